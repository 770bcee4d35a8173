"""What a search may spend, and what it says of itself while it goes on."""

import time
from typing import final

from spherekit.progress import Working


@final
class Budget:
    """Processor time (s) that a search may take from now on; without a limit by default.

    A search does what is worth most first, until the time is spent. Then it ends with what
    it has, and `note` says how much of it that is. `what` names the search.
    """

    def __init__(self, seconds: float = float("inf"), what: str = "search") -> None:
        self.seconds, self.what = seconds, what
        self._started = time.process_time()
        self._note = ""
        self._working = Working(what)

    @property
    def taken(self) -> float:
        """The processor time (s) taken until now."""
        return time.process_time() - self._started

    def part(self, share: float, what: str | None = None) -> "Budget":
        """Return a budget of a share of what is left, for the same or another search."""
        part = Budget(max(0.0, share * (self.seconds - self.taken)), what or self.what)
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
        if self.seconds:
            ended = f"stopped after {self.seconds:.3g} s of processor time"
        else:
            ended = "no processor time was left"
        self._note = f"{ended} before {doing}"
        return False

    def tell(self, doing: str) -> None:
        """Tell what is being done now, if it is time for that."""
        self._working.tell(lambda: f"{doing}, {self.taken:.0f} s")

    @property
    def note(self) -> str:
        """What was not done in words, or nothing."""
        return self._note
