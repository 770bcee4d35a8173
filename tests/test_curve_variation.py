"""Curves that change, against differences of the curves themselves."""

import numpy as np
import pytest

from spherekit.geometry.curve_variation import differentiate_fourier, differentiate_spline
from spherekit.geometry.profile_curve import circle, fourier, through

STEP = 1e-5
CENTRE = np.array([0.36, 0.48, 0.8])
SIDEWAYS = np.array([-0.8, 0.6, 0.0])


def points_near_circle(parameter, count=9, whole=2.0 * np.pi):
    """Return points near a circle on the sphere, moved by a parameter.

    A curve through these points is an example of a profile whose shape changes.

    Parameters
    ----------
    parameter
        The parameter: each point moves by it times a random tangent vector.
    count, whole
        Number of points, and range (rad) over which their azimuths are spread.

    Returns
    -------
    points
        (count, 3) unit vectors.
    change
        (count, 3) the tangent vectors. They are the derivatives of the points by the
        parameter, at the parameter 0.
    """
    rng = np.random.default_rng(4)
    a = np.arange(count) * whole / count
    r = 0.7 + 0.1 * np.cos(2.0 * a) + 0.03 * rng.normal(size=count)
    points = np.stack([np.sin(r) * np.cos(a), np.sin(r) * np.sin(a), np.cos(r)], axis=1)
    change = rng.normal(size=points.shape)
    change -= np.sum(change * points, axis=1)[:, None] * points
    moved = points + parameter * change
    return moved / np.linalg.norm(moved, axis=1)[:, None], change


def moved_centre(angle):
    """Return the unit vector at an angle (rad) from `CENTRE` towards `SIDEWAYS`."""
    return np.cos(angle) * CENTRE + np.sin(angle) * SIDEWAYS


def curves(kind, backwards=False):
    """Return a family of curves, and the derivative that spherekit computes for it.

    A family is a curve on the unit sphere that changes with a parameter x. The tests
    compare the derivative by x with differences of curves of the family.

    A circle has a radius, the arc (rad) from its centre. A curve by a Fourier series has a
    varying radius: sum of cosines[k] cos(k a) + sines[k] sin(k a) at the azimuth a about
    its centre.

    Parameters
    ----------
    kind
        "circle", "fourier", or "closed" or "open" for curves through points.
    backwards
        Whether the derivative is that of the curve in the opposite direction. `curve_at`
        does not depend on this; the caller reverses its curve.

    Returns
    -------
    curve_at
        Function that returns the curve of the family at a parameter x. Near x = 0 its
        centre moves along `SIDEWAYS`, and its sizes or points change linearly.
    derivative
        Derivative at x = 0 by `differentiate_fourier` or `differentiate_spline`: a function
        of the arc length.
    """
    # Arguments of `differentiate_fourier` are pairs: a value and its derivative by x.
    centre = (CENTRE, SIDEWAYS)
    if kind == "circle":
        # A circle has only the first cosine, its radius. It grows by 1 per x.
        radius = 0.6
        cosines_with_rates = ([radius], [1.0])
        derivative = differentiate_fourier(centre, cosines_with_rates, backwards=backwards)

        def circle_at(x):
            return circle(moved_centre(x), radius + x)

        return circle_at, derivative
    if kind == "fourier":
        cosines = np.array([0.6, 0.1, 0.05])
        sines = np.array([0.0, 0.02, 0.0])
        cosine_rates = np.array([0.2, -1.0, 0.5])
        sine_rates = np.array([0.0, 0.3, 1.0])
        derivative = differentiate_fourier(
            centre, (cosines, cosine_rates), (sines, sine_rates), backwards
        )

        def fourier_at(x):
            return fourier(
                moved_centre(x), cosines + x * cosine_rates, sines + x * sine_rates
            )

        return fourier_at, derivative
    # Curves through points. The points of an open curve cover 4 rad of azimuth, less than a
    # turn.
    is_closed = kind == "closed"
    azimuth_range = 2.0 * np.pi if is_closed else 4.0
    points, rates = points_near_circle(0.0, whole=azimuth_range)
    derivative = differentiate_spline(points, rates, is_closed, backwards)

    def spline_at(x):
        moved_points, _ = points_near_circle(x, whole=azimuth_range)
        return through(moved_points, is_closed)

    return spline_at, derivative


def columns(curve, s):
    """Return (8, n) tangent, point, curvature and its rate by arc length."""
    points = curve.evaluate(s)
    tangent = points.frame[:, :, 0].T
    point = points.frame[:, :, 2].T
    curvature = points.curvature[None]
    return np.concatenate([tangent, point, curvature, points.curvature_rate[None]])


RELATIVE_TOLERANCES = np.array([3e-5] * 3 + [3e-5] * 3 + [3e-5] + [1e-3])
"""For the rows of `columns`: three components of the tangent, three of the point, curvature
and its rate. The rate of the curvature has larger errors of its differences."""


@pytest.mark.many
@pytest.mark.parametrize("backwards", [False, True])
@pytest.mark.parametrize("kind", ["circle", "fourier", "closed", "open"])
def test_the_derivative_of_a_changing_curve_is_its_central_difference(kind, backwards):
    """Derivatives of a curve by its shape are those of central differences.

    Tangent, point, curvature and its rate are differentiated by a parameter x, with which
    the family of `curves` changes. The arc length s stays fixed while x changes. The
    reference is the difference of the curves at x = STEP and x = -STEP. `backwards`
    reverses the direction of the curve.
    """
    # The derivative is that of the reversed curve if `backwards`. `curve_at` returns the
    # curve as it is.
    curve_at, derivative = curves(kind, backwards)

    def columns_at(x, s):
        """Return the columns (8, n) of the curve at a parameter x, at arc lengths s."""
        curve = curve_at(x)
        if backwards:
            curve = curve.reversed()
        return columns(curve, s)

    length = curve_at(0.0).length
    s = np.linspace(0.01, 0.97, 41) * length
    if kind != "open":
        # Also beyond one lap of a closed curve, where the change of its length counts.
        s = np.concatenate([s, s + 2.0 * length, s - length])
    differences = (columns_at(STEP, s) - columns_at(-STEP, s)) / (2.0 * STEP)
    scale = np.max(np.abs(differences), axis=1, initial=1.0)
    errors = np.max(np.abs(derivative(s) - differences), axis=1) / scale
    assert np.all(errors < RELATIVE_TOLERANCES)


@pytest.mark.parametrize("backwards", [False, True])
def test_the_derivative_of_an_open_curve_is_nan_beyond_its_ends_only(backwards):
    """An open curve has no derivative beyond its ends, and one at the ends themselves."""
    curve_at, derivative = curves("open", backwards)
    length = curve_at(0.0).length
    assert np.all(np.isnan(derivative(np.array([-0.5, -1e-9, 1.1, 1e6]) * length)))
    assert np.all(np.isfinite(derivative(np.array([0.0, 0.5, 1.0]) * length)))


@pytest.mark.many
@pytest.mark.parametrize("kind", ["circle", "fourier", "closed", "open"])
def test_the_second_derivative_of_the_curvature(kind):
    """The second derivative of curvature by arc length is a difference of the first."""
    curve_at, _ = curves(kind)
    for curve in (curve_at(0.0), curve_at(0.0).reversed()):
        s = np.linspace(0.05, 0.93, 37) * curve.length
        above, below = (curve.evaluate(s + h).curvature_rate for h in (STEP, -STEP))
        second = curve.curvature_second(s)
        expected = (above - below) / (2.0 * STEP)
        assert second == pytest.approx(expected, rel=1e-6, abs=1e-4)
