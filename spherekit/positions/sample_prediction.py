"""Samples predicted from nodes among them, all at once.

Where the samples of a block lie close together, every so many of them are nodes, found as
any sample is; the others are read from splines through these. Nothing is taken for closed
here: whoever asks has to look.
"""

from collections.abc import Callable, Iterator
from functools import cache

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.conventions import TURN
from spherekit.geometry.rotation import max_abs
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.status import Status

DEGREE = 7
"""Of the splines."""
APART = 0.01
"""Inputs (rad) between two nodes: splines are then as good as rounding, but where modes
meet."""
FEWEST = 4
"""With fewer samples than this to a node prediction does not pay."""
MOST = 1024
"""Samples to a node at most."""
PORTION = 1024
"""Nodes that are found at once."""


Spline = Callable[[Floats], Floats]


def predictor(tracer: PositionAnalysis) -> Callable[[int, int, Floats], None] | None:
    """Return what predicts samples of a tracer from nodes, every so many of its samples.

    It writes the variables (variables, modes, samples) from one sample to before another
    into an array, NaN where nothing is predicted. None where samples do not lie close
    together along a path.
    """
    q = tracer.input_grid.q
    if not tracer.input_grid.is_path or not tracer.assembly_modes:
        return None
    step = max(APART / MOST, max_abs(np.diff(q, axis=0)))
    every = min(int(APART / step), (len(q) - 1) // DEGREE)
    if every < FEWEST:
        return None
    driven = list(tracer.solver.driven)
    free = np.delete(np.arange(len(tracer.mechanism.variable_owners)), driven)
    is_angle = np.isin(free, tracer.solver.angles)

    @cache
    def splines() -> list[tuple[int, int, int, Spline]]:
        return list(_splines(tracer, every, free, is_angle))

    def read(start: int, stop: int, out: Floats) -> None:
        out[:] = np.nan
        out[driven] = q[start:stop].T[:, None]
        for mode, first, last, spline in splines():
            low = max(start, first)
            high = min(stop, last + 1)
            if low < high:
                made = spline(np.arange(low, high, dtype=float)).T
                angles = made[is_angle]
                over = ~(np.abs(angles) < np.pi)
                angles[over] -= TURN * np.ceil((angles[over] - np.pi) / TURN)
                made[is_angle] = angles
                out[free, mode, low - start : high - start] = made

    return read


def _splines(
    tracer: PositionAnalysis, every: int, free: Indices, is_angle: Bools
) -> Iterator[tuple[int, int, int, Spline]]:
    """Yield splines by the number of the sample, with modes, first and last samples."""
    from scipy.interpolate import make_interp_spline

    last = len(tracer.input_grid) - 1
    modes = len(tracer.assembly_modes)
    nodes = np.append(np.arange(0, last, every), last)
    values = np.empty((modes, len(nodes), len(free)))
    good = np.empty((modes, len(nodes)), dtype=bool)
    for start in range(0, len(nodes), PORTION):
        some = slice(start, start + PORTION)
        motion = tracer.samples(nodes[some])
        values[:, some] = motion.values[:, free].reshape(modes, -1, len(free))
        good[:, some] = (motion.status == Status.OK).reshape(modes, -1)
    for mode in range(modes):
        edges = np.flatnonzero(np.diff(good[mode], prepend=False, append=False))
        for first, stop in edges.reshape(-1, 2):
            if stop - first <= DEGREE:
                continue
            along = values[mode, first:stop]
            at = nodes[first:stop]
            along[:, is_angle] = np.unwrap(along[:, is_angle], axis=0)
            yield mode, at[0], at[-1], make_interp_spline(at, along, k=DEGREE)
