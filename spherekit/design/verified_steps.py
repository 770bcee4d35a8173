"""Configurations that follow from one design to another, in steps that do not leap."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.engine.design_kernel import NewtonKernel
from spherekit.sphere.rotation import Floats

NEWTON_STEPS = 12
"""Most steps from the configuration of one design to that of the next."""
SHRINKING = 0.125, 0.03125
"""Steps that shrink by this part lead to the nearest configuration: of small deviations,
of others."""
SHORTEST = 2.0**-16
"""Part of a way below which it is not followed: no configuration is ahead."""
STILL = 1e-9
"""Steps (rad) so short do not leap."""
CLOSED = 1e-12
"""A configuration whose pairs miss each other by less (rad) is closed."""
MISSED = 100.0
"""Pairs that miss each other by more than so many of the steps do not close: steps of
constraints that repeat each other come to rest where these contradict."""
NOTHING = 1e-15
"""A next step (rad) that need not be made, and"""
NEARLY = 1e-6
"""one that need not on the way."""
SURE = 0.05
"""A fold is there when it is foreseen twice at places that differ by this part of the way
that is left to it, and"""
TOWARDS = 0.45
"""ways go towards it by this part."""
MARGIN, LEAST, LONGEST = 0.8, 1.0 / 16.0, 4.0
"""Parts of ways change by these factors at least and at most, so that steps shrink by more
than they have to."""
SOON = 2.0**-8
"""Part of a way at which it is looked at first, for its direction."""
BLOCK = 4096
"""Configurations that are followed together."""

Profiles = Callable[[Floats, NDArray[np.intp], Floats], Floats]
"""Columns (w, k) of profiles at variables (v, k) of rows (k,) at parts (k,) of their ways.

NaN where there is no design."""


def followed(
    newton: NewtonKernel,
    start: Floats,
    sizes: Floats,
    away: Floats,
    profiles: Profiles | None = None,
    short: bool = False,
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
    profiles
        The columns of profiles, where some are handed in.
    short
        Whether ways are those of small deviations. They end at a fold that is foreseen
        twice: there the square of the determinant falls to zero linearly. Others are
        followed up to it, in steps that shrink more.

    Notes
    -----
    In parts of the way, shorter where Newton's steps do not shrink at once or the
    determinant of the closure equations changes its sign, so that none leaps to another
    assembly mode.
    """
    m, shrinking = sizes.shape[1], SHRINKING[0 if short else 1]
    gone, part = np.zeros(m), np.ones(m)
    begun = np.concatenate(
        [
            _step(
                newton,
                start[:, some],
                _prepared(newton, sizes[:, some] - (1.0 - SOON) * away[:, some]),
                some,
                np.full(len(some), SOON),
                profiles,
            )
            for some in _blocks(np.arange(m))
        ],
        axis=1,
    )
    ways, side, folds = _Ways.of(start, begun), np.sign(begun[-2]), _Folds.at(begun[-2])
    while len(left := np.flatnonzero((gone < 1.0) & (part >= SHORTEST))):
        for some in _blocks(left):
            ahead = np.minimum(gone[some] + part[some], 1.0)
            there = sizes[:, some] - (1.0 - ahead) * away[:, some]
            foreseen = ways.predicted(some, ahead)
            tried = _stepped(
                newton, shrinking, *foreseen, there, side[some], some, ahead, profiles
            )
            holds, arrived = tried.holds, some[tried.holds]
            longer = (ahead - gone[some]) * tried.longer(shrinking)
            ways.arrive(arrived, ahead[holds], tried.now[:, holds])
            gone[arrived] = ahead[holds]
            if short:
                longer[holds] = folds.shortened(
                    arrived, ahead[holds], tried.determinant[holds], longer[holds]
                )
            part[some] = np.exp2(np.floor(np.log2(np.maximum(longer, 0.5 * SHORTEST))))
    return ways.values[1], gone >= 1.0


@final
@dataclass(frozen=True)
class _Ways:
    """The ways of variables so far, and on by a cubic through where they were.

    `start` and `slope` (v, m) where they begin, `places` (2, m) and `values` (2, v, m) of
    the last two arrivals.
    """

    start: Floats
    slope: Floats
    places: Floats
    values: Floats

    @staticmethod
    def of(start: Floats, begun: Floats) -> "_Ways":
        """Return ways from where they begin; `begun` is Newton's step to `SOON` of them."""
        slope, finite = begun[:-2] / SOON, np.all(np.isfinite(begun), axis=0)
        slope = np.where(finite, slope, 0.0)
        return _Ways(start, slope, np.zeros((2, start.shape[1])), np.stack([start, start]))

    def predicted(self, rows: NDArray[np.intp], t: Floats) -> tuple[Floats, Floats]:
        """Return the variables (v, k) foreseen at places, and how far these are."""
        start, slope = self.start[:, rows], self.slope[:, rows]
        (one, two), (first, last) = self.places[:, rows], self.values[:, :, rows]
        with np.errstate(all="ignore"):
            bend, other = (
                np.where(place > 0.0, (values - start - slope * place) / place**2, 0.0)
                for place, values in ((two, last), (one, first))
            )
            twist = np.where(one > 0.0, (bend - other) / (two - one), 0.0)
        made = start + t * (slope + t * (bend + (t - two) * twist))
        away = made - last
        return made, np.sqrt(np.einsum("vk,vk->k", away, away))

    def arrive(self, rows: NDArray[np.intp], t: Floats, values: Floats) -> None:
        """Note where ways have come to."""
        self.places[0, rows], self.places[1, rows] = self.places[1, rows], t
        self.values[0][:, rows], self.values[1][:, rows] = self.values[1][:, rows], values


def _blocks(rows: NDArray[np.intp]) -> Iterator[NDArray[np.intp]]:
    """Yield rows in blocks that stay in the cache."""
    for start in range(0, len(rows), BLOCK):
        yield rows[start : start + BLOCK]


@final
@dataclass(frozen=True)
class _Folds:
    """Where ways fold, by the square of the determinant at the last place of each.

    `places`, `squares` and `folds` (m,), the last as foreseen there; infinite where none.
    """

    places: Floats
    squares: Floats
    folds: Floats

    @staticmethod
    def at(determinant: Floats) -> "_Folds":
        """Return what is known where ways begin."""
        size = determinant.shape
        return _Folds(np.zeros(size), determinant**2, np.full(size, np.inf))

    def shortened(
        self, rows: NDArray[np.intp], places: Floats, determinant: Floats, part: Floats
    ) -> Floats:
        """Return the next parts of ways that have come to places; 0 where they end."""
        square = determinant**2
        with np.errstate(all="ignore"):
            falls = (self.squares[rows] - square) / (places - self.places[rows])
            left = np.where(falls > 0.0, square / falls, np.inf)
            fold = places + left
            ends = np.abs(fold - self.folds[rows]) < SURE * left
        ends &= fold + left < 1.0
        self.places[rows], self.squares[rows], self.folds[rows] = places, square, fold
        shorter = np.minimum(part, np.maximum(TOWARDS * left, SHORTEST))
        return np.where(ends, 0.0, shorter)


@final
@dataclass(frozen=True)
class _Tried:
    """Where Newton's method leads: variables `now` (v, k), and which of them hold.

    With the determinants there, and by what part of a step the worst one shrank.
    """

    now: Floats
    holds: NDArray[np.bool_]
    determinant: Floats
    shrunk: Floats

    def longer(self, shrinking: float) -> Floats:
        """Return the factors (k,) of parts of ways with which steps shrink, nearly."""
        with np.errstate(all="ignore"):
            factor = MARGIN * shrinking / self.shrunk
        most = np.where(self.holds, LONGEST, 0.5)
        return np.asarray(np.minimum(np.maximum(factor, LEAST), most))


def _step(
    newton: NewtonKernel,
    now: Floats,
    prepared: Floats,
    some: NDArray[np.intp],
    ahead: Floats,
    profiles: Profiles | None,
) -> Floats:
    """Return Newton's step at variables (v, k), determinant and square of the misfit."""
    placed = [now] if profiles is None else [now, profiles(now, some, ahead)]
    with np.errstate(all="ignore"):
        rows = np.ascontiguousarray(np.concatenate([*placed, prepared]))
        return np.asarray(newton.step(rows))


def _prepared(newton: NewtonKernel, sizes: Floats) -> Floats:
    return np.asarray(newton.prepare(np.ascontiguousarray(sizes)))


def _stepped(
    newton: NewtonKernel,
    shrinking: float,
    start: Floats,
    before: Floats,
    sizes: Floats,
    side: Floats,
    rows: NDArray[np.intp],
    ahead: Floats,
    profiles: Profiles | None,
) -> _Tried:
    """Return where Newton's method leads from variables (v, k), and whether straight.

    These are foreseen, by steps of the length `before` (k,).

    That is where each step is this part of the one before at most (Kantorovich 1948), and
    the determinant has the sign `side` (k,). A configuration is left where a step is too
    long, and is there when the next step would be nothing, by how the last ones shrank;
    on the way, when it would not matter.
    """
    made = _Tried(start, np.zeros(len(side), dtype=bool), *np.zeros((2, len(side))))
    left, goes_on = np.arange(len(side)), np.ones(len(side), dtype=bool)
    enough = np.where(ahead < 1.0, NEARLY, NOTHING)
    prepared = _prepared(newton, sizes)
    with np.errstate(all="ignore"):
        for _ in range(NEWTON_STEPS):
            now = made.now if len(left) == len(side) else made.now[:, left]
            result = _step(newton, now, prepared, rows[left], ahead[left], profiles)
            step, off = result[:-2], result[-1]
            length = np.sqrt(np.einsum("vk,vk->k", step, step))
            shrinks = goes_on & (length <= np.maximum(shrinking * before, STILL))
            shrunk = np.where(goes_on & (length > STILL), length / before, 0.0)
            made.shrunk[left] = np.maximum(made.shrunk[left], shrunk)
            still = length * (length / before) ** 2 < enough[left]
            still &= off <= (MISSED * length) ** 2
            ends = shrinks & (still | (off < CLOSED**2))
            there = left[ends & (np.sign(result[-2]) == side[left])]
            made.now[:, left[shrinks]] += step[:, shrinks]
            made.determinant[left[goes_on]] = result[-2, goes_on]
            made.holds[there] = True
            goes_on, before = shrinks & ~ends, length
            if not np.any(goes_on):
                break
            if 2 * np.count_nonzero(goes_on) < len(left):
                left, before = left[goes_on], before[goes_on]
                prepared = prepared[:, goes_on]
                goes_on = np.ones(len(left), dtype=bool)
    return made
