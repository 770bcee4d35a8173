"""The order in which the positions of all links follow from the inputs, group by group.

With all inputs locked, a mechanism is a structure without degrees of freedom. Its smallest
rigid part is a group that can be placed on its own: a dyad, a triad, or a larger
irreducible group. The group is then one body, and the next group follows, until a single
body remains. No link is treated as a fixed frame (theory of Assur groups). An input between
two links that both move therefore needs no special treatment.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import chain
from typing import NamedTuple

from spherekit.errors import CountError, PlanError
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.gear_mesh import find_carried_contacts
from spherekit.planning.mobility import (
    BODY_FREEDOMS,
    DYAD_BODIES,
    PebbleGame,
    check_mobility,
    merge_locked_links,
    play_on_bodies,
)
from spherekit.wording import listing


def driven_pairs(mechanism: Mechanism) -> tuple[int, ...]:
    """Return the indices of the driven pairs, which are the inputs of a mechanism.

    An input must be an R pair (revolute joint). In a contact pair, two links touch along
    curves.

    Raises
    ------
    PlanError
        If an input is a contact pair, or there is no R pair at all.
    """
    revolute_pairs = list(mechanism.angles)
    input_names = mechanism.input_pairs
    for name in input_names:
        if not mechanism.pair(name).kind.has_axis:
            raise PlanError(
                f'{mechanism.name}: inputs.{name}: pair "{name}" is a contact pair; choose '
                f"an R pair as input: {listing(revolute_pairs) or 'there is none'}"
            )
    # A mechanism without declared inputs has its first R pair as the default input. It has
    # no input at all only if it has no R pair.
    if not input_names:
        raise PlanError(
            f"{mechanism.name}: an input must be an R pair, but the mechanism "
            "has none; add an R pair"
        )
    return tuple(mechanism.pair_number[name] for name in input_names)


def driven_at(mechanism: Mechanism, names: str | Sequence[str] | None = None) -> Mechanism:
    """Return the mechanism with other inputs, as the user names them.

    Parameters
    ----------
    mechanism
        The mechanism. If no names are stated, the same mechanism is returned.
    names
        Name of the driven pair, or names of several. Without names, the inputs that the
        mechanism has are checked.

    Raises
    ------
    PlanError
        If the list of names is empty. Without names, if an input of the mechanism is a
        contact, or the mechanism has no R pair (hinge).
    ModelError
        If no pair has one of the names, or a pair is named twice.
    """
    if names is None:
        driven_pairs(mechanism)
        return mechanism
    if not names:
        raise PlanError(f"{mechanism.name}: input_pair is empty; name one or more pairs")
    if isinstance(names, str):
        return mechanism.with_inputs(names)
    return mechanism.with_inputs(*names)


class Group(NamedTuple):
    """Bodies that become one body when all their pairs are closed together.

    Links and pairs (joints) have indices in the mechanism. In the group, a body (links that
    are rigid with each other) has a position in `bodies`, and a pair a position in `pairs`.

    Attributes
    ----------
    bodies
        For each body the indices of its links, which are already rigid relative to each
        other. Positions of the other bodies are computed relative to the first body.
    pairs
        Indices of the pairs between these bodies.
    ends
        For each pair the positions in `bodies` of the two bodies that it joins. The body of
        its first link comes first.
    revolute
        Whether all pairs are R pairs whose equations are independent.
    redundant
        Whether there are more equations than unknowns. For the given geometry, the surplus
        equations follow from the others.
    """

    bodies: tuple[tuple[int, ...], ...]
    pairs: tuple[int, ...]
    ends: tuple[tuple[int, int], ...]
    revolute: bool = True
    redundant: bool = False

    @property
    def is_dyad(self) -> bool:
        """Whether the group has the closed form of a spherical triangle."""
        return self.revolute and len(self.bodies) == DYAD_BODIES

    @property
    def dyad_positions(self) -> tuple[int, int, int]:
        """Positions in `pairs` of the outer, middle and second outer pair of a dyad.

        A dyad has two links (bodies 1 and 2) and is joined to body 0, which is placed. The
        first outer pair joins body 0 to body 1, the middle pair joins body 1 to body 2, and
        the second outer pair joins body 0 to body 2.
        """
        joined_bodies = [set(ends) for ends in self.ends]
        first_outer = joined_bodies.index({0, 1})
        middle = joined_bodies.index({1, 2})
        second_outer = joined_bodies.index({0, 2})
        return first_outer, middle, second_outer

    @property
    def dyad_parity(self) -> int:
        """1 or -1, a factor that converts the sign of a dyad to another order of its axes.

        A dyad can be assembled in two ways, told apart by the sign of u_1 . (u_2 x u_3).
        The axes u are in the order of `pairs`. In the order middle, first outer, second
        outer, the triple product has this factor times the sign. The factor is 1 if this
        order is an even permutation of `pairs`.
        """
        first_outer, middle, _ = self.dyad_positions
        return 1 if (first_outer - middle) % 3 == 1 else -1

    @property
    def middle(self) -> int:
        """The index of the middle pair of a dyad."""
        _, middle, _ = self.dyad_positions
        return self.pairs[middle]

    @property
    def dyad_pairs(self) -> tuple[int, int, int]:
        """Indices of the three pairs of a dyad, in the order of its links.

        The order is: the first outer pair, the middle pair and the other outer pair.
        """
        first_outer, middle, second_outer = self.dyad_positions
        return self.pairs[first_outer], self.pairs[middle], self.pairs[second_outer]

    @property
    def loops(self) -> int:
        """Number of independent closed loops within the group."""
        return len(self.pairs) - len(self.bodies) + 1

    @property
    def kind(self) -> str:
        """The kind of the group: dyad, triad, or a text with its number of bodies."""
        if self.is_dyad:
            return "dyad"
        if self.redundant:
            return f"over-constrained group of {len(self.bodies)} bodies"
        if not self.revolute:
            return f"contact group of {len(self.bodies)} bodies"
        if len(self.bodies) == 5:
            return "triad"
        return f"{len(self.bodies)}-body group with {self.loops} loops"


class Assembly(NamedTuple):
    """The order in which the links are placed, if the angles of the inputs are given.

    An input pair with a given angle joins its two links rigidly. Links that are joined in
    this way form a body. A group is a set of bodies that become one rigid body when all
    their pairs are closed. Group after group is placed, until all links are one body.

    Attributes
    ----------
    inputs
        Indices of the input pairs.
    body_of_link
        For each link the number of the body that it belongs to before any group is placed.
        The number of a body is the smallest of the indices of its links.
    groups
        The groups. Each one uses the bodies that earlier groups have formed.
    """

    inputs: tuple[int, ...]
    body_of_link: tuple[int, ...]
    groups: tuple[Group, ...]

    @property
    def input(self) -> int:
        """The index of the only input pair; `PlanError` if there are several."""
        if len(self.inputs) != 1:
            raise PlanError(
                "this is possible only for mechanisms with one input, but there are "
                f"{len(self.inputs)}; lock the others: --lock PAIR=VALUE, or "
                "spherekit.lock"
            )
        return self.inputs[0]

    @property
    def has_closed_form(self) -> bool:
        """Whether every group is a dyad."""
        return all(group.is_dyad for group in self.groups)

    def joining_group(self, link: int, reference: int) -> Group | None:
        """Return the group that determines the motion of a link relative to another one.

        A body is a set of rigidly joined links. In the beginning, locked input pairs join
        links. A group is a set of bodies that become one body when their pairs are
        assembled. The groups are assembled one after another, so the bodies of later groups
        have more links. The returned group is the first that joins the two links.

        Parameters
        ----------
        link, reference
            Indices of the two links.

        Returns
        -------
        The group. None if locked input pairs already join the two links.
        """
        for group in self.groups:
            bodies_with_links = [
                body for body in group.bodies if link in body or reference in body
            ]
            # Each of the two bodies has one of the links.
            if len(bodies_with_links) == 2:
                return group
        return None


def plan_assembly(mechanism: Mechanism, by_rank: bool = False) -> Assembly:
    """Return the groups in which the links of a mechanism are placed, in order.

    With all inputs locked, the mechanism is a rigid structure. A group is a smallest part
    of it that is rigid by itself, such as a dyad (two links and three R pairs). The
    positions in a group are solved first, and the group is one body of later groups.

    Parameters
    ----------
    mechanism
        The mechanism, with its inputs.
    by_rank
        Whether the rank of the velocity equations has shown that there is one degree of
        freedom for each input. Counting links and pairs may then give fewer degrees of
        freedom, because some constraints are redundant.

    Raises
    ------
    PlanError
        If there is not one degree of freedom for each input, if an input is a contact pair
        or depends on the other inputs, if several links always form a rigid part, or if
        pairs do not join all links.
    """
    inputs = driven_pairs(mechanism)
    # Check that there is one degree of freedom for each input, and that the inputs are
    # independent. For this all inputs but the first are locked. Each lock must take away
    # one degree of freedom, and the first input must still be able to move.
    #
    # The pebble game is an algorithm that counts the degrees of freedom of all parts of a
    # graph. The game is None if constraints may be redundant, because the count is then
    # useless.
    _, pebble_game = check_mobility(
        mechanism, driven=inputs, locked=inputs[1:], by_rank=by_rank
    )
    may_be_redundant = pebble_game is None
    # With all inputs locked, the links that they join are one body.
    body_of_link = merge_locked_links(mechanism, inputs)
    open_pairs = [n for n in range(len(mechanism.pairs)) if n not in inputs]
    if may_be_redundant:
        groups = _split_with_redundancy(mechanism, body_of_link, open_pairs)
    else:
        groups = split_into_groups(mechanism, body_of_link, open_pairs)
    return Assembly(inputs, body_of_link, groups)


def _split_with_redundancy(
    mechanism: Mechanism, body_of_link: Sequence[int], pairs: Sequence[int]
) -> tuple[Group, ...]:
    """Return the groups of a rigid structure in which some constraints repeat others.

    With its inputs locked, a mechanism is a rigid structure. A group is a smallest part of
    it that is rigid by itself. The positions of the links are later solved group by group.

    The groups are found by counting constraints, so a repeated constraint must not count.
    An example is two wheels on a common carrier that roll on each other: the carrier
    already keeps them in touch. Repeated constraints of this kind are left out of the
    count. If there are others, the groups are not known, and all bodies are one group.

    Parameters
    ----------
    mechanism
        The mechanism.
    body_of_link
        For each link the number of its body, a set of rigidly joined links: the smallest
        index of a link in it.
    pairs
        Indices of the pairs that join the bodies.
    """
    carried_contacts = find_carried_contacts(mechanism)
    try:
        return split_into_groups(
            mechanism, body_of_link, pairs, carried_contacts=carried_contacts
        )
    except CountError:
        # Other constraints are repeated, too.
        whole_group = _make_group(
            mechanism,
            body_of_link,
            base_body=body_of_link[0],  # the ground
            pairs=pairs,
            redundant=True,
        )
        # `revolute` would mean that all pairs are R pairs (hinges) with independent
        # equations. The equations are not independent.
        return (whole_group._replace(revolute=False),)


def split_into_groups(
    mechanism: Mechanism,
    body_of_link: Sequence[int],
    pairs: Iterable[int],
    carried_contacts: frozenset[int] = frozenset(),
) -> tuple[Group, ...]:
    """Return the groups of a structure without degrees of freedom, in solving order.

    Parameters
    ----------
    mechanism
        The mechanism.
    body_of_link
        For each link the smallest index of a link of its body.
    pairs
        Indices of the pairs that join the bodies. Links without any of these pairs are left
        out.
    carried_contacts
        Indices of rolling contacts of two wheels on one link, the carrier. The carrier
        already keeps the wheels in touch. Only one of the two constraints of such a contact
        is therefore counted.

    Raises
    ------
    CountError
        If the bodies could move, or are over-constrained.
    """
    open_pairs = {n: mechanism.ends[n] for n in pairs}
    pebble_game, is_independent = play_on_bodies(
        mechanism, body_of_link, open_pairs, carried_contacts
    )
    joined_bodies = {body_of_link[link] for link in chain(*open_pairs.values())}
    freedoms_left = sum(pebble_game.free_pebbles[body] for body in joined_bodies)
    # A structure keeps the three degrees of freedom of one rigid body.
    if open_pairs and not (is_independent and freedoms_left == BODY_FREEDOMS):
        raise CountError(
            f"{mechanism.name}: {len(open_pairs)} pairs do not join "
            f"{len(joined_bodies)} bodies rigidly with just as many constraints as "
            "necessary: either the bodies can still move relative to each other, or "
            "some constraints are redundant"
        )

    # The smallest rigid part is a group, and becomes one body. Then the next one follows.
    groups: list[Group] = []
    while open_pairs:
        part = _find_smallest_part(pebble_game, open_pairs, body_of_link)
        ground_body = body_of_link[0]
        # The other bodies are placed in the ground if the part contains it. Otherwise they
        # are placed in the body with the most links, and of these in the first.
        base_body = ground_body
        if ground_body not in part:
            link_count = Counter(body_of_link)
            base_body = min(part, key=lambda body: (-link_count[body], body))
        inner_pairs = [
            n
            for n, ends in open_pairs.items()
            if {body_of_link[link] for link in ends} <= part
        ]
        redundant = not carried_contacts.isdisjoint(inner_pairs)
        groups.append(
            _make_group(mechanism, body_of_link, base_body, inner_pairs, redundant)
        )
        pebble_game.merge_bodies(part, base_body)
        body_of_link = [base_body if body in part else body for body in body_of_link]
        open_pairs = {n: ends for n, ends in open_pairs.items() if n not in inner_pairs}
    return tuple(groups)


def _make_group(
    mechanism: Mechanism,
    body_of_link: Sequence[int],
    base_body: int,
    pairs: Sequence[int],
    redundant: bool,
) -> Group:
    """Return the group of all bodies that some pairs join.

    A group is a set of bodies that become one rigid body when all its pairs are closed. A
    body is a set of links that are rigid already. The number of a body is the index of one
    of its links.

    Parameters
    ----------
    mechanism
        The mechanism.
    body_of_link
        For each link the number of its body.
    base_body
        The body that comes first in the group. The others are placed relative to it.
    pairs
        Indices of the pairs of the group.
    redundant
        Whether the group has more equations than unknowns.
    """
    # The two bodies that each pair joins, and the links of each of these bodies.
    bodies_of_pairs = []
    for number in pairs:
        link_a, link_b = mechanism.ends[number]
        bodies_of_pairs.append((body_of_link[link_a], body_of_link[link_b]))
    links_of_body = {}
    for body in chain(*bodies_of_pairs):
        links = [link for link, owner in enumerate(body_of_link) if owner == body]
        links_of_body[body] = tuple(links)
    # The base body comes first (False is sorted before True), the others in the order of
    # their links.
    bodies = sorted(
        links_of_body, key=lambda body: (body != base_body, links_of_body[body])
    )
    # The group counts its bodies from 0 on, in this order.
    position = {body: k for k, body in enumerate(bodies)}
    return Group(
        bodies=tuple(links_of_body[body] for body in bodies),
        pairs=tuple(pairs),
        ends=tuple((position[a], position[b]) for a, b in bodies_of_pairs),
        revolute=all(mechanism.pairs[n].kind.has_axis for n in pairs),
        redundant=redundant,
    )


def _find_smallest_part(
    pebble_game: PebbleGame,
    open_pairs: dict[int, tuple[int, int]],
    body_of_link: Sequence[int],
) -> set[int]:
    """Return a small rigid part that contains both bodies of an open pair.

    A part is a set of bodies, which are placed together next. A pair is open if it has not
    been placed yet. The parts are searched in the order of the indices of the two bodies,
    up to the first part of at most three bodies. The first of the smallest parts that were
    found is returned. It is a smallest part of all, except in one case: with contacts, a
    part of two bodies can exist after the first part of three.

    Parameters
    ----------
    pebble_game
        Counts the degrees of freedom of sets of bodies.
    open_pairs
        The two links of each open pair, by index of the pair.
    body_of_link
        For each link the number of its body. A body is a set of rigidly joined links, and
        its number is the index of one of these links.
    """
    parts = []
    for body_a, body_b in _list_couples(open_pairs, body_of_link):
        part = _find_smallest_part_with(pebble_game, body_a, body_b)
        parts.append(part)
        # Without contacts, the smallest possible part is a dyad: two links and the body to
        # which they are joined. So the search ends here.
        if len(part) == DYAD_BODIES:
            break
    # Of parts of equal size `min` returns the first one.
    return min(parts, key=len)


def _list_couples(
    open_pairs: dict[int, tuple[int, int]], body_of_link: Sequence[int]
) -> list[tuple[int, int]]:
    """Return the two bodies that each open pair (joint) joins, in sorted order.

    A body is a set of links that are already rigid with each other, named by one of these
    links. Open pairs are not closed yet. Parameters are those of `_find_smallest_part`.
    """
    couples = []
    for link_a, link_b in open_pairs.values():
        body_a = body_of_link[link_a]
        body_b = body_of_link[link_b]
        couples.append((min(body_a, body_b), max(body_a, body_b)))
    return sorted(couples)


def _find_smallest_part_with(pebble_game: PebbleGame, body_a: int, body_b: int) -> set[int]:
    """Return the smallest rigid part that contains two bodies of a rigid structure.

    The pebble game counts degrees of freedom (Lee and Streinu 2008). Each body has three
    pebbles, one per degree of freedom. Each constraint takes a pebble of one of its two
    bodies, and points from this body to the other one. The pebbles that no constraint has
    taken are free. A rigid structure has three free pebbles, for its motion as a whole.

    The free pebbles are gathered on body a. The part is then all bodies that can be reached
    from a and b along constraints, in the direction in which these point.

    Parameters
    ----------
    pebble_game
        The game with all constraints of the structure.
    body_a, body_b
        Indices of the two bodies.

    Notes
    -----
    A part is rigid if the constraints between its own bodies have taken all its pebbles but
    three.

    - The returned part is rigid. Three of its pebbles are free, on body a. No constraint
      points from the part to the outside, so constraints within have taken all others.
    - A smaller part with both bodies is not rigid. The bodies that it lacks can be reached
      from a or b, so some constraint points to the outside. This constraint has taken a
      pebble. Besides, three pebbles are free on body a.
    """
    pebble_game.gather_pebbles(body_a, BODY_FREEDOMS)
    return pebble_game.reachable_bodies([body_a, body_b])
