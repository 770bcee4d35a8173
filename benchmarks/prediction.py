"""How well a run predicts what it costs, from a few of its samples."""

import statistics
import tempfile
import time
from functools import partial
from unittest.mock import patch

from benchmarks.report import Cell, Section
from spherekit.analysis.cost import AXES, TABLES, Ledger
from spherekit.analysis.forecast import ENOUGH
from spherekit.analysis.run import run as run_analyses
from spherekit.files.library import shipped
from spherekit.files.read import load

QUICK = ("four_bar", "stephenson", "eight_bar_01", "twelve_bar")
STAGES = ("positions", AXES, TABLES)


def run(quick: bool) -> list[Section]:
    """Return the ratios of actual to predicted costs of shipped mechanisms."""
    names: tuple[str, ...] = QUICK
    if not quick:
        packs = [pack for pack in shipped() if pack.distribution == "spherekit"]
        names = tuple(sorted(name for pack in packs for name in pack.files))
    _row(names[0])  # loads pandas and pyarrow, which is not predicted
    rows = [_row(name) for name in names]
    columns = list(zip(*(row[1:] for row in rows), strict=True))
    middle: list[tuple[Cell, ...]] = [
        (what, *(pick([float(cell or 0) for cell in column]) for column in columns))
        for what, pick in (("median", statistics.median), ("least", min), ("most", max))
    ]
    titles = ("mechanism", "seconds", *STAGES, "CSV", "Parquet")
    return [
        Section(
            "Prediction of costs",
            f"Actual over predicted, all poles, {ENOUGH} samples of a branch, with tables. "
            "Seconds are of the processor, so that other work on the machine does not "
            "count; the first column is of all stages together.",
            titles,
            [*middle, *rows],
            ratios=titles[1:],
        )
    ]


def _row(name: str) -> tuple[Cell, ...]:
    made = load(name)
    with (
        tempfile.TemporaryDirectory() as folder,
        patch("time.perf_counter", time.process_time),
        patch("spherekit.analysis.run.Ledger", partial(Ledger, time.process_time)),
    ):
        found = run_analyses(
            made, samples=ENOUGH, branch=0, search=False, folder=folder
        ).summary["cost"]
    expected = found["predicted"]
    both = [
        [of["seconds"][stage] for stage in expected["seconds"]] for of in (found, expected)
    ]
    sizes = [
        sum(of["tables"][table][kind] for table in expected["tables"])
        for kind in ("csv_bytes", "parquet_bytes")
        for of in (found, expected)
    ]
    return (
        name,
        sum(both[0]) / sum(both[1]),
        *(found["seconds"][stage] / expected["seconds"][stage] for stage in STAGES),
        sizes[0] / sizes[1],
        sizes[2] / sizes[3],
    )
