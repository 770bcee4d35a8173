"""What is tried when settings are measured, and how long."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, final

from spherekit.analysis.running.setting import Setting
from spherekit.checked import check_fields
from spherekit.errors import AnalysisError

ROUNDS = 5
"""Times every setting is run, each round in another order; the best counts."""


@final
@dataclass(frozen=True)
class Effort:
    """What is tried when settings are measured, and how long.

    `settings` are those to try; by default all that apply to samples, or to a simulation.
    Errors are measured at most at `checked` samples. Each setting is run in so many
    `rounds` for its time, and after `budget` seconds no round begins.
    """

    unused: ClassVar[tuple[str, ...]] = ("tolerance", "verify", "degrees")

    settings: Sequence[Setting] | None = None
    checked: int | None = None
    rounds: int = ROUNDS
    budget: float = 30.0

    def __post_init__(self) -> None:
        check_fields(self, AnalysisError, "trade")
