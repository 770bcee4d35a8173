"""The direct problem: the motion of a mechanism from its start and its loads."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from spherekit.conventions import STATUS_MEANING, Status, listing
from spherekit.dynamics.collocation import (
    NODES,
    Attempt,
    Step,
    attempt,
    gauss,
    next_length,
)
from spherekit.dynamics.inertia import need_inertia
from spherekit.dynamics.simulation import End, EndKind, Event, Simulation, Travelled
from spherekit.dynamics.state import Dynamics, EquationOfMotion
from spherekit.errors import SolveError
from spherekit.model.dynamics import PairTorque, Stop, TorqueTable
from spherekit.model.geometry import geometry_of
from spherekit.model.laws import Start
from spherekit.model.mechanism import Mechanism
from spherekit.motion.closure import Closure
from spherekit.motion.loops import rank_mobility
from spherekit.motion.motion import Tracer
from spherekit.planning.poles import default_input
from spherekit.sphere.rotation import Floats

DRIVE = "driving_torque"
"""Name of the load that the torque at the input becomes."""

FIRST_ARC = 0.1
SHORTEST = 1e-11
"""Steps shorter than this part of the whole time end a simulation."""

STANDSTILL = 1e-9
"""A pair variable whose rate along the curve is smaller cannot be given a rate."""

TIGHTER = 1e-2


@final
@dataclass(frozen=True)
class PoseStart:
    """A start from a whole configuration, which may be a dead centre of the input.

    `values` (variables,) in the order of the mechanism's `variable_names`, closed to
    about 0.1 rad; `rate` (rad/s) is that of the R pair `pair`.
    """

    values: Sequence[float]
    pair: str
    rate: float


def simulate(
    mechanism: Mechanism,
    start: Start | PoseStart,
    until: float,
    *,
    torque: str | None = None,
    input_pair: str | None = None,
    branch: int = 0,
    tolerance: float = 1e-9,
    switches: Iterable[float] = (),
    check: bool = False,
) -> Simulation:
    """Return the motion of a single-DOF mechanism under its loads.

    Parameters
    ----------
    mechanism
        A mechanism with masses; its loads act, its stops end the simulation.
    start
        Input variable and rate at t = 0 on a branch, or a whole configuration.
    until
        Time (s) at which to end.
    torque
        Expression of the driving torque (N m) at the input, if there is one.
    input_pair, branch
        The driven R pair, by default the first input; the assembly mode at the start.
    tolerance
        Error tolerated in each step for pair variables (rad) and speeds (1/s).
    switches
        Times (s) at which expressions have kinks; knots of torque tables are known.
    check
        Whether to repeat the run with a hundredth of the tolerance and compare.

    Returns
    -------
    Simulation
        With all that was found, also where it ended before `until`.

    Raises
    ------
    ModelError, SolveError
        Before any integration: for what is missing or impossible.
    """
    problem = prepare(mechanism, start, until, torque, input_pair, branch, switches)
    if not 1e-13 <= tolerance <= 1e-2:
        raise SolveError(
            f"{mechanism.name}: tolerance is {tolerance:g}, allowed is 1e-13 to 1e-2"
        )
    found = _Run(problem, tolerance).simulation()
    if not check:
        return found
    tight = _Run(problem, max(TIGHTER * tolerance, 1e-14)).simulation()
    last = min(found.end.t, tight.end.t)
    t = np.array([x.step.start + k * x.step.length for x in found.path for k in (0, 0.4)])
    t = np.append(t[t < last], last)
    difference = np.abs(found.at(t).values - tight.at(t).values)
    return replace(found, error=float(np.max(difference)))


@final
@dataclass(frozen=True)
class Problem:
    """A direct problem that has passed all checks.

    `values` (variables,) closed at the start; `speed` along `tangent` (variables,);
    `switches` times within the run at which steps begin anew.
    """

    equation: EquationOfMotion
    driven: int
    values: Floats
    tangent: Floats
    speed: float
    until: float
    switches: tuple[float, ...]


def prepare(
    mechanism: Mechanism,
    start: Start | PoseStart,
    until: float,
    torque: str | None,
    input_pair: str | None,
    branch: int,
    switches: Iterable[float] = (),
) -> Problem:
    """Return the problem behind the arguments of `simulate`, or raise what is wrong."""
    name = mechanism.name
    if not (np.isfinite(until) and until > 0.0):
        raise SolveError(
            f"{name}: a simulation starts at t = 0 and cannot end at {until:g} s; give a "
            "finite time greater than 0"
        )
    rate = start.rate if isinstance(start, PoseStart) else start.dq
    if not np.isfinite(rate):
        raise SolveError(f"{name}: the rate at the start is {rate}, give a finite number")
    need_inertia(mechanism)
    mechanism = mechanism.with_input(input_pair or default_input(mechanism))
    driven = _variable(mechanism, mechanism.inputs[0].pair)
    if torque is not None:
        drive = PairTorque(DRIVE, mechanism.inputs[0].pair, torque)
        mechanism = replace(mechanism, loads=(*mechanism.loads, drive))
    times = sorted({float(t) for t in switches} | set(_knots(mechanism, until)))
    if not all(np.isfinite(times)):
        raise SolveError(f"{name}: switches has a time that is not finite")
    closure = Closure.of(mechanism, geometry_of(mechanism).joints)
    equation = EquationOfMotion(mechanism, closure)
    if isinstance(start, PoseStart):
        moved = _variable(mechanism, start.pair)
        values = _closed(closure, name, start.values)
    else:
        moved = driven
        values = _configuration(Tracer(mechanism), start.q, branch)
    vectors = closure.vectors(*closure.place(values[None]))
    if rank_mobility(closure.tree, vectors)[0] != 1:
        raise SolveError(
            f"{name}: the start has {rank_mobility(closure.tree, vectors)[0]} freedoms of "
            "velocity, so the loads do not say where it goes; start beside it"
        )
    tangent = equation.at(
        np.zeros(1), equation.state(values, 0.0)[None], np.eye(len(values))[moved]
    ).motion.rates[0]
    if rate != 0.0 and abs(tangent[moved]) < STANDSTILL:
        pair = mechanism.pairs[mechanism.variable_owners[moved]].name
        raise SolveError(
            f"{name}: pair {pair} is at a dead centre at the start and cannot move at "
            f"{rate:g} rad/s; start elsewhere, or give PoseStart with the rate of "
            "another pair"
        )
    speed = rate / tangent[moved] if rate != 0.0 else 0.0
    _check_stops(mechanism, values)
    inside = tuple(t for t in times if 0.0 < t < until)
    return Problem(equation, driven, values, tangent, speed, until, inside)


def _variable(mechanism: Mechanism, pair: str) -> int:
    if mechanism.pair(pair).type != "R":
        raise SolveError(f"{mechanism.name}: pair {pair} is a contact; name an R pair")
    return mechanism.variables_of(mechanism.pair_number[pair])[0]


def _closed(closure: Closure, name: str, values: Sequence[float]) -> Floats:
    given = np.asarray(values, dtype=float)
    count = len(closure.tree.owners)
    if given.shape != (count,) or not np.all(np.isfinite(given)):
        raise SolveError(
            f"{name}: values at the start must be {count} finite numbers, one for each "
            "variable"
        )
    found = closure.solve(given[None], None)
    if not found.residual[0] < 1e-12:
        raise SolveError(
            f"{name}: the values at the start do not close the loops, and no closed "
            f"configuration was found near them (residual {found.residual[0]:.2g} rad)"
        )
    return np.asarray(found.values[0])


def _configuration(tracer: Tracer, q: float, branch: int) -> Floats:
    name = tracer.mechanism.name
    numbers = [item.number for item in tracer.branches]
    if branch not in numbers:
        raise SolveError(
            f"{name}: there is no branch {branch}; the branches found are "
            f"{listing(numbers)}"
        )
    if not np.isfinite(q):
        raise SolveError(f"{name}: the input at the start is {q}, give a finite number")
    motion = tracer.at(np.array([into_range(tracer, np.array([q]))[0]]))
    row = numbers.index(branch)
    if motion.failed[row]:
        status = Status(int(motion.status[row]))
        raise SolveError(
            f"{name}: no configuration of branch {branch} at q = {q:.6g} rad "
            f"({status.name}): {STATUS_MEANING[status]}"
        )
    values: Floats = motion.values[row].copy()
    values[tracer.solver.driven] = q
    return values


def into_range(tracer: Tracer, q: Floats) -> Floats:
    """Return inputs moved by whole turns into the input's range, if that is a turn."""
    turn = 2.0 * np.pi
    if tracer.high - tracer.low < turn * (1.0 - 1e-12):
        return q
    return np.asarray(
        np.where(
            (q >= tracer.low) & (q <= tracer.high),
            q,
            tracer.low + np.mod(q - tracer.low, turn),
        )
    )


def _check_stops(mechanism: Mechanism, values: Floats) -> None:
    for stop in mechanism.stops:
        value = values[_variable(mechanism, stop.pair)]
        if not stop.low <= value <= stop.high:
            raise SolveError(
                f"{mechanism.name}: pair {stop.pair} starts at {value:.6g} rad, outside "
                f"its stops {stop.low:.6g} to {stop.high:.6g} rad"
            )


def _knots(mechanism: Mechanism, until: float) -> Iterable[float]:
    """Yield the times at which torque tables have kinks, and check that they reach."""
    for load in mechanism.loads:
        if not isinstance(load, TorqueTable):
            continue
        load.at(np.array([0.0, until]))
        if not load.periodic:
            yield from load.times
            continue
        period = load.times[-1] - load.times[0]
        first = int(np.floor((0.0 - load.times[-1]) / period))
        last = int(np.ceil((until - load.times[0]) / period))
        for turn in range(first, last + 1):
            yield from (t + turn * period for t in load.times)


@final
class _Run:
    """One integration of a problem, kept while it goes on."""

    def __init__(self, problem: Problem, tolerance: float) -> None:
        self.problem = problem
        self.equation = problem.equation
        self.tolerance = tolerance
        self.tangent = problem.tangent
        self.path: list[Travelled] = []
        self.events: list[Event] = []
        self.drift = 0.0
        self.evaluations = 0
        self.last: Dynamics | None = None

    def field(self, t: Floats, states: Floats) -> Floats:
        """Return the rates of states, on the side of the last step's tangent."""
        self.last = self.equation.at(t, states, self.tangent)
        self.evaluations += 1
        return self.equation.rates(self.last)

    def simulation(self) -> Simulation:
        """Integrate to the end."""
        with np.errstate(all="ignore"):
            end = self._integrate()
        problem = self.problem
        return Simulation(
            self.equation,
            problem.driven,
            tuple(self.path),
            tuple(self.events),
            end,
            self.drift,
            self.evaluations,
        )

    def _integrate(self) -> End:
        problem = self.problem
        t, state = 0.0, self.equation.state(problem.values, problem.speed)
        length = self._first_length(state)
        before: Step | None = None
        for target in (*problem.switches, problem.until):
            while t < target:
                left = target - t
                tried_length = left if left < 1.05 * length else min(length, left)
                tried = attempt(self.field, t, tried_length, state, self.tolerance, before)
                assert self.last is not None
                status = self.last.motion.status
                if tried.error > 1.0 or np.any(status != Status.OK):
                    length = min(next_length(tried), 0.5 * tried_length)
                    if length < SHORTEST * problem.until:
                        return self._stuck(t, state, tried)
                    continue
                if tried_length == length or tried_length < left:
                    length = next_length(tried)
                stopped = self._accept(tried.step)
                if stopped is not None:
                    return stopped
                t = target if tried_length == left else tried.step.stop
                before = tried.step
                state = self._closed(tried.step.end)
            if t < problem.until:
                self._note("switch", t, float(state[problem.driven]), "")
                before = None
        return End("time", problem.until, "the time asked for is over")

    def _first_length(self, state: Floats) -> float:
        found = self.equation.at(np.zeros(1), state[None], self.tangent)
        pace = abs(float(found.speed[0])) / FIRST_ARC
        pace = max(pace, np.sqrt(abs(float(found.acceleration[0])) / FIRST_ARC))
        return float(min(self.problem.until, 1.0 / max(pace, 1e-300), 1.0))

    def _closed(self, state: Floats) -> Floats:
        """Return the state with its configuration put back onto the curve.

        By Newton's method along the normal space, so that no travel is added.
        """
        variables = self.equation.variables
        gap, jacobian = self.equation.closure.linearise(state[None, :variables])
        if not gap.size:
            return state
        self.drift = max(self.drift, float(np.max(np.abs(gap))))
        closed = state.copy()
        closed[:variables] -= np.linalg.pinv(jacobian[0], rcond=1e-10) @ gap[0]
        return closed

    def _accept(self, step: Step) -> End | None:
        """Keep a step and note its events; return the end if a stop was reached."""
        assert self.last is not None
        tangents = self.last.motion.rates
        driven, variables = self.problem.driven, self.equation.variables
        x = gauss(NODES).nodes
        inner = np.concatenate([[-1.0], x, [1.0]])
        t = step.start + 0.5 * step.length * (inner + 1.0)
        states = step.at(t)
        series = gauss(NODES).to_series @ tangents[:, driven]

        def at(column: int, level: float) -> Callable[[float], float]:
            return lambda s: float(step.at(np.array([s]))[0, column]) - level

        def along(s: float) -> float:
            place = 2.0 * (s - step.start) / step.length - 1.0
            return float(np.polynomial.legendre.legval(place, series))

        def note(kind: str, times: Iterable[float], pair: str) -> None:
            for moment in times:
                q = float(step.at(np.array([moment]))[0, driven])
                self._note(kind, moment, q, pair)

        reached: list[tuple[float, Stop]] = []
        for stop in self.equation.mechanism.stops:
            column = _variable(self.equation.mechanism, stop.pair)
            for level, sense in ((stop.low, -1.0), (stop.high, 1.0)):
                beyond = sense * (states[:, column] - level)
                beyond[0] = min(beyond[0], 0.0)
                for k in np.flatnonzero((beyond[1:] > 0.0) & (beyond[:-1] <= 0.0))[:1]:
                    reached.append((_root(at(column, level), t[k], t[k + 1]), stop))
        last = min((item[0] for item in reached), default=np.inf)
        name = self.equation.mechanism.pairs[
            self.equation.mechanism.variable_owners[driven]
        ].name
        edges = np.array([along(t[0]), *tangents[:, driven], along(t[-1])])
        turning = [s for s in _crossings(along, t, edges) if s < last]
        resting = _crossings(at(variables, 0.0), t, states[:, variables])
        note("dead_centre", turning, name)
        note("rest", [s for s in resting if s < last], "")
        self.events.sort(key=lambda event: event.t)
        self.path.append(Travelled(step, tangents))
        self.tangent = tangents[-1]
        if not reached:
            return None
        moment, stop = min(reached, key=lambda item: item[0])
        note("stop", [moment], stop.pair)
        value = float(
            step.at(np.array([moment]))[0, _variable(self.equation.mechanism, stop.pair)]
        )
        return End("stop", moment, f"pair {stop.pair} reached its stop at {value:.6g} rad")

    def _note(self, kind: str, t: float, q: float, pair: str) -> None:
        self.events.append(Event(kind, t, q, pair))  # type: ignore[arg-type]

    def _stuck(self, t: float, state: Floats, tried: Attempt) -> End:
        """Return why no step however short can be taken from here."""
        assert self.last is not None
        codes = self.last.motion.status
        kinds: dict[Status, EndKind] = {
            Status.OFF_PROFILE: "off_profile",
            Status.CURVATURE: "curvature",
        }
        for code, kind in kinds.items():
            if np.any(codes == code):
                return End(kind, t, STATUS_MEANING[code])
        values = state[None, : self.equation.variables]
        _, jacobian = self.equation.closure.linearise(values)
        sizes = np.linalg.svd(jacobian[0], compute_uv=False)
        least = float(sizes[-1] / sizes[0]) if len(sizes) else 1.0
        if least < 1e-5:
            return End(
                "singularity",
                t,
                "the configuration has more than one way on: the closure equations are "
                f"dependent to {least:.1g}",
            )
        return End(
            "too_fast",
            t,
            f"no step is short enough (iteration error {tried.error:.2g}); a load jumps "
            "or grows without bound here: smooth it, or give its time in switches",
        )


def _root(value: Callable[[float], float], low: float, high: float) -> float:
    """Return where a function that changes sign between two times is zero."""
    from scipy.optimize import brentq

    one, other = value(low), value(high)
    if one == 0.0 or one * other > 0.0:
        return low if abs(one) <= abs(other) else high
    return float(brentq(value, low, high, xtol=1e-15, rtol=1e-15))


def _crossings(value: Callable[[float], float], t: Floats, samples: Floats) -> list[float]:
    """Return the times between t (k,) at which a function with these samples is zero."""
    changes = np.flatnonzero((samples[:-1] != 0.0) & (samples[:-1] * samples[1:] <= 0.0))
    return [_root(value, float(t[k]), float(t[k + 1])) for k in changes]
