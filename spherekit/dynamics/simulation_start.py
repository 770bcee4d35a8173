"""Where a simulation starts: the problem checked, the configuration closed."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from spherekit.argument_validation import checked_class
from spherekit.arrays import Floats
from spherekit.conventions import TURN
from spherekit.dynamics.coordinates import need_inertia, need_moving_inertia
from spherekit.dynamics.equation_of_motion import EquationOfMotion
from spherekit.errors import ModelError, SolveError
from spherekit.files.study import Start
from spherekit.geometry.rotation import all_finite, max_abs
from spherekit.mechanism.joint_construction import make_joints
from spherekit.mechanism.load import TorqueFunction, TorqueTable
from spherekit.mechanism.load_kinds import DRIVE, PairTorque
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import driven_at
from spherekit.positions.input_revolutions import into_range as turned_into
from spherekit.positions.linearisation import rank_mobility
from spherekit.positions.loop_closure import Closure
from spherekit.positions.motion import Motion, PositionAnalysis
from spherekit.positions.motion_cache import bare, traced
from spherekit.status import STATUS_MEANING, Status
from spherekit.wording import choices, counted, listing

NEAR = 0.1
"""A given configuration may be this far (rad) from one that closes."""

FARTHEST = 1e9
"""Angles (rad) beyond it are held by a float64 to no better than 1e-7 rad."""

STANDSTILL = 1e-9
"""A pair variable whose rate along the curve is smaller cannot be given a rate."""

Torque = float | str | TorqueFunction
"""A driving torque (N m): a number, an expression, or a function f(t, q, dq)."""

Torques = Torque | Mapping[str, Torque]
"""A driving torque of the only input, or those of inputs by their names."""


@checked_class(SolveError)
@dataclass(frozen=True)
class PoseStart:
    """A start from a whole configuration, which may be a dead centre of the input.

    `values` (variables,) in the order of the mechanism's `variable_names`, closed to
    `NEAR`, angles with any number of whole turns; `rate` (rad/s) is that of the R pair
    `pair`, of several freedoms one for each of as many pairs.
    """

    values: Sequence[float]
    pair: str | Sequence[str]
    rate: float | Sequence[float]


@dataclass(frozen=True)
class Problem:
    """A direct problem of m freedoms that has passed all checks.

    `driven` are the numbers of the inputs' variables; `values` (variables,) closed at the
    start, less `turns` (variables,) whole turns, so that they keep their digits; `speed`
    (m,) the rates along the orthonormal vectors of `frame` (m, variables); `switches` times
    within the run at which steps begin anew; `passes` whether it goes straight on where
    sets of configurations cross; `seen` is given the simulation so far while it is solved;
    `compact` is how it is compiled, see
    `spherekit.dynamics.compiled_equation.compile_equation`.
    """

    equation: EquationOfMotion
    driven: tuple[int, ...]
    values: Floats
    turns: Floats
    frame: Floats
    speed: Floats
    until: float
    switches: tuple[float, ...]
    passes: bool = False
    seen: Callable[..., None] | None = None
    compact: bool = True

    @property
    def whole(self) -> Floats:
        """The angles (variables,) of `turns`, rad."""
        return TURN * self.turns

    @property
    def targets(self) -> tuple[float, ...]:
        """Times (s) between which no load has a knot, the end last."""
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
    """Return the problem behind the arguments of `simulate`, or raise what is wrong."""
    name = mechanism.name
    if not (np.isfinite(until) and until > 0.0):
        raise SolveError(
            f"{name}: a simulation starts at t = 0 and cannot end at {until:g} s; give a "
            "finite time greater than 0"
        )
    need_inertia(mechanism)
    mechanism = driven_at(mechanism, input_pair)
    inputs = mechanism.input_pairs
    pairs, rates = _moved(name, start, inputs)
    driven = tuple(variable_of(mechanism, pair) for pair in inputs)
    moved = [variable_of(mechanism, pair) for pair in pairs]
    mechanism = mechanism.with_loads(*drives(mechanism, torque))
    times = sorted({*map(float, switches), *_knots(mechanism, until)})
    if not all(np.isfinite(times)):
        raise SolveError(f"{name}: switches has a time that is not finite")
    closure = Closure.of(mechanism, make_joints(mechanism))
    equation = EquationOfMotion(mechanism, closure, len(inputs))
    if isinstance(start, PoseStart):
        values, turns = _closed(closure, mechanism, start.values)
    else:
        values, turns = _configuration(mechanism, start.each(inputs)[0], assembly_mode)
    at = closure.at(values[None])
    freedoms = int(rank_mobility(closure.tree, at.vectors)[0])
    if freedoms != len(inputs):
        raise SolveError(
            f"{name}: the start has {counted(freedoms, 'freedom')} of velocity for "
            f"{counted(len(inputs), 'input')}, so the loads do not say where it goes; "
            "start beside it"
        )
    frame = np.linalg.svd(at.jacobian[0])[2][-freedoms:]
    if freedoms == 1 and frame[0, moved[0]] < 0.0:
        frame = -frame
    need_moving_inertia(mechanism, equation.compute_motion(values[None], frame))
    _check_stops(mechanism, values + TURN * turns)
    inside = tuple(t for t in times if 0.0 < t < until)
    speed = _speed(mechanism, frame, moved, rates)
    return Problem(equation, driven, values, turns, frame, speed, until, inside, passes)


def _moved(
    name: str, start: Start | PoseStart, inputs: Sequence[str]
) -> tuple[list[str], Floats]:
    """Return the pairs whose rates (m,) are given at the start, and these."""
    if isinstance(start, PoseStart):
        pairs = [start.pair] if isinstance(start.pair, str) else list(start.pair)
        rates = np.atleast_1d(np.asarray(start.rate, dtype=float))
    else:
        pairs, (_, rates) = list(inputs), start.each(inputs)
    if not all_finite(rates):
        raise SolveError(f"{name}: the rate at the start is {rates}, give finite numbers")
    if not len(pairs) == len(rates) == len(inputs):
        raise SolveError(
            f"{name}: the start has {counted(len(pairs), 'pair')} with "
            f"{counted(len(rates), 'rate')}, needs one for each of "
            f"{counted(len(inputs), 'input')} ({listing(inputs)})"
        )
    return pairs, rates


def _speed(
    mechanism: Mechanism, frame: Floats, moved: Sequence[int], rates: Floats
) -> Floats:
    """Return the rates (m,) along a frame at which pair variables have given ones (m,)."""
    if not np.any(rates):
        return np.zeros(len(rates))
    share = frame[:, list(moved)].T
    if np.linalg.svd(share, compute_uv=False)[-1] < STANDSTILL:
        names = mechanism.names_of(mechanism.variable_owners[v] for v in moved)
        what = "dead centre" if len(moved) == 1 else "singularity of type II"
        raise SolveError(
            f"{mechanism.name}: at the start, a {what}, the rate of {listing(names)} "
            f"cannot be {listing(f'{rate:g}' for rate in rates)} rad/s; start elsewhere, "
            "or give PoseStart with rates of other pairs"
        )
    return np.asarray(np.linalg.solve(share, rates))


def drives(mechanism: Mechanism, torque: Torques | None) -> list[PairTorque]:
    """Return the loads that driving torques at the inputs are."""
    if torque is None:
        return []
    inputs = mechanism.input_pairs
    if not isinstance(torque, Mapping):
        if len(inputs) > 1:
            raise SolveError(
                f"{mechanism.name}: a torque has to say at which input it acts: give one "
                f'by the name of each, as {{"{inputs[0]}": 1.0}}; inputs without one '
                f"turn freely. Inputs: {listing(inputs)}"
            )
        torque = {inputs[0]: torque}
    loads = []
    for pair, given in torque.items():
        if pair not in inputs:
            raise SolveError(
                f'{mechanism.name}: a torque is given at "{pair}", which is not an input'
                f"{choices(pair, inputs, 'Inputs')}"
            )
        name = DRIVE if len(inputs) == 1 else f"{DRIVE}_{pair}"
        if any(load.name == name for load in mechanism.loads):
            raise ModelError(
                f'{mechanism.name}: a load is named "{name}", as that of the driving '
                "torque is; give it another name"
            )
        text = repr(float(given)) if isinstance(given, int | float) else given
        loads.append(PairTorque(name, pair, text))
    return loads


def variable_of(mechanism: Mechanism, pair: str) -> int:
    """Return the number of an R pair's variable; `SpherekitError` for other names."""
    if not mechanism.pair(pair).kind.has_axis:
        raise SolveError(f"{mechanism.name}: pair {pair} is a contact; name an R pair")
    return mechanism.angles[pair]


def _closed(
    closure: Closure, mechanism: Mechanism, values: Sequence[float]
) -> tuple[Floats, Floats]:
    """Return the closed configuration, and the whole turns that it is less (variables,)."""
    name = mechanism.name
    given = np.array(values, dtype=float)
    count = len(closure.tree.owners)
    if given.shape != (count,) or not all_finite(given):
        raise SolveError(
            f"{name}: values at the start must be {count} finite numbers, one for each "
            "variable"
        )
    _need_digits(name, given)
    angles = [*mechanism.angles.values()]
    turns = np.zeros(count)
    turns[angles], given[angles] = whole_turns(given[angles]), reduced(given[angles])
    solution = closure.solve(given[None])
    moved = float(max_abs(solution.values[0] - given))
    if not (solution.gap[0] < 1e-12 and moved < NEAR):
        raise SolveError(
            f"{name}: the values at the start do not close the loops: the nearest closed "
            f"configuration found is {moved:.2g} rad away (residual "
            f"{solution.gap[0]:.2g} rad), allowed is {NEAR} rad"
        )
    return np.asarray(solution.values[0]), turns


def _need_digits(name: str, values: Floats) -> None:
    """Raise `SolveError` where angles are so large that they say no configuration."""
    largest = float(max_abs(values))
    if largest > FARTHEST:
        raise SolveError(
            f"{name}: an angle at the start is {largest:.6g} rad, which a float64 holds to "
            f"{np.spacing(largest):.2g} rad only; allowed is up to {FARTHEST:g} rad. Leave "
            "out whole turns"
        )


def at_inputs(
    of: Mechanism | PositionAnalysis,
    q: Floats,
    assembly_mode: int | None = None,
    search: bool = True,
) -> tuple[PositionAnalysis, Motion]:
    """Return all assembly modes, or one, at inputs (n, inputs) with any whole turns.

    With their tracer, which of one input may be given, over the range of the input.
    """
    if q.shape[1] > 1:
        assert isinstance(of, Mechanism)
        tracer = PositionAnalysis(of, None, assembly_mode, search, path=q)
        return tracer, tracer.motion()
    if isinstance(of, Mechanism):
        of = PositionAnalysis(of, None, assembly_mode, search)
    tracer = reaching(of, q[:, 0], assembly_mode, search)
    motion = tracer.at(into_range(tracer, q))
    return tracer, replace(motion, inputs=np.tile(q, (len(tracer.assembly_modes), 1)))


def _configuration(
    mechanism: Mechanism, q: Floats, assembly_mode: int
) -> tuple[Floats, Floats]:
    """Return the configuration at inputs (m,), and the whole turns that it is less."""
    name = mechanism.name
    if not all_finite(q):
        raise SolveError(f"{name}: the input at the start is {q}, give finite numbers")
    _need_digits(name, q)
    near = q if len(q) == 1 or mechanism.has_contacts else reduced(q)
    tracer, motion = at_inputs(
        traced(mechanism) if len(q) == 1 else bare(mechanism), near[None]
    )
    row = tracer.place_of(assembly_mode)
    status = Status(int(motion.status[row]))
    if status not in (Status.OK, Status.AT_SINGULARITY):
        where = listing(f"{x:.6g}" for x in q)
        raise SolveError(
            f"{name}: no configuration of assembly mode {assembly_mode} at q = {where} rad "
            f"({status.name}): {STATUS_MEANING[status]}"
        )
    number = motion.assembly_modes[row].number
    solver = tracer.solver
    values = motion.values[row].copy()
    driven = list(solver.driven)
    turns = solver.unwrapping.turns(number, values[None], q[None], solver.angles)[0]
    values[driven], turns[driven] = reduced(q), whole_turns(q)
    return values, turns


def reduced(angles: Floats) -> Floats:
    """Return angles (rad) less whole turns, between -pi and pi, to the last digit."""
    turned = np.arctan2(np.sin(angles), np.cos(angles))
    return np.where(np.abs(angles) <= np.pi, angles, turned)


def whole_turns(angles: Floats) -> Floats:
    """Return the number of whole turns by which angles (rad) exceed the reduced ones."""
    return np.round((angles - reduced(angles)) / TURN)


def into_range(tracer: PositionAnalysis, q: Floats) -> Floats:
    """Return inputs moved by whole turns into the input's range, or as near as these lead.

    Where wheels count the turns, only by those after which all are as before.
    """
    low, high = tracer.range
    (period,) = tracer.solver.periods
    if not np.isfinite(period):
        return q
    scale = period / TURN
    moved = turned_into(scale * reduced(q / scale), low, high, period)
    return np.where((q >= low) & (q <= high), q, moved)


def reaching(
    tracer: PositionAnalysis,
    q: Floats,
    assembly_mode: int | None = None,
    search: bool = True,
) -> PositionAnalysis:
    """Return a tracer over a range that holds inputs q (n,) where wheels count the turns.

    It is the one given where no contact rolls, or whole turns lead into its range.
    """
    places = np.append(into_range(tracer, q), tracer.range)
    path = np.array([np.min(places), np.max(places)])
    if tracer.solver.meshes is None or np.array_equal(path, tracer.range):
        return tracer
    return PositionAnalysis(
        tracer.mechanism,
        None,
        assembly_mode,
        search,
        path=path,
        crossings=tracer.crossings,
    )


def _check_stops(mechanism: Mechanism, values: Floats) -> None:
    for stop in mechanism.joint_limits:
        value = values[variable_of(mechanism, stop.pair)]
        if not stop.low <= value <= stop.high:
            raise SolveError(
                f"{mechanism.name}: pair {stop.pair} starts at {value:.6g} rad, outside "
                f"its joint limits {stop.low:.6g} to {stop.high:.6g} rad"
            )


def _knots(mechanism: Mechanism, until: float) -> Iterable[float]:
    """Yield the times at which torque tables have kinks, and check that they reach."""
    for load in mechanism.loads:
        if isinstance(load, TorqueTable):
            load.at(np.array([0.0, until]))
            yield from load.knots(0.0, until)
