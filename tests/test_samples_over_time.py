"""Samples over time: assumed rates, durations, and extremes between samples."""

import numpy as np
import pytest

import spherekit as sk
from spherekit.runs.smooth_extremes import SmoothExtremes


def test_a_run_over_time_without_a_law_states_the_rate_that_it_assumes():
    run = sk.run("four_bar", "dynamics", samples=3, duration=0.2)
    assert run.summary["assumed_rates_rad_per_s"] == {"21": 1.0}


def test_a_run_with_a_law_assumes_no_rates():
    law = sk.ConstantSpeed(2.0)
    run = sk.run("four_bar", "dynamics", samples=3, duration=0.2, laws={"21": law})
    assert run.summary["assumed_rates_rad_per_s"] == {}


@pytest.mark.parametrize("samples", [1, 2])
def test_the_summary_of_a_simulation_has_the_duration_that_was_asked_for(samples):
    run = sk.run(
        "four_bar", "poles", samples=samples, start=sk.Start(0.3, 1.0), duration=0.02
    )
    assert run.summary["simulation"]["duration_s"] == 0.02


def test_an_infinite_value_is_no_extreme_in_one_block_or_in_several():
    """Parabolas with an infinite value have no extreme, as those with an unknown value."""
    values = np.array([0.0, 1.0, 0.0, 2.0, np.inf, 2.0, -np.inf, 0.0])
    whole, divided = SmoothExtremes(), SmoothExtremes()
    whole.add(values)
    for block in np.split(values, [2, 5]):
        divided.add(block)
    assert whole == divided
    # The parabola through 1, 0 and 2 has the minimum -1/24.
    assert (whole.lowest, whole.highest) == pytest.approx((-1.0 / 24.0, 1.0))
