"""A trade as text and as a table of values."""

import numpy as np

from spherekit.conventions import Names
from spherekit.runs.trade_record import MARGIN, Measured, Trade, seconds
from spherekit.tables.table_files import format_csv
from spherekit.wording import without_numbers

HEADINGS = ("", "setting", "error", "worst column", "time", "median", "compiling")


SIDES = "<<<<>>>"
"""On which side of their columns the cells are."""


def as_text(trade: Trade, tolerance: float | None = None) -> str:
    """Return the table for people, the columns' scales, and the recommendation."""
    settings = (_cells(x, x in trade.pareto) for x in trade.settings if not x.reason)
    rows = [HEADINGS, *settings]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = [_heading(trade)]
    for row in rows:
        made = (
            f"{cell:{side}{width}}"
            for cell, side, width in zip(row, SIDES, widths, strict=True)
        )
        lines.append("  ".join(made).rstrip())
    lines.append(
        "*: no other is quicker and as accurate. Times are processor times of the whole "
        "run, the best of the rounds and their median; compiling comes once."
    )
    lines += [
        f"  {measured.name}: the analysis's own estimate of its error "
        f"{measured.own_estimate:.1e}"
        for measured in trade.settings
        if np.isfinite(measured.own_estimate)
    ]
    ways: dict[str, list[str]] = {}
    for name, how, scale in trade.columns:
        size = "" if how.startswith("absolute") else f" ({scale:.3g})"
        ways.setdefault(f"{how}{size}", []).append(name)
    lines += [f"error of {', '.join(names)}: {how}" for how, names in ways.items()]
    lines += _not_applying(trade)
    if tolerance is not None:
        lines.append(advice(trade, tolerance))
    return "\n".join(lines)


def _heading(trade: Trade) -> str:
    what = f"{trade.mechanism}, {trade.analysis}"
    if trade.derivatives is None:
        return f"{what}: parameters of its own, against {trade.reference}"
    orders = "rates and derivatives" if trade.derivatives else "rates, no derivatives"
    return (
        f"{what}: {trade.samples} samples, {orders}; times by {trade.checked} of them, "
        f"errors at {trade.rows} rows against {trade.reference}"
    )


def advice(trade: Trade, tolerance: float) -> str:
    """Return what to take for a tolerance."""
    best = trade.cheapest(tolerance)
    if best is not None:
        return (
            f"for {tolerance:g}: {best.name}, error {best.error:.1e} (taken where "
            f"{MARGIN:g} times that is within), {seconds(best.total)} with "
            "compiling"
        )
    if not trade.pareto:
        return f"for {tolerance:g}: no setting gives all numbers"
    reached = trade.pareto[-1]
    return (
        f"for {tolerance:g}: no setting meets it with a margin of {MARGIN:g}; the best "
        f"reached is {reached.error:.1e}, by {reached.name}"
    )


def as_csv(trade: Trade) -> str:
    """Return all settings, a row each, with a heading."""
    rows = trade.as_dict()["settings"]
    columns = [name for name in rows[0] if name != "setting"]
    return format_csv(
        [columns, *([row[name] for name in columns] for row in rows)]
    ).decode()


def _cells(measured: Measured, front: bool) -> Names:
    return (
        "*" if front else "",
        measured.name,
        f"{measured.error:.1e}"
        + (f" ({measured.missing} missing)" if measured.missing else ""),
        measured.worst_column,
        seconds(measured.seconds),
        seconds(measured.seconds_median),
        seconds(measured.compile_seconds) if measured.compile_seconds > 1e-3 else "",
    )


def _not_applying(trade: Trade) -> list[str]:
    """Return the settings that do not apply, a line for each reason.

    Reasons are one that differ in numbers, or in the name of their setting, only.
    """
    alike: dict[str, tuple[str, list[str]]] = {}
    for measured in trade.settings:
        if measured.reason:
            why = measured.reason.replace(f" {measured.name} ", " ")
            why = why.removeprefix(f"{trade.mechanism}: ")
            alike.setdefault(without_numbers(why), (why, []))[1].append(measured.name)
    return [f"does not apply: {', '.join(names)}: {why}" for why, names in alike.values()]
