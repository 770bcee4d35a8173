"""What a run returns, and how it is written to a folder."""

import json
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

from spherekit.analysis.cost import TABLES
from spherekit.analysis.tables import Table, TableData
from spherekit.conventions import listing, nearest
from spherekit.errors import AnalysisError

if TYPE_CHECKING:
    import pandas as pd

MOTION = "motion"


@final
@dataclass(frozen=True)
class AnalysisResult:
    """The tables of one analysis, as declared arrays."""

    name: str
    tables: tuple[Table, ...]
    data: Mapping[str, TableData]


@final
@dataclass(frozen=True)
class RunResult:
    """The tables of all analyses of a run, its failures and its summary.

    `summary` holds versions, hashes, tolerances, errors reached and times, ready for
    JSON. `failures` maps the name of an analysis that failed to its traceback.
    """

    results: Mapping[str, AnalysisResult]
    failures: Mapping[str, str] = field(default_factory=dict)
    summary: Mapping[str, Any] = field(default_factory=dict)

    @property
    def sizes(self) -> dict[str, tuple[int, int]]:
        """Rows and columns of every table, by the name its files have."""
        found = {}
        for name, result in self.results.items():
            for position, table in enumerate(result.tables):
                data = result.data[table.name]
                rows = len(next(iter(data.values()), ()))
                found[file_stem(name, position, table)] = (rows, len(data))
        return found

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
            If there is no such result, or the analysis failed.
        """
        from spherekit.analysis.frames import to_frame

        name = analysis or next((n for n in self.results if n != MOTION), MOTION)
        if name in self.failures:
            raise AnalysisError(f"{name} failed:\n{self.failures[name]}")
        if name not in self.results:
            raise AnalysisError(
                f'this run has no result "{name}"{nearest(name, self.results) or ";"} '
                f"Results: {listing(self.results)}"
            )
        result = self.results[name]
        declared = {item.name: item for item in result.tables}
        wanted = table or result.tables[0].name
        if wanted not in declared:
            raise AnalysisError(
                f'{name} has no table "{wanted}"{nearest(wanted, declared) or ";"} '
                f"Tables: {listing(declared)}"
            )
        return to_frame(declared[wanted], result.data[wanted], degrees)

    def write(self, folder: str | Path, degrees: bool = False) -> list[Path]:
        """Write every table as CSV and Parquet, and `summary.json`; return the paths.

        Each file appears complete or not at all.

        Raises
        ------
        OutputError
            If the folder cannot be made or written, or the disk is full.
        """
        from spherekit.analysis.frames import csv_bytes, parquet_bytes
        from spherekit.files.atomic import make_folder, write_bytes

        target = make_folder(folder)
        written: list[Path] = []
        cost, started = self.summary["cost"], time.perf_counter()
        for name, result in self.results.items():
            for position, table in enumerate(result.tables):
                frame = self.frame(name, table.name, degrees)
                stem = file_stem(name, position, table)
                notes = {
                    "analysis": name,
                    "mechanism_hash": self.summary["mechanism_hash"],
                }
                for suffix, data in (
                    ("csv", csv_bytes(frame)),
                    ("parquet", parquet_bytes(frame, notes)),
                ):
                    path = target / f"{stem}.{suffix}"
                    write_bytes(path, data)
                    written.append(path)
                    cost["tables"][stem][f"{suffix}_bytes"] = len(data)
        cost["seconds"][TABLES] = time.perf_counter() - started
        path = target / "summary.json"
        text = json.dumps(self.summary, indent=2, ensure_ascii=False)
        write_bytes(path, (text + "\n").encode())
        return [*written, path]


def file_stem(analysis: str, position: int, table: Table) -> str:
    """Return what the files of a table are called, without their ending."""
    return analysis if position == 0 else f"{analysis}_{table.name}"
