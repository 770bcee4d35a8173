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


def cone_half_angles(text):
    """Return the half angles (deg) of the two cones of a pair of bevel gears."""
    return [profile.radius / DEGREE for profile in loads(text).pair("mesh").profiles]


def steps_of_second_gear(text):
    """Return the steps (rad, -pi to pi) of the second gear for 60 deg of the first."""
    # One revolution of the first gear in six steps.
    motion = sk.trace(loads(text), samples=7)
    assert np.all(motion.status == sk.Status.OK)
    return np.angle(np.exp(1j * np.diff(motion.values[:, 1])))


@pytest.mark.parametrize(
    ("shaft_angle", "contact", "stated", "expected"),
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
def test_cones_roll_by_the_ratio_of_the_sines_of_their_half_angles(
    shaft_angle, contact, stated, expected
):
    """Bevel gears that are stated by half angles of their pitch cones roll without slip.

    The file states one or both half angles (deg). The second one follows from the shaft
    angle. The reference ratio of the speeds is the ratio of the sines. It is negative for
    external contact. The first gear turns by 60 deg in each step.
    """
    # The file has a shaft angle of 75 deg and the half angles 30 and 45 deg.
    text = replace_passages(CONES, "75.0", f"{shaft_angle}.0", "[30.0, 45.0]", stated)
    text = text.replace('type = "Cr"', f'type = "Cr"\ncontact = "{contact}"')
    assert np.allclose(cone_half_angles(text), expected, rtol=0, atol=1e-13)
    sign = -1.0 if contact == "external" else 1.0
    first_half_angle, second_half_angle = np.radians(expected)
    ratio = sign * math.sin(first_half_angle) / math.sin(second_half_angle)
    expected_step = np.angle(np.exp(1j * ratio * 60 * DEGREE))
    assert np.allclose(steps_of_second_gear(text), expected_step, rtol=0, atol=1e-12)


def test_half_angles_mean_the_same_with_axes_in_a_pose_as_with_arcs():
    """In the pose form, axes are stated as directions: 75 deg apart, as by the arc."""
    posed = replace_passages(CONES, 'axes = ["a", "b"]\narcs = [75.0]\n', "")
    posed = replace_passages(posed, '[links.1]\naxes = ["a"]', "[links.1]")
    posed = replace_passages(posed, '[links.2]\naxes = ["b"]', "[links.2]")
    posed = replace_passages(posed, '["0", "1"]', '["0", "1"]\nxyz = [0, 0, 1]')
    posed = replace_passages(posed, '["0", "2"]', '["0", "2"]\nlonlat = [90.0, 15.0]')
    assert np.allclose(cone_half_angles(posed), [30, 45], rtol=0, atol=1e-13)
    assert np.allclose(
        steps_of_second_gear(posed), steps_of_second_gear(CONES), rtol=0, atol=1e-12
    )


def test_half_angles_with_six_decimals_are_those_of_teeth():
    """Rounded half angles of 20 and 40 teeth are adjusted so that the cones touch."""
    by_teeth = cone_half_angles(replace_passages(CONES, HALF_ANGLES, "teeth = [20, 40]"))
    rounded = f"half_angles = [{by_teeth[0]:.6f}, {by_teeth[1]:.6f}]"
    adjusted = cone_half_angles(replace_passages(CONES, HALF_ANGLES, rounded))
    assert np.allclose(adjusted, by_teeth, rtol=0, atol=1e-6)
    assert sum(adjusted) == pytest.approx(75.0, abs=1e-13)


def test_half_angles_whose_cones_touch_are_not_adjusted():
    """Half angles with one decimal add up to the shaft angle of 75 deg exactly."""
    for whole_degrees in np.arange(1, 75):
        first = f"{whole_degrees}.3"
        second = f"{74.7 - whole_degrees:.1f}"
        stated = f"half_angles = [{first}, {second}]"
        mechanism = loads(replace_passages(CONES, HALF_ANGLES, stated))
        first_profile, second_profile = mechanism.pair("mesh").profiles
        assert first_profile.radius == math.radians(float(first))
        assert second_profile.radius == math.radians(float(second))


def test_a_roller_follower_is_a_circle_about_its_centre():
    circle = """\
[pairs.touch.profiles.3]
kind = "circle"
centre_lonlat = [90.0, 45.0]
radius = 12.0
"""
    assert loads(CAM) == loads(replace_passages(CAM, FOLLOWER + "\n", "") + circle)


def test_a_flat_follower_is_a_great_circle_about_its_pole():
    flat = 'follower = { link = "3", flat = true, pole_xyz = [0.0, 0.6, -0.8] }'
    profiles = loads(replace_passages(CAM, FOLLOWER, flat)).pair("touch").profiles
    assert profiles[0] == loads(CAM).pair("touch").profiles[0]
    assert profiles[1] == Profile("great_circle", (0.0, 0.6, -0.8))


def test_profiles_have_the_order_of_the_links_of_the_pair():
    exchanged = loads(replace_passages(CAM, '["2", "3"]', '["3", "2"]'))
    assert exchanged.pair("touch").profiles == loads(CAM).pair("touch").profiles[::-1]


def test_a_roller_that_turns_on_a_pin_moves_its_arm_like_a_welded_roller():
    """The rotation of a round roller about its own centre does not move the arm."""
    arm_angles = []
    for text in (CAM, ROLLER_ON_A_PIN):
        mechanism = loads(text)
        motion = sk.trace(mechanism, samples=37)
        assert np.all(motion.status == sk.Status.OK)
        arm_angles.append(motion.values[:, mechanism.variable_names.index("theta_b")])
    assert np.allclose(arm_angles[0], arm_angles[1], rtol=0, atol=1e-12)


def test_the_pin_of_a_slider_stays_on_its_arc():
    """A slider on an arc of a great circle is a revolute pair about the pole of the circle.

    The pin of the slider must stay 90 deg from this pole, and 60 deg (the length of the
    rod) from the tip of the crank. The fourth pair variable is the angle of the slider
    along its arc.
    """
    mechanism = loads(SLIDER)
    assert mechanism.pair("guide").type == "R"
    motion = sk.trace(mechanism, samples=37)
    assert np.all(motion.status == sk.Status.OK)
    # Pair axes of the four pairs; the first is the axis of the crank.
    _, tip, pin, pole = np.moveaxis(motion.axes, 1, 0)  # each (samples, 3)
    assert np.max(np.abs(np.sum(pin * pole, axis=1))) < 1e-14
    cosine_of_rod = np.sum(tip * pin, axis=1)
    assert np.allclose(cosine_of_rod, 0.5, rtol=0, atol=1e-14)
    # The slider angle counts from the first sample. The sine of the angle between the first
    # pin and each pin, about the pole, must agree with it in size and sign.
    slider_angle = motion.values[:, 3] - motion.values[0, 3]
    sine_along_arc = np.sum(np.cross(pin[0], pin) * pole, axis=1)
    assert np.allclose(np.sin(slider_angle), sine_along_arc, rtol=0, atol=1e-13)


def test_the_axis_of_an_arc_is_its_pole():
    """An arc in the plane of x and y is a revolute pair about z."""
    by_pole = replace_passages(POSED_SLIDER, THROUGH, "xyz = [0.0, 0.0, 1.0]")
    assert loads(POSED_SLIDER) == loads(by_pole)
    assert loads(by_pole) == loads(replace_passages(by_pole, 'type = "P"', 'type = "R"'))


def test_the_pole_of_an_arc_through_two_directions_is_their_cross_product():
    """z cross (0.6, 0.8, 0) is (-0.8, 0.6, 0)."""
    through = "through_xyz = [[0.0, 0.0, 1.0], [0.6, 0.8, 0.0]]"
    axes = loads(replace_passages(POSED_SLIDER, THROUGH, through)).geometry.axes
    assert axes["guide"] == pytest.approx((-0.8, 0.6, 0.0), abs=1e-15)


def test_the_pole_of_an_arc_is_perpendicular_to_both_of_its_directions():
    """The pole of an arc through two directions is perpendicular to both, right-handed.

    The 50 random pairs of directions are stated by longitude and latitude (deg). For short
    arcs, rounding has a greater effect on the pole: the tolerance is divided by the sine.
    """
    random = np.random.default_rng(5)
    arcs = random.uniform((-180, -90), (180, 90), (50, 2, 2))
    for lonlat in arcs:
        through = f"through_lonlat = {lonlat.tolist()}"
        mechanism = loads(replace_passages(POSED_SLIDER, THROUGH, through))
        pole = np.array(mechanism.geometry.axes["guide"])
        longitude, latitude = lonlat.T * DEGREE
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


FLAT_FOLLOWER = 'follower = { link = "3", flat = true, pole_lonlat = [9, 7] }'
FILES_WITH_SHORT_FORMS = (
    CONES,
    replace_passages(CONES, "[30.0, 45.0]", "[23.7]"),
    CAM,
    replace_passages(CAM, FOLLOWER, FLAT_FOLLOWER),
    ROLLER_ON_A_PIN,
    SLIDER,
    POSED_SLIDER,
    replace_passages(POSED_SLIDER, "[80.0, 0.0]", "[81.3, 17.9]"),
)


@pytest.mark.parametrize(
    "text", FILES_WITH_SHORT_FORMS, ids=range(len(FILES_WITH_SHORT_FORMS))
)
@pytest.mark.parametrize("unit", ["deg", "rad"])
def test_short_forms_are_written_as_circles_and_revolute_pairs(text, unit):
    """The written file means the same mechanism exactly, without the short forms."""
    mechanism = loads(text)
    written = dumps(mechanism, unit)
    assert loads(written) == mechanism
    for key in ("half_angles", "follower =", 'type = "P"', "through"):
        assert key not in written


def cam_with_profile(profile):
    """Return the text of the cam file with another profile of the cam."""
    return replace_passages(CAM, PROFILE_OF_2, f"[pairs.touch.profiles.2]\n{profile}")


PARAMETER = np.arange(16) * (2 * np.pi / 16) + 0.1
FIGURE_EIGHT = np.stack(
    [40 * np.sin(PARAMETER), 20 * np.sin(2 * PARAMETER)], axis=1
).tolist()
"""Longitudes and latitudes (deg) of points on a curve that crosses itself."""
REPEATED_RING = [[40 * k, 65] for k in range(10)]
"""Points (deg) on a circle of latitude, of which the last, at 360 deg, is the first."""


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (
            FIGURE_EIGHT,
            "the closed curve meets itself: the part between points 8 and 9 meets",
        ),
        (REPEATED_RING, "the last point, 10, repeats the first; leave it out"),
    ],
)
def test_a_profile_that_is_no_simple_curve_is_refused_by_its_name(points, words):
    mechanism = loads(cam_with_profile(f'kind = "points"\npoints = {points}\n'))
    with pytest.raises(ModelError, match=rf"cam: pairs\.touch\.profiles\.2: {words}"):
        sk.trace(mechanism)


@pytest.mark.slow
def test_a_run_has_the_status_curvature_where_a_roller_is_too_large_for_its_cam():
    """A roller that does not fit into the concave waist of its cam gives a status.

    The waist has a smaller radius than the roller of 30 deg. A roller of 2 deg must have
    fewer rows with the status CURVATURE. Rows with this status have no angles.
    """
    waist = 'kind = "fourier"\ncentre_xyz = [0.0, 0.0, 1.0]\ncosines = [25.0, 0.0, 9.0]\n'
    text = cam_with_profile(waist)
    small_roller = loads(replace_passages(text, "roller = 12.0", "roller = 2.0"))
    large_roller = loads(replace_passages(text, "roller = 12.0", "roller = 30.0"))
    run = sk.run(large_roller, "poles", samples=31)
    rows = run.frame("motion").query("status == 'CURVATURE'")
    small_status = sk.trace(small_roller, samples=31).status
    assert len(rows) > np.sum(small_status == sk.Status.CURVATURE)
    assert rows["theta_b"].isna().all()
    assert "CURVATURE" in run.summary["status_meaning"]
