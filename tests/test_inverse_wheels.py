"""Inverse kinematics of wrists whose wheels count the turns of their inputs."""

from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import spherekit as sk
from spherekit.errors import AnalysisError
from spherekit.geometry.sphere_mesh import spiral_directions
from spherekit.outputs.pose_solver import output_kinematics
from spherekit.plugin.rotations import from_tilt_torsion

RATIO = 1.5
"""Teeth of a side gear for one of the hand's: half angles atan(1.5) and its complement."""
SIDE = float(np.degrees(np.arctan(RATIO)))
POSES = np.random.default_rng(4).uniform([-3.0, 0.2, -3.0], [3.0, 2.9, 3.0], (12, 3))
"""Tilts and torsions (rad)."""


@pytest.fixture(scope="module")
def wrist():
    """A column that yaws, and on it a bevel differential whose planet is the hand."""
    axles = {"yaw": ("base", "column", [0.0, 0.0, 1.0])}
    across = {"left_axle": "left", "right_axle": "right", "pitch": "cage"}
    axles |= {name: ("column", link, [0.0, 1.0, 0.0]) for name, link in across.items()}
    axles["roll"] = ("cage", "hand", [1.0, 0.0, 0.0])
    pairs = {
        name: {"type": "R", "links": [one, other], "xyz": axis}
        for name, (one, other, axis) in axles.items()
    }
    hand = {"kind": "circle", "centre_xyz": [1.0, 0.0, 0.0], "radius": 90.0 - SIDE}
    for gear, way in (("left", 1.0), ("right", -1.0)):
        circle = {"kind": "circle", "centre_xyz": [0.0, way, 0.0], "radius": SIDE}
        mesh = {"links": [gear, "hand"], "profiles": {gear: circle, "hand": hand}}
        pairs[f"{gear}_mesh"] = {"type": "Cr", **mesh}
    return sk.build(
        "differential_wrist",
        angle_unit="deg",
        ground="base",
        links={n: {} for n in ("base", "column", "left", "right", "cage", "hand")},
        pairs=pairs,
        inputs={name: {} for name in ("yaw", "left_axle", "right_axle")},
        outputs={"hand": {"link": "hand"}},
    )


def by_hand(inputs):
    """Yaw, then the mean of both side gears, then their difference by the ratio."""
    yaw, left, right = inputs
    angles = yaw, 0.5 * (left + right), -0.5 * RATIO * (left - right)
    return Rotation.from_euler("ZYX", angles).as_matrix()


def test_forward_is_the_formula_of_the_differential(wrist):
    forward = sk.ForwardKinematics(wrist)
    inputs = np.random.default_rng(3).uniform(-9.0, 9.0, (20, 3))
    poses = forward.solutions(inputs)
    assert np.all(poses.row == np.arange(20))
    hand = np.array([by_hand(q) for q in inputs])
    assert np.max(np.abs(poses.rotations - hand)) < 1e-12


@pytest.mark.slow
def test_inputs_of_a_pose_lead_back_to_it_over_all_turns_of_the_wheels(wrist):
    """Both yaws, each with the side gears turned least of all that have the hand there."""
    poses = from_tilt_torsion(POSES)
    inverse = sk.InverseKinematics(wrist).solutions(poses)
    assert np.all(np.bincount(inverse.row) == 2)
    for row, inputs in zip(inverse.row, inverse.inputs, strict=True):
        assert np.max(np.abs(by_hand(inputs) - poses[row])) < 1e-11
        _, left, right = inputs
        turns = np.array(list(product(range(-4, 5), repeat=2))) * 2.0 * np.pi
        pitch, roll = turns[:, 0], turns[:, 1] / RATIO
        others = np.abs(left + pitch + roll) + np.abs(right + pitch - roll)
        assert abs(left) + abs(right) < np.min(others) + 1e-9


def gimbal(roll):
    """A pan-tilt, or with `roll` a pan-tilt-roll, each axis turned by a pinion on it."""
    axes = {"pan": [0.0, 0.0, 1.0], "tilt": [0.0, 1.0, 0.0], "roll": [1.0, 0.0, 0.0]}
    links = ["base", "yoke", "cage", "tool"]
    pairs, names = {}, ("pan", "tilt", "roll")[: 2 + roll]
    for k, name in enumerate(names):
        carrier, moved = links[k : k + 2]
        shaft = axes["roll" if name == "pan" else "pan" if name == "tilt" else "tilt"]
        pairs[name] = {"type": "R", "links": [carrier, moved], "xyz": axes[name]}
        pairs[f"m_{name}"] = {"type": "R", "links": [carrier, f"p_{name}"], "xyz": shaft}
        teeth = ([20, 50], [17, 40], [15, 30])[k]
        mesh = {"links": [f"p_{name}", moved], "teeth": teeth, "axes": [f"m_{name}", name]}
        pairs[f"g_{name}"] = {"type": "Cr", **mesh}
    output = {"link": "tool"} if roll else {"link": "cage", "xyz": [1.0, 0.0, 0.0]}
    return sk.build(
        "gimbal",
        angle_unit="deg",
        ground="base",
        links=[*links[: 3 + roll], *(f"p_{name}" for name in names)],
        pairs=pairs,
        inputs={f"m_{name}": {} for name in names},
        outputs={"tool": output},
    )


@pytest.mark.many
@pytest.mark.parametrize("made", ["differential", "pan_tilt", "pan_tilt_roll"])
def test_the_closed_form_is_that_of_the_graph(made, wrist):
    """Inputs, pairs, rates and both measures, against the velocity equations."""
    mechanism = wrist if made == "differential" else gimbal(made == "pan_tilt_roll")
    closed, graph = output_kinematics(mechanism), output_kinematics(mechanism, graph=True)
    assert (closed.solved_by, graph.solved_by) == ("dyads", "graph")
    poses = spiral_directions(6) if closed.points else from_tilt_torsion(POSES[:4])
    one = closed.inverse(poses, closed.labels, range(len(mechanism.pairs)))
    other = graph.inverse(poses, graph.labels, range(len(mechanism.pairs)))
    assert len(one) == 2 * len(poses) and np.all(one.status == 0)
    met = 0
    for k in range(len(one)):
        off = np.abs(other.inputs - one.inputs[k]).max(axis=1)
        off[other.pose != one.pose[k]] = np.inf
        best = int(np.argmin(off))
        if off[best] < 1e-9:
            met += 1
            for name in ("type_1", "type_2", "rates"):
                there, here = getattr(other, name)[best], getattr(one, name)[k]
                assert np.max(np.abs(there - here)) < 1e-9 * (1.0 + np.max(np.abs(here)))
    assert met >= len(poses)
    assert np.max(closed.residual(one.values)) < 1e-12
    back = closed.forward(one.inputs)
    told = back.directions if closed.points else back.rotations
    assert np.max(np.abs(told - poses[one.pose[back.row]])) < 1e-11


def test_workspace_of_a_geared_pan_tilt(wrist):
    """Tilted by at most 30 degrees it points at a zone of half the sphere."""
    near = sk.run(wrist, "workspace:tolerance=0.3,working_mode=0,near=5")
    assert not near.failures  # the yaw does not move the hand's other carriers
    mechanism = gimbal(roll=False)
    result = sk.run(mechanism, "workspace:limits=tilt:-30:30,tolerance=1e-4")
    table = result.frame("workspace", "areas")
    whole = table[table["part"] == "whole"]
    assert np.min(np.abs(whole["size"] - 2.0 * np.pi)) < 1e-3
    with pytest.raises(AnalysisError, match="limits: m_pan is the pair of a wheel"):
        sk.run(mechanism, "workspace:limits=m_pan:-30:30")
