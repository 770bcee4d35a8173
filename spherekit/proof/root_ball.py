"""Balls that are proven to contain exactly one solution of the equations.

If all matrices in the balls of F' over a whole ball are regular, F has at most one zero in
it, because the difference of two values is a mean of F' times the difference of the points.
From the centre x there is a path z' = -F'(z)^-1 F(x) along which F decreases linearly to 0
(M. Davidenko, 1953). If the balls of F' bound its length by less than the radius, the path
ends inside, at a zero. The distance of this zero from the centre has the same bound.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Array, Floats
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

    The unknowns are angles, real or complex. A ball is a number with a bound of its error.

    Attributes
    ----------
    centre
        Approximate unknown angles (rad), real or complex, as balls of radius 0.
    radius
        Bound (rad) of the difference between the solution and the centre, in each angle.
    unique
        Radius (rad) about the centre, in each angle, within which there is no other
        solution.
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
        """Return whether two solutions are proven to differ by more than whole turns."""
        return any(
            not point.overlaps(other_point)
            for point, other_point in zip(self.points(), other.points(), strict=True)
        )

    def attracts(self, approximation: Sequence[complex]) -> bool:
        """Return whether an approximation (rad) is so near that Newton's method leads here.

        `approximation` has the complex angles of the unknowns. From distances below half of
        `unique`, Newton's method is expected to lead to this root, up to whole turns.
        """
        offset = np.array(approximation) - [complex(angle) for angle in self.centre]
        distance = np.abs(wrap(offset.real) + 1j * offset.imag)
        return bool(np.all(distance < 0.5 * self.unique))

    def points(self) -> list[Ball]:
        """Return e^(i angle) of the unknown angles, as balls that contain the solution."""
        return [(complex_ball(1j) * angle).exp() for angle in self.balls()]


def find_root(
    equations: ArcEquations, known_angles: Sequence[Ball], approximation: Sequence[complex]
) -> CertifiedRoot | None:
    """Return the solution of the equations near an approximation, None if none is proven.

    Newton's method improves the approximation. Then a ball about the result is proven to
    contain exactly one solution. A ball is a number, here a complex angle, with a bound of
    its error.

    Parameters
    ----------
    equations
        The equations of the mechanism.
    known_angles
        The given variables (rad), such as inputs, in balls.
    approximation
        Approximate values of the unknown angles (rad).
    """
    start = np.array([complex_ball(angle) for angle in approximation])
    # A matrix that may be singular raises this error; then nothing is proven.
    try:
        x = _improve_root(equations, known_angles, start)
        if x is None:
            return None
        # A solution that looks real is first proven as a real one.
        largest_imaginary = max(upper_magnitude(angle.imag) for angle in x)
        if largest_imaginary < REAL_TRIAL_IMAGINARY_RAD:
            real_parts = np.array([angle.real for angle in x])
            real_root = _certify_root(equations, known_angles, real_parts, real=True)
            if real_root is not None:
                return real_root
        return _certify_root(equations, known_angles, x, real=False)
    except ZeroDivisionError:
        return None


def _improve_root(
    equations: ArcEquations, known_angles: Sequence[Ball], start: Array
) -> Array | None:
    """Return an approximate solution by Newton's method, None if it diverges.

    The method stops at a negligible step, or after `MAX_ROOT_STEPS` steps. A ball is a
    number with a bound of its error.

    Parameters
    ----------
    equations
        The equations of the mechanism.
    known_angles
        The given variables (rad), such as inputs, in balls.
    start
        (k,) approximate unknown angles (rad), complex, as balls of radius 0.

    Returns
    -------
    (k,) the unknown angles (rad), as balls of radius 0.
    """
    # Each step doubles the number of correct digits. After a step below this, all are
    # correct.
    last_step_rad = 2.0 ** (-precision_bits() / 2)
    x = start
    for _ in range(MAX_ROOT_STEPS):
        values, slopes = _evaluate(equations, x, known_angles)
        change = _approximate_inverse(slopes) @ values
        x = exact_centres(x - change)
        step_size = max(map(upper_magnitude, change))
        if step_size < last_step_rad:
            break
        # The negated comparison is also true for NaN.
        if not step_size < MAX_ROOT_STEP_RAD:
            return None
    return x


def _evaluate(
    equations: ArcEquations, x: Array, known_angles: Sequence[Ball]
) -> tuple[Array, Array]:
    """Return the closure equations F (k,) and their derivatives F' (k, k) at unknowns x.

    x (k,) are values of the unknown angles (rad). F is differentiated with respect to these
    angles. `known_angles` are the angles of inputs and wheels. All numbers are balls, which
    are numbers with a bound of their error.
    """
    values, slopes = equations.evaluate([*x, *known_angles])
    return values, slopes[:, : equations.unknown_count]


def _certify_root(
    equations: ArcEquations, known_angles: Sequence[Ball], x: Array, real: bool
) -> CertifiedRoot | None:
    """Return the solution near an approximation x, None if it is not proven.

    A ball about x is chosen (an interval for each angle). Derivatives in the whole ball
    bound the distance of a solution from x. If this bound is less than the radius, the ball
    contains exactly one solution (interval Newton method).

    Parameters
    ----------
    equations
        The equations of the mechanism.
    known_angles
        The given variables (rad), such as inputs, in balls.
    x
        (k,) the approximation (rad), real or complex, as balls of radius 0.
    real
        Whether x is real. If so, the solution is proven to be real, because its conjugate
        is a solution in the same ball. If x is not real, the solution must be proven not to
        be real: some imaginary part exceeds the radius of the solution.
    """
    values, slopes = _evaluate(equations, x, known_angles)
    # Radius of the ball in which the solution is proven to be the only one.
    unique_radius = _choose_uniqueness_radius(equations, x, slopes)
    # The ball contains complex numbers even if x is real, so that no other complex solution
    # is near.
    balls_about_x = np.array(
        [_widen_angle(angle, unique_radius, real=False) for angle in x]
    )
    _values, slopes_in_ball = _evaluate(equations, balls_about_x, known_angles)
    distance = bound_zero_distance(values, slopes_in_ball)
    if not distance < unique_radius:
        return None
    # Another program that checks the proof may find a larger distance. So the radius of the
    # solution gets a margin. The radius must not be 0.
    with_margin = max(SOLUTION_MARGIN * distance, 1e-300)
    radius = min(with_margin, unique_radius)
    is_proven_complex = any(lower_magnitude(ball.imag) > radius for ball in x)
    if not (real or is_proven_complex):
        return None
    return CertifiedRoot(centre=tuple(x), radius=radius, unique=unique_radius, real=real)


def _choose_uniqueness_radius(equations: ArcEquations, x: Array, slopes: Array) -> float:
    """Return the radius (rad) of a ball about x in which F' should change little.

    F are the equations, F' their derivatives with respect to the unknown angles, and Y
    approximates the inverse of F' at x. In a ball of radius r, Y F' should change by at
    most 1/5, because the proof of a unique solution needs small changes:

        |Y (F'(z) - F'(x))| <= |Y| r (sum of all |F''| of each equation) <= 1/5.

    The sum has the absolute values of all second derivatives of an equation. They are taken
    at x, so the estimate is rough. The proof itself computes F' in the ball, and is valid
    for any r.

    Parameters
    ----------
    equations
        The equations of the mechanism.
    x
        (k,) the centre (rad), real or complex, as balls of radius 0.
    slopes
        (k, k) derivatives F' at x, in balls (numbers with a bound of their error).
    """
    second_derivatives = _bound_sum_of_second_derivatives(equations, x)
    inverse_size = np.vectorize(upper_magnitude)(_approximate_inverse(slopes))
    radius = 0.2 / np.max(inverse_size @ second_derivatives)
    return min(MAX_UNIQUENESS_RADIUS_RAD, radius)


def _bound_sum_of_second_derivatives(equations: ArcEquations, x: Array) -> Floats:
    """Return for each equation a bound (k,) of its summed second derivatives at x.

    The absolute values of all second derivatives are summed. The caller derives from the
    bound how far from x the first derivatives change little.

    An equation is a trigonometric polynomial of degree d_i in angle i. At real angles its
    second derivative with respect to the angles i and j has at most the size C d_i d_j,
    with a constant C (`derivative_bound`). The sum over all i and j is at most
    C (sum of d_i)^2. Complex angles, with imaginary parts y_i, increase the bound by the
    factor exp(sum of d_i ``|y_i|``).

    Parameters
    ----------
    equations
        The equations of the mechanism.
    x
        (k,) the unknown angles (rad), real or complex: balls (numbers with a bound of their
        error) of radius 0.
    """
    # The unknowns are the first of the variables.
    degrees = equations.degrees[:, : equations.unknown_count]
    imaginary_sizes = [upper_magnitude(ball.imag) for ball in x]
    growth = np.exp(degrees @ imaginary_sizes)
    return equations.derivative_bound * growth * np.sum(degrees, axis=1) ** 2


def _widen_angle(angle: Ball, radius: float, real: bool) -> Ball:
    """Return the ball of a radius (rad) about an angle, of real numbers only if `real`."""
    if real:
        return widen(angle, radius)
    return complex_ball(widen(angle.real, radius), widen(angle.imag, radius))


def bound_zero_distance(values: Array, slopes: Array) -> float:
    """Return a bound of the distance of a zero of F from the centre of a box.

    F is a function of k variables. If the half widths of the box exceed the bound, the box
    contains exactly one zero (interval Newton method, Moore). Values are balls: numbers
    with a bound of their error.

    By the mean value theorem, a zero z and the centre x satisfy z - x = -(F')^-1 F(x),
    where each row of F' is taken at some point of the box. The result is the largest
    component of (Y F')^-1 Y F(x) for all F' in the box. Y approximates the inverse of F' at
    the centre, so that Y F' is near the identity.

    Parameters
    ----------
    values
        (k,) values F(x) at the centre, as balls.
    slopes
        (k, k) balls that contain the derivatives F' everywhere in the box.

    Returns
    -------
    The bound (rad). Infinity if F' may be singular.
    """
    # A matrix that may be singular raises ZeroDivisionError.
    try:
        inverse_of_centre = _approximate_inverse(slopes)
        steps = solve_balls(inverse_of_centre @ slopes, inverse_of_centre @ values[:, None])
        return max(map(upper_magnitude, steps.flat))
    except ZeroDivisionError:
        return np.inf


def _approximate_inverse(square: Array) -> Array:
    """Return balls of radius 0 near the inverse of a square matrix of balls."""
    identity = exact_balls(np.eye(len(square)))
    return np.asarray(exact_centres(solve_balls(exact_centres(square), identity)))
