"""A ball with exactly one solution of the equations in it, by the way that leads there.

Where F' is regular in all of a ball, F has one zero in it at most, as the difference of two
values is a mean of F' times that of the places. From the centre x there is a way on which F
falls evenly to 0, z' = -F'(z)^-1 F(x) (M. Davidenko, 1953). If with balls of F' over the
whole ball its solutions are shorter than the ball's radius, the way ends within, and so
at a zero, at most as far from the centre.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Array
from spherekit.numerics.angles import wrap
from spherekit.proof.arc_equations import Equations
from spherekit.proof.ball_frames import exactly
from spherekit.proof.balls import (
    Ball,
    complex_ball,
    lower,
    middles,
    precision,
    solved,
    upper,
    wide,
)

WIDEST = 0.0625
"""Largest radius (rad) of a ball looked at."""
MARGIN = 4.0
"""A solution is said to be in a ball so much wider than proven, so that others see it."""
STEPS = 80
NEAR_REAL = 1e-6
"""Roots with smaller imaginary parts (rad) are tried as real ones."""


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
        return [_around(angle, self.radius, self.real) for angle in self.centre]

    def apart(self, other: "Root") -> bool:
        """Return whether two solutions are proven different, up to whole turns."""
        return any(
            not one.overlaps(two)
            for one, two in zip(self.points(), other.points(), strict=True)
        )

    def leads_to(self, near: Sequence[complex]) -> bool:
        """Return whether an approximation is in its ball, whole turns away or not."""
        apart = np.array(near) - [complex(angle) for angle in self.centre]
        return bool(np.all(np.abs(wrap(apart.real) + 1j * apart.imag) < 0.5 * self.unique))

    def points(self) -> list[Ball]:
        """Return balls of e^(i angle)."""
        return [(complex_ball(1j) * angle).exp() for angle in self.balls()]


def root_near(
    equations: Equations, driven: Sequence[Ball], near: Sequence[complex]
) -> Root | None:
    """Return the solution next to an approximation, None where nothing is proven.

    `driven` are balls of the inputs.
    """
    x = np.array([complex_ball(angle) for angle in near])
    with suppress(ZeroDivisionError):
        for _ in range(STEPS):
            values, first = _at(equations, x, driven)
            change = _inverse_near(first) @ values
            x = middles(x - change)
            size = max(map(upper, change))
            if size < 2.0 ** (-precision() / 2):
                break
            if not size < 10.0:
                return None
        if max(upper(angle.imag) for angle in x) < NEAR_REAL:
            real = np.array([angle.real for angle in x])
            if root := _certified(equations, driven, real, True):
                return root
        return _certified(equations, driven, x, False)
    return None


def _at(equations: Equations, x: Array, driven: Sequence[Ball]) -> tuple[Array, Array]:
    """Return F (k,) and F' (k, k) at balls of the unknowns."""
    values, slopes = equations.arrays([*x, *driven])
    return values, slopes[:, : equations.unknowns]


def _certified(
    equations: Equations, driven: Sequence[Ball], x: Array, real: bool
) -> Root | None:
    values, first = _at(equations, x, driven)
    degrees = equations.degrees[:, : equations.unknowns]
    growth = np.exp(degrees @ [upper(ball.imag) for ball in x])
    second = equations.bound * growth * np.sum(degrees, axis=1) ** 2
    # where derivatives may have changed by a fifth
    rows = np.vectorize(upper)(_inverse_near(first))
    unique = min(WIDEST, 0.2 / np.max(rows @ second))
    around = np.array([_around(angle, unique, False) for angle in x])
    off = zero_within(values, _at(equations, around, driven)[1])
    radius = min(max(MARGIN * off, 1e-300), unique)
    apart = real or any(lower(ball.imag) > radius for ball in x)
    return Root(tuple(x), radius, unique, real) if off < unique and apart else None


def _around(angle: Ball, radius: float, real: bool) -> Ball:
    """Return the ball of an angle's solution, of real numbers where it is real."""
    if real:
        return wide(angle, radius)
    return complex_ball(wide(angle.real, radius), wide(angle.imag, radius))


def zero_within(values: Array, over: Array) -> float:
    """Return how far from the centre of balls there is a zero of F, infinity if unproven.

    `values` are F at the centre, `over` F' anywhere within the balls. There is just one
    zero in them if they are wider than this.
    """
    try:
        near = _inverse_near(over)
        return max(map(upper, solved(near @ over, near @ values[:, None]).flat))
    except ZeroDivisionError:
        return np.inf


def _inverse_near(square: Array) -> Array:
    """Return a matrix without radii next to the inverse."""
    return np.asarray(middles(solved(middles(square), exactly(np.eye(len(square))))))
