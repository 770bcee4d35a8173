"""The volume of the orientations at which given margins are at least 0.

Unit quaternions, up to their sign, are divided into four cubes: one for each component that
is the largest. With a 1 in place of this component and x, y, z in [-1, 1] for the others,
divided by the length of the vector, every point of a cube is a unit quaternion.

The volume element that is invariant under rotations is
8 / (1 + x^2 + y^2 + z^2)^2 dx dy dz. All orientations together have the volume 8 pi^2, as
with Euler angles and sin(b) da db dc.

The cubes are divided into cells with integer coordinates. In a cell each margin is
interpolated by a polynomial of degree 2 in each coordinate, from 27 samples. A cell at the
border of the set is divided into a grid of subcells, in which the volume is summed.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np

from spherekit.arrays import Array, Bools, Floats, Indices
from spherekit.geometry.region_margins import (
    MarginEvaluator,
    Margins,
    require_positive,
    smallest_margins,
)
from spherekit.geometry.triangle_class import VALUE_SAFETY_FACTOR
from spherekit.geometry.vectors import max_abs, unit_rows
from spherekit.numerics.array_rows import ArrayRows
from spherekit.numerics.chebyshev import grid_points
from spherekit.progress import ProgressReporter

ALL_ORIENTATIONS = 8.0 * np.pi**2
"""Volume of all orientations."""

CUBE_BITS = 18
"""A cube of quaternions is 2**CUBE_BITS units wide, so that coordinates are integers. Equal
points of neighbouring cells are then recognised. Larger: cells can be smaller."""

CUBE_POINTS = 3 * (2**CUBE_BITS + 1,)
"""Number of integer points along the three sides of a cube."""

FIRST_HALVINGS = 3
"""Number of times the cubes are halved before the first evaluation."""

MIN_CELL_WIDTH = 4
"""Cells of this width, in units, are not halved: a quarter of the width is one unit."""

SUBCELLS_PER_SIDE = 6
"""Number of subcells along each side of a cell, in which the volume is summed. Larger: more
accurate volumes of cells at the border, and more computation."""

EVALUATIONS_PER_HALVING = 120
"""Approximate number of evaluations that halving a cell in three directions costs."""

SUBCELL_COUNT = SUBCELLS_PER_SIDE**3
"""Number of subcells of a cell."""

SAMPLE_COUNT = 27
"""Number of samples of a cell, from which a margin is interpolated."""

VALUES_PER_CHUNK = 2**13
"""Number of polynomials that are summed at once. It limits the memory."""


def _cubic_grid(axis: Array) -> Array:
    """Return the points (n**3, 3) of a grid with n coordinates per axis, last fastest."""
    return grid_points(3 * [axis])


_CORNERS_OF_CUBE = _cubic_grid(np.arange(2))
"""(8, 3) corners of the unit cube, 0 or 1 along each axis."""

_CHECK_QUARTERS = np.array([[1, 1, 1], [1, 3, 3], [3, 1, 3], [3, 3, 1]])
"""(4, 3) coordinates of four check points in a cell, in quarters of its width."""

_SAMPLE_QUARTERS = np.concatenate([2 * _cubic_grid(np.arange(3)), _CHECK_QUARTERS])
"""(31, 3) coordinates of the 27 samples, then of the check points, in quarters."""


@dataclass(frozen=True)
class Orientations:
    """The orientations at which all margins are at least 0.

    A margin is a function of the orientation that is negative where, for example, a limit
    is exceeded.

    Attributes
    ----------
    volume
        Volume of these orientations. All orientations together have the volume 8 pi^2.
    error
        Estimate of the error of the volume: its change when cells (small cubes of the space
        of orientations) were halved the last time. For cells that were never halved it is
        their whole volume, if they may contain a border.
    place
        (4,) unit quaternion xyzw of the orientation deepest inside the set, among those at
        which margins were evaluated.
    depth
        Depth of this orientation. The depth is the smallest of the margins.
    evaluations
        Number of orientations at which the margins were evaluated.
    calls
        Number of calls of the function that returns the margins.
    """

    volume: float
    error: float
    place: Floats
    depth: float
    evaluations: int
    calls: int

    @property
    def fraction(self) -> float:
        """Volume of these orientations, as a part of the volume of all orientations."""
        return self.volume / ALL_ORIENTATIONS


def _interpolation_matrix(points: Floats) -> Floats:
    """Return the matrix (m, 27) that interpolates a function in a cell from 27 samples.

    A cell is a cube in the space of orientations, sampled at a grid of 3 x 3 x 3 points,
    the last coordinate fastest. The product of the matrix and the samples gives the values
    at m points.

    Parameters
    ----------
    points
        (m, 3) coordinates from 0 to 1 in the cell.
    """
    u = points.T
    # (3, m, 3) for each coordinate the Lagrange polynomials of degree 2, which belong to
    # the nodes 0, 1/2 and 1 (last axis).
    factors = np.stack([(1 - u) * (1 - 2 * u), 4 * u * (1 - u), u * (2 * u - 1)], axis=2)
    return np.einsum("ma,mb,mc->mabc", *factors).reshape(-1, 27)


_LINE_BERNSTEIN = np.array([[1.0, 0.0, 0.0], [-0.5, 2.0, -0.5], [0.0, 0.0, 1.0]])
_CUBE_BERNSTEIN = np.kron(_LINE_BERNSTEIN, np.kron(_LINE_BERNSTEIN, _LINE_BERNSTEIN))
"""(27, 27) matrix from samples to Bernstein coefficients. The smallest and largest
coefficient bound the polynomial in the cell."""

_SUBCELL_CENTRES = (_cubic_grid(np.arange(SUBCELLS_PER_SIDE)) + 0.5) / SUBCELLS_PER_SIDE
_AT_CENTRES = _interpolation_matrix(_SUBCELL_CENTRES)
_CHANGES = [
    _interpolation_matrix(_SUBCELL_CENTRES + half_step)
    - _interpolation_matrix(_SUBCELL_CENTRES - half_step)
    for half_step in 0.5 / SUBCELLS_PER_SIDE * np.eye(3)
]
"""Matrices from samples to the changes over a subcell in each direction. For polynomials of
degree 2 they are the derivatives at the centre times the width of the subcell."""

_SUBCELL_MEANS = np.mean(
    [
        _interpolation_matrix(_SUBCELL_CENTRES + offset / SUBCELLS_PER_SIDE)
        for offset in (_CORNERS_OF_CUBE - 0.5) / 3**0.5
    ],
    axis=0,
)
"""Matrix from samples to the means over subcells, by Gauss's rule with two nodes per
axis."""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)
_CUBE_GAUSS_POINTS = _cubic_grid(0.5 * (1.0 + _NODES))
_CUBE_GAUSS_WEIGHTS = np.prod(_cubic_grid(0.5 * _WEIGHTS), axis=1)
"""Points (64, 3) and weights (64,) of Gauss's rule in a cell."""


def find_orientations(
    margins: Margins, tolerance: float = 1e-3, most: int = 1_000_000
) -> Orientations:
    """Return the volume of the orientations at which all margins are at least 0.

    A margin is a function of the orientation that is negative where, for example, a limit
    is exceeded. The space of orientations is divided into cells. Cells in which a margin
    may change its sign are halved in all three directions, until the volume is known well
    enough. Parts of the set that lie between the samples of a cell can be missed. The error
    does not contain them.

    Parameters
    ----------
    margins
        Function of unit quaternions (n, 4) with components x, y, z, w. It returns margins
        (n, k), the same for q and -q. A margin may be NaN. Such an orientation counts as
        outside of the set.
    tolerance
        Required error, relative to the volume.
    most
        Limit of the number of evaluations. Even if the error is larger, the search ends
        before cells are halved whose estimated cost would exceed the limit. The first cells
        are always evaluated.

    Returns
    -------
    The volume (8 pi^2 for all orientations) with an estimate of its error, the sampled
    orientation whose smallest margin is largest, and the number of evaluations.

    Raises
    ------
    RegionError
        If the tolerance or `most` is not positive and finite. If the margins do not return
        a row for each orientation, or if one of them is infinite.
    """
    require_positive({"tolerance": tolerance, "most": most})
    evaluate = MarginEvaluator(margins)
    orientations = _OrientationCells(evaluate)
    progress = ProgressReporter("measuring a set of orientations")
    while True:
        cells = orientations.cells
        volume = float(cells.volume.sum())
        error = float(cells.error.sum())
        wanted_error = tolerance * volume
        message = f"volume {volume:.4g} +- {error:.2g}, to be known to {wanted_error:.2g}"
        progress.report_if_due(partial(str, message))  # called only if a report is due
        if error <= wanted_error:
            break
        # Cells with smaller errors than the limit are not halved. All of these together
        # have at most half of the required error. With a larger part, fewer cells would be
        # halved at once, in more rounds.
        limit = 0.5 * wanted_error / np.count_nonzero(cells.error)
        can_halve = cells.boxes.width > MIN_CELL_WIDTH
        to_halve = np.flatnonzero((cells.error > limit) & can_halve)
        cost = EVALUATIONS_PER_HALVING * len(to_halve)
        if not cost or evaluate.evaluations + cost > most:
            break
        orientations.halve(to_halve)
    return Orientations(
        volume=volume,
        error=error,
        place=orientations.deepest,
        depth=orientations.depth,
        evaluations=evaluate.evaluations,
        calls=evaluate.calls,
    )


@dataclass(frozen=True)
class _Boxes(ArrayRows):
    """n cells (cubic boxes) that divide the space of orientations.

    An orientation is a unit quaternion, up to its sign. Quaternions are divided into four
    cubes by their largest component. The other three components, divided by the largest,
    are coordinates from -1 to 1 in the cube. The coordinates are stored as whole units from
    the lowest corner of the cube, which is 2**CUBE_BITS units wide. Halving a cell is then
    exact, and equal points of neighbouring cells have equal coordinates.

    Attributes
    ----------
    cube
        (n,) index of the cube: the position of the largest component, from 0 to 3.
    corner
        (n, 3) coordinates of the lowest corner of each cell, in units.
    width
        (n,) width of each cell, in units.
    """

    cube: Indices
    corner: Indices
    width: Indices


@dataclass(frozen=True)
class _MarginRange:
    """Bounds of k margins in n cells of the space of orientations.

    A margin is a function of the orientation that is at least 0 in the set to be measured.

    Attributes
    ----------
    low, high
        (n, k) smallest and largest value that a margin may have in the cell.
    """

    low: Floats
    high: Floats


@dataclass(frozen=True)
class _MeasuredVolumes:
    """For each of n cells, the volume of the part that belongs to a set of orientations.

    Attributes
    ----------
    volume
        (n,) volumes. All orientations together have the volume 8 pi^2.
    is_certain
        (n,) whether the cell certainly belongs to the set as a whole, or certainly not at
        all. All other volumes are estimates.
    """

    volume: Floats
    is_certain: Bools


@dataclass(frozen=True)
class _MeasuredCells(ArrayRows):
    """n cells of the space of orientations, each with the volume of its part of a set.

    The set consists of the orientations at which all margins (functions of the orientation)
    are at least 0.

    Attributes
    ----------
    boxes
        The cells. Each is a cube in three coordinates of orientations (see `_Boxes`).
    volume
        (n,) volume of the part of the set in each cell. All orientations together have the
        volume 8 pi^2.
    error
        (n,) estimated error of each volume; 0 if the cell is known to be inside or outside
        the set.
    """

    boxes: _Boxes
    volume: Floats
    error: Floats


def _make_first_boxes() -> _Boxes:
    """Return the cells of a regular grid in each of the four cubes of quaternions."""
    corners = _cubic_grid(np.arange(2**FIRST_HALVINGS))
    width = 2 ** (CUBE_BITS - FIRST_HALVINGS)
    count = 4 * len(corners)
    return _Boxes(
        cube=np.arange(count) // len(corners),
        corner=np.tile(corners * width, (4, 1)),
        width=np.full(count, width),
    )


def _halve_boxes(boxes: _Boxes) -> _Boxes:
    """Cut each box into eight by halving it in all three directions.

    The eight parts of a box follow one another. Coordinates are integers; the width of the
    first boxes is a power of two, so widths are even.
    """
    whole = boxes.rows(np.repeat(np.arange(len(boxes.width)), 8))
    half_width = whole.width // 2
    # The lowest corners of the eight parts form a cube with half the width.
    corner_of_part = np.tile(_CORNERS_OF_CUBE, (len(boxes.width), 1))
    offset = corner_of_part * half_width[:, None]
    return _Boxes(cube=whole.cube, corner=whole.corner + offset, width=half_width)


def _divide_change(parts: _MeasuredVolumes, whole_volume: Floats) -> Floats:
    """Return estimated errors of the volume of a set in the eight parts of each cell.

    The space of orientations is divided into cells. In each cell, the volume of the part
    that belongs to the set is measured. When a cell is cut into eight parts, they are
    measured again. The sum of the new volumes is more accurate than the old volume, so
    their difference is an estimate of the error.

    The volume in a part is certain if the whole part is known to be inside or outside the
    set. The other parts share the error in equal amounts.

    Parameters
    ----------
    parts
        Volumes of the set in the eight parts of each of k cells, one cell after another.
    whole_volume
        (k,) volumes of the set that were measured in the whole cells.

    Returns
    -------
    (8 k,) errors of the volumes in the parts.
    """
    volume = parts.volume.reshape(-1, 8)
    is_uncertain = ~parts.is_certain.reshape(-1, 8)
    change = np.abs(volume.sum(axis=1) - whole_volume)
    uncertain_count = np.count_nonzero(is_uncertain, axis=1)
    share = change / np.maximum(uncertain_count, 1)
    return np.where(is_uncertain, share[:, None], 0.0).ravel()


class _OrientationCells:
    """Cells of the space of orientations, each with the volume of its part of a set.

    A margin is a function of the orientation that is negative where, for example, a limit
    is exceeded. The set consists of the orientations at which all margins are at least 0.
    All orientations together have the volume 8 pi^2.

    An orientation is a unit quaternion up to its sign, divided by its largest component.
    The other three components, from -1 to 1, are its coordinates in one of four cubes: one
    cube for each component that is the largest. The cells are cubic boxes in these cubes.

    Attributes
    ----------
    cells
        The cells with their volumes and errors.
    deepest
        (4,) unit quaternion xyzw of the sampled orientation deepest inside the set.
    depth
        Depth of this orientation, the smallest of its margins.
    """

    def __init__(self, evaluate: MarginEvaluator) -> None:
        """Divide the space of orientations into cells, and measure the set in each of them.

        `evaluate` returns margins (n, k) at unit quaternions (n, 4). The set to be measured
        consists of the orientations at which all margins are at least 0. The depth of an
        orientation is its smallest margin.
        """
        self.evaluate = evaluate
        # The deepest orientation so far, a quaternion xyzw, and its depth. The first
        # orientation that is evaluated replaces these values.
        self.deepest = np.array([0.0, 0.0, 0.0, 1.0])
        self.depth = -np.inf

        boxes = _make_first_boxes()
        measured = self._measure(boxes)
        # In an uncertain cell, the set may fill nothing or the whole cell. The volume of
        # the cell is therefore the largest possible error.
        cell_volume = _subcell_volumes(boxes).sum(axis=1)  # sum over parts of each cell
        error = np.where(measured.is_certain, 0.0, cell_volume)
        self.cells = _MeasuredCells(boxes, measured.volume, error)

    def halve(self, selected: Indices) -> None:
        """Replace some cells (k,) by their eight parts, and measure the parts."""
        whole = self.cells.rows(selected)
        boxes = _halve_boxes(whole.boxes)
        measured = self._measure(boxes)
        error = _divide_change(measured, whole.volume)
        parts = _MeasuredCells(boxes, measured.volume, error)

        # The parts come after the cells that are not halved.
        is_unchanged = np.ones(len(self.cells.volume), dtype=bool)
        is_unchanged[selected] = False
        unchanged = self.cells.rows(is_unchanged)
        self.cells = _MeasuredCells.concatenate([unchanged, parts])

    def _measure(self, boxes: _Boxes) -> _MeasuredVolumes:
        """Return the volumes of the set in n cells.

        A margin is a function of the orientation that is negative where, for example, a
        limit is exceeded. The set has the orientations at which all k margins are at least
        0. In each cell a margin is interpolated from 27 samples. A cell is outside the set
        if some margin is negative everywhere in the cell, and inside if none can be
        negative. Any other cell is divided into a grid of subcells. The part of each
        subcell that belongs to the set is estimated.

        Parameters
        ----------
        boxes
            The cells: cubic boxes in the space of orientations.
        """
        # (points, n, k): the points of each cell, the cells, the margins.
        margins = _replace_nan_margins(self._evaluate_margins(boxes))
        samples = margins[:SAMPLE_COUNT]
        # Margins at four further points, where the interpolation error is measured.
        checks = margins[SAMPLE_COUNT:]
        bounds = _bound_margins(samples, checks)  # (n, k) smallest and largest values
        is_outside = np.any(bounds.high < 0.0, axis=1)
        is_inside = np.all(bounds.low >= 0.0, axis=1)

        # (n, subcells) volume of the set in each subcell. Certain cells are empty or full.
        volumes = _subcell_volumes(boxes)
        volumes[is_outside] = 0.0
        uncertain = np.flatnonzero(~(is_outside | is_inside))
        volumes[uncertain] *= _filled_parts(samples[:, uncertain])
        return _MeasuredVolumes(volumes.sum(axis=1), is_certain=is_outside | is_inside)

    def _evaluate_margins(self, boxes: _Boxes) -> Floats:
        """Return the k margins at 31 points of each of n cells.

        A margin is a function of the orientation that is negative where, for example, a
        limit is exceeded. Neighbouring cells share points, at which margins are evaluated
        only once. `deepest` stores the orientation with the greatest depth so far. The
        depth is the smallest margin.

        Parameters
        ----------
        boxes
            The cells: cubic boxes in the space of orientations.

        Returns
        -------
        (31, n, k) margins: at a grid of 3 x 3 x 3 points in each cell, then at four other
        points, which later show the interpolation error. NaN where a margin is not defined.
        """
        point_count = len(_SAMPLE_QUARTERS)
        cell_count = len(boxes.width)
        # The space of orientations consists of four cubes, numbered from 0 to 3, by the
        # largest component of the quaternion. `points` are coordinates in a cube.
        points = _sample_points(boxes).reshape(-1, 3)
        cube_of_point = np.tile(boxes.cube, point_count)
        # Equal keys mean equal points. `first` has the number of one point for each key,
        # and `key_of_point` the index of the key for each point.
        point_keys = _point_keys(cube_of_point, points)
        _, first, key_of_point = np.unique(
            point_keys, return_index=True, return_inverse=True
        )
        quaternions = _quaternions(cube_of_point[first], points[first])
        margins = self.evaluate(quaternions)
        self._update_deepest(quaternions, margins)
        return margins[key_of_point].reshape(point_count, cell_count, -1)

    def _update_deepest(self, quaternions: Floats, margins: Floats) -> None:
        """Store the deepest of some orientations, if it is the deepest so far.

        The deepest orientation of all is a result: the place farthest inside the set
        (`Orientations.place`). The set has the orientations at which all margins are at
        least 0. A margin is a function of the orientation that is negative where, for
        example, a limit is exceeded.

        Parameters
        ----------
        quaternions
            (m, 4) unit quaternions xyzw of the orientations.
        margins
            (m, k) margins at these orientations. The depth of an orientation is the
            smallest of its k margins.
        """
        depths = smallest_margins(margins)
        best = int(np.argmax(depths))
        if depths[best] > self.depth:
            self.deepest = quaternions[best]
            self.depth = float(depths[best])


def _sample_points(boxes: _Boxes) -> Indices:
    """Return the points (31, n, 3) of n boxes at which margins are evaluated.

    A margin is a function of the orientation; its samples show whether it is 0 in a box.
    Boxes are parts of a cube with integer coordinates. The 31 points of a box have integer
    coordinates.
    """
    quarter_width = boxes.width // 4
    offsets = _SAMPLE_QUARTERS[:, None, :] * quarter_width[:, None]  # (31, n, 3)
    return boxes.corner + offsets


def _point_keys(cubes: Indices, points: Indices) -> Indices:
    """Return an integer that identifies each of m points in the space of orientations.

    The space consists of four cubes of quaternions, which are divided into cells. Several
    cells share points, such as their corners. They are found by equal integers, so that
    margins are evaluated only once there.

    Parameters
    ----------
    cubes
        (m,) indices of the cubes that contain the points. There are four cubes, one for
        each component of a quaternion that can be the largest.
    points
        (m, 3) integer coordinates in the cube.

    Returns
    -------
    (m,) index of each point in an array with the axes cube, x, y and z.
    """
    x, y, z = points.T
    return np.ravel_multi_index((cubes, x, y, z), (4, *CUBE_POINTS))


def _replace_nan_margins(margins: Floats) -> Floats:
    """Return the margins with numbers in place of NaN, so that they can be interpolated.

    A margin is a function of the orientation that is negative outside of the set to be
    measured, and NaN where it is not defined. A point with NaN is outside of the set. There
    are two cases:

    - No other margin is negative at the point. The NaN becomes -1, so that it excludes the
      point from the set.
    - Another margin is negative at the point, and excludes it already. The NaN becomes the
      largest value that its margin has in the cell, or 1 if there is none. With -1,
      interpolation between this point and points with positive values would give a false
      border of the set.

    For example, two margins have the values (0.5, 2), (NaN, 3) and (NaN, -1) at three
    points of a cell. The NaN of the second point becomes -1, that of the third one 0.5.

    Parameters
    ----------
    margins
        (points, n, k) k margins at several points of each of n cells.

    Returns
    -------
    (points, n, k) margins without NaN.
    """
    # (n, k) largest value of each margin in each cell. `fmax` ignores NaN.
    largest_in_cell = np.nan_to_num(np.fmax.reduce(margins, axis=0), nan=1.0)
    # (points, n, 1) whether a margin is negative at the point.
    is_excluded = np.any(margins < 0.0, axis=2, keepdims=True)
    replacements = np.where(is_excluded, largest_in_cell, -1.0)  # (points, n, k)
    return np.where(np.isnan(margins), replacements, margins)


def _bound_margins(samples: Floats, checks: Floats) -> _MarginRange:
    """Return lower and upper bounds of k margins in each of n cells.

    A margin is a function of the orientation that is negative where, for example, a limit
    is exceeded. In a cell each margin is interpolated by a polynomial of degree 2 in each
    coordinate. The bounds are those of the polynomial, widened by an estimate of the
    interpolation error.

    Parameters
    ----------
    samples
        (27, n, k) margins at a grid of 3 x 3 x 3 points of each cell.
    checks
        (4, n, k) margins at four other points of each cell. `_CHECK_QUARTERS` has their
        coordinates, in quarters of the width of the cell.
    """
    # A polynomial stays between its smallest and largest Bernstein coefficients.
    bernstein = np.tensordot(_CUBE_BERNSTEIN, samples, axes=1)
    # The interpolation error is estimated as the largest one at the check points, times a
    # safety factor.
    at_checks = np.tensordot(_interpolation_matrix(_CHECK_QUARTERS / 4.0), samples, axes=1)
    slack = VALUE_SAFETY_FACTOR * max_abs(at_checks - checks, axis=0)
    return _MarginRange(
        low=bernstein.min(axis=0) - slack, high=bernstein.max(axis=0) + slack
    )


def _filled_parts(samples: Floats) -> Floats:
    """Return which fraction of each subcell of n cells belongs to the orientation set.

    A cell is a cube, divided into SUBCELLS_PER_SIDE equal subcells along each side. A
    margin is a function that is at least 0 in the set. For each margin, the fraction of the
    subcell in which the margin is positive is estimated. The set is where all margins are
    positive, so its fraction is at most the smallest of these, which is returned.

    Parameters
    ----------
    samples
        (27, n, k) the k margins at the 27 sample points of each cell. In the set all
        margins are at least 0.

    Returns
    -------
    (n, SUBCELL_COUNT) fractions from 0 to 1.
    """
    cell_count, margin_count = samples.shape[1:]
    parts = np.empty((cell_count, SUBCELL_COUNT))
    # Chunks of cells limit the memory.
    chunk_count = cell_count * margin_count // VALUES_PER_CHUNK + 1
    for chunk in np.array_split(np.arange(cell_count), chunk_count):
        # One column for each margin in each cell, with its 27 samples.
        columns = samples[:, chunk].reshape(SAMPLE_COUNT, -1)
        by_margin = _filled_fractions(columns).reshape(
            SUBCELL_COUNT, len(chunk), margin_count
        )
        parts[chunk] = by_margin.min(axis=2).T
    return parts


def _filled_fractions(polynomials: Floats) -> Floats:
    """Return the fraction of each subcell of a cell in which a polynomial is positive.

    The polynomial interpolates a margin, a function that is positive inside a set of
    orientations. A cell is divided into subcells. The fraction is estimated as 1/2 + f / S,
    limited to the range from 0 to 1. Here f is the value at the centre of the subcell, and
    S the difference between its largest and smallest values. The estimate treats the
    polynomial as linear. For polynomials that are not linear, `_curvature_correction` is
    added.

    Parameters
    ----------
    polynomials
        (27, m) values of m polynomials at the 27 sample points of their cells.

    Returns
    -------
    (SUBCELL_COUNT, m) fractions from 0 to 1.
    """
    # Fractions do not depend on the size of a polynomial. Its largest value is brought near
    # 1 by a power of two, without rounding, so that no square overflows or vanishes.
    _, exponents = np.frexp(max_abs(polynomials, axis=0))
    polynomials = np.ldexp(polynomials, -exponents)
    centre_value = _AT_CENTRES @ polynomials  # (subcells, m)
    mean_value = _SUBCELL_MEANS @ polynomials  # (subcells, m)
    # (3, subcells, m) how much the polynomial changes over a subcell along each edge. A
    # linear polynomial has its largest and smallest values at opposite corners. Three edges
    # lead from one to the other, so their changes add up to S.
    changes = np.abs(_CHANGES @ polynomials)
    value_range = changes.sum(axis=0)
    squared_gradient = np.sum(changes**2, axis=0)
    # The mean of a linear polynomial is its value at the centre. The difference shows how
    # strongly the polynomial is curved.
    mean_difference = mean_value - centre_value
    with np.errstate(all="ignore"):
        correction = _curvature_correction(mean_difference, value_range, squared_gradient)
        fraction = 0.5 + (centre_value / value_range + correction)
        fraction = np.clip(fraction, 0.0, 1.0)
        # A constant polynomial fills the subcell or leaves it empty.
        is_filled = centre_value >= 0.0
        return np.where(squared_gradient > 0.0, fraction, is_filled)


def _curvature_correction(
    mean_difference: Floats, value_range: Floats, squared_gradient: Floats
) -> Floats:
    """Return the corrections d S / g^2 of fractions of subcells at a curved border.

    Cells of the space of orientations are divided into subcells. `_filled_fractions`
    estimates the fraction of a subcell in which a polynomial is positive as 1/2 + f / S.
    Here f is the value at the centre, and S the range of values in the subcell. The border
    is where the polynomial is 0. At a plane border the sum over all subcells is right. At a
    curved border the sum needs this correction, which assumes that the gradient has the
    same length on both sides of the border.

    Parameters
    ----------
    mean_difference
        (...,) d, mean of the polynomial over the subcell minus its value at the centre.
    value_range
        (...,) S, difference of its largest and smallest values in the subcell.
    squared_gradient
        (...,) g^2, square of its gradient. The width of a subcell is the unit of length.

    Returns
    -------
    (...,) corrections of the fractions.

    Notes
    -----
    V(t) is the volume in which f > t. V(0) is to be computed. The border f = t has the area
    A. Primes denote derivatives with respect to t. L is the Laplacian of f. The subcell is
    a unit cube.

    1. Let t take all values from -S/2 to S/2. The fraction 1/2 + f / S of these values is
       smaller than f at the centre of a subcell. For one t, the number of centres with
       f > t is about V(t), because each subcell has the volume 1. So the sum of the
       fractions of all subcells is the mean of V(t) over all t. By the Taylor series
       V(0) + V' t + V'' t^2 / 2, this mean is V(0) + V'' S^2 / 24. The last term is the
       error of the sum.
    2. If t rises by dt, the border moves by dt / g along its unit normal, so V' = -A / g.
       The area of a moving surface grows per distance by A times the divergence of the
       unit normal. The normal is the gradient divided by g. As g is assumed constant, the
       divergence is L / g. So A' = A L / g^2, and with constant g V'' = -A L / g^3. The sum
       is too small by A L S^2 / (24 g^3).
    3. The Laplacian follows from d, because the mean of f over a unit cube exceeds the
       value at its centre by L / 24. So the sum is too small by A d S^2 / g^3.
    4. Subcells with fractions between 0 and 1 have f from -S/2 to S/2 at their centres.
       They form a layer at the border with the thickness S / g and the volume A S / g. They
       share the correction, so each gets d S / g^2.
    """
    return mean_difference * value_range / squared_gradient


def _quaternions(cube: Indices, points: Array) -> Floats:
    """Return the orientations at grid points, as unit quaternions (n, 4) xyzw.

    An orientation belongs to one of four cubes. The number of the cube is the position of
    the largest component (in magnitude) of its quaternion. The quaternion is divided by
    this component, which becomes 1. The orientation stays the same, even if the component
    is negative: q and -q are the same orientation. The other three components are then from
    -1 to 1. They are the coordinates in the cube.

    Parameters
    ----------
    cube
        (n,) indices of the cubes: the position of the largest component, from 0 to 3.
    points
        (n, 3) integer coordinates from 0 to 2**CUBE_BITS, which stand for -1 to 1.
    """
    quaternions = np.ones((len(cube), 4))
    # The mask selects three components in each row, for the three coordinates of the point.
    coordinates = points.ravel() * 2.0 ** (1 - CUBE_BITS) - 1.0
    quaternions[np.arange(4) != cube[:, None]] = coordinates
    return unit_rows(quaternions)


def _subcell_volumes(boxes: _Boxes) -> Floats:
    """Return the volumes (n, SUBCELL_COUNT) of the subcells of n cells.

    Each cell is divided into SUBCELLS_PER_SIDE equal parts along each side. An orientation
    is a unit quaternion, divided by its largest component. The other components x, y, z,
    from -1 to 1, are coordinates in one of four cubes. In each cube the volume element is
    8 / (1 + x^2 + y^2 + z^2)^2 dx dy dz. The factor 8 is a choice of unit: the volume of
    all orientations is 8 pi^2.

    The volume of a subcell is computed from the volume element at its centre. The volumes
    are then scaled, so that their sum is the volume of the cell by Gauss's rule. Gauss's
    rule is far more accurate than the sum of the unscaled volumes. The caller adds up the
    parts of the subcells that belong to a set of orientations.
    """
    # The coordinates of boxes are integers from 0 to 2**CUBE_BITS. They are converted to
    # coordinates from -1 to 1. The axes of the arrays are cell, point and coordinate.
    unit = 2.0 ** (1 - CUBE_BITS)
    corner = boxes.corner[:, None] * unit - 1.0
    width = boxes.width[:, None, None] * unit

    def density(points: Floats) -> Floats:
        """Return the volume element (n, m) at coordinates (m, 3) from 0 to 1 in cells."""
        x = corner + points * width
        return 8.0 / (1.0 + np.vecdot(x, x)) ** 2

    at_centres = density(_SUBCELL_CENTRES)  # (n, SUBCELL_COUNT)
    mean_density = density(_CUBE_GAUSS_POINTS) @ _CUBE_GAUSS_WEIGHTS  # (n,)
    cell_volume = mean_density * width[:, 0, 0] ** 3
    scale = cell_volume / at_centres.sum(axis=1)
    return at_centres * scale[:, None]
