"""Random deviations of sizes from the sizes in a mechanism file."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from spherekit.arrays import Floats
from spherekit.errors import DesignError
from spherekit.wording import counted, listing

Distribution = Literal["normal", "uniform"]

DISTRIBUTIONS: tuple[Distribution, ...] = ("normal", "uniform")
"""The distributions of deviations."""

MIN_PROBABILITY = 1e-12
"""Smallest probability, and distance from 1, of a normally distributed deviation.

The deviation of probability 0 would be infinite. This probability limits deviations to 7
standard deviations.
"""


@dataclass(frozen=True)
class SizeDeviations:
    """Random deviations of sizes, for a tolerance analysis.

    Attributes
    ----------
    size
        Standard deviation of a normal distribution, or largest deviation of a uniform one.
        It is one number (rad) for all sizes, or one number for each size, in rad or SI
        units.
    distribution
        ``"normal"`` or ``"uniform"``.
    count
        Number of draws (mechanisms with random sizes).
    seed
        Seed of the random numbers.

    Raises
    ------
    DesignError
        If the distribution is unknown, a deviation is negative or not finite, or all are
        zero.
    """

    size: float | tuple[float, ...]
    distribution: Distribution = "normal"
    count: int = 1024
    seed: int = 0

    def __post_init__(self) -> None:
        """Raise `DesignError` if the distribution, a deviation or `count` is invalid.

        The object describes random deviations of sizes for a tolerance analysis. `count` is
        the number of draws (mechanisms with random sizes).
        """
        if self.distribution not in DISTRIBUTIONS:
            raise DesignError(
                f'distribution "{self.distribution}" is not known; it is normal or uniform'
            )
        # `size` says how large the deviations are: one number, or one for each size.
        deviations = np.atleast_1d(self.size)
        is_valid = np.all(np.isfinite(deviations) & (deviations >= 0.0))
        has_deviation = np.any(deviations > 0.0)
        if not is_valid or not has_deviation or self.count < 0:
            numbers = listing(f"{deviation:.6g}" for deviation in deviations)
            raise DesignError(
                f"deviations: found {numbers} (rad or SI units) "
                f"and {counted(self.count, 'draw')}; each deviation must be a finite "
                "positive number or 0, at least one must be above 0, and the number of "
                "draws must be at least 0"
            )

    @property
    def spread(self) -> Any:
        """The standard deviation, one number (rad) or (sizes,) in rad and SI units."""
        # The standard deviation of a uniform distribution from -a to a is a / sqrt(3).
        return np.multiply(self.size, 1.0 if self.distribution == "normal" else 3.0**-0.5)

    @property
    def worst(self) -> Any:
        """The deviation of each size in the worst case, one number or (sizes,).

        It is three standard deviations of a normal distribution, or the largest deviation
        of a uniform one.
        """
        return np.multiply(self.size, 3.0 if self.distribution == "normal" else 1.0)

    def draws(self, sizes: int) -> Floats:
        """Return random deviations of the sizes, spread evenly by a Sobol sequence.

        A draw is one set of deviations of all sizes, for a tolerance analysis.

        Parameters
        ----------
        sizes
            Number of sizes that deviate.

        Returns
        -------
        (sizes, count) deviations. The attribute `size` is the largest deviation of a
        uniform distribution, or the standard deviation of a normal one.
        """
        from scipy.special import ndtri
        from scipy.stats import qmc

        # (sizes, count) points of the unit cube. A Sobol sequence is most even if its
        # length is a power of 2. So a sequence as long as the next power of 2 is computed
        # and cut.
        power = (self.count - 1).bit_length()
        unit_points = qmc.Sobol(sizes, rng=self.seed).random_base2(power).T[:, : self.count]
        # (1, 1) if all sizes have the same deviation, otherwise (sizes, 1).
        deviation_scales = np.reshape(self.size, (-1, 1))
        if self.distribution == "uniform":
            return deviation_scales * (2.0 * unit_points - 1.0)
        # The inverse of the normal distribution turns probabilities into deviations. It is
        # infinite at 0 and 1.
        probabilities = np.clip(unit_points, MIN_PROBABILITY, 1.0 - MIN_PROBABILITY)
        return deviation_scales * ndtri(probabilities)
