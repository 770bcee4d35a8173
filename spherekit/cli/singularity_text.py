"""Sentences on how near the samples of a run come to singularities of types I and II.

An output loses a direction of motion at a singularity of type I. At a singularity of type
II the locked inputs do not hold the output.
"""

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from spherekit.cli.mode_text import modes_text
from spherekit.cli.motion_screen import (
    MEASURE_ERROR,
    RATIO_ERROR,
    inputs_text,
    rests_throughout,
    transmission_text,
)
from spherekit.cli.place_text import MAX_LISTED_PLACES
from spherekit.conventions import Lines
from spherekit.number_text import number_text
from spherekit.wording import counted, listing

NEAR_SHARE = 0.02
"""Share of the largest value up to which the least singular value of a Jacobian, as well as
a transmission measure or angle, counts as nearly 0. Larger: more configurations are called
nearly singular."""

EQUAL_VALUES_SHARE = 1e-6
"""Share of the largest value up to which modes are equally near to a singularity.

Larger: modes are named together although they differ; smaller: rounding errors separate
modes that are mirror images.
"""


def describe_singularities(summary: Any) -> Lines:
    """Return sentences on how near the samples of a run come to singularities.

    At a singularity of type I an output loses a direction of motion. At a singularity of
    type II the locked inputs do not hold the output.

    Other parts of the report describe the singularities of type II of a simulation or of a
    motion with one input. So the sentences describe them only for several prescribed
    inputs.

    Parameters
    ----------
    summary
        The content of ``summary.json``, the file with the main results of the run.
    """
    overview = summary["overview"]
    if not overview["modes"]:
        return []
    # In a simulation the inputs move freely. Otherwise their motion is prescribed.
    is_simulation = "simulation" in summary
    has_several_inputs = len(summary["inputs"]) > 1
    has_several_prescribed_inputs = has_several_inputs and not is_simulation
    has_one_prescribed_input = not has_several_inputs and not is_simulation
    statements = []
    if has_several_prescribed_inputs:
        statements.append(_describe_type_2(summary))
    for number, output in enumerate(overview["outputs"]):
        # With one input, an output with a fixed axis has singularities of type I where it
        # rests. The table of outputs in the report says where, so they are left out here.
        is_in_table = has_one_prescribed_input and output["fixed_axis"]
        if is_in_table:
            continue
        statements.append(_describe_type_1(summary, number))
    lines = [line for statement in statements for line in statement.lines]
    names_places = any(statement.names_singular_places for statement in statements)
    analyses = {analysis["name"] for analysis in summary["analyses"]}
    # The hint after the last sentence suggests the analysis `singularities`. The hint is
    # left out if the run has this analysis.
    has_exact_places = "singularities" in analyses
    if names_places and has_several_prescribed_inputs and not has_exact_places:
        lines[-1] += (
            " These places are estimated from the samples; -a singularities computes "
            "them exactly, and searches between the samples, too."
        )
    return lines


class _Statement(NamedTuple):
    """Sentences on the singularities of one type (I or II) for the report of a run.

    Attributes
    ----------
    lines
        The sentences.
    names_singular_places
        Whether the sentences name places at or near which there are singularities, which an
        analysis would compute more exactly.
    """

    lines: Lines
    names_singular_places: bool


def _extent(summary: Any) -> str:
    """Return where the samples of a run are, in words such as ``on this path``."""
    if "simulation" in summary:
        return "in this motion"
    if not summary["overview"]["is_path"]:
        return "at these samples"
    return "on this path" if len(summary["inputs"]) > 1 else "in this range"


def _sample_extent(summary: Any) -> str:
    """Return words for all samples of a run, such as ``at the samples of this path``.

    They are for statements that hold at the samples and were not tested between them.
    """
    extent = _extent(summary)
    if "simulation" in summary or not summary["overview"]["is_path"]:
        return extent
    path_or_range = extent.split(maxsplit=1)[1]
    return f"at the samples of {path_or_range}"


def _describe_type_2(summary: Any) -> _Statement:
    """Return sentences on singularities of type II of a mechanism with several inputs.

    At such a singularity the locked inputs do not hold the output. The sentences say which
    assembly modes (ways to assemble the mechanism) have samples at a singularity, or end at
    a singularity. If there are no such modes, the sentences name the sample nearest to a
    singularity. It has the least transmission measure or transmission angle, which is 0 at
    a singularity.

    Parameters
    ----------
    summary
        The content of ``summary.json``, the file with the main results of the run.
    """
    overview = summary["overview"]
    meaning = "type II (locked inputs do not hold the output)"
    extent = _extent(summary)  # the end of a sentence, such as "on this path"
    modes_that_end: list[int] = []
    modes_at_singularity: list[int] = []
    nearest_samples: list[_NearestSample] = []
    for number, entry in overview["modes"].items():
        # "closes" has the ranges of samples at which the links can be assembled in this
        # mode. At samples with the status OUT_OF_REACH they cannot. Between both kinds of
        # samples the mode ends where it meets another mode, at a singularity of type II.
        if entry["closes"] and "OUT_OF_REACH" in entry["statuses"]:
            modes_that_end.append(int(number))
        if "AT_SINGULARITY" in entry["statuses"]:
            modes_at_singularity.append(int(number))
        nearest_samples += _list_nearest_samples(int(number), entry)
    lines = []
    is_nearly_met = False
    if modes_at_singularity:
        lines.append(
            f"Samples of {modes_text(modes_at_singularity)} are at singularities of "
            f"{meaning}."
        )
    if modes_that_end:
        subject = modes_text(modes_that_end, begins_sentence=True)
        verb = "ends" if len(modes_that_end) == 1 else "end"
        lines.append(f"{subject} {verb} {extent}, at singularities of {meaning}.")
    if not modes_at_singularity and not modes_that_end:
        beginning = f"No singularity of {meaning} is met"
        nearest_text = ""
        if nearest_samples:
            nearest = min(nearest_samples, key=lambda sample: sample.transmission)
            # The best transmission is the largest possible value: 1, or 90 deg.
            is_nearly_met = nearest.transmission <= NEAR_SHARE * nearest.best_transmission
            if is_nearly_met:
                beginning = f"A singularity of {meaning} is nearly met"
            nearest_text = f"; {_describe_nearest(nearest, nearest_samples, summary)}"
        lines.append(f"{beginning} {_sample_extent(summary)}{nearest_text}.")
    return _Statement(lines, is_nearly_met)


def _describe_nearest(
    nearest: "_NearestSample", nearest_samples: Sequence["_NearestSample"], summary: Any
) -> str:
    """Return in words where the mechanism comes closest to a singularity of type II.

    At such a singularity the locked inputs do not hold the output. The transmission is a
    measure (0 to 1) or an angle (0 to 90 deg) that is 0 at a singularity.

    Parameters
    ----------
    nearest
        The sample with the least transmission.
    nearest_samples
        The nearest samples of all assembly modes. Samples that come equally close are named
        too.
    summary
        The content of ``summary.json``, the file with the main results of the run.
    """
    # The best transmission is the largest possible value: 1 or 90 deg.
    equal_difference = EQUAL_VALUES_SHARE * nearest.best_transmission
    equally_near = [
        (sample.mode, sample.inputs)
        for sample in nearest_samples
        if sample.transmission - nearest.transmission <= equal_difference
    ]
    place_text = _closest_text("closest configuration", summary, equally_near)
    # `measure_text` is, for example, "measure is 0.12".
    return f"{place_text}, where the transmission {nearest.measure_text}"


def _closest_text(
    noun: str, summary: Any, equally_near: Sequence[tuple[int, Sequence[float]]]
) -> str:
    """Return in words which assembly modes come closest to a singularity, and where.

    An assembly mode is one way to assemble the mechanism. Modes with the same inputs are
    listed together, for example "the closest configurations are in modes 0, 1 at input A =
    160 deg".

    Parameters
    ----------
    noun
        The configuration in words, such as "closest configuration".
    summary
        The content of ``summary.json``, the file with the main results of the run.
    equally_near
        For each mode that comes equally close: its number, and the inputs there (rad).
    """
    modes_by_place: dict[str, list[int]] = {}
    for mode, inputs in equally_near:
        numbers = modes_by_place.setdefault(inputs_text(summary, inputs), [])
        if mode not in numbers:
            numbers.append(mode)
    places = [f"{modes_text(modes)} at {place}" for place, modes in modes_by_place.items()]
    # Modes with the same inputs still have different configurations.
    count = sum(len(modes) for modes in modes_by_place.values())
    subject = f"the {noun} is" if count == 1 else f"the {noun}s are"
    # Two places are joined by "and", more places by commas.
    place_text = (
        " and ".join(places) if len(places) == 2 else listing(places, MAX_LISTED_PLACES)
    )
    return f"{subject} in {place_text}"


class _NearestSample(NamedTuple):
    """The sample of one assembly mode that is nearest to a singularity of type II.

    At such a singularity the locked inputs do not hold the output. Nearness is measured by
    the transmission measure (0 to 1) or the transmission angle (0 to 90 deg). Measure and
    angle are 0 at the singularity.

    Attributes
    ----------
    mode
        Number of the assembly mode (way to assemble the mechanism).
    inputs
        Inputs of the sample (rad).
    transmission, best_transmission
        The transmission measure or angle (deg) at this sample, and its best possible value.
    measure_text
        The transmission in words, such as ``angle at pair 3 is 41.2 deg``.
    """

    mode: int
    inputs: Any
    transmission: float
    best_transmission: float
    measure_text: str


def _list_nearest_samples(mode: int, entry: Any) -> Iterator[_NearestSample]:
    """Yield the samples of an assembly mode that are nearest to singularities of type II.

    At such a singularity the locked inputs do not hold the output. Nearness is measured by
    the transmission measure of an output, which is 1 at best and 0 at the singularity. One
    sample is yielded for each output with this measure. If no output has a measure, the
    sample with the least transmission angle of a dyad (two links joined by a pair) is
    yielded.

    Parameters
    ----------
    mode
        Number of the assembly mode (way to assemble the mechanism).
    entry
        The facts of the mode in the overview of the run.
    """
    has_measure = False
    for motion in entry["outputs"]:
        # Both are None if the output has no measure.
        measure = motion["least_transmission_measure"]
        inputs = motion["inputs_of_least_measure_rad"]
        if measure and inputs:
            has_measure = True
            value, _place = measure  # the place of the sample in the run is not used
            number = number_text(value, MEASURE_ERROR, digits=2)
            yield _NearestSample(
                mode,
                inputs,
                transmission=value,
                best_transmission=1.0,
                measure_text=f"measure is {number}",
            )
    transmission = entry["least_transmission"]
    if transmission and not has_measure:
        angle = transmission["angle_rad"]
        text = f"angle at pair {transmission['pair']} is {transmission_text(angle)} deg"
        yield _NearestSample(
            mode,
            transmission["inputs_rad"],
            transmission=math.degrees(angle),
            best_transmission=90.0,
            measure_text=text,
        )


def _describe_type_1(summary: Any, number: int) -> _Statement:
    """Return sentences on configurations in which an output loses a direction of motion.

    These are the singularities of type I. With one input, the output is at rest at such a
    singularity while the input moves.

    Parameters
    ----------
    summary
        The content of ``summary.json``, the file with the main results of a run.
    number
        Index of the output in the summary.
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
    # be singular everywhere or at some places. `jacobians` is for the sentence on the mode
    # that comes nearest to a singularity.
    modes_at_rest: list[int] = []
    modes_singular_everywhere: list[int] = []
    modes_by_place: dict[str, list[int]] = {}
    unlisted_place_count = 0
    jacobians: list[tuple[int, Any]] = []
    for mode, entry in overview["modes"].items():
        motion = entry["outputs"][number]
        jacobian = motion["jacobian"]
        if jacobian is None:
            continue
        if jacobian["largest_least_singular_value"] <= RATIO_ERROR:
            if rests_throughout(motion):
                modes_at_rest.append(int(mode))
            else:
                modes_singular_everywhere.append(int(mode))
            continue
        places = [inputs_text(summary, inputs) for inputs in jacobian["type_1_inputs_rad"]]
        if jacobian["least_singular_value"] <= RATIO_ERROR:
            places.append(inputs_text(summary, jacobian["inputs_rad"]))
        unlisted_place_count += jacobian["further_type_1_places"]
        unlisted_place_count += max(len(places) - MAX_LISTED_PLACES, 0)
        for place in dict.fromkeys(places[:MAX_LISTED_PLACES]):
            modes_by_place.setdefault(place, []).append(int(mode))
        jacobians.append((int(mode), jacobian))

    lines = []
    is_nearly_met = False
    if has_one_freedom:
        lines.append(
            f"The {output} turns about one axis, so the {input_count} inputs can move in "
            "every configuration while it rests (singular of type I everywhere)."
        )
    if modes_at_rest:
        lines.append(
            f"The {output} does not move in {modes_text(modes_at_rest)} (singular of type "
            "I everywhere)."
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
    elif jacobians:
        _, nearest = min(jacobians, key=lambda entry: entry[1]["least_singular_value"])
        least_value = nearest["least_singular_value"]
        largest_value = nearest["largest_least_singular_value"]
        is_nearly_met = least_value <= NEAR_SHARE * largest_value
        if is_nearly_met:
            beginning = f"A {singularity} is nearly met"
        elif modes_singular_everywhere or modes_at_rest:
            beginning = f"The other modes have no {singularity}"
        else:
            beginning = f"No {singularity} is met"
            if has_one_freedom:
                beginning = f"At least one input always moves the {output}"
        end = ""
        if "simulation" not in summary:
            quantity = "the velocity ratio"
            explanation = ""
            if has_several_inputs:
                quantity = "the velocity ratio for the worst combination of input rates"
                explanation = " (smallest singular value of the velocity Jacobian)"
            noun = "closest configuration"
            if has_one_freedom:
                explanation = ""
                quantity = "the root of the sum of the squared velocity ratios"
                noun = "configuration with the smallest ratios"
            equally_near = [
                (mode, jacobian["inputs_rad"])
                for mode, jacobian in jacobians
                if jacobian["least_singular_value"] - least_value
                <= EQUAL_VALUES_SHARE * largest_value
            ]
            end = (
                f"; {_closest_text(noun, summary, equally_near)}, where "
                f"{quantity} is {number_text(least_value, RATIO_ERROR, 2)}{explanation}"
            )
        lines.append(f"{beginning} {_sample_extent(summary)}{end}.")
    return _Statement(lines, is_nearly_met or bool(modes_by_place))
