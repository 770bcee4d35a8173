"""The guides are typed by a reader, block by block, from an empty folder.

Each page begins in a new folder, in which the blocks are used in the order of the page, as
a reader does:

- files that the page shows under a name are saved,
- commands are run, and those after a `$` print the lines below them,
- Python blocks run in one namespace, as if they were in one script.

Tests of `test_docs` run the same blocks, but they have the files of all pages from the
beginning.
"""

import re
import shlex
from contextlib import nullcontext
from pathlib import Path
from typing import NamedTuple

import pytest
from helpers.console_text import shows

from spherekit.cli.main import main

DOCS = Path(__file__).parent.parent / "docs"
PAGES = [
    "first_mechanism.md",
    *sorted(
        path.relative_to(DOCS).as_posix()
        for folder in ("tutorials", "how_to")
        for path in (DOCS / folder).glob("*.md")
        if path.name != "index.md"
    ),
]
REFERENCE_PAGES = ["exchange.md", "figures.md", "pages.md", "python.md"]
"""Pages of the reference that the list of how-to guides links to."""
BLOCK = re.compile(r"^```(\w+|\{run\})\n(.*?)^```$", re.M | re.S)
FILE_NAME = re.compile(r"(?:# |<!-- |/\* )([\w.]+\.\w+)")
"""The name of a file in the comment on the first line of a block."""
NOT_TYPED_HERE = ("python3 -m venv", ".venv/bin/pip", ". .venv/bin/", "mkdir ~/", "cd ~/")
"""Beginnings of commands that install spherekit or change the folder."""
SKIPPED_COMMANDS = {
    "spherekit view wiper.rrd": "opens a window",
    "--samples 10000000": "takes minutes",
    "--png": "needs a driver for pictures",
}
"""Parts of commands that are not run, with the reason."""
NEEDS_MUJOCO = "spherekit import"
SAVED_SCRIPT = re.compile(r"\b[Ss]ave\s+(?:the|this) (?:Python )?blocks?\b")
"""A sentence that says where the Python blocks of a page are saved."""


class PageBlock(NamedTuple):
    """A block of a page: the kind of its text, such as ``console``, and the text."""

    kind: str
    text: str


def page_blocks(page):
    text = (DOCS / page).read_text(encoding="utf-8")
    return [PageBlock(*found) for found in BLOCK.findall(text)]


def is_hidden(block):
    """Return whether the site shows only the figure of a Python block."""
    return block.text.startswith(":hide:")


def without_options(code):
    """Return the code of a block that the site runs, without options of the directive."""
    return re.sub(r"^:.*\n", "", code, flags=re.M)


def run_commands(text):
    """Run the commands of a block of shell commands that are commands of spherekit."""
    for line in text.splitlines():
        command = line.partition(" #")[0].strip()
        is_skipped = any(part in command for part in SKIPPED_COMMANDS)
        if not command or command.startswith(NOT_TYPED_HERE) or is_skipped:
            continue
        program, *arguments = shlex.split(command)
        assert program == "spherekit", command
        assert main(arguments) == 0, command


def check_console(text, capsys):
    """Run the commands after a `$`, and compare what they print; `...` is any lines."""
    for example in filter(None, re.split(r"^\$ ", text, flags=re.M)):
        command, _, shown = example.partition("\n")
        program, *arguments = shlex.split(command)
        assert program == "spherekit", command
        capsys.readouterr()
        assert main(arguments) == 0, command
        printed = capsys.readouterr()
        text_on_screen = printed.out + printed.err
        assert shows(shown, text_on_screen), f"{command}\n{text_on_screen}"


@pytest.mark.slow
@pytest.mark.many(slow="all")
@pytest.mark.parametrize("page", [*PAGES, *REFERENCE_PAGES])
def test_a_reader_can_type_a_guide_from_an_empty_folder(
    page, tmp_path, capsys, monkeypatch
):
    """A reader can follow each guide of the documentation, block by block, in a new folder.

    Files that a page shows are saved, commands are run, and Python blocks run in one
    namespace. `check_console` compares what commands print with the page.

    The kind "{run}" is Python code that the documentation site runs too, to show its
    results. It begins with options of the site, which `without_options` removes. The option
    "hide" (`is_hidden`) says that readers see only the figure, not the code, so they cannot
    type it.
    """
    blocks = page_blocks(page)
    if any(NEEDS_MUJOCO in block.text for block in blocks):
        pytest.importorskip("mujoco")
    pytest.importorskip("matplotlib")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    # What is printed about progress depends on the clock.
    monkeypatch.setattr(
        "spherekit.progress.progress_listener", lambda listener: nullcontext()
    )
    namespace = {"__name__": "__main__"}
    for block in blocks:
        file_name = FILE_NAME.match(block.text)
        if block.kind in ("toml", "xml", "c") and file_name:
            Path(file_name[1]).write_text(block.text, encoding="utf-8")
        elif block.kind == "sh":
            run_commands(block.text)
        elif block.kind == "console":
            check_console(block.text, capsys)
        elif block.kind in ("python", "{run}") and not is_hidden(block):
            exec(compile(without_options(block.text), page, "exec"), namespace)


@pytest.mark.parametrize("page", PAGES)
def test_a_guide_says_where_its_python_is_saved(page):
    """A page with Python names a script; figures are saved, as a script shows none."""
    code_blocks = [
        without_options(block.text)
        for block in page_blocks(page)
        if block.kind in ("python", "{run}") and not is_hidden(block)
    ]
    text = (DOCS / page).read_text(encoding="utf-8")
    if code_blocks:
        assert SAVED_SCRIPT.search(text)
        assert re.search(r"`python \w+\.py`", text)
    for code in code_blocks:
        if "plt.subplots(" in code or ".plot(" in code:
            assert ".savefig(" in code
