"""One equation in two coordinates for the configurations near a loss of rank.

F are the k equations of a mechanism in n = k + 1 variables z. Where F' loses one rank, let
l (k,) be the direction in which no small change of z changes F, l F' = 0, and u and v two
coordinates along the kernel of F'. The system

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

    F(z) = 0 are the k = n - 1 equations of a mechanism in n variables z. Near a loss of
    rank no small change of z changes F in a direction l (k,). Two coordinates u = a . z and
    v = b . z, with constant vectors a and b, are therefore given. The n + 1 equations
    F(z) = g l, a . z = u and b . z = v then define the n variables z and the number g.

    The derivatives are balls (numbers with error bounds). If z is given as balls, they
    contain the derivatives at all points of these balls.

    Attributes
    ----------
    first
        (n + 1, 3) derivatives of (z, g), where the last row belongs to g. Columns 1 and 2
        are the derivatives by u and by v. Column 0 is the Newton step that removes a given
        residual F(z) - g l while u and v are constant.
    second
        (n + 1, 3, 3) second derivatives of (z, g) in the same three directions, or None.
    """

    first: Array
    second: Array | None = None

    @property
    def correction(self) -> Array:
        """(n + 1,) change of (z, g) that removes the residual."""
        return self.first[:, 0]

    @property
    def variable_rates(self) -> Array:
        """(n, 2) derivatives of the variables by u and v."""
        return self.first[:-1, 1:]

    @property
    def gradient(self) -> Array:
        """(2,) derivatives of g by u and v."""
        return self.first[-1, 1:]

    @property
    def seconds(self) -> Array:
        """(n + 1, 3, 3) second derivatives, which must have been computed."""
        assert self.second is not None
        return self.second

    @property
    def hessian(self) -> Array:
        """(2, 2) second derivatives of g by u and v."""
        return self.seconds[-1, 1:, 1:]


@dataclass(frozen=True)
class ReducedEquation:
    """The reduced equation g(u, v) = 0 about a centre.

    Near a point where F' loses a rank, let l be the direction in which no small change of z
    changes F: l F' = 0. With two coordinates u and v given, F(z) = g l defines all
    variables z and the number g. The configurations F = 0 are the zeros of g.

    Attributes
    ----------
    equations
        The equations F of the mechanism.
    centre
        (n,) the point (rad) with u = v = 0.
    frame
        (n, n) orthonormal columns: the directions of u, of v, and of the other coordinates.
    left_null_vector
        (k,) the unit vector l with l F' = 0, nearly: the direction in which F' cannot
        change F.
    units
        (2,) lengths of u and v, the larger one 1. In these units the two curves of a
        crossing are the diagonals of a square.
    other_curvatures
        (n - 2, 2, 2) magnitudes of the second derivatives of the other coordinates by u
        and v.
    """

    equations: ArcEquations
    centre: Floats
    frame: Floats
    left_null_vector: Floats
    units: Floats
    other_curvatures: Floats

    def split_residual(self, position: Array) -> tuple[Ball, Array]:
        """Split the equations F at a position z: F(z) = g l + residual.

        The unit vector l is the direction in which the derivatives F' cannot change F. A
        change of z can therefore remove the residual, but not g l. Where the residual is 0
        and g is 0, z is a configuration.

        Parameters
        ----------
        position
            (n,) values z of the variables, balls (rad).

        Returns
        -------
        level
            The number g, a ball of radius 0: the component of F along l, rounded.
        residual
            (k,) F(z) - g l, with the errors of F. It also has what was rounded off from g,
            so the sum is exact.
        """
        (values,) = self.equations.evaluate(position, 0)
        left_null_vector = exact_balls(self.left_null_vector)
        level = exact_centres(left_null_vector @ values)
        return level, values - level * left_null_vector

    def differentiate(
        self, positions: Array, residual: Array, order: int = 2
    ) -> BorderedDerivatives:
        """Return derivatives of the variables z and of a number g, over balls of z.

        F(z) = 0 are the equations of the mechanism. Near a loss of rank no small change of
        z changes F in a direction l: l F' = 0, nearly. The equations F(z) = g l define all
        variables z and the number g as functions of two coordinates u = a . z and
        v = b . z. Here a and b are the first two columns of `frame`. Configurations F = 0
        are the zeros of g(u, v). The derivatives solve linear equations with the bordered
        matrix

            [F'  -l]
            [a^T  0]
            [b^T  0].

        There are three right sides, which give derivatives in three directions. Directions
        1 and 2 are unit rates of u and of v. Direction 0 is a step of Newton's method: u
        and v are constant, and the residual F(z) - g l falls to 0 linearly. The mixed
        second derivatives by directions 0 and 1 or 2 tell how this step changes the slopes
        of g (`find_critical_point`).

        Parameters
        ----------
        positions
            (n,) values of z (rad), as balls: each is a number with a bound of its error.
            The results apply to all points of the balls.
        residual
            (k,) balls: the residual F(z) - g l that is to be removed.
        order
            1, or 2 for second derivatives as well.

        Raises
        ------
        ZeroDivisionError
            If the bordered matrix may be singular for some point of the balls.
        """
        _, slopes, *curvatures = self.equations.evaluate(positions, order)
        k, variable_count = slopes.shape
        zero = np.zeros((2, 1))
        left_null_vector = exact_balls(self.left_null_vector)
        coordinate_rows = exact_balls(self.frame[:, :2].T)  # a and b
        bordered = np.block([[slopes, -left_null_vector[:, None]], [coordinate_rows, zero]])
        # One column for each direction.
        right_sides = np.block([[-residual[:, None], np.zeros((k, 2))], [zero, np.eye(2)]])
        first = solve_balls(bordered, right_sides)
        if order < 2:
            return BorderedDerivatives(first)
        (curvature,) = curvatures
        # Differentiate F(z) = g l twice, in each of the 9 pairs of directions. In direction
        # 0 the equation is F(z) = g l + residual, whose last term is linear and drops out.
        # The matrix is the same, and the right side is -F''(z', z').
        z_rates = first[:variable_count]
        right_sides = np.zeros((variable_count + 1, 9), object)
        right_sides[:k] = -(z_rates.T @ curvature @ z_rates).reshape(k, 9)
        second = solve_balls(bordered, right_sides).reshape(-1, 3, 3)
        return BorderedDerivatives(first, second)

    def find_critical_point(self, position: Array) -> Array:
        """Return the critical point of g(u, v) near a position.

        F(z) = 0 are the equations of the mechanism. Near the position no small change of z
        changes F in a direction l (`left_null_vector`). Let two coordinates u and v be
        given: the components of z along the first two columns of `frame`. Then F(z) = g l
        defines all variables z and a number g. At the critical point both derivatives of g
        by u and v are 0. If g is also 0 at this point, curves of configurations cross in
        it.

        Newton's method solves the equations F(z) = g l and grad g = 0 together. Proofs only
        use boxes about the point, so they do not depend on its accuracy.

        Parameters
        ----------
        position
            (n,) start, balls (rad).

        Returns
        -------
        (n,) the variables (rad) at the critical point, as balls of radius 0.

        Raises
        ------
        ZeroDivisionError
            If the iteration diverges, or a matrix is singular.
        """
        for _ in range(MAX_CRITICAL_POINT_STEPS):
            # 1. Newton step for F(z) = g l at constant u and v: the `correction` of z and g
            # removes the residual of this equation.
            _, residual = self.split_residual(position)
            derivatives = self.differentiate(position, residual)
            # The correction changes grad g, to first order, by mixed second derivatives of
            # g: in the direction of the correction and by u and v. `seconds` has a row for
            # each variable and, as the last one, for g. Its other two axes are directions:
            # 0 is the correction, 1 and 2 are u and v.
            change_of_gradient = derivatives.seconds[-1, 0, 1:]
            gradient = exact_centres(derivatives.gradient + change_of_gradient)
            # 2. Newton step of u and v for grad g = 0, and the change of all variables by
            # both steps.
            uv_step = solve_balls(exact_centres(derivatives.hessian), -gradient[:, None])
            uv_step = uv_step[:, 0]
            change = exact_centres(
                derivatives.correction[:-1] + derivatives.variable_rates @ uv_step
            )
            step_size = np.max(np.abs(centre_floats(change)))
            if not step_size < MAX_CRITICAL_STEP_RAD:
                raise ZeroDivisionError
            position = exact_centres(position + change)
            # The last eight bits of the numbers may be rounding errors, so that smaller
            # steps are not possible.
            if step_size < 2.0 ** (8 - precision_bits()):
                break
        return position

    def enclose_box(self, limits: Floats) -> Array:
        """Return balls (n,) of all variables over a box about the centre.

        `limits` (n,) are its half lengths (rad) along the frame. The balls are slightly
        larger, which covers rounding.
        """
        reach = np.abs(self.frame) @ limits * (1.0 + 1e-9) + 1e-12
        return exact_balls(self.centre) + zero_balls(reach)

    def evaluate_at(
        self, position: Array, level: Ball, correction: Array
    ) -> tuple[Ball, Array]:
        """Return balls that contain g(u, v) and its slopes at the u and v of a position.

        The function g replaces the equations F(z) = 0 of the mechanism near a point where
        F' loses a rank: its zeros are the configurations. Near this point no small change
        of the variables z changes F in a direction l (the left null vector of F'). The
        coordinates u and v are the components of z along the first two columns of `frame`.
        For given u and v, the equation F(z) = g l defines all variables z and the number g.

        A ball is a number with a bound of its error.

        Parameters
        ----------
        position
            (n,) balls (rad): approximate variables z, with F(z) = g l up to a residual.
        level
            An approximation of g at the position.
        correction
            (n + 1,) balls. They contain what has to be added to `position` and `level` to
            obtain the exact z and g at the same u and v.

        Returns
        -------
        The value of g, and its derivatives (2,) by u and v.
        """
        # Balls that contain the exact z and g.
        enclosed_position = position + correction[:-1]
        enclosed_level = level + correction[-1]
        # `differentiate` also computes the step that removes a residual F(z) - g l. That
        # step is not used here, so the residual is 0.
        no_residual = exact_balls(np.zeros(len(self.left_null_vector)))
        derivatives = self.differentiate(enclosed_position, no_residual, order=1)
        return enclosed_level, derivatives.gradient


def reduce_at_saddle(equations: ArcEquations, position: Floats) -> ReducedEquation:
    """Return the reduced equation about the critical point of g near a position.

    Near a position where the derivatives F' of the equations lose a rank, configurations
    are the zeros of a function g(u, v) of two coordinates (`ReducedEquation`). At the
    critical point both slopes of g are 0. The coordinates u and v are along the principal
    curvatures of g, so that g is convex in u and concave in v. The zeros of g near such a
    saddle are two curves that cross, or nearly cross.

    Parameters
    ----------
    equations
        The equations of the mechanism.
    position
        (n,) a position (rad) where F' nearly loses a rank.

    Raises
    ------
    ZeroDivisionError
        If there is no critical point nearby, or if g has no saddle there. Singular matrices
        raise the same error, so that callers treat all failures alike.
    """
    # 1. The critical point, and the derivatives of g there. The residual is the remainder
    # of the equations beside g l, nearly 0.
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
    # In units of 1 / sqrt(curvature), g is (u^2 - v^2) / 2 plus a constant, to second
    # order. The curves of a crossing are then the diagonals of a square. Only the ratio of
    # the units matters.
    units = np.array([high, -low]) ** -0.5
    # Second derivatives of the variables by u and v, then those of the coordinates of
    # `frame` other than u and v. They tell how far the curves leave the plane of u and v.
    # In `seconds`, the last row belongs to g, and index 0 of the other axes to a direction
    # in which u and v are constant.
    variable_curvatures = centre_floats(derivatives.seconds[:-1, 1:, 1:])
    principal_curvatures = principal.T @ variable_curvatures @ principal
    return replace(
        reduced_equation,
        frame=frame,
        units=units / np.max(units),
        other_curvatures=np.abs(np.tensordot(frame[:, 2:].T, principal_curvatures, 1)),
    )


def _reduce_about(equations: ArcEquations, position: Floats) -> ReducedEquation:
    """Return a preliminary reduced equation g(u, v) = 0 near a position.

    The mechanism has n - 1 equations F(z) = 0 in n variables z. Near the position their
    derivatives F' lose one rank: no small change of z changes F in a direction l. All
    components of F but that along l can be made zero, if two coordinates u and v of z are
    given. F(z) = g l then defines z and g as functions of u and v (Liapunov-Schmidt
    reduction). Configurations are the zeros of g(u, v).

    The singular value decomposition of F' gives these directions. The last left vector is
    l. F' has the rank n - 2, so its kernel has two dimensions. The last two right vectors
    span it, and are the directions of u and v.

    The result is preliminary: the caller turns u and v into the directions in which g has
    its largest and smallest curvature. It then sets `units` and `other_curvatures`, which
    have no meaning here.

    Parameters
    ----------
    equations
        The equations F of the mechanism.
    position
        (n,) values of all variables (rad).

    Raises
    ------
    ZeroDivisionError
        If F' nearly loses more than one rank. Singular matrices raise the same error, so
        that callers treat all failures alike.
    """
    circle_points = cosines_and_sines(position[None])
    _, slopes = equations.harmonics.derivatives(circle_points, 1)
    left_vectors, singular_values, right_vectors = np.linalg.svd(slopes[0])
    # All singular values but the last must be clearly different from 0.
    smallest = MIN_SECOND_SINGULAR_RATIO * singular_values[0]
    if not np.all(singular_values[:-1] > smallest):
        raise ZeroDivisionError
    # The last two right singular vectors span the kernel. They become the first two
    # columns. The n - 2 others are the further coordinates.
    frame = np.roll(right_vectors, 2, axis=0).T
    return ReducedEquation(
        equations=equations,
        centre=position,
        frame=frame,
        left_null_vector=left_vectors[:, -1],
        units=np.ones(2),
        other_curvatures=np.ones(0),
    )


def zero_balls(radii: Sequence[float] | Floats) -> Array:
    """Return balls about 0 with these radii."""
    return np.array([widen(0.0, radius) for radius in radii])
