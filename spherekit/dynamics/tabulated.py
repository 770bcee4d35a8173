"""A mechanism's stored functions, evaluated without the mechanism: once made, quick.

`spherekit.dynamics.tabulate` computes everything that depends on the configuration alone
(Di Gregorio 2024, section 4), along one curve or over a box of several inputs; this module
evaluates it in control loops. It needs NumPy and the standard library only.

The direct problem of a stored model: its motion under its loads, in two scalars.

The state is the coordinate x of the model, q or s, the momentum p = sqrt(B) x' and the
work W of all loads. As in `spherekit.dynamics.state`, which holds in any coordinate,

    dx/dt = p / sqrt(B),   dp/dt = Q / sqrt(B),   dW/dt = Q dx/dt.
"""

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from itertools import chain
from math import sqrt
from typing import Any, final, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spherekit.checked import checked
from spherekit.conventions import Status, listing, nearest
from spherekit.dynamics.stored_model import (
    DAMAGED,
    NUMBER,
    SLACK,
    Archive,
    Floats,
    GridMetadata,
    ModelMetadata,
    Single,
    StoredFunction,
    StoredLoad,
    StoredModel,
)
from spherekit.errors import FileError, ModelError, SolveError
from spherekit.model.dynamics import DRIVE
from spherekit.numeric.cells import TensorChebyshev
from spherekit.numeric.chebyshev import PiecewiseChebyshev
from spherekit.numeric.local import LocalPolynomials
from spherekit.numeric.zeros import zeros

ARCHIVE = Archive("spherekit reduced model", 1, "write one with `--to model`")

CURVE_LAYOUT = (
    "groups[k] lists the functions in the columns of chebyshev_k, whose row c holds "
    "their Chebyshev series from edges_k[c] to edges_k[c + 1]; a periodic model repeats "
    "with the period high - low, in which the variables grow by rise"
)

BOX_LAYOUT = (
    "column f of coefficients[c] holds the tensor Chebyshev series of function f between "
    "bounds[c, 0] and bounds[c, 1]; splits are the halvings of the box, (direction, place, "
    "next below, next above), where -1 - c is cell c and 0 is outside the domain"
)

_BOX = ("splits", "bounds", "coefficients")


@final
@dataclass(frozen=True)
class TabulatedModel(StoredModel):
    """Functions of one coordinate x, which is q or s: see `ModelMetadata`.

    Every method takes numbers, in the least time, or arrays of any shape. Lengths of x
    beyond a period are laps; the range of a model that is not periodic must not be left.
    `groups` holds the functions of the heading's groups.
    """

    alone = True
    heading: ModelMetadata
    groups: tuple[PiecewiseChebyshev, ...]

    @overload
    def value(self, name: str, x: float) -> float: ...
    @overload
    def value(self, name: str, x: ArrayLike) -> Floats: ...

    def value(self, name: str, x: ArrayLike) -> float | Floats:
        """Return any stored function by its name in `heading.functions`."""
        value: float | Floats = self._value(name, x)
        return value

    @overload
    def inertia(self, x: float) -> float: ...
    @overload
    def inertia(self, x: ArrayLike) -> Floats: ...

    def inertia(self, x: ArrayLike) -> float | Floats:
        """Return the equivalent inertia B (kg m2) by x."""
        return self.value("B", x)

    @overload
    def inertia_rate(self, x: float) -> float: ...
    @overload
    def inertia_rate(self, x: ArrayLike) -> Floats: ...

    def inertia_rate(self, x: ArrayLike) -> float | Floats:
        """Return dB/dx (kg m2/rad)."""
        return self.value(self.heading.derivative("B"), x)

    def pole(self, name: str, x: ArrayLike) -> Floats:
        """Return the unit vector (3,) or (..., 3) of a pole axis, in ground axes.

        `name` is LINK/RELATIVE_TO, as "3/1"; either order names the same axis.
        """
        if self._is_one(x):
            if name not in self._poles:
                stored = self.heading.pole(name)[0]
                self._poles[name] = self._named(
                    *(f"pole {stored} {axis}" for axis in "xyz")
                )
            return np.array(self._poles[name](x))
        group, column = self.heading.place(f"pole {self.heading.pole(name)[0]} x")
        (q,), _, shape = self._together(x)
        return self._rows(group, q)[:, column : column + 3].reshape(*shape, 3)

    @overload
    def rate(self, name: str, x: float) -> float: ...
    @overload
    def rate(self, name: str, x: ArrayLike) -> Floats: ...

    def rate(self, name: str, x: ArrayLike) -> float | Floats:
        """Return the velocity coefficient of a pole.

        Times the pole's unit vector it is the angular velocity per unit rate of x of the
        first link, as `heading.poles` names it, relative to the second.
        """
        return self.value(f"rate {self.heading.pole(name)[0]}", x)

    @overload
    def rate_derivative(self, name: str, x: float) -> float: ...
    @overload
    def rate_derivative(self, name: str, x: ArrayLike) -> Floats: ...

    def rate_derivative(self, name: str, x: ArrayLike) -> float | Floats:
        """Return the acceleration coefficient of a pole, the derivative of `rate` by x."""
        heading = self.heading
        return self.value(heading.derivative(f"rate {heading.pole(name)[0]}"), x)

    def places(self, variable: str, value: float) -> Floats:
        """Return where (k,) on the range a pair variable has a value, rising.

        A variable of an R pair (rad) has it up to whole turns.
        """
        heading = self.heading
        if variable not in heading.variables:
            raise SolveError(
                f'{heading.mechanism}: "{variable}" is not a pair variable'
                f"{nearest(variable, heading.variables) or ';'} Variables: "
                f"{listing(heading.variables)}"
            )
        columns = self._columns((variable, heading.derivative(variable)))
        turns = variable in {f"theta_{pair}" for pair in heading.angles}

        def gap(x: Floats) -> tuple[Floats, Floats]:
            reached, rate = self.groups[0].at(x)[:, columns].T
            half = 0.5 * (reached - value)
            if turns:
                return np.sin(half), 0.5 * np.cos(half) * rate
            return half, 0.5 * rate

        edges = self.groups[0].edges
        parts = np.arange(8) / 8
        grid = (edges[:-1, None] + parts * np.diff(edges)[:, None]).ravel()
        return zeros(gap, np.append(grid, edges[-1])).places

    def with_torque(self, torque: str) -> "TabulatedModel":
        """Return the model with a torque (N m) at the input as one more load.

        Parameters
        ----------
        torque
            An expression in pair variables, their rates and the time, as in a file.

        Raises
        ------
        ModelError
            If the expression breaks the grammar, or there is such a torque already.
        """
        works_on = self.heading.derivative(f"theta_{self.heading.input}")
        loads = self._with_torques({DRIVE: (works_on, torque)})
        return TabulatedModel(replace(self.heading, loads=loads), self.groups)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the model to a NumPy archive (.npz) that describes itself.

        Raises
        ------
        OutputError
            If it cannot be written; an older file is then unchanged.
        """
        arrays: dict[str, Floats] = {}
        for k, group in enumerate(self.groups):
            arrays |= {f"edges_{k}": group.edges, f"chebyshev_{k}": group.coefficients}
        ARCHIVE.write(path, {**asdict(self.heading), "layout": CURVE_LAYOUT}, arrays)

    @cached_property
    def _poles(self) -> dict[str, Single]:
        """Directions at single places, by the pole's name, once asked for."""
        return {}

    def _is_one(self, x: Any) -> bool:
        return isinstance(x, NUMBER)

    def _together(
        self, *given: ArrayLike, t: ArrayLike = 0.0
    ) -> tuple[list[Floats], Floats, tuple[int, ...]]:
        numbers = [np.asarray(x, dtype=float) for x in (*given, t)]
        *parts, times = np.broadcast_arrays(*numbers)
        return [part.reshape(-1, 1) for part in parts], times.ravel(), times.shape

    def _places(self, shape: tuple[int, ...]) -> tuple[int, ...]:
        return shape

    def _rows(self, group: int, q: Floats) -> Floats:
        heading, x = self.heading, q[:, 0]
        low, lap = heading.low, heading.high - heading.low
        good = np.isfinite(x)
        if not heading.periodic:
            good &= (x >= low - SLACK * lap) & (x <= heading.high + SLACK * lap)
        if not np.all(good):
            heading.within(float(x[~good][0]))
        laps = np.floor((x - low) / lap) if heading.periodic else np.zeros_like(x)
        values = self.groups[group].at(x - laps * lap)
        if group == 0 and np.any(laps):
            values[:, : len(heading.rise)] += laps[:, None] * np.array(heading.rise)
        return values

    def _single(self, group: int, factors: Floats) -> Single:
        heading, series = self.heading, self.groups[group]
        size = np.array([function.largest for function in heading.groups[group]])
        mixed = PiecewiseChebyshev(series.edges, series.coefficients @ factors)
        polynomials = LocalPolynomials.of(mixed, size @ np.abs(factors))
        rise = np.zeros(len(factors))
        if group == 0:
            rise[: len(heading.rise)] = heading.rise
        rises = [(k, x) for k, x in enumerate((rise @ factors).tolist()) if x]
        low, high, inside, within = (
            heading.low,
            heading.high,
            polynomials.at,
            heading.within,
        )

        def at(x: float) -> list[float]:
            if low <= x < high:
                return inside(x)
            place, laps = within(x)
            row = inside(place)
            for k, growth in rises:
                row[k] += laps * growth
            return row

        return at


@final
@dataclass(frozen=True)
class GridModel(StoredModel):
    """Functions of the m inputs q (rad) of one assembly mode.

    Every method takes one place (m,), in the least time, or places (n, m).
    """

    alone = False
    heading: GridMetadata
    series: TensorChebyshev

    def value(self, name: str, q: ArrayLike) -> float | Floats:
        """Return any stored function by its name in `heading.functions`."""
        value: float | Floats = self._value(name, q)
        return value

    def status(self, q: ArrayLike) -> NDArray[np.int8]:
        """Return (n,) of places (n, m): OK, or OUT_OF_REACH outside the domain."""
        cells = self.series.cells(self._together([*np.atleast_2d(q)])[0][0])
        return np.where(cells >= 0, Status.OK, Status.OUT_OF_REACH).astype(np.int8)

    def accelerations(
        self, q: ArrayLike, dq: ArrayLike, torques: ArrayLike, t: float = 0.0
    ) -> Floats:
        """Return the accelerations (m,) of the inputs (rad/s2) under torques (m,) there."""
        needed = self.torque(q, dq, np.zeros(len(self.heading.inputs)), t)
        accelerations = np.linalg.solve(self.inertia(q), np.asarray(torques) - needed)
        return np.asarray(accelerations, dtype=float)

    def inertia(self, q: ArrayLike) -> Floats:
        """Return the inertia matrix (m, m) or (n, m, m), kg m2."""
        return self._shaped(q, self._inertia)

    def velocity(self, pole: str, q: ArrayLike) -> Floats:
        """Return angular velocities (m, 3) or (n, m, 3) per unit rate of each input.

        `pole` is LINK/RELATIVE_TO, as "3/1": of the first link relative to the second, in
        ground axes. Its direction is the pole axis while that input moves alone, its length
        the coefficient.
        """
        name, sense = self.heading.pole(pole)
        places = [
            self._columns(f"velocity {name} {axis} by {pair}" for axis in "xyz")
            for pair in self.heading.inputs
        ]
        return self._shaped(q, lambda rows: sense * rows[:, places])

    def with_torque(self, torques: Mapping[str, str]) -> "GridModel":
        """Return the model with torques (N m) at inputs, expressions as in a file.

        Raises
        ------
        ModelError
            If an expression breaks the grammar, or there is no such input, or one has a
            torque already.
        """
        heading = self.heading
        for pair in torques:
            if pair not in heading.inputs:
                raise ModelError(
                    f'{heading.mechanism}: torque: "{pair}" is not an input'
                    f"{nearest(pair, heading.inputs) or ';'} Inputs: "
                    f"{listing(heading.inputs)}"
                )
        named = {f"{DRIVE}_{p}": (f"theta_{p}", text) for p, text in torques.items()}
        return GridModel(replace(heading, loads=self._with_torques(named)), self.series)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the model to a NumPy archive (.npz) that describes itself.

        Raises
        ------
        OutputError
            If it cannot be written; an older file is then unchanged.
        """
        arrays = {name: getattr(self.series, name) for name in _BOX}
        ARCHIVE.write(path, {**asdict(self.heading), "layout": BOX_LAYOUT}, arrays)

    def _is_one(self, x: Any) -> bool:
        return isinstance(x[0], NUMBER)

    def _together(
        self, *given: ArrayLike, t: ArrayLike = 0.0
    ) -> tuple[list[Floats], Floats, tuple[int, ...]]:
        first, inputs = np.asarray(given[0], dtype=float), self.heading.inputs
        if first.ndim not in (1, 2) or first.shape[-1] != len(inputs):
            raise SolveError(
                f"{self.heading.mechanism}: places are arrays (n, {len(inputs)}) of the "
                f"inputs {listing(inputs)}, not {first.shape}"
            )
        if first.ndim == 1:
            self._cell(first.tolist())
        numbers = [np.atleast_2d(np.asarray(x, dtype=float)) for x in given]
        times = np.asarray(t, dtype=float).reshape(-1, 1)
        *parts, every = np.broadcast_arrays(*numbers, times)
        return parts, every[:, 0], parts[0].shape

    def _places(self, shape: tuple[int, ...]) -> tuple[int, ...]:
        return shape[:-1]

    def _rows(self, group: int, q: Floats) -> Floats:
        return self.series.at(q)

    def _single(self, group: int, factors: Floats) -> Single:
        cells, cell = self.series.mixed(factors), self._cell
        return lambda q: cells.at(cell(q), q).tolist()  # type: ignore[no-any-return]

    def _shaped(self, q: ArrayLike, function: Callable[[Floats], Floats]) -> Floats:
        """Return a function of rows at one place, or at several."""
        made = function(self._rows(0, self._together(q)[0][0]))
        return made[0] if np.ndim(q) == 1 else made

    def _cell(self, q: Sequence[float]) -> int:
        heading = self.heading
        for value, low, high in zip(q, heading.low, heading.high, strict=True):
            if not low <= value <= high:
                raise self._outside(q)
        cell = self.series.cell(q)
        if cell < 0:
            raise self._outside(q)
        return cell

    def _outside(self, q: Sequence[float]) -> SolveError:
        heading = self.heading
        ends = zip(heading.inputs, q, heading.low, heading.high, strict=True)
        asked, spans = zip(
            *(
                (f"{pair} = {float(value):.9g}", f"{pair} {low:.6g} to {high:.6g}")
                for pair, value, low, high in ends
            ),
            strict=True,
        )
        return SolveError(
            f"{heading.mechanism}: the model is asked for {listing(asked)} rad, which is "
            f"not in its domain: {heading.covered:.3g} of the box {listing(spans)} rad. "
            f"Elsewhere assembly mode {heading.assembly_mode} does not exist or is near a "
            "singularity"
        )


@checked(FileError)
def load_reduced(path: str | os.PathLike[str]) -> TabulatedModel | GridModel:
    """Return a model that `TabulatedModel.save` wrote, or `GridModel.save`.

    Raises
    ------
    FileError
        If it cannot be read, is no such model or of another version, is cut short, or
        has numbers that are not finite.
    """
    where = repr(str(path))
    header, arrays = ARCHIVE.read(path)
    try:
        loads = tuple(StoredLoad(**given) for given in header["loads"])
        kind = GridMetadata if "inputs" in header else ModelMetadata
        given = {name: header[name] for name in kind.__dataclass_fields__}
        given["loads"] = loads
        if kind is GridMetadata:
            given["functions"] = _functions(header["functions"])
            return _over_box(where, GridMetadata(**given), arrays)
        given["groups"] = tuple(map(_functions, header["groups"]))
        return _along_curve(where, ModelMetadata(**given), arrays)
    except DAMAGED as error:
        raise ARCHIVE.damaged(where, error) from None


def _functions(given: Sequence[Mapping[str, Any]]) -> tuple[StoredFunction, ...]:
    return tuple(StoredFunction(**item) for item in given)


def _along_curve(
    where: str, heading: ModelMetadata, arrays: Mapping[str, Floats]
) -> TabulatedModel:
    numbers = [heading.low, heading.high, *heading.rise]
    numbers += [x for item in heading.functions for x in (item.largest, item.error)]
    if not (np.all(np.isfinite(numbers)) and heading.low < heading.high):
        raise FileError(
            f"{where}: the heading has numbers that are not finite; make it anew"
        )
    made = []
    for k, group in enumerate(heading.groups):
        edges, series = arrays[f"edges_{k}"], arrays[f"chebyshev_{k}"]
        rising = edges.ndim == 1 and len(edges) > 1 and bool(np.all(np.diff(edges) > 0.0))
        if not rising or series.ndim != 3 or len(series) != len(edges) - 1:
            raise FileError(f"{where}: the cells of group {k} do not rise; make it anew")
        if series.shape[2] != len(group):
            raise FileError(
                f"{where}: chebyshev_{k} has {series.shape[2]} columns for {len(group)} "
                "functions; make it anew"
            )
        bad = np.argwhere(~np.isfinite(series))
        if len(bad):
            raise FileError(
                f'{where}: "{group[bad[0][2]].name}" has coefficients that are not finite; '
                "make it anew"
            )
        made.append(PiecewiseChebyshev(edges, series))
    return TabulatedModel(heading, tuple(made))


def _over_box(where: str, heading: GridMetadata, arrays: Mapping[str, Floats]) -> GridModel:
    splits, bounds, coefficients = (arrays[name] for name in _BOX)
    low, high = np.array(heading.low), np.array(heading.high)
    shape, m = coefficients.shape, len(heading.inputs)
    fits = len(shape) == m + 2 and shape[-1] == len(heading.functions)
    fits = fits and bounds.shape == (shape[0], 2, m)
    if not (fits and splits.ndim == 2 and splits.shape[1] == 4):
        raise FileError(f"{where}: its cells do not fit its functions; make it anew")
    if not all(np.all(np.isfinite(x)) for x in (splits, bounds, coefficients)):
        raise FileError(f"{where}: has numbers that are not finite; make it anew")
    return GridModel(heading, TensorChebyshev(low, high, splits, bounds, coefficients))


MARGIN = 0.03
"""The integrator's own tolerance per step, as part of the error tolerated in the end."""


@final
@dataclass(frozen=True)
class TabulatedMotion:
    """The motion at times `t` (n,), s; NaN after the curve has ended.

    `x` (n,) coordinate of the model; `values`, `value_rates` (n, variables); `q`, `dq` of
    the input, rad and rad/s; `kinetic`, `work` (n,) J; `message` says why it ended;
    `evaluations` counts calls of the right-hand side.
    """

    t: Floats
    x: Floats
    values: Floats
    value_rates: Floats
    q: Floats
    dq: Floats
    kinetic: Floats
    work: Floats
    message: str
    evaluations: int

    @property
    def energy(self) -> float:
        """Largest difference of kinetic energy gained and work of the loads, J."""
        gap = self.kinetic - self.kinetic[0] - self.work
        return float(np.nanmax(np.abs(gap)))


@checked(SolveError)
def online_motion(
    model: TabulatedModel,
    times: Sequence[float] | Floats,
    x: float,
    dx: float,
    tolerance: float = 1e-9,
    switches: Iterable[float] = (),
) -> TabulatedMotion:
    """Return the motion of a stored model at times (n,), by SciPy's LSODA.

    Parameters
    ----------
    model
        One with masses; a driving torque is given by `OnlineModel.with_torque`.
    times
        Increasing times (s), the first that of the start.
    x, dx
        Coordinate of the model and its rate at the start.
    tolerance
        Error aimed at in x (rad).
    switches
        Times (s) at which expressions have kinks; knots of torque tables are known.

    Raises
    ------
    SolveError
        If times do not increase, the model has no inertia or not this coordinate, or the
        integrator gives up.
    """
    heading, name = model.heading, model.heading.mechanism
    t = np.atleast_1d(np.asarray(times, dtype=float))
    if len(t) < 2 or not (np.all(np.isfinite(t)) and np.all(np.diff(t) > 0.0)):
        raise SolveError(f"{name}: give two or more finite, increasing times")
    at, low, high = model.dynamics.at, heading.low, heading.high
    inertia = at(x)[0]
    if not inertia > 0.0:
        raise SolveError(f"{name}: has no inertia, so loads would accelerate it endlessly")

    def right(time: float, state: Floats) -> tuple[float, float, float]:
        place, p, _ = state.tolist()
        within = place if heading.periodic else min(max(place, low), high)
        row = at(within)
        root = 1.0 / sqrt(row[0])
        speed = p * root
        push = row[1] * speed * speed - model.torque_at(row, within, speed, 0.0, time)
        return speed, push * root, push * speed

    tighter = max(MARGIN * tolerance, 1e-14)
    start, stop = float(t[0]), float(t[-1])
    tables = [load.table.knots(start, stop) for load in heading.loads if load.table]
    critical = sorted(k for k in {*chain(switches, *tables)} if start < k < stop)
    from scipy.integrate import odeint

    states, notes = odeint(
        right,
        [x, sqrt(inertia) * dx, 0.0],
        t,
        tfirst=True,
        rtol=tighter,
        atol=tighter,
        mxstep=100_000,
        tcrit=critical or None,
        full_output=True,
    )
    if notes["message"] != "Integration successful.":
        raise SolveError(f"{name}: {notes['message']}")
    return _motion(model, t, states, int(notes["nfe"][-1]))


def _motion(
    model: TabulatedModel, t: Floats, states: Floats, evaluations: int
) -> TabulatedMotion:
    """Return the motion of states (n, 3): the coordinate, momentum and work."""
    heading = model.heading
    message, reached = "", states[:, 0]
    if not heading.periodic:
        beyond = np.flatnonzero((reached < heading.low) | (reached > heading.high))
        if len(beyond):
            message = f"the curve ends before t = {t[beyond[0]]:.6g} s"
            states[beyond[0] :] = np.nan
    places, p, work = states.T
    finite = np.isfinite(places)
    rows = np.full((2, len(heading.variables), len(t)), np.nan)
    speeds = np.full(len(t), np.nan)
    speeds[finite] = p[finite] / np.sqrt(model.inertia(places[finite]))
    for k, variable in enumerate(heading.variables):
        for row, function in zip(
            rows, (variable, heading.derivative(variable)), strict=True
        ):
            row[k, finite] = model.value(function, places[finite])
    values, rates = rows[0].T, rows[1].T * speeds[:, None]
    driven = heading.variables.index(f"theta_{heading.input}")
    return TabulatedMotion(
        t,
        places,
        values,
        rates,
        values[:, driven],
        rates[:, driven],
        0.5 * p**2,
        work,
        message,
        evaluations,
    )
