"""All inputs of a range at which assembly modes meet, and so where to look for modes.

Between two neighbouring ones the number of real modes does not change. A component of
the configuration curve either goes through the whole range or turns back at two of them,
so the modes at one input of every interval between them lie on all components.
"""

from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.conventions import counted
from spherekit.errors import PlanError
from spherekit.guarantee import Claim, Guarantee
from spherekit.motion.assembly_modes import Solver
from spherekit.motion.complex_modes import meetings_of
from spherekit.numeric.crossings import MOST_CELLS, crossings
from spherekit.planning.assembly import plan_assembly
from spherekit.progress import Working
from spherekit.sphere.rotation import Floats

POINTLIKE = 1e-4
"""A doubtful part (rad) so short is not looked into: its sides are."""
SMOOTH = 4.0 * np.pi
"""Width (rad), over the number of modes, of parts in which their function is smooth."""
MOST_TIME = 40.0
"""Rough time (s) that the search for dead inputs may take."""
CHEAP = 2e-3
"""A pair whose functions of meeting modes take less than this (s) is good enough."""


@final
@dataclass(frozen=True)
class InputTurningPoints:
    """The inputs from `low` to `high` (rad) at which two real modes meet.

    `places` (k,) rise. In the parts `doubtful` (d, 2) some may be missing: in all of the
    range if the modes have no analytic function here.
    """

    low: float
    high: float
    places: Floats
    doubtful: Floats

    def has(self, q: float, tolerance: float) -> bool:
        """Return whether modes may meet at an input q, or whether it is out of range."""
        within = (self.doubtful[:, 0] <= q) & (q <= self.doubtful[:, 1])
        beyond = not self.low + tolerance < q < self.high - tolerance
        meets = np.any(np.abs(self.places - q) < tolerance)
        return bool(beyond or meets or np.any(within))

    def gap(self, step: float) -> float:
        """Return the longest part (rad) without an input of `probes(step)`, 0 if none."""
        widths = np.diff(self.doubtful, axis=1)[:, 0]
        widths = widths[widths > 0.0]
        return float(np.max(widths / np.ceil(widths / step), initial=0.0))

    def probes(self, step: float) -> Floats:
        """Return inputs (n,): one between two neighbours, and more in doubtful parts.

        Those are at most `step` (rad) apart.
        """
        if self.low == self.high:
            return np.array([self.low])
        ends = [self.low, *self.places, *self.doubtful.ravel(), self.high]
        edges = np.unique(ends)
        middles = 0.5 * (edges[:-1] + edges[1:])
        inside = np.zeros(len(middles), dtype=bool)
        parts = []
        for start, stop in self.doubtful:
            inside |= (middles > start) & (middles < stop)
            count = int(np.ceil((stop - start) / step)) if stop - start > POINTLIKE else 0
            parts.append(start + (np.arange(count) + 0.5) / max(count, 1) * (stop - start))
        probes = np.sort(np.concatenate([middles[~inside], *parts]))
        # A range that is one short doubtful part has no sides to look at.
        return probes if len(probes) else np.array([0.5 * (self.low + self.high)])

    def claim(self, step: float) -> Claim:
        """Return what all modes at the inputs of `probes(step)` say of all others."""
        if self.low == self.high:
            return Claim(Guarantee.COMPLETE, "all modes at the only input")
        gap = self.gap(step)
        if not gap:
            count = len(self.places)
            words = f"between the {count} inputs of the range at which they meet"
            if count == 1:
                words = "on both sides of the only input of the range at which they meet"
            words = words if count else "which meet nowhere in the range"
            return Claim(Guarantee.COMPLETE, f"all modes, {words}")
        words = f"all modes at {counted(len(self.probes(step)), 'input')}"
        if len(self.places):
            words += f", and between {len(self.places)} at which they are known to meet"
        return Claim(Guarantee.TO_BOX, words, gap)


def input_turning_points(
    solver: Solver,
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
    most = int(np.clip(most_time / (36.0 * meetings.cost), 12, MOST_CELLS))
    working = Working("looking for the inputs at which modes meet")
    per_group = []
    for part in range(len(meetings.groups)):
        asked = [0]

        def function(q: Floats, part: int = part, asked: list[int] = asked) -> Floats:
            asked[0] += len(q)
            words = f"group {part + 1} of {len(meetings.groups)}, {asked[0]} inputs"
            working.tell(lambda: words)
            return meetings(part, q)

        smooth = SMOOTH / meetings.modes(part)
        per_group.append(crossings(function, low, high, most, smooth))
    places = np.sort(np.concatenate([part.places for part in per_group]))
    doubtful = np.concatenate([part.doubtful for part in per_group])
    return InputTurningPoints(low, high, places, doubtful[np.argsort(doubtful[:, 0])])


def easiest_drive(solver: Solver) -> Solver:
    """Return a mechanism driven where the inputs at which modes meet are found easily.

    It is the given one where they are found easily too, or at no other pair.
    """
    if any(not group.revolute or group.redundant for group in solver.assembly.groups):
        return solver
    as_driven = meetings_of(solver, CHEAP)
    if as_driven is not None and as_driven.cost < CHEAP:
        return solver
    others = []
    for pair in solver.mechanism.pairs:
        mechanism = solver.mechanism.with_inputs(pair.name)
        try:
            others.append(Solver(mechanism, plan_assembly(mechanism)))
        except PlanError:
            continue
    costs = [np.inf if as_driven is None else as_driven.cost]
    for other in others:
        meetings = meetings_of(other, CHEAP)
        costs.append(np.inf if meetings is None else meetings.cost)
    if np.min(costs) < np.inf:
        return (solver, *others)[int(np.argmin(costs))]
    return next((way for way in (solver, *others) if meetings_of(way)), solver)
