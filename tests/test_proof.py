"""Certified assembly modes against elimination, and by a checker of their own."""

import copy
import itertools
import json
import random
import re

import numpy as np
import pytest
from helpers.refusals import decimal_mechanism
from oracles.proof_checker import check, recorded, refuse

import spherekit as sk
from spherekit.cli.main import main
from spherekit.completeness import Guarantee
from spherekit.numerics.angles import wrap
from spherekit.planning.assembly_plan import driven_at, plan_assembly
from spherekit.positions.assembly_enumeration import enumerate_assemblies
from spherekit.positions.position_solver import PositionSolver
from spherekit.proof.balls import (
    centre_floats,
    exact_centres,
    flint_library,
    lower_magnitude,
    upper_magnitude,
)
from spherekit.proof.certificate import modes_certificate
from spherekit.proof.certified_modes import certify_modes
from spherekit.proof.construction import find_construction
from spherekit.proof.decimal_mechanism import read_decimals
from spherekit.proof.structure import extract_structure

CASES = [
    ("four_bar", None, ("40",), 2),
    ("watt", "23", ("100",), 4),
    ("stephenson", "16", ("30",), 8),
    ("eight_bar_01", "56", ("33.3",), 8),
    ("double_butterfly", "A", ("50",), 24),
    ("double_butterfly", "D", ("10",), 32),
    ("three_rrr", None, ("10", "20", "30"), 8),
    ("agile_eye", None, ("10", "20", "30"), 8),
]


def certified_modes_of(name, pair, inputs, tolerance=0.0):
    """Certify the modes of a shipped mechanism at inputs (deg, as texts).

    A mode is one of the ways to assemble the mechanism at these inputs. `pair` is the name
    of the driven pair; with None the inputs are those of the file. The proof is valid for
    all sizes that differ from those of the file by up to `tolerance` (rad).
    """
    mechanism = driven_at(sk.load(name), pair)
    return certify_modes(read_decimals(mechanism, tolerance=tolerance), inputs)


@pytest.mark.many
@pytest.mark.parametrize(("name", "pair", "inputs", "bound"), CASES)
def test_all_complex_modes_are_proven_and_the_real_ones_are_those_found(
    name, pair, inputs, bound
):
    """All complex modes are proven, and the real ones are those that are found without.

    Modes are solutions of the closure equations, so they can be complex. Only the real ones
    can be assembled. They are compared with those of `enumerate_assemblies`, which computes
    all real modes in float64 without a proof. The proven angles are balls (intervals about
    a centre) of less than 1e-15 rad. An independent checker accepts the certificate (file
    of a proof).

    `pair` is the driven pair, and None for the inputs of the file. `inputs` are the input
    angles (deg), and `bound` is the number of complex modes.
    """
    modes = certified_modes_of(name, pair, inputs)
    assert modes.mode_bound == bound == len(modes.roots) and modes.is_complete
    assert modes.completeness.guarantee is Guarantee.CERTIFIED
    mechanism = modes.decimal_mechanism.mechanism
    solver = PositionSolver(mechanism, plan_assembly(mechanism))
    inputs_rad = np.radians([float(value) for value in inputs])
    assemblies = enumerate_assemblies(solver, inputs_rad)
    assert len(assemblies.values) == len(modes.real)
    # (real modes, variables) the angles of the real modes.
    balls = np.array(modes.angles())
    assert max(map(upper_magnitude, (balls - exact_centres(balls)).flat)) < 1e-15
    proven_modes = centre_floats(balls)
    for found_mode in assemblies.values:
        gaps = np.max(np.abs(wrap(proven_modes - found_mode)), axis=1)
        assert np.sum(gaps < 1e-9) == 1
    check(recorded(modes_certificate(modes)))


@pytest.mark.slow
def test_eight_bars_driven_at_any_pair_have_a_construction_with_three_unknowns():
    """A construction with three unknown angles exists for every driven pair.

    A construction places all links one after another, as functions of the input and of some
    unknown angles. It has as many equations as unknown angles. The degrees of these
    equations bound the number of assembly modes (`mode_bound`). The bounds of these
    mechanisms are 8, 16, 24 or 32. Six of the sixteen shipped eight-bars are tested.
    """
    for number in (1, 2, 4, 7, 10, 15):
        mechanism = sk.load(f"eight_bar_{number:02d}")
        for pair in mechanism.pairs:
            construction = find_construction(
                extract_structure(driven_at(mechanism, pair.name))
            )
            assert construction.mode_bound in (8, 16, 24, 32)
            assert len(construction.equation_steps) == construction.unknown_count == 3


def test_modes_keep_their_order_where_an_angle_is_half_a_turn():
    """The output of a universal joint is at 180 deg in one mode, and at 0 in the other."""
    for angle_deg in ("1e-12", "0", "-1e-12"):
        modes = certified_modes_of("universal_joint", None, (angle_deg,))
        half_turns = [
            abs(wrap(complex(root.centre[0]).real)) / np.pi for root in modes.real
        ]
        assert np.allclose(half_turns, [1.0, 0.0])


def test_sizes_within_a_tolerance_have_the_modes_that_are_proven_for_all_of_them():
    """Modes proven for all sizes within 1e-6 rad enclose those of such mechanisms.

    A mode is one way to assemble the mechanism at the input, which is 40 deg here. Arcs of
    the file are changed by random numbers of up to 1e-6 rad, five times. The proven joint
    angles of each changed mechanism overlap the intervals of one mode.
    """
    # With None the input is that of the file. Its angle is a decimal number as text.
    angle_deg = ("40",)
    modes = certified_modes_of("four_bar", pair=None, inputs=angle_deg, tolerance=1e-6)
    assert modes.is_complete
    assert len(modes.real) == 2
    # For each mode an interval for each joint angle.
    enclosures = modes.angles()
    random_numbers = random.Random(5)
    mechanism = modes.decimal_mechanism.mechanism
    for _ in range(5):
        arcs = {}
        for link, sizes in mechanism.geometry.links.items():
            arcs[link] = [arc + random_numbers.uniform(-1e-6, 1e-6) for arc in sizes.arcs]
        changed = mechanism.with_sizes(angle_unit="rad", arcs=arcs)
        changed_modes = certify_modes(read_decimals(changed), angle_deg)

        def is_enclosed(angles, enclosure):
            """Return whether the angles of a mode overlap the intervals of another one."""
            return all(a.overlaps(b) for a, b in zip(angles, enclosure, strict=True))

        for angles in changed_modes.angles():
            assert any(is_enclosed(angles, enclosure) for enclosure in enclosures)


def tampered(certificate, random_choice):
    """Return a certificate with one random change, so that it is false or proves nothing.

    The certificate states all complex modes (solutions) of a mechanism at given inputs.

    Parameters
    ----------
    certificate
        Dictionary with the text of the mechanism file, its construction, inputs, "roots"
        (complex modes as balls), their largest number "bound" and the number of real ones,
        "modes".
    random_choice
        Random generator.
    """
    changed = copy.deepcopy(certificate)
    roots = changed["roots"]
    root = random_choice.choice(roots)
    step = random_choice.choice(changed["construction"]["steps"])

    # A coordinate of a root is complex: a list of its real and imaginary part. Each part is
    # mantissa * 2**exponent. One of the first 30 digits (bits) of the mantissa of the real
    # part is changed. The new number is outside of the ball.
    coordinate = random_choice.choice(root["centre"])
    mantissa, exponent = coordinate[0]
    shift = 1 << max(mantissa.bit_length() - random_choice.randrange(2, 30), 1)

    # Another root, which then occurs twice, while this one is missing.
    other_roots = [x for x in roots if x is not root]
    other_root = random_choice.choice(other_roots)

    # One arc in the text of the mechanism is changed: its first digit becomes 0.001.
    text = changed["mechanism"]
    arc_positions = [match.end() for match in re.finditer(r"arcs = \[", text)]
    position = random_choice.choice(arc_positions)
    changed_text = text[:position] + "0.001" + text[position + 1 :]

    # A step of the construction places a link by the one or two pairs whose names are in
    # "by". Two pairs are interchanged, and one pair is listed twice.
    changed_pairs = step["by"][::-1] if len(step["by"]) == 2 else 2 * step["by"]

    input_pair, input_value = next(iter(changed["inputs"].items()))
    changed_input = repr(float(input_value) + 10.0 ** -random_choice.randrange(1, 9))
    # Possible changes: (table or list, key or index, new value). A wrong bound or number of
    # modes differs by any number, here by 1, 2 or 8. No root can be proven in a ball that
    # is much smaller than that of the certificate.
    container, key, value = random_choice.choice(
        [
            (coordinate, 0, [mantissa + shift, exponent]),
            (root, "real", not root["real"]),
            (changed, "roots", other_roots),
            (changed, "bound", changed["bound"] + random_choice.choice((-1, 1, 8))),
            (changed, "modes", changed["modes"] + random_choice.choice((-1, 1, 2))),
            (roots, roots.index(root), copy.deepcopy(other_root)),
            (root, "radius", root["radius"] * 2.0 ** -random_choice.randrange(20, 60)),
            (changed["inputs"], input_pair, changed_input),
            (step, "by", changed_pairs),
            (changed, "mechanism", changed_text),
        ]
    )
    container[key] = value
    return changed


@pytest.mark.slow
def test_the_checker_refuses_a_hundred_tampered_certificates():
    """An independent checker refuses 100 randomly falsified certificates.

    A certificate (file of a proof) states all assembly modes (ways to assemble the links)
    of a mechanism at some inputs. Those of three mechanisms are falsified in turn.
    `tampered` returns a certificate with one random change, and `refuse` asserts that the
    checker rejects it.
    """
    random_choice = random.Random(17)
    # Name of the mechanism, its driven pair (None: those of the file), and inputs (deg).
    cases = [
        ("four_bar", None, ("40",)),
        ("stephenson", "16", ("30",)),
        ("three_rrr", None, ("10", "20", "30")),
    ]
    certificates = []
    for name, pair, inputs in cases:
        modes = certified_modes_of(name, pair, inputs)
        # `recorded` returns a certificate as it is read from its JSON file.
        certificates.append(recorded(modes_certificate(modes)))
    for number in range(100):
        changed = tampered(certificates[number % 3], random_choice)
        assert changed not in certificates
        refuse(changed)


def stretched(coupler):
    """Return a four-bar with a follower of 30 deg and a coupler of the given arc (deg).

    At the input 0 the tip of its crank is 40 deg from the axis of the follower.
    """
    text = read_decimals(sk.load("four_bar")).document.text
    text = text.replace("arcs = [40.0]", "arcs = [30.0]")
    return decimal_mechanism(text.replace("arcs = [70.0]", f"arcs = [{coupler}]"))


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("digits", (6, 12, 28))
def test_modes_however_close_are_told_apart_and_a_double_one_is_never_certified(digits):
    """Near a double mode, two or no modes are certified; the double one itself is not.

    A mode is a way to assemble the links. `stretched` returns a four-bar with a given
    coupler. At its input 0 the tip of the crank is 40 deg from the axis of the follower.
    The follower has 30 deg. A coupler of 10 deg is in line with it, so both modes coincide.
    A coupler of 10 - 10^-digits deg is too short, so there is no mode. A coupler of
    10 + 10^-(digits + 1) deg has two modes. The angle between these modes is of the order
    of the square root of the excess over 10 deg.
    """
    too_short = certify_modes(stretched("9." + "9" * digits), ("0",))
    assert too_short.is_complete and not too_short.real
    longer = certify_modes(stretched("10." + "0" * digits + "1"), ("0",))
    assert longer.is_complete and len(longer.real) == 2
    # An independent checker accepts the certificate, as read from its file.
    check(recorded(modes_certificate(longer)))
    # The chord between the angles of both modes is at most a factor times the square root
    # of 10^-digits. A factor of 30 is large enough for this four-bar.
    first_mode, second_mode = longer.angles()
    half_angles = [
        0.5 * (a.mid() - b.mid()) for a, b in zip(first_mode, second_mode, strict=True)
    ]
    largest_chord = max(2.0 * abs(angle.sin()) for angle in half_angles)
    assert 0 < largest_chord < 30 * 10.0 ** (-digits / 2)
    double = certify_modes(stretched("10"), ("0",))
    assert (
        not double.is_complete and double.completeness.guarantee is not Guarantee.CERTIFIED
    )


def test_a_platform_with_eight_real_modes_has_exactly_eight():
    """All eight complex modes of a 3-RRR platform with these arcs are real and distinct."""
    arcs = {"base": [82.0, 63.0], "platform": [108.0, 75.0]}
    arcs |= {"crank1": [87.0], "crank2": [106.0], "crank3": [72.0]}
    arcs |= {"coupler1": [98.0], "coupler2": [111.0], "coupler3": [95.0]}
    mechanism = sk.load("three_rrr").with_sizes(angle_unit="deg", arcs=arcs)
    modes = certify_modes(read_decimals(mechanism), ("-56", "122", "29"))
    assert modes.is_counted and len(modes.real) == modes.mode_bound == 8
    assert all(one.differs_from(two) for one, two in itertools.combinations(modes.real, 2))
    check(recorded(modes_certificate(modes)))


def kite():
    """A four-bar whose cranks' tips meet at 0, about which coupler and follower turn."""
    arcs = {"1": [60.0], "2": [60.0], "3": [50.0], "4": [50.0]}
    return read_decimals(sk.load("four_bar").with_sizes(angle_unit="deg", arcs=arcs))


@pytest.mark.slow
def test_a_curve_of_modes_at_one_input_is_a_cluster_and_beside_it_modes_are_certified():
    curve = certify_modes(kite(), ("0",))
    assert not curve.is_complete and not curve.real
    ((_, half),) = curve.clusters
    assert half[0] > 3.0
    check(recorded(modes_certificate(curve)))
    beside = certify_modes(kite(), ("0.0000001",))
    assert beside.is_complete and len(beside.real) == 2


@pytest.mark.slow
def test_the_checker_repeats_that_nothing_else_is_there():
    """The checker repeats the proof that no mode is outside the undecided box of a double
    one.
    """
    certificate = recorded(modes_certificate(certify_modes(stretched("10"), ("0",))))
    assert certificate["undecided_rad"] and not certificate["complete"]
    check(certificate)
    for change in (
        {"undecided_rad": [], "complete": True},
        {"complete": True},
        {"undecided_rad": [{"centre": [0.1], "half": [1e-3]}]},
        {"counted": True},
    ):
        refuse({**certificate, **change})


def test_the_command_prints_modes_and_writes_a_certificate(tmp_path, capsys):
    path = tmp_path / "modes.json"
    assert main(["certify", "three_rrr", "--at", "10,20,30", "-o", str(path)]) == 0
    printed = capsys.readouterr().out
    assert "Proven: there are exactly 2 assembly modes." in printed
    assert main(["certify", "three_rrr", "--at", "10,20,30", "--verbose"]) == 0
    assert "certified: 2 real of 8 complex modes" in capsys.readouterr().out
    check(json.loads(path.read_text(encoding="utf-8")))


def test_the_bounds_of_a_ball_of_which_nothing_is_known_are_zero_and_infinity():
    """`max` passes over NaN, so a NaN as a bound would be lost in the largest bound."""
    arb = flint_library().arb
    unknown = arb(1) / arb(0, 1)  # The divisor contains 0, so the centre is NaN.
    assert np.isnan(float(unknown))
    assert max(map(upper_magnitude, [arb(1), unknown])) == np.inf
    assert lower_magnitude(unknown) == 0.0
