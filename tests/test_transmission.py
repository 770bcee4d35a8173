"""One measure of type II singularities in every analysis.

The measure is a number from 0 to 1. It is 0 where the output can move although all inputs
are locked (type II, or III with type I), and 1 where the output would be held as firmly as
with all pairs locked. The independent side computes it from the velocity equations of all
links (`oracles.velocity_equations`).
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from oracles.velocity_equations import least_misfit, velocity_equations
from scipy.spatial.transform import Rotation

import spherekit as sk
from spherekit.geometry.mirror import normal_at
from spherekit.outputs.fixed_axis_rotation import follow_rotation
from spherekit.outputs.pose_constraints import Constraints, bounds_of
from spherekit.outputs.pose_solver import closed_kinematics, output_kinematics
from spherekit.outputs.workspace import judge
from spherekit.planning.assembly_plan import plan_assembly
from spherekit.positions.motion import make_motion
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.positions.position_solver import PositionSolver
from spherekit.singularities.several_inputs import RowType, coefficients
from spherekit.singularities.stationarity import output_of
from spherekit.status import Status
from spherekit.tolerances import SINGULAR_TRANSMISSION
from spherekit.velocities.transmission_measure import Transmission

CLOSED_FORM_MECHANISMS = ("five_bar", "two_dof_spm", "three_rrr", "agile_eye")
"""Mechanisms whose inverse kinematics has a closed form."""
DISTANCES_RAD = [0.0, 1e-12, 1e-10, 1e-8, 1e-5, 1e-3, 0.1]
"""Angles of rotation from a type II singularity."""


def compute_axes(mechanism, values):
    """Return axes of R pairs, and directions of the output, for rows of pair angles.

    R pairs are revolute joints; a row is one configuration.

    Returns
    -------
    axes
        (n, pairs, 3) unit vectors in the ground frame.
    directions
        (n, 3) directions of an output that points, None for an output that is a pose. An
        output with a direction counts as pointing only if there are two inputs, which can
        determine a direction. Three inputs determine the whole pose of its link.
    """
    closure = PositionSolver(mechanism, plan_assembly(mechanism)).closure.linearise(values)
    output = mechanism.outputs[0]
    if len(mechanism.inputs) != 2 or output.direction is None:
        return closure.vectors, None
    rotations = closure.rotations[:, mechanism.link_number[output.link]]
    return closure.vectors, rotations @ np.array(output.direction)


def measure_by_velocity_equations(mechanism, values):
    """Return the measure (n,) of type II from the velocity equations of all links.

    It is the independent reference. If the inputs are locked and the output still turns at
    unit rate, pairs usually have to give way. The misfit is the norm of the relative
    angular velocities that the pairs do not allow. The measure is the least misfit, divided
    by its value with all pairs locked. It is 0 at a singularity of type II, where the
    output can move although the inputs are locked, and at most 1. `values` (n, variables)
    are the pair angles (rad).
    """
    # Unit vectors of the pair axes, and the directions of the output if it is a direction
    # (None if it is an orientation). `least_misfit` does not count rates about a direction.
    axes, directions = compute_axes(mechanism, values)
    output = mechanism.outputs[0]
    link = mechanism.link_number[output.link]
    relative_to = mechanism.link_number[output.relative_to]
    input_pairs = {mechanism.pair_number[item.pair] for item in mechanism.inputs}
    measures = []
    for row in range(len(axes)):
        direction = None if directions is None else directions[row]
        measures.append(
            least_misfit(
                mechanism.ends, axes[row], input_pairs, link, relative_to, direction
            )
        )
    return np.array(measures)


class ReachedPoses(NamedTuple):
    """Random poses of an output, and the inverse solutions of those that are reached."""

    solver: object
    poses: np.ndarray
    rows: object


def solve_random_poses(name, count=60):
    """Solve the inverse kinematics of random directions or orientations."""
    solver = output_kinematics(sk.load(name))
    random = np.random.default_rng(7)
    poses = random.normal(size=(count, 3))
    poses /= np.linalg.norm(poses, axis=1, keepdims=True)
    if not solver.points:
        poses = Rotation.random(count, random_state=7).as_matrix()
    pairs = range(len(solver.mechanism.pairs))
    return ReachedPoses(solver, poses, solver.inverse(poses, solver.labels, pairs))


@pytest.fixture(scope="module")
def rotation_of_the_paper():
    """Return the closed form of the rotation in Table 3 of Chen et al. 2021.

    The mid-plane of the mechanism turns between two normals, given by two angles in
    degrees. On the way its inputs meet a type II singularity (`crossings`).
    """
    form = sk.mid_plane_form(sk.load("two_dof_spm"))
    start = normal_at(*np.radians((75, -20)))
    stop = normal_at(*np.radians((70, 20)))
    return form.rotation_between(start, stop, (-1, 1, 1))


@pytest.mark.many
@pytest.mark.parametrize("name", CLOSED_FORM_MECHANISMS)
def test_all_analyses_measure_type_2_as_the_velocity_equations(name):
    """All analyses have the same measure of type II as the velocity equations.

    The measure is 0 at a singularity of type II, where the output can move although the
    inputs are locked, and at most 1. The analyses are inverse kinematics, singularities,
    workspace, and rotation about a fixed axis. `solve_random_poses` solves the inverse
    kinematics of random poses.

    The workspace also has a measure of type I. The arcsines of both measures are angles to
    the singularities. At least 8 degrees are asked for. So the margin of a pose to the
    singularities is the smaller angle less these 8 degrees. If another limit of the
    workspace is nearer, the margin of the pose is smaller (`limiting` is the nearest one).
    """
    solver, poses, rows = solve_random_poses(name)
    mechanism = solver.mechanism
    is_reached = rows.solved & np.isfinite(rows.values).all(axis=1)
    reached = np.flatnonzero(is_reached)
    assert len(reached) > 50
    values = rows.values[reached]
    expected = measure_by_velocity_equations(mechanism, values)
    assert np.max(np.abs(rows.type_2[reached] - expected)) < 1e-12

    motion = make_motion(PositionSolver(mechanism, plan_assembly(mechanism)), values)
    singularities = coefficients(motion, output_of(mechanism))
    assert np.max(np.abs(singularities.type_two - expected)) < 1e-12
    is_type_2 = np.isin(singularities.type, (RowType.II, RowType.III))
    assert np.array_equal(is_type_2, expected < SINGULAR_TRANSMISSION)

    # `near` is the least angle to a singularity.
    least_angle = np.radians(8.0)
    kinematics = closed_kinematics(mechanism)
    bounds = bounds_of(kinematics, Constraints(near=least_angle))
    mode_numbers = {label: number for number, label in enumerate(solver.labels)}
    # Every seventh row, because the workspace takes one row at a time.
    for k in range(0, len(reached), 7):
        row = reached[k]
        signs = kinematics.modes[mode_numbers[rows.mode[row]]]
        pose = poses[rows.pose[row]]
        is_orientation = not solver.points
        if is_orientation:
            pose = Rotation.from_matrix(pose).as_quat()
        judgement = judge(kinematics, bounds, signs, pose[None])
        assert judgement.type_2[0] == pytest.approx(expected[k], abs=1e-12)
        least_measure = min(expected[k], rows.type_1[row].min())
        margin_to_singularity = np.arcsin(least_measure) - least_angle
        # Limits of reach may be nearer than the singularity.
        assert judgement.margin[0] <= margin_to_singularity + 1e-9
        is_singularity_nearest = "type" in bounds[judgement.limiting[0]].name
        if is_singularity_nearest:
            assert judgement.margin[0] == pytest.approx(margin_to_singularity, abs=1e-9)

    # The rotation of the output about a fixed axis can start only away from singularities,
    # so it starts at the pose with the largest measures.
    least_measures = np.minimum(rows.type_2, rows.type_1.min(axis=1))
    best = reached[int(np.argmax(least_measures[reached]))]
    rotation = follow_rotation(mechanism, rows.values[best], [0.2, 0.3, 0.9], 0.01)
    assert rotation.at([0.0]).type_2[0] == pytest.approx(rows.type_2[best], abs=1e-9)


@pytest.mark.many
@pytest.mark.parametrize("distance_rad", DISTANCES_RAD)
def test_all_analyses_see_a_type_2_singularity_on_the_path_of_the_paper(
    rotation_of_the_paper, distance_rad
):
    """Every analysis has the same measure of type II near a singularity.

    The path of the paper (Chen et al. 2021) crosses a singularity of type II: the output
    can move although both inputs stand still. The measure is 0 there. Close to the crossing
    it is 0.6315 times the angle (rad) along the path. This factor was computed in 50
    digits. The largest angle, 0.1 rad, is not that close, so an error of 30 % is allowed.
    Status and type follow from the measure. Differences below 2e-14 are rounding.
    `rotation_of_the_paper` is the closed form of this path, a rotation about a fixed axis.
    """
    mechanism = sk.load("two_dof_spm")
    (crossing,) = rotation_of_the_paper.crossings
    on_path = rotation_of_the_paper.at(np.array([crossing + distance_rad]))
    values = on_path.values
    # To which side each of the three legs is bent on this path (the working mode).
    leg_signs = (-1, 1, 1)
    # 1. The reference: the velocity equations of all links
    (expected,) = measure_by_velocity_equations(mechanism, values)
    assert expected == pytest.approx(0.6315 * distance_rad, rel=0.3, abs=2e-14)
    # 2. The closed form of the path
    assert on_path.type_2[0] == pytest.approx(expected, rel=1e-3, abs=2e-14)

    # 3. Inverse kinematics of the direction of the output. It computes the configuration
    # anew, with ten times as much rounding.
    direction = on_path.orientation @ np.array(mechanism.outputs[0].direction)
    rows = output_kinematics(mechanism).inverse(direction, ["-++"])
    assert rows.type_2[0] == pytest.approx(expected, rel=1e-3, abs=2e-13)

    # 4. Singularities of a motion
    motion = make_motion(PositionSolver(mechanism, plan_assembly(mechanism)), values)
    singularities = coefficients(motion, output_of(mechanism))
    assert singularities.type_two[0] == pytest.approx(expected, rel=1e-3, abs=2e-14)

    is_singular = expected < SINGULAR_TRANSMISSION
    assert (singularities.type[0] == RowType.II) == is_singular
    assert (on_path.status[0] == Status.AT_SINGULARITY) == is_singular
    assert (rows.status[0] == Status.AT_SINGULARITY) == is_singular

    # 5. The workspace. The arcsine of the measure is an angle to the singularity. The
    # margin is this angle less the least angle that is asked for.
    least_angle = np.radians(5.0)
    kinematics = closed_kinematics(mechanism)
    bounds = bounds_of(kinematics, Constraints(near=least_angle))
    # `judge` returns the margins of poses in a working mode.
    margin = judge(kinematics, bounds, leg_signs, direction).margin[0]
    # The margin is computed from the cosine of twice the angle. Near the angle 0, rounding
    # of this cosine (1e-16) changes the angle by about 1e-8.
    assert margin == pytest.approx(np.arcsin(expected) - least_angle, abs=3e-8)


def test_equations_with_locked_inputs_lose_their_rank_on_the_path_of_the_paper(
    rotation_of_the_paper,
):
    """The least singular value of the equations is zero at the crossing, up to rounding."""
    mechanism = sk.load("two_dof_spm")
    (crossing,) = rotation_of_the_paper.crossings
    axes, _ = compute_axes(mechanism, rotation_of_the_paper.at(np.array([crossing])).values)
    input_pairs = {mechanism.pair_number[item.pair] for item in mechanism.inputs}
    ground_columns = 3
    equations = velocity_equations(mechanism.ends, axes[0], held=input_pairs)
    singular_values = np.linalg.svd(equations[:, ground_columns:], compute_uv=False)
    assert singular_values[-1] < 1e-14


def test_an_output_that_moves_with_locked_inputs_has_a_measure_of_zero():
    """The pointer of a five-bar moves although one of its two cranks is locked."""
    mechanism = sk.load("five_bar")
    motion = sk.trace(mechanism, samples=3)
    closure = PositionAnalysis(mechanism, samples=3).solver.closure
    one_input = mechanism.with_inputs("21")
    transmission = Transmission.from_mechanism(one_input, mechanism.outputs[0])
    values = motion.values[~motion.failed]
    assert np.all(transmission.measure_configurations(closure, values) == 0.0)


@pytest.mark.parametrize("name", ["bevel_differential", "three_rrr", "two_dof_spm"])
def test_the_measure_does_not_depend_on_the_frame_or_the_ground(name):
    """The measure of type II does not change in other axes or with another ground.

    The measure is a number from 0 to 1. It is 0 where the output can move although the
    inputs are locked. All vectors are rotated alike. The axes of the pairs are also scaled
    by 3, because their lengths do not matter. If the output is a direction, its unit vector
    is only rotated.
    """
    mechanism = sk.load(name)
    motion = PositionAnalysis(mechanism, samples=3, assembly_mode=0).motion()
    values = motion.values[~motion.failed][:2]
    plan = plan_assembly(mechanism)
    closure = PositionSolver(mechanism, plan).closure.linearise(values)
    transmission = Transmission.from_mechanism(mechanism, mechanism.outputs[0])
    axes = closure.vectors
    directions = transmission.output_directions(closure.rotations)
    measures = transmission.measure(axes, directions)

    rotation = Rotation.random(random_state=1).as_matrix()
    turned_directions = None if directions is None else directions @ rotation.T
    measures_turned = transmission.measure(3.0 * axes @ rotation.T, turned_directions)
    assert np.max(np.abs(measures - measures_turned)) < 1e-13

    other_ground = replace(mechanism, ground=mechanism.links[-1])
    transmission = Transmission.from_mechanism(other_ground, mechanism.outputs[0])
    measures_other_ground = transmission.measure(axes, directions)
    assert np.max(np.abs(measures - measures_other_ground)) < 1e-13


def test_turning_about_the_direction_of_an_output_does_not_count_as_motion():
    """An output that only turns about its own direction does not count as moving.

    The output of a five-bar is a direction of link 3: the axis of the pair at the end of
    its crank. The cranks are locked, and both couplers (links 3 and 4) are in line. Link 3
    can then turn about this axis, so the direction does not move. The measure of type II
    would be 0 if the output could move. It is above 0.1, and nearly the same for couplers
    that are not quite in line.
    """
    mechanism = sk.load("five_bar")
    transmission = Transmission.from_mechanism(mechanism, mechanism.outputs[0])
    # The axes are those of the pairs 21, 32, 43, 54 and 51, of which 21 and 51 are inputs.
    # The axes 1 to 3 of the couplers lie in the plane z = 0. In row 1 the middle one is off
    # by 1e-6, so that the couplers are stretched nearly.
    axes = np.zeros((2, 5, 3))
    azimuths = np.radians([0.0, 75.0, 150.0])
    axes[:, 1:4, 0] = np.cos(azimuths)
    axes[:, 1:4, 1] = np.sin(azimuths)
    axes[:, 0] = [0.0, 0.0, 1.0]
    axes[:, 4] = [0.6, 0.0, 0.8]
    axes[1, 2, 2] = 1e-6
    axes = axes @ Rotation.random(random_state=1).as_matrix()
    stretched, nearly_stretched = transmission.measure(axes, axes[:, 1])
    assert stretched > 0.1
    assert stretched == pytest.approx(nearly_stretched, abs=1e-5)
