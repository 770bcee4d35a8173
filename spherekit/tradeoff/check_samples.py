"""The samples of a course at which errors are measured."""

from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.running.sampling import Sampling
from spherekit.motion.motion import Tracer
from spherekit.rates.field import evaluate
from spherekit.rates.request import Request
from spherekit.sphere.rotation import Floats

PEAKS = 8
"""Places of worst conditioning around which more samples are taken, in every step."""


def places(course: Sampling, most: int, wanted: Request) -> NDArray[np.intp]:
    """Return numbers of samples: `most` evenly, and more where axes are least certain.

    There errors of rounding and of functions read from nodes are largest. Between the
    samples beside each peak of the error bounds the middle ones are added, until
    neighbours are reached.
    """
    total, q = len(course), course.inputs[:, 0]
    ends = [0, total - 1, int(np.argmin(q)), int(np.argmax(q))]
    rows = np.unique([*np.linspace(0, total - 1, most).astype(np.intp), *ends])
    if course.inputs.shape[1] > 1 or not wanted.poles:
        return np.asarray(rows, dtype=np.intp)
    bound = _bounds(course, rows, wanted)
    while True:
        peaks = _peaks(bound)
        at = np.unravel_index(peaks, bound.shape)[1]
        gaps = np.unique(np.concatenate([at, at - 1]))
        gaps = gaps[(gaps >= 0) & (gaps < len(rows) - 1)]
        middle = (rows[gaps] + rows[gaps + 1]) // 2
        more = np.setdiff1d(middle, rows)
        if not len(more):
            return np.asarray(rows, dtype=np.intp)
        order = np.argsort(np.concatenate([rows, more]), kind="stable")
        rows = np.concatenate([rows, more])[order]
        added = _bounds(course, more, wanted)
        bound = np.concatenate([bound, added], axis=1)[:, order]


def at_places(course: Sampling, rows: NDArray[np.intp], search: bool) -> Sampling:
    """Return the course that runs through some samples of another only."""
    tracer = course.tracer
    only = tracer.assembly_modes[0].number if len(tracer.assembly_modes) == 1 else None
    q, timing = course.inputs[rows], course.timing
    return replace(
        course,
        tracer=Tracer(tracer.mechanism, None, only, search, path=q),
        inputs=q,
        shape=(len(q),),
        clock=None if timing is None else partial(timing.rows, rows),
    )


def _bounds(course: Sampling, rows: NDArray[np.intp], wanted: Request) -> Floats:
    """Return (assembly modes, samples) the largest bound of a direction of the plan."""
    motion = course.tracer.samples(rows)
    field = evaluate(motion, wanted, route="conditioned")
    largest = np.zeros(len(motion))
    for error in field.error.values():
        largest = np.fmax(largest, error)
    return largest.reshape(-1, motion.samples)


def _peaks(bound: Floats) -> NDArray[np.intp]:
    """Return the flat numbers of the highest local maxima along the samples."""
    beside = np.pad(bound, ((0, 0), (1, 1)), constant_values=-1.0)
    top = (bound >= beside[:, :-2]) & (bound >= beside[:, 2:])
    tops = np.flatnonzero(top)
    return tops[np.argsort(bound.ravel()[tops])[::-1][:PEAKS]]
