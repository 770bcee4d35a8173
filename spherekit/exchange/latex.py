"""The formulas of a mechanism of dyads as LaTeX: positions, poles, coefficients, torque.

They are written as one would print them in a paper (Di Gregorio 2024), line by line from
named intermediate quantities, each from those before it.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from itertools import permutations, product

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import counted, listing, nearest
from spherekit.design.variables import ACTIONS, design_variable
from spherekit.engine.row_quantities import Actions
from spherekit.errors import EngineError
from spherekit.exchange.latex_math import broken
from spherekit.exchange.latex_positions import POSITIONS, Formula, Positions, Sheet, text
from spherekit.exchange.latex_rates import ACCELERATION, DYNAMICS, VELOCITY, Dynamics, Rates
from spherekit.files.write import document_of
from spherekit.model.dynamics import Gravity, need_no_rubbing
from spherekit.model.gears import link_axes, pair_frames, reference_frame
from spherekit.model.locking import restated, sizes_by_frames
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import LinkSizes, PoseGeometry
from spherekit.planning.inputs import plan_assembly
from spherekit.planning.poles import cells

FRAMES = (
    r"$\mathbf{i}_j$, $\mathbf{j}_j$, $\mathbf{k}_j$ are the axes of link $j$: "
    r"$\mathbf{k}_j$ is its first axis, and $\mathbf{j}_j$ leads from there to the second. "
    r"$\mathbf{t}^j_{ik}$ is the tangent to the arc of link $j$ at the axis "
    r"$\mathbf{u}_{ik}$, and $\mathbf{z}_{ik}$ is where that of the second link is when "
    "the angle of the pair is 0."
)
INTRODUCED: Mapping[str, str] = {
    POSITIONS: "The links of each dyad follow from three axes, the middle one at given arcs "
    r"from two that are known, on the side that the sign $s_k$ says.",
    VELOCITY: r"$\mathbf{w}_j = m_{j1} \, \mathbf{u}_{j1}$ is the angular velocity of link "
    r"$j$ against the ground per unit rate of the input, $m_{ij}$ the velocity coefficient "
    "of two links: their poles with a third link lie on one great circle (Aronhold and "
    "Kennedy). Where two of the three poles meet the ratio is 0/0, with a finite limit.",
    ACCELERATION: "Axes of pairs turn with their links; the derivatives of poles and "
    "coefficients follow from those of axes.",
    DYNAMICS: "Link axes turn with the link, so that only the angular velocity changes in "
    r"them: $J_j = \mathbf{w}_j \cdot (\mathbf{I}_j \mathbf{w}_j)$.",
}
POLES = (
    "Each pole is where two great circles meet, those through its poles with two other "
    r"links, case (a): $\mathbf{n}_{ij|k}$ is at right angles to the plane of "
    r"$\mathbf{u}_{ik}$ and $\mathbf{u}_{kj}$."
)


def latex(
    mechanism: Mechanism, quantities: Sequence[str] | None = None, vary: Sequence[str] = ()
) -> str:
    """Return the formulas of a mechanism of R pairs and dyads as a LaTeX document.

    Sizes, masses and the signs of the assembly mode are symbols, with their values in
    tables; arcs and angles of 0, 90 and 180 degrees are put in.

    Parameters
    ----------
    mechanism
        The mechanism, its inputs joined to the ground.
    quantities
        What is wanted, by the names of `spherekit.engine.row_quantities.row_quantities`;
        of vectors also without the component. By default the angles of pairs, poles and
        coefficients, and where there are masses the torque.
    vary
        Keys of sizes and masses of the mechanism's file that vary, ``links.2.arc``: they
        stay symbols whatever their values.

    Raises
    ------
    EngineError
        If positions or poles have no closed form, a quantity is not written as LaTeX, or
        a key is that of a load.
    FileError, DesignError
        If there is no number of a key.
    """
    made = Document(mechanism, vary)
    return made.text(made.wanted(quantities))


class Document:
    """What a document says of a mechanism; keys of `vary` are those that vary."""

    def __init__(self, mechanism: Mechanism, vary: Sequence[str]) -> None:
        assembly = plan_assembly(mechanism)
        for group in assembly.groups:
            if not group.is_dyad:
                members = sorted(link for body in group.bodies[1:] for link in body)
                raise EngineError(
                    f"{mechanism.name}: the {group.kind} of links "
                    f"{listing(mechanism.links[k] for k in members)} has no closed form, so "
                    "there are no formulas of it to print; choose an input from which all "
                    "follow by dyads, or export to a language in which it is solved"
                )
        self.varied, self.massive = _varied(mechanism, vary)
        mechanism, ground = _by_sizes(mechanism)
        self.mechanism, self.sheet = mechanism, Sheet()
        count = len(assembly.inputs)
        inputs = ["q"] if count == 1 else [f"q_{{{k + 1}}}" for k in range(count)]
        for symbol, pair in zip(inputs, mechanism.names_of(assembly.inputs), strict=True):
            self.sheet.give(symbol, f"angle of the input, pair {text(pair)}")
        self.positions = Positions(mechanism, self.sheet, inputs, self.varied, ground)

    @cached_property
    def rates(self) -> Rates:
        """Poles and coefficients."""
        return Rates(self.positions)

    @cached_property
    def dynamics(self) -> Dynamics:
        """Inertia, loads and torques."""
        return Dynamics(self.rates, self.massive)

    def text(self, wanted: Sequence[str]) -> str:
        """Return the document of what some texts follow from."""
        kept = self.sheet.needed(wanted)
        parts = [
            r"\documentclass[a4paper]{article}",
            r"\usepackage{amsmath}",
            r"\allowdisplaybreaks",
            r"\begin{document}",
            rf"\section*{{The spherical mechanism {text(self.mechanism.name)}}}",
            *self._notation(kept),
        ]
        ranks = [POSITIONS, VELOCITY, ACCELERATION, DYNAMICS]
        sections: dict[str, list[Formula]] = {}
        for formula in kept.formulas.values():
            sections.setdefault(formula.section, []).append(formula)
        for section in sorted(
            sections, key=lambda x: ranks.index(x) if x in ranks else 0.5
        ):
            rows = (rf"{x.left} &= {broken(x.right)}" for x in sections[section])
            parts += [
                rf"\section*{{{section}}}",
                INTRODUCED.get(section, POLES),
                r"\begin{align}",
                " \\\\\n".join(rows),
                r"\end{align}",
            ]
        left_out = self.__dict__["dynamics"].left_out if "dynamics" in self.__dict__ else []
        if left_out:
            parts.append(
                f"The friction of {text(listing(left_out))}, which follows from reactions, is "
                "left out of the generalized forces."
            )
        return "\n".join([*parts, r"\end{document}", ""])

    def _notation(self, kept: Sheet) -> Iterator[str]:
        mechanism, positions = self.mechanism, self.positions
        yield r"\section*{Notation}"
        named = zip(positions.index, mechanism.links, strict=True)
        links = [index if index == x else f"{index} ({text(x)})" for index, x in named]
        yield f"Links: {listing(links)}; link {positions.index[0]} is the ground. R pairs:"
        rows = [
            f"{text(pair.name)} & {positions.index[a]}, {positions.index[b]} & "
            f"${positions.pair_axes[k]}$ & ${positions.angle_symbol(k)}$"
            for k, (pair, (a, b)) in enumerate(
                zip(mechanism.pairs, mechanism.ends, strict=True)
            )
        ]
        yield _tabular("llll", ["pair & links & axis & angle", *rows])
        yield "Angles turn the second link of a pair against the first. " + FRAMES
        values = [x for x in kept.given.values() if x.value and x.meaning]
        yield _tabular("lll", [f"${x.symbol}$ & {x.meaning} & ${x.value}$" for x in values])
        open_ones = [x for x in kept.given.values() if not x.value]
        yield _tabular("ll", [f"${x.symbol}$ & {x.meaning}" for x in open_ones])
        tensors = [x for x in kept.given.values() if not x.meaning]
        if tensors:
            of = (f"${x.symbol} = {x.value}$" for x in tensors)
            yield f"Inertia about the centre of the sphere, in link axes (kg m$^2$): {', '.join(of)}."
        if "rates" in self.__dict__:
            yield from self._tables()

    def _tables(self) -> Iterator[str]:
        """Yield the Table of poles for each input that moves."""
        for k, table in enumerate(self.rates.plans):
            bodies = [text(table.name(body)) for body in table.bodies]
            marks = [[mark.replace("■", r"\cdot") for mark in row] for row in cells(table)]
            rows = zip(bodies, marks, strict=True)
            moves = f"${self.positions.inputs[table.input]}$ moves"
            yield f"Poles while {moves}: x those of pairs, I, II, \\ldots by passes:"
            entries = (" & ".join([body, *map("${}$".format, row)]) for body, row in rows)
            yield _tabular("c" * (len(bodies) + 1), [" & ".join(["", *bodies]), *entries])

    # What is wanted.

    def wanted(self, quantities: Sequence[str] | None) -> list[str]:
        """Return the texts that quantities are, and write what they follow from."""
        if quantities is None:
            return self._usual()
        table = dict(self._table())
        texts: list[str] = []
        for name in quantities:
            make = table.get(name) or table.get(name.rpartition("_")[0])
            if make is None:
                raise EngineError(
                    f'{self.mechanism.name}: "{name}" is not written as LaTeX'
                    f"{nearest(name, table) or ';'} there are {listing(table)}"
                )
            texts += make()
            if name.startswith(("torque", "generalized_force")):
                need_no_rubbing(self.mechanism, "formulas in LaTeX have none of")
        return texts

    def _usual(self) -> list[str]:
        rates, positions = self.rates, self.positions
        texts = [positions.angle(k) for k in range(len(self.mechanism.pairs))]
        texts += [pole for poles in rates.poles for pole in poles.values()]
        for k, link in product(rates.moving, range(1, len(self.mechanism.links))):
            texts += rates.coefficient(k, link, 0)
        return texts + (self.dynamics.torques if self.mechanism.masses else [])

    def _table(self) -> Iterator[tuple[str, Callable[[], Sequence[str]]]]:
        """Yield what gives the texts of each quantity, by its name."""
        mechanism, positions = self.mechanism, self.positions
        links, groups = mechanism.links, positions.assembly.groups
        inputs = mechanism.names_of(positions.assembly.inputs)
        moving = [*enumerate([""] if len(inputs) == 1 else [f"_by_{x}" for x in inputs])]

        def alone(make: Callable[..., str], *of: int) -> Callable[[], Sequence[str]]:
            return lambda: [make(*of)]

        for n, pair in enumerate(mechanism.pairs):
            yield f"theta_{pair.name}", alone(positions.angle, n)
            yield f"axis_{pair.name}", alone(positions.pair_axes.__getitem__, n)
            for k, end in moving:
                yield f"rate_{pair.name}{end}", alone(lambda *x: self.rates.rate(*x), k, n)
        for group in groups:
            (name,) = mechanism.names_of([group.middle])
            yield (
                f"transmission_angle_{name}",
                lambda of=group: [positions.transmission_angle(of)],
            )
        for n, link in enumerate(links):
            yield f"orientation_{link}", partial(positions.frames.__getitem__, n)
            for k, end in moving:
                yield f"angular_velocity_{link}{end}", alone(self._velocity, k, n)
                yield f"angular_velocity_dq_{link}{end}", alone(self._acceleration, k, n)
        for (k, end), (a, b) in product(moving, permutations(range(len(links)), 2)):
            of = f"{links[a]}_{links[b]}{end}"
            yield f"pole_{of}", alone(lambda *x: self.rates.pole(*x), k, a, b)
            yield f"velocity_coefficient_{of}", alone(self._coefficient, 0, k, a, b)
            yield f"acceleration_coefficient_{of}", alone(self._coefficient, 1, k, a, b)
        if mechanism.masses:
            for (i, a), (k, end) in product(enumerate(inputs), moving):
                name = f"B_{a}{end}" if end else "B"
                yield name, alone(lambda *x: self.dynamics.inertia(*x), i, k)
            if len(inputs) == 1:
                yield "dB_dq", alone(lambda: self.dynamics.inertia_slope(0, 0, 0))
            for k, end in moving:
                yield f"torque{end}", alone(lambda k: self.dynamics.torques[k], k)
                yield f"generalized_force{end}", alone(lambda k: self.dynamics.forces[k], k)

    def _velocity(self, k: int, link: int) -> str:
        return self.rates.velocity(k, link)

    def _acceleration(self, k: int, link: int) -> str:
        return self.rates.slope(k, self.rates.velocity(k, link))

    def _coefficient(self, order: int, k: int, one: int, other: int) -> str:
        return self.rates.coefficient(k, one, other)[order]


def _tabular(columns: str, rows: Sequence[str]) -> str:
    """Return a table in the middle of the page."""
    body = " \\\\\n".join(rows)
    table = rf"\begin{{tabular}}{{{columns}}}", body, r"\end{tabular}"
    return "\n".join([r"\begin{center}", *table, r"\end{center}"])


def _varied(mechanism: Mechanism, vary: Sequence[str]) -> tuple[set[Actions], set[str]]:
    """Return which sizes vary, and the links whose masses do."""
    document = document_of(mechanism)
    sizes: set[Actions] = set()
    links: set[str] = set()
    for key in vary:
        variable = design_variable(document, key)
        table, name, *_ = variable.path
        weighs = any(isinstance(load, Gravity) for load in mechanism.loads)
        if variable.slot is not None and variable.slot[0] in ("arcs", "angles", "zeros"):
            sizes.add(variable.slot)
        elif table == "mass" and not weighs:
            links.add(str(name))
        else:
            raise EngineError(
                f"{mechanism.name}: {key} is no symbol in LaTeX: numbers of loads, and of "
                "masses under gravity, are printed as numbers; vary arcs, angles, zeros or "
                "masses, or export to another language"
            )
    return sizes, links


def _by_sizes(mechanism: Mechanism) -> tuple[Mechanism, Floats]:
    """Return a mechanism by arcs and angles, and (3, 3) the axes of its ground as given.

    The first axis of a link is then its z axis, and the second is on the side of y.
    """
    if not isinstance(mechanism.geometry, PoseGeometry):
        return mechanism, np.eye(3)
    sizes, turns = {}, {}
    for link, axes in link_axes(mechanism).items():
        x, y, z = reference_frame(axes, next(iter(axes))).T
        turns[link] = turn = np.stack([-y, x, z])
        seen = [turn @ axis for axis in axes.values()]
        arcs = (float(np.arctan2(np.hypot(x, y), z)) for x, y, z in seen[1:])
        angles = (float(np.arctan2(-x, y)) for x, y, _ in seen[2:])
        sizes[link] = LinkSizes(tuple(axes), tuple(arcs), tuple(angles))
    first, second = (
        {pair.name: turns[pair.links[end]] @ of_end[pair.name] for pair in mechanism.pairs}
        for end, of_end in enumerate(pair_frames(mechanism))
    )
    geometry = sizes_by_frames(mechanism.pairs, (first, second), sizes)
    ground = turns[mechanism.ground]
    parts = restated(mechanism, turns=turns, ground=ground)
    return replace(mechanism, geometry=geometry, **parts), ground.T
