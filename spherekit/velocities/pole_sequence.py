"""Computes the poles of a plan one after another, and angular velocities from them.

Let u_ik be the direction of the pole of links i and k. For any two further links k and
r, the pole of i and j lies along (u_ik x u_jk) x (u_ir x u_jr). The factors are the
normals of two great circles through this pole.

Each pole has a bound of its error, which is propagated from the poles it is computed from.
If the plan has several great circles for a pole, a route takes the first two or the best
two. The best two are the great circle with the smallest error, and the one whose
intersection with it has the smallest error.

The poles of an irreducible part of the mechanism follow from the null vector of its
velocity equations.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from spherekit.arrays import Floats
from spherekit.geometry.vectors import (
    cross_columns,
    dot_columns,
    nans,
    norm_columns,
    unit_rows,
)
from spherekit.planning.pole_plan import (
    BlockPoles,
    LinePole,
    Plan,
    Pole,
    PrimaryPole,
    pole_of,
)
from spherekit.positions.linear_equations import left_inverse
from spherekit.positions.loop_tree import LoopTree
from spherekit.positions.motion import Motion
from spherekit.tolerances import EPS
from spherekit.velocities.pole_request import Route

MAX_DIRECTION_ERROR_RAD = 1.0
"""Upper limit of the error bounds of directions. A direction with this bound is unknown."""


@dataclass(frozen=True)
class CircleIntersection:
    """Two great circles that intersect in a pole, at n rows (configurations).

    A pole is the axis about which one link rotates relative to another. Two known great
    circles through a pole determine the pole. For example, the poles that two links have
    with each other and with a third link lie on one great circle.

    Attributes
    ----------
    first_normal, second_normal
        (3, n) normals of the planes of the two great circles, of any length.
    error
        (n,) bound of the error of the intersection of the circles (rad).
    """

    first_normal: Floats
    second_normal: Floats
    error: Floats


class PlannedPoles:
    """The poles of a plan at the n rows of a motion, with any signs of secondary poles.

    A pole is the axis about which two bodies rotate relative to each other. The plan
    computes poles one after another. Primary poles are axes of pairs. Secondary poles are
    intersections of two great circles through known poles.

    Attributes
    ----------
    directions
        (3, n) unit vector of each pole of bodies in ground axes, NaN if it is undefined.
    errors
        (n,) bound of the error of each direction (rad).
    """

    def __init__(
        self,
        plan: Plan,
        motion: Motion,
        route: Route = "best",
        axis_separations: Mapping[Pole, Floats] = MappingProxyType({}),
    ) -> None:
        """Compute the directions and errors of all poles, step by step.

        A pole is the axis about which two links turn relative to each other. There are
        three kinds of steps. A step gives one pole as the axis of a pair (joint), or one
        pole as the intersection of two great circles through known poles. Some parts of the
        mechanism have poles that do not follow in this way. The third kind of step gives
        these poles of a part together, from the velocity equations of the part.

        Parameters
        ----------
        plan, motion
            The plan, and the configurations.
        route
            "first" uses the first two great circles of each pole. All other routes use
            those with the smallest errors at each row (configuration).
        axis_separations
            (n,) by pole, an additional error (rad) for a pole that is the common axis of
            several pairs. In a file with rounded numbers, the axes of these pairs can
            differ a little, so the pole is not exactly known.
        """
        self.plan = plan
        self.motion = motion
        self.route = route
        self.directions: dict[Pole, Floats] = {}
        self.errors: dict[Pole, Floats] = {}
        self._circle_normals: dict[Pole, tuple[Floats, Floats]] = {}
        n = len(motion)
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            for step in plan.steps:
                if isinstance(step, PrimaryPole):
                    separation = axis_separations.get(step.pole, np.zeros(n))
                    self._add_pair_axis(step, separation)
                elif isinstance(step, LinePole):
                    self._add_intersection(step)
                else:
                    # Several poles of a part, from its velocity equations.
                    self._solve_block(step)

    def _add_pair_axis(self, step: PrimaryPole, separation: Floats) -> None:
        """Add a pole (axis of relative rotation of two bodies) that is the axis of a pair.

        Parameters
        ----------
        step
            The pole and the pair.
        separation
            (n,) additional error (rad), infinite or NaN if the bodies do not move relative
            to each other.
        """
        self.directions[step.pole] = self._pair_axis(step.pair)
        self.errors[step.pole] = np.fmin(EPS + separation, MAX_DIRECTION_ERROR_RAD)

    def _add_intersection(self, step: LinePole) -> None:
        """Add a pole that is the intersection of two great circles, with its error."""
        circles = self._choose_great_circles(step.pole, step.via, step.contacts)
        normals = circles.first_normal, circles.second_normal
        self._circle_normals[step.pole] = normals
        self.directions[step.pole] = _unit_vectors(cross_columns(*normals))
        self.errors[step.pole] = circles.error

    def _pair_axis(self, pair: int) -> Floats:
        """Return the unit axis (3, n) of a pair in ground axes."""
        return np.ascontiguousarray(self.motion.axes[:, pair].T)

    def _choose_great_circles(
        self, pole: Pole, third_bodies: Sequence[int], contacts: Sequence[int] = ()
    ) -> CircleIntersection:
        """Return the two great circles from which a pole is computed.

        The pole of bodies i and j lies on the great circle through the poles of i and k and
        of j and k, for any third body k. It also lies in the contact plane of a sliding
        pair between i and j, which contains the point of contact and is at right angles to
        the common tangent of the profiles. The route "first" takes the first two great
        circles. Other routes choose at each row the circle with the smallest error, and the
        circle that has the most accurate intersection with the chosen one.

        The error of an intersection is the sum of the errors of both normals, divided by
        the sine of the angle between them. The sign of the pole may change from row to row.

        Parameters
        ----------
        pole
            The bodies i and j.
        third_bodies
            The bodies k, whose poles with i and with j are known.
        contacts
            Indices of the sliding pairs between i and j.
        """
        i, j = pole
        n = len(self.motion)
        rows = np.arange(n)
        # Two known poles on each great circle: P_ik and P_jk.
        known_pole_pairs = [(pole_of(i, k), pole_of(j, k)) for k in third_bodies]
        normals = [
            cross_columns(self.directions[a], self.directions[b])
            for a, b in known_pole_pairs
        ]
        # For a sliding pair `_pair_axis` returns the common tangent of the profiles, which
        # is the normal of the contact plane. The tangent is known up to rounding, which is
        # added below.
        normals += [self._pair_axis(pair) for pair in contacts]
        normal_errors = [self.errors[a] + self.errors[b] for a, b in known_pole_pairs]
        normal_errors += [np.zeros(n)] * len(contacts)

        count = 2 if self.route == "first" else len(normals)
        # Normals of the circles (circles, 3, n), and errors of their directions
        # (circles, n). A short normal, of nearly equal poles, has a large error.
        circles = np.stack(normals[:count])
        length = norm_columns(circles)
        errors = (np.stack(normal_errors[:count]) + EPS) / np.maximum(length, EPS)
        # `argmin` would choose NaN, the error of a circle through an undefined pole.
        largest_float = np.finfo(float).max
        errors = np.fmin(errors, largest_float)
        # (n,) index of the first circle. Two circles keep their order in all rows, because
        # the sign of the pole, the cross product of the normals, depends on the order.
        first = np.zeros(n, dtype=np.intp)
        if count > 2:
            first = np.argmin(errors, axis=0)
        # Indexing with the arrays `first` and `rows` gives (n, 3), so the result is
        # transposed to (3, n).
        first_normal = circles[first, :, rows].T
        # The sines of the angles between the first circle and all circles.
        sine = norm_columns(cross_columns(first_normal, circles))
        sine /= np.maximum(length * length[first, rows], EPS * EPS)
        intersection_errors = (errors + errors[first, rows]) / np.maximum(sine, EPS)
        # An unknown circle comes last, but before the first circle itself.
        intersection_errors = np.fmin(intersection_errors, largest_float)
        intersection_errors[first, rows] = np.inf
        second = np.argmin(intersection_errors, axis=0)
        return CircleIntersection(
            first_normal=first_normal,
            second_normal=circles[second, :, rows].T,
            error=np.minimum(intersection_errors[second, rows], MAX_DIRECTION_ERROR_RAD),
        )

    def _solve_block(self, step: BlockPoles) -> None:
        """Add the poles of a part of the mechanism, computed from velocity equations.

        A pole is the axis of the relative rotation of two links. The poles of this part do
        not follow from other poles as intersections of great circles. The part has one
        degree of freedom. Its velocity equations therefore determine the rates of all its
        pairs (joints) up to a factor, and so the directions of the poles.

        Parameters
        ----------
        step
            The links and pairs of the part, and its poles.
        """
        # The tree below numbers the links and pairs of the part from 0.
        body_index = {link: k for k, link in enumerate(step.links)}
        ends = [self.plan.ends[pair] for pair in step.pairs]
        # The variables of the part: their indices in the mechanism, and the pair of
        # each.
        variables: list[int] = []
        pair_of_variable: list[int] = []
        for k, pair in enumerate(step.pairs):
            for variable in self.plan.mechanism.variables_of(pair):
                variables.append(variable)
                pair_of_variable.append(k)
        tree = LoopTree(
            count=len(step.links),
            ends=tuple((body_index[a], body_index[b]) for a, b in ends),
            pair_of_variable=tuple(pair_of_variable),
        )
        vectors = self.motion.vectors[:, variables]
        null_motion = solve_null_motion(tree, vectors)
        # (n, bodies, 3) angular velocities, up to a common factor.
        w = tree.body_rates(vectors, null_motion.rates)
        # The rates have unit length and satisfy the velocity equations J r = 0. With the
        # row r added to J, the matrix has an inverse. Rounding changes J by about `EPS`, so
        # the rates change by up to `EPS` times the norm of the inverse.
        error_growth = np.linalg.norm(null_motion.inverse, axis=(1, 2))
        for pole in step.poles:
            i, j = (body_index[link] for link in pole)
            v = (w[:, j] - w[:, i]).T
            # The error of v divided by its length is the angle of the direction error. The
            # second `EPS` avoids a division by zero if the bodies do not move relative to
            # each other.
            error = EPS * error_growth / np.maximum(norm_columns(v), EPS)
            self.directions[pole] = _unit_vectors(v)
            self.errors[pole] = np.minimum(error, MAX_DIRECTION_ERROR_RAD)

    def link_rates(self, bodies: tuple[int, ...]) -> tuple[dict[int, Floats], Floats]:
        """Return the angular velocities of bodies per unit rate of the moving input.

        The velocities are computed from the directions of poles (axes of relative
        rotations), without velocity equations. A body is a set of links that move together.

        The input turns a body b relative to a body a. The velocities of all bodies are
        first computed relative to body a. The velocity of the ground is then subtracted.

        Parameters
        ----------
        bodies
            Indices of bodies; the ground must be one of them.

        Returns
        -------
        w
            (3, n) angular velocity of each body relative to the ground, in ground axes.
        error
            (n,) the largest error bound of the velocities relative to body a. Each is
            divided by a speed of its body, see `_velocity_by_poles`.
            `MAX_DIRECTION_ERROR_RAD` if nothing is known.
        """
        a, b = self.plan.ends[self.plan.input]
        input_axis = self.directions[pole_of(a, b)]
        # By body, angular velocities relative to body a.
        velocity_from_a = {a: np.zeros_like(input_axis), b: input_axis}
        error = np.zeros(len(self.motion))
        for body in set(bodies) - {a, b}:
            velocity_from_a[body], body_error = self._velocity_by_poles(a, b, body)
            error = np.maximum(error, body_error)
        error = np.nan_to_num(
            error, nan=MAX_DIRECTION_ERROR_RAD, posinf=MAX_DIRECTION_ERROR_RAD
        )
        # The ground is body 0.
        ground_velocity = velocity_from_a[0]
        w = {body: velocity - ground_velocity for body, velocity in velocity_from_a.items()}
        return w, error

    @np.errstate(invalid="ignore", divide="ignore", over="ignore")
    def _velocity_by_poles(self, a: int, b: int, k: int) -> tuple[Floats, Floats]:
        """Return the angular velocity of body k relative to body a, from three poles.

        The input turns body b relative to body a at the rate 1. Let u_ij be the direction
        of the pole (axis of the relative rotation) of bodies i and j. The relative
        velocities satisfy

            u_ab = x u_ak + y u_bk,

        the vector form of eq. (5) of Di Gregorio (2024), and the result is x u_ak. The
        cross product with u_bk eliminates y: u_ab x u_bk = x n, with n = u_ak x u_bk. So

            x = (u_ab x u_bk) . n / |n|^2.

        The result does not depend on the signs of u_ak and u_bk.

        Parameters
        ----------
        a, b
            Bodies of the input.
        k
            The third body.

        Returns
        -------
        velocity
            (3, n) angular velocity. It is NaN where u_ak and u_bk coincide.
        error
            (n,) bound of the relative error: the sum of the error bounds of u_ak and u_bk,
            divided by the sine of the angle between them. The error is relative to the
            speed of body k relative to body a or to body b, whichever is larger.
        """
        pole_ak = pole_of(a, k)
        pole_bk = pole_of(b, k)
        u_ab = self.directions[pole_of(a, b)]
        u_ak = self.directions[pole_ak]
        u_bk = self.directions[pole_bk]
        n = cross_columns(u_ak, u_bk)
        n_square = dot_columns(n, n)
        x = dot_columns(cross_columns(u_ab, u_bk), n) / n_square
        error = (self.errors[pole_ak] + self.errors[pole_bk]) / np.sqrt(n_square)
        return u_ak * x, error

    def great_circles(self, pole: Pole) -> Floats:
        """Return the unit normals (n, 2, 3) of two great circles that meet in a pole.

        The circles are drawn to show the construction of the pole (axis of the relative
        rotation of two links). A great circle goes through the poles that both links have
        with a third link. If a sliding pair joins both links, the great circle in its
        contact plane also goes through the pole. This plane contains the centre of the
        sphere and the common normal of the two profiles at the contact.

        In place of links, the plan has bodies: sets of links that the locked inputs join.
        The result is NaN if fewer than two circles exist, or if both links belong to one
        body. In rows where both known poles of a circle coincide, it is NaN, too.

        Parameters
        ----------
        pole
            The two links of the pole.
        """
        body_pole = self.plan.pole(*pole)
        normals = None if body_pole is None else self._circles_through(body_pole)
        if normals is None:
            return nans((len(self.motion), 2, 3))
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            unit_normals = [normal / norm_columns(normal) for normal in normals]
        # From two arrays (3, n) to (n, 2, 3).
        return np.stack([normal.T for normal in unit_normals], axis=1)

    def _circles_through(self, body_pole: Pole) -> tuple[Floats, Floats] | None:
        """Return normals (3, n) of two great circles that meet in the pole of two bodies.

        A pole is the axis of the relative rotation of two bodies. The circles are drawn to
        show its construction. Each circle goes through the poles that both bodies have with
        a third body, or lies in the contact plane of a sliding pair between the bodies.
        This plane contains the centre of the sphere and the normal of the contact.

        If the pole was computed as the intersection of two circles, these are returned. For
        any other pole, such as the axis of a pair, two circles through poles with third
        bodies are chosen and stored. The result is None if there are fewer than two third
        bodies whose poles with both bodies are known.
        """
        if body_pole not in self._circle_normals:
            i, j = body_pole
            third_bodies = [
                k
                for k in self.plan.bodies
                if k not in body_pole
                and pole_of(i, k) in self.directions
                and pole_of(j, k) in self.directions
            ]
            if len(third_bodies) < 2:
                return None
            with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
                circles = self._choose_great_circles(body_pole, third_bodies)
            self._circle_normals[body_pole] = circles.first_normal, circles.second_normal
        return self._circle_normals[body_pole]


def _unit_vectors(vectors: Floats) -> Floats:
    """Return vectors (3, n) divided by their lengths; NaN for zero vectors."""
    return vectors / norm_columns(vectors)


@dataclass(frozen=True)
class NullMotion:
    """The motion of a mechanism with one degree of freedom, at n configurations.

    Attributes
    ----------
    rates
        (n, variables) rates that satisfy the velocity equations, with norm 1. The sign and
        the scale of the motion are arbitrary.
    inverse
        (n, variables, equations + 1) left inverse of a matrix. The first rows of the matrix
        are the velocity equations J, and its last row is `rates`. From it follow the
        derivatives r' of the rates r along the motion: r' = inverse (-J' r, 0), where J'
        is the derivative of J along the motion.
    """

    rates: Floats
    inverse: Floats


def solve_null_motion(tree: LoopTree, vectors: Floats) -> NullMotion:
    """Return the motion of a mechanism with one degree of freedom, up to its scale.

    The rates of its variables are the null vector of its velocity equations.

    Parameters
    ----------
    tree
        The loops of the mechanism, or of a part of it.
    vectors
        (n, variables, 3) vector of each variable in ground axes: the relative angular
        velocity of the links of its pair at unit rate.

    Returns
    -------
    The rates with norm 1, and a left inverse of the equations. With the inverse, callers
    compute derivatives of the rates (`NullMotion`) and estimate errors. Both are NaN at
    configurations at which the equations are singular.
    """
    jacobian = tree.jacobian(vectors)
    n, _, count = jacobian.shape
    # A further equation, c . rates = 1, fixes the scale. Arbitrary coefficients c can be
    # nearly perpendicular to the rates, which costs digits. The second solution has the
    # first rates as c.
    arbitrary = np.broadcast_to(np.cos(1.0 + np.arange(count)), (n, count))
    first_motion = _solve_with_scale_equation(jacobian, arbitrary)
    return _solve_with_scale_equation(jacobian, first_motion.rates)


def _solve_with_scale_equation(jacobian: Floats, coefficients: Floats) -> NullMotion:
    """Return the rates that satisfy the loop equations, with a further equation.

    Parameters
    ----------
    jacobian
        (n, equations, variables) the loop equations.
    coefficients
        (n, variables) the coefficients c of the further equation c . rates = 1. The loop
        equations alone leave the scale of the rates open.
    """
    inverse = left_inverse(np.concatenate([jacobian, coefficients[:, None, :]], axis=1))
    # The last column of the inverse solves the equations with the right-hand side (0, 1).
    return NullMotion(rates=unit_rows(inverse[:, :, -1]), inverse=inverse)
