"""The benchmarks run from a fresh process and report what they say they do."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

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
    assert 0.0 < largest[1] < 1e-12
    for section in content["benchmarks"]["planning"]:
        links = [row[0] for row in section["rows"]]
        assert links == [4, 8, 16, 32]


def test_an_unknown_benchmark_is_refused():
    command = [sys.executable, "-m", "benchmarks", "planing"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 2
    assert "no benchmark is named planing; choose from" in done.stderr
