"""The order in which proofs place the links of a mechanism.

Links are placed one after another from a root. A link that is joined to one placed link is
rotated by the angle of that pair: an unknown, an input, or a follower of wheels. A link
that is joined to two placed links is put on the axes of both pairs. Its arc between these
axes is then one equation (`spherekit.proof.arc_equations`). Such an order exists only if
the mobility, computed from the numbers of links and pairs, equals the number of inputs. The
structure then has a body with at most two pairs, and what remains without this body has one
again.

Wheels with teeth rotate p/q as fast as the only input. Over ranges of the input, the angles
of the input and of all wheels are whole multiples of one variable, which makes one turn
while the input makes q turns. The equations are then trigonometric polynomials in this
variable, as in any other angle. Two configurations with inputs that differ by a whole turn
count as different, unless all wheel angles agree.
"""

from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import combinations, islice
from math import lcm

import numpy as np

from spherekit.arrays import Bools, Indices
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
"""Number of structures for which the construction is remembered.

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
    """One link, and how it is placed relative to links that are placed before it.

    A proof places the links one by one. If one pair (joint) joins the link to a placed one,
    it rotates about the axis of this pair. If two pairs join it to placed links, it is put
    on both axes. Links and pairs are numbered as in the structure.

    Attributes
    ----------
    link
        The link to place.
    parents
        One or two links that are placed before.
    pairs
        For each parent the pair that joins the link to it, in the same order.
    variable
        Index of the variable that gives the angle of the pair, for a link with one parent.
        -1 for a link with two parents, which needs no angle.
    angle_factor
        Pair angle divided by the variable, a whole number. The factor can differ from 1 in
        mechanisms with toothed wheels, where the angles of the input and of the wheels are
        multiples of one variable.
    """

    link: int
    parents: tuple[int, ...]
    pairs: tuple[int, ...]
    variable: int = -1
    angle_factor: int = 1

    @property
    def has_two_parents(self) -> bool:
        """Whether the link is put on the axes of two placed links (its parents).

        Such a closing link gives one equation: the angle between the axes of both placed
        links equals the angle between the two axes of the closing link. Any other link
        rotates about the axis of one pair.
        """
        return len(self.pairs) == 2


@dataclass(frozen=True)
class LinkPlacement:
    """The link relative to which a link is oriented, and the degrees of its orientation.

    The orientation is a rotation matrix. Its elements are trigonometric polynomials in the
    pair angles. Degree m in an angle means terms up to cos(m angle) and sin(m angle). The
    degrees limit the number of solutions of the equations.

    Attributes
    ----------
    reference
        Index of the link relative to which this link is oriented. The root, which is placed
        first, is its own reference.
    degrees
        (variables,) degree of the relative orientation in each variable.
    """

    reference: int
    degrees: Indices


@dataclass(frozen=True)
class ParentPaths:
    """The two paths of links that form a loop together with a closing link.

    A closing link is joined by two pairs (joints) to two links placed before, its parents.
    Its equation contains the axes of both pairs. Both axes must be expressed in the
    coordinates of the same link, the shared link. The orientation of each link is given
    relative to its reference link. So each axis is transformed step by step: from the
    parent to its reference link, then to the reference of that. The links on the way are
    the path. It ends at the shared link, where both paths meet.

    Attributes
    ----------
    shared_link
        Index of the first link that both paths have in common.
    first, second
        Indices of the links of each path, from the parent on, without the shared link.
    """

    shared_link: int
    first: list[int]
    second: list[int]


@dataclass(frozen=True)
class Construction:
    """An order of placing all links of a mechanism, with its variables and equations.

    A link that one pair joins to links placed before rotates by the angle of this pair,
    which is a variable. A link that two pairs join to links placed before is put on both
    axes. The equation of this link says that the arc between the axes equals the arc of the
    link. Variables are numbered: first the unknown angles, then the inputs, then the angles
    that follow from the inputs through toothed wheels.

    Attributes
    ----------
    root
        Index of the link that is placed first.
    steps
        How the other links are placed, in order.
    pairs
        (variables,) for each variable the index of the pair that has this angle.
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
        """The pairs with angles that are variables, but follow from the inputs (wheels)."""
        return self.pairs[self.unknown_count + self.input_count :]

    @property
    def equation_steps(self) -> list[PlacementStep]:
        """The steps that put a link on two axes, in order; each gives one equation."""
        return [step for step in self.steps if step.has_two_parents]

    @cached_property
    def placements(self) -> dict[int, LinkPlacement]:
        """The placement of each link, by the index of the link.

        A placement has the reference of the link: a link placed before. The elements of the
        rotation matrix of the link, relative to its reference, are trigonometric
        polynomials in the variables (angles). The placement also has the degree of these
        polynomials in each variable. The degrees of the closure equations follow from it.
        """
        no_degrees = np.zeros(len(self.pairs), dtype=np.intp)
        placements = {self.root: LinkPlacement(self.root, no_degrees)}
        for step in self.steps:
            # Two pairs join the link to placed links (its parents), or one pair does.
            if step.has_two_parents:
                placements[step.link] = _place_on_two_axes(placements, step)
            else:
                placements[step.link] = self._place_on_one_pair(step)
        return placements

    def _place_on_one_pair(self, step: PlacementStep) -> LinkPlacement:
        """Return the placement of a link that rotates about the axis of one pair.

        The orientation of the link relative to its reference, the other link of the pair,
        is a trigonometric polynomial. The angle of the pair is k times one variable, with
        k = 1 except for wheels. So the degree in this variable is |k|.
        """
        is_variable_of_pair = np.arange(len(self.pairs)) == step.variable
        return LinkPlacement(
            reference=step.parents[0],
            degrees=abs(step.angle_factor) * is_variable_of_pair,
        )

    def parent_paths(self, step: PlacementStep) -> ParentPaths:
        """Return the paths from both parents of a closing link to where they meet."""
        return _find_parent_paths(self.placements, *step.parents)

    @cached_property
    def degrees(self) -> Indices:
        """(equations, variables) degrees of the closure equations in cos and sin of angles.

        An equation of degree m in an angle has powers -m to m of e^(i angle).
        """
        rows = [self.placements[step.link].degrees for step in self.equation_steps]
        return np.array(rows, dtype=np.intp).reshape(-1, len(self.pairs))

    @cached_property
    def mode_bound(self) -> int:
        """Largest possible number of isolated complex modes (solutions of the equations).

        An equation of degree m in cos and sin of an angle has the degree 2 m in tan(angle /
        2). By Bezout's theorem for products of projective lines, the bound is the permanent
        of these degrees. The bound includes solutions at infinity.
        """
        return permanent(2 * self.degrees[:, : self.unknown_count])

    @cached_property
    def equation_systems(self) -> list[tuple[list[int], list[int]]]:
        """The smallest systems of equations that can be solved one after the other.

        Solving them separately is faster than solving all equations at once. Each system
        lists the indices of its equations, and the indices of as many unknowns. All further
        unknowns in these equations follow from earlier systems.
        """
        # (equations, unknowns) whether an equation contains an unknown, that is, whether
        # its degree in this unknown is above 0. Unknowns that have a system are removed
        # below.
        has_unknown = self.degrees[:, : self.unknown_count] > 0
        # Indices of the equations that have no system yet.
        open_equations = list(range(len(has_unknown)))
        systems = []
        while open_equations:
            equations, unknowns = _find_smallest_system(has_unknown, open_equations)
            systems.append((equations, unknowns))
            # Later systems take these unknowns as given.
            has_unknown[:, unknowns] = False
            open_equations = [row for row in open_equations if row not in equations]
        return systems


def _find_smallest_system(
    has_unknown: Bools, open_equations: Sequence[int]
) -> tuple[list[int], list[int]]:
    """Return the smallest set of equations that contains as many unknowns as equations.

    Such a set can be solved without further equations.

    Parameters
    ----------
    has_unknown
        (equations, unknowns) whether an equation contains an unknown that is not yet
        solved.
    open_equations
        Indices of the equations that are not in a system yet. Together they contain as many
        unsolved unknowns as there are equations.

    Returns
    -------
    The indices of the equations, and of the unknowns that the equations contain.
    """
    for size in range(1, len(open_equations) + 1):
        for equations in combinations(open_equations, size):
            is_contained = np.any(has_unknown[list(equations)], axis=0)
            unknowns = np.flatnonzero(is_contained).tolist()
            if len(unknowns) == size:
                return list(equations), unknowns
    raise AssertionError("there are not as many unknowns as equations")


def _place_on_two_axes(
    placements: Mapping[int, LinkPlacement], step: PlacementStep
) -> LinkPlacement:
    """Return the degrees of the orientation of a link that is put on two axes U and W.

    The orientation is a polynomial in the cosines and sines of the variables, with one
    degree for each variable. The degrees limit the number of solutions of the equations.

    U and W are the axes of two pairs (joints) in links placed before, the parents. The
    orientation of the link is U a^T + W b^T + (U x W) n^T, with constant vectors a, b and
    n. Degrees of products add up. So U x W has the degrees of U plus the degrees of W, and
    no other term has more.

    Parameters
    ----------
    placements
        By link index, for the links that are placed before: the reference (link relative to
        which the orientation is stated), and the degrees of the orientation.
    step
        The step that puts the link on two axes.
    """
    # The paths lead from the parents to a common link, in which U and W are expressed. An
    # axis is a constant vector, multiplied by the orientations of the links on its path. So
    # the degrees of these links add up.
    paths = _find_parent_paths(placements, *step.parents)
    reference = paths.shared_link
    no_degrees = np.zeros_like(placements[reference].degrees)
    degrees_of_U = sum((placements[link].degrees for link in paths.first), no_degrees)
    degrees_of_W = sum((placements[link].degrees for link in paths.second), no_degrees)
    return LinkPlacement(reference=reference, degrees=degrees_of_U + degrees_of_W)


def _find_parent_paths(
    placements: Mapping[int, LinkPlacement], first_parent: int, second_parent: int
) -> ParentPaths:
    """Return the paths of two links to the first link that both paths have in common.

    The callers express an axis of each of the two links in the coordinates of this shared
    link. For this, they multiply the axis by the orientations of the links on its path.

    A path leads from a link to its reference (the link relative to which it is oriented),
    then to the reference of that, and so on to the root. The root is its own reference. The
    returned paths end before the shared link. A path is empty if its link is itself the
    shared link.

    Parameters
    ----------
    placements
        By link index: the reference link.
    first_parent, second_parent
        Indices of the two links, which are joined to a third one by one pair each.
    """
    paths_to_root = []
    for parent in (first_parent, second_parent):
        path = [parent]
        reference = placements[parent].reference
        while reference != path[-1]:
            path.append(reference)
            reference = placements[reference].reference
        paths_to_root.append(path)
    first_path, second_path = paths_to_root
    shared_link = next(link for link in first_path if link in second_path)
    return ParentPaths(
        shared_link=shared_link,
        first=first_path[: first_path.index(shared_link)],
        second=second_path[: second_path.index(shared_link)],
    )


def permanent(matrix: Indices) -> int:
    """Return the permanent of a square matrix.

    The permanent is the sum, over all permutations, of the products of one entry from each
    row and column. The callers use it for Bezout's bound of the number of solutions of
    polynomial equations. Entry (i, k) is then the degree of equation i in unknown k, and
    the permanent is the bound.

    The rows are taken one by one. The entries of the rows so far come from different
    columns. For each possible set of these columns, the sum of the products is stored.
    """
    # Sums of products by the set of used columns. Bit k is 1 if column k is in the set.
    sums = {0: 1}
    for row in matrix.tolist():
        extended_sums: dict[int, int] = defaultdict(int)
        for used_columns, sum_of_products in sums.items():
            for column, entry in enumerate(row):
                is_used = used_columns >> column & 1
                if entry and not is_used:
                    extended_sums[used_columns | 1 << column] += sum_of_products * entry
        sums = extended_sums
    all_columns = (1 << len(matrix)) - 1
    return sums.get(all_columns, 0)


def find_construction(
    structure: Structure, preferred_pairs: Collection[int] = ()
) -> Construction:
    """Return the best order of placing the links for a proof, with its equations.

    A link that one pair (joint) joins to links placed before rotates by the angle of this
    pair, which is a variable. If two pairs join a link to links placed before, both axes
    are known. This gives an equation: the arc between the axes equals the arc of the link.

    The best order has the most preferred pairs as variables. Among such orders, it has the
    lowest bound of the number of complex solutions (`mode_bound`).

    Parameters
    ----------
    structure
        The links and pairs. Its followers are the pairs with angles that follow from the
        inputs through toothed wheels.
    preferred_pairs
        Indices of pairs with angles that should become variables where the structure allows
        it.

    Raises
    ------
    PlanError
        If there is no order, or no closed loop.
    """
    construction = _find_best_construction(
        PairGraph.from_structure(structure), preferred_pairs=frozenset(preferred_pairs)
    )
    if construction is None:
        raise PlanError(
            f"{structure.name}: the links cannot be placed one after another, each on one "
            "or two axes of links placed before; proofs need a mechanism whose mobility "
            "by counting is the number of inputs"
        )
    if not construction.unknown_count and not construction.follower_pairs:
        raise PlanError(
            f"{structure.name}: the mechanism has no closed loop, so all angles are inputs "
            "and there is nothing to prove"
        )
    return construction


@dataclass(frozen=True)
class PairGraph:
    """Which links the pairs (joints) join, and which pairs have given angles.

    Names and sizes are left out. So the best order of placing the links is computed once
    for all mechanisms with equal graphs.

    Attributes
    ----------
    ends
        For each pair the two links that it joins.
    link_count, input_count
        Numbers of links and of inputs.
    given_pairs
        Indices of the pairs with given angles: the inputs, then the followers, which inputs
        drive through toothed wheels. All other angles are unknown.
    """

    ends: tuple[tuple[int, int], ...]
    link_count: int
    input_count: int
    given_pairs: tuple[int, ...]

    @staticmethod
    def from_structure(structure: Structure) -> "PairGraph":
        """Return the graph of a structure."""
        return PairGraph(
            ends=structure.ends,
            link_count=len(structure.links),
            input_count=len(structure.inputs),
            given_pairs=(*structure.inputs, *structure.followers),
        )

    def find_bodies(self) -> list[int]:
        """Return, for each link, the index of the first link of its rigid body.

        A body is a set of links joined by pairs with known angles (inputs and wheels). It
        is rigid at given inputs.
        """
        given_ends = (self.ends[pair] for pair in self.given_pairs)
        return component_labels(self.link_count, given_ends)

    def find_joined_bodies(self, body_of_link: list[int]) -> dict[int, tuple[int, int]]:
        """Return the two bodies that each pair with an unknown angle joins, by pair index.

        A body is a rigid set of links. Its index is the index of its first link.
        `body_of_link` has the body of each link (`find_bodies`).
        """
        return {
            pair: (body_of_link[first], body_of_link[second])
            for pair, (first, second) in enumerate(self.ends)
            if pair not in self.given_pairs
        }


@dataclass(frozen=True)
class BodyPlacement:
    """A body (rigid set of links at given inputs), and the pairs by which it is placed.

    Attributes
    ----------
    body
        Index of the body.
    pairs
        The one or two pairs that join it to bodies placed before; none for the root.
    """

    body: int
    pairs: tuple[int, ...]


PlacingOrder = tuple[BodyPlacement, ...]
"""The bodies other than the root, in the order in which they are placed."""


@lru_cache(MAX_CACHED_STRUCTURES)
def _find_best_construction(
    graph: PairGraph, preferred_pairs: frozenset[int]
) -> Construction | None:
    """Return the best order of placing the links for a proof, or None if there is none.

    A proof finds all solutions of equations for some of the pair (joint) angles. The order
    of placing the links decides which angles are these variables, and which equations hold
    for them. A construction is an order with its variables and equations. The best one has

    1. the angles of most preferred pairs as variables,
    2. among equal candidates, the lowest bound of the number of isolated complex solutions
       (`mode_bound`),
    3. among equal candidates, the smallest sum of the degrees of the equations.

    Parameters
    ----------
    graph
        The links and pairs. It also states which angles are given: those of the inputs and
        of the wheels that follow them.
    preferred_pairs
        Pairs whose angles should be variables if possible, for example those of outputs.
    """
    # The fewer preferred pairs are missing among the variables, the better.
    return min(
        _find_constructions(graph),
        key=lambda construction: (
            len(preferred_pairs - {*construction.pairs}),
            construction.mode_bound,
            np.sum(construction.degrees),
        ),
        default=None,
    )


def has_construction(structure: Structure) -> bool:
    """Return whether `find_construction` finds an order of placing the links.

    Without such an order, proofs do not apply to the mechanism.
    """
    constructions = _find_constructions(PairGraph.from_structure(structure))
    first = next(constructions, None)
    return first is not None and bool(first.unknown_count or first.follower_pairs)


def _find_constructions(graph: PairGraph) -> Iterator[Construction]:
    """Yield orders of placing the links for a proof, with their variables and equations.

    Links that are joined by pairs (joints) with given angles form a rigid body. Bodies are
    placed one by one, and in each body its links. Orders with unsolvable equations are left
    out. At most `MAX_COMPARED_ORDERS` orders are tried. `find_construction` chooses the
    best of them.
    """
    body_of_link = graph.find_bodies()
    joined_bodies = graph.find_joined_bodies(body_of_link)
    # A pair with an unknown angle inside one rigid body would be locked: there is no order.
    if any(first == second for first, second in joined_bodies.values()):
        return
    # Any body can be placed first (root). The body of the first input is tried first.
    first_input = graph.given_pairs[0]
    first_link_of_input, _ = graph.ends[first_input]
    input_body = body_of_link[first_link_of_input]
    roots = sorted(set(body_of_link), key=lambda body: body != input_body)
    orders = (
        (root, order)
        for root in roots
        for order in placing_orders(joined_bodies, frozenset(body_of_link), root)
    )
    for root, order in islice(orders, MAX_COMPARED_ORDERS):
        construction = _make_construction(graph, body_of_link, root, order)
        if construction is None:
            continue
        # The bound of the number of solutions is 0 if some equations contain fewer unknowns
        # than there are equations. Such equations cannot be solved.
        can_be_solved = construction.mode_bound > 0
        if can_be_solved:
            yield construction


def placing_orders(
    joined_bodies: Mapping[int, tuple[int, int]], bodies: frozenset[int], root: int
) -> Iterator[PlacingOrder]:
    """Yield all orders in which one or two pairs join each body to bodies before it.

    Proofs place rigid bodies in such an order. The search runs backwards: it removes one
    body after another, each joined to the rest by one or two pairs. At last only the root
    remains. Placing is the reverse. Example: bodies 0, 1, 2, 3 in a ring with the root 0.
    They can be removed in the sequence 2 (joined to 1 and 3), 1 (joined to 0), 3 (joined to
    0).

    Orders that place every body by the same pairs are equivalent, for example with 3
    removed before 1. Only one of them is yielded.

    Parameters
    ----------
    joined_bodies
        For each pair the two bodies that it joins.
    bodies
        All bodies.
    root
        The body that is placed first.
    """
    # Sets of removed bodies, with their pairs, at which the search has been.
    reached_placements: set[frozenset[BodyPlacement]] = set()

    def remove_bodies(
        remaining: frozenset[int], order: PlacingOrder
    ) -> Iterator[PlacingOrder]:
        """Yield the placing orders that end with the sequence `order`.

        The search removes bodies one after another; placing is the reverse. A body can be
        removed if one or two pairs join it to the other remaining bodies. It can then be
        placed after these.

        Parameters
        ----------
        remaining
            The bodies that are still to be removed, and the root, which is never removed.
        order
            The bodies removed so far, with their pairs, in the order of placing: the body
            that was removed last comes first.
        """
        # The same bodies may have been removed by the same pairs in another sequence. Such
        # orders count as equal, so the search does not go on from here.
        placements = frozenset(order)
        if placements in reached_placements:
            return
        reached_placements.add(placements)
        # The root is the body that is placed first, without any pair.
        if remaining == {root}:
            yield order
            return
        for placement in _list_removable_bodies(joined_bodies, remaining, root):
            yield from remove_bodies(remaining - {placement.body}, (placement, *order))

    yield from remove_bodies(bodies, ())


def _list_removable_bodies(
    joined_bodies: Mapping[int, tuple[int, int]], remaining: frozenset[int], root: int
) -> list[BodyPlacement]:
    """Return the bodies that one or two pairs join to the other remaining bodies.

    Such a body can be placed after all other bodies: by rotation about one pair axis, or by
    putting it on two axes. Three axes would be too many.

    Parameters
    ----------
    joined_bodies
        For each pair the two bodies that it joins.
    remaining
        The bodies that are not removed yet.
    root
        The body that is placed first, which is never removed.
    """
    removable_bodies = []
    for body in sorted(remaining - {root}):
        pairs_to_remaining_bodies = tuple(
            pair
            for pair, two_bodies in joined_bodies.items()
            if body in two_bodies and remaining.issuperset(two_bodies)
        )
        if 1 <= len(pairs_to_remaining_bodies) <= 2:
            removable_bodies.append(BodyPlacement(body, pairs_to_remaining_bodies))
    return removable_bodies


def _make_construction(
    graph: PairGraph, body_of_link: list[int], root: int, order: PlacingOrder
) -> Construction | None:
    """Return the steps and variables that place bodies in an order, None if impossible.

    A body is a group of links that are joined by pairs with given angles, so it is rigid.
    If one pair joins a body to bodies that are placed already, the body rotates by the
    unknown angle of this pair. If two pairs do, the body is put on both axes. The angle
    between the axes must then be that on the body, which is one equation. The order is
    refused in three cases:

    - The two pairs by which a body is placed are on different links of the body. The steps
      of a construction cannot express this.
    - The two pairs join the body to the same link.
    - The number of equations differs from the number of unknowns.

    Parameters
    ----------
    graph
        The links and pairs, and which angles are given.
    body_of_link
        For each link the body to which it belongs.
    root
        The body that is placed first; the index of a body is the index of its first link.
    order
        The other bodies in order, with the pairs by which they are placed.
    """
    unknown_pairs = [placement.pairs[0] for placement in order if len(placement.pairs) == 1]
    # The position of a pair in this tuple is the index of the variable of the pair.
    variable_pairs = (*unknown_pairs, *graph.given_pairs)
    steps: list[PlacementStep] = []
    for placement in (BodyPlacement(root, ()), *order):
        body = placement.body
        joining_pairs = placement.pairs
        # For each pair: its link on this body, and its link on a body placed before (the
        # parent).
        links = [
            next(link for link in graph.ends[pair] if body_of_link[link] == body)
            for pair in joining_pairs
        ]
        # The sum of both end indices less the first index is the second index.
        parents = tuple(
            sum(graph.ends[pair]) - link
            for pair, link in zip(joining_pairs, links, strict=True)
        )
        if len(set(links)) > 1 or len(set(parents)) < len(joining_pairs):
            return None
        if joining_pairs:
            has_one_pair = len(joining_pairs) == 1
            variable = variable_pairs.index(joining_pairs[0]) if has_one_pair else -1
            steps.append(
                PlacementStep(
                    link=links[0],
                    parents=parents,
                    pairs=joining_pairs,
                    variable=variable,
                )
            )
        # The other links of the body follow across pairs with given angles. They start from
        # the link that is placed already, which is the root if there are no pairs.
        placed_links = links[:1] or [root]
        for pair, parent, link in find_spanning_tree(
            graph.ends, placed_links, graph.given_pairs
        ):
            steps.append(
                PlacementStep(
                    link=link,
                    parents=(parent,),
                    pairs=(pair,),
                    variable=variable_pairs.index(pair),
                )
            )
    equation_count = sum(step.has_two_parents for step in steps)
    if equation_count != len(unknown_pairs):
        return None
    return Construction(
        root=root,
        steps=steps,
        pairs=variable_pairs,
        unknown_count=len(unknown_pairs),
        input_count=graph.input_count,
    )


def share_input_variable(
    decimal_mechanism: DecimalMechanism, construction: Construction
) -> Construction:
    """Return a construction in which input and wheels are multiples of one variable.

    Toothed wheels turn p/q times as fast as the input. Let N be the least number of turns
    of the input after which all wheels have their initial angles again. The shared variable
    makes one turn while the input makes N turns, so the angles of the input and of the
    wheels are whole multiples of it.

    Parameters
    ----------
    decimal_mechanism
        A mechanism with one input and with followers.
    construction
        A construction in which each follower, a pair with an angle that follows from the
        inputs through wheels, is a separate variable.

    Raises
    ------
    PlanError
        If the ratios of the wheels are not ratios of numbers of teeth, or if the wheels
        have their initial angles again only after more than `MAX_CYCLE_TURNS` turns.
    """
    structure = decimal_mechanism.structure
    wheel_names = listing(structure.names_of(construction.follower_pairs))
    ratios = decimal_mechanism.exact_follower_ratios()
    if ratios is None:
        raise PlanError(
            f"{structure.name}: the input drives {wheel_names} through wheels; proofs over "
            "ranges need ratios of numbers of teeth, so that all wheels come back after "
            "whole turns: give teeth, or give values of the inputs with --at"
        )
    # N of the docstring is the least common multiple of all denominators q.
    cycle_turns = lcm(*(ratio.denominator for ratio in ratios))
    # By pair: its angle over the shared variable.
    factors = {
        pair: int(cycle_turns * ratio)
        for pair, ratio in zip(structure.followers, ratios, strict=True)
    }
    most_turns = max(cycle_turns, *map(abs, factors.values()))
    if most_turns > MAX_CYCLE_TURNS:
        raise PlanError(
            f"{structure.name}: the input drives {wheel_names} through wheels, and up to "
            f"{most_turns} turns pass until all of them are back at the start; proofs over "
            f"ranges allow at most {MAX_CYCLE_TURNS}: give values of the inputs with --at"
        )
    (input_pair,) = construction.input_pairs
    factors[input_pair] = cycle_turns
    variable = construction.unknown_count
    # Links that rotate by the angle of the input or of a wheel get the shared variable.
    steps = []
    for step in construction.steps:
        if step.pairs[0] in factors and not step.has_two_parents:
            factor = factors[step.pairs[0]]
            steps.append(replace(step, variable=variable, angle_factor=factor))
        else:
            steps.append(step)
    return replace(
        construction,
        steps=steps,
        # The unknowns and the input remain; the variables of the wheels are dropped.
        pairs=construction.pairs[: variable + 1],
        cycle_turns=cycle_turns,
    )
