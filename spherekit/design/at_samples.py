"""Kernels of designs at the samples of their inputs."""

from collections.abc import Iterator, Sequence
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.design.profile_numbers import columns_of
from spherekit.engine.design_kernel import DesignKernel
from spherekit.model.joints import Track
from spherekit.motion.motion import Motion
from spherekit.numeric.turns import wrap
from spherekit.sphere.rotation import Floats

BLOCK = 4096
"""Designs evaluated together: their rows stay in the cache."""

Sampled = Iterator[tuple[Floats, Floats, NDArray[np.bool_]]]
"""A sample, the kernel's columns (c, n) there, and who closes (n,)."""


@final
class Winding:
    """Turns of the pairs of a kernel, by which loads are wound, from sample to sample.

    They are those of `spherekit.motion.continued`: along a path an angle moves by less
    than half a turn from one sample that closes to the next, and starts in (-pi, pi]. Over
    a grid none is counted. `q` (k, inputs) are the samples' inputs; at others the turns are
    those of the nearest sample.
    """

    def __init__(self, kernel: DesignKernel, count: int, q: Floats, along: bool) -> None:
        self._kernel, self._q, self._along = kernel, q, along
        self._last = np.full((len(kernel.turning), count), np.nan)
        self._every: list[Floats] = []

    def at(self, rows: Floats, first: int, samples: Floats, beside: bool) -> None:
        """Put turns into rows (r, k, n) at samples (k, w), from a row on."""
        if beside:
            self.fill_beside(rows, first, samples[:, : self._q.shape[1]])
        else:
            self.fill(rows, first)

    def fill(self, rows: Floats, first: int) -> None:
        """Put turns into rows (r, k, n) of the next samples, from a row on."""
        for k, theta in enumerate(self._angles(rows, first)):
            if self._along:
                step = wrap(theta - self._last)
                angle = np.where(np.isnan(self._last), wrap(theta), self._last + step)
                self._last = np.where(np.isnan(angle), self._last, angle)
            else:
                angle = wrap(theta)
            self._every.append(angle)
            rows[first : first + len(theta), k] = np.nan_to_num(angle - theta)

    def fill_beside(self, rows: Floats, first: int, q: Floats) -> None:
        """Put turns into rows (r, k, n) at inputs q (k, inputs) between those samples."""
        for k, theta in enumerate(self._angles(rows, first)):
            near = int(np.argmin(np.max(np.abs(self._q - q[k]), axis=1)))
            beside = np.nan_to_num(self._every[near])
            angle = beside + wrap(theta - beside)
            rows[first : first + len(theta), k] = np.nan_to_num(angle - theta)

    def _angles(self, rows: Floats, first: int) -> Iterator[Floats]:
        """Yield the variables (pairs, n) at each of the samples; NaN where it is open."""
        kernel = self._kernel
        if kernel.angles is None:
            return
        rows[first : first + len(kernel.turning)] = 0.0
        outputs = kernel.angles(rows.reshape(len(rows), -1))
        shaped = np.reshape(outputs, (-1, *rows.shape[1:]))
        closed = np.all(shaped[: kernel.reaches] >= 0.0, axis=0)
        for k in range(rows.shape[1]):
            yield np.where(closed[k], shaped[kernel.reaches :, k], np.nan)


def in_mode(
    kernel: DesignKernel,
    prepared: Floats,
    signs: Sequence[float],
    samples: Floats,
    winding: Winding,
    beside: bool = False,
) -> Sampled:
    """Yield designs in an assembly mode at samples (k, w), as many at once as pay.

    Or `beside` those whose turns are known.
    """
    n, width = prepared.shape[1], samples.shape[1]
    together = max(1, BLOCK // n)
    turns = width + len(signs)
    fixed = turns + len(kernel.turning)
    for start in range(0, len(samples), together):
        some = samples[start : start + together]
        rows = np.empty((fixed + len(prepared), len(some), n))
        rows[:width] = some.T[:, :, None]
        rows[width:turns] = np.array(signs)[:, None, None]
        rows[fixed:] = prepared[:, None, :]
        winding.at(rows, turns, some, beside)
        outputs = kernel.evaluate(rows.reshape(len(rows), -1))
        shaped = np.reshape(outputs, (-1, len(some), n))
        for k, sample in enumerate(some):
            closed = np.all(shaped[: kernel.reaches, k] >= 0.0, axis=0)
            yield sample, shaped[kernel.reaches :, k], closed


def at_variables(
    kernel: DesignKernel,
    motion: Motion,
    samples: Floats,
    tracks: Sequence[Track],
    winding: Winding,
    beside: bool = False,
) -> Sampled:
    """Yield the assembly modes of one design, with profiles, at samples (k, w)."""
    modes = len(motion.assembly_modes)
    if not modes:
        return
    shape = modes, len(samples)
    closed = ~motion.failed.reshape(shape)
    every = np.tile(samples, (modes, 1)).T
    given = [every, motion.values.T]
    if tracks:
        given.append(columns_of(tracks, motion.values))
    whole = np.concatenate(given)
    rows = np.empty((len(whole) + len(kernel.turning), shape[1], shape[0]))
    rows[: len(whole)] = np.swapaxes(whole.reshape(-1, *shape), 1, 2)
    winding.at(rows, len(whole), samples, beside)
    outputs = kernel.evaluate(rows.reshape(len(rows), -1))
    shaped = np.swapaxes(np.reshape(outputs, (-1, shape[1], shape[0])), 1, 2)
    for k, sample in enumerate(samples):
        yield sample, shaped[:, :, k], closed[:, k]


def at_modes(
    kernel: DesignKernel,
    prepared: Floats,
    values: Floats,
    samples: Floats,
    winding: Winding,
    beside: bool = False,
) -> Sampled:
    """Yield modes at samples (k, w) where they have these values (variables, k, n)."""
    n, width = prepared.shape[1], samples.shape[1]
    if not n:
        return
    together = max(1, BLOCK // n)
    turns = width + len(values)
    fixed = turns + len(kernel.turning)
    for start in range(0, len(samples), together):
        some = samples[start : start + together]
        rows = np.empty((fixed + len(prepared), len(some), n))
        rows[:width] = some.T[:, :, None]
        rows[width:turns] = values[:, start : start + len(some)]
        rows[fixed:] = prepared[:, None, :]
        winding.at(rows, turns, some, beside)
        outputs = kernel.evaluate(rows.reshape(len(rows), -1))
        shaped = np.reshape(outputs, (-1, len(some), n))
        closed = np.isfinite(rows[width])
        for k, sample in enumerate(some):
            yield sample, shaped[:, k], closed[k]
