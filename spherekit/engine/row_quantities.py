"""What rows of designs may be asked for, as expressions."""

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, final

import numpy as np

from spherekit.conventions import TURN, listing, nearest
from spherekit.engine.algebra import Exprs, SeriesExpressions, by_coordinate, cross, dot
from spherekit.engine.coordinate_rates import CoordinateRates
from spherekit.engine.expression_graph import Expr, function
from spherekit.engine.inertia import inertia
from spherekit.engine.input_moments import InputMoments
from spherekit.engine.kinematics import RateExpressions
from spherekit.engine.loads import LoadState, forces_of
from spherekit.engine.pose import spin_vectors
from spherekit.errors import EngineError
from spherekit.model.bearings import need_no_rubbing
from spherekit.model.load import TorqueTable
from spherekit.model.mechanism import Mechanism
from spherekit.planning.assembly import Group, plan_assembly
from spherekit.planning.inputs import driven_pairs

if TYPE_CHECKING:
    from spherekit.engine.design_kernel import DesignTerms


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
    inputs = [mechanism.pairs[pair].name for pair in driven_pairs(mechanism)]
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


@final
class RowQuantities:
    """The quantities of a row as expressions, each formed when it is asked for."""

    def __init__(self, terms: "DesignTerms") -> None:
        self.structure, self.actions = terms.structure, terms.actions
        self.links = terms.links
        self.dyads = terms.dyads
        self._turns = terms.turns
        mechanism = self.structure.mechanism
        pairs = self.structure.input_pairs
        self.inputs = [mechanism.pairs[pair].name for pair in pairs]
        self.sample = dict(zip(sample_names(self.inputs), terms.sample, strict=True))
        self.variables = None if terms.closed_form else terms.variables
        self._flows: dict[int, RateExpressions] = {}

    def of(self, name: str) -> Expr:
        """Return a quantity by its name; `EngineError` if there is none of it."""
        mechanism = self.structure.mechanism
        groups = self.structure.assembly.groups
        quantities = _quantities(mechanism, self.inputs, _middles(mechanism, groups))
        if name not in quantities:
            hint = nearest(name, quantities) or "."
            raise EngineError(
                f'{mechanism.name}: "{name}" is no quantity of a configuration{hint} '
                f"Quantities: {listing(quantities)}"
            )
        if name in self.sample:
            return self.sample[name]
        for prefix, make in (
            ("theta_", self.angle),
            ("transmission_angle_", self._transmission_angle),
        ):
            if name.startswith(prefix):
                return make(name.removeprefix(prefix))
        if len(self.inputs) > 1:
            stem, moving = self._split(name)
            return self._several(stem, moving)
        if name.startswith("rate_"):
            return self._rate(name.removeprefix("rate_"))
        if name in ("B", "dB_dq", "torque"):
            return self._inertia(name)
        kind, _, links = name.partition("_coefficient_")
        return self._coefficient(links, ("velocity", "acceleration").index(kind))

    # Several inputs: one moves while the others rest.

    def _split(self, name: str) -> tuple[str, int]:
        """Return a name without the input that moves, and the number of that."""
        ends = [f"_by_{pair}" for pair in self.inputs]
        fitting = [k for k, end in enumerate(ends) if name.endswith(end)]
        # Of pairs whose names end alike the longest is meant.
        moving = max(fitting, key=lambda k: len(ends[k]))
        return name.removesuffix(ends[moving]), moving

    @cached_property
    def _rates(self) -> CoordinateRates:
        return CoordinateRates(self.structure, self.links)

    @cached_property
    def _moments(self) -> InputMoments:
        tensors = self.actions.by_link(self.structure.mechanism)
        return InputMoments(self._rates, self.links, tensors)

    def _several(self, stem: str, moving: int) -> Expr:
        flow = self._rates
        if stem == "torque":
            return self._torque(moving)
        if stem.startswith("B_"):
            return self._moments.inertia(self.inputs.index(stem.removeprefix("B_")), moving)
        if stem.startswith("rate_"):
            number = self._variable(stem.removeprefix("rate_"))
            return flow.tau[moving][number] / flow.scale
        kind, _, text = stem.partition("_coefficient_")
        mechanism = self.structure.mechanism
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
        mechanism, flow = self.structure.mechanism, self._rates
        count, sample = len(self.inputs), list(self.sample.values())
        speeds, accelerations = sample[count : 2 * count], sample[2 * count : 3 * count]
        motion = self._moments.moving(speeds)
        angles = self._angles()
        state = LoadState(
            mechanism,
            self.links,
            flow.tau,
            flow.w,
            angles,
            [0.0] * len(angles),
            motion.rates,
            self.sample["t"],
            _sign,
            self._table,
        )
        force = self._force(state, moving)
        return motion.resistance(moving, accelerations) - force / flow.scale

    def _angles(self) -> list[Expr]:
        """Return the variables of R pairs; those of contacts are zero, loads have none."""
        mechanism = self.structure.mechanism
        angles: list[Expr] = [0.0] * len(mechanism.variable_owners)
        for pair, variable in mechanism.angles.items():
            if pair in self.inputs:
                angles[variable] = self.sample[self._of_input("q", pair)]
            else:
                angles[variable] = self.angle(pair) + self._turns.get(pair, 0.0)
        return angles

    def _of_input(self, kind: str, pair: str) -> str:
        return kind if len(self.inputs) == 1 else f"{kind}_{pair}"

    def needs_turns(self, columns: Sequence[str]) -> bool:
        """Return whether some of these depend on how often pairs have turned."""
        return any(column.split("_by_")[0] == "torque" for column in columns)

    def _force(self, state: LoadState, moving: int) -> Expr:
        """Return the generalised force of all loads on an input, by its number."""
        mechanism = self.structure.mechanism
        table = (
            "eksergian.eksergian: abs(tau)"
            if len(self.inputs) == 1
            else (f"dynamics.dynamics: abs(tau_{self.inputs[moving]})")
        )
        what = f'a kernel of designs does not solve for; runs do: --reduce "max({table})"'
        need_no_rubbing(mechanism, what)
        force: Expr = 0.0
        for parts in self.actions.loads:
            force = force + forces_of(parts, state)[moving]
        return force

    # One input.

    def _flow(self, order: int) -> RateExpressions:
        if order not in self._flows:
            self._flows[order] = RateExpressions(self.structure, self.links, order)
        return self._flows[order]

    def _by_q(self, flow: RateExpressions) -> SeriesExpressions:
        return 1.0 / flow.rate_of(self.structure.driven)

    def _variable(self, pair: str) -> int:
        mechanism = self.structure.mechanism
        return mechanism.variables_of(mechanism.pair_number[pair])[0]

    def angle(self, pair: str) -> Expr:
        """Return the variable of an R pair, less its turns in closed form."""
        structure = self.structure
        if self.variables is not None:
            return self.variables[self._variable(pair)]
        number = structure.mechanism.pair_number[pair]
        chain = structure.pairs.chains[number]
        first, second = (self.links[k] for k in structure.mechanism.ends[number])
        zero = first.direction(chain.constants[0][:, 0])
        side = first.direction(chain.constants[0][:, 1])
        reached = second.direction(chain.constants[1][0])
        return function("atan2", dot(side, reached), dot(zero, reached))

    def _rate(self, pair: str) -> Expr:
        flow = self._flow(0)
        variable = self._variable(pair)
        if variable == self.structure.driven:
            return 1.0
        return flow.tau[0][variable] / flow.tau[0][self.structure.driven]

    def _transmission_angle(self, pair: str) -> Expr:
        mechanism = self.structure.mechanism
        number = mechanism.pair_number[pair]
        groups = {g.middle: g for g in self.structure.assembly.groups if g.is_dyad}
        closed = {dyad.middle: dyad.transmission_angle for dyad in self.dyads}
        if number in closed:
            return closed[number]
        group = groups[number]
        near, middle, far = (self._axis(group.pairs[k]) for k in group.dyad_places)
        one, other = cross(near, middle), cross(middle, far)
        normal, level = cross(one, other), dot(one, other)
        sine, cosine = dot(normal, normal), level * level
        return function("atan2", function("sqrt", sine), function("sqrt", cosine))

    def _axis(self, pair: int) -> Exprs:
        (variable,) = self.structure.mechanism.variables_of(pair)
        (spin,) = spin_vectors(self.structure.pairs, self.links, variable)
        return spin.axis

    def _two_links(self, text: str) -> tuple[str, str]:
        mechanism = self.structure.mechanism
        both = [
            (a, b) for a in mechanism.links for b in mechanism.links if f"{a}_{b}" == text
        ]
        if len(both) > 1:
            raise EngineError(
                f'{mechanism.name}: "{text}" may be of links {both[0][0]} and {both[0][1]} '
                f"or of {both[1][0]} and {both[1][1]}; give links other names"
            )
        (links,) = both
        return links

    def _coefficient(self, text: str, order: int) -> Expr:
        mechanism = self.structure.mechanism
        link, other = (mechanism.link(name) for name in self._two_links(text))
        flow = self._flow(order)
        _, rate = flow.pole((other, link))
        scale = self._by_q(flow)
        made = by_coordinate(rate * scale, scale)[order]
        # The axis of a pair has a sense; without one it is that of the rotation itself.
        axis = mechanism.angle_between(link, other)
        return made * _sign(scale.coefficients[0]) if axis is None else made

    def _inertia(self, name: str) -> Expr:
        flow = self._flow(0 if name == "B" else 1)
        scale = self._by_q(flow)
        whole = inertia(flow, self.actions.by_link(self.structure.mechanism))
        made = by_coordinate(whole * scale * scale, scale)
        if name != "torque":
            return made[0 if name == "B" else 1]
        _, dq, ddq, t = self.sample.values()
        angles = self._angles()
        speed = dq * scale.coefficients[0]
        state = LoadState.along(
            flow,
            angles,
            [0.0] * len(angles),
            speed,
            t,
            _sign,
            self._table,
        )
        force = self._force(state, 0)
        return made[0] * ddq + 0.5 * made[1] * (dq * dq) - force * scale.coefficients[0]

    def _table(self, name: str) -> Expr:
        """Return a torque over time: straight pieces, with a bend at each of its times."""
        mechanism = self.structure.mechanism
        (table,) = (load for load in mechanism.loads if load.name == name)
        assert isinstance(table, TorqueTable)
        if len(table.times) > BENDS:
            raise EngineError(
                f"{mechanism.name}: loads.{name}: a table of {len(table.times)} torques "
                f"cannot be part of a kernel, one of {BENDS} can; write the torque as an "
                "expression"
            )
        start, t = table.times[0], self.sample["t"]
        if table.periodic:
            period = table.times[-1] - start
            angle = (t - start) * (TURN / period) - np.pi
            within = function("atan2", function("sin", angle), function("cos", angle))
            t = within * (period / TURN) + (start + 0.5 * period)
        slopes = np.diff(table.torques) / np.diff(table.times)
        torque = (t - start) * float(slopes[0]) + table.torques[0]
        for place, bend in zip(table.times[1:], np.diff(slopes).tolist(), strict=False):
            beyond = t - place
            torque = torque + 0.5 * bend * (beyond + beyond * _sign(beyond))
        return torque


def _sign(condition: Expr) -> Expr:
    return function("sign", condition)


def middle_pairs(mechanism: Mechanism) -> tuple[str, ...]:
    """Return the pairs with a ``transmission_angle``: those in the middle of dyads."""
    return _middles(mechanism, plan_assembly(mechanism).groups)


def _middles(mechanism: Mechanism, groups: Sequence[Group]) -> tuple[str, ...]:
    return tuple(mechanism.pairs[group.middle].name for group in groups if group.is_dyad)
