"""Tables of analyses of designs, and figures of merit from them: a run for each design."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, final

import numpy as np

from spherekit.analysis.contract import AbstractAnalysis
from spherekit.analysis.execution import Execution
from spherekit.analysis.merit import Merit, Reducing
from spherekit.analysis.result import MOTION, RunResult, stem_of
from spherekit.analysis.run import executed
from spherekit.analysis.tables import Table, TableArrays
from spherekit.conventions import Status, counted, listing, nearest
from spherekit.design.variables import DesignVariable, designed
from spherekit.errors import AnalysisError, DesignError
from spherekit.files.document import Document
from spherekit.model.study import Study
from spherekit.numeric.turns import return_by_turns
from spherekit.sphere.rotation import Floats

if TYPE_CHECKING:
    import pandas as pd

ASSEMBLY = "assembly_mode"
MODES = (ASSEMBLY, "working_mode")
"""Columns by which the rows of a table are those of modes."""

WHOLE = "", ""
"""Instead of the column and the mode: what is of no mode."""

RunTable = tuple[str, Table, TableArrays]
"""What a run's file is called, its table, and the columns of that."""


@final
@dataclass(frozen=True)
class DesignRun:
    """What the run of a design found.

    Attributes
    ----------
    modes
        The modes of which there are rows: by which column, and which.
    figures, whole
        Figures in each of these modes, and figures of tables without modes.
    closes
        The share of samples at which each mode closes, NaN of working modes.
    claim
        What is guaranteed of the modes.
    labels
        What assembly modes are called, by their numbers.
    tables
        All tables, if these are wanted.
    figured
        The modes of which there are figures.
    """

    modes: tuple[tuple[str, str], ...]
    figures: Mapping[str, Floats]
    whole: Mapping[str, float]
    closes: Floats
    claim: str
    labels: Mapping[str, str]
    tables: tuple[RunTable, ...]
    figured: frozenset[tuple[str, str]]


@final
class TableFigures:
    """Figures of tables; their analyses may be of any mechanism, with several inputs too.

    Raises
    ------
    DesignError
        If a table, or a column of an expression, is not known.
    """

    def __init__(
        self,
        document: Document,
        study: Study,
        variables: Sequence[DesignVariable],
        merits: Sequence[Merit],
        analyses: Sequence[AbstractAnalysis],
        tables: bool = False,
    ) -> None:
        self.document, self.study = document, study
        self.variables = tuple(variables)
        self.merits, self.analyses = tuple(merits), tuple(analyses)
        self.tables = tables
        self.units = {m.name: _units(m, analyses, study) for m in merits}
        for merit in merits:
            merit.parsed(self.units[merit.name])

    def run(self, values: Floats) -> DesignRun:
        """Return what the run of a design (variables,) finds, in the file's units.

        Raises
        ------
        SpherekitError
            If there is no such design, or an analysis of it fails.
        """
        mechanism = designed(self.document, self.variables, list(values))
        mechanism = mechanism.with_inputs(*(i.pair for i in self.study.mechanism.inputs))
        study = replace(self.study, mechanism=mechanism)
        run = executed(study, self.analyses, Execution())
        if run.failures:
            raise AnalysisError(next(iter(run.failures.values())))
        by_mode = {merit.name: self._by_mode(run, merit) for merit in self.merits}
        assembled = run.summary.get("assembly_modes", ())
        labels = {str(item["number"]): str(item["mode"]) for item in assembled}
        shares = {str(item["number"]): _share(item["status"]) for item in assembled}
        figured = {mode for figure in by_mode.values() for mode in figure} - {WHOLE}
        numbered = {(ASSEMBLY, number) for number in labels} if self.tables else set()
        modes = figured | numbered
        ordered = tuple(sorted(modes, key=lambda mode: mode[1])) or (WHOLE,)
        figures = {
            name: np.array([of.get(mode, of.get(WHOLE, np.nan)) for mode in ordered])
            for name, of in by_mode.items()
        }
        words = str(run.summary.get("search", ""))
        return DesignRun(
            ordered,
            figures,
            {name: of.get(WHOLE, np.nan) for name, of in by_mode.items()},
            np.array(
                [
                    shares.get(mode, np.nan) if column == ASSEMBLY else np.nan
                    for column, mode in ordered
                ]
            ),
            words.partition(":")[0] if MOTION in run.results and ":" in words else "",
            labels,
            _tables(run) if self.tables else (),
            frozenset(figured),
        )

    def _by_mode(self, run: RunResult, merit: Merit) -> dict[tuple[str, str], float]:
        """Return a figure for each mode of its table; of `WHOLE` where it has no modes."""
        rows = run.frame(*merit.of_table)
        for column, value in merit.only:
            rows = rows[rows[column].astype(str) == value]
        for column in MODES:
            if column in rows:
                modes = rows[column].astype(str)
                return {
                    (column, m): self._reduced(merit, rows[modes == m])
                    for m in modes.unique()
                }
        return {WHOLE: self._reduced(merit, rows)}

    def _reduced(self, merit: Merit, rows: "pd.DataFrame") -> float:
        expression = merit.parsed(self.units[merit.name])
        columns = {name: rows[name].to_numpy(dtype=float) for name in expression.names}
        values = np.broadcast_to(expression.evaluate(columns), len(rows))
        if "status" in rows and np.any(
            np.isnan(values) & (rows["status"] == Status.OVERFLOW.name)
        ):
            return np.inf  # as by a kernel: of the rest it would be a number that is wrong
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


def _tables(run: RunResult) -> tuple[RunTable, ...]:
    """Return all tables of a run."""
    return tuple(
        (stem_of(name, result.tables, table), table, result.data[table.name])
        for name, result in run.results.items()
        for table in result.tables
    )


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


def _share(statuses: Mapping[str, int]) -> float:
    """Return the share of samples at which an assembly mode closes, by its statuses."""
    closed = sum(statuses.get(s.name, 0) for s in (Status.OK, Status.AT_SINGULARITY))
    return closed / total if (total := sum(statuses.values())) else float("nan")
