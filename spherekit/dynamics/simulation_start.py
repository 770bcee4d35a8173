"""Checks the arguments of a simulation and closes its configuration at the start."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from numbers import Real

import numpy as np

from spherekit.argument_validation import checked_class
from spherekit.arrays import Floats
from spherekit.conventions import TURN
from spherekit.dynamics.configurations_at_inputs import (
    compute_modes_at_inputs,
    count_whole_turns,
    wrap_to_pi,
)
from spherekit.dynamics.equation_of_motion import EquationOfMotion
from spherekit.dynamics.inertia import need_inertia, need_moving_inertia
from spherekit.errors import ModelError, SolveError
from spherekit.files.study import Start
from spherekit.geometry.vectors import all_finite, max_abs
from spherekit.mechanism.cache import MechanismCache
from spherekit.mechanism.joint_construction import make_joints
from spherekit.mechanism.load import TorqueFunction, TorqueTable
from spherekit.mechanism.load_kinds import (
    DRIVE_LOAD_NAME,
    PairTorque,
    joint_limit_roundings,
)
from spherekit.mechanism.mechanism import Mechanism
from spherekit.number_text import degree_range_text, degrees_text
from spherekit.planning.assembly_plan import driven_at
from spherekit.positions.loop_closure import Closure
from spherekit.positions.loop_tree import rank_mobility
from spherekit.positions.motion import Motion
from spherekit.positions.motion_cache import kinematics_only, position_analysis_of
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.status import STATUS_MEANING, Status
from spherekit.wording import choices, counted, listing

MAX_START_DISTANCE_RAD = 0.1
"""Largest change of a variable by which the loops of a given configuration are closed.

Larger: the closed configuration can be one that was not meant. Smaller: configurations
must be given with more digits.
"""

START_CLOSURE_TOLERANCE_RAD = 1e-12
"""Largest closure residual of a configuration at the start.

Larger: the motion starts off its curve. Smaller: rounding makes good starts fail.
"""

MAX_START_ANGLE_RAD = 1e9
"""Largest angle at the start; a float64 stores it to 1e-7 rad only.

Larger: the start is less accurate. Smaller: fewer whole turns are allowed.
"""

MIN_START_RATE = 1e-9
"""Smallest rate of a pair variable along the possible velocities if its rate is given.

Larger: starts near dead centres are refused. Smaller: the speed of the mechanism is
computed from rounding errors.
"""

MAX_KEPT_STARTS = 8
"""Configurations at starts that are kept for later simulations.

Larger: more memory. Smaller: a simulation from one of the same few starts searches the
assembly modes again.
"""

_START_CONFIGURATIONS = MechanismCache(max_results=MAX_KEPT_STARTS)

Torque = float | str | TorqueFunction
"""A driving torque (N m): a number, an expression, or a function f(t, q, dq)."""

Torques = Torque | Mapping[str, Torque]
"""A driving torque of the only input, or a mapping from names of inputs to torques."""


@checked_class(SolveError)
@dataclass(frozen=True)
class PoseStart:
    """The start of a simulation from a whole configuration, with rates of chosen pairs.

    The configuration can be a dead centre of the input. The input cannot move there, so its
    rate would not determine the speed of the mechanism. The rate of another pair (joint)
    determines it.

    Attributes
    ----------
    values
        (variables,) pair variables (joint angles, rad) in the order of the mechanism's
        `variable_names`. Angles may contain any number of whole turns. The values are
        changed by at most `MAX_START_DISTANCE_RAD` so that the loops close.
    pair
        The R pair (revolute joint) that has the rate `rate`. With several degrees of
        freedom, a sequence of as many pairs.
    rate
        The rate of this pair, or of each of these pairs, rad/s.
    """

    values: Sequence[float]
    pair: str | Sequence[str]
    rate: float | Sequence[float]


@dataclass(frozen=True)
class Problem:
    """A simulation problem that has passed all checks.

    The start is given by the pair variables v and the rates u of m coordinates, where m is
    the number of degrees of freedom. With a matrix W of orthonormal rows, the time
    derivatives of the pair variables are v' = W^T u. Conversely u = W v'.

    Attributes
    ----------
    equation
        The equation of motion, with m degrees of freedom.
    driven
        Indices of the inputs among the pair variables.
    values
        (variables,) pair variables (rad) of a closed configuration at the start. Angles are
        reduced by whole turns, because a float64 stores large angles with larger errors.
    turns
        (variables,) how many whole turns were subtracted from each variable.
    rate_weights
        (m, variables) the matrix W. Row i has the weights of the rates of the pair
        variables in the rate of coordinate i.
    speed
        (m,) rates u of the coordinates at the start.
    until
        Time at which to end, s.
    switches
        Times (s) within the simulation at which a load may jump or have a kink, such as the
        corners of a torque table. A step ends at each of them, because the series of a step
        cannot represent a kink.
    passes_crossings
        Whether the motion continues straight on at a crossing: a configuration in which
        curves (or surfaces) of configurations cross, such as the flat state of a four-bar.
        By default the simulation ends there.
    on_progress
        A function that is called with the simulation so far while it is computed.
    compact
        Whether the compiled engine uses heyoka's compact mode, which compiles faster and
        runs slower.
    """

    equation: EquationOfMotion
    driven: tuple[int, ...]
    values: Floats
    turns: Floats
    rate_weights: Floats
    speed: Floats
    until: float
    switches: tuple[float, ...]
    passes_crossings: bool = False
    on_progress: Callable[..., None] | None = None
    compact: bool = True

    @property
    def turn_angles(self) -> Floats:
        """The angles (variables,) of `turns`, rad."""
        return TURN * self.turns

    @property
    def targets(self) -> tuple[float, ...]:
        """Times (s) at which integration steps must end: the switches, then the end."""
        return (*self.switches, self.until)


def prepare(
    mechanism: Mechanism,
    start: Start | PoseStart,
    until: float,
    torque: Torques | None = None,
    input_pair: str | Sequence[str] | None = None,
    assembly_mode: int = 0,
    switches: Iterable[float] = (),
    passes: bool = False,
) -> Problem:
    """Return the problem that the arguments of `simulate` describe.

    The parameters are those of `spherekit.dynamics.forward_dynamics.simulate`. `passes`
    says whether the motion continues straight on at a crossing of curves of configurations.

    Raises
    ------
    ModelError, SolveError
        If something is missing or impossible.
    """
    name = mechanism.name
    if not (np.isfinite(until) and until > 0.0):
        raise SolveError(
            f"{name}: a simulation starts at t = 0 and cannot end at {until:g} s; give a "
            "finite time greater than 0"
        )
    # The inputs, the pairs whose rates are given, and the loads.
    need_inertia(mechanism)
    mechanism = driven_at(mechanism, input_pair)
    inputs = mechanism.input_pairs
    moved_pairs, rates = _read_rates(name, start, inputs)
    driven = tuple(variable_of(mechanism, pair) for pair in inputs)
    moved_variables = [variable_of(mechanism, pair) for pair in moved_pairs]
    mechanism = mechanism.with_loads(*make_input_torques(mechanism, torque))
    times = sorted({*map(float, switches), *_list_table_knots(mechanism, until)})
    if not all(np.isfinite(times)):
        raise SolveError(
            f"{name}: switches: found a time that is not finite; give finite times in s"
        )

    # The configuration at the start: variables less whole turns, and these turns.
    closure = Closure.of_mechanism(mechanism, make_joints(mechanism))
    equation = EquationOfMotion(mechanism, closure, freedoms=len(inputs))
    if isinstance(start, PoseStart):
        values, turns = _close_start(closure, mechanism, start.values)
    else:
        q, _ = start.each(inputs)
        values, turns = _find_configuration(mechanism, q, assembly_mode)

    # The velocities that the mechanism can have in this configuration.
    linearisation = closure.linearise(values[None])
    freedoms = int(rank_mobility(closure.tree, linearisation.vectors)[0])
    if freedoms != len(inputs):
        raise SolveError(
            f"{name}: the number of independent velocities at the start is {freedoms}, "
            f"but that of inputs is {len(inputs)}, so the loads do not determine the "
            "motion; start from a configuration near this one"
        )
    # The last right singular vectors of the closure equations are possible velocities.
    velocity_basis = np.linalg.svd(linearisation.jacobian[0])[2][-freedoms:]
    # With one degree of freedom, the pair whose rate is given turns in its positive sense.
    if freedoms == 1 and velocity_basis[0, moved_variables[0]] < 0.0:
        velocity_basis = -velocity_basis
    need_moving_inertia(mechanism, equation.compute_motion(values[None], velocity_basis))
    _check_joint_limits(mechanism, values + TURN * turns)
    return Problem(
        equation=equation,
        driven=driven,
        values=values,
        turns=turns,
        rate_weights=velocity_basis,
        speed=_solve_start_speed(mechanism, velocity_basis, moved_variables, rates),
        until=until,
        switches=tuple(t for t in times if 0.0 < t < until),
        passes_crossings=passes,
    )


def _read_rates(
    name: str, start: Start | PoseStart, inputs: Sequence[str]
) -> tuple[list[str], Floats]:
    """Return the pairs (joints) with known rates at the start, and these rates (m,), rad/s.

    Parameters
    ----------
    name
        Name of the mechanism, for messages.
    start
        The start: inputs and their rates, or a configuration with rates of some pairs.
    inputs
        Names of the m inputs.
    """
    if isinstance(start, PoseStart):
        pairs = [start.pair] if isinstance(start.pair, str) else list(start.pair)
        rates = np.atleast_1d(np.asarray(start.rate, dtype=float))
    else:
        pairs = list(inputs)
        _, rates = start.each(inputs)
    if not all_finite(rates):
        raise SolveError(f"{name}: the rate at the start is {rates}; give finite numbers")
    if not len(pairs) == len(rates) == len(inputs):
        raise SolveError(
            f"{name}: the start has {counted(len(pairs), 'pair')} with "
            f"{counted(len(rates), 'rate')}, expected one for each of "
            f"{counted(len(inputs), 'input')} ({listing(inputs)})"
        )
    if len(set(pairs)) < len(pairs):
        raise SolveError(
            f"{name}: the start has several rates of the same pair: {listing(pairs)}; name "
            "each pair once"
        )
    return pairs, rates


def _solve_start_speed(
    mechanism: Mechanism, velocity_basis: Floats, moved: Sequence[int], rates: Floats
) -> Floats:
    """Return the velocity at the start, at which some pair variables have known rates.

    Pair variables are joint angles. Each possible velocity is a sum of m basis velocities
    (the rows of `velocity_basis`) times coefficients. The coefficients are the result.
    These follow from m linear equations, one for each variable with a known rate.

    Parameters
    ----------
    mechanism
        The mechanism, for messages.
    velocity_basis
        (m, variables) basis of the possible velocities: in each row the rates of all
        variables. The rows are orthonormal.
    moved
        Indices of the m variables with known rates.
    rates
        (m,) rates of these variables, rad/s.

    Returns
    -------
    (m,) coefficients of the rows of `velocity_basis`.

    Raises
    ------
    SolveError
        If these rates do not determine the velocity.
    """
    if not np.any(rates):
        return np.zeros(len(rates))
    # (m, m): in column k the rates of the moved variables in basis velocity k. If this
    # matrix is singular, arbitrary rates of these variables are impossible.
    moved_rates = velocity_basis[:, list(moved)].T
    least_singular_value = np.linalg.svd(moved_rates, compute_uv=False)[-1]
    if least_singular_value < MIN_START_RATE:
        names = mechanism.names_of(mechanism.variable_owners[v] for v in moved)
        what = "dead centre" if len(moved) == 1 else "singularity of type II"
        raise SolveError(
            f"{mechanism.name}: the start is at a {what}, where the rate of "
            f"{listing(names)} cannot be {listing(f'{rate:g}' for rate in rates)} "
            "rad/s; start elsewhere, "
            "or give PoseStart with rates of other pairs"
        )
    return np.asarray(np.linalg.solve(moved_rates, rates))


def make_input_torques(mechanism: Mechanism, torque: Torques | None) -> list[PairTorque]:
    """Return the driving torques at the inputs as loads of the mechanism.

    Parameters
    ----------
    mechanism
        The mechanism with its inputs.
    torque
        A torque of the only input, or torques by the names of the inputs. Each is a number
        (N m), an expression or a function. None without driving torques.

    Raises
    ------
    SolveError
        If it is not clear at which input a torque acts, or if there is no such input.
    ModelError
        If a load of the mechanism has the name of the driving torque.
    """
    if torque is None:
        return []
    inputs = mechanism.input_pairs
    if not isinstance(torque, Mapping):
        if len(inputs) > 1:
            raise SolveError(
                f"{mechanism.name}: the torque does not state at which input it acts; give "
                f'a mapping from names of inputs to torques, such as {{"{inputs[0]}": '
                f"1.0}}; inputs without one turn freely. Inputs: {listing(inputs)}"
            )
        torque = {inputs[0]: torque}
    loads = []
    for pair, law in torque.items():
        if pair not in inputs:
            raise SolveError(
                f'{mechanism.name}: a torque is given at "{pair}", which is not an input'
                f"{choices(pair, inputs, 'Inputs')}"
            )
        name = DRIVE_LOAD_NAME if len(inputs) == 1 else f"{DRIVE_LOAD_NAME}_{pair}"
        if any(load.name == name for load in mechanism.loads):
            raise ModelError(
                f'{mechanism.name}: a load has the name "{name}", which the driving torque '
                "uses; give the load another name"
            )
        # A number becomes an expression. Functions and expressions remain as they are.
        if isinstance(law, int | float | Real):
            if not np.isfinite(law):
                raise SolveError(
                    f"{mechanism.name}: the torque at {pair} is {law} N m; give a finite "
                    "number"
                )
            law = repr(float(law))
        loads.append(PairTorque(name, pair, law))
    return loads


def variable_of(mechanism: Mechanism, pair: str) -> int:
    """Return the index of the angle of an R pair among the pair variables.

    `SpherekitError` is raised if the name `pair` is not that of an R pair.
    """
    if not mechanism.pair(pair).kind.has_axis:
        raise SolveError(
            f'{mechanism.name}: pair "{pair}" is a contact pair; name an R pair'
        )
    return mechanism.angles[pair]


def _close_start(
    closure: Closure, mechanism: Mechanism, values: Sequence[float]
) -> tuple[Floats, Floats]:
    """Return the configuration at a start with closed loops, and its whole revolutions.

    Whole revolutions of the angles are subtracted first. Newton's method then closes the
    loops, beginning with the start values.

    Parameters
    ----------
    closure, mechanism
        The loop-closure equations of the mechanism, and the mechanism.
    values
        (variables,) pair variables (rad) in which the loops nearly close: angles of R
        pairs (revolute joints) and arc lengths at contacts. Angles may contain any number
        of whole revolutions.

    Returns
    -------
    (variables,) the configuration (rad) reduced by whole revolutions, and (variables,) the
    numbers of these revolutions.
    """
    name = mechanism.name
    start_values = np.array(values, dtype=float)
    count = len(closure.tree.pair_of_variable)
    if start_values.shape != (count,) or not all_finite(start_values):
        raise SolveError(
            f"{name}: values at the start must be {count} finite numbers, one for each "
            "variable"
        )
    _check_angle_sizes(name, start_values)
    # Indices of the pair variables that are angles. Arc lengths have no revolutions.
    angle_variables = [*mechanism.angles.values()]
    turns = np.zeros(count)
    turns[angle_variables] = count_whole_turns(start_values[angle_variables])
    start_values[angle_variables] = wrap_to_pi(start_values[angle_variables])
    solution = closure.solve(start_values[None])
    distance = float(max_abs(solution.values[0] - start_values))
    is_closed = solution.closure_residual[0] < START_CLOSURE_TOLERANCE_RAD
    if not (is_closed and distance < MAX_START_DISTANCE_RAD):
        raise SolveError(
            f"{name}: the values at the start do not close the loops: the nearest closed "
            f"configuration found is {distance:.2g} rad away (residual "
            f"{solution.closure_residual[0]:.2g} rad), but at most "
            f"{MAX_START_DISTANCE_RAD} rad is allowed"
        )
    return np.asarray(solution.values[0]), turns


def _check_angle_sizes(name: str, values: Floats) -> None:
    """Raise `SolveError` if an angle (rad) is too large to be accurate.

    The rounding error of a float64 grows with its size. Beyond `MAX_START_ANGLE_RAD` this
    error is too large for a configuration.
    """
    largest = float(max_abs(values))
    if largest > MAX_START_ANGLE_RAD:
        raise SolveError(
            f"{name}: an angle at the start is {largest:.6g} rad, which float64 resolves "
            f"to {np.spacing(largest):.2g} rad only; the largest angle allowed is "
            f"{MAX_START_ANGLE_RAD:g} rad. Leave out whole turns"
        )


def _find_configuration(
    mechanism: Mechanism, q: Floats, assembly_mode: int
) -> tuple[Floats, Floats]:
    """Return the configuration of an assembly mode at the inputs q, and its whole turns.

    An assembly mode is one of the ways to assemble the links at the same inputs. Results
    are stored, because simulations often start from the same configuration.

    Parameters
    ----------
    mechanism
        The mechanism with its inputs.
    q
        (m,) values of the inputs, rad.
    assembly_mode
        Number of the assembly mode.

    Returns
    -------
    (variables,) the pair variables (joint angles, rad) reduced by whole turns, and
    (variables,) how many turns were subtracted from each.
    """
    name = mechanism.name
    if not all_finite(q):
        raise SolveError(f"{name}: the input at the start is {q}; give finite numbers")
    _check_angle_sizes(name, q)
    # The cache computes the configuration only the first time. Masses and loads do not
    # matter for the configuration.
    geometry = kinematics_only(mechanism)
    values, turns = _START_CONFIGURATIONS.get(
        geometry,
        f"assembly mode {assembly_mode} at {q.tolist()}",
        lambda: _compute_configuration(geometry, q, assembly_mode),
    )
    return values.copy(), turns.copy()


def _compute_configuration(
    mechanism: Mechanism, q: Floats, assembly_mode: int
) -> tuple[Floats, Floats]:
    """Compute the configuration of an assembly mode at the inputs q, and its whole turns.

    An assembly mode is one of the ways to assemble the links at the same inputs.

    Parameters
    ----------
    mechanism
        The mechanism with its inputs.
    q
        (m,) values of the inputs (rad) with any number of whole turns.
    assembly_mode
        Number of the assembly mode.

    Returns
    -------
    (variables,) the pair variables (joint angles, rad) reduced by whole turns, and
    (variables,) how many turns were subtracted from each.
    """
    position_analysis, motion = _compute_modes(mechanism, q)
    # The motion has one row for each mode, because there is only one sample.
    row = position_analysis.find_mode_index(assembly_mode)
    _check_mode_exists(mechanism, Status(int(motion.status[row])), q, assembly_mode)
    values = motion.values[row].copy()
    mode = motion.assembly_modes[row]
    turns = _count_turns(position_analysis, mode.number, values, q)
    # The computed inputs can differ from q by whole turns. `turns` has the whole turns of
    # q, so the inputs become q without its whole turns.
    input_variables = list(position_analysis.solver.driven)
    values[input_variables] = wrap_to_pi(q)
    return values, turns


def _compute_modes(mechanism: Mechanism, q: Floats) -> tuple[PositionAnalysis, Motion]:
    """Return the configurations of all assembly modes at the inputs q (m,), rad.

    An assembly mode is one of the ways to assemble the links at the same inputs.

    Returns
    -------
    The position analysis, and a motion with one row for each mode.
    """
    if len(q) == 1:
        # With one input, the modes and their numbers come from a position analysis over the
        # whole range of the input.
        return compute_modes_at_inputs(position_analysis_of(mechanism), q[None])
    # With several inputs, modes are computed at these inputs alone. Whole turns of an input
    # change the configuration only if there are contacts, such as of rolling wheels.
    inputs = q if mechanism.has_contacts else wrap_to_pi(q)
    return compute_modes_at_inputs(mechanism, inputs[None])


def _check_mode_exists(
    mechanism: Mechanism, status: Status, q: Floats, assembly_mode: int
) -> None:
    """Raise `SolveError` unless an assembly mode has a configuration at the inputs q.

    An assembly mode is one of the ways to assemble the links at the same inputs.

    Parameters
    ----------
    mechanism
        The mechanism, for messages.
    status
        Status of the configuration that was computed.
    q
        (m,) the inputs, rad.
    assembly_mode
        Number of the assembly mode.
    """
    # The loops also close at a singularity.
    if status in (Status.OK, Status.AT_SINGULARITY):
        return
    inputs_text = listing(f"{x:.6g}" for x in q)
    raise SolveError(
        f"{mechanism.name}: assembly mode {assembly_mode} has no configuration at q = "
        f"{inputs_text} rad ({status.name}): {STATUS_MEANING[status]}"
    )


def _count_turns(
    position_analysis: PositionAnalysis, mode_number: int, values: Floats, q: Floats
) -> Floats:
    """Return how many whole turns (variables,) the angles of a configuration contain.

    Loads such as springs depend on whole turns. The turns of an input are known from its
    full value. The turns of other angles are counted along a path of configurations that
    ends at the given configuration. The path starts at a configuration whose angles count
    as having no whole turns, such as the reference pose.

    Parameters
    ----------
    position_analysis
        The position analysis that computed the configuration.
    mode_number
        Number of its assembly mode (way to assemble the links).
    values
        (variables,) the pair variables (joint angles) of the configuration, rad.
    q
        (m,) the inputs with all whole turns, rad.
    """
    solver = position_analysis.solver
    angle_numbers = solver.angles  # which of the pair variables are angles
    # `count` has a row for each configuration; here there is one.
    (turns,) = position_analysis.angle_unwrapping.count(
        mode_number, values[None], q[None], requested=angle_numbers
    )
    turns[list(solver.driven)] = count_whole_turns(q)
    return turns


def _check_joint_limits(mechanism: Mechanism, values: Floats) -> None:
    """Raise `SolveError` if variables (variables,), in rad, exceed joint limits.

    Rounding errors are tolerated.
    """
    for limit in mechanism.joint_limits:
        value = values[variable_of(mechanism, limit.pair)]
        low_rounding, high_rounding = joint_limit_roundings(limit)
        if not limit.low - low_rounding <= value <= limit.high + high_rounding:
            raise SolveError(
                f"{mechanism.name}: pair {limit.pair} starts at {degrees_text(value)} deg "
                f"({value:.6g} rad), outside its joint limits "
                f"{degree_range_text(limit.low, limit.high)} deg "
                f"({limit.low:.6g} to {limit.high:.6g} rad)"
            )


def _list_table_knots(mechanism: Mechanism, until: float) -> Iterable[float]:
    """Yield the times (s) at which torques given by tables have kinks.

    A table is linear between its knots, and a step of the integration must end at each
    knot.
    """
    for load in mechanism.loads:
        if isinstance(load, TorqueTable):
            # `at` raises an error if the table does not cover the simulated time.
            load.at(np.array([0.0, until]))
            yield from load.knots(0.0, until)
