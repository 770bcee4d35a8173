"""Constraints of a workspace, expressed as limits of angles.

The reach of legs, the ranges of pairs, angles between axes and distances to singularities
are all limits of angles whose cosines are known. A border is computed from the cosine,
which is a smooth function of the pose. The angle itself changes like a square root where an
axis becomes parallel to another one.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from spherekit.arrays import Floats, Indices
from spherekit.conventions import Names
from spherekit.errors import AnalysisError
from spherekit.geometry.triangle import arc
from spherekit.mechanism.joint_construction import make_joints
from spherekit.mechanism.load_kinds import JointLimit
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.pair_frames import COLLINEAR_SINE
from spherekit.numerics.angles import wrap
from spherekit.outputs.mid_plane_architecture import axis_in
from spherekit.wording import listing, nearest


class ModeAtPoses(Protocol):
    """Interface of a mechanism at n poses of its output, in one working mode.

    A working mode is a choice of one of two positions for each leg. At a singularity of
    type I an input moves while the output rests; at a singularity of type II the output can
    move although the inputs are locked.

    Quantities are NaN at poses at which they are not determined. The limit of the reach is
    the border of the workspace, and its search needs values on both sides. Therefore
    `cosine` and `type_1_square` have values also beyond the reach.
    """

    def cosine(self, first_pair: int, second_pair: int) -> Floats:
        """Return the cosine (n,) of the angle between the axes of two pairs.

        The reach of a leg limits the angle between its first and last axis. The cosine of
        this angle is also known where the leg is too short or too long for the pose. The
        pairs (joints) are numbered as in the mechanism without wheels.
        """

    def angle(self, pair: int) -> Floats:
        """Return the variable (n,) of a pair in (-pi, pi] rad."""

    @property
    def inputs(self) -> Floats:
        """(n, inputs) values of the inputs, rad.

        The values are in (-pi, pi]. If wheels drive the mechanism, they can be outside of
        this range, because configurations do not repeat after one revolution of an input.
        """

    @property
    def type_1(self) -> Floats:
        """(n, inputs) least angular speed of the output per unit rate of each input.

        One input has the rate 1. The others have the rates that make the speed least. The
        speed is 0 at a singularity of type I, because the output rests there although this
        input moves.
        """

    @property
    def type_1_square(self) -> Floats:
        """(n, inputs) squares of `type_1`; negative where a leg does not reach the pose.

        The square passes smoothly through 0 at the limit of the reach. The border of a
        workspace, which is searched there, needs values on both sides.
        """

    @property
    def type_2(self) -> Floats:
        """(n,) measure from 0 to 1 of how well the locked inputs hold the output.

        This is the transmission measure. At a singularity of type II it is 0, because the
        output can move although the inputs are locked.
        """

    @property
    def rates(self) -> Floats:
        """(n, inputs, 3) rates of the inputs per unit angular velocity of the output.

        The components are along the axes of the link relative to which the pose is given.
        The rate of an input is the scalar product of its vector (3,) and the angular
        velocity. If the output is a direction, a rotation about this direction does not
        count.
        """


class LegSpan(NamedTuple):
    """The reach of a leg: the range of the angle between its two outer axes.

    A leg has two links and three axes. The leg closes only if the angle between the first
    and the last axis is in this range. So the range limits the workspace.

    Attributes
    ----------
    first_pair, second_pair
        Numbers of the pairs with the outer axes. If wheels drive the legs, these are
        numbers in the mechanism without the wheels (`LimitedOutput.carrying`).
    shortest, longest
        Smallest and largest angle (rad) at which the leg closes, for links without width.
    is_limited_by_width
        Whether the smallest angle is larger for links of some width, which cannot lie over
        each other. This matters only if the user states a width.
    """

    first_pair: int
    second_pair: int
    shortest: float
    longest: float
    is_limited_by_width: bool


@dataclass(frozen=True)
class AngleLimit:
    """A limit of an angle that depends on the pose of an output.

    A pose is in the workspace if it keeps all limits. How far it is from a limit is
    measured in two ways: by the angle, for reports (`left`), and by its cosine, for
    computations (`column`).

    Attributes
    ----------
    name
        Description of the limit, as it is reported.
    limit
        Limit of the angle (rad), between 0 and pi.
    at_least
        True if the angle must be at least the limit, False if it must be at most the limit.
    cosine
        Function that returns the cosine (n,) of the angle at n poses in one working mode
        (way to assemble the mechanism).
    unit
        Reported angle per limited angle, usually 1.0. It is 0.5 if the limited angle is
        twice the angle that the user knows.
    """

    name: str
    limit: float
    at_least: bool
    cosine: Callable[[ModeAtPoses], Floats]
    unit: float = 1.0

    def column(self, rows: ModeAtPoses) -> Floats:
        """Return the margin (n,) as a difference of cosines, negative beyond the limit.

        The border of a workspace is where the margin is 0. Unlike a difference of angles, a
        difference of cosines is a smooth function of the pose, also at the angles 0 and pi.
        Each limit gives one column of a table of margins.
        """
        # The cosine falls as the angle grows. So this difference is positive if the angle
        # is larger than the limit.
        margin = np.cos(self.limit) - self.cosine(rows)
        return margin if self.at_least else -margin

    def left(self, rows: ModeAtPoses) -> Floats:
        """Return the reported angle (n,) that is left to the limit, negative beyond it."""
        # Rounding errors can make a cosine larger than 1.
        angle = np.arccos(np.clip(self.cosine(rows), -1.0, 1.0))
        margin = self.unit * (angle - self.limit)
        return margin if self.at_least else -margin


@dataclass(frozen=True)
class InterferenceLimit:
    """A limit: the angle between the axes of two pairs is from `low` to `high` (rad)."""

    one: str
    other: str
    low: float
    high: float = np.pi


@dataclass(frozen=True)
class Constraints:
    """Constraints of a workspace in addition to the reach of the legs.

    Attributes
    ----------
    limits
        Ranges of pair angles; the joint limits of the mechanism apply as well.
    apart
        Ranges of angles between the axes of two pairs, so that links do not collide.
    near
        Least allowed distance to singularities, as an angle (rad); 0 for no limit. It
        applies to type I of every input, and to type II. The distance is arcsin(min(m, 1)),
        where the measure m is 0 at the singularity.

        At a singularity of type I, one input moves while the output rests. Its m is the
        angular speed of the output per unit rate of this input. Of all rates of the other
        inputs, those that make this speed least are taken. At a singularity of type II, the
        output can move although the inputs are locked. Its m is the transmission measure,
        which says how well the locked inputs hold the output.
    width, radius
        Width of the links and radius of the sphere that they are on, in the same unit of
        length; 0 for no limit. A leg has two links and three axes. If it can fold so that
        its links overlap, the angle between its first and its third axis must stay so large
        that the links do not touch (Chen et al. 2021, section 3).
    """

    limits: tuple[JointLimit, ...] = ()
    apart: tuple[InterferenceLimit, ...] = ()
    near: float = 0.0
    width: float = 0.0
    radius: float = 0.0


class LimitedOutput(Protocol):
    """Interface of an output of a mechanism, from which limits of its poses are computed.

    Legs carry the output. A leg is two links in series, with three R pairs: one at the
    base, one between both links, and one at the output link. Wheels can drive these links.
    """

    mechanism: Mechanism
    """The whole mechanism."""

    @property
    def carrying(self) -> Mechanism:
        """The mechanism without the wheels: the links and pairs that carry the output.

        Pair numbers in `spans` belong to this mechanism.
        """

    @property
    def spans(self) -> tuple[LegSpan, ...]:
        """The reach of each leg: the range of the angle between its two outer axes."""

    def name_of(self, pair: int) -> str:
        """Return the name of a pair for messages.

        The pair has its number in `carrying`. Virtual pairs, which fix the output in a
        pose, have the numbers after those. The name of a virtual pair is the name of the
        output.
        """


def bounds_of(kinematics: LimitedOutput, wanted: Constraints) -> tuple[AngleLimit, ...]:
    """Return all limits of an output, from its mechanism and from the user.

    A pose of the output is in the workspace if it keeps all limits.

    Parameters
    ----------
    kinematics
        The output, with the joint limits of its mechanism and the reach of its legs. The
        reach of a leg is the range of the angle between the axes at its two ends.
    wanted
        Further constraints, from the user.

    Returns
    -------
    Limits of angles, in this order: angles between axes, pair angles, and distances to
    singularities. Without any limits, the result is a single limit that every pose keeps.

    Raises
    ------
    AnalysisError
        If a pair is unknown, a value is not possible (such as a range with its ends in the
        wrong order), or limits contradict each other.
    """
    bounds = (
        *_limit_axis_angles(kinematics, wanted),
        *_limit_pairs(kinematics, wanted.limits),
        *_limit_measures(kinematics.mechanism, wanted.near),
    )
    return bounds or (_NO_LIMIT,)


def find_least_margin(
    bounds: Sequence[AngleLimit], rows: ModeAtPoses
) -> tuple[Floats, Indices]:
    """Return how far n poses are from their nearest limit, and which limit this is.

    Parameters
    ----------
    bounds
        The limits. A pose is in the workspace if it keeps all of them.
    rows
        The mechanism at the poses, in one working mode (way to assemble it).

    Returns
    -------
    margin
        (n,) angle (rad) to the nearest limit, negative beyond it; NaN if it is not known.
    limiting
        (n,) index of this limit, -1 if it is not known.
    """
    # 1. Size: the least of the angles that are left to the limits. NaN is ignored.
    angle_margins = np.stack([bound.left(rows) for bound in bounds], axis=1)  # (n, limits)
    margin, limiting = _select_least(angle_margins)

    # 2. Sign: near 0 and pi the arc cosine amplifies rounding errors, so a small negative
    # angle may be wrong. The cosines decide whether a pose is inside.
    is_inside = _find_least_cosine_margin(bounds, rows) >= 0.0
    is_rounding = (margin < 0.0) & is_inside
    margin[is_rounding] = 0.0

    # 3. Unknown margins (NaN): such a margin could be the smallest one. A pose beyond
    # another limit is outside anyway.
    is_outside = margin < 0.0
    has_unknown_margin = np.isnan(angle_margins).any(axis=1)
    is_unknown = has_unknown_margin & ~is_outside
    return np.where(is_unknown, np.nan, margin), np.where(is_unknown, -1, limiting)


def measure_joint_margins(mechanism: Mechanism, values: Floats) -> tuple[Names, Floats]:
    """Return how far n configurations of a mechanism are from each of its joint limits.

    The caller marks a configuration with a negative margin as out of reach.

    Parameters
    ----------
    mechanism
        The mechanism with its joint limits.
    values
        (n, variables) pair variables (rad).

    Returns
    -------
    names
        Names of the limits. A limit whose range is a whole turn is left out, since every
        angle is within it.
    margins
        (n, limits) angle (rad) to each limit, negative beyond it; NaN if a variable is NaN.
    """
    names = []
    margins = np.empty((len(values), 0))
    for limit in mechanism.joint_limits:
        half_width = 0.5 * (limit.high - limit.low)
        if half_width >= np.pi:
            continue
        number = mechanism.variable_owners.index(mechanism.pair_number[limit.pair])
        distance = np.abs(wrap(values[:, number] - 0.5 * (limit.low + limit.high)))
        margin = half_width - distance
        # COLLINEAR_SINE is the tolerance (rad) for rounding errors of an angle on a limit.
        is_rounding = (margin < 0.0) & (margin >= -COLLINEAR_SINE)
        margin[is_rounding] = 0.0
        names.append(_name_pair_limit("joint_limit", limit))
        margins = np.column_stack([margins, margin])
    return tuple(names), margins


def _select_least(angle_margins: Floats) -> tuple[Floats, Indices]:
    """Return the least margin (n,) of each pose, and the column (n,) in which it is.

    A margin is what is left to a limit; each row of `angle_margins` (n, limits) is a pose.
    NaN is ignored. If several columns have the least margin, the first one is returned.
    """
    least_margin = np.fmin.reduce(angle_margins, axis=1)
    is_least = angle_margins == least_margin[:, None]
    return least_margin, np.argmax(is_least, axis=1)


def _find_least_cosine_margin(bounds: Sequence[AngleLimit], rows: ModeAtPoses) -> Floats:
    """Return the least margin (n,) of all limits, as a difference of cosines.

    A pose is within all limits of angles if the least margin is at least 0. NaN is ignored.
    """
    cosine_margins = np.stack([bound.column(rows) for bound in bounds], axis=1)
    return np.fmin.reduce(cosine_margins, axis=1)


_NO_LIMIT = AngleLimit(
    name="none: every pose is reached",
    limit=np.pi,
    at_least=False,
    cosine=lambda rows: np.ones_like(rows.type_2),
)
"""A limit that every pose keeps."""


@dataclass(frozen=True)
class _AngleRange:
    """A range of the angle between two axes, and the constraint that it comes from.

    Attributes
    ----------
    low, high
        Smallest and largest angle (rad).
    source
        Name of the constraint, such as a leg or a range set by the user, for messages.
    """

    low: float
    high: float
    source: str


def _collect_axis_ranges(
    kinematics: LimitedOutput, constraints: Constraints
) -> dict[tuple[int, int], list[_AngleRange]]:
    """Return all ranges that are allowed for angles between two pair axes.

    These ranges come from three sources:

    - the reach of each leg: it has two links, so that the angle between its outer axes is
      limited by their arcs,
    - the width of links: where a leg can fold, its links can lie over each other, and a
      least angle between its outer axes keeps them apart,
    - the ranges in `constraints.apart`, which the user sets for any two axes.

    Parameters
    ----------
    kinematics
        The output. The pairs have their numbers in `kinematics.carrying`: the mechanism
        without the wheels that drive it.
    constraints
        The constraints that the user sets.

    Returns
    -------
    The ranges by the numbers of the two pairs, the smaller number first. Each list begins
    with the range 0 to pi, which every angle keeps.
    """
    mechanism = kinematics.carrying
    least_link_angle = _find_least_link_angle(mechanism, constraints)
    ranges: dict[tuple[int, int], list[_AngleRange]] = {}

    def add_range(pair: int, other_pair: int, low: float, high: float, source: str) -> None:
        """Add a range of the angle between the axes of two pairs."""
        key = (min(pair, other_pair), max(pair, other_pair))
        whole_range = _AngleRange(0.0, np.pi, "like every angle")
        ranges.setdefault(key, [whole_range]).append(_AngleRange(low, high, source))

    # Each span describes the reach of one leg.
    for span in kinematics.spans:
        first = span.first_pair
        second = span.second_pair
        add_range(first, second, span.shortest, span.longest, "the arcs of the leg")
        if span.is_limited_by_width:
            add_range(first, second, least_link_angle, np.pi, "the width of the links")
    for limit in constraints.apart:
        pair = _find_pair(kinematics, "apart", limit.one)
        other_pair = _find_pair(kinematics, "apart", limit.other)
        # The angle between two axes of one link is constant, so it does not limit the
        # poses. If it is outside of the range, `_is_always_kept` raises an error.
        if not _is_always_kept(mechanism, limit, pair, other_pair):
            add_range(pair, other_pair, limit.low, limit.high, "the limit apart")
    return ranges


def _limit_axis_angles(
    kinematics: LimitedOutput, constraints: Constraints
) -> tuple[AngleLimit, ...]:
    """Return the limits of angles between axes of pairs, which restrict the poses.

    Three sources give ranges of these angles:

    - the arcs of the two links of a leg, for the angle between its first and third axis,
    - the width of links, which must not overlap when a leg folds,
    - the ranges of `constraints.apart`, which the user sets for any two axes.

    Several ranges of the same angle are replaced by one with the largest lower and the
    smallest upper limit. A limit names the constraint that it comes from.

    Parameters
    ----------
    kinematics
        The output, with its legs and the ranges of the angles between their axes. The
        pairs have their numbers in `kinematics.carrying`: the mechanism without the wheels
        that drive it.
    constraints
        The constraints that the user sets.

    Raises
    ------
    AnalysisError
        If the strictest limits contradict each other.
    """
    bounds: list[AngleLimit] = []
    for axes, ranges in _collect_axis_ranges(kinematics, constraints).items():
        name = "/".join(kinematics.name_of(pair) for pair in axes)
        strictest_low = max(ranges, key=lambda angle_range: angle_range.low)
        strictest_high = min(ranges, key=lambda angle_range: angle_range.high)
        low = strictest_low.low
        high = strictest_high.high
        # A range of nearly a single angle would leave only a curve of poses, and no area.
        # COLLINEAR_SINE is a small sine, which equals its angle (rad).
        if high - low < COLLINEAR_SINE:
            raise _error(
                kinematics.carrying,
                f"the limits of the angle between the axes {name} exclude all poses: "
                f"the angle has to be at least {_format_degrees(low)} "
                f"({strictest_low.source}) and at most {_format_degrees(high)} "
                f"({strictest_high.source}); widen one of these limits",
            )

        # The default value binds the axes of this pass of the loop. The function is called
        # later, with the mechanism at n poses in one working mode.
        def cosine(rows: ModeAtPoses, axes: tuple[int, int] = axes) -> Floats:
            """Return the cosine (n,) of the angle between both axes."""
            return rows.cosine(*axes)

        # A lower limit of 0 and an upper limit of pi are always kept, so they are left out.
        if COLLINEAR_SINE < low < np.pi - COLLINEAR_SINE:
            title = f"axes {name} at least {_format_degrees(low)} ({strictest_low.source})"
            bounds.append(AngleLimit(title, low, at_least=True, cosine=cosine))
        if COLLINEAR_SINE < high < np.pi - COLLINEAR_SINE:
            title = f"axes {name} at most {_format_degrees(high)} ({strictest_high.source})"
            bounds.append(AngleLimit(title, high, at_least=False, cosine=cosine))
    return tuple(bounds)


def _is_always_kept(
    mechanism: Mechanism, limit: InterferenceLimit, pair: int, other_pair: int
) -> bool:
    """Return whether the angle between two pair axes is in its range in every pose.

    This is so if both axes are on one link: the angle between them is constant, and the
    caller needs no limit of the poses. If this angle is not in the range, no pose keeps the
    limit, and an error is raised. In other cases the angle depends on the pose.

    Parameters
    ----------
    mechanism
        The mechanism to which the pairs belong.
    limit
        Range of the angle between two axes.
    pair, other_pair
        Numbers of the pairs with these axes.

    Raises
    ------
    AnalysisError
        If the axes are the same, the range is empty, or the constant angle is outside of
        the range.
    """
    where = f"{limit.one}/{limit.other}"
    if pair == other_pair:
        raise _error(
            mechanism, f"parameter apart: {where} names the same axis twice; name two axes"
        )
    if not 0.0 <= limit.low <= limit.high <= np.pi:
        raise _error(
            mechanism,
            f"parameter apart: {where}: {_format_degrees(limit.low)} to "
            f"{_format_degrees(limit.high)} is not a range; give the least angle between "
            "the axes and then the largest one, both from 0 to 180 deg",
        )
    joints = make_joints(mechanism)
    common_links = set(mechanism.ends[pair]) & set(mechanism.ends[other_pair])
    for link in common_links:
        axis = axis_in(mechanism, joints, pair, link)
        other_axis = axis_in(mechanism, joints, other_pair, link)
        angle = arc(axis, other_axis)
        # The tolerance (rad) allows for rounding errors. COLLINEAR_SINE is the sine of an
        # angle so small that the angle has the same value.
        tolerance = COLLINEAR_SINE
        if not limit.low - tolerance <= angle <= limit.high + tolerance:
            raise _error(
                mechanism,
                f"parameter apart: {where}: both axes are on one link, always "
                f"{_format_degrees(float(angle))} apart, not "
                f"{_format_degrees(limit.low)} to {_format_degrees(limit.high)}",
            )
    return bool(common_links)


def _find_least_link_angle(mechanism: Mechanism, constraints: Constraints) -> float:
    """Return the least angle (rad) between the first and third axis of a leg.

    A leg has two links and three axes. If it folds, its links come to lie side by side, and
    its first and third axes are near each other. The links are bands on a sphere, with the
    axes in the middle of the bands. To avoid a collision, these axes stay at least one
    width apart, an arc of width / radius (Chen et al. 2021, section 3). The angle is 0 for
    links without width.

    Raises
    ------
    AnalysisError
        If the width does not fit the radius.
    """
    width = constraints.width
    radius = constraints.radius
    if width == 0.0:
        fits = 0.0 <= radius < np.inf  # 0 means that the user stated no radius
    else:
        # An angle between axes is at most pi, so the width is at most pi times the radius.
        fits = 0.0 < width <= np.pi * radius < np.inf
    if not fits:
        raise _error(
            mechanism,
            f"links of width {width:g} do not fit on a sphere of radius {radius:g}; give "
            "both in the same unit of length; neither may be negative, and the radius has "
            "to be at least width / pi",
        )
    if width == 0.0:
        return 0.0
    return width / radius


def _limit_pairs(
    kinematics: LimitedOutput, limits: Sequence[JointLimit]
) -> tuple[AngleLimit, ...]:
    """Return the limits of the angles of R pairs (revolute joints).

    A range of a pair angle is expressed as one limit: the angle from the middle of the
    range is at most half its width.

    Parameters
    ----------
    kinematics
        The output; the joint limits of its mechanism are included.
    limits
        Further ranges of pairs.

    Raises
    ------
    AnalysisError
        For unknown pairs, empty ranges, and ranges of one pair that do not overlap.
    """
    mechanism = kinematics.mechanism
    named_limits = [
        *((limit, "joint_limit") for limit in mechanism.joint_limits),
        *((limit, "limit") for limit in limits),
    ]
    # The ranges before the present one, to see whether two of the same pair contradict each
    # other. Angles are compared modulo whole turns: two ranges overlap if the distance of
    # their middles is at most the sum of their half widths.
    previous_limits: list[JointLimit] = []
    bounds = []
    for limit, kind in named_limits:
        # Raises an error if no pair has this name.
        _find_pair(kinematics, "limits", limit.pair)
        number = mechanism.pair_number[limit.pair]
        range_text = _format_range(limit)
        if not -np.inf < limit.low <= limit.high < np.inf:
            raise _error(
                mechanism,
                f"parameter limits: {limit.pair}: {range_text} is not a range; give the "
                "lower limit first",
            )
        middle = 0.5 * (limit.low + limit.high)
        half_width = 0.5 * (limit.high - limit.low)
        for previous in previous_limits:
            distance = wrap(middle - 0.5 * (previous.low + previous.high))
            previous_half_width = 0.5 * (previous.high - previous.low)
            is_apart = abs(distance) > half_width + previous_half_width + COLLINEAR_SINE
            if previous.pair == limit.pair and is_apart:
                raise _error(
                    mechanism,
                    f"parameter limits: {limit.pair} cannot be within "
                    f"{_format_degrees(previous.low)} to {_format_degrees(previous.high)} "
                    f"and within {range_text}; these limits contradict each other",
                )
        previous_limits.append(limit)
        if half_width >= np.pi:  # a range of a whole turn allows every angle
            continue

        # The default values bind the numbers of this pass of the loop.
        def cosine(
            rows: ModeAtPoses, number: int = number, middle: float = middle
        ) -> Floats:
            """Return the cosine (n,) of the angle from the middle of the range."""
            return np.cos(rows.angle(number) - middle)

        name = _name_pair_limit(kind, limit)
        bounds.append(AngleLimit(name, half_width, at_least=False, cosine=cosine))
    return tuple(bounds)


def _limit_measures(mechanism: Mechanism, near: float) -> tuple[AngleLimit, ...]:
    """Return the limits of the distance to singularities of type I and II.

    The measure of type I of an input is the least angular speed of the output per unit rate
    of the input, for any rates of the other inputs. It is 0 if the input moves while the
    output rests. The measure of type II is 0 if the output can move although the inputs are
    locked. The distance to a singularity is the angle b from 0 to pi / 2 with sin b =
    measure. A speed above 1 counts as 1. Twice the
    angle is limited, because cos 2 b = 1 - 2 measure^2 is smooth even where the measure is
    0.

    Parameters
    ----------
    mechanism
        The mechanism with its inputs.
    near
        Least distance (rad) to a singularity; 0 for no limits.

    Returns
    -------
    A limit of type I for every input, then a limit of type II.

    Raises
    ------
    AnalysisError
        If the angle is not in [0, pi / 2).
    """
    if not 0.0 <= near < 0.5 * np.pi:
        raise _error(
            mechanism,
            f"parameter near: {_format_degrees(near)} is out of range; give an angle of at "
            "least 0 and less than 90 deg. The workspace leaves out poses at which the "
            "singularity measure of type I or of type II is less than the sine of this "
            "angle",
        )
    if near == 0.0:
        return ()

    def type_2_cosine(rows: ModeAtPoses) -> Floats:
        """Return cos 2 b (n,) of the distance b to type II at n poses."""
        return 1.0 - 2.0 * np.minimum(rows.type_2**2, 1.0)

    bounds = []
    for number, name in enumerate(mechanism.input_pairs):

        def type_1_cosine(rows: ModeAtPoses, number: int = number) -> Floats:
            """Return cos(2 b) at n poses, with the angle b to a singularity of type I.

            At type I an input moves while the output rests. sin(b) is the least angular
            speed of the output per unit rate of the input, but at most 1. Unlike b, cos(2
            b) is smooth at b = 0.
            """
            # Out of reach the square is negative and cos 2 b above 1. The margin thus
            # passes smoothly through the limit of the reach.
            return 1.0 - 2.0 * np.minimum(rows.type_1_square[:, number], 1.0)

        # The limited angle is 2 b, and b is reported (unit 0.5).
        title = f"type I of {name} at least {_format_degrees(near)} away"
        bounds.append(
            AngleLimit(title, 2.0 * near, at_least=True, cosine=type_1_cosine, unit=0.5)
        )
    title = f"type II at least {_format_degrees(near)} away"
    bounds.append(
        AngleLimit(title, 2.0 * near, at_least=True, cosine=type_2_cosine, unit=0.5)
    )
    return tuple(bounds)


def _find_pair(kinematics: LimitedOutput, option: str, name: str) -> int:
    """Return the number of the pair with a name that the user wrote in a constraint.

    Parameters
    ----------
    kinematics
        The output. `kinematics.carrying` is the part of its mechanism that carries the
        output, without the wheels that drive it. The pairs are numbered as in this part.
    option
        Name of the constraint, for messages.
    name
        Name of the pair.

    Raises
    ------
    AnalysisError
        If no pair has this name, or if it is the pair of a wheel.
    """
    carrying_numbers = kinematics.carrying.pair_number
    if name not in carrying_numbers:
        # A text such as `; did you mean "41"?`. It is empty if no name is similar.
        suggestion = nearest(name, carrying_numbers)
        reason = (
            f'parameter {option}: no pair is named "{name}"{suggestion or "."} '
            f"Pairs: {listing(carrying_numbers)}"
        )
        if name in kinematics.mechanism.pair_number:
            reason = (
                f"parameter {option}: {name} is the pair of a wheel that does not carry "
                "the output"
            )
        raise _error(kinematics.mechanism, reason)
    return carrying_numbers[name]


def _error(mechanism: Mechanism, reason: str) -> AnalysisError:
    """Return the error that the constraints of a workspace are wrong."""
    return AnalysisError(f"workspace of {mechanism.name}: {reason}")


def _name_pair_limit(kind: str, limit: JointLimit) -> str:
    """Return the name under which the range of a pair is reported."""
    return f"{kind} of {limit.pair}, {_format_range(limit)}"


def _format_range(limit: JointLimit) -> str:
    """Return the range of a pair angle as text in degrees."""
    return f"{_format_degrees(limit.low)} to {_format_degrees(limit.high)}"


def _format_degrees(angle: float) -> str:
    """Return an angle (rad) as text in degrees."""
    return f"{np.degrees(angle):.6g} deg"
