"""The range of values that a plot shows, and positions of labels that hide no other."""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.geometry.vectors import max_abs, nans
from spherekit.scenes.scene import Range

OUTLIER_RATIOS = {"curves": 16.0, "colours": 5.0}
"""Ratio of the extent of all values to the inner extent above which outliers are cut off.

A curve that is cut off can still be followed. Of colours, the inner values would keep too
few. Larger: outliers compress the rest of the plot more. Smaller: more values are cut off.
"""

INNER_QUANTILES = (0.1, 0.9)
"""Quantiles between which values count as inner values.

A cut range exceeds these quantiles by as much as they are apart.
"""

CONSTANT_HALF_RANGE = 0.05
"""Half the range about values that do not change, over their scale.

Larger: constants look flatter. Smaller: rounding becomes visible.
"""

PLOT_MARGIN = 0.05
"""Margin between curves and their frame, over the range of values."""

MAX_LEGEND_KINDS = 5
"""Number of names of marks beyond which each is written beside its mark.

With fewer names, marks are explained by the legend.
"""

DIMENSIONAL_UNITS = ("kg", "N", "W", "J", "m")
"""Parts of units of quantities that may be as small as a mechanism is."""

MAP_RESOLUTION = 1e-6
"""Change, over the scale, below which values on the sphere or on a surface are constant.

Such values come from solutions at single points, and are less accurate than rows of a run.
"""

TURN_BY_UNIT = {"deg": 360.0, "rad": 2.0 * np.pi}
"""A whole turn in units of angles."""


def quantity_scale(values: Floats, unit: str) -> float:
    """Return the scale of a quantity, relative to which a plot recognises rounding errors.

    The scale is the largest magnitude. For angles, rates and pure numbers it is at least 1,
    since smaller values may be rounding errors. Other quantities, such as torques and
    inertias, are small if the mechanism is small. Their scale has no such limit.

    Parameters
    ----------
    values
        Values of the quantity.
    unit
        Its unit. A unit with kg, N, W, J or m in it belongs to one of the other quantities.
    """
    largest = float(max_abs(values[np.isfinite(values)]))
    is_dimensional = any(part in unit for part in DIMENSIONAL_UNITS)
    return largest if is_dimensional else max(largest, 1.0)


def choose_plot_range(
    values: Floats,
    scale: float,
    resolution: float = 1e-9,
    shown_by: Literal["curves", "colours"] = "curves",
) -> Range:
    """Return the least and the greatest value that a plot shows.

    A constant quantity gets a range in which rounding errors are not visible. A few values
    that are very far from the rest, for example near a singularity, are cut off, unless the
    rest is constant.

    Parameters
    ----------
    values
        (n,) values, NaN where there is none.
    scale
        Largest magnitude of the quantity, or more; see `quantity_scale`.
    resolution
        Changes below `resolution` times `scale` count as rounding errors.
    shown_by
        Whether values are shown by curves, which get a margin, or by colours.
    """
    finite = values[np.isfinite(values)]
    if not len(finite):
        return 0.0, 1.0
    low = np.min(finite)
    high = np.max(finite)
    if high - low <= resolution * scale:
        # A constant: show a range around it in which rounding is not visible.
        middle = 0.5 * (low + high)
        half = CONSTANT_HALF_RANGE * max(abs(middle), scale) or 1.0
        return middle - half, middle + half
    # Inner values are between two quantiles. If all values extend much farther, only a
    # range about the inner values is shown.
    inner_low, inner_high = np.quantile(finite, INNER_QUANTILES)
    inner_extent = inner_high - inner_low
    # Inner values that differ by rounding only are no range. Their rounding errors are
    # compared with the largest inner value. The scale of all values may be huge because of
    # an outlier near a singularity. It counts only up to 1, the least scale of angles.
    inner_scale = max(abs(inner_low), abs(inner_high), min(scale, 1.0))
    has_inner_range = inner_extent > resolution * inner_scale
    if has_inner_range and OUTLIER_RATIOS[shown_by] * inner_extent < high - low:
        low = max(low, inner_low - inner_extent)
        high = min(high, inner_high + inner_extent)
    margin = PLOT_MARGIN * (high - low) if shown_by == "curves" else 0.0
    return low - margin, high + margin


def choose_map_range(values: Floats, unit: str) -> Range:
    """Return the least and the greatest value that the colours of a map show.

    Whole numbers are taken for counts, and their range contains 0 and 1. Other values get a
    range without outliers, in which rounding errors are not visible.

    Parameters
    ----------
    values
        (n,) values, NaN where there is none.
    unit
        Unit of the values.
    """
    finite = values[np.isfinite(values)]
    # `initial` extends the range to 0 and 1, also if there are no values.
    if np.all(finite == np.round(finite)):
        return np.min(finite, initial=0.0), np.max(finite, initial=1.0)
    scale = quantity_scale(finite, unit)
    return choose_plot_range(finite, scale, MAP_RESOLUTION, "colours")


def insert_gaps(line: Floats, gaps: Bools) -> Floats:
    """Return the points of a line, with a point of NaN in each gap of the line.

    Plotting libraries draw no line through NaN.

    Parameters
    ----------
    line
        (n, k) points.
    gaps
        (n - 1,) whether the line is interrupted between a point and the next one.
    """
    return np.insert(line, np.flatnonzero(gaps) + 1, np.nan, axis=0)


def break_at_jumps(line: Floats, frame: Range, turn: float | None) -> Floats:
    """Return points of a curve with gaps (NaN) where it should not be drawn continuously.

    There are two reasons for a gap between two points. One is that the curve passes through
    infinity: one point is above the frame of the plot, and the other one below. The other
    is that an angle jumps by half a turn or more.

    Parameters
    ----------
    line
        (n, 2) x and y of the points of the curve.
    frame
        Least and greatest y of the plot.
    turn
        A whole turn in the unit of y, None if y is not an angle.
    """
    y = line[:, 1]
    # -1 below the frame, 1 above it, 0 inside.
    side = np.sign(y - np.clip(y, *frame))
    has_gap = side[1:] * side[:-1] < 0.0
    if turn is not None:
        has_gap |= np.abs(np.diff(y)) >= 0.5 * turn
    return insert_gaps(line, has_gap)


def clip_to_frame(line: Floats, frame: Range) -> Floats:
    """Cut a curve off at the lower and upper side of the frame of a plot.

    Parameters
    ----------
    line
        (n, 2) x and y of points of the curve.
    frame
        Least and greatest y of the plot.

    Returns
    -------
    (m, 2) points of the curve. The points at which the curve crosses a side are added.
    Points beyond the frame are NaN.
    """
    for level in frame:  # the lower and the upper side of the frame
        # Insert the points at which the lines between points cross this side.
        height = line[:, 1] - level
        starts = np.flatnonzero(height[:-1] * height[1:] < 0.0)
        # The position of the crossing as a fraction of the line, by interpolation.
        ratio = height[starts] / (height[starts] - height[starts + 1])
        x = line[starts, 0] + ratio * (line[starts + 1, 0] - line[starts, 0])
        crossings = np.stack([x, np.full_like(x, level)], 1)
        line = np.insert(line, starts + 1, crossings, axis=0)
    y = line[:, 1:]
    return np.where(y == np.clip(y, *frame), line, np.nan)


LABEL_DIRECTIONS_RAD = np.radians([45, 135, 0, -45, 90, -90, -135, 180])
"""Directions (rad) from its point in which a label is tried, the preferred one first."""

LABEL_DISTANCES = np.array([1.35, 1.9, 2.6, 3.5])
"""Distances from its point at which a label is tried, over the size of its letters."""

LETTER_HALF_WIDTH_RATIO = 0.31
"""Half the width of a letter, over the size of letters."""

DOT_HALF_WIDTH = 0.4
"""Half the width of a point's dot, over the size of letters."""


def place_labels(
    texts: Sequence[str],
    places: Floats,
    letter: float,
    curve_points: Floats | None = None,
    frame: tuple[Floats, Floats] | None = None,
) -> Floats:
    """Return positions of labels near their points, where they hide nothing if possible.

    For each label a few positions around its point are tried, the nearest first. Positions
    within the frame at which the label overlaps neither a point nor an earlier label are
    preferred. Among them, the position at which the label covers the fewest points of
    curves is chosen. If several positions are equally good, the nearest is chosen.

    Parameters
    ----------
    texts
        The labels of k points.
    places
        (n, k, 2) positions of the points in n pictures, NaN for no point.
    letter
        Size of the letters in the unit of `places`.
    curve_points
        (m, 2) points on curves that labels should not cover, the same in all pictures.
        Neighbouring points have to be closer together than the size of a letter.
    frame
        The lower left and the upper right corner of the picture, each (2,).

    Returns
    -------
    (n, k, 2) positions of the middles of the labels.
    """
    dot_half_size = np.full(2, DOT_HALF_WIDTH * letter)
    # Rectangles that are occupied: middles (n, 2), and half width and half height.
    occupied = [(points, dot_half_size) for points in np.moveaxis(places, 1, 0)]
    middles = nans(places.shape)
    # All positions around a point: distances in rows, directions in columns.
    distances, angles = (
        grid.ravel()
        for grid in np.meshgrid(LABEL_DISTANCES, LABEL_DIRECTIONS_RAD, indexing="ij")
    )
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    for number, text in enumerate(texts):
        # Half width, with a margin of 0.1 letters, and half height.
        half_size = letter * np.array([LETTER_HALF_WIDTH_RATIO * len(text) + 0.1, 0.5])
        # Offsets of a label's middle from its point. For a label as wide as high they would
        # be on circles. For wider labels they are on ellipses: the half width beyond that
        # is added in the x direction, so that the label does not cover its point.
        extra_width = np.array([half_size[0] - 0.5 * letter, 0.0])
        offsets = directions * (letter * distances[:, None] + extra_width)
        # (n, candidates, 2) positions of the label, and which of them overlap anything.
        candidates = places[:, None, number] + offsets
        hides_another = np.zeros(candidates.shape[:2], dtype=bool)
        for middle, occupied_half_size in occupied:
            # Rectangles overlap if their middles are nearer than their half sizes together.
            separation = np.abs(candidates - middle[:, None])
            hides_another |= np.all(separation < half_size + occupied_half_size, axis=2)
        # The cost of a candidate counts what the label hides there. The first candidate
        # with the lowest cost is taken.
        cost = np.zeros(candidates.shape[:2])
        if curve_points is not None and len(curve_points):
            distances_from_curves = np.abs(candidates[:, :, None] - curve_points)
            cost += np.sum(np.all(distances_from_curves < half_size, axis=3), axis=2)
            # A label that covers another one is worse than any that covers curves.
            hides_another_cost = len(curve_points) + 1.0
        else:
            hides_another_cost = 1.0
        cost += hides_another_cost * hides_another
        if frame is not None:
            low, high = frame
            is_outside = np.any(
                (candidates - half_size < low) | (candidates + half_size > high), axis=2
            )
            cost += hides_another_cost * is_outside
        best = np.argmin(cost, axis=1)
        middles[:, number] = candidates[np.arange(len(best)), best]
        occupied.append((middles[:, number], half_size))
    return middles
