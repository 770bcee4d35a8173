"""What a run returns, and how it is written to a folder."""

import json
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, overload

import numpy as np

from spherekit.argument_validation import checked
from spherekit.conventions import Facts
from spherekit.errors import AnalysisError, OutputError
from spherekit.escaping import html_text
from spherekit.markup import html_list, html_table
from spherekit.runs.analysis_faults import failed, failed_rows
from spherekit.runs.run_cost import TABLES
from spherekit.runs.run_folder import (
    FILE_BYTES,
    FINISHED,
    SUMMARY,
    RunFolder,
    sign_summary,
)
from spherekit.runs.table_store import TableStore
from spherekit.storage.atomic_write import make_folder, write_bytes
from spherekit.tables.table import (
    COLUMNS,
    DTYPE_BY_KIND,
    FILE_SIZE,
    Declared,
    Format,
    Table,
    TableArrays,
    formats_of,
)
from spherekit.tables.table_rows import MemoryTables, split_into_chunks
from spherekit.wording import choices, counted, listing, size_text, with_units

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

MOTION = "motion"
FIRST_ROWS = 5
"""Of each table in the page of a notebook."""

Columns = Literal[1, 2]
"""Columns of a journal over which a figure goes."""


@dataclass(frozen=True)
class AnalysisResult:
    """The tables of one analysis, as declared arrays.

    Where the run wrote to a folder, columns are read from its Parquet files when asked
    for; a run that kept no tables has no `data`.
    """

    name: str
    tables: tuple[Table, ...]
    data: Mapping[str, TableArrays]


@dataclass(frozen=True)
class RunResult:
    """The tables of all analyses of a run, its failures and its summary.

    `summary` holds versions, hashes, tolerances, errors reached and times, ready for
    JSON. `failures` maps the name of an analysis that failed to the reason. `files`
    are those that a run with a folder has written, `views` makes figures and recordings.
    """

    results: Mapping[str, AnalysisResult]
    failures: Mapping[str, str] = field(default_factory=dict)
    summary: Facts = field(default_factory=dict)
    files: tuple[Path, ...] = ()
    views: Any = field(default=None, compare=False)

    def __repr__(self) -> str:
        tables = listing(
            name if table is result.tables[0] else f"{name}/{table.name}"
            for name, result in self.results.items()
            for table in result.tables
        )
        rest = f"; failed: {listing(self.failures)}" if self.failures else ""
        return f"<RunResult of {self.summary.get('mechanism')}: tables {tables}{rest}>"

    def _repr_html_(self) -> str:
        """Return the first rows of all tables, what was found, and what failed, as HTML."""
        parts = [f"<p>{html_text(repr(self)[1:-1])}</p>"]
        for name, result in self.results.items():
            for table in result.tables:
                if table.name in result.data:
                    parts.append(_first_rows(name, table, result.data[table.name]))
        claims = [self.summary["search"]] if self.summary.get("assembly_modes") else []
        said = [*claims, *self.summary.get("remarks", ())]
        why = [failed(name, reason) for name, reason in self.failures.items()]
        parts += [
            html_list("Found", list(map(str, said))),
            html_list("Warnings", self.summary.get("warnings", ())),
            html_list("Failed", why + failed_rows(self.summary)),
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
            Name of the analysis, or ``"motion"``; by default the first one asked for.
        table
            Name of its table; by default its main (first) one.
        degrees
            Whether angles are given in degrees instead of rad.

        Raises
        ------
        AnalysisError
            If there is no such result, the analysis failed, or no tables were kept.
        """
        from spherekit.tables.table_files import to_frame

        name = analysis or next((n for n in self.results if n != MOTION), MOTION)
        if name in self.failures:
            raise AnalysisError(failed(name, self.failures[name]))
        if name not in self.results:
            raise AnalysisError(
                f'this run has no result "{name}"{choices(name, self.results, "Results")}'
            )
        result = self.results[name]
        declared = {item.name: item for item in result.tables}
        wanted = table or result.tables[0].name
        if wanted not in declared:
            raise AnalysisError(
                f'{name} has no table "{wanted}"{choices(wanted, declared, "Tables")}'
            )
        return to_frame(declared[wanted], self._data(name, wanted), degrees)

    def _data(self, analysis: str, table: str) -> TableArrays:
        data = self.results[analysis].data
        if table not in data:
            raise AnalysisError(
                "this run kept no tables that can be read; let it keep them (tables=True), "
                "or write Parquet files to a folder"
            )
        return data[table]

    @checked(OutputError)
    def save(self, path: str | Path) -> Path:
        """Write a recording for the viewer, and return its path.

        The run is gone through once more, as a recording holds what tables do not, unless
        `plot` or `show` has done that.

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
                f"{path}: a recording is a file named *.rrd; tables go to a folder "
                "by write(folder)"
            )
        self._views(str(path)).record(path)
        return path

    def show(self) -> None:
        """Show the recording in the page of a notebook, all of it.

        The first time the run is gone through once more, unless `plot` has done that.

        Raises
        ------
        OutputError
            If the package rerun-notebook is not installed.
        """
        self._views("show").show()

    @overload
    def plot(
        self, subject: None = None, degrees: bool = True, columns: Columns = 2
    ) -> Mapping[str, "Figure"]: ...

    @overload
    def plot(
        self, subject: str, degrees: bool = True, columns: Columns = 2
    ) -> "Figure": ...

    @checked(AnalysisError)
    def plot(
        self, subject: str | None = None, degrees: bool = True, columns: Columns = 2
    ) -> "Mapping[str, Figure] | Figure":
        """Return figures for a paper, drawn by matplotlib from what the analyses show.

        The first time the run is gone through once more, as tables do not say what is to be
        seen; that is kept for further figures, `show` and `save`.

        Parameters
        ----------
        subject
            Name of a figure, ``"poles/velocity coefficients"``, or the part of it after
            the analysis, or the name of an analysis with one figure; by default a mapping
            of all by their names.
        degrees
            Whether angles are in degrees instead of rad.
        columns
            Over how many columns of a journal the figure goes: 3.5 or 7.2 inches.

        Raises
        ------
        AnalysisError
            If there is no such figure.
        OutputError
            If matplotlib is not installed.

        Examples
        --------
        >>> import spherekit as sk
        >>> result = sk.run("four_bar", "poles", samples=91)
        >>> result.plot("velocity coefficients").savefig("coefficients.pdf")
        """
        figures: Mapping[str, Figure] = self._views("plot").figures(degrees, columns)
        return figures if subject is None else figures[subject]

    def _views(self, what: str) -> Any:
        if self.views is None:
            raise OutputError(f"{what}: only what spherekit.run returns can be shown")
        return self.views

    @checked(OutputError)
    def write(
        self,
        folder: str | Path,
        degrees: bool = False,
        formats: Sequence[Format] | None = None,
    ) -> list[Path]:
        """Write every table, and `summary.json`; return the paths.

        By default as Parquet, and as CSV up to 100 MB.

        `columns.csv` and the summary say each column's unit. With `degrees` angles, their
        rates and accelerations are in degrees, and their columns are headed ``q [deg]``.

        The files appear together when all are complete, in place of those of an older
        run.

        Raises
        ------
        AnalysisError
            If no tables were kept.
        OutputError
            If the folder cannot be made or written, another run writes there or has left
            unfinished work, or the disk is full.
        """
        declared = {name: result.tables for name, result in self.results.items()}
        rows = {
            stem: split_into_chunks(table, self._data(name, table.name))
            for stem, (name, table) in stems(declared).items()
        }
        with RunFolder.open(folder) as place:
            if place.has_unfinished_work:
                raise OutputError(
                    f"{str(folder)!r}: there is unfinished work of a run; finish it with "
                    'unfinished="resume" first, or choose another folder'
                )
            written, _ = write_results(
                place, declared, rows, self.summary, degrees, formats
            )
            return written


def _first_rows(analysis: str, table: Table, data: TableArrays) -> str:
    """Return the first rows of a table as HTML, with the units of its columns."""
    columns = [data[column.name] for column in table.columns]
    units = {column.name: column.unit for column in table.columns}
    rows = zip(*(values[:FIRST_ROWS].tolist() for values in columns), strict=True)
    name = analysis if table.name == analysis else f"{analysis}/{table.name}"
    return html_table(
        with_units(units, units), rows, f"{name}: {counted(len(columns[0]), 'row')}"
    )


def stems(declared: Declared) -> dict[str, tuple[str, Table]]:
    """Return what files are called without their ending: whose, and of which table."""
    return {
        f"{name}_{table.name}" if number else name: (name, table)
        for name, tables in declared.items()
        for number, table in enumerate(tables)
    }


def _units(declared: Declared, degrees: bool) -> Facts:
    """Return the unit of every column of tables by the stems of their files."""
    return {stem: table.units(degrees) for stem, (_, table) in stems(declared).items()}


def result_of(
    declared: Declared,
    store: TableStore | None,
    place: RunFolder | None,
    summary: Facts,
    degrees: bool,
    formats: Sequence[Format] | None,
) -> RunResult:
    """Return the tables declared by name of analysis, written if there is a folder.

    Raises
    ------
    OutputError
        If the disk is full; the folder then has what it had.
    """
    files: list[Path] = []
    data: dict[str, dict[str, TableArrays]] = {name: {} for name in declared}
    summary = {**summary, "units": _units(declared, degrees=False)}
    by_stem = stems(declared)
    if place is not None and store is not None:
        from spherekit.tables.table_files import ParquetColumns

        rows = {stem: store.pieces(*key) for stem, key in by_stem.items()}
        files, summary = write_results(place, declared, rows, summary, degrees, formats)
        for stem, (name, table) in by_stem.items():
            path = place.path / f"{stem}.parquet"
            if path in files:
                # The absolute path is the same for processes that stand elsewhere.
                data[name][table.name] = ParquetColumns(path.absolute(), table, degrees)
    elif isinstance(store, MemoryTables):
        for name, table in by_stem.values():
            data[name][table.name] = store.table(name, table)
    results = {
        name: AnalysisResult(name, tuple(tables), data[name])
        for name, tables in declared.items()
    }
    return RunResult(results, summary=summary, files=tuple(files))


def write_results(
    folder: RunFolder,
    declared: Declared,
    rows: Mapping[str, Iterator[Mapping[str, Any]]],
    summary: Facts,
    degrees: bool,
    formats: Sequence[Format] | None,
) -> tuple[list[Path], Facts]:
    """Write the tables of analyses, and the summary with their names and the time.

    `rows` are their pieces by the stems of their files. Return the paths and that summary.

    Raises
    ------
    OutputError
        If the disk is full; the folder then has what it had.
    """
    from spherekit.tables.table_files import format_csv, write_table

    started = time.perf_counter()
    by_stem = stems(declared)
    cost = summary["cost"]["tables"]
    in_memory = sum(  # texts as numbers of words
        np.dtype(DTYPE_BY_KIND.get(column.kind, np.int32)).itemsize * cost[stem]["rows"]
        for stem, (_, table) in by_stem.items()
        for column in table.columns
    )
    csv = FILE_SIZE["csv"] * in_memory
    kinds = formats_of(formats, csv)
    if formats is None and "csv" not in kinds:
        left_out = (
            f"no CSV, which would take about {size_text(csv)}: ask for it with "
            '--format both (formats=["csv", "parquet"])'
        )
        summary = {**summary, "remarks": [*summary.get("remarks", ()), left_out]}
    made = make_folder(folder.work / FINISHED)
    sizes: dict[str, int] = {}
    for stem, (analysis, table) in by_stem.items():
        notes = {"analysis": analysis, "mechanism_hash": summary["mechanism_hash"]}
        for name in write_table(made / stem, table, rows[stem], notes, degrees, kinds):
            sizes[name] = (made / name).stat().st_size
            cost[stem][f"{name.rpartition('.')[2]}_bytes"] = sizes[name]
    columns = [
        (stem, column.header(degrees), column.stated_unit(degrees), column.meaning)
        for stem, (_, table) in by_stem.items()
        for column in table.columns
    ]
    headed = format_csv([("table", "column", "unit", "meaning"), *columns])
    write_bytes(made / COLUMNS, headed)
    sizes[COLUMNS] = len(headed)
    summary["cost"]["seconds"][TABLES] = time.perf_counter() - started
    units = _units(declared, degrees)
    written = sign_summary(
        {**summary, "units": units, "files": list(sizes), FILE_BYTES: sizes}
    )
    write_bytes(
        made / SUMMARY, (json.dumps(written, indent=2, ensure_ascii=False) + "\n").encode()
    )
    return folder.publish(), written
