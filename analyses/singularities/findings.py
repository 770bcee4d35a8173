"""Sentences about the singularities of a mechanism with one input."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from spherekit.plugin import Floats, Status, numbered
from spherekit.plugin.rotations import wrap
from spherekit.plugin.singularities import (
    NEAREST_TRANSMISSION_WORD,
    NearMiss,
    SampledSingularities,
    least_transmission,
)

from .scenes import SELF_MOTION

MAX_LISTED_INPUTS = 6
"""Largest number of inputs that are listed for one kind of singularity. For further
inputs only their number is stated."""
OUTPUT_SAMPLES_PER_CURVE = 721
"""Points of a curve among which the extremes of an output are searched. Larger: extremes
between singularities are more accurate."""
FULL_TURN_DEG = 355.0
"""An output that turned by more between the sampled points of a curve turns fully. The
number is smaller than 360, because the last sample is before the end of the curve."""
MEANING_OF_KIND = {
    "I": "The output {output} comes to rest (type I)",
    "II": "The locked input does not hold output {output} (type II)",
    SELF_MOTION: (
        "The output {output} rests with the input while other links move (self-motion)"
    ),
    "III": "Curves of configurations cross (type III of output {output})",
}
"""What each kind of singularity means for an output, in the order of the sentences."""


def describe_inputs_of_kinds(
    points: Mapping[str, Any], output: str, output_in_words: str, input_pair: str
) -> list[str]:
    """Return a sentence for each kind of singularity of an output within the input's range.

    A sentence lists the inputs at which the kind occurs, grouped by assembly modes (ways to
    assemble the links). Some singular configurations belong to none of the computed modes,
    which the sentence says. A further sentence says if the kind occurs on a whole curve of
    configurations.

    Parameters
    ----------
    points
        The table of singularities, by column. ``q`` is the input (rad), NaN if the
        singularity occurs on a whole curve. ``inside`` is "yes" within the input's range.
    output
        The name of the output in this table.
    output_in_words
        The name of the output in sentences.
    input_pair
        Name of the driven pair (joint).
    """
    sentences = []
    is_shown = (points["output"] == output) & (points["inside"] == "yes")
    has_input = np.isfinite(points["q"])
    for kind, meaning in MEANING_OF_KIND.items():
        is_of_kind = is_shown & (points["kind"] == kind)
        sentence = meaning.format(output=output_in_words)
        if np.any(is_of_kind & ~has_input):
            sentences.append(
                f"Throughout a configuration curve, {sentence[0].lower()}{sentence[1:]}"
            )
        rows = is_of_kind & has_input
        if np.any(rows):
            parts = []
            inputs_by_modes = _group_by_modes(
                np.degrees(points["q"][rows]), points["assembly_mode"][rows]
            )
            for modes, inputs in inputs_by_modes.items():
                in_modes = f" in {modes}" if modes else " in no computed mode"
                parts.append(f"{_list_angles(inputs)} deg{in_modes}")
            sentences.append(f"{sentence} at {input_pair} = {'; '.join(parts)}")
    return sentences


def _group_by_modes(inputs_deg: Floats, modes: Iterable[str]) -> dict[str, list[str]]:
    """Return formatted inputs (deg) by the assembly modes in which they occur.

    An assembly mode is one way to assemble the links. Inputs that occur in the same modes
    are listed together, in one part of a sentence.

    Parameters
    ----------
    inputs_deg
        (n,) inputs of singularities (deg).
    modes
        For each singularity a text with the numbers of its assembly modes, such as "0+1".

    Returns
    -------
    The formatted inputs by texts such as "modes 0, 1". The text is empty for inputs in no
    computed mode.
    """
    # The keys are formatted inputs, so inputs that are equal when printed are one item.
    modes_of_input: dict[str, set[int]] = {}
    for value, joined_modes in sorted(zip(inputs_deg.tolist(), modes, strict=True)):
        numbers = modes_of_input.setdefault(_format_degrees(value), set())
        numbers.update(_split_modes([joined_modes]))
    # The reverse mapping: inputs by their modes in words.
    inputs_by_modes: dict[str, list[str]] = {}
    for formatted_input, numbers in modes_of_input.items():
        modes_in_words = numbered("mode", sorted(numbers)) if numbers else ""
        inputs_by_modes.setdefault(modes_in_words, []).append(formatted_input)
    return inputs_by_modes


def _split_modes(modes: Iterable[str]) -> set[int]:
    """Return the numbers of assembly modes in texts such as ``0+2``."""
    return {int(number) for number in "+".join(modes).split("+") if number}


def _list_angles(angles: list[str]) -> str:
    """Return a list of formatted angles; long lists end with the number of the others."""
    omitted = len(angles) - MAX_LISTED_INPUTS
    listed = ", ".join(angles[:MAX_LISTED_INPUTS])
    return f"{listed} and {omitted} more" if omitted > 0 else listed


def _format_degrees(value: float) -> str:
    """Return an angle (deg) as text; an angle that is zero up to rounding as 0."""
    return f"{round(value, 6) + 0.0:.6g}"


def describe_output_ranges(sampled: SampledSingularities, names: list[str]) -> list[str]:
    """Return sentences about the rotation of each output on the configuration curves.

    A configuration curve consists of all configurations that one continuous motion passes.
    Curves with the same sentence are listed together, with their assembly modes (ways to
    assemble the links).

    Parameters
    ----------
    sampled
        The singularities on all curves.
    names
        The name of each output in sentences.
    """
    curves_by_sentence: dict[str, list[int]] = {}
    curve_count = len(sampled.curves)
    for number in range(curve_count):
        for output, name in enumerate(names):
            sentence = (
                f"The output {name} {_describe_output_range(sampled, number, output)}"
            )
            curves_by_sentence.setdefault(sentence, []).append(number)
    sentences = []
    for sentence, curves in curves_by_sentence.items():
        # A sentence that does not apply to all curves names its curves.
        if len(curves) != curve_count:
            sentence += f" on {numbered('configuration curve', curves)}"
            # A curve can pass through several assembly modes. It is divided into pieces, on
            # which the input only rises or only falls. Each piece belongs to one mode.
            pieces = [
                piece
                for number in curves
                for piece in sampled.configurations.curves[number].pieces
            ]
            modes = sorted(set(sampled.modes_of(pieces)))
            if modes:
                sentence += f" ({numbered('assembly mode', modes)})"
        sentences.append(sentence)
    # A remark is needed if the range of the input ends before a whole revolution. In a
    # simulation (motion caused by loads), `range` is not a limit, but the part that the
    # motion has passed.
    low, high = sampled.range
    is_limited = high - low < 2.0 * np.pi - 1e-9
    if is_limited and not sampled.is_simulation:
        sentences.append(
            "These rotations are those on whole configuration curves, also outside the "
            "range of the input"
        )
    return sentences


def _describe_output_range(sampled: SampledSingularities, number: int, output: int) -> str:
    """Return a description of an output's rotation on a configuration curve.

    The text is a verb phrase: the output rests, turns fully, turns in one sense, or swings.
    An output swings if it turns back, or if the curve ends before a full turn.

    Parameters
    ----------
    sampled
        The singularities on all curves.
    number, output
        Index of the curve, and position of the output.
    """
    # 1. The angle of the output at samples of the curve, which include all singularities.
    curve = sampled.curves[number]
    links = sampled.report.outputs[output]
    points = [
        point
        for point in sampled.report.points
        if (point.curve, point.output) == (number, links)
    ]
    # The samples include all singularities of type I, where the output reaches its
    # extremes. The last sample is just before the end, which is the start of a closed
    # curve.
    s = np.linspace(0.0, curve.length * (1.0 - 1e-12), OUTPUT_SAMPLES_PER_CURVE)
    s = np.unique(np.append(s, [point.s for point in points]))
    angle_on_curve = sampled.output_angle(number, output, s)
    angle = angle_on_curve
    # Without a pair between the two links, the angle is the rotation about the pole axis
    # since the start. With a pair, it is the variable of the pair, or its negative.
    crossing_values = [values for _, values in sampled.crossing_ends(number)]
    variable_count = curve.nodes.values.shape[1]
    crossing_angles = sampled.pair_angle(
        output, np.reshape(crossing_values, (-1, variable_count))
    )
    has_pair = crossing_angles is not None
    if crossing_angles is not None:
        angle = np.append(angle_on_curve, crossing_angles)
        # The start of the curve is in (-pi, pi].
        angle = angle - angle_on_curve[0] + wrap(angle_on_curve[0])

    # 2. The kind of rotation, in words.
    low, high = np.degrees([np.min(angle), np.max(angle)])
    swing = _format_degrees(high - low)
    reverses = any(point.output_turns for point in points)
    # An open curve with an end of status OK was not followed further, because it had
    # reached the greatest length.
    is_unfinished = not curve.closed and Status.OK in curve.ends
    if swing == "0":
        return "rests" + (f" at {_format_degrees(high)} deg" if has_pair else "")

    input_variable = sampled.position_analysis.solver.input_variable
    input_ends = curve.at(s[[0, -1]]).values[:, input_variable]
    input_revolutions = np.ptp(input_ends) / (2.0 * np.pi)
    if is_unfinished and input_revolutions > 1.0 and not reverses:
        angle_per_revolution = np.degrees(np.ptp(angle_on_curve)) / input_revolutions
        return (
            f"turns in one sense, by {_format_degrees(angle_per_revolution)} deg in a turn "
            "of the input"
        )
    limitation = ", as far as the curve was followed" if is_unfinished else ""
    if not has_pair:
        to_and_fro = "to and fro " if reverses else ""
        return f"turns {to_and_fro}by {swing} deg about its moving pole axis{limitation}"
    net_angle = abs(angle_on_curve[-1] - angle_on_curve[0])
    if net_angle > np.pi and high - low > FULL_TURN_DEG:
        return "turns fully"
    if is_unfinished and not reverses:
        return f"turns in one sense, by {swing} deg{limitation}"
    return (
        f"swings {swing} deg, from {_format_degrees(low)} to {_format_degrees(high)} deg"
        f"{limitation}"
    )


def describe_accuracy(points: Mapping[str, Any]) -> list[str]:
    """Return a sentence about the accuracy of the listed singularities.

    The list is empty if no singularity has an error bound.

    Parameters
    ----------
    points
        The table of singularities. Its column `error` has bounds of the error of the arc
        length (rad).
    """
    errors = np.asarray(points["error"], dtype=float)
    errors = errors[np.isfinite(errors)]
    if len(errors) == 0:
        return []
    # The largest bound is rounded up to one digit.
    bound = np.max(errors)
    unit = 10.0 ** np.floor(np.log10(bound)) if bound > 0.0 else 1.0
    return [
        "Error bound of the places of these singularities: "
        f"{np.ceil(bound / unit) * unit:.0e} rad along the configuration curve"
    ]


def describe_least_transmission(
    sampled: SampledSingularities, names: list[str], input_pair: str
) -> list[str]:
    """Return a sentence about the smallest transmission angle of each output.

    A dyad is two links joined by a pair (joint), each an arc on the sphere. If a dyad moves
    the output, its transmission angle is the acute angle between the planes of both arcs.
    At 0 there is a singularity of type II: the output can move while the input is locked.
    Outputs without a dyad have no sentence.

    Parameters
    ----------
    sampled
        The singularities on all curves of configurations.
    names
        The name of each output in sentences.
    input_pair
        Name of the driven pair.
    """
    sentences = []
    for output, name in enumerate(names):
        nearest = least_transmission(sampled, output)
        if nearest is None:
            continue
        angle, q, modes = nearest
        # The word is "least".
        beginning = NEAREST_TRANSMISSION_WORD.capitalize()
        sentences.append(
            f"{beginning} transmission angle of {name}: "
            f"{np.degrees(angle):.4g} deg at "
            f"{input_pair} = {_format_degrees(np.degrees(q))} deg in "
            f"{numbered('mode', modes)}"
        )
    return sentences


def warn_of_near_misses(
    misses: Sequence[NearMiss],
    points: Mapping[str, Any],
    names: Sequence[str],
    names_in_words: Sequence[str],
    near_deg: float,
    input_pair: str,
) -> list[str]:
    """Return warnings of outputs that come near a singularity without reaching it.

    There is at most one warning for each output and type. At type I the output rests while
    the input moves. At type II the output can move while the input is locked. Assembly
    modes (ways to assemble the links) that reach a singularity of the same type elsewhere
    in the range need no warning.

    Parameters
    ----------
    misses
        Configurations that are near a singularity (near misses).
    points
        The table of singularities, by column.
    names, names_in_words
        The name of each output in the table of singularities, and in sentences.
    near_deg
        The angle (deg) within which a configuration counts as near. Each warning states
        it. `NearMiss.angle` describes the angle.
    input_pair
        Name of the driven pair.
    """
    warnings = []
    # All combinations of type and output, in the order of the near misses.
    for kind, output in dict.fromkeys((miss.type, miss.output) for miss in misses):
        name = names[output]
        modes_with_singularity = _modes_with_singularity(points, kind, name)
        # Near misses of this type and output, each with the modes that remain.
        remaining: list[tuple[NearMiss, set[int]]] = []
        for miss in misses:
            modes = set(miss.assembly_modes) - modes_with_singularity
            if (miss.type, miss.output) == (kind, output) and modes:
                remaining.append((miss, modes))
        if not remaining:
            continue
        nearest, modes_of_nearest = min(remaining, key=lambda entry: entry[0].angle)
        all_modes = sorted(set().union(*(modes for _, modes in remaining)))
        verb = "comes" if len(all_modes) == 1 else "come"
        warnings.append(
            f"Assembly {numbered('mode', all_modes)} of output {names_in_words[output]} "
            f"{verb} within {near_deg:g} deg of type {kind} without "
            f"meeting it, nearest {np.degrees(nearest.angle):.3g} deg in "
            f"{numbered('mode', sorted(modes_of_nearest))} at {input_pair} = "
            f"{_format_degrees(np.degrees(nearest.q))} deg, velocity coefficient "
            f"{nearest.velocity_coefficient:.3g}"
        )
    return warnings


def _modes_with_singularity(points: Mapping[str, Any], kind: str, output: str) -> set[int]:
    """Return the modes in which an output has a kind of singularity in the input range.

    Parameters
    ----------
    points
        The table of singularities, by column.
    kind, output
        The kind and the output, as they are named in this table.
    """
    is_of_output = (points["kind"] == kind) & (points["output"] == output)
    is_inside = points["inside"] == "yes"
    return _split_modes(points["assembly_mode"][is_of_output & is_inside])
