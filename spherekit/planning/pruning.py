"""The part of a plan that some poles follow from."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

from spherekit.planning.passes import circles
from spherekit.planning.poles import (
    BlockPoles,
    CoaxialPole,
    LinePole,
    Plan,
    Pole,
    PrimaryPole,
    Step,
    mask_of,
    pole_of,
)


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
