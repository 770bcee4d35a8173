"""Samples predicted from nodes among them, all at once.

Where the samples of a block lie close together, every so many of them are nodes, found as
any sample is; the others are read from polynomials through the eight nodes around. Nothing
is taken for closed here: whoever asks has to look.
"""

from functools import lru_cache
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import TURN, Status
from spherekit.motion.motion import Tracer
from spherekit.sphere.rotation import Floats, max_abs

STENCIL = 8
"""Nodes that a polynomial goes through."""
APART = 0.01
"""Inputs (rad) between two nodes: polynomials are then as good as rounding, but where modes
meet."""
FEWEST = 4
"""With fewer samples than this to a node prediction does not pay."""
MOST = 1024
"""Samples to a node at most."""
PRODUCT = 1 << 18
"""Multiplications in a product of matrices: larger ones are shared among cores, which wait
for each other longer than that takes."""
PORTION = 1024
"""Nodes that are found at once."""


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
        every_one = range(len(self._angles))
        self._free = [v for v in every_one if v not in self._driven]

    @classmethod
    def of(cls, tracer: Tracer) -> "Predictor | None":
        """Return a predictor, None where samples do not lie close together along a path."""
        q = tracer.input_grid.q
        if not tracer.input_grid.is_path or not tracer.assembly_modes:
            return None
        if len(q) <= FEWEST * (STENCIL - 1):
            return None
        step = float(max_abs(np.diff(q, axis=0)))
        every = min(MOST, (len(q) - 1) // (STENCIL - 1))
        if step > 0.0:
            every = min(every, int(APART / step))
        return cls(tracer, every) if every >= FEWEST else None

    def read(self, start: int, stop: int, out: Floats) -> None:
        """Write variables (variables, modes, samples) of samples from `start` to `stop`.

        NaN where nothing is predicted.
        """
        every, last = self._every, self._last
        begin, end = start // every, min((stop - 1) // every, last - 1)
        given = self._tracer.input_grid.q[start:stop].T
        for number, inputs in zip(self._driven, given, strict=True):
            out[number] = inputs
        if begin <= end:
            low = max(0, begin - STENCIL + 1)
            nodes = self._nodes(low, min(last, end + STENCIL) + 1)
            self._fill(out, nodes, (begin - low, end + 1 - low), low * every - start)
        if stop > last * every:
            count = len(self._tracer.input_grid)
            back = count - 1 - np.arange(STENCIL)[::-1] * every
            first = max(start, last * every) - start
            at = int(back[-2]) - start - first
            nodes = self._found(back)
            whole = (STENCIL - 2, STENCIL - 1)
            self._fill(out[:, :, first:], nodes, whole, at - (STENCIL - 2) * every)
            if stop == count:
                values, good = nodes
                out[:, :, -1] = np.where(good[:, -1], values[:, :, -1], np.nan)

    def _fill(
        self, out: Floats, nodes: "Nodes", windows: tuple[int, int], place: int
    ) -> None:
        """Write the samples (variables, modes, n) of some windows, each of one node.

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
