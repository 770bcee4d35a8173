"""Columns of a row while one input moves: velocities, poles and their error bounds.

Symbols: q is the moving input, and all derivatives are with respect to q while the other
inputs rest. w are the angular velocities of links per unit rate of q, dw their derivatives.
v and dv are the differences of these for the two links of a pole, and u is the direction of
the pole. The velocity coefficient is v . u, the acceleration coefficient dv . u.

The bounds follow the errors of axes through the velocity equations (sum of a_i r_i = 0
around each loop, with the vectors a_i and rates r_i of the variables) and through their
derivative. They use norms only, as `row_expressions.py` explains.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from spherekit.arrays import Floats
from spherekit.planning.pole_plan import Pole
from spherekit.symbolic.expression_graph import Expr, ExpressionNode, dot
from spherekit.symbolic.vector_algebra import Exprs
from spherekit.velocities.carried_vectors import CarriedVector, absolute, root
from spherekit.velocities.pole_field import (
    MAX_DIRECTION_DQ_ERROR,
    POLE_ERRORS,
    POLE_QUANTITIES,
    SIGNED_COMPONENTS,
    axis_pairs,
)
from spherekit.velocities.pole_request import Request
from spherekit.velocities.pose_expressions import sum_along_paths
from spherekit.velocities.row_expressions import RowExpressions

MAX_CERTIFIED_ERROR_RAD = 1e-9
"""Largest error bound of a direction in a row that a kernel certifies.

It does not apply to poles that are the axis of a pair.

Larger: more rows are taken from float64, with looser bounds. Smaller: more rows are
recomputed in quad precision, where bounds are measured instead of estimated by norms.
"""

MAX_CERTIFIED_DW_ERROR = 1e-8
"""Largest error bound of dw in such a row.

It is relative to dw of all links together, or to 1. dw are the derivatives of the angular
velocities of links with respect to the input.
"""

FIELD_PARTS = (*(x.name for x in POLE_QUANTITIES), *POLE_ERRORS, "w", "dw")
"""Fields of a `PoleField` that are columns."""


@dataclass(frozen=True)
class ColumnList:
    """Expressions that become the output columns of a compiled function (kernel).

    Equal expressions usually share one column, which saves time. The sign of some columns
    is changed after the evaluation. Such a column is not shared, because the other
    quantities would change their sign too.

    Attributes
    ----------
    expressions
        The expression of each column.
    """

    expressions: list[Expr] = field(default_factory=list)
    _indices: dict[Expr, int] = field(default_factory=dict)

    def add_shared(self, items: Iterable[Expr]) -> list[int]:
        """Return the index of the column of each expression, adding new columns."""
        indices: list[int] = []
        for item in items:
            if item not in self._indices:
                self._indices[item] = len(self.expressions)
                self.expressions.append(item)
            indices.append(self._indices[item])
        return indices

    def add_unshared(self, item: Expr) -> int:
        """Add a column that no other expression shares, and return its index."""
        self.expressions.append(item)
        return len(self.expressions) - 1


@dataclass(frozen=True)
class RelativeMotion:
    """The motion of a link relative to another one, as expressions with error bounds.

    From these, the pole (axis of the relative rotation) and the error of its direction are
    computed.

    Attributes
    ----------
    v
        (3,) relative angular velocity per unit rate of the input.
    dv
        (3,) derivative of v with respect to the input.
    v_error, dv_error
        Bounds of the errors of v and dv. The component along any axis has at most this
        error.
    dv_bound
        Bound of the length of dv. Components of dv along an axis have an error from the
        direction of the axis, at most `dv_bound` times the angle of this error.
    """

    v: Exprs
    dv: Exprs
    v_error: Expr
    dv_error: Expr
    dv_bound: Expr


class InputColumns:
    """Velocities and poles while one input moves, and their indices among all columns.

    A pole is the axis about which one link rotates relative to another one. The other
    inputs are locked. w are the angular velocities of links per unit rate of the moving
    input, dw their derivatives with respect to this input, and v the difference of w of two
    links.

    Attributes
    ----------
    column_indices
        Indices of the columns by name of the field (`FIELD_PARTS`), then by pole or link.
    reversible_poles
        Poles whose direction may be reversed: poles that are not the axis of a pair. The
        direction of such a pole is the direction of v or the opposite one, chosen after the
        evaluation.
    velocity_components
        Distinct expressions of the components of w of all links.
    uncertainty
        Expression that is at most 1 for rows whose errors are small enough.
    rate_residual, acceleration_residual
        Norms of the residuals of the velocity equations, and of their derivative.
    rate_size, acceleration_size
        Sums of the sizes of all terms of these equations.
    dw_error
        Bound of the error of dw, summed over all links and relative to their size, or 1.
    """

    def __init__(self, rows: RowExpressions, request: Request, columns: ColumnList) -> None:
        """Write the expressions of velocities and poles while one input moves.

        Parameters
        ----------
        rows
            Expressions that do not depend on the moving input, for one configuration (row).
        request
            The moving input, and the poles (axes of relative rotations) and links to
            compute.
        columns
            The output columns of the compiled function (kernel), to which new ones are
            added.
        """
        self._rows = rows
        self._request = request
        tree = rows.tree
        # The input pair has a single variable.
        (moving_variable,) = rows.pair_variables[request.plan.input]
        # In the velocity equation of a loop, the angular velocities of the passive pairs
        # add up to minus the angular velocity of the input, here at unit rate. With this
        # right-hand side, `solve_loops` returns the rates of the passive variables, and 0
        # for the input. The rate of the input, 1, is set afterwards.
        input_velocity = rows.vectors[moving_variable]
        self._rates = rows.solve_loops({request.plan.input: -1.0 * input_velocity})
        self._rates[moving_variable] = 1.0
        # The relative angular velocities (3,) of the links of all pairs. Along the tree of
        # links they add up to the angular velocities w of the links relative to the ground.
        pair_velocities = rows.pair_velocities(self._rates)
        self._w = sum_along_paths(tree, pair_velocities)
        # Accelerations while the input has a constant rate: the second derivative of each
        # variable, and the derivative (3,) of the relative angular velocity of each pair.
        self._accelerations, pair_accelerations = rows.solve_accelerations(
            self._rates, self._w
        )
        self._dw = sum_along_paths(tree, pair_accelerations)
        # The sums of velocities and of accelerations around the loops, which are zero up to
        # rounding.
        self.rate_residual = self._loop_residual(self._w, pair_velocities)
        self.acceleration_residual = self._loop_residual(self._dw, pair_accelerations)
        # Bounds of the errors of rates, angular velocities, their derivatives, and axes.
        self._set_error_bounds()
        self._add_columns(columns)

    def _loop_residual(
        self, link_vectors: Sequence[Exprs], pair_vectors: Sequence[Exprs]
    ) -> Expr:
        """Return the norm of the residual of the equations of all loops.

        A chord is the pair (joint) that closes a loop. The two links of the chord get their
        vectors along the two sides of the loop. The two vectors must differ by the vector
        of the chord. The residual shows the rounding errors of the solution.

        Parameters
        ----------
        link_vectors
            (3,) angular velocity of each link, or its derivative.
        pair_vectors
            (3,) relative angular velocity of each pair, or its derivative.
        """
        tree = self._rows.tree
        residuals: list[Exprs] = []
        for chord in tree.chords:
            first, second = tree.ends[chord]
            residuals.append(
                link_vectors[first] - link_vectors[second] + pair_vectors[chord]
            )
        return root(sum((dot(x, x) for x in residuals), 0.0))

    def _set_error_bounds(self) -> None:
        """Set bounds of the errors of rates, w, their derivatives, and of axes.

        The bounds are expressions. r_i are the rates of the variables per unit rate of the
        moving input, a_i their vectors (axes), and w the angular velocities of the links.
        The velocity equation of a loop is sum a_i r_i = 0, and its derivative is
        sum (a_i dr_i + da_i r_i) = 0.
        """
        rows = self._rows
        self._speeds = [absolute(rate) for rate in self._rates]
        acceleration_sizes = [absolute(change) for change in self._accelerations]
        self._w_bounds = rows.turns_along_paths(self._speeds)

        # Velocity equations: the error of each axis changes the term a_i r_i.
        rate_term_errors = [
            speed * axis_error
            for speed, axis_error in zip(self._speeds, rows.axis_errors, strict=True)
        ]
        self._w_errors, rate_errors = self._solution_errors(
            rate_term_errors, self.rate_residual
        )

        # Acceleration equations: their terms are a_i dr_i + da_i r_i.
        self._axis_derivative_errors: list[Expr] = []
        term_errors: list[Expr] = []
        term_sizes: list[Expr] = []
        for v, carried in enumerate(rows.carried):
            speed = self._speeds[v]
            # A bound of |da_i|: a_i turns with its link, and slides on it at a contact.
            axis_derivative = carried.length * self._w_bounds[carried.link]
            axis_derivative = axis_derivative + speed * carried.slide_length
            axis_derivative_error = self._axis_derivative_error(
                carried,
                speed=speed,
                rate_error=rate_errors[v],
                axis_error=rows.axis_errors[v],
                slide_error=rows.slide_errors[v],
            )
            self._axis_derivative_errors.append(axis_derivative_error)
            term_errors.append(
                acceleration_sizes[v] * rows.axis_errors[v]
                + speed * axis_derivative_error
                + axis_derivative * rate_errors[v]
            )
            term_sizes.append(
                acceleration_sizes[v] * carried.length + speed * axis_derivative
            )
        self._dw_errors, acceleration_errors = self._solution_errors(
            term_errors, self.acceleration_residual
        )

        # The velocity coefficient of a pair is a component along its axis. Its error is the
        # error of the rate plus the error of the term a_i r_i.
        self._rate_errors = [
            error + term_error
            for error, term_error in zip(rate_errors, rate_term_errors, strict=True)
        ]
        self._acceleration_errors = [
            error + term_error
            for error, term_error in zip(acceleration_errors, term_errors, strict=True)
        ]
        self._dw_bounds = rows.sum_along_paths(term_sizes)
        self.acceleration_size = sum(term_sizes, 0.0)
        self.rate_size = dot(self._speeds, [carried.length for carried in rows.carried])

        dw_square = sum((dot(dw, dw) for dw in self._dw), 0.0)
        self.dw_error = sum(self._dw_errors, 0.0) / root(1.0 + dw_square)
        # Each error is scaled so that its limit is `MAX_CERTIFIED_ERROR_RAD`. Errors of
        # directions are added when the poles are written. If the sum is at most the limit,
        # so is every error.
        self._error_sum = self.dw_error * (MAX_CERTIFIED_ERROR_RAD / MAX_CERTIFIED_DW_ERROR)

    @property
    def uncertainty(self) -> Expr:
        """A number that is at most 1 if all errors are within the certified limits."""
        return self._error_sum / MAX_CERTIFIED_ERROR_RAD

    def _axis_derivative_error(
        self,
        carried: CarriedVector,
        speed: Expr,
        rate_error: Expr,
        axis_error: Expr,
        slide_error: Expr,
    ) -> Expr:
        """Return a bound of the error of the time derivative of a variable's vector.

        The error bounds of accelerations need it. The vector a of a variable (such as the
        axis of a pair) turns with a link. At a contact it may also change relative to the
        link. Its derivative is w x a + r s. Here w is the angular velocity of the link, r
        the rate of the variable, and s the slide: the derivative of a with respect to the
        variable, as seen from the link. Products of two errors are neglected.

        Parameters
        ----------
        carried
            The vector a with its link and its slide.
        speed
            Absolute value of the rate r.
        rate_error, axis_error, slide_error
            Bounds of the errors of r, a and s.
        """
        # w x a has an error of at most |a| (error of w) + |w| (error of a). `w_bound` is a
        # bound of |w|.
        w_bound = self._w_bounds[carried.link]
        error = carried.length * self._w_errors[carried.link] + w_bound * axis_error
        # r s has an error of at most |s| (error of r) + |r| (error of s).
        return error + carried.slide_length * rate_error + speed * slide_error

    def _solution_errors(
        self, term_errors: Sequence[Expr], residual: Expr
    ) -> tuple[list[Expr], list[Expr]]:
        """Return error bounds of the solution of the velocity or acceleration equations.

        The bounds decide whether a row is accurate enough to be certified. The velocity
        equation of a loop says that the terms of all variables add up to zero. A term is
        the vector of a variable times its rate. The angular velocity of a link is the sum
        of the terms on the path from the ground to the link.

        The acceleration equation is the derivative of the velocity equation. Its terms are
        the derivatives of the terms. Their sum along a path is the derivative of the
        angular velocity.

        Parameters
        ----------
        term_errors
            Error bounds of the terms, one for each variable.
        residual
            Norm of the residual of the equations of all loops.

        Returns
        -------
        link_errors
            Error bound for each link: of its angular velocity or the derivative of this.
        variable_errors
            Error bound for each variable: of its rate or the derivative of the rate.
        """
        rows = self._rows
        # A bound of the error in the equations of all loops. `loop_counts` is the number of
        # loops that contain a variable.
        equation_error = residual + dot(rows.loop_counts, term_errors)
        # An error of 1 in the equations changes the rates. The angular velocity of a link
        # changes with them by at most `link_turns`. In addition, the terms on the path to
        # the link have errors. The same holds for the derivatives.
        link_errors = [
            turn * equation_error + path_error
            for turn, path_error in zip(
                rows.link_turns, rows.sum_along_paths(term_errors), strict=True
            )
        ]
        # An error of 1 in the equations changes the rate of a variable, or its derivative,
        # by at most `variable_shifts`.
        variable_errors = [shift * equation_error for shift in rows.variable_shifts]
        return link_errors, variable_errors

    def _add_columns(self, columns: ColumnList) -> None:
        """Add the expressions of all poles and links as columns of a compiled function.

        A pole is the axis of the relative rotation of two links. The function (kernel)
        evaluates many configurations at once. A column is one of its outputs, such as a
        component of an angular velocity, with one number for each configuration. The method
        sets the attributes `column_indices`, `reversible_poles` and `velocity_components`.

        Parameters
        ----------
        columns
            The expressions of all columns of the function, to which new ones are added.
        """
        # Expressions whose columns can be shared, and expressions that change their sign if
        # the direction of their pole is reversed.
        shared_parts, reversible_parts = self._collect_parts()
        # For each quantity, the indices of the columns of each pole or link. `FIELD_PARTS`
        # are the names of the quantities.
        self.column_indices: dict[str, dict[Any, list[int]]] = {
            name: {} for name in FIELD_PARTS
        }
        self._add_reversible_columns(columns, reversible_parts)
        # All other columns. Equal expressions share one column.
        for (name, pole_or_link), expressions in shared_parts.items():
            self.column_indices[name][pole_or_link] = columns.add_shared(expressions)

        # A second list has only the components of the angular velocities of links. The list
        # is faster to evaluate than all columns. Equal components share one entry.
        components = ColumnList()
        # `_w` has the angular velocity (3,) of each link. The result (links, 3) has indices
        # into `velocity_components`.
        self._component_indices = np.array([components.add_shared(w) for w in self._w])
        self.velocity_components = components.expressions

    def _collect_parts(
        self,
    ) -> tuple[dict[tuple[str, Any], Iterable[Expr]], dict[Pole, list[Expr]]]:
        """Return the expressions of all requested poles and links, in two groups.

        A pole is the axis about which two links turn relative to each other. Its direction
        is known up to its sign, unless it is the axis of a pair (joint). The sign is chosen
        after the expressions were evaluated. The expressions that change with it are
        therefore a separate group.

        Returns
        -------
        shared_parts
            Expressions that do not depend on the sign of a direction. The key is the name
            of the quantity with the pole or link.
        reversible_parts
            By pole, the expressions that change their sign if the direction of the pole is
            reversed, in the order of `SIGNED_COMPONENTS`. Poles that are the axis of a pair
            are not included.
        """
        plan = self._request.plan
        pairs = axis_pairs(plan)
        shared_parts: dict[tuple[str, Any], Iterable[Expr]] = {}
        reversible_parts: dict[Pole, list[Expr]] = {}
        for pole in self._request.poles:
            # The pole of the two bodies (sets of links that move together) to which the
            # links belong.
            body_pole = plan.pole(*pole)
            if body_pole in pairs:
                parts = self._pair_axis_parts(pole, pairs[body_pole])
            elif body_pole is not None:
                parts = self._relative_pole_parts(*pole)
                reversible_parts[pole] = [
                    item for name in SIGNED_COMPONENTS for item in parts.pop(name)
                ]
            else:
                # Both links belong to one body, so they do not move relative to each other.
                continue
            shared_parts |= {(name, pole): items for name, items in parts.items()}
        # The angular velocity w of each link, and its derivative dw.
        for link in sorted(self._request.links):
            shared_parts |= {("w", link): self._w[link], ("dw", link): self._dw[link]}
        return shared_parts, reversible_parts

    def _add_reversible_columns(
        self, columns: ColumnList, parts: dict[Pole, list[Expr]]
    ) -> None:
        """Add the columns that change their sign with the direction of a pole.

        A pole is the axis of the relative rotation of two links. The sign of its direction
        is chosen after the columns were evaluated. The columns have successive indices, so
        that all signs can be applied at once: the first component of all poles, then the
        second of all poles, and so on. No other quantity shares these columns, as it would
        change with the sign.

        Parameters
        ----------
        columns
            The output columns of the compiled function, to which new ones are added.
        parts
            By pole, the expressions of the components in the order of `SIGNED_COMPONENTS`.
        """
        first = len(columns.expressions)
        component = 0  # position in the list of each pole
        # A quantity, such as the direction, has `size` components, such as three.
        for name, size in SIGNED_COMPONENTS.items():
            indices_by_pole: dict[Pole, list[int]] = {pole: [] for pole in parts}
            for _ in range(size):
                for pole, items in parts.items():
                    index = columns.add_unshared(items[component])
                    indices_by_pole[pole].append(index)
                component += 1
            self.column_indices[name] |= indices_by_pole
        self.reversible_poles = tuple(parts)
        # All columns that were added here.
        self._reversible_slice = slice(first, len(columns.expressions))
        # A pole is a tuple of the indices of its two links. This array (2, poles) has the
        # first and the second links.
        self._pole_ends = np.array(self.reversible_poles, dtype=np.intp).reshape(-1, 2).T

    def relative_velocities(
        self, components: Floats, first_components: Floats | None = None
    ) -> Floats:
        """Return the relative angular velocities v of the two links of poles.

        A pole is the axis about which a second link turns relative to a first link. v
        is the angular velocity w of the second link minus that of the first, per unit
        rate of the moving input. The poles are the `reversible_poles`: all except those
        that are the axis of a pair (joint), whose direction is known without v.

        Parameters
        ----------
        components
            (k, ...) values of the `velocity_components`: the distinct components of w of
            all links.
        first_components
            (k, ...) values for the first link of each pole, by default `components`. With
            lower bounds in `components` and upper bounds here, the result is a lower bound
            of v.

        Returns
        -------
        (poles, 3, ...) v of these poles, in their order.
        """
        # (poles,) indices of the links. For the x, y and z component of w of each link,
        # `_component_indices` (links, 3) has its row in `components`.
        first, second = self._pole_ends
        if first_components is None:
            first_components = components
        return (
            components[self._component_indices[second]]
            - first_components[self._component_indices[first]]
        )

    def reversible_columns(self, columns: Floats) -> Floats:
        """Return the columns that change their sign if a pole direction is reversed.

        A pole is the axis of the relative rotation of two links, with two opposite
        directions. For the `reversible_poles`, the compiled function returns either of
        them. The caller then chooses one, and multiplies the result by the signs. The
        result is a view, so this changes `columns`.

        Parameters
        ----------
        columns
            (columns, n) all output columns of the compiled function, at n configurations.

        Returns
        -------
        (components, poles, n) the columns of all quantities in `SIGNED_COMPONENTS`, in
        their order. The first three components are the direction.
        """
        successive_columns = columns[self._reversible_slice]  # a slice, so no copy is made
        component_count = sum(SIGNED_COMPONENTS.values())
        return successive_columns.reshape(
            component_count, len(self.reversible_poles), columns.shape[1]
        )

    def reversible_quantities(self, columns: Floats) -> dict[str, Floats]:
        """Return the quantities of poles that change their sign with the pole's direction.

        A pole is the axis of the relative rotation of two links, with two opposite
        directions. Such quantities are the direction itself, and components of velocities
        along it. Poles that are the axis of a pair (joint) are not included, because their
        direction is fixed.

        Parameters
        ----------
        columns
            (columns, n) all output columns of the compiled function, at n configurations.

        Returns
        -------
        By the name of the quantity, an array (components, poles, n) for the
        `reversible_poles`. The arrays are views of `columns`.
        """
        # `SIGNED_COMPONENTS` has the number of components of each quantity by its name.
        component_counts = list(SIGNED_COMPONENTS.values())
        arrays = np.split(
            self.reversible_columns(columns), np.cumsum(component_counts)[:-1]
        )
        return dict(zip(SIGNED_COMPONENTS, arrays, strict=True))

    @property
    def has_uncertain_poles(self) -> bool:
        """Whether v is constant for a pole, or axes nearly coincide.

        A pole is the axis about which one link rotates relative to another, and v their
        relative angular velocity. A constant v usually is zero or a rounding error, so the
        pole is undefined. Poles that are the axis of a pair are left out. Axes nearly
        coincide if they differ by rounding only.
        """
        for i, j in self.reversible_poles:
            v = self._w[j] - self._w[i]
            if not any(isinstance(x, ExpressionNode) for x in v):
                return True
        return bool(self._request.plan.rounded_axes)

    def _pair_axis_parts(self, pole: Pole, pair: int) -> dict[str, Iterable[Expr]]:
        """Return the quantities of a pole that is the axis or the contact line of a pair.

        A pole is the axis about which two links rotate relative to each other. The links
        can be those of the pair, or links that turn about the same axis. A rolling contact
        turns its links about its contact line, from the centre of the sphere to the contact
        point.

        Parameters
        ----------
        pole
            Indices of the two links.
        pair
            Index of the pair.

        Returns
        -------
        Expressions by name of the `PoleField` field. Derivatives are with respect to the
        moving input.
        """
        rows = self._rows
        i, j = pole
        (variable,) = rows.pair_variables[pair]
        first, second = rows.tree.ends[pair]
        carried = rows.carried[variable]
        axis_error = rows.axis_errors[variable]
        axis_derivative_error = self._axis_derivative_errors[variable]
        if pair in rows.contact_lines:
            # A rolling contact: the vector of its variable is a multiple of this line.
            carried = rows.contact_lines[pair]
            axis_error, slide_error = rows.position_errors(
                carried, rows.variable_shifts[variable]
            )
            axis_derivative_error = self._axis_derivative_error(
                carried,
                speed=self._speeds[variable],
                rate_error=self._rate_errors[variable],
                axis_error=axis_error,
                slide_error=slide_error,
            )
        unit = carried.vector
        unit_derivative = carried.derivative(self._w[carried.link], self._rates[variable])
        if {i, j} == {first, second} and pair not in rows.contact_lines:
            # The links of the pair itself: the coefficient is the rate of its variable.
            sense = 1.0 if i == first else -1.0
            coefficient = sense * self._rates[variable]
            derivative = sense * self._accelerations[variable]
            coefficient_error = self._rate_errors[variable]
            derivative_error = self._acceleration_errors[variable]
        else:
            # The coefficients are components of v and dv along the axis.
            motion = self._relative_motion(i, j)
            coefficient = dot(motion.v, unit)
            derivative = dot(motion.dv, unit)
            coefficient_error = motion.v_error
            derivative_error = motion.dv_error + axis_error * motion.dv_bound
        return {
            "direction": [*unit],
            "direction_dq": [*unit_derivative],
            "velocity_coefficient": [coefficient],
            "acceleration_coefficient": [derivative],
            # 1: no digits cancel in the axis of a pair.
            "conditioning": [1.0],
            "direction_error": [axis_error],
            "velocity_coefficient_error": [coefficient_error],
            "acceleration_coefficient_error": [derivative_error],
            "direction_dq_error": [axis_derivative_error],
        }

    def _relative_motion(self, i: int, j: int) -> RelativeMotion:
        """Return the motion of link j relative to link i, with bounds of its errors."""
        v_error = self._w_errors[i] + self._w_errors[j]
        dv_error = self._dw_errors[i] + self._dw_errors[j] + v_error
        return RelativeMotion(
            v=self._w[j] - self._w[i],
            dv=self._dw[j] - self._dw[i],
            v_error=v_error,
            dv_error=dv_error,
            dv_bound=self._dw_bounds[i] + self._dw_bounds[j],
        )

    def _relative_pole_parts(self, i: int, j: int) -> dict[str, Iterable[Expr]]:
        """Return the quantities of the pole of links i and j if it is no axis of a pair.

        The pole has the direction u of v, the angular velocity of link j relative to link i
        per unit rate of the moving input. dv is the derivative of v with respect to this
        input. The error bounds of u and of its derivative are added to the error sum of the
        row, which decides whether the row is certified in float64.

        Returns
        -------
        Expressions by name of the `PoleField` field.
        """
        motion = self._relative_motion(i, j)
        length = root(dot(motion.v, motion.v))
        if length == 0.0:
            # The links rest relative to each other at every configuration.
            return {
                "direction": [np.nan] * 3,
                "direction_dq": [np.nan] * 3,
                "velocity_coefficient": [0.0],
                "acceleration_coefficient": [0.0],
                "conditioning": [0.0],
                "direction_error": [1.0],
                "velocity_coefficient_error": [motion.v_error],
                "acceleration_coefficient_error": [motion.dv_error],
                "direction_dq_error": [np.nan],
            }
        inverse_length = 1.0 / length
        unit = motion.v * inverse_length
        derivative = dot(motion.dv, unit)
        unit_derivative = (motion.dv - derivative * unit) * inverse_length
        w_sizes = [root(dot(w, w)) for w in (self._w[i], self._w[j])]
        # How far w_i and w_j are from cancelling, from 0 to 1. A size that is the number 0
        # belongs to a link that always rests, where nothing cancels.
        conditioning = length / (w_sizes[0] + w_sizes[1]) if all(w_sizes) else 1.0

        direction_error = motion.v_error * inverse_length
        # The acceleration coefficient is dv . u. An error of u multiplies the part of dv
        # that is perpendicular to u, which can be large even if v is small.
        transverse = direction_error * motion.dv_bound
        derivative_error = motion.dv_error + transverse
        unit_derivative_error = (derivative_error + transverse) * inverse_length
        # The error of du is limited by `MAX_DIRECTION_DQ_ERROR`, the error of u by
        # `MAX_CERTIFIED_ERROR_RAD`. The ratio of both limits converts an error of du to an
        # equally serious error of u. `unit_derivative_error` is at most twice
        # `derivative_error` times `inverse_length`. This bound takes its place here.
        turn_uncertainty = (
            derivative_error
            * inverse_length
            * (2.0 * MAX_CERTIFIED_ERROR_RAD / MAX_DIRECTION_DQ_ERROR)
        )
        self._error_sum = self._error_sum + direction_error + turn_uncertainty
        return {
            "direction": [*unit],
            "direction_dq": [*unit_derivative],
            "velocity_coefficient": [length],
            "acceleration_coefficient": [derivative],
            "conditioning": [conditioning],
            "direction_error": [direction_error],
            "velocity_coefficient_error": [motion.v_error],
            "acceleration_coefficient_error": [derivative_error],
            "direction_dq_error": [unit_derivative_error],
        }
