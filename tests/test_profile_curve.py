"""Profiles: curves on the unit sphere against closed forms and 50-digit arithmetic."""

import numpy as np
import pytest
from helpers.refusals import TABLES, check_fragments
from numpy.polynomial.legendre import leggauss

from spherekit.geometry import profile_curve
from spherekit.geometry.rotation import transpose
from spherekit.geometry.triangle import arc

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


def test_circles_equal_their_fourier_series_and_share_its_start():
    for centre in (CENTRE, np.array([0.6, 0.0, -0.8]), np.array([-1.0, 0.0, 0.0])):
        plain, series = (
            profile_curve.circle(centre, 0.7),
            profile_curve.fourier(centre, [0.7]),
        )
        s = np.linspace(-3.0, 9.0, 31)
        np.testing.assert_allclose(
            plain.evaluate(s).frame, series.evaluate(s).frame, atol=1e-14
        )
        np.testing.assert_allclose(
            series.evaluate(s).curvature, 1 / np.tan(0.7), rtol=1e-14
        )
        start = plain.evaluate([0.0]).frame[0, :, 2] - np.cos(0.7) * centre
        axis = np.eye(3)[1 if abs(centre[0]) > 0.9 else 0]
        assert start @ axis > 0 and abs(np.cross(centre, axis) @ start) < 1e-15


def test_frames_obey_their_equations_in_arc_length(curve):
    # integral forms over short spans, by Gauss quadrature: p, t, n and k from their rates
    x, w = leggauss(10)
    parts = np.union1d(np.linspace(0.0, 1.0, 401) * curve.length, curve.edges)
    half = 0.5 * np.diff(parts)
    s = parts[:-1, None] + half[:, None] * (1 + x)
    got = curve.evaluate(s.ravel())
    assert np.max(np.abs(transpose(got.frame) @ got.frame - np.eye(3))) < 9e-16
    np.testing.assert_allclose(np.linalg.det(got.frame), 1.0, rtol=2e-15)
    t, n, p = (got.frame[:, :, i] for i in range(3))
    k = got.curvature[:, None]
    rates = np.concatenate([k * n - p, -k * t, t, got.curvature_rate[:, None]], axis=1)
    change = half[:, None] * np.einsum("j,ijc->ic", w, rates.reshape(-1, 10, 10))
    there = curve.evaluate(parts)
    values = [*(there.frame[:, :, i] for i in range(3)), there.curvature[:, None]]
    if curve.closed:
        values = [np.concatenate([v[:-1], v[:1]]) for v in values]
    grown = np.diff(np.concatenate(values, axis=1), axis=0)
    np.testing.assert_allclose(change, grown, rtol=0, atol=1e-13 * (1 + np.max(np.abs(k))))


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
    s = np.linspace(0.0, 1.0, 33) * curve.length
    once, again = curve.evaluate(s), curve.evaluate(s + curve.length)
    assert np.all(once.inside)
    if curve.closed:
        assert np.all(again.inside) and np.all(curve.evaluate(s - 3 * curve.length).inside)
        scale = np.max(np.abs(once.curvature_rate)) + np.max(np.abs(once.curvature)) + 1
        np.testing.assert_allclose(again.frame, once.frame, atol=1e-14 * scale)
        np.testing.assert_allclose(again.curvature, once.curvature, atol=1e-13 * scale)
    else:
        assert not np.any(again.inside[1:])
        np.testing.assert_array_equal(again.frame[5], once.frame[-1])
        early = curve.evaluate([-0.1])
        assert not early.inside[0]
        np.testing.assert_array_equal(early.frame[0], once.frame[0])


def test_curves_through_points_meet_them_and_converge_to_the_curve_they_are_from():
    made, errors = cam(), []
    for count in (40, 80, 160):
        points = made.evaluate(made.length * np.arange(count) / count).frame[:, :, 2]
        spline = profile_curve.through(points)
        edges = spline.table.evaluate_at_edges(spline.path.knots)
        got = spline.evaluate(edges[:-1]).frame[:, :, 2]
        np.testing.assert_allclose(got, points, rtol=0, atol=2e-14)
        s = np.linspace(0.0, 1.0, 500)
        k = (
            spline.evaluate(s * spline.length).curvature
            - made.evaluate(s * made.length).curvature
        )
        errors.append(np.max(np.abs(k)))
    assert np.log2(errors[1] / errors[2]) > 3.6, errors


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
