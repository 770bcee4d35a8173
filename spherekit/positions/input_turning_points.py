"""All inputs in a range at which assembly modes meet, and where to look for modes.

The inputs are zeros of the functions of `spherekit.positions.mode_coalescence`.
Between two neighbouring ones the number of real modes is constant. A component of the
configuration curve covers one or more of the intervals between them. The modes at one input
in each interval therefore lie on all components.
"""

from itertools import pairwise
from math import ceil
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Floats
from spherekit.completeness import Completeness, Guarantee
from spherekit.geometry.vectors import max_abs
from spherekit.numerics.sign_changes import (
    MAX_CELLS,
    SAMPLES_PER_CELL,
    find_sign_changes,
    merge_intervals,
)
from spherekit.positions.curve_crossing import Crossing
from spherekit.positions.mode_coalescence import make_mode_coalescence
from spherekit.positions.mode_meetings import (
    SAME_CROSSING_INPUT_RAD,
    degrees_text,
    find_crossings,
)
from spherekit.positions.position_solver import PositionSolver
from spherekit.progress import ProgressReporter
from spherekit.wording import counted, listing

POINTLIKE_INTERVAL_RAD = 1e-4
"""Modes are not searched inside a doubtful interval that is shorter.

Modes are searched on both sides of such an interval. Larger: components that exist only
inside are missed. Smaller: more inputs are examined, at which modes nearly coincide.
"""
SAME_TURNING_INPUT_RAD = 1e-12
"""Turning inputs that differ by less are one input, at which modes of several groups meet.

Larger: modes between two turning inputs are missed. Smaller: rounding errors separate equal
inputs, and modes are searched between them.
"""
SMOOTH_WIDTH_RAD = 4.0 * np.pi
"""Width of an interval in which a function is smooth, times its number of factors.

Larger: fewer intervals are divided. Smaller: more time is spent where functions have noise.
"""
SEARCH_TIME_S = 40.0
"""Approximate time that the search may take by default."""
RUN_COST_S = 3e-3
"""Longest time that a value for a group of three loops may take in a run.

Larger: the modes of more mechanisms are proven complete, and runs take longer.
"""
RUN_TIME_S = 10.0
"""Approximate time that the search may take in a run."""
MIN_EXAMINED_CELLS = 12
"""Smallest number of intervals (cells) that are examined, even if a value takes long.

Smaller: more intervals remain doubtful.
"""
MAX_NAMED_CROSSINGS = 6
"""Largest number of inputs of crossings that are written out in a sentence."""


class InputTurningPoints(NamedTuple):
    """The inputs in a range at which two real assembly modes meet.

    An assembly mode is one way to assemble the links. Turning inputs divide
    the range into intervals in which the number of modes is constant.

    Attributes
    ----------
    low, high
        Ends of the range (rad).
    turning_inputs
        (k,) inputs (rad) at which two modes appear or vanish, each once, rising.
    doubtful
        (d, 2) intervals (rad) in which turning inputs may be missing. The whole range is
        doubtful if no functions with zeros at these inputs are known for the mechanism.
    crossings
        Configurations at which curves cross. Modes meet in them, but none of the modes
        ends.
    crossing_inputs
        (c,) inputs (rad) of the crossings, each once, rising.
    """

    low: float
    high: float
    turning_inputs: Floats
    doubtful: Floats
    crossings: tuple[Crossing, ...] = ()
    crossing_inputs: Floats = np.zeros(0)

    def gap(self, step: float) -> float:
        """Return the width (rad) of the widest interval in which a mode may be missed.

        A mode can appear at one turning input and vanish at another. In a doubtful
        interval, both inputs may have been missed. The mode is then found only if a probe
        (an input at which modes are computed) lies between them. The probes divide each
        doubtful interval into smaller intervals, in which a mode may still be missed. The
        result is the width of the widest of these. It is zero if no interval is doubtful.

        Parameters
        ----------
        step
            Greatest distance of neighbouring probes in doubtful intervals (rad).
        """
        probes = self.probes(step)
        widest = 0.0
        for start, stop in merge_intervals(self.doubtful).tolist():
            inside = probes[(start < probes) & (probes < stop)]
            widest = max(widest, max_abs(np.diff([start, *inside, stop])))
        return float(widest)

    def probes(self, step: float) -> Floats:
        """Return the inputs (n,) in rad at which all assembly modes should be computed.

        An assembly mode is a curve of configurations over the input. Modes meet at two
        kinds of inputs: at turning inputs two of them end, at crossing inputs their curves
        cross and continue. Between two neighbouring meetings the number of modes is
        constant, so one probe is enough.

        In a doubtful interval, meetings may have been missed. Such an interval has several
        probes, at most `step` (rad) apart. A doubtful interval shorter than
        `POINTLIKE_INTERVAL_RAD` has none, because modes nearly coincide in it.
        """
        # A crossing at an end of the range can be outside by rounding.
        crossing_inputs = np.clip(self.crossing_inputs, self.low, self.high)
        borders = [
            self.low,
            *self.turning_inputs,
            *crossing_inputs,
            *self.doubtful.ravel(),
            self.high,
        ]
        probes: list[float] = []
        for start, stop in pairwise(np.unique(borders).tolist()):
            middle = 0.5 * (start + stop)
            width = stop - start
            is_doubtful = any(low < middle < high for low, high in self.doubtful.tolist())
            # Number of probes in this interval.
            count = 1
            if is_doubtful:
                count = ceil(width / step) if width > POINTLIKE_INTERVAL_RAD else 0
            probes += [start + (k + 0.5) / count * width for k in range(count)]
        # A range that is one short doubtful interval gets its middle as the only probe.
        return np.array(probes or [0.5 * (self.low + self.high)])

    def claim(self, step: float) -> Completeness:
        """Return whether modes may be missing after a search at all `probes(step)`.

        A probe is an input at which all modes were computed. Modes appear and vanish only
        where two of them meet. If all such meetings are known, one probe between each two
        of them is enough to know all modes. A meeting may have been missed in a doubtful
        interval. There, a mode that exists only between two probes may be missing.

        Parameters
        ----------
        step
            Greatest distance of neighbouring probes in doubtful intervals (rad).
        """
        if self.low == self.high:
            return Completeness(Guarantee.COMPLETE, "all modes at the only input")
        # The widest interval of the input (rad) in which a mode may be missing.
        gap = self.gap(step)
        if not gap:
            return Completeness(Guarantee.COMPLETE, self._describe_all_meetings())
        probe_text = f"{counted(len(self.probes(step)), 'value')} of the input"
        # At the level `TO_BOX`, each mode that exists over a wider interval is known.
        return Completeness(
            Guarantee.TO_BOX,
            reason=f"all modes at {probe_text}{self._describe_known_meetings()}",
            box=gap,
            sentence=(
                f"All assembly modes were computed at {probe_text} and followed from "
                "there over the range. A mode that exists at no such value, over at most "
                f"{np.degrees(gap):.3g} deg of the input, could be missed."
            ),
        )

    @property
    def _meeting_count(self) -> int:
        """The number of inputs at which modes are known to meet.

        At turning inputs modes appear or vanish, at crossing inputs their curves cross.
        """
        return len(self.turning_inputs) + len(self.crossing_inputs)

    def _describe_all_meetings(self) -> str:
        """Return why all modes are known if no interval is doubtful."""
        if self._meeting_count == 0:
            intervals = "which meet nowhere in the range"
        elif self._meeting_count == 1:
            intervals = "which meet at one input in the range"
        else:
            intervals = (
                f"between the {self._meeting_count} inputs of the range at which they meet"
            )
        return f"all modes, {intervals}{self._crossing_remark}"

    def _describe_known_meetings(self) -> str:
        """Return words that are added to the report on a range with doubtful intervals.

        The words say that modes were computed between each two neighbouring known inputs at
        which modes meet. The text is empty if no such input is known.
        """
        if not self._meeting_count:
            return ""
        if self._meeting_count == 1:
            intervals = "both sides of the known value"
        else:
            intervals = f"each interval between the {self._meeting_count} known values"
        return f", which include {intervals} at which modes meet{self._crossing_remark}"

    @property
    def _crossing_remark(self) -> str:
        """A remark that names the inputs at which curves cross; empty without crossings."""
        if not len(self.crossing_inputs):
            return ""
        named = [
            degrees_text(q) for q in self.crossing_inputs[:MAX_NAMED_CROSSINGS].tolist()
        ]
        further = len(self.crossing_inputs) - len(named)
        if further:
            named.append(f"{further} more")
        return f" (curves cross at {listing(named)} deg)"


def find_input_turning_points(
    solver: PositionSolver,
    low: float,
    high: float,
    max_cost_s: float = np.inf,
    max_time_s: float = SEARCH_TIME_S,
) -> InputTurningPoints:
    """Find the inputs in a range at which assembly modes meet.

    Parameters
    ----------
    solver
        The mechanism, which has one input.
    low, high
        Ends of the range of the input (rad).
    max_cost_s
        Longest time (s) that one value of the functions may take for a group of three
        loops. If it takes longer, the whole range is doubtful.
    max_time_s
        Approximate time (s) after which the remaining intervals are doubtful.

    Returns
    -------
    The inputs at which modes meet. Each group of links (placed together) has a function of
    the input that changes its sign where two modes of the group meet.
    """
    coalescence = make_mode_coalescence(solver, max_cost_s) if low < high else None
    if coalescence is None:
        return InputTurningPoints(low, high, np.zeros(0), np.array([[low, high]]))
    if not coalescence.groups:  # An open chain has one mode.
        return InputTurningPoints(low, high, np.zeros(0), np.zeros((0, 2)))
    cell_time_s = SAMPLES_PER_CELL * coalescence.cost
    max_cells = int(np.clip(max_time_s / cell_time_s, MIN_EXAMINED_CELLS, MAX_CELLS))
    progress = ProgressReporter("looking for the inputs at which modes meet")
    group_count = len(coalescence.groups)
    # Inputs (rad) at which a function changes its sign, and intervals in which this could
    # not be decided, group after group.
    all_sign_changes = []
    all_doubtful = []
    for position in range(group_count):

        def evaluate(q: Floats, position: int = position) -> Floats:
            """Return the values (n,) of the function of a group at inputs q (n,) in rad.

            A group is a set of links that are placed together. The function changes its
            sign where two modes (solutions) of the group meet (`ModeCoalescence`).
            """
            progress.report_if_due(lambda: f"group {position + 1} of {group_count}")
            return coalescence(position, q)

        # A product of more factors varies faster.
        smooth_width = SMOOTH_WIDTH_RAD / coalescence.count_factors(position)
        sign_changes, doubtful = find_sign_changes(
            evaluate, low, high, max_cells, smooth_width
        )
        all_sign_changes.append(sign_changes)
        all_doubtful.append(doubtful)
    doubtful = np.concatenate(all_doubtful)
    turning_inputs = np.sort(np.concatenate(all_sign_changes))
    is_new = np.diff(turning_inputs, prepend=-np.inf) > SAME_TURNING_INPUT_RAD
    turning_points = InputTurningPoints(
        low,
        high,
        turning_inputs=turning_inputs[is_new],
        doubtful=doubtful[np.argsort(doubtful[:, 0])],
    )
    return _with_crossings(solver, turning_points)


def _with_crossings(
    solver: PositionSolver, turning_points: InputTurningPoints
) -> InputTurningPoints:
    """Return the turning points with doubtful intervals replaced by the crossings in them.

    Assembly modes are curves of configurations over the input. The turning points were
    found by functions of the input that are zero where two modes meet (`ModeCoalescence`).
    At a turning point both modes end, and such a function changes its sign. At a crossing
    both modes continue, and the function only touches zero. Numerically this looks like two
    zeros or none, so an interval in which it happens is doubtful. The crossings in doubtful
    intervals are computed here.

    Parameters
    ----------
    solver
        The mechanism, which has one input.
    turning_points
        The inputs at which modes meet, with intervals in which this could not be decided.
    """
    crossings: list[Crossing] = []
    # An interval without a crossing remains doubtful.
    still_doubtful = []
    range_low, range_high = turning_points.low, turning_points.high
    for start, stop in turning_points.doubtful.tolist():
        crossings_in_interval = find_crossings(
            solver, start, stop, low=range_low, high=range_high
        )
        crossings += crossings_in_interval
        if not crossings_in_interval:
            still_doubtful.append([start, stop])
    # The inputs of all crossings. An input with several crossings is listed once.
    inputs = np.sort([crossing.values[solver.input_variable] for crossing in crossings])
    is_new = np.diff(inputs, prepend=-np.inf) > SAME_CROSSING_INPUT_RAD
    return turning_points._replace(
        doubtful=np.reshape(still_doubtful, (-1, 2)),
        crossings=tuple(crossings),
        crossing_inputs=inputs[is_new],
    )
