"""What a conformance check found: one named line for each thing that it looks at."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, final

Verdict = Literal["holds", "FAILS", "not checked"]


@final
@dataclass(frozen=True)
class Line:
    """One check: what it asks, whether that holds, and what was seen."""

    name: str
    verdict: Verdict
    note: str = ""

    def __str__(self) -> str:
        return f"{self.name:12s} {self.verdict:12s} {self.note}".rstrip()


@final
@dataclass(frozen=True)
class Report:
    """The lines of a conformance check, in the order in which they were looked at."""

    analysis: str
    lines: tuple[Line, ...]

    @property
    def failing(self) -> tuple[Line, ...]:
        """The lines that do not hold."""
        return tuple(line for line in self.lines if line.verdict == "FAILS")

    def __iter__(self) -> Iterator[Line]:
        return iter(self.lines)

    def __getitem__(self, name: str) -> Line:
        return {line.name: line for line in self.lines}[name]

    def __str__(self) -> str:
        return "\n".join([f"conformance of {self.analysis}:", *map(str, self.lines)])
