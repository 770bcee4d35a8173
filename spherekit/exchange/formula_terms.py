"""The formulas of a mechanism as data, from which sources in any language are printed.

`spherekit.exchange.formulas` makes them.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import Names
from spherekit.engine.expression_graph import (
    Expr,
    ExpressionNode,
    array_function,
    in_order,
)
from spherekit.model.mechanism import Mechanism
from spherekit.numeric.chebyshev import PiecewiseChebyshev

FormulaFunction = Callable[[Floats, Floats, Floats], Floats]
"""A function of a motion, places and sizes; see `Formulas.numpy_function`."""


class Argument(NamedTuple):
    """A number that a source is given: its unit, and its value in the file (rad, SI).

    `key` is that of the file, where it has one.
    """

    name: str
    unit: str
    value: float = 0.0
    key: str = ""


class Mode(NamedTuple):
    """An assembly mode: the inputs `at` (rad) at which it is known, and its places there.

    `values` are the signs of dyads, or the variables (rad) of all pairs.
    """

    number: int
    name: str
    at: tuple[float, ...]
    values: tuple[float, ...]


class ModeTable(NamedTuple):
    """The assembly modes that a source names, and how they were compared.

    Attributes
    ----------
    modes
        The modes that are written.
    left_out
        A sentence for each assembly mode that is not written: which one, and why.
    compared
        The least number of inputs at which a mode was compared with the mechanism, 0 if
        none was compared.
    largest_difference
        The largest difference (rad) of a pair variable in these comparisons.
    """

    modes: tuple[Mode, ...]
    left_out: Names = ()
    compared: int = 0
    largest_difference: float = 0.0


class SeriesTable(NamedTuple):
    """Functions that `terms` stand for, as series in a place: a variable plus `start`.

    Beyond the cells they are repeated after the `length` of a `closed` curve, else NaN.
    """

    terms: tuple[ExpressionNode, ...]
    of: ExpressionNode
    start: float
    series: PiecewiseChebyshev
    length: float
    closed: bool

    def at(self, variable: Floats) -> Floats:
        """Return the functions (terms, n) at values (n,) of the variable."""
        edges = self.series.edges
        place = variable + self.start
        if self.closed:
            place = edges[0] + np.mod(place - edges[0], self.length)
        columns = self.series.at(place)
        columns[~((place >= edges[0]) & (place <= edges[-1]))] = np.nan
        return np.asarray(columns.T)


@dataclass(frozen=True, eq=False, repr=False)
class Formulas:
    """What a source computes, and of what.

    Attributes
    ----------
    mechanism
        The mechanism, driven at its inputs.
    motion
        The inputs (rad) and, where results follow from them, their rates and accelerations,
        the time, turns of passive pairs and torques of tables.
    places
        Names of the signs of dyads, or of the variables of all pairs.
    sizes
        What is varied.
    mode_table
        The assembly modes.
    results
        The unit of each result, by name.
    outputs
        The results as terms.
    step
        Without a closed form: all variables after a step of Newton's method, and how far
        (rad) loops were open before.
    variables
        The terms that the motion, the places and the sizes are.
    tables
        Series of functions that the results are made of, such as profiles.
    title
        What the formulas are.
    """

    mechanism: Mechanism
    motion: tuple[Argument, ...]
    places: Names
    sizes: tuple[Argument, ...]
    mode_table: ModeTable
    results: dict[str, str]
    outputs: tuple[Expr, ...]
    step: tuple[Expr, ...]
    variables: tuple[tuple[ExpressionNode, ...], ...]
    tables: tuple[SeriesTable, ...]
    title: str = "explicit formulas"

    @property
    def modes(self) -> tuple[Mode, ...]:
        """The assembly modes that are written."""
        return self.mode_table.modes

    @property
    def operations(self) -> int:
        """How many operations the results take."""
        return sum(term.operation != "variable" for term in in_order(self.outputs))

    def numpy_function(self, items: Sequence[Expr]) -> FormulaFunction:
        """Return terms of these formulas, such as `outputs` or `step`, as a function.

        Its arguments are values (k, n) or (k, 1) of the motion, the places and the sizes,
        in the order of `motion`, `places` and `sizes`. It returns the values (items, n).
        """
        terms = [term for kind in self.variables for term in kind]
        columns = [terms.index(table.of) for table in self.tables]
        terms += [term for table in self.tables for term in table.terms]
        function = array_function(items, terms)

        def evaluate(motion: Floats, places: Floats, sizes: Floats) -> Floats:
            arguments = (motion, places, sizes)
            count = max(argument.shape[1] for argument in arguments)
            given = np.concatenate(
                [
                    np.broadcast_to(argument, (len(argument), count))
                    for argument in arguments
                ]
            )
            profiles = [
                table.at(given[column])
                for table, column in zip(self.tables, columns, strict=True)
            ]
            return np.asarray(function(np.concatenate([given, *profiles])))

        return evaluate

    @property
    def size_values(self) -> Floats:
        """(sizes, 1) the sizes of the file, in the units of `sizes`."""
        return np.array([size.value for size in self.sizes]).reshape(-1, 1)
