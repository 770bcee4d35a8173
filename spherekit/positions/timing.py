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
    """Times, input rates and input accelerations, in rows as in the motion.

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
        """Return all rows `count` times, one block after another."""
        return self.rows(np.tile(np.arange(len(self.ddq)), count))


def evaluate_time_laws(
    inputs: Sequence[str], laws: Mapping[str, TimeLaw], t: Floats
) -> tuple[Floats, Timing]:
    """Return the inputs that follow time laws, and their rates.

    Parameters
    ----------
    inputs
        Names of the driven pairs.
    laws
        The law of each, by name.
    t
        (n,) times (s).

    Returns
    -------
    (n, inputs) values of the inputs (rad), and their timing.

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
    """Return the smallest and largest inputs, and the smallest and largest rates.

    Parameters
    ----------
    inputs
        (n, inputs) values of the inputs (rad).
    timing
        Their rates. Without it the extents of the rates are NaN.

    Returns
    -------
    Two arrays (2, inputs), in rad and rad/s. Index 0 of the first axis is the smallest
    value, index 1 the largest.
    """
    rates = nans(inputs.shape) if timing is None else timing.dq
    extents = []
    for quantity in (inputs, rates):
        # Column by column this takes a tenth of the time of np.min with an axis.
        smallest = [np.min(column) for column in quantity.T]
        largest = [np.max(column) for column in quantity.T]
        extents.append(np.array([smallest, largest]))
    return extents
