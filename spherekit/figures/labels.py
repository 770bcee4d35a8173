"""Where labels of points go so that none covers another."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

TURNS = np.radians([45, 135, 0, -45, 90, -90, -135, 180])
REACHES = (1.35, 1.9, 2.6, 3.5)
"""How far from its point a label is looked for, in sizes of its letters."""
ASPECT = 0.31
"""Half the width of a letter over the size of letters."""


def placed_labels(texts: Sequence[str], places: Floats, letter: float) -> Floats:
    """Return where the middle of each text goes: near its point, none over another.

    `places` (n, 2) and the size of a `letter` are in the same unit. Each text takes the
    nearest free place of a few around its point; where there is none it takes the nearest.
    """
    half_dot = 0.4 * letter
    taken = [
        (x - half_dot, y - half_dot, x + half_dot, y + half_dot) for x, y in places.tolist()
    ]
    found = np.zeros((len(texts), 2))
    for k, (text, place) in enumerate(zip(texts, places, strict=True)):
        half = np.array([ASPECT * letter * len(text) + 0.1 * letter, 0.5 * letter])
        around = [
            place
            + np.array([np.cos(turn), np.sin(turn)])
            * (reach * letter + np.array([half[0] - 0.5 * letter, 0.0]))
            for reach in REACHES
            for turn in TURNS
        ]
        boxes = [(*(at - half), *(at + half)) for at in around]
        free = [n for n, box in enumerate(boxes) if not any(_meet(box, o) for o in taken)]
        best = free[0] if free else 0
        found[k] = around[best]
        taken.append(boxes[best])
    return found


def _meet(one: Sequence[float], other: Sequence[float]) -> bool:
    return (
        one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]
    )
