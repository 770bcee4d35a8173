"""Formulas as functions of vectors in Julia."""

from collections.abc import Iterator

from spherekit.escaping import julia_comment, julia_string
from spherekit.exchange import identifiers
from spherekit.exchange.script_parts import (
    join_items,
    join_parts,
    smooth_mode_texts,
    write_series,
)
from spherekit.exchange.source_language import Language, operation_formats
from spherekit.exchange.source_printer import FormulaSource, SourceFunction
from spherekit.exchange.source_text import nested

ERROR_CONDITIONS = {
    "sqrt": "x < 0",
    "asin": "abs(x) > 1",
    "acos": "abs(x) > 1",
    "log": "x < 0",
}
"""Conditions on finite x in which functions of Julia raise an error, instead of NaN."""

JULIA = Language(
    name="Julia",
    operation_formats=operation_formats(
        "",
        {name: f"{name}_or_nan({{0}})" for name in ERROR_CONDITIONS}
        | {
            "atan2": "atan({0}, {1})",
            "sign": "sign({0})",
            "maximum": "max({0}, {1})",
            "**": "{0} ^ {1}",
        },
    ),
    assignment_format="    {0} = {1}",
    table_format="    table_{k} = {name}_table_{k}({argument})",
    comment_prefix="# ",
    escape_comment=julia_comment,
    name_rules=identifiers.JULIA_NAME_RULES,
    helper_by_operation={
        name: f"{name}_or_nan(x) = {condition} ? oftype(float(x), NaN) : {name}(x)\n"
        for name, condition in ERROR_CONDITIONS.items()
    },
    nan_literal="NaN",
    first_index=1,
)

JULIA_SERIES_TEMPLATE = """\
const {name}_edges_{k} = {edges}
const {name}_coefficients_{k} = {coefficients}

function {name}_table_{k}(s)
    edges = {name}_edges_{k}
{around}    cell = clamp(searchsortedlast(edges, s), 1, {cells})
    x = ((s - edges[cell]) + (s - edges[cell + 1])) / (edges[cell + 1] - edges[cell])
    map({name}_coefficients_{k}[cell]) do series
        sum, before = zero(x), zero(x)
        for n in {order}:-1:2
            sum, before = series[n] + 2x * sum - before, sum
        end
        series[1] + x * sum - before
    end
end
"""
"""Template of the function that evaluates a stored series, by Clenshaw's recurrence."""

JULIA_CLOSED_SERIES_TEMPLATE = "    s -= floor((s - {low}) / {length}) * {length}\n"
"""Line that moves the variable of a closed curve into its period."""

JULIA_OPEN_SERIES_TEMPLATE = (
    "    {low} <= s <= {high} || return fill(oftype(float(s), NaN), {columns})\n"
)
"""Line that returns NaN outside of an open curve."""

JULIA_SMOOTH_MODE_TEMPLATE = """\
function {name}(k, q)
    starts = {starts}
    places = {places}
{inputs}{moved}    interval = max(1, searchsortedlast(starts, q))
    {mode} = isnan(q) ? fill(NaN, {count}) : Float64.(places[interval][k])
    return {returned}
end
"""
"""Template of the function that selects a mode on its smooth curve.

Its array ``places`` has the values that select a mode, by interval and mode.
"""

JULIA_MOVED_INPUT_TEMPLATE = """\
    if !({low} <= q <= {high})
        above = q - floor((q - {low}) / {period}) * {period}
        q = above - {high} > {low} - above + {period} ? above - {period} : above
    end
"""
"""Template of the lines that move an input outside of the range by whole periods."""


def write_julia(source: FormulaSource) -> str:
    """Return the formulas of a mechanism as the text of a Julia program.

    The text begins with constants: the names of the results, the sizes of the mechanism,
    and the mode values. Mode values are numbers that select an assembly mode (a way to
    assemble the mechanism), such as the signs of dyads (groups of two links). Julia
    functions follow:

    - Functions that the formulas contain, such as profiles of contacts, stored as tables of
      Chebyshev coefficients (series).
    - A function that computes the results by the formulas. If there is no closed form, a
      further function makes a step of Newton's method.
    - A function that returns the mode values at an input, if they depend on the input.
    """
    formulas = source.formulas
    name = source.name
    # Arrays are written as ``Float64[1.0, -1.0]``. The prefix states the type of the
    # numbers, which an empty array would not have otherwise.
    modes = ", ".join(f"Float64{nested(mode.values)}" for mode in formulas.modes)
    result_names = join_items(map(julia_string, formulas.results))
    sizes = nested([size.value for size in formulas.sizes])
    parts = [
        f"const {name}_results = [\n    {result_names}\n]",
        f"const {name}_sizes = Float64{sizes}",
        f"const {name}_modes = [{modes}]\n",
        *write_series(
            source,
            template=JULIA_SERIES_TEMPLATE,
            # These templates treat values outside the range of a series: a function along a
            # closed curve is periodic, one along an open curve ends.
            closed_template=JULIA_CLOSED_SERIES_TEMPLATE,
            open_template=JULIA_OPEN_SERIES_TEMPLATE,
        ),
        *(_write_function(source, function) for function in source.functions),
        *_write_smooth_modes(source),
    ]
    return join_parts(source, parts)


def _write_function(source: FormulaSource, function: SourceFunction) -> str:
    """Return the Julia text of a function that computes some formulas.

    A step of Newton's method also returns the closure residual (by how much the loops were
    open before the step).
    """
    residual = f", {function.closure_residual}" if function.closure_residual else ""
    results = join_items(function.results, 8)
    lines = [*function.lines, f"    return [\n        {results}\n    ]{residual}"]
    body = "\n".join(lines)
    parameters = f"motion, {source.mode_argument}, size={source.name}_sizes"
    return f"function {function.name}({parameters})\n{body}\nend\n"


def _write_smooth_modes(source: FormulaSource) -> Iterator[str]:
    """Yield the text of the function that selects an assembly mode at an input q.

    A mode (way to assemble the mechanism) follows a smooth curve of configurations as q
    changes. The formulas take numbers that select the mode, the mode values. In closed form
    the mode values are the signs of the dyads (groups of two links). Without closed form
    the mode values are the pair variables of a known configuration. Where the curve crosses
    another one, the mode values change. There are values for each interval of q between
    crossings.

    The written function takes the number k of the mode and the input q. It returns the mode
    values in the interval of q, or NaN if q is NaN::

        function fourbar_smooth_mode(k, q)
            starts = [-Inf, 3.14]
            places = [...]
            interval = max(1, searchsortedlast(starts, q))
            mode = isnan(q) ? fill(NaN, 1) : Float64.(places[interval][k])
            return mode
        end

    Without closed form the written function also returns the input of the known
    configuration, from which steps of Newton's method lead to q. Nothing is yielded if the
    mode values do not depend on q.
    """
    if source.smooth_modes is None:
        return
    texts = smooth_mode_texts(
        source,
        nan_literal="NaN",
        infinity_literal="Inf",
        # Lines that shift q into the range of the input by whole periods.
        moved_template=JULIA_MOVED_INPUT_TEMPLATE,
    )
    # What the written function returns: first the variable with the mode values, which is
    # called ``mode`` in the function above.
    returned = source.mode_argument
    # Without a closed form, `step` has the terms of a step of Newton's method.
    has_closed_form = not source.formulas.step
    if has_closed_form:
        input_lines = ""
    else:
        # `interval` is a variable of the written function: the interval of q.
        input_lines = f"    inputs = {texts.known_inputs}\n"
        returned += ", isnan(q) ? NaN : inputs[interval][k]"
    # The template is the function that is shown above, with these texts inserted.
    yield JULIA_SMOOTH_MODE_TEMPLATE.format(
        # Names of the function and of its array of mode values, and sizes of arrays.
        **source.smooth_mode_fields,
        starts=texts.interval_starts,  # the q at which intervals begin
        places=texts.mode_values,  # by interval and mode
        inputs=input_lines,  # a second table: the input of each known configuration
        moved=texts.shift_lines,  # lines that shift q into the range of the input
        returned=returned,
    )
