"""One measure of type II in every analysis: against link rates, many digits, and itself."""

from dataclasses import replace

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
from spherekit.velocities.transmission import Transmission

CLOSED = ("five_bar", "two_dof_spm", "three_rrr", "agile_eye")
DISTANCES = [0.0, 1e-12, 1e-10, 1e-8, 1e-5, 1e-3, 0.1]


def axes_of(mechanism, values):
    """Return the axes (n, pairs, 3) of R pairs, and directions of the output or None."""
    at = PositionSolver(mechanism, plan_assembly(mechanism)).closure.at(values)
    output = mechanism.outputs[0]
    if len(mechanism.inputs) != 2 or output.direction is None:
        return at.vectors, None
    turned = at.rotations[:, mechanism.link_number[output.link]]
    return at.vectors, turned @ np.array(output.direction)


def by_links(mechanism, values):
    """Return the measure (n,) from the rates of all links alone."""
    axes, directions = axes_of(mechanism, values)
    output = mechanism.outputs[0]
    link, of = (mechanism.link_number[name] for name in (output.link, output.relative_to))
    locked = {mechanism.pair_number[item.pair] for item in mechanism.inputs}
    given = mechanism.ends, locked, link, of
    towards = [None] * len(axes) if directions is None else directions
    rows = zip(axes, towards, strict=True)
    return np.array([least_misfit(given[0], own, *given[1:], way) for own, way in rows])


def rows_of(name, count=60):
    """Return the solver, poses and rows of random poses that are reached."""
    solver = output_kinematics(sk.load(name))
    random = np.random.default_rng(7)
    poses = random.normal(size=(count, 3))
    poses /= np.linalg.norm(poses, axis=1, keepdims=True)
    if not solver.points:
        poses = Rotation.random(count, random_state=7).as_matrix()
    pairs = range(len(solver.mechanism.pairs))
    return solver, poses, solver.inverse(poses, solver.labels, pairs)


@pytest.fixture(scope="module")
def paper():
    """The rotation of Table 3 of Chen et al. 2021, by its closed form."""
    form = sk.mid_plane_form(sk.load("two_dof_spm"))
    start, stop = (normal_at(*np.radians(pose)) for pose in ((75, -20), (70, 20)))
    return form.rotation_between(start, stop, (-1, 1, 1))


@pytest.mark.many
@pytest.mark.parametrize("name", CLOSED)
def test_all_analyses_judge_a_configuration_alike(name):
    """Inverse kinematics, workspace, singularities and rotation: one number, one type."""
    solver, poses, rows = rows_of(name)
    made = solver.mechanism
    good = np.flatnonzero(rows.solved & np.isfinite(rows.values).all(axis=1))
    assert len(good) > 50
    values, expected = rows.values[good], by_links(made, rows.values[good])
    assert np.max(np.abs(rows.type_2[good] - expected)) < 1e-12
    motion = make_motion(PositionSolver(made, plan_assembly(made)), values)
    found = coefficients(motion, output_of(made))
    assert np.max(np.abs(found.type_two - expected)) < 1e-12
    second = np.isin(found.type, (RowType.II, RowType.III))
    assert np.array_equal(second, expected < SINGULAR_TRANSMISSION)
    kinematics = closed_kinematics(made)
    bounds = bounds_of(kinematics, Constraints(near=np.radians(8.0)))
    numbers = {label: k for k, label in enumerate(solver.labels)}
    for k in range(0, len(good), 7):
        row = good[k]
        signs = kinematics.modes[numbers[rows.mode[row]]]
        pose = poses[rows.pose[row]]
        place = pose if solver.points else Rotation.from_matrix(pose).as_quat()
        here = judge(kinematics, bounds, signs, place[None])
        assert here.type_2[0] == pytest.approx(expected[k], abs=1e-12)
        least = min(expected[k], rows.type_1[row].min())
        beside = np.arcsin(least) - np.radians(8.0)
        assert here.margin[0] <= beside + 1e-9
        if "type" in bounds[here.limiting[0]].name:
            assert here.margin[0] == pytest.approx(beside, abs=1e-9)
    k = good[int(np.argmax(np.minimum(rows.type_2, rows.type_1.min(axis=1))[good]))]
    turn = follow_rotation(made, rows.values[k], [0.2, 0.3, 0.9], 0.01)
    assert turn.at([0.0]).type_2[0] == pytest.approx(rows.type_2[k], abs=1e-9)


@pytest.mark.many
@pytest.mark.parametrize("distance", DISTANCES)
def test_loops_that_lose_their_rank_are_seen_by_all(paper, distance):
    """On the paper's own path, and beside it: the links move though the inputs stand still.

    The determinant of base axes x elbows, in 50 digits, goes through 0 there; the measure
    is 0.63 of the distance, and both are lost in rounding together.
    """
    made = sk.load("two_dof_spm")
    (place,) = paper.crossings
    at = paper.at(np.array([place + distance]))
    values = at.values
    (expected,) = by_links(made, values)
    assert expected == pytest.approx(0.6315 * distance, rel=0.3, abs=2e-14)
    assert at.type_2[0] == pytest.approx(expected, rel=1e-3, abs=2e-14)
    place = at.orientation @ np.array(made.outputs[0].direction)
    rows = output_kinematics(made).inverse(place, ["-++"])
    assert rows.type_2[0] == pytest.approx(expected, rel=1e-3, abs=2e-13)
    motion = make_motion(PositionSolver(made, plan_assembly(made)), values)
    found = coefficients(motion, output_of(made))
    assert found.type_two[0] == pytest.approx(expected, rel=1e-3, abs=2e-14)
    singular = expected < SINGULAR_TRANSMISSION
    assert (found.type[0] == RowType.II) == singular
    assert (at.status[0] == Status.AT_SINGULARITY) == singular
    assert (rows.status[0] == Status.AT_SINGULARITY) == singular
    kinematics = closed_kinematics(made)
    bounds = bounds_of(kinematics, Constraints(near=np.radians(5.0)))
    margin = judge(kinematics, bounds, (-1, 1, 1), place).margin[0]
    # its limit is known by the cosine of twice the angle, which rounds at 1e-8
    assert margin == pytest.approx(np.arcsin(expected) - np.radians(5.0), abs=3e-8)
    if distance == 0.0:
        axes, _ = axes_of(made, values)
        locked = {made.pair_number[item.pair] for item in made.inputs}
        held = velocity_equations(made.ends, axes[0], held=locked)[:, 3:]
        assert np.linalg.svd(held, compute_uv=False)[-1] < 1e-14


def test_what_the_inputs_do_not_hold_has_no_transmission():
    """A five-bar with one crank locked: its pointer still moves."""
    made = sk.load("five_bar")
    motion = sk.trace(made, samples=3)
    measure = Transmission.from_mechanism(made.with_inputs("21"), made.outputs[0])
    closure = PositionAnalysis(made, samples=3).solver.closure
    assert np.all(
        measure.measure_configurations(closure, motion.values[~motion.failed]) == 0.0
    )


@pytest.mark.parametrize("name", ["bevel_differential", "three_rrr", "two_dof_spm"])
def test_neither_frame_nor_ground_nor_order_matters(name):
    made = sk.load(name)
    motion = PositionAnalysis(made, samples=3, assembly_mode=0).motion()
    values = motion.values[~motion.failed][:2]
    closure = PositionSolver(made, plan_assembly(made, by_rank=True)).closure
    at, own = closure.at(values), Transmission.from_mechanism(made, made.outputs[0])
    vectors, pointed = at.vectors, own.output_directions(at.rotations)
    turn = Rotation.random(random_state=1).as_matrix()
    again = own.measure(
        3.0 * vectors @ turn.T, None if pointed is None else pointed @ turn.T
    )
    moved = Transmission.from_mechanism(
        replace(made, ground=made.links[-1]), made.outputs[0]
    )
    for other in (again, moved.measure(vectors, pointed)):
        assert np.max(np.abs(own.measure(vectors, pointed) - other)) < 1e-13


def test_a_link_that_is_free_to_turn_about_what_it_points_at_counts_as_held():
    """Crank and coupler in line: the dyad of a five-bar is stretched."""
    made = sk.load("five_bar")
    transmission, axes = (
        Transmission.from_mechanism(made, made.outputs[0]),
        np.zeros((2, 5, 3)),
    )
    angles = np.radians([0.0, 75.0, 150.0])
    axes[:, 1:4, 0], axes[:, 1:4, 1] = np.cos(angles), np.sin(angles)
    axes[:, 0], axes[:, 4], axes[1, 2, 2] = [0.0, 0.0, 1.0], [0.6, 0.0, 0.8], 1e-6
    axes = axes @ Rotation.random(random_state=1).as_matrix()
    stretched, beside = transmission.measure(axes, axes[:, 1])
    assert 0.1 < stretched == pytest.approx(beside, abs=1e-5)
