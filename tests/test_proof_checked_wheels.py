"""What the checker repeats of loops with wheels in mesh, and what it refuses."""

import copy

import pytest
from helpers.refusals import mechanism_text
from oracles.proof_checker import Refused, check, recorded, refuse
from test_proof_geared import PLANET, geared
from test_wheels import FIVE_BAR

from spherekit.proof.certificate import (
    curves_certificate,
    modes_certificate,
    singular_table,
)
from spherekit.proof.certified_modes import certify_modes
from spherekit.proof.certified_singularities import locate_singularities
from spherekit.proof.configuration_curves import certify_curves

WITHIN = FIVE_BAR + 'contact = "internal"\n'
TURNED = FIVE_BAR.replace('links = ["1", "5"]', 'links = ["5", "1"]')
BACKWARDS = FIVE_BAR.replace("inputs.left", "inputs.right")
POSED = mechanism_text("posed_geared_five_bar")


def certificate_of(teeth, ends, text=FIVE_BAR):
    curves = certify_curves(geared(teeth, text), ends)
    whole = curves_certificate(curves)
    whole["singularities"] = singular_table(locate_singularities(curves))
    assert whole["complete"] and whole["curves"] and len(whole["wheels"]) == 1
    return recorded(whole)


CASES = [
    ((40, 20), ("0", "360"), FIVE_BAR),
    ((20, 30), ("-100", "150"), FIVE_BAR),
    ((14, 21), ("100", "300"), PLANET),
    ((40, 20), ("0", "90"), WITHIN),
    ((20, 40), ("10", "200"), TURNED),
    ((20, 40), ("10", "200"), BACKWARDS),
    ((20, 40), ("0", "90"), POSED),
]


@pytest.mark.slow
@pytest.mark.many(slow=1)
@pytest.mark.parametrize(("teeth", "ends", "text"), CASES)
def test_curves_of_loops_with_wheels_are_repeated(teeth, ends, text):
    check(certificate_of(teeth, ends, text))


@pytest.mark.parametrize("text", [FIVE_BAR, PLANET, WITHIN, TURNED, POSED])
def test_modes_of_loops_with_wheels_are_repeated(text):
    """They are refused with an input that is not that of the roots."""
    modes = certify_modes(geared((20, 30), text), ("393.25",))
    whole = recorded(modes_certificate(modes))
    check(whole)
    (driven,) = whole["inputs"]
    whole["inputs"][driven] = "33.25"
    refuse(whole)


@pytest.fixture(scope="module")
def part_of_laps():
    whole = certificate_of((20, 40), ("400", "700.5"))
    assert len(whole["curves"]) == 2
    check(whole)
    return whole


CROSSING = {"centre": [0.0, 0.0], "limits": [0.1, 0.1], "is": "curves cross"}
CHANGES = {
    "a crossing": 'c["crossings"] = [CROSSING]',
    "at one input": 'c["curves"][0]["at_one_input"] = True',
    "other teeth": 'c["mechanism"] = c["mechanism"].replace("[20, 40]", "[20, 41]")',
    # 3 turns of a wheel for 2 of the input, of the file too, but not of the pieces
    "other teeth told too": (
        'c["mechanism"] = c["mechanism"].replace("[20, 40]", "[60, 40]")\n'
        'wheel["turns"], wheel["off"] = -3, 9e-15\n'
        'wheel["at_zero_rad"] *= 5.0 / 3.0'
    ),
    "within": 'c["mechanism"] += \'contact = "internal"\\n\'',
    "other turns": 'wheel["turns"] = 1',
    "other laps": 'c["input_turns_of_its_variable"] = 4; wheel["turns"] = -2',
    "no laps": 'c["input_turns_of_its_variable"] = 1',
    "other offset": 'wheel["at_zero_rad"] += 1e-12',
    "vague offset": 'wheel["off"] = 7.0',
    "other pair": 'wheel["pair"] = "54"',
    "no wheels": 'c["wheels"] = []',
    "nothing follows": 'c["construction"]["follow"] = []',
    "missing chain": 'del c["curves"][1]',
    "moved piece": 'c["curves"][0]["pieces"][5]["centre"][0] += 1e-6',
    "other range": 'c["inputs"]["left"] = ["300", "700.5"]',
    "more than all laps": 'c["inputs"]["left"] = ["400", "1121"]',
}


@pytest.mark.slow
@pytest.mark.many(slow=2)
@pytest.mark.parametrize("change", CHANGES)
def test_tampered_certificates_of_wheels_are_refused(part_of_laps, change):
    changed = copy.deepcopy(part_of_laps)
    wheel = changed["wheels"][0]
    exec(CHANGES[change], {"c": changed, "wheel": wheel, "CROSSING": CROSSING})
    assert changed != part_of_laps
    refuse(changed)


@pytest.mark.slow
def test_a_file_with_other_teeth_of_the_same_ratio_is_repeated(part_of_laps):
    changed = copy.deepcopy(part_of_laps)
    changed["mechanism"] = changed["mechanism"].replace("[20, 40]", "[17, 34]")
    check(changed)


def test_two_pairs_of_wheels_are_refused():
    """Which whole turns several wheels have rolled least with is not repeated."""
    changed = modes_certificate(certify_modes(geared((20, 40)), ("393.25",)))
    more = '[pairs.more]\ntype = "Cr"\nlinks = ["2", "5"]\nteeth = [20, 40]\n'
    changed["mechanism"] += more + 'axes = ["left", "right"]\n'
    with pytest.raises(Refused, match="more than one pair of wheels"):
        check(changed)
