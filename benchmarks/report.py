"""A section of results and its Markdown."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

Cell = str | int | float | None


@final
@dataclass(frozen=True)
class Section:
    """A heading, sentences, and a table of text and numbers."""

    title: str
    text: str
    columns: tuple[str, ...]
    rows: Sequence[tuple[Cell, ...]]
    conclusion: str = ""


def markdown(section: Section) -> str:
    """Return a section as Markdown; numbers have three digits."""
    lines = [f"## {section.title}", "", section.text, ""]
    lines.append("| " + " | ".join(section.columns) + " |")
    numeric = [
        all(not isinstance(row[k], str) for row in section.rows)
        for k in range(len(section.columns))
    ]
    lines.append("|" + "|".join("---:" if right else "---" for right in numeric) + "|")
    lines += ["| " + " | ".join(map(shown, row)) + " |" for row in section.rows]
    if section.conclusion:
        lines += ["", section.conclusion]
    return "\n".join(lines)


def shown(cell: Cell) -> str:
    """Return a cell as text."""
    if cell is None:
        return "-"
    if not isinstance(cell, float):
        return str(cell)
    if abs(cell) >= 1000:
        return f"{cell:.0f}"
    return f"{cell:.3g}"
