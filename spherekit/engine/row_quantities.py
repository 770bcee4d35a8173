"""What rows of designs may be asked for, as expressions.

Masses and loads as numbers that a kernel has as inputs.

What a mechanism's tensors are and what its loads are made of has one form for all designs;
the numbers in it, those of the texts of laws included, come one after another.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import TURN, listing, nearest
from spherekit.engine.algebra import Exprs, cross, dot, sum_of
from spherekit.engine.dyads import angle_of, place_by_inputs
from spherekit.engine.expression_graph import (
    Expr,
    ExpressionNode,
    derivatives,
    function,
    sign_of,
    symbols,
)
from spherekit.engine.kinematics import (
    CoordinateRates,
    InputMoments,
    Structure,
)
from spherekit.engine.loads import LoadState, forces_of
from spherekit.engine.pose import LinkOrientation, place_by_variables
from spherekit.engine.turns import Entries, ProfileColumns, TurningPairs
from spherekit.errors import EngineError
from spherekit.model.actions import wound_pairs
from spherekit.model.dynamics import need_no_rubbing
from spherekit.model.expression import Expression, Node
from spherekit.model.load import Component, LinkMoment, TorqueTable
from spherekit.model.mechanism import Mechanism
from spherekit.planning.inputs import Group, driven_pairs, plan_assembly

_Each = Callable[[Any], Any]


@dataclass(frozen=True)
class ActionParameters:
    """Tensors (rows of link axes) by link, and the components of every load."""

    tensors: tuple[tuple[str, tuple[tuple[Any, ...], ...]], ...]
    loads: tuple[tuple[Component, ...], ...]

    @staticmethod
    def of(mechanism: Mechanism) -> "ActionParameters":
        """Return those of a mechanism."""
        tensors = [
            (mass.link, tuple(tuple(map(float, row)) for row in mass.tensor))
            for mass in mechanism.masses
        ]
        return ActionParameters(
            tuple(tensors), tuple(load.components(mechanism) for load in mechanism.loads)
        )

    def mapped(self, change: _Each) -> "ActionParameters":
        """Return the same form with other numbers, asked for in one order."""
        tensors = tuple(
            (link, tuple(tuple(change(x) for x in row) for row in rows))
            for link, rows in self.tensors
        )
        loads = tuple(tuple(_component(x, change) for x in parts) for parts in self.loads)
        return ActionParameters(tensors, loads)

    @property
    def numbers(self) -> list[float]:
        """All numbers, in order."""
        numbers: list[float] = []
        self.mapped(numbers.append)
        return numbers

    @property
    def form(self) -> "ActionParameters":
        """What is left without the numbers: equal for mechanisms that differ in these."""
        return self.mapped(lambda number: 0.0)

    def replaced(self, numbers: Sequence[Expr]) -> "ActionParameters":
        """Return the same form with these numbers or terms."""
        more: Iterator[Expr] = iter(numbers)
        return self.mapped(lambda number: next(more))

    def by_link(self, mechanism: Mechanism) -> dict[int, Entries]:
        """Return the tensors (3, 3) by the number of their link."""
        made: dict[int, Entries] = {}
        for link, rows in self.tensors:
            plain = all(isinstance(x, float) for row in rows for x in row)
            made[mechanism.link_number[link]] = np.array(rows, float if plain else object)
        return made


def _component(part: Component, change: _Each) -> Component:
    law = part.magnitude
    if isinstance(law, Expression):
        law = Expression("", law.names, _tree(law.root, change))
    return Component(law, part.pair, tuple(_moment(x, change) for x in part.moments))


def _moment(moment: LinkMoment, change: _Each) -> LinkMoment:
    x, y, z = map(change, moment.direction)
    arm = None
    if moment.arm is not None:
        a, b, c = map(change, moment.arm)
        arm = a, b, c
    return LinkMoment(moment.link, (x, y, z), moment.axes, arm)


def _tree(node: Node, change: _Each) -> Node:
    if isinstance(node, tuple):
        return (node[0], *(_tree(part, change) for part in node[1:]))
    return node if isinstance(node, str) else change(node)


def sample_names(inputs: Sequence[str]) -> tuple[str, ...]:
    """Return what a sample is: angles (rad) of inputs, rates, accelerations, the time.

    ``q``, ``dq``, ``ddq`` and ``t``; with several inputs ``q_PAIR`` of each, and so on.
    """
    kinds = ("q", "dq", "ddq")
    if len(inputs) == 1:
        return (*kinds, "t")
    return (*(f"{kind}_{pair}" for kind in kinds for pair in inputs), "t")


def row_quantities(mechanism: Mechanism) -> dict[str, str]:
    """Return what rows of designs may be asked for, with the unit of each.

    ``q``; of R pairs ``theta_PAIR`` and ``rate_PAIR``, its derivative by q; of links
    ``velocity_coefficient_LINK_OTHER`` and ``acceleration_coefficient_LINK_OTHER``;
    ``transmission_angle_PAIR`` of the dyad in whose middle a pair is; ``B``, ``dB_dq``
    and ``torque`` where links have masses. With several inputs ``q_PAIR`` of each, and
    all others but angles end in ``_by_PAIR``, the input that moves: the torques too, and
    the inertias ``B_PAIR_by_PAIR``.
    """
    inputs = mechanism.names_of(driven_pairs(mechanism))
    return _quantities(mechanism, inputs, middle_pairs(mechanism))


def _quantities(
    mechanism: Mechanism, inputs: Sequence[str], middle: Sequence[str]
) -> dict[str, str]:
    angles = [pair.name for pair in mechanism.pairs if pair.kind.has_axis]
    units = ("rad", "rad/s", "rad/s2")
    names = sample_names(inputs)
    made = {name: units[k // len(inputs)] for k, name in enumerate(names[:-1])}
    made |= {"t": "s"} | {f"theta_{pair}": "rad" for pair in angles}
    by = [""] if len(inputs) == 1 else [f"_by_{pair}" for pair in inputs]
    made |= {f"rate_{pair}{ending}": "" for pair in angles for ending in by}
    made |= {f"transmission_angle_{pair}": "rad" for pair in middle}
    links = mechanism.links
    for kind, unit in (("velocity_coefficient", ""), ("acceleration_coefficient", "1/rad")):
        made |= {
            f"{kind}_{a}_{b}{ending}": unit
            for a in links
            for b in links
            if a != b
            for ending in by
        }
    if mechanism.masses and len(inputs) == 1:
        made |= {"B": "kg m2", "dB_dq": "kg m2/rad", "torque": "N m"}
    elif mechanism.masses:
        made |= {f"B_{a}_by_{b}": "kg m2" for a in inputs for b in inputs}
        made |= {f"torque_by_{pair}": "N m" for pair in inputs}
    return made


BENDS = 200
"""Rows of a table of torques that a kernel may have."""

Geometry = Callable[[Mapping[str, Expr]], TurningPairs]
"""The pairs in which sizes, by name, are terms."""


@dataclass(frozen=True)
class VariedTerms:
    """What kernels of a topology are written in, and their quantities.

    Attributes
    ----------
    structure
        The kinematics, with `sizes` for the numbers of the mechanism.
    actions
        Its masses and loads; numbers of these that differ are among the sizes too.
    sample, places
        The variables of `sample_names`, and the signs of dyads or the variables of pairs.
    variables
        Of pairs, where these are the places; those that follow from others as terms.
    links, squares, transmission_angles
        What `spherekit.engine.dyads.ClosedPlacements` are of these; the links alone where
        there is no closed form.
    turns
        Of passive pairs whose variables loads depend on, by name: what their turns (rad)
        add to angles that places give.
    """

    structure: Structure
    actions: ActionParameters
    sizes: tuple[ExpressionNode, ...]
    sample: tuple[ExpressionNode, ...]
    places: tuple[ExpressionNode, ...]
    variables: tuple[Expr, ...]
    links: tuple[LinkOrientation, ...]
    squares: Sequence[Expr]
    transmission_angles: Mapping[int, Expr]
    turns: Mapping[str, ExpressionNode]

    @staticmethod
    def of(
        mechanism: Mechanism,
        inputs: Sequence[str],
        sizes: Sequence[str] = (),
        geometry: Geometry | None = None,
        closed_form: bool | None = None,
        differing: Sequence[int] = (),
        closed: Floats | None = None,
    ) -> "VariedTerms":
        """Return the terms of a mechanism; by default in closed form where there is one.

        `differing` says which of the numbers of `ActionParameters` are terms, after the
        sizes; `closed` is a configuration (variables,) of the mechanism, if one is known.

        Raises
        ------
        EngineError
            If the engine does not know the mechanism's pairs or groups.
        """
        terms = symbols(sizes)
        pairs = geometry(dict(zip(sizes, terms, strict=True))) if geometry else None
        structure = Structure.of(mechanism, inputs, pairs, closed)
        sample = symbols(sample_names(inputs))
        if closed_form is None:
            closed_form = structure.assembly.has_closed_form
        squares: list[Expr] = []
        transmission_angles: dict[int, Expr] = {}
        variables: list[Expr] = []
        if closed_form:
            places = symbols([f"sign_{k + 1}" for k in range(len(structure.groups))])
            links, squares, transmission_angles = place_by_inputs(
                structure, sample[: len(inputs)], places
            )
        else:
            places = symbols(mechanism.variable_names)
            following = structure.following([places[v] for v in structure.inputs])
            variables = [following.get(v, place) for v, place in enumerate(places)]
            links = place_by_variables(mechanism, structure.pairs, variables)
        actions = ActionParameters.of(mechanism)
        numbers: list[Expr] = list(actions.numbers)
        more = symbols([f"number_{k}" for k in differing])
        for k, term in zip(differing, more, strict=True):
            numbers[k] = term
        return VariedTerms(
            structure,
            actions.replaced(numbers),
            sizes=(*terms, *more),
            sample=tuple(sample),
            places=tuple(places),
            variables=tuple(variables),
            links=tuple(links),
            squares=squares,
            transmission_angles=transmission_angles,
            turns={
                pair: symbols([f"turns_of_{pair}"])[0]
                for pair in wound_pairs(structure.mechanism)
                if pair not in inputs
            },
        )

    @cached_property
    def flow(self) -> CoordinateRates:
        """The rates."""
        return CoordinateRates(self.structure, self.links, self.variables)

    @property
    def closed_form(self) -> bool:
        """Whether the links are placed by the signs of dyads."""
        return bool(self.squares) or not self.places

    @property
    def profiles(self) -> tuple[ProfileColumns, ...]:
        """The profiles whose columns are handed in after the places."""
        return self.structure.pairs.columns

    @property
    def handed_in(self) -> list[ExpressionNode]:
        """The columns of profiles."""
        both = ((*profile.terms, profile.last) for profile in self.profiles)
        return [term for terms in both for term in terms]

    def _by_place(self, items: Sequence[Expr], v: int) -> list[Expr]:
        """Return the derivatives by a variable, along the profiles that run with it."""
        rates: dict[ExpressionNode, Expr] = {self.places[v]: 1.0}
        for profile in self.profiles:
            if profile.variable == v:
                rates |= zip(profile.terms, profile.along, strict=True)
        return derivatives(items, rates)

    def by_sizes(self, items: Sequence[Expr]) -> list[list[Expr]]:
        """Return the derivatives of expressions by each size, the loops kept closed.

        Then by the columns of profiles but for the last of each, if some are handed in.
        """
        if self.closed_form:
            return [derivatives(items, {size: 1.0}) for size in self.sizes]
        by_places = [self._by_place(items, v) for v in range(len(self.places))]
        columns = [term for profile in self.profiles for term in profile.terms]
        made = []
        for size in (*self.sizes, *columns):
            moved, _ = self.flow.answers(self.flow.misfit_rates(size))
            total = derivatives(items, {size: 1.0})
            for change, partial in zip(moved, by_places, strict=True):
                total = [x + y * change for x, y in zip(total, partial, strict=True)]
            made.append(total)
        return made

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism."""
        return self.structure.mechanism

    @cached_property
    def inputs(self) -> list[str]:
        """The names of the inputs' pairs."""
        return list(self.mechanism.names_of(self.structure.input_pairs))

    @cached_property
    def _named(self) -> dict[str, ExpressionNode]:
        return dict(zip(sample_names(self.inputs), self.sample, strict=True))

    @cached_property
    def _moments(self) -> InputMoments:
        return InputMoments(self.flow, self.actions.by_link(self.mechanism))

    def quantity(self, name: str) -> Expr:
        """Return one of `row_quantities` by its name, `EngineError` if there is none of it.

        Rates are of an input while the others rest.
        """
        middle = _middles(self.mechanism, self.structure.assembly.groups)
        quantities = _quantities(self.mechanism, self.inputs, middle)
        if name not in quantities:
            hint = nearest(name, quantities) or "."
            raise EngineError(
                f'{self.mechanism.name}: "{name}" is no quantity of a configuration{hint} '
                f"Quantities: {listing(quantities)}"
            )
        if name in self._named:
            return self._named[name]
        stem, moving = self._split(name)
        for prefix, make in (
            ("theta_", self.angle),
            ("transmission_angle_", self._transmission_angle),
        ):
            if name.startswith(prefix):
                return make(name.removeprefix(prefix))
        if stem == "torque":
            return self._torque(moving)
        if stem == "dB_dq":
            # B q'' + dB_dq q'^2 / 2 is what links resist.
            return 2.0 * self._moments.resistance(0, [1.0], [0.0])
        if stem.startswith("rate_"):
            variable = self._variable(stem.removeprefix("rate_"))
            return self.flow.tau[moving][variable] / self.flow.scale
        kind, _, text = stem.partition("_coefficient_")
        if kind == stem:
            one = stem.removeprefix("B").removeprefix("_")
            return self._moments.inertia(self.inputs.index(one) if one else 0, moving)
        return self._coefficient(kind, text, moving)

    def _split(self, name: str) -> tuple[str, int]:
        """Return a name without the input that moves, and the number of that."""
        ends = [f"_by_{pair}" for pair in self.inputs]
        fitting = [k for k, end in enumerate(ends) if name.endswith(end)]
        if len(self.inputs) == 1 or not fitting:
            return name, 0
        # Of pairs whose names end alike the longest is meant.
        moving = max(fitting, key=lambda k: len(ends[k]))
        return name.removesuffix(ends[moving]), moving

    def _coefficient(self, kind: str, text: str, moving: int) -> Expr:
        """Return a coefficient of two links: along the axis of a pair, or its size."""
        flow, mechanism = self.flow, self.mechanism
        link, other = (mechanism.link(name) for name in self._two_links(text))
        share = 1.0 / flow.scale
        rates = [rate * share for rate in flow.tau[moving]]
        w = [spin * share for spin in flow.w[moving]]
        variable = mechanism.angle_between(link, other)
        turning = np.asarray(w[link] - w[other])
        if variable is None:
            size = function("sqrt", dot(turning, turning))
            if kind == "velocity":
                return size
            along = np.asarray(turning * (1.0 / size))
        else:
            first, _ = mechanism.ends[mechanism.variable_owners[variable]]
            if kind == "velocity":
                return rates[variable] * (1.0 if first == other else -1.0)
            along = flow.vectors[variable]
        # A unit axis turns at right angles to itself.
        turned = flow.bias(rates, w)
        return dot(np.asarray(turned[link] - turned[other]), along)

    def _torque(self, moving: int) -> Expr:
        """Return the torque of an input: what links resist less what loads do."""
        mechanism, flow = self.mechanism, self.flow
        count, sample = len(self.inputs), self.sample
        speeds, accelerations = sample[count : 2 * count], sample[2 * count : 3 * count]
        name = f"dynamics.dynamics: abs(tau_{self.inputs[moving]})"
        figure = "eksergian.eksergian: abs(tau)" if count == 1 else name
        what = f'a kernel of designs does not solve for; runs do: --reduce "max({figure})"'
        need_no_rubbing(mechanism, what)
        angles = self._angles()
        state = LoadState(
            mechanism,
            self.links,
            flow.tau,
            flow.w,
            angles,
            [0.0] * len(angles),
            flow.moving(speeds)[1],
            self._named["t"],
            sign_of,
            self._table,
        )
        force = sum_of(forces_of(parts, state)[moving] for parts in self.actions.loads)
        return self._moments.resistance(moving, speeds, accelerations) - force / flow.scale

    def _angles(self) -> list[Expr]:
        """Return the variables of R pairs; those of contacts are zero, loads have none."""
        angles: list[Expr] = [0.0] * len(self.mechanism.variable_owners)
        for pair, variable in self.mechanism.angles.items():
            if pair in self.inputs:
                angles[variable] = self.sample[self.inputs.index(pair)]
            else:
                angles[variable] = self.angle(pair) + self.turns.get(pair, 0.0)
        return angles

    def _variable(self, pair: str) -> int:
        return self.mechanism.variables_of(self.mechanism.pair_number[pair])[0]

    def angle(self, pair: str) -> Expr:
        """Return the variable of an R pair, less its turns in closed form."""
        if not self.closed_form:
            return self.variables[self._variable(pair)]
        number = self.mechanism.pair_number[pair]
        return angle_of(self.structure, number, self.links)

    def _transmission_angle(self, pair: str) -> Expr:
        number = self.mechanism.pair_number[pair]
        if number in self.transmission_angles:
            return self.transmission_angles[number]
        groups = {g.middle: g for g in self.structure.assembly.groups if g.is_dyad}
        group = groups[number]
        near, middle, far = (self._axis(group.pairs[k]) for k in group.dyad_places)
        one, other = cross(near, middle), cross(middle, far)
        normal, level = cross(one, other), dot(one, other)
        sine, cosine = dot(normal, normal), level * level
        return function("atan2", function("sqrt", sine), function("sqrt", cosine))

    def _axis(self, pair: int) -> Exprs:
        (variable,) = self.mechanism.variables_of(pair)
        return self.flow.vectors[variable]

    def _two_links(self, text: str) -> tuple[str, str]:
        names = self.mechanism.links
        both = [(a, b) for a in names for b in names if f"{a}_{b}" == text]
        if len(both) > 1:
            raise EngineError(
                f'{self.mechanism.name}: "{text}" may be of links {both[0][0]} and '
                f"{both[0][1]} or of {both[1][0]} and {both[1][1]}; give links other names"
            )
        return both[0]

    def _table(self, name: str) -> Expr:
        """Return a torque over time: straight pieces, with a bend at each of its times."""
        (table,) = (load for load in self.mechanism.loads if load.name == name)
        assert isinstance(table, TorqueTable)
        if len(table.times) > BENDS:
            raise EngineError(
                f"{self.mechanism.name}: loads.{name}: a table of {len(table.times)} "
                f"torques cannot be part of a kernel, one of {BENDS} can; write the torque "
                "as an expression"
            )
        start, t = table.times[0], self._named["t"]
        if table.periodic:
            period = table.times[-1] - start
            angle = (t - start) * (TURN / period) - np.pi
            within = function("atan2", function("sin", angle), function("cos", angle))
            t = within * (period / TURN) + (start + 0.5 * period)
        slopes = np.diff(table.torques) / np.diff(table.times)
        torque = (t - start) * float(slopes[0]) + table.torques[0]
        for place, bend in zip(table.times[1:], np.diff(slopes).tolist(), strict=False):
            beyond = t - place
            torque = torque + 0.5 * bend * (beyond + beyond * sign_of(beyond))
        return torque


def middle_pairs(mechanism: Mechanism) -> tuple[str, ...]:
    """Return the pairs with a ``transmission_angle``: those in the middle of dyads."""
    return _middles(mechanism, plan_assembly(mechanism).groups)


def _middles(mechanism: Mechanism, groups: Sequence[Group]) -> tuple[str, ...]:
    return tuple(mechanism.pairs[group.middle].name for group in groups if group.is_dyad)
