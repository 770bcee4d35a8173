"""Stored functions of several inputs, evaluated without the mechanism.

`spherekit.dynamics.tabulate_grid` makes them: everything in the equations of motion that
depends on the configuration alone, over a box of the inputs. This module needs NumPy and
the standard library only.
"""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spherekit.conventions import Status, listing, nearest
from spherekit.dynamics.model_archive import stored_heading, write_archive
from spherekit.dynamics.model_metadata import StoredFunction, StoredHeading
from spherekit.errors import FileError, ModelError, SolveError
from spherekit.model.dynamics import DRIVE
from spherekit.model.expression import Expression, made_of
from spherekit.model.torque_table import TorqueTable
from spherekit.numeric.cells import TensorCells, TensorChebyshev

Floats = NDArray[np.float64]

LAYOUT = (
    "column f of coefficients[c] holds the tensor Chebyshev series of function f between "
    "bounds[c, 0] and bounds[c, 1]; splits are the halvings of the box, (direction, place, "
    "next below, next above), where -1 - c is cell c and 0 is outside the domain"
)


@final
@dataclass(frozen=True)
class GridMetadata(StoredHeading):
    """What a stored model of several inputs is of, without its numbers.

    `inputs` name the pairs, `low`, `high` (rad) bound their variables, `covered` is the
    part of that box in which the functions are known: elsewhere the assembly mode does not
    exist, or is too near to a singularity. The other entries are as in `StoredHeading`.
    """

    inputs: tuple[str, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    covered: float
    functions: tuple[StoredFunction, ...]

    def place(self, name: str) -> int:
        """Return the column of a function."""
        if name not in self._places:
            raise self.not_stored(f'"{name}"', name, self._places)
        return self._places[name]

    def by_inputs(self, name: str) -> list[str]:
        """Return the names of what a variable or a load works by, input for input."""
        if name in self.variables:
            return [f"d({name})/d(theta_{pair})" for pair in self.inputs]
        return [f"{name} by {pair}" for pair in self.inputs]

    @property
    def inertia(self) -> list[str]:
        """The names of the inertia matrix, row by row to its diagonal."""
        return [
            f"M {a} {b}" for i, a in enumerate(self.inputs) for b in self.inputs[: i + 1]
        ]

    @property
    def christoffel(self) -> list[list[str]]:
        """The names of the Christoffel symbols of each input, in the order of `inertia`."""
        return [[f"c {pair} {name[2:]}" for name in self.inertia] for pair in self.inputs]

    @cached_property
    def _places(self) -> Mapping[str, int]:
        return {function.name: k for k, function in enumerate(self.functions)}


@final
@dataclass(frozen=True)
class GridModel:
    """Functions of the m inputs q (rad) of one assembly mode.

    Every method takes one place (m,), in the least time, or places (n, m).
    """

    heading: GridMetadata
    series: TensorChebyshev

    @property
    def error(self) -> float:
        """Largest measured error of all functions, relative to the largest of each."""
        return max(function.error for function in self.heading.functions)

    def status(self, q: ArrayLike) -> NDArray[np.int8]:
        """Return (n,) of places (n, m): OK, or OUT_OF_REACH outside the domain."""
        cells = self.series.cells(self._several(q))
        return np.where(cells >= 0, Status.OK, Status.OUT_OF_REACH).astype(np.int8)

    def torque(
        self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike, t: ArrayLike = 0.0
    ) -> Floats:
        """Return the torques (m,) or (n, m) at the inputs (N m), all loads acting.

        M q'' + C q' - Q, for rates `dq` and accelerations `ddq` (rad, s) and the time `t`
        (s) for loads that depend on it.

        Raises
        ------
        SolveError
            At a single place outside the domain; rows there are NaN.
        """
        if not isinstance(q[0], _NUMBER):  # type: ignore[index]
            rows = self._rows(q)
            dq, ddq = np.asarray(dq, dtype=float), np.asarray(ddq, dtype=float)
            M, pull = self._dynamics.of_rows(rows, dq)
            force = np.sum(self._forces(rows, dq, np.asarray(t, dtype=float)), axis=2)
            return np.asarray((M @ ddq[..., None])[..., 0] + pull - force)
        state = self._dynamics
        row = state.at(self._cell(q), q)
        try:
            return state.torque(row, dq, ddq, t)
        except (ValueError, ArithmeticError):
            once = [np.array([given], dtype=float) for given in (q, dq, ddq, t)]
            return np.asarray(self.torque(*once)[0])

    def accelerations(
        self, q: ArrayLike, dq: ArrayLike, torques: ArrayLike, t: float = 0.0
    ) -> Floats:
        """Return the accelerations (m,) of the inputs (rad/s2) under torques (m,) there."""
        zero = np.zeros(len(self.heading.inputs))
        needed = self.torque(q, dq, zero, t)
        accelerations = np.linalg.solve(self.inertia(q), np.asarray(torques) - needed)
        return np.asarray(accelerations, dtype=float)

    def inertia(self, q: ArrayLike) -> Floats:
        """Return the inertia matrix (m, m) or (n, m, m), kg m2."""
        m = len(self.heading.inputs)
        M, _ = self._dynamics.of_rows(self._rows(q), np.zeros((1, m)))
        return M[0] if np.ndim(q) == 1 else M

    def forces(self, q: ArrayLike, dq: ArrayLike, t: ArrayLike = 0.0) -> dict[str, Floats]:
        """Return each load's generalised forces (n, m), N m, by its name."""
        by_component = self._forces(
            self._rows(q), np.atleast_2d(np.asarray(dq, dtype=float)), np.asarray(t)
        )
        return self.heading.by_load(by_component)

    def velocity(self, pole: str, q: ArrayLike) -> Floats:
        """Return angular velocities (m, 3) or (n, m, 3) per unit rate of each input.

        `pole` is LINK/RELATIVE_TO, as "3/1": of the first link relative to the second, in
        ground axes. Its direction is the pole axis while that input moves alone, its length
        the coefficient.
        """
        name, sense = self.heading.pole(pole)
        places = [
            [self.heading.place(f"velocity {name} {axis} by {pair}") for axis in "xyz"]
            for pair in self.heading.inputs
        ]
        velocities = sense * self._rows(q)[:, places]
        return velocities[0] if np.ndim(q) == 1 else velocities

    def value(self, name: str, q: ArrayLike) -> float | Floats:
        """Return any stored function by its name in `heading.functions`."""
        column = self.heading.place(name)
        if np.ndim(q) > 1:
            return np.asarray(self._rows(q)[:, column])
        if column not in self._values:
            factors = np.eye(len(self.heading.functions))[:, [column]]
            self._values[column] = self.series.mixed(factors)
        return float(self._values[column].at(self._cell(q), q)[0])  # type: ignore[arg-type]

    def with_torque(self, torques: Mapping[str, str]) -> "GridModel":
        """Return the model with torques (N m) at inputs, expressions as in a file.

        Raises
        ------
        ModelError
            If an expression breaks the grammar, or there is no such input.
        """
        heading = self.heading
        loads = []
        for pair, text in torques.items():
            if pair not in heading.inputs:
                raise ModelError(
                    f'{heading.mechanism}: torque: "{pair}" is not an input'
                    f"{nearest(pair, heading.inputs) or ';'} Inputs: "
                    f"{listing(heading.inputs)}"
                )
            loads.append(heading.torque_load(f"{DRIVE}_{pair}", f"theta_{pair}", text))
        return GridModel(replace(heading, loads=(*heading.loads, *loads)), self.series)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the model to a NumPy archive (.npz) that describes itself.

        Raises
        ------
        OutputError
            If it cannot be written; an older file is then unchanged.
        """
        arrays = {
            "splits": self.series.splits,
            "bounds": self.series.bounds,
            "coefficients": self.series.coefficients,
        }
        write_archive(path, {**asdict(self.heading), "layout": LAYOUT}, arrays)

    @staticmethod
    def read(where: str, header: dict[str, Any], arrays: dict[str, Floats]) -> "GridModel":
        """Return the model of an archive; `FileError` if its numbers cannot be."""
        functions = tuple(StoredFunction(**item) for item in header["functions"])
        heading = stored_heading(GridMetadata, header, {"functions": functions})
        low, high = np.array(heading.low), np.array(heading.high)
        made = TensorChebyshev(low, high, *(arrays[name] for name in _ARRAYS))
        shape, m = made.coefficients.shape, len(heading.inputs)
        fits = len(shape) == m + 2 and shape[-1] == len(functions)
        fits = fits and made.bounds.shape == (shape[0], 2, m)
        fits = fits and made.splits.ndim == 2 and made.splits.shape[1] == 4
        if not fits:
            raise FileError(f"{where}: its cells do not fit its functions; make it anew")
        if not all(np.all(np.isfinite(arrays[name])) for name in _ARRAYS):
            raise FileError(f"{where}: has numbers that are not finite; make it anew")
        return GridModel(heading, made)

    @cached_property
    def _dynamics(self) -> "_State":
        return _State(self.heading, self.series)

    @cached_property
    def _values(self) -> dict[int, TensorCells]:
        """Functions at single places, by column, once asked for."""
        return {}

    def _cell(self, q: Any) -> int:
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
        asked = listing(
            f"{pair} = {float(value):.9g}"
            for pair, value in zip(heading.inputs, q, strict=True)
        )
        spans = listing(
            f"{pair} {low:.6g} to {high:.6g}"
            for pair, low, high in zip(
                heading.inputs, heading.low, heading.high, strict=True
            )
        )
        return SolveError(
            f"{heading.mechanism}: the model is asked for {asked} rad, which is not in its "
            f"domain: {heading.covered:.3g} of the box {spans} rad. Elsewhere assembly "
            f"mode {heading.assembly_mode} does not exist or is near a singularity"
        )

    def _several(self, q: ArrayLike) -> Floats:
        places = np.atleast_2d(np.asarray(q, dtype=float))
        if places.ndim != 2 or places.shape[1] != len(self.heading.inputs):
            raise SolveError(
                f"{self.heading.mechanism}: places are arrays "
                f"(n, {len(self.heading.inputs)}) of the inputs "
                f"{listing(self.heading.inputs)}, not {np.shape(q)}"
            )
        return places

    def _rows(self, q: ArrayLike) -> Floats:
        if np.ndim(q) == 1:
            self._cell(self._several(q)[0])
        return self.series.at(self._several(q))

    def _forces(self, rows: Floats, dq: Floats, t: Floats) -> Floats:
        """Return the generalised forces (n, m, components) of each load component."""
        heading = self.heading
        names: dict[str, Any] = {"t": t}
        for pair in heading.angles:
            name = f"theta_{pair}"
            names[name] = rows[:, heading.place(name)]
            by = [heading.place(derivative) for derivative in heading.by_inputs(name)]
            names[f"d{name}"] = np.sum(rows[:, by] * dq, axis=1)
        sizes = heading.sizes(names, t)
        forces = np.empty((len(rows), len(heading.inputs), len(sizes)))
        for k, (size, name) in enumerate(zip(sizes, heading.works_on, strict=True)):
            by = [heading.place(derivative) for derivative in heading.by_inputs(name)]
            forces[:, :, k] = np.broadcast_to(size, len(rows))[:, None] * rows[:, by]
        return forces


_NUMBER = (float, int)

_ARRAYS = ("splits", "bounds", "coefficients")


@final
class _State:
    """Inertia, Christoffel symbols and loads, one state at a time.

    Of each input a row of factors of its accelerations, of the products of its rates and of
    -1, which the loads are that do not change; then what the other loads need.
    """

    def __init__(self, heading: GridMetadata, series: TensorChebyshev) -> None:
        m, count = len(heading.inputs), len(heading.functions)
        unit = np.eye(count)
        self._m, self._products = m, [(i, k) for i in range(m) for k in range(i + 1)]
        self._width = m + len(self._products) + 1
        works_on = [
            [heading.place(part) for part in heading.by_inputs(name)]
            for name in heading.works_on
        ]
        steady = np.zeros((count, m))
        changing: list[tuple[Expression | TorqueTable, list[int]]] = []
        for law, places in zip(heading.magnitudes, works_on, strict=True):
            if isinstance(law, Expression) and not law.names:
                steady += float(law.evaluate({})) * unit[:, places]
            else:
                changing.append((law, places))
        factors: list[Floats] = []
        for i in range(m):
            inertia = [heading.inertia[_triangle(i, k)] for k in range(m)]
            symbols = heading.christoffel[i]
            factors += [unit[heading.place(name)] for name in inertia]
            factors += [
                (1.0 if a == b else 2.0) * unit[heading.place(name)]
                for name, (a, b) in zip(symbols, self._products, strict=True)
            ]
            factors.append(steady[:, i])
        self._works = slice(len(factors), len(factors) + m * len(changing))
        factors += [unit[place] for _, places in changing for place in places]
        used = {
            name for law, _ in changing if isinstance(law, Expression) for name in law.names
        }
        turning = sorted(name for name in used if name.startswith("dtheta_"))
        self._rates: list[slice] = []
        for name in turning:
            places = [heading.place(part) for part in heading.by_inputs(name[1:])]
            self._rates.append(slice(len(factors), len(factors) + m))
            factors += [unit[place] for place in places]
        written = {"t": "t"} | {name: f"rate_{k}" for k, name in enumerate(turning)}
        for name in sorted(used - {"t", *turning}):
            written[name] = f"row[{len(factors)}]"
            factors.append(unit[heading.place(name)])
        self._call = self._written([law for law, _ in changing], written)
        self._at = series.mixed(np.stack(factors, axis=1))
        names = [*heading.inertia, *(x for symbol in heading.christoffel for x in symbol)]
        self._all = [heading.place(name) for name in names]

    def at(self, cell: int, q: Any) -> Floats:
        """Return what `torque` needs of a place."""
        return self._at.at(cell, q)

    def torque(self, row: Floats, dq: Any, ddq: Any, t: Any) -> Floats:
        """Return the torques (m,) in a state."""
        torques: Floats = self._call(row.tolist(), dq, ddq, t)
        return torques

    def _written(
        self, laws: Sequence[Expression | TorqueTable], names: Mapping[str, str]
    ) -> Callable[..., Any]:
        """Return the torques as one function of what `at` gives, dq, ddq and t."""
        m, width, works = self._m, self._width, self._works.start
        tables = {
            f"table_{k}": law.one
            for k, law in enumerate(laws)
            if isinstance(law, TorqueTable)
        }
        sizes = {
            f"size_{k}": law.code(names) if isinstance(law, Expression) else f"table_{k}(t)"
            for k, law in enumerate(laws)
        }
        rates = {
            f"rate_{k}": " + ".join(f"row[{part.start + i}]*dq[{i}]" for i in range(m))
            for k, part in enumerate(self._rates)
        }
        products = {f"product_{i}_{k}": f"dq[{i}]*dq[{k}]" for i, k in self._products}
        factors = [*(f"ddq[{i}]" for i in range(m)), *products, "-1.0"]
        torques = []
        for i in range(m):
            terms = [f"row[{i * width + k}]*{factor}" for k, factor in enumerate(factors)]
            terms += [f"-{size}*row[{works + k * m + i}]" for k, size in enumerate(sizes)]
            torques.append(" + ".join(terms))
        body = f"array([{', '.join(torques)}])"
        for given in (sizes, rates | products):
            body = f"(lambda {', '.join(given)}: {body})({', '.join(given.values())})"
        return made_of(f"lambda row, dq, ddq, t: {body}", {"array": np.array, **tables})

    def of_rows(self, rows: Floats, dq: Floats) -> tuple[Floats, Floats]:
        """Return M (n, m, m) and C q' (n, m) of all functions in rows."""
        pairs, m = len(self._products), self._m
        entries = rows[:, self._all]
        M = np.empty((len(rows), m, m))
        for number, (i, k) in enumerate(self._products):
            M[:, i, k] = M[:, k, i] = entries[:, number]
        symbols = entries[:, pairs:].reshape(len(rows), m, pairs)
        products = np.stack(
            [(1.0 if i == k else 2.0) * dq[:, i] * dq[:, k] for i, k in self._products],
            axis=1,
        )
        return M, np.asarray(np.sum(symbols * products[:, None], axis=2))


def _triangle(i: int, k: int) -> int:
    i, k = max(i, k), min(i, k)
    return i * (i + 1) // 2 + k
