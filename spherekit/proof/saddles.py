"""Where configuration curves cross, or just miss each other: a saddle with four arms.

Where F' loses one rank and misses the direction l, F = g l has one solution (z, g) next to
it for each pair of coordinates (u, v) along the kernel of F', since the equations bordered
by l and these coordinates are regular. The configurations near by are g(u, v) = 0 (Lyapunov
and Schmidt); derivatives of g come from the same linear equations. If g is convex in u and
concave in v over a rectangle, positive on its sides u = +-r and negative at (0, +-s), its
zeros are four arms that leave through the sides v = +-s, one in each quadrant. How they are
joined follows from the level c alone, the largest over v of the least g over u: they cross
at one point if c is 0, else they are two arcs that miss each other. A value and slopes of g
at any point enclose c: it is at most that value and what the slope by v adds over the
rectangle, and at least that value less what the slope by u takes. All of it is computed in
balls.
"""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from spherekit.arrays import Array, Bools, Floats, Indices
from spherekit.proof.arc_equations import Equations
from spherekit.proof.ball_frames import exactly
from spherekit.proof.balls import (
    Ball,
    bits,
    circle,
    floats,
    lower,
    middles,
    precision,
    solved,
    upper,
    wide,
)
from spherekit.proof.tubes import Zone

Quadrant = tuple[int, int]


def _slopes(bend: Array, slack: float) -> dict[int, tuple[float, float]]:
    """Return bounds of v / u, by its sign, where the form of `bend` (2, 2) is about 0.

    It is at most `slack` times the square of the larger of u and v.

    Raises
    ------
    ZeroDivisionError
        If there are no such bounds.
    """
    a, d, b = wide(bend[0, 0], slack), wide(-bend[1, 1], slack), bend[0, 1]
    root = (b * b + a * d).sqrt()
    made = {sign: (root + sign * b) / d for sign in (1, -1)}
    if not (a > 0 and d > 0 and made[1] > 0 and made[-1] > 0):
        raise ZeroDivisionError
    return {sign: (sign * lower(size), sign * upper(size)) for sign, size in made.items()}


def _along(
    ways: Array, bend: Array, slope: float, off: float
) -> tuple[list[Ball], Indices]:
    """Return slopes of g by u and v, and signs of the rates, in a direction (1, slope).

    With (u, v) the way from the saddle, g is its level and half the form of g'', and the
    slopes of g are g'' (u, v), each with some g'' of `bend` (2, 2) and off by at most `off`
    times the way. Variables move with u and v by `ways` (v, 2). A rate is linear in the
    direction, so that it has the sign in a cone that it has on both its sides.
    """
    most = off * max(1.0, abs(slope))
    by_u, by_v = by = [wide(entry, most) for entry in bend @ exactly([1.0, slope])]
    rates = ways @ [-by_v, by_u]
    return by, (rates > 0).astype(int) - (rates < 0)


def _outward(
    ways: Array, bend: Array, farthest: float, slack: float, off: float, spare: float
) -> tuple[dict[Quadrant, Indices], dict[Quadrant, Floats]]:
    """Return the signs of all rates outward on the arms, and how far variables go.

    The form of `bend` is at most `slack` times the square of the way there. The way is at
    most `farthest`, from a centre that is `spare` from the saddle at most.
    """
    signs, reach = {}, {}
    for k, ends in _slopes(bend, slack).items():
        (one, first), (other, last) = (_along(ways, bend, end, off) for end in ends)
        proven = one[0] > 0 and other[0] > 0
        directions = [*ends, np.clip(k, min(ends), max(ends))]
        sides = [np.array([1.0, slope]) / max(1.0, abs(slope)) for slope in directions]
        far = np.array([max(map(upper, row)) for row in ways @ exactly(sides).T])
        for v in (1, -1):
            signs[k * v, v] = v * proven * np.where(first == last, first, 0)
            reach[k * v, v] = far * farthest + spare
    return signs, reach


def _passes(ways: Array, bend: Array, level: Ball, steep: float) -> Bools:
    """Return which rates vanish nowhere on the two arcs of a level that is not 0."""
    # the way is at least what makes the form as large as the level is
    least = np.sqrt(lower(level) / sum(map(upper, bend.flat)))
    slopes, off = _slopes(bend, 4.004 * steep / least), 1.001 * steep / least
    # one arc and its mirror image: from quadrant to quadrant over v or over u
    turned, side, end = (-1, 1, 0) if level > 0 else (1, 0, 1)
    (one, first), (other, last) = (_along(ways, bend, slopes[k][end], off) for k in (1, -1))
    whole = turned * one[side] > 0 and other[side] > 0
    return np.asarray(whole & (first == turned * last) & (first != 0))


PRECISIONS = (80, 160, 320, 640)
"""Bits of centres in which the level of a saddle is enclosed, until its sign is known."""
FARTHEST = 0.02
"""How far (rad) from where a curve could not be followed a saddle is looked for."""
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
    rates: Mapping[Quadrant, Indices]
    reach: Mapping[Quadrant, Floats]
    passes: Bools

    def on(self, quadrant: Quadrant) -> Floats:
        """Return a place (v,) near an arm, not far from where it leaves."""
        way = 0.9 * np.array([FLATTER, 1.0]) * self.limits[:2] * quadrant
        return self.centre + self.frame[:, :2] @ way

    def quadrant(self, place: Floats, off: float) -> Quadrant | None:
        """Return the arm that a configuration is on, None where that is not proven."""
        u, v = self.coordinates(place)[:2]
        far = abs(v) - off > INNER * self.limits[1] + 1e-13
        if not (far and abs(u) > off + 1e-13 and self.holds(place, off)):
            return None
        return int(np.sign(u)), int(np.sign(v))


def saddle_near(
    equations: Equations,
    place: Floats,
    crosses: Callable[[Zone], bool],
    fits: Callable[[Zone], bool],
) -> Saddle | None:
    """Return the saddle next to a place, None if none is proven that near.

    `crosses` says whether in its part of space a configuration is proven at which a sum of
    the rows of F' vanishes, so that the level is 0; `fits` whether the part may be used.
    """
    with bits(PRECISIONS[0]), suppress(ZeroDivisionError):
        form = _form(equations, place)
        size = WIDEST
        while size > NARROWEST:
            shown = form.shown(size, crosses)
            if shown is not None and fits(shown):
                # of a smaller one more signs of rates may be known, or arms reach less
                enough = STEEPEST if shown.level == 0 else LEAST
                if size < enough or not any(0 in row for row in shown.rates.values()):
                    return shown
            size *= SHRINK
    return None


def _form(equations: Equations, place: Floats) -> "_Form":
    """Return coordinates in which the curves at a saddle are diagonals of a rectangle.

    Raises
    ------
    ZeroDivisionError
        If no centre next to the place has such coordinates.
    """
    centre = floats(_Form.about(equations, place).critical(exactly(place)))
    form = _Form.about(equations, centre)
    _, second = form.solved(exactly(centre), form.open(exactly(centre))[1])
    (low, high), vectors = np.linalg.eigh(floats(second[-1, 1:, 1:]))
    told = low < 0.0 < high and min(-low, high) > 1e-6 * max(-low, high)
    if not (told and np.max(np.abs(centre - place)) < FARTHEST):
        raise ZeroDivisionError
    frame, turned = form.frame.copy(), vectors[:, ::-1]
    frame[:, :2] @= turned
    units = np.array([high, -low]) ** -0.5
    bent = turned.T @ floats(second[:-1, 1:, 1:]) @ turned
    lifted = np.abs(np.tensordot(frame[:, 2:].T, bent, 1))
    return replace(form, frame=frame, units=units / np.max(units), lifted=lifted)


@dataclass(frozen=True)
class _Form:
    """The reduced equation g about a centre, and the test over rectangles.

    F = g `missed` (k,), and u and v are the first two coordinates of `frame` about
    `centre`; `units` (2,) are lengths of these in which branches are diagonals, `lifted`
    (others, 2, 2) sizes of the second derivatives of the other coordinates by them.
    """

    equations: Equations
    centre: Floats
    frame: Floats
    missed: Floats
    units: Floats
    lifted: Floats

    @staticmethod
    def about(equations: Equations, place: Floats) -> "_Form":
        """Return one by the rank that F' is nearest to losing.

        Raises
        ------
        ZeroDivisionError
            If it is more than one.
        """
        _, slopes = equations.real.derivatives(circle(place[None]), 1)
        left, sizes, right = np.linalg.svd(slopes[0])
        if not np.all(sizes[:-1] > 1e-6 * sizes[0]):
            raise ZeroDivisionError
        frame = np.roll(right, 2, axis=0).T
        return _Form(equations, place, frame, left[:, -1], np.ones(2), np.ones(0))

    def open(self, place: Array) -> tuple[Ball, Array]:
        """Return a number near g at a place, and by how much F differs from it (k,)."""
        (values,), missed = self.equations.arrays(place, 0), exactly(self.missed)
        level = middles(missed @ values)
        return level, values - level * missed

    def solved(self, places: Array, residual: Array, order: int = 2) -> list[Array]:
        """Return how (z, g) moves, (v + 1, 3): by a residual of F, and with u and v.

        With it, at an order of 2, its second derivatives (v + 1, 3, 3). At balls of all
        variables.
        """
        _, slopes, *bends = self.equations.arrays(places, order)
        (k, v), nothing = slopes.shape, np.zeros((2, 1))
        missed, along = exactly(self.missed), exactly(self.frame[:, :2].T)
        square = np.block([[slopes, -missed[:, None]], [along, nothing]])
        right = np.block([[-residual[:, None], np.zeros((k, 2))], [nothing, np.eye(2)]])
        made = [solved(square, right)]
        for bent in bends:
            right = np.zeros((v + 1, 9), object)
            right[:k] = -(made[0][:v].T @ bent @ made[0][:v]).reshape(k, 9)
            made.append(solved(square, right).reshape(-1, 3, 3))
        return made

    def critical(self, place: Array) -> Array:
        """Return centres next to where the slopes of g are 0; nothing rests on them.

        Raises
        ------
        ZeroDivisionError
            If there is none next to a place.
        """
        for _ in range(NEWTON):
            first, second = self.solved(place, self.open(place)[1])
            slope = middles(first[-1, 1:] + second[-1, 0, 1:])
            flat = solved(middles(second[-1, 1:, 1:]), -slope[:, None])[:, 0]
            change = middles(first[:-1, 0] + first[:-1, 1:] @ flat)
            far = np.max(np.abs(floats(change)))
            if not far < 0.5:
                raise ZeroDivisionError
            place = middles(place + change)
            if far < 2.0 ** (8 - precision()):
                break
        return place

    def shown(self, size: float, crosses: Callable[[Zone], bool]) -> Saddle | None:
        """Return the saddle with a rectangle of a size, None if that does not prove it."""
        flat, normals = np.array([1.0, FLATTER]) * size * self.units, self.frame[:, 2:].T
        centre = exactly(self.centre)
        level, residual = self.open(centre)
        reach = 0.2 * size + np.max(flat @ self.lifted @ flat, initial=0.0)
        limits = np.array([*flat, *[reach] * len(normals)])
        try:
            first, second = self.solved(self._over(limits), residual)
            ways, bend = first[:-1, 1:], second[-1, 1:, 1:]
            # on the way from the residual at the centre, and from there to u and v
            aside = normals @ first[:-1, 0] + (normals @ ways) @ _about(flat)
            convex = bend[0, 0] > 0 and bend[1, 1] < 0
            if not (convex and all(upper(way) < reach for way in aside)):
                return None
            value, slope = self._there(centre, level, first[:, 0])
            if not _sides(limits, value, slope, bend):
                return None
            part = self.centre, self.frame, limits
            # in units, which are 1 at most
            units = exactly(self.units)
            arms = ways * units, bend * units * units[:, None], 1.001 * size
            nowhere = np.zeros(limits.shape, dtype=bool)
            if crosses(Zone(*part)):
                signs, far = _outward(*arms, 0.0, 0.0, 1e-12)
                return Saddle(*part, 0, 0.0, 0.0 * limits, signs, far, nowhere)
            level, steep = self._level(limits)
            least = min(lower(bend[0, 0]), lower(bend[1, 1]))
            height, sign = upper(level), (level > 0) - (level < 0)
            gap = 2.0 * np.sqrt(2.0 * height / least)
            away = FAR * gap + 1e4 * steep / least + 1e-300
            slack, off = 2.001 * (height / away + 2.0 * steep) / away, 1.001 * steep / away
            return Saddle(
                *part,
                sign or None,
                gap,
                4.0 * away * np.array([sum(map(upper, row)) for row in ways]) + 1e-12,
                *_outward(*arms, slack, off, 4.0 * away),
                _passes(*arms[:2], level, steep) if sign else nowhere,
            )
        except ZeroDivisionError:
            return None

    def _over(self, limits: Floats) -> Array:
        """Return balls of all variables over a part of space, a little more than it."""
        reach = np.abs(self.frame) @ limits * (1.0 + 1e-9) + 1e-12
        return exactly(self.centre) + _about(reach)

    def _there(self, place: Array, level: Ball, moved: Array) -> tuple[Ball, Array]:
        """Return g and its slopes (2,) at the u and v of a place.

        `moved` (v + 1,) is how far (z, g) is from the place and its level.
        """
        (near,) = self.solved(place + moved[:-1], 0 * exactly(self.missed), 1)
        return level + moved[-1], near[-1, 1:]

    def _level(self, limits: Floats) -> tuple[Ball, float]:
        """Return the level of the saddle, and the largest slope at a place next to it.

        Raises
        ------
        ZeroDivisionError
            If no place next to the centre is flat.
        """
        place, most = exactly(self.centre), 2.002 * np.max(limits[:2])
        for digits in PRECISIONS:
            with bits(digits):
                made = Equations(self.equations.written, self.equations.construction)
                form = replace(self, equations=made)
                place = form.critical(place)
                off = (floats(place) - self.centre) @ self.frame
                if not np.all(np.abs(off) < 1e-3 * limits):
                    raise ZeroDivisionError
                level, residual = form.open(place)
                (first,) = form.solved(form._over(limits), residual, 1)
                value, slope = form._there(place, level, first[:, 0])
                steep = max(map(upper, slope))
                level = wide(value, most * steep)
                if not level.contains(0):
                    break
        return level, steep


def _sides(limits: Floats, value: Ball, slope: Array, bend: Array) -> bool:
    """Return whether g is positive on the sides of u and the arms are in quadrants."""
    u, v, *_ = limits
    level, steep = upper(value), [*map(upper, slope)]
    least = [*map(lower, bend.diagonal())]
    side = least[0] * u * u - 2 * upper(bend[0, 1]) * u * v - upper(bend[1, 1]) * v * v
    out = 0.5 * side - steep[0] * u - steep[1] * v - level
    inner = INNER * v
    down = 0.5 * least[1] * inner**2 - steep[1] * inner
    return bool(out > 1e-12 * u * u and down > 1.001 * max(level, 2.0 * u * steep[0]))


def _about(radii: Floats) -> Array:
    """Return balls about 0."""
    return np.array([wide(0.0, radius) for radius in radii])
