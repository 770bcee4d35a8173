"""What rows of designs may be asked for, as expressions."""

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from itertools import count, permutations, product
from typing import Any

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import TURN, Names
from spherekit.errors import CountError, EngineError
from spherekit.mechanism.friction import need_no_rubbing
from spherekit.mechanism.load import TorqueTable
from spherekit.mechanism.load_dependence import wound_pairs
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import (
    Assembly,
    driven_at,
    driven_pairs,
    plan_assembly,
)
from spherekit.symbolic.expression_derivatives import differentiate
from spherekit.symbolic.expression_graph import (
    Expr,
    ExpressionNode,
    dot,
    function,
    iterate_nodes,
    sign_of,
    symbols,
)
from spherekit.symbolic.vector_algebra import (
    Exprs,
    cofactors,
    cross,
    determinant,
    singular_values,
    vector,
)
from spherekit.tolerances import NO_MOTION
from spherekit.velocities.axis_rotations import PairRotations
from spherekit.velocities.coordinate_rates import CoordinateRates
from spherekit.velocities.dyad_expressions import angle_of, place_by_inputs
from spherekit.velocities.input_moments import InputMoments
from spherekit.velocities.kinematic_structure import KinematicStructure
from spherekit.velocities.load_expressions import LoadState, forces_of
from spherekit.velocities.load_numbers import actions_of, with_other_numbers
from spherekit.velocities.pose_expressions import LinkOrientation
from spherekit.wording import listing, nearest


def sample_names(inputs: Sequence[str]) -> Names:
    """Return what a sample is: angles (rad) of inputs, rates, accelerations, the time.

    ``q``, ``dq``, ``ddq`` and ``t``; with several inputs ``q_PAIR`` of each, and so on.
    """
    ends = [""] if len(inputs) == 1 else [f"_{pair}" for pair in inputs]
    return (*(kind + end for kind in ("q", "dq", "ddq") for end in ends), "t")


def row_quantities(mechanism: Mechanism) -> dict[str, str]:
    """Return what rows of designs may be asked for, with the unit of each.

    ``q``; of R pairs ``theta_PAIR`` and ``rate_PAIR``, its derivative by q, and
    ``axis_PAIR_x``; of links ``orientation_LINK_xy``, row x and column y of the rotation
    to ground axes, ``angular_velocity_LINK_x`` by q and its derivative
    ``angular_velocity_dq_LINK_x``; of two links ``velocity_coefficient_LINK_OTHER``,
    ``acceleration_coefficient_LINK_OTHER`` and ``pole_LINK_OTHER_x``, the unit vector that
    times the velocity coefficient is their relative angular velocity, NaN where they rest;
    of outputs that point ``direction_OUTPUT_x`` in the axes of the link they are seen from;
    with several inputs ``condition_number_OUTPUT`` of how it turns by them, or of how its
    direction moves by two, and ``jacobian_determinant_OUTPUT`` where that is square;
    ``transmission_angle_PAIR`` of the dyad in whose middle a pair is; ``determinant``, 0
    where the inputs do not say how all else moves. Where links have masses ``B``,
    ``dB_dq``, ``kinetic_energy``, ``torque``, and ``free_acceleration`` of the input
    without a torque, with the derivatives of an acceleration at given torques, ``A_q``,
    ``A_dq`` and ``B_torque``; where there are loads ``generalized_force``, their power per
    unit rate. With several inputs ``q_PAIR`` of each, and what depends on the input that
    moves ends in ``_by_PAIR``: torques too, and inertias ``B_PAIR_by_PAIR``;
    ``free_acceleration_PAIR`` is that of an input while all are free.
    """
    inputs = mechanism.names_of(driven_pairs(mechanism))
    table = _quantities(mechanism, inputs, _groups_of(mechanism))
    return {name: unit for name, (unit, *_) in table.items()}


LINEAR = {"A_q": "1/s2", "A_dq": "1/s", "B_torque": "1/(kg m2)"}
"""The derivatives of the accelerations of inputs at given torques, and their units."""

Quantity = tuple[str, Callable[..., Expr], tuple[Any, ...]]
"""A unit, what of `VariedTerms` gives the quantity, and of what."""

_Vector = Callable[..., Exprs]


def _quantities(
    mechanism: Mechanism, inputs: Sequence[str], assembly: Assembly
) -> dict[str, Quantity]:
    one, links = len(inputs) == 1, mechanism.links
    units = [unit for unit in ("rad", "rad/s", "rad/s2") for _ in inputs]
    sample = zip(sample_names(inputs), [*units, "s"], strict=True)
    table: dict[str, Quantity] = {
        name: (unit, lambda terms, k: terms.sample[k], (k,))
        for k, (name, unit) in enumerate(sample)
    }

    def put(name: str, unit: str, make: Callable[..., Expr], *of: Any) -> None:
        if name in table:
            make, of = VariedTerms.unclear, (name, of, table[name][2])
        table[name] = unit, make, of

    def put_vector(name: str, unit: str, make: _Vector, *of: Any, end: str = "") -> None:
        for place, axis in enumerate("xyz"):
            put(f"{name}_{axis}{end}", unit, VariedTerms.component, place, make, *of)

    angles = [pair.name for pair in mechanism.pairs if pair.kind.has_axis]
    moving = [("" if one else f"_by_{pair}", k) for k, pair in enumerate(inputs)]
    for pair in angles:
        put(f"theta_{pair}", "rad", VariedTerms.angle, pair)
    for pair, (end, k) in product(angles, moving):
        put(f"rate_{pair}{end}", "", VariedTerms.rate, pair, k)
    for pair in _middles(mechanism, assembly):
        put(f"transmission_angle_{pair}", "rad", VariedTerms.transmission_angle, pair)
    for kind, unit in (("velocity", ""), ("acceleration", "1/rad")):
        for (a, b), (end, k) in product(permutations(links, 2), moving):
            of = VariedTerms.coefficient, a, b, kind, k
            put(f"{kind}_coefficient_{a}_{b}{end}", unit, *of)
    for pair in angles:
        put_vector(f"axis_{pair}", "", VariedTerms.axis, pair)
    for (a, b), (end, k) in product(permutations(links, 2), moving):
        put_vector(f"pole_{a}_{b}", "", VariedTerms.pole, a, b, k, end=end)
    for link, (i, j) in product(links, product(range(3), repeat=2)):
        name = f"orientation_{link}_{'xyz'[i]}{'xyz'[j]}"
        put(name, "", VariedTerms.orientation, link, i, j)
    for link, (end, k) in product(links, moving):
        for kind, unit in (("", ""), ("_dq", "1/rad")):
            name = f"angular_velocity{kind}_{link}"
            put_vector(name, unit, VariedTerms.angular_velocity, kind, link, k, end=end)
    for output in mechanism.outputs:
        if output.direction is not None:
            put_vector(f"direction_{output.name}", "", VariedTerms.direction, output.name)
        if not one:
            put(f"condition_number_{output.name}", "", VariedTerms.condition, output.name)
        if len(inputs) == 3 or (len(inputs) == 2 and output.direction is not None):
            make = VariedTerms.jacobian_determinant
            put(f"jacobian_determinant_{output.name}", "", make, output.name)
    put("determinant", "", VariedTerms.determinant)
    if mechanism.masses or mechanism.loads:
        for end, k in moving:
            put(f"generalized_force{end}", "N m", VariedTerms.generalized_force, k)
    if not mechanism.masses:
        return table
    for (i, a), (end, k) in product(enumerate(inputs), moving):
        put("B" if one else f"B_{a}{end}", "kg m2", VariedTerms.inertia, i, k)
    if one:
        put("dB_dq", "kg m2/rad", VariedTerms.inertia_rate)
    for end, k in moving:
        put(f"torque{end}", "N m", VariedTerms.torque, k)
    for k, pair in enumerate(inputs):
        of_pair = "" if one else f"_{pair}"
        put(f"free_acceleration{of_pair}", "rad/s2", VariedTerms.free_acceleration, k)
        for (kind, unit), (end, j) in product(LINEAR.items(), moving):
            put(f"{kind}{of_pair}{end}", unit, VariedTerms.linearised, kind, k, j)
    put("kinetic_energy", "J", VariedTerms.kinetic_energy)
    return table


Geometry = Callable[[Mapping[str, Expr]], PairRotations]
"""The pairs in which sizes, by name, are terms."""


class VariedTerms:
    """What kernels of a topology are written in, and their quantities.

    By default in closed form where there is one. `differing` says which numbers of masses
    and loads are terms, after the sizes; `closed` is a configuration (variables,) of the
    mechanism, if one is known; `by_rank` is that of
    `KinematicStructure.from_mechanism`. `pointing` names pairs along whose axes outputs
    point, or has directions (3,) in axes of their links, where those of the mechanism vary.

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
    squares
        What `place_by_inputs` gives of signs.
    tables
        What the torques of tables are now, by the names of these loads.
    turns
        Of passive pairs whose variables loads depend on, by name: what their turns (rad)
        add to angles that places give.

    Raises
    ------
    EngineError
        If the engine does not know the mechanism's pairs or groups.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        inputs: Sequence[str],
        sizes: Sequence[str] = (),
        geometry: Geometry | None = None,
        closed_form: bool | None = None,
        differing: Sequence[int] = (),
        closed: Floats | None = None,
        pointing: Mapping[str, str | Exprs] | None = None,
        by_rank: bool = False,
    ) -> None:
        terms = symbols(sizes)
        pairs = geometry(dict(zip(sizes, terms, strict=True))) if geometry else None
        self.mechanism, self.inputs = mechanism, [*inputs]
        self._pointing = pointing or {}
        self.structure = structure = KinematicStructure.from_mechanism(
            mechanism, inputs, pairs, closed, by_rank
        )
        self.sample = symbols(sample_names(inputs))
        if closed_form is None:
            closed_form = structure.assembly.has_closed_form
        self.squares: list[Expr] = []
        self.variables: list[Expr] = []
        self._placed: list[LinkOrientation] = []
        if closed_form:
            self.places = symbols(f"sign_{k + 1}" for k in range(len(structure.groups)))
            given = self.sample[: len(inputs)], self.places
            self._placed, self.squares = place_by_inputs(structure, *given)
        else:
            self.places = symbols(mechanism.variable_names)
            following = structure.follower_angles(
                [self.places[v] for v in structure.inputs]
            )
            self.variables = [following.get(v, x) for v, x in enumerate(self.places)]
        more = symbols(f"number_{k}" for k in differing)
        of_place, place = dict(zip(differing, more, strict=True)), count()
        self.actions = with_other_numbers(
            actions_of(mechanism), lambda number: of_place.get(next(place), number)
        )
        self.sizes = (*terms, *more)
        tables = (x.name for x in mechanism.loads if isinstance(x, TorqueTable))
        self.tables = {table: symbols([f"torque_{table}"])[0] for table in tables}
        passive = (pair for pair in wound_pairs(mechanism) if pair not in inputs)
        self.turns = {pair: symbols([f"turns_of_{pair}"])[0] for pair in passive}

    @cached_property
    def flow(self) -> CoordinateRates:
        """The rates."""
        return CoordinateRates(self.structure, self.variables, self._placed)

    @property
    def closed_form(self) -> bool:
        """Whether the links are placed by the signs of dyads."""
        return bool(self.squares) or not self.places

    @property
    def profile_columns(self) -> list[ExpressionNode]:
        """What is handed in of profiles, after the places."""
        return [
            x
            for y in self.structure.pairs.sides_with_columns
            for x in (*y.column_symbols, y.last_derivative)
        ]

    def _by_place(self, items: Sequence[Expr], v: int) -> list[Expr]:
        """Return the derivatives by a variable, along the profiles that run with it."""
        rates: dict[ExpressionNode, Expr] = {self.places[v]: 1.0}
        for profile in self.structure.pairs.sides_with_columns:
            if profile.track.variable == v:
                rates |= zip(
                    profile.column_symbols, profile.column_derivatives, strict=True
                )
        return differentiate(items, rates)

    def by_sizes(self, items: Sequence[Expr]) -> list[list[Expr]]:
        """Return the derivatives of expressions by each size, the loops kept closed.

        Then by the columns of profiles but for the last of each, if some are handed in.
        """
        if self.closed_form:
            return [differentiate(items, {size: 1.0}) for size in self.sizes]
        used = set(iterate_nodes(items))
        if any(
            profile.last_derivative in used
            for profile in self.structure.pairs.sides_with_columns
        ):
            raise EngineError(
                f"{self.mechanism.name}: how a linearised motion changes with sizes is not "
                "known where profiles are no circles; compare designs by a sweep"
            )
        by_places = [self._by_place(items, v) for v in range(len(self.places))]
        columns = (
            x for y in self.structure.pairs.sides_with_columns for x in y.column_symbols
        )
        made = []
        for size in (*self.sizes, *columns):
            moved = self.flow.solve_loops(self.flow.closure_residual_rates(size))
            total = differentiate(items, {size: 1.0})
            for change, partial in zip(moved, by_places, strict=True):
                total = [x + y * change for x, y in zip(total, partial, strict=True)]
            made.append(total)
        return made

    @cached_property
    def _moments(self) -> InputMoments:
        number = self.mechanism.link_number
        tensors = {number[link]: np.array(rows, object) for link, rows in self.actions[0]}
        return InputMoments(self.flow, tensors)

    def quantity(self, name: str) -> Expr:
        """Return one of `row_quantities` by its name, `EngineError` if there is none of it.

        Rates are of an input while the others rest.
        """
        table = self._table
        if name not in table:
            raise EngineError(
                f'{self.mechanism.name}: "{name}" is no quantity of a configuration'
                f"{nearest(name, table) or '.'} Quantities: {listing(table)}"
            )
        _, make, of = table[name]
        return make(self, *of)

    @cached_property
    def _table(self) -> dict[str, Quantity]:
        return _quantities(self.mechanism, self.inputs, self.structure.assembly)

    def unclear(self, name: str, *several: Sequence[Any]) -> Expr:
        """Raise `EngineError`, for a name may be that of several quantities."""
        one, other = (listing([x for x in of if isinstance(x, str)]) for of in several)
        raise EngineError(
            f'{self.mechanism.name}: "{name}" may be of {one} or of {other}; give links or '
            "pairs other names"
        )

    def component(self, place: int, make: _Vector, *of: Any) -> Expr:
        """Return a component of one of the vectors below."""
        return make(self, *of)[place]

    @cached_property
    def _moved(self) -> list[tuple[list[Expr], list[Exprs]]]:
        """The rates of variables, and of links (3,), while each input moves at 1."""
        share = 1.0 / self.flow.scale
        return [
            ([rate * share for rate in tau], [spin * share for spin in w])
            for tau, w in zip(self.flow.tau, self.flow.w, strict=True)
        ]

    @cached_property
    def _turned(self) -> list[list[Exprs]]:
        """The derivatives (3,) of the rates of links by each input."""
        return [self.flow.bias_accelerations(*moved) for moved in self._moved]

    def determinant(self) -> Expr:
        """Return that of the velocity equations, whose zeros are those of the inputs."""
        return self.flow.scale

    def rate(self, pair: str, moving: int) -> Expr:
        """Return the rate of a pair's variable by an input."""
        return self.flow.tau[moving][self._variable(pair)] / self.flow.scale

    def axis(self, pair: str) -> Exprs:
        """Return the axis (3,) of an R pair in ground axes."""
        return self.flow.vectors[self._variable(pair)]

    def orientation(self, link: str, row: int, column: int) -> Expr:
        """Return an entry of the rotation from a link's axes to the ground's."""
        placed = self.flow.placed[self.mechanism.link(link)]
        return placed.direction(np.eye(3)[column])[row]

    def angular_velocity(self, kind: str, link: str, moving: int) -> Exprs:
        """Return that (3,) of a link in ground axes by an input, or its derivative."""
        of_links = self._turned[moving] if kind else self._moved[moving][1]
        return of_links[self.mechanism.link(link)]

    def _output(self, name: str) -> tuple[int, int, Any]:
        """Return an output's link, the one it is seen from, and where it points (3,)."""
        (output,) = (x for x in self.mechanism.outputs if x.name == name)
        link, base = map(self.mechanism.link, (output.link, output.relative_to))
        if output.direction is None:
            return link, base, None
        given = self._pointing.get(name, np.array(output.direction))
        if isinstance(given, str):
            return link, base, self.axis(given)
        return link, base, self.flow.placed[link].direction(given)

    def direction(self, name: str) -> Exprs:
        """Return what an output points at (3,), in the axes of the link it is seen from."""
        _, base, pointed = self._output(name)
        return self.flow.placed[base].direction(np.eye(3)).T @ pointed

    def _jacobian(self, name: str) -> list[Exprs]:
        """Return how an output turns (3,) by each input.

        By two, where it points, how its direction moves.
        """
        link, base, pointed = self._output(name)
        turning = [w[link] - w[base] for _, w in self._moved]
        if pointed is None or len(turning) != 2:
            return turning
        return [cross(spin, pointed) for spin in turning]

    def condition(self, name: str) -> Expr:
        """Return the condition number of an output's Jacobian."""
        columns = self._jacobian(name)
        if len(columns) > 3:
            columns = [*np.transpose(columns)]
        largest, *_, least = singular_values(columns)
        return largest / least

    def jacobian_determinant(self, name: str) -> Expr:
        """Return that of an output's square Jacobian; of a direction, seen along it."""
        one, two, *three = self._jacobian(name)
        return dot(cross(one, two), three[0] if three else self._output(name)[2])

    def inertia(self, one: int, other: int) -> Expr:
        """Return the inertia between two inputs."""
        share = 1.0 / self.flow.scale
        moments = self._moments
        return moments.matrix[one][other] * (share * share) * moments.unit

    def inertia_rate(self) -> Expr:
        """Return the derivative of the inertia: half of it resists a rate of 1."""
        return 2.0 * self._moments.resistance(0, [1.0], [0.0])

    def rates_left_over(self) -> Expr:
        """Return what the rates of the variables leave over in the loops, relatively.

        It is the norm over all loops and inputs, divided by that of the rates, and zero up
        to rounding where the equations that give the rates are independent. Where equations
        repeat each other, those that were chosen at one configuration may depend on each
        other at another one, and then their solution does not fit in the other loops.
        """
        flow = self.flow
        total: Expr = 0.0
        for tau, w in zip(flow.tau, flow.w, strict=True):
            parts = flow.pair_velocities(tau)
            left: Expr = 0.0
            for chord in flow.tree.chords:
                first, second = flow.tree.ends[chord]
                over = w[first] - w[second] + parts[chord]
                left = left + dot(over, over)
            total = total + left / dot(tau, tau)
        return function("sqrt", total)

    @cached_property
    def _compliance(self) -> list[list[Expr]]:
        """The inverse of the inertia matrix."""
        matrix, scale = self._moments.matrix, self.flow.scale
        share = scale * scale / (self._moments.unit * determinant(matrix))
        return [[x * share for x in row] for row in cofactors(matrix)]

    def kinetic_energy(self) -> Expr:
        """Return the kinetic energy of all links."""
        slow = self.flow.motion_rates(self._speeds).scaled_speeds
        moved = [dot(row, slow) for row in self._moments.matrix]
        return dot(slow, moved) * (0.5 * self._moments.unit)

    def coefficient(self, one: str, two: str, kind: str, moving: int) -> Expr:
        """Return a coefficient of two links: along the axis of a pair, or its size."""
        link, other = self.mechanism.link(one), self.mechanism.link(two)
        rates, w = self._moved[moving]
        variable = self.mechanism.angle_between(link, other)
        turning = w[link] - w[other]
        if kind == "velocity":
            if variable is None:
                return function("sqrt", dot(turning, turning))
            first, _ = self.mechanism.ends[self.mechanism.variable_owners[variable]]
            return rates[variable] * (1.0 if first == other else -1.0)
        if self._rest_together(one, two, moving):
            return 0.0
        # A unit axis turns at right angles to itself.
        turned = self._turned[moving]
        direction = self._relative_direction(one, two, moving)
        return dot(turned[link] - turned[other], direction)

    def pole(self, one: str, two: str, moving: int) -> Exprs:
        """Return the unit vector (3,) of two links' pole axis in ground axes.

        Times the velocity coefficient it is their relative angular velocity by an input. It
        is NaN where the links rest relative to each other and have no pole.
        """
        if self._rest_together(one, two, moving):
            return vector([np.nan] * 3)
        direction = self._relative_direction(one, two, moving)
        link, other = self.mechanism.link(one), self.mechanism.link(two)
        if self.mechanism.angle_between(link, other) is not None:
            return direction  # the axis of a pair is there while the pair rests
        w = self._moved[moving][1]
        spin, turning = w[max(link, other)], w[link] - w[other]
        # Of links that rest, what rounding leaves of the rate has a direction too. As in a
        # run, links rest below a part of their own rates. The root of the sign is 1 or NaN.
        least = NO_MOTION**2 * function("maximum", 1.0, dot(spin, spin))
        moves = function("sqrt", sign_of(dot(turning, turning) - least))
        return direction * moves

    def _relative_direction(self, one: str, two: str, moving: int) -> Exprs:
        """Return the unit vector (3,) of two links' relative angular velocity, or axis."""
        link, other = self.mechanism.link(one), self.mechanism.link(two)
        variable = self.mechanism.angle_between(link, other)
        if variable is not None:
            return self.flow.vectors[variable]
        w = self._moved[moving][1]
        return (w[link] - w[other]) * (1.0 / self.coefficient(one, two, "velocity", moving))

    def _rest_together(self, one: str, two: str, moving: int) -> bool:
        """Return whether inputs at rest hold two links together while an input moves.

        Then the difference of their angular velocities is zero as an expression, and not
        only at some configurations.
        """
        w = self._moved[moving][1]
        turning = w[self.mechanism.link(one)] - w[self.mechanism.link(two)]
        return not any(isinstance(x, ExpressionNode) or x != 0.0 for x in turning)

    @property
    def _speeds(self) -> Sequence[Expr]:
        return self.sample[len(self.inputs) : 2 * len(self.inputs)]

    def torque(self, moving: int) -> Expr:
        """Return the torque of an input: what links resist less what loads do."""
        return self._needed(moving, self.sample[2 * len(self.inputs) : -1])

    def _needed(self, moving: int, accelerations: Sequence[Expr]) -> Expr:
        """Return the torque of an input while inputs accelerate so."""
        resisted = self._moments.resistance(moving, self._speeds, accelerations)
        return resisted - self.generalized_force(moving)

    def free_acceleration(self, one: int) -> Expr:
        """Return the acceleration of an input while none has a torque."""
        still = [0.0] * len(self.inputs)
        needed = (self._needed(k, still) for k in range(len(still)))
        return -1.0 * dot(self._compliance[one], needed)

    def linearised(self, kind: str, one: int, other: int) -> Expr:
        """Return a derivative of an input's acceleration, the torques of all held.

        By the variable or rate of an input, all loops closed, or by its torque; about the
        motion of the sample.
        """
        if kind == "B_torque":
            return self._compliance[one][other]
        count = len(self.inputs)
        torques = [self.torque(k) for k in range(count)]
        rate = {self.sample[count + other]: 1.0}
        changes = differentiate(torques, rate if kind == "A_dq" else self._along(other))
        return -1.0 * dot(self._compliance[one], changes)

    def _along(self, moving: int) -> dict[ExpressionNode, Expr]:
        """Return the rates of the sample, places and profiles while an input moves."""
        rates: dict[ExpressionNode, Expr] = {self.sample[moving]: 1.0}
        if not self.closed_form:
            rates |= zip(self.places, self._moved[moving][0], strict=True)
        for profile in self.structure.pairs.sides_with_columns:
            speed = rates[self.places[profile.track.variable]]
            along = (x * speed for x in profile.column_derivatives)
            rates |= zip(profile.column_symbols, along, strict=True)
        return rates

    def generalized_force(self, moving: int) -> Expr:
        """Return the power of all loads per unit rate of an input."""
        mechanism, flow = self.mechanism, self.flow
        name = f"dynamics.dynamics: abs(tau_{self.inputs[moving]})"
        figure = "eksergian.eksergian: abs(tau)" if len(self.inputs) == 1 else name
        what = f'a kernel of designs does not solve for; runs do: --reduce "max({figure})"'
        need_no_rubbing(mechanism, what)
        angles = self._angles()
        turns = {self._variable(x): y * (1.0 / TURN) for x, y in self.turns.items()}
        state = LoadState(
            mechanism,
            flow.placed,
            flow.tau,
            flow.w,
            angles,
            [turns.get(variable, 0.0) for variable in range(len(angles))],
            flow.motion_rates(self._speeds).variable_rates,
            self.sample[-1],
            sign_of,
            self.tables.__getitem__,
        )
        forces = (forces_of(parts, state)[moving] for parts in self.actions[1])
        return sum(forces, 0.0) / flow.scale

    def _angles(self) -> list[Expr]:
        """Return the variables of R pairs; those of contacts are zero, loads have none."""
        angles: list[Expr] = [0.0] * len(self.mechanism.variable_owners)
        for pair, variable in self.mechanism.angles.items():
            if pair in self.inputs:
                angles[variable] = self.sample[self.inputs.index(pair)]
            else:
                angles[variable] = self.angle(pair)
        return angles

    def _variable(self, pair: str) -> int:
        return self.mechanism.variables_of(self.mechanism.pair_number[pair])[0]

    def angle(self, pair: str) -> Expr:
        """Return the variable of an R pair, less its turns in closed form."""
        if not self.closed_form:
            return self.variables[self._variable(pair)]
        return angle_of(self.structure, self.mechanism.pair_number[pair], self._placed)

    def transmission_angle(self, pair: str) -> Expr:
        """Return the angle in [0, pi/2] between the arcs of the dyad a pair is amid."""
        number = self.mechanism.pair_number[pair]
        dyads = (group for group in self.structure.assembly.groups if group.is_dyad)
        (group,) = (dyad for dyad in dyads if dyad.middle == number)
        near, middle, far = (
            self.flow.vectors[self.mechanism.variables_of(group.pairs[k])[0]]
            for k in group.dyad_positions
        )
        one, other = cross(near, middle), cross(middle, far)
        normal, level = cross(one, other), dot(one, other)
        sine, cosine = dot(normal, normal), level * level
        return function("atan2", function("sqrt", sine), function("sqrt", cosine))


def middle_pairs(mechanism: Mechanism) -> Names:
    """Return the pairs with a ``transmission_angle``: those in the middle of dyads."""
    return _middles(mechanism, _groups_of(mechanism))


def _groups_of(mechanism: Mechanism) -> Assembly:
    """Return the groups of a mechanism, by its graph alone.

    Names of quantities do not depend on sizes. So no configurations are searched where
    counting leaves too few degrees of freedom, and a file whose own sizes do not close has
    the quantities of its designs.
    """
    try:
        return plan_assembly(mechanism)
    except CountError:
        return plan_assembly(driven_at(mechanism), by_rank=True)


def _middles(mechanism: Mechanism, assembly: Assembly) -> Names:
    dyads = (group for group in assembly.groups if group.is_dyad)
    return tuple(mechanism.names_of(group.middle for group in dyads))
