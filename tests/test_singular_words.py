"""What a run says of singularities in a few lines, by hand formulas."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import spherekit as sk
from spherekit.plugin.checks.variants import rename_links
from spherekit.plugin.singularities import ordered_pole

NAME = "singularities"


def said_of(mechanism, samples=73):
    found = sk.run(mechanism, NAME, samples=samples)
    assert not found.failures
    return "\n".join(found.summary["remarks"])


def flapper():
    """A crank-rocker whose coupler leads a second rocker by a tie, a Stephenson chain."""
    links = {
        "body": {"axes": ["motor", "shoulder", "aux"], "arcs": [60, 75], "angles": [55]},
        "crank": {"axes": ["motor", "pin"], "arcs": [14]},
        "coupler": {"axes": ["pin", "j1", "j2"], "arcs": [55, 62], "angles": [22]},
        "wing": {"axes": ["shoulder", "j1"], "arcs": [32]},
        "tie": {"axes": ["j2", "j3"], "arcs": [45]},
        "vane": {"axes": ["aux", "j3"], "arcs": [50]},
    }
    joined = "motor body crank, pin crank coupler, j1 coupler wing, shoulder body wing"
    return built("flapper", links, joined + ", j2 coupler tie, j3 tie vane, aux body vane")


def built(name, links, joined, outputs=("wing", "vane")):
    pairs = {}
    for words in joined.split(", "):
        pair, one, other = words.split()
        pairs[pair] = {"type": "R", "links": [one, other]}
    return sk.build(
        name,
        angle_unit="deg",
        ground=next(iter(links)),
        links=links,
        pairs=pairs,
        outputs={link: {"link": link} for link in outputs},
    )


@pytest.mark.slow
def test_a_dyad_at_its_limit_is_no_crossing_for_an_output_before_it():
    """Where the tie and the vane are in line crank and wing rest, and no curves cross."""
    said = said_of(flapper())
    line = "it rests with the input while other links move: at motor = 4.31768, 108.184 deg"
    assert f"self-motion of wing/body, {line}" in said
    assert "curves of configurations cross" not in said
    assert "least transmission angle of vane/body: 0 deg" in said


@pytest.mark.slow
def test_a_plate_about_a_moving_pole_does_not_swing():
    """A wobbling plate held by a gimbal: its rate's size is integrated over a turn."""
    tilt = 18.0
    links = {
        "case": {"axes": ["shaft", "gimbal"], "arcs": [90.0]},
        "swash": {"axes": ["shaft", "tilted"], "arcs": [tilt]},
        "plate": {"axes": ["tilted", "trunnion"], "arcs": [90.0]},
        "ring": {"axes": ["gimbal", "trunnion"], "arcs": [90.0]},
    }
    joined = "shaft case swash, tilted swash plate, trunnion plate ring, gimbal case ring"
    said = said_of(built("wobble", links, joined, outputs=["plate"]))
    q, tilted = np.linspace(0.0, 2.0 * np.pi, 20001), np.radians(tilt)
    normal = np.stack([np.sin(q) * np.sin(tilted), np.cos(q) * np.sin(tilted)])
    normal = np.stack([*normal, np.full_like(q, np.cos(tilted))], axis=1)
    trunnion = np.cross([0.0, 1.0, 0.0], normal)
    trunnion /= np.linalg.norm(trunnion, axis=1)[:, None]
    axes = np.stack([normal, trunnion, np.cross(normal, trunnion)], axis=2)
    turns = Rotation.from_matrix(np.swapaxes(axes[:-1], 1, 2) @ axes[1:])
    turned = np.degrees(np.sum(turns.magnitude()))
    (line,) = (x for x in said.splitlines() if "moving pole" in x)
    assert "plate/case turns by " in line
    assert abs(float(line.split(" deg")[0].split()[-1]) - turned) < 1e-3


@pytest.mark.slow
def test_a_cone_that_never_returns_turns_by_its_ratio():
    """About the line of contact, by the sines of the shaft angle and its half angle."""
    said = said_of(sk.load("rolling_cones"))
    turned = 360.0 * np.sin(np.radians(70.0)) / np.sin(np.radians(20.0))
    (line,) = (x for x in said.splitlines() if "turns in one sense" in x)
    assert line.endswith("deg in a turn of the input")
    assert abs(float(line.split(" deg")[0].split()[-1]) - turned) < 1e-3


def test_links_whose_names_begin_alike_are_told_apart():
    made = rename_links(sk.load("four_bar"), {"1": "1", "2": "2", "3": "3", "4": "11"})
    assert ordered_pole(made, "11/1") == ordered_pole(made, (3, "1")) == (3, 0)
    assert ordered_pole(made, "1/11") == (0, 3)
