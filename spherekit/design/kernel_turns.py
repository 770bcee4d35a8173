"""Turns of the pairs of a kernel in closed form: by the rule of `motion.unwrapping`.

Angles of all designs are followed at once, between inputs so near that none moves far.
"""

from collections.abc import Sequence
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import TURN
from spherekit.engine.design_kernel import DesignKernel
from spherekit.motion.unwrapping import first_turns
from spherekit.numeric.turns import wrap
from spherekit.sphere.rotation import Floats

STRIDE = np.radians(3.0)
"""Inputs at which angles are looked at are nearer (rad) than this."""
SWING = 1.0
"""Where an angle moves by more (rad) between two, it is looked at between them."""
HALVINGS = 12
"""How often at most; an angle that moves as far even then is not followed there."""
EDGE = 30
"""Halvings that lead to the end of an assembly mode."""

TOGETHER = 16384
"""Rows that are looked at together: they stay in the cache."""


@final
class KernelTurns:
    """The turns of one assembly mode of designs.

    `prepared` (k, n) is what the kernel has of them, `signs` are their dyads', `width` is
    what a sample has. Inputs go on from `anchor` (inputs,); a single one that `returns`
    has come back to where it was after a turn.
    """

    def __init__(
        self,
        kernel: DesignKernel,
        prepared: Floats,
        signs: Sequence[float],
        width: int,
        anchor: Floats,
        returns: bool,
    ) -> None:
        self._kernel, self._prepared, self._width = kernel, prepared, width
        self._signs, self._anchor, self._returns = np.array(signs), anchor, returns
        self._n = prepared.shape[1]

    def at(self, q: Floats, points: Floats) -> Floats:
        """Return turns (pairs, k + m, n), rad, to be added to the angles of the kernel.

        At samples (k, inputs), then at points (m, inputs).
        """
        pairs = len(self._kernel.turning)
        if not pairs:
            return np.zeros((0, len(q) + len(points), self._n))
        with np.errstate(all="ignore"):
            if len(self._anchor) == 1:
                return self._along_one(np.concatenate([q, points])[:, 0])
            turns = self._along_several(q)
            there = np.zeros((pairs, len(points), self._n))
            for k, point in enumerate(points):
                near = int(np.argmin(np.max(np.abs(q - point), axis=1)))
                there[:, k] = self._onward(q[near], point, turns[:, near])
            return np.concatenate([turns, there], axis=1)

    def _angles(self, who: NDArray[np.intp], q: Floats) -> Floats:
        """Return the angles (pairs, m) of designs (m,) at inputs (m, inputs).

        NaN where they do not close.
        """
        kernel, count = self._kernel, len(self._anchor)
        assert kernel.angles is not None
        if len(who) > TOGETHER:
            parts = range(0, len(who), TOGETHER)
            every = [slice(k, k + TOGETHER) for k in parts]
            return np.concatenate([self._angles(who[k], q[k]) for k in every], axis=1)
        first = self._width + len(self._signs)
        rows = np.zeros((first + len(kernel.turning) + len(self._prepared), len(who)))
        rows[:count] = q.T
        rows[self._width : first] = self._signs[:, None]
        rows[first + len(kernel.turning) :] = self._prepared[:, who]
        outputs = kernel.angles(rows)
        closed = np.all(outputs[: kernel.reaches] >= 0.0, axis=0)
        return np.where(closed, outputs[kernel.reaches :], np.nan)

    def _everywhere(self, q: Floats) -> Floats:
        """Return the angles (pairs, k, n) of all designs at inputs (k, inputs)."""
        shape = len(self._kernel.turning), len(q), self._n
        who = np.tile(np.arange(self._n), len(q))
        return self._angles(who, np.repeat(q, self._n, axis=0)).reshape(shape)

    def _steps(self, q: Floats, angles: Floats) -> Floats:
        """Return by how much angles (pairs, k, n) at inputs grow to the next inputs."""
        pairs, k, n = angles.shape
        who, place = np.tile(np.arange(n), k - 1), np.repeat(np.arange(k - 1), n)
        ends = angles[:, :-1].reshape(pairs, -1), angles[:, 1:].reshape(pairs, -1)
        return self._grown(who, (q[place], q[place + 1]), ends).reshape(pairs, k - 1, n)

    def _grown(
        self,
        who: NDArray[np.intp],
        inputs: tuple[Floats, Floats],
        angles: tuple[Floats, Floats],
        halvings: int = HALVINGS,
    ) -> Floats:
        """Return by how much angles of designs (m,) grow from inputs to others.

        NaN where they are not followed.
        """
        step = wrap(angles[1] - angles[0])
        far = np.flatnonzero(np.max(np.abs(step), axis=0) > SWING)
        if not len(far):
            return step
        if not halvings:
            step[:, far] = np.nan
            return step
        low, high = inputs[0][far], inputs[1][far]
        between = 0.5 * (low + high)
        here = self._angles(who[far], between)
        step[:, far] = self._grown(
            who[far], (low, between), (angles[0][:, far], here), halvings - 1
        ) + self._grown(who[far], (between, high), (here, angles[1][:, far]), halvings - 1)
        return step

    # One input.

    def _along_one(self, q: Floats) -> Floats:
        (anchor,) = self._anchor
        laps = np.floor((q - anchor) / TURN) if self._returns else np.zeros(len(q))
        place = q - laps * TURN
        ends = [anchor, *place, anchor + TURN] if self._returns else [anchor, *place]
        low, high = min(ends), max(ends)
        fill = np.linspace(low, high, 2 + int((high - low) / STRIDE))
        stations = np.unique([*ends, *fill])
        angles = self._everywhere(stations[:, None])
        steps = self._steps(stations[:, None], angles)
        start = int(np.searchsorted(stations, anchor))
        whole = np.full_like(angles, np.nan)
        for way, along in (
            (slice(start, None), steps[:, start:]),
            (slice(start, None, -1), -steps[:, :start][:, ::-1]),
        ):
            whole[:, way] = self._followed(stations[way], angles[:, way], along)
        grown = np.zeros_like(whole[:, 0])
        if self._returns:
            good = np.all(np.isfinite(steps), axis=0)
            grown = np.round((whole[:, -1] - whole[:, 0]) / TURN) * TURN
            # A mode that ends goes on to either side of the anchor.
            last = np.logical_and.accumulate(good[::-1], axis=0)[::-1]
            last = np.concatenate([last, last[-1:]])
            whole -= np.where(last & ~last[0], grown[:, None], 0.0)
            grown = np.where(last[0], grown, 0.0)
        at = np.searchsorted(stations, place)
        turned = whole[:, at] + laps[None, :, None] * grown[:, None]
        return np.nan_to_num(turned - angles[:, at])

    def _followed(self, stations: Floats, angles: Floats, steps: Floats) -> Floats:
        """Return angles (pairs, k, n) that go on from the first, or from a mode's end."""
        whole = np.empty_like(angles)
        whole[:, 0] = angles[:, 0] - TURN * first_turns(angles[:, 0])
        for k in range(1, len(stations)):
            whole[:, k] = whole[:, k - 1] + steps[:, k - 1]
            begins = np.isnan(whole[0, k]) & np.isfinite(angles[0, k])
            who = np.flatnonzero(begins)
            if len(who):
                ends = stations[k - 1], stations[k]
                whole[:, k, who] = self._begun(who, ends, angles[:, k, who])
        return whole

    def _begun(
        self, who: NDArray[np.intp], ends: tuple[float, float], angles: Floats
    ) -> Floats:
        """Return angles (pairs, m) that begin in (-pi, pi] where a mode does."""
        open_, closed = (np.full((len(who), 1), end) for end in ends)
        at, first = closed, angles
        for _ in range(EDGE):
            between = 0.5 * (open_ + at)
            here = self._angles(who, between)
            inside = np.isfinite(here[0])
            at = np.where(inside[:, None], between, at)
            open_ = np.where(inside[:, None], open_, between)
            first = np.where(inside, here, first)
        grown = np.nan_to_num(self._grown(who, (at, closed), (first, angles)))
        return first - TURN * first_turns(first) + grown

    # Several inputs.

    def _along_several(self, q: Floats) -> Floats:
        turns = np.zeros((len(self._kernel.turning), len(q), self._n))
        before = self._anchor
        start = self._everywhere(before[None])[:, 0]
        first = -TURN * first_turns(start)
        for k, there in enumerate(q):
            turns[:, k] = self._onward(before, there, turns[:, k - 1] if k else first)
            before = there
        return turns

    def _onward(self, before: Floats, there: Floats, turns: Floats) -> Floats:
        """Return the turns (pairs, n) at inputs to which those at others lead.

        Or the anchor, where these do not; angles are in (-pi, pi] where neither does.
        """
        angle = self._everywhere(there[None])[:, 0]
        made = np.full_like(turns, np.nan)
        for begin, turned_before in ((before, turns), (self._anchor, None)):
            if not np.any(np.isnan(made) & np.isfinite(angle)):
                break
            count = 2 + int(np.max(np.abs(there - begin)) / STRIDE)
            way = begin + np.linspace(0.0, 1.0, count)[:, None] * (there - begin)
            angles = self._everywhere(way)
            grown = np.sum(self._steps(way, angles), axis=1)
            if turned_before is None:
                turned_before = -TURN * first_turns(angles[:, 0])
            turned = turned_before + grown - (angle - angles[:, 0])
            made = np.where(np.isnan(made), turned, made)
        made = np.where(np.isnan(made), -TURN * first_turns(angle), made)
        return np.nan_to_num(TURN * np.round(made / TURN))
