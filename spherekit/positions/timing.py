"""The times of the rows of a motion, and the rates of its inputs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Floats
from spherekit.files.time_law import TimeLaw
from spherekit.geometry.vectors import nans
from spherekit.numerics.array_rows import ArrayRows


@dataclass(frozen=True)
class Timing(ArrayRows):
    """Times, input rates and input accelerations of the n rows of a motion.

    A row is one configuration. A motion with several assembly modes (ways to assemble the
    mechanism) has all rows of the first mode, then all rows of the next mode, and so on.

    Attributes
    ----------
    t
        (n,) times (s).
    dq, ddq
        (n, inputs) rates (rad/s) and accelerations (rad/s^2) of the inputs.
    """

    t: Floats
    dq: Floats
    ddq: Floats

    def repeated(self, count: int) -> "Timing":
        """Return all rows `count` times, one block after another: one for each mode."""
        return self.rows(np.tile(np.arange(len(self.ddq)), count))


def evaluate_time_laws(
    inputs: Sequence[str], laws: Mapping[str, TimeLaw], t: Floats
) -> tuple[Floats, Timing]:
    """Return the values, rates and accelerations of inputs that follow laws of time.

    Parameters
    ----------
    inputs
        Names of the driven pairs.
    laws
        The law of each input, by its name.
    t
        (n,) times (s).

    Returns
    -------
    (n, inputs) values of the inputs (rad), and their timing: times, rates, accelerations.

    Raises
    ------
    ModelError
        If a law is a table that does not contain all times.
    """
    values_by_input = [laws[name].at(t) for name in inputs]
    q = np.stack([values for values, _, _ in values_by_input], axis=1)
    dq = np.stack([rates for _, rates, _ in values_by_input], axis=1)
    ddq = np.stack([accelerations for _, _, accelerations in values_by_input], axis=1)
    return q, Timing(t, dq, ddq)


def input_extents(inputs: Floats, timing: Timing | None = None) -> list[Floats]:
    """Return the smallest and largest values of the inputs, and those of their rates.

    Parameters
    ----------
    inputs
        (n, inputs) values of the inputs (rad).
    timing
        The rates. If None, the result for the rates is NaN.

    Returns
    -------
    Two arrays (2, inputs): values (rad) and rates (rad/s). Row 0 has the smallest, row 1
    the largest.
    """
    rates = nans(inputs.shape) if timing is None else timing.dq
    extents = []
    for quantity in (inputs, rates):
        # Separate columns take a tenth of the time of np.min along an axis.
        smallest = [np.min(column) for column in quantity.T]
        largest = [np.max(column) for column in quantity.T]
        extents.append(np.array([smallest, largest]))
    return extents
