"""What range of values a panel shows, so that noise is no signal and a pole hides none."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

LONELY = 12.0
"""Values so many times farther apart than nine tenths of them leave the frame."""
BEYOND = 1.0
"""How far beyond these the frame then reaches, over their range."""
AROUND = 0.05
"""Half the range about what does not change, over its scale."""
MARGIN = 0.05
DIMENSIONAL = ("kg", "N", "W", "J", "m")
"""Parts of units of quantities that may be as small as a mechanism is."""


def scale_of(values: Floats, unit: str) -> float:
    """Return the scale of a quantity: the largest number, at least one of angles and rates.

    Their size says whether they are noise, that of a torque or an inertia does not.
    """
    known = np.abs(values[np.isfinite(values)])
    largest = float(np.max(known, initial=0.0))
    return largest if any(part in unit for part in DIMENSIONAL) else max(largest, 1.0)


def shown_range(
    values: Floats, scale: float, resolution: float = 1e-9, lonely: float = LONELY
) -> tuple[float, float]:
    """Return the least and greatest value that a panel of values (n,) shows.

    Changes below the `resolution`, over the scale of the quantity, are rounding.
    """
    known = values[np.isfinite(values)]
    if not len(known):
        return 0.0, 1.0
    low, high = float(np.min(known)), float(np.max(known))
    if high - low <= resolution * scale:
        middle = 0.5 * (low + high)
        half = AROUND * max(abs(middle), scale) or 1.0
        return middle - half, middle + half
    inner, outer = np.quantile(known, [0.05, 0.95]).tolist()
    if outer > inner and high - low > lonely * (outer - inner):
        reach = BEYOND * (outer - inner)
        low, high = max(low, inner - reach), min(high, outer + reach)
    margin = MARGIN * (high - low)
    return low - margin, high + margin


def broken(line: Floats, frame: tuple[float, float], turn: float | None) -> Floats:
    """Return points (n, 2) with a gap (NaN) where the curve is not what a stroke says.

    There it passes from one side of the frame to the other through infinity, or y or x
    jump by half a `turn` or more.
    """
    y = line[:, 1]
    before, after = y[:-1], y[1:]
    low, high = frame
    gap = ((before < low) & (after > high)) | ((before > high) & (after < low))
    if turn is not None:
        gap |= np.abs(after - before) >= 0.5 * turn
    (places,) = np.nonzero(gap)
    return np.insert(line, places + 1, np.nan, axis=0)
