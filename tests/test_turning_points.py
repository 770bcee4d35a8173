"""Places at which outputs turn back, and the ranges of their angles, in the overview."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from spherekit.runs.examined_rows import ExaminedRows, OutputRows
from spherekit.runs.mode_overview import OutputOverview


def overview_of(places, angles, rates=None, cut=None, over_time=False):
    """Return the overview of an output with a fixed axis along a path.

    Parameters
    ----------
    places
        (n,) the input (rad), or the time (s).
    angles, rates
        (n,) the angle of the output and its rate. Without rates, they are unknown.
    cut
        Number of the first sample of the second block, None for a single block.
    over_time
        Whether the places are times.
    """
    examined: Any = ExaminedRows.__new__(ExaminedRows)
    examined.plan = SimpleNamespace(moves_over_time=over_time)
    known_rates = np.full(len(places), np.nan) if rates is None else rates
    ratios = np.zeros(len(places)) if rates is None else rates
    path = OutputRows(
        places=places,
        angles=angles,
        rates=known_rates,
        inputs=places[:, None],
        ratios=ratios[:, None],
    )
    overview = OutputOverview()
    for block in (slice(0, cut), slice(cut, None)) if cut else (slice(None),):
        examined._add_path(overview, path.rows(block), rates is not None)
    return overview


@pytest.mark.parametrize("cut", [None, 4, 5, 6])
@pytest.mark.parametrize("over_time", [False, True])
def test_an_output_that_turns_back_at_a_sample_does_so_in_blocks_of_any_size(
    cut, over_time
):
    q = np.linspace(-1.0, 1.0, 9)
    overview = overview_of(q, -0.5 * q**2, -q, cut, over_time)
    assert overview.rests == [0.0]
    assert overview.uncertain_rests == []
    assert overview.turning_error_rad == 0.0
    assert overview.highest_rad == 0.0


@pytest.mark.parametrize("cut", [None, 15])
@pytest.mark.parametrize("shift", [0.0, 0.03])
def test_the_range_of_an_output_that_dwells_ends_at_the_dwell(cut, shift):
    """The output moves for 1 rad of the input, rests for 1 rad and moves back."""
    q = np.linspace(shift, 3.0 - shift, 31)
    distance = np.maximum(np.abs(q - 1.5) - 0.5, 0.0)
    overview = overview_of(q, -0.5 * distance**2, -np.sign(q - 1.5) * distance, cut)
    assert overview.highest_rad == 0.0
    assert overview.turning_error_rad == 0.0
    assert overview.rests == [pytest.approx(1.5)]


@pytest.mark.parametrize("cut", [None, 5, 6, 7, 8])
def test_an_output_of_several_inputs_turns_back_at_its_extreme(cut):
    """The rates are unknown, so the place follows from the angles at the samples."""
    q = np.linspace(-1.2, 1.0, 12) + 0.03
    assert overview_of(q, -(q**2), cut=cut).rests == [pytest.approx(0.0, abs=1e-12)]
    uneven = q + 0.04 * np.cos(7.0 * q)
    rests = overview_of(uneven, -(uneven**2), cut=cut).rests
    assert rests == [pytest.approx(0.0, abs=1e-12)]


@pytest.mark.parametrize("cut", [None, 3, 4, 5])
def test_a_change_of_sign_at_a_singular_sample_is_no_turning_point(cut):
    q = np.linspace(-1.0, 1.0, 8)
    rates = -q
    rates[3] = np.nan
    overview = overview_of(q, -0.5 * q**2, rates, cut)
    assert overview.rests == overview.uncertain_rests == []
    assert overview.turning_error_rad == 0.0


def test_the_farthest_pose_is_not_estimated_across_samples_without_a_configuration():
    angles = np.array([0.0, 0.1, 0.2, np.nan, np.nan, 0.0, 0.02])
    cosines, sines = np.cos(angles), np.sin(angles)
    rotations = np.zeros((len(angles), 3, 3))
    rotations[:, 0, 0] = rotations[:, 1, 1] = cosines
    rotations[:, 1, 0], rotations[:, 0, 1] = sines, -sines
    rotations[:, 2, 2] = 1.0
    examined: Any = ExaminedRows.__new__(ExaminedRows)
    overview = OutputOverview()
    output: Any = SimpleNamespace(direction=None)
    examined._add_rotations(overview, output, rotations, np.isfinite(angles))
    assert overview.highest_rad == pytest.approx(0.2)
    assert overview.smooth_angle.excess(0.0, 0.2) == pytest.approx(0.0, abs=1e-12)
