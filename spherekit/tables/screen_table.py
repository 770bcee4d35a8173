"""A small table of results for the screen, whose cells are texts."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, Self

from spherekit.conventions import Names


@dataclass(frozen=True)
class ScreenColumn:
    """A column of a table that is printed on the screen (`ScreenTable`).

    Attributes
    ----------
    heading
        Text above the column. It includes the unit, such as ``output 4/1 (deg)``.
    align
        ``"right"`` for numbers that are compared with each other.
    """

    heading: str
    align: Literal["left", "right"] = "left"


@dataclass(frozen=True)
class ScreenTable:
    """Results that a command prints on the screen in rows and columns, as texts.

    Attributes
    ----------
    columns
        The columns from left to right.
    rows
        For each row, the texts of its cells.
    title
        A line above the table; empty for a table without a title.
    """

    columns: tuple[ScreenColumn, ...]
    rows: tuple[Names, ...]
    title: str = ""

    def __post_init__(self) -> None:
        """Check that each row has one text for each column."""
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(
                    f"the row {row} has {len(row)} cells, the table has "
                    f"{len(self.columns)} columns"
                )

    @classmethod
    def from_json(cls, entries: Mapping[str, Any]) -> Self:
        """Return a table from the data of `dataclasses.asdict` that JSON has stored."""
        return cls(
            columns=tuple(ScreenColumn(**column) for column in entries["columns"]),
            rows=tuple(tuple(row) for row in entries["rows"]),
            title=entries["title"],
        )


def row_sentences(table: ScreenTable) -> list[str]:
    """Return each row as a text with the headings of its cells."""
    headings = [column.heading for column in table.columns]
    return [
        ", ".join(f"{heading} {cell}" for heading, cell in zip(headings, row, strict=True))
        for row in table.rows
    ]
