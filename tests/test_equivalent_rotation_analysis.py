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
from spherekit.geometry.mirror import normal_at, upward
from spherekit.geometry.rotation import from_quaternion, quaternion, rotation_about_axis
from spherekit.geometry.sphere_mesh import spiral_directions
from spherekit.geometry.tilt_torsion import tilt_torsion
from spherekit.mechanism.elements import Output
from spherekit.numerics.angles import wrap
from spherekit.outputs.fixed_axis_rotation import FollowedRotation, axis_and_angle
from spherekit.outputs.mid_plane_symmetry import mid_plane_form
from spherekit.outputs.output_pose import AtDirection, AtInputs, PoseFinder
from spherekit.outputs.pose_solver import closed_kinematics
from spherekit.outputs.workspace import judge, orientation_samples
from spherekit.runs.needs import Needs
from spherekit.runs.registry import create_analysis
from spherekit.scenes.scene import GreatCircle, Series, SphereCurves
from spherekit.singularities.slices import solver_of

NAME = "equivalent_rotation"
QUATERNION = ("qx", "qy", "qz", "qw")
TABLE_3 = f"{NAME}:start=phi=75+gamma=-20,end=phi=70+gamma=20"


def ran(mechanism, text, **options):
    """Run the analysis alone."""
    return sk.run(mechanism, text if NAME in text else f"{NAME}:{text}", **options)


def schedule(result):
    return result.frame(NAME, "schedule", degrees=True)


def findings(result):
    assert not result.failures, result.failures
    (own,) = result.summary["analyses"]
    return own["findings"]


def degrees(result, *columns):
    return result.frame(NAME, degrees=True)[list(columns)].to_numpy()


@pytest.fixture(scope="module")
def listener():
    return SceneListener()


@pytest.fixture(scope="module")
def table_3(listener):
    text = TABLE_3 + ",theta=0+13+26+40.323061,speed=30,acceleration=70,samples=41"
    return ran("two_dof_spm", text, assembly_mode=0, recorder=listener)


def test_rows_of_table_3(table_3):
    """Printed in Chen et al. 2021, Table 3; gamma of configuration 3 has lost its sign.

    The rows between show the rounding of the paper: up to 6.2e-4 degrees.
    """
    printed = [
        (75.0, -20.0, 5.3391, 56.7404),
        (74.5359, -7.1049, 18.3470, 35.3134),
        (72.9604, +5.7918, 32.3670, 18.9834),
        (70.0, 20.0, 49.2440, 3.7442),
    ]
    found = degrees(table_3, "phi", "gamma", "q_21", "q_61")
    assert found == pytest.approx(np.array(printed), abs=6.2e-4)
    assert found[0] == pytest.approx(np.array(printed[0]), abs=5.1e-5)
    own = findings(table_3)
    axis = [-0.7933, 0.1257, -0.5957]
    assert own["axis_in_mirror_axes"] == pytest.approx(axis, abs=5.1e-5)
    assert np.degrees(own["angle_rad"]) == pytest.approx(40.3230, abs=7e-5)
    assert own["feasible"] and own["end"] == "OK"
    assert own["largest_orientation_error_rad"] < 1e-14 and own["largest_drift_rad"] < 1e-14
    (text,) = table_3.summary["warnings"]
    assert "meets a type II singularity at theta = 30.9007 deg, 21 = 37.95" in text
    (said, *_) = table_3.summary["remarks"]
    assert "(-0.793330, 0.125686, -0.595677) in axes of the mirror (x0, y0, z0)" in said
    assert "in axes of link 1" in said


def test_schedule_is_a_table_in_time(table_3):
    """The limit that binds is met, and no other one is passed."""
    frame = schedule(table_3)
    units = frame.attrs["units"]
    assert units["dq_21"] == "deg/s" and units["ddq_61"] == "deg/s2"
    assert units["t"] == "s" and units["theta"] == units["q_21"] == "deg"
    own = findings(table_3)["schedule"]
    assert own["set_by"].startswith("speed of 61")
    top = max(abs(e["value"]) for e in own["extremes"] if e["quantity"] == "speed")
    assert np.degrees(top) == pytest.approx(30.0, abs=1e-9)
    assert len(frame) == 41 and frame["t"].iloc[-1] == pytest.approx(own["duration_s"])
    assert frame["dq_61"].abs().max() <= 30.0 + 1e-9
    assert frame["ddq_21"].abs().max() <= 70.0 + 1e-9


@pytest.mark.slow
def test_schedule_in_cycles_of_a_controller():
    """A row for each cycle, a whole number of them, no limit passed, no time wasted."""
    way = "start=phi=75+gamma=-20,end=phi=70+gamma=20,speed=30,samples=5"
    least = findings(ran("two_dof_spm", way))["schedule"]["duration_s"]
    result = ran("two_dof_spm", f"{way},cycle=0.004")
    own, table = findings(result)["schedule"], schedule(result)
    t = table["t"].to_numpy()
    assert own["cycle_s"] == 0.004
    assert np.max(np.abs(t - 0.004 * np.arange(len(t)))) < 1e-12
    assert least <= t[-1] == own["duration_s"] < least + 0.004
    assert table[["dq_21", "dq_61"]].abs().to_numpy().max() <= 30.0
    assert np.abs(table[["dq_21", "dq_61"]].iloc[-1]).max() < 1e-9
    assert schedule(ran("two_dof_spm", f"{way},cycle=1e-9")).empty
    assert len(schedule(ran("two_dof_spm", f"{way},cycle={least / 7!r}"))) == 8


def test_a_failed_row_is_not_feasible(monkeypatch):
    """Whatever fails on the way is said, though the end is reached."""
    whole = FollowedRotation.at

    def partly(turn, theta):
        found = whole(turn, theta)
        status = found.status.copy()
        status[2:3] = sk.Status.NOT_CONVERGED
        return replace(found, status=status)

    monkeypatch.setattr(FollowedRotation, "at", partly)
    result = ran("two_dof_spm", "start=phi=75+gamma=-20,end=phi=74+gamma=-20,samples=5")
    own = findings(result)
    assert own["failed_rows"] == 1 and not own["feasible"]
    assert any("1 of 5 rows failed" in text for text in result.summary["warnings"])


def test_modes_of_the_start_are_listed_and_chosen():
    text = TABLE_3 + ",samples=2,mode="
    own = findings(ran("two_dof_spm", text + "+-+"))
    assert [c["mode"] for c in own["start"]["configurations"]][:2] == ["-++", "-+-"]
    assert own["start"]["number"] == 6
    found = degrees(ran("two_dof_spm", text + "6"), "q_21", "q_61")
    assert found[0] == pytest.approx([113.7956, 100.7573], abs=5.1e-5)  # docs, Fig. 5


def test_one_pose_in_all_its_terms():
    """By mid-plane, inputs, orientation, tilt and torsion, turn: the same rotation."""
    mechanism = sk.load("two_dof_spm")
    form = mid_plane_form(mechanism)
    normals = np.stack([normal_at(*np.radians(p)) for p in ((75.0, -20.0), (70.0, 20.0))])
    first, second = form.orientations(normals)
    q = quaternion(second[None])[0]
    tilt = np.degrees(tilt_torsion(first[None]))[0]
    u, angle = axis_and_angle(first, second)
    turn = said(("ux", "uy", "uz", "angle"), [*u, np.degrees(angle)])
    want = degrees(ran("two_dof_spm", TABLE_3 + ",samples=3"), "q_21", "q_61")
    for start, end in (
        ("21=5.339100020817853+61=56.74044673238507", said(QUATERNION, q)),
        (said(("azimuth", "tilt", "torsion"), tilt), turn),
    ):
        result = ran("two_dof_spm", f"start={start},end={end},samples=3")
        assert findings(result)["feasible"]
        assert degrees(result, "q_21", "q_61") == pytest.approx(want, abs=1e-10)


def test_nearest_reachable_pose_is_offered():
    """Against a dense sample of the sphere: nothing reachable is nearer than the offer."""
    plane = mid_plane_form(sk.load("two_dof_spm")).plane
    every, limits = spiral_directions(200_000), np.sin(plane.arcs)
    inside = upward(every[np.all(np.abs(every @ plane.axes.T) <= limits, axis=1)])
    for pose in ((120.0, 0.0), (-70.0, 40.0), (100.0, -60.0), (0.0, 120.0)):
        normal = normal_at(*np.radians(pose))
        found = plane.nearest(normal)
        assert np.all(np.abs(plane.axes @ found) <= limits + 1e-9)
        best = np.max(np.abs(inside @ normal))
        assert abs(found @ normal) >= best - 1e-9
        assert np.arccos(abs(found @ normal)) > np.arccos(best) - 0.02
    reached = normal_at(*np.radians((40.0, 10.0)))
    assert plane.nearest(reached) == pytest.approx(reached, abs=1e-15)
    far = "start=phi=75+gamma=-20,end=phi=120+gamma=0"
    text = ran("two_dof_spm", far).failures[NAME]
    assert "legs at 21, 61, 81 do not reach" in text
    offered = text.split("nearest pose inside is ")[1].removesuffix(" deg")
    again = "start=phi=75+gamma=-20,end=" + offered.replace(" ", "").replace(",", "+")
    assert findings(ran("two_dof_spm", again + ",samples=2"))["feasible"]


@pytest.mark.slow
def test_end_of_the_reach_on_the_way():
    """The closed form of where legs end against samples, over random pairs of poses."""
    form = mid_plane_form(sk.load("two_dof_spm"))
    ended = 0
    for a, b in np.random.default_rng(7).normal(size=(8, 2, 3)):
        turn_axis, start = np.cross(a, b), a / np.linalg.norm(a)
        if np.any(np.abs(form.plane.axes @ start) > np.sin(form.plane.arcs) - 1e-3):
            continue
        about = form.frame @ (turn_axis / np.linalg.norm(turn_axis))
        turn = form.rotation_about(start, about, 3.0, np.ones(3))
        theta = np.linspace(0.0, 3.0, 4001)
        turned = rotation_about_axis(form.frame.T @ about, 0.5 * theta) @ start
        elbows, _ = form.plane.elbows(turned, (1, 1, 1))
        lost = np.any(np.isnan(elbows[..., 0]), axis=1)
        first = theta[np.argmax(lost)] if np.any(lost) else 3.0
        assert first - 3.0 / 4000 <= turn.reached + 1e-9 and turn.reached <= first + 1e-9
        ended += int(np.any(lost))
    assert ended > 1


def said(names, values):
    return "+".join(f"{name}={x:.17g}" for name, x in zip(names, values, strict=True))


def test_a_mechanism_with_two_inputs_departs():
    """A five-bar has no third freedom: it departs between the ends."""
    result = ran("five_bar", "start=21=60+51=100,end=21=75+51=75,samples=21,speed=60")
    own = findings(result)
    assert not own["feasible"] and own["end"] == "OK"
    found = degrees(result, "q_21", "q_51", "phi", "orientation_error")
    ends = [[60.0, 100.0, 0.0], [75.0, 75.0, 0.0]]
    assert found[[0, -1]][:, [0, 1, 3]] == pytest.approx(np.array(ends), abs=1e-9)
    most = np.degrees(own["largest_orientation_error_rad"])
    assert np.all(np.isnan(found[:, 2])) and most == pytest.approx(np.max(found[:, 3]))
    assert "does not turn about a fixed axis" in result.summary["warnings"][0]


def test_a_direction_as_the_end():
    result = ran("five_bar", "start=21=60+51=100,end=x=0.2+y=1+z=0.1,samples=3")
    assert not findings(result)["feasible"]
    found = result.frame(NAME)[["q_21", "q_51"]].to_numpy()[-1:]
    turned = sk.ForwardKinematics("five_bar").solutions(found).directions
    wanted = np.array([0.2, 1.0, 0.1]) / np.linalg.norm([0.2, 1.0, 0.1])
    assert np.min(np.linalg.norm(turned - wanted, axis=1)) < 1e-12


@pytest.mark.slow
def test_a_direction_of_a_mid_plane_form():
    """The one mid-plane in closed form against the inverse kinematics of all links."""
    made = sk.load("two_dof_spm")
    finder = PoseFinder(solver_of(made), made.outputs[0], mid_plane_form(made))
    wanted = np.array([0.9, 0.1, 0.4])
    found = finder.candidates(AtDirection(wanted))
    wanted /= np.linalg.norm(wanted)
    assert len(found) == 8
    points = found.orientations @ np.array(made.outputs[0].direction)
    assert np.max(np.abs(points - wanted)) < 1e-13
    graph = sk.InverseKinematics(made).solutions(wanted)
    for k in range(len(found)):
        gap = np.abs(graph.rotations - found.orientations[k]).max(axis=(1, 2))
        gap += np.abs(np.angle(np.exp(1j * (graph.values - found.values[k])))).max(axis=1)
        assert np.min(gap) < 1e-10
    with pytest.raises(SolveError, match="in every mid-plane"):
        finder.candidates(AtDirection(finder.form.frame @ finder.form.home))


def test_one_input_turns_a_rocker_about_its_axis():
    result = ran("four_bar", "start=21=60,end=21=90,samples=4")
    assert findings(result)["feasible"]
    assert degrees(result, "q")[[0, -1], 0] == pytest.approx([60.0, 90.0], abs=1e-9)
    assert len(schedule(result)) == 0


def test_singular_ends_come_last():
    """At every input the agile eye also has its unit pose, where no leg moves it."""
    made = sk.load("agile_eye")
    finder = PoseFinder(solver_of(made), made.outputs[0], None)
    found = finder.candidates(AtInputs(np.radians([20.0, 15.0, -10.0])))
    assert found.singular.tolist() == [False] * 4 + [True] * 4
    unit = np.max(np.abs(found.orientations - np.eye(3)), axis=(1, 2)) < 1e-9
    assert np.flatnonzero(unit)[0] >= 4


def asked(text):
    create_analysis(f"{NAME}:{text}").needs(sk.load("two_dof_spm"))


def outcome(name, text):
    raise AnalysisError(ran(name, text.replace("TABLE_3", TABLE_3)).failures[NAME])


@pytest.mark.parametrize("call", TABLES["rotations asked for"])
def test_what_is_asked_for_wrongly(call):
    check_call(call, globals(), TABLES["rotations asked for"][call])


def test_more_inputs_than_ways_to_turn_are_refused():
    from spherekit_analyses.equivalent_rotation.analysis import EquivalentRotation

    made = sk.load("three_rrr")
    item = made.inputs[0]
    many = replace(made, inputs=(*made.inputs, replace(item, pair="b1")))
    with pytest.raises(AnalysisError, match="4 inputs turn the output link in more ways"):
        EquivalentRotation(start="", end="").needs(many)
    asks = EquivalentRotation(start="a1=1+a2=2+a3=3", end="a1=1+a2=2+a3=4")
    assert asks.needs(made) == Needs(tracer=True)


def near_the_reach(eps):
    """Two orientations of three_rrr: beside the border of its reach, and well within."""
    kinematics = closed_kinematics(sk.load("three_rrr"))
    signs = kinematics.modes[0]
    every = orientation_samples(400)
    margin = judge(kinematics, kinematics.bounds, signs, every).margin
    inner, outer = every[np.argmax(margin)], every[np.argmin(margin)]

    def at(part):
        place = (1.0 - part) * inner + part * outer
        return place / np.linalg.norm(place)

    def left(part):
        return judge(kinematics, kinematics.bounds, signs, at(part)[None]).margin[0]

    border = brentq(left, 0.0, 1.0, xtol=1e-16)
    start, end = (said(QUATERNION, place) for place in (at(border - eps), inner))
    return f"start={start},end={end},speed=30"


@pytest.mark.parametrize("eps", [1e-5, 1e-7])
def test_a_rotation_from_near_a_dead_centre_has_a_schedule(eps):
    """Inputs turn by 1e3 and more for each rad of the output there."""
    result = ran("three_rrr", near_the_reach(eps))
    assert findings(result)["end"] == "OK"
    assert not [text for text in result.summary["warnings"] if "schedule" in text]
    rates = degrees(result, "dq_dtheta_a1", "dq_dtheta_a2", "dq_dtheta_a3")
    assert np.max(np.abs(rates[0])) > 0.1 / np.sqrt(eps)
    assert np.all(np.isfinite(schedule(result)["dq_a1"]))


def test_a_dead_centre_at_the_start_is_named():
    told = ran("three_rrr", near_the_reach(1e-13)).summary["warnings"]
    (text,) = (text for text in told if "the rotation ends at 0 of" in text)
    assert "input a" in text and "is at a dead centre there" in text


def test_page_of_a_rotation(table_3, listener):
    scene, rows = listener.last_scene("Equivalent rotation")
    assert len(scene.over[0].values) == rows == 4
    parts = {part.path: part for part in scene.primitives}
    assert sum(path.startswith("link/") for path in parts) == 10
    axis = parts["axis"].directions
    assert np.max(np.abs(axis - findings(table_3)["axis"])) < 1e-15
    path = parts["arc/pointer"]
    assert isinstance(path, SphereCurves) and len(path.marks) == 2
    (line,) = path.curves
    height = line @ axis[0]  # an arc about a fixed axis keeps its distance from it
    assert np.ptp(height) < 1e-14
    circle = parts["mid_plane/now"]
    assert isinstance(circle, GreatCircle)
    assert np.max(np.abs(np.sum(circle.normals * axis, axis=1))) < 1e-14
    for name in ("start", "end"):
        (fixed,) = parts[f"mid_plane/{name}"].curves
        assert np.max(np.abs(fixed @ circle.normals[0 if name == "start" else -1])) < 1e-14
    assert len(parts["lost"].marks) == 1
    assert np.degrees(parts["marks/lost"].inputs) == pytest.approx(30.9007, abs=1e-4)
    assert "30.9007" in parts["words"].markdown


def test_page_of_a_schedule(table_3, listener):
    scene, rows = listener.last_scene("Equivalent rotation in time")
    frame = table_3.frame("equivalent_rotation", "schedule")
    assert scene.over[0].values.tolist() == frame["t"].tolist() and rows == 41
    plots = {item.path: item.values for item in scene.primitives if type(item) is Series}
    assert plots["plots/dq/21"] == pytest.approx(frame["dq_21"].to_numpy())
    assert plots["plots/ddq/61"] == pytest.approx(frame["ddq_61"].to_numpy())


@pytest.mark.slow
def test_pages_where_the_rotation_ends_early():
    """Rows beyond the reach are NaN, and no page fails for it."""
    text = "start=a1=40+a2=50+a3=60,end=ux=0+uy=0+uz=1+angle=170,samples=9,speed=10"
    watcher = SceneListener()
    result = ran("three_rrr", text, recorder=watcher)
    assert findings(result)["end"] != "OK" and np.any(np.isnan(degrees(result, "q_a1")))
    told = "; ".join(result.summary["warnings"])
    assert "the rotation ends at" in told and "there is no schedule" in told
    assert "Equivalent rotation in time" not in watcher.primitives_by_page


def test_base_that_moves():
    """An output relative to a moving link: axis and links are in ground axes."""
    made = replace(sk.load("five_bar"), outputs=(Output("hand", "3", "5"),))
    text = "start=21=60+51=100,end=21=75+51=75,samples=5"
    watcher = SceneListener()
    result = ran(made, text, recorder=watcher)
    own = findings(result)
    assert own["output"] == "hand"
    parts = {part.path: part for part in watcher.primitives_by_page["Equivalent rotation"]}
    base = from_quaternion(parts["link/5"].quaternions)
    assert np.max(np.abs(parts["axis"].directions - base @ own["axis"])) < 1e-12
    link = from_quaternion(parts["link/3"].quaternions)
    relative = tilt_torsion(np.swapaxes(base, 1, 2) @ link)
    found = np.radians(degrees(result, "azimuth", "tilt", "torsion"))
    assert np.max(np.abs(wrap(relative - found))) < 1e-9


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
    told = findings(ran(WRIST, f"start=m1=0+m2=0+m3=0,end={end},samples=3"))
    assert told["feasible"] and told["end_pose"]["orientations"] == 8
    assert np.degrees(told["angle_rad"]) == pytest.approx(abs(angle), abs=1e-7)
    assert np.array(told["axis"]) * np.sign(angle) == pytest.approx([0, 0, 1], abs=1e-9)


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("mode", ["1", "2", "3"])
def test_every_mode_of_the_start_has_its_end(mode):
    text = f"start=m1=0+m2=0+m3=0,end=m1=10+m2=10+m3=10,samples=3,mode={mode}"
    told = findings(ran(WRIST, text))
    assert np.degrees(told["angle_rad"]) == pytest.approx(10.0, abs=1e-7)


def test_a_warning_names_the_mode_of_the_end():
    text = "start=m1=0+m2=0+m3=0,end=m1=90+m2=90+m3=90,samples=3,end_mode=0"
    result = ran(WRIST, text)
    (warning,) = [x for x in result.summary["warnings"] if "rotation ends" in x]
    assert "this one is end_mode=0; choose another with end_mode=0 to 7" in warning
