"""Kernels of which sizes are inputs: one for a topology, whatever its geometry.

What does not depend on the configuration is computed once a design (`prepare`), the rest
at every row (`evaluate`): a row is one sample of one design in one assembly mode. Closure
equations are there at complex inputs too: they are analytic, and off the real axis their
solutions neither meet nor vanish; compiled, real and imaginary parts are terms.
"""

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from spherekit.arrays import Floats
from spherekit.mechanism.load import TorqueTable
from spherekit.symbolic.compiler import available
from spherekit.symbolic.expression_evaluation import ArrayFunction, array_function
from spherekit.symbolic.expression_function import expression_function
from spherekit.symbolic.expression_graph import (
    dot,
    function,
    iterate_nodes,
    separate_constant_parts,
)
from spherekit.symbolic.vector_algebra import Exprs, constants, cross
from spherekit.velocities.design_expressions import DesignExpressions


class DesignKernel:
    """A function of designs and samples of a topology that is written in `terms`.

    `prepare` takes the sizes (variables, n) to what is the same at all samples of a design.
    `evaluate` takes a sample, the places of the links (then the columns of profiles that
    are handed in) and what is prepared to the
    `columns`, then to their derivatives, size by size, where `gradients` are asked for, and
    last to `DesignExpressions.relative_loop_residual`, where that is asked for.
    Columns are names of `row_quantities`, `EngineError` where there is none of it. Places
    are the sign of each dyad in closed form; then the first outputs, one for each dyad, are
    not negative where it closes. Otherwise they are the variables of all pairs. It is
    `compiled` where heyoka is installed, or ready at once.

    Tables of torques over time are read at the samples.

    Loads that count turns take those (rad) of the pairs `turning`, after the places and the
    columns of profiles. `angles` is the function of the same rows that gives the first
    outputs and then the variables of these pairs less the turns.
    """

    def __init__(
        self,
        terms: DesignExpressions,
        columns: Sequence[str],
        gradients: bool = False,
        compiled: bool = True,
        with_rates_left_over: bool = False,
    ) -> None:
        outputs = [terms.quantity(name) for name in columns]
        if gradients:
            outputs += [
                slope
                for slopes in terms.differentiate_by_sizes(outputs)
                for slope in slopes
            ]
        if with_rates_left_over:
            outputs.append(terms.relative_loop_residual())
        self.places, self.columns = terms.configuration_symbols, tuple(columns)
        self.closed_form, self._compiled = terms.has_closed_form, compiled and available()
        used = set(iterate_nodes(outputs))
        turns = {pair: x for pair, x in terms.revolution_symbols.items() if x in used}
        self.turning = tuple(turns)
        moving = [
            *terms.sample_symbols,
            *terms.configuration_symbols,
            *terms.profile_symbols,
            *turns.values(),
        ]
        tables = {name: x for name, x in terms.table_symbols.items() if x in used}
        loads = (x for x in terms.mechanism.loads if isinstance(x, TorqueTable))
        self._tables = [load for load in loads if load.name in tables]
        self._time = len(terms.sample_symbols) - 1
        items = [*terms.triple_squares, *outputs, *(terms.angle(pair) for pair in turns)]
        self._rows, fixed = separate_constant_parts(items, [*tables.values(), *moving])
        self._given, self._reached = [*moving, *fixed], len(terms.triple_squares)
        self._count = self._reached + len(outputs)
        self.prepare = expression_function(
            [*fixed.values()], terms.size_symbols, self._compiled
        )
        given = [*tables.values(), *self._given]
        self._evaluate = expression_function(
            self._rows[: self._count], given, self._compiled
        )

    def evaluate(self, rows: Floats) -> Floats:
        """See above."""
        torques = [table.at(rows[self._time])[None] for table in self._tables]
        return self._evaluate(np.concatenate([*torques, rows]) if torques else rows)

    @cached_property
    def angles(self) -> ArrayFunction:
        """See above."""
        rows = [*self._rows[: self._reached], *self._rows[self._count :]]
        return expression_function(rows, self._given, self._compiled)

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
        n, prepared = samples.shape[1], self.prepare(sizes)
        parts = [samples, places, *([] if columns is None else [columns])]
        parts.append(np.zeros((len(self.turning), n)) if turns is None else turns)
        parts.append(np.broadcast_to(prepared, (len(prepared), n)))
        with np.errstate(all="ignore"):
            return self.evaluate(np.concatenate(parts))


MAX_RATES_LEFT_OVER = 1e-9
"""Largest part of the rates that may be left over in loops. Larger: rates have fewer
digits; smaller: rows near singular configurations, which lose some digits, have none."""


class RedundantKernel:
    """The `DesignKernel` of one design in which constraints repeat each other.

    Rates follow from independent equations that are chosen at a configuration. Elsewhere
    these may depend on each other, though all equations together determine the rates. So
    there is a kernel for each choice, and each row is taken from the one whose rates leave
    the least over in all loops. Columns of rates are NaN where all leave more than
    `MAX_RATES_LEFT_OVER`; angles and axes do not depend on the choice.

    Parameters
    ----------
    terms
        Terms of the same design, of the variables of pairs, whose equations are chosen at
        configurations of different modes.
    columns
        Names of `row_quantities`.
    """

    def __init__(self, terms: Sequence[DesignExpressions], columns: Sequence[str]) -> None:
        # Everything that follows from rates is divided by the scale of the rates.
        scale = terms[0].coordinate_rates.scale
        self._follows_from_rates = np.array(
            [scale in set(iterate_nodes([terms[0].quantity(name)])) for name in columns],
            bool,
        )
        by_choice: dict[str, DesignExpressions] = {}
        for item in terms:
            groups = item.structure.groups
            choice = repr(
                [(group.private_variables, group.chosen_equations) for group in groups]
            )
            by_choice.setdefault(choice, item)
        self._kernels = [
            DesignKernel(item, columns, compiled=False, with_rates_left_over=True)
            for item in by_choice.values()
        ]
        self.turning = self._kernels[0].turning
        self.reaches = 0
        no_sizes = np.empty((0, 1))
        self._prepared = [kernel.prepare(no_sizes) for kernel in self._kernels]

    def prepare(self, sizes: Floats) -> Floats:
        """Return no rows (0, n): each kernel has prepared its own for the one design."""
        return np.empty((0, sizes.shape[1]))

    def evaluate(self, rows: Floats) -> Floats:
        """Return the columns (columns, n) of rows (k, n), as `DesignKernel` has them."""
        count = rows.shape[1]
        columns = np.full((len(self._follows_from_rates), count), np.nan)
        least = np.full(count, np.inf)
        for kernel, prepared in zip(self._kernels, self._prepared, strict=True):
            fixed = np.broadcast_to(prepared, (len(prepared), count))
            outputs = kernel.evaluate(np.concatenate([rows, fixed]))
            left_over = outputs[-1]
            is_better = (left_over < least) & (left_over <= MAX_RATES_LEFT_OVER)
            columns[:, is_better] = outputs[:-1, is_better]
            same = ~self._follows_from_rates
            columns[same] = outputs[:-1][same]
            least[is_better] = left_over[is_better]
        return columns


def arc_function(terms: DesignExpressions) -> tuple[tuple[int, ...], ArrayFunction]:
    """Return the links with two axes, and the function of sizes that gives their arcs.

    The arcs (links, n) are in [0, pi] rad.
    """
    mechanism, pairs = terms.mechanism, terms.structure.pairs
    axes: dict[int, list[Exprs]] = {k: [] for k in range(len(mechanism.links))}
    for pair, ends in enumerate(mechanism.ends):
        if pair not in pairs.sides:
            for link, axis in zip(ends, pairs.axes(pair), strict=True):
                axes[link].append(constants(axis))
    both = {link: (*held, cross(*held)) for link, held in axes.items() if len(held) == 2}
    arcs = [
        function("atan2", np.sqrt(dot(normal, normal)), dot(one, other))
        for one, other, normal in both.values()
    ]
    return tuple(both), array_function(arcs, terms.size_symbols)
