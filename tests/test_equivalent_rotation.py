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
    return sk.mid_plane_form(paper)


def inside(form, count, seed, away=0.0):
    """Return normals (count, 3) of the workspace of section 3, within all legs' reach.

    Driven legs are 10 degrees or more, and none is stretched.
    """
    random = np.random.default_rng(seed)
    n = random.normal(size=(100 * count, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    n[:, 2] = np.abs(n[:, 2])
    folds = fold_angles(form.plane, n)
    good = np.all(folds[:, list(form.plane.driven)] - np.radians(10.0) > away, axis=1)
    good &= np.all(2.0 * form.plane.arcs - folds > away, axis=1)
    return n[good & (n[:, 0] < 0.0)][:count]


@pytest.mark.parametrize("angle", [1e-6, 1e-3, 0.4, 2.0, np.pi - 1e-3, np.pi - 1e-9])
def test_axis_and_angle_of_a_rotation(angle):
    random = np.random.default_rng(3)
    for first in Rotation.random(20, random_state=3).as_matrix():
        axis = random.normal(size=3)
        axis /= np.linalg.norm(axis)
        turn = Rotation.from_rotvec(angle * axis).as_matrix()
        found, turned = axis_and_angle(first, turn @ first)
        assert abs(turned - angle) < 2e-15
        assert np.linalg.norm(found - axis) < 2e-15 / min(angle, 1.0)
        assert np.max(np.abs(rotation_about_axis(axis, [angle])[0] - turn)) < 1e-15


def test_phi_gamma_omega():
    """Eqs. (2) and (5), and P as the mirror image of Q."""
    random = np.random.default_rng(4)
    phi = np.radians(random.uniform(1.0, 120.0, 300))
    gamma = np.radians(random.uniform(-60.0, 60.0, 300))
    known = np.sin(phi / 2) ** 2 + np.sin(gamma / 2) ** 2 < 1.0
    phi, gamma = phi[known], gamma[known]
    n = normals_of(phi, gamma)
    *named, omega = mirror_angles(-n)
    assert np.max(np.abs(np.subtract(named, (phi, gamma)))) < 1e-14
    eq5 = np.sin(gamma / 2) / np.cos(phi / 2)
    assert np.sin(omega) == pytest.approx(eq5, abs=1e-13)
    p = np.array([1.0, 0.0, 0.0]) - 2.0 * n[:, :1] * n
    off, up = np.sin(phi) * np.sin(omega), np.sin(phi) * np.cos(omega)
    assert np.max(np.abs(p - np.stack([np.cos(phi), off, up], axis=1))) < 1e-14


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
    (normal,) = form.plane.normals(np.radians([inputs]))
    return np.degrees(mirror_angles(normal)[:2])


@pytest.mark.parametrize("at", TABLE_1)
def test_table_1(form, at):
    pose, *rows = TABLE_1[at]
    start = pose_at(form, at)
    assert start == pytest.approx(pose, abs=5.1e-5)
    for tiny, cad in rows:
        assert 1e3 * (pose_at(form, np.add(at, tiny)) - start) == pytest.approx(
            cad, abs=5.1e-5
        )


def test_four_initial_configurations(form):
    """Fig. 5: four sets of driving angles for one pose; all lead back to it."""
    normals = inside(form, 50, 6)
    found = form.plane.solutions(normals)
    assert len(found) == 4
    for modes, inputs in found.items():
        assert np.max(np.abs(form.plane.normals(inputs) - normals)) < 1e-13
        assert np.all(form.plane.modes(inputs) == modes)
        # eqs. (12) and (13): sin(theta) is the elbow's height over sin(alpha)
        elbows, _ = form.plane.elbows(normals, (*modes, 1))
        heights = elbows[:, :2, 2] / np.sin(form.plane.arcs[:2])
        assert np.max(np.abs(np.sin(inputs) - heights)) < 1e-14
        arcs = np.vecdot(elbows, form.plane.axes) - np.cos(form.plane.arcs)
        assert np.max(np.abs(arcs)) < 1e-15


def test_graph_and_mid_plane_form_are_one(paper, form):
    """11 links, 14 pairs: orientation and driving angles, 1e-11."""
    assert (len(paper.links), len(paper.pairs)) == (11, 14)
    assert form.proof()[1] == 2 and form.proof()[0] < 1e-14
    normals = inside(form, 60, 1, away=np.radians(1.0))
    closure = PositionAnalysis(paper, samples=2).solver.closure
    frames = revolute_frames(paper)
    for third in (1, -1):
        modes = (-1, 1, third)
        rotations = form.place(normals, modes)
        values, _ = form.values(rotations)
        assert closure_gap(paper, rotations, frames) < 1e-14
        assert np.max(np.abs(closure.at(values).residual)) < 1e-13
        # the graph solved on its own for these driving angles, from a disturbed start
        driven, start = driven_variables(form), values.copy()
        free = [v for v in range(14) if v not in driven]
        start[:, free] += np.random.default_rng(2).uniform(-1e-4, 1e-4, (len(start), 12))
        held = turn_singularity(form, normals, modes) > 3e-3
        solved = closure.solve(start[held], driven)
        assert np.max(solved.closure_residual) < 1e-14
        assert np.max(np.abs(solved.values - values[held])) < 1e-11
        placed = closure.at(solved.values).rotations
        ours = form.orientations(normals[held])
        assert np.max(np.abs(placed[:, form.effector] - ours)) < 1e-11
        own = form.plane.solutions(normals)[-1, 1]
        assert np.max(np.abs(values[:, driven] - own)) < 1e-14


def turn_singularity(form, normals, modes):
    """Return |det| of base axes x elbows (n,): 0 where the planes of all legs meet."""
    elbows, _ = form.plane.elbows(normals, modes)
    axes = np.broadcast_to(form.plane.axes, elbows.shape)
    return np.abs(np.linalg.det(cross(axes, elbows)))


@pytest.mark.slow
def test_any_symmetric_arcs_have_the_form():
    random = np.random.default_rng(12)
    for _ in range(6):
        a, b, c, d = np.radians(random.uniform([40, 30, 30, 40], [110, 85, 85, 100]))
        made = mid_plane_mechanism([a, b, b, a, c, c, d, d])
        form = sk.mid_plane_form(made)
        assert form.proof()[1] == 2 and form.proof()[0] < 1e-14
        assert form.plane.arcs == pytest.approx([b, c, d], abs=1e-15)


@pytest.mark.parametrize("pairs", [12, pytest.param(1000, marks=pytest.mark.long)])
def test_axis_stays_fixed_between_random_pairs_of_poses(form, pairs):
    """All mid-planes on the way hold the axis; so does the end effector: 1e-12."""
    starts, stops = inside(form, pairs, 21), inside(form, pairs, 22)
    reached = 0
    for start, stop in zip(starts, stops, strict=True):
        turn = form.rotation_between(start, stop, OUTWARD)
        found = turn.at(np.linspace(0.0, turn.angle, 7))
        ok = found.status == sk.Status.OK
        reached += np.all(ok)
        assert ok[0] and ok[-1] == (turn.end == sk.Status.OK)
        if not ok[-1]:
            continue
        assert max(np.max(found.drift[ok]), np.max(found.orientation_error[ok])) < 1e-12
        back = np.vecmat(turn.axis, found.orientation[ok])
        assert np.max(np.linalg.norm(back - back[0], axis=1)) < 1e-12
        last = form.orientations(stop[None])[0]
        assert np.max(np.abs(found.orientation[-1] - last)) < 1e-13
    assert reached > 0.9 * pairs


def found_status(count, singular):
    status = [sk.Status.OK] * count
    status[singular] = sk.Status.AT_SINGULARITY
    return status


def test_through_the_home_pose(form):
    """phi = 0: all legs folded, the loops fix nothing, and the rotation goes on."""
    turn = rotate(30.0, 0.0, -30.0, 0.0)
    closed = turn.at(np.linspace(0.0, turn.angle, 21))
    home = turn.at([0.5 * turn.angle])
    assert np.max(np.abs(home.inputs)) < 1e-12
    normals, _ = form.normals(closed.orientation)
    phi, gamma, _ = mirror_angles(normals)
    assert np.max(np.abs(phi - np.linspace(np.pi / 6, -np.pi / 6, 21))) < 1e-14
    assert np.max(np.abs(gamma)) < 1e-14
    assert closed.status.tolist() == found_status(21, 10) and closed.type_2[10] < 1e-13
    assert np.all(np.isfinite(closed.second_rates)) and turn.end == sk.Status.OK
    assert turn.leaps == pytest.approx([0.5 * turn.angle], abs=1e-9)
    assert np.max(closed.orientation_error) < 1e-12


def configuration(name, row=0.5):
    """Return a mechanism and a configuration in the middle of its grid."""
    made = sk.load(name)
    motion = sk.trace(made, samples=[3] * len(made.inputs))
    ok = np.flatnonzero((motion.status == sk.Status.OK) & (motion.assembly_mode == 0))
    return made, motion, motion.values[ok[int(row * len(ok))]]


def slopes_of(array, h):
    return (array[0] - 8 * array[1] + 8 * array[3] - array[4]) / (12 * h)


def rates_by_differences(turn, theta, rel, second):
    """Check rates at an angle (rad) by those around it; return the samples there."""
    h = 1e-3
    around = turn.at(theta + h * np.arange(-2, 3))
    assert slopes_of(around.inputs, h) == pytest.approx(around.rates[2], rel=rel)
    if second:
        error = slopes_of(around.rates, h) - around.second_rates[2]
        size = np.max(np.abs(around.second_rates[2]))
        assert np.max(np.abs(error)) < second * max(1.0, size)
    return around


@pytest.mark.parametrize("name", ["three_rrr", "agile_eye"])
def test_three_freedoms_follow_any_axis(name):
    made, _, values = configuration(name)
    closure = Closure.of_mechanism(made, make_joints(made))
    output = made.link_number[made.outputs[0].link]
    start = closure.at(values[None]).rotations[0, output]
    for axis in ([0.4, -1.0, 0.3], [1.0, 0.2, -0.5]):
        turn = sk.follow_rotation(made, values, axis, 0.3)
        theta = np.linspace(0.0, min(0.3, turn.reached), 9)
        found = turn.at(theta)
        assert np.all(found.status == sk.Status.OK)
        at = closure.at(found.values)
        wanted = rotation_about_axis(turn.axis, theta) @ start
        assert np.max(at.closure_residual) < 1e-13
        assert np.max(np.abs(at.rotations[:, output] - wanted)) < 1e-12
        assert np.max(found.orientation_error) < 1e-13 and np.max(found.drift) < 1e-12
        rates_by_differences(turn, 0.5 * theta[-1], 1e-8, 1e-7)


def test_two_freedoms_depart_as_little_as_they_can():
    """Five-bar: least angle against a search over both inputs, and exact rates."""
    made, _, values = configuration("five_bar")
    output = made.link_number["3"]
    turn = sk.follow_rotation(made, values, [0.35, 0.82, 0.33], 0.6)
    theta = np.array([0.0, 0.3, 0.6])
    found = turn.at(theta)
    assert np.all(found.status == sk.Status.OK) and found.orientation_error[0] < 1e-14
    assert found.orientation_error[2] > 0.1
    closure = Closure.of_mechanism(made, make_joints(made))
    start = closure.at(values[None]).rotations[0, output]
    wanted = rotation_about_axis(turn.axis, theta) @ start
    # a mesh around the inputs found, by the dyad's closed form of the same mode
    mesh = 2e-4 * np.array(list(product((-1, 0, 1), repeat=2)))
    for k in (1, 2):
        motion = sk.trace(made, path=found.inputs[k] + mesh)
        rotations = motion.rotations[motion.assembly_mode == 0, output]
        far = angles_between(rotations, wanted[k])
        assert np.argmin(far) == 4
        assert far[4] == pytest.approx(found.orientation_error[k], abs=1e-13)
        fit = np.column_stack([np.ones(9), mesh])
        gradient = np.linalg.lstsq(fit, far**2, rcond=None)[0][1:]
        assert np.max(np.abs(gradient)) < 1e-6
    h = 1e-3
    rates_by_differences(turn, 0.3, 1e-9, 1e-9)
    ahead = turn.at(h * np.arange(5))
    slopes = np.array([-25.0, 48.0, -36.0, 16.0, -3.0]) @ ahead.rates / (12.0 * h)
    assert slopes == pytest.approx(ahead.second_rates[0], abs=1e-8)


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


def test_open_chain_against_euler_angles():
    start = np.array([0.3, 0.7, 0.2])
    turn = sk.follow_rotation(wrist(), start, [1.0, 0.3, 0.2], 1.5)
    found = turn.at(np.linspace(0.0, 1.5, 31))
    assert np.all(found.status == sk.Status.OK)
    z, y = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])
    turns = (rotation_about_axis(u, start[k : k + 1])[0] for k, u in enumerate((z, y, z)))
    r = rotation_about_axis(turn.axis, found.theta) @ np.linalg.multi_dot(list(turns))
    tilt = np.arctan2(np.hypot(r[:, 0, 2], r[:, 1, 2]), r[:, 2, 2])
    azimuth, own = (np.arctan2(r[:, 1, 2], r[:, 0, 2]), np.arctan2(r[:, 2, 1], -r[:, 2, 0]))
    euler = np.stack([azimuth, tilt, own], axis=1)
    assert np.max(np.abs(np.exp(1j * found.inputs) - np.exp(1j * euler))) < 1e-12


def test_through_the_gimbal_pose_of_a_wrist():
    """b turns through 0, where a and c turn about one axis; both stand still."""
    across = [np.sin(0.3), -np.cos(0.3), 0.0]
    turn = sk.follow_rotation(wrist(), [0.3, 0.5, 0.2], across, 0.9)
    assert turn.end == sk.Status.OK and turn.leaps == pytest.approx([0.5], abs=1e-9)
    found = turn.at([0.0, 0.2, 0.5, 0.7, 0.9])
    assert found.inputs[:, 1] == pytest.approx(0.5 - found.theta, abs=1e-12)
    assert np.max(np.abs(found.inputs[:, [0, 2]] - [0.3, 0.2])) < 1e-11
    assert found.rates == pytest.approx(np.tile([0.0, -1.0, 0.0], (5, 1)), abs=1e-11)
    assert found.status.tolist() == found_status(5, 2)


def test_contact_pairs_follow_too():
    """A cam's roller lever: exact about its pivot; beside it no second rates are given."""
    made = sk.load("roller_cam")
    motion = sk.trace(made, samples=9)
    row = int(np.flatnonzero(motion.status == sk.Status.OK)[3])
    axis = motion.axes[row, made.pair_number["follower_pivot"]]
    turn = sk.follow_rotation(made, motion.values[row], axis, 0.02)
    assert np.max(rates_by_differences(turn, 0.01, 1e-7, 1e-5).orientation_error) < 1e-13
    beside = sk.follow_rotation(made, motion.values[row], axis + [0.0, 0.2, 0.1], 0.02)
    around = rates_by_differences(beside, 0.01, 1e-7, None)
    assert np.all(around.orientation_error > 1e-5)
    assert np.all(np.isnan(around.second_rates))


@dataclass(frozen=True)
class Straight:
    """Inputs that go with theta: q = slope theta."""

    axis: np.ndarray
    angle: float
    inputs: tuple
    slope: np.ndarray

    def at(self, theta):
        theta = np.atleast_1d(theta)
        n, rates = len(theta), np.tile(self.slope, (len(theta), 1))
        turns, zero = np.tile(np.eye(3), (n, 1, 1)), np.zeros(n)
        more = 0.0 * rates, 0.0 * rates, turns, zero, zero, zero + 1.0, zero.astype(np.int8)
        return RotationSamples(theta, theta[:, None] * self.slope, rates, *more)


PEAKS = {
    # shape: largest s' and |s''|, in closed form
    "cycloidal": (2.0, 2.0 * np.pi),
    "cubic": (1.5, 6.0),
    "quintic": (15.0 / 8.0, 10.0 / np.sqrt(3.0)),
    "septic": (35.0 / 16.0, 84.0 * np.sqrt(5.0) / 25.0),
}


@pytest.mark.parametrize("shape", SHAPES)
def test_durations_against_closed_forms(shape):
    speed, acceleration = PEAKS[shape]
    by_speed = straight(speed=[1.0, 0.5], shape=shape)
    assert by_speed.duration == pytest.approx(speed * 1.6 / 0.5, rel=1e-12)
    assert by_speed.binding.input == "b"
    assert by_speed.binding.value == pytest.approx(-0.5, rel=1e-12)
    by_acceleration = straight(acceleration=2.0, shape=shape)
    assert by_acceleration.duration**2 == pytest.approx(acceleration * 0.8, rel=1e-12)
    assert by_acceleration.binding.quantity == "acceleration"
    table = by_acceleration.table(11)
    assert table.inputs[-1] == pytest.approx([1.2, -1.6], abs=1e-14)
    assert table.t[-1] == by_acceleration.duration


def rotate(phi, gamma, to_phi, to_gamma):
    form = sk.mid_plane_form(sk.load("two_dof_spm"))
    ends = (normal_at(*np.radians(each)) for each in ((phi, gamma), (to_phi, to_gamma)))
    return form.rotation_between(*ends, OUTWARD)


def four_bar_rotation(axis=(0, 0, 1), angle=0.1, spoil=0.0, output=None):
    made = sk.load("four_bar")
    values = sk.trace(made, samples=3).values[1] + spoil * np.arange(4)
    return sk.follow_rotation(made, values, axis, angle, output)


def straight(**given):
    line = Straight(np.array([0, 0, 1.0]), 0.8, ("a", "b"), np.array([1.5, -2.0]))
    return time_optimal(line, **given)


@pytest.mark.parametrize("call", TABLES["rotations"])
def test_bad_input(call):
    check_call(call, {**globals(), "replace": replace}, TABLES["rotations"][call])
