"""The point of a border nearest to a given one."""

import numpy as np
from numpy.polynomial import chebyshev

from spherekit.numeric.brackets import bracketed_zeros
from spherekit.region.border import ORDERS, BoundarySegments, nodes
from spherekit.region.constraint_functions import Evaluator, least
from spherekit.region.mesh import Indices
from spherekit.sphere.rotation import Floats, arc

SLACK = 1e4
"""A point is in the region if no margin is below 0 by more than this times rounding."""
STEPS = 32
"""Steps along a piece between which its distance has one least value at most."""


def nearest_on(border: BoundarySegments, evaluate: Evaluator, place: Floats) -> Floats:
    """Return the point (3,) of pieces of a border nearest to a direction (3,).

    The pieces that can hold it are found anew at the highest order; there the distance's
    slope, exact for the polynomial through the nodes, is 0, or the point is an end. Of a
    piece that is not found only the ends count.
    """
    chords = border.chords
    far = np.empty(len(border.margin))
    for order in ORDERS:
        some = np.flatnonzero(border.order == order)
        gap = arc(border.points(some, order), place)
        far[some] = np.min(gap, axis=1)
    near = np.flatnonzero(far - chords.length <= np.min(far))
    ends = border.chord_ends(near)
    sought = np.ones(len(near), dtype=bool)
    pieces = BoundarySegments.over(
        evaluate, ends[:, 0], ends[:, 1], border.margin[near], sought
    )
    while np.any(rough := pieces.sound & (pieces.order < ORDERS[-1])):
        pieces.raise_order(evaluate, np.flatnonzero(rough))
    series = chebyshev.chebfit(nodes(ORDERS[-1]), pieces.height.T, ORDERS[-1])
    slopes = chebyshev.chebder(series)
    frames = pieces.chords
    length = frames.length
    parts = np.stack(
        [vectors @ place for vectors in (frames.start, frames.along, frames.left)]
    )

    def rise(u: Floats, which: Indices) -> Floats:
        """Return the slope by u of the cosine of the distance."""
        angle = 0.5 * length[which] * (1.0 + u)
        height = np.sum(chebyshev.chebvander(u, ORDERS[-1]) * series[:, which].T, axis=1)
        slope = np.sum(chebyshev.chebvander(u, ORDERS[-1] - 1) * slopes[:, which].T, axis=1)
        start, along, left = parts[:, which]
        flat = np.cos(angle) * start + np.sin(angle) * along
        turn = np.cos(angle) * along - np.sin(angle) * start
        bend = np.cos(height) * left - np.sin(height) * flat
        return np.asarray(slope * bend + 0.5 * length[which] * np.cos(height) * turn)

    u = np.linspace(-1.0, 1.0, STEPS + 1)
    every = np.repeat(np.arange(len(near)), len(u))
    slope = rise(np.tile(u, len(near)), every).reshape(len(near), -1)
    piece, step = np.nonzero((slope[:, :-1] >= 0.0) & (slope[:, 1:] < 0.0))
    zero, _ = bracketed_zeros(
        lambda x, which: rise(x, piece[which]),
        u[step],
        u[step + 1],
        slope[piece, step],
        slope[piece, step + 1],
    )
    height = np.sum(chebyshev.chebvander(zero, ORDERS[-1]) * series[:, piece].T, axis=1)
    feet = frames.rows(piece).at(zero, height)[pieces.sound[piece]]
    points = np.concatenate([feet, *np.moveaxis(ends, 1, 0)])
    held = least(evaluate(points)) >= -SLACK * np.max(evaluate.floor)
    points = points[held] if held.any() else points
    return np.asarray(points[np.argmin(arc(points, place))])
