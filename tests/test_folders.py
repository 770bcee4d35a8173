"""Folders of results: only what runs have made there is replaced or removed."""

import json

import pytest

import spherekit as sk
from spherekit.cli.main import main

RUN = ["run", "four_bar", "--samples", "5", "-q"]
SWEEP = ["sweep", "four_bar", "--vary", "links.2.arc=10:20:3", "-q"]
SWEEP += ["--reduce", "a=max(transmission_angle_43)"]


def everything(folder):
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def linked_work(base, out):
    (base / "kept").mkdir()
    (base / "kept" / "journal.json").write_text("{}")
    (out / ".spherekit-run").symlink_to(base / "kept")


def linked_file_in_work(base, out):
    (base / "kept").write_text("mine")
    (out / ".spherekit-run").mkdir()
    (out / ".spherekit-run" / "poles.poles.0.rows").symlink_to(base / "kept")


def linked_lock(base, out):
    (base / "kept").write_text("mine")
    (out / ".spherekit-run").mkdir()
    (out / ".spherekit-run" / "lock").symlink_to(base / "kept")


def work_of_another(base, out):
    (out / ".spherekit-run").mkdir()
    (out / ".spherekit-run" / "notes").write_text("mine")


def work_that_is_a_file(base, out):
    (out / ".spherekit-run").write_text("mine")


def summary_of_another(base, out):
    (out / "summary.json").write_text('{"files": ["data.csv"]}')
    (out / "data.csv").write_text("1,2")


def forged_summary(base, out):
    forged = {"spherekit": sk.__version__, "files": ["data.csv"], "signature": "0" * 64}
    (out / "summary.json").write_text(json.dumps(forged))
    (out / "data.csv").write_text("1,2")


def linked_summary(base, out):
    (base / "kept").write_text('{"files": []}')
    (out / "summary.json").symlink_to(base / "kept")


def table_of_another(base, out):
    (out / "poles.parquet").write_text("mine")


def units_of_another(base, out):
    (out / "columns.csv").write_text("mine")


@pytest.mark.parametrize(
    "prepare",
    [
        linked_work,
        linked_file_in_work,
        linked_lock,
        work_of_another,
        work_that_is_a_file,
        summary_of_another,
        forged_summary,
        linked_summary,
        table_of_another,
        units_of_another,
    ],
)
@pytest.mark.parametrize("option", [[], ["--restart"], ["--resume"]])
def test_a_run_leaves_what_no_run_has_made(prepare, option, tmp_path, capsys):
    out = tmp_path / "out"
    out.mkdir()
    prepare(tmp_path, out)
    before = everything(tmp_path)
    assert main([*RUN, "-o", str(out), *option]) == 1
    assert "choose another folder" in capsys.readouterr().err
    assert everything(tmp_path) == before


def test_a_run_replaces_what_a_run_has_made(tmp_path):
    out = tmp_path / "out"
    assert main([*RUN, "-o", str(out)]) == 0
    (out / "notes.txt").write_text("mine")
    assert main([*RUN, "-o", str(out), "-a", "eksergian"]) == 0
    names = {path.name for path in out.iterdir()}
    assert "notes.txt" in names and "eksergian.csv" in names and "poles.csv" not in names
    # Ended while results were moved: they are still those of a run.
    work = out / ".spherekit-run"
    work.mkdir()
    (work / "published.json").write_text(json.dumps(["eksergian.csv", "poles.csv"]))
    summary = json.loads((out / "summary.json").read_text())
    (out / "summary.json").unlink()
    for name in summary["files"]:
        if name != "eksergian.csv":
            (out / name).unlink()
    assert main([*RUN, "-o", str(out)]) == 0
    assert not work.exists() and (out / "notes.txt").read_text() == "mine"
    assert not (out / "eksergian.csv").exists()


def linked_sweep_lock(base, out):
    (base / "kept").write_text("mine")
    (out / ".sweep.lock").symlink_to(base / "kept")


def sweep_of_another(base, out):
    (out / "_sweep.json").write_text('{"mine": 1}')


def broken_definition(base, out):
    (out / "_sweep.json").write_text("{")


def linked_definition(base, out):
    (base / "kept").write_text("{}")
    (out / "_sweep.json").symlink_to(base / "kept")


def linked_designs(base, out):
    (base / "kept").mkdir()
    (out / "designs").symlink_to(base / "kept")


@pytest.mark.parametrize(
    "prepare",
    [
        linked_sweep_lock,
        sweep_of_another,
        broken_definition,
        linked_definition,
        linked_designs,
    ],
)
def test_a_sweep_leaves_what_no_sweep_has_made(prepare, tmp_path, capsys):
    out = tmp_path / "out"
    out.mkdir()
    prepare(tmp_path, out)
    before = everything(tmp_path)
    assert main([*SWEEP, "-o", str(out)]) == 1
    assert "choose another folder" in capsys.readouterr().err
    after = everything(tmp_path)
    after.pop("out/.sweep.lock", None) if prepare is not linked_sweep_lock else None
    assert after == before


@pytest.mark.parametrize(
    "words",
    [
        [*RUN, "-o", ""],
        [*RUN, "--save", ""],
        [*RUN, "--save="],
        [*SWEEP, "-o", ""],
        ["run", ""],
        ["validate", "four_bar", ""],
        ["export", "four_bar", "--to", "mjcf", "-o", ""],
        ["trade", "four_bar", "-a", "poles", "-o", ""],
        ["certify", "four_bar", "-o", ""],
        ["certify", "five_bar", "--figure", ""],
        ["view", ""],
        ["view", "x.rrd", "--png", ""],
        ["new", "mechanism", ""],
        ["import", "x.urdf", "-o", ""],
    ],
)
def test_an_empty_name_is_refused(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as end:
        main(words)
    assert end.value.code == 2
    assert "empty" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["", " "])
def test_an_empty_name_is_refused_in_python(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run = sk.run("four_bar", samples=3)
    for write in (
        lambda: sk.run("four_bar", samples=3, folder=name),
        lambda: run.write(name),
        lambda: sk.dump(sk.load("four_bar"), name),
        lambda: sk.sweep("four_bar", {"links.2.arc": [20.0]}, "a=max(q)", folder=name),
    ):
        with pytest.raises(sk.SpherekitError, match="empty"):
            write()
    assert not list(tmp_path.iterdir())
