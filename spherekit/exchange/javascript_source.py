"""Formulas as an ES module of JavaScript."""

from collections.abc import Iterator

from spherekit.escaping import javascript_comment, json_text
from spherekit.exchange import identifiers
from spherekit.exchange.script_parts import join_parts, smooth_mode_texts, write_series
from spherekit.exchange.source_language import Language, operation_formats
from spherekit.exchange.source_printer import FormulaSource, SourceFunction

JAVASCRIPT = Language(
    name="JavaScript",
    operation_formats=operation_formats(
        "Math.", {"sign": "Math.sign({0})", "maximum": "Math.max({0}, {1})"}
    ),
    assignment_format="  const {0} = {1};",
    table_format="  const table_{k} = {name}_table_{k}({argument});",
    comment_prefix="// ",
    escape_comment=javascript_comment,
    name_rules=identifiers.JAVASCRIPT_NAME_RULES,
    helper_by_operation={},
    nan_literal="NaN",
)

JAVASCRIPT_SERIES_TEMPLATE = """\
const {name}_edges_{k} = {edges};
const {name}_coefficients_{k} = {coefficients};

function {name}_table_{k}(s) {{
  const edges = {name}_edges_{k};
{around}  let cell = 0, beyond = {cells};
  while (beyond - cell > 1) {{
    const middle = (cell + beyond) >> 1;
    if (s >= edges[middle]) cell = middle;
    else beyond = middle;
  }}
  const low = s - edges[cell], high = s - edges[cell + 1];
  const x = (low + high) / (edges[cell + 1] - edges[cell]);
  return {name}_coefficients_{k}[cell].map((series) => {{
    let sum = 0, before = 0;
    for (let n = {order} - 1; n > 0; --n)
      [sum, before] = [series[n] + 2 * x * sum - before, sum];
    return series[0] + x * sum - before;
  }});
}}
"""
"""Template of the function that evaluates a stored series, by Clenshaw's recurrence."""

JAVASCRIPT_CLOSED_SERIES_TEMPLATE = (
    "  s -= Math.floor((s - {low}) / {length}) * {length};\n"
)
"""Line that moves the variable of a closed curve into its period."""

JAVASCRIPT_OPEN_SERIES_TEMPLATE = (
    "  if (!(s >= {low} && s <= {high}))\n    return new Array({columns}).fill(NaN);\n"
)
"""Lines that return NaN outside of an open curve."""

JAVASCRIPT_SMOOTH_MODE_TEMPLATE = """\
export function {name}(k, q, {mode} = new Float64Array({count})) {{
  const starts = {starts};
  const places = {places};
{inputs}{moved}  let interval = 0;
  while (interval + 1 < {intervals} && q >= starts[interval + 1]) ++interval;
  for (let n = 0; n < {count}; ++n)
    {mode}[n] = Number.isNaN(q) ? NaN : places[interval][k][n];
  return {returned};
}}
"""
"""Template of the function that selects a mode on its smooth curve.

Its array ``places`` has the values that select a mode, by interval and mode.
"""

JAVASCRIPT_MOVED_INPUT_TEMPLATE = """\
  if (!(q >= {low} && q <= {high})) {{
    const above = q - Math.floor((q - {low}) / {period}) * {period};
    q = above - {high} > {low} - above + {period} ? above - {period} : above;
  }}
"""
"""Template of the lines that move an input outside of the range by whole periods."""


def write_javascript(source: FormulaSource) -> str:
    """Return the formulas of a mechanism as the text of an ES module.

    The text begins with a description: names of arguments and results, sizes, and mode
    values. Sizes are numbers of the mechanism file that the user has chosen as arguments.
    Mode values are numbers that select an assembly mode (a way to assemble the mechanism),
    such as the signs of dyads (groups of two links). JavaScript functions follow:

    - Functions that the formulas contain, such as the profile of a contact (a curve on a
      link along which it is touched). Such functions are tables of Chebyshev coefficients
      (series).
    - A function that computes the results by the formulas. If there is no closed form, a
      further function makes a step of Newton's method.
    - A function that returns the mode values at an input, if they depend on the input.
    """
    formulas = source.formulas
    description = {
        "mechanism": formulas.mechanism.name,
        # The arguments that describe the motion, such as inputs and their rates.
        "motion": [argument.name for argument in formulas.motion],
        "modes": [mode._asdict() for mode in formulas.modes],
        "sizes": [size._asdict() for size in formulas.sizes],
        "results": [
            {"name": name, "unit": unit} for name, unit in formulas.results.items()
        ],
        # `step` has the terms of a step of Newton's method; it is empty in closed form.
        "closed_form": not formulas.step,
    }
    parts = [
        f"export const {source.name}_about = {json_text(description, indent=1)};\n",
        *write_series(
            source,
            template=JAVASCRIPT_SERIES_TEMPLATE,
            # These templates treat values outside the range of a series: a function on a
            # closed profile is periodic, one on an open profile ends.
            closed_template=JAVASCRIPT_CLOSED_SERIES_TEMPLATE,
            open_template=JAVASCRIPT_OPEN_SERIES_TEMPLATE,
        ),
        *(_write_function(source, function) for function in source.functions),
        *_write_smooth_modes(source),
    ]
    return join_parts(source, parts)


def _write_function(source: FormulaSource, function: SourceFunction) -> str:
    """Return the JavaScript text of a function that writes its results to an array.

    - The function of the formulas writes to the array ``result`` and returns it.
    - If positions have no closed form, another function makes one step of Newton's method.
      The argument ``variables`` has approximate pair variables (joint angles), which the
      step improves in place. The function returns the closure residual: how far the loops
      were open before the step.
    """
    parameters = ", ".join(source.arguments)
    # The name of the residual in the lines of the function, or "" in other functions.
    residual_name = function.closure_residual
    if residual_name:  # the step of Newton's method
        target = source.mode_argument  # This is ``variables`` if there is a Newton step.
        returned = residual_name
    else:
        target = "result"
        returned = target
        parameters += f", result = new Float64Array({len(function.results)})"
    lines = [*function.lines]
    for index, result in enumerate(function.results):
        lines.append(f"  {target}[{index}] = {result};")
    lines.append(f"  return {returned};")
    body = "\n".join(lines)
    return f"export function {function.name}({parameters}) {{\n{body}\n}}\n"


def _write_smooth_modes(source: FormulaSource) -> Iterator[str]:
    """Yield the text of the function that returns the mode values of a mode at an input q.

    A mode (way to assemble the mechanism) follows a smooth curve of configurations as q
    changes. The formulas take numbers that select the mode, the mode values. In closed form
    the mode values are the signs of the dyads (groups of two links). Without closed form
    the mode values are the pair variables of a known configuration. Crossings with other
    curves divide the range of q into intervals. In each interval the mode has other values.

    The written function takes the number k of the mode, the input q, and an array. It
    writes the mode values of the interval that contains q to the array::

        export function fourbar_smooth_mode(k, q, mode = new Float64Array(1)) {
          ...
          return mode;
        }

    If the formulas have a closed form, the written function returns the array. Otherwise
    its mode values belong to a known configuration at another input of the interval. The
    written function returns this input, and steps of Newton's method lead from it to q.
    Nothing is yielded if the mode values do not depend on q.
    """
    if source.smooth_modes is None:
        return
    texts = smooth_mode_texts(
        source,
        nan_literal="NaN",
        infinity_literal="Infinity",
        # Text of lines that shift q into the range of the input by whole periods.
        moved_template=JAVASCRIPT_MOVED_INPUT_TEMPLATE,
    )
    # Without a closed form, `step` has the terms of a step of Newton's method.
    has_closed_form = not source.formulas.step
    if has_closed_form:
        input_lines = ""
        returned = source.mode_argument  # the name of the array, ``mode``
    else:
        # The written function has a table `inputs`: for each interval and mode the input of
        # the known configuration. `interval` is its variable for the interval of q. Without
        # an input (q is NaN), the result is NaN.
        input_lines = f"  const inputs = {texts.known_inputs};\n"
        returned = "Number.isNaN(q) ? NaN : inputs[interval][k]"
    yield JAVASCRIPT_SMOOTH_MODE_TEMPLATE.format(
        # Names of the function and of its array of mode values, and sizes of arrays.
        **source.smooth_mode_fields,
        starts=texts.interval_starts,  # the q at which intervals begin
        places=texts.mode_values,  # by interval and mode
        inputs=input_lines,
        moved=texts.shift_lines,  # lines that shift q into the range of the input
        returned=returned,
    )
