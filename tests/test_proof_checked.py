"""What the checker repeats of counts by systems and of maps of two inputs."""

import copy
import random

import pytest
from helpers.refusals import decimal_mechanism, mechanism_text
from mechanism_examples.wide_five_bar import wide_five_bar_text
from oracles.proof_checker import Sizes, check, recorded, refuse

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
    """Return a certificate of modes that are proven by systems of equations.

    Arcs of 90 degrees send 32 of the 64 complex modes of this mechanism to infinity, so
    counting roots of one eliminant does not prove them.
    """
    modes = certify_modes(read_decimals(sk.load("two_dof_spm")), ("20.5", "17.3"))
    assert modes.systems and modes.is_complete and not modes.is_counted
    assert len(modes.real) == 16 and modes.undecided_boxes is None
    certificate = recorded(modes_certificate(modes))
    check(certificate)
    return certificate


@pytest.fixture(scope="module")
def map_of_five_bar():
    """Return a certificate of the map of both inputs of a spherical five-bar.

    A certificate is the file of a proof. The checker, an independent program, repeats the
    proof; a test falsifies this certificate. A map divides the ranges of two inputs into
    boxes. In a regular box (kind 0) the number of assembly modes (ways to assemble the
    links) is proven to be constant. Other boxes contain a singularity of type II (1), at
    which locked inputs do not hold the output, or are undecided (2). The singularities form
    a curve, which crosses the ranges of this map.
    """
    text = wide_five_bar_text().replace("from = 40.0\nto = 140.0", "from = 78.0\nto = 96.0")
    exact_mechanism = decimal_mechanism(text)
    # The ranges of both inputs.
    ranges = [
        exact_mechanism.input_range_text(item.pair)
        for item in exact_mechanism.mechanism.inputs
    ]
    input_map = certify_input_map(exact_mechanism, ranges, cell=0.08)  # smallest boxes, rad
    # There are regular and singular boxes, and perhaps undecided ones.
    assert {0, 1, 2} >= set(input_map.kind.tolist()) >= {0, 1}
    # As it is read from its JSON file.
    certificate = recorded(map_certificate(input_map))
    check(certificate)
    return certificate


@pytest.mark.parametrize("link", ["2", "4"])
def test_the_checker_widens_radii_of_all_circles_by_the_tolerance(link):
    """The centre of the circle on link 4 is on the axis of a pair, the other is not."""
    text = mechanism_text("pinned_roller").replace("roller = 12.0", "radius = 12.0")
    tolerance = 1e-6
    _, exact = Sizes(text, 0.0, wheels=True).circle("touch", link)
    _, radius = Sizes(text, tolerance, wheels=True).circle("touch", link)
    assert radius.contains(exact)
    for sign in (1, -1):
        assert radius.contains(exact + sign * 0.999 * tolerance)
        assert not radius.contains(exact + sign * 1.001 * tolerance)


TOUCHING_CONES = """
format = 1
name = "cones"
angle_unit = "deg"
ground = "base"
[links]
base = {{ axes = ["first", "second"], arcs = [{arc}] }}
small = {{ axes = ["first"] }}
large = {{ axes = ["second"] }}
[pairs]
first = {{ type = "R", links = ["base", "small"] }}
second = {{ type = "R", links = ["base", "large"] }}
[pairs.mesh]
type = "Cr"
links = ["small", "large"]
axes = ["first", "second"]
contact = "{contact}"
half_angles = [20, 50]
[inputs.first]
from = 0
to = 360
"""
"""Two cones with half angles of 20 and 50 deg, whose axes are `arc` (deg) apart."""


@pytest.mark.parametrize(("contact", "arc"), [("external", 20 + 50), ("internal", 50 - 20)])
def test_the_checker_reads_half_angles_of_cones(contact, arc):
    """The stated ratio is that of the sines of both half angles.

    Certificates of spherekit contain the circles of the cones in place of the half angles.
    Here the text of the original file is put into the certificate.
    """
    text = TOUCHING_CONES.format(contact=contact, arc=arc)
    exact_mechanism = decimal_mechanism(text)
    with working_precision(80):  # decimal digits
        ratios = exact_mechanism.follower_ratios()
        certificate = recorded(wheels_certificate(exact_mechanism, ratios))
    check({**certificate, "mechanism": text})


@pytest.mark.parametrize("name", ["bevel_pair", "planetary_bevel", "bevel_differential"])
def test_the_checker_accepts_ratios_of_wheels_and_refuses_changed_ones(name):
    """The independent checker accepts the speed ratios of wheels, but no changed ratios.

    The checker computes them from the condition of rolling: both wheels have the same
    velocity at their line of contact. The certificate (file of a proof) has a row for each
    pair that wheels drive, with the ratios of its rate to the rates of all inputs. In each
    of four changed copies, a row is missing or one ratio is off by 1e-7 to 0.1. `refuse`
    fails unless the checker refuses a copy.
    """
    exact_mechanism = read_decimals(sk.load(name))
    with working_precision(80):  # decimal digits
        ratios = exact_mechanism.follower_ratios()
        # As it is read from its JSON file.
        certificate = recorded(wheels_certificate(exact_mechanism, ratios))
    check(certificate)

    random_choice = random.Random(5)
    for _ in range(4):
        changed = copy.deepcopy(certificate)
        row = random_choice.choice(changed["ratios"])
        if random_choice.random() < 0.3:
            changed["ratios"].remove(row)
        else:
            index = random_choice.randrange(len(row["ratios"]))
            sign = random_choice.choice((-1, 1))
            row["ratios"][index] += sign * 10.0 ** -random_choice.randrange(1, 8)
        refuse(changed)


@pytest.mark.slow
def test_the_checker_refuses_a_map_with_a_wrong_count_or_a_repeated_solution():
    """The checker refuses a falsified certificate of the map of a small box of inputs.

    A map states the number of assembly modes (ways to assemble the links) over boxes of two
    inputs; here it is 16 everywhere. The four loop equations are solved two by two
    (`"systems"`): first two of them, then the others for each solution of the first. For
    each system the certificate lists all complex solutions at some inputs. The checker
    follows them from these inputs to other ones. `check` accepts the true certificate;
    `refuse` fails unless a copy is refused.
    """
    exact_mechanism = read_decimals(sk.load("two_dof_spm"))
    input_map = certify_input_map(exact_mechanism, [("20", "20.01"), ("17", "17.01")])
    # 16 modes over the whole area (share 1).
    assert input_map.mode_shares == {16: 1.0}
    # As it is read from its JSON file.
    certificate = recorded(map_certificate(input_map))
    check(certificate)

    with_fewer_modes = copy.deepcopy(certificate)
    with_fewer_modes["boxes"][0]["modes"] -= 2
    refuse(with_fewer_modes)

    with_repeated_solution = copy.deepcopy(certificate)
    first_system = with_repeated_solution["systems"][0]
    # A system is solved for one or several choices of the inputs.
    for system_solution in first_system["solved"]:
        system_solution["solutions"][0] = system_solution["solutions"][1]
    refuse(with_repeated_solution)


def nudged(number, random_choice):
    """Return a number that is changed by 0.001 to 0.1, up or down."""
    return number + random_choice.choice((-1, 1)) * 10.0 ** -random_choice.uniform(1, 3)


def tamper_with_systems(certificate, random_choice):
    """Falsify a certificate that counts assembly modes, in one of seven ways, in place.

    Tests check that such a certificate is refused.

    Parameters
    ----------
    certificate
        Dictionary of a file of a proof. "systems" are the systems of equations, which are
        solved one after another. A system is solved once for each solution of the systems
        before it. "solved" lists these cases, each with its "solutions". "roots" are the
        complex modes, and "modes" is the number of real modes.
    random_choice
        `random.Random`, which selects the falsification and the entry.
    """
    systems = certificate["systems"]
    system = random_choice.choice(systems)
    solutions = random_choice.choice(system["solved"])["solutions"]
    falsification = random_choice.randrange(7)
    if falsification == 0:  # in each case of the first system a solution is missing
        for case in systems[0]["solved"]:
            del case["solutions"][0]
    elif falsification == 1:  # a solution is listed twice, another one is missing
        solutions[0] = copy.deepcopy(solutions[1])
    elif falsification == 2:  # a system is missing
        systems.remove(random_choice.choice(systems))
    elif falsification == 3:  # an equation is listed twice
        systems[0]["equations"].append(systems[0]["equations"][0])
    elif falsification == 4:  # the number of modes is wrong
        certificate["modes"] += random_choice.choice((-1, 1))
    elif falsification == 5:  # a real mode is missing, and the number agrees with that
        real_roots = [root for root in certificate["roots"] if root["real"]]
        certificate["roots"].remove(real_roots[0])
        certificate["modes"] -= 1
    else:  # systems are not in the order in which they are solved
        systems.reverse()


def tamper_with_map(certificate, random_choice):
    """Falsify a certificate of a map of two inputs, in one of seven ways, in place.

    A map divides the ranges of both inputs into boxes. A box "is" regular, with a number of
    assembly modes, or contains singularities of type II. Tests check that such a
    certificate is refused.

    Parameters
    ----------
    certificate
        Dictionary of a file of a proof. A box has a centre and half widths (rad, one for
        each input).
    random_choice
        `random.Random`, which selects the falsification and the box.
    """
    boxes = certificate["boxes"]
    box = random_choice.choice(boxes)
    regular_boxes = [box for box in boxes if box["is"] == "regular"]
    singular_boxes = [box for box in boxes if box["is"] == "contains type II"]
    falsification = random_choice.randrange(7)
    side = random_choice.randrange(2)
    if falsification == 0:  # a number of modes is wrong (it is even in every regular box)
        random_choice.choice(regular_boxes)["modes"] += random_choice.choice((-2, 2))
    elif falsification == 1:  # a singular box is called regular
        singular_box = random_choice.choice(singular_boxes)
        singular_box.update({"is": "regular", "modes": random_choice.choice((0, 2))})
    elif falsification == 2:  # a regular box is called singular
        random_choice.choice(regular_boxes)["is"] = "contains type II"
    elif falsification == 3:  # a part of the inputs is not covered
        boxes.remove(box)
    elif falsification == 4:  # boxes overlap, or leave a gap
        box["half_rad"][side] *= random_choice.choice((0.9, 1.2))
    elif falsification == 5:  # a box is shifted by 0.001 to 0.1 rad
        box["centre_rad"][side] = nudged(box["centre_rad"][side], random_choice)
    else:  # the stated share of inputs that are regular is wrong
        shares = certificate["shares"]
        shares["regular"] = nudged(shares["regular"], random_choice)


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("count", [4, 40])
def test_the_checker_refuses_tampered_certificates(by_systems, map_of_five_bar, count):
    """Each of `count` random falsifications, of both certificates in turn, is refused."""
    random_choice = random.Random(4)
    for number in range(count):
        if number % 2:
            certificate = by_systems
            falsify = tamper_with_systems
        else:
            certificate = map_of_five_bar
            falsify = tamper_with_map
        changed = copy.deepcopy(certificate)
        falsify(changed, random_choice)
        assert changed != certificate
        refuse(changed)
