"""Trades of speed for accuracy of short simulations of a four-bar."""

import time

import pytest

import spherekit as sk
from spherekit.errors import AnalysisError
from spherekit.runs import simulation_measurement
from spherekit.runs.evaluation_options import Setting

BY_NUMPY = Setting(integrator="numpy", tolerance=1e-6)


def short_trade(settings, **options):
    """Return the trade of poles of a simulation over 0.02 s, measured once."""
    return sk.trade(
        "four_bar",
        "poles",
        start=sk.Start(0.3, 1.0),
        duration=0.02,
        settings=settings,
        rounds=1,
        **options,
    )


@pytest.mark.slow
def test_settings_of_a_trade_simulate_crossings_like_the_run():
    """The compiled engine does not pass crossings, so a run that passes them refuses it."""
    compiled = Setting(integrator="compiled", tolerance=1e-6)
    result = short_trade([BY_NUMPY, compiled], samples=3, crossings="pass")
    by_numpy, by_compiled = result.settings
    assert not by_numpy.reason
    assert 'crossings="pass" requires' in by_compiled.reason


def test_settings_with_similar_tolerances_are_all_measured():
    similar = Setting(integrator="numpy", tolerance=1.2e-6)
    result = short_trade([BY_NUMPY, similar], samples=3)
    names = [measured.name for measured in result.settings]
    assert names == ["numpy tolerance 1e-06", "numpy tolerance 1.2e-06"]


def test_a_setting_without_a_tolerance_is_refused():
    with pytest.raises(AnalysisError, match='"numpy best" has no tolerance'):
        short_trade([Setting()], samples=3)


@pytest.mark.slow
def test_a_simulation_with_a_single_sample_has_a_trade():
    assert short_trade([BY_NUMPY], samples=1).checked == 1


@pytest.mark.slow
def test_the_time_for_planning_does_not_grow_with_the_number_of_samples(monkeypatch):
    """Planning, here at least 0.05 s, is part of the time before the first sample."""
    make_plan = simulation_measurement.make_analysis_plan

    def plan_slowly(*arguments):
        end = time.process_time() + 0.05
        while time.process_time() < end:
            pass
        return make_plan(*arguments)

    monkeypatch.setattr(simulation_measurement, "make_analysis_plan", plan_slowly)
    (measured,) = short_trade([BY_NUMPY], samples=3).settings
    assert measured.first_seconds >= 0.05
