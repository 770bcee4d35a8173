"""Rolling and sliding contact: cams as four-bars, gears, exact derivatives."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.analysis_runs import evaluate_poles_of_motion
from helpers.refusals import TABLES, check_call, mechanism_text
from mechanism_examples.named_mechanisms import (
    ARM,
    DEGREE,
    DISC,
    ECCENTRICITY,
    GROUND,
    ROLLER,
    cam_with_follower,
    direction_at_colatitude,
    open_cam,
)
from oracles.velocity_equations import null_space, sine_between_lines

import spherekit as sk
from spherekit.cli.main import main
from spherekit.files.mechanism_reader import loads
from spherekit.mechanism.elements import (
    LinkSizes,
    Pair,
    PoseGeometry,
    Profile,
    SizeGeometry,
)
from spherekit.planning.pole_plan import all_poles
from spherekit.planning.pole_planner import plan

ROOT = Path(__file__).parent.parent


EVEN, ODD = (25 * DEGREE, 4 * DEGREE, 3 * DEGREE), (0.0, 0.0, 1.0 * DEGREE)
SHAPE = Profile("fourier", (0.0, 0.0, 1.0), cosines=EVEN, sines=ODD)


BY_GRAPH = {"bevel_pair": 0, "rolling_cones": 0, "planetary_bevel": -1} | dict.fromkeys(
    ("roller_cam", "flat_cam", "shaped_cam", "shaped_flat_cam"), 1
)
HUMPAGE = mechanism_text("humpage")


def test_humpages_gear_has_the_speed_ratios_of_its_pitch_cones(tmp_path):
    """Humpage's reduction gear turns by the ratios of the sines of its pitch cones.

    Sun, fixed ring, output and arm are coaxial. The planet on the arm has two wheels on one
    axis. Its larger wheel meshes with the sun and the ring, its smaller one with the output
    wheel. The pitch cones have the half angles 18 (sun), 78 (ring), 42 and 25 (planet), 95
    deg (output).

    Relative to the arm, two wheels in mesh turn at rates in inverse proportion to the sines
    of their half angles. With the sines s and r of sun and ring, the arm turns by s / (s +
    r) of the sun. With the sines p and q of the larger and the smaller wheel of the planet,
    and o of the output, the output turns by (1 - r q / (p o)) of the arm.
    """
    path = tmp_path / "humpage.toml"
    path.write_text(HUMPAGE)
    mechanism = sk.load(path)
    sun, ring, larger_planet, out = np.sin(np.radians([18.0, 78.0, 42.0, 95.0]))
    smaller_planet = np.sin(np.radians(25.0))
    arm_ratio = sun / (sun + ring)
    out_ratio = arm_ratio * (1.0 - ring * smaller_planet / (larger_planet * out))
    rows = sk.evaluate(mechanism, 0.4)
    assert np.max(np.abs(rows.velocity_coefficient("arm/case") - arm_ratio)) < 1e-13
    # In the file the axis of the output shaft has the direction opposite to those of sun
    # and arm, so the coefficient is negative.
    out_coefficient = np.abs(rows.velocity_coefficient("out/case"))
    assert np.max(np.abs(out_coefficient - out_ratio)) < 1e-13


def test_humpages_gear_is_kept_in_files_and_certified(tmp_path, capsys):
    """Humpage's gear is read from a file, written again, and its ratio is proven.

    The command `certify` prints the turns of the arm per turn of the sun, s / (s + r), with
    the sines s and r of the half angles of the pitch cones of sun and ring.

    Sun and planet can mesh because the arm, on which the planet turns, turns about the axis
    of the sun. A file in which the arm turns about another axis is refused.
    """
    path = tmp_path / "humpage.toml"
    path.write_text(HUMPAGE)
    mechanism = sk.load(path)
    sk.dump(mechanism, tmp_path / "copy.toml")
    assert sk.load(tmp_path / "copy.toml") == mechanism

    sun, ring = np.sin(np.radians([18.0, 78.0]))
    assert main(["certify", str(path)]) == 0
    assert f"arm_shaft turns by {sun / (sun + ring):+.10f}" in capsys.readouterr().out

    # The arc between the axes of sun and arm becomes 10 deg.
    path.write_text(HUMPAGE.replace("arcs = [0.0, 180.0]", "arcs = [10.0, 180.0]"))
    with pytest.raises(sk.SpherekitError, match="nor does a pair coaxial"):
        sk.load(path)


@pytest.mark.parametrize("name, by_graph", BY_GRAPH.items())
def test_shipped_contact_mechanisms_run_over_their_whole_range(name, by_graph):
    result = sk.run(sk.load(name), "poles", samples=37)
    assert not result.failures
    assert result.summary["status"] == {"OK": 37 * len(result.summary["assembly_modes"])}
    assert result.summary["errors_reached"]["largest_closure_residual_rad"] < 1e-13
    assert result.summary["mobility"] == {"rank": 1, "graph": by_graph}
    repeated = result.summary["redundant_constraints"]
    assert repeated["count"] == 1 - by_graph
    all_pairs = sorted(pair.name for pair in sk.load(name).pairs)
    assert sorted(repeated["pairs"]) == (all_pairs if repeated["count"] else [])


def test_internal_bevel_gears_turn_by_the_ratio_of_their_teeth():
    """Internal bevel gears turn by the ratio of their teeth, here 20 / 50.

    `pitch_angles` returns half angles d1 and d2 of the pitch cones with sin d1 / sin d2 =
    N1 / N2, and with the difference d2 - d1 equal to the shaft angle. A mechanism with
    circles of these half angles must have the velocity coefficient N1 / N2.
    """
    from spherekit.mechanism.bevel_gears import pitch_angles

    shaft_angle = 30 * DEGREE
    first, second = pitch_angles((20, 50), shaft_angle, "internal")
    assert second - first == pytest.approx(shaft_angle, abs=1e-15)
    assert np.sin(first) / np.sin(second) == pytest.approx(20 / 50, abs=1e-15)

    external = sk.load("bevel_pair")
    circles = tuple(Profile("circle", (0.0, 0.0, 1.0), r) for r in (first, second))
    sizes = {**external.geometry.links, "0": LinkSizes(("01", "02"), (shaft_angle,))}
    pairs = []
    for pair in external.pairs:
        if pair.name == "12":
            pair = replace(pair, profiles=circles, contact="internal")
        pairs.append(pair)
    internal = replace(external, pairs=tuple(pairs), geometry=SizeGeometry(sizes))
    _, field = evaluate_poles_of_motion(internal, samples=13)
    ground, second_wheel = 0, 2  # numbers of links
    coefficient = field.velocity_coefficient[ground, second_wheel]
    assert np.max(np.abs(coefficient - 20 / 50)) < 1e-13


@pytest.mark.slow
def test_redundant_constraints_are_named_and_rigid_wheels_refused():
    made = sk.load("bevel_pair")
    assert plan(made).steps
    # two wheels that also roll on each other elsewhere cannot turn: rank leaves no freedom
    circle = Profile("circle", direction_at_colatitude(0.3), 0.2)
    pairs = (*made.pairs, Pair("x", "Cr", ("1", "2"), (circle, circle)))
    with pytest.raises(sk.SpherekitError):
        sk.trace(replace(made, pairs=pairs))


@pytest.mark.slow
def test_running_off_an_open_profile_has_a_status():
    """The open cam is an arc of a closed one: it moves alike, and then loses its roller."""
    roller = Profile("circle", direction_at_colatitude(ARM), ROLLER)
    closed_cam = cam_with_follower(GROUND, SHAPE, roller)
    closed_motion = sk.trace(closed_cam, samples=73, search=False)
    open_motion = sk.trace(open_cam(), samples=73, search=False)
    assert np.any(open_motion.status == sk.Status.OK)
    assert np.any(open_motion.status == sk.Status.OFF_PROFILE)
    follower = 1  # variable of pair 13
    for row in np.flatnonzero(open_motion.status == sk.Status.OK):
        is_same_input = np.abs(closed_motion.q - open_motion.q[row]) < 1e-9
        closed_angles = closed_motion.values[is_same_input, follower]
        gap = np.exp(1j * (closed_angles - open_motion.values[row, follower])) - 1
        assert np.min(np.abs(gap)) < 1e-5


BEVEL = (ROOT / "mechanisms" / "bevel_pair.toml").read_text()
ECCENTRIC, ROUND = (
    Profile("circle", direction_at_colatitude(ECCENTRICITY), DISC),
    Profile("circle", direction_at_colatitude(ARM), ROLLER),
)


def geared(old, new):
    """Return the shipped bevel gears with a passage of their file replaced."""
    return loads(BEVEL.replace(old, new), "gears.toml")


def apart():
    """Return a mechanism whose profiles do not touch in the reference pose."""
    circle = Profile("circle", (0.0, 0.0, 1.0), 0.3)
    posed = PoseGeometry({"12": (1.0, 0.0, 0.0), "13": (0.0, 1.0, 0.0)})
    return replace(cam_with_follower(GROUND, circle, circle), geometry=posed)


def crossing():
    """Return a profile through points on a figure of eight."""
    t = np.arange(24) / 24 * 2 * np.pi
    points = np.stack([0.9 * np.sin(0.5 * np.cos(t)), 0.4 * np.sin(2 * t), 1.0 + 0 * t], 1)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    return Profile("points", points=tuple(map(tuple, points)))


@pytest.mark.parametrize("call", TABLES["contacts"])
def test_what_cannot_be_a_contact_is_refused(call):
    check_call(call, globals(), TABLES["contacts"][call])


def test_pole_of_two_sliding_contacts_is_where_their_planes_meet():
    """The pole of two links that touch at two sliding contacts is that of the null space.

    The pole is the axis of the relative rotation of both links. It lies in the plane of
    each contact, which contains the contact and the normal of the profiles there. So the
    pole is the line common to both planes, case (c) of Di Gregorio's lecture. The reference
    are the angular velocities of all links by `null_space`.
    """
    mechanism = sk.load("two_contacts")
    # The steps of the plan that use only the contacts of the two links (`via` would name a
    # third link).
    steps = [s for s in plan(mechanism).steps if getattr(s, "contacts", ()) and not s.via]
    assert [step.case for step in steps] == ["c"]
    # Only the assembly mode of the reference pose: no other modes are searched.
    motion, field = evaluate_poles_of_motion(mechanism, samples=41, search=False)
    assert np.all(motion.status == sk.Status.OK)
    types = [pair.type for pair in mechanism.pairs]
    for row in range(0, 41, 5):
        rates, _ = null_space(3, mechanism.ends, motion.axes[row], types)
        for i, j in all_poles(3):
            # `rates` are angular velocities of the three links.
            sine = sine_between_lines(field.direction[i, j][row], rates[j] - rates[i])
            assert sine < 1e-11
