"""The option `--verify`: some rows of a run are computed again in 50 digits and compared.

The tests compare its numbers with closed forms, and make a run wrong to see that the
verification says so.
"""

import json
from dataclasses import dataclass, replace
from typing import ClassVar, final

import mpmath as mp
import numpy as np
import pytest
from helpers.minimal_analysis import MinimalAnalysis, with_row_columns
from oracles.exact_four_bar import angle, arcs_of

import spherekit as sk
from spherekit.cli.main import main
from spherekit.errors import EngineError
from spherekit.files.study import Start
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.runs import run_plan as summary
from spherekit.runs import runner as runner
from spherekit.runs import sampling, verification
from spherekit.runs.evaluation_options import ORDINARY
from spherekit.runs.needs import Needs
from spherekit.runs.run_plan import RunPlan
from spherekit.runs.sampling import Sampling
from spherekit.runs.verification import Verifier
from spherekit.runs.verification_text import format_verification, verification_failures
from spherekit.tables.table import ASSEMBLY_MODE, SAMPLE, Column, Table
from spherekit.tolerances import EPS
from spherekit.velocities.pole_evaluation import evaluate
from spherekit.velocities.pole_request import request


def verify_run(name="four_bar", analyses="poles", **options):
    """Run a mechanism; return what its summary says of the verification."""
    return sk.run(sk.load(name), analyses, **options).summary["verified"]


def find_column(verification, table, name):
    """Return the entry of a column in a verification, with its largest deviation."""
    columns = {(item["table"], item["column"]): item for item in verification["columns"]}
    return columns[table, name]


@pytest.fixture(scope="module")
def four_bar_verification():
    """Return the verification of 6 rows of a four-bar at 31 samples."""
    return verify_run(samples=31, verify=6)


def test_columns_of_a_sound_run_deviate_by_rounding(four_bar_verification):
    assert four_bar_verification["rows"] == 6
    assert four_bar_verification["beyond"] == []
    assert four_bar_verification["without_reference"] == []
    assert four_bar_verification["largest_distance_rad"] < 1e-14
    assert 1.0 < four_bar_verification["largest_condition"] < 100.0
    column = find_column(four_bar_verification, "poles", "acceleration_coefficient")
    assert column["deviation"] < 1e-14
    difference = abs(column["value"] - column["reference"])
    assert column["deviation"] == pytest.approx(difference, abs=1e-18)


def test_error_bounds_are_not_recomputed(four_bar_verification):
    """Error bounds and the conditioning belong to the run, so they have no reference."""
    assert set(four_bar_verification["not_recomputed"]) == {
        "poles.conditioning",
        "poles.error_bound",
        "poles.velocity_coefficient_error_bound",
        "poles.acceleration_coefficient_error_bound",
        "poles.direction_dq_error_bound",
    }


def test_the_reference_of_an_angle_is_its_closed_form(four_bar_verification):
    """theta_41 by the closed form of Di Gregorio 2024 in 50 digits, modulo whole turns.

    The difference of pi in double and exact precision belongs to the zero of the pair.
    """
    theta = find_column(four_bar_verification, "motion", "theta_41")
    mechanism = sk.load("four_bar")
    inputs = np.linspace(0.0, mechanism.inputs[0].stop, 31)
    with mp.workdps(50):
        q = mp.mpf(float(inputs[theta["sample"]]))
        zero = mp.pi - mp.mpf(np.pi)
        closed_forms = [angle(arcs_of(mechanism), q, mode) + zero for mode in (0, 1)]
        misses = [abs(mp.expj(theta["reference"]) - mp.expj(x)) for x in closed_forms]
        assert min(misses) < 2 * EPS


def test_pole_directions_lie_within_their_bounds(four_bar_verification):
    """6 rows with 6 poles each; the largest error is stated as a part of its bound."""
    directions = four_bar_verification["directions"]
    assert directions["count"] == 36
    assert directions["within_bound"] == 36
    assert 0.01 < directions["over_bound"] <= 1.0
    error = directions["over_bound"] * directions["bound"]
    assert directions["error"] == pytest.approx(error)


def test_verification_does_not_depend_on_the_size_of_blocks():
    """Rows are computed in blocks of 4 or of 512; only the time taken differs."""
    verifications = []
    for block in (4, 512):
        verification = verify_run("stephenson", samples=21, verify=5, block=block)
        del verification["seconds"]
        verifications.append(verification)
    assert verifications[0] == verifications[1]


def test_verified_rows_include_the_worst_ones_and_are_spread_out():
    """The rows with the largest residual, error bound and conditioning are verified.

    To verify is to compute again in 50 digits. Nine rows (samples of an assembly mode) are
    selected; they also cover both ends of the range and three modes or more. A subclass of
    the verifier records the selection.
    """
    selections = []

    class SelectionRecorder(Verifier):
        def verify(self, failed=()):
            selections.append(self._selected)
            return super().verify(failed)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(runner, "Verifier", SelectionRecorder)
        result = sk.run(sk.load("stephenson"), samples=21, verify=9)
    selected_motion = selections[0].motion
    rows = set(zip(selected_motion.sample, selected_motion.assembly_mode, strict=True))
    assert len(rows) == 9

    for table, column in (("motion", "residual"), ("poles", "error_bound")):
        frame = result.frame(table)
        worst = frame.loc[frame[column].idxmax()]
        assert (worst["sample"], worst["assembly_mode"]) in rows
    motion = sk.trace(sk.load("stephenson"), samples=21)
    worst = int(np.argmax(motion.conditioning))
    assert (motion.sample[worst], motion.assembly_mode[worst]) in rows

    modes = {mode for _, mode in rows}
    samples = sorted(sample for sample, _ in rows)
    assert len(modes) > 2
    assert samples[0] < 7
    assert samples[-1] > 13


@pytest.fixture
def change_pole_fields(monkeypatch):
    """Return a function that has a change made in all pole fields of later runs."""

    def install(change):
        def evaluate_and_change(motion, pole_request, memory=None, *more):
            pole_field = evaluate(motion, pole_request, memory)
            change(pole_field)
            return pole_field

        monkeypatch.setattr(summary, "evaluate", evaluate_and_change)

    return install


def test_an_inertia_from_a_wrong_rate_deviates(change_pole_fields):
    """The rate of link 4 is wrong by 1e-8 of itself, its inertia by twice that."""

    def falsify_rate(field):
        field.w[3] *= 1.0 + 1e-8

    change_pole_fields(falsify_rate)
    verification = verify_run(analyses="eksergian", samples=9, verify=3)
    column = find_column(verification, "inertia", "B")
    assert column["subject"] == {"link": "4"}
    assert column["deviation"] == pytest.approx(2e-8 * column["reference"], rel=1e-6)


def test_a_wrong_velocity_coefficient_is_reported_and_fails_a_strict_run(
    change_pole_fields, capsys
):
    """`--verify` reports a velocity coefficient that is off by 1e-9; `--strict` fails.

    It is the rate of link 4 relative to link 1 per rate of the input. The message names the
    link, the link it is seen from, and the pair of the moving input. `change_pole_fields`
    makes a change in the computed poles and coefficients of all later runs.
    """

    def falsify_coefficient(field):
        # Keys are the positions of two links, from 0: here links 1 and 4.
        field.velocity_coefficient[0, 3] += 1e-9

    change_pole_fields(falsify_coefficient)
    # Four rows are verified.
    arguments = ["run", "four_bar", "--samples", "9", "--verify", "4"]
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    assert "poles.velocity_coefficient: off by 1.0e-09 at sample" in printed
    assert "worst row: " in printed
    assert "link 4, relative_to 1, moving 21: poles" in printed
    assert "verify: poles.velocity_coefficient deviate by more than rounding" in printed
    assert main([*arguments, "--strict"]) == 3


def test_a_wrong_pole_direction_is_outside_its_bound(change_pole_fields):
    """The verification of a run finds a pole direction beyond its error bound.

    A pole is the axis of the relative rotation of two links. Four rows of a run are
    verified, with six poles each. In all rows the y component of one pole is changed by
    1e-10. `change_pole_fields` takes a function that makes this change in the results of
    later runs.
    """

    def falsify_direction(field):
        field.direction[1, 3][:, 1] += 1e-10

    change_pole_fields(falsify_direction)
    verification = verify_run(samples=9, verify=4)
    failures = verification_failures(verification)
    fault = "4 of 24 pole directions have an error above"
    assert any(fault in failure for failure in failures)
    directions = verification["directions"]
    assert directions["within_bound"] == directions["count"] - 4
    assert directions["subject"]["link"] == "4"
    assert directions["error"] == pytest.approx(1e-10, rel=0.5)


def make_verifier(position_analysis, count):
    """Return a request of the pole 41 by the input 21, and a verifier of `count` rows."""
    pole_request = request(position_analysis.mechanism, "21", [(0, 3)], [(0, 3)])
    grid = position_analysis.input_grid
    sampling = Sampling(position_analysis, grid.q, grid.shape, None, False, {})
    plan = RunPlan(
        sampling, (), (), {}, (pole_request,), ORDINARY, sampling, len(sampling), []
    )
    return pole_request, Verifier(plan, count)


def test_a_wrong_configuration_is_reported_or_has_no_reference():
    """A small error of a configuration is a deviation; a large one has no reference.

    A verification compares rows (samples of an assembly mode) with references. A reference
    is a configuration in 50 digits, to which Newton's method leads from the row. An error
    of 1e-8 rad is reported as a deviation from the reference. After an error of 1e-4 rad,
    the solution of Newton's method is too far from the row to be taken as its reference.
    The report states the distance from the row to this solution, about 1e-4 rad.
    `make_verifier` returns a request of a pole and a verifier.
    """
    position_analysis = PositionAnalysis(sk.load("four_bar"), samples=7)
    motion = position_analysis.motion()
    # The limit of 20 rows is more than the motion has, so all rows are verified.
    pole_request, verifier = make_verifier(position_analysis, 20)
    far_row, near_row = 3, 5
    values = motion.values.copy()
    column_of_theta_32 = 1
    values[far_row, column_of_theta_32] += 1e-4
    values[near_row, column_of_theta_32] += 1e-8
    wrong_motion = replace(motion, values=values)
    poles = evaluate(wrong_motion, pole_request)
    # This argument has angles that count whole turns. It is empty, since only an analysis
    # could read them and the run has none.
    verifier.select_from_block(wrong_motion, (poles,), continued_angles={})
    verification = verifier.verify()
    assert verification["rows"] == len(motion)

    (lost,) = verification["without_reference"]
    assert lost["sample"] == motion.sample[far_row]
    assert lost["assembly_mode"] == motion.assembly_mode[far_row]
    assert lost["status"] == "MODE_LOST"
    assert lost["distance_rad"] == pytest.approx(1e-4, rel=0.5)

    # Columns that deviate beyond their tolerance.
    assert "motion.theta_32" in verification["beyond"]
    column = find_column(verification, "motion", "theta_32")
    assert column["sample"] == motion.sample[near_row]
    assert column["deviation"] == pytest.approx(1e-8, rel=1e-6)

    text = "\n".join(format_verification(verification))
    sample = motion.sample[far_row]
    assert f"no reference at sample {sample}, assembly mode 0: MODE_LOST" in text
    assert len(verification_failures(verification)) == 2


@pytest.mark.slow
def test_columns_of_several_inputs_are_verified_by_moving_input():
    verification = verify_run("five_bar", samples=9, verify=3)
    subjects = [column["subject"] for column in verification["columns"]]
    moving_inputs = {subject.get("moving") for subject in subjects} - {None}
    assert moving_inputs
    assert moving_inputs <= set(sk.load("five_bar").pair_number)


def test_numbers_within_their_own_error_bound_do_not_deviate_too_far(monkeypatch):
    """Coefficients have error bounds in the table; components of directions have none.

    If hardly any rounding is allowed, only the latter deviate by more than that.
    """
    monkeypatch.setattr(verification, "MAX_ROUNDINGS", 1e-3)
    beyond = verify_run(samples=31, verify=6)["beyond"]
    assert "poles.uy" in beyond
    assert "poles.velocity_coefficient" not in beyond
    assert "poles.acceleration_coefficient" not in beyond


@pytest.mark.slow
def test_the_reference_of_an_axis_that_rests_does_not_move():
    """The axis of pair 54 of the five-bar is fixed in link 5, which rests while 21 moves.

    Its derivative is exactly zero and has the error bound 0. The reference value was a
    product of rounded vectors, which do not cancel exactly.
    """
    verification = verify_run("five_bar", samples=5, verify=10)
    derivatives = verification["direction_derivatives"]
    assert derivatives["count"] == derivatives["within_bound"] == 180


@pytest.mark.slow
def test_all_tables_of_a_run_over_time_are_verified():
    verification = verify_run(
        analyses=["eksergian", "poles"], samples=9, verify=3, duration=1.0
    )
    assert verification["not_verified"] == []
    assert verification["beyond"] == []
    tables = {column["table"] for column in verification["columns"]}
    assert tables == {"motion", "poles", "eksergian", "inertia", "loads"}
    assert find_column(verification, "eksergian", "tau")["deviation"] < 1e-13


@pytest.mark.slow
def test_an_analysis_that_has_no_rows_is_named_as_not_verified():
    verification = verify_run(analyses="singularities", samples=9, verify=3)
    assert {column["table"] for column in verification["columns"]} == {"motion"}
    assert "singularities" in format_verification(verification)[-1]


@final
@dataclass(frozen=True, kw_only=True)
class RiseSinceFirstSample(MinimalAnalysis):
    """An analysis of a test: how far an angle has risen since the first sample.

    A row is compared with the first one of its assembly mode, so `compute` needs all rows
    of the run at once. A run that is not divided into blocks gives them.
    """

    name: ClassVar = "risen"
    tables: ClassVar = (
        Table("risen", "", (SAMPLE, ASSEMBLY_MODE, Column("rise", "rad", ""))),
    )

    def needs(self, mechanism):
        # The angle of pair 32 without jumps of whole revolutions.
        return Needs(continued_values=frozenset(["32"]))

    def compute(self, batch):
        # Rows are sorted by assembly mode, then by sample. Both modes have all samples.
        values = batch.continued_value("32").reshape(2, -1)
        rise = values - values[:, :1]
        return {"risen": with_row_columns(batch, rise=rise.ravel())}


PATH_OF_FOUR_TURNS = np.linspace(0.0, -25.0, 160)[:, None]
"""Inputs (160, 1) in rad."""


def test_an_analysis_of_whole_motions_is_verified():
    """Verified rows replace those of the motion, and the analysis is computed again."""
    result = sk.run(
        sk.load("four_bar"), RiseSinceFirstSample(), path=PATH_OF_FOUR_TURNS, verify=9
    )
    verification = result.summary["verified"]
    assert verification["not_verified"] == []
    assert verification["beyond"] == []
    column = find_column(verification, "risen", "rise")
    assert column["compared"]
    assert column["deviation"] < 2e-14
    assert np.ptp(result.frame()["rise"]) > 20.0


def test_angles_that_drift_are_noticed_in_an_analysis_of_whole_motions(monkeypatch):
    """A drift of continued angles by 1e-9 rad per sample is found by the verification.

    Continued angles have no jumps of whole turns. A verification computes the
    configurations of some rows again, here nine. It takes only the number of whole turns
    from the continued angles. A drift much smaller than a turn does not change this number,
    so the reference has no drift.

    For each column the verification states the row that deviates most, with sample, value,
    reference and deviation. Columns whose deviation is too large are listed in `beyond`.
    `RiseSinceFirstSample` is the analysis: the rise of an angle.
    """
    drift_rad = 1e-9
    four_bar = sk.load("four_bar")
    sound = sk.run(four_bar, RiseSinceFirstSample(), path=PATH_OF_FOUR_TURNS).frame()
    continue_angles = sampling.continue_angles

    def continue_angles_with_drift(motion, *more):
        angles = continue_angles(motion, *more)
        return {name: x + drift_rad * motion.sample for name, x in angles.items()}

    monkeypatch.setattr(sampling, "continue_angles", continue_angles_with_drift)
    result = sk.run(four_bar, RiseSinceFirstSample(), path=PATH_OF_FOUR_TURNS, verify=9)
    verification = result.summary["verified"]
    assert "risen.rise" in verification["beyond"]
    column = find_column(verification, "risen", "rise")
    rise = sound.set_index(["sample", "assembly_mode"])["rise"]
    expected = rise[column["sample"], column["assembly_mode"]]  # in the run without drift
    assert column["reference"] == pytest.approx(expected, abs=1e-12)
    assert abs(column["reference"]) > 2.0 * np.pi
    drift_of_row = drift_rad * column["sample"]
    assert column["deviation"] == pytest.approx(drift_of_row, abs=1e-12)


@pytest.mark.parametrize("tolerance_rad", [1e-3, 1e-6])
def test_errors_of_a_simulation_are_within_what_it_states(tolerance_rad):
    """The errors of a simulation are not larger than the errors that its run states.

    To verify six rows, the run computes them again with 50 digits. In this reference the
    loops are closed, but in a simulation they stay open by up to its tolerance. So a row
    deviates from the reference by more than 1e4 times the rounding error. The verification
    allows for open loops, and lists no column as "beyond" the deviation that is allowed.

    Pole directions (axes of relative rotation) are within the error bounds that the run
    states. The error of configurations that the run states is larger than their deviation,
    and at most ten times the tolerance of the simulation.
    """
    summary = sk.run(
        sk.load("four_bar"),
        "eksergian",
        samples=41,
        start=Start(q=0.5, dq=3.0),
        duration=2.0,
        tolerance=tolerance_rad,
        engine="numpy",
        verify=6,
    ).summary
    verification = summary["verified"]
    assert verification["worst"]["in_roundings"] > 1e4
    assert verification["beyond"] == []
    assert summary["warnings"] == []
    directions = verification["directions"]
    assert directions["within_bound"] == directions["count"] > 0
    stated_error = summary["errors_reached"]["largest_configuration_error_rad"]
    assert verification["largest_distance_rad"] < stated_error < 10.0 * tolerance_rad


@pytest.mark.slow
def test_directions_and_rates_of_a_double_butterfly_are_within_their_bounds():
    verification = sk.run("double_butterfly", samples=31, verify=10).summary["verified"]
    for quantity in ("directions", "rates", "rate_derivatives"):
        assert verification[quantity]["count"] == 280
        assert verification[quantity]["within_bound"] == 280


def test_the_command_prints_and_writes_the_verification(tmp_path, capsys):
    """`--verify` without a number verifies up to ten rows."""
    folder = tmp_path / "out"
    assert main(["run", "four_bar", "--samples", "5", "-o", str(folder), "--verify"]) == 0
    printed = capsys.readouterr().out
    assert "verified 10 rows in 50 digits" in printed
    assert "pole directions are within their error bound" in printed
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    assert summary["verified"]["rows"] == 10


def test_wrong_uses_of_verify_are_refused(capsys):
    with pytest.raises(SystemExit) as system_exit:
        main(["run", "four_bar", "--verify", "0"])
    assert system_exit.value.code == 2
    with pytest.raises(SystemExit):
        main(["run", "--verify", "four_bar"])
    assert "put it before --verify" in capsys.readouterr().err


def test_an_analysis_that_fails_when_computed_again_does_not_lose_the_run():
    """The verification of a run lists an analysis that fails when it is computed again.

    The verification computes some rows of the run again, here two (`verify`). Only this
    second computation of the analysis fails. So the run itself has no failure, and the
    columns of its other tables are still verified.
    """

    @dataclass(frozen=True)
    class FailsSecondTime(MinimalAnalysis):
        name: ClassVar = "failing"
        rowwise: ClassVar = True
        tables: ClassVar = ()
        call_count: ClassVar = 0

        def needs(self, mechanism):
            """Ask for the rates of one pole, though they are not used."""
            return Needs(rates=frozenset([(0, 3)]), derivatives=True)

        def compute(self, batch):
            FailsSecondTime.call_count += 1
            if FailsSecondTime.call_count > 1:
                raise RuntimeError("again")
            return {}

    analyses = [FailsSecondTime(), "poles"]
    result = sk.run(sk.load("four_bar"), analyses, samples=3, verify=2)
    assert not result.failures
    verification = result.summary["verified"]
    assert verification["not_verified"] == ["failing"]
    tables = {column["table"] for column in verification["columns"]}
    assert tables == {"motion", "poles"}


def test_references_that_cannot_be_computed_do_not_lose_the_run(monkeypatch):
    def refuse(*arguments, **options):
        raise EngineError("the arc length of a profile does not converge")

    monkeypatch.setattr(verification, "exact_rows_by_input", refuse)
    summary = sk.run(sk.load("four_bar"), samples=3, verify=2).summary
    assert "does not converge" in format_verification(summary["verified"])[0]
    assert "no row was verified" in summary["warnings"][0]


@pytest.mark.parametrize("samples_before", [4, 8])
def test_the_verification_of_a_resumed_run_names_the_samples_it_leaves_out(
    samples_before, tmp_path
):
    """A run of 8 samples is interrupted after some of them, and resumed with `verify`.

    `verify=3` computes three rows again in 50 digits and compares them. The earlier samples
    are not verified. If these are all samples, nothing is verified, and a warning says why.
    """

    def interrupt(done, total):
        if done == samples_before:
            raise KeyboardInterrupt

    options = {"samples": 8, "block": 4, "folder": tmp_path}
    with pytest.raises(KeyboardInterrupt):
        sk.run(sk.load("four_bar"), **options, progress=interrupt)
    summary = sk.run(sk.load("four_bar"), **options, unfinished="resume", verify=3).summary
    lines = format_verification(summary["verified"])
    if samples_before == 8:
        reason = "all samples were computed before the run was resumed"
        assert lines == [f"not verified: {reason}"]
        assert summary["warnings"] == [f"verify: no row was verified: {reason}"]
    else:
        assert lines[0].startswith("verified 3 rows")
        assert lines[-1].strip().startswith("samples before 4 are not verified")
        assert summary["verified"]["worst"]["sample"] >= 4
        assert summary["warnings"] == []


@pytest.mark.parametrize("first_row", [1, -2])
def test_a_table_that_has_other_rows_with_reference_values_is_not_verified(first_row):
    """A table is not verified if reference values give it other rows than the run.

    An analysis of whole motions may choose its rows by their values. The verification
    computes its table once more with reference values (of many digits). Rows that differ
    cannot be compared. The run keeps its table, and the pair variables are still verified.
    With `first_row` 1 the other table has only row 1, with -2 it has the last two rows.
    """
    other_rows = slice(1, 2) if first_row == 1 else slice(first_row, None)

    @dataclass(frozen=True)
    class KeepsOtherRows(MinimalAnalysis):
        """Keeps the first two rows, but `other_rows` in its third calculation.

        The run makes the first calculation. The verification makes the second with the
        values of the run, and the third with the reference values.
        """

        name: ClassVar = "kept"
        tables: ClassVar = (
            Table("kept", "", (SAMPLE, ASSEMBLY_MODE, Column("angle", "rad", ""))),
        )
        call_count: ClassVar = 0

        def needs(self, mechanism):
            return Needs(continued_values=frozenset(["32"]))

        def compute(self, batch):
            KeepsOtherRows.call_count += 1
            rows = other_rows if KeepsOtherRows.call_count == 3 else slice(0, 2)
            columns = with_row_columns(batch, angle=batch.continued_value("32"))
            return {"kept": {name: values[rows] for name, values in columns.items()}}

    result = sk.run(sk.load("four_bar"), KeepsOtherRows(), samples=5, verify=10)
    assert KeepsOtherRows.call_count == 3
    assert len(result.frame()) == 2
    assert not result.failures
    verification = result.summary["verified"]
    assert verification["not_verified"] == ["kept"]
    assert {column["table"] for column in verification["columns"]} == {"motion"}
