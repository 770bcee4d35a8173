"""The result of a trade: settings with their times and errors, and the cheapest of them."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np

from spherekit.argument_validation import checked as check_arguments
from spherekit.conventions import Facts
from spherekit.errors import AnalysisError
from spherekit.runs.evaluation_options import Setting
from spherekit.runs.run_result import Columns
from spherekit.storage.json_data import finite_or_none

if TYPE_CHECKING:
    from matplotlib.figure import Figure


MARGIN = 4.0
"""Ratio of a tolerance to the largest measured error with which a setting meets it.

Errors are measured at some of the samples only, and rounding errors differ from sample to
sample. Larger: more expensive settings are recommended. Smaller: the errors of the whole
run may exceed the tolerance.
"""

EQUAL_TIME_FACTOR = 1.1
"""Ratio of times up to which two settings count as equally fast.

Measured times scatter by about this factor. Larger: a slower setting can be recommended.
Smaller: the recommendation changes from one measurement to the next.
"""


@dataclass(frozen=True)
class Measured:
    """The times and errors of one setting of a run, or of one value of a parameter.

    A setting is a way to compute a run, such as an engine. A parameter of an analysis makes
    it faster and less accurate. Settings may be measured with fewer samples than the run
    has. Their times are scaled up to all samples of the run.

    Attributes
    ----------
    name
        Name of the setting.
    setting
        The setting; None for a value of a parameter of the analysis.
    seconds, seconds_median
        Best and median processor time (s) of the run, without compiling.
    first_seconds
        The part of both times (s) that is spent before the first sample is computed. This
        part does not depend on the number of samples.
    compile_seconds
        Time (s) for compiling, which is spent once.
    error
        Largest deviation of any column from reference values. The deviation of a column is
        divided by the scale of the column (`Trade.columns`).
    worst_column
        The column with the largest deviation.
    own_estimate
        Error that the analysis itself estimates.
    missing
        Number of reference values for which this setting has no result.
    reason
        Reason why the setting does not apply, with NaN for the error and the times. Empty
        if the setting applies.
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
        """The time of the run, including the time for compiling, s."""
        return self.compile_seconds + self.seconds

    @property
    def counts(self) -> bool:
        """Whether the setting has computed all numbers, so that it can be chosen."""
        return not self.reason and not self.missing and bool(np.isfinite(self.error))


class Cost(NamedTuple):
    """The processor time (s) of a setting, and its largest scaled error."""

    seconds: float
    error: float


Option = TypeVar("Option")


def choose_most_accurate_fast_option(costs: Mapping[Option, Cost]) -> Option:
    """Return the most accurate of the options that are about as fast as the fastest.

    Parameters
    ----------
    costs
        Time and error of each option. Of options with equal errors the fastest is returned.
    """
    limit = EQUAL_TIME_FACTOR * min(cost.seconds for cost in costs.values())
    fast_options = [option for option, cost in costs.items() if cost.seconds <= limit]
    return min(
        fast_options, key=lambda option: (costs[option].error, costs[option].seconds)
    )


@dataclass(frozen=True)
class Trade:
    """The measured settings of one analysis of one mechanism.

    A setting is one way to compute a run, such as an engine or a tolerance. A trade shows
    how much accuracy each setting gives up for speed.

    Attributes
    ----------
    mechanism, analysis
        Names of the mechanism and of the analysis.
    samples
        Number of samples of the requested run.
    checked
        Number of samples at which errors were measured.
    rows
        Number of configurations at these samples.
    reference
        Words about the reference values.
    floor
        Error of the reference values.
    derivatives
        1 if the analysis reads derivatives with respect to the input, otherwise 0. None if
        values of a parameter were measured.
    columns
        Name, words about the scale, and scale of the errors of each column.
    settings
        The settings, with their times and errors.
    made_for
        The run for which the trade was made, see `spherekit.runs.trade_files`.
    draw
        Function that draws the figure.
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
        """Settings that no other beats in both time and error, the quickest first."""
        best: list[Measured] = []
        candidates = [candidate for candidate in self.settings if candidate.counts]
        for measured in sorted(candidates, key=lambda item: (item.total, item.error)):
            if not best or measured.error < best[-1].error:
                best.append(measured)
        return tuple(best)

    def cheapest(self, tolerance: float) -> Measured | None:
        """Return the best setting that meets a tolerance, None if no setting does.

        A setting is a way to compute a run. It meets the tolerance if `MARGIN` times its
        error does not exceed the tolerance. This factor is needed because errors were
        measured at some samples only, and other samples can have larger errors. Measured
        times scatter, so all settings that are about as fast
        as the fastest one count as equally fast. The most accurate of these settings is
        returned.

        Raises
        ------
        AnalysisError
            If the tolerance is not a positive number.
        """
        check_tolerance(self.mechanism, tolerance)
        # `pareto` has the settings that no other beats in both time and error.
        costs = {
            measured: Cost(measured.total, measured.error)
            for measured in self.pareto
            if MARGIN * measured.error <= tolerance
        }
        return choose_most_accurate_fast_option(costs) if costs else None

    @check_arguments(AnalysisError)
    def plot(self, tolerance: float | None = None, columns: Columns = 2) -> "Figure":
        """Return the work-precision figure: the error of each setting against its time.

        A setting is one way to compute a run, such as an engine or a tolerance.

        Parameters
        ----------
        tolerance
            Largest error that is accepted. It is drawn as a line, and the setting that
            `cheapest` returns for it is marked.
        columns
            Width of the figure in columns of a journal, 1 or 2.

        Raises
        ------
        AnalysisError
            If the tolerance is not a positive number, or the trade was not measured by
            `spherekit.trade`.
        OutputError
            If matplotlib is not installed.
        """
        # Only `spherekit.trade` stores a function that draws in `draw`.
        if self.draw is None:
            raise AnalysisError(
                "plot: only a result that spherekit.trade returned can be drawn"
            )
        return self.draw(self, tolerance, columns)

    def as_dict(self, tolerance: float | None = None) -> Facts:
        """Return the trade as data for JSON, with the setting for a tolerance."""
        chosen = None if tolerance is None else self.cheapest(tolerance)
        values = {key: getattr(self, name) for key, name in ATTRIBUTE_BY_KEY.items()}
        return values | {
            "margin": MARGIN,
            "columns": [dict(zip(COLUMN_KEYS, row, strict=True)) for row in self.columns],
            "settings": [self._setting_as_dict(measured) for measured in self.settings],
            "tolerance": tolerance,
            "recommended": None if chosen is None else chosen.name,
        }

    def _setting_as_dict(self, measured: Measured) -> Facts:
        """Return one setting with its times and errors as data for JSON.

        A setting is a way to compute a run. The key "what" describes the setting in words.
        "applies" is false if the setting cannot compute this run. "pareto" is true if no
        other setting has both a shorter time and a smaller error. NaN becomes None, because
        JSON has no NaN.
        """
        values = {}
        for key, value in asdict(measured).items():
            # Only NaN differs from itself.
            is_nan = value != value
            values[key] = None if is_nan else value
        # The time before the first sample, `first_seconds`, is the same for all numbers of
        # samples.
        seconds_per_sample = (measured.seconds - measured.first_seconds) / self.samples
        return {
            **values,
            "what": "" if measured.setting is None else measured.setting.describe(),
            "applies": not measured.reason,
            "microseconds_per_sample": finite_or_none(1e6 * seconds_per_sample),
            "pareto": measured in self.pareto,
        }


ATTRIBUTE_BY_KEY = {
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
"""Attributes of `Trade` by the keys under which files store them."""

COLUMN_KEYS = ("column", "measured", "scale")
"""Keys under which files store the entries of `Trade.columns`."""


def check_tolerance(mechanism: str, tolerance: float) -> None:
    """Raise `AnalysisError` unless a tolerance is a positive number."""
    if not 0.0 < tolerance < np.inf:
        raise AnalysisError(
            f"{mechanism}: tolerance: found {tolerance:g}, expected a finite number above "
            "0, such as 1e-9. The tolerance is the largest accepted error in any column: "
            "in rad for angles, and relative to the largest value of the column for other "
            "numbers"
        )


def format_seconds(value: float) -> str:
    """Return a time (s) as text, such as ``7 us``, ``1.20 ms``, ``45.0 s`` or ``1300 s``.

    Below 1 ms the text has whole microseconds, and above 1000 s whole seconds. Between
    these limits it has three digits.
    """
    # With three digits, numbers from 0.9995 on are rounded to 1.00.
    if value < 0.9995e-3:
        return f"{1e6 * value:.0f} us"
    if value >= 999.5:
        return f"{value:.0f} s"
    if value < 0.9995:
        number = 1e3 * value
        unit = "ms"
    else:
        number = value
        unit = "s"
    # "#" preserves zeros at the end (1.20), but also the point of "120.", which is removed.
    three_digits = f"{number:#.3g}".rstrip(".")
    return f"{three_digits} {unit}"
