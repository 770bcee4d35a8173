"""Which analyses, figures of merit and times a sweep accepts, before it computes."""

import pytest

import spherekit as sk
from spherekit.errors import AnalysisError, DesignError

SIZES = {"links.2.arc": [10.0, 20.0]}


def test_a_sweep_refuses_an_analysis_that_is_requested_twice():
    with pytest.raises(DesignError, match=r"poles: .* 2 times in one sweep"):
        sk.sweep(
            "four_bar", SIZES, analyses=["poles:only=31", "poles:only=42"], tables=True
        )


@pytest.mark.slow
def test_figures_of_the_user_may_read_an_analysis_that_has_none():
    text = "most=max(dynamics.dynamics: kinetic_energy)"
    frame = sk.sweep("four_bar", SIZES, text, analyses=["dynamics"], samples=5).frame()
    expected = sk.sweep("four_bar", SIZES, text, samples=5).frame()
    assert frame["most"].notna().all()
    assert frame.equals(expected)


def test_an_analysis_without_figures_that_no_figure_reads_is_refused():
    with pytest.raises(DesignError, match="dynamics defines no figures of merit"):
        sk.sweep("four_bar", SIZES, "most=max(theta_41)", analyses=["dynamics"])


def test_a_sweep_of_simulations_with_a_torque_may_state_an_assembly_mode():
    study = sk.Study(
        "driven",
        sk.load("four_bar"),
        samples=3,
        assembly_mode=1,
        start={"q": 0.1},
        duration=0.1,
        torque=1.0,
    )
    result = sk.sweep(study, SIZES, analyses=["dynamics"], tables=True)
    motion = result.table("motion")
    assert set(motion["design"]) == {0, 1}
    assert set(motion["assembly_mode"]) == {1}
    assert set(result.frame()["status"]) == {"OK"}


@pytest.mark.parametrize("mode", [None, 1])
def test_times_that_do_not_fit_are_refused_before_designs_are_computed(mode):
    study = sk.Study("driven", sk.load("four_bar"), assembly_mode=mode, torque=1.0)
    with pytest.raises(AnalysisError, match="a driving torque acts in a simulation only"):
        sk.sweep(study, SIZES, analyses=["dynamics"], tables=True)
