"""The motion that follows from the loads in any arithmetic: a reference for simulations.

Of the variables the one that moves most is the coordinate c, its choice made anew for each
step. With B the equivalent inertia and Q the generalised force by c, Eksergian's equation
(Di Gregorio 2024, eq. (9)) is

    dc/dt = p / sqrt(B),   dp/dt = Q / sqrt(B),

for p = sqrt(B) dc/dt, whose square is twice the kinetic energy. In each step dc/dt and
dp/dt are series of Legendre polynomials through Gauss's nodes, found by Picard's iteration
from a float64 solution; at each of its turns the loops are closed once more by a step of
Newton's method with c held. The geometry is the declared one, see `spherekit.exact.rows`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, final

import numpy as np

from spherekit.errors import EngineError
from spherekit.exact.arithmetic import Arithmetic, Numbers
from spherekit.exact.chain import ExactChain
from spherekit.exact.inertia import link_inertia
from spherekit.exact.legendre import LegendreSeries
from spherekit.exact.linear import left_inverse
from spherekit.exact.loads import ExactLoads, ExactLoadState, Sides
from spherekit.exact.rows import motion_series, turning_rates
from spherekit.model.mechanism import Mechanism
from spherekit.sphere.rotation import Floats

SWEEPS = 40
"""Most turns of Picard's iteration; a step that needs more is too long."""

FEW = 15
"""Turns after which a step is longer than is cheap."""

ACCEPTED = 16
"""Roundings by which a step's last terms may move it."""

CHANGED = 2
"""Roundings by which the last turn of Picard's iteration may."""

SETTLED = 1e5
"""Roundings below which a change that no longer shrinks is rounding,"""

SURE = 10
"""from this turn on; before, the iteration may not yet converge."""

SHORTEST = 1e-10
"""A step shorter than this part of the whole time is not an use."""

PREFERRED = 1.5
"""Another variable becomes the coordinate where it moves this many times as fast."""

GRID = 4
"""Places, for each node of a step, at which conditions are looked at."""

CLOSING = 12
"""Most steps of Newton's method to close the loops."""

Guess = Callable[[Floats], tuple[Floats, Floats]]
"""Approximate variables (n, variables) rad, whole turns included, and their rates by
time, at times (n,) s."""

EndKind = Literal["time", "stop", "sticking"]


@final
@dataclass(frozen=True)
class ExactStates:
    """A simulation at n times, in the numbers of an arithmetic.

    `values`, `rates`, `second` (n, variables): the variables with whole turns, rad, and
    their first and second derivative by time.
    """

    t: Numbers
    values: Numbers
    rates: Numbers
    second: Numbers


@final
@dataclass(frozen=True)
class _Step:
    """A step from `start` (s), `length` long: `moves`, `pushes` (count,) series.

    They are those of the rates of the coordinate, the variable `along`, and of p, which
    are `c` and `p` at its start. `sides` are those of the switches.
    """

    start: Any
    length: Any
    along: int
    c: Any
    p: Any
    moves: Numbers
    pushes: Numbers
    sides: Floats


@final
@dataclass(frozen=True)
class _Solved:
    """A step with the conditions and variables at its nodes, and how it went.

    `error` is the size of its last terms in roundings, `sweeps` the turns it took.
    """

    step: _Step
    conditions: list[Numbers]
    values: Numbers
    error: float
    sweeps: int


@final
@dataclass(frozen=True)
class _Root:
    """Where a condition of a step passes through zero: a switch, or -1 for a stop."""

    x: Any
    switch: int
    at_once: bool


@final
@dataclass(frozen=True)
class _Place:
    """A configuration by the coordinate: for `ExactLoadState`, B, and how open it was."""

    values: Numbers
    rates: Numbers
    w: Numbers
    rotations: Numbers
    B: Numbers
    miss: Numbers


@final
class ExactSimulation:
    """The motion of a mechanism with one freedom under its loads and stops.

    It goes from t = 0 to `end` (s), where it ended by `kind`: the time asked for, a stop,
    or dry friction that would turn back at once. `switches` are the times (s) of its kinks.

    Parameters
    ----------
    arithmetic
        The numbers to compute with.
    mechanism
        With masses; all its loads act.
    driven, q, dq
        The variable whose value (rad) and rate (rad/s) at t = 0 are given, exactly.
    until
        The time (s) to go to; beyond a stop, no further.
    guess
        A float64 solution.
    nodes
        Of each step, by default as many as suit the digits. With others, steps and
        rounding are others, and the difference shows the error.

    Raises
    ------
    EngineError
        If no step is short enough, or the configuration at the start is singular by the
        driven variable.
    """

    def __init__(
        self,
        arithmetic: Arithmetic,
        mechanism: Mechanism,
        driven: int,
        q: float,
        dq: float,
        until: float,
        guess: Guess,
        nodes: int | None = None,
    ) -> None:
        self.arithmetic, self.mechanism = arithmetic, mechanism
        self.until = until
        self._guess = guess
        self._chain = ExactChain(arithmetic, mechanism)
        self._loads = ExactLoads(arithmetic, mechanism)
        self._series = LegendreSeries(arithmetic, nodes or 10 + arithmetic.digits)
        self._grid = np.linspace(-1.0, 1.0, GRID * self._series.count + 1)[1:]
        self._largest = 0.0
        self._stops = [
            (mechanism.variables_of(mechanism.pair_number[stop.pair])[0], stop)
            for stop in mechanism.stops
        ]
        self._steps: list[_Step] = []
        self.switches: list[Any] = []
        self.kind: EndKind = "time"
        self.end: Any = arithmetic.exact(0.0)[()]
        self._run(driven, q, dq)

    def at(self, t: Floats) -> ExactStates:
        """Return the motion at times t (n,) s from 0 to the end.

        Times after it count as the end.
        """
        exact = self.arithmetic
        t = np.asarray(t, dtype=float)
        end = float(self.end)
        times = np.where(t >= end, self.end, exact.exact(t))
        starts = np.array([float(step.start) for step in self._steps])
        owner = np.clip(np.searchsorted(starts, t, side="right") - 1, 0, len(starts) - 1)
        shape = len(t), len(self.mechanism.variable_owners)
        states = [exact.zeros(*shape) for _ in range(3)]
        for number in np.unique(owner):
            rows = owner == number
            for array, made in zip(
                states, self._states(self._steps[number], times[rows]), strict=True
            ):
                array[rows] = made
        return ExactStates(times, *states)

    def _states(self, step: _Step, t: Numbers) -> tuple[Numbers, Numbers, Numbers]:
        """Return the variables and their two derivatives by time within a step."""
        c, p = self._reached(step, 2 * (t - step.start) / step.length - 1)
        values = self.arithmetic.exact(self._near(t)[0])
        values[:, step.along] = c
        values, inverse = self._closed(values, step.along)
        free = self._free(step.along)
        series = motion_series(self._chain, values, inverse, free, step.along, 2)
        placed, _ = self._chain.place(series)
        w, dw = turning_rates(placed)
        B, dB = link_inertia(self.arithmetic, self.mechanism, placed[0], w, dw)
        speed = p / self.arithmetic.root(B)
        moving = ExactLoadState(values, series[1], w, placed[0], speed, t)
        force, _ = self._loads.force(moving, step.sides, self._middle(step))
        change = (force - dB * speed * speed / 2) / B
        rates = series[1] * speed[:, None]
        square = (speed * speed)[:, None]
        return values, rates, series[1] * change[:, None] + 2 * series[2] * square

    def _middle(self, step: _Step) -> float:
        return float(step.start + step.length / 2)

    def _near(self, t: Numbers) -> tuple[Floats, Floats]:
        return self._guess(self.arithmetic.floats(t))

    def _free(self, along: int) -> list[int]:
        count = len(self.mechanism.variable_owners)
        return [v for v in range(count) if v != along]

    def _closed(self, values: Numbers, along: int) -> tuple[Numbers, Numbers]:
        """Return configurations with all loops closed, and the Jacobian's inverses."""
        free = self._free(along)
        inverse = self._inverse(values, along)
        last = np.inf
        for _ in range(CLOSING):
            if not free:
                break
            gaps = self._chain.gaps(*self._chain.place(values[None]))[0]
            move = -(inverse @ gaps[..., None])[..., 0]
            size = float(np.max(self.arithmetic.floats(np.abs(move)), initial=0.0))
            if not np.isfinite(size):
                raise EngineError(
                    f"{self.mechanism.name}: a configuration is singular by variable "
                    f"{self.mechanism.variable_names[along]}; start beside it"
                )
            values = values.copy()
            values[:, free] += move
            inverse = self._inverse(values, along)
            if size <= 4 * self.arithmetic.eps or size >= last / 2:
                break
            last = size
        return values, inverse

    def _inverse(self, values: Numbers, along: int) -> Numbers:
        placed, _ = self._chain.place(values[None])
        vectors = self._chain.vectors(values, placed[0])
        jacobian = self._chain.jacobian(vectors)[:, :, self._free(along)]
        return left_inverse(self.arithmetic, jacobian)

    def _place(self, values: Numbers, along: int) -> _Place:
        """Return rates and inertia by a coordinate, and a step that closes the loops."""
        chain, free = self._chain, self._free(along)
        placed, turns = chain.place(values[None])
        vectors = chain.vectors(values, placed[0])
        rates = self.arithmetic.zeros(*values.shape)
        rates[:, along] = rates[:, along] + 1
        miss = rates[:, free]
        if free:
            jacobian = chain.jacobian(vectors)
            inverse = left_inverse(self.arithmetic, jacobian[:, :, free])
            rates[:, free] = -(inverse @ jacobian[:, :, along, None])[..., 0]
            miss = -(inverse @ chain.gaps(placed, turns)[0][..., None])[..., 0]
        w = chain.velocities(vectors, rates)
        B, _ = link_inertia(self.arithmetic, self.mechanism, placed[0], w, 0 * w)
        return _Place(values, rates, w, placed[0], B, miss)

    def _run(self, driven: int, q: float, dq: float) -> None:
        exact = self.arithmetic
        values = exact.exact(self._guess(np.zeros(1))[0])
        values[:, driven] = exact.exact(q)
        values, _ = self._closed(values, driven)
        place = self._place(values, driven)
        p = exact.root(place.B)[0] * exact.exact(dq)[()]
        along = driven
        targets = [*self._loads.knots(self.until), exact.exact(self.until)[()]]
        sides: Sides = None
        flipped: int | None = None
        length = targets[0] / 16
        while targets:
            along, p = self._best(values, along, p)
            left = targets[0] - self.end
            length = min(length, left)
            solved = self._solved(values[0, along], p, along, length, left, sides)
            step, sides = solved.step, solved.step.sides
            root = self._root(solved)
            x = exact.exact(np.ones(1)) if root is None else root.x
            if root is not None and root.at_once and root.switch == flipped:
                self.kind = "sticking"
                break
            self._steps.append(step)
            c, reached = self._reached(step, x)
            p = reached[0]
            self._largest = max(self._largest, abs(float(p)))
            done = step.start + step.length * (x[0] + 1) / 2
            self.end = targets[0] if root is None and step.length == left else done
            values = exact.exact(self._near(np.array([self.end]))[0])
            values[:, along] = c
            values, _ = self._closed(values, along)
            flipped = None
            if root is not None and root.switch < 0:
                self.kind = "stop"
                break
            if root is not None:
                flipped = root.switch
                sides = sides.copy()
                sides[flipped] = -sides[flipped]
                self.switches.append(self.end)
            elif step.length == left:
                targets.pop(0)
            factor = 0.9 * (ACCEPTED / max(solved.error, 1e-3)) ** (1 / self._series.count)
            if solved.sweeps > FEW:
                factor = min(factor, 0.8)
            length = step.length * exact.exact(np.clip(factor, 0.3, 1.5))[()]
        if not self._steps:
            raise EngineError(f"{self.mechanism.name}: the motion ends where it starts")

    def _best(self, values: Numbers, along: int, p: Any) -> tuple[int, Any]:
        """Return the variable that is the coordinate from here, and p by it."""
        rates = self.arithmetic.floats(self._place(values, along).rates[0])
        best = int(np.argmax(np.abs(rates)))
        if not abs(rates[best]) > PREFERRED:
            return along, p
        return best, p if rates[best] > 0.0 else -p

    def _solved(
        self, c: Any, p: Any, along: int, length: Any, left: Any, sides: Sides
    ) -> _Solved:
        """Return a step from the end so far, shortened until it is accurate."""
        while True:
            if float(length) < SHORTEST * self.until and float(length) < float(left):
                raise EngineError(
                    f"{self.mechanism.name}: no step of the reference is short enough at "
                    f"{float(self.end):.6g} s; smooth the loads"
                )
            solved = self._picard(c, p, along, length, sides)
            if solved is None:
                length = length / 2
            elif solved.error > ACCEPTED:
                factor = 0.9 * (ACCEPTED / solved.error) ** (1 / self._series.count)
                length = length * self.arithmetic.exact(np.clip(factor, 0.1, 0.9))[()]
            else:
                return solved

    def _picard(
        self, c: Any, p: Any, along: int, length: Any, sides: Sides
    ) -> _Solved | None:
        """Return a step of a length, None where the iteration does not end."""
        exact, series, free = self.arithmetic, self._series, self._free(along)
        t = self.end + length * (series.nodes + 1) / 2
        inside = float(self.end + length / 2)
        near, moving = self._near(t)
        values = exact.exact(near)
        speed = exact.exact(moving[:, along])
        here = c + length / 2 * (series.to_integrals @ speed)
        values[:, along] = here
        push: Numbers | None = None
        last = first = np.inf
        for sweep in range(1, SWEEPS + 1):
            place = self._place(values, along)
            size = exact.root(place.B)
            if push is None:
                push = size * speed
            speed = push / size
            state = ExactLoadState(values, place.rates, place.w, place.rotations, speed, t)
            if sides is None:
                _, seen = self._loads.force(state, None, inside)
                signs = [
                    np.sign(float(value[0])) or 1.0 for value in map(np.atleast_1d, seen)
                ]
                sides = np.array(signs, dtype=float)
            force, conditions = self._loads.force(state, sides, inside)
            drive = force / size
            there = c + length / 2 * (series.to_integrals @ speed)
            pushed = p + length / 2 * (series.to_integrals @ drive)
            values = values.copy()
            values[:, free] += place.miss + place.rates[:, free] * (there - here)[:, None]
            values[:, along] = there
            scale = max(self._largest, self._size(np.append(pushed, p))) or 1.0
            change = max(
                self._size(there - here),
                self._size(place.miss),
                self._size(pushed - push) / scale,
            )
            here, push = there, pushed
            change /= exact.eps
            first = min(first, change) if sweep <= 2 else first
            if not np.isfinite(change) or (sweep > 6 and change > 10 * first):
                return None
            settled = sweep >= SURE and last / 2 <= change <= SETTLED
            if change <= CHANGED or settled:
                moves, pushes = (series.from_values @ x for x in (speed, drive))
                half = float(length) / (4 * series.count) / exact.eps
                error = half * max(self._size(moves[-2:]), self._size(pushes[-2:]) / scale)
                step = _Step(self.end, length, along, c, p, moves, pushes, sides)
                return _Solved(step, conditions, values, error, sweep)
            last = change
        return None

    def _size(self, numbers: Numbers) -> float:
        return float(np.max(self.arithmetic.floats(np.abs(numbers)), initial=0.0))

    def _reached(self, step: _Step, x: Numbers) -> tuple[Numbers, Numbers]:
        """Return the coordinate and p at places x (n,) in [-1, 1] of a step."""
        integrals = self._series.integrals(x) * (step.length / 2)
        return step.c + integrals @ step.moves, step.p + integrals @ step.pushes

    def _root(self, solved: _Solved) -> _Root | None:
        """Return the first place at which a switch turns, or a stop is reached."""
        nearest: _Root | None = None
        exact = self.arithmetic
        for switch, signed in self._signed(solved):
            series = self._series.from_values @ signed
            shown = np.polynomial.legendre.legval(self._grid, exact.floats(series))
            beyond = np.flatnonzero(shown < 0.0)
            if not len(beyond):
                continue
            first = int(beyond[0])
            low = self._grid[first - 1] if first else -1.0
            x = self._bisected(series, exact.exact([low]), self._grid[first])
            if nearest is None or x[0] < nearest.x[0]:
                nearest = _Root(x, switch, first == 0)
        return nearest

    def _signed(self, solved: _Solved) -> Sequence[tuple[int, Numbers]]:
        """Return what stays positive at the nodes of a step until something happens."""
        exact, sides = self.arithmetic, solved.step.sides
        signed = []
        for number, condition in enumerate(solved.conditions):
            ones = exact.exact(np.full(self._series.count, sides[number]))
            signed.append((number, condition * ones))
        for variable, stop in self._stops:
            value = solved.values[:, variable]
            signed.append((-1, value - exact.exact(stop.low)))
            signed.append((-1, exact.exact(stop.high) - value))
        return signed

    def _bisected(self, series: Numbers, low: Numbers, beyond: float) -> Numbers:
        high = self.arithmetic.exact([beyond])
        for _ in range(int(3.4 * self.arithmetic.digits) + 8):
            middle = (low + high) / 2
            if self._series.values(series, middle)[0] < 0:
                high = middle
            else:
                low = middle
        return high
