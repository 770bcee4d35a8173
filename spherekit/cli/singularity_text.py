"""Sentences on how near the samples of a run come to singularities of types I and II.

An output loses a direction of motion at a singularity of type I. At one of type II the
locked inputs do not hold the output.
"""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

from spherekit.cli.mode_text import modes_text
from spherekit.cli.motion_screen import (
    MEASURE_ERROR,
    RATIO_ERROR,
    inputs_text,
    transmission_text,
)
from spherekit.cli.place_text import MAX_LISTED_PLACES
from spherekit.conventions import Lines
from spherekit.number_text import number_text
from spherekit.wording import counted

NEAR_SHARE = 0.02
"""Share of the largest value from which the least singular value of a Jacobian, as well as
a transmission measure, counts as nearly 0. Larger: more is called nearly singular."""


def describe_singularities(summary: Any) -> Lines:
    """Return sentences on how near the samples come to singularities of types I and II.

    The screen also has a table of outputs. It states the singularities of an output with a
    fixed axis, if the mechanism has one input and the run is no simulation. There are no
    sentences about these. They are about

    - type II (locked inputs do not hold the output), if there are several inputs and the
      run is no simulation,
    - type I (an output loses a direction of motion), for each output that is not in the
      table.

    Parameters
    ----------
    summary
        The content of ``summary.json``.
    """
    overview = summary["overview"]
    has_several_inputs = len(summary["inputs"]) > 1
    is_simulation = "simulation" in summary
    if not overview["modes"]:
        return []
    lines = []
    if has_several_inputs and not is_simulation:
        lines += _describe_type_2(summary)
    for number, output in enumerate(overview["outputs"]):
        is_in_table = output["fixed_axis"] and not has_several_inputs and not is_simulation
        if not is_in_table:
            lines += _describe_type_1(summary, number)
    names = {analysis["name"] for analysis in summary["analyses"]}
    has_exact_places = "singularities" in names
    if lines and has_several_inputs and not is_simulation and not has_exact_places:
        lines[-1] += (
            " These places are those of samples; -a singularities searches between "
            "them, too."
        )
    return lines


def _extent(summary: Any) -> str:
    """Return what the samples cover, such as ``on this path``."""
    if "simulation" in summary:
        return "in this motion"
    if not summary["overview"]["is_path"]:
        return "at these samples"
    return "on this path" if len(summary["inputs"]) > 1 else "in this range"


def _describe_type_2(summary: Any) -> Lines:
    """Return sentences on singularities of type II of a mechanism with several inputs.

    They say which assembly modes have samples at a singularity, or end at one. If there are
    none, they name the sample that is nearest to a singularity.

    Parameters
    ----------
    summary
        The content of ``summary.json``.
    """
    overview = summary["overview"]
    meaning = "type II (locked inputs do not hold the output)"
    extent = _extent(summary)
    modes_that_end: list[int] = []
    modes_at_singularity: list[int] = []
    nearest: _NearestSample | None = None
    for number, entry in overview["modes"].items():
        if entry["closes"] and "OUT_OF_REACH" in entry["statuses"]:
            modes_that_end.append(int(number))
        if "AT_SINGULARITY" in entry["statuses"]:
            modes_at_singularity.append(int(number))
        for sample in _list_nearest_samples(number, entry):
            if nearest is None or sample.value < nearest.value:
                nearest = sample
    lines = []
    if modes_at_singularity:
        lines.append(
            f"Samples of {modes_text(modes_at_singularity)} are at singularities of "
            f"{meaning}."
        )
    if modes_that_end:
        verb = "ends" if len(modes_that_end) == 1 else "end"
        lines.append(
            f"{modes_text(modes_that_end, True)} {verb} {extent}, at singularities of "
            f"{meaning}."
        )
    if not modes_at_singularity and not modes_that_end:
        beginning = f"No singularity of {meaning} is met"
        end = ""
        if nearest is not None:
            if nearest.value <= NEAR_SHARE * nearest.best_value:
                beginning = f"A singularity of {meaning} is nearly met"
            place = inputs_text(summary, nearest.inputs)
            end = (
                f"; the closest configuration is in mode {nearest.mode} at {place}, where "
                f"the transmission {nearest.measure_text}"
            )
        lines.append(f"{beginning} {extent}{end}.")
    return lines


class _NearestSample(NamedTuple):
    """The sample of an assembly mode that is nearest to a singularity of type II.

    Attributes
    ----------
    mode
        Number of the mode.
    inputs
        Inputs of the sample (rad).
    value, best_value
        The transmission measure or angle (deg) there, and the best value that it can have.
        It is 0 at type II.
    measure_text
        The value in words, such as ``angle at pair 3 is 41.2 deg``.
    """

    mode: str
    inputs: Any
    value: float
    best_value: float
    measure_text: str


def _list_nearest_samples(mode: str, entry: Any) -> Iterator[_NearestSample]:
    """Yield the samples of an assembly mode that are nearest to singularities of type II.

    There is one for each output whose transmission measure is known (how well the locked
    inputs hold the output, from 0 to 1). If there is none, the sample with the least
    transmission angle of a dyad (two links in series) is yielded.

    Parameters
    ----------
    mode
        Number of the mode.
    entry
        The summary of the mode.
    """
    has_measure = False
    for motion in entry["outputs"]:
        measure = motion["least_transmission_measure"]
        inputs = motion["inputs_of_least_measure_rad"]
        if measure and inputs:
            has_measure = True
            value = measure[0]
            text = f"measure is {number_text(value, MEASURE_ERROR, 2)}"
            yield _NearestSample(mode, inputs, value, 1.0, text)
    transmission = entry["least_transmission"]
    if transmission and not has_measure:
        angle = transmission["angle_rad"]
        text = f"angle at pair {transmission['pair']} is {transmission_text(angle)} deg"
        yield _NearestSample(
            mode, transmission["inputs_rad"], math.degrees(angle), 90.0, text
        )


def _describe_type_1(summary: Any, number: int) -> Lines:
    """Return sentences on singularities of type I of an output.

    Parameters
    ----------
    summary
        The content of ``summary.json``.
    number
        Position of the output among those of the overview.
    """
    overview = summary["overview"]
    outputs = overview["outputs"]
    output = f"output {outputs[number]['label']}" if len(outputs) > 1 else "output"
    input_count = len(summary["inputs"])
    has_several_inputs = input_count > 1
    # Several inputs can always move together so that an output with one degree of freedom
    # rests. Such an output is singular of type I in every configuration, and what matters
    # is where no input moves it.
    has_one_freedom = has_several_inputs and outputs[number]["fixed_axis"]
    if has_one_freedom:
        singular = f"in a configuration where no input moves the {output}"
        singularity = f"configuration where no input moves the {output}"
        singularities = f"Configurations where no input moves the {output}"
    else:
        motion = "loses a direction of motion"
        if not has_several_inputs:
            motion = "rests while the input moves"
        singular = f"singular of type I (the {output} {motion})"
        singularity = f"singularity of type I (the {output} {motion})"
        singularities = f"Singularities of type I (the {output} {motion})"
    extent = _extent(summary)

    # The least singular value of the output's velocity Jacobian is 0 at type I. A mode can
    # be singular everywhere, or at some places. Otherwise `nearest` is the Jacobian of the
    # mode and sample that come nearest to a singularity.
    modes_singular_everywhere: list[int] = []
    modes_by_place: dict[str, list[int]] = {}
    unlisted_place_count = 0
    nearest: Any = None
    nearest_mode = ""
    for mode, entry in overview["modes"].items():
        jacobian = entry["outputs"][number]["jacobian"]
        if jacobian is None:
            continue
        if jacobian["largest_least_singular_value"] <= RATIO_ERROR:
            modes_singular_everywhere.append(int(mode))
            continue
        places = [inputs_text(summary, inputs) for inputs in jacobian["type_1_inputs_rad"]]
        if jacobian["least_singular_value"] <= RATIO_ERROR:
            places.append(inputs_text(summary, jacobian["inputs_rad"]))
        unlisted_place_count += jacobian["further_type_1_places"]
        unlisted_place_count += max(len(places) - MAX_LISTED_PLACES, 0)
        for place in dict.fromkeys(places[:MAX_LISTED_PLACES]):
            modes_by_place.setdefault(place, []).append(int(mode))
        least_value = jacobian["least_singular_value"]
        if nearest is None or least_value < nearest["least_singular_value"]:
            nearest = jacobian
            nearest_mode = mode

    lines = []
    if has_one_freedom:
        lines.append(
            f"The {output} turns about one axis, so the {input_count} inputs can move in "
            "every configuration while it rests (singular of type I everywhere)."
        )
    if modes_singular_everywhere:
        verb = "is" if len(modes_singular_everywhere) == 1 else "are"
        lines.append(
            f"{modes_text(modes_singular_everywhere, True)} {verb} {singular} {extent} "
            "everywhere."
        )
    if modes_by_place:
        texts = [
            f"{modes_text(modes)} near {place}" for place, modes in modes_by_place.items()
        ]
        more = ""
        if unlisted_place_count:
            more = f", and at {counted(unlisted_place_count, 'further place')}"
        lines.append(f"{singularities} are met {extent}: {'; '.join(texts)}{more}.")
    elif nearest is not None:
        least_value = nearest["least_singular_value"]
        if modes_singular_everywhere:
            beginning = "Other modes have none"
        elif least_value <= NEAR_SHARE * nearest["largest_least_singular_value"]:
            beginning = f"A {singularity} is nearly met"
        else:
            beginning = f"No {singularity} is met"
            if has_one_freedom:
                beginning = f"At least one input always moves the {output}"
        end = ""
        if "simulation" not in summary:
            quantity = "velocity ratio"
            if has_several_inputs:
                quantity = "smallest singular value of the velocity Jacobian"
            comparison = "the closest configuration is"
            if has_one_freedom:
                quantity = "root of the sum of the squared velocity ratios"
                comparison = "the ratios are smallest"
            place = inputs_text(summary, nearest["inputs_rad"])
            end = (
                f"; {comparison} in mode {nearest_mode} at {place}, where "
                f"the {quantity} is {number_text(least_value, RATIO_ERROR, 2)}"
            )
        lines.append(f"{beginning} {extent}{end}.")
    return lines
