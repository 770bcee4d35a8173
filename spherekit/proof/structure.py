"""Links and R pairs that proofs are about; sliding contacts of circles count as links.

Two circles that touch have their centres a fixed arc apart, the sum of their radii, or the
difference where one lies within the other; and where the centres are this arc apart the
circles touch in one point of the great circle through both. So a sliding contact is a
link, its coupler, hinged to the two others at the centres, and its arc is a size like
others. A rolling contact also says how far both wheels turn (`gears`).
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from spherekit.errors import PlanError
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import driven_pairs
from spherekit.wording import listing


@dataclass(frozen=True)
class Structure:
    """Links and R pairs: those of a mechanism in their order, and then those of couplers.

    `inputs` are the driven pairs; the angles of `followers` are fixed by the inputs through
    wheels. `wheels` are the numbers of rolling contacts among the pairs of the mechanism,
    and `couplers` those of sliding ones, in order: each has the last links in this order,
    and the last two pairs, with the two links of the contact.
    """

    name: str
    links: Sequence[str]
    pairs: Sequence[str]
    ends: tuple[tuple[int, int], ...]
    inputs: tuple[int, ...]
    couplers: Sequence[int]
    wheels: Sequence[int]
    followers: tuple[int, ...] = ()

    @property
    def bodies(self) -> int:
        """The number of links that are no couplers."""
        return len(self.links) - len(self.couplers)

    def names_of(self, pairs: Iterable[int]) -> list[str]:
        """Return the names of pairs by their numbers."""
        return [self.pairs[pair] for pair in pairs]

    def coupler(self, number: int) -> tuple[int, tuple[int, int]]:
        """Return the link of a coupler and its pairs with both links of the contact."""
        pair = len(self.pairs) - 2 * (len(self.couplers) - number)
        return self.bodies + number, (pair, pair + 1)


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
        shaped = [
            link
            for link, profile in zip(pair.links, pair.profiles or (), strict=True)
            if profile.round_axis is None
        ]
        if shaped:
            raise PlanError(
                f"{mechanism.name}: pair {pair.name} is a contact whose profile on "
                f"{listing(shaped)} is no circle; proofs are for R and P pairs and for "
                "contacts of circles"
            )
        if pair.kind.variable_count == 1:
            rolling.append(number)
            continue
        couplers.append(number)
        links.append(_new(pair.name, links))
        for link, end in zip(pair.links, two, strict=True):
            pairs.append(_new(f"{pair.name}_{link}", pairs))
            ends.append((end, len(links) - 1))
    driven = map(pairs.index, mechanism.names_of(driven_pairs(mechanism)))
    return Structure(
        mechanism.name, links, pairs, tuple(ends), tuple(driven), couplers, rolling
    )


def _new(name: str, taken: list[str]) -> str:
    """Return a name that is not taken, by underscores at its end."""
    while name in taken:
        name += "_"
    return name
