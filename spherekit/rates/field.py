"""Pole axes and velocity coefficients of a motion, and their exact derivatives.

The primary quantity is the vector w of each link: its angular velocity per unit rate of
the input. A pole's direction is a unit vector along its axis, and the coefficient is the
signed component of w along it.

The sequence of a plan: every pole a product of known ones, every coefficient a ratio.

With two third links k and r a pole lies along (u_ik x u_jk) x (u_ir x u_jr), and
w_k - w_a = x u_ka with one ratio x of such products. All of it is written once for series,
a quantity alone or with its derivative by the input: (3, n) of vectors, (n,) of numbers.

Each pole carries a bound of its error, propagated from those of its sources. Of all the
great circles that the plan keeps for a pole, a route takes the best two or the first two.
The best two are the one with the smallest error and then the partner that makes the
intersection most certain; both the angle between the two planes and the bound are reported.
"""

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import (
    EPS,
    NO_MOTION,
    SINGULAR_RATIO,
    USABLE_DIRECTION,
    Status,
    listing,
    nearest,
)
from spherekit.errors import SolveError
from spherekit.model.gears import SAME_AXIS
from spherekit.model.joints import PairRates
from spherekit.motion.loops import LoopTree
from spherekit.motion.motion import Motion
from spherekit.planning.poles import (
    BlockPoles,
    CoaxialPole,
    LinePole,
    Plan,
    Pole,
    PrimaryPole,
    pole_of,
)
from spherekit.rates.core import (
    Equations,
    LinkRates,
    NullMotion,
    cross,
    dot,
    driven_rates,
    equations,
    norm,
    null_motion,
    null_motion_rate,
)
from spherekit.rates.request import (
    ROUTES,
    PoleField,
    Request,
    Route,
    SignMemory,
    axis_pairs,
    signed,
)
from spherekit.sphere.rotation import Floats

Series = tuple[Floats, ...]
"""A quantity and, if there are two orders, its derivative by the input."""


@final
class PlannedPoles:
    """The poles of a plan at the rows of a motion, with any signs of secondary ones.

    `unit[pole]` (3, n) the direction; `error[pole]` (n,) bound of its error (rad);
    `angle[pole]` (n,) sine of the angle between the two planes used, 1 for primary poles.
    Where it is known how pairs are `turned`, there are derivatives, by the product rule
    through the same intersections. `blocks` are irreducible parts that were solved before.
    By the route ``equations`` only the poles of pairs are planned, the others are NaN.
    """

    def __init__(
        self,
        plan: Plan,
        motion: Motion,
        route: Route = "best",
        turned: PairRates | None = None,
        blocks: dict[BlockPoles, NullMotion] | None = None,
    ) -> None:
        self.plan, self.motion, self.route, self._turned = plan, motion, route, turned
        self.unit: dict[Pole, Series] = {}
        self.error: dict[Pole, Floats] = {}
        self.angle: dict[Pole, Floats] = {}
        self._drawn: dict[Pole, tuple[Floats, Floats]] = {}
        self._blocks = {} if blocks is None else blocks
        self._axes = (motion.axes,) if turned is None else (motion.axes, turned.axes)
        n = len(motion)
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            for step in plan.steps:
                if isinstance(step, PrimaryPole | CoaxialPole):
                    axis = self._of_pair(step.pair)
                    self._add(step.pole, axis, np.full(n, EPS), np.ones(n))
                elif route == "equations":
                    for pole in step.poles if isinstance(step, BlockPoles) else [step.pole]:
                        self._add(pole, (np.full((3, n), np.nan),), np.ones(n), np.zeros(n))
                elif isinstance(step, LinePole):
                    one, other, angle, error = self._two_circles(step)
                    self._drawn[step.pole] = one[0], other[0]
                    self._add(step.pole, _unit(_cross(one, other)), error, angle)
                else:
                    self._solve(step)

    def moving(self, turned: PairRates) -> "PlannedPoles":
        """Return the same with derivatives, given those of axes and vectors of pairs."""
        return PlannedPoles(self.plan, self.motion, self.route, turned, self._blocks)

    def _add(self, pole: Pole, unit: Series, error: Floats, angle: Floats) -> None:
        self.unit[pole], self.error[pole], self.angle[pole] = unit, error, angle

    def _of_pair(self, pair: int) -> Series:
        return tuple(np.ascontiguousarray(axes[:, pair].T) for axes in self._axes)

    def _two_circles(self, step: LinePole) -> tuple[Series, Series, Floats, Floats]:
        """Return the normals of the two great circles of a pole.

        And the sine of the angle between them and the bound of where they meet (n,). Of
        all these are those through pairs of known poles, then the contact planes.
        """
        i, j = step.pole
        sources = [(pole_of(i, k), pole_of(j, k)) for k in step.via]
        every = [_cross(self.unit[a], self.unit[b]) for a, b in sources]
        every += [self._of_pair(number) for number in step.contacts]
        drawn = [self.error[a] + self.error[b] for a, b in sources]
        drawn += [np.zeros(len(self.motion))] * len(step.contacts)
        count = 2 if self.route == "first" else len(every)
        orders = [np.stack(order) for order in zip(*every[:count], strict=True)]
        length, row = norm(orders[0]), np.arange(len(self.motion))
        errors = (np.stack(drawn[:count]) + EPS) / np.maximum(length, EPS)
        # Only two are taken in their order, so that their sense is that of the plan.
        best = np.argmin(errors, axis=0) * (len(errors) > 2)
        first = [_taken(order, best) for order in orders]
        across = norm(cross(first[0], orders[0]))
        sine = across / np.maximum(length * length[best, row], EPS * EPS)
        doubt = (errors + errors[best, row]) / np.maximum(sine, EPS)
        doubt[best, row] = np.inf
        partner = np.argmin(doubt, axis=0)
        second = tuple(_taken(order, partner) for order in orders)
        off = np.minimum(doubt[partner, row], 1.0)
        return tuple(first), second, sine[partner, row], off

    def _solve(self, step: BlockPoles) -> None:
        """Add the poles of an irreducible part: the null vector of its equations."""
        number = {link: k for k, link in enumerate(step.links)}
        owned = [self.plan.mechanism.variables_of(pair) for pair in step.pairs]
        ends = [self.plan.ends[pair] for pair in step.pairs]
        tree = LoopTree(
            len(step.links),
            tuple((number[a], number[b]) for a, b in ends),
            tuple(k for k, of_pair in enumerate(owned) for _ in of_pair),
        )
        variables = [variable for of_pair in owned for variable in of_pair]
        vectors = self.motion.vectors[:, variables]
        block = self._blocks.get(step) or null_motion(tree, vectors)
        self._blocks[step] = block
        w = [block.w]
        if self._turned is not None:
            turned = self._turned.vectors[:, variables]
            w.append(null_motion_rate(tree, vectors, turned, block))
        growth = np.linalg.norm(block.inverse, axis=(1, 2))
        for pole in step.poles:
            i, j = (number[link] for link in pole)
            vector = tuple((order[:, j] - order[:, i]).T for order in w)
            error = np.minimum(EPS * growth / np.maximum(norm(vector[0]), EPS), 1.0)
            self._add(pole, _unit(vector), error, 1.0 / np.maximum(growth, 1.0))

    def link_rates(self, bodies: tuple[int, ...]) -> tuple[dict[int, Series], Floats]:
        """Return w relative to the ground by body, and a bound (n,) of its error.

        By the vector form of eq. (5) of Di Gregorio 2024, with a and b the links of the
        input: u_ab = x u_ak + y u_bk. It is 0/0 only where the axes on the right coincide,
        not where the rate of one of them vanishes.
        """
        a, b = self.plan.ends[self.plan.input]
        driven = self.unit[pole_of(a, b)]
        still = tuple(np.zeros_like(order) for order in driven)
        w, doubt = {a: still, b: driven}, np.zeros(len(self.motion))
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            for body in set(bodies) - {a, b}:
                one, other = pole_of(a, body), pole_of(b, body)
                normal = _cross(self.unit[one], self.unit[other])
                square = _product(dot, normal, normal)
                along = _product(dot, _cross(driven, self.unit[other]), normal)
                w[body] = _product(np.multiply, self.unit[one], _ratio(along, square))
                off = (self.error[one] + self.error[other]) / np.sqrt(square[0])
                doubt = np.maximum(doubt, off)
        if 0 in w:
            ground = w[0]
            for body, series in w.items():
                w[body] = tuple(x - y for x, y in zip(series, ground, strict=True))
        return w, np.nan_to_num(doubt, nan=1.0, posinf=1.0)

    def circles(self, pole: Pole) -> Floats:
        """Return (n, 2, 3) unit normals of two great circles of a pole of links.

        Through third links whose poles with both are known, where it was found otherwise;
        NaN without two.
        """
        nothing, bodies = np.full((len(self.motion), 2, 3), np.nan), self.plan.pole(*pole)
        if bodies is None:
            return nothing
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            if bodies not in self._drawn:
                (i, j), others = bodies, (k for k in self.plan.bodies if k not in bodies)
                via = [k for k in others if {pole_of(i, k), pole_of(j, k)} <= {*self.unit}]
                if len(via) < 2:
                    return nothing
                first, second, *_ = self._two_circles(LinePole(bodies, 0, tuple(via)))
                self._drawn[bodies] = first[0], second[0]
            one, other = self._drawn[bodies]
            return np.stack([one / norm(one), other / norm(other)]).transpose(2, 0, 1)


def _product(of: Callable[[Floats, Floats], Floats], a: Series, b: Series) -> Series:
    """Return the series of a product of any kind (Leibniz)."""
    value = of(a[0], b[0])
    return (value, *(of(x, b[0]) + of(a[0], y) for x, y in zip(a[1:], b[1:], strict=True)))


def _ratio(a: Series, number: Series) -> Series:
    """Return the series of a quotient by a number."""
    value, changes = a[0] / number[0], zip(a[1:], number[1:], strict=True)
    return (value, *((x - value * y) / number[0] for x, y in changes))


def _unit(a: Series) -> Series:
    """Return the series of a vector made a unit vector; NaN where it is zero."""
    square, *changes = _product(dot, a, a)
    length = np.sqrt(square)
    return _ratio(a, (length, *(change / (2.0 * length) for change in changes)))


def _cross(a: Series, b: Series) -> Series:
    return _product(cross, a, b)


def _taken(stack: Floats, which: NDArray[np.intp]) -> Floats:
    """Return (3, n) from (lines, 3, n), its own line for each row."""
    return np.asarray(np.take_along_axis(stack, which[None, None], axis=0)[0])


@final
@dataclass(frozen=True)
class Bounds:
    """Bounds (n,) of the errors of directions (rad), of rates and of their derivatives."""

    direction: dict[Pole, Floats]
    rate: dict[Pole, Floats]
    acceleration_coefficient: dict[Pole, Floats]


def mended_and_bounded(
    poles: Iterable[Pole],
    axes: tuple[Mapping[Pole, int], Collection[Pole]],
    units: Mapping[Pole, Floats],
    drawn_errors: Mapping[Pole, Floats],
    rates: tuple[Mapping[int, Floats], Mapping[int, Floats]],
    weak: NDArray[np.bool_],
    solved: Equations,
) -> Bounds:
    """Return what poles of bodies are off by, and mend the directions of `weak` rows.

    Of unit vectors `units` (3, n) with the errors that they are `drawn_errors` (n,) by.
    Those come from the relative angular velocity where it is the better source. `axes` are
    the poles that are axes of pairs, and which of them are so but for the rounding of axes
    that links have in common; `rates` w and dw (3, n) of bodies, however found: what
    they differ by from the solution of the velocity equations is part of their error.
    """
    n = len(weak)
    pairs, rounded = axes
    poles = list(poles)
    bounds = Bounds(*({pole: np.full(n, np.nan) for pole in poles} for _ in range(3)))
    # Great circles turn in proportion to the axes that they are drawn through.
    tilt = solved.motion.orientation_error / EPS
    for rows, part, errors in solved.parts():
        if not len(rows):
            continue
        more, more_bent = part.second_order
        solved_w, solved_dw = (
            np.ascontiguousarray(array.transpose(1, 2, 0)) for array in (part.w, part.dw)
        )
        sizes, swings = ([norm(link) for link in links] for links in (solved_w, solved_dw))
        for pole in poles:
            i, j = pole
            size, swing = sizes[i] + sizes[j], swings[i] + swings[j]
            v, off = _relative(pole, rows, rates[0], solved_w)
            dv, off_bent = _relative(pole, rows, rates[1], solved_dw)
            length = np.maximum(norm(v), EPS * EPS)
            unit = units[pole][:, rows]
            drawn = np.nan_to_num(drawn_errors[pole][rows], nan=1.0)
            given = drawn
            if pole not in pairs and np.any(weak[rows]):
                slack = errors.slip * errors.sizes(i, j)[0] + norm(off) + EPS * size
                doubt = np.fmin(slack / length, 1.0)
                better = weak[rows] & (doubt < drawn)
                unit[:, better] = v[:, better] / length[better]
                given = np.where(better, doubt, drawn)
                units[pole][:, rows], drawn_errors[pole][rows] = unit, given
            rate, change, across = errors.along(i, j, unit)
            if pole in pairs:
                direction = errors.of_axis(pairs[pole])
                if pole in rounded:
                    apart = 1.0 + SAME_AXIS / errors.numbers
                    direction = direction + errors.slip * apart / length
            else:
                drift = np.fmin(drawn * tilt[rows], (across + more) / length)
                direction = given + drift
            rate += np.abs(dot(unit, off)) + errors.numbers * size + more
            rate += np.fmin(direction, 1.0) ** 2 * length
            change += np.abs(dot(unit, off_bent)) + errors.numbers * (size + swing)
            change += more_bent + direction * norm(dv)
            bad = ~(direction < USABLE_DIRECTION)
            if np.any(bad):
                _, all_w, all_dw = errors.off(*errors.sizes(i, j))
                rate[bad] = (norm(v) + all_w + errors.numbers * size)[bad]
                all_dw += norm(dv) + errors.numbers * (size + swing)
                change[bad] = all_dw[bad]
            bounds.direction[pole][rows] = direction
            bounds.rate[pole][rows], bounds.acceleration_coefficient[pole][rows] = (
                rate,
                change,
            )
    return bounds


def _relative(
    pole: Pole, rows: NDArray[np.intp], given: Mapping[int, Floats], solved_links: Floats
) -> tuple[Floats, Floats]:
    """Return rates (3, n) of a pole's links as they were given, and what they are off by.

    That is against the solution `solved_links` (links, 3, n) of the equations.
    """
    i, j = pole
    solved = solved_links[j] - solved_links[i]
    if i not in given or j not in given:
        return solved, np.zeros_like(solved)
    v = (given[j] - given[i])[:, rows]
    return v, v - solved


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
        How they are found, one of `spherekit.rates.request.ROUTES`.

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
        return signed(by_sequence(motion, wanted, route), motion, wanted, memory)


def field_of_rates(
    motion: Motion, wanted: Request, rates: LinkRates, memory: SignMemory
) -> PoleField:
    """Return the requested poles of a motion whose angular velocities are known.

    The pole of two links lies along their relative angular velocity; `by_equations` is
    true throughout.
    """
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        bodies = {b for pole in _body_poles(wanted) for b in pole} | set(wanted.bodies)
        w, dw = ({k: x[:, k].T.copy() for k in bodies} for x in (rates.w, rates.dw))
        solved = equations(motion, wanted.plan.input)
        flat = ~(rates.reciprocal_condition >= SINGULAR_RATIO) | np.isinf(solved.loss)
        status = motion.status.copy()
        status[flat & (status == Status.OK)] = Status.AT_SINGULARITY
        everywhere = np.ones(len(motion), dtype=bool)
        planned = PlannedPoles(wanted.plan, motion, "equations")
        field = _field(motion, wanted, planned, (w, dw), status, everywhere, solved)
        return signed(field, motion, wanted, memory)


def by_sequence(motion: Motion, wanted: Request, route: Route) -> PoleField:
    """Return the poles by the sequence of the plan, with any signs."""
    planned = PlannedPoles(wanted.plan, motion, route)
    rates, doubt = planned.link_rates(wanted.bodies)
    dw = {body: np.full_like(series[0], np.nan) for body, series in rates.items()}
    if wanted.derivatives:
        turning = np.full((2, len(motion), len(wanted.plan.ends), 3), np.nan)
        for pair, bodies in enumerate(wanted.plan.ends):
            for turned, body in zip(turning, bodies, strict=True):
                if body in rates:
                    turned[:, pair] = rates[body][0].T
        planned = planned.moving(motion.linearisation.pair_rates(*turning))
        rates, doubt = planned.link_rates(wanted.bodies)
        dw = {body: series[1] for body, series in rates.items()}
    w = {body: series[0] for body, series in rates.items()}
    status = motion.status.copy()
    solved = equations(motion, wanted.plan.input)
    weak = np.zeros(len(motion), dtype=bool)
    if route == "best":
        for pole in _body_poles(wanted):
            doubt = np.maximum(doubt, np.nan_to_num(planned.error[pole], nan=1.0))
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
    return _field(motion, wanted, planned, (w, dw), status, weak, solved)


def _field(
    motion: Motion,
    wanted: Request,
    planned: PlannedPoles,
    rates: tuple[dict[int, Floats], dict[int, Floats]],
    status: NDArray[np.int8],
    by_equations: NDArray[np.bool_],
    solved: Equations,
) -> PoleField:
    """Return what was found by the poles that were asked for, with any signs."""
    plan = wanted.plan
    rounded = {
        step.pole
        for step in plan.steps
        if isinstance(step, CoaxialPole) and step.pair in plan.rounded_axes
    }
    axes = axis_pairs(plan), rounded
    units = {pole: unit[0] for pole, unit in planned.unit.items()}
    bounds = mended_and_bounded(
        _body_poles(wanted), axes, units, planned.error, rates, by_equations, solved
    )
    no_rate = status != Status.OK
    for vectors in rates:
        for value in vectors.values():
            value[:, no_rate] = np.nan
    field = PoleField(
        status=status,
        by_equations=by_equations,
        by_kernel=np.zeros(len(motion), dtype=bool),
        loss=np.where(no_rate, np.nan, solved.loss),
    )
    for pole in wanted.poles:
        _add_pole(field, motion, wanted, planned, pole, rates, bounds)
    for pole in wanted.planes:
        field.planes[pole] = planned.circles(pole)
    for link, body in enumerate(plan.body):
        if body in rates[0]:
            field.w[link], field.dw[link] = (part[body].T for part in rates)
    return field


def _body_poles(wanted: Request) -> list[Pole]:
    """Return the wanted poles as poles of bodies, without those of links joined."""
    poles = (wanted.plan.pole(*pole) for pole in wanted.poles)
    return list(dict.fromkeys(pole for pole in poles if pole is not None))


def _add_pole(
    field: PoleField,
    motion: Motion,
    wanted: Request,
    planned: PlannedPoles,
    pole: Pole,
    rates: tuple[dict[int, Floats], dict[int, Floats]],
    bounds: Bounds,
) -> None:
    body_pole = wanted.plan.pole(*pole)
    if body_pole is None:
        add_locked(field, motion, pole)
        return
    (i, j), (w, dw) = (wanted.plan.body[link] for link in pole), rates
    unit, error = planned.unit[body_pole][0].copy(), bounds.direction[body_pole]
    # Nothing bounds what a singular configuration is off by; its status says so.
    judged = np.where(field.status == Status.OK, error, planned.error[body_pole])
    bad = motion.failed | ~(judged < USABLE_DIRECTION)
    unit[:, bad] = np.nan
    codes, angle = field.status.copy(), np.nan_to_num(planned.angle[body_pole])
    codes[bad & (codes == Status.OK)] = Status.ILL_CONDITIONED
    rate = change = np.full(len(motion), np.nan)
    if i in w and j in w:
        v, dv = w[j] - w[i], dw[j] - dw[i]
        rate, change, size = dot(v, unit), dot(dv, unit), norm(v)
        still = bad & (field.status == Status.OK)
        still &= size < NO_MOTION * np.maximum(1.0, norm(w[j]))
        codes[still], rate[still] = Status.NO_POLE, 0.0
        change[still & (norm(dv) < NO_MOTION)] = 0.0
        if body_pole not in axis_pairs(wanted.plan):
            both = norm(w[i]) + norm(w[j])
            angle = size / np.where(both > 0.0, both, 1.0)
    field.pole_status[pole], field.direction[pole] = codes, unit.T
    field.velocity_coefficient[pole] = rate
    field.acceleration_coefficient[pole] = change
    field.angle[pole], field.error[pole] = np.where(bad, np.nan, [angle, error])
    field.velocity_coefficient_error[pole], field.acceleration_coefficient_error[pole] = (
        np.where(np.isnan(value), np.nan, bound[body_pole])
        for value, bound in ((rate, bounds.rate), (change, bounds.acceleration_coefficient))
    )


def add_locked(field: PoleField, motion: Motion, pole: Pole) -> None:
    """Add the pole of two links that inputs at rest hold together: there is none."""
    good, n = field.status == Status.OK, len(motion)
    field.direction[pole] = np.full((n, 3), np.nan)
    field.angle[pole], field.error[pole] = np.full((2, n), np.nan)
    for rates in (
        field.velocity_coefficient,
        field.acceleration_coefficient,
        field.velocity_coefficient_error,
        field.acceleration_coefficient_error,
    ):
        rates[pole] = np.where(good, 0.0, np.nan)
    field.pole_status[pole] = np.where(good, Status.NO_POLE, field.status).astype(np.int8)
