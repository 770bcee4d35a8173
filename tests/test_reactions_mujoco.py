"""Accelerations and reactions against MuJoCo's, to its constraint impedance of 1e-4."""

import numpy as np
import pytest
from test_dynamics_several_inputs import STARTS, heavy

import spherekit as sk
from spherekit.exchange.mjcf import mjcf

mujoco = pytest.importorskip("mujoco")


@pytest.mark.parametrize("name", ["five_bar", "three_rrr"])
def test_what_holds_loops_together_is_what_mujoco_says(name):
    """Of each hinge, the torque there of the moments at the pairs that close loops."""
    made = heavy(name)
    dq = tuple(0.4 * (-1) ** (k + 1) for k in range(len(made.inputs)))
    found = sk.simulate(made, sk.Start(STARTS[name], dq), 0.01)
    begun = found.at([0.0])
    model = mujoco.MjModel.from_xml_string(mjcf(made, begun.values[0]).text)
    data = mujoco.MjData(model)
    hinges = [model.joint(k).name for k in range(model.njnt)]
    dofs = [int(model.joint(hinge).dofadr[0]) for hinge in hinges]
    data.qvel[dofs] = [begun.value_rates[0, made.angles[hinge]] for hinge in hinges]
    mujoco.mj_forward(model, data)
    faster = [data.qacc[dofs[hinges.index(item.pair)]] for item in made.inputs]
    assert faster == pytest.approx(begun.input_accelerations[0], rel=3e-4)
    frames = found.equation.closure.at(begun.values).frames[0]
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
