"""Random mechanisms against the velocity equations: no wrong value without a status."""

import numpy as np
import pytest
from helpers.analysis_runs import evaluate_poles_of_motion
from helpers.fuzz_checks import check_random_mechanisms
from mechanism_examples.random_mechanisms import FAMILIES, random_mechanism

from spherekit.planning.assembly_plan import plan_assembly
from spherekit.status import Status


@pytest.mark.slow
def test_no_wrong_value_without_a_status():
    tally = check_random_mechanisms(range(26))
    assert tally.wrong == [] and tally.mechanisms["evaluated"] >= 15
    assert tally.rows["OK"] >= 45 and tally.rows["AT_SINGULARITY"] >= 1
    assert tally.poles["OK"] >= 1000


@pytest.mark.long
@pytest.mark.parametrize("part", range(10))
def test_no_wrong_value_in_thousands(part):
    assert (
        check_random_mechanisms(range(100000 + 400 * part, 100400 + 400 * part)).wrong == []
    )


FOUND_ONCE = {
    282: "second rates lost their digits in the product with an inverse",
    **dict.fromkeys((2478, 2730, 3787), "a dyad without length was placed elsewhere"),
    1438: "a velocity that no motion goes on with, found OK",
    **dict.fromkeys((2425, 5143, 7454), "a link of 1e-14 rad was turned by rounding, OK"),
    **dict.fromkeys(
        (110346, 115714, 118701, 155342, 161281),
        "judged by a motion that its loops have to 4e-10 only",
    ),
    143157: "loops that agree to 1e-9 of the rates, which are above 1",
    144981: "a loose dyad that the input does not move, OK",
}


@pytest.mark.many
@pytest.mark.parametrize("seed", FOUND_ONCE)
def test_what_a_sweep_found_once(seed):
    assert check_random_mechanisms([seed]).wrong == []


def test_families_and_seeds_repeat():
    made = [random_mechanism(seed) for seed in range(20)]
    assert {family for family, _ in made} == set(FAMILIES)
    assert made == [random_mechanism(seed) for seed in range(20)]


def test_a_short_range_is_searched_too():
    """In a range below 1e-4 rad no input was probed, so no other mode was found."""
    family, made = random_mechanism(58)
    assert (family, made.inputs[0].stop) == ("triads", 1e-6)
    assert not plan_assembly(made).has_closed_form
    motion, field = evaluate_poles_of_motion(made, samples=3)
    assert len(motion.assembly_modes) > 1
    assert np.any(field.status == Status.OK)
