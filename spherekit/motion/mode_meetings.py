"""Inputs at which curves of assembly modes cross, and the modes that continue each other.

Such an input is a change point of a four-bar, or the flat state of a fold. An assembly mode
of dyads is named by signs, and the sign of a dyad belongs to one smooth curve before the
crossing and to another one beyond it. The smooth curve through a crossing so continues in
another assembly mode.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.conventions import EPS, Facts, listing
from spherekit.motion.assembly_modes import AssemblyMode, Solver
from spherekit.motion.crossing import NEARLY_NULL, Crossing, crossing_near
from spherekit.motion.elimination import assemblies
from spherekit.motion.guides import ModeCurve
from spherekit.motion.steps import Nodes, nodes_at
from spherekit.numeric.crossings import wrap
from spherekit.sphere.rotation import max_abs

WIDEST_RAD = 1e-2
"""A part of the input's range that is wider is not examined for a crossing in it."""
BESIDE_RAD = 1e-5
"""Configurations from which a crossing is sought are at least so far beside it."""
LARGEST_MISS = 64.0 * EPS
"""Loops and singular values (rad) that miss a crossing by more are not one. Modes that only
come close to each other, as in a kite whose arcs differ by 1e-12, do not cross."""
SAME_INPUT_RAD = 1e-7
"""Crossings whose inputs differ by less are at one input. That of an isolated double zero
is known to the square root of rounding."""
COMPARED_RAD = 1e-3
"""So far on both sides of a crossing modes are compared."""
PART_OF_GAP = 0.1
"""The same as a part of the distance to the next crossing, where that is nearer."""
CLEARLY = 0.1
"""The mode that continues a curve misses it by less than this part of what others do."""
NEAR_CROSSING = 0.2
"""A mode passes a crossing if it misses it by less than this part of the way to it."""


def degrees_text(angle: float) -> str:
    """Return an angle (rad) in degrees, less the rounding of an angle of 0."""
    return f"{round(float(np.degrees(angle)), 9) + 0.0:.6g}"


def find_crossings(
    solver: Solver, start: float, stop: float, low: float, high: float
) -> list[Crossing]:
    """Return the crossings of curves in a short part of the range of the only input.

    Parameters
    ----------
    solver
        The mechanism.
    start, stop
        Ends of the part (rad).
    low, high
        Ends of the range (rad). A crossing that is beyond them by rounding counts.

    Returns
    -------
    list of Crossing
        Those that real modes at inputs beside the part lead to. Of several at one input
        only those that differ in their variables.
    """
    if stop - start > WIDEST_RAD:
        return []
    away = max(stop - start, BESIDE_RAD)
    crossings: list[Crossing] = []
    for beside in (start - away, stop + away):
        for values in assemblies(solver, np.array([beside])).values:
            sizes = np.linalg.svd(
                solver.closure.at(values[None]).jacobian[0], compute_uv=False
            )
            rank = len(values) - 1
            if len(sizes) < rank or sizes[rank - 1] > NEARLY_NULL * sizes[0]:
                continue
            crossing = crossing_near(solver.closure, values)
            if crossing is None or crossing.miss > LARGEST_MISS:
                continue
            q = crossing.values[solver.single]
            inside = start - SAME_INPUT_RAD <= q <= stop + SAME_INPUT_RAD
            inside &= low - SAME_INPUT_RAD <= q <= high + SAME_INPUT_RAD
            is_new = all(
                max_abs(wrap(crossing.values - other.values)) > SAME_INPUT_RAD
                for other in crossings
            )
            if inside and is_new:
                crossings.append(crossing)
    return crossings


@dataclass(frozen=True)
class ModeMeeting:
    """An input at which curves of assembly modes cross.

    Attributes
    ----------
    input
        The value of the only input (rad).
    modes
        Numbers of the modes that meet, in one tuple for each configuration where they do.
    successors
        For each number of a mode below the input the number of the mode above it that lies
        on the same smooth curve. Modes that are not in it keep their number.
    resolved
        Whether it is known for all modes that meet which ones continue each other.
    """

    input: float
    modes: tuple[tuple[int, ...], ...]
    successors: dict[int, int]
    resolved: bool

    @cached_property
    def predecessors(self) -> dict[int, int]:
        """For each mode above the input the one below it on the same smooth curve."""
        return {after: before for before, after in self.successors.items()}

    @property
    def facts(self) -> Facts:
        """What `summary.json` has of it."""
        return {
            "input_rad": self.input,
            "modes": [list(numbers) for numbers in self.modes],
            "continued_by": {str(k): mode for k, mode in self.successors.items()},
            "resolved": self.resolved,
        }

    def describe(self, input_pair: str, passed: bool) -> str:
        """Return a sentence about it; `passed` says that modes follow the smooth curves."""
        groups = [
            " and ".join(map(str, numbers))
            for numbers in dict.fromkeys(self.modes)
            if len(numbers) > 1
        ]
        words = f"modes {', '.join(groups)} meet" if groups else "curves cross"
        words += f" at {input_pair} = {degrees_text(self.input)} deg"
        if not self.resolved:
            return f"{words}; which of them continue each other is not known"
        if passed:
            return f"{words}; each follows its smooth curve through it"
        if not self.successors:
            return f"{words}; each stays on its smooth curve"
        changes = listing(f"{k} to {mode}" for k, mode in self.successors.items())
        return (
            f"{words}, where curves cross: smooth curves change from mode {changes} there "
            '(crossings "pass" follows them)'
        )


def find_mode_meetings(
    solver: Solver, assembly_modes: Sequence[AssemblyMode], crossings: Sequence[Crossing]
) -> tuple[ModeMeeting, ...]:
    """Return the inputs at which modes meet, with the modes that continue each other.

    Parameters
    ----------
    solver
        The mechanism, which has one input.
    assembly_modes
        All modes over the range.
    crossings
        Where curves cross in it.
    """
    inputs: list[list[Crossing]] = []
    for crossing in sorted(crossings, key=lambda item: float(item.values[solver.single])):
        q = crossing.values[solver.single]
        if inputs and q - inputs[-1][0].values[solver.single] < SAME_INPUT_RAD:
            inputs[-1].append(crossing)
        else:
            inputs.append([crossing])
    places = np.array([group[0].values[solver.single] for group in inputs])
    gaps = np.diff(places, prepend=-np.inf, append=np.inf)
    meetings = []
    for k, group in enumerate(inputs):
        away = min(COMPARED_RAD, PART_OF_GAP * min(gaps[k], gaps[k + 1]))
        meetings.append(_compare_modes(solver, assembly_modes, group, away))
    return tuple(meetings)


def _compare_modes(
    solver: Solver,
    assembly_modes: Sequence[AssemblyMode],
    crossings: Sequence[Crossing],
    away: float,
) -> ModeMeeting:
    """Compare the modes on both sides of crossings at one input, `away` (rad) from it."""
    q = float(np.mean([crossing.values[solver.single] for crossing in crossings]))
    below = _nodes(solver, assembly_modes, q - away)
    above = _nodes(solver, assembly_modes, q + away)
    meeting: list[tuple[int, ...]] = []
    for crossing in crossings:
        passes = np.zeros(len(assembly_modes), dtype=bool)
        for nodes, step in ((below, away), (above, -away)):
            off = _misses(nodes, step, crossing.values[None])[:, 0]
            speed = np.maximum(1.0, max_abs(nodes.slope, axis=1))
            passes |= off < NEAR_CROSSING * away * speed
        meeting.append(
            tuple(assembly_modes[k].number for k in np.flatnonzero(passes).tolist())
        )
    numbers = {number for of_crossing in meeting for number in of_crossing}
    rows = [k for k, mode in enumerate(assembly_modes) if mode.number in numbers]
    # Rows are modes below the input, columns modes above it.
    forward = _misses(below, 2.0 * away, above.values)
    backward = _misses(above, -2.0 * away, below.values).T
    misses = np.fmax(forward, backward)
    same_below = _coincide(below.values)
    same_above = _coincide(above.values)
    successors: dict[int, int] = {}
    resolved = True
    for row in rows:
        if not np.any(np.isfinite(misses[row])):
            continue  # It ends at the crossing, or before.
        best = int(np.nanargmin(misses[row]))
        if misses[row, row] <= misses[row, best] + LARGEST_SAME:
            best = row  # Modes that are one to rounding keep their numbers.
        others = misses[row, ~same_above[best]]
        is_clear = not np.any(misses[row, best] > CLEARLY * others)
        is_clear &= same_below[row, np.nanargmin(misses[:, best])]
        resolved &= bool(is_clear)
        if best != row:
            successors[assembly_modes[row].number] = assembly_modes[best].number
    return ModeMeeting(q, tuple(meeting), successors if resolved else {}, resolved)


LARGEST_SAME = 1e-9
"""Modes (rad) that miss a curve by amounts that differ by less are one there."""


def _nodes(solver: Solver, assembly_modes: Sequence[AssemblyMode], q: float) -> Nodes:
    """Return all modes (modes, variables) at an input (rad) with their derivatives."""
    values = np.concatenate(
        [solver.evaluate(mode, np.array([[q]])).values for mode in assembly_modes]
    )
    with np.errstate(all="ignore"):
        at = solver.closure.at(values)
        return nodes_at(at, [solver.single], np.ones((len(values), 1)))


def _coincide(values: Floats) -> Bools:
    """Return which (modes, modes) of configurations (modes, variables) are one."""
    away = max_abs(wrap(values[:, None] - values[None]), axis=2)
    return (away < LARGEST_SAME) | np.eye(len(values), dtype=bool)


def _misses(nodes: Nodes, step: float, values: Floats) -> Floats:
    """Return by how much (rad) curves, continued by a step (rad), miss configurations.

    It is (modes, k) for configurations (k, variables), NaN where there is none.
    """
    ahead = nodes.values + step * nodes.slope + 0.5 * step**2 * nodes.bend
    return np.asarray(max_abs(wrap(ahead[:, None] - values[None]), axis=2))


def follow_smooth_curves(
    assembly_modes: Sequence[AssemblyMode],
    meetings: Sequence[ModeMeeting],
    start: float,
) -> tuple[AssemblyMode, ...]:
    """Return assembly modes that follow smooth curves through all crossings.

    Parameters
    ----------
    assembly_modes
        All modes over the range.
    meetings
        Where they meet, at rising inputs.
    start
        The input (rad) around which each mode keeps its number.

    Returns
    -------
    tuple of AssemblyMode
        With the same numbers and labels. Each has `pieces`: at a crossing it changes to
        the mode that continues its curve. A mode that is there only as the continuation of
        another one is left out.
    """
    by_number = {mode.number: mode for mode in assembly_modes}
    starts = [-np.inf, *(meeting.input for meeting in meetings)]
    ends = [*starts[1:], np.inf]
    first = sum(meeting.input < start for meeting in meetings)
    smooth = []
    for mode in assembly_modes:
        numbers = [mode.number]
        taken = False
        for meeting in meetings[first:]:
            taken |= _is_taken(numbers[-1], meeting.successors)
            numbers.append(meeting.successors.get(numbers[-1], numbers[-1]))
        for meeting in reversed(meetings[:first]):
            taken |= _is_taken(numbers[0], meeting.predecessors)
            numbers.insert(0, meeting.predecessors.get(numbers[0], numbers[0]))
        if taken and not _exists(mode, starts[first], ends[first]):
            continue
        pieces = tuple(
            (place, by_number[number])
            for place, number in zip(starts, numbers, strict=True)
        )
        changes = len(set(numbers)) > 1
        smooth.append(mode._replace(pieces=pieces if changes else ()))
    return tuple(smooth)


def _is_taken(number: int, successors: Mapping[int, int]) -> bool:
    """Return whether a mode beyond a crossing is the continuation of another one."""
    return number not in successors and number in successors.values()


def _exists(mode: AssemblyMode, low: float, high: float) -> bool:
    """Return whether a mode has configurations at inputs between two (rad).

    Modes of dyads alone continue each other one to one, so this is asked of followed ones.
    """
    guide = mode.guide
    if not isinstance(guide, ModeCurve):
        return True
    return bool(max(guide.inputs[0], low) + SAME_INPUT_RAD < min(guide.inputs[-1], high))
