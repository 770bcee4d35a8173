"""The functions that give a run its rows: what decides about them, then all columns.

Rows in quad precision: the same terms, Newton's method included.

Where float64 leaves too little of a row, its loops are closed to 33 digits and all columns
computed again. What they may be off by is then what the numbers of the file are rounded by,
which is measured: every way in which loops can stay open is gone by a small step.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, Literal

import numpy as np

from spherekit.arrays import Array, Bools, Floats, Indices
from spherekit.conventions import EQUAL_CURVATURE
from spherekit.engine.algebra import sum_of, vector_sum
from spherekit.engine.columns import (
    ERRORS,
    LARGEST_ERROR,
    Outputs,
    Pivot,
    Place,
    RatePlaces,
    Terms,
    curved,
    pivots_of,
)
from spherekit.engine.compiler import CompiledFunction
from spherekit.engine.dyads import (
    COMPILED,
    closed_form,
    lost_by,
)
from spherekit.engine.expression_graph import Expr, substituted
from spherekit.engine.pose import largest
from spherekit.engine.system import (
    ArrayFunction,
    FloatFunction,
    array_function,
    float_function,
    term_function,
)
from spherekit.engine.turns import PARTS, ProfileColumns, with_columns
from spherekit.motion.motion import Motion
from spherekit.planning.poles import Pole
from spherekit.rates.request import Request
from spherekit.sphere.rotation import max_abs

NEARLY_FLAT = 1e-3
"""Rows whose equations are flatter than this are not vouched for."""
REFERENCES = 32
"""Configurations at most that say in which order variables are eliminated."""

Engine = Literal["numpy", "compiled"]
_Function = CompiledFunction | ArrayFunction


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


@cache
def quad() -> Any:
    """Return the number type; it is loaded with the first row that needs it."""
    from numpy_quaddtype import QuadPrecDType

    return QuadPrecDType()


WideRows = tuple[Floats, Floats, Floats, Bools]
"""All columns (columns, n) of rows, rounded, and those aside, see `Terms`; by how much
columns change as loops open by one radian, all ways added up; where (n,) Newton's method
closed them."""


@dataclass(frozen=True)
class WideFunctions:
    """A step of Newton's method, all columns and what else decides, of pair variables.

    `free` are the numbers of the variables that a step gives, with `ways` in which loops
    open; `slopes` are all columns of complex variables. The `profiles` of contacts are
    those of float64, with what they change by.
    """

    closer: ArrayFunction
    whole: ArrayFunction
    aside: ArrayFunction
    slopes: ArrayFunction
    profiles: Sequence[ProfileColumns]
    free: Sequence[int]
    ways: int
    inverse: slice

    def at(self, values: Floats) -> WideRows:
        """Return the rows of variables (variables, n) that are nearly closed."""
        starts = range(0, max(values.shape[1], 1), WIDE_PIECE)
        parts = (self._at(values[:, k : k + WIDE_PIECE]) for k in starts)
        columns, aside, spread, closed = zip(*parts, strict=True)
        return np.hstack(columns), np.hstack(aside), np.hstack(spread), np.hstack(closed)

    def _at(self, values: Floats) -> WideRows:
        free = list(self.free)
        start = values.astype(quad())
        x, step = start.copy(), np.full(values.shape[1], np.inf if free else 0.0)
        for _ in range(STEPS if free else 0):
            after = self.closer(self._given(x, values))
            step = np.max(np.abs(after - x[free]).astype(float), axis=0)
            x[free] = after
            if not np.any(step > CLOSED):
                break
        moved = max_abs((x - start).astype(float), axis=0)
        closed = (step <= CLOSED) & (moved < NEAR)
        x[:, ~closed] = start[:, ~closed]
        columns = self.whole(self._given(x, values))
        aside = self.aside(self._given(x, values))
        spread = self._spread(x.astype(float), aside[self.inverse].astype(float))
        return columns.astype(float), aside.astype(float), spread, closed

    def _spread(self, values: Floats, inverse: Floats) -> Floats:
        """Return what columns change by as loops open, all ways added up.

        Along each way by a step that is imaginary (Squire and Trapp 1998).
        """
        n = len(values[0])
        free = list(self.free)
        spread = np.zeros((self.whole.outputs, n))
        x = values.astype(complex)
        for way in inverse.reshape(len(free), self.ways, n).swapaxes(0, 1):
            x.imag[free] = SMALL * way
            spread += np.abs(self.slopes(self._given(x, values)).imag) / SMALL
        return spread

    def _given(self, x: Array, base: Floats) -> Array:
        """Return variables with the columns of profiles, by their derivatives at `base`."""
        if not self.profiles:
            return x
        made = with_columns(base, self.profiles).astype(x.dtype)
        count, width = len(x), len(PARTS)
        made[:count] = x
        for k, profile in enumerate(self.profiles):
            rows = slice(count + width * k, count + width * (k + 1))
            at = profile.variable
            slopes = profile.series.slopes(base[at] + profile.start)
            made[rows] += slopes.astype(x.dtype) * (x[at] - base[at].astype(x.dtype))
        return made


@dataclass(frozen=True)
class ColumnFunction:
    """A function of pair variables and the columns of profiles, with `width` columns."""

    function: _Function
    profiles: tuple[ProfileColumns, ...]
    width: int

    def __call__(self, values: Floats, out: Floats | None = None) -> Floats:
        """Return all columns (width, n) of variables (variables, n)."""
        return np.asarray(self.function(with_columns(values, self.profiles), out))


@dataclass(frozen=True)
class _InputPlaces:
    """Of an input that moves: how doubtful a row is, and how links turn.

    From the column `first` on there are the angular velocities of `turning` links, then
    the largest errors of directions, rates and changes. `still` (links, 3) are the angular
    velocities that do not change. `poles` are those without a sense of their own, by the
    places of their links among those that turn, then the others.
    """

    worst: Place
    first: int
    turning: int
    still: Floats
    poles: tuple[Indices, Indices]


@dataclass(frozen=True)
class RowFunction:
    """A function with columns that decide about rows.

    Of all pair variables, or of inputs and the signs of dyads, so many as are `given`; then
    the first columns are the `variables`, and the last the `squares` of triple products.
    The next after the variables are a measure of doubt, by how much loops are open, and
    what the configuration is off by. `flatness` is how flat the mechanism is, `curved` by
    how much more the first profile of each contact curves than the second, where that is
    no number.
    """

    columns: ColumnFunction
    flatness: Place
    curved: tuple[Place, ...]
    inputs: tuple[_InputPlaces, ...]
    open_by_rounding: float
    given: int
    variables: int = 0
    squares: int = 0

    def __call__(self, values: Floats, out: Floats | None = None) -> Floats:
        """Return all columns (columns, n) of what is given (given, n)."""
        return self.columns(values, out)

    @property
    def width(self) -> int:
        """The number of columns."""
        return self.columns.width

    def is_well(self, columns: Floats) -> bool:
        """Return whether all rows are closed and vouched for."""
        ends = columns[self.variables : self.variables + 2]
        doubt, residual = np.maximum.reduce(ends, axis=1).tolist()
        return bool(doubt <= 1.0 and residual <= self.open_by_rounding)

    def closure(self, columns: Floats) -> Floats:
        """Return (2, n) by how much loops are open, rad, and errors of configurations."""
        return columns[self.variables + 1 : self.variables + 3]

    def closed(self, columns: Floats) -> Bools:
        """Return which rows (n,) have loops no more open than numbers are rounded."""
        return self.closure(columns)[0] <= self.open_by_rounding

    def lost(self, columns: Floats) -> Bools:
        """Return which rows (n,) the inputs surely do not reach."""
        return lost_by(columns[self.width - self.squares :])

    def vouched(self, columns: Floats) -> Bools:
        """Return which rows (n,) the kernel vouches for, if their loops are closed.

        Of these the numbers are as good as those that are found with care.
        """
        good = self.flatness.of(columns)[0] <= 1.0 / NEARLY_FLAT
        for bent in self.curved:
            good &= bent.of(columns)[0] >= 2.0 * EQUAL_CURVATURE
        for places in self.inputs:
            good &= places.worst.of(columns)[0] <= LARGEST_ERROR
        return np.asarray(good)

    def ends(
        self, columns: Floats, number: int
    ) -> tuple[Floats, Floats, tuple[float, ...]]:
        """Return the least and greatest (links, 3) of angular velocities that change.

        With the largest errors of directions, rates and changes, by an input.
        """
        places = self.inputs[number]
        count, first = 3 * places.turning, places.first
        high = np.maximum.reduce(columns[first : first + count + len(ERRORS)], axis=1)
        low = np.minimum.reduce(columns[first : first + count], axis=1)
        shape = places.turning, 3
        return low.reshape(shape), high[:count].reshape(shape), tuple(high[count:].tolist())

    def turning(self, columns: Floats, number: int) -> Floats:
        """Return (links, 3, n) angular velocities of those that change, by an input."""
        places = self.inputs[number]
        block = columns[places.first : places.first + 3 * places.turning]
        return block.reshape(places.turning, 3, columns.shape[1])

    def relative(self, number: int, turning: Floats, less: Floats | None = None) -> Floats:
        """Return (poles, 3, ...) relative angular velocities of poles without a sense.

        From those of `turning` (links, 3, ...), `less` those, where they differ, that are
        subtracted.
        """
        places = self.inputs[number]
        still = places.still
        if turning.ndim > 2:
            still = np.broadcast_to(still[..., None], (*still.shape, turning.shape[2]))
        w = np.concatenate([turning, still])
        other = w if less is None else np.concatenate([less, still])
        first, second = places.poles
        return w[second] - other[first]

    def errors(self, columns: Floats, number: int) -> Floats:
        """Return (3, n) the largest errors of directions, rates, changes, by an input."""
        places = self.inputs[number]
        start = places.first + 3 * places.turning
        return columns[start : start + len(ERRORS)]


class RowKernel:
    """What gives the rows of a run, see `row_kernel`; functions are made when asked for.

    `rates` say where the columns of each input are, `free` are the variables that are no
    inputs; `vouches` says that rows need not be looked at by others.
    """

    def __init__(self, terms: Terms, motion: Motion, engine: Engine) -> None:
        self.engine, self.free, self._terms = engine, motion.free, terms
        self._columns = terms.outputs.columns
        self.rates = tuple(moving.placed(terms.outputs) for moving in terms.moving)
        in_doubt = any(moving.in_doubt for moving in terms.moving)
        self.vouches = bool(motion.free) and not in_doubt
        profiled = terms.rows.pairs.columns
        self._form = None if profiled else closed_form(motion.mechanism, motion.assembly)

    @property
    def in_threads(self) -> bool:
        """Whether threads call it at the same time: its calls are few and long."""
        return self.engine == "compiled"

    @property
    def kept(self) -> int:
        """How many columns there are."""
        return len(self._columns)

    @property
    def has_closed_form(self) -> bool:
        """Whether all variables follow from inputs."""
        return self._form is not None

    @cached_property
    def of_floats(self) -> FloatFunction:
        """All variables and columns, of inputs and signs of dyads, or of all variables.

        Without a closed form variables are those after a step of Newton's method. Then
        follow how much loops bend, a measure of doubt, by how much loops are open, and the
        side (3,) where the sum of all axes lies, before all columns.
        """
        terms, rows, form = self._terms, self._terms.rows, self._form
        decide = [rows.bend, _doubt(terms), rows.residual, *vector_sum(rows.vectors)]
        columns = [*decide, *self._columns]
        if form is not None:
            stand_in = dict(zip(terms.variables, form.variables, strict=True))
            outputs = [*form.variables, *substituted(columns, stand_in)]
            return float_function(outputs, form.given)
        closer = dict(zip(self.free, rows.closer(terms.variables), strict=True))
        after = [closer.get(v, x) for v, x in enumerate(terms.variables)]
        return float_function([*after, *columns], terms.variables)

    def row(self, given: Sequence[float]) -> tuple[Sequence[float], list[float]] | None:
        """Return the variables of a row, and the side with all columns; None in doubt.

        `given` are inputs and signs of dyads, or variables near by: steps of Newton's
        method close loops as long as these say that there is one solution near
        (Kantorovich's theorem).
        """
        count, closed = len(self._terms.variables), self.has_closed_form
        for _ in range(STEPS):
            try:
                made = self.of_floats(*given)
            except (ArithmeticError, ValueError):
                return None
            bend, doubt, residual = made[count : count + 3]
            if not bend <= SURE:
                return None
            if residual <= self._terms.rows.open_by_rounding:
                values = made[:count] if closed else given
                return (values, made[count + 2 :]) if doubt <= 1.0 else None
            if closed:
                return None
            given = made[:count]
        return None

    def _made(self, outputs: Sequence[Expr], interpreted: bool = False) -> ColumnFunction:
        compiled = self.engine == "compiled" and not interpreted
        made = term_function(outputs, self._terms.given, compiled)
        return ColumnFunction(made, self._terms.rows.pairs.columns, len(outputs))

    @cached_property
    def judging(self) -> RowFunction:
        """What decides about rows, of all pair variables."""
        columns, places = _deciding(self._terms, self.rates)
        # With a closed form, it is for few rows.
        made = self._made(columns, interpreted=self.has_closed_form)
        rounding, given = self._terms.rows.open_by_rounding, len(self._terms.variables)
        return RowFunction(made, *places, rounding, given)

    @cached_property
    def by_inputs(self) -> RowFunction:
        """All variables and what decides about rows, of inputs and signs of dyads."""
        form = self._form
        assert form is not None
        columns, places = _deciding(self._terms, self.rates, len(form.variables))
        stand_in = dict(zip(self._terms.variables, form.variables, strict=True))
        outputs = [*form.variables, *substituted(columns, stand_in), *form.squares]
        function = term_function(outputs, form.given, self.engine == "compiled")
        made = ColumnFunction(function, (), len(outputs))
        sizes = len(form.given), len(form.variables), len(form.squares)
        return RowFunction(made, *places, self._terms.rows.open_by_rounding, *sizes)

    @cached_property
    def whole(self) -> ColumnFunction:
        """The function of all columns."""
        return self._made(self._columns)

    @cached_property
    def closer(self) -> ColumnFunction:
        """Those `free`, by a step of Newton's method closer to where loops close."""
        return self._made(self._terms.rows.closer(self._terms.variables))

    @cached_property
    def aside(self) -> ColumnFunction:
        """What else decides about rows, see `Terms`."""
        return self._made(self._terms.aside, interpreted=True)

    @cached_property
    def wide(self) -> WideFunctions:
        """The same in quad precision."""
        terms, kind = self._terms, quad()
        before, ways = 3 + terms.rows.tree.count, 3 * len(terms.rows.tree.chords)
        return WideFunctions(
            array_function(terms.rows.closer(terms.variables), terms.given, kind),
            array_function(self._columns, terms.given, kind),
            array_function(terms.aside, terms.given, kind),
            array_function(self._columns, terms.given, complex),
            terms.rows.pairs.columns,
            self.free,
            ways,
            slice(before, before + ways * len(self.free)),
        )

    @cached_property
    def _signed(self) -> ColumnFunction:
        blocks = (self._columns[places.signs] for places in self.rates)
        return self._made([x for block in blocks for x in block], interpreted=True)

    def signed_at(self, values: Floats) -> list[Floats]:
        """Return by input (8, poles, n) what has a sign of its own, of few rows."""
        counts = [8 * len(places.signed) for places in self.rates]
        parts = np.split(self._signed(values), np.cumsum(counts)[:-1])
        return [part.reshape(8, len(part) // 8, values.shape[1]) for part in parts]


def row_kernel(
    motion: Motion, requests: Sequence[Request], engine: Engine
) -> RowKernel | None:
    """Return the kernel of what `requests` want of a mechanism's rows.

    The closed configurations of a motion say in which order variables are eliminated;
    None where no order is regular.
    """
    pivots = _pivots(motion, requests)
    if pivots is None:
        return None

    def make() -> RowKernel:
        return RowKernel(Terms.of(motion, requests, pivots), motion, engine)

    wanted = tuple(
        (item.plan.input, item.poles, item.derivatives, tuple(sorted(item.links)))
        for item in requests
    )
    key = repr(("rows", wanted, pivots, engine))
    return COMPILED.get(motion.mechanism, key, make)


def _deciding(
    terms: Terms, rates: Sequence[RatePlaces], variables: int = 0
) -> tuple[list[Expr], tuple[Place, tuple[Place, ...], tuple[_InputPlaces, ...]]]:
    """Return the columns that decide about rows, after so many variables, and places."""
    rows, results, outputs = terms.rows, terms.outputs, Outputs()
    outputs.columns += [0.0] * variables
    outputs.columns += [_doubt(terms), rows.residual, rows.moved_by]
    inputs = []
    for moving, places in zip(terms.moving, rates, strict=True):
        first, turning, still = len(outputs.columns), moving.turning, moving.still
        outputs.columns += [x for w in turning.values() for x in w]
        outputs.columns += [
            largest(map(results.item, places.of[name].values())) for name in ERRORS
        ]
        order = [*turning, *still]
        inputs.append(
            _InputPlaces(
                outputs.place(moving.worst),
                first,
                len(turning),
                np.array([*still.values()], dtype=float).reshape(-1, 3),
                _ends([(order.index(i), order.index(j)) for i, j in places.signed]),
            )
        )
    flatness = outputs.place(rows.flatness)
    bent = tuple(outputs.place(item) for item in rows.curved)
    return outputs.columns[variables:], (flatness, bent, tuple(inputs))


def _doubt(terms: Terms) -> Expr:
    """Return what is at most 1 where nothing is in doubt, if loops are closed."""
    rows = terms.rows
    worst = [moving.worst / LARGEST_ERROR for moving in terms.moving]
    return sum_of([rows.flatness * NEARLY_FLAT, *worst, *curved(rows)])


def _ends(poles: Sequence[Pole]) -> tuple[Indices, Indices]:
    first, second = np.array(poles, dtype=np.intp).reshape(-1, 2).T
    return first, second


def _pivots(motion: Motion, requests: Sequence[Request]) -> tuple[Pivot, ...] | None:
    """Return the order in which variables are eliminated, None where terms do not hold."""
    free = motion.free
    if not free:
        return ()
    good = np.flatnonzero(~motion.failed & (motion.configuration_error < 1e-6))
    if not len(good):
        good = np.flatnonzero(~motion.failed)
    if not len(good):
        return None
    chosen = good[np.unique(np.linspace(0, len(good) - 1, REFERENCES).astype(int))]
    pivots = pivots_of(motion.free_jacobian[chosen])
    if pivots is None:
        return None
    return tuple((loop, tuple(free[k] for k in columns)) for loop, columns in pivots)
