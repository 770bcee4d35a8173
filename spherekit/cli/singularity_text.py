"""Sentences on how near the samples of a run come to singularities of types I and II.

An output loses a direction of motion at a singularity of type I. At one of type II the
locked inputs do not hold the output.
"""

import math
from typing import Any

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
    """Return sentences on how near the samples come to singularities of both types.

    The table of outputs has the singularities of one input and outputs with a fixed axis.
    The sentences are about all others: of several inputs, of outputs without a fixed axis,
    and of simulations.

    Parameters
    ----------
    summary
        The content of ``summary.json``.
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
            text = (
                f"angle at pair {transmission['pair']} is "
                f"{transmission_text(transmission['angle_rad'])} deg"
            )
            candidates = [(angle, text, transmission["inputs_rad"], 90.0)]
        for value, text, inputs, best in candidates:
            if nearest is None or value < nearest[0]:
                nearest = (value, number, text, inputs, best)
    lines = []
    if met:
        lines.append(f"Samples of {modes_text(met)} are at singularities of {meaning}.")
    if ended:
        lines.append(
            f"{modes_text(ended, True)} {'ends' if len(ended) == 1 else 'end'} {extent}, "
            f"at singularities of {meaning}."
        )
    place = ""
    if nearest is not None:
        _, number, text, inputs, _ = nearest
        place = (
            f"nearest to one is mode {number} at {inputs_text(summary, inputs)}, where "
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
        texts = [inputs_text(summary, inputs) for inputs in jacobian["type_1_inputs_rad"]]
        if jacobian["least_singular_value"] <= RATIO_ERROR:
            texts.append(inputs_text(summary, jacobian["inputs_rad"]))
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
            f"{modes_text(always, True)} {'is' if len(always) == 1 else 'are'} singular "
            f"of {meaning} {extent} everywhere."
        )
    if places:
        texts = [f"{modes_text(modes)} near {text}" for text, modes in places.items()]
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
                f"{inputs_text(summary, inputs)}, where the {quantity} is "
                f"{number_text(value, RATIO_ERROR, 2)}."
            )
    return lines
