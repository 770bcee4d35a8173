"""A section of results and its Markdown."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

Cell = str | int | float | None


@final
@dataclass(frozen=True)
class Section:
    """A heading, sentences, and a table of text and numbers.

    The first `keys` columns say what a row is about. `ratios` are the columns that hold
    from machine to machine: they come next, and are kept over time.
    """

    title: str
    text: str
    columns: tuple[str, ...]
    rows: Sequence[tuple[Cell, ...]]
    conclusion: str = ""
    ratios: tuple[str, ...] = ()
    keys: int = 1

    @property
    def order(self) -> list[int]:
        """The numbers of the columns as they are shown: keys, ratios, then the rest."""
        every = range(len(self.columns))
        return sorted(every, key=lambda k: (k >= self.keys, not self._is_ratio(k), k))

    def figures(self) -> dict[str, float]:
        """Return every ratio by the key of its row and the name of its column."""
        found: dict[str, float] = {}
        for row in self.rows:
            key = " ".join(shown(cell) for cell in row[: self.keys])
            for k, cell in enumerate(row):
                if self._is_ratio(k) and cell is not None:
                    name = f"{key} | {self.columns[k]}"
                    while name in found:
                        name += "'"
                    found[name] = float(cell)
        return found

    def _is_ratio(self, column: int) -> bool:
        return self.columns[column] in self.ratios


def markdown(section: Section, commit: str | None = None) -> str:
    """Return a section taken at a commit as Markdown; numbers have three digits."""
    lines = [f"## {section.title}", "", section.text, ""]
    if commit:
        lines += [f"Taken at commit {commit}.", ""]
    order = section.order
    lines.append("| " + " | ".join(section.columns[k] for k in order) + " |")
    numeric = [all(not isinstance(row[k], str) for row in section.rows) for k in order]
    lines.append("|" + "|".join("---:" if right else "---" for right in numeric) + "|")
    lines += [
        "| " + " | ".join(shown(row[k]) for k in order) + " |" for row in section.rows
    ]
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
