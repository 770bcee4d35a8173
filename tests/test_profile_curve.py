"""Profiles: curves on the unit sphere against closed forms and 50-digit arithmetic."""

import numpy as np
import pytest
from helpers.refusals import TABLES, check_fragments
from numpy.polynomial.legendre import leggauss

from spherekit.errors import EngineError
from spherekit.geometry import profile_curve
from spherekit.geometry.parametric_curve import axes_about
from spherekit.geometry.rotation import transpose
from spherekit.geometry.triangle import arc
from spherekit.mechanism.elements import Profile
from spherekit.proof import ball_curves
from spherekit.proof.ball_curves import make_ball_curve
from spherekit.proof.ball_frames import exact_ball, exact_balls
from spherekit.proof.balls import (
    centre_floats,
    power_series,
    series_coefficient,
    widen,
    working_precision,
)

CENTRE = np.array([2.0, -1.0, 2.0]) / 3.0
COSINES, SINES = [0.8, 0.11, -0.05, 0.02], [0.0, -0.07, 0.0, 0.03]


def cam():
    return profile_curve.fourier(CENTRE, COSINES, SINES)


def spherical(longitude, latitude):
    x, y, c = np.cos(longitude), np.sin(longitude), np.cos(latitude)
    return np.stack([c * x, c * y, np.sin(latitude)], axis=-1)


def lobes(a, depth=0.2):
    """Points of a curve with three lobes; `a` is not its arc length."""
    return spherical(a, 0.6 + depth * np.sin(3 * a))


def curves():
    a = np.arange(40) * (2 * np.pi / 40)
    yield profile_curve.circle(CENTRE, 0.4)
    yield profile_curve.circle([0.0, 0.0, 1.0], 2.9)
    yield profile_curve.great_circle([1.0, 0.0, 0.0])
    yield cam()
    yield profile_curve.through(lobes(a))
    yield profile_curve.through(lobes(a[:25]), closed=False)
    yield cam().reversed()


@pytest.fixture(params=curves())
def curve(request):
    return request.param


def test_points_of_a_series_are_at_its_colatitudes():
    """Azimuth counts from x, seen from the centre; how the frame turns is shown below."""
    u, made = np.linspace(0.0, 2.0 * np.pi, 37)[:-1], cam()
    colatitude = sum(x * np.cos(k * u) for k, x in enumerate(COSINES))
    colatitude += sum(x * np.sin(k * u) for k, x in enumerate(SINES))
    first = np.eye(3)[0] - CENTRE[0] * CENTRE
    first /= np.linalg.norm(first)
    around = np.outer(np.cos(u), first) + np.outer(np.sin(u), np.cross(CENTRE, first))
    wanted = np.cos(colatitude)[:, None] * CENTRE + np.sin(colatitude)[:, None] * around
    places = made.evaluate(made.table.evaluate(u)).frame[:, :, 2]
    np.testing.assert_allclose(places, wanted, rtol=0, atol=1e-13)


@pytest.mark.parametrize("radius", [1e-3, 0.4, np.pi / 2, 2.9])
def test_circle_has_its_closed_form(radius):
    made = profile_curve.circle(CENTRE, radius)
    got = made.evaluate(np.linspace(-1.0, 2.0, 50) * made.length)
    p, n = got.frame[:, :, 2], got.frame[:, :, 1]
    np.testing.assert_allclose(made.length, 2 * np.pi * np.sin(radius), rtol=1e-15)
    np.testing.assert_allclose(arc(p, CENTRE[None]), radius, rtol=0, atol=1e-15)
    np.testing.assert_allclose(got.curvature, 1 / np.tan(radius), rtol=1e-15, atol=1e-16)
    centre = np.sin(radius) * n + np.cos(radius) * p
    np.testing.assert_allclose(centre, CENTRE[None] + 0 * p, rtol=0, atol=1e-15)
    assert np.all(got.curvature_rate == 0.0)


def test_a_circle_is_its_fourier_series_and_both_begin_on_the_same_side():
    """A Fourier series with a constant colatitude of 0.7 rad is a circle of that radius.

    Frames and curvature agree at arc lengths over more than a lap. The columns of a frame
    are tangent, normal and the point on the curve. The curvature is 1 / tan(radius). The
    start lies from the centre towards the x axis, or towards y if the centre is near x.
    """
    radius = 0.7
    for centre in (CENTRE, np.array([0.6, 0.0, -0.8]), np.array([-1.0, 0.0, 0.0])):
        circle = profile_curve.circle(centre, radius)
        series = profile_curve.fourier(centre, [radius])
        s = np.linspace(-3.0, 9.0, 31)
        frames = series.evaluate(s).frame
        np.testing.assert_allclose(circle.evaluate(s).frame, frames, atol=1e-14)
        curvature = series.evaluate(s).curvature
        np.testing.assert_allclose(curvature, 1 / np.tan(radius), rtol=1e-14)

        start_point = circle.evaluate([0.0]).frame[0, :, 2]
        start_direction = start_point - np.cos(radius) * centre
        axis = np.eye(3)[1 if abs(centre[0]) > 0.9 else 0]
        assert start_direction @ axis > 0
        assert abs(np.cross(centre, axis) @ start_direction) < 1e-15


def test_frames_obey_their_equations_in_arc_length(curve):
    """Frames of a curve obey Frenet's equations on the sphere.

    They are t' = k n - p, n' = -k t, p' = t, with derivatives by the arc length. The
    columns of a frame are the tangent t, the normal n in the sphere and the point p. k is
    the geodesic curvature. The curve is divided into about 400 short spans. In each span
    the three right-hand sides and k' are integrated by Gauss quadrature with ten nodes. The
    integrals have to be the changes of t, n, p and k over the span.
    """
    nodes, weights = leggauss(10)
    span_ends = np.union1d(np.linspace(0.0, 1.0, 401) * curve.length, curve.edges)
    half_spans = 0.5 * np.diff(span_ends)
    s = span_ends[:-1, None] + half_spans[:, None] * (1 + nodes)
    evaluated = curve.evaluate(s.ravel())
    frames = evaluated.frame
    assert np.max(np.abs(transpose(frames) @ frames - np.eye(3))) < 9e-16
    np.testing.assert_allclose(np.linalg.det(frames), 1.0, rtol=2e-15)

    t, n, p = (frames[:, :, column] for column in range(3))
    k = evaluated.curvature[:, None]
    rates = np.concatenate(
        [k * n - p, -k * t, t, evaluated.curvature_rate[:, None]], axis=1
    )
    rates = rates.reshape(-1, 10, 10)  # (spans, nodes, components of t, n, p and k)
    integrals = half_spans[:, None] * np.einsum("j,ijc->ic", weights, rates)

    at_ends = curve.evaluate(span_ends)
    values = [at_ends.frame[:, :, column] for column in range(3)]
    values.append(at_ends.curvature[:, None])
    if curve.closed:
        # The last point of a lap is its first one.
        values = [np.concatenate([value[:-1], value[:1]]) for value in values]
    changes = np.diff(np.concatenate(values, axis=1), axis=0)
    tolerance = 1e-13 * (1 + np.max(np.abs(k)))
    np.testing.assert_allclose(integrals, changes, rtol=0, atol=tolerance)


def test_reversing_and_not_a_number(curve):
    got = curve.evaluate([np.nan, 0.1, np.inf])
    assert got.inside.tolist() == [False, True, False]
    assert np.isnan(got.frame[[0, 2]]).all() and np.isnan(got.curvature[[0, 2]]).all()
    assert np.isfinite(got.frame[1]).all()
    s = np.linspace(0.0, 1.0, 40) * curve.length
    here = curve.reversed().evaluate(s)
    there = curve.evaluate(-s if curve.closed else curve.length - s)
    np.testing.assert_array_equal(here.frame, there.frame * [-1.0, -1.0, 1.0])
    np.testing.assert_array_equal(here.curvature, -there.curvature)
    np.testing.assert_array_equal(here.curvature_rate, there.curvature_rate)


def test_closed_curves_repeat_and_open_ones_stop(curve):
    """A lap further on, closed curves have the same frames and curvatures, to rounding.

    A frame has tangent, normal and point of the curve. Open curves have no points beyond
    their ends: `inside` is false there, and the frame is that of the end.
    """
    s = np.linspace(0.0, 1.0, 33) * curve.length
    first_lap = curve.evaluate(s)
    next_lap = curve.evaluate(s + curve.length)
    assert np.all(first_lap.inside)
    if curve.closed:
        assert np.all(next_lap.inside)
        assert np.all(curve.evaluate(s - 3 * curve.length).inside)
        # Rounding of s changes frames by the curvature, and curvatures by their rate.
        scale = (
            np.max(np.abs(first_lap.curvature_rate))
            + np.max(np.abs(first_lap.curvature))
            + 1
        )
        np.testing.assert_allclose(next_lap.frame, first_lap.frame, atol=1e-14 * scale)
        np.testing.assert_allclose(
            next_lap.curvature, first_lap.curvature, atol=1e-13 * scale
        )
    else:
        assert not np.any(next_lap.inside[1:])
        np.testing.assert_array_equal(next_lap.frame[5], first_lap.frame[-1])
        before_start = curve.evaluate([-0.1])
        assert not before_start.inside[0]
        np.testing.assert_array_equal(before_start.frame[0], first_lap.frame[0])


def test_curves_through_points_meet_them_and_converge_to_the_curve_they_are_from():
    """Splines through 40, 80 and 160 points of a Fourier cam pass through these points.

    The columns of a frame are tangent, normal and the point on the curve. The curvature, a
    second derivative of a quintic spline, converges with the fourth order in the distance
    of the points. Between 80 and 160 points an order of 3.6 is required, because the fourth
    is only reached for many points.
    """
    exact_curve = cam()
    curvature_errors = []
    for count in (40, 80, 160):
        arc_lengths = exact_curve.length * np.arange(count) / count
        points = exact_curve.evaluate(arc_lengths).frame[:, :, 2]
        spline = profile_curve.through(points)
        # The knots are the parameters of the spline at the points. `table` has the exact
        # arc lengths at the knots. The last knot of a closed curve is the first point
        # again.
        knot_lengths = spline.table.evaluate_at_edges(spline.path.knots)
        points_at_knots = spline.evaluate(knot_lengths[:-1]).frame[:, :, 2]
        np.testing.assert_allclose(points_at_knots, points, rtol=0, atol=2e-14)

        laps = np.linspace(0.0, 1.0, 500)
        curvature = spline.evaluate(laps * spline.length).curvature
        exact_curvature = exact_curve.evaluate(laps * exact_curve.length).curvature
        curvature_errors.append(np.max(np.abs(curvature - exact_curvature)))
    order = np.log2(curvature_errors[1] / curvature_errors[2])
    assert order > 3.6, curvature_errors


def eight(count, shift):
    a = (np.arange(count) + shift) * (2 * np.pi / count)
    return spherical(0.8 * np.sin(a), 0.4 * np.sin(2 * a))


TURN, BACK = np.arange(12) * (2 * np.pi / 12), 0.1 * np.array([0, 1, 2, 3, 2, 1, -1])
RING = spherical(TURN, 0.3 + 0 * TURN)


@pytest.mark.parametrize("call", TABLES["profiles"])
def test_wrong_profiles_are_refused_in_words(call):
    with pytest.raises(ValueError) as told:
        eval(call, {**vars(profile_curve), **globals()})
    check_fragments(str(told.value), TABLES["profiles"][call])


def test_curves_that_do_not_cross_or_are_open_are_accepted():
    assert not profile_curve.through(eight(16, 0.5), closed=False).closed
    assert (
        profile_curve.through(np.concatenate([RING, RING[:1]]), closed=False).length < 6.1
    )
    # two long flanks 1e-3 rad apart, and points that crowd together on one side
    a = np.arange(300) * (2 * np.pi / 300)
    assert profile_curve.through(spherical(0.5 * np.cos(a), 1e-3 * np.sin(a))).closed
    assert profile_curve.through(lobes(a + 0.95 * np.sin(a))).closed


@pytest.mark.parametrize("gap", [0.3, 1e-3, 1e-5])
@pytest.mark.parametrize("pole", [[0.0, 0.0, 1.0], CENTRE])
def test_a_closed_curve_along_a_great_circle_may_have_points_at_uneven_distances(gap, pole):
    """Arcs of the same great circle that follow one another do not meet."""
    longitudes = np.array([0.0, 1.0, 2.0, 3.0, 3.0 + gap, 4.0, 5.0])
    points = spherical(longitudes, 0.0 * longitudes) @ axes_about(pole).T
    made = profile_curve.through(points)
    assert abs(made.length - 2.0 * np.pi) < 1e-13


def test_the_axes_about_a_centre_in_single_precision_are_orthonormal_to_rounding():
    axes = axes_about(np.array([0.8, 0.0, 0.6], dtype=np.float32))
    np.testing.assert_allclose(axes.T @ axes, np.eye(3), rtol=0, atol=1e-15)


def test_arc_lengths_invert_to_rounding(curve):
    """The inverse series against the integral of the speed, at places between its own."""
    table = curve.table
    if table is None:
        return
    s = np.random.default_rng(7).uniform(0.0, table.length, 3000)
    u = table.invert(s)
    assert np.max(np.abs(table.evaluate(u) - s)) < 4e-15 * max(1.0, table.length)
    nodes, weights = leggauss(60)
    for place, where in zip(s[:20], u[:20], strict=True):
        cuts = np.append(table.edges[table.edges < where], where)
        half = 0.5 * np.diff(cuts)[:, None]
        speed = curve.path.speed(cuts[:-1, None] + half * (1.0 + nodes))
        assert abs(np.sum(half * weights * speed) - place) < 1e-13


def arc_length_at(curve, point, low, high):
    """Return the arc length between two others at which a curve passes a point, exactly.

    The tangent is perpendicular to the point there. The result has 53 bits.
    """
    for _ in range(60):
        middle = 0.5 * (low + high)
        (frame,) = centre_floats(curve(exact_balls([middle])))
        if frame[:, 0] @ point > 0.0:
            low = middle
        else:
            high = middle
    return middle


@pytest.mark.parametrize("knot", [0, 2])
def test_balls_about_a_knot_contain_the_curve_on_both_sides(knot):
    """A ball about a knot of a spline encloses the curve on both sides of the knot.

    A ball is a number with an error bound. A knot is a point where two polynomials of the
    spline meet. The polynomials have different fifth derivatives, so a ball about the knot
    must enclose both. Coefficients of power series of the frames are compared, at a ball
    about the knot and at exact arc lengths within it. The knot 0 is the seam of the closed
    profile.
    """
    azimuths = np.radians([0.0, 60.0, 130.0, 185.0, 240.0, 300.0])
    colatitudes = np.radians([30.0, 36.0, 29.0, 38.0, 33.0, 35.0])
    sines = np.sin(colatitudes)
    points = np.column_stack(
        [sines * np.cos(azimuths), sines * np.sin(azimuths), np.cos(colatitudes)]
    )
    profile = Profile("points", points=tuple(map(tuple, points.tolist())))
    radius = 1e-6
    zero, one = exact_balls([0.0, 1.0])
    with working_precision(150):
        curve = make_ball_curve(profile)

        def frame_coefficients(s):
            """Return the coefficients of the frame at s + x for the powers 0 to 6 of x."""
            coefficients_of_argument = [s, one, zero, zero, zero, zero, zero]
            series = power_series(*([value] for value in coefficients_of_argument))
            frames = curve(series)
            return np.array([series_coefficient(frames, power) for power in range(7)])

        centre = 0.0
        if knot:
            # The great arcs from point to point up to the knot. The curve is a little
            # longer than their sum, so the knot is between these limits.
            great_arcs = np.arccos(np.vecdot(points[:-1], points[1:]))
            sum_of_arcs = np.cumsum(great_arcs)[knot - 1]
            low = 0.9 * sum_of_arcs
            high = 1.2 * sum_of_arcs
            centre = arc_length_at(curve, points[knot], low, high)
        about_knot = frame_coefficients(widen(exact_ball(centre), radius))
        for side in (-0.5, 0.5):
            beside = frame_coefficients(exact_ball(centre + side * radius))
            for ball, value in zip(about_knot.flat, beside.flat, strict=True):
                # The exact value is somewhere in the tiny ball `value`. The large ball can
                # contain it only if both overlap.
                assert ball.overlaps(value)


def test_an_expansion_over_arc_length_has_at_most_the_largest_number_of_panels(monkeypatch):
    """This spline needs one panel for each of its intervals, or more."""
    azimuths = np.radians([0.0, 60.0, 120.0, 180.0, 240.0, 300.0])
    points = spherical(azimuths, np.radians([50.0, 55.0, 52.0, 58.0, 51.0, 54.0]))
    profile = Profile("points", points=tuple(map(tuple, points.tolist())))
    panel_count = 0
    make_series = ball_curves.power_series

    def count_series(*coefficients):
        nonlocal panel_count
        panel_count += 1
        return make_series(*coefficients)

    # Each panel starts with one power series.
    monkeypatch.setattr(ball_curves, "power_series", count_series)
    with working_precision(70):
        make_ball_curve(profile)
    needed_count = panel_count
    assert needed_count >= len(points)
    monkeypatch.setattr(ball_curves, "MAX_ARC_LENGTH_PANELS", needed_count)
    ball_curves._make_curve.cache_clear()
    with working_precision(70):
        make_ball_curve(profile)
    monkeypatch.setattr(ball_curves, "MAX_ARC_LENGTH_PANELS", needed_count - 1)
    ball_curves._make_curve.cache_clear()
    with working_precision(70), pytest.raises(EngineError, match="does not converge"):
        make_ball_curve(profile)
