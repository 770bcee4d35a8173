"""The direct problem: the motion of a mechanism from its start and its loads."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Literal, final

import numpy as np

from spherekit.conventions import STATUS_MEANING, Status
from spherekit.dynamics.collocation import (
    NODES,
    Attempt,
    Step,
    attempt,
    gauss,
    next_length,
)
from spherekit.dynamics.differences import by_differences
from spherekit.dynamics.simulation import End, EndKind, Event, Simulation, Travelled
from spherekit.dynamics.start import PoseStart, Problem, prepare, variable_of
from spherekit.dynamics.state import Dynamics
from spherekit.errors import SolveError
from spherekit.model.dynamics import Stop
from spherekit.model.laws import Start
from spherekit.model.mechanism import Mechanism
from spherekit.sphere.rotation import Floats

FIRST_ARC = 0.1
SHORTEST = 1e-11
"""Steps shorter than this part of the whole time end a simulation."""

TIGHTER = 1e-2


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
    scheme: Literal["collocation", "paper"] = "collocation",
    step: float | None = None,
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
    scheme, step
        ``"paper"`` takes the source's finite differences instead, with equal steps (s)
        and without events; see `spherekit.dynamics.differences`.

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
    if scheme == "paper":
        return by_differences(problem, step if step is not None else until / 1000.0)
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
        t, state = 0.0, self.equation.state(problem.values, problem.speed, problem.tangent)
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
        push = abs(float(np.sum(found.forces) / found.B[0]))
        pace = max(pace, np.sqrt(push / FIRST_ARC))
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
            column = variable_of(self.equation.mechanism, stop.pair)
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
            step.at(np.array([moment]))[0, variable_of(self.equation.mechanism, stop.pair)]
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
