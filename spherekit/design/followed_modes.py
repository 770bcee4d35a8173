"""Assembly modes of many designs at samples of the input, with none missing.

All complex solutions of one design are followed to every design, and there from sample to
sample; where one is lost, or two have become one, again off the real axis, where they
cannot meet. As many distinct ones as there are make sure that no real one is missing at any
sample. Which of those at neighbouring samples are one mode is decided by real steps that
pass the tests of continuation (docs/motion.md).
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.design.all_solutions import StartSet
from spherekit.design.solution_paths import (
    Flags,
    Way,
    apart,
    corrected,
    distinct,
    settled,
    tracked,
)
from spherekit.engine.path_kernel import Numbers, PathKernel
from spherekit.sphere.rotation import Floats

BENDS = (0.5, -0.9, 1.7)
"""How far off the real axis a way between two samples goes, as parts of its length."""
REAL = 1e-4
"""Solutions nearer (rad) than this to the real axis may be real ones, off by rounding."""
STAYS = 1e-6
"""Such a one is, if Newton's method on the real axis moves it by less (rad)."""
RIGHT, CONTRACTS, TURN = 0.1, 0.1, 0.95
"""What a real step has to be: its prediction right up to this part of it, Newton's second
step this part of the first, and the cosine of the tangent's turn above."""
SMALLEST = 2.0**-40
"""The least real step, as a part of the way to the next sample."""
TINY = 1e-7
"""Steps and predictions that are off by less (rad) are in order."""


@final
@dataclass(frozen=True)
class Modes:
    """Assembly modes of designs: one row for each.

    `design` (m,) counts within what was given; `values` (variables, samples, m) are NaN
    where a mode does not close. `labels` are as in `AssemblyMode`, after a number in each
    design. `lost` lists the designs of which not all was found.
    """

    design: NDArray[np.intp]
    values: Floats
    labels: tuple[str, ...]
    lost: NDArray[np.intp]


def followed_modes(kernel: PathKernel, start: StartSet, sizes: Floats, q: Floats) -> Modes:
    """Return the modes of designs (sizes, n) at inputs q (samples,), ascending."""
    count, m = sizes.shape[1], start.values.shape[1]
    following = _Following(kernel, np.repeat(sizes, m, axis=1), m)
    at = following.begun(start, q[0])
    modes = _Numbered(count * m)
    modes.begin(at.real)
    reals = [(at.real, at.values)]
    for before, there in pairwise(q):
        at, links = following.onward(at, before, there)
        modes.go_on(at.real, links)
        reals.append((at.real, at.values))
    lost = np.flatnonzero(following.lost)
    design, values = modes.gathered(reals, lost, m)
    design, values = _ordered(design, values)
    return Modes(design, values, _labels(kernel, sizes, design, values), lost)


def _ordered(design: NDArray[np.intp], values: Floats) -> tuple[NDArray[np.intp], Floats]:
    """Return modes by design, then by the first sample at which they close, and how."""
    first = np.argmax(np.isfinite(values[0]), axis=0)
    there = values[:, first, np.arange(len(first))]
    keys = np.round(there - 2.0 * np.pi * np.round(there / (2.0 * np.pi)), 6)
    order = np.lexsort((*keys[::-1], first, design))
    return design[order], values[:, :, order]


def _labels(
    kernel: PathKernel, sizes: Floats, design: NDArray[np.intp], values: Floats
) -> tuple[str, ...]:
    first = np.argmax(np.isfinite(values[0]), axis=0)
    there = values[:, first, np.arange(len(first))]
    prepared = kernel.prepare(np.ascontiguousarray(sizes[:, design]))
    begins = np.searchsorted(design, design)
    numbers = np.arange(len(design)) - begins
    texts = kernel.labels(there, prepared)
    return tuple(f"{k} {text}" for k, text in zip(numbers, texts, strict=True))


@final
@dataclass(frozen=True)
class _Sample:
    """Solutions (variables, n) at a sample, which are real (n,), and what follows."""

    values: Numbers
    real: Flags
    rates: Numbers
    determinant: Numbers


@final
class _Numbered:
    """The numbers (n,) of the modes that rows are on, sample after sample."""

    def __init__(self, rows: int) -> None:
        self.now = np.full(rows, -1)
        self.count = 0
        self.known: list[NDArray[np.intp]] = []
        self.row: list[NDArray[np.intp]] = []

    def begin(self, real: Flags) -> None:
        """Begin a mode with each real row that is on none."""
        fresh = np.flatnonzero(real & (self.now < 0))
        self.now[fresh] = self.count + np.arange(len(fresh))
        self.count += len(fresh)
        self.row.append(fresh)
        self.known.append(self.now.copy())

    def go_on(self, real: Flags, links: NDArray[np.intp]) -> None:
        """Go to the next sample: `links` (n,) say in which row that of a row goes on."""
        before, self.now = self.now, np.full(len(self.now), -1)
        on = np.flatnonzero(links >= 0)
        self.now[links[on]] = before[on]
        self.begin(real)

    def gathered(
        self, reals: list[tuple[Flags, Numbers]], lost: NDArray[np.intp], m: int
    ) -> tuple[NDArray[np.intp], Floats]:
        """Return the design (modes,) and values (variables, samples, modes) of each."""
        design = np.concatenate(self.row) // m
        values = np.full((len(reals[0][1]), len(reals), self.count), np.nan)
        for k, ((real, found), number) in enumerate(zip(reals, self.known, strict=True)):
            rows = np.flatnonzero(real)
            values[:, k, number[rows]] = found[:, rows].real
        kept = np.flatnonzero(~np.isin(design, lost))
        return design[kept], values[:, :, kept]


@final
class _Following:
    """All solutions of designs, `together` rows of each, while the input goes on."""

    def __init__(self, kernel: PathKernel, sizes: Floats, together: int) -> None:
        self.kernel, self.sizes, self.m = kernel, sizes, together
        self.prepared = kernel.prepare(np.ascontiguousarray(sizes))
        self.lost = np.zeros(sizes.shape[1] // together, dtype=bool)

    def begun(self, start: StartSet, q: float) -> _Sample:
        """Return the first sample."""
        n = len(self.lost)
        base = np.repeat(start.sizes[:, None], n * self.m, axis=1)
        ends = np.full(n * self.m, start.q), np.full(n * self.m, complex(q))
        way = Way((base, self.sizes), ends)
        values, arrived = tracked(self.kernel, way, np.tile(start.values, (1, n)))
        values[:, ~arrived] = np.nan
        values, real = self._real(values, np.ones(n * self.m, dtype=bool))
        self.lost |= ~self._whole(values)
        return self._sample(values, real)

    def _sample(self, values: Numbers, real: Flags) -> _Sample:
        with np.errstate(all="ignore"):
            at = self.kernel.at(values, self.prepared)
        real = real & ~np.repeat(self.lost, self.m)
        return _Sample(values, real, at.rates, at.determinant)

    def _whole(self, values: Numbers) -> Flags:
        """Return for each design whether its solutions are distinct."""
        return distinct(values.reshape(len(values), -1, self.m))

    def _real(self, values: Numbers, chosen: Flags) -> tuple[Numbers, Flags]:
        """Return solutions, those that are real but for rounding made so, and which are.

        A design whose rows are neither the one nor the other is lost.
        """
        off = np.max(np.abs(values.imag), axis=0)
        real = off == 0.0
        near = np.flatnonzero((off < REAL) & ~real & chosen)
        if len(near):
            start = np.ascontiguousarray(values[:, near].real)
            found, closed = settled(
                self.kernel, start, np.ascontiguousarray(self.prepared[:, near])
            )
            stays = closed & (np.max(np.abs(found - start), axis=0) < STAYS)
            rows = near[stays]
            values = values.copy()
            values[:, rows] = found[:, stays]
            real[rows] = True
            doubtful = near[~stays]
            self.lost[doubtful // self.m] |= off[doubtful] < STAYS
        return values, real

    def onward(
        self, at: _Sample, before: float, there: float
    ) -> tuple[_Sample, NDArray[np.intp]]:
        """Return the next sample, and in which of its rows the mode of each goes on."""
        kernel, h = self.kernel, there - before
        alive = ~np.repeat(self.lost, self.m)
        with np.errstate(all="ignore"):
            guess = at.values + at.rates * h
            guess[kernel.driven] = there
            made, first, _ = corrected(kernel, guess, self.prepared)
            made[:, ~(first < 1.0)] = np.nan
            made, closed = settled(kernel, made, self.prepared)
        values, real = self._real(np.where(closed, made, np.nan), alive)
        again = ~self._whole(values) & ~self.lost
        for bend in BENDS:
            if not np.any(again):
                break
            rows = np.flatnonzero(np.repeat(again, self.m))
            ends = np.full(len(rows), complex(before)), np.full(len(rows), complex(there))
            own = self.sizes[:, rows]
            way = Way((own, own), ends, 1j * bend * h)
            found, arrived = tracked(kernel, way, at.values[:, rows])
            found[:, ~arrived] = np.nan
            values[:, rows] = found
            values, real = self._real(values, np.repeat(again, self.m))
            again &= ~self._whole(values)
        self.lost |= again
        sample = self._sample(values, real)
        return sample, self._links(at, sample, before, there)

    def _links(
        self, at: _Sample, sample: _Sample, before: float, there: float
    ) -> NDArray[np.intp]:
        """Return in which row (n,) of a sample the mode of a row before goes on, or -1.

        Where no row is left over on one side, those on the other end, or begin, between.
        """
        both = np.flatnonzero(at.real & sample.real)
        links = np.full(len(at.real), -1)
        sure = both[_smooth(at, sample, both, there - before)]
        links[sure] = sure
        taken = np.zeros(len(links), dtype=bool)
        taken[sure] = True
        left, fresh = at.real & ~taken, sample.real & ~taken
        by_design = (np.any(each.reshape(-1, self.m), axis=1) for each in (left, fresh))
        open_ = np.repeat(np.logical_and(*by_design), self.m)
        rows = np.flatnonzero(left & open_)
        ends, reached = self._walked(at, rows, before, there)
        self._match(sample, rows[reached], ends[:, reached], links, taken)
        left[links >= 0] = False
        fresh &= ~taken
        by_design = (np.any(each.reshape(-1, self.m), axis=1) for each in (left, fresh))
        open_ = np.repeat(np.logical_and(*by_design), self.m)
        rows = np.flatnonzero(fresh & open_)
        ends, reached = self._walked(sample, rows, there, before)
        back = np.full(len(links), -1)
        self._match(at, rows[reached], ends[:, reached], back, links >= 0)
        on = np.flatnonzero(back >= 0)
        links[back[on]] = on
        return links

    def _match(
        self,
        sample: _Sample,
        rows: NDArray[np.intp],
        ends: Floats,
        links: NDArray[np.intp],
        taken: Flags,
    ) -> None:
        """Set in which rows of a sample ways of rows end; each is taken once."""
        for row, end in zip(rows, ends.T, strict=True):
            other = self._at(sample, row // self.m, end)
            if other < 0 or taken[other]:
                self.lost[row // self.m] = True
            else:
                links[row], taken[other] = other, True

    def _at(self, sample: _Sample, design: int, end: Floats) -> int:
        """Return the real row of a design at a configuration, -1 without one."""
        own = design * self.m + np.flatnonzero(
            sample.real[design * self.m : (design + 1) * self.m]
        )
        if not len(own):
            return -1
        gaps = apart(sample.values[:, own].real, end[:, None])
        best = int(np.argmin(gaps))
        return int(own[best]) if gaps[best] < STAYS else -1

    def _walked(
        self, at: _Sample, rows: NDArray[np.intp], start: float, stop: float
    ) -> tuple[Floats, Flags]:
        """Return where real ways (variables, n) of rows lead to, and which of them hold."""
        kernel, n = self.kernel, len(rows)
        now = np.ascontiguousarray(at.values[:, rows].real)
        rates = np.ascontiguousarray(at.rates[:, rows].real)
        sign = np.sign(at.determinant[rows].real)
        t, step = np.zeros(n), np.full(n, 0.5)
        prepared = np.ascontiguousarray(self.prepared[:, rows])
        active = np.arange(n)
        with np.errstate(all="ignore"):
            while len(active):
                there = np.minimum(t[active] + step[active], 1.0)
                h = (there - t[active]) * (stop - start)
                own = np.ascontiguousarray(prepared[:, active])
                guess = now[:, active] + rates[:, active] * h
                guess[kernel.driven] = start + there * (stop - start)
                made, first, second = corrected(kernel, guess, own)
                here = kernel.at(made, own)
                made = made + here.step
                moved = np.max(np.abs(made - now[:, active]), axis=0)
                turn = _cosine(here.rates, rates[:, active])
                good = (
                    (first <= RIGHT * moved + TINY)
                    & (second <= CONTRACTS * first + TINY)
                    & (np.sign(here.determinant) == sign[active])
                    & (turn > TURN)
                )
                onward = active[good]
                now[:, onward], rates[:, onward] = made[:, good], here.rates[:, good]
                t[onward] = there[good]
                step[active[~good]] *= 0.5
                step[onward] *= 1.5
                active = active[(t[active] < 1.0) & (step[active] >= SMALLEST)]
        return now, t >= 1.0


def _smooth(at: _Sample, sample: _Sample, rows: NDArray[np.intp], h: float) -> Flags:
    """Return which real rows go on in themselves: by values and rates at both ends."""
    moved = (sample.values[:, rows] - at.values[:, rows]).real
    one, other = at.rates[:, rows].real, sample.rates[:, rows].real
    with np.errstate(all="ignore"):
        off = np.max(np.abs(moved - 0.5 * h * (one + other)), axis=0)
        same = (at.determinant[rows].real > 0.0) == (sample.determinant[rows].real > 0.0)
        size = np.max(np.abs(moved), axis=0)
        right = (off <= RIGHT * size + TINY) & (_cosine(one, other) > TURN)
    return np.asarray(same & right)


def _cosine(one: Floats, other: Floats) -> Floats:
    """Return the cosine (n,) between two tangents by their rates (variables, n)."""
    sizes = np.sum(one * one, axis=0) * np.sum(other * other, axis=0)
    return np.asarray(np.sum(one * other, axis=0) / np.sqrt(sizes))
