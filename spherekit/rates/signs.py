"""Signs of pole directions: continuous along each assembly mode, block after block."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from spherekit.motion.motion import Motion
from spherekit.numeric.hermite import cubic
from spherekit.planning.poles import Pole
from spherekit.rates.pole_field import (
    PoleField,
    axis_pairs,
)
from spherekit.rates.request import Request
from spherekit.rates.vectors import dot
from spherekit.sphere.rotation import Floats

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
