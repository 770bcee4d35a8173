"""Prediction of the size of the tables and of the recording of a run, from two short runs.

The short runs write their files. All sizes are extrapolated linearly in the number of
samples.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from spherekit.conventions import Facts
from spherekit.files.study import Study
from spherekit.planning.assembly_plan import Assembly
from spherekit.runs.contract import Analyses
from spherekit.runs.execution import Execution
from spherekit.runs.recording_session import MAX_RECORDED_SAMPLES
from spherekit.runs.run_result import MOTION
from spherekit.runs.runner import needs_motion, run_study
from spherekit.tables.table_formats import DEFAULT_FORMATS, TABLE_FORMATS

MIN_PREDICTED_SAMPLES = 4
"""Runs of fewer samples are not predicted, since the short runs would not be shorter."""

MEASURED_SAMPLES = 48
"""Number of samples of the longer of the two short runs.

Larger: prediction takes longer; smaller: sizes are extrapolated from fewer rows.
"""

MEASURED_RECORDING_SAMPLES = 16
"""Number of samples of the shorter of the two recordings that are made."""

MAX_POLES = 400
"""Number of poles of a row above which `MEASURED_SAMPLES_OF_MANY_POLES` are measured.

Chains of 30 links have more, and the rates of all their links take seconds for some hundred
rows. Larger: such runs are measured with all their assembly modes, for minutes at 60 links.
Smaller: the number of modes is not known for smaller mechanisms.
"""

MEASURED_SAMPLES_OF_MANY_POLES = 4
"""Samples of the measured run if there are many poles. It has thousands of rows."""

EVALUATED_POLES_OF_MANY = 100
"""Number of poles that are evaluated if there are many, besides the axes of pairs.

Larger: expressions of all poles of 60 links take as long as everything else; smaller: the
bytes of rows are known less well.
"""


def predict_run(
    study: Study, analyses: Analyses, assembly: Assembly, pole_count: int
) -> Facts:
    """Predict what a run of a study will evaluate and write, ready for JSON.

    Parameters
    ----------
    study, analyses
        The run: its mechanism and samples, and what it computes.
    assembly
        The groups of links of the mechanism that are positioned one after another.
    pole_count
        Number of poles that are evaluated at each configuration.

    Returns
    -------
    dict
        - ``assembly_modes``: the number of assembly modes (ways to assemble the mechanism).
          None if the search for modes can take long: if not all groups are dyads (two links
          with three R pairs), or if there are many poles. With None, all other numbers hold
          for a single assembly mode.
        - ``configurations``: the number of configurations.
        - ``tables``: for each table how many rows, columns and bytes it has.
        - ``velocity_equation_solves``: how often velocity equations are solved.
        - ``not_predicted``: names of the analyses for which no table sizes are predicted.

        If nothing is predicted, the only key is ``reason``, which says why.

    Raises
    ------
    SolveError
        If the mechanism cannot be assembled over its range.
    """
    if study.start is not None:
        return {
            "reason": "the motion follows from the loads, so it is not known beforehand"
        }
    samples = study.count
    if samples < MIN_PREDICTED_SAMPLES:
        return {"reason": f"a run of {samples} samples takes less time than its prediction"}
    has_many_poles = pole_count > MAX_POLES
    finds_modes = assembly.has_closed_form and not has_many_poles
    measured_study = study if finds_modes else replace(study, search=False)
    # The first short run has this number of samples, the second twice as many.
    short_count = min(samples, MEASURED_SAMPLES) // 2
    # The tables of other analyses need not grow with the samples.
    rowwise_analyses = [analysis for analysis in analyses if analysis.rowwise]
    computes_motion = needs_motion(study, analyses, Execution())

    def measure(
        measured_analyses: Analyses, sample_count: int, max_poles: int | None = None
    ) -> Facts:
        """Return the summary of a run of some samples, which writes files."""
        with TemporaryDirectory() as folder:
            return run_study(
                shorten_study(measured_study, sample_count),
                measured_analyses,
                Execution(folder=folder, formats=DEFAULT_FORMATS),
                computes_motion,
                max_poles,
            ).summary

    # With many poles the two short runs only compute positions, which is fast. The tables
    # of the analyses are measured in a third run, of a few samples and a part of the poles.
    short_analyses = [] if has_many_poles else rowwise_analyses
    shorter = measure(short_analyses, short_count)
    longer = measure(short_analyses, 2 * short_count)
    measured = longer
    if has_many_poles:
        measured = measure(
            rowwise_analyses,
            min(samples, MEASURED_SAMPLES_OF_MANY_POLES),
            EVALUATED_POLES_OF_MANY,
        )
    mode_count = len(longer["assembly_modes"])
    extrapolation = CostExtrapolation(
        sample_count=samples,
        short_count=short_count,
        shorter=shorter["cost"],
        longer=longer["cost"],
        of_many_poles=measured["cost"] if has_many_poles else None,
        measured_modes=mode_count,
        predicted_modes=mode_count if finds_modes else min(mode_count, 1),
    )
    failed = {item["name"] for item in measured["analyses"] if item["failed"]}
    predicted_names = {analysis.name for analysis in rowwise_analyses} - failed
    tables = {}
    for stem, table in measured["cost"]["tables"].items():
        tables[stem] = {
            "rows": extrapolation.predict("tables", stem, "rows"),
            "columns": table["columns"],
        }
        for name in DEFAULT_FORMATS:
            key = f"{TABLE_FORMATS[name].ending}_bytes"
            tables[stem][key] = extrapolation.predict("tables", stem, key)
    return {
        "assembly_modes": mode_count if finds_modes else None,
        "configurations": extrapolation.predict("configurations"),
        "tables": tables,
        "velocity_equation_solves": extrapolation.predict("velocity_equation_solves"),
        "not_predicted": [a.name for a in analyses if a.name not in predicted_names],
    }


@dataclass(frozen=True)
class CostExtrapolation:
    """Predicts the cost of a run from the costs of short runs of the same study.

    The cost is a nested dictionary of numbers, such as the number of configurations, and of
    the rows and bytes of each table.

    Attributes
    ----------
    sample_count
        Number of samples of the predicted run.
    short_count
        Number of samples of the shorter one of two runs. The longer run has twice as many.
    shorter, longer
        The costs of these two runs. If there are many poles, the runs only have the table
        of the motion.
    of_many_poles
        The cost of a third run, which has all tables and `MEASURED_SAMPLES_OF_MANY_POLES`
        samples. None if there are not many poles.
    measured_modes, predicted_modes
        Number of assembly modes of the short runs and of the prediction.
    """

    sample_count: int
    short_count: int
    shorter: Facts
    longer: Facts
    of_many_poles: Facts | None
    measured_modes: int
    predicted_modes: int

    def predict(self, *keys: str) -> int:
        """Return a predicted cost of a long run, such as the size of a table.

        The cost is usually extrapolated from two short runs with all tables. If there are
        many poles (axes of the relative rotation of two links), such runs would take too
        long. The two short runs then compute only the table of the motion, which is fast.
        All other costs are measured in a third run of very few samples. They are multiplied
        by the ratio of the numbers of samples.

        Parameters
        ----------
        keys
            The nested keys of the cost, such as ``"tables", "motion", "csv_bytes"`` or
            ``"configurations"``.
        """
        is_in_motion_table = len(keys) > 1 and keys[1] == MOTION
        third_run_cost = self.of_many_poles  # None if there are few poles
        if third_run_cost is None or is_in_motion_table:
            value = self._extrapolate_linearly(keys)
        else:
            value = self._scale_many_poles(third_run_cost, keys)
        # The value is proportional to the number of assembly modes.
        return round(value * self.predicted_modes / max(self.measured_modes, 1))

    def _extrapolate_linearly(self, keys: Sequence[str]) -> float:
        """Return a value at `sample_count`, on the line through the two short runs."""
        short_value = _entry(self.shorter, keys)
        # Between the two runs the number of samples grows by `short_count`.
        growth = _entry(self.longer, keys) - short_value
        further_samples = self.sample_count - self.short_count
        return float(short_value + growth * further_samples / self.short_count)

    def _scale_many_poles(self, of_many_poles: Facts, keys: Sequence[str]) -> float:
        """Return the predicted value of one cost, in proportion to the number of samples.

        `keys` lead to the value in the costs `of_many_poles` of a short run. With many
        poles (axes of relative rotation of two links), the constant part of a table is
        negligible. So one short run is enough.
        """
        value = _entry(of_many_poles, keys)
        return float(value * self.sample_count / MEASURED_SAMPLES_OF_MANY_POLES)


def _entry(cost: Facts, keys: Sequence[str]) -> Any:
    """Return the entry of nested dictionaries at a sequence of keys."""
    entry: Any = cost
    for key in keys:
        entry = entry[key]
    return entry


def shorten_study(study: Study, samples: int) -> Study:
    """Return a study with fewer samples, along a path through its ranges."""
    path = study.path
    if path is not None:
        path = path[np.linspace(0, len(path) - 1, samples).astype(int)]
    return replace(study, samples=samples, grid=False, path=path, verify=None)


def predict_recording(
    study: Study,
    analyses: Analyses,
    make_recorder: Callable[[int], Any],
) -> dict[str, int]:
    """Predict the size of the recording of a study, from the recordings of two short runs.

    A recording is a file in which users see the motion. Its size is a linear function of
    the number of recorded samples.

    Parameters
    ----------
    study
        The motion that the run analyses.
    analyses
        The analyses of the run.
    make_recorder
        Function of a number of samples that returns a recorder of `spherekit.display`.

    Returns
    -------
    The predicted numbers of entities (names in the tree of the viewer), rows and bytes,
    with the keys "entities", "rows" and "bytes".
    """
    short_count = MEASURED_RECORDING_SAMPLES
    costs: list[dict[str, int]] = []
    for samples in (short_count, 2 * short_count):
        with make_recorder(samples) as recorder:
            run_study(shorten_study(study, samples), analyses, Execution(recorder=recorder))
            costs.append(recorder.cost)
    short_cost, long_cost = costs
    sample_count = study.count
    # A long run does not record all samples, but about one of `stride` successive samples.
    # -(-a // b) is a / b, rounded up.
    stride = -(-sample_count // MAX_RECORDED_SAMPLES)
    recorded_samples = -(-sample_count // stride)
    growth_factor = recorded_samples / short_count - 1.0
    return {
        key: round(short_cost[key] + growth_factor * (long_cost[key] - short_cost[key]))
        for key in short_cost
    }
