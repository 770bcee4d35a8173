"""Designs that are run one by one: tables of analyses, and figures of merit from them."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from spherekit.arrays import Floats
from spherekit.conventions import Facts
from spherekit.designs.design_evaluation import SINGLY, Evaluator
from spherekit.designs.design_variables import OK, DesignVariable, designed
from spherekit.designs.figures_of_merit import IMPOSSIBLE, Evaluated, reduced, refused
from spherekit.errors import AnalysisError, DesignError, SpherekitError
from spherekit.files.study import Study
from spherekit.files.toml_document import Document
from spherekit.geometry.vectors import max_abs, nans
from spherekit.numerics.angles import return_after_revolutions
from spherekit.runs.contract import Analyses
from spherekit.runs.execution import Execution
from spherekit.runs.figure_of_merit import FigureOfMerit
from spherekit.runs.run_result import MOTION, RunResult, stems
from spherekit.runs.runner import run_study
from spherekit.status import Status
from spherekit.tables.table import Table, TableArrays, Units
from spherekit.wording import choices, counted, listing

if TYPE_CHECKING:
    import pandas as pd

WORKING = "working"
OF_RUN = "run"
"""Before the names of modes that are not the assembly modes of the kernel."""
ASSEMBLY = "assembly_mode"
MODES = (ASSEMBLY, "working_mode")
"""Columns by which the rows of a table are those of modes."""

Mode = tuple[str, str]
"""The column that says of which mode a row is, and which."""
WHOLE: Mode = "", ""
"""Instead of a mode: what is of none."""

RunTable = tuple[str, Table, TableArrays]
"""What a run's file is called, its table, and the columns of that."""


Figures = Mapping[str, Mapping[Mode, float]]
"""By name, in each mode of the table, or of `WHOLE` where that has none."""

NAN = float("nan")


class DesignRuns:
    """Figures and tables of runs, joined mode by mode with the figures of a kernel.

    Analyses may be of any mechanism, with several inputs too. Runs count assembly modes,
    kernels name them by the signs of dyads. Where both are the same for certain their
    figures share a row; other modes have rows of their own.

    Raises
    ------
    DesignError
        If a table, or a column of an expression, is not known.
    """

    kernel = None  # none has all figures

    def __init__(
        self,
        document: Document,
        study: Study,
        variables: Sequence[DesignVariable],
        merits: Sequence[FigureOfMerit],
        analyses: Analyses,
        tables: bool,
        kernel_figures: Evaluator | None,
    ) -> None:
        self.document, self.study = document, study
        self.variables, self.merits, self.analyses = variables, merits, analyses
        self.tables, self.kernel_figures = tables, kernel_figures
        self.units = {m.name: _units(m, analyses, study) for m in merits}
        for merit in merits:
            merit.parsed(self.units[merit.name])
        self._of_kernel = kernel_figures.figures.names if kernel_figures else []
        self.names = [*self._of_kernel, *self.units, *([ASSEMBLY] if tables else [])]

    def classes(self, values: Floats) -> NDArray[np.str_] | None:
        """Return the Grashof classes of designs, where the kernel knows them."""
        figures = self.kernel_figures
        return None if figures is None else figures.classes(values)

    def part(self, count: int) -> int:
        """Return how many of so many designs are taken together."""
        return min(count, SINGLY)

    def at(self, values: Floats) -> Evaluated:
        """Return the figures of merit of designs (variables, n), in the file's units."""
        return Evaluated.in_order(
            [of_design for of_design, _ in self.runs_of(values)], self.names
        )

    def runs_of(
        self, values: Floats, worth: Callable[[Floats, Evaluated], bool] | None = None
    ) -> Iterator[tuple[Evaluated, tuple[RunTable, ...]]]:
        """Yield the rows of each design (variables, n), and its tables if it has some.

        Those are left out that by the rows of the kernel are not `worth` it.
        """
        kernel = None if self.kernel_figures is None else self.kernel_figures.at(values)
        for number, design in enumerate(values.T):
            rows = None if kernel is None else kernel.rows(kernel.design == number)
            if rows is not None and worth is not None and not worth(design, rows):
                continue
            tables: tuple[RunTable, ...] = ()
            try:
                if rows is not None and np.all(rows.status == IMPOSSIBLE):
                    raise DesignError(rows.reason[0])
                run = self.run(design)
                made = self._joined(rows, run)
                if self.tables:
                    tables = _tables(run)
            except SpherekitError as problem:
                made = self._failed(rows, problem)
            yield replace(made, design=np.full(len(made.design), number)), tables

    def run(self, values: Floats) -> RunResult:
        """Return the run of a design (variables,), in the file's units.

        Raises
        ------
        SpherekitError
            If there is no such design, or an analysis of it fails.
        """
        mechanism = designed(self.document, self.variables, values)
        mechanism = mechanism.with_inputs(*self.study.mechanism.input_pairs)
        study = replace(self.study, mechanism=mechanism)
        run = run_study(study, self.analyses, Execution())
        if run.failures:
            raise AnalysisError(next(iter(run.failures.values())))
        return run

    def _failed(self, rows: Evaluated | None, problem: SpherekitError) -> Evaluated:
        """Return the rows of a design whose run failed, by those of the kernel, if any."""
        why = refused(problem, self.names)
        if rows is None:
            return why
        count = len(rows.design)
        made = self._with_figures(rows, [WHOLE] * count, {})
        if not np.all(rows.status == OK):
            return made
        status = np.repeat(why.status, count)
        reason = np.repeat(why.reason, count)
        return replace(made, status=status, reason=reason)

    def _joined(self, rows: Evaluated | None, run: RunResult) -> Evaluated:
        """Return the rows of a design from its run and from those of the kernel, if any."""
        figures = {merit.name: self._by_mode(run, merit) for merit in self.merits}
        assembled = {str(x["number"]): x for x in run.summary.get("assembly_modes", ())}
        figured = set[Mode]().union(*figures.values()) - {WHOLE}
        numbered = {(ASSEMBLY, number) for number in assembled}
        shown = figured | numbered if self.tables else figured
        modes = sorted(shown, key=lambda mode: mode[1]) or [WHOLE]
        words = str(run.summary.get("search", ""))
        claim = words.partition(":")[0] if MOTION in run.results and ":" in words else ""
        labels = [number for _, number in modes]
        place = dict[int, Mode]()
        if rows is not None:
            every = {mode: self._place(rows, mode, assembled) for mode in modes}
            place = {row: mode for mode, row in every.items() if row is not None}
            modes = [m for m, row in every.items() if row is None and m in figured]
            labels = [f"{OF_RUN if m[0] == ASSEMBLY else WORKING} {m[1]}" for m in modes]
        closes = [
            _share(assembled[m[1]]["status"]) if m in numbered else NAN for m in modes
        ]
        made = Evaluated.of(np.zeros(len(modes)), (), labels, closes, claim=claim)
        made = self._with_figures(made, modes, figures)
        if rows is None:
            return made
        on = [place.get(row, WHOLE) for row in range(len(rows.design))]
        return Evaluated.joined([self._with_figures(rows, on, figures), made])

    def _with_figures(
        self, rows: Evaluated, modes: Sequence[Mode], figures: Figures
    ) -> Evaluated:
        """Return rows with the figures of a run in its modes, and the numbers of these."""
        count = len(modes)
        made = {name: nans(count) for name in self._of_kernel} | dict(rows.merits)
        for name in self.units:
            of = figures.get(name, {})
            made[name] = np.array([of.get(m, of.get(WHOLE, NAN)) for m in modes])
        if self.tables:
            made[ASSEMBLY] = np.array(
                [float(m) if column == ASSEMBLY else NAN for column, m in modes]
            )
        return replace(rows, merits=made)

    def _place(self, rows: Evaluated, mode: Mode, assembled: Facts) -> int | None:
        """Return the row of the kernel that a mode of the run is, None if none is."""
        made = self.kernel_figures
        column, number = mode
        if made is None or made.is_followed or column != ASSEMBLY:
            return None
        if made.kernel and made.varied.contacts:
            return None
        label = str(assembled[number]["mode"])
        places = np.flatnonzero(
            np.isin(rows.mode.astype(str), [label, f"{number} {label}"])
        )
        return places[0] if len(places) == 1 else None

    def _by_mode(self, run: RunResult, merit: FigureOfMerit) -> dict[Mode, float]:
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

    def _reduced(self, merit: FigureOfMerit, rows: "pd.DataFrame") -> float:
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
        place = f"q_{merit.place}"
        chosen = present.index(place) if place in present else 0
        returns = len(q) > 0 and return_after_revolutions(q[0], q[-1])
        here = np.ones(len(q), bool)
        if merit.point:
            here = max_abs(q - merit.point, axis=1) < 1e-9
        return reduced(merit.reduction, q[here, chosen], values[here, None], returns).item()


def _tables(run: RunResult) -> tuple[RunTable, ...]:
    """Return all tables of a run."""
    declared = {name: result.tables for name, result in run.results.items()}
    return tuple(
        (stem, table, run.results[name].data[table.name])
        for stem, (name, table) in stems(declared).items()
    )


def _units(merit: FigureOfMerit, analyses: Analyses, study: Study) -> Units:
    """Return the unit of each column of numbers in the table of a figure."""
    analysis, table = merit.of_table
    if analysis == MOTION:
        raise DesignError(
            f"{merit.name}: {analysis}.{table} is of no analysis; name a table of one"
        )
    (chosen,) = (candidate for candidate in analyses if candidate.name == analysis)
    tables = {made.name: made.of(study.mechanism) for made in chosen.tables}
    if table not in tables:
        raise DesignError(
            f'{merit.name}: {analysis} has no table "{table}"'
            f"{choices(table, tables, 'it has')}"
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
    return closed / total if (total := sum(statuses.values())) else NAN
