"""A pointing output whose mechanism falls into dyads once one bar is taken out.

With the output pointing somewhere, its turn about that direction may be what keeps the
mechanism from falling into dyads. With the turn held too, one link with two pairs, a bar,
is too many; without it the rest is dyads. The bar's arc is then one equation in the turn,
f = p . q - cos(arc) for its two axes p and q, and each of its roots a configuration. The
derivative of f comes from the rates of the dyads, exactly.
"""

from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from spherekit.errors import CountError
from spherekit.model.joints import revolutes
from spherekit.motion.assembly_modes import Solver
from spherekit.numeric.brackets import bracketed_zeros
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
        return np.arctan2(y, x)

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
        outer = (np.broadcast_to(axis, (3, n)).T for axis in self._ends(placed, signs))
        inner = (self.dyads.axis_in(pair, self.bar) for pair in self.pairs)
        rotations[:, self.bar] = frame_toward(*outer) @ frame_toward(*inner).T
        return rotations

    def _ends(self, placed: Placed, signs: Signs) -> tuple[Floats, Floats]:
        """Return the axes of the bar, as the links that it joins have them."""
        (first, second), (one, other) = self.pairs, self.links
        return placed.axis(first, one, signs), placed.axis(second, other, signs)

    def gap(self, placed: Placed, signs: Signs) -> Floats:
        """Return f (n,)."""
        return dot(*self._ends(placed, signs)) - self.cosine

    def rate(self, placed: Placed, signs: Signs) -> Fraction:
        """Return the rate of f per unit rate of the output."""
        (first, second), (one, other) = self.pairs, self.links
        normal = cross(*self._ends(placed, signs))
        return difference(
            placed.along(normal, one, first, signs),
            placed.along(normal, other, second, signs),
        )

    def close(
        self, directions: Floats, turn: Floats, signs: Signs
    ) -> tuple[Floats, NDArray[np.bool_]]:
        """Return turns (n,) that close the bar, by Newton's method, and which converged."""
        turn = turn.copy()
        active = np.arange(len(turn))
        converged = np.zeros(len(turn), dtype=bool)
        for _ in range(STEPS):
            some, at = directions[:, active], turn[active]
            placed = self.place(some, at)
            gap, rate = self.gap(placed, signs), self.rate(placed, signs)
            step = -gap * rate.bottom / dot(rate.top, some)
            size, closed = np.abs(step), np.abs(gap) < CLOSED
            step *= LONGEST / np.maximum(size, LONGEST)
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
        row, low, high, at_low, at_high = self._brackets(directions, signs)

        def gap(turn: Floats, some: NDArray[np.intp]) -> Floats:
            return self.gap(self.place(directions[:, row[some]], turn), signs)

        turns, _ = bracketed_zeros(gap, low, high, at_low, at_high)
        held = np.abs(gap(turns, np.arange(len(row)))) < CLOSED
        row, turns = row[held], wrap(turns[held])
        order = np.lexsort((turns, row))
        row, turns = row[order], turns[order]
        new = np.ones(len(row), dtype=bool)
        new[1:] = (row[1:] != row[:-1]) | (np.diff(turns) > SAME_TURN)
        row, turns = row[new], turns[new]
        return row, turns, self.sense(directions[:, row], turns, signs)

    def _brackets(self, directions: Floats, signs: Signs) -> list[NDArray[Any]]:
        """Return rows, two turns with a root of f between, and f at these."""
        n = directions.shape[1]
        spacing = 2 * np.pi / SAMPLES
        samples = np.linspace(-np.pi, np.pi, SAMPLES, endpoint=False)
        rows, turns = np.repeat(np.arange(n), SAMPLES), np.tile(samples, n)
        placed = self.place(directions[:, rows], turns)
        gap = self.gap(placed, signs).reshape(n, SAMPLES)
        slope = self.slope(placed, directions[:, rows], signs).reshape(n, SAMPLES)
        after, tilt = np.roll(gap, -1, axis=1), np.roll(slope, -1, axis=1)
        both = np.isfinite(gap) & np.isfinite(after)
        turns_back = both & ((gap <= 0.0) == (after <= 0.0))
        turns_back &= (gap * slope < 0.0) & (after * tilt > 0.0)
        parts: list[list[NDArray[Any]]] = []

        def keep(
            row: NDArray[np.intp], one: Floats, value: Floats, other: Floats, last: Floats
        ) -> None:
            crossed = (value >= 0.0) != (last >= 0.0)
            parts.append([part[crossed] for part in (row, one, other, value, last)])

        row, column = np.nonzero(both & ~turns_back)
        start = samples[column]
        keep(row, start, gap[row, column], start + spacing, after[row, column])
        row, column = np.nonzero(turns_back)
        start, tilted = samples[column], slope[row, column]
        last = self._last(directions[:, row], start, spacing, signs, tilted)
        keep(row, start, gap[row, column], *last)
        keep(row, *last, start + spacing, after[row, column])
        for shift in (-1, 1):
            beyond = np.roll(gap, shift, axis=1)
            row, column = np.nonzero(np.isfinite(gap) & ~np.isfinite(beyond))
            start = samples[column]
            last = self._last(directions[:, row], start, -shift * spacing, signs)
            keep(row, start, gap[row, column], *last)
        return [np.concatenate(part) for part in zip(*parts, strict=True)]

    def slope(self, placed: Placed, directions: Floats, signs: Signs) -> Floats:
        """Return the derivative of f (n,) by the turn."""
        rate = self.rate(placed, signs)
        return dot(rate.top, directions) / rate.bottom

    def sense(self, directions: Floats, turn: Floats, signs: Signs) -> Floats:
        """Return +1 or -1 (n,): whether f grows or falls with the turn."""
        slope = self.slope(self.place(directions, turn), directions, signs)
        return np.where(slope < 0.0, -1.0, 1.0)

    def _last(
        self,
        directions: Floats,
        turn: Floats,
        way: float,
        signs: Signs,
        slope: Floats | None = None,
    ) -> tuple[Floats, Floats]:
        """Return the last turns (n,) like the first ones on the way, and f there.

        Alike in that all dyads are in reach, or, given its slope, in the sign of that.
        """

        def unlike(at: Floats, some: NDArray[np.intp]) -> Floats:
            placed = self.place(directions[:, some], at)
            good = np.isfinite(self.gap(placed, signs))
            if slope is not None:
                sense = self.slope(placed, directions[:, some], signs) * slope[some]
                good &= sense > 0.0
            return np.where(good, -1.0, 1.0)

        one = np.ones(len(turn))
        _, last = bracketed_zeros(unlike, turn, turn + way, -one, one)
        return last, self.gap(self.place(directions, last), signs)


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
