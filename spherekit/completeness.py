"""What a result says about what it may have missed.

What a search may spend, and what it says of itself while it goes on.
"""

import time
from dataclasses import dataclass
from enum import Enum

import numpy as np

from spherekit.progress import ProgressReporter


class Guarantee(Enum):
    """How complete a set of configurations, curves or points is; the best first.

    Only the first is proven. For the others counts, degrees, residuals and errors of
    interpolants are checked in floating point, and what fails a check claims less.
    """

    CERTIFIED = "certified"
    """Everything is there, and is proven for the mechanism as its file is written."""
    COMPLETE = "complete"
    """Everything is there: the number is known and was checked."""
    TO_BOX = "complete to a box size"
    """What extends over more than the box is there, what is smaller may be missing."""
    COMPONENT = "component only"
    """What is connected to what was found is there, other components may be missing."""
    SAMPLED = "sampled"
    """What samples or random starts met is there."""


@dataclass(frozen=True)
class Completeness:
    """A guarantee, the size of the box (rad, 0 without one), and the reason in words."""

    guarantee: Guarantee
    reason: str
    box: float = 0.0

    def __str__(self) -> str:
        words = self.guarantee.value
        if self.guarantee is Guarantee.TO_BOX:
            words = f"complete to a box of {np.degrees(self.box):.3g} deg"
        return f"{words}: {self.reason}"


class TimeLimit:
    """Processor time (s) that a search may take from now on; without a limit by default.

    A search does what is worth most first, until the time is spent. Then it ends with what
    it has, and `note` says how much of it that is. `what` names the search.
    """

    def __init__(self, seconds: float = float("inf"), what: str = "search") -> None:
        self.seconds, self.what = seconds, what
        self._started = time.process_time()
        self.note = ""
        """What was not done in words, or nothing."""
        self._working = ProgressReporter(what)

    @property
    def taken(self) -> float:
        """The processor time (s) taken until now."""
        return time.process_time() - self._started

    def part(self, share: float, what: str | None = None) -> "TimeLimit":
        """Return a budget of a share of what is left, for the same or another search."""
        part = TimeLimit(max(0.0, share * (self.seconds - self.taken)), what or self.what)
        if what is None:
            part._working = self._working
        return part

    def goes_on(self, doing: str) -> bool:
        """Return whether there is time left for the next step, and tell what it is.

        `doing` is words such as ``"slice 3 of 12"``.
        """
        self.tell(doing)
        if self.taken < self.seconds:
            return True
        self.note = f"stopped after {self.seconds:.3g} s of processor time before {doing}"
        return False

    def tell(self, doing: str) -> None:
        """Tell what is being done now, if it is time for that."""
        self._working.tell(lambda: f"{doing}, {self.taken:.0f} s")
