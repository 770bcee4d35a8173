"""All complex assembly modes of a chain of groups, and where two of them meet.

With R pairs only, the modes of a group are the roots of an algebraic system, and real
ones can appear or vanish only where two roots meet. There the determinant of the group's
equations is zero for both. Its product over all complex modes of the group, and of the
groups before it, no longer depends on how modes are numbered: it is a real analytic
function of the input, and changes its sign exactly where two real modes meet.
"""

from dataclasses import dataclass
from typing import Protocol, final

import numpy as np

from spherekit.model.joints import revolute
from spherekit.motion.assembly_modes import Solver
from spherekit.motion.bars import bars_of, joined_by_three
from spherekit.motion.elimination import all_solutions, count_orders
from spherekit.motion.groups import group_closure
from spherekit.planning.assembly import Group
from spherekit.sphere.complex_rotation import (
    Complexes,
    at_arcs,
    dot,
    half_between,
    taking,
    triple,
)
from spherekit.sphere.quadrics import COMMON_POINTS, arc_quadric, common_points
from spherekit.sphere.rotation import Floats, from_quaternion

MOST_COMPLEX = 64
"""Complex modes of a mechanism up to which all of them are followed."""

MOST_ROOTS = 32
"""Complex modes of a group of seven bodies at most."""

TRIED = (0.3183, 1.7411, 2.9127, 4.0312, 5.3779)
"""Inputs (rad) in no special position at which groups are tried for what they see."""
ALIKE = 1e-9
"""Determinants that differ by less, over the largest, are the same in all modes."""


def _count(solver: Solver, number: int) -> int:
    """Return how many complex modes a train, dyad or triad has, 0 for other groups."""
    group = solver.assembly.groups[number]
    if number in solver.trains:
        return 1
    if group.is_dyad:
        return 2
    return COMMON_POINTS if _platform(group) is not None else 0


def _platform(group: Group) -> tuple[int, int] | None:
    """Return the two bodies that the three bars of a triad join, None if it is none."""
    if not group.revolute or len(group.bodies) != 5:
        return None
    return joined_by_three(bars_of(group))


class ModeCoalescence(Protocol):
    """The real analytic functions of an input whose sign changes where modes meet.

    There is one for each group.
    """

    @property
    def groups(self) -> tuple[Group, ...]:
        """The groups of the mechanism in solving order."""

    @property
    def cost(self) -> float:
        """About the time (s) that one value of all functions takes."""

    def modes(self, part: int) -> int:
        """Return the number of complex modes that the function of a group is made of."""

    def __call__(self, part: int, q: Floats) -> Floats:
        """Return the function (n,) of group `part` at inputs q (n,) rad.

        NaN where a complex mode is missing, infinite, or one of infinitely many.
        """


def meetings_of(solver: Solver, most_cost: float = np.inf) -> ModeCoalescence | None:
    """Return the functions of a mechanism with one input, None if they are not known.

    They are for chains of trains of wheels, dyads and triads, and for a single group of
    seven bodies.
    """
    groups = solver.assembly.groups
    if len(solver.driven) != 1:
        return None
    counts = [_count(solver, number) for number in range(len(groups))]
    if 0 not in counts and int(np.prod(counts)) <= MOST_COMPLEX:
        return _Chain(solver)
    if len(groups) == 1 and _Seven.cost <= most_cost and count_orders(groups[0]):
        return _Seven.of(solver)
    return None


@final
class _Seven:
    """The function of a single group of seven bodies."""

    cost = 1e-2

    def __init__(self, solver: Solver, which: int) -> None:
        self.solver, self.which = solver, which
        self.groups = solver.assembly.groups

    def modes(self, part: int) -> int:
        return MOST_ROOTS

    @staticmethod
    def of(solver: Solver) -> "_Seven | None":
        """Return it with an order of elimination that finds all modes, None without."""
        for which in range(count_orders(solver.assembly.groups[0])):
            made = _Seven(solver, which)
            if np.all(np.isfinite(made(0, np.array(TRIED)))):
                return made
        return None

    def __call__(self, part: int, q: Floats) -> Floats:
        """Return the function (n,) at inputs q (n,) rad, NaN where a mode is missing."""
        group, ends = self.groups[part], self.solver.mechanism.ends
        out = np.full(len(q), np.nan)
        near = None
        for row in np.argsort(q):
            state = self.solver.start(np.array([[q[row]]]))
            closure = group_closure(state, group, ends)
            solved = all_solutions(group, closure, self.which, near)
            if solved is not None:
                near = solved.angles
                out[row] = np.prod(solved.determinants).real
        return out


@final
class _Chain:
    """The functions of a chain of trains of wheels, dyads and triads.

    A group that stands beside earlier ones does not see their modes: those are no
    factors of its function, which would only be a power.
    """

    def __init__(self, solver: Solver) -> None:
        self.solver = solver
        self.groups = solver.assembly.groups
        self._counts = [_count(solver, number) for number in range(len(self.groups))]
        every = frozenset(range(len(self.groups)))
        self._seen = [every] * len(self.groups)
        self._seen = [self._dependence(part) for part in range(len(self.groups))]
        self.cost = sum(
            (5e-4 if group.loops > 1 else 1e-5)
            * float(np.prod([self._counts[earlier] for earlier in seen]))
            for group, seen in zip(self.groups, self._seen, strict=True)
        )

    def modes(self, part: int) -> int:
        counts = [self._counts[earlier] for earlier in self._seen[part] if earlier < part]
        return int(np.prod([*counts, self._counts[part]]))

    def __call__(self, part: int, q: Floats) -> Floats:
        """Return the function (n,) of group `part` at inputs q (n,) rad."""
        return np.asarray(np.prod(self._determinants(part, q), axis=1).real)

    def _determinants(self, part: int, q: Floats) -> Complexes:
        """Return the determinants (n, modes) of a group."""
        with np.errstate(all="ignore"):
            modes = _Modes.start(self.solver, q)
            for number, group in enumerate(self.groups[: part + 1]):
                if number in self.solver.trains:
                    modes = modes.with_train(self.solver, number, q)
                    determinants = np.ones((len(q), modes.within[0].shape[1]), complex)
                    continue
                modes, determinants = modes.grown(self.solver, group, number < part)
                if number < part and number not in self._seen[part]:
                    modes = modes.every(self._counts[number])
        return determinants

    def _dependence(self, part: int) -> frozenset[int]:
        """Return the earlier groups whose modes a group's determinants depend on."""
        determinants = self._determinants(part, np.array(TRIED))
        counts = self._counts[: part + 1]
        values = np.prod(determinants.reshape(len(TRIED), *counts), axis=-1)
        size = np.max(np.abs(values))
        return frozenset(
            earlier
            for earlier in range(part)
            if counts[earlier] > 1
            and not np.max(np.abs(np.diff(values, axis=1 + earlier))) < ALIKE * size
        )


@final
@dataclass(frozen=True)
class _Modes:
    """Orientations (n, modes, 3, 3) of links in their bodies, for all modes so far."""

    within: tuple[Complexes, ...]

    @staticmethod
    def start(solver: Solver, q: Floats) -> "_Modes":
        state = solver.start(q[:, None])
        links = range(len(solver.mechanism.links))
        return _Modes(tuple(state.within[k][:, None].astype(complex) for k in links))

    def with_train(self, solver: Solver, number: int, q: Floats) -> "_Modes":
        """Return the modes with a train of wheels placed, at inputs q (n,) rad."""
        train, within = solver.trains[number], list(self.within)
        contacts = solver.train_frames(train, solver.rolled_values(q[:, None]))
        frames = {
            pair: (first[:, None], second[:, None])
            for pair, (first, second) in contacts.items()
        }
        turns = train.turns(within, solver.mechanism.ends, solver.joints, frames)
        for turn, members in zip(turns, train.group.bodies, strict=True):
            for link in members:
                within[link] = turn @ within[link]
        return _Modes(tuple(within))

    def grown(
        self, solver: Solver, group: Group, placed: bool
    ) -> "tuple[_Modes, Complexes]":
        """Return the modes with a group placed, if wanted, and its determinants."""
        ends = solver.mechanism.ends
        axes = {}
        for number, bodies in enumerate(group.ends):
            joint = revolute(solver.joints[group.pairs[number]])
            links, frames = ends[group.pairs[number]], (joint.first, joint.second)
            for body, link, frame in zip(bodies, links, frames, strict=True):
                axes[number, body] = self.within[link] @ frame[:, 2]
        place = _dyad if group.is_dyad else _triad
        rotations, determinants = place(group, axes)
        if not placed:
            return self, determinants
        modes = determinants.shape[1] // self.within[0].shape[1]
        within = [np.repeat(turned, modes, axis=1) for turned in self.within]
        for body, members in enumerate(group.bodies):
            for link in members if body else ():
                within[link] = rotations[body] @ within[link]
        return _Modes(tuple(within)), determinants

    def every(self, step: int) -> "_Modes":
        """Return one of each `step` modes."""
        return _Modes(tuple(w[:, ::step] for w in self.within))


_Axes = dict[tuple[int, int], Complexes]
"""Axes (n, modes, 3) of pairs in bodies, by the places of both in the group."""


def _dyad(group: Group, axes: _Axes) -> tuple[dict[int, Complexes], Complexes]:
    """Return rotations (n, 2 modes, 3, 3) of the bodies of a dyad, and determinants."""
    near, middle, far = group.dyad_places
    first, second = axes[near, 0], axes[far, 0]
    at = at_arcs(
        first,
        second,
        half_between(axes[near, 1], axes[middle, 1]),
        half_between(axes[far, 2], axes[middle, 2]),
    )
    first, second, at = _flat(first, 2), _flat(second, 2), at.reshape(len(at), -1, 3)
    rotations = {
        1: taking(_flat(axes[near, 1], 2), _flat(axes[middle, 1], 2), first, at),
        2: taking(_flat(axes[far, 2], 2), _flat(axes[middle, 2], 2), second, at),
    }
    return rotations, triple(first, at, second)


def _triad(group: Group, axes: _Axes) -> tuple[dict[int, Complexes], Complexes]:
    """Return rotations (n, 8 modes, 3, 3) of the bodies of a triad, and determinants."""
    bars, two = bars_of(group), _platform(group)
    assert two is not None
    base, platform = two
    quadrics, links = [], []
    for bar in bars:
        at_base = bar.pairs[bar.bodies.index(base)]
        at_platform = bar.pairs[bar.bodies.index(platform)]
        inner = axes[at_base, bar.body], axes[at_platform, bar.body]
        outer = axes[at_base, base], axes[at_platform, platform]
        quadrics.append(arc_quadric(outer[0], outer[1], dot(*inner)))
        links.append((bar.body, inner, outer))
    quadric = np.stack(quadrics, axis=-3)
    n, modes = quadric.shape[:2]
    finite = np.all(np.isfinite(quadric.reshape(n * modes, -1)), axis=1)
    points = np.full((n * modes, COMMON_POINTS, 4), np.nan, dtype=complex)
    points[finite] = common_points(quadric.reshape(n * modes, 3, 4, 4)[finite])
    points = points.reshape(n, modes, COMMON_POINTS, 4)
    points = points / np.sqrt(np.sum(points * points, axis=-1, keepdims=True))
    gradients = np.einsum("nmkij,nmpj->nmpki", quadric, points)
    jacobian = np.concatenate([gradients, points[..., None, :]], axis=-2)
    determinants = np.linalg.det(jacobian).reshape(n, -1)
    turned = np.asarray(from_quaternion(points)).reshape(n, -1, 3, 3)
    rotations = {base: np.broadcast_to(np.eye(3, dtype=complex), turned.shape)}
    rotations[platform] = turned
    for body, inner, outer in links:
        first, second = _flat(outer[0], COMMON_POINTS), _flat(outer[1], COMMON_POINTS)
        there = (turned @ second[..., None])[..., 0]
        own_first, own_second = (_flat(axis, COMMON_POINTS) for axis in inner)
        rotations[body] = taking(own_first, own_second, first, there)
    back = np.swapaxes(rotations[0], -1, -2)
    return {body: back @ rotation for body, rotation in rotations.items()}, determinants


def _flat(axes: Complexes, modes: int) -> Complexes:
    """Return axes (n, m, 3) of each mode m repeated for all that grow from it."""
    return np.repeat(axes, modes, axis=1)
