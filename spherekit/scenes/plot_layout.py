"""What range of values a plot shows, and where labels go so that none hides another."""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.geometry.vectors import max_abs, nans
from spherekit.scenes.scene import Range

LONELY = {"curves": 16.0, "colours": 5.0}
"""Values so many times farther apart than the `INNER` ones leave the range: a curve that
is cut can be followed, of colours the others would keep too few."""
INNER = (0.1, 0.9)
"""Quantiles; the range then reaches as far beyond these as they are apart."""
AROUND = 0.05
"""Half the range about what does not change, over its scale."""
MARGIN = 0.05
"""Between curves and their frame, over the range."""
MOST_KINDS = 5
"""With more names of marks each is written beside its mark, and not in the legend."""
DIMENSIONAL = ("kg", "N", "W", "J", "m")
"""Parts of units of quantities that may be as small as a mechanism is."""
MAP_RESOLUTION = 1e-6
"""Of values on the sphere or a surface, which are solved for places and not rows."""
TURNS = {"deg": 360.0, "rad": 2.0 * np.pi}


def scale_of(values: Floats, unit: str) -> float:
    """Return the scale of a quantity: the largest number, at least one of angles and rates.

    Their size says whether they are noise, that of a torque or an inertia does not.
    """
    largest = float(max_abs(values[np.isfinite(values)]))
    return largest if any(part in unit for part in DIMENSIONAL) else max(largest, 1.0)


def plotted_range(
    values: Floats,
    scale: float,
    resolution: float = 1e-9,
    shown_by: Literal["curves", "colours"] = "curves",
) -> Range:
    """Return the least and greatest value that a plot of values (n,) shows.

    Changes below the `resolution`, over the scale of the quantity, are rounding. About
    curves there is a margin.
    """
    finite = values[np.isfinite(values)]
    if not len(finite):
        return 0.0, 1.0
    low = np.min(finite)
    high = np.max(finite)
    if high - low <= resolution * scale:
        middle = 0.5 * (low + high)
        half = AROUND * max(abs(middle), scale) or 1.0
        return middle - half, middle + half
    inner, outer = np.quantile(finite, INNER)
    reach = outer - inner
    if 0.0 < LONELY[shown_by] * reach < high - low:
        low = max(low, inner - reach)
        high = min(high, outer + reach)
    margin = MARGIN * (high - low) if shown_by == "curves" else 0.0
    return low - margin, high + margin


def map_range(values: Floats, unit: str) -> Range:
    """Return the least and greatest value that the colours of a map of values (n,) show.

    Whole numbers are counts: their colours begin at zero.
    """
    finite = values[np.isfinite(values)]
    if np.all(finite == np.round(finite)):
        return np.min(finite, initial=0.0), np.max(finite, initial=1.0)
    return plotted_range(finite, scale_of(finite, unit), MAP_RESOLUTION, "colours")


def parted(line: Floats, gaps: Bools) -> Floats:
    """Return points (n, k) with NaN between two where there is a gap (n - 1,)."""
    return np.insert(line, np.flatnonzero(gaps) + 1, np.nan, axis=0)


def broken(line: Floats, frame: Range, turn: float | None) -> Floats:
    """Return points (n, 2) with a gap (NaN) where the curve is not what a stroke says.

    There it passes from one side of the frame to the other through infinity, or y or x
    jump by half a `turn` or more.
    """
    y = line[:, 1]
    side = np.sign(y - np.clip(y, *frame))
    gap = side[1:] * side[:-1] < 0.0
    if turn is not None:
        gap |= np.abs(np.diff(y)) >= 0.5 * turn
    return parted(line, gap)


def cut(line: Floats, frame: Range) -> Floats:
    """Return points (n, 2) that end where the curve leaves the frame, NaN beyond it."""
    for level in frame:
        above = line[:, 1] - level
        places = np.flatnonzero(above[:-1] * above[1:] < 0.0)
        part = above[places] / (above[places] - above[places + 1])
        x = line[places, 0] + part * (line[places + 1, 0] - line[places, 0])
        line = np.insert(line, places + 1, np.stack([x, np.full_like(x, level)], 1), axis=0)
    y = line[:, 1:]
    return np.where(y == np.clip(y, *frame), line, np.nan)


WAYS = np.radians([45, 135, 0, -45, 90, -90, -135, 180])
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
    middles = nans(places.shape)
    reach, turn = (grid.ravel() for grid in np.meshgrid(REACHES, WAYS, indexing="ij"))
    way = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    for k, text in enumerate(texts):
        half = letter * np.array([ASPECT * len(text) + 0.1, 0.5])
        size = letter * reach[:, None] + np.array([half[0] - 0.5 * letter, 0.0])
        around = places[:, None, k] + way * size
        covers = np.zeros(around.shape[:2], dtype=bool)
        for place, other in taken:
            covers |= np.all(np.abs(around - place[:, None]) < half + other, axis=2)
        best = np.argmin(covers, axis=1)
        middles[:, k] = around[np.arange(len(best)), best]
        taken.append((middles[:, k], half))
    return middles
