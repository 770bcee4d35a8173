"""Bounds of directions, rates and derivatives, against digits where numbers are round."""

import numpy as np
import pytest
from helpers.error_bound_checks import (
    KINDS,
    compare_errors_with_bounds,
    compare_special_mechanism,
    evaluate,
)
from helpers.refusals import mechanism_text
from mechanism_examples.random_mechanisms import random_mechanism
from mechanism_examples.special_mechanisms import special_mechanism

import spherekit as sk
from spherekit.planning.pole_plan import all_poles
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.tolerances import EPS
from spherekit.velocities.pole_request import request


def test_inertia_that_follows_from_uncertain_rates_has_a_status(tmp_path):
    """A four-bar of right angles, 1e-1, 1e-2 and 1e-4 rad beside where it folds flat.

    At the last input the generalized inertia B is missing and its status says why.
    """
    file = tmp_path / "special.toml"
    file.write_text(mechanism_text("special").format(90, 90, 90, 90) + MASSES)
    path = np.pi - np.array([1e-1, 1e-2, 1e-4])
    run = sk.run(sk.load(file), "eksergian", path=path[:, None], assembly_mode=0)
    frame = run.frame("eksergian")
    assert list(frame["status"]) == ["OK", "OK", "ILL_CONDITIONED"]
    assert np.isnan(frame["B"].iloc[-1])
    assert np.all(np.isfinite(frame["B"].iloc[:2]))


MASSES = """
[mass.3]
tensor = [[2.0, 0.0, 0.0], [0.0, 1.9, 0.0], [0.0, 0.0, 0.3]]
"""


LONG = pytest.param(range(12, 400), marks=pytest.mark.long)


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("seeds", [range(7), range(7, 12), LONG])
def test_error_bounds_are_right_for_special_geometry(seeds):
    """Every number of every row with status OK is within its error bound.

    A row is one configuration with one of its inputs moving alone. There are two references
    in more digits: one for the float64 sizes of the mechanism, one for the decimal degrees
    of its file. Rows with another status are not compared. Special are right angles, equal
    arcs, and links that can lie in line.

    Bounds must not be useless either: the error of some direction is more than 5 % of its
    bound, and there is less than one row with another status for every ten poles compared.
    At least 150 poles per mechanism have to be compared. A pole is the axis of the relative
    rotation of two links.
    """
    pole_count = 0  # poles in all compared rows
    rows_not_ok = 0
    worst_ratio = 0.0  # largest error of a direction divided by its bound
    for seed in seeds:
        _, comparison = compare_special_mechanism(seed)
        for kind in KINDS:
            assert np.all(comparison.error_ratios(kind) <= 1.0), (seed, kind)
        assert comparison.missing_numbers == 0, seed
        assert comparison.rows_without_reference == 0, seed
        pole_count += comparison.pole_rows
        rows_not_ok += comparison.failed_rows
        ratios = comparison.error_ratios("directions")
        worst_ratio = max(worst_ratio, float(np.max(ratios, initial=0.0)))
    assert pole_count > 150 * len(seeds)
    assert worst_ratio > 0.05
    assert 10 * rows_not_ok < pole_count


@pytest.mark.long
@pytest.mark.parametrize("name", sk.mechanisms())
def test_shipped_mechanisms_keep_to_what_is_stated(name):
    """All modes, against the closure equations in 18 digits, or 50 where these say no."""
    made = sk.load(name)
    grid = [3] * len(made.inputs) if len(made.inputs) > 1 else 13
    found = compare_errors_with_bounds(PositionAnalysis(made, search=False, samples=grid))
    assert found.missing_numbers == found.rows_without_reference == 0
    for kind in KINDS:
        assert np.all(found.error_ratios(kind) <= 1.0), kind


def test_special_mechanisms_are_of_all_kinds():
    kinds = {special_mechanism(seed)[0] for seed in range(200)}
    assert len(kinds) == 21


def test_bounds_of_rows_in_quad_precision_are_those_of_rounding_at_least():
    """An axis of the ground counted as what changes when loops open, by its components."""
    made = random_mechanism(2)[1]
    tracer = PositionAnalysis(made, search=False, samples=3, assembly_mode=0)
    poles = all_poles(len(made.links))
    field = evaluate(
        tracer.motion(), request(made, made.inputs[0].pair, poles, rates=poles)
    )
    assert np.all(field.is_quad_precision)
    assert all(np.all(error > EPS) for error in field.direction_error.values())
