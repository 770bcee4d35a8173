"""A curve of singular configurations of a mechanism with two freedoms."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import Status
from spherekit.motion.turns import less_periods
from spherekit.numeric.brackets import bracketed_zeros
from spherekit.numeric.hermite import cubic, cubic_slope
from spherekit.singular.locus import Locus, LocusPoints
from spherekit.sphere.rotation import Floats

GAUSS = np.polynomial.legendre.leggauss(8)
NEAR = 1e-7
"""Configurations (rad) nearer than this to the curve lie on it."""
BESIDE = 0.3
"""The curve is nowhere farther from the chord of two nodes than this part of it."""
NOTHING = 1e-6
"""A function smaller than this at two nodes is taken to vanish between them."""

Along = Callable[[LocusPoints], Floats]
"""A function (n,) of points of a curve."""


@final
@dataclass(frozen=True)
class SingularCurve:
    """A curve of a locus through verified nodes, in the arc length of the variables.

    Attributes
    ----------
    locus
        What the curve consists of.
    nodes
        The nodes in order, tangents running along; those of a closed curve end with the
        first one, its variables grown by whole periods.
    periods
        (V,) growth of each variable that changes nothing.
    closed
        Whether the curve closes.
    ends
        Why it goes no further at its start and at its end: OK if it is closed or the
        greatest length was reached, AT_SINGULARITY where curves cross, OFF_PROFILE,
        MODE_LOST.
    """

    locus: Locus
    nodes: LocusPoints
    periods: Floats
    closed: bool
    ends: tuple[Status, Status]

    @cached_property
    def chords(self) -> Floats:
        """Lengths (n - 1,) of the chords (rad)."""
        return np.asarray(np.linalg.norm(np.diff(self.nodes.values, axis=0), axis=1))

    @cached_property
    def directions(self) -> Floats:
        """Unit vectors (n - 1, V) of the chords."""
        return np.diff(self.nodes.values, axis=0) / self.chords[:, None]

    @cached_property
    def s(self) -> Floats:
        """Arc lengths (n,) of the nodes (rad), of the Hermite polynomials through them."""
        places, weights = GAUSS
        x = 0.5 * (places + 1.0)[:, None]
        tangents = self.nodes.tangents[:, :, 0]
        chords, values = self.chords[:, None, None], self.nodes.values[:, None]
        start, stop = (values[:-1], tangents[:-1, None]), (values[1:], tangents[1:, None])
        speed = cubic_slope(start, stop, chords, x)
        lengths = np.linalg.norm(speed, axis=2) @ (0.5 * weights) * self.chords
        return np.concatenate([[0.0], np.cumsum(lengths)])

    @property
    def length(self) -> float:
        """The arc length of the curve, of one lap if it is closed (rad)."""
        return float(self.s[-1])

    def on(self, which: NDArray[np.intp], parts: Floats) -> LocusPoints:
        """Return the points whose projections divide chords `which` (n,) at parts (n,)."""
        direction, nodes = self.directions[which], self.nodes
        values, motions = predict(nodes, which, parts)
        targets = np.sum(direction * nodes.values[which], axis=1)
        targets += parts * self.chords[which]
        points = self.locus.correct(
            values, motions, direction[:, None], targets[:, None], nodes.basis[which]
        )
        sense = np.sum(points.tangents[:, :, 0] * direction, axis=1)
        flip = np.where(sense < 0.0, -1.0, 1.0)[:, None, None]
        points.tangents[:] *= flip
        points.turns[:] *= flip
        return points

    def find(self, values: Floats, motions: Floats) -> NDArray[np.bool_]:
        """Return which configurations (n, V) with their singular motions are on the curve.

        Whole periods of the variables and signs of the motions do not matter.
        """
        on_curve = np.zeros(len(values), dtype=bool)
        middles = self.nodes.values[:-1] + 0.5 * self.chords[:, None] * self.directions
        away = less_periods(values[:, None] - middles, self.periods)
        along = np.sum(away * self.directions, axis=2)
        beside = np.max(np.abs(away - along[..., None] * self.directions), axis=2)
        near = np.abs(along) < 0.51 * self.chords
        row, which = np.nonzero(near & (beside < BESIDE * self.chords + NEAR))
        parts = np.clip(along[row, which] / self.chords[which] + 0.5, 0.0, 1.0)
        points = self.on(which, parts)
        miss = np.max(np.abs(middles[which] + away[row, which] - points.values), axis=1)
        same = np.abs(np.sum(points.motions * motions[row], axis=1)) > 1.0 - 1e-6
        on_curve[row[(miss < NEAR) & same]] = True
        return on_curve

    def zeros(self, function: Along) -> LocusPoints:
        """Return the points at which a function of points changes its sign.

        Those between the same two nodes are missed if they are two; a function that is
        zero to rounding has no zeros.
        """
        value = function(self.nodes)
        # Bases go on from node to node; those of the last one may be of the first.
        value[-1] = function(self.on(np.array([len(value) - 2]), np.ones(1)))[0]
        clear = np.maximum(np.abs(value[:-1]), np.abs(value[1:])) > NOTHING
        (which,) = np.nonzero(clear & ((value[:-1] >= 0.0) != (value[1:] >= 0.0)))
        part, _ = bracketed_zeros(
            lambda x, some: function(self.on(which[some], x)),
            np.zeros(len(which)),
            np.ones(len(which)),
            value[which],
            value[which + 1],
            tolerance=1e-14,
        )
        return self.on(which, part)

    def cusps(self) -> LocusPoints:
        """Return where the locus has a cusp in the plane of what stands still.

        There the singular motion runs along the curve: seen in the inputs (type II) or at
        the output (type I) the curve turns back.
        """
        if self.locus.motions < self.locus.freedoms:
            return self.nodes.rows(np.zeros(0, dtype=np.intp))

        def side(points: LocusPoints) -> Floats:
            ways = np.stack([points.motions, points.tangents[:, :, 0]], axis=2)
            basis = points.basis[:, :, self.locus.freedoms :]
            return np.asarray(np.linalg.det(np.swapaxes(basis, 1, 2) @ ways))

        return self.zeros(side)


def predict(
    nodes: LocusPoints, which: NDArray[np.intp], parts: Floats
) -> tuple[Floats, Floats]:
    """Return Hermite values of the variables and motions, (n, V) each.

    Their projections on the chords after nodes `which` (n,) are at `parts` (n,), 0 to 1.
    """
    ahead = which + 1
    way = nodes.values[ahead] - nodes.values[which]
    chord = np.linalg.norm(way, axis=1, keepdims=True)
    x = parts[:, None]
    guesses = []
    for what, rates in ((nodes.values, nodes.tangents), (nodes.motions, nodes.turns)):
        ends = []
        for node in (which, ahead):
            speed = np.sum(nodes.tangents[node, :, 0] * way, axis=1, keepdims=True)
            ends.append((what[node], rates[node, :, 0] * (chord / speed)))
        guesses.append(cubic(ends[0], ends[1], chord, x))
    return guesses[0], guesses[1]
