"""A crank in two bearings, one of them redundant: what the commands say agrees."""

import pytest
from helpers.refusals import mechanism_text

from spherekit.cli.main import main

TEXT = mechanism_text("two_bearings")
"""Mechanism file: the counting formula gives mobility -1, the rank of the equations 1."""


@pytest.fixture
def path(tmp_path):
    file = tmp_path / "two_bearings.toml"
    file.write_text(TEXT)
    return str(file)


def test_a_plan_uses_the_mobility_by_rank(path, capsys):
    """The pole plan exists although counting links and pairs says that nothing moves."""
    assert main(["validate", path]) == 0
    printed = capsys.readouterr().out
    assert "1 degree of freedom" in printed
    assert "Counting links and pairs (Gruebler) gives -1" in printed
    assert main(["plan", path, "--steps"]) == 0
    printed = capsys.readouterr().out
    assert "P(drum,frame) = axis of R pair left" in printed
    assert "I    P(rod,frame) case (a)" in printed


@pytest.mark.slow
def test_a_plan_of_a_rigid_mechanism_is_refused(tmp_path, capsys):
    """The command `plan` refuses a mechanism that a further joint makes rigid.

    The mechanism of the file has one degree of freedom. The joint `tie` between the links
    rod and frame removes it.
    """
    text = TEXT
    # Each line replaces a passage of the file. Lines 1 and 2 add an axis for the new pair
    # to the frame, with an arc and an angle. Lines 3 and 4 do the same for the rod.
    for passage, replacement in (
        ('"hinge"], arcs = [180.0, 60.0]', '"hinge", "tie"], arcs = [180.0, 60.0, 50.0]'),
        ("angles = [0.0] }\ndrum", "angles = [0.0, 40.0] }\ndrum"),
        ('["tip", "joint"]', '["tip", "joint", "tie"]'),
        ("arcs = [70.0]", "arcs = [70.0, 35.0], angles = [20.0]"),
    ):
        assert passage in text
        text = text.replace(passage, replacement)
    rigid = tmp_path / "stiff.toml"
    rigid.write_text(text + 'tie = { type = "R", links = ["rod", "frame"] }\n')
    assert main(["plan", str(rigid)]) == 1
    assert "over-constrained" in capsys.readouterr().err


def test_sensitivities_are_refused_where_no_size_may_deviate(path, capsys):
    """The loop through both bearings only closes for exact sizes."""
    assert main(["run", path, "-a", "sensitivity", "--samples", "5"]) == 1
    printed = capsys.readouterr().err
    assert "close only with the exact dimensions of the file" in printed
