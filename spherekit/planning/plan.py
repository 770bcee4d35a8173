"""Plans of a mechanism: how every pole asked for follows while one input moves.

The sequence in which every instantaneous pole axis follows from the known ones.

Poles of pairs (R, Cr) are primary. Synchronous passes of the Aronhold-Kennedy theorem
(Di Gregorio 2011) add the secondary ones: P_ij lies on the great circle of P_ik and
P_jk for every third link k, and on the contact plane of a sliding pair of i and j; two
such lines give it. Links that share an axis by construction have it as their pole. Where
the passes stop, the smallest single-freedom part that holds an unknown pole is solved from
its velocity equations. One pole of it is enough for ordinary passes to find the others, in
every chain of up to twelve links that is known, and the plan says how; the equations give
all of them at once, and more surely. Then the passes go on.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import combinations, pairwise

from spherekit.argument_validation import checked
from spherekit.errors import PlanError
from spherekit.model.graph import clusters
from spherekit.model.mechanism import Mechanism
from spherekit.planning.inputs import Pebbles, counted_freedom, driven_pairs
from spherekit.planning.poles import (
    BlockPoles,
    LinePole,
    Plan,
    Pole,
    PrimaryPole,
    Step,
    parse_pole,
    pole_of,
)

Partners = list[set[int]]
"""The bodies that each one has a known pole with, by number."""
MOST_TRIED = 20_000
"""Poles tried as the one by which passes go on, times the square of those unknown."""


def steps_of(chain: Plan, game: Pebbles | None) -> list[Step]:
    """Return the steps that give all poles of a chain, given as a plan without steps."""
    mechanism = chain.mechanism
    partners: Partners = [set() for _ in mechanism.links]
    steps: list[Step] = []
    contacts: dict[Pole, list[int]] = {}
    for number, (pair, (a, b)) in enumerate(zip(mechanism.pairs, chain.ends, strict=True)):
        if a == b:
            continue
        pole = pole_of(a, b)
        if pair.kind.pole_line is None:
            contacts.setdefault(pole, []).append(number)
        else:
            steps.append(PrimaryPole(pole, number))
            _mark(partners, [pole])
    unknown = [*combinations(chain.bodies, 2)]
    parts: dict[Pole, set[int]] = {}
    round_number = 0
    while unknown := [pole for pole in unknown if pole[1] not in partners[pole[0]]]:
        round_number += 1
        new_steps: list[Step] = []
        for pole in unknown:
            shared = next((n for links, n in chain.coaxial if links >= {*pole}), None)
            if shared is not None:
                new_steps.append(PrimaryPole(pole, shared, round_number))
            else:
                new_steps += _by_lines(chain, contacts, partners, [pole], round_number)
        if not new_steps:
            block = _smallest_block(chain, game, parts, unknown, round_number)
            if game is not None:
                block = _opened(chain, contacts, partners, block)
            new_steps, round_number = [block], block.last
        for step in new_steps:
            _mark(partners, step.poles if isinstance(step, BlockPoles) else [step.pole])
        steps += new_steps
    return steps


def _by_lines(
    chain: Plan,
    contacts: dict[Pole, list[int]],
    partners: Partners,
    poles: Iterable[Pole],
    number: int,
) -> Iterator[LinePole]:
    """Yield the steps of a pass for poles that two different lines or more go through."""
    for pole in poles:
        common = partners[pole[0]] & partners[pole[1]]
        touching = tuple(contacts.get(pole, ()))
        if len(circles(common, pole, chain.coaxial)) + len(touching) >= 2:
            yield LinePole(pole, number, tuple(sorted(common)), touching)


def _opened(
    chain: Plan,
    contacts: dict[Pole, list[int]],
    partners: Partners,
    block: BlockPoles,
) -> BlockPoles:
    """Return a part with the pole by which passes find the most others, and soonest."""

    def opened(pole: Pole) -> BlockPoles:
        """Return the part with the passes that follow from a pole."""
        then = [{*others} for others in partners]
        passes, steps = list[LinePole](), [LinePole(pole, block.round, ())]
        while steps:
            _mark(then, [step.pole for step in steps])
            left = [other for other in block.poles if other[1] not in then[other[0]]]
            steps = [*_by_lines(chain, contacts, then, left, steps[0].round + 1)]
            passes += steps
        return replace(block, opening=pole, passes=tuple(passes))

    def left_and_passes(part: BlockPoles) -> tuple[int, int]:
        left = len(block.poles) - 1 - len(part.passes)
        return left, part.last + (left > 0)

    def fewest_lines(pole: Pole) -> tuple[int, Pole]:
        return -len(partners[pole[0]] & partners[pole[1]]), pole

    most = max(1, MOST_TRIED // len(block.poles) ** 2)
    tried = sorted(block.poles, key=fewest_lines)[:most]
    return min(map(opened, tried), key=left_and_passes)


def circles(
    common: set[int], pole: Pole, coaxial: Sequence[tuple[frozenset[int], int]]
) -> list[tuple[int, ...]]:
    """Return the third links of each different great circle through pairs of known poles.

    Third links that turn about one axis with a link of the pole give the same circle.
    """
    thirds, same = sorted(common), list[tuple[int, int]]()
    for links, _ in coaxial:
        if not links.isdisjoint(pole):
            same += pairwise(k for k, third in enumerate(thirds) if third in links)
    return [tuple(thirds[k] for k in alike) for alike in clusters(len(thirds), same)]


def _smallest_block(
    chain: Plan,
    game: Pebbles | None,
    parts: dict[Pole, set[int]],
    unknown: Sequence[Pole],
    round_number: int,
) -> BlockPoles:
    """Solve the smallest part with an unknown pole; `parts` keeps them between calls.

    Where counting does not decide on freedoms (`game` is None) the part is the whole.
    """
    for pole in unknown:
        if game is None:
            parts[pole] = set(chain.bodies)
        elif pole not in parts:
            # smallest with one freedom: such sets are closed under intersection here
            parts[pole] = game.rigid_part(*pole) or game.reach(pole)
    inside = min((parts[pole] for pole in unknown), key=len)
    return BlockPoles(
        links=tuple(sorted(inside)),
        pairs=tuple(
            n for n, (a, b) in enumerate(chain.ends) if a != b and {a, b} <= inside
        ),
        poles=tuple(pole for pole in unknown if {*pole} <= inside),
        round=round_number,
    )


def _mark(partners: Partners, poles: Iterable[Pole]) -> None:
    for i, j in poles:
        partners[i].add(j)
        partners[j].add(i)


def prune(whole: Plan, wanted: Sequence[Pole]) -> Plan:
    """Return the plan that holds only the ancestors of the wanted poles.

    Each pole keeps the two lines that need the fewest other poles, and every further
    line whose poles are in the plan anyway.
    """
    cost: dict[Pole, frozenset[Pole]] = {}
    sources: dict[Pole, Iterable[Pole]] = {}
    for step in whole.steps:
        if isinstance(step, BlockPoles):
            cost |= {pole: frozenset([pole]) for pole in step.poles}
            primary = [pole_of(*whole.ends[pair]) for pair in step.pairs]
            sources |= dict.fromkeys(step.poles, primary)
        elif isinstance(step, LinePole):
            via, needed = _cheapest_lines(step, cost, whole.coaxial)
            cost[step.pole] = needed | {step.pole}
            sources[step.pole] = replace(step, via=via).sources
        else:
            cost[step.pole], sources[step.pole] = frozenset(), ()
    kept: set[Pole] = set()
    stack = list(wanted)
    while stack:
        pole = stack.pop()
        if pole not in kept:
            kept.add(pole)
            stack += sources[pole]
    steps: list[Step] = []
    for step in whole.steps:
        if isinstance(step, BlockPoles):
            asked = tuple(pole for pole in step.poles if pole in kept)
            if asked:
                passes = _ancestors(step.passes, asked)
                steps.append(replace(step, poles=asked, passes=passes))
        elif step.pole in kept:
            if isinstance(step, LinePole):
                i, j = step.pole
                via = tuple(k for k in step.via if {pole_of(i, k), pole_of(j, k)} <= kept)
                step = replace(step, via=via)
            steps.append(step)
    return replace(whole, requested=tuple(dict.fromkeys(wanted)), steps=tuple(steps))


def _ancestors(passes: Sequence[LinePole], asked: Iterable[Pole]) -> tuple[LinePole, ...]:
    """Return the passes that some poles follow from."""
    needed, kept = set(asked), []
    for step in reversed(passes):
        if step.pole in needed:
            kept.append(step)
            needed.update(step.sources)
    return tuple(reversed(kept))


def _cheapest_lines(
    step: LinePole,
    cost: dict[Pole, frozenset[Pole]],
    coaxial: Sequence[tuple[frozenset[int], int]],
) -> tuple[tuple[int, ...], frozenset[Pole]]:
    """Return third links of different great circles that suffice, and what they need."""
    i, j = step.pole
    needs = {k: cost[pole_of(i, k)] | cost[pole_of(j, k)] for k in step.via}

    def costly(third: int) -> tuple[int, int]:
        return len(needs[third]), third

    every = circles({*step.via}, step.pole, coaxial)
    cheapest = sorted((min(links, key=costly) for links in every), key=costly)
    chosen = tuple(cheapest[: max(2 - len(step.contacts), 0)])
    return chosen, frozenset[Pole]().union(*(needs[k] for k in chosen))


@checked(PlanError)
def plan(
    mechanism: Mechanism,
    poles: Iterable[Pole | str] | None = None,
    input_pair: str | None = None,
    by_rank: bool = False,
) -> Plan:
    """Return the plan for some poles (all by default) while one input moves.

    Parameters
    ----------
    mechanism
        Any chain of R, Cr and Cs pairs with a freedom for each of its inputs.
    poles
        Poles to find, as pairs of link numbers or text such as ``"3/1"``; the plan then
        holds only their ancestors.
    input_pair
        Name of the driven pair. One of several inputs: the others are locked. Otherwise
        the pair drives instead of the declared input. By default the first input.
    by_rank
        Whether the mechanism is known to have a freedom for each input by rank at its
        configurations, though not by counting.

    Raises
    ------
    PlanError
        If the number of inputs is not the mobility, a part is rigid or loose, a pole is
        unknown, or its links are joined by a locked input.
    """
    driven = driven_pairs(mechanism)
    moved = driven[0]
    if input_pair is not None:
        moved = mechanism.pair_number[mechanism.pair(input_pair).name]
        if moved not in driven:
            mechanism = mechanism.with_inputs(input_pair)
            driven = driven_pairs(mechanism)
    locked = tuple(pair for pair in driven if pair != moved)
    body, game = counted_freedom(mechanism, driven, locked, by_rank)
    empty = Plan(mechanism, moved, locked, body, (), ())
    steps = tuple(steps_of(empty, game))
    whole = replace(empty, requested=tuple(combinations(empty.bodies, 2)), steps=steps)
    if poles is None:
        return whole
    wanted = []
    for item in poles:
        i, j = parse_pole(mechanism, item) if isinstance(item, str) else item
        names = mechanism.links
        if not 0 <= min(i, j) <= max(i, j) < len(names):
            raise PlanError(
                f"{mechanism.name}: pole ({i}, {j}): links are numbered from 0 to "
                f"{len(names) - 1}; or give text such as {names[-1]}/{names[0]}"
            )
        pole = whole.pole(i, j)
        if pole is None:
            raise PlanError(
                f"{mechanism.name}: links {names[i]} and {names[j]} are one body while "
                f"input {mechanism.pairs[moved].name} moves alone; ask for the pole with "
                "another input"
            )
        wanted.append(pole)
    return prune(whole, wanted)


def plans(mechanism: Mechanism, by_rank: bool = False) -> tuple[Plan, ...]:
    """Return a whole plan for each input, moved alone with the others locked.

    Raises
    ------
    PlanError
        See `plan`.
    """
    names = mechanism.names_of(driven_pairs(mechanism))
    return tuple(plan(mechanism, None, name, by_rank) for name in names)
