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
from spherekit.model.joints import revolutes
from spherekit.motion.assembly_modes import Solver
from spherekit.motion.closure import newton
from spherekit.numeric.crossings import bracketed_zeros, wrap
from spherekit.output.dyads import Dyads, Signs
from spherekit.output.posed_mode import Fraction, PosedMode
from spherekit.output.virtual_output import VirtualOutputChain
from spherekit.planning.inputs import Assembly, merged, split
from spherekit.rates.request import cross, dot
from spherekit.sphere.rotation import frame_from, frame_toward, perpendicular

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
    its arc. `across` (2, 3) with the output's direction are the rows of a rotation: the
    first turn about the direction is measured from them.
    """

    dyads: Dyads
    assembly: Assembly
    bar: int
    pairs: tuple[int, ...]
    links: tuple[int, ...]
    cosine: float
    across: Floats
    direction: Floats

    def place(self, directions: Floats, turn: Floats, signs: Signs) -> PosedMode:
        """Return the dyads with the output pointing in directions (3, n) at turns (n,)."""
        one, other = _around(directions)
        c, s = np.cos(turn), np.sin(turn)
        x, y = one * c + other * s, other * c - one * s
        columns = (
            x * self.across[0][:, None, None]
            + y * self.across[1][:, None, None]
            + directions * self.direction[:, None, None]
        )
        return PosedMode(self.dyads, signs, {}, columns)

    def turn_of(self, directions: Floats, rotations: Floats) -> Floats:
        """Return the turns (n,) nearest to orientations (n, 3, 3) of the output link."""
        first, second = (rotations @ self.across.T).T
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

        turns, _ = bracketed_zeros(gap, *ends)
        held = np.abs(gap(turns, np.arange(len(row)))) < CLOSED
        row, turns = row[held], wrap(turns[held])
        order = np.lexsort((turns, row))
        row, turns = row[order], turns[order]
        new = np.ones(len(row), dtype=bool)
        new[1:] = (row[1:] != row[:-1]) | (np.diff(turns) > SAME_TURN)
        row, turns = row[new], turns[new]
        slope = self.slope(self.place(directions[:, row], turns, signs), directions[:, row])
        return row, turns, np.where(slope < 0.0, -1.0, 1.0)

    def _brackets(self, directions: Floats, signs: Signs) -> list[Array]:
        """Return rows, two turns with a root of f between, and f at these."""
        n, spacing = directions.shape[1], 2.0 * np.pi / SAMPLES
        row = np.repeat(np.arange(n), SAMPLES + 1)
        turn = np.tile(np.linspace(-np.pi, np.pi, SAMPLES + 1), n)
        placed = self.place(directions[:, row], turn, signs)
        gap, tilt = self.gap(placed), self.slope(placed, directions[:, row])
        turns_back = ((gap[:-1] <= 0.0) == (gap[1:] <= 0.0)) & (gap[:-1] * tilt[:-1] < 0.0)
        turns_back &= gap[1:] * tilt[1:] > 0.0
        reached = np.isfinite(gap)
        odd = turns_back | (reached[:-1] != reached[1:])
        odd = np.flatnonzero(odd & (row[:-1] == row[1:]))
        start, some = turn[odd + ~reached[odd]], directions[:, row[odd]]
        alike = np.where(turns_back, tilt[:-1], np.nan)[odd]

        def unlike(at: Floats, which: Indices) -> Floats:
            """Return -1 where all dyads are in reach and f goes on as at the start."""
            placed = self.place(some[:, which], at, signs)
            turned = self.slope(placed, some[:, which]) * alike[which] <= 0.0
            return np.where(np.isfinite(self.gap(placed)) & ~turned, -1.0, 1.0)

        one, way = np.ones(len(odd)), np.where(reached[odd], spacing, -spacing)
        _, last = bracketed_zeros(unlike, start, start + way, -one, one)
        row, turn = np.insert(row, odd + 1, row[odd]), np.insert(turn, odd + 1, last)
        gap = np.insert(gap, odd + 1, self.gap(self.place(some, last, signs)))
        crossed = (gap[:-1] >= 0.0) != (gap[1:] >= 0.0)
        crossed &= np.isfinite(gap[:-1] + gap[1:]) & (row[:-1] == row[1:])
        at = np.flatnonzero(crossed)
        return [row[at], turn[at], turn[at + 1], gap[at], gap[at + 1]]


def turned(wrist: VirtualOutputChain, solver: Solver) -> DyadsWithClosingLink | None:
    """Return the dyads and the bar of a pointing output, None if there are none.

    Of several bars, the one that leaves dyads which depend least on each other.
    """
    made, output = wrist.mechanism, wrist.output
    joints = revolutes(solver.joints)
    if not wrist.points or output.direction is None or len(joints) < len(made.pairs):
        return None
    held, bodies = (*wrist.pairs,), merged(made, wrist.pairs)
    direction = np.array(output.direction)
    across = frame_from(direction, perpendicular(direction)).T[:2]
    candidates = []
    for bar in range(len(made.links)):
        pairs = tuple(k for k, ends in enumerate(made.ends) if bar in ends)
        if len(pairs) != 2 or {*pairs} & {*held, *wrist.driven} or bar == wrist.base:
            continue
        rest = [k for k in range(len(made.pairs)) if k not in (*held, *pairs)]
        try:
            assembly = Assembly(held, bodies, split(made, bodies, rest))
        except CountError:
            continue
        if Dyads.fit(assembly, wrist.base):
            dyads = Dyads(made, joints, assembly, wrist.base, wrist.link)
            links = tuple(sum(made.ends[pair]) - bar for pair in pairs)
            cosine = float(np.dot(*(dyads.axis_in(pair, bar) for pair in pairs)))
            candidates.append(
                DyadsWithClosingLink(
                    dyads, assembly, bar, pairs, links, cosine, across, direction
                )
            )

    def dependence(turned: DyadsWithClosingLink) -> int:
        feet = (link for stand in turned.dyads.stands for link in (stand.foot, stand.hold))
        return sum(map(turned.dyads.placed_by.__contains__, feet))

    return min(candidates, key=dependence, default=None)


def _around(directions: Floats) -> tuple[Floats, Floats]:
    """Return two unit vectors (3, n) that make a right-handed frame with directions."""
    one = perpendicular(directions.T).T
    return one, cross(directions, one)
