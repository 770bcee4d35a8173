"""Linear equations of many configurations at once."""

import numpy as np

from spherekit.positions.linear_equations import solve_least_norm


def test_a_singular_system_does_not_change_the_solutions_of_the_others():
    random = np.random.default_rng(3)
    matrices = random.normal(size=(4, 3, 3))
    matrices[0] = np.diag([1.0, 1.0, 1e-12])
    matrices[1] = np.diag([1.0, 2.0, 0.0])
    matrices[2] = np.nan
    right_sides = np.ones((4, 3))
    together = solve_least_norm(matrices, right_sides)
    for row in range(4):
        (alone,) = solve_least_norm(matrices[row : row + 1], right_sides[row : row + 1])
        assert np.array_equal(together[row], alone, equal_nan=True)
    assert np.allclose(together[1], [1.0, 0.5, 0.0], rtol=0, atol=1e-15)
