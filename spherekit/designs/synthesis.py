"""Sizes that make objectives small while conditions hold: search, then descent."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from spherekit.arrays import Array, Floats
from spherekit.conventions import Names
from spherekit.designs.descent import (
    BESIDE,
    Descent,
    HeldMode,
    LocalOptimum,
    every_mode,
    held_modes,
    unbeaten,
)
from spherekit.designs.design_evaluation import Evaluator
from spherekit.designs.design_space import Columns
from spherekit.designs.design_variables import ACTIONS, designed
from spherekit.designs.synthesis_requirements import Specification, front_of, nondominated
from spherekit.errors import DesignError
from spherekit.geometry.vectors import max_abs
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.pair_frames import pair_frames
from spherekit.progress import ProgressReporter
from spherekit.wording import counted

if TYPE_CHECKING:
    import pandas as pd

MOST = 32
"""Best rows of a part that are kept for each descent."""
FRONT = 5
"""Points of the front of a mode for each descent that one objective would have."""
AHEAD = 4
"""Rows for each descent of which modes are looked for together."""
SAME = 1e-3
"""Ends of descents nearer than this part of every range, or of 1 rad in arcs, are one."""


@dataclass(frozen=True)
class Synthesis:
    """Designs that a synthesis found, the least of the first objective first.

    With one objective one design for each assembly mode and valley; with several the
    Pareto front of each assembly mode: designs that none beats in all objectives. What is
    one linkage, or its mirror image, with axes that point the other way is one design.

    Attributes
    ----------
    synthesis
        What was wanted.
    values
        (n, variables), in the file's units.
    modes
        (n,) assembly modes, as the signs of their dyads; of other groups as in the row that
        a sweep has of the design.
    objectives
        (n, k) what was to be small.
    figures
        Figures (n,) by name, in the file's unit of angles.
    explored, feasible
        How many designs were looked at first, and in how many rows conditions held.
    before
        (k,) the least of each objective among these.
    tolerance
        (k,) by how much of each objective a design has to be better to beat another: with
        several objectives no descent found one that beats a design here by more.
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
        return designed(sweep.document, sweep.variables, self.values[number])

    def frame(self) -> "pd.DataFrame":
        """Return the designs as a pandas frame."""
        from spherekit.tables.table_files import make_frame

        sweep = self.synthesis.sweep
        columns = {"mode": np.array(self.modes, object)}
        columns |= dict(zip(self.headings, self.objectives.T, strict=True))
        columns |= dict(zip([x.name for x in sweep.variables], self.values.T, strict=True))
        return make_frame(columns | dict(self.figures), {"units": sweep.units()})

    @property
    def headings(self) -> list[str]:
        """The names of the columns of objectives."""
        count = len(self.synthesis.minimise)
        return ["objective"] if count == 1 else [f"objective_{k + 1}" for k in range(count)]

    def __repr__(self) -> str:
        best = " and ".join(f"{value:.6g}" for value in np.min(self.objectives, axis=0))
        return f"Sized({counted(len(self.objectives), 'design')}, least {best})"


def size(synthesis: Specification, starts: int = 12) -> Synthesis:
    """Return the best designs of a synthesis: a sweep, then descents from its best rows.

    With several objectives an evolution of the sweep's best (NSGA-II, Deb and others
    2002, by pymoo) is between these, and points of the front are attacked from other
    starts. Descents follow exact gradients (SciPy's SLSQP, and cutting planes at kinks);
    each keeps to its assembly mode, and to inputs at which it closes.

    Raises
    ------
    DesignError
        If no design meets the conditions.
    EngineError
        If there is no kernel of the mechanism's designs.
    """
    sweep = synthesis.sweep
    made = _evaluator(synthesis)
    working = ProgressReporter(f"{sweep.mechanism.name}: synthesis")
    rows, wanted, feasible = _looked_at(synthesis, MOST * starts, working)
    descent = Descent(synthesis, rows, wanted)
    several = len(synthesis.minimise) > 1
    places = descent.places
    if several:
        front = front_of(synthesis, rows["mode"], places, wanted, FRONT * starts, working)
        begun: list[Start] = [(HeldMode(mode), place) for mode, place in front]
    else:
        varied = np.stack([rows[variable.name] for variable in sweep.variables])
        begun = _spread(made, varied, rows["mode"], places, wanted[:, 0], starts)
    ends = []
    for k, (mode, start) in enumerate(begun):
        ends.append(descent.down(mode, start))
        working.tell(f"{k + 1} of {counted(len(begun), 'descent')}".__str__)
    if made.follows_modes:
        ends = _confirmed(made, descent, begun, ends)
    if several:
        ends = unbeaten(_apart(ends, descent), descent.tolerance)
        for k in range(len(ends)):
            ends[k] = descent.attacked(ends[k], ends)
            working.tell(f"{k + 1} of {counted(len(ends), 'point')} attacked".__str__)
    kept = _apart(ends, descent)
    if several:
        kept = unbeaten(kept, descent.tolerance)
    figures = np.transpose([end.figures for end in kept])
    columns = dict(zip([merit.name for merit in sweep.merits], figures, strict=True))
    return Synthesis(
        synthesis,
        np.array([descent.values(end.x) for end in kept]),
        tuple(end.mode.label for end in kept),
        np.array([end.wanted for end in kept]),
        synthesis.with_match(columns),
        sweep.space.count,
        feasible,
        np.min(wanted, axis=0),
        descent.tolerance,
    )


def _evaluator(synthesis: Specification) -> Evaluator:
    """Return what has the gradients; `DesignError` where there is no kernel."""
    sweep = synthesis.sweep
    made = synthesis.sweep.evaluator
    if not isinstance(made, Evaluator) or not made.has_gradients:
        raise DesignError(
            f"{sweep.mechanism.name}: synthesis follows gradients by numbers that kernels "
            "have as inputs, and there is no kernel of these designs: where profiles are "
            "no circles, sizes of links and numbers under pairs.PAIR.profiles vary; with "
            "others, constraints that repeat each other, or groups of more than 7 bodies "
            "or 64 solutions, sweep it instead"
        )
    if made.follows_modes and len(synthesis.minimise) > 1:
        raise DesignError(
            f"{sweep.mechanism.name}: fronts of several objectives are of modes that have "
            "signs, and some of its groups are no dyads; minimise one, and bound the "
            "others by conditions"
        )
    return made


def _looked_at(
    synthesis: Specification, count: int, working: ProgressReporter
) -> tuple[Columns, Floats, int]:
    """Return the best rows of the sweep, their objectives, and how many meet conditions."""
    sweep = synthesis.sweep
    parts = []
    feasible = 0
    for number in range(sweep.parts):
        rows, wanted = synthesis.rows_of(sweep.part(number))
        feasible += len(wanted)
        if wanted.shape[1] == 1:
            chosen = np.argsort(wanted[:, 0], kind="stable")[:count]
        else:
            chosen = nondominated(wanted, rows["mode"])
        best = {name: values[chosen] for name, values in rows.items()}
        parts.append((best, wanted[chosen]))
        done = min((number + 1) * sweep.part_size, sweep.space.count)
        working.tell(f"{done} designs looked at".__str__)
    if not feasible:
        raise DesignError(
            f"{sweep.mechanism.name}: none of {counted(sweep.space.count, 'design')} meets "
            f"the conditions: {synthesis.why_none()}; widen ranges, relax "
            f"conditions, or look "
            "at more with --designs"
        )
    rows = {name: np.concatenate([part[name] for part, _ in parts]) for name in rows}
    return rows, np.concatenate([part for _, part in parts]), feasible


Start = tuple[HeldMode, Floats]
"""A mode, and a place in units of the ranges, from which a descent goes."""


def _spread(
    evaluator: Evaluator,
    varied: Floats,
    modes: Array,
    places: Floats,
    wanted: Floats,
    count: int,
) -> list[Start]:
    """Return the best rows, of modes that can be held, beside no better one of the mode.

    Rows are of `varied` numbers (variables, rows) of the file.
    """
    chosen: list[Start] = []
    order = np.argsort(wanted, kind="stable")
    for first in range(0, len(order), AHEAD * count):
        rows = order[first : first + AHEAD * count]
        held = held_modes(evaluator, varied[:, rows], modes[rows].tolist())
        for row, mode in zip(rows, held, strict=True):
            if len(chosen) == count:
                return chosen
            if mode is not None and not any(
                max_abs(places[row] - place) < BESIDE and other.goes_on_in(mode)
                for other, place in chosen
            ):
                chosen.append((mode, places[row]))
    return chosen


def _confirmed(
    evaluator: Evaluator,
    descent: Descent,
    begun: Sequence[Start],
    ends: Sequence[LocalOptimum],
) -> list[LocalOptimum]:
    """Return ends of descents whose configurations are a mode of the design in a sweep.

    With its label there. Where they are none, a dead centre has come between two samples,
    and the start of the descent stands for its end.
    """
    made = []
    every = every_mode(evaluator, np.stack([descent.values(end.x) for end in ends], axis=1))
    for (mode, start), end, modes in zip(begun, ends, every, strict=True):
        same = [descent.here(x, end.x) for x in modes if end.mode.goes_on_in(x)]
        allowed = end.wanted + descent.tolerance
        good = [confirmed for confirmed in same if np.all(confirmed.wanted <= allowed)]
        made.append(good[0] if good else descent.here(mode, start))
    return made


def _apart(ends: Sequence[LocalOptimum], descent: Descent) -> list[LocalOptimum]:
    """Return ends of descents in order, those that came to the same linkage once."""
    kept: list[LocalOptimum] = []
    for end in sorted(ends, key=lambda end: tuple(end.wanted)):
        if not any(_alike(other, end, descent) for other in kept):
            kept.append(end)
    return kept


def _alike(one: LocalOptimum, other: LocalOptimum, descent: Descent) -> bool:
    """Return whether ends are one place, or one linkage told otherwise and as good."""
    off = np.abs(one.x - other.x)
    if np.max(off) < SAME and one.mode.goes_on_in(other.mode):
        return True
    sweep = descent.sweep
    acting = [variable.path[0] in ACTIONS for variable in sweep.variables]
    if np.any(np.abs(one.wanted - other.wanted) > descent.tolerance) or np.any(
        off[acting] >= SAME
    ):
        return False
    first, second = (
        designed(sweep.document, sweep.variables, descent.values(end.x))
        for end in (one, other)
    )
    return one_linkage(first, second)


def one_linkage(one: Mechanism, other: Mechanism) -> bool:
    """Return whether two mechanisms of R pairs on one graph are one, or mirror images.

    Axes may point the other way: where that of a pair is turned round, the arcs from it
    become 180 deg less what they were.
    """
    if not all(pair.kind.has_axis for pair in one.pairs):
        return False
    count = len(one.pairs)
    signs = 1.0 - 2.0 * (np.arange(2**count)[:, None] >> np.arange(count) & 1)
    frames = [pair_frames(mechanism) for mechanism in (one, other)]
    for link in one.links:
        places = [
            (k, p.links.index(link)) for k, p in enumerate(one.pairs) if link in p.links
        ]
        axes, wanted = (
            np.array([of_side[side][one.pairs[k].name][:, 2] for k, side in places])
            for of_side in frames
        )
        turned = signs[:, [k for k, _ in places], None] * axes
        off = turned @ np.swapaxes(turned, 1, 2) - wanted @ wanted.T
        near = max_abs(off, axis=(1, 2)) < SAME
        # All axes the other way are those of the mirror image.
        for three in map(list, combinations(range(len(places)), 3)):
            missed = np.linalg.det(turned[:, three]) - np.linalg.det(wanted[three])
            near &= np.abs(missed) < SAME
        signs = signs[near]
    return len(signs) > 0
