"""Formulas as lines of a language: one assignment for each term, and what stands around.

Terms are printed as they are, for what occurs twice is one term already, and C returns what
NumPy's arrays do. CasADi's generator makes 2 to 6 % fewer operations of them, as it counts
a square or an opposite for one.
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from textwrap import wrap
from typing import Any, NamedTuple

import numpy as np

from spherekit.escaping import one_line
from spherekit.exchange.formula_expressions import Formulas, SmoothModes
from spherekit.exchange.identifiers import NameRules, unique_names
from spherekit.symbolic.expression_graph import Expr, ExpressionNode, iterate_nodes
from spherekit.version import __version__
from spherekit.wording import counted, listing

KINDS = ("motion", "mode", "size")
"""The arguments of a source, in the order of `Formulas.variables`."""
_CIRCULAR = ("sin", "cos", "tan", "asin", "acos", "atan")
CALLS = (*_CIRCULAR, "sqrt", "exp", "log", "tanh", "cosh", "sinh")
"""Functions of one argument."""
WIDTH = 84
OTHER_CROSSINGS = (
    "Curves may also cross at inputs that are not known: crossings are found with dyads, "
    "triads and trains of wheels only"
)
"""Said of mechanisms whose crossings may not all be known."""


@dataclass(frozen=True)
class Language:
    """How a language writes what others write otherwise.

    `operations` are formats by the name of an operation of terms, `helpers` what some of
    these need, `assignment` is that of a name, `table` that of what a table gives,
    `comment` begins a line, `comment_text` escapes what follows there, `names` are the
    rules for names of functions, `not_a_number` is the constant NaN, and `index` is the
    number of the first place of an array.
    """

    name: str
    operations: Mapping[str, str]
    assignment: str
    table: str
    comment: str
    comment_text: Callable[[str], str]
    names: NameRules
    helpers: Mapping[str, str]
    not_a_number: str
    index: int = 0
    literal: str = "{0}"


def calls(prefix: str, others: Mapping[str, str]) -> dict[str, str]:
    """Return the operations of a language whose functions have a prefix, but for others."""
    made = {name: f"{{0}} {name} {{1}}" for name in "+-*/"}
    made |= {name: f"{prefix}{name}({{0}})" for name in CALLS}
    made |= {"atan2": f"{prefix}atan2({{0}}, {{1}})", "**": f"{prefix}pow({{0}}, {{1}})"}
    return {**made, **others}


class Function(NamedTuple):
    """A function in a language.

    Its `lines` are assignments, `results` names or numbers, and of Newton's step `opening`
    how far loops were open; `used` are the arguments that are.
    """

    name: str
    lines: list[str]
    results: list[str]
    opening: str
    used: set[str]


class Source:
    """Formulas with their names and lines in a language.

    Attributes
    ----------
    name
        The name of the function, which the language allows.
    results
        The names of the results, in their order, as they end in enumerators.
    """

    def __init__(self, formulas: Formulas, language: Language) -> None:
        self.of, self.language = formulas, language
        self.name = language.names.identifier(formulas.mechanism.name)
        endings = [re.sub(r"\W", "_", name, flags=re.ASCII) for name in formulas.results]
        self.results = unique_names(endings)
        self.mode = "variables" if formulas.step else "mode"
        self.given = ("motion", self.mode, "size")
        self.smooth_name = f"{self.name}_smooth_{self.mode}"

    @cached_property
    def functions(self) -> list[Function]:
        """The function of the results, and where there is one, that of Newton's step."""
        made = [self._function(self.name, self.of.outputs)]
        if self.of.step:
            made.append(self._function(f"{self.name}_step", self.of.step))
        return made

    def _function(self, name: str, outputs: Sequence[Expr]) -> Function:
        first, called = self.language.index, dict[ExpressionNode, str]()
        for word, terms in zip(self.given, self.of.variables, strict=True):
            called |= {term: f"{word}[{k + first}]" for k, term in enumerate(terms)}
        owners: dict[ExpressionNode, int] = {}
        for k, table in enumerate(self.of.tables):
            owners |= dict.fromkeys(table.terms, k)
            columns = enumerate(table.terms, first)
            called |= {term: f"table_{k}[{c}]" for c, term in columns}
        lines, tables, used = list[str](), dict[int, str](), set[str]()
        for term in iterate_nodes(outputs):
            if term.operation != "variable":
                parts = [self._part(x, called) for x in term.arguments]
                called[term] = f"t{len(lines)}"
                text = self.language.operations[term.operation].format(*parts)
                lines.append(self.language.assignment.format(called[term], text))
                continue
            if term in owners:
                k = owners[term]
                table, term = self.of.tables[k], self.of.tables[k].of
                place = f"{called[term]} + {self._literal(table.start)}"
                tables[k] = self.language.table.format(
                    k=k, name=self.name, place=place, columns=len(table.terms)
                )
            used.add(called[term].partition("[")[0])
        results = [self._part(x, called) for x in outputs]
        opening = results.pop() if outputs is self.of.step else ""
        return Function(name, [*tables.values(), *lines], results, opening, used)

    def _part(self, item: Expr, called: Mapping[ExpressionNode, str]) -> str:
        if isinstance(item, ExpressionNode):
            return called[item]
        if np.isnan(item):
            return self.language.not_a_number
        text = self._literal(float(item))
        return f"({text})" if text[0] == "-" else text

    def _literal(self, x: float) -> str:
        return self.language.literal.format(number(x))

    @property
    def helpers(self) -> list[str]:
        """What operations need that the language does not have."""
        every = {
            term.operation for term in iterate_nodes([*self.of.outputs, *self.of.step])
        }
        helpers = self.language.helpers
        return [text for name, text in helpers.items() if name in every]

    @property
    def head(self) -> Iterator[str]:
        """The lines that say what the source is of."""
        of = self.of
        title = f"{of.mechanism.name}: {of.title}, made by spherekit {__version__}."
        yield from wrap(title, WIDTH)
        if of.mechanism.source:
            yield from wrap(one_line(of.mechanism.source.citation), WIDTH)
        for renamed in self.renamed:
            yield from wrap(renamed, WIDTH)
        yield ""
        yield from wrap(self._method, WIDTH)
        if self.smooth is not None:
            yield from wrap(self._smooth_curves, WIDTH)
        places = "rad" if of.step else "+1 or -1: the side of a dyad"
        rows = {
            "motion": [(x.name, x.unit) for x in of.motion],
            self.mode: [(name, places) for name in of.places],
            "size": [(x.name, f"{x.unit}; {x.key} = {x.value:.12g}") for x in of.sizes],
            "result": [*of.results.items()],
        }
        for kind, named in rows.items():
            yield from ("", f"{kind}:" + ("" if named else " none"))
            for k, (name, note) in enumerate(named):
                place = k + self.language.index
                yield f"  [{place}] {name}" + (f" ({note})" if note else "")
        yield from ("", "assembly modes, each with inputs (rad) at which it is known:")
        for k, mode in enumerate(of.modes):
            text = ", ".join(f"{x:.9g}" for x in mode.values) or "none"
            at = ", ".join(f"{q:.6g}" for q in mode.at)
            yield f"  {mode.number} ({mode.name}): {self.mode} {text}; inputs {at}"
            pieces = self.smooth.pieces(k) if self.smooth else []
            for start, known_input, signs in pieces if len(pieces) > 1 else []:
                text = ", ".join(f"{x:.9g}" for x in signs)
                yield (
                    f"    from {start:.6g} rad on: {self.mode} {text}; "
                    f"input {known_input:.6g}"
                )
        for reason in of.mode_table.left_out:
            yield from wrap(f"  not written: {reason}", WIDTH, subsequent_indent="    ")
        if of.mode_table.compared:
            yield from wrap(self._comparison, WIDTH)

    @property
    def smooth(self) -> SmoothModes | None:
        """The modes along smooth curves, if they follow these and have places at all."""
        return self.of.mode_table.smooth if self.of.places else None

    @property
    def _method(self) -> str:
        """The sentences on how positions are computed."""
        if self.of.step:
            return (
                f"Loops are closed by steps of Newton's method, {self.name}_step, from the "
                "variables of a mode below or of the sample before: repeat until what it "
                "returns, by how much loops were open (rad), is small."
            )
        method = "Nothing is iterated; results are NaN where the mode does not close."
        if self.of.mode_table.smooth is not None:
            return method
        return method + (
            " A mode is one side of each dyad: where a dyad is in line at an input, at a "
            "change point, a motion without a jump may continue on the other side."
        )

    @property
    def _smooth_curves(self) -> str:
        """The sentences on modes that follow smooth curves through crossings."""
        smooth = self.smooth
        assert smooth is not None
        range_text = f"between {smooth.low:.6g} and {smooth.high:.6g} rad"
        unknown = "" if smooth.are_all_known else f" {OTHER_CROSSINGS}."
        if not smooth.crossings and smooth.are_all_known:
            return f"A mode is a smooth curve. No curves cross {range_text}."
        if not smooth.crossings:
            return f"A mode is a smooth curve as far as crossings are known.{unknown}"
        crossings = listing(f"{q + 0.0:.6g}" for q in np.round(smooth.crossings, 12))
        if self.of.step:
            use = (
                f"{self.smooth_name} gives variables of a mode, and the input at which it "
                "has them, on the same side of all crossings as an input: steps from there "
                "pass no crossing, where Newton's method may go on along either curve."
            )
        else:
            use = (
                f"{self.smooth_name} gives the sides of the dyads of a mode at an input. "
                "They change at crossings, and are NaN within 1e-6 rad of these."
            )
        if np.isfinite(smooth.period):
            use += (
                " An input outside of the range is moved by whole periods into it, or as "
                "near as they lead."
            )
        return (
            f"A mode is a smooth curve. Curves cross {range_text} at {crossings} rad. "
            f"{use}{unknown}"
        )

    @property
    def smooth_numbers(self) -> dict[str, Any]:
        """Names, numbers and arrays of the function that gives places at an input.

        Arrays are those of `SmoothModes`; `intervals`, `modes` and `count` are the lengths
        of the axes of the places.
        """
        smooth = self.smooth
        assert smooth is not None
        intervals, modes, count = smooth.places.shape
        return {
            "name": self.smooth_name,
            "mode": self.mode,
            "low": in_brackets(smooth.low),
            "high": in_brackets(smooth.high),
            "period": number(smooth.period),
            "starts": np.array(smooth.starts),
            "places": smooth.places,
            "inputs": smooth.inputs,
            "intervals": intervals,
            "modes": modes,
            "count": count,
        }

    @property
    def returns(self) -> bool:
        """Whether all configurations return after a period of the only input."""
        return self.smooth is not None and bool(np.isfinite(self.smooth.period))

    @property
    def _comparison(self) -> str:
        """The sentences on the comparison of modes before the source was written."""
        table = self.of.mode_table
        difference = f"to {table.largest_difference:.1e} rad"
        return (
            "Before this file was written, each mode was compared with the mechanism at "
            f"{counted(table.compared, 'input')} or more. "
            + (
                f"Steps from variables beside a configuration return to it {difference}."
                if self.of.step
                else f"All pair variables agree {difference}."
            )
        )

    @property
    def renamed(self) -> Iterator[str]:
        """The sentences on names that are other ones in the language."""
        name, language = self.of.mechanism.name, self.language.name
        if self.name != name:
            yield (
                f"The mechanism {name} is called {self.name} here, as names in {language} "
                "cannot begin with a digit or be words that it or its libraries use."
            )
        for name, ending in zip(self.of.results, self.results, strict=True):
            if ending != name:
                yield f"The result {name} is called {ending} here."

    @property
    def comment(self) -> str:
        """The head as a comment."""
        language = self.language
        lines = (language.comment + language.comment_text(line) for line in self.head)
        return "".join(line.rstrip() + "\n" for line in lines)

    @property
    def series(self) -> Iterator[dict[str, Any]]:
        """What sources say of each table.

        Cells, columns, the order of the polynomials, their coefficients (cells, columns,
        order) and edges (cells + 1,) of cells, and the length of what is closed.
        """
        for k, table in enumerate(self.of.tables):
            coefficients = np.swapaxes(table.series.coefficients, 1, 2)
            yield {
                "name": self.name,
                "k": k,
                **dict(zip(("cells", "columns", "order"), coefficients.shape, strict=True)),
                "edges": table.series.edges,
                "coefficients": coefficients,
                "length": self._literal(table.length),
                "low": self._literal(table.series.edges[0]),
                "high": self._literal(table.series.edges[-1]),
                "closed": table.closed,
            }


def number(x: float) -> str:
    """Return the shortest text that reads as the same number."""
    return repr(float(x))


def in_brackets(x: float) -> str:
    """Return a number as text, in brackets if it is negative."""
    return f"({number(x)})" if x < 0.0 else number(x)


def nested(values: Any, brackets: str = "[]", literal: str = "{0}") -> str:
    """Return numbers in brackets, arrays of arrays in those of their own."""
    if np.ndim(values):
        items = (nested(item, brackets, literal) for item in values)
        return brackets[0] + ", ".join(items) + brackets[1]
    return literal.format(number(values))


def nested_special(values: Any, brackets: str, not_a_number: str, infinity: str) -> str:
    """Return numbers in brackets as `nested` does, with NaN and infinity by their names."""
    text = re.sub(r"\bnan\b", not_a_number, nested(values, brackets))
    return wrapped(re.sub(r"\binf\b", infinity, text))


def wrapped(text: str, indent: str = "    ") -> str:
    """Return a long list of numbers in lines of bearable length."""
    return f"\n{indent}".join(wrap(text, WIDTH, break_long_words=False))
