"""Positions, poles, coefficients and the equation of motion of dyads, line by line.

Each formula gives a quantity by those before it, as in a paper (Di Gregorio 2024).
"""

from collections.abc import Collection, Sequence
from functools import partial
from itertools import permutations, product
from typing import Any, NamedTuple

import numpy as np

from spherekit.arrays import Floats
from spherekit.errors import EngineError
from spherekit.escaping import latex_text
from spherekit.exchange.latex_text import number
from spherekit.mechanism.elements import SizeGeometry
from spherekit.mechanism.graph import find_spanning_tree
from spherekit.mechanism.load import Component, TorqueTable, expression_of
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import Group, plan_assembly
from spherekit.planning.pole_plan import LinePole, Plan, PrimaryPole, pole_of, roman_numeral
from spherekit.planning.pole_planner import plan
from spherekit.planning.pole_sequence import group_by_circle
from spherekit.symbolic.expression_derivatives import differentiate
from spherekit.symbolic.expression_graph import (
    Expr,
    ExpressionNode,
    function,
    iterate_nodes,
    substitute,
    vector_product,
)
from spherekit.symbolic.expression_graph import dot as sum_of_products
from spherekit.symbolic.parsed_expressions import convert_to_graph
from spherekit.wording import listing

cross, inner = partial(vector_product, "cross"), partial(vector_product, "dot")
symbol = partial(function, "variable")


class Angle(NamedTuple):
    """An angle by its term, its cosine and its sine."""

    term: Expr = 0.0
    cosine: Expr = 1.0
    sine: Expr = 0.0


class Axis(NamedTuple):
    """An axis of a link, its arc from the first one, and the angle of that arc there."""

    term: ExpressionNode
    arc: Angle = Angle()
    turn: Angle = Angle()


class Formula(NamedTuple):
    """What a quantity is, a column where it has rows, and the section that says so."""

    section: str
    rows: list[Expr]


class Formulas:
    """The formulas of a mechanism given by sizes, and what they begin with.

    Attributes
    ----------
    lines
        Formulas by the symbols of their quantities, in order.
    given
        Meanings and values of the symbols that nothing gives.
    quantities
        The terms of each quantity, by the names of
        `spherekit.velocities.row_quantities.row_quantities` without components of vectors.
    left_out
        Loads whose friction follows from reactions.
    free_terms
        The symbols of the sizes that are free, by their slots.

    Raises
    ------
    EngineError
        If there is no closed form, or an arc is 0 or 180 degrees or signed.
    """

    def __init__(self, mechanism: Mechanism, ground: Floats, free: Collection[Any]) -> None:
        self.mechanism, self._free = mechanism, free
        self.free_terms: dict[Any, ExpressionNode] = {}
        self.lines: dict[ExpressionNode, Formula] = {}
        self.given: dict[ExpressionNode, tuple[str, str]] = {}
        self.quantities: dict[str, list[Expr]] = {}
        self.left_out: list[str] = []
        self._assembly, links = plan_assembly(mechanism), mechanism.links
        short = all(len(name) < 3 and name.isdigit() for name in links)
        self.index = links if short else [str(k + 1) for k in range(len(links))]
        self.inputs = self._assembly.inputs
        names = mechanism.names_of(self.inputs)
        self._several, self.moving = len(names) > 1, range(len(names))
        self.ends = [f"_by_{name}" * self._several for name in names]
        self._motion = [
            [self._give(self._numbered(letter, k), what) for k in self.moving]
            for letter, what in (
                ("q", "angle of an input (rad)"),
                (r"\dot{q}", "its rate (rad/s)"),
                (r"\ddot{q}", "its acceleration (rad/s$^2$)"),
            )
        ]
        self.angles = [
            symbol(rf"\theta_{{{self._of(*ends[::-1])}}}") for ends in mechanism.ends
        ]
        for pair, q in zip(self.inputs, self._motion[0], strict=True):
            self.angles[pair] = q
        self._pairs = [self._of(*sorted(ends)[::-1]) for ends in mechanism.ends]
        self.pair_axes = [_bold("u", of) for of in self._pairs]
        self._axes = [self._axes_of(link) for link in range(len(links))]
        self._frames: dict[int, list[Expr]] = {}
        self._place(ground)
        self.plans = [plan(mechanism, None, name) for name in names]
        self.poles = [self._find_poles(k, table) for k, table in enumerate(self.plans)]
        self._section = "Velocity coefficients"
        self._w: list[dict[int, Expr]] = []
        self._m: list[dict[int, Expr]] = []
        for k, table in enumerate(self.plans):
            self._find_coefficients(k, table)
        self._section, moved = "Acceleration coefficients", [*self.lines.items()]
        self._slopes = [self._find_slopes(k, moved) for k in self.moving]
        self._section = "Coefficients between moving links"
        for k in self.moving:
            self._name_coefficients(k)
        if mechanism.masses or mechanism.loads:
            self._section = "Equation of motion"
            self._move(self._forces())

    def needed(self, wanted: Sequence[Expr]) -> dict[ExpressionNode, Formula]:
        """Return the formulas that terms follow from; no more is then given."""
        kept = {*iterate_nodes(wanted)}
        for term, formula in reversed(self.lines.items()):
            if term in kept:
                kept.update(iterate_nodes(formula.rows))
        self.given = {term: said for term, said in self.given.items() if term in kept}
        return {term: formula for term, formula in self.lines.items() if term in kept}

    # Symbols.

    def _of(self, one: int, other: int) -> str:
        both = self.index[one], self.index[other]
        return ("" if max(map(len, both)) == 1 else ",").join(both)

    def _numbered(self, letter: str, k: int) -> str:
        return letter + f"_{{{k + 1}}}" * self._several

    def _moves(self, k: int) -> None:
        """Mark symbols by the input that moves, if there are several."""
        self._mark = rf"^{{({k + 1})}}" * self._several

    def _by(self, k: int, term: ExpressionNode) -> ExpressionNode:
        """Return the symbol of a derivative by an input."""
        name = term.arguments[0]
        return symbol(rf"\partial_{{{k + 1}}}{name}" if self._several else f"{name}'")

    def _give(self, name: str, meaning: str, value: str = "") -> ExpressionNode:
        self.given[symbol(name)] = meaning, value
        return symbol(name)

    def _put(self, term: ExpressionNode, *rows: Expr, always: bool = False) -> Expr:
        """Write a formula and return its symbol; of what is a symbol, that alone."""
        right = rows[0]
        if len(rows) == 1 and not always:
            bare = right.arguments[-1] if _is_opposite(right) else right
            if not isinstance(bare, ExpressionNode) or bare.operation == "variable":
                return right
        self.lines[term] = Formula(self._section, [*rows])
        return term

    def _line(self, letter: str, index: str, *rows: Expr) -> Expr:
        """Write a formula of a quantity with an index, while an input moves if one does."""
        return self._put(symbol(f"{letter}_{{{index}}}{self._mark}"), *rows)

    def _say(self, kind: str, of: str, *terms: Expr) -> None:
        self.quantities[f"{kind}_{of}"] = [*terms]

    # Sizes.

    def _size(self, slot: tuple[str, Any], name: str, value: float, what: str) -> Angle:
        free = slot in self._free
        degrees = rf"${number(float(np.degrees(value)))}^{{\circ}}$"
        term = self._give(name, what + ", free" * free, degrees)
        if free:
            self.free_terms[slot] = term
        values = float(np.cos(value)), float(np.sin(value))
        cosine, sine = (
            function(of, term) if free or abs(x - round(x)) > 1e-15 else float(round(x))
            for of, x in zip(("cos", "sin"), values, strict=True)
        )
        return Angle(term, cosine, sine)

    @property
    def _geometry(self) -> SizeGeometry:
        assert isinstance(self.mechanism.geometry, SizeGeometry)
        return self.mechanism.geometry

    def _axes_of(self, link: int) -> list[Axis]:
        name, index = self.mechanism.links[link], self.index[link]
        sizes, numbers = self._geometry.links[name], self.mechanism.pair_number
        terms = [
            self.pair_axes[numbers[x]] if x in numbers else _bold("a", f"{index},{k}")
            for k, x in enumerate(sizes.axes)
        ]
        made = [Axis(terms[0])]
        if len(terms) < 2 or not all(0.0 <= arc <= np.pi for arc in sizes.arcs):
            raise self._refused(link)
        for k, (pair, arc) in enumerate(zip(sizes.axes[1:], sizes.arcs, strict=True)):
            of = index if len(terms) == 2 else f"{index},{k + 1}"
            start, second, end = (f"${terms[x].arguments[0]}$" for x in (0, 1, k + 1))
            slot, what = (name, pair), f"arc of link {index} from {start} to {end}"
            length, turn = (
                self._size(("arcs", slot), rf"\alpha_{{{of}}}", arc, what),
                Angle(),
            )
            if k:
                what, value = f"angle there from {second} to {end}", sizes.angles[k - 1]
                turn = self._size(("angles", slot), rf"\beta_{{{of}}}", value, what)
            made.append(Axis(terms[k + 1], length, turn))
        return made

    def _refused(self, link: int) -> EngineError:
        return EngineError(
            f"{self.mechanism.name}: links.{self.mechanism.links[link]}: formulas are "
            "printed for links with two axes at least, at arcs between 0 and 180 deg; "
            "change the arc, or export to another language"
        )

    def _axis(self, link: int, pair: int) -> Axis:
        axes = self._axes[link]
        return next(axis for axis in axes if axis.term is self.pair_axes[pair])

    # Positions.

    def _place(self, ground: Floats) -> None:
        mechanism, self._section, self._mark = self.mechanism, "Positions", ""
        i, j, k = (
            self._give(name, "axis of the ground", f"$({', '.join(map(number, column))})$")
            for name, column in zip(
                (rf"\mathbf{{{x}}}_{{{self.index[0]}}}" for x in "ijk"),
                ground.T.tolist(),
                strict=True,
            )
        )
        self._frame(0, k, j, self._axes[0][1], i)
        ways = find_spanning_tree(mechanism.ends, [0], self.inputs)
        for pair, parent, child in ways:
            self._drive(pair, parent, child)
        left = {*self.inputs}.difference(pair for pair, *_ in ways)
        if left:
            raise EngineError(
                f"{mechanism.name}: inputs.{mechanism.names_of(left)[0]}: formulas are "
                "printed for inputs that lead to the ground one after another; drive a "
                "pair of the ground, or export to another language"
            )
        for place, group in enumerate(self._assembly.groups):
            self._close(str(place + 1), group)
        for pair, (_, second) in enumerate(mechanism.ends):
            name, axis = mechanism.pairs[pair].name, self.pair_axes[pair]
            if pair not in self.inputs:
                zero, tangent = self._zero(pair), self._tangent(second, pair)
                half = inner(cross(axis, zero), tangent) / (1.0 + inner(zero, tangent))
                self._put(self.angles[pair], 2.0 * function("atan", half))
            self._say("theta", name, self.angles[pair])
            self._say("axis", name, axis)
        for link, axes in self._frames.items():
            self._say("orientation", mechanism.links[link], *axes)

    def _across(self, link: int, axis: Axis) -> Expr:
        i, j, _ = self._frames[link]
        return axis.turn.cosine * j - axis.turn.sine * i

    def _tangent(self, link: int, pair: int) -> Expr:
        """Return the unit tangent to the reference arc at an axis of a placed link."""
        axis, (_, right, k) = self._axis(link, pair), self._frames[link]
        if axis.term is not k:
            right = axis.arc.sine * k - axis.arc.cosine * self._across(link, axis)
            if axis.arc.sine == 0.0:
                raise self._refused(link)
        return self._put(self._tangent_symbol(link, pair), right)

    def _tangent_symbol(self, link: int, pair: int) -> ExpressionNode:
        return symbol(rf"\mathbf{{t}}^{{{self.index[link]}}}_{{{self._pairs[pair]}}}")

    def _zero(self, pair: int) -> Expr:
        """Return where the tangent of a pair's second link is at zero."""
        start = self._tangent(self.mechanism.ends[pair][0], pair)
        right = self._turned(pair, start, self._zero_angle(pair))
        return self._line(r"\mathbf{z}", self._pairs[pair], right)

    def _zero_angle(self, pair: int) -> Angle:
        name = self.mechanism.pairs[pair].name
        value, slot = self._geometry.zeros.get(name, 0.0), ("zeros", name)
        if not value and slot not in self._free:
            return Angle()
        zero = rf"\theta^{{0}}_{{{self._pairs[pair]}}}"
        return self._size(slot, zero, value, f"zero of pair {latex_text(name)}")

    def _turned(self, pair: int, start: Expr, by: Angle, sense: float = 1.0) -> Expr:
        axis = self.pair_axes[pair]
        return by.cosine * start + sense * by.sine * cross(axis, start)

    def _drive(self, pair: int, parent: int, child: int) -> None:
        """Place the link that an input joins to a placed one."""
        q, axis = self.angles[pair], self._axis(child, pair)
        angle = Angle(q, function("cos", q), function("sin", q))
        if self.mechanism.ends[pair][0] == parent:
            right = self._turned(pair, self._zero(pair), angle)
        else:
            back = self._turned(pair, self._tangent(parent, pair), angle, -1.0)
            zero = self._line(r"\mathbf{z}", self._pairs[pair], back)
            right = self._turned(pair, zero, self._zero_angle(pair), -1.0)
        tangent = self._put(self._tangent_symbol(child, pair), right)
        if axis is self._axes[child][0]:
            self._frame(child, axis.term, tangent, self._axes[child][1])
        else:
            first = axis.arc.cosine * axis.term + axis.arc.sine * tangent
            toward = axis.arc.sine * axis.term - axis.arc.cosine * tangent
            self._frame(child, first, toward, axis)

    def _close(self, of: str, group: Group) -> None:
        """Place both links of a dyad."""
        near, middle, far = group.dyad_positions
        if group.dyad_parity < 0:
            near, far = far, near
        a, b, c = (self.pair_axes[group.pairs[x]] for x in (near, middle, far))
        sides: list[tuple[int, Axis, Axis]] = []
        for outer in (near, far):
            link = group.bodies[sum(group.ends[outer])][0]
            both = (self._axis(link, group.pairs[x]) for x in (outer, middle))
            first, second = sorted(both, key=self._axes[link].index)
            sides.append((link, first, second))
        one, other = (self._cosine(*side) for side in sides)
        between = self._line(r"\gamma", of, inner(a, c))
        under = 1.0 - between * between
        along = self._line(r"\lambda", of, (one - between * other) / under)
        beside = self._line(r"\mu", of, (other - between * one) / under)
        order = ", ".join(f"${self.pair_axes[pair].arguments[0]}$" for pair in group.pairs)
        sign = self._give(f"s_{{{of}}}", f"sign of the triple product of {order}")
        rest = (1.0 - along * one - beside * other) / under
        height = self._line(r"\nu", of, sign * function("sqrt", rest))
        self._put(b, along * a + beside * c + height * cross(a, c), always=True)
        for side in sides:
            self._by_two(*side)
        planes = cross(a, b), cross(b, c)
        share = function("norm", cross(*planes)) / function("norm", inner(*planes))
        (name,) = self.mechanism.names_of([group.middle])
        angle = self._line(r"\psi", of, function("atan", share))
        self._say("transmission_angle", name, angle)

    def _cosine(self, link: int, one: Axis, other: Axis) -> Expr:
        """Return the cosine of the arc between two axes of a link."""
        sines = one.arc.sine * other.arc.sine * _less(other.turn, one.turn).cosine
        right = one.arc.cosine * other.arc.cosine + sines
        of_axis = one is self._axes[link][0]
        return right if of_axis else self._line(r"\kappa", self.index[link], right)

    def _by_two(self, link: int, one: Axis, other: Axis) -> None:
        """Place a link two axes of which are placed."""
        first, start = one.term, self._axes[link][0]
        if one is not start:
            cosine = self._cosine(link, one, other)
            shares = (
                (x.arc.cosine - cosine * y.arc.cosine) * x.term
                for x, y in ((one, other), (other, one))
            )
            sines = one.arc.sine * other.arc.sine * _less(other.turn, one.turn).sine
            upright = sines * cross(one.term, other.term)
            first = (sum(shares, 0.0) + upright) / (1.0 - cosine * cosine)
        if other.arc.sine == 0.0:
            raise self._refused(link)
        toward = (other.term - other.arc.cosine * start.term) / other.arc.sine
        self._frame(link, first, toward, other)

    def _frame(
        self, link: int, first: Expr, toward: Expr, axis: Axis, i: Expr = 0.0
    ) -> None:
        """Place a link by its first axis and what leads from there toward another one."""
        index, k = self.index[link], self._axes[link][0].term
        if k not in self.lines:
            self._put(k, first, always=True)
        if axis.turn.sine != 0.0:
            toward = self._line(r"\mathbf{d}", index, toward)
        right = axis.turn.cosine * toward + axis.turn.sine * cross(toward, k)
        j = self._line(r"\mathbf{j}", index, right)
        self._frames[link] = [i or self._line(r"\mathbf{i}", index, cross(j, k)), j, k]
        for other in self._axes[link]:
            if other.term not in self.lines:
                along = other.arc.cosine * k
                right = along + other.arc.sine * self._across(link, other)
                self._put(other.term, right, always=True)

    # Poles and coefficients.

    def _find_poles(self, k: int, table: Plan) -> dict[tuple[int, int], Expr]:
        self._moves(k)
        poles: dict[tuple[int, int], Expr] = {}
        for step in table.steps:
            if isinstance(step, PrimaryPole):
                poles[step.pole] = self.pair_axes[step.pair]
                continue
            if not isinstance(step, LinePole):
                raise EngineError(
                    f"{self.mechanism.name}: the poles of links "
                    f"{listing(map(table.name, step.links))} follow from the velocity "
                    "equations of an irreducible part alone, which no formula is printed "
                    "for; export to another language"
                )
            both = self._of(*step.pole[::-1])
            moves = f" while ${self._motion[0][k].arguments[0]}$ moves" * self._several
            self._section = f"Poles of pass {roman_numeral(step.round)}{moves}"
            planes = []
            for third, *_ in group_by_circle(step.via, step.pole, table.coaxial)[:2]:
                ends = (poles[pole_of(end, third)] for end in step.pole)
                of = f"{both}|{self.index[third]}"
                planes.append(self._line(r"\mathbf{n}", of, cross(*ends)))
            line = self._line(r"\mathbf{v}", both, cross(*planes))
            size = self._line("v", both, function("norm", line))
            poles[step.pole] = self._line(r"\mathbf{u}", both, line / size)
        return poles

    def _find_coefficients(self, k: int, table: Plan) -> None:
        """Write ratios of Aronhold and Kennedy by a third link whose rate is known."""
        ground, poles = table.body[0], self.poles[k]
        first, second = table.ends[table.input]
        self._moves(k)
        ratios: dict[int, Expr] = {second: 1.0} if first == ground else {first: -1.0}
        velocities: dict[int, Expr] = {ground: 0.0}
        self._m.append(ratios)
        self._w.append(velocities)
        for body in sorted({*table.bodies} - {ground}, key=lambda body: body not in ratios):
            axis, both = poles[pole_of(body, ground)], self._of(body, ground)
            if body not in ratios:
                third = next(
                    x
                    for x in ratios
                    if not any({x, body, ground} <= links for links, _ in table.coaxial)
                )
                between, there = poles[pole_of(body, third)], poles[pole_of(third, ground)]
                plane = self._line(r"\mathbf{c}", both, cross(axis, there))
                over = self._line("N", both, inner(plane, cross(between, there)))
                under = self._line("D", both, inner(plane, cross(between, axis)))
                ratios[body] = self._line("m", both, ratios[third] * over / under)
            w = ratios[body] * axis
            velocities[body] = self._line(r"\mathbf{w}", self.index[body], w)

    def _velocity(self, k: int, link: int) -> Expr:
        return self._w[k][self.plans[k].body[link]]

    def _find_slopes(
        self, by: int, moved: Sequence[tuple[ExpressionNode, Formula]]
    ) -> dict[ExpressionNode, Expr]:
        """Write the derivatives by an input of what follows from axes of pairs."""
        made: dict[ExpressionNode, Expr] = {}
        for axis, ends in zip(self.pair_axes, self.mechanism.ends, strict=True):
            velocities = [self._velocity(by, end) for end in ends]
            w = 0.0 if 0.0 in velocities else min(velocities, key=_is_opposite)
            made[axis] = self._put(self._by(by, axis), cross(w, axis))
        for term, (section, (right, *_)) in moved:
            if section != "Positions":
                (change,) = substitute(differentiate([right], made), {right: term})
                made[term] = self._put(self._by(by, term), change)
        return made

    def _slope(self, by: int, item: Expr) -> Expr:
        return differentiate([item], self._slopes[by])[0]

    def _name_coefficients(self, k: int) -> None:
        """Name the coefficients of all links while an input moves."""
        self._moves(k)
        mechanism, end, body = self.mechanism, self.ends[k], self.plans[k].body
        for link, name in enumerate(mechanism.links):
            w = self._velocity(k, link)
            self._say("angular_velocity", name + end, w)
            self._say("angular_velocity_dq", name + end, self._slope(k, w))
        for a, b in permutations(range(len(mechanism.links)), 2):
            axis = ratio = slope = 0.0
            if body[a] != body[b]:
                axis = self.poles[k][pole_of(body[a], body[b])]
                w, v = self._velocity(k, a), self._velocity(k, b)
                if 0.0 in (w, v):
                    ratio = self._m[k][body[a]] if v == 0.0 else -1.0 * self._m[k][body[b]]
                    slope = self._slope(k, ratio)
                else:
                    ratio = self._line("m", self._of(a, b), inner(w - v, axis))
                    turn = inner(self._slope(k, w) - self._slope(k, v), axis)
                    slope = self._put(self._by(k, ratio), turn)
            of = f"{mechanism.links[a]}_{mechanism.links[b]}{end}"
            self._say("pole", of, axis)
            self._say("velocity_coefficient", of, ratio)
            self._say("acceleration_coefficient", of, slope)

    # The equation of motion.

    def _rate(self, k: int, pair: int) -> Expr:
        """Return the derivative of a pair's variable by an input."""
        first, second = self.mechanism.pairs[pair].links
        of = f"{second}_{first}{self.ends[k]}"
        return self.quantities[f"velocity_coefficient_{of}"][0]

    def _move(self, forces: Sequence[Expr]) -> None:
        """Write inertia and torques."""
        mechanism, moving, ends = self.mechanism, self.moving, self.ends
        _, speeds, accelerations = self._motion
        inertia = dict.fromkeys(product(moving, moving), 0.0)
        resisting, slope = [0.0 for _ in moving], 0.0
        for mass in mechanism.masses:
            link = mechanism.link_number[mass.link]
            index, free = self.index[link], ", free" * (("mass", mass.link) in self._free)
            rows = r" \\ ".join(" & ".join(map(number, row)) for row in mass.tensor)
            matrix = self._give(
                rf"\mathbf{{I}}_{{{index}}}",
                f"inertia tensor of link {index} (kg m$^2$){free}",
                rf"$\begin{{pmatrix}}{rows}\end{{pmatrix}}$",
            )
            if free:
                self.free_terms["mass", mass.link] = matrix
            w, seen = [self._velocity(k, link) for k in moving], list[Expr]()
            for k in moving:
                self._moves(k)
                seen.append(self._seen("x", link, w[k]))
            for k, i in inertia:
                inertia[k, i] += inner(seen[k], matrix * seen[i])
            self._mark = "" if self._several else "'"
            if not self._several:
                change = self._seen("x", link, self._slope(0, w[0]))
                slope += 2.0 * inner(change, matrix * seen[0])
                continue
            late = (speeds[k] * speeds[i] * self._slope(i, w[k]) for k, i in inertia)
            turning = self._line(r"\mathbf{W}", index, sum_of_products(speeds, w))
            turning = self._seen("y", link, turning)
            late = self._seen("z", link, self._line(r"\mathbf{A}", index, sum(late, 0.0)))
            pull = matrix * late + cross(turning, matrix * turning)
            pull = self._line(r"\mathbf{h}", index, pull)
            resisting = [y + inner(x, pull) for x, y in zip(seen, resisting, strict=True)]
        self._mark = ""
        names = mechanism.names_of(self.inputs)
        for k, i in inertia:
            term = symbol(f"B_{{{k + 1},{i + 1}}}" if self._several else "B")
            inertia[k, i] = self._put(term, inertia[k, i])
            name = f"B_{names[k]}{ends[i]}" if self._several else "B"
            self.quantities[name] = [inertia[k, i]]
        if not self._several:
            slope = self._put(symbol("B'"), slope)
            self.quantities["dB_dq"] = [slope]
        for k, end in enumerate(ends):
            right = sum_of_products((inertia[k, i] for i in moving), accelerations)
            half = 0.5 * slope * (speeds[k] * speeds[k])
            right = right + (resisting[k] if self._several else half) - forces[k]
            self.quantities[f"generalized_force{end}"] = [forces[k]]
            torque = self._put(symbol(self._numbered(r"\tau", k)), right, always=True)
            self.quantities[f"torque{end}"] = [torque]

    def _seen(self, letter: str, link: int, given: Expr) -> Expr:
        """Return a vector by its components along the axes of a link."""
        if given == 0.0:
            return 0.0
        frame = self._frames[link]
        alone = [float(axis is given) for axis in frame]
        rows = alone if any(alone) else [inner(axis, given) for axis in frame]
        return self._line(rf"\mathbf{{{letter}}}", self.index[link], *rows)

    def _forces(self) -> list[Expr]:
        """Return the generalized forces of all loads that rub by no reactions."""
        totals: list[Expr] = [0.0 for _ in self.moving]
        self._mark, self._acting = "", 0
        for load in self.mechanism.loads:
            parts = load.components(self.mechanism)
            if any(part.rubs and part.rubs.grip for part in parts):
                self.left_out.append(load.name)
                continue
            for part in parts:
                self._acting += 1
                of, law = str(self._acting), part.magnitude
                if isinstance(law, TorqueTable):
                    what = f"torque of {latex_text(load.name)} at the time (N m)"
                    size = self._give(f"T_{{{of}}}", what)
                else:
                    law = expression_of(law)
                    named = {name: self._named(name) for name in law.names}
                    size = self._line("T", of, convert_to_graph(law, named))
                for k in self.moving:
                    totals[k] += size * self._work(k, part, of)
        return [
            self._put(symbol(self._numbered("Q", k)), works)
            for k, works in enumerate(totals)
        ]

    def _work(self, k: int, part: Component, of: str) -> Expr:
        """Return what a load of magnitude 1 does per unit rate of an input."""
        works = self._rate(k, self.mechanism.pair_number[part.pair]) if part.pair else 0.0
        for count, moment in enumerate(part.moments):
            link = self.mechanism.link_number[moment.link]
            frame = self._frames[link if moment.axes == "link" else 0]
            along = sum_of_products(moment.direction, frame)
            if moment.arm is not None:
                along = cross(sum_of_products(moment.arm, self._frames[link]), along)
            turning = self._line(r"\mathbf{M}", f"{of},{count + 1}", along)
            works += inner(turning, self._velocity(k, link))
        return works

    def _named(self, name: str) -> tuple[Expr, Expr]:
        """Return twice the term of a name in the expression of a load."""
        kind, _, pair = name.partition("_")
        if kind == "t":
            return (self._give("t", "time (s)"),) * 2
        place = self.mechanism.pair_number[pair]
        term = self.angles[place]
        if kind == "dtheta":
            rates = (self._rate(k, place) for k in self.moving)
            speed = term.arguments[0].replace(r"\theta", r"\dot{\theta}")
            right = sum_of_products(rates, self._motion[1])
            return (self._put(symbol(speed), right),) * 2
        return term, term


def _bold(letter: str, index: str) -> ExpressionNode:
    return symbol(rf"\mathbf{{{letter}}}_{{{index}}}")


def _is_opposite(item: Expr) -> bool:
    return isinstance(item, ExpressionNode) and item.arguments[0] == -1.0


def _less(one: Angle, other: Angle) -> Angle:
    """Return the difference of two angles."""
    apart = one.term - other.term
    if other.term == 0.0:
        return one
    return Angle(apart, function("cos", apart), function("sin", apart))
