"""Plans of a mechanism: how every pole asked for follows while one input moves."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import combinations

from spherekit.checked import checked
from spherekit.errors import PlanError
from spherekit.model.mechanism import Mechanism
from spherekit.planning.inputs import driven_pairs
from spherekit.planning.passes import circles, steps_of
from spherekit.planning.poles import (
    BlockPoles,
    CoaxialPole,
    LinePole,
    Plan,
    Pole,
    PrimaryPole,
    Step,
    mask_of,
    parse_pole,
    pole_of,
)
from spherekit.planning.rigidity import counted_freedom


def prune(whole: Plan, wanted: Sequence[Pole]) -> Plan:
    """Return the plan that holds only the ancestors of the wanted poles.

    Each pole keeps the two lines that need the fewest other poles, and every further
    line whose poles are in the plan anyway.
    """
    maker: dict[Pole, Step] = {}
    cost: dict[Pole, frozenset[Pole]] = {}
    cheapest: dict[Pole, tuple[int, ...]] = {}
    for step in whole.steps:
        if isinstance(step, PrimaryPole | CoaxialPole):
            maker[step.pole], cost[step.pole] = step, frozenset()
        elif isinstance(step, BlockPoles):
            for pole in step.poles:
                maker[pole], cost[pole] = step, frozenset([pole])
        else:
            maker[step.pole] = step
            cheapest[step.pole], needed = _cheapest_lines(step, cost, whole.coaxial)
            cost[step.pole] = needed | {step.pole}
    kept: set[Pole] = set()
    stack = list(wanted)
    while stack:
        pole = stack.pop()
        if pole in kept:
            continue
        kept.add(pole)
        step = maker[pole]
        if isinstance(step, LinePole):
            stack += replace(step, via=cheapest[pole]).sources
        elif isinstance(step, BlockPoles):
            stack += [pole_of(*whole.ends[pair]) for pair in step.pairs]
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
                via = [k for k in step.via if {pole_of(i, k), pole_of(j, k)} <= kept]
                step = replace(step, via=tuple(via))
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
    coaxial: Sequence[tuple[int, int]],
) -> tuple[tuple[int, ...], frozenset[Pole]]:
    """Return third links of different great circles that suffice, and what they need."""
    i, j = step.pole
    needs = {k: cost[pole_of(i, k)] | cost[pole_of(j, k)] for k in step.via}
    lines = max(2 - len(step.contacts), 0)
    every = circles(mask_of(step.via), step.pole, coaxial)
    cheapest = (min(links, key=lambda k: (len(needs[k]), k)) for links in every)
    first = sorted(cheapest, key=lambda k: (len(needs[k]), k))[:12]
    if lines == 0:
        return (), frozenset()
    if lines == 1:
        return (first[0],), needs[first[0]]
    a, b = min(
        ((a, b) for n, a in enumerate(first) for b in first[n + 1 :]),
        key=lambda pair: (len(needs[pair[0]] | needs[pair[1]]), pair),
    )
    return (a, b), needs[a] | needs[b]


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
    if input_pair is not None:
        number = mechanism.pair_number[mechanism.pair(input_pair).name]
        if number not in driven_pairs(mechanism):
            mechanism = mechanism.with_inputs(input_pair)
    driven = driven_pairs(mechanism)
    moved = driven[0] if input_pair is None else mechanism.pair_number[input_pair]
    locked = tuple(pair for pair in driven if pair != moved)
    freedom = counted_freedom(mechanism, driven, locked, by_rank)
    empty = Plan(mechanism, moved, locked, freedom.body, (), ())
    every = tuple(combinations(empty.bodies, 2))
    whole = replace(empty, requested=every, steps=tuple(steps_of(empty, freedom.game)))
    if poles is None:
        return whole
    wanted = []
    for item in poles:
        i, j = parse_pole(mechanism, item) if isinstance(item, str) else item
        names = mechanism.links
        if min(i, j) < 0 or max(i, j) >= len(names):
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
    names = [mechanism.pairs[pair].name for pair in driven_pairs(mechanism)]
    return tuple(plan(mechanism, None, name, by_rank) for name in names)
