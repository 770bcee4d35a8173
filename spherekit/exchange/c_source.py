"""Formulas as C99, and as C++ templates: no library but ``<math.h>``, nothing allocated."""

from collections.abc import Iterator

from spherekit.arrays import Floats
from spherekit.escaping import c_comment
from spherekit.exchange import identifiers
from spherekit.exchange.source_printer import (
    CALLS,
    Function,
    Language,
    Source,
    calls,
    nested,
    nested_special,
    wrapped,
)

HELPERS = {
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
_TEMPLATE = "template <class Scalar>\n"
CPP_HELPERS = {
    "sign": f"""{_TEMPLATE}Scalar sign_of(const Scalar &x)
{{
    return x > Scalar(0) ? Scalar(1) : x < Scalar(0) ? Scalar(-1) : x;
}}
""",
    "maximum": f"""{_TEMPLATE}Scalar larger_of(const Scalar &a, const Scalar &b)
{{
    return a >= b || a != a ? a : b;
}}
""",
}
# A literal in double would make every operation on a float one in double. Numbers that
# differentiate themselves are better multiplied by a double than by one of their own.
CONSTANT_OF = """template <class Scalar>
struct constant_of {
    typedef typename std::conditional<
        std::is_floating_point<Scalar>::value, Scalar, double>::type type;
};
"""
_REAL = "    typedef typename constant_of<Scalar>::type Real;\n"

_TABLE = """\
    {scalar} table_{{k}}[{{columns}}];
    {{name}}_table_{{k}}({{place}}, table_{{k}});"""

C = Language(
    "C",
    calls("", {"sign": "sign_of({0})", "maximum": "larger_of({0}, {1})"}),
    "    const double {0} = {1};",
    _TABLE.format(scalar="double"),
    " * ",
    c_comment,
    identifiers.C,
    HELPERS,
    "NAN",
)
CPP = Language(
    "C++",
    calls("", {"sign": "sign_of<Scalar>({0})", "maximum": "larger_of<Scalar>({0}, {1})"}),
    "    const Scalar {0} = {1};",
    _TABLE.format(scalar="Scalar"),
    "// ",
    c_comment,
    identifiers.CPP,
    CPP_HELPERS,
    "Scalar(NAN)",
    literal="Real({0})",
)

SERIES = """\
static void {name}_table_{k}({scalar} s, {scalar} column[{columns}])
{{
{alias}    static const {constant} edges[{cells} + 1] = {{
    {edge_values}}};
    static const {constant} coefficients[{cells}][{columns}][{order}] = {{
    {values}}};
    int cell = 0, beyond = {cells};
{around}    while (beyond - cell > 1) {{
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
CLOSED = "    s = s - floor((s - {low}) / {length}) * {length};\n"
OPEN = """\
    if (!(s >= {low} && s <= {high})) {{
        for (int k = 0; k < {columns}; ++k)
            column[k] = NAN;
        return;
    }}
"""


SMOOTH = """\
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
MOVED = """\
    if (!(q >= {low} && q <= {high})) {{
        const double above = q - floor((q - {low}) / {period}) * {period};
        q = above - {high} > {low} - above + {period} ? above - {period} : above;
    }}
"""
SMOOTH_INPUTS = """\
    static const double inputs[{intervals}][{modes}] = {{
    {inputs}}};
"""


def _smooth_head(source: Source, scalar: str) -> str:
    """Return the head of the function that gives the places of a mode at an input."""
    returned = "double" if source.of.step else "void"
    return f"{returned} {source.smooth_name}(int k, double q, {scalar} {source.mode}[])"


def _smooth_modes(source: Source, scalar: str) -> Iterator[str]:
    """Yield the function that gives the places of a mode on its smooth curve."""
    if source.smooth is None:
        return

    def array(values: Floats) -> str:
        return nested_special(values, "{}", "NAN", "INFINITY")[1:-1]

    numbers = source.smooth_numbers
    inputs = returned = ""
    if source.of.step:
        inputs = SMOOTH_INPUTS.format(**{**numbers, "inputs": array(numbers["inputs"])})
        returned = "    return q == q ? inputs[interval][k] : NAN;\n"
    value = "q == q ? places[interval][k][n] : NAN"
    arrays = {key: array(numbers[key]) for key in ("starts", "places")}
    yield SMOOTH.format(
        **{**numbers, **arrays, "inputs": inputs},
        head=_smooth_head(source, scalar),
        moved=MOVED.format(**numbers) if source.returns else "",
        written=value if scalar == "double" else f"{scalar}({value})",
        returned=returned,
    )


def _tables(source: Source, scalar: str, constant: str, alias: str) -> Iterator[str]:
    literal = source.language.literal
    for table in source.series:
        yield SERIES.format(
            **table,
            scalar=scalar,
            constant=constant,
            alias=alias,
            zero=literal.format("0.0"),
            two=literal.format("2.0"),
            edge_values=wrapped(nested(table["edges"], "{}", literal)[1:-1]),
            values=wrapped(nested(table["coefficients"], "{}", literal)[1:-1]),
            around=(CLOSED if table["closed"] else OPEN).format(**table),
        )


def _head(source: Source, function: Function, scalar: str) -> str:
    mode = f"{scalar} {source.mode}[]"
    if function.opening:
        given = f"const {scalar} motion[], {mode}, const {scalar} size[]"
        return f"{scalar} {function.name}({given})"
    given = f"const {scalar} motion[], const {mode}, const {scalar} size[]"
    return f"void {function.name}({given}, {scalar} result[])"


def _function(source: Source, function: Function, scalar: str) -> str:
    unused = [x for x in source.given if x not in function.used]
    lines = [f"    (void){word};" for word in unused] + function.lines
    if function.opening:
        lines += [f"    {source.mode}[{k}] = {x};" for k, x in enumerate(function.results)]
        lines.append(f"    return {function.opening};")
    else:
        named = zip(source.results, function.results, strict=True)
        lines += [f"    result[{source.name}_{name}] = {x};" for name, x in named]
    body = "\n".join(lines)
    alias = _REAL if "Real(" in body else ""
    return f"{_head(source, function, scalar)}\n{{\n{alias}{body}\n}}\n"


def _data(source: Source, storage: str) -> Iterator[str]:
    """Yield the places of results, the sizes of the file and the assembly modes."""
    name, of = source.name, source.of
    names = ",\n".join(f"    {name}_{x} = {k}" for k, x in enumerate(source.results))
    yield f"enum {{\n{names}\n}};\n"
    if of.sizes:
        values = nested([x.value for x in of.sizes], "{}")
        yield f"{storage}const double {name}_sizes[{len(of.sizes)}] = {values};\n"
    if of.modes and of.places:
        shape = f"[{len(of.modes)}][{len(of.places)}]"
        rows = ",\n    ".join(nested(mode.values, "{}") for mode in of.modes)
        yield f"{storage}const double {name}_modes{shape} = {{\n    {rows}\n}};\n"


def c(source: Source) -> str:
    """Return C99, to be compiled on its own or included."""
    declared = [f"{_head(source, x, 'double')};" for x in source.functions]
    if source.smooth is not None:
        declared.append(f"{_smooth_head(source, 'double')};")
    parts = [
        f"/*\n{source.comment} */\n#include <math.h>\n",
        "/* To be declared where they are called. */",
        *declared,
        "",
        *_data(source, ""),
        *source.helpers,
        *_tables(source, "double", "double", ""),
        *(_function(source, function, "double") for function in source.functions),
        *_smooth_modes(source, "double"),
    ]
    return "\n".join(parts)


def cpp(source: Source) -> str:
    """Return a header of templates, for numbers that differentiate themselves too."""
    guard = f"{source.name}_HPP"
    calls_of = "\n".join(f"using std::{x};" for x in ("atan2", "floor", "pow", *CALLS))
    tables = _tables(source, "Scalar", "Real", _REAL)
    includes = "#include <cmath>\n#include <type_traits>\n"
    parts = [
        f"{source.comment}#ifndef {guard}\n#define {guard}\n\n{includes}",
        f"namespace {source.name}_formulas {{\n\n{calls_of}\n",
        CONSTANT_OF,
        *_data(source, "static "),
        *source.helpers,
        *(_TEMPLATE + text.removeprefix("static ") for text in tables),
        *(_TEMPLATE + _function(source, x, "Scalar") for x in source.functions),
        *(_TEMPLATE + text for text in _smooth_modes(source, "Scalar")),
        "}\n\n#endif\n",
    ]
    return "\n".join(parts)
