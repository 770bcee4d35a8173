"""Formulas as source: one assignment for each term, in the language that is wanted.

C99 and C++ with `<math.h>` alone, JavaScript without anything, Python on NumPy, Julia, and
CasADi's `SX`, in Python. Terms are printed as they are: no printer of expressions makes
better code, for what occurs twice is one term already.
"""

import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pprint import pformat
from textwrap import wrap
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from spherekit.arrays import Floats
from spherekit.engine.expression_graph import Expr, ExpressionNode, in_order
from spherekit.errors import OutputError
from spherekit.exchange.formulas import Formulas
from spherekit.sphere.profile_series import ProfileSeries
from spherekit.version import __version__

Language = Literal["c", "cpp", "js", "python", "julia", "casadi"]

KINDS = ("motion", "mode", "size")
"""The arguments of a source, in the order of `Formulas.variables`."""


class Series(NamedTuple):
    """Columns of a profile by the arc length s: polynomials in each of its cells.

    `coefficients` (cells, columns, degree + 1) are of Chebyshev polynomials, `edges`
    (cells + 1,) bound the cells; the `length` is a period where it is `closed`.
    """

    edges: Floats
    coefficients: Floats
    length: float
    closed: bool


class Function(NamedTuple):
    """A function of a source: its name, results by names of its lines, and what it is."""

    name: str
    lines: tuple[tuple[str, str], ...]
    results: tuple[str, ...]
    series: tuple[tuple[int, str], ...]
    used: frozenset[str]
    is_step: bool


@dataclass(frozen=True)
class Printed:
    """How a language writes what others write otherwise.

    `operations` are formats by the name of an operation of terms; `helpers` what some of
    these need, by the same names. `index` is the number of the first place of an array.
    """

    operations: Mapping[str, str]
    assignment: str
    comment: str
    helpers: Mapping[str, str]
    index: int = 0


_CIRCULAR = ("sin", "cos", "tan", "asin", "acos", "atan")
_CALLS = (*_CIRCULAR, "sqrt", "exp", "log", "tanh", "cosh", "sinh")
_INFIX = {name: f"{{0}} {name} {{1}}" for name in "+-*/"}


def _calls(prefix: str, **others: str) -> dict[str, str]:
    """Return the operations of a language whose functions have a prefix."""
    named = {name: f"{prefix}{name}({{0}})" for name in _CALLS}
    named |= {name: f"{prefix}{name}({{0}}, {{1}})" for name in ("atan2", "pow")}
    named["**"] = named.pop("pow")
    return {**_INFIX, **named, **others}


_C_HELPERS = {
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
_OWN = {"sign": "sign_of({0})", "maximum": "larger_of({0}, {1})"}
_JULIA = ("sqrt", "asin", "acos", "log")
"""Functions of Julia that raise where others return NaN."""

LANGUAGES: Mapping[Language, Printed] = {
    "c": Printed(_calls("", **_OWN), "    const double {0} = {1};", " * ", _C_HELPERS),
    "cpp": Printed(
        _calls("", **_OWN),
        "    const Scalar {0} = {1};",
        "// ",
        {
            name: text.replace(
                "static inline double", "template <class Scalar>\nScalar"
            ).replace("double ", "const Scalar &")
            for name, text in _C_HELPERS.items()
        },
    ),
    "js": Printed(
        _calls("Math.", sign="Math.sign({0})", maximum="Math.max({0}, {1})"),
        "  const {0} = {1};",
        "// ",
        {},
    ),
    "python": Printed(
        _calls(
            "np.",
            asin="np.arcsin({0})",
            acos="np.arccos({0})",
            atan="np.arctan({0})",
            atan2="np.arctan2({0}, {1})",
            sign="np.sign({0})",
            maximum="np.maximum({0}, {1})",
            **{"**": "np.power({0}, {1})"},
        ),
        "        {0} = {1}",
        "# ",
        {},
    ),
    "julia": Printed(
        _calls(
            "",
            **{name: f"{name}_or_nan({{0}})" for name in _JULIA},
            atan2="atan({0}, {1})",
            sign="sign({0})",
            maximum="max({0}, {1})",
            **{"**": "{0} ^ {1}"},
        ),
        "    {0} = {1}",
        "# ",
        {
            name: f"{name}_or_nan(x) = {outside} ? oftype(float(x), NaN) : {name}(x)\n"
            for name, outside in zip(
                _JULIA, ("x < 0", "abs(x) > 1", "abs(x) > 1", "x < 0"), strict=True
            )
        },
        1,
    ),
    "casadi": Printed(
        _calls(
            "ca.", sign="ca.sign({0})", maximum="ca.fmax({0}, {1})", **{"**": "{0} ** {1}"}
        ),
        "    {0} = {1}",
        "# ",
        {},
    ),
}


def source(formulas: Formulas, language: Language) -> str:
    """Return formulas as source in a language.

    Raises
    ------
    OutputError
        If names of results are the same in it.
    """
    return _MAKERS[language](_Source(formulas, language))


def identifier(text: str) -> str:
    """Return a name that all languages allow."""
    return re.sub(r"^(?=\d)", "m_", re.sub(r"\W", "_", text, flags=re.ASCII))


class _Source:
    """Formulas with their names and lines in a language."""

    def __init__(self, formulas: Formulas, language: Language) -> None:
        self.of, self.language, self.form = formulas, language, LANGUAGES[language]
        self.name = identifier(formulas.mechanism.name)
        self.results = [identifier(name) for name in formulas.results]
        if len({*self.results}) < len(self.results):
            raise OutputError(
                f"{formulas.mechanism.name}: names of results differ only in signs that "
                f"names in {language} cannot have; give links or pairs other names"
            )
        self.mode = "mode" if not formulas.step else "variables"
        self.series = [_series(profile.series) for profile in formulas.profiles]
        self.functions = [self._function(self.name, formulas.outputs, False)]
        if formulas.step:
            self.functions.append(self._function(f"{self.name}_step", formulas.step, True))
        self.operations = {
            term.operation for term in in_order([*formulas.outputs, *formulas.step])
        }

    def _function(self, name: str, outputs: Sequence[Expr], is_step: bool) -> Function:
        formulas, at = self.of, self.form.index
        called: dict[ExpressionNode, str] = {}
        for kind, terms in zip(KINDS, formulas.variables, strict=True):
            word = self.mode if kind == "mode" else kind
            called |= {term: f"{word}[{k + at}]" for k, term in enumerate(terms)}
        columns: dict[ExpressionNode, int] = {}
        for k, profile in enumerate(formulas.profiles):
            terms = (*profile.terms, profile.last)
            called |= {x: f"profile_{k}[{c + at}]" for c, x in enumerate(terms)}
            columns |= dict.fromkeys(terms, k)
        lines, series, used = list[tuple[str, str]](), dict[int, str](), set[str]()
        for term in in_order(outputs):
            if term.operation == "variable":
                used.add(called[term].partition("[")[0])
                if term in columns:
                    series.setdefault(columns[term], self._arc(columns[term]))
                    used.add(self.mode)
                continue
            parts = [self._part(x, called) for x in term.arguments]
            called[term] = f"t{len(lines)}"
            lines.append(
                (called[term], self.form.operations[term.operation].format(*parts))
            )
        results = tuple(self._part(x, called) for x in outputs)
        return Function(
            name, tuple(lines), results, tuple(series.items()), frozenset(used), is_step
        )

    def _arc(self, k: int) -> str:
        """Return the arc length at which a profile is touched."""
        track = self.of.profiles[k].track
        return f"{self.mode}[{track.variable + self.form.index}] + {_number(track.start)}"

    def _part(self, item: Expr, called: Mapping[ExpressionNode, str]) -> str:
        if isinstance(item, ExpressionNode):
            return called[item]
        text = _number(float(item))
        return f"({text})" if text[0] == "-" else text

    @property
    def helpers(self) -> list[str]:
        """What operations need that the language does not have."""
        return [text for name, text in self.form.helpers.items() if name in self.operations]

    @property
    def head(self) -> Iterator[str]:
        """The lines that say what the source is of."""
        of = self.of
        yield f"{of.mechanism.name}: explicit formulas, made by spherekit {__version__}."
        if of.mechanism.source:
            yield from wrap(of.mechanism.source.citation, 84)
        yield ""
        closed = (
            "Positions follow in closed form; NaN where a mode does not close."
            if not of.step
            else f"Loops are closed by steps of Newton's method, {self.name}_step, from "
            "the variables of a mode below or of the sample before: repeat until what it "
            "returns, by how much they were open (rad), is small."
        )
        yield from wrap(closed, 84)
        yield ""
        tables = {
            "motion": [(x.name, x.unit) for x in of.motion],
            self.mode: [
                (x, "rad" if of.step else "+1 or -1: a dyad's side") for x in of.places
            ],
            "size": [(x.name, f"{x.unit}, {x.key} = {x.value:.12g}") for x in of.sizes],
            "result": [*of.results.items()],
        }
        for kind, rows in tables.items():
            yield f"{kind}:" + ("" if rows else " none")
            for k, (name, note) in enumerate(rows):
                yield f"  [{k + self.form.index}] {name}" + (f" ({note})" if note else "")
        yield "assembly modes:"
        for mode in of.modes:
            values = ", ".join(f"{x:.9g}" for x in mode.values)
            at = ", ".join(f"{q:.6g}" for q in mode.at)
            yield f"  {mode.number} ({mode.name}): {self.mode} {values or 'none'}; at {at}"

    def commented(self) -> str:
        """Return the head as a comment."""
        mark = self.form.comment
        return "\n".join(f"{mark}{line}".rstrip() for line in self.head) + "\n"

    def body(self, function: Function) -> Iterator[str]:
        """Yield the assignments of a function."""
        for name, text in function.lines:
            yield self.form.assignment.format(name, text)


def _number(x: float) -> str:
    return repr(x)


def _nested(values: Any, brackets: str = "[]") -> str:
    """Return numbers in brackets, arrays of arrays in those of their own."""
    if np.ndim(values):
        items = (_nested(item, brackets) for item in values)
        return brackets[0] + ", ".join(items) + brackets[1]
    return _number(float(values))


def _wrapped(text: str, indent: str = "    ") -> str:
    """Return long lists of numbers in lines of bearable length."""
    return f"\n{indent}".join(wrap(text, 96, break_long_words=False))


def _series(of: ProfileSeries) -> Series:
    series = of.series
    slopes = chebyshev.chebder(series.coefficients[:, :, 7:], axis=1)
    slopes = slopes * (2.0 / np.diff(series.edges))[:, None, None]
    every = np.concatenate(
        [series.coefficients, np.pad(slopes, ((0, 0), (0, 1), (0, 0)))], axis=2
    )
    return Series(series.edges, every.transpose(0, 2, 1), of.length, of.closed)


def _jointly(text: str, source: _Source) -> str:
    """Return a source of its comment, helpers and the rest."""
    return "\n".join([source.commented(), *source.helpers, text.strip("\n")]) + "\n"


# C and C++.

_SERIES_C = """
static void {name}_profile_{k}({scalar} s, {scalar} column[9])
{{
    static const double edges[{edges}] = {{
    {edge_values}}};
    static const double coefficients[{cells}][9][{order}] = {{
    {values}}};
    int cell = 0, beyond = {cells};
{wrapping}    while (beyond - cell > 1) {{
        const int middle = (cell + beyond) / 2;
        if (s >= edges[middle])
            cell = middle;
        else
            beyond = middle;
    }}
    const {scalar} low = s - edges[cell], high = s - edges[cell + 1];
    const {scalar} x = (low + high) / (edges[cell + 1] - edges[cell]);
    for (int k = 0; k < 9; ++k) {{
        {scalar} sum = 0.0, before = 0.0;
        for (int order = {last}; order > 0; --order) {{
            const {scalar} next = coefficients[cell][k][order] + 2.0 * x * sum - before;
            before = sum;
            sum = next;
        }}
        column[k] = coefficients[cell][k][0] + x * sum - before;
    }}
}}
"""
_CLOSED_C = "    s = s - floor(s / {length}) * {length};\n"
_OPEN_C = """\
    if (!(s >= edges[0] && s <= {length})) {{
        for (int k = 0; k < 9; ++k)
            column[k] = NAN;
        return;
    }}
"""


def _profiles_c(source: _Source, scalar: str) -> Iterator[str]:
    for k, series in enumerate(source.series):
        cells, _, order = series.coefficients.shape
        wrapping = _CLOSED_C if series.closed else _OPEN_C
        yield _SERIES_C.format(
            name=source.name,
            k=k,
            scalar=scalar,
            edges=cells + 1,
            cells=cells,
            order=order,
            last=order - 1,
            edge_values=_wrapped(_nested(series.edges, "  ").strip()),
            values=_wrapped(_nested(series.coefficients, "{}")[1:-1]),
            wrapping=wrapping.format(length=_number(series.length), cells=cells),
        )


def _function_c(source: _Source, function: Function, scalar: str, head: str) -> str:
    """Return a function of C or C++, its head being a format of the arguments."""
    mode = source.mode
    given = [
        f"const {scalar} motion[]",
        f"const {scalar} {mode}[]",
        f"const {scalar} size[]",
    ]
    returned = "void"
    if function.is_step:
        given[1] = given[1].removeprefix("const ")
        returned = scalar
    else:
        given.append(f"{scalar} result[]")
    unused = (word for word in ("motion", mode, "size") if word not in function.used)
    if function.is_step:
        unused = (word for word in unused if word != mode)
    lines = [f"    (void){word};" for word in unused]
    for k, arc in function.series:
        lines.append(f"    {scalar} profile_{k}[9];")
        lines.append(f"    {source.name}_profile_{k}({arc}, profile_{k});")
    lines += source.body(function)
    if function.is_step:
        *after, openness = function.results
        lines += [f"    {mode}[{k}] = {x};" for k, x in enumerate(after)]
        lines.append(f"    return {openness};")
    else:
        names = zip(source.results, function.results, strict=True)
        lines += [f"    result[{source.name}_{name}] = {x};" for name, x in names]
    body = "\n".join(lines)
    return f"{head.format(returned=returned, given=', '.join(given))}\n{{\n{body}\n}}\n"


def _data_c(source: _Source) -> Iterator[str]:
    """Yield the places of results, the sizes of the file and the assembly modes."""
    name, of = source.name, source.of
    names = ",\n".join(f"    {name}_{x} = {k}" for k, x in enumerate(source.results))
    yield f"/* Places of the results. */\nenum {{\n{names}\n}};\n"
    if of.sizes:
        values = _nested([x.value for x in of.sizes], "{}")
        yield f"const double {name}_sizes[{len(of.sizes)}] = {values};\n"
    if of.modes and of.places:
        shape = f"[{len(of.modes)}][{len(of.places)}]"
        values = ",\n    ".join(_nested(mode.values, "{}") for mode in of.modes)
        yield f"const double {name}_modes{shape} = {{\n    {values}\n}};\n"


def _c(source: _Source) -> str:
    name = source.name
    heads = [f"{{returned}} {function.name}({{given}})" for function in source.functions]
    functions = [
        _function_c(source, *each)
        for each in (
            (function, "double", head)
            for function, head in zip(source.functions, heads, strict=True)
        )
    ]
    declared = [f"{text.partition(chr(10))[0]};" for text in functions]
    lines = "\n".join(f" * {line}".rstrip() for line in source.head)
    return "\n".join(
        [
            f"/*\n{lines}\n */\n#include <math.h>\n",
            f"/* To be declared where {name} is called. */",
            *declared,
            "",
            *_data_c(source),
            *source.helpers,
            *_profiles_c(source, "double"),
            *functions,
        ]
    )


def _cpp(source: _Source) -> str:
    """Return a header of templates, for numbers that differentiate themselves too."""
    guard = f"{source.name.upper()}_HPP"
    calls = "\n".join(f"using std::{x};" for x in ("atan2", "floor", "pow", *_CALLS))
    head = "template <class Scalar>\n{{returned}} {0}({{given}})"
    parts = [
        f"#ifndef {guard}\n#define {guard}\n\n#include <cmath>\n",
        f"namespace {source.name}_formulas {{\n\n{calls}\n",
        *(
            text.replace("const double", "static const double", 1)
            if text[0] == "c"
            else text
            for text in _data_c(source)
        ),
        *source.helpers,
        *(
            text.replace("\nstatic void", "\ntemplate <class Scalar>\nvoid")
            for text in _profiles_c(source, "Scalar")
        ),
        *(
            _function_c(source, function, "Scalar", head.format(function.name))
            for function in source.functions
        ),
        "}\n\n#endif",
    ]
    return source.commented() + "\n".join(parts) + "\n"


# JavaScript.

_SERIES_JS = """
const {name}_edges_{k} = {edges};
const {name}_coefficients_{k} = {values};
function {name}_profile_{k}(s) {{
  const edges = {name}_edges_{k};
{wrapping}  let cell = 0, beyond = {cells};
  while (beyond - cell > 1) {{
    const middle = (cell + beyond) >> 1;
    if (s >= edges[middle]) cell = middle;
    else beyond = middle;
  }}
  const low = s - edges[cell], high = s - edges[cell + 1];
  const x = (low + high) / (edges[cell + 1] - edges[cell]);
  return {name}_coefficients_{k}[cell].map((series) => {{
    let sum = 0, before = 0;
    for (let order = {last}; order > 0; --order)
      [sum, before] = [series[order] + 2 * x * sum - before, sum];
    return series[0] + x * sum - before;
  }});
}}
"""


def _javascript(source: _Source) -> str:
    of, name, mode = source.of, source.name, source.mode
    about = {
        "mechanism": of.mechanism.name,
        "motion": [x.name for x in of.motion],
        "modes": [mode._asdict() for mode in of.modes],
        "sizes": [size._asdict() for size in of.sizes],
        "results": [{"name": x, "unit": unit} for x, unit in of.results.items()],
        "closed_form": not of.step,
    }
    parts = [f"export const {name}_about = {json.dumps(about, indent=1)};\n"]
    for k, series in enumerate(source.series):
        cells, _, order = series.coefficients.shape
        length = _number(series.length)
        wrapping = f"  s -= Math.floor(s / {length}) * {length};\n"
        if not series.closed:
            wrapping = (
                f"  if (!(s >= edges[0] && s <= {length})) return Array(9).fill(NaN);\n"
            )
        parts.append(
            _SERIES_JS.format(
                name=name,
                k=k,
                edges=_wrapped(_nested(series.edges)),
                values=_wrapped(_nested(series.coefficients)),
                wrapping=wrapping,
                cells=cells,
                last=order - 1,
            )
        )
    for function in source.functions:
        given = f"motion, {mode}, size"
        lines = [
            f"  const profile_{k} = {name}_profile_{k}({arc});"
            for k, arc in function.series
        ]
        lines += source.body(function)
        if function.is_step:
            *after, openness = function.results
            lines += [f"  {mode}[{k}] = {x};" for k, x in enumerate(after)]
            lines.append(f"  return {openness};")
        else:
            given += f", result = new Float64Array({len(function.results)})"
            lines += [f"  result[{k}] = {x};" for k, x in enumerate(function.results)]
            lines.append("  return result;")
        body = "\n".join(lines)
        parts.append(f"export function {function.name}({given}) {{\n{body}\n}}\n")
    return _jointly("\n".join(parts), source)


# Python.

_SERIES_PYTHON = """
_EDGES_{k} = np.array(
    {edges}
)
_COEFFICIENTS_{k} = np.array(
    {values}
)


def _profile_{k}(s):
    s = np.asarray(s, dtype=float)
{wrapping}    cell = np.searchsorted(_EDGES_{k}[1:-1], s, side="right")
    low, high = s - _EDGES_{k}[cell], s - _EDGES_{k}[cell + 1]
    x = (low + high) / (low - high)
    series = np.moveaxis(_COEFFICIENTS_{k}[cell], (-2, -1), (0, 1))
    total, before = 0.0, 0.0
    for order in range({last}, 0, -1):
        total, before = series[:, order] + 2.0 * x * total - before, total
    return series[:, 0] + x * total - before

"""
_PYTHON = """
import numpy as np

MOTION = {motion}
SIZES = {sizes}
RESULTS = {results}
MODES = {modes}
"""


def _data_python(source: _Source) -> str:
    of = source.of
    sizes = {x.name: x.value for x in of.sizes}
    modes = {mode.number: mode.values for mode in of.modes}
    words = [x.name for x in of.motion], sizes, of.results, modes
    return _PYTHON.format(
        **dict(
            zip(("motion", "sizes", "results", "modes"), map(_laid_out, words), strict=True)
        )
    )


def _laid_out(words: Any) -> str:
    return pformat(words, width=88, sort_dicts=False)


def _python(source: _Source) -> str:
    mode, parts = source.mode, [_data_python(source)]
    for k, series in enumerate(source.series):
        length = _number(series.length)
        wrapping = f"    s = np.mod(s, {length})\n"
        if not series.closed:
            wrapping = f"    s = np.where((s >= 0.0) & (s <= {length}), s, np.nan)\n"
        parts.append(
            _SERIES_PYTHON.format(
                k=k,
                edges=_wrapped(_nested(series.edges)),
                values=_wrapped(_nested(series.coefficients)),
                wrapping=wrapping,
                last=series.coefficients.shape[2] - 1,
            )
        )
    for function in source.functions:
        lines = [f"        profile_{k} = _profile_{k}({arc})" for k, arc in function.series]
        lines += source.body(function)
        results = list(function.results)
        returned = "return np.array(np.broadcast_arrays({}), dtype=float)"
        what = f"results (n of RESULTS, ...) at a motion, {mode} and sizes"
        if function.is_step:
            openness = results.pop()
            returned = f"return np.array(np.broadcast_arrays({{}})), {openness}"
            what = f"{mode} after a step of Newton's method, and how far loops were open"
        items = _wrapped(", ".join(results), "        ")
        lines.append("        " + returned.format(f"\n        {items}\n        "))
        body = "\n".join(lines)
        parts.append(
            f"\ndef {function.name}(motion, {mode}, size=tuple(SIZES.values())):\n"
            f'    """Return the {what}."""\n    with np.errstate(all="ignore"):\n{body}\n'
        )
    return _jointly("\n".join(parts), source)


# Julia.

_SERIES_JULIA = """
const {name}_edges_{k} = {edges}
const {name}_coefficients_{k} = {values}

function {name}_profile_{k}(s)
    edges = {name}_edges_{k}
{wrapping}    cell = clamp(searchsortedlast(edges, s), 1, {cells})
    x = ((s - edges[cell]) + (s - edges[cell + 1])) / (edges[cell + 1] - edges[cell])
    map({name}_coefficients_{k}[cell]) do series
        sum, before = zero(x), zero(x)
        for order in {order}:-1:2
            sum, before = series[order] + 2x * sum - before, sum
        end
        series[1] + x * sum - before
    end
end
"""


def _julia(source: _Source) -> str:
    of, name, mode = source.of, source.name, source.mode
    modes = ", ".join(f"Float64{_nested(mode.values)}" for mode in of.modes)
    parts = [
        f"const {name}_results = {json.dumps([*of.results])}",
        f"const {name}_sizes = Float64{_nested([x.value for x in of.sizes])}",
        f"const {name}_modes = [{modes}]",
    ]
    for k, series in enumerate(source.series):
        cells, _, order = series.coefficients.shape
        length = _number(series.length)
        wrapping = f"    s = mod(s, {length})\n"
        if not series.closed:
            wrapping = f"    0 <= s <= {length} || return fill(oftype(s, NaN), 9)\n"
        parts.append(
            _SERIES_JULIA.format(
                name=name,
                k=k,
                edges=_wrapped(_nested(series.edges)),
                values=_wrapped(_nested(series.coefficients)),
                wrapping=wrapping,
                cells=cells,
                order=order,
            )
        )
    for function in source.functions:
        lines = [
            f"    profile_{k} = {name}_profile_{k}({arc})" for k, arc in function.series
        ]
        lines += source.body(function)
        results = list(function.results)
        last = f", {results.pop()}" if function.is_step else ""
        items = _wrapped(", ".join(results), "        ")
        lines.append(f"    return [\n        {items}\n    ]{last}")
        body = "\n".join(lines)
        parts.append(
            f"\nfunction {function.name}(motion, {mode}, size={name}_sizes)\n{body}\nend"
        )
    return _jointly("\n".join(parts), source)


# CasADi.

_SERIES_CASADI = """
_EDGES_{k} = {edges}
_COEFFICIENTS_{k} = {values}


def _profile_{k}(s):
{wrapping}    inner = _EDGES_{k}[1:-1]
    low = ca.pw_const(s, inner, _EDGES_{k}[:-1])
    high = ca.pw_const(s, inner, _EDGES_{k}[1:])
    x = ((s - low) + (s - high)) / (high - low)
    columns = []
    for column in zip(*_COEFFICIENTS_{k}, strict=True):
        orders = zip(*column, strict=True)
        first, *others = (ca.pw_const(s, inner, ca.DM(x)) for x in orders)
        total, before = 0.0, 0.0
        for series in reversed(others):
            total, before = series + 2.0 * x * total - before, total
        columns.append(first + x * total - before)
    return columns

"""


def _casadi(source: _Source) -> str:
    of, mode = source.of, source.mode
    parts = [_data_python(source).replace("import numpy as np", "import casadi as ca")]
    for k, series in enumerate(source.series):
        length = _number(series.length)
        wrapping = f"    s = s - ca.floor(s / {length}) * {length}\n"
        if not series.closed:
            wrapping = f"    s = ca.if_else((s >= 0) * (s <= {length}), s, ca.nan)\n"
        parts.append(
            _SERIES_CASADI.format(
                k=k,
                edges=_wrapped(_nested(series.edges)),
                values=_wrapped(_nested(series.coefficients)),
                wrapping=wrapping,
            )
        )
    for function in source.functions:
        counts = {"motion": len(of.motion), mode: len(of.places), "size": len(of.sizes)}
        lines = [f'    {x} = ca.SX.sym("{x}", {n})' for x, n in counts.items()]
        lines += [f"    profile_{k} = _profile_{k}({arc})" for k, arc in function.series]
        lines += source.body(function)
        results, names = list(function.results), ["result"]
        tail = ""
        if function.is_step:
            tail, names = f", {results.pop()}", ["after", "open"]
        given = f"[motion, {mode}, size]"
        items = _wrapped(", ".join(results), "        ")
        lines += [
            f"    results = ca.vertcat(\n        {items}\n    )",
            f'    names = ["motion", "{mode}", "size"], {json.dumps(names)}',
            f'    return ca.Function("{function.name}", {given}, [results{tail}], *names)',
        ]
        body = "\n".join(lines)
        parts.append(
            f"\ndef {function.name}():\n"
            f'    """Return it, of motion, {mode} and sizes."""\n{body}\n'
        )
    return _jointly("\n".join(parts), source)


_MAKERS: Mapping[Language, Callable[[_Source], str]] = {
    "c": _c,
    "cpp": _cpp,
    "js": _javascript,
    "python": _python,
    "julia": _julia,
    "casadi": _casadi,
}
