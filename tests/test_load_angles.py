"""Exported torques with springs at pairs that cannot turn fully need no count of turns.

They are compared with `sk.inverse_dynamics`, which follows the angles of loads along the
assembly mode, over several turns of the input.
"""

from dataclasses import replace

import numpy as np
import pytest

import spherekit as sk
from spherekit.designs.design_revolutions import unwrap_along_one_input
from spherekit.exchange.formula_maker import formulas
from spherekit.exchange.source_languages import source

INPUT_ANGLES_RAD = np.linspace(-7.0, 12.0, 20)
"""Input angles over three turns."""


def with_spring(name, pair, zero_deg=0.0, input_pair=None):
    """Return a mechanism whose only load is a spring at a pair.

    Its stiffness is 1.3 N m/rad, and its torque is zero at the angle 0.4 rad. `zero_deg`
    turns the position from which the angle of this pair is counted. So the angle may cross
    180 deg in the motion. `input_pair` replaces the driven pair. Joint limits are removed,
    so that they do not end the motion.
    """
    mechanism = sk.load(name)
    if zero_deg:
        geometry = mechanism.geometry
        zeros = dict(geometry.zeros)
        zeros[pair] = zeros.get(pair, 0.0) + np.radians(zero_deg)
        # The file identifies its named assembly modes by angles, which have changed now.
        mechanism = replace(mechanism, geometry=replace(geometry, zeros=zeros), modes={})
    if input_pair:
        mechanism = mechanism.with_inputs(input_pair)
    return replace(mechanism, loads=(sk.Spring("wound", pair, 1.3, 0.4),), joint_limits=())


def exported_torques(exported_formulas, input_angles, mode):
    """Return the torques (n,) of exported formulas at inputs (n,) (rad), at 1 rad/s."""
    values = {
        "q": input_angles,
        "dq": np.ones_like(input_angles),
        "ddq": np.zeros_like(input_angles),
    }
    motion = np.array([values[argument.name] for argument in exported_formulas.motion])
    mode_values = np.array(mode.values).reshape(-1, 1)
    evaluate = exported_formulas.numpy_function(exported_formulas.outputs)
    return evaluate(motion, mode_values, exported_formulas.size_values)[0]


SWINGING_SPRINGS = {
    "rocker": ("four_bar", "41"),
    "coupler on rocker": ("four_bar", "43"),
    "rocker across half a turn": ("four_bar", "41", 95.0),
    "the other way across": ("four_bar", "41", -160.0),
    "driven at the rocker": ("four_bar", "43", 0.0, "41"),
}
"""Arguments of `with_spring` for pairs that cannot turn fully."""


@pytest.mark.many
@pytest.mark.parametrize("name", SWINGING_SPRINGS)
def test_exported_torque_of_a_spring_at_a_swinging_pair_needs_no_count_of_turns(name):
    """Exported torques with a spring at a swinging pair agree with `sk.inverse_dynamics`.

    The formulas have no argument for turns. They compute the angle of a pair in (-pi, pi],
    and the torque of a spring depends on the angle with its whole turns. A pair that swings
    by less than a turn has only one possible number of turns at each angle. A pair that
    rotates fully has many. `with_spring` returns the mechanism, and `exported_torques`
    evaluates the formulas in a mode (way to assemble the links).
    """
    mechanism = with_spring(*SWINGING_SPRINGS[name])
    exported_formulas = formulas(mechanism, ["torque"])
    argument_names = [argument.name for argument in exported_formulas.motion]
    assert argument_names == ["q", "dq", "ddq"]
    assert "turns_of" not in source(exported_formulas, "c")
    compared_rows = 0
    for mode in exported_formulas.modes:
        torques = exported_torques(exported_formulas, INPUT_ANGLES_RAD, mode)
        law = sk.ConstantSpeed(1.0, INPUT_ANGLES_RAD[0])
        times = INPUT_ANGLES_RAD - INPUT_ANGLES_RAD[0]
        solution = sk.inverse_dynamics(mechanism, law, times, assembly_mode=mode.number)
        expected = np.ravel(solution.torques)
        # Both are NaN where the mechanism cannot be assembled. If only one of them were,
        # the comparison below would fail, because the row counts as finite.
        is_finite = np.isfinite(expected) | np.isfinite(torques)
        assert torques[is_finite] == pytest.approx(expected[is_finite], rel=1e-9, abs=1e-10)
        compared_rows += np.sum(is_finite)
    assert compared_rows >= 10


@pytest.mark.parametrize(
    ("case", "vary"),
    [
        (("four_bar", "32"), []),  # turns fully
        (("four_bar", "41"), ["links.2.arc"]),  # may turn fully with another arc
        (("five_bar", "32"), []),  # its angle depends on the path of two inputs
    ],
)
def test_exported_torque_of_a_spring_has_turns_as_argument_if_they_may_matter(case, vary):
    """`vary` names sizes that stay arguments of the formulas."""
    mechanism = with_spring(*case)
    torque = "torque" if len(mechanism.inputs) == 1 else "torque_by_21"
    exported_formulas = formulas(mechanism, [torque], vary=vary)
    _, spring_pair = case
    argument_names = [argument.name for argument in exported_formulas.motion]
    assert f"turns_of_{spring_pair}" in argument_names


@pytest.mark.parametrize(
    ("arcs", "zeros", "input_pair", "spring_pair"),
    [
        ((99.53, 116.19, 30.81, 65.63), (142.1, -27.8, 32.2, -171.2), "21", "32"),
        ((79.5, 24.0, 41.8, 80.2), (-41.0, -19.0, 109.7, 116.7), "41", "21"),
    ],
)
def test_the_swing_of_a_spring_includes_the_angles_at_dead_centres(
    arcs, zeros, input_pair, spring_pair
):
    """A pair that swings over more than a turn keeps its argument for turns.

    The input is at a dead centre at both ends of its range. There the angle of the pair
    changes so fast that it swings over less than a turn between the outermost samples. Arcs
    and zeros are in degrees.
    """
    mechanism = with_spring("four_bar", spring_pair)
    mechanism = replace(mechanism, modes={}, outputs=()).with_inputs(input_pair)
    mechanism = mechanism.with_sizes(
        angle_unit="deg",
        arcs=dict(zip("1234", arcs, strict=True)),
        zeros=dict(zip(("21", "32", "43", "41"), zeros, strict=True)),
    )
    exported_formulas = formulas(mechanism, ["torque"])
    argument_names = [argument.name for argument in exported_formulas.motion]
    assert f"turns_of_{spring_pair}" in argument_names


def test_varying_the_stiffness_of_a_spring_adds_no_count_of_turns():
    mechanism = with_spring("four_bar", "41")
    exported_formulas = formulas(mechanism, ["torque"], vary=["loads.wound.stiffness"])
    argument_names = [argument.name for argument in exported_formulas.motion]
    assert "turns_of_41" not in argument_names


MODE_START_RAD = 1.0
GAP_RAD = (1.008, 1.02)
"""Inputs at which a mode begins, and between which it does not close."""


def fast_angle_with_a_gap(designs, inputs):
    """Return an angle (pairs, inputs, designs) that turns 40 times as fast as the input.

    It is NaN before the mode begins, and in the gap. There is one pair and one design.
    """
    q = inputs[:, 0]
    gap_start, gap_end = GAP_RAD
    is_open = (q < MODE_START_RAD) | ((q > gap_start) & (q < gap_end))
    return np.where(is_open, np.nan, np.angle(np.exp(40j * q)))[None]


def test_revolutions_of_designs_are_whole_where_angles_cannot_be_followed():
    """An angle that is lost near the start of a mode differs by whole revolutions only.

    Angles are followed from an input at which they count as less than half a revolution,
    the anchor. Here the anchor is before the start of the mode. From some anchors the angle
    cannot be followed across the gap.
    """
    q = np.linspace(1.1, 3.0, 41)
    for anchor in np.linspace(0.0, 0.9, 41):
        offsets = unwrap_along_one_input(
            fast_angle_with_a_gap, design_count=1, anchor=anchor, q=q, repeats=False
        )
        revolutions = offsets / (2.0 * np.pi)
        np.testing.assert_allclose(revolutions, np.round(revolutions), atol=1e-12)
