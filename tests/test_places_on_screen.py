"""Where modes exist and outputs rest, as the report of a run on the screen says it."""

from dataclasses import replace

import numpy as np
import pytest

import spherekit as sk
from spherekit.cli.main import main
from spherekit.cli.mode_text import describe_modes
from spherekit.cli.motion_screen import output_table
from spherekit.cli.place_text import PlaceText
from spherekit.cli.run_report import _row_warnings
from spherekit.files.study_reader import study_of
from spherekit.mechanism.elements import Output
from spherekit.runs.mode_overview import ModeOverview
from spherekit.status import Status


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


@pytest.mark.parametrize("rates", [(-0.3, -0.3), (-0.3, 0.2)])
def test_the_speed_of_a_direction_in_a_simulation_is_that_of_all_inputs_together(rates):
    """In a short time the direction turns by nearly its speed times this time."""
    start = sk.Start(np.radians([20.0, 17.0]), rates)
    summary = sk.run(
        "two_dof_spm", (), samples=5, start=start, duration=0.01, assembly_mode=0
    ).summary
    (output,) = summary["overview"]["modes"]["0"]["outputs"]
    mean_speed = output["highest_rad"] / 0.01
    assert output["lowest_ratio"] == pytest.approx([mean_speed], rel=5e-3)
    assert output["highest_ratio"] == pytest.approx([mean_speed], rel=5e-3)


def test_an_output_without_axis_that_turns_back_in_a_simulation_has_the_least_speed_0():
    """A torque against the motion turns the input back between two samples."""
    coupler = Output(name="coupler", link="3", relative_to="1", direction=None)
    mechanism = replace(sk.load("four_bar"), outputs=(coupler,))
    start = sk.Start(1.0, 0.5)
    options = {"samples": 4, "start": start, "duration": 0.5, "torque": -10.0}
    result = sk.run(mechanism, (), **options, assembly_mode=0)
    (output,) = result.summary["overview"]["modes"]["0"]["outputs"]
    assert output["lowest_ratio"] == [0.0]
    assert output["highest_ratio"][0] > 0.0


def test_the_last_sample_of_a_long_run_counts_as_examined():
    """Every second of 722 samples is examined, with the even numbers 0 to 720, and 721."""
    summary = sk.run("bevel_pair", (), samples=722, assembly_mode=0).summary
    assert summary["overview"]["examined_samples"] == 362


def test_a_mode_with_many_singular_samples_exists_everywhere():
    """At 0 the sheet of paper is flat, which is a singularity at every second sample."""
    path = np.radians(np.tile([0.0, 20.0], 40))[:, None]
    summary = sk.run("flat_foldable_vertex", (), path=path).summary
    for mode in summary["overview"]["modes"].values():
        assert mode["unlisted_spans"] == {"OK": 8, "AT_SINGULARITY": 8}
        assert mode["closes"] == [[0.0, 79.0]]
        assert mode["closes_everywhere"]


@pytest.mark.parametrize("size", [1, 4, 1000])
def test_unlisted_spans_are_counted_once_in_blocks_of_any_size(size):
    codes = np.tile(np.repeat([Status.OK, Status.OUT_OF_REACH], 5), 40)
    overview = ModeOverview()
    for first in range(0, len(codes), size):
        overview.add_status(codes[first : first + size], first)
    assert overview.closing_spans == overview.spans["OK"]
    for spans in overview.spans.values():
        assert len(spans.listed) + spans.unlisted_count == 40


def test_spans_that_the_summary_leaves_out_count_as_further_spans():
    """The mode exists in two ranges of each of 17 turns."""
    path = np.radians(np.arange(0.0, 17 * 360.0, 30.0))[:, None]
    summary = sk.run("eight_bar_15", (), path=path, assembly_mode=4).summary
    mode = summary["overview"]["modes"]["4"]
    span_count = len(mode["closes"]) + mode["unlisted_closing_spans"]
    assert span_count == 34
    assert describe_modes(summary)[-1].endswith("and 30 more deg.")
    (warning,) = _row_warnings(summary)
    assert "and 30 more deg)" in warning


def test_equal_velocity_ratios_have_their_least_value_at_the_first_sample():
    """The ratio of bevel gears is constant, up to rounding errors."""
    summary = sk.run("bevel_pair", (), samples=60, block=7, assembly_mode=0).summary
    (output,) = summary["overview"]["modes"]["0"]["outputs"]
    assert output["jacobian"]["place"] == 0.0


def place_text(kind, first, last, samples):
    """Return the texts of places for a range of inputs in degrees, or of times in s."""
    name, unit = {"input": ("21", "rad"), "time": ("t", "s")}[kind]
    ends = np.radians([first, last]) if kind == "input" else [first, last]
    place = {"kind": kind, "name": name, "unit": unit}
    return PlaceText(
        {"place": place, "place_range": list(ends), "examined_samples": samples}
    )


@pytest.mark.parametrize(("first", "last"), [(-180, -175), (-180, -150), (0, 360)])
def test_samples_exactly_five_degrees_apart_are_far_apart_in_each_range(first, last):
    """A step computed from radians can be less than 5 deg by rounding errors."""
    texts = place_text("input", first, last, (last - first) // 5 + 1)
    assert texts.are_samples_far_apart
    assert texts.coarse_step_text == "5 deg"
    assert texts.value(np.radians(12.3), between_samples=True) == "12"


@pytest.mark.parametrize("between_samples", [False, True])
def test_the_texts_of_times_distinguish_the_samples_of_a_long_motion(between_samples):
    texts = place_text("time", 0.0, 20000.0, 20001)
    assert texts.value(12345.0, between_samples) == "12345"
    assert texts.value(12346.0, between_samples) == "12346"
