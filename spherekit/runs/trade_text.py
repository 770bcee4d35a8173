"""A trade as text, and as a table of values."""

import numpy as np

from spherekit.conventions import Names
from spherekit.runs.trade_record import MARGIN, Measured, Trade, format_seconds
from spherekit.tables.table_files import format_csv
from spherekit.wording import counted, without_numbers

HEADINGS = ("", "setting", "error", "worst column", "time", "median", "compiling")
"""Headings of the columns of the text."""

ALIGNMENTS = "<<<<>>>"
"""Alignment of each column: to the left or to the right."""

MARK_TEXT = (
    "*: no other setting is both faster and as accurate. Times are processor times of the "
    "whole run: the best of all rounds, and their median. Time for compiling is needed "
    "only once."
)
"""Explains the first column and the times. Each setting was run in several rounds."""

MIN_LISTED_COMPILE_SECONDS = 1e-3
"""Time (s) for compiling below which its cell is empty."""


def as_text(trade: Trade, tolerance: float | None = None) -> str:
    """Return a trade as text for users.

    A trade consists of the settings of a run (ways to compute it) with their measured times
    and errors. The text has a table of the settings, and lines that explain its marks, its
    times and its errors. The last lines list the settings that do not apply.

    Parameters
    ----------
    trade
        The measured settings.
    tolerance
        Largest error that is accepted. With a tolerance, a setting is recommended at the
        end.
    """
    # The table of settings, in columns as wide as their longest cell.
    rows: list[Names] = [HEADINGS, *make_rows(trade)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = [make_heading(trade)]
    for row in rows:
        cells = [
            f"{cell:{alignment}{width}}"
            for cell, alignment, width in zip(row, ALIGNMENTS, widths, strict=True)
        ]
        lines.append("  ".join(cells).rstrip())
    lines.append(MARK_TEXT)
    lines += describe_errors(trade)
    lines += list_inapplicable_settings(trade)
    if tolerance is not None:
        lines.append(advise(trade, tolerance))
    return "\n".join(lines)


def make_rows(trade: Trade) -> list[Names]:
    """Return the cells of each measured setting, in the order of `HEADINGS`."""
    front = trade.pareto
    # A setting that does not apply to this run has a reason, and no row.
    return [
        _make_cells(measured, is_on_front=measured in front)
        for measured in trade.settings
        if not measured.reason
    ]


def describe_errors(trade: Trade) -> list[str]:
    """Return lines that explain the errors in the table of a trade, for below the table.

    A trade compares several ways (settings) to compute a run by their times and their
    errors. The first lines state the error that the analysis itself estimates for a
    setting. The remaining lines say by which scale the errors of each column of the results
    are divided, such as the largest value with the same unit.
    """
    lines = [
        f"  {measured.name}: the analysis's own estimate of its error "
        f"{measured.own_estimate:.1e}"
        for measured in trade.settings
        if np.isfinite(measured.own_estimate)
    ]
    # Columns with the same scale share a line. `scale_words` describe the scale. The scale
    # itself is added in brackets, except for absolute errors, which are not divided.
    columns_by_scale: dict[str, list[str]] = {}
    for column, scale_words, scale in trade.columns:
        scale_number = "" if scale_words.startswith("absolute") else f" ({scale:.3g})"
        columns_by_scale.setdefault(f"{scale_words}{scale_number}", []).append(column)
    lines += [
        f"error of {', '.join(columns)}: {scale_words}"
        for scale_words, columns in columns_by_scale.items()
    ]
    return lines


def make_heading(trade: Trade) -> str:
    """Return the first line of the text: what was measured, and against what."""
    subject = f"{trade.mechanism}, {trade.analysis}"
    if trade.derivatives is None:
        return f"{subject}: values of its parameters, compared with {trade.reference}"
    orders = "rates and derivatives" if trade.derivatives else "rates, no derivatives"
    return (
        f"{subject}: {counted(trade.samples, 'sample')}, {orders}; timed at "
        f"{counted(trade.checked, 'sample')}, {counted(trade.rows, 'row')} compared with "
        f"{trade.reference}"
    )


def advise(trade: Trade, tolerance: float) -> str:
    """Return a sentence that recommends a setting (way to compute a run) for a tolerance.

    The sentence recommends the setting that `Trade.cheapest` returns. The error is
    multiplied by a margin, and the time includes compiling. If no setting meets
    the tolerance, the sentence says how accurate the best one is.
    """
    best = trade.cheapest(tolerance)
    if best is not None:
        return (
            f"For {tolerance:g}: {best.name}, error {best.error:.1e} ({MARGIN:g} times "
            f"this is within the tolerance), {format_seconds(best.total)} including "
            "compiling"
        )
    # The front has the settings that no other setting beats in both time and error, the
    # fastest first. Settings that did not compute all numbers are left out.
    front = trade.pareto
    if not front:
        return f"For {tolerance:g}: no setting computes all numbers"
    most_accurate = front[-1]
    return (
        f"For {tolerance:g}: no setting meets it with a margin of {MARGIN:g}; the best "
        f"reached is {most_accurate.error:.1e}, by {most_accurate.name}"
    )


def as_csv(trade: Trade) -> str:
    """Return all settings as CSV, a row each, with a heading."""
    rows = trade.as_dict()["settings"]
    columns = [name for name in rows[0] if name != "setting"]
    values = [[row[name] for name in columns] for row in rows]
    return format_csv([columns, *values]).decode()


def _make_cells(measured: Measured, is_on_front: bool) -> Names:
    """Return the cells of one line in the table of measured settings.

    A setting is a way to compute a run. The cells are:

    - a star if no other setting is both faster and more accurate,
    - the name,
    - the largest error, with the number of missing results,
    - the column with this error,
    - the best time, the median time and the time for compiling.
    """
    error = f"{measured.error:.1e}"
    if measured.missing:
        error += f" ({measured.missing} missing)"
    is_compiled = measured.compile_seconds > MIN_LISTED_COMPILE_SECONDS
    return (
        "*" if is_on_front else "",
        measured.name,
        error,
        measured.worst_column,
        format_seconds(measured.seconds),
        format_seconds(measured.seconds_median),
        format_seconds(measured.compile_seconds) if is_compiled else "",
    )


def list_inapplicable_settings(trade: Trade) -> list[str]:
    """Return lines that list the settings which cannot compute a run, with the reasons.

    A setting is a way to compute a run. A trade compares settings. It has their measured
    times and errors, or the reason why a setting does not apply. Reasons that differ only
    in numbers or in the name of the setting share a line.
    """
    # By the reason without numbers: the first such reason with its numbers, and the names
    # of all settings with this reason.
    settings_by_reason: dict[str, tuple[str, list[str]]] = {}
    for measured in trade.settings:
        if measured.reason:
            # Without the name of the setting, reasons of several settings become equal.
            reason = measured.reason.replace(f" {measured.name} ", " ")
            reason = reason.removeprefix(f"{trade.mechanism}: ")
            key = without_numbers(reason)
            _, names = settings_by_reason.setdefault(key, (reason, []))
            names.append(measured.name)
    return [
        f"does not apply: {', '.join(names)}: {reason}"
        for reason, names in settings_by_reason.values()
    ]
