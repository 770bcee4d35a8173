"""The motion of a run on the screen: where modes close, and how far outputs move."""

import math
from collections.abc import Sequence
from typing import Any

from spherekit.conventions import Lines
from spherekit.number_text import degrees_text, number_text
from spherekit.tables.screen_table import ScreenColumn, ScreenTable
from spherekit.wording import counted, listing

MAX_TABLE_ROWS = 40
"""Rows of a table on the screen; summary.json has all of them."""

MAX_LISTED_PLACES = 6
"""Places, such as inputs at which an output rests, that are listed in a cell or line."""

COARSE_STEP_DEG = 5.0
"""Distance of samples from which a note says that the table may miss places of rest."""

RATIO_ERROR = 5e-10
"""Velocity ratios that are not larger are rounding errors, and printed as 0."""

MEASURE_ERROR = 1e-7
"""Transmission measures that are not larger are rounding errors, and printed as 0."""

RATIO_DIGITS = 4
"""Significant digits of velocity ratios."""


class PlaceText:
    """Texts of places: values of the first input (deg), times (s) or numbers of samples.

    Parameters
    ----------
    overview
        The entry ``overview`` of the summary of a run.
    """

    def __init__(self, overview: Any) -> None:
        place = overview["place"]
        self.kind: str = place["kind"]
        self.unit = {"rad": "deg"}.get(place["unit"], place["unit"])
        self.name: str = place["name"]
        if self.kind == "input":
            self.heading = f"{self.name} (deg)"
        elif self.kind == "time":
            self.heading = "t (s)"
        else:
            self.heading = "sample"
        # Distance of the examined samples: finer digits of places between them would not
        # be known.
        low, high = overview["place_range"] or (0.0, 0.0)
        intervals = max(overview["examined_samples"] - 1, 1)
        step = abs(high - low) / intervals
        self.sample_step = step
        if self.kind == "input":
            step = math.degrees(step)
        # A place between samples is known to about the square of the step.
        self.step_text = ""
        if self.kind == "input" and step >= COARSE_STEP_DEG:
            self.step_text = f"{number_text(step, digits=3)} deg"
        self.between_decimals = 2 if step < 1.5 else (1 if step < 5.0 else 0)

    def value(self, place: float, between_samples: bool = False) -> str:
        """Return a place as text, without its name and unit."""
        if self.kind == "input":
            if between_samples:
                text = f"{math.degrees(place):.{self.between_decimals}f}"
                return "0" if float(text) == 0.0 else text
            return _angle_text(place)
        if self.kind == "time":
            return number_text(place, digits=3 if between_samples else 4)
        return f"{place:.0f}"

    def between(self, first: float, last: float) -> str:
        """Return that a place lies between two samples."""
        return f"between {self.value(first)} and {self.value(last)}"

    def at(self, place: float) -> str:
        """Return a place with its name and unit, such as ``21 = 30 deg``."""
        if self.kind == "sample":
            return f"sample {place:.0f}"
        return f"{self.name} = {self.value(place)} {self.unit}"

    def spans(self, spans: Sequence[Sequence[float]]) -> str:
        """Return spans as text, such as ``0 to 137, 220 to 360``."""
        texts = [
            self.value(first)
            if first == last
            else f"{self.value(min(first, last))} to {self.value(max(first, last))}"
            for first, last in spans
        ]
        return listing(texts, MAX_LISTED_PLACES)

    def named_spans(self, spans: Sequence[Sequence[float]]) -> str:
        """Return spans with name and unit, such as ``at 21 from 0 to 137 deg``."""
        text = self.spans(spans)
        if self.kind == "sample":
            return f"at the samples {text}"
        return f"at {self.name} = {text} {self.unit}"


def _angle_text(angle_rad: float) -> str:
    """Return an angle in degrees with two decimals, enough between samples."""
    return degrees_text(math.radians(round(math.degrees(angle_rad), 2)))


def mode_name(mode: Any) -> str:
    """Return the number of a mode with its name in the file, or with its signs.

    Groups that are no dyads have no sign, which a mode without any leaves out.

    Parameters
    ----------
    mode
        An entry of ``assembly_modes`` of the summary.
    """
    title = mode.get("name") or mode["mode"].replace("~", "")
    return f"{mode['number']} ({title})" if title else str(mode["number"])


def number_list(numbers: Sequence[int]) -> str:
    """Return numbers of modes as text, successive ones as a range: ``0-5, 7``."""
    parts: Lines = []
    ordered = sorted(numbers)
    start = 0
    while start < len(ordered):
        stop = start
        while stop + 1 < len(ordered) and ordered[stop + 1] == ordered[stop] + 1:
            stop += 1
        if stop - start >= 2:
            parts.append(f"{ordered[start]}-{ordered[stop]}")
        else:
            parts += [str(number) for number in ordered[start : stop + 1]]
        start = stop + 1
    return ", ".join(parts)


def describe_modes(summary: Any) -> Lines:
    """Return lines about the assembly modes: their names, and where they close."""
    modes = summary["assembly_modes"]
    overview = summary["overview"]
    place_text = PlaceText(overview)
    names = [mode_name(mode) for mode in modes]
    entries = [overview["modes"].get(str(mode["number"])) for mode in modes]
    if "simulation" in summary:
        return [f"The simulation starts in assembly mode {names[0]}."]
    count = counted(len(modes), "assembly mode")
    titles = listing(names, 16)
    if all(name.isdigit() for name in names):
        titles = number_list([mode["number"] for mode in modes])
    closes = [entry is not None and entry["closes_everywhere"] for entry in entries]
    if len(modes) == 1 and names[0].isdigit():
        titles = ""
    if all(closes):
        which = {1: "which closes", 2: "both close"}.get(len(modes), "all close")
        return [": ".join(filter(None, [f"{count}, {which} everywhere", titles]))]
    lines = [": ".join(filter(None, [count, titles]))]
    # Modes that close at the same places share a line.
    modes_by_place: dict[str, list[int]] = {}
    for mode, entry in zip(modes, entries, strict=True):
        place = _closing_place(mode, entry, overview, place_text)
        modes_by_place.setdefault(place, []).append(mode["number"])
    for place, numbers in modes_by_place.items():
        word = "mode" if len(numbers) == 1 else "modes"
        verb = "closes" if len(numbers) == 1 else "close"
        lines.append(f"{word} {number_list(numbers)} {verb} {place}")
    return lines


def _closing_place(mode: Any, entry: Any, overview: Any, place_text: PlaceText) -> str:
    """Return where a mode closes, such as ``at 21 = 0 to 137 deg``."""
    if entry is None or not entry["closes"]:
        return "nowhere"
    if entry["closes_everywhere"]:
        return "everywhere"
    if overview["is_path"] and place_text.kind != "sample":
        return place_text.named_spans(entry["closes"])
    counts = mode["status"]
    share = counts.get("OK", 0) / max(sum(counts.values()), 1)
    return f"at {share:.0%} of the samples"


def output_table(summary: Any) -> ScreenTable | None:
    """Return the table of outputs: range, velocity ratio, transmission, places of rest.

    None if no output moves.

    Parameters
    ----------
    summary
        The content of ``summary.json``.
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
    columns.append(ScreenColumn("swing (deg)", "right"))
    if is_simulation:
        columns.append(ScreenColumn("speed (rad/s)"))
    elif len(inputs) == 1:
        columns.append(ScreenColumn("velocity ratio"))
    else:
        columns += [ScreenColumn(f"velocity ratio by {pair}") for pair in inputs]
    has_transmission = any(
        entry["least_transmission"] for entry in overview["modes"].values()
    )
    if has_transmission:
        unit = "" if place_text.kind == "input" else " (deg)"
        where = place_text.heading
        if place_text.kind == "sample":
            unit = ""
            where = f"{', '.join(inputs)} (deg)"
        heading = f"least transmission angle{unit} at {where}"
        columns.append(ScreenColumn(heading))
    has_measure = any(
        motion["least_transmission_measure"] is not None
        for entry in overview["modes"].values()
        for motion in entry["outputs"]
    )
    if has_measure:
        heading = "least transmission measure"
        if place_text.kind != "sample":
            heading += f" at {place_text.heading}"
        columns.append(ScreenColumn(heading))
    has_rests = turns_about_axis and overview["is_path"]
    if has_rests:
        verb = "comes to rest (type I)" if len(inputs) == 1 else "turns back"
        columns.append(ScreenColumn(f"{verb} near {place_text.heading}"))

    names = {str(mode["number"]): mode_name(mode) for mode in summary["assembly_modes"]}
    # Rows with the same cells share a row, with all their modes.
    modes_by_cells: dict[tuple[str, ...], list[str]] = {}
    for number, entry in overview["modes"].items():
        for output, motion in zip(outputs, entry["outputs"], strict=True):
            if motion["lowest_rad"] is None:
                continue
            cells = [output["label"]] if len(outputs) > 1 else []
            if turns_about_axis:
                cells.append(
                    f"{_angle_text(motion['lowest_rad'])} to "
                    f"{_angle_text(motion['highest_rad'])}"
                    if output["fixed_axis"]
                    else "-"
                )
            cells.append(_angle_text(motion["highest_rad"] - motion["lowest_rad"]))
            cells += _ratio_cells(motion)
            if has_transmission:
                cells.append(_transmission_cell(entry["least_transmission"], place_text))
            if has_measure:
                cells.append(_measure_cell(motion, place_text))
            if has_rests:
                cells.append(_rest_cell(output, motion, place_text))
            modes_by_cells.setdefault(tuple(cells), []).append(number)
    if not modes_by_cells:
        return None
    rows = []
    for row_cells, numbers in modes_by_cells.items():
        title = names[numbers[0]]
        if len(numbers) > 1:
            title = number_list([int(number) for number in numbers])
        rows.append((title, *row_cells))
    title = "Motion of the outputs:"
    if len(outputs) == 1:
        title = f"Motion of the output {outputs[0]['label']}:"
    return ScreenTable(tuple(columns), tuple(rows[:MAX_TABLE_ROWS]), title)


def _ratio_cells(motion: Any) -> Lines:
    """Return the range of each velocity ratio, or of the speed, as text."""
    cells = []
    for low, high in zip(motion["lowest_ratio"], motion["highest_ratio"], strict=True):
        if low is None:
            cells.append("-")
            continue
        low_text = number_text(low, RATIO_ERROR, RATIO_DIGITS)
        high_text = number_text(high, RATIO_ERROR, RATIO_DIGITS)
        cells.append(low_text if low_text == high_text else f"{low_text} to {high_text}")
    return cells


def _transmission_cell(transmission: Any, place_text: PlaceText) -> str:
    if transmission is None:
        return "-"
    angle = number_text(math.degrees(transmission["angle_rad"]), 1e-9, 3)
    where = place_text.value(transmission["place"])
    if "inputs_rad" in transmission:
        where = ", ".join(map(degrees_text, transmission["inputs_rad"]))
    return f"{angle} at {where}"


def _measure_cell(motion: Any, place_text: PlaceText) -> str:
    if motion["least_transmission_measure"] is None:
        return "-"
    measure, place = motion["least_transmission_measure"]
    text = number_text(measure, MEASURE_ERROR, 2)
    if place_text.kind == "sample":
        return text
    return f"{text} at {place_text.value(place)}"


def _rest_cell(output: Any, motion: Any, place_text: PlaceText) -> str:
    if not output["fixed_axis"]:
        return "-"
    if motion["highest_rad"] - motion["lowest_rad"] < RATIO_ERROR:
        return "everywhere"
    text_by_place = {
        place: place_text.value(place, between_samples=True) for place in motion["rests"]
    }
    for first, last in motion["uncertain_rests"]:
        text_by_place[first] = place_text.between(first, last)
    places = [text_by_place[place] for place in sorted(text_by_place)]
    further = motion["further_rests"] + max(len(places) - MAX_LISTED_PLACES, 0)
    text = ", ".join(places[:MAX_LISTED_PLACES]) or "none"
    return f"{text} and {further} more" if further else text


def table_notes(summary: Any, table: ScreenTable | None) -> Lines:
    """Return what a reader of the table of outputs has to know about its columns."""
    if table is None:
        return []
    overview = summary["overview"]
    notes = []
    if any(not output["fixed_axis"] for output in overview["outputs"]):
        points = any(output["points"] for output in overview["outputs"])
        what = "direction" if points else "pose"
        notes.append(
            "Outputs without a fixed axis: the swing is the largest angle from the first "
            f"{what}, and the velocity ratio is a size, 0 where the output rests (type I)."
        )
    if any("least transmission measure" in column.heading for column in table.columns):
        notes.append(
            "The transmission measure is 0 at a singularity of type II and 1 at best."
        )
    row_count = sum(len(entry["outputs"]) for entry in overview["modes"].values())
    if len(table.rows) == MAX_TABLE_ROWS and row_count > MAX_TABLE_ROWS:
        notes.append(f"Further rows are in summary.json: {row_count} modes and outputs.")
    if step_text := PlaceText(overview).step_text:
        notes.append(
            f"Samples are {step_text} apart, so that extremes and places of rest between "
            "them can be missed."
        )
    sample_count = summary["samples"]
    if overview["examined_samples"] < sample_count:
        notes.append(
            f"The table is from {overview['examined_samples']} of {sample_count} samples."
        )
    return notes
