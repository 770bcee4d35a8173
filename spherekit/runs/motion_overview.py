"""An overview of the motion of a run: where modes close, and how far outputs move.

It is accumulated block by block and is part of the state of a run, so that a resumed run
has the same overview. Its size does not grow with the number of samples.

All rows decide where a mode closes. Angles and velocity ratios are examined at a limited
number of samples, so that the overview takes no noticeable time in long runs.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import numpy as np

from spherekit.arrays import Bools, Floats, Indices, Integers, SmallIntegers
from spherekit.conventions import TURN, Facts
from spherekit.mechanism.elements import Output
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.angles import wrap
from spherekit.positions.assembly_mode import has_configuration
from spherekit.positions.motion import Motion
from spherekit.positions.timing import Timing
from spherekit.runs.sampling import Sampling
from spherekit.status import Status
from spherekit.velocities.transmission_angle import ARRAYS, transmission_angle
from spherekit.velocities.transmission_measure import Transmission

MAX_OVERVIEW_SAMPLES = 721
"""Number of samples at which outputs are examined: one for each half degree of a turn.

Larger: narrow extremes are met more often, and long runs take more time.
"""

MAX_SPANS = 32
"""Number of spans of samples, and of places of rest, that are stored for each mode."""

RESTING_RATIO = 1e-9
"""Velocity ratio below which an output counts as resting. Larger: slow outputs seem to
rest; smaller: rounding errors seem to be motions."""


SAME_VALUE = 1e-9
"""Minima that differ by less are equal, and the first of them is reported. Larger: places
of minima are less accurate; smaller: rounding errors choose among equal minima."""

MAX_RATE_CURVATURE = 0.05
"""How far a rate may be from linear between two samples for a place of rest between them.

It is the error of the trapezoidal rule over the change of the rate times the step. Larger:
places between distant samples are less accurate; smaller: they are given as intervals.
"""


@dataclass(frozen=True)
class ExaminedOutput:
    """An output of the overview.

    Attributes
    ----------
    name
        Its name in the file; empty if it has none besides its links.
    label
        Its name for the screen: that in the file, and its links such as ``4/1``.
    link, reference
        Numbers of the link that moves, and of the link relative to which it moves.
    variable
        Number of the variable of the pair that joins both links, None without such a pair.
    sense
        +1 if this variable is the angle of the link relative to the reference, or -1.
    direction
        (3,) the direction in which the output points, in the axes of its link. None if
        the output is the orientation of the link.
    """

    name: str
    label: str
    link: int
    reference: int
    variable: int | None
    sense: float
    direction: tuple[float, float, float] | None


def examined_outputs(mechanism: Mechanism) -> tuple[ExaminedOutput, ...]:
    """Return the outputs whose motion is examined.

    They are the outputs that the file declares. Without any they are the links that a pair
    joins to the ground, otherwise all links, seen from the ground. The relative motion of
    the two links of an input pair is left out.
    """
    input_ends = [
        set(mechanism.ends[mechanism.pair_number[pair]]) for pair in mechanism.input_pairs
    ]
    number = mechanism.link_number
    outputs = [
        _examined_output(mechanism, output)
        for output in mechanism.outputs
        if {number[output.link], number[output.relative_to]} not in input_ends
    ]
    if outputs:
        return tuple(outputs)
    # The ground is link 0, so the larger number is that of the other link.
    links = [max(ends) for ends in mechanism.ends if 0 in ends]
    candidates = [link for link in dict.fromkeys(links) if {0, link} not in input_ends]
    if not candidates:
        candidates = [
            link for link in range(1, len(mechanism.links)) if {0, link} not in input_ends
        ]
    return tuple(
        _examined_output(mechanism, Output("", mechanism.links[link], mechanism.ground))
        for link in candidates
    )


def _examined_output(mechanism: Mechanism, output: Output) -> ExaminedOutput:
    link = mechanism.link_number[output.link]
    reference = mechanism.link_number[output.relative_to]
    variable = (
        None if output.direction is not None else mechanism.angle_between(link, reference)
    )
    sense = 1.0
    if variable is not None:
        _, second_link = mechanism.ends[mechanism.variable_owners[variable]]
        sense = 1.0 if second_link == link else -1.0
    label = f"{output.link}/{output.relative_to}"
    has_name = output.name not in ("", output.link)
    direction = output.direction
    return ExaminedOutput(
        name=output.name if has_name else "",
        label=f"{output.name} {label}" if has_name else label,
        link=link,
        reference=reference,
        variable=variable,
        sense=sense,
        direction=None
        if direction is None
        else (float(direction[0]), float(direction[1]), float(direction[2])),
    )


@dataclass(frozen=True)
class OverviewPlan:
    """What an overview examines, and what identifies a sample for the user.

    Attributes
    ----------
    sampling
        The samples and the assembly modes of the run.
    """

    sampling: Sampling

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism, with the inputs of the run."""
        return self.sampling.position_analysis.mechanism

    @cached_property
    def outputs(self) -> tuple[ExaminedOutput, ...]:
        """The outputs whose motion is examined."""
        return examined_outputs(self.mechanism)

    @cached_property
    def dyads(self) -> list[tuple[str, tuple[int, int, int]]]:
        """Name of the middle pair of each dyad, and its pairs: outer, middle, outer."""
        dyads = []
        for group in self.sampling.position_analysis.assembly.groups:
            if group.is_dyad:
                first, middle, last = (group.pairs[k] for k in group.dyad_positions)
                dyads.append((self.mechanism.pairs[middle].name, (first, middle, last)))
        return dyads

    @cached_property
    def transmissions(self) -> list[Transmission] | None:
        """The transmission measure of each output, None if all groups are dyads.

        Dyads have the transmission angle, which designers know.
        """
        groups = self.sampling.position_analysis.assembly.groups
        if all(group.is_dyad for group in groups):
            return None
        links = self.mechanism.links
        return [
            Transmission.from_mechanism(
                self.mechanism,
                Output(
                    output.label,
                    links[output.link],
                    links[output.reference],
                    output.direction,
                ),
            )
            for output in self.outputs
        ]

    @cached_property
    def step(self) -> int:
        """One of so many samples is examined."""
        return -(-len(self.sampling) // MAX_OVERVIEW_SAMPLES)

    @cached_property
    def is_path(self) -> bool:
        """Whether successive samples are neighbours on a path."""
        return len(self.sampling.shape) == 1

    @cached_property
    def place_kind(self) -> str:
        """What identifies a sample: ``time``, ``input`` (the first one) or ``sample``.

        The first input identifies a sample if it rises or falls along the samples.
        """
        if self.sampling.is_over_time:
            return "time"
        first_input = self.sampling.inputs[:, 0]
        steps = np.diff(first_input)
        is_monotonic = bool(np.all(steps > 0.0) or np.all(steps < 0.0))
        if self.is_path and len(first_input) > 1 and is_monotonic:
            return "input"
        return "sample"

    @cached_property
    def places(self) -> Floats:
        """(k,) the time (s), the first input (rad) or the number of each sample."""
        if self.place_kind == "time":
            times = self.sampling.t
            assert times is not None
            return times
        if self.place_kind == "input":
            return self.sampling.inputs[:, 0]
        return np.arange(float(len(self.sampling)))

    @property
    def moves_over_time(self) -> bool:
        """Whether speeds are meant, and not velocity ratios: in a simulation."""
        return self.sampling.simulation is not None


@dataclass
class OutputOverview:
    """How an output moves in one assembly mode.

    Attributes
    ----------
    lowest_rad, highest_rad
        Range of its angle. For outputs without a fixed axis: of the rotation from its
        first pose, so that the lowest is 0.
    lowest_ratio, highest_ratio
        For each input the range of the velocity ratio: rate of the angle per unit rate of
        the input. For outputs without a fixed axis it is the magnitude of the velocity.
        In a simulation there is one entry, the rate in rad/s.
    rests
        Places at which the rate of the output changes its sign.
    uncertain_rests
        Places of two samples between which it does so, if they are too far apart.
    further_rests
        Number of such places that are not listed.
    transmission
        The least transmission measure (0 at type II, 1 at best) and its place, None if it
        is not computed.
    gain
        Range of the least singular value of the velocity Jacobian of the output, which is
        0 at singularities of type I: the least, its place, and the largest. None if it is
        not known.
    type_1_places
        Places between samples at which the determinant of a square Jacobian changes its
        sign.
    further_type_1_places
        Number of such places that are not listed.
    last_determinant
        The place, the determinant and the sense of the last examined row, None if it has
        no determinant.
    first_pose, last_row
        What the next block needs of the rows before: the first rotation (9,), direction
        (3,) or angle (1,), and the last examined row as `_ExaminedRows` stores it.
    """

    lowest_rad: float | None = None
    highest_rad: float | None = None
    lowest_ratio: list[float | None] = field(default_factory=list)
    highest_ratio: list[float | None] = field(default_factory=list)
    rests: list[float] = field(default_factory=list)
    uncertain_rests: list[list[float]] = field(default_factory=list)
    further_rests: int = 0
    transmission: list[float] | None = None
    gain: list[float] | None = None
    type_1_places: list[float] = field(default_factory=list)
    further_type_1_places: int = 0
    last_determinant: list[float] | None = None
    first_pose: list[float] | None = None
    last_row: list[float | None] | None = None

    def widen_angle(self, angles: Floats) -> None:
        """Extend the range of the angle by further angles (rad)."""
        finite = angles[np.isfinite(angles)]
        if len(finite):
            low, high = float(np.min(finite)), float(np.max(finite))
            self.lowest_rad = low if self.lowest_rad is None else min(self.lowest_rad, low)
            self.highest_rad = (
                high if self.highest_rad is None else max(self.highest_rad, high)
            )

    def widen_ratios(self, ratios: Floats) -> None:
        """Extend the ranges of the velocity ratios by further ones (n, inputs)."""
        if not self.lowest_ratio:
            self.lowest_ratio = [None] * ratios.shape[1]
            self.highest_ratio = [None] * ratios.shape[1]
        for number, column in enumerate(ratios.T):
            finite = column[np.isfinite(column)]
            if not len(finite):
                continue
            low, high = float(np.min(finite)), float(np.max(finite))
            earlier_low = self.lowest_ratio[number]
            earlier_high = self.highest_ratio[number]
            self.lowest_ratio[number] = (
                low if earlier_low is None else min(earlier_low, low)
            )
            self.highest_ratio[number] = (
                high if earlier_high is None else max(earlier_high, high)
            )

    def add_uncertain_rest(self, first: float, last: float) -> None:
        """Note that the output comes to rest somewhere between two distant samples."""
        if len(self.uncertain_rests) < MAX_SPANS:
            self.uncertain_rests.append([first, last])
        else:
            self.further_rests += 1

    def add_rest(self, place: float) -> None:
        """Note a place at which the output comes to rest."""
        if len(self.rests) < MAX_SPANS:
            self.rests.append(place)
        else:
            self.further_rests += 1

    def add_gains(self, gains: Floats, places: Floats) -> None:
        """Extend the range of the least singular value by further ones (m,), or NaN."""
        if not np.any(np.isfinite(gains)):
            return
        row = _first_minimum(gains)
        least, largest = float(gains[row]), float(np.nanmax(gains))
        if self.gain is None:
            self.gain = [least, float(places[row]), largest]
            return
        if least < self.gain[0]:
            self.gain[:2] = [least, float(places[row])]
        self.gain[2] = max(self.gain[2], largest)

    def add_determinants(
        self, determinants: Floats, senses: Floats, places: Floats
    ) -> None:
        """Note where determinants of successive rows change their sign.

        Parameters
        ----------
        determinants
            (m,) determinants, NaN in rows without one. No sign change is looked for across
            such rows.
        senses
            (m,) signs of the motion. No sign change is looked for between rows of
            different senses.
        places
            (m,) places of the samples.
        """
        if not len(determinants):
            return
        if self.last_determinant is not None:
            place, determinant, sense = self.last_determinant
            places = np.append(place, places)
            determinants = np.append(determinant, determinants)
            senses = np.append(sense, senses)
        has_other_sign = determinants[1:] * determinants[:-1] < 0.0
        changes = np.flatnonzero(has_other_sign & (senses[1:] == senses[:-1]))
        for row in changes.tolist():
            before, after = determinants[row], determinants[row + 1]
            share = before / (before - after)
            place = float(places[row] + share * (places[row + 1] - places[row]))
            if len(self.type_1_places) < MAX_SPANS:
                self.type_1_places.append(place)
            else:
                self.further_type_1_places += 1
        is_known = bool(np.isfinite(determinants[-1]))
        last = [float(places[-1]), float(determinants[-1]), float(senses[-1])]
        self.last_determinant = last if is_known else None


@dataclass
class ModeOverview:
    """Where an assembly mode closes, and how its outputs move.

    Attributes
    ----------
    spans
        Spans of samples, by the name of their status: numbers of the first and the last
        sample. At most `MAX_SPANS` are stored for each status.
    unlisted_spans
        Number of the spans that are not stored, by status.
    transmission
        The least transmission angle (rad), the middle pair of its dyad, and the place.
    outputs
        The overview of each output.
    """

    spans: dict[str, list[list[int]]] = field(default_factory=dict)
    unlisted_spans: dict[str, int] = field(default_factory=dict)
    transmission: list[Any] | None = None
    outputs: list[OutputOverview] = field(default_factory=list)

    @classmethod
    def from_json(cls, entries: Facts) -> Self:
        """Return the overview of a mode from the data of `dataclasses.asdict`."""
        outputs = [OutputOverview(**output) for output in entries["outputs"]]
        return cls(**(entries | {"outputs": outputs}))

    def add_status(self, codes: SmallIntegers, first_sample: int) -> None:
        """Note the statuses (n,) of successive samples, from `first_sample` on."""
        if not len(codes):
            return
        changes = np.flatnonzero(codes[1:] != codes[:-1]) + 1
        starts = [0, *changes.tolist()]
        stops = [*changes.tolist(), len(codes)]
        for start, stop in zip(starts, stops, strict=True):
            name = Status(int(codes[start])).name
            spans = self.spans.setdefault(name, [])
            first, last = first_sample + start, first_sample + stop - 1
            if spans and spans[-1][1] == first - 1:
                spans[-1][1] = last
            elif len(spans) < MAX_SPANS:
                spans.append([first, last])
            else:
                self.unlisted_spans[name] = self.unlisted_spans.get(name, 0) + 1


@dataclass
class PendingRows:
    """Rows of a motion that are not examined yet, mode after mode.

    Attributes
    ----------
    sample
        (k,) numbers of the samples.
    inputs, values, status
        (modes, k, ...) inputs and variables (rad), and status codes.
    times
        (3, modes, k, inputs) times, rates and accelerations of the inputs, None without
        times. Times are repeated for each input.
    """

    sample: Integers
    inputs: Floats
    values: Floats
    status: SmallIntegers
    times: Floats | None

    @classmethod
    def from_motion(cls, motion: Motion, examined: Indices) -> Self:
        """Return the rows of some samples of a block, given by their positions (k,)."""
        mode_count = len(motion.assembly_modes)
        shape = (mode_count, len(examined))
        # The rows are picked out first: a reshaped array could be a copy of the block.
        first_rows = motion.samples * np.arange(mode_count)
        rows = (first_rows[:, None] + examined).ravel()
        times = None
        if motion.timing is not None:
            timing = motion.timing
            dq = timing.dq[rows]
            t = np.broadcast_to(timing.t[rows, None], dq.shape)
            times = np.stack([x.reshape(*shape, -1) for x in (t, dq, timing.ddq[rows])])
        return cls(
            motion.sample[examined],
            motion.inputs[rows].reshape(*shape, -1),
            motion.values[rows].reshape(*shape, -1),
            motion.status[rows].reshape(shape),
            times,
        )

    @classmethod
    def join(cls, parts: Sequence[Self]) -> Self:
        """Return the rows of successive parts together."""
        times = [part.times for part in parts if part.times is not None]
        return cls(
            np.concatenate([part.sample for part in parts]),
            np.concatenate([part.inputs for part in parts], axis=1),
            np.concatenate([part.values for part in parts], axis=1),
            np.concatenate([part.status for part in parts], axis=1),
            np.concatenate(times, axis=2) if times else None,
        )

    def to_motion(self, motion: Motion) -> Motion:
        """Return the rows as a motion of the same mechanism as another motion."""
        modes, k = self.status.shape
        row_count = modes * k
        timing = None
        if self.times is not None:
            t, dq, ddq = self.times.reshape(3, row_count, -1)
            timing = Timing(t[:, 0], dq, ddq)
        numbers = [mode.number for mode in motion.assembly_modes]
        return replace(
            motion,
            samples=k,
            sample=np.tile(self.sample, modes),
            assembly_mode=np.repeat(numbers, k),
            inputs=self.inputs.reshape(row_count, -1),
            values=self.values.reshape(row_count, -1),
            status=self.status.ravel(),
            residual=np.zeros(row_count),
            placed=None,
            timing=timing,
            sense=None,
            singular_error=None,
        )

    def to_json(self) -> Facts:
        """Return the rows ready for JSON."""
        return {
            name: None if array is None else array.tolist()
            for name, array in vars(self).items()
        }

    @classmethod
    def from_json(cls, entries: Facts) -> Self:
        """Return the rows from the data of `to_json`."""
        times = entries["times"]
        return cls(
            np.array(entries["sample"], dtype=int),
            np.array(entries["inputs"], dtype=float),
            np.array(entries["values"], dtype=float),
            np.array(entries["status"], dtype=np.int8),
            None if times is None else np.array(times, dtype=float),
        )


@dataclass
class MotionOverview:
    """The overview of the motion of a run, by the number of the assembly mode.

    Attributes
    ----------
    modes
        The overview of each mode, by its number as text.
    """

    modes: dict[str, ModeOverview] = field(default_factory=dict)

    # Examined rows that wait until there are enough to evaluate them together, since
    # blocks of long runs have few of them.
    pending: list[PendingRows] = field(default_factory=list)

    def to_json(self) -> Facts:
        """Return the overview ready for JSON."""
        return {
            "modes": {number: asdict(mode) for number, mode in self.modes.items()},
            "pending": [rows.to_json() for rows in self.pending],
        }

    @classmethod
    def from_json(cls, entries: Facts) -> Self:
        """Return the overview from the data of `to_json`."""
        return cls(
            {
                number: ModeOverview.from_json(mode)
                for number, mode in entries["modes"].items()
            },
            [PendingRows.from_json(rows) for rows in entries["pending"]],
        )

    def add_block(self, plan: OverviewPlan, motion: Motion) -> None:
        """Add the rows of a block of successive samples.

        Parameters
        ----------
        plan
            What is examined.
        motion
            The configurations of the block.
        """
        if not motion.samples or not motion.assembly_modes:
            return
        samples = motion.sample[: motion.samples]
        first, last = int(samples[0]), int(samples[-1])
        for position, mode in enumerate(motion.assembly_modes):
            overview = self.modes.setdefault(
                str(mode.number),
                ModeOverview(outputs=[OutputOverview() for _ in plan.outputs]),
            )
            rows = slice(position * motion.samples, (position + 1) * motion.samples)
            overview.add_status(motion.status[rows], first)

        # Rows of the examined samples, mode after mode. The last sample of the run is
        # always one of them.
        examined = np.arange(-(-first // plan.step) * plan.step, last + 1, plan.step)
        if last == len(plan.sampling) - 1 and last % plan.step:
            examined = np.append(examined, last)
        if not self.pending and len(examined) == motion.samples:
            self._examine(plan, motion)  # this uses what the motion has computed already
            return
        if len(examined):
            self.pending.append(PendingRows.from_motion(motion, examined - first))
        count = sum(rows.status.size for rows in self.pending)
        if count >= MAX_OVERVIEW_SAMPLES:
            self.examine_pending(plan, motion)

    def examine_pending(self, plan: OverviewPlan, motion: Motion | None = None) -> None:
        """Evaluate the rows that wait for it.

        Parameters
        ----------
        plan
            What is examined.
        motion
            Any motion of the mechanism; by default one is computed.
        """
        if not self.pending:
            return
        motion = motion or plan.sampling.motion_at(np.arange(1))
        part = PendingRows.join(self.pending).to_motion(motion)
        self.pending = []
        self._examine(plan, part)

    def _examine(self, plan: OverviewPlan, part: Motion) -> None:
        """Add the outputs and transmission angles at all rows of a motion."""
        modes = part.assembly_modes
        examined_rows = _ExaminedRows(plan, part)
        sample_count = len(part) // len(modes)
        places = plan.places[part.sample[:sample_count]]
        for position, mode in enumerate(modes):
            rows = slice(position * sample_count, (position + 1) * sample_count)
            overview = self.modes[str(mode.number)]
            _note_transmission(overview, plan, part, rows, places)
            for number in range(len(plan.outputs)):
                examined_rows.add_output(overview.outputs[number], number, rows, places)


class _ExaminedRows:
    """The motion of all outputs at some rows.

    Parameters
    ----------
    plan
        The outputs.
    motion
        The configurations of the rows, mode after mode.
    """

    def __init__(self, plan: OverviewPlan, motion: Motion) -> None:
        self.plan = plan
        self.motion = motion
        self.is_ok = motion.status == Status.OK
        self.closes = has_configuration(motion.status)
        self.rotations = motion.rotations
        self.link_rates = _link_rates(motion)

    def add_output(
        self, overview: OutputOverview, number: int, rows: slice, places: Floats
    ) -> None:
        """Add the rows of one assembly mode to the overview of an output.

        Parameters
        ----------
        overview
            The overview of the output in this mode, which is changed in place.
        number
            Position of the output.
        rows
            The m rows of the mode.
        places
            (m,) what identifies their samples, see `OverviewPlan.places`.
        """
        output = self.plan.outputs[number]
        is_ok = self.is_ok[rows]
        if self.plan.transmissions is not None:
            self._add_transmission(overview, number, rows, places)
        # (m, inputs, 3) angular velocity relative to the reference, per rate of each input.
        velocity = (
            self.link_rates[rows, :, output.link]
            - self.link_rates[rows, :, output.reference]
        )
        reference_rotation = self.rotations[rows, output.reference]
        link_rotation = self.rotations[rows, output.link]
        if output.variable is not None:
            owner = self.motion.mechanism.variable_owners[output.variable]
            axis = output.sense * self.motion.axes[rows, owner]
            ratios = np.einsum("mik,mk->mi", velocity, axis)
            jacobian = ratios[:, :, None]
        elif output.direction is not None:
            pointing = link_rotation @ np.array(output.direction)
            jacobian = np.cross(velocity, pointing[:, None])
            ratios = np.linalg.norm(jacobian, axis=2)
        else:
            jacobian = velocity
            ratios = np.linalg.norm(jacobian, axis=2)
        ratios[~is_ok] = np.nan
        inputs = self.motion.inputs[rows]
        # The rate along the path of samples decides where the output turns back.
        timing = self.motion.timing
        if self.plan.moves_over_time and timing is not None:
            # At a dead centre a ratio is infinite and the rate of the input is zero.
            with np.errstate(invalid="ignore"):
                speeds = np.sum(ratios * timing.dq[rows], axis=1, keepdims=True)
            overview.widen_ratios(speeds)
        else:
            overview.widen_ratios(ratios)
        self._add_jacobians(overview, output, rows, jacobian, places)

        if output.variable is None:
            relative = reference_rotation.swapaxes(1, 2) @ link_rotation
            self._add_rotations(overview, output, relative, self.closes[rows])
            return
        angles = output.sense * self.motion.values[rows, output.variable]
        if not self.plan.is_path:
            self._add_scattered_angles(overview, angles)
            return
        rates = ratios[:, 0] if inputs.shape[1] == 1 else None
        if self.plan.moves_over_time and timing is not None:
            rates = speeds[:, 0]
        self._add_path(overview, angles, ratios, rates, inputs, places)

    def _add_jacobians(
        self,
        overview: OutputOverview,
        output: ExaminedOutput,
        rows: slice,
        jacobian: Floats,
        places: Floats,
    ) -> None:
        """Note how near the rows of a mode are to singularities of type I.

        Parameters
        ----------
        overview
            The overview of the output in this mode, which is changed in place.
        output
            The output.
        rows
            The m rows of the mode.
        jacobian
            (m, inputs, 1 or 3) velocity of the output per rate of each input: its angular
            velocity, the velocity of its direction, or the rate of its angle.
        places
            (m,) places of the samples.
        """
        input_count, component_count = jacobian.shape[1:]
        is_known = self.is_ok[rows] & np.all(np.isfinite(jacobian), axis=(1, 2))
        if not np.any(is_known):
            overview.last_determinant = None
            return
        # Directions move in the plane that is perpendicular to them.
        freedoms = 2 if output.direction is not None else component_count
        rank = min(input_count, freedoms)
        gains = np.full(len(jacobian), np.nan)
        if rank == 1:
            gains[is_known] = np.linalg.norm(jacobian[is_known], axis=(1, 2))
        else:
            values = np.linalg.svd(jacobian[is_known], compute_uv=False)
            gains[is_known] = values[:, rank - 1]
        overview.add_gains(gains, places)
        if not self.plan.is_path or input_count != freedoms:
            return
        determinants = np.full(len(jacobian), np.nan)
        regular = jacobian[is_known]
        if output.direction is not None:
            direction = np.array(output.direction)
            pointing = self.rotations[rows, output.link][is_known] @ direction
            normal = np.cross(regular[:, 0], regular[:, 1])
            determinants[is_known] = np.sum(normal * pointing, axis=1)
        else:
            determinants[is_known] = np.linalg.det(regular)
        senses = np.zeros(len(jacobian))
        timing = self.motion.timing
        if self.plan.moves_over_time and timing is not None:
            # At a dead centre the ratio is infinite and changes its sign, as does the rate
            # of the input. This is no singularity of type I.
            senses = np.sign(np.prod(timing.dq[rows], axis=1))
        # Signs of determinants that are rounding errors mean nothing.
        determinants[gains <= RESTING_RATIO] = np.nan
        overview.add_determinants(determinants, senses, places)

    def _add_transmission(
        self, overview: OutputOverview, number: int, rows: slice, places: Floats
    ) -> None:
        """Note the least transmission measure of an output in the rows of a mode."""
        assert self.plan.transmissions is not None
        transmission = self.plan.transmissions[number]
        directions = transmission.output_directions(self.rotations[rows])
        measures = transmission.measure(self.motion.vectors[rows], directions)
        measures = np.where(self.closes[rows], measures, np.nan)
        if not np.any(np.isfinite(measures)):
            return
        row = _first_minimum(measures)
        least = overview.transmission
        if least is None or measures[row] < least[0] - SAME_VALUE:
            overview.transmission = [float(measures[row]), float(places[row])]

    def _add_rotations(
        self,
        overview: OutputOverview,
        output: ExaminedOutput,
        relative: Floats,
        closes: Bools,
    ) -> None:
        """Extend the largest rotation from the first pose, or of the first direction.

        `relative` (m, 3, 3) are rotations from axes of the link to axes of the reference.
        """
        valid = np.flatnonzero(closes & np.all(np.isfinite(relative), axis=(1, 2)))
        if not len(valid):
            return
        relative = relative[valid]
        if output.direction is not None:
            pointing = relative @ np.array(output.direction)
            if overview.first_pose is None:
                overview.first_pose = pointing[0].tolist()
            first = np.array(overview.first_pose)
            sine = np.linalg.norm(np.cross(pointing, first), axis=1)
            overview.widen_angle(np.arctan2(sine, pointing @ first))
            return
        if overview.first_pose is None:
            overview.first_pose = relative[0].ravel().tolist()
        first = np.reshape(overview.first_pose, (3, 3))
        difference = first.T @ relative
        # The skew part has the length 2 sin(angle), the trace is 1 + 2 cos(angle).
        skew = difference - difference.swapaxes(1, 2)
        sine = np.linalg.norm(skew[:, [2, 0, 1], [1, 2, 0]], axis=1)
        cosine = np.trace(difference, axis1=1, axis2=2) - 1.0
        overview.widen_angle(np.arctan2(sine, cosine))

    def _add_scattered_angles(self, overview: OutputOverview, angles: Floats) -> None:
        """Extend the range of an angle over a grid, where samples have no order.

        Angles are counted within half a turn of the first one.
        """
        finite = angles[np.isfinite(angles)]
        if not len(finite):
            return
        if overview.first_pose is None:
            overview.first_pose = [float(finite[0])]
        (first,) = overview.first_pose
        overview.widen_angle(first + wrap(finite - first))

    def _add_path(
        self,
        overview: OutputOverview,
        angles: Floats,
        ratios: Floats,
        rates: Floats | None,
        inputs: Floats,
        places: Floats,
    ) -> None:
        """Extend the range of an angle along a path, and note where it turns back.

        Parameters
        ----------
        overview
            The overview, which is changed in place.
        angles
            (m,) angles of the output (rad), with jumps of whole turns.
        ratios
            (m, inputs) velocity ratios.
        rates
            (m,) rate of the angle whose zeros are places of rest. None for a path of
            several inputs, where it is the mean rate per step.
        inputs, places
            (m, inputs) values of the inputs (rad), and (m,) places of the samples.
        """
        # A row without a configuration ends a segment of neighbouring rows.
        is_known = np.isfinite(angles)
        if not np.all(is_known[:1]):
            overview.last_row = None
        ends = np.flatnonzero(np.diff(is_known.astype(np.int8))) + 1
        for segment in np.split(np.arange(len(angles)), ends):
            if not len(segment) or not is_known[segment[0]]:
                overview.last_row = None
                continue
            rows = np.column_stack(
                [
                    places[segment],
                    angles[segment],
                    np.full(len(segment), np.nan) if rates is None else rates[segment],
                    inputs[segment],
                    ratios[segment],
                ]
            )
            self._add_segment(overview, rows, inputs.shape[1], rates is None)

    def _add_segment(
        self,
        overview: OutputOverview,
        rows: Floats,
        input_count: int,
        takes_rate_of_steps: bool,
    ) -> None:
        """Add neighbouring rows of a path, all of which have a configuration.

        Parameters
        ----------
        overview
            The overview, which is changed in place.
        rows
            (m, 3 + 2 inputs) place, angle (rad) and rate of each row, its inputs (rad) and
            its velocity ratios.
        input_count
            Number of inputs.
        takes_rate_of_steps
            Whether the differences of angles take the place of rates.
        """
        if overview.last_row is not None:
            # NaN cannot be stored in the journal, so None stands for it.
            last_row = [np.nan if x is None else x for x in overview.last_row]
            rows = np.vstack([last_row, rows])
        places, angles, rates = rows[:, :3].T
        inputs = rows[:, 3 : 3 + input_count]
        ratios = rows[:, 3 + input_count :]
        expected_steps = np.sum(
            0.5 * (ratios[1:] + ratios[:-1]) * np.diff(inputs, axis=0), axis=1
        )
        is_uncertain = ~np.isfinite(expected_steps)
        if self.plan.moves_over_time:
            is_uncertain[:] = True  # ratios are infinite at a dead centre of the input
        expected_steps[is_uncertain] = 0.0
        # Choose the whole turns so that each step is near the expected one.
        turns = np.round((expected_steps - np.diff(angles)) / TURN)
        angles[1:] += TURN * np.cumsum(turns)
        if takes_rate_of_steps:
            rates[1:] = np.diff(angles)
        overview.widen_angle(angles)

        # The rate is nearly linear between neighbouring rows. Rows in which it is zero up
        # to rounding are passed over.
        moving = np.flatnonzero(np.abs(rates) > RESTING_RATIO)
        reversals = np.flatnonzero(rates[moving][1:] * rates[moving][:-1] < 0.0)
        for before, after in zip(
            moving[reversals].tolist(), moving[reversals + 1].tolist(), strict=True
        ):
            if np.isnan(rates[before:after]).any():
                # A singular configuration is between both rows. The rate can jump there
                # from one sign to the other without being zero.
                continue
            share = rates[before] / (rates[before] - rates[after])
            distance = places[after] - places[before]
            place = float(places[before] + share * distance)
            if takes_rate_of_steps:
                overview.add_rest(place)
                continue
            # The step of the angle shows whether the rate is linear: the trapezoidal rule
            # then gives this step.
            path = places if self.plan.moves_over_time else inputs[:, 0]
            step = path[after] - path[before]
            error = 0.5 * (rates[before] + rates[after]) * step
            error -= angles[after] - angles[before]
            variation = abs((rates[after] - rates[before]) * step)
            if abs(error) > MAX_RATE_CURVATURE * variation:
                overview.add_uncertain_rest(float(places[before]), float(places[after]))
                continue
            overview.add_rest(place)
            extreme = angles[before] + 0.5 * rates[before] * share * step
            overview.widen_angle(np.array([extreme]))
        last_row = rows[-1]
        if not abs(last_row[2]) > RESTING_RATIO and len(moving):
            # The next block needs the last rate that is not zero, and its place.
            last_row = last_row.copy()
            last_row[[0, 2]] = rows[moving[-1], [0, 2]]
        overview.last_row = [float(x) if np.isfinite(x) else None for x in last_row]


def _first_minimum(values: Floats) -> int:
    """Return the first row of the least value (m,), where NaN stands for no value."""
    return int(np.flatnonzero(values <= np.nanmin(values) + SAME_VALUE)[0])


def _link_rates(motion: Motion) -> Floats:
    """Return the angular velocities (n, inputs, links, 3) of links per rate of each input.

    They are relative to the ground and in ground axes, and NaN where the closure equations
    do not determine them.
    """
    linearisation = motion.linearisation
    jacobian = linearisation.jacobian
    passive = list(motion.passive_variables)
    rates = []
    for pair in motion.assembly.inputs:
        driven = motion.mechanism.variables_of(pair)[0]
        variable_rates = np.zeros((len(motion), motion.values.shape[1]))
        variable_rates[:, driven] = 1.0
        if passive:
            closing = -motion.closure_inverse @ jacobian[:, :, driven, None]
            variable_rates[:, passive] = closing[:, :, 0]
        rates.append(linearisation.tree.body_rates(motion.vectors, variable_rates))
    return np.stack(rates, axis=1)


def _note_transmission(
    overview: ModeOverview,
    plan: OverviewPlan,
    motion: Motion,
    rows: slice,
    places: Floats,
) -> None:
    """Note the least transmission angle of all dyads in the rows of a mode.

    Parameters
    ----------
    overview
        The overview of the mode, which is changed in place.
    plan
        The dyads.
    motion, rows
        The configurations, and the rows of the mode.
    places
        (m,) places of the samples of these rows.
    """
    for name, (first, middle, last) in plan.dyads:
        axes = motion.axes[rows]
        angles = transmission_angle(ARRAYS, axes[:, first], axes[:, middle], axes[:, last])
        if not np.any(np.isfinite(angles)):
            continue
        row = _first_minimum(angles)
        least = overview.transmission
        if least is None or angles[row] < least[0] - SAME_VALUE:
            overview.transmission = [float(angles[row]), name, float(places[row])]


def summarize_overview(overview: MotionOverview, plan: OverviewPlan) -> Facts:
    """Return the overview for the summary of a run.

    Returns
    -------
    ``place``: what identifies samples, with its name and unit. ``examined_samples``: at
    how many samples outputs were examined. ``outputs``: their labels, links and whether
    they turn about a fixed axis. ``modes``: for each mode by number the places between
    which it closes, spans of other statuses, the least transmission angle, and for each
    output the range of its angle, its velocity ratios, and where it comes to rest.
    """
    overview.examine_pending(plan)
    mechanism = plan.mechanism
    places = plan.places
    names: dict[str, tuple[str, str]] = {
        "time": ("t", "s"),
        "input": (mechanism.input_pairs[0], "rad"),
        "sample": ("sample", ""),
    }
    place_name, place_unit = names[plan.place_kind]

    def place_spans(spans: Sequence[Sequence[int]]) -> list[list[float]]:
        """Return spans of samples by the places of their first and last samples."""
        return [[float(places[first]), float(places[last])] for first, last in spans]

    sample_count = len(places)
    modes = {}
    for number, mode in overview.modes.items():
        transmission = None
        if mode.transmission is not None:
            angle, pair, place = mode.transmission
            transmission = {"angle_rad": angle, "pair": pair, "place": place}
            transmission["inputs_rad"] = _inputs_at(plan, place)
        closing = _join_spans(
            [
                *mode.spans.get(Status.OK.name, ()),
                *mode.spans.get(Status.AT_SINGULARITY.name, ()),
            ]
        )
        modes[number] = {
            "closes": place_spans(closing),
            "closes_everywhere": closing == [[0, sample_count - 1]],
            "statuses": {
                name: place_spans(spans)
                for name, spans in mode.spans.items()
                if name != Status.OK.name
            },
            "unlisted_spans": mode.unlisted_spans,
            "least_transmission": transmission,
            "outputs": [
                {
                    "lowest_rad": output.lowest_rad,
                    "highest_rad": output.highest_rad,
                    "lowest_ratio": output.lowest_ratio,
                    "highest_ratio": output.highest_ratio,
                    "rests": output.rests,
                    "uncertain_rests": output.uncertain_rests,
                    "further_rests": output.further_rests,
                    "least_transmission_measure": output.transmission,
                    "inputs_of_least_measure_rad": (
                        None
                        if output.transmission is None
                        else _inputs_at(plan, output.transmission[1])
                    ),
                    "jacobian": _summarize_jacobian(plan, output),
                }
                for output in mode.outputs
            ],
        }
    return {
        "place": {"kind": plan.place_kind, "name": place_name, "unit": place_unit},
        "place_range": [float(places[0]), float(places[-1])] if sample_count else [],
        "is_path": plan.is_path,
        "examined_samples": len(range(0, sample_count, plan.step)),
        "ratio": "rad/s" if plan.moves_over_time else "",
        "outputs": [
            {
                "name": output.name,
                "label": output.label,
                "link": mechanism.links[output.link],
                "relative_to": mechanism.links[output.reference],
                "fixed_axis": output.variable is not None,
                "points": output.direction is not None,
            }
            for output in plan.outputs
        ],
        "modes": modes,
    }


def _summarize_jacobian(plan: OverviewPlan, output: OutputOverview) -> Facts | None:
    """Return the range of the least singular value, and where determinants are zero."""
    if output.gain is None:
        return None
    least, place, largest = output.gain
    return {
        "least_singular_value": least,
        "largest_least_singular_value": largest,
        "place": place,
        "inputs_rad": _inputs_at(plan, place),
        "type_1_places": output.type_1_places,
        "type_1_inputs_rad": [_inputs_at(plan, place) for place in output.type_1_places],
        "further_type_1_places": output.further_type_1_places,
    }


def _inputs_at(plan: OverviewPlan, place: float) -> list[float]:
    """Return the inputs (rad) at a place, interpolated between samples of a path."""
    if not plan.is_path:
        values: list[float] = plan.sampling.inputs[round(place)].tolist()
        return values
    places = plan.places
    order = slice(None) if places[-1] >= places[0] else slice(None, None, -1)
    return [
        float(np.interp(place, places[order], column[order]))
        for column in plan.sampling.inputs.T
    ]


def _join_spans(spans: Sequence[Sequence[int]]) -> list[list[int]]:
    """Return spans of samples in order, adjacent ones joined."""
    joined: list[list[int]] = []
    for first, last in sorted(map(tuple, spans)):
        if joined and first <= joined[-1][1] + 1:
            joined[-1][1] = max(joined[-1][1], last)
        else:
            joined.append([first, last])
    return joined
