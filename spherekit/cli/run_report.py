"""The report of a run for the screen: results first, then warnings, files and cost."""

import math
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from spherekit.cli.mode_text import describe_modes, number_list
from spherekit.cli.motion_screen import (
    MEASURE_DIGITS,
    TRANSMISSION_DIGITS,
    link_text,
    output_table,
    ratio_last_digit,
    table_notes,
)
from spherekit.cli.place_text import PlaceText, angle_text
from spherekit.cli.screen_report import ScreenReport
from spherekit.cli.singularity_text import describe_singularities
from spherekit.conventions import Lines
from spherekit.files.library import find, is_study
from spherekit.number_text import (
    bound_text,
    degree_range_text,
    degrees_text,
    last_significant_digit,
    number_text,
)
from spherekit.tables.screen_table import ScreenTable
from spherekit.wording import counted, listing, numbered, size_text

MAX_LISTED_MEETINGS = 6
"""Largest number of printed inputs at which modes meet; summary.json has all of them."""

MAX_LISTED_EVENTS = 4
"""Largest number of printed events of a simulation; the table of events has all."""

LEAST_SWING_RAD = math.radians(1e-5)
"""Swings (rad) of the input up to this size are not listed as events, only counted.

The table of outputs leaves out reversals at similarly small speeds. Larger: more stops of a
damped motion are only counted; smaller: stops appear that no other result shows.
"""

MAX_LISTED_LOADS = 6
"""Largest number of printed loads of a simulation; the mechanism file has all."""

MAX_LISTED_LIMITS = 4
"""Largest number of printed joint limits; the mechanism file has all."""

MIN_STAGE_SHARE = 0.005
"""Share of the time of a run below which a stage is not printed."""

RATE_ERROR = 1e-12
"""Rates of inputs (rad/s) that are not larger are rounding errors, and printed as 0."""

DEFAULT_ANALYSES = ["poles"]
"""The analyses of a run that are not named in its question."""

TYPE_2_TEXT = (
    "a singularity of type II (the locked input does not hold the output: a dead centre)"
)
"""A singularity of type II in words: a dead centre has other meanings, too."""

EVENT_TEXTS = {
    "dead_centre": "dead centre of {pair}",
    "type_2": "singularity of type II",
    "crossing": "crossing of configuration curves",
    "rest": "all links stop and turn back",
    "joint_limit": "joint limit of {pair}",
    "switch": "switch of a load",
    "lift_off": "lift-off of {pair}",
}
"""Words for the kinds of events of a simulation."""

ERROR_TEXTS = (
    ("largest_configuration_error_rad", "{} rad in positions"),
    ("largest_direction_error_bound_rad", "{} rad in pole axes"),
    ("largest_velocity_coefficient_error_bound", "{} in velocity ratios"),
)
"""For each error bound on the screen: its key in ``errors_reached``, and its format."""

TABLE_QUANTITIES = {
    "angle": "angles by about {} deg",
    "ratio": "velocity ratios by about {}",
    "speed": "speeds by about {} rad/s",
    "transmission_angle": "transmission angles by about {} deg",
    "transmission_measure": "transmission measures by about {}",
}
"""Quantities in the table of outputs, and by how much they exceed its extremes."""

MAX_NEXT_STEPS = 3
"""Largest number of commands that are suggested, besides that of a proof."""


@dataclass(frozen=True)
class RunOutput:
    """What a run has written, and the words of its command line.

    The report names the files, and suggests commands that the user could want next.

    Attributes
    ----------
    file
        The file or name of the mechanism or study, as the user wrote it.
    words
        The words of the command line after ``spherekit``.
    mechanism_options
        The options that choose the inputs, lock pairs, and say how an assembly mode
        continues where two curves of configurations cross. Suggested commands repeat them,
        so that they analyse the same mechanism.
    folder
        The folder of the results. None if no tables were written.
    file_names
        Names of the files in the folder.
    is_in_degrees
        Whether angles in the files are in degrees.
    recording
        Path of the recording of the motion. None if none was written.
    figures
        How many figures were drawn, and where. Empty without figures.
    """

    file: str
    words: Sequence[str] = ()
    mechanism_options: Sequence[str] = ()
    folder: str | None = None
    file_names: Sequence[str] = ()
    is_in_degrees: bool = False
    recording: str | None = None
    figures: str = ""


def make_report(summary: Any, output: RunOutput) -> ScreenReport:
    """Return the report of a run for the screen, in the order in which it is printed.

    Parameters
    ----------
    summary
        The content of ``summary.json``, the file with the main results of the run.
    output
        What the run has written, and the words of its command line.
    """
    return ScreenReport(
        question=_question(summary),
        results=_results(summary),
        warnings=_warnings(summary),
        accuracy=_accuracy(summary),
        files=_files(summary, output),
        next_steps=_next_steps(summary, output),
        details=_details(summary),
    )


def _question(summary: Any) -> str:
    """Return one line that repeats what the user asked for, as the heading of the report.

    An example is ``four_bar: input a from 0 to 360 deg, 361 samples``. The names of the
    analyses follow if these are not the default analyses.

    Parameters
    ----------
    summary
        The content of ``summary.json``, the file with the main results of the run. Its
        ``sampling`` is the number of samples as text: ``361``, or ``41x21`` on a grid of
        two inputs.
    """
    analyses = [analysis["name"] for analysis in summary["analyses"]]
    analyses_text = ""
    if analyses != DEFAULT_ANALYSES:
        noun = "analysis" if len(analyses) == 1 else "analyses"
        analyses_text = f"; {noun}: {', '.join(analyses) or 'none'}"
    mechanism = summary["mechanism"]
    samples = counted(summary["sampling"], "sample")
    if "simulation" in summary:
        simulation = summary["simulation"]
        start = ", ".join(
            f"input {_input_words(summary, pair)} at {degrees_text(state['q_rad'])} deg "
            # A rate of at most `RATE_ERROR` is a rounding error and is printed as 0.
            f"and {number_text(state['dq_rad_per_s'], RATE_ERROR)} rad/s"
            for pair, state in simulation["start"].items()
        )
        return (
            f"{mechanism}: simulation of {simulation['duration_s']:.6g} s, "
            f"start with {start}, "
            f"{samples}{analyses_text}"
        )
    # Some analyses search configurations themselves, without samples of the inputs. If the
    # run has only such analyses, no assembly mode is listed. The ranges of the inputs were
    # not used and are not printed.
    if not summary["assembly_modes"]:
        names = [_input_words(summary, pair) for pair in summary["inputs"]]
        return f"{mechanism}: {numbered('input', names)}{analyses_text}"
    ranges = []
    for pair, (low, high) in summary["inputs"].items():
        if low == high:
            ranges.append(f"{_input_words(summary, pair)} = {degrees_text(low)} deg")
        else:
            is_downwards = summary["input_ends"][pair] == [high, low]
            first, last = (high, low) if is_downwards else (low, high)
            range_text = degree_range_text(first, last)
            ranges.append(f"{_input_words(summary, pair)} from {range_text} deg")
    word = "input" if len(ranges) == 1 else "inputs"
    how = ""
    if "time" in summary:
        how = f" in {summary['time']['duration_s']:.6g} s"
    elif len(ranges) > 1:
        # On a path all inputs change together. A grid has all combinations of their values.
        how = " on one path" if summary["overview"]["is_path"] else " on a grid"
    return f"{mechanism}: {word} {' and '.join(ranges)}{how}, {samples}{analyses_text}"


def _input_words(summary: Any, pair: str) -> str:
    """Return the name of an input, with its links if the name has no letters.

    A bare name such as ``21`` would not tell that it is a pair. The first line of the
    report explains the name, and the other lines have only the name.
    """
    if any(character.isalpha() for character in pair):
        return pair
    reference, link = summary["input_links"][pair]
    return f"{pair} (link {link_text(link)} relative to link {link_text(reference)})"


def _results(summary: Any) -> list[str | ScreenTable]:
    """Return the results of a run as lines and tables, in the order of the screen.

    The results of requested analyses come first, then the results of the motion. A
    verification and the accuracy come last.

    Parameters
    ----------
    summary
        The content of ``summary.json``, the file with the main results of the run.
    """
    results = _analysis_results(summary) + _describe_assumed_rates(summary)
    # Without an assembly mode (way to assemble the mechanism) no motion was computed.
    if summary["assembly_modes"]:
        results += describe_modes(summary)
        if "simulation" in summary:
            results += _describe_drive(summary)
            results += _describe_simulation(summary["simulation"])
        else:
            results.append(summary["completeness"])
            if len(summary["inputs"]) > 1 and summary["overview"]["is_path"]:
                line = (
                    "All inputs change together, along one path. Other combinations of "
                    "inputs are not computed"
                )
                if "time" not in summary:  # samples of time laws cannot be a grid
                    line += "; --samples NxM, such as 41x21, computes a grid of them"
                results.append(f"{line}.")
            results += _describe_meetings(summary)
            results += _describe_dead_centres(summary)
        results += describe_singularities(summary)
        results += _describe_unexpected_mobility(summary)
        table = output_table(summary)
        if table is not None:
            results.append(table)
            results += table_notes(summary, table)
        results += _describe_unapplied_limits(summary)
    if "verified" in summary:
        from spherekit.runs.verification_text import format_verification

        results += format_verification(summary["verified"])
    if "accuracy" in summary:
        results.append(accuracy_line(summary["accuracy"]))
    return results


def _analysis_results(summary: Any) -> list[str | ScreenTable]:
    """Return the tables and remarks of each analysis; several analyses with their names."""
    results: list[str | ScreenTable] = []
    names = [analysis["name"] for analysis in summary["analyses"]]
    for analysis in summary["analyses"]:
        tables = [ScreenTable.from_json(entry) for entry in analysis["screen_tables"]]
        remarks = analysis["remarks"]
        if len(names) > 1 and (tables or remarks):
            results.append(f"{analysis['name']}:")
        results += tables
        results += remarks
    return results


def _describe_assumed_rates(summary: Any) -> Lines:
    """Return a line with the rates of the inputs, if the user has given no motion.

    Driving torques and reactions depend on the rates. An example is "No time law was given,
    so input 21 moves at 1 rad/s. --law gives another motion."

    Parameters
    ----------
    summary
        The content of ``summary.json``, the file with the main results of the run.
    """
    rates = summary["assumed_rates_rad_per_s"]
    if not rates:
        return []
    first, *others = (f"input {pair}" for pair in rates)
    speeds = [f"{rate:.4g} rad/s" for rate in rates.values()]
    moves = [f"{first} moves at {speeds[0]}"]
    moves += [f"{name} at {speed}" for name, speed in zip(others, speeds[1:], strict=True)]
    return [f"No time law was given, so {' and '.join(moves)}. --law gives another motion."]


def _describe_dead_centres(summary: Any) -> Lines:
    """Return lines on the dead centres at which assembly modes end.

    A dead centre is a singularity of type II, at which the input is stationary and
    reverses. Beyond it an assembly mode (way to assemble the mechanism) does not exist.
    Only mechanisms with one input have such lines. Modes that end at the same places share
    a line. An example is "Modes 0, 1 end at dead centres (type II singularities) near input
    21 = 36.87 deg. ...".

    Parameters
    ----------
    summary
        The content of ``summary.json``, the file with the main results of the run.
    """
    overview = summary["overview"]
    # The places of the overview say where in the motion something happens. Depending on the
    # run they are inputs, times or numbers of samples.
    if len(summary["inputs"]) != 1 or overview["place"]["kind"] != "input":
        return []
    place_text = PlaceText(overview)
    modes_by_places: dict[str, list[int]] = {}
    for mode in summary["assembly_modes"]:
        entry = overview["modes"].get(str(mode["number"]))
        if entry is None or set(entry["statuses"]) - {"OUT_OF_REACH"}:
            # The mode is not in the overview, or some of its samples have another status
            # than OK and OUT_OF_REACH (the links cannot be assembled). The ends of its
            # spans need not be dead centres then.
            return []
        # The mode exists in these spans of the input. Each span is the input (rad) at its
        # first and at its last sample.
        spans = entry["closes"]
        texts = _dead_centre_texts(spans, overview["place_range"], place_text)
        if texts:
            text = listing(texts, MAX_LISTED_EVENTS)
            modes_by_places.setdefault(text, []).append(mode["number"])
    if not modes_by_places:
        text = f"No mode has {TYPE_2_TEXT} at the samples of this range"
        analyses = {analysis["name"] for analysis in summary["analyses"]}
        if "singularities" in analyses:
            return [f"{text}."]
        return [f"{text}; -a singularities also searches between them."]
    name = place_text.named  # of the input
    # The places are intervals if samples are far apart, otherwise values.
    where = f"at {name}" if place_text.are_samples_far_apart else f"near {name} ="
    lines = []
    mode_count = 0
    for places, numbers in modes_by_places.items():
        mode_count += len(numbers)
        if len(numbers) == 1:
            subject, verb, pronoun = "Mode", "ends", "its"
        else:
            subject, verb, pronoun = "Modes", "end", "their"
        # The swing of an output is the difference of its largest and smallest angle.
        lines.append(
            f"{subject} {number_list(numbers)} {verb} at dead centres (type II "
            f"singularities) {where} {places} deg. The table has {pronoun} values up to "
            "the last samples, so that swings and the largest velocity ratios are lower "
            "bounds: velocity ratios grow without bound towards a dead centre."
        )
    if mode_count < len(summary["assembly_modes"]):
        lines.append("The other modes have no dead centre at the samples of this range.")
    return lines


def _dead_centre_texts(
    spans: Sequence[Sequence[float]],
    input_range: Sequence[float],
    place_text: PlaceText,
) -> Lines:
    """Return texts of the inputs near which an assembly mode has dead centres.

    A span is a part of the range in which the mode exists. If it ends inside the range, the
    dead centre is between the last sample of the span and the next sample outside it. If
    the samples are far apart, the text names both of them. Otherwise it names only the last
    sample of the span.

    Parameters
    ----------
    spans
        The inputs (rad) of the first and the last sample of each span.
    input_range
        The inputs of the first and the last sample of the run (rad).
    place_text
        Writes an input as text.
    """
    texts = []
    for span in spans:
        low, high = sorted(span)
        sample_below = low - place_text.sample_step
        sample_above = high + place_text.sample_step
        for end, limit, interval in (
            (low, min(input_range), (sample_below, low)),
            (high, max(input_range), (high, sample_above)),
        ):
            if end == limit:
                continue
            if place_text.are_samples_far_apart:
                texts.append(place_text.between(*interval))
            else:
                texts.append(place_text.value(end))
    return texts


def _describe_unexpected_mobility(summary: Any) -> Lines:
    """Return a line if counting links and pairs gives the wrong mobility.

    The mobility (number of degrees of freedom) follows from the numbers of links and pairs,
    key ``graph``. In mechanisms with special dimensions this count is too small. The
    mobility then follows from the rank of the velocity equations (key ``rank``). A
    constraint is redundant if it follows from the other constraints.

    Parameters
    ----------
    summary
        The content of ``summary.json``, the file with the main results of the run.
    """
    mobility = summary["mobility"]
    redundant = summary["redundant_constraints"]
    if mobility["rank"] is None or mobility["graph"] == mobility["rank"]:
        return []
    count = redundant["count"] if redundant else 0
    reason = ""
    if count:
        constraints = "constraint is" if count == 1 else "constraints are"
        reason = (
            f", because {count} {constraints} redundant. The mechanism moves only if its "
            "geometry is exact"
        )
    return [
        f"Over-constrained: the mobility is {mobility['rank']}, while counting links and "
        f"pairs gives {mobility['graph']}{reason}."
    ]


def _describe_unapplied_limits(summary: Any) -> Lines:
    """Return a line if the file has joint limits that this run does not apply.

    Only a simulation ends at joint limits. Without this line, users would think that
    outputs can reach their whole range.
    """
    texts = [
        f"{pair} ({degree_range_text(low, high)} deg)"
        for pair, (low, high) in summary.get("unapplied_joint_limits_rad", {}).items()
    ]
    if not texts:
        return []
    noun = "joint limit" if len(texts) == 1 else "joint limits"
    return [
        f"This run does not apply the {noun} of {listing(texts, MAX_LISTED_LIMITS)}; "
        "only a simulation (--start) ends at joint limits."
    ]


def _describe_meetings(summary: Any) -> Lines:
    """Return sentences on the inputs at which assembly modes (ways to assemble) meet.

    These inputs are computed from the equations, so they can be between samples.
    """
    sentences = [meeting["sentence"] for meeting in summary["mode_meetings"]]
    lines = list(sentences[:MAX_LISTED_MEETINGS])
    unlisted = len(sentences) - MAX_LISTED_MEETINGS
    if unlisted > 0:
        lines.append(f"Modes meet at {counted(unlisted, 'other input')}: see summary.json.")
    return lines


def _describe_drive(summary: Any) -> Lines:
    """Return lines on what moves the mechanism in a simulation, and how far inputs move.

    Causes are loads, a driving torque, or only the inertia.

    Parameters
    ----------
    summary
        The content of ``summary.json``, the file with the main results of the run.
    """
    inputs = summary["inputs"]
    loads = summary["simulation"]["loads"]
    # The torques of the option --torque are loads, too: one for each driven input.
    is_driven = any(load["drives"] for load in loads)
    texts = [
        load["name"] if load["name"] == load["kind"] else f"{load['name']} ({load['kind']})"
        for load in loads
        if not load["drives"]
    ]
    causes = [] if loads else ["its inertia alone"]
    if is_driven:
        causes.append("the driving torque of --torque")
    if texts:
        noun = "load" if len(texts) == 1 else "loads"
        causes.append(f"the {noun} {listing(texts, MAX_LISTED_LOADS)}")
    drive = ""
    if not is_driven:
        free = "The input is" if len(inputs) == 1 else "The inputs are"
        drive = (
            f" {free} not driven, so the driving torque is 0; --torque adds one, and --law "
            "in place of --start gives the torque of a prescribed motion."
        )
    ranges = [
        f"{pair} moves between {angle_text(low)} and {angle_text(high)} deg"
        for pair, (low, high) in inputs.items()
    ]
    return [
        f"The mechanism is moved by {' and '.join(causes)}.{drive}",
        f"Input {', input '.join(ranges)}.",
    ]


def _describe_simulation(simulation: Any) -> Lines:
    """Return lines on how a simulation ended, and on its events.

    Events are, for example, stops and dead centres.

    Parameters
    ----------
    simulation
        The value under the key ``simulation`` in the summary of the run.
    """
    end = simulation["end"]
    lines = []
    if end["kind"] == "time":
        lines.append(f"It ran to the end, {end['t']:.6g} s.")
    else:
        lines.append(
            f"It ended at {end['t']:.6g} of {simulation['duration_s']:.6g} s: "
            f"{end['reason']}. The results until then are kept."
        )
    event_count = simulation["events"]
    lines += _describe_events(event_count, simulation["event_list"])
    # At a singularity of type II a locked input does not hold the output. The three kinds
    # of events in the condition below are such singularities. At a "crossing", curves of
    # configurations cross.
    if not {"dead_centre", "type_2", "crossing"} & set(simulation["event_kinds"]):
        # The line is "The motion meets no singularity of type II (...).".
        lines.append(f"The motion meets no {TYPE_2_TEXT.removeprefix('a ')}.")
    return lines


def _describe_events(event_count: int, events: Sequence[Any]) -> Lines:
    """Return lines on the events of a simulation, such as stops and dead centres.

    In a damped oscillation an input stops at the end of each swing. Stops after swings
    below `LEAST_SWING_RAD` are only counted.

    Parameters
    ----------
    event_count
        Number of all events of the simulation.
    events
        The first events with their kinds and times (s). The summary of a run leaves out
        further events. A stop also has the angle of the swing before it (rad).
    """
    times_by_event: dict[str, Lines] = {}
    small_stop_count = 0
    for event in events:
        # Events that are not stops have no swing.
        is_small_stop = event.get("swing_rad", math.inf) <= LEAST_SWING_RAD
        if is_small_stop:
            small_stop_count += 1
            continue
        # The text may contain "{pair}", for the name of the pair of the event.
        text = EVENT_TEXTS.get(event["kind"], event["kind"])
        text = text.format(pair=event["pair"] or "the input")
        times_by_event.setdefault(text, []).append(number_text(event["t"], digits=4))
    lines = []
    if times_by_event:
        listed_count = len(events) - small_stop_count
        texts = [
            f"{text} at t (s) = {listing(times, MAX_LISTED_EVENTS)}"
            for text, times in times_by_event.items()
        ]
        lines.append(f"{counted(listed_count, 'event')}: {'; '.join(texts)}.")
    if small_stop_count:
        lines.append(
            f"{counted(small_stop_count, 'more stop')} of all links, after swings of less "
            f"than {math.degrees(LEAST_SWING_RAD):.5f} deg, "
            f"{'is' if small_stop_count == 1 else 'are'} only in the table of events."
        )
    if later_count := event_count - len(events):
        verb = "is" if later_count == 1 else "are"
        lines.append(
            f"{counted(later_count, 'later event')} {verb} only in the table of events."
        )
    return lines


def _warnings(summary: Any) -> Lines:
    """Return the warnings of a run, each with its cause and what to do.

    The warnings concern the motion, the analyses and the rest of the run. A last group of
    lines explains missing results.

    Parameters
    ----------
    summary
        The content of ``summary.json``, the file with the main results of the run.
    """
    warnings = list(summary["motion_warnings"])
    names = [analysis["name"] for analysis in summary["analyses"]]
    for analysis in summary["analyses"]:
        prefix = f"{analysis['name']}: " if len(names) > 1 else ""
        warnings += [prefix + text for text in analysis["warnings"]]
    # `summary["warnings"]` repeats the warnings above. Only the other warnings are added,
    # such as the warnings of a verification.
    printed_already = {
        *summary["motion_warnings"],
        *(
            f"{analysis['name']}: {text}"
            for analysis in summary["analyses"]
            for text in analysis["warnings"]
        ),
    }
    warnings += [text for text in summary["warnings"] if text not in printed_already]
    warnings += _status_warnings(summary)
    return warnings


def _status_warnings(summary: Any) -> Lines:
    """Return a line for each status other than OK: count, places, cause and cure.

    A status tells whether a configuration or a result could be computed. The lines are
    first on configurations, then on pole axes (axes of the relative rotation of two links),
    then on the tables of analyses.
    """
    return [
        *_row_warnings(summary),
        *_pole_warnings(summary),
        *_table_warnings(summary),
    ]


def _row_warnings(summary: Any) -> Lines:
    """Return a line for each reason why rows of the motion have no result.

    A row is one sample of the inputs in one assembly mode (way to assemble the mechanism).
    Its status is OK, or the reason why it has no result.

    Parameters
    ----------
    summary
        The content of ``summary.json``, the file with the main results of the run.
    """
    warnings = []
    overview = summary["overview"]
    place_text = PlaceText(overview)
    meanings = summary["status_meaning"]
    # A place is an input or a time, such as "from 30 to 50 deg". Samples on a grid, or
    # samples with only a number, have no place.
    has_places = overview["is_path"] and place_text.kind != "sample"
    for status, count in summary["status"].items():
        if status == "OK":
            continue
        # Modes for which the rows are missing at the same places are named together.
        modes_by_place: dict[str, list[int]] = {}
        for mode in summary["assembly_modes"]:
            entry = overview["modes"].get(str(mode["number"]), {})
            spans = entry.get("statuses", {}).get(status)
            if not spans:
                continue
            further = entry["unlisted_spans"].get(status, 0)
            place = f" {place_text.named_spans(spans, further)}" if has_places else ""
            modes_by_place.setdefault(place, []).append(mode["number"])
        places = [
            f"{'mode' if len(numbers) == 1 else 'modes'} {number_list(numbers)}{place}"
            for place, numbers in modes_by_place.items()
        ]
        cause = _cause(status, summary) or meanings[status]
        warnings.append(
            f"{counted(count, 'row')} {'has' if count == 1 else 'have'} no result, "
            f"{status} ({'; '.join(places)}): {cause}."
        )
    return warnings


def _pole_warnings(summary: Any) -> Lines:
    """Return a line for each cause for which axes of relative rotation have no result.

    The poles (axes of the relative rotation of two links) have a status at each sample.
    NO_POLE is no failure: the two links do not rotate relative to each other.
    """
    count_by_status = summary["pole_status"]
    total = sum(count_by_status.values())
    return [
        f"{count} of {total} pole axes have no result, {status}: "
        f"{summary['status_meaning'][status]}."
        for status, count in count_by_status.items()
        if status not in ("OK", "NO_POLE")
    ]


def _table_warnings(summary: Any) -> Lines:
    """Return lines that say why rows in tables of analyses have no result.

    The status of a row is OK, or the reason why it has no result. There is a line for each
    table and reason. Rows of the motion have statuses too, and `_row_warnings` explains
    these. Such a status is not explained again here.

    Parameters
    ----------
    summary
        The content of ``summary.json``, the file with the main results of the run.
    """
    warnings = []
    for analysis in summary["analyses"]:
        for table, count_by_status in analysis["failed_rows"].items():
            source = analysis["name"]
            if table != source:  # the main table of an analysis has its name
                source = f"table {table} of {source}"
            for status, count in count_by_status.items():
                if status in summary["status"]:
                    continue
                verb = "has" if count == 1 else "have"
                meaning = summary["status_meaning"][status]
                warnings.append(
                    f"{counted(count, 'row')} of {source} {verb} no result, {status}: "
                    f"{meaning}."
                )
    return warnings


def _cause(status: str, summary: Any) -> str:
    """Return in words why rows have no result, and what to do; "" if nothing specific.

    Only the status OUT_OF_REACH (links cannot be assembled at these inputs) has such a
    text.

    Parameters
    ----------
    status
        The reason why rows have no result.
    summary
        The content of ``summary.json``, the file with the main results of the run.
    """
    if status != "OUT_OF_REACH":
        return ""
    if len(summary["inputs"]) > 1:
        # Positions of dyads (groups of two links) have a closed form, so the cause is
        # certain.
        if set(summary["groups"]) <= {"dyad"}:
            return (
                "the links cannot be assembled at these inputs; narrow the ranges of the "
                "inputs or change the arcs"
            )
        return (
            "the links cannot be assembled at these inputs, or no verified path leads "
            "there from a neighbouring sample; narrow the ranges, or take more samples"
        )
    # "closes" lists the samples at which the loops of links close in a mode.
    closes_somewhere = any(
        entry["closes"] for entry in summary["overview"]["modes"].values()
    )
    if closes_somewhere:
        return (
            "the modes end at dead centres, beyond which the links cannot be assembled; "
            "narrow the range of the input, drive another pair (--input), or change arcs"
        )
    return "the links cannot be assembled at these inputs; change the range or the arcs"


def _accuracy(summary: Any) -> str:
    """Return one line on the accuracy of the results.

    Parameters
    ----------
    summary
        The content of ``summary.json``, the file with the main results of the run. Its key
        ``errors_reached`` has the largest error bounds. A bound that was not computed is
        None.
    """
    errors = summary["errors_reached"]
    texts = [
        text.format(bound_text(errors[key]))
        for key, text in ERROR_TEXTS
        if errors[key] is not None
    ]
    if "simulation" in summary:
        simulation = summary["simulation"]
        missed = ", which was MISSED" if simulation["missed"] else ""
        texts.insert(
            0,
            f"{bound_text(simulation['achieved_error_rad'])} rad in the simulated input "
            f"(tolerance {simulation['tolerance']:.0e} rad{missed}), "
            f"{bound_text(simulation['energy_imbalance_J'])} J in the energy (largest: "
            f"{simulation['energy_scale_J']:.2g} J)",
        )
    if not texts:  # no error bound is known
        return ""
    bounds = f"at each sample are at most {', '.join(texts)}"
    overview = summary["overview"]
    # The report has a table of outputs only if modes were found and outputs are examined.
    # The line then begins with a sentence about this table, which says how accurate it is.
    has_output_table = summary["assembly_modes"] and overview["outputs"]
    if has_output_table:
        return f"{_table_accuracy(overview)}. Errors {bounds}"
    return f"errors {bounds}"


def _table_accuracy(overview: Any) -> str:
    """Return in words how accurate the extremes in the table of outputs are.

    The extremes are the extreme values at the samples. Between two samples, values can be
    larger or smaller. An example of the text is "at the samples, the table is accurate
    to the digits shown. Between samples (1 deg of input 21 apart), values can exceed the
    extremes in the table: angles by about 0.002 deg".

    Samples are a path, or a grid of several inputs. The accuracy is stated for a path only.

    Parameters
    ----------
    overview
        The overview of the motion in the summary of the run.
    """
    # The distance of two samples as text. Empty if the samples have numbers, but no
    # distance.
    sample_distance = PlaceText(overview).step_text
    if not overview["is_path"]:
        apart = f", which are {sample_distance} apart" if sample_distance else ""
        return f"the table has the extremes of the samples{apart}"
    exceptions = []
    # The excess is how far a quantity may go beyond its extremes between samples.
    excesses = _largest_excesses(overview)
    for key, excess in excesses.items():
        if not excess:
            continue
        number = f"{float(bound_text(excess)):.12f}"
        number_without_zeros = number.rstrip("0").rstrip(".")
        # A text such as "angles by about {} deg".
        text_of_quantity = TABLE_QUANTITIES[key]
        exceptions.append(text_of_quantity.format(number_without_zeros))
    line = "the table is accurate to the digits shown"
    if exceptions:
        apart = f" ({sample_distance} apart)" if sample_distance else ""
        line = (
            f"at the samples, {line}. Between samples{apart}, values can exceed the "
            f"extremes in the table: {', '.join(exceptions)}"
        )
    # An assembly mode is one way to assemble the mechanism. Its "statuses" tell why some
    # samples have no result.
    modes = overview["modes"].values()
    close_everywhere = all(mode["closes_everywhere"] for mode in modes)
    has_other_values = len(exceptions) < len(excesses)
    if exceptions and has_other_values and close_everywhere:
        line += ", other values by less than the last digit shown"
    if not close_everywhere:
        line += ". For a mode that ends, the table covers the samples up to its end"
    elif any(mode["statuses"] for mode in modes):
        line += ". Samples without a result are left out of the table"
    return line


def _largest_excesses(overview: Any) -> dict[str, float]:
    """Return how far quantities between samples may exceed the extremes in the table.

    The table states the range of each output and its velocity ratio, for each assembly mode
    (way to assemble the mechanism). If inputs are given as functions of time, the table has
    speeds (rad/s) instead of velocity ratios.

    Parameters
    ----------
    overview
        The overview of the motion in the summary of the run.

    Returns
    -------
    The largest excess of each quantity, by its key in `TABLE_QUANTITIES`. It is 0 if no
    excess would change a printed digit. Quantities that the table does not have are left
    out.
    """
    # The entry "ratio" of the overview is a unit: "rad/s" if the overview has speeds, "" if
    # it has velocity ratios.
    unit_of_rates = overview["ratio"]
    has_speeds = unit_of_rates == "rad/s"
    largest: dict[str, float] = {}
    for mode in overview["modes"].values():
        for motion in mode["outputs"]:
            for key, excess, last_digit in _table_excesses(motion, has_speeds):
                # A mode that does not close at all samples may end at a dead centre. Its
                # velocity ratios grow without bound there, so no excess is stated.
                if key == "ratio" and not mode["closes_everywhere"]:
                    continue
                # A smaller excess would not change the printed number.
                visible_excess = excess if excess > 0.5 * last_digit else 0.0
                largest[key] = max(largest.get(key, 0.0), visible_excess)
    # The text lists the quantities in the order of the table.
    return {key: largest[key] for key in TABLE_QUANTITIES if key in largest}


def _table_excesses(motion: Any, has_speeds: bool) -> Iterator[tuple[str, float, float]]:
    """Yield how far quantities of an output may exceed their printed extremes.

    The extremes are the extreme values at the samples. Between samples a quantity may
    exceed them, by the excess.

    Parameters
    ----------
    motion
        The motion of the output in one assembly mode, from the overview of the run. Its
        entry "excess_between_samples" has three excesses:

        - "angle_rad": of the angle of the output.
        - "ratio": of the speed or the velocity ratio.
        - "transmission": of the transmission angle (rad). If the output has no transmission
          angle, it is the excess of the transmission measure (without unit).
    has_speeds
        Whether the table has speeds instead of velocity ratios.

    Yields
    ------
    For each quantity its key in `TABLE_QUANTITIES`, the excess, and the value of the last
    digit that the table prints, to tell whether the excess would be visible.
    """
    excess = motion["excess_between_samples"]
    yield "angle", math.degrees(excess["angle_rad"]), 0.01
    # The lists have the lowest and the highest value for each input, or None if there is no
    # value. There is one excess for all these values, so the finest last digit counts.
    extreme_ratios = [*motion["lowest_ratio"], *motion["highest_ratio"]]
    last_digits = [ratio_last_digit(ratio) for ratio in extreme_ratios if ratio is not None]
    finest_last_digit = min(last_digits, default=math.inf)
    rate_key = "speed" if has_speeds else "ratio"
    yield rate_key, excess["ratio"], finest_last_digit
    if motion["least_transmission"]:
        angle = math.degrees(motion["least_transmission"]["angle_rad"])
        last_digit = last_significant_digit(angle, TRANSMISSION_DIGITS)
        yield "transmission_angle", math.degrees(excess["transmission"]), last_digit
    elif motion["least_transmission_measure"]:
        measure, _place_of_measure = motion["least_transmission_measure"]
        last_digit = last_significant_digit(measure, MEASURE_DIGITS)
        yield "transmission_measure", excess["transmission"], last_digit


def _files(summary: Any, output: RunOutput) -> str:
    """Return one line on the files that a run has written, or on how to write them.

    Parameters
    ----------
    summary
        The content of ``summary.json``, the file with the main results of the run.
    output
        What the run has written.
    """
    parts = []
    if output.folder is None:
        hint = "" if output.recording else ", --save X.rrd for a recording to view"
        parts.append(f"no tables saved; add -o DIR for tables{hint}")
    else:
        size = sum(summary.get("bytes", {}).values())
        unit = "deg" if output.is_in_degrees else "rad"
        names = listing(output.file_names, 8)
        size_words = f", {size_text(size)}" if size else ""
        parts.append(f"{output.folder}: {names}{size_words}, angles in {unit}")
    if summary.get("replaced_files"):
        parts.append(
            "replaced tables of an earlier run: " + listing(summary["replaced_files"], 8)
        )
    if output.figures:
        parts.append(output.figures)
    if output.recording:
        cost = summary["cost"].get("recording")
        size_words = f" ({size_text(cost['bytes'])})" if cost else ""
        parts.append(f"recording {output.recording}{size_words}")
    # The recording (motion for a 3D viewer) may have only one of every `interval` samples.
    recorded_samples = summary.get("recording", {"one_of": 1, "from_sample": 0})
    interval = recorded_samples["one_of"]
    first_sample = recorded_samples["from_sample"]
    if interval > 1 or first_sample > 0:
        parts.append(
            f"the recording has only one of every {counted(interval, 'sample')} of each "
            f"assembly mode, from sample {first_sample} on; --log-every K changes this"
        )
    return "; ".join(parts)


def _next_steps(summary: Any, output: RunOutput) -> list[tuple[str, str]]:
    """Return commands that the user may want after this run, the most useful ones first.

    Each command has a few words on what it computes. A command is suggested if the run has
    not computed this already.

    Parameters
    ----------
    summary
        The content of ``summary.json``, the file with the main results of the run.
    output
        What the run has written, and the words of its command line.
    """
    # The analyses that this run has computed.
    names = {analysis["name"] for analysis in summary["analyses"]}
    same_mechanism = shlex.join([output.file, *output.mechanism_options])
    command = f"spherekit run {same_mechanism}"
    # The same run again, with all its options.
    same_run = shlex.join(["spherekit", *output.words]) if output.words else command
    outputs = summary["overview"]["outputs"] if summary["assembly_modes"] else []
    is_simulation = "simulation" in summary
    steps = []
    if is_simulation:
        if output.folder is None:
            steps.append((f"{same_run} -o DIR --figures", "tables and figures over time"))
        if output.recording is None:
            steps.append((f"{same_run} --view", "watch the motion"))
    elif not summary["assembly_modes"]:
        # The analyses of this run did not use the motion, so no motion was computed.
        steps.append((command, "motion: ranges of outputs and velocity ratios"))
    if outputs and "singularities" not in names and not is_simulation:
        # With several inputs, singular configurations form curves or surfaces.
        description = "exact places of singularities, between samples too"
        if len(summary["inputs"]) > 1:
            description = "singular configurations over the ranges of the inputs"
        steps.append((f"{command} -a singularities", description))
    # These three analyses compute driving torques. "eksergian" uses Eksergian's equation of
    # motion, which is for one input. "dynamics" takes any number of inputs.
    has_torques = bool(names & {"eksergian", "dynamics", "statics"})
    if summary["has_masses"] and not has_torques:
        name = "eksergian" if len(summary["inputs"]) == 1 else "dynamics"
        steps.append((f"{command} -a {name}", "driving torques"))
    if output.folder is None and not is_simulation:
        steps.append((f"{same_run} -o DIR --figures", "tables and figures of this run"))
    # `page` and `certify` take a mechanism file, not a study file.
    is_mechanism = not is_study(find(output.file))
    if is_mechanism:
        steps.append(
            (f"spherekit page {same_mechanism}", "a page on which the mechanism moves")
        )
    steps = steps[:MAX_NEXT_STEPS]
    if summary["can_prove_modes"] and is_mechanism:
        steps.append(
            (f"spherekit certify {same_mechanism}", "prove that no assembly mode is missed")
        )
    return steps


def _details(summary: Any) -> Lines:
    """Return lines on how the results of a run were computed, for ``--verbose``.

    The lines state the mobility (number of degrees of freedom), methods, errors and cost.
    Groups are sets of links whose positions are computed together, such as dyads (groups of
    two links). An acceleration coefficient is the derivative of an angular velocity with
    respect to the input, for an input that moves at 1 rad/s. A pole axis is the axis about
    which one link rotates relative to another.

    Parameters
    ----------
    summary
        The content of ``summary.json``, the file with the main results of the run.
    """
    mobility = summary["mobility"]
    rank = mobility["rank"]
    text = f"mobility {mobility['graph']} by the numbers of links and pairs"
    if rank is not None:
        text += f", {rank} by the rank of the velocity equations"
    lines = [text]
    redundant = summary["redundant_constraints"]
    if redundant and redundant["count"]:
        lines.append(
            f"{counted(redundant['count'], 'redundant constraint')} among pairs "
            f"{', '.join(redundant['pairs'])}"
        )
    lines.append(f"groups: {', '.join(summary['groups']) or 'none'}")
    if summary["assembly_modes"]:
        lines.append(f"search of assembly modes: {summary['search']}")
    errors = summary["errors_reached"]
    if errors["largest_closure_residual_rad"] is not None:
        lines.append(
            f"largest closure residual {errors['largest_closure_residual_rad']:.1e} rad"
        )
    key = "largest_acceleration_coefficient_error_bound"
    if errors[key] is not None:
        # For example "acceleration coefficients to 2e-12 1/rad", the bound of their errors.
        lines.append(f"acceleration coefficients to {bound_text(errors[key])} 1/rad")
    if count := summary["pole_status"].get("NO_POLE"):
        lines.append(
            f"{count} of {sum(summary['pole_status'].values())} pole axes do not exist "
            "(NO_POLE): two links have no relative motion there"
        )
    if "simulation" in summary:
        simulation = summary["simulation"]
        reason = summary["cost"]["simulate"]["reason"]
        lines.append(f"engine {simulation['engine']['name']} ({reason})")
    return lines + spent(summary["cost"])


def spent(cost: Any) -> Lines:
    """Return lines for the cost of a run: evaluations, time, and sizes of files.

    Parameters
    ----------
    cost
        The value under the key ``cost`` in the summary of the run.
    """
    seconds = cost["seconds"]  # by stage of the run
    total = sum(seconds.values())
    # Stages that took less than a small share of the time are not listed.
    stages = ", ".join(
        f"{stage} {duration(time_s)}"
        for stage, time_s in seconds.items()
        if time_s > MIN_STAGE_SHARE * total
    )
    evaluations = ", ".join(
        counted(cost[key], noun)
        for key, noun in (
            ("configurations", "configuration"),
            ("poles", "pole"),
            ("axis_derivatives", "derivative"),
            ("link_rates", "link rate"),
        )
        if cost[key]
    )
    separator = "; " if evaluations else ""
    # The size in a format (CSV or Parquet) is the sum over all tables. It is stated only if
    # all tables were written in this format.
    tables = cost["tables"].values()
    rows = counted(sum(table["rows"] for table in tables), "row")
    sizes = f"  {rows} in {counted(len(tables), 'table')}"
    for key, name in (("csv_bytes", "CSV"), ("parquet_bytes", "Parquet")):
        if all(key in table for table in tables):
            sizes += f", {size_text(sum(table[key] for table in tables))} {name}"
    if recording := cost.get("recording"):
        sizes += f"; recording: {recording['entities']} entities, "
        sizes += size_text(recording["bytes"])
    return [f"cost: {evaluations}{separator}{duration(total)} s ({stages})", sizes]


def duration(seconds: float) -> str:
    """Return seconds with two digits, or as a whole number from 100 on."""
    return f"{seconds:.2g}" if seconds < 99.5 else f"{seconds:.0f}"


def accuracy_line(choice: Any) -> str:
    """Return the line about the setting that was chosen to meet a tolerance.

    A setting is one way to compute the tables of a run. Two errors of the setting may be
    known:

    - the predicted error, from an earlier measurement;
    - the achieved error, from some rows of this run (check rows) that were also computed
      accurately.

    Parameters
    ----------
    choice
        The value under the key ``accuracy`` in the summary. ``why`` is the reason of the
        choice as a phrase. An error that is not known is None.
    """
    predicted_error = choice["predicted_error"]
    achieved_error = choice["achieved_error"]
    predicted = ""
    if predicted_error is not None:
        predicted = f", predicted error {predicted_error:.1e}"
    line = (
        f"tolerance {choice['tolerance']:g}: {choice['setting']} "
        f"({choice['why']}){predicted}"
    )
    unmet = "" if choice["met"] else ": THE TOLERANCE IS NOT MET"
    if achieved_error is not None:
        return (
            f"{line}; largest error {achieved_error:.1e} at {choice['check_rows']} "
            "check rows "
            f"({choice['worst_column']}){unmet}"
        )
    if predicted_error is not None:
        # ``why`` names the earlier measurement.
        return f"{line}, from this measurement{unmet}"
    # A setting concerns the computation of samples. Neither of its errors is known if no
    # requested result depends on samples.
    return f"{line}; no requested result depends on samples"
