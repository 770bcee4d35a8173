"""The order in which proofs place the links of a mechanism.

Links are placed one after another from a root. A link that is joined to one placed link is
rotated by the angle of that pair: an unknown, an input, or a follower of wheels. A link
that is joined to two placed links is put on the axes of both pairs. Its arc between these
axes is then one equation (`spherekit.proof.arc_equations`). A structure that can just be
assembled has at least one body with at most two pairs, and again has one without this body,
so such an order always exists.

Wheels with teeth rotate p/q as fast as the only input. Over ranges of the input, the angles
of the input and of all wheels are whole multiples of one variable, which makes one turn
while the input makes q turns. The equations are then trigonometric polynomials in this
variable, as in any other angle. Configurations one turn of the input apart count as
different unless all wheels are back.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import combinations, islice, permutations
from math import lcm, prod

import numpy as np

from spherekit.arrays import Indices
from spherekit.errors import PlanError
from spherekit.mechanism.graph import component_labels, find_spanning_tree
from spherekit.proof.decimal_mechanism import DecimalMechanism
from spherekit.proof.structure import Structure
from spherekit.wording import listing

MAX_COMPARED_ORDERS = 20000
"""Largest number of orders of placing that are compared; eight-bars have some hundred.

Larger: planning of mechanisms with many links takes longer. Smaller: the order with the
lowest bound of complex modes may be missed.
"""

MAX_CACHED_STRUCTURES = 256
"""Number of structures whose construction is remembered.

Random geometries of one structure share it. Larger: more memory. Smaller: studies of many
structures plan again.
"""

MAX_CYCLE_TURNS = 64
"""Largest number of turns of the input, and of wheels, until all wheels are back.

Larger: equations of higher degree in the input's variable, and longer proofs. Smaller:
more gear trains are refused.
"""


@dataclass(frozen=True)
class PlacementStep:
    """One link and how it is placed: across one pair, or on the axes of two pairs.

    Links and pairs are numbers.

    Attributes
    ----------
    link
        The link to place.
    parents
        One or two links that are placed before.
    pairs
        For each parent the pair that joins the link to it.
    variable
        Number of the variable by which a link across one pair rotates; -1 for two pairs.
    angle_factor
        The pair angle over the variable. It differs from 1 only if wheels and the input are
        multiples of one shared variable.
    """

    link: int
    parents: tuple[int, ...]
    pairs: tuple[int, ...]
    variable: int = -1
    angle_factor: int = 1

    @property
    def is_dyad(self) -> bool:
        """Whether the link is put on two axes, which gives an equation."""
        return len(self.pairs) == 2


@dataclass(frozen=True)
class LinkPlacement:
    """The link relative to which another link is placed.

    Attributes
    ----------
    reference
        The reference link. The root is its own reference.
    degrees
        (variables,) degree of the orientation relative to the reference, as a trigonometric
        polynomial, in each variable.
    """

    reference: int
    degrees: Indices


@dataclass(frozen=True)
class ParentPaths:
    """The paths of references from the two parents of a dyad to where they meet.

    Attributes
    ----------
    shared_link
        The first link that both paths have in common.
    first, second
        The links from each parent to the link before the shared one.
    """

    shared_link: int
    first: list[int]
    second: list[int]


@dataclass(frozen=True)
class Construction:
    """An order of placing all links of a mechanism, with its variables and equations.

    A link is placed across one pair, by the angle of the pair, or on the axes of two pairs,
    which gives an equation. Variables are numbered: first the unknown angles, then the
    inputs, then the angles that follow from the inputs through wheels.

    Attributes
    ----------
    root
        The link that is placed first.
    steps
        How the other links are placed, in order.
    pairs
        The pair of each variable.
    unknown_count
        Number of unknown angles; there are as many equations.
    input_count
        Number of inputs.
    cycle_turns
        Turns of the input after which all wheels are back, if input and wheels share one
        variable. The input angle is `cycle_turns` times the variable. Otherwise 1.
    """

    root: int
    steps: Sequence[PlacementStep]
    pairs: tuple[int, ...]
    unknown_count: int
    input_count: int
    cycle_turns: int = 1

    @property
    def input_pairs(self) -> tuple[int, ...]:
        """The pairs of the inputs."""
        return self.pairs[self.unknown_count : self.unknown_count + self.input_count]

    @property
    def follower_pairs(self) -> tuple[int, ...]:
        """The pairs whose angles are variables that follow from the inputs."""
        return self.pairs[self.unknown_count + self.input_count :]

    @property
    def equation_steps(self) -> list[PlacementStep]:
        """The steps that put a link on two axes, in order; each gives one equation."""
        return [step for step in self.steps if step.is_dyad]

    @cached_property
    def placements(self) -> dict[int, LinkPlacement]:
        """By link: its reference link, and the degrees of its orientation relative to it.

        A link across one pair is placed relative to its parent. A link on two axes is
        placed relative to the link at which the paths of its parents meet; a path leads
        from a link to its reference, and so on to the root. Its orientation has the sum of
        the degrees of all links on both paths.
        """
        # One degree for each variable.
        variables = np.arange(len(self.pairs))
        no_degrees = 0 * variables
        placements = {self.root: LinkPlacement(self.root, no_degrees)}
        for step in self.steps:
            if step.is_dyad:
                paths = _find_parent_paths(placements, *step.parents)
                degrees = [
                    placements[link].degrees for link in (*paths.first, *paths.second)
                ]
                placements[step.link] = LinkPlacement(
                    paths.shared_link, np.sum([no_degrees, *degrees], axis=0)
                )
            else:
                degrees_of_angle = abs(step.angle_factor) * (variables == step.variable)
                placements[step.link] = LinkPlacement(step.parents[0], degrees_of_angle)
        return placements

    def parent_paths(self, step: PlacementStep) -> ParentPaths:
        """Return the paths from both parents of a dyad to the link where they meet."""
        return _find_parent_paths(self.placements, *step.parents)

    @cached_property
    def degrees(self) -> Indices:
        """(equations, variables) degrees of the equations as trigonometric polynomials.

        An equation of degree m in an angle has powers -m to m of e^(i angle).
        """
        rows = [self.placements[step.link].degrees for step in self.equation_steps]
        return np.array(rows, dtype=np.intp).reshape(-1, len(self.pairs))

    @cached_property
    def mode_bound(self) -> int:
        """Largest possible number of isolated complex modes.

        In the half tangents of its angles an equation of trigonometric degree m has the
        degree 2 m. By Bezout's theorem for products of projective lines, the bound is the
        permanent of these degrees. It counts solutions at infinity.
        """
        return permanent(2 * self.degrees[:, : self.unknown_count])

    @cached_property
    def equation_systems(self) -> list[tuple[list[int], list[int]]]:
        """The smallest systems of equations that can be solved one after the other.

        For each system the numbers of its equations and of its unknowns, as many. Other
        unknowns in these equations belong to systems before it.
        """
        # Rows are equations, columns are unknowns that are not solved yet.
        has_unknown = self.degrees[:, : self.unknown_count] > 0
        open_equations = list(range(len(has_unknown)))
        systems = []
        while open_equations:
            # Sets of equations, small ones first, each with the unknowns that they contain.
            candidates = (
                (
                    [*equations],
                    np.flatnonzero(np.any(has_unknown[[*equations]], axis=0)).tolist(),
                )
                for size in range(1, len(open_equations) + 1)
                for equations in combinations(open_equations, size)
            )
            # The first set with as many unknowns as equations is the next system.
            equations, unknowns = next(
                candidate
                for candidate in candidates
                if len(candidate[0]) == len(candidate[1])
            )
            systems.append((equations, unknowns))
            # These unknowns are given in the systems that follow.
            has_unknown[:, unknowns] = False
            open_equations = [row for row in open_equations if row not in equations]
        return systems


def _find_parent_paths(
    placements: Mapping[int, LinkPlacement], first_parent: int, second_parent: int
) -> ParentPaths:
    """Return the paths of two links to the first link that both paths have in common.

    A path leads from a link to its reference, from there to the reference of that link, and
    so on to the root.

    Parameters
    ----------
    placements
        By link: its reference link.
    first_parent, second_parent
        The two links.
    """
    paths = []
    for parent in (first_parent, second_parent):
        path = [parent]
        while (reference := placements[path[-1]].reference) != path[-1]:
            path.append(reference)
        paths.append(path)
    first_path, second_path = paths
    shared_link = next(link for link in first_path if link in second_path)
    return ParentPaths(
        shared_link,
        first_path[: first_path.index(shared_link)],
        second_path[: second_path.index(shared_link)],
    )


def permanent(matrix: Indices) -> int:
    """Return the permanent of a square matrix.

    It is the sum over all permutations of the products of one entry from each row.
    """
    rows = matrix.tolist()
    return sum(
        prod(row[column] for row, column in zip(rows, columns, strict=True))
        for columns in permutations(range(len(rows)))
    )


def find_construction(
    structure: Structure, preferred_pairs: Collection[int] = ()
) -> Construction:
    """Return the order of placing links that has the lowest bound of complex modes.

    Parameters
    ----------
    structure
        The links and pairs.
    preferred_pairs
        Numbers of pairs. The order in which most of them are variables is taken first, the
        bound of complex modes decides among equals.

    Raises
    ------
    PlanError
        If there is no such order, since the structure does not have one degree of freedom
        for each input, or if the structure has no loop.
    """
    construction = _find_best_construction(
        structure.ends,
        len(structure.links),
        len(structure.inputs),
        (*structure.inputs, *structure.followers),
        frozenset(preferred_pairs),
    )
    if construction is None:
        raise PlanError(
            f"{structure.name}: its links cannot be placed one after another on at most "
            f"two axes each; proofs need one freedom for each input by counting"
        )
    if not construction.unknown_count and not construction.follower_pairs:
        raise PlanError(
            f"{structure.name}: it has no closed loop, so that all angles are inputs and "
            "there is nothing to prove"
        )
    return construction


Ends = tuple[tuple[int, int], ...]
"""For each pair the two links that it joins."""

PlacingOrder = tuple[tuple[int, ...], ...]
"""For each body in order: the body, then the one or two pairs by which it is placed."""


@lru_cache(MAX_CACHED_STRUCTURES)
def _find_best_construction(
    ends: Ends,
    link_count: int,
    input_count: int,
    given_pairs: tuple[int, ...],
    preferred_pairs: frozenset[int],
) -> Construction | None:
    """Return the construction with the lowest bound of complex modes, None without one.

    A construction is an order of placing the links. Links that pairs with given angles join
    form bodies, which are placed as one. Before the bound, the number of preferred pairs
    that are variables decides; among equal bounds the sum of the degrees does.

    Parameters
    ----------
    ends
        For each pair the two links that it joins.
    link_count, input_count
        Numbers of links and of inputs.
    given_pairs
        The pairs with given angles: inputs first, then followers.
    preferred_pairs
        Pairs that shall be variables if possible.
    """
    body_of_link = component_labels(link_count, (ends[pair] for pair in given_pairs))
    # By pair with an unknown angle: the two bodies that it joins.
    joined_bodies = {
        pair: (body_of_link[first], body_of_link[second])
        for pair, (first, second) in enumerate(ends)
        if pair not in given_pairs
    }
    # A body is rigid, so a pair with an unknown angle between two of its links is locked.
    if any(first == second for first, second in joined_bodies.values()):
        return None
    # Roots are tried from the body of the first input on.
    input_body = body_of_link[ends[given_pairs[0]][0]]
    roots = sorted(set(body_of_link), key=lambda body: body != input_body)
    constructions = (
        _make_construction(ends, body_of_link, input_count, given_pairs, root, order)
        for root in roots
        for order in placing_orders(joined_bodies, frozenset(body_of_link), root)
    )
    return min(
        (
            construction
            for construction in islice(constructions, MAX_COMPARED_ORDERS)
            # A bound of 0 means that some equations cannot be solved for the unknowns.
            if construction and construction.mode_bound
        ),
        key=lambda construction: (
            len(preferred_pairs - {*construction.pairs}),
            construction.mode_bound,
            np.sum(construction.degrees),
        ),
        default=None,
    )


def placing_orders(
    joined_bodies: Mapping[int, tuple[int, int]], bodies: frozenset[int], root: int
) -> Iterator[PlacingOrder]:
    """Yield orders of placing bodies, each with one or two pairs to bodies before it.

    An order has for each body except the root its number, then the one or two pairs by
    which it is placed. No two orders place every body by the same pairs.

    Parameters
    ----------
    joined_bodies
        For each pair the two bodies that it joins.
    bodies
        All bodies.
    root
        The body that is placed first.
    """
    seen_placements: set[frozenset[tuple[int, ...]]] = set()

    def remove_bodies(
        remaining: frozenset[int], order: PlacingOrder
    ) -> Iterator[PlacingOrder]:
        """Yield the orders that end with a given order, by removing one body after another.

        Parameters
        ----------
        remaining
            The bodies that are still to be removed, and the root.
        order
            The bodies removed so far with their pairs, the one removed last first. Placing
            is the reverse of removing, so that this is the end of the placing order.
        """
        # The bodies that can still be removed depend on the set of those removed and on
        # their pairs, not on the sequence. A set that was reached before gives no new
        # order.
        placements = frozenset(order)
        if placements in seen_placements:
            return
        seen_placements.add(placements)
        if remaining == {root}:
            yield order
            return
        for body in sorted(remaining - {root}):
            joining_pairs = tuple(
                pair
                for pair, two_bodies in joined_bodies.items()
                if body in two_bodies and set(two_bodies) <= remaining
            )
            if 1 <= len(joining_pairs) <= 2:
                extended_order = ((body, *joining_pairs), *order)
                yield from remove_bodies(remaining - {body}, extended_order)

    yield from remove_bodies(bodies, ())


def _make_construction(
    ends: Ends,
    body_of_link: list[int],
    input_count: int,
    given_pairs: tuple[int, ...],
    root: int,
    order: PlacingOrder,
) -> Construction | None:
    """Return the construction that places bodies in an order, None if it is not possible.

    A body consists of links that pairs with given angles join. The order is not possible if
    the two pairs by which a body is placed are on different links of the body or on one and
    the same parent, or if there are not as many equations as unknowns.

    Parameters
    ----------
    ends
        For each pair the two links that it joins.
    body_of_link
        For each link the body to which it belongs.
    input_count
        Number of inputs.
    given_pairs
        The pairs with given angles: inputs first, then followers.
    root
        The body that is placed first; its number is also that of its first link.
    order
        The other bodies with the pairs by which they are placed.
    """
    unknown_pairs = [pairs[0] for _, *pairs in order if len(pairs) == 1]
    variable_pairs = (*unknown_pairs, *given_pairs)
    steps: list[PlacementStep] = []
    for body, *joining_pairs in ((root,), *order):
        # For each pair its link on this body, and its parent on a body before.
        links = [
            next(link for link in ends[pair] if body_of_link[link] == body)
            for pair in joining_pairs
        ]
        # The sum of both ends less one end is the other end.
        parents = tuple(
            sum(ends[pair]) - link for pair, link in zip(joining_pairs, links, strict=True)
        )
        if len(set(links)) > 1 or len(set(parents)) < len(joining_pairs):
            return None
        if joining_pairs:
            has_one_pair = len(joining_pairs) == 1
            variable = variable_pairs.index(joining_pairs[0]) if has_one_pair else -1
            steps.append(PlacementStep(links[0], parents, tuple(joining_pairs), variable))
        # The other links of the body follow across pairs with given angles, from the link
        # that is placed already.
        steps += [
            PlacementStep(link, (parent,), (pair,), variable_pairs.index(pair))
            for pair, parent, link in find_spanning_tree(
                ends, links[:1] or [root], given_pairs
            )
        ]
    if sum(step.is_dyad for step in steps) != len(unknown_pairs):
        return None
    return Construction(root, steps, variable_pairs, len(unknown_pairs), input_count)


def share_input_variable(
    decimal_mechanism: DecimalMechanism, construction: Construction
) -> Construction:
    """Return a construction in which input and wheels are multiples of one variable.

    The shared variable makes one turn in the turns of the input after which all wheels are
    back. The angles of the input and of the wheels are then whole multiples of it.

    Parameters
    ----------
    decimal_mechanism
        A mechanism with one input and with followers.
    construction
        A construction in which each follower, a pair whose angle follows from the inputs
        through wheels, is a variable of its own.

    Raises
    ------
    PlanError
        If the ratios of the wheels are not those of numbers of teeth, or if the wheels are
        back only after too many turns.
    """
    structure = decimal_mechanism.structure
    wheel_names = listing(structure.names_of(construction.follower_pairs))
    ratios = decimal_mechanism.exact_follower_ratios()
    if ratios is None:
        raise PlanError(
            f"{structure.name}: wheels turn {wheel_names} with the input; proofs over "
            "ranges are for ratios of teeth, with which wheels come back: give teeth, or "
            "give values of the inputs with --at"
        )
    # With ratios p/q, after the least common multiple of all q all wheels are back.
    cycle_turns = lcm(*(ratio.denominator for ratio in ratios))
    factors = {
        pair: int(cycle_turns * ratio)
        for pair, ratio in zip(structure.followers, ratios, strict=True)
    }
    most_turns = max(cycle_turns, *map(abs, factors.values()))
    if most_turns > MAX_CYCLE_TURNS:
        raise PlanError(
            f"{structure.name}: wheels turn {wheel_names} with the input, up to "
            f"{most_turns} turns until they are back; proofs over ranges are for at most "
            f"{MAX_CYCLE_TURNS}: give values of the inputs with --at"
        )
    (input_pair,) = construction.input_pairs
    factors[input_pair] = cycle_turns
    variable = construction.unknown_count
    # Links across the input and the wheels get the shared variable.
    steps = [
        replace(step, variable=variable, angle_factor=factors[step.pairs[0]])
        if step.pairs[0] in factors and not step.is_dyad
        else step
        for step in construction.steps
    ]
    return replace(
        construction,
        steps=steps,
        pairs=construction.pairs[: variable + 1],
        cycle_turns=cycle_turns,
    )
