"""The screen table of the motion of all outputs, and the notes below this table."""

import math
from collections.abc import Sequence
from typing import Any

from spherekit.cli.mode_text import mode_name, modes_text, number_list
from spherekit.cli.place_text import MAX_LISTED_PLACES, PlaceText, angle_text
from spherekit.conventions import TURN, Lines
from spherekit.number_text import degrees_text, last_significant_digit, number_text
from spherekit.tables.screen_table import ScreenColumn, ScreenTable
from spherekit.wording import numbered

MAX_TABLE_ROWS = 40
"""Largest number of rows of a table on the screen; summary.json has all rows."""

RATIO_ERROR = 5e-10
"""Velocity ratios that are not larger are rounding errors, and printed as 0."""

ANGLE_ERROR_RAD = 5e-10
"""Ranges of angles that are not larger are rounding errors."""

FARTHEST_HEADING = "farthest from start"
"""Heading, without unit, of the column of swings of outputs without a fixed axis."""

MEASURE_HEADING = "least transmission measure"
"""Heading of the column of transmission measures, which a note explains."""

MEASURE_ERROR = 1e-7
"""Transmission measures that are not larger are rounding errors, and printed as 0."""

TRANSMISSION_ERROR_DEG = 1e-9
"""Transmission angles that are not larger are rounding errors, and printed as 0."""

TRANSMISSION_DIFFERENCE_RAD = 1e-6
"""A dyad is named in a note only if its angle is smaller by more than this.

Its least transmission angle is compared with the angles of the outputs. Larger: the note is
left out more often.
"""

TRANSMISSION_DIGITS = 3
"""Significant digits of transmission angles."""

MEASURE_DIGITS = 2
"""Significant digits of transmission measures."""

RATIO_DIGITS = 4
"""Decimals of velocity ratios, and significant digits of very small and large ratios."""

RATIO_STEP = 1e-3
"""Smaller velocity ratios are printed with significant digits, as decimals would lose
most of them."""

LARGE_RATIO = 100.0
"""Larger velocity ratios are printed with significant digits only."""


def output_table(summary: Any) -> ScreenTable | None:
    """Return the table of outputs: range, velocity ratio, transmission, places of rest.

    The transmission angle tells how well a force is passed on to the output. At a place of
    rest the output turns back.

    The result is None if no output is examined, or if the mechanism can be assembled at no
    examined sample.

    Parameters
    ----------
    summary
        The content of ``summary.json``, the file with the main results of a run.
    """
    overview = summary["overview"]
    outputs = overview["outputs"]
    place_text = PlaceText(overview)
    if not outputs or not overview["modes"]:
        return None
    inputs = list(summary["inputs"])
    is_simulation = "simulation" in summary
    turns_about_axis = any(output["fixed_axis"] for output in outputs)

    columns = [ScreenColumn("mode")]
    if len(outputs) > 1:
        columns.append(ScreenColumn("output"))
    if turns_about_axis:
        columns.append(ScreenColumn("angle (deg)"))
    turns = all(
        motion["highest_rad"] - motion["lowest_rad"] >= TURN - ANGLE_ERROR_RAD
        for entry in overview["modes"].values()
        for motion in entry["outputs"]
        if motion["lowest_rad"] is not None
    )
    columns.append(ScreenColumn(_swing_heading(outputs, turns), "right"))
    if is_simulation:
        columns.append(ScreenColumn("speed (rad/s)"))
    elif len(inputs) == 1:
        columns.append(ScreenColumn("velocity ratio"))
    else:
        columns += [ScreenColumn(f"velocity ratio by {pair}") for pair in inputs]
    # The pairs at which transmission angles of outputs are taken. A single pair is named in
    # the heading, several pairs in a column.
    pairs = {
        motion["least_transmission"]["pair"]
        for entry in overview["modes"].values()
        for motion in entry["outputs"]
        if motion["least_transmission"]
    }
    has_transmission = bool(pairs)
    has_pair_column = len(pairs) > 1
    at_pair = f" at pair {min(pairs)}" if len(pairs) == 1 else ""
    # If the least value occurs at several places, the overview has the first of them.
    where = f"at {place_text.heading}"
    if place_text.kind != "time":
        where = f"at {numbered('input', inputs)} (deg)"
    if has_transmission:
        columns.append(ScreenColumn(f"least transmission angle{at_pair} (deg)", "right"))
        if has_pair_column:
            columns.append(ScreenColumn("at pair"))
        columns.append(ScreenColumn(where, "right"))
    has_measure = any(
        motion["least_transmission_measure"] is not None
        for entry in overview["modes"].values()
        for motion in entry["outputs"]
    )
    if has_measure:
        columns += [
            ScreenColumn(MEASURE_HEADING, "right"),
            ScreenColumn(where, "right"),
        ]
    has_rests = turns_about_axis and overview["is_path"]
    if has_rests:
        # Along a path of several inputs and over time, an output turns back although its
        # velocity ratios are not zero.
        verb = "comes to rest (type I singularity)"
        if len(inputs) > 1 or is_simulation:
            verb = "turns back"
        # Values of one input are accurate to the printed digits. Other places are rougher.
        is_accurate = place_text.kind == "input" and len(inputs) == 1
        preposition = "at" if is_accurate else "near"
        columns.append(ScreenColumn(f"{verb} {preposition} {place_text.heading}"))

    # Times (s) at which all links stop in a simulation, which the events have exactly.
    events = summary["simulation"]["event_list"] if is_simulation else []
    stop_times = [event["t"] for event in events if event["kind"] == "rest"]
    names = {str(mode["number"]): mode_name(mode) for mode in summary["assembly_modes"]}
    # Rows with the same cells share a row, with all their modes.
    modes_by_cells: dict[tuple[str, ...], list[str]] = {}
    for number, entry in overview["modes"].items():
        for output, motion in zip(outputs, entry["outputs"], strict=True):
            if motion["lowest_rad"] is None:
                continue
            cells = [output["label"]] if len(outputs) > 1 else []
            if turns_about_axis:
                cells.append(_range_text(motion) if output["fixed_axis"] else "-")
            cells.append(_swing_text(motion, ends_at_dead_centre(overview, entry)))
            cells += _ratio_cells(motion)
            if has_transmission:
                cells += _transmission_cells(
                    motion["least_transmission"], has_pair_column, place_text
                )
            if has_measure:
                cells += _measure_cells(motion, place_text)
            if has_rests:
                cells.append(_rest_cell(output, motion, place_text, stop_times))
            modes_by_cells.setdefault(tuple(cells), []).append(number)
    if not modes_by_cells:
        return None
    rows = []
    for row_cells, numbers in modes_by_cells.items():
        title = names[numbers[0]]
        if len(numbers) > 1:
            title = number_list([int(number) for number in numbers])
        rows.append((title, *row_cells))
    title = "Motion of the outputs, each written as link/reference link:"
    if len(outputs) == 1:
        title = f"Motion of the output {output_words(outputs[0])}:"
    return ScreenTable(tuple(columns), tuple(rows[:MAX_TABLE_ROWS]), title)


def output_words(output: Any) -> str:
    """Return an output in words, such as ``rocker (link 4 relative to link 1)``.

    Parameters
    ----------
    output
        The description of the output in the summary of a run: its link, its reference link,
        its name, and whether it is a direction on the link.
    """
    what = "a direction on link" if output["points"] else "link"
    link = link_text(output["link"])
    motion = f"{what} {link} relative to link {link_text(output['relative_to'])}"
    return f"{output['name']} ({motion})" if output["name"] else motion


def link_text(name: str) -> str:
    """Return the name of a link for a sentence, in quotes if it can be read as a word."""
    letter_count = sum(character.isalpha() for character in name)
    return f'"{name}"' if letter_count > 1 else name


def ends_at_dead_centre(overview: Any, entry: Any) -> bool:
    """Return whether an assembly mode ends at a dead centre within the range of the run.

    A dead centre is a singularity of type II, beyond which the mode cannot be assembled. It
    is usually between two samples. Ranges of angles end at the last sample before the dead
    centre, so the true ranges may be larger. Printed widths of ranges then begin with
    ``>=``.

    Parameters
    ----------
    overview
        The overview of the motion in the summary of the run.
    entry
        The facts of the mode in the overview.
    """
    exists_somewhere = bool(entry["closes"])  # spans where the mode can be assembled
    is_missing_somewhere = "OUT_OF_REACH" in entry["statuses"]
    # Only samples along a path are successive configurations, between which a mode ends.
    return overview["is_path"] and exists_somewhere and is_missing_somewhere


def _range_text(motion: Any) -> str:
    """Return the range of an angle as text in degrees, or its only value."""
    lowest = angle_text(motion["lowest_rad"])
    highest = angle_text(motion["highest_rad"])
    return f"{lowest} throughout" if lowest == highest else f"{lowest} to {highest}"


def _swing_heading(outputs: Sequence[Any], turns: bool) -> str:
    """Return the heading of the table column that says how far each output moves.

    The angle of an output with a fixed axis is its swing (range of rotation). For other
    outputs it is the largest angle from the first sample.

    Parameters
    ----------
    outputs
        The facts of all outputs, from the overview of the motion.
    turns
        Whether every output rotates by at least one revolution in every assembly mode. The
        heading is then ``turns by``.
    """
    if turns:
        return "turns by (deg)"
    if not any(output["fixed_axis"] for output in outputs):
        return f"{FARTHEST_HEADING} (deg)"
    if all(output["fixed_axis"] for output in outputs):
        return "swing (deg)"
    return f"swing or {FARTHEST_HEADING} (deg)"


def _swing_text(motion: Any, is_lower_bound: bool) -> str:
    """Return the width of the range of an angle as text in degrees.

    The text begins with ``>=`` if the true range may be larger, since the mode ends at a
    dead centre between samples.

    The printed ends of the range are rounded too, so their difference can differ from the
    printed width by one in the last digit.
    """
    swing_deg = math.degrees(motion["highest_rad"] - motion["lowest_rad"])
    text = degrees_text(math.radians(round(swing_deg, 2)))
    return f">= {text}" if is_lower_bound else text


def _ratio_text(ratio: float) -> str:
    """Return a velocity ratio with as many decimals as its neighbours in the column."""
    if abs(ratio - round(ratio)) <= RATIO_ERROR:
        return str(round(ratio))
    if RATIO_STEP < abs(ratio) < LARGE_RATIO:
        return f"{ratio:.{RATIO_DIGITS}f}"
    return number_text(ratio, RATIO_ERROR, RATIO_DIGITS)


def ratio_last_digit(ratio: float) -> float:
    """Return the value of the last printed digit of a velocity ratio, see `_ratio_text`."""
    if abs(ratio) <= RATIO_ERROR:
        return math.inf  # printed as 0, for which no digit can be wrong
    if RATIO_STEP < abs(ratio) < LARGE_RATIO:
        return 10.0**-RATIO_DIGITS
    return last_significant_digit(ratio, RATIO_DIGITS)


def _ratio_cells(motion: Any) -> Lines:
    """Return the range of each velocity ratio, or of the speed, as text."""
    cells = []
    for low, high in zip(motion["lowest_ratio"], motion["highest_ratio"], strict=True):
        if low is None:
            cells.append("-")
            continue
        low_text, high_text = _ratio_text(low), _ratio_text(high)
        if low_text == high_text:  # a constant needs no decimals that fit its neighbours
            low_text = high_text = number_text(low, RATIO_ERROR, RATIO_DIGITS)
        cells.append(low_text if low_text == high_text else f"{low_text} to {high_text}")
    return cells


def _transmission_cells(
    transmission: Any, has_pair_column: bool, place_text: PlaceText
) -> Lines:
    """Return the table cells for the least transmission angle of an output.

    The transmission angle of a dyad (two links joined by a pair) is 0 at a dead centre. The
    cells are the angle (deg), the pair (joint) at which it is measured, and the place of
    the sample with this angle. The place is a time if `place_text.kind` is "time",
    otherwise the inputs. The table has the cell of the pair only with `has_pair_column`.
    All cells are "-" for an output without a transmission angle.
    """
    if transmission is None:
        return ["-"] * (3 if has_pair_column else 2)
    cells = [transmission_text(transmission["angle_rad"])]
    if has_pair_column:
        cells.append(transmission["pair"])
    cells.append(_place_cell(transmission["place"], transmission, place_text))
    return cells


def transmission_text(angle_rad: float) -> str:
    """Return a transmission angle (rad) as text in degrees, without the unit."""
    return number_text(math.degrees(angle_rad), TRANSMISSION_ERROR_DEG, TRANSMISSION_DIGITS)


def _measure_cells(motion: Any, place_text: PlaceText) -> Lines:
    """Return the least transmission measure and its place as text."""
    if motion["least_transmission_measure"] is None:
        return ["-", "-"]
    measure, place = motion["least_transmission_measure"]
    text = number_text(measure, MEASURE_ERROR, MEASURE_DIGITS)
    largest = motion["largest_transmission_measure"]
    if largest is not None and largest - measure <= MEASURE_ERROR:
        return [f"{text} throughout", "-"]
    inputs = {"inputs_rad": motion["inputs_of_least_measure_rad"]}
    return [text, _place_cell(place, inputs, place_text)]


def _place_cell(place: float, entry: Any, place_text: PlaceText) -> str:
    """Return a place as text: the time, or all inputs of the sample."""
    if place_text.kind != "time":
        return ", ".join(angle_text(angle) for angle in entry["inputs_rad"])
    return place_text.value(place)


def _rest_cell(
    output: Any, motion: Any, place_text: PlaceText, stop_times: Sequence[float]
) -> str:
    """Return the table cell that lists the places at which an output comes to rest.

    A place is the value of the input, or the time. The cell has only the first places, and
    says how many follow.

    Parameters
    ----------
    output
        The facts of the output, the same in all assembly modes.
    motion
        The motion of this output in one assembly mode.
    place_text
        Converts places to text.
    stop_times
        Times (s) at which all links stop in a simulation. These times are exact. A rest
        within one sample of such a time is printed with this time.
    """
    # Rests are found as changes of sign of the rate. Without a fixed axis there is no sign.
    if not output["fixed_axis"]:
        return "-"
    if rests_throughout(motion):
        return "everywhere"
    text_by_place = {}
    for place in motion["rests"]:
        text_by_place[place] = place_text.value(place, between_samples=True)
        for stop_time in stop_times:
            if abs(stop_time - place) <= place_text.sample_step:
                text_by_place[place] = place_text.value(stop_time)
    # A rest is uncertain if the samples before and after it are too far apart to
    # interpolate. The text then names the places of these two samples.
    for first, last in motion["uncertain_rests"]:
        text_by_place[first] = place_text.between(first, last)
    places = [text_by_place[place] for place in sorted(text_by_place)]
    # Count the places that the summary leaves out and the places that this cell leaves out.
    further = motion["further_rests"] + max(len(places) - MAX_LISTED_PLACES, 0)
    text = ", ".join(places[:MAX_LISTED_PLACES]) or "none"
    return f"{text} and {further} more" if further else text


def rests_throughout(motion: Any) -> bool:
    """Return whether an output never moves: one pose at all samples, velocity ratios of 0.

    Parameters
    ----------
    motion
        The least and largest angle (rad) and velocity ratios of the output in an assembly
        mode, from the summary of a run.
    """
    ratios = [*motion["lowest_ratio"], *motion["highest_ratio"]]
    swing_rad = motion["highest_rad"] - motion["lowest_rad"]
    has_velocity = any(ratio is not None and abs(ratio) > RATIO_ERROR for ratio in ratios)
    return swing_rad <= ANGLE_ERROR_RAD and not has_velocity


def table_notes(summary: Any, table: ScreenTable | None) -> Lines:
    """Return notes that explain the table of outputs, and say what the table leaves out.

    Parameters
    ----------
    summary
        The content of ``summary.json``, the file with the main results of a run.
    table
        The table of outputs from `output_table`. None: there are no notes.
    """
    if table is None:
        return []
    overview = summary["overview"]
    notes = []
    if any(not output["fixed_axis"] for output in overview["outputs"]):
        # The key "points" says whether the output is a direction (such as the line of sight
        # of a camera), and not the pose of a link.
        has_direction = any(output["points"] for output in overview["outputs"])
        what = "direction" if has_direction else "pose"
        resting = "the output rests (singularity of type I)"
        if len(summary["inputs"]) > 1:
            resting = "this input alone does not move the output"
        rate = f"velocity ratio is a magnitude, 0 where {resting}"
        if "simulation" in summary:
            rate = "speed is a magnitude"
        notes.append(
            f"Outputs without a fixed axis: {FARTHEST_HEADING} is the largest angle from "
            f"the {what} at the first sample of the mode. The {rate}."
        )
    if any(column.heading == MEASURE_HEADING for column in table.columns):
        notes.append(
            "The transmission measure m says how firmly the locked inputs hold the output: "
            "play in the pairs moves the output about 1/m times as far as it would with "
            "m = 1, the best value. m is 0 where the inputs cannot drive the output "
            "(singularity of type II)."
        )
    # A dyad is two links joined by a pair. The table has the transmission angles of dyads
    # that determine outputs. Another dyad may come nearer to a dead centre (angle 0).
    notes += _describe_other_dyad(summary)
    row_count = sum(len(entry["outputs"]) for entry in overview["modes"].values())
    if len(table.rows) == MAX_TABLE_ROWS and row_count > MAX_TABLE_ROWS:
        notes.append(f"Further rows are in summary.json: {row_count} modes and outputs.")
    # The step between samples as a text, which is empty if the step is small.
    if step_text := PlaceText(overview).coarse_step_text:
        notes.append(
            f"Samples are {step_text} apart, so extremes and places of rest between "
            "them can be missed."
        )
    sample_count = summary["samples"]
    if overview["examined_samples"] < sample_count:
        notes.append(
            f"The table uses {overview['examined_samples']} of the {sample_count} samples."
        )
    return notes


def _describe_other_dyad(summary: Any) -> Lines:
    """Return a note if another dyad is nearer to a dead centre than the dyads in the table.

    A dyad is two links joined by a pair. Its transmission angle is 0 at a dead centre. The
    table has one transmission angle for each output: the angle of the dyad that determines
    the motion of the output. Another dyad of the mechanism may have a smaller angle.

    Parameters
    ----------
    summary
        The content of ``summary.json``, the file with the main results of a run.

    Returns
    -------
    A list with the note, or an empty list.
    """
    overview = summary["overview"]
    least_by_mode = {
        int(number): entry["least_transmission"]
        for number, entry in overview["modes"].items()
        if entry["least_transmission"]
    }
    if not least_by_mode:
        return []
    least = min(least_by_mode.values(), key=lambda entry: entry["angle_rad"])
    angles_of_outputs = [
        motion["least_transmission"]["angle_rad"]
        for entry in overview["modes"].values()
        for motion in entry["outputs"]
        if motion["least_transmission"]
    ]
    least_of_outputs = min(angles_of_outputs, default=math.inf)
    if least_of_outputs <= least["angle_rad"] + TRANSMISSION_DIFFERENCE_RAD:
        return []
    place_text = PlaceText(overview)
    place = place_text.at(least["place"])
    # The number of a sample says little, so the inputs of the sample are printed.
    if place_text.kind == "sample":
        place = inputs_text(summary, least["inputs_rad"])
    # Several assembly modes can have the same least angle, at the same pair and place,
    # because they differ only in how other dyads are assembled. All of them are listed.
    modes = [
        number
        for number, entry in least_by_mode.items()
        if abs(entry["angle_rad"] - least["angle_rad"]) <= TRANSMISSION_DIFFERENCE_RAD
        and (entry["pair"], entry["place"]) == (least["pair"], least["place"])
    ]
    return [
        "With all dyads of the mechanism, the least transmission angle is "
        f"{transmission_text(least['angle_rad'])} deg, at pair {least['pair']} in "
        f"{modes_text(modes)} at {place}. At a dead centre (type II singularity), a "
        "transmission angle is 0."
    ]


def inputs_text(summary: Any, inputs_rad: Sequence[float]) -> str:
    """Return inputs as text, such as ``inputs 21 = 30, 51 = 40 deg``."""
    texts = [
        f"{pair} = {angle_text(angle)}"
        for pair, angle in zip(summary["inputs"], inputs_rad, strict=True)
    ]
    noun = "input" if len(texts) == 1 else "inputs"
    return f"{noun} {', '.join(texts)} deg"
