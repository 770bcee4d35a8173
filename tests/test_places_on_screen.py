"""Where modes exist and outputs rest, as the report of a run on the screen says it."""

from dataclasses import replace

import numpy as np

import spherekit as sk
from spherekit.cli.main import main
from spherekit.cli.mode_text import describe_modes
from spherekit.cli.motion_screen import output_table
from spherekit.files.study_reader import study_of


def cells_of(table):
    """Return the first row of a table, by the headings of its columns."""
    headings = [column.heading for column in table.columns]
    return dict(zip(headings, table.rows[0], strict=True))


def test_an_output_that_moves_does_not_rest_everywhere_at_a_single_sample():
    cells = cells_of(output_table(sk.run("four_bar", samples=1).summary))
    assert cells["velocity ratio"] == "-0.5321"
    assert cells["comes to rest (type I singularity) near sample"] == "none"


def test_inputs_of_a_path_without_order_have_the_heading_of_inputs():
    """The first sample is 0.3 rad, or 17.19 deg; there the transmission angle is least."""
    path = np.array([[0.3], [0.5], [0.4]])
    study = replace(study_of("four_bar"), path=path, samples=3)
    cells = cells_of(output_table(sk.run(study).summary))
    assert cells["at input 21 (deg)"] == "17.19"


def test_samples_at_which_a_mode_of_a_grid_exists_are_counted():
    """One missing sample of 861 is not rounded away, and singular samples count."""
    summary = sk.run("five_bar", samples=(3, 3)).summary
    mode = summary["assembly_modes"][0]
    mode["status"] = {"OK": 858, "AT_SINGULARITY": 2, "OUT_OF_REACH": 1}
    summary["overview"]["modes"]["0"]["closes_everywhere"] = False
    assert "Mode 0 exists at 860 of the 861 samples." in describe_modes(summary)


def test_in_a_simulation_the_speed_of_an_output_without_axis_is_explained(capsys):
    start = ["--start", "q=60deg+60deg,dq=1rad/s+0rad/s", "--duration", "0.1"]
    assert main(["run", "five_bar", *start, "--samples", "5"]) == 0
    out = capsys.readouterr().out
    assert "The speed is a magnitude." in out
    assert "velocity ratio is" not in out
