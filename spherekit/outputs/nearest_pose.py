"""Finds the reachable pose that is nearest to a pose out of reach.

A pose of the output is a direction or an orientation. A direction is a unit vector with
three components, and an orientation is a unit quaternion with four. Poses are therefore
points of a unit sphere. The angle of a rotation is twice the arc between the quaternions.

The target pose is the pose out of reach. Poses around it are described by normal
coordinates v: the point at v is reached from the target by an arc of length |v| in the
tangent direction v. There are two coordinates for directions and three for orientations. A
margin measures how much is left to a limit of the mechanism. A pose is reachable if no
margin is negative. The nearest pose solves

    minimise |v|^2 / 2  subject to  margins(v) >= 0.

The problem has many local minima. Sequential quadratic programming (SQP) therefore improves
several starts. Then the ball of radius |v| around the target is sampled, and samples that
may lead to a nearer pose are the next starts. The search ends when there is no gain.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.geometry.vectors import unit_rows

Margins = Callable[[Floats], Floats]
"""A function that returns the margins (n, bounds) of poses (n, 3 or 4).

There is one margin for each limit. It is negative if the limit is violated, and NaN if it
has no value at a pose.
"""

SEARCH_START_COUNT = 12
"""Number of starts in one round. With more, the search is slower but more thorough."""

BALL_SAMPLE_COUNT = 4000
"""Number of samples in the ball around the target.

A reachable region in the ball is noticed if its size exceeds about 1/16 of the radius for
orientations, and 1/60 for directions.
"""

MAX_SEARCH_ROUNDS = 6
"""Largest number of rounds. Each round improves all starts and then samples the ball.

Larger: nearer poses may be found, in more time. Smaller: the search ends sooner.
"""

MAX_SQP_STEPS = 60
"""Largest number of SQP steps from one start.

Larger: starts far from a minimum arrive. Smaller: they end before it.
"""

FIRST_STEPS = 8
"""Number of SQP steps of all starts. After these, only the best are continued.

Larger: a better choice of the best, in more time. Smaller: a good start may be dropped.
"""

FINALIST_COUNT = 3
"""Number of starts that are continued after `FIRST_STEPS`.

With more, the search is slower. A local minimum that is dropped here can be met again when
the ball is sampled.
"""

MAX_SQP_STEP_RAD = 0.5
"""Longest SQP step, in coordinates v (rad).

Larger: steps on which the linearised margins are wrong. Smaller: more steps.
"""

DIFFERENCE_STEP = 1e-6
"""Step of the central differences of the margins, in coordinates v (rad).

Larger: curved margins have less accurate gradients. Smaller: rounding errors grow.
"""

MIN_STEP_LENGTH = 1e-11
"""SQP steps from a start end when a step is shorter, in coordinates v (rad).

Larger: less accurate minima. Smaller: steps that are only rounding.
"""

STEP_FRACTIONS = 0.5 ** np.arange(10)
"""Fractions of an SQP step that are tried. The one with the least merit is used."""

INWARD_STEPS = np.array([1e-12, 1e-11, 1e-10, 1e-9, 1e-8, 1e-7])
"""Lengths (rad) of steps from the border of the workspace to its inside.

The border is computed up to rounding errors, so a point on it may be outside.
"""

RETURN_FRACTIONS = np.logspace(-10.0, 0.0, 41)
"""Fractions of the path back to a start that are tried if no inward step leads inside.

This happens at a corner of the border, or if a margin has no value beyond the border.
"""

MIN_RESIDUAL_OF_SOLUTION = 1e-12
"""Smallest residual, between 0 and 1, with which inequalities have a common solution.

Larger: inequalities that only distant vectors satisfy count as contradictory. Smaller:
rounding errors can hide a contradiction.
"""

MIN_GAIN = 1e-9
"""The search ends if a round reduces the arc to the nearest pose by less (rad).

Larger: fewer rounds, and poses that are farther than the nearest one. Smaller: more rounds.
"""


@dataclass(frozen=True)
class NormalCoordinates:
    """Coordinates of poses around one pose, so that the length of a vector is a distance.

    Poses are points of a unit sphere in d + 1 dimensions: directions (d = 2), or
    orientations as unit quaternions (d = 3). The normal coordinates v (d,) of a pose
    describe the arc from the centre to the pose. The length of v is the length of the arc
    (rad), and the direction of v is the direction in which the arc starts: ``pose =
    cos(|v|) centre + sin(|v|) (v / |v|) basis``.

    Attributes
    ----------
    centre
        (d + 1,) the point of the sphere at v = 0.
    basis
        (d, d + 1) orthonormal vectors that are orthogonal to `centre`, one in each row.
    """

    centre: Floats
    basis: Floats

    @classmethod
    def around(cls, centre: Floats) -> "NormalCoordinates":
        """Create coordinates around a direction (3,) or unit quaternion (4,)."""
        # The first right singular vector is +-centre. The others are orthogonal to it.
        _, _, rows = np.linalg.svd(centre[None])
        return cls(centre, rows[1:])

    @property
    def dimension(self) -> int:
        """The number d of coordinates: 2 for directions, 3 for orientations."""
        return len(self.basis)

    @property
    def angle_per_arc(self) -> float:
        """Angle between two poses divided by the arc between their points on the sphere.

        Poses are directions, or orientations as unit quaternions. The ratio is 1 for
        directions. It is 2 for orientations, because two unit quaternions at an arc s
        differ by a rotation through 2 s.
        """
        return 2.0 if self.dimension == 3 else 1.0

    def poses(self, v: Floats) -> Floats:
        """Return the points (..., d + 1) of the sphere at coordinates v (..., d) (rad)."""
        length = np.linalg.norm(v, axis=-1, keepdims=True)
        # np.sinc(x / pi) is sin(x) / x, and 1 at x = 0.
        return np.cos(length) * self.centre + np.sinc(length / np.pi) * (v @ self.basis)

    def coordinates(self, poses: Floats) -> Floats:
        """Return the coordinates v (n, d) (rad) of points (n, d + 1) of the sphere.

        The points are poses: directions (d = 2) or unit quaternions (d = 3). |v| is the
        length of the arc from the centre of the coordinates to the point, and v has the
        direction in which this arc starts. For quaternions |v| is at most pi / 2. If a
        direction is opposite to the centre, |v| is pi, and all directions of v are right.
        """
        cosine = poses @ self.centre
        # A quaternion and its negative are one orientation. The nearer one is taken.
        sign = np.where((cosine < 0.0) & (self.dimension == 3), -1.0, 1.0)
        tangential = sign[:, None] * (poses @ self.basis.T)
        sine = np.linalg.norm(tangential, axis=1)
        arc = np.arctan2(sine, sign * cosine)
        # Arcs in all directions lead to the opposite point. One of them is taken.
        is_opposite = (sine == 0.0) & (sign * cosine < 0.0)
        tangential[is_opposite, 0] = 1.0
        return tangential * (arc / np.where(sine > 0.0, sine, 1.0))[:, None]


@dataclass(frozen=True)
class NearestPoseSearch:
    """Searches the reachable pose that is nearest to a given target pose.

    Attributes
    ----------
    margins
        Function that returns margins of poses, one for each limit of the mechanism. A
        margin is negative beyond the limit, or NaN where the limit has no value. Margins
        guide the search and are smooth across the border of the workspace, if they exist
        beyond the border.
    is_inside
        Function that takes poses (n, 3 or 4) and returns a mask (n,) of the reachable ones.
        It is the exact test that the result must pass.
    """

    margins: Margins
    is_inside: Callable[[Floats], Bools]

    def find_nearest(
        self, target_pose: Floats, reachable: Floats
    ) -> tuple[Floats, float] | None:
        """Find the reachable pose nearest to a target pose that the mechanism cannot reach.

        Parameters
        ----------
        target_pose
            (3,) direction or (4,) unit quaternion that is out of reach.
        reachable
            (n, 3 or 4) reachable poses, from which the search starts. They should be spread
            evenly over the workspace.

        Returns
        -------
        The nearest pose (3 or 4,), for which `is_inside` is true, and the angle (rad)
        between it and the target. The result is None if no reachable pose was found.
        """
        # Coordinates v around the target: the distance of a pose is the length of v.
        chart = NormalCoordinates.around(target_pose)
        # Each round improves its starts to local minima. All nearer poses are in the ball
        # around the target with the radius of the best distance so far. The next round
        # starts from samples of this ball.
        starts = _choose_spread_starts(chart.coordinates(reachable))
        nearest: Floats | None = None
        for _ in range(MAX_SEARCH_ROUNDS):
            candidate = self._find_local_minimum(chart, starts)
            if candidate is None:
                break
            # By how much the candidate is nearer than the best pose so far.
            gain = np.inf if nearest is None else _length(nearest) - _length(candidate)
            if gain > 0.0:
                nearest = candidate
            if gain < MIN_GAIN:
                break
            # The candidate is the nearest pose so far.
            starts = self._choose_starts_in_ball(chart, radius=_length(candidate))
        if nearest is None:
            return None
        # The arc between two quaternions is half the angle of the rotation between them.
        return chart.poses(nearest), chart.angle_per_arc * _length(nearest)

    def _choose_starts_in_ball(self, chart: NormalCoordinates, radius: float) -> Floats:
        """Choose starts for the next round of the search, in a ball around the target pose.

        The radius is the distance of the nearest reachable pose so far, so only poses in
        the ball can be nearer. A margin is how much is left to one limit of the mechanism.
        A pose is reachable if none of its margins is negative.

        Parameters
        ----------
        chart
            Coordinates v (d,) around the target pose, so that |v| is the distance (rad) of
            a pose from the target, along the sphere of poses.
        radius
            Largest |v| (rad) in the ball.

        Returns
        -------
        (`SEARCH_START_COUNT`, d) coordinates. First come the reachable samples that are
        nearest to the target. Then come samples out of reach, those with the smallest
        violation of a limit first. If there are too few samples of both kinds, arbitrary
        samples fill the array.
        """
        # `BALL_SAMPLES` are spread evenly in a ball of radius 1, the innermost first.
        samples = radius * BALL_SAMPLES[chart.dimension]
        with np.errstate(all="ignore"):
            least_margin = np.min(self.margins(chart.poses(samples)), axis=1)
        # 1. Reachable samples. The first ones are nearest.
        reachable = np.flatnonzero(least_margin >= 0.0)[:SEARCH_START_COUNT]
        # 2. Samples out of reach, by the size of their violation. All others get an
        # infinite violation, so that they come last.
        violation = np.where(least_margin < 0.0, -least_margin, np.inf)
        missing_count = SEARCH_START_COUNT - len(reachable)
        nearly_reachable = np.argsort(violation)[:missing_count]
        return samples[np.concatenate([reachable, nearly_reachable])]

    def _find_local_minimum(
        self, chart: NormalCoordinates, starts: Floats
    ) -> Floats | None:
        """Improve several starts, and return the best reachable result.

        The target is the pose that should be reached. The method is sequential quadratic
        programming (SQP): it minimises |v|^2 / 2 with all margins at least 0. Here v are
        the coordinates around the target, and a margin is what is left to a limit of the
        mechanism. In each step the margins are replaced by linear functions. The solution
        of this simpler problem gives a step. A line search decides how much of the step is
        used. The search weighs |v| against violated margins (exact penalty function).

        Parameters
        ----------
        chart
            Normal coordinates around the target pose.
        starts
            (k, d) coordinates of the starts, reachable or not.

        Returns
        -------
        (d,) coordinates of the nearest point after `_move_inside` has moved the improved
        starts inside. None if there is none.
        """
        # For each start: the point reached so far, the factor of violated margins in the
        # merit function, and the value of this function.
        v = starts.copy()
        penalty = np.ones(len(v))
        merit = np.full(len(v), np.inf)
        # Indices of the starts that are still improved.
        active_starts = np.arange(len(v))
        for count in range(MAX_SQP_STEPS):
            if count == FIRST_STEPS:
                # From now on only the best starts are improved.
                active_starts = active_starts[
                    np.argsort(merit[active_starts])[:FINALIST_COUNT]
                ]
            if not len(active_starts):
                break

            # 1. A step for each active start.
            values, gradients = self._linearise_margins(chart, v[active_starts])
            steps = np.zeros((len(active_starts), chart.dimension))
            for k, start in enumerate(active_starts):
                steps[k], largest_multiplier = _compute_sqp_step(
                    v[start], values[k], gradients[k]
                )
                # The merit function has its minimum at the solution of the problem only if
                # the penalty exceeds all multipliers. The penalty never decreases.
                penalty[start] = max(penalty[start], 2.0 * largest_multiplier)

            # 2. The best point along each step, and the merit there.
            best_points, best_merit = self._search_along_steps(
                chart, v[active_starts], steps, penalty[active_starts]
            )
            merit_before = _merit(v[active_starts], values, penalty[active_starts])
            has_decreased = best_merit < merit_before

            # 3. Go to the best points that decrease the merit. A start whose merit does not
            # decrease, or whose step is tiny, has converged and is not improved further.
            length = np.linalg.norm(best_points - v[active_starts], axis=1)
            v[active_starts[has_decreased]] = best_points[has_decreased]
            merit[active_starts] = np.minimum(best_merit, merit_before)
            active_starts = active_starts[has_decreased & (length > MIN_STEP_LENGTH)]
        return self._move_inside(chart, v, starts)

    def _search_along_steps(
        self, chart: NormalCoordinates, points: Floats, steps: Floats, penalty: Floats
    ) -> tuple[Floats, Floats]:
        """Try fractions of steps from some points, and return the best point of each step.

        The best point has the smallest value of the merit function: half the squared
        distance from the target, plus the penalty times the sum of all violations of
        limits.

        Parameters
        ----------
        chart
            Coordinates around the target pose.
        points, steps
            (k, d) coordinates of the points, and a step from each.
        penalty
            (k,) factor of the violations in the merit function.

        Returns
        -------
        best_points
            (k, d) coordinates.
        best_merit
            (k,) values of the merit function there.
        """
        # (k, fractions, d) points, and (k, fractions) values of the merit function.
        trial_points = points[:, None] + STEP_FRACTIONS[:, None] * steps[:, None]
        trial_merit = _merit(
            trial_points, self._evaluate_margins(chart, trial_points), penalty[:, None]
        )
        rows = np.arange(len(points))
        best_fraction = np.argmin(trial_merit, axis=1)
        return trial_points[rows, best_fraction], trial_merit[rows, best_fraction]

    def _linearise_margins(
        self, chart: NormalCoordinates, v: Floats
    ) -> tuple[Floats, Floats]:
        """Compute margins and their gradients by central differences.

        A margin is how much is left to one limit of the mechanism, negative beyond it. The
        search replaces margins by linear functions near a point.

        Parameters
        ----------
        chart
            Coordinates v around the target pose, as vectors of length |v| = distance (rad).
        v
            (k, d) coordinates of k points.

        Returns
        -------
        margins
            (k, bounds) margins at the points for all limits (bounds), NaN where a margin
            has no value.
        gradients
            (k, bounds, d) derivatives with respect to v, zero where they do not exist.
        """
        d = chart.dimension
        # The point itself, and a step forwards and backwards along each coordinate.
        offsets = DIFFERENCE_STEP * np.concatenate(
            [np.zeros((1, d)), np.eye(d), -np.eye(d)]
        )
        # Margins (k, 1 + 2 d, bounds) at these points, divided into those at the point
        # itself, after the d steps forwards, and after the d steps backwards.
        values = self._evaluate_margins(chart, v[:, None] + offsets)
        centre, ahead, behind = np.split(values, [1, 1 + d], axis=1)
        # A margin may be NaN beyond the border, ahead of the point or behind it. In that
        # case the difference between the point and the other side is used.
        central_difference = (ahead - behind) / (2.0 * DIFFERENCE_STEP)
        difference_ahead = (ahead - centre) / DIFFERENCE_STEP
        difference_behind = (centre - behind) / DIFFERENCE_STEP
        one_sided_difference = np.where(
            np.isnan(ahead), difference_behind, difference_ahead
        )
        gradients = np.where(
            np.isnan(central_difference), one_sided_difference, central_difference
        )
        # From (k, d, bounds) to (k, bounds, d). Derivatives that do not exist become 0.
        return centre[:, 0], np.swapaxes(np.nan_to_num(gradients), 1, 2)

    def _evaluate_margins(self, chart: NormalCoordinates, v: Floats) -> Floats:
        """Return the margins (k, m, limits) of poses with the coordinates v (k, m, d).

        A margin is how much is left to one limit of the mechanism, negative beyond it.
        """
        poses = chart.poses(v).reshape(-1, chart.dimension + 1)
        with np.errstate(all="ignore"):
            values = self.margins(poses)
        return values.reshape(*v.shape[:2], -1)

    def _move_inside(
        self, chart: NormalCoordinates, v: Floats, starts: Floats
    ) -> Floats | None:
        """Move points at the border inside the workspace, and return the nearest of them.

        The points are results of the search. Because of rounding errors they can be
        slightly outside of the workspace.

        Parameters
        ----------
        chart
            Coordinates v around the target pose. |v| is the distance (rad) of a point from
            the target.
        v
            (k, d) coordinates of the points.
        starts
            (k, d) coordinates of the starts from which the search arrived at the points.
            Some of them are inside the workspace.

        Returns
        -------
        (d,) coordinates of the moved point with the smallest |v|, for which `is_inside` is
        true. None if no point can be moved inside.
        """
        nearest: Floats | None = None
        nearest_distance = np.inf
        distances = np.linalg.norm(v, axis=1)
        # Points are tried in the order of their distance. A move can increase the distance
        # of a point, so the first success need not be the best.
        for k in np.argsort(distances):
            # This point and all later ones are farther than the best success.
            if distances[k] >= nearest_distance:
                break
            moved_point = self._move_point_inside(chart, v[k], starts[k])
            if moved_point is not None and _length(moved_point) < nearest_distance:
                nearest = moved_point
                nearest_distance = _length(moved_point)
        return nearest

    def _move_point_inside(
        self, chart: NormalCoordinates, point: Floats, start: Floats
    ) -> Floats | None:
        """Move a point at the border of the workspace inside, None if this fails.

        Rounding errors of the search can put the point slightly outside. It is moved away
        from the limits of the workspace that it nearly reaches or slightly exceeds, by the
        shortest of `INWARD_STEPS` that leads inside. If no such step leads inside, the
        point is moved back towards its start.

        Parameters
        ----------
        chart
            Coordinates around the target pose.
        point
            (d,) coordinates of the point.
        start
            (d,) coordinates of the start from which the search arrived at the point.

        Returns
        -------
        (d,) coordinates of a point inside, or None.
        """
        inward_direction = self._find_inward_direction(chart, point)
        moved_point = self._find_first_inside(chart, point, inward_direction, INWARD_STEPS)
        if moved_point is not None:
            return moved_point
        return self._find_first_inside(chart, point, start - point, RETURN_FRACTIONS)

    def _find_inward_direction(self, chart: NormalCoordinates, point: Floats) -> Floats:
        """Return the direction from a point at the border into the workspace.

        A margin is how much is left to one limit of the mechanism. Because of rounding
        errors, the point can be slightly outside of the workspace. The caller therefore
        moves it inside by one of the short `INWARD_STEPS` in this direction. Margins that
        are zero or nearly zero are active. All active margins grow along the direction.

        Parameters
        ----------
        chart
            Coordinates around the target pose.
        point
            (d,) coordinates of the point.

        Returns
        -------
        (d,) the shortest vector whose component along the gradient of each active margin is
        at least 1. It is NaN if there is no such vector, and 0 if no margin is active.
        """
        values, gradients = self._linearise_margins(chart, point[None])
        margins = values[0]  # (bounds,)
        margin_gradients = gradients[0]  # (bounds, d)
        # The caller tries all `INWARD_STEPS`. A margin above 1000 times the longest step
        # stays positive, unless its slope exceeds 1000.
        longest_step = INWARD_STEPS[-1]
        is_small = margins < 1e3 * longest_step
        # A margin with the gradient 0 prescribes no direction.
        has_gradient = np.linalg.norm(margin_gradients, axis=1) > 0.0
        is_active = is_small & has_gradient
        # Find the shortest vector x with normals @ x >= 1.
        normals = unit_rows(margin_gradients[is_active])
        inward_direction, _multipliers = _solve_least_distance(
            normals, offsets=np.ones(len(normals))
        )
        return inward_direction

    def _find_first_inside(
        self, chart: NormalCoordinates, point: Floats, direction: Floats, lengths: Floats
    ) -> Floats | None:
        """Return a point inside the workspace, close to where a path enters it.

        The caller moves a point along a straight path, because rounding errors may have put
        it slightly outside. The result has to be inside, but near the point.

        Points at the given lengths along the path are tested. The path enters the workspace
        between the last of these points that is outside and the next point. This part of
        the path is then divided in the same way, until it is shorter than `MIN_GAIN` (rad).

        Parameters
        ----------
        chart
            Coordinates around the target pose.
        point, direction
            (d,) the path is ``point + length direction``. If the direction is NaN, all
            points of the path are outside.
        lengths
            (m,) the lengths to try, rising.

        Returns
        -------
        (d,) coordinates of the point inside, or None if the last tested point is outside.
        """
        last = len(lengths) - 1
        while True:
            is_inside = self.is_inside(chart.poses(point + np.outer(lengths, direction)))
            # All points from `first_inside` on are inside.
            first_inside = _count_up_to_last_false(is_inside)
            if first_inside > last:
                return None
            # The first point inside may count as inside only because of rounding errors.
            # The next point is therefore used.
            length_inside = lengths[min(first_inside + 1, last)]
            if first_inside == 0:
                break  # no point is outside
            length_outside = lengths[first_inside - 1]
            if (length_inside - length_outside) * _length(direction) < MIN_GAIN:
                break
            # Divide the part of the path in which it enters the workspace.
            lengths = np.linspace(length_outside, length_inside, len(lengths))
        inside: Floats = point + length_inside * direction
        return inside


def _count_up_to_last_false(values: Bools) -> int:
    """Return the number of values (n,) up to the last False, 0 if all are True."""
    false_indices = np.flatnonzero(~values)
    if len(false_indices) == 0:
        return 0
    return int(false_indices[-1]) + 1


def _length(v: Floats) -> float:
    """Return the Euclidean norm of a vector."""
    return float(np.linalg.norm(v))


def _choose_spread_starts(reachable: Floats) -> Floats:
    """Choose starts of a search: near ones, and some that are far apart.

    Half of the starts are the poses nearest to the target. Each further start is the pose
    that is farthest from all chosen before, so that separate regions of the workspace get
    starts too.

    Parameters
    ----------
    reachable
        (n, d) coordinates of reachable poses. The target has the coordinates 0.

    Returns
    -------
    (up to `SEARCH_START_COUNT`, d) coordinates.
    """
    # Sort by the distance from the target, and choose the nearest ones.
    reachable = reachable[np.argsort(np.linalg.norm(reachable, axis=1))]
    chosen = list(reachable[: SEARCH_START_COUNT // 2])
    # (n,) distance of each pose from the nearest chosen one.
    distance_to_chosen = np.full(len(reachable), np.inf)
    for start in chosen:
        distance_to_chosen = np.minimum(
            distance_to_chosen, np.linalg.norm(reachable - start, axis=1)
        )
    # Then choose the pose that is farthest from all chosen ones, again and again.
    while len(chosen) < min(SEARCH_START_COUNT, len(reachable)):
        farthest = reachable[np.argmax(distance_to_chosen)]
        chosen.append(farthest)
        distance_to_chosen = np.minimum(
            distance_to_chosen, np.linalg.norm(reachable - farthest, axis=1)
        )
    return np.reshape(chosen, (-1, reachable.shape[1]))


def _merit(v: Floats, values: Floats, penalty: Floats) -> Floats:
    """Return the merit function that the search for the nearest pose minimises.

    The function rates points that may violate limits: |v|^2 / 2, half the squared distance
    from the target, plus `penalty` times the sum of all violations (exact penalty
    function).

    Parameters
    ----------
    v
        (..., d) coordinates of points; the target is at 0.
    values
        (..., bounds) margins at v: how much is left to each limit of the mechanism,
        negative beyond it.
    penalty
        Factor of the sum of violations, in a shape that broadcasts to (...).

    Returns
    -------
    (...) values of the function. They are infinite where a margin is NaN.
    """
    violation = np.sum(np.maximum(-values, 0.0), axis=-1)
    violation[np.isnan(values).any(axis=-1)] = np.inf
    return 0.5 * np.sum(v * v, axis=-1) + penalty * violation


def _compute_sqp_step(v: Floats, values: Floats, gradients: Floats) -> tuple[Floats, float]:
    """Compute one step of sequential quadratic programming (SQP) towards the nearest pose.

    The problem is to minimise ``|v|^2 / 2`` while no margin is negative. The step solves
    the linearised problem: minimise ``|v + step|^2 / 2`` subject to ``values + gradients @
    step >= 0``. If the linearised problem has no solution, the step reduces the violations
    in the sense of least squares. The length of the step is at most `MAX_SQP_STEP_RAD`.

    Parameters
    ----------
    v
        (d,) coordinates of the point; the target of the search is at 0.
    values
        (bounds,) margins at the point: how much is left to each limit, negative beyond it.
        Margins that are NaN are ignored.
    gradients
        (bounds, d) derivatives of the margins. Margins whose gradient is zero are ignored.

    Returns
    -------
    step
        (d,) change of v.
    largest_multiplier
        Largest Lagrange multiplier of a linearised margin, 0 if none is active or there is
        no solution. The caller needs it for the merit function of the line search, in which
        the factor of the violations (`penalty`) must be larger than all multipliers.
    """
    is_used = (np.linalg.norm(gradients, axis=1) > 0.0) & np.isfinite(values)
    gradients = gradients[is_used]
    values = values[is_used]
    # With point = v + step, the problem is to find the shortest vector `point` such that
    # gradients @ point >= gradients @ v - values.
    point, multipliers = _solve_least_distance(gradients, gradients @ v - values)
    step = point - v
    has_solution = np.isfinite(step).all()
    if not has_solution:
        # The limits contradict each other, and all multipliers are 0. Take the step that
        # would change the violated margins to 0, in the sense of least squares.
        violated = values < 0.0
        step = np.linalg.pinv(gradients[violated]) @ -values[violated]
    # Shorten long steps, because the margins are only nearly linear. 1e-300 prevents a
    # division by zero.
    step *= min(1.0, MAX_SQP_STEP_RAD / max(_length(step), 1e-300))
    return step, float(np.max(multipliers, initial=0.0))


def _solve_least_distance(normals: Floats, offsets: Floats) -> tuple[Floats, Floats]:
    """Find the shortest vector x with ``normals @ x >= offsets``.

    Parameters
    ----------
    normals
        (m, d) rows of the inequalities, none of them zero.
    offsets
        (m,) right-hand sides of the inequalities.

    Returns
    -------
    x
        (d,) the shortest vector, NaN if no vector satisfies all inequalities.
    multipliers
        (m,) Lagrange multipliers, ``x = normals.T @ multipliers``; zero if x is NaN.

    Notes
    -----
    Lawson and Hanson solve this problem by non-negative least squares: find the weights u
    >= 0 that minimise the length of the residual

        (normals.T @ u, offsets . u - 1).

    Let the components of the residual at the minimum be (p, -h). Then x = p / h, and the
    multipliers are u / h. If h is 0, the inequalities contradict each other.

    References
    ----------
    C. L. Lawson and R. J. Hanson, Solving Least Squares Problems, 1974, chapter 23.
    """
    # SciPy takes long to import.
    from scipy.optimize import nnls

    d = normals.shape[1]
    zero_satisfies_all = not np.any(offsets > 0.0)
    if zero_satisfies_all:
        return np.zeros(d), np.zeros(len(offsets))
    # The columns of `system` are the inequalities. Each is divided by the length of its
    # normal, so that this length has no influence.
    normal_lengths = np.linalg.norm(normals, axis=1)
    system = np.vstack([normals.T, offsets]) / normal_lengths
    target = np.append(np.zeros(d), 1.0)
    weights, _ = nnls(system, target)
    residual = system @ weights - target
    p = residual[:d]
    h = -residual[d]
    # Contradictory inequalities have h = 0 up to rounding.
    if h < MIN_RESIDUAL_OF_SOLUTION:
        return np.full(d, np.nan), np.zeros(len(offsets))
    multipliers = weights / normal_lengths / h
    return p / h, multipliers


def _make_disc_samples(count: int) -> Floats:
    """Return points (count, 2) spread evenly in the unit disc, the innermost first.

    Successive points differ by the golden angle in azimuth, like the seeds of a sunflower.
    The radii grow so that every point stands for the same area. The search for the nearest
    pose that can be reached tries poses at these points.
    """
    index = np.arange(count)
    radius = np.sqrt((index + 0.5) / count)
    azimuth = index * np.pi * (3.0 - np.sqrt(5.0))
    return radius[:, None] * np.column_stack([np.cos(azimuth), np.sin(azimuth)])


def _make_ball_samples(count: int) -> Floats:
    """Return points (count, 3) spread evenly in the unit ball, the innermost first.

    The directions of the points come from a sequence of evenly spread points in two
    dimensions (additive recurrence of M. Roberts), with the real root of x^3 = x + 1 as its
    constant. The radii grow so that every point stands for the same volume. The search for
    the nearest pose that can be reached tries poses at these points.
    """
    root = 1.324717957244746
    index = np.arange(count)
    radius = np.cbrt((index + 0.5) / count)
    height = 2.0 * ((0.5 + index / root) % 1.0) - 1.0
    azimuth = 2.0 * np.pi * ((0.5 + index / root**2) % 1.0)
    parallel_radius = np.sqrt(1.0 - height**2)
    directions = np.column_stack(
        [parallel_radius * np.cos(azimuth), parallel_radius * np.sin(azimuth), height]
    )
    return radius[:, None] * directions


BALL_SAMPLES = {
    2: _make_disc_samples(BALL_SAMPLE_COUNT),
    3: _make_ball_samples(BALL_SAMPLE_COUNT),
}
"""Samples of the unit ball by its dimension d, (`BALL_SAMPLE_COUNT`, d)."""
