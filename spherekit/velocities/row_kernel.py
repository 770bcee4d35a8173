"""Compiled functions that evaluate all output columns of many configurations at once.

A `RowKernel` first computes a few quality measures per row (closure residual,
uncertainties, error bounds). For the rows that pass, it then computes every column. Rows
that do not pass are recomputed in quad precision by `quad_precision_rows.py`.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.positions.motion import Motion
from spherekit.symbolic.expression_evaluation import FloatFunction, float_function
from spherekit.symbolic.expression_function import expression_function
from spherekit.symbolic.expression_graph import Expr, ExpressionNode, substitute, symbols
from spherekit.symbolic.vector_algebra import vector_sum
from spherekit.velocities.axis_rotations import ProfileSide, append_profile_columns
from spherekit.velocities.carried_vectors import largest
from spherekit.velocities.dyad_expressions import make_closed_form
from spherekit.velocities.elimination_order import (
    EliminationOrder,
    assign_elimination_orders,
)
from spherekit.velocities.function_cache import FUNCTION_CACHE
from spherekit.velocities.input_columns import ColumnList, InputColumns
from spherekit.velocities.pole_field import REPORTED_ERRORS
from spherekit.velocities.pole_request import Request
from spherekit.velocities.row_expressions import RowExpressions, curvature_uncertainties

MIN_RECIPROCAL_CONDITION = 1e-3
"""Reciprocal condition number of the loop equations below which a row is not certified.

Larger: more rows are recomputed in quad precision. Smaller: float64 gives rows nearer to
singular configurations, with looser bounds.
"""

REFERENCES = 32
"""Largest number of configurations from which the elimination order is chosen.

Larger: the order suits more rows, and takes longer to find.
"""

MAX_REFERENCE_ERROR_RAD = 1e-6
"""Largest error of a configuration from which the elimination order is chosen.

If all configurations have larger errors, any of them is taken. Larger: the order can suit
configurations that are nearly singular. Smaller: fewer configurations contribute.
"""

MAX_NEWTON_STEPS = 8
"""Largest number of steps of Newton's method that close the loops of a single row."""

MAX_KANTOROVICH_NUMBER = 0.5
"""Largest number in Kantorovich's theorem for which exactly one solution is near."""

KernelEngine = Literal["numpy", "compiled"]
"""What evaluates the functions of a kernel: NumPy, or functions compiled by heyoka."""


class ColumnFunction:
    """A compiled or NumPy function of n configurations, with outputs grouped by name.

    The input is an array (variables, n) of pair variables. The output is an array
    (width, n) with `width` numbers for each configuration. A call has two parts:

    1. The contact curves of links (profiles) are evaluated at the variables of contacts,
       which are arc lengths. This gives tangent, point and curvature at each contact.
    2. The function evaluates expressions in the variables and these numbers.

    Attributes
    ----------
    slices
        For each name, its range along the first axis of the output.
    width
        Length of the first axis of the output.
    function
        The second part of a call: the function of variables and numbers of contacts.
    """

    def __init__(
        self,
        parts: Mapping[Any, Sequence[Expr]],
        variables: Sequence[ExpressionNode],
        profiles: Sequence[ProfileSide],
        compiled: bool = False,
    ) -> None:
        """Make the function from expressions.

        Parameters
        ----------
        parts
            The output expressions in groups, in the order of the results of the function.
            The key of a group can be of any type.
        variables
            The symbols of the pair variables.
        profiles
            Contact curves of links. Tangent, point and curvature of such a curve at the
            contact are symbols in the expressions.
        compiled
            Whether heyoka compiles the function. Otherwise NumPy evaluates it.
        """
        outputs: list[Expr] = []
        self.slices: dict[Any, slice] = {}
        for name, expressions in parts.items():
            self.slices[name] = slice(len(outputs), len(outputs) + len(expressions))
            outputs += expressions
        self.width = len(outputs)
        self._profiles = profiles
        contact_symbols: list[ExpressionNode] = []
        for profile in profiles:
            contact_symbols += profile.contact_symbols
        self.function = expression_function(
            outputs, [*variables, *contact_symbols], compiled
        )

    def __call__(self, values: Floats, out: Floats | None = None) -> Floats:
        """Return the output (width, n), in `out` if given, at values (variables, n)."""
        return self.function(append_profile_columns(values, self._profiles), out)


class SingleRowOutputs(NamedTuple):
    """The outputs of a kernel's function that evaluates one configuration (row).

    The fields are expressions while the function is made, and numbers when it is evaluated.
    From the numbers, `RowKernel.evaluate_row` decides whether the row is accurate.

    If the variables follow from the inputs by formulas (closed form), all outputs are for
    these variables. Otherwise the function performs a step of Newton's method: `variables`
    are the values after the step, and all other outputs belong to the values before the
    step.

    Attributes
    ----------
    variables
        The pair variables (rad).
    kantorovich_number
        The number h in Kantorovich's theorem. If it is at most 1/2, Newton's method
        converges, and there is exactly one solution near.
    uncertainty_sum
        Sum of the uncertainties: error bounds and condition numbers relative to the largest
        allowed ones. If the sum is at most 1, none exceeds its limit.
    residual
        By how much the loops are open (rad).
    axis_sum
        (3,) sum over all variables of the angular velocity of their pair at unit rate (for
        R pairs the axis). The sum serves to choose one of the two opposite directions of a
        pole (axis of relative rotation): the one whose scalar product with this sum is
        positive.
    columns
        All velocities and poles, with error bounds.
    """

    variables: Sequence[Any]
    kantorovich_number: Any
    uncertainty_sum: Any
    residual: Any
    axis_sum: Sequence[Any]
    columns: Sequence[Any]

    def flat_list(self) -> list[Any]:
        """Return all outputs as one list, in the order of the fields."""
        return [
            *self.variables,
            self.kantorovich_number,
            self.uncertainty_sum,
            self.residual,
            *self.axis_sum,
            *self.columns,
        ]

    @staticmethod
    def from_flat_list(numbers: Sequence[Any], variable_count: int) -> "SingleRowOutputs":
        """Return the outputs from a list in the order of `flat_list`."""
        first = variable_count  # index of the first output after the variables
        return SingleRowOutputs(
            variables=numbers[:first],
            kantorovich_number=numbers[first],
            uncertainty_sum=numbers[first + 1],
            residual=numbers[first + 2],
            axis_sum=numbers[first + 3 : first + 6],
            columns=numbers[first + 6 :],
        )


@dataclass(frozen=True)
class EvaluatedRow:
    """The results for one configuration, which are certified to be accurate.

    The results are all velocities and poles (axes of relative rotation of two links) of a
    mechanism.

    Attributes
    ----------
    variables
        Values (rad) of all pair variables.
    residual
        By how much the loops are open (rad).
    axis_sum
        (3,) sum of the vectors of all variables, in ground axes. The vector of a variable
        is the angular velocity of its pair at unit rate, for an R pair its axis. The caller
        uses the sum to choose one of the two opposite directions of a pole axis: the one
        whose scalar product with this sum is positive.
    columns
        Velocities, poles and their error bounds. `InputColumns.column_indices` says which
        column has which quantity.
    """

    variables: Sequence[float]
    residual: float
    axis_sum: Sequence[float]
    columns: Sequence[float]


class RowKernel:
    """The functions that evaluate the rows of a run. Each is built when it is first used.

    A row is one configuration. The columns are the velocities, poles and error bounds that
    are computed for each row. A row is certified if its loops are closed up to rounding and
    all its *uncertainties* are at most 1. An uncertainty is the ratio of a condition number
    or of an error bound to the largest allowed one.

    Attributes
    ----------
    engine
        "numpy", or "compiled" if heyoka evaluates the expressions.
    passive_variables
        Indices of the variables that no input sets.
    input_columns
        For each input that moves while the others are locked, the indices of the columns of
        its velocities and poles.
    closure_rounding_rad
        Loops with a smaller closure residual (rad) are closed up to rounding.
    can_certify_rows
        Whether certified rows need no other check. False if poles are uncertain, or if
        there are no passive variables, from whose equations the bounds follow.
    has_closed_form
        Whether all variables follow from the inputs and the signs of dyads.
    is_compiled
        Whether heyoka compiles the functions. Threads can call compiled functions at the
        same time.
    column_count
        Number of columns.
    profiles
        Profiles whose columns are inputs of the functions.
    loop_count
        Number of independent loops.
    """

    def __init__(
        self,
        motion: Motion,
        requests: Sequence[Request],
        pivots: EliminationOrder,
        engine: KernelEngine,
    ) -> None:
        """Write the expressions of all columns.

        A row is one configuration. The columns are the velocities and poles of a row, and
        their error bounds.

        Parameters
        ----------
        motion
            Configurations of the mechanism, in any assembly modes.
        requests
            The poles and links to compute, for each input that moves while the others are
            locked.
        pivots
            The order in which variables are eliminated from the loop equations.
        engine
            What evaluates the expressions: "numpy", or "compiled" (heyoka).
        """
        mechanism = motion.mechanism
        self.engine = engine
        self.passive_variables = motion.passive_variables
        self._variables = symbols(mechanism.variable_names)

        self._rows = RowExpressions(
            mechanism, self._variables, pivots, inputs=motion.assembly.inputs
        )
        self.closure_rounding_rad = self._rows.closure_rounding_rad
        self.loop_count = len(self._rows.tree.chords)

        # One set of columns per input that moves while the others are locked. The sets
        # share columns: each distinct expression is listed once.
        shared_columns = ColumnList()
        self.input_columns = [
            InputColumns(self._rows, request, shared_columns) for request in requests
        ]
        self._columns = shared_columns.expressions
        self.column_count = len(self._columns)

        # The results of a row are certified if their error bounds are small enough. The
        # bounds follow from the equations of the passive variables. Without such variables,
        # or if poles are undefined or their axes equal but for rounding
        # (`has_uncertain_poles`), there are no sufficient bounds.
        self.can_certify_rows = bool(self.passive_variables) and not any(
            columns.has_uncertain_poles for columns in self.input_columns
        )
        # Contact profiles that are described by columns, with which the variables have no
        # closed form.
        self.profiles = self._rows.pairs.sides_with_symbols
        self._closed_form = (
            None if self.profiles else make_closed_form(mechanism, motion.assembly)
        )
        self.has_closed_form = self._closed_form is not None
        self.is_compiled = engine == "compiled"
        # Ratios of condition numbers and error bounds to the largest allowed ones. If their
        # sum is at most 1, none exceeds its limit, and the row is certified.
        self._uncertainties = [
            self._rows.condition_number * MIN_RECIPROCAL_CONDITION,
            *(columns.uncertainty for columns in self.input_columns),
            *curvature_uncertainties(self._rows),
        ]

    @cached_property
    def is_constant(self) -> Bools:
        """(columns,) whether a column is the same number for every configuration."""
        return np.array([not isinstance(x, ExpressionNode) for x in self._columns], bool)

    @cached_property
    def _scalar_function(self) -> FloatFunction:
        """Function that takes and returns plain numbers, for a single configuration.

        `evaluate_row` calls it. The outputs are those of `SingleRowOutputs`, in order: the
        variables, then all other outputs. There are two cases:

        - There are formulas for all variables (a closed form). The arguments are the
          inputs, and one sign for each dyad (two links and three R pairs), which chooses
          one of its two solutions. The formulas give the variables, and all other outputs
          are computed from these.
        - There are no such formulas. The arguments are all variables. The first outputs are
          the variables after a step of Newton's method. All other outputs are computed from
          the arguments, the variables before the step.
        """
        other_outputs = self._single_row_expressions().flat_list()
        if self._closed_form is None:
            after_step = self._variables_after_newton_step()
            return float_function([*after_step, *other_outputs], self._variables)
        closed_form = self._closed_form
        # All expressions become functions of inputs and signs.
        form_by_variable = dict(zip(self._variables, closed_form.variables, strict=True))
        return float_function(
            [*closed_form.variables, *substitute(other_outputs, form_by_variable)],
            closed_form.arguments,
        )

    def _single_row_expressions(self) -> SingleRowOutputs:
        """Return the outputs for single rows, without the variables, as expressions."""
        rows = self._rows
        return SingleRowOutputs(
            variables=[],
            kantorovich_number=rows.kantorovich_number,
            uncertainty_sum=sum(self._uncertainties, 0.0),
            residual=rows.residual,
            axis_sum=[*vector_sum(rows.vectors)],
            columns=self._columns,
        )

    def _variables_after_newton_step(self) -> list[Expr]:
        """Return all variables after a step of Newton's method, which keeps the inputs."""
        passive = dict(zip(self.passive_variables, self._rows.newton_step, strict=True))
        return [passive.get(v, symbol) for v, symbol in enumerate(self._variables)]

    def evaluate_row(self, values: Sequence[float]) -> EvaluatedRow | None:
        """Evaluate a single row (configuration). Return None if it cannot be certified.

        This is a fast way for one row. If the result is None, the caller evaluates the row
        in the ordinary, slower way.

        A row is certified if its loops are closed up to rounding and the sum of its
        uncertainties is at most 1. An uncertainty is a condition number or an error bound,
        relative to the largest allowed one. If the sum is at most 1, so is each
        uncertainty. The mechanism must have no contact curves in `profiles`, because their
        values at the contacts are not computed here.

        Parameters
        ----------
        values
            If there are formulas for all variables (closed form): the inputs (rad), and for
            each dyad (two links and three R pairs) the sign +1 or -1 that chooses one of
            its two solutions. Otherwise the variables near a closed configuration, from
            which Newton's method closes the loops if Kantorovich's theorem guarantees
            exactly one solution near.
        """
        for _ in range(MAX_NEWTON_STEPS):
            try:
                numbers = self._scalar_function(values)
            except (ArithmeticError, ValueError):
                return None
            outputs = SingleRowOutputs.from_flat_list(numbers, len(self._variables))
            # Newton's method is not certain to converge. "not <=" is also true for NaN.
            if not outputs.kantorovich_number <= MAX_KANTOROVICH_NUMBER:
                return None
            is_closed = outputs.residual <= self.closure_rounding_rad
            if not is_closed:
                # With a closed form, the arguments are inputs and signs, which Newton's
                # method cannot improve.
                if self.has_closed_form:
                    return None
                # Try again with the variables after a step of Newton's method.
                values = outputs.variables
                continue
            if not outputs.uncertainty_sum <= 1.0:
                return None
            # The variables to which the outputs belong.
            if self.has_closed_form:
                variables = outputs.variables
            else:
                # `outputs.variables` are those after another, superfluous Newton step.
                variables = values
            return EvaluatedRow(
                variables, outputs.residual, outputs.axis_sum, outputs.columns
            )
        return None

    def _make_function(
        self, parts: Mapping[Any, Sequence[Expr]], compiled: bool = False
    ) -> ColumnFunction:
        """Return a function of all variables whose outputs are the given expressions."""
        return ColumnFunction(parts, self._variables, self.profiles, compiled)

    @property
    def _quality_expressions(self) -> dict[Any, Sequence[Expr]]:
        """Quality measures of a row (configuration) and related expressions, by name.

        The first three say how accurate the row is. `find_slice_reversals` reads the
        others: from the velocities it finds the rows between which the direction of a pole
        (axis of relative rotation) may reverse.

        - ``"uncertainties"``: error bounds or condition numbers, each divided by the
          largest allowed one.
        - ``"uncertainty_sum"``: the sum of the uncertainties. If the sum is at most 1, the
          row is certified as accurate.
        - ``"closure"``: by how much the loops are open, and the error of the variables
          (rad).
        - ``("velocities", k)``: components of the angular velocities of links while input k
          moves.
        - ``("errors", k)``: for each kind of error bound in `REPORTED_ERRORS`, the largest
          bound of any pole, while input k moves.
        """
        rows = self._rows
        parts: dict[Any, Sequence[Expr]] = {
            "uncertainty_sum": [sum(self._uncertainties, 0.0)],
            "closure": [rows.residual, rows.configuration_error],
            "uncertainties": self._uncertainties,
        }
        for k, columns in enumerate(self.input_columns):
            parts["velocities", k] = columns.velocity_components
            parts["errors", k] = [
                largest(self._error_bounds_of_poles(columns, name))
                for name in REPORTED_ERRORS
            ]
        return parts

    def _error_bounds_of_poles(
        self, input_columns: InputColumns, error_name: str
    ) -> list[Expr]:
        """Return the expression of one kind of error bound for each pole.

        A pole is the axis of the relative rotation of two links while one input moves. The
        list `_columns` has the expressions of all results of this kernel.

        Parameters
        ----------
        input_columns
            Where the results for the moving input are in `_columns`.
        error_name
            The kind of error bound, one of `REPORTED_ERRORS`, such as "direction_error".
        """
        indices_by_pole = input_columns.column_indices[error_name]
        error_bounds: list[Expr] = []
        for indices in indices_by_pole.values():
            # A direction, for example, has three columns, but an error bound has one.
            (index,) = indices
            error_bounds.append(self._columns[index])
        return error_bounds

    @cached_property
    def row_quality(self) -> ColumnFunction:
        """The function that returns the quality measures of rows, from all variables."""
        # With a closed form this function is called for few rows, so it is not compiled.
        compiled = self.is_compiled and not self.has_closed_form
        return self._make_function(self._quality_expressions, compiled)

    @cached_property
    def closed_form_quality(self) -> ColumnFunction:
        """All variables and the quality measures, as a function of inputs and signs.

        There are formulas for all variables (closed form). A dyad (two links joined by a
        pair) can be closed in two ways, and a sign chooses one of them. The quality
        measures (`_quality_expressions`), such as error bounds, tell the caller whether the
        results of a row (one configuration) are accurate. The caller solves other rows
        again.

        The function also returns the square of the triple product of the three axes of each
        dyad (``"squares"``). It follows from the arcs between the axes, and is negative if
        the dyad cannot be closed.
        """
        assert self._closed_form is not None
        closed_form = self._closed_form
        # All expressions become functions of inputs and signs.
        form_by_variable = dict(zip(self._variables, closed_form.variables, strict=True))
        quality = {
            name: substitute(expressions, form_by_variable)
            for name, expressions in self._quality_expressions.items()
        }
        parts = {
            "variables": closed_form.variables,
            **quality,
            "squares": closed_form.triple_squares,
        }
        # Mechanisms with a closed form have no contacts with profiles.
        return ColumnFunction(
            parts, closed_form.arguments, profiles=(), compiled=self.is_compiled
        )

    @cached_property
    def all_columns(self) -> ColumnFunction:
        """The function that returns all columns of rows, from all variables."""
        return self._make_function({"columns": self._columns}, self.is_compiled)

    @cached_property
    def newton_step(self) -> ColumnFunction:
        """The function that makes a step of Newton's method, which closes the loops.

        Passive variables are variables that no input sets. The function returns their new
        values from the values of all variables.
        """
        return self._make_function({"passive_variables": self._rows.newton_step})

    @cached_property
    def row_bounds(self) -> ColumnFunction:
        """Function of the numbers that tell how accurate a row (configuration) is.

        The kernel must have a single moving input. `RowVelocities` decides by these numbers
        which rows are certified as accurate in float64. It also bounds the errors of the
        other rows, which it computes again in quad precision. The numbers are:

        - ``"condition_number"`` of the loop equations.
        - ``"kantorovich_number"``: if it is at most 1/2, exactly one solution is near.
        - ``"curvature_uncertainty"``: the sum of `curvature_uncertainties`, which has a
          positive number for each contact, except contacts of two circles. A number exceeds
          1 if the two profiles (contact curves) have nearly the same curvature. They then
          hardly determine their motion. If the sum is at most 1, no contact has this
          problem. The sum is NaN if the links would overlap.
        - ``"inverse"`` of the loop equations. A small rotation about an axis of the ground
          may be missing to close a loop. The inverse has the movement of each passive
          variable (not an input) that closes the loop, per rad of this rotation. Its shape
          (passive variables, loops, 3) is flattened; the 3 are the axes of the ground.
        - ``"dw_error"``: error bound of dw, the derivatives of the angular velocities
          of all links with respect to the input.
        - ``"rate_residual"``, ``"acceleration_residual"``: how well the rates and their
          derivatives satisfy the loop equations.
        - ``"rate_size"``, ``"acceleration_size"``: sums of the sizes of all terms of these
          equations.
        """
        rows = self._rows
        moving_input = self.input_columns[0]
        return self._make_function(
            {
                "condition_number": [rows.condition_number],
                "kantorovich_number": [rows.kantorovich_number],
                "curvature_uncertainty": [sum(curvature_uncertainties(rows), 0.0)],
                "inverse": [*rows.inverse[rows.passive_variables].flat],
                "dw_error": [moving_input.dw_error],
                "rate_residual": [moving_input.rate_residual],
                "acceleration_residual": [moving_input.acceleration_residual],
                "rate_size": [moving_input.rate_size],
                "acceleration_size": [moving_input.acceleration_size],
            }
        )


def row_kernel(
    motion: Motion,
    requests: Sequence[Request],
    engine: KernelEngine,
    order: EliminationOrder | None = None,
) -> RowKernel | None:
    """Return the kernel: the functions that compute poles and velocities of configurations.

    A pole is the axis of the relative rotation of two links. Kernels are cached. Equal
    requests for a mechanism get the same kernel.

    Parameters
    ----------
    motion
        Closed configurations of the mechanism, in any assembly modes (ways to assemble it).
    requests
        The requested quantities, for each input that moves while the others are locked.
    engine
        What evaluates the expressions: "numpy", or "compiled" (heyoka).
    order
        The order in which variables are eliminated from the loop equations. An order is
        good at a configuration if the elimination divides by no number near zero there. By
        default the order is chosen that is good at the largest number of configurations.

    Returns
    -------
    RowKernel or None
        None if no order is good at any configuration, or if the elimination of the
        expressions divides by zero.
    """
    # A pivot is a loop with the variables for which its equations are solved. `pivots` has
    # them in the order of elimination.
    pivots = choose_order(motion) if order is None else order
    if pivots is None:
        return None

    quantities = [
        (request.plan.input, request.poles, sorted(request.links)) for request in requests
    ]
    key = repr(("rows", quantities, pivots, engine))
    # If a divisor in the expressions is exactly zero, `RowKernel` raises this error, and
    # there is no kernel.
    with suppress(ZeroDivisionError):
        return FUNCTION_CACHE.get(
            motion.mechanism, key, lambda: RowKernel(motion, requests, pivots, engine)
        )
    return None


def choose_order(motion: Motion) -> EliminationOrder | None:
    """Choose an elimination order that is regular at as many rows as possible.

    The velocity equations are solved in a fixed order: which variables are eliminated from
    the equations of which loop. The order is regular at a row (configuration of the motion)
    if no step divides by nearly zero.

    Returns
    -------
    The order, empty if all variables are inputs. None if no row has a configuration, or if
    the equations cannot be solved for all other variables by any order.
    """
    if not motion.passive_variables:
        return []
    # `kantorovich_error` is the error bound (rad) of the variables. Rows with a large bound
    # are near singular configurations and are only used if there are no others.
    is_accurate = motion.kantorovich_error < MAX_REFERENCE_ERROR_RAD
    candidates = np.flatnonzero(~motion.failed & is_accurate)
    if not len(candidates):
        candidates = np.flatnonzero(~motion.failed)
    if not len(candidates):
        return None
    # The order is chosen for at most `REFERENCES` candidates, evenly spread: the
    # references.
    spread = np.unique(np.linspace(0, len(candidates) - 1, REFERENCES).astype(int))
    references = candidates[spread]
    orders_with_rows = assign_elimination_orders(
        motion.linearisation.jacobian[references], motion.passive_variables
    )
    if not orders_with_rows:
        return None
    # Each order comes with the references that are assigned to it. The order with the most
    # references is returned, or the first of several with equally many.
    order, _ = max(orders_with_rows, key=lambda order_and_rows: len(order_and_rows[1]))
    return order
