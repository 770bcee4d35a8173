"""Volumes of sets of orientations, against closed forms."""

import numpy as np
import pytest
from sphere_areas import common_area

from spherekit.errors import RegionError
from spherekit.region.orientations import ALL_ORIENTATIONS, find_orientations
from spherekit.sphere.rotation import from_quaternion


def unit(vector):
    return np.asarray(vector, float) / np.linalg.norm(vector, axis=-1, keepdims=True)


def tilt(axis, reference, angle):
    """Keep the orientations that carry an axis to within an angle of a reference."""

    def margins(quaternions):
        carried = from_quaternion(quaternions) @ unit(axis)
        return (carried @ unit(reference) - np.cos(angle))[:, None]

    return margins


def test_everything_and_nothing():
    whole = find_orientations(lambda q: np.ones((len(q), 1)))
    assert abs(whole.volume / ALL_ORIENTATIONS - 1.0) < 1e-10 and whole.error == 0.0
    assert whole.fraction == pytest.approx(1.0)
    nothing = find_orientations(lambda q: -np.ones((len(q), 2)))
    assert nothing.volume == nothing.error == 0.0 and nothing.depth < 0.0


@pytest.mark.parametrize("angle", [0.4, 1.5, 2.8])
def test_turns_by_at_most_an_angle(angle):
    """The volume is 8 pi (a - sin a)."""
    exact = 8.0 * np.pi * (angle - np.sin(angle))
    found = find_orientations(lambda q: 2.0 * q[:, 3:] ** 2 - 1.0 - np.cos(angle), 5e-3)
    assert abs(found.volume - exact) <= found.error <= 5e-3 * found.volume


def test_one_axis_in_common_caps():
    """The volume is 2 pi times the area in which the axis may be."""
    rng = np.random.default_rng(11)
    for _ in range(4):
        centres, radii = unit(rng.normal(size=(3, 3))), rng.uniform(0.7, 1.8, 3)
        keep = np.array([True, True, False])
        axis = unit(rng.normal(size=3))
        sign = np.where(keep, 1.0, -1.0)

        def margins(q, centres=centres, radii=radii, axis=axis, sign=sign):
            return sign * (from_quaternion(q) @ axis @ centres.T - np.cos(radii))

        exact = 2.0 * np.pi * common_area(centres, radii, keep)
        found = find_orientations(margins, 2e-2, most=200_000)
        assert abs(found.volume - exact) <= found.error


def test_limits_of_the_work_are_told_by_the_error():
    within = tilt([0, 0, 1], [0, 0, 1], 0.6)
    exact = 4.0 * np.pi**2 * (1.0 - np.cos(0.6))
    found = find_orientations(within, 1e-6, most=50_000)
    assert found.evaluations < 100_000 and abs(found.volume - exact) <= found.error
    assert found.depth > 0.0 and within(found.place[None]).min() == found.depth
    with pytest.raises(RegionError, match="tolerance is -1"):
        find_orientations(within, -1)
