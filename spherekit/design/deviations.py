"""By how much sizes are off: one deviation for all, or one for each, and draws of them."""

from dataclasses import dataclass
from typing import Any, Literal, final

import numpy as np

from spherekit.errors import DesignError
from spherekit.sphere.rotation import Floats

Distribution = Literal["normal", "uniform"]

DISTRIBUTIONS: tuple[Distribution, ...] = ("normal", "uniform")


@final
@dataclass(frozen=True)
class Deviations:
    """Draws of sizes about those of the file.

    With a ``"normal"`` distribution `size` (rad) is the standard deviation, and the worst
    case three of it; with a ``"uniform"`` one sizes are off by at most `size`. It is one
    for all, or one for each, in the unit of that number.
    """

    size: float | tuple[float, ...]
    distribution: Distribution = "normal"
    count: int = 1024
    seed: int = 0

    def __post_init__(self) -> None:
        if self.distribution not in DISTRIBUTIONS:
            raise DesignError(
                f'distribution "{self.distribution}" is not known; it is normal or uniform'
            )
        sizes = np.atleast_1d(self.size)
        possible = np.all(np.isfinite(sizes) & (sizes >= 0.0)) and np.any(sizes > 0.0)
        if not possible or self.count < 0:
            raise DesignError(
                "a deviation is a positive number, of some sizes perhaps 0, and the number "
                "of draws not < 0"
            )

    def _times(self, factor: float) -> Any:
        made = np.array(self.size) * factor
        return made if made.ndim else float(made)

    @property
    def spread(self) -> Any:
        """The standard deviation (rad), one or (sizes,)."""
        return self._times(1.0 if self.distribution == "normal" else 1.0 / np.sqrt(3.0))

    @property
    def worst(self) -> Any:
        """The deviation (rad) of the worst case, one or (sizes,)."""
        return self._times(3.0 if self.distribution == "normal" else 1.0)

    def draws(self, sizes: int) -> Floats:
        """Return deviations (sizes, count), spread evenly by a Sobol sequence."""
        from scipy.special import ndtri
        from scipy.stats import qmc

        power = int(np.ceil(np.log2(max(self.count, 1))))
        unit = qmc.Sobol(sizes, rng=self.seed).random_base2(power).T[:, : self.count]
        size = np.reshape(self.size, (-1, 1))
        if self.distribution == "uniform":
            return np.asarray(size * (2.0 * unit - 1.0))
        return np.asarray(size * ndtri(np.clip(unit, 1e-12, 1.0 - 1e-12)))
