"""The extremes: sweeps of one parameter to where numbers are no longer trustworthy.

A case is a function in a module of this package, with one module for each family. The
module `benchmarks.extremes.registry` says what a case returns and how it is judged.
"""

from collections.abc import Sequence
from importlib import import_module

import numpy as np

from benchmarks.extremes.registry import ALLOWED, CASES, TRUSTED, Case, Row
from benchmarks.harness import Cell, Section

FAMILIES = (
    "singular",
    "parallel",
    "arcs",
    "charts",
    "planar",
    "contacts",
    "turns",
    "chains",
    "inertia",
    "loads",
    "long_runs",
)
"""Modules of this package with cases."""


def cases() -> dict[str, Case]:
    """Return all cases by name, family after family."""
    for module in FAMILIES:
        import_module(f"benchmarks.extremes.{module}")
    return CASES


def run(quick: bool, only: Sequence[str] = ()) -> list[Section]:
    """Return a table of the cases of each family.

    Parameters
    ----------
    quick
        Whether cases have only a few values of their parameter.
    only
        Names of the cases, by default all. If given, their rows are returned too.
    """
    chosen = [case for name, case in cases().items() if not only or name in only]
    rows_by_case = {case.name: case.rows(quick) for case in chosen}
    families = dict.fromkeys(case.family for case in chosen)
    sections = [
        _summarize_family(
            family, [case for case in chosen if case.family == family], rows_by_case
        )
        for family in families
    ]
    if only:
        sections += [_list_rows(case, rows_by_case[case.name]) for case in chosen]
    return sections


def _summarize_family(
    family: str, family_cases: list[Case], rows_by_case: dict[str, list[Row]]
) -> Section:
    """Return the table of a family, with a row for each case."""
    wrong_count = sum(
        row.wrong for case in family_cases if case.held for row in rows_by_case[case.name]
    )
    exception = ""
    if not all(case.held for case in family_cases):
        exception = ", those of formulas that are compared left out."
    return Section(
        f"Extremes: {family}",
        f"The largest error over unit roundoff times conditioning, where that is at most "
        f"{TRUSTED:.0e} and a number is given (allowed: {ALLOWED:g}); and the first place, "
        "by conditioning, at which a status stands instead of a number.",
        (
            "case",
            "what it is",
            "parameter",
            "from, to",
            "error / (roundoff x conditioning)",
            "of",
            "largest conditioning of a number",
            "first status",
            "statuses",
            "wrong without a status",
        ),
        [_summarize_case(case, rows_by_case[case.name]) for case in family_cases],
        f"{wrong_count} numbers stand without a status and are further off than allowed"
        + (exception or "."),
    )


def _summarize_case(case: Case, rows: list[Row]) -> tuple[Cell, ...]:
    """Return the largest error of a case, and where its numbers get a status."""
    trusted = [row for row in rows if row.trusted]
    worst = max(trusted, key=lambda row: row.ratio, default=None)
    reserved = [row for row in rows if not row.given]
    first_reserved = min(reserved, key=lambda row: row.conditioning, default=None)
    return (
        case.name,
        case.text,
        case.parameter,
        f"{case.values[0]:g} to {case.values[-1]:g}",
        worst.ratio if worst else None,
        f"{worst.quantity} at {worst.parameter:.3g}" if worst else "-",
        max((row.conditioning for row in trusted), default=None),
        _describe_first_status(first_reserved),
        ", ".join(sorted({row.status for row in reserved})) or "-",
        sum(row.wrong for row in rows),
    )


def _describe_first_status(row: Row | None) -> str:
    """Return quantity, parameter and conditioning of the first row with a status."""
    if row is None:
        return "none needed"
    conditioning = "inf" if np.isinf(row.conditioning) else f"{row.conditioning:.1e}"
    return f"{row.quantity} at {row.parameter:.3g} (conditioning {conditioning})"


def _list_rows(case: Case, rows: list[Row]) -> Section:
    """Return the table of all rows of a case."""
    return Section(
        f"Extremes: {case.name}",
        case.text,
        (case.parameter, "quantity", "conditioning", "error", "over roundoff", "status"),
        [
            (
                row.parameter,
                row.quantity,
                row.conditioning,
                row.error if row.given else None,
                row.ratio if row.given else None,
                row.status + (", wrong" if row.wrong else ""),
            )
            for row in rows
        ],
    )
