"""Loops with wheels over ranges: proven curves against a closed form of a geared five-bar.

The closed form is that of `test_wheels`: the second crank turns back by the ratio of teeth,
and two arcs close the loop where they reach over the gap between the tips, with two modes.
"""

import re

import numpy as np
import pytest
from helpers.refusals import decimal_mechanism, mechanism_text
from scipy.optimize import brentq
from test_wheels import FIVE_BAR, coupler_margin, right_crank_angle

from spherekit.cli.main import main
from spherekit.completeness import Guarantee
from spherekit.errors import PlanError
from spherekit.proof import certified_modes
from spherekit.proof.certificate import curves_certificate
from spherekit.proof.certified_modes import certify_modes
from spherekit.proof.certified_singularities import locate_singularities
from spherekit.proof.configuration_curves import certify_curves

PLANET = FIVE_BAR.replace('links = ["2", "5"]\nteeth', 'links = ["1", "3"]\nteeth')
PLANET = PLANET.replace('axes = ["left", "right"]\n', 'axes = ["left", "32"]\n')


def geared(teeth, text=FIVE_BAR):
    """Return a geared five-bar, exact in decimals, with these numbers of teeth."""
    return decimal_mechanism(text.format(*teeth, 0.0, 360.0))


def margin(q, teeth):
    """Return by how much two couplers reach over the gap of crank tips at inputs (deg).

    The five-bar can be assembled where it is positive, in two modes.
    """
    q = np.atleast_1d(np.asarray(q, dtype=float))
    return coupler_margin(q, right_crank_angle(q, teeth))


def dead_centres(low, high, teeth):
    """Return the inputs (deg) at which the couplers are in line, by the closed form."""
    grid = np.linspace(low, high, 40 * round((high - low) / 90.0) + 1)
    sign = np.sign(margin(grid, teeth))
    return [
        brentq(lambda q: margin(q, teeth)[0], grid[k], grid[k + 1], xtol=1e-12)
        for k in np.flatnonzero(sign[1:] != sign[:-1])
    ]


CASES = [
    ((40, 20), 1, ("0", "360")),
    ((20, 40), 2, ("-360", "360")),
    ((20, 40), 2, ("400", "700.5")),
    ((20, 20), 1, ("0", "360")),
    ((20, 30), 3, ("-100", "980")),
    ((17, 23), 23, ("3000", "3900")),
]


@pytest.mark.many
@pytest.mark.parametrize(("teeth", "laps", "ends"), CASES)
def test_modes_and_dead_centres_of_a_geared_five_bar_are_those_of_the_closed_form(
    teeth, laps, ends
):
    """Proven modes and dead centres of a geared five-bar are those of its closed form.

    A mode is a way to assemble the links; at a dead centre the input cannot go on. The
    couplers join the tips of the two cranks. The closed form `margin` says by how much they
    can span more than the arc between the tips. Dead centres are its zeros, and two modes
    exist where it is positive.

    `laps` is the number of turns of the input after which all wheels have come back. A
    range of so many turns is a full cycle. `ends` are the ends of the range of the input in
    degrees. They are decimal texts, since a proof is about exact decimal numbers.
    """
    curves = certify_curves(geared(teeth), ends)
    low, high = map(float, ends)
    assert curves.completeness.guarantee is Guarantee.CERTIFIED
    assert curves.cycle_turns == laps
    assert curves.is_full_cycle == (high - low == 360 * laps)

    expected_dead_centres = dead_centres(low, high, teeth)
    proven_dead_centres = np.degrees(curves.turning_points)
    assert len(expected_dead_centres) == len(proven_dead_centres)
    assert np.all(np.abs(proven_dead_centres - expected_dead_centres) < 1e-6)

    for first, last, count in curves.intervals:
        interior_inputs = np.degrees(np.linspace(first, last, 9)[1:-1])
        assert count in (0, 2)
        assert np.all((margin(interior_inputs, teeth) > 0) == (count == 2))
    proven_range = np.degrees([curves.intervals[0][0], curves.intervals[-1][1]])
    assert np.allclose(proven_range, [low, high], rtol=0, atol=1e-9)


@pytest.mark.many
@pytest.mark.parametrize(("teeth", "laps", "ends"), CASES)
def test_the_clearance_of_a_geared_five_bar_is_the_distance_to_a_dead_centre(
    teeth, laps, ends
):
    """The clearance of an input is its distance to the next singularity or end of range.

    `geared` makes a geared five-bar with these numbers of teeth. At a dead centre the input
    cannot go on. `dead_centres` computes dead centres by a closed form. The proven
    clearance may be up to 1e-5 deg less than the distance, but not more. `ends` are the
    ends of the range of the input in degrees.

    After a cycle of `laps` turns of the input, all configurations return. So two inputs are
    never farther apart than half a cycle. A range of a full cycle has no end.
    """
    curves = certify_curves(geared(teeth), ends)
    located = locate_singularities(curves)
    assert not located.undecided
    low, high = map(float, ends)
    expected_dead_centres = dead_centres(low, high, teeth)
    if len(expected_dead_centres) > 1:
        q = 0.5 * (expected_dead_centres[0] + expected_dead_centres[1])
    else:
        q = 0.5 * (low + high)

    cycle = 360.0 * laps
    distances = [0.5 * cycle]
    for dead_centre in expected_dead_centres:
        # The difference plus or minus whole cycles, between minus half and half a cycle.
        difference = (dead_centre - q + 0.5 * cycle) % cycle - 0.5 * cycle
        distances.append(abs(difference))
    if not curves.is_full_cycle:
        distances += [abs(low - q), abs(high - q)]
    clearance = np.degrees(located.clearance(np.radians(q)))
    assert 0 <= min(distances) - clearance < 1e-5


def test_wheels_are_told_to_come_back_or_refused():
    with pytest.raises(PlanError, match=r"longer than 2 turns, after which the motion"):
        certify_curves(geared((20, 40)), ("0", "721"))
    with pytest.raises(PlanError, match=r"drives right .* at most 64: give values"):
        certify_curves(geared((71, 67)), ("0", "10"))
    bare = FIVE_BAR.replace("teeth = [{0}, {1}]", "half_angles = [57.0]")
    with pytest.raises(PlanError, match=r"drives right .* numbers of teeth"):
        certify_curves(geared((20, 40), bare), ("0", "10"))


def test_certify_prints_the_ranges_between_dead_centres_of_a_geared_five_bar(
    tmp_path, capsys
):
    """The command prints how many modes there are before, between and after dead centres.

    A mode is a way to assemble the links. At a dead centre the input cannot go on.
    `dead_centres` computes the two dead centres of the range by a closed form. There are
    two modes before the first and after the second dead centre. Between the two dead
    centres the five-bar cannot be assembled.

    The two cranks are geared by wheels of 20 and 40 teeth. After two turns of the input
    crank the other crank has made one turn, so the motion repeats. The range from 0 to 720
    deg is these two turns.
    """
    path = tmp_path / "geared.toml"
    path.write_text(FIVE_BAR.format(20, 40, 0.0, 720.0), encoding="utf-8")
    assert main(["certify", str(path)]) == 0
    screen = capsys.readouterr().out
    assert "Proven: all assembly modes" in screen

    # Each row has the two ends (deg) of a range and the number of its assembly modes.
    rows = re.findall(r"^ +([\d.]+) +([\d.]+) +(\d)$", screen, re.M)
    printed = np.array(rows, dtype=float)
    first, second = dead_centres(0, 720, (20, 40))
    expected = [(0, first, 2), (first, second, 0), (second, 720, 2)]
    assert np.allclose(printed, expected, rtol=0, atol=1e-6)


def test_a_certificate_holds_the_turns_and_the_zero_of_a_wheel():
    """A certificate states the turns of a wheel, and its angle where the input is zero.

    A certificate is the file of a proof. The wheel at pair "right" has 40 teeth, that of
    the input has 20. So both come back after two turns of the input (0 to 720 deg), in
    which the driven wheel turns once backwards. The equations of the proof have half the
    input angle as their variable, so one turn of this variable is two turns of the input.
    The angle agrees with the closed form within the error bound that the certificate states
    ("off").
    """
    teeth = (20, 40)
    certificate = curves_certificate(certify_curves(geared(teeth), ("0", "720")))
    assert certificate["input_turns_of_its_variable"] == 2
    (wheel,) = certificate["wheels"]
    assert wheel["pair"] == "right"
    assert wheel["turns"] == -1  # in one turn of the variable
    expected = np.radians(right_crank_angle(0.0, teeth))
    error = abs(wheel["at_zero_rad"] - expected)
    assert error <= wheel["off"] + 1e-15 < 1e-14


@pytest.mark.slow
def test_a_planet_on_a_crank_has_the_modes_that_are_proven_at_inputs():
    """A wheel of the coupler rolls about one of the ground, which the crank carries."""
    written = geared((14, 21), PLANET)
    curves = certify_curves(written, ("0", "1080"))
    assert curves.completeness.guarantee is Guarantee.CERTIFIED and curves.cycle_turns == 3
    assert len(curves.turning_points) > 0
    counts = []
    for q in np.random.default_rng(2).uniform(0, 1080, 6):
        modes = certify_modes(written, (repr(float(q)),))
        assert modes.is_complete and len(modes.real) == curves.count_modes_at(np.radians(q))
        counts.append(len(modes.real))
    assert set(counts) == {0, 2}


def test_wheels_that_are_all_driven_are_refused():
    driven = FIVE_BAR + "[inputs.right]\n"
    with pytest.raises(PlanError, match="relate the inputs left, right to each other"):
        geared((20, 40), driven)


@pytest.mark.slow
def test_modes_that_a_wheel_has_within_a_tolerance_are_not_excluded(monkeypatch):
    """A wheel of 20 teeth turns 1000 times as far as an error of the other wheel of 20000.

    The input is 3e-5 deg beyond a dead centre, so that the file has no mode (way to
    assemble). Another mechanism, with an angle of the pose that differs by less than the
    tolerance, has two modes there.
    """
    monkeypatch.setattr(certified_modes, "MAX_MODE_BOXES", 1000)
    text = mechanism_text("posed_geared_five_bar").format(20000, 20, 0.0, 360.0)
    inputs = ("10.10243",)
    tolerance = 1e-6
    assert not certify_modes(decimal_mechanism(text), inputs).real

    changed_angle = "value = 20.50005"
    assert np.radians(20.50005 - 20.5) < tolerance
    changed = decimal_mechanism(text.replace("value = 20.5", changed_angle))
    assert len(certify_modes(changed, inputs).real) == 2

    modes = certify_modes(decimal_mechanism(text, tolerance), inputs)
    assert not modes.is_complete
