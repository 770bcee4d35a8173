"""The benchmarks run from a fresh process and report what they say they do."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from chains import with_contacts

from benchmarks import configurations
from benchmarks.history import comparison, entry_of, keep, kept
from benchmarks.report import Section, markdown
from spherekit.model.graph import pieces
from spherekit.planning.inputs import graph_mobility

ROOT = Path(__file__).parent.parent


@pytest.mark.slow
def test_quick_benchmarks_write_markdown_and_json(tmp_path):
    target = tmp_path / "figures.json"
    command = ["-m", "benchmarks", "--quick", "--json"]
    out = subprocess.run(
        [sys.executable, *command, str(target), "planning", "accuracy"],
        cwd=ROOT,
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    assert out.startswith("# Benchmarks\n")
    assert "## Errors by chain" in out
    content = json.loads(target.read_text())
    assert set(content["machine"]) >= {"processor", "cores", "Python", "NumPy"}
    assert list(content["benchmarks"]) == ["planning", "accuracy"]
    distribution = content["benchmarks"]["accuracy"][0]
    largest = distribution["rows"][-1]
    assert largest[0] == "largest"
    assert 0.0 <= largest[1] < 1e-12
    for section in content["benchmarks"]["planning"]:
        links = [row[0] for row in section["rows"]]
        assert links == [4, 8, 16, 32]


@pytest.mark.slow
def test_quick_benchmark_of_configurations():
    """Over the four-bar the four-bar is 1, and contact pairs are as many as asked for."""
    shipped, links, contacts = configurations.run(quick=True)
    ratios = {row[0]: row for row in shipped.rows}
    assert ratios["four_bar"][-1] == ratios["four_bar"][-4] == 1.0
    assert ratios["five_bar"][1] == 2
    assert [row[0] for row in links.rows] == [4, 12]
    assert [row[:2] for row in contacts.rows] == [(0, 0), (1, 0), (0, 2)]
    for rolling, sliding in ((0, 0), (3, 0), (1, 2)):
        made = with_contacts(np.random.default_rng(1), 8, rolling, sliding)
        kinds = [pair.type for pair in made.pairs]
        assert (kinds.count("Cr"), kinds.count("Cs")) == (rolling, sliding)
        assert len(made.links) == 8 and len(pieces(made)) == 1
        assert graph_mobility(made) == 1


def test_an_unknown_benchmark_is_refused():
    command = [sys.executable, "-m", "benchmarks", "planing"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 2
    assert "no benchmark is named planing; choose from" in done.stderr


def ratios_of(value, quick=True, processor="one"):
    section = Section(
        "Times", "", ("job", "ms", "over a"), [("a", 2.0, 1.0), ("b", 5.0, value)],
        ratios=("over a",),
    )  # fmt: skip
    machine = {"processor": processor, "cores": "2", "system": "x"}
    return entry_of({"jobs": [section]}, machine, quick)


def test_ratios_are_shown_first_and_kept(tmp_path):
    path = tmp_path / "history.jsonl"
    for value in (2.5, 2.6, 2.4):
        keep(ratios_of(value), path)
    entries = kept(path)
    assert [one["ratios"]["jobs | Times | b | over a"] for one in entries] == [
        2.5,
        2.6,
        2.4,
    ]
    assert set(entries[0]) == {"date", "commit", "quick", "machine", "ratios"}
    same, near, far = (comparison(ratios_of(x), entries)[1] for x in (2.4, 2.6, 4.8))
    assert same.startswith("     +0.0 %") and near.startswith("     +8.3 %")
    assert far.startswith("!! +100.0 %")
    nothing = ["no earlier run on a like machine was kept"]
    assert comparison(ratios_of(2.4, quick=False), entries) == nothing
    assert comparison(ratios_of(2.4, processor="two"), entries) == nothing


def test_markdown_puts_ratios_before_other_figures():
    section = Section(
        "T", "x", ("a", "b", "ms", "ratio"), [("k", 1, 3.0, 0.5)], "", ("ratio",), 2
    )  # fmt: skip
    assert "| a | b | ratio | ms |" in markdown(section)
    assert "| k | 1 | 0.5 | 3 |" in markdown(section)
    assert section.figures() == {"k 1 | ratio": 0.5}
