"""Speed against accuracy: reported errors against 50 digits, and what is recommended."""

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
from spherekit.runs.contract import Sweep
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

FIVE = ("four_bar", "stephenson", "double_butterfly", "shaped_cam", "two_dof_spm")
FEW = (Setting(), Setting(route="conditioned"), Setting(engine="extended"))


@pytest.fixture(autouse=True)
def digits():
    with Digits(50).within():
        yield


def course(mechanism, samples, **given):
    return make_sampling(Study(mechanism.name, mechanism, samples, **given))


def in_fifty_digits(plan):
    """Return the requests of a run, with reference rows of its course in 50 digits."""
    (motion,) = plan.sampling.blocks(len(plan.sampling))
    every = np.ones(len(motion), dtype=bool)
    return [
        (item, exact_rows(motion, every, item.plan.input, Digits(50)))
        for item in plan.requests
    ]


def true_error(plan, setting, reference):
    """Return the largest scaled error of the table `poles`, everything in 50 digits."""
    tables, _, _ = compute_timed_tables(plan.sampling, *plan.analyses, setting)
    data = tables["poles"]
    order = np.lexsort((data["sample"], data["assembly_mode"]))
    first = {name: np.asarray(values)[order] for name, values in data.items()}
    count = sum(len(item.poles) for item, _ in reference)
    worst = {"velocity_coefficient": 0.0, "acceleration_coefficient": 0.0}
    scale = dict.fromkeys(worst, 0.0)
    largest = 0.0
    column = 0
    for item, exact in reference:
        for pole in item.poles:
            own = {name: values[column::count] for name, values in first.items()}
            column += 1
            u = np.stack([own[f"u{c}"] for c in "xyz"], axis=1)
            right = exact_direction(exact, pole, u)
            i, j = pole
            known = (exact.status == Status.OK) & np.all(np.isfinite(u), axis=1)
            off = centre_floats(right - u)[known]
            largest = max(largest, np.max(np.abs(off), initial=0.0))
            for name, w in (
                ("velocity_coefficient", exact.w),
                ("acceleration_coefficient", exact.dw),
            ):
                along = np.sum((w[:, j] - w[:, i]) * right, axis=1)
                off = centre_floats(along - own[name])[known]
                worst[name] = max(worst[name], np.max(np.abs(off), initial=0.0))
                size = np.abs(centre_floats(along)[known])
                scale[name] = max(scale[name], np.max(size, initial=0.0))
    return max(largest, *(worst[name] / scale[name] for name in worst), EPS)


CASES = {
    "four_bar": {"samples": 9},
    "stephenson": {"samples": 7, "assembly_mode": 0},
    "double_butterfly": {"samples": 5, "assembly_mode": 0},
    "shaped_cam": {"samples": 7, "assembly_mode": 0},
    "two_dof_spm": {"samples": 3, "assembly_mode": 0},
}


@pytest.mark.many
@pytest.mark.parametrize("name", FIVE)
def test_reported_errors_are_within_a_factor_two_of_the_true_ones(name):
    made = sk.load(name)
    found = trade(made, "poles", rounds=1, settings=settings(name), **CASES[name])
    plan = make_analysis_plan(course(made, **CASES[name]), create_analysis("poles"))
    reference = in_fifty_digits(plan)
    judged = 0
    for each in found.settings:
        if each.counts:
            true = true_error(plan, each.setting, reference)
            assert 0.5 * true <= each.error <= 2.0 * true, (each.name, each.error, true)
            judged += 1
    assert judged >= 2


def settings(name):
    own = [*FEW, Setting(route="equations")]
    return own if name != "double_butterfly" else own[:2]


def varied(made, random, size=0.02):
    """Return a mechanism with all arcs changed at random a little."""
    links = {
        name: replace(
            own, arcs=tuple(float(x * random.normal(1.0, size)) for x in own.arcs)
        )
        for name, own in made.geometry.links.items()
    }
    return replace(made, geometry=replace(made.geometry, links=links))


LONG = {"four_bar": 181, "stephenson": 91, "two_dof_spm": 31, "shaped_cam": 61}
MANY = [
    *(("four_bar", 6, 91), ("stephenson", 4, 91)),
    *(pytest.param(name, 200, LONG[name], marks=pytest.mark.long) for name in LONG),
]


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize(("name", "count", "samples"), MANY)
def test_recommended_settings_meet_the_tolerance(name, count, samples):
    random = np.random.default_rng(FIVE.index(name))
    given = {"assembly_mode": 0, "search": True}
    while count:
        made = varied(sk.load(name), random)
        tolerance = 10.0 ** random.uniform(-12.0, -3.0)
        try:
            how = {"settings": FEW, "checked": samples // 3, "rounds": 1, **given}
            found = trade(made, "poles", samples=samples, **how)
        except SolveError:  # these arcs cannot be assembled
            continue
        count -= 1
        chosen = found.cheapest(tolerance)
        if chosen is None:
            assert all(MARGIN * each.error > tolerance for each in found.pareto)
            continue
        plan = make_analysis_plan(course(made, samples, **given), create_analysis("poles"))
        (motion,) = plan.sampling.blocks(samples)
        reference = compute_reference_tables(plan, motion)
        tables, _, _ = compute_timed_tables(
            plan.sampling, *plan.analyses, chosen.setting, reference.pole_fields
        )
        for each in measure_deviations(plan, tables, reference.tables):
            assert each.error <= tolerance and not each.missing, (chosen.name, each)


def test_what_is_dominated_is_not_on_the_front():
    found = trade(sk.load("four_bar"), samples=37, settings=FEW, rounds=1)
    for each in found.pareto:
        for other in found.settings:
            if other.counts and other.error <= each.error:
                assert other.total >= each.total
    errors = [each.error for each in found.pareto]
    assert errors == sorted(errors, reverse=True)


ALIKE = ((1.0, 1e-10), (1.05, 1e-15), (1.5, 1e-16))
"""Times of settings, of which the first two are alike, and their errors."""


@pytest.mark.slow
def test_the_cheapest_depends_on_the_number_of_samples_and_of_alike_ones_on_the_error():
    """Nodes are evaluated once, so their price falls with the number of samples."""
    made = sk.load("four_bar")
    found = trade(made, samples=1_000_000, settings=FEW[:1], checked=361, rounds=1)
    assert 361 < found.checked < 700
    for samples, cheapest in ((1_000, 0), (1_000_000, 1)):
        every = Measured("every", FEW[0], 1e-5 * samples, error=1e-15)
        nodes = Measured("nodes", FEW[-1], 0.1 + 1e-6 * samples, error=1e-9)
        given = replace(found, samples=samples, settings=(every, nodes))
        assert given.cheapest(1e-6) is given.settings[cheapest]
        assert given.cheapest(1e-12) is every
    alike = [replace(every, seconds=10.0 * k, error=e) for k, e in ALIKE]
    given = replace(found, settings=tuple(alike))
    assert given.cheapest(1e-6) is given.cheapest(1e-12) is alike[1]
    assert given.cheapest(4e-16) is alike[2]


@pytest.mark.slow
def test_missing_numbers_are_not_chosen():
    """The first great circles of the Stephenson fail where two of its poles meet."""
    made = sk.load("stephenson")
    found = trade(made, samples=361, settings=[Setting(), Setting(route="first")], rounds=1)
    best, first = found.settings
    assert best.counts and first.missing > 0 and not first.counts


@pytest.mark.parametrize("tolerance", [0.0, -1e-9, np.nan, np.inf])
def test_no_tolerance(tolerance):
    with pytest.raises(AnalysisError, match="give a positive number"):
        choose(Study("x", sk.load("four_bar"), 9), [create_analysis("poles")], tolerance)


@pytest.mark.slow
def test_an_analysis_trades_its_own_parameters():
    found = trade(sk.load("five_bar"), "workspace", rounds=1)
    assert next(each.name for each in found.settings) == "tolerance=0.01"
    assert all(np.isfinite(each.own_estimate) for each in found.settings)
    found = trade(sk.load("four_bar"), "sensitivity", rounds=1, samples=3)
    assert found.derivatives is None
    assert [each.name for each in found.settings] == [
        f"draws={count}" for count in (16, 64, 256, 1024)
    ]
    errors = [each.error for each in found.settings]
    assert errors[0] > 5.0 * errors[-1] > 0.0
    assert not any(each.missing for each in found.settings)


@dataclass(frozen=True, kw_only=True)
class Beside(MinimalAnalysis):
    """A place next below zero, or at zero."""

    name: ClassVar = "beside"
    reads_samples: ClassVar = False
    tables: ClassVar = (Table("beside", "", (Column("x", "rad", ""),)),)
    trades: ClassVar = (Sweep("off", (1e-17, 0.0), "beside", "x", (), places=True),)
    off: float = 0.0

    def compute(self, batch):
        return {"beside": {"x": np.array([-self.off])}}


def test_a_place_next_below_a_turn_is_next_to_zero():
    (each,) = trade(sk.load("four_bar"), Beside(), rounds=1).settings
    assert each.error < 1e-15 and not each.missing


@pytest.mark.slow
def test_places_of_singularities_are_compared_with_the_nearest():
    found = trade(sk.load("four_bar"), "singularities", rounds=1)
    assert found.reference == "the tightest: samples=1441"
    for each in found.settings:  # they are refined between samples
        assert each.error < 1e-12 and not each.missing
    assert found.columns[0][:2] == ("singularities.q", "absolute rad")


@pytest.mark.slow
def test_the_command_says_what_is_reached(capsys, tmp_path):
    pytest.importorskip("matplotlib")
    given = ["four_bar", "--samples", "13", "--rounds", "1"]
    assert main(["trade", *given, "--tol", "1e-30", "-o", str(tmp_path)]) == 0
    text = capsys.readouterr().out
    assert "for 1e-30: no setting meets it with a margin of 4; the best reached is" in text
    rows = json.loads((tmp_path / "trade.json").read_text())["settings"]
    lines = (tmp_path / "trade.csv").read_text().splitlines()
    assert len(lines) == 1 + len(rows)
    assert (tmp_path / "trade.png").read_bytes().startswith(b"\x89PNG")


def test_a_short_run_makes_no_trade_and_says_what_it_reached(capsys):
    assert main(["run", "four_bar", "--samples", "31", "--tol", "1e-9", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["accuracy"]
    assert found["met"] and found["setting"] == "numpy best"
    assert found["achieved_error"] < 1e-13 and found["check_rows"] == 62
    assert f"fewer than {MIN_SAMPLES_FOR_TRADE}" in found["why"]


def test_a_long_run_takes_the_cheapest_setting(capsys):
    count = MIN_SAMPLES_FOR_TRADE
    text = f"run four_bar -a poles:only=31 --samples {count} --assembly-mode 0 --tol 1e-6"
    assert main(text.split()) == 0
    lines = capsys.readouterr().out.splitlines()
    (line,) = [x for x in lines if x.startswith("tolerance")]
    assert "the cheapest of a short trade of poles" in line and "NOT MET" not in line


def stored_trade(folder, *words):
    """Return where a short trade of the four-bar is stored."""
    given = ["four_bar", "--rounds", "1", "-q", *words]
    assert main(["trade", *given, "-o", str(folder)]) == 0
    return str(folder)


COUNTED = ("error", "seconds")
RUN = ("--samples", "200", "--assembly-mode", "0")
MOVED = ("-a", "eksergian", "--start", "q=0.5,dq=3", "--duration", "0.3", "--samples", "9")


@pytest.mark.slow
def test_a_run_takes_a_stored_trade(capsys, stored):
    given = ["run", "four_bar", *RUN, "--tol", "1e-5", "--trade", stored, "--json"]
    assert main(given) == 0
    found = json.loads(capsys.readouterr().out)["accuracy"]
    again = read_trade(stored)
    assert found["setting"] == again.cheapest(1e-5).name
    assert "stored trade of poles" in found["why"] and found["met"]
    assert found["achieved_error"] <= 1e-5 and found["check_rows"] == 61
    tight = 2.0 * again.cheapest(1e-5).error  # which is met without the margin of 4 only
    assert main([*given[:-4], repr(tight), *given[-3:]]) == 0
    found = json.loads(capsys.readouterr().out)["accuracy"]
    assert "no setting" in found["why"] or 4.0 * found["predicted_error"] <= tight
    written = json.loads((Path(stored) / "trade.json").read_text())
    for each, row in zip(again.settings, written["settings"], strict=True):
        for key in ("name", "missing", "reason", *([] if each.reason else COUNTED)):
            assert getattr(each, key) == row[key], key
        assert each.reason or str(each.setting) == each.name


@pytest.mark.slow
def test_a_simulation_takes_integrator_and_tolerance_of_a_stored_trade(
    capsys, tmp_path, monkeypatch
):
    monkeypatch.setattr(
        "spherekit.runs.simulation_measurement.TOLERANCES_RAD", [1e-4, 1e-7, 1e-11]
    )
    kept = stored_trade(tmp_path, *MOVED)
    capsys.readouterr()
    given = ["run", "four_bar", *MOVED, "--trade", kept]
    assert main([*given, "--tol", "1e-8", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    chosen = read_trade(kept).cheapest(1e-8)
    assert found["accuracy"]["setting"] == chosen.name and found["accuracy"]["met"]
    assert found["simulation"]["tolerance"] == chosen.setting.tolerance
    assert found["simulation"]["engine"]["name"] == chosen.setting.integrator
    assert main([*given, "--tol", "1e-17"]) == 0
    assert "by that trade: THE TOLERANCE IS NOT MET" in capsys.readouterr().out
    assert main([*given, "--tol", "1e-8", "--engine", "numpy"]) == 1


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        (("--samples", "201", "--assembly-mode", "0"), "samples: 200 there, 201 now"),
        (("--samples", "200"), "assembly mode: 0 there, null now"),
        ((*RUN, "-a", "poles:only=31"), "parameters:"),
        ((*RUN, "-a", "eksergian"), "analysis poles, which is not run"),
        ((*RUN, "-a", "poles", "-a", "eksergian"), "there is none of eksergian"),
        ((*RUN, "--law", "constant_speed:speed=2", "--duration", "1"), "laws:"),
    ],
)
def test_a_trade_of_another_run_is_refused(changed, words, capsys, stored):
    assert main(["run", "four_bar", *changed, "--tol", "1e-5", "--trade", stored]) == 1
    said = capsys.readouterr().err
    assert words in said and ("leave" in said or "make it" in said)


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    return stored_trade(tmp_path_factory.mktemp("trade"), *RUN)


def test_a_trade_of_another_mechanism_or_version_is_refused(capsys, stored, tmp_path):
    given = [*RUN, "--tol", "1e-5", "--trade"]
    assert main(["run", "stephenson", *given, stored]) == 1
    assert "mechanism: four_bar there, stephenson now" in capsys.readouterr().err
    data = json.loads((Path(stored) / "trade.json").read_text())
    data["made_for"] |= {"mechanism_hash": "0" * 64, "spherekit": "0.0.1"}
    (tmp_path / "trade.json").write_text(json.dumps(data))
    assert main(["run", "four_bar", *given, str(tmp_path)]) == 1
    said = capsys.readouterr().err
    assert "spherekit: 0.0.1 there" in said and "mechanism hash: 000" in said


@pytest.mark.parametrize("text", [None, "not JSON", "[]", "{}", '{"settings": 1}'])
def test_what_is_no_trade_is_refused(text, capsys, tmp_path):
    if text is not None:
        (tmp_path / "trade.json").write_text(text)
    given = ["run", "four_bar", "--trade", str(tmp_path)]
    assert main([*given, "--tol", "1e-5"]) == 1
    said = capsys.readouterr().err
    assert " trade" in said and "write one with: spherekit trade" in said
    assert main(given) == 1
    assert "with --tol T" in capsys.readouterr().err
