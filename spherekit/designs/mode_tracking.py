"""Assembly modes of many designs at samples of the inputs, with none missing.

All complex solutions of one design are followed to every design, and there from sample to
sample; where one is lost, or two have become one, again off the real axis, where they
cannot meet. As many distinct ones as there are make sure that no real one is missing at any
sample. Which of those at neighbouring samples are one mode is decided by real steps that
pass the tests of continuation (docs/motion.md). Over a grid of several inputs a mode is
what such steps join, along any axis: but one configuration at a sample, where ways around
a singularity would join two.
"""

import numpy as np

from spherekit.arrays import Array, Bools, Floats, Indices, Integers
from spherekit.conventions import Names
from spherekit.designs.homotopy import (
    LONG,
    StartSolutions,
    apart,
    distinct,
    settled,
    tracked,
)
from spherekit.designs.path_kernel import PathKernel
from spherekit.geometry.vectors import max_abs, nans
from spherekit.numerics.angles import wrap
from spherekit.positions.input_grid import InputGrid

BENDS = (0.0, 0.5, -0.9, 1.7)
"""How far off the real axis a way between two samples goes, as parts of its length."""
REAL = 1e-4
"""Solutions nearer (rad) than this to the real axis may be real ones, off by rounding."""
STAYS = 1e-6
"""Such a one is, if Newton's method on the real axis moves it by less (rad)."""


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
    q = lattice.q[:, :, None]
    previous = lattice.neighbours()[1::2]
    width = sizes.shape[1] * m
    kept: dict[int, Array] = {}
    values = nans((kernel.variables, len(q), width))
    number = np.full((len(q), width), -1)  # of the mode that a row is on at a sample
    for k in range(len(q)):
        before = sorted(previous[previous[:, k] >= 0, k], reverse=True)
        begun = np.tile(start.values, (1, sizes.shape[1]))
        begin = start.q[:, None]
        given = np.broadcast_to(start.sizes[:, None], following.sizes.shape)
        if before:
            begun = kept[before[0]]
            begin = q[before[0]]
            given = following.sizes
        at = kept[k] = following.onward(begun, given, (begin, q[k]))
        real = is_real(at)
        number[k, real] = k * width + np.flatnonzero(real)
        for other in before:
            links = following.links(kept[other], at, (q[other], q[k]))
            rows = np.flatnonzero(links >= 0)
            if other == before[0]:
                number[k, links[rows]] = number[other, rows]
                continue
            for row in rows:
                one, two = sorted((number[other, row], number[k, links[row]]))
                here = number[:, row // m * m :][:, :m]
                # Two modes are one, unless both have a configuration somewhere.
                if not np.any(np.any(here == one, axis=1) & np.any(here == two, axis=1)):
                    here[here == two] = one
        kept.pop(k - len(q) // lattice.shape[0], None)
        values[:, k, real] = at[:, real].real
    number[:, np.repeat(following.lost, m)] = -1
    return _gathered(kernel, sizes, values, number, following.lost)


def is_real(values: Array) -> Bools:
    """Return which solutions (variables, ...) are real."""
    return np.all(values.imag == 0.0, axis=0)


def _gathered(
    kernel: PathKernel, sizes: Floats, solutions: Floats, number: Integers, lost: Bools
) -> tuple[Indices, Floats, Names, Indices]:
    """Return modes by design, then by the first sample at which they close, and how."""
    k, row = np.nonzero(number >= 0)
    _, begun, mode = np.unique(number[k, row], return_index=True, return_inverse=True)
    design = row[begun] // (number.shape[1] // len(lost))
    values = nans((*solutions.shape[:2], len(begun)))
    values[:, k, mode] = solutions[:, k, row]
    free = np.delete(np.arange(len(values)), kernel.driven)
    values[free] = wrap(values[free])
    first = np.argmax(np.isfinite(values[0]), axis=0)
    there = values[:, first, np.arange(len(first))]
    order = np.lexsort((*np.round(there[::-1], 6), first, design))
    design = design[order]
    values = values[:, :, order]
    there = there[:, order]
    counts = np.arange(len(design)) - np.searchsorted(design, design)
    texts = zip(counts, kernel.labels(there, sizes[:, design]), strict=True)
    return design, values, tuple(f"{k} {text}" for k, text in texts), np.flatnonzero(lost)


class _Following:
    """All solutions of designs, `together` rows of each, while the inputs go on.

    `lost` are the designs of which not all are there.
    """

    def __init__(self, kernel: PathKernel, sizes: Floats, together: int) -> None:
        self.kernel, self.sizes, self.m = kernel, sizes, together
        self.lost = np.zeros(sizes.shape[1] // together, bool)

    def onward(self, begun: Array, sizes: Floats, q: tuple[Array, Array]) -> Array:
        """Return the solutions (variables, n) to which those of other sizes lead.

        While the inputs go from the one to the other of `q` (inputs, 1). Where two have
        become one, off the real axis.
        """
        made = np.full(begun.shape, np.nan, dtype=complex)
        left = ~self.lost
        for bend in BENDS:
            rows = np.flatnonzero(np.repeat(left, self.m))
            if not len(rows):
                break
            ends = sizes[:, rows], self.sizes[:, rows]
            start = begun[:, rows].astype(complex)
            aside = 1j * bend * (q[1] - q[0])
            arrivals, arrived = tracked(self.kernel, start, ends, q, aside)
            made[:, rows] = np.where(arrived, arrivals, np.nan)
            self._set_real(made, rows)
            left &= ~distinct(made.reshape(len(made), -1, self.m))
        self.lost |= left
        made[:, np.repeat(self.lost, self.m)] = np.nan
        return made

    def _set_real(self, values: Array, rows: Indices) -> None:
        """Make those of some solutions real that are so but for rounding.

        A design of which one is neither the one nor the other is lost.
        """
        off = max_abs(values[:, rows].imag, axis=0)
        some = (off > 0.0) & (off < REAL)
        near = rows[some]
        start = values[:, near].real
        prepared = self.kernel.prepare(self.sizes[:, near])
        refined, closed = settled(lambda x, k: self.kernel.at(x, prepared[:, k]), start)
        stays = closed & (max_abs(refined - start, axis=0) < STAYS)
        values[:, near[stays]] = refined[:, stays]
        self.lost[near[~stays & (off[some] < STAYS)] // self.m] = True

    def links(self, at: Array, there: Array, q: tuple[Array, Array]) -> Indices:
        """Return in which row (n,) of a sample the mode of a row goes on, or -1.

        By real ways. What two of them lead to, or one leads nowhere, is of a lost design.
        """
        rows = np.flatnonzero(is_real(at))
        links = np.full(at.shape[1], -1)
        sizes = self.sizes[:, rows]
        begun = at[:, rows].real
        ends, reached = tracked(self.kernel, begun, (sizes, sizes), q, contracts=LONG)
        rows = rows[reached]
        ends = ends[:, reached]
        design = rows // self.m
        others = there.reshape(len(there), -1, self.m)[:, design]
        gaps = apart(others.real, ends[:, :, None])
        gaps[~is_real(others)] = np.inf
        best = design * self.m + np.argmin(gaps, axis=1)
        sure = np.min(gaps, axis=1) < STAYS
        links[rows[sure]] = best[sure]
        _, first = np.unique(links[rows], return_index=True)
        sure[np.delete(np.arange(len(rows)), first)] = False
        self.lost[design[~sure]] = True
        return links
