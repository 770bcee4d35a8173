"""Configurations with more degrees of freedom than the motion are no assembly modes."""

import numpy as np
import pytest

import spherekit as sk
from spherekit.positions.additional_freedoms import has_additional_freedoms
from spherekit.positions.position_analysis import PositionAnalysis


@pytest.fixture(scope="module")
def miura_unit():
    """Return the position analysis of the Miura unit, with its reference mode only."""
    return PositionAnalysis(sk.load("miura_unit"), samples=3, search=False)


def make_configuration(position_analysis, fold_angles):
    """Return the variables (rad) of given fold angles by pair; all others are 0."""
    names = position_analysis.mechanism.variable_names
    values = np.zeros(len(names))
    for pair, angle in fold_angles.items():
        values[names.index(f"theta_{pair}")] = angle
    closure = position_analysis.solver.closure
    assert closure.linearise(values[None]).closure_residual[0] < 1e-12
    return values


@pytest.mark.parametrize("second_fold", [-np.pi, np.pi])
def test_a_sheet_whose_straight_lines_are_folded_flat_has_additional_freedoms(
    miura_unit, second_fold
):
    """The sheet is then a strip of three facets in three layers.

    Its two zigzag lines turn independently of each other.
    """
    fold_angles = dict.fromkeys(["h11", "h12", "h13"], np.pi)
    fold_angles |= dict.fromkeys(["h21", "h22", "h23"], second_fold)
    fold_angles |= {"z11": 0.7, "z21": -0.7, "z31": 0.7}
    fold_angles |= {"z12": 0.3, "z22": -0.3, "z32": 0.3}
    values = make_configuration(miura_unit, fold_angles)
    assert has_additional_freedoms(miura_unit.solver.closure, values)


def test_crossings_and_points_of_one_curve_have_no_additional_freedoms(miura_unit):
    """In the flat sheet several motions begin, but they exclude each other."""
    flat = make_configuration(miura_unit, {})
    closure = miura_unit.solver.closure
    assert miura_unit.solver.compute_mobility(flat) > 1
    assert not has_additional_freedoms(closure, flat)
    assert not has_additional_freedoms(closure, miura_unit.solver.reference)


def test_the_change_point_of_a_vertex_has_no_additional_freedoms():
    """Two curves cross in the flat state of a vertex of four creases."""
    position_analysis = PositionAnalysis(sk.load("flat_foldable_vertex"), samples=3)
    flat = make_configuration(position_analysis, {})
    assert position_analysis.solver.compute_mobility(flat) == 2
    assert not has_additional_freedoms(position_analysis.solver.closure, flat)


@pytest.mark.long
def test_additional_freedoms_are_counted_and_are_no_failed_checks():
    """All curves from the flat states of the Miura unit are followed or counted."""
    result = sk.run("miura_unit", "singularities", samples=9)
    assert len(result.summary["assembly_modes"]) == 6
    findings = result.summary["analyses"][0]["findings"]
    assert findings["checks_failed"] == []
    assert findings["configuration_curves"] == 6
    assert (
        "additional freedoms were found, which are no assembly modes"
        in (findings["guarantee"])
    )
