"""What a run says of singularities in a few lines, by hand formulas."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import spherekit as sk
from analyses.singularities.findings import describe_inputs_of_kinds
from spherekit.errors import PlanError
from spherekit.plugin.checks.variants import rename_links
from spherekit.plugin.singularities import ordered_pole

NAME = "singularities"


def read_remarks(mechanism, samples=73):
    """Run the singularities analysis; return the remarks of its summary as one text."""
    result = sk.run(mechanism, NAME, samples=samples)
    assert not result.failures
    return "\n".join(result.summary["remarks"])


def flapper():
    """Return a crank-rocker (wing) whose coupler drives a second rocker (vane) by a tie.

    It is a Stephenson six-bar with two outputs. Arcs, and angles between arcs of a link,
    are in degrees.
    """
    links = {
        "body": {"axes": ["motor", "shoulder", "aux"], "arcs": [60, 75], "angles": [55]},
        "crank": {"axes": ["motor", "pin"], "arcs": [14]},
        "coupler": {"axes": ["pin", "j1", "j2"], "arcs": [55, 62], "angles": [22]},
        "wing": {"axes": ["shoulder", "j1"], "arcs": [32]},
        "tie": {"axes": ["j2", "j3"], "arcs": [45]},
        "vane": {"axes": ["aux", "j3"], "arcs": [50]},
    }
    pairs = "motor body crank, pin crank coupler, j1 coupler wing, shoulder body wing"
    pairs += ", j2 coupler tie, j3 tie vane, aux body vane"
    return build_mechanism("flapper", links, pairs)


def build_mechanism(name, links, pair_text, outputs=("wing", "vane")):
    """Return a mechanism from links and pairs, which are texts "pair link link, ..."."""
    pairs = {}
    for words in pair_text.split(", "):
        pair, first, second = words.split()
        pairs[pair] = {"type": "R", "links": [first, second]}
    return sk.build(
        name,
        angle_unit="deg",
        ground=next(iter(links)),
        links=links,
        pairs=pairs,
        outputs={link: {"link": link} for link in outputs},
    )


def test_places_are_listed_beside_a_curve_on_which_the_output_rests():
    """An output that rests on one whole curve has its places on other curves listed too."""
    points = {
        "output": np.array(["wing", "wing", "vane"]),
        "inside": np.array(["yes", "yes", "yes"]),
        "kind": np.array(["I", "I", "I"]),
        "q": np.array([np.nan, np.radians(30.0), np.radians(40.0)]),
        "assembly_mode": np.array(["0", "1", "1"]),
    }
    whole_curve, places = describe_inputs_of_kinds(points, "wing", "wing", "motor")
    assert whole_curve.startswith("Throughout a configuration curve")
    assert places.endswith("at motor = 30 deg in mode 1")


@pytest.mark.slow
def test_a_stretched_dyad_is_no_crossing_for_outputs_before_it():
    """Where tie and vane are in line, crank and wing rest while the vane moves on.

    That is a self-motion of the output wing; configuration curves do not cross.
    """
    remarks = read_remarks(flapper())
    places = "at motor = 4.31768, 108.184 deg"
    rests = f"rests with the input while other links move (self-motion) {places}"
    assert f"output wing (wing/body) {rests}" in remarks
    assert "Curves of configurations cross" not in remarks
    assert "Least transmission angle of vane (vane/body): 0 deg" in remarks


@pytest.mark.slow
def test_the_turn_of_a_plate_about_a_moving_pole_is_the_sum_of_small_rotations():
    """A remark says by which angle a wobble plate turns in one turn of its shaft.

    The plate is tilted by 18 degrees on the shaft and guided by a gimbal. Its axis of
    rotation moves, so the angle is an integral over the motion. The reference: orientations
    of the plate are built from the directions of its normal and of the gimbal, and the
    rotation angles between 20001 successive ones are added up. `read_remarks` returns the
    remarks of a run.
    """
    tilt_deg = 18.0
    links = {
        "case": {"axes": ["shaft", "gimbal"], "arcs": [90.0]},
        "swash": {"axes": ["shaft", "tilted"], "arcs": [tilt_deg]},
        "plate": {"axes": ["tilted", "trunnion"], "arcs": [90.0]},
        "ring": {"axes": ["gimbal", "trunnion"], "arcs": [90.0]},
    }
    pairs = "shaft case swash, tilted swash plate, trunnion plate ring, gimbal case ring"
    remarks = read_remarks(build_mechanism("wobble", links, pairs, outputs=["plate"]))

    q = np.linspace(0.0, 2.0 * np.pi, 20001)
    tilt = np.radians(tilt_deg)
    plate_normal = np.stack(
        [np.sin(q) * np.sin(tilt), np.cos(q) * np.sin(tilt), np.full_like(q, np.cos(tilt))],
        axis=1,
    )
    gimbal = [0.0, 1.0, 0.0]
    trunnion = np.cross(gimbal, plate_normal)
    trunnion /= np.linalg.norm(trunnion, axis=1)[:, None]
    third_axis = np.cross(plate_normal, trunnion)
    orientations = np.stack([plate_normal, trunnion, third_axis], axis=2)
    steps = np.swapaxes(orientations[:-1], 1, 2) @ orientations[1:]
    turned_deg = np.degrees(np.sum(Rotation.from_matrix(steps).magnitude()))

    # The last angle in the remark is that of the whole motion.
    (line,) = (x for x in remarks.splitlines() if "moving pole" in x)
    assert "plate (plate/case) turns by " in line
    assert abs(last_degrees(line) - turned_deg) < 1e-3


def last_degrees(line):
    """Return the number before the first " deg" of a line."""
    return float(line.split(" deg")[0].split()[-1])


@pytest.mark.slow
def test_a_rolling_cone_turns_by_the_ratio_of_sines_in_a_turn():
    """About the line of contact, by the sines of the shaft angle and its half angle."""
    remarks = read_remarks(sk.load("rolling_cones"))
    turned_deg = 360.0 * np.sin(np.radians(70.0)) / np.sin(np.radians(20.0))
    (line,) = (x for x in remarks.splitlines() if "turns in one sense" in x)
    assert line.endswith("deg in a turn of the input")
    assert abs(last_degrees(line) - turned_deg) < 1e-3


def test_links_whose_names_begin_alike_are_distinguished():
    names = {"1": "1", "2": "2", "3": "3", "4": "11"}
    mechanism = rename_links(sk.load("four_bar"), names)
    assert ordered_pole(mechanism, "11/1") == (3, 0)
    assert ordered_pole(mechanism, (3, "1")) == (3, 0)
    assert ordered_pole(mechanism, "1/11") == (0, 3)
    with pytest.raises(PlanError, match="could mean 1/11 or 11/1"):
        ordered_pole(mechanism, "111")


@pytest.mark.slow
def test_the_sense_of_a_coefficient_is_not_guessed():
    evaluated = sk.evaluate("twelve_bar", 0.1)
    with pytest.raises(PlanError, match="could mean 1/11 or 11/1"):
        evaluated.velocity_coefficient("111")


def test_the_index_of_a_link_is_not_taken_for_a_name():
    """In the four-bar, links 1 to 4 have the indices 0 to 3."""
    mechanism = sk.load("four_bar")
    assert ordered_pole(mechanism, (np.int64(3), 0)) == (3, 0)
    with pytest.raises(PlanError, match="numbered from 0 to 3"):
        ordered_pole(mechanism, (4, 0))
