"""A whole mechanism in balls: link orientations, loop closure, and its derivatives.

All functions take the pair variables as balls. Orientations and loop residuals can also be
evaluated at power series, which gives all derivatives along a motion.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import factorial

import numpy as np

from spherekit.arrays import Array, Bools, Floats, Indices, SmallIntegers
from spherekit.mechanism.elements import PoseGeometry, Profile
from spherekit.mechanism.graph import find_spanning_tree
from spherekit.mechanism.joint import Joint
from spherekit.mechanism.joint_construction import make_joints
from spherekit.mechanism.mechanism import Mechanism
from spherekit.proof.ball_curves import Curve, evaluate_rotation, make_ball_curve
from spherekit.proof.ball_frames import (
    Frames,
    declared_frames,
    exact_ball,
    exact_balls,
    revolute_rotation_terms,
)
from spherekit.proof.balls import (
    centre_floats,
    exact_centres,
    flint_library,
    power_series,
    precision_bits,
    series_coefficient,
)
from spherekit.status import Status

MAX_CONTACT_STEPS = 60
"""Largest number of Newton steps to the contact of two profiles.

Larger: nearly equal curvatures converge. Smaller: the contact is less accurate there.
"""

MAX_CLOSURE_STEPS = 40
"""Largest number of Newton steps that close the loops.

Larger: poor starts succeed. Smaller: they fail sooner.
"""

ROUNDING_STEP_RATIO = 1e3
"""Step that counts as rounding, over the rounding times the condition number.

Larger: the iteration may end before it has converged. Smaller: it may not converge.
"""

MAX_START_CONTRACTION = 0.125
"""Largest second Newton step over the first one, if the start is near one solution only.

Larger: a start between two solutions counts as near one of them. Smaller: more starts are
reported as ambiguous.
"""

MAX_CONDITION_ROUNDING = 1.0 / 64.0
"""Condition number times rounding above which a matrix counts as rank deficient.

Larger: inverses with few digits are used. Smaller: more configurations count as singular.
"""

PairFunction = Callable[[Array], Array]
"""A function of the variables (n, m) of a pair, balls or power series."""


@dataclass(frozen=True)
class PairKinematics:
    """Two functions of the variables of a pair (joint): a rotation and a direction.

    Both functions take the values (n, variables) of the variables of the pair. Link
    orientations and directions of pairs are computed from their results.

    Attributes
    ----------
    rotation
        Returns the rotation of the second link relative to the first: matrices (n, 3, 3)
        from the axes of the second link to the axes of the first.
    axis
        Returns the direction of the pair: unit vectors (n, 3) in the axes of the first
        link. The direction of an R pair is its axis. A contact has no axis, so its
        direction is that from the centre of the sphere to the contact point.
    """

    rotation: PairFunction
    axis: PairFunction


def _revolute_kinematics(first: Array, second: Array) -> PairKinematics:
    """Return the kinematics of an R pair from its frames in both links."""
    terms = revolute_rotation_terms(first, second)
    return PairKinematics(
        rotation=lambda values: evaluate_rotation(terms, values[:, 0]),
        axis=lambda values: np.broadcast_to(first[2], (len(values), 3)),
    )


def _contact_kinematics(
    curves: Sequence[Curve], variables: tuple[int, int], starts: Array
) -> PairKinematics:
    """Return functions for the rotation and the direction of a contact of two profiles.

    The profile (rim) of each link is a curve: a function of arc lengths (n,) that returns
    frames (n, 3, 3) with the columns tangent, normal and point. At the contact both frames
    coincide, so the rotation from the second to the first link is (first frame) (second
    frame)^T. A contact has no axis. In place of it, `PairKinematics.axis` returns the
    direction of the contact point.

    Parameters
    ----------
    curves
        The profile of each link in link axes.
    variables
        The pair has one or two variables, which are arc lengths. For each curve this is the
        index (0 or 1) of the variable that belongs to it. In rolling, both curves have the
        same variable.
    starts
        (2,) arc length (rad) of each curve where its variable is 0.
    """

    def contact_frame(side: int, values: Array) -> Array:
        """Return the frames (n, 3, 3) of one curve at the contact, for variables (n, m)."""
        return curves[side](values[:, variables[side]] + starts[side])

    def rotation(values: Array) -> Array:
        """Return the rotations (n, 3, 3) from the second link to the first."""
        return contact_frame(0, values) @ contact_frame(1, values).swapaxes(1, 2)

    return PairKinematics(rotation, axis=lambda values: contact_frame(0, values)[:, :, 2])


def _find_contact(curves: Sequence[Curve], arc_lengths: Array) -> Array:
    """Return the arc lengths (2,) rad at which two profiles touch in the reference pose.

    The reference pose is the configuration in the file. Two wheels begin to roll from there
    on. So the caller takes the result as the arc lengths at which the variable of their
    contact is zero.

    At the contact the frames (tangent, normal, point) of both profile curves coincide.
    Newton's method solves this by least squares, since the profiles may miss each other by
    rounding. Numbers are balls (numbers with a bound of their error). The result of
    Newton's method is an approximation, whose ball has the bound 0.

    Parameters
    ----------
    curves
        The profile curve of each link. In the reference pose the axes of both links
        coincide.
    arc_lengths
        (2,) first approximation (rad).
    """
    # The variables of a contact are arc lengths along both curves, counted from `starts`.
    # Here they are counted from 0.
    kinematics = _contact_kinematics(
        curves, variables=(0, 1), starts=exact_balls(np.zeros(2))
    )
    last_step_size = np.inf
    for _ in range(MAX_CONTACT_STEPS):
        # Where the curves touch, the rotation from the second link to the first is the
        # identity, because the axes of both links coincide in the reference pose.
        step = _newton_step_to_identity(kinematics.rotation, arc_lengths)
        arc_lengths = exact_centres(arc_lengths + step)
        step_size = np.max(np.abs(centre_floats(step)))
        # Newton's steps shrink fast. A step of more than half the step before is only
        # rounding.
        if not step_size < last_step_size / 2:
            break
        last_step_size = step_size
    return arc_lengths


def _newton_step_to_identity(rotation: PairFunction, variables: Array) -> Array:
    """Return the Newton step (m,) of the variables of a contact towards touching profiles.

    The rotation of the contact leads from its second link to its first. It depends on the
    m variables of the contact, and is the identity where the profiles touch. The step makes
    the rotation the identity, to first order.

    The residual of Newton's method is the axis of the rotation times the sine of its angle.
    If this angle is small, the derivatives of the residual with respect to the variables
    are the angular velocities at unit rates.

    Parameters
    ----------
    rotation
        Function that returns the rotation of the contact at given variables.
    variables
        (m,) present values of the pair variables, in balls (numbers with error bounds).
    """
    values = variables[None]  # one configuration, as the functions of pairs take several
    (residual,) = skew_part(rotation(values))  # (3,)
    velocities_in_rows = _rotation_vectors(rotation, values)
    jacobians = velocities_in_rows.swapaxes(1, 2)  # (1, 3, m)
    (inverse,), _conditions = left_inverses(jacobians)
    return -(inverse @ residual)


def _rotation_vectors(rotation: PairFunction, values: Array) -> Array:
    """Return the angular velocity of a pair at unit rate of each of its variables.

    The motion is that of the second link relative to the first. Power series in time give
    the angular velocity.

    Parameters
    ----------
    rotation
        Function that returns the rotation of the pair at given variables.
    values
        (n, m) values of its m variables, in balls (numbers with a bound of their error).

    Returns
    -------
    (n, m, 3) angular velocities in the axes of the first link.
    """
    vectors = []
    # One variable moves at the rate 1 while all other variables rest.
    for direction in exact_balls(np.eye(values.shape[1])):
        # The variables as series in the time t: values + direction t. The rotation is then
        # a series, too, and contains the angular velocity.
        moving_values = power_series(values, np.broadcast_to(direction, values.shape))
        (angular_velocity,) = angular_velocities(rotation(moving_values), order=1)
        vectors.append(angular_velocity)
    return np.stack(vectors, axis=1)


def _make_pair_kinematics(mechanism: Mechanism, frames: Frames) -> list[PairKinematics]:
    """Return functions that compute the rotation and the axis of each pair, in balls.

    The rotation is that of the second link of the pair relative to the first. A ball is a
    number with a bound of its error. The functions serve to place all links with error
    bounds.

    Parameters
    ----------
    mechanism
        The mechanism.
    frames
        By name of a revolute pair: its frames in both links, in balls.
    """
    # A mechanism file has either sizes or a reference pose. Sizes include the arc lengths
    # at which wheels start to roll. In a reference pose, wheels start where they touch.
    has_reference_pose = isinstance(mechanism.geometry, PoseGeometry)
    kinematics = []
    # `joint` is the pair in float64. Only contacts need it: it has the indices of their
    # variables, and exact or approximate starts of their curves.
    for pair, joint in zip(mechanism.pairs, make_joints(mechanism), strict=True):
        if pair.profiles is None:
            kinematics.append(_revolute_kinematics(*frames[pair.name]))
            continue
        curves = _profile_curves(pair.profiles, is_external=pair.contact == "external")
        # The start of a curve is the arc length at which the variable of the contact is 0.
        starts = _contact_starts(joint, curves, has_reference_pose)
        # For each profile the index of the pair variable that is the arc length along it.
        first, second = joint.contact_profiles
        variables = (first.variable, second.variable)
        kinematics.append(_contact_kinematics(curves, variables, starts))
    return kinematics


def _profile_curves(
    profiles: tuple[Profile, Profile], is_external: bool
) -> tuple[Curve, Curve]:
    """Return the curves of two profiles in contact, with the same direction at the contact.

    If the profiles touch from outside (external contact), their centres are on opposite
    sides of the contact. The second curve must then run backwards about its centre.
    """
    first_profile, second_profile = profiles
    return (
        make_ball_curve(first_profile),
        make_ball_curve(second_profile, backwards=is_external),
    )


def _contact_starts(
    joint: Joint, curves: Sequence[Curve], has_reference_pose: bool
) -> Array:
    """Return the arc lengths (2,) at which the variables of a contact are 0.

    A file with link sizes states these arc lengths. If the file has a reference pose,
    wheels start to roll where they touch in this pose. The float64 geometry only
    approximates these points, so they are computed again with more digits.

    Parameters
    ----------
    joint
        The contact in the float64 geometry of the mechanism.
    curves
        The profile curve of each link.
    has_reference_pose
        Whether the file gives a reference pose.

    Returns
    -------
    Two arc lengths (rad) as balls (numbers with a bound of their error).
    """
    first, second = joint.contact_profiles
    float_starts = exact_balls([first.start, second.start])
    # Both arc lengths of a sliding contact are variables, so its starts are exactly 0.
    is_rolling = bool(joint.rolling_variables)
    if is_rolling and has_reference_pose:
        return _find_contact(curves, float_starts)
    return float_starts


@dataclass(frozen=True)
class LoopClosure:
    """Configurations in which Newton's method has closed the loops, from k starts.

    The caller expands the motion about these configurations in power series. Arrays contain
    balls: numbers with a bound (radius) of their error. Newton's method gives
    approximations without bounds, so the radius of its results is 0.

    Attributes
    ----------
    values
        (k, variables) pair variables (rad), balls. The radius of free variables is 0.
    free
        Indices of the variables for which Newton's method solved. The other variables, such
        as inputs, have their start values.
    inverse
        (k, free, equations) left inverses of the derivatives of the loop equations with
        respect to the `free` variables.
    condition
        (k,) condition numbers of these derivatives: Frobenius norm of the matrix times the
        Frobenius norm of its inverse.
    residual
        (k,) largest component (rad) of the closure errors of the loops.
    distance
        (k,) largest change (rad) of a variable from the start.
    is_ambiguous
        (k,) whether another solution may be as near to the start as this one. True if the
        second Newton step is not much shorter than the first.
    status
        (k,) OK, NOT_CONVERGED, or AT_SINGULARITY if the derivatives have a lower rank.
    """

    values: Array
    free: list[int]
    inverse: Array
    condition: Floats
    residual: Floats
    distance: Floats
    is_ambiguous: Bools
    status: SmallIntegers


@dataclass(frozen=True)
class _PlacedPair:
    """A pair (joint) of two links, with its place in the mechanism.

    With it, `Linkage` orients the links, and computes pair axes in ground axes.

    Attributes
    ----------
    kinematics
        Functions for the rotation of the second link relative to the first, and for the
        pair axis or contact point in the first link.
    variables
        Indices of the pair's variables among all variables of the mechanism.
    first_link
        Index of the first link of the pair.
    """

    kinematics: PairKinematics
    variables: tuple[int, ...]
    first_link: int


class Linkage:
    """The links of a mechanism, placed one after another from the ground, in balls.

    Every link is placed once, across the pair that reaches it first. Each further pair
    closes a loop. The residual of the loop is the skew part of the remaining rotation.

    Parameters
    ----------
    mechanism
        The mechanism.
    frames
        The frames of its R pairs. By default they are computed from the sizes of the
        mechanism. The float64 numbers of these sizes are taken as exact.
    """

    def __init__(self, mechanism: Mechanism, frames: Frames | None = None) -> None:
        """Find out which pairs (joints) place links, and which close loops.

        Parameters
        ----------
        mechanism
            The mechanism.
        frames
            By name of a revolute pair: its frames (3, 3) in both links, with the pair axis
            as z axis. By default they follow from the sizes of the mechanism, with float64
            numbers taken as exact.
        """
        self.mechanism = mechanism
        # Indices of the two links of each pair.
        ends = mechanism.ends
        all_kinematics = _make_pair_kinematics(
            mechanism, frames or declared_frames(mechanism)
        )
        self._pairs = [
            _PlacedPair(kinematics, mechanism.variables_of(pair), ends[pair][0])
            for pair, kinematics in enumerate(all_kinematics)
        ]
        # The spanning tree reaches each link from the ground by one pair. `_tree` lists
        # this pair, the link nearer to the ground (parent), and the link that is reached
        # (child), parents first. All other pairs close loops.
        self._tree = find_spanning_tree(ends)
        tree_pairs = [pair for pair, _, _ in self._tree]
        self._loop_pairs = np.setdiff1d(range(len(all_kinematics)), tree_pairs)
        # A sense is 1 if a path passes a pair from its first to its second link, and -1 in
        # the opposite direction. It is 0 if the path does not pass the pair. (links,
        # pairs): the path from the ground to each link.
        path_senses = _find_path_senses(mechanism, self._tree)
        # (loops, pairs): the path around each loop.
        loop_senses = _find_loop_senses(mechanism, self._loop_pairs, path_senses)
        # `variable_owners` has the pair of each variable. A pair with two variables gets
        # two columns.
        variable_owners = mechanism.variable_owners
        self._path_senses_of_variables = path_senses[:, variable_owners]
        self._loop_senses_of_variables = loop_senses[:, variable_owners]

    def place_links(self, values: Array) -> tuple[Array, Array]:
        """Return the orientations of all links, and the closure errors of the loops.

        The closure errors tell whether the pair variables belong to a configuration.

        Links are placed from the ground on, each across one pair (joint). Every other pair
        closes a loop. The product of the rotations around a loop is the identity if the
        loop is closed.

        Parameters
        ----------
        values
            (n, variables) pair variables (rad), in balls (numbers with a bound of their
            error). Power series of balls also give derivatives along a motion.

        Returns
        -------
        orientations
            (n, links, 3, 3) rotations from link axes to ground axes.
        residuals
            (n, 3 * number of loops) three numbers for each loop: the axis of the remaining
            rotation, in ground axes, times the sine of its angle. A closed loop has
            the residuals 0.
        """
        # For each pair the rotations (n, 3, 3) from its second link to its first.
        rotations = [
            pair.kinematics.rotation(values[:, pair.variables]) for pair in self._pairs
        ]
        # For each link its orientation (n, 3, 3). The ground is link 0.
        placed = {0: np.broadcast_to(exact_balls(np.eye(3)), (len(values), 3, 3))}
        for pair, parent, child in self._tree:
            first_link, _second_link = self.mechanism.ends[pair]
            if first_link == parent:
                child_to_parent = rotations[pair]
            else:
                # The transpose of a rotation is its inverse.
                child_to_parent = rotations[pair].swapaxes(1, 2)
            placed[child] = placed[parent] @ child_to_parent
        # The empty array gives the right shape if there is no loop.
        residuals = [exact_balls(np.zeros((len(values), 0)))]
        for pair in self._loop_pairs:
            first_link, second_link = self.mechanism.ends[pair]
            ground_to_second_link = placed[second_link].swapaxes(1, 2)
            remaining = placed[first_link] @ rotations[pair] @ ground_to_second_link
            residuals.append(skew_part(remaining))
        orientations = np.stack([placed[link] for link in range(len(placed))], axis=1)
        return orientations, np.concatenate(residuals, axis=1)

    def pair_axes(self, values: Array, orientations: Array) -> Array:
        """Return the direction of each pair (joint) in ground axes.

        All pairs are on a sphere. The direction from its centre is the axis of an R pair,
        or leads to the contact point of a contact pair.

        Parameters
        ----------
        values
            (n, variables) pair variables (rad).
        orientations
            (n, links, 3, 3) rotations from link axes to ground axes.

        Returns
        -------
        (n, pairs, 3) unit vectors.
        """
        ground_axes = []
        for pair in self._pairs:
            # The direction in the axes of the first link of the pair.
            link_axis = pair.kinematics.axis(values[:, pair.variables])
            ground_from_link = orientations[:, pair.first_link]
            ground_axes.append(np.matvec(ground_from_link, link_axis))
        return np.stack(ground_axes, axis=1)

    def variable_vectors(self, values: Array, orientations: Array) -> Array:
        """Return for each variable the angular velocity of its pair (joint) at unit rate.

        The closure Jacobian is computed from these vectors. The other variables rest. The
        velocity is that of the second link of the pair relative to the first. For a
        revolute pair it is the axis. For a contact it follows from the derivative of the
        rotation matrix.

        Parameters
        ----------
        values
            (n, variables) pair variables (rad), in balls (numbers with a bound of their
            error).
        orientations
            (n, links, 3, 3) rotations from link axes to ground axes.

        Returns
        -------
        (n, variables, 3) in ground axes.
        """
        vectors = []
        # `stated_pair` is the pair as in the file. `pair` has functions that compute its
        # kinematics in balls.
        for stated_pair, pair in zip(self.mechanism.pairs, self._pairs, strict=True):
            pair_values = values[:, pair.variables]
            is_revolute = stated_pair.profiles is None
            if is_revolute:
                vectors_in_link = pair.kinematics.axis(pair_values)[:, None]
            else:
                vectors_in_link = _rotation_vectors(pair.kinematics.rotation, pair_values)
            # Vectors are rows here, so the orientation is transposed.
            transposed = orientations[:, pair.first_link].swapaxes(1, 2)
            vectors.append(vectors_in_link @ transposed)
        return np.concatenate(vectors, axis=1)

    def link_velocities(self, vectors: Array, rates: Array) -> Array:
        """Return the angular velocities of all links relative to the ground.

        The velocity of a link is a sum over the variables on the path from the ground to
        the link: rate times velocity vector. Each term has the sign of the sense in which
        the path passes the pair.

        Parameters
        ----------
        vectors
            (n, variables, 3) angular velocity of each pair at unit rate of the variable, in
            ground axes.
        rates
            (n, variables) rates of the variables.

        Returns
        -------
        (n, links, 3) in ground axes.
        """
        # (links, variables): 1 or -1 on the path of a link, 0 for all other variables.
        return self._path_senses_of_variables @ (vectors * rates[:, :, None])

    def jacobian(self, vectors: Array) -> Array:
        """Return the derivatives of loop closure errors with respect to the variables.

        The closure error of a loop is the small rotation by which the loop is open. Its
        derivative with respect to a variable is the angular velocity of the pair (joint) at
        unit rate, multiplied by a sign. The sign is the sense in which the loop passes the
        pair, 1 or -1. It is 0 if the loop does not pass the pair.

        Parameters
        ----------
        vectors
            (n, variables, 3) angular velocity of each pair at unit rate of the variable, in
            ground axes.

        Returns
        -------
        (n, 3 loops, variables) derivatives, in ground axes. There are three rows for each
        loop, one for each component.
        """
        senses = self._loop_senses_of_variables  # (loops, variables)
        vectors_as_columns = vectors.swapaxes(1, 2)  # (n, 3, variables)
        # Axes: configuration, loop, component, variable.
        signed_vectors = senses[None, :, None, :] * vectors_as_columns[:, None, :, :]
        return signed_vectors.reshape(len(vectors), 3 * len(senses), vectors.shape[1])

    def close_loops(self, start: Array, held: Sequence[int], eps: float) -> LoopClosure:
        """Close the loops by Newton's method, while some variables keep their values.

        A step is -J^+ r, with the left inverse J^+ of the Jacobian and the residual r. A
        row is one configuration. Its iteration ends when steps are only rounding: they no
        longer shrink, or are a few eps, and are at most `ROUNDING_STEP_RATIO` times eps
        times the condition number. Rows that fail have a status other than OK.

        Parameters
        ----------
        start
            (k, variables) start values (rad), as balls (numbers with a bound of their
            error). Bounds of held variables need not be 0.
        held
            Indices of the variables that keep their values.
        eps
            Distance from 1 to the next larger number in the present precision.
        """
        k, count = start.shape
        free = [variable for variable in range(count) if variable not in held]
        values = start.copy()
        # (k,) size of the previous step of each row (rad).
        last_step_size = np.full(k, np.inf)
        status = np.full(k, Status.NOT_CONVERGED, dtype=np.int8)
        is_active = np.ones(k, dtype=bool)
        # One array (k,) for each step.
        step_sizes = []
        while True:
            orientations, residuals = self.place_links(values)
            jacobian = self.jacobian(self.variable_vectors(values, orientations))
            inverse, condition = left_inverses(jacobian[:, :, free])
            change = -np.matvec(inverse, residuals)
            step_size = largest_in_rows(change)
            rounding = ROUNDING_STEP_RATIO * eps * condition
            step_sizes.append(step_size)
            is_rounding = (step_size <= rounding) & (
                (step_size <= 4 * eps) | (step_size >= last_step_size / 2)
            )
            status[is_active & is_rounding] = Status.OK
            status[is_active & ~np.isfinite(step_size)] = Status.AT_SINGULARITY
            # A step of more than 1 rad has left the neighbourhood of the start.
            is_active &= ~is_rounding & (step_size <= 1.0)
            if len(step_sizes) > MAX_CLOSURE_STEPS or not np.any(is_active):
                break
            last_step_size = step_size
            active_change = np.where(is_active[:, None], change, 0)
            values[:, free] = exact_centres(values[:, free] + active_change)
        # If there is only one solution near the start, the second step is much shorter than
        # the first. A single step counts as the first and the second.
        second_step = step_sizes[:2][-1]
        is_ambiguous = second_step > np.maximum(
            rounding, MAX_START_CONTRACTION * step_sizes[0]
        )
        return LoopClosure(
            values=values,
            free=free,
            inverse=inverse,
            condition=condition,
            residual=largest_in_rows(residuals),
            distance=largest_in_rows(values - start),
            is_ambiguous=is_ambiguous,
            status=status,
        )

    def expand_motion(
        self, closure: LoopClosure, moving_variable: int, order: int
    ) -> list[Array]:
        """Return all variables as power series in one variable that moves.

        The coefficients are computed power by power, so that the loops stay closed. Let J
        be the derivatives of the closure errors with respect to the free variables. The
        coefficients c_p of these variables for the power p occur for the first time in the
        closure errors of power p:

            error of power p = J c_p + (terms of lower powers).

        With c_p = 0 the error is these terms. So c_p is minus the inverse of J times this
        error.

        Parameters
        ----------
        closure
            Closed configurations. The free variables are all variables except the moving
            variable and the locked variables.
        moving_variable
            Index of the moving variable.
        order
            Highest power.

        Returns
        -------
        For each power from 0 to the order the coefficients (k, variables) in k
        configurations.
        """
        coefficients = [
            closure.values,
            *exact_balls(np.zeros((order, *closure.values.shape))),
        ]
        coefficients[1][:, moving_variable] = exact_ball(1.0)
        for power in range(1, order + 1):
            # Here the coefficients of the free variables for this power are still 0.
            _, residuals = self.place_links(power_series(*coefficients[: power + 1]))
            residual = series_coefficient(residuals, power)
            coefficients[power][:, closure.free] = -np.matvec(closure.inverse, residual)
        return coefficients


def _find_path_senses(mechanism: Mechanism, tree: Sequence[tuple[int, int, int]]) -> Floats:
    """Return in which sense the path from the ground to each link passes each pair (joint).

    With these senses as factors, the angular velocity of a link is the sum of the angular
    velocities of the pairs on its path.

    Parameters
    ----------
    mechanism
        The mechanism.
    tree
        For each pair of the spanning tree: its number, the link nearer to the ground
        (parent), and the link that it places (child). Parents come before their children.

    Returns
    -------
    (links, pairs) 1 if the path passes the pair from its first to its second link, -1 in
    the opposite sense, 0 if the pair is not on the path.
    """
    senses = np.zeros((len(mechanism.links), len(mechanism.pairs)))
    for pair, parent, child in tree:
        first_link, _second_link = mechanism.ends[pair]
        senses[child] = senses[parent]
        senses[child, pair] = 1.0 if first_link == parent else -1.0
    return senses


def _find_loop_senses(
    mechanism: Mechanism, loop_pairs: Indices, path_senses: Floats
) -> Floats:
    """Return in which sense each loop passes each pair (joint): 1, -1, or 0 if it does not.

    A loop runs from the ground to the first link of the pair that closes it, over this pair
    to its second link, and back to the ground. The sense is 1 from the first to the second
    link of a pair. The result has the shape (loops, pairs). The derivative of the closure
    error of a loop with respect to the variable of a pair has the sense as a factor.

    Parameters
    ----------
    mechanism
        The mechanism.
    loop_pairs
        Indices of the pairs that close a loop.
    path_senses
        (links, pairs) the senses in which the path from the ground to each link passes the
        pairs.
    """
    senses = np.zeros((len(loop_pairs), len(mechanism.pairs)))
    for loop, pair in enumerate(loop_pairs):
        first_link, second_link = mechanism.ends[pair]
        senses[loop] = path_senses[first_link] - path_senses[second_link]
        senses[loop, pair] += 1.0
    return senses


def largest_in_rows(values: Array) -> Floats:
    """Return the largest magnitude (k,) in each row of an array (k, m), 0 without columns.

    The numbers are balls (numbers with a bound of their error). The bounds are ignored.
    """
    return np.max(np.abs(centre_floats(values)), axis=1, initial=0.0)


def angular_velocities(rotations: Array, order: int) -> list[Array]:
    """Return the angular velocity and its derivatives from power series of rotations.

    The angular velocity of a rotation R(t) is the vector of the skew matrix R' R^T. If the
    series R has the coefficients R_0, R_1, ..., then the coefficient of t^p in R' R^T is
    the sum over k = 0 ... p of (k + 1) R_(k + 1) R_(p - k)^T.

    Parameters
    ----------
    rotations
        (..., 3, 3) rotations as power series in one variable t.
    order
        Highest power of the series that is used.

    Returns
    -------
    `order` arrays (..., 3): the angular velocity at unit rate of t, then its derivatives
    with respect to t, from the first on.
    """
    coefficients = [series_coefficient(rotations, power) for power in range(order + 1)]
    velocity_and_derivatives = []
    for power in range(order):
        products = []
        for k in range(power + 1):
            rate_coefficient = (k + 1) * coefficients[k + 1]  # of R' for t^k
            products.append(rate_coefficient @ coefficients[power - k].swapaxes(-1, -2))
        velocity_coefficient = skew_part(np.sum(products, axis=0))
        # The derivative of order p is the factorial of p times the coefficient of t^p.
        velocity_and_derivatives.append(factorial(power) * velocity_coefficient)
    return velocity_and_derivatives


def skew_part(matrices: Array) -> Array:
    """Return the vectors (..., 3) of the skew parts of matrices (..., 3, 3).

    The vector of a rotation matrix is its axis times the sine of its angle.
    """
    twice_skew = matrices - matrices.swapaxes(-1, -2)
    components = [twice_skew[..., 2, 1], twice_skew[..., 0, 2], twice_skew[..., 1, 0]]
    return np.stack(components, axis=-1) / 2


def left_inverses(matrices: Array) -> tuple[Array, Floats]:
    """Return left inverses of matrices, and their condition numbers.

    The elements are balls (numbers with a bound of their error), but only the centres are
    used. So the inverses are approximations without error bounds.

    Parameters
    ----------
    matrices
        (n, m, k) with m >= k.

    Returns
    -------
    inverses
        (n, k, m) left inverses B with B A = 1, as balls of radius 0. NaN for matrices
        without full column rank.
    condition
        (n,) condition numbers in Frobenius norms, at least 1. NaN where the inverse is NaN.
    """
    bits = precision_bits()
    n, m, k = matrices.shape
    inverses = np.full((n, k, m), flint_library().arb.nan())
    condition = np.full(n, np.nan)
    for row, matrix in enumerate(matrices):
        inverse = _approximate_left_inverse(matrix, bits)
        if inverse is None:
            continue
        matrix_norm = np.linalg.norm(centre_floats(matrix))
        number = matrix_norm * np.linalg.norm(centre_floats(inverse))
        # Rounding the matrix, by 2^-bits, changes the inverse by this relative amount. If
        # it is large, the matrix counts as rank deficient, and the result stays NaN.
        inverse_error = number * 2.0**-bits
        if inverse_error < MAX_CONDITION_ROUNDING:
            inverses[row] = inverse
            condition[row] = np.maximum(number, 1.0)
    return inverses, condition


def _approximate_left_inverse(matrix: Array, bits: int) -> Array | None:
    """Return the left inverse (A^T A)^-1 A^T of a matrix A, None if A^T A is singular.

    The result is an approximation without an error bound.

    A^T A is computed with more than twice as many bits as A has, since its condition number
    is the square of the condition number of A.

    Parameters
    ----------
    matrix
        (m, k) balls (numbers with a bound of their error). Only their centres are used.
    bits
        Number of bits to which the elements of the matrix are rounded.

    Returns
    -------
    (k, m) balls of radius 0.
    """
    flint = flint_library()
    m, k = matrix.shape
    bits_of_square = 2 * bits + 64
    # `mid` sets the radii of balls to 0.
    with flint.ctx.workprec(bits_of_square):
        centre_matrix = flint.arb_mat(m, k, list(matrix.ravel())).mid()
        transposed = centre_matrix.transpose()
        try:
            inverse_of_square = (transposed * centre_matrix).inv().mid()
        except ZeroDivisionError:
            return None
        left_inverse = (inverse_of_square * transposed).mid()
    return np.reshape(left_inverse.entries(), (k, m))
