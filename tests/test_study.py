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
from spherekit.errors import AnalysisError, FileError
from spherekit.files.library import shipped
from spherekit.files.study import Study
from spherekit.files.study_reader import load_study
from spherekit.runs.registry import registered
from spherekit.runs.study_analyses import make_study_analyses

STUDY = mechanism_text("study.study")


@pytest.fixture(autouse=True)
def plugin():
    with registered(Tuned):
        yield


def write(folder, text, name="x.study.toml"):
    path = folder / name
    path.write_text(text)
    return path


def fault(folder, text):
    """Return the message with which a study is refused, and its path."""
    path = write(folder, text)
    with pytest.raises(FileError) as caught:
        make_study_analyses(load_study(path))
    return str(caught.value), path


def test_a_study_is_read_as_written(tmp_path):
    study = load_study(write(tmp_path, STUDY))
    assert (study.name, study.mechanism.name) == ("x", "stephenson")
    assert (study.samples, study.assembly_mode, study.search) == (7, 1, False)
    assert (study.folder, study.recording) == (Path("out"), Path("x.rrd"))
    assert study.degrees is True
    (driven,) = study.mechanism.inputs
    expected = ("12", np.radians(-30), np.radians(90))
    assert (driven.pair, driven.start, driven.stop) == expected
    poles, tuned = make_study_analyses(study)
    assert (poles.only, poles.circles) == (("6/1", "5/1"), "6/1")
    assert tuned == Tuned(count=3, weight=2.0, kind="b", ends=(1.5, 2.0))
    assert type(tuned.weight) is type(tuned.ends[1]) is float


def test_everything_but_the_mechanism_has_a_default(tmp_path):
    path = write(tmp_path, 'format = 1\nmechanism = "four_bar"\n')
    assert load_study(path) == Study("x", sk.load("four_bar"))
    asked = load_study(write(tmp_path, f"{path.read_text()}verify = 3\n"))
    assert sk.run(asked, samples=5).summary["verified"]["rows"] == 3
    write(tmp_path, path.read_text().replace("verify = 3\n", ""))
    assert load_study("four_bar") == Study("four_bar", sk.load("four_bar"))
    walked = [Study("x", sk.load("five_bar"), path=[[0, 0], [1, k]]) for k in (1, 1, 2)]
    assert walked[0] == walked[1] != walked[2]
    (only,) = make_study_analyses(load_study(path))
    assert only.name == "poles"


def test_a_study_is_no_mechanism_but_names_its_file(tmp_path, monkeypatch):
    (tmp_path / "parts").mkdir()
    sk.dump(sk.load("four_bar"), tmp_path / "parts" / "mine.toml")
    path = write(tmp_path, 'format = 1\nmechanism = "parts/mine.toml"\n')
    monkeypatch.chdir(tmp_path / "parts")
    assert load_study(path).mechanism == sk.load("four_bar")


def test_a_limit_not_given_is_that_of_the_mechanism(tmp_path):
    text = 'format = 1\nmechanism = "stephenson"\nangle_unit = "rad"\n[inputs.12]\n'
    (driven,) = load_study(write(tmp_path, text + "from = 0.5")).mechanism.inputs
    assert (driven.start, driven.stop) == (0.5, 2 * np.pi)
    without_unit = text.replace('angle_unit = "rad"\n', "").replace("12", "14")
    (driven,) = load_study(write(tmp_path, without_unit)).mechanism.inputs
    assert (driven.pair, driven.start, driven.stop) == ("14", 0.0, 2 * np.pi)

    (tmp_path / "bad.toml").write_text('format = 1\nname = "bad"\n')
    message, _ = fault(tmp_path, STUDY.replace("stephenson", "bad.toml"))
    assert message.startswith(f"{tmp_path / 'bad.toml'}:1: ")
    path = write(tmp_path, STUDY)
    with pytest.raises(FileError, match="is a study, not a mechanism; read it with"):
        sk.load(path)


def test_a_study_made_in_python_names_itself_and_the_key():
    study = Study("mine", sk.load("four_bar"), analyses={"poles": {"onyl": []}})
    with pytest.raises(AnalysisError, match=r"^mine: analyses.poles.onyl: .onyl. is not"):
        sk.run(study)


def test_the_command_line_runs_a_study_and_writes_its_output(tmp_path, monkeypatch):
    text = STUDY.replace('recording = "x.rrd"\n', "")
    before, _, rest = text.partition("[analyses.tuned]")
    write(tmp_path, before + rest[rest.index("[output]") :])
    monkeypatch.chdir(tmp_path)
    assert main(["run", "x.study.toml", "-q"]) == 0
    frame = pd.read_parquet(tmp_path / "out" / "poles.parquet")
    links = {(r.link, r.relative_to) for r in frame.itertuples()}
    assert links == {("5", "1"), ("6", "1")}
    assert set(frame["assembly_mode"]) == {1}
    np.testing.assert_allclose(
        frame["q [deg]"].unique(), np.linspace(-30, 90, 7), atol=1e-13
    )
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["analyses"][0]["parameters"]["only"] == ["6/1", "5/1"]


def test_flags_given_override_the_study(tmp_path, monkeypatch, capsys):
    write(tmp_path, STUDY.replace('recording = "x.rrd"\n', ""))
    monkeypatch.chdir(tmp_path)
    flags = "--samples 3 --input 14 --assembly-mode 0 -a poles:only=31 -o other --json -q"
    assert main(["run", "x.study.toml", *flags.split()]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["samples"], list(summary["inputs"])) == (3, ["14"])
    assert [item["number"] for item in summary["assembly_modes"]] == [0]
    assert [item["name"] for item in summary["analyses"]] == ["poles"]
    assert (tmp_path / "other" / "poles.csv").exists()
    assert not (tmp_path / "out").exists()


def test_samples_given_replace_the_values_of_a_study(tmp_path, capsys):
    path = tmp_path / "path.study.toml"
    path.write_text(
        'format = 1\nmechanism = "five_bar"\nangle_unit = "deg"\n'
        "[inputs.21]\nvalues = [60.0, 70.0]\n[inputs.51]\nvalues = [60.0, 65.0]\n"
    )
    for flags, count in (([], "2"), (["--samples", "3"], "3"), (["--samples", "2x3"], "6")):
        assert main(["run", str(path), "-a", "poles:only=31", "--json", *flags]) == 0
        assert f'"samples": {count},' in capsys.readouterr().out


def test_the_command_line_reports_faults_and_explains_a_study(tmp_path, capsys):
    path = write(tmp_path, STUDY.replace("only =", "onyl ="))
    for command in ("run", "explain", "validate"):
        assert main([command, str(path)]) == 1
        said = f'{path}:13: analyses.poles.onyl: "onyl" is not a parameter'
        assert said in capsys.readouterr().err
    path = write(tmp_path, STUDY.replace("[inputs.12]", "[inputs.14]"))
    assert main(["explain", str(path), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["inputs"] == ["14"]
    assert facts["analyses"] == ["poles", "tuned"]
    assert facts["asked"] == ["P51", "P61"]
    assert main(["validate", str(path)]) == 0
    assert "x: ok, study of stephenson" in capsys.readouterr().out


def test_shipped_studies_are_found_by_name_and_run():
    studies = [name for pack in shipped() for name in pack.studies]
    assert "stephenson_output" in studies
    for name in studies:
        result = sk.run(name)
        assert not result.failures
        assert set(result.summary["status"]) == {"OK"}
