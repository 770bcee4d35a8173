"""Finds paths, in a plane or on the sphere, that hide each other.

Curves over a common axis are compared sample by sample in `curve_plots`. Paths are compared
as sets of points, since two modes often follow one path in different directions.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from spherekit.arrays import Floats
from spherekit.geometry.vectors import all_finite

DASH_WIDTHS = 5.0
"""Length of a dash of coinciding curves, in widths of their lines."""

COINCIDING_RATIO = 0.003
"""Largest distance of curves that coincide, relative to the size of the frame.

Larger: curves are dashed that can be told apart; smaller: one of two curves is hidden.
"""

COINCIDING_QUANTILE = 0.9
"""Fraction of the points of a curve that must be near another curve to coincide with it.

Points are near if their distance is below `COINCIDING_RATIO`.

Single rows may be farther away, such as the rows at a jump.
"""

MAX_COMPARED_POINTS = 200
"""Largest number of points of a path whose distances from another path are computed."""


class DashPosition(NamedTuple):
    """The number of drawn curves that coincide, and the position of one curve among them.

    Coinciding curves get different dashes, so that all can be seen.
    """

    position: int
    curve_count: int

    @property
    def linestyle(self) -> Any:
        """The line style for matplotlib of one of several curves that coincide.

        The first curve keeps the line style of its look (None). The others are drawn over
        it in dashes, each at another offset, so that all colours are visible.
        """
        if not self.position:
            return None
        offset = DASH_WIDTHS * self.position
        gap = DASH_WIDTHS * (self.curve_count - 1)
        return (offset, (DASH_WIDTHS, gap))


def dash_positions(leaders: Sequence[int]) -> list[DashPosition]:
    """Return for each curve its position among the curves that coincide with it.

    Curves that coincide are drawn with dashes side by side.

    Parameters
    ----------
    leaders
        For each curve the index of the first curve that coincides with it. For a curve
        without an earlier coinciding curve, its own index.
    """
    return [
        DashPosition(
            position=leaders[:curve].count(leader), curve_count=leaders.count(leader)
        )
        for curve, leader in enumerate(leaders)
    ]


def find_coinciding_paths(paths: Sequence[Floats], size: float) -> list[DashPosition]:
    """Return for each drawn path its position among the paths that coincide with it.

    Paths at different positions get different dashes, so that none hides another. Two
    paths coincide if nearly all points of at least one of them are on the other path, up to
    the thickness of a line. The first of several coinciding paths is their leader.

    Parameters
    ----------
    paths
        (n, k) n points of each path with k coordinates, NaN in gaps.
    size
        Size of the frame of the drawing, in the unit of the points.
    """
    # For each path so far its leader: the first path that coincides with it, or itself.
    leaders: list[int] = []
    for number, path in enumerate(paths):
        leader = number
        for earlier_number in range(number):
            is_leader = leaders[earlier_number] == earlier_number
            earlier_path = paths[earlier_number]
            # Paths are compared with leaders only.
            if is_leader and (
                _lies_on(path, earlier_path, size) or _lies_on(earlier_path, path, size)
            ):
                leader = earlier_number
                break
        leaders.append(leader)
    return dash_positions(leaders)


def _lies_on(path: Floats, other_path: Floats, size: float) -> bool:
    """Return whether nearly all points of a path are on another path.

    If so, one of the two paths would hide the other one, so the caller draws both with
    dashes.

    Parameters
    ----------
    path, other_path
        (n, k) n points with k coordinates, NaN in gaps. The other path consists of the
        straight segments between its points.
    size
        Size of the frame of the drawing, in the unit of the points. A point is on the other
        path if it is nearer than `COINCIDING_RATIO` times this size.
    """
    points = path[all_finite(path, 1)]
    starts = other_path[:-1]
    ends = other_path[1:]
    has_ends = all_finite(starts, 1) & all_finite(ends, 1)
    starts = starts[has_ends]
    ends = ends[has_ends]
    # A single point is drawn as a dot and hides no line.
    if len(points) < 2 or not len(starts):
        return False
    # Compare only some of the points, to save time.
    step = -(-len(points) // MAX_COMPARED_POINTS)  # rounded up
    points = points[::step]
    # For each point of the path the nearest point of each segment: the start of the segment
    # plus a fraction, from 0 to 1, of the segment.
    segments = ends - starts
    squared_lengths = np.vecdot(segments, segments)
    from_starts = points[:, None] - starts
    with np.errstate(divide="ignore", invalid="ignore"):
        parts = np.vecdot(from_starts, segments) / squared_lengths
    parts = np.clip(np.nan_to_num(parts), 0.0, 1.0)
    nearest_offsets = from_starts - parts[..., None] * segments
    distances = np.linalg.norm(nearest_offsets, axis=2).min(axis=1)
    return bool(np.quantile(distances, COINCIDING_QUANTILE) < COINCIDING_RATIO * size)
