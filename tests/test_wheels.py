"""Wheels over several turns: the assembly does not depend on where the input range starts.

The independent side is a closed form. Of two wheels on fixed axes the second turns back by
the ratio of teeth. The other loop, over both cranks and two couplers, closes where the
distance between the crank tips is one that the couplers can span.
"""

from dataclasses import replace

import numpy as np
import pytest
from cross_checks.mechanisms import random_subject
from helpers.hypothesis_strategies import MECHANISMS
from helpers.refusals import mechanism_text
from scipy.spatial.transform import Rotation

import spherekit as sk
from spherekit.completeness import Guarantee
from spherekit.dynamics.inverse_dynamics import inverse_dynamics
from spherekit.dynamics.simulation_start import prepare
from spherekit.files.mechanism_reader import loads
from spherekit.files.study import Start
from spherekit.files.time_law import ConstantSpeed
from spherekit.mechanism.bevel_gears import pitch_angles
from spherekit.mechanism.elements import Input, Pair, PoseGeometry, Profile
from spherekit.mechanism.inertia import Mass
from spherekit.mechanism.load_kinds import PairTorque
from spherekit.outputs.forward_kinematics import ForwardKinematics
from spherekit.planning.least_rolling import find_least_rolled_turns
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.runs.completeness_text import describe_completeness
from spherekit.status import Status

DEGREE = np.pi / 180.0
BASE = 75.0
LEFT = 40.0
COUPLERS = (60.0, 55.0)
RIGHT = 35.0
"""Arcs (deg) of the geared five-bar: base, left crank, both couplers, right crank."""
FIVE_BAR = mechanism_text("geared_five_bar_wheels")
SECOND_PLANET = mechanism_text("wheels_second_planet")
MASS = Mass("3", ((2.0, 0.1, 0.0), (0.1, 1.5, 0.2), (0.0, 0.2, 1.0)))
"""Inertia tensor (kg m2) of link 3, for tests of dynamics."""


def geared_five_bar(folder, teeth, span):
    """Return the five-bar whose cranks carry wheels that mesh.

    Parameters
    ----------
    teeth
        Numbers of teeth of the left and the right wheel.
    span
        Range of the input, the left crank, in degrees.
    """
    path = folder / "geared.toml"
    path.write_text(FIVE_BAR.format(*teeth, *span))
    return sk.load(path)


def test_all_modes_of_a_linkage_on_wheels_are_found(tmp_path):
    mechanism = geared_five_bar(tmp_path, teeth=(20, 30), span=(0.0, 360.0))
    position_analysis = PositionAnalysis(mechanism, samples=25)
    assert position_analysis.claim.guarantee is Guarantee.COMPLETE
    assert position_analysis.configurations.guarantee is Guarantee.COMPLETE
    assert not position_analysis.configurations.mismatches


def test_wheels_of_an_irrational_ratio_never_return(tmp_path):
    """The period of an input is infinite if its wheels never return to their positions.

    The cranks of this five-bar have smooth wheels with an irrational ratio. At two inputs
    that differ by a whole turn, the right crank therefore has different positions. The
    range of the input is two turns. A sample must have only the configurations of its own
    input, and not those at the input that is one turn away. Each sample has at most two
    configurations, because there are two ways to assemble the couplers.

    The left wheel is a cone with the half angle 57 deg. That of the right wheel is the rest
    of the arc of 75 deg between both axes. On the unit sphere, the circle of the left wheel
    has the radius sin(57 deg) about its axis. So the length that the wheels have rolled,
    the variable of the pair `mesh`, changes by this radius per rad of the input. The length
    decreases as the input increases: while the left wheel turns forwards, the point of
    contact moves backwards along its circle.
    """
    path = tmp_path / "irrational.toml"
    text = FIVE_BAR.replace("teeth = [{0}, {1}]", "half_angles = [57.0]")
    # Fields 0 and 1 are numbers of teeth, which are not in this text. Fields 2 and 3 are
    # the range of the input (deg).
    unused = 0
    path.write_text(text.format(unused, unused, 0.0, 720.0))
    mechanism = sk.load(path)
    position_analysis = PositionAnalysis(mechanism, samples=25)
    assert np.isinf(position_analysis.solver.periods[0])

    motion = position_analysis.motion()
    is_ok = motion.status == Status.OK
    (mesh,) = mechanism.variables_of(mechanism.pair_number["mesh"])
    rolled = motion.values[is_ok, mesh] + np.sin(57.0 * DEGREE) * motion.q[is_ok]
    assert np.ptp(rolled) < 1e-9
    _, configurations_per_sample = np.unique(motion.sample[is_ok], return_counts=True)
    assert np.max(configurations_per_sample) == 2


def test_three_wheels_return_after_a_common_multiple_of_turns():
    """Teeth 17 : 23 and 19 : 31 are in the same position after 23 times 31 turns."""
    wheels = PositionAnalysis(loads(mechanism_text("three_wheels")), samples=1)
    assert wheels.solver.periods[0] == pytest.approx(23 * 31 * 2.0 * np.pi)


def right_crank_angle(q, teeth):
    """Return the angle (deg) of the right crank at an angle q (deg) of the left one.

    Both read 90 degrees where nothing has rolled: the contact then lies at azimuth 0, and
    the arcs of both cranks are 90 degrees on from there.
    """
    return 90.0 - (q - 90.0) * teeth[0] / teeth[1]


def crank_tip(axis, zero_direction, angle, arc):
    """Return the tips (n, 3) of a crank in the ground frame.

    Parameters
    ----------
    axis, zero_direction
        Unit vector (3,) of the crank's axis, and the one across it at which angles are 0.
    angle, arc
        Angles (n,) of the crank and the arc from its axis to its tip, in rad.
    """
    across = np.cross(axis, zero_direction)
    side = np.cos(angle)[:, None] * zero_direction + np.sin(angle)[:, None] * across
    return np.cos(arc) * axis + np.sin(arc) * side


def coupler_margin(q, right):
    """Return the margin (n,) in rad by which the two couplers can reach between the cranks.

    Positive: the loop closes, in two configurations. The couplers form a chain between the
    tips of both cranks. Their distance must be below the sum of both arcs and above the
    difference. `q` and `right` (n,) are the angles of the left and the right crank in
    degrees. A crank has the angle 0 if it is directed to the axis of the other crank.
    """
    base = BASE * DEGREE
    left_axis = np.array([0.0, 0.0, 1.0])
    left_zero = np.array([1.0, 0.0, 0.0])
    left_tip = crank_tip(left_axis, left_zero, q * DEGREE, LEFT * DEGREE)

    right_axis = np.array([np.sin(base), 0.0, np.cos(base)])
    right_zero = np.array([-np.cos(base), 0.0, np.sin(base)])
    right_tip = crank_tip(right_axis, right_zero, right * DEGREE, RIGHT * DEGREE)

    gap_deg = np.arccos(np.sum(left_tip * right_tip, axis=1)) / DEGREE
    stretched_margin = sum(COUPLERS) - gap_deg
    folded_margin = gap_deg - abs(COUPLERS[0] - COUPLERS[1])
    return np.minimum(stretched_margin, folded_margin) * DEGREE


def angle_of(motion, pair):
    """Return the angles (n,) in rad of a pair in all rows of a motion."""
    (variable,) = motion.mechanism.variables_of(motion.mechanism.pair_number[pair])
    return motion.values[:, variable]


def distance_from_whole_turns(angles):
    """Return the distance (rad) of angles (rad) from the nearest multiple of 2 pi."""
    return np.abs(np.remainder(np.asarray(angles) + np.pi, 2.0 * np.pi) - np.pi)


@pytest.mark.parametrize(
    ("teeth", "span"),
    [
        ((20, 40), (600, 720)),
        ((17, 23), (3000, 3050)),
        pytest.param((20, 40), (-360, 360), marks=pytest.mark.slow),
        pytest.param((20, 30), (400, 500), marks=pytest.mark.slow),
    ],
)
def test_the_assembly_does_not_depend_on_where_the_range_starts(tmp_path, teeth, span):
    """The right crank follows the ratio of teeth, wherever the input range starts.

    The geared five-bar closes in two modes where its couplers reach between the crank tips,
    and not elsewhere. `coupler_margin` says in closed form by how much (rad) they reach.
    Samples with a margin below 1e-6 rad are not compared. `span` is the range (deg).
    """
    mechanism = geared_five_bar(tmp_path, teeth, span)
    sample_count = (span[1] - span[0]) // 5 + 1
    motion = sk.trace(mechanism, samples=sample_count)
    q_deg = motion.q / DEGREE
    right_deg = right_crank_angle(q_deg, teeth)
    closes = ~motion.failed
    angle_misses = distance_from_whole_turns(angle_of(motion, "right") - right_deg * DEGREE)
    # Failed rows have no angle (NaN).
    assert np.max(angle_misses[closes]) < 1e-9

    # Rows are sorted by mode, then by sample. All modes have the same inputs, so the
    # margins of the first mode are those of the samples.
    modes_per_sample = closes.reshape(len(motion.assembly_modes), -1).sum(axis=0)
    margin_rad = coupler_margin(q_deg, right_deg)[: motion.samples]
    # The loop clearly closes at some sample of the range.
    assert np.any(margin_rad > 0.02)
    assert np.all(modes_per_sample[margin_rad > 1e-6] == 2)
    assert not np.any(modes_per_sample[margin_rad < -1e-6])


@pytest.mark.slow
def test_every_analysis_puts_the_wheels_together_alike(tmp_path):
    """Forward kinematics, simulations and inverse dynamics agree with the ratio of teeth.

    `right_crank_angle` has the expected angle of the right crank of a geared five-bar.
    Inputs (deg) are up to 2000 turns outside the range of the file. With 20 and 40 teeth
    the wheels are back after two turns, so forward kinematics returns inputs from -360 to
    360 degrees.
    """
    teeth = (20, 40)
    mechanism = geared_five_bar(tmp_path, teeth, span=(0, 360))
    mechanism = replace(mechanism, masses=(MASS,))
    (right,) = mechanism.variables_of(mechanism.pair_number["right"])
    for q_deg in (420.0, 700.0, 720060.0):
        expected = right_crank_angle(q_deg, teeth) * DEGREE
        q = q_deg * DEGREE

        solutions = ForwardKinematics(mechanism, "pointer").solutions([[q]])
        assert len(solutions.values) == 2
        misses = distance_from_whole_turns(solutions.values[:, right] - expected)
        assert np.max(misses) < 1e-8
        q_within_period = np.remainder(q_deg + 360.0, 720.0) - 360.0
        assert np.allclose(solutions.inputs / DEGREE, q_within_period, rtol=0.0, atol=1e-7)

        # A simulation of 0.1 s with the initial rate 1 rad/s; only its start is computed.
        simulation_start = prepare(mechanism, Start(q, 1.0), 0.1)
        assert distance_from_whole_turns(simulation_start.values[right] - expected) < 1e-8

        law = ConstantSpeed(0.1, q)
        values = inverse_dynamics(mechanism, law, [0.0]).values[0]
        assert distance_from_whole_turns(values[right] - expected) < 1e-8


def test_a_reference_pose_alone_fixes_the_phase_of_wheels(tmp_path):
    """Wheels that are stated in a reference pose turn from that pose, in any range.

    The axes of the pose are those of the geared five-bar at q = 60 degrees, and the
    mechanism states this angle for its input. The right crank has the angle 0 in the pose,
    and turns back from there by the ratio of teeth, 17 : 23. The ranges are many turns
    away. In parts of them the five-bar cannot be closed.
    """
    teeth = (17, 23)
    sized_mechanism = geared_five_bar(tmp_path, teeth, span=(59, 61))
    # Samples of the first mode at 59, 60 and 61 degrees, then those of further modes.
    motion_about_60_deg = PositionAnalysis(sized_mechanism, samples=3).motion()
    axes_at_60_deg = motion_about_60_deg.axes[1]
    axes = {}
    for pair, axis in zip(sized_mechanism.pairs, axes_at_60_deg, strict=True):
        axes[pair.name] = tuple(axis.tolist())
    del axes["mesh"]

    # Half angles of the pitch cones of both wheels, whose axes are `BASE` apart. In the
    # file of the pose the wheels are circles that roll on each other (Cr).
    left_radius, right_radius = pitch_angles(teeth, BASE * DEGREE, "external")
    pitch_circles = (
        Profile("circle", axes["left"], left_radius),
        Profile("circle", axes["right"], right_radius),
    )
    links_by_pair = {"left": "12", "right": "15", "32": "23", "43": "34", "54": "45"}
    pairs = [Pair(name, "R", tuple(links)) for name, links in links_by_pair.items()]
    pairs.append(Pair("mesh", "Cr", ("2", "5"), pitch_circles))
    input_angle_in_pose = {"left": 60.0 * DEGREE}
    posed_mechanism = sk.Mechanism(
        "posed",
        "1",
        tuple("12345"),
        tuple(pairs),
        PoseGeometry(axes, input_angle_in_pose),
        (Input("left", 0.0, 1.0),),
    )
    for low_deg, high_deg in ((410.0, 440.0), (-8220.0, -8200.0)):
        span = Input("left", low_deg * DEGREE, high_deg * DEGREE)
        mechanism = replace(posed_mechanism, inputs=(span,))
        motion = PositionAnalysis(mechanism, samples=41).motion()
        closes = ~motion.failed
        expected = -(motion.q - 60.0 * DEGREE) * teeth[0] / teeth[1]
        assert np.any(closes)
        misses = distance_from_whole_turns(angle_of(motion, "right") - expected)
        assert np.max(misses[closes]) < 1e-9


@pytest.mark.parametrize(
    ("name", "pair", "ratio"),
    [
        ("bevel_pair", "02", -20.0 / 40.0),
        ("planetary_bevel", "output_pivot", 2.0),
        ("rolling_cones", "roller_axis", np.sin(50 * DEGREE) / np.sin(20 * DEGREE)),
    ],
)
def test_shipped_gear_trains_turn_by_their_ratio_in_any_range(name, pair, ratio):
    """The output angle of a gear train is its ratio times the input, plus one constant.

    The constant must be the same in three ranges (deg), but for whole turns. Ratios are
    computed by hand: from numbers of teeth, or sines of the half angles of cones.
    """
    mechanism = sk.load(name)
    (driven,) = mechanism.inputs
    offsets = []
    for low_deg, high_deg in ((0.0, 1.0), (-400.0, -300.0), (1000.0, 1900.0)):
        span = replace(driven, start=low_deg * DEGREE, stop=high_deg * DEGREE)
        motion = PositionAnalysis(replace(mechanism, inputs=(span,)), samples=11).motion()
        assert not motion.failed.any()
        offsets.append(angle_of(motion, pair) - ratio * motion.q)
    offsets = np.concatenate(offsets)
    assert np.max(distance_from_whole_turns(offsets - offsets[0])) < 1e-9


def test_carrier_of_a_differential_is_half_way_between_inputs_in_any_range():
    """The angle of the carrier of a bevel differential is the mean of both side gears.

    Both side gears have the same number of teeth. One more turn of an input is half a turn
    of the carrier, so whole turns of the inputs count.
    """
    mechanism = sk.load("bevel_differential")
    for shifts_deg in ((0.0, 0.0), (360.0, 0.0), (-720.0, 1080.0)):
        inputs = []
        for item, shift_deg in zip(mechanism.inputs, shifts_deg, strict=True):
            shift = shift_deg * DEGREE
            inputs.append(replace(item, start=item.start + shift, stop=item.stop + shift))
        shifted = replace(mechanism, inputs=tuple(inputs))
        motion = PositionAnalysis(shifted, samples=9).motion()
        closes = ~motion.failed
        assert np.sum(closes) >= 9
        carrier = angle_of(motion, "carrier_axle")[closes]
        expected = 0.5 * np.sum(motion.inputs[closes], axis=1)
        assert np.max(distance_from_whole_turns(carrier - expected)) < 1e-9


@pytest.mark.many
@pytest.mark.parametrize("shift_deg", [0.0, -360.0, 360.0])
def test_wheels_on_moving_links_stay_on_the_curve_of_the_reference_pose(shift_deg):
    """Wheels on moving links are followed along one curve of configurations only.

    How far these wheels have rolled does not follow from the input alone. So only the curve
    through the reference pose is followed, and `claim`, which states how complete the
    assembly modes are, must say so. In this random mechanism the input swings along the
    curve, so each input within the swing is met twice. A range that is shifted by a whole
    turn has the same configurations.
    """
    # A random mechanism with wheels on moving links. In its reference pose the input is 0.
    mechanism = random_subject(4).mechanism
    (driven,) = (item.pair for item in mechanism.inputs)
    ranges = {driven: (shift_deg - 40.0, shift_deg + 60.0)}
    position_analysis = PositionAnalysis(
        mechanism.with_inputs(ranges=ranges, angle_unit="deg"), samples=101
    )
    motion = position_analysis.motion()
    is_ok = (motion.status == Status.OK).reshape(len(position_analysis.assembly_modes), -1)
    modes_per_sample = np.sum(is_ok, axis=0)
    assert modes_per_sample.max() == 2
    assert set(modes_per_sample) <= {0, 2}

    # Samples are one degree apart, from -40 degrees on. Sample 40 is the reference pose.
    differences = motion.values[motion.sample == 40] - position_analysis.solver.reference
    distances = np.max(np.abs(np.sin(0.5 * differences)), axis=1)
    assert np.min(distances) < 1e-9
    assert "mode of the reference pose" in position_analysis.claim.reason


def test_a_second_planet_changes_nothing_about_the_motion(tmp_path):
    """A second planet, opposite the first one, does not change a planetary gear train.

    It adds two contacts that are satisfied already. The common links must move as without
    it. How far the wheels of each contact have rolled on each other must still follow from
    the inputs (`gear_phases.all_known`).
    """
    text = (MECHANISMS / "planetary_bevel.toml").read_text().partition("[mass.carrier]")[0]
    text = text.replace(
        'axes = ["carrier_pivot", "planet_axis"]\narcs = [90.0]',
        'axes = ["carrier_pivot", "planet_axis", "opposite"]\narcs = [90.0, 90.0]\n'
        "angles = [180.0]",
    )
    path = tmp_path / "two.toml"
    path.write_text(text + SECOND_PLANET)
    two_planets = PositionAnalysis(sk.load(path), samples=9)
    one_planet = PositionAnalysis(sk.load("planetary_bevel"), samples=9)
    assert two_planets.solver.gear_phases.all_known
    assert len(two_planets.assembly_modes) == 1
    assert two_planets.claim.guarantee is Guarantee.COMPLETE

    motion_of_two = two_planets.motion()
    motion_of_one = one_planet.motion()
    assert np.all(motion_of_two.status == Status.OK)
    links_of_two = two_planets.mechanism.links
    common = [links_of_two.index(link) for link in one_planet.mechanism.links]
    common_rotations = motion_of_two.rotations[:, common]
    assert np.max(np.abs(common_rotations - motion_of_one.rotations)) < 1e-12


PLANET_WITH_PIN = """
format = 1
name = "planet_with_pin"
angle_unit = "deg"
ground = "sun"
[links]
sun = {{ axes = ["arm_pivot", "crank_pivot"], arcs = [70.0] }}
arm = {{ axes = ["arm_pivot", "planet_axis"], arcs = [60.0] }}
planet = {{ axes = ["planet_axis", "pin"], arcs = [25.0] }}
rod = {{ axes = ["pin", "crank_pin"], arcs = [50.0] }}
crank = {{ axes = ["crank_pin", "crank_pivot"], arcs = [{}] }}
[pairs]
arm_pivot = {{ type = "R", links = ["sun", "arm"] }}
planet_axis = {{ type = "R", links = ["arm", "planet"] }}
pin = {{ type = "R", links = ["planet", "rod"] }}
crank_pin = {{ type = "R", links = ["rod", "crank"] }}
crank_pivot = {{ type = "R", links = ["sun", "crank"] }}
mesh.type = "Cr"
mesh.links = ["sun", "planet"]
mesh.teeth = [36, 18]
mesh.axes = ["arm_pivot", "planet_axis"]
[inputs.crank_pivot]
from = 0.0
to = 360.0
"""
"""A planet rolls on a fixed sun of twice as many teeth; a rod joins its pin to a crank."""


@pytest.mark.parametrize(
    ("crank_arc_deg", "crank_deg"),
    [(55.0, 18.25332772518774), (55.0, 21.68924000684597), (70.0, 0.0), (55.0, 47.3)],
)
def test_modes_half_a_turn_of_the_arm_apart_are_two_although_a_planet_has_turned_once(
    crank_arc_deg, crank_deg
):
    """Two modes half a turn of the arm apart are counted as two.

    `PLANET_WITH_PIN` is a planet on a fixed sun, and a rod from its pin to a crank. The arm
    carries the planet. The sun has twice as many teeth as the planet. So while the arm
    makes half a turn, the planet makes one turn on the arm and has the same angle again.
    At three of the crank angles the arm angles of two modes differ by half a turn. The
    expected arm angles come from a scan: the rod fits where the distance between its ends
    is 50 deg.
    """
    mechanism = loads(PLANET_WITH_PIN.format(crank_arc_deg))
    path = np.array([[np.radians(crank_deg)]])
    motion = PositionAnalysis(mechanism, path=path).motion()
    arms = motion.values[:, mechanism.angles["arm_pivot"]]
    # Axes in the first mode, from which the scan turns the arm.
    axes = {name: motion.axes[0, k] for name, k in mechanism.pair_number.items()}
    arm_turns = np.linspace(-3.0, -3.0 + 2.0 * np.pi, 4001)
    # The pin turns with the planet relative to the arm, and then with the arm.
    rotation_on_arm = Rotation.from_rotvec(2.0 * np.outer(arm_turns, axes["planet_axis"]))
    rotation_of_arm = Rotation.from_rotvec(np.outer(arm_turns, axes["arm_pivot"]))
    pins = rotation_of_arm.apply(rotation_on_arm.apply(axes["pin"]))
    misses = pins @ axes["crank_pin"] - np.cos(np.radians(50.0))
    # The rod fits where the sign changes.
    changes = np.flatnonzero(misses[1:] * misses[:-1] < 0.0)
    scanned = arm_turns[changes] + arms[0]
    # The scan begins 3 rad before the first mode, and ends after a whole turn.
    assert len(scanned) == len(motion.values) == 4
    # (modes, scanned) sines of half the differences, so that whole turns do not count.
    # Each mode is near a scanned angle, and each scanned angle is near a mode.
    distances = np.abs(np.sin(0.5 * (arms[:, None] - scanned)))
    assert np.max(np.min(distances, axis=1)) < 1e-3
    assert np.max(np.min(distances, axis=0)) < 1e-3


def test_a_load_acts_although_the_wheels_do_not_follow_the_input():
    """A spring on the arm of `PLANET_WITH_PIN` is balanced by the torque of its energy.

    The input is the crank. No gear ratio leads from it to the wheels, so the configurations
    have no known period. The torque is a central difference of the energy of the spring.
    """
    stiffness = 0.7
    mechanism = loads(PLANET_WITH_PIN.format(55.0))
    spring = PairTorque("spring", "arm_pivot", f"-{stiffness}*theta_arm_pivot")
    step_rad = 1e-4
    path = np.radians(20.0) + step_rad * np.array([[-1.0], [0.0], [1.0]])
    position_analysis = PositionAnalysis(mechanism, path=path)
    mode_count = len(position_analysis.assembly_modes)
    assert mode_count == 4
    angles = position_analysis.motion().values[:, mechanism.angles["arm_pivot"]]
    energy = 0.5 * stiffness * angles.reshape(mode_count, 3) ** 2
    expected = (energy[:, 2] - energy[:, 0]) / (2.0 * step_rad)
    loaded = replace(mechanism, loads=(spring,))
    torques = sk.run(loaded, "statics", path=path).frame()["tau"].to_numpy()
    assert torques.reshape(mode_count, 3)[:, 1] == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("inputs", [1, 2])
def test_a_report_on_free_wheels_is_a_whole_sentence(inputs):
    """A roller that turns freely has infinitely many assemblies; only one is computed.

    The second input turns a link that joins nothing else.
    """
    text = mechanism_text("posed_roller")
    reached = "the mode of the reference pose was"
    if inputs == 1:
        lines = text.replace(", 5 = {}", "").splitlines()
        text = "\n".join(line for line in lines if "spin" not in line)
        reached = (
            "the mode of the reference pose and the modes that continue it where it ends "
            "were"
        )
    report = describe_completeness(PositionAnalysis(loads(text), samples=3))
    assert report == (
        f"Only {reached} computed; other ways to mesh the wheels were not searched."
    )


@pytest.mark.parametrize("turns", [(3, 0), (-10, 0), (7, 7)])
def test_a_start_whole_turns_along_both_wheels_gives_the_same_teeth(turns):
    """A `start` that is shifted by whole circumferences is the same point of each wheel.

    The field `start` of two wheels has an arc length along each of their circles. The
    points at these arc lengths touch where the variable of the contact is zero. On the unit
    sphere, a whole circumference is 360 degrees times the sine of the radius.

    Both wheels are shifted by whole numbers of circumferences, `turns`, so that the same
    points touch. The shift must not count as rolling. One turn of a wheel of 17 teeth rolls
    a wheel of 23 teeth by 17/23 of a turn. So rolling would change the angle of the second
    wheel by a fraction of a turn, and not by whole turns only.
    """
    teeth = (17, 23)
    text = (MECHANISMS / "bevel_pair.toml").read_text()
    text = text.replace("teeth = [20, 40]", "teeth = [17, 23]")
    radii = pitch_angles(teeth, 75.0 * DEGREE, "external")
    angles = []
    for first_turns, second_turns in ((0, 0), turns):
        start_deg = (
            360.0 * first_turns * float(np.sin(radii[0])),
            360.0 * second_turns * float(np.sin(radii[1])),
        )
        shifted_text = text.replace(
            "phase = { 01 = 0.0, 02 = 0.0 }", f"start = {list(start_deg)}"
        )
        assert shifted_text != text
        angles.append(angle_of(sk.trace(loads(shifted_text), samples=3), "02"))
    assert np.max(distance_from_whole_turns(angles[1] - angles[0])) < 1e-9


def test_least_rolling_is_found_many_turns_away():
    """A large wheel drives a pinion, and a wheel on its shaft drives another one.

    The pinion turns so often that the next contact has rolled some turns. The expected sum
    comes from trying up to 30 turns of each wheel. Shafts 1 and 2 follow: angles a = (a1,
    a2). The rolled lengths are `lengths[0, 0]`, as the driver stands still, and
    `lengths[1, 0]` minus a1 times the sine of the wheel on the shaft of the pinion.
    """
    driver, pinion, wheel, last = np.sin([1.2, 0.12, 1.0, 0.5])
    circumferences = 2.0 * np.pi * np.array([[driver, pinion], [wheel, last]])
    lengths = np.array([[0.4, -0.1], [-0.1, 0.3]]) * circumferences
    first_slopes = np.array([[0.0, 0.0], [wheel, 0.0]])
    second_slopes = np.array([[pinion, 0.0], [0.0, last]])

    def rolled_sums(turns_of_driver, turns_of_wheel):
        """Return the sums of both absolute rolled lengths for turns along two circles."""
        first_length = lengths[0, 0] + turns_of_driver * circumferences[0, 0]
        shaft_angle = (lengths[0, 1] - first_length) / pinion
        second_length = lengths[1, 0] + turns_of_wheel * circumferences[1, 0]
        return np.abs(first_length) + np.abs(second_length - wheel * shaft_angle)

    turns = find_least_rolled_turns(
        lengths, circumferences, first_slopes, first_slopes - second_slopes
    )
    # A turn along the pinion has the effect of a turn back along the wheel on its shaft.
    turns_of_wheel = turns[1, 0] - turns[0, 1]
    tried_sums = rolled_sums(*(np.indices((61, 61)) - 30))
    assert rolled_sums(turns[0, 0], turns_of_wheel) == pytest.approx(np.min(tried_sums))
