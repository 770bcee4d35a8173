"""Study files: faults with file, line and key; runs; flags that override the file."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from helpers.broken_plugins import Tuned
from helpers.refusals import mechanism_text

import spherekit as sk
from spherekit.cli.main import main
from spherekit.errors import AnalysisError, FileError, ModelError
from spherekit.files.library import find, shipped
from spherekit.files.study import Study
from spherekit.files.study_reader import load_study
from spherekit.runs.registry import registered
from spherekit.runs.study_analyses import make_study_analyses

STUDY = mechanism_text("study.study")
"""The text of tests/files/study.study.toml, a study of the analyses `poles` and `tuned`."""


@pytest.fixture(autouse=True)
def plugin():
    """Register the analysis `tuned` of the study, whose parameters have every kind."""
    with registered(Tuned):
        yield


def mechanism_file_without_inputs(name):
    """Return the text of the file of a shipped mechanism without its inputs."""
    tables = find(name).read_text().split("\n[")
    return "\n[".join(table for table in tables if not table.startswith("inputs"))


def write_study(folder, text):
    """Write the text of a study named x, and return its path."""
    path = folder / "x.study.toml"
    path.write_text(text)
    return path


def test_a_study_is_read_as_written(tmp_path):
    """Every key of a study file has its value in the study that is read.

    `STUDY` has angles in degrees; the input of the pair "12" runs from -30 to 90 deg. Its
    analyses are `poles`, of the rotation axes (poles) 6/1 and 5/1, and `tuned`, an analysis
    of the tests (`Tuned`) with parameters of all types. The parameter `circles` is the pole
    whose two great circles are drawn. The integers in `weight = 2` and `ends = [1.5, 2]`
    become floats, because these parameters have the type float.
    """
    study = load_study(write_study(tmp_path, STUDY))
    assert study.name == "x"
    assert study.mechanism.name == "stephenson"
    assert study.samples == 7
    assert study.assembly_mode == 1
    # Assembly modes other than that of the reference pose are not searched for.
    assert study.search is False
    assert study.folder == Path("out")
    assert study.recording == Path("x.rrd")
    assert study.degrees is True
    (driven,) = study.mechanism.inputs
    assert driven.pair == "12"
    assert driven.start == np.radians(-30)
    assert driven.stop == np.radians(90)
    poles, tuned = make_study_analyses(study)
    assert poles.only == ("6/1", "5/1")
    assert poles.circles == "6/1"
    assert tuned == Tuned(count=3, weight=2.0, kind="b", ends=(1.5, 2.0))
    assert type(tuned.weight) is float
    assert type(tuned.ends[1]) is float


MINIMAL_STUDY = 'format = 1\nmechanism = "four_bar"\n'


def test_everything_but_the_mechanism_has_a_default(tmp_path):
    """The default analysis is `poles`. A mechanism alone is a study of its name."""
    study = load_study(write_study(tmp_path, MINIMAL_STUDY))
    assert study == Study("x", sk.load("four_bar"))
    (analysis,) = make_study_analyses(study)
    assert analysis.name == "poles"
    assert load_study("four_bar") == Study("four_bar", sk.load("four_bar"))


def test_rows_that_a_study_asks_to_verify_are_verified(tmp_path):
    study = load_study(write_study(tmp_path, f"{MINIMAL_STUDY}verify = 3\n"))
    assert sk.run(study, samples=5).summary["verified"]["rows"] == 3


def test_studies_are_equal_if_their_paths_are():
    def study_to(last_input):
        path = [[0, 0], [1, last_input]]
        return Study("x", sk.load("five_bar"), path=path)

    assert study_to(1) == study_to(1)
    assert study_to(1) != study_to(2)


def test_the_mechanism_of_a_study_is_looked_for_beside_the_study(tmp_path, monkeypatch):
    """Not from the working folder, which is another here."""
    (tmp_path / "parts").mkdir()
    sk.dump(sk.load("four_bar"), tmp_path / "parts" / "mine.toml")
    path = write_study(tmp_path, 'format = 1\nmechanism = "parts/mine.toml"\n')
    monkeypatch.chdir(tmp_path / "parts")
    assert load_study(path).mechanism == sk.load("four_bar")


def test_a_limit_that_a_study_does_not_give_is_that_of_the_mechanism(tmp_path):
    """With `from` alone, and for another input pair with neither limit."""
    head = 'format = 1\nmechanism = "stephenson"\n'
    text = f'{head}angle_unit = "rad"\n[inputs.12]\nfrom = 0.5'
    (driven,) = load_study(write_study(tmp_path, text)).mechanism.inputs
    assert (driven.start, driven.stop) == (0.5, 2 * np.pi)
    text = f"{head}[inputs.14]\n"
    (driven,) = load_study(write_study(tmp_path, text)).mechanism.inputs
    assert (driven.pair, driven.start, driven.stop) == ("14", 0.0, 2 * np.pi)


def test_a_fault_in_the_mechanism_of_a_study_names_the_file_of_the_mechanism(tmp_path):
    (tmp_path / "bad.toml").write_text('format = 1\nname = "bad"\n')
    path = write_study(tmp_path, STUDY.replace("stephenson", "bad.toml"))
    with pytest.raises(FileError) as refusal:
        load_study(path)
    assert str(refusal.value).startswith(f"{tmp_path / 'bad.toml'}:1: ")


def test_a_study_that_is_read_as_a_mechanism_is_refused(tmp_path):
    path = write_study(tmp_path, STUDY)
    with pytest.raises(FileError, match="is a study, not a mechanism; read it with"):
        sk.load(path)


def test_a_fault_in_a_study_made_in_python_names_the_study_and_the_key():
    study = Study("mine", sk.load("four_bar"), analyses={"poles": {"onyl": []}})
    with pytest.raises(AnalysisError, match=r"^mine: analyses.poles.onyl: .onyl. is not"):
        sk.run(study)


WITHOUT_RECORDING = STUDY.replace('recording = "x.rrd"\n', "")


def test_the_command_line_runs_a_study_and_writes_its_output(tmp_path, monkeypatch):
    """The study without its analysis `tuned`: two poles in mode 1, at 7 inputs in deg."""
    before, _, rest = WITHOUT_RECORDING.partition("[analyses.tuned]")
    write_study(tmp_path, before + rest[rest.index("[output]") :])
    monkeypatch.chdir(tmp_path)
    assert main(["run", "x.study.toml", "-q"]) == 0
    frame = pd.read_parquet(tmp_path / "out" / "poles.parquet")
    poles = {(row.link, row.relative_to) for row in frame.itertuples()}
    assert poles == {("5", "1"), ("6", "1")}
    assert set(frame["assembly_mode"]) == {1}
    q_deg = frame["q [deg]"].unique()
    np.testing.assert_allclose(q_deg, np.linspace(-30, 90, 7), atol=1e-13)
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["analyses"][0]["parameters"]["only"] == ["6/1", "5/1"]


def test_flags_given_override_the_study(tmp_path, monkeypatch, capsys):
    write_study(tmp_path, WITHOUT_RECORDING)
    monkeypatch.chdir(tmp_path)
    flags = "--samples 3 --input 14 --assembly-mode 0 -a poles:only=31 -o other --json -q"
    assert main(["run", "x.study.toml", *flags.split()]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["samples"] == 3
    assert list(summary["inputs"]) == ["14"]
    assert [item["number"] for item in summary["assembly_modes"]] == [0]
    assert [item["name"] for item in summary["analyses"]] == ["poles"]
    assert (tmp_path / "other" / "poles.csv").exists()
    assert not (tmp_path / "out").exists()


def test_samples_given_replace_the_values_of_a_study(tmp_path, capsys):
    """The study has two values of each input; 2x3 samples are a grid of them."""
    path = tmp_path / "path.study.toml"
    path.write_text(
        'format = 1\nmechanism = "five_bar"\nangle_unit = "deg"\n'
        "[inputs.21]\nvalues = [60.0, 70.0]\n[inputs.51]\nvalues = [60.0, 65.0]\n"
    )
    for flags, count in (([], "2"), (["--samples", "3"], "3"), (["--samples", "2x3"], "6")):
        assert main(["run", str(path), "-a", "poles:only=31", "--json", *flags]) == 0
        assert f'"samples": {count},' in capsys.readouterr().out


@pytest.mark.parametrize("command", ["run", "explain", "validate"])
def test_commands_report_a_fault_in_a_study_with_line_and_key(command, tmp_path, capsys):
    path = write_study(tmp_path, STUDY.replace("only =", "onyl ="))
    assert main([command, str(path)]) == 1
    message = f'{path}:13: analyses.poles.onyl: "onyl" is not a parameter'
    assert message in capsys.readouterr().err


def test_explain_states_input_analyses_and_poles_of_a_study(tmp_path, capsys):
    """The input of the study replaces that of the mechanism."""
    path = write_study(tmp_path, STUDY.replace("[inputs.12]", "[inputs.14]"))
    assert main(["explain", str(path), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["inputs"] == ["14"]
    assert facts["analyses"] == ["poles", "tuned"]
    assert facts["asked"] == ["P51", "P61"]


def test_validate_accepts_a_study_and_names_its_mechanism(tmp_path, capsys):
    path = write_study(tmp_path, STUDY.replace("[inputs.12]", "[inputs.14]"))
    assert main(["validate", str(path)]) == 0
    assert "x: valid study of stephenson" in capsys.readouterr().out


def test_shipped_studies_run_by_their_name_without_a_failed_row():
    studies = [name for pack in shipped() for name in pack.studies]
    assert "stephenson_output" in studies
    for name in studies:
        result = sk.run(name)
        assert not result.failures
        assert set(result.summary["status"]) == {"OK"}


def test_a_start_takes_lists_as_it_takes_tuples():
    start = sk.Start(q=[0.5, 0.2], dq=[1.0, 0.0])
    assert start == sk.Start(q=(0.5, 0.2), dq=(1.0, 0.0))
    with pytest.raises(ModelError, match="found nan, expected a finite number"):
        sk.Start(q=[0.5, float("nan")])


def test_a_start_takes_arrays_as_it_takes_tuples():
    start = sk.Start(q=np.array([0.5, 0.2]), dq=np.array([1.0, 0.0]))
    assert start == sk.Start(q=(0.5, 0.2), dq=(1.0, 0.0))


def test_a_start_that_states_a_key_twice_is_refused():
    with pytest.raises(ModelError, match="start: a key is given twice"):
        sk.Start.of("q=0.1,q=0.2")


@pytest.mark.parametrize(
    ("table", "key"),
    [
        ('[inputs.21]\nfrom = "nan"', "inputs.21.from"),
        ('[inputs.21]\nvalues = [0, "1e400deg"]', r"inputs.21.values\[1\]"),
        ('[start]\nq = 0\ndq = "inf"', "start.dq"),
        (
            '[inputs.21.law]\nkind = "constant_speed"\nspeed = 1\nfrom = "inf"',
            "inputs.21.law.from",
        ),
    ],
)
def test_a_text_that_is_no_finite_number_is_refused_with_its_key(tmp_path, table, key):
    path = write_study(tmp_path, f'format = 1\nmechanism = "four_bar"\n{table}\n')
    with pytest.raises(FileError, match=f"{key}: found .*, expected a finite number"):
        load_study(path)


def test_the_default_input_of_a_mechanism_can_be_locked_after_a_study_has_named_it(
    tmp_path,
):
    """A study without inputs leaves the default input of its mechanism as it is."""
    text = mechanism_file_without_inputs("five_bar")
    (tmp_path / "five.toml").write_text(text)
    path = write_study(tmp_path, 'format = 1\nmechanism = "five.toml"\n')
    locked = sk.lock(load_study(path).mechanism, {"21": 50.0}, angle_unit="deg")
    assert len(locked.links) == 4
