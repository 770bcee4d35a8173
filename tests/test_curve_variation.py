"""Curves that change, against differences of the curves themselves."""

import numpy as np
import pytest

from spherekit.geometry.curve_variation import differentiate_fourier, differentiate_spline
from spherekit.geometry.profile_curve import circle, fourier, through

STEP = 1e-5
CENTRE = np.array([0.36, 0.48, 0.8])
SIDEWAYS = np.array([-0.8, 0.6, 0.0])


def points_of(move, count=9, whole=2.0 * np.pi):
    """Return points near a circle, and what they move by, random numbers apart."""
    rng = np.random.default_rng(4)
    a = np.arange(count) * whole / count
    r = 0.7 + 0.1 * np.cos(2.0 * a) + 0.03 * rng.normal(size=count)
    points = np.stack([np.sin(r) * np.cos(a), np.sin(r) * np.sin(a), np.cos(r)], axis=1)
    change = rng.normal(size=points.shape)
    change -= np.sum(change * points, axis=1)[:, None] * points
    moved = points + move * change
    return moved / np.linalg.norm(moved, axis=1)[:, None], change


def turned(angle):
    return np.cos(angle) * CENTRE + np.sin(angle) * SIDEWAYS


def curves(kind, backwards=False):
    """Return a function of a number, and the curve varied by it."""
    if kind == "circle":
        varied = differentiate_fourier(
            (CENTRE, SIDEWAYS), ([0.6], [1.0]), backwards=backwards
        )
        return lambda x: circle(turned(x), 0.6 + x), varied
    if kind == "fourier":
        even, odd = np.array([0.6, 0.1, 0.05]), np.array([0.0, 0.02, 0.0])
        moved = np.array([0.2, -1.0, 0.5]), np.array([0.0, 0.3, 1.0])
        varied = differentiate_fourier(
            (CENTRE, SIDEWAYS), (even, moved[0]), (odd, moved[1]), backwards
        )
        return lambda x: fourier(turned(x), even + x * moved[0], odd + x * moved[1]), varied
    closed = kind == "closed"
    whole = 2.0 * np.pi if closed else 4.0
    points, change = points_of(0.0, whole=whole)
    varied = differentiate_spline(points, change, closed, backwards)
    return lambda x: through(points_of(x, whole=whole)[0], closed), varied


def columns(curve, s):
    there = curve.evaluate(s)
    rows = [there.frame[:, :, 0].T, there.frame[:, :, 2].T]
    return np.concatenate([*rows, there.curvature[None], there.curvature_rate[None]])


@pytest.mark.many
@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize("kind", ["circle", "fourier", "closed", "open"])
def test_what_a_curve_changes_by_is_its_difference(kind, backwards):
    made, varied = curves(kind, backwards)

    def at(x, s):
        curve = made(x)
        return columns(curve.reversed() if backwards else curve, s)

    length = made(0.0).length
    s = np.linspace(0.01, 0.97, 41) * length
    if kind != "open":
        s = np.concatenate([s, s + 2.0 * length, s - length])
    wanted = (at(STEP, s) - at(-STEP, s)) / (2.0 * STEP)
    scale = np.max(np.abs(wanted), axis=1, initial=1.0)
    off = np.max(np.abs(varied(s) - wanted), axis=1) / scale
    assert np.all(off < [3e-5] * 7 + [1e-3])


@pytest.mark.many
@pytest.mark.parametrize("kind", ["circle", "fourier", "closed", "open"])
def test_the_second_derivative_of_the_curvature(kind):
    made, _ = curves(kind)
    for curve in (made(0.0), made(0.0).reversed()):
        s = np.linspace(0.05, 0.93, 37) * curve.length
        more, less = (curve.evaluate(s + h).curvature_rate for h in (STEP, -STEP))
        second = curve.curvature_second(s)
        wanted = (more - less) / (2.0 * STEP)
        assert second == pytest.approx(wanted, rel=1e-6, abs=1e-4)
