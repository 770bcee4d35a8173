"""What a trade found: settings with their times and errors, and the cheapest of them.

Trades kept on disk: what run they were made for, and reading them back.

The work-precision chart: error against time, both logarithmic.

A trade as text and as a table of values.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from spherekit.analysis.contract import AbstractAnalysis
from spherekit.analysis.frames import csv_text
from spherekit.analysis.result import Columns
from spherekit.analysis.running.evaluation import Setting
from spherekit.analysis.running.run_state import digest, identities_of
from spherekit.analysis.scene import Axis, Mark, PlaneCurve, Portrait, Scene, Text
from spherekit.argument_validation import checked as judged
from spherekit.arrays import Floats
from spherekit.conventions import AnyPath, Facts, Names, without_numbers
from spherekit.errors import AnalysisError
from spherekit.files.plain import finite
from spherekit.files.write import mechanism_hash
from spherekit.model.study import Study
from spherekit.planning.inputs import driven_at
from spherekit.version import __version__

if TYPE_CHECKING:
    from matplotlib.figure import Figure


Way = TypeVar("Way")

MARGIN = 4.0
"""A setting is recommended for a tolerance this many times its measured error, for errors
are measured at some of the samples, and rounding scatters from one to the next."""

ALIKE = 1.1
"""Times within this factor are taken as the same: they scatter as much."""


@dataclass(frozen=True)
class Measured:
    """One setting: what it took and how far its tables were off.

    `seconds` and `seconds_median` are the best and the median time of the run that is
    wanted, of which `first_seconds` come before any sample; `compile_seconds` come once.
    `error` is the largest scaled deviation, of `worst_column`; `own_estimate` the
    analysis's own. `missing` numbers were not given though they exist. `reason` says why
    the setting does not apply, then all else is NaN. `setting` is None for a parameter.
    """

    name: str
    setting: Setting | None
    seconds: float = np.nan
    seconds_median: float = np.nan
    first_seconds: float = np.nan
    compile_seconds: float = 0.0
    error: float = np.nan
    worst_column: str = ""
    own_estimate: float = np.nan
    missing: int = 0
    reason: str = ""

    @property
    def total(self) -> float:
        """The time of the run with compiling, s."""
        return self.compile_seconds + self.seconds

    @property
    def counts(self) -> bool:
        """Whether it can be chosen: it applies, and gives every number there is."""
        return not self.reason and not self.missing and bool(np.isfinite(self.error))


def recommended(measured: Mapping[Way, tuple[float, float]]) -> Way:
    """Return the most accurate of the ways that are about as quick as the quickest.

    `measured` has the time and the error of each.
    """
    limit = ALIKE * min(time for time, _ in measured.values())
    alike = [way for way, (time, _) in measured.items() if time <= limit]
    return min(alike, key=lambda way: measured[way][::-1])


@dataclass(frozen=True)
class Trade:
    """Settings of one analysis of one mechanism, measured.

    `samples` are those asked for, `checked` those at which errors were measured, `rows`
    the configurations behind these. `columns` says how the errors of each column are
    measured, `reference` what they are measured against, and `floor` how well that is
    known itself. `derivatives` is the order of the rates' derivatives that the analysis
    reads, and no more is computed; None where no rates are. `made_for` says which run it
    was made for, see `spherekit.tradeoff.record`; `draw` makes its figure.
    """

    mechanism: str
    analysis: str
    samples: int
    checked: int
    rows: int
    reference: str
    floor: float
    derivatives: int | None
    columns: tuple[tuple[str, str, float], ...]
    settings: tuple[Measured, ...]
    made_for: Facts
    draw: "Callable[[Trade, float | None, Columns], Figure] | None" = field(
        default=None, compare=False
    )

    def __repr__(self) -> str:
        best = ", ".join(
            f"{measured.name} ({measured.error:.1e})" for measured in self.pareto[:3]
        )
        return (
            f"<Trade of {self.analysis} on {self.mechanism}: {len(self.settings)} "
            f"settings, the quickest with their errors: {best}>"
        )

    @property
    def pareto(self) -> tuple[Measured, ...]:
        """The settings that no other beats in both time and error, the quickest first."""
        best: list[Measured] = []
        counting = [candidate for candidate in self.settings if candidate.counts]
        for measured in sorted(counting, key=lambda item: (item.total, item.error)):
            if not best or measured.error < best[-1].error:
                best.append(measured)
        return tuple(best)

    def cheapest(self, tolerance: float) -> Measured | None:
        """Return the quickest setting whose error times `MARGIN` is within a tolerance.

        Of those about as quick, the most accurate: times differ from run to run.

        Raises
        ------
        AnalysisError
            If the tolerance is not a positive number.
        """
        check_tolerance(self.mechanism, tolerance)
        within = {
            measured: (measured.total, measured.error)
            for measured in self.pareto
            if MARGIN * measured.error <= tolerance
        }
        return recommended(within) if within else None

    @judged(AnalysisError)
    def plot(self, tolerance: float | None = None, columns: Columns = 2) -> "Figure":
        """Return the work-precision figure, for one or two columns of a journal.

        A tolerance is a line in it, and what is taken for that is marked.

        Raises
        ------
        AnalysisError
            If the tolerance is not a positive number, or the trade was not measured by
            `spherekit.trade`.
        OutputError
            If matplotlib is not installed.
        """
        if self.draw is None:
            raise AnalysisError("plot: only what spherekit.trade returns can be drawn")
        return self.draw(self, tolerance, columns)

    def as_dict(self, tolerance: float | None = None) -> Facts:
        """Return everything ready for JSON."""
        chosen = None if tolerance is None else self.cheapest(tolerance)
        return {key: getattr(self, name) for key, name in STORED.items()} | {
            "margin": MARGIN,
            "columns": [dict(zip(COLUMN, row, strict=True)) for row in self.columns],
            "settings": [
                {
                    **{k: None if x != x else x for k, x in asdict(measured).items()},
                    "what": "" if measured.setting is None else measured.setting.describe(),
                    "applies": not measured.reason,
                    "microseconds_per_sample": finite(
                        1e6 * (measured.seconds - measured.first_seconds) / self.samples
                    ),
                    "pareto": measured in self.pareto,
                }
                for measured in self.settings
            ],
            "tolerance": tolerance,
            "recommended": None if chosen is None else chosen.name,
        }


STORED = {
    "mechanism": "mechanism",
    "analysis": "analysis",
    "made_for": "made_for",
    "samples": "samples",
    "checked_samples": "checked",
    "checked_rows": "rows",
    "reference": "reference",
    "reference_error": "floor",
    "derivatives": "derivatives",
}
"""Under which names a trade is stored, and what of it."""
COLUMN = "column", "measured", "scale"


def check_tolerance(mechanism: str, tolerance: float) -> None:
    """Raise `AnalysisError` unless a tolerance is a positive number."""
    if not 0.0 < tolerance < np.inf:
        raise AnalysisError(
            f"{mechanism}: tolerance {tolerance:g} is none; give a positive number such as "
            "1e-9: the largest error of a column, in its scale"
        )


FILE = "trade.json"


def run_of(study: Study, analysis: AbstractAnalysis) -> Facts:
    """Return what a trade for a study's run depends on, ready for JSON."""
    mechanism = driven_at(study.mechanism)
    path = study.path
    ((_, version, given),) = identities_of([analysis])
    return {
        "spherekit": __version__,
        "mechanism": mechanism.name,
        "mechanism_hash": mechanism_hash(mechanism),
        "analysis": analysis.name,
        "analysis_version": version,
        "parameters": given,
        "inputs": mechanism.input_pairs,
        "samples": "x".join(map(str, study.shape)),
        "input_values": None if path is None else digest(path),
        "assembly_mode": study.assembly_mode
        if study.start is None
        else study.assembly_mode or 0,
        "search": study.search,
        # Trades of earlier versions have no such key.
        **({"crossings": "pass"} if study.crossings == "pass" else {}),
        "laws": {pair: repr(law) for pair, law in study.laws.items()},
        "duration": study.duration,
        "start": None if study.start is None else [study.start.q, study.start.dq],
        "torque": study.torque,
    }


def read_trade(path: AnyPath) -> Trade:
    """Return the trade that `spherekit trade -o` wrote into a folder.

    Raises
    ------
    AnalysisError
        If there is none, or it cannot be read.
    """
    file = Path(path)
    again = f"write one with: spherekit trade FILE -a NAME -o {path}"
    try:
        if file.is_dir():
            file = file / FILE
        if file.exists() and not file.is_file():
            raise ValueError("a folder or a device, not a regular file")
        return _trade(json.loads(file.read_bytes()))
    except FileNotFoundError:
        raise AnalysisError(f"{file}: there is no trade; {again}") from None
    except (OSError, KeyError, TypeError, ValueError) as problem:
        raise AnalysisError(
            f"{file}: is not a trade that this version reads ({problem!r}); {again}"
        ) from None


def _trade(data: Facts) -> Trade:
    return Trade(
        columns=tuple(tuple(column[key] for key in COLUMN) for column in data["columns"]),
        settings=tuple(map(_measured, data["settings"])),
        **{name: data[key] for key, name in STORED.items()},
    )


def _measured(row: Facts) -> Measured:
    given: Facts = {
        x.name: np.nan if row[x.name] is None else row[x.name] for x in fields(Measured)
    }
    given["setting"] = None if row["setting"] is None else Setting(**row["setting"])
    return Measured(**given)


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
    return csv_text([columns, *([row[name] for name in columns] for row in rows)]).decode()


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


def seconds(value: float) -> str:
    """Return a time with three digits; those of one unit align."""
    if value < 0.9995e-3:
        return f"{1e6 * value:.0f} us"
    if value >= 999.5:
        return f"{value:.0f} s"
    number, unit = (1e3 * value, "ms") if value < 0.9995 else (value, "s")
    return f"{number:#.3g}".rstrip(".") + f" {unit}"


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


FRONT, EVALUATED, TOLERANCE = 1, 0, 5
"""Tones: of settings that no other beats, of other settings, of the tolerance."""
LEAST = 1e-17


def scene(trade: Trade, tolerance: float | None = None) -> Scene:
    """Return the chart with a mark for each setting, and the table.

    Settings are numbered; a tolerance is a line, and its choice a mark.
    """
    counting = [candidate for candidate in trade.settings if candidate.counts]
    points = _points(counting)
    (left, bottom), (right, top) = _frame(points)
    curves = [
        PlaneCurve(_points(trade.pareto), FRONT, "no other is quicker and as accurate")
    ]
    marks = []
    for numbered, (measured, place) in enumerate(zip(counting, points, strict=True), 1):
        tone = FRONT if measured in trade.pareto else EVALUATED
        marks.append(Mark(str(numbered), place, tone))
        words = f"{numbered}: {measured.name}, {measured.error:.1e}"
        curves.append(PlaneCurve(place[None], tone, words))
    if tolerance is not None:
        line = np.array([[left, tolerance], [right, tolerance]])
        curves.append(PlaneCurve(line, TOLERANCE, f"tolerance {tolerance:g}"))
        chosen = trade.cheapest(tolerance)
        if chosen is not None:
            (place,) = _points([chosen])
            marks.append(Mark("taken", place, TOLERANCE))
    chart = Portrait(
        "trade/chart",
        "work and precision",
        x=points[:1, 0],
        y=points[:1, 1],
        x_label="processor time with compiling",
        y_label="largest error of a column",
        x_range=(left, right),
        y_range=(bottom, top),
        x_unit="s",
        curves=curves,
        marks=marks,
        logarithmic=True,
    )
    words = f"```\n{as_text(trade, tolerance)}\n```"
    return Scene(
        "Trade",
        (chart, Text("trade/table", "Trade", words)),
        (Axis("setting", "", np.zeros(1)),),
        "trade",
    )


def _points(counting: Sequence[Measured]) -> Floats:
    """Return (n, 2) times and errors."""
    rows = [(measured.total, measured.error) for measured in counting]
    return np.maximum(np.reshape(rows, (-1, 2)), LEAST)


def _frame(points: Floats) -> tuple[Floats, Floats]:
    """Return the round times and the powers of ten that hold all points with some room."""
    if not len(points):
        return np.array([0.1, 0.1]), np.array([1.0, 1.0])
    low, high = np.log10([points.min(axis=0), points.max(axis=0)])
    room = np.maximum(0.06 * (high - low), 0.1)
    return 10.0 ** (low - room), 10.0 ** (high + room)
