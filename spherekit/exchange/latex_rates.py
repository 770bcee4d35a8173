"""Poles in the order of the Table, coefficients and the equation of motion as formulas."""

from collections.abc import Callable, Sequence
from functools import partial
from itertools import combinations_with_replacement

from spherekit.errors import EngineError
from spherekit.exchange.latex_math import (
    cross,
    dot,
    law,
    minus,
    number,
    power,
    product,
    quotient,
    total,
)
from spherekit.exchange.latex_positions import Positions, text
from spherekit.model.load import Component, LinkMoment, TorqueTable, expression_of
from spherekit.model.parts import Vector
from spherekit.planning.plan import circles, plan
from spherekit.planning.poles import (
    BlockPoles,
    LinePole,
    Plan,
    Pole,
    PrimaryPole,
    pole_of,
    roman,
)

VELOCITY = "Velocity coefficients"
ACCELERATION = "Acceleration coefficients"
DYNAMICS = "Equation of motion"
Slope = Callable[[int], str]
"""What gives the derivative of a quantity by an input."""


class Rates:
    """Formulas of poles and coefficients; the k-th input moves while the others rest.

    Raises
    ------
    EngineError
        If poles follow from an irreducible part only.
    """

    def __init__(self, positions: Positions) -> None:
        self.positions, self.sheet = positions, positions.sheet
        self.mechanism = mechanism = positions.mechanism
        self.inputs = mechanism.names_of(positions.assembly.inputs)
        self.plans = [plan(mechanism, None, name) for name in self.inputs]
        self.moving = range(len(self.inputs))
        self.poles: list[dict[Pole, str]] = []
        self.coefficients: list[dict[int, str]] = []
        self.velocities: list[dict[int, str]] = []
        self._made: dict[tuple[int, str], str] = {}
        self._slope: dict[str, Slope] = {
            axis: partial(self._axis_slope, pair)
            for pair, axis in enumerate(positions.pair_axes)
        }
        for k, table in enumerate(self.plans):
            self._find_poles(k, table)
            self._find_coefficients(k, table)

    def marked(self, symbol: str, k: int, of: str = "") -> str:
        """Return a symbol with its index and the input that moves, if there are several."""
        above = "" if len(self.moving) == 1 else rf"^{{({k + 1})}}"
        return f"{symbol}_{{{of}}}{above}"

    def by(self, k: int, symbol: str) -> str:
        """Return the symbol of a derivative by an input."""
        one = len(self.moving) == 1
        return f"{symbol}'" if one else rf"\partial_{{{k + 1}}}{symbol}"

    def slope(self, k: int, symbol: str) -> str:
        """Return the derivative of a quantity by an input."""
        if symbol.startswith("-"):
            return minus(self.slope(k, symbol[1:]))
        if symbol not in self._slope:
            return "0"
        if (k, symbol) not in self._made:
            right = self._slope[symbol](k)
            made = self.sheet.short(ACCELERATION, self.by(k, symbol), right)
            self._made[k, symbol] = made
        return self._made[k, symbol]

    def pole(self, k: int, one: int, other: int) -> str:
        """Return the pole of two links, "0" if they are one body."""
        pole = self.plans[k].pole(one, other)
        return "0" if pole is None else self.poles[k][pole]

    def velocity(self, k: int, link: int) -> str:
        """Return the angular velocity of a link per unit rate of an input."""
        return self.velocities[k][self.plans[k].body[link]]

    def coefficient(self, k: int, one: int, other: int) -> tuple[str, str]:
        """Return the velocity coefficient of a link against another, and its derivatives.

        It is that along the axis of their pair, or along their pole.
        """
        axis = self.pole(k, one, other)
        if axis == "0":
            return "0", "0"
        for moved, still, sign in ((one, other, "1"), (other, one, "-1")):
            if self.plans[k].body[still] == self.plans[k].body[0]:
                made = product(sign, self.coefficients[k][self.plans[k].body[moved]])
                return made, self.slope(k, made)
        both = self.positions.indices(other, one)
        symbol = self.marked("m", k, both)
        w, v = self.velocity(k, one), self.velocity(k, other)
        made = self.sheet.put(VELOCITY, symbol, dot(total(w, minus(v)), axis))
        self._slope[made] = partial(self._relative_slope, w, v, axis)
        return made, self.slope(k, made)

    def rate(self, k: int, pair: int) -> str:
        """Return the derivative of a pair's variable by an input."""
        first, second = self.mechanism.ends[pair]
        made, _ = self.coefficient(k, second, first)
        return made

    # Poles, in the order of the Table.

    def _find_poles(self, k: int, table: Plan) -> None:
        found: dict[Pole, str] = {}
        self.poles.append(found)
        for step in table.steps:
            if isinstance(step, PrimaryPole):
                found[step.pole] = self.positions.pair_axes[step.pair]
            elif isinstance(step, LinePole) and not step.contacts:
                found[step.pole] = self._by_lines(k, table, step)
            else:
                links = step.links if isinstance(step, BlockPoles) else step.pole
                raise EngineError(
                    f"{self.mechanism.name}: links {', '.join(map(table.name, links))}: "
                    "their poles follow from an irreducible part or a contact, which LaTeX "
                    "is not written for; export to another language, or ask for quantities "
                    "of positions alone"
                )

    def _by_lines(self, k: int, table: Plan, step: LinePole) -> str:
        i, j = step.pole
        section = f"Poles of pass {roman(step.round)}"
        if len(self.moving) > 1:
            section += f" while ${self._input(k)}$ moves"
        both = self.positions.indices(i, j)
        planes = []
        for third, *_ in circles({*step.via}, step.pole, table.coaxial)[:2]:
            ends = [self.poles[k][pole_of(end, third)] for end in step.pole]
            of = f"{both}|{self.positions.index[third]}"
            plane = self.sheet.put(section, self.marked(r"\mathbf{n}", k, of), cross(*ends))
            self._slope[plane] = partial(self._cross_slope, *ends)
            planes.append(plane)
        line = self.sheet.put(section, self.marked(r"\mathbf{v}", k, both), cross(*planes))
        self._slope[line] = partial(self._cross_slope, *planes)
        size = self.marked("v", k, both)
        self.sheet.put(section, size, rf"\left\|{line}\right\|")
        axis = self.marked(r"\mathbf{u}", k, both)
        self._slope[axis] = partial(self._unit_slope, axis, line, size)
        return self.sheet.put(section, axis, quotient(line, size))

    def _input(self, k: int) -> str:
        return self.positions.inputs[self.positions.assembly.inputs[k]]

    # Coefficients, by ratios of Aronhold and Kennedy.

    def _find_coefficients(self, k: int, table: Plan) -> None:
        ground = table.body[0]
        first, second = table.ends[table.input]
        moved, sign = (second, "1") if first == ground else (first, "-1")
        known = {ground: "0", moved: sign}
        self.coefficients.append(known)
        self.velocities.append({ground: "0"})
        for body in table.bodies:
            if body not in known:
                known[body] = self._ratio(k, table, body, known)
            if body != ground:
                axis, both = self.pole(k, body, ground), self.positions.index[body]
                right = product(known[body], axis)
                w = self.sheet.short(VELOCITY, self.marked(r"\mathbf{w}", k, both), right)
                self.velocities[k][body] = w
                self._slope.setdefault(w, partial(self._product_slope, known[body], axis))

    def _ratio(self, k: int, table: Plan, body: int, known: dict[int, str]) -> str:
        ground, both = table.body[0], self.positions.indices(table.body[0], body)
        other = next(
            x
            for x in known
            if x != ground
            and not any(links >= {x, body, ground} for links, _ in table.coaxial)
        )
        axis, there = self.pole(k, body, ground), self.pole(k, other, ground)
        between = self.pole(k, body, other)
        normal = self.marked(r"\mathbf{c}", k, both)
        self.sheet.put(VELOCITY, normal, cross(axis, there))
        self._slope[normal] = partial(self._cross_slope, axis, there)
        shares = []
        for letter, end in (("N", there), ("D", axis)):
            right = dot(normal, cross(between, end))
            share = self.sheet.put(VELOCITY, self.marked(letter, k, both), right)
            self._slope[share] = partial(self._triple_slope, normal, between, end)
            shares.append(share)
        symbol, (over, under) = self.marked("m", k, both), shares
        right = quotient(product(known[other], over), under)
        self._slope[symbol] = partial(self._ratio_slope, symbol, known[other], over, under)
        return self.sheet.put(VELOCITY, symbol, right)

    # Derivatives of what was written, by an input.

    def _axis_slope(self, pair: int, k: int) -> str:
        """An axis moves with either link, and not with one that turns about it."""
        ends = self.mechanism.ends[pair]
        if 0 in (self.plans[k].body[end] for end in ends):
            return "0"
        w = min((self.velocity(k, end) for end in ends), key=len)
        return cross(w, self.positions.pair_axes[pair])

    def _cross_slope(self, a: str, b: str, k: int) -> str:
        return total(cross(self.slope(k, a), b), cross(a, self.slope(k, b)))

    def _triple_slope(self, normal: str, a: str, b: str, k: int) -> str:
        turned = dot(self.slope(k, normal), cross(a, b))
        return total(turned, dot(normal, self._cross_slope(a, b, k)))

    def _unit_slope(self, axis: str, line: str, size: str, k: int) -> str:
        change = self.slope(k, line)
        along = product(dot(axis, change), axis)
        return quotient(total(change, minus(along)), size)

    def _product_slope(self, share: str, axis: str, k: int) -> str:
        change = product(self.slope(k, share), axis)
        return total(change, product(share, self.slope(k, axis)))

    def _ratio_slope(self, m: str, share: str, over: str, under: str, k: int) -> str:
        more = product(self.slope(k, share), over), product(share, self.slope(k, over))
        less = product(m, self.slope(k, under))
        return quotient(total(*more, minus(less)), under)

    def _relative_slope(self, w: str, v: str, axis: str, k: int) -> str:
        """Return that of (w - v) . u: u turns at right angles to itself."""
        return dot(total(self.slope(k, w), minus(self.slope(k, v))), axis)


class Dynamics:
    """Formulas of inertia, loads and torques; `varied` are the links whose masses vary.

    Loads whose friction follows from reactions are left out, their names in `left_out`.
    """

    def __init__(self, rates: Rates, varied: set[str]) -> None:
        self.rates, self.positions, self.sheet = rates, rates.positions, rates.sheet
        self.mechanism = mechanism = rates.mechanism
        self.left_out: list[str] = []
        self._parts: dict[tuple[int, int], dict[str, str]] = {}
        number_of = mechanism.link_number
        self._links = [
            (
                number_of[mass.link],
                self._tensor(mass.link, mass.tensor, mass.link in varied),
            )
            for mass in mechanism.masses
            if number_of[mass.link]
        ]
        self.forces = [self._force(k, works) for k, works in enumerate(self._works())]
        self.torques = [self._torque(k) for k in rates.moving]

    # Inertia.

    def inertia(self, k: int, other: int) -> str:
        """Return the inertia of an input, or between two of them."""
        k, other = sorted((k, other))
        parts = [self._part(link, entries, k, other) for link, entries in self._links]
        return self._short(self._of_inputs("B", k, other), total(*parts))

    def inertia_slope(self, k: int, other: int, by: int) -> str:
        """Return the derivative of an inertia by an input."""
        k, other = sorted((k, other))
        parts = []
        for link, entries in self._links:
            part = self._part(link, entries, k, other)
            right = total(
                self._form(entries, self._slopes(link, k, by), self._seen(link, other)),
                self._form(entries, self._seen(link, k), self._slopes(link, other, by)),
            )
            if k == other:
                one = self._form(entries, self._seen(link, k), self._slopes(link, k, by))
                right = product("2", one)
            parts.append(self._short(self.rates.by(by, part), right))
        symbol = self.rates.by(by, self._of_inputs("B", k, other))
        return self._short(symbol, total(*parts))

    def _tensor(
        self, name: str, rows: Sequence[Vector], varies: bool
    ) -> dict[tuple[int, int], str]:
        """Return the symbols of a link's tensor by row and column."""
        index = self.positions.index[self.mechanism.link_number[name]]
        entries = {}
        for i, j in combinations_with_replacement(range(3), 2):
            if rows[i][j] or varies:
                symbol = f"I_{{{index},{'xyz'[i]}{'xyz'[j]}}}"
                what = ", which varies" * varies
                entries[i, j] = self.sheet.give(symbol, what, number(rows[i][j]))
        return entries

    def _part(self, link: int, entries: dict[tuple[int, int], str], k: int, m: int) -> str:
        symbol = self._of_inputs(f"J_{{{self._of(link)}}}", k, m)
        right = self._form(entries, self._seen(link, k), self._seen(link, m))
        return self._short(symbol, right)

    def _form(
        self, entries: dict[tuple[int, int], str], a: Sequence[str], b: Sequence[str]
    ) -> str:
        """Return a . I b of components in link axes."""
        terms = []
        for (i, j), entry in entries.items():
            if i == j:
                square = power(a[i], "2") if a[i] == b[i] else product(a[i], b[i])
                terms.append(product(entry, "0" if "0" in (a[i], b[i]) else square))
            elif a == b:
                terms.append(product("2", entry, a[i], a[j]))
            else:
                both = total(product(a[i], b[j]), product(a[j], b[i]))
                terms.append(product(entry, both))
        return total(*terms)

    def _seen(self, link: int, k: int) -> list[str]:
        """Return the components of a link's angular velocity in its axes."""
        w = self.rates.velocity(k, link)
        return self._components(link, w, lambda x: self.rates.marked(x, k, self._of(link)))

    def _slopes(self, link: int, k: int, by: int) -> list[str]:
        w = self.rates.velocity(k, link)
        turned = "0" if k == by else cross(w, self.rates.velocity(by, link))
        change = total(self.rates.slope(by, w), turned)

        def symbol(letter: str) -> str:
            return self.rates.by(by, self.rates.marked(letter, k, self._of(link)))

        return self._components(link, change, symbol)

    def _of(self, link: int) -> str:
        return self.positions.index[link]

    def _components(self, link: int, given: str, symbol: Callable[[str], str]) -> list[str]:
        frame, along = self.positions.frames[link], given.removeprefix("-")
        if along in frame:
            return [
                product("-1" * (along != given) or "1", str(int(x == along))) for x in frame
            ]
        return [
            self._short(symbol(letter), dot(axis, given))
            for letter, axis in zip("xyz", frame, strict=True)
        ]

    def _of_inputs(self, symbol: str, k: int, other: int) -> str:
        """Return a symbol with two inputs, if there are several."""
        several = len(self.rates.moving) > 1
        return symbol + rf"^{{({k + 1},{other + 1})}}" * several

    def _short(self, left: str, right: str) -> str:
        return self.sheet.short(DYNAMICS, left, right)

    # Loads.

    def _works(self) -> list[str]:
        """Return what all loads do per unit rate of each input."""
        totals = ["0" for _ in self.rates.moving]
        for place, load in enumerate(self.mechanism.loads):
            parts = load.components(self.mechanism)
            if any(part.rubs and part.rubs.grip for part in parts):
                self.left_out.append(load.name)
                continue
            for k, part in enumerate(parts):
                of = str(place + 1) + f",{k + 1}" * (len(parts) > 1)
                totals = [*map(total, totals, self._work(part, of, load.name))]
        return totals

    def _work(self, part: Component, of: str, name: str) -> list[str]:
        symbol = f"T_{{{of}}}"
        if isinstance(part.magnitude, TorqueTable):
            what = f"torque of table {text(name)} at the time"
            magnitude = self.sheet.give(symbol, what)
        else:
            right = law(expression_of(part.magnitude), self._named)
            magnitude = self._short(symbol, right)
        works = []
        for k in self.rates.moving:
            parts = [
                dot(self._moment(moment, f"{of},{place + 1}"), self._spin(k, moment))
                for place, moment in enumerate(part.moments)
            ]
            if part.pair:
                parts.append(self.rates.rate(k, self.mechanism.pair_number[part.pair]))
            works.append(product(magnitude, total(*parts)))
        return works

    def _spin(self, k: int, moment: LinkMoment) -> str:
        return self.rates.velocity(k, self.mechanism.link_number[moment.link])

    def _moment(self, moment: LinkMoment, of: str) -> str:
        """Return a moment, or that of a force with an arm."""
        link = self.mechanism.link_number[moment.link]
        along = self._vector(0 if moment.axes == "ground" else link, moment.direction)
        if moment.arm is not None:
            along = cross(self._vector(link, moment.arm), along)
        return self._short(rf"\mathbf{{M}}_{{{of}}}", along)

    def _vector(self, link: int, components: Vector) -> str:
        frame = self.positions.frames[link]
        parts = zip(components, frame, strict=True)
        return total(*(product(number(x), axis) for x, axis in parts))

    def _named(self, name: str) -> str:
        """Return the symbol of a name in the expression of a load."""
        kind, _, pair = name.partition("_")
        if kind == "t":
            return self.sheet.give("t", "time (s)")
        place = self.mechanism.pair_number[pair]
        symbol = self.positions.angle_symbol(place)
        if kind == "theta":
            return self.positions.angle(place)
        rates = [
            product(self.rates.rate(k, place), self.speed(k)) for k in self.rates.moving
        ]
        base, mark, index = symbol.partition("_")
        return self._short(rf"\dot{{{base}}}{mark}{index}", total(*rates))

    def _force(self, k: int, works: str) -> str:
        return self._short(self._input("Q", k), works)

    # The equation of motion.

    def speed(self, k: int) -> str:
        """Return the symbol of an input's rate."""
        return self.sheet.give(self._input(r"\dot{q}", k), "rate of an input (rad/s)")

    def acceleration(self, k: int) -> str:
        """Return the symbol of an input's acceleration."""
        what = "acceleration of an input (rad/s$^2$)"
        return self.sheet.give(self._input(r"\ddot{q}", k), what)

    def _input(self, letter: str, k: int) -> str:
        return letter if len(self.rates.moving) == 1 else f"{letter}_{{{k + 1}}}"

    def _torque(self, k: int) -> str:
        moving = self.rates.moving
        terms = [product(self.inertia(k, i), self.acceleration(i)) for i in moving]
        for i, j in combinations_with_replacement(moving, 2):
            speeds = product(self.speed(i), self.speed(j))
            if i == j:
                speeds = power(self.speed(i), "2")
            terms.append(product(self._christoffel(k, i, j), speeds))
        return self.sheet.put(
            DYNAMICS, self._input(r"\tau", k), total(*terms, minus(self.forces[k]))
        )

    def _christoffel(self, k: int, i: int, j: int) -> str:
        """Return what resists an input at rates 1 of two others, in both orders."""
        half = r"\frac{1}{2}"
        if i == j:
            whole = product("1" if i != k else half, self.inertia_slope(k, i, i))
            across = product(half, self.inertia_slope(i, i, k)) if i != k else "0"
            return total(whole, minus(across))
        if k in (i, j):
            return self.inertia_slope(k, k, j if k == i else i)
        parts = self.inertia_slope(k, i, j), self.inertia_slope(k, j, i)
        return total(*parts, minus(self.inertia_slope(i, j, k)))
