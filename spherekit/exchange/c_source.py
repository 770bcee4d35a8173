"""Formulas as C99, and as C++ templates: no library but ``<math.h>``, nothing allocated."""

from collections.abc import Iterator

import numpy as np

from spherekit.arrays import Floats
from spherekit.escaping import c_comment
from spherekit.exchange import identifiers
from spherekit.exchange.source_head import head_comment
from spherekit.exchange.source_language import (
    UNARY_FUNCTIONS,
    Language,
    operation_formats,
)
from spherekit.exchange.source_printer import FormulaSource, SourceFunction
from spherekit.exchange.source_text import nested, nested_with_nan, wrap_lines

C_HELPER_BY_OPERATION = {
    "sign": """static inline double sign_of(double x)
{
    return x > 0.0 ? 1.0 : x < 0.0 ? -1.0 : x;
}
""",
    "maximum": """static inline double larger_of(double a, double b)
{
    return a >= b || a != a ? a : b;
}
""",
}
"""Functions that C does not have, by the operation of expressions that needs them."""

TEMPLATE_HEAD = "template <class Scalar>\n"
"""Beginning of a function of any number type."""

CPP_HELPER_BY_OPERATION = {
    "sign": f"""{TEMPLATE_HEAD}Scalar sign_of(const Scalar &x)
{{
    return x > Scalar(0) ? Scalar(1) : x < Scalar(0) ? Scalar(-1) : x;
}}
""",
    "maximum": f"""{TEMPLATE_HEAD}Scalar larger_of(const Scalar &a, const Scalar &b)
{{
    return a >= b || a != a ? a : b;
}}
""",
}
"""The same in C++, for any number type."""

CONSTANT_OF = """template <class Scalar>
struct constant_of {
    typedef typename std::conditional<
        std::is_floating_point<Scalar>::value, Scalar, double>::type type;
};
"""
"""The type of constants in C++.

Constants of type double would make every operation on a float one on doubles. Numbers that
differentiate themselves are better multiplied by a double than by one of their own.
"""

REAL_TYPE_LINE = "    typedef typename constant_of<Scalar>::type Real;\n"
"""Line of a C++ function that defines the type of its constants."""

TABLE_FORMAT = """\
    {scalar} table_{{k}}[{{columns}}];
    {{name}}_table_{{k}}({{argument}}, table_{{k}});"""
"""Lines that evaluate a stored series."""

C = Language(
    name="C",
    operation_formats=operation_formats(
        "", {"sign": "sign_of({0})", "maximum": "larger_of({0}, {1})"}
    ),
    assignment_format="    const double {0} = {1};",
    table_format=TABLE_FORMAT.format(scalar="double"),
    comment_prefix=" * ",
    escape_comment=c_comment,
    name_rules=identifiers.C_NAME_RULES,
    helper_by_operation=C_HELPER_BY_OPERATION,
    nan_literal="NAN",
)
CPP = Language(
    name="C++",
    operation_formats=operation_formats(
        "", {"sign": "sign_of<Scalar>({0})", "maximum": "larger_of<Scalar>({0}, {1})"}
    ),
    assignment_format="    const Scalar {0} = {1};",
    table_format=TABLE_FORMAT.format(scalar="Scalar"),
    comment_prefix="// ",
    escape_comment=c_comment,
    name_rules=identifiers.CPP_NAME_RULES,
    helper_by_operation=CPP_HELPER_BY_OPERATION,
    nan_literal="Scalar(NAN)",
    literal_format="Real({0})",
)

C_SERIES_TEMPLATE = """\
static void {name}_table_{k}({scalar} s, {scalar} column[{columns}])
{{
{type_line}    static const {constant} edges[{cells} + 1] = {{
    {edge_values}}};
    static const {constant} coefficients[{cells}][{columns}][{order}] = {{
    {values}}};
    int cell = 0, beyond = {cells};
{out_of_range}    while (beyond - cell > 1) {{
        const int middle = (cell + beyond) / 2;
        if (s >= edges[middle])
            cell = middle;
        else
            beyond = middle;
    }}
    const {scalar} low = s - edges[cell], high = s - edges[cell + 1];
    const {scalar} x = (low + high) / (edges[cell + 1] - edges[cell]);
    for (int k = 0; k < {columns}; ++k) {{
        {scalar} sum = {zero}, before = {zero};
        for (int n = {order} - 1; n > 0; --n) {{
            const {scalar} next = coefficients[cell][k][n] + {two} * x * sum - before;
            before = sum;
            sum = next;
        }}
        column[k] = coefficients[cell][k][0] + x * sum - before;
    }}
}}
"""
"""Template of the function that evaluates a stored series, by Clenshaw's recurrence."""

C_CLOSED_SERIES_TEMPLATE = "    s = s - floor((s - {low}) / {length}) * {length};\n"
"""Line that moves the variable of a closed curve into its period."""

C_OPEN_SERIES_TEMPLATE = """\
    if (!(s >= {low} && s <= {high})) {{
        for (int k = 0; k < {columns}; ++k)
            column[k] = NAN;
        return;
    }}
"""
"""Lines that return NaN outside of an open curve."""

C_SMOOTH_MODE_TEMPLATE = """\
{head}
{{
    static const double starts[{intervals}] = {{
    {starts}}};
    static const double places[{intervals}][{modes}][{count}] = {{
    {places}}};
{inputs}{moved}    int interval = 0;
    while (interval + 1 < {intervals} && q >= starts[interval + 1])
        ++interval;
    for (int n = 0; n < {count}; ++n)
        {mode}[n] = {written};
{returned}}}
"""
"""Template of the function that selects a mode on its smooth curve.

Its array ``places`` has the values that select a mode in the formulas, such as the signs of
its dyads, by interval and mode.
"""

C_MOVED_INPUT_TEMPLATE = """\
    if (!(q >= {low} && q <= {high})) {{
        const double above = q - floor((q - {low}) / {period}) * {period};
        q = above - {high} > {low} - above + {period} ? above - {period} : above;
    }}
"""
"""Template of the lines that move an input outside of the range by whole periods."""

KNOWN_INPUTS_TEMPLATE = """\
    static const double inputs[{intervals}][{modes}] = {{
    {inputs}}};
"""
"""Template of the array of known inputs in that function."""


def write_c(source: FormulaSource) -> str:
    """Return the formulas of a mechanism as C99, to be compiled on its own or included.

    The text begins with declarations of all functions. It continues with

    - constants for the users of the formulas, such as the indices of the results,
    - functions that C does not have, such as the sign of a number,
    - functions that evaluate stored series: tables of Chebyshev coefficients by which
      functions of one variable are computed, such as the profile of a contact,
    - the functions of the formulas,
    - a function that returns, at an input, the numbers that select an assembly mode (one
      way to assemble the mechanism) in the formulas. It is written only if these numbers
      change where the smooth curves of configurations of two modes cross.
    """
    # Declarations of the functions.
    declarations = [
        f"{_function_head(source, function, 'double')};" for function in source.functions
    ]
    if source.smooth_modes is not None:
        declarations.append(f"{_smooth_mode_head(source, 'double')};")
    # Declarations of the arrays that callers read: definitions without the values.
    constants = [*_write_constants(source, storage="")]
    for text in constants:
        if text.startswith("const "):
            name_and_type, _, _ = text.partition(" = ")
            declarations.append(f"extern {name_and_type};")
    parts = [
        f"/*\n{head_comment(source)} */\n#include <math.h>\n",
        _prototype_comment(source),
        *declarations,
        "",
        *constants,
        *source.helpers,
        # No line has to define the type of constants, since C has the type double.
        *_write_series(source, scalar="double", constant="double", type_line=""),
        *(_write_function(source, function, "double") for function in source.functions),
        *_write_smooth_modes(source, "double"),
    ]
    return "\n".join(parts)


def _prototype_comment(source: FormulaSource) -> str:
    """Return the C comment before the function prototypes, with an example of a call.

    The example computes the results at the known inputs of the first assembly mode (way to
    assemble the mechanism). If positions have a closed form, a mode is selected by the
    signs of its dyads (groups of two links). Otherwise Newton's method starts from pair
    variables (joint angles) of the mode.
    """
    formulas = source.formulas
    comment = (
        "/* Prototypes. Copy them, and the names of results below, to the file from which\n"
        "   the functions are called."
    )
    if not formulas.modes:
        return f"{comment} */"
    name = source.name
    mode = formulas.modes[0]
    # In the array of the motion, inputs come first. Rates and other arguments are zero.
    motion = [*mode.at, *[0.0] * (len(formulas.motion) - len(mode.at))]
    # A null pointer stands for an array without elements.
    size = f"{name}_sizes" if formulas.sizes else "0"
    # Mode values are the numbers that select a mode: signs of dyads, or pair variables.
    mode_value_count = len(formulas.mode_value_names)
    mode_values = f"{name}_modes[0]" if mode_value_count else "0"
    lines = [
        f"const double motion[{len(motion)}] = {nested(motion, '{}')};",
        f"double result[{len(formulas.results)}];",
    ]
    if formulas.step:  # Newton's method is needed
        lines += [
            f"double variables[{mode_value_count}];",
            f"for (int i = 0; i < {mode_value_count}; ++i)",
            f"    variables[i] = {mode_values}[i];",
            "for (int steps = 0; steps < 20; ++steps)",
            f"    if ({name}_step(motion, variables, {size}) < 1e-12)",
            "        break;",
        ]
        mode_values = "variables"
    lines.append(f"{name}(motion, {mode_values}, {size}, result);")
    # Results are found by their names in the array.
    lines += [
        f'printf("%.9g\\n", result[{name}_{result}]);' for result in source.result_names[:1]
    ]
    example = "\n".join(f"       {line}" for line in lines)
    title = f"Example: assembly mode {mode.number} at inputs at which it exists."
    return f"{comment}\n\n   {title}\n\n{example}\n*/"


def write_cpp(source: FormulaSource) -> str:
    """Return the formulas of a mechanism as a C++ header of templates.

    The number type of variables, ``Scalar``, is a parameter of the templates, and may be a
    type for automatic differentiation. The number type of constants, ``Real``, follows from
    ``Scalar`` by the template `CONSTANT_OF`.

    After some definitions of types, the header has constants for its users, functions that
    C++ does not have (`helpers`), functions that evaluate tables of Chebyshev coefficients,
    the functions of the formulas, and a function that selects an assembly mode (way to
    assemble the mechanism).
    """
    guard = f"{source.name}_HPP"
    used_functions = "\n".join(
        f"using std::{name};" for name in ("atan2", "floor", "pow", *UNARY_FUNCTIONS)
    )
    includes = "#include <cmath>\n#include <type_traits>\n"
    # Functions that evaluate tables of Chebyshev coefficients. In C++ each of them has a
    # line that defines `Real`, the type of its constants.
    series = _write_series(source, "Scalar", "Real", REAL_TYPE_LINE)
    parts = [
        f"{head_comment(source)}#ifndef {guard}\n#define {guard}\n\n{includes}",
        f"namespace {source.name}_formulas {{\n\n{used_functions}\n",
        CONSTANT_OF,
        *_write_constants(source, storage="static "),
        *source.helpers,
        # Functions in a header need "static" if several files include it. Templates do not.
        *(TEMPLATE_HEAD + text.removeprefix("static ") for text in series),
        *(
            TEMPLATE_HEAD + _write_function(source, function, "Scalar")
            for function in source.functions
        ),
        # The function that selects an assembly mode at an input, if there is one.
        *(TEMPLATE_HEAD + text for text in _write_smooth_modes(source, "Scalar")),
        "}\n\n#endif\n",
    ]
    return "\n".join(parts)


def _write_constants(source: FormulaSource, storage: str) -> Iterator[str]:
    """Yield the C declarations of constants for the users of the formulas.

    The constants are the index of each result in the array of results, the values of the
    sizes in the mechanism file, and the mode values of each assembly mode (way to assemble
    the mechanism). Mode values are the numbers that select a mode in the formulas. In
    closed form mode values are the sign (+1 or -1) of each dyad (group of two links).
    Otherwise mode values are approximate pair variables (joint angles, rad).

    Parameters
    ----------
    source
        The formulas with their names.
    storage
        Storage class of the arrays with a space behind it (``"static "``), or nothing.
    """
    name = source.name
    formulas = source.formulas
    enumerators = ",\n".join(
        f"    {name}_{result} = {index}" for index, result in enumerate(source.result_names)
    )
    yield f"enum {{\n{enumerators}\n}};\n"
    # `nested` writes an array with C's braces around each axis.
    if formulas.sizes:
        values = nested([size.value for size in formulas.sizes], "{}")
        count = len(formulas.sizes)
        yield f"{storage}const double {name}_sizes[{count}] = {values};\n"
    if formulas.modes and formulas.mode_value_names:
        shape = f"[{len(formulas.modes)}][{len(formulas.mode_value_names)}]"
        rows = ",\n    ".join(nested(mode.values, "{}") for mode in formulas.modes)
        yield f"{storage}const double {name}_modes{shape} = {{\n    {rows}\n}};\n"


def _write_series(
    source: FormulaSource, scalar: str, constant: str, type_line: str
) -> Iterator[str]:
    """Yield the C functions that evaluate the stored series.

    A stored series is a table of Chebyshev coefficients by which functions of one variable
    are computed, such as the profile of a contact. The range of the variable is divided at
    the `edges` into cells, each with its own `coefficients`. On a closed curve the
    functions are periodic, and the variable is moved into the period. Beyond the ends of an
    open curve the results are NaN.

    Parameters
    ----------
    source
        The formulas with their series.
    scalar, constant
        Names of the C types of variables and of constants, such as ``double``.
    type_line
        Line that defines the type of constants, or nothing.
    """
    literal_format = source.language.literal_format  # writes 2.0 as Real(2.0) in C++
    # `fields` has the values of one series that are inserted in the templates, by name.
    for fields in source.series_fields:
        # Lines for a variable outside of the range of the series.
        out_of_range_template = (
            C_CLOSED_SERIES_TEMPLATE if fields["closed"] else C_OPEN_SERIES_TEMPLATE
        )
        edges = nested(fields["edges"], "{}", literal_format)
        coefficients = nested(fields["coefficients"], "{}", literal_format)
        # `[1:-1]` removes the outer braces, which the template has already.
        yield C_SERIES_TEMPLATE.format(
            **fields,
            scalar=scalar,
            constant=constant,
            type_line=type_line,
            zero=literal_format.format("0.0"),
            two=literal_format.format("2.0"),
            edge_values=wrap_lines(edges[1:-1]),
            values=wrap_lines(coefficients[1:-1]),
            out_of_range=out_of_range_template.format(**fields),
        )


def _function_head(source: FormulaSource, function: SourceFunction, scalar: str) -> str:
    """Return the head of a C function, without its body.

    A function either computes the results of the mechanism, or makes a step of Newton's
    method. All its arguments are arrays:

    - ``motion``: the inputs and their rates;
    - ``mode`` or ``variables``: the numbers that select the assembly mode (way to assemble
      the links). These numbers are signs of dyads (groups of two links), or approximate
      pair variables (joint angles). A step of Newton's method improves the variables in
      place;
    - ``size``: numbers of the mechanism file;
    - ``result``: the results. A step of Newton's method does not have this array, and
      returns the closure residual (how far loops are open).

    Parameters
    ----------
    source, function
        The source and one of its functions.
    scalar
        Name of the number type of its arguments, such as ``double``.
    """
    mode_parameter = f"{scalar} {source.mode_argument}[]"
    # Only a step of Newton's method has a closure residual.
    if function.closure_residual:
        return (
            f"{scalar} {function.name}"
            f"(const {scalar} motion[], {mode_parameter}, const {scalar} size[])"
        )
    return (
        f"void {function.name}(const {scalar} motion[], const {mode_parameter}, "
        f"const {scalar} size[], {scalar} result[])"
    )


def _write_function(source: FormulaSource, function: SourceFunction, scalar: str) -> str:
    """Return the text of a C function with its body.

    A function either computes the results of the mechanism, or makes a step of Newton's
    method. The argument ``variables`` of a step is an array with approximate pair variables
    (joint angles). The step overwrites them with improved ones. It returns the closure
    residual (how far loops are open).

    Parameters
    ----------
    source, function
        The source and one of its functions.
    scalar
        Name of the number type of its arguments: ``double`` in C, ``Scalar`` in C++, where
        the function is a template.
    """
    # Compilers warn of unused arguments unless they are named in a statement.
    lines = [
        f"    (void){argument};"
        for argument in source.arguments
        if argument not in function.used_arguments
    ]
    lines += function.lines
    # Copy the results from local variables to the array that the caller reads. Only a step
    # of Newton's method has a closure residual.
    if function.closure_residual:
        # `mode_argument` is ``variables`` here: the name of the array that is improved.
        for index, result in enumerate(function.results):
            lines.append(f"    {source.mode_argument}[{index}] = {result};")
        lines.append(f"    return {function.closure_residual};")
    else:
        for name, result in zip(source.result_names, function.results, strict=True):
            lines.append(f"    result[{source.name}_{name}] = {result};")
    body = "\n".join(lines)
    # C++ code writes constants as ``Real(0.5)``, and needs a line that defines ``Real``.
    type_line = REAL_TYPE_LINE if "Real(" in body else ""
    head = _function_head(source, function, scalar)
    return f"{head}\n{{\n{type_line}{body}\n}}\n"


def _smooth_mode_head(source: FormulaSource, scalar: str) -> str:
    """Return the head (first line) of the C function that selects a mode at an input.

    An assembly mode (way to assemble the mechanism) is selected by numbers, the mode
    values. Curves of configurations of two modes can cross. A "smooth" mode follows its
    smooth curve through the crossing, where its mode values can change. So the mode values
    depend on the input. The C function takes the row ``k`` of the mode in the array of
    modes, the input ``q`` (rad), and an array to which it writes the mode values at this
    input.

    If positions have a closed form, the mode values are the signs of the dyads (groups of
    two links), and the function returns nothing. Otherwise the mode values are the pair
    variables (joint angles, rad) of a known configuration, from which Newton's method
    starts. The function then returns the input of that configuration.

    Parameters
    ----------
    source
        The formulas.
    scalar
        Name of the number type of the array, such as ``double``.
    """
    # `step`, a step of Newton's method, is empty if positions have a closed form.
    has_closed_form = not source.formulas.step
    returned_type = "void" if has_closed_form else "double"
    return (
        f"{returned_type} {source.smooth_function}"
        f"(int k, double q, {scalar} {source.mode_argument}[])"
    )


def _write_smooth_modes(source: FormulaSource, scalar: str) -> Iterator[str]:
    """Yield the C function that selects an assembly mode at an input, if there is one.

    An assembly mode (way to assemble the mechanism) is selected by numbers, the mode
    values, such as the signs of its dyads (groups of two links). A mode can follow a smooth
    curve of configurations through a crossing with another curve. Its mode values can
    change at the crossing. Crossings therefore divide the range of the input into
    intervals. The written function has a table of mode values (``places``), by interval
    and mode::

        void fourbar_smooth_mode(int k, double q, double mode[])
        {
            static const double starts[2] = {-INFINITY, 3.14};   // of the intervals
            static const double places[2][2][1] = {...};
            int interval = 0;
            while (interval + 1 < 2 && q >= starts[interval + 1])
                ++interval;
            for (int n = 0; n < 1; ++n)
                mode[n] = q == q ? places[interval][k][n] : NAN;
        }

    Its arguments are the index k of the mode in this table and the input q (rad). The mode
    values in the interval of q are written to the last argument. They are NaN if q is NaN:
    then ``q == q`` is false. Two parts are added if necessary:

    - If configurations repeat after a period of the input, q is first moved into the range
      of the input.
    - Formulas that are not in closed form are solved by Newton's method, which starts from
      a known configuration of the mode. The mode values are the variables of this
      configuration. The function also returns its input, from an array ``inputs``.

    Parameters
    ----------
    source
        The source.
    scalar
        Name of the number type of the mode values, such as ``double``.
    """
    smooth_modes = source.smooth_modes
    if smooth_modes is None:
        return
    fields = source.smooth_mode_fields
    lines_that_move_q = ""
    if source.is_periodic:
        lines_that_move_q = C_MOVED_INPUT_TEMPLATE.format(**fields)
    yield C_SMOOTH_MODE_TEMPLATE.format(
        **fields,
        head=_smooth_mode_head(source, scalar),
        starts=_array_elements(np.array(smooth_modes.starts)),
        places=_array_elements(smooth_modes.mode_values),
        inputs=_known_inputs_array(source),
        moved=lines_that_move_q,
        written=_mode_value_expression(scalar),
        returned=_return_known_input(source),
    )


def _array_elements(values: Floats) -> str:
    """Return the elements of an array as C, without the outer braces."""
    text = nested_with_nan(values, "{}", nan_literal="NAN", infinity_literal="INFINITY")
    return text.removeprefix("{").removesuffix("}")


def _mode_value_expression(scalar: str) -> str:
    """Return the C expression for one of the numbers that select an assembly mode.

    In the C code, n is the index of the number, k the row of the mode and q the input. The
    result is NaN if q is NaN, in which case q == q is false.
    """
    value = "q == q ? places[interval][k][n] : NAN"
    # In C++ the number type may be a class, which is constructed from the double.
    return value if scalar == "double" else f"{scalar}({value})"


def _known_inputs_array(source: FormulaSource) -> str:
    """Return the C array of the inputs of known configurations, empty in closed form.

    Without closed form, Newton's method starts from a known configuration of the mode. The
    array has the input (rad) of this configuration, for each interval of the input and each
    assembly mode.
    """
    has_closed_form = not source.formulas.step
    if has_closed_form:
        return ""
    assert source.smooth_modes is not None
    return KNOWN_INPUTS_TEMPLATE.format(
        **source.smooth_mode_fields, inputs=_array_elements(source.smooth_modes.inputs)
    )


def _return_known_input(source: FormulaSource) -> str:
    """Return the C line that returns the input of the known configuration of mode k.

    Without closed form, Newton's method starts at this configuration. The result is NaN if
    q is NaN. In closed form there is no such start, and the line is empty.
    """
    has_closed_form = not source.formulas.step
    if has_closed_form:
        return ""
    return "    return q == q ? inputs[interval][k] : NAN;\n"
