"""Profiles as series in their arc length against the curves themselves."""

import numpy as np
import pytest

from spherekit.sphere.profile import fourier, through
from spherekit.sphere.profile_series import ProfileSeries


def an_open_curve():
    """Points of a wave that does not close."""
    a = np.linspace(0.0, 2.0, 15)
    c = 0.8 + 0.1 * np.sin(2.0 * a)
    points = [np.sin(c) * np.cos(a), np.sin(c) * np.sin(a), np.cos(c)]
    return through(np.stack(points, axis=1), closed=False)


@pytest.mark.parametrize(
    "curve",
    [
        fourier([0.0, 0.6, 0.8], [0.5, 0.02, 0.04], [0.0, 0.01]),
        fourier([0.0, 0.6, 0.8], [0.5, 0.02, 0.04], [0.0, 0.01]).reversed(),
        an_open_curve(),
    ],
    ids=["series", "backwards", "open"],
)
def test_series_are_the_curve(curve):
    """Frames to rounding, curvatures nearly; the slope bounds differences of dk/ds."""
    made = ProfileSeries.of(curve)
    s = np.random.default_rng(5).uniform(0.0, curve.length, 2000)
    there, found = curve.at(s), made.at(s)
    assert np.max(np.abs(found[:3].T - there.frame[:, :, 0])) < 1e-14
    assert np.max(np.abs(found[3:6].T - there.frame[:, :, 2])) < 1e-14
    assert np.allclose(found[6], there.curvature, rtol=1e-12, atol=1e-12)
    assert np.allclose(found[7], there.curvature_rate, rtol=1e-9, atol=1e-9)
    h = 1e-5
    near = np.clip(s, h, curve.length - h)
    more, less = (curve.at(near + step).curvature_rate for step in (h, -h))
    assert np.max(np.abs(more - less) / (2.0 * h)) <= made.most_bent


def test_beyond_the_ends():
    """A closed curve repeats itself, an open one ends."""
    closed = fourier([0.0, 0.6, 0.8], [0.5, 0.02])
    made, s = ProfileSeries.of(closed), np.array([-0.4, closed.length + 0.2])
    assert np.allclose(made.at(s), made.at(np.mod(s, closed.length)), rtol=0.0, atol=1e-13)
    curve = an_open_curve()
    made = ProfileSeries.of(curve)
    assert np.all(np.isnan(made.at(np.array([-1e-9, curve.length + 1e-9]))))
