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


def bytes_of_files(folder):
    """Return the bytes of all files in a folder by their relative path."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def make_files(base, entries):
    """Create files, folders and links in the folder `base`, as test data lists them.

    Each of the `entries` is a line of `folders.toml`: `PATH: TEXT` for a file, `PATH/` for
    a folder or `PATH -> TARGET` for a symbolic link. In texts, BASE stands for the folder
    and VERSION for the version of spherekit.
    """
    for entry in entries:
        link_path, arrow, target = entry.partition(" -> ")
        name, _, text = entry.partition(": ")
        path = base / (link_path if arrow else name)
        path.parent.mkdir(parents=True, exist_ok=True)
        if arrow:
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
    """A run refuses a folder that holds other files, and changes nothing in it."""
    (tmp_path / "out").mkdir()
    make_files(tmp_path, THINGS["no run"][prepare])
    out = tmp_path / "out"
    before = bytes_of_files(tmp_path)
    assert main([*RUN, "-o", str(out), *option]) == 1
    assert "choose another folder" in capsys.readouterr().err
    assert bytes_of_files(tmp_path) == before


def test_a_run_replaces_what_a_run_has_made(tmp_path):
    """A second run replaces the tables of the first; other files in the folder stay."""
    out = tmp_path / "out"
    assert main([*RUN, "-o", str(out)]) == 0
    (out / "notes.txt").write_text("mine")
    assert main([*RUN, "-o", str(out), "-a", "eksergian"]) == 0
    names = {path.name for path in out.iterdir()}
    assert "notes.txt" in names and "eksergian.csv" in names and "poles.csv" not in names


def test_a_run_interrupted_while_it_moves_its_results_can_be_restarted(
    tmp_path, monkeypatch
):
    """After Ctrl-C while results are moved into place, `--restart` tidies up.

    A run writes its files into a work folder, `.spherekit-run`. Then it removes the files
    of the older run and moves its own into the folder of results, the summary last. Here
    the fifth move of the second run is interrupted, which ends with exit status 130. Its
    table `eksergian.csv` is then in place, but there is no summary. The third run has no
    such table, and must remove what the second run has left. A file of the user stays.
    """
    out = tmp_path / "out"
    assert main([*RUN, "-o", str(out)]) == 0
    (out / "notes.txt").write_text("mine")
    replace = Path.replace
    moved = []

    def interrupt_fifth_move(self, target):
        if Path(target).parent == out:
            moved.append(target)
            if len(moved) == 5:
                raise KeyboardInterrupt
        return replace(self, target)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", interrupt_fifth_move)
        assert main([*RUN, "-o", str(out), "-a", "eksergian"]) == 130
    assert not (out / "summary.json").exists()
    assert (out / "eksergian.csv").exists()
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
def test_changed_results_are_not_overwritten(prepare, tmp_path, capsys):
    """Results that were edited, linked or added to since the run are refused and stay."""
    out = tmp_path / "out"
    assert main([*RUN, "-o", str(out)]) == 0
    if prepare in CHANGED:
        CHANGED[prepare](tmp_path, out)
    else:
        make_files(tmp_path, THINGS["no run either"][prepare])
    before = bytes_of_files(tmp_path)
    assert main([*RUN, "-o", str(out), "--restart"]) == 1
    assert "choose another folder" in capsys.readouterr().err
    assert bytes_of_files(tmp_path) == before


def test_a_linked_folder_is_used_and_hard_links_keep_the_old_results(tmp_path):
    """Results go into the folder behind a symbolic link, as new files.

    A second run replaces the results. Hard links to the old files keep the old content,
    which shows that the run does not write into existing files.
    """
    (tmp_path / "target").mkdir()
    out = tmp_path / "out"
    out.symlink_to(tmp_path / "target")
    assert main([*RUN, "-o", str(out)]) == 0
    old_contents = {}
    for name in ("poles.csv", "summary.json"):
        (tmp_path / name).hardlink_to(out / name)
        old_contents[name] = (tmp_path / name).read_bytes()
    assert main([*RUN, "-o", str(out), "--samples", "7"]) == 0
    for name, old_content in old_contents.items():
        assert (tmp_path / name).read_bytes() == old_content
    assert out.is_symlink()
    assert (out / "poles.csv").read_bytes() != old_contents["poles.csv"]


FIGURE = ["run", "four_bar", "--samples", "5", "-q", "-o", "out", "--figures"]
TRADE = ["trade", "four_bar", "-a", "poles", "-q", "-o", "out"]
RECORDING = [*RUN, "--save", "out/a.rrd"]


@pytest.mark.parametrize("link", [True, False])
@pytest.mark.parametrize(
    "arguments, name",
    [
        (FIGURE, "figures/poles_velocity_coefficients.png"),
        (RECORDING, "a.rrd.part"),
        (TRADE, "trade.json"),
        (TRADE, "trade.csv"),
    ],
)
def test_a_command_does_not_overwrite_files_by_names_it_chooses(
    arguments, name, link, tmp_path, monkeypatch, capsys
):
    """Figures, recordings and tables of trade-offs replace no file or link of the user."""
    monkeypatch.chdir(tmp_path)
    target = tmp_path / "out" / name
    target.parent.mkdir(parents=True)
    (tmp_path / "kept").write_text("mine")
    target.symlink_to(tmp_path / "kept") if link else target.write_text("mine")
    assert main(arguments) == 1
    assert "choose another folder" in capsys.readouterr().err
    assert target.read_text() == "mine" and target.is_symlink() == link


@pytest.mark.parametrize("prepare", THINGS["no sweep"])
def test_a_sweep_leaves_what_no_sweep_has_made(prepare, tmp_path, capsys):
    """A sweep refuses a folder that holds other files, and changes nothing but its lock."""
    (tmp_path / "out").mkdir()
    make_files(tmp_path, THINGS["no sweep"][prepare])
    out = tmp_path / "out"
    before = bytes_of_files(tmp_path)
    assert main([*SWEEP, "-o", str(out)]) == 1
    assert "choose another folder" in capsys.readouterr().err
    after = bytes_of_files(tmp_path)
    after.pop("out/.sweep.lock", None) if prepare != "linked lock" else None
    assert after == before


def arguments_with_an_empty_text():
    """Yield command lines of all subcommands, each with one empty argument."""
    for name, parser in command_parsers(build_parser()).items():
        for action in parser._actions:
            if not action.option_strings:
                yield [name, ""]
            elif action.nargs != 0:
                value_count = action.nargs if isinstance(action.nargs, int) else 1
                yield [name, action.option_strings[-1], *[""] * value_count]
                if value_count == 1:
                    yield [name, f"{action.option_strings[-1]}="]


@pytest.mark.slow
def test_an_empty_argument_is_refused_everywhere(tmp_path, monkeypatch, capsys):
    """Every argument and option of all commands refuses an empty text."""
    monkeypatch.chdir(tmp_path)
    command_lines = list(arguments_with_an_empty_text())
    assert len(command_lines) > 100
    for arguments in command_lines:
        with pytest.raises(SystemExit) as end:
            main(arguments)
        assert end.value.code == 2
        message = capsys.readouterr().err
        assert "the value is empty" in message and "argument" in message, arguments
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["", " "])
def test_an_empty_name_is_refused_in_python(name, tmp_path, monkeypatch):
    """Functions that write files refuse an empty or blank name."""
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
    """Return the path of a table of a run, and a function that reads it."""
    sk.run("four_bar", samples=9, folder=folder)
    path = folder / "poles.parquet"
    return path, lambda: read_parquet(path).to_csv()


def part_of_a_sweep(folder):
    """Return the path of a part of a sweep, and a function that continues the sweep."""

    def rows():
        result = sk.sweep("four_bar", vary, "max(q)", samples=2, folder=folder, workers=1)
        return result.frame().to_csv()

    vary = {"links.2.arc": [10.0, 20.0]}
    rows()
    return folder / "part-000000.parquet", rows


def stored_functions(folder):
    """Return the path of a reduced model, and a function that evaluates it."""
    path = folder / "model.npz"
    sk.export("four_bar", path)
    return path, lambda: repr(sk.load_reduced(path).torque(1.0, 2.0, 0.5))


def coupling(folder):
    """Return the path of a coupling table, and a function that evaluates it."""
    path = folder / "table.npz"
    sk.export("four_bar", path, to="coupling", tolerance=1e-2)
    return path, lambda: repr(sk.load_coupling(path).at(1.0).angles)


@pytest.mark.many
@pytest.mark.parametrize(
    "stored", [table_of_a_run, part_of_a_sweep, stored_functions, coupling]
)
def test_a_flipped_bit_is_noticed_or_changes_no_number(stored, tmp_path):
    """A stored file with one flipped bit gives the same numbers, or an error.

    `stored` is a function that writes one kind of file; it returns the path and a function
    that reads the file. One bit at a time is flipped: in 30 random bytes, and in the names
    of columns. More than half of the flips in random bytes must be noticed.
    """
    path, read = stored(tmp_path)
    data = path.read_bytes()
    expected = read()
    random = np.random.default_rng(7)
    random_bytes = random.integers(len(data), size=30)
    bytes_of_names = [match.start() for match in re.finditer(b"velocity_coefficient", data)]

    def is_noticed(index):
        """Return whether reading fails after a flip in this byte, or check the numbers."""
        changed = bytearray(data)
        changed[index] ^= 1 << int(random.integers(8))
        path.write_bytes(changed)
        try:
            assert read() == expected
        except sk.SpherekitError:
            return True
        return False

    noticed_at_random = sum(is_noticed(index) for index in random_bytes)
    assert noticed_at_random > 15
    for index in bytes_of_names:
        is_noticed(index)
