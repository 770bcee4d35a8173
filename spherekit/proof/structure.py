"""The links and R pairs of a mechanism that proofs compute with.

Two circles that touch have their centres at a fixed arc: the sum of their radii, or the
difference if one lies inside the other. Conversely, if the centres are at this arc, the
circles touch in one point of the great circle through both centres. A sliding contact of
circles is therefore equivalent to a binary link, its coupler, which is joined to both
links of the contact by R pairs at the centres. A rolling contact also relates the rotation
of both wheels (`spherekit.proof.decimal_mechanism`).
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from spherekit.errors import PlanError
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import driven_pairs


@dataclass(frozen=True)
class Structure:
    """Links of a mechanism and the revolute pairs that join them, as proofs use them.

    The sizes of the links are not included.

    A sliding contact of two circles is replaced by a link, the coupler. Revolute pairs at
    both centres join the coupler to the links of the contact. Links and pairs are numbered
    from 0 in the order of `links` and `pairs`.

    Attributes
    ----------
    name
        Name of the mechanism.
    links
        Names of the links in the order of the mechanism, then the names of the couplers.
    pairs
        Names of the revolute pairs in the order of the mechanism, then two for each
        coupler.
    ends
        For each pair the indices of the two links that it joins.
    inputs
        Indices of the driven pairs.
    couplers
        For each coupler the index of the sliding contact that it replaces. The index counts
        all pairs of the mechanism, and so is not an index in `pairs`.
    wheels
        Indices of the rolling contacts (of two wheels), which also count all pairs of the
        mechanism.
    followers
        Indices of the pairs that the inputs drive through wheels.
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
    def body_count(self) -> int:
        """Number of links that are not couplers."""
        return len(self.links) - len(self.couplers)

    def names_of(self, pairs: Iterable[int]) -> list[str]:
        """Return the names of pairs."""
        return [self.pairs[pair] for pair in pairs]

    def coupler_parts(self, coupler: int) -> tuple[int, tuple[int, int]]:
        """Return the index of the link of a coupler, and the indices of its two pairs.

        A coupler is an additional link that replaces a sliding contact of two circles. Its
        R pairs at the centres of the circles join it to the first and to the second link of
        the contact. `coupler` is the index in `couplers`.
        """
        # The pairs of couplers are at the end of the list.
        first_pair = len(self.pairs) - 2 * (len(self.couplers) - coupler)
        return self.body_count + coupler, (first_pair, first_pair + 1)


def extract_structure(mechanism: Mechanism) -> Structure:
    """Return the links and R pairs of a mechanism, with a coupler for each sliding contact.

    A coupler is a further link that replaces a sliding contact of two circles. R pairs at
    the centres of both circles join it to the links of the contact. Each coupler adds one
    link and two pairs, first the pair with the first link of the contact. The field
    `followers` stays empty.

    Raises
    ------
    PlanError
        If the profiles of a contact are not two circles, if an input is a contact pair, or
        if there is no R pair.
    """
    links = list(mechanism.links)
    pair_names = []
    pair_ends = []
    for pair, ends in zip(mechanism.pairs, mechanism.ends, strict=True):
        if pair.kind.has_axis:
            pair_names.append(pair.name)
            pair_ends.append(ends)

    # Contacts. A sliding one adds a coupler with two pairs. A rolling one adds nothing, but
    # its number is listed.
    sliding_contacts = []
    rolling_contacts = []
    for number, (pair, ends) in enumerate(
        zip(mechanism.pairs, mechanism.ends, strict=True)
    ):
        if pair.kind.has_axis:
            continue
        links_with_other_profiles = [
            link
            for link, profile in zip(pair.links, pair.profiles or (), strict=True)
            if profile.round_axis is None
        ]
        if links_with_other_profiles:
            raise PlanError(
                f'{mechanism.name}: contact pair "{pair.name}": the profile on link '
                f'"{links_with_other_profiles[0]}" is not a circle; proofs are possible '
                "for R and P pairs and for contacts of circles"
            )
        # A rolling contact has one variable, a sliding contact has two.
        if pair.kind.variable_count == 1:
            rolling_contacts.append(number)
            continue
        sliding_contacts.append(number)
        links.append(_unused_name(pair.name, links))
        for link, end in zip(pair.links, ends, strict=True):
            pair_names.append(_unused_name(f"{pair.name}_{link}", pair_names))
            coupler_link = len(links) - 1
            pair_ends.append((end, coupler_link))

    driven_names = mechanism.names_of(driven_pairs(mechanism))
    return Structure(
        name=mechanism.name,
        links=links,
        pairs=pair_names,
        ends=tuple(pair_ends),
        inputs=tuple(map(pair_names.index, driven_names)),
        couplers=sliding_contacts,
        wheels=rolling_contacts,
    )


def _unused_name(name: str, used_names: list[str]) -> str:
    """Return a name with underscores added until it differs from all used names."""
    while name in used_names:
        name += "_"
    return name
