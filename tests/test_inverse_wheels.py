"""Inverse kinematics of wrists whose wheels count the turns of their inputs."""

from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import spherekit as sk
from spherekit.errors import AnalysisError
from spherekit.geometry.sphere_mesh import spiral_directions
from spherekit.outputs.pose_solver import output_kinematics
from spherekit.plugin.rotations import from_tilt_torsion

RATIO = 1.5
"""Ratio of the teeth of a side gear to those of the hand's gear."""
SIDE_HALF_ANGLE_DEG = float(np.degrees(np.arctan(RATIO)))
"""Half angle of the cone of a side gear. That of the hand's gear is its complement."""
TILT_TORSION_RAD = np.random.default_rng(4).uniform(
    [-3.0, 0.2, -3.0], [3.0, 2.9, 3.0], (12, 3)
)
"""(12, 3) azimuth, tilt and torsion of random poses."""


@pytest.fixture(scope="module")
def wrist():
    """Return a wrist with a bevel differential whose inputs are yaw and two side gears.

    A column yaws about z on the base. The axles of both side gears and of the cage are the
    y axis of the column. The hand is the planet gear of the differential and rolls about
    the x axis of the cage. The angles of the inputs may exceed a whole turn. Pairs of type
    R are revolute joints, those of type Cr gears in mesh, with pitch circles on the sphere.
    """
    pair_ends_and_axes = {
        "yaw": ("base", "column", [0.0, 0.0, 1.0]),
        "left_axle": ("column", "left", [0.0, 1.0, 0.0]),
        "right_axle": ("column", "right", [0.0, 1.0, 0.0]),
        "pitch": ("column", "cage", [0.0, 1.0, 0.0]),
        "roll": ("cage", "hand", [1.0, 0.0, 0.0]),
    }
    pairs = {
        name: {"type": "R", "links": [first_link, second_link], "xyz": axis}
        for name, (first_link, second_link, axis) in pair_ends_and_axes.items()
    }
    hand_circle = {
        "kind": "circle",
        "centre_xyz": [1.0, 0.0, 0.0],
        "radius": 90.0 - SIDE_HALF_ANGLE_DEG,
    }
    for gear, side in (("left", 1.0), ("right", -1.0)):
        gear_circle = {
            "kind": "circle",
            "centre_xyz": [0.0, side, 0.0],
            "radius": SIDE_HALF_ANGLE_DEG,
        }
        pairs[f"{gear}_mesh"] = {
            "type": "Cr",
            "links": [gear, "hand"],
            "profiles": {gear: gear_circle, "hand": hand_circle},
        }
    return sk.build(
        "differential_wrist",
        angle_unit="deg",
        ground="base",
        links={n: {} for n in ("base", "column", "left", "right", "cage", "hand")},
        pairs=pairs,
        inputs={name: {} for name in ("yaw", "left_axle", "right_axle")},
        outputs={"hand": {"link": "hand"}},
    )


def hand_rotation(inputs):
    """Return the rotation (3, 3) of the hand by the formula of a bevel differential.

    `inputs` are yaw, left and right gear angle (rad). The hand pitches by the mean of both
    side gears and rolls by half their difference times the ratio of teeth.
    """
    yaw, left, right = inputs
    pitch = 0.5 * (left + right)
    roll = -0.5 * RATIO * (left - right)
    return Rotation.from_euler("ZYX", (yaw, pitch, roll)).as_matrix()


def test_forward_kinematics_of_the_wrist_match_the_formula_of_the_differential(wrist):
    """Random inputs over three turns have one pose each, that of `hand_rotation`."""
    forward = sk.ForwardKinematics(wrist)
    inputs = np.random.default_rng(3).uniform(-9.0, 9.0, (20, 3))
    poses = forward.solutions(inputs)
    assert np.all(poses.row == np.arange(20))
    expected = np.array([hand_rotation(q) for q in inputs])
    assert np.max(np.abs(poses.rotations - expected)) < 1e-12


@pytest.mark.slow
def test_inverse_kinematics_turn_the_side_gears_as_little_as_possible(wrist):
    """Inverse kinematics of the wrist has the pose, with the least turns of both gears.

    The wrist has the angles yaw, pitch and roll, so each pose has two solutions, with
    opposite signs of cos(pitch). `hand_rotation`, the formula of the differential, returns
    the pose of the inputs. A full turn of pitch adds 2 pi to both gears and does not change
    the pose. A full turn of roll adds 2 pi / ratio to one gear and subtracts it from the
    other. No combination of up to four such turns has a smaller sum of both gear angles.
    """
    poses = from_tilt_torsion(TILT_TORSION_RAD)
    inverse = sk.InverseKinematics(wrist).solutions(poses)
    assert np.all(np.bincount(inverse.row) == 2)
    turns = np.array(list(product(range(-4, 5), repeat=2))) * 2.0 * np.pi
    pitch_turn = turns[:, 0]
    roll_turn = turns[:, 1] / RATIO
    for row, inputs in zip(inverse.row, inverse.inputs, strict=True):
        assert np.max(np.abs(hand_rotation(inputs) - poses[row])) < 1e-11
        _, left, right = inputs
        equivalent_left = left + pitch_turn + roll_turn
        equivalent_right = right + pitch_turn - roll_turn
        gear_angles = np.abs(equivalent_left) + np.abs(equivalent_right)
        assert abs(left) + abs(right) < np.min(gear_angles) + 1e-9


def geared_gimbal(has_roll, pan_teeth=(20, 50), pan_motor_deg=0.0):
    """Return a pan-tilt or pan-tilt-roll mechanism whose axes are driven by pinions.

    Each pinion is mounted on the carrier of its axis. The motor pair `m_pan` drives pinion
    `p_pan`, which meshes (pair `g_pan`) with the yoke that turns about `pan`; likewise
    `tilt` and `roll`. The output is a direction of the cage without roll and the pose of
    the tool with it. In the reference pose, `m_pan` has the value `pan_motor_deg`.
    """
    axis_directions = {
        "pan": [0.0, 0.0, 1.0],
        "tilt": [0.0, 1.0, 0.0],
        "roll": [1.0, 0.0, 0.0],
    }
    # The shaft of a pinion is perpendicular to the axis that it drives.
    shaft_directions = {
        "pan": axis_directions["roll"],
        "tilt": axis_directions["pan"],
        "roll": axis_directions["tilt"],
    }
    teeth = {"pan": list(pan_teeth), "tilt": [17, 40], "roll": [15, 30]}
    axis_names = ["pan", "tilt", "roll"] if has_roll else ["pan", "tilt"]
    links = ["base", "yoke", "cage", "tool"][: len(axis_names) + 1]
    pairs = {}
    for name, carrier, moved_link in zip(axis_names, links, links[1:], strict=False):
        pairs[name] = {
            "type": "R",
            "links": [carrier, moved_link],
            "xyz": axis_directions[name],
        }
        pairs[f"m_{name}"] = {
            "type": "R",
            "links": [carrier, f"p_{name}"],
            "xyz": shaft_directions[name],
        }
        pairs[f"g_{name}"] = {
            "type": "Cr",
            "links": [f"p_{name}", moved_link],
            "teeth": teeth[name],
            "axes": [f"m_{name}", name],
        }
    pairs["m_pan"]["value"] = pan_motor_deg
    output = {"link": "tool"} if has_roll else {"link": "cage", "xyz": [1.0, 0.0, 0.0]}
    return sk.build(
        "gimbal",
        angle_unit="deg",
        ground="base",
        links=[*links, *(f"p_{name}" for name in axis_names)],
        pairs=pairs,
        inputs={f"m_{name}": {} for name in axis_names},
        outputs={"tool": output},
    )


@pytest.mark.many
@pytest.mark.parametrize("mechanism_name", ["differential", "pan_tilt", "pan_tilt_roll"])
def test_closed_form_inverse_kinematics_match_the_general_solver(mechanism_name, wrist):
    """The closed form of inverse kinematics agrees with the general numerical solver.

    The closed form solves dyads (two links joined by a pair). It has two solutions for each
    pose. Inputs that differ by whole turns of the wheels can lead to the same pose, and the
    solvers may return different ones. So not every solution of the closed form needs a
    partner with equal inputs (rad) among those of the general solver. At least as many as
    there are poses must have one, so that the comparison is not empty. Partners must have
    equal rates of the inputs per rate of the output, and equal measures of singularities of
    types I and II. Forward kinematics of the closed form must lead back to all poses.
    """
    if mechanism_name == "differential":
        mechanism = wrist
    else:
        mechanism = geared_gimbal(has_roll=mechanism_name == "pan_tilt_roll")
    closed_form = output_kinematics(mechanism)
    general = output_kinematics(mechanism, graph=True)
    assert closed_form.solved_by == "dyads"
    assert general.solved_by == "graph"
    # The output is the direction of a pointer, or else an orientation.
    is_pointer = closed_form.points
    if is_pointer:
        poses = spiral_directions(6)
    else:
        # Orientations from four triples of azimuth, tilt and torsion.
        poses = from_tilt_torsion(TILT_TORSION_RAD[:4])
    all_pairs = range(len(mechanism.pairs))
    # The labels are those of all working modes (ways to assemble the links at a pose).
    solutions = closed_form.inverse(poses, closed_form.labels, all_pairs)
    references = general.inverse(poses, general.labels, all_pairs)
    assert len(solutions) == 2 * len(poses)
    assert np.all(solutions.status == sk.Status.OK)

    matched = 0
    for k in range(len(solutions)):
        distance = np.abs(references.inputs - solutions.inputs[k]).max(axis=1)
        distance[references.pose != solutions.pose[k]] = np.inf
        nearest = int(np.argmin(distance))
        if distance[nearest] < 1e-9:
            matched += 1
            for quantity in ("type_1", "type_2", "rates"):
                value = getattr(solutions, quantity)[k]
                error = np.max(np.abs(getattr(references, quantity)[nearest] - value))
                assert error < 1e-9 * (1.0 + np.max(np.abs(value)))
    assert matched >= len(poses)

    assert np.max(closed_form.residual(solutions.values)) < 1e-12
    forward = closed_form.forward(solutions.inputs)
    outputs = forward.directions if is_pointer else forward.rotations
    # For each output, `row` is the index of the solution from whose inputs it is computed.
    poses_of_outputs = poses[solutions.pose[forward.row]]
    assert np.max(np.abs(outputs - poses_of_outputs)) < 1e-11


@pytest.mark.slow
def test_workspace_of_the_wrist_near_a_working_mode_has_no_failures(wrist):
    run = sk.run(wrist, "workspace:tolerance=0.3,working_mode=0,near=5")
    assert not run.failures  # the yaw does not move the hand's other carriers


def test_workspace_of_a_geared_pan_tilt_is_a_zone_of_half_the_sphere():
    """With tilt limited to 30 degrees it points at latitudes from -30 to 30 degrees.

    The area of this zone on the unit sphere is 2 pi (1 + 1) sin 30 deg = 2 pi.
    """
    run = sk.run(
        geared_gimbal(has_roll=False), "workspace:limits=tilt:-30:30,tolerance=1e-4"
    )
    areas = run.frame("workspace", "areas")
    whole = areas[areas["part"] == "whole"]
    assert np.min(np.abs(whole["size"] - 2.0 * np.pi)) < 1e-3


def test_workspace_limits_at_the_pair_of_a_wheel_are_refused():
    with pytest.raises(AnalysisError, match="limits: m_pan is the pair of a wheel"):
        sk.run(geared_gimbal(has_roll=False), "workspace:limits=m_pan:-30:30")


def test_general_inverse_kinematics_have_both_solutions_of_a_pinion_on_a_large_wheel():
    """Inverse kinematics of a geared pan-tilt has two solutions for the pan motor.

    The output has to point to the longitude 150 deg. The yoke turns to this longitude, or
    to the opposite one, -30 deg. Then the tilt carries the output over the pole (axis of
    the yoke) to the wanted side. A pinion with 20 teeth drives the yoke, which has 400
    teeth. So the pinion turns by -20 times the angle of the yoke. The `general` inverse
    kinematics is the one that `graph=True` selects.
    """
    mechanism = geared_gimbal(has_roll=False, pan_teeth=(20, 400))
    general = output_kinematics(mechanism, graph=True)
    longitude, latitude = np.radians([150.0, 20.0])
    direction = [
        np.cos(latitude) * np.cos(longitude),
        np.cos(latitude) * np.sin(longitude),
        np.sin(latitude),
    ]
    solutions = general.inverse(np.array([direction]), general.labels, [])
    pinion_deg = np.sort(np.degrees(solutions.inputs[:, 0]))
    assert pinion_deg == pytest.approx([-20.0 * 150.0, -20.0 * (150.0 - 180.0)])


def pan_directions(longitudes_deg):
    """Return directions (n, 3) at the latitude of 20 degrees."""
    longitudes = np.radians(longitudes_deg)
    latitude = np.radians(20.0)
    return np.column_stack(
        [
            np.cos(latitude) * np.cos(longitudes),
            np.cos(latitude) * np.sin(longitudes),
            np.full(len(longitudes), np.sin(latitude)),
        ]
    )


@pytest.mark.parametrize("wheel_teeth", [520, 1000])
def test_general_inverse_kinematics_find_pinions_after_any_number_of_revolutions(
    wheel_teeth,
):
    """The pinion with 20 teeth turns back by the ratio times the angle of the yoke.

    The yoke turns to the longitude of 179 degrees, or to -1 degree with the tilt beyond the
    pole. The first solution needs more than 12 revolutions of the pinion.
    """
    mechanism = geared_gimbal(has_roll=False, pan_teeth=(20, wheel_teeth))
    solutions = sk.InverseKinematics(mechanism).solutions(pan_directions([179.0]))
    ratio = wheel_teeth / 20.0
    pinion_deg = np.sort(np.degrees(solutions.inputs[:, 0]))
    assert pinion_deg == pytest.approx([-ratio * 179.0, ratio])


def test_general_inverse_kinematics_find_many_revolutions_of_one_of_two_coaxial_inputs():
    """A sun with 20 teeth drives a planet with 1200 teeth, whose axis is on a driven arm.

    The planet's direction is requested at the latitude of 20 degrees. It has the longitude
    of the arm, or the opposite one with the planet beyond the pole. Per degree of the
    planet, the sun turns by 60 degrees relative to the arm.

    If arm and sun make a revolution together, the direction is the same. Solutions are the
    inputs with the smallest sum of absolute values. Several pairs of inputs can have this
    sum, but the angle of the sun relative to the arm is the same for all of them. So only
    this angle is compared.
    """
    axes = {"arm_axle": [0.0, 0.0, 1.0], "sun_axle": [0.0, 0.0, 1.0]}
    axes["planet_axle"] = [0.0, 1.0, 0.0]
    ends = {"arm_axle": ["base", "arm"], "sun_axle": ["base", "sun"]}
    ends["planet_axle"] = ["arm", "planet"]
    pairs = {n: {"type": "R", "links": ends[n], "xyz": xyz} for n, xyz in axes.items()}
    pairs["mesh"] = {
        "type": "Cr",
        "links": ["sun", "planet"],
        "teeth": [20, 1200],
        "axes": ["sun_axle", "planet_axle"],
    }
    mechanism = sk.build(
        "sun_planet",
        angle_unit="deg",
        ground="base",
        links=["base", "arm", "sun", "planet"],
        pairs=pairs,
        inputs={"arm_axle": {}, "sun_axle": {}},
        outputs={"planet": {"link": "planet", "xyz": [1.0, 0.0, 0.0]}},
    )
    solutions = sk.InverseKinematics(mechanism).solutions(pan_directions([150.0]))
    arm_deg, sun_deg = np.degrees(solutions.inputs).T
    # The planet is turned by 20 degrees on the arm, or by 160 degrees beyond the pole.
    assert np.sort(sun_deg - arm_deg) == pytest.approx([60.0 * 20.0, 60.0 * 160.0])


@pytest.mark.parametrize(
    ("anchor_deg", "pan_teeth"), [(3600.0, (20, 50)), (720.0, (50, 20))]
)
def test_general_inverse_kinematics_are_smallest_with_any_turns_in_the_reference_pose(
    anchor_deg, pan_teeth
):
    """Solutions are those of a motor at zero if it is at whole periods of the wheels.

    In the reference pose the motor has the value `anchor_deg`. A period of the wheels is
    the smallest number of revolutions of the motor after which both wheels are as before.
    """
    mechanism = geared_gimbal(False, pan_teeth, pan_motor_deg=anchor_deg)
    solutions = sk.InverseKinematics(mechanism).solutions(pan_directions([100.0]))
    ratio = pan_teeth[1] / pan_teeth[0]
    pinion_deg = np.sort(np.degrees(solutions.inputs[:, 0]))
    assert pinion_deg == pytest.approx([-ratio * 100.0, ratio * 80.0])
