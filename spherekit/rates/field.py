"""Pole axes and velocity coefficients of a motion, and their exact derivatives.

The primary quantity is the vector w of each link: its angular velocity per unit rate of
the input. A pole's direction is a unit vector along its axis, and the coefficient is the
signed component of w along it.
"""

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import EPS, NO_MOTION, SINGULAR_RATIO, USABLE_DIRECTION, Status
from spherekit.motion.motion import Motion
from spherekit.planning.poles import Pole, PrimaryPole
from spherekit.rates.core import driven_rates
from spherekit.rates.lines import (
    Lines,
    decompose,
    decompose_rate,
    evaluate_line_rates,
    evaluate_lines,
)
from spherekit.rates.request import Request
from spherekit.rates.vectors import dot, norm
from spherekit.sphere.rotation import Floats

TRUSTED_ERROR = 1e-12
"""Samples whose propagated error bound exceeds this use the velocity equations."""


@final
@dataclass(frozen=True)
class PoleField:
    """Requested poles of a motion; rows as in the motion, NaN where it failed.

    `direction[pole]` (n, 3) unit vector in ground axes, continuous along each branch and
    at its first sample on the side of the mechanism's axes (of a pair: its axis);
    `rate[pole]` (n,): rate * direction is the angular velocity of the pole's second
    link relative to its first per unit rate of the input; `rate_dq[pole]` (n,) its
    derivative by the input (1/rad); `angle[pole]` (n,) sine of the angle between the
    two planes used, 0 where they coincide; `error[pole]` (n,) bound of the direction's
    rounding error (rad).
    `planes[pole]` (n, 2, 3) unit normals of those planes, for the poles asked for.
    `w[link]`, `dw[link]` (n, 3): rates of links relative to the ground.
    `status` (n,): the motion's, with AT_SINGULARITY where the rates are not finite.
    `pole_status[pole]` (n,): the same, with NO_POLE or ILL_CONDITIONED where only this
    pole cannot be given.
    `by_equations` (n,): samples solved from the velocity equations instead.
    """

    direction: dict[Pole, Floats]
    rate: dict[Pole, Floats]
    rate_dq: dict[Pole, Floats]
    angle: dict[Pole, Floats]
    error: dict[Pole, Floats]
    planes: dict[Pole, Floats]
    w: dict[int, Floats]
    dw: dict[int, Floats]
    status: NDArray[np.int8]
    pole_status: dict[Pole, NDArray[np.int8]]
    by_equations: NDArray[np.bool_]


@final
class SignMemory:
    """The last direction and rates of each pole, so that blocks join continuously."""

    def __init__(self) -> None:
        self.last: dict[tuple[int, Pole], tuple[Floats, Floats, Floats, float]] = {}


def evaluate(
    motion: Motion, wanted: Request, memory: SignMemory | None = None
) -> PoleField:
    """Return the requested poles and coefficients at every row of a motion.

    Parameters
    ----------
    motion
        Any motion of the request's mechanism.
    wanted
        What to find, from `spherekit.rates.request.request`.
    memory
        Given for successive blocks of one motion, so that signs continue across them.
    """
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        return _evaluate(motion, wanted, memory or SignMemory())


def _evaluate(motion: Motion, wanted: Request, memory: SignMemory) -> PoleField:
    lines = evaluate_lines(wanted.plan, motion, wanted.planes)
    w, doubt = _link_rates(wanted, lines)
    dw = {link: np.full_like(value, np.nan) for link, value in w.items()}
    if wanted.derivatives:
        _add_rates(wanted, lines, motion, w, dw)
    for pole in wanted.poles:
        doubt = np.maximum(doubt, np.nan_to_num(lines.error[pole], nan=1.0))
    status = motion.status.copy()
    weak = (doubt > TRUSTED_ERROR) & ~motion.failed
    flat = np.zeros(len(motion), dtype=bool)
    if np.any(weak):
        exact = driven_rates(motion, weak)
        flat[weak] = ~(exact.flatness >= SINGULAR_RATIO)
        for link in wanted.links:
            w[link][:, weak] = exact.w[:, link].T
            dw[link][:, weak] = exact.dw[:, link].T
        _mend_directions(wanted, lines, w, weak, exact.flatness)
    status[flat & (status == Status.OK)] = Status.AT_SINGULARITY
    no_rate = status != Status.OK
    for vectors in (w, dw):
        for value in vectors.values():
            value[:, no_rate] = np.nan
    field = PoleField({}, {}, {}, {}, {}, {}, {}, {}, status, {}, weak)
    for pole in wanted.poles:
        _add_pole(field, motion, wanted, lines, pole, w, dw, memory)
    for pole, normals in lines.planes.items():
        field.planes[pole] = np.moveaxis(normals, -1, 0)
    for link in wanted.links:
        field.w[link], field.dw[link] = w[link].T, dw[link].T
    return field


def _link_rates(wanted: Request, lines: Lines) -> tuple[dict[int, Floats], Floats]:
    """Return w relative to the ground of each link (3, n), and a bound of their error."""
    plan = wanted.plan
    a, b = plan.mechanism.ends[plan.input]
    driven = lines.unit[(min(a, b), max(a, b))]
    w = {a: np.zeros_like(driven), b: driven.copy()}
    doubt = np.zeros(driven.shape[1])
    for link in wanted.links:
        if link in (a, b):
            continue
        one, other = _toward(a, link), _toward(b, link)
        factor, sine = decompose(driven, lines.unit[one], lines.unit[other])
        w[link] = factor * lines.unit[one]
        doubt = np.maximum(doubt, (lines.error[one] + lines.error[other]) / sine)
    if 0 in w:
        ground = w[0].copy()
        w = {link: value - ground for link, value in w.items()}
    return w, np.nan_to_num(doubt, nan=1.0, posinf=1.0)


def _add_rates(
    wanted: Request,
    lines: Lines,
    motion: Motion,
    w: dict[int, Floats],
    dw: dict[int, Floats],
) -> None:
    plan = wanted.plan
    mechanism = plan.mechanism
    unknown = np.full((len(motion), 3), np.nan)

    def of_ends(which: int) -> Floats:
        ends = [pair[which] for pair in mechanism.ends]
        return np.stack([w[k].T if k in w else unknown for k in ends], axis=1)

    turned = motion.rates_of_pairs(of_ends(0), of_ends(1))
    evaluate_line_rates(plan, lines, motion, turned)
    a, b = mechanism.ends[plan.input]
    pole = (min(a, b), max(a, b))
    driven, driven_dq = lines.unit[pole], lines.rate[pole]
    raw = {a: np.zeros_like(driven), b: driven_dq}
    for link in wanted.links:
        if link in (a, b):
            continue
        one, other = _toward(a, link), _toward(b, link)
        unit, rate = lines.unit[one], lines.rate[one]
        factor, _ = decompose(driven, unit, lines.unit[other])
        change = decompose_rate(
            (driven, driven_dq), (unit, rate), (lines.unit[other], lines.rate[other])
        )
        raw[link] = change * unit + factor * rate
    for link, value in raw.items():
        dw[link] = value - raw[0]


def _toward(one: int, link: int) -> Pole:
    return (one, link) if one < link else (link, one)


def _mend_directions(
    wanted: Request,
    lines: Lines,
    w: dict[int, Floats],
    weak: NDArray[np.bool_],
    flatness: Floats,
) -> None:
    """Take directions from the velocity equations where those are the better source."""
    primary = {s.pole for s in wanted.plan.steps if isinstance(s, PrimaryPole)}
    for pole in wanted.poles:
        i, j = pole
        if pole in primary or i not in w or j not in w:
            continue
        vector = w[j][:, weak] - w[i][:, weak]
        length = norm(vector)
        scale = np.maximum(norm(w[j][:, weak]), norm(w[i][:, weak]))
        error = EPS * np.maximum(scale, 1.0) / np.maximum(length * flatness, EPS)
        better = error < np.nan_to_num(lines.error[pole][weak], nan=1.0)
        rows = np.flatnonzero(weak)[better]
        lines.unit[pole][:, rows] = vector[:, better] / length[better]
        lines.error[pole][rows] = error[better]


def _add_pole(
    field: PoleField,
    motion: Motion,
    wanted: Request,
    lines: Lines,
    pole: Pole,
    w: dict[int, Floats],
    dw: dict[int, Floats],
    memory: SignMemory,
) -> None:
    i, j = pole
    unit, error = lines.unit[pole].copy(), lines.error[pole]
    bad = motion.failed | ~(error < USABLE_DIRECTION)
    unit[:, bad] = np.nan
    known = i in w and j in w
    nothing = np.full(unit.shape[1], np.nan)
    rate = dot(w[j] - w[i], unit) if known else nothing
    rate_dq = dot(dw[j] - dw[i], unit) if known else nothing.copy()
    primary = any(isinstance(s, PrimaryPole) and s.pole == pole for s in wanted.plan.steps)
    if not primary:
        signs = _continuous_signs(motion, unit, rate, w, dw, pole, memory, known)
        unit, rate, rate_dq = unit * signs, rate * signs, rate_dq * signs
    own = field.status.copy()
    unknown = bad & (own == Status.OK)
    own[unknown] = Status.ILL_CONDITIONED
    if known:
        still = unknown & (norm(w[j] - w[i]) < NO_MOTION * np.maximum(1.0, norm(w[j])))
        own[still] = Status.NO_POLE
        rate[still] = 0.0
        rate_dq[still & (norm(dw[j] - dw[i]) < NO_MOTION)] = 0.0
    field.pole_status[pole] = own
    field.direction[pole] = unit.T
    field.rate[pole], field.rate_dq[pole] = rate, rate_dq
    field.error[pole] = np.where(bad, np.nan, error)
    field.angle[pole] = np.where(bad, np.nan, np.nan_to_num(lines.angle[pole]))


SUBSTEPS = 8


def _continuous_signs(
    motion: Motion,
    unit: Floats,
    rate: Floats,
    w: dict[int, Floats],
    dw: dict[int, Floats],
    pole: Pole,
    memory: SignMemory,
    known: bool,
) -> Floats:
    """Return the signs that make a direction continuous along each branch.

    The direction follows w itself, so its coefficient keeps its sign until w passes
    through zero; where it does is read off the Hermite path between two samples. At the
    first sample it points to the side where the sum of all axes and contacts lies.
    """
    signs = np.ones(unit.shape[1])
    for number, branch in enumerate(motion.branches):
        rows = slice(number * motion.samples, (number + 1) * motion.samples)
        u = unit[:, rows]
        good = np.flatnonzero(np.all(np.isfinite(u), axis=0))
        if not len(good):
            continue
        q = motion.q[rows][good]
        u = u[:, good]
        if known:
            along = np.where(rate[rows][good] < 0.0, -1.0, 1.0)
            v = (w[pole[1]] - w[pole[0]])[:, rows][:, good]
            dv = (dw[pole[1]] - dw[pole[0]])[:, rows][:, good]
        else:
            along, v, dv = np.ones(len(q)), u, np.zeros_like(u)
        key = (branch.number, pole)
        if key in memory.last:
            q0, v0, dv0, s0 = memory.last[key]
            flips = _flips(
                np.append(q0, q), np.column_stack([v0, v]), np.column_stack([dv0, dv])
            )
            chain = s0 * np.cumprod(flips)
        else:
            home = np.sum(motion.frames[rows.start + good[0], :, :, 2], axis=0)
            side = -1.0 if u[:, 0] @ home * along[0] < 0.0 else 1.0
            chain = np.cumprod(np.append(side, _flips(q, v, dv)))
        signs[rows.start + good] = chain * along
        memory.last[key] = (q[-1:], v[:, -1:], dv[:, -1:], float(chain[-1]))
    return signs


def _flips(q: Floats, v: Floats, dv: Floats) -> Floats:
    """Return +1 or -1 for each gap (k - 1,): whether v (3, k) reverses in between."""
    flips = np.ones(len(q) - 1)
    gap = np.flatnonzero(dot(v[:, 1:], v[:, :-1]) < 0.0)
    if not len(gap):
        return flips
    h = (q[1:] - q[:-1])[gap]
    t = np.linspace(0.0, 1.0, SUBSTEPS + 1)[:, None]
    slope = np.nan_to_num(dv)
    path = (
        v[:, None, gap] * (1 + 2 * t) * (1 - t) ** 2
        + v[:, None, gap + 1] * t * t * (3 - 2 * t)
        + h * t * (1 - t) * ((1 - t) * slope[:, None, gap] - t * slope[:, None, gap + 1])
    )
    turns = np.sum(path[:, 1:] * path[:, :-1], axis=0)
    flips[gap] = np.where(np.sum(turns < 0.0, axis=0) % 2 == 1, -1.0, 1.0)
    return flips
