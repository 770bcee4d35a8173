"""Systems of equations linear in the cosine and sine of each angle, and their solutions."""

import numpy as np
import pytest

from spherekit.geometry.trigonometric_system import (
    estimate_real_angles,
    find_near_real_angles,
)


def test_a_zero_highest_coefficient_of_the_eliminant_is_a_problem():
    """With cos x (1 + 2 cos y) = 2 sin x and cos y = 0, tan x = 1/2: there are 4 solutions.

    The eliminant loses its highest power exactly, so its roots say nothing.
    """
    equations = np.zeros((2, 3, 3))
    equations[0, 1, :2] = 1.0, 2.0
    equations[0, 2, 0] = -2.0
    equations[1, 0, 1] = 2.0
    incidence = np.ones((2, 2), dtype=bool)
    for x in np.arctan(0.5) + np.array([0.0, np.pi]):
        for y in (-np.pi / 2, np.pi / 2):
            factors = [np.array([1.0, np.cos(angle), np.sin(angle)]) for angle in (x, y)]
            assert np.max(np.abs(equations @ factors[1] @ factors[0])) < 1e-15
    angles, problem = find_near_real_angles(equations, incidence)
    assert not len(angles)
    assert problem == "the coefficient of the highest power of the eliminant is zero"


@pytest.mark.parametrize("count", [2, 3])
def test_no_system_has_no_estimated_angles(count):
    incidence = np.ones((count, count), dtype=bool)
    incidence[0, 2:] = False  # the first of three equations does not contain z
    equations = np.empty((0, count, *[3] * count))
    angles, is_clear = estimate_real_angles(equations, incidence)
    assert angles.shape == (0, 0, count)
    assert is_clear.shape == (0,)
