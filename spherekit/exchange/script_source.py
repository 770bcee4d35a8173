"""Formulas as JavaScript, Julia, and Python on NumPy or on CasADi's `SX`."""

from collections.abc import Iterable, Iterator
from pprint import pformat

from spherekit.conventions import Facts
from spherekit.escaping import (
    javascript_comment,
    json_text,
    julia_comment,
    julia_string,
    python_comment,
)
from spherekit.exchange import identifiers
from spherekit.exchange.source_printer import (
    WIDTH,
    Language,
    Source,
    calls,
    nested,
    nested_special,
    wrapped,
)

_RAISE = {"sqrt": "x < 0", "asin": "abs(x) > 1", "acos": "abs(x) > 1", "log": "x < 0"}
"""Where functions of Julia raise that elsewhere are NaN."""

JS = Language(
    "JavaScript",
    calls("Math.", {"sign": "Math.sign({0})", "maximum": "Math.max({0}, {1})"}),
    "  const {0} = {1};",
    "  const table_{k} = {name}_table_{k}({place});",
    "// ",
    javascript_comment,
    identifiers.JAVASCRIPT,
    {},
    "NaN",
)
JULIA = Language(
    "Julia",
    calls(
        "",
        {name: f"{name}_or_nan({{0}})" for name in _RAISE}
        | {
            "atan2": "atan({0}, {1})",
            "sign": "sign({0})",
            "maximum": "max({0}, {1})",
            "**": "{0} ^ {1}",
        },
    ),
    "    {0} = {1}",
    "    table_{k} = {name}_table_{k}({place})",
    "# ",
    julia_comment,
    identifiers.JULIA,
    {
        name: f"{name}_or_nan(x) = {where} ? oftype(float(x), NaN) : {name}(x)\n"
        for name, where in _RAISE.items()
    },
    "NaN",
    1,
)
PYTHON = Language(
    "Python",
    calls(
        "np.",
        {name: f"np.arc{name[1:]}({{0}})" for name in ("asin", "acos", "atan")}
        | {
            "atan2": "np.arctan2({0}, {1})",
            "sign": "np.sign({0})",
            "maximum": "np.maximum({0}, {1})",
            "**": "np.power({0}, {1})",
        },
    ),
    "        {0} = {1}",
    "        table_{k} = _table_{k}({place})",
    "# ",
    python_comment,
    identifiers.PYTHON,
    {},
    "np.nan",
)
CASADI = Language(
    "Python",
    calls(
        "ca.",
        {
            "sign": "ca.sign({0})",
            "maximum": "ca.fmax({0}, {1})",
            "**": "{0} ** {1}",
        },
    ),
    "    {0} = {1}",
    "    table_{k} = _table_{k}({place})",
    "# ",
    python_comment,
    identifiers.CASADI,
    {},
    'float("nan")',
)


def _tables(source: Source, form: str, closed: str, opened: str) -> Iterator[str]:
    """Yield the functions that read tables, in the form of a language."""
    for table in source.series:
        values = {key: wrapped(nested(table[key])) for key in ("edges", "coefficients")}
        around = (closed if table["closed"] else opened).format(**table)
        yield form.format(**{**table, **values}, around=around)


def _joined(source: Source, parts: list[str]) -> str:
    return "\n".join([source.comment, *source.helpers, *parts]) + "\n"


_SERIES_JS = """\
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


_SMOOTH_JS = """\
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
_MOVED_JS = """\
  if (!(q >= {low} && q <= {high})) {{
    const above = q - Math.floor((q - {low}) / {period}) * {period};
    q = above - {high} > {low} - above + {period} ? above - {period} : above;
  }}
"""


def _smooth_modes_js(source: Source) -> Iterator[str]:
    """Yield the function that gives the places of a mode on its smooth curve."""
    if source.smooth is None:
        return
    numbers, arrays = _smooth_arrays(source, "NaN", "Infinity")
    inputs, returned = "", source.mode
    if source.of.step:
        inputs = f"  const inputs = {arrays['inputs']};\n"
        returned = "Number.isNaN(q) ? NaN : inputs[interval][k]"
    moved = _MOVED_JS.format(**numbers) if source.returns else ""
    numbers |= {**arrays, "inputs": inputs}
    yield _SMOOTH_JS.format(**numbers, moved=moved, returned=returned)


def _smooth_arrays(
    source: Source, not_a_number: str, infinity: str
) -> tuple[Facts, dict[str, str]]:
    """Return the numbers of smooth modes, and their arrays as texts."""
    numbers = source.smooth_numbers
    arrays = {
        key: nested_special(numbers[key], "[]", not_a_number, infinity)
        for key in ("starts", "places", "inputs")
    }
    return numbers, arrays


def javascript(source: Source) -> str:
    """Return an ES module."""
    of, name = source.of, source.name
    about = {
        "mechanism": of.mechanism.name,
        "motion": [x.name for x in of.motion],
        "modes": [mode._asdict() for mode in of.modes],
        "sizes": [size._asdict() for size in of.sizes],
        "results": [{"name": x, "unit": unit} for x, unit in of.results.items()],
        "closed_form": not of.step,
    }
    closed = "  s -= Math.floor((s - {low}) / {length}) * {length};\n"
    opened = (
        "  if (!(s >= {low} && s <= {high}))\n    return new Array({columns}).fill(NaN);\n"
    )
    parts = [f"export const {name}_about = {json_text(about, indent=1)};\n"]
    parts += _tables(source, _SERIES_JS, closed, opened)
    for function in source.functions:
        given, lines = ", ".join(source.given), [*function.lines]
        to = source.mode
        if not function.opening:
            to = "result"
            given += f", result = new Float64Array({len(function.results)})"
        lines += [f"  {to}[{k}] = {x};" for k, x in enumerate(function.results)]
        lines.append(f"  return {function.opening or to};")
        body = "\n".join(lines)
        parts.append(f"export function {function.name}({given}) {{\n{body}\n}}\n")
    return _joined(source, [*parts, *_smooth_modes_js(source)])


_SERIES_JULIA = """\
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


_SMOOTH_JULIA = """\
function {name}(k, q)
    starts = {starts}
    places = {places}
{inputs}{moved}    interval = max(1, searchsortedlast(starts, q))
    {mode} = isnan(q) ? fill(NaN, {count}) : Float64.(places[interval][k])
    return {returned}
end
"""
_MOVED_JULIA = """\
    if !({low} <= q <= {high})
        above = q - floor((q - {low}) / {period}) * {period}
        q = above - {high} > {low} - above + {period} ? above - {period} : above
    end
"""


def _smooth_modes_julia(source: Source) -> Iterator[str]:
    """Yield the function that gives the places of a mode on its smooth curve."""
    if source.smooth is None:
        return
    numbers, arrays = _smooth_arrays(source, "NaN", "Inf")
    inputs, returned = "", source.mode
    if source.of.step:
        inputs = f"    inputs = {arrays['inputs']}\n"
        returned = f"{source.mode}, isnan(q) ? NaN : inputs[interval][k]"
    moved = _MOVED_JULIA.format(**numbers) if source.returns else ""
    numbers |= {**arrays, "inputs": inputs}
    yield _SMOOTH_JULIA.format(**numbers, moved=moved, returned=returned)


def julia(source: Source) -> str:
    """Return functions of vectors."""
    of, name = source.of, source.name
    modes = ", ".join(f"Float64{nested(mode.values)}" for mode in of.modes)
    parts = [
        f"const {name}_results = [\n    {_items(map(julia_string, of.results))}\n]",
        f"const {name}_sizes = Float64{nested([x.value for x in of.sizes])}",
        f"const {name}_modes = [{modes}]\n",
    ]
    parts += _tables(
        source,
        _SERIES_JULIA,
        "    s -= floor((s - {low}) / {length}) * {length}\n",
        "    {low} <= s <= {high} || return fill(oftype(float(s), NaN), {columns})\n",
    )
    for function in source.functions:
        last = function.opening and f", {function.opening}"
        values = _items(function.results, 8)
        lines = [*function.lines, f"    return [\n        {values}\n    ]{last}"]
        body = "\n".join(lines)
        given = f"motion, {source.mode}, size={name}_sizes"
        parts.append(f"function {function.name}({given})\n{body}\nend\n")
    return _joined(source, [*parts, *_smooth_modes_julia(source)])


def _items(items: Iterable[str], indent: int = 4) -> str:
    return wrapped(", ".join(items), " " * indent)


_DATA = """\
import {library}

MOTION = {motion}
SIZES = {sizes}
RESULTS = {results}
MODES = {modes}
"""


def _data(source: Source, library: str) -> str:
    of = source.of
    words = {
        "motion": [x.name for x in of.motion],
        "sizes": {x.name: x.value for x in of.sizes},
        "results": of.results,
        "modes": {mode.number: mode.values for mode in of.modes},
    }
    texts = {key: pformat(x, width=WIDTH, sort_dicts=False) for key, x in words.items()}
    return _DATA.format(library=library, **texts)


_SERIES_PYTHON = """
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


_SMOOTH_PYTHON = """
def {name}(number, q):
    \"\"\"Return the {mode} (..., as q) of an assembly mode at inputs q (rad){more}.\"\"\"
    starts = np.array(
        {starts}
    )
    places = np.array(
        {places}
    )
{inputs}    q = np.asarray(q, dtype=float)
{moved}    interval = np.searchsorted(starts[1:], q, side="right")
    mode = list(MODES).index(number)
    {mode}_there = np.moveaxis(places[interval, mode], -1, 0)
    return {returned}
"""
_MOVED_PYTHON = """\
    above = q - np.floor((q - {low}) / {period}) * {period}
    above = np.where(above - {high} > {low} - above + {period}, above - {period}, above)
    q = np.where((q >= {low}) & (q <= {high}), q, above)
"""
_MORE_INPUTS = ", and inputs at which it has them"


def _smooth_modes_python(source: Source) -> Iterator[str]:
    """Yield the function that gives the places of a mode on its smooth curve."""
    if source.smooth is None:
        return
    numbers, arrays = _smooth_arrays(source, "np.nan", "np.inf")
    inputs = more = ""
    returned = f"np.where(np.isnan(q), np.nan, {source.mode}_there)"
    if source.of.step:
        inputs = f"    inputs = np.array(\n        {arrays['inputs']}\n    )\n"
        returned += ", np.where(np.isnan(q), np.nan, inputs[interval, mode])"
        more = _MORE_INPUTS
    moved = _MOVED_PYTHON.format(**numbers) if source.returns else ""
    numbers |= {**arrays, "inputs": inputs}
    yield _SMOOTH_PYTHON.format(**numbers, moved=moved, returned=returned, more=more)


def python(source: Source) -> str:
    """Return functions of arrays, by NumPy."""
    parts = [_data(source, "numpy as np")]
    parts += _tables(
        source,
        _SERIES_PYTHON,
        "    s = s - np.floor((s - {low}) / {length}) * {length}\n",
        "    s = np.where((s >= {low}) & (s <= {high}), s, np.nan)\n",
    )
    for function in source.functions:
        last = function.opening and f", {function.opening}"
        what = "the RESULTS (results, ...)"
        if last:
            what = "variables after a step of Newton's method, and how far loops were open"
        made = (
            f"np.broadcast_arrays(\n            {_items(function.results, 12)}\n        )"
        )
        body = "\n".join([*function.lines, f"        return np.array({made}){last}"])
        given = f"motion, {source.mode}, size=tuple(SIZES.values())"
        parts.append(
            f'\ndef {function.name}({given}):\n    """Return {what}."""\n'
            f'    with np.errstate(all="ignore"):\n{body}\n'
        )
    return _joined(source, [*parts, *_smooth_modes_python(source)])


_SERIES_CASADI = """
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


_SMOOTH_CASADI = """
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
_MOVED_CASADI = """\
    above = q - ca.floor((q - {low}) / {period}) * {period}
    is_nearer_below = above - {high} > {low} - above + {period}
    above = ca.if_else(is_nearer_below, above - {period}, above)
    q = ca.if_else((q >= {low}) * (q <= {high}), q, above)
"""


def _smooth_modes_casadi(source: Source) -> Iterator[str]:
    """Yield the function that gives the places of a mode on its smooth curve."""
    if source.smooth is None:
        return
    numbers, arrays = _smooth_arrays(source, 'float("nan")', 'float("inf")')
    inputs = more = first_input = next_input = ""
    returned = f"{source.mode}_there"
    if source.of.step:
        inputs = f"    inputs = {arrays['inputs']}\n"
        first_input = "known_input = ca.DM(inputs[0][mode])\n    "
        next_input = (
            "        known_input = ca.if_else(\n"
            "            is_beyond, inputs[interval][mode], known_input\n        )\n"
        )
        returned += ", known_input"
        more = _MORE_INPUTS.replace("inputs", "the input")
    moved = _MOVED_CASADI.format(**numbers) if source.returns else ""
    numbers |= {**arrays, "inputs": inputs}
    yield _SMOOTH_CASADI.format(
        **numbers,
        moved=moved,
        returned=returned,
        more=more,
        first_input=first_input,
        next_input=next_input,
    )


def casadi(source: Source) -> str:
    """Return what makes functions of CasADi, which it differentiates and generates."""
    of, parts = source.of, [_data(source, "casadi as ca")]
    parts += _tables(
        source,
        _SERIES_CASADI,
        "    s = s - ca.floor((s - {low}) / {length}) * {length}\n",
        '    s = ca.if_else((s >= {low}) * (s <= {high}), s, float("nan"))\n',
    )
    counts = zip(source.given, map(len, (of.motion, of.places, of.sizes)), strict=True)
    symbols = [f'    {word} = ca.SX.sym("{word}", {n})' for word, n in counts]
    names = json_text([*source.given])
    for function in source.functions:
        last = function.opening and f", {function.opening}"
        made = '["after", "open"]' if last else '["result"]'
        arguments = f'"{function.name}", given, [values{last}], {names}, {made}'
        lines = [
            *function.lines,
            f"    values = ca.vertcat(\n        {_items(function.results, 8)}\n    )",
            f"    given = [{', '.join(source.given)}]",
            f"    return ca.Function({arguments})",
        ]
        body = "\n".join([*symbols, *lines])
        doc = f'    """Return the function of {", ".join(source.given)}."""'
        parts.append(f"\ndef {function.name}():\n{doc}\n{body}\n")
    return _joined(source, [*parts, *_smooth_modes_casadi(source)])
