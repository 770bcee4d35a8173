"""Exported torques with springs at pairs that cannot turn fully need no count of turns.

They are compared with `sk.inverse_dynamics`, which follows the angles of loads along the
assembly mode, over several turns of the input.
"""

from dataclasses import replace

import numpy as np
import pytest

import spherekit as sk
from spherekit.exchange.formula_maker import formulas
from spherekit.exchange.source_languages import source

INPUT_ANGLES = np.linspace(-7.0, 12.0, 20)
"""rad, inputs in three turns."""


def sprung(name, pair, zero_deg=0.0, input_pair=None):
    """Return a mechanism whose only load is a spring, with the zero of the pair moved."""
    mechanism = sk.load(name)
    if zero_deg:
        geometry = mechanism.geometry
        zeros = dict(geometry.zeros)
        zeros[pair] = zeros.get(pair, 0.0) + np.radians(zero_deg)
        mechanism = replace(mechanism, geometry=replace(geometry, zeros=zeros), modes={})
    if input_pair:
        mechanism = mechanism.with_inputs(input_pair)
    return replace(mechanism, loads=(sk.Spring("wound", pair, 1.3, 0.4),), joint_limits=())


def exported_torques(made, q, mode):
    """Return the torque (n,) of formulas at inputs (n,), at 1 rad/s."""
    values = {"q": q, "dq": np.ones_like(q), "ddq": np.zeros_like(q)}
    motion = np.array([values[argument.name] for argument in made.motion])
    places = np.array(mode.values).reshape(-1, 1)
    return made.numpy_function(made.outputs)(motion, places, made.size_values)[0]


CASES = {
    "rocker": ("four_bar", "41"),
    "coupler on rocker": ("four_bar", "43"),
    "rocker across half a turn": ("four_bar", "41", 95.0),
    "the other way across": ("four_bar", "41", -160.0),
    "driven at the rocker": ("four_bar", "43", 0.0, "41"),
}


@pytest.mark.many
@pytest.mark.parametrize("name", CASES)
def test_a_spring_at_a_pair_that_swings_needs_no_turns(name):
    mechanism = sprung(*CASES[name])
    made = formulas(mechanism, ["torque"])
    assert [argument.name for argument in made.motion] == ["q", "dq", "ddq"]
    assert "turns_of" not in source(made, "c")
    compared = 0
    for mode in made.modes:
        exported = exported_torques(made, INPUT_ANGLES, mode)
        law = sk.ConstantSpeed(1.0, INPUT_ANGLES[0])
        times = INPUT_ANGLES - INPUT_ANGLES[0]
        solution = sk.inverse_dynamics(mechanism, law, times, assembly_mode=mode.number)
        expected = np.ravel(solution.torques)
        is_known = np.isfinite(expected) | np.isfinite(exported)
        assert exported[is_known] == pytest.approx(expected[is_known], rel=1e-9, abs=1e-10)
        compared += np.sum(is_known)
    assert compared >= 10


@pytest.mark.parametrize(
    ("case", "vary"),
    [
        (("four_bar", "32"), []),  # turns fully
        (("four_bar", "41"), ["links.2.arc"]),  # may turn fully with another arc
        (("five_bar", "32"), []),  # its angle depends on the path of two inputs
    ],
)
def test_elsewhere_turns_stay_an_argument(case, vary):
    mechanism = sprung(*case)
    torque = "torque" if len(mechanism.inputs) == 1 else "torque_by_21"
    made = formulas(mechanism, [torque], vary=vary)
    assert f"turns_of_{case[1]}" in [argument.name for argument in made.motion]


def test_a_stiffness_may_vary():
    mechanism = sprung("four_bar", "41")
    made = formulas(mechanism, ["torque"], vary=["loads.wound.stiffness"])
    assert "turns_of_41" not in [argument.name for argument in made.motion]
