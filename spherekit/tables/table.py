"""Declared tables: every column's name, unit and meaning, stated once."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from spherekit.arrays import Array, Floats
from spherekit.errors import AnalysisError
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.lazy_columns import Interleaved, once, read
from spherekit.wording import listing

Kind = Literal["number", "integer", "text", "status"]
Scale = Literal["unit", "absolute", "largest", "none"]
Turns = Literal["no", "vector", "otherwise"]

TYPES = {"number": np.float64, "integer": np.int64, "status": np.int8}
"""Types of the columns of each kind but text."""
BLANK = {"number": np.nan, "text": ""}
"""What stands where a part of a table lacks a column."""

Format = Literal["csv", "parquet"]

FILE_SIZE: Mapping[Format, float] = {"csv": 2.2, "parquet": 0.6}
"""About how large files are, over packed rows; measured on motions and poles."""


MOST_CSV = 1e8
"""Bytes of CSV that are written without being asked for."""


def formats_of(asked: Sequence[Format] | None, csv_bytes: float) -> Sequence[Format]:
    """Return the formats of tables that take about so many bytes as CSV.

    Where none is asked for: CSV only up to `MOST_CSV`.
    """
    if asked is not None:
        return asked
    return tuple(FILE_SIZE) if csv_bytes <= MOST_CSV else ("parquet",)


IN_DEGREES = {"rad": "deg", "rad/s": "deg/s", "rad/s2": "deg/s2"}
"""Units of angles, and those in which tables give them if asked for degrees. Quantities per
angle stay per rad."""

COLUMNS = "columns.csv"
"""The file in which a folder of tables says of every column its unit and meaning."""

CHUNK = 1 << 17
"""Rows that are written and read at once."""


@dataclass(frozen=True)
class Column:
    """One column of a table; `unit` is SI, rad, 1/rad, or empty for pure numbers.

    With several inputs a column that is there `per_input` becomes one for each, its name
    followed by that of the pair: ``q_left``, ``q_right``.

    One that is there `per_passive` becomes one for each variable of the pairs that are not
    driven, with the name of that variable.

    `scale` says how errors of its numbers are measured: ``"absolute"``, over the
    ``"largest"`` number of the run, or ``"none"`` for what describes the computation and
    is not a result. By the ``"unit"``: absolute for rad, within one turn, else the largest.

    `turns` says what becomes of it where the mechanism is turned as a whole: ``"no"`` for
    what no turn changes, ``"vector"`` for a component of a vector in ground axes, x, y, z
    in successive columns, ``"otherwise"`` for what else depends on the ground's axes. Rows
    of a table without samples, or with a text that does, are then others too.
    """

    name: str
    unit: str
    meaning: str
    kind: Kind = "number"
    per_input: bool = False
    per_passive: bool = False
    scale: Scale = "unit"
    turns: Turns = "no"

    def unit_in(self, degrees: bool) -> str:
        """Return the unit of its numbers in a table with angles in rad or degrees."""
        return IN_DEGREES.get(self.unit, self.unit) if degrees else self.unit

    def header(self, degrees: bool) -> str:
        """Return what files call it: with its unit, ``q [deg]``, where that is not SI."""
        unit = self.unit_in(degrees)
        return self.name if unit == self.unit else f"{self.name} [{unit}]"

    def stated_unit(self, degrees: bool) -> str:
        """Return that unit as files say it: 1 of a pure number, empty of a name."""
        return self.unit_in(degrees) or ("1" if self.kind == "number" else "")


@dataclass(frozen=True)
class Table:
    """A tidy table: one row per (sample, assembly mode, subject)."""

    name: str
    meaning: str
    columns: tuple[Column, ...]

    def of(self, mechanism: Mechanism) -> "Table":
        """Return the table with a column for each input or variable where it says so."""
        columns: list[Column] = []
        driven = mechanism.input_pairs
        owners = mechanism.names_of(mechanism.variable_owners)
        for column in self.columns:
            named = {column.name: ""}
            if column.per_passive:
                named = {
                    name: f" {pair}"
                    for name, pair in zip(mechanism.variable_names, owners, strict=True)
                    if pair not in driven
                }
            elif column.per_input and len(driven) > 1:
                named = {f"{column.name}_{pair}": f" {pair}" for pair in driven}
            columns += [
                replace(
                    column,
                    name=name,
                    meaning=column.meaning + pair,
                    per_input=False,
                    per_passive=False,
                )
                for name, pair in named.items()
            ]
        return replace(self, columns=tuple(columns))

    def units(self, degrees: bool) -> dict[str, str]:
        """Return the unit of every column by what files call it."""
        return {c.header(degrees): c.stated_unit(degrees) for c in self.columns}

    def stacked(
        self, mechanism: Mechanism, parts: Iterable[Mapping[str, Any]] = ()
    ) -> dict[str, Array]:
        """Return the rows of all parts, one part after another, by column.

        A part has columns (n,), or a single value for all of its rows; if it has no
        column, it is one row. Numbers and texts that it lacks are blank.

        Raises
        ------
        AnalysisError
            If a part has a column that is not declared.
        """
        columns = self.of(mechanism).columns
        blank = {c.name: BLANK[c.kind] for c in columns if c.kind in BLANK}
        made: dict[str, list[Array]] = {
            c.name: [np.zeros(0, TYPES.get(c.kind, str))] for c in columns
        }
        for part in parts:
            if undeclared := part.keys() - made.keys():
                raise AnalysisError(f"table {self.name} has no {listing(undeclared)}")
            count = next((len(values) for values in part.values() if np.ndim(values)), 1)
            row = {**blank, **part}
            for c in columns:
                values = np.asarray(row[c.name], dtype=TYPES.get(c.kind, str))
                made[c.name].append(np.broadcast_to(values, (count,)))
        return {name: np.concatenate(arrays) for name, arrays in made.items()}

    def with_names(self, mechanism: Mechanism) -> "Table":
        """Return the table with the names of assembly modes, where the file has some."""
        if not mechanism.modes or ASSEMBLY_MODE not in self.columns:
            return self
        place = self.columns.index(ASSEMBLY_MODE) + 1
        return replace(
            self, columns=(*self.columns[:place], MODE_NAME, *self.columns[place:])
        )

    def named(self, data: "TableData", names: Mapping[int, str]) -> "TableData":
        """Return rows with the names of their assembly modes, where the table has these."""
        if MODE_NAME not in self.columns:
            return data
        numbers, repeats = once(data[ASSEMBLY_MODE.name])
        texts = [names.get(k, "") for k in range(np.max(numbers, initial=-1) + 1)]
        words = np.array(texts, str)[numbers]
        made = Interleaved([words] * repeats) if repeats > 1 else words
        return {c.name: made if c == MODE_NAME else data[c.name] for c in self.columns}

    @property
    def in_assembly_modes(self) -> bool:
        """Whether rows belong to samples of assembly modes."""
        return {SAMPLE.name, ASSEMBLY_MODE.name} <= {column.name for column in self.columns}


TableArrays = Mapping[str, Array]
TableData = Mapping[str, Array | Interleaved]
"""A table's columns, and these as an analysis may give them."""

Tables = Mapping[str, TableData]
"""Tables by name, as an analysis may give them."""

Declared = Mapping[str, Sequence[Table]]
"""The tables that are declared, by the name of their analysis."""

Units = Mapping[str, str]
"""Units by the names of columns or quantities."""


def row_count(data: TableData) -> int:
    """Return how many rows a table has."""
    return len(next(iter(data.values())))


def arrays(data: TableData) -> dict[str, Array]:
    """Return all columns as arrays."""
    return dict(zip(data, read(data.values()), strict=True))


def input_columns(mechanism: Mechanism, values: Floats, name: str = "q") -> dict[str, Any]:
    """Return the columns that a name has by input, of values (n, inputs)."""
    columns = Table("", "", (Column(name, "", "", per_input=True),)).of(mechanism).columns
    return {c.name: values[:, k] for k, c in enumerate(columns)}


SAMPLE = Column("sample", "", "number of the input value, from 0", "integer")
ASSEMBLY_MODE = Column("assembly_mode", "", "number of the assembly mode", "integer")
MODE_NAME = Column("mode_name", "", "name of the assembly mode in the file", "text")
INPUT = Column("q", "rad", "variable of the driven pair")
INPUTS = Column("q", "rad", "variable of the driven pair", per_input=True)
TIME = Column("t", "s", "time")
RESIDUAL = Column(
    "residual", "rad", "largest rotation by which a loop fails to close", scale="none"
)
STATUS = Column("status", "", "OK, or why the row is empty", "status")
