"""The benchmarks run and report what they say they do."""

import json

import pytest

from benchmarks.__main__ import main
from benchmarks.harness import Section, format_section


@pytest.mark.slow
def test_quick_benchmarks_write_markdown_and_json(tmp_path, capsys):
    target = tmp_path / "figures.json"
    assert main(["--quick", "--json", str(target), "planning"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("# Benchmarks\n")
    assert "## Planning: chains of dyads" in out
    content = json.loads(target.read_text())
    assert set(content["machine"]) >= {"processor", "cores", "Python", "NumPy"}
    assert list(content["benchmarks"]) == ["planning"]
    for section in content["benchmarks"]["planning"]:
        assert [row[0] for row in section["rows"]] == [4, 8, 16, 32]


def test_an_unknown_benchmark_is_refused(capsys):
    with pytest.raises(SystemExit):
        main(["planing"])
    assert "no benchmark is named planing; choose from" in capsys.readouterr().err


def test_markdown_has_three_digits_and_numbers_to_the_right():
    rows = [("k", 1.23456, None), ("m", 12345.6, 2)]
    text = format_section(Section("T", "x", ("a", "b", "c"), rows), "1234")
    assert "Taken at commit 1234." in text and "|---|---:|---:|" in text
    assert "| k | 1.23 | - |" in text and "| m | 12346 | 2 |" in text
