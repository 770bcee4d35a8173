"""What the samples of a run are plotted over: time, an input, or several on a grid."""

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.running.sampling import Sampling
from spherekit.analysis.scene import Axis
from spherekit.conventions import listing
from spherekit.sphere.rotation import Floats


def axes_of(course: Sampling, sample: NDArray[np.int64]) -> tuple[Axis, ...]:
    """Return what some samples (n,) are plotted over, with the span of the whole run.

    That is the time where samples are times, each input of a grid, and otherwise the
    first input that grows or falls throughout, or else the number of the sample.
    """
    if course.t is not None:
        return (_axis("time", "s", course.t, sample),)
    names = [item.pair for item in course.tracer.mechanism.inputs]
    degrees = np.degrees(course.inputs)
    if len(course.shape) > 1:
        return tuple(
            _axis(f"input {name}", "deg", column, sample)
            for name, column in zip(names, degrees.T, strict=True)
        )
    steps = np.diff(degrees, axis=0)
    steady = np.flatnonzero(np.all(steps > 0.0, axis=0) | np.all(steps < 0.0, axis=0))
    if not len(steady):
        return (_axis("sample", "", np.arange(float(len(course))), sample),)
    first = int(steady[0])
    others = listing(name for name in names if name != names[first])
    label = f"input {names[first]}" + (f" with {others}" if others else "")
    return (_axis(label, "deg", degrees[:, first], sample),)


def _axis(label: str, unit: str, whole: Floats, sample: NDArray[np.int64]) -> Axis:
    span = (float(np.min(whole)), float(np.max(whole))) if len(whole) else (0.0, 1.0)
    return Axis(label, unit, np.asarray(whole)[sample], span)
