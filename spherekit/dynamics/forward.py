"""The direct problem: the motion of a mechanism from its start and its loads."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Literal, final

import numpy as np

from spherekit.conventions import STATUS_MEANING, Status
from spherekit.dynamics.collocation import (
    Attempt,
    Step,
    attempt,
    next_length,
)
from spherekit.dynamics.differences import by_differences
from spherekit.dynamics.events import StepEvents
from spherekit.dynamics.simulation import End, EndKind, Event, Simulation, Travelled
from spherekit.dynamics.start import PoseStart, Problem, prepare, variable_of
from spherekit.dynamics.state import Dynamics
from spherekit.errors import SolveError
from spherekit.model.laws import Start
from spherekit.model.mechanism import Mechanism
from spherekit.sphere.rotation import Floats

FIRST_ARC = 0.1
SHORTEST = 1e-11
"""Steps shorter than this part of the whole time end a simulation."""

TIGHTER = 1e-2
MOST_STEPS = 100_000
TOO_MANY = (
    f"{MOST_STEPS} steps are not enough; the loads change the speed too fast: raise the "
    "speed that smooths friction, or the tolerance"
)
CROSSING = (
    "two curves of configurations cross here, so the loads do not say which way the "
    "mechanism goes on; start beyond the crossing"
)


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
        self.orientation = 0.0
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
        if not self.path:
            raise SolveError(
                f"{self.equation.mechanism.name}: the motion cannot leave its start: "
                f"{end.message}"
            )
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
                if len(self.path) >= MOST_STEPS:
                    return End("too_fast", t, TOO_MANY)
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
        """Keep a step and note its events; return the end if there is one within it."""
        assert self.last is not None
        mechanism, driven = self.equation.mechanism, self.problem.driven
        tangents = self.last.motion.rates
        within = StepEvents(step, tangents)
        end = self._end(within)
        last = np.inf if end is None else end.t
        name = mechanism.pairs[mechanism.variable_owners[driven]].name
        found = [("dead_centre", t, name) for t in within.dead_centres(driven)]
        found += [("rest", t, "") for t in within.rests(self.equation.variables)]
        for kind, t, pair in sorted(found, key=lambda item: item[1]):
            if t < last:
                self._note(kind, t, float(step.at(np.array([t]))[0, driven]), pair)
        self.path.append(Travelled(step, tangents))
        self.tangent = tangents[-1]
        return end

    def _end(self, within: StepEvents) -> End | None:
        """Return the end that lies within a step: a stop, or a crossing of curves."""
        reached = within.stop(self.equation.mechanism)
        orientation = within.orientation(self.equation.closure)
        size = max(abs(self.orientation), float(np.max(np.abs(orientation))))
        side = self.orientation or float(orientation[0])
        self.orientation = float(np.copysign(size, side))
        crossing = within.crossing(orientation, self.orientation)
        if crossing is not None and (reached is None or crossing < reached[0]):
            return End("singularity", crossing, CROSSING)
        if reached is None:
            return None
        t, stop = reached
        state = within.step.at(np.array([t]))[0]
        value = float(state[variable_of(self.equation.mechanism, stop.pair)])
        self._note("stop", t, float(state[self.problem.driven]), stop.pair)
        return End("stop", t, f"pair {stop.pair} reached its stop at {value:.6g} rad")

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
            return End("singularity", t, CROSSING)
        return End(
            "too_fast",
            t,
            f"no step is short enough (iteration error {tried.error:.2g}); a load jumps "
            "or grows without bound here: smooth it, or give its time in switches",
        )
