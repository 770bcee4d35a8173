"""One equation in two coordinates for the configurations near a loss of rank.

F are the k equations of a mechanism in n = k + 1 variables z. Where F' loses one rank, let
l (k,) be the direction in which no small change of z changes F, l F' = 0, and u and v two
coordinates along the kernel of F'. The system

    F(z) = g l,   with u and v of z given,

has a regular derivative with respect to (z, g). It defines z and g as functions of u and v,
and the configurations nearby are the zeros of the *reduced equation* g(u, v) = 0 (Lyapunov
and Schmidt). Derivatives of z and g follow from linear equations with one bordered matrix.
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

CRITICAL_POINT_ROUNDING_BITS = 8
"""Last bits of a number that may be rounding errors, so that Newton's method ends.

Larger: less accurate critical points. Smaller: steps that are only rounding are made.
"""


@dataclass(frozen=True)
class SurfaceDerivatives:
    """First derivatives of a surface of positions near a loss of rank, as balls.

    Balls are numbers with a bound of their error. F(z) = 0 are the n - 1 equations of a
    mechanism in n variables z. Near a crossing of curves, the derivatives F' are nearly
    singular: l F' is nearly 0 for a constant unit vector l. So small changes of z hardly
    change the component of F along l. The equations F(z) = g l leave this component free.
    Its value g is a new unknown number, the level.

    These n - 1 equations have n + 1 unknowns, z and g. Two more equations give the values
    of two coordinates u and v of z, which are linear functions of z. Then z and g are
    determined, so they are functions of u and v. The points z form a surface. The
    configurations are the points of the surface with g = 0.

    Attributes
    ----------
    variable_rates
        (n, 2) derivatives of the variables z with respect to u and v.
    gradient
        (2,) derivatives of g with respect to u and v.
    correction
        (n,) change of the variables by a step of Newton's method with constant u and v. The
        step leads from a point z beside the surface to the surface, and removes the error
        F(z) - g l.
    level_correction
        Change of g by the same step.
    """

    variable_rates: Array
    gradient: Array
    correction: Array
    level_correction: Ball


@dataclass(frozen=True)
class SurfaceCurvatures:
    """Second derivatives of a surface of positions near a loss of rank, as balls.

    Balls are numbers with a bound of their error. `SurfaceDerivatives` explains the
    surface, its coordinates u and v, the variables z and the level g.

    The second derivatives are used to find the point where the gradient of g is 0. Only
    there can curves g = 0 cross. The signs and sizes of these derivatives also give the
    directions of the curves at a crossing.

    Attributes
    ----------
    variable_curvatures
        (n, 2, 2) second derivatives of the variables z with respect to u and v.
    hessian
        (2, 2) second derivatives of g with respect to u and v.
    gradient_correction
        (2,) change of the gradient of g between two points. The first one is the point z at
        which the derivatives are computed. It may be a little beside the surface. A step of
        Newton's method with constant u and v leads to the second point, on the surface. The
        gradient at the first point plus this change is nearly the gradient on the surface.
    """

    variable_curvatures: Array
    hessian: Array
    gradient_correction: Array


@dataclass(frozen=True)
class ReducedEquation:
    """The reduced equation: one equation in two coordinates, near a crossing of curves.

    F(z) = 0 are the k = n - 1 equations of a mechanism in n variables z. At a centre c, the
    derivatives F' are nearly singular: l F' is nearly 0 for a constant unit vector l. So
    small changes of z hardly change the component of F along l. The equations F(z) = g l
    leave this component free. Its value g is a new unknown number, the level. Two linear
    functions u and v of z are given as well, with unit vectors a and b. The n + 1 equations

        F(z) = g l,   a . (z - c) = u,   b . (z - c) = v

    define the n variables z and the number g as functions of u and v. The configurations
    are the points z with g(u, v) = 0, the reduced equation (Lyapunov-Schmidt reduction).

    Attributes
    ----------
    equations
        The equations F of the mechanism.
    centre
        (n,) the point (rad) with u = v = 0.
    frame
        (n, n) orthonormal columns: the direction a of u, the direction b of v, and the
        directions of the remaining coordinates.
    left_null_vector
        (k,) the unit vector l.
    """

    equations: ArcEquations
    centre: Floats
    frame: Floats
    left_null_vector: Floats

    def split_residual(self, position: Array) -> tuple[Ball, Array]:
        """Split the error of the equations at a position into a level and a residual.

        F(z) = 0 are the equations of a mechanism in the variables z. Near a crossing of
        curves, small changes of z hardly change the component of F along a constant unit
        vector l (`left_null_vector`). The level g is this component: F(z) = g l + residual.
        The residual has nearly no component along l, so a step of Newton's method can
        remove it.

        Parameters
        ----------
        position
            (n,) values z of the variables (rad), in balls (numbers with a bound of their
            error).

        Returns
        -------
        level
            The number g, the rounded component of F along l, as a ball of radius 0.
        residual
            (k,) balls F(z) - g l. The balls contain the errors of F, and what was rounded
            off from g.
        """
        # F at z, without derivatives.
        (values,) = self.equations.evaluate(position, order=0)
        left_null_vector = exact_balls(self.left_null_vector)
        component = left_null_vector @ values
        level = exact_centres(component)
        residual = values - level * left_null_vector
        return level, residual

    def differentiate(
        self, positions: Array, residual: Array | None = None
    ) -> SurfaceDerivatives:
        """Return the first derivatives of a surface of positions, and of the level on it.

        A proof about a saddle of the level needs the gradient of the level.

        With given coordinates u and v, the equations F(z) = g l determine the variables z
        and the level g. The points z form the surface (see the class).

        u and v are the coordinates along the first two columns of `frame`. If F(z) = g l
        has an error, the result also contains the step of Newton's method that removes this
        error with constant u and v (`correction`).

        Parameters
        ----------
        positions
            (n,) values of z (rad), in balls (numbers with a bound of their error). The
            derivatives are valid for all values in the balls.
        residual
            (k,) balls: the error F(z) - g l. By default the error is 0, and so is the step.

        Raises
        ------
        ZeroDivisionError
            If z and g may be undetermined for some values in the balls.
        """
        if residual is None:
            residual = exact_balls(np.zeros(len(self.left_null_vector)))
        # `slopes` are the derivatives F' with respect to z. F' and F(z) = g l give linear
        # equations for the step and for the derivatives.
        _, slopes = self.equations.evaluate(positions, 1)
        solution = self._solve_first_order(slopes, residual)
        return _name_derivatives(solution)

    def differentiate_twice(
        self, positions: Array, residual: Array
    ) -> tuple[SurfaceDerivatives, SurfaceCurvatures]:
        """Return the first and second derivatives of a surface of positions and its level.

        With given coordinates u and v, the equations F(z) = g l determine the variables z
        and the level g. The points z form the surface (see the class).

        Curves g(u, v) = 0 can cross only where the gradient of g is 0. All derivatives
        serve to find this point. The second ones also show whether g has a saddle there.

        The given z satisfies F(z) = g l only approximately. A step of Newton's method with
        constant u and v would remove the error F(z) - g l. This method does not make the
        step. It returns the changes of z, of g and of the gradient of g
        (`gradient_correction`) that the step causes. Callers can include these changes in
        their own steps and error bounds.

        Parameters
        ----------
        positions
            (n,) values of z (rad), in balls (numbers with a bound of their error). The
            derivatives are valid for all values in the balls.
        residual
            (k,) balls: the error F(z) - g l that a step of Newton's method is to remove.

        Raises
        ------
        ZeroDivisionError
            If z and g may be undetermined for some values in the balls.
        """
        _, slopes, curvatures = self.equations.evaluate(positions, 2)
        # (n + 1, 3) changes of z (rows 0 to n - 1) and g (row n) in three directions: along
        # Newton's step (column 0), along u (column 1) and along v (column 2).
        first = self._solve_first_order(slopes, residual)
        variable_rates = first[:-1]
        # (n + 1, 3, 3) second derivatives in pairs of these directions.
        second = self._solve_second_order(slopes, curvatures, variable_rates)
        second_of_z, second_of_g = second[:-1], second[-1]
        surface_curvatures = SurfaceCurvatures(
            variable_curvatures=second_of_z[:, 1:, 1:],
            hessian=second_of_g[1:, 1:],
            # Changes by the step (index 0) of the derivatives by u and v.
            gradient_correction=second_of_g[0, 1:],
        )
        return _name_derivatives(first), surface_curvatures

    def _solve_first_order(self, slopes: Array, residual: Array) -> Array:
        """Return a Newton step to a surface of positions, and derivatives of the surface.

        With given coordinates u and v, the equations F(z) = g l determine the variables z
        and the level g. The points z form the surface (see the class).

        The coordinates are u = a . z + constant and v = b . z + constant, with constant
        vectors a and b. Let z' and g' be the changes of z and g by Newton's step, or their
        derivatives along u or v. z' and g' solve three sets of linear equations with one
        matrix (`_border`):

            Newton's step:   F' z' - g' l = -residual,   a . z' = 0,   b . z' = 0,
            along u:         F' z' - g' l = 0,           a . z' = 1,   b . z' = 0,
            along v:         F' z' - g' l = 0,           a . z' = 0,   b . z' = 1.

        Parameters
        ----------
        slopes
            (k, n) derivatives F' of the equations, in balls (numbers with a bound of their
            error).
        residual
            (k,) balls: the error F(z) - g l that Newton's step removes.

        Returns
        -------
        (n + 1, 3) balls. The last row belongs to g, the first n rows to z. The columns are
        the step, and the derivatives with respect to u and v.
        """
        equation_rows = np.block([-residual[:, None], np.zeros((len(slopes), 2))])
        coordinate_rows = np.block([np.zeros((2, 1)), np.eye(2)])
        right_sides = np.vstack([equation_rows, coordinate_rows])
        return solve_balls(self._border(slopes), right_sides)

    def _solve_second_order(self, slopes: Array, curvatures: Array, rates: Array) -> Array:
        """Return second derivatives of a surface of positions, also along a Newton step.

        With given coordinates u and v, the equations F(z) = g l determine the variables z
        and the level g. The points z form the surface (see the class).

        The coordinates are u = a . z + constant and v = b . z + constant, with constant
        vectors a and b. A given z has an error r = F(z) - g l, which a step of Newton's
        method removes with constant u and v. Let s, from 0 to 1, be the part of the error
        that is removed: F(z) - g l = (1 - s) r. This equation makes z and g functions of s,
        u and v. Its second derivatives with respect to two of these parameters, i and j,
        are

            F' z_ij - g_ij l = -F''(z_i, z_j),   a . z_ij = 0,   b . z_ij = 0.

        z_i and z_ij are the first and second derivatives of z. The first derivatives with
        respect to s are the step of Newton's method. The second derivatives g_ij with
        respect to u and v are the Hessian of g. Those with respect to s and u, or s and v,
        tell how the step changes the slopes of g.

        Parameters
        ----------
        slopes, curvatures
            (k, n) first derivatives F' and (k, n, n) second derivatives F'', in balls
            (numbers with a bound of their error).
        rates
            (n, 3) balls: the first derivatives z_i.

        Returns
        -------
        (n + 1, 3, 3) balls. The last index of the first axis belongs to g, the first n
        indices to z.
        """
        equation_count, variable_count = slopes.shape
        # (k, 3, 3) F''(z_i, z_j). Axes: equation, i, j. The nine pairs of parameters are
        # written side by side, as right sides of the linear equations. The last two rows,
        # of a and b, are 0.
        second_changes = rates.T @ curvatures @ rates
        right_sides = np.zeros((variable_count + 1, 9), object)
        right_sides[:equation_count] = -second_changes.reshape(equation_count, 9)
        # All nine sets of equations have the same matrix on the left side.
        solution = solve_balls(self._border(slopes), right_sides)
        return solution.reshape(-1, 3, 3)

    def _border(self, slopes: Array) -> Array:
        """Return the matrix (n + 1, n + 1) that relates changes near a crossing of curves.

        With given coordinates u and v, the equations F(z) = g l determine the variables z
        and the level g. The points z form the surface (see the class).

        The coordinates are u = a . z + constant and v = b . z + constant; a and b are the
        first two columns of `frame`. `slopes` (k, n) are the derivatives F'. Let z' be a
        small change of z, and g' a small change of g. Then F - g l changes by F' z' - g' l,
        u by a . z', and v by b . z'. The matrix of these linear functions of (z', g') is

            [F'  -l]
            [a^T  0]
            [b^T  0].

        The matrix is regular at a crossing, where F' alone loses a rank. The derivatives of
        z and g, and steps of Newton's method, solve linear equations with this matrix.
        `_solve_first_order` and `_solve_second_order` state the right sides.
        """
        # All elements become balls: numbers with a bound of their error.
        left_null_vector = exact_balls(self.left_null_vector)
        coordinate_rows = exact_balls(self.frame[:, :2].T)  # a and b
        return np.block(
            [
                [slopes, -left_null_vector[:, None]],
                [coordinate_rows, np.zeros((2, 1))],
            ]
        )

    def find_critical_point(self, position: Array) -> Array:
        """Return the point near a position at which curves of configurations may cross.

        With given coordinates u and v, the equations F(z) = g l determine the variables z
        and the level g. The points z form the surface (see the class).

        At the returned point both slopes of g(u, v) are 0. If g itself is 0 there, and has
        a saddle there, curves of configurations cross. Newton's method solves F(z) = g l
        and grad g = 0 together. Later proofs are about boxes around the point, so its error
        does not matter.

        Parameters
        ----------
        position
            (n,) start values of the variables (rad), in balls (numbers with a bound of
            their error).

        Returns
        -------
        (n,) the variables (rad) at the critical point, as balls of radius 0.

        Raises
        ------
        ZeroDivisionError
            If the iteration diverges, or a matrix is singular.
        """
        # Steps below this size are only rounding.
        rounding_rad = 2.0 ** (CRITICAL_POINT_ROUNDING_BITS - precision_bits())
        for _ in range(MAX_CRITICAL_POINT_STEPS):
            step = self._step_to_critical_point(position)
            step_size = np.max(np.abs(centre_floats(step)))
            if not step_size < MAX_CRITICAL_STEP_RAD:
                raise ZeroDivisionError
            position = exact_centres(position + step)
            if step_size < rounding_rad:
                break
        # If the steps have run out, this is the last position.
        return position

    def _step_to_critical_point(self, position: Array) -> Array:
        """Return the Newton step of all variables to a point where curves may cross.

        With given coordinates u and v, the equations F(z) = g l determine the variables z
        and the level g. The points z form the surface (see the class).

        Curves g(u, v) = 0 can cross only where the gradient of g is 0. The step has two
        parts, which are added:

        1. To the surface: with u and v constant, z and g are corrected so that F(z) = g l.
           The gradient changes by `gradient_correction`.
        2. Along the surface: u and v are changed so that the gradient becomes 0. z follows.

        Parameters
        ----------
        position
            (n,) variables z (rad), in balls (numbers with a bound of their error).

        Returns
        -------
        (n,) balls of radius 0, since a step of an iteration needs no error bounds.
        """
        # g is the component of F(z) along l. The step needs only the residual F(z) - g l.
        _level, residual = self.split_residual(position)
        # First and second derivatives of z and g with respect to u and v.
        first, second = self.differentiate_twice(position, residual)
        # Part 1: the change of z, and the gradient of g after this change.
        step_to_surface = first.correction
        gradient = exact_centres(first.gradient + second.gradient_correction)
        # Part 2: hessian (2, 2) times the step of u and v is -gradient.
        uv_column = solve_balls(exact_centres(second.hessian), -gradient[:, None])
        uv_step = uv_column[:, 0]
        step_along_surface = first.variable_rates @ uv_step
        return exact_centres(step_to_surface + step_along_surface)

    def enclose_box(self, limits: Floats) -> Array:
        """Return balls (n,) of all variables over a box about the centre.

        A ball is a number with a bound of its error. The n axes of the box are the columns
        of the frame, and `limits` (n,) are its half lengths (rad) along them. The balls are
        slightly larger than the box, which covers rounding.
        """
        reach = np.abs(self.frame) @ limits * (1.0 + 1e-9) + 1e-12
        return exact_balls(self.centre) + zero_balls(reach)

    def evaluate_on_surface(
        self, position: Array, level: Ball, derivatives: SurfaceDerivatives
    ) -> tuple[Ball, Array]:
        """Return the level and its slopes, with error bounds, near an approximate position.

        With given coordinates u and v, the equations F(z) = g l determine the variables z
        and the level g. The points z form the surface (see the class).

        A proof about a saddle of g needs the level g and its slopes at one point of the
        surface. The given z is only near the surface: z and g satisfy F(z) = g l
        approximately. Both are corrected with constant u and v, so that they satisfy it
        exactly. The result is the corrected g, with its slopes at the corrected z.

        Parameters
        ----------
        position
            (n,) approximate variables z (rad), in balls (numbers with a bound of their
            error).
        level
            The approximate g.
        derivatives
            The first derivatives of z and g with respect to u and v, for a box that
            contains the corrected z. The object also has the corrections: the balls
            `correction` for z and `level_correction` for g contain the exact ones.

        Returns
        -------
        Balls that contain the exact g, and its exact derivatives (2,) with respect to u and
        v.
        """
        # Balls that contain the exact z and g for this u and v.
        enclosed_position = position + derivatives.correction
        enclosed_level = level + derivatives.level_correction
        # F(z) = g l is linear in g, so the slopes of g depend on z only.
        gradient = self.differentiate(enclosed_position).gradient
        return enclosed_level, gradient


@dataclass(frozen=True)
class SaddleReduction:
    """The reduced equation g(u, v) = 0 about a saddle point of g, with its curvatures.

    A mechanism has n variables and n - 1 equations. Near the saddle point, two curves of
    configurations cross or narrowly miss each other. There all equations but one are
    solved, so that all variables become functions of two coordinates u and v. The last
    equation is g(u, v) = 0: its zeros are the configurations. The directions of u and v are
    chosen so that g is convex in u and concave in v. A proof
    about the curves takes the sides of a rectangle about the saddle point from `units`. It
    takes the limits of the other coordinates from `other_curvatures`.

    Attributes
    ----------
    reduced_equation
        The reduced equation. Its centre is the saddle point.
    units
        (2,) unit lengths of u and v. If u and v are divided by these units, the two curves
        of a crossing are the diagonals u = v and u = -v, to first order. Only their ratio
        matters, so they are scaled to make the larger unit 1.
    other_curvatures
        (n - 2, 2, 2) absolute values of the second derivatives, with respect to u and v, of
        the n - 2 further coordinates, which are at right angles to u and v. They say how
        far the curves leave the plane of u and v.
    """

    reduced_equation: ReducedEquation
    units: Floats
    other_curvatures: Floats


def _name_derivatives(solution: Array) -> SurfaceDerivatives:
    """Name the parts of a solution (n + 1, 3) of the linear equations of `ReducedEquation`.

    The first n rows belong to the variables, the last row to the function g(u, v). The
    columns are Newton's step and the derivatives with respect to the coordinates u and v.
    """
    return SurfaceDerivatives(
        variable_rates=solution[:-1, 1:],
        gradient=solution[-1, 1:],
        correction=solution[:-1, 0],
        level_correction=solution[-1, 0],
    )


def reduce_at_saddle(equations: ArcEquations, position: Floats) -> SaddleReduction:
    """Return the reduced equation about its saddle point, near a crossing of curves.

    Near a position where the derivatives F' of the equations lose a rank, configurations
    are the zeros of a function g(u, v) of two coordinates (`ReducedEquation`). At the
    saddle point both slopes of g are 0, and its principal curvatures have opposite signs.
    The zeros of g near it are two curves that cross, or nearly cross.

    Parameters
    ----------
    equations
        The equations of the mechanism.
    position
        (n,) a position (rad) where F' nearly loses a rank.

    Raises
    ------
    ZeroDivisionError
        If there is no critical point nearby, if g has no saddle there, if F' nearly loses
        more than one rank, or if a matrix is singular.
    """
    # 1. The critical point, with l and the kernel of F' at the position. Then the same
    # reduction about the critical point.
    preliminary_equation = _reduce_about(equations, position)
    critical_point = preliminary_equation.find_critical_point(exact_balls(position))
    centre = centre_floats(critical_point)
    reduced_equation = _reduce_about(equations, centre)

    # 2. Derivatives at the critical point, where the residual is nearly 0.
    _, residual = reduced_equation.split_residual(exact_balls(centre))
    _, curvatures = reduced_equation.differentiate_twice(exact_balls(centre), residual)
    variable_curvatures = centre_floats(curvatures.variable_curvatures)

    # 3. Principal curvatures of g, the smaller one first, and their directions. The two
    # curvatures must have opposite signs and comparable sizes.
    hessian = centre_floats(curvatures.hessian)
    (low, high), vectors = np.linalg.eigh(hessian)
    has_saddle = low < 0.0 < high and min(-low, high) > MIN_CURVATURE_RATIO * max(
        -low, high
    )
    is_near = np.max(np.abs(centre - position)) < MAX_CENTRE_DISTANCE_RAD
    if not (has_saddle and is_near):
        raise ZeroDivisionError

    # 4. Coordinates u along the positive curvature and v along the negative one.
    frame = reduced_equation.frame.copy()
    principal = vectors[:, ::-1]
    frame[:, :2] @= principal
    # In units of 1 / sqrt(curvature), g is (u^2 - v^2) / 2 plus a constant, to second
    # order. The curves of a crossing are then the diagonals of a square. Only the ratio of
    # the units matters.
    units = np.array([high, -low]) ** -0.5
    # Second derivatives with respect to the new u and v: of the variables (n, 2, 2), then
    # of the coordinates of the frame other than u and v (n - 2, 2, 2).
    principal_curvatures = principal.T @ variable_curvatures @ principal
    other_curvatures = np.tensordot(frame[:, 2:].T, principal_curvatures, 1)
    return SaddleReduction(
        reduced_equation=replace(reduced_equation, frame=frame),
        units=units / np.max(units),
        other_curvatures=np.abs(other_curvatures),
    )


def _reduce_about(equations: ArcEquations, position: Floats) -> ReducedEquation:
    """Return the reduced equation g(u, v) = 0 about a position.

    F(z) = 0 are the n - 1 equations of a mechanism in n variables z. At the position, their
    derivatives F' nearly lose a rank, so that two curves of configurations can cross there.
    The n - 1 equations are reduced to one equation g = 0 in two coordinates u and v of z.
    At given u and v, the other coordinates are chosen so that all components of F are zero,
    except that along a unit vector l. Then F = g l, and g = 0 is left.

    The singular value decomposition of F' gives the directions. The last left vector is l:
    to first order, changes of z hardly change F along l. The last two right vectors span
    the changes of z that hardly change F at all, nearly the kernel of F'. These two vectors
    become the directions of u and v.

    Parameters
    ----------
    equations
        The equations F of the mechanism.
    position
        (n,) values of all variables (rad).

    Raises
    ------
    ZeroDivisionError
        If F' nearly loses more than one rank.
    """
    # F' (n - 1, n) in float64. `harmonics` are the equations as sums of cosines and sines.
    circle_points = cosines_and_sines(position[None])
    _values, (slopes,) = equations.harmonics.derivatives(circle_points, order=1)
    left_vectors, singular_values, right_vectors = np.linalg.svd(slopes)
    # All singular values but the last must be clearly different from 0.
    smallest = MIN_SECOND_SINGULAR_RATIO * singular_values[0]
    if not np.all(singular_values[:-1] > smallest):
        raise ZeroDivisionError
    kernel = right_vectors[-2:]
    # The directions of the other coordinates.
    complement = right_vectors[:-2]
    return ReducedEquation(
        equations=equations,
        centre=position,
        frame=np.vstack([kernel, complement]).T,
        left_null_vector=left_vectors[:, -1],
    )


def zero_balls(radii: Sequence[float] | Floats) -> Array:
    """Return balls about 0 with these radii."""
    return np.array([widen(0.0, radius) for radius in radii])
