"""Samples of the inputs: what is refused, and that they are the caller's numbers."""

import numpy as np
import pytest

import spherekit as sk
from spherekit.errors import SolveError
from spherekit.positions.position_analysis import PositionAnalysis


def test_a_path_that_is_changed_later_does_not_change_the_samples():
    path = np.array([[0.1], [0.2], [0.3]])
    position_analysis = PositionAnalysis(sk.load("four_bar"), path=path)
    path[:] = 1.0
    inputs = position_analysis.motion().values[:3, position_analysis.solver.driven]
    assert np.array_equal(inputs.ravel(), [0.1, 0.2, 0.3])


@pytest.mark.parametrize(
    ("samples", "grid", "message"),
    [
        (2_000_000, True, "found 2000000x2000000; at most 1099511627776 samples"),
        ((2**45, 0), False, "at least 1, not 0"),
        ((2**45, -1), False, "at least 1, not -1"),
    ],
)
def test_impossible_grids_of_samples_are_refused_before_memory_is_needed(
    samples, grid, message
):
    with pytest.raises(SolveError, match=message):
        PositionAnalysis(sk.load("five_bar"), samples=samples, grid=grid, follow=False)
