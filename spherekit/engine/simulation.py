"""Forward dynamics: the motion of a mechanism from its initial state and its loads."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike

from spherekit.conventions import SINGULAR_RATIO, listing, nearest
from spherekit.engine.compiler import End, Integrator
from spherekit.engine.dynamics import Dynamics, dynamics
from spherekit.engine.loads import FULL_TURN, AppliedLoad
from spherekit.errors import EngineError
from spherekit.model.mechanism import Mechanism
from spherekit.motion.closure import Closure
from spherekit.sphere.rotation import Floats

CLOSED = 1e-9
"""Initial values whose loops stay open by more than this (rad) are refused."""

MAX_STEPS = 10_000_000


@final
@dataclass(frozen=True)
class Passage:
    """An event of a simulation: what, when (s), and the variables there (rad)."""

    name: str
    time: float
    sense: int


@final
@dataclass(frozen=True)
class Simulation:
    """The motion at the times asked for, as far as it came.

    `t` (m,) s; `reduced` (m, variables) rad, the variables less `turns` whole turns, so
    that they keep their accuracy after many; `speed` (m,) dp/dt; `work` (m,) of all loads
    since the start (J). `events` are what was passed, in order. `ended` says why the
    motion stopped early, "" if it did not; the last state reached is at `end_time`,
    `end_values`. `steps` were taken in `seconds`; compiling took `compile_seconds`
    (now or before).
    """

    made: Dynamics
    t: Floats
    reduced: Floats
    turns: Floats
    speed: Floats
    work: Floats
    events: tuple[Passage, ...]
    ended: str
    end_time: float
    end_values: Floats
    steps: int
    seconds: float
    compile_seconds: float

    @cached_property
    def _seen(self) -> Floats:
        inputs = np.vstack([self.reduced.T, self.speed, self.t, self.turns.T])
        return np.asarray(self.made.observe(np.ascontiguousarray(inputs)))

    @cached_property
    def _size(self) -> Floats:
        return np.asarray(self.made.size(np.ascontiguousarray(self.reduced.T)))

    def _row(self, number: int) -> Floats:
        return np.asarray(self._seen[self.reduced.shape[1] + number])

    @property
    def values(self) -> Floats:
        """(m, variables) the variables (rad), whole turns included."""
        return self.reduced + FULL_TURN * self.turns

    @property
    def q(self) -> Floats:
        """(m,) angle of the input (rad)."""
        return np.asarray(self.values[:, self.made.structure.driven])

    @property
    def rates(self) -> Floats:
        """(m, variables) rates of all variables by time (rad/s)."""
        return np.asarray(self._seen[: self.reduced.shape[1]].T)

    @property
    def dq(self) -> Floats:
        """(m,) rate of the input (rad/s)."""
        return np.asarray(self.rates[:, self.made.structure.driven])

    @property
    def ddq(self) -> Floats:
        """(m,) second derivative of the input by time (rad/s2)."""
        return self._row(0)

    @property
    def inertia(self) -> Floats:
        """(m,) generalised inertia B by the input (kg m2); infinite at its dead centre."""
        return self._row(1)

    @property
    def inertia_dq(self) -> Floats:
        """(m,) dB/dq (kg m2/rad)."""
        return self._row(2)

    @property
    def kinetic(self) -> Floats:
        """(m,) kinetic energy (J)."""
        return self._row(3)

    @property
    def arc_speed(self) -> Floats:
        """(m,) speed along the curve of all variables (rad/s)."""
        return np.asarray(self._size[1] * self.speed)

    @property
    def powers(self) -> Mapping[str, Floats]:
        """(m,) power of each load by name (W)."""
        return {name: self._row(4 + k) for k, name in enumerate(self.made.loads)}

    @property
    def forces(self) -> Mapping[str, Floats]:
        """(m,) generalised force Q of each load for the input (N m)."""
        dq = self.dq
        return {name: power / dq for name, power in self.powers.items()}

    @property
    def imbalance(self) -> Floats:
        """(m,) kinetic energy gained less work done (J): the error of the integration."""
        return np.asarray(self.kinetic - self.kinetic[0] - self.work)

    @cached_property
    def closure(self) -> Floats:
        """(m,) largest rotation (rad) by which a loop stays open."""
        structure = self.made.structure
        closure = Closure.of(structure.mechanism, structure.pairs.joints)
        gaps = closure.residual(*closure.place(self.reduced))
        return np.asarray(np.max(np.abs(gaps), axis=1))


def simulate(
    mechanism: Mechanism,
    input_pair: str,
    start: ArrayLike,
    times: ArrayLike,
    *,
    rate: float | None = None,
    arc_rate: float | None = None,
    loads: Sequence[AppliedLoad] = (),
    dead_centres: Sequence[str] = (),
    stops: Mapping[str, float] | None = None,
    tolerance: float = 1e-13,
    compact: bool = True,
    number: type[Any] = float,
    max_steps: int = MAX_STEPS,
) -> Simulation:
    """Return the motion of a mechanism under loads from an initial state.

    Parameters
    ----------
    mechanism, input_pair
        A mechanism with one freedom, and the pair whose angle q is the input.
    start
        (variables,) a closed configuration (rad), which also says the assembly mode.
    times
        (m,) rising times (s) at which the motion is wanted; the first is the start.
    rate, arc_rate
        One of them: dq/dt (rad/s), or the speed along the curve of all variables
        (rad/s), which also starts a motion from a dead centre of the input.
    loads
        All loads that act, those of the actuator among them.
    dead_centres, stops
        Variables whose dead centres are noted, and values (rad) at which variables end
        the motion.
    tolerance, compact, number
        See `spherekit.engine.dynamics.dynamics`.
    max_steps
        The run ends after this many steps, and keeps what it has.

    Raises
    ------
    EngineError
        If the initial state is not one, the times do not rise, names are unknown, or the
        mechanism cannot be compiled.
    """
    grid = np.atleast_1d(np.asarray(times, dtype=float))
    given = np.asarray(start, dtype=float)
    stops = dict(stops or {})
    _check_times(mechanism, grid)
    for name in (*dead_centres, *stops):
        if name not in mechanism.variable_names:
            raise EngineError(
                f'{mechanism.name}: no variable is named "{name}"'
                f"{nearest(name, mechanism.variable_names) or ';'} Variables: "
                f"{listing(mechanism.variable_names)}"
            )
    made = dynamics(
        mechanism,
        input_pair,
        loads,
        dead_centres,
        tuple(stops),
        tolerance,
        compact,
        number,
    )
    _check_start(made, given)
    speed = _initial_speed(made, given, rate, arc_rate)
    count = len(given)
    turns = np.zeros(count)
    sides = _sides(made, given, speed, grid[0])
    integrator = made.integrator
    _, length, inertia = made.size(given[:, None])[:, 0]
    scales = np.array([1.0 / length, inertia / length**2])
    first = np.array([*given, speed / scales[0], 0.0])
    started = time.perf_counter()
    parameters = np.array([*turns, *scales, *stops.values(), *sides])
    integrator.start(first, float(grid[0]), parameters)
    period = _periods(made)
    rows: list[Floats] = [first[None]]
    windings: list[Floats] = [turns[None]]
    done, steps = 1, 0
    end = End.STEPS if len(grid) > 1 else End.TIME
    while end is End.STEPS and steps < max_steps:
        turns = turns + _reduce(integrator, count, period)
        stretch = min(STRETCH, max_steps - steps)
        states, end, taken = integrator.run(grid[done:], stretch)
        rows.append(states)
        windings.append(np.broadcast_to(turns, (len(states), count)))
        done, steps = done + len(states), steps + taken
    seconds = time.perf_counter() - started
    states, wound = np.concatenate(rows), np.concatenate(windings)
    events = tuple(
        Passage(made.events[each.event], each.time, each.sense) for each in integrator.seen
    )
    return Simulation(
        made,
        grid[:done],
        states[:, :count],
        wound,
        states[:, count] * scales[0],
        states[:, count + 1] * scales[1],
        events,
        _reason(end, events, integrator.time, max_steps),
        integrator.time,
        integrator.state[:count].astype(float) + FULL_TURN * turns,
        steps,
        seconds,
        made.seconds,
    )


STRETCH = 50
"""Steps after which angles are reduced by whole turns; long runs need it for accuracy."""

_FULL_TURN_REST = 2.4492935982947064e-16
"""2 pi less its nearest float64."""


def _periods(made: Dynamics) -> Floats:
    """Return 1 for variables that may be reduced by whole turns, 0 for contacts."""
    mechanism = made.structure.mechanism
    kinds = [mechanism.pairs[owner].type for owner in mechanism.variable_owners]
    return np.array([1.0 if kind == "R" else 0.0 for kind in kinds])


def _reduce(integrator: Integrator, count: int, period: Floats) -> Floats:
    """Take whole turns off the angles of the state, and return how many."""
    values = integrator.state[:count]
    turns: Floats = np.round(values.astype(float) / FULL_TURN) * period
    values -= turns * FULL_TURN
    values -= turns * _FULL_TURN_REST
    known = integrator.parameters[:count]
    known += turns[: len(known)]
    return turns


def _reason(end: End, events: Sequence[Passage], time: float, max_steps: int) -> str:
    if end is End.TIME:
        return ""
    if end is End.EVENT:
        if events[-1].name.startswith("switch"):
            return f"{events[-1].name} would turn back at once at t = {time:.9g} s"
        return f"{events[-1].name} at t = {time:.9g} s"
    if end is End.NOT_FINITE:
        return f"the state is no longer finite after t = {time:.9g} s"
    return f"{max_steps} steps were not enough; they reached t = {time:.9g} s"


def _check_times(mechanism: Mechanism, grid: Floats) -> None:
    if not np.all(np.isfinite(grid)) or not np.all(np.diff(grid) > 0.0):
        raise EngineError(
            f"{mechanism.name}: the times of a simulation have to be finite and to rise; "
            "sort them and remove repetitions"
        )


def _check_start(made: Dynamics, given: Floats) -> None:
    mechanism = made.structure.mechanism
    count = len(mechanism.variable_names)
    if given.shape != (count,) or not np.all(np.isfinite(given)):
        raise EngineError(
            f"{mechanism.name}: the start of a simulation has {count} finite values, one "
            f"for each of {listing(mechanism.variable_names)}"
        )
    closure = Closure.of(mechanism, made.structure.pairs.joints)
    gap = closure.residual(*closure.place(given[None]))
    if gap.size and np.max(np.abs(gap)) > CLOSED:
        raise EngineError(
            f"{mechanism.name}: the loops stay open by {np.max(np.abs(gap)):.3g} rad at "
            "the start; take a configuration of a motion (spherekit.trace)"
        )


def _initial_speed(
    made: Dynamics, given: Floats, rate: float | None, arc_rate: float | None
) -> float:
    name = made.structure.mechanism.name
    wanted = [each for each in (rate, arc_rate) if each is not None]
    if len(wanted) != 1 or not np.isfinite(wanted[0]):
        raise EngineError(f"{name}: give one finite initial rate, of the input or the arc")
    tau_q, size, _ = made.size(given[:, None])[:, 0]
    if not size > 0.0:
        raise EngineError(
            f"{name}: at the start the mechanism has more than one motion; start elsewhere"
        )
    if rate is None:
        return float(wanted[0] / size)
    if abs(tau_q) < SINGULAR_RATIO * size and rate != 0.0:
        raise EngineError(
            f"{name}: the start is a dead centre of the input, where its rate is zero "
            "whatever the motion; give arc_rate, or start elsewhere"
        )
    return float(rate / tau_q) if rate else 0.0


def _sides(made: Dynamics, given: Floats, speed: float, time: float) -> Floats:
    """Return the signs of the loads' conditions at the start.

    Where a condition is zero, that towards which it goes; positive if it stays.
    """
    if made.conditions is None:
        return np.zeros(0)
    known = np.concatenate([given, [speed, time], np.zeros(len(given))])
    count = len(made.events) - sum(not each.startswith("switch") for each in made.events)
    sides = np.zeros(count)
    for k in range(count):
        row = np.concatenate([known, sides])[:, None]
        both = np.asarray(made.conditions(row))[:, 0].reshape(2, count)[:, k]
        sides[k] = np.sign(both[0]) or np.sign(both[1]) or 1.0
    return sides
