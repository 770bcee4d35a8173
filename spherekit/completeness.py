"""Statements of how complete a result is, and what may be missing in it."""

from dataclasses import dataclass
from enum import Enum

import numpy as np


class Guarantee(Enum):
    """How complete a set of configurations, curves or points is, the best level first.

    Only the first level is proven. The others rest on checks with rounded numbers. A result
    that fails a check has a lower level.
    """

    CERTIFIED = "certified"
    """Nothing is missing. This is proven for the mechanism as its file is written."""
    COMPLETE = "complete"
    """Nothing is missing. The total number is known and was checked."""
    TO_BOX = "complete to a box size"
    """Parts of the result that fit into a small box of angles may be missing.

    A box is a small range of each angle, for example of each input. All larger parts were
    found.
    """
    COMPONENT = "component only"
    """Everything connected to what was found is there. Separate parts may be missing."""
    SAMPLED = "sampled"
    """Only what samples or random starts reached is there."""


@dataclass(frozen=True)
class Completeness:
    """States whether a result may have missed something, and why.

    An example of a result is the set of all configurations at an input.

    Attributes
    ----------
    guarantee
        Level of completeness: whether a part may be missing, and which.
    reason
        Reason in words.
    box
        Width (rad) of a box of angles, such as the inputs, at the level `TO_BOX`. A part of
        the result that fits into a box may be missing. All larger parts were found. The
        width is 0 at other levels.
    sentence
        The statement in a whole sentence for users, empty if it follows from the level.
    """

    guarantee: Guarantee
    reason: str
    box: float = 0.0
    sentence: str = ""

    def __str__(self) -> str:
        level = self.guarantee.value
        if self.guarantee is Guarantee.TO_BOX:
            level = f"complete to a box of {np.degrees(self.box):.3g} deg"
        return f"{level}: {self.reason}"
