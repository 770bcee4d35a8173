"""Requirements of a synthesis: objectives, conditions and precision points."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from spherekit.arrays import Array, Floats, Indices
from spherekit.conventions import Names
from spherekit.designs.design_conditions import Columns
from spherekit.designs.design_variables import OK
from spherekit.designs.figures_of_merit import NEVER_CLOSES
from spherekit.designs.sweep import Sweep
from spherekit.errors import DesignError, ModelError
from spherekit.geometry.vectors import all_finite
from spherekit.mechanism.load_expression import Expression, parse
from spherekit.progress import ProgressReporter
from spherekit.wording import counted

MAX_EXPLAINED_DESIGNS = 1024
"""Number of designs by which an error message says which condition excludes them."""

MATCH = "match"
"""Name of the figure that is the root mean square error at the precision points."""

POPULATION_SIZE = 60
"""Number of designs in a generation of the evolution, and largest size of a front."""

MISSING_DESIGN_VIOLATION = 1e6
"""Objectives and violation of the conditions of a design that does not have the mode.

The evolution prefers every design that has the mode and violates conditions by less.
"""

TINY_VIOLATION = 1e-12
"""Violation of a condition ``less < more`` whose two sides are equal."""


@dataclass(frozen=True)
class ModeScores:
    """Objectives and violated conditions of designs in one assembly mode.

    A design is one choice of sizes, and an assembly mode is one way to assemble the
    mechanism. Only the m designs that can be assembled in this mode and have finite
    objectives are included.

    Attributes
    ----------
    design
        (m,) indices of these designs among those that were evaluated.
    objectives
        (m, k) values of the k objectives, which are minimised.
    violations
        (m,) sum of the amounts by which conditions are violated, 0 if all are met.
    """

    design: Indices
    objectives: Floats
    violations: Floats


@dataclass(frozen=True)
class Specification:
    """What a synthesis is to achieve: objectives to minimise and conditions to meet.

    Both are expressions of figures of merit, numbers that rate a design. Precision points
    are inputs at which quantities of the mechanism have desired values.

    Attributes
    ----------
    sweep
        The designs that are evaluated first, their figures of merit, and the conditions.
    minimise
        The objectives, as expressions of figures and variables.
    matched
        Names of the figures that are errors at precision points.
    points
        Number of precision points.

    Raises
    ------
    DesignError
        If an objective is not an expression of figures and variables, or a figure has the
        name of another column of the result.
    """

    sweep: Sweep
    minimise: Names
    matched: Names = ()
    points: int = 1

    def __post_init__(self) -> None:
        _ = self.objectives
        reserved_names = {*self.headings, *([MATCH] if self.matched else [])}
        for merit in self.sweep.merits:
            if merit.name in reserved_names:
                raise DesignError(
                    f'{self.sweep.mechanism.name}: two columns would be called "'
                    f'{merit.name}"; give the figure of merit another name'
                )

    @property
    def headings(self) -> list[str]:
        """The names of the columns of objectives in the result."""
        count = len(self.minimise)
        return ["objective"] if count == 1 else [f"objective_{k + 1}" for k in range(count)]

    @cached_property
    def objectives(self) -> tuple[Expression, ...]:
        """The parsed objectives."""
        names = self.sweep.names
        if self.matched:
            names = [*names, MATCH]
        try:
            return tuple(parse(text, names) for text in self.minimise)
        except ModelError as problem:
            raise DesignError(f"minimise: in the expression, {problem}") from None

    def select_rows(self, columns: Columns) -> tuple[Columns, Floats]:
        """Return the rows of a table of designs that a synthesis can compare.

        A synthesis minimises objectives. A row is one assembly mode (way to assemble the
        mechanism) of one design (choice of sizes). A row is left out if its status is not
        OK, for example if the design cannot be assembled. It is also left out if an
        objective is not finite.

        Parameters
        ----------
        columns
            Columns of the table by name.

        Returns
        -------
        rows
            The columns of the selected rows. If there are precision points, they include
            `MATCH`, the root mean square of the errors at these points.
        objectives
            (selected rows, k) values of the objectives.
        """
        columns = self.add_match(columns)
        objectives = self._evaluate_objectives(columns)
        selected = (columns["status"] == OK) & all_finite(objectives, 1)
        rows = {name: values[selected] for name, values in columns.items()}
        return rows, objectives[selected]

    def add_match(self, columns: Columns) -> Columns:
        """Return columns with the error at the precision points, if there are some."""
        if not self.matched:
            return columns
        errors = np.array([columns[name] for name in self.matched])
        match = np.sqrt(np.sum(errors * errors, axis=0) / self.points)
        return {**columns, MATCH: match}

    def score_mode(self, designs: Floats, mode: str) -> ModeScores:
        """Return objectives and violated conditions of designs in one assembly mode.

        An assembly mode is one way to assemble the mechanism. A condition of the user is an
        inequality ``less < more``. The amount of its violation is less - more, if this is
        positive. Equality that is not allowed is a tiny violation. The amounts of all
        conditions are added, although their units may differ.

        Parameters
        ----------
        designs
            (variables, n) values of the design variables, in the units of the file.
        mode
            Label of the mode.

        Returns
        -------
        The scores of the designs that have this mode and finite objectives.
        """
        # A row is one assembly mode of one design. Rows without finite objectives are left
        # out.
        rows, objectives = self.select_rows(self._tabulate(designs))
        has_mode = rows["mode"] == mode
        violations = np.zeros(len(objectives))
        for condition in self.sweep.conditions:
            # A condition with NaN on one side counts as infinitely violated.
            less, more = condition.evaluate_sides(rows)
            excess = np.nan_to_num(less - more, nan=np.inf)
            least_violation = np.where(condition.find_met(rows), 0.0, TINY_VIOLATION)
            violations += np.maximum(excess, least_violation)
        return ModeScores(
            rows["design"][has_mode], objectives[has_mode], violations[has_mode]
        )

    def explain_failure(self) -> str:
        """Return a text that says why no design meets the requirements of a synthesis.

        Some designs (choices of sizes) are evaluated. The text counts those that cannot be
        assembled and those that are impossible mechanisms. Each of them has one row in the
        table of designs. Other designs have a row for each assembly mode (way to assemble
        the mechanism). For each condition the text counts the rows that meet it.
        """
        designs = self.sweep.space.compute_designs(0, MAX_EXPLAINED_DESIGNS)
        # `add_match` adds the column "match", the error at the precision points. Objectives
        # may contain it.
        rows = self.add_match(self._tabulate(designs))
        status = rows["status"]
        reasons = []
        design_count = designs.shape[1]
        never_count = np.sum(status == NEVER_CLOSES)
        if never_count:
            reasons.append(
                f"{never_count} of {design_count} cannot be assembled at any sample"
            )
        is_impossible = (status != OK) & (status != NEVER_CLOSES)
        causes = rows["reason"][is_impossible]
        if len(causes):
            reasons.append(
                f"{len(causes)} of {design_count} are not valid mechanisms ({causes[0]})"
            )
        closing = {name: values[status == OK] for name, values in rows.items()}
        row_count = len(closing["status"])
        if row_count:
            for condition in self.sweep.conditions:
                # A condition without columns has a single value for all rows.
                is_met = np.broadcast_to(condition.find_met(closing), row_count)
                met_count = np.sum(is_met)
                reasons.append(
                    f"{condition.text} holds in {met_count} of {counted(row_count, 'row')}"
                )
            # (rows, objectives)
            objectives = self._evaluate_objectives(closing)
            has_all_objectives = all_finite(objectives, axis=1)
            if not np.any(has_all_objectives):
                reasons.append("objectives have no value")
        return ", ".join(reasons)

    def _tabulate(self, designs: Floats) -> Columns:
        """Return the table of designs (variables, n), numbered from 0."""
        return self.sweep.tabulate_designs(designs, np.arange(designs.shape[1]))

    def _evaluate_objectives(self, rows: Columns) -> Floats:
        """Return the objectives (rows, k) of rows of the table of designs."""
        objectives = []
        for objective in self.objectives:
            # With the column of designs, a constant expression gets as many values as the
            # others.
            columns = {name: rows[name] for name in ("design", *objective.names)}
            objectives.append(objective.evaluate(columns))
        return np.stack(objectives, axis=1)


def select_nondominated(objectives: Floats, modes: Array) -> Indices:
    """Return the rows of each assembly mode that are on the Pareto front.

    A row is a design in one assembly mode (way to assemble the mechanism). A row dominates
    another row of the same mode if none of its objectives is larger and the rows are not
    equal. Smaller objectives are better. A row that no row dominates is on the front.

    Parameters
    ----------
    objectives
        (n, k) values of the k objectives in each row.
    modes
        (n,) labels of the assembly modes of the rows.

    Returns
    -------
    (m,) indices of the rows on the front, rising. Of equal rows only the first one is
    included.
    """
    nondominated: list[int] = []
    for mode in np.unique(modes):
        rows = np.flatnonzero(modes == mode)
        # After sorting by the first objective, then by the second and so on, no row
        # dominates the first one.
        rows = rows[np.lexsort(objectives[rows].T[::-1])]
        while len(rows):
            best = rows[0]
            nondominated.append(best)
            # Rows that are better in no objective are dominated or equal, and are removed.
            rows = rows[np.any(objectives[rows] < objectives[best], axis=1)]
    return np.array(sorted(nondominated), dtype=np.intp)


class PopulationScores(NamedTuple):
    """How good the n designs of one generation of an evolutionary search are.

    Attributes
    ----------
    objectives
        (n, k) objectives, which are minimised.
    violations
        (n,) amounts by which conditions are violated, 0 if none is.
    """

    objectives: Floats
    violations: Floats


@dataclass(frozen=True)
class PopulationScorer:
    """Scores the designs of one generation of an evolutionary search for a Pareto front.

    A design is one choice of the design variables.

    Attributes
    ----------
    specification
        The objectives, the conditions and the ranges of the design variables.
    mode
        Label of the assembly mode (way to assemble the mechanism).
    objective_count
        Number k of objectives.
    """

    specification: Specification
    mode: str
    objective_count: int

    @property
    def low(self) -> Floats:
        """(variables,) lower ends of the ranges, in the units of the file."""
        return np.array([item.low for item in self.specification.sweep.space.variations])

    @property
    def high(self) -> Floats:
        """(variables,) upper ends of the ranges, in the units of the file."""
        return np.array([item.high for item in self.specification.sweep.space.variations])

    def score(self, points: Floats) -> PopulationScores:
        """Return the objectives and violated conditions of designs.

        An assembly mode is one way to assemble the mechanism. A design gets the large value
        `MISSING_DESIGN_VIOLATION` if it cannot be assembled in the mode, or if an objective
        is not finite. The search therefore prefers any other design that violates
        conditions by less than this value.

        Parameters
        ----------
        points
            (n, variables) the designs. Coordinates 0 and 1 are the ends of the range of a
            variable.
        """
        design_count = len(points)
        designs = (self.low + (self.high - self.low) * points).T
        # Scores of the designs that have the mode and finite objectives. `scores.design`
        # has their indices. All other designs keep the large values.
        scores = self.specification.score_mode(designs, self.mode)
        objectives = np.full((design_count, self.objective_count), MISSING_DESIGN_VIOLATION)
        objectives[scores.design] = scores.objectives
        violations = np.full(design_count, MISSING_DESIGN_VIOLATION)
        violations[scores.design] = scores.violations
        return PopulationScores(objectives, violations)


def evolve_fronts(
    specification: Specification,
    modes: Array,
    points: Floats,
    objectives: Floats,
    max_points: int,
    progress: ProgressReporter,
) -> list[tuple[str, Floats]]:
    """Improve the Pareto front of each assembly mode by an evolution (NSGA-II).

    The front of an assembly mode consists of the designs for which no other design is
    better in all objectives. The evolution of each mode starts from its rows in the front
    and from random points.

    Parameters
    ----------
    specification
        The objectives and conditions.
    modes
        (n,) labels of the assembly modes of the rows (designs in one mode) from which the
        evolution starts.
    points
        (n, variables) the designs of these rows, each variable from 0 to 1 over its range.
    objectives
        (n, k) their objectives.
    max_points
        Largest number of points of a front that are returned; they are spread along it.
    progress
        Tells the user which mode is at work.

    Returns
    -------
    The label of a mode and a point (variables,) for each point of the fronts.

    Raises
    ------
    DesignError
        If pymoo is not installed.
    """
    sweep = specification.sweep
    try:
        from pymoo.algorithms.moo.nsga2 import NSGA2
        from pymoo.core.problem import Problem
        from pymoo.optimize import minimize
    except ImportError:
        raise DesignError(
            f"{sweep.mechanism.name}: several objectives need pymoo: "
            'pip install "spherekit-mechanisms[optimise]"; or minimise one, and bound the '
            "others by conditions"
        ) from None
    objective_count = objectives.shape[1]
    seed = sweep.space.seed

    class FrontProblem(Problem):  # type: ignore[misc]
        """The search for the Pareto front of one assembly mode, for the library pymoo.

        An assembly mode is one way to assemble the mechanism. A point has the design
        variables of a design, scaled to 0 to 1. pymoo calls `_evaluate` with the points of
        a generation of designs, and reads the objectives from ``out["F"]``. In ``out["G"]``
        there is one number for each design, the sum of all violations of conditions.
        """

        def __init__(self, population_scorer: PopulationScorer) -> None:
            super().__init__(
                n_var=len(population_scorer.low),
                n_obj=population_scorer.objective_count,
                n_ieq_constr=1,
                xl=0.0,
                xu=1.0,
            )
            self.population_scorer = population_scorer

        def _evaluate(self, x: Floats, out: dict[str, Floats], *_: Any, **__: Any) -> None:
            """Write the objectives and violations of points x into `out`."""
            scores = self.population_scorer.score(x)
            out["F"] = scores.objectives
            out["G"] = scores.violations[:, None]
            # The text is only created if a report is due.
            mode = self.population_scorer.mode
            progress.report_if_due(lambda: f"front of mode {mode}")

    # The evolution evaluates about as many designs as the sweep before.
    generation_count = max(sweep.space.count // POPULATION_SIZE, 1)
    nondominated = select_nondominated(objectives, modes)
    fronts: list[tuple[str, Floats]] = []
    for mode in np.unique(modes):
        rows = nondominated[modes[nondominated] == mode]
        front = points[rows]
        front_objectives = objectives[rows]
        random_points = np.random.default_rng(seed).uniform(
            size=(POPULATION_SIZE, points.shape[1])
        )
        spread = _spread_points(front, front_objectives, POPULATION_SIZE)
        population = np.concatenate([spread, random_points])[:POPULATION_SIZE]
        population_scorer = PopulationScorer(specification, mode, objective_count)
        result = minimize(
            FrontProblem(population_scorer),
            NSGA2(pop_size=POPULATION_SIZE, sampling=population),
            ("n_gen", generation_count),
            seed=seed,
            verbose=False,
        )
        # X has the points and F the objectives. Without a result the rows remain.
        if result.X is not None:
            front = np.atleast_2d(result.X)
            front_objectives = np.atleast_2d(result.F)
        for point in _spread_points(front, front_objectives, max_points):
            fronts.append((str(mode), point))
    return fronts


def _spread_points(points: Floats, objectives: Floats, max_points: int) -> Floats:
    """Return some of the designs on a Pareto front, spread evenly along the front.

    The points are sorted by their first objective, and evenly spaced ranks are selected.

    Parameters
    ----------
    points
        (n, variables) designs as points: coordinates 0 and 1 are the ends of the range of a
        variable.
    objectives
        (n, k) objectives of the points.
    max_points
        Largest number of points that are returned.

    Returns
    -------
    (m, variables) points, sorted by the first objective.
    """
    count = min(len(points), max_points)
    ranks = np.linspace(0, len(points) - 1, count).astype(int)
    order = np.argsort(objectives[:, 0], kind="stable")
    return points[order[ranks]]
