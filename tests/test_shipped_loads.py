"""Shipped mechanisms with masses and loads: all tables by default, motion, MuJoCo."""

import re

import numpy as np
import pytest

import spherekit as sk
from spherekit.exchange.exported_pose import find_pose
from spherekit.exchange.mjcf import MujocoModel

LOADED = {
    **dict.fromkeys(("stephenson", "universal_joint", "planetary_bevel"), 1e-6),
    **{"roller_cam": 2e-3, "double_butterfly": 1e-4, "three_rrr": 1e-4},
}
"""Shipped mechanisms, and how far (rad) MuJoCo may be off."""


@pytest.mark.many
@pytest.mark.parametrize("name", LOADED)
def test_no_table_of_forces_is_empty(name):
    run = sk.run(name, ["dynamics", "reactions", "statics"], samples=13)
    assert not run.failures
    for analysis in ("dynamics", "reactions", "statics"):
        for table in run.results[analysis].tables:
            rows = run.frame(analysis, table.name)
            numbers = rows.select_dtypes("number")
            assert len(rows) and numbers.to_numpy()[np.isfinite(numbers)].any(), table.name
            assert not np.isin(rows["status"], ("OVERFLOW", "NOT_CONVERGED")).any()
    for kind in ("dynamics", "statics"):
        torques = run.frame(kind).filter(like="tau")
        assert torques.abs().max().min() > 1e-3
    facts = next(a for a in run.summary["analyses"] if a["name"] == "reactions")
    couples = [x["largest_couple_force_N"] for x in facts["findings"]["bearings"].values()]
    assert couples and min(couples) > 0.1


@pytest.mark.many
@pytest.mark.parametrize("name", LOADED)
def test_mujoco_moves_it_as_it_moves_here(name):
    mujoco = pytest.importorskip("mujoco")
    made = sk.load(name)
    bearings = [load.name for load in made.loads if isinstance(load, sk.Bearings)]
    made, values = find_pose(made.with_loads(without=bearings))
    written = MujocoModel(made, values, timestep=2.5e-4)
    assert not [note for note in written.notes if "left out" in note]
    model = mujoco.MjModel.from_xml_string(written.text)
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 800)
    names = [item.pair for item in made.inputs]
    got = np.array([data.joint(pair).qpos[0] for pair in names])
    q = tuple(float(values[made.angles[pair]]) for pair in names)
    start = sk.Start(q=q, dq=(0.0,) * len(q))
    found = sk.simulate(made, start, 0.2, assembly_mode=0).at([0.2])
    assert np.max(np.abs(got - q)) > 0.05
    assert np.max(np.abs(got - found.inputs[0])) < LOADED[name]


def test_sweeps_of_torques_with_rubbing_bearings_name_the_table_that_has_them():
    arcs = {"links.2.arc": [14.0]}
    with pytest.raises(sk.SpherekitError, match="friction follows") as refused:
        sk.sweep("stephenson", arcs, ["most=max(abs(torque))"], samples=5)
    (figure,) = re.findall('--reduce "([^"]+)"', str(refused.value))
    swept = sk.sweep("stephenson", arcs, [f"most={figure}"], samples=5).frame()
    assert len(swept) == 4 and (swept["most"] > 1e-3).all()
