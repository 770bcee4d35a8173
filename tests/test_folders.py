"""Folders of results: only what runs have made there is replaced or removed."""

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from helpers.refusals import mechanism_text

import spherekit as sk
from spherekit.cli.command_line import build_parser, command_parsers
from spherekit.cli.main import main
from spherekit.tables.table_files import read_parquet

RUN = ["run", "four_bar", "--samples", "5", "-q"]
SWEEP = ["sweep", "four_bar", "--vary", "links.2.arc=10:20:3", "-q"]
SWEEP += ["--reduce", "a=max(transmission_angle_43)"]


def everything(folder):
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def put(base, things):
    """Put things into a folder, as folders.toml says them."""
    for thing in things:
        place, link, target = thing.partition(" -> ")
        name, _, text = thing.partition(": ")
        path = base / (place if link else name)
        path.parent.mkdir(parents=True, exist_ok=True)
        if link:
            path.symlink_to(base / target)
        elif name.endswith("/"):
            path.mkdir()
        else:
            text = text.replace("BASE", str(base)).replace("VERSION", sk.__version__)
            path.write_text(text)


THINGS = tomllib.loads(mechanism_text("folders"))


@pytest.mark.parametrize("prepare", THINGS["no run"])
@pytest.mark.parametrize("option", [[], ["--restart"], ["--resume"]])
def test_a_run_leaves_what_no_run_has_made(prepare, option, tmp_path, capsys):
    (tmp_path / "out").mkdir()
    put(tmp_path, THINGS["no run"][prepare])
    out = tmp_path / "out"
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


def test_a_run_that_was_stopped_as_it_moved_its_results(tmp_path, monkeypatch):
    out = tmp_path / "out"
    assert main([*RUN, "-o", str(out)]) == 0
    (out / "notes.txt").write_text("mine")
    replace, moved = Path.replace, []

    def stopping(self, target):
        if Path(target).parent == out:
            moved.append(target)
            if len(moved) == 5:
                raise KeyboardInterrupt
        return replace(self, target)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", stopping)
        assert main([*RUN, "-o", str(out), "-a", "eksergian"]) == 130
    assert not (out / "summary.json").exists() and (out / "eksergian.csv").exists()
    assert main([*RUN, "-o", str(out), "--restart"]) == 0
    names = {path.name for path in out.iterdir()}
    assert names >= {"notes.txt", "poles.csv"}
    assert not names & {".spherekit-run", "eksergian.csv"}


def edited(base, out):
    (out / "poles.csv").write_text((out / "poles.csv").read_text() + "mine")


def in_place_of_a_table(base, out):
    (base / "kept").write_bytes((out / "poles.csv").read_bytes())
    (out / "poles.csv").unlink()
    (out / "poles.csv").symlink_to(base / "kept")


def copied_summary(base, out):
    for path in out.iterdir():
        if path.name != "summary.json":
            path.write_text("mine")


def changed_summary(base, out):
    text = (out / "summary.json").read_text()
    (out / "summary.json").write_text(text.replace('"samples": 5', '"samples": 6'))


CHANGED = {
    each.__name__: each
    for each in (edited, in_place_of_a_table, copied_summary, changed_summary)
}


@pytest.mark.parametrize("prepare", [*CHANGED, *THINGS["no run either"]])
def test_results_that_are_no_longer_those_of_a_run_stay(prepare, tmp_path, capsys):
    out = tmp_path / "out"
    assert main([*RUN, "-o", str(out)]) == 0
    if prepare in CHANGED:
        CHANGED[prepare](tmp_path, out)
    else:
        put(tmp_path, THINGS["no run either"][prepare])
    before = everything(tmp_path)
    assert main([*RUN, "-o", str(out), "--restart"]) == 1
    assert "choose another folder" in capsys.readouterr().err
    assert everything(tmp_path) == before


def test_names_behind_which_there_is_another_name(tmp_path):
    """A folder that is a link itself is the folder; hard links keep what they hold."""
    (tmp_path / "there").mkdir()
    out = tmp_path / "out"
    out.symlink_to(tmp_path / "there")
    assert main([*RUN, "-o", str(out)]) == 0
    for name in ("poles.csv", "summary.json"):
        (tmp_path / name).hardlink_to(out / name)
    kept = {name: (tmp_path / name).read_bytes() for name in ("poles.csv", "summary.json")}
    assert main([*RUN, "-o", str(out), "--samples", "7"]) == 0
    assert all((tmp_path / name).read_bytes() == data for name, data in kept.items())
    assert out.is_symlink() and (out / "poles.csv").read_bytes() != kept["poles.csv"]


FIGURE = ["run", "four_bar", "--samples", "5", "-q", "-o", "out", "--figures"]
TRADE = ["trade", "four_bar", "-a", "poles", "-q", "-o", "out"]
RECORDING = [*RUN, "--save", "out/a.rrd"]


@pytest.mark.parametrize("link", [True, False])
@pytest.mark.parametrize(
    "words, name",
    [
        (FIGURE, "figures/poles_velocity_coefficients.png"),
        (RECORDING, "a.rrd.part"),
        (TRADE, "trade.json"),
        (TRADE, "trade.csv"),
    ],
)
def test_names_that_a_command_chooses(words, name, link, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    place = tmp_path / "out" / name
    place.parent.mkdir(parents=True)
    (tmp_path / "kept").write_text("mine")
    place.symlink_to(tmp_path / "kept") if link else place.write_text("mine")
    assert main(words) == 1
    assert "choose another folder" in capsys.readouterr().err
    assert place.read_text() == "mine" and place.is_symlink() == link


@pytest.mark.parametrize("prepare", THINGS["no sweep"])
def test_a_sweep_leaves_what_no_sweep_has_made(prepare, tmp_path, capsys):
    (tmp_path / "out").mkdir()
    put(tmp_path, THINGS["no sweep"][prepare])
    out = tmp_path / "out"
    before = everything(tmp_path)
    assert main([*SWEEP, "-o", str(out)]) == 1
    assert "choose another folder" in capsys.readouterr().err
    after = everything(tmp_path)
    after.pop("out/.sweep.lock", None) if prepare != "linked lock" else None
    assert after == before


def words_with_values():
    """Every place of every subcommand for a word, that empty."""
    for name, parser in command_parsers(build_parser()).items():
        for action in parser._actions:
            if not action.option_strings:
                yield [name, ""]
            elif action.nargs != 0:
                several = action.nargs if isinstance(action.nargs, int) else 1
                yield [name, action.option_strings[-1], *[""] * several]
                if several == 1:
                    yield [name, f"{action.option_strings[-1]}="]


def test_an_empty_word_is_refused_everywhere(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    asked = list(words_with_values())
    assert len(asked) > 100
    for words in asked:
        with pytest.raises(SystemExit) as end:
            main(words)
        assert end.value.code == 2
        said = capsys.readouterr().err
        assert "found an empty text" in said and "argument" in said, words
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


def table_of_a_run(folder):
    sk.run("four_bar", samples=9, folder=folder)
    path = folder / "poles.parquet"
    return path, lambda: read_parquet(path).to_csv()


def part_of_a_sweep(folder):
    def rows():
        found = sk.sweep("four_bar", vary, "max(q)", samples=2, folder=folder, workers=1)
        return found.frame().to_csv()

    vary = {"links.2.arc": [10.0, 20.0]}
    rows()
    return folder / "part-000000.parquet", rows


def stored_functions(folder):
    path = folder / "model.npz"
    sk.export("four_bar", path)
    return path, lambda: repr(sk.load_reduced(path).torque(1.0, 2.0, 0.5))


def coupling(folder):
    path = folder / "table.npz"
    sk.export("four_bar", path, to="coupling", tolerance=1e-2)
    return path, lambda: repr(sk.load_coupling(path).at(1.0).angles)


@pytest.mark.many
@pytest.mark.parametrize(
    "stored", [table_of_a_run, part_of_a_sweep, stored_functions, coupling]
)
def test_a_bit_that_changes_is_told_or_changes_no_number(stored, tmp_path):
    path, read = stored(tmp_path)
    data, whole, told = path.read_bytes(), read(), 0
    random = np.random.default_rng(7)
    named = [x.start() for x in re.finditer(b"velocity_coefficient", data)]
    for place in [*random.integers(len(data), size=30), *named]:
        changed = bytearray(data)
        changed[place] ^= 1 << int(random.integers(8))
        path.write_bytes(changed)
        try:
            assert read() == whole
        except sk.SpherekitError:
            told += 1
    assert told > 15
