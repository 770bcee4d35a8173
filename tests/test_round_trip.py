"""Forward of inverse and inverse of forward: 16 roundings over the singularity measure.

Half a unit in the last place of an input of 3 rad is 1 EPS, and moves the pose by that
over the measure of type II; so no method keeps 1e-13 below measures of about 1e-3.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import spherekit as sk
from spherekit.geometry.rotation import angles_between
from spherekit.outputs.forward_kinematics import ForwardKinematics, output_orientations
from spherekit.outputs.pose_solver import output_kinematics
from spherekit.status import Status
from spherekit.tolerances import EPS

COUNTS = [500, pytest.param(100_000, marks=pytest.mark.long)]
ROUNDINGS = 16
"""So many of them over the measure at most; 8 are seen."""
TOLD = 1e-13
"""What that keeps to wherever the measure is above 0.036."""


def angle_between(a, b):
    return 2.0 * np.arcsin(0.5 * np.linalg.norm(a - b, axis=1))


def turned(one, other):
    return np.abs(np.remainder(one - other + np.pi, 2.0 * np.pi) - np.pi).max(axis=1)


def keeps_the_law(error, measure):
    assert np.all(error * measure <= ROUNDINGS * EPS)
    assert np.all(error[measure > ROUNDINGS * EPS / TOLD] < TOLD)


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("name", ["five_bar", "two_dof_spm"])
def test_pointing_outputs_return(name, count):
    """Every working mode there, the nearest assembly mode back, and there again."""
    solver = output_kinematics(sk.load(name))
    poses = np.random.default_rng(1).normal(size=(count, 3))
    poses /= np.linalg.norm(poses, axis=1, keepdims=True)
    for mode in solver.labels:
        rows = solver.inverse(poses, [mode])
        good = np.asarray(rows.status == Status.OK)
        found = solver.forward(rows.inputs[good])
        error = angle_between(found.directions, poses[good][found.row])
        order = np.lexsort((error, found.row))
        row, first = np.unique(found.row[order], return_index=True)
        assert len(row) == np.sum(good) > 0
        best = order[first]
        keeps_the_law(error[best], rows.type_2[good])
        again = solver.inverse(found.directions[best], [mode])
        least = rows.type_1[good].min(axis=1)
        keeps_the_law(turned(again.inputs, rows.inputs[good]), least)


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("name", ["three_rrr", "agile_eye"])
def test_orientations_return(name, count):
    """Back by Newton's method on all loops from a start disturbed, inputs held."""
    solver = output_kinematics(sk.load(name))
    own = ForwardKinematics(solver.mechanism).solver
    poses = Rotation.random(count, random_state=1).as_matrix()
    free = [k for k in range(9) if k not in own.driven]
    noise = np.random.default_rng(2).normal(size=(count, len(free)))
    for mode in solver.labels:
        rows = solver.inverse(poses, [mode], range(9))
        good = np.asarray(rows.status == Status.OK)
        start = rows.values[good]
        start[:, free] += 1e-4 * rows.type_2[good][:, None] * noise[: np.sum(good)]
        values = own.closure.solve(start, own.driven).values
        back = output_orientations(
            solver.mechanism, solver.output, own.closure.linearise(values).rotations
        )
        keeps_the_law(angles_between(back, poses[good]), rows.type_2[good])
        again = solver.inverse(back, [mode])
        least = rows.type_1[good].min(axis=1)
        keeps_the_law(turned(again.inputs, rows.inputs[good]), least)
