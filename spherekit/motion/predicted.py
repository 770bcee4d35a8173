"""Samples predicted from nodes among them, all at once.

Where the samples of a block lie close together, every so many of them are nodes, found as
any sample is; the others are read from splines through these. Nothing is taken for closed
here: whoever asks has to look.
"""

from functools import cached_property
from typing import Any, final

import numpy as np

from spherekit.conventions import TURN, Status
from spherekit.motion.motion import Tracer
from spherekit.sphere.rotation import Floats, max_abs

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


@final
class Predictor:
    """Predicts samples of a tracer from nodes, every so many of its samples."""

    def __init__(self, tracer: Tracer, every: int) -> None:
        self._tracer, self._every = tracer, every
        self._driven = list(tracer.solver.driven)
        every_one = range(len(tracer.mechanism.variable_owners))
        self._free = [v for v in every_one if v not in self._driven]
        self._angles = np.isin(self._free, tracer.solver.angles)

    @classmethod
    def of(cls, tracer: Tracer) -> "Predictor | None":
        """Return a predictor, None where samples do not lie close together along a path."""
        q = tracer.input_grid.q
        if not tracer.input_grid.is_path or not tracer.assembly_modes:
            return None
        if len(q) <= FEWEST * DEGREE:
            return None
<<<<<<< HEAD
        step = float(max_abs(np.diff(q, axis=0)))
        every = min(MOST, (len(q) - 1) // (STENCIL - 1))
=======
        step = float(np.max(np.abs(np.diff(q, axis=0))))
        every = min(MOST, (len(q) - 1) // DEGREE)
>>>>>>> 8838184d (Samples are read from splines, closed forms from the inputs alone; bounds by imaginary steps)
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

<<<<<<< HEAD
        `place` is where in `out` the first node lies.
        """
        values, good = nodes
        first, usable = _stencils(good)
        every = self._every
        for mode in range(values.shape[1]):
            offset = np.arange(first.shape[1]) - first[mode]
            alike = np.where(usable[mode], offset, -1)[slice(*windows)]
            edges = np.flatnonzero(np.diff(alike)) + 1
            for run in np.split(np.arange(*windows), edges):
                most = max(1, PRODUCT // (STENCIL * every * len(self._free)))
                for k in range(0, len(run), most):
                    part = run[k : k + most]
                    low = place + int(part[0]) * every
                    rows = slice(max(0, low), min(out.shape[2], low + len(part) * every))
                    if rows.start >= rows.stop:
                        continue
                    if alike[part[0] - windows[0]] < 0:
                        out[:, mode, rows] = np.nan
                        continue
                    at = first[mode, part[0]] + np.arange(len(part))
                    made = self._read(values[:, mode], part, at)
                    for number, samples in zip(self._free, made, strict=True):
                        out[number, mode, rows] = samples[
                            rows.start - low : rows.stop - low
                        ]

    def _read(
        self, values: Floats, windows: NDArray[np.intp], at: NDArray[np.intp]
    ) -> Floats:
        """Return (free variables, samples) in windows with stencils (k,) from `at` on."""
        values = values[self._free]
        base = values[:, windows, None]
        away = values[:, at[:, None] + np.arange(STENCIL)] - base
        angles = self._angles[self._free]
        away[angles] -= TURN * np.round(away[angles] / TURN)
        far = max_abs(base[:, :, 0], axis=1) + max_abs(away, axis=(1, 2))
        offset = int(windows[0] - at[0])
        away[:, :, offset] = base[:, :, 0]
        made = (away.reshape(-1, STENCIL) @ _weights(self._every)[offset]).reshape(
            len(values), -1
        )
        for number in np.flatnonzero(angles & (far >= np.pi)):
            _wrap(made[number])
        return np.asarray(made)

    def _found(self, samples: NDArray[np.intp]) -> "Nodes":
        """Return the variables (variables, modes, k) of samples, and which are good."""
        motion = self._tracer.samples(samples)
        modes = len(self._tracer.assembly_modes)
        values = motion.values.reshape(modes, len(samples), -1)
        good = (motion.status == Status.OK).reshape(modes, -1)
        return np.moveaxis(values, 2, 0), good

    def _nodes(self, start: int, stop: int) -> "Nodes":
        """Return nodes by their numbers, found in portions and kept while they are near."""
        portions = range(start // PORTION, (stop - 1) // PORTION + 1)
        for number in portions:
            if number not in self._known:
                nodes = np.arange(number * PORTION, (number + 1) * PORTION)
                nodes = nodes[nodes <= self._last]
                self._known[number] = self._found(nodes * self._every)
        self._known = {n: kept for n, kept in self._known.items() if n >= portions[0]}
        values, good = (
            np.concatenate([self._known[n][k] for n in portions], axis=-1) for k in (0, 1)
        )
        first = portions[0] * PORTION
        return values[:, :, start - first : stop - first], good[
            :, start - first : stop - first
        ]


Nodes = tuple[Floats, NDArray[np.bool_]]
"""Variables (variables, modes, k) of nodes, and which (modes, k) are good."""


def _stencils(good: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Return the first node (modes, windows) of each window's stencil, and which are good.

    A stencil stays among successive nodes that are, its window in the middle if it can.
    """
    nodes = good.shape[1]
    number = np.arange(nodes)
    start = np.maximum.accumulate(np.where(good, -1, number), axis=1) + 1
    bad = np.where(good, nodes, number)
    stop = np.minimum.accumulate(bad[:, ::-1], axis=1)[:, ::-1]
    left, right = start[:, :-1], stop[:, :-1] - STENCIL
    middle = number[:-1] - (STENCIL // 2 - 1)
    first = np.clip(middle, left, np.maximum(right, left))
    usable = good[:, :-1] & good[:, 1:] & (right >= left)
    return np.clip(first, 0, max(nodes - STENCIL, 0)), usable


@lru_cache(maxsize=64)
def _weights(every: int) -> Floats:
    """Return (offsets, STENCIL, every) what nodes count for at samples of each window.

    By how far they are from the node where the window starts, which counts for itself.
    """
    nodes = np.arange(STENCIL)
    apart = nodes[:, None] - nodes + np.eye(STENCIL)
    under = np.prod(apart, axis=1)
    made = np.empty((STENCIL - 1, STENCIL, every))
    for offset in range(STENCIL - 1):
        place = offset + np.arange(every) / every
        away = place - nodes[:, None]
        for node in range(STENCIL):
            others = np.delete(away, node, axis=0)
            made[offset, node] = np.prod(others, axis=0) / under[node]
        made[offset, offset] = 1.0
    return made


def _wrap(angle: Floats) -> None:
    """Reduce angles to (-pi, pi] in place."""
    if np.max(angle) >= np.pi or np.min(angle) <= -np.pi:
        over = ~(np.abs(angle) < np.pi)
        angle[over] -= TURN * np.round(angle[over] / TURN)
        angle[angle <= -np.pi] += TURN
=======
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
>>>>>>> 8838184d (Samples are read from splines, closed forms from the inputs alone; bounds by imaginary steps)
