"""Help that loads little, examples that are real, new files, shells that complete."""

import json
import os
import pty
import re
import select
import shlex
import subprocess
import sys
import time
from argparse import Namespace
from pathlib import Path

import pytest

import spherekit as sk
from spherekit.cli.command_line import COMMANDS, build_parser
from spherekit.cli.completers import complete_analyses
from spherekit.cli.main import main
from spherekit.cli.new import KINDS

BIN = Path(sys.executable).parent
HEAVY = {"numpy", "scipy", "pandas", "pyarrow", "rerun", "networkx", "jsonschema", "mpmath"}


def helps():
    """The words of each subcommand."""
    return [(), *((name,) for name in COMMANDS)]


@pytest.mark.parametrize("words", helps())
def test_help_loads_no_large_library_and_no_other_command(words):
    """The help of a command is fast: it loads no large library and no other command.

    `words` are the words of the command before "--help". A fresh process prints the help
    and then the names of all loaded modules. `HEAVY` are the libraries that must not be
    among them.
    """
    code = (
        f"import sys; from spherekit.cli.main import main\ntry: main([*{words!r}, "
        "'--help'])\nexcept SystemExit: print(*sys.modules)"
    )
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    text, _, last_line = process.stdout.rstrip().rpartition("\n")
    modules = set(last_line.split())
    assert not HEAVY & modules
    # `run` has options that other commands share.
    others = {f"spherekit.cli.{name}" for name in COMMANDS} - {"spherekit.cli.run"}
    others -= {f"spherekit.cli.{word}" for word in words}
    assert not others & modules
    assert "examples:\n  # " in text


@pytest.mark.parametrize("words", helps())
def test_examples_in_help_are_understood(words, capsys):
    with pytest.raises(SystemExit):
        main([*words, "--help"])
    shown = capsys.readouterr().out.partition("examples:\n")[2]
    lines = re.findall(r"^  (?!# )(.*)$", shown, re.M)
    assert len(lines) >= 2
    for line in lines:
        found = re.search(r"spherekit ([^|)]*)", line)
        build_parser().parse_args(shlex.split(found[1]))


@pytest.mark.many
@pytest.mark.parametrize("kind", KINDS)
def test_a_new_mechanism_runs_as_it_is(kind, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["new", "mechanism", "mine", "--kind", kind]) == 0
    made = sk.load(tmp_path / "mine.toml")
    assert made.name == "mine" and made.outputs
    assert len(re.findall(r"^# ", (tmp_path / "mine.toml").read_text(), re.M)) >= 6
    assert "spherekit run mine.toml" in capsys.readouterr().out
    assert main(["run", "mine.toml", "--samples", "9", "--json"]) == 0
    assert set(json.loads(capsys.readouterr().out)["status"]) == {"OK"}


def test_what_is_commented_out_in_a_new_mechanism_reads_too(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    main(["new", "mechanism", "mine", "-q"])
    text = (tmp_path / "mine.toml").read_text()
    head, mark, tail = text.partition("# [mass.rocker]")
    tail = re.sub(r"^# ?", "", mark + tail, flags=re.M)
    (tmp_path / "mine.toml").write_text(head + tail)
    made = sk.load("mine.toml")
    assert made.loads and made.masses and made.joint_limits


def test_a_new_mechanism_like_another_moves_like_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["new", "mechanism", "deep/mine", "--like", "watt", "-q"]) == 1
    Path("deep").mkdir()
    assert main(["new", "mechanism", "deep/mine", "--like", "watt", "-q"]) == 0
    made, old = sk.load("deep/mine.toml"), sk.load("watt")
    assert (made.name, made.pairs, made.links) == ("mine", old.pairs, old.links)


def test_a_new_file_never_replaces_one(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("mine.toml").write_text("mine")
    assert main(["new", "mechanism", "mine"]) == 1
    assert "mine.toml: exists already" in capsys.readouterr().err
    assert Path("mine.toml").read_text() == "mine"


CASES = {
    "spherekit expl": "explain",
    "spherekit run double_b": "double_butterfly",
    "spherekit run four_bar -a eks": "eksergian",
    "spherekit run four_bar --asse": "--assembly-mode",
}


def test_parameters_of_an_unknown_analysis_are_not_completed():
    assert complete_analyses("poles:", Namespace())[0] == "poles:only="
    assert complete_analyses("nope:", Namespace()) == []


def test_bash_completes_commands_mechanisms_analyses_and_options():
    """A real bash completes commands, mechanisms, analyses and options.

    The words of `CASES` are typed into a terminal, each followed by the tab key, and the
    completed word must appear.
    """
    path = f"{BIN}{os.pathsep}{os.environ['PATH']}"
    child, terminal = pty.fork()
    if child == 0:  # the child process becomes the shell
        environment = {**os.environ, "PATH": path, "TERM": "dumb", "PS1": "$ "}
        os.execvpe("bash", ["bash", "--norc", "--noprofile", "-i"], environment)
    try:
        # The terminal echoes what is typed, so the word to wait for is typed in two parts.
        os.write(terminal, b'eval "$(spherekit completion bash)"; echo rea""dy\n')
        assert "ready" in read_until(terminal, "ready")
        for typed, completed in CASES.items():
            os.write(terminal, f"{typed}\t".encode())
            assert completed in read_until(terminal, completed), typed
            os.write(terminal, b"\x15")  # Ctrl-U deletes the line
    finally:
        os.close(terminal)
        os.waitpid(child, 0)


def read_until(terminal, word, limit_s=20.0):
    """Return what a terminal shows until a word appears, or until the limit of time."""
    text = ""
    end = time.monotonic() + limit_s
    while word not in text and time.monotonic() < end:
        if select.select([terminal], [], [], 0.2)[0]:
            text += os.read(terminal, 4096).decode(errors="replace")
    return text
