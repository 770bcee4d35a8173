"""A file without ``[inputs]`` is the file that drives its first R pair through one turn."""

import json
import re
import tomllib
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest

import spherekit as sk
from spherekit.cli.main import main
from spherekit.errors import ModelError, PlanError
from spherekit.files.library import find

WIPER = Path(__file__).parent / "files" / "wiper.toml"
COST = re.compile(r"cost: .*\n")
"""Line with times on the screen, which differ from run to run."""


def without_inputs(name):
    """Return the text of a shipped mechanism without its table of inputs."""
    text = find(name).read_text("utf-8")
    return re.sub(r"\[inputs\.\w+\]\n(?:\w+ = .*\n)*", "", text)


TEXTS = {
    "wiper": WIPER.read_text("utf-8"),
    **{
        name: without_inputs(name)
        for name in ("universal_joint", "four_bar", "stephenson", "roller_cam", "watt")
    },
}
"""One dyad, Hooke's joint, masses and loads, two dyads, a contact, another six-bar."""


MARKS = dict.fromkeys(TEXTS, pytest.mark.slow)
MARKS |= {"wiper": (), "stephenson": pytest.mark.long, "watt": pytest.mark.long}


@pytest.fixture(params=[pytest.param(name, marks=MARKS[name]) for name in TEXTS])
def files(request, tmp_path):
    """Return the paths of a file without inputs, and of the same with its input stated."""
    text = TEXTS[request.param]
    tables = tomllib.loads(text)
    assert "inputs" not in tables
    first = next(name for name, pair in tables["pairs"].items() if pair["type"] == "R")
    paths = []
    for folder, added_text in (("silent", ""), ("stated", f"\n[inputs.{first}]\n")):
        (tmp_path / folder).mkdir()
        path = tmp_path / folder / f"{request.param}.toml"
        path.write_text(text + added_text, "utf-8")
        paths.append(path)
    return paths


def said(capsys, *words):
    """Return what a command prints, without times and folders, and its exit status.

    Progress of a search goes to the stream of errors, and depends on the time it takes.
    """
    status = main([str(word) for word in words])
    texts = capsys.readouterr()
    text = re.sub(r"(silent|stated)", "folder", texts.out + texts.err * bool(status))
    return status, COST.sub("", text)


ALL = (
    "poles",
    "singularities",
    "sensitivity",
    "statics",
    "dynamics",
    "reactions",
    "eksergian",
)
QUICK = ("singularities", "statics", "eksergian")


@pytest.mark.many
@pytest.mark.parametrize(
    "more", [(), pytest.param(("--only-needed",), marks=pytest.mark.slow)]
)
@pytest.mark.parametrize(
    "analysis",
    [pytest.param(x, marks=() if x in QUICK else pytest.mark.slow) for x in ALL],
)
def test_runs_without_inputs_equal_runs_with_the_first_pair_as_input(
    analysis, more, files, tmp_path, capsys
):
    """Results of an analysis are equal for a file without inputs and with the default one.

    By default the first R pair (revolute joint) is the input. Printed text, tables and the
    summary of both runs are compared without tolerance. An analysis that refuses the
    mechanism has to do so in the same words. `more` are further options of the command.
    `files` has the paths of both files. `said` runs a command and returns its status and
    text.
    """
    printed = []
    tables = []
    summaries = []
    for path in files:
        folder = tmp_path / f"{path.parent.name}_out"
        command = ["run", path, "-a", analysis, "--samples", 9, *more, "-o", folder]
        printed.append(said(capsys, *command))
        tables.append({x.name: pd.read_parquet(x) for x in folder.glob("*.parquet")})
        summary = folder / "summary.json"
        summaries.append(json.loads(summary.read_text()) if summary.exists() else {})
    assert printed[0] == printed[1]
    assert tables[0].keys() == tables[1].keys()
    for name, table in tables[0].items():
        pd.testing.assert_frame_equal(table, tables[1][name], check_exact=True)
    for key in ("mechanism_hash", "inputs", "assembly_modes", "completeness"):
        assert summaries[0].get(key) == summaries[1].get(key)


COMMANDS = {
    "validate": (),
    "plan": ("--steps",),
    **{f"explain {name}": ("-a", name) for name in ALL},
    "explain --only-needed": ("-a", "singularities", "--only-needed"),
    "certify": ("--at", "40"),
}
QUICK_COMMANDS = ("validate", "plan", "explain poles", "explain --only-needed", "certify")


@pytest.mark.parametrize(
    "command",
    [
        pytest.param(x, marks=() if x in QUICK_COMMANDS else pytest.mark.slow)
        for x in COMMANDS
    ],
)
def test_commands_agree(command, files, capsys):
    word, *_ = command.split()
    one, other = (said(capsys, word, path, *COMMANDS[command]) for path in files)
    assert one == other


LANGUAGES = ("c", "cpp", "js", "python", "julia", "latex", "mjcf")


@pytest.mark.parametrize("language", [*LANGUAGES, "page"])
def test_what_is_written_agrees(language, files, tmp_path, capsys):
    command = ("page",) if language == "page" else ("export", "--to", language)
    written = []
    for path in files:
        target = tmp_path / f"{path.parent.name}_file"
        status, _ = said(capsys, command[0], path, *command[1:], "-o", target)
        text = target.read_text("utf-8") if target.exists() else ""
        written.append((status, text.replace(path.parent.name, "")))
    assert written[0] == written[1]


def test_sweeps_trades_and_evaluations_without_inputs_equal_those_with_one(files):
    """A file without inputs has the default input, as if the file stated it.

    By default the first R pair (revolute joint) turns once. Compared are a sweep over an
    arc, a trade of accuracy for time, and `evaluate` at two inputs. `files` has the paths
    of the file without inputs and of the one that states the default.
    """
    silent, stated = map(sk.load, files)
    assert silent == stated
    assert silent.content == stated.content
    links = silent.geometry.links
    arc_link = next(name for name, sizes in links.items() if len(sizes.arcs) == 1)
    vary = {f"links.{arc_link}.arc": [70.0, 71.0]}
    merit = f"swing=range(theta_{silent.pairs[1].name})"
    silent_sweep = sk.sweep(silent, vary, merit, samples=5).frame()
    stated_sweep = sk.sweep(stated, vary, merit, samples=5).frame()
    pd.testing.assert_frame_equal(silent_sweep, stated_sweep)

    silent_trade = sk.trade(silent, samples=5, rounds=1)
    stated_trade = sk.trade(stated, samples=5, rounds=1)
    assert silent_trade.made_for == stated_trade.made_for
    assert silent_trade.rows == stated_trade.rows > 0

    q = [0.5, 0.7]
    silent_rows = sk.evaluate(silent, q).frame()
    assert silent_rows.equals(sk.evaluate(stated, q).frame())


def test_the_wiper_has_four_singularities_of_type_i(capsys):
    """Where crank and coupler are in line the blade rests: two closed forms.

    The blade turns back where its joint is at the distance 80 + 25 or 80 - 25 deg from
    the motor. The motor is then at the angle of a triangle with the sides 75, that
    distance and 45 deg, at the motor's axis, or half a turn from it.
    """
    status, text = said(capsys, "run", WIPER, "-a", "singularities", "--only-needed")
    assert status == 0
    assert "4 of type I" in text and "2 assembly modes" in text
    assert "33.935, 225.086 deg in mode 1; 134.914, 326.065 deg in mode 0" in text
    status, text = said(capsys, "explain", WIPER, "-a", "singularities")
    assert status == 0 and "dyad: pairs tip, joint, hinge" in text


@pytest.mark.slow
def test_no_mode_is_lost_by_leaving_out_what_is_not_needed(capsys):
    """Hooke's joint has two modes, also where its shipped file states no input."""
    for more in ((), ("--only-needed",)):
        _, text = said(capsys, "run", "universal_joint", "-a", "singularities", *more)
        assert "2 assembly modes" in text


def test_the_default_gives_way_to_a_lock():
    """The next R pair is driven where the first one, which no file drives, is locked."""
    undriven = replace(sk.load("five_bar"), inputs=())
    (only,) = undriven.inputs
    assert only.is_default and only.pair == undriven.pairs[0].name
    rest = sk.lock(undriven, {only.pair: 80.0}, angle_unit="deg")
    assert rest.inputs[0].is_default and rest.inputs[0].pair == rest.pairs[0].name
    driven = undriven.with_inputs(only.pair)
    assert not driven.inputs[0].is_default
    with pytest.raises(ModelError, match="no link can move"):
        sk.lock(driven, {only.pair: 80.0}, angle_unit="deg")
    with pytest.raises(PlanError, match="2"):
        sk.plan(undriven)
