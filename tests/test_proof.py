"""Certified assembly modes against elimination, and by a checker of their own."""

import copy
import itertools
import json
import random

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
from spherekit.proof.balls import centre_floats, exact_centres, upper_magnitude
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


def proven(name, pair, inputs, tolerance=0.0):
    mechanism = driven_at(sk.load(name), pair)
    return certify_modes(read_decimals(mechanism, tolerance=tolerance), inputs)


@pytest.mark.many
@pytest.mark.parametrize(("name", "pair", "inputs", "bound"), CASES)
def test_all_complex_modes_are_proven_and_the_real_ones_are_those_found(
    name, pair, inputs, bound
):
    modes = proven(name, pair, inputs)
    assert modes.mode_bound == bound == len(modes.roots) and modes.is_complete
    assert modes.completeness.guarantee is Guarantee.CERTIFIED
    mechanism = modes.decimal_mechanism.mechanism
    solver = PositionSolver(mechanism, plan_assembly(mechanism))
    found = enumerate_assemblies(solver, np.radians([float(value) for value in inputs]))
    assert len(found.values) == len(modes.real)
    balls = np.array(modes.angles())
    assert max(map(upper_magnitude, (balls - exact_centres(balls)).flat)) < 1e-15
    places = centre_floats(balls)
    for values in found.values:
        assert sum(np.max(np.abs(wrap(row - values))) < 1e-9 for row in places) == 1
    check(recorded(modes_certificate(modes)))


def test_every_pair_of_every_chain_can_drive_it_by_the_construction():
    for number in (1, 2, 4, 7, 10, 15):
        mechanism = sk.load(f"eight_bar_{number:02d}")
        for pair in mechanism.pairs:
            made = find_construction(extract_structure(driven_at(mechanism, pair.name)))
            assert (
                8 <= made.mode_bound <= 32
                and len(made.equation_steps) == made.unknown_count == 3
            )


def test_sizes_within_a_tolerance_have_the_modes_that_are_proven_for_all_of_them():
    modes = proven("four_bar", None, ("40",), 1e-6)
    assert modes.is_complete and len(modes.real) == 2
    balls = modes.angles()
    moves = random.Random(5)
    mechanism = modes.decimal_mechanism.mechanism
    for _ in range(5):
        moved = mechanism.with_sizes(
            angle_unit="rad",
            arcs={
                link: [arc + moves.uniform(-1e-6, 1e-6) for arc in sizes.arcs]
                for link, sizes in mechanism.geometry.links.items()
            },
        )
        for row in certify_modes(read_decimals(moved), ("40",)).angles():
            assert any(
                all(a.overlaps(b) for a, b in zip(row, each, strict=True)) for each in balls
            )


def tampered(certificate, moves):
    """Return a certificate changed so that what it says is not so, or not shown."""
    changed = copy.deepcopy(certificate)
    roots, text = changed["roots"], changed["mechanism"]
    root, step = moves.choice(roots), moves.choice(changed["construction"]["steps"])
    part = moves.choice(root["centre"])
    ((key, value),) = list(changed["inputs"].items())[:1]
    mantissa, exponent = part[0]
    shift = 1 << max(mantissa.bit_length() - moves.randrange(2, 30), 1)
    other = moves.choice([each for each in roots if each is not root])
    place = moves.choice([k for k in range(len(text)) if text.startswith("arcs = [", k)])
    by = step["by"][::-1] if len(step["by"]) == 2 else 2 * step["by"]
    off = 10.0 ** -moves.randrange(1, 9)
    owner, key, value = moves.choice(
        [
            (part, 0, [mantissa + shift, exponent]),
            (root, "real", not root["real"]),
            (changed, "roots", [each for each in roots if each is not root]),
            (changed, "bound", changed["bound"] + moves.choice((-1, 1, 8))),
            (changed, "modes", changed["modes"] + moves.choice((-1, 1, 2))),
            (roots, roots.index(root), copy.deepcopy(other)),
            (root, "radius", root["radius"] * 2.0 ** -moves.randrange(20, 60)),
            (changed["inputs"], key, repr(float(value) + off)),
            (step, "by", by),
            (changed, "mechanism", f"{text[: place + 8]}0.001{text[place + 9 :]}"),
        ]
    )
    owner[key] = value
    return changed


@pytest.mark.slow
def test_the_checker_refuses_a_hundred_tampered_certificates():
    moves = random.Random(17)
    whole = [
        recorded(modes_certificate(proven(*case)))
        for case in (
            ("four_bar", None, ("40",)),
            ("stephenson", "16", ("30",)),
            ("three_rrr", None, ("10", "20", "30")),
        )
    ]
    for number in range(100):
        changed = tampered(whole[number % 3], moves)
        assert changed not in whole
        refuse(changed)


def stretched(coupler):
    """A four-bar whose crank at 0 leaves 40 degrees to a follower of 30 and a coupler."""
    text = read_decimals(sk.load("four_bar")).document.text
    text = text.replace("arcs = [40.0]", "arcs = [30.0]")
    return decimal_mechanism(text.replace("arcs = [70.0]", f"arcs = [{coupler}]"))


@pytest.mark.many
@pytest.mark.parametrize("digits", (6, 12, 28))
def test_modes_however_close_are_told_apart_and_a_double_one_is_never_certified(digits):
    far = certify_modes(stretched("9." + "9" * digits), ("0",))
    assert far.is_complete and not far.real
    near = certify_modes(stretched("10." + "0" * digits + "1"), ("0",))
    assert near.is_complete and len(near.real) == 2
    check(recorded(modes_certificate(near)))
    half = [0.5 * (a.mid() - b.mid()) for a, b in zip(*near.angles(), strict=True)]
    assert 0 < max(2.0 * abs(each.sin()) for each in half) < 30 * 10.0 ** (-digits / 2)
    double = certify_modes(stretched("10"), ("0",))
    assert (
        not double.is_complete and double.completeness.guarantee is not Guarantee.CERTIFIED
    )


def test_a_platform_with_eight_real_modes_has_exactly_eight():
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
    whole = recorded(modes_certificate(certify_modes(stretched("10"), ("0",))))
    assert whole["undecided_rad"] and not whole["complete"]
    check(whole)
    for change in (
        {"undecided_rad": [], "complete": True},
        {"complete": True},
        {"undecided_rad": [{"centre": [0.1], "half": [1e-3]}]},
        {"counted": True},
    ):
        refuse({**whole, **change})


def test_the_command_prints_modes_and_writes_a_certificate(tmp_path, capsys):
    path = tmp_path / "modes.json"
    assert main(["certify", "three_rrr", "--at", "10,20,30", "-o", str(path)]) == 0
    said = capsys.readouterr().out
    assert "certified: 2 real of 8 complex modes" in said and said.count("mode ") == 2
    check(json.loads(path.read_text(encoding="utf-8")))
