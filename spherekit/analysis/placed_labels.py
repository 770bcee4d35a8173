"""Where labels of points in a plane go so that none covers another."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

TURNS = np.radians([45, 135, 0, -45, 90, -90, -135, 180])
REACHES = np.array([1.35, 1.9, 2.6, 3.5])
"""How far from its point a label is looked for, in sizes of its letters."""
ASPECT = 0.31
"""Half the width of a letter over the size of letters."""
DOT = 0.4
"""Half the width of a point's dot over the size of letters."""


def placed_labels(texts: Sequence[str], places: Floats, letter: float) -> Floats:
    """Return where the middles (n, k, 2) of texts go: near points, none over another.

    `places` (n, k, 2) are those of k points in n pictures, NaN where there is none, in
    the unit of the size of a `letter`. Each text takes the nearest free place of a few
    around its point; where there is none it takes the nearest.
    """
    dot = np.full(2, DOT * letter)
    taken = [(place, dot) for place in np.moveaxis(places, 1, 0)]
    middles = np.full(places.shape, np.nan)
    reach, turn = (grid.ravel() for grid in np.meshgrid(REACHES, TURNS, indexing="ij"))
    way = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    for k, text in enumerate(texts):
        half = letter * np.array([ASPECT * len(text) + 0.1, 0.5])
        size = letter * reach[:, None] + np.array([half[0] - 0.5 * letter, 0.0])
        around = places[:, None, k] + way * size
        covers = np.zeros(around.shape[:2], dtype=bool)
        for place, other in taken:
            covers |= np.all(np.abs(around - place[:, None]) < half + other, axis=2)
        best = np.argmin(covers, axis=1)
        middles[:, k] = np.take_along_axis(around, best[:, None, None], axis=1)[:, 0]
        taken.append((middles[:, k], half))
    return middles
