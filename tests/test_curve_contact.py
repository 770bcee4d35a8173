"""Where profiles touch: curves of every kind turned so that they do at a known place."""

from dataclasses import replace

import numpy as np
import pytest

from spherekit.geometry.curve_contact import nearest_frames
from spherekit.geometry.parametric_curve import axes_about
from spherekit.geometry.profile_curve import circle, fourier, great_circle, through
from spherekit.mechanism.joint_construction import PROFILE_GAP_RAD

KINDS = ("circle", "great_circle", "fourier", "points", "open")


class RotatedCurve:
    """A profile curve that is rotated by a matrix (3, 3)."""

    def __init__(self, curve, rotation):
        self.curve = curve
        self.rotation = rotation
        self.length = curve.length
        self.closed = curve.closed

    def evaluate(self, s):
        """Return the points at arc lengths s (n,), with rotated frames (n, 3, 3)."""
        points = self.curve.evaluate(s)
        return replace(points, frame=self.rotation @ points.frame)


def random_curve(random, kind):
    """Return a random profile curve on the sphere, of one of `KINDS`, about a random axis.

    Circles have radii of 0.05 to 2.5 rad. Fourier curves and curves through points have a
    radius with random waves. The latter run through 12 to 29 points, open ones through half
    of them. Curves that spherekit refuses are drawn again.
    """
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
            azimuth = np.arange(n) * (2 * np.pi / n)
            wave = random.uniform(0, 0.12) * np.cos(random.integers(1, 5) * azimuth)
            colatitude = random.uniform(0.4, 1.4) + wave
            x = np.sin(colatitude) * np.cos(azimuth)
            y = np.sin(colatitude) * np.sin(azimuth)
            z = np.cos(colatitude)
            points = np.stack([x, y, z], axis=1) @ axes_about(axis).T
            if kind == "points":
                return through(points)
            return through(points[: n // 2], False)
        except ValueError:  # a cusp, or a point where the curve meets itself
            continue


def touching_at(random, first, second):
    """Return the second curve rotated so that it touches the first, and where they touch.

    Returns
    -------
    curve, places
        `RotatedCurve`, and the arc lengths of the contact on both curves, which are random.
        There the frames (tangent, normal, point) of both curves are equal.
    """
    first_place = random.uniform(0.0, first.length)
    second_place = random.uniform(0.0, second.length)
    first_frame = first.evaluate([first_place]).frame[0]
    second_frame = second.evaluate([second_place]).frame[0]
    rotation = first_frame @ second_frame.T
    return RotatedCurve(second, rotation), [first_place, second_place]


LONG = pytest.param(3450, 3, marks=pytest.mark.long)


@pytest.mark.slow
@pytest.mark.parametrize(("count", "seed"), [(50, 1), LONG])
def test_a_contact_of_two_profiles_is_found(count, seed):
    """The contact of random profiles that touch at a known point is found.

    `touching_at` rotates the second curve so that the frames (tangent, normal, point) of
    both curves are equal at one point. The second curve is reversed if the bodies of the
    profiles are on opposite sides of the common tangent. In every other example the first
    body is inside the second one; then the first profile must be more curved at the
    contact.

    `nearest_frames` returns the arc lengths on both curves at which the frames differ by
    the smallest angle. The frames must be equal there. The curves may also touch elsewhere,
    so these arc lengths need not be the known ones.
    """
    random = np.random.default_rng(seed)
    for number in range(count):
        first_kind = KINDS[number % 5]
        second_kind = KINDS[number // 5 % 5]
        first = random_curve(random, first_kind)
        second = random_curve(random, second_kind)
        is_within = number % 2 == 1
        facing = second if is_within else second.reversed()
        rotated, (first_place, second_place) = touching_at(random, first, facing)
        first_curvature = first.evaluate([first_place]).curvature[0]
        second_curvature = second.evaluate([second_place]).curvature[0]
        if is_within and not first_curvature > second_curvature + 1e-3:
            continue
        (first_length, second_length), angle = nearest_frames(first, rotated)
        first_frame = first.evaluate([first_length]).frame
        second_frame = rotated.evaluate([second_length]).frame
        # Rotations that differ by the angle differ by at most 1.42 times it in this norm.
        assert np.linalg.norm(first_frame - second_frame) < 2.0 * angle + 1e-13
        assert angle < 1e-12, (first_kind, second_kind)


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


def test_a_contact_at_the_end_of_an_open_profile_is_not_taken_for_one_at_its_start():
    """An open profile runs one and a half times about a circle, and touches it twice."""
    turn = circle([0.0, 0.0, 1.0], 0.6)
    profile = replace(turn, closed=False, length=1.5 * turn.length)
    roller = circle([-np.sin(0.9), 0.0, np.cos(0.9)], 0.3).reversed()
    s, miss = nearest_frames(profile, roller)
    assert miss < 1e-12
    assert s[0] == pytest.approx(0.5 * turn.length, abs=1e-9)


@pytest.mark.parametrize("fraction", [-0.7, -0.4, 0.3, 0.5, 0.8])
def test_a_contact_at_a_sharp_tip_is_found(fraction):
    """The tip, of radius 2e-8 rad, is far narrower than the first samples of the curve."""
    cam = fourier([0.0, 0.0, 1.0], [0.5001, 0.5]).reversed()
    place = 0.5 * cam.length + 1e-7 * fraction
    _, normal, point = cam.evaluate([place]).frame[0].T
    roller = circle(np.cos(0.2) * point - np.sin(0.2) * normal, 0.2).reversed()
    _, miss = nearest_frames(cam, roller)
    assert miss < 1e-9
