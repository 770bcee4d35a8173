"""Assembly modes of many designs at samples of the inputs, with none missing.

All complex solutions of one design are followed to every design, and there from sample to
sample; where one is lost, or two have become one, again off the real axis, where they
cannot meet. As many distinct ones as there are make sure that no real one is missing at any
sample. Which of those at neighbouring samples are one mode is decided by real steps that
pass the tests of continuation (docs/motion.md). Over a grid of several inputs a mode is
what such steps join, along any axis: but one configuration at a sample, where ways around
a singularity would join two.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Array, Bools, Floats, Indices, Integers
from spherekit.conventions import Names
from spherekit.design.homotopy import (
    LONG,
    Equations,
    StartSolutions,
    apart,
    corrected,
    distinct,
    settled,
    straight,
    tracked,
)
from spherekit.engine.design_kernel import PathKernel
from spherekit.motion.input_grid import InputGrid
from spherekit.numeric.crossings import wrap
from spherekit.sphere.rotation import max_abs, nans

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


def followed_modes(
    kernel: PathKernel, start: StartSolutions, sizes: Floats, lattice: InputGrid
) -> tuple[Indices, Floats, Names, Indices]:
    """Return the modes of designs (sizes, n) at inputs, a path or a grid, m in all.

    Their designs (m,), as counted in what was given; values (variables, samples, m), NaN
    where a mode does not close; labels as in `AssemblyMode`, after a number in each design;
    and the designs of which not all was found.
    """
    m = start.values.shape[1]
    following = _Following(kernel, np.repeat(sizes, m, axis=1), m)
    q, previous = lattice.q, lattice.neighbours()[1::2]
    width = sizes.shape[1] * m
    kept: dict[int, _Sample] = {}
    values = nans((kernel.variables, len(q), width))
    number = np.full((len(q), width), -1)  # of the mode that a row is on at a sample
    for k in range(len(q)):
        before = sorted((int(row) for row in previous[:, k] if row >= 0), reverse=True)
        at = (
            following.onward(kept[before[0]], q[before[0]], q[k])
            if before
            else following.begun(start, q[k])
        )
        number[k, at.real] = k * width + np.flatnonzero(at.real)
        for other in before:
            links = following.links(kept[other], at, q[other], q[k])
            rows = np.flatnonzero(links >= 0)
            if other == before[0]:
                number[k, links[rows]] = number[other, rows]
                continue
            for row in rows.tolist():
                ends = number[other, row], number[k, links[row]]
                _join(number[:, following.own(row)], min(ends), max(ends))
        kept[k] = at
        kept.pop(k - len(q) // lattice.shape[0], None)
        values[:, k, at.real] = at.values[:, at.real].real
    number[:, np.repeat(following.lost, m)] = -1
    return _gathered(kernel, sizes, values, number, following.lost)


def _join(here: Integers, one: int, other: int) -> None:
    """Make two modes one where both are, unless both have a configuration somewhere."""
    if not np.any(np.any(here == one, axis=1) & np.any(here == other, axis=1)):
        here[here == other] = one


def _gathered(
    kernel: PathKernel, sizes: Floats, solutions: Floats, number: Integers, lost: Bools
) -> tuple[Indices, Floats, Names, Indices]:
    """Return modes by design, then by the first sample at which they close, and how."""
    k, row = np.nonzero(number >= 0)
    numbers, mode = np.unique(number[k, row], return_inverse=True)
    design = np.zeros(len(numbers), dtype=np.intp)
    design[mode] = row // (number.shape[1] // len(lost))
    values = nans((*solutions.shape[:2], len(numbers)))
    values[:, k, mode] = solutions[:, k, row]
    first = np.argmax(np.isfinite(values[0]), axis=0)
    there = values[:, first, np.arange(len(first))]
    keys = np.round(wrap(there), 6)
    order = np.lexsort((*keys[::-1], first, design))
    design, values, there = design[order], values[:, :, order], there[:, order]
    prepared = kernel.prepare(sizes[:, design])
    counts = np.arange(len(design)) - np.searchsorted(design, design)
    texts = zip(counts, kernel.labels(there, prepared), strict=True)
    labels = tuple(f"{k} {text}" for k, text in texts)
    return design, values, labels, np.flatnonzero(lost)


@dataclass(frozen=True)
class _Sample:
    """Solutions (variables, n) at a sample, which are real (n,), and what follows."""

    values: Array
    real: Bools
    rates: Array
    determinant: Array

    def along(self, h: Floats) -> Array:
        """Return the rates (variables, n) while the inputs go on by h (inputs,)."""
        return np.tensordot(h, self.rates, 1)


class _Following:
    """All solutions of designs, `together` rows of each, while the inputs go on."""

    def __init__(self, kernel: PathKernel, sizes: Floats, together: int) -> None:
        self.kernel, self.sizes, self.m = kernel, sizes, together
        self.prepared = kernel.prepare(sizes)
        self.lost = np.zeros(sizes.shape[1] // together, dtype=bool)

    def begun(self, start: StartSolutions, q: Floats) -> _Sample:
        """Return the first sample."""
        n = len(self.lost)
        way = straight((start.sizes[:, None], self.sizes), (start.q[:, None], q[:, None]))
        values, arrived = tracked(self.kernel, way, np.tile(start.values, (1, n)))
        values[:, ~arrived] = np.nan
        values, real = self._real(values, np.ones(n * self.m, dtype=bool))
        self.lost |= ~self._whole(values)
        return self._sample(values, real)

    def _sample(self, values: Array, real: Bools) -> _Sample:
        with np.errstate(all="ignore"):
            at = self.kernel.at(values, self.prepared)
        real = real & ~np.repeat(self.lost, self.m)
        return _Sample(values, real, at.rates, at.determinant)

    def _equations(self, rows: Indices) -> Equations:
        prepared = self.prepared[:, rows]
        return lambda values, some: self.kernel.at(values, prepared[:, some])

    def _whole(self, values: Array) -> Bools:
        """Return for each design whether its solutions are distinct."""
        return distinct(values.reshape(len(values), -1, self.m))

    def _real(self, values: Array, chosen: Bools) -> tuple[Array, Bools]:
        """Return solutions, those that are real but for rounding made so, and which are.

        A design whose rows are neither the one nor the other is lost.
        """
        off = max_abs(values.imag, axis=0)
        real = off == 0.0
        near = np.flatnonzero((off < REAL) & ~real & chosen)
        if len(near):
            start = values[:, near].real
            refined, closed = settled(self._equations(near), start)
            stays = closed & (max_abs(refined - start, axis=0) < STAYS)
            rows = near[stays]
            values = values.copy()
            values[:, rows] = refined[:, stays]
            real[rows] = True
            doubtful = near[~stays]
            self.lost[doubtful // self.m] |= off[doubtful] < STAYS
        return values, real

    def onward(self, at: _Sample, before: Floats, there: Floats) -> _Sample:
        """Return the sample at inputs `there` from that at inputs `before` (inputs,)."""
        kernel, h = self.kernel, there - before
        alive = ~np.repeat(self.lost, self.m)
        with np.errstate(all="ignore"):
            guess = at.values + at.along(h)
            guess[kernel.driven] = there[:, None]
            equations = self._equations(np.arange(len(alive)))
            made, first, _, _ = corrected(equations, guess)
            made[:, ~(first < 1.0)] = np.nan
            made, closed = settled(equations, made)
        values, real = self._real(np.where(closed, made, np.nan), alive)
        again = ~self._whole(values) & ~self.lost
        for bend in BENDS:
            if not np.any(again):
                break
            rows = np.flatnonzero(np.repeat(again, self.m))
            sizes, ends = self.sizes[:, rows], (before[:, None], there[:, None])
            way = straight((sizes, sizes), ends, 1j * bend * h[:, None])
            arrivals, arrived = tracked(kernel, way, at.values[:, rows])
            arrivals[:, ~arrived] = np.nan
            values[:, rows] = arrivals
            values, real = self._real(values, np.repeat(again, self.m))
            again &= ~self._whole(values)
        self.lost |= again
        return self._sample(values, real)

    def own(self, row: int) -> slice:
        """Return the rows of the design of a row."""
        start = row // self.m * self.m
        return slice(start, start + self.m)

    def links(
        self,
        at: _Sample,
        sample: _Sample,
        before: Floats,
        there: Floats,
    ) -> Indices:
        """Return in which row (n,) of a sample the mode of a row before goes on, or -1.

        The same row is tried first. Where no row is left over on one side, those on the
        other end, or begin, between. What two ways lead to, or one leads nowhere, is of a
        lost design.
        """
        both = np.flatnonzero(at.real & sample.real)
        links = np.full(len(at.real), -1)
        sure = both[_smooth(at, sample, both, there - before)]
        links[sure] = sure
        for onward in (True, False):
            left, fresh = at.real & (links < 0), sample.real.copy()
            fresh[links[links >= 0]] = False
            of_design = [np.any(x.reshape(-1, self.m), axis=1) for x in (left, fresh)]
            open_ = np.repeat(of_design[0] & of_design[1], self.m)
            if onward:
                led = self._led(at, sample, np.flatnonzero(left & open_), before, there)
            else:
                led = self._led(sample, at, np.flatnonzero(fresh & open_), there, before)
            for row, end in led:
                one, other = (row, end) if onward else (end, row)
                if end < 0 or links[one] >= 0 or other in links[self.own(row)]:
                    self.lost[row // self.m] = True
                else:
                    links[one] = other
        return links

    def _led(
        self, at: _Sample, sample: _Sample, rows: Indices, start: Floats, stop: Floats
    ) -> Iterator[tuple[int, int]]:
        """Yield rows whose real ways reach a sample, and where these end, -1 if nowhere."""
        sizes, begun = self.sizes[:, rows], at.values[:, rows].real
        way = straight((sizes, sizes), (start[:, None], stop[:, None]))
        values, reached = tracked(self.kernel, way, begun, contracts=LONG)
        for row, end in zip(rows[reached].tolist(), values[:, reached].T, strict=True):
            places = self.own(row)
            gaps = apart(sample.values[:, places].real, end[:, None])
            gaps[~sample.real[places]] = np.inf
            best = int(np.argmin(gaps))
            yield row, places.start + best if gaps[best] < STAYS else -1


def _smooth(at: _Sample, sample: _Sample, rows: Indices, h: Floats) -> Bools:
    """Return which real rows go on in themselves: by values and rates at both ends."""
    moved = (sample.values - at.values)[:, rows].real
    one, other = (x.along(h)[:, rows].real for x in (at, sample))
    with np.errstate(all="ignore"):
        # Other ways here may have counted other whole turns.
        mean = 0.5 * (one + other)
        away = wrap(moved - mean)
        off, size = max_abs(away, axis=0), max_abs(mean + away, axis=0)
        same = (at.determinant[rows].real > 0.0) == (sample.determinant[rows].real > 0.0)
        lengths = np.linalg.norm(one, axis=0) * np.linalg.norm(other, axis=0)
        cosine = np.sum(one * other, axis=0) / lengths
    return same & (off <= RIGHT * size + TINY) & (cosine > TURN)
