"""Declarations of tables: the name, unit and meaning of every column, stated once."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from spherekit.arrays import Array, Floats
from spherekit.errors import AnalysisError
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.lazy_columns import (
    Interleaved,
    read_columns,
    remove_repetitions,
)
from spherekit.wording import listing

Kind = Literal["number", "integer", "text", "status"]
"""What the cells of a column are."""

Scale = Literal["unit", "absolute", "largest", "none"]
"""How errors of a column are scaled, see `Column`."""

Turns = Literal["no", "vector", "otherwise"]
"""How a column changes if the whole mechanism is rotated, see `Column`."""

DTYPE_BY_KIND = {"number": np.float64, "integer": np.int64, "status": np.int8}
"""Array types of the columns of each kind, except text."""

BLANK_BY_KIND = {"number": np.nan, "text": ""}
"""Values for rows in a part of a table (group of rows) without the column."""

IN_DEGREES = {"rad": "deg", "rad/s": "deg/s", "rad/s2": "deg/s2"}
"""Units of angles, and those in tables in degrees. Quantities per angle stay per rad."""

COLUMNS = "columns.csv"
"""Name of the file with the unit and meaning of every column in a folder of tables."""

CHUNK_ROWS = 1 << 17
"""Number of rows written and read at once. Larger: more memory. Smaller: more time."""


@dataclass(frozen=True)
class Column:
    """Declaration of one column of a table.

    Attributes
    ----------
    name
        Name of the column.
    unit
        SI unit, with angles in rad; empty for pure numbers.
    meaning
        Description for users.
    kind
        What the cells contain: ``"number"``, ``"integer"``, ``"text"`` or ``"status"`` (a
        `spherekit.Status`).
    per_input
        Whether a mechanism with several inputs has one column for each. Their names end
        with the name of the pair: ``q_left``, ``q_right``. In the meaning the name of the
        pair follows the words "the driven pair".
    per_passive
        Whether the column stands for one column per variable of the passive pairs (pairs
        that are not driven). Each has the name and the meaning of its variable.
    scale
        Whether errors of the column are absolute or relative. `spherekit.trade` measures
        these errors. Errors of columns in rad are taken within one turn.

        - ``"absolute"``: They are absolute.
        - ``"largest"``: They are relative to the largest number among the columns of the
          table with the same unit. There is one exception: columns in N m/rad, for
          example, contain only rounding errors if the columns in N m are constant. Errors
          in N m/rad are then relative to the largest number in N m.
        - ``"unit"``: They are absolute for columns in rad, and as with ``"largest"`` for
          other units.
        - ``"none"``: They are not measured, because the column describes the computation
          and is not a result.
    turns
        How the column changes if the whole mechanism is rotated. The check `rotation` of
        `spherekit.plugin.conformance` compares tables accordingly.

        - ``"no"``: The column does not change.
        - ``"vector"``: The column is a component of a vector in ground axes. The components
          x, y, z are in successive columns.
        - ``"otherwise"``: The column changes in another way, as an azimuth does. The column
          is not compared. In two cases the rotated mechanism may have other rows, and no
          column of the table is compared. In the first case, the column is a text. In the
          second case, the rows do not belong to samples in assembly modes.
    on_request
        Name of the parameter of the analysis that requests the column. The table has the
        column only if the parameter differs from its default. Empty: it always has it.
    """

    name: str
    unit: str
    meaning: str
    kind: Kind = "number"
    per_input: bool = False
    per_passive: bool = False
    scale: Scale = "unit"
    turns: Turns = "no"
    on_request: str = ""

    def unit_in(self, degrees: bool) -> str:
        """Return the unit in a table with angles in degrees, or in rad."""
        return IN_DEGREES.get(self.unit, self.unit) if degrees else self.unit

    def header(self, degrees: bool) -> str:
        """Return the header of the column in files.

        The header is the name of the column. A unit that differs from the SI unit follows
        in brackets, as in ``q [deg]``. `degrees` says whether angles of the table are in
        degrees.
        """
        unit = self.unit_in(degrees)
        return self.name if unit == self.unit else f"{self.name} [{unit}]"

    def stated_unit(self, degrees: bool) -> str:
        """Return the unit as it is written in files.

        In files a pure number has the unit ``1``. The unit is empty for texts, statuses and
        whole numbers without a unit. `degrees` says whether angles of the table are in
        degrees.
        """
        return self.unit_in(degrees) or ("1" if self.kind == "number" else "")


@dataclass(frozen=True)
class Table:
    """Declaration of a table, often with a row for each sample, assembly mode and subject.

    A subject is what a row is about, such as a pole or a pair. An assembly mode is one of
    the ways to assemble the mechanism.

    Attributes
    ----------
    name
        Name of the table.
    meaning
        Description for users.
    columns
        The columns of the table, in their order.
    """

    name: str
    meaning: str
    columns: tuple[Column, ...]

    def of(self, mechanism: Mechanism) -> "Table":
        """Return the declaration of this table with the columns that a mechanism needs.

        Some declared columns stand for several columns of the result:

        - With several inputs, a column with `per_input` becomes one column for each input.
          The name of the driven pair (joint) is appended to the name of the column. The
          meaning of the column, a text for users, then also contains this name.
        - A column with `per_passive` becomes one column for each variable of the pairs that
          are not driven, with the name and the meaning of the variable.
        """
        driven_pairs = mechanism.input_pairs
        columns: list[Column] = []
        for column in self.columns:
            # The meanings of the columns that replace this one, by their names.
            meaning_by_name = {column.name: column.meaning}
            if column.per_passive:
                meaning_by_name = _passive_meanings(mechanism)
            elif column.per_input and len(driven_pairs) > 1:
                meaning_by_name = {
                    f"{column.name}_{pair}": _name_pair(column.meaning, pair)
                    for pair in driven_pairs
                }
            for name, meaning in meaning_by_name.items():
                columns.append(
                    replace(
                        column,
                        name=name,
                        meaning=meaning,
                        per_input=False,
                        per_passive=False,
                    )
                )
        return replace(self, columns=tuple(columns))

    def units(self, degrees: bool) -> dict[str, str]:
        """Return the unit of every column, by the header of the column in files.

        `degrees` says whether angles of the table are in degrees.
        """
        return {c.header(degrees): c.stated_unit(degrees) for c in self.columns}

    def stacked(
        self, mechanism: Mechanism, parts: Iterable[Mapping[str, Any]] = ()
    ) -> dict[str, Array]:
        """Return the complete columns of a table whose rows are given in parts.

        An analysis can thus make the rows of a table group by group.

        Parameters
        ----------
        mechanism
            The mechanism. With several inputs, some columns stand for one column per input.
        parts
            The parts in the order of their rows. A part has values by name of the column:
            an array (n,), or one value for all rows of the part. A part without an array is
            one row. A part may leave out columns of numbers and texts, which are then blank
            (NaN or empty). It must have all columns of whole numbers and of statuses.

        Returns
        -------
        Arrays with all rows, by name of the column.

        Raises
        ------
        AnalysisError
            If a part has a column that is not declared.
        """
        # The declaration with one column per input, where there are several inputs.
        columns = self.of(mechanism).columns
        blank_by_name: dict[str, Any] = {}
        arrays_by_name: dict[str, list[Array]] = {}
        for column in columns:
            if column.kind in BLANK_BY_KIND:
                blank_by_name[column.name] = BLANK_BY_KIND[column.kind]
            # An empty array gives the column its type if there are no parts.
            dtype = DTYPE_BY_KIND.get(column.kind, str)
            arrays_by_name[column.name] = [np.zeros(0, dtype)]
        for part in parts:
            if undeclared := part.keys() - arrays_by_name.keys():
                raise AnalysisError(
                    f"table {self.name} has no column {listing(undeclared)}"
                )
            # The number of rows is the length of any array in the part.
            count = next((len(values) for values in part.values() if np.ndim(values)), 1)
            complete_part = {**blank_by_name, **part}
            for column in columns:
                dtype = DTYPE_BY_KIND.get(column.kind, str)
                values = np.asarray(complete_part[column.name], dtype=dtype)
                arrays_by_name[column.name].append(np.broadcast_to(values, (count,)))
        return {name: np.concatenate(arrays) for name, arrays in arrays_by_name.items()}

    def with_names(self, mechanism: Mechanism) -> "Table":
        """Return the table with a column for the names of assembly modes.

        An assembly mode is one way to assemble the mechanism. Nothing is added if the
        mechanism names no modes or the table has no mode numbers.
        """
        if not mechanism.modes or ASSEMBLY_MODE not in self.columns:
            return self
        index = self.columns.index(ASSEMBLY_MODE) + 1
        return replace(
            self, columns=(*self.columns[:index], MODE_NAME, *self.columns[index:])
        )

    def named(self, data: "TableData", names: Mapping[int, str]) -> "TableData":
        """Return the data with a further column of the names of assembly modes.

        An assembly mode is one of the ways to assemble the mechanism. A mechanism can name
        its modes. The table then declares a column of names, by `with_names`. If the table
        declares no such column, the data are returned as they are.

        Parameters
        ----------
        data
            The other columns of the table by name. One of them has the number of the mode
            in each row, from which the name follows.
        names
            Names by number of the mode. Modes without a name get an empty text.
        """
        if MODE_NAME not in self.columns:
            return data
        mode_names = _name_modes(data[ASSEMBLY_MODE.name], names)
        return {
            column.name: mode_names if column == MODE_NAME else data[column.name]
            for column in self.columns
        }

    @property
    def in_assembly_modes(self) -> bool:
        """Whether each row of the table belongs to a sample in an assembly mode."""
        return {SAMPLE.name, ASSEMBLY_MODE.name} <= {column.name for column in self.columns}


def _name_modes(
    mode_column: Array | Interleaved, names: Mapping[int, str]
) -> Array | Interleaved:
    """Return the column of names of assembly modes, from the column of their numbers.

    An assembly mode is one of the ways to assemble the mechanism. A table can have several
    rows for one sample, one for each subject, such as a pole. All these rows have the same
    mode, so the texts are made once for each sample. `Interleaved` repeats the texts for
    each subject when the column is read.

    Parameters
    ----------
    mode_column
        The number of the mode in each row.
    names
        Names by number of the mode. Modes without a name get an empty text.
    """
    mode_numbers, repeats = remove_repetitions(mode_column)
    mode_count = np.max(mode_numbers, initial=-1) + 1
    name_by_mode = np.array([names.get(k, "") for k in range(mode_count)], str)
    mode_names = name_by_mode[mode_numbers]
    return Interleaved([mode_names] * repeats) if repeats > 1 else mode_names


TableArrays = Mapping[str, Array]
"""The columns (n,) of a table, by name."""

TableData = Mapping[str, Array | Interleaved]
"""The columns of a table as an analysis may return them; they may be computed lazily."""

Tables = Mapping[str, TableData]
"""Tables by name, as an analysis may return them."""

Declared = Mapping[str, Sequence[Table]]
"""The tables that are declared, by the name of their analysis."""

Units = Mapping[str, str]
"""Units by the names of columns or quantities."""


def _passive_meanings(mechanism: Mechanism) -> dict[str, str]:
    """Return what each variable of the pairs that are not driven measures, by its name."""
    owners = mechanism.names_of(mechanism.variable_owners)
    return {
        name: meaning
        for name, meaning, owner in zip(
            mechanism.variable_names, mechanism.variable_meanings, owners, strict=True
        )
        if owner not in mechanism.input_pairs
    }


def _name_pair(meaning: str, pair: str) -> str:
    """Return the meaning of a column that belongs to an input, with the name of its pair.

    The name, in quotes, follows the words "the driven pair". If the meaning does not
    contain these words, the name is appended.
    """
    words = "the driven pair"
    if words in meaning:
        return meaning.replace(words, f'{words} "{pair}"')
    return f'{meaning}, pair "{pair}"'


def row_count(data: TableData) -> int:
    """Return the number of rows of a table."""
    return len(next(iter(data.values())))


def arrays(data: TableData) -> dict[str, Array]:
    """Return all columns as arrays; lazy columns are computed."""
    return dict(zip(data, read_columns(data.values()), strict=True))


def input_columns(mechanism: Mechanism, values: Floats, name: str = "q") -> dict[str, Any]:
    """Return the columns of a quantity that every input (driven pair) has.

    Parameters
    ----------
    mechanism
        The mechanism.
    values
        (n, inputs) values of the quantity in n rows.
    name
        Name of the column of a single input. If there are several inputs, the name of each
        column is this name and the name of the driven pair, such as ``q_left``.
    """
    columns = Table("", "", (Column(name, "", "", per_input=True),)).of(mechanism).columns
    return {c.name: values[:, k] for k, c in enumerate(columns)}


SAMPLE = Column(
    "sample",
    "",
    "number of the sample, counted from 0 (a sample is one set of input values)",
    "integer",
)
ASSEMBLY_MODE = Column(
    "assembly_mode",
    "",
    "number of the assembly mode (a way to assemble the mechanism), from 0",
    "integer",
)
MODE_NAME = Column(
    "mode_name", "", "name of the assembly mode in the mechanism file", "text"
)
INPUT = Column("q", "rad", "angle of the driven pair (the input)")
INPUTS = Column("q", "rad", "angle of the driven pair (the input)", per_input=True)
TIME = Column("t", "s", "time to which the values of this row belong")
RESIDUAL = Column(
    "residual", "rad", "largest angle by which a loop of links fails to close", scale="none"
)
STATUS = Column(
    "status", "", "OK, or the reason why numbers are missing in this row", "status"
)
