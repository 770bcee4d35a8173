"""How the loops of a group are solved: which columns are private, which are unknowns.

Each loop gives three equations. Where two columns occur in one loop only, the scalar
equation along their vector product is free of them; they follow from the other columns
afterwards. With one such pair for every loop, a group of k loops comes down to k
equations (a dyad to one), whatever its bodies.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

from spherekit.planning.assembly import Group


@final
@dataclass(frozen=True)
class Loop:
    """A closed way through the bodies of a group.

    `passes` lists (pair number within the group, sense), in order; sense +1 goes from
    the pair's first link to its second. `private` are the two variables eliminated from
    its equations, or none.
    """

    passes: tuple[tuple[int, int], ...]
    private: tuple[int, ...]


@final
@dataclass(frozen=True)
class Elimination:
    """The loops of a group and the variables that remain to be solved together."""

    loops: tuple[Loop, ...]
    unknowns: tuple[int, ...]


def eliminate(group: Group, variables: Sequence[Sequence[int]]) -> Elimination:
    """Return the loops of a group; `variables[pair]` are those of the mechanism's pairs."""
    owned = [tuple(variables[pair]) for pair in group.pairs]
    ways = _ways(group, _leaves(group), owned)
    crossed = [pair for way in ways for pair, _ in way]
    loops: list[Loop] = []
    gone: set[int] = set()
    for way in ways:
        columns = [
            variable
            for pair, _ in reversed(way)
            if crossed.count(pair) == 1
            for variable in owned[pair]
        ]
        private = tuple(columns[:2]) if len(columns) > 1 else ()
        loops.append(Loop(way, private))
        gone |= set(private)
    every = [variable for of_pair in owned for variable in of_pair]
    return Elimination(tuple(loops), tuple(v for v in every if v not in gone))


def _leaves(group: Group) -> dict[int, tuple[int, int]]:
    """Return bodies with two pairs that can be left out, each with these two pairs."""
    at: dict[int, list[int]] = {body: [] for body in range(len(group.bodies))}
    for pair, ends in enumerate(group.ends):
        for body in ends:
            at[body].append(pair)
    leaves: dict[int, tuple[int, int]] = {}
    for body in sorted(at, reverse=True):
        if len(at[body]) != 2:
            continue
        neighbours = {_far(group, pair, body) for pair in at[body]}
        if len(neighbours) < 2 or neighbours & set(leaves):
            continue
        trial = {**leaves, body: (at[body][0], at[body][1])}
        if _connected(group, set(trial)):
            leaves = trial
    return leaves


def _far(group: Group, pair: int, body: int) -> int:
    a, b = group.ends[pair]
    return b if body == a else a


def _connected(group: Group, without: set[int]) -> bool:
    rest = set(range(len(group.bodies))) - without
    if not rest:
        return False
    seen, queue = set(), [min(rest)]
    while queue:
        body = queue.pop()
        seen.add(body)
        for ends in group.ends:
            if body in ends:
                other = ends[1] if ends[0] == body else ends[0]
                if other in rest and other not in seen:
                    queue.append(other)
    return seen == rest


def _ways(
    group: Group, leaves: dict[int, tuple[int, int]], owned: Sequence[tuple[int, ...]]
) -> list[tuple[tuple[int, int], ...]]:
    """Return a loop for each leaf, then for each chord of the other bodies' tree.

    The pairs that close a loop come last, sliding contacts among them if possible.
    """
    leaf_pairs = {pair for both in leaves.values() for pair in both}
    inner = [pair for pair in range(len(group.pairs)) if pair not in leaf_pairs]
    ordered = sorted(inner, key=lambda pair: len(owned[pair]))
    root = min(set(range(len(group.bodies))) - set(leaves))
    above: dict[int, tuple[int, int] | None] = {root: None}
    grown, used = True, set()
    while grown:
        grown = False
        for pair in ordered:
            a, b = group.ends[pair]
            if (a in above) != (b in above):
                old, new = (a, b) if a in above else (b, a)
                above[new] = (pair, old)
                used.add(pair)
                grown = True
                break

    def from_root(body: int) -> list[tuple[int, int]]:
        way: list[tuple[int, int]] = []
        step = above[body]
        while step is not None:
            pair, old = step
            way.append((pair, 1 if group.ends[pair][0] == old else -1))
            step = above[old]
        return way[::-1]

    def between(start: int, end: int) -> list[tuple[int, int]]:
        down, up = from_root(start), from_root(end)
        while down and up and down[0] == up[0]:
            down, up = down[1:], up[1:]
        return [(pair, -sense) for pair, sense in reversed(down)] + up

    ways = []
    for body, (first, second) in leaves.items():
        start, end = _far(group, first, body), _far(group, second, body)
        out = (first, 1 if group.ends[first][1] == body else -1)
        back = (second, 1 if group.ends[second][0] == body else -1)
        ways.append((*between(end, start), out, back))
    for pair in inner:
        if pair not in used:
            a, b = group.ends[pair]
            ways.append((*between(b, a), (pair, 1)))
    return ways
