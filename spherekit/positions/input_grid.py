"""Samples of the inputs of a mechanism: a path, or a grid over the ranges of the inputs."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Floats, Indices
from spherekit.errors import SolveError
from spherekit.geometry.vectors import all_finite
from spherekit.mechanism.elements import Input
from spherekit.mechanism.mechanism import Mechanism
from spherekit.wording import counted, numbered

MAX_SAMPLES = 2**40
"""Largest number of samples. Each input then takes 8 TiB of memory."""


@dataclass(frozen=True)
class InputGrid:
    """Samples of the inputs (choices of their values), on a path or on a grid.

    Attributes
    ----------
    q
        (n, inputs) values of the inputs (rad) at each sample.
    shape
        Number of samples along each axis. A path has one axis. A grid has one axis for each
        input. The last input changes fastest from sample to sample.
    """

    q: Floats
    shape: tuple[int, ...]

    def __len__(self) -> int:
        return len(self.q)

    @property
    def is_path(self) -> bool:
        """Whether the samples are a path, so that successive samples are neighbours."""
        return len(self.shape) == 1

    @property
    def range(self) -> tuple[float, float]:
        """The least and the greatest sampled value (rad), for a mechanism of one input."""
        return float(np.min(self.q)), float(np.max(self.q))

    def neighbours(self) -> Indices:
        """Return the neighbouring samples of each sample along each axis of the grid.

        Callers follow or compare configurations from each sample to its neighbours.

        Returns
        -------
        (2 axes, n) indices of samples. Row 2 a is the next sample along axis a, and row 2 a
        + 1 the previous one. At a border of the grid the index is -1.
        """
        # Indices of the samples in the shape of the grid, with a border of -1. Shifted by
        # one along an axis, this array has the neighbour of each sample. The border is then
        # removed.
        padded = np.pad(np.arange(len(self)).reshape(self.shape), 1, constant_values=-1)
        interior = (slice(1, -1),) * len(self.shape)
        rows = []
        for axis in range(len(self.shape)):
            for shift in (-1, 1):
                rows.append(np.roll(padded, shift, axis)[interior].ravel())
        return np.stack(rows)

    def nearest(self, q: Floats, count: int) -> Indices:
        """Return the indices of the `count` samples nearest to inputs q (inputs,) in rad.

        The nearest one comes first.
        """
        return np.argsort(np.linalg.norm(self.q - q, axis=1), kind="stable")[:count]


def spread_rows(count: int, max_rows: int) -> Indices:
    """Return at most `max_rows` row numbers below `count`, spread evenly, both ends too."""
    return np.unique(np.linspace(0, count - 1, min(max_rows, count)).astype(np.intp))


def make_input_grid(
    mechanism: Mechanism,
    samples: int | Sequence[int],
    wants_grid: bool,
    path: Floats | None,
) -> InputGrid:
    """Return the samples of the inputs at which a mechanism is computed.

    Parameters
    ----------
    mechanism
        The mechanism with the ranges of its inputs.
    samples
        A single number is the number of samples on the straight path through all ranges.
        With `wants_grid` it is the number of values of each input. A sequence always
        requests a grid, and has the number of values of each input.
    wants_grid
        Whether to sample all combinations of the inputs.
    path
        (n, inputs) samples (rad) that the user states. If given, only these samples are
        returned.

    Raises
    ------
    SolveError
        If a range is empty, or samples or path do not fit the number of inputs.
    """
    inputs = mechanism.inputs
    if path is not None:
        return make_path(path, len(inputs))
    for item in inputs:
        if item.start == item.stop:
            raise SolveError(
                f"{mechanism.name}: inputs.{item.pair}: the range from `from` to `to` is "
                f"empty, both are {item.start:.6g} rad; give a greater or smaller `to`"
            )
    # Arrays and numbers of NumPy become lists and numbers of Python.
    samples = np.asarray(samples).tolist()
    if wants_grid and not isinstance(samples, Sequence):
        samples = [samples] * len(inputs)
    check_sample_counts(mechanism, samples)
    if isinstance(samples, Sequence):
        return make_grid(inputs, samples)
    # All inputs move together from the start to the stop of their ranges.
    columns = [_space_evenly(item.start, item.stop, samples) for item in inputs]
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
        If a grid has another number of axes than there are inputs, if a number is less than
        1, or if there are more than `MAX_SAMPLES` samples.
    """
    inputs = mechanism.inputs
    counts = samples if isinstance(samples, Sequence) else (samples,)
    text = "x".join(map(str, counts))
    if isinstance(samples, Sequence) and len(samples) != len(inputs):
        raise SolveError(
            f"{mechanism.name}: samples: {text} is for {counted(len(samples), 'input')}, "
            f"but the mechanism has {counted(len(inputs), 'input')} "
            f"({numbered('pair', mechanism.input_pairs)}); give one number for each input, "
            "such as 361 or 41x21"
        )
    if min(counts, default=1) < 1:
        raise SolveError(f"samples must be at least 1, not {min(counts)}")
    if math.prod(counts) > MAX_SAMPLES:
        raise SolveError(
            f"{mechanism.name}: samples: found {text}; at most {MAX_SAMPLES} samples are "
            "possible"
        )


def make_grid(inputs: Sequence[Input], samples: Sequence[int]) -> InputGrid:
    """Return the grid of all combinations of evenly spaced values of the inputs.

    The values include both ends of the range of each input; a single value is the start.
    `samples` has the number of values of each input. The last input varies fastest.
    """
    axes = [
        _space_evenly(item.start, item.stop, count)
        for item, count in zip(inputs, samples, strict=True)
    ]
    mesh = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    return InputGrid(mesh.reshape(-1, len(inputs)), tuple(samples))


def make_path(q: Floats, input_count: int) -> InputGrid:
    """Return the samples of the inputs that the user states, as a path.

    Parameters
    ----------
    q
        (n, inputs) values of the inputs (rad); (n,) for a single input.
    input_count
        Number of inputs.

    Raises
    ------
    SolveError
        If the shape does not fit the number of inputs, or a value is not finite.
    """
    # A copy, so that later changes of the caller's array do not change the samples.
    path = np.atleast_1d(np.array(q, dtype=float))
    if path.ndim == 1:
        path = path[:, None]
    if path.shape[1:] != (input_count,) or not len(path):
        raise SolveError(
            f"the path has the shape {np.shape(q)}, expected (number of samples, "
            f"{input_count}): one column for each input"
        )
    if not all_finite(path):
        raise SolveError(
            "the path has a number that is not finite in row "
            f"{np.argmin(all_finite(path, 1))}; give finite inputs in rad"
        )
    return InputGrid(path, (len(path),))


def _space_evenly(low: float, high: float, count: int) -> Floats:
    """Return `count` evenly spaced numbers from low to high, both included; one: low."""
    return np.linspace(low, high, count)
