"""The nearest reachable pose, against random poses and against the reach of single legs.

A random pose that is reachable is never nearer than the one that is called the nearest. No
pose is nearer than the largest violation of the reach of a leg: a rotation by an angle
changes the arc between an axis of the base and one of the output by no more than that.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.random import default_rng
from scipy.spatial.transform import Rotation

import spherekit as sk
from spherekit.cli.main import main
from spherekit.geometry.vectors import unit_rows
from spherekit.outputs.nearest_pose import NearestPoseSearch, NormalCoordinates
from spherekit.outputs.pose_constraints import Constraints, bounds_of
from spherekit.outputs.pose_rows import JointRange
from spherekit.outputs.pose_solver import output_kinematics
from spherekit.outputs.workspace import judge, nearest_in_mode, nearest_poses

WRIST = str(Path(__file__).parent / "files" / "coaxial_wrist.toml")
DEGREE = np.pi / 180.0


def random_poses(random, count, points):
    """Return evenly random points (count, 3), or unit quaternions (count, 4) otherwise."""
    return unit_rows(random.normal(size=(count, 3 if points else 4)))


def random_poses_within(random, pose, angle, count):
    """Return random poses whose angle from `pose` is less than `angle` (rad).

    `pose` is a point (3,) or a unit quaternion (4,). Rotation vectors are evenly spread in
    a disc or a ball, hence the square or cubic root of even random numbers.
    """
    axes = unit_rows(random.normal(size=(count, 3)))
    if len(pose) == 3:
        axes = unit_rows(np.cross(axes, pose))
        angles = angle * np.sqrt(random.random((count, 1)))
        return Rotation.from_rotvec(angles * axes).apply(pose)
    angles = angle * np.cbrt(random.random((count, 1)))
    return (Rotation.from_rotvec(angles * axes) * Rotation.from_quat(pose)).as_quat()


def angle_between(pose, second_pose):
    """Return the arc between two points (3,) or the angle between two quaternions (4,)."""
    if len(pose) == 3:
        sine = np.linalg.norm(np.cross(pose, second_pose))
        return np.arctan2(sine, pose @ second_pose)
    return (Rotation.from_quat(pose).inv() * Rotation.from_quat(second_pose)).magnitude()


def check_nearest(kinematics, bounds, signs, count, seed=0, tries=40_000):
    """Assert that the poses that are offered instead of unreachable ones are the nearest.

    The asked poses are the first `count` unreachable ones of 4000 random poses: points on
    the sphere if the output is a direction (`kinematics.points`), else orientations.
    `judge` says which poses are reachable in the working mode `signs` (way to bend each
    leg) and within `bounds`. The offered pose has to be reachable. None of `tries` random
    poses that are nearer to the asked one may be reachable. Returns the asked poses, and
    the angles (rad) between each of them and the offered one.
    """
    random = default_rng(seed)
    asked_poses = random_poses(random, 4000, kinematics.points)
    is_reachable = judge(kinematics, bounds, signs, asked_poses).inside
    asked_poses = asked_poses[~is_reachable][:count]
    assert len(asked_poses) == count

    offers = nearest_in_mode(kinematics, bounds, signs, asked_poses)
    angles = []
    for asked_pose, (offered_pose, angle) in zip(asked_poses, offers, strict=True):
        assert judge(kinematics, bounds, signs, offered_pose[None]).inside[0]
        assert angle_between(asked_pose, offered_pose) == pytest.approx(angle, abs=1e-8)
        # The factor keeps rounding of the boundary out of the comparison.
        nearer_angle = angle * (1.0 - 1e-7)
        nearer = random_poses_within(random, asked_pose, nearer_angle, tries)
        assert not judge(kinematics, bounds, signs, nearer).inside.any()
        angles.append(angle)
    return asked_poses, np.array(angles)


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize(
    ("name", "mode", "count"),
    [
        (WRIST, 0, 4),
        pytest.param(WRIST, 5, 25, marks=pytest.mark.slow),
        pytest.param("three_rrr", 0, 25, marks=pytest.mark.slow),
        pytest.param("three_rrr", 6, 12, marks=pytest.mark.slow),
        ("five_bar", 0, 4),
        pytest.param("five_bar", 1, 25, marks=pytest.mark.slow),
    ],
)
def test_the_nearest_reachable_pose_is_compared_with_random_poses_and_the_reach_of_legs(
    name, mode, count
):
    """No random pose is nearer than the offered one, and no leg allows a nearer one.

    `check_nearest` asks for `count` poses that cannot be reached, and tries 40 000 random
    poses near each. Without joint limits, a pose cannot be reached because an axis of the
    output is too near or too far for a leg. The arc by which it is too near or too far (the
    negative margin) is a lower bound of the angle between asked and offered pose. The angle
    is equal to this bound for poses at which one leg alone decides. `mode` is the number of
    the working mode (way to bend each leg).
    """
    kinematics = output_kinematics(sk.load(name))
    bounds = kinematics.bounds
    signs = kinematics.modes[mode]
    poses, angles = check_nearest(kinematics, bounds, signs, count)
    missing_arcs = -judge(kinematics, bounds, signs, poses).margin
    assert np.all(angles > missing_arcs - 1e-9)
    assert np.any(angles < missing_arcs + 1e-8)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "limits", "near"),
    [
        (WRIST, {"m1": (-40, 50), "w2": (-60, 80)}, 0),
        (WRIST, {}, 15),
        (WRIST, {"m1": (-40, 50)}, 10),
        ("agile_eye", {}, 20),
        ("three_rrr", {}, 10),
        ("five_bar", {"21": (-40, 60)}, 15),
        ("five_bar", {"21": (-40, 60), "51": (-50, 70)}, 0),
    ],
)
def test_no_random_pose_within_joint_limits_is_nearer(name, limits, near):
    """Nearest poses obey joint limits and keep away from singularities.

    `limits` are the ranges of joint angles by pair, and `near` is the least angle from a
    singularity, both in degrees. Margins of limits have no value where a leg cannot reach,
    so the search cannot follow them from outside; random poses check its result.
    """
    kinematics = output_kinematics(sk.load(name))
    ranges = tuple(
        JointRange(pair, low * DEGREE, high * DEGREE)
        for pair, (low, high) in limits.items()
    )
    bounds = bounds_of(kinematics, Constraints(limits=ranges, near=near * DEGREE))
    check_nearest(kinematics, bounds, kinematics.modes[0], 6, tries=25_000)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_wrists_of_random_sizes(seed):
    random = default_rng(seed)
    made = sk.load("three_rrr")
    arcs = {
        link: np.degrees(sizes.arcs[0]) + random.uniform(-25.0, 25.0)
        for link, sizes in made.geometry.links.items()
        if len(sizes.arcs) == 1
    }
    kinematics = output_kinematics(made.with_sizes(angle_unit="deg", arcs=arcs))
    mode = kinematics.modes[random.integers(8)]
    check_nearest(kinematics, kinematics.bounds, mode, 5, seed, tries=25_000)


@pytest.mark.many
@pytest.mark.parametrize(
    "analysis", ["inverse_kinematics:poses", "workspace:tolerance=0.5,pose"]
)
def test_the_command_offers_the_nearest(analysis, capsys):
    """A neck's wrist is 0.905 deg from its border, where a rod is stretched.

    0.905 deg is the arc between the axes of the leg, less that of the stretched leg: the
    reach of the other legs does not matter there.
    """
    text = f"{analysis}=azimuth=90+tilt=70+torsion=-90,working_mode=+++"
    main(["run", WRIST, "-a", text])
    said = capsys.readouterr()
    assert "0.9052 deg away" in said.out + said.err


def test_nothing_is_offered_where_nothing_is_reached():
    kinematics = output_kinematics(sk.load("five_bar"))
    ranges = (
        JointRange("21", -40 * DEGREE, 60 * DEGREE),
        JointRange("51", -50 * DEGREE, 70 * DEGREE),
    )
    bounds = bounds_of(kinematics, Constraints(limits=ranges))
    pose = np.array([[1.0, 0.0, 0.0]])
    assert nearest_in_mode(kinematics, bounds, kinematics.modes[1], pose) == [None]


@dataclass(frozen=True)
class UnreachablePoint:
    """A point whose pose is unreachable, and which a search moves until it is reachable.

    An earlier search began at a start pose, moved along a line towards the pose that was
    asked for, and ended at an unreachable point. The point is now moved back along
    this line. All numbers are distances (rad) from the asked pose along this line.

    Attributes
    ----------
    distance
        Distance of the point before the search moves it back.
    start
        Distance of the start pose. The point is moved at most to this distance.
    reachable_beyond
        Poses at larger distances than this one are reachable.
    """

    distance: float
    start: float
    reachable_beyond: float

    @property
    def can_reach(self):
        """Whether a reachable pose is between the point and the start."""
        return self.reachable_beyond < self.start


@pytest.mark.parametrize("dimension", [2, 3], ids=["on the sphere", "orientations"])
@pytest.mark.parametrize(
    "points",
    [
        (UnreachablePoint(0.1, 1.0, 0.8), UnreachablePoint(0.2, 0.3, 0.21)),
        (UnreachablePoint(0.2, 0.3, 0.21), UnreachablePoint(0.1, 1.0, 0.8)),
        (UnreachablePoint(0.1, 1.0, 0.8), UnreachablePoint(0.15, 0.9, 0.85)),
        (UnreachablePoint(0.1, 0.9, 0.3), UnreachablePoint(0.4, 0.5, 0.41)),
        # The first point finds no reachable pose up to its start.
        (UnreachablePoint(0.1, 1.0, 1.5), UnreachablePoint(0.2, 0.3, 0.25)),
    ],
)
def test_the_nearest_of_two_points_that_are_moved_back_to_reachable_poses_is_returned(
    dimension, points
):
    """Two points are moved to reachable poses; the one nearer to the target is returned.

    The target is the pose that was asked for, and is not reachable. Two searches moved
    towards it, each along a line from its own start, and ended at unreachable points.
    `_move_inside` moves each point back along its line until its pose is reachable, at most
    to the start. `UnreachablePoint` states this line by distances (rad) from the target. On
    the line all poses at larger distances than `reachable_beyond` are reachable.

    A pose has coordinates about the target: 2 for points on the sphere, 3 for orientations.
    Their length is the distance from the target. Each line is a coordinate axis. A point
    cannot be moved to a reachable pose if `reachable_beyond` is larger than the distance of
    the start. Otherwise `reachable_beyond` is the distance at which the move ends. The
    smaller one of both points is expected.
    """
    chart = NormalCoordinates.around(np.eye(dimension + 1)[0])
    limits = np.array([point.reachable_beyond for point in points])

    def is_reachable(poses):
        """Return whether poses, each on one of both lines, are beyond the line's limit."""
        coordinates = np.abs(chart.coordinates(poses))
        distances = np.max(coordinates, axis=1)
        axis = np.argmax(coordinates[:, :2], axis=1)
        return distances > limits[axis]

    def zero_margins(poses):
        """Return margins (n, 1) to a limit of the workspace, zero everywhere.

        A margin says how much is left to a limit. `_move_inside` first tries to move a
        point along the gradients of the margins. Here the gradients are zero, so it moves
        the point back towards its start.
        """
        return np.zeros((len(poses), 1))

    search = NearestPoseSearch(zero_margins, is_reachable)
    # One coordinate axis for each of both points.
    axes = np.eye(dimension)[:2]
    unreachable = np.array([[point.distance] for point in points]) * axes
    starts = np.array([[point.start] for point in points]) * axes
    nearest = search._move_inside(chart, unreachable, starts)

    expected_distance = min(point.reachable_beyond for point in points if point.can_reach)
    assert expected_distance <= np.linalg.norm(nearest) < expected_distance + 1e-8
    axis_of_nearest = np.argmax(np.abs(nearest))
    assert points[axis_of_nearest].reachable_beyond == expected_distance


def test_the_coordinates_of_the_opposite_direction_have_the_length_pi():
    centre = unit_rows(np.array([0.3, -0.5, 0.8]))
    for axis in (centre, np.array([0.0, 0.0, 1.0])):
        chart = NormalCoordinates.around(axis)
        coordinates = chart.coordinates(-axis[None])
        assert np.linalg.norm(coordinates) == pytest.approx(np.pi, abs=1e-15)
        assert np.allclose(chart.poses(coordinates), -axis, atol=1e-15)


def test_the_opposite_quaternion_has_the_coordinates_zero():
    identity = np.array([0.0, 0.0, 0.0, 1.0])
    chart = NormalCoordinates.around(identity)
    assert np.array_equal(chart.coordinates(-identity[None]), np.zeros((1, 3)))


def test_nearest_poses_of_integer_directions_are_those_of_floats():
    """A leg reaches 150 deg from each driven axis (z and y), so 30 deg are missing."""
    kinematics = output_kinematics(sk.load("five_bar"))
    opposite_axes = np.array([[0, 0, -1], [0, -1, 0]])
    nearest, angles = nearest_poses(kinematics, opposite_axes, kinematics.modes[0])
    assert angles == pytest.approx(30.0 * DEGREE)
    for pose, opposite_axis in zip(nearest, opposite_axes, strict=True):
        assert angle_between(pose, opposite_axis) == pytest.approx(30.0 * DEGREE)


@pytest.mark.parametrize("name", ["five_bar", "agile_eye"])
def test_a_pose_that_is_not_finite_has_no_nearest_pose(name):
    kinematics = output_kinematics(sk.load(name))
    length = 3 if kinematics.points else 4
    poses = np.full((2, length), np.nan)
    poses[1] = np.inf
    nearest, angles = nearest_poses(kinematics, poses, kinematics.modes[0])
    assert nearest.shape == poses.shape
    assert np.all(np.isnan(nearest))
    assert np.all(np.isnan(angles))
