"""Chooses the setting of a run for a tolerance, and measures the error that it reaches."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from spherekit.argument_validation import checked
from spherekit.conventions import Facts
from spherekit.errors import AnalysisError, PluginError
from spherekit.files.study import Study
from spherekit.runs.contract import Analyses
from spherekit.runs.evaluation_options import ORDINARY, Setting
from spherekit.runs.run_identity import differences
from spherekit.runs.run_plan import RunPlan
from spherekit.runs.sampling import make_sampling
from spherekit.runs.simulation_measurement import make_analysis_plan
from spherekit.runs.table_deviation import Deviation, find_largest_deviation
from spherekit.runs.trade import trade
from spherekit.runs.trade_files import describe_run, folder_of_trade, read_trade
from spherekit.runs.trade_measurement import measure_run, reads_motion_quantities
from spherekit.runs.trade_record import (
    MARGIN,
    Cost,
    Measured,
    Trade,
    check_tolerance,
    choose_most_accurate_fast_option,
)
from spherekit.storage.json_data import finite_or_none
from spherekit.wording import listing

MIN_SAMPLES_FOR_TRADE = 50_000
"""Number of samples from which on a short trade is made.

It costs little compared with such a run. Larger: runs use the ordinary setting although
another one is faster. Smaller: the trade takes a large part of the time of the run.
"""

SHORT_TRADE_SAMPLES = 121
"""Number of samples of a short trade.

Larger: more certain errors and times, in more time.
"""

SHORT_TRADE_OPTIONS = {
    "settings": (ORDINARY, Setting(route="conditioned"), Setting(engine="compiled")),
    "checked": SHORT_TRADE_SAMPLES,
    "rounds": 1,
}
"""Options of `trade` with which a short trade is made."""


@checked(AnalysisError)
def choose(
    study: Study,
    analyses: Analyses,
    tolerance: float,
    stored: Sequence[Trade] = (),
) -> tuple[Setting, Facts]:
    """Return the cheapest setting with errors within a tolerance, and what it reaches.

    A trade is a measurement: the time and the error of each setting (way to compute the
    run). If there are stored trades, the setting is chosen from them. Without stored
    trades, a short trade is made if the run has at least `MIN_SAMPLES_FOR_TRADE` samples. A
    run with fewer samples has the ordinary setting, and so has a run without settings to
    compare. A setting must meet the tolerance with the margin `MARGIN`. If none does, the
    most accurate one is used.

    Parameters
    ----------
    study
        The run.
    analyses
        The analyses of the run.
    tolerance
        Largest error of a column, scaled as `spherekit.runs.trade_measurement` describes.
    stored
        Trades of the analyses that were made before.

    Returns
    -------
    setting
        The setting.
    record
        For the summary of the run: the setting, why it was chosen, the largest error that a
        trade measured, and the error at some rows of the run itself. None stands for an
        unknown error. No rows of a simulation are checked. The key ``met`` says whether the
        error at these rows is known and within the tolerance. Without such rows, the error
        of the trade decides.

    Raises
    ------
    AnalysisError
        If the tolerance is not a positive number; other errors as `spherekit.run`.
    """
    check_tolerance(study.mechanism.name, tolerance)
    trades = list(stored)
    # Errors depend on the setting only in some analyses. There is a run for each of these
    # analyses, but none for a simulation.
    run_plans: list[RunPlan] = []
    if study.start is None:
        sampling = make_sampling(study)
        for analysis in analyses:
            # An analysis that fails is left out here. The run itself reports the failure.
            with suppress(AnalysisError, PluginError):
                run_plan = make_analysis_plan(sampling, analysis)
                if not analysis.trades and reads_motion_quantities(run_plan):
                    run_plans.append(run_plan)
    # The choice: from trades, if there are any.
    if not stored and study.count >= MIN_SAMPLES_FOR_TRADE:
        for run_plan in run_plans:
            with suppress(AnalysisError, PluginError):
                if run_plan.requests[0].poles:
                    (analysis,) = run_plan.analyses
                    trades.append(trade(study, analysis, **SHORT_TRADE_OPTIONS))
    if trades:
        choice = _choose_from_trades(trades, tolerance, "stored" if stored else "short")
    else:
        cause = "no settings could be compared"
        if study.count < MIN_SAMPLES_FOR_TRADE:
            cause = f"there are fewer than {MIN_SAMPLES_FOR_TRADE} samples"
        reason = f"nothing was measured, since {cause}"
        choice = SettingChoice(ORDINARY, np.nan, reason)

    # The error that the chosen setting reaches at some rows of the run.
    deviations: list[Deviation] = []
    row_count = 0
    for run_plan in run_plans:
        with suppress(AnalysisError, PluginError):
            (analysis,) = run_plan.analyses
            plan_with_setting = make_analysis_plan(
                run_plan.sampling, analysis, choice.setting
            )
            run_deviations, row_count = measure_run(plan_with_setting)
            deviations += run_deviations
    largest = find_largest_deviation(deviations)
    achieved_error = np.nan if largest is None else largest.error
    decisive_error = achieved_error if row_count else choice.error
    return choice.setting, {
        "tolerance": tolerance,
        "setting": str(choice.setting),
        "what": choice.setting.describe(),
        "why": choice.reason,
        "predicted_error": finite_or_none(choice.error),
        "achieved_error": finite_or_none(achieved_error),
        "worst_column": "" if largest is None else largest.column,
        "check_rows": row_count,
        "met": bool(decisive_error <= tolerance),
    }


def read_stored_trades(
    study: Study, analyses: Analyses, paths: Sequence[str]
) -> list[Trade]:
    """Read the trades that were stored for the analyses of a run, and check them.

    A trade is a measurement of speed against accuracy: the settings of a run (ways to
    compute it), each with its time and error. It belongs to one analysis.

    Parameters
    ----------
    study
        The study of the run.
    analyses
        The analyses of the run.
    paths
        Folders or files with one trade each.

    Returns
    -------
    One trade for each analysis.

    Raises
    ------
    AnalysisError
        If a trade was made for another run or analysis, or if an analysis has no trade.
    """
    trades: dict[str, Trade] = {}
    for path in paths:
        stored_trade = read_trade(path)
        analyses_of_trade = [
            item for item in analyses if item.name == stored_trade.analysis
        ]
        if not analyses_of_trade:
            raise AnalysisError(
                f"{path}: the trade was measured for analysis {stored_trade.analysis}, "
                "which is not part of this run; the run has "
                f"{listing(item.name for item in analyses)}: leave this "
                "--trade out"
            )
        run_description = describe_run(study, analyses_of_trade[0])
        if differing := differences(stored_trade.made_for, run_description):
            raise AnalysisError(
                f"{path}: the trade was made for another run ({differing}); make it for "
                f"this one with: spherekit trade {run_description['mechanism']} -a "
                f"{run_description['analysis']} -o {folder_of_trade(path)} and the "
                "options of the run, or leave --trade out"
            )
        # A trade can also compare values of a parameter of the analysis, without settings.
        has_settings = any(
            measured.setting is not None for measured in stored_trade.settings
        )
        if not has_settings:
            raise AnalysisError(
                f"{path}: the trade compares values of a parameter of "
                f"{stored_trade.analysis}, not settings of a run; give the parameter "
                "with -a NAME:key=value, and leave --trade out"
            )
        trades[stored_trade.analysis] = stored_trade
    lacking = [analysis.name for analysis in analyses if analysis.name not in trades]
    if lacking:
        raise AnalysisError(
            f"--trade: there is no trade for {listing(lacking)}; make one with: spherekit "
            f"trade FILE -a {lacking[0]} -o DIR, and give --trade once for each analysis"
        )
    return list(trades.values())


@dataclass(frozen=True)
class SettingChoice:
    """A setting (way to compute a run) that was chosen for a run, with the reason.

    Attributes
    ----------
    setting
        The chosen setting.
    error
        Largest error that was measured with this setting; NaN if none was measured.
    reason
        The reason of the choice, as a phrase for users.
    """

    setting: Setting
    error: float
    reason: str


def _choose_from_trades(
    trades: Sequence[Trade], tolerance: float, kind: str
) -> SettingChoice:
    """Return the cheapest setting that meets a tolerance with a margin in all trades.

    A trade is a measurement of speed against accuracy, for one analysis: the settings of a
    run (ways to compute it), each with its time and error. Measured times scatter, so
    settings that are about as fast as the fastest one count as equally cheap. Of these the
    most accurate one is returned. If no setting meets the tolerance with the margin
    `MARGIN`, the most accurate of all is returned.

    Parameters
    ----------
    trades
        One trade for each analysis. Only settings that all of them contain are considered.
    tolerance
        Largest error that is accepted. In the tables of an analysis, errors of angles are
        absolute (rad). All other errors are relative to the largest value of the same unit.
    kind
        Adjective for the trades in the reason, such as ``"stored"``.
    """
    # For each trade, its usable settings with their times and errors. A setting is usable
    # (`counts`) if it could be run and has computed all values that the reference has.
    # A trade can also contain measurements for values of a parameter of the analysis. They
    # have no setting, and are left out.
    measured_of_trades: list[dict[Setting, Measured]] = []
    for analysis_trade in trades:
        measured_by_setting = {}
        for measured in analysis_trade.settings:
            if measured.setting and measured.counts:
                measured_by_setting[measured.setting] = measured
        measured_of_trades.append(measured_by_setting)
    # The total time and the largest error of each setting over all trades.
    costs: dict[Setting, Cost] = {}
    for setting in measured_of_trades[0]:
        if all(setting in by_setting for by_setting in measured_of_trades):
            measurements = [by_setting[setting] for by_setting in measured_of_trades]
            costs[setting] = Cost(
                seconds=sum(measured.total for measured in measurements),
                error=max(measured.error for measured in measurements),
            )
    origin = f"of a {kind} trade of {listing(item.analysis for item in trades)}"
    if not costs:
        # Without a usable setting, the default setting is taken.
        return SettingChoice(ORDINARY, np.nan, f"no setting {origin} computes all rows")
    # Errors were measured at some samples only, so they need a margin.
    sufficient_costs = {
        setting: cost for setting, cost in costs.items() if MARGIN * cost.error <= tolerance
    }
    if sufficient_costs:
        setting = choose_most_accurate_fast_option(sufficient_costs)
        reason = f"the cheapest {origin}"
    else:
        setting = min(costs, key=lambda candidate: costs[candidate].error)
        reason = (
            f"no setting {origin} meets the tolerance with a margin of {MARGIN:g}; "
            "the most accurate"
        )
    return SettingChoice(setting, costs[setting].error, reason)
