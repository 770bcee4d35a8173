"""A crank in two bearings, one of them redundant: what the commands say agrees."""

import pytest
from helpers.refusals import mechanism_text

from spherekit.cli.main import main

TEXT = mechanism_text("two_bearings")


@pytest.fixture
def path(tmp_path):
    file = tmp_path / "two_bearings.toml"
    file.write_text(TEXT)
    return str(file)


def test_a_plan_goes_by_rank_where_a_run_does(path, capsys):
    assert main(["validate", path]) == 0
    assert "mobility -1 by the graph and 1 by rank" in capsys.readouterr().out
    assert main(["plan", path, "--steps"]) == 0
    said = capsys.readouterr().out
    assert "P(drum,frame) = axis of R pair left" in said
    assert "I    P(rod,frame) case (a)" in said


def test_a_plan_still_says_where_nothing_moves(tmp_path, capsys):
    stiff = tmp_path / "stiff.toml"
    tie = 'tie = { type = "R", links = ["rod", "frame"] }\n'
    text = TEXT
    for old, new in (
        ('"hinge"], arcs = [180.0, 60.0]', '"hinge", "tie"], arcs = [180.0, 60.0, 50.0]'),
        ("angles = [0.0] }\ndrum", "angles = [0.0, 40.0] }\ndrum"),
        ('["tip", "joint"]', '["tip", "joint", "tie"]'),
        ("arcs = [70.0]", "arcs = [70.0, 35.0], angles = [20.0]"),
    ):
        assert old in text
        text = text.replace(old, new)
    stiff.write_text(text + tie)
    assert main(["plan", str(stiff)]) == 1
    assert "over-constrained" in capsys.readouterr().err


def test_sensitivities_say_that_no_size_may_deviate(path, capsys):
    assert main(["run", path, "-a", "sensitivity", "--samples", "5"]) == 1
    said = capsys.readouterr().err
    assert "closes with its sizes as they are and with none that deviate" in said
