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
"""Cases of every family but the long runs; the others are tested with the long sweeps."""


@pytest.mark.many
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=() if name in FAST else pytest.mark.long)
        for name, case in CASES.items()
        if case.held
    ],
)
def test_errors_are_within_what_conditioning_allows(name):
    rows = CASES[name].rows(quick=True)
    assert not [row for row in rows if row.wrong]
    assert any(row.trusted for row in rows)
    assert not any(np.isnan(row.conditioning) for row in rows)


def test_a_row_is_wrong_only_if_it_stands_without_a_status():
    families = {case.family for case in CASES.values()}
    assert families - {CASES[name].family for name in FAST} == {"long runs"}
    limit = ALLOWED * ROUNDOFF
    assert not Row(1.0, "angles", 1e6, 0.9e6 * limit).wrong
    assert Row(1.0, "angles", 1e6, 1.1e6 * limit).wrong
    assert Row(1.0, "angles", 1e20, 1.1 * TRUSTED * limit).wrong
    assert Row(1.0, "angles", 1.0, np.nan).wrong
    assert not Row(1.0, "angles", 1e20, np.inf, "AT_SINGULARITY").wrong


def test_the_reference_agrees_with_closed_forms():
    """Angles and coefficients of the four-bar by Di Gregorio's formulas, in doubles."""
    arcs = np.radians([60.0, 20.0, 70.0, 40.0])
    made = four_bar(arcs)
    with pytest.raises(
        ModelError, match='link cam is "fourier".*spherekit.proof.reference_rows'
    ):
        Reference(sk.load("shaped_cam"))
    assert Reference(sk.load("flat_cam")).data.radii.shape[0] == 2
    with mp.workdps(DIGITS):
        values = exact([0.1, 3.0])
        assert float(values[0]) == 0.1 and 0 < values[0] * 10 - 1 < 1e-16
        assert length(exact([[3.0, 4.0, 0.0]]))[0] == 5
    reference, point = point_of(made, 0.0, 0.7)
    known = truth(reference, point.near)
    rocker = known.rates[made.link_number["4"]].astype(float)
    angle = float(point.near[made.variable_names.index("theta_41")])
    found = [
        (four_bar_angles(np.array([0.7]), tuple(arcs), mode)[0], mode) for mode in (0, 1)
    ]
    gaps = [abs(np.sin(0.5 * (angle + np.pi - theta))) for theta, _ in found]
    mode = int(np.argmin(gaps))
    assert gaps[mode] < 1e-14
    _, coefficient = four_bar_coefficients(np.array([0.7]), tuple(arcs), mode)
    assert abs(rocker[2] - coefficient[0]) < 1e-13


def test_conditioning_is_that_of_a_change_of_the_data():
    """Near a dead centre of type II angles go as one over the distance, rates squared."""
    rows = list(CASES["four_bar_dead_centre"].sweep([1e-2, 1e-4]))
    by = {(row.parameter, row.quantity): row.conditioning for row in rows}
    assert 50.0 < by[1e-4, "angles"] / by[1e-2, "angles"] < 200.0
    assert 5e3 < by[1e-4, "rates"] / by[1e-2, "rates"] < 2e4


def test_cases_can_be_listed_and_run_alone(capsys):
    assert main(["--list"]) == 0
    assert "four_bar_dead_centre: Type II" in capsys.readouterr().out
    assert main(["extremes", "--quick", "--only", "torque_of_a_huge_load"]) == 0
    out = capsys.readouterr().out
    assert "## Extremes: loads" in out and "## Extremes: torque_of_a_huge_load" in out
    with pytest.raises(SystemExit):
        main(["extremes", "--only", "no_such_case"])
    assert "no case is named no_such_case" in capsys.readouterr().err
