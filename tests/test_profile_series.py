"""Profiles as series in their arc length against the curves themselves."""

import numpy as np
import pytest

from spherekit.geometry.profile_curve import fourier, through
from spherekit.geometry.profile_series import ProfileSeries

CLOSED, A = fourier([0.0, 0.6, 0.8], [0.5, 0.02, 0.04], [0.0, 0.01]), np.linspace(0, 2, 15)
C = 0.8 + 0.1 * np.sin(2.0 * A)
OPEN = through(np.c_[np.sin(C) * np.cos(A), np.sin(C) * np.sin(A), np.cos(C)], closed=False)


@pytest.mark.parametrize("curve", [CLOSED, CLOSED.reversed(), OPEN])
def test_series_are_the_curve(curve):
    """Frames to rounding, curvatures nearly; the slope bounds differences of dk/ds."""
    made = ProfileSeries.fit(curve)
    s = np.random.default_rng(5).uniform(0.0, curve.length, 2000)
    there, found = curve.evaluate(s), made.evaluate(s)
    assert np.max(np.abs(found[:3].T - there.frame[:, :, 0])) < 1e-14
    assert np.max(np.abs(found[3:6].T - there.frame[:, :, 2])) < 1e-14
    assert np.allclose(found[6], there.curvature, rtol=1e-12, atol=1e-12)
    assert np.allclose(found[7], there.curvature_rate, rtol=1e-9, atol=1e-9)
    h = 1e-5
    near = np.clip(s, h, curve.length - h)
    more, less = (curve.evaluate(near + step).curvature_rate for step in (h, -h))
    assert np.max(np.abs(more - less) / (2.0 * h)) <= made.max_curvature_second


def test_beyond_the_ends():
    """A closed curve repeats itself, an open one ends."""
    made, s = ProfileSeries.fit(CLOSED), np.array([-0.4, CLOSED.length + 0.2])
    assert np.allclose(
        made.evaluate(s), made.evaluate(np.mod(s, CLOSED.length)), rtol=0.0, atol=1e-13
    )
    assert np.all(
        np.isnan(ProfileSeries.fit(OPEN).evaluate(np.array([-1e-9, OPEN.length + 1e-9])))
    )
