"""`run --verify`: what it says, against closed forms, and that it finds what is wrong."""

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


def verified(name="four_bar", analyses="poles", **words):
    return sk.run(sk.load(name), analyses, **words).summary["verified"]


def column(verdict, table, name):
    items = {(item["table"], item["column"]): item for item in verdict["columns"]}
    return items[table, name]


def test_columns_deviate_by_rounding_and_references_are_right():
    verdict = verified(samples=31, verify=6)
    assert verdict["rows"] == 6
    assert verdict["beyond"] == [] and verdict["without_reference"] == []
    assert verdict["largest_distance_rad"] < 1e-14
    assert 1.0 < verdict["largest_condition"] < 100.0
    bounds = ("error", "velocity_coefficient_error", "acceleration_coefficient_error")
    bounds = (*bounds, "direction_dq_error")
    left = {"poles.conditioning", *(f"poles.{name}_bound" for name in bounds)}
    assert set(verdict["not_recomputed"]) == left
    item = column(verdict, "poles", "acceleration_coefficient")
    assert item["deviation"] < 1e-14
    assert item["deviation"] == pytest.approx(
        abs(item["value"] - item["reference"]), abs=1e-18
    )
    theta = column(verdict, "motion", "theta_41")
    made = sk.load("four_bar")
    with mp.workdps(50):
        q = mp.mpf(float(np.linspace(0.0, made.inputs[0].stop, 31)[theta["sample"]]))
        forms = [angle(arcs_of(made), q, mode) + mp.pi - mp.mpf(np.pi) for mode in (0, 1)]
        off = min(abs(mp.expj(theta["reference"]) - mp.expj(form)) for form in forms)
        assert off < 2 * EPS
    directions = verdict["directions"]
    assert directions["count"] == directions["within_bound"] == 36
    assert 0.01 < directions["over_bound"] <= 1.0
    assert directions["error"] == pytest.approx(
        directions["over_bound"] * directions["bound"]
    )


def test_the_same_rows_whatever_the_blocks():
    """And among them those with the largest residual, error bound and conditioning."""
    one, other = (
        verified("stephenson", samples=21, verify=5, block=block) for block in (4, 512)
    )
    for verdict in (one, other):
        del verdict["seconds"]
    assert one == other
    seen = []

    class Spy(Verifier):
        def verify(self, failed=()):
            seen.append(self._selected)
            return super().verify(failed)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(runner, "Verifier", Spy)
        result = sk.run(sk.load("stephenson"), samples=21, verify=9)
    motion, poles = result.frame("motion"), result.frame("poles")
    rows = set(zip(seen[0].motion.sample, seen[0].motion.assembly_mode, strict=True))
    assert len(rows) == 9
    for frame, name in ((motion, "residual"), (poles, "error_bound")):
        worst = frame.loc[frame[name].idxmax()]
        assert (worst["sample"], worst["assembly_mode"]) in rows
    whole = sk.trace(sk.load("stephenson"), samples=21)
    worst = int(np.argmax(whole.conditioning))
    assert (whole.sample[worst], whole.assembly_mode[worst]) in rows
    assert len({assembly_mode for _, assembly_mode in rows}) > 2
    spread = sorted(sample for sample, _ in rows)
    assert spread[0] < 7 and spread[-1] > 13


@pytest.fixture
def perturbed(monkeypatch):
    """Have a change made in all fields of poles."""

    def perturb(change):
        def wrong(motion, wanted, memory=None, *rest):
            field = evaluate(motion, wanted, memory)
            change(field)
            return field

        monkeypatch.setattr(summary, "evaluate", wrong)

    return perturb


def test_a_wrong_rate_is_found(perturbed, capsys):
    perturbed(lambda field: np.multiply.at(field.w[3], slice(None), 1.0 + 1e-8))
    item = column(verified(analyses="eksergian", samples=9, verify=3), "inertia", "B")
    assert item["subject"] == {"link": "4"}
    assert item["deviation"] == pytest.approx(2e-8 * item["reference"], rel=1e-6)
    perturbed(lambda field: np.add.at(field.velocity_coefficient[0, 3], slice(None), 1e-9))
    arguments = ["run", "four_bar", "--samples", "9", "--verify", "4"]
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    assert "poles.velocity_coefficient: off by 1.0e-09 at sample" in printed
    assert "worst row: " in printed and "link 4, relative_to 1, moving 21: poles" in printed
    assert "verify: poles.velocity_coefficient deviate by more than rounding" in printed
    assert main([*arguments, "--strict"]) == 3


def test_a_wrong_direction_is_outside_its_bound(perturbed):
    perturbed(lambda field: np.add.at(field.direction[1, 3], np.s_[:, 1], 1e-10))
    verdict = verified(samples=9, verify=4)
    assert any(
        "4 of 24 pole directions are off" in fault
        for fault in verification_failures(verdict)
    )
    directions = verdict["directions"]
    assert directions["within_bound"] == directions["count"] - 4
    assert directions["subject"]["link"] == "4"
    assert directions["error"] == pytest.approx(1e-10, rel=0.5)


def verifier_of(tracer, count):
    made = tracer.mechanism
    wanted = request(made, "21", [(0, 3)], [(0, 3)])
    course = Sampling(tracer, tracer.input_grid.q, tracer.input_grid.shape, None, False, {})
    plan = RunPlan(course, (), (), {}, (wanted,), ORDINARY, course, len(course), [])
    return wanted, Verifier(plan, count)


def test_a_wrong_configuration_has_no_reference():
    tracer = PositionAnalysis(sk.load("four_bar"), samples=7)
    motion = tracer.motion()
    wanted, verifier = verifier_of(tracer, 20)
    values = motion.values.copy()
    values[3, 1] += 1e-4
    values[5, 1] += 1e-8
    moved = replace(motion, values=values)
    verifier.check_block(moved, (evaluate(moved, wanted),), {})
    verdict = verifier.verify()
    assert verdict["rows"] == len(motion)
    (lost,) = verdict["without_reference"]
    assert lost["sample"] == motion.sample[3] and lost["status"] == "MODE_LOST"
    assert lost["assembly_mode"] == motion.assembly_mode[3]
    assert lost["distance_rad"] == pytest.approx(1e-4, rel=0.5)
    assert "motion.theta_32" in verdict["beyond"]
    item = column(verdict, "motion", "theta_32")
    assert item["sample"] == motion.sample[5]
    assert item["deviation"] == pytest.approx(1e-8, rel=1e-6)
    text = "\n".join(format_verification(verdict))
    assert f"no reference at sample {motion.sample[3]}, assembly mode 0: MODE_LOST" in text
    assert len(verification_failures(verdict)) == 2


@pytest.mark.slow
def test_several_inputs_times_and_analyses_of_whole_motions():
    verdict = verified("five_bar", samples=9, verify=3)
    moved = {item["subject"].get("moving") for item in verdict["columns"]} - {None}
    assert moved <= set(sk.load("five_bar").pair_number) and moved
    mixed = verified(analyses=["eksergian", "poles"], samples=9, verify=3, duration=1.0)
    assert mixed["not_verified"] == [] and mixed["beyond"] == []
    tables = {item["table"] for item in mixed["columns"]}
    assert tables == {"motion", "poles", "eksergian", "inertia", "loads"}
    assert column(mixed, "eksergian", "tau")["deviation"] < 1e-13
    alone = verified(analyses="singularities", samples=9, verify=3)
    assert {item["table"] for item in alone["columns"]} == {"motion"}
    assert "singularities" in format_verification(alone)[-1]


@final
@dataclass(frozen=True, kw_only=True)
class Risen(MinimalAnalysis):
    """By how much a variable rose since the first sample, which one block cannot say."""

    name: ClassVar = "risen"
    tables: ClassVar = (
        Table("risen", "", (SAMPLE, ASSEMBLY_MODE, Column("rise", "rad", ""))),
    )

    def needs(self, mechanism):
        return Needs(continued_values=frozenset(["32"]))

    def compute(self, batch):
        values = batch.continued_value("32").reshape(2, -1)
        return {"risen": with_row_columns(batch, rise=(values - values[:, :1]).ravel())}


def test_whole_motions_have_their_rows_replaced(monkeypatch):
    """Angles that drift away show in what an analysis makes of all samples at once.

    The row that is off most is then the last one that is verified, several turns on.
    """
    drift = 1e-9
    right = sampling.continue_angles
    path = np.linspace(0.0, -25.0, 160)[:, None]
    result = sk.run(sk.load("four_bar"), Risen(), path=path, verify=9)
    verdict, sound = result.summary["verified"], result.frame()
    assert verdict["not_verified"] == [] and verdict["beyond"] == []
    found = column(verdict, "risen", "rise")
    assert found["compared"] and found["deviation"] < 2e-14
    assert np.ptp(sound["rise"]) > 20.0

    def drifting(motion, *how):
        angles = right(motion, *how)
        return {name: angle + drift * motion.sample for name, angle in angles.items()}

    monkeypatch.setattr(sampling, "continue_angles", drifting)
    result = sk.run(sk.load("four_bar"), Risen(), path=path, verify=9)
    verdict = result.summary["verified"]
    assert "risen.rise" in verdict["beyond"]
    found = column(verdict, "risen", "rise")
    sound = sound.set_index(["sample", "assembly_mode"])["rise"]
    wanted = sound[found["sample"], found["assembly_mode"]]
    assert found["reference"] == pytest.approx(wanted, abs=1e-12)
    assert abs(found["reference"]) > 2.0 * np.pi
    assert found["deviation"] == pytest.approx(drift * found["sample"], abs=1e-12)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6])
def test_simulations_are_off_by_their_own_errors(tolerance):
    """Loops of a simulation stay open by its tolerance, not by rounding."""
    summary = sk.run(
        sk.load("four_bar"),
        "eksergian",
        samples=41,
        start=Start(q=0.5, dq=3.0),
        duration=2.0,
        tolerance=tolerance,
        engine="numpy",
        verify=6,
    ).summary
    verdict = summary["verified"]
    assert verdict["worst"]["in_roundings"] > 1e4
    assert verdict["beyond"] == [] and summary["warnings"] == []
    directions = verdict["directions"]
    assert directions["within_bound"] == directions["count"] > 0
    known = summary["errors_reached"]["largest_configuration_error_rad"]
    assert verdict["largest_distance_rad"] < known < 10.0 * tolerance


@pytest.mark.slow
def test_rates_of_driven_links_are_within_bounds_of_zero():
    told = sk.run("double_butterfly", samples=31, verify=10).summary["verified"]
    for name in ("directions", "rates", "rate_derivatives"):
        assert told[name]["count"] == told[name]["within_bound"] == 280


def test_the_command_prints_and_writes_it(tmp_path, capsys):
    folder = tmp_path / "out"
    assert main(["run", "four_bar", "--samples", "5", "-o", str(folder), "--verify"]) == 0
    printed = capsys.readouterr().out
    assert "verified 10 rows in 50 digits" in printed
    assert "pole directions lie within their error bound" in printed
    written = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    assert written["verified"]["rows"] == 10
    with pytest.raises(SystemExit) as ended:
        main(["run", "four_bar", "--verify", "0"])
    assert ended.value.code == 2
    with pytest.raises(SystemExit):
        main(["run", "--verify", "four_bar"])
    assert "write the file before --verify" in capsys.readouterr().err


def test_faults_of_a_plugin_or_a_profile_do_not_lose_the_run(monkeypatch):
    class Failing(MinimalAnalysis):
        name, rowwise, tables = "failing", True, ()
        calls = 0

        def needs(self, mechanism):
            return Needs(rates=frozenset([(0, 3)]), derivatives=True)

        def compute(self, batch):
            Failing.calls += 1
            if Failing.calls > 1:
                raise RuntimeError("again")
            return {}

    Failing = dataclass(frozen=True)(Failing)
    result = sk.run(sk.load("four_bar"), [Failing(), "poles"], samples=3, verify=2)
    verdict = result.summary["verified"]
    assert verdict["not_verified"] == ["failing"] and not result.failures
    assert {item["table"] for item in verdict["columns"]} == {"motion", "poles"}

    def refused(*words, **more):
        raise EngineError("the arc length of a profile does not converge")

    monkeypatch.setattr(verification, "exact_rows_by_input", refused)
    summary = sk.run(sk.load("four_bar"), samples=3, verify=2).summary
    assert "does not converge" in format_verification(summary["verified"])[0]
    assert "no row was verified" in summary["warnings"][0]
