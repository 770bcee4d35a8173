"""Periodic functions as trigonometric interpolants, with the error that was measured."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spherekit.numeric.chebyshev import Floats

FEWEST_SAMPLES = 32
MOST_SAMPLES = 2**14
_BLOCK = 2**21


@final
@dataclass(frozen=True)
class Periodic:
    """m functions that grow by `rise` (m,) in every `period` and repeat otherwise.

    `coefficients` (samples // 2 + 1, m) are the complex amplitudes of the harmonics 0, 1,
    2, ... of what is left when the linear growth is taken away. `error` is the largest
    difference from the function measured midway between the samples, relative to the
    largest value.
    """

    period: float
    rise: Floats
    coefficients: NDArray[np.complex128]
    samples: int
    error: float

    @staticmethod
    def fit(
        function: Callable[[Floats], Floats],
        period: float,
        rise: Floats | None = None,
        tolerance: float = 1e-13,
        most: int = MOST_SAMPLES,
    ) -> "Periodic":
        """Return the interpolant of a function (n,) -> (n, m) at equally spaced samples.

        Their number is doubled until the error measured midway between them is below
        `tolerance`, or there are `most`: `error` says what was reached.
        """

        def sample(places: Floats) -> Floats:
            values = function(period * places)
            return values if rise is None else values - np.outer(places, rise)

        count = FEWEST_SAMPLES
        samples = sample(np.arange(count) / count)
        while True:
            middle = sample((np.arange(count) + 0.5) / count)
            series = np.fft.rfft(samples, axis=0) / count
            finer = np.concatenate([series, np.zeros((count // 2, samples.shape[1]))])
            finer[count // 2] *= 0.5
            guess = np.fft.irfft(finer * (2 * count), 2 * count, axis=0)[1::2]
            size = max(float(np.max(np.abs(samples))), float(np.max(np.abs(middle))))
            error = float(np.max(np.abs(guess - middle))) / (size or 1.0)
            if error <= tolerance or 2 * count > most:
                growth = np.zeros(samples.shape[1]) if rise is None else rise
                return Periodic(period, growth, series, count, error)
            samples = np.stack([samples, middle], axis=1).reshape(2 * count, -1)
            count *= 2

    def at(self, s: ArrayLike) -> Floats:
        """Return the functions (n, m) at s (n,)."""
        s = np.asarray(s, dtype=float)
        return self._sum(self._amplitudes, s) + np.outer(s / self.period, self.rise)

    def derivative(self, s: ArrayLike) -> Floats:
        """Return the derivatives (n, m) of the interpolant at s (n,)."""
        s = np.asarray(s, dtype=float)
        turned = self._amplitudes * (2j * np.pi / self.period * self._orders[:, None])
        turned[-1] = 0.0
        return self._sum(turned, s) + self.rise / self.period

    @cached_property
    def _orders(self) -> Floats:
        return np.arange(len(self.coefficients), dtype=float)

    @cached_property
    def _amplitudes(self) -> NDArray[np.complex128]:
        doubled = 2.0 * self.coefficients
        doubled[0] *= 0.5
        doubled[-1] *= 0.5
        return np.asarray(doubled)

    def _sum(self, amplitudes: NDArray[np.complex128], s: Floats) -> Floats:
        turns = 2.0 * np.pi * np.mod(s / self.period, 1.0)
        block = max(1, _BLOCK // len(amplitudes))
        parts = [np.zeros((0, amplitudes.shape[1]))]
        for start in range(0, len(s), block):
            phase = np.outer(turns[start : start + block], self._orders)
            parts.append(np.cos(phase) @ amplitudes.real - np.sin(phase) @ amplitudes.imag)
        return np.concatenate(parts)
