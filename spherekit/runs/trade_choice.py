"""The setting of a run that is to meet a tolerance, and what it reaches at check rows."""

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from spherekit.argument_validation import checked
from spherekit.conventions import Facts
from spherekit.errors import AnalysisError, PluginError
from spherekit.files.study import Study
from spherekit.runs.contract import Analyses
from spherekit.runs.evaluation_options import ORDINARY, Setting
from spherekit.runs.run_identity import differences
from spherekit.runs.sampling import make_sampling
from spherekit.runs.simulation_measurement import plan_of
from spherekit.runs.table_deviation import Deviation, worst
from spherekit.runs.trade import trade
from spherekit.runs.trade_files import read_trade, run_of
from spherekit.runs.trade_measurement import measure_run, reads_poles
from spherekit.runs.trade_record import MARGIN, Trade, check_tolerance, recommended
from spherekit.storage.json_data import finite_or_none
from spherekit.wording import listing

WORTH = 50_000
"""Samples from which on a short trade costs little beside the run; below, none is made."""

CHECKED = 121
"""Samples of a short trade."""

SHORT = {
    "settings": (ORDINARY, Setting(route="conditioned"), Setting(engine="compiled")),
    "checked": CHECKED,
    "rounds": 1,
}
"""How a short trade is made."""


@checked(AnalysisError)
def choose(
    study: Study,
    analyses: Analyses,
    tolerance: float,
    stored: Sequence[Trade] = (),
) -> tuple[Setting, Facts]:
    """Return the cheapest setting with errors within a tolerance, and what it reaches.

    Trades that are `stored` decide, if there are any. Else with fewer than `WORTH` samples
    the ordinary setting is taken, with more a short trade decides. Where none meets the
    tolerance, the most accurate is taken, and it is not `met`. Errors are scaled as
    `spherekit.runs.trade_measurement` says: the largest that a trade measured, and at check
    rows of the run itself, None where there is none. Of a simulation no rows are checked.

    Raises
    ------
    AnalysisError
        If the tolerance is not a positive number; other errors as `spherekit.run`.
    """
    check_tolerance(study.mechanism.name, tolerance)
    trades = list(stored)
    plans = []
    if study.start is None:
        sampling = make_sampling(study)
        for analysis in analyses:
            with suppress(AnalysisError, PluginError):  # the run says what fails
                plan = plan_of(sampling, analysis)
                if not analysis.trades and reads_poles(plan):
                    plans.append(plan)
    if not stored and study.count >= WORTH:
        for plan in plans:
            with suppress(AnalysisError, PluginError):
                if plan.requests[0].poles:
                    trades.append(trade(study, plan.analyses[0], **SHORT))
    setting, predicted, why = (
        _of_trades(trades, tolerance, "stored" if stored else "short")
        if trades
        else (ORDINARY, np.nan, f"fewer than {WORTH} samples: no trade was made")
    )
    collected: list[Deviation] = []
    rows = 0
    for plan in plans:
        with suppress(AnalysisError, PluginError):
            deviations, rows = measure_run(
                plan_of(plan.sampling, plan.analyses[0], setting)
            )
            collected += deviations
    largest = worst(collected)
    achieved = np.nan if largest is None else largest.error
    return setting, {
        "tolerance": tolerance,
        "setting": str(setting),
        "what": setting.describe(),
        "why": why,
        "predicted_error": finite_or_none(predicted),
        "achieved_error": finite_or_none(achieved),
        "worst_column": "" if largest is None else largest.column,
        "check_rows": rows,
        "met": bool((achieved if rows else predicted) <= tolerance),
    }


def stored_for(study: Study, analyses: Analyses, places: Sequence[str]) -> list[Trade]:
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
        now = run_of(study, named[0])
        if differs := differences(record.made_for, now):
            raise AnalysisError(
                f"{place}: the trade was made for another run ({differs}); make it for "
                f"this one with: spherekit trade {now['mechanism']} -a {now['analysis']} "
                f"-o {place} and the options of the run, or leave --trade out"
            )
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


def _of_trades(
    trades: Sequence[Trade], tolerance: float, kind: str
) -> tuple[Setting, float, str]:
    """Return the cheapest setting that meets a tolerance in all trades, its error, why."""
    counting = [
        {x.setting: x for x in record.settings if x.setting and x.counts}
        for record in trades
    ]
    measured = {
        setting: (
            sum(x[setting].total for x in counting),
            max(x[setting].error for x in counting),
        )
        for setting in counting[0]
        if all(setting in others for others in counting)
    }
    good = {s: m for s, m in measured.items() if MARGIN * m[1] <= tolerance}
    of = f"of a {kind} trade of {listing(item.analysis for item in trades)}"
    if not measured:
        return ORDINARY, np.nan, f"no setting {of} gives all rows"
    chosen, why = (
        (recommended(good), f"the cheapest {of}")
        if good
        else (
            min(measured, key=lambda setting: measured[setting][1]),
            f"no setting {of} meets the tolerance; the most accurate",
        )
    )
    return chosen, measured[chosen][1], why
