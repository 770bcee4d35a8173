"""The singularities analysis with one input: planes, moving points, and rows of tables."""

import re
from dataclasses import replace

import numpy as np
import pytest
from helpers.engines import ENGINES
from helpers.scene_listener import SceneListener
from mechanism_examples.named_mechanisms import four_bar
from oracles.four_bar_singularities import ROCKER, findings_and_warnings

import spherekit as sk
from spherekit.mechanism.elements import Input
from spherekit.scenes.scene import GreatCircle, InputMarks, Portrait

NAME = "singularities"
TURN = 2.0 * np.pi


@pytest.mark.slow
@pytest.mark.parametrize("output", ["5/3", "6/1"])
def test_the_drawn_planes_coincide_at_type_1(output):
    """The two planes that are drawn at a singularity of type I are the same plane.

    The input of the Stephenson six-bar is link 2 relative to link 1. The output 5/3 has
    two other links, the output 6/1 has the same reference link.
    """
    listener = SceneListener()
    result = sk.run("stephenson", f"{NAME}:output={output}", samples=5, recorder=listener)
    frame = result.frame()
    assert len(frame) and set(frame["kind"]) == {"I"}
    planes = listener.primitives(GreatCircle, "Singularities").values()
    first, second = (plane.normals for plane in planes)
    assert len(first) == len(frame)
    assert np.max(np.linalg.norm(np.cross(first, second), axis=1)) < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("name", ["four_bar", "rolling_cones"])
def test_the_moving_point_stays_on_its_curve_in_each_turn_of_the_input(name):
    """The moving point of a plot over the input lies on a drawn curve in each turn.

    Lines between the drawn points deviate little from the curve. The input of the rolling
    cones turns 25 times along their curve, so drawn points are 34 deg apart.
    """
    mechanism = sk.load(name)
    (only_input,) = mechanism.inputs
    mechanism = replace(mechanism, inputs=(replace(only_input, start=0.0, stop=2 * TURN),))
    listener = SceneListener()
    result = sk.run(mechanism, NAME, samples=9, recorder=listener)
    for mode in set(result.frame("motion")["assembly_mode"]):
        (portrait,) = listener.primitives(Portrait, mode).values()
        points = np.stack([portrait.x, portrait.y], axis=1)
        distances = np.full(len(points), np.inf)
        for curve in portrait.curves:
            starts, steps = curve.points[:-1], np.diff(curve.points, axis=0)
            # (points, lines) the nearest place on each line, as a fraction of the line.
            offsets = points[:, None] - starts
            fractions = np.vecdot(offsets, steps) / np.vecdot(steps, steps)
            misses = offsets - np.clip(fractions, 0.0, 1.0)[..., None] * steps
            nearest = np.nanmin(np.linalg.norm(misses, axis=-1), axis=1)
            distances = np.minimum(distances, nearest)
        # The line of a closed curve ends half a degree before its start.
        assert np.max(distances) < np.radians(0.5)


def test_marks_of_self_motions_are_called_so():
    """An output that is the input rests with it; marks of this say self-motion."""
    listener = SceneListener()
    result = sk.run(four_bar(ROCKER), f"{NAME}:output=2/1", samples=9, recorder=listener)
    assert set(result.frame()["kind"]) == {"self-motion"}
    primitives = [part for scene in listener.scenes for part in scene.primitives]
    marks = [part for part in primitives if isinstance(part, InputMarks)]
    for part in primitives:
        if isinstance(part, Portrait):
            marks += part.marks
    assert {mark.label for mark in marks} == {"self-motion"}


@pytest.mark.slow
def test_a_simulation_does_not_meet_curves_on_which_the_input_rests_elsewhere():
    """A simulation from 1 rad to 1.4 rad reports no singularities at the input 0.

    The kite folds at the input 0. There the rocker can turn freely while the input rests.
    These configurations form two curves of their own. Each curve as a whole is a row of the
    table, of type II: the input rests. Such a row has no value of the input (q is NaN).

    The table has all singularities of the mechanism. In the column ``inside``, "no" means
    that the simulation does not pass the singularity.
    """
    kite = replace(four_bar(np.radians([60.0, 60.0, 40.0, 40.0])), loads=())
    start = {"q": 1.0, "dq": 0.5}
    result = sk.run(kite, NAME, start=start, duration=1.0, samples=5, engine="numpy")
    frame = result.frame()
    at_rest = frame[frame["q"].isna()]
    assert set(at_rest["kind"]) == {"II"}
    assert set(at_rest["inside"]) == {"no"}
    findings, warnings = findings_and_warnings(result)
    assert findings[NAME] == {}
    assert not any("meets a singularity" in text for text in warnings)


@pytest.mark.slow
def test_the_relation_has_all_rows_if_all_samples_are_crossings():
    """All three samples of a parallelogram are flat; the table has them as type III."""
    parallelogram = four_bar(np.radians([60.0, 40.0, 60.0, 40.0]))
    result = sk.run(parallelogram, NAME, samples=3)
    relation = result.frame(NAME, "relation")
    forms = relation["form"].nunique()
    assert forms == 2
    assert len(relation) == forms * len(result.frame("motion"))
    assert set(relation["type"]) == {"III"}
    assert set(relation["status"].astype(str)) == {"AT_SINGULARITY"}


@pytest.mark.slow
@pytest.mark.parametrize("output", ["4/1", "1/4"])
def test_an_output_angle_grows_with_a_positive_velocity_coefficient(output):
    """The slope of the plot of an output over the input is the velocity coefficient.

    Link 4 is the second link of the pair 41, so the output 1/4 has the opposite angle and
    the opposite velocity coefficient of 4/1.
    """
    listener = SceneListener()
    result = sk.run("four_bar", f"{NAME}:output={output}", samples=361, recorder=listener)
    relation = result.frame(NAME, "relation")
    for mode, rows in relation[relation["form"] == "i"].groupby("assembly_mode"):
        (portrait,) = listener.primitives(Portrait, mode).values()
        slopes = np.gradient(np.unwrap(portrait.y[:-1]), portrait.x[:-1])
        coefficients = rows["velocity_coefficient"].to_numpy()[:-1]
        assert np.max(np.abs(slopes - coefficients)[1:-1]) < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("arcs", [[60.0, 25.0, 50.0, 55.0], [60.0, 60.0, 40.0, 40.0]])
def test_a_reversed_output_swings_between_the_opposite_angles(arcs):
    """The output 1/4 has the opposite angles of 4/1, also at crossings of curves (kite)."""
    result = sk.run(four_bar(np.radians(arcs)), f"{NAME}:output=4/1+1/4", samples=5)
    ranges = {"4/1": [], "1/4": []}
    for remark in result.summary["remarks"]:
        if found := re.search(r"(4/1|1/4)\)? swings .* from (\S+) to (\S+) deg", remark):
            output, low, high = found.groups()
            ranges[output].append((float(low), float(high)))
    assert ranges["4/1"]
    opposite = [(0.0 - high, 0.0 - low) for low, high in ranges["4/1"]]
    assert ranges["1/4"] == opposite


@pytest.mark.slow
def test_an_output_that_is_given_twice_is_listed_once():
    """4/1 and 41 are the same output, whose singularities and remarks are given once."""
    once, twice = (
        sk.run("four_bar", f"{NAME}:output={output}", samples=5)
        for output in ("4/1", "4/1+41")
    )
    assert len(once.frame()) == 4
    assert len(twice.frame()) == 4
    assert twice.summary["remarks"] == once.summary["remarks"]


@pytest.mark.parametrize(
    ("rate", "duration", "passed"),
    [
        (0.5, 0.3, set()),
        (-1.0, 0.8, {46.52}),
        (1.5, 0.8, {117.82}),
        (5.0, 1.2, {46.52, 117.82}),
    ],
)
def test_a_simulation_passes_the_dead_centres_between_its_samples(rate, duration, passed):
    """The rocker drives a crank-rocker, and turns back at dead centres (type II).

    The dead centres of the rocker are at 46.52 and 117.82 deg.
    """
    rocker = Input("41", *np.radians([47.0, 117.0]))
    mechanism = replace(sk.load("four_bar"), loads=(), inputs=(rocker,))
    start = {"q": 1.4, "dq": rate}
    result = sk.run(
        mechanism, NAME, start=start, duration=duration, samples=21, engine="numpy"
    )
    frame = result.frame()
    events = result.summary["simulation"]["event_list"]
    assert {event["kind"] for event in events} <= {"dead_centre"}
    is_inside = frame["inside"] == "yes"
    found = set(np.degrees(frame["q"][is_inside]).round(2))
    assert found == passed
    assert bool(events) == bool(found)
    warns = any("type II in the range" in text for text in result.summary["warnings"])
    assert warns == bool(found)


@pytest.mark.slow
@pytest.mark.parametrize("samples", [9, 41])
@pytest.mark.parametrize(
    ("arcs", "rate", "duration", "crossings", "dead_centres"),
    [
        # A parallelogram is flat at 180 and at 360 deg.
        ([60.0, 40.0, 60.0, 40.0], 2.0, 6.0, [180.0, 360.0], []),
        # The rocker turns back at 236.9 deg of each second turn, here of the second one.
        ([50.0, 30.0, 60.0, 40.0], 3.0, 4.5, [360.0], [596.863]),
    ],
)
def test_a_crossing_that_a_simulation_passes_is_inside(
    arcs, rate, duration, crossings, dead_centres, samples
):
    """The crossings are the events of the simulation."""
    mechanism = replace(four_bar(np.radians(arcs)), loads=())
    result = sk.run(
        mechanism,
        NAME,
        start={"q": 2.5, "dq": rate},
        duration=duration,
        samples=samples,
        engine="numpy",
        crossings="pass",
    )
    events = result.summary["simulation"]["event_list"]
    assert [event["kind"] for event in events] == ["crossing"] * len(crossings)
    frame = result.frame()
    inside = frame[frame["inside"] == "yes"]
    for kind, expected in (("III", crossings), ("I", dead_centres)):
        rows = inside[inside["kind"] == kind]
        assert len(rows) == len(expected)
        assert np.allclose(np.degrees(rows["q"]), expected, rtol=0.0, atol=1e-3)
        assert set(rows["assembly_mode"]) <= {"0"}


@pytest.mark.slow
@pytest.mark.parametrize("engine", ENGINES)
def test_a_crossing_at_which_a_simulation_ends_is_inside(engine):
    """A parallelogram moves from 143 deg to 180 deg, where it is flat."""
    arcs = np.radians([60.0, 40.0, 60.0, 40.0])
    mechanism = replace(four_bar(arcs), loads=())
    start = {"q": 2.5, "dq": 2.0}
    result = sk.run(mechanism, NAME, start=start, duration=1.0, samples=4, engine=engine)
    assert result.summary["simulation"]["end"]["kind"] == "singularity"
    frame = result.frame()
    assert set(frame["kind"]) == {"III"}
    passed = frame["q"][frame["inside"] == "yes"]
    assert len(passed) == 1 and len(frame) == 2
    assert np.allclose(passed, np.pi, rtol=0.0, atol=1e-9)
