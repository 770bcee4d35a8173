"""How near a configuration is to a singularity: angles.

An angle is that by which planes or axes miss the geometric condition which misses least.
It is zero at a singularity and keeps its meaning whatever the rates are.
"""

from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.singular.conditions import residuals
from spherekit.singular.relation import FourLinks, LinkCount, Relation, SixPoles
from spherekit.sphere.rotation import Floats, cross


@final
@dataclass(frozen=True)
class SingularityAngles:
    """Angles (n,) in rad between what would coincide at a singularity.

    Attributes
    ----------
    type_i, type_ii
        The least angle of the conditions of type I and of type II.
    transmission
        Between the planes of the axes (or, os, rs) and (io, os, is), in [0, pi/2]: in a
        four-bar the transmission angle, between coupler and follower. NaN with less than
        four links.
    """

    type_i: Floats
    type_ii: Floats
    transmission: Floats


def nearness(relation: Relation, links: FourLinks, poles: SixPoles) -> SingularityAngles:
    """Return the angles by which n configurations miss the singularities of a relation."""
    n = len(relation.c)

    def angle(kind: str) -> Floats:
        sines = residuals(relation, links, poles, kind)
        least = np.min(np.stack(list(sines.values())), axis=0) if sines else np.ones(n)
        return np.asarray(np.arcsin(np.minimum(least, 1.0)))

    first, second = angle("I"), angle("II")
    if relation.kind is not LinkCount.FOUR_LINKS:
        return SingularityAngles(first, second, np.full(n, np.nan))
    with np.errstate(invalid="ignore"):
        one = _normal(cross(poles.os, poles.or_), cross(poles.os, poles.rs))
        other = _normal(cross(poles.os, poles.io), cross(poles.os, poles.is_))
        sine = np.linalg.norm(cross(one, other), axis=1)
        cosine = np.abs(np.sum(one * other, axis=1))
    return SingularityAngles(first, second, np.arctan2(sine, cosine))


def _normal(one: Floats, other: Floats) -> Floats:
    """Return unit normals (n, 3): along the longer of two parallel vectors."""
    sizes = np.linalg.norm(one, axis=1), np.linalg.norm(other, axis=1)
    longer = np.where((sizes[0] >= sizes[1])[:, None], one, other)
    return np.asarray(longer / np.maximum(*sizes)[:, None])
