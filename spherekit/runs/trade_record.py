"""What a trade found: settings with their times and errors, and the cheapest of them."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from spherekit.argument_validation import checked as judged
from spherekit.conventions import Facts
from spherekit.errors import AnalysisError
from spherekit.runs.evaluation_options import Setting
from spherekit.runs.run_result import Columns
from spherekit.storage.json_data import finite_or_none

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
    was made for, see `spherekit.runs.trade_record`; `draw` makes its figure.
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
                    "microseconds_per_sample": finite_or_none(
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


def seconds(value: float) -> str:
    """Return a time with three digits; those of one unit align."""
    if value < 0.9995e-3:
        return f"{1e6 * value:.0f} us"
    if value >= 999.5:
        return f"{value:.0f} s"
    number, unit = (1e3 * value, "ms") if value < 0.9995 else (value, "s")
    return f"{number:#.3g}".rstrip(".") + f" {unit}"
