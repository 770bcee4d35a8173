"""Where links are as formulas: axes and frames in the order in which dyads place them."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Floats
from spherekit.engine.row_quantities import Actions
from spherekit.errors import EngineError
from spherekit.exchange.latex_math import (
    applied,
    cross,
    dot,
    minus,
    number,
    product,
    quotient,
    total,
)
from spherekit.model.gears import COLLINEAR, axes_from_sizes
from spherekit.model.graph import spanning
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import LinkSizes, SizeGeometry
from spherekit.planning.inputs import Group, plan_assembly

POSITIONS = "Positions"


class Formula(NamedTuple):
    """A line: a quantity by its symbol, and what it is."""

    section: str
    left: str
    right: str


class Given(NamedTuple):
    """A symbol that formulas begin with: what it means, and its value if it has one."""

    symbol: str
    meaning: str
    value: str = ""


class Sheet:
    """Formulas in order, and what they begin with."""

    def __init__(self) -> None:
        self.formulas: dict[str, Formula] = {}
        self.given: dict[str, Given] = {}

    def give(self, symbol: str, meaning: str, value: str = "") -> str:
        """Say what a symbol means, and return it."""
        self.given[symbol] = Given(symbol, meaning, value)
        return symbol

    def put(self, section: str, left: str, right: str) -> str:
        """Write a formula and return its symbol."""
        self.formulas[left] = Formula(section, left, right)
        return left

    def short(self, section: str, left: str, right: str) -> str:
        """Write a formula and return its symbol; of what is a symbol, that alone."""
        plain = not re.search(r"\s|\\(frac|sqrt|left)", right)
        return right if plain else self.put(section, left, right)

    def needed(self, wanted: Iterable[str]) -> "Sheet":
        """Return the formulas that some texts follow from, and what they begin with."""
        every = sorted({*self.given, *self.formulas}, key=len, reverse=True)
        symbols = re.compile(
            "|".join(rf"(?<![a-zA-Z\\]){re.escape(symbol)}(?![a-zA-Z])" for symbol in every)
        )
        kept = {symbol for text in wanted for symbol in symbols.findall(text)}
        for left, formula in reversed(self.formulas.items()):
            if left in kept:
                kept.update(symbols.findall(formula.right))
        made = Sheet()
        made.formulas = {x: formula for x, formula in self.formulas.items() if x in kept}
        made.given = {x: given for x, given in self.given.items() if x in kept}
        return made


@dataclass(frozen=True)
class Angle:
    """An angle (rad) by its symbol; unless it varies its sine may be 0 or 1."""

    symbol: str = "0"
    value: float = 0.0
    varies: bool = False

    def _function(self, name: str, value: float) -> str:
        near = round(value)
        if self.varies or abs(value - near) > 1e-15:
            return applied(name, self.symbol)
        return str(near)

    @property
    def cosine(self) -> str:
        """Its cosine."""
        return self._function("cos", float(np.cos(self.value)))

    @property
    def sine(self) -> str:
        """Its sine."""
        return self._function("sin", float(np.sin(self.value)))

    @property
    def sense(self) -> str:
        """The sign of its sine."""
        return "1" if np.sin(self.value) > 0.0 else "-1"

    def less(self, other: "Angle") -> "Angle":
        """Return the difference."""
        symbol = total(self.symbol, minus(other.symbol))
        return Angle(symbol, self.value - other.value, self.varies or other.varies)


class Axis(NamedTuple):
    """An axis of a link: its arc from the first one, and the angle of that arc there."""

    symbol: str
    arc: Angle = Angle()
    turn: Angle = Angle()


class Positions:
    """Formulas of the axes and frames of all links of a mechanism given by sizes.

    `inputs` are the symbols of the input angles. `varied` are the sizes that vary, by what
    they are, as in `spherekit.design.variables`; `ground` (3, 3) has the columns i, j and k
    of the ground.

    Raises
    ------
    EngineError
        If an input is not joined to the ground by inputs.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        sheet: Sheet,
        inputs: list[str],
        varied: set[Actions],
        ground: Floats,
    ) -> None:
        self.mechanism, self.sheet, self.varied = mechanism, sheet, varied
        self.assembly = plan_assembly(mechanism)
        self.inputs = dict(zip(self.assembly.inputs, inputs, strict=True))
        names = mechanism.links
        short = all(re.fullmatch(r"\d{1,2}", name) for name in names)
        self.index = names if short else tuple(str(k + 1) for k in range(len(names)))
        self.between = [self.indices(*sorted(ends)) for ends in mechanism.ends]
        self.pair_axes = [rf"\mathbf{{u}}_{{{both}}}" for both in self.between]
        self.placed: set[str] = set()
        self.frames: dict[int, tuple[str, str, str]] = {}
        self.axes = [self._axes(link) for link in range(len(names))]
        self.zeros = [self._zero(pair) for pair in range(len(mechanism.pairs))]
        self._start(ground)
        for place, group in enumerate(self.assembly.groups):
            self._close(place, group)

    def indices(self, one: int, other: int) -> str:
        """Return the index of the second link against the first."""
        both = self.index[other], self.index[one]
        return ("" if max(map(len, both)) == 1 else ",").join(both)

    def angle(self, pair: int) -> str:
        """Return the variable of a pair."""
        if pair in self.inputs:
            return self.inputs[pair]
        _, second = self.mechanism.ends[pair]
        axis, zero = self.pair_axes[pair], self._zero_direction(pair)
        tangent = self._tangent(second, pair)
        half = quotient(dot(cross(axis, zero), tangent), total("1", dot(zero, tangent)))
        return self._put(self.angle_symbol(pair), product("2", applied("arctan", half)))

    def angle_symbol(self, pair: int) -> str:
        """Return the symbol of a pair's variable."""
        return self.inputs.get(
            pair, rf"\theta_{{{self.indices(*self.mechanism.ends[pair])}}}"
        )

    def transmission_angle(self, group: Group) -> str:
        """Return the angle between the arcs of a dyad."""
        near, middle, far = (self.pair_axes[group.pairs[k]] for k in group.dyad_places)
        planes = cross(near, middle), cross(middle, far)
        share = rf"\left\|{cross(*planes)}\right\|", rf"\left|{dot(*planes)}\right|"
        symbol = rf"\psi_{{{self.between[group.middle]}}}"
        return self._put(symbol, applied("arctan", quotient(*share)))

    def _put(self, left: str, right: str) -> str:
        return self.sheet.put(POSITIONS, left, right)

    def _short(self, left: str, right: str) -> str:
        return self.sheet.short(POSITIONS, left, right)

    # Sizes.

    def _sizes(self, link: int) -> LinkSizes:
        geometry = self.mechanism.geometry
        assert isinstance(geometry, SizeGeometry)
        return geometry.links.get(self.mechanism.links[link], LinkSizes(()))

    def _size(self, kind: str, of: Actions, symbol: str, value: float, what: str) -> Angle:
        varies = (kind, of) in self.varied
        degrees = rf"{number(float(np.degrees(value)))}^{{\circ}}"
        self.sheet.give(symbol, what + ", which varies" * varies, degrees)
        return Angle(symbol, value, varies)

    def _axes(self, link: int) -> list[Axis]:
        sizes, index, name = self._sizes(link), self.index[link], self.mechanism.links[link]
        made: list[Axis] = []
        for k, pair in enumerate(sizes.axes):
            symbol = rf"\mathbf{{a}}_{{{index},{k + 1}}}"
            if pair not in sizes.unpaired:
                symbol = self.pair_axes[self.mechanism.pair_number[pair]]
            axis = Axis(symbol)
            if k:
                of = index if len(sizes.axes) == 2 else f"{index},{k}"
                start, slot = made[0].symbol, (name, pair)
                what = f"arc of link {index} from ${start}$ to ${symbol}$"
                arc = self._size("arcs", slot, rf"\alpha_{{{of}}}", sizes.arcs[k - 1], what)
                axis = axis._replace(arc=arc)
            if k > 1:
                what = f"angle at ${start}$ from ${made[1].symbol}$ to ${symbol}$"
                value = sizes.angles[k - 2]
                turn = self._size("angles", slot, rf"\beta_{{{of}}}", value, what)
                axis = axis._replace(turn=turn)
            made.append(axis)
        return made

    def _zero(self, pair: int) -> Angle:
        geometry, name = self.mechanism.geometry, self.mechanism.pairs[pair].name
        assert isinstance(geometry, SizeGeometry)
        value = geometry.zeros.get(name, 0.0)
        if value == 0.0 and ("zeros", name) not in self.varied:
            return Angle()
        symbol = rf"\theta^{{0}}_{{{self.indices(*self.mechanism.ends[pair])}}}"
        what = f"zero of the angle of pair {text(name)}"
        return self._size("zeros", name, symbol, value, what)

    def _place_of(self, link: int, pair: int) -> int:
        return self._sizes(link).axes.index(self.mechanism.pairs[pair].name)

    def _reference(self, link: int, place: int) -> int | None:
        """Return the axis to which the reference arc leads from another."""
        axes = [*axes_from_sizes(self._sizes(link)).values()]
        sines = (float(np.linalg.norm(np.cross(axes[place], axis))) for axis in axes)
        return next((k for k, sine in enumerate(sines) if sine > COLLINEAR), None)

    # Directions fixed in links.

    def _across(self, link: int, axis: Axis) -> str:
        """Return the unit vector at right angles to k toward an axis."""
        i, j, _ = self.frames[link]
        return total(product(axis.turn.cosine, j), minus(product(axis.turn.sine, i)))

    def _tangent(self, link: int, pair: int) -> str:
        """Return the unit tangent to the reference arc at an axis of a placed link."""
        place = self._place_of(link, pair)
        axis, to = self.axes[link][place], self._reference(link, place)
        _, j, k = self.frames[link]
        if to is None:
            right = product(axis.arc.cosine, j)
        elif to:
            other = self.axes[link][to]
            right = product(other.arc.sense, self._across(link, other))
        else:
            back = product(axis.arc.cosine, self._across(link, axis))
            right = total(product(axis.arc.sine, k), minus(back))
            right = product(axis.arc.sense, right)
        return self._short(self._tangent_symbol(link, pair), right)

    def _tangent_symbol(self, link: int, pair: int) -> str:
        return rf"\mathbf{{t}}^{{{self.index[link]}}}_{{{self.between[pair]}}}"

    def _zero_direction(self, pair: int) -> str:
        """Return where the tangent of a pair's second link is at zero."""
        tangent = self._tangent(self.mechanism.ends[pair][0], pair)
        right = self._turned(pair, tangent, self.zeros[pair], "1")
        return self._short(rf"\mathbf{{z}}_{{{self.between[pair]}}}", right)

    def _turned(self, pair: int, start: str, by: Angle, sense: str) -> str:
        """Return a vector at right angles to a pair's axis, turned about it."""
        beside = cross(self.pair_axes[pair], start)
        return total(product(by.cosine, start), product(sense, by.sine, beside))

    # Links, one after another.

    def _start(self, ground: Floats) -> None:
        """Place the ground, then the links that inputs join to it."""
        mechanism, inputs = self.mechanism, self.assembly.inputs
        i, j, k = (rf"\mathbf{{{letter}}}_{{{self.index[0]}}}" for letter in "ijk")
        for symbol, column in zip((i, j, k), ground.T.tolist(), strict=True):
            self.sheet.give(
                symbol, "axis of the ground", f"({', '.join(map(number, column))})"
            )
        self.frames[0] = i, j, k
        self.placed.add(self._put(self.axes[0][0].symbol, k))
        self._rest(0)
        ways = spanning(mechanism.ends, [0], inputs)
        for pair, parent, child in ways:
            self._drive(pair, parent, child)
        left = {*inputs} - {pair for pair, *_ in ways}
        if left:
            raise EngineError(
                f"{mechanism.name}: inputs.{mechanism.names_of(left)[0]}: joins links that "
                "no inputs join to the ground, which LaTeX is not written for; drive a "
                "pair of the ground, or export to another language"
            )

    def _drive(self, pair: int, parent: int, child: int) -> None:
        """Place the link that an input joins to a placed one."""
        angle = Angle(self.inputs[pair], 1.0, True)
        if self.mechanism.ends[pair][0] == parent:
            right = self._turned(pair, self._zero_direction(pair), angle, "1")
        else:
            zero = rf"\mathbf{{z}}_{{{self.between[pair]}}}"
            back = self._turned(pair, self._tangent(parent, pair), angle, "-1")
            right = self._turned(pair, self._short(zero, back), self.zeros[pair], "-1")
        tangent = self._short(self._tangent_symbol(child, pair), right)
        place = self._place_of(child, pair)
        axis, to = self.axes[child][place], self._reference(child, place)
        if to is None:
            self._frame(child, product(axis.arc.cosine, axis.symbol), tangent, Axis(""))
        elif place and not to:
            arc = axis.arc
            ahead = product(arc.sense, arc.sine, tangent)
            first = total(product(arc.cosine, axis.symbol), ahead)
            back = product(arc.sense, arc.cosine, tangent)
            toward = total(product(arc.sine, axis.symbol), minus(back))
            self._frame(child, first, toward, axis)
        else:
            other = self.axes[child][to]
            first = product(axis.arc.cosine, axis.symbol)
            self._frame(child, first, product(other.arc.sense, tangent), other)

    def _close(self, number_of: int, group: Group) -> None:
        """Place both links of a dyad."""
        near, middle, far = group.dyad_places
        if group.dyad_parity < 0:
            near, far = far, near
        links = [group.bodies[sum(group.ends[outer])][0] for outer in (near, far)]
        a, b, c = (self.pair_axes[group.pairs[k]] for k in (near, middle, far))
        places = [
            [self._place_of(link, group.pairs[k]) for k in (outer, middle)]
            for link, outer in zip(links, (near, far), strict=True)
        ]
        one, other = (self._cosine(*both) for both in zip(links, places, strict=True))
        k = number_of + 1
        between = self._put(rf"\gamma_{{{k}}}", dot(a, c))
        under = total("1", minus(rf"\gamma_{{{k}}}^{{2}}"))
        shares = [
            quotient(total(x, minus(product(between, y))), under)
            for x, y in ((one, other), (other, one))
        ]
        first, second = (
            self._short(rf"\{letter}_{{{k}}}", share)
            for letter, share in zip(("lambda", "mu"), shares, strict=True)
        )
        rest = total("1", minus(product(first, one)), minus(product(second, other)))
        order = ", ".join(f"${self.pair_axes[pair]}$" for pair in group.pairs)
        sign = self.sheet.give(f"s_{{{k}}}", f"sign of the triple product of {order}")
        root = product(sign, rf"\sqrt{{{quotient(rest, under)}}}")
        height = self._put(rf"\nu_{{{k}}}", root)
        upright = product(height, cross(a, c))
        self._put(b, total(product(first, a), product(second, c), upright))
        self.placed.add(b)
        for link, both in zip(links, places, strict=True):
            self._by_two(link, *both)

    def _cosine(self, link: int, places: list[int]) -> str:
        """Return the cosine of the arc between two axes of a link."""
        one, other = (self.axes[link][place] for place in sorted(places))
        if 0 in places:
            return other.arc.cosine
        right = total(
            product(one.arc.cosine, other.arc.cosine),
            product(one.arc.sine, other.arc.sine, other.turn.less(one.turn).cosine),
        )
        of = ",".join([self.index[link], *(str(place + 1) for place in sorted(places))])
        return self._short(rf"\kappa_{{{of}}}", right)

    def _by_two(self, link: int, *places: int) -> None:
        """Place a link two axes of which are placed."""
        one, other = (self.axes[link][place] for place in sorted(places))
        first = one.symbol
        if 0 not in places:
            cosine, turn = self._cosine(link, [*places]), other.turn.less(one.turn)
            shares = [
                product(total(x, minus(product(cosine, y))), axis.symbol)
                for axis, x, y in (
                    (one, one.arc.cosine, other.arc.cosine),
                    (other, other.arc.cosine, one.arc.cosine),
                )
            ]
            sines = one.arc.sine, other.arc.sine, turn.sine
            upright = product(*sines, cross(one.symbol, other.symbol))
            under = total("1", minus(f"{cosine}^{{2}}" if cosine != "0" else "0"))
            first = quotient(total(*shares, upright), under)
        start = self.axes[link][0].symbol
        ahead = one if other.arc.sine == "0" else other
        back = product(ahead.arc.cosine, start)
        toward = quotient(total(ahead.symbol, minus(back)), ahead.arc.sine)
        self._frame(link, first, toward, ahead)

    def _frame(self, link: int, first: str, toward: str, axis: Axis) -> None:
        """Place a link by its first axis and what leads from there toward another one."""
        index, k = self.index[link], self.axes[link][0].symbol
        if k not in self.placed:
            self.placed.add(self._put(k, first))
        i, j = (rf"\mathbf{{{letter}}}_{{{index}}}" for letter in "ij")
        if axis.turn.sine != "0":
            toward = self._short(rf"\mathbf{{d}}_{{{index}}}", toward)
            beside = product(axis.turn.sine, cross(toward, k))
            toward = total(product(axis.turn.cosine, toward), beside)
        else:
            toward = product(axis.turn.cosine, toward)
        self.frames[link] = i, self._short(j, toward), k
        self._put(i, cross(self.frames[link][1], k))
        self._rest(link)

    def _rest(self, link: int) -> None:
        """Write the axes of a link with a frame."""
        _, _, k = self.frames[link]
        for axis in self.axes[link]:
            if axis.symbol not in self.placed:
                beside = product(axis.arc.sine, self._across(link, axis))
                along = product(axis.arc.cosine, k)
                self.placed.add(self._put(axis.symbol, total(along, beside)))


def text(name: str) -> str:
    """Return a name as LaTeX prints it."""
    return name.replace("_", r"\_")
