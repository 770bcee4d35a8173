"""What a study will cost, said before it is run."""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from spherekit.analysis.contract import AbstractAnalysis, Batch, Needs
from spherekit.analysis.course import DEFAULT_TOLERANCE, course_of
from spherekit.analysis.forecast import LEAST, extrapolated, forecast
from spherekit.analysis.made_up import made_up_motion
from spherekit.analysis.recording import MOST_LOGGED
from spherekit.analysis.run import run
from spherekit.files.study import Study
from spherekit.motion.continued import AngleMemory
from spherekit.motion.motion import DEFAULT_SAMPLES, Motion, samples_in_block
from spherekit.planning.assembly import Assembly
from spherekit.rates.request import Request

TRIED = 361
"""Samples over which branches are looked for when only their number is wanted."""


def expected(
    study: Study,
    analyses: Sequence[AbstractAnalysis],
    assembly: Assembly,
    wanted: Sequence[Request],
) -> dict[str, Any]:
    """Return what a run of the study will cost, ready for JSON.

    Where all groups are dyads the branches are found, as the run will; otherwise the
    search may take long, `branches` is None, and the cost is that of each branch.
    `reason` says why there is no prediction, where there is none.

    Raises
    ------
    SolveError
        If the mechanism cannot be assembled over its range.
    """
    if study.start is not None:
        return {"reason": "the motion follows from the loads, and is not known before"}
    mechanism = study.mechanism
    samples = _samples(study)
    if samples < LEAST:
        return {"reason": f"a run of {samples} samples is over before it is predicted"}
    own = [analysis.needs(mechanism) for analysis in analyses]
    if not assembly.has_closed_form:
        return {"branches": None} | _of_a_branch(analyses, own, assembly, wanted, samples)
    if study.path is not None:
        rows = np.unique(np.linspace(0, samples - 1, min(samples, TRIED)).astype(np.intp))
        path = np.array(study.path)[rows]
    started = time.process_time()
    course = course_of(
        mechanism,
        samples=_fewer(study.samples or DEFAULT_SAMPLES),
        input_pair=None,
        branch=study.branch,
        search=study.search,
        grid=False,
        path=None if study.path is None else path,
        laws=study.laws,
        duration=study.duration,
        start=None,
        torque=None,
        tolerance=DEFAULT_TOLERANCE,
        engine="auto",
    )
    searched = time.process_time() - started
    found = forecast(course, analyses, own, wanted, samples, course.tracer.block)
    return found | {"seconds": {"search": searched, **found["seconds"]}}


def _samples(study: Study) -> int:
    if study.path is not None:
        return len(study.path)
    return int(np.prod(study.samples or DEFAULT_SAMPLES))


def _fewer(samples: int | tuple[int, ...]) -> int | tuple[int, ...]:
    """Return samples, or the shape of a grid, with no more than are needed to search."""
    if isinstance(samples, int):
        return min(samples, TRIED)
    most = max(2, int(TRIED ** (1.0 / len(samples))))
    return tuple(min(count, most) for count in samples)


def _of_a_branch(
    analyses: Sequence[AbstractAnalysis],
    own: Sequence[Needs],
    assembly: Assembly,
    wanted: Sequence[Request],
    samples: int,
) -> dict[str, Any]:
    mechanism = wanted[0].plan.mechanism
    plans = tuple(item.plan for item in wanted)

    def few(count: int) -> Motion:
        return made_up_motion(mechanism, assembly, count)

    def batch(motion: Motion, needs: Needs, found: Any) -> Batch:
        angles = AngleMemory().continued(motion, needs.continued_values)
        return Batch(mechanism, plans, needs, motion, found, angles)

    block = samples_in_block(1)
    return extrapolated(few, batch, analyses, own, wanted, 1, samples, block)


def with_samples(study: Study, samples: int | tuple[int, ...] | None) -> Study:
    """Return the study with so many samples, if any are given."""
    return study if samples is None else replace(study, samples=samples, path=None)


SHORT = 16
"""Samples of the shortest recording that is made for a prediction."""


def extrapolated_recording(
    study: Study,
    analyses: Sequence[AbstractAnalysis],
    made: Callable[[int], Any],
) -> dict[str, int]:
    """Return the entities, rows and bytes that the recording of a study will have.

    From three short ones: what stays once, each block of samples and each sample take
    bytes of their own. `made` gives a recorder of `spherekit.view` for each.
    """

    def recorded(samples: int, block: int) -> tuple[int, int, int, int]:
        path = study.path
        if path is not None:
            path = tuple(
                path[k] for k in np.linspace(0, len(path) - 1, samples).astype(int)
            )
        with made(samples + block) as recorder:
            result = run(
                study.mechanism,
                analyses,
                samples=samples,
                path=None if path is None else np.array(path),
                branch=study.branch,
                search=study.search,
                laws=study.laws,
                duration=study.duration,
                recorder=recorder,
                block=block,
            )
            found = recorder.cost
        branches = len(result.summary["branches"])
        return branches, found["entities"], found["rows"], found["bytes"]

    _, _, few, one = recorded(SHORT, SHORT)
    _, _, _, cut = recorded(2 * SHORT, SHORT)
    branches, entities, many, two = recorded(2 * SHORT, 2 * SHORT)
    each_block, each = cut - two, (two - one) / SHORT
    total = _samples(study)
    samples = -(-total // -(-total // MOST_LOGGED))
    blocks = min(samples, -(-total // samples_in_block(branches)))
    return {
        "entities": entities,
        "rows": round(few + (many - few) / SHORT * (samples - SHORT)),
        "bytes": round(one + each_block * (blocks - 1) + each * (samples - SHORT)),
    }
