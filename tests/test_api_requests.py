"""Requests of the Python interface that have no effect or no meaning are refused."""

import math
import warnings

import pytest

import spherekit as sk
from spherekit.errors import FileError, OutputError, SolveError


def write_synthesis(folder, quantity, value):
    """Write a synthesis file with one precision point, and return its path."""
    path = folder / "wanted.toml"
    path.write_text(
        'format = 1\nmechanism = "four_bar"\nminimise = "match"\n'
        'vary = {"links.2.arc" = [15, 30]}\n'
        f'match = {{quantity = "{quantity}", at = [10], values = [{value}]}}\n'
    )
    return path


@pytest.mark.parametrize("angle", ["nan", "inf"])
def test_an_angle_written_as_text_has_to_be_finite(tmp_path, angle):
    """The message has the line of the file, as for a number without quotation marks."""
    path = write_synthesis(tmp_path, "theta_41", f'"{angle}"')
    with pytest.raises(FileError, match=f'toml:5: .*found "{angle}", expected a finite'):
        sk.synthesize(path, designs=4, starts=1)


def test_a_synthesis_does_not_take_an_angular_velocity_for_a_direction(tmp_path):
    """Its components would be divided by their length, which is part of the wish."""
    path = write_synthesis(tmp_path, "angular_velocity_4", "[0, 0, 2]")
    with pytest.raises(FileError, match="angular_velocity_4 is neither a direction nor"):
        sk.synthesize(path, designs=4, starts=1)


@pytest.mark.parametrize("name", ["table.csv", "copy.toml"])
def test_an_export_without_angles_has_no_unit_of_angles(tmp_path, name):
    """A coupling table is in rad, also if degrees are requested."""
    with pytest.raises(OutputError, match='"angle_unit" does not apply'):
        sk.export("four_bar", tmp_path / name, angle_unit="deg")
    assert not (tmp_path / name).exists()


def test_an_infinite_input_gives_an_error_without_a_warning():
    """`evaluate` names the wrong input; NumPy does not warn before."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(SolveError, match="not finite"):
            sk.evaluate("four_bar", [0.3, math.inf])
