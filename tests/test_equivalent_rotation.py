"""Rotation about a fixed axis: the third paper's mechanism, any mechanism, schedules."""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import pytest
from helpers.refusals import TABLES, check_call
from mechanism_examples.mid_plane_mechanism import (
    driven_variables,
    fold_angles,
    mid_plane_mechanism,
)
from oracles.velocity_equations import closure_gap, revolute_frames
from scipy.spatial.transform import Rotation

import spherekit as sk
from spherekit.errors import ModelError, SolveError
from spherekit.geometry.mirror import mirror_angles, normal_at, normals_of
from spherekit.geometry.rotation import angles_between, rotation_about_axis
from spherekit.geometry.vectors import cross
from spherekit.mechanism.elements import Input, Output, Pair, PoseGeometry
from spherekit.mechanism.joint_construction import make_joints
from spherekit.outputs.fixed_axis_rotation import axis_and_angle
from spherekit.outputs.rotation_timing import SHAPES, RotationSamples, time_optimal
from spherekit.positions.loop_closure import Closure
from spherekit.positions.position_analysis import PositionAnalysis

OUTWARD = (-1, 1, 1)
"""The driven links as in Fig. 5(a)."""
ARCS = np.radians([60.0, 40.0, 40.0, 60.0, 40.0, 40.0, 50.0, 50.0])


@pytest.fixture(scope="module")
def paper():
    return sk.load("two_dof_spm")


@pytest.fixture(scope="module")
def form(paper):
    """Return the architecture in which base and end effector mirror each other."""
    return sk.mid_plane_form(paper)


def random_reachable_normals(form, count, seed, margin=0.0):
    """Return random normals (count, 3) of mid-planes that all three legs reach.

    The mid-plane mirrors the fixed platform onto the moving one (Chen et al. 2021), so its
    normal determines the pose. A leg has two links of equal arcs (`form.plane.arcs`). Its
    opening angle is that between its axes at both platforms: 0 if it is folded, twice the
    arc if it is stretched. By the rule of section 3 of the paper, driven legs are opened by
    at least 10 degrees. `margin` (rad) is the distance of opening angles from this limit
    and from stretched legs. As in the paper, the angle phi of the mid-plane is positive.
    """
    random = np.random.default_rng(seed)
    # Far more than `count`, because only a part of them is within reach.
    normals = random.normal(size=(100 * count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    # Opposite normals belong to the same plane. The one with positive z is used.
    normals[:, 2] = np.abs(normals[:, 2])
    opening_angles = fold_angles(form.plane, normals)
    # `driven` has the numbers of the two driven legs.
    driven_angles = opening_angles[:, list(form.plane.driven)]
    is_opened = np.all(driven_angles - np.radians(10.0) > margin, axis=1)
    is_within_reach = np.all(2.0 * form.plane.arcs - opening_angles > margin, axis=1)
    # The x component of the normal is -sin(phi / 2).
    has_positive_phi = normals[:, 0] < 0.0
    return normals[is_opened & is_within_reach & has_positive_phi][:count]


@pytest.mark.parametrize("angle", [1e-6, 1e-3, 0.4, 2.0, np.pi - 1e-3, np.pi - 1e-9])
def test_axis_and_angle_of_a_rotation(angle):
    """Axis and angle of a relative rotation are those from which SciPy built it.

    The angle is right to 2e-15 rad. The error of the axis grows with 1 / angle.
    """
    random = np.random.default_rng(3)
    for first_orientation in Rotation.random(20, random_state=3).as_matrix():
        axis = random.normal(size=3)
        axis /= np.linalg.norm(axis)
        rotation = Rotation.from_rotvec(angle * axis).as_matrix()
        found_axis, found_angle = axis_and_angle(
            first_orientation, rotation @ first_orientation
        )
        assert abs(found_angle - angle) < 2e-15
        assert np.linalg.norm(found_axis - axis) < 2e-15 / min(angle, 1.0)
        assert np.max(np.abs(rotation_about_axis(axis, [angle])[0] - rotation)) < 1e-15


def test_mirror_angles_satisfy_the_equations_of_the_paper():
    """The angles phi, gamma and omega of a mid-plane obey eqs. (2) and (5) of the paper.

    A mid-plane is a mirror plane through the centre of the sphere. Its unit normal is
    (-sin(phi / 2), sin(gamma / 2), n_z) with n_z >= 0. The point
    P = (cos phi, sin phi sin omega, sin phi cos omega) is the mirror image of Q = (1, 0, 0)
    (Chen et al. 2021).
    """
    random = np.random.default_rng(4)
    phi = np.radians(random.uniform(1.0, 120.0, 300))
    gamma = np.radians(random.uniform(-60.0, 60.0, 300))
    # Otherwise no unit normal has these components.
    exists = np.sin(phi / 2) ** 2 + np.sin(gamma / 2) ** 2 < 1.0
    phi = phi[exists]
    gamma = gamma[exists]
    normals = normals_of(phi, gamma)
    # The opposite normal belongs to the same plane, so the angles are the same.
    phi_again, gamma_again, omega = mirror_angles(-normals)
    assert np.max(np.abs(phi_again - phi)) < 1e-14
    assert np.max(np.abs(gamma_again - gamma)) < 1e-14
    sine_by_eq5 = np.sin(gamma / 2) / np.cos(phi / 2)
    assert np.sin(omega) == pytest.approx(sine_by_eq5, abs=1e-13)
    mirror_image = np.array([1.0, 0.0, 0.0]) - 2.0 * normals[:, :1] * normals
    expected = np.stack(
        [np.cos(phi), np.sin(phi) * np.sin(omega), np.sin(phi) * np.cos(omega)], axis=1
    )
    assert np.max(np.abs(mirror_image - expected)) < 1e-14


def test_a_mirror_through_the_z_axis_exists_in_spite_of_rounding():
    """If phi and gamma add up to 180 deg, the normal of the mirror has n_z = 0."""
    phi_deg = np.arange(-180.0, 181.0)
    phi = np.radians(phi_deg)
    for sign in (1.0, -1.0):
        gamma = np.radians(sign * (180.0 - np.abs(phi_deg)))
        normals = normals_of(phi, gamma)
        assert np.max(np.abs(normals[:, 0] + np.sin(phi / 2))) < 1e-15
        assert np.max(np.abs(normals[:, 1] - np.sin(gamma / 2))) < 1e-15
        assert np.max(np.abs(normals[:, 2])) < 1e-7
    # One millionth of a degree more is no rounding error.
    assert np.isnan(normals_of(np.radians([60.0]), np.radians([120.000001]))).all()


def test_omega_is_at_most_a_right_angle_for_negative_zeros():
    normals = np.array([[1.0, 0.0, -0.0], [-1.0, -0.0, -0.0], [0.0, -1.0, -0.0]])
    _, _, omega = mirror_angles(normals)
    assert omega.tolist() == [0.0, 0.0, -np.pi / 2]


@pytest.mark.parametrize("angle", [np.nan, np.inf])
def test_angles_of_a_mirror_that_are_not_finite_are_refused(angle):
    with pytest.raises(SolveError, match="give two finite angles"):
        normal_at(0.1, angle)


# Chen et al. 2021, Table 1: initial configuration, then tiny inputs and the column of the
# CAD model (degrees; the last in thousandths). The sign of gamma at (14, 23) is printed
# without its minus.
TABLE_1 = {
    (14.0, 23.0): (
        (59.0786, -4.7420),
        ((0.001, 0.002), (3.4417, -0.3505)),
        ((-0.003, 0.004), (0.8857, -3.6368)),
    ),
    (31.0, 12.0): (
        (64.9472, 9.2984),
        ((0.001, -0.002), (-1.2617, 1.6108)),
        ((-0.003, 0.004), (1.6035, -3.5913)),
    ),
}


def pose_at(form, inputs):
    """Return phi and gamma (deg) of the mid-plane at the driving angles (deg)."""
    (normal,) = form.plane.normals(np.radians([inputs]))
    return np.degrees(mirror_angles(normal)[:2])


@pytest.mark.parametrize("initial_inputs", TABLE_1)
def test_poses_of_table_1(form, initial_inputs):
    """Poses and their changes by tiny inputs are those of a CAD model, to all digits.

    They are printed in Chen et al. 2021, Table 1: poses in degrees, changes in thousandths
    of a degree.
    """
    printed_pose, *rows = TABLE_1[initial_inputs]
    pose = pose_at(form, initial_inputs)
    assert pose == pytest.approx(printed_pose, abs=5.1e-5)
    for input_change, printed_change in rows:
        changed_pose = pose_at(form, np.add(initial_inputs, input_change))
        change = 1e3 * (changed_pose - pose)
        assert change == pytest.approx(printed_change, abs=5.1e-5)


def test_four_sets_of_driving_angles_lead_to_one_pose(form):
    """Each pose has four sets of driving angles (Chen et al. 2021, Fig. 5).

    Base and end effector mirror each other in a mid-plane, so the normal of this plane
    determines the pose. The elbow of a leg is the axis between its two links. By eqs. (12)
    and (13), sin(theta) of a driving angle theta is the z component of the elbow, divided
    by the sine of the arc of the driving link. The z axis is perpendicular to the base axes
    of the driven legs. It is also tested that the angle between each elbow and the base
    axis of its leg is the arc of the driving link. The fixture `form` has the geometry of
    the mechanism in the paper.
    """
    normals = random_reachable_normals(form, count=50, seed=6)
    solutions = form.plane.solutions(normals)
    assert len(solutions) == 4
    # A leg has two possible elbows, which a sign (1 or -1) distinguishes. The solutions are
    # listed by the signs of the first two legs, which are driven.
    for driven_signs, inputs in solutions.items():
        assert np.max(np.abs(form.plane.normals(inputs) - normals)) < 1e-13
        assert np.all(form.plane.modes(inputs) == driven_signs)
        third_leg_sign = 1  # either sign is possible
        elbows, _ = form.plane.elbows(normals, (*driven_signs, third_leg_sign))
        sines = elbows[:, :2, 2] / np.sin(form.plane.arcs[:2])
        assert np.max(np.abs(np.sin(inputs) - sines)) < 1e-14
        arc_cosines = np.vecdot(elbows, form.plane.axes)
        assert np.max(np.abs(arc_cosines - np.cos(form.plane.arcs))) < 1e-15


def test_mid_plane_form_satisfies_the_loop_closure_of_all_links(paper, form):
    """Positions by mirroring in the mid-plane close all loops of the 11 links.

    Base and end effector of the paper's mechanism mirror each other in this plane. Its
    normal and a sign for each of three legs determine a configuration. The sign selects one
    of two elbows of a leg. The third leg is tested with both signs; the signs -1 and 1 of
    the two driven legs are an example.

    The reference is Newton's method on the loop closure of all 14 pairs, which does not use
    mid-planes. The passive pair angles start up to 1e-4 rad away. `form` computes by
    mid-planes.
    """
    assert (len(paper.links), len(paper.pairs)) == (11, 14)
    # `proof` tests the mirror symmetry in many configurations. It returns the largest angle
    # between the axes of a pair in its two links, and the number of degrees of freedom.
    axis_gap, freedoms = form.proof()
    assert freedoms == 2
    assert axis_gap < 1e-14
    # Mid-planes that all legs reach, at least 1 degree from the limits of their reach.
    normals = random_reachable_normals(form, count=60, seed=1, margin=np.radians(1.0))
    closure = PositionAnalysis(paper, samples=2).solver.closure
    frames = revolute_frames(paper)
    driven = driven_variables(form)  # columns of the two inputs among the 14 pair angles
    passive = [variable for variable in range(14) if variable not in driven]
    driven_signs = (-1, 1)
    for third_leg_sign in (1, -1):
        signs = (*driven_signs, third_leg_sign)
        # Orientations of all links by mirroring, and (normals, 14) the pair angles that
        # follow from them.
        rotations = form.place(normals, signs)
        values, _ = form.values(rotations)
        assert closure_gap(paper, rotations, frames) < 1e-14
        assert np.max(np.abs(closure.linearise(values).residual)) < 1e-13

        start = values.copy()
        start[:, passive] += np.random.default_rng(2).uniform(-1e-4, 1e-4, (len(start), 12))
        # Near a singularity, where the determinant is 0, rounding errors are enlarged.
        is_regular = singularity_determinant(form, normals, signs) > 3e-3
        solved = closure.solve(start[is_regular], driven)
        assert np.max(solved.closure_residual) < 1e-14
        assert np.max(np.abs(solved.values - values[is_regular])) < 1e-11
        effector_rotations = closure.linearise(solved.values).rotations[:, form.effector]
        expected = form.orientations(normals[is_regular])
        assert np.max(np.abs(effector_rotations - expected)) < 1e-11
        # The closed form of the paper gives the inputs by the signs of the driven legs.
        inputs_by_signs = form.plane.solutions(normals)
        driving_angles = inputs_by_signs[driven_signs]
        assert np.max(np.abs(values[:, driven] - driving_angles)) < 1e-14


def singularity_determinant(form, normals, modes):
    """Return |det| of the plane normals of the three legs (n,).

    Each normal is base axis x elbow. The determinant is 0 where the planes of all legs meet
    in one line, at a type II singularity.
    """
    elbows, _ = form.plane.elbows(normals, modes)
    axes = np.broadcast_to(form.plane.axes, elbows.shape)
    return np.abs(np.linalg.det(cross(axes, elbows)))


@pytest.mark.slow
def test_any_symmetric_arcs_have_the_form():
    """Random mechanisms with mid-plane symmetric arcs (deg) are recognised, with their
    arcs.
    """
    random = np.random.default_rng(12)
    for _ in range(6):
        a, b, c, d = np.radians(random.uniform([40, 30, 30, 40], [110, 85, 85, 100]))
        mechanism = mid_plane_mechanism([a, b, b, a, c, c, d, d])
        form = sk.mid_plane_form(mechanism)
        assert form.proof()[1] == 2 and form.proof()[0] < 1e-14
        assert form.plane.arcs == pytest.approx([b, c, d], abs=1e-15)


@pytest.mark.parametrize("pairs", [12, pytest.param(1000, marks=pytest.mark.long)])
def test_axis_stays_fixed_between_random_pairs_of_poses(form, pairs):
    """Between two poses the end effector turns about an axis that moves by less than 1e-12.

    The mechanism is that of Chen et al. 2021 (`form`). Its base and end effector mirror
    each other in a plane, so the normal of this plane determines the pose. The axis is
    fixed in the base and in the end effector. Its coordinates in the end effector follow
    from those in the base and the orientation at each sample. Between two random poses, a
    leg may be unable to follow. More than 90 % of all rotations must reach their last pose.
    """
    starts = random_reachable_normals(form, pairs, 21)
    stops = random_reachable_normals(form, pairs, 22)
    reached = 0
    for start, stop in zip(starts, stops, strict=True):
        # `OUTWARD` are signs of the legs: the driven links point outward (Fig. 5(a)).
        rotation = form.rotation_between(start, stop, OUTWARD)
        rows = rotation.at(np.linspace(0.0, rotation.angle, 7))
        is_valid = rows.status == sk.Status.OK
        reached += np.all(is_valid)
        assert is_valid[0]
        # `end` is the status at which the rotation ends: OK if it reaches the last pose.
        assert is_valid[-1] == (rotation.end == sk.Status.OK)
        if not is_valid[-1]:
            continue
        # `drift` is the angle (rad) from the momentary axis to the fixed axis.
        assert np.max(rows.drift[is_valid]) < 1e-12
        assert np.max(rows.orientation_error[is_valid]) < 1e-12
        # Each orientation matrix leads from the end effector to the base. Its transpose
        # takes the axis into the end effector.
        axis_in_effector = np.vecmat(rotation.axis, rows.orientation[is_valid])
        axis_shift = np.linalg.norm(axis_in_effector - axis_in_effector[0], axis=1)
        assert np.max(axis_shift) < 1e-12
        (last_orientation,) = form.orientations(stop[None])
        assert np.max(np.abs(rows.orientation[-1] - last_orientation)) < 1e-13
    assert reached > 0.9 * pairs


def statuses_with_one_singular(count, singular):
    """Return a list of OK statuses, with AT_SINGULARITY at one index."""
    status = [sk.Status.OK] * count
    status[singular] = sk.Status.AT_SINGULARITY
    return status


def test_a_rotation_passes_the_home_pose_in_which_all_legs_are_folded(form):
    """A rotation from phi = 30 to -30 deg passes phi = 0, a type II singularity.

    Base and end effector of the mechanism of Chen et al. 2021 are mirror images of each
    other in the mid-plane. Two angles phi and gamma state this plane: its normal has the
    first two components -sin(phi / 2) and sin(gamma / 2). At phi = 0 all legs are folded,
    and the loops do not determine the motion. The mid-plane does: phi changes linearly with
    the angle of rotation, and rates stay finite. The computation steps over the singular
    configuration, and lists its angle of rotation in `leaps`.
    """
    # phi and gamma (deg) at the start and at the end.
    rotation = rotate(30.0, 0.0, -30.0, 0.0)
    half_angle = 0.5 * rotation.angle
    rows = rotation.at(np.linspace(0.0, rotation.angle, 21))
    home = rotation.at([half_angle])
    assert np.max(np.abs(home.inputs)) < 1e-12
    normals, _ = form.normals(rows.orientation)
    phi, gamma, _ = mirror_angles(normals)
    assert np.max(np.abs(phi - np.linspace(np.pi / 6, -np.pi / 6, 21))) < 1e-14
    assert np.max(np.abs(gamma)) < 1e-14
    assert rows.status.tolist() == statuses_with_one_singular(21, 10)
    assert rows.type_2[10] < 1e-13  # a measure that is zero at a type II singularity
    assert rotation.end == sk.Status.OK
    assert np.all(np.isfinite(rows.second_rates))
    assert rotation.leaps == pytest.approx([half_angle], abs=1e-9)
    assert np.max(rows.orientation_error) < 1e-12


def configuration(name):
    """Return a mechanism and the joint angles of mode 0 in the middle of its grid."""
    mechanism = sk.load(name)
    motion = sk.trace(mechanism, samples=[3] * len(mechanism.inputs))
    is_valid = (motion.status == sk.Status.OK) & (motion.assembly_mode == 0)
    rows = np.flatnonzero(is_valid)
    return mechanism, motion.values[rows[len(rows) // 2]]


def derivative_at_middle(samples, h):
    """Return the derivative at the middle of five samples with step h, to order h^4."""
    return (samples[0] - 8 * samples[1] + 8 * samples[3] - samples[4]) / (12 * h)


def check_rates_by_differences(rotation, theta, rate_tolerance, second_tolerance):
    """Assert that rates of the inputs at an angle theta (rad) are finite differences.

    Parameters
    ----------
    rotation
        A rotation of an output link about a fixed axis, which is sampled at angles theta.
    theta
        The angle.
    rate_tolerance
        Relative tolerance of the rates dq/dtheta.
    second_tolerance
        Tolerance of the second rates d2q/dtheta2. It is relative to the largest second rate
        or to 1, whichever is larger. None if the rotation has no second rates.

    Returns
    -------
    rows
        Five samples of the rotation around theta.
    """
    h = 1e-3  # rad
    rows = rotation.at(theta + h * np.arange(-2, 3))
    rates = derivative_at_middle(rows.inputs, h)
    assert rates == pytest.approx(rows.rates[2], rel=rate_tolerance)
    if second_tolerance is not None:
        error = derivative_at_middle(rows.rates, h) - rows.second_rates[2]
        size = max(1.0, np.max(np.abs(rows.second_rates[2])))
        assert np.max(np.abs(error)) < second_tolerance * size
    return rows


@pytest.mark.parametrize("name", ["three_rrr", "agile_eye"])
def test_three_inputs_turn_the_output_about_any_axis(name):
    """With three inputs the output turns exactly about axes that were chosen freely.

    The expected orientation is that of the start, turned by Rodrigues' formula. The test
    asks for a rotation by 0.3 rad; the mechanism may reach less (`reached`). At each moment
    the output turns about some axis. The drift is the angle between this axis and the
    chosen one.
    """
    mechanism, values = configuration(name)
    closure = Closure.of_mechanism(mechanism, make_joints(mechanism))
    output = mechanism.link_number[mechanism.outputs[0].link]
    start = closure.linearise(values[None]).rotations[0, output]
    for axis in ([0.4, -1.0, 0.3], [1.0, 0.2, -0.5]):
        rotation = sk.follow_rotation(mechanism, values, axis, 0.3)
        theta = np.linspace(0.0, min(0.3, rotation.reached), 9)
        rows = rotation.at(theta)
        assert np.all(rows.status == sk.Status.OK)
        closed = closure.linearise(rows.values)
        expected = rotation_about_axis(rotation.axis, theta) @ start
        assert np.max(closed.closure_residual) < 1e-13
        assert np.max(np.abs(closed.rotations[:, output] - expected)) < 1e-12
        assert np.max(rows.orientation_error) < 1e-13
        assert np.max(rows.drift) < 1e-12
        check_rates_by_differences(
            rotation, 0.5 * theta[-1], rate_tolerance=1e-8, second_tolerance=1e-7
        )


def test_two_inputs_follow_an_axis_with_the_least_orientation_error():
    """The output of a five-bar follows a rotation about an axis as nearly as possible.

    With two inputs, its three-parameter orientation cannot follow exactly. The orientation
    error is the angle between the wanted and the real orientation. `follow_rotation` must
    find the inputs with the least error.

    For comparison, the error is computed for a mesh of 3 x 3 inputs, 2e-4 rad apart, around
    the inputs that it finds. The positions are those of a closed form (`sk.trace`). The
    error in the middle must be the smallest. A plane that is fitted to the squares of the
    nine errors must be level, so that their gradient is 0. The rates of the inputs are
    compared with finite differences.
    """
    mechanism, values = configuration("five_bar")
    output = mechanism.link_number["3"]
    rotation = sk.follow_rotation(mechanism, values, [0.35, 0.82, 0.33], 0.6)
    theta = np.array([0.0, 0.3, 0.6])
    rows = rotation.at(theta)
    assert np.all(rows.status == sk.Status.OK)
    assert rows.orientation_error[0] < 1e-14
    assert rows.orientation_error[2] > 0.1
    closure = Closure.of_mechanism(mechanism, make_joints(mechanism))
    start = closure.linearise(values[None]).rotations[0, output]
    wanted = rotation_about_axis(rotation.axis, theta) @ start
    mesh = 2e-4 * np.array(list(product((-1, 0, 1), repeat=2)))
    middle = 4
    for k in (1, 2):
        motion = sk.trace(mechanism, path=rows.inputs[k] + mesh)
        # The rotation starts in a configuration of assembly mode 0, and stays in this mode.
        orientations = motion.rotations[motion.assembly_mode == 0, output]
        errors = angles_between(orientations, wanted[k])
        assert np.argmin(errors) == middle
        assert errors[middle] == pytest.approx(rows.orientation_error[k], abs=1e-13)
        plane = np.column_stack([np.ones(9), mesh])
        gradient = np.linalg.lstsq(plane, errors**2, rcond=None)[0][1:]
        assert np.max(np.abs(gradient)) < 1e-6  # rad^2 per rad
    check_rates_by_differences(rotation, 0.3, rate_tolerance=1e-9, second_tolerance=1e-9)
    # Second rates at the start, by one-sided differences of fourth order
    h = 1e-3
    first_rows = rotation.at(h * np.arange(5))
    weights = np.array([-25.0, 48.0, -36.0, 16.0, -3.0]) / (12.0 * h)
    second_rates = weights @ first_rows.rates
    assert second_rates == pytest.approx(first_rows.second_rates[0], abs=1e-8)


def wrist():
    """Return an open chain of three R pairs, Euler angles z, y, z of its last link."""
    axes = {"a": (0.0, 0.0, 1.0), "b": (0.0, 1.0, 0.0), "c": (0.0, 0.0, 1.0)}
    return sk.Mechanism(
        "wrist",
        "link0",
        ("link0", "link1", "link2", "link3"),
        tuple(Pair(name, "R", (f"link{k}", f"link{k + 1}")) for k, name in enumerate(axes)),
        PoseGeometry(axes),
        inputs=tuple(Input(name, 0.0, 1.0) for name in axes),
        outputs=(Output("tool", "link3", "link0"),),
    )


def test_an_open_wrist_turns_by_its_euler_angles():
    """The inputs of a wrist that turns about a fixed axis are Euler angles z, y, z.

    The orientations are products of elementary rotations; the angles are read from them
    by the usual formulas.
    """
    start = np.array([0.3, 0.7, 0.2])  # rad
    rotation = sk.follow_rotation(wrist(), start, [1.0, 0.3, 0.2], 1.5)
    rows = rotation.at(np.linspace(0.0, 1.5, 31))
    assert np.all(rows.status == sk.Status.OK)
    z = np.array([0.0, 0.0, 1.0])
    y = np.array([0.0, 1.0, 0.0])
    start_orientation = np.eye(3)
    for axis, angle in zip((z, y, z), start, strict=True):
        start_orientation = start_orientation @ rotation_about_axis(axis, [angle])[0]
    r = rotation_about_axis(rotation.axis, rows.theta) @ start_orientation
    azimuth = np.arctan2(r[:, 1, 2], r[:, 0, 2])
    tilt = np.arctan2(np.hypot(r[:, 0, 2], r[:, 1, 2]), r[:, 2, 2])
    spin = np.arctan2(r[:, 2, 1], -r[:, 2, 0])
    euler_angles = np.stack([azimuth, tilt, spin], axis=1)
    differences = np.exp(1j * rows.inputs) - np.exp(1j * euler_angles)
    assert np.max(np.abs(differences)) < 1e-12


def test_a_wrist_passes_its_gimbal_pose():
    """A wrist turns about the axis of its middle pair through its gimbal pose.

    The angle b of the middle pair is 0 there, and the first and last pairs, a and c, have
    one axis (a singularity). By hand: b falls from 0.5 rad with rate -1, and a and c stand
    still. The singular configuration, at theta = 0.5 rad, is stepped over (a leap).
    """
    a = 0.3  # rad
    # The opposite direction of the axis of b, so that b falls.
    negative_axis_of_b = [np.sin(a), -np.cos(a), 0.0]
    rotation = sk.follow_rotation(wrist(), [a, 0.5, 0.2], negative_axis_of_b, 0.9)
    assert rotation.end == sk.Status.OK
    assert rotation.leaps == pytest.approx([0.5], abs=1e-9)
    rows = rotation.at([0.0, 0.2, 0.5, 0.7, 0.9])
    assert rows.inputs[:, 1] == pytest.approx(0.5 - rows.theta, abs=1e-12)
    assert np.max(np.abs(rows.inputs[:, [0, 2]] - [0.3, 0.2])) < 1e-11
    assert rows.rates == pytest.approx(np.tile([0.0, -1.0, 0.0], (5, 1)), abs=1e-11)
    assert rows.status.tolist() == statuses_with_one_singular(5, 2)
    # The inputs determine the output in the gimbal pose, so it is no crossing of type II.
    assert rows.type_2 == pytest.approx(np.ones(5), abs=1e-15)
    assert rotation.crossings == ()


def test_leaps_outside_a_rotation_are_no_crossings(form):
    """A singular configuration before the start of a rotation is not one of its crossings.

    The mechanism of the paper starts with all legs folded, a singularity of type II. A
    path is followed from 0.02 rad before to 0.5 rad after this configuration. Its second
    part is followed as a rotation of its own, with a lead.
    """
    rotation = rotate(0, 0, 60, 0)
    assert rotation.crossings == pytest.approx([0.0], abs=1e-12)
    (first_values,) = rotation.nodes.values[:1]
    lead = 0.1 - rotation.nodes.theta[0]
    later = sk.follow_rotation(
        form.mechanism, first_values, rotation.axis, 0.4, form.output.name, lead
    )
    assert later.end == sk.Status.OK
    assert later.leaps == pytest.approx([-0.1], abs=1e-9)
    assert later.crossings == ()


def test_a_rotation_does_not_start_where_loops_do_not_close(paper):
    """At a singularity of the loops the start cannot be closed and is refused."""
    rotation = rotate(50, 10, 20, -10)
    (values,) = rotation.at(rotation.crossings).values
    with pytest.raises(SolveError, match="the configuration to start from is singular"):
        sk.follow_rotation(paper, values, rotation.axis, 0.1)


def test_a_rotation_from_rounded_values_leads_to_the_stated_orientation(paper):
    """The orientation error at the end is the angle to the orientation that was stated."""
    rotation = rotate(50, 10, 20, -10)
    samples = rotation.at([0.2, 0.3])
    rounded = np.round(samples.values[0], 7)
    found = sk.follow_to(paper, rounded, samples.orientation[1])
    end = found.at([found.angle])
    error = angles_between(end.orientation, samples.orientation[1:])
    assert end.orientation_error == pytest.approx(error, abs=1e-12)


@pytest.mark.parametrize("size", [1e-200, 1e200])
def test_the_length_of_an_axis_does_not_matter(size):
    """Axes whose squared length underflows or overflows are directions as well."""
    assert np.all(four_bar_rotation(axis=(0.0, 0.0, size)).axis == [0.0, 0.0, 1.0])


def test_a_mechanism_with_a_cam_follows_an_axis():
    """The lever of a roller cam turns exactly about its pivot, and nearly about others.

    If the lever cannot turn exactly about an axis, the nearest orientation is followed.
    Rates of the variables by the angle of rotation are compared with finite differences, in
    the middle of rotations by 0.02 rad. The second rates of a nearest orientation are not
    computed and are NaN.
    """
    mechanism = sk.load("roller_cam")
    motion = sk.trace(mechanism, samples=9)
    # A row in the middle of the motion.
    row = int(np.flatnonzero(motion.status == sk.Status.OK)[3])
    pivot = motion.axes[row, mechanism.pair_number["follower_pivot"]]
    angle = 0.02  # rad
    exact = sk.follow_rotation(mechanism, motion.values[row], pivot, angle)
    rows = check_rates_by_differences(
        exact, 0.5 * angle, rate_tolerance=1e-7, second_tolerance=1e-5
    )
    assert np.max(rows.orientation_error) < 1e-13
    tilted_axis = pivot + [0.0, 0.2, 0.1]
    inexact = sk.follow_rotation(mechanism, motion.values[row], tilted_axis, angle)
    rows = check_rates_by_differences(
        inexact, 0.5 * angle, rate_tolerance=1e-7, second_tolerance=None
    )
    assert np.all(rows.orientation_error > 1e-5)
    assert np.all(np.isnan(rows.second_rates))


@dataclass(frozen=True)
class LinearRotation:
    """A stand-in for the rotation of a mechanism's output by the angle theta.

    It is used to test time laws theta(t), for which only the values of the inputs and their
    rates matter.

    Attributes
    ----------
    axis, angle
        (3,) axis of the rotation, and the whole angle (rad).
    inputs
        Names of the input pairs.
    slope
        (inputs,) rates dq/dtheta of the inputs, whose values are q = slope * theta.
    """

    axis: np.ndarray
    angle: float
    inputs: tuple
    slope: np.ndarray

    def at(self, theta):
        """Return a sample of the motion at each angle theta (rad) of the output.

        The inputs are proportional to theta. Tests of time laws use only the inputs and
        their rates. All other numbers are placeholders.
        """
        theta = np.atleast_1d(theta)
        n = len(theta)
        rates = np.tile(self.slope, (n, 1))
        return RotationSamples(
            theta=theta,
            inputs=theta[:, None] * self.slope,
            rates=rates,
            second_rates=np.zeros_like(rates),
            values=np.zeros_like(rates),
            orientation=np.tile(np.eye(3), (n, 1, 1)),
            orientation_error=np.zeros(n),
            drift=np.zeros(n),
            type_2=np.ones(n),
            status=np.full(n, sk.Status.OK, dtype=np.int8),
        )


PEAKS = {
    # shape: largest s' and |s''|, in closed form
    "cycloidal": (2.0, 2.0 * np.pi),
    "cubic": (1.5, 6.0),
    "quintic": (15.0 / 8.0, 10.0 / np.sqrt(3.0)),
    "septic": (35.0 / 16.0, 84.0 * np.sqrt(5.0) / 25.0),
}


@pytest.mark.parametrize("shape", SHAPES)
def test_durations_at_a_limit_are_those_of_closed_forms(shape):
    """The shortest duration of a rotation lets the peak of its time law meet a limit.

    In a rotation of duration T, an input turns by its whole angle times s(t/T), which grows
    from 0 to 1. The function s has several shapes. `PEAKS` has the largest values of s' and
    |s''| in closed form. The largest speed is therefore angle * max s' / T, the largest
    acceleration angle * max |s''| / T^2. The shortest T follows from their limits.

    While the output turns by 0.8 rad, the inputs "a" and "b" turn by 1.2 and -1.6 rad.
    """
    peak_speed, peak_acceleration = PEAKS[shape]
    angle_of_b = 1.6
    # Input "b" has the larger angle and the smaller limit, so it decides the duration.
    # `binding` is the peak that meets its limit.
    by_speed = linear_rotation_in_time(speed=[1.0, 0.5], shape=shape)
    assert by_speed.duration == pytest.approx(peak_speed * angle_of_b / 0.5, rel=1e-12)
    assert by_speed.binding.input == "b"
    assert by_speed.binding.value == pytest.approx(-0.5, rel=1e-12)
    by_acceleration = linear_rotation_in_time(acceleration=2.0, shape=shape)
    squared_duration = by_acceleration.duration**2
    expected_square = peak_acceleration * angle_of_b / 2.0
    assert squared_duration == pytest.approx(expected_square, rel=1e-12)
    assert by_acceleration.binding.quantity == "acceleration"
    table = by_acceleration.table(11)
    assert table.inputs[-1] == pytest.approx([1.2, -1.6], abs=1e-14)
    assert table.t[-1] == by_acceleration.duration


def rotate(phi, gamma, to_phi, to_gamma):
    """Return the rotation of the paper's mechanism between two mid-planes (in deg)."""
    form = sk.mid_plane_form(sk.load("two_dof_spm"))
    ends = (normal_at(*np.radians(each)) for each in ((phi, gamma), (to_phi, to_gamma)))
    return form.rotation_between(*ends, OUTWARD)


def four_bar_rotation(axis=(0, 0, 1), angle=0.1, spoil=0.0, output=None, lead=0.0):
    """Return a rotation of the four-bar; `spoil` (rad) opens the loop at its start."""
    mechanism = sk.load("four_bar")
    values = sk.trace(mechanism, samples=3).values[1] + spoil * np.arange(4)
    return sk.follow_rotation(mechanism, values, axis, angle, output, lead)


def linear_rotation_in_time(**limits):
    """Return the time-optimal schedule of a linear rotation by 0.8 rad with two inputs."""
    rotation = LinearRotation(np.array([0, 0, 1.0]), 0.8, ("a", "b"), np.array([1.5, -2.0]))
    return time_optimal(rotation, **limits)


@pytest.mark.parametrize("call", TABLES["rotations"])
def test_bad_arguments_of_rotations_are_refused(call):
    """Each call of the table "rotations" of `refusals.toml` raises the stated error."""
    check_call(call, {**globals(), "replace": replace}, TABLES["rotations"][call])


def test_a_base_variable_of_half_a_turn_is_positive(form):
    """The variables of base pairs are in (-pi, pi], whichever link of the pair is first."""
    plane = form.plane
    for sense in (1.0, -1.0):
        signed_plane = replace(plane, phases=np.zeros(3), senses=np.full(3, sense))
        # Elbows at the azimuth pi: opposite to the x axes of the frames.
        x_axes, z_axes = plane.dials[..., 0], plane.dials[..., 2]
        arcs = plane.arcs[:, None]
        elbows = np.cos(arcs) * z_axes - np.sin(arcs) * x_axes
        variables = signed_plane.readings(elbows[None])
        assert np.allclose(np.abs(variables), np.pi, atol=1e-15)
        assert np.all(variables > -np.pi)


def test_no_mid_plane_keeps_a_margin_larger_than_the_reach(form):
    """The nearest mid-plane keeps its margin; without any such plane it is NaN."""
    plane = form.plane
    wanted = normal_at(np.radians(120.0), 0.0)
    least_reach = np.min(plane.reach)
    nearest = plane.nearest(wanted, 0.5 * least_reach)
    heights = np.arcsin(np.abs(plane.axes @ nearest))
    assert np.all(heights <= plane.reach - 0.5 * least_reach + 1e-9)
    for factor in (1.1, 1.5, 2.5, 20.0):
        assert np.all(np.isnan(plane.nearest(wanted, factor * least_reach)))


@pytest.mark.parametrize("arc", [0.0, 60.0, 180.0])
def test_carriers_with_an_elbow_along_or_oblique_to_the_normal_are_refused(arc):
    """Link 9 has an elbow and the normal of the mid-plane, which are at right angles."""
    mechanism = sk.load("two_dof_spm").with_sizes(angle_unit="deg", arcs={"9": arc})
    with pytest.raises(ModelError, match="in link 9, .* not at right angles"):
        sk.mid_plane_form(mechanism)


@pytest.mark.parametrize("beyond", [0.0, 4e-4, 1e-3, 2e-3, 4e-3])
def test_a_rotation_may_end_shortly_behind_a_singular_configuration(beyond):
    """A wrist turns to its gimbal pose, or up to a few mrad beyond it.

    Its middle variable b falls from 0.5 rad with the rate -1, by hand.
    """
    a = 0.3  # rad
    angle = 0.5 + beyond
    rotation = sk.follow_rotation(wrist(), [a, 0.5, 0.2], [np.sin(a), -np.cos(a), 0], angle)
    assert rotation.end == sk.Status.OK
    assert rotation.reached == angle
    assert rotation.at([angle]).inputs[0, 1] == pytest.approx(-beyond, abs=1e-11)


def test_an_output_that_stands_still_is_followed_to_the_end():
    """A target that turns about a line across the axis of a rocker leaves it where it is.

    The rotations about two perpendicular axes differ by an angle whose cosine of the half
    is cos(rocker / 2) cos(target / 2), which is largest if the rocker does not turn.
    """
    mechanism = sk.load("four_bar")
    motion = sk.trace(mechanism, samples=3)
    pivot = motion.axes[1, mechanism.pair_number["41"]]
    across = np.cross(pivot, [0.3, 0.5, 0.1])
    rotation = sk.follow_rotation(mechanism, motion.values[1], across, 2.0)
    assert rotation.end == sk.Status.OK
    rows = rotation.at([0.0, 1.0, 2.0])
    assert rows.inputs == pytest.approx(np.full((3, 1), rows.inputs[0, 0]), abs=1e-12)
    assert rows.orientation_error == pytest.approx(rows.theta, abs=1e-12)
    with pytest.raises(SolveError, match="limit an input that moves"):
        time_optimal(rotation, speed=1.0)


def test_a_singular_node_has_the_condition_zero():
    """At the gimbal pose of a wrist the equations do not determine the links."""
    rotation = sk.follow_rotation(wrist(), [0.3, 0.5, 0.2], [1.0, 0.0, 0.0], 0.1)
    gimbal_pose = rotation.output_link.compare(np.array([[0.3, 0.0, 0.2]]), np.eye(3)[None])
    assert rotation.make_nodes(np.zeros(1), gimbal_pose).condition == [0.0]


def test_schedules_limited_by_inputs_that_stand_still_are_refused():
    """A wrist turns about its first axis: only "a" moves, so limits of "b" are no limits.

    With a linear law "a" has no acceleration either.
    """
    rotation = sk.follow_rotation(wrist(), [0.3, 0.5, 0.2], [0, 0, 1], 0.5)
    with pytest.raises(SolveError, match="limit an input that moves"):
        time_optimal(rotation, speed=[np.inf, 1.0, np.inf])
    linear_law = sk.Polynomial((0.0, 1.0))
    with pytest.raises(SolveError, match="limit an input that moves"):
        time_optimal(rotation, acceleration=1.0, shape=linear_law)
    by_speed = time_optimal(rotation, speed=[0.25, 1.0, 1.0], shape=linear_law)
    assert by_speed.duration == pytest.approx(0.5 / 0.25, rel=1e-12)


def test_a_schedule_without_known_accelerations_names_the_contact_pairs():
    """A cam follower that cannot turn exactly about an axis has no second rates."""
    mechanism = sk.load("roller_cam")
    motion = sk.trace(mechanism, samples=9)
    row = int(np.flatnonzero(motion.status == sk.Status.OK)[3])
    pivot = motion.axes[row, mechanism.pair_number["follower_pivot"]]
    tilted_axis = pivot + [0.0, 0.2, 0.1]
    rotation = sk.follow_rotation(mechanism, motion.values[row], tilted_axis, 0.02)
    with pytest.raises(SolveError, match="the accelerations of the inputs are not known"):
        time_optimal(rotation, speed=1.0)
