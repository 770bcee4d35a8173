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
from spherekit.files.library import find
from spherekit.files.mechanism_reader import loads
from spherekit.planning.pole_plan import all_poles
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.tolerances import EPS
from spherekit.velocities.pole_request import request
from spherekit.velocities.row_kernel import row_kernel

BOUNDS = (
    "error_bound",
    "velocity_coefficient_error_bound",
    "acceleration_coefficient_error_bound",
    "direction_dq_error_bound",
)


def test_run_verifies_a_link_whose_arc_is_nearly_half_a_turn(capsys):
    """All four kinds of error keep to their bounds in a badly conditioned mechanism.

    Link e hardly moves against link A, so a small error of its pole axis changes much.
    With --strict the exit status is 3, since not all rows are OK.
    """
    path = str(HERE / "files" / "bound_a.toml")
    assert main(["run", path, "--samples", "7", "--verify", "28", "--strict"]) == 3
    printed = capsys.readouterr()
    assert "verify:" not in printed.err
    assert printed.out.count("are within their error bound") == 4


def test_errors_keep_to_their_bounds_where_pole_directions_turn_fast():
    """`verify` recomputes rows in 50 digits and counts the errors within their bounds."""
    result = sk.run(loads(mechanism_text("bound_a")), "poles", samples=7, verify=28)
    verified = result.summary["verified"]
    for name in ("rates", "rate_derivatives", "direction_derivatives"):
        assert verified[name]["count"] == verified[name]["within_bound"] > 200
    # The mechanism has the difficult case: a pole direction turns by 1e4 rad per rad.
    rows = result.frame()
    turning_rate = np.linalg.norm(rows[["dux_dq", "duy_dq", "duz_dq"]], axis=1)
    assert np.nanmax(turning_rate) > 1e4


LONG = pytest.param(range(100, 400), marks=pytest.mark.long)


@pytest.mark.slow
@pytest.mark.parametrize("seeds", [range(8), LONG])
def test_errors_of_mechanisms_with_arcs_near_0_and_180_degrees_keep_to_their_bounds(seeds):
    """The exact values are those of the float64 sizes and of the decimal degrees.

    They are computed in 20 or 50 digits. More than 20 numbers per mechanism are judged.
    """
    judged_numbers = 0
    for seed in seeds:
        mechanism, path = straight_mechanism(seed)
        comparison = judge_bounds(mechanism, path, as_written=True, every=50)
        judged_numbers += comparison.pole_rows
    assert judged_numbers > 20 * len(seeds)


@pytest.mark.many
@pytest.mark.parametrize(
    ("names", "samples"),
    [(["four_bar"], 151), (["four_bar", "stephenson", "double_butterfly"], 13)],
)
def test_bounds_of_ordinary_mechanisms_are_at_most_1e5_times_the_error(names, samples):
    """The limit applies to the median of bound / error, which was between 1e2 and 2e4.

    Errors up to half a rounding (1e-16) are left out, since they are small by chance.
    """
    comparison = ErrorComparison()
    for name in names:
        position_analysis = PositionAnalysis(sk.load(name), samples=samples)
        comparison.add(compare_errors_with_bounds(position_analysis))
    for kind in KINDS[1:]:
        error, bound = comparison.errors_and_bounds(kind)
        is_measurable = error > 1e-16
        assert np.sum(is_measurable) > 500
        assert np.median(bound[is_measurable] / error[is_measurable]) < 1e5, kind


@pytest.mark.many
@pytest.mark.parametrize("inputs", [0.7, [0.7, 1.9, 3.3]])
@pytest.mark.parametrize("assembly_mode", [None, 0])
@pytest.mark.parametrize("name", ["four_bar", "stephenson", "shaped_cam"])
def test_evaluate_gives_the_error_bounds_of_the_table_of_poles(name, inputs, assembly_mode):
    """`sk.evaluate` has the same error bounds as the table of poles of a run.

    A pole is the axis of the relative rotation of two links. `inputs` is one value of the
    input or three values (rad). Rows with the status OK (0) are compared, of one assembly
    mode or of all (None).
    """
    mechanism = sk.load(name)
    evaluation = sk.evaluate(mechanism, inputs, assembly_mode=assembly_mode)
    is_ok = evaluation.status == 0
    path = np.atleast_1d(inputs)[:, None]
    table = sk.run(mechanism, "poles", path=path, assembly_mode=assembly_mode).frame()
    ok_rows = table[table["status"] == "OK"]
    assert len(ok_rows) == np.sum(is_ok) * len(evaluation.poles) > 0

    pole_names = ok_rows["link"].astype(str) + "/" + ok_rows["relative_to"].astype(str)
    for pole, rows in ok_rows.groupby(pole_names):
        rows = rows.sort_values(["assembly_mode", "sample"])
        for bound_name in BOUNDS:
            bound = getattr(evaluation, bound_name)(pole)[is_ok]
            # A single row is computed by other code than several rows. Its rounding errors
            # differ, and the bounds depend on them. So bounds agree only in size.
            np.testing.assert_allclose(bound, rows[bound_name], rtol=0.5, atol=1e-13)
        direction_dq = evaluation.direction_dq(pole)[is_ok]
        np.testing.assert_allclose(
            direction_dq, rows[["dux_dq", "duy_dq", "duz_dq"]], atol=1e-9
        )

    frame = evaluation.frame()
    assert set(BOUNDS) <= set(frame.columns)
    # The largest bound is about 1e-10, in the six-bar "stephenson".
    assert np.all(frame.loc[frame["status"] == "OK", [*BOUNDS]].to_numpy() < 1e-7)


@pytest.mark.many
@pytest.mark.parametrize("seed", [0, 3, 5, 8, 11])
def test_derivatives_of_directions_are_within_bounds_beside_folds(seed):
    """Near a fold, where two assembly modes meet, directions change ever faster."""
    _, mechanism, path = special_mechanism(seed)
    comparison = judge_bounds(mechanism, path)
    errors, _ = comparison.errors_and_bounds("direction derivatives")
    assert len(errors) > 20


def test_errors_of_orientations_include_how_far_a_rolled_length_turns_a_small_wheel():
    """The bound of orientation errors counts how far a small wheel turns per rolled length.

    A small wheel rolls on a large one. One variable of the mechanism is the arc length by
    which it has rolled. `configuration_error` bounds the errors of all variables, and
    `orientation_error` those of link orientations. Each variable is changed alone by 1e-6
    rad. No link may turn by more than this change times the ratio of the two bounds.
    """
    position_analysis = PositionAnalysis(loads(mechanism_text("small_planet")), samples=3)
    motion = position_analysis.motion()
    ratio = motion.orientation_error / motion.configuration_error
    largest_turn = np.zeros(len(motion))
    for variable in range(motion.values.shape[1]):
        values = motion.values.copy()
        values[:, variable] += 1e-6
        change = position_analysis.given(values).rotations - motion.rotations
        turns = np.linalg.norm(change, axis=(2, 3)) / np.sqrt(2.0) / 1e-6
        largest_turn = np.maximum(largest_turn, np.max(turns, axis=1))
    # Per unit of rolled length, the small wheel turns by the cotangents of the half angles
    # of both pitch cones, added up. The half angles are 2 and 60 degrees.
    expected = 1.0 / np.tan(np.radians(2.0)) + 1.0 / np.tan(np.radians(60.0))
    assert np.allclose(largest_turn, expected, rtol=1e-4)
    assert np.all(largest_turn <= ratio * (1.0 + 1e-4))


@pytest.mark.slow
def test_bounds_of_configurations_in_large_runs_count_every_axis_of_a_loop():
    """The largest bound in the summary includes the rounding of a loop about three axes.

    A loop with m variables can be open by (2 + m) EPS about each axis. In runs with many
    rows, the bounds are computed by other code than in short ones.
    """
    mechanism = sk.load("four_bar")
    motion = PositionAnalysis(mechanism, samples=9).motion()
    passive_jacobians = motion.linearisation.jacobian[:, :, list(motion.passive_variables)]
    inverse_norms = np.linalg.norm(np.linalg.inv(passive_jacobians), axis=(1, 2))
    opening = np.sqrt(3.0) * (2.0 + 4.0) * EPS  # m = 4
    summary = sk.run(mechanism, "poles", samples=8193).summary
    assert summary["errors_reached"]["fraction_by_kernel"] == 1.0
    largest_bound = summary["errors_reached"]["largest_configuration_error_rad"]
    assert largest_bound >= 2.0 * EPS + np.max(inverse_norms) * opening


def rippled_cam():
    """Return a cam whose curvature changes fast along its profile, with a large roller."""
    text = find("shaped_cam").read_text(encoding="utf-8")
    ripples = [25.0, *[0.0] * 11, 0.3]
    for old, new in (
        ("cosines = [25.0, 4.0, 3.0]", f"cosines = {ripples}"),
        ("sines = [0.0, 0.0, 1.0]", "sines = [0.0]"),
        ("roller = 12.0", "roller = 20.0"),
        ("to = 360.0", "to = 20.0"),
    ):
        assert old in text
        text = text.replace(old, new)
    return loads(text)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["twelve_bar", "rippled cam"])
def test_kantorovich_numbers_include_all_second_derivatives_of_the_loops(name):
    """Kantorovich numbers are not too small, so that error bounds from them are safe.

    If the Kantorovich number h of a row is at most 1/2, exactly one closed configuration is
    near that of the row. h must be at least |F''| |J^+|^2 |F|. F are the equations of all
    loops, and J is their Jacobian for the passive variables.

    - |F|: rounding opens each loop by up to (2 + m) EPS about each of three axes, if the
      longest loop has m variables.
    - |F''|: J is differentiated by finite differences, with respect to one variable after
      the other. The largest norm of these derivatives is a lower limit of |F''|.
    """
    mechanism = rippled_cam() if name == "rippled cam" else sk.load(name)
    position_analysis = PositionAnalysis(mechanism, samples=13)
    motion = position_analysis.motion()
    motion = motion.rows(np.flatnonzero(~motion.failed))
    (driven,) = mechanism.inputs
    poles = all_poles(len(mechanism.links))
    kernel = row_kernel(motion, [request(mechanism, driven.pair, poles)], "numpy")
    bounds = kernel.row_bounds(motion.values.T)
    (numbers,) = bounds[kernel.row_bounds.slices["kantorovich_number"]]

    passive = list(kernel.passive_variables)
    closure = position_analysis.solver.closure
    step = 1e-6
    second_derivative = np.zeros(len(motion))
    for variable in passive:
        shift = step * np.eye(motion.values.shape[1])[variable]
        after = closure.linearise(motion.values + shift).jacobian
        before = closure.linearise(motion.values - shift).jacobian
        change = (after - before)[:, :, passive] / (2.0 * step)
        norms = np.linalg.norm(change, ord=2, axis=(1, 2))
        second_derivative = np.maximum(second_derivative, norms)
    tree = motion.linearisation.tree
    opening = np.sqrt(3.0 * tree.loop_count) * (2.0 + tree.longest_loop) * EPS
    inverses = np.linalg.pinv(motion.linearisation.jacobian[:, :, passive])
    inverse_norms = np.linalg.norm(inverses, axis=(1, 2))
    assert np.all(numbers >= second_derivative * inverse_norms**2 * opening)
