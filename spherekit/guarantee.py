"""What a result says about what it may have missed."""

from dataclasses import dataclass
from enum import Enum
from typing import final

import numpy as np


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


@final
@dataclass(frozen=True)
class Claim:
    """A guarantee, the size of the box (rad, 0 without one), and the reason in words."""

    guarantee: Guarantee
    reason: str
    box: float = 0.0

    def __str__(self) -> str:
        words = self.guarantee.value
        if self.guarantee is Guarantee.TO_BOX:
            words = f"complete to a box of {np.degrees(self.box):.3g} deg"
        return f"{words}: {self.reason}"
