"""Derivatives of curves on the sphere with respect to the quantities that define them.

A design variable moves the centre, the coefficients or the points of a profile. This module
differentiates the curve with respect to that variable at a fixed arc length. A derivative
is carried as a complex step (`spherekit.numerics.complex_step`): a quantity and its
derivative are the real and the scaled imaginary part of one number.

The knots of a spline through points are lengths along the curve, so they move with it. The
spline of SciPy takes real knots only. The same spline is therefore constructed here for
complex ones.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import perm

import numpy as np
from numpy.typing import ArrayLike

from spherekit.arrays import Floats
from spherekit.geometry.arc_length import ArcLength, integrate_rate, measure_arc_length
from spherekit.geometry.parametric_curve import (
    FourierPath,
    Path,
    PathFrames,
    SplinePath,
    axes_about,
)
from spherekit.geometry.profile_curve import azimuth_panels, spline_fits
from spherekit.geometry.vectors import cross, dot
from spherekit.numerics.complex_step import add_complex_step, extract_derivative
from spherekit.tolerances import PROFILE_END_ROUNDING

_POWER_DERIVATIVES = np.array(
    [[perm(power, order) for power in range(6)] for order in range(6)], float
)
"""(6, 6) derivative of each order (row) of x^power (column) at x = 1."""


def quintic_panels(
    knots: Floats, points: Floats, closed: bool
) -> Callable[[Floats, int], Floats]:
    """Return the quintic spline through points as a function; points may be complex.

    Complex knots and points carry derivatives with respect to a design variable (complex
    step). SciPy's splines take no complex knots. The spline is the same as in
    `spherekit.geometry.parametric_curve.quintic`: a polynomial of degree 5 on each panel
    between two knots. Derivatives up to order 4 agree at the knots. An open spline has no
    knots at the two points next to each end, so the order 5 agrees there.

    Parameters
    ----------
    knots
        (m,) parameters of the points.
    points
        (m, 3) points. The first is repeated at the end if the spline is closed.
    closed
        Whether the spline is periodic.

    Returns
    -------
    A function of parameters (...) and an order. It returns the derivative (..., 3) of this
    order with respect to the parameter; order 0 is the point itself.
    """
    from scipy.sparse import block_diag, vstack
    from scipy.sparse.linalg import splu

    h = np.diff(knots)
    panels = len(h)
    # The unknowns are coefficients for the powers of (u - knot) / h. A derivative of order
    # k with respect to u has the factor 1 / h^k. This factor is multiplied by the k-th
    # power of the mean h, so that all equations have coefficients of similar size.
    h_powers = h[:, None] ** np.arange(6.0)
    scale = (np.real(np.mean(h)) ** np.arange(6.0) / h_powers)[..., None]
    at_starts = scale * np.diag(np.diag(_POWER_DERIVATIVES))
    at_stops = scale * _POWER_DERIVATIVES

    # Rows: the orders 1 to 5 at the end of each panel, less those at the next panel.
    next_starts = block_diag([*at_starts[:, 1:]], format="csr")
    stops = block_diag([*at_stops[:, 1:]], format="csr")
    # The rows of the next panel are five rows ahead; the first panel follows the last.
    jumps = stops - next_starts[np.roll(np.arange(5 * panels), -5)]
    is_continuous = np.tile(np.arange(5) < 4, (panels, 1))
    if not closed:
        # All orders agree at the first two and the last two inner points. There is no panel
        # after the last one.
        is_continuous[[0, 1, -3, -2]] = True
        is_continuous[-1] = False

    # Rows: the values at both ends of each panel.
    start_values = block_diag([*at_starts[:, :1]])
    stop_values = block_diag([*at_stops[:, :1]])
    system = vstack([start_values, stop_values, jumps[is_continuous.ravel()]], format="csc")
    right_side = np.zeros((6 * panels, 3), dtype=points.dtype)
    right_side[: 2 * panels] = np.concatenate([points[:-1], points[1:]])
    solution = splu(system).solve(right_side)
    coefficients = solution.reshape(panels, 6, 3) / h_powers[..., None]

    def spline(u: Floats, order: int) -> Floats:
        """Return a derivative (..., 3) of the spline with respect to its parameter u.

        `order` is the order of the derivative: 0 returns the points of the spline. The
        parameters u have any shape (...).
        """
        # The spline is a polynomial on each panel between two knots. Complex parameters
        # have a derivative in the imaginary part, so panels are found from the real parts.
        panel = np.searchsorted(np.real(knots[1:-1]), np.real(u), side="right")
        powers = (u - knots[panel])[..., None] ** np.arange(6.0 - order)
        factors = _POWER_DERIVATIVES[order, order:, None] * coefficients[panel, order:]
        return np.sum(factors * powers[..., None], axis=-2)

    return spline


@dataclass(frozen=True)
class PathVariation:
    """A path with its derivative with respect to a design variable, as a complex step.

    A path is a curve on the unit sphere as a function of a parameter u. A design variable
    is a quantity that changes the curve. Complex step: a quantity a and its derivative da
    are one complex number a + i h da. The step h is so tiny that the real part does not
    change. Any function of such numbers has its own derivative, times h, as imaginary part.

    Attributes
    ----------
    path
        The path, whose points and coefficients are such complex numbers.
    arc_length
        The arc length of the path as a function of its parameter, real numbers only.
    arc_length_rate
        A function of the parameter u: the derivative, with respect to the design variable,
        of the arc length from the start to u, with u held fixed.
    length_rate
        Derivative of the whole length (rad).
    closed
        Whether the curve is closed.
    """

    path: Path
    arc_length: ArcLength
    arc_length_rate: ArcLength
    length_rate: float
    closed: bool

    def find_parameters(self, lengths: Floats) -> Floats:
        """Return the parameters u (n,) of points of the path at arc lengths (n,), rad."""
        return self.arc_length.invert(lengths)

    def find_parameter_rates(self, u: Floats, length_rates: Floats) -> Floats:
        """Return the derivatives of parameters u with respect to the design variable x.

        If x changes the path, the point at an arc length gets another parameter. The
        derivative u' follows from the chain rule for the arc length s(u, x): ds/du u' +
        ds/dx = s'. Here ds/du is the speed of the path, and ds/dx is `arc_length_rate`.

        Parameters
        ----------
        u
            (n,) parameters of points of the path.
        length_rates
            (n,) s', the derivatives of the arc lengths (rad) of these points with respect
            to x.

        Returns
        -------
        (n,) derivatives u'.
        """
        return (length_rates - self.arc_length_rate.evaluate(u)) / self._speeds(u)

    def _speeds(self, u: Floats) -> Floats:
        """Return the speeds ds/du (n,) of the path at parameters u (n,), real numbers."""
        # `path` takes complex numbers, whose imaginary part is a derivative, here 0. The
        # real part of the result is the speed.
        complex_speeds = self.path.speed(add_complex_step(u, 0.0))
        return np.real(complex_speeds)


@dataclass(frozen=True)
class MovingFit:
    """A spline through points that move with a design variable.

    Attributes
    ----------
    path
        The spline. Its numbers carry derivatives with respect to the design variable as
        complex steps: the imaginary part of a number is its derivative times a tiny number.
    arc_length_rate
        A function of the parameter u of the spline: the derivative, with respect to the
        design variable, of the arc length from the start to u, with u held fixed.
    panel_length_rates
        (panels,) derivatives, with respect to the design variable, of the lengths of the
        panels. A panel is the part of the curve between successive points.
    """

    path: SplinePath
    arc_length_rate: ArcLength
    panel_length_rates: Floats


def _vary_spline(points: Floats, change: Floats, closed: bool) -> PathVariation:
    """Return the smooth curve through points that a design variable moves.

    The result has the derivatives of the curve with respect to this variable.

    The curve is a spline. The knots are the parameters of the points. Knots should be
    nearly arc lengths, which depend on the spline. The spline is therefore fitted several
    times. The knots of the first fit are the sums of great-circle arcs between the points.
    Those of every later fit are the arc lengths on the fit before. All knots change with
    the design variable.

    Parameters
    ----------
    points
        (m, 3) unit vectors.
    change
        (m, 3) derivatives of these vectors with respect to the design variable.
    closed
        Whether the curve is closed.
    """
    moving_points = _make_moving_points(points, change, closed)
    # A knot step is the difference of successive knots: an arc between two points for the
    # first fit, later the length of the piece of the previous fit between them.
    knot_step_rates = _differentiate_arcs(moving_points)
    fits = list(spline_fits(points, closed))
    for spline, _arc_length in fits:
        # `moving_fit` is the same spline, with derivatives with respect to the design
        # variable.
        moving_fit = _differentiate_fit(spline, moving_points, knot_step_rates)
        knot_step_rates = moving_fit.panel_length_rates
    # The last fit is the curve.
    _, arc_length = fits[-1]
    return PathVariation(
        path=moving_fit.path,
        arc_length=arc_length,
        arc_length_rate=moving_fit.arc_length_rate,
        length_rate=float(np.sum(moving_fit.panel_length_rates)),
        closed=closed,
    )


def _make_moving_points(points: Floats, change: Floats, closed: bool) -> Floats:
    """Return unit vectors that carry their derivatives as complex steps.

    Complex step: the imaginary part of a number is its derivative times a tiny number.

    Parameters
    ----------
    points, change
        (m, 3) unit vectors, and their derivatives with respect to the design variable.
    closed
        Whether the curve is closed. The first point is then repeated at the end.
    """
    moving_points = add_complex_step(points, change)
    moving_points = moving_points / np.sqrt(dot(moving_points, moving_points))[:, None]
    if closed:
        moving_points = np.concatenate([moving_points, moving_points[:1]])
    return moving_points


def _differentiate_fit(
    path: SplinePath, moving_points: Floats, knot_step_rates: Floats
) -> MovingFit:
    """Return a spline with its derivatives with respect to a design variable.

    The variable moves the points of the spline. The curve is fitted several times. The arc
    lengths of the panels (pieces between successive points) are the knot steps of the next
    fit. So the derivatives of the panel lengths are computed, too.

    Parameters
    ----------
    path
        The same spline with real numbers, without derivatives.
    moving_points
        (panels + 1, 3) its points, which carry their derivatives as complex steps: the
        imaginary part of a number is its derivative times a tiny number.
    knot_step_rates
        (panels,) derivatives of the knot steps, the differences of successive knots. Knots
        are the parameters of the points.
    """
    # The first knot is 0 and does not move. SciPy has no splines with complex knots, so
    # `quintic_panels` computes the same spline.
    knot_rates = np.append(0.0, np.cumsum(knot_step_rates))
    moving_knots = add_complex_step(path.knots, knot_rates)
    spline = quintic_panels(moving_knots, moving_points, path.closed)
    # A `SplinePath` computes points and speeds with the function `spline` only, which was
    # made with the moving knots. The knots stored in the path may be real.
    moving_path = SplinePath(spline, path.knots, path.closed)

    # The arc lengths s(u, x) at the knots u depend on the design variable x in two ways:
    # the curve changes at a fixed u, and the knot moves along the curve, at the speed ds/du
    # times du/dx.
    arc_length_rate = _integrate_speed_rate(moving_path, path.knots)
    rate_at_fixed_parameter = arc_length_rate.evaluate_at_edges(path.knots)
    rate_by_moving_knots = path.speed(path.knots) * extract_derivative(moving_knots)
    length_rates = rate_at_fixed_parameter + rate_by_moving_knots
    # The length of a panel is the difference of the arc lengths at its ends.
    panel_length_rates = np.diff(length_rates)
    return MovingFit(moving_path, arc_length_rate, panel_length_rates)


def _integrate_speed_rate(path: Path, edges: Floats) -> ArcLength:
    """Return the derivative of the arc length of a path with respect to a design variable.

    The arc length is the integral of the speed |dp/du| over the parameter u. Its derivative
    is therefore the integral of the derivative of the speed.

    Parameters
    ----------
    path
        The path as a complex step: the imaginary part of each number is its derivative with
        respect to the design variable, times a tiny number.
    edges
        (m,) parameters u. The path is smooth between them.

    Returns
    -------
    A function of a parameter u: the derivative of the arc length from edges[0] to u, with u
    held fixed.
    """

    def speed_rate(u: Floats) -> Floats:
        """Return the derivative of the speed at fixed parameters u."""
        # A fixed parameter has the derivative 0.
        complex_speed = path.speed(add_complex_step(u, 0.0))
        return extract_derivative(complex_speed)

    return integrate_rate(speed_rate, edges)


def _differentiate_arcs(points: Floats) -> Floats:
    """Return the derivatives of the arcs (rad) between successive points.

    The points depend on a design variable, with respect to which the arcs are
    differentiated.

    Parameters
    ----------
    points
        (m, 3) unit vectors with their derivatives as a complex step: the real part is the
        point, the imaginary part is its derivative times a tiny number.

    Returns
    -------
    (m - 1,) derivatives.
    """
    across = cross(points[:-1], points[1:])
    # `dot` does not conjugate its arguments, so sine and cosine carry their derivatives.
    sine = np.sqrt(dot(across, across))
    cosine = dot(points[:-1], points[1:])
    # The derivative of an angle a is cos(a) (sin a)' - sin(a) (cos a)'.
    return np.real(cosine) * extract_derivative(sine) - np.real(sine) * extract_derivative(
        cosine
    )


@dataclass(frozen=True)
class CurveDerivative:
    """The derivative of a curve with respect to a design variable, along its arc length.

    The curve is a path on the unit sphere, run forwards or backwards. A design variable,
    such as a radius, changes it. The derivative is the rate at which the point of the
    curve at a fixed arc length moves, and its tangent and curvature change.

    Attributes
    ----------
    variation
        The path as a function of its own parameter, with its derivative with respect to the
        design variable.
    backwards
        Whether the curve runs against the path.
    """

    variation: PathVariation
    backwards: bool

    def __call__(self, s: Floats) -> Floats:
        """Return derivatives with respect to the design variable at arc lengths s (n,).

        The arc lengths s (rad) are fixed, and the path changes with the design variable.
        The derivatives follow step by step:

        1. The arc length on the path is s, or -s if the curve runs against the path, plus a
           whole multiple of the length of the path. It changes with the design variable,
           because the length of the path changes.
        2. The arc length on the path determines the parameter u of the path. So u changes
           too.
        3. The path at u gives tangent, point and curvature. They change because the path
           changes at a fixed u, and because u changes.

        Returns
        -------
        (8, n) derivatives. Rows 0 to 2 are those of the tangent, 3 to 5 those of the point,
        6 that of the geodesic curvature k, and 7 that of dk/ds. NaN beyond an end of an
        open curve.
        """
        variation = self.variation
        signed_lengths = -s if self.backwards else s
        laps = self._count_laps(signed_lengths)
        path_lengths = signed_lengths + laps * variation.arc_length.length
        path_length_rates = laps * variation.length_rate
        # An open curve has no points beyond its ends. Its polynomials are not continued.
        length = variation.arc_length.length
        lengths_on_path = np.clip(path_lengths, 0.0, length)
        is_beyond = np.abs(path_lengths - lengths_on_path) > PROFILE_END_ROUNDING * length

        u = variation.find_parameters(lengths_on_path)
        u_rates = variation.find_parameter_rates(u, path_length_rates)

        # The derivatives are computed by a complex step. The numbers of the path and
        # `moving_u` are complex: the imaginary part is the derivative with respect to the
        # design variable, times a tiny factor. The same then holds for the frames. Their
        # imaginary parts contain both changes of step 3.
        moving_u = add_complex_step(u, u_rates)
        frames = variation.path.frames(moving_u)
        derivatives = self._differentiate_points(frames)
        if not variation.closed:
            derivatives[:, is_beyond] = np.nan
        return derivatives

    def _count_laps(self, signed_lengths: Floats) -> Floats:
        """Return how many whole lengths of the path are added to arc lengths of the curve.

        The caller needs the arc lengths on the path, which are counted from 0 at its start
        to L at its end. The curve can run backwards, and arc lengths of a closed curve can
        exceed L. The arc length on the path is the signed length plus a whole
        number of laps times L. The result has these numbers.

        Parameters
        ----------
        signed_lengths
            (n,) arc lengths (rad) on the curve, with the opposite sign if the curve runs
            backwards.

        Returns
        -------
        (n,) whole numbers of laps. A negative number shortens the arc length.
        """
        if self.variation.closed:
            return -np.floor(signed_lengths / self.variation.arc_length.length)
        # An open curve that runs backwards starts at the end of the path. The arc length s
        # on the curve is then L - s on the path, so there is one lap.
        lap = 1.0 if self.backwards else 0.0
        return np.full_like(signed_lengths, lap)

    def _differentiate_points(self, frames: PathFrames) -> Floats:
        """Return derivatives of points and curvatures with respect to the design variable.

        Parameters
        ----------
        frames
            Tangents, points and curvatures of the path at n points. Their numbers are
            complex, with the derivatives with respect to the design variable as scaled
            imaginary parts (complex step).

        Returns
        -------
        (8, n) derivatives. Rows 0 to 2 are those of the tangent, 3 to 5 those of the point,
        6 that of the geodesic curvature k, and 7 that of dk/ds.
        """
        # The columns of a frame are the tangent, another axis and the point.
        frame = extract_derivative(frames.frame)
        tangent = frame[:, :, 0].T
        point = frame[:, :, 2].T
        curvature = extract_derivative(frames.curvature)
        curvature_rate = extract_derivative(frames.curvature_rate)
        if self.backwards:
            # A backwards curve has the same points with the opposite tangents. Its
            # curvature, positive to the left, has the opposite sign. In dk/ds the signs of
            # k and of s cancel.
            tangent = -tangent
            curvature = -curvature
        return np.concatenate([tangent, point, curvature[None], curvature_rate[None]])


def differentiate_fourier(
    centre: tuple[ArrayLike, ArrayLike],
    cosines: tuple[ArrayLike, ArrayLike],
    sines: tuple[ArrayLike, ArrayLike] = ((), ()),
    backwards: bool = False,
) -> CurveDerivative:
    """Return the derivative of the curve of `spherekit.geometry.profile_curve.fourier`.

    The colatitude (angle from the centre) of the curve is a Fourier series of the azimuth
    about the centre. With one coefficient, the radius, the curve is a circle. All arguments
    depend on a design variable. Each one has two parts: value and derivative.

    Parameters
    ----------
    centre
        Unit vector (3,), and its derivative with respect to the design variable.
    cosines, sines
        Coefficients (rad) of the colatitude, and their derivatives.
    backwards
        Whether the curve is run in the opposite direction.
    """
    order_count = max(np.size(cosines[0]), np.size(sines[0]))
    cosine_values = _append_zeros(cosines[0], order_count)
    cosine_rates = _append_zeros(cosines[1], order_count)
    sine_values = _append_zeros(sines[0], order_count)
    sine_rates = _append_zeros(sines[1], order_count)
    centre_value, centre_rate = centre

    path = FourierPath(
        axes_about(np.asarray(centre_value, dtype=float)), cosine_values, sine_values
    )
    # The moving path has complex numbers. Their real parts are the values, their scaled
    # imaginary parts the derivatives with respect to the design variable (complex step).
    moving_path = FourierPath(
        axes_about(add_complex_step(centre_value, centre_rate)),
        add_complex_step(cosine_values, cosine_rates),
        add_complex_step(sine_values, sine_rates),
    )
    # The arc length is the integral of the speed over the azimuth. The edges divide the
    # turn into panels, four for each order of the series. In a panel the speed varies so
    # little that the integral is accurate.
    edges = azimuth_panels(order_count)
    arc_length_rate = _integrate_speed_rate(moving_path, edges)
    variation = PathVariation(
        path=moving_path,
        arc_length=measure_arc_length(path, edges),
        arc_length_rate=arc_length_rate,
        # The integral over all azimuths: the derivative of the whole length.
        length_rate=arc_length_rate.length,
        closed=True,
    )
    return CurveDerivative(variation, backwards)


def _append_zeros(coefficients: ArrayLike, count: int) -> Floats:
    """Return coefficients followed by zeros, `count` numbers together."""
    padded = np.zeros(count)
    padded[: np.size(coefficients)] = coefficients
    return padded


def differentiate_spline(
    points: ArrayLike, change: ArrayLike, closed: bool, backwards: bool = False
) -> CurveDerivative:
    """Return the derivative of a spline curve with respect to a design variable.

    The curve is a contact profile that runs smoothly through points. The points depend on
    the design variable. The derivatives of computed quantities with respect to this
    variable follow from the result.
    `spherekit.geometry.profile_curve.through` computes the curve itself.

    Parameters
    ----------
    points
        (m, 3) unit vectors in the order of the curve.
    change
        (m, 3) derivatives of these vectors with respect to the design variable.
    closed
        Whether the curve is closed.
    backwards
        Whether the curve is run in the opposite direction.
    """
    variation = _vary_spline(
        np.asarray(points, dtype=float), np.asarray(change, dtype=float), closed
    )
    return CurveDerivative(variation, backwards)
