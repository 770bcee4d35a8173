"""Certified arcs: parts of space in which the configurations are exactly one arc.

Let z be all variables, z0 a configuration, t the unit tangent of the configuration curve
at z0, and N an orthonormal basis of the directions across it. A certified arc is the part
of space z = z0 + t s + N y with |s| <= h and |y_i| <= r. Let Y be near the inverse of F'N
at z0. If Y F'N differs from the identity by less than 1 in the whole part, there is at most
one y for every s. There is also at least one: a path leads from z0 to F = 0 as in
`spherekit.proof.root_ball`, and from there y' = -(F'N)^-1 F't. Bounds of Y F' bound both
paths, so that they do not leave the part. The configurations in the part are then one arc
that does not end inside.

No variable is special, so a dead centre of the input is an ordinary point. All numbers are
float64 with bounds of their errors.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.numerics.angles import wrap
from spherekit.proof.arc_equations import ArcEquations
from spherekit.proof.balls import cosines_and_sines

LONGEST_ARC_RAD = 0.4
"""Largest half length (rad) of an arc of a chain that is tried.

Larger: more failing trials for each arc. Smaller: more arcs for each curve.
"""

SHORTEST_ARC_RAD = 1e-7
"""Smallest half length (rad) of a certified arc that is tried.

Larger: curves with sharp bends are lost. Smaller: more failing trials where no arc exists.
"""

LENGTH_REDUCTION = 0.7
"""Each half length that is tried over the one before it.

Larger: arcs closer to the longest possible length, with more trials. Smaller: shorter arcs.
"""

RADIUS_RATIOS = (1.0, 0.6, 0.35, 0.2, 0.1, 0.03, 0.01)
"""Radii of an arc that are tried, over its half length, the largest first.

A large radius holds the arc more easily. A small radius keeps the derivatives constant.
"""

MAX_CORRECTOR_STEPS = 12
"""Largest number of Newton steps towards a configuration.

Larger: starts farther from a configuration succeed. Smaller: they fail sooner.
"""

MAX_CORRECTOR_STEP_RAD = 1.0
"""Newton step (rad) towards a configuration from which on the correction fails.

Larger: configurations far from the start may be returned. Smaller: rough starts fail.
"""

CONVERGED_STEP_RAD = 1e-11
"""Newton step (rad) below which there is no further one.

Larger: less accurate configurations. Smaller: steps that are only rounding are made.
"""

MAX_CLOSURE_RESIDUAL = 1e-10
"""Largest value of an equation before the last Newton step to a configuration.

Larger: positions that do not close may be returned. Smaller: slow convergence fails.
"""

MIN_SINGULAR_VALUE_RATIO = 1e-13
"""Relative singular value of the derivatives below which it counts as zero.

Larger: Newton's method does not change some directions. Smaller: nearly singular
derivatives give huge steps.
"""

ROUND_UP = 1.0 + 1e-12
"""Factor that covers the rounding of sums of bounds (all terms are positive).

Larger: weaker bounds. Smaller: below some 1 + 1e-14 the sums could be rounded below the
bound.
"""

PRODUCT_ROUNDING = 1e-14
"""Bound of the rounding of a matrix product of up to 16 rows, relative to magnitudes.

Larger: weaker bounds. Smaller: below 16 roundings of float64 it is no longer a bound.
"""

COORDINATE_ROUNDING_RAD = 1e-13
"""Bound (rad) of the rounding of the coordinates of a point in a box.

Larger: points near a side count neither as inside nor as outside. Smaller: below some 1e-14
it is no longer a bound.
"""


@dataclass(frozen=True)
class OrientedBox:
    """A box in the space of v variables, with sides in any orthogonal directions.

    Proofs use such boxes along and across curves of configurations.

    Attributes
    ----------
    centre
        (v,) the centre (rad).
    frame
        (v, v) orthonormal columns: the directions of the sides.
    limits
        (v,) half lengths (rad) of the sides.
    """

    centre: Floats
    frame: Floats
    limits: Floats

    def coordinates(self, positions: Floats) -> Floats:
        """Return coordinates (..., v) of positions (..., v) along the sides of the box.

        A position has the values of the v variables (rad). The coordinates are measured
        from the centre. Whole turns of a variable make no difference.
        """
        return wrap(positions - self.centre) @ self.frame

    def _contain(self, positions: Floats, reach: Floats | float) -> Bools:
        """Return whether positions (..., v) are inside this box, as an array (...).

        A position must be inside by at least `reach` (rad) along each of the v sides.
        `reach` is a number or an array (..., v). A negative `reach` accepts positions that
        are outside by this distance.
        """
        coordinates = np.abs(self.coordinates(positions))
        return np.all(coordinates + reach <= self.limits, axis=-1)

    def contains(self, position: Floats, error: float) -> bool:
        """Return whether a position (v,), known up to `error` rad, is certainly inside."""
        return bool(self._contain(position, error + COORDINATE_ROUNDING_RAD))

    def may_contain(self, position: Floats, error: float) -> bool:
        """Return whether a position (v,), known up to `error` rad, may be inside."""
        return bool(self._contain(position, -error - COORDINATE_ROUNDING_RAD))

    def covers(self, centres: Floats, radii: Floats) -> Bools:
        """Return a mask (n,) of axis-aligned boxes proven to be inside this box.

        `centres` and `radii` (n, v) are the centres and half lengths (rad) of the boxes.
        """
        # Half length of each box along the sides of this box. It is enlarged, so that
        # rounding errors cannot make it too small.
        reach = radii @ np.abs(self.frame) * ROUND_UP + COORDINATE_ROUNDING_RAD
        return self._contain(centres, reach)


def boxes_covered(
    oriented_boxes: Iterable[OrientedBox], centres: Floats, radii: Floats
) -> Bools:
    """Return a mask of axis-aligned boxes proven to be inside one of many oriented boxes.

    The oriented boxes contain known configurations. `centres` and `radii` (n, v) are the
    centres and half lengths (rad) of the axis-aligned boxes.
    """
    is_covered = np.zeros(len(centres), dtype=bool)
    for oriented_box in oriented_boxes:
        is_covered |= oriented_box.covers(centres, radii)
    return is_covered


@dataclass(frozen=True)
class CertifiedArc(OrientedBox):
    """An oriented box in which the configurations are exactly one arc of a curve.

    The box is in the space of all v variables of a mechanism. A configuration is a point at
    which all loops close. The first column of `frame` is the tangent t of the curve at the
    centre z0, the remaining columns are the normals N. A point of the box is z0 + t s + N y
    with ``|s|`` up to the half length h and each ``|y_i|`` up to the radius r. `limits` are
    h, and r for each normal.

    Attributes
    ----------
    euclidean_distance
        Bound (rad) of the length of y on the whole arc: its distance from the axis y = 0.
    centre_error
        Bound (rad) of the length of y at s = 0: the distance of the arc from the centre.
    test
        The object with which the arc was proven. It bounds the equations near the centre,
        and so gives bounds of shorter parts of the arc.
    """

    euclidean_distance: float
    centre_error: float
    test: "TubeTest"

    @property
    def half_length(self) -> float:
        """The half length h (rad)."""
        return self.limits[0]

    @property
    def radius(self) -> float:
        """The radius r (rad), which is equal for all normals."""
        return self.limits[1]

    @property
    def tangent(self) -> Floats:
        """(v,) the unit tangent t."""
        return self.frame[:, 0]

    def largest_normal_coordinate(self, half_length: float) -> float:
        """Return a bound (rad) of the coordinates of the arc along its normals.

        The result bounds each coordinate ``|y_i|``. The bound is valid where the coordinate
        s along the tangent has ``|s|`` up to `half_length` (rad).
        """
        bounds = self.test.bound_arc(half_length, self.radius)
        # The arc is proven to stay in the box, so the radius is also a bound.
        return min(float(bounds.normal_coordinate), self.radius)


@dataclass(frozen=True)
class TangentFrame:
    """Tangent and normals of a configuration curve at one of its points.

    A mechanism with one degree of freedom has v variables and k = v - 1 equations F = 0,
    with derivatives F' (k, v). The tangent t satisfies F' t = 0. Along the normals N, which
    are orthogonal to t, the derivatives are the square matrix F' N.

    Attributes
    ----------
    frame
        (v, v) orthonormal columns: the tangent t, then the normals N.
    inverse
        (k, k) matrix Y, an approximate inverse of F' N. Proofs multiply the equations by Y,
        so that the derivatives Y F' N are near the identity.
    """

    frame: Floats
    inverse: Floats


def find_frame(slopes: Floats, direction: Floats | None) -> TangentFrame | None:
    """Return tangent and normals of a configuration curve, None without a unique tangent.

    The v variables satisfy k = v - 1 equations F = 0. In the singular value decomposition
    F' = U S V^T, the last row of V^T is the tangent t, since F' t = 0. The other rows are
    the normals N.

    Parameters
    ----------
    slopes
        (k, v) first derivatives F' of the equations at a configuration.
    direction
        (v,) the tangent points to the side of this direction. With None its sense is
        arbitrary.
    """
    left_vectors, singular_values, right_vectors = np.linalg.svd(slopes)
    # If the smallest singular value is only rounding, there may be several tangents. The
    # limit need not be exact, because proofs test each frame.
    if not singular_values[-1] > 1e-13 * singular_values[0]:
        return None
    tangent = right_vectors[-1]
    if direction is not None and tangent @ direction < 0:
        tangent = -tangent
    frame = np.column_stack([tangent, right_vectors[:-1].T])
    # F' N is U S, so its inverse is S^-1 U^T.
    inverse = left_vectors.T / singular_values[:, None]
    return TangentFrame(frame, inverse)


def find_piece(
    equations: ArcEquations,
    centre: Floats,
    direction: Floats | None,
    longest: float,
) -> CertifiedArc | None:
    """Return the longest arc of the configuration curve that is proven about a centre.

    The result is a box in which the configurations are exactly one arc. One side of the box
    is along the tangent of the curve. Several half lengths of this side are tried, each
    with several radii (half widths in the other directions).

    Parameters
    ----------
    equations
        The equations of the mechanism.
    centre
        (v,) a configuration (rad), up to the accuracy of Newton's method.
    direction
        (v,) the tangent is oriented along this direction; without it, in either sense.
    longest
        Largest half length (rad) that is tried.

    Returns
    -------
    None if no arc is proven.
    """
    circle_points = cosines_and_sines(centre[None])
    derivatives = [array[0] for array in equations.harmonics.derivatives(circle_points, 2)]
    tangent_frame = find_frame(derivatives[1], direction)
    if tangent_frame is None:
        return None
    test = TubeTest(equations, derivatives, tangent_frame)
    # All half lengths (rows) are tried with all radii (columns) at once.
    shrink_steps = math.log(SHORTEST_ARC_RAD / longest) / math.log(LENGTH_REDUCTION)
    count = 1 + max(0, math.floor(shrink_steps))
    half_lengths: Floats = longest * LENGTH_REDUCTION ** np.arange(float(count))[:, None]
    radii: Floats = half_lengths * RADIUS_RATIOS
    bounds = test.bound_arc(half_lengths, radii)
    stays_inside = bounds.normal_coordinate * ROUND_UP < radii
    is_regular = bounds.contraction < 1.0
    proven = np.argwhere(stays_inside & is_regular)
    if not len(proven):
        return None
    # The first one has the largest half length, and of these the largest radius.
    best = tuple(proven[0])
    half_length = half_lengths[best[0], 0]
    radius = radii[best]
    # The bounds are of components along the normals. Other boxes have other normals and
    # need the Euclidean distance.
    to_distance = math.sqrt(len(tangent_frame.inverse)) * ROUND_UP
    centre_error = float(test.bound_arc(0.0, radius).normal_coordinate)
    limits = np.array([half_length, *[radius] * len(tangent_frame.inverse)])
    return CertifiedArc(
        centre=centre,
        frame=tangent_frame.frame,
        limits=limits,
        euclidean_distance=bounds.normal_coordinate[best] * to_distance,
        centre_error=centre_error * to_distance,
        test=test,
    )


@dataclass(frozen=True)
class ArcBounds:
    """Bounds for an arc of configurations in a box.

    The bounds can prove that the box contains exactly one arc of the configuration curve.

    The arc consists of the configurations z = z0 + t s + N y(s). At the centre z0 the curve
    has the tangent t and the k normals N. The box contains all points with ``|s|`` up to a
    half length and each ``|y_i|`` up to a radius. F' are the derivatives of the equations
    that close the loops. Y is approximately the inverse of F'N at the centre (`TubeTest`).

    Boxes of several sizes may be tried about the same centre. Each bound is an array with
    one element for each box; the shape is () for one box.

    Attributes
    ----------
    normal_coordinate
        Bound (rad) of all ``|y_i|`` on the arc. If it is below the radius, the arc stays in
        the box. The length of y is at most sqrt(k) times this.
    contraction
        Largest row sum of ``|Y F'N - I|`` in the box, with the identity matrix I. If it is
        below 1, there is at most one arc.
    slope
        Largest ``|dy_i/ds|`` of the arc, over all i.
    """

    normal_coordinate: Floats
    contraction: Floats
    slope: Floats


class TubeTest:
    """Bounds of Y F and its derivatives near a centre, in coordinates along a frame.

    F = 0 are the k equations that close the loops of the mechanism. The equations are
    trigonometric polynomials in the v variables. The frame consists of the tangent and the
    normals N of the configuration curve at the centre. The matrix Y is near the inverse of
    F'N, the derivatives with respect to the normal coordinates. If Y F' stays near (0, I),
    a column of zeros and the identity matrix, there is exactly one arc of configurations in
    a box about the centre.

    Parameters
    ----------
    equations
        The equations F of the mechanism.
    derivatives
        F (k,), F' (k, v) and F'' (k, v, v) at the centre, by the variables.
    tangent_frame
        Tangent, normals and Y at the centre.

    Attributes
    ----------
    degrees
        (k, v) trigonometric degrees d of each equation along each coordinate of the frame:
        the sum of the degrees in the variables, each times the magnitude of the variable's
        component along the coordinate.
    third_bound
        (k,) numbers C: the third derivative of an equation with respect to the coordinates
        i, j and l is at most C d_i d_j d_l.
    derivative_error
        (k,) numbers E, rounding included: at the centre, the error of a computed derivative
        with respect to the coordinates i and j is at most E d_i d_j. The error of a first
        derivative, with respect to i, is at most E d_i.
    inverse_size
        (k, k) magnitudes of the entries of Y.
    second_derivatives
        (k, v, v) Y F'' along the frame.
    """

    def __init__(
        self,
        equations: ArcEquations,
        derivatives: list[Floats],
        tangent_frame: TangentFrame,
    ) -> None:
        """Compute what `bound_arc` needs at the centre to bound the arc in a box.

        F = 0 are the k equations of a mechanism in v variables, and the centre is a point
        of a configuration curve. The columns of the frame are the tangent and the normals
        of the curve. Y is approximately the inverse of the derivatives of F along the
        normals.

        A box about the centre has its sides along the columns of the frame. The bounds of
        `bound_arc` can prove that the configurations in the box are exactly one arc. Boxes
        of many sizes are tried. All that does not depend on the size is computed here,
        once.

        Parameters
        ----------
        equations
            The equations F of the mechanism.
        derivatives
            F (k,), F' (k, v) and F'' (k, v, v) at the centre, by the variables.
        tangent_frame
            The frame (tangent and normals), and Y as its `inverse`.
        """
        values, slopes, curvatures = derivatives
        frame = tangent_frame.frame
        inverse = tangent_frame.inverse
        # (k,) constants C. An equation contains cosines and sines of multiples of the
        # angles. The degree d_i is the highest multiple of variable i. The third derivative
        # with respect to the variables i, j and l is at most C d_i d_j d_l.
        self.third_bound = equations.derivative_bound
        # (k, v) degrees along the columns of the frame. A derivative along a column t is
        # the sum of t_i times the derivative with respect to variable i. So the same bound
        # holds with the degree |t_1| d_1 + |t_2| d_2 + ... `ROUND_UP`, slightly above 1,
        # covers rounding.
        self.degrees = equations.degrees @ np.abs(frame) * ROUND_UP
        # Numbers E that bound the errors of the computed derivatives: E for F, E d_i for
        # F', and E d_i d_j for F''.
        self.derivative_error = _bound_derivative_error(equations)
        self.inverse_size = np.abs(inverse)
        # (k, v, v) Y F'' along the frame.
        self.second_derivatives = np.tensordot(inverse, frame.T @ curvatures @ frame, 1)
        # Largest element of |Y F|, including errors.
        residual_error = self.inverse_size @ self.derivative_error
        self._residual = np.max(np.abs(inverse @ values) + residual_error)
        # (k, v) |Y F' - (0, I)| at the centre, with F' along the frame. (0, I) is a column
        # of zeros for the tangent, and the identity matrix for the normals. The difference
        # would be 0 with the exact tangent and the exact inverse.
        slopes_along_frame = inverse @ (slopes @ frame)
        slopes_along_frame[:, 1:] -= np.eye(len(inverse))
        self._slope_error = np.abs(slopes_along_frame)

    def bound_slope_change(self, reach: Floats) -> Floats:
        """Return bounds of the entries of |Y F' - (0, I)| in boxes about the centre.

        The centre is a point of a configuration curve. With these bounds, `bound_arc`
        proves that the configurations in a box are exactly one arc of the curve.

        F' (k, v) are the derivatives of the k equations along v directions: the tangent of
        the curve at the centre, then its normals (the frame). Y is approximately the
        inverse of the columns of the normals. So Y F' is near (0, I): a column of zeros,
        then the identity matrix.

        Taylor's formula about the centre is F' = F'(0) + F''(0) x + remainder, with
        coordinates x along the frame.

        Parameters
        ----------
        reach
            (..., v) largest coordinates |x| (rad) along the frame, of one or many boxes.

        Returns
        -------
        (..., k, v) bounds for each equation and coordinate.
        """
        # 1. |Y F'(0) - (0, I)| is `_slope_error`.
        # 2. |Y F''(0) x|: for each equation the row |x| times the matrix |Y F''(0)| (v, v).
        #    `second_derivatives` (k, v, v) are Y F''(0).
        reach_rows = reach[..., None, None, :]
        linear_change = (reach_rows @ np.abs(self.second_derivatives))[..., 0, :]
        # 3. |Y| (`inverse_size`) times the remainder and the errors of the computed
        #    derivatives.
        remainder = self._bound_taylor_remainder(reach)
        remainder_change = self.inverse_size @ remainder
        return (self._slope_error + linear_change + remainder_change) * ROUND_UP

    def _bound_taylor_remainder(self, reach: Floats) -> Floats:
        """Return bounds of the error of Taylor's formula F' = F'(0) + F''(0) x.

        F' and F'' are the first and second derivatives of the k equations with respect to v
        coordinates x. The coordinates are along a frame: the tangent and the normals of the
        configuration curve at x = 0. `bound_slope_change` needs the error to bound F' in a
        whole box.

        An equation is a trigonometric polynomial, with the degree d_i along coordinate i
        (`degrees`). Two bounds are products of degrees. The first one is Bernstein's
        inequality:

        - A third derivative is at most C d_i d_j d_l, with the constant C (`third_bound`).
        - The errors of the computed F'(0) and F''(0) are at most E d_i and E d_i d_j, with
          the constant E (`derivative_error`).

        Let S be the sum of all d_j times the largest ``|x_j|``. Three bounds are added for
        coordinate i:

        - of the remainder                        d_i C S^2 / 2,
        - of the error of the computed F'(0)      d_i E,
        - of the error of the computed F''(0) x   d_i E S.

        Parameters
        ----------
        reach
            (..., v) largest coordinates |x| (rad) along the frame, of one or many boxes.

        Returns
        -------
        (..., k, v) bounds for each equation and coordinate.
        """
        sums = reach @ self.degrees.T  # (..., k), S
        third_order = 0.5 * self.third_bound * sums**2
        computed_derivatives = self.derivative_error * (1.0 + sums)
        without_degree = third_order + computed_derivatives
        return without_degree[..., None] * self.degrees

    def bound_arc(self, half_length: Floats | float, radius: Floats | float) -> ArcBounds:
        """Return bounds of an arc of configurations in a box, to prove that it stays there.

        The frame at the centre of the box has the tangent and the normals of a
        configuration curve. A point of the arc has the coordinate s along the tangent, and
        k coordinates y(s) along the normals. The box contains all points with ``|s|`` up to
        the half length and each ``|y_i|`` up to the radius.

        The bounds assume that the arc stays in the box. The assumption is proven if the
        bound of ``|y_i|`` is less than the radius, and the contraction less than 1.

        F' are the derivatives of the k equations along the frame. Y is approximately the
        inverse of the derivatives along the normals. Then Y F' is (e, I + E): a small
        column e of derivatives with respect to s, and a matrix near the identity I of
        derivatives with respect to y. Along the arc F' (1, y') = 0, so (I + E) y' = -e.
        Three bounds follow:

        1. The contraction is the largest row sum of ``|E|`` in the box.
        2. The slope is a bound of all ``|y_i'|``: the largest ``|e_i|`` divided by
           (1 - contraction).
        3. ``|y_i|`` is at most the bound at s = 0, plus what y_i can change from there to
           the end of the box. This change is at most the half length times the mean of the
           slope's bound.

        Parameters
        ----------
        half_length, radius
            Limits (rad) of ``|s|`` and of each ``|y_i|``: numbers, or arrays for many
            boxes.
        """
        normal_count = len(self.inverse_size)
        # (..., v) each: largest coordinates in the whole box, and in its part with s = 0.
        reach_of_box = _largest_coordinates(half_length, radius, normal_count)
        reach_at_centre = _largest_coordinates(0.0, radius, normal_count)
        reaches = np.stack(np.broadcast_arrays(reach_of_box, reach_at_centre))
        # (..., k, 1 + k) each: bounds of the magnitudes of Y F' - (0, I) = (e, E). Column 0
        # bounds |e|, the remaining columns |E|.
        change_in_box, change_at_centre = self.bound_slope_change(reaches)

        # 1. Contraction. `ROUND_UP` is slightly above 1 and covers the rounding of the
        #    bound.
        row_sums = change_in_box[..., 1:].sum(axis=-1)
        contraction = row_sums.max(axis=-1) * ROUND_UP

        # 2. Slopes in the box and at s = 0, which is in the box, so that its contraction is
        #    valid there, too. If it exceeds 1, the slopes become huge, but not negative.
        margin = np.maximum(1.0 - contraction, 1e-300)
        with np.errstate(over="ignore"):  # infinity is a valid bound
            slope_in_box = change_in_box[..., 0].max(axis=-1) / margin * ROUND_UP
            slope_at_centre = change_at_centre[..., 0].max(axis=-1) / margin * ROUND_UP

        # 3. Largest |y_i|. At s = 0 it is at most the residual |Y F| at the centre, divided
        #    by 1 - contraction. From there to the end of the box, the bound of the slope is
        #    integrated along s. The bound of each |e_i| is a polynomial in |s| without
        #    negative coefficients, so the bound of the slope is convex in |s|. Its mean is
        #    therefore at most the mean of its values at s = 0 and at the end of the box.
        largest_at_centre = self._residual / margin
        mean_slope = 0.5 * slope_in_box + 0.5 * slope_at_centre
        largest = (largest_at_centre + half_length * mean_slope) * ROUND_UP
        return ArcBounds(
            normal_coordinate=largest, contraction=contraction, slope=slope_in_box
        )


def _bound_derivative_error(equations: ArcEquations) -> Floats:
    """Return error bounds E (k,) of the computed equations and their derivatives.

    An equation with the degrees d has an error of at most E, its first derivative with
    respect to variable i at most E d_i, and its second derivatives at most E d_i d_j. There
    are two parts:

    - the error of the evaluation by Fourier series (`harmonics`),
    - the rounding of the products with the frame and the approximate inverse Y. A matrix
      product has an error of at most `PRODUCT_ROUNDING` times the product of magnitudes.
      There are at most three products in a row, which the factor 4 covers.
    """
    rounding = 4.0 * PRODUCT_ROUNDING * equations.derivative_bound
    return equations.harmonics.error + rounding


def _largest_coordinates(
    half_length: Floats | float, radius: Floats | float, normal_count: int
) -> Floats:
    """Return the half lengths of boxes as vectors: along the tangent, then the normals.

    A box is about the centre of an arc, with sides along its tangent and normals. The
    caller bounds the derivatives of the equations in the box from the largest coordinates.

    Parameters
    ----------
    half_length, radius
        Half lengths (rad) along the tangent and along each normal: numbers, or arrays for
        many boxes.
    normal_count
        Number of normals.

    Returns
    -------
    (..., 1 + normals) largest coordinates in each box.
    """
    shape = np.broadcast_shapes(np.shape(half_length), np.shape(radius))
    coordinates = np.empty((*shape, 1 + normal_count))
    coordinates[..., 0] = half_length
    coordinates[..., 1:] = np.asarray(radius)[..., None]
    return coordinates


def correct_configuration(
    equations: ArcEquations, position: Floats, free_count: int | None = None
) -> Floats | None:
    """Return the configuration near a position, by Newton's method; None if it fails.

    All equations of the mechanism are 0 in a configuration. Nothing is proven here.

    Parameters
    ----------
    equations
        The equations of the mechanism.
    position
        (v,) start values of all variables (rad).
    free_count
        Number of variables to change, from the first on; the others keep their values. By
        default all are changed. If more variables are changed than there are equations, the
        shortest possible step is taken.
    """
    position = position.copy()
    for _ in range(MAX_CORRECTOR_STEPS):
        # Values (k,) and derivatives (k, v) of the equations, by Fourier series. These take
        # the cosines and sines of the variables.
        circle_points = np.stack([np.cos(position), np.sin(position)], axis=-1)
        (values_before_step,), (slopes,) = equations.harmonics.derivatives(
            circle_points[None], 1
        )
        step, *_ = np.linalg.lstsq(
            slopes[:, :free_count], -values_before_step, rcond=MIN_SINGULAR_VALUE_RATIO
        )
        position[:free_count] += step
        step_size = np.max(np.abs(step))
        is_small_enough = step_size < MAX_CORRECTOR_STEP_RAD
        # Written with `not`, so that NaN fails, too.
        if not is_small_enough:
            return None
        if step_size < CONVERGED_STEP_RAD:
            break
    # These values belong to the state before the last step. After the step they are
    # smaller.
    is_closed = np.max(np.abs(values_before_step)) < MAX_CLOSURE_RESIDUAL
    return position if is_closed else None
