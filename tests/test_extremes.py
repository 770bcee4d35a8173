"""The extremes: errors within what conditioning allows, and a status beyond it."""

import mpmath as mp
import numpy as np
import pytest
from oracles.closed_forms import four_bar_angles, four_bar_coefficients

import spherekit as sk
from benchmarks import extremes
from benchmarks.__main__ import main
from benchmarks.extremes.reference import DIGITS, Reference, exact, length, truth
from benchmarks.extremes.registry import ALLOWED, ROUNDOFF, TRUSTED, Row
from benchmarks.extremes.shapes import four_bar, point_of
from spherekit.errors import ModelError

CASES = extremes.cases()
FAST = {
    *("four_bar_dead_centre", "change_point", "crank_without_length", "arc_of_the_coupler"),
    *("secondary_pole_at_the_edge", "poles_across_the_edge", "small_four_bar"),
    *("radii_almost_equal", "contact_almost_lost", "turns_of_the_four_bar"),
    *("dyads_on_dyads", "inertia_of_the_rocker", "energy_of_a_motion"),
    *("torque_of_a_huge_load", "torque_of_a_tiny_load", "loads_that_overflow"),
    "motion_under_a_huge_load",
}
"""Fast cases, of every family but the long runs. Other cases are marked `long`."""


@pytest.mark.many
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=() if name in FAST else pytest.mark.long)
        for name, case in CASES.items()
        if case.held
    ],
)
def test_errors_at_the_extremes_are_within_what_conditioning_allows(name):
    """No row has a larger error than its condition number explains, unless it says so.

    Every case must also have rows that are trusted, and a condition number in all rows.
    """
    rows = CASES[name].rows(quick=True)
    assert not [row for row in rows if row.wrong]
    assert any(row.trusted for row in rows)
    assert not any(np.isnan(row.conditioning) for row in rows)


def test_the_fast_cases_cover_every_family_but_the_long_runs():
    families = {case.family for case in CASES.values()}
    assert families - {CASES[name].family for name in FAST} == {"long runs"}


def test_a_row_is_wrong_if_its_error_exceeds_the_limit_without_a_status():
    """The limit is the condition number times `ALLOWED` roundings, up to `TRUSTED`.

    The arguments of a row are parameter, quantity, condition number, error and status.
    """
    limit = ALLOWED * ROUNDOFF
    assert not Row(1.0, "angles", 1e6, 0.9e6 * limit).wrong
    assert Row(1.0, "angles", 1e6, 1.1e6 * limit).wrong
    assert Row(1.0, "angles", 1e20, 1.1 * TRUSTED * limit).wrong
    assert Row(1.0, "angles", 1.0, np.nan).wrong
    assert not Row(1.0, "angles", 1e20, np.inf, "AT_SINGULARITY").wrong


def test_the_reference_refuses_profiles_that_it_does_not_know():
    """It knows circles and great circles; Fourier cams have another reference."""
    with pytest.raises(
        ModelError, match='link cam is "fourier".*spherekit.proof.reference_rows'
    ):
        Reference(sk.load("shaped_cam"))
    assert Reference(sk.load("flat_cam")).data.radii.shape[0] == 2


def test_the_reference_converts_floats_exactly():
    """The float 0.1 is larger than 1/10 by less than 1e-16 of it."""
    with mp.workdps(DIGITS):
        values = exact([0.1, 3.0])
        assert float(values[0]) == 0.1
        assert 0 < values[0] * 10 - 1 < 1e-16
        assert length(exact([[3.0, 4.0, 0.0]]))[0] == 5


def test_the_reference_of_a_four_bar_agrees_with_closed_forms():
    """The rocker angle and velocity in 90 digits are those of Di Gregorio's formulas.

    The reference of the benchmark (`truth`) has 90 digits; the formulas are evaluated in
    float64 at the same crank angle. They have two assembly modes, one of which must agree.
    """
    crank_angle = 0.7
    arcs = np.radians([60.0, 20.0, 70.0, 40.0])
    mechanism = four_bar(arcs)
    with mp.workdps(DIGITS):
        # `parameter` is a number for messages of the benchmark; any value will do here.
        reference, point = point_of(mechanism, parameter=0.0, q=crank_angle)
        # The pair variables (rad), for which the loops close in 90 digits.
        configuration = point.near
        exact_values = truth(reference, configuration)
        # Angular velocity (3,) of the rocker, link 4, per unit rate of the crank.
        rocker_velocity = exact_values.rates[mechanism.link_number["4"]].astype(float)
        rocker_angle = float(configuration[mechanism.variable_names.index("theta_41")])

    inputs = np.array([crank_angle])
    differences = []
    for mode in (0, 1):
        closed_form_angle = four_bar_angles(inputs, tuple(arcs), mode)[0]
        # The formulas measure the rocker angle from the opposite side, so pi is added.
        half_difference = 0.5 * (rocker_angle + np.pi - closed_form_angle)
        differences.append(abs(np.sin(half_difference)))
    mode = int(np.argmin(differences))
    assert differences[mode] < 1e-14
    _, coefficient = four_bar_coefficients(inputs, tuple(arcs), mode)
    # The rocker rotates about the z axis.
    assert abs(rocker_velocity[2] - coefficient[0]) < 1e-13


def test_condition_numbers_grow_towards_a_dead_centre_as_the_theory_says():
    """Near a dead centre (type II) that of angles grows as 1/distance, of rates squared.

    From 1e-2 to 1e-4 rad these are factors of 100 and 10000.
    """
    rows = list(CASES["four_bar_dead_centre"].sweep([1e-2, 1e-4]))
    conditioning = {(row.parameter, row.quantity): row.conditioning for row in rows}
    growth_of_angles = conditioning[1e-4, "angles"] / conditioning[1e-2, "angles"]
    growth_of_rates = conditioning[1e-4, "rates"] / conditioning[1e-2, "rates"]
    assert 50.0 < growth_of_angles < 200.0
    assert 5e3 < growth_of_rates < 2e4


def test_the_command_lists_all_cases(capsys):
    assert main(["--list"]) == 0
    assert "four_bar_dead_centre: Type II" in capsys.readouterr().out


def test_the_command_runs_a_single_case(capsys):
    assert main(["extremes", "--quick", "--only", "torque_of_a_huge_load"]) == 0
    out = capsys.readouterr().out
    assert "## Extremes: loads" in out
    assert "## Extremes: torque_of_a_huge_load" in out


def test_the_command_refuses_an_unknown_case(capsys):
    with pytest.raises(SystemExit):
        main(["extremes", "--only", "no_such_case"])
    assert "no case is named no_such_case" in capsys.readouterr().err
