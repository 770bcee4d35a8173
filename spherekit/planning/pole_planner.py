"""Makes the plan by which requested poles follow from each other while one input moves."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import combinations

from spherekit.argument_validation import checked
from spherekit.errors import PlanError
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import driven_pairs
from spherekit.planning.mobility import check_mobility
from spherekit.planning.pole_plan import (
    BlockPoles,
    LinePole,
    Plan,
    Pole,
    Step,
    parse_pole,
    pole_of,
)
from spherekit.planning.pole_sequence import find_all_steps, group_by_circle


@checked(PlanError)
def plan(
    mechanism: Mechanism,
    poles: Iterable[Pole | str] | None = None,
    input_pair: str | None = None,
    by_rank: bool = False,
) -> Plan:
    """Return the plan for some poles (all by default) while one input moves.

    A pole is the axis of the relative rotation of two links. The plan lists the steps that
    find the poles, each from poles of earlier steps.

    Parameters
    ----------
    mechanism
        Any chain of R, Cr and Cs pairs with one degree of freedom for each of its inputs.
    poles
        Poles to find, as pairs of link numbers or text such as ``"3/1"``. The plan then
        contains only these poles and the poles from which they follow.
    input_pair
        Name of the pair that moves, by default the first input. If it is one of several
        inputs, the other inputs are locked. If it is not an input, it replaces the declared
        inputs.
    by_rank
        Whether the rank of the velocity equations has shown that there is one degree of
        freedom for each input. Counting links and pairs may give fewer, if constraints are
        redundant.

    Raises
    ------
    PlanError
        If the number of inputs is not the mobility, a part is rigid or loose, a pole is
        unknown, or its links do not move relative to each other.
    ModelError
        If no pair has the name `input_pair`.
    """
    driven = driven_pairs(mechanism)
    moving_pair = driven[0]
    if input_pair is not None:
        moving_pair = mechanism.pair_number[mechanism.pair(input_pair).name]
        if moving_pair not in driven:
            mechanism = mechanism.with_inputs(input_pair)
            driven = driven_pairs(mechanism)
    locked = tuple(pair for pair in driven if pair != moving_pair)
    # Links that are rigid while the other inputs are locked are one body. The pebble game
    # counts the degrees of freedom of all parts.
    body_of_link, pebble_game = check_mobility(
        mechanism, driven, locked=locked, by_rank=by_rank
    )
    # A plan without steps has all that the search for the steps needs.
    empty_plan = Plan(
        mechanism=mechanism,
        input=moving_pair,
        locked=locked,
        body=body_of_link,
        requested=(),
        steps=(),
    )
    whole_plan = replace(
        empty_plan,
        requested=tuple(combinations(empty_plan.bodies, 2)),
        steps=tuple(find_all_steps(empty_plan, pebble_game)),
    )
    if poles is None:
        return whole_plan
    requested = [_pole_of_bodies(whole_plan, pole) for pole in poles]
    return prune_plan(whole_plan, requested)


def _pole_of_bodies(whole_plan: Plan, pole: Pole | str) -> Pole:
    """Return the pole that the user requests, as the pole of two bodies.

    A pole is the axis of the relative rotation of two links. One input moves. Links that
    are rigid while the other inputs are locked form one body.

    Parameters
    ----------
    whole_plan
        The plan of all poles.
    pole
        Indices of two links, or a text such as ``3/1``.

    Raises
    ------
    PlanError
        If there is no such pole, or both links belong to one body.
    """
    mechanism = whole_plan.mechanism
    names = mechanism.links
    # The indices of the two links.
    if isinstance(pole, str):
        i, j = parse_pole(mechanism, pole)
    else:
        i, j = pole
    if not 0 <= min(i, j) <= max(i, j) < len(names):
        raise PlanError(
            f"{mechanism.name}: pole ({i}, {j}): links are numbered from 0 to "
            f"{len(names) - 1}; give two of these numbers, or a string with two names, "
            f'such as "{names[-1]}/{names[0]}"'
        )
    if i == j:
        raise PlanError(
            f"{mechanism.name}: pole ({i}, {j}): a pole needs two different links"
        )
    # The pole of the bodies to which these links belong.
    pole_of_bodies = whole_plan.pole(i, j)
    if pole_of_bodies is None:
        raise PlanError(
            f"{mechanism.name}: links {names[i]} and {names[j]} have no pole while input "
            f"{mechanism.pairs[whole_plan.input].name} moves alone, because they do not "
            "move relative to each other; request the pole for another input"
        )
    return pole_of_bodies


def plans(mechanism: Mechanism, by_rank: bool = False) -> tuple[Plan, ...]:
    """Return a plan for each input of a mechanism.

    A plan lists the steps that find all poles (axes of the relative rotations of two links)
    while this input moves and the other inputs are locked.

    Raises
    ------
    PlanError
        If the number of inputs is not the mobility, or a part is rigid or loose.
    """
    names = mechanism.names_of(driven_pairs(mechanism))
    return tuple(plan(mechanism, None, name, by_rank) for name in names)


def prune_plan(whole_plan: Plan, requested: Sequence[Pole]) -> Plan:
    """Return the plan with only those steps that the requested poles need.

    A pole P_ij is the axis of the relative rotation of two bodies. The pole is the
    intersection of two lines: great circles through P_ik and P_jk for third bodies k, or
    great circles in contact planes of sliding pairs. A contact plane contains the centre of
    the sphere and the normal of the contact. A step can have more than two lines. The two
    that need the fewest other poles are chosen, and all poles that they need stay in the
    plan.

    Further lines of a step stay if all their poles are in the new plan anyway. In each
    configuration, the two lines with the best-conditioned intersection can then be used.

    Parameters
    ----------
    whole_plan
        A plan of all poles.
    requested
        The requested poles of bodies.
    """
    # Collect the requested poles, and all poles from which these follow. The stack has the
    # poles that still have to be collected. `sources_by_pole` has for each pole the poles
    # from which it is computed.
    sources_by_pole = _choose_sources(whole_plan)
    needed_poles: set[Pole] = set()
    stack = list(requested)
    while stack:
        pole = stack.pop()
        if pole not in needed_poles:
            needed_poles.add(pole)
            stack += sources_by_pole[pole]

    # Keep the steps that give needed poles, and only their lines through needed poles. A
    # block is a part of the mechanism whose poles are computed together.
    steps: list[Step] = []
    for step in whole_plan.steps:
        if isinstance(step, BlockPoles):
            needed_of_block = tuple(pole for pole in step.poles if pole in needed_poles)
            if needed_of_block:
                steps.append(_prune_block(step, needed_of_block))
        elif step.pole in needed_poles:
            if isinstance(step, LinePole):
                step = _prune_lines(step, needed_poles)
            steps.append(step)
    distinct_requested = tuple(dict.fromkeys(requested))
    return replace(whole_plan, requested=distinct_requested, steps=tuple(steps))


def _choose_sources(whole_plan: Plan) -> dict[Pole, Iterable[Pole]]:
    """Return, for each pole of a plan, the poles from which it is computed.

    A pole P_ij is the axis of the relative rotation of two bodies. There are three kinds:

    - A primary pole is known without any other pole. Such a pole is the axis of a pair, or
      the line through the centre of the sphere and the point of a rolling contact.
    - A line pole is the intersection of two great circles, each through P_ik and P_jk for a
      third body k. The two circles that need the fewest other poles are chosen. A
      circle in the contact plane of a sliding pair can take the place of one of them, and
      needs no pole. This plane contains the normal of the contact.
    - The poles of a block (an irreducible part of the mechanism) are computed together,
      from the primary poles of its pairs.

    Returns
    -------
    For each pole the poles that it needs directly.
    """
    # For each pole, the set of poles that have to be computed to get it: itself, and all
    # poles that it needs directly or through others. The size of the set is its cost.
    # Primary poles cost nothing, so they are in no set.
    computed_poles: dict[Pole, frozenset[Pole]] = {}
    sources_by_pole: dict[Pole, Iterable[Pole]] = {}
    for step in whole_plan.steps:
        if isinstance(step, BlockPoles):
            # A pole of a block needs only primary poles, so only itself is computed. The
            # block may have sliding contacts, whose poles are not primary.
            primary_poles = [
                pole_of(*whole_plan.ends[pair])
                for pair in step.pairs
                if whole_plan.mechanism.pairs[pair].kind.pole_line is not None
            ]
            for pole in step.poles:
                computed_poles[pole] = frozenset([pole])
                sources_by_pole[pole] = primary_poles
        elif isinstance(step, LinePole):
            # The third bodies k of the chosen circles, and all poles to be computed for
            # these circles. `coaxial` lists bodies that turn about one axis, because they
            # give the same circle.
            third_bodies, needed_poles = _choose_cheapest_lines(
                step, computed_poles, whole_plan.coaxial
            )
            computed_poles[step.pole] = needed_poles | {step.pole}
            # The sources of a step are P_ik and P_jk for its third bodies k.
            cheapest_step = replace(step, via=third_bodies)
            sources_by_pole[step.pole] = cheapest_step.sources
        else:
            # A primary pole.
            computed_poles[step.pole] = frozenset()
            sources_by_pole[step.pole] = ()
    return sources_by_pole


def _choose_cheapest_lines(
    step: LinePole,
    computed_poles: dict[Pole, frozenset[Pole]],
    coaxial: Sequence[tuple[frozenset[int], int]],
) -> tuple[tuple[int, ...], frozenset[Pole]]:
    """Return the third bodies of the great circles that need the fewest other poles.

    A pole P_ij is the axis of the relative rotation of two bodies. The pole is the
    intersection of two lines on the sphere. A third body k gives a line: the great circle
    through the poles P_ik and P_jk. A sliding contact of the bodies i and j gives another
    one: the great circle through the contact point at right angles to both profiles.

    The cost of a circle is the number of poles that have to be computed for it. Each circle
    is rated by itself, even if two circles need the same poles. If several third bodies
    give the same circle, only the cheapest of them counts.

    Parameters
    ----------
    step
        The step, with all its lines.
    computed_poles
        For each pole of an earlier step, all poles that have to be computed for it,
        including itself. Empty for the axis of a pair, which is known.
    coaxial
        For each common axis of several bodies the bodies that turn about it, and the index
        of an R pair about it. If two third bodies turn about the same axis as i or j, their
        circles are the same.

    Returns
    -------
    third_bodies
        One for each great circle by which the pole is found: two, or fewer if there are
        sliding contacts.
    needed_poles
        All poles to be computed for these great circles.
    """
    i, j = step.pole
    needed_by_third: dict[int, frozenset[Pole]] = {}
    for third in step.via:
        needed_for_p_ik = computed_poles[pole_of(i, third)]
        needed_for_p_jk = computed_poles[pole_of(j, third)]
        needed_by_third[third] = needed_for_p_ik | needed_for_p_jk

    def cost(third: int) -> tuple[int, int]:
        """Return the number of needed poles. Bodies of equal cost are sorted by number."""
        return len(needed_by_third[third]), third

    # Third bodies with the same circle are in one group. Take the cheapest of each group.
    circles = group_by_circle(step.via, step.pole, coaxial)
    cheapest_thirds = [min(thirds, key=cost) for thirds in circles]
    cheapest_thirds.sort(key=cost)
    # Each sliding contact replaces one of the two circles.
    circle_count = max(2 - len(step.contacts), 0)
    chosen = tuple(cheapest_thirds[:circle_count])
    needed_poles: frozenset[Pole] = frozenset()
    for third in chosen:
        needed_poles |= needed_by_third[third]
    return chosen, needed_poles


def _prune_lines(step: LinePole, needed_poles: set[Pole]) -> LinePole:
    """Return a step without the great circles whose poles are not all needed.

    A pole P_ij is the axis of the relative rotation of the bodies i and j. The step finds
    it at the intersection of great circles through P_ik and P_jk for third bodies k. The
    step may also use contact planes of sliding pairs (planes through the centre of the
    sphere and the normal of the contact). They need no poles and stay.
    """
    i, j = step.pole
    via = [
        third
        for third in step.via
        if {pole_of(i, third), pole_of(j, third)} <= needed_poles
    ]
    return replace(step, via=tuple(via))


def _prune_block(block: BlockPoles, requested: tuple[Pole, ...]) -> BlockPoles:
    """Return a block with only the requested ones of its poles.

    A pole is the axis of the relative rotation of two bodies. A block is a part of the
    mechanism whose poles can only be computed together. For display only, the block also
    has a list of steps. It shows how its poles would follow one by one if one of them, the
    opening pole, were known. Steps that lead to no requested pole are removed.

    A remaining step may name a pole that was found before the block. The pruned plan can
    lack this pole, because the computation of the block does not need it.
    """
    # The steps are examined backwards, so that a step comes after all steps that need it.
    needed_poles = set(requested)
    needed_steps: list[LinePole] = []
    for step in reversed(block.steps_from_opening):
        if step.pole in needed_poles:
            needed_steps.append(step)
            needed_poles.update(step.sources)
    needed_steps.reverse()
    return replace(block, poles=requested, steps_from_opening=tuple(needed_steps))
