"""Pieces of a region's border: graphs over chords, with the area beside each chord.

A chord is the arc of a great circle between two points of the border. Over it the border
is a curve of height h(u) towards the region, u from -1 to 1 along the chord, and the area
between both is the integral of sin h by the arc of the chord, exactly.
"""

from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np
from numpy.polynomial import chebyshev

from spherekit.arrays import Bools, Floats, Indices
from spherekit.geometry.region_margins import Evaluator, active, chosen, least
from spherekit.geometry.rotation import cross, max_abs, nans, unit_rows
from spherekit.geometry.triangle import arc
from spherekit.numerics.array_rows import ArrayRows
from spherekit.numerics.bracketed_zeros import bracketed_zeros
from spherekit.numerics.chebyshev import real_zeros
from spherekit.numerics.least_squares import descent
from spherekit.tolerances import EPS

ORDERS = (1, 4, 8, 16)
"""Steps between the nodes of a piece, doubled until its area is known well enough; 1 for
the chord of a piece that was not found."""
HIGHEST = 0.4
"""A piece higher than this part of its chord is cut first."""
SHORTEST = 1e-11
"""Chords shorter than this (rad) are the border themselves."""
AUDIT = 16
"""Steps along a piece at which the other margins are looked at."""


def chord_frames(start: Floats, end: Floats) -> Floats:
    """Return the frames (n, 3, 3) of chords: rows to the start, ahead, and to the left."""
    side = cross(start, end - start)
    size = np.linalg.norm(side, axis=1, keepdims=True)
    left = side / np.where(size > 0.0, size, 1.0)
    return np.stack([start, cross(left, start), left], axis=1)


def beside(frames: Floats, length: Floats, u: Floats, height: Floats) -> Floats:
    """Return the points (n, ..., 3) at u and heights (n, ...) of chords (n,)."""
    angle = 0.5 * np.expand_dims(length, (*range(1, np.ndim(height)),)) * (1.0 + u)
    level = np.cos(height)
    weights = [level * np.cos(angle), level * np.sin(angle), np.sin(height)]
    return np.einsum("n...i,nij->n...j", np.stack(weights, axis=-1), frames)


@cache
def nodes(order: int) -> Floats:
    """Return the places u (order + 1,) of the nodes, both ends included."""
    return -np.cos(np.arange(order + 1) * np.pi / order)


@cache
def coefficients(order: int) -> Floats:
    """Return the matrix from values at the nodes to coefficients of Chebyshev's series."""
    return np.asarray(np.linalg.inv(chebyshev.chebvander(nodes(order), order)), float)


@cache
def weights(order: int) -> Floats:
    """Return the weights (order + 1,) of Clenshaw and Curtis for the nodes."""
    return 2.0 / (1.0 - np.arange(0, order + 1, 2) ** 2.0) @ coefficients(order)[::2]


def between(order: int, u: Floats) -> Floats:
    """Return the matrix (m, order + 1) from values at the nodes to those at u (m,)."""
    return chebyshev.chebvander(u, order) @ coefficients(order)


@dataclass
class BoundarySegments(ArrayRows):
    """Pieces (n,) of the border over chords: what bounds them and their heights.

    `frames` (n, 3, 3) and `length` (n,) rad are those of the chords, see `chord_frames`.
    `margin` is the number of the margin that is 0 on each, `height` (n, 17) are the
    heights at the nodes of the piece's own `order`, the first `order` + 1 of them.
    `area` is the part of the region cut off by the chord, `error` what halving the order
    changes, `sound` whether the piece was found and no other margin is negative on it;
    those that are not are their chords.
    `owner` is the triangle that it is in, `start` and `stop` are the crossings between
    which the border runs there, and of two pieces that make a corner one is `leading`.
    """

    frames: Floats
    length: Floats
    margin: Indices
    owner: Indices
    start: Indices
    stop: Indices
    leading: Bools
    sound: Bools
    order: Indices
    height: Floats
    area: Floats
    error: Floats

    @staticmethod
    def over(
        evaluate: Evaluator,
        ends: tuple[Floats, Floats],
        margin: Indices,
        place: tuple[Indices, Indices, Indices, Bools],
        sought: Bools,
    ) -> "BoundarySegments":
        """Return the pieces between points (n, 3) of the border, of the lowest order.

        `place` are owner, start, stop and leading. Those not `sought` (n,) are their
        chords, and not sound.
        """
        n = len(margin)
        pieces = BoundarySegments(
            chord_frames(*ends),
            arc(*ends),
            margin,
            *place,
            sought,
            np.full(n, ORDERS[0]),
            np.zeros((n, ORDERS[-1] + 1)),
            *np.zeros((2, n)),
        )
        pieces.raise_order(evaluate, np.flatnonzero(sought))
        return pieces

    def raise_order(self, evaluate: Evaluator, which: Indices) -> None:
        """Bring some pieces to the next order, all of them below the highest."""
        orders = self.order[which]
        for before, order in pairwise(ORDERS):
            some = which[orders == before]
            heights = nans((len(some), order + 1))
            heights[:, :: order // before] = self.height[some, : before + 1]
            self._measure(evaluate, some, order, heights)

    def _measure(
        self, evaluate: Evaluator, which: Indices, order: int, height: Floats
    ) -> None:
        """Find the heights (m, order + 1) that are NaN, and the areas with them."""
        length = self.length[which]
        long = length > SHORTEST
        height[~long] = 0.0
        row, node = np.nonzero(np.isnan(height))
        height[row, node], sound = self._heights(evaluate, which[row], nodes(order)[node])
        halved, area = (
            -0.5 * length * (np.sin(height[:, :: order // steps]) @ weights(steps))
            for steps in (order // 2, order)
        )
        self.error[which] = np.abs(area - halved) + EPS * length + ~long * length**2
        self.area[which], self.order[which] = area, order
        self.height[which, : order + 1] = height
        self._straighten(which[np.unique(row[~sound])])

    def _straighten(self, which: Indices) -> None:
        """Take pieces that are not found for their chords."""
        self.sound[which], self.order[which] = False, ORDERS[0]
        self.height[which], self.area[which] = 0.0, 0.0

    def _heights(
        self, evaluate: Evaluator, chord: Indices, u: Floats
    ) -> tuple[Floats, Bools]:
        """Return heights (m,) where margins are 0 over places of chords, and whether found.

        They are sought within a parabola over the chord; the margin has to rise to the
        left, and no other may be negative there.
        """
        number = self.margin[chord]
        widest = HIGHEST * self.length[chord] * (1.0 - u * u)

        def rows(part: Floats, which: Indices) -> Floats:
            return evaluate(self._at(chord[which], u[which], part * widest[which]))

        def value(part: Floats, which: Indices) -> Floats:
            return chosen(rows(part, which), number[which])

        ends = np.repeat([-1.0, 1.0], len(u))
        right, left = value(ends, np.tile(np.arange(len(u)), 2)).reshape(2, -1)
        sound = (right < 0.0) & (left >= 0.0)
        some = np.flatnonzero(sound)
        part = np.zeros(len(u))
        part[some], _ = bracketed_zeros(
            lambda part, which: value(part, some[which]),
            -np.ones(len(some)),
            np.ones(len(some)),
            right[some],
            left[some],
            EPS / widest[some],
        )
        others = rows(part[some], some)
        kept = np.arange(others.shape[1]) == number[some][:, None]
        sound[some] &= ~np.any((others < -evaluate.floor) & ~kept, axis=1)
        return part * widest, sound

    def audit(self, evaluate: Evaluator, which: Indices) -> None:
        """Straighten pieces, as they are made, on which another margin dips below 0.

        What a margin exceeds the piece's own by, which is 0 on the border, is taken as a
        parabola through every three samples.
        """
        u = np.linspace(-1.0, 1.0, AUDIT + 1)
        height = self.height[which, : ORDERS[1] + 1] @ between(ORDERS[1], u).T
        rows = evaluate(self._at(which, u, height).reshape(-1, 3))
        margin = chosen(rows, np.repeat(self.margin[which], len(u)))
        rows = (rows - margin[:, None]).reshape(len(which), len(u), rows.shape[1])
        a, b, c = rows[:, :-2], rows[:, 1:-1], rows[:, 2:]
        bend, slope = a - 2.0 * b + c, 0.5 * (c - a)
        with np.errstate(all="ignore"):
            turn = -slope / bend
            lowest = np.where(np.abs(turn) < 1.0, b + 0.5 * slope * turn, b)
            dips = np.any(np.minimum(lowest, b) < -evaluate.floor, axis=(1, 2))
        self._straighten(which[dips])

    def _at(self, which: Indices, u: Floats, height: Floats) -> Floats:
        return beside(self.frames[which], self.length[which], u, height)

    @property
    def ends(self) -> Floats:
        """Both ends (n, 2, 3) of the chords."""
        return beside(
            self.frames, self.length, np.array([-1.0, 1.0]), np.zeros((len(self.length), 2))
        )

    def points(self, which: Indices) -> tuple[Floats, Indices]:
        """Return the nodes (m, 3) of pieces (k,) in order, and each's place in these."""
        step = ORDERS[-1] // self.order[which, None]
        piece, place = np.nonzero(np.arange(ORDERS[-1] + 1) % step == 0)
        chord = which[piece]
        height = self.height[chord, place // step[piece, 0]]
        return self._at(chord, nodes(ORDERS[-1])[place], height), piece

    def curve(self, chain: Indices) -> Floats:
        """Return the nodes (m, 3) of pieces that follow one another."""
        points, piece = self.points(chain)
        return points[np.diff(piece, prepend=0) == 0]


DIFFERENCE = 1e-6
"""Steps by which slopes of margins are found, as part of the chord."""
BEYOND = 1e-7
"""Where the smallest margin is exactly 0, the one that ends the region is looked for this
much farther on, as part of the edge."""
FARTHEST = 4.0
"""A corner farther from its chord than this times the chord's arc is not its corner."""


def along(start: Floats, end: Floats, angle: Floats) -> Floats:
    """Return the points (n, 3) at angles (rad) from `start` on the arcs to `end`."""
    toward = unit_rows(cross(cross(start, end - start), start))
    return np.cos(angle)[:, None] * start + np.sin(angle)[:, None] * toward


def crossings(
    evaluate: Evaluator, inside: Floats, outside: Floats
) -> tuple[Floats, Indices]:
    """Return where arcs (n,) from inside to outside leave the region, and by which margin.

    `inside` and `outside` are (n, 3); the second array holds the margins' numbers.
    """
    length = arc(inside, outside)

    def rows(angle: Floats, which: Indices) -> Floats:
        return evaluate(along(inside[which], outside[which], angle))

    every, zero = np.arange(len(length)), np.zeros(len(length))
    place, beyond = bracketed_zeros(
        lambda angle, which: least(rows(angle, which)),
        zero,
        length,
        least(evaluate(inside)),
        least(evaluate(outside)),
        EPS,
    )
    at = least(rows(place, every))
    after = rows(np.where(at == 0.0, place + BEYOND * length, beyond), every)
    return along(inside, outside, place), active(after, evaluate.floor)


def corners(
    evaluate: Evaluator, start: Floats, end: Floats, pair: Indices
) -> tuple[Floats, Bools]:
    """Return points (n, 3) near chords, and whether two margins are 0 at them.

    By least squares in the tangent plane, with slopes by differences: `start` and `end`
    (n, 3) are the ends of the chords, where the first and the second margin of each
    `pair` (n, 2) of numbers are 0.
    """
    first, length = unit_rows(start + end), arc(start, end)
    toward = unit_rows(cross(cross(start, end - start), first))
    frame = np.stack([toward, cross(first, toward)], axis=1) * length[:, None, None]

    def places(x: Floats, which: Indices) -> Floats:
        """Return the points (k, m, 3) at places (k, m, 2) of the tangent planes."""
        return unit_rows(x @ frame[which] + first[which, None])

    def residuals(x: Floats, which: Indices) -> tuple[Floats, Floats]:
        beside = x[:, None] + DIFFERENCE * np.eye(3, 2, -1)
        rows = evaluate(places(beside, which).reshape(-1, 3))
        numbers = np.repeat(pair[which], 3, axis=0).T
        value = np.stack([chosen(rows, number) for number in numbers], axis=1).reshape(
            -1, 3, 2
        )
        slope = (value[:, 1:] - value[:, :1]) / DIFFERENCE
        return value[:, 0], np.swapaxes(slope, 1, 2)

    x, squares = descent(residuals, np.zeros((len(start), 2)), -FARTHEST, FARTHEST)
    sound = np.sqrt(squares) <= SLACK * np.max(evaluate.floor)
    sound &= max_abs(x, axis=1) < FARTHEST
    return places(x[:, None], np.arange(len(x)))[:, 0], sound


SLACK = 1e4
"""A point is in the region if no margin is below 0 by more than this times rounding."""


def nearest_on(border: BoundarySegments, evaluate: Evaluator, place: Floats) -> Floats:
    """Return the point (3,) of pieces of a border nearest to a direction (3,).

    The pieces that can hold it are brought to the highest order; there the slope of
    the distance's polynomial is 0, or the point is an end. Of a piece that is not found
    only the ends count.
    """
    far = np.min(arc(border.ends, place), axis=1)
    pieces = border.rows(far - border.length <= np.min(far))
    while np.any(rough := pieces.sound & (pieces.order < ORDERS[-1])):
        pieces.raise_order(evaluate, np.flatnonzero(rough))
    candidates = [pieces.ends.reshape(-1, 3)]
    for piece in np.flatnonzero(pieces.sound)[:, None]:
        cosine = np.vecdot(pieces.points(piece)[0], place)
        u = real_zeros(chebyshev.chebder(coefficients(ORDERS[-1]) @ cosine))
        height = pieces.height[piece] @ between(ORDERS[-1], u).T
        candidates.append(pieces._at(piece, u, height)[0])
    points = np.concatenate(candidates)
    held = least(evaluate(points)) >= -SLACK * np.max(evaluate.floor)
    points = points[held] if held.any() else points
    return points[np.argmin(arc(points, place))]
