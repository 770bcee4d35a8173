"""Mistakes in files, commands and calls: what each message says, in one table.

A message says where the fault is, what it is, what is allowed and what to do; the fragments
of a row are these, in any order. Nothing is traced, searched or integrated before it.
"""
# ruff: noqa: E501

import shlex
from pathlib import Path

import pytest

import spherekit as sk
from spherekit.cli.main import main
from spherekit.motion.closure import Closure

TEMPLATE = (Path(sk.__file__).parent / "cli" / "templates" / "four_bar.toml").read_text()
LOAD = '[loads.motor]\npair = "drive"\ntorque = "{}"\n'
MASS = "[mass.rocker]\ntensor = [[1, 0, 0], [0, 1, 0], [0, 0, 9]]\n"
STUDY = 'format = 1\nmechanism = "four_bar"\nangle_unit = "deg"\n'

FILES = {
    "misspelt key": ("arcs = [20.0]", "arc = [20.0]", [":16: links.crank.arc", "unknown key", 'did you mean "arcs"', "allowed in links.crank: axes, arcs"]),
    "axis twice": ('["drive", "tip"]', '["drive", "drive"]', [":15: links.crank.axes", '"drive" is given twice', "list each once"]),
    "unknown axis": ('["drive", "tip"]', '["drive", "tipp"]', [":15: links.crank.axes", "[drive, tipp]", "the R pairs on this link are [drive, tip]"]),
    "pair type": ('type = "R"', 'type = "S"', [":30: pairs.drive.type", 'found "S"', "allowed: R, P, Cr, Cs"]),
    "text for a number": ("arcs = [20.0]", 'arcs = ["20"]', [":16: links.crank.arcs[0]", 'found "20" (text)', "needs a number"]),
    "degrees as radians": ('"deg" ', '"rad" ', [":12: links.base.arcs[0]", "60.0 rad", "looks like degrees", 'set angle_unit = "deg"']),
    "no unit": ('angle_unit = "deg"', "#", ["angle_unit is missing", "there is no default", '"deg" or "rad"']),
    "arc beyond half a turn": ("arcs = [20.0]", "arcs = [200.0]", [":16: links.crank.arcs[0]", "200 deg", "between 0 and 180 deg", "signed_arcs = true"]),
    "unknown ground": ('"base"  ', '"bse"  ', [":6: ground", 'no link is named "bse"', 'did you mean "base"', "Links: base, crank"]),
    "input of a link": ("[inputs.drive]", "[inputs.crank]", [":46: inputs.crank", 'no pair is named "crank"', "Pairs: drive, tip"]),
    "newer format": ("format = 1", "format = 2", [":3: format", "found 2", "reads 1", "needs a newer spherekit"]),
    "link twice": ("[links.crank]", "[links.base]", [":14: links.base", "given twice, first on line 10", "names are unique"]),
    "unclosed list": ('["drive", "tip"]', '["drive", "tip"', [":16: column 1", "Unclosed array"]),
    "output of no link": ('link = "rocker"', 'link = "rockr"', [":52: outputs.rocker.link", 'no link is named "rockr"', 'did you mean "rocker"']),
    "name with a blank": ('"NAME"', '"my bar"', [":4: name", 'found "my bar"', "1 to 64 letters", "digits and underscores"]),
    "unknown angle in a load": ("[outputs", LOAD.format("sin(theta_driv)") + "[outputs", ["loads.motor.torque", "column 5", 'did you mean "theta_drive"', "names: t, theta_drive"]),
    "product without a sign": ("[outputs", LOAD.format("2 theta_drive") + "[outputs", ["loads.motor.torque", "column 3", "products are written with *"]),
    "inertia that no body has": ("[outputs", MASS + "[outputs", ["mass.rocker.tensor", "not physical", "by 7 kg m2", "check units"]),
    "empty range": ("to = 360.0", "to = 0.0", ["inputs.drive", "from `from` to `to` is empty", "both are 0 rad", "give another `to`"]),
    "empty file": (TEMPLATE, "", [":1: format", "missing", "start with format = 1"]),
}  # fmt: skip

STUDIES = {
    "unknown analysis": ("[analyses.pole]\n", [":4: analyses.pole", 'did you mean "poles"', "Installed: dynamics"]),
    "misspelt key of a study": ("sample = 3\n", [":4: sample", 'did you mean "samples"', "allowed at the top of the file"]),
}  # fmt: skip

LONG = "x" * 300
COMMANDS = {
    "run": ["spherekit run", "FILE|STUDY", "See: spherekit run --help"],
    "runn four_bar": ["invalid choice: 'runn'", 'did you mean "run"', "spherekit --help"],
    "four_bar": ["that is a file: spherekit run four_bar"],
    "run four_bar --degree": ["unrecognized arguments: --degree", 'did you mean "--deg"'],
    "run four_bar --samples 0": ["--samples", "whole numbers of at least 1", "361 or 41x21", "'0'"],
    "run four_bar --samples 3x3": ["samples: 3x3 is of 2 inputs", "there is 1 input (21)", "as 361"],
    "run four_bar --verify x": ["--verify", "such as 16", "write the file before --verify"],
    "run four_bar --engine fast": ["--engine", "choose from 'auto', 'numpy', 'compiled'"],
    "run four_bar --tol x": ["--tol", "'x' is not a number"],
    "run four_bar --tol 0": ["tolerance 0", "give a positive number such as 1e-9"],
    "run four_bar --serve 80000": ["cannot serve on port 80000", "0-65535", "choose another port"],
    "run four_bar --serve 0": ["cannot serve on port 0", "1 to 65535"],
    "run four_bar --connect ''": ["argument --connect", "found an empty text for URL", "unset variable"],
    f"run four_bar -o {LONG}": ["cannot be made: the name is too long"],
    f"run four_bar --save {LONG}.rrd": ["cannot be written: the name is too long"],
    "run four_bar --tol 1e-6 --trade /dev/zero": ["is not a trade", "not a regular file", "spherekit trade"],
    f"size {LONG}": ["cannot be opened: File name too long"],
    f"view {LONG}": ["cannot be read: File name too long", "run FILE --save X.rrd"],
    "certify four_bar --at ''": ["argument --at", "found an empty text"],
    "certify four_bar --at ' '": ["--at", "is not a decimal number", "40 or 12.5"],
    "certify four_bar --cell 0": ["--cell and --figure are for ranges of several inputs"],
    "certify four_bar --at 1 -o ''": ["argument -o", "found an empty text"],
    "certify four_bar --at 1 -o .": ["cannot be written: is a folder", "name of a file"],
    "run fourbar": ["fourbar: not found", 'did you mean "four_bar"', "Shipped mechanisms: agile_eye"],
    "run four_bar -a pole": ['no analysis is named "pole"', 'did you mean "poles"', "Installed:"],
    "run four_bar -a poles:onyl=31": ["poles", '"onyl"', 'did you mean "only"', "Allowed: only="],
    "run four_bar -a poles:only=39": ['"39" is not a pole', "Write LINK/LINK with two of the links 1, 2, 3, 4"],
    "run four_bar -a poles:only=31 -a poles:only=42": ["poles: is asked for 2 times", "only=31+42", "run twice"],
    "run four_bar -a singularities:near=x": ["singularities: parameter near", '"x"', "number"],
    "run four_bar -a singularities:near=-3": ["singularities: near: -3", "0 or more"],
    "run watt -a eksergian": ["watt", "neither masses nor loads", "give at least one [mass.LINK]"],
    "run four_bar -a workspace": ["outputs.rocker", "has 1 input", "trace its motion instead", "--input 41"],
    "run five_bar -a workspace:limits=21:40": ["workspace: limits", '"21:40"', "PAIR:LOW:HIGH"],
    "run five_bar -a workspace:near=95": ["near: 95 deg", "at least 0 and less than 90 deg"],
    "run five_bar -a workspace:pose=tilt=3": ["workspace: pose", '"tilt=3" is not a pose', "azimuth=..+tilt=.."],
    "run five_bar -a inverse_kinematics": ["inverse_kinematics", "found no poses", "poses=azimuth=", "window=NAME:FROM:TO:COUNT"],
    "run five_bar -a inverse_kinematics:poses=10:20": ["poses", '"10:20"', "is not name=number", "azimuth=10+tilt=20"],
    "run five_bar -a inverse_kinematics:file=nothing.csv": ["nothing.csv: cannot be read", "give the path of a CSV or Parquet file"],
    "run two_dof_spm -a equivalent_rotation:start=phi=75": ["equivalent_rotation", "parameters missing: end"],
    "run four_bar --input 99": ['no pair is named "99"', "Pairs: 21, 32, 43, 41"],
    "run five_bar --input 21": ["five_bar", "the number of inputs is 1 (21)", "declare 2 R pairs as inputs"],
    "run four_bar --law constant:speed=1": ["--law", 'did you mean "constant_speed"', "Laws: constant_speed"],
    "run four_bar --law constant_speed:sped=1": ["--law constant_speed", '"sped"', 'did you mean "speed"', "from=number"],
    "run four_bar --start q=0.3": ["start", "needs a duration in s", "--duration T"],
    "run four_bar --start q=a --duration 1": ["start: q", '"a"', "number"],
    "run four_bar --duration -1": ["duration: found -1 s", "a finite time above 0"],
    "run four_bar --torque 3 --duration 1": ["a driving torque needs a start"],
    "run four_bar --start q=0.3 --duration 1 --torque 3*thta_21": ["torque", "column 3", 'did you mean "theta_21"'],
    "run four_bar --start q=0.3 --duration 1 --tol 1e-30": ["tolerance is 1e-30", "allowed is 1e-15 to 1e-2"],
    "run four_bar --resume": ["--resume", "without a folder", "with -o"],
    "run four_bar --format csv": ["--format", "without tables", "-o DIR"],
    "run four_bar --log-every 5": ["--log-every", "without a recording", "--save"],
    "run four_bar --save x.txt": ["x.txt", "must be named *.rrd"],
    "run four_bar --save nothere/x.rrd": ["nothere/x.rrd", "the folder does not exist", "create it first"],
    "run four_bar --connect nowhere": ['"nowhere"', "not the address of a viewer", "rerun+http://"],
    "run four_bar --trade d": ["--trade", "with --tol T"],
    "plan four_bar --for 3/9": ['"3/9" is not a pole', 'did you mean "3/2"'],
    "view nothing": ["nothing", "no such recording", "--save X.rrd"],
    "export four_bar": ["spherekit export", "--to"],
    "export four_bar --to stl": ["--to", "choose from 'model', 'mjcf'"],
    "export four_bar --to mjcf --poles 31": ["--poles does nothing without --to model"],
    "export four_bar --to model -o x.xml": ["x.xml", "named *.npz", "give it that ending"],
    "export four_bar --to mjcf --at x": ["--at", "'x' is not a number"],
    "trade four_bar --rounds 0": ["--rounds 0", "a whole number of at least 1"],
    "new mechanism a-b": ['"a-b"', "letters, digits and underscores", "such as a_b"],
    "new mechanis x": ["invalid choice: 'mechanis'", 'did you mean "mechanism"'],
    "completion tcsh": ["'tcsh'", "choose from 'bash', 'zsh', 'fish'"],
}  # fmt: skip

CALLS = {
    "load(3)": ["load: name_or_path is 3 (int)", "text or a path"],
    "run('four_bar', sample=3)": ['no option "sample"', 'did you mean "samples"', "options:"],
    "run('four_bar', samples='x')": ["samples is 'x' (str)", "a whole number"],
    "run('four_bar', engine='compiled')": ["engine does nothing", "give start"],
    "run('four_bar', start=0.3, duration=1.0)": ["start is 0.3 (float)", "Start or None"],
    "evaluate('four_bar', 'x')": ["inputs is 'x' (str)", "numbers"],
    "plan('four_bar', ['3/9'])": ['"3/9" is not a pole', 'did you mean "3/2"'],
    "simulate('four_bar', 0.3, 1.0)": ["start is 0.3 (float)", "has to be Start"],
    "simulate('four_bar', sk.Start(q=0.3), -1.0)": ["cannot end at -1 s", "greater than 0"],
    "simulate('four_bar', sk.Start(q=0.3), 1.0, engine='fast')": ['"fast" is not known', 'allowed: "auto"'],
    "simulate('watt', sk.Start(q=0.3), 1.0)": ["watt: mass", "give at least one [mass.LINK]"],
    "load('four_bar').with_sizes(arcs={'9': 3.0}, angle_unit='deg')": ['no link is named "9"', "Links: 1, 2, 3, 4"],
    "load('four_bar').with_sizes(arcs={'2': 25.0})": ["'angle_unit'", "Arguments: angle_unit, arcs"],
    "export('four_bar', 'x.txt')": ["x.txt", "*.npz, *.xml", "one of these endings"],
    "ConstantSpeed(speed='x')": ["ConstantSpeed: speed is 'x' (str)", "a number"],
    "Cycloidal(start=0, stop=1, duration=-1)": ["duration: found -1 s", "more than 0"],
}  # fmt: skip


SHOWS_A_POSE = "run five_bar -a inverse_kinematics"
"""Its message has a pose that the mechanism reaches, which takes a configuration."""


@pytest.fixture(autouse=True)
def nothing_is_computed(request, monkeypatch, tmp_path):
    def refused(*_, **__):
        raise AssertionError("a configuration was computed before the mistake was told")

    if SHOWS_A_POSE not in request.node.name:
        monkeypatch.setattr(Closure, "at", refused)
    monkeypatch.chdir(tmp_path)


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


@pytest.mark.parametrize("mistake", FILES)
def test_mistakes_in_mechanism_files(mistake, capsys):
    before, after, fragments = FILES[mistake]
    assert before in TEMPLATE
    Path("mine.toml").write_text(TEMPLATE.replace(before, after, 1))
    status, said = told("run mine.toml", capsys)
    assert status == 1
    for fragment in fragments:
        assert fragment in said


@pytest.mark.parametrize("mistake", STUDIES)
def test_mistakes_in_study_files(mistake, capsys):
    text, fragments = STUDIES[mistake]
    Path("mine.study.toml").write_text(STUDY + text)
    status, said = told("run mine.study.toml", capsys)
    assert status == 1
    for fragment in ["mine.study.toml", *fragments]:
        assert fragment in said


@pytest.mark.parametrize("command", COMMANDS)
def test_mistakes_in_commands(command, capsys):
    status, said = told(command, capsys)
    assert status in (1, 2) and (status == 2) == ("See: spherekit" in said)
    for fragment in COMMANDS[command]:
        assert fragment in said, said


@pytest.mark.parametrize("call", CALLS)
def test_mistakes_in_calls(call):
    with pytest.raises(sk.SpherekitError) as refused:
        eval(f"sk.{call}")
    for fragment in CALLS[call]:
        assert fragment in str(refused.value)
