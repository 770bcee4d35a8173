"""Everything that a run reads of a row, as terms of the pair variables.

The closure of the loops, the rates and their derivatives, all poles, and what each of them
may be off by: bounds of norms as in `spherekit.rates.errors.rough_errors`, with what
the numbers given leave over in the equations.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, final

import numpy as np

from spherekit.conventions import EPS
from spherekit.engine.algebra import Exprs, cross, dot, vector
from spherekit.engine.arrays import ArrayFunction, array_function
from spherekit.engine.block_elimination import LoopInverse, Pivot, loop_inverse, pivots_of
from spherekit.engine.cache import COMPILED
from spherekit.engine.compiler import CompiledFunction, compile_function
from spherekit.engine.expression_graph import Expr, ExpressionNode, function, symbols
from spherekit.engine.pose import Angles, LinkOrientation, place_by_variables, placed_by
from spherekit.engine.turns import TurningPairs, turning_pairs
from spherekit.model.mechanism import Mechanism
from spherekit.motion.loops import LoopTree
from spherekit.motion.motion import Motion
from spherekit.planning.poles import CoaxialPole, Pole, PrimaryPole
from spherekit.rates.columns import RateColumns, RowColumns
from spherekit.rates.request import Request
from spherekit.sphere.rotation import Floats

REFERENCES = 32
"""Configurations at most that say in which order variables are eliminated."""


@final
@dataclass(frozen=True)
class RowKernel:
    """A function of all pair variables (variables, n), see `row_kernel`.

    `poles` and `links` are those of each input that moves, `free` the variables that are no
    inputs. `function` gives the columns, `closing` these variables closer to where loops
    close, by a step of Newton's method.
    """

    poles: tuple[tuple[Pole, ...], ...]
    links: tuple[tuple[int, ...], ...]
    free: tuple[int, ...]
    flatness: float
    rounding: float
    function: CompiledFunction | ArrayFunction
    closing: CompiledFunction | ArrayFunction

    @property
    def width(self) -> int:
        """The number of columns."""
        parts = zip(self.poles, self.links, strict=True)
        return ROWS + sum(1 + 9 * len(poles) + 6 * len(links) for poles, links in parts)

    def __call__(self, values: Floats) -> Floats:
        """Return all columns (columns, n) of variables (variables, n)."""
        return np.asarray(self.function(np.ascontiguousarray(values)))

    def closer(self, values: Floats) -> Floats:
        """Return the variables `free`, (variables, n), closer to where loops close."""
        return np.asarray(self.closing(np.ascontiguousarray(values)))

    def read(self, rows: Floats) -> RowColumns:
        """Return columns by what they are, as views."""
        rates, at = [], ROWS

        def block(*shape: int) -> Floats:
            nonlocal at
            first, at = at, at + int(np.prod(shape))
            return rows[first:at].reshape(*shape, -1)

        for poles, links in zip(self.poles, self.links, strict=True):
            count = len(poles)
            worst = block(1)[0]
            w, dw = block(len(links), 3), block(len(links), 3)
            rates.append(
                RateColumns(
                    poles,
                    block(3, count),
                    block(2, count),
                    block(count),
                    block(3, count),
                    dict(zip(links, w, strict=True)),
                    dict(zip(links, dw, strict=True)),
                    worst,
                )
            )
        closure = rows[0], rows[1], rows[2]
        return RowColumns(*closure, rates, self.flatness, self.rounding)


ROWS = 3
"""Columns that do not depend on the input that moves."""


def row_kernel(
    motion: Motion, requests: Sequence[Request], engine: Literal["numpy", "compiled"]
) -> RowKernel | None:
    """Return the kernel of what `requests` want of a mechanism's rows.

    The closed configurations of a motion say in which order variables are eliminated.
    None where the terms do not hold: for contacts, for redundant loops, for none, and where
    axes of pairs coincide but for rounding.
    """
    mechanism, tree = motion.mechanism, LoopTree.of(motion.mechanism)
    free = motion.free
    good = np.flatnonzero(~motion.failed & (motion.configuration_error < 1e-6))
    if mechanism.has_contacts or not free or len(free) != 3 * len(tree.chords):
        return None
    if not len(good) or any(item.plan.rounded_axes for item in requests):
        return None
    chosen = good[np.unique(np.linspace(0, len(good) - 1, REFERENCES).astype(int))]
    pivots = pivots_of(motion.free_jacobian[chosen])
    if pivots is None:
        return None
    pivots = tuple((loop, (free[a], free[b], free[c])) for loop, (a, b, c) in pivots)
    wanted = tuple((item.plan.input, item.poles, item.derivatives) for item in requests)

    def make() -> RowKernel:
        variables = symbols(mechanism.variable_names)
        terms = _Rows(mechanism, variables, pivots, motion.assembly.inputs)
        outputs = terms.closure
        each = [terms.moving(item) for item in requests]
        for one in each:
            outputs += one.outputs
        closer = terms.closer(variables)
        made = compile_function if engine == "compiled" else array_function
        return RowKernel(
            tuple(one.poles for one in each),
            tuple(one.links for one in each),
            free,
            terms.flatness,
            terms.rounding,
            made(outputs, variables),
            made(closer, variables),
        )

    return COMPILED.get(mechanism, repr(("rows", wanted, pivots, engine)), make)


def _root(item: Expr) -> Expr:
    return function("sqrt", item)


def _norm(item: Exprs) -> Expr:
    return _root(dot(item, item))


def _zero() -> Exprs:
    return vector([0.0, 0.0, 0.0])


@final
class _Rows:
    """The terms of a row that do not depend on the input that moves."""

    def __init__(
        self,
        mechanism: Mechanism,
        variables: Sequence[ExpressionNode],
        pivots: Sequence[Pivot],
        inputs: Sequence[int],
    ) -> None:
        self.mechanism, self.tree = mechanism, LoopTree.of(mechanism)
        self.pairs: TurningPairs = turning_pairs(mechanism)
        self.placed = place_by_variables(mechanism, self.pairs, variables)
        self.inputs = inputs
        self.held = {mechanism.variables_of(pair)[0] for pair in inputs}
        self.free = [v for v in range(len(variables)) if v not in self.held]
        self.carriers, self.vectors = self._carried()
        self.inverse: LoopInverse = loop_inverse(self._columns, pivots)
        self._opened(variables)
        self._bounds()

    def _carried(self) -> tuple[list[int], list[Exprs]]:
        """Return the link that carries the axis of each variable, and the axes."""
        carriers, vectors = [], []
        for variable, spins in enumerate(self.pairs.spins):
            (own,) = spins
            other = self.pairs.twin[variable]
            held = min((own, other), key=lambda spin: self.placed[spin.link].depth)
            carriers.append(held.link)
            axis = self.placed[held.link].direction(held.axis)
            vectors.append(vector(list(axis * held.size)))
        return carriers, vectors

    @property
    def _columns(self) -> Mapping[int, Mapping[int, Exprs]]:
        """The closure Jacobian, by loop and free variable."""
        signs = self.tree.signs
        return {
            loop: {v: float(row[v]) * self.vectors[v] for v in self.free if row[v]}
            for loop, row in enumerate(signs)
        }

    def _opened(self, variables: Sequence[ExpressionNode]) -> None:
        """Set by how much loops are open: rotation vectors to first order, and the size."""
        angles = Angles(variables)
        self.gaps, square = [], 0.0
        for chord in self.tree.chords:
            a, b = self.tree.ends[chord]
            around = placed_by(self.pairs.chains[chord], self.placed[a], angles)
            one = self._axes(around)
            other = self._axes(self.placed[b])
            turns = [cross(y, x) for x, y in zip(one, other, strict=True)]
            self.gaps.append((turns[0] + turns[1] + turns[2]) * 0.5)
            for x, y in zip(one, other, strict=True):
                square = square + dot(x - y, x - y)
        self.residual = _root(square * 0.5)

    def _axes(self, placed: LinkOrientation) -> list[Exprs]:
        return [vector(list(placed.direction(axis))) for axis in np.eye(3)]

    def _bounds(self) -> None:
        """Set the bounds of what variables, orientations and axes are off by."""
        tree, blocks = self.tree, self.inverse.rows
        self.moved = {v: _size(row.values()) for v, row in blocks.items()}
        self.sensitivity = _root(_squares(self.moved.values()))
        turns: list[dict[int, Exprs]] = [{}] * tree.count
        for pair, parent, child in tree.placements:
            (variable,) = self.mechanism.variables_of(pair)
            turns[child] = dict(turns[parent])
            sense = 1.0 if tree.ends[pair][0] == parent else -1.0
            for loop, row in blocks.get(variable, {}).items():
                more = np.multiply.outer(sense * self.vectors[variable], row)
                old = turns[child].get(loop)
                turns[child][loop] = more if old is None else old + more
        paths = np.count_nonzero(tree.paths, axis=1)
        longest = int(np.max(np.count_nonzero(tree.signs, axis=1)))
        self.numbers = EPS * (2.0 + float(np.max(paths)))
        self.rounding = EPS * (2.0 + longest)
        self.gap = self.residual + self.rounding
        open_ = self.gap * float(np.sqrt(3.0 * len(tree.chords)))
        self.turns = [_size(each.values()) for each in turns]
        self.turned = [each * open_ for each in self.turns]
        self.axes = [self.turned[carrier] + self.numbers for carrier in self.carriers]
        entries = float(np.sum(tree.signs[:, self.free] ** 2))
        self.flatness = 1.0 / float(np.sqrt(entries))
        bend = float(longest) * (self.sensitivity * self.sensitivity) * self.gap
        root = _root(1.0 - 2.0 * bend)
        moved_by = self.sensitivity * self.gap * 2.0 / (1.0 + root)
        self.closure: list[Expr] = [
            self.residual,
            self.sensitivity,
            moved_by + 2.0 * EPS,
        ]

    def closer(self, variables: Sequence[ExpressionNode]) -> list[Expr]:
        """Return the free variables after a step of Newton's method."""
        step = self.inverse.solved(self.gaps)
        return [variables[v] - step[v] for v in self.free]

    def moving(self, wanted: Request) -> "_Moving":
        """Return what is wanted while one input moves."""
        return _Moving(self, wanted)


@final
class _Moving:
    """Rates while one input moves, and the poles wanted, as outputs."""

    def __init__(self, rows: _Rows, wanted: Request) -> None:
        tree, mechanism = rows.tree, rows.mechanism
        plan = wanted.plan
        (moved,) = mechanism.variables_of(plan.input)
        self._rows = rows
        rates = self._solved(
            [float(-sign[moved]) * rows.vectors[moved] for sign in tree.signs]
        )
        rates |= {v: 1.0 if v == moved else 0.0 for v in rows.held}
        over = self._left(rates, None)
        w = self._links(rates)
        turned = [
            cross(w[k], axis) for k, axis in zip(rows.carriers, rows.vectors, strict=True)
        ]
        bias = [
            _summed(
                [float(sign) * rates[v] * turned[v] for v, sign in enumerate(row) if sign]
            )
            for row in tree.signs
        ]
        change = self._solved([-1.0 * each for each in bias])
        change |= dict.fromkeys(rows.held, 0.0)
        bent = self._left(change, bias)
        dw = self._links(change, rates, turned)
        speeds, bends = _sizes(rates), _sizes(change)
        sizes, swings = ([_norm(each) for each in links] for links in (w, dw))
        slips = [speeds[v] * off for v, off in enumerate(rows.axes)]
        off_w, off_rates = self._off(slips, over)
        slips = [
            bends[v] * off
            + speeds[v] * (off_w[carrier] + sizes[carrier] * off)
            + sizes[carrier] * off_rates.get(v, 0.0)
            for v, (off, carrier) in enumerate(zip(rows.axes, rows.carriers, strict=True))
        ]
        off_dw, _ = self._off(slips, bent)
        numbers = rows.numbers
        worst: Expr = 0.0
        for item in off_dw:
            worst = worst + item
        pairs = {
            step.pole: step.pair
            for step in plan.steps
            if isinstance(step, PrimaryPole | CoaxialPole)
        }
        self.poles = tuple(p for p in wanted.poles if plan.pole(*p) is not None)
        self.links = tuple(
            link for link, body in enumerate(plan.body) if body in self._bodies(wanted)
        )
        columns: list[list[Expr]] = []
        for i, j in self.poles:
            own = plan.pole(i, j)
            assert own is not None
            v, dv = w[j] - w[i], dw[j] - dw[i]
            size, swing = sizes[i] + sizes[j], swings[i] + swings[j]
            e_w, e_dw = off_w[i] + off_w[j], off_dw[i] + off_dw[j]
            if own in pairs:
                (variable,) = mechanism.variables_of(pairs[own])
                unit, angle, length = rows.vectors[variable], 1.0, size
                rate = dot(v, unit)
                direction = rows.axes[variable]
            else:
                length = _norm(v)
                unit, rate = v * (1.0 / length), length
                angle = length / size
                direction = (e_w + numbers * size) / length
                worst = worst + direction
            e_rate = e_w + numbers * size + direction * direction * length
            e_change = e_dw + numbers * (size + swing) + direction * swing
            columns.append([*unit, rate, dot(dv, unit), angle, direction, e_rate, e_change])
        self.outputs: list[Expr] = [worst]
        self.outputs += [x for link in self.links for x in w[link]]
        self.outputs += [x for link in self.links for x in dw[link]]
        self.outputs += [x for column in zip(*columns, strict=True) for x in column]

    @staticmethod
    def _bodies(wanted: Request) -> set[int]:
        poles = (wanted.plan.pole(*pole) for pole in wanted.poles)
        return {b for pole in poles if pole for b in pole} | set(wanted.bodies)

    def _solved(self, right: Sequence[Exprs]) -> dict[int, Expr]:
        return self._rows.inverse.solved(right)

    def _left(self, rates: Mapping[int, Expr], bias: Sequence[Exprs] | None) -> Expr:
        """Return the size of what rates leave over in the equations."""
        rows, total = self._rows, 0.0
        for loop, row in enumerate(rows.tree.signs):
            parts = [
                float(sign) * rates[v] * rows.vectors[v]
                for v, sign in enumerate(row)
                if sign
            ]
            over = _summed(parts if bias is None else [*parts, bias[loop]])
            total = total + dot(over, over)
        return _root(total)

    def _off(self, slips: Sequence[Expr], over: Expr) -> tuple[list[Expr], dict[int, Expr]]:
        """Return what links and variables are off by, first or second derivatives.

        `slips` are what the terms of variables in the equations are off by, `over` what the
        equations have left.
        """
        rows = self._rows
        loops = [
            _added(slips[v] for v, sign in enumerate(row) if sign)
            for row in rows.tree.signs
        ]
        whole = _size([vector(loops)]) + over
        found = [turn * whole for turn in rows.turns]
        along: list[Expr] = [0.0] * rows.tree.count
        for pair, parent, child in rows.tree.placements:
            (variable,) = rows.mechanism.variables_of(pair)
            along[child] = along[parent] + slips[variable]
        links = [a + b for a, b in zip(found, along, strict=True)]
        return links, {v: moved * whole for v, moved in rows.moved.items()}

    def _links(
        self,
        rates: Mapping[int, Expr],
        held: Mapping[int, Expr] | None = None,
        turned: Sequence[Exprs] = (),
    ) -> list[Exprs]:
        """Return what links do at rates, with axes that turn meanwhile."""
        rows = self._rows
        found = [_zero()] * rows.tree.count
        for pair, parent, child in rows.tree.placements:
            (variable,) = rows.mechanism.variables_of(pair)
            part = rates[variable] * rows.vectors[variable]
            if held is not None:
                part = part + held[variable] * turned[variable]
            ahead = rows.tree.ends[pair][0] == parent
            found[child] = found[parent] + part if ahead else found[parent] - part
        return found


def _summed(parts: Sequence[Exprs]) -> Exprs:
    total = _zero()
    for part in parts:
        total = total + part
    return total


def _added(items: Iterable[Expr]) -> Expr:
    total: Expr = 0.0
    for item in items:
        total = total + item
    return total


def _squares(items: Iterable[Expr]) -> Expr:
    return _added(item * item for item in items)


def _size(parts: Iterable[Exprs]) -> Expr:
    """Return the root of the sum of the squares of all entries; 0 of none."""
    entries = [x for part in parts for x in np.ravel(part)]
    return _root(_squares(entries)) if entries else 0.0


def _sizes(items: Mapping[int, Expr]) -> dict[int, Expr]:
    """Return absolute values."""
    return {
        v: _root(x * x) if isinstance(x, ExpressionNode) else abs(x)
        for v, x in items.items()
    }
