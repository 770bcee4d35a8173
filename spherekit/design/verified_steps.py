"""Configurations that follow from one design to another, in steps that do not leap."""

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from spherekit.design.profile_numbers import columns_of
from spherekit.engine.design_kernel import NewtonKernel
from spherekit.model.joints import Track
from spherekit.sphere.rotation import Floats

NEWTON_STEPS = 12
"""Most steps from the configuration of one design to that of the next."""
SHRINKING = 0.125
"""Newton's steps that shrink by this part lead to the nearest configuration."""
SHORTEST = 2.0**-16
"""Part of a way below which it is not followed: no configuration is ahead."""
STILL = 1e-9
"""Steps (rad) so short do not leap."""
CLOSED = 1e-12
"""A configuration whose pairs miss each other by less (rad) is closed."""

Profiles = Callable[[float], Sequence[Track] | None]
"""The profiles at a part of a way; None if there is no design."""


def followed(
    newton: NewtonKernel,
    start: Floats,
    sizes: Floats,
    away: Floats,
    tracks: Profiles | None = None,
) -> tuple[Floats, NDArray[np.bool_]]:
    """Return the variables (v, m) that follow to sizes (k, m), and which get there.

    Parameters
    ----------
    newton
        Newton's step of the topology.
    start
        (v, m) closed configurations of the designs with sizes `sizes - away`.
    sizes, away
        (k, m) rad and SI, where the ways end, and what that is from where they begin.
    tracks
        The profiles at parts of the way, from 0 to 1, where some are handed in.

    Notes
    -----
    In parts of the way, halved where Newton's steps do not shrink at once or the
    determinant of the closure equations changes its sign, so that none leaps to another
    assembly mode.
    """
    now, m = start.copy(), sizes.shape[1]
    gone, part = np.zeros(m), np.ones(m)
    first = () if tracks is None else tracks(0.0)
    if first is None:
        return now, np.zeros(m, dtype=bool)
    side = np.sign(_step(newton, start, newton.prepare(sizes - away), first)[-2])
    while len(left := np.flatnonzero((gone < 1.0) & (part >= SHORTEST))):
        ahead = np.minimum(gone[left] + part[left], 1.0)
        there = sizes[:, left] - (1.0 - ahead) * away[:, left]
        holds = np.zeros(len(left), dtype=bool)
        for some, profiles in _together(ahead, tracks):
            rows = left[some]
            beyond, onward = _stepped(
                newton, now[:, rows], there[:, some], side[rows], profiles
            )
            now[:, rows[onward]] = beyond[:, onward]
            holds[some] = onward
        gone[left[holds]] = ahead[holds]
        part[left] *= np.where(holds, 2.0, 0.5)
    return now, gone >= 1.0


def _together(
    ahead: Floats, tracks: Profiles | None
) -> list[tuple[NDArray[np.intp], Sequence[Track]]]:
    """Return rows at parts (n,) of their ways whose profiles are the same, with these."""
    if tracks is None:
        return [(np.arange(len(ahead)), ())]
    parts = [(np.flatnonzero(ahead == t), tracks(float(t))) for t in np.unique(ahead)]
    return [(rows, profiles) for rows, profiles in parts if profiles is not None]


def _step(
    newton: NewtonKernel, now: Floats, prepared: Floats, tracks: Sequence[Track]
) -> Floats:
    """Return Newton's step at variables (v, m), determinant and square of the misfit."""
    placed = [now, columns_of(tracks, now.T)] if tracks else [now]
    with np.errstate(all="ignore"):
        return np.asarray(newton.step(np.concatenate([*placed, prepared])))


def _stepped(
    newton: NewtonKernel,
    start: Floats,
    sizes: Floats,
    side: Floats,
    tracks: Sequence[Track],
) -> tuple[Floats, NDArray[np.bool_]]:
    """Return the variables (v, m) by Newton's method, and where it goes straight there.

    That is where each step is an eighth of the one before at most (Kantorovich 1948), and
    the determinant has the sign `side` (m,).
    """
    prepared, now = newton.prepare(np.ascontiguousarray(sizes)), start
    lengths: list[Floats] = []
    with np.errstate(all="ignore"):
        for _ in range(NEWTON_STEPS):
            result = _step(newton, now, prepared, tracks)
            closed = result[-1] < CLOSED**2
            lengths.append(np.linalg.norm(result[:-2], axis=0))
            if np.all(closed | ~np.isfinite(result[-1])):
                break
            now = now + result[:-2]
        shrinks = np.sign(result[-2]) == side
        for step, following in pairwise(lengths):
            shrinks &= following <= np.maximum(SHRINKING * step, STILL)
    return now, closed & shrinks
