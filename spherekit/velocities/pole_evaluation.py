"""Poles and coefficients at the rows of a motion, by the terms of rows.

Float64 gives what norms vouch for, quad precision the other rows. A route that is asked for
by its name takes directions and rates from the sequence of the plan instead.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache, partial
from typing import Any, Literal

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.errors import SolveError
from spherekit.geometry.vectors import nans
from spherekit.mechanism.pair_frames import SAME_AXIS_SINE
from spherekit.planning.pole_plan import Pole
from spherekit.positions.motion import Motion
from spherekit.status import Status
from spherekit.tolerances import EPS, NO_MOTION, SINGULAR_RATIO, USABLE_DIRECTION
from spherekit.velocities.decimal_rates import DecimalRates
from spherekit.velocities.direction_signs import SIGNED, SignContinuation, dot, norm, signed
from spherekit.velocities.elimination_order import (
    MAX_AMPLIFICATION,
    EliminationOrder,
    assign_elimination_orders,
    inverse_sizes,
)
from spherekit.velocities.geometry_rounding import GeometryRounding
from spherekit.velocities.input_columns import (
    MAX_CERTIFIED_DW_ERROR,
    MAX_CERTIFIED_ERROR_RAD,
    InputColumns,
)
from spherekit.velocities.pole_field import POLE_ERRORS, TURN_KNOWN, PoleField, axis_pairs
from spherekit.velocities.pole_request import ROUTES, Request, Route
from spherekit.velocities.pole_sequence import PlannedPoles
from spherekit.velocities.quad_precision_rows import recompute_in_quad
from spherekit.velocities.row_kernel import MIN_RECIPROCAL_CONDITION, RowKernel, row_kernel
from spherekit.wording import listing, nearest

INCONSISTENT = 1e-10
"""Velocity or acceleration equations that leave over more, relatively, have no solution."""
TRUSTED_CHANGE = 1e-2
"""Rates, or derivatives, that may be off by a larger part than this are lost."""
SECOND_ORDER = 4.0
"""Errors of second order, over those of first times the bend of the loops, at most."""

SIZES = SIGNED | {"w": 3, "dw": 3}
"""How many components parts of a field have; others have one."""

RowEngine = Literal["numpy", "compiled", "extended"]


def evaluate(
    motion: Motion,
    wanted: Request,
    memory: SignContinuation | None = None,
    route: Route = "best",
    engine: RowEngine = "numpy",
) -> PoleField:
    """Return the requested poles and coefficients at every row of a motion.

    Parameters
    ----------
    motion
        Any motion of the request's mechanism.
    wanted
        What to find, from `spherekit.velocities.pole_request.request`.
    memory
        Given for successive blocks of one motion, so that signs continue across them.
    route
        How they are found, one of `spherekit.velocities.pole_request.ROUTES`.
    engine
        What runs the terms: NumPy, heyoka, or quad precision for all rows.

    Raises
    ------
    SolveError
        If there is no such route.
    """
    if route not in ROUTES:
        raise SolveError(
            f'{motion.mechanism.name}: no route is "{route}"'
            f"{nearest(str(route), ROUTES) or ';'} Routes: {listing(ROUTES)}"
        )
    with np.errstate(all="ignore"):
        made = found(motion, wanted, engine, route)
        signed(made, motion, wanted, memory or SignContinuation())
    if route == "equations":
        made.by_equations[:] = True
    return made


@np.errstate(all="ignore")
def found(
    motion: Motion,
    wanted: Request,
    engine: RowEngine = "numpy",
    route: Route = "best",
    order: EliminationOrder | None = None,
) -> PoleField:
    """Return the poles by the terms, with any signs of secondary ones.

    Variables are eliminated in one `order`, if it is given; by default in the one that is
    regular at most rows, and at the other rows in orders of their own.
    """
    links = range(len(motion.mechanism.links))
    at = _Rows(motion, replace(wanted, links=frozenset(links)), engine, order)
    planned = cache(partial(PlannedPoles, wanted.plan, motion, route))
    if route in ("first", "conditioned"):
        at.follow(planned())
    field = PoleField(
        status=at.status,
        by_equations=at.wide,
        by_kernel=at.sure,
        by_decimals=at.by_decimals,
        loss=np.where(at.status == Status.OK, at.loss, np.nan),
    )
    for link in links:
        field.w[link], field.dw[link] = at.part("w", link).T, at.part("dw", link).T
    for pole in wanted.poles:
        _add_pole(field, at, pole, planned)
    field.planes.update({pole: planned().circles(pole) for pole in wanted.planes})
    for own_order, rows in at.reordered:
        field.put(rows, found(motion.rows(rows), wanted, engine, route, own_order))
    return field


class _Rows:
    """What the terms give at the rows of a motion.

    The kernel vouches for rows (n,) that are `sure`; `wide` ones are computed in quad
    precision. `errors[pole]` (4, n) are its `POLE_ERRORS`, in this order; `loss` (n,)
    is the part of the largest rate or derivative that may be off, infinite where they are
    lost. Rows `by_decimals` (n,) are those of the decimal sizes of the file, where the
    rounding of these leaves nothing of the rates. Rows that follow the sequence have the
    angular velocities `by_sequence` (3, n).
    The rows `reordered`, with the elimination order of each, are not computed here: that of
    the kernel is not regular there, though the velocity equations are.
    """

    def __init__(
        self,
        motion: Motion,
        wanted: Request,
        engine: RowEngine,
        order: EliminationOrder | None = None,
    ) -> None:
        self.motion, self.wanted = motion, wanted
        self.status, n = motion.status.copy(), len(motion)
        self.loss = np.zeros(n)
        self.sure, self.wide, self.by_decimals = np.zeros((3, n), dtype=bool)
        self.errors: dict[Pole, Floats] = {}
        self.apart: dict[Pole, Floats] = {}
        self.by_sequence: dict[int, Floats] = {}
        self._of: Mapping[str, Mapping[Any, list[int]]] = {}
        by: Literal["numpy", "compiled"] = "numpy" if engine == "extended" else engine
        kernel = row_kernel(motion, [wanted], by, order)
        self.reordered: list[tuple[EliminationOrder, Indices]] = []
        if kernel is None and order is None:
            self.reordered = self._reorder(np.full(n, np.inf))
        if kernel is None:
            self.status[self.status == Status.OK] = Status.AT_SINGULARITY
            return
        values = motion.values.T
        self._columns, self._aside = kernel.all_columns(values), kernel.row_bounds(values)
        self._places = kernel.row_bounds.slices
        self._of = kernel.input_columns[0].column_indices
        self._signed = kernel.input_columns[0].signed_poles
        for pole in self._of["error"]:
            self.errors[pole] = np.concatenate(
                [self.part(name, pole) for name in POLE_ERRORS]
            )
        self.sure = self._vouched() & ~motion.failed & (engine != "extended")
        self.wide = ~self.sure & ~motion.failed
        if order is None:
            self.reordered = self._reorder(self._bound("condition_number"))
            for _, rows in self.reordered:
                self.wide[rows] = False
        if np.any(self.wide):
            kernel = row_kernel(motion, [wanted], "numpy", order) or kernel
            self._widen(kernel, np.flatnonzero(self.wide))
            lost = self.wide & np.isinf(self.loss) & (self.status == Status.OK)
            if np.any(lost):
                self._compute_by_decimals(kernel, np.flatnonzero(lost))
        # Axes of pairs that are one but for rounding differ by that.
        pairs, rounded = axis_pairs(wanted.plan), wanted.plan.rounded_axes
        for links, errors in self.errors.items():
            pole = wanted.plan.pole(*links)
            if pole and wanted.plan.rounds[pole] and pairs.get(pole) in rounded:
                slack = SAME_AXIS_SINE * self._bound("rate_size")
                self.apart[links] = slack / norm(self.relative(links)[0])
                dv = norm(self.relative(links)[1])
                bent = (
                    SAME_AXIS_SINE * self._bound("acceleration_size")
                    + self.apart[links] * dv
                )
                turned = (bent + self.apart[links] * dv) / norm(self.relative(links)[0])
                errors += self.apart[links], slack, bent, turned
        lost = np.isinf(self.loss) & (self.status == Status.OK)
        self.status[lost] = Status.AT_SINGULARITY

    def part(self, name: str, key: Any) -> Floats:
        """Return (components, n) of a part of a pole or link; NaN where it is not known.

        A direction may be known where rates are not.
        """
        if not self._of:
            return nans((SIZES.get(name, 1), len(self.status)))
        made = self._columns[self._of[name][key]]
        if name == "w":
            made = self.by_sequence.get(key, made)
        if name == "direction":
            return np.where(self.motion.failed, np.nan, made)
        return np.where(self.status == Status.OK, made, np.nan)

    def relative(self, pole: Pole) -> tuple[Floats, Floats]:
        """Return (3, n) the relative angular velocity of links, and its derivative."""
        i, j = pole
        w, dw = (self.part(name, j) - self.part(name, i) for name in ("w", "dw"))
        return w, dw

    def follow(self, planned: PlannedPoles) -> None:
        """Take rates from the sequence of the plan, derivatives by the terms.

        What they differ by from the terms is part of their error.
        """
        w, doubt = planned.link_rates(self.wanted.bodies)
        self.sure[:] = self.wide[:] = False
        lost = ~(doubt < USABLE_DIRECTION) & (self.status == Status.OK)
        self.status[lost] = Status.ILL_CONDITIONED
        before = {pole: self.relative(pole)[0] for pole in self.errors}
        of_links = enumerate(self.wanted.plan.body)
        self.by_sequence = {link: w[body] for link, body in of_links if body in w}
        for pole, errors in self.errors.items():
            errors[1] += norm(self.relative(pole)[0] - before[pole])

    def _reorder(self, condition_numbers: Floats) -> list[tuple[EliminationOrder, Indices]]:
        """Return elimination orders for rows at which that of the kernel is not regular.

        Parameters
        ----------
        condition_numbers
            (n,) those of the equations by the kernel: the size of the Jacobian times that
            of the inverse that its order gives. NaN where a pivot is zero.
        """
        doubtful = (
            ~(condition_numbers <= 1.0 / MIN_RECIPROCAL_CONDITION) & ~self.motion.failed
        )
        rows = np.flatnonzero(doubtful)
        if not len(rows):
            return []
        jacobians = self.motion.linearisation.jacobian[rows]
        passive = jacobians[:, :, list(self.motion.passive_variables)]
        least = inverse_sizes(passive) * np.linalg.norm(passive, axis=(1, 2))
        # Near a singular configuration every order gives a large inverse.
        is_regular = condition_numbers[rows] <= MAX_AMPLIFICATION * least
        misordered = ~(is_regular | np.isinf(least))
        rows = rows[misordered]
        return [
            (own_order, rows[some])
            for own_order, some in assign_elimination_orders(
                jacobians[misordered], self.motion.passive_variables
            )
        ]

    def _bound(self, name: str) -> Floats:
        """Return a quantity (n,) of `RowKernel.row_bounds` by its name."""
        return self._aside[self._places[name]][0]

    def _vouched(self) -> Bools:
        """Return which rows (n,) norms vouch for: each pole is known or surely none."""
        good = self._bound("condition_number") <= 1.0 / MIN_RECIPROCAL_CONDITION
        good &= self._bound("curvature_uncertainty") <= 1.0
        good &= self._bound("dw_error") <= MAX_CERTIFIED_DW_ERROR
        for pole in self._signed:
            direction, rate, change, _ = self.errors[pole]
            v, dv = map(norm, self.relative(pole))
            doubt = direction + 2.0 * MAX_CERTIFIED_ERROR_RAD / TURN_KNOWN * change / v
            none = (v <= rate) & (dv <= change) & (change <= NO_MOTION)
            good &= (doubt <= MAX_CERTIFIED_ERROR_RAD) | none
        return good

    def _widen(self, kernel: RowKernel, rows: Indices) -> None:
        """Compute rows again in quad precision, and what they may be off by.

        The loops of these rows are closed to 33 digits. The error that remains is that of
        the rounded numbers of the geometry (`GeometryRounding`).
        """
        tree = self.motion.linearisation.tree
        quad_rows = recompute_in_quad(kernel, self.motion.values[rows].T)
        columns = quad_rows.columns
        self._columns[:, rows] = columns
        self._aside[:, rows] = quad_rows.bounds
        condition_number = self._bound("condition_number")[rows]
        rate_size = self._bound("rate_size")[rows]
        acceleration_size = self._bound("acceleration_size")[rows]
        # Rows that Newton's method did not close stay open as they were.
        closed_gap = EPS * (2.0 + tree.longest_loop)
        gap = np.where(quad_rows.is_closed, closed_gap, self.motion.residual_bound[rows])

        ways = 3 * len(tree.chords)
        inverse = quad_rows.bounds[self._places["inverse"]].reshape(
            len(self.motion.passive_variables), ways, len(rows)
        )
        has_contacts = self.motion.mechanism.has_contacts

        def spread(name: str, key: Any) -> Floats:
            return np.sum(quad_rows.opening_changes[self._of[name][key]], axis=0)

        links = self._of["w"]
        rounding = GeometryRounding(
            gap=gap,
            axis_error=EPS * (2.0 + tree.longest_path),
            loop_error=EPS * (2.0 + tree.longest_loop),
            w=np.array([columns[at] for at in links.values()]),
            dw=np.array([columns[at] for at in self._of["dw"].values()]),
            w_spread=np.array([spread("w", link) for link in links]),
            dw_spread=np.array([spread("dw", link) for link in links]),
            turns=self._turns_of_links(rows, inverse),
            moved=np.max(np.sum(np.abs(inverse), axis=1), axis=0, initial=0.0),
            profile_speed=rate_size if has_contacts else np.zeros_like(gap),
            profile_bend=acceleration_size if has_contacts else np.zeros_like(gap),
        )
        loss = rounding.loss
        # Residuals of the equations relative to their terms, or to 1 if these are smaller.
        relative_residual = np.maximum(
            self._bound("rate_residual")[rows] / np.maximum(rate_size, 1.0),
            self._bound("acceleration_residual")[rows] / np.maximum(acceleration_size, 1.0),
        )
        held = (loss <= TRUSTED_CHANGE) & (relative_residual < INCONSISTENT)
        held &= condition_number * SINGULAR_RATIO <= 1.0
        self.loss[rows] = np.where(held, loss, np.inf)
        more = SECOND_ORDER * np.fmin(self._bound("kantorovich_number")[rows], 0.5)
        for pole, errors in self.errors.items():
            v, dv = (part[:, rows] for part in self.relative(pole))
            errors[:, rows] = rounding.pole_errors(
                pole,
                v=v,
                dv=dv,
                direction_dq=columns[self._of["direction_dq"][pole]],
                spreads={name: spread(name, pole) for name in SIGNED},
                is_pair_axis=pole not in self._signed,
                second_order=more,
            )

    def _compute_by_decimals(self, kernel: RowKernel, rows: Indices) -> None:
        """Compute rows that are too near a singularity for rounded sizes."""
        plan = self.wanted.plan
        decimal_rates = DecimalRates.of(self.motion.rows(rows), plan.input)
        if decimal_rates is None:
            return
        good = decimal_rates.is_known & (decimal_rates.loss <= TRUSTED_CHANGE)
        rows = rows[good]
        self.by_decimals[rows] = True
        self.loss[rows] = decimal_rates.loss[good]

        def put(name: str, key: Any, numbers: Floats) -> None:
            for at, number in zip(self._of[name][key], numbers, strict=True):
                if not kernel.is_constant[at]:  # which others may share
                    self._columns[at, rows] = number[good]

        for link in self._of["w"]:
            put("w", link, decimal_rates.w[:, link].T.astype(float))
            put("dw", link, decimal_rates.dw[:, link].T.astype(float))
        pairs = axis_pairs(plan)
        for pole, errors in self.errors.items():
            body_pole = plan.pole(*pole)
            assert body_pole is not None
            numbers, bounds = decimal_rates.pole(pole, pairs.get(body_pole))
            for name, part in numbers.items():
                put(name, pole, part)
            errors[:, rows] = bounds[:, good]

    def _turns_of_links(self, rows: Indices, inverse: Floats) -> Floats:
        """Return how links turn (ways, links, 3, rows) as the loops open, rad per rad.

        `inverse` (free variables, ways, rows) says how far variables move; three ways for
        each loop.
        """
        linearisation = self.motion.linearisation
        tree, vectors = linearisation.tree, linearisation.vectors[rows]
        turns = np.zeros((inverse.shape[1], tree.count, 3, len(rows)))
        for turn, moved in zip(turns, inverse.swapaxes(0, 1), strict=True):
            rates = np.zeros((len(rows), vectors.shape[1]))
            rates[:, list(self.motion.passive_variables)] = moved.T
            turn[:] = np.moveaxis(tree.body_rates(vectors, rates), 0, -1)
        return turns


def _add_pole(
    field: PoleField, at: _Rows, pole: Pole, planned: Callable[[], PlannedPoles]
) -> None:
    """Add a pole; its direction by the plan where rates leave it open."""
    body_pole, ok = at.wanted.plan.pole(*pole), at.status == Status.OK
    if body_pole is None:
        add_locked(field, at.motion, pole)
        return
    unit, turn = at.part("direction", pole), at.part("direction_dq", pole)
    rate, change, angle = (
        at.part(name, pole)[0]
        for name in ("velocity_coefficient", "acceleration_coefficient", "angle")
    )
    direction, e_rate, e_change, e_turn = at.errors.get(pole, np.full((4, len(ok)), np.inf))
    unknown, (v, dv) = ~(direction < USABLE_DIRECTION), at.relative(pole)
    open_ = ~at.motion.failed & (unknown | bool(at.by_sequence))
    # Where constraints repeat each other, great circles may be one but for rounding.
    redundant = any(group.redundant for group in at.motion.assembly.groups)
    if np.any(open_) and (at.by_sequence or not redundant):
        axis = planned().unit[body_pole]
        axis = axis * np.where(~unknown & (dot(unit, axis) < 0.0), -1.0, 1.0)
        # Axes are off as the configuration is.
        off = np.fmin(at.motion.orientation_error, at.motion.fold_error)
        off = planned().error[body_pole] * np.maximum(off / EPS, 1.0)
        unit[:, open_] = axis[:, open_]
        direction[open_] = (off + at.apart.get(pole, 0.0))[open_]
        rate[open_], change[open_] = dot(v, unit)[open_], dot(dv, unit)[open_]
        part = np.where(direction < USABLE_DIRECTION, direction, 1.0)
        e_rate[open_] += (part * norm(v))[open_]
        e_change[open_] += (part * norm(dv))[open_]
        if body_pole not in axis_pairs(at.wanted.plan):
            turn[:, open_ & unknown] = np.nan
    bad = at.motion.failed | ~(direction < USABLE_DIRECTION)
    unit[:, bad] = np.nan
    # How a direction turns is left out where it may be off by too much.
    has_six_digits = e_turn < TURN_KNOWN * np.maximum(1.0, norm(turn))
    turn[:, bad | ~has_six_digits] = np.nan
    codes = at.status.copy()
    codes[bad & ok] = Status.ILL_CONDITIONED
    w = norm(at.part("w", pole[1]))
    still = bad & ok & (norm(v) < NO_MOTION * np.maximum(1.0, w))
    codes[still] = Status.NO_POLE
    rate[bad] = change[bad] = np.nan
    rate[still] = 0.0
    change[still & (norm(dv) < NO_MOTION)] = 0.0
    field.pole_status[pole], field.direction[pole] = codes, unit.T
    field.direction_dq[pole] = turn.T
    field.velocity_coefficient[pole], field.acceleration_coefficient[pole] = rate, change
    field.angle[pole], field.error[pole] = np.where(bad, np.nan, [angle, direction])
    field.velocity_coefficient_error[pole] = np.where(np.isnan(rate), np.nan, e_rate)
    field.acceleration_coefficient_error[pole] = np.where(
        np.isnan(change), np.nan, e_change
    )
    field.direction_dq_error[pole] = np.where(np.isnan(turn[0]), np.nan, e_turn)


def vouched_field(
    moving: InputColumns, columns: Floats, motion: Motion, wanted: Request
) -> PoleField:
    """Return the poles of rows by all columns (columns, n), for which a kernel vouches."""
    directions, n = moving.column_indices["direction"], len(motion)
    field = PoleField(
        status=motion.status,
        pole_status=dict.fromkeys(directions, motion.status),
        by_equations=np.zeros(n, dtype=bool),
        by_kernel=np.ones(n, dtype=bool),
        by_decimals=np.zeros(n, dtype=bool),
        loss=np.zeros(n),
    )
    for name, places in moving.column_indices.items():
        for key, at in places.items():
            part = columns[at]
            getattr(field, name)[key] = part.T if len(at) > 1 else part[0]
    for pole in set(wanted.poles) - directions.keys():
        add_locked(field, motion, pole)
    return field


def add_locked(field: PoleField, motion: Motion, pole: Pole) -> None:
    """Add the pole of two links that inputs at rest hold together: there is none."""
    good, n = field.status == Status.OK, len(motion)
    field.pole_status[pole] = np.where(good, Status.NO_POLE, field.status).astype(np.int8)
    for name in (*SIGNED, "angle", *POLE_ERRORS):
        count = (3,) * (SIGNED.get(name) == 3)
        rest = np.where(good, 0.0, np.nan) if "coefficient" in name else nans((n, *count))
        getattr(field, name)[pole] = rest
