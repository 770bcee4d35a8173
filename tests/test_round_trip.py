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
"""Numbers of random poses."""
ROUNDINGS = 16
"""So many of them over the measure at most; 8 are seen."""
STATED_ERROR = 1e-13
"""Error (rad) that the documentation states where the measure is large enough."""


def angles_between_directions(a, b):
    """Return the angles (rad) between unit vectors, both (n, 3)."""
    return 2.0 * np.arcsin(0.5 * np.linalg.norm(a - b, axis=1))


def largest_input_differences(inputs, expected):
    """Return the largest difference (rad) of the inputs in each row, modulo whole turns.

    Both arguments are (n, inputs).
    """
    differences = np.remainder(inputs - expected + np.pi, 2.0 * np.pi) - np.pi
    return np.abs(differences).max(axis=1)


def check_error_against_measure(error, measure):
    """Assert that errors (n,) in rad are some roundings over the singularity measure.

    `measure` (n,) is 1 at best, and 0 at a singularity: of type II for poses from inputs,
    of type I for inputs from poses.
    """
    assert np.all(error * measure <= ROUNDINGS * EPS)
    is_regular = measure > ROUNDINGS * EPS / STATED_ERROR  # above 0.036
    assert np.all(error[is_regular] < STATED_ERROR)


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("name", ["five_bar", "two_dof_spm"])
def test_a_direction_returns_from_its_inputs_and_inputs_from_their_direction(name, count):
    """Inverse and forward kinematics of random directions lead back to where they began.

    Inputs are computed for a direction, then the direction for these inputs, then its
    inputs. A working mode is one way to assemble the legs at a pose, an assembly mode one
    way at some inputs. Of several assembly modes, the one nearest to the first direction
    counts. The errors are some rounding errors divided by a measure of singularity of the
    configuration: type II for directions, type I for inputs.
    """
    # `labels` are the working modes. `type_1` and `type_2` of a row are the two measures.
    solver = output_kinematics(sk.load(name))
    directions = np.random.default_rng(1).normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for working_mode in solver.labels:
        rows = solver.inverse(directions, [working_mode])
        reached = np.asarray(rows.status == Status.OK)
        expected_inputs = rows.inputs[reached]
        forward = solver.forward(expected_inputs)
        # forward.row is the row of the inputs, once for each of their assembly modes.
        expected_directions = directions[reached][forward.row]
        error = angles_between_directions(forward.directions, expected_directions)
        by_row_and_error = np.lexsort((error, forward.row))
        row, first = np.unique(forward.row[by_row_and_error], return_index=True)
        assert len(row) == np.sum(reached) > 0
        nearest = by_row_and_error[first]
        check_error_against_measure(error[nearest], rows.type_2[reached])

        inputs = solver.inverse(forward.directions[nearest], [working_mode]).inputs
        input_error = largest_input_differences(inputs, expected_inputs)
        least_type_1 = rows.type_1[reached].min(axis=1)  # over the legs
        check_error_against_measure(input_error, least_type_1)


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("name", ["three_rrr", "agile_eye"])
def test_an_orientation_returns_from_its_inputs_and_inputs_from_their_orientation(
    name, count
):
    """Inverse and forward kinematics of random orientations lead back to where they began.

    For every working mode (way to assemble the legs at a pose), inputs are computed for an
    orientation, then the orientation for these inputs, then its inputs. The singularity
    measures of type I and II are 1 at best and 0 at a singularity. The error of an
    orientation is some rounding errors divided by the measure of type II. That of an input
    is some rounding errors divided by the measure of type I.

    Forward kinematics is Newton's method on all loops with the inputs locked. It starts
    from disturbed passive angles. The disturbance is so small beside the measure of type II
    that Newton's method stays in the same assembly mode.
    """
    solver = output_kinematics(sk.load(name))
    newton = ForwardKinematics(solver.mechanism).solver
    orientations = Rotation.random(count, random_state=1).as_matrix()
    variables = range(9)  # all joint angles of three legs
    passive = [k for k in variables if k not in newton.driven]
    noise = np.random.default_rng(2).normal(size=(count, len(passive)))
    for working_mode in solver.labels:
        rows = solver.inverse(orientations, [working_mode], variables)
        reached = np.asarray(rows.status == Status.OK)
        type_2 = rows.type_2[reached]
        start = rows.values[reached]
        # As many rows of random numbers as there are poses that the mode reaches.
        noise_of_reached = noise[: np.sum(reached)]
        start[:, passive] += 1e-4 * type_2[:, None] * noise_of_reached
        values = newton.closure.solve(start, newton.driven).values
        rotations = newton.closure.linearise(values).rotations
        returned = output_orientations(solver.mechanism, solver.output, rotations)
        error = angles_between(returned, orientations[reached])
        check_error_against_measure(error, type_2)

        inputs = solver.inverse(returned, [working_mode]).inputs
        input_error = largest_input_differences(inputs, rows.inputs[reached])
        least_type_1 = rows.type_1[reached].min(axis=1)  # over the legs
        check_error_against_measure(input_error, least_type_1)
