"""How near a configuration is to a singularity: angles.

An angle is that by which planes or axes miss the geometric condition which misses least.
It is zero at a singularity and keeps its meaning whatever the rates are.
"""

from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.singular.conditions import residuals
from spherekit.singular.relation import FourLinks, Relation, SixPoles
from spherekit.sphere.rotation import Floats


@final
@dataclass(frozen=True)
class SingularityAngles:
    """Angles (n,) in rad between what would coincide at a singularity.

    Attributes
    ----------
    type_i, type_ii
        The least angle of the conditions of type I and of type II.
    """

    type_i: Floats
    type_ii: Floats


def nearness(relation: Relation, links: FourLinks, poles: SixPoles) -> SingularityAngles:
    """Return the angles by which n configurations miss the singularities of a relation."""
    n = len(relation.c)

    def angle(kind: str) -> Floats:
        sines = residuals(relation, links, poles, kind)
        least = np.min(np.stack(list(sines.values())), axis=0) if sines else np.ones(n)
        return np.asarray(np.arcsin(np.minimum(least, 1.0)))

    return SingularityAngles(angle("I"), angle("II"))
