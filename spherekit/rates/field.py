"""Pole axes and velocity coefficients of a motion, and their exact derivatives.

The primary quantity is the vector w of each link: its angular velocity per unit rate of
the input. A pole's direction is a unit vector along its axis, and the coefficient is the
signed component of w along it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import (
    NO_MOTION,
    SINGULAR_RATIO,
    USABLE_DIRECTION,
    Status,
    listing,
    nearest,
)
from spherekit.errors import SolveError
from spherekit.motion.motion import Motion
from spherekit.numeric.hermite import cubic
from spherekit.numeric.rows import ArrayRows
from spherekit.planning.poles import CoaxialPole, Pole, PrimaryPole, pole_of
from spherekit.rates.bounds import Bounds, mended_and_bounded
from spherekit.rates.columns import RateColumns
from spherekit.rates.core import Equations, LinkRates, driven_rates, equations
from spherekit.rates.gnomonic import Chart
from spherekit.rates.lines import (
    Lines,
    decompose,
    decompose_rate,
    evaluate_line_rates,
    evaluate_lines,
    planes_through,
)
from spherekit.rates.request import Request
from spherekit.rates.routes import ROUTES, Route
from spherekit.rates.vectors import dot, norm
from spherekit.sphere.rotation import Floats

TRUSTED_ERROR = 1e-12
"""Samples whose propagated error bound exceeds this use the velocity equations."""

NEARLY_LOOSE = 0.1 / SINGULAR_RATIO
"""And those where the loops are this sensitive: the equations say whether they hold."""


@final
@dataclass(frozen=True)
class PoleField(ArrayRows):
    """Requested poles of a motion in which one input moves; rows as in the motion.

    NaN where the motion failed. Derivatives are by that input, the others held.

    `direction[pole]` (n, 3) unit vector in ground axes, continuous along each assembly mode
    and at its first sample on the side of the mechanism's axes (of a pair: its axis);
    `rate[pole]` (n,): rate * direction is the angular velocity of the pole's second link
    relative to its first per unit rate of the input; `acceleration_coefficient[pole]` (n,)
    its derivative by the input (1/rad); `angle[pole]` (n,) sine of the angle between the
    two planes used, 0 where they coincide. `error[pole]` (n,) bound of the direction's
    error (rad), `velocity_coefficient_error[pole]` and
    `acceleration_coefficient_error[pole]` (n,) those of the two coefficients: of rounding,
    and of what the configuration is off by. `planes[pole]` (n, 2, 3) unit normals of those
    planes, for the poles asked for. `w[link]`, `dw[link]` (n, 3): rates of links relative
    to the ground, per unit rate of the input, and their derivatives. `loss` (n,): the part
    of the largest of them, or of 1, that may be wrong. `status` (n,): the motion's, with
    AT_SINGULARITY where the rates are not finite. `pole_status[pole]` (n,): the same, with
    NO_POLE or ILL_CONDITIONED where only this pole cannot be given. `by_equations` (n,):
    samples solved from the velocity equations instead; `by_kernel` (n,): rows that a kernel
    vouches for.
    """

    direction: dict[Pole, Floats]
    velocity_coefficient: dict[Pole, Floats]
    acceleration_coefficient: dict[Pole, Floats]
    angle: dict[Pole, Floats]
    error: dict[Pole, Floats]
    velocity_coefficient_error: dict[Pole, Floats]
    acceleration_coefficient_error: dict[Pole, Floats]
    planes: dict[Pole, Floats]
    w: dict[int, Floats]
    dw: dict[int, Floats]
    status: NDArray[np.int8]
    pole_status: dict[Pole, NDArray[np.int8]]
    by_equations: NDArray[np.bool_]
    by_kernel: NDArray[np.bool_]
    loss: Floats


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


def evaluate(
    motion: Motion,
    wanted: Request,
    memory: SignMemory | None = None,
    route: Route = "best",
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
    route
        How they are found, one of `spherekit.rates.routes.ROUTES`.

    Raises
    ------
    SolveError
        If there is no such route.
    """
    memory = memory or SignMemory()
    if route not in ROUTES:
        raise SolveError(
            f'{motion.mechanism.name}: no route is "{route}"'
            f"{nearest(str(route), ROUTES) or ';'} Routes: {listing(ROUTES)}"
        )
    if route == "equations":
        everywhere = np.ones(len(motion), dtype=bool)
        found = driven_rates(motion, everywhere, wanted.plan.input)
        return field_of_rates(motion, wanted, found, memory)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        return _signed(_by_lines(motion, wanted, route), motion, wanted, memory)


def field_of_columns(
    motion: Motion,
    wanted: Request,
    columns: RateColumns,
    vouched: NDArray[np.bool_],
    memory: SignMemory,
    with_planes: bool,
) -> PoleField:
    """Return the requested poles of a motion from what a kernel found of its rows.

    Rows that it does not vouch for (n,) are found by `evaluate`'s ``best``, and put in
    their place; `columns` are written to. Great circles are drawn when they are read, or at
    once, `with_planes`.
    """
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        field = _of_columns(motion, wanted, columns, vouched)
        field = _signed(field, motion, wanted, memory)
    for pole in wanted.planes if with_planes else ():
        _ = field.planes[pole]
    return field


def field_of_rates(
    motion: Motion, wanted: Request, found: LinkRates, memory: SignMemory
) -> PoleField:
    """Return the requested poles of a motion whose angular velocities are known.

    The pole of two links lies along their relative angular velocity; `by_equations` is
    true throughout, and `angle` is the flatness that the rates were found with.
    """
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        lines = Lines.of_pairs(wanted.plan, motion, "equations")
        bodies = {b for pole in _body_poles(wanted) for b in pole} | set(wanted.bodies)
        w = {body: found.w[:, body].T.copy() for body in bodies}
        dw = {body: found.dw[:, body].T.copy() for body in bodies}
        everywhere = np.ones(len(motion), dtype=bool)
        for pole in _body_poles(wanted):
            if pole not in lines.unit:
                lines.unit[pole] = np.full_like(w[pole[0]], np.nan)
                lines.error[pole] = np.ones(len(motion))
                lines.angle[pole] = found.reciprocal_condition
        for pole in wanted.planes:
            own = wanted.plan.pole(*pole)
            if own is not None:
                planes_through(wanted.plan, own, lines)
        solved = equations(motion, wanted.plan.input)
        flat = ~(found.reciprocal_condition >= SINGULAR_RATIO) | np.isinf(solved.loss)
        status = motion.status.copy()
        status[flat & (status == Status.OK)] = Status.AT_SINGULARITY
        field = _field(motion, wanted, lines, (w, dw), status, everywhere, solved)
        return _signed(field, motion, wanted, memory)


def _of_columns(
    motion: Motion, wanted: Request, columns: RateColumns, vouched: NDArray[np.bool_]
) -> PoleField:
    """Return what `field_of_columns` does, with any signs."""
    n = len(motion)
    rest = np.flatnonzero(~vouched & ~motion.failed)
    nothing = np.flatnonzero(motion.failed)
    if len(nothing):
        for part in columns.every:
            part[..., nothing] = np.nan
    at = {pole: k for k, pole in enumerate(columns.poles)}
    loss = np.zeros(n)
    loss[nothing] = np.nan
    field = PoleField(
        direction={pole: columns.direction[:, k].T for pole, k in at.items()},
        velocity_coefficient={pole: columns.rate[0, k] for pole, k in at.items()},
        acceleration_coefficient={pole: columns.rate[1, k] for pole, k in at.items()},
        angle={pole: columns.angle[k] for pole, k in at.items()},
        error={pole: columns.error[0, k] for pole, k in at.items()},
        velocity_coefficient_error={pole: columns.error[1, k] for pole, k in at.items()},
        acceleration_coefficient_error={
            pole: columns.error[2, k] for pole, k in at.items()
        },
        planes=_PlanesWhenRead(wanted, motion),
        w={link: values.T for link, values in columns.w.items()},
        dw={link: values.T for link, values in columns.dw.items()},
        status=motion.status.copy() if len(rest) else motion.status,
        pole_status=dict.fromkeys(columns.poles, motion.status),
        by_equations=np.zeros(n, dtype=bool),
        by_kernel=vouched,
        loss=loss,
    )
    for pole in wanted.poles:
        if pole not in at:
            _add_locked(field, motion, pole)
    if not len(rest):
        return field
    careful = _by_lines(motion.rows(rest), replace(wanted, planes=frozenset()), "best")
    for pole in at:
        field.pole_status[pole] = motion.status.copy()
    for name, own in vars(field).items():
        new = getattr(careful, name)
        if name == "by_kernel":
            continue
        if not isinstance(own, dict):
            own[rest] = new
            continue
        for key, values in own.items():
            values[rest] = new[key]
    return field


@final
class _PlanesWhenRead(dict[Pole, Floats]):
    """The great circles of poles, drawn when they are first read."""

    def __init__(self, wanted: Request, motion: Motion) -> None:
        super().__init__()
        self._wanted, self._motion = wanted, motion

    def __missing__(self, pole: Pole) -> Floats:
        plan, motion = self._wanted.plan, self._motion
        own = plan.pole(*pole)
        self[pole] = np.full((len(motion), 2, 3), np.nan)
        if pole in self._wanted.planes and own is not None:
            with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
                lines = evaluate_lines(plan, motion, [own])
            self[pole] = np.moveaxis(lines.planes[own], -1, 0)
        return self[pole]


def _by_lines(motion: Motion, wanted: Request, route: Route) -> PoleField:
    """Return the poles by the great circles of the plan, with any signs."""
    chart = Chart(wanted.plan, motion) if route == "gnomonic" else None
    kept = [pole for pole in (wanted.plan.pole(*pole) for pole in wanted.planes) if pole]
    if chart is None:
        lines = evaluate_lines(wanted.plan, motion, kept, route)
    else:
        lines = chart.lines
        for pole in kept:
            planes_through(wanted.plan, pole, lines)
    w, doubt = _link_rates(wanted, lines, chart)
    dw = {link: np.full_like(value, np.nan) for link, value in w.items()}
    if wanted.derivatives:
        _add_rates(wanted, lines, chart, motion, w, dw)
    status = motion.status.copy()
    solved = equations(motion, wanted.plan.input)
    weak = np.zeros(len(motion), dtype=bool)
    if route == "best":
        for pole in _body_poles(wanted):
            doubt = np.maximum(doubt, np.nan_to_num(lines.error[pole], nan=1.0))
        # Only the equations say whether redundant constraints agree with each other.
        redundant = any(group.redundant for group in motion.assembly.groups)
        # Groups that this input does not move may be loose all the same.
        loose = motion.sensitivity > NEARLY_LOOSE
        weak = ((doubt > TRUSTED_ERROR) | redundant | loose) & ~motion.failed
        for body in wanted.bodies:
            w[body][:, weak] = solved.w[weak, body].T
            dw[body][:, weak] = solved.dw[weak, body].T
    else:
        lost = ~(doubt < USABLE_DIRECTION) & (status == Status.OK)
        status[lost] = Status.ILL_CONDITIONED
    status[np.isinf(solved.loss) & (status == Status.OK)] = Status.AT_SINGULARITY
    return _field(motion, wanted, lines, (w, dw), status, weak, solved)


def _field(
    motion: Motion,
    wanted: Request,
    lines: Lines,
    rates: tuple[dict[int, Floats], dict[int, Floats]],
    status: NDArray[np.int8],
    by_equations: NDArray[np.bool_],
    solved: Equations,
) -> PoleField:
    """Return what was found by the poles that were asked for, with any signs."""
    bounds = mended_and_bounded(
        _body_poles(wanted),
        (_pairs(wanted), _rounded(wanted)),
        lines,
        rates,
        by_equations,
        solved,
    )
    w, dw = rates
    no_rate = status != Status.OK
    for vectors in rates:
        for value in vectors.values():
            value[:, no_rate] = np.nan
    loss = np.where(no_rate, np.nan, solved.loss)
    by_kernel = np.zeros(len(motion), dtype=bool)
    field = PoleField(
        direction={},
        velocity_coefficient={},
        acceleration_coefficient={},
        angle={},
        error={},
        velocity_coefficient_error={},
        acceleration_coefficient_error={},
        planes={},
        w={},
        dw={},
        status=status,
        pole_status={},
        by_equations=by_equations,
        by_kernel=by_kernel,
        loss=loss,
    )
    for pole in wanted.poles:
        _add_pole(field, motion, wanted, lines, pole, w, dw, bounds)
    nothing = np.full((len(motion), 2, 3), np.nan)
    for pole in wanted.planes:
        own = wanted.plan.pole(*pole)
        field.planes[pole] = (
            nothing if own is None else np.moveaxis(lines.planes[own], -1, 0)
        )
    for link, body in enumerate(wanted.plan.body):
        if body in w:
            field.w[link], field.dw[link] = w[body].T, dw[body].T
    return field


def _body_poles(wanted: Request) -> list[Pole]:
    """Return the wanted poles as poles of bodies, without those of links joined."""
    poles = (wanted.plan.pole(*pole) for pole in wanted.poles)
    return list(dict.fromkeys(pole for pole in poles if pole is not None))


def _link_rates(
    wanted: Request, lines: Lines, chart: Chart | None
) -> tuple[dict[int, Floats], Floats]:
    """Return w relative to the ground of each body (3, n), and a bound of their error."""
    a, b = wanted.plan.ends[wanted.plan.input]
    driven = lines.unit[pole_of(a, b)]
    w = {a: np.zeros_like(driven), b: driven.copy()}
    doubt = np.zeros(driven.shape[1])
    for body in wanted.bodies:
        if body in (a, b):
            continue
        one, other = pole_of(a, body), pole_of(b, body)
        if chart is None:
            factor, sine = decompose(driven, lines.unit[one], lines.unit[other])
        else:
            factor, sine = chart.ratio(body)
        w[body] = factor * lines.unit[one]
        doubt = np.maximum(doubt, (lines.error[one] + lines.error[other]) / sine)
    if 0 in w:
        ground = w[0].copy()
        w = {body: value - ground for body, value in w.items()}
    return w, np.nan_to_num(doubt, nan=1.0, posinf=1.0)


def _add_rates(
    wanted: Request,
    lines: Lines,
    chart: Chart | None,
    motion: Motion,
    w: dict[int, Floats],
    dw: dict[int, Floats],
) -> None:
    plan = wanted.plan
    unknown = np.full((len(motion), 3), np.nan)

    def of_ends(which: int) -> Floats:
        ends = [pair[which] for pair in plan.ends]
        return np.stack([w[k].T if k in w else unknown for k in ends], axis=1)

    turned = motion.linearisation.pair_rates(of_ends(0), of_ends(1))
    if chart is None:
        evaluate_line_rates(plan, lines, motion, turned)
    else:
        chart.add_rates(turned)
    a, b = plan.ends[plan.input]
    pole = pole_of(a, b)
    driven, driven_dq = lines.unit[pole], lines.rate[pole]
    raw = {a: np.zeros_like(driven), b: driven_dq}
    for body in wanted.bodies:
        if body in (a, b):
            continue
        one, other = pole_of(a, body), pole_of(b, body)
        unit, rate = lines.unit[one], lines.rate[one]
        if chart is None:
            factor, _ = decompose(driven, unit, lines.unit[other])
            change = decompose_rate(
                (driven, driven_dq), (unit, rate), (lines.unit[other], lines.rate[other])
            )
        else:
            factor, _ = chart.ratio(body)
            change = chart.ratio_rate(body)
        raw[body] = change * unit + factor * rate
    for body, value in raw.items():
        dw[body] = value - raw[0]


def _add_pole(
    field: PoleField,
    motion: Motion,
    wanted: Request,
    lines: Lines,
    pole: Pole,
    w: dict[int, Floats],
    dw: dict[int, Floats],
    bounds: Bounds,
) -> None:
    own = wanted.plan.pole(*pole)
    if own is None:
        _add_locked(field, motion, pole)
        return
    i, j = (wanted.plan.body[link] for link in pole)
    unit, error = lines.unit[own].copy(), bounds.direction[own]
    # Nothing bounds what a singular configuration is off by; its status says so.
    judged = np.where(field.status == Status.OK, error, lines.error[own])
    bad = motion.failed | ~(judged < USABLE_DIRECTION)
    unit[:, bad] = np.nan
    known = i in w and j in w
    nothing = np.full(unit.shape[1], np.nan)
    rate = dot(w[j] - w[i], unit) if known else nothing
    acceleration_coefficient = dot(dw[j] - dw[i], unit) if known else nothing.copy()
    codes = field.status.copy()
    unknown = bad & (codes == Status.OK)
    codes[unknown] = Status.ILL_CONDITIONED
    if known:
        still = unknown & (norm(w[j] - w[i]) < NO_MOTION * np.maximum(1.0, norm(w[j])))
        codes[still] = Status.NO_POLE
        rate[still] = 0.0
        acceleration_coefficient[still & (norm(dw[j] - dw[i]) < NO_MOTION)] = 0.0
    field.pole_status[pole] = codes
    field.direction[pole] = unit.T
    field.velocity_coefficient[pole], field.acceleration_coefficient[pole] = (
        rate,
        acceleration_coefficient,
    )
    field.error[pole] = np.where(bad, np.nan, error)
    field.velocity_coefficient_error[pole] = np.where(
        np.isnan(rate), np.nan, bounds.rate[own]
    )
    field.acceleration_coefficient_error[pole] = np.where(
        np.isnan(acceleration_coefficient), np.nan, bounds.acceleration_coefficient[own]
    )
    field.angle[pole] = np.where(bad, np.nan, np.nan_to_num(lines.angle[own]))


def _signed(
    field: PoleField, motion: Motion, wanted: Request, memory: SignMemory
) -> PoleField:
    """Give directions, and coefficients along them, the signs that continue; in place."""
    pairs = _pairs(wanted)
    for pole in wanted.poles:
        own = wanted.plan.pole(*pole)
        if own is None or own in pairs:
            continue
        i, j = pole
        unit, rate = field.direction[pole].T, field.velocity_coefficient[pole]
        steady = _steady_signs(field, motion, pole, memory)
        if steady is not None:
            _turn_round(field, pole, steady)
            continue
        known = i in field.w and j in field.w
        v = (field.w[j] - field.w[i]).T if known else None
        dv = (field.dw[j] - field.dw[i]).T if known else None
        signs = _continuous_signs(motion, unit, rate, v, dv, pole, memory)
        for values in (unit, rate, field.acceleration_coefficient[pole]):
            values *= signs
    return field


def _turn_round(field: PoleField, pole: Pole, signs: Sequence[float]) -> None:
    """Reverse a pole's directions in the assembly modes whose sign is -1, in place."""
    unit, rate = field.direction[pole].T, field.velocity_coefficient[pole]
    samples = len(rate) // len(signs)
    for number, sign in enumerate(signs):
        if sign < 0.0:
            rows = slice(number * samples, (number + 1) * samples)
            for values in (unit, rate, field.acceleration_coefficient[pole]):
                np.negative(values[..., rows], out=values[..., rows])


def _steady_signs(
    field: PoleField, motion: Motion, pole: Pole, memory: SignMemory
) -> list[float] | None:
    """Return one sign for each assembly mode, where none changes within the block.

    None where one does, or may: `_continuous_signs` then follows them from row to row.
    """
    i, j = pole
    if motion.sense is not None or not motion.is_path or motion.inputs.shape[1] != 1:
        return None
    if not motion.samples or not (i in field.w and j in field.w):
        return None
    unit, rate = field.direction[pole].T, field.velocity_coefficient[pole]
    beside = unit[:, 1:] * unit[:, :-1]
    going = beside[0] + beside[1]
    going += beside[2]
    steps = [(n * motion.samples, (n + 1) * motion.samples - 1) for n in _modes(motion)]
    if not all(np.min(rate[a : b + 1]) >= 0.0 for a, b in steps):
        return None
    if not all(a == b or np.min(going[a:b]) >= 0.0 for a, b in steps):
        return None
    signs, ends = [], []
    for (first, last), mode in zip(steps, motion.assembly_modes, strict=True):
        v, dv = ((x[j][first] - x[i][first])[:, None] for x in (field.w, field.dw))
        key = mode.number, pole
        way, sense = motion.q[[first]], np.ones(1)
        if key in memory.last:
            before = memory.last[key]
            flip = _flips(
                np.append(before.way, way),
                np.append(before.sense, sense),
                np.column_stack([before.w, v]),
                np.column_stack([before.dw, dv]),
            )
            sign = before.sign * float(flip[0])
        else:
            home = _home(motion, mode.number, first, memory)
            sign = -1.0 if unit[:, first] @ home < 0.0 else 1.0
        signs.append(sign)
        v, dv = ((x[j][last] - x[i][last])[:, None] for x in (field.w, field.dw))
        ends.append((key, _Last(motion.q[[last]], sense, v, dv, sign)))
    memory.last.update(ends)
    return signs


def _modes(motion: Motion) -> range:
    return range(len(motion.assembly_modes))


def _home(motion: Motion, mode: int, row: int, memory: SignMemory) -> Floats:
    """Return the side (3,) on which directions of a mode start, read at its first row."""
    if mode not in memory.home:
        (frames,) = motion.rows(np.array([row])).frames
        memory.home[mode] = np.sum(frames[:, :, 2], axis=0)
    return memory.home[mode]


def _add_locked(field: PoleField, motion: Motion, pole: Pole) -> None:
    """Add the pole of two links that inputs at rest hold together: there is none."""
    n = len(motion)
    good = field.status == Status.OK
    field.direction[pole] = np.full((n, 3), np.nan)
    field.velocity_coefficient[pole] = np.where(good, 0.0, np.nan)
    field.acceleration_coefficient[pole] = field.velocity_coefficient[pole].copy()
    field.angle[pole] = np.full(n, np.nan)
    field.error[pole] = np.full(n, np.nan)
    field.velocity_coefficient_error[pole] = field.velocity_coefficient[pole].copy()
    field.acceleration_coefficient_error[pole] = field.velocity_coefficient[pole].copy()
    field.pole_status[pole] = np.where(good, Status.NO_POLE, field.status).astype(np.int8)


def _rounded(wanted: Request) -> set[Pole]:
    """Return the poles of bodies whose pairs have one axis but for rounding."""
    return {
        step.pole
        for step in wanted.plan.steps
        if isinstance(step, CoaxialPole) and step.pair in wanted.plan.rounded_axes
    }


def _pairs(wanted: Request) -> dict[Pole, int]:
    """Return the poles of bodies that are the axis or contact line of a pair, and those."""
    steps = wanted.plan.steps
    return {
        step.pole: step.pair
        for step in steps
        if isinstance(step, PrimaryPole | CoaxialPole)
    }


SUBSTEPS = 8


def _continuous_signs(
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
        known = np.all(np.isfinite(unit[:, rows]), axis=0)
        moved = known if w is None else known & np.all(np.isfinite(w[:, rows]), axis=0)
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
            each[..., -1:].copy() for each in (t, here, v, dv)
        )
        memory.last[key] = _Last(way_here, sense_here, w_here, dw_here, float(chain[-1]))
        if len(good) == len(moved):
            continue
        for row in np.flatnonzero(known & ~moved):
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
    turns = np.sum(path[:, 1:] * path[:, :-1], axis=0)
    flips[gap] = np.where(np.sum(turns < 0.0, axis=0) % 2 == 1, -1.0, 1.0)
    return flips
