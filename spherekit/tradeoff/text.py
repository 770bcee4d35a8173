"""A trade as text and as a table of values."""

import csv
import io

import numpy as np

from spherekit.conventions import without_numbers
from spherekit.tradeoff.record import MARGIN, Measured, Trade

HEADINGS = ("", "setting", "error", "worst column", "time", "median", "compiling")
TO_THE_RIGHT = ("time", "median", "compiling")


def as_text(trade: Trade, tolerance: float | None = None) -> str:
    """Return the table for people, the columns' scales, and the recommendation."""
    lines = [_heading(trade)]
    front = {measured.name for measured in trade.pareto}
    rows: list[tuple[str, ...]] = [HEADINGS]
    for candidate in trade.settings:
        if not candidate.reason:
            rows.append(_cells(trade, candidate, candidate.name in front))
    widths = [max(len(row[k]) for row in rows) for k in range(len(HEADINGS))]
    for row in rows:
        cells = (
            cell.rjust(width) if heading in TO_THE_RIGHT else cell.ljust(width)
            for heading, cell, width in zip(HEADINGS, row, widths, strict=True)
        )
        lines.append("  ".join(cells).rstrip())
    lines.append(
        "*: no other is quicker and as accurate. Times are processor times of a run"
        + _scaled(trade)
        + ", the best of the rounds and their median; compiling comes once."
    )
    if any(np.isfinite(measured.estimate) for measured in trade.settings):
        lines += [
            f"  {measured.name}: the analysis's own estimate of its error "
            f"{measured.estimate:.1e}"
            for measured in trade.settings
            if np.isfinite(measured.estimate)
        ]
    lines += _scales(trade)
    lines += _not_applying(trade)
    if tolerance is not None:
        lines.append(advice(trade, tolerance))
    return "\n".join(lines)


def _scaled(trade: Trade) -> str:
    if trade.derivatives is None or trade.samples == trade.checked:
        return ""
    return f" with {trade.samples} samples, scaled from {trade.checked}"


def _heading(trade: Trade) -> str:
    what = f"{trade.mechanism}, {trade.analysis}"
    if trade.derivatives is None:
        return f"{what}: parameters of its own, against {trade.reference}"
    orders = "rates and derivatives" if trade.derivatives else "rates, no derivatives"
    return (
        f"{what}: {trade.samples} samples, {orders}; errors at {trade.rows} rows against "
        f"{trade.reference}"
    )


def advice(trade: Trade, tolerance: float) -> str:
    """Return what to take for a tolerance."""
    best = trade.cheapest(tolerance)
    if best is not None:
        return (
            f"for {tolerance:g}: {best.name}, error {best.error:.1e} (taken where "
            f"{MARGIN:g} times that is within), {seconds(best.total(trade.samples))} with "
            "compiling"
        )
    reached = trade.most_accurate
    if reached is None:
        return f"for {tolerance:g}: no setting gives all numbers"
    return (
        f"for {tolerance:g}: no setting meets it with a margin of {MARGIN:g}; the best "
        f"reached is {reached.error:.1e}, by {reached.name}"
    )


def as_csv(trade: Trade) -> str:
    """Return all settings, a row each, with a heading."""
    rows = trade.as_dict()["settings"]
    stream = io.StringIO()
    columns = [name for name in rows[0] if name != "setting"]
    writer = csv.DictWriter(stream, columns, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return stream.getvalue()


def _cells(trade: Trade, measured: Measured, front: bool) -> tuple[str, ...]:
    return (
        "*" if front else "",
        measured.name,
        f"{measured.error:.1e}"
        + (f" ({measured.missing} missing)" if measured.missing else ""),
        measured.column,
        seconds(measured.seconds(trade.samples)),
        seconds(measured.first + measured.per_sample_median * trade.samples),
        seconds(measured.compile) if measured.compile > 1e-3 else "",
    )


def seconds(value: float) -> str:
    """Return a time with three digits; those of one unit align."""
    if value < 0.9995e-3:
        return f"{1e6 * value:.0f} us"
    if value >= 999.5:
        return f"{value:.0f} s"
    number, unit = (1e3 * value, "ms") if value < 0.9995 else (value, "s")
    return f"{number:#.3g}".rstrip(".") + f" {unit}"


def _scales(trade: Trade) -> list[str]:
    """Return how errors are measured, columns of one scale together."""
    ways: dict[str, list[str]] = {}
    for name, how, scale in trade.columns:
        size = "" if how.startswith("absolute") else f" ({scale:.3g})"
        ways.setdefault(f"{how}{size}", []).append(name)
    return [f"error of {', '.join(names)}: {how}" for how, names in ways.items()]


def _not_applying(trade: Trade) -> list[str]:
    """Return the settings that do not apply, a line for each reason.

    Reasons are one that differ in numbers, or in the name of their setting, only.
    """
    alike: dict[str, list[Measured]] = {}
    for measured in trade.settings:
        if measured.reason:
            key = without_numbers(_unnamed(measured))
            alike.setdefault(key, []).append(measured)
    lines = []
    for every in alike.values():
        first, *others = every
        why = _unnamed(first) if others else first.reason
        names = ", ".join(_shortened([measured.name for measured in every]))
        lines.append(f"does not apply: {names}: {why.removeprefix(f'{trade.mechanism}: ')}")
    return lines


def _unnamed(measured: Measured) -> str:
    """Return why a setting does not apply, without its name."""
    return measured.reason.replace(f" {measured.name} ", " ")


def _shortened(names: list[str]) -> list[str]:
    """Return names, of those that differ in the last number only the first in full.

    ``linear 32, linear 64, linear 128`` is ``linear 32, 64, 128``.
    """
    heads = [name.rpartition(" ") for name in names]
    return [
        last if k and last.isdecimal() and before == heads[k - 1][0] else name
        for k, (name, (before, _, last)) in enumerate(zip(names, heads, strict=True))
    ]
