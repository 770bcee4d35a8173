"""Constraints of a workspace: bounds on angles that are known by their cosines.

The cosine is smooth where the angle ends with a vertical slope, so that a border found
from it is found well: reach, limits of pairs, angles between axes and the measures of
singularities are all such bounds.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from spherekit.arrays import Bools, Floats, Indices, SmallIntegers
from spherekit.conventions import Names
from spherekit.errors import AnalysisError
from spherekit.geometry.triangle import arc
from spherekit.mechanism.elements import Output
from spherekit.mechanism.joint_construction import make_joints
from spherekit.mechanism.load_kinds import JointLimit
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.pair_frames import COLLINEAR_SINE
from spherekit.numerics.angles import wrap
from spherekit.numerics.array_rows import ArrayRows
from spherekit.outputs.dyad_chain import Signs
from spherekit.outputs.forward_kinematics import (
    ForwardKinematics,
    PoseSolutions,
    output_rates,
)
from spherekit.outputs.mid_plane_architecture import MidPlaneArchitecture, axis_in
from spherekit.outputs.virtual_output import with_wrist
from spherekit.positions.assembly_mode import label_of
from spherekit.positions.loop_closure import Closure
from spherekit.positions.motion import make_motion
from spherekit.status import Status
from spherekit.tolerances import SINGULAR_DYAD_SINE
from spherekit.velocities.transmission import Transmission
from spherekit.wording import listing, nearest


class Rows(Protocol):
    """A mechanism at n poses of its output, in one working mode.

    Everything is NaN where it is not determined; what limits the reach is not.
    """

    def cosine(self, one: int, other: int) -> Floats:
        """Return the cosine (n,) of the angle between the axes of two pairs."""

    def angle(self, pair: int) -> Floats:
        """Return the variable (n,) of a pair in (-pi, pi] rad."""

    @property
    def inputs(self) -> Floats:
        """(n, inputs) rad in (-pi, pi]."""

    @property
    def type_1(self) -> Floats:
        """(n, inputs) measures of type I, see `Inverse`."""

    @property
    def type_1_square(self) -> Floats:
        """(n, inputs) its squares, continued smoothly where a leg does not reach.

        There they are negative.
        """

    @property
    def type_2(self) -> Floats:
        """(n,) measure of type II, see `Inverse`."""

    @property
    def rates(self) -> Floats:
        """(n, inputs, 3) rates of the inputs per unit angular velocity of the output.

        In axes of the link that the output is seen from; for a pointing output of the part
        at right angles to its direction.
        """


Span = tuple[int, int, float, float, bool]
"""Two pairs whose axes a leg joins, the least and the greatest angle (rad) between them,
and whether the leg's two links can lie over each other there."""


@dataclass(frozen=True)
class InverseRows(ArrayRows):
    """k rows: the number of the pose, the label of the working mode, and what is there.

    Attributes
    ----------
    pose
        (k,) number of the pose, ascending.
    mode
        (k,) label of the working mode, ``~`` for each group without signs; empty for a
        pose without a configuration.
    inputs
        (k, inputs) rad in (-pi, pi].
    status
        (k,) values of `Status`: OK; OUT_OF_REACH, and then all but margin and limiting
        are NaN; AT_SINGULARITY where a measure is nearly 0 or has no value.
    margin, limiting
        (k,) rad left to the nearest limit, negative outside, and its number in `limits`;
        NaN and -1 where no limit says anything.
    type_1, type_2
        (k, inputs) and (k,), see `Inverse` and `spherekit.velocities.transmission`.
    rates
        (k, inputs, 3), see `Rows`.
    values
        (k, pairs asked for) rad in (-pi, pi].
    limits
        Names of the limits.
    """

    pose: Indices
    mode: NDArray[np.str_]
    inputs: Floats
    status: SmallIntegers
    margin: Floats
    limiting: Indices
    type_1: Floats
    type_2: Floats
    rates: Floats
    values: Floats
    limits: Names

    def __len__(self) -> int:
        return len(self.pose)

    @property
    def solved(self) -> Bools:
        """Which rows (k,) have a configuration."""
        return self.status != Status.OUT_OF_REACH

    def judged(self) -> Self:
        """Return the rows with their status, empty where a limit or the reach says no."""
        out, finite = self.margin < 0.0, np.isfinite(self.margin)
        least = np.fmin(np.min(self.type_1, axis=1), self.type_2)
        regular = np.isfinite(self.inputs).all(axis=1) & (least > SINGULAR_DYAD_SINE)
        status = np.where(regular, Status.OK, Status.AT_SINGULARITY)
        status[out] = Status.OUT_OF_REACH
        gone = np.where(out, np.nan, 0.0)
        emptied = {
            name: (getattr(self, name).T + gone).T
            for name in ("inputs", "type_1", "type_2", "rates", "values")
        }
        margin = np.where(finite, self.margin, np.nan)
        return replace(self, status=status.astype(np.int8), margin=margin, **emptied)

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """Return the rows of several modes, those of a pose together."""
        every = super().joined(parts)
        return every.rows(np.argsort(every.pose, kind="stable"))


@dataclass(frozen=True)
class AngleLimit:
    """An angle (rad) that may not be less, or not be more, than a limit.

    `cosine` gives that of the angle, and a unit of the angle is `unit` rad of what the
    bound is named for.
    """

    name: str
    limit: float
    at_least: bool
    cosine: Callable[[Rows], Floats]
    unit: float = 1.0

    def column(self, rows: Rows) -> Floats:
        """Return the margin (n,) as a difference of cosines, smooth across the border."""
        beyond = np.cos(self.limit) - self.cosine(rows)
        return beyond if self.at_least else -beyond

    def left(self, rows: Rows) -> Floats:
        """Return how far (n,) rad the angle is from the limit, negative beyond."""
        beyond = self.unit * (np.arccos(np.clip(self.cosine(rows), -1.0, 1.0)) - self.limit)
        return beyond if self.at_least else -beyond


@dataclass(frozen=True)
class InterferenceLimit:
    """Two pairs whose axes are between `low` and `high` (rad) apart."""

    one: str
    other: str
    low: float
    high: float = np.pi


@dataclass(frozen=True)
class Constraints:
    """What a workspace is asked to keep to, beside the reach of the legs.

    Attributes
    ----------
    limits
        Limits of pairs; the joint limits of the mechanism hold as well.
    apart
        Limits of angles between axes.
    near
        Least distance (rad) to a singularity: the angle whose sine is the measure, of
        type I of every input, and of type II.
    width, radius
        Width of the links and radius of the sphere that they are on, in one unit of
        length: the outer axes of a leg that can fold stay so far apart, along the
        sphere, that its links do not touch (Chen et al. 2021, section 3). 0 for none.
    """

    limits: tuple[JointLimit, ...] = ()
    apart: tuple[InterferenceLimit, ...] = ()
    near: float = 0.0
    width: float = 0.0
    radius: float = 0.0


class OutputKinematics:
    """The poses of one declared output.

    Of one with another number of inputs than a pose has coordinates, forward only.

    Attributes
    ----------
    mechanism, output
        The output, and the mechanism that declares it.
    points
        Whether poses are directions (n, 3), else rotations (n, 3, 3).
    modes, legs
        The signs of all working modes, and what each sign belongs to.
    form
        The mid-plane symmetric architecture of the output, if it has one.
    solved_by
        What gives the configurations: ``dyads``, ``mid-plane`` or ``graph``.
    """

    modes: tuple[Signs, ...] = ()
    legs: Names = ()
    form: MidPlaneArchitecture | None = None
    solved_by = "graph"

    def __init__(self, mechanism: Mechanism, output: Output, points: bool) -> None:
        self.mechanism, self.output, self.points = mechanism, output, points

    @property
    def labels(self) -> Names:
        """Labels of the working modes."""
        return tuple(map(label_of, self.modes))

    def chosen_modes(self, text: str) -> tuple[Signs, ...]:
        """Return the modes that a text names: all for ``""``, else a label or a number.

        Raises
        ------
        AnalysisError
            If it names none.
        """
        if not text:
            return self.modes
        if text in self.labels:
            return (self.modes[self.labels.index(text)],)
        if text.isdecimal() and int(text) < len(self.modes):
            return (self.modes[int(text)],)
        raise AnalysisError(
            f'{self.mechanism.name}: outputs.{self.output.name}: working mode "{text}" is '
            f"none of {listing(self.labels, 64)}, nor a number below {len(self.modes)}; "
            f"the signs are those of: {'; '.join(self.legs)}"
        )

    def inverse(
        self, poses: Floats, modes: Sequence[str], pairs: Sequence[int] = ()
    ) -> InverseRows:
        """Return the configurations of poses in some modes, with variables of pairs.

        Modes are named by their labels.

        Raises
        ------
        PlanError
            If there is none.
        """
        with_wrist(self.mechanism, self.output.name)
        raise AssertionError(poses, modes, pairs)

    def forward(self, inputs: Floats) -> PoseSolutions:
        """Return every pose found at inputs (n, inputs) rad."""
        return self._forward.solutions(inputs)

    def turns(self, values: Floats) -> Floats:
        """Return the output's angular velocity (n, 3, inputs) per unit rate of each input.

        At configurations (n, variables), in axes of the link that the output is seen from;
        NaN where the inputs do not determine the motion.
        """
        return output_rates(make_motion(self._forward.solver, values), self.output)

    def type_2(self, values: Floats) -> Floats:
        """Return the measure (n,) of type II at configurations (n, variables)."""
        return Transmission.of(self.mechanism, self.output).of_values(self._closure, values)

    def residual(self, values: Floats) -> Floats:
        """Return (n,) rad by how much loops fail to close at values (n, variables)."""
        return self._closure.at(values).gap

    @cached_property
    def _forward(self) -> ForwardKinematics:
        return ForwardKinematics(self.mechanism, self.output.name)

    @cached_property
    def _closure(self) -> Closure:
        return Closure.of(self.mechanism, make_joints(self.mechanism))


class ClosedKinematics(OutputKinematics, ABC):
    """An output in a closed form that needs no start; poses are judged by its limits."""

    @property
    def carrying(self) -> Mechanism:
        """What carries the output: the numbers of axes are those of its pairs."""
        return self.mechanism

    @property
    @abstractmethod
    def spans(self) -> tuple[Span, ...]:
        """What limits the reach."""

    @abstractmethod
    def at(self, poses: Floats, signs: Signs) -> Rows:
        """Return one mode at poses."""

    def name_of(self, pair: int) -> str:
        """Return the name of a pair, or that of the output for a pair made for it."""
        pairs = self.carrying.pairs
        return pairs[pair].name if pair < len(pairs) else self.output.name

    @cached_property
    def bounds(self) -> tuple[AngleLimit, ...]:
        """The reach of the legs, and the joint limits of the mechanism."""
        return bounds_of(self, Constraints())

    def inverse(
        self, poses: Floats, modes: Sequence[str], pairs: Sequence[int] = ()
    ) -> InverseRows:
        """Return a row for each pose and mode."""
        limits = tuple(bound.name for bound in self.bounds)
        signs = dict(zip(self.labels, self.modes, strict=True))
        count = len(poses)
        parts = []
        for mode in modes:
            with np.errstate(all="ignore"):
                rows = self.at(poses, signs[mode])
                values = [np.empty((count, 0)), *map(rows.angle, pairs)]
                part = InverseRows(
                    np.arange(count),
                    np.full(count, mode),
                    rows.inputs,
                    np.zeros(count, dtype=np.int8),
                    *left_of(self.bounds, rows),
                    rows.type_1,
                    rows.type_2,
                    rows.rates,
                    np.column_stack(values),
                    limits,
                )
            parts.append(part.judged())
        return InverseRows.joined(parts)


def bounds_of(kinematics: ClosedKinematics, wanted: Constraints) -> tuple[AngleLimit, ...]:
    """Return all bounds: of the reach, then those wanted.

    Raises
    ------
    AnalysisError
        For unknown pairs, values without meaning, and limits that contradict each other.
    """
    bounds = (
        *_between_axes(kinematics, wanted),
        *_of_pairs(kinematics, wanted.limits),
        *_of_singularities(kinematics.mechanism, wanted.near),
    )
    return bounds or (_NO_LIMIT,)


def left_of(bounds: Sequence[AngleLimit], rows: Rows) -> tuple[Floats, Indices]:
    """Return what is left (n,) rad to the nearest bound, and its number.

    Negative outside; the number is -1 where no limit says why the pose cannot be taken.
    """
    left = np.stack([bound.left(rows) for bound in bounds], axis=1)
    columns = np.stack([bound.column(rows) for bound in bounds], axis=1)
    margin = np.fmin.reduce(left, axis=1)
    limiting = np.argmax(left == margin[:, None], axis=1)
    exact = np.fmin.reduce(columns, axis=1)
    margin[(margin < 0.0) & (exact >= 0.0)] = 0.0
    unknown = np.isnan(left).any(axis=1) & ~(margin < 0.0)
    return np.where(unknown, np.nan, margin), np.where(unknown, -1, limiting)


_NO_LIMIT = AngleLimit(
    "none: every pose is reached", np.pi, False, lambda r: np.ones_like(r.type_2)
)


def _between_axes(
    kinematics: ClosedKinematics, wanted: Constraints
) -> tuple[AngleLimit, ...]:
    """Return the bounds of angles between axes, one each way for each two axes.

    Of the limits (rad) of two axes the strictest hold, with where they are from.
    """
    mechanism = kinematics.carrying
    closest = _closest(mechanism, wanted)
    limits: dict[tuple[int, int], list[tuple[float, float, str]]] = {}

    def ask(one: int, other: int, *limit: Any) -> None:
        limits.setdefault((min(one, other), max(one, other)), [(0.0, np.pi, "")]).append(
            limit
        )

    for one, other, shortest, longest, folds in kinematics.spans:
        ask(one, other, shortest, longest, "the arcs of the leg")
        if folds:
            ask(one, other, closest, np.pi, "the width of the links")
    for item in wanted.apart:
        one, other = (_pair(kinematics, "apart", name) for name in (item.one, item.other))
        if not _holds_always(mechanism, item, one, other):
            ask(one, other, item.low, item.high, "apart")
    bounds: list[AngleLimit] = []
    for axes, held in limits.items():
        name = "/".join(kinematics.name_of(pair) for pair in axes)
        low, _, low_from = max(held, key=lambda asked: asked[0])
        _, high, high_from = min(held, key=lambda asked: asked[1])
        if high - low < COLLINEAR_SINE:
            raise _refusal(
                mechanism,
                f"the axes {name} cannot be at least {_deg(low)} apart ({low_from}) and "
                f"at most {_deg(high)} ({high_from}) on any area: these limits contradict "
                "each other, or leave no more than a curve",
            )

        def cosine(rows: Rows, axes: tuple[int, int] = axes) -> Floats:
            return rows.cosine(*axes)

        for end, words, source in ((low, "least", low_from), (high, "most", high_from)):
            if COLLINEAR_SINE < end < np.pi - COLLINEAR_SINE:
                title = f"axes {name} at {words} {_deg(end)} ({source})"
                bounds.append(AngleLimit(title, end, words == "least", cosine))
    return tuple(bounds)


def _holds_always(
    mechanism: Mechanism, item: InterferenceLimit, one: int, other: int
) -> bool:
    """Return whether the axes are on one link, and so always apart as asked."""
    where = f"{item.one}/{item.other}"
    if one == other:
        raise _refusal(mechanism, f"apart: {where} names one axis twice")
    if not 0.0 <= item.low <= item.high <= np.pi:
        raise _refusal(
            mechanism,
            f"apart: {where}: {_deg(item.low)} to {_deg(item.high)} is not a range; give "
            "the least angle between the axes, 0 to 180 deg, and a greatest not below",
        )
    joints = make_joints(mechanism)
    shared = set(mechanism.ends[one]) & set(mechanism.ends[other])
    for link in shared:
        fixed = arc(*(axis_in(mechanism, joints, pair, link) for pair in (one, other)))
        if not item.low - COLLINEAR_SINE <= fixed <= item.high + COLLINEAR_SINE:
            raise _refusal(
                mechanism,
                f"apart: {where}: both axes are on one link, always {_deg(float(fixed))} "
                f"apart, not {_deg(item.low)} to {_deg(item.high)}",
            )
    return bool(shared)


def _closest(mechanism: Mechanism, wanted: Constraints) -> float:
    """Return the least angle (rad) that the width of links leaves between axes."""
    width, radius = wanted.width, wanted.radius
    if not (0.0 <= width <= np.pi * radius < np.inf or 0.0 == width <= radius < np.inf):
        raise _refusal(
            mechanism,
            f"links of width {width:g} do not fit on a sphere of radius {radius:g}; give "
            "both in the same unit of length, 0 or more, the radius more than width / 3.2",
        )
    return width / radius if width else 0.0


def _of_pairs(
    kinematics: ClosedKinematics, limits: Sequence[JointLimit]
) -> tuple[AngleLimit, ...]:
    """Return the bounds of pairs: joint limits and limits wanted, each by its middle."""
    mechanism = kinematics.mechanism
    asked = [(item, "joint_limit") for item in mechanism.joint_limits]
    kept: dict[str, JointLimit] = {}
    bounds = []
    for item, kind in [*asked, *((item, "limit") for item in limits)]:
        _pair(kinematics, "limits", item.pair)
        number = mechanism.pair_number[item.pair]
        span = f"{_deg(item.low)} to {_deg(item.high)}"
        if not -np.inf < item.low <= item.high < np.inf:
            why = f"limits: {item.pair}: {span} is not a range; give the lower limit first"
            raise _refusal(mechanism, why)
        middle, half = 0.5 * (item.low + item.high), 0.5 * (item.high - item.low)
        before = kept.setdefault(item.pair, item)
        gap = wrap(middle - 0.5 * (before.low + before.high))
        if abs(gap) > half + 0.5 * (before.high - before.low) + COLLINEAR_SINE:
            raise _refusal(
                mechanism,
                f"limits: {item.pair} cannot be within {_deg(before.low)} to "
                f"{_deg(before.high)} and within {span}; these limits contradict each "
                "other",
            )
        kept[item.pair] = item
        if half >= np.pi:
            continue

        def cosine(rows: Rows, number: int = number, middle: float = middle) -> Floats:
            return np.cos(rows.angle(number) - middle)

        bounds.append(AngleLimit(f"{kind} of {item.pair}, {span}", half, False, cosine))
    return tuple(bounds)


def _of_singularities(mechanism: Mechanism, near: float) -> tuple[AngleLimit, ...]:
    """Return the bounds of the measures, by the double angle, whose cosine is smooth."""
    if not 0.0 <= near < 0.5 * np.pi:
        raise _refusal(
            mechanism,
            f"near: {_deg(near)} is not a distance to a singularity; it is at least 0 and "
            "less than 90 deg, as the angle whose sine is the measure",
        )
    if near == 0.0:
        return ()
    bounds = []
    for number, name in enumerate([*mechanism.input_pairs, ""]):

        def cosine(rows: Rows, number: int = number, name: str = name) -> Floats:
            square = rows.type_1_square[:, number] if name else rows.type_2**2
            # Endless where an input rests whatever the output does: far from type I.
            return 1.0 - 2.0 * np.minimum(square, 1.0)

        title = f"{f'type I of {name}' if name else 'type II'} at least {_deg(near)} away"
        bounds.append(AngleLimit(title, 2.0 * near, True, cosine, 0.5))
    return tuple(bounds)


def _pair(kinematics: ClosedKinematics, what: str, name: str) -> int:
    """Return the number of a pair among those that carry the output."""
    numbers, every = kinematics.carrying.pair_number, kinematics.mechanism.pair_number
    if name not in numbers:
        hint = f"{nearest(name, numbers) or ';'} Pairs: {listing(numbers)}"
        why = f'{what}: no pair is named "{name}"{hint}'
        if name in every:
            why = f"{what}: {name} is the pair of a wheel, which does not carry the output"
        raise _refusal(kinematics.mechanism, why)
    return numbers[name]


def _refusal(mechanism: Mechanism, why: str) -> AnalysisError:
    return AnalysisError(f"workspace of {mechanism.name}: {why}")


def _deg(angle: float) -> str:
    return f"{np.degrees(angle):.6g} deg"
