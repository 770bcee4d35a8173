"""Contacts of circles, proven: sliding ones are links, rolling ones turn what they turn."""

import itertools
import json
import re

import numpy as np
import pytest
from helpers.refusals import decimal_mechanism, mechanism_text
from oracles.proof_checker import check, recorded

import spherekit as sk
from spherekit.cli.main import main
from spherekit.errors import AnalysisError, PlanError
from spherekit.numerics.angles import wrap
from spherekit.proof.balls import centre_float, centre_floats
from spherekit.proof.certificate import modes_certificate
from spherekit.proof.certified_modes import certify_modes
from spherekit.proof.decimal_mechanism import read_decimals
from spherekit.runs.proven_poles import check_provable, prove_poles

DISCS = mechanism_text("proof_contacts_discs")
BARS = {"a": (70.0, 0.0, 25.0), "b": (75.0, 55.0, 31.5), "c": (50.0, 0.0, 19.0)}
"""Three discs on links 1, 1 and 2: arc and angle of the centre there, radius there."""
PLATE = {"a": (0.0, 0.0, 14.0), "b": (35.0, 0.0, 20.25), "c": (28.0, 62.0, 26.0)}


def disc(arc, turn, radius):
    """A circle in the frame of a link, whose second axis has a positive y."""
    a, t = np.radians([arc, turn])
    centre = [-np.sin(a) * np.sin(t), np.sin(a) * np.cos(t), np.cos(a)]
    numbers = ", ".join(repr(float(x)) for x in centre)
    return f'kind = "circle"\ncentre_xyz = [{numbers}]\nradius = {radius}\n'


def plate(internal=""):
    """A plate with three discs, one of which may lie within that of the other link."""
    more = ""
    for name, link in (("a", "1"), ("b", "1"), ("c", "2")):
        words = 'contact = "internal"\n' if name == internal else ""
        more += f'[pairs.{name}]\ntype = "Cs"\nlinks = ["{link}", "3"]\n{words}'
        more += f"[pairs.{name}.profiles.{link}]\n{disc(*BARS[name])}"
        more += f"[pairs.{name}.profiles.3]\n{disc(*PLATE[name])}"
    empty = dict.fromkeys(("on_1", "arcs_1", "angles_1", "on_2", "arcs_2", "body"), "")
    return DISCS.format(name="plate", more=more, **empty)


def bars(internal=""):
    """The same plate on three bars, from centre to centre."""
    more = ""
    for name, link in (("a", "1"), ("b", "1"), ("c", "2")):
        sense = -1 if name == internal else 1
        arc = abs(BARS[name][2] + sense * PLATE[name][2])
        more += f'[links.bar_{name}]\naxes = ["{name}_{link}", "{name}_3"]\n'
        more += f"arcs = [{arc}]\n"
        for end in (link, "3"):
            more += f'[pairs.{name}_{end}]\ntype = "R"\nlinks = ["{end}", "bar_{name}"]\n'
    (a1, _, _), (b1, b2, _), (c1, _, _) = BARS.values()
    (_, _, _), (e1, _, _), (f1, f2, _) = PLATE.values()
    return DISCS.format(
        name="bars",
        on_1=', "a_1", "b_1"',
        arcs_1=f"{a1}, {b1}",
        angles_1=b2,
        on_2=', "c_2"',
        arcs_2=c1,
        body=f'axes = ["a_3", "b_3", "c_3"]\narcs = [{e1}, {f1}]\nangles = [{f2}]',
        more=more,
    )


def proven(text, *inputs):
    return certify_modes(decimal_mechanism(text), inputs)


@pytest.mark.parametrize("internal", ["", "a"])
def test_a_plate_on_three_discs_has_the_modes_of_the_same_plate_on_three_bars(internal):
    contacts, links = proven(plate(internal), "40"), proven(bars(internal), "40")
    for modes in (contacts, links):
        assert modes.mode_bound == 8 == len(modes.roots) and modes.is_complete
        check(recorded(modes_certificate(modes)))
    assert len(contacts.real) == len(links.real) > 1
    inner = ["a_1", "a_3", "b_1", "b_3", "c_2", "c_3"]
    gaps = []
    for modes in (contacts, links):
        names = modes.decimal_mechanism.structure.pairs
        rows = [
            [centre_float(angles[names.index(name)]) for name in inner]
            for angles in modes.angles()
        ]
        # zero directions differ, differences between modes do not
        gaps.append(np.array(rows)[:, None] - np.array(rows)[None])
    turned = np.exp(1j * np.array(gaps))
    orders = itertools.permutations(range(len(links.real)))
    turns = [turned[1][np.ix_(order, order)] for order in orders]
    assert min(np.max(np.abs(turned[0] - each)) for each in turns) < 1e-9


def agrees(modes, values):
    """Whether columns of a table of the motion are those of a proven mode."""
    columns = modes.decimal_mechanism.motion_columns()
    given = [factor * values[name] for name, factor in columns]
    gaps = wrap(centre_floats(np.array(modes.angles())) - given)
    return np.any(np.max(np.abs(gaps), axis=1) < 1e-9)


def compared(mechanism, texts, count):
    """Prove the modes and poles of a mechanism that a run finds at the same inputs."""
    modes = certify_modes(read_decimals(mechanism), texts)
    assert modes.is_complete and len(modes.real) == count
    here = np.radians([float(text) for text in texts])
    result = sk.run(mechanism, "poles", path=np.stack([here, here + 0.01]))
    frame = result.frame("motion")
    frame = frame[frame["sample"] == 0]
    assert len(frame) == count
    for _, row in frame.iterrows():
        assert agrees(modes, row)
    motion, poles = (result.results[each].data[each] for each in ("motion", "poles"))
    return prove_poles(mechanism, motion, poles)


SHIPPED = [
    ("roller_cam", "40", 2),
    pytest.param("flat_cam", "40", 2, marks=pytest.mark.long),
    pytest.param("bevel_pair", "400", 1, marks=pytest.mark.long),
    ("rolling_cones", "-70", 1),
    pytest.param("planetary_bevel", "10", 1, marks=pytest.mark.long),
    pytest.param("bevel_differential", "40 10", 1, marks=pytest.mark.long),
]


@pytest.mark.parametrize(("name", "inputs", "count"), SHIPPED)
def test_modes_and_poles_of_contacts_are_those_that_a_run_finds(name, inputs, count):
    found = compared(sk.load(name), inputs.split(), count)
    moving = int(np.sum(found.data["status"] == 0))
    assert moving > 0 and list(found.counts.values()) == [{"holds": moving}] * 2


def geared(teeth):
    """A five-bar whose second crank is turned by wheels on both cranks."""
    text = read_decimals(sk.load("five_bar")).document.text
    head, _, rest = text.partition("[inputs.51]")
    _, _, outputs = rest.partition("[outputs")
    mesh = '[pairs.mesh]\ntype = "Cr"\nlinks = ["2", "5"]\naxes = ["21", "51"]\n'
    mesh += f"{teeth}\n\n"
    return head.replace("[inputs.21]", mesh + "[inputs.21]") + "[outputs" + outputs


LOOPS = [
    pytest.param("teeth = [40, 20]", marks=pytest.mark.long),
    'teeth = [18, 31]\ncontact = "internal"\nstart = [12.0, -31.0]',
]


@pytest.mark.parametrize("teeth", LOOPS)
def test_wheels_in_a_loop_turn_as_in_a_run(teeth):
    found = compared(decimal_mechanism(geared(teeth)).mechanism, ["75"], 2)
    rows = len(found.data["status"])
    assert rows > 0 and all(each.total() == rows for each in found.counts.values())
    assert not found.exceeded


def test_a_sliding_contact_is_proven_over_its_whole_range(capsys):
    assert main(["certify", "roller_cam"]) == 0
    said = capsys.readouterr().out
    assert "certified: all configurations" in said and "360.000000000 deg: 2 modes" in said
    # a four-bar of arcs 60, 10, 37, 45: the follower rests with crank and coupler in line
    ground, crank, coupler, rocker = np.radians([60.0, 10.0, 37.0, 45.0])
    for reach in (coupler + crank, coupler - crank):
        cosine = (np.cos(rocker) - np.cos(reach) * np.cos(ground)) / (
            np.sin(reach) * np.sin(ground)
        )
        angle = np.degrees(np.arccos(cosine))
        near = [angle, 360 - angle] if reach > coupler else [180 - angle, 180 + angle]
        told = [float(word) for word in re.findall(r"[0-9]+[.][0-9]+", said)]
        for each in near:
            assert min(abs(each - angle) for angle in told) < 1e-6


def test_wheels_alone_have_one_mode_everywhere(capsys, tmp_path):
    path = tmp_path / "wheels.json"
    assert main(["certify", "bevel_differential", "-o", str(path)]) == 0
    assert "+0.5 x left_axle +0.5 x right_axle" in capsys.readouterr().out
    kept = json.loads(path.read_text(encoding="utf-8"))
    ratios = {each["pair"]: each["ratios"] for each in kept["ratios"]}
    assert np.allclose(ratios["carrier_axle"], [0.5, 0.5], rtol=0, atol=1e-12)


def test_other_contacts_are_refused():
    for name, words in (
        ("shaped_cam", "profile on cam is no circle"),
        ("two_contacts", "pair left is a contact whose profile on 3 is no circle"),
    ):
        with pytest.raises(PlanError, match=words):
            read_decimals(sk.load(name))
    text = plate().replace('type = "Cs"\nlinks = ["2"', 'type = "Cr"\nlinks = ["2"')
    with pytest.raises(PlanError, match="pair c is a rolling contact, and no link carries"):
        decimal_mechanism(text)
    with pytest.raises(AnalysisError, match="-a poles"):
        check_provable(sk.load("four_bar"), ["statics"], whole=True)
