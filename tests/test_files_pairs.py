"""Pairs as designers state them: cones by half angles, followers, arcs; their faults."""

import math

import numpy as np
import pytest
from helpers.refusals import mechanism_text, replace_passages

import spherekit as sk
from spherekit.errors import ModelError
from spherekit.files.mechanism_reader import loads
from spherekit.files.mechanism_writer import dumps
from spherekit.mechanism.elements import Profile

DEGREE = np.pi / 180.0

CONES = mechanism_text("cones")

CAM = mechanism_text("cam")

ROLLER_ON_A_PIN = mechanism_text("pinned_roller")

SLIDER = mechanism_text("slider")

POSED_SLIDER = mechanism_text("posed_slider")

HALF_ANGLES = "half_angles = [30.0, 45.0]"
FOLLOWER = 'follower = { link = "3", roller = 12.0, centre_lonlat = [90.0, 45.0] }'
THROUGH = "through_lonlat = [[10.0, 0.0], [80.0, 0.0]]"
PROFILE_OF_2 = """\
[pairs.touch.profiles.2]
kind = "circle"
centre_lonlat = [90.0, 80.0]
radius = 25.0
"""


def radii(text):
    """Return the angular radii (deg) of the two circles of a pair of cones."""
    return [profile.radius / DEGREE for profile in loads(text).pair("mesh").profiles]


def rolled(text):
    """Return the second gear's steps (rad, -pi to pi) for steps of 60 deg of the first."""
    motion = sk.trace(loads(text), samples=7)
    assert np.all(motion.status == sk.Status.OK)
    return np.angle(np.exp(1j * np.diff(motion.values[:, 1])))


@pytest.mark.parametrize(
    ("shaft", "contact", "given", "expected"),
    [
        (75, "external", "[30.0, 45.0]", (30, 45)),
        (75, "external", "[30.0]", (30, 45)),
        (120, "external", "[100.0]", (100, 20)),
        (120, "external", "[20.0, 100.0]", (20, 100)),
        (150, "external", "[90.0]", (90, 60)),
        (30, "internal", "[25.0, 55.0]", (25, 55)),
        (30, "internal", "[65.0]", (65, 95)),
    ],
)
def test_cones_roll_by_the_sines_of_their_half_angles(shaft, contact, given, expected):
    text = replace_passages(CONES, "75.0", f"{shaft}.0", "[30.0, 45.0]", given)
    text = text.replace('type = "Cr"', f'type = "Cr"\ncontact = "{contact}"')
    assert np.allclose(radii(text), expected, rtol=0, atol=1e-13)
    sign = -1.0 if contact == "external" else 1.0
    ratio = sign * math.sin(expected[0] * DEGREE) / math.sin(expected[1] * DEGREE)
    expected_step = np.angle(np.exp(1j * ratio * 60 * DEGREE))
    assert np.allclose(rolled(text), expected_step, rtol=0, atol=1e-12)


def test_half_angles_mean_the_same_in_both_forms_and_as_teeth():
    """sin 30 / sin 45 is not a ratio of teeth; 20 and 40 teeth are cones of any digits."""
    posed = replace_passages(CONES, 'axes = ["a", "b"]\narcs = [75.0]\n', "")
    posed = replace_passages(posed, '[links.1]\naxes = ["a"]', "[links.1]")
    posed = replace_passages(posed, '[links.2]\naxes = ["b"]', "[links.2]")
    posed = replace_passages(posed, '["0", "1"]', '["0", "1"]\nxyz = [0, 0, 1]')
    posed = replace_passages(posed, '["0", "2"]', '["0", "2"]\nlonlat = [90.0, 15.0]')
    assert np.allclose(radii(posed), [30, 45], rtol=0, atol=1e-13)
    assert np.allclose(rolled(posed), rolled(CONES), rtol=0, atol=1e-12)
    by_teeth = radii(replace_passages(CONES, HALF_ANGLES, "teeth = [20, 40]"))
    rounded = f"half_angles = [{by_teeth[0]:.6f}, {by_teeth[1]:.6f}]"
    made_to_fit = radii(replace_passages(CONES, HALF_ANGLES, rounded))
    assert np.allclose(made_to_fit, by_teeth, rtol=0, atol=1e-6)
    assert sum(made_to_fit) == pytest.approx(75.0, abs=1e-13)


def test_half_angles_that_touch_are_kept_to_the_last_bit():
    for first in np.arange(1, 75):
        given = f"half_angles = [{first}.3, {74.7 - first:.1f}]"
        made = loads(replace_passages(CONES, HALF_ANGLES, given)).pair("mesh").profiles
        assert made[0].radius == math.radians(float(f"{first}.3"))
        assert made[1].radius == math.radians(float(f"{74.7 - first:.1f}"))


def test_a_follower_is_the_profile_it_stands_for():
    circle = """\
[pairs.touch.profiles.3]
kind = "circle"
centre_lonlat = [90.0, 45.0]
radius = 12.0
"""
    assert loads(CAM) == loads(replace_passages(CAM, FOLLOWER + "\n", "") + circle)
    flat = 'follower = { link = "3", flat = true, pole_xyz = [0.0, 0.6, -0.8] }'
    made = loads(replace_passages(CAM, FOLLOWER, flat)).pair("touch").profiles
    assert made[0] == loads(CAM).pair("touch").profiles[0]
    assert made[1] == Profile("great_circle", (0.0, 0.6, -0.8))
    first = loads(replace_passages(CAM, '["2", "3"]', '["3", "2"]')).pair("touch").profiles
    assert first == loads(CAM).pair("touch").profiles[::-1]


def test_a_roller_that_turns_on_a_pin_moves_its_arm_like_one_welded_to_it():
    welded, pinned = (sk.trace(loads(text), samples=37) for text in (CAM, ROLLER_ON_A_PIN))
    assert np.all(welded.status == sk.Status.OK)
    assert np.all(pinned.status == sk.Status.OK)
    arm = [
        made.values[:, loads(text).variable_names.index("theta_b")]
        for made, text in ((welded, CAM), (pinned, ROLLER_ON_A_PIN))
    ]
    assert np.allclose(arm[0], arm[1], rtol=0, atol=1e-12)


def test_the_pin_of_a_slider_stays_on_its_arc():
    """The pin at 90 deg from the pole, and one rod length from the crank's tip."""
    assert loads(SLIDER).pair("guide").type == "R"
    motion = sk.trace(loads(SLIDER), samples=37)
    assert np.all(motion.status == sk.Status.OK)
    _, tip, pin, pole = np.moveaxis(motion.axes, 1, 0)
    assert np.max(np.abs(np.sum(pin * pole, axis=1))) < 1e-14
    assert np.allclose(np.sum(tip * pin, axis=1), 0.5, rtol=0, atol=1e-14)
    slid = motion.values[:, 3] - motion.values[0, 3]
    along = np.sum(np.cross(pin[0], pin) * pole, axis=1)
    assert np.allclose(np.sin(slid), along, rtol=0, atol=1e-13)


def test_the_axis_of_an_arc_is_its_pole():
    by_pole = replace_passages(POSED_SLIDER, THROUGH, "xyz = [0.0, 0.0, 1.0]")
    assert loads(POSED_SLIDER) == loads(by_pole)
    assert loads(by_pole) == loads(replace_passages(by_pole, 'type = "P"', 'type = "R"'))
    other_way = "through_xyz = [[0.0, 0.0, 1.0], [0.6, 0.8, 0.0]]"
    axes = loads(replace_passages(POSED_SLIDER, THROUGH, other_way)).geometry.axes
    assert axes["guide"] == pytest.approx((-0.8, 0.6, 0.0), abs=1e-15)
    random = np.random.default_rng(5)
    for ends in random.uniform((-180, -90), (180, 90), (50, 2, 2)):
        given = f"through_lonlat = {ends.tolist()}"
        made = loads(replace_passages(POSED_SLIDER, THROUGH, given))
        pole = np.array(made.geometry.axes["guide"])
        (east, west), (up, down) = ends.T * DEGREE
        first, second = (
            np.array([np.cos(b) * np.cos(a), np.cos(b) * np.sin(a), np.sin(b)])
            for a, b in ((east, up), (west, down))
        )
        sine = np.linalg.norm(np.cross(first, second))
        assert abs(pole @ first) < 1e-15 / sine and abs(pole @ second) < 1e-15 / sine
        assert np.linalg.det([first, second, pole]) > 0


FLAT = 'follower = { link = "3", flat = true, pole_lonlat = [9, 7] }'
STATED = (
    *(
        CONES,
        replace_passages(CONES, "[30.0, 45.0]", "[23.7]"),
        CAM,
        replace_passages(CAM, FOLLOWER, FLAT),
    ),
    *(ROLLER_ON_A_PIN, SLIDER, POSED_SLIDER),
    replace_passages(POSED_SLIDER, "[80.0, 0.0]", "[81.3, 17.9]"),
)


@pytest.mark.parametrize("text", STATED, ids=range(len(STATED)))
@pytest.mark.parametrize("unit", ["deg", "rad"])
def test_every_key_is_written_as_what_it_stands_for(text, unit):
    made = loads(text)
    written = dumps(made, unit)
    assert loads(written) == made
    for key in ("half_angles", "follower =", 'type = "P"', "through"):
        assert key not in written


def with_cam(profile):
    """Return the cam file with another profile of the cam."""
    return replace_passages(CAM, PROFILE_OF_2, f"[pairs.touch.profiles.2]\n{profile}")


TURN = np.arange(16) * (2 * np.pi / 16) + 0.1
EIGHT = np.stack([40 * np.sin(TURN), 20 * np.sin(2 * TURN)], axis=1).tolist()
RING = [[40 * k, 65] for k in range(10)]


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (EIGHT, "the closed curve meets itself: between points 8 and 9 and"),
        (RING, "the last point, 10, repeats the first; leave it out"),
    ],
)
def test_profiles_that_are_no_curves_are_named(points, words):
    made = loads(with_cam(f'kind = "points"\npoints = {points}\n'))
    with pytest.raises(ModelError, match=rf"cam: pairs\.touch\.profiles\.2: {words}"):
        sk.trace(made)


@pytest.mark.slow
def test_a_run_names_the_roller_that_is_too_large_for_a_concave_cam():
    """A cam with a waist: the concave radius there is below that of a 30 deg roller."""
    waist = 'kind = "fourier"\ncentre_xyz = [0.0, 0.0, 1.0]\ncosines = [25.0, 0.0, 9.0]\n'
    small, large = (
        loads(replace_passages(with_cam(waist), "roller = 12.0", f"roller = {radius}"))
        for radius in (2.0, 30.0)
    )
    run = sk.run(large, "poles", samples=31)
    rows = run.frame("motion").query("status == 'CURVATURE'")
    assert len(rows) > np.sum(sk.trace(small, samples=31).status == sk.Status.CURVATURE)
    assert rows["theta_b"].isna().all() and "CURVATURE" in run.summary["status_meaning"]
