"""A check: what is asked, and the function that asks it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import final

from benchmarks.sceptic.evidence import Evidence
from benchmarks.sceptic.finding import Notes

Ask = Callable[[Evidence, Notes], None]


@final
@dataclass(frozen=True)
class Check:
    """A question to the analyses of a mechanism.

    `text` says in one sentence what has to hold. `ask` notes what it compares and what
    does not hold; it notes nothing where the question has no meaning.
    """

    name: str
    text: str
    ask: Ask


CHECKS: dict[str, Check] = {}
"""All checks by name, in the order in which they are made."""


def check(name: str, text: str) -> Callable[[Ask], Ask]:
    """Register a function as a check."""

    def register(ask: Ask) -> Ask:
        assert name not in CHECKS, name
        CHECKS[name] = Check(name, text, ask)
        return ask

    return register
