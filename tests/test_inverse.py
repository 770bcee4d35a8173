"""Inverse and forward kinematics of outputs, against second formulations."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from helpers.refusals import TABLES, check_call
from mechanism_examples.named_mechanisms import (
    platform_with_unlike_legs,
    posed_three_rrr,
    serial_chain,
)
from scipy.spatial.transform import Rotation

import spherekit as sk
from spherekit.errors import FileError, PlanError
from spherekit.files.mechanism_reader import loads
from spherekit.files.mechanism_writer import dumps
from spherekit.geometry.tilt_torsion import (
    azimuth_tilt,
    euler_zyz,
    from_euler_zyz,
    from_tilt_torsion,
    pointing,
    tilt_torsion,
)
from spherekit.geometry.triangle import arc
from spherekit.mechanism.elements import Output
from spherekit.mechanism.joint_construction import make_joints
from spherekit.outputs.closing_link import find_closing_link, merge_equal_turns
from spherekit.outputs.forward_kinematics import ForwardKinematics, output_rates
from spherekit.outputs.virtual_output import with_wrist
from spherekit.positions.assembly_mode import AssemblyMode
from spherekit.status import Status

SHIPPED = ("three_rrr", "agile_eye", "five_bar")


def test_turns_that_differ_by_a_revolution_are_one_solution():
    """A turn of pi that was also found as nearly -pi is one solution of its direction."""
    rows = np.array([0, 0, 0, 1, 2, 2])
    turns = np.array([np.pi, 0.5, -np.pi + 1e-9, np.pi, -np.pi + 1e-3, np.pi])
    kept_rows, kept_turns = merge_equal_turns(rows, turns)
    assert kept_rows.tolist() == [0, 0, 1, 2, 2]
    expected = [-np.pi + 1e-9, 0.5, np.pi, -np.pi + 1e-3, np.pi]
    assert np.array_equal(kept_turns, expected)
    # a root that is bracketed twice at pi and once at -pi
    _, merged = merge_equal_turns(
        np.zeros(3, dtype=int), np.array([-np.pi + 1e-9, np.pi - 2e-9, np.pi - 1e-9])
    )
    assert merged.tolist() == [-np.pi + 1e-9]
    no_rows, no_turns = merge_equal_turns(np.array([], dtype=int), np.array([]))
    assert len(no_rows) == len(no_turns) == 0


def random_rotations(count, seed):
    return Rotation.random(count, random_state=seed).as_matrix()


def random_poses(kinematics, count, seed):
    """Return random directions (count, 3), or rotations (count, 3, 3) if the output turns
    freely.
    """
    rotations = random_rotations(count, seed)
    return rotations[:, :, 2] if kinematics.wrist.points else rotations


MECHANISMS = {
    **{name: lambda name=name: sk.load(name) for name in SHIPPED},
    "unlike_legs": platform_with_unlike_legs,
    "serial_3": lambda: serial_chain(3),
    "serial_2": lambda: serial_chain(2),
    "posed": posed_three_rrr,
}


@pytest.fixture(params=MECHANISMS)
def mechanism(request):
    return MECHANISMS[request.param]()


def test_tilt_and_torsion_and_euler_angles_lead_back():
    """Angles of a rotation give the rotation again, also in singular cases.

    Tilt and torsion, and Euler angles z-y-z, are tried. Of 500 random rotations 100 are
    replaced by turns about z, 100 have the tilt pi, and 10 are the identity. There the
    angles are not unique.
    """
    rotations = random_rotations(500, 1)
    # An entry of each random matrix is used as the angle about z.
    angles_about_z = rotations[:100, 0, 2]
    rotation_vectors = angles_about_z[:, None] * [0, 0, 1]
    rotations[:100] = Rotation.from_rotvec(rotation_vectors).as_matrix()
    rotations[100:200] = Rotation.from_euler("ZY", [[0.3, np.pi]] * 100).as_matrix()
    rotations[200:210] = np.eye(3)
    for to_angles, from_angles in (
        (tilt_torsion, from_tilt_torsion),
        (euler_zyz, from_euler_zyz),
    ):
        angles = to_angles(rotations)
        assert np.max(np.abs(from_angles(angles) - rotations)) < 4e-15
        tilts = angles[:, 1]
        assert np.all((tilts >= 0.0) & (tilts <= np.pi))
    directions = rotations[:, :, 2]
    assert np.max(np.abs(pointing(azimuth_tilt(directions)) - directions)) < 1e-15


def test_tilt_and_torsion_are_euler_angles_of_scipy():
    """Azimuth a, tilt t and torsion s are the Euler angles z-y-z a, t, s - a."""
    angles = np.array([[0.7, 0.4, -0.2]])
    rotation = Rotation.from_euler("ZYZ", [[0.7, 0.4, -0.9]]).as_matrix()
    assert np.allclose(from_tilt_torsion(angles), rotation, atol=1e-15)
    assert np.allclose(tilt_torsion(rotation), angles, atol=1e-15)


def test_inputs_agree_with_the_positions_of_all_links(mechanism):
    """Inputs by inverse kinematics agree with the positions of all links, in every mode.

    Inverse kinematics computes inputs for a pose of the output in closed form. The
    reference is a position solver that places all links. For this solver, virtual pairs
    from the base to the output drive the output into the pose. Their angles are azimuth and
    tilt if the pose is a direction, otherwise Euler angles z-y-z.

    A working mode has one sign per leg. `type_1` is the distance of a leg from its dead
    centre (0 to 1). Errors grow with 1 / type_1.
    """
    kinematics = sk.InverseKinematics(mechanism)
    poses = random_poses(kinematics, 60, 3)
    poses_are_directions = kinematics.wrist.points
    if poses_are_directions:
        virtual_angles = azimuth_tilt(poses)
    else:
        virtual_angles = euler_zyz(poses)
    inverse = kinematics.at(poses)
    assert len(inverse.modes) == 2 ** len(kinematics.legs)
    for k, signs in enumerate(inverse.modes):
        # The mode is selected by its signs; 0 is its number.
        positions = kinematics.solver.evaluate(AssemblyMode(0, signs), virtual_angles)
        assert np.array_equal(positions.status, inverse.status[k])
        differences = positions.values[:, kinematics.driven] - inverse.inputs[k]
        is_valid = inverse.status[k] == Status.OK
        # Angles that differ by whole turns are the same.
        differences = np.abs(np.angle(np.exp(1j * differences[is_valid])))
        assert np.max(differences * inverse.type_1[k][is_valid], initial=0.0) < 2e-13
        assert np.all(np.isnan(inverse.inputs[k][~is_valid]))


def test_inverse_kinematics_can_be_sent_to_other_processes_after_use():
    kinematics = sk.InverseKinematics("three_rrr")
    poses = random_poses(kinematics, 5, 3)
    inverse = kinematics.at(poses)
    copy = pickle.loads(pickle.dumps(kinematics))
    assert np.array_equal(copy.at(poses).inputs, inverse.inputs, equal_nan=True)


def pair_frames(mechanism):
    """Return the frames (3, 3) of each pair in its first and second link, by name."""
    joints = make_joints(mechanism)
    return {
        p.name: (j.first, j.second) for p, j in zip(mechanism.pairs, joints, strict=True)
    }


def test_the_margin_of_a_three_legged_wrist_is_that_of_its_nearest_leg():
    """The margin of a pose is the least distance (rad) of a leg from its limit of reach.

    The reference is the triangle inequality on the sphere. The arc between the ends of a
    leg is between |crank - coupler| (folded) and the smaller of crank + coupler (stretched)
    and 2 pi minus that. The margin is negative if the pose is out of the reach of a leg.
    """
    mechanism = sk.load("three_rrr")
    poses = random_rotations(500, 10)
    inverse = sk.InverseKinematics(mechanism).at(poses)
    frames = pair_frames(mechanism)
    sizes = mechanism.geometry.links
    leg_margins = []
    for leg in "123":
        # The axis of pair a in its first link, the ground, and that of pair c in its second
        # link, the platform.
        ground_axis = frames[f"a{leg}"][0][:, 2]
        platform_axis = poses @ frames[f"c{leg}"][1][:, 2]
        span = arc(ground_axis, platform_axis)
        crank = sizes[f"crank{leg}"].arcs[0]
        coupler = sizes[f"coupler{leg}"].arcs[0]
        largest = min(crank + coupler, 2 * np.pi - crank - coupler)
        leg_margins.append(np.minimum(span - abs(crank - coupler), largest - span))
    assert np.max(np.abs(inverse.margin - np.min(leg_margins, axis=0))) < 1e-14


@pytest.fixture(scope="module")
def wrist_in_random_poses():
    """Return the wrist `three_rrr`, 500 poses (500, 3, 3), and its inverse kinematics."""
    mechanism = sk.load("three_rrr")
    poses = random_rotations(500, 10)
    return mechanism, poses, sk.InverseKinematics(mechanism).at(poses, normals=True)


def base_axis(mechanism, leg):
    """Return the axis (3,) of the input pair of a leg, in ground axes."""
    first_frame, _ = pair_frames(mechanism)[f"a{leg}"]
    return first_frame[:, 2]


def normals_of_leg_planes(mechanism, leg, poses, angles):
    """Return the unit normals (n, 3) of the plane of the coupler of a leg.

    A leg has a crank on the base and a coupler on the platform. The plane contains both
    axes of the coupler: that to the crank (pair b) and that to the platform (pair c). The
    normal is along their vector product, b x c.

    Parameters
    ----------
    mechanism
        The wrist `three_rrr`, a platform on three legs.
    leg
        "1", "2" or "3".
    poses, angles
        (n, 3, 3) orientations of the platform, and angles (n,) of the crank in rad.
    """
    frames = pair_frames(mechanism)  # by pair: its frames in its first and second link
    ground_frame, crank_frame = frames[f"a{leg}"]
    rotations_about_base_axis = Rotation.from_euler("z", angles[:, None]).as_matrix()
    crank_orientation = ground_frame @ rotations_about_base_axis @ crank_frame.T
    # Column 2 of a frame is the axis of the pair.
    b_in_crank, _ = frames[f"b{leg}"]
    axis_b = crank_orientation @ b_in_crank[:, 2]
    _, c_in_platform = frames[f"c{leg}"]
    axis_c = poses @ c_in_platform[:, 2]
    normals = np.cross(axis_b, axis_c)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


@pytest.mark.parametrize("leg", "123")
@pytest.mark.parametrize("mode", range(8))
def test_the_type_i_measure_is_the_sine_between_base_axis_and_leg_plane(
    mode, leg, wrist_in_random_poses
):
    """The measure of type I of a leg is the sine between its base axis and a plane.

    This plane contains both axes of the coupler, which joins the crank to the platform. A
    leg is at a dead centre (type I) where its base axis lies in this plane.
    `wrist_in_random_poses` has a wrist, poses and their inverse kinematics. The normal of
    the plane that inverse kinematics returns must point to the side of the base axis.
    """
    mechanism, poses, inverse = wrist_in_random_poses
    leg_number = int(leg) - 1
    is_valid = inverse.status[mode] == Status.OK
    normals = normals_of_leg_planes(
        mechanism, leg, poses[is_valid], inverse.inputs[mode][is_valid, leg_number]
    )
    sines = normals @ base_axis(mechanism, leg)
    type_1 = inverse.type_1[mode][is_valid, leg_number]
    assert np.max(np.abs(np.abs(sines) - type_1)) < 1e-12
    expected_normals = normals * np.sign(sines)[:, None]
    returned_normals = inverse.normals[mode][is_valid, leg_number]
    assert np.max(np.abs(expected_normals - returned_normals)) < 1e-12


@pytest.mark.parametrize("mode", range(8))
def test_the_type_ii_measure_is_the_least_singular_value_of_the_leg_planes(
    mode, wrist_in_random_poses
):
    """The measure of type II is sigma_min(N) / sqrt(3), with the leg normals as rows of N.

    `wrist_in_random_poses` has a wrist, poses and their inverse kinematics. Three legs join
    the platform of the wrist to its base. Each leg has three pairs: that of the crank,
    which is an input, and two passive ones.

    Suppose that pairs have play: besides its rotation, each pair adds a small angular
    velocity in any direction, its misfit. The angular velocity w of the platform is the sum
    of the rotations and misfits along each leg. S is the least sum of squared misfits of
    all pairs, for the best w with |w| = 1, if the cranks cannot rotate. S_locked is the
    same if no pair can rotate. By definition the measure is sqrt(S / S_locked).

    1. S, one leg: both passive axes are in the plane of the leg. So their rotations have no
    component along the normal n of this plane, and the three misfits alone must give n.w.
    The sum of their squares is least if each is n.w / 3, and is then (n.w)^2 / 3.

    2. S, all legs: the sum over the legs is |N w|^2 / 3. Its least value for |w| = 1 is
    sigma_min(N)^2 / 3.

    3. S_locked: the three misfits of each leg add up to w. Their squares are least if each
    is w / 3. The sum for 3 legs of 3 pairs is 3 x 3 x (1/3)^2 = 1.
    """
    mechanism, poses, inverse = wrist_in_random_poses
    is_valid = inverse.status[mode] == Status.OK
    leg_normals = [
        normals_of_leg_planes(
            mechanism, leg, poses[is_valid], inverse.inputs[mode][is_valid, leg_number]
        )
        for leg_number, leg in enumerate("123")
    ]
    matrices = np.stack(leg_normals, axis=1)
    least_singular_values = np.linalg.svd(matrices, compute_uv=False)[:, -1]
    expected = least_singular_values / np.sqrt(3.0)
    assert np.max(np.abs(expected - inverse.type_2[mode][is_valid])) < 1e-12


def test_the_jacobian_inverts_differences_of_the_inputs(mechanism):
    """The Jacobian (output by inputs) is the inverse of central differences of the inputs.

    Inverse kinematics is evaluated at poses turned by 1e-5 rad about x, y and z, away from
    singularities. Poses are directions (n, 3) if the output of the mechanism is the
    direction of a pointer, otherwise rotations (n, 3, 3).
    """
    kinematics = sk.InverseKinematics(mechanism)
    poses = random_poses(kinematics, 300, 11)
    # The Jacobian needs the normals of the legs, which are only returned if asked for.
    inverse = kinematics.at(poses, normals=True)
    # Measures of types I (modes, poses, inputs) and II (modes, poses) are 0 at
    # singularities.
    least_type_1 = np.min(inverse.type_1, axis=2)
    is_regular = (inverse.status == Status.OK) & (least_type_1 > 0.2)
    is_regular &= (inverse.type_2 > 0.2) & (inverse.margin > 0.05)
    assert np.sum(is_regular) > 20
    step = 1e-5

    def inputs_after_turn(rotation_vector):
        turn = Rotation.from_rotvec(rotation_vector).as_matrix()
        is_pointer = kinematics.wrist.points  # whether the output is a direction
        if is_pointer:
            turned_poses = poses @ turn.T  # rows are directions
        else:
            turned_poses = turn @ poses
        return kinematics.at(turned_poses).inputs

    derivatives = []
    for axis in np.eye(3):
        change = inputs_after_turn(step * axis) - inputs_after_turn(-step * axis)
        derivatives.append(np.angle(np.exp(1j * change)) / (2 * step))
    inputs_by_turn = np.stack(derivatives, axis=-1)[is_regular]
    # (rows, inputs, 3) times (rows, 3, inputs). With two inputs, as for a pointer, only
    # the product in this order is the identity.
    product = inputs_by_turn @ inverse.jacobian[is_regular]
    assert np.max(np.abs(product - np.eye(inputs_by_turn.shape[1]))) < 1e-6


def test_rows_that_are_out_of_reach_do_not_disturb_others():
    """A pose of NaN among 20 poses is out of reach, and changes no other row.

    Inverse kinematics of a platform, in one working mode (a sign for each leg). Without
    poses the results have no rows.
    """
    mechanism = sk.load("three_rrr")
    kinematics = sk.InverseKinematics(mechanism)
    poses = random_rotations(20, 12)
    poses[3] = np.nan
    inverse = kinematics.at(poses, modes=[(1, -1, 1)])
    alone = kinematics.at(np.delete(poses, 3, axis=0), modes=[(1, -1, 1)])
    assert inverse.labels == ("+-+",) and inverse.status[0, 3] == Status.OUT_OF_REACH
    for name in ("inputs", "margin", "type_2"):
        without, expected = (
            np.delete(getattr(inverse, name), 3, axis=1),
            getattr(alone, name),
        )
        assert np.array_equal(without, expected, equal_nan=True)
    assert np.any(inverse.status == Status.OUT_OF_REACH)
    empty = kinematics.at(np.empty((0, 3, 3)))
    assert empty.inputs.shape == (8, 0, 3)


def test_coinciding_axes_are_a_singularity_and_no_failure_of_the_run():
    """A crank and a coupler of one arc: with its ends together the leg turns freely."""
    mechanism = sk.load("five_bar")
    first = pair_frames(mechanism)["21"][0][:, 2]
    inverse = sk.InverseKinematics(mechanism).at(np.stack([first, [0.36, 0.48, 0.8]]))
    assert np.all(inverse.status[:, 0] == Status.AT_SINGULARITY)
    assert np.all(inverse.status[:, 1] == Status.OK)
    assert np.all(np.abs(inverse.margin[:, 0]) < 1e-7)


def test_an_output_relative_to_a_moving_link():
    """Inverse kinematics works for a coupler relative to the crank of another leg.

    The ground then moves relative to the crank like any other link. The solutions must have
    the wanted poses; a pose of NaN has no solution. Forward kinematics must lead back to
    the poses.
    """
    mechanism = sk.load("three_rrr")
    mechanism = replace(mechanism, outputs=(Output("o", "coupler2", "crank1"),))
    kinematics = sk.InverseKinematics(mechanism)
    poses = random_rotations(5, 18)
    poses[1] = np.nan
    solutions = kinematics.solutions(poses)
    # `row` is the number of the pose that a solution belongs to.
    assert len(solutions.row) and 1 not in solutions.row
    assert np.max(np.abs(solutions.rotations - poses[solutions.row])) < 1e-13
    forward = ForwardKinematics(mechanism)
    for row in (0, len(solutions.row) - 1):
        forward_solutions = forward.solutions(solutions.inputs[row][None])
        gap = np.max(
            np.abs(forward_solutions.rotations - solutions.rotations[row]), axis=(1, 2)
        )
        assert np.min(gap) < 1e-11


THREE, FIVE = sk.load("three_rrr"), sk.load("five_bar")


def inverse_kinematics_between(name, link, base):
    """Return the inverse kinematics of a link relative to another."""
    mechanism = replace(sk.load(name), outputs=(Output("o", link, base),))
    return sk.InverseKinematics(mechanism)


@pytest.mark.parametrize("call", TABLES["inverse kinematics"])
def test_bad_arguments_of_inverse_kinematics_are_refused(call):
    """A call of "inverse kinematics" in `refusals.toml` raises the error stated there."""
    check_call(call, globals(), TABLES["inverse kinematics"][call])


def test_files_state_the_pointer_of_an_output_in_three_ways():
    """A file can state the pointer of an output in three ways.

    The pointer is a direction that is fixed in the link. It is stated by the axis of a
    revolute pair of the link, by components, or by longitude and latitude (deg). Other
    axes, and two statements at once, are refused.
    """
    five = sk.load("five_bar")
    # The axis of pair 43 in the first of its two links.
    axis = pair_frames(five)["43"][0][:, 2]
    assert np.allclose(five.outputs[0].direction, axis, atol=1e-15)
    assert loads(dumps(five)).outputs == five.outputs
    text = dumps(five)
    line = next(line for line in text.splitlines() if line.startswith("xyz"))
    turned = loads(text.replace(line, "lonlat = [90.0, 15.0]")).outputs[0].direction
    assert np.allclose(turned, [0.0, np.cos(np.radians(15)), np.sin(np.radians(15))])
    with pytest.raises(FileError, match=r"pointer.axis: link .* has no R pair .21."):
        loads(text.replace(line, 'axis = "21"'))
    with pytest.raises(FileError, match="the direction is already given by axis"):
        loads(text.replace(line, f'axis = "43"\n{line}'))


def test_names_of_the_wrist_give_way():
    """Pairs of the virtual wrist get other names if the mechanism uses theirs ("tilt")."""
    mechanism = sk.load("five_bar")
    renamed = loads(
        dumps(mechanism).replace('"43"', '"tilt"').replace("pairs.43", "pairs.tilt")
    )
    wrist = with_wrist(renamed).mechanism
    assert [pair.name for pair in wrist.pairs[-3:]] == ["azimuth", "tilt_", "turn"]
    legs = sk.InverseKinematics(renamed).legs
    assert legs == ("dyad of 21, 32, turn", "dyad of tilt, 54, 51")


def count_solutions_with_orientation(solutions, row, orientation):
    """Return how many solutions for a direction have this orientation of the output.

    Solutions are different if their inputs are. `row` is the number of the direction.
    """
    is_of_row = solutions.row == row
    gaps = np.max(np.abs(solutions.rotations[is_of_row] - orientation), axis=(1, 2))
    inputs = solutions.inputs[is_of_row][gaps < 1e-9]
    return len({tuple(np.round(q, 6)) for q in inputs})


@pytest.mark.slow
def test_all_mid_plane_symmetric_solutions_are_found():
    """Inverse kinematics finds all mid-plane symmetric solutions, in all modes of the legs.

    In `two_dof_spm` base and output link can be mirror images of each other about a plane,
    the mid-plane, in which the elbows of all legs are. The direction of the output then
    determines this plane. If the three legs reach it, each leg has two possible elbows.

    Solutions with equal inputs are counted once. Only two legs are driven, so the inputs do
    not depend on the elbow of the third leg. The elbows of the driven legs give 2 x 2
    different inputs. If a leg does not reach the plane, no solution is symmetric.
    `mid_plane_form` computes plane and elbows in closed form.
    """
    mechanism = sk.load("two_dof_spm")
    form = sk.mid_plane_form(mechanism)
    directions = np.array([[0.3, 0.8, 0.52], [0.5, 0.5, 0.7], [-0.4, 0.7, 0.1], [0, -1, 1]])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    # The form has its own axes, into which `frame` turns the directions.
    normals, _ = form.normals_to(directions @ form.frame)
    # The elbows (directions, legs, 3) are NaN if a leg does not reach the mid-plane. The
    # mode 1 or -1 selects one of the two elbows of a leg. A leg has both elbows or none, so
    # that one mode shows whether the plane is reached.
    elbows, _ = form.plane.elbows(normals, modes=1)
    is_reached = np.isfinite(elbows).all(axis=(1, 2))
    assert 2 <= np.sum(is_reached) < 4

    solutions = sk.InverseKinematics(mechanism).solutions(directions)
    assert np.max(np.abs(solutions.directions - directions[solutions.row])) < 1e-14
    for row, orientation in enumerate(form.orientations(normals)):
        expected_count = 2 * 2 if is_reached[row] else 0
        count = count_solutions_with_orientation(solutions, row, orientation)
        assert count == expected_count
    # A working mode has five signs: one for each of the four dyads (two links each), and
    # one for the last link, a bar between two axes.
    assert {len(signs) for signs in solutions.signs} == {5}


@pytest.mark.slow
def test_solutions_close_where_the_axes_of_a_dyad_coincide():
    """At this direction of the mid-plane mechanism a dyad is degenerate."""
    mechanism = sk.load("two_dof_spm")
    solutions = sk.InverseKinematics(mechanism).solutions([[0.0, 0.5, 0.75**0.5]])
    closed = ForwardKinematics(mechanism).solver.closure.linearise(solutions.values)
    assert np.all(closed.closure_residual < 1e-12)


def test_the_jacobian_of_the_mid_plane_mechanism_is_that_of_the_velocity_equations():
    """Inverse kinematics of a mid-plane mechanism has the Jacobian of its link velocities.

    Base and output link of `two_dof_spm` can be mirror images in a plane, the mid-plane.
    The output is the direction of a pointer. The poses are those of its 16
    configurations at driving angles of 14 and 23 deg. The angular velocity about the
    pointer does not move it and is removed. For each pose whose pointer moves, some working
    mode must have the same inputs and the same Jacobian.
    """
    mechanism = sk.load("two_dof_spm")
    kinematics = sk.InverseKinematics(mechanism)
    motion = sk.trace(mechanism, path=np.radians([[14.0, 23.0]]))
    output = kinematics.wrist.output
    rotations = motion.rotations[:, mechanism.link_number["4"]]
    pointers = rotations @ np.array(output.direction)
    # (poses, 3, inputs) angular velocities per unit rate of each input.
    rates = output_rates(motion, output)
    along_pointer = np.vecmat(pointers, rates)
    rates = rates - pointers[:, :, None] * along_pointer[:, None]

    # A direction leaves the turn about it open. Newton's method finds this turn, from the
    # orientations `near`. The Jacobian is computed from normals of the legs, one for each
    # input, which are part of the result only on request.
    inverse = kinematics.at(pointers, near=rotations, normals=True)
    # Results (modes, poses, ...) minus those of the motion (poses, ...).
    input_gaps = np.angle(np.exp(1j * (inverse.inputs - motion.inputs)))
    is_same = np.max(np.abs(input_gaps), axis=2) < 1e-9
    is_same &= inverse.status == Status.OK
    has_same_rates = np.max(np.abs(inverse.jacobian - rates), axis=(2, 3)) < 1e-8
    # In four configurations the pointer rests; inverse kinematics does not converge there.
    moves = np.max(np.abs(rates), axis=(1, 2)) > 1e-6
    assert np.sum(moves) == 12
    assert np.all(np.any(is_same & has_same_rates, axis=0)[moves])


def test_a_mechanism_with_a_bar_wants_a_start():
    kinematics = sk.InverseKinematics(sk.load("two_dof_spm"))
    far = kinematics.at([[0.0, -0.6, -0.8]], near=np.eye(3))
    assert np.all(far.status == Status.OUT_OF_REACH) and np.all(far.margin < 0.0)


def test_the_jacobian_has_a_column_of_zeros_where_an_input_moves_a_resting_output():
    """The input of a stretched leg of `three_rrr` does not move the output.

    Three legs carry the platform, which is the output. Leg 1 is a crank, driven at pair a1,
    and a coupler, which pair c1 joins to the platform. Here the arc from a1 to c1 is crank
    + coupler, so leg 1 is stretched. Its direction, and the turn of the platform about c1,
    are random.

    Column i of the Jacobian is the angular velocity of the platform while only input i
    moves, at the rate 1. The normal n_i of input i is a unit vector. While input i is
    locked, all possible angular velocities are perpendicular to n_i. So the product of the
    normals (rows) and the Jacobian is a diagonal matrix. By definition, `type_1` is its
    diagonal.

    For the stretched leg `type_1` and the column are 0. The normal and the other columns
    must still be right.
    """
    mechanism = sk.load("three_rrr")
    frames = pair_frames(mechanism)
    sizes = mechanism.geometry.links
    ground_axis = frames["a1"][0][:, 2]
    stretched_arc = sizes["crank1"].arcs[0] + sizes["coupler1"].arcs[0]
    platform_axis = frames["c1"][1][:, 2]
    poses = []
    for rotation in random_rotations(200, 21):
        # The rotation is only a source of a random direction and a random angle.
        random_direction = rotation[:, 0]
        random_angle = rotation[0, 0] * np.pi
        # The axis of c1 is the axis of a1, rotated by the stretched arc within the plane of
        # the axis of a1 and the random direction.
        plane_normal = np.cross(ground_axis, random_direction)
        vector = stretched_arc * plane_normal / np.linalg.norm(plane_normal)
        axis = Rotation.from_rotvec(vector).apply(ground_axis)
        alignment, _ = Rotation.align_vectors([axis], [platform_axis])
        spin = Rotation.from_rotvec(random_angle * axis)
        poses.append((spin * alignment).as_matrix())
    inverse = sk.InverseKinematics(mechanism).at(poses, normals=True)
    # Due to rounding, `type_1` of the stretched leg is exactly 0 at some poses only.
    is_exact = (inverse.status == Status.AT_SINGULARITY) & (inverse.type_1[..., 0] == 0.0)
    assert np.any(is_exact)
    normals = inverse.normals[is_exact]
    assert np.allclose(np.linalg.norm(normals, axis=2), 1.0, atol=1e-14)
    jacobian = inverse.jacobian[is_exact]
    assert np.all(jacobian[:, :, 0] == 0.0)
    products = normals @ jacobian
    type_1 = inverse.type_1[is_exact]
    assert np.allclose(products, type_1[:, None] * np.eye(3), atol=1e-12)


@pytest.mark.slow
def test_the_type_ii_measure_belongs_to_the_poses_of_the_call():
    """The result `type_2` does not change if the caller changes its arrays after the call.

    `type_2` measures how near each pose is to a singularity of type II. It is computed only
    when it is first read, when the caller may have changed the arrays of the call.
    """
    kinematics = sk.InverseKinematics("three_rrr")
    poses = random_rotations(5, 22)
    expected = kinematics.at(poses.copy()).type_2
    inverse = kinematics.at(poses)
    poses[:] = np.roll(poses, 1, axis=0)
    assert np.array_equal(inverse.type_2, expected, equal_nan=True)
    # In this mechanism the caller also gives `near`, the orientations from which Newton's
    # method starts.
    kinematics = sk.InverseKinematics("two_dof_spm")
    starts = random_rotations(5, 23)
    directions = pointing(np.radians([[60.0, 40.0]] * 5))
    expected = kinematics.at(directions, near=starts.copy()).type_2
    inverse = kinematics.at(directions, near=starts)
    starts[:] = np.eye(3)
    assert np.array_equal(inverse.type_2, expected, equal_nan=True)


@pytest.mark.slow
def test_solutions_at_a_turn_of_half_a_revolution_are_not_lost():
    """The number of turns does not depend on the axis from which turns are counted."""
    kinematics = sk.InverseKinematics("two_dof_spm")
    closing_link = find_closing_link(kinematics.wrist, kinematics.solver)
    direction = pointing(np.radians([[60.0, 40.0]])).T
    # Rounding decides on which side of half a revolution a turn is, so several are tried.
    dyad_modes = [(1, 1, 1, 1), (1, 1, -1, 1), (1, 1, -1, -1)]
    with np.errstate(all="ignore"):
        for signs in dyad_modes:
            turns = closing_link.find_turns(direction, signs).turn
            assert len(turns) in (2, 4)
            for turn in turns:
                about_z = Rotation.from_euler("z", turn - np.pi).as_matrix()
                frame = about_z @ closing_link.pointer_frame
                counted = replace(closing_link, pointer_frame=frame)
                shifted = counted.find_turns(direction, signs).turn
                assert len(shifted) == len(turns)
                assert np.min(np.abs(np.abs(shifted) - np.pi)) < 1e-12


def test_inputs_at_half_a_revolution_are_pi_and_not_minus_pi():
    """Rounding decides on which side of half a revolution an input is."""
    second_inputs = np.linspace(-3.0, 3.0, 301)
    inputs = np.column_stack([np.full(301, np.pi), second_inputs])
    directions = (
        ForwardKinematics(sk.load("five_bar"), "pointer").solutions(inputs).directions
    )
    first_inputs = sk.InverseKinematics("five_bar").at(directions).inputs[..., 0]
    assert np.any(np.abs(np.abs(first_inputs) - np.pi) < 1e-12)
    assert not np.any(first_inputs <= -np.pi)


def test_refusal_of_one_input_does_not_advise_to_drive_the_pair_that_is_driven():
    mechanism = sk.build(
        "crank",
        angle_unit="deg",
        ground="base",
        links=["base", "crank"],
        pairs={"axle": {"type": "R", "links": ["base", "crank"], "xyz": [0.0, 0.0, 1.0]}},
        inputs={"axle": {}},
        outputs={"crank": {"link": "crank"}},
    )
    with pytest.raises(PlanError) as refusal:
        sk.InverseKinematics(mechanism)
    assert "--input" not in str(refusal.value)
