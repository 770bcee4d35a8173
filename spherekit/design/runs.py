"""Designs that are run one by one: tables of analyses, and figures of merit from them."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.contract import AbstractAnalysis, FigureOfMerit
from spherekit.analysis.execution import Execution
from spherekit.analysis.result import MOTION, RunResult, stems
from spherekit.analysis.run import executed
from spherekit.analysis.tables import Table, TableArrays
from spherekit.arrays import Floats
from spherekit.conventions import Status, choices, counted, listing
from spherekit.design.evaluate import SINGLY, Evaluator
from spherekit.design.figures import IMPOSSIBLE, Evaluated, reduced, refused
from spherekit.design.variables import OK, DesignVariable, designed
from spherekit.errors import AnalysisError, DesignError, SpherekitError
from spherekit.files.document import Document
from spherekit.model.study import Study
from spherekit.numeric.crossings import return_by_turns
from spherekit.sphere.rotation import max_abs

if TYPE_CHECKING:
    import pandas as pd

WORKING, OF_RUN = "working", "run"
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


@dataclass(frozen=True)
class DesignRun:
    """What the run of a design found.

    Attributes
    ----------
    modes
        The modes of which there are rows, `WHOLE` where there is none.
    figures
        By name, in each mode of the table, or of `WHOLE` where that has none.
    shares, labels
        By the numbers of assembly modes: at which share of samples each closes, its name.
    claim
        What is guaranteed of the modes.
    tables
        All tables, if these are wanted.
    """

    modes: tuple[Mode, ...]
    figures: Mapping[str, Mapping[Mode, float]]
    shares: Mapping[str, float]
    labels: Mapping[str, str]
    claim: str
    tables: tuple[RunTable, ...]


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
        analyses: Sequence[AbstractAnalysis],
        tables: bool,
        kernel_figures: Evaluator | None,
    ) -> None:
        self.document, self.study = document, study
        self.variables = tuple(variables)
        self.merits, self.analyses = tuple(merits), tuple(analyses)
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
        made = [of_design for of_design, _ in self.runs_of(values)]
        return Evaluated.in_order([self.none(), *made])

    def none(self) -> Evaluated:
        """Return no rows."""
        return Evaluated.of([], self.names)

    def runs_of(
        self, values: Floats, worth: Callable[[Floats, Evaluated], bool] | None = None
    ) -> Iterator[tuple[Evaluated, tuple[RunTable, ...]]]:
        """Yield the rows of each design (variables, n), and its tables if it has some.

        Those are left out that by the rows of the kernel are not `worth` it.
        """
        kernel = None
        if self.kernel_figures is not None:
            kernel = self.kernel_figures.at(values)
        for number, design in enumerate(values.T):
            rows = None if kernel is None else kernel.rows(kernel.design == number)
            if rows is not None and worth is not None and not worth(design, rows):
                continue
            run: DesignRun | SpherekitError
            try:
                if rows is not None and np.all(rows.status == IMPOSSIBLE):
                    raise DesignError(rows.reason[0])
                run = self.run(design)
            except SpherekitError as problem:
                run = problem
            made = self._rows(rows, run)
            numbers = np.full(len(made.design), number)
            tables = run.tables if isinstance(run, DesignRun) else ()
            yield replace(made, design=numbers), tables

    def _rows(self, rows: Evaluated | None, run: DesignRun | SpherekitError) -> Evaluated:
        """Return the rows of a design from its run and from those of the kernel, if any."""
        if not isinstance(run, DesignRun):
            why = refused(run, self.names)
            if rows is None:
                return why
            count = len(rows.design)
            made = replace(rows, merits=self._figures(None, [WHOLE] * count, rows))
            if not np.all(rows.status == OK):
                return made
            status, reason = np.repeat(why.status, count), np.repeat(why.reason, count)
            return replace(made, status=status, reason=reason)
        if rows is None:
            return self._of_run(run, run.modes, [mode for _, mode in run.modes])
        place = {mode: self._place(rows, mode, run) for mode in run.modes}
        on = {row: mode for mode, row in place.items()}
        modes = [on.get(k, WHOLE) for k in range(len(rows.design))]
        made = replace(rows, merits=self._figures(run, modes, rows))
        figured = {mode for of_modes in run.figures.values() for mode in of_modes}
        others = [m for m, row in place.items() if row is None and m in figured - {WHOLE}]
        labels = [f"{OF_RUN if m[0] == ASSEMBLY else WORKING} {m[1]}" for m in others]
        return Evaluated.joined([made, self._of_run(run, others, labels)])

    def _of_run(
        self, run: DesignRun, modes: Sequence[Mode], labels: Sequence[str]
    ) -> Evaluated:
        """Return rows of modes that the kernel has none of."""
        nan = float("nan")
        closes = [
            run.shares.get(mode, nan) if column == ASSEMBLY else nan
            for column, mode in modes
        ]
        figures, zeros = self._figures(run, modes, None), np.zeros(len(modes))
        return Evaluated.of(zeros, figures, labels, closes, claim=run.claim)

    def _figures(
        self, run: DesignRun | None, modes: Sequence[Mode], rows: Evaluated | None
    ) -> dict[str, Floats]:
        """Return the figures of a kernel's rows, those of a run, numbers of its modes."""
        nan = float("nan")
        made = {name: np.full(len(modes), nan) for name in self._of_kernel}
        made |= rows.merits if rows is not None else {}
        for name in self.units:
            of: Mapping[Mode, float] = {} if run is None else run.figures[name]
            made[name] = np.array([of.get(m, of.get(WHOLE, nan)) for m in modes])
        if self.tables:
            numbers = [float(m) if column == ASSEMBLY else nan for column, m in modes]
            made[ASSEMBLY] = np.array(numbers)
        return made

    def _place(self, rows: Evaluated, mode: Mode, run: DesignRun) -> int | None:
        """Return the row of the kernel that a mode of the run is, None if none is."""
        made = self.kernel_figures
        column, number = mode
        if made is None or made.is_followed or column != ASSEMBLY:
            return None
        if made.kernel is not None and made.varied.contacts is not None:
            return None
        label = run.labels[number]
        places = np.flatnonzero(
            np.isin(rows.mode.astype(str), [label, f"{number} {label}"])
        )
        return int(places[0]) if len(places) == 1 else None

    def run(self, values: Floats) -> DesignRun:
        """Return what the run of a design (variables,) finds, in the file's units.

        Raises
        ------
        SpherekitError
            If there is no such design, or an analysis of it fails.
        """
        mechanism = designed(self.document, self.variables, list(values))
        mechanism = mechanism.with_inputs(*self.study.mechanism.input_pairs)
        study = replace(self.study, mechanism=mechanism)
        run = executed(study, self.analyses, Execution())
        if run.failures:
            raise AnalysisError(next(iter(run.failures.values())))
        figures = {merit.name: self._by_mode(run, merit) for merit in self.merits}
        assembled = run.summary.get("assembly_modes", ())
        labels = {str(item["number"]): str(item["mode"]) for item in assembled}
        shares = {str(item["number"]): _share(item["status"]) for item in assembled}
        modes = {mode for of_modes in figures.values() for mode in of_modes} - {WHOLE}
        modes |= {(ASSEMBLY, number) for number in labels} if self.tables else set()
        words = str(run.summary.get("search", ""))
        return DesignRun(
            tuple(sorted(modes, key=lambda mode: mode[1])) or (WHOLE,),
            figures,
            shares,
            labels,
            words.partition(":")[0] if MOTION in run.results and ":" in words else "",
            _tables(run) if self.tables else (),
        )

    def _by_mode(
        self, run: RunResult, merit: FigureOfMerit
    ) -> dict[tuple[str, str], float]:
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
        chosen = present.index(f"q_{merit.place}") if f"q_{merit.place}" in present else 0
        returns = bool(present) and len(q) > 0 and return_by_turns(q[0], q[-1])
        here = np.flatnonzero(
            max_abs(q - merit.point, axis=1) < 1e-9 if merit.point else np.ones(len(q))
        )
        figure = reduced(merit.reduction, q[here, chosen], values[here, None], returns)
        return float(figure[0])


def _tables(run: RunResult) -> tuple[RunTable, ...]:
    """Return all tables of a run."""
    declared = {name: result.tables for name, result in run.results.items()}
    return tuple(
        (stem, table, run.results[name].data[table.name])
        for stem, (name, table) in stems(declared).items()
    )


def _units(
    merit: FigureOfMerit, analyses: Sequence[AbstractAnalysis], study: Study
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
        said = choices(table, tables, "it has")
        raise DesignError(f'{merit.name}: {analysis} has no table "{table}"{said}')
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
