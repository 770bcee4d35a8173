"""Accelerations and reactions against MuJoCo's.

MuJoCo joins the links of a tree by hinges, and closes loops by soft constraints whose
impedance is about 1e-4; so mechanisms with loops agree to some 1e-4 only, and open chains
to rounding.
"""

from dataclasses import replace

import numpy as np
import pytest
from helpers.polynomial_motions import START_INPUTS
from mechanism_examples.linkages import mechanism_from_chain
from oracles.newton_euler import random_mass, with_point_masses

import spherekit as sk
from spherekit.dynamics.reactions import reactions
from spherekit.exchange.mjcf import MujocoModel
from spherekit.files.time_law import Polynomial
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.positions.timing import evaluate_time_laws

mujoco = pytest.importorskip("mujoco")


def links_beyond_hinge(model, mechanism, hinge):
    """Return the numbers of the moving links that a hinge of MuJoCo's tree carries.

    These are all links that the tree reaches from the ground through this hinge. The caller
    adds the moments on these links, to compare the sum with a torque at the hinge.

    Parameters
    ----------
    model
        MuJoCo's model, whose bodies have the names of the links.
    mechanism
        Mechanism of the model; its first link is the ground.
    hinge
        Name of the hinge, which is that of a pair.
    """
    hinge_body = int(model.jnt_bodyid[model.joint(hinge).id])
    ground_body = 0
    carried_links = []
    for link in mechanism.links[1:]:
        body = model.body(link).id
        while body not in (ground_body, hinge_body):
            body = int(model.body_parentid[body])
        if body == hinge_body:
            carried_links.append(mechanism.link_number[link])
    return carried_links


@pytest.mark.parametrize("name", ["five_bar", "three_rrr"])
def test_accelerations_and_moments_that_close_loops_agree_with_mujoco(name):
    """Accelerations and loop-closing moments agree with MuJoCo's to 3e-4.

    Compared is the first instant of a simulation without loads. MuJoCo joins the links of a
    tree by hinges and closes the loops by soft constraints. MuJoCo states the effect of
    these constraints as one torque for each hinge. The same torque follows from spherekit's
    moments at the pairs that close loops. The moments on all links beyond the hinge in the
    tree are added, and the component along the axis of the hinge is taken. Soft constraints
    yield by a relative 1e-4, so the programs do not agree more closely.
    """
    mechanism = with_point_masses(name)
    input_rates = tuple(0.4 * (-1) ** (k + 1) for k in range(len(mechanism.inputs)))
    start = sk.Start(START_INPUTS[name], input_rates)
    simulation = sk.simulate(mechanism, start, 0.01)
    state = simulation.at([0.0])

    model = mujoco.MjModel.from_xml_string(MujocoModel(mechanism, state.values[0]).text)
    data = mujoco.MjData(model)
    hinges = [model.joint(k).name for k in range(model.njnt)]
    dofs = [int(model.joint(hinge).dofadr[0]) for hinge in hinges]
    hinge_columns = [mechanism.angles[hinge] for hinge in hinges]
    data.qvel[dofs] = state.value_rates[0, hinge_columns]
    mujoco.mj_forward(model, data)
    input_dofs = [dofs[hinges.index(item.pair)] for item in mechanism.inputs]
    assert data.qacc[input_dofs] == pytest.approx(state.input_accelerations[0], rel=3e-4)

    # (pairs, 3, 3) axes of each pair's frame in ground axes, and (pairs, 3) moments in it
    frames = simulation.equation.closure.linearise(state.values).frames[0]
    moments = simulation.moments(np.zeros(1)).moments[0]
    moment_on_link = np.zeros((len(mechanism.links), 3))  # N m, ground axes
    for number, pair in enumerate(mechanism.pairs):
        if pair.name not in hinges:
            first, second = mechanism.ends[number]
            moment = frames[number] @ moments[number]
            moment_on_link[second] += moment
            moment_on_link[first] -= moment

    expected = []
    for hinge in hinges:
        links_beyond = links_beyond_hinge(model, mechanism, hinge)
        axis = data.xaxis[model.joint(hinge).id]
        expected.append(axis @ np.sum(moment_on_link[links_beyond], axis=0))
    tolerance = 3e-4 * np.max(np.abs(expected))
    assert data.qfrc_constraint[dofs] == pytest.approx(np.array(expected), abs=tolerance)


def wrist_with_masses():
    """Return an open chain of three R pairs, all driven, with random masses and gravity."""
    axes = np.array([[0.1, 0.2, 1.0], [1.0, 0.3, 0.2], [0.2, -1.0, 0.4]])
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    wrist = mechanism_from_chain("1-2 2-3 3-4", axes)
    random = np.random.default_rng(8)
    wrist = wrist.with_inputs(*[pair.name for pair in wrist.pairs])
    masses = tuple(random_mass(random, link) for link in wrist.links[1:])
    return replace(wrist, masses=masses).with_loads(sk.Gravity("weight", (1.0, -2.0, -9.0)))


def test_wrenches_in_an_open_chain_are_those_of_mujoco():
    """Force and moment in each hinge of a wrist are those of MuJoCo, to rounding.

    Angles, rates and accelerations are prescribed. MuJoCo computes the wrenches by its own
    recursive Newton-Euler algorithm. They act on the second link of each pair. MuJoCo's
    moments are about the centre of mass of the tree and are moved to the centre of the
    sphere. Those of spherekit are in axes of the pair and are turned to ground axes.
    """
    wrist = wrist_with_masses()
    q = (0.3, -0.5, 0.8)  # rad
    dq = (1.0, -2.0, 1.5)  # rad/s
    ddq = (4.0, 3.0, -6.0)  # rad/s^2
    laws = {}
    for item, angle, rate, acceleration in zip(wrist.inputs, q, dq, ddq, strict=True):
        laws[item.pair] = Polynomial((angle, rate, acceleration / 2))
    path, timing = evaluate_time_laws(list(laws), laws, np.zeros(1))
    position_analysis = PositionAnalysis(wrist, assembly_mode=0, path=path)
    motion = replace(position_analysis.motion(), timing=timing)
    result = reactions(motion)

    # The model is built in the pose of these pair variables, so its own angles are 0.
    pose = result.torques.values[0]
    model_text = MujocoModel(wrist, pose).text
    model = mujoco.MjModel.from_xml_string(model_text)
    data = mujoco.MjData(model)
    data.qvel = dq
    data.qacc = ddq
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_comVel(model, data)
    mujoco.mj_rnePostConstraint(model, data)

    tolerance = 1e-11 * np.max(np.abs(result.forces))
    for k, (_, second) in enumerate(wrist.ends):
        body = model.body(wrist.links[second]).id
        moment, force = data.cfrc_int[body].reshape(2, 3)
        moment = moment + np.cross(data.subtree_com[model.body_rootid[body]], force)
        frame = result.frames[0, k]
        assert frame @ result.forces[0, k] == pytest.approx(force, abs=tolerance)
        assert frame @ result.moments[0, k] == pytest.approx(moment, abs=tolerance)
