"""What a trade found: settings with their times and errors, and the cheapest of them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any, TypeVar, final

import numpy as np

from spherekit.analysis.result import Columns
from spherekit.analysis.running.setting import Setting
from spherekit.checked import checked as judged
from spherekit.errors import AnalysisError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Way = TypeVar("Way")

MARGIN = 4.0
"""A setting is recommended for a tolerance this many times its measured error, for errors
are measured at some of the samples, and rounding scatters from one to the next."""

ALIKE = 1.1
"""Times within this factor are taken as the same: they scatter as much."""


@final
@dataclass(frozen=True)
class Measured:
    """One setting: what it took and how far its tables were off.

    `first` (s) is what comes before any sample, such as nodes; `per_sample` and
    `per_sample_median` (s) the best and the median time of a sample of all assembly modes;
    `compile` (s) what compiling took. `error` is the largest scaled deviation, of `column`;
    `estimate` the analysis's own. `missing` numbers were not given though they exist.
    `reason` says why the setting does not apply, then all else is NaN. `setting` is None
    for a parameter.
    """

    name: str
    setting: Setting | None
    first: float = np.nan
    per_sample: float = np.nan
    per_sample_median: float = np.nan
    compile: float = 0.0
    error: float = np.nan
    column: str = ""
    estimate: float = np.nan
    missing: int = 0
    reason: str = ""

    def seconds(self, samples: int) -> float:
        """Return the time of a run with so many samples, without compiling."""
        return self.first + self.per_sample * samples

    def total(self, samples: int) -> float:
        """Return the time of a run with so many samples, with compiling."""
        return self.compile + self.seconds(samples)

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


@final
@dataclass(frozen=True)
class Trade:
    """Settings of one analysis of one mechanism, measured.

    `samples` are those asked for, `checked` those at which errors were measured, `rows`
    the configurations behind these. `columns` says how the errors of each column are
    measured, `reference` what they are measured against, and `floor` how well that is
    known itself. `derivatives` is the order of the rates' derivatives that the analysis
    reads, and no more is computed; None where no rates are. `made_for` says which run it
    was made for, see `spherekit.tradeoff.stored`; `draw` makes its figure.
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
    made_for: Mapping[str, Any]
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
        for measured in sorted(
            counting, key=lambda item: (item.total(self.samples), item.error)
        ):
            if not best or measured.error < best[-1].error:
                best.append(measured)
        return tuple(best)

    @property
    def most_accurate(self) -> Measured | None:
        """The setting with the least error, the quickest of several."""
        return self.pareto[-1] if self.pareto else None

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
            measured: (measured.total(self.samples), measured.error)
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

    def as_dict(self, tolerance: float | None = None) -> dict[str, Any]:
        """Return everything ready for JSON."""
        chosen = None if tolerance is None else self.cheapest(tolerance)
        names = {measured.name for measured in self.pareto}
        return {
            "mechanism": self.mechanism,
            "analysis": self.analysis,
            "made_for": dict(self.made_for),
            "samples": self.samples,
            "checked_samples": self.checked,
            "checked_rows": self.rows,
            "reference": self.reference,
            "reference_error": self.floor,
            "margin": MARGIN,
            "derivatives": self.derivatives,
            "columns": [
                {"column": name, "measured": how, "scale": scale}
                for name, how, scale in self.columns
            ],
            "settings": [
                _row(measured, self.samples, measured.name in names)
                for measured in self.settings
            ],
            "tolerance": tolerance,
            "recommended": None if chosen is None else chosen.name,
        }


def check_tolerance(mechanism: str, tolerance: float) -> None:
    """Raise `AnalysisError` unless a tolerance is a positive number."""
    if not 0.0 < tolerance < np.inf:
        raise AnalysisError(
            f"{mechanism}: tolerance {tolerance:g} is none; give a positive number such as "
            "1e-9: the largest error of a column, in its scale"
        )


def _row(measured: Measured, samples: int, pareto: bool) -> dict[str, Any]:
    def number(value: float) -> float | None:
        return float(value) if np.isfinite(value) else None

    return {
        "name": measured.name,
        "what": "" if measured.setting is None else measured.setting.describe(),
        "setting": None if measured.setting is None else asdict(measured.setting),
        "applies": not measured.reason,
        "reason": measured.reason,
        "error": number(measured.error),
        "worst_column": measured.column,
        "own_estimate": number(measured.estimate),
        "missing": measured.missing,
        "seconds": number(measured.seconds(samples)),
        "seconds_median": number(measured.first + measured.per_sample_median * samples),
        "first_seconds": number(measured.first),
        "microseconds_per_sample": number(1e6 * measured.per_sample),
        "compile_seconds": measured.compile,
        "pareto": pareto,
    }


def gathered(names: Sequence[tuple[str, str, float]]) -> tuple[tuple[str, str, float], ...]:
    """Return columns once each, as first met."""
    return tuple({name: (name, how, scale) for name, how, scale in names}.values())
