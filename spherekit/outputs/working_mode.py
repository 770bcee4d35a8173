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

    When a method runs for the first time with some arguments, the dyads whose signs it
    reads are recorded. It must read the signs of the same dyads in all modes. The key of a
    stored result is the name of the method, its arguments (which must be hashable) and the
    signs that it has read.
    """
    name = method.__name__

    @wraps(method)
    def shared_method(mode: "WorkingMode", *arguments: Hashable) -> Result:
        """Return the result of the decorated `method` for a mode, computed or stored."""
        # For each quantity (the method with its arguments), the dyads whose signs it reads.
        sign_dependencies = mode.chain.sign_dependencies
        quantity = (name, *arguments)

        def make_key() -> tuple[Hashable, ...]:
            """Return the key of the result: the quantity with the signs that it reads."""
            return (quantity, *(mode.signs[dyad] for dyad in sign_dependencies[quantity]))

        key = make_key() if quantity in sign_dependencies else None
        if key is None or key not in mode.shared_results:
            # A copy of the mode, with the same store, records the signs that are read.
            # NumPy must not warn of NaN, which is the result at poses out of reach.
            recording_mode = replace(mode, read_signs=set())
            with np.errstate(all="ignore"):
                result = method(recording_mode, *arguments)
            sign_dependencies[quantity] = frozenset(recording_mode.read_signs)
            key = make_key()
            mode.shared_results[key] = result
        # Another decorated method may be calling this one on `mode`. Its own result then
        # depends on the same signs.
        mode.read_signs.update(sign_dependencies[quantity])
        return mode.shared_results[key]  # type: ignore[no-any-return]

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
        Results of all modes of the same poses, see `_shared_between_modes`.
    read_signs
        Numbers of the dyads whose signs were read.
    """

    chain: DyadChain
    signs: Signs
    posed_axes: Mapping[int, Floats] = field(default_factory=dict)
    posed_rotation: Floats | None = None
    driven: tuple[int, ...] = ()
    measure: "Callable[[WorkingMode], Floats] | None" = None
    closing_link: ClosingLinkState | None = None
    shared_results: dict[Hashable, Any] = field(default_factory=dict)
    read_signs: set[int] = field(default_factory=set)

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
        chain = self.chain
        # The orientations of links are computed one after another. The axis may be needed
        # before the orientation of its link is known. For example, two pairs of the link
        # have the same axis line, and one of them joins it to an earlier link. The axis is
        # then taken from this pair in the earlier link. `source` is the pair and link from
        # which the axis is taken. `source.sense` is negative if both axes point in opposite
        # directions.
        source = chain.axis_source(pair, link)
        dyad = chain.dyad_of_link.get(source.link)
        # The poses are those of one link, the posed link. `posed_axes` has the axes of this
        # link that the poses determine directly. All other links belong to dyads (two links
        # joined by a middle pair). The axis of the middle pair is computed first, as one of
        # two intersections, and the orientations of both links follow from it.
        if source.link == chain.posed_link and source.pair in self.posed_axes:
            axis = self.posed_axes[source.pair]
        elif dyad is not None and source.pair == chain.dyads[dyad].middle_pair:
            axis, _ = self.signed_middle_axis(dyad)
        else:
            # A vector fixed in the link, whose orientation is known.
            axis = self.vector(source.link, chain.axis_in(source.pair, source.link))
        return -axis if source.sense < 0.0 else axis

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
        self.read_signs.add(dyad_number)
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
        first_vector, first_components = self._vector_off_axis(pair, first_link)
        second_vector, second_components = self._vector_off_axis(pair, second_link)
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

    def _vector_off_axis(self, pair: int, link: int) -> tuple[Floats, Floats]:
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
        frame = chain.frame_in(pair, link)  # (3, 3); column 2 is the axis of the pair
        # The orientation of the base is known, and that of the posed link is given by the
        # poses. Any vector of these links is known in base axes: here column 0 (x) of the
        # frame, which is at right angles to the axis.
        if link in (chain.base, chain.posed_link):
            return self.vector(link, frame[:, 0]), np.array([1.0, 0.0, 0.0])
        # Any other link belongs to a dyad: two links that are joined by a middle pair. An
        # outer pair joins each of them to a link whose orientation is known already, its
        # support. So the link has a middle and an outer pair, whose axes are known in base
        # axes. The vector is the axis of the middle pair, or of the outer pair if the
        # middle one is parallel to the axis of `pair`.
        other_pair = chain.dyads[chain.dyad_of_link[link]].middle_pair
        if pair == other_pair or chain.is_coaxial(pair, other_pair, link):
            other_pair, _ = chain.support_of(link)
        # Columns of `frame` are its unit vectors in link axes. So this product has the
        # components of the axis along them.
        components = chain.axis_in(other_pair, link) @ frame
        return self.axis(other_pair, link), components

    @_shared_between_modes
    def input_angle(self, pair: int) -> Floats:
        """Return an input (n,) in rad, NaN where the mode has no configuration."""
        return np.where(self._has_configuration, self.angle(pair), np.nan)

    @_shared_between_modes
    def pair_rate(self, pair: int) -> RateFraction:
        """Return the rate of a pair's variable per unit angular velocity of the output.

        The result is a fraction ``numerator . w / denominator`` with the angular velocity w
        of the output.

        The pair belongs to a dyad, which joins two links placed before, its supports. The
        relative angular velocity of the supports is a sum of three vectors along the axes
        of the dyad, whose lengths are the rates of its pairs. By Cramer's rule, one rate is
        the scalar product of this velocity and the vector product of the other two axes,
        divided by the triple product of all three.

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
        dyad_number = self.chain.dyad_of_pair[pair]
        dyad = self.chain.dyads[dyad_number]
        a, c = self._outer_axes(dyad_number)
        # The sign of the triple product t is that of the working mode.
        b, triple_product = self.signed_middle_axis(dyad_number)
        other_axes = {
            dyad.near_pair: (b, c),
            dyad.middle_pair: (c, a),
            dyad.far_pair: (b, a),
        }[pair]
        normal = cross_columns(*other_axes)
        other_pairs = [number for number in dyad.pairs if number != pair]
        far_rate = self.angular_velocity_along(normal, dyad.far_support, other_pairs)
        near_rate = self.angular_velocity_along(normal, dyad.near_support, other_pairs)
        rate = far_rate - near_rate
        # The formulas give the rate of this link relative to the other link of the pair.
        link = dyad.near_link if pair == dyad.near_pair else dyad.far_link
        # The variable of a pair is counted from its first to its second link.
        is_second_link = self.chain.ends[pair][1] == link
        sign = -triple_product if is_second_link else triple_product
        return RateFraction(rate.numerator, rate.denominator * sign)

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
        pair, support = chain.support_of(link)
        if any(
            link in chain.ends[normal_pair] and chain.is_coaxial(pair, normal_pair, link)
            for normal_pair in normal_pairs
        ):
            # The outer pair turns the link about an axis at right angles to the vector.
            return self.angular_velocity_along(vector, support, [pair])
        pair_rate = self.pair_rate(pair)
        component = dot_columns(vector, self.axis(pair, link))
        # The result is the part of the support plus that of the pair. Fractions have a
        # method for the difference only, so the part of the pair is subtracted with the
        # opposite sign. A rate is that of the second link of a pair relative to the first.
        is_second_link = chain.ends[pair][1] == link
        subtracted_component = -component if is_second_link else component
        subtracted_rate = RateFraction(
            pair_rate.numerator * subtracted_component, pair_rate.denominator
        )
        return self.angular_velocity_along(vector, support) - subtracted_rate

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
        zero. This needs numbers on both sides, also where the dyad does not reach.

        If the dyad is between the base and the output's link, the speed is
        ``|b . (a x c)| / sin(arc)``, with the axes a, b, c of the dyad and the arc of that
        link of the dyad which the input does not join. The square of the triple product is
        a function of a and c alone. It is negative where the dyad does not reach, so that
        there is no b. It passes through 0 smoothly. For other dyads the same continuation
        is used, but it may have a kink.
        """
        dyad_number = self.chain.dyad_of_pair[pair]
        square = self.output_speed(pair) ** 2
        dyad = self.chain.dyads[dyad_number]
        other_arc = dyad.arcs[1 if pair == dyad.near_pair else 0]
        triangle = self._triangle(dyad_number)
        # |a + c|^2 and |a - c|^2 stand for a . c. They lose no digits near 0 and pi.
        triple_product_square = triple_square(
            *dyad.half_arcs, triangle.sum_square, triangle.difference_square
        )
        # The speed is NaN if any dyad does not reach. If it is another dyad, the square of
        # the triple product of this one is positive or NaN. `fmin` then returns 0.
        continuation = np.fmin(triple_product_square / np.sin(other_arc) ** 2, 0.0)
        return np.where(np.isnan(square), continuation, square)

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
