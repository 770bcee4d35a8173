"""Inertia tensors of a mechanism as arrays, by the index of the link."""

import numpy as np

from spherekit.arrays import Floats
from spherekit.mechanism.mechanism import Mechanism


def link_inertia_tensors(mechanism: Mechanism) -> dict[int, Floats]:
    """Return the inertia tensor (3, 3) of every link that has one, by link index.

    The tensors (kg m2) are about the centre of the sphere, in link axes.
    """
    return {
        mechanism.link_number[mass.link]: np.array(mass.tensor) for mass in mechanism.masses
    }
