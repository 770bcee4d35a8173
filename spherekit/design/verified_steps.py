"""Configurations that follow from one design to another, in steps that do not leap."""

from collections.abc import Callable
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
    ways = _Ways(newton, start, sizes, away, profiles, short)
    while len(left := np.flatnonzero((ways.gone < 1.0) & (ways.part >= SHORTEST))):
        for some in _blocks(left):
            ways.advance(some)
    return ways.values[1], ways.gone >= 1.0


def _blocks(rows: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    """Return rows in blocks that stay in the cache."""
    return [rows[start : start + BLOCK] for start in range(0, len(rows), BLOCK)]


@final
class _Ways:
    """The ways of variables (v, m) so far, and on by a cubic through where they were.

    `gone` and `part` (m,) are how far they have come and what is tried next, `slope` (v, m)
    their direction at the start, `places` (2, m) and `values` (2, v, m) the last two
    arrivals. The determinant has the sign `side` (m,); its `squares` at the last arrival
    foresee `folds`, infinite where none.
    """

    def __init__(
        self,
        newton: NewtonKernel,
        start: Floats,
        sizes: Floats,
        away: Floats,
        profiles: Profiles | None,
        short: bool,
    ) -> None:
        self.newton, self.profiles, self.short = newton, profiles, short
        self.start, self.sizes, self.away = start, sizes, away
        m, self.shrinking = sizes.shape[1], SHRINKING[0 if short else 1]
        self.gone, self.part, self.folds = np.zeros(m), np.ones(m), np.full(m, np.inf)
        self.places, self.values = np.zeros((2, m)), np.stack([start, start])
        self.slope, self.side, self.squares = np.zeros_like(start), np.zeros(m), np.zeros(m)
        for some in _blocks(np.arange(m)):
            soon = np.full(len(some), SOON)
            begun = self._step(start[:, some], self._prepared(some, soon), some, soon)
            finite = np.all(np.isfinite(begun), axis=0)
            self.slope[:, some] = np.where(finite, begun[:-2] / SOON, 0.0)
            self.side[some], self.squares[some] = np.sign(begun[-2]), begun[-2] ** 2

    def advance(self, some: NDArray[np.intp]) -> None:
        """Try the next parts of some ways; they become shorter where these do not hold."""
        ahead = np.minimum(self.gone[some] + self.part[some], 1.0)
        now, determinant, shrunk, holds = self._corrected(some, ahead)
        arrived, there = some[holds], ahead[holds]
        with np.errstate(all="ignore"):
            factor = MARGIN * self.shrinking / shrunk
        most = np.where(holds, LONGEST, 0.5)
        part = (ahead - self.gone[some]) * np.minimum(np.maximum(factor, LEAST), most)
        if self.short:
            part[holds] = self._before_folds(
                arrived, there, determinant[holds], part[holds]
            )
        self.gone[arrived] = there
        self.places[:, arrived] = self.places[1, arrived], there
        self.values[0][:, arrived] = self.values[1][:, arrived]
        self.values[1][:, arrived] = now[:, holds]
        self.part[some] = np.exp2(np.floor(np.log2(np.maximum(part, 0.5 * SHORTEST))))

    def _before_folds(
        self, rows: NDArray[np.intp], places: Floats, determinant: Floats, part: Floats
    ) -> Floats:
        """Return the next parts of ways that have come to places; 0 where they end."""
        square = determinant**2
        with np.errstate(all="ignore"):
            falls = (self.squares[rows] - square) / (places - self.places[1, rows])
            left = np.where(falls > 0.0, square / falls, np.inf)
            fold = places + left
            ends = np.abs(fold - self.folds[rows]) < SURE * left
        ends &= fold + left < 1.0
        self.squares[rows], self.folds[rows] = square, fold
        shorter = np.minimum(part, np.maximum(TOWARDS * left, SHORTEST))
        return np.where(ends, 0.0, shorter)

    def _foreseen(self, rows: NDArray[np.intp], t: Floats) -> tuple[Floats, Floats]:
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

    def _prepared(self, rows: NDArray[np.intp], ahead: Floats) -> Floats:
        sizes = self.sizes[:, rows] - (1.0 - ahead) * self.away[:, rows]
        return np.asarray(self.newton.prepare(np.ascontiguousarray(sizes)))

    def _step(
        self, now: Floats, prepared: Floats, rows: NDArray[np.intp], ahead: Floats
    ) -> Floats:
        """Return Newton's step at variables (v, k), determinant, square of the misfit."""
        placed = [now]
        if self.profiles is not None:
            placed.append(self.profiles(now, rows, ahead))
        with np.errstate(all="ignore"):
            given = np.ascontiguousarray(np.concatenate([*placed, prepared]))
            return np.asarray(self.newton.step(given))

    def _corrected(
        self, rows: NDArray[np.intp], ahead: Floats
    ) -> tuple[Floats, Floats, Floats, NDArray[np.bool_]]:
        """Return where Newton's method leads from foreseen variables, and who holds.

        With the determinants there, and by what part of a step the worst one shrank. It
        holds where each step is this part of the one before at most (Kantorovich 1948), and
        the determinant keeps its sign. A configuration is left where a step is too long,
        and is there when the next step would be nothing, by how the last ones shrank; on
        the way, when it would not matter.
        """
        made, before = self._foreseen(rows, ahead)
        determinant, shrank = np.zeros((2, len(rows)))
        holds = np.zeros(len(rows), dtype=bool)
        left, goes_on = np.arange(len(rows)), np.ones(len(rows), dtype=bool)
        enough = np.where(ahead < 1.0, NEARLY, NOTHING)
        prepared = self._prepared(rows, ahead)
        with np.errstate(all="ignore"):
            for _ in range(NEWTON_STEPS):
                now = made if len(left) == len(rows) else made[:, left]
                result = self._step(now, prepared, rows[left], ahead[left])
                step, off = result[:-2], result[-1]
                length = np.sqrt(np.einsum("vk,vk->k", step, step))
                shrinks = goes_on & (length <= np.maximum(self.shrinking * before, STILL))
                shrunk = np.where(goes_on & (length > STILL), length / before, 0.0)
                shrank[left] = np.maximum(shrank[left], shrunk)
                still = length * (length / before) ** 2 < enough[left]
                still &= off <= (MISSED * length) ** 2
                ends = shrinks & (still | (off < CLOSED**2))
                same_side = np.sign(result[-2]) == self.side[rows[left]]
                holds[left[ends & same_side]] = True
                made[:, left[shrinks]] += step[:, shrinks]
                determinant[left[goes_on]] = result[-2, goes_on]
                goes_on, before = shrinks & ~ends, length
                if not np.any(goes_on):
                    break
                if 2 * np.count_nonzero(goes_on) < len(left):
                    left, before = left[goes_on], before[goes_on]
                    prepared = prepared[:, goes_on]
                    goes_on = np.ones(len(left), dtype=bool)
        return made, determinant, shrank, holds
