"""The result of a run in memory, and how it is written to a folder."""

import copy
import json
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, overload

import numpy as np

from spherekit.argument_validation import checked
from spherekit.conventions import Facts
from spherekit.errors import AnalysisError, OutputError
from spherekit.escaping import html_text
from spherekit.markup import html_list, html_table
from spherekit.runs.analysis_faults import describe_failed_rows, describe_failure
from spherekit.runs.run_cost import TABLES
from spherekit.runs.run_folder import (
    FILE_BYTES,
    FINISHED,
    SIGNATURE,
    SUMMARY,
    RunFolder,
    sign_summary,
)
from spherekit.runs.table_store import TableStore
from spherekit.storage.atomic_write import make_folder, write_bytes
from spherekit.tables.table import (
    COLUMNS,
    DTYPE_BY_KIND,
    Declared,
    Table,
    TableArrays,
)
from spherekit.tables.table_formats import TABLE_FORMATS, Format, choose_formats, is_csv
from spherekit.tables.table_rows import MemoryTables, split_into_chunks
from spherekit.wording import choices, counted, listing, size_text, with_units

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

MOTION = "motion"
"""Name of the table with the configurations, which every run writes."""

NOTEBOOK_ROWS = 5
"""Number of rows of each table that are shown in a notebook."""

TEXT_CODE_TYPE = np.int32
"""Type of the numbers that stand for texts in memory, by which their size is estimated."""

MAX_LISTED_COLUMNS = 20
"""Number of columns of a table that messages list."""

Columns = Literal[1, 2]
"""Number of columns of a journal over which a figure extends."""


@dataclass(frozen=True)
class AnalysisResult:
    """The tables of one analysis.

    Attributes
    ----------
    name
        Name of the analysis.
    tables
        The declared tables: names, units and meanings of their columns.
    data
        The columns of each table, by name of the table. If the run wrote to a folder, a
        column is read from the Parquet file each time it is used. If the run stored no
        tables, or its folder has no Parquet files, the mapping is empty.
    """

    name: str
    tables: tuple[Table, ...]
    data: Mapping[str, TableArrays]


@dataclass(frozen=True)
class RunResult:
    """The tables of all analyses of a run, its failures and its summary.

    Attributes
    ----------
    results
        The tables by the name of their analysis.
    failures
        The reasons why analyses failed, by their names.
    summary
        Versions, hashes, tolerances, reached errors and times, as data for JSON.
    files
        Files that a run with a folder has written.
    views
        Creates figures and recordings (files for the viewer).
    """

    results: Mapping[str, AnalysisResult]
    failures: Mapping[str, str] = field(default_factory=dict)
    summary: Facts = field(default_factory=dict)
    files: tuple[Path, ...] = ()
    views: Any = field(default=None, compare=False)

    def __repr__(self) -> str:
        table_names = []
        for name, result in self.results.items():
            for number, table in enumerate(result.tables):
                table_names.append(f"{name}/{table.name}" if number else name)
        failures = f"; failed: {listing(self.failures)}" if self.failures else ""
        return (
            f"<RunResult of {self.summary.get('mechanism')}: tables "
            f"{listing(table_names)}{failures}>"
        )

    def _repr_html_(self) -> str:
        """Return the first rows of all tables, the findings and the failures as HTML.

        Notebooks show this text for a result.
        """
        # The text of `repr` is "<RunResult of ...>". Its angle brackets are removed.
        title = repr(self)[1:-1]
        parts = [f"<p>{html_text(title)}</p>"]
        for name, result in self.results.items():
            for table in result.tables:
                if table.name in result.data:
                    parts.append(_first_rows_html(name, table, result.data[table.name]))
        findings = []
        # The sentence under "search" says how the assembly modes (ways to assemble the
        # mechanism) were found. A run that computes no motion has none.
        if self.summary.get("assembly_modes"):
            findings.append(str(self.summary["search"]))
        findings += map(str, self.summary.get("remarks", ()))
        failures = [
            describe_failure(name, reason) for name, reason in self.failures.items()
        ]
        parts += [
            html_list("Found", findings),
            html_list("Warnings", self.summary.get("warnings", ())),
            html_list("Failed", failures + describe_failed_rows(self.summary)),
        ]
        return "".join(parts)

    @checked(AnalysisError)
    def frame(
        self,
        analysis: str | None = None,
        table: str | None = None,
        degrees: bool = False,
    ) -> "pd.DataFrame":
        """Return a table as a pandas frame.

        Parameters
        ----------
        analysis
            Name of the analysis, or ``"motion"`` for the configurations. By default the
            first analysis of the run.
        table
            Name of the table. By default the first table of the analysis.
        degrees
            Whether angles, their rates and accelerations are in degrees instead of rad.

        Raises
        ------
        AnalysisError
            If there is no such result, the analysis failed, or no tables were kept.
        FileError
            If the run wrote to a folder, and the file there is missing, damaged or
            replaced.
        """
        from spherekit.tables.table_files import to_frame

        # The summary has failed analyses too.
        analysis_names = [item["name"] for item in self.summary.get("analyses", ())]
        analysis_names += [item for item in self.results if item != MOTION]
        default_name = analysis_names[0] if analysis_names else MOTION
        name = default_name if analysis is None else analysis
        if name in self.failures:
            raise AnalysisError(describe_failure(name, self.failures[name]))
        if name not in self.results:
            raise AnalysisError(
                f'this run has no result "{name}"{choices(name, self.results, "Results")}'
            )
        result = self.results[name]
        if not result.tables:
            raise AnalysisError(
                f"{name} has no table in this run; a run computes the motion only if an "
                "analysis reads it, such as poles"
                if name == MOTION
                else f"{name} has no table in this run"
            )
        tables = {item.name: item for item in result.tables}
        table_name = result.tables[0].name if table is None else table
        if table_name not in tables:
            raise AnalysisError(
                f'{name} has no table "{table_name}"{choices(table_name, tables, "Tables")}'
            )
        return to_frame(tables[table_name], self._columns_of(name, table_name), degrees)

    def _columns_of(self, analysis: str, table: str) -> TableArrays:
        """Return the columns of a table; an `AnalysisError` says if they were not kept."""
        data = self.results[analysis].data
        if table not in data:
            raise AnalysisError(
                "this run kept no tables that can be read; run it with tables=True, or "
                "write Parquet files to a folder"
            )
        return data[table]

    @checked(OutputError)
    def save(self, path: str | Path) -> Path:
        """Write a recording for the viewer, and return its path.

        A recording contains more than the tables. The run is therefore repeated, unless
        `plot` or `show` has repeated it before.

        Raises
        ------
        OutputError
            If the path does not end in ``.rrd``, or cannot be written.

        Examples
        --------
        >>> import spherekit as sk
        >>> result = sk.run("four_bar", "poles", samples=19)
        >>> path = result.save("four_bar.rrd")
        """
        path = Path(path)
        if path.suffix != ".rrd":
            raise OutputError(
                f"{path}: a recording is a file named *.rrd; write tables to a folder with "
                "write(folder)"
            )
        # The views (figures and recordings) repeat the run when they are first used. Only
        # results of `spherekit.run` have views; for other results an error is raised.
        views = self._check_views(str(path))
        views.record(path)
        return path

    def show(self) -> None:
        """Show the drawings of the whole run (its recording) in a notebook.

        Results do not store drawings, because they are large. The first call therefore
        repeats the run, unless `plot` has repeated it before.

        Raises
        ------
        OutputError
            If the package rerun-notebook is not installed.
        """
        self._check_views("show").show()

    @overload
    def plot(
        self, x: None = None, y: None = None, *, degrees: bool = True, columns: Columns = 2
    ) -> Mapping[str, "Figure"]: ...

    @overload
    def plot(
        self,
        x: str,
        y: str | None = None,
        *,
        where: Mapping[str, Any] | None = None,
        table: str | None = None,
        degrees: bool = True,
        columns: Columns = 2,
    ) -> "Figure": ...

    @checked(AnalysisError)
    def plot(
        self,
        x: str | None = None,
        y: str | None = None,
        *,
        where: Mapping[str, Any] | None = None,
        table: str | None = None,
        degrees: bool = True,
        columns: Columns = 2,
    ) -> "Mapping[str, Figure] | Figure":
        """Return a figure of two columns of a table, a named figure, or all named figures.

        - ``plot("q", "theta_41")`` draws one column of a table against another one, with a
          curve for each assembly mode. If the table has several rows for each sample and
          mode, such as one for each pair of links, each subject has a panel.
        - ``plot("velocity coefficients")`` returns a figure that an analysis has prepared.
        - ``plot()`` returns all prepared figures, as a mapping by name.

        Prepared figures show data that tables do not contain. The first call for such a
        figure therefore repeats the run. The result keeps these data, so that further
        figures, `show` and `save` do not repeat the run again.

        Parameters
        ----------
        x
            Name of the column on the horizontal axis if `y` is given. Otherwise the name of
            a prepared figure, ``"analysis/subject"``, such as
            ``"poles/velocity coefficients"``. The subject is enough if only one figure has
            it. The name of the analysis is enough if the analysis has only one figure.
        y
            Name of the column on the vertical axis.
        where
            With `y`: the rows to draw, by column and value, such as
            ``{"link": "4", "relative_to": "1"}``. Angles are in degrees, or in rad with
            ``degrees=False``. By default all rows are drawn.
        table
            With `y`: the table that has both columns, by table name or as
            ``"analysis/table"``. By default it is the first table with both columns, and
            tables with rows of samples come before other tables.
        degrees
            Whether angles are in degrees instead of rad.
        columns
            Width of the figure in columns of a journal: 1 is 3.5 inches, 2 is 7.2 inches.

        Raises
        ------
        AnalysisError
            If there is no such figure or column. The message suggests a similar name.
        OutputError
            If matplotlib is not installed.

        Examples
        --------
        >>> import spherekit as sk
        >>> result = sk.run("four_bar", "poles", samples=91)
        >>> result.plot("velocity coefficients").savefig("coefficients.pdf")
        >>> figure = result.plot("q", "theta_41")
        >>> rocker = {"link": "4", "relative_to": "1"}
        >>> figure = result.plot("q", "velocity_coefficient", where=rocker)
        """
        views = self._check_views("plot")
        if x is not None and y is not None:
            name, shown_table = self._find_table([x, y], table)
            frame = _select_rows(
                self.frame(name, shown_table.name, degrees), shown_table, where or {}
            )
            titles = _mode_titles(self.summary)
            column_figure: Figure = views.column_figure(
                shown_table, frame, x, y, titles, degrees, columns
            )
            return column_figure
        if where or table or y is not None:
            raise AnalysisError(
                "plot: y, where and table have an effect only in a figure of two columns; "
                'give the columns x and y, such as plot("q", "theta_41")'
            )
        figures: Mapping[str, Figure] = views.figures(degrees, columns)
        return figures if x is None else figures[x]

    def _find_table(
        self, columns: Sequence[str], table_name: str | None
    ) -> tuple[str, Table]:
        """Return the first table that has the columns, with the name of its analysis.

        Parameters
        ----------
        columns
            Names of the columns.
        table_name
            Name of the table, or ``"analysis/table"``; None for any.

        Raises
        ------
        AnalysisError
            If a column is unknown or has no numbers, or no table has all columns.
        """
        candidates = [
            (name, declared)
            for name, result in self.results.items()
            for declared in result.tables
            if table_name in (None, declared.name, f"{name}/{declared.name}")
        ]
        # Tables with rows of samples give curves and come first. Among these the table of
        # configurations comes last, since a user more likely means a column of an analysis.
        candidates.sort(
            key=lambda candidate: (
                not candidate[1].in_assembly_modes,
                candidate[0] == MOTION,
            )
        )
        if not candidates:
            # The main table of an analysis has the name of the analysis.
            table_names = [
                declared.name if declared.name == name else f"{name}/{declared.name}"
                for name, result in self.results.items()
                for declared in result.tables
            ]
            raise AnalysisError(
                f'plot: this run has no table "{table_name}"'
                f"{choices(table_name, table_names, 'Tables')}"
            )
        kinds_by_table = [
            {column.name: column.kind for column in declared.columns}
            for _, declared in candidates
        ]
        known_columns = list(dict.fromkeys(chain.from_iterable(kinds_by_table)))
        for name in columns:
            if name not in known_columns:
                raise AnalysisError(
                    f'plot: no column is named "{name}"'
                    f"{choices(name, known_columns, 'Columns', MAX_LISTED_COLUMNS)}"
                )
        for (name, declared), kinds in zip(candidates, kinds_by_table, strict=True):
            if all(column in kinds for column in columns):
                for column in columns:
                    if kinds[column] not in ("number", "integer"):
                        raise AnalysisError(
                            f'plot: the column "{column}" of the table {declared.name} has '
                            "no numbers; use it in the argument where, to select rows"
                        )
                return name, declared
        owners_by_column = {
            column: [
                declared.name
                for (_, declared), kinds in zip(candidates, kinds_by_table, strict=True)
                if column in kinds
            ]
            for column in columns
        }
        places = "; ".join(
            f'"{column}" is in {listing(owners)}'
            for column, owners in owners_by_column.items()
        )
        raise AnalysisError(
            f"plot: no table has both columns: {places}. Join the frames of both tables by "
            "sample and assembly_mode, and draw them with matplotlib"
        )

    def _check_views(self, method: str) -> Any:
        """Return the views; an `OutputError` names the method if there are none."""
        if self.views is None:
            raise OutputError(
                f"{method}: only a result that spherekit.run returned can be shown"
            )
        return self.views

    @checked(OutputError)
    def write(
        self,
        folder: str | Path,
        degrees: bool = False,
        formats: Sequence[Format] | None = None,
    ) -> list[Path]:
        """Write all tables and `summary.json` to a folder, and return the paths.

        `columns.csv` and the summary contain the unit of each column. The files appear
        together when all of them are complete, in place of the files of an older run.

        Parameters
        ----------
        folder
            The folder. It is created if needed.
        degrees
            Whether angles, their rates and accelerations are in degrees. The heading of
            such a column is ``q [deg]``, for example.
        formats
            Formats of the tables. By default Parquet, and CSV up to 100 MB.

        Raises
        ------
        AnalysisError
            If no tables were kept.
        FileError
            If the run wrote to a folder, and a file there is missing, damaged or replaced.
        OutputError
            If the folder cannot be made or written, another run writes there or has left
            unfinished work, files there belong to no run, or the disk is full.
        """
        declared = {name: result.tables for name, result in self.results.items()}
        # The rows of each table in parts, by the name of its file without the ending.
        chunks_by_stem = {
            stem: split_into_chunks(table, self._columns_of(name, table.name))
            for stem, (name, table) in tables_by_file_stem(declared).items()
        }
        with RunFolder.open(folder) as run_folder:
            if run_folder.has_unfinished_work:
                raise OutputError(
                    f"{str(folder)!r}: there is unfinished work of a run; finish it with "
                    'unfinished="resume" first, or choose another folder'
                )
            paths, _ = write_results(
                run_folder, declared, chunks_by_stem, self.summary, degrees, formats
            )
            return paths


def _mode_titles(summary: Facts) -> dict[int, str]:
    """Return the titles of assembly modes by mode index, from the summary of a run."""
    titles: dict[int, str] = {}
    for mode in summary.get("assembly_modes", ()):
        label = mode.get("name") or mode["mode"]
        titles[mode["number"]] = f"Mode {mode['number']}" + (f" ({label})" if label else "")
    return titles


def _select_rows(
    frame: "pd.DataFrame", table: Table, where: Mapping[str, Any]
) -> "pd.DataFrame":
    """Return the rows of a table in which some columns have the values of `where`.

    Parameters
    ----------
    frame
        The rows.
    table
        The declaration of the table, with the names of its columns.
    where
        The value to look for in each column, by column name.

    Raises
    ------
    AnalysisError
        If a column is unknown, a value is a list or another collection, or no row is left.
    """
    names = [column.name for column in table.columns]
    for name, value in where.items():
        if name not in names:
            raise AnalysisError(
                f'plot: where: the table {table.name} has no column "{name}"'
                f"{choices(name, names, 'Columns', MAX_LISTED_COLUMNS)}"
            )
        if not np.isscalar(value):
            raise AnalysisError(
                f"plot: where: {name} is of type {type(value).__name__}; give one value, "
                "a number or a text"
            )
        rows = frame[frame[name] == value]
        if not len(rows):
            values = list(map(str, frame[name].unique()))
            raise AnalysisError(
                f"plot: where: no row has {name} = {value!r}"
                f"{choices(value, values, 'Values')}"
            )
        frame = rows
    return frame


def _first_rows_html(analysis: str, table: Table, data: TableArrays) -> str:
    """Return the first rows of a table as HTML, with the units of its columns."""
    columns = [data[column.name] for column in table.columns]
    units = {column.name: column.unit for column in table.columns}
    first_values = [values[:NOTEBOOK_ROWS].tolist() for values in columns]
    rows = zip(*first_values, strict=True)
    name = analysis if table.name == analysis else f"{analysis}/{table.name}"
    return html_table(
        with_units(units, units), rows, f"{name}: {counted(len(columns[0]), 'row')}"
    )


def tables_by_file_stem(declared: Declared) -> dict[str, tuple[str, Table]]:
    """Return the analysis and the table of each file, by the stem of the file.

    Each table is written to a separate file. The stem is the name of the file without its
    ending. The first table of an analysis is in the file that is named like the analysis.
    """
    tables_by_stem = {}
    for analysis, tables in declared.items():
        for number, table in enumerate(tables):
            stem = f"{analysis}_{table.name}" if number else analysis
            tables_by_stem[stem] = (analysis, table)
    return tables_by_stem


def _units_by_stem(declared: Declared, degrees: bool) -> Facts:
    """Return the unit of every column of tables by the stems of their files."""
    return {
        stem: table.units(degrees)
        for stem, (_, table) in tables_by_file_stem(declared).items()
    }


def make_result(
    declared: Declared,
    store: TableStore | None,
    run_folder: RunFolder | None,
    summary: Facts,
    degrees: bool,
    formats: Sequence[Format] | None,
) -> RunResult:
    """Return the result of a run, and write it first if there is a folder.

    Parameters
    ----------
    declared
        The declared tables, by name of the analysis.
    store
        The rows of the tables; None if the run stores no tables.
    run_folder
        The folder of the run; None without one.
    summary
        The summary of the run.
    degrees
        Whether files have angles in degrees.
    formats
        Formats of the files; None for the default.

    Raises
    ------
    OutputError
        If the disk is full. The folder then still has the results of an older run.
    """
    # Columns of tables, by analysis and then by table. They are read from Parquet files
    # when they are used, or they are in memory.
    files: list[Path] = []
    data: dict[str, dict[str, TableArrays]] = {name: {} for name in declared}
    # Columns in memory are in rad.
    summary = {**summary, "units": _units_by_stem(declared, degrees=False)}
    # Name of the analysis and table of each file, by the name of the file without ending.
    tables_by_stem = tables_by_file_stem(declared)
    if run_folder is not None and store is not None:
        from spherekit.tables.table_files import ParquetColumns

        # The rows of each table, in chunks of limited length.
        chunks_by_stem = {
            stem: store.pieces(name, table)
            for stem, (name, table) in tables_by_stem.items()
        }
        files, summary = write_results(
            run_folder, declared, chunks_by_stem, summary, degrees, formats
        )
        for stem, (name, table) in tables_by_stem.items():
            path = run_folder.path / f"{stem}.parquet"
            if path in files:
                # With an absolute path, processes with another working folder can read the
                # file too.
                data[name][table.name] = ParquetColumns(path.absolute(), table, degrees)
    elif isinstance(store, MemoryTables):
        for name, table in tables_by_stem.values():
            data[name][table.name] = store.table(name, table)
    results = {
        name: AnalysisResult(name, tuple(tables), data[name])
        for name, tables in declared.items()
    }
    return RunResult(results, summary=summary, files=tuple(files))


def write_results(
    folder: RunFolder,
    declared: Declared,
    chunks_by_stem: Mapping[str, Iterator[Mapping[str, Any]]],
    summary: Facts,
    degrees: bool,
    formats: Sequence[Format] | None,
) -> tuple[list[Path], Facts]:
    """Write the tables of analyses, and the summary with their names and the time.

    Parameters
    ----------
    folder
        The folder of the run.
    declared
        The tables by the name of their analysis.
    chunks_by_stem
        Their columns in chunks of rows, by the name of the file without ending.
    summary
        The summary of the run.
    degrees
        Whether files have angles in degrees.
    formats
        Formats of the files. By default Parquet, and CSV if the tables are small.

    Returns
    -------
    paths
        The written files.
    summary
        The summary as it was written.

    Raises
    ------
    OutputError
        If the disk is full; the folder then has what it had.
    """
    from spherekit.tables.table_files import format_column_list, write_table

    start = time.perf_counter()
    tables_by_stem = tables_by_file_stem(declared)
    # The summary may come from another folder. Facts about the files there are left out.
    summary = {
        name: value
        for name, value in summary.items()
        if name not in (SIGNATURE, "replaced_files")
    }
    summary["cost"] = copy.deepcopy(summary["cost"])
    cost_by_stem = summary["cost"]["tables"]
    for cost in cost_by_stem.values():
        for table_format in TABLE_FORMATS.values():
            cost.pop(f"{table_format.ending}_bytes", None)
    # The size of the tables decides whether CSV files are written by default.
    memory_bytes = 0
    for stem, (_, table) in tables_by_stem.items():
        for column in table.columns:
            # Each different text is stored once, and a cell has the index of its text.
            dtype = np.dtype(DTYPE_BY_KIND.get(column.kind, TEXT_CODE_TYPE))
            memory_bytes += dtype.itemsize * cost_by_stem[stem]["rows"]
    csv_bytes = TABLE_FORMATS["csv"].relative_size * memory_bytes
    written_formats = choose_formats(formats, csv_bytes)
    if formats is None and not any(is_csv(name) for name in written_formats):
        remark = (
            f"no CSV, which would take about {size_text(csv_bytes)}: ask for it with "
            '--format both (formats=["csv", "parquet"])'
        )
        summary = {**summary, "remarks": [*summary.get("remarks", ()), remark]}

    # The tables, the list of columns and the summary are written into a work folder. All
    # files are complete before any of them appears in the folder of the run.
    finished_folder = make_folder(folder.work / FINISHED)
    bytes_by_file: dict[str, int] = {}
    for stem, (analysis, table) in tables_by_stem.items():
        notes = {"analysis": analysis, "mechanism_hash": summary["mechanism_hash"]}
        file_names = write_table(
            finished_folder / stem,
            table,
            chunks_by_stem[stem],
            notes,
            degrees,
            written_formats,
        )
        for name in file_names:
            bytes_by_file[name] = (finished_folder / name).stat().st_size
            _, _, ending = name.rpartition(".")
            cost_by_stem[stem][f"{ending}_bytes"] = bytes_by_file[name]
    column_list = format_column_list(
        {stem: table for stem, (_, table) in tables_by_stem.items()},
        degrees,
        written_formats,
    )
    write_bytes(finished_folder / COLUMNS, column_list)
    bytes_by_file[COLUMNS] = len(column_list)
    summary["cost"]["seconds"][TABLES] = time.perf_counter() - start
    # Tables of an earlier run in the folder, which are removed or replaced.
    endings = tuple(f".{kind.ending}" for kind in TABLE_FORMATS.values())
    replaced = [
        name
        for name in folder.earlier_files()
        if name.endswith(endings) and name != COLUMNS
    ]
    if replaced:
        summary = {**summary, "replaced_files": replaced}
    written_summary = sign_summary(
        {
            **summary,
            "units": _units_by_stem(declared, degrees),
            "files": list(bytes_by_file),
            FILE_BYTES: bytes_by_file,
        }
    )
    text = json.dumps(written_summary, indent=2, ensure_ascii=False) + "\n"
    write_bytes(finished_folder / SUMMARY, text.encode())
    return folder.publish(), written_summary
