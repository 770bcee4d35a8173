"""Descents of a synthesis from a design to a local optimum, by exact gradients.

Points are in units of the ranges of the variables: each coordinate goes from 0 to 1.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Floats
from spherekit.designs.cutting_planes import LinearisedFunctions, minimize_largest
from spherekit.designs.design_conditions import Columns
from spherekit.designs.design_evaluation import DesignEvaluator
from spherekit.designs.figure_gradients import FigureGradients, with_derivatives
from spherekit.designs.synthesis_modes import SynthesisMode
from spherekit.designs.synthesis_requirements import MATCH, Specification
from spherekit.designs.varied_mechanism import RADIANS_PER_DEGREE
from spherekit.geometry.vectors import all_finite, max_abs
from spherekit.symbolic.expression_graph import Expr, symbols
from spherekit.symbolic.parsed_expressions import convert_to_graph

MAX_QUADRATIC_STEPS = 50
"""Largest number of steps of sequential quadratic programming in one descent."""

CONSTRAINT_TOLERANCE = 1e-9
"""A constraint counts as satisfied if it is violated by less, relative to its size."""

UNDEFINED_OBJECTIVE = 1e6
"""Least value given to the objective, and violation of constraints, of undefined designs.

It is so large that a line search turns back.
"""

OBJECTIVE_TOLERANCE = 1e-6
"""Designs whose objectives differ by less are equally good.

The number is relative to the width of each objective along the front, or to its smallest
value. Larger: fewer descents, and fronts are less exact. Smaller: more descents.
"""

MIN_RELATIVE_DECREASE = 0.1 * OBJECTIVE_TOLERANCE
"""A descent ends if no objective decreases by more, relative to the same scale."""

MAX_DESCENT_ROUNDS = 12
"""Largest number of descents in turn, each from the end of the one before."""

MAX_OTHER_STARTS = 3
"""Largest number of other points from which a design of a front is challenged.

They are the points that come nearest to being better than the design.
"""

MIN_START_DISTANCE = 0.1
"""Starting points that differ by less in all coordinates lead to the same optimum."""


@dataclass(frozen=True)
class LocalOptimum:
    """A design at which a local optimisation (descent) has ended, with its objectives.

    A design is one choice of the sizes of a mechanism.

    Attributes
    ----------
    mode
        The assembly mode (way to assemble the mechanism) in which the design is used.
    x
        (variables,) coordinates of the design, one for each design variable: 0 and 1 are
        the ends of the range of the variable.
    objectives
        (k,) values of the objectives, which are minimised.
    figures
        (figures,) figures of merit (numbers that rate a design), with angles in the unit
        (deg or rad) of the mechanism file.
    """

    mode: SynthesisMode
    x: Floats
    objectives: Floats
    figures: Floats


@dataclass(frozen=True)
class DescentValues:
    """Objectives and conditions of one design in one assembly mode, with gradients.

    An assembly mode is one way to assemble the mechanism. A local optimisation (descent)
    needs these values.

    Attributes
    ----------
    functions
        The values of all objectives and conditions, and their gradients with respect to the
        coordinates of the design (0 to 1 in the range of each variable). The value of a
        condition is positive if it is violated. Conditions on `closing_fraction` are left
        out, because this fraction is not smooth.
    closing_fraction
        Fraction of the samples at which the mechanism can be assembled in this mode.
    meets_closing_conditions
        Whether the conditions that depend on this fraction are met.
    figures
        (figures,) figures of merit (numbers that rate a design), with angles in the unit
        (deg or rad) of the mechanism file.
    """

    functions: LinearisedFunctions
    closing_fraction: float
    meets_closing_conditions: bool
    figures: Floats


class CandidateStarts(NamedTuple):
    """Designs from which another descent (local optimisation) may start.

    Attributes
    ----------
    points
        (n, variables) the designs, in units of the ranges of the variables (0 to 1).
    objectives
        (n, k) values of the k objectives, which are minimised.
    """

    points: Floats
    objectives: Floats


class ExpressionValues(NamedTuple):
    """Objectives and conditions of a design, and derivatives with respect to arguments.

    The arguments are the design variables and the figures of merit.

    Attributes
    ----------
    values
        (expressions,) the objectives, then the conditions.
    partial_slopes
        (arguments, expressions) derivatives with respect to each argument while the others
        are constant. Derivatives that do not exist are zero.
    """

    values: Floats
    partial_slopes: Floats


class Descent:
    """Local optimisations (descents) of designs until the objectives no longer decrease.

    Parameters
    ----------
    specification
        The objectives, the conditions and the ranges of the variables.
    rows
        Table of n evaluated designs by column, each design in one assembly mode. Some of
        the designs are used as further starts.
    objectives
        (n, k) objectives of these designs.

    Attributes
    ----------
    points
        (n, variables) the designs, with each variable from 0 to 1 over its range.
    modes
        (n,) labels of their assembly modes (ways to assemble the links).
    scales
        (k,) scale of each objective, by which objectives are compared. With several
        objectives, the scale is the largest minus the smallest value of the n designs. If
        this is 0, and for a single objective, it is the smallest absolute value.
    """

    def __init__(
        self, specification: Specification, rows: Columns, objectives: Floats
    ) -> None:
        """Convert designs to coordinates, and objectives and conditions to a function.

        Parameters
        ----------
        specification
            The objectives, which are minimised, the conditions, and the sweep with the
            ranges of the design variables and the figures of merit.
        rows
            Columns of the table of n designs from which descents may start.
        objectives
            (n, k) objectives of these designs.
        """
        sweep = specification.sweep
        assert isinstance(sweep.evaluator, DesignEvaluator)
        self.sweep = sweep
        self._figure_gradients = FigureGradients(sweep.evaluator)
        # Coordinates run from 0 to 1 over the range of each variable.
        self._low = np.array([variation.low for variation in sweep.space.variations])
        high = np.array([variation.high for variation in sweep.space.variations])
        self._width = high - self._low
        values = np.transpose([rows[variable.name] for variable in sweep.variables])
        self.points = (values - self._low) / self._width
        self.modes = rows["mode"]
        self._row_objectives = objectives
        self.scales = self._objective_scales(objectives)

        # One symbol for each design variable and each figure of merit. Texts of the user,
        # such as objectives, become expressions of these symbols. `convert_to_graph`
        # requires two nodes for each name, with and without whole revolutions; here the two
        # nodes are equal.
        symbols_by_name = {node.arguments[0]: node for node in symbols(sweep.names)}
        nodes_by_name = {name: (node, node) for name, node in symbols_by_name.items()}
        # The name MATCH is the root mean square of the errors at precision points.
        if specification.matched:
            misses = [symbols_by_name[name] for name in specification.matched]
            match = np.sqrt(sum(miss * miss for miss in misses) / specification.points)
            nodes_by_name[MATCH] = (match, match)
        expressions: list[Expr] = [
            convert_to_graph(objective, nodes_by_name)
            for objective in specification.objectives
        ]
        self._objective_count = len(expressions)
        # A condition less < more becomes less - more, which must not be positive.
        # Conditions on "closes", the fraction of samples at which a mode closes, are
        # checked separately, because the fraction is not smooth.
        expressions += [
            convert_to_graph(condition.less, nodes_by_name)
            - convert_to_graph(condition.more, nodes_by_name)
            for condition in sweep.conditions
            if "closes" not in condition.names
        ]
        self._closing_conditions = [
            condition for condition in sweep.conditions if "closes" in condition.names
        ]
        self._functions_and_slopes = with_derivatives(
            expressions, [*symbols_by_name.values()]
        )
        # Figures are computed in rad and SI units. Each factor is the unit of a figure in
        # the user's texts, in rad or SI units.
        units = [sweep.units()[merit.name] for merit in sweep.merits]
        self._figure_units = np.array(
            [RADIANS_PER_DEGREE if unit == "deg" else 1.0 for unit in units]
        )
        # The optimiser calls for values and for gradients separately. Results of the last
        # point are therefore stored, by the point and the mode.
        self._last_values: dict[tuple[bytes, SynthesisMode], DescentValues] = {}

    @staticmethod
    def _objective_scales(objectives: Floats) -> Floats:
        """Return the `scales` (k,) for objectives (n, k); 1 where they would be 0."""
        widths = np.ptp(objectives, axis=0)
        has_front = (widths > 0.0) & (objectives.shape[1] > 1)
        smallest = np.min(np.abs(objectives), axis=0)
        return np.where(has_front, widths, np.where(smallest > 0.0, smallest, 1.0))

    @property
    def tolerance(self) -> Floats:
        """(k,) difference by which an objective of a better design must be smaller."""
        return OBJECTIVE_TOLERANCE * self.scales

    def file_values(self, x: Floats) -> Floats:
        """Return the design variables (variables,) of a point, in the units of the file."""
        return self._low + self._width * x

    def track_mode_from(self, x: Floats, mode: SynthesisMode) -> SynthesisMode:
        """Return a mode that is tracked from the design at x from now on."""
        varied_mechanism = self._figure_gradients.evaluator.varied_mechanism
        design = varied_mechanism.evaluate_design(self.file_values(x))
        return mode if design is None else mode.with_origin(design)

    def evaluate(self, x: Floats, mode: SynthesisMode) -> DescentValues:
        """Return objectives and conditions of a design in a mode, with their gradients.

        An assembly mode is one way to assemble the mechanism.

        Parameters
        ----------
        x
            (variables,) the design: the position of each variable in its range (0 to 1).
        mode
            The assembly mode.

        Returns
        -------
        Objectives and conditions with their gradients with respect to x, and the fraction
        of samples at which the mechanism can be assembled. If the design is impossible,
        values that depend on figures of merit are NaN. Gradients that do not exist are
        zero.
        """
        # The optimiser asks for values and gradients separately, so the last result is
        # stored.
        key = x.tobytes(), mode
        if key not in self._last_values:
            self._last_values = {key: self._evaluate_point(x, mode)}
        return self._last_values[key]

    def _evaluate_point(self, x: Floats, mode: SynthesisMode) -> DescentValues:
        """Compute the result of `evaluate` by the chain rule.

        Objectives and conditions are expressions of the design variables (sizes) and of the
        figures of merit (numbers that rate a design). A figure belongs to one assembly mode
        (way to assemble the mechanism). The coordinates of the point x are the positions of
        the variables in their ranges (0 to 1).
        """
        # Values of the design variables in the units of the mechanism file.
        values = self.file_values(x)
        # The figures of merit, and their derivatives with respect to the design variables.
        figure_values = self._figure_gradients.evaluate(values, mode)
        # The expressions are texts of the user, with angles in the unit of the file.
        # `figure_values` has them in rad, so they are divided by the unit (in rad).
        figures = figure_values.figures / self._figure_units
        # A coordinate of x goes from 0 to 1, and its variable over the width of its range.
        # So a derivative with respect to x is the derivative with respect to the variable,
        # times the width.
        # (variables, variables) derivatives of the variables with respect to x.
        variable_slopes = np.diag(self._width)
        # (figures, variables) derivatives of the figures with respect to the variables.
        slopes_by_variables = figure_values.gradients
        # (figures, variables) derivatives of the figures with respect to x.
        figure_slopes = slopes_by_variables * self._width / self._figure_units[:, None]
        # NaN is replaced by 0, because 0 * NaN would spread to expressions that do not
        # depend on this figure.
        inner_slopes = np.nan_to_num(np.concatenate([variable_slopes, figure_slopes]))

        arguments = np.concatenate([values, figures])
        expressions = self._evaluate_expressions(arguments)
        # (expressions, variables) by the chain rule. `partial_slopes` (arguments,
        # expressions) has the derivatives with respect to the variables and figures.
        gradients = expressions.partial_slopes.T @ inner_slopes
        # The first k expressions are objectives, the others are conditions (limits). A
        # limit is positive if the condition is violated.
        k = self._objective_count
        functions = LinearisedFunctions(
            objectives=expressions.values[:k],
            objective_gradients=gradients[:k],
            limits=expressions.values[k:],
            limit_gradients=gradients[k:],
        )
        # `closing_fraction` is the fraction of samples at which the mechanism can be
        # assembled.
        closing_fraction = figure_values.closing_fraction
        columns = dict(zip(self.sweep.names, arguments, strict=True))
        columns["closes"] = closing_fraction
        meets_closing_conditions = all(
            condition.find_met(columns) for condition in self._closing_conditions
        )
        return DescentValues(functions, closing_fraction, meets_closing_conditions, figures)

    def _evaluate_expressions(self, arguments: Floats) -> ExpressionValues:
        """Return objectives and conditions at values of their arguments, with derivatives.

        The objectives and conditions of the optimisation are expressions of the user. Their
        arguments are design variables and figures of merit (numbers that rate a design).

        Parameters
        ----------
        arguments
            The design variables and then the figures of merit, in the units of the
            mechanism file.
        """
        with np.errstate(all="ignore"):
            outputs = self._functions_and_slopes(arguments[:, None])
        # Row 0 has the values. Each further row has the derivatives with respect to one
        # argument.
        outputs = outputs.reshape(len(arguments) + 1, -1)
        slopes = outputs[1:]  # (arguments, expressions)
        # A derivative that does not exist is NaN or infinite. It becomes 0, so that the
        # optimiser ignores the argument.
        partial_slopes = np.where(np.isfinite(slopes), slopes, 0.0)
        return ExpressionValues(values=outputs[0], partial_slopes=partial_slopes)

    def objectives(self, x: Floats, mode: SynthesisMode) -> Floats:
        """Return the objectives (k,) at a point in a mode."""
        return self.evaluate(x, mode).functions.objectives

    def minimize_first_objective(self, x: Floats, mode: SynthesisMode) -> Floats:
        """Return the point at which a descent of the first objective ends.

        The other objectives must not increase (the epsilon-constraint method; Haimes,
        Lasdon and Wismer 1971). The mechanism must close in this assembly mode at as many
        samples as at the start.

        Parameters
        ----------
        x
            (variables,) the first design, each variable from 0 to 1 over its range.
        mode
            The assembly mode.

        Returns
        -------
        (variables,) the last point, or the first one if the last one is worse or violates a
        constraint.
        """
        from scipy.optimize import minimize

        start = self.evaluate(x, mode)
        start_objectives = start.functions.objectives
        # An undefined design must be worse than the start.
        undefined_objective = max(UNDEFINED_OBJECTIVE, 2.0 * abs(start_objectives[0]))

        def objective(y: Floats) -> tuple[float, Floats]:
            """Return the first objective and its gradient."""
            functions = self.evaluate(y, mode).functions
            if not np.isfinite(functions.objectives[0]):
                return undefined_objective, np.zeros_like(y)
            return functions.objectives[0], functions.objective_gradients[0]

        def slack(y: Floats) -> Floats:
            """Return the constraints, as numbers that must not be negative.

            There are three kinds. The fraction of samples at which the loops close must not
            fall below that at the start. The conditions must be met. The other objectives
            must not increase.
            """
            values = self.evaluate(y, mode)
            decreases = start_objectives[1:] - values.functions.objectives[1:]
            closing_gain = values.closing_fraction - start.closing_fraction
            slacks = np.concatenate([[closing_gain], -values.functions.limits, decreases])
            return np.nan_to_num(slacks, nan=-UNDEFINED_OBJECTIVE)

        def slack_gradients(y: Floats) -> Floats:
            """Return the gradients of the constraints of `slack`, in the same order."""
            functions = self.evaluate(y, mode).functions
            return np.concatenate(
                [
                    # The fraction of samples at which the mode closes changes in steps, so
                    # its gradient is zero between them.
                    np.zeros((1, len(y))),
                    -functions.limit_gradients,
                    -functions.objective_gradients[1:],
                ]
            )

        result = minimize(  # type: ignore[call-overload]
            objective,
            x,
            jac=True,
            method="SLSQP",
            bounds=[(0.0, 1.0)] * len(x),
            constraints=[{"type": "ineq", "fun": slack, "jac": slack_gradients}],
            options={"maxiter": MAX_QUADRATIC_STEPS, "ftol": 1e-14},
        )
        end: Floats = np.clip(result.x, 0.0, 1.0)
        is_better = objective(end)[0] <= objective(x)[0]
        tolerances = CONSTRAINT_TOLERANCE * (1.0 + np.abs(slack(x)))
        meets_constraints = (
            np.all(slack(end) >= -tolerances)
            and self.evaluate(end, mode).meets_closing_conditions
        )
        return end if is_better and meets_constraints else x

    def approach_aim(
        self, x: Floats, mode: SynthesisMode, aim: Floats
    ) -> tuple[Floats, float]:
        """Change a design so that its objectives come as near to an aim as possible.

        The largest of the k differences (objective - aim) / scale is minimised (the
        scalarisation of Pascoletti and Serafini 1984). If the aim is the objectives at x,
        the descent decreases all of them, until no step can.

        Parameters
        ----------
        x
            (variables,) the design at which the descent begins: the position of each
            variable in its range (0 to 1).
        mode
            The assembly mode (way to assemble the mechanism). Designs that can be assembled
            in this mode at fewer samples of the inputs than the first design are refused.
            The user can state conditions on the fraction of samples at which the mode can
            be assembled (``closes``). Designs that violate them are refused, too.
        aim
            (k,) aims of the objectives.

        Returns
        -------
        x
            (variables,) the design at which the descent ends.
        largest_excess
            The largest of these differences at the end of the descent, negative if all
            objectives are below the aim.
        """
        min_closing_fraction = self.evaluate(x, mode).closing_fraction

        def scaled_functions(y: Floats) -> LinearisedFunctions | None:
            """Return the functions that the optimiser minimises or limits, at a design y.

            The objectives of the result are (objective - aim) / scale. The optimiser
            minimises the largest of them. `self.scales` makes objectives in different units
            comparable. The limits are the conditions of the synthesis that are smooth
            functions of the design. A limit is violated where it is positive.

            The result is None if a number is not finite, or if the design is refused.
            """
            values = self.evaluate(y, mode)
            # A design is refused if it can be assembled at fewer samples than the first
            # design.
            if values.closing_fraction < min_closing_fraction:
                return None
            # It is also refused if a condition of the user on this fraction is not met.
            if not values.meets_closing_conditions:
                return None
            functions = values.functions
            scaled = LinearisedFunctions(
                objectives=(functions.objectives - aim) / self.scales,
                objective_gradients=functions.objective_gradients / self.scales[:, None],
                limits=functions.limits,
                limit_gradients=functions.limit_gradients,
            )
            return scaled if all(map(all_finite, scaled)) else None

        return minimize_largest(scaled_functions, x, MIN_RELATIVE_DECREASE)

    def descend(self, mode: SynthesisMode, x: Floats) -> LocalOptimum:
        """Return the local optimum to which descents from a point lead.

        Two kinds of descent alternate until no objective decreases any more. The first
        decreases the first objective by sequential quadratic programming, while the others
        must not increase. This descent may stop too early at kinks of the objectives. The
        second decreases all objectives together, by a method for functions with kinks.

        Parameters
        ----------
        mode
            The assembly mode (way to assemble the mechanism). A mode is stored as
            configurations of one design, from which those of near designs are computed.
            After each descent the configurations of the new design are stored.
        x
            (variables,) the first point: the position of each variable in its range (0 to
            1).
        """
        for _ in range(MAX_DESCENT_ROUNDS):
            start_objectives = self.objectives(x, mode)
            x = self.minimize_first_objective(x, mode)
            mode = self.track_mode_from(x, mode)
            # The aims are the objectives at x, so all differences (objective - aim) are 0
            # at the start. The largest difference becomes negative only if every objective
            # decreases.
            x, _ = self.approach_aim(x, mode, aim=self.objectives(x, mode))
            mode = self.track_mode_from(x, mode)
            # `scales` makes decreases of different objectives comparable.
            decrease = (start_objectives - self.objectives(x, mode)) / self.scales
            # The comparison is False for NaN, so NaN ends the loop.
            if not np.max(decrease) > MIN_RELATIVE_DECREASE:
                break
        return self.as_optimum(mode, x)

    def as_optimum(self, mode: SynthesisMode, x: Floats) -> LocalOptimum:
        """Return a point in a mode with its objectives and figures."""
        values = self.evaluate(x, mode)
        return LocalOptimum(mode, x, values.functions.objectives, values.figures)

    def challenge(
        self, optimum: LocalOptimum, optima: Sequence[LocalOptimum]
    ) -> LocalOptimum:
        """Look for a design that is better than a local optimum in all objectives.

        Descents from other designs aim at the objectives of the optimum: they bring their
        own objectives as far below these as possible. If a descent ends below all of them,
        further descents from its end lead to a new local optimum. This one replaces the
        old optimum, and the search begins anew.

        Parameters
        ----------
        optimum
            The local optimum.
        optima
            All local optima of the synthesis, which serve as further starts.

        Returns
        -------
        The optimum itself, or the last one that replaced it.
        """
        for _ in range(MAX_DESCENT_ROUNDS):
            for start in self._other_starts(optimum, optima):
                x, largest_excess = self.approach_aim(
                    start, optimum.mode, aim=optimum.objectives
                )
                if largest_excess < -OBJECTIVE_TOLERANCE:
                    optimum = self.descend(optimum.mode, x)
                    break
            else:
                # No start led to a better design.
                break
        return optimum

    def _other_starts(
        self, optimum: LocalOptimum, optima: Sequence[LocalOptimum]
    ) -> Iterator[Floats]:
        """Yield starts of descents that may lead to a better design than an optimum.

        Starts are designs that were evaluated before all descents, and optima of other
        descents. All starts have the same assembly mode (way to assemble the mechanism) as
        the optimum. Starts with nearly the objectives of the optimum, or better ones, come
        first. A start too near to the optimum or to an earlier start is left out.

        Yields
        ------
        (variables,) the start: the position of each variable in its range (0 to 1).
        """
        candidates = self._candidate_starts(optimum, optima)
        excesses = (candidates.objectives - optimum.objectives) / self.scales
        # The largest amount by which an objective exceeds that of the optimum.
        largest_excess = np.max(excesses, axis=1)
        starts: list[Floats] = []
        for k in np.argsort(largest_excess, kind="stable"):
            if len(starts) >= MAX_OTHER_STARTS:
                return
            point = candidates.points[k]
            distances = [max_abs(point - other) for other in (optimum.x, *starts)]
            if all(distance >= MIN_START_DISTANCE for distance in distances):
                starts.append(point)
                yield point

    def _candidate_starts(
        self, optimum: LocalOptimum, optima: Sequence[LocalOptimum]
    ) -> CandidateStarts:
        """Return all designs at which descents to a better design may start.

        A descent from each start aims at a design that is better than an optimum in all
        objectives. The result has designs that were evaluated before all descents, and
        optima of other descents. All have the same assembly mode (way to assemble the
        mechanism) as the optimum.
        """
        # Of earlier designs, only the label of the mode is known, so labels are compared.
        is_same_mode = self.modes == optimum.mode.label
        points = [self.points[is_same_mode]]
        objectives = [self._row_objectives[is_same_mode]]
        # Of optima, the modes themselves are known. `continues_in` compares them.
        for candidate in optima:
            if candidate.mode.continues_in(optimum.mode):
                points.append(candidate.x[None, :])
                objectives.append(candidate.objectives[None, :])
        return CandidateStarts(np.concatenate(points), np.concatenate(objectives))


def is_better(
    optimum: LocalOptimum, other_optimum: LocalOptimum, tolerance: Floats
) -> bool:
    """Return whether an optimum is better than another optimum, within a tolerance (k,).

    An optimum has k objectives, which are minimised. A better optimum has an objective that
    is smaller by more than the tolerance, and none that is larger by more.
    """
    decrease = other_optimum.objectives - optimum.objectives
    return bool(np.all(decrease >= -tolerance) and np.any(decrease > tolerance))


def select_unbeaten(
    optima: Sequence[LocalOptimum], tolerance: Floats
) -> list[LocalOptimum]:
    """Return the optima that no other optimum of the same assembly mode beats.

    An assembly mode is one of the ways to assemble the mechanism. An optimum beats another
    if one of its objectives is smaller by more than the tolerance and no objective is
    larger by more than the tolerance.

    Parameters
    ----------
    optima
        Local optima: designs with their objectives, which are minimised.
    tolerance
        (k,) differences of the k objectives that do not count.

    Returns
    -------
    The optima that remain, in their order.
    """
    unbeaten = []
    for optimum in optima:
        # `continues_in` follows the assembly mode of the other design to this design, and
        # tells whether it is the same mode.
        is_beaten = any(
            other.mode.continues_in(optimum.mode) and is_better(other, optimum, tolerance)
            for other in optima
        )
        if not is_beaten:
            unbeaten.append(optimum)
    return unbeaten
