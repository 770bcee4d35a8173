"""Rows of analyses that fail where positions do not, and torques that are nothing: said."""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from helpers.refusals import TABLES

import spherekit as sk
from spherekit.cli.main import main

SHIPPED = Path(__file__).parent.parent / "mechanisms"
SHARES_BY_TORQUE = {
    "exp(900 + 0*t)": 1.0,
    "t/(0*t)": 1.0,
    "log(dtheta_{pair} - 1e9)": 1.0,
    "exp(709 + 90*sin(9*theta_{pair}))": None,
    "1/(theta_{pair} - theta_{pair})": 1.0,
    "asin(1e9 + dtheta_{pair}) - exp(1e3 + t)": 1.0,
    "1e300*exp(80*sin(9*theta_{pair}))": None,
}
"""Torque expressions without a finite value, and the share of rows in which they fail.

None means some rows, but not all.
"""
FORCE = 'link = "{link}"\npoint = [0.1, 0.0, 0.1]\nforce = ["exp(900 + t)", "0", "0"]'
LOADS = [
    *(
        (f'pair = "{{pair}}"\ntorque = "{text}"', share)
        for text, share in SHARES_BY_TORQUE.items()
    ),
    (f'kind = "force"\n{FORCE}', 1.0),
    ('kind = "moment"\nlink = "{link}"\nmoment = ["0", "0", "sqrt(-1 - t)"]', 1.0),
]
"""Texts of a load with the pair and the link left open, and the share of failed rows."""


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize(("load_text", "failed_share"), LOADS)
@pytest.mark.parametrize(
    ("name", "pair", "link", "analysis"),
    [
        ("four_bar", "32", "3", "eksergian"),
        ("four_bar", "43", "3", "dynamics"),
        ("five_bar", "32", "3", "dynamics"),
    ],
)
def test_a_load_without_finite_values_fails_only_the_rows_that_need_it(
    tmp_path, capsys, name, pair, link, analysis, load_text, failed_share
):
    """Rows with the load have the status OVERFLOW; all other results are as without it.

    The load is added to a shipped mechanism under the name `huge`. Three tables do not
    depend on it: `inertia`, `outputs` of the analysis `statics`, and the powers of the
    other loads. Tables have one or more rows for each configuration.
    """
    plain = sk.load(name)
    path = tmp_path / "loaded.toml"
    added_text = load_text.format(pair=pair, link=link)
    file_text = (SHIPPED / f"{name}.toml").read_text()
    path.write_text(f"{file_text}\n[loads.huge]\n{added_text}\n")
    loaded = sk.load(path)

    # On the screen: with --strict failed rows give the exit status 3, else 0.
    words = ["run", str(path), "-a", analysis, "-a", "statics", "--samples", "7"]
    assert main([*words, "--strict"]) == 3
    printed = capsys.readouterr().out
    assert f"rows of {analysis} have no result, OVERFLOW" in printed
    assert "OVERFLOW: a load" in printed
    assert main(words) == 0

    # `failed_share` is the share of closed configurations at which the load fails. None
    # stands for some of them, but not all.
    run = sk.run(loaded, [analysis, "statics"], samples=7)
    is_closed = (run.frame("motion")["status"] == "OK").to_numpy()
    has_overflow = run.frame(analysis)["status"] == "OVERFLOW"
    if failed_share is None:
        assert 0.0 < np.mean(has_overflow) < 1.0
    else:
        assert np.mean(has_overflow[is_closed]) == failed_share

    # In the summary of the run.
    for summary in run.summary["analyses"]:
        if summary["name"] == analysis:
            failed_rows = summary["failed_rows"][analysis]
            break
    assert failed_rows == {"OVERFLOW": int(np.sum(has_overflow))}
    assert "OVERFLOW" in run.summary["status_meaning"]
    assert f"of table {analysis} failed" in run._repr_html_()
    json.dumps(run.summary)

    # Results that do not depend on the load.
    run_without = sk.run(plain, [analysis, "statics"], samples=7)
    for analysis_name, table in ((analysis, "inertia"), ("statics", "outputs")):
        rows = run.frame(analysis_name, table)
        expected = run_without.frame(analysis_name, table)
        rows_per_configuration = len(rows) / len(is_closed)
        ok_rows = np.sum(rows["status"] == "OK")
        assert ok_rows > 0
        assert ok_rows == np.sum(is_closed) * rows_per_configuration
        numbers = rows.select_dtypes("number").columns
        np.testing.assert_allclose(rows[numbers], expected[numbers], rtol=1e-12, atol=1e-12)
    load_rows = run.frame(analysis, "loads")
    other_loads = load_rows[load_rows["load"] != "huge"]
    has_power = other_loads["power"].notna()
    is_ok = other_loads["status"] == "OK"
    assert np.array_equal(is_ok, has_power)
    rows_per_configuration = len(other_loads) / len(is_closed)
    assert np.sum(has_power) == np.sum(is_closed) * rows_per_configuration


CANCELS = '[loads.x]\npair = "32"\ntorque = "1/(theta_32 - theta_32)"\n'
CANCELLED = "divides by an expression that is zero everywhere"
POLE = '[loads.x]\npair = "32"\ntorque = "1/theta_21"\n'
BEGUN = ["--start", "q=0,dq=1rad/s", "--duration", "1", "--samples", "5"]
SIZES = ["--vary", "links.2.arc=19:21:3"]
LIMIT = '[[joint_limits]]\npair = "32"\nlow = -inf\nhigh = 1\n'
BEARINGS = """
[loads.x]
kind = "bearings"
pair = "32"
positions = [-0.1, 0.1]
radius = 0.005
coefficient = inf
speed = 1.0
"""
DYNAMICS = ["run", "-a", "dynamics", *BEGUN]
LAW = [
    "run",
    "--law",
    "polynomial:coefficients=0+1e308rad/s+1e308rad/s2",
    "--duration",
    "9",
]
REFUSED = [
    *(
        (f'[loads.x]\npair = "32"\ntorque = "{text}"\n', ["validate"], said)
        for text, said in TABLES["constants"].items()
    ),
    (LIMIT, ["validate"], "joint_limits[0].low"),
    (BEARINGS, ["validate"], "loads.x.coefficient"),
    (CANCELS, ["sweep", *SIZES, "--reduce", "max(torque)"], CANCELLED),
    (CANCELS, DYNAMICS, "fails at its start"),
    (CANCELS, [*DYNAMICS, "--engine", "compiled"], CANCELLED),
    (POLE, DYNAMICS, "fails at its start"),
    ("", [*DYNAMICS, "--torque", "0/0"], "divides by zero"),
    ("", LAW, "not finite"),
]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("added_text", "words", "fragment"), REFUSED)
def test_numbers_that_are_never_finite_are_refused_in_one_sentence(
    tmp_path, capsys, added_text, words, fragment
):
    """The text is added to the file of the four-bar; `words` are command and options."""
    path = tmp_path / "loaded.toml"
    path.write_text((SHIPPED / "four_bar.toml").read_text() + "\n" + added_text)
    command, *options = words
    assert main([command, str(path), *options]) == 1
    printed = capsys.readouterr().err
    assert fragment in printed
    assert "Traceback" not in printed


@pytest.mark.parametrize(
    ("name", "analysis", "sentence"),
    [
        ("bevel_differential", "dynamics", "is 0 throughout"),
        ("five_bar", "statics", "no loads, so there is nothing to hold"),
        ("five_bar", "dynamics", "no loads: the torques balance only the inertia"),
    ],
)
def test_a_run_says_why_torques_are_zero_and_prints_no_rounding_errors(
    capsys, name, analysis, sentence
):
    """No torque of size 1e-19 N m is printed, nor a bare zero."""
    assert main(["run", name, "-a", analysis, "--samples", "37"]) == 0
    printed = capsys.readouterr().out
    assert sentence in printed
    assert "e-19" not in printed
    assert ": 0 N m" not in printed


def test_the_maximum_of_a_design_is_infinite_if_a_row_overflows():
    """The maximum over the remaining rows would be a wrong finite number.

    It is computed by a compiled kernel (`torque`) and from a table (`eksergian.eksergian`).
    """
    load = sk.PairTorque("on_rocker", "41", "exp(700 + 20*sin(3*theta_21))")
    mechanism = sk.load("four_bar").with_loads(load)
    reduce = ["kernel=max(abs(torque))", "table=max(eksergian.eksergian: abs(tau))"]
    frame = sk.sweep(mechanism, {"links.2.arc": [20.0]}, reduce, samples=9).frame()
    assert len(frame) == 2  # assembly modes
    assert np.isposinf(frame[["kernel", "table"]].to_numpy()).all()


@cache
def run_partly_out_of_reach(name, samples):
    """Return a run of the analysis `singularities` in which some inputs are out of reach.

    The five-bar runs on a grid over full turns of its inputs, of which a part is out of its
    reach. The wrist `three_rrr` cannot reach some of its own range.
    """
    mechanism = sk.load(name)
    if name == "five_bar":
        full_turns = {"21": (0.0, 360.0), "51": (0.0, 360.0)}
        mechanism = mechanism.with_inputs(ranges=full_turns, angle_unit="deg")
    run = sk.run(mechanism, "singularities", samples=samples)
    assert "OUT_OF_REACH" in set(run.frame("motion")["status"].astype(str))
    return run


PARTLY_OUT_OF_REACH = pytest.mark.parametrize(
    "name, samples", [("five_bar", (5, 4)), ("three_rrr", (2, 2, 2))]
)


@pytest.mark.slow
@PARTLY_OUT_OF_REACH
def test_rows_of_relations_have_the_status_of_their_configuration(name, samples):
    """Statuses of two tables, whose rows are in different orders, are matched.

    The table of relations has all samples of the first input, then all of the next. The
    table of the motion has a row for each sample and assembly mode.
    """
    run = run_partly_out_of_reach(name, samples)
    relation = run.frame("singularities", "relation")
    motion = run.frame("motion")
    row_keys = ["sample", "assembly_mode"]
    rows = relation.merge(
        motion[[*row_keys, "status"]], on=row_keys, suffixes=("", "_of_motion")
    )
    assert (rows["status"].astype(str) == rows["status_of_motion"].astype(str)).all()


@pytest.mark.slow
@PARTLY_OUT_OF_REACH
def test_rows_of_configurations_out_of_reach_are_no_failures_of_an_analysis(name, samples):
    """The summary of the run counts no failed row of the analysis."""
    (analysis,) = run_partly_out_of_reach(name, samples).summary["analyses"]
    assert analysis["failed_rows"] == {}


def test_rows_out_of_reach_do_not_count_in_the_fractions_of_computed_rows():
    """The five-bar has regular configurations, or none, at the samples of this grid."""
    full_turns = {"21": (0.0, 360.0), "51": (0.0, 360.0)}
    mechanism = sk.load("five_bar").with_inputs(ranges=full_turns, angle_unit="deg")
    summary = sk.run(mechanism, "poles", samples=(5, 4)).summary
    assert summary["status"].keys() == {"OK", "OUT_OF_REACH"}
    assert summary["errors_reached"]["fraction_by_kernel"] == 1.0
    assert summary["errors_reached"]["fraction_by_velocity_equations"] == 0.0
