"""Where profiles touch: curves of every kind turned so that they do at a known place."""

from dataclasses import replace

import numpy as np
import pytest

from spherekit.geometry.curve_contact import nearest_frames
from spherekit.geometry.parametric_curve import axes_about
from spherekit.geometry.profile_curve import circle, fourier, great_circle, through
from spherekit.mechanism.joint_construction import PROFILE_GAP_RAD

KINDS = ("circle", "great_circle", "fourier", "points", "open")


class Turned:
    """A curve turned by a rotation matrix."""

    def __init__(self, curve, turn):
        self.curve, self.turn = curve, turn
        self.length, self.closed = curve.length, curve.closed

    def evaluate(self, s):
        place = self.curve.evaluate(s)
        return replace(place, frame=self.turn @ place.frame)


def random_curve(random, kind):
    """Return a random profile of a kind, of all sizes."""
    axis = random.normal(size=3)
    axis /= np.linalg.norm(axis)
    if kind == "circle":
        return circle(axis, random.uniform(0.05, 2.5))
    if kind == "great_circle":
        return great_circle(axis)
    while True:
        try:
            if kind == "fourier":
                n = random.integers(2, 7)
                waves = random.normal(size=(2, n)) * 0.15 / np.arange(1, n + 1)
                cosines = [random.uniform(0.3, 1.6), *waves[0]]
                return fourier(axis, cosines, [0.0, *waves[1]])
            n = random.integers(12, 30)
            a = np.arange(n) * (2 * np.pi / n)
            wave = random.uniform(0, 0.12) * np.cos(random.integers(1, 5) * a)
            tilt = random.uniform(0.4, 1.4) + wave
            flat = [np.sin(tilt) * np.cos(a), np.sin(tilt) * np.sin(a), np.cos(tilt)]
            points = np.stack(flat, axis=1) @ axes_about(axis).T
            return through(points) if kind == "points" else through(points[: n // 2], False)
        except ValueError:  # a cusp, or a point where the curve meets itself
            continue


def touching_at(random, first, second):
    """Return the second curve turned so that it touches the first, and where they do."""
    places = [random.uniform(0.0, curve.length) for curve in (first, second)]
    one, other = first.evaluate(places[:1]).frame[0], second.evaluate(places[1:]).frame[0]
    return Turned(second, one @ other.T), places


LONG = pytest.param(3450, 3, marks=pytest.mark.long)


@pytest.mark.slow
@pytest.mark.parametrize(("count", "seed"), [(50, 1), LONG])
def test_profiles_that_touch_are_found_to(count, seed):
    """Of all kinds, beside each other, or one within another that is less curved there."""
    random = np.random.default_rng(seed)
    for number in range(count):
        kinds = KINDS[number % 5], KINDS[number // 5 % 5]
        curves = first, second = [random_curve(random, kind) for kind in kinds]
        facing = second if number % 2 else second.reversed()
        turned, places = touching_at(random, first, facing)
        one, other = (
            c.evaluate([s]).curvature[0] for c, s in zip(curves, places, strict=True)
        )
        if number % 2 == 0 or one > other + 1e-3:
            s, miss = nearest_frames(first, turned)
            gap = first.evaluate(s[:1]).frame - turned.evaluate(s[1:]).frame
            assert np.linalg.norm(gap) < 2.0 * miss + 1e-13 and miss < 1e-12, kinds


def test_profiles_that_miss_each_other_by_a_little_are_nearest_there():
    """Two circles apart by a gap: the frames differ by it, where they are nearest."""
    for gap in (1e-3, 1e-5, 1e-7):
        first = circle([0.0, 0.0, 1.0], 0.4)
        centre = 0.4 + 0.3 + gap
        second = circle([np.sin(centre), 0.0, np.cos(centre)], 0.3).reversed()
        s, miss = nearest_frames(first, second)
        assert miss == pytest.approx(gap, rel=1e-3)
        assert first.evaluate(s[:1]).frame[0, 1, 2] == pytest.approx(0.0, abs=1e-6)
        assert (miss < PROFILE_GAP_RAD) == (gap < PROFILE_GAP_RAD)


def test_of_several_contacts_it_is_the_first_along_the_first_profile():
    """A cam of three lobes within a circle touches it with each of them."""
    cam = fourier([0.0, 0.0, 1.0], [0.5, 0.0, 0.0, 0.1])
    s, miss = nearest_frames(cam, circle([0.0, 0.0, 1.0], 0.6))
    assert miss < 1e-12
    assert min(s[0], cam.length - s[0]) == pytest.approx(0.0, abs=1e-9)
