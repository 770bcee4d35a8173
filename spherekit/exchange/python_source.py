"""Formulas as functions of NumPy arrays."""

from collections.abc import Iterator

from spherekit.escaping import python_comment
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

PYTHON = Language(
    name="Python",
    operation_formats=operation_formats(
        "np.",
        {name: f"np.arc{name[1:]}({{0}})" for name in ("asin", "acos", "atan")}
        | {
            "atan2": "np.arctan2({0}, {1})",
            "sign": "np.sign({0})",
            "maximum": "np.maximum({0}, {1})",
            "**": "np.power({0}, {1})",
        },
    ),
    assignment_format="        {0} = {1}",
    table_format="        table_{k} = _table_{k}({argument})",
    comment_prefix="# ",
    escape_comment=python_comment,
    name_rules=identifiers.PYTHON_NAME_RULES,
    helper_by_operation={},
    nan_literal="np.nan",
)

PYTHON_SERIES_TEMPLATE = """
_EDGES_{k} = np.array(
    {edges}
)
_COEFFICIENTS_{k} = np.array(
    {coefficients}
)


def _table_{k}(s):
    s = np.asarray(s, dtype=float)
{around}    cell = np.searchsorted(_EDGES_{k}[1:-1], s, side="right")
    low, high = s - _EDGES_{k}[cell], s - _EDGES_{k}[cell + 1]
    x = (low + high) / (_EDGES_{k}[cell + 1] - _EDGES_{k}[cell])
    series = np.moveaxis(_COEFFICIENTS_{k}[cell], (-2, -1), (0, 1))
    total, before = 0.0, 0.0
    for n in range({order} - 1, 0, -1):
        total, before = series[:, n] + 2.0 * x * total - before, total
    return series[:, 0] + x * total - before

"""
"""Template of the function that evaluates a stored series, by Clenshaw's recurrence."""

PYTHON_CLOSED_SERIES_TEMPLATE = "    s = s - np.floor((s - {low}) / {length}) * {length}\n"
"""Line that moves the variable of a closed curve into its period."""

PYTHON_OPEN_SERIES_TEMPLATE = "    s = np.where((s >= {low}) & (s <= {high}), s, np.nan)\n"
"""Line that makes the variable NaN outside of an open curve."""

PYTHON_SMOOTH_MODE_TEMPLATE = """
def {name}(number, q):
    \"\"\"Return the {mode} (..., as q) of an assembly mode at inputs q (rad){end}.\"\"\"
    starts = np.array(
        {starts}
    )
    places = np.array(
        {places}
    )
{inputs}    q = np.asarray(q, dtype=float)
{shift_lines}    interval = np.searchsorted(starts[1:], q, side="right")
    mode = list(MODES).index(number)
    {mode}_there = np.moveaxis(places[interval, mode], -1, 0)
    return {returned}
"""
"""Template of the function that selects a mode on its smooth curve.

Its array ``places`` has the values that select a mode, by interval and mode.
"""

PYTHON_MOVED_INPUT_TEMPLATE = """\
    above = q - np.floor((q - {low}) / {period}) * {period}
    above = np.where(above - {high} > {low} - above + {period}, above - {period}, above)
    q = np.where((q >= {low}) & (q <= {high}), q, above)
"""
"""Template of the lines that move an input outside of the range by whole periods."""


def write_python(source: FormulaSource) -> str:
    """Return formulas as functions of NumPy arrays."""
    parts = [
        write_constants(source, "numpy as np"),
        *write_series(
            source,
            PYTHON_SERIES_TEMPLATE,
            PYTHON_CLOSED_SERIES_TEMPLATE,
            PYTHON_OPEN_SERIES_TEMPLATE,
        ),
        *(_write_function(source, function) for function in source.functions),
        *_write_smooth_modes(source),
    ]
    return join_parts(source, parts)


def _write_function(source: FormulaSource, function: SourceFunction) -> str:
    """Return the Python text of one function of an exported file.

    The written function takes three arrays, with these rows:

    - the inputs and rates, in the order of the constant MOTION of the file;
    - the values that select the assembly mode (way to assemble the mechanism);
    - the sizes of links, by default the values of the constant SIZES.

    The further axes of these arrays are samples. The function returns an array with one row
    for each result, in the order of the constant RESULTS.
    """
    returned = "the RESULTS (results, ...)"  # what the docstring says
    residual = ""
    # A function that makes one step of Newton's method returns the pair variables after the
    # step, and the closure residual: how far loops were open before the step.
    if function.closure_residual:
        returned = "variables after a step of Newton's method, and how far loops were open"
        residual = f", {function.closure_residual}"
    results = join_items(function.results, indent=12)
    # A result can be a single number. `broadcast_arrays` in the written function repeats it
    # for each sample.
    arrays = f"np.broadcast_arrays(\n            {results}\n        )"
    return_line = f"        return np.array({arrays}){residual}"
    # `function.lines` compute the results from the rows of the three arrays.
    body = "\n".join([*function.lines, return_line])
    parameters = f"motion, {source.mode_argument}, size=tuple(SIZES.values())"
    return (
        f'\ndef {function.name}({parameters}):\n    """Return {returned}."""\n'
        f'    with np.errstate(all="ignore"):\n{body}\n'
    )


def _write_smooth_modes(source: FormulaSource) -> Iterator[str]:
    """Yield the Python text of the function that selects an assembly mode at an input.

    An assembly mode (way to assemble the mechanism) is selected by a few numbers, the mode
    values. For formulas in closed form they are signs. Other formulas make steps of
    Newton's method from a known configuration, whose pair variables are the mode values.

    A mode can follow a smooth curve of configurations through a crossing with another
    curve. Beyond the crossing its mode values are different. The written function therefore
    has a table of mode values (``places``) by interval of the input q and by mode::

        def fourbar_smooth_mode(number, q):
            starts = np.array([-np.inf, 3.14])  # of the intervals
            places = np.array([...])
            q = np.asarray(q, dtype=float)
            interval = np.searchsorted(starts[1:], q, side="right")
            mode = list(MODES).index(number)
            mode_there = np.moveaxis(places[interval, mode], -1, 0)
            return np.where(np.isnan(q), np.nan, mode_there)

    If configurations repeat after a period of the input, further lines move q by whole
    periods into the range of the input.

    For Newton's method the written function also returns the input of the known
    configuration.

    Nothing is yielded if modes do not follow smooth curves.
    """
    if source.smooth_modes is None:
        return
    texts = smooth_mode_texts(
        source,
        nan_literal="np.nan",
        infinity_literal="np.inf",
        # The lines that move q by whole periods.
        moved_template=PYTHON_MOVED_INPUT_TEMPLATE,
    )
    # The local variable of the written function with the mode values at q, such as
    # "mode_there".
    variable_name = f"{source.mode_argument}_there"
    returned = _nan_where_q_is_nan(variable_name)
    input_lines = ""
    docstring_end = ""
    # `step` has the pair variables after a step of Newton's method. Empty in closed form.
    needs_newton_steps = bool(source.formulas.step)
    if needs_newton_steps:
        # The table `inputs` has the input of the known configuration, by interval and mode.
        returned += ", " + _nan_where_q_is_nan("inputs[interval, mode]")
        input_lines = f"    inputs = np.array(\n        {texts.known_inputs}\n    )\n"
        docstring_end = KNOWN_INPUTS_TEXT
    yield PYTHON_SMOOTH_MODE_TEMPLATE.format(
        **source.smooth_mode_fields,  # names of the function and its variables, and sizes
        starts=texts.interval_starts,
        places=texts.mode_values,
        inputs=input_lines,
        shift_lines=texts.shift_lines,
        returned=returned,
        end=docstring_end,
    )


def _nan_where_q_is_nan(expression: str) -> str:
    """Return the Python expression that is NaN where q is NaN, and otherwise the given."""
    return f"np.where(np.isnan(q), np.nan, {expression})"
