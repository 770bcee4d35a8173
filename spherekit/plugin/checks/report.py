"""The report of a conformance check: one line for each check."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

Verdict = Literal["holds", "FAILS", "not checked"]


class NotApplicableError(Exception):
    """A check does not apply; the message says why."""


@dataclass(frozen=True)
class Line:
    """One check: its name, its verdict, and what was seen."""

    name: str
    verdict: Verdict
    note: str = ""

    def __str__(self) -> str:
        return f"{self.name:12s} {self.verdict:12s} {self.note}".rstrip()


@dataclass(frozen=True)
class Report:
    """The result of checking an analysis (plugin): one line for each check.

    Attributes
    ----------
    analysis
        Name of the class, or the text that named the analysis.
    lines
        The lines, in the order of the checks. ``report["blocks"]`` is the line of the check
        with the name "blocks".
    """

    analysis: str
    lines: tuple[Line, ...]

    @property
    def failing(self) -> tuple[Line, ...]:
        """The lines of checks that failed."""
        return tuple(line for line in self.lines if line.verdict == "FAILS")

    def __iter__(self) -> Iterator[Line]:
        return iter(self.lines)

    def __getitem__(self, name: str) -> Line:
        return {line.name: line for line in self.lines}[name]

    def __str__(self) -> str:
        return "\n".join([f"conformance of {self.analysis}:", *map(str, self.lines)])
