"""What a synthesis wants: objectives, conditions and precision points."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from spherekit.arrays import Array, Floats, Indices
from spherekit.conventions import Names
from spherekit.designs.design_space import Columns
from spherekit.designs.design_variables import OK
from spherekit.designs.figures_of_merit import NEVER_CLOSES
from spherekit.designs.sweep import Sweep
from spherekit.errors import DesignError, ModelError
from spherekit.geometry.vectors import all_finite
from spherekit.mechanism.load_expression import Expression, parse
from spherekit.progress import ProgressReporter
from spherekit.wording import counted

LOOKED_AT = 1024
"""Designs by which a synthesis says what none of them meets."""

MATCH = "match"
"""The figure of precision points."""


@dataclass(frozen=True)
class Specification:
    """What sizes are wanted: objectives, and conditions, of figures of a sweep.

    Attributes
    ----------
    sweep
        The designs that are looked at first, their figures, and the conditions.
    minimise
        The objectives, expressions of figures and varied numbers.
    matched
        Names of the figures that precision points are missed by.
    points
        How many precision points there are.
    """

    sweep: Sweep
    minimise: Names
    matched: Names = ()
    points: int = 1

    def __post_init__(self) -> None:
        _ = self.objectives

    @cached_property
    def objectives(self) -> tuple[Expression, ...]:
        """The parsed objectives."""
        names = self.sweep.names + [MATCH] * bool(self.matched)
        try:
            return tuple(parse(text, names) for text in self.minimise)
        except ModelError as problem:
            raise DesignError(f"minimise: {problem}") from None

    def rows_of(self, columns: Columns) -> tuple[Columns, Floats]:
        """Return the good rows of a sweep's columns, and their objectives (rows, k)."""
        rows = self.with_match(columns)
        objectives = self._worth(rows)
        good = (rows["status"] == "OK") & all_finite(objectives, 1)
        return {name: values[good] for name, values in rows.items()}, objectives[good]

    def with_match(self, columns: Columns) -> Columns:
        """Return columns with the figure of the precision points, if there are some."""
        if not self.matched:
            return columns
        missed = np.array([columns[name] for name in self.matched])
        return {**columns, MATCH: np.sqrt(np.sum(missed * missed, axis=0) / self.points)}

    def missed(self, designs: Floats, mode: str) -> tuple[Indices, Floats, Floats]:
        """Return which designs (variables, n) have a mode, and what they are worth in it.

        Returns
        -------
        rows, objectives, missed
            Array (m,) of designs, their objectives (m, k), and (m,) by how much the
            conditions are missed in all, 0 where they hold.
        """
        rows, objectives = self.rows_of(
            self.sweep.rows(designs, np.arange(designs.shape[1]))
        )
        here = rows["mode"] == mode
        missed = np.zeros(len(objectives))
        for condition in self.sweep.conditions:
            less, more = condition.sides(rows)
            missed += np.maximum(np.nan_to_num(less - more, nan=np.inf), 0.0)
        return rows["design"][here], objectives[here], missed[here]

    def why_none(self) -> str:
        """Return what keeps designs from being good, in words, by some of the first."""
        designs = self.sweep.space.designs(0, LOOKED_AT)
        rows = self.with_match(self.sweep.rows(designs, np.arange(designs.shape[1])))
        status = rows["status"]
        words = []
        n = designs.shape[1]
        if never := np.sum(status == NEVER_CLOSES):
            words.append(f"{never} of {n} close at no sample")
        others = rows["reason"][(status != OK) & (status != NEVER_CLOSES)]
        if len(others):
            words.append(f"{len(others)} of {n} cannot be ({others[0]})")
        kept = {name: values[status == OK] for name, values in rows.items()}
        if count := len(kept["status"]):
            words += [
                f"{condition.text} holds in {np.sum(condition.holds(kept))} of "
                f"{counted(count, 'row')}"
                for condition in self.sweep.conditions
            ]
            if not np.any(all_finite(self._worth(kept), 1)):
                words.append("objectives have no value")
        return ", ".join(words)

    def _worth(self, rows: Columns) -> Floats:
        """Return the objectives (rows, k)."""
        worth = [
            objective.evaluate({name: rows[name] for name in ("design", *objective.names)})
            for objective in self.objectives
        ]
        return np.stack(worth, axis=1)


POPULATION = 60
"""Designs of a generation, and most of a front."""
MISSED = 1e6
"""By how much a design that does not close in a mode misses its conditions."""


def nondominated(wanted: Floats, modes: Array) -> Indices:
    """Return the rows (m,) that no row of their mode beats in all objectives (n, k)."""
    best: list[int] = []
    for mode in np.unique(modes):
        rows = np.flatnonzero(modes == mode)
        rows = rows[np.lexsort(wanted[rows].T[::-1])]
        while len(rows):
            best.append(rows[0])
            rows = rows[np.any(wanted[rows] < wanted[best[-1]], axis=1)]
    return np.array(sorted(best), dtype=np.intp)


def front_of(
    synthesis: Specification,
    modes: Array,
    places: Floats,
    wanted: Floats,
    most: int,
    working: ProgressReporter,
) -> list[tuple[str, Floats]]:
    """Return the front of each mode: modes, and places in units of the variables' ranges.

    Parameters
    ----------
    synthesis
        What is wanted.
    modes, places, wanted
        Rows to begin with: their modes (n,), places (n, variables) and objectives (n, k).
    most
        Most places of a mode, spread along its front.
    working
        What tells how far it is.
    """
    sweep, made = synthesis.sweep, list[tuple[str, Floats]]()
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
    low, high = np.array([(item.low, item.high) for item in sweep.space.variations]).T
    count, seed = wanted.shape[1], sweep.space.seed

    class Requirements(Problem):  # type: ignore[misc]
        """The objectives and conditions of a generation in the mode at hand."""

        def _evaluate(self, x: Floats, out: dict[str, Floats], *_: Any, **__: Any) -> None:
            rows, worth, missed = synthesis.missed((low + (high - low) * x).T, mode)
            out["F"] = np.full((len(x), count), MISSED)
            out["G"] = np.full((len(x), 1), MISSED)
            out["F"][rows], out["G"][rows, 0] = worth, missed
            working.tell(f"front of mode {mode}".__str__)

    problem = Requirements(n_var=len(low), n_obj=count, n_ieq_constr=1, xl=0.0, xu=1.0)
    limit = "n_gen", max(sweep.space.count // POPULATION, 1)
    best = nondominated(wanted, modes)
    for mode in np.unique(modes):
        rows = best[modes[best] == mode]
        ends, worth = places[rows], wanted[rows]
        first = np.random.default_rng(seed).uniform(size=(POPULATION, len(low)))
        begin = np.concatenate([_spread(ends, worth, POPULATION), first])[:POPULATION]
        algorithm = NSGA2(pop_size=POPULATION, sampling=begin)
        result = minimize(problem, algorithm, limit, seed=seed, verbose=False)
        if result.X is not None:
            ends, worth = np.atleast_2d(result.X), np.atleast_2d(result.F)
        made += [(str(mode), end) for end in _spread(ends, worth, most)]
    return made


def _spread(places: Floats, wanted: Floats, most: int) -> Floats:
    """Return at most so many places (n, variables), evenly in order of an objective."""
    some = np.linspace(0, len(places) - 1, min(len(places), most)).astype(int)
    return places[np.argsort(wanted[:, 0], kind="stable")[some]]
