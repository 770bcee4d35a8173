"""Formulas as Python that makes functions of CasADi, of its symbols `SX`.

CasADi differentiates the functions and generates code from them.
"""

from collections.abc import Iterator

from spherekit.escaping import json_text, python_comment
from spherekit.exchange import identifiers
from spherekit.exchange.python_constants import KNOWN_INPUTS_TEXT, write_constants
from spherekit.exchange.script_parts import (
    join_items,
    join_parts,
    smooth_mode_texts,
    write_series,
)
from spherekit.exchange.source_language import Language, operation_formats
from spherekit.exchange.source_printer import FormulaSource, SourceFunction

CASADI = Language(
    name="Python",
    operation_formats=operation_formats(
        "ca.",
        {
            "sign": "ca.sign({0})",
            "maximum": "ca.fmax({0}, {1})",
            "**": "{0} ** {1}",
        },
    ),
    assignment_format="    {0} = {1}",
    table_format="    table_{k} = _table_{k}({argument})",
    comment_prefix="# ",
    escape_comment=python_comment,
    name_rules=identifiers.CASADI_NAME_RULES,
    helper_by_operation={},
    nan_literal='float("nan")',
)

CASADI_SERIES_TEMPLATE = """
_EDGES_{k} = {edges}
_COEFFICIENTS_{k} = {coefficients}


def _table_{k}(s):
{around}    inner = _EDGES_{k}[1:-1]
    low, high = (ca.pw_const(s, inner, ends) for ends in (_EDGES_{k}[:-1], _EDGES_{k}[1:]))
    x = ((s - low) + (s - high)) / (high - low)
    columns = []
    for column in zip(*_COEFFICIENTS_{k}, strict=True):
        orders = zip(*column, strict=True)
        first, *others = (ca.pw_const(s, inner, ca.DM(order)) for order in orders)
        total, before = 0.0, 0.0
        for series in reversed(others):
            total, before = series + 2.0 * x * total - before, total
        columns.append(first + x * total - before)
    return columns

"""
"""Template of the function that evaluates a stored series, by Clenshaw's recurrence."""

CASADI_CLOSED_SERIES_TEMPLATE = "    s = s - ca.floor((s - {low}) / {length}) * {length}\n"
"""Line that moves the variable of a closed curve into its period."""

CASADI_OPEN_SERIES_TEMPLATE = (
    '    s = ca.if_else((s >= {low}) * (s <= {high}), s, float("nan"))\n'
)
"""Line that makes the variable NaN outside of an open curve."""

CASADI_SMOOTH_MODE_TEMPLATE = """
def {name}(number, q):
    \"\"\"Return the {mode} of an assembly mode at an input q (rad){more}.\"\"\"
    mode = list(MODES).index(number)
    starts = {starts}
    places = {places}
{inputs}{moved}    {mode}_there = ca.DM(places[0][mode])
    {first_input}for interval in range(1, {intervals}):
        is_beyond = q >= starts[interval]
        {mode}_there = ca.if_else(
            is_beyond, ca.DM(places[interval][mode]), {mode}_there
        )
{next_input}    return {returned}
"""
"""Template of the function that selects a mode on its smooth curve.

Its array ``places`` has the values that select a mode in the formulas, such as the signs of
its dyads, by interval and mode.
"""

CASADI_MOVED_INPUT_TEMPLATE = """\
    above = q - ca.floor((q - {low}) / {period}) * {period}
    is_nearer_below = above - {high} > {low} - above + {period}
    above = ca.if_else(is_nearer_below, above - {period}, above)
    q = ca.if_else((q >= {low}) * (q <= {high}), q, above)
"""
"""Template of the lines that move an input outside of the range by whole periods."""


def write_casadi(source: FormulaSource) -> str:
    """Return the source code of Python functions that each return a CasADi function."""
    parts = [
        write_constants(source, "casadi as ca"),
        *write_series(
            source,
            CASADI_SERIES_TEMPLATE,
            CASADI_CLOSED_SERIES_TEMPLATE,
            CASADI_OPEN_SERIES_TEMPLATE,
        ),
        *(_write_function(source, function) for function in source.functions),
        *_write_smooth_modes(source),
    ]
    return join_parts(source, parts)


def _write_function(source: FormulaSource, function: SourceFunction) -> str:
    """Return the text of a Python function that constructs a function of CasADi.

    The text first defines symbols for the arguments, then computes with them line by line,
    and ends with ``ca.Function``. The CasADi function computes the results of the
    mechanism, or makes a step of Newton's method. A step returns the improved pair
    variables (joint angles) and the closure residual (how far loops are open).
    """
    formulas = source.formulas
    # The three arguments are vectors: inputs and their rates (`motion`), the values that
    # select an assembly mode (way to assemble the links), and numbers of the mechanism file
    # (`size`). A mode is selected by signs of groups of two links, or by pair variables.
    lengths = (len(formulas.motion), len(formulas.mode_value_names), len(formulas.sizes))
    symbol_lines = [
        f'    {argument} = ca.SX.sym("{argument}", {length})'
        for argument, length in zip(source.arguments, lengths, strict=True)
    ]
    argument_names = json_text([*source.arguments])
    # Only a step of Newton's method has a closure residual.
    residual = f", {function.closure_residual}" if function.closure_residual else ""
    # Names of the results: the variables after the step and how far loops are open, or the
    # results of the formulas.
    result_names = '["after", "open"]' if residual else '["result"]'
    results = join_items(function.results, indent=8)
    lines = [
        *symbol_lines,
        *function.lines,
        f"    values = ca.vertcat(\n        {results}\n    )",
        f"    given = [{', '.join(source.arguments)}]",
        f'    return ca.Function("{function.name}", given, [values{residual}], '
        f"{argument_names}, {result_names})",
    ]
    body = "\n".join(lines)
    docstring = f'    """Return the function of {", ".join(source.arguments)}."""'
    return f"\ndef {function.name}():\n{docstring}\n{body}\n"


def _write_smooth_modes(source: FormulaSource) -> Iterator[str]:
    """Yield the text of the function that selects an assembly mode, if there is one.

    An assembly mode is selected in the formulas by numbers, the mode values. In closed form
    they are the sign (+1 or -1) of each dyad (two links and three R pairs). Configuration
    curves of modes may cross. A mode that follows its smooth curve through a crossing has
    other mode values beyond the crossing. The crossings divide the range of the input q
    into intervals. The written function looks up the mode values in the interval of q::

        def four_bar_smooth_mode(number, q):
            mode = list(MODES).index(number)
            starts = [-inf, 3.14]       # of the intervals
            places = [...]              # mode values, by interval and mode
            mode_there = ca.DM(places[0][mode])
            for interval in range(1, 2):
                is_beyond = q >= starts[interval]
                mode_there = ca.if_else(is_beyond, ..., mode_there)
            return mode_there

    Without closed form, the mode values are the variables (rad) of all pairs in a known
    configuration, from which steps of Newton's method (`formulas.step`) lead to the input.
    The written function then also returns the input of the known configuration.
    """
    if source.smooth_modes is None:
        return
    texts = smooth_mode_texts(
        source,
        nan_literal='float("nan")',
        infinity_literal='float("inf")',
        # Lines that shift q into the range of the input by whole periods.
        moved_template=CASADI_MOVED_INPUT_TEMPLATE,
    )
    # Parts of the text about the input of the known configuration: the array of inputs, the
    # end of the docstring, the line before the loop over the intervals, and the lines in
    # it. All parts are empty in closed form.
    input_lines = ""
    docstring_end = ""
    first_input = ""
    next_input = ""
    # In the written function, the numbers at the input q have a name such as `mode_there`.
    returned = f"{source.mode_argument}_there"
    if source.formulas.step:
        input_lines = f"    inputs = {texts.known_inputs}\n"
        # The text speaks of several inputs. The written function takes a single input.
        docstring_end = KNOWN_INPUTS_TEXT.replace("inputs", "the input")
        first_input = "known_input = ca.DM(inputs[0][mode])\n    "
        next_input = (
            "        known_input = ca.if_else(\n"
            "            is_beyond, inputs[interval][mode], known_input\n        )\n"
        )
        returned += ", known_input"
    yield CASADI_SMOOTH_MODE_TEMPLATE.format(
        **source.smooth_mode_fields,
        starts=texts.interval_starts,
        places=texts.mode_values,
        inputs=input_lines,
        moved=texts.shift_lines,  # lines that move an input into the range by whole periods
        returned=returned,
        more=docstring_end,
        first_input=first_input,
        next_input=next_input,
    )
