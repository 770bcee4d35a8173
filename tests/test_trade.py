"""The command `trade`: speed against accuracy of evaluation settings.

A trade measures the time and the error of each setting and recommends the cheapest one for
a tolerance. The tests compute errors independently in 50 digits. A setting is on the Pareto
front if no other is both faster and more accurate.
"""

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from helpers.minimal_analysis import MinimalAnalysis

import spherekit as sk
from spherekit.cli.main import main
from spherekit.errors import AnalysisError, SolveError
from spherekit.files.study import Study
from spherekit.proof.balls import Digits, centre_floats
from spherekit.proof.reference_rows import exact_direction, exact_rows
from spherekit.runs.contract import ParameterTrade
from spherekit.runs.evaluation_options import Setting
from spherekit.runs.registry import create_analysis
from spherekit.runs.sampling import make_sampling
from spherekit.runs.simulation_measurement import compute_timed_tables, make_analysis_plan
from spherekit.runs.trade import trade
from spherekit.runs.trade_choice import MIN_SAMPLES_FOR_TRADE, choose
from spherekit.runs.trade_files import read_trade
from spherekit.runs.trade_measurement import compute_reference_tables, measure_deviations
from spherekit.runs.trade_record import MARGIN, Measured
from spherekit.status import Status
from spherekit.tables.table import Column, Table
from spherekit.tolerances import EPS

MECHANISM_NAMES = (
    "four_bar",
    "stephenson",
    "double_butterfly",
    "shaped_cam",
    "two_dof_spm",
)
FEW_SETTINGS = (Setting(), Setting(route="conditioned"), Setting(engine="extended"))
"""The default, pole directions by the best conditioned circles, and more digits."""


@pytest.fixture(autouse=True)
def digits():
    with Digits(50).within():
        yield


def sampling_of(mechanism, samples, **options):
    """Return the sampling of a run with these options."""
    return make_sampling(Study(mechanism.name, mechanism, samples, **options))


def compute_exact_rows(plan):
    """Return each pole request of a run with its rows in 50 digits."""
    (motion,) = plan.sampling.blocks(len(plan.sampling))
    all_rows = np.ones(len(motion), dtype=bool)
    return [
        (request, exact_rows(motion, all_rows, request.plan.input, Digits(50)))
        for request in plan.requests
    ]


def compute_true_error(plan, setting, exact_rows_by_request):
    """Return the largest error of the table `poles` of a run, compared with 50 digits.

    A pole is the axis of the relative rotation of two links. Errors of directions count
    absolutely. Those of velocity and acceleration coefficients (rates per rate of the
    input, and their derivatives) count relative to the largest coefficient of their column.
    The result is at least `EPS`, the rounding error of the numbers in the table.

    Parameters
    ----------
    plan
        The planned run: its samples, and `poles` as its only analysis.
    setting
        How the run evaluates velocities.
    exact_rows_by_request
        A list of tuples (request, rows in 50 digits), one for each input. Only this input
        moves in these rows. The request has the poles that are compared. The rows are those
        that `compute_exact_rows` returns.
    """
    tables, _, _ = compute_timed_tables(plan.sampling, *plan.analyses, setting)
    # Sort rows by mode, then by sample. Each sample of a mode then has one row for each
    # pole, in the order of the requests.
    poles_table = tables["poles"]
    order = np.lexsort((poles_table["sample"], poles_table["assembly_mode"]))
    columns = {name: np.asarray(values)[order] for name, values in poles_table.items()}
    pole_count = sum(len(request.poles) for request, _ in exact_rows_by_request)

    direction_error = 0.0
    largest_error = {"velocity_coefficient": 0.0, "acceleration_coefficient": 0.0}
    largest_size = dict.fromkeys(largest_error, 0.0)
    pole_number = 0
    for request, exact in exact_rows_by_request:
        for pole in request.poles:
            rows = {
                name: values[pole_number::pole_count] for name, values in columns.items()
            }
            pole_number += 1
            u = np.stack([rows[f"u{axis}"] for axis in "xyz"], axis=1)
            # The exact direction has the sign of u. Its components are balls, which are
            # numbers with an error bound. `centre_floats` rounds them to float64.
            exact_u = exact_direction(exact, pole, u)
            is_known = (exact.status == Status.OK) & np.all(np.isfinite(u), axis=1)
            differences = centre_floats(exact_u - u)[is_known]
            direction_error = max(direction_error, np.max(np.abs(differences), initial=0.0))
            # A coefficient is the relative rate of both links along the pole.
            first, second = pole
            for name, rates in (
                ("velocity_coefficient", exact.w),
                ("acceleration_coefficient", exact.dw),
            ):
                coefficient = np.sum((rates[:, second] - rates[:, first]) * exact_u, axis=1)
                differences = centre_floats(coefficient - rows[name])[is_known]
                error = np.max(np.abs(differences), initial=0.0)
                largest_error[name] = max(largest_error[name], error)
                size = np.max(np.abs(centre_floats(coefficient)[is_known]), initial=0.0)
                largest_size[name] = max(largest_size[name], size)
    relative_errors = [largest_error[name] / largest_size[name] for name in largest_error]
    return max(direction_error, *relative_errors, EPS)


RUN_OPTIONS = {
    "four_bar": {"samples": 9},
    "stephenson": {"samples": 7, "assembly_mode": 0},
    "double_butterfly": {"samples": 5, "assembly_mode": 0},
    "shaped_cam": {"samples": 7, "assembly_mode": 0},
    "two_dof_spm": {"samples": 3, "assembly_mode": 0},
}


@pytest.mark.many
@pytest.mark.parametrize("name", MECHANISM_NAMES)
def test_reported_errors_are_within_a_factor_two_of_the_true_ones(name):
    """The errors of a trade agree with errors from 50 digits, for at least two settings."""
    mechanism = sk.load(name)
    options = RUN_OPTIONS[name]
    measured = trade(mechanism, "poles", rounds=1, settings=settings_for(name), **options)
    plan = make_analysis_plan(sampling_of(mechanism, **options), create_analysis("poles"))
    exact_rows_by_request = compute_exact_rows(plan)
    judged_count = 0
    for item in measured.settings:
        if item.counts:
            true_error = compute_true_error(plan, item.setting, exact_rows_by_request)
            assert 0.5 * true_error <= item.error <= 2.0 * true_error, item.name
            judged_count += 1
    assert judged_count >= 2


def settings_for(name):
    """Return the settings to measure; fewer for the double butterfly, which is slow."""
    if name == "double_butterfly":
        return list(FEW_SETTINGS[:2])
    return [*FEW_SETTINGS, Setting(route="equations")]


def vary_arcs(mechanism, random, standard_deviation=0.02):
    """Return a mechanism whose arcs are each multiplied by a random factor near 1."""
    links = {}
    for name, size in mechanism.geometry.links.items():
        factors = [random.normal(1.0, standard_deviation) for _ in size.arcs]
        arcs = tuple(float(x * k) for x, k in zip(size.arcs, factors, strict=True))
        links[name] = replace(size, arcs=arcs)
    return replace(mechanism, geometry=replace(mechanism.geometry, links=links))


SAMPLES_OF_LONG_CASES = {
    "four_bar": 181,
    "stephenson": 91,
    "two_dof_spm": 31,
    "shaped_cam": 61,
}
TOLERANCE_CASES = [
    ("four_bar", 6, 91),
    ("stephenson", 4, 91),
    *(
        pytest.param(name, 200, samples, marks=pytest.mark.long)
        for name, samples in SAMPLES_OF_LONG_CASES.items()
    ),
]
"""Name, number of random mechanisms and number of samples."""


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize(("name", "count", "samples"), TOLERANCE_CASES)
def test_recommended_settings_meet_the_tolerance(name, count, samples):
    """The setting recommended for a random tolerance meets it at all samples.

    A trade measures the time and the error of evaluation settings, and recommends the
    cheapest one whose error times `MARGIN` is below a tolerance. It measures errors at a
    third of the samples only; here all samples are compared with the reference. Each number
    in the tables of the reference must also be in those of the setting (`missing` counts
    numbers that are not).

    If no setting is recommended, the error of each setting in question must be too large.
    These are the settings that no other beats in both time and error (`pareto`). Times do
    not matter here, so they are measured in one round.
    """
    random = np.random.default_rng(MECHANISM_NAMES.index(name))
    options = {"assembly_mode": 0, "search": True}
    remaining = count
    while remaining:
        mechanism = vary_arcs(sk.load(name), random)
        tolerance = 10.0 ** random.uniform(-12.0, -3.0)
        try:
            measured = trade(
                mechanism,
                "poles",
                samples=samples,
                settings=FEW_SETTINGS,
                checked=samples // 3,
                rounds=1,
                **options,
            )
        except SolveError:  # these arcs cannot be assembled
            continue
        remaining -= 1
        chosen = measured.cheapest(tolerance)
        if chosen is None:
            assert all(MARGIN * item.error > tolerance for item in measured.pareto)
            continue
        sampling = sampling_of(mechanism, samples, **options)
        plan = make_analysis_plan(sampling, create_analysis("poles"))
        (motion,) = plan.sampling.blocks(samples)
        reference = compute_reference_tables(plan, motion)
        # Both unit vectors along a pole axis are right. Those of this setting get the
        # senses of the reference, so that they can be compared.
        tables, _, _ = compute_timed_tables(
            plan.sampling, *plan.analyses, chosen.setting, reference.pole_fields
        )
        for deviation in measure_deviations(plan, tables, reference.tables):
            assert deviation.error <= tolerance, (chosen.name, deviation)
            assert not deviation.missing, (chosen.name, deviation)


def test_no_setting_dominates_one_of_the_front():
    """A setting at least as accurate as one of the front is not faster than it."""
    measured = trade(sk.load("four_bar"), samples=37, settings=FEW_SETTINGS, rounds=1)
    for on_front in measured.pareto:
        for item in measured.settings:
            if item.counts and item.error <= on_front.error:
                assert item.total >= on_front.total
    errors = [item.error for item in measured.pareto]
    assert errors == sorted(errors, reverse=True)


SECONDS_AND_ERRORS = ((1.0, 1e-10), (1.05, 1e-15), (1.5, 1e-16))
"""Times (s) and errors of settings; the first two times are alike, within five percent."""


@pytest.fixture(scope="module")
def measured_four_bar():
    """Return the trade of a million samples of a four-bar, of which 361 were asked for."""
    return trade(
        sk.load("four_bar"),
        samples=1_000_000,
        settings=FEW_SETTINGS[:1],
        checked=361,
        rounds=1,
    )


@pytest.mark.slow
def test_the_cheapest_setting_depends_on_the_number_of_samples(measured_four_bar):
    """Interpolation has a fixed price for its nodes, so it pays for many samples only."""
    assert 361 < measured_four_bar.checked < 700
    for samples, cheapest in ((1_000, 0), (1_000_000, 1)):
        each_sample = Measured("every", FEW_SETTINGS[0], 1e-5 * samples, error=1e-15)
        nodes = Measured("nodes", FEW_SETTINGS[-1], 0.1 + 1e-6 * samples, error=1e-9)
        candidates = replace(
            measured_four_bar, samples=samples, settings=(each_sample, nodes)
        )
        assert candidates.cheapest(1e-6) is candidates.settings[cheapest]
        assert candidates.cheapest(1e-12) is each_sample


@pytest.mark.slow
def test_of_settings_alike_in_time_the_more_accurate_is_chosen(measured_four_bar):
    base = Measured("every", FEW_SETTINGS[0], 1.0, error=1e-15)
    first, second, third = (
        replace(base, seconds=10.0 * seconds, error=error)
        for seconds, error in SECONDS_AND_ERRORS
    )
    candidates = replace(measured_four_bar, settings=(first, second, third))
    assert candidates.cheapest(1e-6) is second
    assert candidates.cheapest(1e-12) is second
    assert candidates.cheapest(4e-16) is third


@pytest.mark.slow
def test_a_setting_with_missing_numbers_does_not_count():
    """The first great circles of the Stephenson fail where two of its poles meet."""
    settings = [Setting(), Setting(route="first")]
    measured = trade(sk.load("stephenson"), samples=361, settings=settings, rounds=1)
    best, first_circles = measured.settings
    assert best.counts
    assert first_circles.missing > 0
    assert not first_circles.counts


@pytest.mark.parametrize("tolerance", [0.0, -1e-9, np.nan, np.inf])
def test_a_tolerance_that_is_no_positive_number_is_refused(tolerance):
    with pytest.raises(AnalysisError, match="expected a finite number above 0"):
        choose(Study("x", sk.load("four_bar"), 9), [create_analysis("poles")], tolerance)


@pytest.mark.slow
def test_the_workspace_trades_its_tolerance():
    measured = trade(sk.load("five_bar"), "workspace", rounds=1)
    assert measured.settings[0].name == "tolerance=0.01"
    assert all(np.isfinite(item.own_estimate) for item in measured.settings)


@pytest.mark.slow
def test_the_sensitivity_trades_its_number_of_draws():
    """The statistical error of 16 draws is more than five times that of 1024."""
    measured = trade(sk.load("four_bar"), "sensitivity", rounds=1, samples=3)
    assert measured.derivatives is None
    names = [item.name for item in measured.settings]
    assert names == [f"draws={count}" for count in (16, 64, 256, 1024)]
    errors = [item.error for item in measured.settings]
    assert errors[0] > 5.0 * errors[-1] > 0.0
    assert not any(item.missing for item in measured.settings)


@dataclass(frozen=True, kw_only=True)
class AngleBesideZero(MinimalAnalysis):
    """An angle that is zero, or just below it, as the parameter `off` says."""

    name: ClassVar = "beside"
    reads_samples: ClassVar = False
    tables: ClassVar = (Table("beside", "", (Column("x", "rad", ""),)),)
    trades: ClassVar = (
        ParameterTrade("off", (1e-17, 0.0), "beside", "x", (), places=True),
    )
    off: float = 0.0

    def compute(self, batch):
        return {"beside": {"x": np.array([-self.off])}}


def test_an_angle_just_below_a_turn_is_close_to_zero():
    """-1e-17 rad, which modulo a turn is 2 pi, deviates from 0 by rounding alone."""
    (item,) = trade(sk.load("four_bar"), AngleBesideZero(), rounds=1).settings
    assert item.error < 1e-15
    assert not item.missing


@dataclass(frozen=True, kw_only=True)
class NoPlaces(AngleBesideZero):
    """An analysis that finds no place, whatever its parameter."""

    def compute(self, batch):
        return {"beside": {"x": np.zeros(0)}}


def test_runs_that_all_find_no_place_agree():
    """Two tables without any position agree, so the setting can be recommended."""
    measured = trade(sk.load("four_bar"), NoPlaces(), rounds=1)
    (item,) = measured.settings
    assert item.error == EPS
    assert not item.missing
    assert measured.cheapest(1e-9) is item


@dataclass(frozen=True, kw_only=True)
class SizeWithSpread(MinimalAnalysis):
    """A size that does not depend on `off`, and a column `x_spread` that does."""

    name: ClassVar = "beside"
    reads_samples: ClassVar = False
    tables: ClassVar = (
        Table("beside", "", (Column("x", "", ""), Column("x_spread", "", ""))),
    )
    trades: ClassVar = (ParameterTrade("off", (1.0, 0.0), "beside", "x", ()),)
    off: float = 0.0

    def compute(self, batch):
        return {"beside": {"x": np.ones(1), "x_spread": np.array([self.off])}}


def test_a_column_whose_name_begins_with_the_compared_one_is_not_compared():
    (item,) = trade(sk.load("four_bar"), SizeWithSpread(), rounds=1).settings
    assert item.error == EPS


@dataclass(frozen=True, kw_only=True)
class CountedSamples(MinimalAnalysis):
    """The inputs of all samples of its run, collected in `shapes` and `inputs`."""

    name: ClassVar = "counted"
    tables: ClassVar = (Table("counted", "", (Column("x", "", ""),)),)
    trades: ClassVar = (ParameterTrade("off", (1.0, 0.0), "counted", "x", ()),)
    off: float = 0.0
    inputs: ClassVar = []

    def compute(self, batch):
        self.inputs.append(batch.inputs)
        return {"counted": {"x": np.ones(1)}}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "options", "largest_count"),
    [
        ("two_dof_spm", {"samples": 5, "grid": True}, 25),
        ("two_dof_spm", {"samples": (6, 7)}, 31),
        ("two_dof_spm", {"samples": 7, "grid": True}, 31),
        ("four_bar", {"path": np.linspace(0.2, 0.9, 100)[:, None]}, 31),
    ],
)
def test_values_of_a_parameter_are_compared_at_few_samples_of_the_same_run(
    name, options, largest_count
):
    """A grid remains a grid over the same ranges, and a path has the same ends."""
    mechanism = sk.load(name)
    CountedSamples.inputs.clear()
    trade(mechanism, CountedSamples(), rounds=1, assembly_mode=0, **options)
    all_inputs = sampling_of(mechanism, **({"samples": 9} | options)).inputs
    for inputs in CountedSamples.inputs:
        assert 4 < len(inputs) <= largest_count
        assert np.array_equal(np.min(inputs, axis=0), np.min(all_inputs, axis=0))
        assert np.array_equal(np.max(inputs, axis=0), np.max(all_inputs, axis=0))
        if inputs.shape[1] > 1:
            counts = [len(np.unique(column)) for column in inputs.T]
            assert np.prod(counts) == len(inputs)


def test_a_long_run_that_begins_out_of_reach_has_a_trade(monkeypatch):
    """The default setting is timed at samples that are spread over the whole run.

    The first tenth of the range of input 41 cannot be reached.
    """
    monkeypatch.setattr("spherekit.runs.batch_runner.MIN_KERNEL_ROWS", 16)
    mechanism = sk.load("four_bar").with_inputs(
        "41", ranges={"41": (0.0, 360.0)}, angle_unit="deg"
    )
    (item,) = trade(
        mechanism, samples=300, settings=FEW_SETTINGS[:1], checked=31, rounds=1
    ).settings
    assert item.counts
    assert item.seconds > 0.0


@pytest.mark.slow
def test_errors_are_measured_at_as_many_samples_as_asked_for():
    """The default limit of 361 samples does not apply to a number that is given."""
    measured = trade(
        sk.load("four_bar"),
        "poles:only=21",
        samples=400,
        checked=400,
        settings=FEW_SETTINGS[:1],
        rounds=1,
        assembly_mode=0,
    )
    assert measured.checked == 400


@pytest.mark.slow
def test_singularities_of_coarse_samplings_are_accurate():
    """Singularities are refined between samples; each is compared with the nearest one."""
    measured = trade(sk.load("four_bar"), "singularities", rounds=1)
    assert measured.reference == "the tightest: samples=1441"
    for item in measured.settings:
        assert item.error < 1e-12
        assert not item.missing
    assert measured.columns[0][:2] == ("singularities.q", "absolute rad")


@pytest.mark.slow
def test_the_command_says_that_no_setting_meets_a_tolerance(capsys, tmp_path):
    pytest.importorskip("matplotlib")
    arguments = ["four_bar", "--samples", "13", "--rounds", "1"]
    assert main(["trade", *arguments, "--tol", "1e-30", "-o", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    message = "For 1e-30: no setting meets it with a margin of 4; the best reached is"
    assert message in printed
    settings = json.loads((tmp_path / "trade.json").read_text())["settings"]
    lines = (tmp_path / "trade.csv").read_text().splitlines()
    assert len(lines) == 1 + len(settings)
    assert (tmp_path / "trade.png").read_bytes().startswith(b"\x89PNG")


def test_a_short_run_makes_no_trade_and_says_what_it_reached(capsys):
    assert main(["run", "four_bar", "--samples", "31", "--tol", "1e-9", "--json"]) == 0
    accuracy = json.loads(capsys.readouterr().out)["accuracy"]
    assert accuracy["met"]
    assert accuracy["setting"] == "numpy best"
    assert accuracy["achieved_error"] < 1e-13
    assert accuracy["check_rows"] == 62
    assert f"fewer than {MIN_SAMPLES_FOR_TRADE}" in accuracy["why"]


@pytest.mark.slow
def test_a_long_run_takes_the_cheapest_setting(capsys):
    command = (
        f"run four_bar -a poles:only=31 --samples {MIN_SAMPLES_FOR_TRADE} "
        "--assembly-mode 0 --tol 1e-6"
    )
    assert main(command.split()) == 0
    lines = capsys.readouterr().out.splitlines()
    (line,) = [line for line in lines if line.startswith("  tolerance")]
    assert "the cheapest of a short trade of poles" in line
    assert "NOT MET" not in line


def store_trade(folder, *flags):
    """Store a short trade of the four-bar; return its folder as text."""
    arguments = ["four_bar", "--rounds", "1", "-q", *flags]
    assert main(["trade", *arguments, "-o", str(folder)]) == 0
    return str(folder)


RUN_FLAGS = ("--samples", "200", "--assembly-mode", "0")
SIMULATION_FLAGS = (
    *("-a", "eksergian", "--start", "q=0.5rad,dq=3rad/s"),
    *("--duration", "0.3", "--samples", "9"),
)


def run_with_trade(capsys, folder, tolerance, *flags):
    """Run the four-bar with a stored trade; return the summary of the run."""
    arguments = [*flags, "--tol", repr(tolerance), "--trade", folder, "--json"]
    assert main(["run", "four_bar", *arguments]) == 0
    return json.loads(capsys.readouterr().out)


@pytest.mark.slow
def test_a_run_takes_the_cheapest_setting_of_a_stored_trade(capsys, stored):
    accuracy = run_with_trade(capsys, stored, 1e-5, *RUN_FLAGS)["accuracy"]
    assert accuracy["setting"] == read_trade(stored).cheapest(1e-5).name
    assert "stored trade of poles" in accuracy["why"]
    assert accuracy["met"]
    assert accuracy["achieved_error"] <= 1e-5
    assert accuracy["check_rows"] == 61


@pytest.mark.slow
def test_a_setting_of_a_stored_trade_needs_a_margin_of_four(capsys, stored):
    """Twice the error of a setting is a tolerance that it meets only without the margin."""
    tolerance = 2.0 * read_trade(stored).cheapest(1e-5).error
    accuracy = run_with_trade(capsys, stored, tolerance, *RUN_FLAGS)["accuracy"]
    is_met_with_margin = 4.0 * accuracy.get("predicted_error", np.inf) <= tolerance
    assert "no setting" in accuracy["why"] or is_met_with_margin


@pytest.mark.slow
def test_a_stored_trade_is_read_as_it_was_written(stored):
    """Times and errors are compared for the settings that apply; others have a reason."""
    written = json.loads((Path(stored) / "trade.json").read_text())
    for item, row in zip(read_trade(stored).settings, written["settings"], strict=True):
        for key in ("name", "missing", "reason"):
            assert getattr(item, key) == row[key], key
        if not item.reason:
            assert item.error == row["error"]
            assert item.seconds == row["seconds"]
            assert str(item.setting) == item.name


@pytest.fixture
def stored_simulation_trade(tmp_path, monkeypatch, capsys):
    """Return the folder of a trade of a simulation with three tolerances (rad)."""
    monkeypatch.setattr(
        "spherekit.runs.simulation_measurement.TOLERANCES_RAD", [1e-4, 1e-7, 1e-11]
    )
    folder = store_trade(tmp_path, *SIMULATION_FLAGS)
    capsys.readouterr()
    return folder


@pytest.mark.slow
def test_a_simulation_takes_integrator_and_tolerance_of_a_stored_trade(
    capsys, stored_simulation_trade
):
    summary = run_with_trade(capsys, stored_simulation_trade, 1e-8, *SIMULATION_FLAGS)
    chosen = read_trade(stored_simulation_trade).cheapest(1e-8)
    assert summary["accuracy"]["setting"] == chosen.name
    assert summary["accuracy"]["met"]
    assert summary["simulation"]["tolerance"] == chosen.setting.tolerance
    assert summary["simulation"]["engine"]["name"] == chosen.setting.integrator


@pytest.mark.slow
def test_a_simulation_says_that_a_stored_trade_misses_the_tolerance(
    capsys, stored_simulation_trade
):
    arguments = ["run", "four_bar", *SIMULATION_FLAGS, "--trade", stored_simulation_trade]
    assert main([*arguments, "--tol", "1e-17"]) == 0
    assert "from this measurement: THE TOLERANCE IS NOT MET" in capsys.readouterr().out


@pytest.mark.slow
def test_a_simulation_with_an_engine_of_its_own_refuses_a_stored_trade(
    stored_simulation_trade,
):
    arguments = ["run", "four_bar", *SIMULATION_FLAGS, "--trade", stored_simulation_trade]
    assert main([*arguments, "--tol", "1e-8", "--engine", "numpy"]) == 1


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (("--samples", "201", "--assembly-mode", "0"), "samples: 200 there, 201 now"),
        (("--samples", "200"), "assembly mode: 0 there, null now"),
        ((*RUN_FLAGS, "-a", "poles:only=31"), "parameters:"),
        ((*RUN_FLAGS, "-a", "eksergian"), "analysis poles, which is not part of this run"),
        ((*RUN_FLAGS, "-a", "poles", "-a", "eksergian"), "there is no trade for eksergian"),
        ((*RUN_FLAGS, "--law", "constant_speed:speed=2rad/s", "--duration", "1"), "laws:"),
    ],
)
def test_a_trade_of_another_run_is_refused(flags, message, capsys, stored):
    """The message names the difference and what to do about it."""
    assert main(["run", "four_bar", *flags, "--tol", "1e-5", "--trade", stored]) == 1
    error_text = capsys.readouterr().err
    assert message in error_text
    assert any(advice in error_text for advice in ("leave", "make it", "make one"))


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    """Return the folder of a trade of 200 samples in one assembly mode."""
    return store_trade(tmp_path_factory.mktemp("trade"), *RUN_FLAGS)


def test_a_trade_of_another_mechanism_or_version_is_refused(capsys, stored, tmp_path):
    arguments = [*RUN_FLAGS, "--tol", "1e-5", "--trade"]
    assert main(["run", "stephenson", *arguments, stored]) == 1
    assert "mechanism: four_bar there, stephenson now" in capsys.readouterr().err

    data = json.loads((Path(stored) / "trade.json").read_text())
    data["made_for"] |= {"mechanism_hash": "0" * 64, "spherekit": "0.0.1"}
    (tmp_path / "trade.json").write_text(json.dumps(data))
    assert main(["run", "four_bar", *arguments, str(tmp_path)]) == 1
    error_text = capsys.readouterr().err
    assert "spherekit: 0.0.1 there" in error_text
    assert "other contents of the mechanism file" in error_text


@pytest.mark.parametrize("text", [None, "not JSON", "[]", "{}", '{"settings": 1}'])
def test_a_folder_without_a_trade_is_refused(text, capsys, tmp_path):
    """The file `trade.json` is absent, or it has another content."""
    if text is not None:
        (tmp_path / "trade.json").write_text(text)
    arguments = ["run", "four_bar", "--trade", str(tmp_path)]
    assert main([*arguments, "--tol", "1e-5"]) == 1
    error_text = capsys.readouterr().err
    assert " trade" in error_text
    assert "write one with: spherekit trade" in error_text
    assert main(arguments) == 1
    assert "with --tol T" in capsys.readouterr().err


def test_a_long_run_without_a_trade_does_not_call_itself_short(monkeypatch):
    """Settings cannot be compared for `singularities`, however many samples there are."""
    monkeypatch.setattr("spherekit.runs.trade_choice.MIN_SAMPLES_FOR_TRADE", 20)
    four_bar = sk.load("four_bar")
    reasons = [
        choose(
            Study("four_bar", four_bar, samples=samples),
            [create_analysis("singularities", "rad")],
            1e-9,
        )[1]["why"]
        for samples in (19, 20)
    ]
    assert "fewer than 20 samples" in reasons[0]
    assert reasons[1] == "nothing was measured, since no settings could be compared"


@pytest.mark.parametrize(
    "changed",
    [
        {"made_for": None},
        {"settings": [{"error": "small"}]},
        {"settings": [{"setting": {"engine": "steam"}}]},
        {"settings": [{"setting": {"fuel": "coal"}}]},
    ],
)
def test_a_damaged_trade_is_refused_with_the_name_of_its_file(changed, stored, tmp_path):
    """In the file of a trade, one value or the first setting is damaged."""
    content = json.loads((Path(stored) / "trade.json").read_text())
    for key, value in changed.items():
        content[key] = [content[key][0] | value[0]] if key == "settings" else value
    file = tmp_path / "trade.json"
    file.write_text(json.dumps(content))
    with pytest.raises(
        AnalysisError, match="not a trade that this version can read"
    ) as info:
        read_trade(file)
    assert str(info.value).startswith(str(file))


def test_a_trade_file_of_endless_brackets_is_refused(tmp_path):
    file = tmp_path / "trade.json"
    file.write_text("[" * 100_000)
    with pytest.raises(AnalysisError, match="not a trade that this version can read"):
        read_trade(file)


def test_advice_about_the_file_of_a_trade_names_its_folder(stored, tmp_path, capsys):
    """`spherekit trade -o` takes a folder, `--trade` also takes the file in it."""
    arguments = ["run", "four_bar", "--samples", "201", "--tol", "1e-5", "--trade"]
    assert main([*arguments, str(Path(stored) / "trade.json")]) == 1
    assert f"-o {stored} and the options" in capsys.readouterr().err
    file = tmp_path / "trade.json"
    file.write_text("{}")
    assert main([*arguments, str(file)]) == 1
    assert capsys.readouterr().err.strip().endswith(f"-o {tmp_path}")
