"""One working mode of dyads that are placed one after another from one body, at many poses.

The middle axis of a dyad follows from its outer axes (`spherekit.geometry.dyad_axis`). The
rates of its pairs follow from the triple product of its three axes, and with them the rates
of the inputs per unit angular velocity of the output. Vectors are stored as (3, n) for n
poses, components first, in the axes of the base. Quantities that depend on the signs of
some dyads only are computed once for all modes in which these signs are equal.
"""

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import wraps
from typing import Any, TypeVar

import numpy as np

from spherekit.arrays import Bools, Floats, SmallIntegers
from spherekit.geometry.dyad_axis import middle_axis, triple_square
from spherekit.geometry.vectors import cross_columns, dot_columns, norm_columns
from spherekit.outputs.dyad_chain import DyadChain, Signs
from spherekit.positions.assembly_mode import has_configuration
from spherekit.status import Status
from spherekit.tolerances import REACH_SLACK, SINGULAR_DYAD_SINE


@dataclass(frozen=True)
class RateFraction:
    """A rate that is linear in the angular velocity w of the output, at n poses.

    The rate is ``numerator . w / denominator``. Both parts are finite at singular
    configurations, where the rate itself is not.

    Attributes
    ----------
    numerator
        (3, n) vector in the axes of the base.
    denominator
        (n,) or (1,) number.
    """

    numerator: Floats
    denominator: Floats

    def __add__(self, other: "RateFraction") -> "RateFraction":
        """Return the sum over the common denominator."""
        numerator = self.numerator * other.denominator + other.numerator * self.denominator
        return RateFraction(numerator, self.denominator * other.denominator)

    def __sub__(self, other: "RateFraction") -> "RateFraction":
        """Return the difference over the common denominator."""
        numerator = self.numerator * other.denominator - other.numerator * self.denominator
        return RateFraction(numerator, self.denominator * other.denominator)


@dataclass(frozen=True)
class ClosingLinkState:
    """The state of the closing link of a mechanism at n poses.

    An output that points in a direction can turn about this direction. Once its direction
    and its turn are given, all links but one are placed one after another: two at a time,
    as a dyad (two links with three pairs) between two placed links. The last one, the
    *closing link*, joins two placed links by two pairs. The angle between the axes of these
    pairs must be the arc of the closing link, which is an equation for the turn. The
    residual is the cosine of this angle less the cosine of the arc.

    Attributes
    ----------
    residual_rate
        Rate of the residual while the output has the angular velocity w: a fraction
        ``numerator . w / denominator``.
    directions
        (3, n) directions of the output.
    status
        (n,) codes of `Status`: OK only if the closing link fits and all dyads can be
        assembled.
    """

    residual_rate: RateFraction
    directions: Floats
    status: SmallIntegers


@dataclass(frozen=True)
class DyadReach:
    """How far the dyads of a mode are from the limits of their reach, at n poses.

    A dyad is two links between two supports. It reaches if the angle between its outer axes
    is between the angles at which it is folded and stretched.

    Attributes
    ----------
    margin
        (n,) angle (rad) left to the nearest limit of any dyad; negative out of reach.
    limiting
        (n,) number of the dyad with this margin.
    status
        (n,) OK, AT_SINGULARITY or OUT_OF_REACH.
    """

    margin: Floats
    limiting: SmallIntegers
    status: SmallIntegers


@dataclass(frozen=True)
class DyadTriangle:
    """The parts from which the middle axis of a dyad is composed, at n poses.

    A dyad is two links with three pair axes: the outer axes a and c and the middle axis b.
    These are the corners of a spherical triangle. Its sides from b to a and c are given,
    which leaves two positions of b, one on each side of the plane of a and c:
    ``b = common_part + sign * signed_part``.

    Attributes
    ----------
    common_part
        (3, n) part of the middle axis in the plane of a and c.
    signed_part
        (3, n) part of the middle axis at right angles to this plane, for the sign 1.
    triple_product
        (n,) absolute value of b . (a x c); NaN where the dyad does not reach.
    sum_square, difference_square
        (n,) squares of the lengths of a + c and of a - c. The angle between a and c follows
        from them without loss of digits.
    """

    common_part: Floats
    signed_part: Floats
    triple_product: Floats
    sum_square: Floats
    difference_square: Floats


Result = TypeVar("Result")


def _shared_between_modes(method: Callable[..., Result]) -> Callable[..., Result]:
    """Return a method of `WorkingMode` that reuses results of other modes (a decorator).

    A working mode is a sign for each dyad, which says in which of two ways its two links
    are placed. Many quantities depend on the signs of some dyads only. They are computed
    once for all modes of the same poses in which these signs are equal.

    The arguments of the method must be hashable, and it must read the signs of the same
    dyads in all modes.
    """

    @wraps(method)
    def shared_method(mode: "WorkingMode", *arguments: Hashable) -> Result:
        """Return the result of the decorated method for a mode, computed or stored."""
        return mode.find_or_compute(method, arguments)

    return shared_method


@dataclass(frozen=True)
class WorkingMode:
    """The dyads of a chain at n poses of the output, in one working mode.

    A dyad is two links that can be placed in two ways between their neighbours. A working
    mode has a sign for each dyad, which chooses one of both ways.

    Attributes
    ----------
    chain
        The dyads in solving order.
    signs
        The sign, 1 or -1, of each dyad.
    posed_axes
        Axes (3, n) of pairs of the posed link, by the number of the pair. The posed link is
        the one that is placed by the poses, not by dyads.
    posed_rotation
        (3, 3, n) orientation of the posed link, or None if `posed_axes` has all axes that
        are needed. Index 0 is the axis of the posed link, index 1 the component in the axes
        of the base.
    driven
        Numbers of the pairs of the inputs.
    measure
        Function that computes the measure of type II (n,).
    closing_link
        State of the closing link if there is one, otherwise None.
    shared_results
        Results of all modes of the same poses, by the keys of `_make_result_key`.
    recorded_dyads
        Numbers of the dyads whose signs were read since this object was made.
    """

    chain: DyadChain
    signs: Signs
    posed_axes: Mapping[int, Floats] = field(default_factory=dict)
    posed_rotation: Floats | None = None
    driven: tuple[int, ...] = ()
    measure: "Callable[[WorkingMode], Floats] | None" = None
    closing_link: ClosingLinkState | None = None
    shared_results: dict[Hashable, Any] = field(default_factory=dict)
    recorded_dyads: set[int] = field(default_factory=set)

    def find_or_compute(
        self, method: Callable[..., Result], arguments: tuple[Hashable, ...]
    ) -> Result:
        """Return the result of a method, from another mode if that has computed it.

        A stored result is valid for all modes with the same signs of those dyads that the
        method reads.

        Parameters
        ----------
        method
            A method of this class.
        arguments
            Its arguments.
        """
        quantity = (method.__name__, *arguments)
        # By quantity, the numbers of the dyads whose signs it reads. These are known as
        # soon as the quantity has been computed for some mode.
        dyads_by_quantity = self.chain.sign_dependencies
        is_stored = (
            quantity in dyads_by_quantity
            and self._make_result_key(quantity) in self.shared_results
        )
        if not is_stored:
            result, dyads = self._compute_and_record(method, arguments)
            dyads_by_quantity[quantity] = dyads
            self.shared_results[self._make_result_key(quantity)] = result
        # If this quantity is needed to compute another one, the other one depends on the
        # same signs.
        self.recorded_dyads.update(dyads_by_quantity[quantity])
        return self.shared_results[self._make_result_key(quantity)]  # type: ignore[no-any-return]

    def _make_result_key(self, quantity: tuple[Hashable, ...]) -> tuple[Hashable, ...]:
        """Return the key of a result: the quantity, and this mode's signs that it reads.

        `quantity` is the name of a method with its arguments.
        """
        dyads = self.chain.sign_dependencies[quantity]
        return (quantity, *(self.signs[dyad] for dyad in dyads))

    def _compute_and_record(
        self, method: Callable[..., Result], arguments: tuple[Hashable, ...]
    ) -> tuple[Result, frozenset[int]]:
        """Return the result of a method, and the dyads whose signs it has read.

        Parameters
        ----------
        method
            A method of this class.
        arguments
            Its arguments.
        """
        # This copy of the mode has an empty record of dyads, but uses the same stored
        # results.
        recording_mode = replace(self, recorded_dyads=set())
        # NumPy must not warn of NaN, which is the result at poses out of reach.
        with np.errstate(all="ignore"):
            result = method(recording_mode, *arguments)
        return result, frozenset(recording_mode.recorded_dyads)

    @property
    def inputs(self) -> Floats:
        """(n, inputs) rad in (-pi, pi], NaN where the mode has no configuration."""
        return np.stack([self.input_angle(pair) for pair in self.driven], axis=1)

    @property
    def type_1(self) -> Floats:
        """(n, inputs) speed of the output per unit rate of each input.

        It is 0 at a singularity of type I, where the input moves while the output rests.
        """
        return np.stack([self.output_speed(pair) for pair in self.driven], axis=1)

    @property
    def type_1_square(self) -> Floats:
        """(n, inputs) squares of `type_1`, continued smoothly out of reach.

        The continuation is negative.
        """
        squares = [self._output_speed_square(pair) for pair in self.driven]
        return np.stack(squares, axis=1)

    @property
    def type_2(self) -> Floats:
        """(n,) transmission measure, NaN where the mode has no configuration.

        It is 0 at a singularity of type II, where the output can move with locked inputs.
        """
        assert self.measure is not None
        return np.where(self._has_configuration, self.measure(self), np.nan)

    @property
    def rates(self) -> Floats:
        """(n, inputs, 3) rates of the inputs per unit angular velocity of the output."""
        fractions = [self.input_rate(pair) for pair in self.driven]
        return np.stack(
            [(rate.numerator / rate.denominator).T for rate in fractions], axis=1
        )

    @property
    def slope(self) -> Floats:
        """(n,) derivative of the residual of the closing link by the turn of the output."""
        assert self.closing_link is not None
        rate = self.closing_link.residual_rate
        return dot_columns(rate.numerator, self.closing_link.directions) / rate.denominator

    @property
    def status(self) -> SmallIntegers:
        """(n,) whether the mode closes, see `Inverse`."""
        if self.closing_link is None:
            return self.reach().status
        return self.closing_link.status

    @property
    def _has_configuration(self) -> Bools:
        """(n,) whether the mode closes, at a regular or at a singular configuration."""
        return has_configuration(self.status)

    @_shared_between_modes
    def reach(self) -> DyadReach:
        """Return how far the dyads are from the limits of their reach.

        A dyad is two links with three pairs. It closes if the angle between its outer axes
        a and c is between the angles at which it is folded and stretched. The margin is the
        angle that is left to the nearest of these limits.
        """
        # One array (n,) for each dyad.
        margins = []
        is_regular = []
        for number, dyad in enumerate(self.chain.dyads):
            triangle = self._triangle(number)
            sum_square = triangle.sum_square  # |a + c|^2
            difference_square = triangle.difference_square  # |a - c|^2
            # The angle t between the unit vectors a and c has |a - c| = 2 sin(t / 2) and
            # |a + c| = 2 sin((pi - t) / 2). The smaller length is used. An arc cosine of
            # a . c would lose half the digits near 0 and pi.
            shorter = np.sqrt(np.minimum(sum_square, difference_square))
            half = np.arcsin(np.minimum(0.5 * shorter, 1.0))
            is_obtuse = sum_square < difference_square
            angle = np.where(is_obtuse, np.pi - 2.0 * half, 2.0 * half)
            margins.append(np.minimum(angle - dyad.shortest, dyad.longest - angle))
            # `triple_product` is the product of three sines: of both arcs and of the angle
            # at the middle pair. The last one is 0 where the dyad is stretched or folded.
            # If it is smaller than `SINGULAR_DYAD_SINE` (1e-6), the configuration has only
            # half of its digits, and the status is AT_SINGULARITY.
            least_product = SINGULAR_DYAD_SINE * np.prod(np.sin(dyad.arcs))
            is_regular.append(triangle.triple_product >= least_product)
        # The least margin of all dyads, NaN ignored, and the first dyad that has it.
        margin = np.fmin.reduce(margins)
        has_least_margin = np.array(margins) == margin  # (dyads, n)
        limiting = np.argmax(has_least_margin, axis=0).astype(np.int8)
        status = np.where(np.all(is_regular, axis=0), Status.OK, Status.AT_SINGULARITY)
        # Rounding errors of the arcs may exceed a limit by `REACH_SLACK`. The negated
        # comparison is also true for NaN.
        status[~(margin >= -REACH_SLACK)] = Status.OUT_OF_REACH
        return DyadReach(margin, limiting, status.astype(np.int8))

    def axis(self, pair: int, link: int) -> Floats:
        """Return the axis of a pair, as it is fixed in one of its links, in base axes.

        The shape is (3, n), or (3, 1) if the axis is the same at all poses.
        """
        # Links are placed one after another. If two pairs of a link have one axis line, and
        # one of them joins it to a link placed before, the axis is known from there.
        source = self.chain.axis_source(pair, link)
        axis = self._placed_axis(source.pair, source.link)
        is_opposite = source.sense < 0.0
        return -axis if is_opposite else axis

    def _placed_axis(self, pair: int, link: int) -> Floats:
        """Return the axis of a pair in base axes, from the placement of one of its links.

        The shape is (3, n), or (3, 1) if the axis is the same at all poses.
        """
        chain = self.chain
        # Some axes of the posed link are given with the poses.
        if link == chain.posed_link and pair in self.posed_axes:
            return self.posed_axes[pair]
        # The middle axis of a dyad is found before the orientations of its two links.
        dyad_number = chain.dyad_of_link.get(link)
        if dyad_number is not None and pair == chain.dyads[dyad_number].middle_pair:
            axis, _ = self.signed_middle_axis(dyad_number)
            return axis
        # All other axes are vectors fixed in a link of known orientation.
        return self.vector(link, chain.axis_in(pair, link))

    def vector(self, link: int, vector: Floats) -> Floats:
        """Return a vector (3,) of a link in base axes, (3, n), or (3, 1) of the base."""
        if link == self.chain.base:
            return vector[:, None]
        return self._carried_vector(link, *vector.tolist())

    @_shared_between_modes
    def _carried_vector(self, link: int, x: float, y: float, z: float) -> Floats:
        """Return a vector that is fixed in a link, in base axes (3, n).

        The vector has the components x, y, z in the axes of the link. A link of a dyad has
        an outer pair, at a link placed before, and the middle pair of the dyad. With their
        axes p and q, the vector is a sum of p, q and p x q with constant weights.
        """
        chain = self.chain
        # The posed link is the one whose orientation (3, 3, n) the poses give.
        if link == chain.posed_link:
            assert self.posed_rotation is not None
            # The vector is x, y, z times the three axes of the link. The first index of the
            # orientation is the axis, the second one its component, the third one the pose.
            # The last two are joined, so that one product of matrices sums over the axes.
            flat_rotation = self.posed_rotation.reshape(3, -1)
            return (np.array([x, y, z]) @ flat_rotation).reshape(3, -1)
        dyad = chain.dyads[chain.dyad_of_link[link]]
        outer_pair, _ = chain.support_of(link)
        p = self.axis(outer_pair, link)
        q = self.axis(dyad.middle_pair, link)
        p_weight, q_weight, cross_weight = chain.vector_weights(link, x, y, z)
        return p_weight * p + q_weight * q + cross_weight * cross_columns(p, q)

    def _outer_axes(self, dyad_number: int) -> tuple[Floats, Floats]:
        """Return the axes (3, n) of the near and of the far pair of a dyad."""
        dyad = self.chain.dyads[dyad_number]
        near_axis = self.axis(dyad.near_pair, dyad.near_support)
        far_axis = self.axis(dyad.far_pair, dyad.far_support)
        return near_axis, far_axis

    @_shared_between_modes
    def signed_middle_axis(self, dyad_number: int) -> tuple[Floats, Floats]:
        """Return the middle axis b of a dyad, and the triple product b . (a x c).

        Here a and c are the axes of the near and far pair of the dyad. The axis b is
        (3, n), the product (n,). Both are NaN where the dyad does not reach.
        """
        triangle = self._triangle(dyad_number)
        # Modes with equal signs of this dyad share the result.
        self.recorded_dyads.add(dyad_number)
        # The side of the plane through a and c on which b is, 1 or -1.
        side = self.signs[dyad_number] * self.chain.dyads[dyad_number].positive_mode_side
        axis = triangle.common_part + side * triangle.signed_part
        return axis, side * triangle.triple_product

    @_shared_between_modes
    def _triangle(self, dyad_number: int) -> DyadTriangle:
        """Return the parts of the middle axis of a dyad, for both of its positions.

        The middle axis b has the angles `dyad.arcs` A and C to the outer axes a and c. Its
        two positions are mirror images of each other about the plane of a and c. They are

            b = (cos A + cos C) (a + c) / |a + c|^2 + (cos A - cos C) (a - c) / |a - c|^2
                + t (a x c) / |a x c|^2,
            t^2 = (cos(A - C) - a . c) (a . c - cos(A + C)),

        with both signs of the triple product t = b . (a x c). It is computed from half the
        arcs, since differences of cosines lose digits if a and c are nearly parallel.
        """
        dyad = self.chain.dyads[dyad_number]
        a, c = self._outer_axes(dyad_number)
        total = a + c
        difference = a - c
        sum_square = dot_columns(total, total)
        difference_square = dot_columns(difference, difference)
        triple_product_square = triple_square(
            *dyad.half_arcs, sum_square, difference_square
        )
        # At the limit of the reach rounding errors can make the square negative.
        is_rounding = (triple_product_square < 0.0) & (triple_product_square > -REACH_SLACK)
        triple_product_square[is_rounding] = 0.0
        triple_product = np.sqrt(triple_product_square)
        sum_weight, difference_weight, cross_weight = middle_axis(
            *dyad.half_arcs, sum_square, difference_square, triple_product
        )
        common_part = total * sum_weight
        # With equal arcs b is in the middle between a and c.
        if dyad.arcs[0] != dyad.arcs[1]:
            common_part += difference * difference_weight
        # (a - c) x (a + c) is 2 a x c. Unlike a x c it keeps its relative accuracy if a and
        # c nearly coincide.
        signed_part = cross_columns(difference, total)
        signed_part *= 0.5 * cross_weight
        return DyadTriangle(
            common_part=common_part,
            signed_part=signed_part,
            triple_product=triple_product,
            sum_square=sum_square,
            difference_square=difference_square,
        )

    @_shared_between_modes
    def angle(self, pair: int) -> Floats:
        """Return the variable (n,) of a pair in (-pi, pi] rad, NaN out of reach.

        Take one vector in each link of the pair, not parallel to its axis. The variable is
        the angle about the axis from the vector of the first link to that of the second
        link, less the same angle in the position where the variable is 0. The difference of
        both angles is computed from their cosines and sines, by the addition theorem.
        """
        first_link, second_link = self.chain.ends[pair]
        # Each vector in base axes (3, n), and its components (3,) in the frame of the pair
        # in its link. z of this frame is the axis of the pair.
        first_vector, first_components = self._find_vector_off_axis(pair, first_link)
        second_vector, second_components = self._find_vector_off_axis(pair, second_link)
        # Cosine and sine of the angle between the vectors, times their distances from the
        # axis. The components along the axis drop out.
        cosine = dot_columns(first_vector, second_vector)
        cosine = cosine - first_components[2] * second_components[2]
        sine = dot_columns(
            self.axis(pair, second_link), cross_columns(first_vector, second_vector)
        )
        # The same at the variable 0, where the frames of the pair in both links coincide,
        # so that the components are in the same axes.
        zero_cosine = (
            second_components[0] * first_components[0]
            + second_components[1] * first_components[1]
        )
        zero_sine = (
            second_components[1] * first_components[0]
            - second_components[0] * first_components[1]
        )
        return np.arctan2(
            sine * zero_cosine - cosine * zero_sine,
            cosine * zero_cosine + sine * zero_sine,
        )

    def _find_vector_off_axis(self, pair: int, link: int) -> tuple[Floats, Floats]:
        """Return a vector of a link that is not parallel to the axis of a pair.

        The pair angle is measured between such a vector of its first link and one of its
        second link.

        Returns
        -------
        vector
            (3, n) in base axes at n poses; (3, 1) if it is the same at all poses, because
            it is fixed in the base.
        components
            (3,) the same vector in the frame of the pair in this link.
        """
        chain = self.chain
        pair_frame = chain.frame_in(pair, link)  # (3, 3); columns are its x, y and z axis
        # The orientations of the base and of the posed link are known, so any vector of
        # them is known. x of the frame is at right angles to the axis of the pair, z.
        if link in (chain.base, chain.posed_link):
            return self.vector(link, pair_frame[:, 0]), np.array([1.0, 0.0, 0.0])
        # Of a link of a dyad, the axes of its pairs are known first.
        other_pair = self._choose_pair_off_axis(pair, link)
        axis_in_link = chain.axis_in(other_pair, link)
        # Scalar products with the columns of the frame.
        components = axis_in_link @ pair_frame
        return self.axis(other_pair, link), components

    def _choose_pair_off_axis(self, pair: int, link: int) -> int:
        """Return a pair of a dyad's link whose axis is not parallel to that of a pair.

        The link has the middle pair of its dyad, and an outer pair that joins it to a link
        placed before. The middle pair is chosen unless its axis is parallel.
        """
        chain = self.chain
        middle_pair = chain.dyads[chain.dyad_of_link[link]].middle_pair
        if pair != middle_pair and not chain.is_coaxial(pair, middle_pair, link):
            return middle_pair
        outer_pair, _support = chain.support_of(link)
        return outer_pair

    @_shared_between_modes
    def input_angle(self, pair: int) -> Floats:
        """Return an input (n,) in rad, NaN where the mode has no configuration."""
        return np.where(self._has_configuration, self.angle(pair), np.nan)

    @_shared_between_modes
    def pair_rate(self, pair: int) -> RateFraction:
        """Return the rate of a pair's variable per unit angular velocity of the output.

        The result is a fraction ``numerator . w / denominator`` with the angular velocity w
        of the output.

        The pair belongs to a dyad, two links between two links placed before, its supports.
        The relative angular velocity of the supports is a sum of three vectors along the
        axes of the dyad, whose lengths are the rates of its pairs. By Cramer's rule, one
        rate is the scalar product of this velocity and the vector product of the other two
        axes, divided by the triple product of all three.

        Notes
        -----
        The near, middle and far pair of the dyad have the axes a, b, c and the rates A, B,
        C. The supports have the angular velocities w_near and w_far, so that

            w_near + a A = w_far + c C - b B.

        The scalar product of this equation with the vector product of two axes leaves only
        the rate of the third pair, times the triple product of the axes:

            A = (b x c) . (w_far - w_near) / -t,    t = b . (a x c),
            B = (c x a) . (w_far - w_near) / -t,
            C = (b x a) . (w_far - w_near) / -t.

        A and C are the rates of the links of the dyad relative to their supports, B is that
        of the far link relative to the near link.
        """
        chain = self.chain
        dyad_number = chain.dyad_of_pair[pair]
        dyad = chain.dyads[dyad_number]
        a, c = self._outer_axes(dyad_number)
        # The sign of the triple product t is that of the working mode.
        b, triple_product = self.signed_middle_axis(dyad_number)
        # 1. The vector product of the other two axes, at right angles to both.
        if pair == dyad.near_pair:
            normal = cross_columns(b, c)
        elif pair == dyad.middle_pair:
            normal = cross_columns(c, a)
        else:
            normal = cross_columns(b, a)
        # 2. The component of w_far - w_near along it. Rotations about the other two axes
        # have no such component, so their rates need not be computed.
        other_pairs = [number for number in dyad.pairs if number != pair]
        far_component = self.angular_velocity_along(normal, dyad.far_support, other_pairs)
        near_component = self.angular_velocity_along(normal, dyad.near_support, other_pairs)
        component = far_component - near_component
        # 3. The formulas divide by -t. They count the rates A, B, C as those of this link,
        # relative to the other link of the pair.
        counted_link = dyad.near_link if pair == dyad.near_pair else dyad.far_link
        # The variable of a pair is that of its second link relative to its first one. If
        # the link is the first one, the rate has the opposite sign.
        if chain.ends[pair][1] == counted_link:
            divisor = -triple_product
        else:
            divisor = triple_product
        return RateFraction(component.numerator, component.denominator * divisor)

    def angular_velocity_along(
        self, vector: Floats, link: int, normal_pairs: Sequence[int] = ()
    ) -> RateFraction:
        """Return the scalar product of a vector and the angular velocity of a link.

        The result is linear in the angular velocity w of the output. It is a fraction
        ``numerator . w / denominator``, both parts of which are finite at singularities.

        A link of a dyad is joined to its support, a link placed before, by an outer pair of
        the dyad. Its angular velocity is that of the support plus the rate of this pair
        along its axis. The support is treated in the same way. This ends at the base, whose
        angular velocity is 0, or at the posed link, which moves as the output does.

        Parameters
        ----------
        vector
            (3, n) vector.
        link
            Number of the link; its angular velocity is relative to the base.
        normal_pairs
            Pairs whose axes are at right angles to the vector. Rotation about these axes
            adds nothing to the scalar product, so its rate is not computed.
        """
        chain = self.chain
        if link == chain.base:
            return RateFraction(np.zeros((3, 1)), np.ones(1))
        # The posed link moves as the output does: vector . w.
        if link == chain.posed_link:
            return RateFraction(vector, np.ones(1))
        outer_pair, support = chain.support_of(link)
        if self._is_on_one_axis(outer_pair, normal_pairs, link):
            # The axis of the outer pair is at right angles to the vector, too. The link
            # and its support have the same angular velocity along the vector.
            return self.angular_velocity_along(vector, support, [outer_pair])
        support_part = self.angular_velocity_along(vector, support)
        # The rate of the second link of the pair relative to the first one.
        pair_rate = self.pair_rate(outer_pair)
        axis_component = dot_columns(vector, self.axis(outer_pair, link))
        pair_part = RateFraction(
            pair_rate.numerator * axis_component, pair_rate.denominator
        )
        is_second_link = chain.ends[outer_pair][1] == link
        return support_part + pair_part if is_second_link else support_part - pair_part

    def _is_on_one_axis(self, pair: int, other_pairs: Sequence[int], link: int) -> bool:
        """Return whether a pair of a link is coaxial with one of several other pairs.

        Only those of the other pairs that this link has are compared.
        """
        chain = self.chain
        pairs_of_link = [number for number in other_pairs if link in chain.ends[number]]
        return any(chain.is_coaxial(pair, number, link) for number in pairs_of_link)

    @_shared_between_modes
    def input_rate(self, pair: int) -> RateFraction:
        """Return the rate of an input per unit angular velocity of the output.

        The result is a fraction ``numerator . w / denominator`` with the angular velocity w
        of the output.

        An output that is a direction d can turn about it. In some mechanisms a last link,
        the closing link, determines this turn. It joins two links that are placed already.
        Its residual states by how much it does not fit, and the rate s . w of the residual
        must be 0. Here

        - w = v + k d, where v moves the direction and k is the rate of the turn,
        - k = -(s . v) / (s . d), so that the closing link fits,
        - r . w is the rate of the input, equal to ((s . d) r - (r . d) s) . v / (s . d).

        This numerator is at right angles to d, so it may be multiplied by w instead of v.
        """
        rate = self.pair_rate(pair)
        if self.closing_link is not None:
            directions = self.closing_link.directions
            residual_rate = self.closing_link.residual_rate
            rate_by_turn = dot_columns(rate.numerator, directions)
            residual_by_turn = dot_columns(residual_rate.numerator, directions)
            rate = RateFraction(
                rate.numerator * residual_by_turn - residual_rate.numerator * rate_by_turn,
                rate.denominator * residual_by_turn,
            )
        return rate

    @_shared_between_modes
    def _numerator_length(self, pair: int) -> Floats:
        """Return the length (n,) of the numerator of the rate of an input."""
        return norm_columns(self.input_rate(pair).numerator)

    def output_normal(self, pair: int) -> Floats:
        """Return the unit vector (3, n) along which an angular velocity drives an input.

        The rate of the input is proportional to the component of the output's angular
        velocity along this vector, and has its sign. With the input locked and the other
        inputs free, the angular velocity is at right angles to it.
        """
        rate = self.input_rate(pair)
        return rate.numerator * (np.sign(rate.denominator) / self._numerator_length(pair))

    @_shared_between_modes
    def output_speed(self, pair: int) -> Floats:
        """Return the speed (n,) of the output along its normal per unit rate of an input.

        This is the measure of type I of the input.
        """
        return np.abs(self.input_rate(pair).denominator) / self._numerator_length(pair)

    def _output_speed_square(self, pair: int) -> Floats:
        """Return the square (n,) of `output_speed`, continued to poses out of reach.

        `output_speed` is the speed of the output per unit rate of the input `pair`, an
        outer pair of a dyad. The border of a workspace is searched where its square is
        zero. This needs numbers on both sides, also where a dyad does not reach the pose.
        """
        square = self.output_speed(pair) ** 2
        is_out_of_reach = np.isnan(square)
        return np.where(is_out_of_reach, self._continue_speed_square(pair), square)

    def _continue_speed_square(self, pair: int) -> Floats:
        """Return values (n,) for the square of the output speed at poses out of reach.

        If the dyad of the input is between the base and the output's link, the speed is
        ``|b . (a x c)| / sin(arc)``, with the axes a, b, c of the dyad and the arc of that
        link of the dyad which the input does not join. The square of the triple product is
        a function of a and c alone. It passes through 0 smoothly, and is negative where
        the dyad does not reach. For other dyads the same function is used. The squared
        speed may then have a kink at 0.

        Positive values and NaN are replaced by 0. The dyad of the input reaches such a pose
        or has no outer axes, so that another dyad is out of reach.
        """
        dyad_number = self.chain.dyad_of_pair[pair]
        dyad = self.chain.dyads[dyad_number]
        near_arc, far_arc = dyad.arcs
        other_arc = far_arc if pair == dyad.near_pair else near_arc
        triangle = self._triangle(dyad_number)
        # |a + c|^2 and |a - c|^2 stand for a . c. They lose no digits near 0 and pi.
        triple_product_square = triple_square(
            *dyad.half_arcs, triangle.sum_square, triangle.difference_square
        )
        # Unlike `minimum`, `fmin` returns the other number if one is NaN.
        return np.fmin(triple_product_square / np.sin(other_arc) ** 2, 0.0)

    def axes(self, count: int) -> Floats:
        """Return the axes (n, count, 3) of the first `count` pairs in base axes.

        They are NaN where the mode has no configuration.
        """
        axes = np.empty((len(self.status), count, 3))
        for pair in range(count):
            axes[:, pair] = self._earliest_axis(pair).T
        return axes

    def cosine(self, first_pair: int, second_pair: int) -> Floats:
        """Return the cosine (n,) of the angle between the axes of two pairs.

        NaN where an axis cannot be placed; it may be known where the mode does not close.
        """
        cosine = dot_columns(
            self._earliest_axis(first_pair), self._earliest_axis(second_pair)
        )
        return np.broadcast_to(cosine, len(self.status))

    def _earliest_axis(self, pair: int) -> Floats:
        """Return the axis (3, n) of a pair, from the one of its links placed first."""
        chain = self.chain
        order = {**chain.dyad_of_link, chain.base: -1, chain.posed_link: -1}
        first = min(chain.ends[pair], key=lambda link: order.get(link, np.inf))
        return self.axis(pair, first)
