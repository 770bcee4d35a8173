"""Crossings of configuration curves, and gaps that are as narrow as one likes."""

import itertools
import json
import re
from decimal import Decimal
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.refusals import decimal_mechanism
from test_proof_adversaries import FOUR_BAR, two_dyads
from test_proof_range import check_counts

import spherekit as sk
from spherekit.cli.main import main
from spherekit.completeness import Guarantee
from spherekit.proof.arc_equations import ArcEquations
from spherekit.proof.balls import flint_library, pi_ball, working_precision
from spherekit.proof.certified_singularities import locate_singularities
from spherekit.proof.collinear_loops import SOLUTION_RADIUS_RAD, Crossings
from spherekit.proof.configuration_curves import certify_curves
from spherekit.proof.construction import find_construction
from spherekit.proof.curve_search import CurveSearch
from spherekit.proof.paving import BoxSet

TURN = ("0", "360")
FOLDS = ("80", "30", "50", "60")


def four_bar(arcs, unit="deg"):
    """Return a four-bar, exact in decimals, with a crank that turns once.

    `arcs` are decimal texts of ground, crank, coupler and rocker in `unit`.
    """
    text = FOUR_BAR.format(*arcs).replace('"deg"', f'"{unit}"')
    if unit == "rad":
        text = text.replace("to = 360", "to = 6.28")
    return decimal_mechanism(text)


def change_arc(arcs, link, step):
    """Add a decimal step (deg, as a text) to the arc of one link, without rounding."""
    changed = [Decimal(arc) for arc in arcs]
    changed[link] += Decimal(step)
    return [format(arc, "f") for arc in changed]


def closes_at_half_a_turn(arcs):
    """Return whether a four-bar can be assembled with its crank at 180 degrees.

    Ground and crank are then in line, and their sum has to lie between difference and sum
    of coupler and rocker (triangle inequality). This is decided by balls (numbers with an
    error bound) of 300 digits. The arcs are nearly those at which both sums are equal, so
    it is asserted that the digits are enough for this comparison. The difference of coupler
    and rocker is far smaller.
    """
    with working_precision(300):
        ground, crank, coupler, rocker = (
            flint_library().arb(arc) * pi_ball() / 180 for arc in arcs
        )
        # The cosine falls with the arc, so the signs of comparison are the other way.
        cosine_of_gap = (ground + crank).cos()
        cosine_of_stretched_dyad = (coupler + rocker).cos()
        cosine_of_folded_dyad = (coupler - rocker).cos()
        assert not (cosine_of_gap - cosine_of_stretched_dyad).contains(0)
        return bool(cosine_of_stretched_dyad < cosine_of_gap < cosine_of_folded_dyad)


@pytest.mark.many(slow=11)
@pytest.mark.parametrize("step", ["1e-6", "1e-8", "1e-10", "1e-12", "1e-14", "1e-20"])
@pytest.mark.parametrize(("link", "sign"), [(0, "+"), (1, "-"), (3, "+"), (3, "-")])
def test_the_proof_knows_on_which_side_a_four_bar_misses_a_crossing(step, link, sign):
    """A proof finds whether two modes of a four-bar pass 180 deg or turn back there.

    Arcs 80 + 30 = 50 + 60 deg let configuration curves cross at 180 deg (a saddle). One arc
    is changed by `step` degrees, up or down as `sign` says. Then the curves of both
    assembly modes (ways to assemble the links) either get past 180 deg without meeting, or
    turn back just before and just after it. The triangle inequality in 300 digits says
    which.

    A saddle is a place where curves cross or nearly do. With coordinates u and v of the
    configurations about the saddle, four arms (branches of curves) leave it, one in each
    quadrant. An arm is named by its signs of u and v.

    Curves that miss each other consist of two joined arms each. If the level sign of the
    saddle is positive, two arms are joined if they have equal signs of v. If it is
    negative, two arms are joined if they have equal signs of u. If the input rises on one
    of them away from the saddle and falls on the other, the curve passes 180 deg. Otherwise
    it turns back.
    """
    # A decimal number as text, such as "-1e-6".
    change = sign + step
    arcs = change_arc(FOLDS, link, change)
    curves = certify_curves(four_bar(arcs), TURN)
    closes = closes_at_half_a_turn(arcs)

    # Away from the crossing (intervals wider than 0.1 rad) there are two modes.
    wide_counts = [count for low, high, count in curves.intervals if high - low > 0.1]
    assert wide_counts
    assert set(wide_counts) == {2}

    is_certified = curves.completeness.guarantee is Guarantee.CERTIFIED
    if closes:
        assert is_certified
    else:
        # Curves turn back on both sides of 180 deg. Turning points that are too close for
        # the proof to separate may stay undecided; then nothing is certified.
        assert not is_certified or len(curves.turning_points) == 2

    for saddle in curves.saddles:
        assert saddle.level_sign in (1, -1)
        # Two arms are joined if this component of their signs (0: u, 1: v) is equal.
        if saddle.level_sign > 0:
            joint_component = 1
        else:
            joint_component = 0
        # For each arm: the sign of the change of each variable away from the saddle.
        signs_by_arm = saddle.outward_signs
        for arm_a, arm_b in itertools.combinations(signs_by_arm, 2):
            are_joined = arm_a[joint_component] == arm_b[joint_component]
            if are_joined:
                # Whether the input, the last variable, rises (1) or falls (-1) on an arm
                # away from the saddle. It is 0 if this is not proven.
                input_sign_a = signs_by_arm[arm_a][-1]
                input_sign_b = signs_by_arm[arm_b][-1]
                assert input_sign_a != 0
                assert input_sign_b != 0
                passes_half_a_turn = input_sign_a != input_sign_b
                assert passes_half_a_turn == closes


@pytest.mark.many
@pytest.mark.parametrize(
    ("ends", "crossed"),
    [
        (("0", "180"), True),
        (("180", "300"), True),
        (("0", "180.00001"), True),
        (("179", "181"), True),
        (("179.9999", "200"), True),
        (("190", "500"), False),
    ],
)
def test_ranges_that_end_next_to_a_crossing_have_all_modes(ends, crossed):
    """Curves of this four-bar cross at 180 deg, where its links are in line.

    `ends` are the ends of the input's range in degrees; `crossed` says whether the range
    contains 180 deg. Each interval has two modes, and the intervals fill the range but for
    a part of 1e-9 about the crossing.
    """
    curves = certify_curves(four_bar(FOLDS), ends)
    assert curves.completeness.guarantee is Guarantee.CERTIFIED
    assert len(curves.crossing_inputs) == int(crossed)
    assert all(count == 2 for _, _, count in curves.intervals)
    low, high = (np.radians(float(end)) for end in ends)
    covered = sum(last - first for first, last, _ in curves.intervals)
    assert covered > (high - low) * (1 - 1e-9)


def crossing_dyads():
    """Two four-bars on one crank, of which the second is in line at one input."""
    text = two_dyads(60, 30, 70, 50, 40).document.text
    for old, new in (
        ("arcs = [50, 30]", "arcs = [30, 30]"),
        ('"f"]\narcs = [40]', '"f"]\narcs = [60]'),
        ('"f"]\narcs = [35]', '"f"]\narcs = [50]'),
    ):
        assert old in text
        text = text.replace(old, new)
    return decimal_mechanism(text)


@pytest.mark.slow
def test_curves_of_two_loops_cross_once_in_each_mode_of_the_other():
    curves = certify_curves(crossing_dyads(), TURN)
    assert curves.completeness.guarantee is Guarantee.CERTIFIED
    assert [saddle.level_sign for saddle in curves.saddles] == [0, 0]
    assert np.ptp(curves.crossing_inputs) < 1e-9
    check_counts(curves, curves.intervals[:2])


def test_the_input_is_clear_of_crossings_as_far_as_is_said():
    curves = certify_curves(four_bar(FOLDS), TURN)
    clear = locate_singularities(curves).clearance(np.radians(170.0))
    assert np.radians(10.0) - 1e-9 < clear <= np.radians(10.0)


def test_links_in_radians_are_in_line_where_both_sides_are_the_same_sum():
    exact = four_bar(("1.4", "0.5", "0.9", "1.0"), "rad")
    curves = certify_curves(exact, ("2.5", "3.5"))
    assert [saddle.level_sign for saddle in curves.saddles] == [0]
    near = four_bar(("1.4", "0.5", "0.9", "1.00000000000001"), "rad")
    nearly = certify_curves(near, ("2.5", "3.5"))
    assert [saddle.level_sign for saddle in nearly.saddles] == [-1]


def test_a_tolerance_leaves_open_whether_curves_cross():
    written = decimal_mechanism(FOUR_BAR.format(*FOLDS), tolerance=1e-12)
    curves = certify_curves(written, TURN)
    assert curves.completeness.guarantee is Guarantee.TO_BOX
    assert [saddle.level_sign for saddle in curves.saddles] == [None]
    assert {count for _, _, count in curves.intervals} == {2}


WITHOUT_OUTPUTS = """
format = 1
name = "odd"
ground = "base"
angle_unit = "deg"
[links]
base = {{ axes = ["a", "d", "g"], arcs = [77.0, 63.0], angles = [55.0] }}
crank = {{ axes = ["a", "b"], arcs = [{}] }}
rod = {{ axes = ["b", "c", "e"], arcs = [81.0, 33.0], angles = [-28.0] }}
swing = {{ axes = ["d", "c"], arcs = [52.0] }}
arm = {{ axes = ["e", "f"], arcs = [71.0] }}
flap = {{ axes = ["g", "f"], arcs = [58.0] }}
[pairs]
a = {{ type = "R", links = ["base", "crank"] }}
b = {{ type = "R", links = ["crank", "rod"] }}
c = {{ type = "R", links = ["rod", "swing"] }}
d = {{ type = "R", links = ["base", "swing"] }}
e = {{ type = "R", links = ["rod", "arm"] }}
f = {{ type = "R", links = ["arm", "flap"] }}
g = {{ type = "R", links = ["base", "flap"] }}
[inputs.a]
"""
"""A six-bar linkage with the arc of the crank (deg) to be filled in, without outputs."""


def test_certificates_of_undecided_crossings_are_written(tmp_path):
    path = tmp_path / "fold.toml"
    path.write_text(FOUR_BAR.format(*FOLDS), encoding="utf-8")
    out = tmp_path / "certificate.json"
    assert main(["certify", str(path), "--tolerance", "1e-12rad", "-o", str(out)]) == 3
    certificate = json.loads(out.read_text(encoding="utf-8"))
    assert certificate["singularities"]["undecided_parts"] > 0


def test_the_command_says_where_curves_cross(tmp_path, capsys):
    path = tmp_path / "kite.toml"
    path.write_text(FOUR_BAR.format(40, 40, 70, 70), encoding="utf-8")
    assert main(["certify", str(path)]) == 0
    said = capsys.readouterr().out
    assert "curves cross at 0.000000000 deg, in 2 configurations (type III)" in said
    assert "deg the mechanism can move while the input is at rest (type II)" in said
    # The only singularities of the kite are these, which the last result does not deny.
    assert "  Elsewhere there are no singularities." in said


@pytest.mark.slow
@pytest.mark.parametrize("crank_arc", [17.0, 60.0])
def test_certificates_of_files_without_outputs_have_all_singularities(
    crank_arc, tmp_path, capsys
):
    """If a file declares no outputs, links with a pair at the ground count as outputs.

    The inputs of proven singularities of this six-bar are compared with those of the
    analysis `singularities`, which finds them by another method. In type I an output rests,
    in type II the input. Type II occurs with the long crank (60 deg) only, since a short
    one makes full turns. If a certificate names two types, such as "II or III", the first
    is compared.
    """
    path = tmp_path / "odd.toml"
    path.write_text(WITHOUT_OUTPUTS.format(crank_arc), encoding="utf-8")
    assert main(["certify", str(path)]) == 0
    printed = capsys.readouterr().out
    proven = re.findall(r"type (I+)\b.* (\d+\.\d{9}) ", printed)
    rows = sk.run(str(path), "singularities", samples=37).frame("singularities")
    for singularity_type in ("I", "II"):
        of_type = rows[rows["kind"] == singularity_type]
        expected_deg = np.unique(np.round(np.degrees(of_type["q"]) % 360.0, 6))
        proven_deg = [float(q) for name, q in proven if name == singularity_type]
        # Each input of the analysis must be in the certificate. The reverse is not tested:
        # where the certificate says "I or III", the analysis lists no type I.
        for q in expected_deg:
            assert min(np.abs(np.array(proven_deg) - q)) < 1e-5
        is_long_crank = crank_arc == 60.0
        is_expected = singularity_type == "I" or is_long_crank
        assert (len(expected_deg) > 0) == is_expected


def kite_with_dyads(count):
    """Return a kite-shaped four-bar, with further four-bars on the same crank.

    With the crank at 0 degrees, the tip of the crank is on the axis of the kite's rocker,
    which then can turn while the crank stands still. The `count` further four-bars are all
    alike, with an angle of 50 degrees between the crank arc and the ground arc in this
    position.

    Four-bar number k has the coupler b<k> and the rocker w<k>; the kite is number 0. The
    ground "g" and the crank "k" have an arc for each four-bar. All these arcs begin at the
    axis "a" of the crank. Their directions are given as angles about this axis, from the
    arc of the kite.
    """
    ground_axes = ["a", "r0", *(f"r{k}" for k in range(1, count + 1))]
    crank_axes = ["a", "c0", *(f"c{k}" for k in range(1, count + 1))]
    ground = ", ".join(f"{40.0 * k}" for k in range(1, count + 1))
    crank = ", ".join(f"{40.0 * k + 50.0}" for k in range(1, count + 1))
    arcs = {"g": ([60.0, *[70.0] * count], ground), "k": ([60.0, *[30.0] * count], crank)}
    text = 'format = 1\nname = "kite"\nangle_unit = "deg"\nground = "g"\n'
    for link, axes in (("g", ground_axes), ("k", crank_axes)):
        link_arcs, angles = arcs[link]
        text += f"[links.{link}]\naxes = {json.dumps(axes)}\narcs = {link_arcs}\n"
        text += f"angles = [{angles}]\n"
    pairs = {"a": ("g", "k")}
    for k in range(count + 1):
        coupler, rocker = (50.0, 50.0) if k == 0 else (80.0, 60.0)
        text += f'[links.b{k}]\naxes = ["c{k}", "d{k}"]\narcs = [{coupler}]\n'
        text += f'[links.w{k}]\naxes = ["r{k}", "d{k}"]\narcs = [{rocker}]\n'
        pairs[f"c{k}"] = ("k", f"b{k}")
        pairs[f"d{k}"] = (f"b{k}", f"w{k}")
        pairs[f"r{k}"] = (f"w{k}", "g")
    for name, ends in pairs.items():
        text += f'[pairs.{name}]\ntype = "R"\nlinks = {json.dumps(ends)}\n'
    return decimal_mechanism(text + "[inputs.a]\nfrom = 0\nto = 360\n")


def test_boxes_inside_a_crossing_that_was_found_after_them_are_decided():
    curves = certify_curves(four_bar(("60", "30", "60", "30")), TURN)
    search = CurveSearch(curves.equations, side=lambda _input_variable, _margin: 0)
    for saddle in curves.saddles:
        assert search.crossings.find(saddle.centre)
    centres = np.array([saddle.centre for saddle in curves.saddles])
    assert len(centres) == 2
    small_boxes = BoxSet(centres, np.full_like(centres, 1e-6))
    assert len(search.resolve_undecided(small_boxes)) == 0


@pytest.mark.slow
def test_a_configuration_in_a_box_is_bounded_by_its_euclidean_distance():
    """The stated error of a configuration in a proof covers the errors of all variables.

    The mechanism is a kite (four-bar) and five further four-bars on the same crank. With
    the crank "a" at 0, the rocker "r0" of the kite can turn alone. So the crank is constant
    on a curve of configurations.

    `is_constant` proves this from a piece of the curve. Around the piece is a box that
    contains no other configurations. `is_constant` computes a configuration with a constant
    crank near the centre of the box. The proof succeeds if this configuration is certainly
    inside the box. So `is_constant` passes the configuration to `contains`, with a bound of
    its error. The sides of a box may have any directions in the space of all variables, so
    this bound has to be a Euclidean distance.

    Here a stand-in for the piece records the bound. The angles of the five further rockers
    are only known to be within `SOLUTION_RADIUS_RAD`, so the bound has to be at least
    sqrt(5) times that.
    """
    count = 5
    mechanism = kite_with_dyads(count)
    equations = ArcEquations(mechanism, find_construction(mechanism.structure))
    names = [mechanism.structure.pairs[pair] for pair in equations.construction.pairs]
    # A four-bar with the sizes of the further ones. These have an angle of 50 deg between
    # crank and ground where "a" is 0.
    text = FOUR_BAR.format(70, 30, 80, 60)
    motion = sk.trace(decimal_mechanism(text).mechanism, path=np.radians([[50.0]]))
    rocker_angle = motion.values[0, motion.mechanism.pair_number["34"]]
    # A configuration of the curve: any angle of "r0" will do.
    angles = {"a": 0.0, "r0": 1.0}
    for k in range(1, count + 1):
        angles[f"r{k}"] = rocker_angle
    centre = np.array([angles[name] for name in names])
    errors = []

    def contains(_position, error):
        """Record the bound of the error, and say that the configuration is inside."""
        errors.append(error)
        return True

    piece = SimpleNamespace(centre=centre, contains=contains)
    assert Crossings(equations).is_constant([piece], names.index("a"))
    (error,) = errors
    assert error >= np.sqrt(count) * SOLUTION_RADIUS_RAD
