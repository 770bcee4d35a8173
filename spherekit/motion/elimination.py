"""All closed configurations of groups of R pairs with up to three loops, by elimination.

Bars are taken out, one for each loop, until what is left is a tree; the arc of each bar is
one equation, linear in the cosine and sine of each angle of the tree
(`spherekit.sphere.trigonometric`). A bar is a body with two R pairs; with its neighbours
placed, its arc between them is the only condition, and it follows from its axes. No
structure is known by name: what matters is which bars there are.

The closed configurations of a mechanism: all at its inputs, or some over their ranges.

All at one choice of the inputs are found group after group in the order of planning: both
modes of a dyad, and of an irreducible group all that elimination or a search finds.

All closed configurations of one irreducible group at one sample, and by which method.

The binary links of a group as arcs between two other bodies, and how they are placed.

A body with two R pairs keeps one axis of each of its neighbours at a fixed arc. With the
neighbours placed, that arc is the only condition, and the body follows from its axes.

Searching the configurations of a mechanism over the range of its inputs at random.

With one input the input is unknown too: a start goes to the configuration curves, so that
one that is short along the input is met as well as others, and not only where an input
probed happens to lie in it. With several each start has the inputs of one sample. Where
wheels are in mesh, each start has an input and the lengths rolled that belong to it.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain, combinations, islice, permutations, repeat
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Array, Bools, Complexes, Floats, Indices, SmallIntegers
from spherekit.conventions import CLOSURE_TOLERANCE
from spherekit.model.graph import spanning
from spherekit.motion.assembly_modes import Solver, flatness
from spherekit.motion.closure import Closure
from spherekit.motion.groups import (
    State,
    group_closure,
    group_tree,
    group_variables,
    place_dyad,
)
from spherekit.motion.loops import (
    Linearisation,
    condition,
    pair_angle,
    penetrates,
)
from spherekit.motion.meshes import GearPhases
from spherekit.motion.search import (
    POLISHING_STEPS,
    SEED,
    STARTS,
    Distinct,
    damped,
    search,
    starting_range,
)
from spherekit.motion.steps import determinant_sign
from spherekit.motion.turns import whole_laps
from spherekit.numeric.crossings import wrap
from spherekit.planning.inputs import Group
from spherekit.sphere.paths import dot
from spherekit.sphere.rotation import cross, max_abs, transpose
from spherekit.sphere.trigonometric import (
    all_angles,
    common_angles,
    determinants,
    eliminated_degree,
    point,
    taking,
)

NEARLY_REAL = 0.03
"""Roots with a smaller imaginary part are tried: double ones have some by rounding."""
REAL = 1e-7
"""Roots with a smaller imaginary part are taken for real."""
POINTLIKE = 1e-5
"""A bar of smaller arc (its sine) is not well described by the cosine of its arc."""
MOST_ORDERS = 8
"""Orders of elimination tried until one is certain to have lost nothing."""

_TURN = np.zeros((3, 3, 3))
_TURN[0, 2, 2] = _TURN[1, 0, 0] = _TURN[1, 1, 1] = _TURN[2, 1, 0] = 1.0
_TURN[2, 0, 1] = -1.0
"""A rotation about z is this (3, 3, 3) times its point (1, cos, sin)."""


def has_elimination(group: Group) -> bool:
    """Return whether all solutions of a group may be found by elimination."""
    return group.revolute and len(group.bodies) in (5, 7) and bool(orders_of(group))


def eliminated(group: Group, closure: Closure) -> tuple[Floats, Bools, str]:
    """Return all solutions of a group that has an elimination, at one sample.

    `closure` is the group's own, with a single sample.

    Returns
    -------
    values, real, problem
        Angles (k, pairs) rad of nearly closed configurations; (k,) which are real as far as
        rounding tells, so that a closed one must be next to them; and why a real solution
        may be missing, empty if none can be.
    """
    states = closure.at(np.zeros((1, len(group.pairs)))).states
    frames = Frames(group, np.moveaxis(np.stack([states.first, states.second]), 1, 2))
    values, real = [np.empty((0, len(group.pairs)))], [np.empty(0, dtype=bool)]
    problem = "a link has an arc of about 0 or 180 deg"
    if min(map(frames.sine, bars_of(group))) < POINTLIKE:
        return values[0], real[0], problem
    for order in orders_of(group):
        solved, problem = common_angles(frames.equations(order)[0], order.involves)
        imaginary = max_abs(solved.imag, axis=1)
        tried = imaginary < NEARLY_REAL
        values.append(frames.angles(frames.placed(order, solved[None, tried].real)))
        real.append(imaginary[tried] < REAL)
        if not problem:
            return values[-1], real[-1], ""
    return np.concatenate(values), np.concatenate(real), problem


@lru_cache
def bars_of(group: Group) -> dict[int, list[tuple[int, int]]]:
    """Return the bodies of a group that have two pairs, with two other bodies.

    The pairs by their places in the group, each with the body that it leads to.
    """
    bars = {}
    for body in range(len(group.bodies)):
        ways = [(k, sum(ends) - body) for k, ends in enumerate(group.ends) if body in ends]
        if len(ways) == len({other for _, other in ways}) == 2:
            bars[body] = ways
    return bars


class Order(NamedTuple):
    """A tree left by bars, in an order in which its angles can be eliminated.

    `root` is a body of the tree, `pairs` are its pairs, that of the remaining angle first;
    `bars` are the bodies whose arcs are the equations, `ways` the pairs that each spans.
    """

    root: int
    pairs: tuple[int, ...]
    bars: tuple[int, ...]
    ways: tuple[tuple[int, ...], ...]

    @property
    def involves(self) -> Bools:
        """(t, t) which equation has which angle in it."""
        return np.array([[pair in way for pair in self.pairs] for way in self.ways])

    @property
    def roots(self) -> int:
        """Number of complex solutions, 0 if the angles cannot be eliminated so."""
        return 2 * eliminated_degree(self.involves)


@lru_cache
def orders_of(group: Group) -> tuple[Order, ...]:
    """Return the first orders of fewest solutions, the same ones every time."""
    orders, bars = [], bars_of(group)
    for out in combinations(bars, group.loops):
        root = min({*range(len(group.bodies))} - {*out})
        pairs = [k for k, ends in enumerate(group.ends) if not {*out} & {*ends}]
        spans = {bar: [body for _, body in bars[bar]] for bar in out}
        if len(pairs) != len(out) or any({*out} & {*span} for span in spans.values()):
            continue
        ways = {bar: _way(group, pairs, *span) for bar, span in spans.items()}
        for sequence in permutations(pairs):
            for taken in permutations(out):
                order = Order(root, sequence, taken, tuple(ways[bar] for bar in taken))
                # of the last two, one order is enough
                if order.roots and taken[-2:] == tuple(sorted(taken[-2:])):
                    orders.append(order)
    least = min((order.roots for order in orders), default=0)
    return tuple(order for order in orders if order.roots == least)[:MOST_ORDERS]


def _way(group: Group, pairs: Sequence[int], start: int, goal: int) -> tuple[int, ...]:
    """Return the pairs from one body of a tree to another, in order."""
    came = {
        body: (pair, other) for pair, other, body in spanning(group.ends, [start], pairs)
    }
    way: list[int] = []
    while goal in came:
        pair, goal = came[goal]
        way.insert(0, pair)
    return tuple(way)


@dataclass(frozen=True)
class Frames:
    """The pair frames (2, pairs, n, 3, 3) of a group's bodies: in the first, in the second.

    R_second = R_first first Z(angle) second^T, R from body axes to those of body 0, for n
    samples, real or complex.
    """

    group: Group
    sides: Array

    def of_pair(self, pair: int, body: int) -> Array:
        """Return the frames (n, 3, 3) of a pair in one of its bodies."""
        return self.sides[self.group.ends[pair].index(body), pair]

    def _axes(self, bar: int) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
        """Return the unit axes (n, 3) of a bar's pairs: in it, in the bodies it joins."""
        ways = bars_of(self.group)[bar]
        outer = tuple(self.of_pair(pair, body)[..., 2] for pair, body in ways)
        return tuple(self.of_pair(pair, bar)[..., 2] for pair, _ in ways), outer

    def sine(self, bar: int) -> float:
        """Return the least sine of a bar's arc; at 0 it spins between its neighbours."""
        return float(np.min(np.linalg.norm(cross(*self._axes(bar)[0]), axis=-1)))

    def equations(self, order: Order) -> Array:
        """Return the equations (n, t, 3, ..., 3) of bars in the tree's angles."""
        return np.stack([self._equation(order, k) for k in range(len(order.bars))], axis=1)

    def _equation(self, order: Order, number: int) -> Array:
        way, bar = order.ways[number], order.bars[number]
        inner, (spread, moving) = self._axes(bar)
        body, count = bars_of(self.group)[bar][0][1], len(order.pairs)
        for pair in way:
            ahead = self.group.ends[pair][0] == body
            further = sum(self.group.ends[pair]) - body
            one, other = self.of_pair(pair, body), self.of_pair(pair, further)
            turn = one[:, None] @ (_TURN if ahead else transpose(_TURN))
            turned = turn @ transpose(other)[:, None]
            spread = np.einsum("n...i,nxik->n...xk", spread, turned)
            body = further
        spread = np.einsum("n...i,ni->n...", spread, moving)
        within = [angle for angle in range(count) if order.pairs[angle] in way]
        places = [1 + way.index(order.pairs[angle]) for angle in within]
        equation = np.zeros((len(spread), *[3] * count), dtype=spread.dtype)
        held = (slice(None) if angle in within else 0 for angle in range(count))
        equation[slice(None), *held] = np.transpose(spread, [0, *places])
        equation.reshape(len(spread), -1)[:, 0] -= dot(*inner)
        return equation

    def placed(self, order: Order, angles: Array) -> Array:
        """Return orientations (n, m, bodies, 3, 3) at angles (n, m, t) of the tree."""
        ends = self.group.ends
        placed = np.empty((*angles.shape[:2], len(self.group.bodies), 3, 3), angles.dtype)
        placed[:, :, order.root] = np.eye(3)
        for pair, body, further in spanning(ends, [order.root], order.pairs):
            sense = 1.0 if ends[pair][0] == body else -1.0
            angle = sense * angles[..., order.pairs.index(pair)]
            turn = np.tensordot(point(angle), _TURN, 1)
            one, other = self.of_pair(pair, body), self.of_pair(pair, further)
            step = one[:, None] @ turn @ transpose(other)[:, None]
            placed[:, :, further] = placed[:, :, body] @ step
        for bar in order.bars:
            inner, outer = self._axes(bar)
            there = [
                (placed[:, :, body] @ axis[:, None, :, None])[..., 0]
                for (_, body), axis in zip(bars_of(self.group)[bar], outer, strict=True)
            ]
            turned = taking(*(axis[:, None] for axis in inner), *there)
            placed[:, :, bar] = turned if np.iscomplexobj(placed) else turned.real
        return transpose(placed[:, :, :1]) @ placed

    def angles(self, placed: Floats) -> Floats:
        """Return the angles (m, pairs) rad of pairs between bodies (1, m, bodies, 3, 3)."""
        one, other = (
            placed[0][:, [ends[side] for ends in self.group.ends]] @ self.sides[side][:, 0]
            for side in (0, 1)
        )
        return pair_angle(one, other)

    def solutions(self, order: Order) -> tuple[Complexes, Complexes]:
        """Return all solutions (n, roots, t) of the tree's angles, rad, and determinants.

        Those (n, roots) of the equations' derivatives; NaN where a solution is missing.
        """
        equations = self.equations(order)
        angles = all_angles(equations, order.involves)
        return angles, determinants(equations, angles)


DIGITS = 6
"""Decimals of an angle (rad) that tell modes apart where they are put in order."""
MOVED = 1e-2
"""Farthest (rad) that an angle of a real root moves until the group is closed."""


class Method(NamedTuple):
    """How the modes of one group were found.

    `doubt` orders methods: 0 where no real mode at the inputs probed can be missing, the
    more the worse.
    """

    words: str
    doubt: float = 0.0


CLOSED_FORM = Method("closed form")
"""The method of dyads, and of trains of wheels, which have one mode."""
SEARCH = Method("search", 1.0)


def solutions(
    group: Group, closure: Closure, given: Floats | None = None
) -> tuple[list[Floats], Method]:
    """Return the closed configurations (variables,) of a group, and the method.

    All of them where an elimination applies and is sound, else those that it and a
    search from random starts find, which tries those `given` (n, variables) first.
    `closure` is the group's own, with a single sample.
    The order is that of the angles and the same every time.
    """
    distinct, words, method = Distinct(closure), SEARCH.words, None
    if has_elimination(group):
        near, real, problem = eliminated(group, closure)
        at = closure.solve(near, iterations=POLISHING_STEPS)
        closed = at.gap < CLOSURE_TOLERANCE
        moved = max_abs(wrap(at.values - near), axis=1)
        if np.any(real & ~(closed & (moved < MOVED))):
            problem = problem or "a real root led to no closed configuration"
        distinct.add(at.values[closed])
        words = f"{words} ({problem})"
        if not problem:
            method = Method(f"elimination: all {orders_of(group)[0].roots} complex roots")
    if method is None:
        census = search(closure, distinct, given)
        method = Method(f"{words}: {census.words('modes')}", census.share)
    return sorted(distinct.values, key=in_order), method


def in_order(mode: Floats) -> list[float]:
    """Return a key that puts modes in order by their angles, whatever rounding does.

    Angles of a half turn are above zero, on either side of where they begin anew.
    """
    angles = np.round(wrap(mode), DIGITS)
    turned = np.where(angles <= np.round(-np.pi, DIGITS), -angles, angles)
    return turned.tolist()


def least_complete(*methods: Method | None) -> Method | None:
    """Return the method that guarantees least; None stands for not used."""
    return max(filter(None, methods), key=lambda method: method.doubt, default=None)


def all_complete(methods: Iterable[Method | None]) -> bool:
    """Return whether no real mode can be missing."""
    return not any(method and method.doubt for method in methods)


FLAT_SIGN = 1e-8
"""Groups of a smaller reciprocal condition have no sign."""
MOST_ASSEMBLY_MODES = 64
"""Assembly modes of one run; a mechanism of many dyads has 2 to their number."""
RANGE_ROUNDS = 4
"""Rounds of a search over a range at least."""
FLAT = 1e-5
"""Configurations nearer to a dead centre (relative singular value) are not told apart."""


class Assemblies(NamedTuple):
    """The k modes at one choice of the inputs.

    `signs` are those of dyads, `values` (k, variables) rad; `methods[g]` says how the modes
    of group g were found: the least complete way, None if none of the groups before closes.
    """

    signs: tuple[tuple[int, ...], ...]
    values: Floats
    methods: tuple[Method | None, ...]

    @property
    def is_complete(self) -> bool:
        """Whether no real mode can be missing."""
        return all_complete(self.methods)


def assemblies(solver: Solver, q: Floats) -> Assemblies:
    """Return every mode found at inputs q (inputs,), and how."""
    methods: list[Method | None] = [None] * len(solver.assembly.groups)
    searched = any(
        not group.revolute and number not in solver.trains
        for number, group in enumerate(solver.assembly.groups)
    )
    if searched and solver.meshes is not None and solver.meshes.all_known:
        there = _modes_in_mesh(solver, solver.meshes, q)
        signs = tuple(signs_at(solver, values) for values in there)
        return Assemblies(signs, there, (SEARCH,) * len(methods))
    every = chains(solver, q[None], 4 * MOST_ASSEMBLY_MODES, methods)
    values = np.reshape(
        [state.values[0] for _, state in every], (-1, len(solver.mechanism.variable_owners))
    )
    return Assemblies(tuple(signs for signs, _ in every), values, tuple(methods))


def _modes_in_mesh(solver: Solver, meshes: GearPhases, q: Floats) -> Floats:
    """Return the closed configurations (n, variables) found with wheels in mesh."""
    near = q - whole_laps(q - meshes.anchor, meshes.periods)
    held = np.append(near, meshes.rolled(near[None]))[None]
    locked = solver.closure.locked([*solver.driven, *meshes.variables], held)
    distinct = Distinct(locked)
    search(locked, distinct)
    values = np.reshape(distinct.values, (-1, len(solver.closure.tree.owners)))
    return solver.moved(values, q[None])


def chains(
    solver: Solver, q: Floats, most: int, methods: list[Method | None] | None = None
) -> list[tuple[tuple[int, ...], State]]:
    """Return dyad signs and states of the modes that close at any of inputs q (n, inputs).

    At most so many. The `methods` of groups are noted; those other than dyads and trains of
    wheels are placed at a single input.
    """

    def extend(
        state: State, signs: tuple[int, ...]
    ) -> Iterator[tuple[tuple[int, ...], State]]:
        number = len(signs)
        if number == len(solver.assembly.groups):
            yield signs, state
            return
        grown, method = _grown(solver, state, number, q)
        if methods is not None:
            methods[number] = least_complete(methods[number], method)
        for sign, further in grown:
            yield from extend(further, (*signs, sign))

    with np.errstate(invalid="ignore", divide="ignore"):
        return list(islice(extend(solver.start(q), ()), most))


def _grown(
    solver: Solver, state: State, number: int, q: Floats
) -> tuple[list[tuple[int, State]], Method]:
    """Return the states in which a group is placed, with dyad signs, and the method.

    It is the group of that number; q (n, inputs) are the inputs.
    """
    group, grown = solver.assembly.groups[number], []
    if group.is_dyad or number in solver.trains:
        for sign in (1, -1) if group.is_dyad else (0,):
            further = state.copy()
            if sign:
                place_dyad(further, group, sign)
            else:
                further.lost |= ~(solver.place(further, number, q).gap < CLOSURE_TOLERANCE)
            if not np.all(further.lost):
                grown.append((sign, further))
        return grown, CLOSED_FORM
    reference = solver.reference
    variables = group_variables(state, group)
    given = None if reference is None else reference[None, variables]
    closure = group_closure(state, group)
    configurations, method = solutions(group, closure, given)
    if configurations:
        at = closure.solve(np.array(configurations))
        for row, values in enumerate(at.values):
            further = state.copy()
            further.merge(group, at.placed[row : row + 1])
            further.values[:, variables] = values
            grown.append((0, further))
    return grown, method


def signs_at(solver: Solver, values: Floats) -> tuple[int, ...]:
    """Return the dyad signs of a closed configuration (variables,), 0 for other groups."""
    signs = zip(
        solver.assembly.groups, group_signs(solver, values[None], 0.0)[0], strict=True
    )
    return tuple((1 if sign >= 0 else -1) if g.is_dyad else 0 for g, sign in signs)


def group_matrices(solver: Solver, at: Linearisation, number: int) -> Floats:
    """Return matrices (n, k, m) of a group, whose determinants tell its modes apart.

    A dyad's axes, the velocity equations of another group.
    """
    group = solver.assembly.groups[number]
    if group.is_dyad:
        return at.axes[:, list(group.pairs)]
    variables = [v for pair in group.pairs for v in solver.mechanism.variables_of(pair)]
    return group_tree(group, solver.joints).jacobian(at.vectors[:, variables])


def group_signs(solver: Solver, values: Floats, least: float = FLAT_SIGN) -> SmallIntegers:
    """Return the signs (n, groups) that tell modes of closed configurations apart.

    Of the triple product of a dyad's axes and of the determinant of another group's
    velocity equations: 0 where their reciprocal condition is below the `least`, and of
    groups that have none, but 1 of these where the `least` is 0.
    """
    at = solver.closure.at(values)
    signs = np.zeros((len(values), len(solver.assembly.groups)), dtype=np.int8)
    for number in range(signs.shape[1]):
        matrices = group_matrices(solver, at, number)
        _, rows, columns = matrices.shape
        signs[:, number] = np.nan_to_num(determinant_sign(matrices))
        if least:
            signs[:, number] *= (rows == columns) & (condition(matrices) < 1.0 / least)
    return signs


def random_starts(
    solver: Solver,
    low: Floats,
    high: Floats,
    samples: Floats | None = None,
    seed: int = SEED,
) -> Iterator[tuple[int, Floats, Indices]]:
    """Yield what rounds of random starts over a range lead to, the same ones every time.

    `RANGE_ROUNDS` rounds first, then one after another: how many starts, configurations
    (k, variables) that close, and the sample (k,) of each where the inputs are kept. Those
    whose contacts do not exist, or that lie at a dead centre, are left out.

    Parameters
    ----------
    low, high
        (inputs,) rad, the range.
    samples
        (n, inputs) the inputs to start at if they are to be kept.
    """
    random, closure, meshes = np.random.default_rng(seed), solver.closure, solver.meshes
    driven = list(solver.driven)
    first, last = starting_range(closure)
    first[driven], last[driven] = low, high
    rolled = [] if meshes is None else list(meshes.variables)
    held = driven + rolled if meshes is not None or samples is not None else []
    is_input = np.isin(np.arange(len(first)), driven)
    least, most = np.where(is_input, first, -np.inf), np.where(is_input, last, np.inf)
    turning = [v for v in solver.angles if v not in driven]
    for count in chain([RANGE_ROUNDS], repeat(1)):
        values = random.uniform(first, last, (count * STARTS, len(first)))
        rows = np.zeros(len(values), dtype=np.intp)
        if samples is not None:
            rows = random.integers(0, len(samples), len(values))
            values[:, driven] = samples[rows]
        with np.errstate(all="ignore"):
            if meshes is not None:
                values[:, rolled] = meshes.rolled(values[:, driven])
            values, near = damped(closure, values, held, least, most)
            at = closure.solve(values[near], driven + rolled, iterations=POLISHING_STEPS)
            reciprocal_condition = flatness(at.jacobian[:, :, ~is_input])
            good = (at.gap < CLOSURE_TOLERANCE) & np.all(at.states.inside, axis=1)
            good &= (reciprocal_condition > FLAT) & ~penetrates(closure.joints, at.states)
        at.values[:, turning] = wrap(at.values[:, turning])
        yield len(near), at.values[good], rows[near][good]
