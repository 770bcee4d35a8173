"""Balls that are proven to contain exactly one solution of the equations.

If F' is regular everywhere in a ball, F has at most one zero in it, because the difference
of two values is a mean of F' times the difference of the points. From the centre x there is
a path z' = -F'(z)^-1 F(x) along which F decreases linearly to 0 (M. Davidenko, 1953). If
the balls of F' over the whole ball bound its length by less than the radius, the path ends
inside, at a zero whose distance from the centre has the same bound.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Array
from spherekit.numerics.angles import wrap
from spherekit.proof.arc_equations import ArcEquations
from spherekit.proof.ball_frames import exact_balls
from spherekit.proof.balls import (
    Ball,
    complex_ball,
    exact_centres,
    lower_magnitude,
    precision_bits,
    solve_balls,
    upper_magnitude,
    widen,
)

MAX_UNIQUENESS_RADIUS_RAD = 0.0625
"""Largest radius (rad) of a ball in which a solution is proven to be the only one.

Larger: more tests fail. Smaller: less of the space around a solution is known to be empty.
"""

SOLUTION_MARGIN = 4.0
"""Stated radius of a solution over the proven one.

Larger: solutions that are close are not separated. Smaller: checkers with weaker bounds
cannot repeat the proof.
"""

MAX_ROOT_STEPS = 80
"""Largest number of Newton steps to a solution.

Larger: poor approximations succeed. Smaller: they fail sooner. Double roots need a step for
each bit.
"""

MAX_ROOT_STEP_RAD = 10.0
"""Largest Newton step (rad) to a solution; a longer one has diverged.

Larger: diverging iterations end later. Smaller: poor approximations fail.
"""

REAL_TRIAL_IMAGINARY_RAD = 1e-6
"""Imaginary parts (rad) below which a solution is first tried as a real one.

Larger: more trials in vain. Smaller: real solutions that coincide nearly may be missed.
"""


@dataclass(frozen=True)
class CertifiedRoot:
    """A solution of the equations that is proven to exist and to be the only one nearby.

    The unknowns are angles, which may be complex. A ball is a number with a bound of its
    error.

    Attributes
    ----------
    centre
        Balls of radius 0: an approximation of each unknown angle (rad), real or complex.
    radius
        Largest difference (rad) of the solution from the centre in an angle.
    unique
        A radius (rad) about the centre, in each angle: no other solution is within it.
    real
        True if the solution is proven to be real, False if it is proven not to be.
    """

    centre: tuple[Ball, ...]
    radius: float
    unique: float
    real: bool

    def balls(self) -> list[Ball]:
        """Return balls (rad) of the unknown angles that contain the solution."""
        return [_widen_angle(angle, self.radius, self.real) for angle in self.centre]

    def differs_from(self, other: "CertifiedRoot") -> bool:
        """Return whether two solutions are proven different, modulo turns."""
        return any(
            not point.overlaps(other_point)
            for point, other_point in zip(self.points(), other.points(), strict=True)
        )

    def attracts(self, approximation: Sequence[complex]) -> bool:
        """Return whether an approximation (rad) is within half of `unique`, modulo turns.

        Newton's method from there leads to this solution: within `unique` the derivatives
        change so little that a step at least halves the distance from the solution.
        """
        offset = np.array(approximation) - [complex(angle) for angle in self.centre]
        distance = np.abs(wrap(offset.real) + 1j * offset.imag)
        return bool(np.all(distance < 0.5 * self.unique))

    def points(self) -> list[Ball]:
        """Return e^(i angle) of the unknown angles, as numbers with error bounds."""
        return [(complex_ball(1j) * angle).exp() for angle in self.balls()]


def find_root(
    equations: ArcEquations, known_angles: Sequence[Ball], approximation: Sequence[complex]
) -> CertifiedRoot | None:
    """Return the solution near an approximation, None if none is proven.

    Newton's method improves the approximation, until its steps are negligible or their
    number is `MAX_ROOT_STEPS`. A ball about the result is then proven to contain exactly
    one solution, or the result is None. A ball is a number, here a complex angle, with a
    bound of its error.

    Parameters
    ----------
    equations
        The equations of the mechanism.
    known_angles
        Balls (rad) of all variables that are not unknown.
    approximation
        The unknown angles (rad).
    """
    x = np.array([complex_ball(angle) for angle in approximation])
    with suppress(ZeroDivisionError):
        for _ in range(MAX_ROOT_STEPS):
            values, slopes = _evaluate(equations, x, known_angles)
            change = _approximate_inverse(slopes) @ values
            x = exact_centres(x - change)
            step_size = max(map(upper_magnitude, change))
            # Newton's method doubles the digits: after this step all are correct.
            if step_size < 2.0 ** (-precision_bits() / 2):
                break
            # A long step shows that the iteration has diverged. The negated comparison is
            # also true for NaN.
            if not step_size < MAX_ROOT_STEP_RAD:
                return None
        # If all imaginary parts are nearly 0, a real solution is tried first.
        largest_imaginary = max(upper_magnitude(angle.imag) for angle in x)
        if largest_imaginary < REAL_TRIAL_IMAGINARY_RAD:
            real_parts = np.array([angle.real for angle in x])
            if root := _certify_root(equations, known_angles, real_parts, real=True):
                return root
        return _certify_root(equations, known_angles, x, real=False)
    return None


def _evaluate(
    equations: ArcEquations, x: Array, known_angles: Sequence[Ball]
) -> tuple[Array, Array]:
    """Return F (k,) and F' (k, k) by the unknowns, at values x (k,) of the unknowns.

    All numbers are balls, which are numbers with a bound of their error.
    """
    values, slopes = equations.evaluate([*x, *known_angles])
    return values, slopes[:, : equations.unknown_count]


def _certify_root(
    equations: ArcEquations, known_angles: Sequence[Ball], x: Array, real: bool
) -> CertifiedRoot | None:
    """Return the solution near an approximation x, None if it is not proven.

    F are the equations and F' their derivatives by the unknown angles. The proof has three
    steps:

    1. Choose the radius ``unique`` of a ball about x, so small that F' should change by at
       most a fifth in it: |F'(x)^-1 (F'(z) - F'(x))| <= 1/5. The proof does not rely on
       this.
    2. Evaluate F' in the whole ball. This bounds the ``distance`` of a solution from x.
    3. If the distance is less than ``unique``, the ball contains exactly one solution.

    Parameters
    ----------
    equations
        The equations of the mechanism.
    known_angles
        Balls (rad) of all variables that are not unknown.
    x
        (k,) balls of radius 0: the approximation, real or complex.
    real
        Whether x is real. The solution is then real as well: its conjugate is a solution in
        the same ball, which has one solution only. If x is not real, the result has to be
        proven not to be real: some angle must have an imaginary part larger than the radius
        of the ball.
    """
    values, slopes = _evaluate(equations, x, known_angles)
    # 1. An equation is a trigonometric polynomial with a degree in each angle. At real
    # angles, its second derivative by the angles i and j is at most C d_i d_j, with the
    # degrees d and a constant C, the derivative bound. The sum of all second derivatives is
    # at most C (sum of d)^2. Imaginary parts of x increase it exponentially.
    degrees = equations.degrees[:, : equations.unknown_count]
    growth = np.exp(degrees @ [upper_magnitude(ball.imag) for ball in x])
    second_bound = equations.derivative_bound * growth * np.sum(degrees, axis=1) ** 2
    inverse_size = np.vectorize(upper_magnitude)(_approximate_inverse(slopes))
    unique = min(MAX_UNIQUENESS_RADIUS_RAD, 0.2 / np.max(inverse_size @ second_bound))
    # 2. F' in the whole ball, and the bound of the distance.
    unique_balls = np.array([_widen_angle(angle, unique, real=False) for angle in x])
    slopes_around = _evaluate(equations, unique_balls, known_angles)[1]
    distance = bound_zero_distance(values, slopes_around)
    # 3. The radius that is stated for the solution is `SOLUTION_MARGIN` times the distance,
    # so that a checking program can repeat the proof if its bounds are a little larger. It
    # is at least 1e-300, not 0.
    radius = min(max(SOLUTION_MARGIN * distance, 1e-300), unique)
    is_decided = real or any(lower_magnitude(ball.imag) > radius for ball in x)
    if not (distance < unique and is_decided):
        return None
    return CertifiedRoot(centre=tuple(x), radius=radius, unique=unique, real=real)


def _widen_angle(angle: Ball, radius: float, real: bool) -> Ball:
    """Return the ball of a radius (rad) about an angle, of real numbers only if `real`."""
    if real:
        return widen(angle, radius)
    return complex_ball(widen(angle.real, radius), widen(angle.imag, radius))


def bound_zero_distance(values: Array, slopes: Array) -> float:
    """Return a bound of the distance of a zero of F from the centre of balls.

    By the mean value theorem, a zero z has the distance z - x = -(F')^-1 F(x) from the
    centre x, for some F' in the balls. The bound is the largest component of
    (Y F')^-1 Y F(x) for all F' in the balls, where Y is an approximate inverse of F'. If
    the radii of the balls exceed the bound, the balls contain exactly one zero (interval
    Newton method, Moore).

    Parameters
    ----------
    values
        (k,) balls: F at the centre.
    slopes
        (k, k) balls: F' anywhere in the balls.

    Returns
    -------
    The bound (rad), infinity if F' may be singular in the balls.
    """
    # A matrix that may be singular raises ZeroDivisionError.
    try:
        inverse = _approximate_inverse(slopes)
        steps = solve_balls(inverse @ slopes, inverse @ values[:, None])
        return max(map(upper_magnitude, steps.flat))
    except ZeroDivisionError:
        return np.inf


def _approximate_inverse(square: Array) -> Array:
    """Return balls of radius 0 near the inverse of a square matrix of balls."""
    identity = exact_balls(np.eye(len(square)))
    return np.asarray(exact_centres(solve_balls(exact_centres(square), identity)))
