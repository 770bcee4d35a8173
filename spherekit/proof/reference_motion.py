"""The motion that follows from the loads in balls: a reference for simulations.

Of the variables the one that moves most is the coordinate c, its choice made anew for each
step. With B the equivalent inertia and Q the generalised force by c, Eksergian's equation
(Di Gregorio 2024, eq. (9)) is

    dc/dt = p / sqrt(B),   dp/dt = Q / sqrt(B),

for p = sqrt(B) dc/dt, whose square is twice the kinetic energy. In each step dc/dt and
dp/dt are series of Legendre polynomials through Gauss's nodes, found by Picard's iteration
from a float64 solution; at each of its turns the loops are closed once more by a step of
Newton's method with c held. The geometry is the declared one, see
`spherekit.proof.reference_rows`.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.polynomial.legendre import legint, legvander

from spherekit.arrays import Array, Floats
from spherekit.errors import EngineError
from spherekit.mechanism.load import LoadComponent, TorqueTable, require_expression
from spherekit.mechanism.load_expression import ARRAY_OPERATIONS, NON_SMOOTH_FUNCTIONS, fold
from spherekit.mechanism.mechanism import Mechanism
from spherekit.proof.ball_forces import Moving, Sides, _of_table, inertia
from spherekit.proof.ball_frames import exact, exactly
from spherekit.proof.balls import (
    Ball,
    Digits,
    coefficient,
    floats,
    library,
    middles,
    series,
)
from spherekit.proof.linkage import Closed, Linkage, left_inverse, turning_rates
from spherekit.status import Status


def knots(parts: Sequence[LoadComponent], until: float) -> list[Ball]:
    """Return the times between 0 and `until` (s) at which tables of torques have kinks."""
    every: list[Ball] = []
    for table in (part.magnitude for part in parts):
        if isinstance(table, TorqueTable):
            times = exactly(table.times)
            period = times[-1] - times[0]
            farthest = until + np.max(np.abs(table.times))
            turns = int(farthest / float(period)) + 1 if table.periodic else 0
            for turn in range(-turns, turns + 1):
                every.extend(middles(times + turn * period))
    inside = {float(t): t for t in every if 0.0 < float(t) < until}
    return sorted(inside.values(), key=float)


SWEEPS = 40
"""Most turns of Picard's iteration; a step that needs more is too long."""

FEW, LONGER = 15, 1.05
"""Turns after which a step is longer than is cheap; how much longer else the next is."""

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

Guess = Callable[[Floats], tuple[Floats, Floats]]
"""Approximate variables (n, variables) rad, whole turns included, and their rates by
time, at times (n,) s."""

EndKind = Literal["time", "joint_limit", "sticking"]


@dataclass(frozen=True)
class _Step:
    """A step from `start` (s), `length` long, on which time goes from -1 to 1.

    `way` (count + 1, 2) are the series of the coordinate, the variable `along`, and of p.
    `sides` are those of the switches; `signed` are series that turn negative where one
    ends, by its number, -1 for joint limits. `error` is the size of its last terms in
    roundings, `sweeps` the turns it took.
    """

    start: Ball
    length: Ball
    along: int
    way: Array
    sides: Floats
    signed: list[tuple[int, Array]]
    error: float
    sweeps: int

    def reached(self, x: Array) -> Array:
        """Return the coordinate and p (2, n) at places x (n,) in [-1, 1]."""
        return middles(_value(self.way, x).T)


def _value(series: Array, x: Array) -> Array:
    """Return Legendre series with coefficients (count, ...) at places x (n,)."""
    # numpy's own `legval` has factors that it rounds to float64
    return legvander(x, len(series) - 1) @ series


def _integral(series: Array) -> Array:
    """Return the series of the integrals from -1."""
    made = legint(series)
    made[0] -= _value(made, exactly([-1.0]))[0]
    return made


class ExactSimulation:
    """The motion of a single-DOF mechanism from a start, under its loads.

    It goes from t = 0 to `end` (s), where it ended by `kind`: the time asked for, a joint
    limit, or dry friction that would turn back at once. `switches` are the times (s) of its
    kinks.

    Parameters
    ----------
    arithmetic
        The digits to compute with.
    mechanism
        With masses; all its loads act.
    driven, q, dq
        The variable whose value (rad) and rate (rad/s) at t = 0 are given, exactly.
    until
        The time (s) to go to; beyond a stop, no further.
    guess
        A float64 solution.

    Raises
    ------
    EngineError
        If no step is short enough, or the configuration at the start is singular by the
        driven variable.
    """

    def __init__(
        self,
        arithmetic: Digits,
        mechanism: Mechanism,
        driven: int,
        q: float,
        dq: float,
        until: float,
        guess: Guess,
    ) -> None:
        self.arithmetic, self.mechanism, self.until = arithmetic, mechanism, until
        self._guess = guess
        self._largest = 0.0
        self._steps: list[_Step] = []
        self.switches: list[Ball] = []
        self.kind: EndKind = "time"
        with arithmetic.within():
            self.end = exact(0.0)
            self._linkage = Linkage(mechanism)
            self._parts = [
                part for load in mechanism.loads for part in load.components(mechanism)
            ]
            self._count = count = 10 + arithmetic.digits
            root = library().arb.legendre_p_root
            rows = [root(count, k, weight=True) for k in range(count)[::-1]]
            self._nodes, weights = middles(np.array(rows)).T
            polynomials = legvander(self._nodes, count - 1) * (np.arange(count) + 0.5)
            # coefficients from values at the nodes, and integrals from the start to these
            self._series = middles((polynomials * weights[:, None]).T)
            self._integrals = middles(_value(_integral(self._series), self._nodes))
            self._grid = np.linspace(-1.0, 1.0, GRID * count + 1)
            self._run(driven, q, dq)

    def at(self, t: Floats) -> Array:
        """Return the variables and two derivatives by time, balls (3, n, variables).

        At times t (n,) s from 0 to the end; later ones count as the end. The variables are
        in rad, whole turns included.
        """
        t = np.asarray(t, dtype=float)
        with self.arithmetic.within():
            times = np.where(t >= float(self.end), self.end, exactly(t))
            later = [float(step.start) for step in self._steps[1:]]
            owner = np.searchsorted(later, t, side="right")
            shape = 3, len(t), len(self.mechanism.variable_owners)
            states: Array = np.empty(shape, dtype=object)
            for number in np.unique(owner):
                rows = owner == number
                states[:, rows] = self._states(self._steps[number], times[rows])
        return states

    def _states(self, step: _Step, t: Array) -> list[Array]:
        """Return the variables and their two derivatives by time within a step."""
        c, p = step.reached(2 * (t - step.start) / step.length - 1)
        closed = self._closed(t, c, step.along)
        values, first, second = self._linkage.motion(closed, step.along, 2)
        placed, _ = self._linkage.place(series(values, first, second))
        w, dw = turning_rates(placed, 2)
        placed = coefficient(placed, 0)
        B, dB = inertia(self.mechanism, placed, w, dw)
        speed = p / np.sqrt(B)
        inside = float(step.start + step.length / 2)
        moving = Moving(values, first, w, placed)
        push, _ = self._force(moving, speed, t, step.sides, inside)
        change = (push - dB * speed * speed / 2) / B
        second = first * change[:, None] + 2 * second * (speed * speed)[:, None]
        return [values, first * speed[:, None], second]

    def _force(
        self, moving: Moving, speed: Array, t: Array, sides: Sides, inside: float
    ) -> tuple[Array, list[Array]]:
        """Return the generalised force of the loads (n,), and the switches' conditions.

        `speed` (n,) is the rate of the coordinate by time, `t` (n,) s. Conditions are in
        the order in which expressions are evaluated; numbers in these are the float64 they
        are. `inside` is a time (s) between the knots about the rows.
        """
        variables, conditions = self.mechanism.angles, list[Array]()
        total = exactly(np.zeros(len(t)))

        def named(name: str) -> Any:
            kind, _, pair = name.partition("_")
            if kind == "t":
                return t
            if kind == "theta":
                return moving.values[:, variables[pair]]
            return moving.rates[:, variables[pair]] * speed

        def side(condition: Array) -> Any:
            """Return the side of the next condition (n,)."""
            conditions.append(np.atleast_1d(condition))
            return (
                np.sign(floats(condition)) if sides is None else sides[len(conditions) - 1]
            )

        def applied(name: str, given: Sequence[Any]) -> Any:
            """Return a function of expressions; NaN outside its domain."""
            if name in ("sign", "abs"):
                return side(given[0]) * given[0] ** (name == "abs")
            if name in NON_SMOOTH_FUNCTIONS:
                upward, best = 1 if name == "max" else -1, given[0]
                for item in given[1:]:
                    gap = best - item
                    best = (best + item + upward * side(gap) * gap) / 2
                return best
            if not hasattr(exact(0.0), name):
                return ARRAY_OPERATIONS[name](*given)
            return np.frompyfunc(lambda x, *y: getattr(x, name)(*y), len(given), 1)(*given)

        for part in self._parts:
            if isinstance(part.magnitude, TorqueTable):
                magnitude = _of_table(part.magnitude, t, inside)
            else:
                magnitude = fold(
                    require_expression(part.magnitude).root, exact, named, applied
                )
            rates = [moving.rates[:, variables[part.pair]]] if part.pair else []
            for moment in part.moments:
                link = self.mechanism.link_number[moment.link]
                w, turn = moving.w[:, link], moving.rotations[:, link]
                if moment.arm is not None:
                    w = np.cross(w, turn @ exactly(moment.arm))
                direction = exactly(moment.direction)
                if moment.axes == "link":
                    direction = turn @ direction
                rates.append(np.sum(w * direction, axis=1))
            total = total + magnitude * sum(rates)
        return total, conditions

    def _closed(self, t: Array, c: Array, along: int) -> Closed:
        """Return the closed configurations at times with a variable held."""
        values = exactly(self._guess(floats(t))[0])
        values[:, along] = c
        closed = self._linkage.closed(values, [along], self.arithmetic.eps)
        if np.any(closed.status != Status.OK):
            raise EngineError(
                f"{self.mechanism.name}: a configuration is singular by variable "
                f"{self.mechanism.variable_names[along]}; start beside it"
            )
        return closed

    def _moving(self, values: Array, along: int) -> tuple[Moving, Array, Array]:
        """Return rates and inertia by a coordinate, and a step that closes the loops."""
        linkage = self._linkage
        free = [v for v in range(values.shape[1]) if v != along]
        placed, gaps = linkage.place(values)
        vectors = linkage.vectors(values, placed)
        jacobian = linkage.jacobian(vectors)
        inverse, _ = left_inverse(jacobian[:, :, free])
        rates, miss = exactly(np.zeros((2, *values.shape)))
        rates[:, along] = exact(1.0)
        rates[:, free] = -np.matvec(inverse, jacobian[:, :, along])
        miss[:, free] = -np.matvec(inverse, gaps)
        w = linkage.velocities(vectors, rates)
        B, _ = inertia(self.mechanism, placed, w, w)
        return Moving(values, rates, w, placed), np.sqrt(B), miss

    def _run(self, driven: int, q: float, dq: float) -> None:
        along = driven
        values = self._closed(exactly([0.0]), exactly([q]), driven).values
        moving, size, _ = self._moving(values, driven)
        p = size[0] * dq
        targets = [*knots(self._parts, self.until), exact(self.until)]
        sides: Sides = None
        flipped: int | None = None
        length = targets[0] / 16
        while targets:
            # where another variable moves faster, it is the coordinate from here on
            rates = floats(moving.rates[0])
            best = int(np.argmax(np.abs(rates)))
            if abs(rates[best]) > PREFERRED:
                along, p = best, p if rates[best] > 0.0 else -p
            left = (targets[0] - self.end).mid()
            length = min(length, left)
            step: _Step | None = None
            while step is None or step.error > ACCEPTED:
                if float(length) < min(SHORTEST * self.until, float(left)):
                    raise EngineError(
                        f"{self.mechanism.name}: no step of the reference is short enough "
                        f"at {float(self.end):.6g} s; smooth the loads"
                    )
                step = self._picard(values[0, along], p, along, length, sides)
                length = (length / 2).mid()
            x, switch, at_once = min(
                self._roots(step),
                key=lambda root: float(root[0]),
                default=(exact(1.0), None, False),
            )
            if at_once and switch == flipped:
                self.kind = "sticking"
                break
            self._steps.append(step)
            (c,), (p,) = step.reached(np.array([x]))
            self._largest = max(self._largest, abs(float(p)))
            whole = switch is None and step.length is left
            there = (step.start + step.length * (x + 1) / 2).mid()
            self.end = targets.pop(0) if whole else there
            values = self._closed(np.array([self.end]), c, along).values
            moving, *_ = self._moving(values, along)
            sides, flipped = step.sides.copy(), switch
            if switch == -1:
                self.kind = "joint_limit"
                break
            if switch is not None:
                sides[switch] = -sides[switch]
                self.switches.append(self.end)
            costly = step.sweeps > FEW or step.error > 1.0
            length = (step.length * (0.8 if costly else LONGER)).mid()
        if not self._steps:
            raise EngineError(f"{self.mechanism.name}: the motion ends where it starts")

    def _picard(
        self, c: Ball, p: Ball, along: int, length: Ball, sides: Sides
    ) -> _Step | None:
        """Return a step of a length, None where the iteration does not end."""
        half = length / 2
        t, inside = self.end + half * (self._nodes + 1), float(self.end + half)
        values, rates = map(exactly, self._guess(floats(t)))
        speed = rates[:, along]
        here = values[:, along] = middles(c + half * (self._integrals @ speed))
        push: Array | None = None
        last = np.inf
        for sweep in range(1, SWEEPS + 1):
            moving, size, miss = self._moving(values, along)
            push = size * speed if push is None else push
            speed = push / size
            if sides is None:
                _, seen = self._force(moving, speed, t, None, inside)
                sides = np.array([np.sign(float(x[0])) or 1.0 for x in seen])
            load, conditions = self._force(moving, speed, t, sides, inside)
            drive = load / size
            there = middles(c + half * (self._integrals @ speed))
            pushed = middles(p + half * (self._integrals @ drive))
            values = middles(values + miss + moving.rates * (there - here)[:, None])
            values[:, along] = there
            scale = max(self._largest, _size(pushed), abs(float(p))) or 1.0
            moved = _size(there - here), _size(miss), _size(pushed - push) / scale
            change = max(moved) / self.arithmetic.eps
            here, push = there, pushed
            if not np.isfinite(change):
                return None
            if change <= CHANGED or (sweep >= SURE and last / 2 <= change <= SETTLED):
                rates = self._series @ np.stack([speed, drive], axis=1)
                way = half * _integral(rates)
                way[0] += np.array([c, p])
                terms = max(_size(rates[-2:, 0]), _size(rates[-2:, 1]) / scale)
                error = float(half) / (2 * self._count) / self.arithmetic.eps * terms
                signed = self._signed(conditions, sides, values)
                return _Step(self.end, length, along, way, sides, signed, error, sweep)
            last = change
        return None

    def _signed(
        self, conditions: Sequence[Array], sides: Floats, values: Array
    ) -> list[tuple[int, Array]]:
        """Return the series of conditions and joint limits, positive where they hold."""
        held = zip(conditions, sides, strict=True)
        signed = list(enumerate(x * (side * np.ones(self._count)) for x, side in held))
        for stop in self.mechanism.joint_limits:
            value = values[:, self.mechanism.angles[stop.pair]]
            signed += [(-1, value - stop.low), (-1, stop.high - value)]
        return [(number, self._series @ value) for number, value in signed]

    def _roots(self, step: _Step) -> Iterator[tuple[Ball, int, bool]]:
        """Yield where in a step conditions first turn: place, switch, whether at once."""
        for switch, condition in step.signed:
            beyond = _value(floats(condition), self._grid[1:]) < 0.0
            if not np.any(beyond):
                continue
            first = np.argmax(beyond)
            low, high = exactly(self._grid[first : first + 2])
            for _ in range(int(3.4 * self.arithmetic.digits) + 8):
                middle = (low + high).mid() / 2
                if _value(condition, np.array([middle]))[0].mid() < 0:
                    high = middle
                else:
                    low = middle
            yield high, switch, first == 0


def _size(balls: Any) -> float:
    return np.max(np.abs(floats(balls)), initial=0.0)
