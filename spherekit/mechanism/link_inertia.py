"""Inertia tensors of the links of a mechanism."""

import numpy as np

from spherekit.arrays import Floats
from spherekit.mechanism.mechanism import Mechanism


def tensors(mechanism: Mechanism) -> dict[int, Floats]:
    """Return the tensors (3, 3) of links with mass about O, in link axes (kg m2)."""
    return {
        mechanism.link_number[mass.link]: np.array(mass.tensor) for mass in mechanism.masses
    }
