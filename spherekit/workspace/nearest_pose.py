"""The reachable pose nearest to one that is out of reach.

A direction is a unit vector of three numbers and an orientation one of four, a quaternion.
Poses are therefore the points of a unit sphere. An arc on the sphere of quaternions is half
of an angle of rotation. Around the pose that is wanted, normal coordinates v are used, two
for directions and three for orientations: |v| is the arc from that pose. The nearest pose
solves

    minimise |v|^2 / 2  subject to  margins(v) >= 0.

The problem has many local solutions. Several starts are therefore improved by sequential
quadratic programming. Then the ball of radius |v| around the wanted pose is searched for
anything nearer, until nothing is found in it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.sphere.rotation import unit_rows

Margins = Callable[[Floats], Floats]
"""Margins (n, bounds) at poses (n, 3 or 4), which are negative outside."""

START_COUNT = 12
"""Poses from which the distance is reduced in one round. More: slower, and less is left to
the search of the ball."""

BALL_SAMPLE_COUNT = 4000
"""Poses of the ball that is searched. A reachable part of it is met if its size is more
than about a sixteenth of the radius for orientations, and a sixtieth for directions."""

MAX_ROUNDS = 6
"""Searches of a ball for something nearer, each followed by improvements."""

MAX_STEPS = 60
"""Steps of sequential quadratic programming from one start."""

FIRST_STEPS = 8
"""Steps of all starts. Only the best of them are continued after these."""

FINALIST_COUNT = 3
"""Starts that are improved to the end. More: slower. A local solution that is lost here is
met again in the ball."""

DIFFERENCE = 1e-6
"""Step of the central differences of margins, in coordinates v."""

CONVERGED = 1e-11
"""Length of a step at which an improvement ends."""

LINE_SEARCH = 0.5 ** np.arange(10)
"""Parts of a step of which the one with the least merit is taken."""

NUDGES = np.array([1e-12, 1e-11, 1e-10, 1e-9, 1e-8, 1e-7])
"""Steps into the workspace from its border, which is known to rounding only."""

RETREATS = np.logspace(-10.0, 0.0, 41)
"""Parts of the path back to a start that are tried where no nudge leads inside, as at a
border that is sharp or where a margin has no value beyond."""

MIN_GAIN = 1e-9
"""Arc (rad) by which another pose has to be nearer to take the place of one."""


@dataclass(frozen=True)
class NormalCoordinates:
    """Normal coordinates v (d,) of a unit sphere in d + 1 dimensions around a point.

    Attributes
    ----------
    centre
        (d + 1,) the point at v = 0.
    basis
        (d, d + 1) unit vectors at right angles to it and to each other.
    """

    centre: Floats
    basis: Floats

    @classmethod
    def around(cls, centre: Floats) -> "NormalCoordinates":
        """Return the coordinates around a direction (3,) or unit quaternion (4,)."""
        _, _, rows = np.linalg.svd(centre[None])
        return cls(centre, rows[1:])

    @property
    def dimension(self) -> int:
        """The number d of coordinates: 2 for directions, 3 for orientations."""
        return len(self.basis)

    @property
    def angle_per_arc(self) -> float:
        """The angle between two poses, by the arc between them on the sphere."""
        return 2.0 if self.dimension == 3 else 1.0

    def poses(self, v: Floats) -> Floats:
        """Return the points (..., d + 1) at coordinates (..., d)."""
        length = np.linalg.norm(v, axis=-1, keepdims=True)
        return np.cos(length) * self.centre + np.sinc(length / np.pi) * (v @ self.basis)

    def coordinates(self, poses: Floats) -> Floats:
        """Return the shortest coordinates (n, d) of points (n, d + 1)."""
        along = poses @ self.centre
        # A quaternion and its negative are one orientation. The nearer one is taken.
        sign = np.where((along < 0.0) & (self.dimension == 3), -1.0, 1.0)
        across = sign[:, None] * (poses @ self.basis.T)
        sine = np.linalg.norm(across, axis=1)
        arc = np.arctan2(sine, sign * along)
        return across * (arc / np.where(sine > 0.0, sine, 1.0))[:, None]


@dataclass(frozen=True)
class NearestPoseSearch:
    """The search for the reachable pose nearest to one that is out of reach.

    Attributes
    ----------
    margins
        Margins of the limits, smooth across the border of what is reached.
    is_inside
        Decides whether poses (n, 3 or 4) are reachable, rounding included.
    """

    margins: Margins
    is_inside: Callable[[Floats], Bools]

    def find_nearest(
        self, wanted: Floats, reachable: Floats
    ) -> tuple[Floats, float] | None:
        """Return the nearest pose, and the angle (rad) to it.

        Parameters
        ----------
        wanted
            (3,) direction or (4,) unit quaternion that is out of reach.
        reachable
            (n, 3 or 4) some poses that are reachable, at best spread evenly.

        Returns
        -------
        The pose, which `is_inside`, and the angle to it; None if no reachable pose was met.
        """
        space = NormalCoordinates.around(wanted)
        starts = _spread_starts(space.coordinates(reachable))
        nearest: Floats | None = None
        for _ in range(MAX_ROUNDS):
            candidate = self._improve_all(space, starts)
            if candidate is None:
                break
            gain = np.inf if nearest is None else _length(nearest) - _length(candidate)
            if gain > 0.0:
                nearest = candidate
            if gain < MIN_GAIN:
                break
            starts = self._starts_in_ball(space, _length(candidate))
        if nearest is None:
            return None
        return space.poses(nearest), space.angle_per_arc * _length(nearest)

    def _starts_in_ball(self, space: NormalCoordinates, radius: float) -> Floats:
        """Return starts in a ball: the nearest reachable, and the least unreachable."""
        v = radius * BALL_SAMPLES[space.dimension]
        with np.errstate(all="ignore"):
            least_margin = np.min(self.margins(space.poses(v)), axis=1)
        # The samples are sorted by their distance from the centre.
        inside = np.flatnonzero(least_margin >= 0.0)[:START_COUNT]
        violation = np.where(least_margin < 0.0, -least_margin, np.inf)
        outside = np.argsort(violation)[: START_COUNT - len(inside)]
        return v[np.concatenate([inside, outside])]

    def _improve_all(self, space: NormalCoordinates, starts: Floats) -> Floats | None:
        """Return the nearest reachable local solution (d,) from starts (k, d), if any."""
        v = starts.copy()
        penalty = np.ones(len(v))
        merit = np.full(len(v), np.inf)
        moving = np.arange(len(v))
        for count in range(MAX_STEPS):
            if count == FIRST_STEPS:
                moving = moving[np.argsort(merit[moving])[:FINALIST_COUNT]]
            if not len(moving):
                break
            values, slopes = self._expand(space, v[moving])
            steps = np.zeros((len(moving), space.dimension))
            for k, start in enumerate(moving):
                steps[k], weight = _projection_step(v[start], values[k], slopes[k])
                penalty[start] = max(penalty[start], 2.0 * weight)
            tried = v[moving, None] + LINE_SEARCH[:, None] * steps[:, None]
            tried_merit = _merit(tried, self._values(space, tried), penalty[moving, None])
            before = _merit(v[moving], values, penalty[moving])
            best = np.argmin(tried_merit, axis=1)
            row = np.arange(len(moving))
            is_lower = tried_merit[row, best] < before
            taken = tried[row, best]
            length = np.linalg.norm(taken - v[moving], axis=1)
            v[moving[is_lower]] = taken[is_lower]
            merit[moving] = np.minimum(tried_merit[row, best], before)
            moving = moving[is_lower & (length > CONVERGED)]
        return self._nearest_inside(space, v, starts)

    def _expand(self, space: NormalCoordinates, v: Floats) -> tuple[Floats, Floats]:
        """Return margins (k, bounds) and their derivatives (k, bounds, d) at v (k, d)."""
        d = space.dimension
        offsets = DIFFERENCE * np.concatenate([np.zeros((1, d)), np.eye(d), -np.eye(d)])
        values = self._values(space, v[:, None] + offsets)
        centre = values[:, :1]
        ahead = values[:, 1 : 1 + d]
        behind = values[:, 1 + d :]
        slopes = (ahead - behind) / (2.0 * DIFFERENCE)
        # A margin may have no value beyond the border, so that one side has to do.
        one_sided = np.where(np.isnan(ahead), centre - behind, ahead - centre) / DIFFERENCE
        slopes = np.where(np.isnan(slopes), one_sided, slopes)
        return centre[:, 0], np.swapaxes(np.nan_to_num(slopes), 1, 2)

    def _values(self, space: NormalCoordinates, v: Floats) -> Floats:
        """Return margins (k, m, bounds) at coordinates (k, m, d)."""
        poses = space.poses(v).reshape(-1, space.dimension + 1)
        with np.errstate(all="ignore"):
            values = self.margins(poses)
        return values.reshape(*v.shape[:2], -1)

    def _nearest_inside(
        self, space: NormalCoordinates, v: Floats, starts: Floats
    ) -> Floats | None:
        """Return the shortest of coordinates (k, d) that is inside after small steps."""
        for k in np.argsort(np.linalg.norm(v, axis=1)):
            values, slopes = self._expand(space, v[k][None])
            lengths = np.linalg.norm(slopes[0], axis=1)
            is_active = (values[0] < 1e3 * NUDGES[-1]) & (lengths > 0.0)
            normals = unit_rows(slopes[0][is_active])
            inward, _ = _shortest_beyond(normals, np.ones(len(normals)))
            for tried in (
                v[k] + np.outer(NUDGES, inward),
                v[k] + np.outer(RETREATS, starts[k] - v[k]),
            ):
                outside = np.flatnonzero(~self.is_inside(space.poses(tried)))
                # Rounding may put a point outside to the inside. One step more is sure to
                # be inside if everything further is.
                first = 1 + np.max(outside, initial=-1)
                if first < len(tried):
                    nearest: Floats = tried[min(first + 1, len(tried) - 1)]
                    return nearest
        return None


def _length(v: Floats) -> float:
    return float(np.linalg.norm(v))


def _spread_starts(reachable: Floats) -> Floats:
    """Return the shortest of coordinates (n, d) of reachable poses, and some others.

    The others are as far from each other as possible, so that separate parts of the
    workspace have a start each.
    """
    reachable = reachable[np.argsort(np.linalg.norm(reachable, axis=1))]
    chosen = list(reachable[: START_COUNT // 2])
    apart = np.full(len(reachable), np.inf)
    for start in chosen:
        apart = np.minimum(apart, np.linalg.norm(reachable - start, axis=1))
    while len(chosen) < min(START_COUNT, len(reachable)):
        chosen.append(reachable[np.argmax(apart)])
        apart = np.minimum(apart, np.linalg.norm(reachable - chosen[-1], axis=1))
    return np.reshape(chosen, (-1, reachable.shape[1]))


def _merit(v: Floats, values: Floats, penalty: Floats) -> Floats:
    """Return |v|^2 / 2 plus a penalty (...) for each violated margin.

    Parameters
    ----------
    v, values
        (..., d) coordinates, and (..., bounds) margins there.
    penalty
        Factor of the violations, of a shape that fits (...).
    """
    violation = np.sum(np.maximum(-values, 0.0), axis=-1)
    # A margin without a value counts as violated by any amount.
    violation[np.isnan(values).any(axis=-1)] = np.inf
    return 0.5 * np.sum(v * v, axis=-1) + penalty * violation


def _projection_step(v: Floats, values: Floats, slopes: Floats) -> tuple[Floats, float]:
    """Return the step (d,) to the point nearest to 0 that keeps the linearised margins.

    Parameters
    ----------
    v
        (d,) coordinates.
    values, slopes
        (bounds,) and (bounds, d) margins there and their derivatives.

    Returns
    -------
    step
        (d,) change of v.
    weight
        The greatest multiplier of a margin, by which its violation is penalised.
    """
    has_slope = (np.linalg.norm(slopes, axis=1) > 0.0) & np.isfinite(values)
    slopes = slopes[has_slope]
    values = values[has_slope]
    point, multipliers = _shortest_beyond(slopes, slopes @ v - values)
    step = point - v
    if not np.isfinite(step).all():
        # No point keeps all linearised margins: reduce the violated ones at least.
        violated = values < 0.0
        step = np.linalg.pinv(slopes[violated]) @ -values[violated]
    # The linearisation says little further away than a fraction of a right angle.
    step *= min(1.0, 0.5 / max(_length(step), 1e-300))
    return step, float(np.max(multipliers, initial=0.0))


def _shortest_beyond(normals: Floats, offsets: Floats) -> tuple[Floats, Floats]:
    """Return the shortest vector x (d,) with normals @ x >= offsets, and multipliers.

    It is NaN if there is none. The problem of least distance is solved by non-negative
    least squares.

    References
    ----------
    C. L. Lawson and R. J. Hanson, Solving Least Squares Problems, 1974, chapter 23.
    """
    # SciPy takes long to import.
    from scipy.optimize import nnls

    d = normals.shape[1]
    if not np.any(offsets > 0.0):
        return np.zeros(d), np.zeros(len(offsets))
    # The rows are scaled to unit normals, so that no limit counts more than another.
    scale = np.linalg.norm(normals, axis=1)
    system = np.vstack([normals.T, offsets]) / scale
    target = np.append(np.zeros(d), 1.0)
    weights, _ = nnls(system, target)
    residual = system @ weights - target
    if -residual[d] < 1e-12:
        return np.full(d, np.nan), np.zeros(len(offsets))
    return -residual[:d] / residual[d], weights / scale / -residual[d]


def _make_disc_samples(count: int) -> Floats:
    """Return points (count, 2) spread evenly in the unit disc, the innermost first.

    They are the seeds of a sunflower, each a golden angle further than the one before.
    """
    number = np.arange(count)
    radius = np.sqrt((number + 0.5) / count)
    turn = number * np.pi * (3.0 - np.sqrt(5.0))
    return radius[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])


def _make_ball_samples(count: int) -> Floats:
    """Return points (count, 3) spread evenly in the unit ball, the innermost first.

    The directions follow the additive recurrence of M. Roberts in two dimensions, whose
    constant is the real root of x^3 = x + 1. The radii give every point the same volume.
    """
    root = 1.324717957244746
    number = np.arange(count)
    radius = np.cbrt((number + 0.5) / count)
    height = 2.0 * ((0.5 + number / root) % 1.0) - 1.0
    turn = 2.0 * np.pi * ((0.5 + number / root**2) % 1.0)
    width = np.sqrt(1.0 - height**2)
    directions = np.column_stack([width * np.cos(turn), width * np.sin(turn), height])
    return radius[:, None] * directions


BALL_SAMPLES = {
    2: _make_disc_samples(BALL_SAMPLE_COUNT),
    3: _make_ball_samples(BALL_SAMPLE_COUNT),
}
"""Points of the unit ball by its dimension."""
