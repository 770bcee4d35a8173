"""Limits of an output: read from text, and how poses fare under them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.plugin import AnalysisError, Floats
from spherekit.plugin.workspace import (
    AngleLimit,
    AxesLimit,
    ClosedKinematics,
    DirectionWorkspace,
    Judged,
    OrientationWorkspace,
    PairLimit,
    judge,
)

UNDEFINED = "the output is not determined"
"""Name of a border where no bound is 0."""


@final
@dataclass(frozen=True)
class Limited:
    """An output under limits of angles."""

    kinematics: ClosedKinematics
    bounds: Sequence[AngleLimit]

    @property
    def names(self) -> list[str]:
        """Names of the limits by their numbers, with that of none."""
        return [bound.name for bound in self.bounds] + [UNDEFINED]

    def judge(
        self, item: DirectionWorkspace | OrientationWorkspace, places: Floats
    ) -> Judged:
        """Return how places (n, 3) or (n, 4) fare in the working mode of a workspace."""
        return judge(self.kinematics, self.bounds, item.signs, places)


def read_limit(text: str) -> PairLimit:
    """Return the limits of a pair from ``PAIR:LOW:HIGH`` in degrees."""
    pair, *limits = text.split(":")
    if len(limits) == 2:
        low, high = (_degrees("limits", text, limit) for limit in limits)
        return PairLimit(pair, low, high)
    raise AnalysisError(
        f'workspace: limits: "{text}" is not PAIR:LOW:HIGH, with both in degrees'
    )


def read_apart(text: str) -> AxesLimit:
    """Return limits from ``PAIR/PAIR:LEAST`` or ``PAIR/PAIR:LEAST:GREATEST``."""
    axes, *limits = text.split(":")
    one, _, other = axes.partition("/")
    if other and len(limits) in (1, 2):
        return AxesLimit(one, other, *(_degrees("apart", text, limit) for limit in limits))
    raise AnalysisError(
        f'workspace: apart: "{text}" is not PAIR/PAIR:LEAST or PAIR/PAIR:LEAST:GREATEST, '
        "with angles in degrees"
    )


def _degrees(what: str, text: str, number: str) -> float:
    try:
        return float(np.radians(float(number)))
    except ValueError:
        raise AnalysisError(
            f'workspace: {what}: "{number}" in "{text}" is not a number of degrees'
        ) from None
