"""What a check notes: comparisons made, findings, and analyses that refuse."""

from dataclasses import dataclass, field
from enum import Enum
from typing import final


class Kind(Enum):
    """How bad a finding is."""

    CONTRADICTION = "contradicts"
    """Two analyses, or an analysis and its own words, cannot both be right."""
    FAULT = "faults"
    """An error that is none of the project's own, or a warning of NumPy that leaks."""
    SILENT = "silent"
    """A table is empty, a unit or a claim is missing, and nothing says so."""
    LATE = "late"
    """The time of a check was up."""
    SHORT = "not found"
    """Something exists that a search missed, and its claim says that this may be."""


HARMLESS = (Kind.SHORT,)
"""Kinds that no claim contradicts."""


@final
@dataclass(frozen=True)
class Finding:
    """What is wrong, in words that hold the place and the figures."""

    check: str
    kind: Kind
    what: str


@final
@dataclass
class Notes:
    """What one check notes of one mechanism, and the processor time it took.

    `finished` is False where it was ended; `most` findings are kept.
    """

    check: str
    compared: int = 0
    findings: list[Finding] = field(default_factory=list)
    refused: list[str] = field(default_factory=list)
    most: int = 5
    seconds: float = 0.0
    finished: bool = False

    def judged(self, count: int = 1) -> None:
        """Note that so many values were compared."""
        self.compared += int(count)

    def found(self, what: str, kind: Kind = Kind.CONTRADICTION) -> None:
        """Note a finding; of many of one check the first few are kept."""
        if len(self.findings) < self.most:
            self.findings.append(Finding(self.check, kind, what))

    def contradiction(self, wrong: bool, what: str) -> None:
        """Note one comparison, and a contradiction if it is wrong."""
        self.judged()
        if wrong:
            self.found(what)

    @property
    def contradictions(self) -> int:
        """How many findings no claim covers."""
        return sum(each.kind not in HARMLESS for each in self.findings)
