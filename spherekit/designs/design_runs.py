"""Runs of designs, one by one: tables of analyses, and figures of merit from these."""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from spherekit.arrays import Array, Bools, Floats
from spherekit.conventions import Facts
from spherekit.designs.design_evaluation import SINGLE_DESIGN_PART_SIZE, DesignEvaluator
from spherekit.designs.design_variables import OK, DesignVariable, make_design
from spherekit.designs.figures_of_merit import (
    IMPOSSIBLE,
    DesignTable,
    failed_design,
)
from spherekit.errors import AnalysisError, DesignError, SpherekitError
from spherekit.files.study import Study
from spherekit.files.toml_document import Document
from spherekit.geometry.vectors import max_abs, nans
from spherekit.numerics.angles import SAME_ANGLE_RAD, return_after_revolutions
from spherekit.runs.contract import Analyses
from spherekit.runs.execution import Execution
from spherekit.runs.figure_of_merit import FigureOfMerit
from spherekit.runs.reductions import REDUCTION_BY_NAME, reduce_samples
from spherekit.runs.run_result import MOTION, RunResult, tables_by_file_stem
from spherekit.runs.runner import run_study
from spherekit.status import Status
from spherekit.tables.table import SAMPLE, Table, TableArrays, Units
from spherekit.wording import choices, counted, listing

if TYPE_CHECKING:
    import pandas as pd

WORKING_MODE_PREFIX = "working"
"""Beginning of the label of a working mode, in tables that have modes of a kernel too."""

RUN_MODE_PREFIX = "run"
"""Beginning of the label of an assembly mode of a run that is no mode of the kernel."""

ASSEMBLY = "assembly_mode"
"""Column of tables with the number of the assembly mode."""

WORKING = "working_mode"
"""Column of tables with the label of the working mode."""

MODE_COLUMNS = (ASSEMBLY, WORKING)
"""Columns of tables that say to which mode a row belongs."""


_MEETING_MODES = re.compile(r"[0-9]+(\+[0-9]+)+")
"""Text of a row that belongs to several assembly modes, such as ``0+1``."""


class TableMode(NamedTuple):
    """The mode to which rows of a result table belong.

    An example is an assembly mode (way to assemble the mechanism).

    Attributes
    ----------
    column
        Name of the column that tells the modes apart, one of `MODE_COLUMNS`.
    label
        The value in this column for the mode, as a text.
    """

    column: str
    label: str


NO_TABLE_MODE = TableMode("", "")
"""Stands for the mode of rows in a table that has no modes."""

FiguresByMode = Mapping[str, Mapping[TableMode, float]]
"""Figures of merit by their names, and each of them by the mode of the table."""

NAN = float("nan")
"""A figure that does not exist."""


class RunTable(NamedTuple):
    """A result table from the analysis of one design (choice of sizes).

    Attributes
    ----------
    stem
        Name of the file of the table, without the ending.
    table
        Names, units and meanings of the columns.
    data
        The columns.
    """

    stem: str
    table: Table
    data: TableArrays


class DesignRuns:
    """Runs many designs and computes figures of merit from the tables of the runs.

    A figure of merit is a number that rates a design. Any analysis of any mechanism is
    possible. Figures of a kernel, a function that evaluates many designs at once, can be
    added. Runs give numbers to assembly modes, whereas kernels identify them by the signs
    of dyads. If a mode of the run and a mode of the kernel are certainly the same, their
    figures share a row. Other modes have rows of their own.

    Parameters
    ----------
    document
        The mechanism file whose numbers are varied.
    study
        The study by which each design is run.
    variables
        The numbers that are varied.
    merits
        The figures of merit that are computed from tables.
    analyses
        The analyses of each run.
    tables
        Whether all tables of the runs are to be returned.
    kernel_evaluator
        Computes figures of merit without runs; None if there are none.

    Attributes
    ----------
    units
        Units of the columns of tables: by the name of the figure of merit that uses the
        table, then by the name of the column.
    names
        Names of all figures of merit, and with `tables` the column `assembly_mode`.

    Raises
    ------
    DesignError
        If a figure refers to an unknown table or column.
    """

    kernel = None  # No kernel computes all figures.

    def __init__(
        self,
        document: Document,
        study: Study,
        variables: Sequence[DesignVariable],
        merits: Sequence[FigureOfMerit],
        analyses: Analyses,
        tables: bool,
        kernel_evaluator: DesignEvaluator | None,
    ) -> None:
        """Prepare the runs of analyses for many designs, and check the figures of merit.

        A design is one choice of the sizes of a mechanism. A figure of merit is a number
        that rates it.

        Parameters
        ----------
        document, study
            The mechanism file, and the study: samples and options of the run of each
            design.
        variables
            The numbers of the file that differ from design to design.
        merits
            The figures that need a run: each reduces a column of a table of the run.
        analyses
            The analyses of each run.
        tables
            Whether the caller wants the tables of the runs.
        kernel_evaluator
            Computes the figures of merit that need no run, for many designs at once. They
            are not in `merits`. None if there are no such figures.

        Raises
        ------
        DesignError
            If the table or a column of a figure does not exist.
        """
        self.document = document
        self.study = study
        self.variables = variables
        self.merits = merits
        self.analyses = analyses
        self.tables = tables
        self.kernel_evaluator = kernel_evaluator
        # For each figure, the units of the columns in the table that it reduces.
        self.units = {merit.name: _column_units(merit, analyses, study) for merit in merits}
        self._require_columns()
        # Names of the figures that need no run.
        self._kernel_names = kernel_evaluator.figures.names if kernel_evaluator else []
        # Names of the columns of numbers in the table of designs: all figures, and with
        # `tables` the number of the assembly mode (way to assemble the mechanism).
        self.names = self._list_number_columns()

    def _require_columns(self) -> None:
        """Raise `DesignError` if a figure of merit uses a column that its table lacks."""
        for merit in self.merits:
            # A figure is a reduction of an expression in columns, such as max(size / 2).
            # Parsing it checks the names of the columns.
            merit.parsed(self.units[merit.name])

    def _list_number_columns(self) -> list[str]:
        """Return the names of the columns of numbers in the table of designs.

        The table has a row for each assembly mode of each design. Its columns are the
        figures of merit. If the tables of the runs are requested too, there is a column
        with the number of the assembly mode. The tables of the runs have the same column,
        so that the rows of a design in a mode can be found in them.
        """
        run_names = list(self.units)  # figures that are computed from tables of the run
        names = [*self._kernel_names, *run_names]
        if self.tables:
            names.append(ASSEMBLY)
        return names

    def grashof_classes(self, values: Floats) -> NDArray[np.str_] | None:
        """Return the Grashof classes (n,) of designs (variables, n), such as crank-rocker.

        None if the mechanism is not a four-bar, or if no kernel, a function that evaluates
        many designs at once, covers its designs.
        """
        if self.kernel_evaluator is None:
            return None
        return self.kernel_evaluator.grashof_classes(values)

    def part_size(self, count: int) -> int:
        """Return how many of `count` designs a part of a sweep should have."""
        return min(count, SINGLE_DESIGN_PART_SIZE)

    def evaluate(self, values: Floats) -> DesignTable:
        """Return the figures of merit of designs (variables, n), in units of the file."""
        return DesignTable.join_by_design(
            [design_table for design_table, _ in self.run_designs(values)], self.names
        )

    def run_designs(
        self,
        values: Floats,
        is_needed: Callable[[Floats, DesignTable], bool] | None = None,
    ) -> Iterator[tuple[DesignTable, tuple[RunTable, ...]]]:
        """Run the analyses of designs, one design after the other.

        A design is one choice of the sizes. Some figures of merit (numbers that rate a
        design) need no run. If there are any, a kernel (function for many designs at once)
        computes them for all designs before the first run.

        Parameters
        ----------
        values
            (variables, n) values of the design variables, in the units of the mechanism
            file.
        is_needed
            Function that returns whether a design is run. Its arguments are the values
            (variables,) of the design, and the table rows of the design with the figures
            from the kernel. Without a kernel, or without this function, all designs are
            run.

        Yields
        ------
        design_table
            The rows of a design, one for each assembly mode, with all figures of merit.
        tables
            The tables of its run. Empty if they are not requested or the run failed.
        """
        kernel_table = None
        if self.kernel_evaluator is not None:
            kernel_table = self.kernel_evaluator.evaluate(values)
        for number, design in enumerate(values.T):
            kernel_rows = None
            if kernel_table is not None:
                kernel_rows = kernel_table.rows(kernel_table.design == number)
                if is_needed is not None and not is_needed(design, kernel_rows):
                    continue
            tables: tuple[RunTable, ...] = ()
            try:
                if kernel_rows is not None and np.all(kernel_rows.status == IMPOSSIBLE):
                    raise DesignError(kernel_rows.reason[0])
                run = self.run_design(design)
                # Join the figures from the kernel with those from the run.
                table = self._join_run(kernel_rows, run)
                if self.tables:
                    tables = _tables_of_run(run)
            except SpherekitError as problem:
                # The design is impossible, or its run failed.
                table = self._join_failure(kernel_rows, problem)
            yield replace(table, design=np.full(len(table.design), number)), tables

    def run_design(self, values: Floats) -> RunResult:
        """Run the analyses of one design (choice of sizes).

        Parameters
        ----------
        values
            (variables,) values of the design variables, in the units of the file.

        Returns
        -------
        The run, in which all analyses have succeeded.

        Raises
        ------
        SpherekitError
            If the design is impossible, or one of its analyses fails.
        """
        # The study of this design: the same samples and inputs, with another mechanism.
        mechanism = make_design(self.document, self.variables, values)
        mechanism = mechanism.with_inputs(*self.study.mechanism.input_pairs)
        study = replace(self.study, mechanism=mechanism)
        run = run_study(study, self.analyses, Execution())
        # A run does not raise the errors of its analyses. The first one is raised here.
        if run.failures:
            raise AnalysisError(next(iter(run.failures.values())))
        return run

    def _join_failure(
        self, kernel_rows: DesignTable | None, problem: SpherekitError
    ) -> DesignTable:
        """Return the rows of a design whose run failed, with the reason.

        A design is one choice of the sizes, and a figure of merit is a number that rates
        it. Figures from the run are NaN here. Figures that a kernel (function for many
        designs at once) has computed before the run stay. If the kernel has already stated
        a reason for failure, this reason stays, too.

        Parameters
        ----------
        kernel_rows
            The rows of this design from the kernel, None without a kernel.
        problem
            The error that ended the run.
        """
        failure = failed_design(problem, self.names)
        if kernel_rows is None:
            return failure
        table = self._add_missing_figures(kernel_rows)
        if np.any(kernel_rows.status != OK):
            # The kernel found that the design is impossible or cannot be assembled.
            return table
        # All assembly modes (ways to assemble the mechanism) get the failure of the run.
        count = len(kernel_rows.design)
        status = np.repeat(failure.status, count)
        reason = np.repeat(failure.reason, count)
        return replace(table, status=status, reason=reason)

    def _add_missing_figures(self, kernel_rows: DesignTable) -> DesignTable:
        """Return rows that a kernel has computed, with NaN for the figures of the run."""
        # There are no tables of the run, so no row belongs to a mode of a table.
        modes = [NO_TABLE_MODE] * len(kernel_rows.design)
        return self._add_figures(kernel_rows, modes, figures={})

    def _join_run(self, kernel_rows: DesignTable | None, run: RunResult) -> DesignTable:
        """Return the rows of a design with figures of its run and of the kernel.

        The kernel, a function that evaluates many designs at once, has computed some
        figures of merit of this design before the run. The others follow from tables of the
        run. Each row is an assembly mode: one way in which the links are put together. The
        run numbers the modes, the kernel labels them by signs. A mode that is certainly the
        same in both has one row with the figures of both; each other mode has its own row.

        Parameters
        ----------
        kernel_rows
            The rows of this design that the kernel has computed, None without a kernel.
        run
            The run of this design.
        """
        # A mode of the run has a row if it has figures, or if the tables are requested. If
        # no mode has a row, there is one row for all modes.
        figures = {merit.name: self._reduce_by_mode(run, merit) for merit in self.merits}
        assembly_modes = {
            str(mode["number"]): mode for mode in run.summary.get("assembly_modes", ())
        }
        modes_with_figures = set[TableMode]().union(*figures.values()) - {NO_TABLE_MODE}
        modes_of_run = {TableMode(ASSEMBLY, number) for number in assembly_modes}
        shown = modes_with_figures | modes_of_run if self.tables else modes_with_figures
        modes = sorted(shown, key=lambda mode: mode.label) or [NO_TABLE_MODE]
        labels = [mode.label for mode in modes]

        # Find the modes of the run that are modes of the kernel, too.
        mode_by_kernel_row = dict[int, TableMode]()
        if kernel_rows is not None:
            kernel_row_by_mode = {
                mode: self._find_kernel_row(kernel_rows, mode, assembly_modes)
                for mode in modes
            }
            mode_by_kernel_row = {
                row: mode for mode, row in kernel_row_by_mode.items() if row is not None
            }
            # Other modes of the run get separate rows, if they have figures.
            modes = [
                mode
                for mode, row in kernel_row_by_mode.items()
                if row is None and mode in modes_with_figures
            ]
            labels = [_label_beside_kernel(mode) for mode in modes]

        # Make the rows of modes that only the run has.
        closes = [
            _closing_fraction(assembly_modes[mode.label]["status"])
            if mode in modes_of_run
            else NAN
            for mode in modes
        ]
        run_rows = DesignTable.from_columns(
            design=np.zeros(len(modes)),
            merits=(),
            mode=labels,
            is_working_mode=[mode.column == WORKING for mode in modes],
            closes=closes,
            claim=_claim_of_search(run),
        )
        run_rows = self._add_figures(run_rows, modes, figures)
        if kernel_rows is None:
            return run_rows

        # Add the figures of the run to the rows of the kernel.
        kernel_modes = [
            mode_by_kernel_row.get(row, NO_TABLE_MODE)
            for row in range(len(kernel_rows.design))
        ]
        kernel_rows = self._add_figures(kernel_rows, kernel_modes, figures)
        return DesignTable.concatenate([kernel_rows, run_rows])

    def _add_figures(
        self, rows: DesignTable, modes: Sequence[TableMode], figures: FiguresByMode
    ) -> DesignTable:
        """Add the figures of merit from a run to the rows of a design.

        A figure of merit is a number that rates a design. A kernel (function for many
        designs at once) may have computed some figures before. The others come from the
        result tables of the run, the analysis of this design.

        Parameters
        ----------
        rows
            The n rows of a design, one for each mode.
        modes
            (n,) the mode of the run to which each row belongs, or `NO_TABLE_MODE`. A mode
            is an assembly mode (way to assemble the mechanism), or a working mode (way to
            assemble it at a fixed pose of the output).
        figures
            The figures of the run, by name and then by mode. A figure that a mode does not
            have is NaN in its row.
        """
        # Rows that no kernel has computed get NaN for the figures of the kernel.
        merits = {name: nans(len(modes)) for name in self._kernel_names} | dict(rows.merits)
        # The keys of `units` are the names of all figures of the run.
        for name in self.units:
            figure_by_mode = figures.get(name, {})
            # A figure follows from a result table of the run. If this table has no column
            # that states the mode of each row, there is a single figure for all modes, with
            # the key `NO_TABLE_MODE`.
            common_figure = figure_by_mode.get(NO_TABLE_MODE, NAN)
            merits[name] = np.array(
                [figure_by_mode.get(mode, common_figure) for mode in modes]
            )
        # The tables of the run are stored in other files, in which an assembly mode has a
        # number. The number links the rows of this table to those files. For a working mode
        # the number is NaN.
        if self.tables:
            merits[ASSEMBLY] = np.array([_assembly_number(mode) for mode in modes])
        return replace(rows, merits=merits)

    def _find_kernel_row(
        self, kernel_rows: DesignTable, mode: TableMode, assembly_modes: Facts
    ) -> int | None:
        """Return the index of the kernel row with the same assembly mode, or None.

        Figures of merit (numbers that rate a design) come from a run and from a kernel
        (function for many designs at once). The figures of both are joined in one row for
        each assembly mode (way to assemble the mechanism). The run and the kernel may label
        a mode differently, so modes are matched by the signs of their dyads. A dyad is two
        links with three R pairs, and its sign is the way in which it is assembled.

        The result is None if no row matches, or if there are no signs to compare:

        - The mode is a working mode (way to assemble the mechanism at a fixed pose of the
          output). Working modes have no signs of dyads.
        - The rows of the run belong to no known assembly mode.
        - The kernel numbers its modes and has no signs.
        - The kernel replaces contacts by links. The signs of these links do not occur in
          the run.

        Parameters
        ----------
        kernel_rows
            Rows of the design from the kernel.
        mode
            A mode of the run of the same design.
        assembly_modes
            The modes of the run as in its summary, by their numbers. For each mode, the key
            "mode" has the text of its signs, such as "+-".
        """
        if mode.column != ASSEMBLY or mode.label not in assembly_modes:
            return None
        evaluator = self.kernel_evaluator
        if evaluator is None or not evaluator.has_signs_of_runs:
            return None
        signs = str(assembly_modes[mode.label]["mode"])
        # The kernel labels a mode by its signs, such as "+-", or also by its number, such
        # as "0 +-".
        possible_labels = [signs, f"{mode.label} {signs}"]
        is_match = np.isin(kernel_rows.mode.astype(str), possible_labels)
        matching_rows = np.flatnonzero(is_match)
        return matching_rows[0] if len(matching_rows) == 1 else None

    def _reduce_by_mode(
        self, run: RunResult, merit: FigureOfMerit
    ) -> dict[TableMode, float]:
        """Compute a figure of merit from a table of a run, for each mode in the table.

        A figure of merit is a number that rates a design, such as the maximum of a column.
        Rows of one mode, such as one assembly mode (way to assemble the mechanism), have
        the same value in one of the `MODE_COLUMNS`.

        Returns
        -------
        The figure by mode. The only key is `NO_TABLE_MODE` if the table has no such column.
        Rows at which assembly modes meet, with a text such as ``0+1``, count for each.
        """
        rows = run.frame(*merit.of_table)
        # Conditions of the user select rows, such as those of one pair (joint).
        for column, value in merit.only:
            rows = rows[rows[column].astype(str) == value]
        for column in MODE_COLUMNS:
            if column in rows:
                rows_by_label = _row_numbers_by_label(rows[column].astype(str))
                return {
                    TableMode(column, label): self._reduce_rows(merit, rows.iloc[numbers])
                    for label, numbers in rows_by_label.items()
                }
        return {NO_TABLE_MODE: self._reduce_rows(merit, rows)}

    def _reduce_rows(self, merit: FigureOfMerit, rows: "pd.DataFrame") -> float:
        """Compute a figure of merit from the rows of one mode in a table.

        A figure of merit is a number that rates a design. An expression of columns is
        evaluated in each row. Its values are reduced to one number, such as their maximum.
        Some reductions need the inputs. For example "at" returns the value at a certain
        input.

        Raises
        ------
        DesignError
            If a figure states another number of inputs than the table has, needs or returns
            an input that the table does not have, or needs one row of several at an input.
        """
        values = self._evaluate_expression(merit, rows)
        if _has_overflow(values, rows):
            # An overflow makes the figure infinite. Ignoring the row would give a finite
            # figure that looks correct.
            return np.inf
        inputs = self._inputs_of_rows(rows)  # (rows, inputs)
        input_count = inputs.shape[1]
        if merit.point and not self._input_columns(rows):
            raise DesignError(
                f"{merit.name}: at(EXPRESSION, Q) needs inputs: the table has no column of "
                "an input"
            )
        if merit.point and len(merit.point) != input_count:
            raise DesignError(
                f"{merit.name}: at(EXPRESSION, Q) needs {counted(input_count, 'input')} "
                f"Q, found {len(merit.point)}"
            )
        # The reduction "swing" is the difference of the largest and the smallest angle,
        # with full revolutions counted. It needs to know whether the path of samples
        # returns to its start. The angle may then swing on from the last sample to the
        # first one.
        is_closed_path = len(inputs) > 0 and return_after_revolutions(inputs[0], inputs[-1])
        # The reduction "at" uses only the row at the inputs that the user states. All
        # others use all rows.
        is_used = _are_rows_used(merit, inputs)
        if merit.point and SAMPLE.name in rows:
            samples = rows.loc[is_used, SAMPLE.name]
            # Samples of a grid can have this Q in common if the table lacks an input.
            lacks_inputs = input_count < len(self.study.mechanism.inputs)
            several = ""
            if samples.duplicated().any():
                several = "several for one sample"
            elif lacks_inputs and len(samples) > 1:
                several = "several, as it has one of the inputs"
            if several:
                raise DesignError(
                    f"{merit.name}: at(EXPRESSION, Q) needs one row at Q, but the table "
                    f"has {several}; select one by COLUMN=TEXT"
                )
        # "argmin" and "argmax" return a value of one input, which the user names. Other
        # reductions get the first input.
        index_of_input = self._index_of_input(merit, rows)
        figure = reduce_samples(
            merit.reduction,
            q=inputs[is_used, index_of_input],
            values=values[is_used, None],
            is_closed_path=is_closed_path,
        )
        return figure.item()

    def _evaluate_expression(self, merit: FigureOfMerit, rows: "pd.DataFrame") -> Floats:
        """Return the values of the expression of a figure of merit in the rows (n,)."""
        expression = merit.parsed(self.units[merit.name])
        columns = {name: rows[name].to_numpy(dtype=float) for name in expression.names}
        return np.broadcast_to(expression.evaluate(columns), len(rows))

    def _input_columns(self, rows: "pd.DataFrame") -> list[str]:
        """Return the names of the columns of inputs that the table of a run has, if any.

        The column is ``q`` if there is one input. With several inputs there is a column
        ``q_PAIR`` for each.
        """
        pairs = [item.pair for item in self.study.mechanism.inputs]
        names = ["q", *(f"q_{pair}" for pair in pairs)]
        return [name for name in names if name in rows]

    def _inputs_of_rows(self, rows: "pd.DataFrame") -> Array:
        """Return the inputs (rows, inputs); without inputs the row numbers (rows, 1)."""
        names = self._input_columns(rows)
        if not names:
            return np.arange(len(rows))[:, None]
        return rows[names].to_numpy(dtype=float)

    def _index_of_input(self, merit: FigureOfMerit, rows: "pd.DataFrame") -> int:
        """Return the index of the input whose values are passed to the reduction.

        The index counts the columns of inputs in the table (`_input_columns`). The
        reductions "argmin" and "argmax" return the value of an input where an expression is
        smallest or largest. With several inputs the user names the driven pair of this
        input, which is stored as `place`. If the table has only one column of inputs, and
        for other reductions, the index is 0.

        Raises
        ------
        DesignError
            If the figure is the value of an input that the table does not have, or of one
            of several inputs without a name.
        """
        names = self._input_columns(rows)
        named_column = f"q_{merit.place}"
        if named_column in names:
            return names.index(named_column)
        if REDUCTION_BY_NAME[merit.reduction].returns_input:
            fault = ""
            has_several_inputs = len(self.study.mechanism.inputs) > 1
            if not names:
                fault = "the table has no column of an input"
            elif merit.place and has_several_inputs:
                fault = f"the table has no column {named_column}"
            elif len(names) > 1:
                fault = "name the input whose value you need"
            if fault:
                raise DesignError(
                    f"{merit.name}: {merit.reduction} returns an input: {fault}"
                )
        return 0


def _row_numbers_by_label(labels: "pd.Series[str]") -> dict[str, list[int]]:
    """Return the numbers of the rows of each mode, by the label of the mode.

    `labels` (rows,) are the texts of the column of modes. Working modes have other texts
    than the ``0+1`` of rows at which the assembly modes 0 and 1 meet.
    """
    numbers: dict[str, list[int]] = {}
    for number, text in enumerate(labels):
        is_meeting = _MEETING_MODES.fullmatch(text) is not None
        for label in text.split("+") if is_meeting else [text]:
            numbers.setdefault(label, []).append(number)
    return numbers


def _are_rows_used(merit: FigureOfMerit, inputs: Array) -> Bools:
    """Return a mask (rows,) of the rows of a table that a figure of merit uses.

    The reduction "at" takes the value at the inputs `point`, so it uses only the row of
    these inputs. All other reductions use all rows. `inputs` (rows, inputs) are the inputs
    (rad) of the rows.
    """
    if not merit.point:
        return np.ones(len(inputs), bool)
    return max_abs(inputs - merit.point, axis=1) < SAME_ANGLE_RAD


def _has_overflow(values: Floats, rows: "pd.DataFrame") -> bool:
    """Return whether a value is NaN because a number in its row is too large for float64.

    Parameters
    ----------
    values
        (n,) values of an expression in the rows.
    rows
        The rows of a table, which may have a column ``status``.
    """
    if "status" not in rows:
        return False
    overflows = rows["status"] == Status.OVERFLOW.name
    return bool(np.any(np.isnan(values) & overflows))


def _assembly_number(mode: TableMode) -> float:
    """Return the number of an assembly mode in a run, or NaN for another kind of mode.

    Rows of no known assembly mode have an empty label, so the number is NaN.
    """
    if mode.column != ASSEMBLY or not mode.label.isdigit():
        return NAN
    return float(mode.label)


def _label_beside_kernel(mode: TableMode) -> str:
    """Return a label, such as "run 2", of an assembly mode that only a run has found.

    The other modes in the table were computed by a kernel (function of many designs), which
    labels them by signs or numbers. The prefix "run" shows that this mode is none of them.
    """
    prefix = RUN_MODE_PREFIX if mode.column == ASSEMBLY else WORKING_MODE_PREFIX
    return f"{prefix} {mode.label}"


def _claim_of_search(run: RunResult) -> str:
    """Return what the search of a run guarantees about its modes, or an empty text."""
    search = str(run.summary.get("search", ""))
    if MOTION not in run.results or ":" not in search:
        return ""
    claim, _, _ = search.partition(":")
    return claim


def _tables_of_run(run: RunResult) -> tuple[RunTable, ...]:
    """Return all tables of a run."""
    tables_by_analysis = {name: result.tables for name, result in run.results.items()}
    return tuple(
        RunTable(stem, table, run.results[analysis].data[table.name])
        for stem, (analysis, table) in tables_by_file_stem(tables_by_analysis).items()
    )


def _column_units(merit: FigureOfMerit, analyses: Analyses, study: Study) -> Units:
    """Return the units of all numeric columns in the table that a figure of merit uses.

    The caller needs the names and units to parse the expression of the figure.

    A figure of merit (number that rates a design) is a text such as ``max(workspace.areas
    part=whole: size)``. It names an analysis and one of its tables. Then come conditions
    that select rows (`only`), and an expression in the columns of the table. The reductions
    ``argmin`` and ``argmax`` give the value of an input where the expression is smallest or
    largest. Their second argument can name the driven pair of this input (`place`).

    Raises
    ------
    DesignError
        If there is no such table, if it lacks a column by which the figure selects rows, or
        if the figure asks for the value of a pair that is not driven.
    """
    analysis, table = merit.of_table
    # Quantities of the table "motion" are used without naming a table, as in
    # ``max(theta_41)``.
    if analysis == MOTION:
        raise DesignError(
            f"{merit.name}: {analysis}.{table}: {analysis} is not an analysis; write "
            "ANALYSIS.TABLE, or, for quantities of the motion, the expression alone"
        )
    if merit.place not in ("", *study.mechanism.input_pairs):
        raise DesignError(
            f"{merit.name}: the second argument of {merit.reduction} has to name a driven "
            f"pair, found {merit.place}. Driven pairs: "
            f"{listing(study.mechanism.input_pairs)}"
        )
    (chosen,) = (candidate for candidate in analyses if candidate.name == analysis)
    # The columns depend on the mechanism, such as one column for each input.
    tables = {
        candidate.name: candidate.of(study.mechanism)
        for candidate in chosen.requested_tables()
    }
    if table not in tables:
        raise DesignError(
            f'{merit.name}: the analysis {analysis} has no table "{table}"'
            f"{choices(table, tables, 'Its tables')}"
        )
    columns = tables[table].columns
    names = [column.name for column in columns]
    for column, _ in merit.only:
        if column not in names:
            raise DesignError(
                f"{merit.name}: {analysis}.{table} has no column {column}; its columns: "
                f"{listing(names)}"
            )
    return {column.name: column.unit for column in columns if column.kind == "number"}


def _closing_fraction(count_by_status: Mapping[str, int]) -> float:
    """Return the fraction of samples at which the loops close in an assembly mode.

    Parameters
    ----------
    count_by_status
        Number of samples of each status.
    """
    total = sum(count_by_status.values())
    closing = (Status.OK, Status.AT_SINGULARITY)
    closed = sum(count_by_status.get(status.name, 0) for status in closing)
    return closed / total if total else NAN
