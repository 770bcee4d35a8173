"""What proofs are about: links and R pairs, sliding contacts of circles as links.

Two circles that touch have their centres a fixed arc apart, the sum of their radii, or the
difference where one lies within the other; and where the centres are this arc apart the
circles touch in one point of the great circle through both. So a sliding contact is a
link, its coupler, hinged to the two others at the centres, and its arc is a size like
others. A rolling contact also says how far both wheels turn (`gears`).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import final

from spherekit.conventions import listing
from spherekit.errors import PlanError
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import Profile
from spherekit.planning.inputs import driven_pairs


@final
@dataclass(frozen=True)
class Coupler:
    """The link that stands for a sliding contact, and its pairs with the two links of it.

    `contact` is the number of the contact among the pairs of the mechanism.
    """

    contact: int
    link: int
    pairs: tuple[int, int]


@final
@dataclass(frozen=True)
class Structure:
    """Links and R pairs: those of a mechanism in their order, and then those of couplers.

    `inputs` are the driven pairs; the angles of `followers` are fixed by the inputs through
    wheels. `wheels` are the numbers of rolling contacts among the pairs of the mechanism.
    """

    name: str
    links: tuple[str, ...]
    pairs: tuple[str, ...]
    ends: tuple[tuple[int, int], ...]
    inputs: tuple[int, ...]
    couplers: tuple[Coupler, ...] = ()
    wheels: tuple[int, ...] = ()
    followers: tuple[int, ...] = ()

    @property
    def bodies(self) -> int:
        """The number of links that are no couplers."""
        return len(self.links) - len(self.couplers)

    @cached_property
    def pair_number(self) -> Mapping[str, int]:
        """Position of each pair in `pairs`, by name."""
        return {name: number for number, name in enumerate(self.pairs)}


def structure_of(mechanism: Mechanism) -> Structure:
    """Return the structure of a mechanism, the wheels of rolling contacts not yet in mesh.

    Raises
    ------
    PlanError
        If a contact is none of two circles.
    """
    links, pairs, ends = list(mechanism.links), [], []
    for pair, two in zip(mechanism.pairs, mechanism.ends, strict=True):
        if pair.kind.has_axis:
            pairs.append(pair.name)
            ends.append(two)
    couplers, rolling = [], []
    for number, (pair, two) in enumerate(zip(mechanism.pairs, mechanism.ends, strict=True)):
        if pair.kind.has_axis:
            continue
        profiles = zip(pair.links, pair.profiles or (), strict=True)
        shaped = [link for link, profile in profiles if not is_circle(profile)]
        if shaped:
            raise PlanError(
                f"{mechanism.name}: pair {pair.name} is a contact whose profile on "
                f"{listing(shaped)} is no circle; proofs are for R and P pairs and for "
                "contacts of circles"
            )
        if pair.kind.freedoms == 1:
            rolling.append(number)
            continue
        links.append(_new(pair.name, links))
        halves = []
        for link, end in zip(pair.links, two, strict=True):
            halves.append(len(pairs))
            pairs.append(_new(f"{pair.name}_{link}", pairs))
            ends.append((end, len(links) - 1))
        couplers.append(Coupler(number, len(links) - 1, (halves[0], halves[1])))
    names = [mechanism.pairs[number].name for number in driven_pairs(mechanism)]
    return Structure(
        mechanism.name,
        tuple(links),
        tuple(pairs),
        tuple(ends),
        tuple(pairs.index(name) for name in names),
        tuple(couplers),
        tuple(rolling),
    )


def is_circle(profile: Profile) -> bool:
    """Return whether a profile is a circle, great or not, about its centre."""
    return not (profile.points or profile.cosines or profile.sines)


def _new(name: str, taken: list[str]) -> str:
    """Return a name that is not taken, by underscores at its end."""
    while name in taken:
        name += "_"
    return name
