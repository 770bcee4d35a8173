"""What would determine the forces through the centre that a file leaves open."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from spherekit.conventions import listing
from spherekit.dynamics.transmitted import DEPENDENT, DETERMINED, Balance, without_centre
from spherekit.model.joints import Joint
from spherekit.model.mechanism import Mechanism
from spherekit.sphere.rotation import Floats


@final
@dataclass(frozen=True)
class Lacking:
    """What a file would have to say more.

    `centres` are links with inertia without a centre of mass, `distances` contacts of which
    it is not known how far from O their force acts, `floating` pairs that would have to let
    their links slide along the axis as well; where all that is not `enough`, constraints
    that repeat each other leave more open.
    """

    centres: tuple[str, ...] = ()
    distances: tuple[str, ...] = ()
    floating: tuple[str, ...] = ()
    enough: bool = True

    @property
    def wanted(self) -> list[str]:
        """What that is, in words."""
        wanted = []
        if self.centres:
            wanted.append(f"mass and centre of the links {listing(self.centres)}")
        if self.distances:
            contacts = listing(self.distances)
            wanted.append(f"the distance of the contacts {contacts} from the centre")
        if self.floating:
            pairs = listing(self.floating)
            wanted.append(
                f"that the pairs {pairs}, or others in their loops, float (bearings, axial)"
            )
        if not self.enough:
            wanted.append("constraints that do not repeat each other")
        return wanted

    def __bool__(self) -> bool:
        return bool(self.wanted)


def lacking(mechanism: Mechanism, joints: Sequence[Joint], frames: Floats) -> Lacking:
    """Return what would determine all forces at one row, `frames` (pairs, 3, 3) its pairs.

    The reactions that balance each other without loads are a linear space. Each pair that
    floats takes one direction from it, if the force along its axis takes part in what is
    left; the pair in which it does most is taken first.
    """
    contacts = [pair.name for pair in mechanism.pairs if not pair.kind.has_axis]
    distances = [name for name in contacts if mechanism.pair(name).distance is None]
    told = replace(
        mechanism,
        masses=tuple(
            replace(mass, mass=1.0, centre=(0.0, 0.0, 0.0)) for mass in mechanism.masses
        ),
        pairs=tuple(
            replace(pair, distance=1.0) if pair.name in distances else pair
            for pair in mechanism.pairs
        ),
    )
    balance = Balance(told, joints, frames[None], forces=True)
    _, sizes, back = np.linalg.svd(balance.matrix[0])
    rank = int(np.count_nonzero(sizes > DEPENDENT * sizes[0]))
    free = back[rank:].T
    along = [k for k, (_, component) in enumerate(balance.columns) if component == 5]
    floating = []
    while along:
        parts = np.linalg.norm(free[along], axis=1)
        if np.max(parts) < np.sqrt(DETERMINED):
            break
        column = along[int(np.argmax(parts))]
        floating.append(balance.columns[column][0])
        _, _, turn = np.linalg.svd(free[[column]])
        free = free @ turn[1:].T
    forces = [k for k, (_, component) in enumerate(balance.columns) if component > 2]
    names = tuple(mechanism.pairs[pair].name for pair in sorted(floating))
    enough = not np.any(free[forces] ** 2 > DETERMINED)
    return Lacking(tuple(without_centre(mechanism)), tuple(distances), names, enough)
