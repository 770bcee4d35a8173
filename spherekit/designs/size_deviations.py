"""Random deviations of sizes from the sizes in a mechanism file."""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from spherekit.arrays import Floats
from spherekit.errors import DesignError
from spherekit.wording import choices, listing

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
        If the distribution is unknown, a deviation is negative or not finite, all are zero,
        or `count` is negative.
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
                f'distribution: found "{self.distribution}"'
                f"{choices(self.distribution, DISTRIBUTIONS, 'Allowed')}"
            )
        # `size` says how large the deviations are: one number, or one for each size.
        deviations = np.atleast_1d(self.size)
        is_valid = np.isfinite(deviations) & (deviations >= 0.0)
        if not np.all(is_valid):
            invalid = dict.fromkeys(f"{x:.6g}" for x in deviations[~is_valid])
            raise DesignError(
                f"deviations: found {listing(invalid)} (in rad, or in the SI unit of the "
                "size); a deviation has to be 0 or a finite positive number"
            )
        if not np.any(deviations > 0.0):
            raise DesignError("deviations: all are 0; at least one has to be above 0")
        if self.count < 0:
            raise DesignError(f"draws: found {self.count}, expected 0 or more")

    @property
    def spread(self) -> Any:
        """The standard deviation, one number (rad) or (sizes,) in rad and SI units."""
        # The standard deviation of a uniform distribution from -a to a is a / sqrt(3).
        return np.multiply(self.size, 1.0 if self.distribution == "normal" else 3.0**-0.5)

    @property
    def worst(self) -> Any:
        """The deviation of each size in the worst case, one number or (sizes,).

        The worst case is three standard deviations of a normal distribution, or the largest
        deviation of a uniform one.
        """
        return np.multiply(self.size, 3.0 if self.distribution == "normal" else 1.0)

    def draws(self, size_count: int) -> Floats:
        """Return random deviations of the sizes of a mechanism, for a tolerance analysis.

        Sizes are dimensions such as arcs and angles. A draw is one set of deviations of all
        sizes. The draws are spread evenly by a Sobol sequence.

        Parameters
        ----------
        size_count
            Number of sizes that deviate.

        Returns
        -------
        (sizes, draws) deviations, with as many draws as the attribute `count` says.
        """
        from scipy.special import ndtri
        from scipy.stats import qmc

        # A Sobol sequence is most even if its length is a power of 2. So the sequence is
        # computed for the next power of 2, and then cut to the number of draws.
        power = (self.count - 1).bit_length()
        sequence = qmc.Sobol(size_count, rng=self.seed).random_base2(power)
        unit_points = sequence.T[:, : self.count]  # (sizes, draws), each from 0 to 1
        # The largest deviation of a uniform distribution, or the standard deviation of a
        # normal one: (1, 1) if all sizes have the same one, otherwise (sizes, 1).
        deviation_scales = np.reshape(self.size, (-1, 1))
        if self.distribution == "uniform":
            return deviation_scales * (2.0 * unit_points - 1.0)
        # The inverse of the normal distribution turns probabilities into deviations. The
        # inverse is infinite at 0 and 1.
        probabilities = np.clip(unit_points, MIN_PROBABILITY, 1.0 - MIN_PROBABILITY)
        return deviation_scales * ndtri(probabilities)
