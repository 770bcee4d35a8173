"""Rows of analyses that fail where positions do not, and torques that are nothing: said."""

import json
from pathlib import Path

import numpy as np
import pytest
from helpers.refusals import TABLES

import spherekit as sk
from spherekit.cli.main import main

SHIPPED = Path(__file__).parent.parent / "mechanisms"
TORQUES = {
    **dict.fromkeys(("exp(900 + 0*t)", "t/(0*t)", "log(dtheta_{pair} - 1e9)"), 1.0),
    "exp(709 + 90*sin(9*theta_{pair}))": None,
    "1/(theta_{pair} - theta_{pair})": 1.0,
    "asin(1e9 + dtheta_{pair}) - exp(1e3 + t)": 1.0,
    "1e300*exp(80*sin(9*theta_{pair}))": None,
}
FORCE = 'link = "{link}"\npoint = [0.1, 0.0, 0.1]\nforce = ["exp(900 + t)", "0", "0"]'
LOADS = [
    *((f'pair = "{{pair}}"\ntorque = "{text}"', share) for text, share in TORQUES.items()),
    (f'kind = "force"\n{FORCE}', 1.0),
    ('kind = "moment"\nlink = "{link}"\nmoment = ["0", "0", "sqrt(-1 - t)"]', 1.0),
]


@pytest.mark.slow
@pytest.mark.many
@pytest.mark.parametrize(("load", "share"), LOADS)
@pytest.mark.parametrize(
    ("name", "pair", "link", "analysis"),
    [
        ("four_bar", "32", "3", "eksergian"),
        ("four_bar", "43", "3", "dynamics"),
        ("five_bar", "32", "3", "dynamics"),
    ],
)
def test_loads_that_are_no_number_leave_inertia_and_the_others(
    tmp_path, capsys, name, pair, link, analysis, load, share
):
    plain, path = sk.load(name), tmp_path / "loaded.toml"
    more = load.format(pair=pair, link=link)
    text = (SHIPPED / f"{name}.toml").read_text()
    path.write_text(f"{text}\n[loads.huge]\n{more}\n")
    made = sk.load(path)
    words = ["run", str(path), "-a", analysis, "-a", "statics", "--samples", "7"]
    assert main([*words, "--strict"]) == 3
    said = capsys.readouterr().out
    assert f"of table {analysis} failed" in said and "OVERFLOW: a load" in said
    assert main(words) == 0
    found = sk.run(made, [analysis, "statics"], samples=7)
    frame = found.frame(analysis)
    closed = (found.frame("motion")["status"] == "OK").to_numpy()
    lost = frame["status"] == "OVERFLOW"
    assert np.mean(lost[closed]) == share if share else 0.0 < np.mean(lost) < 1.0
    facts = next(item for item in found.summary["analyses"] if item["name"] == analysis)
    assert facts["failed_rows"][analysis] == {"OVERFLOW": int(np.sum(lost))}
    assert "OVERFLOW" in found.summary["status_meaning"]
    assert f"of table {analysis} failed" in found._repr_html_()
    json.dumps(found.summary)
    without = sk.run(plain, [analysis, "statics"], samples=7)
    for table in ("inertia", "outputs"):
        of = "statics" if table == "outputs" else analysis
        one, other = (run.frame(of, table) for run in (found, without))
        assert np.sum(one["status"] == "OK") == np.sum(closed) * len(one) / len(closed) > 0
        numbers = one.select_dtypes("number").columns
        np.testing.assert_allclose(one[numbers], other[numbers], rtol=1e-12, atol=1e-12)
    parts = found.frame(analysis, "loads")
    others = parts[parts["load"] != "huge"]
    assert (others["status"] == "OK").equals(others["power"].notna())
    assert np.sum(others["power"].notna()) == np.sum(closed) * len(others) / len(closed)


CANCELS = '[loads.x]\npair = "32"\ntorque = "1/(theta_32 - theta_32)"\n'
CANCELLED = "divides by what is zero everywhere"
POLE = '[loads.x]\npair = "32"\ntorque = "1/theta_21"\n'
BEGUN = ["--start", "q=0,dq=1", "--duration", "1", "--samples", "5"]
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
LAW = ["run", "--law", "polynomial:coefficients=0+1e308+1e308", "--duration", "9"]
REFUSED = [
    *(
        (f'[loads.x]\npair = "32"\ntorque = "{text}"\n', ["validate"], said)
        for text, said in TABLES["constants"].items()
    ),
    (LIMIT, ["validate"], "joint_limits[0].low"),
    (BEARINGS, ["validate"], "loads.x.coefficient"),
    (CANCELS, ["sweep", *SIZES, "--reduce", "max(torque)"], CANCELLED),
    (CANCELS, DYNAMICS, "cannot leave its start"),
    (CANCELS, [*DYNAMICS, "--engine", "compiled"], CANCELLED),
    (POLE, DYNAMICS, "cannot leave its start"),
    ("", [*DYNAMICS, "--torque", "0/0"], "divides by zero"),
    ("", LAW, "not finite"),
]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("more", "words", "said"), REFUSED)
def test_what_is_no_number_is_refused_in_a_sentence(tmp_path, capsys, more, words, said):
    path = tmp_path / "loaded.toml"
    path.write_text((SHIPPED / "four_bar.toml").read_text() + "\n" + more)
    assert main([words[0], str(path), *words[1:]]) == 1
    told = capsys.readouterr().err
    assert said in told and "Traceback" not in told


@pytest.mark.parametrize(
    ("name", "analysis", "said"),
    [
        ("bevel_differential", "dynamics", "zero in every row, to rounding"),
        ("five_bar", "statics", "no loads, so there is nothing to hold"),
        ("five_bar", "dynamics", "no loads: the torques are against inertia alone"),
    ],
)
def test_torques_below_their_rounding_are_zero_and_what_is_not_given_is_said(
    capsys, name, analysis, said
):
    assert main(["run", name, "-a", analysis, "--samples", "37"]) == 0
    told = capsys.readouterr().out
    assert said in told and "e-19" not in told and ": 0 N m" not in told


def test_figures_of_designs_over_rows_that_overflow_are_infinite():
    """By the table as by the kernel; of the rows that are left it would be a number."""
    load = sk.PairTorque("on_rocker", "41", "exp(700 + 20*sin(3*theta_21))")
    made = sk.load("four_bar").with_loads(load)
    reduce = ["kernel=max(abs(torque))", "table=max(eksergian.eksergian: abs(tau))"]
    found = sk.sweep(made, {"links.2.arc": [20.0]}, reduce, samples=9).frame()
    assert np.isposinf(found[["kernel", "table"]].to_numpy()).all() and len(found) == 2
