"""Which poles a set of wanted directions and coefficients needs.

Signs of pole directions: continuous along each assembly mode, block after block.

Poles of a motion in which one input moves, in rows.
"""

from collections.abc import Callable, Iterable, Mapping, MutableMapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Literal, final

import numpy as np
from numpy.typing import NDArray

from spherekit.model.mechanism import Mechanism
from spherekit.motion.motion import Motion
from spherekit.numeric.zeros import ArrayRows, cubic
from spherekit.planning.plan import (
    plan,
    prune,
)
from spherekit.planning.poles import (
    BlockPoles,
    CoaxialPole,
    Plan,
    Pole,
    PrimaryPole,
    pole_of,
)
from spherekit.rates.core import dot
from spherekit.sphere.rotation import Floats

Route = Literal["best", "first", "conditioned", "equations"]

ROUTES: dict[Route, str] = {
    "best": "two best great circles, velocity equations where these are doubtful",
    "first": "first two great circles of the plan",
    "conditioned": "two best great circles",
    "equations": "velocity equations of the whole mechanism",
}
"""Only ``best`` changes over to another source; the others give a status instead."""


@final
@dataclass(frozen=True)
class Request:
    """The plan behind wanted poles and coefficients, and the links whose rates it gives.

    `poles` are the wanted ones, by links; `bodies` are the bodies of the plan whose
    angular velocity is found, the ground and the two of the input among them. `planes`
    are the poles whose great circles are wanted as well, `links` those whose angular
    velocities are.
    """

    plan: Plan
    poles: tuple[Pole, ...]
    bodies: tuple[int, ...]
    derivatives: bool
    planes: frozenset[Pole] = frozenset()
    links: frozenset[int] = frozenset()


@lru_cache(maxsize=64)
def _whole_plan(mechanism_key: "_ByIdentity", driven: str, by_rank: bool) -> Plan:
    return plan(mechanism_key.mechanism, None, driven, by_rank)


class _ByIdentity:
    """A mechanism as a cache key: the same object, not an equal one."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism

    def __hash__(self) -> int:
        return id(self.mechanism)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _ByIdentity) and other.mechanism is self.mechanism


def request(
    mechanism: Mechanism,
    driven: str,
    poles: Iterable[Pole],
    rates: Iterable[Pole] = (),
    derivatives: bool = True,
    planes: Iterable[Pole] = (),
    by_rank: bool = False,
    links: Iterable[int] = (),
) -> Request:
    """Return what must be planned for these poles and velocity coefficients.

    `driven` is the input that moves; others stand still, and poles of links that they
    join are left out. The coefficient of links (i, j) is the component of w_j - w_i;
    each w follows from the two poles of its body with those of the input. Derivatives
    in ground axes also need the rate of one body at each pair whose axis the plan uses.
    `links` are those whose angular velocity is wanted. `by_rank` is that of
    `spherekit.planning.poles.plan`.
    """
    whole = _whole_plan(_ByIdentity(mechanism), driven, by_rank)
    a, b = whole.ends[whole.input]
    circles = frozenset(pole_of(*pole) for pole in planes)
    wanted = tuple(dict.fromkeys([*(pole_of(*pole) for pole in poles), *sorted(circles)]))
    turned = frozenset(links)
    to_ground = [pole_of(0, link) for link in sorted(turned - {0})]
    coefficients = list(dict.fromkeys([*(pole_of(*pole) for pole in rates), *to_ground]))
    bodies = {a, b} | {whole.body[link] for pole in coefficients for link in pole}
    if derivatives:
        bodies.add(0)
    while True:
        needed = {whole.pole(*pole) for pole in (*wanted, *coefficients, (a, b))}
        for body in bodies - {a, b}:
            needed |= {pole_of(a, body), pole_of(b, body)}
        pruned = prune(whole, sorted(pole for pole in needed if pole is not None))
        more = _moving_bodies(pruned) - bodies if derivatives else set()
        if not more:
            everything = tuple(dict.fromkeys((*wanted, *coefficients)))
            body_numbers = tuple(sorted(bodies))
            return Request(pruned, everything, body_numbers, derivatives, circles, turned)
        bodies |= more


def _moving_bodies(planned: Plan) -> set[int]:
    """The bodies whose rates tell how the axes used by a plan move.

    The axis of an R pair is fixed in its first link; a contact moves along the profiles
    of both.
    """
    mechanism = planned.mechanism
    used: set[int] = set()
    for step in planned.steps:
        if isinstance(step, PrimaryPole | CoaxialPole):
            used.add(step.pair)
        elif isinstance(step, BlockPoles):
            used |= set(step.pairs)
        else:
            used |= set(step.contacts)
    bodies: set[int] = set()
    for pair in used:
        carriers = mechanism.pairs[pair].kind.carriers
        bodies |= set(planned.ends[pair][:carriers])
    return bodies


TURN_KNOWN = 1e-6
"""Relative error to which the derivative of an axis is known where it is given."""


def axis_pairs(plan: Plan) -> dict[Pole, int]:
    """Return the poles of bodies that are the axis or contact line of a pair, and those."""
    return {
        step.pole: step.pair
        for step in plan.steps
        if isinstance(step, PrimaryPole | CoaxialPole)
    }


def carrier(plan: Plan, pole: Pole) -> int | None:
    """Return the link that carries a pole's axis, None if none does."""
    body_pole = plan.pole(*pole)
    pair = None if body_pole is None else axis_pairs(plan).get(body_pole)
    if pair is None or not plan.mechanism.pairs[pair].kind.has_axis:
        return None
    return plan.mechanism.ends[pair][0]


def carried_turn(unit: Floats, w: Floats) -> Floats:
    """Return (n, 3) the derivative of an axis (n, 3) that a link at w (n, 3) carries."""
    return np.cross(w, unit)


def turn_along(
    unit: Floats,
    dv: Floats,
    coefficients: tuple[Floats, Floats],
    errors: tuple[Floats, Floats],
) -> Floats:
    """Return (n, 3) the derivative of a direction (n, 3), from v = r u.

    `dv` (n, 3) is the derivative of v, `coefficients` (n,) are r and its derivative, with
    the bounds of their `errors`. NaN where r is too small to know it to `TURN_KNOWN`.
    """
    rate, change = coefficients
    with np.errstate(divide="ignore", invalid="ignore"):
        turns = np.asarray((dv - change[:, None] * unit) / rate[:, None])
        size = np.maximum(1.0, np.sqrt(np.sum(turns * turns, axis=1)))
        sure = size * errors[0] + errors[1] < TURN_KNOWN * size * np.abs(rate)
    turns[~sure] = np.nan
    return turns


@final
@dataclass(frozen=True, kw_only=True)
class PoleField(ArrayRows):
    """Requested poles of a motion in which one input moves; rows as in the motion.

    NaN where the motion failed. Derivatives are by that input, the others held.

    `direction[pole]` (n, 3) unit vector in ground axes, continuous along each assembly
    mode and at its first sample on the side of the mechanism's axes (of a pair: its
    axis); `rate[pole]` (n,): rate * direction is the angular velocity of the pole's
    second link relative to its first per unit rate of the input;
    `acceleration_coefficient[pole]` (n,) its derivative by the input (1/rad);
    `angle[pole]` (n,) how far the angular velocities of its links are from cancelling:
    |w_j - w_i| over |w_i| + |w_j|, 1 for the axes of pairs. `error[pole]` (n,) bound of
    the direction's error (rad), `velocity_coefficient_error[pole]` and
    `acceleration_coefficient_error[pole]` (n,) those of the two coefficients: of
    rounding, and of what the configuration is off by. `planes[pole]` (n, 2, 3) unit
    normals of those planes, for the poles asked for. `w[link]`, `dw[link]` (n, 3):
    rates of links relative to the ground, per unit rate of the input, and their
    derivatives. `direction_dq[pole]` (n, 3) is how directions turn, of the poles of
    which a kernel says it. `loss` (n,): the part of the largest of them, or of 1, that
    may be wrong. `status` (n,): the motion's, with AT_SINGULARITY where the rates are
    not finite. `pole_status[pole]` (n,): the same, with NO_POLE or ILL_CONDITIONED
    where only this pole cannot be given. `by_equations` (n,): samples solved from the
    velocity equations instead; `by_kernel` (n,): rows that a kernel vouches for.
    """

    direction: MutableMapping[Pole, Floats] = field(default_factory=dict)
    velocity_coefficient: MutableMapping[Pole, Floats] = field(default_factory=dict)
    acceleration_coefficient: MutableMapping[Pole, Floats] = field(default_factory=dict)
    angle: MutableMapping[Pole, Floats] = field(default_factory=dict)
    error: MutableMapping[Pole, Floats] = field(default_factory=dict)
    velocity_coefficient_error: MutableMapping[Pole, Floats] = field(default_factory=dict)
    acceleration_coefficient_error: MutableMapping[Pole, Floats] = field(
        default_factory=dict
    )
    planes: MutableMapping[Pole, Floats] = field(default_factory=dict)
    w: MutableMapping[int, Floats] = field(default_factory=dict)
    dw: MutableMapping[int, Floats] = field(default_factory=dict)
    status: NDArray[np.int8]
    pole_status: MutableMapping[Pole, NDArray[np.int8]] = field(default_factory=dict)
    by_equations: NDArray[np.bool_]
    by_kernel: NDArray[np.bool_]
    loss: Floats
    direction_dq: MutableMapping[Pole, Floats] = field(default_factory=dict)

    @property
    def made(self) -> "PoleField":
        """All of it, as arrays: itself."""
        return self

    def turned(self, plan: Plan, pole: Pole) -> Floats:
        """Return (n, 3) how the direction of a pole of links turns by the input, 1/rad.

        From w_j - w_i = r u and its derivative, so NaN where r is too small to know it; of
        the axis of a pair, which its links carry, u' = w x u also where these stand still
        relative to each other.
        """
        if pole in self.direction_dq:
            return self.direction_dq[pole]
        i, j = pole
        unit, link = self.direction[pole], carrier(plan, pole)
        if link is not None and link in self.w:
            return carried_turn(unit, self.w[link])
        return turn_along(
            unit,
            self.dw[j] - self.dw[i],
            (self.velocity_coefficient[pole], self.acceleration_coefficient[pole]),
            (
                self.velocity_coefficient_error[pole],
                self.acceleration_coefficient_error[pole],
            ),
        )


Path = Floats
"""(8, k) what a direction follows: the way, the sense of the input, w and dw."""


@final
class SignMemory:
    """What earlier blocks of a motion found, so that signs continue.

    The last direction and rates of each pole, and the side that directions start on.
    """

    def __init__(self) -> None:
        self.last: dict[tuple[int, Pole], tuple[Path, float]] = {}
        self.home: dict[int, Floats] = {}

    def state(self) -> dict[str, Any]:
        """Return what is remembered, ready for JSON, bit for bit."""
        return {
            "home": [
                [assembly_mode, side.tolist()] for assembly_mode, side in self.home.items()
            ],
            "last": [
                [assembly_mode, *pole, path[:, 0].tolist(), sign]
                for (assembly_mode, pole), (path, sign) in self.last.items()
            ],
        }

    @classmethod
    def restored(cls, state: Mapping[str, Any]) -> "SignMemory":
        """Return the memory that `state` gave."""
        memory = cls()
        memory.home = {
            assembly_mode: np.array(side) for assembly_mode, side in state["home"]
        }
        for assembly_mode, low, high, path, sign in state["last"]:
            memory.last[assembly_mode, (low, high)] = np.array(path)[:, None], sign
        return memory


def signed(
    field: PoleField, motion: Motion, wanted: Request, memory: SignMemory
) -> PoleField:
    """Give directions, and coefficients along them, the signs that continue; in place."""
    pairs = axis_pairs(wanted.plan)
    for pole in wanted.poles:
        body_pole = wanted.plan.pole(*pole)
        if body_pole is None or body_pole in pairs:
            continue
        i, j = pole
        unit, rate = field.direction[pole].T, field.velocity_coefficient[pole]
        has_rates = i in field.w and j in field.w
        v = (field.w[j] - field.w[i]).T if has_rates else None
        dv = (field.dw[j] - field.dw[i]).T if has_rates else None
        signs = continuous_signs(motion, unit, rate, v, dv, pole, memory)
        for values in (unit, rate, field.acceleration_coefficient[pole]):
            values *= signs
    return field


@final
@dataclass(frozen=True)
class Stops:
    """Rows of one assembly mode where directions are looked at.

    `rows` (k,) rise; `linked` (k - 1,) says that a direction may reverse from one of them
    to the next.
    """

    rows: NDArray[np.intp]
    linked: NDArray[np.bool_]


@final
@dataclass(frozen=True)
class TurnedRows:
    """Which directions of an input are turned round: the `pole` from `start` to `stop`.

    All (k,). Over a grid of inputs each row is turned to a side, `sides` (modes, 3).
    """

    pole: NDArray[np.intp]
    start: NDArray[np.intp]
    stop: NDArray[np.intp]
    sides: Floats | None = None

    @classmethod
    def of(
        cls, ranges: Sequence[tuple[int, int, int]], sides: Floats | None = None
    ) -> "TurnedRows":
        """Return those of poles with their rows' starts and stops."""
        pole, start, stop = np.array(ranges, dtype=np.intp).reshape(-1, 3).T
        return cls(pole, start, stop, sides)

    def signs(
        self, k: int, unit: Floats, rows: NDArray[np.intp], modes: NDArray[np.intp]
    ) -> Floats:
        """Return (n,) -1 where pole k, with directions (n, 3), is turned round at rows."""
        if self.sides is not None:
            across = np.sum(self.sides[modes] * unit, axis=1)
            return np.where(across < 0.0, -1.0, 1.0)
        made = np.ones(len(rows))
        for number in np.flatnonzero(self.pole == k).tolist():
            within = (rows >= self.start[number]) & (rows < self.stop[number])
            made[within] *= -1.0
        return made

    def turn(self, with_sign: Floats, mode: int, first: int) -> None:
        """Turn what has a sign (8, poles, n) of rows from `first` on, in place."""
        n = with_sign.shape[2]
        if self.sides is not None:
            across = np.einsum("k,kpn->pn", self.sides[mode], with_sign[:3])
            with_sign *= np.where(across < 0.0, -1.0, 1.0)
            return
        for k in np.flatnonzero((self.start < first + n) & (self.stop > first)).tolist():
            rows = slice(max(0, self.start[k] - first), self.stop[k] - first)
            part = with_sign[:, self.pole[k], rows]
            np.negative(part, out=part)


def signs_at_stops(
    motion: Motion,
    signed: Sequence[Pole],
    stops: Mapping[int, Stops],
    at: Callable[[NDArray[np.intp]], tuple[Floats, Floats, Floats]],
    memory: SignMemory,
) -> TurnedRows:
    """Return which directions are turned round to go on along each assembly mode.

    Of the poles `signed`, whose rates are not negative before. `stops` are those of modes
    by their place; `at` gives directions, relative angular velocities and their
    derivatives (3, poles, k) at rows by their numbers. Signs are those of
    `continuous_signs`.
    """
    ranges: list[tuple[int, int, int]] = []
    if not signed or not stops:
        return TurnedRows.of(ranges)
    units, vectors, changes = at(np.concatenate([item.rows for item in stops.values()]))
    if motion.inputs.shape[1] > 1:
        changes = np.zeros_like(vectors)  # by the way of all inputs it is not known
    is_good = np.all(np.isfinite(units), axis=0)
    is_moved = np.all(np.isfinite(vectors), axis=0) & np.any(vectors != 0.0, axis=0)
    is_moved &= is_good
    first = 0
    for number, item in stops.items():
        mode, rows, here = motion.assembly_modes[number], item.rows, first
        first += len(rows)
        way, end = _way(motion, rows), (number + 1) * motion.samples
        since = np.append(0, np.cumsum(item.linked))
        for j, pole in enumerate(signed):
            some = slice(here, first)
            good = np.flatnonzero(is_moved[j, some])
            if not len(good):
                continue
            unit, key, side = units[:, j, some], (mode.number, pole), 1.0
            if key not in memory.last:
                home = _home(motion, mode.number, int(rows[good[0]]), memory)
                side = -1.0 if home @ unit[:, good[0]] < 0.0 else 1.0
            parts = [way], np.ones((1, len(rows))), vectors[:, j, some], changes[:, j, some]
            path = np.concatenate(parts)[:, good]
            linked = since[good[1:]] > since[good[:-1]]
            chain = _chain(memory, key, side, path, linked)
            if len(good) == len(rows) and not np.any(linked):
                ranges += [(j, int(rows[0]), end)] if chain[0] < 0.0 else []
                continue
            signs = np.repeat(chain, np.diff(good, append=len(rows)))
            signs = np.append(np.ones(good[0]), signs)
            for k in np.flatnonzero(is_good[j, some] & ~is_moved[j, some]):
                near = good[np.argmin(np.abs(rows[good] - rows[k]))]
                signs[k] = -1.0 if signs[near] * unit[:, near] @ unit[:, k] < 0.0 else 1.0
            edges = np.flatnonzero(np.diff(signs < 0.0, prepend=False, append=False))
            bounds = np.append(rows, end)[edges]
            ranges += [(j, *bounds[k : k + 2].tolist()) for k in range(0, len(bounds), 2)]
    return TurnedRows.of(ranges)


def sides_of(motion: Motion, held: NDArray[np.bool_], memory: SignMemory) -> TurnedRows:
    """Return that directions are turned to the side that modes start on.

    `held` (modes, samples) says which rows have a configuration.
    """
    sides = np.zeros((len(motion.assembly_modes), 3))
    for number, mode in enumerate(motion.assembly_modes):
        if np.any(held[number]):
            first = number * motion.samples + int(np.argmax(held[number]))
            sides[number] = _home(motion, mode.number, first, memory)
    return TurnedRows.of([], sides)


def _way(motion: Motion, rows: NDArray[np.intp]) -> Floats:
    """Return (k,) how far rows are: their input, or of several the number of the sample."""
    single = motion.inputs.shape[1] == 1
    return motion.q[rows] if single else motion.sample[rows].astype(float)


def _home(motion: Motion, mode: int, row: int, memory: SignMemory) -> Floats:
    """Return the side (3,) on which directions of a mode start, read at its first row."""
    if mode not in memory.home:
        (frames,) = motion.rows(np.array([row])).frames
        memory.home[mode] = np.sum(frames[:, :, 2], axis=0)
    return memory.home[mode]


SUBSTEPS = 8


def continuous_signs(
    motion: Motion,
    unit: Floats,
    rate: Floats,
    w: Floats | None,
    dw: Floats | None,
    pole: Pole,
    memory: SignMemory,
) -> Floats:
    """Return the signs that make a direction continuous along each assembly mode.

    `w` (3, n) is the relative angular velocity along it, if known, and `dw` its
    derivative. The direction follows w, so its coefficient keeps its sign until w passes
    through zero; where it does is read off the Hermite path between two samples. At the
    first sample it points to the side where the sum of all axes and contacts lies. Over a
    grid of inputs it points to that side throughout.

    At a dead centre of the input w, which is per unit rate of the input, reverses through
    infinity, and only w times the sense of the input is continuous. Where w is not finite
    the direction follows its neighbour.
    """
    single = motion.inputs.shape[1] == 1
    way = motion.q if single else motion.sample.astype(float)
    sense = np.ones(unit.shape[1]) if motion.sense is None else motion.sense
    signs = np.ones(unit.shape[1])
    for number, assembly_mode in enumerate(motion.assembly_modes):
        rows = slice(number * motion.samples, (number + 1) * motion.samples)
        finite = np.all(np.isfinite(unit[:, rows]), axis=0)
        moved = finite if w is None else finite & np.all(np.isfinite(w[:, rows]), axis=0)
        good = np.flatnonzero(moved)
        if not len(good):
            continue
        chosen = slice(None) if len(good) == len(moved) else good
        t = way[rows][chosen]
        u = unit[:, rows][:, chosen]
        if w is not None and dw is not None:
            here = sense[rows][chosen]
            along = np.where(rate[rows][chosen] * here < 0.0, -1.0, 1.0)
            v, dv = w[:, rows][:, chosen], dw[:, rows][:, chosen]
            if motion.sense is not None:
                v, dv = here * v, here * dv
        else:
            here = np.ones(len(t))
            along, v, dv = np.ones(len(t)), u, np.zeros_like(u)
        if not single:
            dv = np.zeros_like(u)  # by the way of all inputs together it is not known
        home = _home(motion, assembly_mode.number, rows.start + int(good[0]), memory)
        if not motion.is_path:
            signs[rows.start + good] = np.where(home @ u < 0.0, -1.0, 1.0)
            continue
        side = -1.0 if u[:, 0] @ home * along[0] < 0.0 else 1.0
        path = np.concatenate([[t], [here], v, dv])
        chain = _chain(memory, (assembly_mode.number, pole), side, path)
        signs[rows.start + good] = chain * along
        if len(good) == len(moved):
            continue
        for row in np.flatnonzero(finite & ~moved):
            near = rows.start + good[np.argmin(np.abs(good - row))]
            beside = signs[near] * unit[:, near] @ unit[:, rows.start + row]
            signs[rows.start + row] = -1.0 if beside < 0.0 else 1.0
    return signs


def _chain(
    memory: SignMemory,
    key: tuple[int, Pole],
    side: float,
    path: Path,
    linked: NDArray[np.bool_] | None = None,
) -> Floats:
    """Return the signs (k,) that go on along a path, and keep where it ends.

    From the last sign in memory, or the `side` that it starts on. It may reverse only
    where it is `linked` (k - 1,), unless that is left out.
    """
    flips = np.ones(path.shape[1] - 1)
    if linked is None or np.any(linked):
        flips = _flips(path)
        if linked is not None:
            flips[~linked] = 1.0
    if key in memory.last:
        last, side = memory.last[key]
        if last[2:5, 0] @ path[2:5, 0] < 0.0:
            side *= float(_flips(np.column_stack([last, path[:, :1]]))[0])
    chain = side * np.concatenate(([1.0], np.cumprod(flips)))
    memory.last[key] = path[:, -1:].copy(), float(chain[-1])
    return chain


def _flips(path: Path) -> Floats:
    """Return +1 or -1 for each gap (k - 1,): whether w reverses in between.

    On a Hermite path, or a straight one where the sense changes and slopes are useless.
    """
    (q, sense), v, dv = path[:2], path[2:5], path[5:]
    flips = np.ones(len(q) - 1)
    gap = np.flatnonzero(dot(v[:, 1:], v[:, :-1]) < 0.0)
    if not len(gap):
        return flips
    h = np.where(sense[1:] == sense[:-1], q[1:] - q[:-1], 0.0)[gap]
    t = np.linspace(0.0, 1.0, SUBSTEPS + 1)[:, None]
    start, stop = (
        (v[:, None, end], np.nan_to_num(dv[:, None, end])) for end in (gap, gap + 1)
    )
    path = cubic(start, stop, h, t)
    # Rounding must not decide which way what is nearly zero at an end points there.
    path[:, 0], path[:, -1] = start[0][:, 0], stop[0][:, 0]
    turns = np.sum(path[:, 1:] * path[:, :-1], axis=0)
    flips[gap] = np.where(np.sum(turns < 0.0, axis=0) % 2 == 1, -1.0, 1.0)
    return flips
