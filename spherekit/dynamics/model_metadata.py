"""What a stored model is of, without its numbers, and the archive that holds both."""

import io
import json
import math
import os
import struct
import zipfile
import zlib
from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import listing, nearest
from spherekit.errors import FileError, ModelError, SolveError
from spherekit.model.expression import Expression, load_names, parse
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
