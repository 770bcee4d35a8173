"""The functions that give a run its rows: what decides about them, then all columns."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import EQUAL_CURVATURE
from spherekit.engine.arrays import ArrayFunction, array_function
from spherekit.engine.block_elimination import Pivot, pivots_of
from spherekit.engine.cache import COMPILED
from spherekit.engine.carried_vectors import largest
from spherekit.engine.columns import (
    LARGEST_ERROR,
    Outputs,
    Place,
    PolePlaces,
    RatePlaces,
    Terms,
)
from spherekit.engine.compiler import CompiledFunction, compile_function
from spherekit.engine.expression_graph import Expr
from spherekit.engine.parted_places import PartedPlaces
from spherekit.engine.profile_columns import ProfileColumns, with_columns
from spherekit.motion.motion import Motion
from spherekit.planning.poles import Pole
from spherekit.rates.columns import PoleColumns, RateColumns
from spherekit.rates.core import NEARLY_FLAT
from spherekit.rates.request import Request
from spherekit.sphere.rotation import Floats

REFERENCES = 32
"""Configurations at most that say in which order variables are eliminated."""

Engine = Literal["numpy", "compiled"]
_Function = CompiledFunction | ArrayFunction


@final
@dataclass(frozen=True)
class _InputPlaces:
    """Of an input that moves: how doubtful a row is, and how links turn.

    From the column `first` on there are the angular velocities of `turning` links, then
    `errors` columns: the largest errors of directions, rates and changes. `still`
    (links, 3) are the angular velocities that do not change. `poles` are those without a
    sense of their own, by the places of their links among those that turn, then the others.
    """

    worst: Place
    first: int
    turning: int
    errors: int
    still: Floats
    poles: tuple[NDArray[np.intp], NDArray[np.intp]]


@final
@dataclass(frozen=True)
class RowFunction:
    """A function of all pair variables, with columns that decide about rows.

    `places` are by how much loops are open, how flat the mechanism is, and what the
    configuration is off by. `curved` are by how much more the first profile of each
    contact curves than the second, where that is no number.
    """

    function: _Function
    profiles: tuple[ProfileColumns, ...]
    width: int
    places: tuple[Place, Place, Place]
    curved: tuple[Place, ...]
    inputs: tuple[_InputPlaces, ...]
    open_by_rounding: float

    def __call__(self, values: Floats, out: Floats | None = None) -> Floats:
        """Return all columns (columns, n) of variables (variables, n)."""
        return np.asarray(self.function(with_columns(values, self.profiles), out))

    def residual(self, columns: Floats) -> Floats:
        """Return (n,) by how much loops are open, rad."""
        return np.asarray(self.places[0].of(columns)[0])

    def off(self, columns: Floats) -> Floats:
        """Return (n,) the errors of configurations."""
        return np.asarray(self.places[2].of(columns)[0])

    def closed(self, columns: Floats) -> NDArray[np.bool_]:
        """Return which rows (n,) have loops no more open than numbers are rounded."""
        return np.asarray(self.residual(columns) <= self.open_by_rounding)

    def vouched(self, columns: Floats) -> NDArray[np.bool_]:
        """Return which rows (n,) the kernel vouches for, if their loops are closed.

        Of these the numbers are as good as those that are found with care.
        """
        good = self.places[1].of(columns)[0] <= 1.0 / NEARLY_FLAT
        for curved in self.curved:
            good &= curved.of(columns)[0] >= 2.0 * EQUAL_CURVATURE
        for places in self.inputs:
            good &= places.worst.of(columns)[0] <= LARGEST_ERROR
        return np.asarray(good)

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
        return np.asarray(w[second] - other[first])

    def errors(self, columns: Floats, number: int) -> Floats:
        """Return (3, n) the largest errors of directions, rates, changes, by an input."""
        places = self.inputs[number]
        start = places.first + 3 * places.turning
        return columns[start : start + places.errors]


@final
@dataclass(frozen=True)
class RowKernel:
    """What gives the rows of a run, see `row_kernel`.

    `judging` gives what decides about rows, `whole` all columns, the first `kept` of which
    are results; `residual` is the column that says by how much loops are open. `free` are
    the variables that are no inputs.
    """

    rates: tuple[RatePlaces, ...]
    kept: int
    residual: int
    free: tuple[int, ...]
    judging: RowFunction
    _make_whole: Callable[[], RowFunction]
    _make_closing: Callable[[], _Function]
    _make_signed: Callable[[], ArrayFunction]

    @cached_property
    def whole(self) -> RowFunction:
        """The function of all columns, made when it is first asked for."""
        return self._make_whole()

    @cached_property
    def parted(self) -> PartedPlaces:
        """Places that share no column."""
        return PartedPlaces.of(self.rates, self.residual)

    @cached_property
    def _closing(self) -> _Function:
        return self._make_closing()

    @cached_property
    def _signed(self) -> ArrayFunction:
        return self._make_signed()

    def closer(self, values: Floats) -> Floats:
        """Return the variables `free`, (variables, n), closer to where loops close.

        By a step of Newton's method.
        """
        return np.asarray(self._closing(with_columns(values, self.judging.profiles)))

    def signed_at(self, values: Floats) -> list[Floats]:
        """Return by input (8, poles, n) what has a sign of its own, of few rows."""
        given = with_columns(values, self.judging.profiles)
        columns, made, first = self._signed(given), [], 0
        for places in self.rates:
            count = len(places.signed)
            made.append(columns[first : first + 8 * count])
            made[-1] = made[-1].reshape(8, count, values.shape[1])
            first += 8 * count
        return made


def signed_columns(places: RatePlaces, columns: Floats) -> Floats:
    """Return (8, poles, n) what has a sign of its own, from all columns: a view."""
    count = len(places.signed)
    block = columns[places.block : places.block + 8 * count]
    return block.reshape(8, count, columns.shape[1])


def read_columns(places: RatePlaces, columns: Floats) -> RateColumns:
    """Return the rates of an input, as views of columns that are kept."""
    signed = signed_columns(places, columns)
    return RateColumns(
        {pole: _pole(places, pole, columns, signed) for pole in places.poles},
        {link: place.of(columns) for link, place in places.w.items()},
        {link: place.of(columns) for link, place in places.dw.items()},
    )


def _pole(places: RatePlaces, pole: Pole, columns: Floats, signed: Floats) -> PoleColumns:
    at: PolePlaces = places.poles[pole]
    if at.axis is None:
        k = places.signed.index(pole)
        unit, turn, rate, change = signed[:3, k], signed[3:6, k], signed[6, k], signed[7, k]
    else:
        unit, turn, first, second = (place.of(columns) for place in at.axis)
        rate, change = first[0], second[0]
    angle, *errors = (part.of(columns)[0] for part in (at.angle, *at.errors))
    one, other, last = errors
    return PoleColumns(unit, turn, rate, change, angle, one, other, last)


def row_kernel(
    motion: Motion, requests: Sequence[Request], engine: Engine
) -> RowKernel | None:
    """Return the kernel of what `requests` want of a mechanism's rows.

    The closed configurations of a motion say in which order variables are eliminated.
    None where the terms do not hold: without loops, where axes of pairs coincide but for
    rounding, and where links that have a pole rest.
    """
    pivots = _pivots(motion, requests)
    if pivots is None:
        return None

    def make() -> RowKernel | None:
        terms = Terms.of(motion, requests, pivots)
        return None if terms is None else _kernel(terms, motion.free, engine)

    return COMPILED.get(motion.mechanism, _key("rows", requests, pivots, engine), make)


def _kernel(terms: Terms, free: tuple[int, ...], engine: Engine) -> RowKernel:
    rows, results = terms.rows, terms.outputs
    residual = results.place(rows.residual).first
    rates = tuple(moving.placed(results) for moving in terms.moving)
    kept, judged = len(results.columns), Outputs()
    by = compile_function if engine == "compiled" else array_function

    def deciding(outputs: Outputs, errors: Sequence[Sequence[Expr]]) -> RowFunction:
        inputs = []
        for moving, places, largest_ones in zip(terms.moving, rates, errors, strict=True):
            first, turning, still = len(outputs.columns), moving.turning, moving.still
            outputs.columns += [x for w in turning.values() for x in w] + [*largest_ones]
            order = [*turning, *still]
            inputs.append(
                _InputPlaces(
                    outputs.place(moving.worst),
                    first,
                    len(turning),
                    len(largest_ones),
                    np.array([*still.values()], dtype=float).reshape(-1, 3),
                    _ends([(order.index(i), order.index(j)) for i, j in places.signed]),
                )
            )
        closure = rows.residual, rows.flatness, rows.moved_by
        one, other, last = (outputs.place(item) for item in closure)
        curved = tuple(outputs.place(item) for item in rows.curved)
        return RowFunction(
            by(outputs.columns, terms.given),
            rows.pairs.columns,
            len(outputs.columns),
            (one, other, last),
            curved,
            tuple(inputs),
            rows.open_by_rounding,
        )

    signed = [
        column
        for places in rates
        for column in results.columns[places.block : places.block + 8 * len(places.signed)]
    ]
    errors = [
        [
            largest(results.item(pole.errors[k]) for pole in places.poles.values())
            for k in range(3)
        ]
        for places in rates
    ]
    return RowKernel(
        rates,
        kept,
        residual,
        free,
        deciding(judged, errors),
        lambda: deciding(results, [()] * len(rates)),
        lambda: by(rows.closer(terms.variables), terms.given),
        lambda: array_function(signed, terms.given),
    )


def _ends(poles: Sequence[Pole]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    first, second = np.array(poles, dtype=np.intp).reshape(-1, 2).T
    return first, second


@final
@dataclass(frozen=True)
class PoleKernel:
    """Directions, rates and derivatives of rates of poles, of all pair variables."""

    width: int
    profiles: tuple[ProfileColumns, ...]
    function: _Function

    def __call__(self, values: Floats, out: Floats | None = None) -> Floats:
        """Return (5 for each pole and input, n) of variables (variables, n)."""
        return np.asarray(self.function(with_columns(values, self.profiles), out))


def pole_kernel(
    motion: Motion, requests: Sequence[Request], engine: Engine
) -> PoleKernel | None:
    """Return what is the least of `row_kernel`: poles and rates, without any bounds."""
    pivots = _pivots(motion, requests)
    if pivots is None:
        return None

    def make() -> PoleKernel | None:
        terms = Terms.of(motion, requests, pivots)
        if terms is None:
            return None
        items = [item for moving in terms.moving for item in moving.poles(terms.outputs)]
        by = compile_function if engine == "compiled" else array_function
        return PoleKernel(len(items), terms.rows.pairs.columns, by(items, terms.given))

    return COMPILED.get(motion.mechanism, _key("poles", requests, pivots, engine), make)


def _key(
    name: str, requests: Sequence[Request], pivots: Sequence[Pivot], engine: str
) -> str:
    wanted = tuple(
        (item.plan.input, item.poles, item.derivatives, tuple(sorted(item.links)))
        for item in requests
    )
    return repr((name, wanted, pivots, engine))


def _pivots(motion: Motion, requests: Sequence[Request]) -> tuple[Pivot, ...] | None:
    """Return the order in which variables are eliminated, None where terms do not hold."""
    free = motion.free
    good = np.flatnonzero(~motion.failed & (motion.configuration_error < 1e-6))
    if not free or not motion.linearisation.tree.chords or not len(good):
        return None
    if any(item.plan.rounded_axes for item in requests):
        return None
    chosen = good[np.unique(np.linspace(0, len(good) - 1, REFERENCES).astype(int))]
    pivots = pivots_of(motion.free_jacobian[chosen])
    if pivots is None:
        return None
    return tuple((loop, tuple(free[k] for k in columns)) for loop, columns in pivots)
