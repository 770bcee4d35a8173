"""Samples predicted from nodes among them, all at once.

Where the samples of a block lie close together, every so many of them are nodes, found as
any sample is; the others are read from splines through these. Nothing is taken for closed
here: whoever asks has to look.
"""

from functools import cached_property
from typing import Any

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import TURN, Status
from spherekit.motion.motion import PositionAnalysis

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


class Predictor:
    """Predicts samples of a tracer from nodes, every so many of its samples."""

    def __init__(self, tracer: PositionAnalysis, every: int) -> None:
        self._tracer, self._every = tracer, every
        self._driven = list(tracer.solver.driven)
        every_one = range(len(tracer.mechanism.variable_owners))
        self._free = [v for v in every_one if v not in self._driven]
        self._angles = np.isin(self._free, tracer.solver.angles)

    @classmethod
    def of(cls, tracer: PositionAnalysis) -> "Predictor | None":
        """Return a predictor, None where samples do not lie close together along a path."""
        q = tracer.input_grid.q
        if not tracer.input_grid.is_path or not tracer.assembly_modes:
            return None
        if len(q) <= FEWEST * DEGREE:
            return None
        step = float(np.max(np.abs(np.diff(q, axis=0))))
        every = min(MOST, (len(q) - 1) // DEGREE)
        if step > 0.0:
            every = min(every, int(APART / step))
        return cls(tracer, every) if every >= FEWEST else None

    def read(self, start: int, stop: int, out: Floats) -> None:
        """Write variables (variables, modes, samples) of samples from `start` to `stop`.

        NaN where nothing is predicted.
        """
        out[:] = np.nan
        given = self._tracer.input_grid.q[start:stop].T
        for number, inputs in zip(self._driven, given, strict=True):
            out[number] = inputs
        for mode, first, last, spline in self._splines:
            low, high = max(start, first), min(stop, last + 1)
            if low < high:
                made = spline(np.arange(low, high, dtype=float)).T
                angles = made[self._angles]
                over = ~(np.abs(angles) < np.pi)
                angles[over] -= TURN * np.ceil((angles[over] - np.pi) / TURN)
                made[self._angles] = angles
                out[self._free, mode, low - start : high - start] = made

    @cached_property
    def _splines(self) -> list[tuple[int, int, int, Any]]:
        """Splines by the number of the sample, with their modes, first and last samples."""
        from scipy.interpolate import make_interp_spline

        count, modes = len(self._tracer.input_grid), len(self._tracer.assembly_modes)
        nodes = np.append(np.arange(0, count - 1, self._every), count - 1)
        values = np.empty((modes, len(nodes), len(self._free)))
        good = np.empty((modes, len(nodes)), dtype=bool)
        for start in range(0, len(nodes), PORTION):
            some = slice(start, start + PORTION)
            motion = self._tracer.samples(nodes[some])
            passive = motion.values[:, self._free]
            values[:, some] = passive.reshape(modes, -1, len(self._free))
            good[:, some] = (motion.status == Status.OK).reshape(modes, -1)
        made = []
        for mode in range(modes):
            edges = np.flatnonzero(np.diff(good[mode], prepend=False, append=False))
            for first, stop in edges.reshape(-1, 2).tolist():
                if stop - first <= DEGREE:
                    continue
                along, at = values[mode, first:stop], nodes[first:stop]
                along[:, self._angles] = np.unwrap(along[:, self._angles], axis=0)
                spline = make_interp_spline(at.astype(float), along, k=DEGREE)
                made.append((mode, int(at[0]), int(at[-1]), spline))
        return made
