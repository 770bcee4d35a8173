"""One equation in two coordinates for the configurations near a loss of rank.

F are the k equations of a mechanism in v = k + 1 variables z. Where F' loses one rank, let
l be the direction (k,) that F' misses, and u and v two coordinates along the kernel of F'.
The system

    F(z) = g l,   with u and v of z given,

has a regular derivative by (z, g). It defines z and g as functions of u and v, and the
configurations nearby are the zeros of the *reduced equation* g(u, v) = 0 (Lyapunov and
Schmidt). Derivatives of z and g follow from linear equations with one bordered matrix.
Everything is computed in balls.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from spherekit.arrays import Array, Floats
from spherekit.proof.arc_equations import ArcEquations
from spherekit.proof.ball_frames import exact_balls
from spherekit.proof.balls import (
    Ball,
    centre_floats,
    cosines_and_sines,
    exact_centres,
    precision_bits,
    solve_balls,
    widen,
)

MIN_SECOND_SINGULAR_RATIO = 1e-6
"""Smallest relative second-smallest singular value of F' where one rank is lost.

Larger: crossings of badly scaled loops are refused. Smaller: positions that lose two ranks
are tried in vain.
"""

MIN_CURVATURE_RATIO = 1e-6
"""Smallest ratio of the two principal curvatures of g at a saddle.

Larger: crossings at small angles are refused. Smaller: rectangles become so flat that the
test fails anyway.
"""

MAX_CENTRE_DISTANCE_RAD = 0.02
"""Largest change (rad) of a variable from the given position to the critical point of g.

Larger: crossings farther away are found, perhaps of other curves. Smaller: crossings beside
the position where a curve was lost are missed.
"""

MAX_CRITICAL_POINT_STEPS = 12
"""Largest number of Newton steps to the critical point of g.

Larger: positions farther away succeed. Smaller: they fail sooner.
"""

MAX_CRITICAL_STEP_RAD = 0.5
"""Largest Newton step (rad) to the critical point of g; a longer one has diverged.

Larger: diverging iterations end later. Smaller: positions farther away fail.
"""


@dataclass(frozen=True)
class BorderedDerivatives:
    """Derivatives of (z, g) by two coordinates u and v, over a set of points.

    z are all variables of the equations F. Near a loss of rank the derivatives F' miss a
    direction l, and F(z) = g l defines z and the number g as functions of u and v.

    Attributes
    ----------
    first
        (v + 1, 3) derivatives of (z, g), where the last row belongs to g. Column 0 is the
        change while a residual of F is removed, columns 1 and 2 are the derivatives by u
        and by v.
    second
        (v + 1, 3, 3) second derivatives in the same three directions, or None.
    """

    first: Array
    second: Array | None = None

    @property
    def correction(self) -> Array:
        """(v + 1,) change of (z, g) that removes the residual."""
        return self.first[:, 0]

    @property
    def variable_rates(self) -> Array:
        """(v, 2) derivatives of the variables by u and v."""
        return self.first[:-1, 1:]

    @property
    def gradient(self) -> Array:
        """(2,) derivatives of g by u and v."""
        return self.first[-1, 1:]

    @property
    def seconds(self) -> Array:
        """(v + 1, 3, 3) second derivatives, which must have been computed."""
        assert self.second is not None
        return self.second

    @property
    def hessian(self) -> Array:
        """(2, 2) second derivatives of g by u and v."""
        return self.seconds[-1, 1:, 1:]


@dataclass(frozen=True)
class ReducedEquation:
    """The reduced equation g(u, v) = 0 about a centre.

    Near a point where F' loses a rank, let l be the direction that F' misses. With two
    coordinates u and v given, F(z) = g l defines all variables z and the number g. The
    configurations F = 0 are the zeros of g.

    Attributes
    ----------
    equations
        The equations F of the mechanism.
    centre
        (v,) the point (rad) with u = v = 0.
    frame
        (v, v) orthonormal columns: the directions of u, of v, and of the other coordinates.
    missed
        (k,) the unit vector l that F' misses.
    units
        (2,) lengths of u and v, the larger one 1. In these units the two curves of a
        crossing are the diagonals of a square.
    other_curvatures
        (v - 2, 2, 2) magnitudes of the second derivatives of the other coordinates by u
        and v.
    """

    equations: ArcEquations
    centre: Floats
    frame: Floats
    missed: Floats
    units: Floats
    other_curvatures: Floats

    def split_residual(self, position: Array) -> tuple[Ball, Array]:
        """Split the equations F at a position into a multiple of l and a remainder.

        The unit vector l (`missed`) is the direction that the derivatives F' miss.

        Parameters
        ----------
        position
            (v,) balls (rad).

        Returns
        -------
        level
            A ball of radius 0 near the component of F along l. It is close to g.
        residual
            (k,) F less `level` times l.
        """
        (values,) = self.equations.evaluate(position, 0)
        missed = exact_balls(self.missed)
        level = exact_centres(missed @ values)
        return level, values - level * missed

    def differentiate(
        self, positions: Array, residual: Array, order: int = 2
    ) -> BorderedDerivatives:
        """Return derivatives of (z, g) over balls of all variables.

        The equations F(z) = g l, with l = `missed`, define all variables z and the number g
        as functions of two coordinates u and v along the first two columns a, b of `frame`.
        The derivatives solve linear equations with the bordered matrix

            [F'  -l]
            [a^T  0]
            [b^T  0].

        Parameters
        ----------
        positions
            (v,) balls (rad).
        residual
            (k,) balls: the residual of F that the first direction removes.
        order
            1, or 2 for second derivatives as well.

        Raises
        ------
        ZeroDivisionError
            If the bordered matrix may be singular for some point of the balls.
        """
        _, slopes, *curvatures = self.equations.evaluate(positions, order)
        k, v = slopes.shape
        zero = np.zeros((2, 1))
        missed = exact_balls(self.missed)
        kernel = exact_balls(self.frame[:, :2].T)
        bordered = np.block([[slopes, -missed[:, None]], [kernel, zero]])
        # Right-hand sides: remove the residual while u and v are constant; unit rate of u;
        # unit rate of v.
        right_sides = np.block([[-residual[:, None], np.zeros((k, 2))], [zero, np.eye(2)]])
        first = solve_balls(bordered, right_sides)
        if order < 2:
            return BorderedDerivatives(first)
        (curvature,) = curvatures
        # Differentiate F(z) = g l twice: the same matrix, and F''(z', z') on the right.
        right_sides = np.zeros((v + 1, 9), object)
        right_sides[:k] = -(first[:v].T @ curvature @ first[:v]).reshape(k, 9)
        second = solve_balls(bordered, right_sides).reshape(-1, 3, 3)
        return BorderedDerivatives(first, second)

    def find_critical_point(self, position: Array) -> Array:
        """Return the point with F = g l at which both slopes of g by u and v are 0.

        It is computed by Newton's method with the second derivatives of g. No proof depends
        on the accuracy of the point.

        Parameters
        ----------
        position
            (v,) start, balls (rad).

        Returns
        -------
        (v,) balls of radius 0.

        Raises
        ------
        ZeroDivisionError
            If the iteration diverges.
        """
        for _ in range(MAX_CRITICAL_POINT_STEPS):
            _, residual = self.split_residual(position)
            derivatives = self.differentiate(position, residual)
            # Slope of g after the residual is removed: direction 0 of the derivatives
            # removes it, directions 1 and 2 are u and v.
            slope = exact_centres(derivatives.gradient + derivatives.seconds[-1, 0, 1:])
            uv_step = solve_balls(exact_centres(derivatives.hessian), -slope[:, None])[:, 0]
            change = exact_centres(
                derivatives.correction[:-1] + derivatives.variable_rates @ uv_step
            )
            step_size = np.max(np.abs(centre_floats(change)))
            if not step_size < MAX_CRITICAL_STEP_RAD:
                raise ZeroDivisionError
            position = exact_centres(position + change)
            # The last eight bits are rounding.
            if step_size < 2.0 ** (8 - precision_bits()):
                break
        return position

    def enclose_box(self, limits: Floats) -> Array:
        """Return balls (v,) of all variables over a box about the centre.

        `limits` (v,) are its half lengths (rad) along the frame. The balls are slightly
        larger, which covers rounding.
        """
        reach = np.abs(self.frame) @ limits * (1.0 + 1e-9) + 1e-12
        return exact_balls(self.centre) + zero_balls(reach)

    def evaluate_at(
        self, position: Array, level: Ball, correction: Array
    ) -> tuple[Ball, Array]:
        """Return g and its two slopes at the coordinates u and v of a position.

        F(z) = g l defines all variables z and the number g as functions of u and v. The
        exact point (z, g) at the u and v of the position is near the position.

        Parameters
        ----------
        position
            (v,) balls (rad) near F = g l.
        level
            An approximation of g at the position.
        correction
            (v + 1,) balls that contain the difference of the exact (z, g) from `position`
            and `level`.

        Returns
        -------
        The value of g, and its derivatives (2,) by u and v.
        """
        no_residual = 0 * exact_balls(self.missed)
        derivatives = self.differentiate(position + correction[:-1], no_residual, 1)
        return level + correction[-1], derivatives.gradient


def reduce_at_saddle(equations: ArcEquations, position: Floats) -> ReducedEquation:
    """Return the reduced equation about the critical point of g near a position.

    Near a position where the derivatives F' of the equations lose a rank, configurations
    are the zeros of a function g(u, v) of two coordinates (`ReducedEquation`). At the
    critical point both slopes of g are 0. The coordinates u and v are along the principal
    curvatures of g, so that g is convex in u and concave in v.

    Parameters
    ----------
    equations
        The equations of the mechanism.
    position
        (v,) a position (rad) where F' nearly loses a rank.

    Raises
    ------
    ZeroDivisionError
        If there is no critical point nearby, or if g has no saddle there.
    """
    # 1. The critical point, and the derivatives of g there.
    critical_point = _reduce_about(equations, position).find_critical_point(
        exact_balls(position)
    )
    centre = centre_floats(critical_point)
    reduced_equation = _reduce_about(equations, centre)
    _, residual = reduced_equation.split_residual(exact_balls(centre))
    derivatives = reduced_equation.differentiate(exact_balls(centre), residual)

    # 2. Principal curvatures of g, the smaller one first, and their directions. They must
    # have opposite signs and comparable sizes.
    hessian = centre_floats(derivatives.hessian)
    (low, high), vectors = np.linalg.eigh(hessian)
    has_saddle = low < 0.0 < high and min(-low, high) > MIN_CURVATURE_RATIO * max(
        -low, high
    )
    is_near = np.max(np.abs(centre - position)) < MAX_CENTRE_DISTANCE_RAD
    if not (has_saddle and is_near):
        raise ZeroDivisionError

    # 3. Coordinates u along the positive curvature and v along the negative one.
    frame = reduced_equation.frame.copy()
    principal = vectors[:, ::-1]
    frame[:, :2] @= principal
    # In units of 1 / sqrt(curvature) the curves of a crossing are diagonals.
    units = np.array([high, -low]) ** -0.5
    variable_curvatures = centre_floats(derivatives.seconds[:-1, 1:, 1:])
    principal_curvatures = principal.T @ variable_curvatures @ principal
    return replace(
        reduced_equation,
        frame=frame,
        units=units / np.max(units),
        other_curvatures=np.abs(np.tensordot(frame[:, 2:].T, principal_curvatures, 1)),
    )


def _reduce_about(equations: ArcEquations, position: Floats) -> ReducedEquation:
    """Return the reduced equation near a position, in unscaled coordinates.

    The derivatives F' of the equations nearly lose one rank at the position. The singular
    value decomposition of F' gives the direction that F' misses and the directions of the
    two coordinates. `units` and `other_curvatures` are not set yet.

    Parameters
    ----------
    equations
        The equations F of the mechanism.
    position
        (v,) values of all variables (rad).

    Raises
    ------
    ZeroDivisionError
        If F' nearly loses more than one rank.
    """
    circle_points = cosines_and_sines(position[None])
    _, slopes = equations.harmonics.derivatives(circle_points, 1)
    left_vectors, singular_values, right_vectors = np.linalg.svd(slopes[0])
    # All singular values but the last must be clearly different from 0.
    smallest = MIN_SECOND_SINGULAR_RATIO * singular_values[0]
    if not np.all(singular_values[:-1] > smallest):
        raise ZeroDivisionError
    # The last two right singular vectors span the kernel. They become the first two.
    frame = np.roll(right_vectors, 2, axis=0).T
    return ReducedEquation(
        equations=equations,
        centre=position,
        frame=frame,
        missed=left_vectors[:, -1],
        units=np.ones(2),
        other_curvatures=np.ones(0),
    )


def zero_balls(radii: Sequence[float] | Floats) -> Array:
    """Return balls about 0 with these radii."""
    return np.array([widen(0.0, radius) for radius in radii])
