"""Segments of the border of a region of directions: curves over chords, and their areas.

A chord is the arc of a great circle between two points of the border. Over it the border is
a curve of height h(u) (rad), the angle from the chord towards the region, which is to the
left. The parameter u runs from -1 to 1 along the chord. The area between chord and border
is the integral of sin(h) over the arc of the chord, without approximation.
"""

from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np
from numpy.polynomial import chebyshev

from spherekit.arrays import Bools, Floats, Indices
from spherekit.geometry.border_point import BORDER_TOLERANCE_FACTOR
from spherekit.geometry.region_margins import (
    UNDEFINED_MARGIN,
    MarginEvaluator,
    select_margins,
)
from spherekit.geometry.triangle import arc
from spherekit.geometry.vectors import cross, nans
from spherekit.numerics.array_rows import ArrayRows
from spherekit.numerics.bracketed_zeros import find_bracketed_zeros
from spherekit.numerics.chebyshev import find_real_zeros
from spherekit.tolerances import EPS

ORDERS = (1, 4, 8, 16)
"""Orders of the polynomials of height. The order of a segment is raised until its area is
known well enough. Order 1 is the chord itself, for a segment whose border was not found.

The nodes of each order are among the nodes of the next order, so heights are reused.
"""

MAX_HEIGHT_RATIO = 0.4
"""Largest height at the middle of a segment, as a part of its chord.

If a segment is higher, its triangle is cut into smaller ones.
"""

MIN_BORDER_CHORD_RAD = 1e-11
"""A shorter chord is taken as the border, since its direction has too few digits."""

CHECK_STEPS = 16
"""Number of steps along a segment at which the other margins are evaluated."""


def chord_frames(start: Floats, end: Floats) -> Floats:
    """Return the frames of chords, by which points beside the chords are placed.

    On the unit sphere, the chord of a curve is the arc of the great circle between its
    ends. A frame is a set of three perpendicular unit vectors. `points_beside_chords` uses
    the frames.

    Parameters
    ----------
    start, end
        (n, 3) unit vectors, the ends of the chords.

    Returns
    -------
    (n, 3, 3) matrices. Their rows are unit vectors: to the start, along the chord at its
    start, and to its left. The last two are 0 if start and end coincide.
    """
    # The cross product with the difference of both ends is accurate also for short chords.
    side = cross(start, end - start)
    size = np.linalg.norm(side, axis=1, keepdims=True)
    to_left = side / np.where(size > 0.0, size, 1.0)
    return np.stack([start, cross(to_left, start), to_left], axis=1)


def points_beside_chords(
    frames: Floats, length: Floats, u: Floats, height: Floats
) -> Floats:
    """Return the points at given heights over chords.

    A chord is the arc of a great circle between two points of a curve on the unit sphere.
    The height is the angle (rad) of a point from the chord, positive to its left.

    Parameters
    ----------
    frames
        (n, 3, 3) frames of the chords. Their rows are unit vectors: to the start, along the
        chord at its start, and to its left.
    length
        (n,) arcs of the chords (rad).
    u
        Parameter along each chord, -1 at its start and 1 at its end. Its shape broadcasts
        with `height`.
    height
        (n, ...) angles (rad) from the chord to the left.

    Returns
    -------
    (n, ..., 3) unit vectors.
    """
    # Angle (rad) from the start along the chord. The lengths (n,) get the same number of
    # axes as the heights (n, ...).
    later_axes = tuple(range(1, np.ndim(height)))
    angle = 0.5 * np.expand_dims(length, later_axes) * (1.0 + u)
    level = np.cos(height)
    components = [level * np.cos(angle), level * np.sin(angle), np.sin(height)]
    # n is the chord, i the row of its frame, j the component of the point.
    return np.einsum("n...i,nij->n...j", np.stack(components, axis=-1), frames)


@cache
def chebyshev_nodes(order: int) -> Floats:
    """Return the nodes u (order + 1,) from -1 to 1, both ends included."""
    return -np.cos(np.arange(order + 1) * np.pi / order)


@cache
def coefficient_matrix(order: int) -> Floats:
    """Return the matrix from values at the nodes to coefficients of a Chebyshev series."""
    vandermonde = chebyshev.chebvander(chebyshev_nodes(order), order)
    return np.asarray(np.linalg.inv(vandermonde), float)


@cache
def integration_weights(order: int) -> Floats:
    """Return the weights (order + 1,) of Clenshaw and Curtis for the nodes."""
    even_orders = np.arange(0, order + 1, 2)
    return 2.0 / (1.0 - even_orders**2.0) @ coefficient_matrix(order)[::2]


def interpolation_matrix(order: int, u: Floats) -> Floats:
    """Return the matrix (m, order + 1) from values at the nodes to values at u (m,)."""
    return chebyshev.chebvander(u, order) @ coefficient_matrix(order)


def areas_beside_chords(height: Floats, length: Floats) -> Floats:
    """Return the signed areas (sr) between chords and the border of a region.

    A chord is the great-circle arc between the ends of a piece (segment) of the border. The
    region is to the left of its border. The area is positive where the border is to the
    right of the chord, because the region then extends beyond the chord.

    The element of area at the angle a from the chord is cos(a) da ds, with the arc length
    s along the chord. Its integral over a, from 0 to the height h, is sin(h) ds. The
    integral over s is computed by Clenshaw-Curtis quadrature.

    Parameters
    ----------
    height
        (k, order + 1) heights (rad): angles from the chord to the border, positive to the
        left. They are at the Chebyshev nodes (points of polynomial interpolation) of this
        order along the chord.
    length
        (k,) arcs of the chords (rad).

    Returns
    -------
    (k,) areas (sr).
    """
    order = height.shape[1] - 1
    # The weights are for a parameter u from -1 to 1, and ds = (length / 2) du.
    return -0.5 * length * (np.sin(height) @ integration_weights(order))


def estimate_area_errors(height: Floats, length: Floats) -> Floats:
    """Return the errors (sr) of the areas between chords and the border of a region.

    A chord is the great-circle arc between the ends of a piece (segment) of the border.

    Parameters
    ----------
    height
        (k, order + 1) heights (rad): angles from the chord to the border, positive to the
        left. They are at the Chebyshev nodes (points of polynomial interpolation) of this
        order along the chord.
    length
        (k,) arcs of the chords (rad).

    Returns
    -------
    (k,) errors of `areas_beside_chords`.
    """
    # The truncation error is estimated by the change of the area when every second node is
    # left out. The remaining nodes are those of half the order.
    coarse_area = areas_beside_chords(height[:, ::2], length)
    truncation = np.abs(areas_beside_chords(height, length) - coarse_area)
    rounding = EPS * length
    # The heights beside a very short chord are not measured but taken as zero. The true
    # heights are at most the length of the chord, so the area is at most its square.
    not_measured = np.where(length > MIN_BORDER_CHORD_RAD, 0.0, length**2)
    return truncation + rounding + not_measured


def parabola_minima(samples: Floats) -> Floats:
    """Return the smallest value at or beside each inner sample of functions.

    To find minima between samples, a parabola is laid through each sample and its two
    neighbours. If the extremum of the parabola is between the neighbours, the smaller one
    of extremum and sample is returned. If not, the sample is returned.

    Parameters
    ----------
    samples
        (n, m, k) samples of k functions on n curves at m equally spaced positions.

    Returns
    -------
    (n, m - 2, k) smallest values.
    """
    before = samples[:, :-2]
    middle = samples[:, 1:-1]
    after = samples[:, 2:]
    # The parabola is middle + slope x + second_difference x^2 / 2, with x in steps from the
    # middle sample.
    second_difference = before - 2.0 * middle + after
    slope = 0.5 * (after - before)
    with np.errstate(all="ignore"):
        extremum_position = -slope / second_difference
        extremum = middle + 0.5 * slope * extremum_position
        is_between = np.abs(extremum_position) < 1.0
    return np.minimum(np.where(is_between, extremum, middle), middle)


@dataclass(frozen=True)
class BorderNodes:
    """Interpolation points (nodes) on the border of a region of the unit sphere.

    The border consists of segments (smooth pieces). Their nodes follow one another.

    Attributes
    ----------
    points
        (m, 3) unit vectors.
    segment
        (m,) index of the segment of each point, ascending from 0.
    node
        (m,) index of the point within its segment, from 0 at the start of the segment.
    """

    points: Floats
    segment: Indices
    node: Indices

    @property
    def is_start(self) -> Bools:
        """Whether each point (m,) is the start of its segment."""
        return self.node == 0


@dataclass
class BorderSegments(ArrayRows):
    """Segments of the border of a region, n in all.

    A chord is the arc of a great circle between two points of the border in a triangle of a
    mesh. The segment is the border beside the chord: a curve whose height is a polynomial
    along the chord. The height is the angle to the left of the chord. The region is to the
    left. Margins are the functions that are at least 0 in the region. A crossing is a point
    at which the border crosses an edge of the mesh.

    Attributes
    ----------
    frames
        (n, 3, 3) frames of the chords. Their rows are unit vectors: to the start, along the
        chord at its start, and to its left.
    length
        (n,) arcs of the chords (rad).
    margin
        (n,) index of the margin that is zero on the segment, or `UNDEFINED_MARGIN`.
    triangle
        (n,) index of the triangle of the mesh that contains the chord.
    start, stop
        (n,) indices of the crossings between which the border runs in the triangle.
    is_leading
        (n,) False for a segment that begins at a corner of the border in the triangle. The
        leading segment of the same triangle ends at this corner.
    is_sound
        (n,) whether the border between the ends of the segment was found, and no other
        margin is negative on it. In place of the border, a segment that is not sound has
        its chord.
    order
        (n,) order of the polynomial of the height, one of `ORDERS`.
    height
        (n, 17) heights (rad) at the nodes of the order, in the first order + 1 columns.
    area
        (n,) area (sr) of the part of the region that the chord cuts off.
    error
        (n,) change of the area (sr) if the order is halved.
    """

    frames: Floats
    length: Floats
    margin: Indices
    triangle: Indices
    start: Indices
    stop: Indices
    is_leading: Bools
    is_sound: Bools
    order: Indices
    height: Floats
    area: Floats
    error: Floats

    @staticmethod
    def empty() -> "BorderSegments":
        """Return an object without segments (pieces of the border of a region).

        The refinement of a region begins with it, before the border is found. Each field is
        an array with one row for each segment, so every field has no rows here.
        """
        # The height of a segment over its chord is a polynomial. `height` has one column
        # for each interpolation point (node) of this polynomial. The polynomial with the
        # highest degree has one node more than this degree.
        highest_degree = ORDERS[-1]
        max_node_count = highest_degree + 1
        no_index = np.zeros(0, np.intp)
        no_number = np.zeros(0)
        no_flag = np.zeros(0, dtype=bool)
        return BorderSegments(
            frames=np.zeros((0, 3, 3)),
            length=no_number,
            margin=no_index,
            triangle=no_index,
            start=no_index,
            stop=no_index,
            is_leading=no_flag,
            is_sound=no_flag,
            order=no_index,
            height=np.zeros((0, max_node_count)),
            area=no_number,
            error=no_number,
        )

    @staticmethod
    def find(
        evaluate: MarginEvaluator,
        ends: tuple[Floats, Floats],
        margin: Indices,
        triangle: Indices,
        crossings: tuple[Indices, Indices],
        is_leading: Bools,
        is_searched: Bools,
    ) -> "BorderSegments":
        """Return the segments between points of the border, with polynomials of low degree.

        A segment is the border of a region in one triangle of a mesh. The chord is the arc
        of a great circle between its ends. The border beside the chord is given by its
        height, the angle from the chord to the left, as a polynomial along the chord.
        Margins are functions that are at least 0 in the region.

        The order of a segment is the degree of the polynomial: 1 (the chord), 4, 8 or 16.
        The returned segments have the order 4, or 1 where the border is not known.

        Parameters
        ----------
        evaluate
            The margins.
        ends
            Two arrays (n, 3) of unit vectors, the starts and the ends of the chords.
        margin
            (n,) index of the margin that is zero on each segment.
        triangle
            (n,) index of the triangle that contains the segment.
        crossings
            Two arrays (n,) of indices of crossings. A crossing is a point at which the
            border crosses an edge of the mesh. The border enters the triangle of a segment
            at the first crossing, and leaves it at the second.
        is_leading
            (n,) whether a segment begins at an edge of its triangle. If the border has a
            corner within a triangle, a leading segment ends there and another one begins.
        is_searched
            (n,) whether the border of a segment is searched. If not, the chord is taken as
            the border.
        """
        # Begin with chords: order 1, no height, and no area beside the chord. A segment is
        # sound if the border between its ends is known. All searched segments begin as
        # sound. `raise_order` makes a segment unsound if it does not find the border there.
        n = len(margin)
        start, stop = crossings
        segments = BorderSegments(
            frames=chord_frames(*ends),
            length=arc(*ends),
            margin=margin,
            triangle=triangle,
            start=start,
            stop=stop,
            is_leading=is_leading,
            is_sound=is_searched,
            order=np.full(n, ORDERS[0]),
            height=np.zeros((n, ORDERS[-1] + 1)),
            area=np.zeros(n),
            error=np.zeros(n),
        )
        # The order rises from 1 to 4.
        segments.raise_order(evaluate, np.flatnonzero(is_searched))
        return segments

    def raise_order(self, evaluate: MarginEvaluator, selected: Indices) -> None:
        """Raise some segments (k,) to the next order. None of them has the highest one."""
        orders = self.order[selected]
        for order, next_order in pairwise(ORDERS):
            raised = selected[orders == order]
            # The nodes of the lower order are among those of the higher one.
            heights = nans((len(raised), next_order + 1))
            heights[:, :: next_order // order] = self.height[raised, : order + 1]
            self._measure(evaluate, raised, next_order, heights)

    def _measure(
        self,
        evaluate: MarginEvaluator,
        selected: Indices,
        order: int,
        known_height: Floats,
    ) -> None:
        """Compute and store the heights of some segments at a new order, and their areas.

        The estimated errors of the areas are stored, too.

        A segment is a piece of the border of a region. Its chord is the arc of the great
        circle between its ends. The height (angle) of the border over the chord is a
        polynomial along the chord. The polynomial is stored by its values at Chebyshev
        nodes. The order of the segment is the degree of this polynomial. If the border is
        not found at a node, the chord takes the place of the whole segment.

        Parameters
        ----------
        evaluate
            The margins: functions of the direction that are at least 0 in the region. One
            of them is zero on the border.
        selected
            (k,) indices of the segments.
        order
            Their new order.
        known_height
            (k, order + 1) heights (rad) of the border at the nodes, positive to the left of
            the chord. NaN if not known yet.
        """
        height, is_found = self._complete_heights(evaluate, selected, known_height)
        length = self.length[selected]
        self.order[selected] = order
        self.height[selected, : order + 1] = height
        self.area[selected] = areas_beside_chords(height, length)
        self.error[selected] = estimate_area_errors(height, length)
        self._replace_by_chords(selected[~is_found])

    def _complete_heights(
        self, evaluate: MarginEvaluator, selected: Indices, known_height: Floats
    ) -> tuple[Floats, Bools]:
        """Return the heights of the border over some chords at all Chebyshev nodes.

        A chord is the great-circle arc between the ends of a piece of the border. The
        height (angle) of the border over the chord is a polynomial along the chord, stored
        by its values at the nodes. When the degree (order) of the polynomial is raised, the
        heights at the old nodes are known and are used again.

        Parameters
        ----------
        evaluate
            The margins: functions of the direction that are at least 0 in the region.
        selected
            (k,) indices of the segments (pieces of the border).
        known_height
            (k, order + 1) heights (rad) at the nodes of the new order, NaN if not known.

        Returns
        -------
        height
            (k, order + 1) heights (rad), positive to the left of the chord. The heights are
            0 over very short chords, for which the border is not searched.
        is_found
            (k,) whether the border was found at all nodes of a segment.
        """
        height = known_height.copy()
        is_short = ~(self.length[selected] > MIN_BORDER_CHORD_RAD)
        height[is_short] = 0.0

        # Each unknown height has a position in `selected` and the index of a node.
        position, node = np.nonzero(np.isnan(height))
        u = chebyshev_nodes(height.shape[1] - 1)[node]
        searched_height, is_found_at_node = self._find_heights(
            evaluate, selected[position], u
        )
        height[position, node] = searched_height
        is_found = np.ones(len(selected), dtype=bool)
        is_found[position[~is_found_at_node]] = False
        return height, is_found

    def _replace_by_chords(self, selected: Indices) -> None:
        """Replace segments (k,) whose border was not found by their chords."""
        self.is_sound[selected] = False
        self.order[selected] = ORDERS[0]
        self.height[selected] = 0.0
        self.area[selected] = 0.0

    def _find_heights(
        self, evaluate: MarginEvaluator, segment: Indices, u: Floats
    ) -> tuple[Floats, Bools]:
        """Return the heights of the border over points of chords.

        A margin is a function of the direction that is at least 0 in the region, so one of
        the margins is zero on the border. A chord is the arc of a great circle between two
        points of the border. The region is to its left, and the height is the angle from
        the chord to the left.

        The height is searched on both sides of the chord, up to a parabola over it. The
        margin that is zero on the border must be negative on the right parabola and at
        least 0 on the left one. No other margin may be negative at the height.

        Parameters
        ----------
        evaluate
            The margins.
        segment
            (m,) index of the segment of each point.
        u
            (m,) parameter of each point on the chord, -1 < u < 1. At both ends of the chord
            the height is 0 and is not searched.

        Returns
        -------
        height
            (m,) heights (rad), 0 if none was found.
        is_sound
            (m,) whether a height was found and no other margin is negative there.
        """
        # The index of the margin that is zero on the border of each segment.
        border_margin = self.margin[segment]
        # The parabola, which is zero at both ends of the chord, bounds the search at each
        # of the m points of chords. Heights are searched as fractions of it, so that the
        # search is between -1 (right of the chord) and 1 (left) at all points.
        max_height = MAX_HEIGHT_RATIO * self.length[segment] * (1.0 - u * u)

        def evaluate_margins(fraction: Floats, points: Indices) -> Floats:
            """Return all margins (k, margins) at heights over some points of chords.

            A margin is a function that is at least 0 inside the region.

            `points` (k,) are indices of the m points. The height over each of them is
            `fraction` (k,) of its largest searched height, negative right of the chord.
            """
            height = fraction * max_height[points]
            return evaluate(self._points_at(segment[points], u[points], height))

        def evaluate_border_margin(fraction: Floats, points: Indices) -> Floats:
            """Return only the margin (k,) that is zero on the border, at these heights."""
            margins = evaluate_margins(fraction, points)
            return select_margins(margins, border_margin[points])

        limits = np.repeat([-1.0, 1.0], len(u))
        at_limits = evaluate_border_margin(limits, np.tile(np.arange(len(u)), 2))
        value_on_right, value_on_left = at_limits.reshape(2, -1)
        is_sound = (value_on_right < 0.0) & (value_on_left >= 0.0)
        bracketed = np.flatnonzero(is_sound)
        fraction = np.zeros(len(u))
        # The zero is located to EPS rad of height.
        fraction[bracketed], _ = find_bracketed_zeros(
            lambda fraction, rows: evaluate_border_margin(fraction, bracketed[rows]),
            low=-np.ones(len(bracketed)),
            high=np.ones(len(bracketed)),
            values_at_low=value_on_right[bracketed],
            values_at_high=value_on_left[bracketed],
            tolerance=EPS / max_height[bracketed],
        )
        # No other margin may be negative on the border.
        values = evaluate_margins(fraction[bracketed], bracketed)
        is_zero_margin = np.arange(values.shape[1]) == border_margin[bracketed][:, None]
        is_negative = (values < -evaluate.rounding_errors) & ~is_zero_margin
        is_sound[bracketed] &= ~np.any(is_negative, axis=1)
        return fraction * max_height, is_sound

    def reject_excluded_segments(
        self, evaluate: MarginEvaluator, selected: Indices
    ) -> None:
        """Replace segments by their chords if another margin excludes a part of them.

        A segment is a piece of the border of a region, on which one margin (the border
        margin) is zero. Margins are functions of the direction that are at least 0 in the
        region. If another margin is negative on a part of the segment, this part is outside
        the region and not its border. The chord (great-circle arc between the ends) then
        replaces the segment. The segment is marked as not sound (`is_sound`), because the
        border between its ends is not known.

        Parameters
        ----------
        evaluate
            The margins.
        selected
            (k,) indices of the segments that are checked. Their heights above the chord
            must be polynomials of degree 4, the degree with which `find` creates segments.
        """
        # (k, samples, margins) each margin minus the border margin, at equally spaced
        # points of each segment. The border margin would be 0 on a segment without error.
        # The difference cancels most of the error.
        differences = self._sample_differences(evaluate, selected)
        # A minimum between samples is found by a parabola through three samples.
        is_negative = parabola_minima(differences) < -evaluate.rounding_errors
        has_excluded_part = np.any(is_negative, axis=(1, 2))
        self._replace_by_chords(selected[has_excluded_part])

    def _sample_differences(self, evaluate: MarginEvaluator, selected: Indices) -> Floats:
        """Return the differences of all margins from the border margin along segments.

        A segment is a piece of the border of a region, on which one margin (the border
        margin) should be zero. Where another margin is negative, the segment is outside the
        region. The computed segment is a polynomial of degree 4 with a small error. There
        the border margin is not exactly zero. All margins are therefore compared with the
        border margin: a negative difference shows that the segment is outside.

        Parameters
        ----------
        evaluate
            The margins: functions of the direction that are at least 0 in the region.
        selected
            (k,) indices of the segments.

        Returns
        -------
        (k, samples, margins) differences at equally spaced points of each segment.
        """
        # The chord is the great-circle arc between the ends of a segment. The parameter u
        # runs along the chord. The height of the segment over the chord is a polynomial in
        # u, interpolated from its values at degree + 1 nodes.
        u = np.linspace(-1.0, 1.0, CHECK_STEPS + 1)
        degree = ORDERS[1]  # 4, the degree with which `find` creates segments
        nodes_to_samples = interpolation_matrix(degree, u)
        height = self.height[selected, : degree + 1] @ nodes_to_samples.T
        points = self._points_at(selected, u, height)  # (k, samples, 3)
        margins = evaluate(points.reshape(-1, 3))
        margins = margins.reshape(len(selected), len(u), margins.shape[1])
        # (k, 1, 1) index of the border margin of each segment. It is `UNDEFINED_MARGIN` if
        # the region ends because a margin becomes NaN. No margin has to be zero there, so
        # the margins are compared with 0.
        border_number = self.margin[selected, None, None]
        border_margin = np.take_along_axis(margins, border_number, axis=2)
        return margins - np.where(border_number == UNDEFINED_MARGIN, 0.0, border_margin)

    def _points_at(self, selected: Indices, u: Floats, height: Floats) -> Floats:
        """Return the points at given heights beside the chords of some segments."""
        return points_beside_chords(self.frames[selected], self.length[selected], u, height)

    @property
    def ends(self) -> Floats:
        """Both ends (n, 2, 3) of the chords."""
        return points_beside_chords(
            self.frames, self.length, np.array([-1.0, 1.0]), np.zeros((len(self.length), 2))
        )

    def node_points(self, selected: Indices) -> BorderNodes:
        """Return the interpolation points (nodes) of some segments (k,) of a border.

        A segment is a piece of the border of a region. Its height (angle) over the chord,
        the great-circle arc between its ends, is a polynomial along the chord. The order of
        the segment is the degree of this polynomial. The segment has order + 1 Chebyshev
        nodes, which include both ends. Its heights at the nodes are stored.
        """
        # Each node belongs to a segment (an index in `selected`) and has an index within
        # this segment, from 0 to the order of the segment.
        orders = self.order[selected]
        has_node = np.arange(ORDERS[-1] + 1) <= orders[:, None]
        index, node = np.nonzero(has_node)
        # Parameter of each node on its chord, from -1 to 1. `ORDERS` has all possible
        # orders.
        u = np.empty(len(node))
        for order in ORDERS:
            has_order = orders[index] == order
            u[has_order] = chebyshev_nodes(order)[node[has_order]]
        segment = selected[index]
        points = self._points_at(segment, u, self.height[segment, node])
        return BorderNodes(points, segment=index, node=node)

    def polyline(self, chain: Indices) -> Floats:
        """Return the nodes (m, 3) of segments that follow one another.

        The common node of two successive segments appears once. If the chain is closed, its
        first node appears again at the end.
        """
        nodes = self.node_points(chain)
        # The start of a segment is the end of the segment before it.
        is_repeated = nodes.is_start & (nodes.segment > 0)
        return nodes.points[~is_repeated]

    def raise_to_highest_order(self, evaluate: MarginEvaluator) -> None:
        """Raise all segments whose border can be found to the highest order."""
        while True:
            can_raise = self.is_sound & (self.order < ORDERS[-1])
            if not can_raise.any():
                return
            self.raise_order(evaluate, np.flatnonzero(can_raise))

    def find_extremal_points(self, number: int, direction: Floats) -> Floats:
        """Return the points of a segment where its distance from a direction is extremal.

        Parameters
        ----------
        number
            Index of a segment (piece of the border). It must be a polynomial of the highest
            degree, 16.
        direction
            (3,) unit vector.

        Returns
        -------
        (m, 3) unit vectors at which the derivative of the distance along the segment is
        zero. The ends of the segment are not examined.
        """
        degree = ORDERS[-1]
        segment = np.array([number])  # the methods take arrays of numbers
        # The chord is the great-circle arc between the ends of the segment. The parameter u
        # runs from -1 to 1 along the chord. The cosine of the distance becomes a Chebyshev
        # series in u.
        cosine = np.vecdot(self.node_points(segment).points, direction)
        cosine_series = coefficient_matrix(degree) @ cosine
        u = find_real_zeros(chebyshev.chebder(cosine_series))
        # `self.height` has the angles of the segments above their chords at the nodes.
        height = self.height[segment] @ interpolation_matrix(degree, u).T
        (points,) = self._points_at(segment, u, height)
        return points


def find_nearest_point(
    segments: BorderSegments, evaluate: MarginEvaluator, direction: Floats
) -> Floats:
    """Return the point of a border that is nearest to a direction.

    It is the point of the region that is nearest to a direction outside. The border
    consists of segments between known points. The nearest point is an end of a segment, or
    a point within a segment at which the distance has a minimum.

    A segment is sound if the course of the border between its ends was found. Of other
    segments only the ends are examined.

    Parameters
    ----------
    segments
        The border of a region.
    evaluate
        The margins of the region: functions of the direction that are at least 0 in it.
    direction
        (3,) unit vector outside the region.

    Returns
    -------
    (3,) unit vector.
    """
    nearby = _select_nearby_segments(segments, direction)
    # Segments are polynomials, most accurate with the highest degree. Where the method does
    # not find the border at the additional nodes, it marks the segment as unsound.
    nearby.raise_to_highest_order(evaluate)
    candidates = [nearby.ends.reshape(-1, 3)]
    for number in np.flatnonzero(nearby.is_sound):
        candidates.append(nearby.find_extremal_points(int(number), direction))
    points = np.concatenate(candidates)
    # Segments are approximate polynomials, so their points can be a little outside of the
    # region. Such candidates are left out if others are inside. With a margin of NaN a
    # point is outside.
    tolerances = BORDER_TOLERANCE_FACTOR * evaluate.rounding_errors
    is_inside = np.all(evaluate(points) >= -tolerances, axis=1)
    points = points[is_inside] if is_inside.any() else points
    return points[np.argmin(arc(points, direction))]


def _select_nearby_segments(segments: BorderSegments, direction: Floats) -> BorderSegments:
    """Return the segments that can contain the point of the border nearest to a direction.

    A segment is a piece of the border, its chord the great-circle arc between its ends. Its
    height over the chord is at most `MAX_HEIGHT_RATIO` (0.4) times the length of the chord.
    Each point of the segment is therefore nearer than this length to one end. So its
    distance from the direction is at least the distance of the nearer end, minus the length
    of the chord. A segment is selected if this lower bound does not exceed the distance of
    the nearest end of all segments.

    Parameters
    ----------
    segments
        The border of a region.
    direction
        (3,) unit vector.
    """
    end_distance = np.min(arc(segments.ends, direction), axis=1)
    least_distance = end_distance - segments.length
    return segments.rows(least_distance <= np.min(end_distance))
