"""Classes of triangles: inside, outside, or crossed by the border of a region.

In a triangle each margin is interpolated by a polynomial of degree 2 from six samples. Four
more samples show how large the interpolation error is. A class is as certain as these
samples.
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.geometry.vectors import cross, max_abs

VALUE_SAFETY_FACTOR = 3.0
"""Bound of the error of an interpolated margin, over the largest error at the check points.
For a polynomial of degree 3 the factor 2 is enough."""

SLOPE_SAFETY_FACTOR = 12.0
"""Bound of the error of the slope of a margin, over the same largest error of the margin.
The slope is that along an edge at one of its ends, with the edge as unit of length. For a
polynomial of degree 3 the factor 11 is enough."""

MIN_CORNER_RAD = 0.25
"""Corners of the region that are sharper than this are cut out by ever smaller triangles.
Larger: more triangles are cut. Smaller: gradients may point in more different directions in
a triangle in which the border is taken for a simple curve."""

STEADY_RATIO = 1.0
"""A margin that is undefined in a part of a triangle keeps its sign if its smallest size is
larger than this times the difference between its largest and smallest sample."""

CHECK_TWELFTHS = np.array(
    [[9, 3, 0], [0, 9, 3], [3, 0, 9], [3, 9, 0], [0, 3, 9], [9, 0, 3], [4, 4, 4]]
)
"""(7, 3) barycentric coordinates of possible check points, in twelfths: on the edges 12, 23
and 31 nearer to the first vertex of the edge, the same nearer to the second vertex, and the
centroid."""


class TriangleClass(IntEnum):
    """Position of a triangle relative to a region."""

    OUTSIDE = 0
    INSIDE = 1
    SIMPLE = 2
    """The border in the triangle is a single curve, the graph of a function over some
    direction, or there is no border."""
    BROKEN = 3
    """The margins are defined in a part of the triangle only. The border is the border of
    that part, which is known only from samples."""
    OPEN = 4
    """A part of the region, or a hole of it, may be hidden in the triangle."""


@dataclass(frozen=True)
class MarginBounds:
    """Bounds of k margins in n triangles of a mesh.

    Margins are functions that are at least 0 inside a region. In a triangle they are
    interpolated from six samples. Four further samples, at the check points, show the
    interpolation error.

    The bounds tell whether a triangle is inside the region, outside, or crossed by the
    border.

    Attributes
    ----------
    low, high
        (n, k) smallest and largest value that a margin may have in the triangle, with
        allowance for the interpolation error.
    error
        (n, k) largest interpolation error at the check points of the triangle.
    """

    low: Floats
    high: Floats
    error: Floats


def _bernstein_matrix() -> Floats:
    """Return the matrix (6, 6) from samples of a function to Bernstein coefficients.

    The coefficients are bounds of a polynomial in a triangle. The samples are at the
    vertices 1, 2, 3 and at the midpoints of the edges 12, 23, 31. They determine a
    polynomial of degree 2. Its value is b1 p^2 + b2 q^2 + b3 r^2 + 2 b12 p q + 2 b23 q r +
    2 b31 r p, with the barycentric coordinates p, q, r of a point. The b are the Bernstein
    coefficients. In the triangle the polynomial is between the smallest and the largest b.

    Returns
    -------
    The matrix. Its rows give b1, b2, b3, b12, b23 and b31.
    """
    # b1 is the sample at vertex 1. b12 is twice the sample at the midpoint of edge 12,
    # minus the mean of the samples at both ends.
    half_sum_of_ends = 0.5 * np.array([[1, 1, 0], [0, 1, 1], [1, 0, 1]])
    from_vertices = np.vstack([np.eye(3), -half_sum_of_ends])
    from_midpoints = np.vstack([np.zeros((3, 3)), 2.0 * np.eye(3)])
    return np.hstack([from_vertices, from_midpoints])


def _slope_matrix(bernstein: Floats) -> Floats:
    """Return the matrix (3, 2, 6) from samples in a triangle to derivatives at corners.

    The derivatives give the gradients of margins (functions that are at least 0 inside a
    region). A margin is known at six samples: the vertices 1, 2, 3 and the midpoints of the
    edges. They determine the polynomial b1 p^2 + b2 q^2 + b3 r^2 + 2 b12 p q + 2 b23 q r +
    2 b31 r p. Here p, q, r are barycentric coordinates, and the b Bernstein coefficients.

    Parameters
    ----------
    bernstein
        (6, 6) matrix from the samples to b1, b2, b3, b12, b23 and b31.

    Returns
    -------
    The matrix. Axis 0 is the vertex 1, 2 or 3. Axis 1 is the direction: from vertex 1 to 2,
    or from 1 to 3. The unit of length is the whole edge between these two vertices. Axis 2
    is the sample.
    """
    # From 1 to 2, q grows and p shrinks. From 1 to 3, r grows and p shrinks. The derivative
    # of the polynomial from 1 to 2 at vertex 1 (p = 1, q = r = 0) is 2 (b12 - b1).
    # Each b is a row of the matrix: the factors of the samples that give the coefficient.
    b1, b2, b3, b12, b23, b31 = bernstein
    at_vertex_1 = [b12 - b1, b31 - b1]
    at_vertex_2 = [b2 - b12, b23 - b12]
    at_vertex_3 = [b23 - b31, b3 - b31]
    return 2.0 * np.stack([at_vertex_1, at_vertex_2, at_vertex_3])


def _check_matrix(bernstein: Floats) -> Floats:
    """Return the matrix (7, 6) from six samples to interpolated values at seven points.

    A margin is a function that is at least 0 inside a region. In each triangle of a mesh,
    the margin is interpolated by a polynomial of degree 2 through six samples: at the
    vertices 1, 2, 3 and at the midpoints of the edges. The polynomial is compared with
    further samples at some of the points `CHECK_TWELFTHS`, to estimate its error.

    Parameters
    ----------
    bernstein
        (6, 6) matrix from the samples to the coefficients b1, b2, b3, b12, b23 and b31 of
        the polynomial (Bernstein coefficients).
    """
    # The barycentric coordinates p, q, r of the seven points. The polynomial is b1 p^2 +
    # b2 q^2 + b3 r^2 + 2 b12 p q + 2 b23 q r + 2 b31 p r.
    p, q, r = CHECK_TWELFTHS.T / 12.0
    terms = np.stack([p * p, q * q, r * r, 2 * p * q, 2 * q * r, 2 * p * r], axis=1)
    return terms @ bernstein


_BERNSTEIN = _bernstein_matrix()
_SLOPES = _slope_matrix(_BERNSTEIN)
_CHECKS = _check_matrix(_BERNSTEIN)


def classify_triangles(
    points: Floats, triangles: Indices, samples: Floats
) -> tuple[Indices, Bools]:
    """Return the class of each triangle, and whether several margins are uncertain in it.

    Margins are functions of the direction that are at least 0 inside a region. A margin is
    uncertain in a triangle if its bounds in the triangle have different signs.

    - A triangle is outside if a margin is certainly negative, and inside if all margins are
      certainly at least 0.
    - A triangle is simple if the gradients of all uncertain margins, everywhere in the
      triangle, lie in a cone that is less than 180 deg wide. The smallest margin then rises
      along the axis of the cone. Its zeros are the graph of a function, so no curve closes
      in the triangle. The width of the cone leaves room for corners of `MIN_CORNER_RAD`.
    - Any other triangle is open: a part of the region, or a hole in it, may be hidden
      there.
    - Margins may be NaN at some samples. For their signs see `_bound_undefined_margins`. A
      sample counts as outside if some margins are NaN there and no margin is negative. A
      triangle with such samples is outside if all samples are of this kind, or if a margin
      is certainly negative. Otherwise it is broken if no margin is negative at any sample,
      and open if one is.

    Parameters
    ----------
    points
        (V, 3) unit vectors, the vertices of the mesh.
    triangles
        (n, 3) vertex numbers.
    samples
        (10, n, k) margins: at the three vertices, at the midpoints of the edges 12, 23 and
        31, at one check point on each of these edges, at a quarter of it from the vertex
        with the lower number, and at the centroid.

    Returns
    -------
    classes
        (n,) `TriangleClass`.
    has_several_uncertain
        (n,) whether more than one margin is uncertain.
    """
    is_missing = np.isnan(samples)
    filled = np.where(is_missing, 0.0, samples)
    is_defined = np.all(~is_missing, axis=0)
    # (n, k) bounds of each margin in each triangle.
    bounds = _bound_margins(triangles, filled)
    low_with_gaps, high_with_gaps = _bound_undefined_margins(samples)
    low = np.where(is_defined, bounds.low, low_with_gaps)
    high = np.where(is_defined, bounds.high, high_with_gaps)
    is_negative = high < 0.0
    is_uncertain = (low < 0.0) & (high >= 0.0)

    # A triangle is inside if all margins are certainly at least 0, and simple if the
    # gradients show a simple border. Any other triangle is open.
    classes = np.full(len(triangles), TriangleClass.INSIDE)
    classes[is_uncertain.any(axis=1)] = TriangleClass.OPEN
    candidates = np.flatnonzero(
        is_uncertain.any(axis=1)
        & ~is_negative.any(axis=1)
        & np.all(is_defined | ~is_uncertain, axis=1)
    )
    is_simple = _gradients_lie_in_cone(
        points[triangles[candidates]],
        filled[:6, candidates],
        bounds.error[candidates],
        is_uncertain[candidates],
    )
    classes[candidates[is_simple]] = TriangleClass.SIMPLE

    # Later assignments replace earlier ones. First samples that are outside only because a
    # margin is NaN.
    is_unreachable = is_missing.any(axis=2) & ~(np.fmin.reduce(samples, axis=2) < 0.0)
    is_broken = is_unreachable.any(axis=0)
    classes[is_broken] = TriangleClass.OPEN
    no_margin_negative = np.all(is_missing | (samples >= 0.0), axis=(0, 2))
    classes[is_broken & no_margin_negative] = TriangleClass.BROKEN
    classes[is_unreachable.all(axis=0)] = TriangleClass.OUTSIDE
    classes[is_negative.any(axis=1)] = TriangleClass.OUTSIDE
    has_several_uncertain = np.count_nonzero(is_uncertain, axis=1) > 1
    return classes, has_several_uncertain


def _bound_undefined_margins(samples: Floats) -> tuple[Floats, Floats]:
    """Return bounds of margins that are NaN at some samples of a triangle.

    Margins are functions that are at least 0 inside a region. The caller uses only the
    signs of the bounds, so each bound is 1 or -1. The sign of a margin is certain if the
    samples that are not NaN have this sign and vary little (see `STEADY_RATIO`). A margin
    that is NaN at all samples counts as positive.

    Parameters
    ----------
    samples
        (10, n, k) margins at ten points of each triangle.

    Returns
    -------
    low, high
        (n, k) lower and upper bounds. The bounds have different signs if the sign of the
        margin is not certain.
    """
    # `fmin` and `fmax` ignore NaN.
    smallest = np.fmin.reduce(samples, axis=0)
    largest = np.fmax.reduce(samples, axis=0)
    variation = STEADY_RATIO * (largest - smallest)
    # The sign is certain if all samples are above `variation`, or all are below
    # -`variation`. Comparisons with NaN are false, so a margin without any sample counts as
    # positive.
    low = np.where(smallest <= variation, -1.0, 1.0)
    high = np.where(-largest > variation, -1.0, 1.0)
    return low, high


def _bound_margins(triangles: Indices, samples: Floats) -> MarginBounds:
    """Return bounds of margins in triangles.

    Margins are functions that are at least 0 inside a region. The margins are known only at
    ten samples of each triangle. The samples show an interpolation error, and the bounds
    are widened by `VALUE_SAFETY_FACTOR` times this error.

    Parameters
    ----------
    triangles
        (n, 3) vertex numbers.
    samples
        (10, n, k) margins: at the three vertices, at the midpoints of the edges 12, 23 and
        31, at a check point on each of these edges, and at the centroid. A check point is
        at a quarter of its edge from the vertex with the lower number.
    """
    # Six samples determine a polynomial of degree 2. Its Bernstein coefficients are bounds.
    # The other four samples show its error.
    nodes = samples[:6]
    check_values = samples[6:]
    coefficients = np.tensordot(_BERNSTEIN, nodes, axes=1)
    error = max_abs(_interpolate_at_checks(triangles, nodes) - check_values, axis=0)
    slack = VALUE_SAFETY_FACTOR * error
    return MarginBounds(
        low=coefficients.min(axis=0) - slack,
        high=coefficients.max(axis=0) + slack,
        error=error,
    )


def _interpolate_at_checks(triangles: Indices, nodes: Floats) -> Floats:
    """Return interpolated values at the check points of triangles.

    The caller compares the interpolated values with the true values at these points, to
    find the interpolation error. The check point of an edge is at a quarter of the edge,
    nearer to the vertex with the lower number. So both triangles at the edge have the same
    check point.

    Parameters
    ----------
    triangles
        (n, 3) vertex numbers.
    nodes
        (6, n, k) values of k functions at the vertices and at the midpoints of the edges
        12, 23 and 31.

    Returns
    -------
    (4, n, k) values of the polynomial of degree 2 at the check points of these edges and at
    the centroid.
    """
    # (7, n, k) values near both ends of each edge, and at the centroid.
    interpolated = np.tensordot(_CHECKS, nodes, axes=1)
    near_first_vertex = interpolated[:3]
    near_second_vertex = interpolated[3:6]
    at_centroid = interpolated[6:]
    # (n, 3) booleans, a column for each of the edges 12, 23 and 31: whether the second
    # vertex of the edge has the lower number.
    first = triangles
    second = triangles[:, [1, 2, 0]]
    second_is_lower = second < first
    on_edges = np.where(
        second_is_lower.T[:, :, None], near_second_vertex, near_first_vertex
    )
    return np.concatenate([on_edges, at_centroid])


def _gradients_lie_in_cone(
    corners: Floats, samples: Floats, error: Floats, is_uncertain: Bools
) -> Bools:
    """Return whether the gradients of the uncertain margins lie in a cone about their mean.

    A margin is a function that is at least 0 inside a region. An uncertain margin may be 0
    in the triangle. If all gradients lie in a cone, all these margins increase along the
    axis of the cone. On each line along this axis, the region is then the part beyond one
    point. These points form a single curve, so no separate part or hole of the region is
    hidden in the triangle.

    Margins are interpolated by polynomials of degree 2, so gradients are linear in a
    triangle. It is therefore enough to check the gradients at the three vertices.

    Parameters
    ----------
    corners
        (n, 3, 3) vertices of the triangles.
    samples
        (6, n, k) margins at the vertices and at the midpoints of the edges 12, 23, 31.
    error
        (n, k) interpolation error of each margin.
    is_uncertain
        (n, k) margins to consider.

    Returns
    -------
    (n,) whether all these gradients lie in such a cone, up to the error.
    """
    # Derivatives (3, 2, n, k) of the interpolation along the edges 12 and 13, at each
    # vertex. `_SLOPES` has their factors in the six samples. The unit of length is the
    # whole edge.
    slopes = np.tensordot(_SLOPES, samples, axes=1)
    edge_12 = corners[:, 1] - corners[:, 0]
    edge_13 = corners[:, 2] - corners[:, 0]
    # In the plane of the triangle the real axis runs along edge 12, the imaginary axis
    # towards vertex 3. Edge 13 has the components `shift` and `height`.
    base = np.linalg.norm(edge_12, axis=1)[:, None]
    shift = np.vecdot(edge_12, edge_13)[:, None] / base
    twice_area = np.linalg.norm(cross(edge_12, edge_13), axis=1)[:, None]
    height = twice_area / base
    along_base = slopes[:, 0] / base
    gradient = along_base + 1j * (slopes[:, 1] - shift * along_base) / height
    size = np.abs(gradient)
    # (3, n, 1) largest change of the gradient at each vertex, if the slopes along both
    # edges u and v at the vertex change by up to 1. The change is |u + v| or |u - v| over
    # |u x v|.
    to_next = np.roll(corners, -1, axis=1) - corners
    to_previous = np.roll(corners, 1, axis=1) - corners
    longest_diagonal = np.maximum(
        np.linalg.norm(to_next + to_previous, axis=2),
        np.linalg.norm(to_next - to_previous, axis=2),
    )
    change_per_slope = (longest_diagonal / twice_area).T[:, :, None]
    with np.errstate(all="ignore"):
        # The axis of the cone is the mean of all unit gradients. A margin is not exactly of
        # degree 2. The error of a slope is estimated as `SLOPE_SAFETY_FACTOR` times the
        # measured error of the margin, which is enough for degree 3. With the relative
        # error r of a gradient, its angle to the axis changes by up to asin(r). The cosine
        # of this angle decreases by no more than r if it is at least r.
        slope_error = SLOPE_SAFETY_FACTOR * error
        slack = slope_error * change_per_slope / size
        directions = np.where(is_uncertain, gradient / size, 0.0)
        axis = np.sum(directions, axis=(0, 2))
        cosine = np.real(directions * np.conj(axis / np.abs(axis))[:, None]) - slack
    # Where the zeros of two margins meet in a corner of the region with the angle A, their
    # gradients differ by 180 deg - A, each from the mean by 90 deg - A / 2. Wider cones
    # belong to sharper corners than `MIN_CORNER_RAD`, and are refused.
    return np.all((cosine > np.sin(0.5 * MIN_CORNER_RAD)) | ~is_uncertain, axis=(0, 2))
