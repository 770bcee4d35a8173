"""Profiles of contact pairs as curves on the unit sphere, in balls and power series.

Angles, radii and coefficients of a profile count as exact float64 numbers, and directions
are made unit vectors. A profile through points is the quintic spline that
`spherekit.geometry.profile_curve` lays through them: its float64 knots and coefficients
define it. Curves return points and tangents only. Derivatives come from power series, so
the module has no formulas for curvatures.
"""

from collections.abc import Callable
from functools import lru_cache
from itertools import pairwise, zip_longest

import numpy as np
from numpy.polynomial.polynomial import polyval

from spherekit.arrays import Array, Floats, Indices
from spherekit.errors import EngineError
from spherekit.geometry.parametric_curve import SplinePath
from spherekit.geometry.profile_curve import spline_through
from spherekit.mechanism.elements import Profile
from spherekit.proof.ball_frames import (
    azimuth_frame,
    exact_ball,
    exact_balls,
    unit_vector,
)
from spherekit.proof.balls import (
    Ball,
    ball_ends,
    centre_floats,
    enclose_both,
    pi_ball,
    power_series,
    precision_bits,
    series_coefficient,
    series_length_limit,
    sine_cosine,
)

MAX_ARC_LENGTH_PANELS = 10_000
"""Largest number of panels (pieces) in the expansion of a profile over its arc length.

Larger: profiles with sharper bends succeed, slowly. Smaller: they are refused.
"""

MAX_CACHED_CURVES = 32
"""Number of curves that are remembered, by profile and precision.

Larger: more memory. Smaller: curves are computed again.
"""

PANEL_REDUCTION = 0.7
"""Width of each panel that is tried, over the width of the panel before it.

Larger: more trials. Smaller: panels are narrower than necessary.
"""

CONVERGENCE_MARGIN = 0.9
"""Used part of the estimated distance at which a series has all digits.

Larger: fewer panels, and some may lack digits. Smaller: more panels.
"""

Curve = Callable[[Array], Array]
"""Returns the frames (n, 3, 3) of a curve at arc lengths (n,) rad.

The columns are the unit tangent t, the normal n = p x t, and the point p.
"""

Path = Callable[[Array], tuple[Array, Array]]
"""Returns points (n, 3) and their derivatives (n, 3) with respect to a parameter (n,).

The points are unit vectors. The parameter is not the arc length.
"""


def evaluate_rotation(terms: Array, angles: Array) -> Array:
    """Return the rotation matrices (n, 3, 3) of a link at angles about its pair axis.

    Each is terms[0] + cos(angle) terms[1] + sin(angle) terms[2] with the three matrices of
    `terms` (3, 3, 3). `angles` (n,) in rad are balls (numbers with a bound of their error),
    or power series with such coefficients.
    """
    sine, cosine = (array[:, None, None] for array in sine_cosine(angles))
    return terms[0] + terms[1] * cosine + terms[2] * sine


def make_ball_curve(profile: Profile, backwards: bool = False) -> Curve:
    """Return the curve of a profile in balls of the present precision.

    A profile is the rim of a link that touches another link. A ball is a number with a
    bound of its error; the caller sets its number of digits (`working_precision`).

    The curve is a function of arc lengths (n,). It returns frames (n, 3, 3) with the
    columns tangent, normal and point.

    Parameters
    ----------
    profile
        The profile in the axes of its link.
    backwards
        Whether to run the curve in the opposite sense, an open curve from its end.
    """
    # `reverse_start` is the arc length from which the reversed curve starts.
    curve, reverse_start = _make_curve(profile, precision_bits())
    if not backwards:
        return curve

    def reversed_curve(s: Array) -> Array:
        """Return the frames (n, 3, 3) at arc lengths (n,) in the opposite sense."""
        # Tangent and normal change their signs, the point does not.
        return curve(reverse_start - s) * [-1, -1, 1]

    return reversed_curve


@lru_cache(maxsize=MAX_CACHED_CURVES)
def _make_curve(profile: Profile, _precision_bits: int) -> tuple[Curve, Ball]:
    """Return the curve of a profile in ball arithmetic, and where its reverse starts.

    A profile is the rim of a link that touches another link. The caller may reverse the
    curve, and needs the arc length at which the reversed curve starts.

    The curve is a function of arc lengths (n,). It returns frames (n, 3, 3) with the
    columns tangent, normal and point. All numbers are balls, with a centre and a radius
    that bounds the error of the centre. The float64 numbers of the profile count as exact
    (radius 0).

    Parameters
    ----------
    profile
        The profile in the axes of its link: a circle, a spline through points, or a Fourier
        sum. The Fourier profile gives the angle from the centre at each azimuth.
    _precision_bits
        Present number of bits, a key of the cache, because results depend on the precision.

    Returns
    -------
    curve
        The frames as a function of the arc length.
    reverse_start
        The arc length (rad) from which a reversed curve starts: the length of an open
        curve, 0 for a closed one.
    """
    # `_by_arc_length` turns a path with any parameter into a curve by arc length. It needs
    # values of the parameter between which the path is smooth: all knots of a spline, or
    # just both ends.
    if profile.kind == "points":
        spline, _table = spline_through(np.array(profile.points), profile.closed)
        spline_path = _SphericalSpline(spline).evaluate
        return _by_arc_length(spline_path, exact_balls(spline.knots), profile.closed)
    assert profile.centre is not None  # only profiles through points have no centre
    axes = azimuth_frame(unit_vector(exact_balls(profile.centre)))
    if profile.kind == "fourier":
        fourier_path = _make_fourier_path(
            axes, exact_balls(profile.cosines), exact_balls(profile.sines)
        )
        # The parameter is the azimuth, over one turn from 0 to 2 pi.
        azimuth_ends = exact_balls([0.0, 2.0]) * pi_ball()
        return _by_arc_length(fourier_path, azimuth_ends, closed=True)
    if profile.kind == "circle":
        assert profile.radius is not None  # every circle has a radius
        sine, cosine = exact_ball(profile.radius).sin_cos()
    else:
        # The only other kind is a great circle, with a radius of 90 degrees.
        sine, cosine = exact_balls([1.0, 0.0])
    # A circle is closed, so its reverse starts at 0.
    return _make_circle(axes, sine, cosine), exact_ball(0.0)


def _make_circle(axes: Array, sine: Ball, cosine: Ball) -> Curve:
    """Return the curve of a circle on the unit sphere, with centre z and angular radius r.

    All numbers are balls (numbers with a bound of their error). The azimuth about z is a =
    (arc length) / sin(r). The frame at a is

        tangent = y cos(a) - x sin(a),
        normal  = z sin(r) - (x cos(a) + y sin(a)) cos(r),
        point   = z cos(r) + (x cos(a) + y sin(a)) sin(r).

    Parameters
    ----------
    axes
        (3, 3) rows x, y and z: the directions of azimuth 0 and 90 degrees, and the centre.
    sine, cosine
        Sine and cosine of the angular radius r.
    """
    x, y, z = axes
    # The frame is constant_part + cos(a) cosine_part + sin(a) sine_part. The columns of
    # each part belong to the tangent, the normal and the point.
    constant_part = np.stack([0 * z, sine * z, cosine * z], axis=1)
    cosine_part = np.stack([y, -cosine * x, sine * x], axis=1)
    sine_part = np.stack([-x, -cosine * y, sine * y], axis=1)
    terms = np.array([constant_part, cosine_part, sine_part])

    def circle(s: Array) -> Array:
        """Return the frames (n, 3, 3) at arc lengths (n,) rad."""
        azimuth = s / sine
        return evaluate_rotation(terms, azimuth)

    return circle


def _by_arc_length(path: Path, knots: Array, closed: bool) -> tuple[Curve, Ball]:
    """Return the curve of a path as a function of its arc length.

    A path has any parameter, but contacts need the arc length. The curve is divided into
    panels. In each panel the arc length is computed as a power series of the parameter. The
    inverse of the series gives the parameter as a function of the arc length. The panels
    are so short that both series are accurate to all digits.

    Parameters
    ----------
    path
        Returns points (n, 3) on the unit sphere and their derivatives (n, 3) at values (n,)
        of its parameter. The path is analytic between neighbouring knots.
    knots
        Values of its parameter, in order.
    closed
        Whether the path is closed.

    Returns
    -------
    curve
        Returns frames (n, 3, 3) at arc lengths (n,); columns are tangent, normal and point.
    reverse_start
        The arc length (rad) from which a reversed curve starts: the length of an open
        curve, 0 for a closed one.

    Raises
    ------
    EngineError
        If the required accuracy needs too many panels (pieces of the profile).
    """
    bits = precision_bits()
    # `panel_starts` has the arc length at which each panel begins, and at last the whole
    # length. `panel_series` has the coefficients of the parameter as a series of the arc
    # length from the start of the panel on. More terms make longer panels.
    term_count = 8 + bits // 3
    panel_starts: list[Ball] = [exact_ball(0.0)]
    panel_series: list[list[Ball]] = []
    with series_length_limit(term_count):
        for low, high in pairwise(knots):
            while centre_floats(high - low) > 0.0:
                if len(panel_series) >= MAX_ARC_LENGTH_PANELS:
                    raise EngineError(
                        "the arc length of a profile does not converge; space its points "
                        "more evenly, or give a Fourier profile fewer coefficients"
                    )
                # The parameter low + x as a series in x, and the arc length as its
                # integral.
                parameter = power_series(*np.array([[low, 1, *[0] * (term_count - 2)]]).T)
                speed = vector_lengths(path(parameter)[1])
                arc_series = speed.item().integral()
                # The coefficients without their radii, so that errors do not accumulate.
                arc_of_parameter, parameter_of_arc = (
                    [series[power].mid() for power in range(term_count)]
                    for series in (arc_series, arc_series.reversion())
                )
                # Width of the panel, as a part of the remaining distance to the next knot.
                width = min(
                    1.0, _convergence_distance(arc_of_parameter, bits) / float(high - low)
                )
                # Shorten the panel until the reversed series has all digits as well.
                while True:
                    end = low + (high - low) * width if width < 1.0 else high
                    arc = polyval(end - low, arc_of_parameter).mid()
                    largest_arc = _convergence_distance(parameter_of_arc, bits)
                    if width == 0.0 or float(arc) < largest_arc:
                        break
                    width *= PANEL_REDUCTION
                panel_starts.append(panel_starts[-1] + arc)
                panel_series.append([low, *parameter_of_arc[1:]])
                low = end.mid()
    starts = np.array(panel_starts)
    length = panel_starts[-1]
    series_table: Array = np.array(panel_series)
    float_starts = centre_floats(starts)

    panel_count = len(series_table)

    def find_panels(s_floats: Floats) -> Indices:
        """Return the panels of arc lengths (n,) rad, counted on in each further lap."""
        s_floats = np.nan_to_num(s_floats)
        laps = np.floor(s_floats / float_starts[-1]) if closed else np.zeros(len(s_floats))
        within_lap = s_floats - laps * float_starts[-1]
        panels = np.searchsorted(float_starts[1:-1], within_lap, side="right")
        return panels + panel_count * laps.astype(np.intp)

    def evaluate_panels(s: Array, panels: Indices) -> Array:
        """Return the frames (n, 3, 3) at arc lengths (n,) rad, by the series of panels."""
        laps, panel = np.divmod(panels, panel_count)
        s = s - exact_balls(laps.astype(float)) * length - starts[panel]
        point, rate = path(polyval(s, series_table[panel].T, tensor=False))
        tangent = rate / vector_lengths(rate)[:, None]
        return np.stack([tangent, np.cross(point, tangent), point], axis=-1)

    def curve(s: Array) -> Array:
        """Return the frames (n, 3, 3) of the curve at arc lengths s (n,) rad."""
        return _enclose_pieces(evaluate_panels, s, find_panels)

    return curve, exact_ball(0.0) if closed else length


def _enclose_pieces(
    evaluate: Callable[[Array, Indices], Array],
    parameters: Array,
    find_pieces: Callable[[Floats], Indices],
) -> Array:
    """Return balls that contain the values of a piecewise function on whole balls.

    A ball is a number with a bound of its error, that is an interval. If the interval
    contains ends of pieces, the result contains the values of all pieces that it meets.

    Parameters
    ----------
    evaluate
        Function that takes parameters (n,) and indices of pieces (n,). It returns values
        (n, ...), each by the formula of the piece, also outside this piece.
    parameters
        (n,) balls, or power series of balls. In a series the constant term decides the
        piece.
    find_pieces
        Function that returns, for float64 parameters (n,), the index of the piece (interval
        of the curve) that contains each. Larger parameters have larger indices.
    """
    low, high = ball_ends(series_coefficient(parameters, 0))
    pieces = find_pieces(low)
    last_pieces = find_pieces(high)
    values = evaluate(parameters, pieces)
    # Most balls meet one piece only. For the other balls, the values of the next pieces are
    # added one by one.
    while np.any(pieces < last_pieces):
        pieces = np.minimum(pieces + 1, last_pieces)
        values = enclose_both(values, evaluate(parameters, pieces))
    return values


def _convergence_distance(coefficients: list[Ball], bits: int) -> float:
    """Return how far from its centre a power series is exact to the wanted bits.

    Beyond this distance x, the terms that were left out matter. The distance is estimated
    from the last coefficients c_n. The term c_n x^n is below the last bit if abs(c_n) x^n
    <= 2^-bits, that is for

        ln x <= -(bits ln 2 + ln abs(c_n)) / n.

    The largest x that satisfies this for the last four terms is an estimate. (A single term
    could be zero by chance.) The result is the estimate, reduced by `CONVERGENCE_MARGIN`.

    Parameters
    ----------
    coefficients
        Five or more coefficients c_n of the series, the power 0 first.
    bits
        Bits that the sum of the series must have.
    """
    count = len(coefficients)
    powers = np.arange(count - 4, count)
    last_coefficients = centre_floats(np.array(coefficients[-4:]))
    with np.errstate(divide="ignore"):
        logs = np.log(np.abs(last_coefficients))
    log_distances = -(bits * np.log(2.0) + logs) / powers
    return np.exp(np.min(log_distances)) * CONVERGENCE_MARGIN


def _make_fourier_path(axes: Array, cosines: Array, sines: Array) -> Path:
    """Return the path on the sphere of a profile that a Fourier sum describes.

    The profile is a curve around a point of the sphere, its centre. The angle from the
    centre, r, is a function of the azimuth a about the centre: r(a) = sum over k of
    cosines[k] cos(k a) + sines[k] sin(k a).

    Parameters
    ----------
    axes
        (3, 3) rows: the directions of azimuth 0 and 90 degrees, and of the centre.
    cosines, sines
        Coefficients (rad) for k = 0, 1, 2, ...
    """
    x, y, z = axes

    def path(azimuth: Array) -> tuple[Array, Array]:
        """Return points at azimuths (n,) rad, and derivatives with respect to azimuth.

        Azimuths and results are balls (numbers with error bounds), or power series of
        balls.
        """
        # `colatitude` is the angle r between the point and the centre z of the curve;
        # `colatitude_rate` is its derivative with respect to azimuth.
        colatitude, colatitude_rate = _evaluate_colatitude(azimuth, cosines, sines)
        # The point is cos(r) z + sin(r) outward. The unit vectors x and y are perpendicular
        # to z, at azimuths 0 and 90 degrees. `outward` is the unit vector between them at
        # the azimuth of the point, and `along` is its derivative.
        azimuth_sine, azimuth_cosine = (part[:, None] for part in sine_cosine(azimuth))
        outward = azimuth_cosine * x + azimuth_sine * y
        along = azimuth_cosine * y - azimuth_sine * x
        sine, cosine = (part[:, None] for part in sine_cosine(colatitude))
        point = cosine * z + sine * outward
        rate = colatitude_rate[:, None] * (cosine * outward - sine * z) + sine * along
        return point, rate

    return path


def _evaluate_colatitude(
    azimuth: Array, cosines: Array, sines: Array
) -> tuple[Array, Array]:
    """Return the angle from the centre of a Fourier profile, and its azimuth derivative.

    Parameters
    ----------
    azimuth
        (n,) azimuths a (rad), as balls (numbers with error bounds), or power series of
        balls.
    cosines, sines
        Coefficients (rad): the angle is the sum of cosines[k] cos(k a) + sines[k] sin(k a).
        The two lists may differ in length.

    Returns
    -------
    Angles (n,) rad from the centre and their derivatives (n,), as balls or series like
    `azimuth`.
    """
    # Zeros of the kind of the azimuth: balls or series.
    colatitude = 0 * azimuth
    slope = 0 * azimuth
    coefficients = zip_longest(cosines, sines, fillvalue=0)
    for harmonic, (cosine_factor, sine_factor) in enumerate(coefficients):
        sine, cosine = sine_cosine(harmonic * azimuth)
        colatitude = colatitude + (cosine_factor * cosine + sine_factor * sine)
        slope = slope + harmonic * (sine_factor * cosine - cosine_factor * sine)
    return colatitude, slope


class _SphericalSpline:
    """A quintic spline in space, projected from the centre onto the unit sphere, in balls.

    The spline is the profile (rim) of a link. A ball is a number with a bound of its error.
    The float64 knots and control points of the spline count as exact.

    The spline is one polynomial between two knots. If a ball contains a knot, the result
    contains the values of the polynomials on both sides.
    """

    def __init__(self, spline_path: SplinePath) -> None:
        """Store the degree, the control points (m, 3) in balls, and the knots (float64)."""
        self._degree: int = spline_path.spline.k
        self._control_points = exact_balls(spline_path.spline.c)
        self._knots: Floats = spline_path.spline.t

    def evaluate(self, parameter: Array) -> tuple[Array, Array]:
        """Return unit vectors (n, 3) and their derivatives with respect to the parameter.

        The parameters (n,) are balls (numbers with a bound of their error), or power series
        of balls. The results are of the same kind.
        """
        points_and_rates = _enclose_pieces(
            self._evaluate_intervals, parameter, self._find_intervals
        )
        return points_and_rates[:, 0], points_and_rates[:, 1]

    def _find_intervals(self, parameter_floats: Floats) -> Indices:
        """Return, for each parameter (n,), the index of its interval between knots."""
        # The first degree + 1 knots are not after the start of the curve, and the last
        # degree + 1 knots are not before its end. Only the knots between them separate
        # intervals.
        inner_knots = self._knots[self._degree + 1 : len(self._control_points)]
        return np.searchsorted(inner_knots, parameter_floats, side="right")

    def _evaluate_intervals(self, parameter: Array, interval: Indices) -> Array:
        """Return points on the unit sphere and their derivatives (n, 2, 3).

        Each parameter (n,) is evaluated with the polynomial of its `interval` (n,), which
        is numbered from the start of the curve.
        """
        # The polynomial of interval i depends on degree + 1 control points, the first of
        # which has index i. It also depends on 2 * degree knots, the first of which has
        # index i + 1. Each column of the arrays has the indices for one parameter.
        point_numbers = interval + np.arange(self._degree + 1)[:, None]
        knot_numbers = interval + np.arange(1, 2 * self._degree + 1)[:, None]
        spline_point, derivative = _evaluate_de_boor(
            self._control_points[point_numbers],
            # The knots as balls without error.
            exact_balls(self._knots[knot_numbers]),
            parameter,
        )
        # From the spline in space to the sphere.
        return _project_to_sphere(spline_point, derivative)


def _evaluate_de_boor(
    control_points: Array, knots: Array, parameter: Array
) -> tuple[Array, Array]:
    """Return a spline in space and its derivative at n parameters, by de Boor's algorithm.

    All numbers are balls (numbers with a bound of their error), or power series of balls.

    Parameters
    ----------
    control_points
        (degree + 1, n, 3) the control points on which the spline depends at each parameter.
    knots
        (2 degree, n) the knots on which the spline depends there, in rising order.
    parameter
        (n,) parameters. Each is between the knots number degree - 1 and degree.

    Returns
    -------
    Points (n, 3) and derivatives with respect to the parameter (n, 3).
    """
    degree = len(control_points) - 1
    points = list(control_points)
    u = parameter[:, None]
    # Each level replaces the points by interpolations between neighbours, so one point less
    # remains. The last two points are interpolated below.
    for level in range(degree - 1):
        interpolated_points = []
        for k in range(degree - level):
            # De Boor's formula: points k and k + 1 are interpolated linearly between the
            # knots k + level and k + degree.
            low = knots[k + level][:, None]
            high = knots[k + degree][:, None]
            slope = (points[k + 1] - points[k]) / (high - low)
            interpolated_points.append(points[k] + (u - low) * slope)
        points = interpolated_points
    # The same formula on the last level: k is 0, and the level is degree - 1. The two knots
    # are the knots on both sides of the parameter.
    first_point, last_point = points
    low = knots[degree - 1][:, None]
    high = knots[degree][:, None]
    slope = (last_point - first_point) / (high - low)
    spline_point = first_point + (u - low) * slope
    # Another formula of de Boor: the derivative is the last slope, times the degree.
    derivative = degree * slope
    return spline_point, derivative


def _project_to_sphere(space_point: Array, space_rate: Array) -> Array:
    """Project points of a curve in space from the centre onto the unit sphere.

    All numbers are balls (numbers with a bound of their error), or power series of balls.

    Parameters
    ----------
    space_point, space_rate
        (n, 3) points of the curve, and their derivatives with respect to its parameter.

    Returns
    -------
    (n, 2, 3) the projected points, and their derivatives.
    """
    radius = vector_lengths(space_point)[:, None]
    point = space_point / radius
    # Derivative of the projected point: the rate across the radius, divided by the radius.
    radial_rate = np.sum(point * space_rate, axis=1, keepdims=True)
    rate = (space_rate - radial_rate * point) / radius
    return np.stack([point, rate], axis=1)


def vector_lengths(vectors: Array) -> Array:
    """Return the lengths (n,) of vectors (n, 3).

    Their elements are balls (numbers with a bound of their error), or power series.
    """
    return np.sqrt(np.sum(vectors * vectors, axis=1))
