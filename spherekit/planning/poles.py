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

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import final

from spherekit.checked import checked
from spherekit.conventions import counted, nearest
from spherekit.errors import PlanError
from spherekit.markup import html_table
from spherekit.model.mechanism import Mechanism
from spherekit.planning.cells import cells
from spherekit.planning.coaxial import coaxial_links
from spherekit.planning.inputs import driven_pairs
from spherekit.planning.rigidity import Pebbles, counted_freedom

Pole = tuple[int, int]
"""Two link numbers, smaller first; the pole of the second relative to the first."""


MOST_TRIED = 20_000
"""Poles tried as the one by which passes go on, times the square of those unknown."""


@final
@dataclass(frozen=True)
class PrimaryPole:
    """A pole that is the axis or contact line of a pair."""

    pole: Pole
    pair: int


@final
@dataclass(frozen=True)
class LinePole:
    """A pole at the intersection of great circles.

    `via` are the third links k whose poles P_ik and P_jk span a great circle, and
    `contacts` the sliding pairs whose contact plane is one. Any two of all these lines
    suffice; the best-conditioned two are chosen at each configuration.
    """

    pole: Pole
    round: int
    via: tuple[int, ...]
    contacts: tuple[int, ...] = ()

    @property
    def case(self) -> str:
        """The lecture's case of the first two lines: a, b or c."""
        lines = min(len(self.via), 2)
        return {2: "a", 1: "b", 0: "c"}[lines if not self.contacts else min(lines, 1)]

    @property
    def sources(self) -> tuple[Pole, ...]:
        """The poles that its lines are drawn through."""
        i, j = self.pole
        return tuple(source for k in self.via for source in (pole_of(i, k), pole_of(j, k)))


@final
@dataclass(frozen=True)
class CoaxialPole:
    """A pole that is the axis of R pair `pair`, which its links always share."""

    pole: Pole
    round: int
    pair: int


@final
@dataclass(frozen=True)
class BlockPoles:
    """All poles of an irreducible single-freedom part, solved together.

    The pair rates of the part are the null vector of its loop-closure velocity
    equations; `poles` are those that were unknown before. With the one called `opening`
    the `passes` find the others, in the order of the lecture.
    """

    links: tuple[int, ...]
    pairs: tuple[int, ...]
    poles: tuple[Pole, ...]
    round: int
    method: str = "null vector of the velocity equations"
    opening: Pole | None = None
    passes: tuple[LinePole, ...] = ()

    @property
    def rounds(self) -> dict[Pole, int]:
        """The pass in which each of its poles becomes known."""
        later = {step.pole: step.round for step in self.passes}
        return {pole: later.get(pole, self.round) for pole in self.poles}

    @property
    def last(self) -> int:
        """The pass in which the last of its poles becomes known."""
        return max((step.round for step in self.passes), default=self.round)


Step = PrimaryPole | CoaxialPole | LinePole | BlockPoles


@final
@dataclass(frozen=True)
class Plan:
    """Ordered steps that give every requested pole while one input moves.

    With several inputs the others are `locked`, and links that cannot move relative to
    each other then are one body: poles are those of bodies, each called by its link with
    the smallest number, which `body` has for every link.
    """

    mechanism: Mechanism
    input: int
    locked: tuple[int, ...]
    body: tuple[int, ...]
    requested: tuple[Pole, ...]
    steps: tuple[Step, ...]

    def __repr__(self) -> str:
        moving = self.mechanism.pairs[self.input].name
        return (
            f"<Plan of {self.mechanism.name}: {counted(len(self.requested), 'pole')} in "
            f"{counted(len(self.steps), 'step')}, while {moving} moves>"
        )

    def _repr_html_(self) -> str:
        """Return the Table: for each pole the pass that finds it, x for a primary one."""
        names = [self.name(body) for body in self.bodies]
        rows = [[name, *row] for name, row in zip(names, cells(self), strict=True)]
        moving = self.mechanism.pairs[self.input].name
        return html_table(["", *names], rows, f"{self.mechanism.name}, {moving} moves")

    @cached_property
    def bodies(self) -> tuple[int, ...]:
        """The links that bodies are called by, in order."""
        return tuple(sorted(set(self.body)))

    @cached_property
    def ends(self) -> tuple[tuple[int, int], ...]:
        """The two bodies of every pair; the same one twice within a body."""
        return tuple((self.body[a], self.body[b]) for a, b in self.mechanism.ends)

    @cached_property
    def coaxial(self) -> tuple[tuple[int, int], ...]:
        """For each common axis its bodies, as bits of a number, and an R pair about it."""
        return tuple(
            (_mask(self.body[link] for link in axis.links), axis.pair)
            for axis in coaxial_links(self.mechanism)
        )

    @cached_property
    def rounded_axes(self) -> frozenset[int]:
        """The pairs of `coaxial` whose axes are common but for rounding."""
        shared = coaxial_links(self.mechanism)
        return frozenset(axis.pair for axis in shared if not axis.exactly)

    def pole(self, i: int, j: int) -> Pole | None:
        """Return the pole of the bodies of two links, None if they are one body."""
        a, b = self.body[i], self.body[j]
        return None if a == b else pole_of(a, b)

    def name(self, body: int) -> str:
        """Return the name of a body: its links, joined by plus signs."""
        names = self.mechanism.links
        return "+".join(names[k] for k, owner in enumerate(self.body) if owner == body)

    @property
    def rounds(self) -> dict[Pole, int]:
        """The pass in which each pole becomes known; 0 for primary poles."""
        passes: dict[Pole, int] = {}
        for step in self.steps:
            if isinstance(step, PrimaryPole):
                passes[step.pole] = 0
            elif isinstance(step, LinePole | CoaxialPole):
                passes[step.pole] = step.round
            else:
                passes.update(step.rounds)
        return passes

    @property
    def blocks(self) -> tuple[BlockPoles, ...]:
        """The irreducible parts, empty for a determinate mechanism."""
        return tuple(step for step in self.steps if isinstance(step, BlockPoles))


def pole_of(i: int, j: int) -> Pole:
    """Return the pole of two links, smaller number first."""
    return (i, j) if i < j else (j, i)


def all_poles(count: int) -> tuple[Pole, ...]:
    """Return the m (m - 1) / 2 poles of `count` links in order."""
    return tuple(combinations(range(count), 2))


def parse_pole(mechanism: Mechanism, text: str) -> Pole:
    """Return the pole that ``3/1``, ``coupler/ground`` or, where clear, ``31`` names."""
    number = mechanism.link_number
    if "/" in text:
        names = text.split("/")
        splits = [(names[0], names[-1])] if len(names) == 2 else []
    else:
        splits = [(text[:cut], text[cut:]) for cut in range(1, len(text))]
    poles = {
        pole_of(number[a], number[b])
        for a, b in splits
        if a in number and b in number and a != b
    }
    if len(poles) == 1:
        return poles.pop()
    every = [
        f"{mechanism.links[j]}/{mechanism.links[i]}" for i, j in all_poles(len(number))
    ]
    why = "could be several poles" if poles else "is not a pole"
    hint = nearest(text, every) or "."
    raise PlanError(
        f'{mechanism.name}: "{text}" {why}{hint} Write LINK/LINK with two of the links '
        f"{', '.join(mechanism.links)}"
    )


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
    whole = replace(empty, requested=every, steps=tuple(_steps(empty, freedom.game)))
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


def _steps(chain: Plan, game: Pebbles | None) -> list[Step]:
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
    common = partners[pole[0]] & partners[pole[1]]
    touching = tuple(contacts.get(pole, ()))
    if len(_circles(common, pole, chain.coaxial)) + len(touching) < 2:
        return None
    return LinePole(pole, round_number, _bits(common), touching)


def _opened(
    chain: Plan,
    contacts: dict[Pole, list[int]],
    partners: Sequence[int],
    block: BlockPoles,
) -> BlockPoles:
    """Return a part with the pole by which passes find the most others, and soonest."""

    def lines(pole: Pole) -> int:
        return (partners[pole[0]] & partners[pole[1]]).bit_count()

    best: tuple[int, int, Pole, tuple[LinePole, ...]] | None = None
    ordered = sorted(block.poles, key=lambda pole: (-lines(pole), pole))
    for pole in ordered[: max(1, MOST_TRIED // len(block.poles) ** 2)]:
        then = list(partners)
        _mark(then, [pole])
        left, passes = [other for other in block.poles if other != pole], block.round
        steps: list[LinePole] = []
        while left:
            passes += 1
            made = [_by_lines(chain, contacts, then, other, passes) for other in left]
            new_steps = [step for step in made if step is not None]
            if not new_steps:
                break
            _mark(then, [step.pole for step in new_steps])
            steps += new_steps
            left = [other for other in left if not then[other[0]] >> other[1] & 1]
        if best is None or (len(left), passes) < best[:2]:
            best = len(left), passes, pole, tuple(steps)
    assert best is not None
    return replace(block, opening=best[2], passes=best[3])


def _circles(
    common: int, pole: Pole, coaxial: Sequence[tuple[int, int]]
) -> list[tuple[int, ...]]:
    """Return the third links of each different great circle through pairs of known poles.

    Third links that turn about one axis with a link of the pole give the same circle.
    """
    if not coaxial:
        return [(third,) for third in _bits(common)]
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
        circles.append(_bits(same))
    return circles


def _holds(mask: int, i: int, j: int) -> bool:
    return bool(mask >> i & 1 and mask >> j & 1)


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
    circles = _circles(_mask(step.via), step.pole, coaxial)
    cheapest = (min(links, key=lambda k: (len(needs[k]), k)) for links in circles)
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


def _mask(links: Iterable[int]) -> int:
    mask = 0
    for link in links:
        mask |= 1 << link
    return mask


def _bits(mask: int) -> tuple[int, ...]:
    return tuple(k for k in range(mask.bit_length()) if mask >> k & 1)
