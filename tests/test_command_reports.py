"""What `sweep`, `synthesize` and `validate` print, and options that are given twice."""

import json
import re
from pathlib import Path

import pandas as pd
import pytest

from spherekit.cli.main import main
from spherekit.cli.sweep_report import _count_rows
from spherekit.wording import size_text, without_numbers

SYNTHESIS = Path(__file__).parent.parent / "examples" / "synthesis" / "function.toml"
SWEEP = ["sweep", "four_bar", "--vary", "links.2.arc=10,20,40", "--samples", "5"]
INFINITE = "grows=max(1/(theta_21 - 1.5707963267948966))"
"""A figure of merit that is infinite if a sample is at 90 deg."""


def test_infinite_figures_of_merit_leave_the_other_numbers_as_they_are(capsys):
    """The conditions of the figure make it infinite for one design only."""
    reduce = ["--reduce", "much=max(1/max(theta_41 + 1, 0))"]
    assert main([*SWEEP, *reduce]) == 0
    lines = capsys.readouterr().out.splitlines()
    highest = next(line.split() for line in lines if "highest" in line)
    lowest = next(line.split() for line in lines if "lowest" in line)
    assert highest[2] == "inf"
    assert highest[4] == "+"
    assert 0.1 < float(lowest[1]) < 1.0


def test_json_rows_have_null_for_infinite_figures(capsys):
    assert main([*SWEEP, "--reduce", INFINITE, "--json"]) == 0
    out = capsys.readouterr().out
    assert "Infinity" not in out
    assert all(json.loads(line)["grows"] is None for line in out.splitlines())


def test_figures_are_drawn_also_if_the_rows_are_printed_as_json(tmp_path, capsys):
    saved = ["-o", str(tmp_path), "--figures", "svg", "--json"]
    assert main([*SWEEP, "--reduce", "most=max(theta_41)", *saved]) == 0
    rows = capsys.readouterr().out.splitlines()
    assert [json.loads(row)["design"] for row in rows] == [0, 0, 1, 1, 2, 2]
    assert (tmp_path / "_figures" / "most.svg").exists()


def test_the_stated_distance_of_samples_is_the_largest(capsys):
    """Samples at equal times of a cycloidal law are nearest at its ends."""
    law = ["--law", "cycloidal:from=0deg,to=90deg,duration=2", "--duration", "2"]
    assert main([*SWEEP, *law, "--reduce", "most=max(theta_41)"]) == 0
    # Between a quarter and a half of the duration: 45 deg - (22.5 - 90 / (2 pi)) deg.
    assert "(up to 36.8239 deg of input 21 apart)" in capsys.readouterr().out
    assert main([*SWEEP, "--reduce", "most=max(theta_41)"]) == 0
    assert "(90 deg of input 21 apart)" in capsys.readouterr().out


def test_a_sweep_over_one_assembly_mode_does_not_claim_all(capsys):
    assert main([*SWEEP, "--reduce", "most=max(theta_41)", "--assembly-mode", "1"]) == 0
    assert "3 designs, each in one assembly mode, with" in capsys.readouterr().out
    assert main([*SWEEP, "--reduce", "most=max(theta_41)", "--no-search"]) == 0
    assert "3 designs, each in its assembly modes, with" in capsys.readouterr().out


def test_a_mode_that_misses_few_samples_does_not_exist_at_100_percent():
    frame = pd.DataFrame({"design": [0, 1], "closes": [1.0, 2999 / 3000]})
    text = _count_rows(frame, pd.Series([True, True]), ())
    assert text.endswith("each at 99.9 % or more")


def test_without_numbers_no_table_is_mentioned_and_no_figures_are_suggested(capsys):
    assert main([*SWEEP, "--reduce", "none=max(sqrt(theta_41 - 100))"]) == 0
    out = capsys.readouterr().out
    assert "This table" not in out
    assert "--figures" not in out
    assert "-o DIR" in out


def test_no_mechanism_like_a_shipped_study_is_suggested(capsys):
    """A study names its mechanism, and `new mechanism --like` needs a mechanism."""
    subject = ["sweep", "stephenson_output", "--vary", "links.2.arc=60"]
    assert main([*subject, "--reduce", "most=max(theta_34)", "--samples", "3"]) == 0
    assert "--like" not in capsys.readouterr().out


def test_a_synthesis_is_refused_in_advance_if_its_file_cannot_be_written(
    tmp_path, capsys, monkeypatch
):
    """The search is not begun, and the synthesis file is not replaced."""
    monkeypatch.setattr("spherekit.api.designs.synthesize", None)
    path = tmp_path / "wanted.toml"
    path.write_bytes(SYNTHESIS.read_bytes())
    missing = str(tmp_path / "missing" / "found.toml")
    assert main(["synthesize", str(path), "-o", missing]) != 0
    assert "the folder does not exist" in capsys.readouterr().err
    assert main(["synthesize", str(path), "-o", str(path)]) != 0
    assert "is the synthesis file; choose another file" in capsys.readouterr().err
    assert path.read_bytes() == SYNTHESIS.read_bytes()


@pytest.mark.slow
def test_a_synthesis_with_infinite_figures_prints_the_other_numbers(tmp_path, capsys):
    text = SYNTHESIS.read_text()
    text = text.replace("[figures]", '[figures]\nsteep = "max(1/theta_21)"')
    path = tmp_path / "wanted.toml"
    path.write_text(text)
    found = tmp_path / "a b.toml"
    options = ["--designs", "64", "--starts", "1", "-o", str(found)]
    assert main(["synthesize", str(path), *options]) == 0
    lines = capsys.readouterr().out.splitlines()
    heading = next(line.strip() for line in lines if line.strip().startswith("design "))
    best = next(line.split() for line in lines if re.match(r"\s+0  ", line))
    columns = re.split(r"\s{2,}", heading)
    assert best[columns.index("steep")] == "inf"
    assert any(f"spherekit run '{found}'" in line for line in lines)


def test_the_command_that_a_validation_suggests_reads_the_same_mechanism(tmp_path, capsys):
    path = tmp_path / "two words.study.toml"
    path.write_text('format = 1\nmechanism = "four_bar"\n')
    assert main(["validate", str(path)]) == 0
    assert f"spherekit run '{path}'" in capsys.readouterr().out
    assert main(["validate", "five_bar", "--lock", "51=80deg"]) == 0
    out = capsys.readouterr().out
    assert "spherekit run five_bar --lock 51=80deg" in out
    assert "spherekit view" not in out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["five_bar", "--lock", "51=80deg", "--lock", "51=81deg"], "51 has two values"),
        (
            ["four_bar", "--law", "constant_speed:speed=1", "--duration", "1"]
            + ["--law", "21=constant_speed:speed=2"],
            "input 21 has two laws",
        ),
    ],
)
def test_a_pair_with_two_values_or_laws_is_refused(words, message, capsys):
    assert main(["run", *words, "--samples", "3"]) != 0
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("count", "text"),
    [
        (999_400, "999 kB"),
        (999_500, "1 MB"),
        (999_999, "1 MB"),
        (999.6e6, "1 GB"),
        (999.6e9, "1 TB"),
        (1.5e9, "1.5 GB"),
        (12, "0.012 kB"),
    ],
)
def test_sizes_of_memory_have_no_exponent(count, text):
    assert size_text(count) == text


@pytest.mark.parametrize("number", ["3", "-2.5", "1e-05", "1.5e-3", "2e+10"])
def test_numbers_at_the_end_of_a_sentence_are_left_out(number):
    assert without_numbers(f"It is {number}.") == "It is "
    assert without_numbers(f"It is {number}, large") == "It is , large"
    assert without_numbers(f"links.4.arc: {number}") == "links.4.arc: "
