"""The sequence in which all pole axes of a mechanism follow from the known ones.

1. The poles of pairs (R, Cr) are primary: they are known from the start.
2. Passes of the Aronhold-Kennedy theorem (Di Gregorio 2011) find secondary poles. P_ij
   lies on the great circle through P_ik and P_jk for every third link k, and on the contact
   plane of a sliding pair of i and j. Two such lines give the pole. All poles of a pass
   follow from poles of earlier passes. Links that share an axis by construction have it as
   their pole.
3. If a pass finds nothing, the smallest part with one degree of freedom that contains an
   unknown pole is solved from its velocity equations, which give all its poles. Then the
   passes continue.

One pole of a part solved in step 3 would be enough for passes to find the others, in every
known chain of up to twelve links. The plan states this order
(`BlockPoles.steps_from_opening`). The numbers still come from the velocity equations, which
are better conditioned.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import combinations, count, pairwise

from spherekit.mechanism.graph import connected_components
from spherekit.planning.mobility import PebbleGame
from spherekit.planning.pole_plan import (
    BlockPoles,
    LinePole,
    Plan,
    Pole,
    PrimaryPole,
    Step,
    pole_of,
)

MAX_OPENING_WORK = 20_000
"""Largest number of opening poles that are tried for an irreducible part, multiplied by the
square of the number of its unknown poles.

The time of a trial grows with this square. Larger: the pole from which passes find the most
others is more often the best one, and planning of large parts takes longer.
"""


class KnownPoles:
    """The poles that are known so far in the search for all poles.

    A pole is the axis of the relative rotation of two bodies. The search has several
    passes. Each finds poles that follow from those of earlier passes.

    Attributes
    ----------
    partners
        For each body the bodies with which it has a known pole.
    """

    def __init__(self, partners: Iterable[Iterable[int]]) -> None:
        """Begin with known poles: for each body, the bodies with which it has one."""
        self.partners = [set(bodies) for bodies in partners]

    def copy(self) -> "KnownPoles":
        """Return a copy to which poles can be added independently."""
        return KnownPoles(self.partners)

    def add(self, step: Step) -> None:
        """Add the poles that a step gives."""
        poles = step.poles if isinstance(step, BlockPoles) else [step.pole]
        for i, j in poles:
            self.partners[i].add(j)
            self.partners[j].add(i)

    def unknown_of(self, poles: Iterable[Pole]) -> list[Pole]:
        """Return those of some poles that are not known."""
        return [(i, j) for i, j in poles if j not in self.partners[i]]

    def third_bodies(self, pole: Pole) -> set[int]:
        """Return the bodies that have known poles with both bodies of a pole."""
        i, j = pole
        return self.partners[i] & self.partners[j]


def find_all_steps(empty_plan: Plan, pebble_game: PebbleGame | None) -> list[Step]:
    """Return the steps that give all poles of a mechanism.

    A pole is the axis of the relative rotation of two bodies. First come the primary poles:
    the axes of pairs, and the lines from the centre of the sphere to the points of rolling
    contacts. Each pass (round) then adds the poles that lie on two known lines: great
    circles through two known poles, and great circles in contact planes of sliding pairs.
    A contact plane contains the centre of the sphere and the normal of the contact. If a
    pass finds no pole, a part of the mechanism is solved from its velocity equations.

    Parameters
    ----------
    empty_plan
        A plan without steps: the mechanism, the moving input, and the bodies.
    pebble_game
        Counts the degrees of freedom of any set of bodies. None if redundant constraints
        make the count useless.
    """
    steps: list[Step] = []
    # For each body, the bodies with which it has a known pole: none in the beginning.
    known_poles = KnownPoles([] for _ in empty_plan.mechanism.links)
    # The sliding contacts of two bodies, and the primary poles. `ends` has the two bodies
    # of each pair, which are the same if a locked input makes them one body.
    contacts_by_pole: dict[Pole, list[int]] = {}
    for number, (pair, (a, b)) in enumerate(
        zip(empty_plan.mechanism.pairs, empty_plan.ends, strict=True)
    ):
        if a == b:
            continue
        pole = pole_of(a, b)
        # A sliding contact gives no pole, but a plane in which the pole lies. A sliding
        # contact has no `pole_line`.
        if pair.kind.pole_line is None:
            contacts_by_pole.setdefault(pole, []).append(number)
        else:
            primary_pole = PrimaryPole(pole, number)
            steps.append(primary_pole)
            known_poles.add(primary_pole)

    unknown_poles = known_poles.unknown_of(combinations(empty_plan.bodies, 2))
    mobile_parts = MobileParts(empty_plan.bodies, pebble_game)
    pass_number = 0
    while unknown_poles:
        pass_number += 1
        new_steps: list[Step] = []
        for pole in unknown_poles:
            shared_axis_pair = _pair_of_common_axis(empty_plan, pole)
            if shared_axis_pair is not None:
                new_steps.append(PrimaryPole(pole, shared_axis_pair, pass_number))
            else:
                new_steps += _find_line_poles(
                    empty_plan, contacts_by_pole, known_poles, [pole], pass_number
                )
        if not new_steps:
            # The pass finds nothing. Each pole has a part of the mechanism from which it
            # can be computed. The smallest of these parts is solved from its velocity
            # equations, as a block (irreducible part).
            part = min(map(mobile_parts.find_part, unknown_poles), key=len)
            block = _make_block(empty_plan, part, unknown_poles, pass_number)
            # For display, plan in which order the poles of the block would follow.
            if pebble_game is not None:
                block = _choose_opening(empty_plan, contacts_by_pole, known_poles, block)
            new_steps = [block]
            pass_number = block.last_pass_number
        # The poles of a pass count as known only after the pass.
        for step in new_steps:
            known_poles.add(step)
        steps += new_steps
        unknown_poles = known_poles.unknown_of(unknown_poles)
    return steps


def _pair_of_common_axis(empty_plan: Plan, pole: Pole) -> int | None:
    """Return an R pair about the common axis of both bodies of a pole, or None."""
    for bodies, pair in empty_plan.coaxial:
        if bodies.issuperset(pole):
            return pair
    return None


def _find_line_poles(
    empty_plan: Plan,
    contacts_by_pole: dict[Pole, list[int]],
    known_poles: KnownPoles,
    poles: Iterable[Pole],
    pass_number: int,
) -> list[LinePole]:
    """Return a plan step for each unknown pole that lies on two or more known lines.

    A plan is a sequence of steps, each of which constructs poles from those known before.

    A pole P_ij is the axis of the relative rotation of the bodies i and j. It lies on the
    great circle through P_ik and P_jk for every third body k. At a sliding contact of i and
    j, the pole lies on the great circle at right angles to both profiles. Two of these
    lines determine the pole. The step lists all lines, because which two intersect best
    depends on the configuration.

    Parameters
    ----------
    empty_plan
        The mechanism with its bodies and the moving input, as a plan without steps.
    contacts_by_pole
        For each pole, the indices of the sliding pairs that join its two bodies.
    known_poles
        The poles of earlier passes (rounds of the search).
    poles
        The unknown poles that are examined.
    pass_number
        Number of the present pass.
    """
    steps = []
    for pole in poles:
        third_bodies = known_poles.third_bodies(pole)
        contacts = tuple(contacts_by_pole.get(pole, ()))
        # Third bodies that rotate about a common axis (`coaxial`) with body i or j give the
        # same great circle, which then counts once.
        circles = group_by_circle(third_bodies, pole, empty_plan.coaxial)
        if len(circles) + len(contacts) >= 2:
            step = LinePole(
                pole,
                pass_number=pass_number,
                via=tuple(sorted(third_bodies)),
                contacts=contacts,
            )
            steps.append(step)
    return steps


def group_by_circle(
    third_bodies: Iterable[int], pole: Pole, coaxial: Sequence[tuple[frozenset[int], int]]
) -> list[tuple[int, ...]]:
    """Group third bodies k that give the same great circle through P_ik and P_jk.

    The pole P_ij is the axis of the relative rotation of the bodies i and j. It lies on
    this great circle for every third body k. Two different circles determine it, so equal
    circles must count once. Third bodies that turn about one axis with body i have the same
    pole P_ik, and so the same circle. The same is true for body j.

    Parameters
    ----------
    third_bodies
        Bodies that have known poles with both bodies of the pole.
    pole
        The pole P_ij that lies on the great circles.
    coaxial
        For each common axis, the bodies that turn about it and an R pair (hinge) about it.

    Returns
    -------
    For each different great circle, the third bodies that give it, in rising order.
    """
    # Couples of third bodies with the same circle, by their positions in `bodies`.
    bodies = sorted(third_bodies)
    equal_couples: list[tuple[int, int]] = []
    for coaxial_bodies, _ in coaxial:
        has_body_of_pole = not coaxial_bodies.isdisjoint(pole)
        if has_body_of_pole:
            # These third bodies turn about one axis with body i or j.
            positions = [k for k, body in enumerate(bodies) if body in coaxial_bodies]
            equal_couples += pairwise(positions)
    # Bodies that are connected by such couples, directly or through others, are a group.
    circles = []
    for indices in connected_components(len(bodies), equal_couples):
        circles.append(tuple(bodies[k] for k in indices))
    return circles


class MobileParts:
    """Finds the smallest part of a mechanism from which a pole can be computed.

    A pole is the axis of the relative rotation of two bodies. Its part is the smallest set
    of bodies that contains both and has one degree of freedom. The pole then follows from
    the pairs between bodies of the part. Parts are remembered, so that each is searched
    once.

    Parameters
    ----------
    bodies
        All bodies of the mechanism.
    pebble_game
        Counts the degrees of freedom of any set of bodies. The game is None if redundant
        constraints make the count useless. Each part is then the whole mechanism.
    """

    def __init__(self, bodies: Iterable[int], pebble_game: PebbleGame | None) -> None:
        """Begin without any part."""
        self._bodies = set(bodies)
        self._pebble_game = pebble_game
        self._part_by_pole: dict[Pole, set[int]] = {}

    def find_part(self, pole: Pole) -> set[int]:
        """Return the bodies of the part of a pole."""
        if self._pebble_game is None:
            return self._bodies
        if pole not in self._part_by_pole:
            self._part_by_pole[pole] = self._pebble_game.find_mobile_part(*pole)
        return self._part_by_pole[pole]


def _make_block(
    empty_plan: Plan, part: set[int], unknown_poles: Sequence[Pole], pass_number: int
) -> BlockPoles:
    """Return the step that computes all unknown poles of a part of the mechanism together.

    A body is one link, or several links that cannot move relative to each other while the
    other inputs are locked. Its number is the smallest index of its links. A pole is the
    axis of the relative rotation of two bodies. This step is used where poles do not follow
    one by one from known poles.

    Parameters
    ----------
    empty_plan
        The mechanism with its bodies and the moving input, as a plan without steps.
    part
        The bodies of the part.
    unknown_poles
        All poles that are unknown. A pole belongs to the part if both its bodies do.
    pass_number
        Number of the pass (round of the search) in which the part is solved.
    """
    # The pairs between different bodies of the part. A pair between two links of the same
    # body (a = b), such as a locked input, is not one of them.
    pairs = [n for n, (a, b) in enumerate(empty_plan.ends) if a != b and {a, b} <= part]
    return BlockPoles(
        links=tuple(sorted(part)),
        pairs=tuple(pairs),
        poles=tuple(pole for pole in unknown_poles if part.issuperset(pole)),
        pass_number=pass_number,
    )


def _choose_opening(
    empty_plan: Plan,
    contacts_by_pole: dict[Pole, list[int]],
    known_poles: KnownPoles,
    block: BlockPoles,
) -> BlockPoles:
    """Return a block with the opening pole from which the most other poles would follow.

    A pole P_ij is the axis of the relative rotation of the bodies i and j. A block is a
    part of the mechanism whose poles are all computed at once, from velocity equations. For
    information, the plan also shows how its poles would follow if one of them, the opening
    pole, were known. They would be found in passes (rounds). Each pass finds the poles that
    lie on two known great circles.

    If equally many poles follow from several opening poles, the one with the fewest passes
    is chosen.

    Parameters
    ----------
    empty_plan
        The mechanism with its bodies and the moving input, as a plan without steps.
    contacts_by_pole
        For each pole, the indices of the sliding pairs that join its two bodies.
    known_poles
        The poles that are known before the block is solved.
    block
        The block, without an opening pole.
    """

    def most_poles_first(opened_block: BlockPoles) -> tuple[int, int]:
        """Return a sort key by which the best choice of an opening pole comes first.

        The best choice leads to the most poles, and each step gives one pole. Of equal
        choices, the best needs the fewest passes (rounds).
        """
        found_count = len(opened_block.steps_from_opening)
        return -found_count, opened_block.last_pass_number

    def most_lines_first(pole: Pole) -> tuple[int, Pole]:
        """Return a sort key: poles on many known great circles first, then by number.

        A pole P_ij is the axis of the relative rotation of the bodies i and j. It lies on
        the great circle through P_ik and P_jk for every third body k. So each body k with
        two such known poles gives a great circle.
        """
        great_circle_count = len(known_poles.third_bodies(pole))
        return -great_circle_count, pole

    # Not all poles can be tried as opening pole. The time of a trial grows with the square
    # of the number of poles, so fewer are tried in a block with many poles.
    max_trials = max(1, MAX_OPENING_WORK // len(block.poles) ** 2)
    tried_poles = sorted(block.poles, key=most_lines_first)[:max_trials]
    opened_blocks = [
        _open_block(empty_plan, contacts_by_pole, known_poles, block, pole)
        for pole in tried_poles
    ]
    return min(opened_blocks, key=most_poles_first)


def _open_block(
    empty_plan: Plan,
    contacts_by_pole: dict[Pole, list[int]],
    known_poles: KnownPoles,
    block: BlockPoles,
    opening_pole: Pole,
) -> BlockPoles:
    """Return a block with the steps that would be possible if one of its poles were known.

    A pole is the axis of the relative rotation of two bodies. A block is a part of the
    mechanism whose poles are all computed at once. For display, steps show how its poles
    would follow from one of them, the opening pole. They would be found in passes (rounds).
    Each pass finds all unknown poles of the block that lie on two known great circles.
    These poles are known in the next pass.

    Parameters
    ----------
    empty_plan
        The mechanism with its bodies and the moving input, as a plan without steps.
    contacts_by_pole
        For each pole, the indices of the sliding pairs that join its two bodies.
    known_poles
        The poles that are known before the block is solved. They are not changed.
    block
        The block, without an opening pole.
    opening_pole
        The pole that counts as known.
    """
    poles_after_opening = known_poles.copy()
    # This step only marks the opening pole as known. It is not in the result.
    poles_after_opening.add(LinePole(opening_pole, pass_number=block.pass_number, via=()))
    steps_of_all_passes: list[LinePole] = []
    for pass_number in count(block.pass_number + 1):
        steps_of_pass = _find_line_poles(
            empty_plan,
            contacts_by_pole,
            known_poles=poles_after_opening,
            poles=poles_after_opening.unknown_of(block.poles),
            pass_number=pass_number,
        )
        if not steps_of_pass:
            break
        for step in steps_of_pass:
            poles_after_opening.add(step)
        steps_of_all_passes += steps_of_pass
    return replace(
        block, opening=opening_pole, steps_from_opening=tuple(steps_of_all_passes)
    )
