"""How large the tables and the recording of a study will be, judged from short runs.

A run of few samples writes its files, and one of twice as many: all sizes grow as they do
from one to the other.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import reduce
from operator import getitem
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from spherekit.conventions import Facts
from spherekit.files.study import Study
from spherekit.planning.assembly_plan import Assembly
from spherekit.runs.contract import Analyses
from spherekit.runs.execution import Execution
from spherekit.runs.recording_session import MOST_LOGGED
from spherekit.runs.run_result import MOTION
from spherekit.runs.runner import executed, traced
from spherekit.tables.table import FILE_SIZE

LEAST = 4
"""Samples below which no short run is smaller than the run."""

FEW = 48
"""Samples of the longer one of two short runs."""

SHORT = 16
"""Samples of the shortest recording that is made."""


MANY_POLES = 400
"""Poles of a row beyond which a run of `FEW_OF_MANY` samples in one mode is measured.

Chains of 30 links have more, and the rates of all their links take seconds for some hundred
rows. More: such runs are measured with all their modes, for minutes at 60 links. Fewer: the
number of modes, and by how much they differ, are not known of smaller mechanisms.
"""

FEW_OF_MANY = 4
"""Samples of a run with many poles. They have thousands of rows."""

EVALUATED_OF_MANY = 100
"""Poles, besides axes of pairs, that are evaluated of many. More: expressions of all poles
of 60 links take as long as all else; fewer: the bytes of rows are known less well."""


def expected(study: Study, analyses: Analyses, assembly: Assembly, poles: int) -> Facts:
    """Return what a run of the study will evaluate and write, ready for JSON.

    Parameters
    ----------
    study, analyses, assembly
        The run, and the groups of its mechanism.
    poles
        How many poles are asked for at each configuration.

    Returns
    -------
    dict
        Where all groups are dyads and poles are not many, the assembly modes are found, as
        the run will find them. Otherwise that may take long: `assembly_modes` is None, and
        the figures are those of each assembly mode. `reason` says why there are no figures,
        if there are none.

    Raises
    ------
    SolveError
        If the mechanism cannot be assembled over its range.
    """
    if study.start is not None:
        return {"reason": "the motion follows from the loads, and is not known before"}
    samples = study.count
    if samples < LEAST:
        return {"reason": f"a run of {samples} samples is over before it is predicted"}
    has_many_poles = poles > MANY_POLES
    finds_modes = assembly.has_closed_form and not has_many_poles
    few = study if finds_modes else replace(study, search=False)
    half = min(samples, FEW) // 2
    able = [analysis for analysis in analyses if analysis.rowwise]
    follow = traced(study, analyses, Execution())

    def measure(chosen: Analyses, count: int, most_poles: int | None = None) -> Facts:
        """Return the summary of a run of so many samples."""
        with TemporaryDirectory() as folder:
            execution = Execution(folder=folder, formats=tuple(FILE_SIZE))
            study = shortened(few, count)
            return executed(study, chosen, execution, follow, most_poles).summary

    # The positions alone are quick to find, whatever is asked of them.
    cheap = [] if has_many_poles else able
    shorter = measure(cheap, half)
    longer = measure(cheap, 2 * half)
    asked = longer
    if has_many_poles:
        asked = measure(able, min(samples, FEW_OF_MANY), EVALUATED_OF_MANY)
    modes = len(longer["assembly_modes"])
    multiple = modes if finds_modes else min(modes, 1)

    def grown(*keys: str) -> int:
        if has_many_poles and keys[1:2] != (MOTION,):
            # What does not grow with the samples is little of such tables.
            whole = reduce(getitem, keys, asked["cost"]) * samples / FEW_OF_MANY
        else:
            one, two = (reduce(getitem, keys, x["cost"]) for x in (shorter, longer))
            whole = one + (two - one) * (samples - half) / half
        return round(whole * multiple / max(modes, 1))

    failed = {item["name"] for item in asked["analyses"] if item["failed"]}
    names = {analysis.name for analysis in able} - failed
    return {
        "assembly_modes": modes if finds_modes else None,
        "configurations": grown("configurations"),
        "tables": {
            stem: {
                "rows": grown("tables", stem, "rows"),
                "columns": table["columns"],
                **{
                    f"{kind}_bytes": grown("tables", stem, f"{kind}_bytes")
                    for kind in FILE_SIZE
                },
            }
            for stem, table in asked["cost"]["tables"].items()
        },
        "velocity_equation_solves": grown("velocity_equation_solves"),
        "not_predicted": [a.name for a in analyses if a.name not in names],
    }


def shortened(study: Study, samples: int) -> Study:
    """Return the study with so many of its samples, along a path through its ranges."""
    path = study.path
    if path is not None:
        path = path[np.linspace(0, len(path) - 1, samples).astype(int)]
    return replace(study, samples=samples, grid=False, path=path, verify=None)


def extrapolated_recording(
    study: Study,
    analyses: Analyses,
    made: Callable[[int], Any],
) -> dict[str, int]:
    """Return the entities, rows and bytes that the recording of a study will have.

    From two short ones. `made` gives a recorder of `spherekit.display` for each.
    """
    costs: list[dict[str, int]] = []
    for samples in (SHORT, 2 * SHORT):
        with made(samples) as recorder:
            executed(shortened(study, samples), analyses, Execution(recorder=recorder))
            costs.append(recorder.cost)
    one, two = costs
    total = study.count
    more = -(-total // -(-total // MOST_LOGGED)) / SHORT - 1.0
    return {key: round(one[key] + more * (two[key] - one[key])) for key in one}
