"""A mechanism's stored functions, evaluated without the mechanism: once made, quick.

`spherekit.dynamics.reduced_model_maker` computes everything that depends on the
configuration alone (Di Gregorio 2024, section 4), along one curve or over a box of several
inputs; this module evaluates it in control loops. It needs NumPy and the standard library
only.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property, partial
from itertools import chain
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from spherekit.argument_validation import checked
from spherekit.arrays import Floats, SmallIntegers
from spherekit.conventions import AnyPath, Facts, Names
from spherekit.dynamics.reduced_model_archive import (
    SLACK,
    StoredFunction,
    StoredHeading,
    StoredLoad,
    read_archive,
    write_archive,
)
from spherekit.errors import FileError, ModelError, SolveError
from spherekit.geometry.vectors import all_finite
from spherekit.mechanism.load_expression import load_names, parse
from spherekit.mechanism.load_kinds import DRIVE_LOAD_NAME
from spherekit.numerics.chebyshev import PiecewiseChebyshev
from spherekit.numerics.local_polynomials import make_local_polynomials
from spherekit.numerics.tensor_chebyshev import CellSums, TensorChebyshev
from spherekit.numerics.zeros import find_zeros
from spherekit.status import Status
from spherekit.symbolic.expression_evaluation import (
    ArrayFunction,
    FloatFunction,
    array_function,
    float_function,
)
from spherekit.symbolic.expression_graph import ExpressionNode, iterate_nodes, symbols
from spherekit.wording import choices, listing

KIND = ("spherekit reduced model", 2, "write one with `--to model`")

LAYOUT = (
    "groups[k] lists the functions in the columns of arrays of that number. Along a curve "
    "row c of coefficients_k holds their Chebyshev series from edges_k[c] to "
    "edges_k[c + 1]; a periodic model repeats with the period high - low, in which the "
    "variables grow by rise. Over a box column f of coefficients_k[c] holds the tensor "
    "Chebyshev series of function f between bounds_k[c, 0] and bounds_k[c, 1]; splits_k "
    "are the halvings of the box, (direction, place, next below, next above), where -1 - c "
    "is cell c and 0 is outside the domain"
)

NUMBER = (float, int)
"""What is one place; a tuple is tested in less time than a union."""

Place = TypeVar("Place", float, Floats)

Single = Callable[[Any], list[float]]
"""Some functions at one place, in the least time."""


@dataclass(frozen=True)
class StoredModel:
    """Functions of m coordinates of one assembly mode: see `StoredHeading`.

    A place on a curve is a number, over a box a sequence (m,). Every method takes one
    place, in the least time, or along a curve an array of any shape, over a box places
    (n, m). Numbers on a curve that are beyond a period are laps; the range of a model that
    is not periodic must not be left. `groups` holds the functions of the heading's groups.
    """

    heading: StoredHeading
    groups: tuple[PiecewiseChebyshev | TensorChebyshev, ...]

    def __getstate__(self) -> Facts:
        # Printed functions, and the terms they are of, stay in their process.
        return {"heading": replace(self.heading), "groups": self.groups}

    @property
    def error(self) -> float:
        """Largest measured error of all functions, relative to the largest of each."""
        return max(function.error for function in self.heading.functions)

    def torque(self, x: Any, dx: Any, ddx: Any, t: Any = 0.0) -> Any:
        """Return the torques (N m) of the actuators for this motion, all loads acting.

        M x'' + C x' - Q, of one coordinate B x'' + 1/2 dB/dx x'^2 - Q (Di Gregorio 2024,
        eq. (21)). With coordinates of inputs they act at these; with the arc length s it
        is per unit of that, and the torque at a pair is that divided by the pair's rate
        along the curve.

        Parameters
        ----------
        x, dx, ddx
            Coordinates (rad) and their first and second rates by time.
        t
            Time (s) for loads that depend on it.

        Raises
        ------
        SolveError
            At a single place outside the domain; rows of several inputs are NaN there.
        """
        if self._is_one(x):
            return self.torque_at(self.dynamics[0](x), x, dx, ddx, t)
        states, times, shape = self._together(x, dx, ddx, t=t)
        return self._shaped(self._torques(self._given(states, times)).T, shape)

    def forces(self, x: ArrayLike, dx: ArrayLike, t: ArrayLike = 0.0) -> dict[str, Floats]:
        """Return each load's generalised forces Q (N m) by its name, shaped as x."""
        states, times, shape = self._together(x, dx, dx, t=t)
        loads, columns = self.heading.loads, self._forces(self._given(states, times))
        columns = columns.reshape(len(loads), len(self.heading.by), len(times))
        parts = zip(loads, columns, strict=True)
        return {load.name: self._shaped(part.T, shape) for load, part in parts}

    def _given(self, states: Sequence[Floats], t: Floats) -> Floats:
        """Return what terms are of (k, n) in states (n, m) of coordinates and two rates."""
        q, *rates = states
        moving = (row for rate in rates for row in rate.T)
        tables = (table.at(t) for table in self.heading.tables)
        return np.array([*self._rows(0, q).T, *moving, t, *tables])

    @cached_property
    def _torques(self) -> ArrayFunction:
        return array_function(self.heading.torques, self._variables)

    @cached_property
    def _forces(self) -> ArrayFunction:
        return array_function([*chain(*self.heading.forces)], self._variables)

    @property
    def _variables(self) -> list[ExpressionNode]:
        names = (function.name for function in self.heading.groups[0])
        return [*symbols(names), *self.heading.motion]

    def value(self, name: str, x: Any) -> Any:
        """Return any stored function by its name in `heading.functions`."""
        if self._is_one(x):
            return self._single(name)(x)[0]
        return self.functions([name], x)[..., 0]

    def functions(self, names: Sequence[str], x: ArrayLike) -> Floats:
        """Return stored functions (..., k) of one group by their names, at many places."""
        (q,), _, shape = self._together(x)
        rows = self._rows(self.heading.place(names[0])[0], q)
        return rows[:, self._columns(names)].reshape(*shape[:-1], len(names))

    def inertia(self, x: Any) -> Any:
        """Return the inertia matrix (..., m, m) kg m2, along a curve the number B."""
        if self.heading.alone:
            return self.value("B", x)
        i, k = np.tril_indices(len(self.heading.by))
        M = np.empty((*np.shape(x), len(self.heading.by)))
        M[..., i, k] = M[..., k, i] = self.functions(self.heading.inertia, x)
        return M

    def inertia_rate(self, x: Place) -> Place:
        """Return dB/dx (kg m2/rad) along a curve."""
        return self.value(self.heading.derivative("B"), x)

    def accelerations(
        self, q: ArrayLike, dq: ArrayLike, torques: ArrayLike, t: float = 0.0
    ) -> Floats:
        """Return the accelerations (m,) of the inputs (rad/s2) under torques (m,) there."""
        needed = self.torque(q, dq, np.zeros(np.shape(q)), t)
        left = np.atleast_1d(np.asarray(torques) - needed)
        return np.linalg.solve(np.atleast_2d(self.inertia(q)), left)

    def status(self, q: ArrayLike) -> SmallIntegers:
        """Return (n,) of places: OK, or OUT_OF_REACH outside the domain."""
        (places,), *_ = self._together(np.atleast_1d(q))
        inside = np.isfinite(self._rows(0, places)[:, 0])
        return np.where(inside, Status.OK, Status.OUT_OF_REACH).astype(np.int8)

    def pole(self, name: str, x: ArrayLike) -> Floats:
        """Return the unit vector (3,) or (..., 3) of a pole axis, in ground axes.

        `name` is LINK/RELATIVE_TO, as "3/1"; either order names the same axis. Of a curve.
        """
        stored = self.heading.pole(name)[0]
        names = [f"pole {stored} {axis}" for axis in "xyz"]
        if self._is_one(x):
            return np.array(self._single(*names)(x))
        return self.functions(names, x)

    def rate(self, name: str, x: Place) -> Place:
        """Return the velocity coefficient of a pole of a curve.

        `name` is LINK/RELATIVE_TO, as "3/1". Times the pole's unit vector the coefficient
        is the angular velocity of the first link relative to the second, per unit rate of
        x.
        """
        stored, sense = self.heading.pole(name)
        return sense * self.value(f"rate {stored}", x)

    def rate_derivative(self, name: str, x: Place) -> Place:
        """Return the acceleration coefficient of a pole, the derivative of `rate` by x."""
        stored, sense = self.heading.pole(name)
        return sense * self.value(self.heading.derivative(f"rate {stored}"), x)

    def velocity(self, pole: str, q: ArrayLike) -> Floats:
        """Return angular velocities (..., m, 3) per unit rate of each input, over a box.

        `pole` is LINK/RELATIVE_TO, as "3/1": of the first link relative to the second, in
        ground axes. Its direction is the pole axis while that input moves alone, its length
        the coefficient.
        """
        name, sense = self.heading.pole(pole)
        by = [self.heading.by_coordinates(f"velocity {name} {axis}") for axis in "xyz"]
        names = [*chain(*zip(*by, strict=True))]
        return sense * self.functions(names, q).reshape(*np.shape(q), 3)

    def places(self, variable: str, value: float) -> Floats:
        """Return where (k,) on a curve a pair variable has a value, rising.

        A variable of an R pair (rad) has it up to whole turns.
        """
        heading, series = self.heading, self.groups[0]
        if variable not in heading.variables:
            raise SolveError(
                f'{heading.mechanism}: "{variable}" is not a pair variable'
                f"{choices(variable, heading.variables, 'Variables')}"
            )
        columns = self._columns((variable, heading.derivative(variable)))
        assert isinstance(series, PiecewiseChebyshev)
        turns = variable in {f"theta_{pair}" for pair in heading.angles}

        def gap(x: Floats) -> tuple[Floats, Floats]:
            reached, rate = series.evaluate(x)[:, columns].T
            half = 0.5 * (reached - value)
            if turns:
                return np.sin(half), 0.5 * np.cos(half) * rate
            return half, 0.5 * rate

        return find_zeros(gap, series.spread_positions(8)).places

    def with_torque(self, torque: str | Mapping[str, str]) -> "StoredModel":
        """Return the model with torques (N m) at inputs as more loads.

        Parameters
        ----------
        torque
            An expression in pair variables, their rates and the time, as in a file, at the
            first input, or one for each of some inputs by their names.

        Raises
        ------
        ModelError
            If an expression breaks the grammar, or there is no such input, or one has a
            torque already.
        """
        heading = self.heading
        given = {heading.inputs[0]: torque} if isinstance(torque, str) else torque
        loads = list(heading.loads)
        for pair, text in given.items():
            if pair not in heading.inputs:
                raise ModelError(
                    f'{heading.mechanism}: torque: "{pair}" is not an input'
                    f"{choices(pair, heading.inputs, 'Inputs')}"
                )
            name = DRIVE_LOAD_NAME if heading.alone else f"{DRIVE_LOAD_NAME}_{pair}"
            if any(load.name == name for load in loads):
                raise ModelError(f"{heading.mechanism}: torque: the model has one already")
            try:
                parse(text, load_names(heading.angles))
            except ModelError as error:
                raise ModelError(f"{heading.mechanism}: torque: {error}") from None
            loads.append(StoredLoad(name, (f"theta_{pair}",), (text,)))
        return StoredModel(replace(heading, loads=tuple(loads)), self.groups)

    def save(self, path: AnyPath) -> None:
        """Write the model to a NumPy archive (.npz) that describes itself.

        Raises
        ------
        OutputError
            If it cannot be written; an older file is then unchanged.
        """
        arrays = {
            f"{name}_{k}": getattr(group, name)
            for k, group in enumerate(self.groups)
            for name in _names(self.heading)
        }
        write_archive(path, KIND, {**asdict(self.heading), "layout": LAYOUT}, arrays)

    @cached_property
    def dynamics(self) -> tuple[Single, FloatFunction]:
        """What torques need at a place, the inertia first, and their function.

        Of that row and the motion there; along a curve dB/dx comes next.
        """
        heading = self.heading
        first = symbols([*heading.inertia, *heading.christoffel[0]])
        stored = [
            x
            for x in iterate_nodes([*first, *heading.torques])
            if x.operation == "variable" and x not in heading.motion
        ]
        single = self._single(*(x.arguments[0] for x in stored))
        return single, float_function(heading.torques, [*stored, *heading.motion])

    def torque_at(self, row: list[float], x: Any, dx: Any, ddx: Any, t: Any) -> Any:
        """Return the torques in a state at a place of which `row` is that of `dynamics`."""
        heading = self.heading
        moving = (dx, ddx) if heading.alone else (*dx, *ddx)
        try:
            made = self.dynamics[1](
                [*row, *moving, t, *(float(x.at(t)) for x in heading.tables)]
            )
        except (ValueError, ArithmeticError):
            once = [np.array([given], dtype=float) for given in (x, dx, ddx, t)]
            return self.torque(*once)[0]
        return made[0] if heading.alone else np.array(made)

    @cached_property
    def _singles(self) -> dict[Names, Single]:
        """Functions at single places by their names, once asked for."""
        return {}

    def _single(self, *names: str) -> Single:
        """Return stored functions of one group by their names, at a single place."""
        if names not in self._singles:
            group = self.heading.place(names[0])[0]
            unit = np.eye(len(self.heading.groups[group]))
            self._singles[names] = self.single(group, unit[:, self._columns(names)])
        return self._singles[names]

    def _is_one(self, x: Any) -> bool:
        return isinstance(x if self.heading.alone else x[0], NUMBER)

    def _together(
        self, *given: ArrayLike, t: ArrayLike = 0.0
    ) -> tuple[list[Floats], Floats, tuple[int, ...]]:
        """Return places and rates (n, m), times (n,), and the shape (..., m) of these."""
        m = len(self.heading.by)
        arrays = [np.asarray(x, dtype=float) for x in given]
        if self.heading.alone:
            arrays = [x[..., None] for x in arrays]
        elif arrays[0].ndim not in (1, 2) or arrays[0].shape[-1] != m:
            raise SolveError(
                f"{self.heading.mechanism}: places are arrays (n, {m}) of the "
                f"inputs {listing(self.heading.inputs)}, not {arrays[0].shape}"
            )
        elif arrays[0].ndim == 1:
            self._cell(arrays[0].tolist())
        *parts, every = np.broadcast_arrays(*arrays, np.asarray(t, dtype=float)[..., None])
        flat = [part.reshape(-1, m) for part in parts]
        return flat, every.reshape(-1, m)[:, 0], parts[0].shape

    def _shaped(self, values: Floats, shape: tuple[int, ...]) -> Floats:
        """Return values (n, m) at places of this shape; of a curve they are numbers."""
        return values.reshape(shape[:-1] if self.heading.alone else shape)

    def _rows(self, group: int, q: Floats) -> Floats:
        """Return the functions of a group (n, F) at places (n, m)."""
        heading, series = self.heading, self.groups[group]
        if isinstance(series, TensorChebyshev):
            return series.evaluate(q)
        x, (low,), (high,) = q[:, 0], heading.low, heading.high
        lap, laps = high - low, np.zeros(len(q))
        good = np.isfinite(x)
        if heading.periodic:
            laps = np.floor((x - low) / lap)
        else:
            good &= (x >= low - SLACK * lap) & (x <= high + SLACK * lap)
        if not np.all(good):
            heading.within(float(x[~good][0]))
        values = series.evaluate(x - laps * lap)
        if group == 0:
            values[:, : len(heading.rise)] += laps[:, None] * np.array(heading.rise)
        return values

    def single(self, group: int, factors: Floats) -> Single:
        """Return sums of the functions of a group by factors (F, K) at one place."""
        heading, series = self.heading, self.groups[group]
        if isinstance(series, TensorChebyshev):
            cells, cell = CellSums(series, factors), self._cell
            return lambda q: cells.evaluate(cell(q), q).tolist()  # type: ignore[no-any-return]
        size = np.array([function.largest for function in heading.groups[group]])
        mixed = PiecewiseChebyshev(series.edges, series.coefficients @ factors)
        inside = make_local_polynomials(mixed, size @ np.abs(factors))
        rise = heading.rise if group == 0 else ()
        growths = np.array(rise) @ factors[: len(rise)]
        rises = [(k, x) for k, x in enumerate(growths.tolist()) if x]
        (low,), (high,), within = heading.low, heading.high, heading.within

        def at(x: float) -> list[float]:
            if low <= x < high:
                return inside(x)
            place, laps = within(x)
            row = inside(place)
            for k, growth in rises:
                row[k] += laps * growth
            return row

        return at

    def _columns(self, names: Iterable[str]) -> list[int]:
        return [self.heading.place(name)[1] for name in names]

    def _cell(self, q: Sequence[float]) -> int:
        """Return the cell of a place over a box; `SolveError` outside the domain."""
        heading, series = self.heading, self.groups[0]
        assert isinstance(series, TensorChebyshev)
        for value, low, high in zip(q, heading.low, heading.high, strict=True):
            if not low <= value <= high:
                break
        else:
            cell = series.find_cell(q)
            if cell >= 0:
                return cell
        ranges = zip(heading.by, q, heading.low, heading.high, strict=True)
        asked = (f"{by} = {x:.9g} ({low:.6g} to {high:.6g})" for by, x, low, high in ranges)
        raise SolveError(
            f"{heading.mechanism}: the model is asked for {listing(asked)} rad, which is "
            f"not in its domain: {heading.covered:.3g} of the box of these ranges. "
            f"Elsewhere assembly mode {heading.assembly_mode} does not exist or is near a "
            "singularity"
        )


@checked(FileError)
def load_reduced(path: AnyPath) -> StoredModel:
    """Return a model that `StoredModel.save` wrote.

    Raises
    ------
    FileError
        If it cannot be read, is no such model or of another version, is cut short, or
        has numbers that are not finite.
    """
    return read_archive(path, KIND, partial(_model, repr(str(path))))


def _model(
    where: str, header: Mapping[str, Any], arrays: Mapping[str, Floats]
) -> StoredModel:
    """Return the model that a heading and arrays are, checked."""
    given = {name: header[name] for name in StoredHeading.__dataclass_fields__}
    given["loads"] = tuple(StoredLoad(**load) for load in header["loads"])
    given["groups"] = tuple(
        tuple(StoredFunction(**item) for item in group) for group in header["groups"]
    )
    heading = StoredHeading(**given)
    numbers = [*heading.low, *heading.high, *heading.rise]
    numbers += [x for item in heading.functions for x in (item.largest, item.error)]
    if not (all_finite(numbers) and np.all(np.less(heading.low, heading.high))):
        raise FileError(
            f"{where}: the heading has numbers that are not finite; make it anew"
        )
    groups = (_series(where, heading, k, arrays) for k in range(len(heading.groups)))
    return StoredModel(heading, tuple(groups))


def _series(
    where: str, heading: StoredHeading, k: int, arrays: Mapping[str, Floats]
) -> PiecewiseChebyshev | TensorChebyshev:
    """Return the series of a group of functions, checked."""
    group, series = heading.groups[k], arrays[f"coefficients_{k}"]
    fault = None
    if series.ndim != len(heading.by) + 2 or series.shape[-1] != len(group):
        fault = (
            f"coefficients_{k} do not fit: {series.shape[-1]} columns for {len(group)} "
            "functions"
        )
    elif not all_finite(series):
        name = group[np.argwhere(~np.isfinite(series))[0, -1]].name
        fault = f'"{name}" has coefficients that are not finite'
    else:
        cells = [arrays[f"{name}_{k}"] for name in _names(heading)[:-1]]
        ends = (cells[0][:-1], cells[0][1:]) if heading.alone else cells[1].swapaxes(0, 1)
        rising = np.all(np.less(*ends)) and len(ends[0]) == len(series) > 0
        if not (rising and all(all_finite(x) for x in cells)):
            fault = f"the cells of group {k} do not rise"
    if fault is not None:
        raise FileError(f"{where}: {fault}; make it anew")
    if heading.alone:
        return PiecewiseChebyshev(cells[0], series)
    low, high = np.array(heading.low), np.array(heading.high)
    return TensorChebyshev(low, high, cells[0], cells[1], series)


def _names(heading: StoredHeading) -> Names:
    """Return the names of a group's arrays, the coefficients last."""
    if heading.alone:
        return "edges", "coefficients"
    return "splits", "bounds", "coefficients"
