"""The extremes: sweeps of one parameter to where numbers stop being trustworthy.

A case is a function in a module of this package, one module a family; see
`benchmarks.extremes.registry` for what it returns and how that is judged.
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
    """Return a table of cases for each family, and all rows of the cases named."""
    chosen = [case for name, case in cases().items() if not only or name in only]
    rows = {case.name: case.rows(quick) for case in chosen}
    families = dict.fromkeys(case.family for case in chosen)
    sections = [
        _summary(family, [case for case in chosen if case.family == family], rows)
        for family in families
    ]
    return sections + [_whole(case, rows[case.name]) for case in chosen if only]


def _summary(family: str, members: list[Case], rows: dict[str, list[Row]]) -> Section:
    table: list[tuple[Cell, ...]] = []
    wrong, every = 0, all(case.held for case in members)
    for case in members:
        found = rows[case.name]
        wrong += sum(row.wrong for row in found) if case.held else 0
        trusted = [row for row in found if row.trusted]
        worst = max(trusted, key=lambda row: row.ratio, default=None)
        reserved = [row for row in found if not row.given]
        first = min(reserved, key=lambda row: row.conditioning, default=None)
        table.append(
            (
                case.name,
                case.text,
                case.parameter,
                f"{case.values[0]:g} to {case.values[-1]:g}",
                worst.ratio if worst else None,
                f"{worst.quantity} at {worst.parameter:.3g}" if worst else "-",
                max((row.conditioning for row in trusted), default=None),
                _trust(first),
                ", ".join(sorted({row.status for row in reserved})) or "-",
                sum(row.wrong for row in found),
            )
        )
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
        table,
        f"{wrong} numbers stand without a status and are further off than allowed"
        + (", those of formulas that are compared left out." if not every else "."),
    )


def _trust(row: Row | None) -> str:
    if row is None:
        return "none needed"
    conditioning = "inf" if np.isinf(row.conditioning) else f"{row.conditioning:.1e}"
    return f"{row.quantity} at {row.parameter:.3g} (conditioning {conditioning})"


def _whole(case: Case, rows: list[Row]) -> Section:
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
