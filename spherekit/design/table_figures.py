"""Figures of merit from the tables of analyses: every design is run on its own."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, final

import numpy as np

from spherekit.analysis.contract import AbstractAnalysis
from spherekit.analysis.execution import Execution
from spherekit.analysis.merit import Merit, Reducing
from spherekit.analysis.result import MOTION, RunResult
from spherekit.analysis.run import executed
from spherekit.conventions import Status, counted, listing, nearest
from spherekit.design.evaluate import SINGLY
from spherekit.design.evaluated import Evaluated, evaluated, none, refused
from spherekit.design.variables import DesignVariable, designed
from spherekit.errors import AnalysisError, DesignError, SpherekitError
from spherekit.files.document import Document
from spherekit.model.study import Study
from spherekit.numeric.turns import return_by_turns
from spherekit.sphere.rotation import Floats

if TYPE_CHECKING:
    import pandas as pd

MODES = ("assembly_mode", "working_mode")
"""Columns by which the rows of a table are those of modes."""


@final
class TableFigures:
    """Figures of tables; their analyses may be of any mechanism, with several inputs too.

    Raises
    ------
    DesignError
        If a table, or a column of an expression, is not known.
    """

    kernel = None

    def __init__(
        self,
        document: Document,
        study: Study,
        variables: Sequence[DesignVariable],
        merits: Sequence[Merit],
        analyses: Sequence[AbstractAnalysis],
    ) -> None:
        self.document, self.study = document, study
        self.variables = tuple(variables)
        self.merits, self.analyses = tuple(merits), tuple(analyses)
        self.units = {m.name: _units(m, analyses, study) for m in merits}
        for merit in merits:
            merit.parsed(self.units[merit.name])

    def classes(self, values: Floats) -> None:
        """Return no Grashof classes."""

    def part(self, count: int) -> int:
        """Return how many of so many designs are taken together."""
        return min(count, SINGLY)

    def at(self, values: Floats) -> Evaluated:
        """Return the figures of merit of designs (variables, n), in the file's units."""
        parts = [none(self.merits)]
        for k, design in enumerate(values.T):
            try:
                of_design = self._single(list(design))
            except SpherekitError as problem:
                of_design = refused(problem, self.merits)
            parts.append(replace(of_design, design=of_design.design + k))
        return Evaluated.joined(parts, [merit.name for merit in self.merits])

    def _single(self, values: Sequence[float]) -> Evaluated:
        mechanism = designed(self.document, self.variables, values)
        mechanism = mechanism.with_inputs(*(i.pair for i in self.study.mechanism.inputs))
        study = replace(self.study, mechanism=mechanism)
        run = executed(study, self.analyses, Execution())
        if run.failures:
            raise AnalysisError(next(iter(run.failures.values())))
        figures = [self._by_mode(run, merit) for merit in self.merits]
        modes = sorted({mode for figure in figures for mode in figure}) or [""]
        made = {
            merit.name: np.array(
                [figure.get(mode, figure.get("", np.nan)) for mode in modes]
            )
            for merit, figure in zip(self.merits, figures, strict=True)
        }
        words = str(run.summary.get("search", ""))
        claim = words.partition(":")[0] if MOTION in run.results and ":" in words else ""
        return evaluated(
            np.zeros(len(modes), dtype=np.int64),
            np.array(modes, dtype=object),
            np.array([_closes(run, mode) for mode in modes]),
            claim,
            made,
        )

    def _by_mode(self, run: RunResult, merit: Merit) -> dict[str, float]:
        """Return a figure for each mode of its table; of "" where it has no modes."""
        rows = run.frame(*merit.of_table)
        for column, value in merit.only:
            rows = rows[rows[column].astype(str) == value]
        for column in MODES:
            if column in rows:
                modes = rows[column].astype(str)
                return {m: self._reduced(merit, rows[modes == m]) for m in modes.unique()}
        return {"": self._reduced(merit, rows)}

    def _reduced(self, merit: Merit, rows: "pd.DataFrame") -> float:
        expression = merit.parsed(self.units[merit.name])
        columns = {name: rows[name].to_numpy(dtype=float) for name in expression.names}
        values = np.broadcast_to(expression.evaluate(columns), len(rows))
        names = ["q", *(f"q_{item.pair}" for item in self.study.mechanism.inputs)]
        present = [name for name in names if name in rows]
        q = (
            rows[present].to_numpy(dtype=float)
            if present
            else np.arange(len(rows))[:, None]
        )
        if merit.point and len(merit.point) != q.shape[1]:
            raise DesignError(
                f"{merit.name}: at needs {counted(q.shape[1], 'input')}, not "
                f"{len(merit.point)}"
            )
        chosen = present.index(f"q_{merit.place}") if f"q_{merit.place}" in present else 0
        returns = bool(present) and len(q) > 0 and return_by_turns(q[0], q[-1])
        reducing = Reducing(merit, 1, returns)
        for place, value in zip(q, values, strict=True):
            if not merit.point or np.max(np.abs(place - merit.point)) < 1e-9:
                reducing.take(float(place[chosen]), np.array([value]))
        return float(reducing.result()[0])


def _units(
    merit: Merit, analyses: Sequence[AbstractAnalysis], study: Study
) -> dict[str, str]:
    """Return the unit of each column of numbers in the table of a figure."""
    analysis, table = merit.of_table
    if analysis == MOTION:
        raise DesignError(
            f"{merit.name}: {analysis}.{table} is of no analysis; name a table of one"
        )
    (chosen,) = (candidate for candidate in analyses if candidate.name == analysis)
    tables = {made.name: made.of(study.mechanism) for made in chosen.tables}
    if table not in tables:
        hint = nearest(table, tables) or ";"
        raise DesignError(
            f'{merit.name}: {analysis} has no table "{table}"{hint} it has '
            f"{listing(tables)}"
        )
    columns = tables[table].columns
    names = [column.name for column in columns]
    for column, _ in merit.only:
        if column not in names:
            raise DesignError(
                f"{merit.name}: {analysis}.{table} has no column {column}; its columns: "
                f"{listing(names)}"
            )
    return {item.name: item.unit for item in columns if item.kind == "number"}


def _closes(run: RunResult, mode: str) -> float:
    """Return the share of samples at which an assembly mode closes; NaN of other modes."""
    data: Any = run.results[MOTION].data if MOTION in run.results else {}
    if MOTION not in data:
        return float("nan")
    rows = run.frame(MOTION)
    status = rows["status"][rows["assembly_mode"].astype(str) == mode].astype(str)
    held = status.isin([Status.OK.name, Status.AT_SINGULARITY.name])
    return float(held.mean()) if len(status) else float("nan")
