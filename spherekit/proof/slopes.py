"""Slopes of the arms of a saddle, from what bounds the second derivatives around it."""

from collections.abc import Iterator
from typing import final

import numpy as np

from spherekit.proof.balls import Ball, BallMatrix, exact, lower, upper, wide
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
