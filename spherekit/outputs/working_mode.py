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
from spherekit.numerics.angles import wrap
from spherekit.outputs.dyad_chain import DyadChain, Signs
from spherekit.positions.assembly_mode import has_configuration
from spherekit.status import Status
from spherekit.tolerances import REACH_SLACK, SINGULAR_DYAD_SINE


@dataclass(frozen=True)
class RateFraction:
    """A rate as a fraction ``numerator . w / denominator``, at n poses.

    The rate is, for example, that of an input or of another pair. It is a linear function
    of the angular velocity w of the output. At singular configurations the denominator can
    be 0. The rate is then infinite, but both parts of the fraction are finite. The parts
    are therefore stored separately.

    Attributes
    ----------
    numerator
        (3, n) vector in the axes of the base, or (3, 1) if it is the same at all poses.
    denominator
        (n,) number, or (1,) if it is the same at all poses.
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

    A pose is a direction of the output link, which can still turn about this direction.
    Direction and turn place the output link. All other links but one are then placed in
    dyads (two links that are joined by a pair). The remaining link, the *closing link*,
    joins two placed links. It fits if the angle between the axes of its two pairs is its
    arc. This is an equation for the turn. The residual is the cosine of this angle less the
    cosine of the arc.

    Attributes
    ----------
    residual_rate
        Rate of the residual while the output has the angular velocity w: a fraction
        ``numerator . w / denominator``. In a motion the residual stays 0. From this follows
        the rate of the turn, on which the rates of the inputs depend.
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
    """How far a mechanism of dyads is from the limits of its reach, at n poses.

    A dyad is two links, joined by a middle pair, between two other links. Its two outer
    pairs join it to these other links. A dyad reaches if the angle between its outer axes
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
class MiddleAxisParts:
    """The parts from which the middle axis of a dyad is composed, at n poses.

    A dyad is two links with three pair axes: the outer axes a and c and the middle axis b.
    These axes are the corners of a spherical triangle. The sides of this triangle from b to
    a and c are given, which leaves two positions of b, one on each side of the plane of a
    and c: ``b = common_part + side * signed_part`` with the side 1 or -1.

    Attributes
    ----------
    common_part
        (3, n) part of the middle axis in the plane of a and c.
    signed_part
        (3, n) part of the middle axis at right angles to this plane, for the side 1. NaN
        where the dyad does not reach, and where a and c are parallel.
    triple_product_square
        (n,) square of the triple product b . (a x c), negative where the dyad does not
        reach. The square is a smooth function of the angle between a and c.
    triple_product
        (n,) absolute value of b . (a x c); NaN where the dyad does not reach.
    sum_square, difference_square
        (n,) squares of the lengths of a + c and of a - c. The angle between a and c follows
        from these squares without loss of digits.
    """

    common_part: Floats
    signed_part: Floats
    triple_product_square: Floats
    triple_product: Floats
    sum_square: Floats
    difference_square: Floats

    @property
    def outer_angle(self) -> Floats:
        """(n,) angle (rad) from 0 to pi between the outer axes a and c of a dyad.

        The unit vectors a and c at the angle u have ``|a - c| = 2 sin(u / 2)`` and
        ``|a + c| = 2 sin((pi - u) / 2)``. The smaller length is used, because an arc cosine
        of a . c would lose half of the digits near 0 and pi.
        """
        shorter = np.sqrt(np.minimum(self.sum_square, self.difference_square))
        half = np.arcsin(np.minimum(0.5 * shorter, 1.0))
        is_obtuse = self.sum_square < self.difference_square
        return np.where(is_obtuse, np.pi - 2.0 * half, 2.0 * half)


@dataclass(frozen=True)
class PairRateEquation:
    """The equation for the rate of one pair of a dyad, at n poses.

    The equation gives the rate from the motion of the supports, the two links to which the
    dyad is joined.

    A dyad is two links, joined by a middle pair with the axis b. The near pair (axis a) and
    the far pair (axis c) join the dyad to its near and its far support. These have the
    angular velocities w_near and w_far. The rate of a pair is the rate of one of its links,
    the moving link, as seen from its other link. The moving link is the near link for the
    near pair, and the far link for the other two pairs. With the rates A, B, C of the three
    pairs, the angular velocity of the far link is

        w_near + a A + b B = w_far + c C.

    The scalar product with a normal of two axes leaves the rate of the third pair:

        normal . (w_far - w_near) = -triple_product * rate.

    Attributes
    ----------
    normal
        (3, n) vector product of the axes of the other two pairs of the dyad: b x c for the
        near pair, c x a for the middle pair, b x a for the far pair.
    triple_product
        (n,) triple product b . (a x c).
    moving_link
        Number of the moving link.
    """

    normal: Floats
    triple_product: Floats
    moving_link: int


@dataclass(frozen=True)
class LinkVector:
    """A vector fixed in a link, with components in the base and in the frame of a pair.

    Pair angles are measured between two such vectors.

    Attributes
    ----------
    in_base
        (3, n) components in the axes of the base at n poses; (3, 1) if they are the same at
        all poses.
    in_pair_frame
        (3,) components in the frame of a pair in this link. The z axis of this frame is the
        axis of the pair.
    """

    in_base: Floats
    in_pair_frame: Floats


@dataclass(frozen=True)
class ScaledAngle:
    """An angle, represented by its cosine and sine times a common positive factor.

    The factor need not be known, since it cancels in the arc tangent.

    Attributes
    ----------
    cosine, sine
        Cosine and sine times the factor, numbers or arrays (n,).
    """

    cosine: Floats
    sine: Floats

    def subtract(self, other: "ScaledAngle") -> Floats:
        """Return this angle less another one, in (-pi, pi] rad (addition theorem)."""
        # The factors of both angles cancel in the quotient that `arctan2` forms. Half a
        # turn with a sine of -0 or of a tiny negative number is -pi there, which `wrap`
        # makes pi.
        return wrap(
            np.arctan2(
                self.sine * other.cosine - self.cosine * other.sine,
                self.cosine * other.cosine + self.sine * other.sine,
            )
        )


Result = TypeVar("Result")


def _shared_between_modes(method: Callable[..., Result]) -> Callable[..., Result]:
    """Decorate a method of `WorkingMode` so that several modes share its results.

    A working mode is a sign for each dyad (two links), which chooses one of two ways to
    place it. Many quantities depend on the signs of some dyads only. Such a quantity is
    computed once for all modes of the same poses in which these signs are equal.

    When the method is computed for the first time, `find_or_compute` records the dyads
    whose signs it reads. It must therefore read the signs of the same dyads in all modes.
    The arguments of the method must be hashable.
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
        the link that is placed by the poses, not by dyads.
    posed_rotation
        (3, 3, n) orientation of the posed link, or None if `posed_axes` has all axes that
        the dyads need. Index 0 is the axis of the posed link, index 1 the component in the
        axes of the base.
    driven
        Numbers of the pairs of the inputs.
    measure
        Function that computes the transmission measure (n,), see `type_2`.
    closing_link
        State of the closing link if there is one, otherwise None.
    shared_results
        Results of all modes of the same poses, by the keys of `_make_result_key`.
    recorded_dyads
        Numbers of the dyads on whose signs results have depended since this object was
        created.
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
        """Return the result of a method, which may have been computed for another mode.

        A working mode is a sign for each dyad (two links). A method may depend on the signs
        of some dyads only. All modes in which these signs are equal share its result. For
        example, the middle axis of dyad 0 depends on the sign of dyad 0 only. The modes (1,
        1) and (1, -1) of two dyads therefore have the same middle axis of dyad 0.

        Parameters
        ----------
        method
            A method of this class.
        arguments
            Arguments of the method.
        """
        quantity = (method.__name__, *arguments)
        # The dyads whose signs a method reads are known once it has been computed for any
        # mode. Before that, nothing is stored.
        if not self._is_stored(quantity):
            self._compute_and_store(quantity, method, arguments)
        # The numbers of the dyads whose signs the quantity depends on.
        dyads = self.chain.sign_dependencies[quantity]
        # This method may be called while another quantity is computed, which then depends
        # on the same signs. `recorded_dyads` collects the dyads for that quantity.
        self.recorded_dyads.update(dyads)
        return self.shared_results[self._make_result_key(quantity)]  # type: ignore[no-any-return]

    def _is_stored(self, quantity: tuple[Hashable, ...]) -> bool:
        """Return whether a mode with the same relevant signs has computed a quantity.

        A quantity is the name of a method with its arguments. It depends on the signs
        (positions) of some dyads only. Which dyads these are is known after the first
        computation.
        """
        has_known_signs = quantity in self.chain.sign_dependencies
        return has_known_signs and self._make_result_key(quantity) in self.shared_results

    def _make_result_key(self, quantity: tuple[Hashable, ...]) -> tuple[Hashable, ...]:
        """Return the key of a stored result: the quantity, and the signs it depends on.

        Modes with the same key share the result. `quantity` is the name of a method with
        its arguments. A sign tells which of two positions a dyad (two links) has.
        """
        dyads = self.chain.sign_dependencies[quantity]
        return (quantity, *(self.signs[dyad] for dyad in dyads))

    def _compute_and_store(
        self,
        quantity: tuple[Hashable, ...],
        method: Callable[..., Result],
        arguments: tuple[Hashable, ...],
    ) -> None:
        """Compute a quantity, record which dyads it depends on, and store the result.

        A working mode is a sign for each dyad (two links). The record has the dyads whose
        signs are read. Other modes with the same signs of these dyads can use the result.

        Parameters
        ----------
        quantity
            Tuple of the name of the method and its arguments. It is a part of the key under
            which the result is stored.
        method
            A method of this class.
        arguments
            Arguments of the method.
        """
        # The methods add each dyad whose sign they read to `recorded_dyads` of their mode.
        # A copy of this mode with an empty record collects the dyads of this quantity
        # alone. The copy shares the stored results with this mode.
        recording_mode = replace(self, recorded_dyads=set())
        # NumPy must not warn of NaN, which is the result at poses out of reach.
        with np.errstate(all="ignore"):
            result = method(recording_mode, *arguments)
        dyads = frozenset(recording_mode.recorded_dyads)
        self.chain.sign_dependencies[quantity] = dyads
        self.shared_results[self._make_result_key(quantity)] = result

    @property
    def inputs(self) -> Floats:
        """(n, inputs) rad in (-pi, pi].

        NaN where the mode has no configuration, or does not determine the input.
        """
        return np.stack([self.input_angle(pair) for pair in self.driven], axis=1)

    @property
    def type_1(self) -> Floats:
        """(n, inputs) angular speed of the output per unit rate of each input, at n poses.

        The speed is 0 at a singularity of type I, where the input moves while the output
        rests.
        """
        return _stack_inputs([self.output_speed(pair) for pair in self.driven])

    @property
    def type_1_square(self) -> Floats:
        """(n, inputs) squares of `type_1`, continued out of reach.

        The continuation is negative where the dyad of the input does not reach, and 0 where
        its outer axes are unknown.
        """
        return _stack_inputs([self._output_speed_square(pair) for pair in self.driven])

    @property
    def type_2(self) -> Floats:
        """(n,) transmission measure: how well the locked inputs hold the output.

        The measure is 0 at a singularity of type II, where the output can move with locked
        inputs, and NaN where the mode has no configuration.
        """
        assert self.measure is not None
        return np.where(self._has_configuration, self.measure(self), np.nan)

    @property
    def rates(self) -> Floats:
        """(n, inputs, 3) rates of the inputs per unit angular velocity of the output."""
        fractions = [self.input_rate(pair) for pair in self.driven]
        return _stack_inputs([(rate.numerator / rate.denominator).T for rate in fractions])

    @property
    def slope(self) -> Floats:
        """(n,) derivative of the residual of the closing link, d(residual)/d(turn)."""
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
        """Return how far the mechanism is from the limits of its reach.

        The mechanism consists of dyads (two links between two others). Each dyad has a
        margin, the angle left until it is stretched or folded. The least margin of all
        dyads counts. The configuration is singular if a dyad is nearly stretched or folded.
        """
        numbers = range(len(self.chain.dyads))
        # The outer axes of a dyad belong to the pairs that join it to other links. If they
        # are the same at all poses, its margin is an array (1,) instead of (n,).
        margins = np.array(
            np.broadcast_arrays(*(self._dyad_margin(number) for number in numbers))
        )
        is_regular = np.broadcast_arrays(
            *(self._is_dyad_regular(number) for number in numbers)
        )
        # The margin is NaN for dyads that are placed after a dyad that does not reach,
        # because the links beside them have no place. `fmin` ignores NaN.
        margin = np.fmin.reduce(margins)
        # Index of the first dyad with the least margin.
        limiting = np.argmax(margins == margin, axis=0).astype(np.int8)
        status = np.where(np.all(is_regular, axis=0), Status.OK, Status.AT_SINGULARITY)
        # A margin that is negative by less than `REACH_SLACK` may be a rounding error. The
        # comparison is false for NaN, so that NaN counts as out of reach.
        is_within_reach = margin >= -REACH_SLACK
        status[~is_within_reach] = Status.OUT_OF_REACH
        return DyadReach(margin, limiting, status.astype(np.int8))

    def _dyad_margin(self, dyad_number: int) -> Floats:
        """Return the margin (n,) of a dyad in rad, negative where it does not reach.

        A dyad is two links with three pairs. It closes if the angle between its outer axes
        is between the angles at which it is folded and stretched. The margin is the angle
        that is left to the nearer one of these limits.
        """
        dyad = self.chain.dyads[dyad_number]
        angle = self._middle_axis_parts(dyad_number).outer_angle
        return np.minimum(angle - dyad.shortest, dyad.longest - angle)

    def _is_dyad_regular(self, dyad_number: int) -> Bools:
        """Return, for each of n poses, whether a dyad (two links) is well determined.

        A dyad is badly determined if it is nearly stretched or nearly folded, or out of
        reach. The triple product of its three axes is the product of three sines: of both
        arcs and of the angle at the middle pair (joint). The last sine is 0 where the dyad
        is stretched or folded. If the last sine is below `SINGULAR_DYAD_SINE` (1e-6), the
        configuration loses half of its digits.
        """
        dyad = self.chain.dyads[dyad_number]
        least_product = SINGULAR_DYAD_SINE * np.prod(np.sin(dyad.arcs))
        # False where the triple product is NaN, out of reach.
        return self._middle_axis_parts(dyad_number).triple_product >= least_product

    def axis(self, pair: int, link: int) -> Floats:
        """Return the axis of a pair, as it is fixed in one of its links, in base axes.

        The shape is (3, n), or (3, 1) if the axis is the same at all poses.
        """
        # Links are placed one after another. A pair in a link that is placed earlier may
        # have the same axis. `axis_source` returns this pair and link, where the axis is
        # cheaper to compute.
        source = self.chain.axis_source(pair, link)
        axis = self._placed_axis(source.pair, source.link)
        is_opposite = source.sense < 0.0
        return -axis if is_opposite else axis

    def _placed_axis(self, pair: int, link: int) -> Floats:
        """Return the axis of a pair in base axes, computed from one of its links.

        Parameters
        ----------
        pair, link
            Numbers of the pair and of one of its links, which is placed already.

        Returns
        -------
        (3, n) at n poses, or (3, 1) if the axis is the same at all poses.
        """
        chain = self.chain
        # The orientation of the posed link is given by the poses of the output. For some of
        # its pairs, the axes are given with the poses.
        if link == chain.posed_link and pair in self.posed_axes:
            return self.posed_axes[pair]
        # A dyad is two links, joined by its middle pair. The axis of this pair is computed
        # first, before the orientations of the two links.
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
        """Return a vector that is fixed in a moving link, in base axes (3, n).

        The vector has the components x, y, z in the axes of the link.
        """
        if link == self.chain.posed_link:
            return self._vector_of_posed_link(x, y, z)
        return self._vector_of_dyad_link(link, x, y, z)

    def _vector_of_posed_link(self, x: float, y: float, z: float) -> Floats:
        """Return a vector of the posed link in base axes (3, n).

        The orientation of this link is given by the poses of the output. The components x,
        y, z are in the axes of the link. The result is the sum of the three axes of the
        link, multiplied by x, y and z.
        """
        assert self.posed_rotation is not None
        # Index 0 of the orientation (3, 3, n) is the axis of the link. Components and poses
        # are joined to one index, so that one product of matrices sums over the axes.
        axes_of_link = self.posed_rotation.reshape(3, -1)
        return (np.array([x, y, z]) @ axes_of_link).reshape(3, -1)

    def _vector_of_dyad_link(self, link: int, x: float, y: float, z: float) -> Floats:
        """Return a vector that is fixed in a link of a dyad, in base axes (3, n).

        A dyad is two links joined by a middle pair. Each link also has an outer pair, which
        joins it to a link with a known orientation. The axes p of the outer pair and q of
        the middle pair are known at all n poses. The vector is a sum of p, q and p x q with
        constant weights.

        Parameters
        ----------
        link
            Number of the link.
        x, y, z
            Components of the vector in the axes of the link.
        """
        chain = self.chain
        dyad = chain.dyads[chain.dyad_of_link[link]]
        outer_pair, _support = chain.support_of(link)
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

        A dyad is two links with three pairs. The middle pair joins the links to each other.
        The near and the far pair, with the axes a and c, join them to links placed before.
        The axis b can lie on two sides of the plane through a and c. The sign of the dyad
        in the mode (1 or -1) selects the side.

        The axis b is (3, n), the product (n,). Both are NaN where a and c are at an angle
        that the two links cannot bridge. The axis is also NaN where a and c are parallel.
        """
        parts = self._middle_axis_parts(dyad_number)
        # Record that the result depends on the sign of this dyad. Modes in which this sign
        # is equal share the result.
        self.recorded_dyads.add(dyad_number)
        # The side, 1 or -1, is the sign of b . (a x c). A dyad with the sign 1 has b on the
        # side `positive_mode_side`, and with the sign -1 on the other side.
        side = self.signs[dyad_number] * self.chain.dyads[dyad_number].positive_mode_side
        # The two positions of b are mirror images about the plane. They have the same part
        # in the plane (`common_part`), and opposite parts at right angles to it.
        axis = parts.common_part + side * parts.signed_part
        return axis, side * parts.triple_product

    @_shared_between_modes
    def _middle_axis_parts(self, dyad_number: int) -> MiddleAxisParts:
        """Return the parts of the middle axis of a dyad, which give both of its positions.

        A dyad is two links with three pair axes a, b, c. The outer axes a and c are known.
        The middle axis b has the angles `dyad.arcs` (the arcs of the links) to them. Its
        two positions are mirror images of each other about the plane of a and c:

            b = sum_weight (a + c) + difference_weight (a - c) + cross_weight (a x c),

        with both signs of the cross weight. The formulas for the weights use half arcs, |a
        + c|^2 and |a - c|^2. In this way no digits are lost if a and c are nearly parallel.
        """
        dyad = self.chain.dyads[dyad_number]
        # Half of the arc of the near link, from a to b, and of the far link, from b to c.
        half_near_arc, half_far_arc = dyad.half_arcs
        a, c = self._outer_axes(dyad_number)
        total = a + c
        difference = a - c
        sum_square = dot_columns(total, total)
        difference_square = dot_columns(difference, difference)

        # 1. The triple product t = b . (a x c). Its square is negative out of reach, and t
        # is NaN there. At the limit of the reach t is 0, and the square can be negative by
        # rounding. A negative square above `-REACH_SLACK` therefore counts as 0.
        triple_product_square = triple_square(
            half_near_arc, half_far_arc, sum_square, difference_square
        )
        is_rounding = (triple_product_square < 0.0) & (triple_product_square > -REACH_SLACK)
        triple_product = np.sqrt(np.where(is_rounding, 0.0, triple_product_square))

        # 2. The weights, and the two parts of b.
        sum_weight, difference_weight, cross_weight = middle_axis(
            half_near_arc, half_far_arc, sum_square, difference_square, triple_product
        )
        common_part = total * sum_weight
        # With equal arcs b has equal angles to a and c, and so no part along a - c. The
        # weight of a - c would be 0, or NaN if a and c coincide, and is not used.
        if dyad.arcs[0] != dyad.arcs[1]:
            common_part += difference * difference_weight
        # (a - c) x (a + c) is 2 a x c. Unlike a x c it keeps its relative accuracy if a and
        # c nearly coincide.
        doubled_cross_product = cross_columns(difference, total)
        return MiddleAxisParts(
            common_part=common_part,
            signed_part=doubled_cross_product * (0.5 * cross_weight),
            triple_product_square=triple_product_square,
            triple_product=triple_product,
            sum_square=sum_square,
            difference_square=difference_square,
        )

    @_shared_between_modes
    def angle(self, pair: int) -> Floats:
        """Return the variable of a pair at n poses, in (-pi, pi] rad, NaN out of reach.

        A vector is fixed in each link of the pair, not parallel to the axis. The angle
        about the axis leads from the vector of the first link to the vector of the second
        link. The variable is this angle minus the same angle in the position where the
        variable is 0.
        """
        first_link, second_link = self.chain.ends[pair]
        # Each vector has two sets of components. Those in the axes of the base give the
        # angle at the poses. The others are in a frame of the pair that is fixed in the
        # link. If the variable is 0, the frames in both links coincide, so the components
        # in these frames give the angle at zero.
        first_vector = self._find_vector_off_axis(pair, first_link)
        second_vector = self._find_vector_off_axis(pair, second_link)
        axis = self.axis(pair, second_link)
        angle_at_poses = _angle_about_axis(axis, first_vector, second_vector)
        angle_at_zero = _angle_at_zero(first_vector, second_vector)
        return angle_at_poses.subtract(angle_at_zero)  # reduced to (-pi, pi]

    def _find_vector_off_axis(self, pair: int, link: int) -> LinkVector:
        """Return a vector of a link that is not parallel to the axis of a pair.

        The angle of a pair is measured from such a vector of its first link to such a
        vector of its second link. The components in the axes of the base give the angle at
        the poses. The components in the frame of the pair give the angle in the position
        where the variable of the pair is 0.

        Parameters
        ----------
        pair, link
            Numbers of the pair and of one of its links.
        """
        chain = self.chain
        pair_frame = chain.frame_in(pair, link)  # (3, 3); columns are its x, y and z axis
        # The orientation of the base is known, and that of the posed link is given by the
        # poses of the output. So any vector of these links is known. The x axis of the pair
        # frame is used, which is at right angles to the pair axis z.
        if link in (chain.base, chain.posed_link):
            return LinkVector(
                in_base=self.vector(link, pair_frame[:, 0]),
                in_pair_frame=np.array([1.0, 0.0, 0.0]),
            )
        # Of other links, only the axes of their pairs are known here, not their
        # orientations. So the vector is the axis of another pair of the link.
        other_pair = self._choose_pair_off_axis(pair, link)
        axis_in_link = chain.axis_in(other_pair, link)
        return LinkVector(
            in_base=self.axis(other_pair, link),
            # Scalar products with the columns of the frame.
            in_pair_frame=axis_in_link @ pair_frame,
        )

    def _choose_pair_off_axis(self, pair: int, link: int) -> int:
        """Return a pair of a link whose axis is not parallel to the axis of a given pair.

        The chosen axis serves as a vector from which the angle about the given axis is
        measured. The link belongs to a dyad (two links). It has the middle pair of the dyad
        and an outer pair, which joins it to a link placed before. The middle pair is chosen
        unless its axis is parallel.
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
        """Return the rate of a pair's variable, as a fraction for any motion of the output.

        The fraction is ``numerator . w / denominator`` with the angular velocity w of the
        output. At singular configurations the denominator can be 0, so both parts are kept.

        The pair belongs to a dyad: two links that are joined to each other and to two other
        links, the near and the far support. The positions of both supports are found before
        that of the dyad. The motion of both supports determines the rate.
        """
        chain = self.chain
        dyad = chain.dyads[chain.dyad_of_pair[pair]]
        # The equation gives the rate of one link of the pair (the moving link) relative to
        # the other link, from the angular velocities w_near and w_far of the supports:
        #     normal . (w_far - w_near) = -triple_product * rate.
        # The triple product is b . (a x c) of the three pair axes a, b, c of the dyad.
        equation = self._pair_rate_equation(pair)
        # The normal is at right angles to the axes of the other two pairs of the dyad. If a
        # support turns about one of these axes, this adds nothing to normal . w. So such
        # rotations are left out of the angular velocities of the supports.
        other_pairs = [number for number in dyad.pairs if number != pair]
        far_component = self.angular_velocity_along(
            equation.normal, dyad.far_support, other_pairs
        )
        near_component = self.angular_velocity_along(
            equation.normal, dyad.near_support, other_pairs
        )
        component = far_component - near_component  # normal . (w_far - w_near)
        # The variable of a pair is the angle of its second link relative to its first one.
        # If the moving link is the second link, the variable has the rate of the moving
        # link. If not, both rates have opposite signs.
        _first_link, second_link = chain.ends[pair]
        if equation.moving_link == second_link:
            divisor = -equation.triple_product
        else:
            divisor = equation.triple_product
        return RateFraction(component.numerator, component.denominator * divisor)

    def _pair_rate_equation(self, pair: int) -> PairRateEquation:
        """Return the equation for the rate of a pair of a dyad.

        A dyad is two links between two supports. It can be placed in two ways, and a
        working mode chooses one of them. The chain is: near support, near pair, near link,
        middle pair, far link, far pair, far support. The pairs have these axes and rates:

        - a, A: the rate of the near link relative to the near support,
        - b, B: the rate of the far link relative to the near link,
        - c, C: the rate of the far link relative to the far support.

        The link named first is the moving link of the pair. The angular velocity of the far
        link, computed from both supports, is

            w_near + a A + b B = w_far + c C.

        The scalar product of this equation with the vector product of two axes leaves only
        the rate of the third pair (Cramer's rule). With the triple product t = b . (a x c),

            (b x c) . (w_far - w_near) = -t A,
            (c x a) . (w_far - w_near) = -t B,
            (b x a) . (w_far - w_near) = -t C.

        The result has the vector product on the left (`normal`), t, and the moving link.
        """
        dyad_number = self.chain.dyad_of_pair[pair]
        dyad = self.chain.dyads[dyad_number]
        a, c = self._outer_axes(dyad_number)
        # The middle axis b (3, n) and the triple product t (n,) at n poses, if the dyad is
        # placed in the way of this mode.
        b, t = self.signed_middle_axis(dyad_number)
        if pair == dyad.near_pair:
            return PairRateEquation(
                normal=cross_columns(b, c), triple_product=t, moving_link=dyad.near_link
            )
        if pair == dyad.middle_pair:
            return PairRateEquation(
                normal=cross_columns(c, a), triple_product=t, moving_link=dyad.far_link
            )
        return PairRateEquation(
            normal=cross_columns(b, a), triple_product=t, moving_link=dyad.far_link
        )

    def angular_velocity_along(
        self, vector: Floats, link: int, normal_pairs: Sequence[int] = ()
    ) -> RateFraction:
        """Return the scalar product of a vector and the angular velocity of a link.

        The rates of the pairs are computed from such products (`pair_rate`). The result is
        a fraction ``numerator . w / denominator`` with the angular velocity w of the
        output.

        An outer pair joins each link to its support, a link placed before. So the angular
        velocity of the link is the angular velocity of the support, plus the rotation about
        this pair:

            vector . w_link = vector . w_support +- (rate of the pair) (vector . axis).

        The sign depends on which link of the pair is its second one. The support is treated
        in the same way, and so on. This ends at the base, which is at rest, or at the posed
        link (placed by the poses), which has the angular velocity w.

        Parameters
        ----------
        vector
            (3, n) vector.
        link
            Number of the link; its angular velocity is relative to the base.
        normal_pairs
            Pairs whose axes are at right angles to the vector. Rotation about such an axis
            adds nothing to the scalar product. If the outer pair has the axis of one of
            them, its rate is therefore not computed. Pairs that do not belong to the link
            are ignored.
        """
        chain = self.chain
        if link == chain.base:
            return RateFraction(np.zeros((3, 1)), np.ones(1))
        if link == chain.posed_link:
            return RateFraction(vector, np.ones(1))
        # The pair of the sum above, and the number of the support.
        outer_pair, support = chain.support_of(link)
        if self._is_on_one_axis(outer_pair, normal_pairs, link):
            # The outer pair has the same axis as one of the normal pairs. So its axis is at
            # right angles to the vector, and its rate adds nothing. Only the part of the
            # support remains. The outer pair is a pair of the support as well. It is passed
            # as a normal pair, because the outer pair of the support may have this axis,
            # too.
            return self.angular_velocity_along(vector, support, normal_pairs=[outer_pair])
        # The sum above. The normal pairs were only needed for the outer pair of this link.
        support_part = self.angular_velocity_along(vector, support)
        # The rate of a pair is the rate of its second link relative to its first link.
        pair_rate = self.pair_rate(outer_pair)
        axis_component = dot_columns(vector, self.axis(outer_pair, link))
        pair_part = RateFraction(
            pair_rate.numerator * axis_component, pair_rate.denominator
        )
        if chain.ends[outer_pair][1] == link:
            return support_part + pair_part
        return support_part - pair_part

    def _is_on_one_axis(self, pair: int, other_pairs: Sequence[int], link: int) -> bool:
        """Return whether a pair (joint) of a link is coaxial with one of some other pairs.

        Other pairs that do not belong to the link are ignored.
        """
        chain = self.chain
        pairs_of_link = [number for number in other_pairs if link in chain.ends[number]]
        return any(chain.is_coaxial(pair, number, link) for number in pairs_of_link)

    @_shared_between_modes
    def input_rate(self, pair: int) -> RateFraction:
        """Return the rate of an input as a linear function of the angular velocity w.

        The result is the fraction ``numerator . w / denominator``, where w belongs to the
        output link. If the output link only has to point in a direction, a closing link (a
        link with two joints) can determine its rotation about this direction. The component
        of w along the direction then has no influence.
        """
        rate = self.pair_rate(pair)
        if self.closing_link is None:
            return rate
        return _eliminate_turn(rate, self.closing_link)

    @_shared_between_modes
    def _numerator_length(self, pair: int) -> Floats:
        """Return the length (n,) of the numerator of the rate of an input."""
        return norm_columns(self.input_rate(pair).numerator)

    def output_normal(self, pair: int) -> Floats:
        """Return the unit normal (3, n), along which a rotation drives an input.

        The rate of the input is proportional to the component of the output's angular
        velocity along the normal, and has the sign of this component. With the input locked
        and the other inputs free, the angular velocity is at right angles to the normal.
        """
        rate = self.input_rate(pair)
        # At a singularity of type I the denominator is 0, and either sense is right.
        sense = np.where(rate.denominator < 0.0, -1.0, 1.0)
        return rate.numerator * (sense / self._numerator_length(pair))

    @_shared_between_modes
    def output_speed(self, pair: int) -> Floats:
        """Return the angular speed (n,) of the output along its normal per unit input rate.

        The normal is the direction of rotation that drives the input (`output_normal`). The
        speed is 0 at a singularity of type I, where the input moves while the output rests.
        """
        return np.abs(self.input_rate(pair).denominator) / self._numerator_length(pair)

    def _output_speed_square(self, pair: int) -> Floats:
        """Return the square (n,) of `output_speed`, continued to poses out of reach.

        `output_speed` is the angular speed of the output per unit rate of the input `pair`.
        The border of a workspace is where its square is 0. Its search needs values on both
        sides, so the square is continued where the dyad (two links) of the pair does not
        reach.
        """
        square = self.output_speed(pair) ** 2
        is_out_of_reach = np.isnan(square)
        return np.where(is_out_of_reach, self._continue_speed_square(pair), square)

    def _continue_speed_square(self, pair: int) -> Floats:
        """Return values (n,) that continue the squared output speed out of reach.

        The search for the border of a workspace needs a value that changes its sign at the
        border. The squared speed of the output per unit rate of an input is positive within
        the reach and 0 at the limit of the reach. This function returns the negative values
        that continue the square beyond this limit.

        The input is a pair of a dyad: two links between two others, with three pair axes a,
        b and c. The near link of the dyad has the axes a and b, the far link b and c. A
        pose (orientation of the output) is within reach if the dyad can be assembled. There
        the result is 0, and also where the outer axes a and c are unknown.

        First let the dyad join the base to the output link, with the input at a.

        - The angular velocity w of the output is the sum of the axes times the rates of
          their pairs.
        - The vector v = b x c is perpendicular to b and c. If the input has unit rate, then
          v . w = v . a = t, with the triple product t of the three axes.
        - The length of v is sin(arc), with the arc of the far link. So the speed of the
          output along v is |t| / sin(arc).

        If the input is at c, the result is the same with a and c exchanged. For an input at
        b, and in dyads that join other links, the speed is not exactly this quotient. But
        it becomes 0 where t does, so the quotient is used in all cases.

        The square of t follows from the three angles between the axes. By this formula it
        becomes negative smoothly out of reach.
        """
        dyad_number = self.chain.dyad_of_pair[pair]
        dyad = self.chain.dyads[dyad_number]
        near_arc, far_arc = dyad.arcs
        # The arc of the link that the input does not drive. For an input at b, either arc
        # will do.
        if pair == dyad.near_pair:
            undriven_arc = far_arc
        else:
            undriven_arc = near_arc
        triple_product_square = self._middle_axis_parts(dyad_number).triple_product_square
        continuation = triple_product_square / np.sin(undriven_arc) ** 2
        # Positive numbers (this dyad reaches) and NaN (its outer axes are unknown) become
        # 0.
        return np.where(continuation < 0.0, continuation, 0.0)

    def axes(self, count: int) -> Floats:
        """Return the axes (n, count, 3) of the first `count` pairs in base axes.

        Axes that follow from a dyad (two links) are NaN at poses that it does not reach.
        Other axes have values even there.
        """
        axes = np.empty((len(self.status), count, 3))
        for pair in range(count):
            axes[:, pair] = self._earliest_axis(pair).T
        return axes

    def cosine(self, first_pair: int, second_pair: int) -> Floats:
        """Return the cosine (n,) of the angle between the axes of two pairs.

        The result is NaN where an axis cannot be placed.
        """
        cosine = dot_columns(
            self._earliest_axis(first_pair), self._earliest_axis(second_pair)
        )
        return np.broadcast_to(cosine, len(self.status))

    def _earliest_axis(self, pair: int) -> Floats:
        """Return the axis (3, n) of a pair, from the one of its links placed first."""
        chain = self.chain
        # When each link is placed: the base and the posed link first, then the links of
        # dyad 0, of dyad 1, and so on.
        order = {**chain.dyad_of_link, chain.base: -1, chain.posed_link: -1}
        first = min(chain.ends[pair], key=lambda link: order.get(link, np.inf))
        return self.axis(pair, first)


def _stack_inputs(values: Sequence[Floats]) -> Floats:
    """Return values of the inputs, each (n, ...) or (1, ...), as (n, inputs, ...)."""
    return np.stack(np.broadcast_arrays(*values), axis=1)


def _angle_about_axis(axis: Floats, first: LinkVector, second: LinkVector) -> ScaledAngle:
    """Return the angle about the axis of a pair from one vector to another one.

    With the projections p and q of both vectors onto the plane at right angles to the axis,
    the cosine is p . q and the sine axis . (p x q), both times the lengths of p and q.

    Parameters
    ----------
    axis
        (3, n) axis of the pair in base axes, a unit vector.
    first, second
        A vector fixed in each link of the pair. Its pair frame has its z axis along the
        axis of the pair.
    """
    _, _, first_along_axis = first.in_pair_frame
    _, _, second_along_axis = second.in_pair_frame
    # p . q is the scalar product of the vectors less that of their parts along the axis.
    cosine = dot_columns(first.in_base, second.in_base)
    cosine = cosine - first_along_axis * second_along_axis
    # The parts along the axis have no influence on this triple product.
    sine = dot_columns(axis, cross_columns(first.in_base, second.in_base))
    return ScaledAngle(cosine, sine)


def _angle_at_zero(first: LinkVector, second: LinkVector) -> ScaledAngle:
    """Return the angle about a pair axis between two vectors, where the pair variable is 0.

    The variable at another position is the angle there minus this angle. A frame of the
    pair is fixed in each of its two links, with z along the axis of the pair. If the
    variable is 0, both frames coincide. The x and y
    components of both vectors then form two vectors p and q in one plane, and the angle is
    the one from p to q.

    Parameters
    ----------
    first, second
        A vector fixed in each link of the pair.
    """
    first_x, first_y, _ = first.in_pair_frame  # p
    second_x, second_y, _ = second.in_pair_frame  # q
    dot_product = second_x * first_x + second_y * first_y
    cross_product = second_y * first_x - second_x * first_y
    return ScaledAngle(cosine=dot_product, sine=cross_product)


def _eliminate_turn(
    input_rate: RateFraction, closing_link: ClosingLinkState
) -> RateFraction:
    """Return the rate of an input if a closing link determines the turn of the output.

    The output link has to point in a direction d. The turn is its rotation about d. In some
    mechanisms a closing link joins two links that are placed already, and fits only at a
    certain turn. The component of w along d then has no influence on the result.

    Parameters
    ----------
    input_rate
        Rate of the input if the turn were free: the fraction r . w / denominator, with the
        numerator r (3, n) and the angular velocity w of the output.
    closing_link
        The directions d, and the rate of the residual: the fraction s . w / denominator,
        with the numerator s (3, n). The closing link fits if the residual is 0.

    Notes
    -----
    The angular velocity is w = v + k d, where v moves the direction and k is the rate of
    the turn. The closing link still fits if the residual stays 0, that is s . w = 0. So k =
    -(s . v) / (s . d). The numerator of the rate of the input is then

        r . w = r . v + k (r . d) = ((s . d) r - (r . d) s) . v / (s . d).

    The vector in front of v is at right angles to d, so w can take the place of v.
    """
    d = closing_link.directions
    r = input_rate.numerator
    s = closing_link.residual_rate.numerator
    r_along_d = dot_columns(r, d)
    s_along_d = dot_columns(s, d)
    return RateFraction(r * s_along_d - s * r_along_d, input_rate.denominator * s_along_d)
