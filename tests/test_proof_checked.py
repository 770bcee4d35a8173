"""What the checker repeats of counts by systems and of maps of two inputs."""

import copy
import random

import pytest
from helpers.refusals import decimal_mechanism
from oracles.proof_checker import check, recorded, refuse

import spherekit as sk
from spherekit.proof.balls import working_precision
from spherekit.proof.certificate import (
    map_certificate,
    modes_certificate,
    wheels_certificate,
)
from spherekit.proof.certified_modes import certify_modes
from spherekit.proof.decimal_mechanism import read_decimals
from spherekit.proof.input_map import certify_input_map


@pytest.fixture(scope="module")
def by_systems():
    """Arcs of 90 degrees send 32 of the 64 complex modes of this mechanism to infinity."""
    modes = certify_modes(read_decimals(sk.load("two_dof_spm")), ("20.5", "17.3"))
    assert modes.systems and modes.is_complete and not modes.is_counted
    assert len(modes.real) == 16 and modes.undecided_boxes is None
    whole = recorded(modes_certificate(modes))
    check(whole)
    return whole


@pytest.fixture(scope="module")
def over_boxes():
    """A part of the inputs of a 5R that its type II curve goes through."""
    text = read_decimals(sk.load("five_bar")).document.text
    text = text.replace("from = 40.0\nto = 140.0", "from = 78.0\nto = 96.0")
    written = decimal_mechanism(text)
    ends = [written.input_range_text(item.pair) for item in written.mechanism.inputs]
    found = certify_input_map(written, ends, 0.08)
    assert {0, 1, 2} >= set(found.kind.tolist()) >= {0, 1}
    whole = recorded(map_certificate(found))
    check(whole)
    return whole


@pytest.mark.parametrize("name", ["bevel_pair", "planetary_bevel", "bevel_differential"])
def test_wheels_are_repeated_by_the_angular_velocities_of_rolling(name):
    written = read_decimals(sk.load(name))
    with working_precision(80):
        whole = recorded(wheels_certificate(written, written.follower_ratios()))
    check(whole)
    moves = random.Random(5)
    for _ in range(4):
        changed = copy.deepcopy(whole)
        row = moves.choice(changed["ratios"])
        if moves.random() < 0.3:
            changed["ratios"].remove(row)
        else:
            place = moves.randrange(len(row["ratios"]))
            row["ratios"][place] += moves.choice((-1, 1)) * 10.0 ** -moves.randrange(1, 8)
        refuse(changed)


@pytest.mark.slow
def test_a_map_with_two_systems_of_two_unknowns_each_is_repeated():
    written = read_decimals(sk.load("two_dof_spm"))
    found = certify_input_map(written, [("20", "20.01"), ("17", "17.01")])
    assert found.mode_shares == {16: 1.0}
    whole = recorded(map_certificate(found))
    check(whole)
    changed = copy.deepcopy(whole)
    changed["boxes"][0]["modes"] -= 2
    refuse(changed)
    changed = copy.deepcopy(whole)
    for start in changed["systems"][0]["solved"]:
        start["solutions"][0] = start["solutions"][1]
    refuse(changed)


def nudged(number, moves):
    return number + moves.choice((-1, 1)) * 10.0 ** -moves.uniform(1, 3)


def tampered_systems(changed, moves):
    parts = changed["systems"]
    solutions = moves.choice(moves.choice(parts)["solved"])["solutions"]
    kind = moves.randrange(7)
    if kind == 0:
        for entry in parts[0]["solved"]:
            del entry["solutions"][0]
    elif kind == 1:
        solutions[0] = copy.deepcopy(solutions[1])
    elif kind == 2:
        parts.remove(moves.choice(parts))
    elif kind == 3:
        parts[0]["equations"].append(parts[0]["equations"][0])
    elif kind == 4:
        changed["modes"] += moves.choice((-1, 1))
    elif kind == 5:
        changed["roots"].remove(next(each for each in changed["roots"] if each["real"]))
        changed["modes"] -= 1
    else:
        parts.reverse()


def tampered_map(changed, moves):
    boxes = changed["boxes"]
    box = moves.choice(boxes)
    regular = [each for each in boxes if each["is"] == "regular"]
    contains = [each for each in boxes if each["is"] == "contains type II"]
    kind, side = moves.randrange(7), moves.randrange(2)
    if kind == 0:
        moves.choice(regular)["modes"] += moves.choice((-2, 2))
    elif kind == 1:
        moves.choice(contains).update({"is": "regular", "modes": moves.choice((0, 2))})
    elif kind == 2:
        moves.choice(regular)["is"] = "contains type II"
    elif kind == 3:
        boxes.remove(box)
    elif kind == 4:
        box["half_rad"][side] *= moves.choice((0.9, 1.2))
    elif kind == 5:
        box["centre_rad"][side] = nudged(box["centre_rad"][side], moves)
    else:
        changed["shares"]["regular"] = nudged(changed["shares"]["regular"], moves)


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("count", [4, 40])
def test_the_checker_refuses_tampered_certificates(by_systems, over_boxes, count):
    moves = random.Random(4)
    for number in range(count):
        whole, change = (
            (by_systems, tampered_systems) if number % 2 else (over_boxes, tampered_map)
        )
        changed = copy.deepcopy(whole)
        change(changed, moves)
        assert changed != whole
        refuse(changed)
