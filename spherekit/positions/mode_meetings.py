"""Finds the inputs at which curves of assembly modes cross, and how the modes continue.

The configurations of a mechanism with one input form curves in the space of its variables.
Two curves cross at a change point of a four-bar, for example, or in the flat state of a
fold. An assembly mode of dyads is defined by the sign of each dyad. This is the sign of the
triple product of the dyad's three pair axes. Along each smooth curve through a crossing,
the triple product of a dyad that is singular there passes through zero, so its sign
changes. The same signs therefore belong to one smooth curve below the crossing and to
another one above it. This module finds the mode in which each smooth curve continues.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.conventions import Facts
from spherekit.geometry.vectors import max_abs
from spherekit.numerics.angles import wrap
from spherekit.positions.assembly_enumeration import enumerate_assemblies
from spherekit.positions.assembly_mode import AssemblyMode
from spherekit.positions.curve_crossing import MAX_NULL_RATIO, Crossing, find_crossing
from spherekit.positions.input_paths import InputPathNodes, nodes_at
from spherekit.positions.mode_predictor import ModeCurve
from spherekit.positions.position_solver import PositionSolver
from spherekit.tolerances import EPS
from spherekit.wording import listing

MAX_INTERVAL_RAD = 1e-2
"""Wider intervals of the input are not searched for crossings. The search starts beside the
interval, and it is local."""
MIN_START_DISTANCE_RAD = 1e-5
"""Least distance from the interval of the inputs at which the search for a crossing starts.
The distance is that to the nearer end of the interval."""
MAX_MISS_RAD = 64.0 * EPS
"""Largest closure residual, and largest singular value that should be zero, of a crossing.
The rounding of a large input is added. Larger: modes that only come close to each other
count as crossing, as in a kite whose arcs differ by 1e-12. Smaller: rounding errors hide
crossings."""
SAME_CROSSING_INPUT_RAD = 1e-7
"""Crossings whose inputs differ by less are at the same input. The input of an isolated
double zero is accurate only to about the square root of the rounding error."""
COMPARISON_DISTANCE_RAD = 1e-3
"""Distance from a crossing, on both sides, at which modes are compared. Larger:
continuation by a Taylor polynomial is less accurate; smaller: modes differ less from each
other."""
MAX_COMPARISON_RATIO = 0.1
"""Largest distance at which modes are compared, relative to the distance of the next
crossing."""
MAX_MISS_RATIO = 0.1
"""Largest miss of the mode that continues a curve, relative to the miss of every other
mode. Larger: doubtful continuations are accepted; smaller: more meetings are reported as
unresolved."""
PASSING_RATIO = 0.2
"""A mode passes through a crossing if its continuation misses the crossing by less than
this part of the distance that its fastest variable moves up to the crossing."""
COINCIDENT_RAD = 1e-9
"""Modes whose variables differ by less coincide at an input. Also the difference of two
misses that counts as rounding."""


def degrees_text(angle: float) -> str:
    """Return an angle (rad) as text in degrees, with six significant digits.

    Angles smaller than about 1e-9 deg are rounding errors and become "0", never "-0".
    """
    return f"{round(float(np.degrees(angle)), 9) + 0.0:.6g}"


def find_crossings(
    solver: PositionSolver, start: float, stop: float, low: float, high: float
) -> list[Crossing]:
    """Return the crossings of curves in a short interval of the only input.

    At a crossing, two or more curves of configurations meet. The closure Jacobian then has
    more zero singular values than on a single curve. The search starts from all
    configurations at one input below the interval and one above it.

    Parameters
    ----------
    solver
        The mechanism, which has one input.
    start, stop
        Ends of the interval (rad).
    low, high
        Ends of the range of the input (rad). A crossing may lie outside them, or outside
        the interval, by `SAME_CROSSING_INPUT_RAD`.

    Returns
    -------
    The crossings whose variables differ from each other. The list is empty if the interval
    is wider than `MAX_INTERVAL_RAD`.
    """
    if stop - start > MAX_INTERVAL_RAD:
        return []
    # The search starts at all configurations below and above the interval.
    distance = max(stop - start, MIN_START_DISTANCE_RAD)
    crossings: list[Crossing] = []
    for start_input in (start - distance, stop + distance):
        for values in enumerate_assemblies(solver, np.array([start_input])).values:
            singular_values = np.linalg.svd(
                solver.closure.linearise(values[None]).jacobian[0], compute_uv=False
            )
            # On a single curve the Jacobian has the rank of all variables but one. Near a
            # crossing one more singular value is nearly zero. Configurations without such a
            # value are skipped.
            rank = len(values) - 1
            if len(singular_values) < rank:
                continue
            if singular_values[rank - 1] > MAX_NULL_RATIO * singular_values[0]:
                continue
            # `miss` is how far the result is from an exact crossing.
            crossing = find_crossing(solver.closure, values)
            if crossing is None:
                continue
            q = crossing.values[solver.input_variable]
            # After many turns the rounding of the input alone opens the loops by more.
            if crossing.miss > MAX_MISS_RAD + EPS * abs(q):
                continue
            is_inside = (
                start - SAME_CROSSING_INPUT_RAD <= q <= stop + SAME_CROSSING_INPUT_RAD
            )
            is_inside &= (
                low - SAME_CROSSING_INPUT_RAD <= q <= high + SAME_CROSSING_INPUT_RAD
            )
            is_new = all(
                max_abs(wrap(crossing.values - known_crossing.values))
                > SAME_CROSSING_INPUT_RAD
                for known_crossing in crossings
            )
            if is_inside and is_new:
                crossings.append(crossing)
    return crossings


@dataclass(frozen=True)
class ModeMeeting:
    """An input at which the curves of configurations of several assembly modes cross.

    Attributes
    ----------
    input
        Value of the only input (rad).
    modes
        One tuple for each configuration at which curves cross. The tuple has the numbers of
        the modes that meet there.
    successors
        Maps the number of a mode below the input to the number of the mode above it that
        lies on the same smooth curve. A mode that is not a key continues under its own
        number. Empty if the meeting is not resolved.
    resolved
        Whether the successor of every mode that meets was identified clearly.
    """

    input: float
    modes: tuple[tuple[int, ...], ...]
    successors: dict[int, int]
    resolved: bool

    @cached_property
    def predecessors(self) -> dict[int, int]:
        """The inverse of `successors`: modes below the input by modes above it."""
        return {after: before for before, after in self.successors.items()}

    @property
    def facts(self) -> Facts:
        """The data for this meeting in the file `summary.json`."""
        return {
            "input_rad": self.input,
            "modes": [list(numbers) for numbers in self.modes],
            "continued_by": {str(k): mode for k, mode in self.successors.items()},
            "resolved": self.resolved,
        }

    def describe(self, input_pair: str, passed: bool) -> str:
        """Return a sentence about a meeting of modes, for reports and error messages.

        An assembly mode is one way to assemble the mechanism. Its configurations form a
        curve over the input. At a meeting such curves cross. A smooth curve through the
        crossing can belong to one mode below this input and to another mode above it.
        `successors` maps the number of the mode below to that of the mode above. `resolved`
        says whether this assignment is known.

        Parameters
        ----------
        input_pair
            Name of the input pair.
        passed
            Whether modes follow their smooth curves through crossings (option "pass"). With
            the option "end", a mode keeps the signs of its dyads (groups of two links).
        """
        # `modes` has one tuple for each configuration at which curves cross: the numbers of
        # the modes that meet there. A tuple of two or more numbers becomes a text such as
        # "0 and 1". `dict.fromkeys` drops repeated tuples and keeps the order.
        meeting_modes = []
        for numbers in dict.fromkeys(self.modes):
            if len(numbers) > 1:
                meeting_modes.append(" and ".join(map(str, numbers)))
        event = "curves cross"
        if meeting_modes:
            event = f"modes {', '.join(meeting_modes)} meet"
        event += f" at {input_pair} = {degrees_text(self.input)} deg"
        if not self.resolved:
            return f"{event}; which of them continue each other is not known"
        if passed:
            return f"{event}; each follows its smooth curve through it"
        # `successors` has only modes whose smooth curve continues in another mode.
        if not self.successors:
            return f"{event}; each stays on its smooth curve"
        changes = listing(
            f"{number} to {successor}" for number, successor in self.successors.items()
        )
        return (
            f"{event}, where curves cross: smooth curves change from mode {changes} there "
            '(crossings "pass" follows them)'
        )


def find_mode_meetings(
    solver: PositionSolver,
    assembly_modes: Sequence[AssemblyMode],
    crossings: Sequence[Crossing],
) -> tuple[ModeMeeting, ...]:
    """Return the inputs at which modes meet, and which mode continues which one there.

    The configurations of a mode form a curve over the input. Two modes meet where their
    curves cross. A mode above this input continues the mode below it that lies on the same
    smooth curve. All crossings at the same input belong to one meeting.

    Parameters
    ----------
    solver
        The mechanism, which has one input.
    assembly_modes
        All modes (ways to assemble the mechanism) over the range of the input.
    crossings
        Configurations in this range at which curves cross, in any order.

    Returns
    -------
    One meeting for each input at which curves cross, in rising order of the inputs.
    """

    def input_of(crossing: Crossing) -> float:
        """Return the value of the input (rad) at a crossing."""
        return float(crossing.values[solver.input_variable])

    crossings_by_input: list[list[Crossing]] = []
    for crossing in sorted(crossings, key=input_of):
        # Inputs that differ only by the errors of the search count as equal.
        is_at_last_input = bool(crossings_by_input) and (
            input_of(crossing) - input_of(crossings_by_input[-1][0])
            < SAME_CROSSING_INPUT_RAD
        )
        if is_at_last_input:
            crossings_by_input[-1].append(crossing)
        else:
            crossings_by_input.append([crossing])
    inputs = np.array([input_of(at_input[0]) for at_input in crossings_by_input])
    # gaps[k] is the distance below input k, gaps[k + 1] the distance above it.
    gaps = np.diff(inputs, prepend=-np.inf, append=np.inf)
    meetings = []
    for k, crossings_at_input in enumerate(crossings_by_input):
        # Modes are compared at this distance below and above the input.
        distance = min(
            COMPARISON_DISTANCE_RAD, MAX_COMPARISON_RATIO * min(gaps[k], gaps[k + 1])
        )
        meetings.append(
            _compare_modes(solver, assembly_modes, crossings_at_input, distance)
        )
    return tuple(meetings)


def _compare_modes(
    solver: PositionSolver,
    assembly_modes: Sequence[AssemblyMode],
    crossings: Sequence[Crossing],
    distance: float,
) -> ModeMeeting:
    """Find which modes meet at one input, and which modes continue each other.

    Each mode is evaluated on both sides of the input, and continued with its first two
    derivatives. A mode passes through a crossing if its continuation comes near to the
    crossing. The continuation of a mode below the input is compared with all modes above
    it. The nearest of these modes is its successor. Modes above are compared with modes
    below in the same way.

    Parameters
    ----------
    solver
        The mechanism, which has one input.
    assembly_modes
        All modes over the range of the input.
    crossings
        The crossings at the input, one or more.
    distance
        Distance (rad) from the input at which modes are evaluated, below and above it.

    Returns
    -------
    The meeting, which is resolved if the best continuation of every mode that meets is much
    better than all others, in both directions.
    """
    q = float(np.mean([crossing.values[solver.input_variable] for crossing in crossings]))
    below = _evaluate_modes(solver, assembly_modes, q - distance)
    above = _evaluate_modes(solver, assembly_modes, q + distance)
    meeting: list[tuple[int, ...]] = []
    for crossing in crossings:
        is_passing = np.zeros(len(assembly_modes), dtype=bool)
        for nodes, step in ((below, distance), (above, -distance)):
            distances = _measure_misses(nodes, step, crossing.values[None])[:, 0]
            speed = np.maximum(1.0, max_abs(nodes.slope, axis=1))
            is_passing |= distances < PASSING_RATIO * distance * speed
        meeting.append(
            tuple(assembly_modes[k].number for k in np.flatnonzero(is_passing).tolist())
        )
    numbers = {number for crossing_modes in meeting for number in crossing_modes}
    # Positions in `assembly_modes` of the modes that meet.
    rows = [k for k, mode in enumerate(assembly_modes) if mode.number in numbers]
    # (modes, modes): rows are modes below the input, columns are modes above it. The larger
    # miss of the two directions counts. fmax ignores NaN in one direction.
    forward = _measure_misses(below, 2.0 * distance, above.values)
    backward = _measure_misses(above, -2.0 * distance, below.values).T
    misses = np.fmax(forward, backward)
    coincides_below = _find_coincident_modes(below.values)
    coincides_above = _find_coincident_modes(above.values)
    successors: dict[int, int] = {}
    resolved = True
    for row in rows:
        if not np.any(np.isfinite(misses[row])):
            continue  # The mode ends at the crossing, or before it.
        best = int(np.nanargmin(misses[row]))
        if misses[row, row] <= misses[row, best] + COINCIDENT_RAD:
            best = row  # Modes that coincide up to rounding keep their numbers.
        # Modes that coincide with the best one above cannot be told apart and are left out.
        other_misses = misses[row, ~coincides_above[best]]
        is_clear = not np.any(misses[row, best] > MAX_MISS_RATIO * other_misses)
        # Downwards, the best mode above must be continued by this mode.
        is_clear &= coincides_below[row, np.nanargmin(misses[:, best])]
        resolved &= bool(is_clear)
        if best != row:
            successors[assembly_modes[row].number] = assembly_modes[best].number
    return ModeMeeting(q, tuple(meeting), successors if resolved else {}, resolved)


def _evaluate_modes(
    solver: PositionSolver, assembly_modes: Sequence[AssemblyMode], q: float
) -> InputPathNodes:
    """Evaluate all assembly modes, and their derivatives, at input q (rad).

    The derivatives are with respect to the input. The result has one row per mode. The row
    is NaN if the mode does not exist at the input.
    """
    values = np.concatenate(
        [solver.evaluate(mode, np.array([[q]])).values for mode in assembly_modes]
    )
    with np.errstate(all="ignore"):
        linearisation = solver.closure.linearise(values)
        return nodes_at(linearisation, [solver.input_variable], np.ones((len(values), 1)))


def _find_coincident_modes(values: Floats) -> Bools:
    """Return, for each two assembly modes, whether they have the same configuration.

    The result is (modes, modes). `values` (modes, variables) are the configurations (rad)
    at one input. A mode that does not exist at the input (NaN) coincides only with itself.
    """
    distance = max_abs(wrap(values[:, None] - values[None]), axis=2)
    return (distance < COINCIDENT_RAD) | np.eye(len(values), dtype=bool)


def _measure_misses(nodes: InputPathNodes, step: float, values: Floats) -> Floats:
    """Return the distances of configurations from modes continued to another input value.

    A mode is continued by its Taylor polynomial of second order. A small distance shows
    that a configuration lies on the same smooth curve as the mode.

    Parameters
    ----------
    nodes
        Configuration of each mode at one value of the input, with its first derivatives
        `slope` and second derivatives `bend` with respect to the input.
    step
        Change of the input (rad) from this value to the other one, with its sign.
    values
        (k, variables) the given configurations (rad) at the other value of the input.

    Returns
    -------
    (modes, k) largest absolute difference of a variable (rad). NaN if the mode or the
    configuration does not exist.
    """
    continued_values = nodes.values + step * nodes.slope + 0.5 * step**2 * nodes.bend
    return np.asarray(max_abs(wrap(continued_values[:, None] - values[None]), axis=2))


def follow_smooth_curves(
    assembly_modes: Sequence[AssemblyMode],
    meetings: Sequence[ModeMeeting],
    start: float,
) -> tuple[AssemblyMode, ...]:
    """Return assembly modes that follow smooth curves through all crossings.

    A dyad (two links joined by a pair) can be placed in two ways, told apart by its sign.
    An assembly mode has constant signs. At a meeting, the configuration curves of two modes
    cross. A smooth curve can pass there from one mode to the other. The curve is then
    composed of pieces of several modes, and gets the number of one of them.

    Parameters
    ----------
    assembly_modes
        All modes over the range of the input.
    meetings
        The inputs at which curves cross, rising. All must be `resolved`: it is known which
        modes continue each other.
    start
        The input (rad) that decides about numbers: each smooth curve gets the number of the
        mode to which it belongs there.

    Returns
    -------
    Modes with the numbers and labels of `assembly_modes`. A mode that changes has `pieces`:
    the mode to which its curve belongs between each two meetings.
    A mode that begins at a meeting as the continuation of another mode, and does not exist
    at `start`, is left out.
    """
    mode_by_number = {mode.number: mode for mode in assembly_modes}
    # The meetings divide the range into intervals, one more than there are meetings.
    starts = [-np.inf, *(meeting.input for meeting in meetings)]
    ends = [*starts[1:], np.inf]
    # Position of the interval that contains `start`.
    first = sum(meeting.input < start for meeting in meetings)
    smooth_modes = []
    for mode in assembly_modes:
        # Number of the mode that lies on the curve in each interval. The list begins with
        # the interval of `start`, and is extended upwards, then downwards. At a meeting the
        # curve can continue in another mode. `successors` (upwards) and `predecessors`
        # (downwards) then have the number of this mode by the number before.
        numbers = [mode.number]
        # Whether, behind a meeting, another curve has the same number as this curve. Then
        # this curve is left out below if it has no configurations in the interval of
        # `start`: the mode only continues the other curve.
        is_claimed = False
        for meeting in meetings[first:]:
            is_claimed |= _is_taken_by_another(numbers[-1], meeting.successors)
            numbers.append(meeting.successors.get(numbers[-1], numbers[-1]))
        for meeting in reversed(meetings[:first]):
            is_claimed |= _is_taken_by_another(numbers[0], meeting.predecessors)
            numbers.insert(0, meeting.predecessors.get(numbers[0], numbers[0]))
        if is_claimed and not _exists_between(mode, starts[first], ends[first]):
            continue
        pieces = tuple(
            (interval_start, mode_by_number[number])
            for interval_start, number in zip(starts, numbers, strict=True)
        )
        has_changes = len(set(numbers)) > 1
        smooth_modes.append(mode._replace(pieces=pieces if has_changes else ()))
    return tuple(smooth_modes)


def _is_taken_by_another(number: int, successors: Mapping[int, int]) -> bool:
    """Return whether a curve keeps its mode number, and another curve takes it, too.

    At a meeting, curves of assembly modes cross. Each curve has the number of its mode, and
    can continue behind the meeting in a mode with another number. Two curves then have the
    same number if the mode of one of them begins at the meeting, as the continuation of the
    other curve. The caller then leaves out this mode if it does not exist near the input
    at which the curves get their numbers.

    Parameters
    ----------
    number
        The number of the curve before the meeting.
    successors
        The new number by the old one, for each curve that changes its number at the
        meeting. These are the `successors` of the meeting if it is passed with a rising
        input, and its `predecessors` with a falling input.
    """
    keeps_number = number not in successors
    another_takes_number = number in successors.values()
    return keeps_number and another_takes_number


def _exists_between(mode: AssemblyMode, low: float, high: float) -> bool:
    """Return whether a mode has configurations at inputs between `low` and `high` (rad).

    A mode with groups larger than dyads is a curve (`ModeCurve`), which may begin or end at
    a crossing and so cover only a part of the range. A mode of dyads (two links joined by a
    pair) has no such curve, and never begins at a crossing.
    """
    guide = mode.guide
    if not isinstance(guide, ModeCurve):
        return True
    return bool(
        max(guide.inputs[0], low) + SAME_CROSSING_INPUT_RAD < min(guide.inputs[-1], high)
    )
