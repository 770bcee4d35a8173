"""A pointing output whose mechanism falls into dyads once one bar is taken out.

With the output pointing somewhere, its turn about that direction may be what keeps the
mechanism from falling into dyads. With the turn held too, one link with two pairs, a bar,
is too many; without it the rest is dyads. The bar's arc is then one equation in the turn,
f = p . q - cos(arc) for its two axes p and q, and each of its roots a configuration. The
derivative of f comes from the rates of the dyads, exactly.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.errors import CountError
from spherekit.model.joints import revolutes
from spherekit.motion.assembly_modes import Solver
from spherekit.numeric.turns import wrap
from spherekit.output.dyads import Dyads, Signs
from spherekit.output.placed import Fraction, Placed, difference
from spherekit.output.virtual_output import VirtualOutputChain
from spherekit.planning.assembly import Assembly, split
from spherekit.planning.inputs import merged
from spherekit.rates.vectors import cross, dot
from spherekit.sphere.rotation import Floats, frame_from, frame_toward, perpendicular

SAMPLES = 120
"""Turns at which the bar's equation is looked at for changes of its sign."""
STEPS, MOST_STEPS, HALVINGS = 12, 60, 44
"""Steps from a start, within a bracket, and towards the end of a dyad's reach."""
LONGEST = 0.3
"""Longest step of Newton's method (rad)."""
CONVERGED = 1e-11
"""A last step below this (rad) has converged: the next one is below rounding."""
CLOSED = 1e-7
"""f at a root is less: at the end of a dyad's reach its slope has no end, and a step from
there none either."""
SAME_TURN = 1e-7
"""Roots nearer to each other (rad) are one."""


@final
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
    pairs: tuple[int, int]
    links: tuple[int, int]
    cosine: float
    across: Floats
    direction: Floats

    @property
    def depth(self) -> int:
        """How many dyads the dyads depend on, counted over all: the fewer the better."""
        return sum(len(groups) for groups in self.dyads.needs)

    def place(self, directions: Floats, turn: Floats) -> Placed:
        """Return the dyads with the output pointing in directions (3, n) at turns (n,)."""
        one, other = _around(directions)
        c, s = np.cos(turn), np.sin(turn)
        x, y = one * c + other * s, other * c - one * s
        columns = (
            x * self.across[0][:, None, None]
            + y * self.across[1][:, None, None]
            + directions * self.direction[:, None, None]
        )
        return Placed(self.dyads, {}, columns)

    def turn_of(self, directions: Floats, rotations: Floats) -> Floats:
        """Return the turns (n,) nearest to orientations (n, 3, 3) of the output link."""
        first, second = np.swapaxes(rotations @ self.across.T, 0, 1).transpose(2, 0, 1)
        one, other = _around(directions)
        x = dot(one, first) + dot(other, second)
        y = dot(other, first) - dot(one, second)
        return np.asarray(np.arctan2(y, x))

    def links_of(self, placed: Placed, signs: Signs, count: int) -> Floats:
        """Return the orientations (n, count, 3, 3) of all links but the virtual ones."""
        assert placed.given_rotation is not None
        n = placed.given_rotation.shape[-1]
        rotations = np.empty((n, count, 3, 3))
        for link in range(count):
            if link == self.bar:
                continue
            for k, vector in enumerate(np.eye(3)):
                seen = placed.vector(vector, link, signs, ("frame", k))
                rotations[:, link, :, k] = seen.T
        (first, second), (one, other) = self.pairs, self.links
        outer = (
            np.broadcast_to(placed.axis(pair, link, signs), (3, n)).T
            for pair, link in ((first, one), (second, other))
        )
        inner = (self.dyads.axis_in(pair, self.bar) for pair in self.pairs)
        rotations[:, self.bar] = frame_toward(*outer) @ frame_toward(*inner).T
        return rotations

    def gap(self, placed: Placed, signs: Signs) -> Floats:
        """Return f (n,)."""
        (first, second), (one, other) = self.pairs, self.links
        p, q = placed.axis(first, one, signs), placed.axis(second, other, signs)
        return dot(p, q) - self.cosine

    def rate(self, placed: Placed, signs: Signs) -> Fraction:
        """Return the rate of f per unit rate of the output."""
        (first, second), (one, other) = self.pairs, self.links
        p, q = placed.axis(first, one, signs), placed.axis(second, other, signs)
        normal = cross(p, q)
        return difference(
            placed.along(normal, one, first, signs),
            placed.along(normal, other, second, signs),
        )

    def close(
        self,
        directions: Floats,
        turn: Floats,
        signs: Signs,
        bracket: tuple[Floats, Floats] | None = None,
    ) -> tuple[Floats, NDArray[np.bool_]]:
        """Return turns (n,) that close the bar, and which of them converged.

        Newton's method from `turn`, with steps halving the `bracket` where it leaves it:
        two turns (n,), f negative or zero at the first and positive at the second.
        """
        turn = turn.copy()
        active = np.arange(len(turn))
        converged = np.zeros(len(turn), dtype=bool)
        low, high = bracket or (np.full(len(turn), -np.inf), np.full(len(turn), np.inf))
        low, high = low.copy(), high.copy()
        for _ in range(STEPS if bracket is None else MOST_STEPS):
            some, at = directions[:, active], turn[active]
            placed = self.place(some, at)
            gap, rate = self.gap(placed, signs), self.rate(placed, signs)
            step = -gap * rate.bottom / dot(rate.top, some)
            size, closed = np.abs(step), np.abs(gap) < CLOSED
            if bracket is None:
                step *= LONGEST / np.maximum(size, LONGEST)
            else:
                low[active] = np.where(gap <= 0.0, at, low[active])
                high[active] = np.where(gap > 0.0, at, high[active])
                way = at + step - low[active], at + step - high[active]
                outside = ~(way[0] * way[1] <= 0.0) | ((size < CONVERGED) & ~closed)
                middle = 0.5 * (low[active] + high[active])
                step = np.where(outside, middle - at, step)
                size = np.abs(step)
            turn[active] = np.where(np.isfinite(step), at + step, at)
            converged[active] = (size < CONVERGED) & closed
            active = active[size >= CONVERGED]
            if not len(active):
                break
        return turn, converged

    def roots(
        self, directions: Floats, signs: Signs
    ) -> tuple[NDArray[np.intp], Floats, Floats]:
        """Return every turn found at directions (3, n): rows, turns, senses of f.

        Looked for where f changes its sign between equally spaced samples, between one
        of them and the turn beside it at which a dyad gets out of reach, and between them
        and an extremum of f.
        """
        row, low, high = self._brackets(directions, signs)
        turns, held = self.close(directions[:, row], low, signs, (low, high))
        row, turns = row[held], wrap(turns[held])
        order = np.lexsort((turns, row))
        row, turns = row[order], turns[order]
        new = np.ones(len(row), dtype=bool)
        new[1:] = (row[1:] != row[:-1]) | (np.diff(turns) > SAME_TURN)
        row, turns = row[new], turns[new]
        return row, turns, self.sense(directions[:, row], turns, signs)

    def _brackets(
        self, directions: Floats, signs: Signs
    ) -> tuple[NDArray[np.intp], Floats, Floats]:
        """Return rows, and turns with f negative or zero and positive, a root between."""
        n = directions.shape[1]
        spacing = 2 * np.pi / SAMPLES
        samples = np.arange(SAMPLES) * spacing - np.pi
        rows, turns = np.repeat(np.arange(n), SAMPLES), np.tile(samples, n)
        placed = self.place(directions[:, rows], turns)
        gap = self.gap(placed, signs).reshape(n, SAMPLES)
        slope = self.slope(placed, directions[:, rows], signs).reshape(n, SAMPLES)
        parts: list[tuple[NDArray[np.intp], Floats, Floats]] = []

        def keep(row: NDArray[np.intp], *places: tuple[Floats, Floats]) -> None:
            for (one, value), (other, last) in pairwise(places):
                crossed = (value <= 0.0) != (last <= 0.0)
                rising = value <= 0.0
                low, high = np.where(rising, one, other), np.where(rising, other, one)
                parts.append((row[crossed], low[crossed], high[crossed]))

        edges = [
            np.nonzero(np.isfinite(gap) & ~np.isfinite(np.roll(gap, shift, axis=1)))
            for shift in (-1, 1)
        ]
        row, column = (np.concatenate([edge[k] for edge in edges]) for k in (0, 1))
        way = np.repeat([spacing, -spacing], [len(edge[0]) for edge in edges])
        start = np.asarray(samples[column])
        last = self._halved(directions[:, row], start, way, signs, None)
        keep(row, (start, gap[row, column]), last)
        after, tilt = np.roll(gap, -1, axis=1), np.roll(slope, -1, axis=1)
        both = np.isfinite(gap) & np.isfinite(after)
        turns_back = both & ((gap <= 0.0) == (after <= 0.0))
        turns_back &= (gap * slope < 0.0) & (after * tilt > 0.0)
        for chosen in (turns_back, both & ~turns_back):
            row, column = np.nonzero(chosen)
            start = np.asarray(samples[column])
            first = start, np.asarray(gap[row, column])
            end = start + spacing, np.asarray(after[row, column])
            if chosen is turns_back:
                tilted = np.asarray(slope[row, column])
                middle = self._halved(directions[:, row], start, spacing, signs, tilted)
                keep(row, first, middle, end)
            else:
                keep(row, first, end)
        row, low, high = (np.concatenate([part[k] for part in parts]) for k in range(3))
        return row, low, high

    def slope(self, placed: Placed, directions: Floats, signs: Signs) -> Floats:
        """Return the derivative of f (n,) by the turn."""
        rate = self.rate(placed, signs)
        return np.asarray(dot(rate.top, directions) / rate.bottom)

    def sense(self, directions: Floats, turn: Floats, signs: Signs) -> Floats:
        """Return +1 or -1 (n,): whether f grows or falls with the turn."""
        slope = self.slope(self.place(directions, turn), directions, signs)
        return np.where(slope < 0.0, -1.0, 1.0)

    def _halved(
        self,
        directions: Floats,
        turn: Floats,
        way: float | Floats,
        signs: Signs,
        slope: Floats | None,
    ) -> tuple[Floats, Floats]:
        """Return the last turns (n,) like the first ones on the way, and f there.

        Alike in that all dyads are in reach, or, given its slope, in the sign of that.
        """
        inside, outside = turn.copy(), turn + way
        last = self.gap(self.place(directions, inside), signs)
        for _ in range(HALVINGS):
            middle = 0.5 * (inside + outside)
            placed = self.place(directions, middle)
            gap = self.gap(placed, signs)
            good = np.isfinite(gap)
            if slope is not None:
                good &= self.slope(placed, directions, signs) * slope > 0.0
            inside, outside = (
                np.where(good, middle, inside),
                np.where(good, outside, middle),
            )
            last = np.where(good, gap, last)
        return inside, last


def turned(wrist: VirtualOutputChain, solver: Solver) -> DyadsWithClosingLink | None:
    """Return the dyads and the bar of a pointing output, None if there are none.

    Of several bars, the one that leaves dyads which depend least on each other.
    """
    made, output = wrist.mechanism, wrist.output
    joints = revolutes(solver.joints)
    if not wrist.points or output.direction is None or len(joints) < len(made.pairs):
        return None
    held = (*wrist.pairs,)
    bodies = merged(made, held)
    best: DyadsWithClosingLink | None = None
    for bar in range(len(made.links)):
        pairs = [k for k, ends in enumerate(made.ends) if bar in ends]
        if len(pairs) != 2 or {*pairs} & {*held, *wrist.driven} or bar == wrist.base:
            continue
        rest = [k for k in range(len(made.pairs)) if k not in (*held, *pairs)]
        try:
            groups = split(made, bodies, rest)
        except CountError:
            continue
        assembly = Assembly(held, bodies, groups)
        if not Dyads.fit(assembly, wrist.base):
            continue
        dyads = Dyads(made, joints, assembly, wrist.base, [wrist.link])
        first, second = pairs
        direction = np.array(output.direction)
        frame = frame_from(direction, perpendicular(direction))
        candidate = DyadsWithClosingLink(
            dyads,
            assembly,
            bar,
            (first, second),
            (sum(made.ends[first]) - bar, sum(made.ends[second]) - bar),
            float(dyads.axis_in(first, bar) @ dyads.axis_in(second, bar)),
            frame.T[:2],
            direction,
        )
        if best is None or candidate.depth < best.depth:
            best = candidate
    return best


def _around(directions: Floats) -> tuple[Floats, Floats]:
    """Return two unit vectors (3, n) that make a right-handed frame with directions.

    They have a jump where the direction is -z only (T. Duff et al., Building an
    orthonormal basis, revisited, 2017).
    """
    x, y, z = directions
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    one = np.stack([1.0 + sign * x * x * a, sign * b, -sign * x])
    other = np.stack([b, sign + y * y * a, -y])
    return one, other
