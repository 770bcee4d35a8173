"""What a stored model is of, without its numbers, and the archive that holds both."""

import hashlib
import io
import json
import math
import stat
import struct
import zipfile
import zlib
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from spherekit.arrays import Array
from spherekit.conventions import AnyPath, Names
from spherekit.errors import FileError, SolveError
from spherekit.mechanism.load import TorqueTable
from spherekit.mechanism.load_expression import load_names, parse
from spherekit.symbolic.expression_graph import Expr, ExpressionNode, dot, symbols
from spherekit.symbolic.parsed_expressions import convert_to_graph
from spherekit.version import __version__
from spherekit.wording import choices

SLACK = 1e-12
"""The ends of a range may be overstepped by this part of it, which is rounding."""

DAMAGED: tuple[type[Exception], ...] = (
    *(ValueError, KeyError, TypeError, EOFError, RuntimeError, ArithmeticError),
    *(zipfile.BadZipFile, zlib.error, struct.error),
)
"""What NumPy, zipfile and constructors raise of archives with other content."""


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


@dataclass(frozen=True)
class StoredLoad:
    """The magnitudes of a load's components, and the stored functions they work on.

    `components` are expressions in pair variables, their rates and the time; a torque
    given by a table has `times` (s) and `torques` (N m) instead. `works_on` names a
    function for each: a pair's variable or its rate, or a velocity of the load's own.
    """

    name: str
    works_on: Names
    components: Names = ()
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
class StoredHeading:
    """What a stored model of m coordinates is of, without its numbers.

    `variables` and `angles` name the pair variables, and the R pairs among them; `poles`
    the poles, as LINK/RELATIVE_TO; `inputs` the driven pairs. `mechanism_sha256` is of the
    mechanism's canonical file in radians, `made_by` the version of spherekit.

    The coordinates are `by`: along one curve "q", the variable of the input, where that
    turns fully on a closed curve, else "s", its arc length (rad); over a box those of the
    inputs. `low`, `high` (m,) rad bound them. Along a curve the variables grow by `rise`,
    and a `periodic` model goes on so beyond its ends; over a box `rise` is empty, and
    `covered` the part of it in which the functions are known: elsewhere the assembly mode
    does not exist, or is too near to a singularity. The first of `groups` has what the
    motion needs, each further one a pole of a curve, in the order of `poles`.
    """

    mechanism: str
    mechanism_sha256: str
    made_by: str
    assembly_mode: int
    variables: Names
    angles: Names
    poles: Names
    loads: tuple[StoredLoad, ...]
    inputs: Names
    by: Names
    low: tuple[float, ...]
    high: tuple[float, ...]
    rise: tuple[float, ...] = ()
    periodic: bool = False
    covered: float = 1.0
    groups: tuple[tuple[StoredFunction, ...], ...] = ()

    @cached_property
    def alone(self) -> bool:
        """Whether there is a curve, and so one coordinate, a number."""
        return bool(self.rise)

    @property
    def functions(self) -> tuple[StoredFunction, ...]:
        """All stored functions."""
        return tuple(chain(*self.groups))

    @property
    def _lower(self) -> list[tuple[str, str]]:
        """The places of a symmetric matrix, row by row to its diagonal."""
        return [(a, b) for i, a in enumerate(self.by) for b in self.by[: i + 1]]

    @property
    def inertia(self) -> list[str]:
        """The names of the inertia matrix, row by row to its diagonal."""
        return ["B"] if self.alone else [f"M {a} {b}" for a, b in self._lower]

    @property
    def christoffel(self) -> list[dict[str, float]]:
        """Of each coordinate the symbols, in the order of `inertia`, with their factors."""
        if self.alone:
            return [{self.derivative("B"): 0.5}]
        return [
            {f"c {pair} {a} {b}": 1.0 if a == b else 2.0 for a, b in self._lower}
            for pair in self.by
        ]

    def derivative(self, name: str) -> str:
        """Return the name of a function's derivative by the only coordinate."""
        return f"d({name})/d{self.by[0]}"

    def by_coordinates(self, name: str) -> list[str]:
        """Return the names of what a variable or a load works by, for each coordinate."""
        if name not in self.variables:
            return [name] if self.alone else [f"{name} by {pair}" for pair in self.by]
        if self.alone:
            return [self.derivative(name)]
        return [f"d({name})/d(theta_{pair})" for pair in self.by]

    def place(self, name: str) -> tuple[int, int]:
        """Return the group and the column of a function; `SolveError` if it has none."""
        if name not in self._places:
            raise self.not_stored("", name, self._places)
        return self._places[name]

    @cached_property
    def _places(self) -> Mapping[str, tuple[int, int]]:
        return {
            function.name: (k, column)
            for k, group in enumerate(self.groups)
            for column, function in enumerate(group)
        }

    @cached_property
    def tables(self) -> list[TorqueTable]:
        """The torques that are given by tables."""
        return [load.table for load in self.loads if load.table]

    @cached_property
    def motion(self) -> list[ExpressionNode]:
        """The variables of `forces` and `torques` that are no stored functions.

        Rates and accelerations of the coordinates, the time, and the torques of `tables`
        then.
        """
        of_each = [f"{what} {k}" for what in ("rate", "acceleration") for k in self.by]
        return symbols([*of_each, "t", *(f"table {table.name}" for table in self.tables)])

    @cached_property
    def forces(self) -> list[list[Expr]]:
        """The generalised forces of each load by each coordinate, in terms."""
        names = load_names(self.angles)
        m = len(self.by)
        rates, time = self.motion[:m], self.motion[2 * m]

        def named(name: str) -> Expr:
            if name.startswith("dtheta_"):
                return dot(map(self._stored, self.by_coordinates(name[1:])), rates)
            return time if name == "t" else self._stored(name)

        forces = []
        for load in self.loads:
            laws: list[Expr] = [
                convert_to_graph(law, {x: (named(x),) * 2 for x in law.names})
                for law in (parse(text, names) for text in load.components)
            ] or symbols([f"table {load.name}"])
            works = [map(self._stored, self.by_coordinates(x)) for x in load.works_on]
            forces.append([dot(laws, ways) for ways in zip(*works, strict=True)])
        return forces

    @cached_property
    def torques(self) -> list[Expr]:
        """The driving torque M x'' + C x' - Q for each coordinate, as expressions."""
        m = len(self.by)
        rates = self.motion[:m]
        accelerations = self.motion[m : 2 * m]
        # Symmetric matrices are stored row by row to their diagonals.
        first, second = np.tril_indices(m)
        rate_products = [rates[a] * rates[b] for a, b in zip(first, second, strict=True)]
        M = np.empty((m, m), dtype=object)
        M[first, second] = M[second, first] = list(map(self._stored, self.inertia))
        torques = []
        for i, factor_by_symbol in enumerate(self.christoffel):
            symbols_of_row = [
                factor * self._stored(name) for name, factor in factor_by_symbol.items()
            ]
            inertia_torque = dot(M[i], accelerations) + dot(symbols_of_row, rate_products)
            load_force = sum((force[i] for force in self.forces), 0.0)
            torques.append(inertia_torque - load_force)
        return torques

    def _stored(self, name: str) -> ExpressionNode:
        """Return the variable that stands for a function; `SolveError` if it has none."""
        self.place(name)
        return symbols([name])[0]

    def pole(self, name: str) -> tuple[str, float]:
        """Return the name by which a pole is stored, and -1 if that turns its links round.

        Raises
        ------
        SolveError
            If it is not stored.
        """
        for stored, sense in ((name, 1.0), ("/".join(reversed(name.split("/"))), -1.0)):
            if stored in self.poles:
                return stored, sense
        raise self.not_stored("pole ", name, self.poles)

    def not_stored(self, what: str, name: str, stored: Collection[str]) -> SolveError:
        """Return the error of what the model has not."""
        return SolveError(
            f'{self.mechanism}: {what}"{name}" is not stored'
            f"{choices(name, stored, 'Stored are')}"
        )

    def within(self, x: float) -> tuple[float, int]:
        """Return the place on the curve within its ends, and how many laps were taken off.

        Raises
        ------
        SolveError
            If it is not finite, or beyond the ends of a curve that is not periodic.
        """
        (low,), (high,) = self.low, self.high
        lap = high - low
        if self.periodic and math.isfinite(x):
            laps = math.floor((x - low) / lap)
            return x - laps * lap, laps
        slack = SLACK * lap
        if low - slack <= x <= high + slack:
            return x, 0
        allowed = (
            "is finite" if self.periodic else f"lies within {low:.9g} to {high:.9g} rad"
        )
        raise SolveError(
            f"{self.mechanism}: the model is asked for {self.by[0]} = {x:.9g}, but "
            f"the coordinate {allowed}"
        )


Made = TypeVar("Made")

Kind = tuple[str, int, str]
"""Of archives with a heading: the name and version of their format, how to make one."""


CHECKSUM_MARK = b"sha256:"
CHECKSUM_LENGTH = 64
"""An archive ends with its own SHA-256 sum as hexadecimal digits, after a mark.

Both are the comment of the zip archive, which other programs pass over. Whatever changes a
byte, or writes the archive anew, leaves no sum that fits. Without it, a changed heading
could ask for any amount of work before a fault is noticed.
"""


def write_archive(
    path: AnyPath, kind: Kind, heading: Mapping[str, Any], arrays: Mapping[str, Any]
) -> None:
    """Write a heading and arrays; `OutputError` if that cannot be done."""
    from spherekit.storage.atomic_write import write_bytes

    words = {"format": kind[0], "version": kind[1], **heading}
    stream = io.BytesIO()
    np.savez_compressed(stream, header=np.array(json.dumps(words, indent=1)), **arrays)
    with zipfile.ZipFile(stream, "a") as archive:
        archive.comment = CHECKSUM_MARK + bytes(CHECKSUM_LENGTH)
    content = stream.getvalue()[:-CHECKSUM_LENGTH]
    write_bytes(path, content + _checksum(content))


def _checksum(content: bytes) -> bytes:
    return hashlib.sha256(content).hexdigest().encode()


def read_archive(
    path: AnyPath, kind: Kind, made: Callable[[dict[str, Any], dict[str, Array]], Made]
) -> Made:
    """Return what is made of the heading, its lists as tuples, and the arrays of a file.

    Raises
    ------
    FileError
        If it cannot be read, is none of this kind, of another version, or is not as it was
        written.
    """
    where, (words, version, remedy) = repr(str(path)), kind
    try:
        if stat.S_ISFIFO(mode := Path(path).stat().st_mode) or stat.S_ISCHR(mode):
            raise FileError(f"{where}: is a pipe or a device; give the name of a file")
        data = Path(path).read_bytes()
    except OSError as error:
        raise FileError(f"{where}: cannot be read: {error.strerror or error}") from None
    except ValueError as error:  # a null character in the name
        raise FileError(f"{where}: cannot be read: {error}") from None
    content = data[:-CHECKSUM_LENGTH]
    is_whole = content.endswith(CHECKSUM_MARK) and data == content + _checksum(content)
    try:
        if not is_whole:
            raise ValueError("its checksum is missing or wrong")
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            header = json.loads(str(archive.get("header", "null")))
            if not isinstance(header, dict) or header.get("format") != words:
                raise FileError(f"{where}: is not a {words}; {remedy}")
            if header.get("version") != version:
                raise FileError(
                    f"{where}: has version {header.get('version')} of the format, and "
                    f"spherekit {__version__} reads version {version}; make it anew with "
                    "this spherekit"
                )
            given = {name: archive[name] for name in archive.files if name != "header"}
        return made(_tuples(header), given)
    except DAMAGED as error:
        raise FileError(
            f"{where}: is not a {words}, or not as this spherekit has written it "
            f"({error}): it was cut short or changed, or is from another program or "
            f"version; make it anew, {remedy}"
        ) from None


def _tuples(value: Any) -> Any:
    """Return what a heading says with tuples for lists, wherever they are in it."""
    if isinstance(value, dict):
        return {name: _tuples(part) for name, part in value.items()}
    return tuple(map(_tuples, value)) if isinstance(value, list) else value
