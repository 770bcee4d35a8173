"""A ball with exactly one solution of the equations in it, by the Newton-Kantorovich test.

With x the centre, Y near the inverse of F'(x), b >= |Y F(x)|, a >= |1 - Y F'(x)| and
k r >= |Y (F'(y) - F'(x))| for all y at most r from x (largest components, row sums),
y - Y F(y) maps that ball into itself and contracts if b + (a + k r) r < r and a + k r < 1.
It then has exactly one fixed point there, at most b / (1 - a - k r) from x, and Y is
regular, so that fixed points are the solutions (L. Kantorovich, 1948; it is R. Krawczyk's
test with the derivative's change bounded by a constant).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.numeric.crossings import wrap
from spherekit.proof.balls import (
    Ball,
    BallMatrix,
    complex_ball,
    exact,
    inverse_near,
    lower,
    matrix,
    middle_of,
    precision,
    upper,
    wide,
)
from spherekit.proof.equations import Equations
from spherekit.sphere.rotation import Floats

WIDEST = 0.0625
"""Largest radius (rad) of a ball looked at: the bounds of the derivatives are for it."""
MARGIN = 4.0
"""A solution is said to be in a ball so much wider than proven, so that others see it."""
STEPS = 80
NEAR_REAL = 1e-6
"""Roots with smaller imaginary parts (rad) are tried as real ones."""


@final
@dataclass(frozen=True)
class Root:
    """Unknown angles with exactly one solution within `unique` of `centre` (rad).

    The solution is within `radius`. `centre` are balls without radius. The solution is
    real if `real` says so, and has an imaginary part if it does not.
    """

    centre: tuple[Ball, ...]
    radius: float
    unique: float
    real: bool

    def balls(self) -> list[Ball]:
        """Return balls of the angles that contain the solution."""
        if self.real:
            return [wide(ball.real, self.radius) for ball in self.centre]
        both = [(ball.real, ball.imag) for ball in self.centre]
        return [
            complex_ball(wide(x, self.radius)) + _i() * wide(y, self.radius)
            for x, y in both
        ]

    def apart(self, other: "Root") -> bool:
        """Return whether two solutions are proven different, up to whole turns."""
        pairs = zip(self.points(), other.points(), strict=True)
        return any(not one.overlaps(two) for one, two in pairs)

    def leads_to(self, near: Sequence[complex]) -> bool:
        """Return whether an approximation is in its ball, whole turns away or not."""
        apart = np.array(near) - [middle_of(angle) for angle in self.centre]
        turned = wrap(apart.real) + 1j * apart.imag
        return bool(np.all(np.abs(turned) < 0.5 * self.unique))

    def holds(self, other: "Root") -> bool:
        """Return whether the solution of another is this one: it is alone around here."""
        pairs = zip(self.centre, other.centre, strict=True)
        return all(upper(a - b) + other.radius < self.unique / 2.0 for a, b in pairs)

    def points(self) -> list[Ball]:
        """Return balls of e^(i angle)."""
        return [(_i() * complex_ball(angle)).exp() for angle in self.balls()]


def _i() -> Ball:
    return complex_ball(1j)


def root_near(
    equations: Equations, driven: Sequence[Ball], near: Sequence[complex]
) -> Root | None:
    """Return the solution next to an approximation, None where nothing is proven.

    `driven` are balls of the inputs.
    """
    x = [complex_ball(complex(angle)) for angle in near]
    for _ in range(STEPS):
        values, first = _at(equations, x, driven)
        change = _step(values, first)
        if change is None:
            return None
        x = [(angle - d).mid() for angle, d in zip(x, change, strict=True)]
        size = max(upper(d) for d in change)
        if size < _unit():
            break
        if not size < 10.0:
            return None
    if max(upper(angle.imag) for angle in x) < NEAR_REAL:
        root = _certified(
            equations, driven, [complex_ball(angle.real) for angle in x], True
        )
        if root is not None:
            return root
    return _certified(equations, driven, x, False)


def _unit() -> float:
    """Return the spacing of centres at the present precision, as a float64 number."""
    return float(2.0 ** (-precision() / 2))


def _at(
    equations: Equations, x: Sequence[Ball], driven: Sequence[Ball]
) -> tuple[BallMatrix, BallMatrix]:
    """Return F (k, 1) and F' (k, k) at balls of the unknowns."""
    values, slopes = equations.arrays([*x, *driven])
    return matrix(values[:, None]), matrix(slopes[:, : equations.unknowns])


def _step(values: BallMatrix, first: BallMatrix) -> list[Ball] | None:
    inverse = inverse_near(first)
    return None if inverse is None else list((inverse * values).entries())


def _certified(
    equations: Equations, driven: Sequence[Ball], x: Sequence[Ball], real: bool
) -> Root | None:
    values, first = _at(equations, x, driven)
    inverse = inverse_near(first)
    if inverse is None:
        return None
    count = equations.unknowns
    miss = np.array([upper(ball) for ball in (inverse * values).entries()])
    rest = (inverse * first).tolist()
    contraction = [
        sum(
            upper(entry - (1 if row == column else 0))
            for column, entry in enumerate(entries)
        )
        for row, entries in enumerate(rest)
    ]
    away = np.array([upper(ball.imag) for ball in x])
    stretch = np.ones(equations.variables)
    stretch[:count] = np.exp(away + 2 * WIDEST)
    _, constant = equations.norms(stretch)
    sums = np.sum(equations.construction.degrees[:, :count], axis=1)
    rows = [[upper(entry) for entry in entries] for entries in inverse.tolist()]
    bend = np.array(rows) @ (constant * sums * sums)
    off = np.max(miss)
    steep, bent = np.array(max(contraction)), np.max(bend)
    unique, slope, good = (item.item() for item in contracted(off, steep, bent, WIDEST))
    if not good:
        return None
    radius = min(max(MARGIN * float(off) / (1.0 - slope), 1e-300), unique)
    if not real and not any(lower(ball.imag) > radius for ball in x):
        return None
    return Root(tuple(x), radius, unique, real)


def contracted(
    miss: Floats, contraction: Floats, bend: Floats, widest: float
) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Return within what a solution is the only one, a + k r there, and if that is proven.

    `miss` is b, `contraction` a and `bend` k of the test.
    """
    up = 1.0 + 1e-12
    miss, contraction, bend = miss * up, contraction * up, bend * up
    unique = np.minimum(widest, 0.5 * (1.0 - contraction) / bend)
    slope = (contraction + bend * unique) * up
    good = np.isfinite(miss) & np.isfinite(bend) & (contraction < 1.0)
    return unique, slope, good & (slope < 1.0) & (miss < unique * (1.0 - slope) / up)


def maps_inside(
    near: BallMatrix, over: BallMatrix, value: BallMatrix, sides: Sequence[float]
) -> bool:
    """Return whether Newton's map with the inverse of `near` takes a box into itself.

    `over` are the slopes anywhere in the box, `value` F at its centre; `sides` are half
    widths. Then F has one zero in the box (R. Krawczyk, 1969).
    """
    inverse = inverse_near(near)
    if inverse is None:
        return False
    one = matrix(
        [[int(row == column) for column in range(len(sides))] for row in range(len(sides))]
    )
    box = matrix([[wide(exact(0.0), side)] for side in sides])
    image = ((one - inverse * over) * box - inverse * value).entries()
    return all(upper(entry.real) < side for entry, side in zip(image, sides, strict=True))
