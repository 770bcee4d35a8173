"""Signs of pole directions, continuous along each assembly mode from block to block."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from spherekit.arrays import Array, Bools, Floats, Indices
from spherekit.geometry.vectors import all_finite
from spherekit.numerics.hermite import cubic_hermite
from spherekit.planning.pole_plan import Pole
from spherekit.positions.motion import Motion
from spherekit.velocities.pole_field import PoleField, axis_pairs
from spherekit.velocities.pole_request import Request


def dot(a: Floats, b: Floats) -> Floats:
    """Return a . b (..., n) for arrays (..., 3, n)."""
    return np.einsum("...in,...in->...n", a, b)


def norm(a: Floats) -> Floats:
    """Return |a| (..., n) for arrays (..., 3, n)."""
    return np.sqrt(dot(a, a))


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
    path = cubic_hermite(start, stop, h, t)
    # Rounding must not decide which way what is nearly zero at an end points there.
    path[:, 0], path[:, -1] = start[0][:, 0], stop[0][:, 0]
    turns = np.sum(path[:, 1:] * path[:, :-1], axis=0)
    flips[gap] = (-1.0) ** np.sum(turns < 0.0, axis=0)
    return flips
