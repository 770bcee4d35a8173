"""Slopes of the arms of a saddle, from what bounds the second derivatives around it.

Where configuration curves cross, or just miss each other: a saddle with four arms.

At a configuration where F' loses one rank, all equations but one sum g of them still fix
all but two coordinates (u, v), and the configurations near by are g(u, v) = 0 (Lyapunov
and Schmidt). If g is convex in u and concave in v over a rectangle, positive on its sides
u = +-r and negative at (0, +-s), its zeros are four arms that leave through the sides
v = +-s, one in each quadrant. How they are joined follows from the level c alone, the
largest over v of the least g over u: they cross at one point if c is 0, else they are two
arcs that miss each other. A value and slopes of g at any point enclose c: it is at most
that value and what the slope by v adds over the rectangle, and at least that value less
what the slope by u takes. All of it is computed in balls.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from spherekit.proof.balls import (
    Ball,
    BallMatrix,
    bits,
    exact,
    lower,
    matrix,
    middle,
    solved,
    upper,
    wide,
)
from spherekit.proof.equations import Equations
from spherekit.proof.roots import maps_inside
from spherekit.proof.tubes import Zone
from spherekit.sphere.rotation import Floats

DIRECTIONS = 100
"""Parts of each side of the square of directions in which slopes are enclosed."""

Quadrant = tuple[int, int]
QUADRANTS: tuple[Quadrant, ...] = ((1, 1), (1, -1), (-1, 1), (-1, -1))


@final
class Slopes:
    """Slopes of arms in a rectangle, from how variables move with u and v, and from g''.

    With (u, v) the way from the saddle, g is its level and half the form of g'', and the
    slopes of g are g'' (u, v), each with some g'' of the rectangle.
    """

    def __init__(self, ways: BallMatrix, bend: BallMatrix, units: Floats) -> None:
        self.ways = [[e.real for e in row] for row in ways.tolist()]
        self.bend = bend[0, 0].real, bend[0, 1].real, bend[1, 1].real
        self.units = exact(float(units[0])), exact(float(units[1]))

    def outward(self, slack: float, off: float) -> dict[Quadrant, tuple[int, ...]]:
        """Return the signs of the rates of all variables outward on the arms.

        The form of g'' is at most `slack` times the square of the way there, and the
        slopes of g are off by at most `off` times the way.
        """
        signs: dict[Quadrant, list[set[int]]] = {
            quadrant: [set() for _ in self.ways] for quadrant in QUADRANTS
        }
        for p, s in _directions():
            form, by_u, by_v = self._along(p, s, off)
            if not wide(form, slack).contains(0):
                continue
            for quadrant in QUADRANTS:
                if quadrant[0] not in _signs(p) or quadrant[1] not in _signs(s):
                    continue
                outward = by_u * quadrant[0] > 0
                for row, (across, up) in zip(signs[quadrant], self.ways, strict=True):
                    rate = (up * by_u - across * by_v) * quadrant[0] * quadrant[1]
                    row.add((int(rate > 0) - int(rate < 0)) if outward else 0)
        return {
            quadrant: tuple(next(iter(s)) if len(s) == 1 else 0 for s in row)
            for quadrant, row in signs.items()
        }

    def reach(
        self, slack: float, limits: Floats, off: float = 1e-12
    ) -> dict[Quadrant, tuple[float, ...]]:
        """Return how far all variables go on the arms, from a centre next to the saddle.

        By the directions that `outward` has, and by `off` more.
        """
        most = 1.001 * float(np.max(limits[:2] / [float(e.mid()) for e in self.units]))
        rows: dict[Quadrant, list[float]] = {q: [off] * len(self.ways) for q in QUADRANTS}
        for p, s in _directions():
            if not wide(self._along(p, s, 0.0)[0], slack).contains(0):
                continue
            for quadrant in QUADRANTS:
                if quadrant[0] not in _signs(p) or quadrant[1] not in _signs(s):
                    continue
                for j, (across, up) in enumerate(self.ways):
                    way = upper(across * p * self.units[0] + up * s * self.units[1]) * most
                    rows[quadrant][j] = max(rows[quadrant][j], way + off)
        return {quadrant: tuple(row) for quadrant, row in rows.items()}

    def through(self, level: Ball, steep: float) -> tuple[bool, ...]:
        """Return which rates vanish nowhere on the two arcs of a level that is not 0."""
        a, b, d = (upper(e) for e in self.bend)
        # the way is at least what makes the form as large as the level is
        least = float(np.sqrt(lower(level) / (a + 2.0 * b + d)))
        slack, off = 4.004 * steep / least, 1.001 * steep / least
        sign = -1 if level > 0 else 1
        side = 0 if sign > 0 else 1
        signs: list[dict[int, set[int]]] = [{1: set(), -1: set()} for _ in self.ways]
        for p, s in _directions():
            form, by_u, by_v = self._along(p, s, off)
            if wide(form, slack) * sign < 0:
                continue
            ahead = (by_u if side == 0 else by_v) * (1 if side == 0 else -1)
            for row, (across, up) in zip(signs, self.ways, strict=True):
                rate = up * by_u - across * by_v
                for half in _signs((p, s)[side]):
                    whole = ahead * half > 0
                    row[half].add((int(rate > 0) - int(rate < 0)) if whole else 0)
        return tuple(all(len(s) <= 1 and 0 not in s for s in row.values()) for row in signs)

    def _along(self, p: Ball, s: Ball, off: float) -> tuple[Ball, Ball, Ball]:
        """Return the form of g'' and the slopes of g in a direction."""
        a, b, d = self.bend
        u, v = p * self.units[0], s * self.units[1]
        form = u * u * a + 2 * u * v * b + v * v * d
        return form, wide(u * a + v * b, off), wide(u * b + v * d, off)


def _signs(ball: Ball) -> tuple[int, ...]:
    return (1,) if ball > 0 else (-1,) if ball < 0 else (1, -1)


def _directions() -> Iterator[tuple[Ball, Ball]]:
    """Yield parts of the sides of a square that together are all of them."""
    half = 1.0 / DIRECTIONS
    for number in range(DIRECTIONS):
        along = wide(exact((2 * number + 1) * half - 1.0), half * (1.0 + 1e-12))
        for end in (exact(1.0), exact(-1.0)):
            yield along, end
            yield end, along


PRECISIONS = (80, 160, 320, 640)
"""Bits of centres in which the level of a saddle is enclosed, until its sign is known."""
WIDEST = 0.4
"""Largest rectangle tried (rad), in the units of the branches."""
NARROWEST = 1e-5
SHRINK = 0.75
STEEPEST, LEAST = 0.02, 1e-3
"""Smaller rectangles are not tried only to learn more signs of rates, or to reach less."""
INNER = 1.0 / 16.0
"""Arms are told apart by quadrants from this part of the rectangle on."""
FLATTER = 0.7
"""Height of the rectangle over its width, in units in which branches are diagonals."""
NEWTON = 12
FAR = 100.0
"""How many times their gap arms are away from a saddle where they count as straight."""


@final
@dataclass(frozen=True)
class Saddle(Zone):
    """A part of space with four arms of configuration curves that meet, or nearly do.

    Coordinates are those of `frame` (v, v) about `centre`: u, v and all others, each at
    most `limits` (v,). `level` is the sign of g at the saddle, 0 if the curves are proven
    to cross there, None if it is not told from 0; arms of equal v are joined if it is
    positive, of equal u if negative. The curves miss each other by at most `gap` (rad).
    `rates` has for each quadrant the sign that each variable's rate has outward on the
    arm, 0 if none is proven, farther than `zone` (v,) from the centre, and `reach` how far
    the variable goes from the centre on it. `passes` says of which variables the rates
    vanish nowhere between two arms that are joined.
    """

    level: int | None
    gap: float
    zone: Floats
    rates: Mapping[Quadrant, tuple[int, ...]]
    reach: Mapping[Quadrant, tuple[float, ...]]
    passes: tuple[bool, ...] = ()

    @property
    def open(self) -> int:
        """How many rates have no proven sign."""
        return sum(row.count(0) for row in self.rates.values())

    def on(self, quadrant: Quadrant) -> Floats:
        """Return a place (v,) near an arm, not far from where it leaves."""
        u, v = 0.9 * FLATTER * self.limits[0], 0.9 * self.limits[1]
        way = np.array([u * quadrant[0], v * quadrant[1]])
        return np.asarray(self.centre + self.frame[:, :2] @ way)

    def quadrant(self, place: Floats, off: float) -> Quadrant | None:
        """Return the arm that a configuration is on, None where that is not proven."""
        at = self.coordinates(place)
        far = abs(at[1]) - off > INNER * self.limits[1] + 1e-13
        if not (far and abs(at[0]) > off + 1e-13 and self.holds(place, off)):
            return None
        return int(np.sign(at[0])), int(np.sign(at[1]))


@final
@dataclass(frozen=True)
class _Jets:
    """F, F' and F'' at balls: (k, 1), (k, v), and (v, v) of each equation."""

    values: BallMatrix
    slopes: BallMatrix
    bends: tuple[BallMatrix, ...]


def _jets(equations: Equations, places: Sequence[Ball]) -> _Jets:
    values, slopes, bends = equations.arrays(places, 2)
    return _Jets(matrix(values[:, None]), matrix(slopes), tuple(map(matrix, bends)))


def _sum(factors: Sequence[Ball], parts: Sequence[BallMatrix]) -> BallMatrix:
    total = 0 * parts[0]
    for factor, part in zip(factors, parts, strict=True):
        total = total + factor * part
    return total


def critical_point(equations: Equations, near: Sequence[Ball]) -> list[Ball] | None:
    """Return centres next to where F is a multiple of l and a sum of the rows of F' is 0.

    l is the vector that F' at the first place is nearest to missing. Nothing rests on it.
    """
    place = list(near)
    first = _jets(equations, place)
    start = np.array([[middle(e.real) for e in row] for row in first.slopes.tolist()])
    if not np.all(np.isfinite(start)):
        return None
    missed = [exact(float(e)) for e in np.linalg.svd(start)[0][:, -1]]
    factors, level = list(missed), exact(0.0)
    count, k = equations.variables, len(missed)
    for _ in range(NEWTON):
        at = _jets(equations, place)
        row = matrix([factors])
        bent = _sum(factors, at.bends)
        values, slopes = at.values.entries(), at.slopes
        right = [v - level * m for v, m in zip(values, missed, strict=True)]
        right += (row * slopes).entries()
        right += [sum((f * m for f, m in zip(factors, missed, strict=True)), exact(-1.0))]
        rows = [[*slopes.tolist()[i], *[0] * k, -missed[i]] for i in range(k)]
        rows += [
            [*bent.tolist()[j], *(slopes[i, j] for i in range(k)), 0] for j in range(count)
        ]
        rows += [[*[0] * count, *missed, 0]]
        try:
            step = matrix(rows).mid().solve(matrix([[e] for e in right]).mid()).entries()
        except ZeroDivisionError:
            return None
        change = [e.real.mid() for e in step]
        size = max(upper(e) for e in change[:count])
        if not size < 0.5:
            return None
        place = [(p - e).mid() for p, e in zip(place, change[:count], strict=True)]
        factors = [(f - e).mid() for f, e in zip(factors, change[count:-1], strict=True)]
        level = (level - change[-1]).mid()
    return place


Crosses = Callable[[Saddle], bool]
"""Says something of a saddle's part of space."""


def saddle_near(
    equations: Equations, place: Floats, farthest: float, crosses: Crosses, fits: Crosses
) -> Saddle | None:
    """Return the saddle next to a place, None if none is proven within `farthest` (rad).

    `crosses` says whether in its part of space a configuration is proven at which a sum of
    the rows of F' vanishes, so that the level is 0; `fits` whether the part may be used.
    """
    best: Saddle | None = None
    with bits(PRECISIONS[0]):
        at = critical_point(equations, [exact(float(e)) for e in place])
        if at is None:
            return None
        centre = np.array([middle(ball) for ball in at])
        if not np.max(np.abs(centre - place)) < farthest:
            return None
        form = _form(equations, centre)
        size = WIDEST
        while form is not None and size > NARROWEST:
            shown = form.shown(size, crosses)
            if shown is not None and fits(shown) and _better(shown, best):
                best = shown
            if best is not None:
                enough = STEEPEST if best.level == 0 else LEAST
                if not best.open or size < enough:
                    break
            size *= SHRINK
    return best


def _better(one: Saddle, other: Saddle | None) -> bool:
    """Return whether more signs of rates are known of a smaller rectangle.

    Where they remain open at a level that is not 0, arms of a smaller one reach less far.
    """
    if other is None or one.open < other.open:
        return True
    return one.level != 0 and one.open == other.open > 0


def _form(equations: Equations, centre: Floats) -> "_Form | None":
    """Return coordinates in which the curves at a place are diagonals of a rectangle."""
    turns = np.stack([np.cos(centre), np.sin(centre)], axis=-1)
    _, slopes, curvatures = equations.real.second(turns)
    left, sizes, right = np.linalg.svd(slopes)
    if len(sizes) > 1 and not sizes[-2] > 1e-6 * sizes[0]:
        return None
    plane, normals = right[-2:].T, right[:-2].T
    bent = np.einsum("i,ijl,ja,lb->ab", left[:, -1], curvatures, plane, plane)
    values, vectors = np.linalg.eigh(bent)
    low, high = float(values[0]), float(values[1])
    if not (low < 0.0 < high and min(-low, high) > 1e-6 * max(-low, high)):
        return None
    frame = np.column_stack([plane @ vectors[:, ::-1], normals])
    units = np.array([high, -low]) ** -0.5
    return _Form(equations, centre, frame, left, units / np.max(units))


@final
class _Form:
    """The reduced equation g about a place, and the test over rectangles.

    `left` (k, k) has as columns the sums of equations that are solved first, then g;
    `units` (2,) are lengths of u and v in which branches are diagonals.
    """

    def __init__(
        self,
        equations: Equations,
        centre: Floats,
        frame: Floats,
        left: Floats,
        units: Floats,
    ) -> None:
        self.equations, self.centre, self.frame = equations, centre, frame
        self.units = units
        self.plane, self.normals = _exactly(frame[:, :2]), _exactly(frame[:, 2:])
        self.first, self.last = _exactly(left[:, :-1].T), _exactly(left[:, -1:].T)
        self.others = frame.shape[1] - 2

    def shown(self, size: float, crosses: Crosses) -> Saddle | None:
        """Return the saddle with a rectangle of a size, None if that does not prove it."""
        flat = np.array([1.0, FLATTER]) * size * self.units
        reach = 0.2 * size + self._lifted(flat)
        limits = np.array([*flat, *[reach] * self.others])
        over = self._over(limits)
        if not self._graph(limits, over):
            return None
        try:
            _, bend = self._reduced(over)
            value, slope = self._at([exact(float(e)) for e in self.centre], over)
            if not (bend[0, 0].real > 0 and bend[1, 1].real < 0):
                return None
            if not self._sides(limits, value, slope, bend):
                return None
            part = Saddle(self.centre, self.frame, limits, None, 0.0, 0.0 * limits, {}, {})
            ways, _ = self._reduced(over)
            slopes = Slopes(ways, bend, self.units)
            whole = slopes.reach(0.0, limits)
            if crosses(part):
                return replace(part, level=0, rates=slopes.outward(0.0, 0.0), reach=whole)
            level, steep = self._level(limits, over)
        except ZeroDivisionError:
            return None
        least = min(lower(bend[0, 0].real), lower(bend[1, 1].real))
        size = upper(level)
        gap = float(2.0 * np.sqrt(2.0 * size / least))
        away = FAR * gap + 1e4 * steep / least + 1e-300
        slack = 2.001 * (size / away + 2.0 * steep) / away
        spread = np.array([[upper(e.real) for e in row] for row in ways.tolist()])
        sign = int(level > 0) - int(level < 0)
        return replace(
            part,
            level=sign or None,
            gap=gap,
            zone=4.0 * away * np.sum(spread, axis=1) + 1e-12,
            rates=slopes.outward(slack, 1.001 * steep / away),
            reach=slopes.reach(slack, limits, 4.0 * away),
            passes=slopes.through(level, steep) if sign else (),
        )

    def _lifted(self, flat: Floats) -> float:
        """Return about how far the others are from 0 at the corners of a rectangle."""
        if not self.others:
            return 0.0
        turns = np.stack([np.cos(self.centre), np.sin(self.centre)], axis=-1)
        _, slopes, curvatures = self.equations.real.second(turns)
        first = np.array([[middle(e.real) for e in r] for r in self.first.tolist()])
        sides = self.frame[:, :2] * flat
        bent = np.sum(np.abs(np.einsum("ijl,ja,lb->iab", curvatures, sides, sides)), (1, 2))
        inverse = np.linalg.inv(first @ slopes @ self.frame[:, 2:])
        return float(np.max(np.abs(inverse) @ np.abs(first) @ bent))

    def _over(self, limits: Floats) -> _Jets:
        """Return F, F' and F'' over all of a part of space, a little more than it."""
        reach = np.abs(self.frame) @ limits * (1.0 + 1e-9) + 1e-12
        places = [
            wide(exact(float(e)), float(r)) for e, r in zip(self.centre, reach, strict=True)
        ]
        return _jets(self.equations, places)

    def _graph(self, limits: Floats, over: _Jets) -> bool:
        """Return whether for all u and v of the part the others are fixed in it."""
        if not self.others:
            return True
        here = _jets(self.equations, [exact(float(e)) for e in self.centre])
        flat = matrix([[wide(exact(0.0), float(e))] for e in limits[:2]])
        sides = [float(e) for e in limits[2:]]
        bends = [_sum(row, over.bends) for row in self.first.tolist()]
        forms = [self.plane.transpose() * b * self.plane for b in bends]
        bent = matrix([[(flat.transpose() * form * flat)[0, 0]] for form in forms])
        value = self.first * here.values + (self.first * here.slopes * self.plane) * flat
        value = value + bent * exact(0.5)
        inner = self.first * over.slopes * self.normals
        near = self.first * here.slopes * self.normals
        return maps_inside(near, inner, value, sides)

    def _reduced(self, at: _Jets) -> tuple[BallMatrix, BallMatrix]:
        """Return how all variables move with u and v (v, 2), and g'' (2, 2), over balls."""
        ways = self.plane
        weights = self.last
        if self.others:
            inner = self.first * at.slopes * self.normals
            ways = ways - self.normals * solved(inner, self.first * at.slopes * self.plane)
            weights = weights - self._weights(at, inner)
        bent = _sum(weights.entries(), at.bends)
        return ways, ways.transpose() * bent * ways

    def _weights(self, at: _Jets, inner: BallMatrix) -> BallMatrix:
        """Return the sum (1, k) of equations by which g' differs from the slopes of g's."""
        right = (self.last * at.slopes * self.normals).transpose()
        return solved(inner.transpose(), right).transpose() * self.first

    def _at(self, place: Sequence[Ball], over: _Jets) -> tuple[Ball, tuple[Ball, Ball]]:
        """Return g and its slopes by u and v, the others as they are fixed at a place."""
        at = _jets(self.equations, place)
        if self.others:
            inner = self.first * over.slopes * self.normals
            off = (self.normals * solved(inner, self.first * at.values)).entries()
            at = _jets(
                self.equations, [p - e.real for p, e in zip(place, off, strict=True)]
            )
        weights = self.last
        if self.others:
            weights = weights - self._weights(at, self.first * at.slopes * self.normals)
        slopes = (weights * at.slopes * self.plane).entries()
        return (self.last * at.values)[0, 0].real, (slopes[0].real, slopes[1].real)

    def _sides(
        self, limits: Floats, value: Ball, slope: tuple[Ball, Ball], bend: BallMatrix
    ) -> bool:
        """Return whether g is positive on the sides of u and the arms are in quadrants."""
        u, v = float(limits[0]), float(limits[1])
        level, steep = upper(value), [upper(e) for e in slope]
        least = [lower(bend[j, j].real) for j in (0, 1)]
        mixed = upper(bend[0, 1].real)
        side = least[0] * u * u - 2 * mixed * u * v - upper(bend[1, 1].real) * v * v
        out = 0.5 * side - steep[0] * u - steep[1] * v - level
        inner = INNER * v
        down = 0.5 * least[1] * inner**2 - steep[1] * inner
        return bool(out > 1e-12 * u * u and down > 1.001 * max(level, 2.0 * u * steep[0]))

    def _level(self, limits: Floats, over: _Jets) -> tuple[Ball, float]:
        """Return the level of the saddle, and the largest slope at a place next to it."""
        place = [exact(float(e)) for e in self.centre]
        value, slope = self._at(place, over)
        best = self._between(value, slope, limits)
        written, made = self.equations.written, self.equations.construction
        for precision in PRECISIONS:
            with bits(precision):
                finer = Equations(written, made)
                there = critical_point(finer, place)
                if there is None or not self._inside(there, limits):
                    break
                place = there
                form = _Form(finer, self.centre, self.frame, self._left(), self.units)
                best = self._between(*form._at(place, over), limits)
            if not best[0].contains(0):
                break
        return best

    def _between(
        self, value: Ball, slope: tuple[Ball, Ball], limits: Floats
    ) -> tuple[Ball, float]:
        """Return the level that a value and slopes of g allow, and the larger slope."""
        steep = max(upper(e) for e in slope)
        return wide(value, 2.002 * float(np.max(limits[:2])) * steep), steep

    def _left(self) -> Floats:
        parts = [*self.first.tolist(), *self.last.tolist()]
        return np.array([[middle(e.real) for e in row] for row in parts]).T

    def _inside(self, place: Sequence[Ball], limits: Floats) -> bool:
        near = np.array([middle(e) for e in place])
        return bool(np.all(np.abs((near - self.centre) @ self.frame) < 1e-3 * limits))


def _exactly(floats: Floats) -> BallMatrix:
    """Return a matrix of float64 numbers as balls, of no entries too."""
    if floats.size == 0:
        return type(matrix([[0]]))(*floats.shape)
    return matrix([[exact(float(e)) for e in row] for row in floats])
