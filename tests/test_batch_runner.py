"""Rows that a kernel gives all at once are those that are found one by one with care."""

import pickle
from contextlib import suppress

import numpy as np
import pytest
from helpers.kernel_comparison import evaluate_both_ways, find_differences
from helpers.refusals import mechanism_text
from mechanism_examples.random_mechanisms import random_mechanism, shaped_mechanism
from mechanism_examples.special_mechanisms import special_mechanism
from mechanism_examples.wide_five_bar import wide_five_bar

import spherekit as sk
from benchmarks.harness import list_own_mechanisms
from spherekit.errors import SpherekitError
from spherekit.files.library import find
from spherekit.files.mechanism_reader import loads
from spherekit.files.study import Study
from spherekit.numerics.lazy_columns import LazyColumn
from spherekit.planning.pole_plan import all_poles
from spherekit.runs import batch_runner, prefetch
from spherekit.runs.kernel_columns import LazyField
from spherekit.runs.sampling import make_sampling
from spherekit.status import Status
from spherekit.symbolic.compiler import available
from spherekit.velocities.direction_signs import continue_signs
from spherekit.velocities.pole_evaluation import evaluate
from spherekit.velocities.pole_request import request

LONG_SEARCHES = {7, 15}
"""Seeds of chains that cannot move, which takes seconds to find out."""
SLOW = {"twelve_bar", "stephenson_output"}


@pytest.fixture(autouse=True)
def _from_the_first_row(monkeypatch):
    monkeypatch.setattr(batch_runner, "MIN_KERNEL_ROWS", 0)


def compare_kernel_with_reference(mechanism, same_signs=True, **options):
    """Assert that a run with and without a row kernel has the same statuses and numbers.

    A row kernel is a set of compiled functions that compute many rows at once (a row is one
    sample in one assembly mode). The kernel certifies a row if its error bounds are small;
    other rows are computed without it. Numbers may differ by the sum of their error bounds.

    Parameters
    ----------
    mechanism
        Mechanism that is moved.
    same_signs
        Whether directions of poles (axes of relative rotation) must also have the same
        sign. Opposite directions describe the same pole.
    options
        Further options of the run, such as `samples`.

    Returns
    -------
    float or None
        Share of the rows that the kernel certified; None if there is no kernel.
    """
    evaluations = evaluate_both_ways(mechanism, **options)
    if evaluations is None:
        return None
    differences = find_differences(evaluations, same_signs)
    assert differences.are_none, differences
    return differences.share


@pytest.mark.many
@pytest.mark.parametrize("name", [n for n in list_own_mechanisms() if n not in SLOW])
def test_kernel_agrees_with_reference_for_shipped_mechanisms(name):
    """Kernel and reference have the same statuses, and numbers within error bounds."""
    assert compare_kernel_with_reference(sk.load(name), samples=9) is not None


@pytest.mark.slow
def test_kernel_agrees_with_reference_for_random_mechanisms():
    """Many topologies, half with degenerate geometry; some rows beside ends of modes."""
    shares = []
    for seed in {*range(12), 112} - LONG_SEARCHES:  # a pivot of the last is 0 as a term
        _, mechanism = random_mechanism(seed)
        with suppress(SpherekitError):  # some random mechanisms are refused
            shares.append(compare_kernel_with_reference(mechanism, samples=9))
    shares = [share for share in shares if share is not None]
    assert len(shares) >= 4
    assert np.mean(shares) > 0.2


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3, 11])
def test_kernel_agrees_with_reference_for_contacts_of_any_profile(seed):
    """Chains of turning, rolling and sliding pairs, with circles, series and points."""
    assert compare_kernel_with_reference(shaped_mechanism(seed), samples=5) > 0.4


def test_kernel_agrees_with_reference_for_gears_with_a_start():
    """Two bevel wheels whose contact begins at azimuths of 20 and 50 degrees."""
    text = mechanism_text("gears").format(
        links='["base", "wheel"]',
        driven="pinion_shaft",
        contact="external",
        teeth=[20, 40],
        phase="start = [20, 50]",
    )
    assert compare_kernel_with_reference(loads(text), samples=5) == 1.0


@pytest.mark.parametrize(
    ("name", "samples"), [("five_bar", (40, 20)), ("bevel_differential", (4, 3))]
)
def test_kernel_agrees_with_reference_on_grids_of_two_inputs(name, samples):
    """Some points of the grid of the five-bar are out of reach."""
    evaluations = evaluate_both_ways(sk.load(name), samples=samples, grid=True)
    differences = find_differences(evaluations)
    assert differences.are_none, differences
    is_ok = evaluations.reference_motion.status == Status.OK
    assert differences.share == np.mean(is_ok)


@pytest.mark.parametrize("options", [{"samples": (5, 4), "grid": True}, {"samples": 20}])
def test_kernel_agrees_with_reference_if_the_angles_of_the_first_sample_are_unknown(
    options,
):
    """Kernel and reference agree although both modes have no angles at the first sample.

    The tips of both cranks of the five-bar coincide there. The other two links can
    therefore turn freely about the common axis, so their angles are not determined.
    """
    cranks_of_60_degrees = find("five_bar").read_text("utf-8")
    for axes in ('["21", "32"]', '["51", "54"]'):
        cranks_of_60_degrees = cranks_of_60_degrees.replace(
            f"axes = {axes}\narcs = [75.0]", f"axes = {axes}\narcs = [60.0]"
        )
    # Two sides of 60 degrees over the base of 90 degrees.
    azimuth = np.degrees(np.arccos(1.0 / np.sqrt(3.0)))
    text = cranks_of_60_degrees.replace(
        "from = 40.0\nto = 140.0", f"from = {azimuth}\nto = {azimuth + 20.0}"
    ).replace("from = 40.0\nto = 70.0", f"from = {-azimuth}\nto = {20.0 - azimuth}")
    evaluations = evaluate_both_ways(loads(text), **options)
    # Each of the two assembly modes has 20 rows. Rows 0 and 20 are the first samples.
    assert np.all(evaluations.reference_motion.failed[::20])
    differences = find_differences(evaluations)
    assert differences.are_none, differences


def set_slice_rows(monkeypatch, slice_rows):
    """Let a kernel compute rows in slices of exactly this number of rows.

    A slice is a multiple of SLICE_ROWS rows, and large enough for SLICE_NUMBERS results.
    With 1 result it has exactly SLICE_ROWS rows.
    """
    monkeypatch.setattr(batch_runner, "SLICE_NUMBERS", 1)
    monkeypatch.setattr(batch_runner, "SLICE_ROWS", slice_rows)


def record_continued_signs(monkeypatch):
    """Return a list to which every later run appends the signs of its pole directions.

    A pole is the axis of the relative rotation of two links. Its sign is arbitrary and is
    continued from row to row. Each entry is an array (poles, rows) of 1 and -1, in the
    order of the rows of a motion.
    """
    recorded_signs = []

    def continue_and_record_signs(*arguments):
        sign_function = continue_signs(*arguments)
        # A sign function has the arguments directions, rows and modes. Only the rows matter
        # here, and all are asked for.
        recorded_signs.append(sign_function(None, slice(None), None))
        return sign_function

    monkeypatch.setattr(batch_runner, "continue_signs", continue_and_record_signs)
    return recorded_signs


def count_sign_changes(signs):
    """Return how often signs (poles, rows) differ from those of the row before."""
    return np.count_nonzero(np.diff(signs))


@pytest.mark.many
@pytest.mark.parametrize("name", ["watt", "two_dof_spm", "three_rrr"])
def test_signs_of_pole_directions_continue_through_slices_as_without_a_kernel(
    name, monkeypatch
):
    """Pole directions are continuous along an assembly mode, although a sign is arbitrary.

    A pole is the axis of the relative rotation of two links. A kernel (compiled functions
    that compute many rows at once) computes directions of arbitrary sign. They are then
    multiplied by signs 1 or -1, which are continued in slices of consecutive rows. The
    reference is a run without a kernel (`evaluate_both_ways`). Slices have the usual number
    of rows, or one row.
    """
    # The kernel is compiled for any number of rows, if the compiler heyoka is installed.
    # Otherwise NumPy evaluates the same expressions.
    if available():
        monkeypatch.setattr(batch_runner, "MIN_COMPILED_ROWS", 0)
    recorded_signs = record_continued_signs(monkeypatch)
    usual_slice_rows = batch_runner.SLICE_ROWS
    for slice_rows in (usual_slice_rows, 1):
        set_slice_rows(monkeypatch, slice_rows)
        evaluations = evaluate_both_ways(sk.load(name), samples=120)
        differences = find_differences(evaluations)
        assert differences.are_none, differences
        # `share` is the share of all rows that the kernel computes: most of the rows with
        # status OK. Other rows cannot be assembled: two modes of `three_rrr` have few of
        # the samples only.
        share_of_kernel = differences.share
        share_of_ok_rows = np.mean(evaluations.reference_motion.status == Status.OK)
        assert share_of_kernel > 0.7 * share_of_ok_rows
    # The comparison means something only if these signs change within the motion.
    assert sum(count_sign_changes(signs) for signs in recorded_signs) > 10


@pytest.mark.slow
def test_kernel_agrees_with_reference_where_four_bars_fold_flat():
    """Special four-bars and dyads on them, at and beside the inputs where they fold.

    Signs of directions are not compared, since they cannot be continued through a fold.
    """
    count = 0
    # In mechanism 197 a dyad is in line, and the links after it cannot be placed.
    for seed in (*range(12), 197):
        _, mechanism, inputs = special_mechanism(seed)
        with suppress(SpherekitError):
            share = compare_kernel_with_reference(mechanism, same_signs=False, path=inputs)
            count += share is not None
    assert count >= 5


@pytest.mark.many
@pytest.mark.parametrize("name", ["four_bar", "stephenson", "five_bar", "shaped_cam"])
def test_close_samples_interpolated_from_nodes_agree_with_the_reference(name):
    """With 3000 samples the kernel interpolates configurations between nodes.

    It then closes their loops by Newton's method, to 6e-15 rad.
    """
    evaluations = evaluate_both_ways(sk.load(name), samples=3000)
    differences = find_differences(evaluations)
    assert differences.are_none, differences
    motion = evaluations.kernel_motion
    assert differences.share > 0.95 * np.mean(motion.status == Status.OK)
    assert np.nanmax(motion.residual) < 6e-15


@pytest.mark.many
@pytest.mark.parametrize(
    ("name", "samples"),
    [("four_bar", 900), ("double_butterfly", 500), ("five_bar", 700), ("shaped_cam", 600)],
)
def test_columns_that_are_computed_when_read_equal_those_computed_at_once(
    name, samples, monkeypatch
):
    """Lazy columns of a run, computed when they are first read, have the right numbers.

    The reference is the same run, in which the arrays of all pole quantities are computed
    at once and each column is cut from its array. A pickled copy of a table that was not
    read yet must also have the same columns, bit for bit.
    """
    options = {"samples": samples, "block": 130}  # several blocks, the last one shorter
    lazy_tables = _tables_of(sk.run(name, **options))
    blocks = [block for table in lazy_tables for block in table._blocks]
    columns = [column for block in blocks for column in block.values()]
    # A column of several inputs or modes consists of parts.
    parts = [part for column in columns for part in getattr(column, "parts", [column])]
    # The test is worth something only if many columns are lazy.
    assert sum(isinstance(part, LazyColumn) for part in parts) > 100
    pickled_table = pickle.loads(pickle.dumps(lazy_tables[-1]))

    def column_from_arrays(self, key, pole, component):
        """Return a component of the quantity `key` of a pole, in all rows."""
        values = getattr(self.as_arrays, key)[pole]
        return values.reshape(len(values), -1)[:, component].copy()

    monkeypatch.setattr(LazyField, "column", column_from_arrays)
    tables = _tables_of(sk.run(name, **options))
    for lazy_table, table in zip(lazy_tables, tables, strict=True):
        assert list(lazy_table) == list(table)
        for column in table:
            _assert_equal_columns(lazy_table[column], table[column], column)
    for column, values in pickled_table.items():
        _assert_equal_columns(values, tables[-1][column], column)


def _tables_of(result):
    """Return all tables of a run."""
    return [table for item in result.results.values() for table in item.data.values()]


def _assert_equal_columns(first, second, name):
    """Assert that two columns are equal bit for bit, NaN in the same rows."""
    assert np.array_equal(first, second, equal_nan=first.dtype.kind == "f"), name


@pytest.mark.parametrize(("name", "block"), [("stephenson", 700), ("five_bar", 400)])
def test_rows_do_not_depend_on_the_size_of_blocks(name, block, monkeypatch):
    """Rows are the same in one block of samples, in several, and without a kernel.

    A kernel is a set of compiled functions that compute many rows at once. Columns of whole
    numbers and statuses must be equal, pole directions and velocity coefficients up to
    rounding. The signs of directions are equal too: they continue from block to block, and
    over rows without a value. About half of the rows of the five-bar are out of reach, and
    have no values.
    """
    options = {"samples": 2900, "assembly_mode": 0}
    mechanism = wide_five_bar() if name == "five_bar" else sk.load(name)
    whole = sk.run(mechanism, **options)
    in_blocks = sk.run(mechanism, block=block, **options)
    # No run has so many rows, so no kernel is used.
    monkeypatch.setattr(batch_runner, "MIN_KERNEL_ROWS", 1 << 60)
    without_kernel = sk.run(mechanism, **options)

    table = whole.results["poles"].data["poles"]
    for result, tolerance in ((in_blocks, 1e-11), (without_kernel, 1e-9)):
        same_table = result.results["poles"].data["poles"]
        for column in table:
            if table[column].dtype.kind != "f":
                assert np.array_equal(table[column], same_table[column]), column
        for column in ("ux", "uy", "uz", "velocity_coefficient"):
            difference = np.abs(table[column] - same_table[column])
            has_no_value = np.isnan(table[column])
            assert np.array_equal(has_no_value, np.isnan(same_table[column]))
            assert np.nanmax(difference) < tolerance
    if name == "stephenson":
        # The kernel computed nearly all rows.
        assert whole.summary["errors_reached"]["fraction_by_kernel"] > 0.99
    else:
        assert 0.4 < np.mean(np.isnan(table["ux"])) < 0.6


def test_cores_change_nothing(monkeypatch):
    """Rows of three threads, the next block found meanwhile, are those of one."""
    found = []
    for cores in (1, 3):
        monkeypatch.setattr(prefetch, "usable_cores", lambda cores=cores: cores)
        result = sk.run("four_bar", samples=9000, block=4500)
        found.append(result.results["poles"].data["poles"])
    one, three = found
    for name in one:
        assert np.array_equal(one[name], three[name], equal_nan=one[name].dtype == float)


def test_bounds_hold_in_fifty_digits():
    """Numbers of the kernel are within their bounds of reference values in 50 digits."""
    result = sk.run("stephenson", samples=41, assembly_mode=1, verify=12)
    assert result.summary["errors_reached"]["fraction_by_kernel"] > 0.9
    for name in ("directions", "rates", "rate_derivatives"):
        verdict = result.summary["verified"][name]
        assert verdict["count"] and verdict["count"] == verdict["within_bound"]


def test_some_rows_of_several_modes_have_poles():
    """A motion of a few rows keeps its modes, with fewer rows than these have."""
    made = sk.load("four_bar")
    (motion,) = make_sampling(Study(made.name, made, 9)).blocks(9)
    poles = all_poles(len(made.links))
    field = evaluate(
        motion.rows([2]), request(made, made.inputs[0].pair, poles, rates=poles)
    )
    assert all(len(u) == 1 and np.all(np.isfinite(u)) for u in field.direction.values())
