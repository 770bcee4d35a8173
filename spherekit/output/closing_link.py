"""A pointing output whose mechanism falls into dyads once one bar is taken out.

With the output pointing somewhere, its turn about that direction may be what keeps the
mechanism from falling into dyads. With the turn held too, one link with two pairs, a bar,
is too many; without it the rest is dyads. The bar's arc is then one equation in the turn,
f = p . q - cos(arc) for its two axes p and q, and each of its roots a configuration. The
derivative of f comes from the rates of the dyads, exactly.

Dyads placed one after another on one body, as vectors of pair axes over many rows.

The middle axis of a dyad follows from the outer ones (`spherekit.sphere.dyad`). The rates
of its pairs follow from the triple product t of its axes, and with them how the inputs
move per unit rate of the output. Arrays are (3, n), components first.
"""

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field
from typing import Any, final

import numpy as np

from spherekit.arrays import Array, Bools, Floats, Indices
from spherekit.conventions import REACH_SLACK
from spherekit.errors import CountError
from spherekit.model.joints import revolutes
from spherekit.motion.assembly_modes import FLAT_DYAD, Solver
from spherekit.numeric.crossings import bracketed_zeros, wrap
from spherekit.output.dyads import Dyads, Signs
from spherekit.output.virtual_output import VirtualOutputChain
from spherekit.planning.inputs import Assembly, merged, split
from spherekit.rates.request import cross, dot
from spherekit.sphere.dyad import middle_axis, triple_square
from spherekit.sphere.rotation import frame_from, frame_toward, perpendicular


@final
@dataclass(frozen=True)
class Fraction:
    """A rate, linear in the output's angular velocity w: top . w / bottom.

    `top` (3, n) and `bottom` (n,); both stay finite at a singular configuration.
    """

    top: Floats
    bottom: Floats


@final
@dataclass
class Placed:
    """The dyads at n rows, every part computed once for the signs that it depends on.

    `given_axes` are the axes (3, n) of pairs on given links, `given_rotation` the columns
    (3, 3, n) of the orientation of the given link, for its other axes.
    """

    dyads: Dyads
    given_axes: Mapping[int, Floats]
    given_rotation: Floats | None
    computed: dict[Hashable, Any] = field(default_factory=dict)

    def key(self, name: str, what: int, groups: frozenset[int], signs: Signs) -> Hashable:
        """Return a key for what depends on the signs of some groups only."""
        return (name, what, *(s if k in groups else 0 for k, s in enumerate(signs)))

    def axis(self, pair: int, link: int, signs: Signs) -> Floats:
        """Return the axis (3, n) or (3, 1) of a pair, seen on one of its links."""
        dyads = self.dyads
        pair, link, sense = dyads.source(pair, link)
        if sense < 0.0:
            return -self.axis(pair, link, signs)
        if link == dyads.base:
            return dyads.axis_in(pair, link)[:, None]
        if link in dyads.given and pair in self.given_axes:
            return self.given_axes[pair]
        if link in dyads.placed_by:
            group = dyads.placed_by[link]
            if pair == dyads.stands[group].middle:
                return self.middle(group, signs)[0]
        return self.vector(dyads.axis_in(pair, link), link, signs, ("axis", pair))

    def vector(
        self, vector: Floats, link: int, signs: Signs, name: tuple[str, int]
    ) -> Floats:
        """Return a vector (3,) of a link in base axes, (3, n) or (3, 1)."""
        dyads = self.dyads
        if link == dyads.base:
            return vector[:, None]
        if link in dyads.given:
            key: Hashable = (*name, link)
            if key not in self.computed:
                assert self.given_rotation is not None
                columns = self.given_rotation.reshape(3, -1)
                self.computed[key] = (vector @ columns).reshape(3, -1)
            return np.asarray(self.computed[key])
        group = dyads.placed_by[link]
        key = (self.key(*name, dyads.needs[group], signs), link)
        if key not in self.computed:
            spread = dyads.spreads.get((*name, link))
            if spread is None:
                spread = dyads.spread_of(vector, link)
                dyads.spreads[*name, link] = spread
            p = self.axis(spread.outer, link, signs)
            q = self.axis(spread.middle, link, signs)
            a, b, c = spread.weights
            self.computed[key] = a * p + b * q + c * cross(p, q)
        return np.asarray(self.computed[key])

    def outer(self, group: int, signs: Signs) -> tuple[Floats, Floats]:
        """Return the axes of a dyad's near and far pair."""
        stand = self.dyads.stands[group]
        return (
            self.axis(stand.near, stand.foot, signs),
            self.axis(stand.far, stand.hold, signs),
        )

    def middle(self, group: int, signs: Signs) -> tuple[Floats, Floats]:
        """Return the middle axis (3, n) and middle . (near x far), NaN out of reach."""
        key = self.key("middle", group, self.dyads.needs[group], signs)
        if key not in self.computed:
            level, across, height = self._halves(group, signs)
            sign = signs[group] * self.dyads.stands[group].parity
            self.computed[key] = level + sign * across, sign * height
        middle: tuple[Floats, Floats] = self.computed[key]
        return middle

    def _halves(self, group: int, signs: Signs) -> tuple[Floats, Floats, Floats]:
        """Return the part of the middle axis that both signs share, the other, and |t|."""
        key = self.reach_key(group, signs)
        if key not in self.computed:
            stand = self.dyads.stands[group]
            halves = stand.cones.halves
            a, c = self.outer(group, signs)
            total, difference = a + c, a - c
            squares = dot(total, total), dot(difference, difference)
            square = triple_square(*halves, *squares)
            grazes = np.abs(square) < REACH_SLACK
            if np.any(grazes):
                square[grazes] = np.maximum(square[grazes], 0.0)
            root = np.sqrt(square)
            along, beside, height = middle_axis(*halves, *squares, root)
            level = total * along
            if stand.cones.near != stand.cones.far:
                level += difference * beside
            across = cross(difference, total)  # 2 a x c, to rounding of its own size
            across *= 0.5 * height
            self.computed[key] = level, across, root
            self.computed[key, "squares"] = squares
            self.computed[key, "sound"] = root >= FLAT_DYAD * stand.flat
        parts: tuple[Floats, Floats, Floats] = self.computed[key]
        return parts

    def margin(self, group: int, signs: Signs) -> Floats:
        """Return by how much (rad) a dyad reaches, negative if it does not (n,)."""
        key = self.reach_key(group, signs), "margin"
        if key not in self.computed:
            cones = self.dyads.stands[group].cones
            u, v = self._beside(group, signs, "squares")
            half = np.arcsin(np.minimum(0.5 * np.sqrt(np.minimum(u, v)), 1.0))
            base = np.where(u < v, np.pi - 2.0 * half, 2.0 * half)
            centre = 0.5 * (cones.longest + cones.shortest)
            reach = 0.5 * (cones.longest - cones.shortest)
            self.computed[key] = reach - np.abs(base - centre)
        return np.asarray(self.computed[key])

    def square(self, group: int, signs: Signs) -> Floats:
        """Return t^2 (n,) of a dyad: negative where it does not reach."""
        u, v = self._beside(group, signs, "squares")
        halves = self.dyads.stands[group].cones.halves
        return np.asarray(triple_square(*halves, u, v))

    def sound(self, group: int, signs: Signs) -> Bools:
        """Return whether a dyad closes and is neither stretched nor folded (n,)."""
        return np.asarray(self._beside(group, signs, "sound"))

    def _beside(self, group: int, signs: Signs, what: str) -> Any:
        self._halves(group, signs)
        return self.computed[self.reach_key(group, signs), what]

    def reach_key(self, group: int, signs: Signs) -> Hashable:
        """Return the key of what a dyad's reach depends on: all but its own sign."""
        return self.key("halves", group, self.dyads.needs[group] - {group}, signs)

    def angle(self, pair: int, signs: Signs) -> tuple[Floats, Hashable]:
        """Return the variable (n,) of a pair in (-pi, pi] rad, and its key."""
        needs = (self.dyads.needs_of(link) for link in self.dyads.ends[pair])
        key = self.key("angle", pair, frozenset().union(*needs), signs)
        if key not in self.computed:
            self.computed[key] = self._angle(pair, signs)
        return self.computed[key], key

    def _angle(self, pair: int, signs: Signs) -> Floats:
        dyads = self.dyads
        a, b = dyads.ends[pair]
        if dyads.base in (a, b):
            other, part = self._side(pair, b if a == dyads.base else a, signs)
            turn = np.array([[part[0], part[1]], [-part[1], part[0]]])
            x, y = turn @ dyads.frame_in(pair, dyads.base)[:, :2].T @ other
            return np.asarray(np.arctan2(y if a == dyads.base else -y, x))
        one, first = self._side(pair, a, signs)
        other, second = self._side(pair, b, signs)
        x = dot(one, other) - first[2] * second[2]
        y = dot(self.axis(pair, b, signs), cross(one, other))
        turn = second[0] * first[0] + second[1] * first[1]
        side = second[1] * first[0] - second[0] * first[1]
        return np.asarray(np.arctan2(y * turn - x * side, x * turn + y * side))

    def _side(self, pair: int, link: int, signs: Signs) -> tuple[Floats, Floats]:
        """Return a vector of a link off a pair's axis, and its components in the frame.

        The components (3,) are those in the pair's frame in that link.
        """
        dyads = self.dyads
        frame = dyads.frame_in(pair, link)
        if link in dyads.given:
            vector = self.vector(frame[:, 0], link, signs, ("zero", pair))
            return vector, np.array([1.0, 0.0, 0.0])
        stand = dyads.stands[dyads.placed_by[link]]
        other = stand.middle
        if pair == other or dyads.is_coaxial(pair, other, link):
            other = stand.near if link == stand.first else stand.far
        return self.axis(other, link, signs), dyads.axis_in(other, link) @ frame

    def rate(self, pair: int, signs: Signs) -> Fraction:
        """Return the rate of a pair's variable per unit rate of the output.

        Notes
        -----
        The rates of the two bodies, w_foot + a A = w_hold + c C - b B, times the product
        of two of the axes, leave the rate of the third pair.
        """
        dyads = self.dyads
        group = dyads.group_of[pair]
        key = self.key("rate", pair, dyads.moves_with(pair), signs)
        if key not in self.computed:
            stand = dyads.stands[group]
            a, c = self.outer(group, signs)
            b, triple = self.middle(group, signs)
            near: int | None = stand.near
            far: int | None = stand.far
            if pair == stand.near:
                across, body, near = cross(b, c), stand.first, None
            elif pair == stand.middle:
                across, body = cross(c, a), stand.second
            else:
                across, body, far = cross(b, a), stand.second, None
            moved = self.along(across, stand.hold, far, signs)
            still = self.along(across, stand.foot, near, signs)
            rate = difference(moved, still)
            ahead = dyads.ends[pair][1] == body
            self.computed[key] = Fraction(
                rate.top, rate.bottom * (-triple if ahead else triple)
            )
        fraction: Fraction = self.computed[key]
        return fraction

    def along(
        self, vector: Floats, link: int, across: int | None, signs: Signs
    ) -> Fraction | None:
        """Return vector . w of a link; None for zero.

        The vector is at right angles to the axis of the pair `across` on that link, if
        one is named.
        """
        dyads = self.dyads
        if link == dyads.base:
            return None
        if link in dyads.given:
            return Fraction(vector, np.ones(1))
        group = dyads.placed_by[link]
        stand = dyads.stands[group]
        at_first = link == stand.first
        pair, foot = (stand.near, stand.foot) if at_first else (stand.far, stand.hold)
        if across is not None and dyads.is_coaxial(pair, across, link):
            return self.along(vector, foot, pair, signs)
        carried = self.along(vector, foot, None, signs)
        turning = self.rate(pair, signs)
        share = dot(vector, self.axis(pair, link, signs))
        ahead = dyads.ends[pair][1] == link
        turned = Fraction(turning.top * (share if ahead else -share), turning.bottom)
        return turned if carried is None else _sum(turned, carried)


def _sum(one: Fraction, other: Fraction) -> Fraction:
    return Fraction(
        one.top * other.bottom + other.top * one.bottom, one.bottom * other.bottom
    )


def difference(one: Fraction | None, other: Fraction | None) -> Fraction:
    """Return the difference of two rates; None stands for zero."""
    if other is None:
        assert one is not None, "what stands on the base alone does not move"
        return one
    minus = Fraction(-other.top, other.bottom)
    return minus if one is None else _sum(one, minus)


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

    def close(self, directions: Floats, turn: Floats, signs: Signs) -> tuple[Floats, Bools]:
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

    def roots(self, directions: Floats, signs: Signs) -> tuple[Indices, Floats, Floats]:
        """Return every turn found at directions (3, n): rows, turns, senses of f.

        Looked for where f changes its sign between equally spaced samples, between one
        of them and the turn beside it at which a dyad gets out of reach, and between them
        and an extremum of f.
        """
        row, low, high, at_low, at_high = self._brackets(directions, signs)

        def gap(turn: Floats, some: Indices) -> Floats:
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

    def _brackets(self, directions: Floats, signs: Signs) -> list[Array]:
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
        parts: list[list[Array]] = []

        def keep(
            row: Indices, one: Floats, value: Floats, other: Floats, last: Floats
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

        def unlike(at: Floats, some: Indices) -> Floats:
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
