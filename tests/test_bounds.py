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


def test_what_follows_from_rates_in_doubt_has_a_status(tmp_path):
    """Beside where a four-bar of right angles folds flat."""
    file = tmp_path / "special.toml"
    file.write_text(mechanism_text("special").format(90, 90, 90, 90) + MASSES)
    made = sk.load(file)
    path = np.pi - np.array([1e-1, 1e-2, 1e-4])
    frame = sk.run(made, "eksergian", path=path[:, None], assembly_mode=0).frame(
        "eksergian"
    )
    assert list(frame["status"]) == ["OK", "OK", "ILL_CONDITIONED"]
    assert np.isnan(frame["B"].iloc[-1]) and np.all(np.isfinite(frame["B"].iloc[:2]))


MASSES = """
[mass.3]
tensor = [[2.0, 0.0, 0.0], [0.0, 1.9, 0.0], [0.0, 0.0, 0.3]]
"""


LONG = pytest.param(range(12, 400), marks=pytest.mark.long)


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize("seeds", [range(7), range(7, 12), LONG])
def test_special_geometry_keeps_to_what_is_stated(seeds):
    """By the float64 numbers and by the decimal degrees, every number of every row."""
    judged, marked, worst = 0, 0, 0.0
    for seed in seeds:
        _, found = compare_special_mechanism(seed)
        for kind in KINDS:
            assert np.all(found.error_ratios(kind) <= 1.0), (seed, kind)
        assert found.silent == 0 and found.unknown == 0, seed
        judged += found.numbers
        marked += found.marked
        worst = max(worst, float(np.max(found.error_ratios("directions"), initial=0.0)))
    assert judged > 150 * len(seeds) and worst > 0.05
    assert marked < 0.6 * (judged / 6)  # of rows; far from folds none is marked


@pytest.mark.long
@pytest.mark.parametrize("name", sk.mechanisms())
def test_shipped_mechanisms_keep_to_what_is_stated(name):
    """All modes, against the closure equations in 18 digits, or 50 where these say no."""
    made = sk.load(name)
    grid = [3] * len(made.inputs) if len(made.inputs) > 1 else 13
    found = compare_errors_with_bounds(PositionAnalysis(made, search=False, samples=grid))
    assert found.silent == found.unknown == 0
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
    field = evaluate(tracer.motion(), request(made, made.inputs[0].pair, poles, poles))
    assert np.all(field.is_quad_precision)
    assert all(np.all(error > EPS) for error in field.direction_error.values())
