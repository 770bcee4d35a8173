"""Friction that depends on reactions, and changes these reactions.

A pair k with friction carries one or two loads, numbered by j: the forces on its bearings,
or the moment of the normal force of a contact. Each load is a_kj + sum_l b_kjl f_l, where
f_l are the friction torques of all such pairs. So the friction torques satisfy

    f_k = r_k sum_j |a_kj + sum_l b_kjl f_l|,   r_k = -mu_k tanh(v_k / v0_k)

with the friction coefficient mu_k, the rate v_k of the pair and the rate v0_k that smooths
the friction. A change of f changes the right-hand side by at most B times that change, with
B_kl = |r_k| sum_j |b_kjl|. The largest eigenvalue of B is called the feedback. If it is
below 1, the iteration of this equation contracts, so there is exactly one solution and the
iteration converges to it. Otherwise there may be several solutions or none: the bearings
can lock. A Newton step replaces a step of the iteration if it leaves a smaller residual.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import count

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.conventions import Names
from spherekit.dynamics.generalised_forces import Loads
from spherekit.dynamics.transmitted_forces import (
    AXIAL_FORCE,
    DEPENDENT_REACTIONS_RATIO,
    MAX_TOOTH_SIDE_CHANGES,
    MAX_UNDETERMINED_PART,
    MOMENT_COMPONENTS,
    DrivenEquilibrium,
    DrivenState,
    NewtonEuler,
    acceleration_wrenches,
    links_without_centre,
    solve_equilibrium,
)
from spherekit.errors import SolveError
from spherekit.geometry.vectors import max_abs, nans
from spherekit.mechanism.load import BearingFriction
from spherekit.mechanism.mechanism import Mechanism
from spherekit.wording import listing

CARRIED_LOAD_TOLERANCE = 1e-14
"""Relative change of the carried loads at which the iteration for friction has converged.

The change is relative to the largest carried load. Larger: friction is less accurate.
Smaller: rounding keeps the iteration from ending.
"""

MAX_FRICTION_ITERATIONS = 100
"""Iterations after which friction is reported as unknown."""


@dataclass(frozen=True)
class IndeterminateForces:
    """What a mechanism file would have to state so that all forces in pairs are determined.

    A pair is a joint of two links, and a contact is one kind of pair.

    Attributes
    ----------
    centres
        Names of links with inertia for which the file states no centre of mass.
    distances
        Names of contacts whose distance from the centre O of the sphere is not known.
    floating
        Names of pairs whose bearings would have to let the link slide along the axis. If
        more bearings hold links along their axes than equilibrium can determine, their
        axial forces are not determined.
    enough
        Whether all of this information together would determine all forces. If not, other
        constraints are redundant.
    """

    centres: Names = ()
    distances: Names = ()
    floating: Names = ()
    enough: bool = True

    @property
    def wanted(self) -> list[str]:
        """The information that would determine the forces, as phrases for a message.

        The message tells the user what to add to the mechanism file.
        """
        wanted = []
        if self.centres:
            wanted.append(f"mass and centre of the links {listing(self.centres)}")
        if self.distances:
            wanted.append(
                f"the distance of the contacts {listing(self.distances)} from the centre"
            )
        # If too many bearings hold links along their axes, equilibrium does not determine
        # the axial forces. A bearing that lets its link slide has no axial force, so the
        # message suggests to state such bearings.
        if self.floating:
            wanted.append(
                f"which bearings of the pairs {listing(self.floating)}, or of others in "
                "their loops, take no axial force (key axial)"
            )
        # All information above would still leave some forces undetermined.
        if not self.enough:
            wanted.append("constraints that are not redundant")
        return wanted


def diagnose_indeterminate_forces(
    mechanism: Mechanism, frames: Floats
) -> IndeterminateForces:
    """Return what a file must still state, so that the forces in all pairs are determined.

    The result has centres of mass, distances of contacts, and pairs (joints) that would
    have to float. A floating pair lets its links slide along the axis, so it transmits no
    axial force.

    Equilibrium does not determine reactions that balance each other without loads. Such
    reactions form a linear space. Each floating pair removes one dimension of this space.
    The floating pairs are chosen one after another, each with the largest axial force in
    the remaining space.

    Parameters
    ----------
    mechanism
        The mechanism whose forces are not determined.
    frames
        (pairs, 3, 3) axes of the pairs in their columns, in ground axes.
    """
    distances = tuple(
        pair.name
        for pair in mechanism.pairs
        if not pair.kind.has_axis and pair.distance is None
    )
    # Masses, centres and unknown distances get arbitrary values: which reactions balance
    # each other does not depend on them.
    complete_mechanism = replace(
        mechanism,
        masses=tuple(
            replace(mass, mass=1.0, centre=(0.0, 0.0, 0.0)) for mass in mechanism.masses
        ),
        pairs=tuple(
            replace(pair, distance=1.0) if pair.name in distances else pair
            for pair in mechanism.pairs
        ),
    )
    equations = NewtonEuler(complete_mechanism, frames[None], forces=True)
    _, singular_values, right = np.linalg.svd(equations.matrix[0])
    rank = np.count_nonzero(
        singular_values > DEPENDENT_REACTIONS_RATIO * singular_values[0]
    )
    # (columns, k): an orthonormal basis of the reactions that balance each other
    balanced = right[rank:].T
    # Each column is a pair and the component (0 to 5) of its moment and force.
    components = [component for _, component in equations.columns]
    axial_columns = [
        k for k, component in enumerate(components) if component == AXIAL_FORCE
    ]
    from scipy.linalg import qr

    # QR with pivoting chooses the pairs one after another, each with the largest axial
    # force in the remaining space.
    basis_change, triangle, order = qr(balanced[axial_columns].T, pivoting=True)
    chosen = np.count_nonzero(np.abs(np.diag(triangle)) >= np.sqrt(MAX_UNDETERMINED_PART))
    chosen_columns = [axial_columns[k] for k in order[:chosen]]
    floating = sorted(equations.columns[column][0] for column in chosen_columns)
    # Basis of the space that remains if all chosen pairs slide.
    remaining = balanced @ basis_change[:, chosen:]
    is_force = [
        k for k, component in enumerate(components) if component >= MOMENT_COMPONENTS
    ]
    return IndeterminateForces(
        centres=tuple(links_without_centre(mechanism)),
        distances=distances,
        floating=tuple(mechanism.names_of(floating)),
        enough=not np.any(remaining[is_force] ** 2 > MAX_UNDETERMINED_PART),
    )


@dataclass(frozen=True)
class CarriedLoads:
    """The loads that pairs (joints) with friction carry, at n rows (samples of a motion).

    Friction depends on the carried loads and changes these loads, so the loads are computed
    by iteration.

    Attributes
    ----------
    carried
        (n, k) loads of k pairs with friction. The load of a revolute pair is the sum of the
        magnitudes of the forces (N) on its bearings. The load of a contact is the moment
        (N m) of the normal force about the centre of the sphere. NaN in rows without a
        motion.
    is_unknown
        (n,) whether the friction is not known: the iteration has not converged, there may
        be no single solution, so that bearings may lock, or the sides on which gear teeth
        press with this friction are not found.
    iterations
        Number of iterations.
    """

    carried: Floats
    is_unknown: Bools
    iterations: int


def solve_bearing_friction(
    frictionless: DrivenState,
    loads: Loads,
    is_finite: Bools,
    inverse_inertia: Floats | None = None,
) -> CarriedLoads:
    """Return the loads that pairs with friction carry, from the motion without friction.

    The friction torques f of all such pairs depend on the loads that they carry, and change
    these loads. The load j of pair k (force on a bearing, or moment of a contact) is the
    vector a_kj + sum_l b_kjl f_l. The vectors a and b are computed here. `_solve_friction`
    then solves f_k = r_k sum_j |a_kj + sum_l b_kjl f_l|, where r_k is the friction
    coefficient times the law of friction at the rate of pair k.

    The vectors depend on the sides on which gear teeth press. Where friction reverses a
    side, the equation is solved again with the other side.

    Parameters
    ----------
    frictionless
        n rows of the moving mechanism without this friction.
    loads
        The loads of the mechanism.
    is_finite
        (n,) whether a row is solved. The carried loads of other rows are NaN.
    inverse_inertia
        (n, m, m) inverse of the inertia matrix, from which the change of the accelerations
        by friction follows. If it is None, the accelerations are given, and friction
        changes the torques at the inputs.

    Raises
    ------
    SolveError
        If a reaction from which friction follows is not determined.
    """
    components = [loads.components[k] for k in loads.friction_components]
    carried = nans((len(is_finite), len(components)))
    is_unknown = np.zeros(len(is_finite), dtype=bool)
    # Only rows that are to be solved; the results are inserted at the end.
    driven = frictionless.rows(is_finite)
    mechanism = driven.mechanism
    motion = driven.motion
    timing = driven.timing

    frictions = [x.bearing_friction for x in components if x.bearing_friction is not None]
    friction_pairs = [mechanism.pair_number[friction.pair] for friction in frictions]
    needs_forces = any(friction.needs_forces for friction in frictions)
    balance = solve_equilibrium(driven, needs_forces)
    _check_determined(driven, balance, frictions)

    def compute_carried(equations: NewtonEuler, reaction_wrenches: Floats) -> Floats:
        """Return the loads that k pairs with friction carry at n rows, as vectors.

        The friction at a pair follows from the magnitudes of its vectors. The vectors
        without friction are the a_kj above. Those for a friction torque of 1 N m at one
        pair are the b_kjl.

        Parameters
        ----------
        equations
            The equations of the reactions. They depend on the sides of gear teeth that
            press on each other.
        reaction_wrenches
            (n, links, 6) for each link the moment (N m) about the centre and the force (N)
            that the reactions of all its pairs together exert on it.

        Returns
        -------
        (n, k, 2, 3) one or two vectors for each pair, in the axes of the pair. Those of a
        revolute pair are the forces (N) on its bearings. A contact has one vector: the
        moment (N m) of its normal force about the centre. A missing second vector is 0.
        """
        # A reaction is one component of the moment or force in a pair. The residual of the
        # equations is not needed.
        reactions, _residual = equations.solve_reactions(reaction_wrenches)
        # (n, pairs, 6) moment and force of each pair, the sum of its reactions.
        wrenches = equations.sum_wrenches(reactions)
        carried_loads = np.zeros((len(reaction_wrenches), len(friction_pairs), 2, 3))
        for k, (friction, pair) in enumerate(zip(frictions, friction_pairs, strict=True)):
            # Moment and force in the pair. Its bearings share them by their positions.
            moment = wrenches[:, pair, :3]
            force = wrenches[:, pair, 3:] if friction.needs_forces else None
            loads_at_pair = friction.supported_loads(moment, force)
            carried_loads[:, k, : loads_at_pair.shape[1]] = loads_at_pair
        return carried_loads

    # The generalised force of a friction torque of 1 N m is the velocity of its pair, per
    # unit rate of each coordinate: (n, k, m).
    velocities = np.swapaxes(loads.velocities(motion)[..., loads.friction_components], 1, 2)
    if inverse_inertia is None:
        # The accelerations are given, so the torques at the inputs balance the friction.
        acceleration_changes = 0.0 * velocities
        input_torque_changes = -velocities
    else:
        # The torques at the inputs are given, so friction changes the accelerations.
        acceleration_changes = velocities @ inverse_inertia[is_finite]
        input_torque_changes = 0.0 * velocities
    input_pairs = [mechanism.pair_number[item.pair] for item in mechanism.inputs]

    # The changes of the wrenches of the reactions by 1 N m of friction at each pair.
    frictionless_wrenches = balance.equilibrium.reaction_wrenches
    wrench_changes = []
    for k, pair in enumerate(friction_pairs):
        # Only this torque and the changes that it causes act, without loads.
        torques = np.zeros((len(frictionless_wrenches), len(mechanism.pairs)))
        torques[:, input_pairs] = input_torque_changes[:, k]
        torques[:, pair] += 1.0
        needed = acceleration_wrenches(mechanism, motion, acceleration_changes[:, k])
        wrench_changes.append(balance.equations.subtract_torques(needed, torques))

    # The factors r_k: friction per unit of the load that is carried.
    laws = [component.magnitude for component in components]
    factors = loads.friction_coefficients * loads.evaluate_laws(
        laws, motion, timing.dq, timing.t
    )
    has_teeth = any(pair.pressure_angle is not None for pair in mechanism.pairs)
    is_settled = np.ones(len(frictionless_wrenches), dtype=bool)
    equations = balance.equations
    iterations = 0
    for _ in range(MAX_TOOTH_SIDE_CHANGES):
        # The loads a_kj without friction, and their changes b_kjl, l on the last axis.
        without_friction = compute_carried(equations, frictionless_wrenches)
        per_friction = np.stack(
            [compute_carried(equations, change) for change in wrench_changes], axis=-1
        )
        solution = _solve_friction(
            FrictionEquation(without_friction, per_friction, factors)
        )
        iterations += solution.iterations
        if not has_teeth:
            break
        # The sides on which teeth press with this friction.
        known_loads = np.where(solution.is_unknown[:, None], 0.0, solution.carried)
        friction = (factors * known_loads)[:, None]
        with_friction = replace(
            driven,
            timing=replace(
                timing, ddq=timing.ddq + (friction @ acceleration_changes)[:, 0]
            ),
            torques=driven.torques + (friction @ input_torque_changes)[:, 0],
            carried=known_loads,
        )
        balance = solve_equilibrium(with_friction, needs_forces)
        is_same = balance.equations.unit_wrenches == equations.unit_wrenches
        is_settled = balance.is_settled & np.all(is_same, axis=(1, 2))
        if np.all(is_settled):
            break
        equations = balance.equations
    carried[is_finite] = solution.carried
    is_unknown[is_finite] = solution.is_unknown | ~is_settled
    return CarriedLoads(carried, is_unknown, iterations)


def _check_determined(
    driven: DrivenState, balance: DrivenEquilibrium, frictions: Sequence[BearingFriction]
) -> None:
    """Raise `SolveError` if a reaction that causes friction is not determined.

    Friction is computed from the reaction in its pair (joint). Redundant constraints can
    leave this reaction undetermined.

    Parameters
    ----------
    driven
        The motion with its driving torques.
    balance
        The equations of the reactions in this motion, and their solution.
    frictions
        All loads that are friction of bearings or contacts.
    """
    for friction in frictions:
        _check_moments_determined(balance, friction)
        if friction.needs_forces:
            _check_forces_determined(driven, balance, friction)


def _check_moments_determined(
    balance: DrivenEquilibrium, friction: BearingFriction
) -> None:
    """Raise `SolveError` if the moment in the pair with this friction is not determined.

    The friction is computed from this moment. Redundant constraints can leave the moment
    undetermined. The moment is also undetermined if `solve_equilibrium` did not find the
    side on which gear teeth press.
    """
    mechanism = balance.equations.mechanism
    pair_number = mechanism.pair_number[friction.pair]
    # Components that the equations of equilibrium do not determine.
    open_components = balance.equations.open_components[:, pair_number]
    is_moment_open = np.any(open_components[:, :MOMENT_COMPONENTS])
    are_tooth_sides_known = np.all(balance.is_settled)
    if is_moment_open or not are_tooth_sides_known:
        # The message advises a load of kind "friction", which does not depend on reactions.
        raise SolveError(
            f"{mechanism.name}: loads.{friction.name}: redundant constraints leave the "
            f"reaction of pair {friction.pair} undetermined, and with it the friction "
            "that follows from it; use a load of kind friction instead, or give gears "
            "their pressure_angle"
        )


def _check_forces_determined(
    driven: DrivenState, balance: DrivenEquilibrium, friction: BearingFriction
) -> None:
    """Raise `SolveError` if the force in the pair with this friction is not determined.

    A pair (joint) transmits a couple, and a force through the centre O of the sphere. The
    force loads the bearings and so causes friction.

    The force is not determined in two cases. The equations of equilibrium can have several
    solutions for it. Or there is a link that no pair holds at O: the forces in all pairs
    then count as not determined.

    Parameters
    ----------
    driven
        The motion with its driving torques.
    balance
        The equations of the reactions in this motion, and their solution.
    friction
        The friction of a bearing.
    """
    mechanism = driven.mechanism
    equations = balance.equations
    pair_number = mechanism.pair_number[friction.pair]
    # Whether the equations leave a component of the moment or force of this pair open.
    has_several_solutions = np.any(equations.open_components[:, pair_number])
    # Whether some link can be displaced from O.
    is_link_loose = np.any(equations.slides)
    if not has_several_solutions and not is_link_loose:
        return
    # Phrases for the information that the file lacks, such as the distance of a contact.
    # They are found from the pair axes in the first row (sample) of the motion.
    frames = driven.motion.frames[0]
    lacking_information = diagnose_indeterminate_forces(mechanism, frames).wanted
    # "Both" in the advice means the force and the friction.
    advice = ""
    if lacking_information:
        advice = f"; to determine both, state in the file: {listing(lacking_information)}"
    raise SolveError(
        f"{mechanism.name}: loads.{friction.name}: the force through the centre in "
        f"pair {friction.pair} is not determined, so the friction that it causes "
        f"in the bearings is not determined either{advice}; leave the key axial out "
        "to compute only the friction due to the couple"
    )


@dataclass(frozen=True)
class FrictionEquation:
    """The equation that the friction torques f of pairs satisfy, at n rows of a motion.

    Pair k is a revolute pair or a contact. A revolute pair carries a force (N) on each of
    one or two bearings. A contact carries one moment (N m). Each of these loads j is
    a_kj + sum_l b_kjl f_l, since friction in pair l changes the reactions in pair k.
    Friction is proportional to the loads: f_k = r_k sum_j |a_kj + sum_l b_kjl f_l|.

    Attributes
    ----------
    without_friction
        (n, pairs, 2, 3) vectors a_kj of the loads without friction. The third axis is j. A
        missing second load is 0.
    per_friction
        (n, pairs, 2, 3, pairs) vectors b_kjl, the changes of the loads by 1 N m of
        friction. The last axis is the pair l at which this friction acts.
    factors
        (n, pairs) factors r_k: friction torque per unit of the carried load. The sign is
        opposite to the motion of the pair, and the size is smaller near zero speed.
    """

    without_friction: Floats
    per_friction: Floats
    factors: Floats

    def compute_loads(self, friction: Floats) -> Floats:
        """Return the load vectors (n, pairs, 2, 3) for friction torques (n, pairs), N m."""
        # The letters are: n rows, k and l pairs, j loads of a pair, a components.
        return self.without_friction + np.einsum(
            "nkjal,nl->nkja", self.per_friction, friction
        )

    def sum_loads(self, friction: Floats) -> Floats:
        """Return, for each pair, the sum (n, pairs) of the magnitudes of its loads.

        The loads depend on the friction torques `friction` (n, pairs), N m.
        """
        return np.sum(np.linalg.norm(self.compute_loads(friction), axis=3), axis=2)

    def find_contracting_rows(self) -> Bools:
        """Return a mask (n,) of rows in which the friction torques have a single solution.

        If f changes, the right side of the equation changes by at most B times this change,
        with B_kl = |r_k| sum_j |b_kjl|. If the largest eigenvalue of B is below 1, the
        equation is a contraction, which has a single solution.
        """
        sensitivities = np.sum(np.linalg.norm(self.per_friction, axis=3), axis=2)
        eigenvalues = np.linalg.eigvals(np.abs(self.factors)[..., None] * sensitivities)
        return max_abs(eigenvalues, axis=1) < 1.0

    def right_side_slope(self, friction: Floats) -> Floats:
        """Return the derivatives (n, pairs, pairs) of the right sides with respect to f.

        The right side of equation k is r_k sum_j |load_kj|. The result has at [:, k, l] the
        derivative with respect to f_l. The derivative of |load| is the unit vector of the
        load times the derivative of the load.
        """
        load_vectors = self.compute_loads(friction)
        lengths = np.linalg.norm(load_vectors, axis=3, keepdims=True)
        with np.errstate(invalid="ignore", divide="ignore"):
            directions = np.nan_to_num(load_vectors / lengths)
        return np.einsum("nk,nkja,nkjal->nkl", self.factors, directions, self.per_friction)


def _solve_friction(equation: FrictionEquation) -> CarriedLoads:
    """Return the loads that pairs carry, from the equation of their friction torques f.

    The equation is f = r L(f). The friction torque of a pair is a factor r times the load L
    that the pair carries. This load depends on the friction torques of all pairs.

    Each iteration tries two new values of f: the right side of the equation at the last f
    (fixed-point iteration), and a Newton step. In each row (sample of the motion) the value
    with the smaller residual is used.

    A row contracts if the right side changes less than f does. Such a row has exactly one
    solution. Other rows may have none or several.

    Returns
    -------
    The carried loads. Friction is marked as unknown in rows that do not contract, or that
    have not converged.
    """
    factors = equation.factors  # r
    is_contracting = equation.find_contracting_rows()
    friction = np.zeros_like(factors)  # f
    carried = equation.sum_loads(friction)  # L(f)
    for iterations in count(1):
        previous = carried
        fixed_point = factors * carried
        newton = _step_by_newton(equation, friction, fixed_point, is_contracting)

        fixed_point_loads = equation.sum_loads(fixed_point)
        newton_loads = equation.sum_loads(newton)
        fixed_point_residual = max_abs(fixed_point - factors * fixed_point_loads, axis=1)
        newton_residual = max_abs(newton - factors * newton_loads, axis=1)
        is_newton_better = (newton_residual < fixed_point_residual)[:, None]
        friction = np.where(is_newton_better, newton, fixed_point)
        carried = np.where(is_newton_better, newton_loads, fixed_point_loads)

        change = max_abs(carried - previous, axis=1)
        # Rows that do not contract take part in each iteration. They ask for no further
        # one, because their friction counts as unknown anyway. Rows with NaN do not count
        # as converged.
        is_converged = change <= CARRIED_LOAD_TOLERANCE * np.max(carried, axis=1)
        needs_iteration = is_contracting & ~is_converged
        if iterations == MAX_FRICTION_ITERATIONS or not np.any(needs_iteration):
            break
    is_unknown = needs_iteration | ~is_contracting
    return CarriedLoads(carried, is_unknown, iterations)


def _step_by_newton(
    equation: FrictionEquation, friction: Floats, right_side: Floats, is_contracting: Bools
) -> Floats:
    """Return the friction torques (n, k) after one step of Newton's method.

    The step is computed only in rows that contract (in which the right side of the equation
    changes less than the friction torques do). Other rows get the value `right_side`,
    because their equations may be singular.

    Parameters
    ----------
    equation
        The equation.
    friction
        (n, k) the friction torques before the step.
    right_side
        (n, k) the right side of the equation at these torques.
    is_contracting
        (n,) whether a row contracts.
    """
    identity = np.eye(friction.shape[1])
    matrix = np.where(
        is_contracting[:, None, None],
        identity - equation.right_side_slope(friction),
        identity,
    )
    residual = right_side - friction
    # `solve` needs the right side as a column.
    correction = np.linalg.solve(matrix, residual[..., None])[..., 0]
    return friction + correction
