"""Shipped mechanisms with masses and loads: all tables by default, motion, MuJoCo."""

import re

import numpy as np
import pytest

import spherekit as sk
from spherekit.exchange.exported_pose import find_pose
from spherekit.exchange.mjcf import MujocoModel

MUJOCO_TOLERANCE_RAD = {
    **dict.fromkeys(("stephenson", "universal_joint", "planetary_bevel"), 1e-6),
    **{"roller_cam": 2e-3, "double_butterfly": 1e-4, "three_rrr": 1e-4},
}
"""Shipped mechanisms with masses and loads, and how far (rad) MuJoCo may be off.

MuJoCo closes loops of pairs by soft constraints, and a cam by a soft contact.
"""


@pytest.mark.many
@pytest.mark.parametrize("name", MUJOCO_TOLERANCE_RAD)
def test_tables_of_forces_have_numbers_and_no_failed_rows(name):
    """Dynamics, reactions and statics of shipped mechanisms fill all their tables.

    The loads in the files must have an effect: the largest torque of each input exceeds
    1e-3 N m. A pair transmits a moment to its two bearings by a couple of forces. The
    largest of these forces exceeds 0.1 N in each pair with bearings.

    A row is a sample in an assembly mode (way to assemble the links). Its status may be
    OUT_OF_REACH: the mode does not exist at these inputs, so nothing can be computed.
    Otherwise it must be OK.
    """
    run = sk.run(name, ["dynamics", "reactions", "statics"], samples=13)
    assert not run.failures
    for analysis in ("dynamics", "reactions", "statics"):
        for table in run.results[analysis].tables:
            rows = run.frame(analysis, table.name)
            numbers = rows.select_dtypes("number")
            finite_numbers = numbers.to_numpy()[np.isfinite(numbers)]
            assert len(rows) > 0, table.name
            assert np.any(finite_numbers != 0.0), table.name
            assert set(rows["status"]) <= {"OK", "OUT_OF_REACH"}, table.name
    for analysis in ("dynamics", "statics"):
        torques = run.frame(analysis).filter(like="tau")
        largest_by_input = torques.abs().max()
        assert largest_by_input.min() > 1e-3
    summary = next(a for a in run.summary["analyses"] if a["name"] == "reactions")
    bearings = summary["findings"]["bearings"].values()
    couple_forces = [bearing["largest_couple_force_N"] for bearing in bearings]
    assert couple_forces
    assert min(couple_forces) > 0.1


@pytest.mark.many
@pytest.mark.parametrize("name", MUJOCO_TOLERANCE_RAD)
def test_mujoco_moves_the_mechanism_as_a_simulation_does(name):
    """The exported MuJoCo model moves as a simulation of spherekit, for 0.2 s from rest.

    Bearing friction is removed from both, because MuJoCo has no friction that depends on
    reactions. No other load may be left out of the model. `MUJOCO_TOLERANCE_RAD` allows for
    the soft constraints of MuJoCo. `find_pose` returns the mechanism and one of its
    configurations in assembly mode 0.
    """
    mujoco = pytest.importorskip("mujoco")
    mechanism = sk.load(name)
    bearings = [load.name for load in mechanism.loads if isinstance(load, sk.Bearings)]
    mechanism, values = find_pose(mechanism.with_loads(without=bearings))
    exported = MujocoModel(mechanism, values, timestep=2.5e-4)
    assert not [note for note in exported.notes if "left out" in note]
    model = mujoco.MjModel.from_xml_string(exported.text)
    data = mujoco.MjData(model)
    step_count = 800  # 0.2 s
    mujoco.mj_step(model, data, step_count)
    input_pairs = [item.pair for item in mechanism.inputs]
    by_mujoco = np.array([data.joint(pair).qpos[0] for pair in input_pairs])

    q = tuple(float(values[mechanism.angles[pair]]) for pair in input_pairs)
    start = sk.Start(q=q, dq=(0.0,) * len(q))
    state = sk.simulate(mechanism, start, 0.2, assembly_mode=0).at([0.2])
    # Otherwise equal inputs would only say that nothing has moved.
    assert np.max(np.abs(by_mujoco - q)) > 0.05
    error = np.max(np.abs(by_mujoco - state.inputs[0]))
    assert error < MUJOCO_TOLERANCE_RAD[name]


def test_a_sweep_of_torques_with_friction_of_bearings_names_the_figure_that_works():
    """`torque` of a row has no such friction; the message has a figure of a table."""
    arcs = {"links.2.arc": [14.0]}
    with pytest.raises(sk.SpherekitError, match="friction depends") as refusal:
        sk.sweep("stephenson", arcs, ["most=max(abs(torque))"], samples=5)
    (suggested_figure,) = re.findall('--reduce "([^"]+)"', str(refusal.value))
    rows = sk.sweep("stephenson", arcs, [f"most={suggested_figure}"], samples=5).frame()
    assembly_mode_count = 4
    assert len(rows) == assembly_mode_count
    assert (rows["most"] > 1e-3).all()
