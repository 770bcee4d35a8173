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

FILE_TEXT = mechanism_text("proof_contacts_discs")
LINK_DISCS = {"a": (70.0, 0.0, 25.0), "b": (75.0, 55.0, 31.5), "c": (50.0, 0.0, 19.0)}
"""Discs a and b on link 1, and c on link 2: arc and angle of the centre, and radius (deg).

Arcs and angles are polar coordinates in the axes of the link."""
PLATE_DISCS = {"a": (0.0, 0.0, 14.0), "b": (35.0, 0.0, 20.25), "c": (28.0, 62.0, 26.0)}
"""The discs of the plate (link 3) that touch them."""


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
        more += f"[pairs.{name}.profiles.{link}]\n{disc(*LINK_DISCS[name])}"
        more += f"[pairs.{name}.profiles.3]\n{disc(*PLATE_DISCS[name])}"
    empty = dict.fromkeys(("on_1", "arcs_1", "angles_1", "on_2", "arcs_2", "body"), "")
    return FILE_TEXT.format(name="plate", more=more, **empty)


def bars(internal=""):
    """Return the text of a mechanism file in which bars replace the contacts of a plate.

    The original mechanism has three sliding contacts a, b and c. In each, a disc of the
    plate (link 3) touches a disc of another link: link 1 in a and b, link 2 in c.
    `PLATE_DISCS` has the discs of the plate by contact, and `LINK_DISCS` those of the links
    1 and 2. A disc is stated by arc and angle of its centre in the axes of the link, and
    its radius (deg).

    A bar joins the centres of two discs in contact. It has the arc of the sum of both
    radii, or of their difference if one disc is inside the other. `internal` is the name of
    such a contact; if it is empty, there is none. `FILE_TEXT` is the common text of both
    files, with fields to fill in for axes and sizes of the links.
    """
    link_and_pair_tables = ""
    for name, link in (("a", "1"), ("b", "1"), ("c", "2")):
        _, _, link_radius = LINK_DISCS[name]
        _, _, plate_radius = PLATE_DISCS[name]
        if name == internal:
            bar_arc = abs(link_radius - plate_radius)
        else:
            bar_arc = link_radius + plate_radius
        link_and_pair_tables += (
            f'[links.bar_{name}]\naxes = ["{name}_{link}", "{name}_3"]\n'
            f"arcs = [{bar_arc}]\n"
        )
        for end in (link, "3"):
            link_and_pair_tables += (
                f'[pairs.{name}_{end}]\ntype = "R"\nlinks = ["{end}", "bar_{name}"]\n'
            )
    # The axes of a link with bars: the pair 12 (not on the plate), then the centres of its
    # discs. `arcs` has the arc from the first axis to each further axis. `angles` has the
    # angle from the first of these arcs to each further arc.
    arc_a, _, _ = LINK_DISCS["a"]
    arc_b, angle_b, _ = LINK_DISCS["b"]
    arc_c, _, _ = LINK_DISCS["c"]
    plate_arc_b, _, _ = PLATE_DISCS["b"]
    plate_arc_c, plate_angle_c, _ = PLATE_DISCS["c"]
    return FILE_TEXT.format(
        name="bars",
        on_1=', "a_1", "b_1"',
        arcs_1=f"{arc_a}, {arc_b}",
        angles_1=angle_b,
        on_2=', "c_2"',
        arcs_2=arc_c,
        body=(
            f'axes = ["a_3", "b_3", "c_3"]\narcs = [{plate_arc_b}, {plate_arc_c}]\n'
            f"angles = [{plate_angle_c}]"
        ),
        more=link_and_pair_tables,
    )


def prove_modes(text, *inputs):
    """Prove the modes of a mechanism file at inputs, which are decimal texts (deg)."""
    return certify_modes(decimal_mechanism(text), inputs)


def differences_between_modes(modes, pair_names):
    """Return exp(i d) of the differences d of joint angles, (modes, modes, pairs).

    Modes are ways to assemble the mechanism. Two mechanism files may count joint angles
    from different zero directions; differences between modes do not depend on them. exp(i
    d) is the same for differences that are equal up to whole turns.
    """
    names = modes.decimal_mechanism.structure.pairs
    columns = [names.index(name) for name in pair_names]
    rows = []
    for mode_angles in modes.angles():
        # An angle is stored with an error bound; its middle value is used.
        rows.append([centre_float(mode_angles[column]) for column in columns])
    angles = np.array(rows)  # (modes, pairs)
    return np.exp(1j * (angles[:, None] - angles[None]))


@pytest.mark.parametrize("internal", ["", "a"])
def test_a_plate_on_three_discs_has_the_modes_of_the_same_plate_on_three_bars(internal):
    """Two discs in contact keep the arc between their centres, as a bar does.

    Both mechanisms have 8 complex modes (ways to assemble them), the largest number that
    the degrees of their equations allow (`mode_bound`). The checker, which shares no code
    with the proof, accepts both certificates. The real modes are the same in some order.
    The files count joint angles from different zero directions, so the differences of
    angles between modes are compared. `internal` is the name of the contact in which one
    disc is inside the other; it is empty if there is none. The input is at 40 deg.
    """
    modes_of_discs = prove_modes(plate(internal), "40")
    modes_of_bars = prove_modes(bars(internal), "40")
    for modes in (modes_of_discs, modes_of_bars):
        assert modes.mode_bound == 8 == len(modes.roots)
        assert modes.is_complete
        # `recorded` returns the certificate as it is read from its JSON file.
        check(recorded(modes_certificate(modes)))
    mode_count = len(modes_of_discs.real)
    assert mode_count == len(modes_of_bars.real) > 1

    pair_names = ["a_1", "a_3", "b_1", "b_3", "c_2", "c_3"]
    disc_differences = differences_between_modes(modes_of_discs, pair_names)
    bar_differences = differences_between_modes(modes_of_bars, pair_names)
    errors = [
        np.max(np.abs(disc_differences - bar_differences[np.ix_(order, order)]))
        for order in itertools.permutations(range(mode_count))
    ]
    assert min(errors) < 1e-9


def agrees(modes, values):
    """Whether columns of a table of the motion are those of a proven mode."""
    columns = modes.decimal_mechanism.motion_columns()
    given = [factor * values[name] for name, factor in columns]
    gaps = wrap(centre_floats(np.array(modes.angles())) - given)
    return np.any(np.max(np.abs(gaps), axis=1) < 1e-9)


def prove_modes_and_poles_of_a_run(mechanism, texts, count):
    """Prove the modes at inputs, compare a run with them, and prove the run's poles.

    A mode is a way to assemble the mechanism, and a pole the axis of the relative rotation
    of two links. Proofs use ball arithmetic, whose numbers have error bounds. `count` is
    the number of real modes, and `texts` are the inputs (deg) as decimal texts.

    Returns
    -------
    The result of `prove_poles` for all rows of the run (one per sample and mode).
    """
    modes = certify_modes(read_decimals(mechanism), texts)
    assert modes.is_complete and len(modes.real) == count
    inputs = np.radians([float(text) for text in texts])
    # A path needs two samples. The modes are compared at the first only.
    result = sk.run(mechanism, "poles", path=np.stack([inputs, inputs + 0.01]))
    frame = result.frame("motion")
    frame = frame[frame["sample"] == 0]
    assert len(frame) == count
    for _, row in frame.iterrows():
        assert agrees(modes, row)
    motion = result.results["motion"].data["motion"]
    poles = result.results["poles"].data["poles"]
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
    """Poles and velocity coefficients of all rows with status OK (0) are proven."""
    proof = prove_modes_and_poles_of_a_run(sk.load(name), inputs.split(), count)
    row_count = int(np.sum(proof.data["status"] == 0))
    assert row_count > 0
    assert list(proof.counts.values()) == [{"holds": row_count}] * 2


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
    """The proof exceeds no error bound that the run states for its poles."""
    mechanism = decimal_mechanism(geared(teeth)).mechanism
    proof = prove_modes_and_poles_of_a_run(mechanism, ["75"], 2)
    row_count = len(proof.data["status"])
    assert row_count > 0
    assert all(verdicts.total() == row_count for verdicts in proof.counts.values())
    assert not proof.exceeded


def test_inputs_at_which_the_follower_of_a_roller_cam_rests_are_proven(capsys):
    """The proof finds the inputs at which the follower of a roller cam is stationary.

    The centres of cam and roller stay at a constant distance of 37 deg, so the mechanism is
    equivalent to a four-bar with a coupler of 37 deg. Its rocker (follower) is stationary
    if crank and coupler are in line. The inputs follow from the spherical law of cosines
    for the triangle of ground, crank with coupler, and rocker. The test reads the numbers
    that the command prints.
    """
    assert main(["certify", "roller_cam"]) == 0
    screen = capsys.readouterr().out
    assert "Proven: all assembly modes" in screen
    # A line of the table: from 0 to 360 deg there are 2 modes (ways to assemble it).
    assert re.search(r"^ +0\.0+ +360\.0+ +2$", screen, re.M)
    printed_numbers = [float(word) for word in re.findall(r"[0-9]+[.][0-9]+", screen)]

    ground, crank, coupler, rocker = np.radians([60.0, 10.0, 37.0, 45.0])
    # The side of the triangle from the crank's axis to the tip of the rocker. Crank and
    # coupler are stretched out, or the crank is folded back on the coupler.
    for side in (coupler + crank, coupler - crank):
        cosine = (np.cos(rocker) - np.cos(side) * np.cos(ground)) / (
            np.sin(side) * np.sin(ground)
        )
        # The angle between ground and side, at the crank's axis. A stretched crank has the
        # direction of the side, a folded crank the opposite direction.
        side_angle = np.degrees(np.arccos(cosine))
        is_stretched = side > coupler
        crank_angle = side_angle if is_stretched else 180 - side_angle
        for expected in (crank_angle, 360 - crank_angle):
            # Inputs are printed in degrees, with nine decimals.
            assert min(abs(expected - number) for number in printed_numbers) < 1e-6


def test_wheels_alone_have_one_mode_everywhere(capsys, tmp_path):
    path = tmp_path / "wheels.json"
    assert main(["certify", "bevel_differential", "-o", str(path)]) == 0
    assert "+0.5 x left_axle +0.5 x right_axle" in capsys.readouterr().out
    kept = json.loads(path.read_text(encoding="utf-8"))
    ratios = {each["pair"]: each["ratios"] for each in kept["ratios"]}
    assert np.allclose(ratios["carrier_axle"], [0.5, 0.5], rtol=0, atol=1e-12)


def test_other_contacts_are_refused():
    for name, words in (
        ("shaped_cam", 'profile on link "cam" is not a circle'),
        ("two_contacts", 'pair "left": the profile on link "3" is not a circle'),
    ):
        with pytest.raises(PlanError, match=words):
            read_decimals(sk.load(name))
    text = plate().replace('type = "Cs"\nlinks = ["2"', 'type = "Cr"\nlinks = ["2"')
    with pytest.raises(PlanError, match="pair c is a rolling contact, but no link carries"):
        decimal_mechanism(text)
    with pytest.raises(AnalysisError, match="-a poles"):
        check_provable(sk.load("four_bar"), ["statics"], has_all_pairs=True)
