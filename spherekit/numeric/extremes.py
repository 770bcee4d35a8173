"""Where functions given as Chebyshev series on cells are largest."""

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.polynomial import chebyshev

from spherekit.numeric.chebyshev import Floats, PiecewiseChebyshev


@final
@dataclass(frozen=True)
class Extremes:
    """Places (m,) and values (m,) of m functions where their sizes are largest."""

    places: Floats
    values: Floats


def largest(fitted: PiecewiseChebyshev) -> Extremes:
    """Return where the absolute value of each function is largest on the whole range.

    All zeros of the derivative of each cell's series are taken, as eigenvalues of its
    companion matrix, and both ends of the cell.
    """
    cells, _, count = fitted.coefficients.shape
    low, width = fitted.edges[:-1], np.diff(fitted.edges)
    places, values = np.zeros(count), np.zeros(count)
    for function in range(count):
        for cell in range(cells):
            series = fitted.coefficients[cell, :, function]
            x = np.concatenate([[-1.0, 1.0], _turning(series)])
            y = chebyshev.chebval(x, series)
            top = int(np.argmax(np.abs(y)))
            if np.abs(y[top]) > np.abs(values[function]):
                values[function] = y[top]
                places[function] = low[cell] + 0.5 * width[cell] * (1.0 + x[top])
    return Extremes(places, values)


def _turning(series: Floats) -> Floats:
    """Return the places in [-1, 1] at which the derivative of a series is zero."""
    slope = chebyshev.chebder(series)
    kept = np.flatnonzero(np.abs(slope) > 1e-15 * np.max(np.abs(slope), initial=0.0))
    if not len(kept) or kept[-1] == 0:
        return np.zeros(0)
    roots = chebyshev.chebroots(slope[: kept[-1] + 1])
    real = roots.real[np.abs(roots.imag) < 1e-6]
    return np.asarray(real[np.abs(real) <= 1.0])
