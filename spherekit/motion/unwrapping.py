"""Angle unwrapping: which whole turns a passive pair has made at an input.

An angle that a motion reduces to a turn is a continuous function of the inputs along its
assembly mode. It is in (-pi, pi] at the anchor, which is the reference pose, or zero; what
wheels fix is a linear function of the inputs from there on, the rest is followed by
verified steps, however far samples lie apart.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.conventions import TURN, Status
from spherekit.motion.closure import Closure
from spherekit.motion.guides import ModeCurve, follow
from spherekit.motion.meshes import Meshes
from spherekit.motion.steps import walk
from spherekit.motion.turns import into_range, whole_laps
from spherekit.planning.wheels import (
    WheelTrain,
)
from spherekit.sphere.rotation import Floats

SAME = 0.3
"""Angles (rad) of a followed mode that are farther from a row's are another's."""
BEYOND = 1e-4
"""An input beyond the end of a mode by less (rad) is at its end, a dead centre."""
HALF = np.pi + 1e-9
"""An angle (rad) of half a turn is positive, whatever rounding makes of it."""


def first_turns(angles: Floats) -> Floats:
    """Return the whole turns less which angles are in (-pi, pi]."""
    return np.asarray(np.ceil((angles - HALF) / TURN))


@final
@dataclass(frozen=True)
class _Piece:
    """A mode over the inputs that it reaches without a gap.

    After `period` (rad) of the input its angles have grown by `winding` (variables,) turns;
    zero where the input cannot go round, None where they do not return. `first`
    (variables,) are the turns of its nodes less which angles are as at the anchor.
    """

    curve: ModeCurve
    period: float
    winding: Floats | None
    first: Floats

    def turns(self, values: Floats, driven: int, angles: Sequence[int]) -> Floats:
        """Return turns (n, angles) to be added at configurations (n, variables).

        NaN for those that do not lie on it.
        """
        q, low, high = values[:, driven], *self.curve.inputs[[0, -1]]
        laps = np.zeros(len(q))
        if self.winding is not None:
            laps = np.floor((q - low + BEYOND) / self.period)
        place = q - laps * self.period if self.winding is not None else q
        near = (place >= low - BEYOND) & (place <= high + BEYOND)
        followed, _ = self.curve.predict(np.clip(place, low, high))
        away = followed[:, angles] - values[:, angles]
        turns = np.round(away / TURN)
        near &= np.max(np.abs(away - TURN * turns), axis=1, initial=0.0) < SAME
        turns -= self.first[angles]
        if self.winding is not None:
            turns += laps[:, None] * self.winding[angles]
        return np.where(near[:, None], turns, np.nan)


@final
class Unwrapping:
    """The turns of passive pairs of one mechanism, mode by mode."""

    def __init__(
        self,
        closure: Closure,
        driven: Sequence[int],
        angles: Sequence[int],
        reference: Floats | None,
        meshes: Meshes | None,
        train: tuple[WheelTrain, list[int]] | None,
    ) -> None:
        self._closure, self._driven, self._angles = closure, list(driven), list(angles)
        self._meshes, self._train = meshes, train
        self._periods = np.full(len(driven), TURN) if meshes is None else meshes.periods
        anchor = np.zeros(len(driven)) if reference is None else reference[self._driven]
        self.anchor = anchor
        self._pieces: dict[int, list[_Piece]] = {}

    def turns(
        self,
        mode: int,
        values: Floats,
        q: Floats,
        wanted: Sequence[int],
        last: Floats | None = None,
    ) -> Floats:
        """Return turns (n, variables) to be added to configurations (n, variables).

        `q` (n, inputs) are their inputs, which may be whole periods from those of the
        configurations. Only the variables `wanted` are sought, those of others may be
        zero. With several inputs samples are followed in their order, from the `last`
        whole configuration (variables,) or else from the anchor.
        """
        turns = np.zeros_like(values)
        settled = set(self._driven)
        if self._train is not None:
            train, followers = self._train
            start = train.offsets + train.ratios @ self.anchor
            start = start - TURN * first_turns(start)
            angle = start + (q - self.anchor) @ train.ratios.T
            turns[:, followers] = np.round((angle - values[:, followers]) / TURN)
            settled |= set(followers)
        sought = [v for v in self._angles if v not in settled]
        if not set(sought) & set(wanted) or not len(values):
            return turns
        at = self._at(values, q)
        passive = self._by_pieces(mode, at) if len(self._driven) == 1 else None
        if passive is None:
            passive = self._in_order(at, last)
        turns[:, sought] = passive[:, [self._angles.index(v) for v in sought]]
        return turns

    def _at(self, values: Floats, q: Floats) -> Floats:
        """Return configurations (n, variables) moved to inputs whole periods away."""
        at = values.copy()
        at[:, self._driven] = q
        if self._meshes is not None:
            grown = q - values[:, self._driven]
            at[:, list(self._meshes.variables)] += grown @ self._meshes.ratios.T
        return at

    def _by_pieces(self, mode: int, at: Floats) -> Floats:
        (driven,) = self._driven
        turns = np.full((len(at), len(self._angles)), np.nan)
        pieces = self._pieces.setdefault(mode, [])
        tried = np.zeros(len(at), dtype=bool)
        number = 0
        while True:
            for piece in pieces[number:]:
                open_ = np.isnan(turns[:, 0])
                turns[open_] = piece.turns(at[open_], driven, self._angles)
            number = len(pieces)
            left = np.flatnonzero(np.isnan(turns[:, 0]) & ~tried)
            if not len(left):
                return turns
            tried[left[0]] = True
            pieces.append(self._piece(at[left[0]], at[left, driven]))

    def _piece(self, values: Floats, places: Floats) -> _Piece:
        """Return the mode about a configuration (variables,), as far as it reaches."""
        (driven,), (period,), (anchor,) = self._driven, self._periods, self.anchor
        returns = bool(np.isfinite(period))
        ends = [anchor, float(np.min(places)), float(np.max(places))]
        if returns:
            moved = float(into_range(values[driven], anchor, anchor + period, period))
            values = self._at(values[None], np.array([[moved]]))[0]
            ends = [moved - period, moved + period]
        curve = follow(self._closure, driven, values, min(ends), max(ends))
        low, high = curve.inputs[[0, -1]]
        winding = None
        if returns:
            winding = np.zeros(len(values))
            if high - low > period + BEYOND:
                grown = curve.values[-1] - curve.predict(high - np.array([period]))[0][0]
                winding = np.round(grown / TURN)
                away = (grown - TURN * winding)[self._angles]
                winding = winding if np.max(np.abs(away)) < SAME else None
        there = anchor + period * np.arange(3) if returns else np.array([anchor])
        inside = there[(there >= low - BEYOND) & (there <= high + BEYOND)]
        nearest = low if returns else anchor
        reference = np.clip(inside[:1] if len(inside) else [nearest], low, high)
        first = first_turns(curve.predict(reference)[0][0])
        return _Piece(curve, period, winding, first)

    def _in_order(self, at: Floats, last: Floats | None) -> Floats:
        """Return turns (n, angles) of rows that follow each other, several inputs.

        Where no straight way within the mode leads there from the row before, angles are
        those of `_from_anchor`.
        """
        angles, given = self._angles, at if last is None else np.concatenate([[last], at])
        after, before = given[1:], given[:-1]
        moved, status = walk(self._closure, self._driven, after, before[:, self._driven])
        steps = np.round((moved - before)[:, angles] / TURN)
        away = np.abs((moved - before)[:, angles] - TURN * steps)
        follows = (status == Status.OK) & (np.max(away, axis=1, initial=0.0) < SAME)
        anew = np.concatenate([[last is None], ~follows])
        turns = np.zeros((len(given), len(angles)))
        turns[anew] = self._from_anchor(given[anew])
        for row in np.flatnonzero(~anew[1:]):
            turns[row + 1] = turns[row] - steps[row]
        return turns[len(given) - len(at) :]

    def _from_anchor(self, at: Floats) -> Floats:
        """Return turns (n, angles) of rows to which a straight way from the anchor leads.

        But for whole periods of inputs, with which angles grow as they do from the anchor.
        Where none leads there, angles are in (-pi, pi].
        """
        turns = np.zeros((len(at), len(self._angles)))
        far = whole_laps(at[:, self._driven] - self.anchor, self._periods)
        near = self._at(at, at[:, self._driven] - far)
        for row, laps in enumerate(far):
            here = near[row : row + 1]
            there, status = walk(self._closure, self._driven, here, self.anchor[None])
            if status[0] != Status.OK:
                turns[row] = -first_turns(here[0, self._angles])
                continue
            turns[row] = -first_turns(there[0, self._angles])
            for k in np.flatnonzero(laps):
                goal = self.anchor + np.eye(len(laps))[k] * self._periods[k]
                round_, status = walk(self._closure, self._driven, there, goal[None])
                grown = (round_ - there)[0, self._angles] / TURN
                if status[0] == Status.OK and np.max(np.abs(grown % 1.0 - 0.5)) > 0.45:
                    turns[row] += np.round(grown) * laps[k] / self._periods[k]
        return turns
