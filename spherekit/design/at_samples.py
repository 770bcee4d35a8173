"""Kernels of designs at the samples of their inputs."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from spherekit.design.profile_numbers import columns_of
from spherekit.engine.design_kernel import DesignKernel
from spherekit.model.joints import Track
from spherekit.motion.motion import Motion
from spherekit.sphere.rotation import Floats

BLOCK = 4096
"""Designs evaluated together: their rows stay in the cache."""

Sampled = Iterator[tuple[Floats, Floats, NDArray[np.bool_]]]
"""A sample, the kernel's columns (c, n) there, and who closes (n,)."""


def in_mode(
    kernel: DesignKernel,
    prepared: Floats,
    signs: Sequence[float],
    samples: Floats,
    turns: Floats,
) -> Sampled:
    """Yield designs in an assembly mode at samples (k, w), as many at once as pay.

    `turns` (pairs, k, n), rad, are those of the pairs of the kernel.
    """
    n, width = prepared.shape[1], samples.shape[1]
    together = max(1, BLOCK // n)
    first = width + len(signs)
    fixed = first + len(kernel.turning)
    for start in range(0, len(samples), together):
        some = samples[start : start + together]
        rows = np.empty((fixed + len(prepared), len(some), n))
        rows[:width] = some.T[:, :, None]
        rows[width:first] = np.array(signs)[:, None, None]
        rows[fixed:] = prepared[:, None, :]
        rows[first:fixed] = turns[:, start : start + len(some)]
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
    turns: Floats,
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
    rows[len(whole) :] = turns
    outputs = kernel.evaluate(rows.reshape(len(rows), -1))
    shaped = np.swapaxes(np.reshape(outputs, (-1, shape[1], shape[0])), 1, 2)
    for k, sample in enumerate(samples):
        yield sample, shaped[:, :, k], closed[:, k]


def at_modes(
    kernel: DesignKernel,
    prepared: Floats,
    values: Floats,
    samples: Floats,
    turns: Floats,
) -> Sampled:
    """Yield modes at samples (k, w) where they have these values (variables, k, n)."""
    n, width = prepared.shape[1], samples.shape[1]
    if not n:
        return
    together = max(1, BLOCK // n)
    first = width + len(values)
    fixed = first + len(kernel.turning)
    for start in range(0, len(samples), together):
        some = samples[start : start + together]
        rows = np.empty((fixed + len(prepared), len(some), n))
        rows[:width] = some.T[:, :, None]
        rows[width:first] = values[:, start : start + len(some)]
        rows[fixed:] = prepared[:, None, :]
        rows[first:fixed] = turns[:, start : start + len(some)]
        outputs = kernel.evaluate(rows.reshape(len(rows), -1))
        shaped = np.reshape(outputs, (-1, len(some), n))
        closed = np.isfinite(rows[width])
        for k, sample in enumerate(some):
            yield sample, shaped[:, k], closed[k]
