"""Degrees of freedom counted on the graph of links and pairs: rigid and moving parts.

A link has 3 degrees of freedom on the sphere. A pair removes 2 (R, Cr) or 1 (Cs). The count
is made for every part of the graph at once by the pebble game for (3, 3)-sparse graphs
(Jacobs and Hendrickson 1997; Lee and Streinu 2008).
"""

from collections.abc import Iterable, Sequence

from spherekit.errors import CountError, PlanError
from spherekit.mechanism.graph import component_labels, connected_components
from spherekit.mechanism.mechanism import Mechanism
from spherekit.wording import counted, listing

BODY_FREEDOMS = 3
"""Degrees of freedom of a free body on the sphere."""

DYAD_BODIES = 3
"""Number of bodies of a dyad, the smallest group: one that is placed, and two links."""


def merge_locked_links(mechanism: Mechanism, locked: Iterable[int]) -> tuple[int, ...]:
    """Return, for each link, the number of its body, if some pairs (joints) are locked.

    A body consists of all links that locked pairs join to each other. They do not move
    relative to each other, so the caller treats them as one link. The number of a body is
    the smallest index of its links.

    Parameters
    ----------
    mechanism
        The mechanism.
    locked
        Indices of the locked pairs.
    """
    locked_ends = (mechanism.ends[pair] for pair in locked)
    return tuple(component_labels(len(mechanism.links), locked_ends))


class PebbleGame:
    """The pebble game, which counts the degrees of freedom of all parts of a graph.

    Each body owns three pebbles, one for each degree of freedom on the sphere. A new
    independent constraint takes a free pebble of one of its two bodies and points from this
    body to the other one. If a constraint takes a pebble of its other body instead, its
    direction is reversed and the first pebble becomes free. A part of the graph is rigid if
    no more than three pebbles can be freed on its bodies.

    Attributes
    ----------
    free_pebbles
        Number of free pebbles of each body.
    constraint_targets
        For each body the bodies to which its constraints point; each of these constraints
        has one of the body's pebbles.
    """

    def __init__(self, body_count: int) -> None:
        """Begin with bodies that no constraint joins, so that all pebbles are free."""
        self.free_pebbles = [BODY_FREEDOMS] * body_count
        self.constraint_targets: list[list[int]] = [[] for _ in range(body_count)]

    def gather_pebbles(self, body: int, count: int, keep: Sequence[int] = ()) -> int:
        """Move free pebbles to a body until it has enough of them, if possible.

        Pebbles count degrees of freedom. Each body has three, and each constraint takes one
        of them. The others are free, and can be moved from body to body along constraints.

        Parameters
        ----------
        body
            The body that receives the pebbles.
        count
            Number of free pebbles that it should have.
        keep
            Bodies whose free pebbles must stay where they are.

        Returns
        -------
        The number of free pebbles that the body has in the end.
        """
        while self.free_pebbles[body] < count:
            if not self._fetch_pebble(body, visited={body, *keep}):
                break
        return self.free_pebbles[body]

    def _fetch_pebble(self, body: int, visited: set[int]) -> bool:
        """Move one free pebble to a body, and return whether this is possible.

        The caller tests by free pebbles whether a new constraint is independent. Each body
        has three pebbles, one for each degree of freedom. Each constraint has taken a
        pebble of one of its two bodies. The constraint points from this body to the other
        one, its target. It can take a free pebble of its target instead. The pebble of the
        first body then becomes free, and the constraint points in the opposite direction.
        If the target has no free pebble, one is moved to the target in the same way first.

        Parameters
        ----------
        body
            The body.
        visited
            Bodies that have been tried and are not tried again. The set is changed in
            place.
        """
        # The bodies from `body` to the one that is examined. A constraint leads from each
        # to the next. A recursive function would be too deep for mechanisms of many links.
        path = [body]
        while path:
            targets = self.constraint_targets[path[-1]]
            target = next((target for target in targets if target not in visited), None)
            if target is None:
                path.pop()
                continue
            visited.add(target)
            path.append(target)
            if self.free_pebbles[target]:
                for giver_index in range(len(path) - 1, 0, -1):
                    self._exchange_pebble(path[giver_index - 1], path[giver_index])
                return True
        return False

    def _exchange_pebble(self, body: int, target: int) -> None:
        """Free a pebble of a body by letting a constraint take a pebble of another body.

        Pebbles are degrees of freedom; each constraint uses up one pebble of one of its two
        bodies. The constraint from `body` to `target` now uses a pebble of the target, and
        points from the target to the body.
        """
        self.free_pebbles[target] -= 1
        self.free_pebbles[body] += 1
        self.constraint_targets[body].remove(target)
        self.constraint_targets[target].append(body)

    def add_constraint(self, body_a: int, body_b: int) -> bool:
        """Add one constraint between two bodies; return False if it is redundant.

        Pebbles count degrees of freedom. Each body has three. An independent constraint
        takes a pebble of one of its two bodies, and points to the other one. A constraint
        can exchange this pebble for a free pebble of the other body. In this way free
        pebbles move from body to body.

        The new constraint is independent if four free pebbles can be moved to its two
        bodies: three for the motion of both as a whole, and one for a relative motion,
        which the constraint removes.
        """
        if self.gather_pebbles(body_a, BODY_FREEDOMS) < BODY_FREEDOMS:
            return False
        if not self.gather_pebbles(body_b, 1, keep=[body_a]):
            return False
        # Both bodies have free pebbles, so either could give one. Body a does.
        self.free_pebbles[body_a] -= 1
        self.constraint_targets[body_a].append(body_b)
        return True

    def add_pair(self, body_a: int, body_b: int, constraint_count: int) -> bool:
        """Add the constraints of a pair (joint); return False if one of them is redundant.

        After a redundant constraint, the remaining ones are not added. A pair within one
        body is redundant.
        """
        if body_a == body_b:
            return False
        return all(self.add_constraint(body_a, body_b) for _ in range(constraint_count))

    def reachable_bodies(self, bodies: Iterable[int]) -> set[int]:
        """Return some bodies, and all bodies to which constraints lead from them."""
        reached = set[int]()
        stack = list(bodies)
        while stack:
            body = stack.pop()
            if body not in reached:
                reached.add(body)
                stack += self.constraint_targets[body]
        return reached

    def find_rigid_part(self, body_a: int, body_b: int) -> set[int] | None:
        """Return the smallest rigid set of bodies that contains two bodies, or None.

        A pebble is a degree of freedom of a body that no constraint has used up. Pebbles
        can be moved to other bodies along the constraints. Two bodies that are rigid with
        each other have three pebbles in all. If a fourth pebble can be moved to them, they
        can move relative to each other, and the result is None.
        """
        self.gather_pebbles(body_a, BODY_FREEDOMS)
        if self.gather_pebbles(body_b, 1, keep=[body_a]):
            return None
        return self.reachable_bodies([body_a, body_b])

    def find_mobile_part(self, body_a: int, body_b: int) -> set[int]:
        """Return the smallest set with one degree of freedom that contains two bodies.

        The whole mechanism must have one degree of freedom as well, and no rigid part may
        contain both bodies.

        A pebble is a degree of freedom of a body that no constraint has used up. Four
        pebbles are free: three for the motion of the mechanism as a whole, and one for the
        relative motion. These pebbles are moved to the two bodies. The set consists of all
        bodies that constraints reach from these two.
        """
        rigid_part = self.find_rigid_part(body_a, body_b)
        assert rigid_part is None, "rigid parts are merged before"
        return self.reachable_bodies([body_a, body_b])

    def merge_bodies(self, part: set[int], into: int) -> None:
        """Replace a rigid part by one of its bodies, so that it counts as one body.

        Pebbles count degrees of freedom. Each body has three. A constraint takes a pebble
        of one of its bodies, and points from this body to the other. A constraint can give
        this pebble back if it takes a free pebble of the other body instead. The constraint
        then points the other way.

        Constraints within the part are removed. Constraints from outside that point to the
        part now point to the remaining body, which has three free pebbles.

        Parameters
        ----------
        part
            Indices of the bodies of the part.
        into
            The body that remains.
        """
        # A rigid part has three pebbles that its inner constraints have not taken. They are
        # freed and gathered on the remaining body. A constraint that points from the part
        # to a body outside has taken one of these three pebbles. It gives the pebble back,
        # takes one outside instead, and then points to the part. So afterwards only inner
        # constraints start from bodies of the part, and these can be removed.
        self.gather_pebbles(into, BODY_FREEDOMS)
        for body in range(len(self.constraint_targets)):
            if body in part:
                self.constraint_targets[body] = []
                self.free_pebbles[body] = 0
            else:
                self._redirect_constraints(body, part, into)
        self.free_pebbles[into] = BODY_FREEDOMS

    def _redirect_constraints(self, body: int, part: set[int], into: int) -> None:
        """Let constraints from a body to any body of a part point to `into` instead."""
        self.constraint_targets[body] = [
            into if target in part else target for target in self.constraint_targets[body]
        ]


def graph_mobility(mechanism: Mechanism) -> int:
    """Return the number of degrees of freedom, 3 (m - 1) - 2 n_R - 2 n_Cr - n_Cs.

    The degrees of freedom are counted only from the graph: each link has three degrees of
    freedom on the sphere, and each pair (joint) removes one or two. m, n_R, n_Cr and n_Cs
    are the numbers of links, revolute joints, rolling contacts and sliding contacts.
    """
    constraint_count = sum(pair.constraints for pair in mechanism.pairs)
    return BODY_FREEDOMS * (len(mechanism.links) - 1) - constraint_count


def check_mobility(
    mechanism: Mechanism,
    driven: Sequence[int],
    locked: Sequence[int] = (),
    by_rank: bool = False,
) -> tuple[tuple[int, ...], PebbleGame | None]:
    """Check by counting that a mechanism is connected and has one freedom for each input.

    Parameters
    ----------
    mechanism
        Any chain of R, Cr and Cs pairs.
    driven
        Indices of all driven pairs.
    locked
        Indices of the driven pairs that are locked. Each part of the mechanism that only
        the locked inputs could move becomes one body, if the count decides about it.
    by_rank
        Whether the rank of the velocity equations at a configuration is known to leave
        enough degrees of freedom, although the count does not.

    Returns
    -------
    body_of_link
        For each link the smallest link of its rigid body while the locked inputs stand
        still. If the count does not decide about the mobility, only the links that locked
        pairs join are one body.
    pebble_game
        The pebble game on these bodies, for questions about parts of the chain. None if the
        count does not decide.

    Raises
    ------
    PlanError
        If the graph is not connected. The message names the loose links.
    CountError
        If a part is rigid or over-constrained, the mobility is not the number of inputs, or
        the inputs are not independent.

    Notes
    -----
    Constraints may be redundant, so the count does not decide in two cases. First, it may
    leave too few degrees of freedom while the rank leaves enough. Second, there may be
    rolling pairs, such as bevel gears with axes on one carrier. If the count leaves too
    many degrees of freedom, the rank does so as well.
    """
    _check_connected(mechanism)
    mobility = graph_mobility(mechanism)
    try:
        pebble_game = _play_on_links(mechanism)
        if mobility != len(driven):
            raise CountError(
                f"{mechanism.name}: the {counted(len(mechanism.links), 'link')} and "
                f"{counted(len(mechanism.pairs), 'pair')} have mobility "
                "3(m - 1) - 2 n_R - 2 n_Cr - n_Cs = "
                f"{mobility}, but the number of inputs is {len(driven)} "
                f"({listing(mechanism.names_of(driven))}); {inputs_to_declare(mobility)}"
            )
    except CountError:
        # Constraints may be redundant, so that the count does not decide.
        has_rolling_pair = any(pair.rolls for pair in mechanism.pairs)
        if (by_rank or has_rolling_pair) and mobility <= len(driven):
            return merge_locked_links(mechanism, locked), None
        raise
    if locked:
        return _play_with_locked_inputs(mechanism, driven, locked)
    return tuple(range(len(mechanism.links))), pebble_game


def _check_connected(mechanism: Mechanism) -> None:
    """Raise a `PlanError` if pairs do not join all links to the ground."""
    parts = connected_components(len(mechanism.links), mechanism.ends)
    if len(parts) > 1:
        names = mechanism.links
        loose = "; ".join(", ".join(names[k] for k in part) for part in parts[1:])
        raise PlanError(
            f"{mechanism.name}: the graph is not connected: no pairs connect the ground "
            f"with links [{loose}]; add the missing pairs or remove these links"
        )


def inputs_to_declare(mobility: int) -> str:
    """Return the advice of an error message for a mechanism of this mobility."""
    if mobility < 1:
        return "remove constraints: add links, or remove pairs"
    inputs = "one R pair as the input" if mobility == 1 else f"{mobility} R pairs as inputs"
    return f"declare {inputs}, or add or remove pairs"


def _play_on_links(mechanism: Mechanism) -> PebbleGame:
    """Count the degrees of freedom of all links and pairs, and return the finished count.

    The count is done by an algorithm named pebble game. Each link begins with three degrees
    of freedom (pebbles). Each constraint of a pair removes one of them unless it is
    redundant.

    Raises
    ------
    CountError
        If a constraint is redundant, or two links joined by a pair cannot move relative to
        each other.
    """
    names = mechanism.links
    pebble_game = PebbleGame(len(names))
    for pair, (link_a, link_b) in zip(mechanism.pairs, mechanism.ends, strict=True):
        if not pebble_game.add_pair(link_a, link_b, pair.constraints):
            rigid_links = sorted(pebble_game.reachable_bodies([link_a, link_b]))
            raise CountError(
                f"{mechanism.name}: over-constrained: links "
                f"[{', '.join(names[k] for k in rigid_links)}] cannot move relative to "
                f'each other, even if pair "{pair.name}" had fewer constraints; remove a '
                "pair or add a link"
            )
    # The links of every pair must be able to move relative to each other.
    for pair, (link_a, link_b) in zip(mechanism.pairs, mechanism.ends, strict=True):
        rigid_part = pebble_game.find_rigid_part(link_a, link_b)
        if rigid_part is not None:
            raise CountError(
                f"{mechanism.name}: rigid: links "
                f"[{', '.join(names[k] for k in sorted(rigid_part))}] cannot move relative "
                f'to each other, so that pair "{pair.name}" cannot move; remove a pair or '
                "merge these links into one"
            )
    return pebble_game


def play_on_bodies(
    mechanism: Mechanism,
    body_of_link: Sequence[int],
    pairs: Iterable[int],
    carried_contacts: frozenset[int] = frozenset(),
) -> tuple[PebbleGame, bool]:
    """Count the degrees of freedom of bodies (rigidly joined links) with some pairs.

    The pebble game is the algorithm of this count. Each body begins with three degrees of
    freedom (pebbles). Each constraint of a pair removes one of them unless it is redundant.

    Parameters
    ----------
    mechanism
        The mechanism.
    body_of_link
        For each link the number of its body: the smallest index of a link in the body.
    pairs
        Indices of the pairs whose constraints are added.
    carried_contacts
        Indices of rolling contacts of two wheels with a common carrier. The carrier keeps
        the distance of the wheels, so the contact has one further constraint and not two.

    Returns
    -------
    pebble_game
        The game with all independent constraints.
    is_independent
        Whether no constraint was redundant.
    """
    # The game has as many bodies as there are links. A link index that is not the number of
    # a body is a body without constraints, which does not affect the others.
    pebble_game = PebbleGame(len(body_of_link))
    is_independent = True
    for number in pairs:
        pair = mechanism.pairs[number]
        constraint_count = 1 if number in carried_contacts else pair.constraints
        link_a, link_b = mechanism.ends[number]
        body_a = body_of_link[link_a]
        body_b = body_of_link[link_b]
        is_independent &= pebble_game.add_pair(body_a, body_b, constraint_count)
    return pebble_game, is_independent


def _play_with_locked_inputs(
    mechanism: Mechanism, driven: Sequence[int], locked: Sequence[int]
) -> tuple[tuple[int, ...], PebbleGame]:
    """Merge the links that cannot move relative to each other while inputs are locked.

    A body is a set of links that are rigid with each other. First, locked pairs (joints)
    join links to bodies. The pebble game (`PebbleGame`) counts degrees of freedom of any
    set of bodies, only from the graph. It finds further sets of bodies that are rigid. Each
    of these sets becomes one body.

    Parameters
    ----------
    mechanism
        The mechanism.
    driven, locked
        Indices of all driven pairs, and indices of the driven pairs that are locked.

    Returns
    -------
    body_of_link
        For each link the smallest link of its rigid body while the locked inputs stand
        still.
    pebble_game
        The game on these bodies, which counts the degrees of freedom of any set of them.

    Raises
    ------
    CountError
        If an input that is not locked cannot move.
    """
    body_of_link = merge_locked_links(mechanism, locked)
    open_pairs = [k for k in range(len(mechanism.pairs)) if k not in locked]
    # If a constraint of the open pairs is redundant, the locked inputs are not independent.
    pebble_game, is_independent = play_on_bodies(mechanism, body_of_link, open_pairs)
    # Merge each rigid set of bodies to the one with the smallest number.
    for number in open_pairs:
        link_a, link_b = mechanism.ends[number]
        rigid_bodies = pebble_game.find_rigid_part(
            body_of_link[link_a], body_of_link[link_b]
        )
        if rigid_bodies is not None:
            merged_body = min(rigid_bodies)
            pebble_game.merge_bodies(rigid_bodies, merged_body)
            body_of_link = tuple(
                merged_body if body in rigid_bodies else body for body in body_of_link
            )

    # An input that is not locked is stuck if both its links are in one body.
    moving_inputs = [pair for pair in driven if pair not in locked]
    is_stuck = False
    for pair in moving_inputs:
        link_a, link_b = mechanism.ends[pair]
        is_stuck |= body_of_link[link_a] == body_of_link[link_b]
    if not is_independent or is_stuck:
        raise CountError(
            f"{mechanism.name}: the inputs {listing(mechanism.names_of(driven))} are not "
            f"independent: with {listing(mechanism.names_of(locked))} locked, "
            f"{listing(mechanism.names_of(moving_inputs))} cannot move; choose other "
            "inputs"
        )
    return body_of_link, pebble_game
