"""Error bounds of coefficients and of the derivatives of directions, against 50 digits."""

import numpy as np
import pytest
from helpers.error_bound_checks import (
    KINDS,
    ErrorComparison,
    compare_errors_with_bounds,
    judge_bounds,
)
from helpers.refusals import HERE, mechanism_text
from mechanism_examples.special_mechanisms import special_mechanism, straight_mechanism

import spherekit as sk
from spherekit.cli.main import main
from spherekit.files.mechanism_reader import loads
from spherekit.positions.position_analysis import PositionAnalysis

BOUNDS = (
    "error_bound",
    "velocity_coefficient_error_bound",
    "acceleration_coefficient_error_bound",
    "direction_dq_error_bound",
)


def test_run_verifies_a_link_whose_arc_is_nearly_half_a_turn(capsys):
    """Link e hardly moves against A: an error of its pole axis turns a large change."""
    file = str(HERE / "files" / "bound_a.toml")
    assert main(["run", file, "--samples", "7", "--verify", "28", "--strict"]) == 3
    said = capsys.readouterr()
    assert "verify:" not in said.err
    assert said.out.count("lie within their error bound") == 4


def test_a_small_coefficient_with_a_large_derivative_has_a_bound_that_holds():
    result = sk.run(loads(mechanism_text("bound_a")), "poles", samples=7, verify=28)
    verdict = result.summary["verified"]
    for name in ("rates", "rate_derivatives", "direction_derivatives"):
        assert verdict[name]["count"] == verdict[name]["within_bound"] > 200
    # The case is there: the directions of some poles turn at 1e4 rad per rad.
    rows = result.frame()
    turned = np.linalg.norm(rows[["dux_dq", "duy_dq", "duz_dq"]], axis=1)
    assert np.nanmax(turned) > 1e4


LONG = pytest.param(range(100, 400), marks=pytest.mark.long)


@pytest.mark.slow
@pytest.mark.parametrize("seeds", [range(8), LONG])
def test_arcs_near_0_and_180_degrees_keep_to_their_bounds(seeds):
    """By the float64 numbers and by the decimal degrees, in 20 digits or 50."""
    judged = 0
    for seed in seeds:
        made, path = straight_mechanism(seed)
        judged += judge_bounds(made, path, as_written=True, every=50).numbers
    assert judged > 20 * len(seeds)


@pytest.mark.many
@pytest.mark.parametrize(
    ("names", "samples"),
    [(["four_bar"], 151), (["four_bar", "stephenson", "double_butterfly"], 13)],
)
def test_bounds_of_ordinary_mechanisms_are_not_grossly_wide(names, samples):
    """Medians over all errors above half a rounding; measured were 1e2 to 2e4."""
    found = ErrorComparison()
    for name in names:
        found.add(
            compare_errors_with_bounds(PositionAnalysis(sk.load(name), samples=samples))
        )
    for kind in KINDS[1:]:
        error, bound = found.errors_and_bounds(kind)
        seen = error > 1e-16
        assert np.sum(seen) > 500
        assert np.median(bound[seen] / error[seen]) < 1e5, kind


@pytest.mark.many
@pytest.mark.parametrize("inputs", [0.7, [0.7, 1.9, 3.3]])
@pytest.mark.parametrize("assembly_mode", [None, 0])
@pytest.mark.parametrize("name", ["four_bar", "stephenson", "shaped_cam"])
def test_evaluate_has_the_bounds_of_the_table(name, inputs, assembly_mode):
    made = sk.load(name)
    at = sk.evaluate(made, inputs, assembly_mode=assembly_mode)
    path = np.atleast_1d(inputs)[:, None]
    table = sk.run(made, "poles", path=path, assembly_mode=assembly_mode).frame()
    good = table[table["status"] == "OK"]
    assert len(good) == np.sum(at.status == 0) * len(at.poles) > 0
    names = good["link"].astype(str) + "/" + good["relative_to"].astype(str)
    for pole, rows in good.groupby(names):
        rows = rows.sort_values(["assembly_mode", "sample"])
        for bound in BOUNDS:
            given = getattr(at, bound)(pole)[at.status == 0]
            # One input is computed by other code than many; both bounds are of one size.
            np.testing.assert_allclose(given, rows[bound], rtol=0.5, atol=1e-13)
        turned = at.direction_dq(pole)[at.status == 0]
        np.testing.assert_allclose(turned, rows[["dux_dq", "duy_dq", "duz_dq"]], atol=1e-9)
    frame = at.frame()
    assert set(BOUNDS) <= set(frame.columns)
    assert np.all(frame.loc[frame["status"] == "OK", [*BOUNDS]].to_numpy() < 1e-7)


@pytest.mark.many
@pytest.mark.parametrize("seed", [0, 3, 5, 8, 11])
def test_derivatives_of_directions_are_within_bounds_beside_folds(seed):
    _, made, path = special_mechanism(seed)
    found = judge_bounds(made, path)
    assert len(found.errors_and_bounds("direction derivatives")[0]) > 20
