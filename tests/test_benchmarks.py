"""The benchmarks run and report what they say they do."""

import json

import pytest

from benchmarks.__main__ import main
from benchmarks.comparison import comparison_section
from benchmarks.harness import Section, format_section
from benchmarks.page import page_text, read_record, record_sections, write_record


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


MACHINE = {"processor": "P", "cores": "2"}
PEERS = Section(
    "Peers: forward dynamics, one loop",
    "x",
    ("engine", "setting", "error of q, rad", "ms, median", "ms, fastest"),
    [
        ("spherekit compiled", "tolerance 1e-6", 1e-6, 1.0, 1.0),
        ("spherekit compiled", "tolerance 1e-9", 1e-9, 2.0, 1.9),
        ("spherekit NumPy", "tolerance 1e-9", 1e-12, 300.0, 290.0),
        ("Pinocchio", "rtol 1e-6", 1e-7, 20.0, 19.0),
        ("Pinocchio", "rtol 1e-9", 2e-9, 60.0, 50.0),
        ("MuJoCo", "step 0.001 s", 3e-9, 90.0, 80.0),
    ],
)


def test_the_comparison_takes_the_fastest_settings_that_are_accurate():
    record = {}
    record_sections(record, "peers", [PEERS], MACHINE, "12345678")
    (row,) = comparison_section(record["benchmarks"]).rows
    assert row[1:] == (
        "2 ms, error 1e-09 rad (compiled)",
        "60 ms, error 2e-09 rad (Pinocchio)",
        30.0,
    )


def test_nothing_is_compared_without_another_program():
    assert comparison_section({"peers": []}) is None
    alone = Section(PEERS.title, PEERS.text, PEERS.columns, PEERS.rows[:3])
    record = {}
    record_sections(record, "peers", [alone], MACHINE, "12345678")
    assert comparison_section(record["benchmarks"]) is None


def record_of_two_benchmarks(commit, other_commit):
    """Return a record of the benchmark "peers" and of another one, with their commits.

    The other benchmark has one section with the heading "Other".
    """
    other = Section("Other", "x", ("a",), [(1,)])
    record = {}
    record_sections(record, "peers", [PEERS], MACHINE, commit)
    record_sections(record, "other", [other], MACHINE, other_commit)
    return record


def test_the_page_states_the_commit_once_if_it_is_the_same_everywhere():
    record = record_of_two_benchmarks("12345678", other_commit="12345678")
    assert page_text(record).count("12345678") == 1


def test_the_page_states_the_commit_of_each_section_if_they_differ():
    record = record_of_two_benchmarks("12345678", other_commit="abcdef99")
    assert page_text(record).count("Taken at commit") == 2


def test_the_page_begins_with_the_comparison_with_other_programs():
    """The heading of the comparison is before the heading of any recorded section."""
    text = page_text(record_of_two_benchmarks("12345678", other_commit="12345678"))
    assert text.index("spherekit beside other programs") < text.index("## Other")


def test_a_record_that_is_written_and_read_again_gives_the_same_page(tmp_path):
    path = tmp_path / "record.json"
    assert read_record(path) == {}  # there is no file yet
    record = record_of_two_benchmarks("12345678", other_commit="12345678")
    write_record(record, path)
    assert page_text(read_record(path)) == page_text(record)


def test_results_of_another_machine_are_refused():
    record = {}
    record_sections(record, "peers", [PEERS], MACHINE, "12345678")
    with pytest.raises(ValueError, match="another machine"):
        record_sections(record, "peers", [PEERS], {"processor": "Q"}, "12345678")
