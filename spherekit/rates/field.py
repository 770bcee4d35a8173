"""Pole axes and velocity coefficients of a motion, and their exact derivatives.

The primary quantity is the vector w of each link: its angular velocity per unit rate of
the input. A pole's direction is a unit vector along its axis, and the coefficient is the
signed component of w along it.
"""

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
from spherekit.planning.poles import CoaxialPole, Pole, pole_of
from spherekit.rates.bounds import Bounds, mended_and_bounded
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
from spherekit.rates.pole_field import PoleField
from spherekit.rates.request import Request
from spherekit.rates.routes import ROUTES, Route
from spherekit.rates.signs import SignMemory, signed
from spherekit.rates.turning import axis_pairs
from spherekit.rates.vectors import dot, norm
from spherekit.sphere.rotation import Floats

TRUSTED_ERROR = 1e-12
"""Samples whose propagated error bound exceeds this use the velocity equations."""

NEARLY_LOOSE = 0.1 / SINGULAR_RATIO
"""And those where the loops are this sensitive: the equations say whether they hold."""


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
        rates = driven_rates(motion, everywhere, wanted.plan.input)
        return field_of_rates(motion, wanted, rates, memory)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        return signed(by_lines(motion, wanted, route), motion, wanted, memory)


def field_of_rates(
    motion: Motion, wanted: Request, rates: LinkRates, memory: SignMemory
) -> PoleField:
    """Return the requested poles of a motion whose angular velocities are known.

    The pole of two links lies along their relative angular velocity; `by_equations` is
    true throughout, and `angle` is the flatness that the rates were found with.
    """
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        lines = Lines.of_pairs(wanted.plan, motion, "equations")
        bodies = {b for pole in _body_poles(wanted) for b in pole} | set(wanted.bodies)
        w = {body: rates.w[:, body].T.copy() for body in bodies}
        dw = {body: rates.dw[:, body].T.copy() for body in bodies}
        everywhere = np.ones(len(motion), dtype=bool)
        for pole in _body_poles(wanted):
            if pole not in lines.unit:
                lines.unit[pole] = np.full_like(w[pole[0]], np.nan)
                lines.error[pole] = np.ones(len(motion))
                lines.angle[pole] = rates.reciprocal_condition
        for pole in wanted.planes:
            body_pole = wanted.plan.pole(*pole)
            if body_pole is not None:
                planes_through(wanted.plan, body_pole, lines)
        solved = equations(motion, wanted.plan.input)
        flat = ~(rates.reciprocal_condition >= SINGULAR_RATIO) | np.isinf(solved.loss)
        status = motion.status.copy()
        status[flat & (status == Status.OK)] = Status.AT_SINGULARITY
        field = _field(motion, wanted, lines, (w, dw), status, everywhere, solved)
        return signed(field, motion, wanted, memory)


def by_lines(motion: Motion, wanted: Request, route: Route) -> PoleField:
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
        (axis_pairs(wanted.plan), _rounded(wanted)),
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
        body_pole = wanted.plan.pole(*pole)
        field.planes[pole] = (
            nothing if body_pole is None else np.moveaxis(lines.planes[body_pole], -1, 0)
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
    body_pole = wanted.plan.pole(*pole)
    if body_pole is None:
        add_locked(field, motion, pole)
        return
    i, j = (wanted.plan.body[link] for link in pole)
    unit, error = lines.unit[body_pole].copy(), bounds.direction[body_pole]
    # Nothing bounds what a singular configuration is off by; its status says so.
    judged = np.where(field.status == Status.OK, error, lines.error[body_pole])
    bad = motion.failed | ~(judged < USABLE_DIRECTION)
    unit[:, bad] = np.nan
    has_rates = i in w and j in w
    nothing = np.full(unit.shape[1], np.nan)
    rate = dot(w[j] - w[i], unit) if has_rates else nothing
    acceleration_coefficient = dot(dw[j] - dw[i], unit) if has_rates else nothing.copy()
    codes = field.status.copy()
    unknown = bad & (codes == Status.OK)
    codes[unknown] = Status.ILL_CONDITIONED
    if has_rates:
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
        np.isnan(rate), np.nan, bounds.rate[body_pole]
    )
    field.acceleration_coefficient_error[pole] = np.where(
        np.isnan(acceleration_coefficient),
        np.nan,
        bounds.acceleration_coefficient[body_pole],
    )
    angle = np.nan_to_num(lines.angle[body_pole])
    if has_rates and body_pole not in axis_pairs(wanted.plan):
        sizes = norm(w[i]) + norm(w[j])
        angle = norm(w[j] - w[i]) / np.where(sizes > 0.0, sizes, 1.0)
    field.angle[pole] = np.where(bad, np.nan, angle)


def add_locked(field: PoleField, motion: Motion, pole: Pole) -> None:
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
