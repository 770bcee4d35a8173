"""Dimensional synthesis: a sweep over designs, then descents from its best rows."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from spherekit.arrays import Array, Floats
from spherekit.conventions import Names
from spherekit.designs.descent import (
    MIN_START_DISTANCE,
    Descent,
    LocalOptimum,
    select_unbeaten,
)
from spherekit.designs.design_conditions import Columns
from spherekit.designs.design_evaluation import DesignEvaluator
from spherekit.designs.design_variables import ACTIONS, make_design
from spherekit.designs.linkage_comparison import SAME_LINKAGE, is_same_linkage
from spherekit.designs.synthesis_modes import (
    SynthesisMode,
    find_all_modes,
    find_labelled_modes,
)
from spherekit.designs.synthesis_requirements import (
    Specification,
    evolve_fronts,
    select_nondominated,
)
from spherekit.errors import DesignError
from spherekit.geometry.vectors import max_abs
from spherekit.mechanism.mechanism import Mechanism
from spherekit.progress import ProgressReporter
from spherekit.wording import counted

if TYPE_CHECKING:
    import pandas as pd

ROWS_PER_START = 32
"""Number of best rows of each part of the sweep that are stored for each descent.

Larger: more of the modes that cannot be tracked can be replaced. Smaller: less memory.
"""

FRONT_POINTS_PER_START = 5
"""Points of a mode's front, for each descent that there would be with one objective."""

SEARCHED_ROWS_PER_START = 4
"""Rows, for each descent, whose modes are found together.

Larger: modes are found for rows that are not used. Smaller: more calls.
"""


@dataclass(frozen=True)
class Synthesis:
    """The designs that a synthesis found, sorted by the first objective.

    With one objective there is one design for each assembly mode (way to assemble the
    links) and each local minimum. With several objectives there is the Pareto front of each
    mode: the designs for which no other design is better in all objectives. Designs that
    are the same linkage or its mirror image, perhaps with axes that point in the opposite
    direction, are listed once.

    Attributes
    ----------
    synthesis
        The requirements.
    values
        (n, variables) values of the variables, in the units of the file.
    modes
        (n,) assembly modes: the signs of the dyads (two links with three R pairs). With
        other groups of links, the label that a sweep has for this design.
    objectives
        (n, k) values of the k objectives, which were minimised.
    figures
        Figures of merit (n,) by name, angles in the unit of the file.
    explored
        Number of designs of the sweep.
    feasible
        Number of rows of the sweep (assembly modes of designs) that meet the conditions and
        have finite objectives.
    before
        (k,) the smallest value of each objective among the rows that meet the conditions.
    tolerance
        (k,) amount for each objective. A design counts as better only if an objective is
        smaller by more than this amount.
    """

    synthesis: Specification
    values: Floats
    modes: Names
    objectives: Floats
    figures: Mapping[str, Floats]
    explored: int
    feasible: int
    before: Floats
    tolerance: Floats

    def mechanism(self, number: int = 0) -> Mechanism:
        """Return the mechanism of a design, the best by default."""
        sweep = self.synthesis.sweep
        return make_design(sweep.document, sweep.variables, self.values[number])

    def frame(self) -> "pd.DataFrame":
        """Return the designs as a pandas frame, with units in ``attrs["units"]``."""
        from spherekit.tables.table_files import make_frame

        sweep = self.synthesis.sweep
        columns = {"mode": np.array(self.modes, object)}
        columns |= dict(zip(self.headings, self.objectives.T, strict=True))
        columns |= dict(zip([x.name for x in sweep.variables], self.values.T, strict=True))
        return make_frame(columns | dict(self.figures), {"units": sweep.units()})

    @property
    def headings(self) -> list[str]:
        """The names of the columns of objectives."""
        return self.synthesis.headings

    def __repr__(self) -> str:
        best = " and ".join(f"{value:.6g}" for value in np.min(self.objectives, axis=0))
        return f"Synthesis({counted(len(self.objectives), 'design')}, least {best})"


@dataclass(frozen=True)
class DescentStart:
    """A design and assembly mode from which a descent (local optimisation) starts.

    Attributes
    ----------
    mode
        The assembly mode (way to assemble the links).
    x
        (variables,) the design, with each variable from 0 to 1 over its range.
    """

    mode: SynthesisMode
    x: Floats


@dataclass(frozen=True)
class ExploredDesigns:
    """The best designs of a sweep, with which a synthesis begins.

    A synthesis searches for sizes of links that meet requirements. Its sweep evaluates many
    designs (choices of sizes). The table of the sweep has one row for each assembly mode
    (way to assemble the mechanism) of each design.

    Attributes
    ----------
    rows
        Columns by name, with n rows of this table that meet the conditions. The table is
        computed in parts (groups of designs). Each part contributes its own best rows,
        without a comparison with other parts. With one objective, these are a fixed number
        of rows with the lowest values. With several objectives, these are all rows that no
        row of the same mode in the part dominates. A row dominates another one if none of
        its objectives is larger and one is smaller.
    objectives
        (n, k) the values of the k objectives, which are minimised, in these rows.
    feasible_count
        Number of all rows of the sweep that meet the conditions and have finite objectives.
    """

    rows: Columns
    objectives: Floats
    feasible_count: int


def synthesize_dimensions(specification: Specification, starts: int = 12) -> Synthesis:
    """Find the best designs: evaluate many designs, then improve the best ones by descents.

    A sweep evaluates the designs, and a descent is a local optimisation. With several
    objectives the best designs are a front: no other design is better in all objectives.
    Before the descents, an evolution (NSGA-II, Deb and others 2002, by pymoo) improves this
    front. After them, descents from other starts try to find a better design for each point
    of the front. Descents follow exact gradients: SciPy's SLSQP, and cutting planes where
    objectives have kinks. Each descent keeps its assembly mode, and the fraction of inputs
    at which this mode closes does not decrease.

    Parameters
    ----------
    specification
        The requirements, with the designs of the sweep.
    starts
        Largest number of descents with one objective, at least 1. With several objectives
        there are up to `FRONT_POINTS_PER_START` times as many for each mode.

    Returns
    -------
    The best designs, sorted by the first objective.

    Raises
    ------
    DesignError
        If no design meets the conditions, there are no gradients, or `starts` is below 1.
    EngineError
        If no compiled function can evaluate the designs.
    """
    if starts < 1:
        raise DesignError(f"starts = {starts}: give at least 1")
    sweep = specification.sweep
    evaluator = _require_gradients(specification)
    progress = ProgressReporter(f"{sweep.mechanism.name}: synthesis")
    explored = _explore_designs(specification, ROWS_PER_START * starts, progress)
    descent = Descent(specification, explored.rows, explored.objectives)
    # With several objectives the best designs of a mode form a Pareto front.
    has_front = len(specification.minimise) > 1
    if has_front:
        fronts = evolve_fronts(
            specification,
            modes=explored.rows["mode"],
            points=descent.points,
            objectives=explored.objectives,
            max_points=FRONT_POINTS_PER_START * starts,
            progress=progress,
        )
        descent_starts = [DescentStart(SynthesisMode(mode), x) for mode, x in fronts]
    else:
        descent_starts = _choose_starts(
            evaluator,
            values=np.stack([explored.rows[v.name] for v in sweep.variables]),
            labels=explored.rows["mode"],
            points=descent.points,
            objective=explored.objectives[:, 0],
            count=starts,
        )
    optima = []
    for k, start in enumerate(descent_starts):
        optima.append(descent.descend(start.mode, start.x))
        # `report_if_due` calls the lambda at once, so `k` still has its present value.
        progress.report_if_due(
            lambda: f"{k + 1} of {counted(len(descent_starts), 'descent')}",  # noqa: B023
            done=k + 1,
            total=len(descent_starts),
        )
    # Modes without signs are tracked configurations, which may be no mode of a sweep.
    if evaluator.has_unsigned_modes:
        optima = _confirm_modes(evaluator, descent, descent_starts, optima)
    # Each point of a front is challenged by descents from other points.
    if has_front:
        optima = select_unbeaten(_merge_same_linkages(optima, descent), descent.tolerance)
        for k in range(len(optima)):
            optima[k] = descent.challenge(optima[k], optima)
            progress.report_if_due(
                lambda: f"{k + 1} of {counted(len(optima), 'point')} checked",  # noqa: B023
                done=k + 1,
                total=len(optima),
            )
    # Descents and challenges may have led to designs that others beat.
    optima = _merge_same_linkages(optima, descent)
    if has_front:
        optima = select_unbeaten(optima, descent.tolerance)
    figures = np.transpose([optimum.figures for optimum in optima])
    columns = dict(zip([merit.name for merit in sweep.merits], figures, strict=True))
    return Synthesis(
        synthesis=specification,
        values=np.array([descent.file_values(optimum.x) for optimum in optima]),
        modes=tuple(optimum.mode.label for optimum in optima),
        objectives=np.array([optimum.objectives for optimum in optima]),
        figures=specification.add_match(columns),
        explored=sweep.space.count,
        feasible=explored.feasible_count,
        before=np.min(explored.objectives, axis=0),
        tolerance=descent.tolerance,
    )


def _require_gradients(specification: Specification) -> DesignEvaluator:
    """Return the evaluator of the designs, if it has what a synthesis needs.

    A synthesis changes the sizes of a mechanism along the gradients of figures of merit
    (numbers that rate a design). There are no gradients in these cases:

    - Constraints are redundant.
    - A group of links, whose positions are found together, has more than 7 bodies.
    - The closure equations have more than 64 complex solutions (`MAX_SOLUTIONS` of
      `spherekit.designs.homotopy`), too many to follow all of them.
    - The study has the setting crossings = "pass". An assembly mode (way to assemble the
      mechanism) then continues smoothly where two curves of configurations cross.
    - The profile of a contact is not a circle, and a number varies that is neither a size
      of a link nor a number of such a profile.
    - The study states an assembly mode, and the mechanism has contacts, or groups other
      than dyads (groups of two links).
    - The file gives a reference pose, and the study requests only the assembly mode of this
      pose.

    With several objectives, a synthesis finds a Pareto front. It then also needs assembly
    modes that are named by the signs of dyads. A sign tells in which of two ways a dyad is
    assembled.

    Raises
    ------
    DesignError
        If the gradients cannot be computed, or if there are several objectives and modes
        are not named by the signs of dyads.
    """
    sweep = specification.sweep
    evaluator = sweep.evaluator
    if not isinstance(evaluator, DesignEvaluator) or not evaluator.has_gradients:
        raise DesignError(
            f"{sweep.mechanism.name}: synthesis cannot compute gradients for these "
            "designs; sweep them instead. Where profiles are not circles, gradients exist "
            "only with respect to dimensions of links and numbers under "
            "pairs.PAIR.profiles. Gradients do not exist with redundant constraints, with "
            "groups of more than 7 "
            'bodies or 64 solutions, with crossings "pass", or with search = false and a '
            "reference pose. With a stated assembly mode, gradients exist only if all "
            "groups are dyads of R pairs; leave the assembly mode out"
        )
    if evaluator.has_unsigned_modes and len(specification.minimise) > 1:
        raise DesignError(
            f"{sweep.mechanism.name}: a Pareto front of several objectives is possible "
            "only if all groups are dyads and all profiles are circles; minimise one "
            "objective, and bound the others by conditions"
        )
    return evaluator


def _explore_designs(
    specification: Specification, rows_per_part: int, progress: ProgressReporter
) -> ExploredDesigns:
    """Evaluate all designs of the sweep and return the best rows.

    A row of the sweep is one assembly mode (way to assemble the mechanism) of one design.
    The sweep is computed in parts, so that not all rows are in memory at once.

    Parameters
    ----------
    specification
        The requirements (objectives and conditions), with the sweep.
    rows_per_part
        Number of best rows that are returned from each part if there is one objective. With
        several objectives, all rows of a part are returned that no row of the same assembly
        mode dominates. A row dominates another one if none of its objectives is larger and
        one is smaller.
    progress
        Shows the user how many designs are evaluated.

    Returns
    -------
    The best rows of all parts, unsorted.

    Raises
    ------
    DesignError
        If no row meets the conditions and has finite objectives. The message says why.
    """
    sweep = specification.sweep
    rows_of_parts = []
    objectives_of_parts = []
    feasible_count = 0
    for number in range(sweep.part_count):
        rows, objectives = specification.select_rows(sweep.compute_part(number))
        feasible_count += len(objectives)
        if objectives.shape[1] == 1:
            best = np.argsort(objectives[:, 0], kind="stable")[:rows_per_part]
        else:
            best = select_nondominated(objectives, rows["mode"])
        rows_of_parts.append({name: values[best] for name, values in rows.items()})
        objectives_of_parts.append(objectives[best])
        design_count = min((number + 1) * sweep.part_size, sweep.space.count)
        # `report_if_due` calls the lambda at once, so `design_count` still has its present
        # value.
        all_designs = counted(sweep.space.count, "design")
        progress.report_if_due(
            lambda: f"{design_count} of {all_designs} evaluated",  # noqa: B023
            done=design_count,
            total=sweep.space.count,
        )
    if not feasible_count:
        raise DesignError(
            f"{sweep.mechanism.name}: none of {counted(sweep.space.count, 'design')} meets "
            f"the conditions: {specification.explain_failure()}; widen ranges, relax "
            "conditions, or examine more designs with --designs"
        )
    rows = {
        name: np.concatenate([part[name] for part in rows_of_parts])
        for name in rows_of_parts[0]
    }
    return ExploredDesigns(rows, np.concatenate(objectives_of_parts), feasible_count)


def _choose_starts(
    evaluator: DesignEvaluator,
    values: Floats,
    labels: Array,
    points: Floats,
    objective: Floats,
    count: int,
) -> list[DescentStart]:
    """Return the best designs of a sweep as starts of local optimisations (descents).

    A row of the sweep is one assembly mode (way to assemble the mechanism) of one design. A
    row near to a better row of the same mode is left out. A row has only a label of its
    mode, and to find the mode with this label can take long. So rows are processed in
    blocks, the best rows first, until there are enough starts.

    Parameters
    ----------
    evaluator
        Finds the configurations of a mode. A row is left out if they are not found.
    values
        (variables, n) values of the design variables of the rows, in the units of the file.
    labels
        (n,) labels of the assembly modes of the rows.
    points
        (n, variables) the same designs as coordinates: 0 and 1 are the ends of the range of
        a variable.
    objective
        (n,) the objective, which is minimised.
    count
        Number of starts.

    Returns
    -------
    At most `count` starts, sorted by their objective.
    """
    starts: list[DescentStart] = []
    order = np.argsort(objective, kind="stable")
    block_size = SEARCHED_ROWS_PER_START * count
    for first in range(0, len(order), block_size):
        rows = order[first : first + block_size]
        modes = find_labelled_modes(evaluator, values[:, rows], labels[rows].tolist())
        for row, mode in zip(rows, modes, strict=True):
            if len(starts) == count:
                return starts
            if mode is None:
                continue
            # `continues_in` tells whether modes of two designs are the same mode.
            is_near = any(
                max_abs(points[row] - start.x) < MIN_START_DISTANCE
                and start.mode.continues_in(mode)
                for start in starts
            )
            if not is_near:
                starts.append(DescentStart(mode, points[row]))
    return starts


def _confirm_modes(
    evaluator: DesignEvaluator,
    descent: Descent,
    starts: Sequence[DescentStart],
    optima: Sequence[LocalOptimum],
) -> list[LocalOptimum]:
    """Return the ends of descents, after a new search of their assembly modes.

    An assembly mode is one way to assemble the mechanism. A descent changes the design step
    by step and follows the configurations of a mode. A descent may have slipped to another
    mode. So at the end all modes of the design are searched anew. The end is confirmed if
    one of these modes has the same configurations and objectives that are as good. If the
    end is not confirmed, the start of the descent is returned.

    Parameters
    ----------
    evaluator
        Finds all modes of the designs.
    descent
        Evaluates the objectives of designs.
    starts
        The start of each descent.
    optima
        The end of each descent.

    Returns
    -------
    For each descent its confirmed end, or its start.
    """
    confirmed_optima = []
    designs = np.stack([descent.file_values(optimum.x) for optimum in optima], axis=1)
    modes_of_designs = find_all_modes(evaluator, designs)
    for start, optimum, modes in zip(starts, optima, modes_of_designs, strict=True):
        confirmed = _find_confirmed_optimum(descent, optimum, modes)
        if confirmed is None:
            confirmed = descent.as_optimum(start.mode, start.x)
        confirmed_optima.append(confirmed)
    return confirmed_optima


def _find_confirmed_optimum(
    descent: Descent, optimum: LocalOptimum, modes: Sequence[SynthesisMode]
) -> LocalOptimum | None:
    """Return an optimum of a descent if a new search of its assembly modes confirms it.

    An assembly mode is one way to assemble the mechanism. A descent changes the design step
    by step and follows the configurations of a mode. On the way it may have slipped to
    another mode. So all modes of the last design are searched anew. The optimum is
    confirmed if one of them is the followed mode and has objectives that are as good.

    Parameters
    ----------
    descent
        Evaluates the objectives of designs.
    optimum
        The end of a descent, with the mode that was followed to it.
    modes
        All assembly modes of its design, found by a search.

    Returns
    -------
    The same design in the first mode of the search that confirms it. No objective may
    exceed that of `optimum` by more than the tolerance of the descent. None if no mode
    confirms the optimum.
    """
    allowed_objectives = optimum.objectives + descent.tolerance
    for mode in modes:
        if optimum.mode.continues_in(mode):
            candidate = descent.as_optimum(mode, optimum.x)
            if np.all(candidate.objectives <= allowed_objectives):
                return candidate
    return None


def _merge_same_linkages(
    optima: Sequence[LocalOptimum], descent: Descent
) -> list[LocalOptimum]:
    """Return optima (designs) sorted by their objectives, with each linkage only once.

    Two optima can be the same linkage, or its mirror image, with other numbers. Only the
    optimum with the smaller objectives remains.
    """
    different: list[LocalOptimum] = []
    for optimum in sorted(optima, key=lambda item: tuple(item.objectives)):
        if not any(_are_alike(other, optimum, descent) for other in different):
            different.append(optimum)
    return different


def _are_alike(
    optimum: LocalOptimum, other_optimum: LocalOptimum, descent: Descent
) -> bool:
    """Return whether two optima of a synthesis are practically the same result.

    The results are the same if the optima are one design in one assembly mode (way to
    assemble the mechanism). Two optima with equal objectives are also the same result if
    they are one linkage, up to mirror images and reversed axes.

    Parameters
    ----------
    optimum, other_optimum
        Two ends of descents. Their points `x` have a coordinate for each design variable: 0
        and 1 are the ends of its range.
    descent
        The descents that led to the optima.
    """
    distances = np.abs(optimum.x - other_optimum.x)
    has_same_variables = np.max(distances) < SAME_LINKAGE
    # `continues_in` tells whether the modes of both designs are the same.
    if has_same_variables and optimum.mode.continues_in(other_optimum.mode):
        return True
    sweep = descent.sweep
    # `is_same_linkage` ignores masses and loads, so they are compared here. The first part
    # of the path of a variable is its table in the file.
    is_action = [variable.path[0] in ACTIONS for variable in sweep.variables]
    if np.any(distances[is_action] >= SAME_LINKAGE):
        return False
    differences = np.abs(optimum.objectives - other_optimum.objectives)
    if np.any(differences > descent.tolerance):
        return False
    mechanism, other_mechanism = (
        make_design(sweep.document, sweep.variables, descent.file_values(item.x))
        for item in (optimum, other_optimum)
    )
    return is_same_linkage(mechanism, other_mechanism)
