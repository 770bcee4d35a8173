"""Mistakes in files, commands and calls are told by the words of one table.

Nothing is traced, searched or integrated before a mistake in a file or command is told.
"""

import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.broken_plugins import Tuned
from helpers.refusals import (
    TABLES,
    check_call,
    check_fragments,
    mechanism_text,
    replace_passages,
)
from mechanism_examples.named_mechanisms import LINKS, four_bar_from_file, two_four_bars

import spherekit as sk
from spherekit.cli.main import main
from spherekit.designs.design_space import range_variation
from spherekit.dynamics.forward_dynamics import simulate
from spherekit.dynamics.inverse_dynamics import inverse_dynamics
from spherekit.dynamics.reduced_model_maker import reduced_model
from spherekit.errors import FileError
from spherekit.exchange.mjcf import MujocoModel
from spherekit.files.mechanism_reader import loads
from spherekit.files.study import Start
from spherekit.files.time_law import ConstantSpeed, Tabulated
from spherekit.geometry.direction_region import find_region
from spherekit.positions.loop_closure import Closure
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.runs.registry import registered
from spherekit.runs.trade import trade
from spherekit.singularities.aspects import aspects
from spherekit.singularities.single_freedom import SingleFreedomSingularities
from spherekit.singularities.singular_curves import singular_curves
from spherekit.singularities.singular_surface import singular_surface
from spherekit.singularities.stationarity import output_of

TEMPLATE = Path(sk.__file__).parent / "cli" / "templates" / "four_bar.toml"
MECHANISMS = (
    *("sizes", "pose", "cones", "cam", "pinned_roller", "slider", "posed_slider"),
    "loaded",
)
STUDIES = "study.study", "constant.study", "table.study", "timed.study"
CALLED = (
    *(
        MujocoModel,
        PositionAnalysis,
        SingleFreedomSingularities,
        Tabulated,
        aspects,
        range_variation,
        four_bar_from_file,
    ),
    *(find_region, inverse_dynamics, output_of, reduced_model, replace, simulate),
    *(singular_curves, singular_surface, trade, two_four_bars),
)
NAMES = {each.__name__: each for each in CALLED} | {
    **{"sk": sk, "np": np, "LINKS": LINKS, "NAN": float("nan")},
    **{"FOUR_BAR": sk.load("four_bar"), "FIVE_BAR": sk.load("five_bar")},
    **{"START": Start(0.3, 1.0), "LAW": ConstantSpeed(1.0)},
}
SHOWS_A_POSE = "run five_bar -a inverse_kinematics"
"""Its message has a pose that the mechanism reaches, which takes a configuration."""


@pytest.fixture(autouse=True)
def folder(request, monkeypatch, tmp_path):
    """An empty folder, in which no configuration is computed but for answers."""

    def refused(*_, **__):
        raise AssertionError("a configuration was computed before the mistake was told")

    name = request.node.name
    if SHOWS_A_POSE not in name and "answers" not in name:
        monkeypatch.setattr(Closure, "linearise", refused)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def cases(*tables):
    """Return the rows of tables: the table, the case."""
    return [pytest.param(table, case) for table in tables for case in TABLES[table]]


@pytest.mark.parametrize(("name", "case"), cases(*MECHANISMS))
def test_mistakes_in_mechanism_files(name, case):
    old, new, *fragments = TABLES[name][case]
    with pytest.raises(FileError) as caught:
        loads(replace_passages(mechanism_text(name), old, new), "x.toml")
    check_fragments(str(caught.value), fragments)


NINES = "9" * 400
HUGE = [
    ("180.0", NINES, ["x.toml:24: pairs.21.zero: found a huge"]),
    ("180.0", NINES * 25, ["x.toml:24: ", "too many digits"]),
    ("180.0", "0x" + NINES * 25, ["x.toml:24: pairs.21.zero: "]),
    ('"free"', "[" * 900 + "]" * 900, ["x.toml:45: nested too", "32"]),
]


@pytest.mark.parametrize(("old", "new", "fragments"), HUGE, ids=range(len(HUGE)))
def test_what_is_huge_is_refused(old, new, fragments):
    with pytest.raises(FileError) as caught:
        loads(replace_passages(mechanism_text("sizes"), old, new), "x.toml")
    check_fragments(str(caught.value), fragments)


@pytest.mark.parametrize(("name", "case"), cases(*STUDIES))
def test_mistakes_in_study_files(name, case):
    old, new, *fragments = TABLES[name][case]
    Path("x.study.toml").write_text(replace_passages(mechanism_text(name), old, new))
    with registered(Tuned), pytest.raises(FileError) as caught:
        sk.run("x.study.toml")
    check_fragments(str(caught.value), fragments)


def told(command, capsys):
    """The exit status of a command and what it says."""
    try:
        status = main(shlex.split(command))
    except SystemExit as refused:
        status = refused.code
    out, err = capsys.readouterr()
    assert out == "" and "Traceback" not in err
    assert len(err.strip().splitlines()) == 1
    return status, err


@pytest.mark.parametrize("case", TABLES["template"])
def test_mistakes_in_mechanism_files_by_the_command(case, capsys):
    old, new, *fragments = TABLES["template"][case]
    Path("mine.toml").write_text(replace_passages(TEMPLATE.read_text(), old, new))
    status, said = told("run mine.toml", capsys)
    assert status == 1
    check_fragments(said, fragments)


@pytest.mark.parametrize("command", TABLES["commands"])
def test_mistakes_in_commands(command, capsys):
    status, said = told(command.replace("LONG", "x" * 300), capsys)
    assert status in (1, 2) and (status == 2) == ("See: spherekit" in said)
    check_fragments(said, TABLES["commands"][command])


@pytest.mark.parametrize(("table", "call"), cases("calls", "answers"))
def test_mistakes_in_calls(table, call, folder):
    check_call(call, NAMES, TABLES[table][call])
    assert list(folder.iterdir()) == []
