"""The sequence in which every instantaneous pole axis follows from the known ones.

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
from itertools import combinations

from spherekit.planning.poles import (
    BlockPoles,
    CoaxialPole,
    LinePole,
    Plan,
    Pole,
    PrimaryPole,
    Step,
    bits_of,
    pole_of,
)
from spherekit.planning.rigidity import Pebbles

MOST_TRIED = 20_000
"""Poles tried as the one by which passes go on, times the square of those unknown."""


def steps_of(chain: Plan, game: Pebbles | None) -> list[Step]:
    """Return the steps that give all poles of a chain, given as a plan without steps."""
    mechanism = chain.mechanism
    partners = [0] * len(mechanism.links)
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
    every = combinations(chain.bodies, 2)
    unknown = [p for p in every if not partners[p[0]] >> p[1] & 1]
    parts: dict[Pole, set[int]] = {}
    round_number = 0
    while unknown:
        round_number += 1
        new_steps: list[Step] = []
        for pole in unknown:
            shared = next((n for mask, n in chain.coaxial if _holds(mask, *pole)), None)
            if shared is not None:
                new_steps.append(CoaxialPole(pole, round_number, shared))
                continue
            by_lines = _by_lines(chain, contacts, partners, pole, round_number)
            if by_lines is not None:
                new_steps.append(by_lines)
        if not new_steps:
            block = _smallest_block(chain, game, parts, unknown, round_number)
            if game is not None:
                block = _opened(chain, contacts, partners, block)
            new_steps, round_number = [block], block.last
        for step in new_steps:
            _mark(partners, step.poles if isinstance(step, BlockPoles) else [step.pole])
        steps += new_steps
        unknown = [p for p in unknown if not partners[p[0]] >> p[1] & 1]
    return steps


def _by_lines(
    chain: Plan,
    contacts: dict[Pole, list[int]],
    partners: Sequence[int],
    pole: Pole,
    round_number: int,
) -> LinePole | None:
    """Return the step that gives a pole by two lines or more, if there are as many."""
    if not _has_lines(chain, contacts, partners, pole):
        return None
    common = partners[pole[0]] & partners[pole[1]]
    return LinePole(pole, round_number, bits_of(common), tuple(contacts.get(pole, ())))


def _has_lines(
    chain: Plan,
    contacts: dict[Pole, list[int]],
    partners: Sequence[int],
    pole: Pole,
) -> bool:
    """Return whether two different lines or more go through a pole."""
    common = partners[pole[0]] & partners[pole[1]]
    touching = len(contacts.get(pole, ()))
    if common.bit_count() + touching < 2:
        return False
    return not chain.coaxial or len(circles(common, pole, chain.coaxial)) + touching >= 2


def _opened(
    chain: Plan,
    contacts: dict[Pole, list[int]],
    partners: Sequence[int],
    block: BlockPoles,
) -> BlockPoles:
    """Return a part with the pole by which passes find the most others, and soonest."""

    def lines(pole: Pole) -> int:
        return (partners[pole[0]] & partners[pole[1]]).bit_count()

    best: tuple[int, int, Pole] | None = None
    ordered = sorted(block.poles, key=lambda pole: (-lines(pole), pole))
    for pole in ordered[: max(1, MOST_TRIED // len(block.poles) ** 2)]:
        left, passes = len(block.poles) - 1, block.round
        for _, poles in _following(chain, contacts, partners, block, pole):
            passes += 1
            left -= len(poles)
            if best is not None and best[0] == 0 and passes >= best[1]:
                break
        if left:
            passes += 1
        if best is None or (left, passes) < best[:2]:
            best = left, passes, pole
    assert best is not None
    opening = best[2]
    return replace(
        block,
        opening=opening,
        passes=tuple(
            LinePole(
                pole,
                number,
                bits_of(then[pole[0]] & then[pole[1]]),
                tuple(contacts.get(pole, ())),
            )
            for number, (then, poles) in enumerate(
                _following(chain, contacts, partners, block, opening), block.round + 1
            )
            for pole in poles
        ),
    )


def _following(
    chain: Plan,
    contacts: dict[Pole, list[int]],
    partners: Sequence[int],
    block: BlockPoles,
    opening: Pole,
) -> Iterator[tuple[Sequence[int], list[Pole]]]:
    """Return, for each pass from a pole on, what was known and which poles follow."""
    then = list(partners)
    _mark(then, [opening])
    left = [pole for pole in block.poles if pole != opening]
    while left:
        follows = [pole for pole in left if _has_lines(chain, contacts, then, pole)]
        if not follows:
            return
        yield then, follows
        _mark(then, follows)
        left = [pole for pole in left if not then[pole[0]] >> pole[1] & 1]


def circles(
    common: int, pole: Pole, coaxial: Sequence[tuple[int, int]]
) -> list[tuple[int, ...]]:
    """Return the third links of each different great circle through pairs of known poles.

    Third links that turn about one axis with a link of the pole give the same circle.
    """
    if not coaxial:
        return [(third,) for third in bits_of(common)]
    left = common
    circles = []
    while left:
        third = left & -left
        same, grown = third, 0
        while same != grown:
            grown = same
            for mask, _ in coaxial:
                if mask & same and any(mask >> link & 1 for link in pole):
                    same |= mask & common
        left &= ~same
        circles.append(bits_of(same))
    return circles


def _holds(mask: int, i: int, j: int) -> bool:
    return bool(mask >> i & 1 and mask >> j & 1)


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
            parts[pole] = game.moving_part(*pole)
    inside = min((parts[pole] for pole in unknown), key=len)
    return BlockPoles(
        links=tuple(sorted(inside)),
        pairs=tuple(
            n
            for n, (a, b) in enumerate(chain.ends)
            if a != b and a in inside and b in inside
        ),
        poles=tuple(p for p in unknown if p[0] in inside and p[1] in inside),
        round=round_number,
    )


def _mark(partners: list[int], poles: Iterable[Pole]) -> None:
    for i, j in poles:
        partners[i] |= 1 << j
        partners[j] |= 1 << i
