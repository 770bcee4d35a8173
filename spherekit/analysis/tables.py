"""Declared tables: every column's name, unit and meaning, stated once."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, final

import numpy as np
from numpy.typing import NDArray

from spherekit.errors import AnalysisError
from spherekit.model.mechanism import Mechanism

Kind = Literal["number", "integer", "text", "status"]
Scale = Literal["unit", "absolute", "largest", "none"]


@final
@dataclass(frozen=True)
class Column:
    """One column of a table; `unit` is SI, rad, 1/rad, or empty for pure numbers.

    With several inputs a column that is there `per_input` becomes one for each, its name
    followed by that of the pair: ``q_left``, ``q_right``.

    `scale` says how errors of its numbers are measured: ``"absolute"``, over the
    ``"largest"`` number of the run, or ``"none"`` for what describes the computation and
    is no result. By the ``"unit"``: absolute for rad, within one turn, else the largest.
    """

    name: str
    unit: str
    meaning: str
    kind: Kind = "number"
    per_input: bool = False
    scale: Scale = "unit"


@final
@dataclass(frozen=True)
class Table:
    """A tidy table: one row per (sample, branch, subject)."""

    name: str
    meaning: str
    columns: tuple[Column, ...]

    def of(self, mechanism: Mechanism) -> "Table":
        """Return the table with a column for each input where it says so."""
        inputs = mechanism.inputs
        if len(inputs) < 2:
            return self
        columns: list[Column] = []
        for column in self.columns:
            if not column.per_input:
                columns.append(column)
                continue
            columns += [
                Column(
                    f"{column.name}_{item.pair}",
                    column.unit,
                    f"{column.meaning} {item.pair}",
                    column.kind,
                    scale=column.scale,
                )
                for item in inputs
            ]
        return replace(self, columns=tuple(columns))

    def check(self, data: Mapping[str, NDArray[Any]], analysis: str) -> None:
        """Raise `AnalysisError` if columns are missing, extra or of unequal length."""
        names = [column.name for column in self.columns]
        if list(data) != names:
            raise AnalysisError(
                f"{analysis}: table {self.name} was declared with columns {names}, but "
                f"compute returned {list(data)}"
            )
        lengths = {name: len(values) for name, values in data.items()}
        if len(set(lengths.values())) > 1:
            raise AnalysisError(
                f"{analysis}: table {self.name} has columns of unequal length: {lengths}"
            )


TableData = Mapping[str, NDArray[Any]]


def input_columns(mechanism: Mechanism, inputs: NDArray[np.float64]) -> dict[str, Any]:
    """Return the columns `INPUTS` of values (n, inputs), by their names."""
    own = Table("", "", (INPUTS,)).of(mechanism).columns
    return {c.name: inputs[:, k] for k, c in enumerate(own)}


def concatenate(parts: "list[TableData]") -> TableData:
    """Return the rows of several parts of one table, one after another."""
    return {
        name: np.concatenate([np.asarray(part[name]) for part in parts])
        for name in parts[0]
    }


SAMPLE = Column("sample", "", "number of the input value, from 0", "integer")
BRANCH = Column("branch", "", "number of the assembly mode", "integer")
INPUT = Column("q", "rad", "variable of the driven pair")
INPUTS = Column("q", "rad", "variable of the driven pair", per_input=True)
TIME = Column("t", "s", "time")
RESIDUAL = Column(
    "residual", "rad", "largest rotation by which a loop fails to close", scale="none"
)
STATUS = Column("status", "", "OK, or why the row is empty", "status")
