"""Assembly modes of many designs at samples of the inputs, with none missing.

All complex solutions of one design are followed to every design, and there from sample to
sample; where one is lost, or two have become one, again off the real axis, where they
cannot meet. As many distinct ones as there are make sure that no real one is missing at any
sample. Which of those at neighbouring samples are one mode is decided by real steps that
pass the tests of continuation (docs/motion.md). Over a grid of several inputs a mode is
what such steps join, along any axis: but one configuration at a sample, where ways around
a singularity would join two.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.arrays import Array, Bools, Floats, Indices
from spherekit.design.all_solutions import (
    StartSet,
    Way,
    apart,
    corrected,
    distinct,
    settled,
    tracked,
)
from spherekit.design.profile_numbers import followed
from spherekit.engine.design_kernel import PathKernel
from spherekit.motion.input_grid import InputGrid
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


@final
@dataclass(frozen=True)
class Modes:
    """Assembly modes of designs: one row for each.

    `design` (m,) counts within what was given; `values` (variables, samples, m) are NaN
    where a mode does not close. `labels` are as in `AssemblyMode`, after a number in each
    design. `lost` lists the designs of which not all was found.
    """

    design: Indices
    values: Floats
    labels: tuple[str, ...]
    lost: Indices


def followed_modes(
    kernel: PathKernel, start: StartSet, sizes: Floats, lattice: InputGrid
) -> Modes:
    """Return the modes of designs (sizes, n) at inputs: a path, or a grid."""
    m = start.values.shape[1]
    following = _Following(kernel, np.repeat(sizes, m, axis=1), m)
    q, previous = lattice.q, lattice.neighbours()[1::2]
    sheets = _Sheets(len(q), sizes.shape[1], m)
    kept: dict[int, _Sample] = {}
    values = nans((len(q), kernel.variables, sizes.shape[1] * m))
    for k in range(len(q)):
        before = sorted((int(row) for row in previous[:, k] if row >= 0), reverse=True)
        if not before:
            at = following.begun(start, q[k])
            sheets.begin(k, at.real)
        else:
            first, *others = before
            at = following.onward(kept[first], q[first], q[k])
            links = following.links(kept[first], at, q[first], q[k])
            more = [
                (other, following.across(kept[other], at, q[other], q[k]))
                for other in others
            ]
            sheets.go_on(k, at.real, [(first, links), *more])
        kept[k] = at
        kept.pop(k - len(q) // lattice.shape[0], None)
        values[k][:, at.real] = at.values[:, at.real].real
    lost = np.flatnonzero(following.lost)
    design, configurations = sheets.gathered(values, lost)
    design, configurations = _ordered(design, configurations)
    return Modes(
        design, configurations, _labels(kernel, sizes, design, configurations), lost
    )


def _ordered(design: Indices, values: Floats) -> tuple[Indices, Floats]:
    """Return modes by design, then by the first sample at which they close, and how."""
    first = np.argmax(np.isfinite(values[0]), axis=0)
    there = values[:, first, np.arange(len(first))]
    keys = np.round(there - 2.0 * np.pi * np.round(there / (2.0 * np.pi)), 6)
    order = np.lexsort((*keys[::-1], first, design))
    return design[order], values[:, :, order]


def _labels(
    kernel: PathKernel, sizes: Floats, design: Indices, values: Floats
) -> tuple[str, ...]:
    first = np.argmax(np.isfinite(values[0]), axis=0)
    there = values[:, first, np.arange(len(first))]
    prepared = kernel.prepare(np.ascontiguousarray(sizes[:, design]))
    begins = np.searchsorted(design, design)
    numbers = np.arange(len(design)) - begins
    texts = kernel.labels(there, prepared)
    return tuple(f"{k} {text}" for k, text in zip(numbers, texts, strict=True))


def _onward(h: Floats, rates: Array) -> Array:
    """Return rates (variables, n) while inputs go on by h (inputs,), from those of each."""
    return np.asarray(np.tensordot(h, rates, 1))


@final
@dataclass(frozen=True)
class _Sample:
    """Solutions (variables, n) at a sample, which are real (n,), and what follows."""

    values: Array
    real: Bools
    rates: Array
    determinant: Array

    def along(self, h: Floats) -> Array:
        """Return the rates (variables, n) while the inputs go on by h (inputs,)."""
        return _onward(h, self.rates)


@final
class _Sheets:
    """The numbers of the modes that rows are on at samples, -1 where they are on none."""

    def __init__(self, samples: int, designs: int, together: int) -> None:
        self.m, self.count = together, 0
        self.number = np.full((samples, designs * together), -1)

    def begin(self, k: int, real: Bools) -> None:
        """Begin a mode with each real row of a sample that is on none."""
        fresh = np.flatnonzero(real & (self.number[k] < 0))
        self.number[k, fresh] = self.count + np.arange(len(fresh))
        self.count += len(fresh)

    def go_on(self, k: int, real: Bools, links: Sequence[tuple[int, Indices]]) -> None:
        """Go on to a sample from others: `links` (n,) say to which row those there lead."""
        for other, to in links:
            on = np.flatnonzero(to >= 0)
            there, here = self.number[other, on], self.number[k, to[on]]
            fresh = here < 0
            # A row of another sample of this mode may have come here already.
            for row, number in zip(to[on[fresh]], there[fresh], strict=True):
                if not np.any(self.number[k, self._own(row)] == number):
                    self.number[k, row] = number
            for row, one, two in zip(
                to[on[~fresh]], here[~fresh], there[~fresh], strict=True
            ):
                if one != two:
                    self._join(self._own(row), int(one), int(two))
        self.begin(k, real)

    def _own(self, row: int) -> slice:
        """Return the rows of the design of a row."""
        start = row // self.m * self.m
        return slice(start, start + self.m)

    def _join(self, part: slice, one: int, other: int) -> None:
        """Make two modes of a design one, unless both have a configuration somewhere."""
        here = self.number[:, part]
        both = np.any(here == one, axis=1) & np.any(here == other, axis=1)
        if not np.any(both):
            here[here == max(one, other)] = min(one, other)

    def gathered(self, solutions: Floats, lost: Indices) -> tuple[Indices, Floats]:
        """Return the design (modes,) and values (variables, samples, modes) of each."""
        k, row = np.nonzero(self.number >= 0)
        good = ~np.isin(row // self.m, lost)
        k, row = k[good], row[good]
        numbers, mode = np.unique(self.number[k, row], return_inverse=True)
        design = np.zeros(len(numbers), dtype=np.intp)
        design[mode] = row // self.m
        values = nans((solutions.shape[1], len(solutions), len(numbers)))
        values[:, k, mode] = solutions[k, :, row].T
        return design, values


@final
class _Following:
    """All solutions of designs, `together` rows of each, while the inputs go on."""

    def __init__(self, kernel: PathKernel, sizes: Floats, together: int) -> None:
        self.kernel, self.sizes, self.m = kernel, sizes, together
        self.prepared = kernel.prepare(np.ascontiguousarray(sizes))
        self.lost = np.zeros(sizes.shape[1] // together, dtype=bool)

    def begun(self, start: StartSet, q: Floats) -> _Sample:
        """Return the first sample."""
        n = len(self.lost)
        way = Way((start.sizes[:, None], self.sizes), (start.q[:, None], q[:, None]))
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
            start = np.ascontiguousarray(values[:, near].real)
            refined, closed = settled(
                self.kernel, start, np.ascontiguousarray(self.prepared[:, near])
            )
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
            made, first, _ = corrected(kernel, guess, self.prepared)
            made[:, ~(first < 1.0)] = np.nan
            made, closed = settled(kernel, made, self.prepared)
        values, real = self._real(np.where(closed, made, np.nan), alive)
        again = ~self._whole(values) & ~self.lost
        for bend in BENDS:
            if not np.any(again):
                break
            rows = np.flatnonzero(np.repeat(again, self.m))
            sizes, ends = self.sizes[:, rows], (before[:, None], there[:, None])
            way = Way((sizes, sizes), ends, 1j * bend * h[:, None])
            arrivals, arrived = tracked(kernel, way, at.values[:, rows])
            arrivals[:, ~arrived] = np.nan
            values[:, rows] = arrivals
            values, real = self._real(values, np.repeat(again, self.m))
            again &= ~self._whole(values)
        self.lost |= again
        return self._sample(values, real)

    def across(
        self, at: _Sample, sample: _Sample, before: Floats, there: Floats
    ) -> Indices:
        """Return `links` to a sample that was come to from another one.

        Rows that the rates at both ends lead to each other are tried first.
        """
        h = there - before
        onto = self._nearest(at.real, at.values + at.along(h), sample)
        back = self._nearest(sample.real, sample.values - sample.along(h), at)
        mutual = (onto >= 0) & (back[onto] == np.arange(len(onto)))
        likely = np.where(mutual, onto, -1)
        lost_before = self.lost.copy()
        made = self.links(at, sample, before, there, likely)
        doubtful = self.lost & ~lost_before
        if np.any(doubtful):
            # What two rows led to is decided by walking all of them.
            self.lost[doubtful] = False
            likely[np.repeat(doubtful, self.m)] = -1
            made = self.links(at, sample, before, there, likely)
        return made

    def _nearest(self, rows: Bools, guess: Array, sample: _Sample) -> Indices:
        """Return the real rows (n,) of a sample that guesses are nearest to, or -1."""
        nearest = np.full(len(rows), -1)
        chosen = np.flatnonzero(rows)
        design = chosen // self.m
        values = sample.values.real.reshape(len(guess), -1, self.m)
        gaps = apart(values[:, design], guess.real[:, chosen, None])
        real = sample.real.reshape(-1, self.m)[design]
        gaps[~real] = np.inf
        some = np.any(real, axis=1)
        nearest[chosen[some]] = (design * self.m + np.argmin(gaps, axis=1))[some]
        return nearest

    def links(
        self,
        at: _Sample,
        sample: _Sample,
        before: Floats,
        there: Floats,
        likely: Indices | None = None,
    ) -> Indices:
        """Return in which row (n,) of a sample the mode of a row before goes on, or -1.

        `likely` (n,) are the rows that are tried first, each once, or -1; by default the
        same. Where no row is left over on one side, those on the other end, or begin,
        between.
        """
        same = np.arange(len(at.real)) if likely is None else likely
        both = np.flatnonzero(at.real & (same >= 0) & sample.real[same])
        links = np.full(len(at.real), -1)
        sure = both[_smooth(at, sample, both, same[both], there - before)]
        links[sure] = same[sure]
        taken = np.zeros(len(links), dtype=bool)
        taken[same[sure]] = True
        left, fresh = at.real & (links < 0), sample.real & ~taken
        rows = np.flatnonzero(left & self._open(left, fresh))
        self._lead(at, sample, rows, (before, there), links, taken)
        left, fresh = left & (links < 0), fresh & ~taken
        rows, back = (
            np.flatnonzero(fresh & self._open(left, fresh)),
            np.full(len(links), -1),
        )
        self._lead(sample, at, rows, (there, before), back, links >= 0)
        on = np.flatnonzero(back >= 0)
        links[back[on]] = on
        return links

    def _open(self, left: Bools, fresh: Bools) -> Bools:
        """Return the rows (n,) of designs that have rows of both kinds."""
        both = [np.any(flags.reshape(-1, self.m), axis=1) for flags in (left, fresh)]
        return np.repeat(both[0] & both[1], self.m)

    def _lead(
        self,
        at: _Sample,
        sample: _Sample,
        rows: Indices,
        ends: tuple[Floats, Floats],
        links: Indices,
        taken: Bools,
    ) -> None:
        """Set in which rows of a sample real ways of rows end; each is taken once."""
        start, stop = ends
        sizes = self.sizes[:, rows]
        turned = dict(zip(self.kernel.driven, stop - start, strict=True))
        begun = np.ascontiguousarray(at.values[:, rows].real)
        values, reached = followed(
            self.kernel, begun, sizes, np.zeros_like(sizes), turned=turned
        )
        for row, end in zip(rows[reached], values[:, reached].T, strict=True):
            other = self._at(sample, row // self.m, end)
            if other < 0 or taken[other]:
                self.lost[row // self.m] = True
            else:
                links[row], taken[other] = other, True

    def _at(self, sample: _Sample, design: int, end: Floats) -> int:
        """Return the real row of a design at a configuration, -1 without one."""
        of_design = design * self.m + np.flatnonzero(
            sample.real[design * self.m : (design + 1) * self.m]
        )
        if not len(of_design):
            return -1
        gaps = apart(sample.values[:, of_design].real, end[:, None])
        best = int(np.argmin(gaps))
        return int(of_design[best]) if gaps[best] < STAYS else -1


def _smooth(
    at: _Sample,
    sample: _Sample,
    rows: Indices,
    to: Indices,
    h: Floats,
) -> Bools:
    """Return which real rows go on in others: by values and rates at both ends."""
    moved = (sample.values[:, to] - at.values[:, rows]).real
    one, other = at.along(h)[:, rows].real, sample.along(h)[:, to].real
    with np.errstate(all="ignore"):
        # Other ways here may have counted other whole turns.
        away = moved - 0.5 * (one + other)
        turns = 2.0 * np.pi * np.round(away / (2.0 * np.pi))
        off, moved = max_abs(away - turns, axis=0), moved - turns
        same = (at.determinant[rows].real > 0.0) == (sample.determinant[to].real > 0.0)
        size = max_abs(moved, axis=0)
        right = (off <= RIGHT * size + TINY) & (_cosine(one, other) > TURN)
    return np.asarray(same & right)


def _cosine(one: Floats, other: Floats) -> Floats:
    """Return the cosine (n,) between two tangents by their rates (variables, n)."""
    sizes = np.sum(one * one, axis=0) * np.sum(other * other, axis=0)
    return np.asarray(np.sum(one * other, axis=0) / np.sqrt(sizes))
