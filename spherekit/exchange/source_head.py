"""The comment at the head of a source: what it computes, its arguments and its modes."""

from collections.abc import Iterable, Iterator
from textwrap import wrap

import numpy as np

from spherekit.escaping import one_line
from spherekit.exchange.formula_expressions import Formulas, Mode
from spherekit.exchange.mode_table import UNKNOWN_AT_CROSSING_RAD
from spherekit.exchange.source_printer import FormulaSource
from spherekit.exchange.source_text import LINE_WIDTH
from spherekit.version import __version__
from spherekit.wording import counted, listing

OTHER_CROSSINGS = (
    "Curves may also cross at inputs that are not known: crossings are found with dyads, "
    "triads and trains of wheels only"
)
"""Sentence on mechanisms of which not all crossings may be known."""


def head_comment(source: FormulaSource) -> str:
    """Return the head of a source as a comment of its language."""
    language = source.language
    comment = ""
    for line in _head_lines(source):
        comment_line = language.comment_prefix + language.escape_comment(line)
        comment += comment_line.rstrip() + "\n"
    return comment


def _head_lines(source: FormulaSource) -> Iterator[str]:
    """Yield the lines of the comment at the head of an exported source file.

    The lines have no marks of a comment (such as //). The lines state in turn

    - the title, and names that were changed because the language does not allow them;
    - how positions are computed;
    - how modes continue where curves of configurations cross, if they continue smoothly;
    - what is in the arrays of arguments and results;
    - the assembly modes (ways to assemble the mechanism);
    - how well the formulas agree with the mechanism.
    """
    formulas = source.formulas
    mechanism = formulas.mechanism
    title = f"{mechanism.name}: {formulas.title}, made by spherekit {__version__}."
    yield from wrap(title, LINE_WIDTH)
    if mechanism.source:
        yield from wrap(one_line(mechanism.source.citation), LINE_WIDTH)
    for sentence in _renaming_sentences(source):
        yield from wrap(sentence, LINE_WIDTH)
    yield ""
    yield from wrap(_method_sentences(source), LINE_WIDTH)
    # Sentences on modes that continue smoothly where curves of configurations cross.
    if source.smooth_modes is not None:
        yield from wrap(_smooth_mode_sentences(source), LINE_WIDTH)
    yield from _argument_lines(source)
    yield ""
    yield "assembly modes, each with the argument that selects it:"
    for position, mode in enumerate(formulas.modes):
        yield from _mode_lines(source, position, mode)
    for reason, names in formulas.mode_table.left_out_by_reason().items():
        text = f"  not written: {', '.join(names)}: {reason}"
        yield from wrap(text, LINE_WIDTH, subsequent_indent="    ")
    # The number of inputs at which the formulas were compared with the mechanism.
    compared_inputs = formulas.mode_table.compared
    if compared_inputs > 0:
        yield from wrap(_comparison_sentences(source), LINE_WIDTH)


def _argument_lines(source: FormulaSource) -> Iterator[str]:
    """Yield a list of the elements of each argument and of the result, with units.

    The lines are a part of the comment at the head of an exported source file. The
    arguments are arrays: the motion (inputs, rates, ...), the mode values, and the sizes
    (numbers of the mechanism file). Mode values select the assembly mode (way to assemble
    the mechanism). In closed form mode values are the signs of the dyads (two links and
    three R pairs). Otherwise mode values are the pair variables from which Newton's method
    starts.
    """
    formulas = source.formulas
    # `step` has the expressions of a step of Newton's method. It is empty in closed form.
    if formulas.step:
        mode_notes = ["rad"] * len(formulas.mode_value_names)
    else:
        # There is one sign for each dyad. The note names the middle pair of the dyad.
        mode_notes = [_sign_note(formulas, pair) for pair in formulas.middle_pairs]
    notes_by_array = {
        "motion": [(argument.name, argument.unit) for argument in formulas.motion],
        source.mode_argument: [*zip(formulas.mode_value_names, mode_notes, strict=True)],
        # Each size with its key and its value in the mechanism file.
        "size": [
            (size.name, f"{size.unit}; {size.key} = {size.value:.12g}")
            for size in formulas.sizes
        ],
        "result": [*formulas.results.items()],
    }
    for array_name, elements in notes_by_array.items():
        yield ""
        yield f"{array_name}:" if elements else f"{array_name}: none"
        for index, (name, note) in enumerate(elements, source.language.first_index):
            yield f"  [{index}] {name} ({note})" if note else f"  [{index}] {name}"


def _sign_note(formulas: Formulas, middle_pair: str) -> str:
    """Return what the sign of a dyad means; the dyad is named by its middle pair."""
    if middle_pair in formulas.mechanism.pair_number:
        return f"+1 or -1: the side of the dyad with the middle pair {middle_pair}"
    return "+1 or -1: the side of a dyad that replaces a contact"


def _mode_lines(source: FormulaSource, position: int, mode: Mode) -> Iterator[str]:
    """Yield the lines on an assembly mode, for the head of an exported source file.

    The lines state the number, name, mode values and inputs of the mode. Mode values are
    the numbers that select the mode (way to assemble the mechanism): the signs of its dyads
    (two links and three R pairs), or the pair variables (rad) from which Newton's method
    starts. The inputs are those of one known configuration with these values.

    Over the input, the configurations of a mode form a curve. This curve can cross the
    curve of another mode. If the modes continue smoothly (`source.smooth_modes`), a mode
    has other mode values beyond a crossing. The crossings divide the curve into pieces.
    Each piece has a further line, with its first input, its mode values, and the input of a
    known configuration.

    Parameters
    ----------
    source
        The source code that is written, with its formulas and modes.
    position
        Position of the mode in the table of modes.
    mode
        The mode.
    """
    argument_text = _mode_argument_text(source, mode.values)
    input_text = ", ".join(f"{q:.6g}" for q in mode.at)
    title = f"{mode.number} ({mode.name})" if mode.name else f"{mode.number}"
    yield f"  {title}: {argument_text}, exists for example at {input_text} rad"
    if source.smooth_modes is None:
        return
    pieces = source.smooth_modes.pieces(position)
    if len(pieces) < 2:  # The mode has the same values everywhere.
        return
    for piece in pieces:
        argument_text = _mode_argument_text(source, piece.mode_values)
        yield (
            f"    from {piece.start:.6g} rad on: {argument_text}, for example at "
            f"{piece.known_input:.6g} rad"
        )


def _mode_argument_text(source: FormulaSource, values: Iterable[float]) -> str:
    """Return the argument with mode values as text, such as ``argument mode = {1, -1}``.

    Mode values are the numbers that select an assembly mode (way to assemble the
    mechanism). They are listed in braces in the comments of all languages.
    """
    value_text = ", ".join(f"{value:.9g}" for value in values)
    if not value_text:  # There is nothing to select.
        return f"argument {source.mode_argument} is empty"
    return f"argument {source.mode_argument} = {{{value_text}}}"


def _method_sentences(source: FormulaSource) -> str:
    """Return the sentences on how positions are computed, for the head of a source.

    Positions are computed in closed form, or by steps of Newton's method. In closed form,
    the signs of the dyads (two links and three R pairs) select an assembly mode (way to
    assemble the mechanism). A sign tells on which side of the dyad its middle pair is.

    Where the three axes of a dyad are in one plane, the mechanism can continue on either
    side. If modes have signs and keep them for all inputs, a sentence warns of this.
    """
    # `step` has the expressions of a step of Newton's method. It is empty in closed form.
    # The function of the step returns the closure residual, by how much loops are open.
    if source.formulas.step:
        return (
            f"{source.name}_step makes one step of Newton's method, which closes the "
            "loops. Start from the variables of a mode below, or from those of the "
            "previous sample. Repeat the step until the returned value is small: it is "
            "the rotation (rad) by which loops were open before the step."
        )
    method = (
        "No iteration is needed; results are NaN at inputs at which the mode cannot be "
        "assembled."
    )
    # `smooth` has the mode values by intervals of the input, or is None if modes keep their
    # signs for all inputs. In closed form the mode values are the signs, so
    # `mode_value_names` is empty if there are no dyads.
    keeps_signs = source.formulas.mode_table.smooth is None
    if not keeps_signs or not source.formulas.mode_value_names:
        return method
    return method + (
        " A mode is one side of each dyad. At a change point, an input at which the "
        "arcs of a dyad are in one plane, a motion without a jump may continue on the "
        "other side."
    )


def _smooth_mode_sentences(source: FormulaSource) -> str:
    """Return the sentences on modes that follow smooth curves, for the head of a source.

    An assembly mode is a way to assemble the mechanism. At a crossing, curves of
    configurations of different modes meet, as at the change point of a four-bar. The
    sentences say where curves cross, and whether all crossings are known. They also say how
    the generated source stays on one curve:

    - In closed form, it changes the signs of the dyads (two links and three R pairs). The
      sign of a dyad tells on which side its middle pair is.
    - Otherwise, it starts Newton's method from a known configuration. This configuration is
      chosen so that no crossing is between its input and the requested one.

    If configurations repeat after a period of the input, a sentence says that inputs
    outside of the range are moved by whole periods.
    """
    smooth_modes = source.smooth_modes
    assert smooth_modes is not None
    range_text = f"between {smooth_modes.low:.6g} and {smooth_modes.high:.6g} rad"
    unknown = "" if smooth_modes.are_all_known else f" {OTHER_CROSSINGS}."
    if not smooth_modes.crossings and smooth_modes.are_all_known:
        return f"A mode is a smooth curve. No curves cross {range_text}."
    if not smooth_modes.crossings:
        return f"A mode is a smooth curve as far as crossings are known.{unknown}"
    # Inputs (rad) of the crossings. An input such as 1e-17 is a rounding error of 0, so
    # inputs are rounded to 12 decimals. Adding zero turns -0.0 into 0.0.
    rounded_inputs = np.round(smooth_modes.crossings, 12)
    crossings = listing(f"{q + 0.0:.6g}" for q in rounded_inputs)
    # `step` has the expressions of a step of Newton's method. It is empty in closed form.
    if source.formulas.step:
        use = (
            f"{source.smooth_function} gives a start for Newton's method: variables of a "
            "mode, and the input at which it has them. No crossing is between this input "
            "and yours, so Newton's method cannot change to the other curve there."
        )
    else:
        use = (
            f"{source.smooth_function} gives the sides of the dyads of a mode at an input. "
            "They can change at crossings, and are then NaN within "
            f"{UNKNOWN_AT_CROSSING_RAD:g} rad of these."
        )
    if np.isfinite(smooth_modes.period):
        use += (
            " An input outside of the range is moved by whole periods into it, or as "
            "near as they lead."
        )
    return (
        f"A mode is a smooth curve. Curves cross {range_text} at {crossings} rad. "
        f"{use}{unknown}"
    )


def _comparison_sentences(source: FormulaSource) -> str:
    """Return the sentences on the comparison of modes before the source was written."""
    table = source.formulas.mode_table
    difference = f"to {table.largest_difference:.1e} rad"
    if source.formulas.step:
        result = (
            f"From variables near a configuration, the steps lead back to it {difference}."
        )
    else:
        result = f"All pair variables agree {difference}."
    return (
        "Before this file was written, each mode was compared with the mechanism at "
        f"{counted(table.compared, 'input')} or more. {result}"
    )


def _renaming_sentences(source: FormulaSource) -> Iterator[str]:
    """Yield the sentences on names that the language does not allow."""
    name = source.formulas.mechanism.name
    if source.name != name:
        yield (
            f"The mechanism {name} is called {source.name} here, because the name is "
            f"not allowed in {source.language.name}, or is used by it, its libraries or "
            "this source."
        )
    for result, result_name in zip(
        source.formulas.results, source.result_names, strict=True
    ):
        if result_name != result:
            yield f"The result {result} is called {result_name} here."
