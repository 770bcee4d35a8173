"""All inputs of a range at which assembly modes meet, and so where to look for modes.

With R pairs only, the modes of a group are the roots of an algebraic system, and real
ones can appear or vanish only where two roots meet. There the determinant of the group's
equations is zero for both. Its product over all complex modes of the group, and of the
groups before it, no longer depends on how modes are numbered: it is a real analytic
function of the input, and changes its sign exactly where two real modes meet.

Between two neighbouring such inputs the number of real modes does not change. A component
of the configuration curve either goes through the whole range or turns back at two of them,
so the modes at one input of every interval between them lie on all components.
"""

from collections.abc import Iterable, Sequence
from itertools import pairwise
from math import ceil, prod
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Complexes, Floats
from spherekit.completeness import Completeness, Guarantee
from spherekit.geometry.vectors import all_finite, max_abs
from spherekit.mechanism.joint import revolute
from spherekit.numerics.sign_changes import MAX_CELLS, find_sign_changes
from spherekit.positions.arc_equations import GroupGeometry
from spherekit.positions.curve_crossing import Crossing
from spherekit.positions.elimination_order import EliminationOrder, find_elimination_orders
from spherekit.positions.group_assembly import place_train_bodies
from spherekit.positions.mode_meetings import SAME_INPUT_RAD, degrees_text, find_crossings
from spherekit.positions.position_solver import PositionSolver
from spherekit.progress import ProgressReporter
from spherekit.wording import counted, listing

MOST_COMPLEX = 64
"""Complex modes of a mechanism up to which all of them are followed."""
MOST_LOOPS = 2
"""A group of more loops is solved only if it is the only one of the mechanism."""
COSTS = {1: 1e-5, 2: 5e-4, 3: 1e-2}
"""About the time (s) that the modes of a group of so many loops take at an input."""
TRIED = (0.3183, 1.7411, 2.9127, 4.0312, 5.3779)
"""Inputs (rad) in no special position at which groups are tried for what they see."""
ALIKE = 1e-9
"""Determinants that differ by less, over the largest, are the same in all modes."""


def meetings_of(
    solver: PositionSolver, most_cost: float = np.inf
) -> "ModeCoalescence | None":
    """Return the functions of a mechanism with one input, None if they are not known.

    They are for chains of trains of wheels, dyads and triads, and for a single group of
    three loops, if a value of its function takes less than `most_cost` (s).
    """
    groups = solver.assembly.groups
    orders = [
        find_elimination_orders(group) if group.revolute and group.loops in COSTS else ()
        for number, group in enumerate(groups)
        if number not in solver.wheel_trains
    ]
    if len(solver.driven) != 1 or not all(orders):
        return None
    if prod(order[0].root_count for order in orders) > MOST_COMPLEX:
        return None
    most = max((len(order[0].removed_links) for order in orders), default=0)
    if most > MOST_LOOPS and (len(groups) > 1 or COSTS[most] > most_cost):
        return None
    return ModeCoalescence(solver)


class ModeCoalescence:
    """The real analytic functions of an input whose sign changes where modes meet.

    There is one for each group, `groups` in solving order; `cost` is about the time (s)
    that one value of all functions takes. A group that stands beside earlier ones does not
    see their modes: those are no factors of its function, which would only be a power.
    """

    def __init__(self, solver: PositionSolver) -> None:
        self.solver = solver
        self.groups = solver.assembly.groups
        every = frozenset(range(len(self.groups)))
        tried_at = np.add.outer(TRIED, np.arange(len(solver.driven)))
        self._orders: list[EliminationOrder | None] = []
        self._seen: list[frozenset[int]] = []
        for part, group in enumerate(self.groups):
            self._seen.append(every)
            tried = (
                (None,) if part in solver.wheel_trains else find_elimination_orders(group)
            )
            self._orders.append(tried[0])
            for self._orders[part] in tried:
                determinants = self._determinants(part, tried_at)
                if all_finite(determinants):
                    break
            self._seen[part] = self._dependence(part, determinants)
        self.cost = sum(
            COSTS.get(group.loops, COSTS[2]) * prod(map(self._count, seen))
            for group, seen in zip(self.groups, self._seen, strict=True)
        )
        self._seen.append(every)

    def _count(self, number: int) -> int:
        """Return how many complex modes a group has, a train of wheels one."""
        order = self._orders[number]
        return 1 if order is None else order.root_count

    def modes(self, part: int) -> int:
        """Return the number of complex modes that the function of a group is made of."""
        return prod(map(self._count, (*self._seen[part], part)))

    def __call__(self, part: int, q: Floats) -> Floats:
        """Return the function (n,) of group `part` at inputs q (n,) rad.

        NaN where a complex mode is missing, infinite, or one of infinitely many, and where
        the product of the determinants of all modes exceeds float64.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            function = np.prod(self._determinants(part, q[:, None]), axis=1).real
        return np.where(np.isfinite(function), function, np.nan)

    def configurations(self, q: Floats) -> Complexes:
        """Return the variables (modes, pairs) rad of all complex modes at inputs q (k,).

        Of a mechanism of R pairs; NaN where a mode is missing, infinite, or one of
        infinitely many.
        """
        with np.errstate(all="ignore"):
            within = self._placed(len(self.groups), q[None])
            one, other = self._sides(range(len(self.solver.joints)), within)
            turning = (one[..., 0] + 1j * one[..., 1]) * other[..., 0]
            return -1j * np.log(np.sum(turning, axis=-1)).T

    def _determinants(self, part: int, q: Floats) -> Complexes:
        """Return the determinants (n, modes) of a group at inputs q (n, k)."""
        order, group = self._orders[part], self.groups[part]
        with np.errstate(all="ignore"):
            within = self._placed(part, q)
            if order is None:
                return np.ones((len(q), within[0].shape[1]), dtype=complex)
            geometry = GroupGeometry(group, self._sides(group.pairs, within))
            return geometry.solve_equations(order)[1].reshape(len(q), -1)

    def _placed(self, part: int, q: Floats) -> list[Complexes]:
        """Return the orientations (n, modes, 3, 3) of links in their bodies.

        At inputs q (n, k), for all modes of the groups before one.
        """
        state, ends = self.solver.start(q), self.solver.mechanism.ends
        within = [state.within[k][:, None].astype(complex) for k in sorted(state.within)]
        fixed = self.solver.gear_train_angles(q)
        angles = {pair: angle[:, None] for pair, angle in fixed.items()}
        for number, group in enumerate(self.groups[:part]):
            order, step = self._orders[number], self._count(number)
            if order is None:
                turns = place_train_bodies(group, within, ends, self.solver.joints, angles)
            else:
                geometry = GroupGeometry(group, self._sides(group.pairs, within))
                placed = geometry.place_bodies(order, geometry.solve_equations(order)[0])
                placed = placed.reshape(len(q), -1, *placed.shape[2:])
                turns = [placed[:, :, body] for body in range(placed.shape[2])]
                within = [np.repeat(turned, step, axis=1) for turned in within]
            for turn, members in zip(turns, group.bodies, strict=True):
                for link in members:
                    within[link] = turn @ within[link]
            if number not in self._seen[part]:
                within = [turned[:, ::step] for turned in within]
        return within

    def _sides(self, pairs: Iterable[int], within: Sequence[Complexes]) -> Complexes:
        """Return the frames (2, pairs, n, 3, 3) of pairs in all modes, one by one."""
        sides = []
        for pair in pairs:
            joint = revolute(self.solver.joints[pair])
            a, b = self.solver.mechanism.ends[pair]
            sides.append((within[a] @ joint.first, within[b] @ joint.second))
        return np.swapaxes(np.reshape(sides, (len(sides), 2, -1, 3, 3)), 0, 1)

    def _dependence(self, part: int, determinants: Complexes) -> frozenset[int]:
        """Return the earlier groups whose modes a group's determinants (n, modes) see."""
        counts = [self._count(number) for number in range(part + 1)]
        values = np.prod(determinants.reshape(len(TRIED), *counts), axis=-1)
        return frozenset(
            earlier
            for earlier in range(part)
            if counts[earlier] > 1
            and not max_abs(np.diff(values, axis=1 + earlier)) < ALIKE * max_abs(values)
        )


POINTLIKE = 1e-4
"""A doubtful part (rad) so short is not looked into: its sides are."""
SMOOTH = 4.0 * np.pi
"""Width (rad), over the number of modes, of parts in which their function is smooth."""
MOST_TIME = 40.0
"""Rough time (s) that the search for dead inputs may take."""
MOST_NAMED = 6
"""Inputs at which curves cross that a claim names."""


class InputTurningPoints(NamedTuple):
    """The inputs from `low` to `high` (rad) at which two real modes meet.

    Attributes
    ----------
    low, high
        Ends of the range (rad).
    places
        (k,) inputs at which two modes appear or vanish, rising.
    doubtful
        (d, 2) parts in which some may be missing: all of the range if the modes have no
        analytic function here.
    crossings
        Configurations at which curves cross, so that modes meet and none of them ends.
    crossing_inputs
        (c,) the inputs there, each once, rising.
    """

    low: float
    high: float
    places: Floats
    doubtful: Floats
    crossings: tuple[Crossing, ...] = ()
    crossing_inputs: Floats = np.zeros(0)

    def gap(self, step: float) -> float:
        """Return the longest part (rad) without an input of `probes(step)`, 0 if none."""
        widths = np.diff(self.doubtful)
        widths = widths[widths > 0.0]
        return float(np.max(widths / np.ceil(widths / step), initial=0.0))

    def probes(self, step: float) -> Floats:
        """Return inputs (n,): one between two neighbours, and more in doubtful parts.

        Those are at most `step` (rad) apart.
        """
        crossed = np.clip(self.crossing_inputs, self.low, self.high)
        ends = [self.low, *self.places, *crossed, *self.doubtful.ravel(), self.high]
        probes: list[float] = []
        for start, stop in pairwise(np.unique(ends).tolist()):
            middle, width, count = 0.5 * (start + stop), stop - start, 1
            if any(low < middle < high for low, high in self.doubtful.tolist()):
                count = ceil(width / step) if width > POINTLIKE else 0
            probes += [start + (k + 0.5) / count * width for k in range(count)]
        # A range that is one short doubtful part has no sides to look at.
        return np.array(probes or [0.5 * (self.low + self.high)])

    def claim(self, step: float) -> Completeness:
        """Return what all modes at the inputs of `probes(step)` say of all others."""
        if self.low == self.high:
            return Completeness(Guarantee.COMPLETE, "all modes at the only input")
        gap = self.gap(step)
        count = len(self.places) + len(self.crossing_inputs)
        if not gap:
            words = f"between the {count} inputs of the range at which they meet"
            if count < 2:
                words = f"which meet {('nowhere', 'at one input')[count]} in the range"
            words = f"all modes, {words}{self._crossing_words}"
            return Completeness(Guarantee.COMPLETE, words)
        words = f"all modes at {counted(len(self.probes(step)), 'input')}"
        if count:
            words += f", and between {count} at which they are known to meet"
            words += self._crossing_words
        return Completeness(Guarantee.TO_BOX, words, gap)

    @property
    def _crossing_words(self) -> str:
        """Which of the inputs at which modes meet are those where curves cross."""
        if not len(self.crossing_inputs):
            return ""
        named = [degrees_text(q) for q in self.crossing_inputs[:MOST_NAMED].tolist()]
        left = len(self.crossing_inputs) - len(named)
        words = listing([*named, *([f"{left} more"] if left else [])])
        return f" (curves cross at {words} deg)"


def input_turning_points(
    solver: PositionSolver,
    low: float,
    high: float,
    most_cost: float = np.inf,
    most_time: float = MOST_TIME,
) -> InputTurningPoints:
    """Return the dead inputs of a mechanism with one input over a range (rad).

    Where one value of the functions takes more than `most_cost` (s), the whole range is
    left doubtful. What is not settled after about `most_time` (s), too.
    """
    meetings = meetings_of(solver, most_cost) if low < high else None
    if meetings is None:
        return InputTurningPoints(low, high, np.zeros(0), np.array([[low, high]]))
    if not meetings.groups:  # an open chain has one mode
        return InputTurningPoints(low, high, np.zeros(0), np.zeros((0, 2)))
    most = int(np.clip(most_time / (36.0 * meetings.cost), 12, MAX_CELLS))
    working = ProgressReporter("looking for the inputs at which modes meet")
    per_group = []
    for part in range(len(meetings.groups)):

        def function(q: Floats, part: int = part) -> Floats:
            working.tell(f"group {part + 1} of {len(meetings.groups)}".__str__)
            return meetings(part, q)

        per_group.append(
            find_sign_changes(function, low, high, most, SMOOTH / meetings.modes(part))
        )
    places, doubtful = (np.concatenate(parts) for parts in zip(*per_group, strict=True))
    doubtful = doubtful[np.argsort(doubtful[:, 0])]
    return _with_crossings(solver, InputTurningPoints(low, high, np.sort(places), doubtful))


def _with_crossings(
    solver: PositionSolver, turning_points: InputTurningPoints
) -> InputTurningPoints:
    """Return turning points where doubtful parts in which curves cross are crossings.

    At a crossing the functions of meeting modes have a double zero, which is no change of
    sign. To the error of the function it could as well be two zeros, or none.
    """
    crossings: list[Crossing] = []
    still_doubtful = []
    for start, stop in turning_points.doubtful.tolist():
        crossings_there = find_crossings(
            solver, start, stop, turning_points.low, turning_points.high
        )
        crossings += crossings_there
        if not crossings_there:
            still_doubtful.append([start, stop])
    inputs = np.sort([crossing.values[solver.input_variable] for crossing in crossings])
    is_new = np.diff(inputs, prepend=-np.inf) > SAME_INPUT_RAD
    return turning_points._replace(
        doubtful=np.reshape(still_doubtful, (-1, 2)),
        crossings=tuple(crossings),
        crossing_inputs=inputs[is_new],
    )
