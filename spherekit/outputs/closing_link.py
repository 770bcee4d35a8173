"""A pointing output whose mechanism falls into dyads once one bar is taken out.

With the output pointing somewhere, its turn about that direction may be what keeps the
mechanism from falling into dyads. With the turn held too, one link with two pairs, a bar,
is too many; without it the rest is dyads. The bar's arc is then one equation in the turn,
f = p . q - cos(arc) for its two axes p and q, and each of its roots a configuration. The
derivative of f comes from the rates of the dyads, exactly.
"""

from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Array, Floats, Indices
from spherekit.errors import CountError
from spherekit.geometry.triangle import frame_from, frame_toward, perpendicular
from spherekit.mechanism.joint import revolutes
from spherekit.numerics.angles import wrap
from spherekit.numerics.bracketed_zeros import find_bracketed_zeros
from spherekit.outputs.dyad_chain import Dyads, Signs
from spherekit.outputs.virtual_output import VirtualOutputChain
from spherekit.outputs.working_mode import Fraction, PosedMode
from spherekit.planning.assembly_plan import Assembly, split_into_groups
from spherekit.planning.mobility import merge_locked_links
from spherekit.positions.loop_closure import newton
from spherekit.positions.position_solver import PositionSolver
from spherekit.velocities.direction_signs import dot
from spherekit.velocities.pole_request import cross

SAMPLES = 120
"""Turns at which the bar's equation is looked at for changes of its sign."""
STEPS = 12
"""Newton's steps from a start."""
LONGEST = 0.3
"""Longest step of Newton's method (rad)."""
CONVERGED = 1e-11
"""A last step below this (rad) has converged: the next one is below rounding."""
CLOSED = 1e-7
"""f at a root is less: at the end of a dyad's reach its slope has no end, and a step from
there none either."""
SAME_TURN = 1e-7
"""Roots nearer to each other (rad) are one."""


@dataclass(frozen=True)
class DyadsWithClosingLink:
    """A pointing mechanism of dyads and one bar.

    `pairs` are those of the link `bar`, `links` the links that it joins, `cosine` that of
    its arc. `frame` (3, 3) has two axes that the turn is measured from, and the output's
    direction, as rows.
    """

    dyads: Dyads
    assembly: Assembly
    bar: int
    pairs: tuple[int, ...]
    links: tuple[int, ...]
    cosine: float
    frame: Floats

    def place(self, directions: Floats, turn: Floats, signs: Signs) -> PosedMode:
        """Return the dyads with the output pointing in directions (3, n) at turns (n,)."""
        one, other = _around(directions)
        c = np.cos(turn)
        s = np.sin(turn)
        axes = [one * c + other * s, other * c - one * s, directions]
        columns = np.einsum("ai,ajn->ijn", self.frame, axes)
        return PosedMode(self.dyads, signs, {}, columns)

    def turn_of(self, directions: Floats, rotations: Floats) -> Floats:
        """Return the turns (n,) nearest to orientations (n, 3, 3) of the output link."""
        first, second = (rotations @ self.frame[:2].T).T
        one, other = _around(directions)
        sine = dot(other, first) - dot(one, second)
        return np.arctan2(sine, dot(one, first) + dot(other, second))

    def links_of(self, placed: PosedMode, count: int) -> Floats:
        """Return the orientations (n, count, 3, 3) of all links but the virtual ones."""
        assert placed.given_rotation is not None
        n = placed.given_rotation.shape[-1]
        rotations = np.empty((n, count, 3, 3))
        for link in range(count):
            if link == self.bar:
                continue
            for k, vector in enumerate(np.eye(3)):
                rotations[:, link, :, k] = placed.vector(link, vector).T
        outer = (np.broadcast_to(axis, (3, n)).T for axis in self._ends(placed))
        inner = (self.dyads.axis_in(pair, self.bar) for pair in self.pairs)
        rotations[:, self.bar] = frame_toward(*outer) @ frame_toward(*inner).T
        return rotations

    def _ends(self, placed: PosedMode) -> list[Floats]:
        """Return the axes of the bar, as the links that it joins have them."""
        return list(map(placed.axis, self.pairs, self.links))

    def gap(self, placed: PosedMode) -> Floats:
        """Return f (n,)."""
        return dot(*self._ends(placed)) - self.cosine

    def rate(self, placed: PosedMode) -> Fraction:
        """Return the rate of f per unit rate of the output."""
        normal = cross(*self._ends(placed))
        one, other = map(placed.along, (normal, normal), self.links, self.pairs)
        return one - other

    def slope(self, placed: PosedMode, directions: Floats) -> Floats:
        """Return the derivative of f (n,) by the turn."""
        rate = self.rate(placed)
        return dot(rate.top, directions) / rate.bottom

    def close(self, directions: Floats, turn: Floats, signs: Signs) -> Floats:
        """Return turns (n,) that close the bar, by Newton's method."""

        def change(at: Floats, rows: Indices) -> Floats:
            placed = self.place(directions[:, rows], at[:, 0], signs)
            step = -self.gap(placed) / self.slope(placed, directions[:, rows])
            return np.where(np.isfinite(step), step, 0.0)[:, None]

        values, _ = newton(change, turn[:, None], STEPS, CONVERGED, LONGEST)
        return values[:, 0]

    def roots(self, directions: Floats, signs: Signs) -> tuple[Indices, Floats, Floats]:
        """Return every turn found at directions (3, n): rows, turns, senses of f.

        Looked for where f changes its sign between equally spaced samples, between one
        of them and the turn beside it at which a dyad gets out of reach, and between them
        and an extremum of f.
        """
        row, *ends = self._brackets(directions, signs)

        def gap(turn: Floats, some: Indices) -> Floats:
            return self.gap(self.place(directions[:, row[some]], turn, signs))

        turns, _ = find_bracketed_zeros(gap, *ends)
        held = np.abs(gap(turns, np.arange(len(row)))) < CLOSED
        row = row[held]
        turns = wrap(turns[held])
        order = np.lexsort((turns, row))
        row = row[order]
        turns = turns[order]
        new = np.diff(row, prepend=-1) > 0
        new |= np.diff(turns, prepend=0.0) > SAME_TURN
        row = row[new]
        turns = turns[new]
        slope = self.slope(self.place(directions[:, row], turns, signs), directions[:, row])
        return row, turns, np.where(slope < 0.0, -1.0, 1.0)

    def _brackets(self, directions: Floats, signs: Signs) -> list[Array]:
        """Return rows, two turns with a root of f between, and f at these."""
        n = directions.shape[1]
        spacing = 2.0 * np.pi / SAMPLES
        row = np.repeat(np.arange(n), SAMPLES + 1)
        turn = np.tile(np.linspace(-np.pi, np.pi, SAMPLES + 1), n)
        placed = self.place(directions[:, row], turn, signs)
        gap = self.gap(placed)
        tilt = self.slope(placed, directions[:, row])
        rising = gap * tilt
        turns_back = ~np.diff(gap <= 0.0) & (rising[:-1] < 0.0) & (rising[1:] > 0.0)
        reached = np.isfinite(gap)
        odd = np.flatnonzero((turns_back | np.diff(reached)) & (np.diff(row) == 0))
        start = turn[odd + ~reached[odd]]
        some = directions[:, row[odd]]
        alike = np.where(turns_back, tilt[:-1], np.nan)[odd]

        def unlike(at: Floats, which: Indices) -> Floats:
            """Return -1 where all dyads are in reach and f goes on as at the start."""
            placed = self.place(some[:, which], at, signs)
            turned = self.slope(placed, some[:, which]) * alike[which] <= 0.0
            return np.where(np.isfinite(self.gap(placed)) & ~turned, -1.0, 1.0)

        one = np.ones(len(odd))
        way = np.where(reached[odd], spacing, -spacing)
        _, last = find_bracketed_zeros(unlike, start, start + way, -one, one)
        row = np.insert(row, odd + 1, row[odd])
        turn = np.insert(turn, odd + 1, last)
        gap = np.insert(gap, odd + 1, self.gap(self.place(some, last, signs)))
        crossed = np.diff(gap >= 0.0) & np.isfinite(gap[:-1] + gap[1:])
        at = np.flatnonzero(crossed & (np.diff(row) == 0))
        return [row[at], turn[at], turn[at + 1], gap[at], gap[at + 1]]


def turned(
    wrist: VirtualOutputChain, solver: PositionSolver
) -> DyadsWithClosingLink | None:
    """Return the dyads and the bar of a pointing output, None if there are none.

    Of several bars, the one that leaves dyads which depend least on each other.
    """
    made = wrist.mechanism
    direction = wrist.output.direction
    joints = revolutes(solver.joints)
    if not wrist.points or direction is None or len(joints) < len(made.pairs):
        return None
    held = wrist.pairs
    bodies = merge_locked_links(made, held)
    axis = np.array(direction)
    frame = frame_from(axis, perpendicular(axis)).T
    candidates = []
    for bar in range(len(made.links)):
        pairs = tuple(k for k, ends in enumerate(made.ends) if bar in ends)
        if len(pairs) != 2 or {*pairs} & {*held, *wrist.driven} or bar == wrist.base:
            continue
        rest = [k for k in range(len(made.pairs)) if k not in (*held, *pairs)]
        try:
            assembly = Assembly(held, bodies, split_into_groups(made, bodies, rest))
        except CountError:
            continue
        if Dyads.fit(assembly, wrist.base):
            dyads = Dyads(made, joints, assembly, wrist.base, wrist.link)
            links = tuple(sum(made.ends[pair]) - bar for pair in pairs)
            cosine = float(np.dot(*(dyads.axis_in(pair, bar) for pair in pairs)))
            candidates.append(
                DyadsWithClosingLink(dyads, assembly, bar, pairs, links, cosine, frame)
            )

    def dependence(turned: DyadsWithClosingLink) -> int:
        feet = (link for stand in turned.dyads.stands for link in (stand.foot, stand.hold))
        return sum(map(turned.dyads.placed_by.__contains__, feet))

    return min(candidates, key=dependence, default=None)


def _around(directions: Floats) -> tuple[Floats, Floats]:
    """Return two unit vectors (3, n) that make a right-handed frame with directions."""
    one = perpendicular(directions.T).T
    return one, cross(directions, one)
