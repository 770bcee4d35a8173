"""A mechanism's stored functions, evaluated without the mechanism: once made, quick.

`spherekit.dynamics.offline` computes everything that depends on the configuration alone
(Di Gregorio 2024, section 4); this module evaluates it in control loops. It needs NumPy
and the standard library only.
"""

import io
import json
import math
import os
import zipfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from operator import itemgetter
from pathlib import Path
from typing import Any, final, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spherekit.conventions import listing, nearest
from spherekit.errors import FileError, SolveError, SpherekitError
from spherekit.model.dynamics import TorqueTable
from spherekit.model.expression import load_names, parse
from spherekit.numeric.adaptive import AdaptiveChebyshev
from spherekit.version import __version__

Floats = NDArray[np.float64]
RowMagnitude = Callable[[Sequence[float]], float]

FORMAT = "spherekit reduced model"
VERSION = 1
SLACK = 1e-12
"""The ends of a range may be overstepped by this part of it, which is rounding."""
LAYOUT = (
    "groups[k] lists the functions in the columns of chebyshev_k, whose row c holds "
    "their Chebyshev series from edges_k[c] to edges_k[c + 1]; a periodic model repeats "
    "with the period high - low, in which the variables grow by rise"
)


@final
@dataclass(frozen=True)
class Function:
    """A stored function of the coordinate: its `largest` value and measured `error`.

    The error is relative to the largest value, which belongs to all components of a
    vector alike.
    """

    name: str
    unit: str
    largest: float
    error: float


@final
@dataclass(frozen=True)
class StoredLoad:
    """The magnitudes of a load's components, which work on its stored velocities.

    `components` are expressions in pair variables, their rates and the time; a torque
    given by a table has `times` (s) and `torques` (N m) instead.
    """

    name: str
    components: tuple[str, ...] = ()
    times: tuple[float, ...] = ()
    torques: tuple[float, ...] = ()
    repeats: bool = False

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the velocities that its components work on."""
        if len(self.components) < 2:
            return (f"load {self.name}",)
        return tuple(f"load {self.name} {axis}" for axis in "xyz")

    @property
    def table(self) -> TorqueTable:
        """The torque as a table."""
        return TorqueTable(self.name, "", self.times, self.torques, self.repeats)


@final
@dataclass(frozen=True)
class Heading:
    """What a stored model is of, without its numbers.

    `coordinate` is "q", the variable of pair `input`, on a closed curve along which it
    turns fully, or "s", the arc length of the curve (rad). `low`, `high` bound the
    coordinate; of a periodic model they are one period apart, in which the variables grow
    by `rise`. `variables` and `angles` name the pair variables, and the R pairs among
    them. The first of `groups` has what the motion needs, each further one a pole, in
    the order of `poles`, named
    LINK/RELATIVE_TO. `mechanism_sha256` is of the mechanism's canonical file in radians,
    `made_by` the version of spherekit.
    """

    mechanism: str
    mechanism_sha256: str
    made_by: str
    input: str
    branch: int
    coordinate: str
    periodic: bool
    low: float
    high: float
    variables: tuple[str, ...]
    angles: tuple[str, ...]
    poles: tuple[str, ...]
    loads: tuple[StoredLoad, ...]
    rise: tuple[float, ...]
    groups: tuple[tuple[Function, ...], ...]

    @property
    def functions(self) -> tuple[Function, ...]:
        """All stored functions."""
        return tuple(each for group in self.groups for each in group)


@final
@dataclass(frozen=True)
class OnlineModel:
    """Functions of one coordinate x, which is q or s: see `Heading`.

    Every method takes numbers, in the least time, or arrays (n,). Lengths of x beyond a
    period are laps; the range of a model that is not periodic must not be left.
    `groups` holds the functions of the heading's groups.
    """

    heading: Heading
    groups: tuple[AdaptiveChebyshev, ...]

    @property
    def error(self) -> float:
        """Largest measured error of all functions, relative to the largest of each."""
        return max(each.error for each in self.heading.functions)

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
        B, dB = self._inertia_columns
        if isinstance(x, float | int):
            row = self._one(0, x).tolist()
            row += (t, dx)
            force = 0.0
            for column, magnitude in self._magnitudes:
                force += magnitude(row) * row[column]
            return row[B] * ddx + 0.5 * row[dB] * dx * dx - force  # type: ignore[operator]
        rows = self._rows(0, x)
        dx, ddx = np.asarray(dx, dtype=float), np.asarray(ddx, dtype=float)
        force = np.sum(self._forces(rows, dx, np.asarray(t, dtype=float)), axis=-1)
        return np.asarray(rows[..., B] * ddx + 0.5 * rows[..., dB] * dx**2 - force)

    def forces(self, x: ArrayLike, dx: ArrayLike, t: ArrayLike = 0.0) -> dict[str, Floats]:
        """Return each load's generalised force Q (N m) by x, by its name."""
        rows = self._rows(0, x)
        parts = self._forces(rows, np.asarray(dx, dtype=float), np.asarray(t, dtype=float))
        found: dict[str, Floats] = {}
        at = 0
        for load in self.heading.loads:
            count = len(load.columns)
            found[load.name] = np.sum(parts[..., at : at + count], axis=-1)
            at += count
        return found

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
        return self.value(self._derivative("B"), x)

    def pole(self, name: str, x: ArrayLike) -> Floats:
        """Return the unit vector (3,) or (n, 3) of a pole axis, in ground axes.

        `name` is LINK/RELATIVE_TO, as "3/1"; either order names the same axis.
        """
        group, column = self._place[f"pole {self._pole(name)} x"]
        found = self._one if isinstance(x, float | int) else self._rows
        return found(group, x)[..., column : column + 3]  # type: ignore[operator,no-any-return]

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
        return self.value(self._derivative(f"rate {self._pole(name)}"), x)

    @overload
    def value(self, name: str, x: float) -> float: ...
    @overload
    def value(self, name: str, x: ArrayLike) -> Floats: ...

    def value(self, name: str, x: ArrayLike) -> float | Floats:
        """Return any stored function by its name in `heading.functions`."""
        group, column = self._found(name)
        if isinstance(x, float | int):
            return float(self._one(group, x)[column])
        return np.asarray(self._rows(group, x)[..., column])

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the model to a NumPy archive (.npz) that describes itself.

        Raises
        ------
        OutputError
            If it cannot be written; an older file is then unchanged.
        """
        from spherekit.files.atomic import write_bytes

        header = {"format": FORMAT, "version": VERSION, **asdict(self.heading)}
        text = json.dumps({**header, "layout": LAYOUT}, indent=1)
        arrays: dict[str, Any] = {}
        for k, group in enumerate(self.groups):
            arrays |= {f"edges_{k}": group.edges, f"chebyshev_{k}": group.coefficients}
        stream = io.BytesIO()
        np.savez_compressed(stream, header=np.array(text), **arrays)
        write_bytes(path, stream.getvalue())

    @cached_property
    def _place(self) -> Mapping[str, tuple[int, int]]:
        """Group and column of each function."""
        return {
            each.name: (k, column)
            for k, group in enumerate(self.heading.groups)
            for column, each in enumerate(group)
        }

    def _found(self, name: str) -> tuple[int, int]:
        if name not in self._place:
            raise SolveError(
                f'{self.heading.mechanism}: "{name}" is not stored'
                f"{nearest(name, self._place) or ';'} Stored are {listing(self._place)}"
            )
        return self._place[name]

    def _derivative(self, name: str) -> str:
        return f"d({name})/d{self.heading.coordinate}"

    def _pole(self, name: str) -> str:
        known = self.heading.poles
        if name in known:
            return name
        reverse = "/".join(reversed(name.split("/")))
        if reverse in known:
            return reverse
        raise SolveError(
            f'{self.heading.mechanism}: pole "{name}" is not stored'
            f"{nearest(name, known) or ';'} Stored are {listing(known) or 'none'}; make "
            "the model anew with it"
        )

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
            raise _outside(heading, float(x[~good][0]))
        laps = np.floor((x - low) / (high - low)) if heading.periodic else np.zeros_like(x)
        found = self.groups[number].at((x - laps * (high - low)).ravel())
        found = found.reshape(*x.shape, -1)
        if number == 0 and np.any(laps):
            found[..., : len(heading.rise)] += laps[..., None] * np.array(heading.rise)
        return found

    def _one(self, number: int, x: float) -> Floats:
        """Return the functions of a group (m,) at one x."""
        low, period, high = self._range
        if low <= x < high:
            return self.groups[number].one(x)
        heading = self.heading
        if not math.isfinite(x):
            raise _outside(heading, x)
        if not heading.periodic:
            if not low - SLACK * period <= x <= high + SLACK * period:
                raise _outside(heading, x)
            return self.groups[number].one(x)
        laps = math.floor((x - low) / period)
        row = self.groups[number].one(x - laps * period)
        if number == 0:
            row[: len(heading.rise)] += laps * np.array(heading.rise)
        return row

    @cached_property
    def _range(self) -> tuple[float, float, float]:
        low, high = self.heading.low, self.heading.high
        return low, high - low, high

    @cached_property
    def _inertia_columns(self) -> tuple[int, int]:
        return self._found("B")[1], self._found(self._derivative("B"))[1]

    @cached_property
    def _parts(self) -> tuple[tuple[int, StoredLoad, int], ...]:
        return tuple(
            (self._place[column][1], load, k)
            for load in self.heading.loads
            for k, column in enumerate(load.columns)
        )

    @cached_property
    def _magnitudes(self) -> tuple[tuple[int, RowMagnitude], ...]:
        """The column of each load component, and its magnitude at a row of floats."""
        variables, pairs = self.heading.variables, self.heading.angles
        count = len(variables)
        read: dict[str, RowMagnitude] = {"t": itemgetter(-2)}
        for pair in pairs:
            k = variables.index(f"theta_{pair}")
            read[f"theta_{pair}"] = itemgetter(k)
            read[f"dtheta_{pair}"] = _rate_at(count + k)
        names = load_names(pairs)
        return tuple(
            (
                column,
                parse(load.components[k], names).scalar(read)
                if load.components
                else _tabulated(load.table),
            )
            for column, load, k in self._parts
        )

    def _forces(self, rows: Floats, dx: Floats, t: Floats) -> Floats:
        """Return the generalised force of each load component (..., components)."""
        variables, pairs = self.heading.variables, self.heading.angles
        count = len(variables)
        known: dict[str, Floats] = {"t": t}
        for pair in pairs:
            k = variables.index(f"theta_{pair}")
            known[f"theta_{pair}"] = rows[..., k]
            known[f"dtheta_{pair}"] = rows[..., count + k] * dx
        names = load_names(pairs)
        found = np.empty((*np.broadcast(rows[..., 0], dx, t).shape, len(self._parts)))
        for number, (column, load, k) in enumerate(self._parts):
            magnitude = (
                parse(load.components[k], names).evaluate(known)
                if load.components
                else load.table.at(t)
            )
            found[..., number] = magnitude * rows[..., column]
        return found


def load_reduced(path: str | os.PathLike[str]) -> OnlineModel:
    """Return a model that `OnlineModel.save` wrote.

    Raises
    ------
    FileError
        If it cannot be read, is no such model or of another version, is cut short, or
        has numbers that are not finite.
    """
    where = repr(str(path))
    try:
        with np.load(Path(path), allow_pickle=False) as archive:
            if not isinstance(archive, np.lib.npyio.NpzFile) or "header" not in archive:
                raise FileError(f"{where}: is no {FORMAT}; write one with `--to model`")
            header = json.loads(str(archive["header"]))
            _check_header(where, header)
            arrays = {name: archive[name] for name in archive.files if name != "header"}
        heading = _heading(header)
        return OnlineModel(heading, _groups(where, heading, arrays))
    except OSError as error:
        raise FileError(f"{where}: cannot be read: {error.strerror or error}") from None
    except SpherekitError:
        raise
    except (ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
        raise FileError(
            f"{where}: is no complete {FORMAT} ({error}); make it anew"
        ) from None


def _check_header(where: str, header: Any) -> None:
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        raise FileError(f"{where}: is no {FORMAT}; write one with `--to model`")
    if header.get("version") != VERSION:
        raise FileError(
            f"{where}: has version {header.get('version')} of the format, and spherekit "
            f"{__version__} reads version {VERSION}; make it anew with this spherekit"
        )


def _heading(header: dict[str, Any]) -> Heading:
    loads = tuple(_stored_load(each) for each in header["loads"])
    groups = tuple(tuple(Function(**each) for each in group) for group in header["groups"])
    rest = {name: header[name] for name in Heading.__dataclass_fields__}
    for name in ("variables", "angles", "poles", "rise"):
        rest[name] = tuple(rest[name])
    return Heading(**{**rest, "loads": loads, "groups": groups})


def _stored_load(given: dict[str, Any]) -> StoredLoad:
    lists = {name: tuple(given[name]) for name in ("components", "times", "torques")}
    return StoredLoad(**{**given, **lists})


def _groups(
    where: str, heading: Heading, arrays: dict[str, Floats]
) -> tuple[AdaptiveChebyshev, ...]:
    numbers = [heading.low, heading.high, *heading.rise]
    numbers += [x for each in heading.functions for x in (each.largest, each.error)]
    if not (np.all(np.isfinite(numbers)) and heading.low < heading.high):
        raise FileError(
            f"{where}: the heading has numbers that are not finite; make it anew"
        )
    found = []
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
        found.append(AdaptiveChebyshev(edges, series))
    return tuple(found)


def _outside(heading: Heading, x: float) -> SolveError:
    allowed = "is finite"
    if not heading.periodic:
        allowed = f"lies within {heading.low:.9g} to {heading.high:.9g} rad"
    return SolveError(
        f"{heading.mechanism}: the model is asked for {heading.coordinate} = {x:.9g}, but "
        f"the coordinate {allowed}"
    )


def _rate_at(column: int) -> RowMagnitude:
    return lambda row: row[column] * row[-1]


def _tabulated(table: TorqueTable) -> RowMagnitude:
    return lambda row: float(table.at(row[-2]))
