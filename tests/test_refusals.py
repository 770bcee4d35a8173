"""Mistakes in files, commands and calls are refused with the words of `refusals.toml`.

Each table of that file has cases: a passage of a valid file and the passage that replaces
it, a command, or a Python expression; and fragments that the message has to have. Nothing
is traced, searched or integrated before a mistake in a file or command is refused.
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
"""Tables of mistakes in mechanism files; each has the name of the valid text."""
STUDIES = "study.study", "constant.study", "table.study", "timed.study"
"""Tables of mistakes in study files."""
CALLABLES = (
    MujocoModel,
    PositionAnalysis,
    SingleFreedomSingularities,
    Tabulated,
    aspects,
    range_variation,
    four_bar_from_file,
    find_region,
    inverse_dynamics,
    output_of,
    reduced_model,
    replace,
    simulate,
    singular_curves,
    singular_surface,
    trade,
    two_four_bars,
)
NAMES = {function.__name__: function for function in CALLABLES} | {
    "sk": sk,
    "np": np,
    "LINKS": LINKS,
    "NAN": float("nan"),
    "FOUR_BAR": sk.load("four_bar"),
    "FIVE_BAR": sk.load("five_bar"),
    "START": Start(0.3, 1.0),
    "LAW": ConstantSpeed(1.0),
}
"""Names that the expressions of the tables "calls" and "answers" use."""
SHOWS_A_POSE = "run five_bar -a inverse_kinematics"
"""Its message has a pose that the mechanism reaches, which takes a configuration."""


@pytest.fixture(autouse=True)
def folder(request, monkeypatch, tmp_path):
    """Work in an empty folder, where computing a configuration fails the test.

    The table "answers" has mistakes that only a configuration shows.
    """

    def fail(*_, **__):
        raise AssertionError("a configuration was computed before the mistake was told")

    name = request.node.name
    if SHOWS_A_POSE not in name and "answers" not in name:
        monkeypatch.setattr(Closure, "linearise", fail)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def cases(*tables):
    """Return a parameter set (name of the table, name of the case) for every case."""
    return [pytest.param(table, case) for table in tables for case in TABLES[table]]


@pytest.mark.parametrize(("name", "case"), cases(*MECHANISMS))
def test_mistakes_in_mechanism_files(name, case):
    """A valid text with one passage replaced; the message has all fragments of the case."""
    old, new, *fragments = TABLES[name][case]
    with pytest.raises(FileError) as caught:
        loads(replace_passages(mechanism_text(name), old, new), "x.toml")
    check_fragments(str(caught.value), fragments)


NINES_400 = "9" * 400
NINES_10000 = "9" * 10_000
NESTED_LISTS = "[" * 900 + "]" * 900
HUGE = [
    ("180.0", NINES_400, ["x.toml:24: pairs.21.zero: found a huge"]),
    ("180.0", NINES_10000, ["x.toml:24: ", "too many digits"]),
    ("180.0", "0x" + NINES_10000, ["x.toml:24: pairs.21.zero: "]),
    ('"free"', NESTED_LISTS, ["x.toml:45: the tables and arrays are nested too", "32"]),
]
"""Passages of a valid file, what replaces them, and fragments of the message."""


@pytest.mark.parametrize(("old", "new", "fragments"), HUGE, ids=range(len(HUGE)))
def test_huge_numbers_and_deep_nesting_are_refused(old, new, fragments):
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


def run_refused_command(command, capsys):
    """Return the exit status of a command and its message, which has to be one line."""
    try:
        status = main(shlex.split(command))
    except SystemExit as exit_request:
        status = exit_request.code
    output, message = capsys.readouterr()
    assert output == ""
    assert "Traceback" not in message
    assert len(message.strip().splitlines()) == 1
    return status, message


@pytest.mark.parametrize("case", TABLES["template"])
def test_mistakes_in_mechanism_files_by_the_command(case, capsys):
    old, new, *fragments = TABLES["template"][case]
    Path("mine.toml").write_text(replace_passages(TEMPLATE.read_text(), old, new))
    status, message = run_refused_command("run mine.toml", capsys)
    assert status == 1
    check_fragments(message, fragments)


@pytest.mark.parametrize("command", TABLES["commands"])
def test_mistakes_in_commands(command, capsys):
    """Exit status 2, with a reference to the help, is for words that no command has."""
    long_name = "x" * 300
    status, message = run_refused_command(command.replace("LONG", long_name), capsys)
    assert status in (1, 2)
    assert (status == 2) == ("See: spherekit" in message)
    check_fragments(message, TABLES["commands"][command])


@pytest.mark.parametrize(("table", "call"), cases("calls", "answers"))
def test_mistakes_in_calls(table, call, folder):
    """The expression is refused with the fragments of its case, and writes no file."""
    check_call(call, NAMES, TABLES[table][call])
    assert list(folder.iterdir()) == []
