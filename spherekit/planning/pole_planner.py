"""Plans of a mechanism: how every pole asked for follows while one input moves."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import combinations

from spherekit.argument_validation import checked
from spherekit.errors import PlanError
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import driven_pairs
from spherekit.planning.mobility import counted_freedom
from spherekit.planning.pole_plan import (
    BlockPoles,
    LinePole,
    Plan,
    Pole,
    Step,
    parse_pole,
    pole_of,
)
from spherekit.planning.pole_sequence import circles, steps_of


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
