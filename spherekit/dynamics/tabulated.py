"""A mechanism's stored functions, evaluated without the mechanism: once made, quick.

`spherekit.dynamics.tabulate` computes everything that depends on the configuration alone
(Di Gregorio 2024, section 4); this module evaluates it in control loops. It needs NumPy
and the standard library only.
"""

import os
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import final, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spherekit.checked import checked
from spherekit.conventions import listing, nearest
from spherekit.dynamics.grid_model import GridModel
from spherekit.dynamics.model_archive import (
    DAMAGED,
    FORMAT,
    read_archive,
    stored_heading,
    write_archive,
)
from spherekit.dynamics.model_metadata import SLACK, ModelMetadata, StoredFunction
from spherekit.dynamics.scalar_evaluation import ScalarEvaluation, ScalarFunctions
from spherekit.errors import FileError, ModelError, SolveError, SpherekitError
from spherekit.model.dynamics import DRIVE
from spherekit.numeric.chebyshev import PiecewiseChebyshev
from spherekit.numeric.zeros import zeros

Floats = NDArray[np.float64]

_NUMBER = (float, int)
"""What is one place; a tuple is tested in less time than a union."""

LAYOUT = (
    "groups[k] lists the functions in the columns of chebyshev_k, whose row c holds "
    "their Chebyshev series from edges_k[c] to edges_k[c + 1]; a periodic model repeats "
    "with the period high - low, in which the variables grow by rise"
)


@final
@dataclass(frozen=True)
class TabulatedModel:
    """Functions of one coordinate x, which is q or s: see `ModelMetadata`.

    Every method takes numbers, in the least time, or arrays (n,). Lengths of x beyond a
    period are laps; the range of a model that is not periodic must not be left.
    `groups` holds the functions of the heading's groups.
    """

    heading: ModelMetadata
    groups: tuple[PiecewiseChebyshev, ...]

    @property
    def error(self) -> float:
        """Largest measured error of all functions, relative to the largest of each."""
        return max(function.error for function in self.heading.functions)

    @overload
    def torque(self, x: float, dx: float, ddx: float, t: float = 0.0) -> float: ...
    @overload
    def torque(
        self, x: ArrayLike, dx: ArrayLike, ddx: ArrayLike, t: ArrayLike = 0.0
    ) -> Floats: ...

    def torque(
        self, x: ArrayLike, dx: ArrayLike, ddx: ArrayLike, t: ArrayLike = 0.0
    ) -> float | Floats:
        """Return the torque (N m) of the actuator for this motion, all loads acting.

        B x'' + 1/2 dB/dx x'^2 - Q (Di Gregorio 2024, eq. (21)). With the coordinate q it
        acts at the input; with s it is per unit arc length, and the torque at a pair is
        that divided by the pair's rate along the curve.

        Parameters
        ----------
        x, dx, ddx
            Coordinate (rad) and its first and second rate by time.
        t
            Time (s) for loads that depend on it.
        """
        if isinstance(x, _NUMBER):
            row = self.state.at(x)
            force = self.state.force(row, dx, t)  # type: ignore[arg-type]
            return row[0] * ddx + 0.5 * row[1] * dx * dx - force  # type: ignore[operator]
        rows = self._rows(0, x)
        dx, ddx = np.asarray(dx, dtype=float), np.asarray(ddx, dtype=float)
        force = np.sum(self._forces(rows, dx, np.asarray(t, dtype=float)), axis=-1)
        torque = self._column(rows, "B") * ddx
        torque += 0.5 * self._column(rows, self.heading.derivative("B")) * dx**2
        return np.asarray(torque - force)

    def forces(self, x: ArrayLike, dx: ArrayLike, t: ArrayLike = 0.0) -> dict[str, Floats]:
        """Return each load's generalised force Q (N m) by x, by its name."""
        rows = self._rows(0, x)
        parts = self._forces(rows, np.asarray(dx, dtype=float), np.asarray(t, dtype=float))
        return self.heading.by_load(parts)

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
        """Return the unit vector (3,) or (n, 3) of a pole axis, in ground axes.

        `name` is LINK/RELATIVE_TO, as "3/1"; either order names the same axis.
        """
        if isinstance(x, _NUMBER):
            if name not in self._poles:
                names = tuple(f"pole {self._pole(name)} {axis}" for axis in "xyz")
                self._poles[name] = ScalarFunctions(self.heading, self.groups, names)
            return np.array(self._poles[name].at(x))
        group, column = self.heading.place(f"pole {self._pole(name)} x")
        return self._rows(group, x)[..., column : column + 3]

    @overload
    def rate(self, name: str, x: float) -> float: ...
    @overload
    def rate(self, name: str, x: ArrayLike) -> Floats: ...

    def rate(self, name: str, x: ArrayLike) -> float | Floats:
        """Return the velocity coefficient of a pole.

        Times the pole's unit vector it is the angular velocity per unit rate of x of the
        first link, as `heading.poles` names it, relative to the second.
        """
        return self.value(f"rate {self._pole(name)}", x)

    @overload
    def rate_derivative(self, name: str, x: float) -> float: ...
    @overload
    def rate_derivative(self, name: str, x: ArrayLike) -> Floats: ...

    def rate_derivative(self, name: str, x: ArrayLike) -> float | Floats:
        """Return the acceleration coefficient of a pole, the derivative of `rate` by x."""
        return self.value(self.heading.derivative(f"rate {self._pole(name)}"), x)

    @overload
    def value(self, name: str, x: float) -> float: ...
    @overload
    def value(self, name: str, x: ArrayLike) -> Floats: ...

    def value(self, name: str, x: ArrayLike) -> float | Floats:
        """Return any stored function by its name in `heading.functions`."""
        if isinstance(x, _NUMBER):
            if name not in self._values:
                self._values[name] = ScalarFunctions(self.heading, self.groups, (name,))
            return self._values[name].at(x)[0]
        group, column = self.heading.place(name)
        return np.asarray(self._rows(group, x)[..., column])

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
        columns = [heading.place(x)[1] for x in (variable, heading.derivative(variable))]
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
        heading = self.heading
        if any(load.name == DRIVE for load in heading.loads):
            raise ModelError(f"{heading.mechanism}: torque: the model has one already")
        works_on = heading.derivative(f"theta_{heading.input}")
        drive = heading.torque_load(DRIVE, works_on, torque)
        return TabulatedModel(replace(heading, loads=(*heading.loads, drive)), self.groups)

    @cached_property
    def state(self) -> ScalarEvaluation:
        """Inertia and generalised force in single states."""
        return ScalarEvaluation(self.heading, self.groups)

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
        write_archive(path, {**asdict(self.heading), "layout": LAYOUT}, arrays)

    @cached_property
    def _poles(self) -> dict[str, ScalarFunctions]:
        """Directions at single places, by the pole's name, once asked for."""
        return {}

    @cached_property
    def _values(self) -> dict[str, ScalarFunctions]:
        """Functions at single places, by name, once asked for."""
        return {}

    def _column(self, rows: Floats, name: str) -> Floats:
        return np.asarray(rows[..., self.heading.place(name)[1]])

    def _pole(self, name: str) -> str:
        return self.heading.pole(name)[0]

    def _rows(self, number: int, x: ArrayLike) -> Floats:
        """Return the functions of a group (..., m) at x of any shape."""
        x = np.asarray(x, dtype=float)
        heading = self.heading
        low, high = heading.low, heading.high
        slack = 0.0 if heading.periodic else SLACK * (high - low)
        good = np.isfinite(x)
        if not heading.periodic:
            good &= (x >= low - slack) & (x <= high + slack)
        if not np.all(good):
            raise heading.outside(float(x[~good][0]))
        laps = np.floor((x - low) / (high - low)) if heading.periodic else np.zeros_like(x)
        values = self.groups[number].at((x - laps * (high - low)).ravel())
        values = values.reshape(*x.shape, -1)
        if number == 0 and np.any(laps):
            values[..., : len(heading.rise)] += laps[..., None] * np.array(heading.rise)
        return values

    def _forces(self, rows: Floats, dx: Floats, t: Floats) -> Floats:
        """Return the generalised force of each load component (..., components)."""
        heading = self.heading
        names = {"t": t}
        for name, (function, is_rate) in heading.read().items():
            column = self._column(rows, function)
            names[name] = column * dx if is_rate else column
        sizes = heading.sizes(names, t)
        shape = np.broadcast_shapes(rows.shape[:-1], dx.shape, t.shape)
        forces = np.empty((*shape, len(sizes)))
        for k, (size, name) in enumerate(zip(sizes, heading.works_on, strict=True)):
            forces[..., k] = size * self._column(rows, name)
        return forces


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
    try:
        header, arrays = read_archive(path)
        if "inputs" in header:
            return GridModel.read(where, header, arrays)
        groups = tuple(
            tuple(StoredFunction(**item) for item in group) for group in header["groups"]
        )
        heading = stored_heading(ModelMetadata, header, {"groups": groups})
        return TabulatedModel(heading, _groups(where, heading, arrays))
    except OSError as error:
        raise FileError(f"{where}: cannot be read: {error.strerror or error}") from None
    except SpherekitError:
        raise
    except DAMAGED as error:
        raise FileError(
            f"{where}: is not a complete {FORMAT} ({error}); make it anew"
        ) from None


def _groups(
    where: str, heading: ModelMetadata, arrays: dict[str, Floats]
) -> tuple[PiecewiseChebyshev, ...]:
    numbers = [heading.low, heading.high, *heading.rise]
    numbers += [
        x for function in heading.functions for x in (function.largest, function.error)
    ]
    if not (np.all(np.isfinite(numbers)) and heading.low < heading.high):
        raise FileError(
            f"{where}: the heading has numbers that are not finite; make it anew"
        )
    interpolants = []
    for k, group in enumerate(heading.groups):
        edges, series = arrays[f"edges_{k}"], arrays[f"chebyshev_{k}"]
        fits = edges.ndim == 1 and len(edges) > 1 and bool(np.all(np.diff(edges) > 0.0))
        if not fits or series.ndim != 3 or len(series) != len(edges) - 1:
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
        interpolants.append(PiecewiseChebyshev(edges, series))
    return tuple(interpolants)
