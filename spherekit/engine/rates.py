"""The rates of all variables along the motion, without a division by their own.

The velocity equations of a single-freedom mechanism with m variables have m - 1
independent rows; their maximal minors, with alternating signs, are proportional to the
rates. The vector of these minors is a polynomial in the directions of the axes. It is
regular at the dead centres of every pair and vanishes only where the rank drops. Here it
is found group by group: a group's variables by Cramer's rule, and everything found before
multiplied by the group's determinant. Of several inputs one moves while the others rest.

How the loops of a group are solved: which columns are private, which are unknowns.

Each loop gives three equations. Where two columns occur in one loop only, the scalar
equation along their vector product is free of them; they follow from the other columns
afterwards. With one such pair for every loop, a group of k loops comes down to k
equations (a dyad to one), whatever its bodies.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from spherekit.arrays import Floats
from spherekit.engine.algebra import (
    Exprs,
    cofactors,
    constants,
    cross,
    determinant,
    dot,
    vector,
)
from spherekit.engine.expression_graph import WITHOUT_EXPRESSIONS, Expr
from spherekit.errors import EngineError
from spherekit.model.graph import joined, spanning
from spherekit.model.mechanism import Mechanism
from spherekit.planning.inputs import Assembly, Group

Way = tuple[tuple[int, int], ...]
"""Pairs with senses, in order; sense +1 goes from a pair's first link to its second."""


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
    kept = [k for k, ends in enumerate(group.ends) if not without & set(ends)]
    ways = spanning(group.ends, [min(rest, default=0)], kept)
    return len(rest) == len(ways) + 1


def _ways(
    group: Group, leaves: dict[int, tuple[int, int]], owned: Sequence[tuple[int, ...]]
) -> list[Way]:
    """Return a loop for each leaf, then for each chord of the other bodies' tree.

    The pairs that close a loop come last, sliding contacts among them if possible.
    """
    leaf_pairs = {pair for both in leaves.values() for pair in both}
    inner = [pair for pair in range(len(group.pairs)) if pair not in leaf_pairs]
    tree: list[int] = []
    for pair in sorted(inner, key=lambda pair: len(owned[pair])):
        body = joined(len(group.bodies), [group.ends[k] for k in tree])
        a, b = group.ends[pair]
        if body[a] != body[b]:
            tree.append(pair)
    ways = []
    for leaf, (first, second) in leaves.items():
        start, end = _far(group, first, leaf), _far(group, second, leaf)
        out = (first, 1 if group.ends[first][1] == leaf else -1)
        back = (second, 1 if group.ends[second][0] == leaf else -1)
        ways.append((*way(group.ends, tree, end, start), out, back))
    for pair in inner:
        if pair not in tree:
            a, b = group.ends[pair]
            ways.append((*way(group.ends, tree, b, a), (pair, 1)))
    return ways


LARGEST = 6
"""Most equations of a group that are solved together by determinants."""

INDEPENDENT = 1e-6
"""Equations of unit size nearer than this to being combinations of others repeat them."""

COINCIDENT = 1e-9
"""Axes of one link whose angle has a smaller sine are one axis."""


@dataclass(frozen=True)
class GroupRows:
    """A group with its loops and unknowns, or the rows to use where equations repeat.

    `ways[loop]` lists pairs by their number within the group; `private[loop]` are the two
    variables eliminated from its equations, or none; `unknowns` remain to be solved
    together. `chosen` lists (loop, variable): the loop's equation along the vector of a
    variable.
    """

    group: Group
    ways: Sequence[Way]
    private: Sequence[tuple[int, ...]]
    unknowns: Sequence[int]
    chosen: tuple[tuple[int, int], ...] | None = None


def group_rows(
    mechanism: Mechanism,
    assembly: Assembly,
    pose_vectors: Callable[[], Floats],
) -> tuple[GroupRows, ...]:
    """Return how each group is solved.

    `pose_vectors()` gives the variables' vectors (variables, 3) at one configuration; it
    is called only where equations repeat, to choose independent ones.

    Raises
    ------
    EngineError
        If a group has more equations to solve together than is sensible.
    """
    owned = [mechanism.variables_of(pair) for pair in range(len(mechanism.pairs))]
    made = []
    for group in assembly.groups:
        of_pairs = [owned[pair] for pair in group.pairs]
        ways = _ways(group, _leaves(group), of_pairs)
        crossed = [pair for loop in ways for pair, _ in loop]
        private: list[tuple[int, ...]] = []
        for loop in ways:
            once = (pair for pair, _ in reversed(loop) if crossed.count(pair) == 1)
            columns = [variable for pair in once for variable in of_pairs[pair]]
            alone = len(columns) > 1 and not group.redundant
            private.append(tuple(columns[:2]) if alone else ())
        gone = {v for both in private for v in both}
        unknowns = [v for variables in of_pairs for v in variables if v not in gone]
        rows = GroupRows(group, ways, private, unknowns)
        if group.redundant:
            chosen = _independent(mechanism, assembly, rows, pose_vectors())
            rows = replace(rows, chosen=chosen)
        count = len(rows.unknowns)
        if count > LARGEST:
            raise EngineError(
                f"{mechanism.name}: a {group.kind} leaves {count} equations to be solved "
                f"together, expressions take at most {LARGEST}",
                WITHOUT_EXPRESSIONS,
            )
        made.append(rows)
    return tuple(made)


def _independent(
    mechanism: Mechanism,
    assembly: Assembly,
    group_rows: GroupRows,
    vectors: Floats,
) -> tuple[tuple[int, int], ...]:
    """Choose rows by the pivots of a QR decomposition, as many as there are unknowns."""
    from scipy.linalg import qr

    owners = mechanism.variable_owners
    driven = [mechanism.variables_of(pair)[0] for pair in assembly.inputs]
    candidates: dict[tuple[int, int], Floats] = {}
    for number, loop in enumerate(group_rows.ways):
        senses = np.zeros(len(mechanism.pairs))
        for pair, sign, enters, leaves in _passed(mechanism, group_rows.group, loop):
            senses[pair] = sign
            for driver, sense in way(mechanism.ends, assembly.inputs, enters, leaves):
                senses[driver] += sense
        weights = senses[list(owners)]
        columns = weights[:, None] * vectors
        for variable in np.flatnonzero(weights):
            candidates[number, int(variable)] = columns @ vectors[variable]
    rows = [
        np.delete(row, driven) / max(float(np.linalg.norm(row)), 1e-300)
        for row in candidates.values()
    ]
    count, keys = len(group_rows.unknowns), list(candidates)
    _, triangle, order = qr(np.transpose(rows), mode="economic", pivoting=True)
    sizes = np.abs(np.diagonal(triangle))
    if len(sizes) < count or np.min(sizes[:count]) < INDEPENDENT:
        raise EngineError(
            f"{mechanism.name}: its equations leave more than one motion at the "
            "configuration they were chosen at; change the range of the input",
            WITHOUT_EXPRESSIONS,
        )
    return tuple(keys[k] for k in order[:count])


def _passed(
    mechanism: Mechanism, group: Group, loop: Way
) -> Iterator[tuple[int, int, int, int]]:
    """Yield each pair of a loop with its sense, the link that it leads to, the next from.

    The two links are of one body.
    """
    onward = (*loop[1:], loop[0])
    for (pair, sense), (after, following) in zip(loop, onward, strict=True):
        number = group.pairs[pair]
        enters = mechanism.ends[number][1 if sense > 0 else 0]
        leaves = mechanism.ends[group.pairs[after]][0 if following > 0 else 1]
        yield number, sense, enters, leaves


def way(ends: Sequence[tuple[int, int]], pairs: Sequence[int], start: int, end: int) -> Way:
    """Return the pairs, with senses, that lead from a body to another; empty if none do."""
    ways: dict[int, Way] = {start: ()}
    for pair, old, new in spanning(ends, [start], pairs):
        ways[new] = (*ways[old], (pair, 1 if ends[pair][0] == old else -1))
    return ways.get(end, ())


Span = Callable[[int, int], Expr | None]
"""|A x B|^2 of two variables' vectors where it is constant, else None."""


def group_rates(
    mechanism: Mechanism,
    rows: GroupRows,
    closed: Sequence[int],
    vectors: Sequence[Exprs],
    turned: Sequence[Exprs],
    span: Span,
) -> tuple[dict[int, Expr], Expr]:
    """Return the rates of a group's variables times a determinant, and that.

    `vectors` (3,) are those of all variables, `turned` (3,) what pairs turn by besides the
    rates that are looked for; `closed` pairs are those that such rates were found of.
    """
    group, unknowns = rows.group, rows.unknowns
    loops = []
    for loop in rows.ways:
        columns: dict[int, Exprs] = {}
        rest: Exprs = vector([0.0, 0.0, 0.0])
        for number, sense, enters, leaves in _passed(mechanism, group, loop):
            for variable in mechanism.variables_of(number):
                columns[variable] = vectors[variable] * float(sense)
            between = way(mechanism.ends, closed, enters, leaves)
            for pair, sign in ((number, sense), *between):
                rest = rest + turned[pair] * float(sign)
        loops.append((columns, rest))
    if rows.chosen is not None:
        used = [(vectors[v], *loops[number]) for number, v in rows.chosen]
    else:
        used = [
            (along, columns, rest)
            for private, (columns, rest) in zip(rows.private, loops, strict=True)
            for along in (
                [cross(*(columns[v] for v in private))] if private else constants(np.eye(3))
            )
        ]
    matrix: list[list[Expr]] = [
        [dot(along, columns[v]) if v in columns else 0.0 for v in unknowns]
        for along, columns, _ in used
    ]
    right = [dot(along, rest) for along, _, rest in used]
    scale, shares = determinant(matrix), cofactors(matrix)
    rates: dict[int, Expr] = {
        variable: -1.0 * dot(right, [row[k] for row in shares])
        for k, variable in enumerate(unknowns)
    }
    for private, (columns, rest) in zip(rows.private, loops, strict=True):
        if private:
            square = span(*private)
            if isinstance(square, float) and square < COINCIDENT**2:
                names = [mechanism.variable_names[v] for v in private]
                raise EngineError(
                    f"{mechanism.name}: the axes of {names[0]} and {names[1]} coincide in "
                    "a link, so these two cannot be told apart",
                    WITHOUT_EXPRESSIONS,
                )
            both = _private_rates(private, columns, rest, scale, rates, square)
            rates |= zip(private, both, strict=True)
    return rates, scale


def _private_rates(
    private: tuple[int, ...],
    columns: dict[int, Exprs],
    given: Exprs,
    scale: Expr,
    rates: Mapping[int, Expr],
    square: Expr | None,
) -> tuple[Expr, Expr]:
    """Return those of the two variables eliminated from a loop: S + x A + y B = 0."""
    a, b = (columns[v] for v in private)
    others = [v for v in columns if v not in private]
    if len(rates) == 1 and len(others) == 1:
        # The bac-cab rule: no division, and no cancellation of S.
        turned = cross(given, columns[others[0]])
        return dot(b, turned), -1.0 * dot(a, turned)
    rest = given * scale
    for variable in others:
        rest = rest + columns[variable] * rates[variable]
    normal = cross(a, b)
    share = 1.0 / (dot(normal, normal) if square is None else square)
    # In this order what multiplies the rest is the same for all right-hand sides.
    return (
        dot(cross(normal, b) * share, rest),
        dot(cross(a, normal) * share, rest),
    )
