"""The sampled values of the inputs: a path through them, or a grid over their ranges."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Floats, Indices
from spherekit.errors import SolveError
from spherekit.geometry.rotation import all_finite
from spherekit.mechanism.elements import Input
from spherekit.mechanism.mechanism import Mechanism
from spherekit.wording import counted, listing

MOST_SAMPLES = 2**40
"""Largest number of samples. NumPy has no arrays of many more. Fewer samples can already
exceed the memory, which is reported when it happens."""


@dataclass(frozen=True)
class InputGrid:
    """Sampled inputs `q` (n, inputs) rad, in rows.

    `shape` counts the samples along each axis, the last running fastest: one axis for a
    path, one for each input for a grid.
    """

    q: Floats
    shape: tuple[int, ...]

    def __len__(self) -> int:
        return len(self.q)

    @property
    def is_path(self) -> bool:
        """Whether successive samples are neighbours."""
        return len(self.shape) == 1

    @property
    def range(self) -> tuple[float, float]:
        """The least and the greatest sampled value (rad) of a single input."""
        return float(np.min(self.q)), float(np.max(self.q))

    def neighbours(self) -> Indices:
        """Return (2 axes, n): the next and the previous sample along each axis, or -1."""
        padded = np.pad(np.arange(len(self)).reshape(self.shape), 1, constant_values=-1)
        axes = range(len(self.shape))
        inside = (slice(1, -1),) * len(axes)
        rolled = [np.roll(padded, shift, axis) for axis in axes for shift in (-1, 1)]
        return np.stack([beside[inside].ravel() for beside in rolled])

    def nearest(self, q: Floats, count: int) -> Indices:
        """Return the rows of the `count` samples nearest to inputs q (inputs,)."""
        return np.argsort(np.linalg.norm(self.q - q, axis=1), kind="stable")[:count]


def spread_rows(count: int, most: int) -> Indices:
    """Return at most so many of the numbers below a count, spread evenly."""
    return np.unique(np.linspace(0, count - 1, min(most, count)).astype(np.intp))


def sampled(
    mechanism: Mechanism,
    samples: int | Sequence[int],
    wants_grid: bool,
    path: Floats | None,
) -> InputGrid:
    """Return the samples of a mechanism: a path, a grid of its ranges, or a way through.

    The parameters are those of `PositionAnalysis`.

    Raises
    ------
    SolveError
        If a range is empty, or the samples are not those of its inputs.
    """
    inputs = mechanism.inputs
    if path is not None:
        return given_path(path, len(inputs))
    for item in inputs:
        if item.start == item.stop:
            raise SolveError(
                f"{mechanism.name}: inputs.{item.pair}: the range from `from` to `to` is "
                f"empty, both are {item.start:.6g} rad; give another `to`, greater or less"
            )
    check_sample_counts(mechanism, samples)
    if isinstance(samples, Sequence):
        return grid(inputs, samples)
    if wants_grid:
        return grid(inputs, [samples] * len(inputs))
    columns = [_spaced(item.start, item.stop, samples) for item in inputs]
    return InputGrid(np.stack(columns, axis=1), (samples,))


def check_sample_counts(mechanism: Mechanism, samples: int | Sequence[int]) -> None:
    """Check that numbers of samples fit the inputs of a mechanism.

    Parameters
    ----------
    mechanism
        The mechanism with its inputs.
    samples
        Number of samples along a path, or along each input of a grid.

    Raises
    ------
    SolveError
        If a grid has another number of axes than there are inputs, or there are more than
        `MOST_SAMPLES` samples.
    """
    inputs = mechanism.inputs
    counts = samples if isinstance(samples, Sequence) else (samples,)
    text = "x".join(map(str, counts))
    if isinstance(samples, Sequence) and len(samples) != len(inputs):
        raise SolveError(
            f"{mechanism.name}: samples: {text} is of "
            f"{counted(len(samples), 'input')}, but it has "
            f"{counted(len(inputs), 'input')} ({listing(i.pair for i in inputs)}); "
            "give one number for each, as 361 or 41x21"
        )
    if math.prod(counts) > MOST_SAMPLES:
        raise SolveError(
            f"{mechanism.name}: samples: found {text}; at most {MOST_SAMPLES} samples are "
            "possible, and a run of a million is already fine"
        )


def grid(inputs: Sequence[Input], samples: Sequence[int]) -> InputGrid:
    """Return the grid with so many samples of each input, both ends of ranges included."""
    axes = [
        _spaced(item.start, item.stop, count)
        for item, count in zip(inputs, samples, strict=True)
    ]
    mesh = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    return InputGrid(mesh.reshape(-1, len(inputs)), tuple(samples))


def given_path(q: Floats, inputs: int) -> InputGrid:
    """Return a path of given samples q (n, inputs) rad; (n,) for a single input.

    Raises
    ------
    SolveError
        If the shape does not fit the number of inputs, or a value is not finite.
    """
    path = np.atleast_1d(np.asarray(q, dtype=float))
    if path.ndim == 1:
        path = path[:, None]
    if path.shape[1:] != (inputs,) or not len(path):
        raise SolveError(
            f"a path for {inputs} inputs is an array (samples, {inputs}), not {np.shape(q)}"
        )
    if not all_finite(path):
        raise SolveError(f"the path is not finite in row {np.argmin(all_finite(path, 1))}")
    return InputGrid(path, (len(path),))


def _spaced(low: float, high: float, count: int) -> Floats:
    if count < 1:
        raise SolveError(f"samples must be at least 1, not {count}")
    return np.linspace(low, high, count)
