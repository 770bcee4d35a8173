"""Samples predicted from nodes among them, all at once.

Where the samples of a block lie close together, every so many of them are nodes, found as
any sample is; the others are read from polynomials through the eight nodes around. Nothing
is taken for closed here: whoever asks has to look.
"""

from functools import lru_cache
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import Status
from spherekit.motion.motion import Tracer
from spherekit.sphere.rotation import Floats

STENCIL = 8
"""Nodes that a polynomial goes through."""
APART = 0.01
"""Inputs (rad) between two nodes: polynomials are then as good as rounding, but where modes
meet."""
FEWEST = 4
"""With fewer samples than this to a node prediction does not pay."""
MOST = 256
"""Samples to a node at most."""
PORTION = 1024
"""Nodes that are found at once."""
TURN = 2.0 * np.pi


@final
class Predictor:
    """Predicts samples of a tracer from nodes, every so many of its samples."""

    def __init__(self, tracer: Tracer, every: int) -> None:
        self._tracer, self._every = tracer, every
        self._last = (len(tracer.input_grid) - 1) // every
        self._known: dict[int, Nodes] = {}
        self._angles = np.zeros(len(tracer.mechanism.variable_owners), dtype=bool)
        self._angles[tracer.solver.angles] = True
        self._driven = list(tracer.solver.driven)

    @classmethod
    def of(cls, tracer: Tracer) -> "Predictor | None":
        """Return a predictor, None where samples do not lie close together along a path."""
        q = tracer.input_grid.q
        if not tracer.input_grid.is_path or not tracer.assembly_modes:
            return None
        if len(q) <= FEWEST * (STENCIL - 1):
            return None
        step = float(np.max(np.abs(np.diff(q, axis=0))))
        every = min(MOST, (len(q) - 1) // (STENCIL - 1))
        if step > 0.0:
            every = min(every, int(APART / step))
        return cls(tracer, every) if every >= FEWEST else None

    def at(self, start: int, stop: int) -> Floats:
        """Return variables (variables, modes, samples) of samples from `start` to `stop`.

        NaN where nothing is predicted.
        """
        every, last = self._every, self._last
        given = self._tracer.input_grid.q[start:stop].T
        modes = len(self._tracer.assembly_modes)
        out = np.full((len(self._angles), modes, stop - start), np.nan)
        begin, end = start // every, min((stop - 1) // every, last - 1)
        if begin <= end:
            low = max(0, begin - STENCIL + 1)
            values, good = self._nodes(low, min(last, end + STENCIL) + 1)
            made = self._windows(values, good)[:, :, begin - low : end + 1 - low]
            first, past = max(start, begin * every), min(stop, (end + 1) * every)
            flat = made.reshape(*made.shape[:2], -1)
            skipped = first - begin * every
            out[:, :, first - start : past - start] = flat[
                :, :, skipped : skipped + past - first
            ]
        if stop > last * every:
            self._end(out, start, stop)
        known = np.isfinite(out[0])
        for number, own in zip(self._driven, given, strict=True):
            out[number] = np.where(known, own, np.nan)
        free = self._angles.copy()
        free[self._driven] = False
        for own in out[free]:
            _wrap(own)
        return out

    def _end(self, out: Floats, start: int, stop: int) -> None:
        """Add the samples after the last node, from nodes that end with the last sample."""
        every, count = self._every, len(self._tracer.input_grid)
        back = count - 1 - np.arange(STENCIL)[::-1] * every
        found = self._windows(*self._found(back))[:, :, -1]
        first = max(start, self._last * every)
        made = found[:, :, first - back[-2] :]
        own = out[:, :, first - start : min(stop, count - 1) - start]
        own[:] = made[:, :, : own.shape[2]]

    def _found(self, samples: NDArray[np.intp]) -> "Nodes":
        """Return the variables (variables, modes, k) of samples, and which are good."""
        found = self._tracer.samples(samples)
        modes = len(self._tracer.assembly_modes)
        values = found.values.reshape(modes, len(samples), -1)
        good = (found.status == Status.OK).reshape(modes, -1)
        return np.moveaxis(values, 2, 0), good

    def _nodes(self, start: int, stop: int) -> "Nodes":
        """Return nodes by their numbers, found in portions and kept while they are near."""
        portions = range(start // PORTION, (stop - 1) // PORTION + 1)
        for number in portions:
            if number not in self._known:
                nodes = np.arange(number * PORTION, (number + 1) * PORTION)
                nodes = nodes[nodes <= self._last]
                self._known[number] = self._found(nodes * self._every)
        self._known = {n: own for n, own in self._known.items() if n >= portions[0]}
        values, good = (
            np.concatenate([self._known[n][k] for n in portions], axis=-1) for k in (0, 1)
        )
        first = portions[0] * PORTION
        return values[:, :, start - first : stop - first], good[
            :, start - first : stop - first
        ]

    def _windows(self, values: Floats, good: NDArray[np.bool_]) -> Floats:
        """Return (variables, modes, windows, every) samples from each node to the next."""
        first, known = _stencils(good)
        modes, windows = first.shape
        at = first[:, :, None] + np.arange(STENCIL)
        base = values[:, :, :-1, None]
        away = values[:, np.arange(modes)[:, None, None], at] - base
        away[self._angles] -= TURN * np.round(away[self._angles] / TURN)
        offset = np.arange(windows) - first
        made = np.empty((len(values), modes, windows, self._every))
        weights = _weights(self._every)
        for each in np.unique(offset[known]):
            chosen = known & (offset == each)
            made[:, chosen] = away[:, chosen] @ weights[each]
        made += base
        made[:, ~known] = np.nan
        return made


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
    known = good[:, :-1] & good[:, 1:] & (right >= left)
    return np.clip(first, 0, max(nodes - STENCIL, 0)), known


@lru_cache(maxsize=64)
def _weights(every: int) -> Floats:
    """Return (offsets, STENCIL, every) what nodes count for at samples of each window."""
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
    return made


def _wrap(angle: Floats) -> None:
    """Reduce angles to (-pi, pi] in place."""
    over = ~(np.abs(angle) < np.pi)
    if np.any(over):
        angle[over] -= TURN * np.round(angle[over] / TURN)
        angle[angle <= -np.pi] += TURN
