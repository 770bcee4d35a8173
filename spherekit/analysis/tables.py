"""Declared tables: every column's name, unit and meaning, stated once."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, final

import numpy as np
from numpy.typing import NDArray

from spherekit.errors import AnalysisError

Kind = Literal["number", "integer", "text", "status"]


@final
@dataclass(frozen=True)
class Column:
    """One column of a table; `unit` is SI, rad, 1/rad, or empty for pure numbers."""

    name: str
    unit: str
    meaning: str
    kind: Kind = "number"


@final
@dataclass(frozen=True)
class Table:
    """A tidy table: one row per (sample, branch, subject)."""

    name: str
    meaning: str
    columns: tuple[Column, ...]

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


def concatenate(parts: "list[TableData]") -> TableData:
    """Return the rows of several parts of one table, one after another."""
    return {
        name: np.concatenate([np.asarray(part[name]) for part in parts])
        for name in parts[0]
    }


SAMPLE = Column("sample", "", "number of the input value, from 0", "integer")
BRANCH = Column("branch", "", "number of the assembly mode", "integer")
INPUT = Column("q", "rad", "variable of the driven pair")
TIME = Column("t", "s", "time")
RESIDUAL = Column("residual", "rad", "largest rotation by which a loop fails to close")
STATUS = Column("status", "", "OK, or why the row is empty", "status")
