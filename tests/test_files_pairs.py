"""Pairs as designers state them: cones by half angles, followers, arcs; their faults."""

import math

import numpy as np
import pytest

import spherekit as sk
from spherekit.conventions import Status
from spherekit.errors import FileError, ModelError
from spherekit.files.read import loads
from spherekit.files.write import dumps
from spherekit.model.parts import Profile

DEGREE = np.pi / 180.0

CONES = """\
format = 1
name = "cones"
angle_unit = "deg"
ground = "0"
[links.0]
axes = ["a", "b"]
arcs = [75.0]
[links.1]
axes = ["a"]
[links.2]
axes = ["b"]
[pairs.a]
type = "R"
links = ["0", "1"]
[pairs.b]
type = "R"
links = ["0", "2"]
[pairs.mesh]
type = "Cr"
links = ["1", "2"]
half_angles = [30.0, 45.0]
axes = ["a", "b"]
"""

CAM = """\
format = 1
name = "cam"
angle_unit = "deg"
ground = "1"
[links.1]
axes = ["a", "b"]
arcs = [60.0]
[links.2]
axes = ["a"]
[links.3]
axes = ["b"]
[pairs.a]
type = "R"
links = ["1", "2"]
[pairs.b]
type = "R"
links = ["1", "3"]
[pairs.touch]
type = "Cs"
links = ["2", "3"]
follower = { link = "3", roller = 12.0, centre_lonlat = [90.0, 45.0] }
[pairs.touch.profiles.2]
kind = "circle"
centre_lonlat = [90.0, 80.0]
radius = 25.0
"""

ROLLER_ON_A_PIN = """\
format = 1
name = "pinned"
angle_unit = "deg"
ground = "1"
[links.1]
axes = ["a", "b"]
arcs = [60.0]
[links.2]
axes = ["a"]
[links.3]
axes = ["b", "pin"]
arcs = [45.0]
[links.4]
axes = ["pin"]
[pairs.a]
type = "R"
links = ["1", "2"]
[pairs.b]
type = "R"
links = ["1", "3"]
[pairs.pin]
type = "R"
links = ["3", "4"]
[pairs.touch]
type = "Cr"
links = ["2", "4"]
follower = { link = "4", roller = 12.0, axis = "pin" }
[pairs.touch.profiles.2]
kind = "circle"
centre_lonlat = [90.0, 80.0]
radius = 25.0
"""

SLIDER = """\
format = 1
name = "slider"
angle_unit = "deg"
ground = "1"
[links.1]
axes = ["a", "guide"]
arcs = [70.0]
[links.2]
axes = ["a", "b"]
arcs = [25.0]
[links.3]
axes = ["b", "c"]
arcs = [60.0]
[links.4]
axes = ["guide", "c"]
arcs = [90.0]
[pairs.a]
type = "R"
links = ["1", "2"]
[pairs.b]
type = "R"
links = ["2", "3"]
[pairs.c]
type = "R"
links = ["3", "4"]
[pairs.guide]
type = "P"
links = ["1", "4"]
"""

POSED_SLIDER = """\
format = 1
name = "posed_slider"
angle_unit = "deg"
ground = "1"
[links.1]
[links.2]
[links.3]
[links.4]
[pairs.a]
type = "R"
links = ["1", "2"]
xyz = [0.0, 0.0, 1.0]
[pairs.b]
type = "R"
links = ["2", "3"]
lonlat = [20.0, 65.0]
[pairs.c]
type = "R"
links = ["3", "4"]
lonlat = [50.0, 0.0]
[pairs.guide]
type = "P"
links = ["1", "4"]
through_lonlat = [[10.0, 0.0], [80.0, 0.0]]
"""

HALF_ANGLES = "half_angles = [30.0, 45.0]"
FOLLOWER = 'follower = { link = "3", roller = 12.0, centre_lonlat = [90.0, 45.0] }'
THROUGH = "through_lonlat = [[10.0, 0.0], [80.0, 0.0]]"
PROFILE_OF_2 = """\
[pairs.touch.profiles.2]
kind = "circle"
centre_lonlat = [90.0, 80.0]
radius = 25.0
"""


def changed(text, *replacements):
    """Return the text with passages replaced, given in turn as old, new."""
    for old, new in zip(replacements[::2], replacements[1::2], strict=True):
        assert text.count(old) >= 1, old
        text = text.replace(old, new, 1)
    return text


def radii(text):
    """Return the angular radii (deg) of the two circles of a pair of cones."""
    return [profile.radius / DEGREE for profile in loads(text).pair("mesh").profiles]


def rolled(text):
    """Return the second gear's steps (rad, -pi to pi) for steps of 60 deg of the first."""
    motion = sk.trace(loads(text), samples=7)
    assert np.all(motion.status == Status.OK)
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
    text = changed(CONES, "75.0", f"{shaft}.0", "[30.0, 45.0]", given)
    text = text.replace('type = "Cr"', f'type = "Cr"\ncontact = "{contact}"')
    assert np.allclose(radii(text), expected, rtol=0, atol=1e-13)
    sign = -1.0 if contact == "external" else 1.0
    ratio = sign * math.sin(expected[0] * DEGREE) / math.sin(expected[1] * DEGREE)
    expected_step = np.angle(np.exp(1j * ratio * 60 * DEGREE))
    assert np.allclose(rolled(text), expected_step, rtol=0, atol=1e-12)


def test_half_angles_mean_the_same_in_both_forms_and_as_teeth():
    """sin 30 / sin 45 is not a ratio of teeth; 20 and 40 teeth are cones of any digits."""
    posed = changed(CONES, 'axes = ["a", "b"]\narcs = [75.0]\n', "")
    posed = changed(posed, '[links.1]\naxes = ["a"]', "[links.1]")
    posed = changed(posed, '[links.2]\naxes = ["b"]', "[links.2]")
    posed = changed(posed, '["0", "1"]', '["0", "1"]\nxyz = [0, 0, 1]')
    posed = changed(posed, '["0", "2"]', '["0", "2"]\nlonlat = [90.0, 15.0]')
    assert np.allclose(radii(posed), [30, 45], rtol=0, atol=1e-13)
    assert np.allclose(rolled(posed), rolled(CONES), rtol=0, atol=1e-12)
    by_teeth = radii(changed(CONES, HALF_ANGLES, "teeth = [20, 40]"))
    rounded = f"half_angles = [{by_teeth[0]:.6f}, {by_teeth[1]:.6f}]"
    made_to_fit = radii(changed(CONES, HALF_ANGLES, rounded))
    assert np.allclose(made_to_fit, by_teeth, rtol=0, atol=1e-6)
    assert sum(made_to_fit) == pytest.approx(75.0, abs=1e-13)


def test_half_angles_that_touch_are_kept_to_the_last_bit():
    for first in np.arange(1, 75):
        given = f"half_angles = [{first}.3, {74.7 - first:.1f}]"
        made = loads(changed(CONES, HALF_ANGLES, given)).pair("mesh").profiles
        assert made[0].radius == math.radians(float(f"{first}.3"))
        assert made[1].radius == math.radians(float(f"{74.7 - first:.1f}"))


def test_a_follower_is_the_profile_it_stands_for():
    circle = """\
[pairs.touch.profiles.3]
kind = "circle"
centre_lonlat = [90.0, 45.0]
radius = 12.0
"""
    assert loads(CAM) == loads(changed(CAM, FOLLOWER + "\n", "") + circle)
    flat = 'follower = { link = "3", flat = true, pole_xyz = [0.0, 0.6, -0.8] }'
    made = loads(changed(CAM, FOLLOWER, flat)).pair("touch").profiles
    assert made[0] == loads(CAM).pair("touch").profiles[0]
    assert made[1] == Profile("great_circle", (0.0, 0.6, -0.8))
    first = loads(changed(CAM, '["2", "3"]', '["3", "2"]')).pair("touch").profiles
    assert first == loads(CAM).pair("touch").profiles[::-1]


def test_a_roller_that_turns_on_a_pin_moves_its_arm_like_one_welded_to_it():
    welded, pinned = (sk.trace(loads(text), samples=37) for text in (CAM, ROLLER_ON_A_PIN))
    assert np.all(welded.status == Status.OK)
    assert np.all(pinned.status == Status.OK)
    arm = [
        made.values[:, loads(text).variable_names.index("theta_b")]
        for made, text in ((welded, CAM), (pinned, ROLLER_ON_A_PIN))
    ]
    assert np.allclose(arm[0], arm[1], rtol=0, atol=1e-12)


def test_the_pin_of_a_slider_stays_on_its_arc():
    """The pin at 90 deg from the pole, and one rod length from the crank's tip."""
    assert loads(SLIDER).pair("guide").type == "R"
    motion = sk.trace(loads(SLIDER), samples=37)
    assert np.all(motion.status == Status.OK)
    _, tip, pin, pole = np.moveaxis(motion.axes, 1, 0)
    assert np.max(np.abs(np.sum(pin * pole, axis=1))) < 1e-14
    assert np.allclose(np.sum(tip * pin, axis=1), 0.5, rtol=0, atol=1e-14)
    slid = motion.values[:, 3] - motion.values[0, 3]
    along = np.sum(np.cross(pin[0], pin) * pole, axis=1)
    assert np.allclose(np.sin(slid), along, rtol=0, atol=1e-13)


def test_the_axis_of_an_arc_is_its_pole():
    by_pole = changed(POSED_SLIDER, THROUGH, "xyz = [0.0, 0.0, 1.0]")
    assert loads(POSED_SLIDER) == loads(by_pole)
    assert loads(by_pole) == loads(changed(by_pole, 'type = "P"', 'type = "R"'))
    other_way = "through_xyz = [[0.0, 0.0, 1.0], [0.6, 0.8, 0.0]]"
    axes = loads(changed(POSED_SLIDER, THROUGH, other_way)).geometry.axes
    assert axes["guide"] == pytest.approx((-0.8, 0.6, 0.0), abs=1e-15)
    random = np.random.default_rng(5)
    for ends in random.uniform((-180, -90), (180, 90), (50, 2, 2)):
        given = f"through_lonlat = {ends.tolist()}"
        made = loads(changed(POSED_SLIDER, THROUGH, given))
        pole = np.array(made.geometry.axes["guide"])
        longitude, latitude = ends.T * DEGREE
        first, second = np.stack(
            [
                np.cos(latitude) * np.cos(longitude),
                np.cos(latitude) * np.sin(longitude),
                np.sin(latitude),
            ],
            axis=1,
        )
        sine = np.linalg.norm(np.cross(first, second))
        assert abs(pole @ first) < 1e-15 / sine
        assert abs(pole @ second) < 1e-15 / sine
        assert np.linalg.det([first, second, pole]) > 0


@pytest.mark.parametrize(
    "text",
    [
        CONES,
        changed(CONES, "[30.0, 45.0]", "[23.7]"),
        CAM,
        ROLLER_ON_A_PIN,
        changed(
            CAM, FOLLOWER, 'follower = { link = "3", flat = true, pole_lonlat = [9, 7] }'
        ),
        SLIDER,
        POSED_SLIDER,
        changed(POSED_SLIDER, "[80.0, 0.0]", "[81.3, 17.9]"),
    ],
)
@pytest.mark.parametrize("unit", ["deg", "rad"])
def test_every_key_is_written_as_what_it_stands_for(text, unit):
    made = loads(text)
    written = dumps(made, unit)
    assert loads(written) == made
    for key in ("half_angles", "follower =", 'type = "P"', "through"):
        assert key not in written


def follower(keys):
    """Return the follower of link 3 with these keys."""
    return f'follower = {{ link = "3", {keys} }}'


FAULTS = {
    # case: (base, old, new, line and key, words that must occur)
    "cones apart": (
        CONES,
        "45.0]",
        "43.0]",
        "21: pairs.mesh.half_angles: the cones do not touch",
        ["shaft angle is 75 deg", "30 + 43 = 73 deg", "miss by 2 deg", "second out"],
    ),
    "internal cones apart": (
        CONES,
        HALF_ANGLES,
        HALF_ANGLES + '\ncontact = "internal"',
        "21: pairs.mesh.half_angles: the cones do not touch",
        ["shaft angle is 75 deg", "45 - 30 = 15 deg", "miss by 60 deg"],
    ),
    "no second cone": (
        CONES,
        "[30.0, 45.0]",
        "[80.0]",
        "21: pairs.mesh.half_angles: at a shaft angle of 75 deg no second cone",
        ["would be -5 deg"],
    ),
    "cones about one line": (
        CONES,
        "arcs = [75.0]",
        "arcs = [180.0]",
        "21: pairs.mesh.half_angles: the shaft angle is 180 deg",
        ["about one line"],
    ),
    "three half angles": (
        CONES,
        "[30.0, 45.0]",
        "[30.0, 45.0, 1.0]",
        "21: pairs.mesh.half_angles: has 3 values, needs at most 2",
        [],
    ),
    "no half angles": (
        CONES,
        "[30.0, 45.0]",
        "[]",
        "21: pairs.mesh.half_angles: has 0 values, needs at least 1",
        [],
    ),
    "negative half angle": (
        CONES,
        "[30.0, 45.0]",
        "[-30.0, 105.0]",
        "21: pairs.mesh.half_angles: found a half angle of -30 deg",
        ["between 0 and 180 deg"],
    ),
    "half angle of 180": (
        CONES,
        "[30.0, 45.0]",
        "[180.0]",
        "21: pairs.mesh.half_angles: found a half angle of 180 deg",
        [],
    ),
    "teeth and half angles": (
        CONES,
        HALF_ANGLES,
        HALF_ANGLES + "\nteeth = [20, 40]",
        "21: pairs.mesh.half_angles: teeth are given already",
        ["one of teeth and half_angles is enough"],
    ),
    "half angles without axes": (
        CONES,
        HALF_ANGLES + '\naxes = ["a", "b"]\n',
        HALF_ANGLES + "\n",
        "18: pairs.mesh: a contact pair needs the curve of each link",
        ["axes and either teeth or half_angles"],
    ),
    "half angles that slide": (
        CONES,
        '"Cr"',
        '"Cs"',
        '19: pairs.mesh.type: found "Cs", allowed: Cr',
        [],
    ),
    "half angles on R": (
        CONES,
        '"R"',
        '"R"\nhalf_angles = [1.0]',
        "14: pairs.a.half_angles: only rolling contact pairs (Cr)",
        [],
    ),
    "half angles and profiles": (
        CAM,
        FOLLOWER,
        'half_angles = [1.0]\naxes = ["a", "b"]',
        "19: pairs.touch.type",
        ["23: pairs.touch.profiles: half_angles are given already"],
    ),
    "axis of another gear": (
        CONES,
        HALF_ANGLES + '\naxes = ["a", "b"]',
        HALF_ANGLES + '\naxes = ["b", "a"]',
        '22: pairs.mesh.axes: R pair "b" is not on link "1"',
        [],
    ),
    "cones on incomplete links": (
        CONES,
        "arcs = [75.0]\n",
        "",
        '21: pairs.mesh.axes: arcs or angles of link "0" are missing',
        [],
    ),
    "follower on R": (
        CAM,
        '"R"',
        '"R"\n' + FOLLOWER,
        "14: pairs.a.follower: only contact pairs (Cr, Cs) have a follower",
        [],
    ),
    "unknown link of a follower": (
        CAM,
        'link = "3"',
        'link = "33"',
        '21: pairs.touch.follower.link: the pair joins "2" and "3", not "33"',
        ['did you mean "3"?'],
    ),
    "follower with a profile": (
        CAM,
        'link = "3"',
        'link = "2"',
        '21: pairs.touch.follower.link: the profile of "2" is given already (line 22)',
        [],
    ),
    "follower without a mate": (
        CAM,
        PROFILE_OF_2,
        "",
        "18: pairs.touch: a contact pair needs the curve of each link",
        [],
    ),
    "one profile": (
        CAM,
        FOLLOWER + "\n",
        "",
        '21: pairs.touch.profiles: the curve of link "3" is missing',
        ["follower for a roller or a flat face"],
    ),
    "no roller": (
        CAM,
        "roller = 12.0",
        "roller = 0",
        "21: pairs.touch.follower.roller: the angular radius is 0 deg",
        ["between 0 and 180 deg"],
    ),
    "large roller": (
        CAM,
        "roller = 12.0",
        "roller = 180.5",
        "21: pairs.touch.follower.roller: the angular radius is 180.5 deg",
        [],
    ),
    "roller without a centre": (
        CAM,
        FOLLOWER,
        follower("roller = 12.0"),
        "21: pairs.touch.follower: a roller needs its centre",
        ["centre_xyz = [x, y, z]", "axis ="],
    ),
    "neither roller nor flat": (
        CAM,
        FOLLOWER,
        follower("pole_lonlat = [0.0, 0.0]"),
        "21: pairs.touch.follower: a follower is a roller or a flat face",
        ["flat = true"],
    ),
    "roller and flat": (
        CAM,
        "roller = 12.0",
        "roller = 12.0, flat = true",
        "21: pairs.touch.follower",
        ["flat: roller is given already"],
    ),
    "flat face without a pole": (
        CAM,
        FOLLOWER,
        follower("flat = true"),
        "21: pairs.touch.follower: a flat face needs its pole",
        [],
    ),
    "flat face with a centre": (
        CAM,
        FOLLOWER,
        follower("flat = true, centre_xyz = [1, 0, 0], pole_xyz = [1, 0, 0]"),
        "21: pairs.touch.follower.centre_xyz: a flat face has a pole",
        [],
    ),
    "not flat": (
        CAM,
        FOLLOWER,
        follower("flat = false, pole_xyz = [1, 0, 0]"),
        "21: pairs.touch.follower.flat: found false, allowed: true",
        [],
    ),
    "two centres": (
        CAM,
        "roller = 12.0",
        "roller = 12.0, centre_xyz = [1, 0, 0]",
        "21: pairs.touch.follower.centre_lonlat: centre_xyz is given already",
        [],
    ),
    "unknown axis of a roller": (
        ROLLER_ON_A_PIN,
        'axis = "pin"',
        'axis = "pim"',
        '27: pairs.touch.follower.axis: no R pair is named "pim"',
        ['did you mean "pin"?'],
    ),
    "axis of another link": (
        ROLLER_ON_A_PIN,
        'axis = "pin"',
        'axis = "b"',
        '27: pairs.touch.follower.axis: R pair "b" is not on link "4"',
        [],
    ),
    "unknown key of a follower": (
        CAM,
        "roller =",
        "roler =",
        "21: pairs.touch.follower",
        ['roler: unknown key; did you mean "roller"?'],
    ),
    "equal ends": (
        POSED_SLIDER,
        "[80.0, 0.0]",
        "[10.0, 0.0]",
        "24: pairs.guide.through_lonlat: the two directions are equal",
        ["define no arc"],
    ),
    "opposite ends": (
        POSED_SLIDER,
        THROUGH,
        "through_xyz = [[0, 0.6, 0.8], [0, -0.6, -0.8]]",
        "24: pairs.guide.through_xyz: the two directions are opposite",
        ["define no arc"],
    ),
    "one end": (
        POSED_SLIDER,
        ", [80.0, 0.0]]",
        "]",
        "24: pairs.guide.through_lonlat: has 1 value, needs 2",
        [],
    ),
    "an end that is not a unit vector": (
        POSED_SLIDER,
        THROUGH,
        "through_xyz = [[0, 0.6, 0.8], [0, 3, 4]]",
        "24: pairs.guide.through_xyz[1]: found length 5, needs a unit vector",
        [],
    ),
    "arc of an R pair": (
        POSED_SLIDER,
        '"P"',
        '"R"',
        "24: pairs.guide.through_lonlat: only arc-prismatic pairs (P)",
        [],
    ),
    "arc and axis": (
        POSED_SLIDER,
        THROUGH,
        THROUGH + "\nxyz = [0, 0, 1]",
        "24: pairs.guide.through_lonlat: xyz is given already",
        [],
    ),
    "arc among sizes": (
        SLIDER,
        '"P"',
        '"P"\n' + THROUGH,
        "28: pairs.guide.through_lonlat: two geometries",
        ["links.1.axes (line 6)"],
    ),
    "a slider without an axis": (
        POSED_SLIDER,
        THROUGH + "\n",
        "",
        "21: pairs.guide: its axis in the reference pose is missing",
        [],
    ),
    "profiles on P": (
        CAM,
        '"Cs"',
        '"P"',
        "21: pairs.touch.follower: only contact pairs",
        ["22: pairs.touch.profiles: only contact pairs"],
    ),
}


@pytest.mark.parametrize("case", FAULTS)
def test_faults_name_line_key_and_remedy(case):
    base, old, new, start, words = FAULTS[case]
    with pytest.raises(FileError) as caught:
        loads(changed(base, old, new), "x.toml")
    message = str(caught.value)
    assert f"x.toml:{start}" in message, message
    for word in words:
        assert word in message, message


def with_cam(profile):
    """Return the cam file with another profile of the cam."""
    return changed(CAM, PROFILE_OF_2, f"[pairs.touch.profiles.2]\n{profile}")


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


def test_a_follower_that_runs_off_an_open_profile_has_a_status():
    half = [[18 * k - 90, 65] for k in range(11)]
    text = with_cam(f'kind = "points"\npoints = {half}\nclosed = false\n')
    summary = sk.run(loads(text), "poles", samples=31).summary
    assert summary["status"]["OFF_PROFILE"] > 0
    assert summary["status"]["OK"] > 0


def test_a_run_names_the_roller_that_is_too_large_for_a_concave_cam():
    """A cam with a waist: the concave radius there is below that of a 30 deg roller."""
    waist = 'kind = "fourier"\ncentre_xyz = [0.0, 0.0, 1.0]\ncosines = [25.0, 0.0, 9.0]\n'
    made = loads(changed(with_cam(waist), "roller = 12.0", "roller = 30.0"))
    summary = sk.run(made, "poles", samples=31).summary
    assert summary["status"]["CURVATURE"] > 0
    assert "CURVATURE" in summary["status_meaning"]
