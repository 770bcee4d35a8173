"""Which poles a set of wanted directions and coefficients needs.

Signs of pole directions: continuous along each assembly mode, block after block.

Poles of a motion in which one input moves, in rows.
"""

from collections.abc import Callable, Iterable, Mapping, MutableMapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Literal

import numpy as np

from spherekit.arrays import Array, Bools, Floats, Indices, SmallIntegers
from spherekit.model.mechanism import Mechanism
from spherekit.motion.motion import Motion
from spherekit.numeric.zeros import ArrayRows, cubic
from spherekit.planning.plan import (
    plan,
    prune,
)
from spherekit.planning.poles import (
    Plan,
    Pole,
    PrimaryPole,
    pole_of,
)
from spherekit.sphere.rotation import all_finite


def cross(a: Floats, b: Floats) -> Floats:
    """Return a x b for arrays (..., 3, n)."""
    return np.cross(a, b, axis=-2)


def dot(a: Floats, b: Floats) -> Floats:
    """Return a . b (..., n) for arrays (..., 3, n)."""
    return np.einsum("...in,...in->...n", a, b)


def norm(a: Floats) -> Floats:
    """Return |a| (..., n) for arrays (..., 3, n)."""
    return np.sqrt(dot(a, a))


Route = Literal["best", "first", "conditioned", "equations"]

ROUTES: dict[Route, str] = {
    "best": "velocity equations of the whole mechanism, in more digits where doubtful",
    "first": "first two great circles of the plan",
    "conditioned": "two best great circles",
    "equations": "velocity equations of the whole mechanism",
}
"""Those of the sequence give a status where it is ill-conditioned."""


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


class ByIdentity:
    """A mechanism as a cache key: the same object, not an equal one."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism

    def __hash__(self) -> int:
        return id(self.mechanism)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ByIdentity) and other.mechanism is self.mechanism


@lru_cache
def _whole_plan(of: ByIdentity, driven: str, by_rank: bool) -> Plan:
    return plan(of.mechanism, None, driven, by_rank)


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
    each w follows from the two poles of its body with those of the input.
    `links` are those whose angular velocity is wanted. `by_rank` is that of
    `spherekit.planning.poles.plan`.
    """
    whole = _whole_plan(ByIdentity(mechanism), driven, by_rank)
    a, b = whole.ends[whole.input]
    circles = frozenset(pole_of(*pole) for pole in planes)
    wanted = [*(pole_of(*pole) for pole in poles), *sorted(circles)]
    turned = frozenset(links)
    to_ground = [pole_of(0, link) for link in sorted(turned - {0})]
    coefficients = [*(pole_of(*pole) for pole in rates), *to_ground]
    bodies = {0, a, b} | {whole.body[link] for pole in coefficients for link in pole}
    needed = {whole.pole(*pole) for pole in (*wanted, *coefficients, (a, b))}
    for body in bodies - {a, b}:
        needed |= {pole_of(a, body), pole_of(b, body)}
    pruned = prune(whole, sorted(pole for pole in needed if pole is not None))
    every = tuple(dict.fromkeys([*wanted, *coefficients]))
    return Request(pruned, every, tuple(sorted(bodies)), derivatives, circles, turned)


TURN_KNOWN = 1e-6
"""Relative error to which the derivative of an axis is known where it is given."""


def axis_pairs(plan: Plan) -> dict[Pole, int]:
    """Return the poles of bodies that are the axis or contact line of a pair, and those."""
    return {step.pole: step.pair for step in plan.steps if isinstance(step, PrimaryPole)}


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
    derivatives. `direction_dq[pole]` (n, 3) is how directions
    turn by the input, 1/rad, and `direction_dq_error[pole]` (n,) a bound of its error.
    `loss` (n,): the part of the largest of them, or of 1, that may be wrong.
    `status` (n,): the motion's, with AT_SINGULARITY where the rates are
    not finite. `pole_status[pole]` (n,): the same, with NO_POLE or ILL_CONDITIONED
    where only this pole cannot be given. `by_equations` (n,): samples solved from the
    velocity equations instead; `by_kernel` (n,): rows that a kernel vouches for;
    `by_decimals` (n,): rows of the decimal sizes of the file, beside a dead centre.
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
    status: SmallIntegers
    pole_status: MutableMapping[Pole, SmallIntegers] = field(default_factory=dict)
    by_equations: Bools
    by_kernel: Bools
    by_decimals: Bools
    loss: Floats
    direction_dq: MutableMapping[Pole, Floats] = field(default_factory=dict)
    direction_dq_error: MutableMapping[Pole, Floats] = field(default_factory=dict)

    @property
    def made(self) -> "PoleField":
        """All of it, as arrays: itself."""
        return self


Path = Floats
"""(8,) or (8, k) what a direction follows: the way, the sense of the input, w and dw."""


class SignContinuation:
    """What earlier blocks of a motion found, so that signs continue.

    The last direction and rates of each pole, and the side that directions start on.
    """

    def __init__(self) -> None:
        self.last: dict[tuple[int, ...], tuple[Path, float]] = {}
        self.home: dict[int, Floats] = {}

    def state(self) -> dict[str, Any]:
        """Return what is remembered, ready for JSON, bit for bit."""
        return {
            "home": [[mode, side.tolist()] for mode, side in self.home.items()],
            "last": [
                [*key, path.tolist(), sign] for key, (path, sign) in self.last.items()
            ],
        }

    @classmethod
    def restored(cls, state: Mapping[str, Any]) -> "SignContinuation":
        """Return the memory that `state` gave."""
        memory = cls()
        memory.home = {mode: np.array(side) for mode, side in state["home"]}
        for *key, path, sign in state["last"]:
            memory.last[tuple(key)] = np.array(path), sign
        return memory


def signed(
    field: PoleField, motion: Motion, wanted: Request, memory: SignContinuation
) -> None:
    """Give directions, and coefficients along them, the signs that continue; in place.

    A direction follows the relative angular velocity along it, so its coefficient keeps
    its sign until that passes through zero; where it does is read off the Hermite path
    between two samples. At the first sample it points to the side where the sum of all
    axes and contacts lies. Over a grid of inputs it points to that side throughout.

    At a dead centre of the input the angular velocity, which is per unit rate of the input,
    reverses through infinity, and only its product with the sense of the input is
    continuous. Where it is not finite the direction follows its neighbour.
    """
    without, n = {None, *axis_pairs(wanted.plan)}, len(motion)
    poles = [pole for pole in wanted.poles if wanted.plan.pole(*pole) not in without]
    if not (poles and motion.assembly_modes and n):
        return
    sense = np.ones(n) if motion.sense is None else motion.sense
    unit = np.array([field.direction[pole].T for pole in poles])
    v, dv = (
        np.array([(rates[j] - rates[i]).T for i, j in poles])
        for rates in (field.w, field.dw)
    )
    rate, e_rate, e_change = (
        np.array([part[pole] for pole in poles])
        for part in (
            field.velocity_coefficient,
            field.velocity_coefficient_error,
            field.acceleration_coefficient_error,
        )
    )
    # Which way links turn that rest throughout is rounding: the axis itself goes on.
    rests = (norm(v) <= e_rate) & (norm(dv) <= e_change)
    ahead = np.where((rate * sense < 0.0) & ~rests, -1.0, 1.0)
    moved = [np.where(rests[:, None], *x) for x in ((unit, sense * v), (0.0, sense * dv))]
    paths = np.swapaxes([ahead[:, None] * unit, *moved], 1, 2)
    held = ~motion.failed.reshape(-1, motion.samples)
    if motion.is_path:
        stops: dict[int, Stops] = {}
        for number, row in enumerate(held):
            some = np.flatnonzero(row) + number * motion.samples
            if len(some):
                stops[number] = some, np.ones(len(some) - 1, dtype=bool)
        turned = signs_at_stops(motion, poles, stops, lambda some: paths[..., some], memory)
    else:
        turned = sides_of(motion, held, memory)
    rows = np.arange(n)
    signs = ahead * turned(paths[0], rows, rows // motion.samples)
    for pole, of_pole in zip(poles, signs, strict=True):
        turn_round(field, pole, of_pole)


SIGNED = {
    "direction": 3,
    "direction_dq": 3,
    "velocity_coefficient": 1,
    "acceleration_coefficient": 1,
}
"""What of a pole turns round with its direction, and how many components it has."""


def turn_round(field: PoleField, pole: Pole, signs: Floats) -> None:
    """Turn a pole round at some rows, in place."""
    for name in SIGNED:
        part = getattr(field, name)[pole].T
        part *= signs


Stops = tuple[Indices, Bools]
"""Rows (k,) of one assembly mode where directions are looked at, rising, and from which of
them (k - 1,) to the next a direction may reverse."""

Turning = Callable[[Floats, Any, Any], Array]
"""Gives -1 (poles, k) where directions (3, poles, k) are turned round, else 1, at rows (k,)
of modes by their place, of one or (k,)."""


def to_sides(sides: Floats) -> Turning:
    """Return what turns directions to the sides (modes, 3)."""

    def signs(unit: Floats, rows: Any, modes: Any) -> Floats:
        a, b, c = np.atleast_2d(sides[modes]).T
        return np.where(a * unit[0] + b * unit[1] + c * unit[2] < 0.0, -1.0, 1.0)

    return signs


def signs_at_stops(
    motion: Motion,
    signed: Sequence[Pole],
    stops: Mapping[int, Stops],
    at: Callable[[Indices], Iterable[Floats]],
    memory: SignContinuation,
) -> Turning:
    """Return which directions are turned round to go on along each assembly mode.

    Of the poles `signed`, whose rates are not negative before. `stops` are those of modes
    by their place; `at` gives directions, relative angular velocities and their
    derivatives (3, poles, k) at rows by their numbers, times the sense of the input.
    """
    made = np.ones((len(signed), len(motion)), dtype=np.int8)
    if not signed or not stops:
        return lambda unit, rows, modes: made[:, rows]
    units, vectors, changes = at(np.concatenate([rows for rows, _ in stops.values()]))
    several = motion.inputs.shape[1] > 1
    if several:
        changes = np.zeros_like(vectors)  # by the way of all inputs it is not known
    ways = motion.sample.astype(float) if several else motion.inputs[:, 0]
    is_good = all_finite(units, 0)
    is_moved = is_good & all_finite(vectors, 0) & np.any(vectors, axis=0)
    first = 0
    for number, (rows, linked) in stops.items():
        mode, some = motion.assembly_modes[number], slice(first, first + len(rows))
        first, end = some.stop, (number + 1) * motion.samples
        sense = np.ones(len(rows)) if motion.sense is None else motion.sense[rows]
        since = np.append(0, np.cumsum(linked))
        for j, pole in enumerate(signed):
            good = np.flatnonzero(is_moved[j, some])
            if not len(good):
                continue
            unit, key, side = units[:, j, some], (mode.number, *pole), 1.0
            if key not in memory.last:
                home = _home(motion, mode.number, int(rows[good[0]]), memory)
                side = -1.0 if home @ unit[:, good[0]] < 0.0 else 1.0
            parts = ways[rows][None], sense[None], vectors[:, j, some], changes[:, j, some]
            path = np.concatenate(parts)[:, good]
            chain = _chain(memory, key, side, path, since[good[1:]] > since[good[:-1]])
            often = np.diff(good, prepend=0, append=len(rows))
            signs = np.repeat(np.append(1.0, chain), often)
            for k in np.flatnonzero(is_good[j, some] & ~is_moved[j, some]):
                near = good[np.argmin(np.abs(rows[good] - rows[k]))]
                signs[k] = -1.0 if signs[near] * unit[:, near] @ unit[:, k] < 0.0 else 1.0
            made[j, rows[0] : end] = np.repeat(signs, np.diff(rows, append=end))
    return lambda unit, rows, modes: made[:, rows]


def sides_of(motion: Motion, held: Bools, memory: SignContinuation) -> Turning:
    """Return that directions are turned to the side that modes start on.

    `held` (modes, samples) says which rows have a configuration.
    """
    sides = np.zeros((len(motion.assembly_modes), 3))
    for number, (mode, some) in enumerate(zip(motion.assembly_modes, held, strict=False)):
        if np.any(some):
            first = number * motion.samples + int(np.argmax(some))
            sides[number] = _home(motion, mode.number, first, memory)
    return to_sides(sides)


def _home(motion: Motion, mode: int, row: int, memory: SignContinuation) -> Floats:
    """Return the side (3,) on which directions of a mode start, read at its first row."""
    if mode not in memory.home:
        (frames,) = motion.rows(np.array([row])).frames
        memory.home[mode] = np.sum(frames[:, :, 2], axis=0)
    return memory.home[mode]


SUBSTEPS = 8


def _chain(
    memory: SignContinuation,
    key: tuple[int, ...],
    side: float,
    path: Path,
    linked: Bools,
) -> Floats:
    """Return the signs (k,) that go on along a path, and keep where it ends.

    From the last sign in memory, or the `side` that it starts on. It may reverse only
    where it is `linked` (k - 1,).
    """
    flips = np.where(linked, _flips(path) if np.any(linked) else 1.0, 1.0)
    if key in memory.last:
        last, side = memory.last[key]
        if last[2:5] @ path[2:5, 0] < 0.0:
            side *= float(_flips(np.column_stack([last, path[:, 0]]))[0])
    chain = np.cumprod(np.append(side, flips))
    memory.last[key] = path[:, -1].copy(), float(chain[-1])
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
    h = np.where(sense[1:] == sense[:-1], np.diff(q), 0.0)[gap]
    t = np.linspace(0.0, 1.0, SUBSTEPS + 1)[:, None]
    start, stop = (
        (v[:, None, end], np.nan_to_num(dv[:, None, end])) for end in (gap, gap + 1)
    )
    path = cubic(start, stop, h, t)
    # Rounding must not decide which way what is nearly zero at an end points there.
    path[:, 0], path[:, -1] = start[0][:, 0], stop[0][:, 0]
    turns = np.sum(path[:, 1:] * path[:, :-1], axis=0)
    flips[gap] = (-1.0) ** np.sum(turns < 0.0, axis=0)
    return flips
