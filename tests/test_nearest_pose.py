"""The nearest reachable pose, against random poses and against the reach of single legs.

A random pose that is reachable is never nearer than the one that is called the nearest. No
pose is nearer than the largest violation of the reach of a leg: a rotation by an angle
changes the arc between an axis of the base and one of the output by no more than that.
"""

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
from spherekit.outputs.workspace import judge, nearest_in_mode

WRIST = str(Path(__file__).parent / "files" / "coaxial_wrist.toml")
DEGREE = np.pi / 180.0


def random_poses(random, count, points):
    return unit_rows(random.normal(size=(count, 3 if points else 4)))


def within(random, pose, angle, count):
    """Return random poses whose angle from one is less, evenly in rotation vectors."""
    axes = unit_rows(random.normal(size=(count, 3)))
    if len(pose) == 3:
        axes = unit_rows(np.cross(axes, pose))
        angles = angle * np.sqrt(random.random((count, 1)))
        return Rotation.from_rotvec(angles * axes).apply(pose)
    angles = angle * np.cbrt(random.random((count, 1)))
    return (Rotation.from_rotvec(angles * axes) * Rotation.from_quat(pose)).as_quat()


def angle_between(one, other):
    if len(one) == 3:
        return np.arctan2(np.linalg.norm(np.cross(one, other)), one @ other)
    return (Rotation.from_quat(one).inv() * Rotation.from_quat(other)).magnitude()


def check_nearest(kinematics, bounds, signs, count, seed=0, tries=40_000):
    """Check the nearest poses to `count` random ones; return the angles to them."""
    random = default_rng(seed)
    poses = random_poses(random, 4000, kinematics.points)
    poses = poses[~judge(kinematics, bounds, signs, poses).inside][:count]
    assert len(poses) == count
    angles = []
    offers = nearest_in_mode(kinematics, bounds, signs, poses)
    for pose, (there, angle) in zip(poses, offers, strict=True):
        assert judge(kinematics, bounds, signs, there[None]).inside[0]
        assert angle_between(pose, there) == pytest.approx(angle, abs=1e-8)
        nearer = within(random, pose, angle * (1.0 - 1e-7), tries)
        assert not judge(kinematics, bounds, signs, nearer).inside.any()
        angles.append(angle)
    return poses, np.array(angles)


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
def test_no_reachable_pose_is_nearer(name, mode, count):
    """Under the reach of the legs alone, where a lower bound of the angle is known."""
    kinematics = output_kinematics(sk.load(name))
    bounds, signs = kinematics.bounds, kinematics.modes[mode]
    poses, angles = check_nearest(kinematics, bounds, signs, count)
    violated = -judge(kinematics, bounds, signs, poses).margin
    assert np.all(angles > violated - 1e-9)
    assert np.any(angles < violated + 1e-8)


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
def test_no_pose_within_limits_is_nearer(name, limits, near):
    """With joint limits, whose margins have no value out of reach, or off singularities."""
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


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize(
    ("points", "starts", "arcs"),
    [
        ([0.1, 0.2], [1.0, 0.3], [0.8, 0.21]),
        ([0.2, 0.1], [0.3, 1.0], [0.21, 0.8]),
        ([0.1, 0.15], [1.0, 0.9], [0.8, 0.85]),
        ([0.1, 0.4], [0.9, 0.5], [0.3, 0.41]),
        ([0.1, 0.2], [1.0, 0.3], [1.5, 0.25]),
    ],
)
def test_of_points_that_are_moved_inside_the_nearest_is_returned(
    dimension, points, starts, arcs
):
    """Two points have long ways back to their starts, on axes of their own.

    On axis k poses are reachable beyond `arcs[k]`, so that is the arc of the moved point.
    """
    chart = NormalCoordinates.around(np.eye(dimension + 1)[0])

    def is_inside(poses):
        v = np.abs(chart.coordinates(poses))
        axis = np.argmax(v[:, :2], axis=1)
        return np.max(v, axis=1) > np.array(arcs)[axis]

    search = NearestPoseSearch(lambda poses: np.zeros((len(poses), 1)), is_inside)
    axes = np.eye(dimension)[:2]
    moved = search._move_inside(
        chart, np.array(points)[:, None] * axes, np.array(starts)[:, None] * axes
    )
    reachable = [arc for arc, start in zip(arcs, starts, strict=True) if arc < start]
    assert min(reachable) <= np.linalg.norm(moved) < min(reachable) + 1e-8
    assert np.argmax(np.abs(moved)) == arcs.index(min(reachable))
