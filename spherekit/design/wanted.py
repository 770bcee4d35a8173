"""What a sizing wants: objectives, conditions and precision points."""

from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import counted
from spherekit.design.figures import NEVER_CLOSES
from spherekit.design.file_numbers import OK
from spherekit.design.sweep import Columns, Sweep
from spherekit.errors import DesignError, ModelError
from spherekit.model.expression import Expression, parse
from spherekit.sphere.rotation import Floats

Rows = NDArray[np.intp]

LOOKED_AT = 1024
"""Designs by which a sizing says what none of them meets."""

MATCH = "match"
"""The figure of precision points."""


@final
@dataclass(frozen=True)
class Sizing:
    """What sizes are wanted: objectives, and conditions, of figures of a sweep.

    Attributes
    ----------
    sweep
        The designs that are looked at first, their figures, and the conditions.
    minimise
        The objectives, expressions of figures and varied numbers.
    matched
        Names of the figures that precision points are missed by.
    """

    sweep: Sweep
    minimise: tuple[str, ...]
    matched: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        _ = self.objectives

    @cached_property
    def names(self) -> list[str]:
        """What objective and conditions may be of."""
        names = [variable.name for variable in self.sweep.variables]
        names += [merit.name for merit in self.sweep.merits]
        return [*names, MATCH] if self.matched else names

    @cached_property
    def objectives(self) -> tuple[Expression, ...]:
        """The parsed objectives."""
        try:
            return tuple(parse(text, self.names) for text in self.minimise)
        except ModelError as problem:
            raise DesignError(f"minimise: {problem}") from None

    def rows_of(self, columns: Columns) -> tuple[Columns, Floats]:
        """Return the good rows of a sweep's columns, and their objectives (rows, k)."""
        rows = self.with_match(columns)
        objectives = self._worth(rows)
        good = (rows["status"] == "OK") & np.all(np.isfinite(objectives), axis=1)
        kept = {name: np.asarray(values)[good] for name, values in rows.items()}
        return kept, objectives[good]

    def with_match(self, columns: Columns) -> Columns:
        """Return columns with the figure of the precision points, if there are some."""
        if not self.matched:
            return columns
        missed = np.array([columns[name] for name in self.matched])
        return {**columns, MATCH: np.sqrt(np.mean(missed * missed, axis=0))}

    def missed(self, designs: Floats, mode: str) -> tuple[Rows, Floats, Floats]:
        """Return which designs (variables, n) have a mode, and what they are worth in it.

        Returns
        -------
        rows, objectives, missed
            Numbers (m,) of designs, their objectives (m, k), and (m,) by how much the
            conditions are missed in all, 0 where they hold.
        """
        columns = self.with_match(self.sweep.rows(designs, np.arange(designs.shape[1])))
        here = (columns["mode"] == mode) & (columns["status"] == "OK")
        rows = {name: np.asarray(values)[here] for name, values in columns.items()}
        objectives = self._worth(rows)
        missed = np.zeros(len(objectives))
        for condition in self.sweep.conditions:
            missed += np.maximum(-np.nan_to_num(condition.slack(rows), nan=-np.inf), 0.0)
        finite = np.all(np.isfinite(objectives), axis=1)
        return rows["design"][finite], objectives[finite], missed[finite]

    def why_none(self) -> str:
        """Return what keeps designs from being good, in words, by some of the first."""
        designs = self.sweep.space.designs(0, LOOKED_AT)
        rows = self.with_match(self.sweep.rows(designs, np.arange(designs.shape[1])))
        status, reasons, n = rows["status"], rows["reason"], designs.shape[1]
        words, there = [], status == OK
        if never := int(np.sum(status == NEVER_CLOSES)):
            words.append(f"{never} of {n} close at no sample")
        if others := reasons[(status != OK) & (status != NEVER_CLOSES)].tolist():
            words.append(f"{len(others)} of {n} cannot be ({others[0]})")
        kept = {name: np.asarray(values)[there] for name, values in rows.items()}
        count = int(np.sum(there))
        if count:
            words += [
                f"{condition.text} holds in {int(np.sum(condition.holds(kept)))} of "
                f"{counted(count, 'row')}"
                for condition in self.sweep.conditions
            ]
            defined = np.all(np.isfinite(self._worth(kept)), axis=1)
            if not np.any(defined):
                words.append("objectives have no value")
        return ", ".join(words)

    def _worth(self, rows: Columns) -> Floats:
        """Return the objectives (rows, k)."""
        shape = rows["design"].shape
        worth = [
            objective.evaluate({name: rows[name] for name in objective.names})
            for objective in self.objectives
        ]
        return np.stack([np.broadcast_to(values, shape) for values in worth], axis=1)
