"""Inverse dynamics: torques of a motion, and torques that hold a mechanism at rest."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from spherekit.argument_validation import checked
from spherekit.arrays import Bools, Floats, Integers, SmallIntegers
from spherekit.dynamics.bearing_friction import solve_bearing_friction
from spherekit.dynamics.configurations_at_inputs import compute_modes_at_inputs
from spherekit.dynamics.coordinates import (
    CoordinateMotion,
    determinacy,
    motion_by_variables,
)
from spherekit.dynamics.generalised_forces import Loads
from spherekit.dynamics.inertia import Inertia, driving_torques, inertia
from spherekit.dynamics.input_motion import InputMotion, only_column
from spherekit.dynamics.simulation_start import variable_of
from spherekit.dynamics.transmitted_forces import DrivenState
from spherekit.errors import ModelError, SolveError
from spherekit.files.mechanism_reader import AnyMechanism, mechanism_of
from spherekit.files.time_law import TimeLaw
from spherekit.geometry.vectors import all_finite
from spherekit.mechanism.mechanism import Mechanism
from spherekit.outputs.rotation_timing import TimeScaling
from spherekit.planning.assembly_plan import driven_at
from spherekit.positions.angle_unwrapping import unwrap_motion
from spherekit.positions.loop_closure import Closure
from spherekit.positions.motion import Motion
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.positions.timing import Timing, evaluate_time_laws
from spherekit.status import Status
from spherekit.tolerances import SINGULAR_INPUT_DETERMINACY
from spherekit.velocities.pole_evaluation import evaluate_unsigned
from spherekit.velocities.pole_request import request
from spherekit.wording import counted, listing

MAX_ZERO_TORQUE = 1e-13
"""Largest torque, relative to the sum of the sizes of its terms, that counts as zero.

Larger: small torques are reported as zero. Smaller: rounding errors are reported.
"""


def total(parts: Floats, status: SmallIntegers) -> Floats:
    """Return the sums (n, ...) of k parts (n, k, ...). They are NaN if a row is not OK."""
    with np.errstate(over="ignore"):
        sums: Floats = np.sum(parts, axis=1)
    sums[status != Status.OK] = np.nan
    return sums


def of_parts(parts: Floats, status: SmallIntegers) -> SmallIntegers:
    """Return the status (n, k) of each of k parts of a sum, such as the torques of loads.

    The status of a finite part is OK. Any other part has the `status` (n,) of its row,
    which says why there is no number.
    """
    return np.where(np.isfinite(parts), np.int8(Status.OK), status[:, None])


def judged(
    status: SmallIntegers,
    masses: Inertia,
    forces: Floats,
    torques: Floats,
    rates: Floats,
    has_unknown_friction: Bools | bool,
) -> SmallIntegers:
    """Set unknown inertia, loads and torques to NaN in place; return the status of torques.

    A row is one sample of a motion. Three rules say what is known in a row:

    - Inertia is known if the rates of the pair variables are known.
    - Loads are known if these rates and the friction in bearings are known.
    - Torques are known if all loads of the row are known.

    A number that overflows is not known either.

    Parameters
    ----------
    status
        (n,) status of the rates of the pair variables. They are known if it is OK.
    masses
        Contributions of links to the inertia matrix M (`M_parts`) and to its derivatives
        (`dM_parts`). Its arrays are changed.
    forces
        (n, m, loads) generalised forces at m inputs. The array is changed.
    torques
        (n, m) driving torques. The array is changed.
    rates
        (n, m) rates of the inputs.
    has_unknown_friction
        (n,) whether the friction of bearings is not determined.

    Returns
    -------
    (n,) the status of the torques: NOT_CONVERGED for unknown friction, and OVERFLOW if a
    torque, a load or the power of a load is not finite.
    """
    has_rates = status == Status.OK
    has_loads = has_rates & np.logical_not(has_unknown_friction)
    is_known_load = has_loads[:, None] & _find_finite_loads(forces, rates)
    has_torques = has_loads & np.all(is_known_load, axis=1) & all_finite(torques, 1)

    _set_unknown_inertia(masses, has_rates)
    forces_by_load = np.moveaxis(forces, 1, 2)  # a view (n, loads, m) of the same numbers
    forces_by_load[~is_known_load] = np.nan
    torques[~has_torques] = np.nan

    torque_status = status.copy()
    torque_status[has_rates & ~has_loads] = Status.NOT_CONVERGED
    torque_status[has_loads & ~has_torques] = Status.OVERFLOW
    return torque_status


def _set_unknown_inertia(masses: Inertia, has_rates: Bools) -> None:
    """Set the inertia in rows without rates (n,), and numbers that overflow, to NaN."""
    for parts in (masses.M_parts, masses.dM_parts):
        parts[~has_rates] = np.nan
        parts[~np.isfinite(parts)] = np.nan


def _find_finite_loads(forces: Floats, rates: Floats) -> Bools:
    """Return a mask (n, loads) of loads with finite generalised forces and power.

    Parameters
    ----------
    forces
        (n, m, loads) generalised forces at m inputs.
    rates
        (n, m) rates of the inputs.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        powers = np.einsum("ni,nil->nl", rates, forces)
    return np.isfinite(powers) & all_finite(forces, 1)


@dataclass(frozen=True)
class InverseSolution(InputMotion):
    """The driving torques of a motion, at n times in one or more assembly modes.

    The rows are the times of the first assembly mode, then those of the next one, and so
    on. An assembly mode is one of the ways to assemble the links at the same inputs. The
    torques of failed rows are NaN. Inertia, `values` and rates are NaN in rows whose
    `rate_status` is not OK.

    Attributes
    ----------
    mechanism
        The mechanism with its inputs.
    sample
        (n,) index of the sample.
    assembly_mode
        (n,) number of the assembly mode.
    t
        (n,) time, s.
    inputs, input_rates, input_accelerations
        (n, inputs) values (rad), rates (rad/s) and accelerations (rad/s2) of the inputs.
    M_parts
        (n, masses, inputs, inputs) contribution of each link to the inertia matrix, kg m2.
    dM_parts
        (n, masses, inputs, inputs, inputs) derivatives of `M_parts` with respect to the
        inputs, which are the last axis, kg m2/rad.
    Q_parts
        (n, inputs, loads) generalised force of each load, N m.
    torques
        (n, inputs) driving torques, N m.
    values
        (n, variables) pair variables (rad).
    motion
        The configurations with their derivatives with respect to the inputs. Failed rows
        are not NaN throughout.
    residual
        (n,) closure residual (rad).
    status
        (n,) status of the torques.
    rate_status
        (n,) status of the rates of the links per unit rate of the inputs. The inertia
        matrix follows from these rates.
    carried
        (n, k) loads that k pairs with friction carry: sums of the bearing forces (N), or
        moments (N m) of the normal forces of contacts. The friction is proportional to
        these loads. 0 in rows without motion. None without such friction.
    rounds
        Number of iterations by which `carried` was computed.
    """

    mechanism: Mechanism
    sample: Integers
    assembly_mode: Integers
    t: Floats
    inputs: Floats
    input_rates: Floats
    input_accelerations: Floats
    M_parts: Floats
    dM_parts: Floats
    Q_parts: Floats
    torques: Floats
    values: Floats
    motion: CoordinateMotion
    residual: Floats
    status: SmallIntegers
    rate_status: SmallIntegers
    carried: Floats | None = None
    rounds: int = 0

    def __repr__(self) -> str:
        return (
            f"<InverseSolution of {self.mechanism.name}: {counted(len(self.t), 'row')} in "
            f"{counted(len(np.unique(self.assembly_mode)), 'assembly mode')}, "
            f"{np.count_nonzero(self.status)} failed>"
        )

    @property
    def M(self) -> Floats:
        """(n, inputs, inputs) inertia matrix, kg m2."""
        return total(self.M_parts, self.rate_status)

    @property
    def dM(self) -> Floats:
        """(n, inputs, inputs, inputs) derivatives of M; the last axis is the input."""
        return total(self.dM_parts, self.rate_status)

    @property
    def Q_all(self) -> Floats:
        """(n, inputs) generalised forces of all loads, N m."""
        return total(np.moveaxis(self.Q_parts, 2, 1), self.status)

    @property
    def sure_torques(self) -> Floats:
        """(n, inputs) driving torques, N m; 0 where they are only rounding errors.

        A torque counts as a rounding error if it is at most `MAX_ZERO_TORQUE` times the sum
        of the sizes of its terms. Its terms are

        - the inertia matrix M times the accelerations of the inputs,
        - torques by the change of M during the motion (Coriolis torques),
        - the generalised forces Q of the loads.

        The sizes of the first two are estimated together, as abs(M) times accelerations.
        """
        # A size that overflows is infinite, and a finite torque then counts as 0.
        with np.errstate(over="ignore"):
            # A Coriolis torque has derivatives of M with respect to the inputs, times
            # products of two input rates. M changes by about its own size when an input
            # moves by 1 rad. So the torque is about M times such a product.
            speeds = np.abs(self.input_rates)
            largest_speed = np.max(speeds, axis=1)[:, None]
            acceleration_sizes = largest_speed * speeds
            acceleration_sizes += np.abs(self.input_accelerations)
            # M is the sum of its parts by links. The letters are: n rows, k links, i and j
            # inputs.
            term_sizes = np.einsum("nkij,nj->ni", np.abs(self.M_parts), acceleration_sizes)
            term_sizes += np.sum(np.abs(self.Q_parts), axis=2)  # over all loads
            is_rounding = np.abs(self.torques) <= MAX_ZERO_TORQUE * term_sizes
            return np.where(is_rounding, 0.0, self.torques)

    @property
    def kinetic(self) -> Floats:
        """(n,) kinetic energy, J."""
        return 0.5 * np.einsum("ni,nij,nj->n", self.input_rates, self.M, self.input_rates)

    @property
    def power(self) -> Floats:
        """(n, loads) power of each load, W."""
        return np.einsum("ni,nil->nl", self.input_rates, self.Q_parts)

    @property
    def tau(self) -> Floats:
        """(n,) driving torque at the only input, N m; `SolveError` with several."""
        return only_column(self.torques)

    @property
    def B_parts(self) -> Floats:
        """(n, masses) parts of the equivalent inertia, kg m2."""
        return only_column(self.M_parts[..., 0])

    @property
    def dB_parts(self) -> Floats:
        """(n, masses) derivatives of `B_parts` with respect to the input."""
        return only_column(self.dM_parts[..., 0, 0])

    @property
    def B(self) -> Floats:
        """(n,) equivalent inertia, kg m2."""
        return only_column(self.M[..., 0])

    @property
    def dB_dq(self) -> Floats:
        """(n,) derivative dB/dq of the equivalent inertia B, q the input, kg m2/rad."""
        return only_column(self.dM[..., 0, 0])

    @property
    def Q(self) -> Floats:
        """(n,) generalised force of all loads, N m."""
        return only_column(self.Q_all)

    @property
    def rates(self) -> Floats:
        """(n, inputs, variables) rates of pair variables per unit rate of each input."""
        return self.motion.rates

    @property
    def pair_rates(self) -> Floats:
        """(n, variables) rates of the pair variables per unit rate of the input."""
        return only_column(np.moveaxis(self.rates, 1, 2))

    @checked(SolveError)
    def torque_at(self, pair: str) -> Floats:
        """Return the torque (n,) in N m that would drive the motion at another R pair.

        The torque replaces the driving torque at the input and has the same effect. The
        torque is not finite at dead centres of the pair, where a torque at the pair cannot
        move the mechanism.
        """
        variable = variable_of(self.mechanism, pair)
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.tau / self.pair_rates[:, variable]


@checked(SolveError)
def inverse_dynamics(
    mechanism: AnyMechanism,
    law: TimeLaw | Mapping[str, TimeLaw] | TimeScaling,
    times: ArrayLike,
    *,
    input_pair: str | None = None,
    assembly_mode: int | None = None,
    search: bool = True,
) -> InverseSolution:
    """Return the torques that move the inputs by time laws, against inertia and loads.

    Parameters
    ----------
    mechanism
        A mechanism with masses, loads or both.
    law
        The time law of the input: its variable, rate and acceleration as functions of time.
        With several inputs, a mapping from their names to laws, or a rotation of an output
        in time (`spherekit.time_optimal`), which has its own assembly mode.
    times
        (k,) one or more increasing times, s.
    input_pair
        Name of the driven pair. This and the following parameters are as in
        `spherekit.trace`. They have no effect if `law` is a rotation of an output, which
        has its own inputs and assembly mode.
    assembly_mode
        Number of the assembly mode, or None for all modes.
    search
        Whether modes other than the mode of the reference pose are searched for.

    Raises
    ------
    ModelError, PlanError, SolveError
        If an argument is wrong, or a reaction that causes friction is not determined.
        Samples that cannot be reached get a status.

    Examples
    --------
    >>> import spherekit as sk
    >>> laws = {"21": sk.ConstantSpeed(0.5, 1.0), "51": sk.ConstantSpeed(-0.2, 1.5)}
    >>> found = sk.inverse_dynamics("five_bar", laws, [0.0, 0.5], assembly_mode=0)
    >>> found.torques.shape
    (2, 2)
    """
    mechanism = mechanism_of(mechanism)
    t = np.atleast_1d(np.asarray(times, dtype=float))
    if t.ndim != 1 or not (len(t) and all_finite(t) and np.all(np.diff(t) > 0.0)):
        raise SolveError(
            f"{mechanism.name}: times: expected a one-dimensional array of finite times "
            "in s, one or more, each later than the one before"
        )
    # Without masses and loads every torque is zero, which is taken for an error.
    need_terms(mechanism)
    if isinstance(law, TimeScaling):
        return needed_torques(_motion_of_rotation(mechanism, law, t))
    # The configurations of all modes at the inputs of these times.
    mechanism, laws = _driven(mechanism, law, input_pair)
    q, timing = evaluate_time_laws(mechanism.input_pairs, laws, t)
    position_analysis, motion = compute_modes_at_inputs(mechanism, q, assembly_mode, search)
    # The rows of the motion are all times of the first mode, then of the next one.
    mode_count = len(position_analysis.assembly_modes)
    motion = replace(motion, timing=timing.repeated(mode_count))
    return needed_torques(unwrap_motion(motion, position_analysis.angle_unwrapping))


def _driven(
    mechanism: Mechanism, law: TimeLaw | Mapping[str, TimeLaw], input_pair: str | None
) -> tuple[Mechanism, Mapping[str, TimeLaw]]:
    """Return a mechanism that is driven at the pairs with a time law, and these laws.

    Laws by name can drive pairs (joints) other than the inputs that the mechanism declares.
    There have to be at least as many laws as declared inputs.

    Parameters
    ----------
    mechanism
        The mechanism.
    law
        Variable, rate and acceleration of the only input as functions of time, or such laws
        by the names of the inputs.
    input_pair
        Name of the only input, by default the one that the mechanism declares.

    Raises
    ------
    SolveError
        If there are fewer laws than inputs, or none for `input_pair`.
    """
    if isinstance(law, Mapping):
        if input_pair is not None and input_pair not in law:
            raise SolveError(
                f'{mechanism.name}: input_pair "{input_pair}" has no law; give one by its '
                "name, or leave input_pair out"
            )
        laws = law
    else:
        mechanism = driven_at(mechanism, input_pair)
        laws = {mechanism.input_pairs[0]: law}
    inputs = mechanism.input_pairs
    if len(laws) < len(inputs):
        missing = next(pair for pair in inputs if pair not in laws)
        raise SolveError(
            f"{mechanism.name}: input {missing} has no law; give one for every input by "
            f"its name ({listing(inputs)})"
        )
    # Columns of results are in the order of the inputs: the declared order if exactly the
    # declared inputs have laws, otherwise the order of the laws.
    drives_declared_inputs = set(inputs) == set(laws)
    driven_pairs = inputs if drives_declared_inputs else laws
    return mechanism.with_inputs(*driven_pairs), laws


def _motion_of_rotation(mechanism: Mechanism, schedule: TimeScaling, t: Floats) -> Motion:
    """Return the motion of a mechanism that rotates an output link about a fixed axis.

    Parameters
    ----------
    mechanism
        The mechanism with the output.
    schedule
        The rotation, with its angle as a function of time, and with the inputs and the
        configurations that belong to each angle.
    t
        (n,) times, s.
    """
    # At these times: names, values, rates and accelerations of the inputs, and the angle
    # theta (rad) of the rotation.
    samples = schedule.at(t)
    # The rotation already has the pair variables (joint angles) at each angle. The position
    # analysis only computes the other quantities of the motion (follow=False).
    configurations = schedule.rotation.at(samples.theta).values
    position_analysis = PositionAnalysis(
        mechanism.with_inputs(*samples.names), follow=False
    )
    motion = position_analysis.given(configurations)
    motion = replace(
        motion,
        inputs=samples.inputs,
        status=samples.status,
        timing=Timing(t, samples.rates, samples.accelerations),
    )
    # Angles are continued over full turns, because loads such as springs depend on them.
    return unwrap_motion(motion, position_analysis.angle_unwrapping)


def needed_torques(motion: Motion) -> InverseSolution:
    """Return the torques at the inputs that a motion in time needs.

    The torques balance the inertia forces and the loads. The result also has the parts from
    which the torques were computed.

    Parameters
    ----------
    motion
        A motion of all inputs with its timing (times, rates and accelerations of the
        inputs). Its angles have no jumps of whole revolutions, because loads may depend on
        the number of revolutions.
    """
    assert motion.timing is not None
    mechanism = motion.mechanism
    timing = motion.timing
    input_variables = [mechanism.variables_of(pair)[0] for pair in motion.assembly.inputs]
    closure = Closure.of_mechanism(mechanism, motion.joints)
    coordinates = motion_by_variables(closure, motion.values, input_variables)
    status = motion.status.copy()
    is_singular = _find_singular_rows(motion, coordinates)
    status[(status == Status.OK) & is_singular] = Status.AT_SINGULARITY

    # First the torques without friction of bearings. `balancing` computes them from inertia
    # and loads, and copies `rows` to the solution, where they say to what each row belongs.
    rows = motion.sample, motion.assembly_mode, motion.inputs, motion.residual
    solution = balancing(mechanism, rows, timing, coordinates, status)
    loads = Loads(mechanism)
    if loads.friction_components:
        # Friction of bearings depends on the forces that they carry, which depend on the
        # torques. An iteration solves for these forces (`friction.carried`). Then the
        # torques are computed again. Where the forces are not determined, for example
        # because bearings may lock (`friction.is_unknown`), the torques become NaN.
        has_torques = all_finite(solution.torques, 1)
        driven = DrivenState(mechanism, coordinates, timing, solution.torques)
        with np.errstate(over="ignore", invalid="ignore"):
            friction = solve_bearing_friction(driven, loads, has_torques)
        friction.carried[~has_torques] = 0.0
        solution = balancing(
            mechanism,
            rows,
            timing,
            coordinates,
            status,
            locked=friction.is_unknown,
            carried=friction.carried,
        )
        solution = replace(solution, rounds=friction.iterations)
    # Rows that failed or are at a singularity get NaN for values, rates and frames.
    for array in (solution.values, coordinates.rates, coordinates.frames):
        array[status != Status.OK] = np.nan
    return solution


def _find_singular_rows(motion: Motion, coordinates: CoordinateMotion) -> Bools:
    """Return at which rows (n,) the rates of the inputs do not determine all other rates.

    A row is one sample in one assembly mode (way to assemble the mechanism). The caller
    marks these rows as singular, and returns no torques there.

    Parameters
    ----------
    motion
        The motion.
    coordinates
        The same motion. Its coordinates are the inputs: `rates` has the rates of all
        variables per unit rate of each input.
    """
    mechanism = motion.mechanism
    # A row with NaN in its rates is singular, too.
    is_singular = ~(determinacy(coordinates.rates) >= SINGULAR_INPUT_DETERMINACY)
    has_configuration = ~motion.failed
    # If assembly modes nearly meet at a row, the derivatives depend on rounding errors of
    # the configuration. The evaluation of poles (axes of relative rotation) recognises such
    # rows. Only this finding is needed, so the list of requested poles is empty. Each input
    # in turn is the only one that moves.
    for name in mechanism.names_of(motion.assembly.inputs):
        # With `by_rank`, the degrees of freedom follow from the rank of the velocity
        # equations. Counting links and pairs can give too few of them.
        pole_request = request(mechanism, name, (), by_rank=True)
        field = evaluate_unsigned(motion.rows(has_configuration), pole_request)
        # `is_decimal` marks rows so near a singularity that float64 numbers do not
        # determine the rates. Inertia is computed in float64, so such rows are singular.
        is_singular[has_configuration] |= (field.status != Status.OK) | field.is_decimal
    return is_singular


def balancing(
    mechanism: Mechanism,
    rows: tuple[Integers, Integers, Floats, Floats],
    timing: Timing,
    coordinates: CoordinateMotion,
    rate_status: SmallIntegers,
    locked: Bools | bool = False,
    carried: Floats | None = None,
) -> InverseSolution:
    """Return the torques at the inputs that balance inertia forces and loads.

    Parameters
    ----------
    mechanism
        The mechanism with its inputs.
    rows
        Four arrays that are copied to the result: (n,) numbers of the samples, (n,) numbers
        of the assembly modes, (n, inputs) values of the inputs (rad), and (n,) closure
        residuals (rad).
    timing
        Times, rates and accelerations of the inputs.
    coordinates
        The configurations at n rows, and their derivatives with respect to the inputs.
    rate_status
        (n,) status of the rates.
    locked
        (n,) whether the friction of bearings is not determined, for example because the
        bearings may lock. The torques of these rows are NaN.
    carried
        (n, k) loads of bearings and contacts, to which friction is proportional; see
        `InverseSolution`. None leaves this friction out.
    """
    sample, assembly_mode, inputs, residual = rows
    with np.errstate(over="ignore", invalid="ignore"):
        masses = inertia(mechanism, coordinates)
        forces = Loads(mechanism).evaluate_forces(coordinates, timing.dq, timing.t, carried)
        total_forces = np.sum(forces, axis=2)
        torques = driving_torques(masses.M, masses.dM, total_forces, timing.dq, timing.ddq)
    # `judged` replaces unknown entries of the arrays by NaN.
    status = judged(
        rate_status,
        masses=masses,
        forces=forces,
        torques=torques,
        rates=timing.dq,
        has_unknown_friction=locked,
    )
    return InverseSolution(
        mechanism=mechanism,
        sample=sample,
        assembly_mode=assembly_mode,
        t=timing.t,
        inputs=inputs,
        input_rates=timing.dq,
        input_accelerations=timing.ddq,
        M_parts=masses.M_parts,
        dM_parts=masses.dM_parts,
        Q_parts=forces,
        torques=torques,
        values=coordinates.values.copy(),
        motion=coordinates,
        residual=residual,
        status=status,
        rate_status=rate_status,
        carried=carried,
    )


def need_terms(mechanism: Mechanism) -> None:
    """Raise `ModelError` if a mechanism has neither masses nor loads."""
    if not mechanism.masses and not mechanism.loads:
        raise ModelError(
            f"{mechanism.name}: has neither masses nor loads, so it needs no torque; give "
            "at least one [mass.LINK] or [loads.NAME]"
        )


def holding_torques(motion: Motion, t: float = 0.0) -> InverseSolution:
    """Return the torques at the inputs that hold a mechanism at rest against its loads.

    Parameters
    ----------
    motion
        Configurations in rows. Their timing has no effect.
    t
        The time (s), for loads that depend on time.
    """
    no_motion = np.zeros_like(motion.inputs)
    timing = Timing(np.full(len(motion), t), no_motion, no_motion)
    return needed_torques(replace(motion, timing=timing))
