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
from spherekit.errors import FileError
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
from spherekit.outputs.forward_kinematics import ForwardKinematics, output_rates
from spherekit.outputs.virtual_output import with_wrist
from spherekit.positions.assembly_mode import AssemblyMode
from spherekit.status import Status

SHIPPED = ("three_rrr", "agile_eye", "five_bar")


def random_rotations(count, seed):
    return Rotation.random(count, random_state=seed).as_matrix()


def poses_for(kinematics, count, seed):
    rotations = random_rotations(count, seed)
    return rotations[:, :, 2] if kinematics.wrist.points else rotations


MADE = {
    **{name: lambda name=name: sk.load(name) for name in SHIPPED},
    "unlike_legs": platform_with_unlike_legs,
    "serial_3": lambda: serial_chain(3),
    "serial_2": lambda: serial_chain(2),
    "posed": posed_three_rrr,
}


@pytest.fixture(params=MADE)
def made(request):
    return MADE[request.param]()


def test_tilt_and_torsion():
    rotations = random_rotations(500, 1)
    rotations[:100] = Rotation.from_rotvec(rotations[:100, 0] * [0, 0, 1]).as_matrix()
    rotations[100:200] = Rotation.from_euler("ZY", [[0.3, np.pi]] * 100).as_matrix()
    rotations[200:210] = np.eye(3)
    for there, back in ((tilt_torsion, from_tilt_torsion), (euler_zyz, from_euler_zyz)):
        angles = there(rotations)
        assert np.max(np.abs(back(angles) - rotations)) < 1e-15 * 4
        assert np.all(angles[:, 1] >= 0.0) and np.all(angles[:, 1] <= np.pi)
    angles = np.array([[0.7, 0.4, -0.2]])
    known = Rotation.from_euler("ZYZ", [[0.7, 0.4, -0.9]]).as_matrix()
    assert np.allclose(from_tilt_torsion(angles), known, atol=1e-15)
    assert np.allclose(tilt_torsion(known), angles, atol=1e-15)
    directions = rotations[:, :, 2]
    assert np.max(np.abs(pointing(azimuth_tilt(directions)) - directions)) < 1e-15


def test_vectors_agree_with_the_positions_of_all_links(made):
    """Closed form of axes against rotation matrices and pair variables, every mode."""
    kinematics = sk.InverseKinematics(made)
    poses = poses_for(kinematics, 60, 3)
    coordinates = azimuth_tilt(poses) if kinematics.wrist.points else euler_zyz(poses)
    inverse = kinematics.at(poses)
    assert len(inverse.modes) == 2 ** len(kinematics.legs)
    for k, signs in enumerate(inverse.modes):
        known = kinematics.solver.evaluate(AssemblyMode(0, signs), coordinates)
        assert np.array_equal(known.status, inverse.status[k])
        gap = known.values[:, kinematics.driven] - inverse.inputs[k]
        held = inverse.status[k] == Status.OK
        gap = np.abs(np.angle(np.exp(1j * gap[held])))
        assert np.max(gap * inverse.type_1[k][held], initial=0.0) < 2e-13
        assert np.all(np.isnan(inverse.inputs[k][~held]))


def test_inverse_kinematics_can_be_sent_to_other_processes_after_use():
    kinematics = sk.InverseKinematics("three_rrr")
    poses = poses_for(kinematics, 5, 3)
    inverse = kinematics.at(poses)
    copy = pickle.loads(pickle.dumps(kinematics))
    assert np.array_equal(copy.at(poses).inputs, inverse.inputs, equal_nan=True)


def input_frames(made):
    """Frames of all pairs in both links, by name."""
    joints = make_joints(made)
    return {p.name: (j.first, j.second) for p, j in zip(made.pairs, joints, strict=True)}


def test_the_margin_and_measures_of_a_three_legged_wrist():
    """Reach by the arcs of each leg; measures by the planes of its cranks and couplers."""
    made = sk.load("three_rrr")
    poses = random_rotations(500, 10)
    inverse = sk.InverseKinematics(made).at(poses, normals=True)
    frames, sizes = input_frames(made), made.geometry.links
    least = []
    for leg in "123":
        base = arc(frames[f"a{leg}"][0][:, 2], poses @ frames[f"c{leg}"][1][:, 2])
        crank, rod = sizes[f"crank{leg}"].arcs[0], sizes[f"coupler{leg}"].arcs[0]
        outer = min(crank + rod, 2 * np.pi - crank - rod)
        least.append(np.minimum(base - abs(crank - rod), outer - base))
    assert np.max(np.abs(inverse.margin - np.min(least, axis=0))) < 1e-14
    for k in range(8):
        good = inverse.status[k] == Status.OK
        normals = []
        for i, leg in enumerate("123"):
            first, second = frames[f"a{leg}"]
            turn = Rotation.from_euler("z", inverse.inputs[k][good, i, None]).as_matrix()
            b = first @ turn @ second.T @ frames[f"b{leg}"][0][:, 2]
            n = np.cross(b, poses[good] @ frames[f"c{leg}"][1][:, 2])
            n /= np.linalg.norm(n, axis=1, keepdims=True)
            sine = n @ first[:, 2]
            assert np.max(np.abs(np.abs(sine) - inverse.type_1[k][good, i])) < 1e-12
            n *= np.sign(sine)[:, None]
            assert np.max(np.abs(n - inverse.normals[k][good, i])) < 1e-12
            normals.append(n)
        # A leg of three pairs with its crank locked resists about its normal alone, as
        # three springs in a row; three locked legs side by side resist as one spring.
        least = np.linalg.svd(np.stack(normals, axis=1), compute_uv=False)[:, -1]
        assert np.max(np.abs(least / np.sqrt(3.0) - inverse.type_2[k][good])) < 1e-12


def test_the_jacobian_undoes_differences_of_the_inputs(made):
    """Exact rates against central differences of the inverse kinematics itself."""
    kinematics = sk.InverseKinematics(made)
    poses = poses_for(kinematics, 300, 11)
    inverse = kinematics.at(poses, normals=True)
    clear = (inverse.status == Status.OK) & (np.min(inverse.type_1, axis=2) > 0.2)
    clear &= (inverse.type_2 > 0.2) & (inverse.margin > 0.05)
    assert np.sum(clear) > 20
    step = 1e-5
    moved = []
    for axis in np.eye(3):
        ends = []
        for sign in (1, -1):
            turn = Rotation.from_rotvec(sign * step * axis).as_matrix()
            turned = poses @ turn.T if kinematics.wrist.points else turn @ poses
            ends.append(kinematics.at(turned).inputs)
        moved.append(np.angle(np.exp(1j * (ends[0] - ends[1]))) / (2 * step))
    rows = np.stack(moved, axis=-1)[clear]
    product = rows @ inverse.jacobian[clear]
    assert np.max(np.abs(product - np.eye(rows.shape[1]))) < 1e-6


def test_rows_that_are_out_of_reach_do_not_disturb_others():
    made = sk.load("three_rrr")
    kinematics = sk.InverseKinematics(made)
    poses = random_rotations(20, 12)
    poses[3] = np.nan
    inverse = kinematics.at(poses, modes=[(1, -1, 1)])
    alone = kinematics.at(np.delete(poses, 3, axis=0), modes=[(1, -1, 1)])
    assert inverse.labels == ("+-+",) and inverse.status[0, 3] == Status.OUT_OF_REACH
    for name in ("inputs", "margin", "type_2"):
        one, other = np.delete(getattr(inverse, name), 3, axis=1), getattr(alone, name)
        assert np.array_equal(one, other, equal_nan=True)
    assert np.any(inverse.status == Status.OUT_OF_REACH)
    empty = kinematics.at(np.empty((0, 3, 3)))
    assert empty.inputs.shape == (8, 0, 3)


def test_coinciding_axes_are_a_singularity_and_no_failure_of_the_run():
    """A crank and a coupler of one arc: with its ends together the leg turns freely."""
    made = sk.load("five_bar")
    first = input_frames(made)["21"][0][:, 2]
    inverse = sk.InverseKinematics(made).at(np.stack([first, [0.36, 0.48, 0.8]]))
    assert np.all(inverse.status[:, 0] == Status.AT_SINGULARITY)
    assert np.all(inverse.status[:, 1] == Status.OK)
    assert np.all(np.abs(inverse.margin[:, 0]) < 1e-7)


def test_an_output_seen_from_a_moving_link():
    """A coupler seen from another leg's crank: the ground is placed like any link."""
    made = sk.load("three_rrr")
    made = replace(made, outputs=(Output("o", "coupler2", "crank1"),))
    kinematics = sk.InverseKinematics(made)
    poses = random_rotations(5, 18)
    poses[1] = np.nan
    found = kinematics.solutions(poses)
    assert len(found.row) and 1 not in found.row
    assert np.max(np.abs(found.rotations - poses[found.row])) < 1e-13
    forward = ForwardKinematics(made)
    for row in (0, len(found.row) - 1):
        back = forward.solutions(found.inputs[row][None])
        gap = np.max(np.abs(back.rotations - found.rotations[row]), axis=(1, 2))
        assert np.min(gap) < 1e-11


THREE, FIVE = sk.load("three_rrr"), sk.load("five_bar")


def seen(name, link, base):
    """The inverse kinematics of a link relative to another."""
    made = replace(sk.load(name), outputs=(Output("o", link, base),))
    return sk.InverseKinematics(made)


@pytest.mark.parametrize("call", TABLES["inverse kinematics"])
def test_what_cannot_be_asked(call):
    check_call(call, globals(), TABLES["inverse kinematics"][call])


def test_files_say_what_an_output_points_with():
    five = sk.load("five_bar")
    axis = input_frames(five)["43"][0][:, 2]
    assert np.allclose(five.outputs[0].direction, axis, atol=1e-15)
    assert loads(dumps(five)).outputs == five.outputs
    text = dumps(five)
    line = next(line for line in text.splitlines() if line.startswith("xyz"))
    turned = loads(text.replace(line, "lonlat = [90.0, 15.0]")).outputs[0].direction
    assert np.allclose(turned, [0.0, np.cos(np.radians(15)), np.sin(np.radians(15))])
    with pytest.raises(FileError, match=r"pointer.axis: link .* has no R pair .21."):
        loads(text.replace(line, 'axis = "21"'))
    with pytest.raises(FileError, match="the direction is given by axis already"):
        loads(text.replace(line, f'axis = "43"\n{line}'))


def test_names_of_the_wrist_give_way():
    made = sk.load("five_bar")
    renamed = loads(dumps(made).replace('"43"', '"tilt"').replace("pairs.43", "pairs.tilt"))
    wrist = with_wrist(renamed).mechanism
    assert [pair.name for pair in wrist.pairs[-3:]] == ["azimuth", "tilt_", "turn"]
    legs = sk.InverseKinematics(renamed).legs
    assert legs == ("dyad of 21, 32, turn", "dyad of tilt, 54, 51")


@pytest.mark.slow
def test_every_turn_of_the_mid_plane_mechanism_is_found():
    """The closed form has two places for each of the three legs, where they reach."""
    made = sk.load("two_dof_spm")
    kinematics, form = sk.InverseKinematics(made), sk.mid_plane_form(made)
    directions = np.array([[0.3, 0.8, 0.52], [0.5, 0.5, 0.7], [-0.4, 0.7, 0.1], [0, -1, 1]])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    normals, _ = form.normals_to(directions @ form.frame)
    reached = np.isfinite(form.plane.elbows(normals, 1)[1]).all(axis=1)
    found = kinematics.solutions(directions)
    assert np.max(np.abs(found.directions - directions[found.row])) < 1e-14
    assert 2 <= np.sum(reached) < 4
    for row, known in enumerate(form.orientations(normals)):
        mine = found.row == row
        same = np.max(np.abs(found.rotations[mine] - known), axis=(1, 2)) < 1e-9
        pairs = {tuple(np.round(q, 6)) for q in found.inputs[mine][same]}
        assert len(pairs) == (4 if reached[row] else 0)
    assert {len(signs) for signs in found.signs} == {5}
    there = kinematics.solutions([[0.0, 0.5, 0.75**0.5]])  # axes of a dyad coincide
    assert np.all(
        ForwardKinematics(made).solver.closure.at(there.values).closure_residual < 1e-12
    )


def test_the_jacobian_of_the_mid_plane_mechanism_is_that_of_the_velocity_equations():
    made = sk.load("two_dof_spm")
    kinematics = sk.InverseKinematics(made)
    motion = sk.trace(made, path=np.radians([[14.0, 23.0]]))
    output = kinematics.wrist.output
    rotations = motion.rotations[:, made.link_number["4"]]
    pose = rotations @ np.array(output.direction)
    rates = output_rates(motion, output)
    rates = rates - pose[:, :, None] * np.einsum("ni,nij->nj", pose, rates)[:, None]
    inverse = kinematics.at(pose, near=rotations, normals=True)
    gap = np.max(np.abs(np.angle(np.exp(1j * (inverse.inputs - motion.inputs)))), axis=2)
    wrong = np.max(np.abs(inverse.jacobian - rates), axis=(2, 3))
    moves = np.max(np.abs(rates), axis=(1, 2)) > 1e-6
    same = (gap < 1e-9) & (inverse.status == Status.OK)
    assert np.sum(moves) >= 8 and np.all(np.any(same & (wrong < 1e-8), axis=0)[moves])


def test_a_mechanism_with_a_bar_wants_a_start():
    kinematics = sk.InverseKinematics(sk.load("two_dof_spm"))
    far = kinematics.at([[0.0, -0.6, -0.8]], near=np.eye(3))
    assert np.all(far.status == Status.OUT_OF_REACH) and np.all(far.margin < 0.0)
