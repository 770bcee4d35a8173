"""Velocities and poles at the rows of a motion, by up to three methods per row.

1. A kernel evaluates all rows in float64. Bounds by norms certify most of them.
2. The other rows are computed again in quad precision, and their errors are measured.
3. Very near a singularity, sizes rounded to float64 determine no digit of the rates. Such
   rows are computed from the decimal sizes of the file.

Symbols: w are the angular velocities of links per unit rate of the moving input, dw their
derivatives with respect to this input. v and dv are the differences of these for the two
links of a pole.
"""

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.geometry.vectors import nans, norm_columns
from spherekit.mechanism.pair_frames import SAME_AXIS_SINE
from spherekit.planning.pole_plan import Pole
from spherekit.positions.motion import Motion
from spherekit.status import Status
from spherekit.tolerances import (
    EPS,
    MAX_RATE_ERROR,
    MAX_RATE_RESIDUAL,
    NO_MOTION,
    SINGULAR_RATIO,
    USABLE_DIRECTION,
)
from spherekit.velocities.decimal_rates import DecimalRates
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
)
from spherekit.velocities.pole_field import (
    MAX_DIRECTION_DQ_ERROR,
    POLE_ERRORS,
    POLE_QUANTITIES,
    SIGNED_COMPONENTS,
    axis_pairs,
)
from spherekit.velocities.pole_request import Request
from spherekit.velocities.pole_sequence import PlannedPoles
from spherekit.velocities.quad_precision_rows import QuadPrecisionRows, recompute_in_quad
from spherekit.velocities.row_kernel import (
    MAX_KANTOROVICH_NUMBER,
    MIN_RECIPROCAL_CONDITION,
    RowKernel,
    row_kernel,
)

SECOND_ORDER_FACTOR = 4.0
"""Factor in the bound of the terms of second order in an error.

The bound is this factor times the terms of first order, times the number in Kantorovich's
theorem. The number measures how strongly the loops are curved.
"""

COMPONENT_COUNTS = SIGNED_COMPONENTS | {"w": 3, "dw": 3}
"""Number of components of the quantities of a row. Other quantities have one component."""

RowEngine = Literal["numpy", "compiled", "extended"]
"""What evaluates the expressions: NumPy, heyoka, or quad precision for all rows."""


class RowVelocities:
    """Velocities and poles at the n rows of a motion while one input moves.

    A pole is the axis about which one link rotates relative to another one. Other inputs
    are locked. w are the angular velocities of the links per unit rate of the moving input,
    and dw their derivatives with respect to this input.

    Attributes
    ----------
    motion, request
        The configurations, and the poles and links to compute.
    status
        (n,) status of the motion. Rows whose rates are not determined are AT_SINGULARITY.
    is_certified
        (n,) rows whose float64 results the bounds of the kernel certify.
    is_quad_precision
        (n,) rows that were computed in quad precision.
    is_decimal
        (n,) rows that were computed from the decimal sizes of the file.
    relative_error_bound
        (n,) bound of the errors of w and dw by the velocity equations, relative to the
        largest vector of any link or to 1. It is 0 for certified rows and for rows that are
        not computed. It is infinite if the rates of a computed row are not determined.
    pole_errors
        (n,) error bounds of each pole, by their names in `POLE_ERRORS`.
    axis_separations
        (n,) for poles that are the common axis of several pairs: angle (rad) by which the
        rounding of these axes can turn the pole. Other poles have no entry.
    planned_w
        (3, n) by link, angular velocities that the plan of the poles gives. Empty if the
        velocity equations give them.
    reordered
        Further elimination orders, each with the rows (k,) that it suits better than the
        order of the kernel. The velocity equations are regular at these rows, but the
        elimination in the kernel meets a pivot that is nearly zero. These rows are not
        computed here.
    """

    def __init__(
        self,
        motion: Motion,
        request: Request,
        engine: RowEngine,
        order: EliminationOrder | None = None,
    ) -> None:
        """Compute all rows.

        Parameters
        ----------
        motion, request
            The configurations, and what to compute.
        engine
            What evaluates the expressions.
        order
            The order in which variables are eliminated. By default an order is chosen that
            is regular at as many rows as possible, and `reordered` can have further orders
            for the other rows.
        """
        self.motion = motion
        self.request = request
        n = len(motion)
        self.status = motion.status.copy()
        self.relative_error_bound = np.zeros(n)
        self.is_certified = np.zeros(n, dtype=bool)
        self.is_quad_precision = np.zeros(n, dtype=bool)
        self.is_decimal = np.zeros(n, dtype=bool)
        self.pole_errors: dict[Pole, dict[str, Floats]] = {}
        self.axis_separations: dict[Pole, Floats] = {}
        self.planned_w: dict[int, Floats] = {}
        self.reordered: list[tuple[EliminationOrder, Indices]] = []
        # Indices of columns by quantity, then by pole or link. Empty without a kernel.
        self._column_indices: Mapping[str, Mapping[Any, list[int]]] = {}

        float_engine: Literal["numpy", "compiled"] = (
            "numpy" if engine == "extended" else engine
        )
        kernel = row_kernel(motion, [request], float_engine, order)
        if kernel is None:
            if order is None:
                self.reordered = self._find_reordered_rows(np.full(n, np.inf))
            self.status[self.status == Status.OK] = Status.AT_SINGULARITY
            return

        values = motion.values.T
        self._columns = kernel.all_columns(values)
        self._bounds = kernel.row_bounds(values)
        self._bound_slices = kernel.row_bounds.slices
        self._column_indices = kernel.input_columns[0].column_indices
        self._reversible_poles = kernel.input_columns[0].reversible_poles
        for pole in self._column_indices[POLE_ERRORS[0]]:
            self.pole_errors[pole] = {
                name: self.quantity(name, pole)[0] for name in POLE_ERRORS
            }
        self.is_certified = self._find_certified_rows() & ~motion.failed
        self.is_certified &= engine != "extended"
        self.is_quad_precision = ~self.is_certified & ~motion.failed
        if order is None:
            condition_numbers = self._bound("condition_number")
            self.reordered = self._find_reordered_rows(condition_numbers)
            for _, rows in self.reordered:
                self.is_quad_precision[rows] = False

        if np.any(self.is_quad_precision):
            # Quad precision needs a kernel that is not compiled.
            kernel = row_kernel(motion, [request], "numpy", order) or kernel
            self._compute_in_quad(kernel, np.flatnonzero(self.is_quad_precision))
            is_lost = (
                self.is_quad_precision
                & np.isinf(self.relative_error_bound)
                & (self.status == Status.OK)
            )
            if np.any(is_lost):
                self._compute_from_decimals(kernel, np.flatnonzero(is_lost))
        self._add_errors_of_common_axes()
        is_lost = np.isinf(self.relative_error_bound) & (self.status == Status.OK)
        self.status[is_lost] = Status.AT_SINGULARITY

    def quantity(self, name: str, key: Any) -> Floats:
        """Return a quantity (components, n) of a pole or link, at n rows (configurations).

        A pole is the axis about which two links rotate relative to each other. The quantity
        is NaN in rows without a configuration. In other rows whose status is not OK, all
        quantities but directions are NaN. If no row has rates, directions are NaN, too.

        Parameters
        ----------
        name
            Field of `PoleField`, such as "w", the angular velocity of a link per unit rate
            of the input. Usually "w" is the solution of the velocity equations. After a
            call of `use_planned_velocities` it is computed from poles.
        key
            The pole as indices of its links, or the index of one link.
        """
        if not self._has_rates:
            # The velocity equations are singular in all rows, so nothing was computed.
            return nans((COMPONENT_COUNTS.get(name, 1), len(self.status)))
        values = self._columns[self._column_indices[name][key]]
        if name == "w":
            values = self.planned_w.get(key, values)
        if name == "direction":
            return np.where(self.motion.failed, np.nan, values)
        return np.where(self.status == Status.OK, values, np.nan)

    @property
    def _has_rates(self) -> bool:
        """Whether the velocity equations can be solved for the rates at any row.

        A row is one configuration. If the equations are singular at all rows, no quantity
        is computed and there are no columns.
        """
        return bool(self._column_indices)

    def relative_velocity(self, pole: Pole) -> Floats:
        """Return v (3, n), the difference of the angular velocities of two links."""
        first, second = pole
        return self.quantity("w", second) - self.quantity("w", first)

    def relative_velocity_derivative(self, pole: Pole) -> Floats:
        """Return dv (3, n), the difference of the derivatives of two links."""
        first, second = pole
        return self.quantity("dw", second) - self.quantity("dw", first)

    def use_planned_velocities(self, planned_poles: PlannedPoles) -> None:
        """Replace the angular velocities of links by those that follow from known poles.

        A pole is the axis of the relative rotation of two links. Until this call, the
        velocity equations gave the angular velocities. The plan of the poles is another
        method: poles are intersections of great circles, one after another. It is used on
        the routes "first" and "conditioned". The derivatives of the angular velocities
        still come from the equations.

        The error bounds of the equations do not apply to the plan. Three things are changed
        in place:

        - No row counts any more as certified (its error bounds are small enough) or as
          computed in quad precision.
        - Both methods give the relative angular velocity of the two links of a pole, per
          unit rate of the input. The size of the difference is added to the error of the
          velocity coefficient of the pole, which is this velocity along the pole.
        - Rows in which the plan gives a direction with an error above `USABLE_DIRECTION`
          (rad) become ILL_CONDITIONED.

        Parameters
        ----------
        planned_poles
            The poles by the plan, at the same rows.
        """
        # By body of the plan. A body is a set of links that do not move relative to each
        # other while one input moves and all others are locked. `w` has the requested
        # bodies only.
        w, direction_error = planned_poles.link_rates(self.request.bodies)
        self.is_certified[:] = False
        self.is_quad_precision[:] = False
        is_uncertain = np.isnan(direction_error) | (direction_error >= USABLE_DIRECTION)
        self.status[is_uncertain & (self.status == Status.OK)] = Status.ILL_CONDITIONED

        # The relative angular velocity (3, n) of the links of each pole.
        velocities_by_equations = self._pole_velocities()
        # From here on, `quantity` returns the velocities of the plan.
        self.planned_w = {
            link: w[body] for link, body in enumerate(self.request.plan.body) if body in w
        }
        velocities_by_plan = self._pole_velocities()
        for pole, errors in self.pole_errors.items():
            errors["velocity_coefficient_error"] += norm_columns(
                velocities_by_plan[pole] - velocities_by_equations[pole]
            )

    def _pole_velocities(self) -> dict[Pole, Floats]:
        """Return the relative angular velocity (3, n) of the links of each pole."""
        return {pole: self.relative_velocity(pole) for pole in self.pole_errors}

    def _bound(self, name: str) -> Floats:
        """Return the quantity (n,) of `RowKernel.row_bounds` with a given name."""
        return self._bounds[self._bound_slices[name]][0]

    def _find_certified_rows(self) -> Bools:
        """Return a mask (n,) of rows (configurations) with small error bounds in float64.

        These rows are certified. All other rows are computed again in quad precision. In a
        certified row, the velocity equations are far from singular. For each pole (the axis
        about which two links rotate relative to each other), either the direction of the
        pole is accurate, or its two links certainly do not move relative to each other.
        """
        is_certified = self._bound("condition_number") <= 1.0 / MIN_RECIPROCAL_CONDITION
        # The curvature uncertainty exceeds 1 if the two profiles of a contact have nearly
        # the same curvature. Such profiles hardly determine their motion.
        is_certified &= self._bound("curvature_uncertainty") <= 1.0
        # dw are the derivatives of the angular velocities of all links with respect to
        # the input.
        is_certified &= self._bound("dw_error") <= MAX_CERTIFIED_DW_ERROR
        # Poles that are axes of pairs (joints) are known exactly. The directions of all
        # other poles (`_reversible_poles`) follow from the relative angular velocities v of
        # their links. If two links do not move relative to each other, their pole has no
        # direction that could be wrong.
        for pole in self._reversible_poles:
            errors = self.pole_errors[pole]
            v_size = norm_columns(self.relative_velocity(pole))
            dv_size = norm_columns(self.relative_velocity_derivative(pole))
            is_certified &= _is_direction_accurate(errors, v_size) | _is_certainly_at_rest(
                errors, v_size, dv_size
            )
        return is_certified

    def _find_reordered_rows(
        self, condition_numbers: Floats
    ) -> list[tuple[EliminationOrder, Indices]]:
        """Return elimination orders for rows in which the usual order loses many digits.

        An elimination order says which variables are eliminated from which loop of the
        velocity equations. The kernel uses one order for all rows (configurations), the
        usual order. In some rows a step of this order divides by nearly zero, although the
        equations are regular. Another order is used there.

        Parameters
        ----------
        condition_numbers
            (n,) for each row the norm of the Jacobian times the norm of the inverse that
            the usual order gives. NaN if a divisor is zero.

        Returns
        -------
        Orders with the rows (k,) for which each of them is used.
        """
        # A comparison with NaN is False, so NaN counts as not good.
        is_good = condition_numbers <= 1.0 / MIN_RECIPROCAL_CONDITION
        doubtful_rows = np.flatnonzero(~is_good & ~self.motion.failed)
        if not len(doubtful_rows):
            return []
        # The least condition number that any order can give in each of these rows, infinite
        # in singular configurations.
        least_numbers = self._least_condition_numbers(doubtful_rows)
        # The usual order is good enough if its condition number is not much larger.
        has_good_order = condition_numbers[doubtful_rows] <= (
            MAX_AMPLIFICATION * least_numbers
        )
        is_singular = np.isinf(least_numbers)
        rows = doubtful_rows[~has_good_order & ~is_singular]
        return [
            (order, rows[indices])
            for order, indices in assign_elimination_orders(
                self.motion.linearisation.jacobian[rows], self.motion.passive_variables
            )
        ]

    def _least_condition_numbers(self, rows: Indices) -> Floats:
        """Return the least condition numbers that any elimination order can give.

        An elimination order is the order in which variables are eliminated from the loop
        equations. The least condition numbers (k,) are the condition numbers of the exact
        inverse of the equations of the passive variables (which no input sets), for k rows.
        The numbers are infinite at singular configurations.
        """
        jacobians = self.motion.linearisation.jacobian[rows]
        passive_equations = jacobians[:, :, list(self.motion.passive_variables)]
        sizes = np.linalg.norm(passive_equations, axis=(1, 2))
        return inverse_sizes(passive_equations) * sizes

    def _compute_in_quad(self, kernel: RowKernel, rows: Indices) -> None:
        """Compute rows (k,) again in quad precision, and bound their errors.

        The new values replace the columns of these rows, their relative error bounds and
        the error bounds of their poles, in place. The loops of these rows are closed to 33
        digits. The remaining error is caused by the rounding of the sizes of the mechanism
        (`GeometryRounding`). The relative error bound is infinite in rows whose angular
        velocities are not determined accurately enough.

        Parameters
        ----------
        kernel
            The expressions of all columns, which NumPy evaluates in quad precision.
        rows
            (k,) indices of the rows.
        """
        quad_rows = recompute_in_quad(kernel, self.motion.values[rows].T)
        # Both arrays have the rows of the motion along their last axis.
        self._columns[:, rows] = quad_rows.columns
        self._bounds[:, rows] = quad_rows.bounds
        # Sums of the sizes of all terms of the velocity and the acceleration equations.
        rate_size = self._bound("rate_size")[rows]
        acceleration_size = self._bound("acceleration_size")[rows]
        rounding = self._make_geometry_rounding(quad_rows, rows)

        # Residuals of the equations relative to their terms, or to 1 if these are smaller.
        relative_residual = np.maximum(
            self._bound("rate_residual")[rows] / np.maximum(rate_size, 1.0),
            self._bound("acceleration_residual")[rows] / np.maximum(acceleration_size, 1.0),
        )
        # The rates are accurate if their bound is small, if they satisfy all equations, and
        # if the equations are not singular.
        is_accurate = rounding.relative_error_bound <= MAX_RATE_ERROR
        is_accurate &= relative_residual < MAX_RATE_RESIDUAL
        is_accurate &= self._bound("condition_number")[rows] * SINGULAR_RATIO <= 1.0
        self.relative_error_bound[rows] = np.where(
            is_accurate, rounding.relative_error_bound, np.inf
        )

        # The bounds of `rounding` are linear in the opening of the loops. The terms of
        # second order are in proportion to the number in Kantorovich's theorem. The theorem
        # says nothing about numbers above its limit. These numbers, and NaN, are replaced
        # by the limit.
        second_order = SECOND_ORDER_FACTOR * np.fmin(
            self._bound("kantorovich_number")[rows], MAX_KANTOROVICH_NUMBER
        )
        # The error bounds of each pole. Spreads say by how much its quantities change as
        # the loops open. A pole that is not among the signed poles is the axis of a pair.
        for pole, errors in self.pole_errors.items():
            bounds = rounding.pole_errors(
                pole,
                v=self.relative_velocity(pole)[:, rows],
                dv=self.relative_velocity_derivative(pole)[:, rows],
                direction_dq=quad_rows.columns[self._column_indices["direction_dq"][pole]],
                spreads={
                    name: self._spread(quad_rows, name, pole) for name in SIGNED_COMPONENTS
                },
                is_pair_axis=pole not in self._reversible_poles,
                second_order=second_order,
            )
            for name, error in errors.items():
                error[rows] = bounds.get(name, np.nan)

    def _make_geometry_rounding(
        self, quad_rows: QuadPrecisionRows, rows: Indices
    ) -> GeometryRounding:
        """Return the effect of rounded sizes on rows (k,) computed in quad precision.

        The sizes of the mechanism are rounded to float64, so the axes of links are tilted
        by about `EPS` rad. Therefore the loops remain open by a small angle, the gap. The
        result computes bounds of the errors that the gap causes.

        Parameters
        ----------
        quad_rows
            The results of these rows.
        rows
            (k,) indices of the rows in the motion.
        """
        tree = self.motion.linearisation.tree
        # The rounded axes of all pairs on a way add up to a tilt at its end, at most `EPS`
        # for each. `longest_loop` and `longest_path` are the largest numbers of variables
        # in a loop, and on the way from the ground to a link. As a margin, the bounds have
        # two more terms.
        loop_error = EPS * (2.0 + tree.longest_loop)
        axis_error = EPS * (2.0 + tree.longest_path)
        # Closed loops are open by these tilts. Rows that Newton's method did not close stay
        # open as they were.
        gap = np.where(quad_rows.is_closed, loop_error, self.motion.residual_bound[rows])
        # A chord is a pair that closes a loop. Each loop can open about three axes, so
        # there are three directions of opening for each loop.
        direction_count = 3 * len(tree.chords)
        # Inverse of the loop equations (passive variables, directions, k): movement of the
        # variables per unit opening of a loop.
        inverse = quad_rows.bounds[self._bound_slices["inverse"]].reshape(
            len(self.motion.passive_variables), direction_count, len(rows)
        )
        # The movements of each variable are added over all directions of opening. The
        # largest sum of all variables counts.
        movements = np.sum(np.abs(inverse), axis=1)
        largest_movement = np.max(movements, axis=0, initial=0.0)
        # Only contacts have profiles, whose sizes are rounded too. The effect is bounded by
        # the sums of the sizes of all terms of the velocity equations (`rate_size`) and of
        # the acceleration equations (`acceleration_size`).
        has_contacts = self.motion.mechanism.has_contacts
        no_profiles = np.zeros_like(gap)
        w_indices = self._column_indices["w"]
        dw_indices = self._column_indices["dw"]
        return GeometryRounding(
            gap=gap,
            axis_error=axis_error,
            loop_error=loop_error,
            # Angular velocities of the links per unit rate of the input, and their
            # derivatives with respect to the input. The spreads are their changes per
            # rad of opening, summed over all directions.
            w=np.array([quad_rows.columns[indices] for indices in w_indices.values()]),
            dw=np.array([quad_rows.columns[indices] for indices in dw_indices.values()]),
            w_spread=np.array([self._spread(quad_rows, "w", link) for link in w_indices]),
            dw_spread=np.array([self._spread(quad_rows, "dw", link) for link in w_indices]),
            link_rotations=self._link_rotations(rows, inverse),
            largest_movement=largest_movement,
            profile_speed=self._bound("rate_size")[rows] if has_contacts else no_profiles,
            profile_bend=(
                self._bound("acceleration_size")[rows] if has_contacts else no_profiles
            ),
        )

    def _spread(self, quad_rows: QuadPrecisionRows, name: str, key: Any) -> Floats:
        """Return how much a quantity changes, per rad by which loops open (k,).

        Because arcs and angles of links are rounded, loops are open by tiny rotations. The
        angle of a rotation (rad) times the result is an error bound of the quantity.

        Each loop can open about three axes. Each of these openings changes the components
        of the quantity. The result is the sum of all absolute changes: of all components,
        for all loops and all three axes.

        Parameters
        ----------
        quad_rows
            The results of k rows (configurations).
        name
            Name of the quantity.
        key
            The two links of the pole (axis of relative rotation), or the index of the link,
            to which the quantity belongs.
        """
        # Indices of the columns of all components, such as x, y and z of a vector. The
        # first axis of `opening_changes` has one entry per column.
        columns = self._column_indices[name][key]
        # (components, k) absolute changes, already summed over loops and axes.
        changes = quad_rows.opening_changes[columns]
        return np.sum(changes, axis=0)

    def _link_rotations(self, rows: Indices, inverse: Floats) -> Floats:
        """Return the rotations of all links if a loop opens, in rad per rad of opening.

        Rounding of sizes leaves the loops open by tiny rotations, which turn the links. The
        result is used for error bounds.

        Parameters
        ----------
        rows
            (k,) indices of configurations.
        inverse
            (passive variables, directions, k) inverse of the loop equations: the movement
            of the variables that are not inputs, per unit opening of a loop. A loop can
            open in three directions, so there are three for each loop.

        Returns
        -------
        (directions, links, 3, k) rotation vectors in ground axes.
        """
        linearisation = self.motion.linearisation
        tree = linearisation.tree
        # (k, variables, 3) relative angular velocity of the links of a pair at unit rate.
        vectors = linearisation.vectors[rows]
        direction_count = inverse.shape[1]
        rotations = np.zeros((direction_count, tree.count, 3, len(rows)))
        for direction in range(direction_count):
            # The movements of all variables (k, variables). The inputs rest.
            movements = np.zeros((len(rows), vectors.shape[1]))
            movements[:, list(self.motion.passive_variables)] = inverse[:, direction].T
            link_rotations = tree.body_rates(vectors, movements)  # (k, links, 3)
            rotations[direction] = np.moveaxis(link_rotations, 0, -1)
        return rotations

    def _compute_from_decimals(self, kernel: RowKernel, rows: Indices) -> None:
        """Compute rows (k,) from the decimal sizes of the file instead of rounded ones.

        These rows are so near to a singularity that the rounding of the sizes to float64
        leaves no correct digit. The method computes w, the angular velocities of links per
        unit rate of the input, their derivatives dw with respect to the input, and the
        poles (axes of relative rotation of two links). The columns, error bounds and flags
        of the rows for which the computation succeeds are changed in place. Other rows stay
        as they are.

        Parameters
        ----------
        kernel
            Its `is_constant` says which columns are the same number in all rows.
        rows
            (k,) indices of the rows.
        """
        plan = self.request.plan
        decimal_rates = DecimalRates.from_motion(self.motion.rows(rows), plan.input)
        if decimal_rates is None:
            return
        # (k,) which of the rows have rates now. Only these are written.
        has_rates = decimal_rates.is_known & (
            decimal_rates.relative_error_bound <= MAX_RATE_ERROR
        )
        written_rows = rows[has_rates]
        self.is_decimal[written_rows] = True
        self.relative_error_bound[written_rows] = decimal_rates.relative_error_bound[
            has_rates
        ]

        def put_columns(name: str, key: Any, values: Floats) -> None:
            """Write the components of a quantity of a pole or link to the columns.

            `key` is the pole or the link. `values` (components, k) has all k rows. Only
            rows that have rates are written. `_column_indices` has the column of each
            component.
            """
            indices = self._column_indices[name][key]
            for index, column in zip(indices, values, strict=True):
                # A column that is the same number in all rows is exact already. Several
                # quantities can share it, so it must not be changed for one of them.
                if not kernel.is_constant[index]:
                    self._columns[index, written_rows] = column[has_rates]

        for link in self._column_indices["w"]:
            put_columns("w", link, decimal_rates.w[:, link].T.astype(float))
            put_columns("dw", link, decimal_rates.dw[:, link].T.astype(float))

        # If a pair joins two links, their pole is the axis of the pair, which is known even
        # where the relative angular velocity is zero. The plan has such pairs by bodies:
        # sets of links that the locked inputs join.
        pair_by_body_pole = axis_pairs(plan)
        for pole, errors in self.pole_errors.items():
            body_pole = plan.pole(*pole)
            assert body_pole is not None
            pair = pair_by_body_pole.get(body_pole)
            quantities, bounds = decimal_rates.pole(pole, pair)
            for quantity in POLE_QUANTITIES:
                # A quantity that was not computed from decimal sizes becomes NaN.
                unknown = nans((quantity.components, len(has_rates)))
                put_columns(quantity.name, pole, quantities.get(quantity.name, unknown))
            for name, error in errors.items():
                error[written_rows] = bounds[name][has_rates] if name in bounds else np.nan

    def separations_of_common_axes(self) -> dict[Pole, Floats]:
        """Return the direction errors of poles that are the common axis of several pairs.

        A pole is the axis of the relative rotation of two links. Several pairs (joints) in
        series can have one line as their axis, the pole. Rounding in the mechanism file can
        make these axes differ a little. Then the pole is not exactly known. `PlannedPoles`
        computes poles from other poles and adds the result to the errors of these axes.

        Returns
        -------
        For each such pole (n,) the largest angle (rad) by which its direction can be wrong.
        If the velocity equations are singular at all rows, the rates are unknown, and the
        result is empty.
        """
        if not self._has_rates:
            return {}
        return {
            pole: self._separation_of_axes(pole)
            for pole in self.request.plan.rounded_common_axes
        }

    def _separation_of_axes(self, links: Pole) -> Floats:
        """Return the angle (n,) in rad by which a pole can differ from its exact direction.

        The pole is the common axis of several pairs, whose rounded axes differ. The pole
        has the direction of the relative angular velocity v of its links. A change of v
        turns the pole by at most the size of this change, divided by the size of v.
        """
        # v is a sum of rates times axes. Each axis changes by at most `SAME_AXIS_SINE`, the
        # largest sine between axes that count as equal, and `rate_size` is the sum of all
        # rates.
        v_error = SAME_AXIS_SINE * self._bound("rate_size")
        v_size = norm_columns(self.relative_velocity(links))
        with np.errstate(invalid="ignore", divide="ignore"):
            return v_error / v_size

    def _add_errors_of_common_axes(self) -> None:
        """Increase the errors of poles that are a common axis of several pairs, in place.

        A pole is the axis of the relative rotation of two links. Several pairs (joints) in
        series can have one line as their axis, the pole. In the mechanism file, the axes of
        these pairs are rounded numbers, which can differ a little. Then the pole is not
        exactly known. The plan lists these poles as `rounded_common_axes`.
        """
        plan = self.request.plan
        for links, errors in self.pole_errors.items():
            if plan.pole(*links) not in plan.rounded_common_axes:
                continue
            errors_of_axis = self._errors_of_common_axis(links)
            # In some rows the plan of the poles later replaces the direction and its error.
            # The error of the axis is then added again, so it is also stored by itself.
            self.axis_separations[links] = errors_of_axis["direction_error"]
            for name, error in errors_of_axis.items():
                errors[name] += error

    def _errors_of_common_axis(self, links: Pole) -> dict[str, Floats]:
        """Return the errors of a pole because the axes of its pairs are rounded numbers.

        A pole is the axis of the relative rotation of two links. Here several pairs
        (joints) in series join the links. Their axes should be one line, the pole, but they
        differ by rounding. Each axis (unit vector) can be wrong by `SAME_AXIS_SINE`, the
        largest sine between axes that count as equal.

        The relative angular velocity v of the links is a sum of terms that contain these
        axes. So is its derivative dv with respect to the input. The direction of the pole
        is u = v / |v|. The error bounds are:

        - of v and dv: `SAME_AXIS_SINE` times the sum of the sizes of the terms. The sums
          over all pairs of the mechanism are used, which are at least as large.
        - of u: error(v) / |v|.
        - of the velocity coefficient v . u = |v|: error(v).
        - of the acceleration coefficient dv . u: error(dv) + error(u) |dv|.
        - of the derivative of u, (dv - (dv . u) u) / |v|:
          (error(dv) + 2 error(u) |dv|) / |v|. One error(u) is for u, the other for |v|.

        Parameters
        ----------
        links
            The two links of the pole.

        Returns
        -------
        The error bounds (n,), by their names in `POLE_ERRORS`.
        """
        v_size = norm_columns(self.relative_velocity(links))
        dv_size = norm_columns(self.relative_velocity_derivative(links))
        v_error = SAME_AXIS_SINE * self._bound("rate_size")
        dv_error = SAME_AXIS_SINE * self._bound("acceleration_size")
        u_error = self._separation_of_axes(links)  # v_error / v_size
        acceleration_coefficient_error = dv_error + u_error * dv_size
        direction_dq_error = (acceleration_coefficient_error + u_error * dv_size) / v_size
        return {
            "direction_error": u_error,
            "velocity_coefficient_error": v_error,
            "acceleration_coefficient_error": acceleration_coefficient_error,
            "direction_dq_error": direction_dq_error,
        }


def _is_direction_accurate(errors: Mapping[str, Floats], v_size: Floats) -> Bools:
    """Return a mask (n,) of rows with an accurate pole direction and derivative in float64.

    A pole is the axis of the relative rotation of two links. Its direction is u = v / |v|,
    with the relative angular velocity v. With the derivative dv of v with respect to
    the input, the derivative of u is

        du = (dv - (dv . u) u) / |v|.

    Rows in which u and du are not accurate are computed again in quad precision, unless the
    two links certainly have no relative motion.

    Parameters
    ----------
    errors
        Error bounds (n,) of the pole, by their names in `POLE_ERRORS`.
    v_size
        (n,) length of v.
    """
    # The error of du is at most the sum of three terms, divided by |v|:
    # - error(dv), the error of dv itself,
    # - error(u) |dv|, because u has an error in (dv . u) u,
    # - error(u) |dv|, because the divisor |v| has the relative error error(u).
    # The known error of the acceleration coefficient dv . u is error(dv) + error(u) |dv|.
    # Twice this error is at least as large as the sum, so it is used in place of the sum.
    direction_dq_error = 2.0 * errors["acceleration_coefficient_error"] / v_size
    # The errors of u and du are added as fractions of their limits. If the sum is at most
    # 1, each error is within its limit. If v is zero, the sum is infinite or NaN.
    used_fractions = (
        errors["direction_error"] / MAX_CERTIFIED_ERROR_RAD
        + direction_dq_error / MAX_DIRECTION_DQ_ERROR
    )
    return np.asarray(used_fractions <= 1.0)


def _is_certainly_at_rest(
    errors: Mapping[str, Floats], v_size: Floats, dv_size: Floats
) -> Bools:
    """Return a mask (n,) of rows in which two links certainly have no relative motion.

    In such rows the relative angular velocity v of the two links of a pole, and its
    derivative dv with respect to the input, are zero within small error bounds. The pole
    then has no direction that could be wrong.

    Parameters
    ----------
    errors
        Error bounds (n,) of the pole, by their names in `POLE_ERRORS`.
    v_size, dv_size
        (n,) lengths of v and dv.
    """
    # The errors bound the components of v and dv along any axis. The length of a vector is
    # its component along itself, so the same bounds apply to lengths.
    v_error = errors["velocity_coefficient_error"]
    dv_error = errors["acceleration_coefficient_error"]
    is_zero = (v_size <= v_error) & (dv_size <= dv_error)
    # Links with large error bounds could still move, so the bounds have to be small, too.
    # `dv_error` is a sum that includes `v_error`, so only `dv_error` is tested.
    return np.asarray(is_zero & (dv_error <= NO_MOTION))
