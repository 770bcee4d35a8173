"""The sequence in which every pole axis follows from the known ones.

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

from spherekit.mechanism.graph import clusters
from spherekit.planning.mobility import Pebbles
from spherekit.planning.pole_plan import (
    BlockPoles,
    LinePole,
    Plan,
    Pole,
    PrimaryPole,
    Step,
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
