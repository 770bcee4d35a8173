"""Points of the border of a region: where arcs leave it, and its corners."""

from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.geometry.region_margins import (
    RELATIVE_ROUNDING,
    MarginEvaluator,
    find_active_margins,
    select_margins,
    smallest_margins,
)
from spherekit.geometry.triangle import arc
from spherekit.geometry.vectors import cross, max_abs, unit_rows
from spherekit.numerics.bracketed_zeros import find_bracketed_zeros
from spherekit.numerics.least_squares import minimize_squares
from spherekit.tolerances import EPS

DIFFERENCE_STEP = 1e-6
"""Step of the differences that give the slopes of margins, as a part of the chord."""

STEP_BEYOND_BORDER = 1e-7
"""If the smallest margin is exactly 0 at a crossing, the margin that ends the region is
looked up this much farther along the edge, as a part of the edge."""

MAX_CORNER_DISTANCE = 4.0
"""A corner that is farther from the middle of its chord than this times the chord's arc,
along or across the chord, is rejected: it belongs to another part of the border."""

BORDER_TOLERANCE_FACTOR = 1e4
"""A point is on the border, or in the region, if no margin is negative by more than this
times its rounding error."""


def points_on_arcs(start: Floats, end: Floats, angle: Floats) -> Floats:
    """Return one point on each arc of a great circle, at an angle from its start.

    Parameters
    ----------
    start, end
        (n, 3) unit vectors, the ends of the arcs.
    angle
        (n,) angle (rad) of each point from the start of its arc.

    Returns
    -------
    (n, 3) unit vectors.
    """
    # `toward` is the unit tangent of the arc at its start. start x (end - start) equals
    # start x end, but is accurate also for short arcs.
    toward = unit_rows(cross(cross(start, end - start), start))
    return np.cos(angle)[:, None] * start + np.sin(angle)[:, None] * toward


@dataclass(frozen=True)
class ArcMargins:
    """Margins of a region along n arcs of great circles.

    Each arc leads from the inside of the region to the outside. The border of the region is
    found on it as the zero of the smallest margin.

    Attributes
    ----------
    evaluate
        The function that returns all k margins at directions. The region consists of the
        directions at which all margins are at least 0.
    inside, outside
        (n, 3) unit vectors, the ends of the arcs inside and outside the region.
    """

    evaluate: MarginEvaluator
    inside: Floats
    outside: Floats

    def margins(self, angle: Floats, arcs: Indices) -> Floats:
        """Return all margins (m, k) at angles (m,) rad from the inner ends of arcs (m,)."""
        return self.evaluate(points_on_arcs(self.inside[arcs], self.outside[arcs], angle))

    def smallest_margin(self, angle: Floats, arcs: Indices) -> Floats:
        """Return the smallest margin (m,) at angles (m,) from the inner ends of arcs."""
        return smallest_margins(self.margins(angle, arcs))


def find_crossings(
    evaluate: MarginEvaluator, inside: Floats, outside: Floats
) -> tuple[Floats, Indices]:
    """Return the points where arcs leave a region, and the margins that end it there.

    The region consists of the directions at which all margins (functions of the direction)
    are at least 0. Each arc of a great circle leaves the region at one point, a zero of the
    smallest margin. The margin that ends the region is the one that becomes negative there.

    Parameters
    ----------
    evaluate
        The function that returns all margins at directions.
    inside
        (n, 3) unit vectors, the ends of the arcs inside the region.
    outside
        (n, 3) unit vectors, the ends of the arcs outside the region.

    Returns
    -------
    points
        (n, 3) unit vectors on the border.
    margins
        (n,) indices of the margins; `UNDEFINED_MARGIN` if the region ends because a margin
        is NaN.
    """
    arc_margins = ArcMargins(evaluate, inside, outside)
    length = arc(inside, outside)
    # Angles (rad) from the inner end of each arc: the zero of the smallest margin, and the
    # outer end of the last search interval.
    crossing_angle, angle_outside = find_bracketed_zeros(
        arc_margins.smallest_margin,
        low=np.zeros(len(length)),
        high=length,
        values_at_low=smallest_margins(evaluate(inside)),
        values_at_high=smallest_margins(evaluate(outside)),
        tolerance=EPS,
    )
    # All margins are evaluated just beyond the border. The smallest one is negative there
    # and ends the region. Of margins that are equal up to rounding, the first counts.
    angle_beyond = _find_angles_beyond(arc_margins, length, crossing_angle, angle_outside)
    margins_beyond = arc_margins.margins(angle_beyond, np.arange(len(length)))
    return (
        points_on_arcs(inside, outside, crossing_angle),
        find_active_margins(margins_beyond, evaluate.rounding_errors),
    )


def _find_angles_beyond(
    arc_margins: ArcMargins, length: Floats, crossing_angle: Floats, angle_outside: Floats
) -> Floats:
    """Return angles (n,), rad, just beyond the points where arcs leave a region.

    Margins are functions that are at least 0 in the region. The margin that ends the region
    is negative just beyond the border, so the caller evaluates the margins there.

    On each arc, a search has narrowed an interval around the border until the interval was
    tiny. The outer end of the interval is just beyond the border. A search that met a
    margin of exactly 0 has stopped early. For such an arc, the angle is a small step beyond
    the crossing.

    Parameters
    ----------
    arc_margins
        Margins along the n arcs.
    length
        (n,) lengths (rad) of the arcs.
    crossing_angle
        (n,) angles (rad) from the start of the arcs to the border.
    angle_outside
        (n,) angles at the outer end of the last search interval.
    """
    margin_at_crossing = arc_margins.smallest_margin(crossing_angle, np.arange(len(length)))
    has_stopped_early = margin_at_crossing == 0.0
    one_step_beyond = crossing_angle + STEP_BEYOND_BORDER * length
    return np.where(has_stopped_early, one_step_beyond, angle_outside)


def find_corners(
    evaluate: MarginEvaluator, start: Floats, end: Floats, margins: Indices
) -> tuple[Floats, Bools]:
    """Return points near chords at which two margins are zero.

    The border of a region consists of arcs on which one of several functions, the margins,
    is zero. At a corner two of them are zero. The corner is found by least squares in the
    tangent plane at the middle of a chord between two points of the border. The slopes of
    the margins are computed as differences.

    Parameters
    ----------
    evaluate
        The margins.
    start, end
        (n, 3) unit vectors, the ends of the chords. The first margin is zero at the start,
        the second at the end.
    margins
        (n, 2) indices of these margins.

    Returns
    -------
    corners
        (n, 3) unit vectors.
    is_corner
        (n,) whether both margins are zero there, and the point is near the chord.
    """
    middle = unit_rows(start + end)
    length = arc(start, end)
    toward = unit_rows(cross(cross(start, end - start), middle))
    sizes = _margin_sizes(evaluate.rounding_errors)[margins]
    # Rows: the directions along and across each chord, as long as the chord.
    tangents = np.stack([toward, cross(middle, toward)], axis=1) * length[:, None, None]

    def points_at(x: Floats, chords: Indices) -> Floats:
        """Return points (k, m, 3) at tangent plane coordinates (k, m, 2) of k chords."""
        return unit_rows(x @ tangents[chords] + middle[chords, None])

    def residuals(x: Floats, chords: Indices) -> tuple[Floats, Floats]:
        """Return both margins (k, 2), relative to their sizes, and slopes (k, 2, 2)."""
        # Three points for each chord: x itself, and one step from it in each direction.
        stencil = x[:, None] + DIFFERENCE_STEP * np.eye(3, 2, -1)
        values = evaluate(points_at(stencil, chords).reshape(-1, 3))
        # The two margins of each chord at these points: axes chord, point, margin.
        first_numbers, second_numbers = np.repeat(margins[chords], 3, axis=0).T
        pair = np.stack(
            [select_margins(values, first_numbers), select_margins(values, second_numbers)],
            axis=1,
        )
        pair = pair.reshape(-1, 3, 2) / sizes[chords, None]
        slope = (pair[:, 1:] - pair[:, :1]) / DIFFERENCE_STEP
        return pair[:, 0], np.swapaxes(slope, 1, 2)

    x, squares = minimize_squares(
        residuals,
        start=np.zeros((len(start), 2)),
        low=-MAX_CORNER_DISTANCE,
        high=MAX_CORNER_DISTANCE,
    )
    is_corner = np.sqrt(squares) <= BORDER_TOLERANCE_FACTOR * RELATIVE_ROUNDING
    is_corner &= max_abs(x, axis=1) < MAX_CORNER_DISTANCE
    return points_at(x[:, None], np.arange(len(x)))[:, 0], is_corner


def _margin_sizes(rounding_errors: Floats) -> Floats:
    """Return a typical absolute value of each margin, called its size.

    A margin is a function that is at least 0 inside a region. Margins have different units.
    The caller divides them by their sizes before it minimises the sum of their squares.

    Parameters
    ----------
    rounding_errors
        (k,) rounding error of each margin, `RELATIVE_ROUNDING` times its size.

    Returns
    -------
    (k + 1,) sizes of the k margins, and of `UNDEFINED_MARGIN`, whose index is -1. A margin
    that is mostly 0 gets the size 1. `UNDEFINED_MARGIN` stands for the smallest of all
    margins, where NaN counts as a margin of -1. So the last size is the smallest of all
    others and 1.
    """
    sizes = rounding_errors / RELATIVE_ROUNDING
    sizes = np.where(sizes > 0.0, sizes, 1.0)
    return np.append(sizes, np.min(sizes, initial=1.0))
