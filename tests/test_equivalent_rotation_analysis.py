"""The analysis `equivalent_rotation`: tables, findings, messages, pages, poses as text."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.refusals import TABLES, check_call
from helpers.scene_listener import SceneListener
from scipy.optimize import brentq

import spherekit as sk
from spherekit.errors import AnalysisError, SolveError
from spherekit.geometry.mirror import normal_at
from spherekit.geometry.rotation import from_quaternion, quaternion, rotation_about_axis
from spherekit.geometry.sphere_mesh import spiral_directions
from spherekit.geometry.tilt_torsion import tilt_torsion
from spherekit.mechanism.elements import Output
from spherekit.numerics.angles import wrap
from spherekit.outputs.fixed_axis_rotation import FollowedRotation, axis_and_angle
from spherekit.outputs.mid_plane_symmetry import mid_plane_form
from spherekit.outputs.output_pose import (
    AtDirection,
    AtInputs,
    AtOrientation,
    PoseFinder,
)
from spherekit.outputs.pose_solver import closed_kinematics
from spherekit.outputs.workspace import judge, orientation_samples
from spherekit.runs.needs import Needs
from spherekit.runs.registry import create_analysis
from spherekit.scenes.scene import GreatCircle, Series, SphereCurves
from spherekit.singularities.slices import solver_of

NAME = "equivalent_rotation"
QUATERNION = ("qx", "qy", "qz", "qw")
TABLE_3 = f"{NAME}:start=phi=75+gamma=-20,end=phi=70+gamma=20"


def run_rotation(mechanism, text, **options):
    """Run the analysis alone, with its parameters as text."""
    return sk.run(mechanism, text if NAME in text else f"{NAME}:{text}", **options)


def schedule(result):
    """Return the table over time, with angles in degrees."""
    return result.frame(NAME, "schedule", degrees=True)


def findings(result):
    """Return the findings of the only analysis of a run that did not fail."""
    assert not result.failures, result.failures
    (entry,) = result.summary["analyses"]
    return entry["findings"]


def columns_in_degrees(result, *columns):
    """Return columns of the main table with angles in degrees, shape (rows, columns)."""
    return result.frame(NAME, degrees=True)[list(columns)].to_numpy()


@pytest.fixture(scope="module")
def listener():
    return SceneListener()


@pytest.fixture(scope="module")
def table_3(listener):
    text = TABLE_3 + ",theta=0+13+26+40.323061,speed=30,acceleration=70,samples=41"
    return run_rotation("two_dof_spm", text, assembly_mode=0, recorder=listener)


def test_rotation_of_table_3_of_the_paper(table_3):
    """Poses and driving angles are those of Chen et al. 2021, Table 3 (degrees).

    `table_3` is a run of the analysis: the platform turns about one axis from a first to a
    last pose. Base and platform mirror each other in a plane. Its unit normal (-sin(phi /
    2), sin(gamma / 2), n_z) has components in mirror axes, which are fixed to the base. The
    drift is the angle between the axis about which the platform turns at a moment and the
    fixed axis.

    In the first row all printed digits are correct. Later rows differ by up to 6.2e-4
    degrees from rounding in the paper.
    """
    # phi, gamma, driving angles at the pairs 21 and 61
    printed = [
        (75.0, -20.0, 5.3391, 56.7404),
        (74.5359, -7.1049, 18.3470, 35.3134),
        (72.9604, 5.7918, 32.3670, 18.9834),
        (70.0, 20.0, 49.2440, 3.7442),
    ]
    rows = columns_in_degrees(table_3, "phi", "gamma", "q_21", "q_61")
    assert rows == pytest.approx(np.array(printed), abs=6.2e-4)
    assert rows[0] == pytest.approx(np.array(printed[0]), abs=5.1e-5)
    rotation = findings(table_3)
    printed_axis = [-0.7933, 0.1257, -0.5957]
    assert rotation["axis_in_mirror_axes"] == pytest.approx(printed_axis, abs=5.1e-5)
    assert np.degrees(rotation["angle_rad"]) == pytest.approx(40.3230, abs=7e-5)
    assert rotation["feasible"]
    assert rotation["end"] == "OK"
    assert rotation["largest_orientation_error_rad"] < 1e-14
    assert rotation["largest_drift_rad"] < 1e-14


def test_messages_of_the_rotation_of_table_3(table_3):
    """The only warning names the type II singularity on the way, a remark the axis.

    At a type II singularity the locked inputs do not hold the platform.
    """
    (warning,) = table_3.summary["warnings"]
    assert "meets a type II singularity at theta = 30.9007 deg, 21 = 37.95" in warning
    remark = table_3.summary["remarks"][0]
    assert "(-0.793330, 0.125686, -0.595677) in axes of the mirror (x0, y0, z0)" in remark
    assert "in axes of link 1" in remark


def test_schedule_reaches_one_limit_and_exceeds_none(table_3):
    """The schedule of a rotation is as fast as the limits of the inputs allow.

    In `table_3` the platform of a mechanism turns about a fixed axis. The schedule is this
    motion over time, with limits of 30 deg/s and 70 deg/s2 for the inputs. The speed of the
    input 61 reaches its limit; no speed or acceleration exceeds a limit. The table has 41
    rows, as was asked for.
    """
    frame = schedule(table_3)
    units = frame.attrs["units"]
    assert units["t"] == "s"
    assert units["theta"] == units["q_21"] == "deg"
    assert units["dq_21"] == "deg/s"
    assert units["ddq_61"] == "deg/s2"
    timing = findings(table_3)["schedule"]
    assert timing["set_by"].startswith("speed of 61")
    speeds = [abs(x["value"]) for x in timing["extremes"] if x["quantity"] == "speed"]
    assert np.degrees(max(speeds)) == pytest.approx(30.0, abs=1e-9)
    assert len(frame) == 41
    assert frame["t"].iloc[-1] == pytest.approx(timing["duration_s"])
    for pair in ("21", "61"):
        assert frame[f"dq_{pair}"].abs().max() <= 30.0 + 1e-9
        assert frame[f"ddq_{pair}"].abs().max() <= 70.0 + 1e-9


@pytest.mark.slow
def test_schedule_in_cycles_of_a_controller():
    """With `cycle` (s) a schedule has a row per cycle and ends after a whole number.

    A schedule is a table of the inputs over time. Without `cycle` it takes the shortest
    duration that the limit of 30 deg/s allows. With `cycle` the duration is rounded up, so
    the inputs are a little slower. With a cycle of 1e-9 s the table would have too many
    rows (`MAX_SCHEDULE_ROWS`), so it is empty. `findings` and `schedule` read the result of
    `run_rotation`. The table of `schedule` has speeds in deg/s.
    """
    # phi and gamma are the angles (deg) of the mid-plane, in which base and platform are
    # mirror images of each other.
    parameters = "start=phi=75+gamma=-20,end=phi=70+gamma=20,speed=30,samples=5"
    shortest_schedule = findings(run_rotation("two_dof_spm", parameters))["schedule"]
    shortest = shortest_schedule["duration_s"]
    result = run_rotation("two_dof_spm", f"{parameters},cycle=0.004")
    timing = findings(result)["schedule"]
    table = schedule(result)
    t = table["t"].to_numpy()
    assert timing["cycle_s"] == 0.004
    assert np.max(np.abs(t - 0.004 * np.arange(len(t)))) < 1e-12
    assert t[-1] == timing["duration_s"]
    assert shortest <= t[-1] < shortest + 0.004
    speeds = table[["dq_21", "dq_61"]].abs()  # deg/s
    assert speeds.to_numpy().max() <= 30.0
    assert speeds.iloc[-1].max() < 1e-9
    assert schedule(run_rotation("two_dof_spm", f"{parameters},cycle=1e-9")).empty
    # A duration of seven cycles has eight rows, at 0, 1, ..., 7 cycles.
    cycle = repr(shortest / 7)
    assert len(schedule(run_rotation("two_dof_spm", f"{parameters},cycle={cycle}"))) == 8


def test_a_rotation_with_a_failed_row_is_not_feasible(monkeypatch):
    """A rotation with one row that does not converge is reported as not feasible.

    This holds although its end is reached. The third of five rows is changed to this
    status.
    """
    complete_at = FollowedRotation.at

    def at_with_a_failed_row(rotation, theta):
        rows = complete_at(rotation, theta)
        status = rows.status.copy()
        status[2] = sk.Status.NOT_CONVERGED
        return replace(rows, status=status)

    monkeypatch.setattr(FollowedRotation, "at", at_with_a_failed_row)
    parameters = "start=phi=75+gamma=-20,end=phi=74+gamma=-20,samples=5"
    result = run_rotation("two_dof_spm", parameters)
    assert findings(result)["failed_rows"] == 1
    assert not findings(result)["feasible"]
    assert any("1 of 5 rows failed" in text for text in result.summary["warnings"])


def test_modes_of_the_start_are_listed_and_chosen():
    """Configurations at the start have signs; one is chosen by signs or number."""
    text = TABLE_3 + ",samples=2,mode="
    listed = findings(run_rotation("two_dof_spm", text + "+-+"))
    assert [c["mode"] for c in listed["start"]["configurations"]][:2] == ["-++", "-+-"]
    assert listed["start"]["number"] == 6
    inputs = columns_in_degrees(run_rotation("two_dof_spm", text + "6"), "q_21", "q_61")
    assert inputs[0] == pytest.approx([113.7956, 100.7573], abs=5.1e-5)  # docs, Fig. 5


@pytest.mark.slow
def test_a_pose_can_be_given_in_five_ways():
    """A rotation is the same whichever of five descriptions states its start and end.

    Base and platform are mirror images of each other in the mid-plane. The descriptions
    are:

    - phi and gamma, which state the normal of this plane: (-sin(phi / 2), sin(gamma / 2),
      n_z). Those of Table 3 of Chen et al. 2021 are in the text `TABLE_3`: 75 and -20 deg
      at the start, 70 and 20 deg at the end.
    - The input angles. The paper prints 5.3391 and 56.7404 deg at the start; more digits
      are used here.
    - A quaternion, or azimuth, tilt and torsion, both computed from phi and gamma.
    - For the end, also the axis and the angle of the rotation that leads to it.
    """
    mechanism = sk.load("two_dof_spm")
    form = mid_plane_form(mechanism)
    first_normal = normal_at(*np.radians((75.0, -20.0)))
    second_normal = normal_at(*np.radians((70.0, 20.0)))
    # Orientations (3, 3) of the platform at the start and at the end.
    first, second = form.orientations(np.stack([first_normal, second_normal]))
    second_quaternion = pose_text(QUATERNION, quaternion(second[None])[0])
    tilt_and_torsion = np.degrees(tilt_torsion(first[None]))[0]
    first_tilt = pose_text(("azimuth", "tilt", "torsion"), tilt_and_torsion)
    axis, angle = axis_and_angle(first, second)
    turn = pose_text(("ux", "uy", "uz", "angle"), [*axis, np.degrees(angle)])
    first_inputs = "21=5.339100020817853+61=56.74044673238507"

    by_mid_planes = run_rotation("two_dof_spm", TABLE_3 + ",samples=3")
    expected = columns_in_degrees(by_mid_planes, "q_21", "q_61")
    for start, end in ((first_inputs, second_quaternion), (first_tilt, turn)):
        result = run_rotation("two_dof_spm", f"start={start},end={end},samples=3")
        assert findings(result)["feasible"]
        inputs = columns_in_degrees(result, "q_21", "q_61")
        assert inputs == pytest.approx(expected, abs=1e-10)


def test_the_nearest_reachable_mid_plane_is_found():
    """For a mid-plane that the legs do not reach, the nearest reachable one is found.

    Base and platform are mirror images of each other in the mid-plane. No reachable plane
    of a dense sample of the sphere may be nearer. A normal and its opposite have the same
    plane, so absolute cosines are compared.

    The elbow of a leg is in the mid-plane, at the angle `arc` from the base axis of the
    leg. So the leg reaches the plane if the angle between axis and plane is at most `arc`.
    The sine of this angle is ``|axis . normal|``.

    A plane is stated by two angles phi and gamma. Its unit normal is (-sin(phi / 2),
    sin(gamma / 2), n_z) with n_z >= 0 (`normal_at`).
    """
    plane = mid_plane_form(sk.load("two_dof_spm")).plane
    directions = spiral_directions(200_000)
    limits = np.sin(plane.arcs)
    is_reachable = np.all(np.abs(directions @ plane.axes.T) <= limits, axis=1)
    reachable = directions[is_reachable]
    # Angles phi and gamma (deg) of mid-planes that the legs do not reach.
    for pose in ((120.0, 0.0), (-70.0, 40.0), (100.0, -60.0), (0.0, 120.0)):
        wanted = normal_at(*np.radians(pose))
        nearest = plane.nearest(wanted)
        assert np.all(np.abs(plane.axes @ nearest) <= limits + 1e-9)
        best_cosine = np.max(np.abs(reachable @ wanted))
        cosine = abs(nearest @ wanted)
        assert cosine >= best_cosine - 1e-9
        assert np.arccos(cosine) > np.arccos(best_cosine) - 0.02  # spacing of the sample
    reached = normal_at(*np.radians((40.0, 10.0)))
    assert plane.nearest(reached) == pytest.approx(reached, abs=1e-15)


def test_the_message_offers_a_pose_that_is_reached():
    """An end out of reach is refused with the nearest pose, which then works."""
    start = "start=phi=75+gamma=-20"
    message = run_rotation("two_dof_spm", f"{start},end=phi=120+gamma=0").failures[NAME]
    assert "legs at 21, 61, 81 do not reach" in message
    offered = message.split("nearest pose inside is ")[1].removesuffix(" deg")
    offered_end = offered.replace(" ", "").replace(",", "+")
    result = run_rotation("two_dof_spm", f"{start},end={offered_end},samples=2")
    assert findings(result)["feasible"]


def random_start_and_axis(random):
    """Return the normal of a random mid-plane, and an axis in this plane (unit vectors)."""
    first, second = random.normal(size=(2, 3))
    axis = np.cross(first, second)  # at right angles to `first`
    return first / np.linalg.norm(first), axis / np.linalg.norm(axis)


def is_within_reach(plane, normal):
    """Return whether all legs reach a mid-plane, with a margin of 1e-3 in the sines.

    A leg reaches the plane if the angle between its base axis and the plane is at most its
    arc. The sine of this angle is |axis . normal|. Next to the limit both elbows of the leg
    coincide, hence the margin.
    """
    sines = np.abs(plane.axes @ normal)
    return not np.any(sines > np.sin(plane.arcs) - 1e-3)


def has_all_elbows(plane, normals):
    """Return whether all legs reach each of the mid-planes (n,) with these normals (n, 3).

    The elbow of a leg, the axis between its two links, is NaN if the leg does not reach the
    plane. The sign of a leg chooses one of its two possible elbows. Both exist in the same
    planes, so all signs are 1.
    """
    elbows, _ = plane.elbows(normals, np.ones(3))
    return ~np.any(np.isnan(elbows[..., 0]), axis=1)


@pytest.mark.slow
def test_a_rotation_ends_where_a_leg_reaches_no_farther():
    """A rotation of a platform ends where a leg reaches no farther.

    The angle that can be reached is computed in closed form and compared with 4001 samples,
    for random axes. The platform is the mirror image of the base in the mid-plane, which
    contains the axis. If the platform turns by an angle, the mid-plane turns by half of
    this angle. The elbow of a leg, between its two links, must lie in the mid-plane.
    `has_all_elbows` says whether all legs can have such an elbow.

    The axis and the normals of mid-planes are in mirror axes, the coordinate axes of the
    closed form. They are fixed to the base, but differ from the axes of its file. The
    matrix `form.frame` transforms vectors from mirror axes to those of the base.
    """
    form = mid_plane_form(sk.load("two_dof_spm"))
    largest_angle = 3.0
    sampled_angles = np.linspace(0.0, largest_angle, 4001)
    spacing = largest_angle / 4000
    # A leg can have two elbows. The sign of each leg selects the elbow at the start. The
    # choice does not matter here: a leg has both elbows or none.
    signs_of_legs = np.ones(3)
    random = np.random.default_rng(7)
    ended_rotations = 0
    for _ in range(8):
        start_normal, axis = random_start_and_axis(random)
        if not is_within_reach(form.plane, start_normal):
            continue
        axis_in_base = form.frame @ axis
        rotation = form.rotation_about(
            start_normal, axis_in_base, largest_angle, signs_of_legs
        )

        turned_normals = rotation_about_axis(axis, 0.5 * sampled_angles) @ start_normal
        is_beyond = ~has_all_elbows(form.plane, turned_normals)
        if np.any(is_beyond):
            ended_rotations += 1
            first_sample_beyond = np.flatnonzero(is_beyond)[0]
            first_angle_beyond = sampled_angles[first_sample_beyond]
        else:
            first_angle_beyond = largest_angle
        # `reached` is the angle (rad) up to which the legs can follow.
        assert first_angle_beyond - spacing - 1e-9 <= rotation.reached
        assert rotation.reached <= first_angle_beyond + 1e-9
    assert ended_rotations > 1


def pose_text(names, values):
    """Return a pose as text, NAME=NUMBER for each name, joined by +."""
    return "+".join(f"{name}={x:.17g}" for name, x in zip(names, values, strict=True))


def test_an_output_with_two_freedoms_departs_between_the_ends():
    """A five-bar cannot turn its output about a fixed axis, and the run says so.

    At both ends the orientation is exact. Between them it departs from the orientation that
    a rotation about the axis would give. The table has the departure as
    `orientation_error`, and the summary has a warning. The column phi, an angle of the
    mid-plane, is NaN. Only mechanisms whose base and output link are mirror images of each
    other have a mid-plane.
    """
    # Start and end are given by the angles of the inputs 21 and 51 in degrees.
    parameters = "start=21=60+51=100,end=21=75+51=75,samples=21,speed=60"
    result = run_rotation("five_bar", parameters)
    rotation = findings(result)
    assert not rotation["feasible"]
    assert rotation["end"] == "OK"
    inputs = columns_in_degrees(result, "q_21", "q_51")
    (orientation_error,) = columns_in_degrees(result, "orientation_error").T
    assert inputs[0] == pytest.approx(np.array([60.0, 100.0]), abs=1e-9)
    assert inputs[-1] == pytest.approx(np.array([75.0, 75.0]), abs=1e-9)
    assert orientation_error[[0, -1]] == pytest.approx(np.zeros(2), abs=1e-9)
    largest_error = np.degrees(rotation["largest_orientation_error_rad"])
    assert largest_error == pytest.approx(np.max(orientation_error))
    assert np.all(np.isnan(columns_in_degrees(result, "phi")))
    assert "cannot turn exactly about the fixed axis" in result.summary["warnings"][0]


def test_a_direction_as_the_end():
    """An end given as a direction turns the output's pointer into it."""
    result = run_rotation("five_bar", "start=21=60+51=100,end=x=0.2+y=1+z=0.1,samples=3")
    assert not findings(result)["feasible"]
    inputs = result.frame(NAME)[["q_21", "q_51"]].to_numpy()[-1:]
    directions = sk.ForwardKinematics("five_bar").solutions(inputs).directions
    wanted = np.array([0.2, 1.0, 0.1]) / np.linalg.norm([0.2, 1.0, 0.1])
    assert np.min(np.linalg.norm(directions - wanted, axis=1)) < 1e-12


@pytest.mark.slow
def test_all_configurations_at_a_direction_are_those_of_inverse_kinematics():
    """The eight configurations at one direction agree with inverse kinematics.

    Base and platform mirror each other in a mid-plane. The output points in the mirror
    image of a constant direction, the home direction. So one mid-plane gives the wanted
    direction, in closed form. The inverse kinematics of all links knows nothing of
    mid-planes. The home direction itself is refused, because every plane through it mirrors
    it into itself.
    """
    mechanism = sk.load("two_dof_spm")
    output = mechanism.outputs[0]
    finder = PoseFinder(solver_of(mechanism), output, mid_plane_form(mechanism))
    direction = np.array([0.9, 0.1, 0.4])
    candidates = finder.candidates(AtDirection(direction))
    direction /= np.linalg.norm(direction)
    assert len(candidates) == 8
    pointers = candidates.orientations @ np.array(output.direction)
    assert np.max(np.abs(pointers - direction)) < 1e-13
    solutions = sk.InverseKinematics(mechanism).solutions(direction)
    for orientation, values in zip(candidates.orientations, candidates.values, strict=True):
        gap = np.abs(solutions.rotations - orientation).max(axis=(1, 2))
        angle_gap = np.angle(np.exp(1j * (solutions.values - values)))
        gap += np.abs(angle_gap).max(axis=1)
        assert np.min(gap) < 1e-10
    # In the axes of the base.
    home_direction = finder.form.frame @ finder.form.home
    with pytest.raises(SolveError, match="for every mid-plane"):
        finder.candidates(AtDirection(home_direction))


def test_one_input_turns_a_rocker_about_its_axis():
    result = run_rotation("four_bar", "start=21=60,end=21=90,samples=4")
    assert findings(result)["feasible"]
    assert columns_in_degrees(result, "q")[[0, -1], 0] == pytest.approx(
        [60.0, 90.0], abs=1e-9
    )
    assert len(schedule(result)) == 0


def test_singular_ends_come_last():
    """Singular configurations at the wanted inputs are listed after the regular ones.

    At every input the agile eye also has its unit pose, in which no leg moves the eye.
    """
    mechanism = sk.load("agile_eye")
    finder = PoseFinder(solver_of(mechanism), mechanism.outputs[0], None)
    candidates = finder.candidates(AtInputs(np.radians([20.0, 15.0, -10.0])))
    assert candidates.singular.tolist() == [False] * 4 + [True] * 4
    is_unit_pose = np.max(np.abs(candidates.orientations - np.eye(3)), axis=(1, 2)) < 1e-9
    assert np.flatnonzero(is_unit_pose)[0] >= 4


def check_parameters(text):
    create_analysis(f"{NAME}:{text}", "deg").needs(sk.load("two_dof_spm"))


def raise_failure(name, text):
    raise AnalysisError(run_rotation(name, text.replace("TABLE_3", TABLE_3)).failures[NAME])


@pytest.mark.parametrize("call", TABLES["rotations asked for"])
def test_bad_parameters_of_rotations_are_refused(call):
    """Each call of "rotations asked for" in `refusals.toml` raises the stated error."""
    check_call(call, globals(), TABLES["rotations asked for"][call])


def test_more_than_three_inputs_are_refused():
    """An output turns in three ways at most, so that a fourth input is refused."""
    from spherekit_analyses.equivalent_rotation.analysis import EquivalentRotation

    mechanism = sk.load("three_rrr")
    first_input = mechanism.inputs[0]
    four_inputs = replace(
        mechanism, inputs=(*mechanism.inputs, replace(first_input, pair="b1"))
    )
    with pytest.raises(AnalysisError, match="4 inputs, but an orientation has only three"):
        EquivalentRotation(start="", end="").needs(four_inputs)
    analysis = EquivalentRotation(start="a1=1+a2=2+a3=3", end="a1=1+a2=2+a3=4")
    assert analysis.needs(mechanism) == Needs(tracer=True)


def rotation_from_the_border_of_the_reach(distance):
    """Return parameters of a rotation of a platform from beside its border to well within.

    The border is where a leg is at a dead centre. The margin of an orientation is its
    distance to the nearest dead centre. Of 400 sampled orientations, `inner` has the
    largest margin and `outer` the least, which is negative. The border is the point between
    both quaternions at which the margin is 0. The rotation leads from near the border to
    `inner`.

    Parameters
    ----------
    distance
        Distance of the start from the border, as a part of the line from `inner` to
        `outer`.
    """
    kinematics = closed_kinematics(sk.load("three_rrr"))
    signs = kinematics.modes[0]
    quaternions = orientation_samples(400)

    def margins(orientations):
        return judge(kinematics, kinematics.bounds, signs, orientations).margin

    sampled_margins = margins(quaternions)
    inner = quaternions[np.argmax(sampled_margins)]
    outer = quaternions[np.argmin(sampled_margins)]

    def between(fraction):
        """Return the quaternion at a fraction of the way from inner to outer."""
        orientation = (1.0 - fraction) * inner + fraction * outer
        return orientation / np.linalg.norm(orientation)

    border = brentq(lambda x: margins(between(x)[None])[0], 0.0, 1.0, xtol=1e-16)
    start = pose_text(QUATERNION, between(border - distance))
    end = pose_text(QUATERNION, inner)
    return f"start={start},end={end},speed=30"


@pytest.mark.parametrize("eps", [1e-5, 1e-7])
def test_a_rotation_from_near_a_dead_centre_has_a_schedule(eps):
    """Near a dead centre, inputs turn 1000 times as fast as the output, and a schedule
    exists.

    `eps` is the distance of the start from the border, as a part of the way across it.
    Rates grow with 1 / sqrt(eps).
    """
    result = run_rotation("three_rrr", rotation_from_the_border_of_the_reach(eps))
    assert findings(result)["end"] == "OK"
    assert not [text for text in result.summary["warnings"] if "schedule" in text]
    rates = columns_in_degrees(result, "dq_dtheta_a1", "dq_dtheta_a2", "dq_dtheta_a3")
    assert np.max(np.abs(rates[0])) > 0.1 / np.sqrt(eps)
    assert np.all(np.isfinite(schedule(result)["dq_a1"]))


def test_a_dead_centre_at_the_start_is_named():
    """A rotation that begins at a dead centre ends at once; the warning names the input."""
    warnings = run_rotation(
        "three_rrr", rotation_from_the_border_of_the_reach(1e-13)
    ).summary["warnings"]
    (text,) = (text for text in warnings if "The rotation ends at 0 of" in text)
    assert "input a" in text and "is at a dead centre there" in text


def test_page_of_a_rotation_draws_axis_path_and_mid_planes(table_3, listener):
    """The page of a rotation shows links, axis, path, mid-planes and the singularity.

    `table_3` is the rotation of Table 3 of Chen et al. 2021, at four angles theta, and
    `listener` has recorded the scene. The path of the pointer has a constant distance from
    the axis. Base and platform are mirror images of each other in the mid-plane, which
    contains the axis. At the type II singularity the inputs do not hold the platform. It is
    marked on the path (``lost``), in the plots over theta (``marks/lost``) and in the text
    (``words``). The marked angle is the one that the warning states.
    """
    scene, row_count = listener.last_scene("Equivalent rotation")
    assert row_count == 4
    # `over` has the quantities of the horizontal axes of plots: here only the angle theta.
    (theta,) = scene.over
    assert len(theta.values) == row_count
    primitives = {primitive.path: primitive for primitive in scene.primitives}
    # The mechanism has eleven links. The ground is not drawn.
    assert sum(path.startswith("link/") for path in primitives) == 10
    # (1, 3) unit vector of the axis of rotation.
    axis = primitives["axis"].directions
    assert np.max(np.abs(axis - findings(table_3)["axis"])) < 1e-15
    pointer_path = primitives["arc/pointer"]
    assert isinstance(pointer_path, SphereCurves)
    assert [mark.label for mark in pointer_path.marks] == ["start", "end"]
    (line,) = pointer_path.curves
    assert np.ptp(line @ axis[0]) < 1e-14
    mid_planes = primitives["mid_plane/now"]  # that of the shown row
    assert isinstance(mid_planes, GreatCircle)
    normals = mid_planes.normals  # (4, 3), of the plane at each angle theta
    cosines = np.sum(normals * axis, axis=1)
    # The planes contain the axis, so their normals are perpendicular to it.
    assert np.max(np.abs(cosines)) < 1e-14
    for name, normal in (("start", normals[0]), ("end", normals[-1])):
        (circle,) = primitives[f"mid_plane/{name}"].curves
        assert np.max(np.abs(circle @ normal)) < 1e-14
    assert len(primitives["lost"].marks) == 1
    (warning,) = table_3.summary["warnings"]
    assert "theta = 30.9007 deg" in warning
    # In a plot over theta, the attribute `inputs` of marks has values of theta.
    marked_theta = primitives["marks/lost"].inputs
    assert np.degrees(marked_theta) == pytest.approx(30.9007, abs=1e-4)
    assert "30.9007" in primitives["words"].markdown


def test_page_of_a_schedule(table_3, listener):
    """The page over time plots speeds and accelerations of the table of the schedule."""
    scene, row_count = listener.last_scene("Equivalent rotation in time")
    frame = table_3.frame("equivalent_rotation", "schedule")
    assert scene.over[0].values.tolist() == frame["t"].tolist() and row_count == 41
    plots = {item.path: item.values for item in scene.primitives if type(item) is Series}
    assert plots["plots/dq/21"] == pytest.approx(frame["dq_21"].to_numpy())
    assert plots["plots/ddq/61"] == pytest.approx(frame["ddq_61"].to_numpy())


@pytest.mark.slow
def test_pages_where_the_rotation_ends_early():
    """If a rotation ends early, rows beyond are NaN, and the page over time is left out."""
    parameters = "start=a1=40+a2=50+a3=60,end=ux=0+uy=0+uz=1+angle=170,samples=9,speed=10"
    scene_listener = SceneListener()
    result = run_rotation("three_rrr", parameters, recorder=scene_listener)
    assert findings(result)["end"] != "OK" and np.any(
        np.isnan(columns_in_degrees(result, "q_a1"))
    )
    warnings = "; ".join(result.summary["warnings"])
    assert "The rotation ends at" in warnings and "There is no schedule" in warnings
    assert "Equivalent rotation in time" not in scene_listener.primitives_by_page


def test_an_output_relative_to_a_moving_link():
    """For an output relative to a moving link, the page draws the axis in the ground frame.

    The axis in the findings is in the frame of the moving base link. The table has the pose
    relative to this link (tilt and torsion). `SceneListener` collects what is drawn.
    """
    mechanism = replace(sk.load("five_bar"), outputs=(Output("hand", "3", "5"),))
    scene_listener = SceneListener()
    parameters = "start=21=60+51=100,end=21=75+51=75,samples=5"
    result = run_rotation(mechanism, parameters, recorder=scene_listener)
    rotation = findings(result)
    assert rotation["output"] == "hand"
    page = scene_listener.primitives_by_page["Equivalent rotation"]
    primitives = {primitive.path: primitive for primitive in page}
    base = from_quaternion(primitives["link/5"].quaternions)
    output = from_quaternion(primitives["link/3"].quaternions)
    axis_in_ground = base @ rotation["axis"]
    assert np.max(np.abs(primitives["axis"].directions - axis_in_ground)) < 1e-12
    relative = tilt_torsion(np.swapaxes(base, 1, 2) @ output)
    table = np.radians(columns_in_degrees(result, "azimuth", "tilt", "torsion"))
    assert np.max(np.abs(wrap(relative - table))) < 1e-9


WRIST = str(Path(__file__).parent / "files" / "coaxial_wrist.toml")


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("angle", [90.0, -50.0, 20.0])
def test_the_end_is_in_the_mode_of_the_start(angle):
    """Equal motor angles turn a coaxial wrist as a whole about the axis of its motors.

    Each of the eight orientations of the platform turns with the motors. Only the one in
    the working mode of the start is reached by that turn.
    """
    end = "+".join(f"m{k}={angle}" for k in (1, 2, 3))
    rotation = findings(run_rotation(WRIST, f"start=m1=0+m2=0+m3=0,end={end},samples=3"))
    assert rotation["feasible"] and rotation["end_pose"]["orientations"] == 8
    assert np.degrees(rotation["angle_rad"]) == pytest.approx(abs(angle), abs=1e-7)
    assert np.array(rotation["axis"]) * np.sign(angle) == pytest.approx([0, 0, 1], abs=1e-9)


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("mode", ["1", "2", "3"])
def test_every_mode_of_the_start_has_its_end(mode):
    """In each assembly mode, equal motor angles of 10 deg turn the wrist by 10 deg."""
    parameters = f"start=m1=0+m2=0+m3=0,end=m1=10+m2=10+m3=10,samples=3,mode={mode}"
    rotation = findings(run_rotation(WRIST, parameters))
    assert np.degrees(rotation["angle_rad"]) == pytest.approx(10.0, abs=1e-7)


def test_a_warning_names_the_mode_of_the_end():
    """An end in another mode is not reached; a warning says how to choose."""
    parameters = "start=m1=0+m2=0+m3=0,end=m1=90+m2=90+m3=90,samples=3,end_mode=0"
    result = run_rotation(WRIST, parameters)
    (warning,) = [text for text in result.summary["warnings"] if "rotation ends" in text]
    assert "This one is end_mode=0; choose another with end_mode=0 to 7" in warning


@pytest.mark.parametrize("name", ["five_bar", "two_dof_spm"])
def test_poses_with_a_wrong_number_of_inputs_are_refused(name):
    """One value must not be taken for both inputs, and the message names the inputs."""
    mechanism = sk.load(name)
    form = mid_plane_form(mechanism) if name == "two_dof_spm" else None
    finder = PoseFinder(solver_of(mechanism), mechanism.outputs[0], form)
    for count in (1, 3):
        with pytest.raises(SolveError, match="one value for each of: 21"):
            finder.candidates(AtInputs(np.zeros(count)))


@pytest.mark.parametrize("factor", [2.0, -1.0, np.nan])
def test_orientations_that_are_no_rotations_are_refused_at_start_and_end(factor):
    """A scaled or reflected orientation has no mid-plane, not the one of its rotation."""
    mechanism = sk.load("two_dof_spm")
    finder = PoseFinder(
        solver_of(mechanism), mechanism.outputs[0], mid_plane_form(mechanism)
    )
    start = finder.candidates(AtOrientation(np.eye(3)))
    pose = AtOrientation(factor * np.eye(3))
    with pytest.raises(SolveError, match="rotation matrix"):
        finder.candidates(pose)
    with pytest.raises(SolveError, match="rotation matrix"):
        finder.resolve_end(start, 0, pose, "")
