"""Kernels of which sizes are inputs: one for a topology, whatever its geometry.

What does not depend on the configuration is computed once a design (`prepare`), the rest
at every row (`evaluate`): a row is one sample of one design in one assembly mode. Closure
equations are there at complex inputs too: they are analytic, and off the real axis their
solutions neither meet nor vanish; compiled, real and imaginary parts are terms.

The closure equations of designs at any input, real or complex.

Sizes are real. The variables, the inputs among them, may be complex: the equations are
analytic, and off the real axis their solutions neither meet nor vanish.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Array, Floats
from spherekit.engine.algebra import Exprs, constants, cross, dot
from spherekit.engine.compiler import TermFunction, available, compile_function
from spherekit.engine.expression_graph import (
    Expr,
    ExpressionNode,
    function,
    hoisted,
    rewrite,
    symbols,
)
from spherekit.engine.row_quantities import VariedTerms
from spherekit.engine.system import array_function, term_function

Parts = tuple[Expr, Expr]
"""The real and the imaginary part."""


ComplexFunction = Callable[[Array, Floats], Array]
"""Gives values (outputs, n) at complex variables (variables, n) and numbers (k, n)."""


def complex_function(
    outputs: Sequence[Expr],
    variables: Sequence[ExpressionNode],
    numbers: Sequence[ExpressionNode],
    compiled: bool,
) -> ComplexFunction:
    """Return expressions of variables that are complex, and of real numbers.

    Raises
    ------
    KeyError
        If a term to be compiled is no sum, product, quotient, sine or cosine.
    """
    if not compiled:
        plain = array_function(outputs, [*variables, *numbers], complex)
        return lambda values, given: plain(np.concatenate([values, given.astype(complex)]))
    real = symbols(f"real_{k}" for k in range(len(variables)))
    imaginary = symbols(f"imaginary_{k}" for k in range(len(variables)))
    parts = dict(zip(variables, zip(real, imaginary, strict=True), strict=True))

    def apply(term: ExpressionNode, arguments: list[Parts]) -> Parts:
        if term.operation == "variable":
            return parts.get(term, (term, 0.0))
        return _OPERATIONS[term.operation](*arguments)

    made = rewrite(outputs, lambda number: (number, 0.0), apply)
    columns = [part[k] for k in (0, 1) for part in made]
    by_parts = compile_function(columns, [*real, *imaginary, *numbers])

    def at(values: Array, given: Floats) -> Array:
        rows = by_parts(np.concatenate([values.real, values.imag, given]))
        made = np.empty((len(outputs), values.shape[1]), dtype=complex)
        made.real, made.imag = rows[: len(outputs)], rows[len(outputs) :]
        return made

    return at


def _product(one: Parts, other: Parts) -> Parts:
    (a, b), (c, d) = one, other
    return a * c - b * d, a * d + b * c


def _quotient(one: Parts, other: Parts) -> Parts:
    (a, b), (c, d) = one, other
    square = c * c + d * d
    return (a * c + b * d) / square, (b * c - a * d) / square


def _sine(angle: Parts) -> Parts:
    a, b = angle
    return (
        function("sin", a) * function("cosh", b),
        function("cos", a) * function("sinh", b),
    )


def _cosine(angle: Parts) -> Parts:
    a, b = angle
    return (
        function("cos", a) * function("cosh", b),
        -(function("sin", a) * function("sinh", b)),
    )


_OPERATIONS: Mapping[str, Callable[..., Parts]] = {
    "+": lambda x, y: (x[0] + y[0], x[1] + y[1]),
    "-": lambda x, y: (x[0] - y[0], x[1] - y[1]),
    "*": _product,
    "/": _quotient,
    "sin": _sine,
    "cos": _cosine,
}


@dataclass(frozen=True)
class DesignKernel:
    """A function of designs and samples.

    `prepare` takes the sizes (variables, n) to what is the same at all samples of a design.
    `evaluate` takes a sample, the places of the links (then the columns of profiles that
    are handed in) and what is prepared to the
    `columns`, then to their derivatives, size by size, where they were asked for. Places
    are the sign of each dyad in closed form; then the first outputs, one for each dyad, are
    not negative where it closes. Otherwise they are the variables of all pairs.

    Loads that count turns take those (rad) of the pairs `turning`, after the places and the
    columns of profiles. `angles` is the function of the same rows that gives the first
    outputs and then the variables of these pairs less the turns.
    """

    places: tuple[str, ...]
    closed_form: bool
    columns: tuple[str, ...]
    prepare: TermFunction
    evaluate: TermFunction
    turning: tuple[str, ...] = ()
    angles: TermFunction | None = None

    @property
    def reaches(self) -> int:
        """How many outputs come before the columns."""
        return len(self.places) if self.closed_form else 0

    def at(
        self,
        samples: Floats,
        places: Floats,
        sizes: Floats,
        columns: Floats | None = None,
        turns: Floats | None = None,
    ) -> Floats:
        """Return what `evaluate` gives at samples (k, n) and places, of sizes (s, n or 1).

        With the columns of profiles that are handed in, and turns (pairs, n) rad, if any.
        """
        n = samples.shape[1]
        prepared = self.prepare(sizes)
        parts = [samples, places, *([] if columns is None else [columns])]
        parts.append(np.zeros((len(self.turning), n)) if turns is None else turns)
        parts.append(np.broadcast_to(prepared, (len(prepared), n)))
        with np.errstate(all="ignore"):
            return np.asarray(self.evaluate(np.concatenate(parts)))


def design_kernel(
    terms: VariedTerms,
    columns: Sequence[str],
    gradients: bool = False,
    compiled: bool = True,
) -> DesignKernel:
    """Return the kernel of a topology.

    Parameters
    ----------
    terms
        What it is written in.
    columns
        Names of `row_quantities`.
    gradients
        Whether their derivatives by all sizes are wanted too.
    compiled
        Whether to compile, where heyoka is installed, or to be ready at once.

    Raises
    ------
    EngineError
        If a column is not known.
    """
    outputs = [terms.quantity(name) for name in columns]
    if gradients:
        outputs += [slope for slopes in terms.by_sizes(outputs) for slope in slopes]
    squares = terms.squares
    torques = any(column.split("_by_")[0] == "torque" for column in columns)
    turns = terms.turns if torques else {}
    angles = [terms.angle(pair) for pair in turns]
    moving = [*terms.sample, *terms.places, *terms.handed_in, *turns.values()]
    row_terms, fixed = hoisted([*squares, *outputs, *angles], moving, "design_")
    count, every = len(squares) + len(outputs), [*moving, *fixed]
    compiled = compiled and available()
    return DesignKernel(
        tuple(place.arguments[0] for place in terms.places),
        terms.closed_form,
        tuple(columns),
        term_function(list(fixed.values()), terms.sizes, compiled),
        term_function(row_terms[:count], every, compiled),
        tuple(turns),
        term_function([*row_terms[: len(squares)], *row_terms[count:]], every, compiled)
        if turns
        else None,
    )


def arc_function(terms: VariedTerms) -> tuple[tuple[int, ...], TermFunction]:
    """Return the links with two axes, and the function of sizes that gives their arcs.

    The arcs (links, n) are in [0, pi] rad.
    """
    mechanism, pairs = terms.structure.mechanism, terms.structure.pairs
    axes: dict[int, list[Exprs]] = {k: [] for k in range(len(mechanism.links))}
    for pair, ends in enumerate(mechanism.ends):
        if pair not in pairs.sides:
            for link, axis in zip(ends, pairs.axes(pair), strict=True):
                axes[link].append(constants(axis))
    links = tuple(link for link, directions in axes.items() if len(directions) == 2)
    arcs = []
    for link in links:
        one, other = axes[link]
        normal = cross(one, other)
        arcs.append(function("atan2", np.sqrt(dot(normal, normal)), dot(one, other)))
    return links, array_function(arcs, terms.sizes)


@dataclass(frozen=True)
class At:
    """Equations at n places: Newton's `step` (variables, n) and the `rates` by the inputs.

    `rates` (inputs, variables, n), `determinant` (n,) of the equations, `open` (n,) the
    square of how far loops are open.
    """

    step: Array
    rates: Array
    determinant: Array
    open: Array


@dataclass(frozen=True)
class PathKernel:
    """Newton's step and the rates of a topology whose sizes are inputs.

    `prepare` takes the sizes (sizes, n) to what is the same at all samples of a design,
    `real` and `complex` variables, the columns of profiles that are handed in, and these to
    `At`; `turning` to the triple products that dyads are named by, `groups` has ``+`` for
    each of them and ``~`` for other groups. `driven` are the inputs that rates are by.
    """

    variables: int
    driven: list[int]
    prepare: TermFunction
    real: TermFunction
    complex: ComplexFunction | None
    groups: str
    turning: TermFunction

    def labels(self, values: Floats, prepared: Floats) -> list[str]:
        """Return the signs of dyads, ``~`` for other groups, at closed configurations."""
        rows = np.concatenate([values, prepared])
        signs = iter(np.where(self.turning(rows) >= 0.0, "+", "-"))
        columns = [next(signs) if g == "+" else None for g in self.groups]
        width = values.shape[1]
        return [
            "".join("~" if column is None else str(column[k]) for column in columns)
            for k in range(width)
        ]

    def at(self, values: Array, prepared: Floats) -> At:
        """Return what the equations are at values (variables, n) and prepared (k, n)."""
        if np.iscomplexobj(values) and self.complex is not None:
            columns = self.complex(values, prepared)
        else:
            columns = self.real(np.concatenate([values, prepared]))
        v, k = self.variables, len(self.driven)
        rates = columns[v : (k + 1) * v].reshape(k, v, values.shape[1])
        return At(columns[:v], rates, columns[-2], columns[-1])


def path_kernel(
    terms: VariedTerms, compiled: bool = True, alone: bool = False
) -> PathKernel:
    """Return the kernel; `terms` are of variables, not of signs.

    Newton's step `alone` is real, and without rates.
    """
    structure, flow, places = terms.structure, terms.flow, terms.places
    change, determinant = flow.answers(flow.misfits), flow.scale
    for variable, angle in enumerate(terms.variables):
        if angle is not places[variable]:
            change[variable] = angle - places[variable]
    rates: list[list[Expr]] = []
    if not alone:
        rates = [[rate / determinant for rate in tau] for tau in flow.tau]
    outputs = [*change, *(rate for row in rates for rate in row), determinant]
    outputs.append(flow.openness)
    dyads = [group for group in structure.assembly.groups if group.is_dyad and not alone]
    turning = []
    for group in dyads:
        owned = [structure.mechanism.variables_of(pair) for pair in group.pairs]
        axes = [flow.vectors[variable] for (variable,) in owned]
        turning.append(dot(axes[0], cross(axes[1], axes[2])))
    given = [*places, *terms.handed_in]
    rows, fixed = hoisted([*outputs, *turning], given, "design_")
    rows, turning = rows[: len(outputs)], rows[len(outputs) :]
    inputs = [*given, *fixed]
    compiled = compiled and available()
    return PathKernel(
        len(places),
        [] if alone else list(structure.inputs),
        term_function(list(fixed.values()), terms.sizes, compiled),
        term_function(rows, inputs, compiled),
        None if alone else complex_function(rows, places, inputs[len(places) :], compiled),
        "".join("+" if group.is_dyad else "~" for group in structure.assembly.groups),
        array_function(turning, inputs),
    )
