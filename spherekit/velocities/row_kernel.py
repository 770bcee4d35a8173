"""The functions that give a run its rows: what decides about them, then all columns.

Rows in quad precision: the same terms, Newton's method included.

Where float64 leaves too little of a row, its loops are closed to 33 digits and all columns
computed again. What they may be off by is then what the numbers of the file are rounded by,
which is measured: every way in which loops can stay open is gone by a small step.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cached_property
from typing import Any, Literal

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.geometry.rotation import max_abs
from spherekit.numerics.quad_precision import quad
from spherekit.positions.motion import Motion
from spherekit.symbolic.expression_graph import (
    Expr,
    ExpressionNode,
    FloatFunction,
    float_function,
    substituted,
    symbols,
)
from spherekit.symbolic.term_function import term_function
from spherekit.symbolic.vector_algebra import vector_sum
from spherekit.velocities.axis_rotations import ProfileSide, append_profile_columns
from spherekit.velocities.carried_vectors import largest
from spherekit.velocities.dyad_expressions import COMPILED, closed_form
from spherekit.velocities.elimination_order import (
    EliminationOrder,
    assign_elimination_orders,
)
from spherekit.velocities.pole_request import Request
from spherekit.velocities.row_expressions import (
    ERRORS,
    LARGEST_ERROR,
    MovingTerms,
    RowTerms,
    curved,
)

NEARLY_FLAT = 1e-3
"""Rows whose equations are flatter than this are not vouched for."""
REFERENCES = 32
"""Configurations at most that say in which order variables are eliminated. More: the order
suits more rows, and takes longer to find."""

Engine = Literal["numpy", "compiled"]
STEPS = 8
"""Of Newton's method at most."""
SURE = 0.5
"""Loops that bend less than this have one solution near."""
NEAR = 1e-4
"""A solution farther away (rad) is not the one meant."""
CLOSED = 1e-25
"""A last step that is smaller (rad) has closed the loops."""
SMALL = 1e-30
"""How far loops are opened (rad)."""
WIDE_PIECE = 256
"""Rows computed at once."""


WideRows = tuple[Floats, Floats, Floats, Bools]
"""All columns (columns, n) of rows, rounded, and those aside; by how much columns change as
loops open by one radian, all ways added up; where (n,) Newton's method closed them."""


class ColumnFunction:
    """The function of some parts, by name, of variables and columns of `profiles`.

    `places` name its columns, `width` is their number.
    """

    def __init__(
        self,
        parts: Mapping[Any, Sequence[Expr]],
        given: Sequence[ExpressionNode],
        profiles: Sequence[ProfileSide],
        compiled: bool = False,
    ) -> None:
        outputs: list[Expr] = []
        self.places: dict[Any, slice] = {}
        for key, items in parts.items():
            self.places[key] = slice(len(outputs), len(outputs) + len(items))
            outputs += items
        self.width, self._profiles = len(outputs), profiles
        given = [*given, *(term for profile in profiles for term in profile.column_symbols)]
        self.function = term_function(outputs, given, compiled)

    def __call__(self, values: Floats, out: Floats | None = None) -> Floats:
        """Return all columns (width, n) of variables (variables, n)."""
        return self.function(append_profile_columns(values, self._profiles), out)


class RowKernel:
    """What gives the rows of a run, see `row_kernel`; functions are made when asked for.

    `moving` say where the columns of each input are, `free` are the variables that are no
    inputs, from which all follow where it `has_closed_form`; `vouches` says that rows need
    not be looked at by others. Loops that are no more than `open_by_rounding` open (rad)
    are closed. It has `kept` columns; threads call it at the same time where its calls are
    few and long.
    """

    def __init__(
        self,
        motion: Motion,
        requests: Sequence[Request],
        pivots: EliminationOrder,
        engine: Engine,
    ) -> None:
        mechanism, self.engine, self.free = (
            motion.mechanism,
            engine,
            motion.passive_variables,
        )
        self._variables = symbols(mechanism.variable_names)
        given = mechanism, self._variables, pivots, motion.assembly.inputs
        rows, columns = RowTerms(*given), dict[Any, int]()
        self._rows, self.open_by_rounding = rows, rows.open_by_rounding
        self.moving = [MovingTerms(rows, item, columns) for item in requests]
        self._columns = [x[1] if isinstance(x, tuple) else x for x in columns]
        doubts = (moving.in_doubt for moving in self.moving)
        self.vouches = bool(motion.passive_variables) and not any(doubts)
        self._profiles = rows.pairs.sides_with_columns
        self._form = None if self._profiles else closed_form(mechanism, motion.assembly)
        self.in_threads, self.kept = engine == "compiled", len(self._columns)
        self.has_closed_form = self._form is not None
        worst = [moving.worst / LARGEST_ERROR for moving in self.moving]
        self._doubts = [rows.flatness * NEARLY_FLAT, *worst, *curved(rows)]

    @cached_property
    def is_constant(self) -> Bools:
        """(columns,) which columns are numbers for every configuration."""
        return np.array([not isinstance(x, ExpressionNode) for x in self._columns], bool)

    @cached_property
    def of_floats(self) -> FloatFunction:
        """All variables and columns, of inputs and signs of dyads, or of all variables.

        Without a closed form variables are those after a step of Newton's method. Then
        follow how much loops bend, a measure of doubt, by how much loops are open, and the
        side (3,) where the sum of all axes lies, before all columns.
        """
        rows = self._rows
        decide = [rows.bend, sum(self._doubts, 0.0), rows.residual]
        columns = [*decide, *vector_sum(rows.vectors), *self._columns]
        if self._form is None:
            closer = dict(zip(self.free, rows.closer, strict=True))
            after = [closer.get(v, x) for v, x in enumerate(self._variables)]
            return float_function([*after, *columns], self._variables)
        given, variables, _ = self._form
        stand_in = dict(zip(self._variables, variables, strict=True))
        return float_function([*variables, *substituted(columns, stand_in)], given)

    def row(self, given: Sequence[float]) -> tuple[Sequence[float], list[float]] | None:
        """Return the variables of a row, and the side with all columns; None in doubt.

        `given` are inputs and signs of dyads, or variables near by: steps of Newton's
        method close loops as long as these say that there is one solution near
        (Kantorovich's theorem).
        """
        count, closed = len(self._variables), self.has_closed_form
        for _ in range(STEPS):
            try:
                made = self.of_floats(given)
            except (ArithmeticError, ValueError):
                return None
            bend, doubt, residual = made[count : count + 3]
            if not bend <= SURE:
                return None
            if residual <= self.open_by_rounding:
                values = made[:count] if closed else given
                return (values, made[count + 2 :]) if doubt <= 1.0 else None
            if closed:
                return None
            given = made[:count]
        return None

    def _made(
        self, parts: Mapping[Any, Sequence[Expr]], compiled: bool = False
    ) -> ColumnFunction:
        return ColumnFunction(parts, self._variables, self._profiles, compiled)

    @property
    def _deciding(self) -> dict[Any, Sequence[Expr]]:
        """What decides about rows, by name.

        What is at most 1 where a row is not doubtful, added up; by how much loops are open
        with what the configuration is off by; what is in doubt, one by one; for each input
        how links turn, and the largest errors of directions, rates and changes.
        """
        rows = self._rows
        parts: dict[Any, Sequence[Expr]] = {
            "doubt": [sum(self._doubts, 0.0)],
            "closure": [rows.residual, rows.moved_by],
            "doubts": self._doubts,
        }
        for k, moving in enumerate(self.moving):
            parts["spins", k] = moving.spins
            parts["errors", k] = [
                largest(self._columns[at] for (at,) in moving.of[name].values())
                for name in ERRORS
            ]
        return parts

    @cached_property
    def judging(self) -> ColumnFunction:
        """What decides about rows, of all pair variables."""
        # With a closed form, it is for few rows.
        return self._made(self._deciding, self.in_threads and not self.has_closed_form)

    @cached_property
    def by_inputs(self) -> ColumnFunction:
        """All variables and what decides about rows, of inputs and signs of dyads."""
        assert self._form is not None
        given, variables, squares = self._form
        stand_in = dict(zip(self._variables, variables, strict=True))
        parts = {key: substituted(x, stand_in) for key, x in self._deciding.items()}
        every = {"variables": variables, **parts, "squares": squares}
        return ColumnFunction(every, given, (), self.in_threads)

    @cached_property
    def whole(self) -> ColumnFunction:
        """The function of all columns."""
        return self._made({"columns": self._columns}, self.in_threads)

    @cached_property
    def closer(self) -> ColumnFunction:
        """Those `free`, by a step of Newton's method closer to where loops close."""
        return self._made({"free": self._rows.closer}, self.in_threads)

    @cached_property
    def aside(self) -> ColumnFunction:
        """What else decides about a row, of the first input."""
        rows, first = self._rows, self.moving[0]
        return self._made(
            {
                "shape": [rows.flatness, rows.bend, sum(curved(rows), 0.0)],
                "turns": rows.turns,
                "inverse": [*rows.inverse[rows.free].flat],
                "left": [first.part, first.over, first.over_bent, first.fast, first.swings],
            }
        )

    def wide(self, values: Floats) -> WideRows:
        """Return rows of nearly closed variables (variables, n) by quad precision.

        Only arrays have it, not what is compiled.
        """
        starts = range(0, values.shape[1], WIDE_PIECE)
        parts = (self._piece(values[:, k : k + WIDE_PIECE]) for k in starts)
        columns, aside, spread, closed = map(np.hstack, zip(*parts, strict=True))
        return columns, aside, spread, closed

    def _piece(self, values: Floats) -> WideRows:
        free = list(self.free)
        closer, whole, aside = (x.function for x in (self.closer, self.whole, self.aside))
        start = values.astype(quad())
        x = start.copy()
        for _ in range(STEPS):
            after = closer(append_profile_columns(x, self._profiles, values))
            step = max_abs((after - x[free]).astype(float), axis=0)
            x[free] = after
            if not np.any(step > CLOSED):
                break
        closed = (step <= CLOSED) & (max_abs((x - start).astype(float), axis=0) < NEAR)
        x[:, ~closed] = start[:, ~closed]
        given = append_profile_columns(x, self._profiles, values)
        columns, others = whole(given).astype(float), aside(given).astype(float)
        inverse = others[self.aside.places["inverse"]]
        ways = 3 * len(self._rows.tree.chords)
        inverse = inverse.reshape(len(free), ways, values.shape[1])
        spread = self._add_up_changes(x.astype(float), inverse)
        return columns, others, spread, closed

    def _add_up_changes(self, values: Floats, inverse: Floats) -> Floats:
        """Return by how much columns change as loops open, all ways added up.

        The derivatives are those of a step that is imaginary (Squire and Trapp 1998).

        Parameters
        ----------
        values
            (variables, n) rad, closed configurations.
        inverse
            (free variables, ways, n) by how much variables move as loops open, rad per rad.

        Returns
        -------
        (columns, n) sizes of the changes, per rad.
        """
        free = list(self.free)
        ways, count = inverse.shape[1:]
        changes = np.zeros((len(self._columns), count))
        # One call takes several ways: of a few rows, each call costs about as much as the
        # numbers of `WIDE_PIECE` rows.
        together = max(1, WIDE_PIECE // max(count, 1))
        for start in range(0, ways, together):
            some = inverse[:, start : start + together]
            repeated = np.tile(values, some.shape[1])
            stepped = repeated.astype(complex)
            stepped.imag[free] = SMALL * some.reshape(len(free), -1)
            columns = self.whole.function(
                append_profile_columns(stepped, self._profiles, repeated)
            )
            sizes = np.abs(columns.imag).reshape(len(columns), some.shape[1], count)
            # Way after way, so that sums round as they do for one way at a time.
            for size in sizes.swapaxes(0, 1):
                changes += size / SMALL
        return changes


def row_kernel(
    motion: Motion,
    requests: Sequence[Request],
    engine: Engine,
    order: EliminationOrder | None = None,
) -> RowKernel | None:
    """Return the kernel that computes what `requests` ask of a mechanism's rows.

    Parameters
    ----------
    motion
        Closed configurations of the mechanism, in any modes.
    requests
        One for each input that moves.
    engine
        What runs the expressions.
    order
        The order in which variables are eliminated; by default the one that is regular at
        most rows of the motion.

    Returns
    -------
    RowKernel or None
        None where no order is regular at any row.
    """
    pivots = choose_order(motion) if order is None else order
    if pivots is None:
        return None

    wanted = [(item.plan.input, item.poles, sorted(item.links)) for item in requests]
    key = repr(("rows", wanted, pivots, engine))
    given = motion, requests, pivots, engine
    with suppress(ZeroDivisionError):  # a pivot that is zero as a term, not by its numbers
        return COMPILED.get(motion.mechanism, key, lambda: RowKernel(*given))
    return None


def choose_order(motion: Motion) -> EliminationOrder | None:
    """Return the elimination order that is regular at most rows of a motion, if any is.

    One order need not be regular in all assembly modes: where loops repeat equations of
    others, which of them do may depend on the mode.
    """
    if not motion.passive_variables:
        return []
    good = np.flatnonzero(~motion.failed & (motion.float64_error < 1e-6))
    if not len(good):
        good = np.flatnonzero(~motion.failed)
    if not len(good):
        return None
    chosen = good[np.unique(np.linspace(0, len(good) - 1, REFERENCES).astype(int))]
    assigned = assign_elimination_orders(
        motion.linearisation.jacobian[chosen], motion.passive_variables
    )
    if not assigned:
        return None
    # Of orders with as many rows the first: it was chosen by all rows together.
    return max(assigned, key=lambda part: len(part[1]))[0]
