"""Designs that none beats in all of several objectives: the Pareto front."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from spherekit.design.wanted import Sizing
from spherekit.errors import DesignError
from spherekit.progress import Working
from spherekit.sphere.rotation import Floats

POPULATION = 60
"""Designs of a generation, and most of a front."""
MISSED = 1e6
"""By how much a design that does not close in a mode misses its conditions."""


def nondominated(wanted: Floats, modes: NDArray[Any]) -> NDArray[np.intp]:
    """Return the rows (m,) that no row of their mode beats in all objectives (n, k)."""
    kept = np.ones(len(wanted), dtype=bool)
    for mode in np.unique(modes):
        rows = np.flatnonzero(modes == mode)
        rows = rows[np.lexsort(wanted[rows].T[::-1])]
        best: list[int] = []
        while len(rows):
            first = rows[0]
            best.append(first)
            rows = rows[np.any(wanted[rows] < wanted[first], axis=1)]
        kept[modes == mode] = False
        kept[best] = True
    return np.flatnonzero(kept)


def front_of(
    sizing: Sizing,
    modes: NDArray[Any],
    places: Floats,
    wanted: Floats,
    most: int,
    working: Working,
) -> list[tuple[str, Floats]]:
    """Return the front of each mode: modes, and places in units of the variables' ranges.

    Parameters
    ----------
    sizing
        What is wanted.
    modes, places, wanted
        Rows to begin with: their modes (n,), places (n, variables) and objectives (n, k).
    most
        Most places of a mode, spread along its front.
    working
        What tells how far it is.
    """
    made: list[tuple[str, Floats]] = []
    generations = max(sizing.sweep.space.count // POPULATION, 1)
    for mode in np.unique(modes):
        rows = np.flatnonzero(modes == mode)
        rows = rows[nondominated(wanted[rows], modes[rows])]
        begin = places[rows[np.argsort(wanted[rows, 0], kind="stable")]]
        thinned = np.linspace(0, len(begin) - 1, min(len(begin), POPULATION)).astype(int)
        words = f"front of mode {mode}"
        ends = _evolved(sizing, mode, begin[thinned], generations, working, words)
        spread = np.linspace(0, len(ends) - 1, min(len(ends), most)).astype(int)
        made += [(str(mode), end) for end in ends[spread]]
    return made


def _evolved(
    sizing: Sizing,
    mode: str,
    begin: Floats,
    generations: int,
    working: Working,
    words: str,
) -> Floats:
    """Return the front (n, variables) of a mode after generations, in order."""
    try:
        from pymoo.algorithms.moo.nsga2 import NSGA2
        from pymoo.core.problem import Problem
        from pymoo.optimize import minimize
    except ImportError:
        raise DesignError(
            f"{sizing.sweep.mechanism.name}: several objectives need pymoo: "
            'pip install "spherekit-mechanisms[optimise]"; or minimise one, and bound the '
            "others by conditions"
        ) from None
    sweep = sizing.sweep
    ranges = np.array(
        [(variation.low, variation.high) for variation in sweep.space.variations]
    ).T
    count = len(sizing.minimise)

    class Wanted(Problem):  # type: ignore[misc]
        """The objectives and conditions of a generation."""

        def __init__(self) -> None:
            super().__init__(
                n_var=len(sweep.variables),
                n_obj=count,
                n_ieq_constr=1,
                xl=0.0,
                xu=1.0,
            )

        def _evaluate(self, x: Floats, out: dict[str, Floats], *_: Any, **__: Any) -> None:
            values = ranges[0] + (ranges[1] - ranges[0]) * x
            rows, wanted, missed = sizing.missed(values.T, mode)
            out["F"] = np.full((len(x), count), MISSED)
            out["G"] = np.full((len(x), 1), MISSED)
            out["F"][rows], out["G"][rows, 0] = wanted, missed
            working.tell(lambda: words)

    first = np.random.default_rng(sweep.space.seed).uniform(
        size=(max(POPULATION - len(begin), 0), begin.shape[1])
    )
    result = minimize(
        Wanted(),
        NSGA2(pop_size=POPULATION, sampling=np.concatenate([begin, first])),
        ("n_gen", generations),
        seed=sweep.space.seed,
        verbose=False,
    )
    if result.X is None:
        return begin
    return np.atleast_2d(result.X)[np.argsort(np.atleast_2d(result.F)[:, 0], kind="stable")]
