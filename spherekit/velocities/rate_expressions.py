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

from collections import Counter
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from spherekit.arrays import Floats
from spherekit.errors import EngineError
from spherekit.mechanism.graph import component_labels, find_spanning_tree
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import Assembly, Group
from spherekit.symbolic.expression_graph import ADVICE_WITHOUT_EXPRESSIONS, Expr, dot
from spherekit.symbolic.vector_algebra import (
    Exprs,
    cofactors,
    constants,
    cross,
    determinant,
    vector_sum,
)

Way = tuple[tuple[int, int], ...]
"""Pairs with senses, in order; sense +1 goes from a pair's first link to its second."""

LARGEST = 6
"""Most equations of a group that are solved together by determinants."""

AXES = constants(np.eye(3))
"""Directions along which a loop has equations where none of its variables are private."""

WITHOUT_PRIVATE = -1
"""In place of a variable: the equation of a loop without its two private variables."""

INDEPENDENT = 1e-6
"""Equations of unit size nearer than this to being combinations of others repeat them."""


def _leaves(group: Group) -> dict[int, list[int]]:
    """Return bodies with two pairs that can be left out, each with these two pairs."""
    leaves: dict[int, list[int]] = {}
    for body in reversed(range(len(group.bodies))):
        at = [pair for pair, ends in enumerate(group.ends) if body in ends]
        neighbours = {other for pair in at for other in group.ends[pair]} - {body}
        if len(at) == len(neighbours) == 2 and not neighbours & leaves.keys():
            out = {*leaves, body}
            kept = [k for k, ends in enumerate(group.ends) if not out & set(ends)]
            rest = [other for other in range(len(group.bodies)) if other not in out]
            if len(find_spanning_tree(group.ends, rest[:1], kept)) == len(rest) - 1:
                leaves[body] = at
    return leaves


def _loops(mechanism: Mechanism, group: Group, closed: Sequence[int]) -> list[Way]:
    """Return a loop for each leaf, then for each chord of the other bodies' tree.

    Links of one body are joined by `closed` pairs. The pairs that close a loop come last,
    sliding contacts among them if possible.
    """
    leaves, ends = _leaves(group), group.ends
    inner = [pair for pair, both in enumerate(ends) if not leaves.keys() & set(both)]
    tree: list[int] = []
    for pair in sorted(inner, key=lambda k: len(mechanism.variables_of(group.pairs[k]))):
        body = component_labels(len(group.bodies), [ends[k] for k in tree])
        if body[ends[pair][0]] != body[ends[pair][1]]:
            tree.append(pair)
    last = [
        (second, [first], 1 if ends[second][0] == k else -1)
        for k, (first, second) in leaves.items()
    ]
    last += [(pair, [], 1) for pair in inner if pair not in tree]
    loops = []
    for chord, more, sense in last:
        pair, used = group.pairs[chord], [group.pairs[k] for k in (*tree, *more)]
        start, end = mechanism.ends[pair][::sense]
        back = _way(mechanism.ends, [*closed, *used], end, start)
        loops.append((*back, (pair, sense)))
    return loops


def _way(
    ends: Sequence[tuple[int, int]], pairs: Sequence[int], start: int, end: int
) -> Way:
    """Return the pairs, with senses, that lead from a link to another."""
    ways: dict[int, Way] = {start: ()}
    for pair, old, new in find_spanning_tree(ends, [start], pairs):
        ways[new] = (*ways[old], (pair, 1 if ends[pair][0] == old else -1))
    return ways[end]


class GroupEquations:
    """How the loops of a group of an assembly give the rates of its variables.

    `loops` lead through its pairs and those closed before; `private[loop]` are the two
    variables eliminated from its equations, or none; `unknowns` remain to be solved
    together. Where equations repeat, `chosen` are (loop, variable): the loop's equation
    along the vector of a variable, or with `WITHOUT_PRIVATE` the one that is free of the
    loop's private variables. `pose_vectors()` gives the variables' vectors (variables, 3)
    at one configuration, at which they are chosen.

    Raises
    ------
    EngineError
        If there are more equations to solve together than is sensible.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        assembly: Assembly,
        group: Group,
        pose_vectors: Callable[[], Floats],
    ) -> None:
        self.mechanism, self.pairs = mechanism, group.pairs
        before = assembly.groups[: assembly.groups.index(group)]
        closed = [*assembly.inputs, *(pair for other in before for pair in other.pairs)]
        self.loops = _loops(mechanism, group, closed)
        crossed = Counter(pair for loop in self.loops for pair, _ in loop)
        once = [
            [
                v
                for pair, _ in reversed(loop)
                if crossed[pair] == 1 and pair in self.pairs
                for v in self._owned(pair)
            ]
            for loop in self.loops
        ]
        every = [v for pair in self.pairs for v in self._owned(pair)]
        # Equations that repeat each other are chosen one by one where they are few. Only
        # where they are many, two variables of each loop are eliminated first.
        is_eliminating = not group.redundant or len(every) > LARGEST
        self.private = [
            columns[:2] if is_eliminating and len(columns) > 1 else [] for columns in once
        ]
        gone = {v for both in self.private for v in both}
        self.unknowns = [v for v in every if v not in gone]
        self.chosen = self._independent(pose_vectors()) if group.redundant else None
        if len(self.unknowns) > LARGEST:
            raise EngineError(
                f"{mechanism.name}: a {group.kind} leaves {len(self.unknowns)} equations "
                f"to be solved together, expressions take at most {LARGEST}",
                ADVICE_WITHOUT_EXPRESSIONS,
            )

    def _owned(self, pair: int) -> tuple[int, ...]:
        return self.mechanism.variables_of(pair)

    def _independent(self, vectors: Floats) -> list[tuple[int, int]]:
        """Choose rows by the pivots of a QR decomposition, one for each unknown."""
        from scipy.linalg import qr

        rows: dict[tuple[int, int], Floats] = {}
        for number, (loop, private) in enumerate(
            zip(self.loops, self.private, strict=True)
        ):
            weights = np.zeros(len(vectors))
            for pair, sense in loop:
                weights[list(self._owned(pair))] += sense
            columns = weights[:, None] * vectors
            directions = {v: vectors[v] for v in np.flatnonzero(weights).tolist()}
            if private:
                one, other = private
                directions = {WITHOUT_PRIVATE: np.cross(columns[one], columns[other])}
            for variable, direction in directions.items():
                row = columns @ direction
                size = float(np.linalg.norm(row))
                # An equation whose coefficients are rounding errors says nothing: the
                # private axes are parallel, or all axes of the loop lie in one plane.
                if size > INDEPENDENT * max(float(np.linalg.norm(direction)), INDEPENDENT):
                    rows[number, variable] = row[self.unknowns] / size
        count, keys = len(self.unknowns), list(rows)
        unit_rows = np.reshape([*rows.values()], (len(rows), count))
        _, triangle, order = qr(unit_rows.T, mode="economic", pivoting=True)
        sizes = np.abs(np.diagonal(triangle))
        if len(sizes) < count or np.min(sizes[:count], initial=1.0) < INDEPENDENT:
            raise EngineError(
                f"{self.mechanism.name}: its equations leave more than one motion at the "
                "configuration they were chosen at; change the range of the input",
                ADVICE_WITHOUT_EXPRESSIONS,
            )
        return [keys[k] for k in order[:count]]

    def rates(
        self, vectors: Sequence[Exprs], turned: Sequence[Exprs]
    ) -> tuple[dict[int, Expr], Expr]:
        """Return the rates of its variables times a determinant, and that.

        `vectors` (3,) are those of all variables, `turned` (3,) what pairs turn by besides
        the rates that are looked for.
        """
        loops: list[tuple[dict[int, Exprs], Exprs]] = []
        used: list[tuple[Exprs, dict[int, Exprs], Exprs]] = []
        for loop, private in zip(self.loops, self.private, strict=True):
            columns = {
                v: vectors[v] * float(sense)
                for pair, sense in loop
                if pair in self.pairs
                for v in self._owned(pair)
            }
            rest = vector_sum(turned[pair] * float(sense) for pair, sense in loop)
            loops.append((columns, rest))
            ways = [cross(*(columns[v] for v in private))] if private else AXES
            used += [(along, columns, rest) for along in ways]
        if self.chosen is not None:
            used = []
            for number, v in self.chosen:
                columns, rest = loops[number]
                along = vectors[v]
                if v == WITHOUT_PRIVATE:
                    along = cross(*(columns[x] for x in self.private[number]))
                used.append((along, columns, rest))
        matrix: list[list[Expr]] = [
            [dot(along, columns[v]) if v in columns else 0.0 for v in self.unknowns]
            for along, columns, _ in used
        ]
        right = [dot(along, rest) for along, _, rest in used]
        scale, shares = determinant(matrix), cofactors(matrix)
        rates: dict[int, Expr] = {
            variable: -1.0 * dot(right, [row[k] for row in shares])
            for k, variable in enumerate(self.unknowns)
        }
        for private, (columns, rest) in zip(self.private, loops, strict=True):
            if private:
                both = _private_rates(private, columns, rest, scale, rates)
                rates |= zip(private, both, strict=True)
        return rates, scale


def _private_rates(
    private: Sequence[int],
    columns: dict[int, Exprs],
    given: Exprs,
    scale: Expr,
    rates: Mapping[int, Expr],
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
    share = 1.0 / dot(normal, normal)
    # In this order what multiplies the rest is the same for all right-hand sides.
    return (
        dot(cross(normal, b) * share, rest),
        dot(cross(a, normal) * share, rest),
    )
