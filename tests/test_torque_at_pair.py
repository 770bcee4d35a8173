"""Driving torques at another pair than the input, in tables, plots and sweeps."""

import numpy as np
import pytest
from helpers.scene_listener import SceneListener

import spherekit as sk
from spherekit.errors import ModelError
from spherekit.scenes.scene import Series


def test_a_pair_has_no_torque_at_its_dead_centres():
    """The pair 43 of the four-bar reverses at 0 and 180 deg of the crank.

    No torque at it can drive the mechanism there. The inertia of these rows is known.
    """
    result = sk.run("four_bar", "eksergian:at=43", samples=13)
    frame = result.frame()
    is_dead_centre = frame["sample"].isin([0, 6, 12]).to_numpy()
    assert np.array_equal(frame["status"] == "AT_SINGULARITY", is_dead_centre)
    assert np.array_equal(frame["tau"].isna(), is_dead_centre)
    assert np.all(np.isfinite(frame["B"]))
    (analysis,) = result.summary["analyses"]
    assert analysis["failed_rows"] == {"eksergian": {"AT_SINGULARITY": 6}}
    largest = analysis["findings"]["torque"]["largest_torque_Nm"]
    assert abs(largest) == pytest.approx(np.nanmax(np.abs(frame["tau"])))


def test_the_plotted_parts_of_a_torque_at_another_pair_add_up_to_it():
    listener = SceneListener()
    result = sk.run("four_bar", "eksergian:at=41", samples=7, recorder=listener)
    frame = result.frame()
    for mode in (0, 1):
        curves = {
            curve.label: curve.values
            for path, curve in listener.primitives(Series, mode).items()
            if path.startswith("plots/torque/")
        }
        torque = curves.pop("tau")
        assert len(curves) == 3  # inertia and two loads
        assert np.array_equal(torque, frame["tau"][frame["assembly_mode"] == mode])
        np.testing.assert_allclose(sum(curves.values()), torque, rtol=1e-12)


def test_figures_of_merit_are_of_the_torque_at_the_pair():
    """The figures of a sweep are the largest and the mean square torque of a run."""
    sizes = {"links.2.arc": [20.0]}
    options = {"analyses": ["eksergian:at=41"], "samples": 13}
    swept = sk.sweep("four_bar", sizes, [], **options).frame()
    frame = sk.run("four_bar", "eksergian:at=41", samples=13).frame()
    torques = [rows["tau"].to_numpy() for _, rows in frame.groupby("assembly_mode")]
    for name, expected in (
        ("largest_torque", [np.max(np.abs(torque)) for torque in torques]),
        ("rms_torque", [np.sqrt(np.mean(torque**2)) for torque in torques]),
    ):
        assert sorted(swept[name]) == pytest.approx(sorted(expected), rel=1e-9)


def test_a_sweep_refuses_a_torque_at_an_unknown_pair():
    with pytest.raises(ModelError, match='no pair is named "44"'):
        sk.sweep(
            "four_bar", {"links.2.arc": [20.0]}, [], analyses=["eksergian:at=44"], samples=5
        )


def test_a_load_named_like_the_torques_has_its_own_plot():
    """The power of the load `driving_torques`, and that of the driving torques."""
    load = sk.PairTorque("driving_torques", "51", "-3")
    listener = SceneListener()
    sk.run(sk.load("five_bar").with_loads(load), "dynamics", samples=3, recorder=listener)
    plots = listener.primitives(Series, 0).values()
    labels = [curve.label for curve in plots if curve.group == "power"]
    assert labels == ["driving torques", "driving_torques"]
