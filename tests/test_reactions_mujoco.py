"""Accelerations and reactions against MuJoCo's: of loops to its impedance of 1e-4."""

from dataclasses import replace

import numpy as np
import pytest
from mechanism_examples.linkages import mechanism_from_chain
from oracles.newton_euler import random_mass, with_point_masses
from test_dynamics_several_inputs import STARTS

import spherekit as sk
from spherekit.dynamics.reactions import reactions
from spherekit.exchange.mjcf import MujocoModel
from spherekit.files.time_law import Polynomial
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.positions.timing import evaluate_time_laws

mujoco = pytest.importorskip("mujoco")


@pytest.mark.parametrize("name", ["five_bar", "three_rrr"])
def test_what_holds_loops_together_is_what_mujoco_says(name):
    """Of each hinge, the torque there of the moments at the pairs that close loops."""
    made = with_point_masses(name)
    dq = tuple(0.4 * (-1) ** (k + 1) for k in range(len(made.inputs)))
    found = sk.simulate(made, sk.Start(STARTS[name], dq), 0.01)
    begun = found.at([0.0])
    model = mujoco.MjModel.from_xml_string(MujocoModel(made, begun.values[0]).text)
    data = mujoco.MjData(model)
    hinges = [model.joint(k).name for k in range(model.njnt)]
    dofs = [int(model.joint(hinge).dofadr[0]) for hinge in hinges]
    data.qvel[dofs] = [begun.value_rates[0, made.angles[hinge]] for hinge in hinges]
    mujoco.mj_forward(model, data)
    faster = [data.qacc[dofs[hinges.index(item.pair)]] for item in made.inputs]
    assert faster == pytest.approx(begun.input_accelerations[0], rel=3e-4)
    frames = found.equation.closure.linearise(begun.values).frames[0]
    moments = found.moments(np.zeros(1)).moments[0]
    on_links = np.zeros((len(made.links), 3))
    for number, pair in enumerate(made.pairs):
        if pair.name not in hinges:
            first, second = made.ends[number]
            on_links[second] += frames[number] @ moments[number]
            on_links[first] -= frames[number] @ moments[number]
    bodies = {model.body(k).name: k for k in range(model.nbody)}
    wanted = []
    for hinge in hinges:
        joint = model.joint(hinge).id
        carried = []
        for link in made.links[1:]:
            body = bodies[link]
            while body not in (0, int(model.jnt_bodyid[joint])):
                body = int(model.body_parentid[body])
            carried += [made.link_number[link]] if body else []
        wanted.append(data.xaxis[joint] @ np.sum(on_links[carried], axis=0))
    held = data.qfrc_constraint[dofs]
    assert held == pytest.approx(np.array(wanted), abs=3e-4 * np.max(np.abs(wanted)))


def test_forces_of_an_open_chain_are_what_mujoco_says():
    """A wrist of three R pairs: the wrench of each hinge, without any constraint."""
    axes = np.array([[0.1, 0.2, 1.0], [1.0, 0.3, 0.2], [0.2, -1.0, 0.4]])
    made = mechanism_from_chain("1-2 2-3 3-4", axes / np.linalg.norm(axes, axis=1)[:, None])
    random = np.random.default_rng(8)
    made = made.with_inputs(*[pair.name for pair in made.pairs])
    made = replace(made, masses=tuple(random_mass(random, link) for link in made.links[1:]))
    made = made.with_loads(sk.Gravity("weight", (1.0, -2.0, -9.0)))
    q, dq, ddq = (0.3, -0.5, 0.8), (1.0, -2.0, 1.5), (4.0, 3.0, -6.0)
    laws = {
        item.pair: Polynomial((a, b, c / 2))
        for item, a, b, c in zip(made.inputs, q, dq, ddq, strict=True)
    }
    path, timing = evaluate_time_laws(list(laws), laws, np.zeros(1))
    motion = replace(PositionAnalysis(made, None, 0, path=path).motion(), timing=timing)
    found = reactions(motion)
    model = mujoco.MjModel.from_xml_string(MujocoModel(made, found.torques.values[0]).text)
    data = mujoco.MjData(model)
    data.qvel, data.qacc = dq, ddq
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_comVel(model, data)
    mujoco.mj_rnePostConstraint(model, data)
    for k, (_, second) in enumerate(made.ends):
        number = model.body(made.links[second]).id
        moment, force = data.cfrc_int[number].reshape(2, 3)
        moment = moment + np.cross(data.subtree_com[model.body_rootid[number]], force)
        frame = found.frames[0, k]
        scale = np.max(np.abs(found.forces))
        assert frame @ found.forces[0, k] == pytest.approx(force, abs=1e-11 * scale)
        assert frame @ found.moments[0, k] == pytest.approx(moment, abs=1e-11 * scale)
