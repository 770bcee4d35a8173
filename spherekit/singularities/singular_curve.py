"""One curve of singular configurations of a mechanism with two inputs."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.geometry.vectors import max_abs
from spherekit.numerics.bracketed_zeros import find_bracketed_zeros
from spherekit.positions.configuration_curve import NEAR, Chords
from spherekit.positions.curve_segment import CurvePoints
from spherekit.singularities.slices import LocusPoints, SingularityLocus
from spherekit.status import Status

GAUSS = np.polynomial.legendre.leggauss(8)


NOTHING = 1e-6
"""A function smaller than this at two nodes is taken to vanish between them."""


Along = Callable[[LocusPoints], Floats]
"""A function (n,) of points of a curve."""


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

    locus: SingularityLocus
    nodes: LocusPoints
    periods: Floats
    closed: bool
    ends: tuple[Status, Status]

    @cached_property
    def chord(self) -> Chords:
        """The chords between the nodes."""
        return Chords(_plain(self.nodes))

    @cached_property
    def s(self) -> Floats:
        """Arc lengths (n,) of the nodes (rad), of the Hermite polynomials through them."""
        tangents = self.nodes.tangents[:, None, :, 0]
        start = tangents[:-1]
        chord = self.chord.directions[:, None]
        places, weights = GAUSS
        x = 0.5 * (places[:, None] + 1.0)
        bent = start + tangents[1:] - 2.0 * chord
        speed = start + x * (2.0 * (chord - start - bent) + 3.0 * x * bent)
        lengths = np.linalg.norm(speed, axis=2) @ (0.5 * weights) * self.chord.chords
        return np.append(0.0, np.cumsum(lengths))

    def on(self, which: Indices, parts: Floats) -> LocusPoints:
        """Return the points whose projections divide chords `which` (n,) at parts (n,)."""
        chord, nodes, ahead = self.chord, self.nodes, which + 1
        direction = chord.directions[which]
        length = chord.chords[which]
        turning = nodes.motions[ahead] - nodes.motions[which]
        motions = nodes.motions[which] + parts[:, None] * turning
        targets = np.vecdot(direction, nodes.values[which]) + parts * length
        points = self.locus.correct(
            chord.predict(which, parts),
            motions,
            direction[:, None],
            targets[:, None],
            nodes.basis[which],
        )
        return _turned(
            points,
            np.where(np.vecdot(points.tangents[:, :, 0], direction) < 0.0, -1.0, 1.0),
        )

    def find(self, values: Floats, motions: Floats) -> Bools:
        """Return which configurations (n, V) with their singular motions are on the curve.

        Whole periods of the variables and signs of the motions do not matter.
        """
        row, which, away, along = self.chord.beside(values, self.periods)
        points = self.on(which, along / self.chord.chords[which])
        miss = max_abs((self.nodes.values[which] + away) - points.values, axis=1)
        same = np.abs(np.vecdot(points.motions, motions[row])) > 1.0 - 1e-6
        return np.isin(np.arange(len(values)), row[(miss < NEAR) & same])

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
        part, _ = find_bracketed_zeros(
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
            return self.nodes.rows(slice(0))

        def side(points: LocusPoints) -> Floats:
            ways = np.stack([points.motions, points.tangents[:, :, 0]], axis=2)
            return np.linalg.det(
                np.swapaxes(points.basis[:, :, self.locus.freedoms :], 1, 2) @ ways
            )

        return self.zeros(side)


def _plain(points: LocusPoints) -> CurvePoints:
    """Return what chords are made of; bends are not known."""
    tangents = points.tangents[:, :, 0]
    return CurvePoints(
        points.values, tangents, np.full_like(tangents, np.nan), points.residual
    )


def _turned(points: LocusPoints, sense: Floats | float) -> LocusPoints:
    """Return points with their tangents turned round where the sense (n,) is -1."""
    sense = np.reshape(sense, (-1, 1, 1))
    return replace(points, tangents=sense * points.tangents, turns=sense * points.turns)
