"""The motion of a run on the screen: where modes close, and how far outputs move."""

import math
from collections.abc import Sequence
from typing import Any

from spherekit.conventions import TURN, Lines
from spherekit.number_text import degrees_text, number_text
from spherekit.tables.screen_table import ScreenColumn, ScreenTable
from spherekit.wording import counted, listing

MAX_TABLE_ROWS = 40
"""Rows of a table on the screen; summary.json has all of them."""

MAX_LISTED_PLACES = 4
"""Places, such as inputs at which an output rests, that are listed in a cell or line."""

COARSE_STEP_DEG = 5.0
"""Distance of samples from which a note says that the table may miss places of rest."""

RATIO_ERROR = 5e-10
"""Velocity ratios that are not larger are rounding errors, and printed as 0."""

NEAR_SHARE = 0.02
"""Share of the largest value from which the least singular value of a Jacobian, as well as
a transmission measure, counts as nearly 0. Larger: more is called nearly singular."""

MEASURE_HEADING = "least transmission measure"
"""Heading of the column of transmission measures, which a note explains."""

MEASURE_ERROR = 1e-7
"""Transmission measures that are not larger are rounding errors, and printed as 0."""

RATIO_DIGITS = 4
"""Decimals of velocity ratios, and significant digits of very small and large ones."""

RATIO_STEP = 1e-3
"""Smaller velocity ratios are printed with significant digits, as decimals would lose
most of them."""

LARGE_RATIO = 100.0
"""Larger velocity ratios are printed with significant digits only."""


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
        self.step_words = ""
        if self.kind != "sample" and step:
            unit = "deg" if self.kind == "input" else "s"
            name = f" of {self.name}" if self.kind == "input" else ""
            self.step_words = f"{number_text(step, digits=3)} {unit}{name}"
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
        which = {1: "which exists", 2: "both exist"}
        closing = which.get(len(modes), "all exist")
        place = "over the whole range"
        if len(summary["inputs"]) > 1:
            place = "on the whole path"
        if not overview["is_path"]:
            place = "at all samples"
        return [": ".join(filter(None, [f"{count}, {closing} {place}", titles]))]
    lines = [": ".join(filter(None, [count, titles]))]
    # Modes that close at the same places share a line.
    modes_by_place: dict[str, list[int]] = {}
    for mode, entry in zip(modes, entries, strict=True):
        place = _closing_place(mode, entry, overview, place_text)
        modes_by_place.setdefault(place, []).append(mode["number"])
    for place, numbers in modes_by_place.items():
        word = "Mode" if len(numbers) == 1 else "Modes"
        verb = "exists" if len(numbers) == 1 else "exist"
        lines.append(f"{word} {number_list(numbers)} {verb} {place}.")
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
    turns = all(
        motion["highest_rad"] - motion["lowest_rad"] >= TURN - RATIO_ERROR
        for entry in overview["modes"].values()
        for motion in entry["outputs"]
        if motion["lowest_rad"] is not None
    )
    columns.append(ScreenColumn("turns by (deg)" if turns else "swing (deg)", "right"))
    if is_simulation:
        columns.append(ScreenColumn("speed (rad/s)"))
    elif len(inputs) == 1:
        columns.append(ScreenColumn("velocity ratio"))
    else:
        columns += [ScreenColumn(f"velocity ratio by {pair}") for pair in inputs]
    has_transmission = any(
        entry["least_transmission"] for entry in overview["modes"].values()
    )
    joints = {
        entry["least_transmission"]["pair"]
        for entry in overview["modes"].values()
        if entry["least_transmission"]
    }
    joint = f" at pair {joints.pop()}" if len(joints) == 1 else ""
    where = f"at {place_text.heading}"
    if place_text.kind == "sample":
        where = f"at {', '.join(inputs)} (deg)"
    if has_transmission:
        columns += [
            ScreenColumn(f"least transmission angle{joint} (deg)", "right"),
            ScreenColumn(where, "right"),
        ]
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
            cells.append(_swing_text(motion))
            cells += _ratio_cells(motion)
            if has_transmission:
                cells += _transmission_cells(entry["least_transmission"], place_text)
            if has_measure:
                cells += _measure_cells(motion, place_text)
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
    title = "Motion of the outputs, each written as link/reference link:"
    if len(outputs) == 1:
        title = f"Motion of the output {output_words(outputs[0])}:"
    return ScreenTable(tuple(columns), tuple(rows[:MAX_TABLE_ROWS]), title)


def output_words(output: Any) -> str:
    """Return an output in words, such as ``rocker (link 4 relative to link 1)``.

    Parameters
    ----------
    output
        An entry of ``outputs`` of the overview.
    """
    what = "a direction on link" if output["points"] else "link"
    motion = f"{what} {output['link']} relative to link {output['relative_to']}"
    return f"{output['name']} ({motion})" if output["name"] else motion


def _swing_text(motion: Any) -> str:
    """Return the width (deg) of the range of an angle.

    It can differ by one in the last digit from the difference of the printed ends, which
    are rounded too.
    """
    swing_deg = math.degrees(motion["highest_rad"] - motion["lowest_rad"])
    return degrees_text(math.radians(round(swing_deg, 2)))


def _ratio_text(ratio: float) -> str:
    """Return a velocity ratio with as many decimals as its neighbours in the column."""
    if abs(ratio - round(ratio)) <= RATIO_ERROR:
        return str(round(ratio))
    if RATIO_STEP < abs(ratio) < LARGE_RATIO:
        return f"{ratio:.{RATIO_DIGITS}f}"
    return number_text(ratio, RATIO_ERROR, RATIO_DIGITS)


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


def _transmission_cells(transmission: Any, place_text: PlaceText) -> Lines:
    """Return the least transmission angle (deg) and its place as text."""
    if transmission is None:
        return ["-", "-"]
    angle = number_text(math.degrees(transmission["angle_rad"]), 1e-9, 3)
    return [angle, _place_cell(transmission["place"], transmission, place_text)]


def _measure_cells(motion: Any, place_text: PlaceText) -> Lines:
    """Return the least transmission measure and its place as text."""
    if motion["least_transmission_measure"] is None:
        return ["-", "-"]
    measure, place = motion["least_transmission_measure"]
    text = number_text(measure, MEASURE_ERROR, 2)
    inputs = {"inputs_rad": motion["inputs_of_least_measure_rad"]}
    return [text, _place_cell(place, inputs, place_text)]


def _place_cell(place: float, entry: Any, place_text: PlaceText) -> str:
    """Return a place as text: the first input, the time, or all inputs of a sample."""
    if place_text.kind == "sample":
        return ", ".join(_angle_text(angle) for angle in entry["inputs_rad"])
    return place_text.value(place)


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


def describe_singularities(summary: Any) -> Lines:
    """Return sentences on how near the samples come to singularities of both types.

    They are for motions whose singularities do not stand in the table of outputs: those of
    several inputs, of outputs without a fixed axis, and simulations.
    """
    overview = summary["overview"]
    several = len(summary["inputs"]) > 1
    is_simulation = "simulation" in summary
    if not overview["modes"]:
        return []
    lines = []
    if several and not is_simulation:
        lines += _describe_type_2(summary)
    for number, output in enumerate(overview["outputs"]):
        is_in_table = output["fixed_axis"] and not several and not is_simulation
        if not is_in_table:
            lines += _describe_type_1(summary, number)
    names = {analysis["name"] for analysis in summary["analyses"]}
    if lines and several and not is_simulation and "singularities" not in names:
        lines[-1] += (
            " These places are from the samples; -a singularities gives exact ones."
        )
    return lines


def _inputs_text(summary: Any, inputs_rad: Sequence[float]) -> str:
    """Return inputs as text, such as ``21 = 30, 51 = 40 deg``."""
    texts = [
        f"{pair} = {_angle_text(angle)}"
        for pair, angle in zip(summary["inputs"], inputs_rad, strict=True)
    ]
    return f"{', '.join(texts)} deg"


def _extent(summary: Any) -> str:
    """Return what the samples cover, such as ``on this path``."""
    if "simulation" in summary:
        return "in this motion"
    if not summary["overview"]["is_path"]:
        return "at these samples"
    return "on this path" if len(summary["inputs"]) > 1 else "in this range"


def _describe_type_2(summary: Any) -> Lines:
    """Return sentences on singularities of type II of a mechanism with several inputs."""
    overview = summary["overview"]
    meaning = "type II (locked inputs do not hold the output)"
    extent = _extent(summary)
    ended, met = [], []
    # The value, its mode, its name and text, the inputs, and the best value there could be.
    nearest: tuple[float, str, str, Any, float] | None = None
    for number, entry in overview["modes"].items():
        if entry["closes"] and "OUT_OF_REACH" in entry["statuses"]:
            ended.append(int(number))
        if "AT_SINGULARITY" in entry["statuses"]:
            met.append(int(number))
        candidates = [
            (
                measure[0],
                f"measure is {number_text(measure[0], MEASURE_ERROR, 2)}",
                inputs,
                1.0,
            )
            for motion in entry["outputs"]
            if (measure := motion["least_transmission_measure"])
            and (inputs := motion["inputs_of_least_measure_rad"])
        ]
        transmission = entry["least_transmission"]
        if not candidates and transmission:
            angle = math.degrees(transmission["angle_rad"])
            text = f"{number_text(angle, 1e-9, 3)} deg"
            candidates = [(angle, f"angle is {text}", transmission["inputs_rad"], 90.0)]
        for value, text, inputs, best in candidates:
            if nearest is None or value < nearest[0]:
                nearest = (value, number, text, inputs, best)
    lines = []
    if met:
        lines.append(f"Samples of {_modes_text(met)} are at singularities of {meaning}.")
    if ended:
        lines.append(
            f"{_modes_text(ended, True)} {'ends' if len(ended) == 1 else 'end'} {extent}, "
            f"at singularities of {meaning}."
        )
    place = ""
    if nearest is not None:
        _, number, text, inputs, _ = nearest
        place = (
            f"nearest to one is mode {number} at {_inputs_text(summary, inputs)}, where "
            f"the transmission {text}"
        )
    if not met and not ended:
        end = f"; {place}" if place else ""
        beginning = f"No singularity of {meaning} is met"
        if nearest is not None and nearest[0] <= NEAR_SHARE * nearest[4]:
            beginning = f"A singularity of {meaning} is nearly met"
        lines.append(f"{beginning} {extent}{end}.")
    return lines


def _describe_type_1(summary: Any, number: int) -> Lines:
    """Return sentences on singularities of type I of an output, by its number."""
    overview = summary["overview"]
    outputs = overview["outputs"]
    output = f"output {outputs[number]['label']}" if len(outputs) > 1 else "output"
    several = len(summary["inputs"]) > 1
    loses = "loses a direction of motion" if several else "rests while the input moves"
    if outputs[number]["fixed_axis"]:
        loses = "rests while the inputs move" if several else loses
    meaning = f"type I (the {output} {loses})"
    extent = _extent(summary)
    always: list[int] = []
    places: dict[str, list[int]] = {}
    nearest: tuple[float, str, Any] | None = None
    largest = 0.0  # of the least singular values of the nearest mode
    further = 0
    for mode, entry in overview["modes"].items():
        motion = entry["outputs"][number]
        jacobian = motion["jacobian"]
        if jacobian is None:
            continue
        if jacobian["largest_least_singular_value"] <= RATIO_ERROR:
            always.append(int(mode))
            continue
        texts = [_inputs_text(summary, inputs) for inputs in jacobian["type_1_inputs_rad"]]
        if jacobian["least_singular_value"] <= RATIO_ERROR:
            texts.append(_inputs_text(summary, jacobian["inputs_rad"]))
        further += jacobian["further_type_1_places"]
        further += max(len(texts) - MAX_LISTED_PLACES, 0)
        for text in dict.fromkeys(texts[:MAX_LISTED_PLACES]):
            places.setdefault(text, []).append(int(mode))
        value = jacobian["least_singular_value"]
        if nearest is None or value < nearest[0]:
            nearest = (value, mode, jacobian["inputs_rad"])
            largest = jacobian["largest_least_singular_value"]
    lines = []
    if always:
        lines.append(
            f"{_modes_text(always, True)} {'is' if len(always) == 1 else 'are'} singular "
            f"of {meaning} {extent} everywhere."
        )
    if places:
        texts = [f"{_modes_text(modes)} near {text}" for text, modes in places.items()]
        more = f", and at {counted(further, 'further place')}" if further else ""
        lines.append(
            f"Singularities of {meaning} are met {extent}: {'; '.join(texts)}{more}."
        )
    elif nearest is not None:
        value, mode, inputs = nearest
        quantity = "smallest singular value of the velocity Jacobian"
        if not several:
            quantity = "velocity ratio"
        others = (
            "other modes have none" if always else f"no singularity of {meaning} is met"
        )
        if value <= NEAR_SHARE * largest and not always:
            others = f"a singularity of {meaning} is nearly met"
        if "simulation" in summary:
            lines.append(f"{others[0].upper()}{others[1:]} {extent}.")
        else:
            lines.append(
                f"{others[0].upper()}{others[1:]} {extent}; nearest to one is mode "
                f"{mode} at "
                f"{_inputs_text(summary, inputs)}, where the {quantity} is "
                f"{number_text(value, RATIO_ERROR, 2)}."
            )
    return lines


def _modes_text(numbers: Sequence[int], begins_sentence: bool = False) -> str:
    """Return ``mode 3`` or ``modes 0-5, 7``."""
    word = "mode" if len(numbers) == 1 else "modes"
    return f"{word.capitalize() if begins_sentence else word} {number_list(numbers)}"


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
            f"{what}, and the velocity ratio is a magnitude, 0 where the output rests "
            "(singularity of type I)."
        )
    if any(column.heading == MEASURE_HEADING for column in table.columns):
        notes.append(
            "The transmission measure is 1 at best and 0 where the input cannot drive the "
            "output (singularity of type II)."
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
