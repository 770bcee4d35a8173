"""Positions, poles, coefficients and the equation of motion of dyads, line by line.

Each formula gives a quantity by those before it, as in a paper (Di Gregorio 2024).
"""

import re
from collections.abc import Iterable
from itertools import permutations
from itertools import product as couples
from typing import Any, NamedTuple

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import listing
from spherekit.errors import EngineError
from spherekit.exchange.latex_math import (
    cross,
    dot,
    law,
    minus,
    number,
    product,
    quotient,
    total,
)
from spherekit.model.graph import spanning
from spherekit.model.load import Component, TorqueTable, expression_of
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import SizeGeometry, Vector
from spherekit.planning.inputs import Group, plan_assembly
from spherekit.planning.plan import circles, plan
from spherekit.planning.poles import LinePole, Plan, PrimaryPole, pole_of, roman


class Angle(NamedTuple):
    """An angle by its symbol, its cosine and its sine."""

    symbol: str = "0"
    cosine: str = "1"
    sine: str = "0"


class Axis(NamedTuple):
    """An axis of a link, its arc from the first one, and the angle of that arc there."""

    symbol: str
    arc: Angle = Angle()
    turn: Angle = Angle()


class Formula(NamedTuple):
    """What a quantity is, and the section that says so."""

    section: str
    right: str


class Formulas:
    """The formulas of a mechanism given by sizes, and what they begin with.

    Attributes
    ----------
    lines
        Formulas by the symbols of their quantities, in order.
    given
        Meanings and values of the symbols that nothing gives.
    quantities
        The symbols of each quantity, by the names of
        `spherekit.engine.row_quantities.row_quantities` without components of vectors.

    Raises
    ------
    EngineError
        If there is no closed form, or an arc is 0 or 180 degrees or signed.
    """

    def __init__(self, mechanism: Mechanism, ground: Floats, free: set[Any]) -> None:
        self.mechanism, self._free = mechanism, free
        self.lines: dict[str, Formula] = {}
        self.given: dict[str, tuple[str, str]] = {}
        self.quantities: dict[str, list[str]] = {}
        self.left_out: list[str] = []
        self._assembly = plan_assembly(mechanism)
        links = mechanism.links
        short = all(len(name) < 3 and name.isdigit() for name in links)
        self.index = links if short else [str(k + 1) for k in range(len(links))]
        self.inputs = inputs = self._assembly.inputs
        self.moving, names = range(len(inputs)), mechanism.names_of(inputs)
        self.ends = [f"_by_{name}" * (len(names) > 1) for name in names]
        ends = [f"_{{{k + 1}}}" * (len(names) > 1) for k in self.moving]
        self._q, self._speed, self._acceleration = (
            [self._give(letter + end, what) for end in ends]
            for letter, what in (
                ("q", "angle of an input (rad)"),
                (r"\dot{q}", "its rate (rad/s)"),
                (r"\ddot{q}", "its acceleration (rad/s$^2$)"),
            )
        )
        self.angles = [
            rf"\theta_{{{self._of(second, first)}}}" for first, second in mechanism.ends
        ]
        for pair, symbol in zip(inputs, self._q, strict=True):
            self.angles[pair] = symbol
        self.pair_axes = [
            _bold("u", self._of(*sorted(ends, reverse=True))) for ends in mechanism.ends
        ]
        self._axes = [self._axes_of(link) for link in range(len(links))]
        self._frames: dict[int, tuple[str, str, str]] = {}
        self._place(ground)
        self.plans = [plan(mechanism, None, name) for name in names]
        self._rate()
        if mechanism.masses or mechanism.loads:
            self._move()

    def needed(self, wanted: Iterable[str]) -> tuple[dict[str, Formula], list[str]]:
        """Return the formulas that some texts follow from, and the symbols given."""
        every = sorted({*self.given, *self.lines}, key=len, reverse=True)
        symbols = re.compile(
            "|".join(rf"(?<![a-zA-Z\\]){re.escape(x)}(?![a-zA-Z])" for x in every)
        )
        kept = set(symbols.findall("; ".join(wanted)))
        for left, formula in reversed(self.lines.items()):
            if left in kept:
                kept.update(symbols.findall(formula.right))
        lines = {left: formula for left, formula in self.lines.items() if left in kept}
        return lines, [symbol for symbol in self.given if symbol in kept]

    def _of(self, one: int, other: int) -> str:
        both = self.index[one], self.index[other]
        return ("" if max(map(len, both)) == 1 else ",").join(both)

    def _give(self, symbol: str, meaning: str, value: str = "") -> str:
        self.given[symbol] = meaning, value
        return symbol

    def _put(self, left: str, right: str) -> str:
        """Write a formula and return its symbol; of what is a symbol, that alone."""
        is_axis = re.fullmatch(r"\\mathbf\{u\}_[^']*", left)
        if not is_axis and not re.search(r"\s|\\frac|\\left|\\begin", right):
            return right
        self.lines[left] = Formula(self._section, right)
        return left

    def _says(self, name: str, *symbols: str) -> None:
        self.quantities[name] = [*symbols]

    # Sizes.

    def _size(self, slot: tuple[str, Any], symbol: str, value: float, what: str) -> Angle:
        free = slot in self._free
        degrees = rf"{number(float(np.degrees(value)))}^{{\circ}}"
        self._give(symbol, what + ", free" * free, degrees)

        def of(name: str, size: float) -> str:
            near = round(size)
            plain = not free and abs(size - near) < 1e-15
            return str(near) if plain else rf"\{name} {symbol}"

        return Angle(
            symbol, of("cos", float(np.cos(value))), of("sin", float(np.sin(value)))
        )

    def _axes_of(self, link: int) -> list[Axis]:
        name, index = self.mechanism.links[link], self.index[link]
        sizes, numbers = self._geometry.links[name], self.mechanism.pair_number
        symbols = [
            self.pair_axes[numbers[x]] if x in numbers else _bold("a", f"{index},{k + 1}")
            for k, x in enumerate(sizes.axes)
        ]
        made = [Axis(symbols[0])]
        if len(symbols) < 2 or not all(0.0 <= arc <= np.pi for arc in sizes.arcs):
            raise self._refused(link)
        for k, (pair, arc) in enumerate(zip(sizes.axes[1:], sizes.arcs, strict=True)):
            of = index if len(symbols) == 2 else f"{index},{k + 1}"
            ends = f"from ${symbols[0]}$ to ${symbols[k + 1]}$"
            what = f"arc of link {index} {ends}"
            length = self._size(("arcs", (name, pair)), rf"\alpha_{{{of}}}", arc, what)
            turn = Angle()
            if k:
                what = f"angle there from ${symbols[1]}$ to ${symbols[k + 1]}$"
                slot = "angles", (name, pair)
                turn = self._size(slot, rf"\beta_{{{of}}}", sizes.angles[k - 1], what)
            made.append(Axis(symbols[k + 1], length, turn))
        return made

    @property
    def _geometry(self) -> SizeGeometry:
        assert isinstance(self.mechanism.geometry, SizeGeometry)
        return self.mechanism.geometry

    def _refused(self, link: int) -> EngineError:
        return EngineError(
            f"{self.mechanism.name}: links.{self.mechanism.links[link]}: formulas are "
            "printed for links with two axes at least, at arcs between 0 and 180 deg; "
            "change the arc, or export to another language"
        )

    def _axis(self, link: int, pair: int) -> Axis:
        axes = self._axes[link]
        return next(axis for axis in axes if axis.symbol == self.pair_axes[pair])

    # Positions.

    def _place(self, ground: Floats) -> None:
        mechanism, self._section = self.mechanism, "Positions"
        frame = [_bold(letter, self.index[0]) for letter in "ijk"]
        for symbol, column in zip(frame, ground.T.tolist(), strict=True):
            self._give(symbol, "axis of the ground", f"({', '.join(map(number, column))})")
        i, j, k = frame
        self._put(self._axes[0][0].symbol, k)
        self._frame(0, k, j, self._axes[0][1], i)
        ways = spanning(mechanism.ends, [0], self.inputs)
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
                over = dot(cross(axis, zero), tangent)
                half = quotient(over, total("1", dot(zero, tangent)))
                self._put(self.angles[pair], rf"2 \, \arctan\left({half}\right)")
            self._says(f"theta_{name}", self.angles[pair])
            self._says(f"axis_{name}", axis)
        for link, axes in self._frames.items():
            self._says(f"orientation_{mechanism.links[link]}", *axes)

    def _across(self, link: int, axis: Axis) -> str:
        i, j, _ = self._frames[link]
        return total(product(axis.turn.cosine, j), minus(product(axis.turn.sine, i)))

    def _tangent(self, link: int, pair: int) -> str:
        """Return the unit tangent to the reference arc at an axis of a placed link."""
        axis, (_, right, k) = self._axis(link, pair), self._frames[link]
        if axis.symbol != k:
            back = product(axis.arc.cosine, self._across(link, axis))
            right = total(product(axis.arc.sine, k), minus(back))
            if axis.arc.sine == "0":
                raise self._refused(link)
        return self._put(self._tangent_symbol(link, pair), right)

    def _tangent_symbol(self, link: int, pair: int) -> str:
        return rf"\mathbf{{t}}^{{{self.index[link]}}}{self.pair_axes[pair][10:]}"

    def _zero(self, pair: int) -> str:
        """Return where the tangent of a pair's second link is at zero."""
        start = self._tangent(self.mechanism.ends[pair][0], pair)
        return self._zeroed(pair, start, "1", self.pair_axes[pair].replace("u", "z"))

    def _zeroed(self, pair: int, start: str, sense: str, symbol: str) -> str:
        name = self.mechanism.pairs[pair].name
        value, angle = self._geometry.zeros.get(name, 0.0), Angle()
        if value or ("zeros", name) in self._free:
            zero = self.pair_axes[pair].replace(r"\mathbf{u}", r"\theta^{0}")
            angle = self._size(("zeros", name), zero, value, f"zero of pair {plain(name)}")
        return self._put(symbol, self._turned(pair, start, angle, sense))

    def _turned(self, pair: int, start: str, by: Angle, sense: str) -> str:
        beside = product(sense, by.sine, cross(self.pair_axes[pair], start))
        return total(product(by.cosine, start), beside)

    def _drive(self, pair: int, parent: int, child: int) -> None:
        """Place the link that an input joins to a placed one."""
        q, axis = self.angles[pair], self._axis(child, pair)
        angle, symbol = Angle(q, rf"\cos {q}", rf"\sin {q}"), self.pair_axes[pair]
        tangent = self._tangent_symbol(child, pair)
        if self.mechanism.ends[pair][0] == parent:
            self._put(tangent, self._turned(pair, self._zero(pair), angle, "1"))
        else:
            back = self._turned(pair, self._tangent(parent, pair), angle, "-1")
            zero = self._put(symbol.replace("u", "z"), back)
            tangent = self._zeroed(pair, zero, "-1", tangent)
        along, beside = (
            [product(x, symbol), product(y, tangent)]
            for x, y in ((axis.arc.cosine, axis.arc.sine), (axis.arc.sine, axis.arc.cosine))
        )
        if axis == self._axes[child][0]:
            self._frame(child, symbol, tangent, self._axes[child][1])
        else:
            toward = total(beside[0], minus(beside[1]))
            self._frame(child, total(*along), toward, axis)

    def _close(self, k: str, group: Group) -> None:
        """Place both links of a dyad, the k-th."""
        near, middle, far = group.dyad_places
        if group.dyad_parity < 0:
            near, far = far, near
        links = [group.bodies[sum(group.ends[outer])][0] for outer in (near, far)]
        a, b, c = (self.pair_axes[group.pairs[x]] for x in (near, middle, far))
        places = [
            sorted(
                (self._axis(link, group.pairs[x]) for x in (outer, middle)),
                key=self._axes[link].index,
            )
            for link, outer in zip(links, (near, far), strict=True)
        ]
        one, other = (
            self._cosine(link, *both) for link, both in zip(links, places, strict=True)
        )
        between = self._put(rf"\gamma_{{{k}}}", dot(a, c))
        under = total("1", minus(f"{between}^{{2}}"))
        first, second = (
            self._put(
                rf"\{x}_{{{k}}}", quotient(total(y, minus(product(between, z))), under)
            )
            for x, y, z in (("lambda", one, other), ("mu", other, one))
        )
        rest = total("1", minus(product(first, one)), minus(product(second, other)))
        order = ", ".join(f"${self.pair_axes[pair]}$" for pair in group.pairs)
        sign = self._give(f"s_{{{k}}}", f"sign of the triple product of {order}")
        root = rf"\sqrt{{{quotient(rest, under)}}}"
        height = self._put(rf"\nu_{{{k}}}", product(sign, root))
        upright = product(height, cross(a, c))
        self._put(b, total(product(first, a), product(second, c), upright))
        for link, both in zip(links, places, strict=True):
            self._by_two(link, *both)
        planes = cross(a, b), cross(b, c)
        sine, cosine = rf"\left\|{cross(*planes)}\right\|", rf"\left|{dot(*planes)}\right|"
        share = quotient(sine, cosine)
        (name,) = self.mechanism.names_of([group.middle])
        angle = self._put(rf"\psi_{{{k}}}", rf"\arctan\left({share}\right)")
        self._says(f"transmission_angle_{name}", angle)

    def _cosine(self, link: int, one: Axis, other: Axis) -> str:
        """Return the cosine of the arc between two axes of a link."""
        if one == self._axes[link][0]:
            return other.arc.cosine
        cosines = product(one.arc.cosine, other.arc.cosine)
        apart = _less(other.turn, one.turn).cosine
        sines = product(one.arc.sine, other.arc.sine, apart)
        return self._put(rf"\kappa_{{{self.index[link]}}}", total(cosines, sines))

    def _by_two(self, link: int, one: Axis, other: Axis) -> None:
        """Place a link two axes of which are placed."""
        first, start = one.symbol, self._axes[link][0]
        if one != start:
            cosine = self._cosine(link, one, other)
            shares = (
                product(total(x.arc.cosine, minus(product(cosine, y.arc.cosine))), x.symbol)
                for x, y in ((one, other), (other, one))
            )
            sines = one.arc.sine, other.arc.sine, _less(other.turn, one.turn).sine
            upright = product(*sines, cross(one.symbol, other.symbol))
            under = total("1", minus(f"{cosine}^{{2}}"))
            first = quotient(total(*shares, upright), under)
        if other.arc.sine == "0":
            raise self._refused(link)
        back = minus(product(other.arc.cosine, start.symbol))
        toward = quotient(total(other.symbol, back), other.arc.sine)
        self._frame(link, first, toward, other)

    def _frame(self, link: int, first: str, toward: str, axis: Axis, i: str = "") -> None:
        """Place a link by its first axis and what leads from there toward another one."""
        index, k = self.index[link], self._axes[link][0].symbol
        if k not in self.lines:
            self._put(k, first)
        if axis.turn.sine != "0":
            toward = self._put(_bold("d", index), toward)
        beside = product(axis.turn.sine, cross(toward, k))
        j = self._put(_bold("j", index), total(product(axis.turn.cosine, toward), beside))
        i = i or self._put(_bold("i", index), cross(j, k))
        self._frames[link] = i, j, k
        for other in self._axes[link]:
            if other.symbol not in self.lines:
                side = product(other.arc.sine, self._across(link, other))
                self._put(other.symbol, total(product(other.arc.cosine, k), side))

    # Poles and coefficients.

    def _marked(self, symbol: str, k: int) -> str:
        """Return a symbol with the input that moves, if there are several."""
        return symbol if len(self.moving) == 1 else rf"{symbol}^{{({k + 1})}}"

    def _by(self, k: int, symbol: str) -> str:
        """Return the symbol of a derivative by an input."""
        return f"{symbol}'" if len(self.moving) == 1 else rf"\partial_{{{k + 1}}}{symbol}"

    def _rate(self) -> None:
        """Write poles, coefficients, then the derivatives of both."""
        self.poles: list[dict[tuple[int, int], str]] = []
        self._planes: dict[str, tuple[str, list[tuple[str, ...]]]] = {}
        self._coefficients: list[dict[int, str]] = []
        self._ratios: dict[tuple[int, int], tuple[int, str, str]] = {}
        self._w: list[dict[int, str]] = []
        self._slopes: list[dict[str, str]] = []
        for k, table in enumerate(self.plans):
            self._find_poles(k, table)
        self._section = "Velocity coefficients"
        for k, table in enumerate(self.plans):
            self._find_coefficients(k, table)
        self._section = "Acceleration coefficients"
        for by in self.moving:
            self._find_slopes(by)
        self._section = "Coefficients between moving links"
        for k, end in enumerate(self.ends):
            self._name_coefficients(k, end)

    def _find_poles(self, k: int, table: Plan) -> None:
        found: dict[tuple[int, int], str] = {}
        self.poles.append(found)
        for step in table.steps:
            if isinstance(step, PrimaryPole):
                found[step.pole] = self.pair_axes[step.pair]
                continue
            if not isinstance(step, LinePole):
                raise EngineError(
                    f"{self.mechanism.name}: the poles of links "
                    f"{listing(map(table.name, step.links))} follow from the velocity "
                    "equations of an irreducible part alone, which no formula is printed "
                    "for; export to another language"
                )
            both = self._of(*step.pole[::-1])
            self._section = f"Poles of pass {roman(step.round)}"
            if len(self.moving) > 1:
                self._section += f" while ${self._q[k]}$ moves"
            planes = []
            for third, *_ in circles({*step.via}, step.pole, table.coaxial)[:2]:
                ends = [found[pole_of(end, third)] for end in step.pole]
                of = _bold("n", f"{both}|{self.index[third]}")
                planes.append((self._put(self._marked(of, k), cross(*ends)), *ends))
            line = self._put(
                self._marked(_bold("v", both), k), cross(*(x[0] for x in planes))
            )
            size = self._put(self._marked(f"v_{{{both}}}", k), rf"\left\|{line}\right\|")
            axis = self._marked(_bold("u", both), k)
            found[step.pole] = self._put(axis, quotient(line, size))
            self._planes[axis] = size, planes

    def _find_coefficients(self, k: int, table: Plan) -> None:
        """Write ratios of Aronhold and Kennedy by a third link whose rate is known."""
        ground, poles = table.body[0], self.poles[k]
        first, second = table.ends[table.input]
        found = {second: "1"} if first == ground else {first: "-1"}
        velocities = {ground: "0"}
        self._coefficients.append(found)
        self._w.append(velocities)
        for body in sorted(table.bodies, key=lambda body: body not in found):
            if body == ground:
                continue
            axis, both = poles[pole_of(body, ground)], self._of(body, ground)
            if body not in found:
                third = next(
                    x
                    for x in found
                    if not any({x, body, ground} <= links for links, _ in table.coaxial)
                )
                between, there = poles[pole_of(body, third)], poles[pole_of(third, ground)]
                plane = self._put(self._marked(_bold("c", both), k), cross(axis, there))
                under = self._put(
                    self._marked(f"D_{{{both}}}", k), dot(plane, cross(axis, between))
                )
                over = product(found[third], dot(plane, cross(there, between)))
                ratio = self._marked(f"m_{{{both}}}", k)
                found[body] = self._put(ratio, quotient(over, under))
                self._ratios[k, body] = third, plane, under
            w = self._marked(_bold("w", self.index[body]), k)
            velocities[body] = self._put(w, product(found[body], axis))

    def _velocity(self, k: int, link: int) -> str:
        return self._w[k][self.plans[k].body[link]]

    def _find_slopes(self, by: int) -> None:
        """Write the derivatives by an input."""
        made: dict[str, str] = {"0": "0"}
        self._slopes.append(made)

        def turned(a: str, b: str) -> str:
            return total(cross(made[a], b), cross(a, made[b]))

        for axis, ends in zip(self.pair_axes, self.mechanism.ends, strict=True):
            w = min((self._velocity(by, end) for end in ends), key=len)
            still = any(self._velocity(by, end) == "0" for end in ends)
            made[axis] = "0" if still else self._put(self._by(by, axis), cross(w, axis))
            made[f"-{axis}"] = minus(made[axis])
        for axis, (size, planes) in self._planes.items():
            (one, *first), (other, *second) = planes
            sides = [
                product(dot(axis, self._put(self._by(by, plane), turned(*ends))), across)
                for plane, ends, across in (
                    (other, second, cross(one, axis)),
                    (one, first, minus(cross(other, axis))),
                )
            ]
            made[axis] = self._put(self._by(by, axis), quotient(total(*sides), size))
        for k, table in enumerate(self.plans):
            for body, share in self._coefficients[k].items():
                axis = self.poles[k][pole_of(body, table.body[0])]
                w, change = self._w[k][body], "0"
                if (k, body) in self._ratios:
                    third, plane, under = self._ratios[k, body]
                    between = self.poles[k][pole_of(body, third)]
                    there = self._w[k][third]
                    late = total(made[there], minus(product(share, made[axis])))
                    moved = cross(total(there, minus(w)), made[between])
                    over = dot(plane, total(cross(late, between), moved))
                    change = self._put(self._by(by, share), quotient(over, under))
                made[share] = change
                right = total(product(change, axis), product(share, made[axis]))
                made[w] = self._put(self._by(by, w), right)

    def _name_coefficients(self, k: int, end: str) -> None:
        """Name the coefficients of all links while an input moves."""
        mechanism, slopes = self.mechanism, self._slopes[k]
        for link, name in enumerate(mechanism.links):
            w = self._velocity(k, link)
            self._says(f"angular_velocity_{name}{end}", w)
            self._says(f"angular_velocity_dq_{name}{end}", slopes[w])
        for a, b in permutations(range(len(mechanism.links)), 2):
            bodies = [self.plans[k].body[link] for link in (a, b)]
            axis, ratio, slope = "0", "0", "0"
            if bodies[0] != bodies[1]:
                axis = self.poles[k][pole_of(*bodies)]
                ratio = self._marked(f"m_{{{self._of(a, b)}}}", k)
                w, v = (self._velocity(k, link) for link in (a, b))
                if "0" in (w, v):
                    moved, turn = (bodies[0], "1") if v == "0" else (bodies[1], "-1")
                    ratio = self._coefficients[k][moved]
                    ratio, slope = product(turn, ratio), product(turn, slopes[ratio])
                else:
                    ratio = self._put(ratio, dot(total(w, minus(v)), axis))
                    change = total(slopes[w], minus(slopes[v]))
                    slope = self._put(self._by(k, ratio), dot(change, axis))
            of = f"{mechanism.links[a]}_{mechanism.links[b]}{end}"
            self._says(f"pole_{of}", axis)
            self._says(f"velocity_coefficient_{of}", ratio)
            self._says(f"acceleration_coefficient_{of}", slope)

    def _rate_of(self, k: int, pair: int) -> str:
        """Return the derivative of a pair's variable by an input."""
        first, second = (self.mechanism.links[x] for x in self.mechanism.ends[pair])
        name = f"velocity_coefficient_{second}_{first}{self.ends[k]}"
        (ratio,) = self.quantities[name]
        return ratio

    # The equation of motion.

    def _move(self) -> None:
        """Write inertia, loads and torques."""
        mechanism, moving, ends = self.mechanism, self.moving, self.ends
        self._section = "Equation of motion"
        forces = self._forces()
        numbers = mechanism.link_number
        bodies = [(numbers[x.link], x.tensor) for x in mechanism.masses if numbers[x.link]]
        parts: dict[tuple[int, int], list[str]] = {x: [] for x in couples(moving, moving)}
        slopes: list[str] = []
        rates = [*zip(moving, self._speed, self._acceleration, strict=True)]
        torques: list[list[str]] = [[] for _ in moving]
        for link, tensor in bodies:
            index = self.index[link]
            matrix = rf"\mathbf{{I}}_{{{index}}}"
            free = ", free" * (("mass", mechanism.links[link]) in self._free)
            rows = r" \\ ".join(" & ".join(map(number, row)) for row in tensor)
            value = rf"\begin{{pmatrix}}{rows}\end{{pmatrix}}"
            self._give(matrix, f"inertia tensor of link {index} (kg m$^2$){free}", value)
            w = [self._velocity(k, link) for k in moving]
            seen = [
                self._seen(self._marked(_bold("x", index), k), link, w[k]) for k in moving
            ]
            for k, i in parts:
                parts[k, i].append(dot(seen[k], _times(matrix, seen[i])))
            if len(moving) == 1:
                (x,), slope = seen, self._slopes[0][w[0]]
                change = self._seen(self._by(0, _bold("x", index)), link, slope)
                slopes.append(product("2", dot(change, _times(matrix, x))))
                continue
            spin = total(*(product(speed, w[k]) for k, speed, _ in rates))
            late = [
                product(one, other, self._slopes[i][w[k]])
                for (k, one, _), (i, other, _) in couples(rates, rates)
            ]
            spin, late_spin = (
                self._seen(_bold(letter, index), link, x)
                for letter, x in (("y", spin), ("z", total(*late)))
            )
            turning = cross(spin, _times(matrix, spin))
            turned = self._put(
                _bold("h", index), total(product(matrix, late_spin), turning)
            )
            for k, terms in enumerate(torques):
                terms.append(dot(seen[k], turned))
        names = mechanism.names_of(self.inputs)
        made = {}
        for (k, i), terms in parts.items():
            symbol = "B" if len(moving) == 1 else f"B_{{{k + 1},{i + 1}}}"
            made[k, i] = self._put(symbol, total(*terms))
            self._says(f"B_{names[k]}{ends[i]}" if ends[i] else "B", made[k, i])
        if len(moving) == 1:
            slope = self._put("B'", total(*slopes))
            self._says("dB_dq", slope)
            torques = [[product(r"\frac{1}{2}", slope, rf"{self._speed[0]}^{{2}}")]]
        for k, terms in enumerate(torques):
            pushed = (product(made[k, i], rate) for i, _, rate in rates)
            right = total(*pushed, *terms, minus(forces[k]))
            self._says(f"generalized_force{ends[k]}", forces[k])
            self._says(f"torque{ends[k]}", self._put(self._numbered(r"\tau", k), right))

    def _numbered(self, symbol: str, k: int) -> str:
        return symbol if len(self.moving) == 1 else f"{symbol}_{{{k + 1}}}"

    def _seen(self, symbol: str, link: int, given: str) -> str:
        """Return a vector by its components along the axes of a link."""
        if given == "0":
            return "0"
        frame = self._frames[link]
        own = [str(int(axis == given)) for axis in frame if given in frame]
        rows = r" \\ ".join(own or [dot(axis, given) for axis in frame])
        return self._put(symbol, rf"\begin{{pmatrix}} {rows} \end{{pmatrix}}")

    def _forces(self) -> list[str]:
        """Return the generalized forces of all loads that rub by no reactions."""
        works: list[list[str]] = [[] for _ in self.moving]
        for place, load in enumerate(self.mechanism.loads):
            parts = load.components(self.mechanism)
            if any(part.rubs and part.rubs.grip for part in parts):
                self.left_out.append(load.name)
                continue
            for count, part in enumerate(parts):
                of = str(place + 1) + f",{count + 1}" * (len(parts) > 1)
                if isinstance(part.magnitude, TorqueTable):
                    what = f"torque of {plain(load.name)} at the time (N m)"
                    size = self._give(f"T_{{{of}}}", what)
                else:
                    right = law(expression_of(part.magnitude), self._named)
                    size = self._put(f"T_{{{of}}}", right)
                for k, terms in enumerate(works):
                    terms.append(product(size, self._work(k, part, of)))
        return [
            self._put(self._numbered("Q", k), total(*terms))
            for k, terms in enumerate(works)
        ]

    def _work(self, k: int, part: Component, of: str) -> str:
        """Return what a load of magnitude 1 does per unit rate of an input."""
        numbers, terms = self.mechanism.link_number, list[str]()
        for count, moment in enumerate(part.moments):
            link = numbers[moment.link]
            along = self._vector(link if moment.axes == "link" else 0, moment.direction)
            if moment.arm is not None:
                along = cross(self._vector(link, moment.arm), along)
            turning = self._put(_bold("M", f"{of},{count + 1}"), along)
            terms.append(dot(turning, self._velocity(k, link)))
        if part.pair:
            terms.append(self._rate_of(k, self.mechanism.pair_number[part.pair]))
        return total(*terms)

    def _vector(self, link: int, components: Vector) -> str:
        both = zip(components, self._frames[link], strict=True)
        return total(*(product(number(x), axis) for x, axis in both))

    def _named(self, name: str) -> str:
        """Return the symbol of a name in the expression of a load."""
        kind, _, pair = name.partition("_")
        if kind == "t":
            return self._give("t", "time (s)")
        place = self.mechanism.pair_number[pair]
        angle = self.angles[place]
        if kind == "theta":
            return angle
        rates = [
            product(self._rate_of(k, place), speed) for k, speed in enumerate(self._speed)
        ]
        return self._put(angle.replace(r"\theta", r"\dot{\theta}"), total(*rates))


def _bold(letter: str, index: str) -> str:
    return rf"\mathbf{{{letter}}}_{{{index}}}"


def _times(matrix: str, given: str) -> str:
    return "0" if given == "0" else rf"\left({matrix} \, {given}\right)"


def _less(one: Angle, other: Angle) -> Angle:
    """Return the difference of two angles, the first of which is none of an arc's own."""
    if other == Angle():
        return one
    apart = rf"\left({one.symbol} - {other.symbol}\right)"
    return Angle(apart, rf"\cos{apart}", rf"\sin{apart}")


def plain(name: str) -> str:
    """Return a name as LaTeX prints it."""
    return name.replace("_", r"\_")
