"""Descents of a synthesis from a design to a local optimum, by exact gradients.

Points are in units of the ranges of the variables: each coordinate goes from 0 to 1.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

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
"""Objective, and violation of constraints, where a design is undefined.

It is so large that a line search turns back.
"""

OBJECTIVE_TOLERANCE = 1e-6
"""Designs whose objectives differ by less are equally good.

The number is relative to the width of each objective along the front, or to its smallest
value. Larger: fewer descents, and fronts are less exact. Smaller: more descents.
"""

MIN_RELATIVE_DECREASE = 0.1 * OBJECTIVE_TOLERANCE
"""A descent ends if no objective decreases by more, relative in the same way."""

MAX_DESCENT_ROUNDS = 12
"""Largest number of times that a descent is started again from its end."""

MAX_OTHER_STARTS = 3
"""Number of other points from which a design of a front is challenged.

They are those that are nearest to being better than it.
"""

MIN_START_DISTANCE = 0.1
"""Starting points that differ by less in all coordinates lead to the same optimum."""


@dataclass(frozen=True)
class LocalOptimum:
    """A point at which a descent ended.

    Attributes
    ----------
    mode
        The assembly mode.
    x
        (variables,) the point, in units of the ranges.
    objectives
        (k,) objectives there.
    figures
        (figures,) figures of merit there, angles in the unit of the file.
    """

    mode: SynthesisMode
    x: Floats
    objectives: Floats
    figures: Floats


@dataclass(frozen=True)
class DescentValues:
    """Objectives and conditions of a design in a mode.

    Attributes
    ----------
    functions
        Objectives and conditions with their gradients by the coordinates. Conditions are
        limits: by how much they are violated, negative where they are met.
    closes
        Fraction of the samples at which the mode closes.
    figures
        (figures,) figures of merit, angles in the unit of the file.
    """

    functions: LinearisedFunctions
    closes: float
    figures: Floats


class Descent:
    """Descents to designs from which the objectives no longer decrease.

    Parameters
    ----------
    specification
        The objectives, the conditions and the ranges of the variables.
    rows
        Columns of the table of designs, with designs that are tried as other starts.
    objectives
        (n, k) objectives of these rows.

    Attributes
    ----------
    points
        (n, variables) the rows as points, in units of the ranges.
    modes
        (n,) labels of their assembly modes.
    scales
        (k,) scale of each objective, by which objectives are compared: its width along the
        rows if there are several objectives, otherwise its smallest absolute value.
    """

    def __init__(
        self, specification: Specification, rows: Columns, objectives: Floats
    ) -> None:
        """Make points of the rows, and the function of objectives and conditions."""
        sweep = specification.sweep
        assert isinstance(sweep.evaluator, DesignEvaluator)
        self.sweep = sweep
        self._figure_gradients = FigureGradients(sweep.evaluator)
        self._low = np.array([variation.low for variation in sweep.space.variations])
        high = np.array([variation.high for variation in sweep.space.variations])
        self._width = high - self._low
        values = np.transpose([rows[variable.name] for variable in sweep.variables])
        self.points = (values - self._low) / self._width
        self.modes = rows["mode"]
        self._row_objectives = objectives
        self.scales = self._objective_scales(objectives)

        symbols_by_name = {node.arguments[0]: node for node in symbols(sweep.names)}
        # The same expression is used with and without whole revolutions.
        named = {name: (node, node) for name, node in symbols_by_name.items()}
        # The error at precision points is no figure of the kernel, but a root mean square.
        if specification.matched:
            misses = [symbols_by_name[name] for name in specification.matched]
            match = np.sqrt(sum(miss * miss for miss in misses) / specification.points)
            named[MATCH] = (match, match)
        expressions: list[Expr] = [
            convert_to_graph(objective, named) for objective in specification.objectives
        ]
        self._objective_count = len(expressions)
        # A condition less < more becomes less - more, which must not be positive. How often
        # a mode closes is no smooth function; it is a constraint of its own.
        expressions += [
            convert_to_graph(condition.less, named)
            - convert_to_graph(condition.more, named)
            for condition in sweep.conditions
            if "closes" not in condition.names
        ]
        self._function = with_derivatives(expressions, [*symbols_by_name.values()])
        units = [sweep.units()[merit.name] for merit in sweep.merits]
        self._figure_units = np.array(
            [RADIANS_PER_DEGREE if unit == "deg" else 1.0 for unit in units]
        )
        # The optimiser asks for values and gradients at the same point one by one.
        self._last_values: dict[tuple[bytes, SynthesisMode], DescentValues] = {}

    @staticmethod
    def _objective_scales(objectives: Floats) -> Floats:
        """Return the `scales` (k,) for objectives (n, k); 1 for objectives that are 0."""
        widths = np.ptp(objectives, axis=0)
        has_front = (widths > 0.0) & (objectives.shape[1] > 1)
        smallest = np.min(np.abs(objectives), axis=0)
        return np.where(has_front, widths, np.where(smallest > 0.0, smallest, 1.0))

    @property
    def tolerance(self) -> Floats:
        """(k,) by how much an objective must be smaller for a design to be better."""
        return OBJECTIVE_TOLERANCE * self.scales

    def file_values(self, x: Floats) -> Floats:
        """Return the values (variables,) of a point, in the units of the file."""
        return self._low + self._width * x

    def track_mode_from(self, x: Floats, mode: SynthesisMode) -> SynthesisMode:
        """Return a mode that is tracked from the design at x from now on."""
        varied_mechanism = self._figure_gradients.evaluator.varied_mechanism
        design = varied_mechanism.evaluate_design(self.file_values(x))
        return mode if design is None else mode.with_origin(design)

    def evaluate(self, x: Floats, mode: SynthesisMode) -> DescentValues:
        """Return objectives and conditions at a point in a mode, with their gradients.

        Parameters
        ----------
        x
            (variables,) the point, in units of the ranges of the variables (0 to 1).
        mode
            The assembly mode: one of the ways in which the links are put together.

        Returns
        -------
        Objectives and conditions. Those that depend on figures are NaN if there is no such
        design. Gradients that do not exist are zero.
        """
        key = x.tobytes(), mode
        if key not in self._last_values:
            values = self.file_values(x)
            figure_values = self._figure_gradients.evaluate(values, mode)
            figures = figure_values.figures / self._figure_units
            figure_slopes = (
                figure_values.gradients * self._width / self._figure_units[:, None]
            )
            # Derivatives of the values and of the figures by the coordinates.
            by_coordinates = np.nan_to_num(
                np.concatenate([np.diag(self._width), figure_slopes])
            )
            with np.errstate(all="ignore"):
                outputs = self._function(np.concatenate([values, figures])[:, None])
            # Index 0 has the expressions, then their derivatives by values and figures. The
            # expressions are the k objectives and then the conditions.
            outputs = outputs.reshape(len(by_coordinates) + 1, -1)
            partial_slopes = np.where(np.isnan(outputs[1:]), 0.0, outputs[1:])
            gradients = partial_slopes.T @ by_coordinates
            k = self._objective_count
            functions = LinearisedFunctions(
                objectives=outputs[0, :k],
                objective_gradients=gradients[:k],
                limits=outputs[0, k:],
                limit_gradients=gradients[k:],
            )
            self._last_values = {
                key: DescentValues(functions, figure_values.closes, figures)
            }
        return self._last_values[key]

    def objectives(self, x: Floats, mode: SynthesisMode) -> Floats:
        """Return the objectives (k,) at a point in a mode."""
        return self.evaluate(x, mode).functions.objectives

    def minimize_first_objective(self, x: Floats, mode: SynthesisMode) -> Floats:
        """Return the point at which a descent of the first objective ends.

        The other objectives must not increase (the epsilon-constraint method; Haimes,
        Lasdon and Wismer 1971). The mode must close at as many samples as at the start.

        Parameters
        ----------
        x
            (variables,) the first point.
        mode
            The assembly mode.

        Returns
        -------
        (variables,) the last point, or the first one if the last one is not better.
        """
        from scipy.optimize import minimize

        start = self.evaluate(x, mode)
        start_objectives = start.functions.objectives

        def objective(y: Floats) -> tuple[float, Floats]:
            """Return the first objective and its gradient."""
            functions = self.evaluate(y, mode).functions
            if not np.isfinite(functions.objectives[0]):
                return UNDEFINED_OBJECTIVE, np.zeros_like(y)
            return functions.objectives[0], functions.objective_gradients[0]

        def slack(y: Floats) -> Floats:
            """Return the constraints, as numbers that must not be negative.

            They are the fraction of samples at which the mode closes, less that at the
            start; the conditions; and the decreases of the other objectives.
            """
            values = self.evaluate(y, mode)
            decreases = start_objectives[1:] - values.functions.objectives[1:]
            slacks = np.concatenate(
                [[values.closes - start.closes], -values.functions.limits, decreases]
            )
            return np.nan_to_num(slacks, nan=-UNDEFINED_OBJECTIVE)

        def slack_gradients(y: Floats) -> Floats:
            """Return the gradients of the constraints; that of the fraction is zero."""
            functions = self.evaluate(y, mode).functions
            return np.concatenate(
                [
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
        meets_constraints = np.all(slack(end) >= -tolerances)
        return end if is_better and meets_constraints else x

    def approach_aim(
        self, x: Floats, mode: SynthesisMode, aim: Floats
    ) -> tuple[Floats, float]:
        """Bring all objectives as near to an aim as possible, or below it.

        The largest difference of an objective from its aim is minimised (the scalarisation
        of Pascoletti and Serafini 1984). If the aim is the objectives at x, this is a
        descent of all objectives. It ends where no step decreases all of them.

        Parameters
        ----------
        x
            (variables,) the first point.
        mode
            The assembly mode, which must close at as many samples as there.
        aim
            (k,) aims of the objectives.

        Returns
        -------
        x
            (variables,) the last point.
        largest_excess
            The largest difference from the aim there, in units of the scale of the
            objective. It is negative if all objectives are below the aim.
        """
        min_closes = self.evaluate(x, mode).closes

        def scaled_functions(y: Floats) -> LinearisedFunctions | None:
            """Return differences from the aim, or None where they are not defined."""
            values = self.evaluate(y, mode)
            if values.closes < min_closes:
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

        Descents of the first objective and of all objectives alternate, until no objective
        decreases any more.

        Parameters
        ----------
        mode
            The assembly mode. After each descent its configurations are tracked from the
            design that was reached.
        x
            (variables,) the first point, in units of the ranges.
        """
        for _ in range(MAX_DESCENT_ROUNDS):
            start_objectives = self.objectives(x, mode)
            x = self.minimize_first_objective(x, mode)
            mode = self.track_mode_from(x, mode)
            x, _ = self.approach_aim(x, mode, aim=self.objectives(x, mode))
            mode = self.track_mode_from(x, mode)
            decrease = (start_objectives - self.objectives(x, mode)) / self.scales
            # Written so that NaN ends the descent.
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
        """Look for a design that is better in all objectives, from other starts.

        Parameters
        ----------
        optimum
            The design that is challenged.
        optima
            All optima of the synthesis, which are among the other starts.

        Returns
        -------
        The optimum, or the last one if better ones were found one after the other.
        """
        # A better optimum is challenged anew, until no start leads to a better one.
        for _ in range(MAX_DESCENT_ROUNDS):
            for start in self._other_starts(optimum, optima):
                x, largest_excess = self.approach_aim(
                    start, optimum.mode, aim=optimum.objectives
                )
                if largest_excess < -OBJECTIVE_TOLERANCE:
                    optimum = self.descend(optimum.mode, x)
                    break
            else:
                break
        return optimum

    def _other_starts(
        self, optimum: LocalOptimum, optima: Sequence[LocalOptimum]
    ) -> Iterator[Floats]:
        """Yield points of the same mode away from an optimum, as starts of other descents.

        They are rows of the sweep and other optima. Those whose objectives exceed the
        objectives of the optimum least come first.
        """
        rows = self.modes == optimum.mode.label
        others = [other for other in optima if other.mode.continues_in(optimum.mode)]
        points = np.vstack([self.points[rows], *(other.x for other in others)])
        objectives = np.vstack(
            [self._row_objectives[rows], *(other.objectives for other in others)]
        )
        largest_excess = np.max((objectives - optimum.objectives) / self.scales, axis=1)
        used_points = [optimum.x]
        for k in np.argsort(largest_excess, kind="stable"):
            if len(used_points) > MAX_OTHER_STARTS:
                return
            distances = [max_abs(points[k] - point) for point in used_points]
            if all(distance >= MIN_START_DISTANCE for distance in distances):
                used_points.append(points[k])
                yield points[k]


def is_better(
    optimum: LocalOptimum, other_optimum: LocalOptimum, tolerance: Floats
) -> bool:
    """Return whether an optimum is better than another one, within a tolerance (k,).

    It is smaller in an objective by more than the tolerance, and larger in none by more.
    """
    decrease = other_optimum.objectives - optimum.objectives
    return bool(np.all(decrease >= -tolerance) and np.any(decrease > tolerance))


def select_unbeaten(
    optima: Sequence[LocalOptimum], tolerance: Floats
) -> list[LocalOptimum]:
    """Return the optima than which none of the same assembly mode is better.

    An optimum is better if one of its objectives is smaller by more than the tolerance, and
    none is larger by more.

    Parameters
    ----------
    optima
        Ends of descents, in one or several modes.
    tolerance
        (k,) differences of objectives that do not count.

    Returns
    -------
    The optima that remain, in their order.
    """
    unbeaten = []
    for optimum in optima:
        is_beaten = any(
            other.mode.continues_in(optimum.mode) and is_better(other, optimum, tolerance)
            for other in optima
        )
        if not is_beaten:
            unbeaten.append(optimum)
    return unbeaten
