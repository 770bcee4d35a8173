"""Signs of pole directions: continuous along each assembly mode, block after block."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, dataclass
from typing import Any, final

import numpy as np

from spherekit.motion.motion import Motion
from spherekit.numeric.hermite import cubic
from spherekit.planning.poles import Pole
from spherekit.rates.columns import PoleColumns, RateColumns
from spherekit.rates.pole_field import PoleField
from spherekit.rates.request import Request
from spherekit.rates.turning import axis_pairs
from spherekit.rates.vectors import dot
from spherekit.sphere.rotation import Floats


@final
@dataclass(frozen=True)
class _Last:
    """The last row of a pole: the way (1,), its sense (1,), w and dw (3, 1), the sign."""

    way: Floats
    sense: Floats
    w: Floats
    dw: Floats
    sign: float


@final
class SignMemory:
    """What earlier blocks of a motion found, so that signs continue.

    The last direction and rates of each pole, and the side that directions start on.
    """

    def __init__(self) -> None:
        self.last: dict[tuple[int, Pole], _Last] = {}
        self.home: dict[int, Floats] = {}

    def state(self) -> dict[str, Any]:
        """Return what is remembered, ready for JSON, bit for bit."""
        return {
            "home": [
                [assembly_mode, side.tolist()] for assembly_mode, side in self.home.items()
            ],
            "last": [
                [assembly_mode, *pole, *(np.ravel(part).tolist() for part in astuple(last))]
                for (assembly_mode, pole), last in self.last.items()
            ],
        }

    @classmethod
    def restored(cls, state: Mapping[str, Any]) -> "SignMemory":
        """Return the memory that `state` gave."""
        memory = cls()
        memory.home = {
            assembly_mode: np.array(side) for assembly_mode, side in state["home"]
        }
        for assembly_mode, low, high, way, sense, w, dw, sign in state["last"]:
            memory.last[assembly_mode, (low, high)] = _Last(
                np.array(way),
                np.array(sense),
                np.array(w)[:, None],
                np.array(dw)[:, None],
                *sign,
            )
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


def steady_signs(
    motion: Motion,
    signed: Sequence[Pole],
    at: Callable[[Sequence[int]], Floats],
    memory: SignMemory,
) -> Floats:
    """Return (modes, poles) one sign for each mode in which directions do not reverse.

    Of the poles `signed`: each is turned by it to go on from the block before; `at` gives
    what has a sign of theirs (8, poles, k) at rows by their numbers. Rows that hold nothing
    do not count.
    """
    signs = np.ones((len(motion.assembly_modes), len(signed)))
    samples, good, sense = motion.samples, ~motion.failed, np.ones(1)
    rows: list[int] = []
    going_on = []
    for number in range(len(signs)):
        held = good[number * samples : (number + 1) * samples]
        if np.any(held) and len(signed):
            ends = int(np.argmax(held)), samples - 1 - int(np.argmax(held[::-1]))
            rows += [number * samples + end for end in ends]
            going_on.append(number)
    if not rows:
        return signs
    parts = at(rows)
    vectors, changes = _relative(motion, parts)
    for k, number in enumerate(going_on):
        mode, (first, last) = motion.assembly_modes[number], rows[2 * k : 2 * k + 2]
        (v, v_end), (dv, dv_end) = vectors[2 * k : 2 * k + 2], changes[2 * k : 2 * k + 2]
        before = [memory.last.get((mode.number, pole)) for pole in signed]
        new = [j for j, item in enumerate(before) if item is None]
        going = np.ones(len(signed))
        if new:
            home = _home(motion, mode.number, first, memory)
            going[new] = np.where(home @ v[:, new] < 0.0, -1.0, 1.0)
        for j, item in enumerate(before):
            if item is None:
                continue
            going[j] = item.sign
            if item.w[:, 0] @ v[:, j] < 0.0:
                flip = _flips(
                    np.append(item.way, _way(motion, first)),
                    np.append(item.sense, sense),
                    np.column_stack([item.w, v[:, j]]),
                    np.column_stack([item.dw, dv[:, j]]),
                )
                going[j] *= float(flip[0])
        way = _way(motion, last)
        for j, pole in enumerate(signed):
            at_end = v_end[:, j : j + 1], dv_end[:, j : j + 1]
            memory.last[mode.number, pole] = _Last(way, sense, *at_end, float(going[j]))
        signs[number] = np.where(parts[6, :, 2 * k] < 0.0, -going, going)
    return signs


def _way(motion: Motion, row: int) -> Floats:
    """Return (1,) how far a row is: its input, or of several the number of its sample."""
    single = motion.inputs.shape[1] == 1
    return motion.q[[row]] if single else motion.sample[[row]].astype(float)


def _relative(motion: Motion, parts: Floats) -> tuple[Floats, Floats]:
    """Return (rows, 3, poles) relative angular velocities, and derivatives by the way."""
    parts = np.moveaxis(parts, 2, 0)
    unit, turn, rate, change = parts[:, :3], parts[:, 3:6], parts[:, 6:7], parts[:, 7:8]
    v = rate * unit
    single = motion.inputs.shape[1] == 1
    return v, change * unit + rate * turn if single else np.zeros_like(v)


def turn_round(columns: RateColumns, signs: Floats) -> None:
    """Reverse directions in the assembly modes where their sign (modes, poles) is -1."""
    samples = columns.with_sign.shape[2] // len(signs)
    for number, pole in zip(*np.nonzero(signs < 0.0), strict=True):
        turned = columns.with_sign[:, pole, number * samples : (number + 1) * samples]
        np.negative(turned, out=turned)


def turn_each(columns: PoleColumns, signs: Floats) -> None:
    """Give a pole's direction a sign (n,) in each row, in place."""
    for values in columns.with_sign:
        values *= signs


def sided_signs(motion: Motion, unit: Floats, memory: SignMemory) -> Floats:
    """Return (n,) the signs that turn directions (3, n) to the side that modes start on."""
    signs, finite = np.ones(unit.shape[1]), np.isfinite(unit[0])
    for number, mode in enumerate(motion.assembly_modes):
        rows = slice(number * motion.samples, (number + 1) * motion.samples)
        if np.any(finite[rows]):
            first = rows.start + int(np.argmax(finite[rows]))
            home = _home(motion, mode.number, first, memory)
            signs[rows] = np.where(home @ unit[:, rows] < 0.0, -1.0, 1.0)
    return signs


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
        key = (assembly_mode.number, pole)
        if key in memory.last:
            last = memory.last[key]
            first = _flips(
                np.append(last.way, t[:1]),
                np.append(last.sense, here[:1]),
                np.column_stack([last.w, v[:, :1]]),
                np.column_stack([last.dw, dv[:, :1]]),
            )
            chain = last.sign * np.cumprod(np.append(first, _flips(t, here, v, dv)))
        else:
            side = -1.0 if u[:, 0] @ home * along[0] < 0.0 else 1.0
            chain = np.cumprod(np.append(side, _flips(t, here, v, dv)))
        signs[rows.start + good] = chain * along
        way_here, sense_here, w_here, dw_here = (
            array[..., -1:].copy() for array in (t, here, v, dv)
        )
        memory.last[key] = _Last(way_here, sense_here, w_here, dw_here, float(chain[-1]))
        if len(good) == len(moved):
            continue
        for row in np.flatnonzero(finite & ~moved):
            near = rows.start + good[np.argmin(np.abs(good - row))]
            beside = signs[near] * unit[:, near] @ unit[:, rows.start + row]
            signs[rows.start + row] = -1.0 if beside < 0.0 else 1.0
    return signs


def _flips(q: Floats, sense: Floats, v: Floats, dv: Floats) -> Floats:
    """Return +1 or -1 for each gap (k - 1,): whether v (3, k) reverses in between.

    On a Hermite path, or a straight one where the sense changes and slopes are useless.
    """
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
