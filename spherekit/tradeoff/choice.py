"""The setting of a run that is to meet a tolerance, and what it reaches at check rows."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from spherekit.analysis.contract import AbstractAnalysis
from spherekit.analysis.declared import declared
from spherekit.analysis.running.evaluation import Setting
from spherekit.analysis.running.sampling import course_of
from spherekit.argument_validation import checked
from spherekit.conventions import listing
from spherekit.errors import AnalysisError, PluginError
from spherekit.model.mechanism import Mechanism
from spherekit.model.study import Study
from spherekit.tradeoff.measure import Benchmark, Deviation, worst
from spherekit.tradeoff.record import (
    MARGIN,
    Trade,
    check_run,
    check_tolerance,
    read_trade,
    recommended,
    run_of,
)
from spherekit.tradeoff.trade import trade

WORTH = 50_000
"""Samples from which on a short trade costs little beside the run; below, none is made."""

CHECKED = 121
"""Samples of a short trade."""

CHECK_ROWS = 61
"""Samples at which what was reached is measured, spread over the run's own."""

SHORT = (Setting(), Setting(route="conditioned"), Setting(engine="compiled"))
"""The settings of a short trade."""


@dataclass(frozen=True)
class Choice:
    """A setting chosen for a tolerance.

    `predicted` is the largest error that the short trade measured for it, NaN where there
    was none; `achieved` the largest at `rows` check rows of the run itself, in `column`.
    """

    setting: Setting
    tolerance: float
    predicted: float
    achieved: float
    column: str
    rows: int
    why: str

    @property
    def met(self) -> bool:
        """Whether the tolerance is met at the check rows, or those of the trade."""
        return bool((self.achieved if self.rows else self.predicted) <= self.tolerance)

    def as_dict(self) -> dict[str, Any]:
        """Return it ready for JSON."""

        def number(value: float) -> float | None:
            return float(value) if np.isfinite(value) else None

        return {
            "tolerance": self.tolerance,
            "setting": str(self.setting),
            "what": self.setting.describe(),
            "why": self.why,
            "predicted_error": number(self.predicted),
            "achieved_error": number(self.achieved),
            "worst_column": self.column,
            "check_rows": self.rows,
            "met": self.met,
        }


@checked(AnalysisError)
def choose(
    study: Study,
    analyses: Sequence[AbstractAnalysis],
    tolerance: float,
    stored: Sequence[Trade] = (),
) -> Choice:
    """Return the cheapest setting whose errors stay within a tolerance.

    Trades that are `stored` decide, if there are any. Else with fewer than `WORTH` samples
    the ordinary setting is taken, with more a short trade decides. Where none meets the
    tolerance, the most accurate is taken, and `met` is false. Errors are scaled as
    `spherekit.tradeoff.measure` says.

    Raises
    ------
    AnalysisError
        If the tolerance is not a positive number.
    PlanError, SolveError
        See `spherekit.run`.
    """
    mechanism = study.mechanism
    check_tolerance(mechanism.name, tolerance)
    predicted, why = np.nan, f"fewer than {WORTH} samples: no trade was made"
    setting = Setting()
    if stored:
        setting, predicted, why = _of_trades(stored, tolerance, study.count, "stored")
    elif study.count >= WORTH:
        trades = []
        for analysis in analyses:
            with suppress(AnalysisError, PluginError):  # the run says what fails
                if not analysis.trades and _reads(mechanism, analysis):
                    short_trade = trade(
                        study, analysis, settings=SHORT, checked=CHECKED, rounds=1
                    )
                    trades.append(short_trade)
        if trades:
            setting, predicted, why = _of_trades(trades, tolerance, study.count, "short")
    course = course_of(study)
    collected: list[Deviation] = []
    rows = 0
    for analysis in analyses:
        with suppress(AnalysisError, PluginError):
            bench = Benchmark.of(course, analysis)
            if bench.reads_poles and not analysis.trades:
                deviations, rows = bench.checked(setting, CHECK_ROWS)
                collected += deviations
    largest = worst(collected)
    return Choice(
        setting,
        tolerance,
        predicted,
        np.nan if largest is None else largest.error,
        "" if largest is None else f"{largest.table}.{largest.column}",
        rows,
        why,
    )


def choose_simulation(mechanism: str, tolerance: float, stored: Sequence[Trade]) -> Choice:
    """Return the cheapest integrator with its own tolerance, by stored trades.

    Raises
    ------
    AnalysisError
        If the tolerance is not a positive number.
    """
    check_tolerance(mechanism, tolerance)
    setting, predicted, why = _of_trades(stored, tolerance, stored[0].samples, "stored")
    return Choice(setting, tolerance, predicted, np.nan, "", 0, why)


def stored_for(
    study: Study, analyses: Sequence[AbstractAnalysis], places: Sequence[str]
) -> list[Trade]:
    """Return the trades of the analyses of a study's run, read from folders or files.

    Raises
    ------
    AnalysisError
        If one was made for another run, or an analysis has none.
    """
    trades: dict[str, Trade] = {}
    for place in places:
        record = read_trade(place)
        named = [analysis for analysis in analyses if analysis.name == record.analysis]
        if not named:
            raise AnalysisError(
                f"{place}: the trade is of analysis {record.analysis}, which is not run; "
                f"the run has {listing(analysis.name for analysis in analyses)}: leave "
                "this --trade out"
            )
        check_run(record, run_of(study, named[0]), place)
        if all(measured.setting is None for measured in record.settings):
            raise AnalysisError(
                f"{place}: the trade is of parameters of {record.analysis}, not of ways to "
                "run it; give the parameter with -a NAME:key=value, and leave --trade out"
            )
        trades[record.analysis] = record
    lacking = [analysis.name for analysis in analyses if analysis.name not in trades]
    if lacking:
        raise AnalysisError(
            f"--trade: there is none of {listing(lacking)}; make it with: spherekit trade "
            f"FILE -a {lacking[0]} -o DIR, and give --trade once for each analysis"
        )
    return list(trades.values())


def _reads(mechanism: Mechanism, analysis: AbstractAnalysis) -> bool:
    needs = declared(analysis, mechanism)
    return bool(needs.directions or needs.rates or needs.link_rates or needs.pair_rates)


def _of_trades(
    trades: Sequence[Trade], tolerance: float, samples: int, kind: str
) -> tuple[Setting, float, str]:
    """Return the cheapest setting that meets a tolerance in all trades, its error, why."""
    errors: dict[Setting, float] = {}
    seconds: dict[Setting, float] = {}
    for number, record in enumerate(trades):
        by_setting = {
            measured.setting: measured
            for measured in record.settings
            if measured.setting and measured.counts
        }
        kept = (
            by_setting
            if number == 0
            else {s: e for s, e in by_setting.items() if s in errors}
        )
        errors = {s: max(e.error, errors.get(s, 0.0)) for s, e in kept.items()}
        seconds = {s: e.total(samples) + seconds.get(s, 0.0) for s, e in kept.items()}
    names = listing(item.analysis for item in trades)
    good = [s for s, error in errors.items() if MARGIN * error <= tolerance]
    if good:
        chosen = recommended({s: (seconds[s], errors[s]) for s in good})
        return chosen, errors[chosen], f"the cheapest of a {kind} trade of {names}"
    if not errors:
        return Setting(), np.nan, f"no setting of a {kind} trade of {names} gives all rows"
    chosen = min(errors, key=lambda s: errors[s])
    words = (
        f"no setting of a {kind} trade of {names} meets the tolerance; the most accurate"
    )
    return chosen, errors[chosen], words
