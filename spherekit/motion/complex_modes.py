"""All complex assembly modes of a chain of groups, and where two of them meet.

With R pairs only, the modes of a group are the roots of an algebraic system, and real
ones can appear or vanish only where two roots meet. There the determinant of the group's
equations is zero for both. Its product over all complex modes of the group, and of the
groups before it, no longer depends on how modes are numbered: it is a real analytic
function of the input, and changes its sign exactly where two real modes meet.
"""

from collections.abc import Sequence
from typing import final

import numpy as np

from spherekit.model.joints import revolute
from spherekit.motion.assembly_modes import Solver
from spherekit.motion.elimination import Frames, Order, orders_of
from spherekit.motion.groups import train_turns
from spherekit.planning.assembly import Group
from spherekit.sphere.rotation import Floats
from spherekit.sphere.trigonometric import Complexes

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


def meetings_of(solver: Solver, most_cost: float = np.inf) -> "ModeCoalescence | None":
    """Return the functions of a mechanism with one input, None if they are not known.

    They are for chains of trains of wheels, dyads and triads, and for a single group of
    three loops, if a value of its function takes less than `most_cost` (s).
    """
    groups = solver.assembly.groups
    orders = [
        orders_of(group) if group.revolute and group.loops in COSTS else ()
        for number, group in enumerate(groups)
        if number not in solver.trains
    ]
    if len(solver.driven) != 1 or not all(orders):
        return None
    if np.prod([order[0].roots for order in orders]) > MOST_COMPLEX:
        return None
    most = max((len(order[0].bars) for order in orders), default=0)
    if most > MOST_LOOPS and (len(groups) > 1 or COSTS[most] > most_cost):
        return None
    return ModeCoalescence(solver)


@final
class ModeCoalescence:
    """The real analytic functions of an input whose sign changes where modes meet.

    There is one for each group, `groups` in solving order; `cost` is about the time (s)
    that one value of all functions takes. A group that stands beside earlier ones does not
    see their modes: those are no factors of its function, which would only be a power.
    """

    def __init__(self, solver: Solver) -> None:
        self.solver = solver
        self.groups = solver.assembly.groups
        every = frozenset(range(len(self.groups)))
        self._orders: list[Order | None] = []
        self._seen: list[frozenset[int]] = []
        for part, group in enumerate(self.groups):
            self._seen.append(every)
            tried: Sequence[Order | None] = (None,)
            if part not in solver.trains:
                tried = orders_of(group)
            self._orders.append(tried[0])
            for self._orders[part] in tried:
                determinants = self._determinants(part, np.array(TRIED))
                if np.all(np.isfinite(determinants)):
                    break
            self._seen[part] = self._dependence(part, determinants)
        self.cost = sum(
            COSTS.get(group.loops, COSTS[2])
            * float(np.prod([self._count(k) for k in seen]))
            for group, seen in zip(self.groups, self._seen, strict=True)
        )

    def _count(self, number: int) -> int:
        """Return how many complex modes a group has, a train of wheels one."""
        order = self._orders[number]
        return 1 if order is None else order.roots

    def modes(self, part: int) -> int:
        """Return the number of complex modes that the function of a group is made of."""
        counts = [self._count(earlier) for earlier in self._seen[part] if earlier < part]
        return int(np.prod([*counts, self._count(part)]))

    def __call__(self, part: int, q: Floats) -> Floats:
        """Return the function (n,) of group `part` at inputs q (n,) rad.

        NaN where a complex mode is missing, infinite, or one of infinitely many.
        """
        return np.asarray(np.prod(self._determinants(part, q), axis=1).real)

    def _determinants(self, part: int, q: Floats) -> Complexes:
        """Return the determinants (n, modes) of a group."""
        state = self.solver.start(q[:, None])
        links = range(len(self.solver.mechanism.links))
        # orientations (n, modes, 3, 3) of links in their bodies, for all modes so far
        within = [state.within[k][:, None].astype(complex) for k in links]
        determinants, ends = np.ones((len(q), 1), complex), self.solver.mechanism.ends
        every = self.solver.train_angles(q[:, None]) if self.solver.trains else {}
        angles = {pair: angle[:, None] for pair, angle in every.items()}
        with np.errstate(all="ignore"):
            for number, group in enumerate(self.groups[: part + 1]):
                order = self._orders[number]
                if order is None:
                    turns = train_turns(group, within, ends, self.solver.joints, angles)
                    for turn, members in zip(turns, group.bodies, strict=True):
                        for link in members:
                            within[link] = turn @ within[link]
                    determinants = np.ones((len(q), within[0].shape[1]), dtype=complex)
                    continue
                frames = self._frames(group, within)
                solutions, determinants = frames.solutions(order)
                determinants = determinants.reshape(len(q), -1)
                if number < part:
                    placed = frames.placed(order, solutions)
                    shape = len(q), -1, *placed.shape[2:]
                    placed, step = placed.reshape(shape), order.roots
                    within = [np.repeat(turned, step, axis=1) for turned in within]
                    for body, members in enumerate(group.bodies):
                        for link in members if body else ():
                            within[link] = placed[:, :, body] @ within[link]
                    if number not in self._seen[part]:
                        within = [turned[:, ::step] for turned in within]
        return determinants

    def _frames(self, group: Group, within: Sequence[Complexes]) -> Frames:
        """Return the pair frames of a group at all modes so far, one after another."""
        sides: list[list[Complexes]] = [[], []]
        for pair in group.pairs:
            joint = revolute(self.solver.joints[pair])
            links = self.solver.mechanism.ends[pair]
            for side, frame in enumerate((joint.first, joint.second)):
                sides[side].append(within[links[side]] @ frame)
        return Frames(group, np.array(sides).reshape(2, len(group.pairs), -1, 3, 3))

    def _dependence(self, part: int, determinants: Complexes) -> frozenset[int]:
        """Return the earlier groups whose modes a group's determinants (n, modes) see."""
        counts = [self._count(number) for number in range(part + 1)]
        values = np.prod(determinants.reshape(len(TRIED), *counts), axis=-1)
        size = np.max(np.abs(values))
        return frozenset(
            earlier
            for earlier in range(part)
            if counts[earlier] > 1
            and not np.max(np.abs(np.diff(values, axis=1 + earlier))) < ALIKE * size
        )
