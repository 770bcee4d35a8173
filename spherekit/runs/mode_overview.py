"""Where an assembly mode closes and how far each output moves in it, block after block.

These records are part of the state of a run. Their size does not grow with the number of
samples.
"""

from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np

from spherekit.arrays import Bools, Floats, SmallIntegers
from spherekit.conventions import Facts
from spherekit.positions.assembly_mode import has_configuration
from spherekit.runs.smooth_extremes import SmoothExtremes
from spherekit.status import Status

MAX_LIST_ENTRIES = 32
"""Number of entries that each list of an overview has at most.

The lists are the spans of samples with one status, the spans of samples at which a mode
closes, and for each output the places of rest, the uncertain places, and the places of type
I singularities. Further items are counted only. Larger: more items are listed, and the
stored state of a run is larger.
"""

REVERSAL_SHARE = 0.02
"""Share of the change of a velocity within which its line from row to row meets zero.

The curvature of the velocity between two rows moves the line by a similar share. Larger:
velocities that only come close to zero count as zero; smaller: zeros between distant rows
are not noticed, and the least velocity ratio is read at a row, not between rows.
"""

EQUAL_MINIMA_TOLERANCE = 1e-9
"""Minima that differ by less are equal, and the first of them is reported.

The minima are minima of transmission angles (rad), transmission measures and singular
values. Larger: places of minima are less accurate; smaller: rounding errors choose among
equal minima.
"""


SMOOTH_EXTREMES = ("smooth_angle", "smooth_transmission_angle", "smooth_transmission")
"""Attributes of `OutputOverview` that are single records of `SmoothExtremes`."""


@dataclass
class OutputOverview:
    """How an output moves in one assembly mode (way to assemble the mechanism).

    An output is a link, or a direction on a link, with a motion of interest. A place
    identifies a sample: it is the time (s), the value of the first input (rad) or the
    number of the sample, as in `OverviewPlan.places`.

    Attributes
    ----------
    lowest_rad, highest_rad
        Range of the angle of the output. An output without a fixed axis has the range of
        the angle by which it has turned from its first pose, which begins at 0.
    lowest_ratio, highest_ratio
        For each input the range of the velocity ratio: rate of the angle per unit rate of
        the input. For outputs without a fixed axis it is the magnitude of the velocity.
        In a simulation there is one entry: the rate or this magnitude in rad/s.
    rests
        Places at which the rate of the output changes its sign.
    uncertain_rests
        Places of two samples between which the rate of the output changes its sign. The
        samples are too far apart to interpolate the place at which the rate is zero.
    further_rests
        Number of places of rest that are neither in `rests` nor in `uncertain_rests`.
    transmission_angle
        The least transmission angle (rad) of the dyad (two links with three R pairs) that
        determines the motion of the output, and its place. None if no dyad determines this
        motion.
    transmission
        The least transmission measure and its place, None if it is not computed. The
        measure is 0 at singularities of type II, and 1 at best.
    largest_transmission
        The largest transmission measure, None if it is not computed. If it equals the
        least one, the measure is constant.
    gain
        The range of the smallest singular value of the output's velocity Jacobian over all
        samples. Three numbers: the least value, its place, and the largest value. The
        singular value is 0 at singularities of type I. None if no sample has a known
        Jacobian.
    type_1_places
        Places between samples at which the determinant of a square Jacobian changes its
        sign.
    further_type_1_places
        Number of such places that are not listed.
    last_determinant
        The place, the determinant and the sense (see `find_zero_crossings`) of the last
        examined row, None if it has no determinant. The next block (group of samples) needs
        it.
    last_velocities
        The velocity of the output per rate of each input in the last examined row of a
        path, (inputs, 3). In a simulation it is the velocity itself, (1, 3). None if the
        velocity is unknown, or if the output has signed ratios. The next block needs it.
    first_pose
        The first rotation (9,), direction (3,) or angle (1,), from which the following
        rows are measured. None for an angle along a path.
    last_rows
        Last examined rows of a path, which the next block needs, from
        `OutputRows.last_rows`. Each has place, angle (rad), rate, inputs (rad) and velocity
        ratios, with None in place of NaN. The attribute is None for outputs without a fixed
        axis, on a grid, and if the last row has no configuration.
    turning_error_rad
        Largest estimated error (rad) of an angle at which the output turns back between
        two samples.
    smooth_angle, smooth_ratios, smooth_transmission_angle, smooth_transmission
        Extremes that four quantities have between samples, estimated by parabolas. The
        quantities are the angle (rad), the velocity ratio of each input, the transmission
        angle (rad) and the transmission measure. The angle is estimated only if the places
        at which it turns back are not known.
    """

    lowest_rad: float | None = None
    highest_rad: float | None = None
    lowest_ratio: list[float | None] = field(default_factory=list)
    highest_ratio: list[float | None] = field(default_factory=list)
    rests: list[float] = field(default_factory=list)
    uncertain_rests: list[list[float]] = field(default_factory=list)
    further_rests: int = 0
    transmission_angle: list[float] | None = None
    transmission: list[float] | None = None
    largest_transmission: float | None = None
    gain: list[float] | None = None
    type_1_places: list[float] = field(default_factory=list)
    further_type_1_places: int = 0
    last_determinant: list[float] | None = None
    last_velocities: list[list[float]] | None = None
    first_pose: list[float] | None = None
    last_rows: list[list[float | None]] | None = None
    turning_error_rad: float = 0.0
    smooth_angle: SmoothExtremes = field(default_factory=SmoothExtremes)
    smooth_ratios: list[SmoothExtremes] = field(default_factory=list)
    smooth_transmission_angle: SmoothExtremes = field(default_factory=SmoothExtremes)
    smooth_transmission: SmoothExtremes = field(default_factory=SmoothExtremes)

    @classmethod
    def from_json(cls, entries: Facts) -> Self:
        """Return the overview of an output from the data of `dataclasses.asdict`."""
        smooth_ratios = entries.get("smooth_ratios", ())
        extremes: Facts = {
            name: SmoothExtremes.from_json(entries[name])
            for name in SMOOTH_EXTREMES
            if name in entries
        }
        extremes["smooth_ratios"] = [SmoothExtremes.from_json(x) for x in smooth_ratios]
        return cls(**(entries | extremes))

    def widen_angle(self, angles: Floats) -> None:
        """Extend the range of the angle of the output by further angles (rad)."""
        finite = angles[np.isfinite(angles)]
        if len(finite):
            low, high = float(np.min(finite)), float(np.max(finite))
            self.lowest_rad = low if self.lowest_rad is None else min(self.lowest_rad, low)
            self.highest_rad = (
                high if self.highest_rad is None else max(self.highest_rad, high)
            )

    def widen_ratios(self, ratios: Floats) -> None:
        """Extend the range of the velocity ratio of an output for each input.

        Parameters
        ----------
        ratios
            (n, inputs) velocity ratios (output rate per input rate) at further samples. In
            a simulation (n, 1) rates of the output (rad/s). Values that are not finite are
            left out.
        """
        if not self.lowest_ratio:
            self.lowest_ratio = [None] * ratios.shape[1]
            self.highest_ratio = [None] * ratios.shape[1]
            self.smooth_ratios = [SmoothExtremes() for _ in ratios.T]
        # `smooth_ratios` estimates the extremes between samples.
        for number, column in enumerate(ratios.T):
            self.smooth_ratios[number].add(column)
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
        """Note two samples between which the output comes to rest, by their places."""
        if len(self.uncertain_rests) < MAX_LIST_ENTRIES:
            self.uncertain_rests.append([first, last])
        else:
            self.further_rests += 1

    def add_turning_error(self, error: float) -> None:
        """Note the error (rad) of the angle at which the output turns back."""
        self.turning_error_rad = max(self.turning_error_rad, float(error))

    def add_rest(self, place: float) -> None:
        """Note a place at which the output comes to rest."""
        if len(self.rests) < MAX_LIST_ENTRIES:
            self.rests.append(place)
        else:
            self.further_rests += 1

    def add_gains(self, gains: Floats, places: Floats) -> None:
        """Update the range of the smallest singular value of the velocity Jacobian.

        The Jacobian relates the velocity of the output to the rates of the inputs. Its
        smallest singular value is zero at a singularity of type I, where the output loses a
        direction of motion. Each sample has such a value. The overview reports the least
        and the largest of them, and the place of the least.

        Parameters
        ----------
        gains
            (m,) smallest singular value at each of m samples, NaN where there is none.
        places
            (m,) place of each sample: its time (s), the first input (rad) or its number.
        """
        if not np.any(np.isfinite(gains)):
            return
        # `self.gain` is the least value, its place, and the largest value.
        row = first_minimum(gains)
        least, largest = float(gains[row]), float(np.nanmax(gains))
        if self.gain is None:
            self.gain = [least, float(places[row]), largest]
            return
        # Of minima that differ only by rounding, the first one stays.
        if least < self.gain[0] - EQUAL_MINIMA_TOLERANCE:
            self.gain[:2] = [least, float(places[row])]
        self.gain[2] = max(self.gain[2], largest)

    def add_reversals(self, velocities: Floats) -> None:
        """Set the least velocity ratio to 0 if the output rests between two samples.

        The velocity ratio of an output without a fixed axis is the magnitude of a vector.
        If this vector passes through zero between two samples of a path, its magnitude is
        positive at both. The least magnitude of all samples is then too large.

        Parameters
        ----------
        velocities
            (m, inputs, 3) velocity of the output per unit rate of each input at successive
            samples. In a simulation (m, 1, 3) velocities. NaN at samples without one.
        """
        # The last sample of the block before is compared, too.
        if self.last_velocities is not None:
            velocities = np.concatenate([[self.last_velocities], velocities])
        # (steps, inputs) whether the velocity passes through zero in each step.
        has_zero = _passes_zero(velocities[:-1], velocities[1:])
        for input_index in np.flatnonzero(np.any(has_zero, axis=0)).tolist():
            self.lowest_ratio[input_index] = 0.0
        is_known = len(velocities) > 0 and bool(np.all(np.isfinite(velocities[-1])))
        self.last_velocities = velocities[-1].tolist() if is_known else None

    def add_determinants(
        self, determinants: Floats, senses: Floats, places: Floats
    ) -> None:
        """Note singularities of type I: places where a determinant passes through zero.

        The determinant is that of the output's velocity Jacobian (velocity per unit rate of
        each input) at successive samples. At type I inputs can move while the output rests.
        A place is the time (s), the first input (rad) or the number of a sample.

        Parameters
        ----------
        determinants
            (m,) determinants at the m samples of a block, NaN where there is none.
        senses
            (m,) sign of the product of the rates of all inputs in a simulation, otherwise
            0. A change of this sign shows that an input turns back. The velocity per unit
            rate of this input can then change its sign without a singularity of type I.
            Samples before and after the change are therefore not compared.
        places
            (m,) places of the samples.
        """
        if not len(determinants):
            return
        # The last sample of the block before (`last_determinant`) is compared, too.
        if self.last_determinant is not None:
            place, determinant, sense = self.last_determinant
            places = np.append(place, places)
            determinants = np.append(determinant, determinants)
            senses = np.append(sense, senses)
        for place in find_zero_crossings(determinants, senses, places):
            if len(self.type_1_places) < MAX_LIST_ENTRIES:
                self.type_1_places.append(place)
            else:
                self.further_type_1_places += 1
        # The next block continues from the last sample.
        self.last_determinant = None
        if np.isfinite(determinants[-1]):
            self.last_determinant = [
                float(places[-1]),
                float(determinants[-1]),
                float(senses[-1]),
            ]


def find_zero_crossings(
    determinants: Floats, senses: Floats, places: Floats
) -> list[float]:
    """Return the places at which a determinant passes through zero between two samples.

    The determinant is that of the velocity Jacobian: the velocity of the output per unit
    rate of each input. At a zero, the output has a singularity of type I: it can rest while
    inputs move.

    In a simulation, an input can turn back while the output moves on. At such a place the
    velocity per unit rate is infinite and changes its sign without a zero. Samples before
    and after the place are not compared.

    Parameters
    ----------
    determinants
        (m,) determinants at successive samples. Samples without one have NaN, and are not
        compared with their neighbours.
    senses
        (m,) sign of the product of the rates of all inputs in a simulation, otherwise 0. A
        change of this sign shows that an input turns back.
    places
        (m,) place of each sample: its time (s), the first input (rad) or its number.

    Returns
    -------
    The places, interpolated linearly between two samples.
    """
    has_other_sign = determinants[1:] * determinants[:-1] < 0.0
    has_same_sense = senses[1:] == senses[:-1]
    crossings = []
    for row in np.flatnonzero(has_other_sign & has_same_sense).tolist():
        before = determinants[row]
        after = determinants[row + 1]
        # A linear determinant is zero at this share of the step.
        share = before / (before - after)
        step = places[row + 1] - places[row]
        crossings.append(float(places[row] + share * step))
    return crossings


def _passes_zero(before: Floats, after: Floats) -> Bools:
    """Return whether vectors pass through zero between two successive samples.

    The vectors are velocities of an output. The caller learns from the result that the
    output rests between the samples.

    Between the samples a vector follows nearly the straight line from `before` to `after`.
    The vector counts as passing through zero if this line comes near to zero. The largest
    allowed distance is `REVERSAL_SHARE` times the length of the line.

    Parameters
    ----------
    before, after
        (..., 3) the vectors at the two samples.
    """
    change = after - before
    with np.errstate(invalid="ignore", divide="ignore"):
        # The point of the line that is nearest to zero, as a share of the change.
        share = -np.sum(before * change, axis=-1) / np.sum(change**2, axis=-1)
        is_between_rows = (share > 0.0) & (share < 1.0)
        nearest_point = before + share[..., None] * change
        least_distance = np.linalg.norm(nearest_point, axis=-1)
        is_near = least_distance <= REVERSAL_SHARE * np.linalg.norm(change, axis=-1)
    return is_between_rows & is_near


@dataclass
class SampleSpans:
    """Spans of successive samples, which are added in ascending order, block after block.

    The result does not depend on how the samples are divided into blocks (groups of
    successive samples).

    Attributes
    ----------
    listed
        The numbers of the first and the last sample of each span, for the first
        `MAX_LIST_ENTRIES` spans.
    unlisted_count
        Number of the spans that are not listed.
    last_sample
        The last sample of the last span, listed or not. None if there is no span.
    """

    listed: list[list[int]] = field(default_factory=list)
    unlisted_count: int = 0
    last_sample: int | None = None

    def add(self, first: int, last: int) -> None:
        """Add the samples from `first` to `last`; they can continue the last span."""
        # Counted spans are later than all listed spans, so a listed span can only continue
        # as long as there are none.
        if self.last_sample is not None and first == self.last_sample + 1:
            if not self.unlisted_count:
                self.listed[-1][1] = last
        elif len(self.listed) < MAX_LIST_ENTRIES:
            self.listed.append([first, last])
        else:
            self.unlisted_count += 1
        self.last_sample = last


@dataclass
class ModeOverview:
    """Where an assembly mode closes, and how its outputs move.

    An assembly mode is one of the ways to assemble the mechanism. A mode closes at a sample
    if the links can be assembled in this way at the inputs of the sample.

    Attributes
    ----------
    spans
        Spans of successive samples with the same status (`Status`: OK, or the reason why
        there is no result), by the name of the status.
    closing_spans
        Spans of successive samples at which the mode closes.
    transmission
        The least transmission angle of all dyads of the mechanism, as a list of three: the
        angle (rad), the name of the middle pair of its dyad, and the place. The place is
        the time (s), the first input (rad) or the number of the sample, as in
        `OverviewPlan.places`. None if there is no dyad.
    outputs
        The overview of each output.
    """

    spans: dict[str, SampleSpans] = field(default_factory=dict)
    closing_spans: SampleSpans = field(default_factory=SampleSpans)
    transmission: list[Any] | None = None
    outputs: list[OutputOverview] = field(default_factory=list)

    @classmethod
    def from_json(cls, entries: Facts) -> Self:
        """Return the overview of a mode from the data of `dataclasses.asdict`."""
        return cls(
            spans={name: SampleSpans(**spans) for name, spans in entries["spans"].items()},
            closing_spans=SampleSpans(**entries["closing_spans"]),
            transmission=entries["transmission"],
            outputs=[OutputOverview.from_json(output) for output in entries["outputs"]],
        )

    def add_status(self, codes: SmallIntegers, first_sample: int) -> None:
        """Add the statuses of successive samples to the spans of samples with equal status.

        Parameters
        ----------
        codes
            (n,) status codes of the samples in one assembly mode.
        first_sample
            Number of the first of these samples.
        """
        if not len(codes):
            return
        # Samples from each start to its stop (excluded) have the same status.
        changes = (np.flatnonzero(codes[1:] != codes[:-1]) + 1).tolist()
        starts = [0, *changes]
        stops = [*changes, len(codes)]
        for start, stop in zip(starts, stops, strict=True):
            status_name = Status(int(codes[start])).name
            spans = self.spans.setdefault(status_name, SampleSpans())
            first = first_sample + start
            last = first_sample + stop - 1
            spans.add(first, last)
            # With the statuses OK and AT_SINGULARITY, the mode has a configuration.
            if has_configuration(codes[start]):
                self.closing_spans.add(first, last)


def first_minimum(values: Floats) -> int:
    """Return the index of the row with the least value, the first row if several agree.

    Values within `EQUAL_MINIMA_TOLERANCE` agree, so rounding does not choose the row.

    Parameters
    ----------
    values
        (m,) values, NaN in rows without one. At least one is finite.
    """
    return int(np.flatnonzero(values <= np.nanmin(values) + EQUAL_MINIMA_TOLERANCE)[0])


def update_minimum(
    minimum: list[float] | None, values: Floats, places: Floats
) -> list[float] | None:
    """Return the updated least value and its place after the values of further samples.

    A smaller value replaces the earlier minimum only if it is less by more than
    `EQUAL_MINIMA_TOLERANCE`. Of minima that differ only by rounding, the first one stays.

    Parameters
    ----------
    minimum
        The least value of earlier samples and its place, None if there is none.
    values
        (m,) values at further samples, NaN where there is none.
    places
        (m,) place of each sample: its time (s), the first input (rad) or its number.
    """
    if not np.any(np.isfinite(values)):
        return minimum
    row = first_minimum(values)
    if minimum is None or values[row] < minimum[0] - EQUAL_MINIMA_TOLERANCE:
        return [float(values[row]), float(places[row])]
    return minimum
