"""What stored models of one coordinate and of several have in common: torques and loads.

What a stored model is of, without its numbers, and the archive that holds both.
"""

import io
import json
import math
import os
import struct
import zipfile
import zlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, final, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spherekit.conventions import listing, nearest
from spherekit.errors import FileError, ModelError, SolveError
from spherekit.model.expression import Expression, load_names, made_of, parse
from spherekit.model.load import TorqueTable
from spherekit.version import __version__

Floats = NDArray[np.float64]

SLACK = 1e-12
"""The ends of a range may be overstepped by this part of it, which is rounding."""

DAMAGED: tuple[type[Exception], ...] = (
    *(ValueError, KeyError, TypeError, EOFError, RuntimeError, ArithmeticError),
    *(zipfile.BadZipFile, zlib.error, struct.error),
)
"""What NumPy and zipfile raise of archives in which a bit has changed."""


@final
@dataclass(frozen=True)
class StoredFunction:
    """A stored function of the coordinates: its `largest` value and measured `error`.

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
    """The magnitudes of a load's components, and the stored functions they work on.

    `components` are expressions in pair variables, their rates and the time; a torque
    given by a table has `times` (s) and `torques` (N m) instead. `works_on` names a
    function for each: a pair's variable or its rate, or a velocity of the load's own.
    """

    name: str
    works_on: tuple[str, ...]
    components: tuple[str, ...] = ()
    times: tuple[float, ...] = ()
    torques: tuple[float, ...] = ()
    repeats: bool = False

    @property
    def table(self) -> TorqueTable | None:
        """The torque as a table, None where there is none."""
        if self.components:
            return None
        return TorqueTable(self.name, "", self.times, self.torques, self.repeats)


@dataclass(frozen=True)
class StoredHeading(ABC):
    """What a stored model is of, without its numbers: what all models have.

    `variables` and `angles` name the pair variables, and the R pairs among them; `poles`
    the poles, as LINK/RELATIVE_TO. `mechanism_sha256` is of the mechanism's canonical file
    in radians, `made_by` the version of spherekit.
    """

    mechanism: str
    mechanism_sha256: str
    made_by: str
    assembly_mode: int
    variables: tuple[str, ...]
    angles: tuple[str, ...]
    poles: tuple[str, ...]
    loads: tuple[StoredLoad, ...]

    @property
    @abstractmethod
    def parts(self) -> tuple[tuple[StoredFunction, ...], ...]:
        """The stored functions, those of the motion first, group by group."""

    @property
    @abstractmethod
    def inertia(self) -> list[str]:
        """The names of the inertia matrix, row by row to its diagonal."""

    @property
    @abstractmethod
    def christoffel(self) -> list[dict[str, float]]:
        """Of each coordinate the symbols, in the order of `inertia`, with their factors."""

    @abstractmethod
    def by_coordinates(self, name: str) -> list[str]:
        """Return the names of what a variable or a load works by, for each coordinate."""

    def place(self, name: str) -> tuple[int, int]:
        """Return the group and the column of a function."""
        if name not in self._places:
            raise self.not_stored(f'"{name}"', name, self._places)
        return self._places[name]

    @cached_property
    def _places(self) -> Mapping[str, tuple[int, int]]:
        return {
            function.name: (k, column)
            for k, group in enumerate(self.parts)
            for column, function in enumerate(group)
        }

    @cached_property
    def magnitudes(self) -> tuple[Expression | TorqueTable, ...]:
        """The magnitude of each component of each load, N m or N."""
        names = load_names(self.angles)
        laws: list[Expression | TorqueTable] = []
        for load in self.loads:
            table = load.table
            laws += [table] if table else [parse(text, names) for text in load.components]
        return tuple(laws)

    @cached_property
    def works_on(self) -> tuple[list[str], ...]:
        """For each of these magnitudes the functions that it works by."""
        return tuple(
            self.by_coordinates(name) for load in self.loads for name in load.works_on
        )

    def pole(self, name: str) -> tuple[str, float]:
        """Return the name by which a pole is stored, and -1 if that turns its links round.

        Raises
        ------
        SolveError
            If it is not stored.
        """
        reverse = "/".join(reversed(name.split("/")))
        for stored, sense in ((name, 1.0), (reverse, -1.0)):
            if stored in self.poles:
                return stored, sense
        raise self.not_stored(f'pole "{name}"', name, self.poles, "; make the model anew")

    def not_stored(
        self, what: str, name: str, stored: Collection[str], then: str = ""
    ) -> SolveError:
        """Return the error of what the model has not."""
        return SolveError(
            f"{self.mechanism}: {what} is not stored{nearest(name, stored) or ';'} Stored "
            f"are {listing(stored) or 'none'}{then}"
        )


@final
@dataclass(frozen=True)
class ModelMetadata(StoredHeading):
    """What a stored model of one curve is of, without its numbers.

    `coordinate` is "q", the variable of pair `input`, on a closed curve along which it
    turns fully, or "s", the arc length of the curve (rad). `low`, `high` bound the
    coordinate; of a periodic model they are one period apart, in which the variables grow
    by `rise`. The first of `groups` has what the motion needs, each further one a pole, in
    the order of `poles`. The other entries are as in `StoredHeading`.
    """

    input: str
    coordinate: str
    periodic: bool
    low: float
    high: float
    rise: tuple[float, ...]
    groups: tuple[tuple[StoredFunction, ...], ...]

    @property
    def functions(self) -> tuple[StoredFunction, ...]:
        """All stored functions."""
        return tuple(function for group in self.groups for function in group)

    @property
    def parts(self) -> tuple[tuple[StoredFunction, ...], ...]:
        """See `StoredHeading`."""
        return self.groups

    @property
    def inertia(self) -> list[str]:
        """See `StoredHeading`."""
        return ["B"]

    @property
    def christoffel(self) -> list[dict[str, float]]:
        """See `StoredHeading`."""
        return [{self.derivative("B"): 0.5}]

    def by_coordinates(self, name: str) -> list[str]:
        """See `StoredHeading`."""
        return [self.derivative(name) if name in self.variables else name]

    def derivative(self, name: str) -> str:
        """Return the name of a function's derivative by the coordinate."""
        return f"d({name})/d{self.coordinate}"

    def within(self, x: float) -> tuple[float, int]:
        """Return a coordinate within `low` and `high`, and how many laps were taken off.

        Raises
        ------
        SolveError
            If it is not finite, or beyond the ends of a model that is not periodic.
        """
        lap = self.high - self.low
        if self.periodic and math.isfinite(x):
            laps = math.floor((x - self.low) / lap)
            return x - laps * lap, laps
        slack = SLACK * lap
        if not self.periodic and self.low - slack <= x <= self.high + slack:
            return x, 0
        allowed = "is finite"
        if not self.periodic:
            allowed = f"lies within {self.low:.9g} to {self.high:.9g} rad"
        raise SolveError(
            f"{self.mechanism}: the model is asked for {self.coordinate} = {x:.9g}, but "
            f"the coordinate {allowed}"
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

    @property
    def parts(self) -> tuple[tuple[StoredFunction, ...], ...]:
        """See `StoredHeading`."""
        return (self.functions,)

    @property
    def inertia(self) -> list[str]:
        """See `StoredHeading`."""
        return [
            f"M {a} {b}" for i, a in enumerate(self.inputs) for b in self.inputs[: i + 1]
        ]

    @property
    def christoffel(self) -> list[dict[str, float]]:
        """See `StoredHeading`."""
        lower = [(a, b) for i, a in enumerate(self.inputs) for b in self.inputs[: i + 1]]
        return [
            {f"c {pair} {a} {b}": 1.0 if a == b else 2.0 for a, b in lower}
            for pair in self.inputs
        ]

    def by_coordinates(self, name: str) -> list[str]:
        """See `StoredHeading`."""
        if name in self.variables:
            return [f"d({name})/d(theta_{pair})" for pair in self.inputs]
        return [f"{name} by {pair}" for pair in self.inputs]


@final
@dataclass(frozen=True)
class Archive:
    """A kind of NumPy archive with a heading: its format, and how one is made."""

    format: str
    version: int
    remedy: str

    def write(
        self,
        path: str | os.PathLike[str],
        heading: Mapping[str, Any],
        arrays: Mapping[str, Any],
    ) -> None:
        """Write a heading and arrays; `OutputError` if that cannot be done."""
        from spherekit.files.atomic import write_bytes

        words = {"format": self.format, "version": self.version, **heading}
        stream = io.BytesIO()
        np.savez_compressed(stream, header=np.array(json.dumps(words, indent=1)), **arrays)
        write_bytes(path, stream.getvalue())

    def read(
        self, path: str | os.PathLike[str]
    ) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Return the heading, its lists as tuples, and the arrays of a file.

        Raises
        ------
        FileError
            If it cannot be read, is none of these, of another version, or damaged.
        """
        where = repr(str(path))
        try:
            with np.load(Path(path), allow_pickle=False) as archive:
                if not isinstance(archive, np.lib.npyio.NpzFile) or "header" not in archive:
                    raise FileError(f"{where}: is not a {self.format}; {self.remedy}")
                header = json.loads(str(archive["header"]))
                if not isinstance(header, dict) or header.get("format") != self.format:
                    raise FileError(f"{where}: is not a {self.format}; {self.remedy}")
                if header.get("version") != self.version:
                    raise FileError(
                        f"{where}: has version {header.get('version')} of the format, and "
                        f"spherekit {__version__} reads version {self.version}; make it "
                        "anew with this spherekit"
                    )
                given = {name: archive[name] for name in archive.files if name != "header"}
            return _tuples(header), given
        except OSError as error:
            raise FileError(f"{where}: cannot be read: {error.strerror or error}") from None
        except DAMAGED as error:
            raise self.damaged(where, error) from None

    def damaged(self, where: str, error: Exception) -> FileError:
        """Return the error of a file that is cut short, or in which a bit has changed."""
        return FileError(
            f"{where}: is not a complete {self.format} ({error}); make it anew"
        )


def _tuples(value: Any) -> Any:
    """Return what a heading says with tuples for lists, wherever they are in it."""
    if isinstance(value, dict):
        return {name: _tuples(part) for name, part in value.items()}
    return tuple(map(_tuples, value)) if isinstance(value, list) else value


def torque_load(heading: StoredHeading, name: str, works_on: str, text: str) -> StoredLoad:
    """Return a torque (N m), an expression as in a file, as one more load.

    Raises
    ------
    ModelError
        If it breaks the grammar, or there is such a torque already.
    """
    if any(load.name == name for load in heading.loads):
        raise ModelError(f"{heading.mechanism}: torque: the model has one already")
    try:
        parse(text, load_names(heading.angles))
    except ModelError as error:
        raise ModelError(f"{heading.mechanism}: torque: {error}") from None
    return StoredLoad(name, (works_on,), (text,))


NUMBER = (float, int)
"""What is one place; a tuple is tested in less time than a union."""

Single = Callable[[Any], list[float]]
"""Some functions at one place, in the least time."""


@dataclass(frozen=True)
class StoredModel(ABC):
    """Functions of m coordinates of one assembly mode: what all stored models do."""

    heading: StoredHeading
    alone: ClassVar[bool]
    """Whether a place is a number, the only coordinate."""

    @property
    def error(self) -> float:
        """Largest measured error of all functions, relative to the largest of each."""
        return max(function.error for part in self.heading.parts for function in part)

    @overload
    def torque(self, x: float, dx: float, ddx: float, t: float = 0.0) -> float: ...
    @overload
    def torque(
        self, x: ArrayLike, dx: ArrayLike, ddx: ArrayLike, t: ArrayLike = 0.0
    ) -> Floats: ...

    def torque(
        self, x: ArrayLike, dx: ArrayLike, ddx: ArrayLike, t: ArrayLike = 0.0
    ) -> float | Floats:
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
            single: float | Floats = self.torque_at(self.dynamics.at(x), x, dx, ddx, t)
            return single
        (q, dq, ddq), times, shape = self._together(x, dx, ddx, t=t)
        rows = self._rows(0, q)
        M = self._inertia(rows)
        torque = (M @ ddq[..., None])[..., 0] - np.sum(
            self._forces(rows, dq, times), axis=2
        )
        first, second = np.tril_indices(M.shape[1])
        for i, symbols in enumerate(self.heading.christoffel):
            bends = rows[:, self._columns(symbols)] * list(symbols.values())
            torque[:, i] += np.sum(bends * dq[:, first] * dq[:, second], axis=1)
        return np.asarray(torque.reshape(shape))

    def forces(self, x: ArrayLike, dx: ArrayLike, t: ArrayLike = 0.0) -> dict[str, Floats]:
        """Return each load's generalised forces Q (N m) by its name, shaped as x."""
        (q, dq), times, shape = self._together(x, dx, t=t)
        parts = self._forces(self._rows(0, q), dq, times)
        made, at = {}, 0
        for load in self.heading.loads:
            its = parts[..., at : at + len(load.works_on)]
            made[load.name] = np.sum(its, axis=-1).reshape(shape)
            at += len(load.works_on)
        return made

    def _value(self, name: str, x: Any) -> Any:
        """Return a stored function at one place or several."""
        if self._is_one(x):
            if name not in self._values:
                self._values[name] = self._named(name)
            return self._values[name](x)[0]
        group, column = self.heading.place(name)
        (q,), _, shape = self._together(x)
        return np.asarray(self._rows(group, q)[:, column].reshape(self._places(shape)))

    def _with_torques(
        self, torques: Mapping[str, tuple[str, str]]
    ) -> tuple[StoredLoad, ...]:
        """Return the loads with torques more: by name what they work on, and how large."""
        heading = self.heading
        more = [torque_load(heading, name, *torque) for name, torque in torques.items()]
        return (*heading.loads, *more)

    @abstractmethod
    def _is_one(self, x: Any) -> bool:
        """Return whether x is one place, not several."""

    @abstractmethod
    def _together(
        self, *given: ArrayLike, t: ArrayLike = 0.0
    ) -> tuple[list[Floats], Floats, tuple[int, ...]]:
        """Return places and rates (n, m), times (n,), and the shape that was given."""

    @abstractmethod
    def _places(self, shape: tuple[int, ...]) -> tuple[int, ...]:
        """Return the shape of a function at places of this shape."""

    @abstractmethod
    def _rows(self, group: int, q: Floats) -> Floats:
        """Return the functions of a group (n, F) at places (n, m)."""

    @abstractmethod
    def _single(self, group: int, factors: Floats) -> Single:
        """Return sums of the functions of a group by factors (F, K) at one place."""

    def _named(self, *names: str) -> Single:
        places = [self.heading.place(name) for name in names]
        group = places[0][0]
        unit = np.eye(len(self.heading.parts[group]))
        return self._single(group, unit[:, [column for _, column in places]])

    def _columns(self, names: Iterable[str]) -> list[int]:
        return [self.heading.place(name)[1] for name in names]

    @cached_property
    def _values(self) -> dict[str, Single]:
        """Functions at single places, by name, once asked for."""
        return {}

    @cached_property
    def dynamics(self) -> "_Dynamics":
        """Inertia and loads in single states."""
        return _Dynamics(self)

    def torque_at(self, row: list[float], x: Any, dx: Any, ddx: Any, t: Any) -> Any:
        """Return the torques in a state at a place of which `row` is `dynamics.at`."""
        try:
            return self.dynamics.torque(row, dx, ddx, t)
        except (ValueError, ArithmeticError):
            once = [np.array([given], dtype=float) for given in (x, dx, ddx, t)]
            return self.torque(*once)[0]

    def _inertia(self, rows: Floats) -> Floats:
        """Return M (n, m, m) of all functions in rows."""
        m = len(self.heading.christoffel)
        M = np.empty((len(rows), m, m))
        for i, k, column in zip(
            *np.tril_indices(m), self._columns(self.heading.inertia), strict=True
        ):
            M[:, i, k] = M[:, k, i] = rows[:, column]
        return M

    def _forces(self, rows: Floats, dq: Floats, t: Floats) -> Floats:
        """Return the generalised forces (n, m, components) of each load component."""
        heading = self.heading
        names = {"t": t}
        for name in (f"theta_{pair}" for pair in heading.angles):
            names[name] = rows[:, heading.place(name)[1]]
            by = self._columns(heading.by_coordinates(name))
            names[f"d{name}"] = np.sum(rows[:, by] * dq, axis=1)
        forces = np.empty((*dq.shape, len(heading.works_on)))
        for k, law in enumerate(heading.magnitudes):
            works_on = rows[:, self._columns(heading.works_on[k])]
            size = law.at(t) if isinstance(law, TorqueTable) else law.evaluate(names)
            forces[:, :, k] = np.broadcast_to(size, len(rows))[:, None] * works_on
        return forces


@final
class _Dynamics:
    """Inertia, Christoffel symbols and loads of a model, one state at a time.

    `at` returns the factors of accelerations, of products of rates and of -1, which the
    loads are that do not change, for each coordinate, then what the other loads need;
    `torque` is one Python function of these and of dq, ddq and t.
    """

    def __init__(self, model: StoredModel) -> None:
        heading = model.heading
        m, unit = len(heading.christoffel), np.eye(len(heading.parts[0]))
        alone = model.alone
        factors: dict[tuple[float, ...], str] = {}

        def put(factor: Floats) -> str:
            return factors.setdefault(tuple(factor.tolist()), f"row[{len(factors)}]")

        def stored(name: str) -> Floats:
            return np.asarray(unit[heading.place(name)[1]])

        dq, ddq = ([x] if alone else [f"{x}[{i}]" for i in range(m)] for x in ("dq", "ddq"))
        steady = np.zeros((m, len(unit)))
        laws: dict[str, tuple[Expression | TorqueTable, list[Floats]]] = {}
        for law, by in zip(heading.magnitudes, heading.works_on, strict=True):
            ways = [stored(name) for name in by]
            if isinstance(law, Expression) and not law.names:
                steady += float(law.evaluate({})) * np.array(ways)
            else:
                laws[f"size_{len(laws)}"] = law, ways
        lower = [(i, k) for i in range(m) for k in range(i + 1)]
        of = {(i, k): name for (i, k), name in zip(lower, heading.inertia, strict=True)}
        torques = []
        for i in range(m):
            inertia = [of[max(i, k), min(i, k)] for k in range(m)]
            terms = [f"{put(stored(x))}*{ddq[k]}" for k, x in enumerate(inertia)]
            for (a, b), (x, half) in zip(
                lower, heading.christoffel[i].items(), strict=True
            ):
                terms.append(f"{put(half * stored(x))}*({dq[a]}*{dq[b]})")
            if np.any(steady[i]):
                terms.append(f"-{put(steady[i])}")
            terms += [f"-{size}*{put(ways[i])}" for size, (_, ways) in laws.items()]
            torques.append(" + ".join(terms))
        given, tables = _sizes(
            heading,
            {size: law for size, (law, _) in laws.items()},
            dq,
            lambda x: put(stored(x)),
        )
        body = torques[0] if alone else f"array([{', '.join(torques)}])"
        if given:
            first = ", ".join(f"{name} := {text}" for name, text in given.items())
            body = f"({first}, {body})[-1]"
        self.torque = made_of(
            f"lambda row, dq, ddq, t: {body}", {"array": np.array, **tables}
        )
        self.at = model._single(0, np.array(list(factors)).T)


def _sizes(
    heading: StoredHeading,
    laws: Mapping[str, Expression | TorqueTable],
    dq: Sequence[str],
    put: Callable[[str], str],
) -> tuple[dict[str, str], dict[str, Callable[[float], float]]]:
    """Return magnitudes by name as Python, with the rates they need first, and tables.

    `dq` are the rates of the coordinates, `put` gives a stored function of a name.
    """
    written, given = {"t": "t"}, dict[str, str]()
    used = {x for law in laws.values() if isinstance(law, Expression) for x in law.names}
    for name in sorted(used - {"t"}):
        if name.startswith("dtheta_"):
            by = heading.by_coordinates(name[1:])
            text = " + ".join(f"{put(x)}*{rate}" for x, rate in zip(by, dq, strict=True))
            written[name] = f"rate_{len(given)}"
            given[written[name]] = text
        else:
            written[name] = put(name)
    tables: dict[str, Callable[[float], float]] = {}
    for size, law in laws.items():
        if isinstance(law, TorqueTable):
            tables[f"table_{size}"] = law.one
            given[size] = f"table_{size}(t)"
        else:
            given[size] = law.code(written)
    return given, tables
