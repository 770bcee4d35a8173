"""Velocity equations as terms, in the variables of the inputs: rates, misfits, moments.

In homogeneous form: `tau[i]` are the rates of all variables times `scale` while input i
moves at the rate 1 and the others rest. The scale vanishes where these inputs do not say
how all variables move. Of one freedom tau are the minors of the velocity equations
(`spherekit.engine.rates`), the rates in a parameter p that runs through the dead centres of
every pair, for nothing is divided. Rates by the input are those by p over the scale, rates
by the arc length of the curve in the space of all variables those over |tau|.

With links placed along a tree of pairs, the pairs that close loops miss each other by a
small rotation. At the inputs at rest the variables change so that all pairs fit again:
w_second - w_first = A x - e, with A the vectors of the pair's variables, x their changes,
and e the rotation by which its second link is turned against where the pair has it. With
the misfit of a configuration that is nearly closed, x is Newton's step; with the rate of
the misfit by a size, the derivative of the variables by it.

The moments that a motion takes at the inputs are Newton's and Euler's equations of the
links along the velocities that an input leaves free while the others rest:

    torque_i = sum_j w_ji . (I_j a_j + w_j x I_j w_j) - the power of the loads by input i,

with w_ji the angular velocity of link j per unit rate of input i.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from spherekit.arrays import Floats
from spherekit.engine.algebra import (
    Exprs,
    constants,
    cross,
    dot,
    sum_of,
    vector,
    vector_sum,
)
from spherekit.engine.expression_graph import (
    Expr,
    ExpressionNode,
    derivatives,
)
from spherekit.engine.pose import Angles, LinkOrientation, placed_by, spin_vectors
from spherekit.engine.rates import GroupRows, HomogeneousRates, group_rows
from spherekit.engine.turns import Entries, TurningPairs, turning_pairs
from spherekit.errors import EngineError
from spherekit.model.gears import geometry_of
from spherekit.model.mechanism import Mechanism
from spherekit.motion.closure import Closure
from spherekit.motion.loops import LoopTree
from spherekit.motion.motion import Motion, Tracer
from spherekit.planning.inputs import Assembly, driven_at, plan_assembly
from spherekit.sphere.rotation import max_abs


@final
@dataclass(frozen=True)
class Structure:
    """What of a mechanism's kinematics does not depend on how links are placed."""

    mechanism: Mechanism
    assembly: Assembly
    pairs: TurningPairs
    groups: tuple[GroupRows, ...]

    @property
    def input_pairs(self) -> tuple[int, ...]:
        """The numbers of the inputs: the driven pairs without those that follow."""
        followers = self.pairs.followers
        return tuple(pair for pair in self.assembly.inputs if pair not in followers)

    @property
    def driven(self) -> int:
        """The number of the only input's variable."""
        alone = len(self.input_pairs) == 1
        pair = self.input_pairs[0] if alone else self.assembly.input
        return self.mechanism.variables_of(pair)[0]

    @property
    def inputs(self) -> tuple[int, ...]:
        """The numbers of the inputs' variables."""
        owned = self.mechanism.variables_of
        return tuple(owned(pair)[0] for pair in self.input_pairs)

    def moving(self, one: int) -> dict[int, Expr]:
        """Return the rates of the driven pairs while an input pair moves at the rate 1."""
        place = self.input_pairs.index(one)
        rates = self.at_rest | {one: 1.0}
        for pair, follower in self.pairs.followers.items():
            rates[pair] = follower.ratios[place]
        return rates

    @property
    def at_rest(self) -> dict[int, Expr]:
        """The rates of the driven pairs while no input moves."""
        return dict.fromkeys(self.assembly.inputs, 0.0)

    def following(self, q: Sequence[Expr]) -> dict[int, Expr]:
        """Return the angles by variable that follow from the angles q of the inputs."""
        made = {}
        for pair, follower in self.pairs.followers.items():
            angle = follower.offset
            for ratio, at in zip(follower.ratios, q, strict=True):
                angle = angle + ratio * at
            made[self.mechanism.variables_of(pair)[0]] = angle
        return made

    @staticmethod
    def at(mechanism: Mechanism, values: Floats) -> "Structure":
        """Return the structure of a mechanism with its inputs, however many.

        Where equations repeat, independent ones are chosen at the closed configuration
        `values` (variables,).

        Raises
        ------
        EngineError
            If a profile is not a circle, or a group is too large.
        PlanError
            If the mechanism does not have as many freedoms as inputs.
        """
        assembly = plan_assembly(mechanism)
        pairs = turning_pairs(mechanism)

        def vectors() -> Floats:
            closure = Closure.of(mechanism, geometry_of(mechanism).joints)
            return np.asarray(closure.at(values[None]).vectors[0])

        groups = group_rows(mechanism, assembly, vectors)
        return Structure(mechanism, assembly, pairs, groups)

    @staticmethod
    def of(
        mechanism: Mechanism,
        input_pairs: str | Sequence[str],
        pairs: TurningPairs | None = None,
        closed: Motion | None = None,
    ) -> "Structure":
        """Return the structure of a mechanism with these pairs as inputs.

        Its `pairs` may be those of a design, in terms, and some of them follow the inputs;
        a motion that is known saves looking for a `closed` configuration where equations
        repeat.

        Raises
        ------
        EngineError
            If a profile is not a circle, or a group is too large.
        PlanError
            If the mechanism does not have a freedom for each input.
        """
        names = [input_pairs] if isinstance(input_pairs, str) else [*input_pairs]
        pairs = pairs or turning_pairs(mechanism)
        following = mechanism.names_of(pairs.followers)
        assembly = plan_assembly(driven_at(mechanism, [*names, *following]))

        def vectors() -> Floats:
            motion = closed or Tracer(mechanism, input_pairs, search=False).sparse(9)
            held = np.flatnonzero(~motion.failed)
            if not len(held):
                raise EngineError(
                    f"{mechanism.name}: no configuration was found at which to choose "
                    "independent equations; give a range of the input where it closes"
                )
            first = int(held[0])
            return np.asarray(motion.vectors[first])

        groups = group_rows(mechanism, assembly, vectors)
        return Structure(mechanism, assembly, pairs, groups)

    def span(self, one: int, other: int) -> Expr | None:
        """Return |A x B|^2 of two variables' vectors where it is constant, else None."""
        owners = self.mechanism.variable_owners
        if owners[one] == owners[other]:
            if self.pairs.columns:
                return None
            sizes = [self.pairs.spins[v][0].size for v in (one, other)]
            cosine = self.pairs.chains[owners[one]].constants[1][2, 2]
            return (sizes[0] * sizes[1]) ** 2 * (1.0 - cosine * cosine)
        held = [self.held(v) for v in (one, other)]
        for link in set(held[0]) & set(held[1]):
            both = cross(constants(held[0][link]), constants(held[1][link]))
            return dot(both, both)
        return None

    def vectors(self, placed: Sequence[LinkOrientation]) -> list[Exprs]:
        """Return the vectors (3,) of all variables, in ground axes, links placed."""
        variables = range(len(self.mechanism.variable_owners))
        spins = [spin_vectors(self.pairs, placed, v) for v in variables]
        return [vector_sum([spin.axis * spin.size for spin in parts]) for parts in spins]

    def solved(
        self,
        driven: Mapping[int, Expr],
        vectors: Sequence[Exprs],
        misfits: Mapping[int, Exprs] | None = None,
    ) -> HomogeneousRates:
        """Return the rates of all variables at those of the driven pairs."""
        solver = HomogeneousRates(self.mechanism, driven, vectors, self.span, misfits)
        for rows in self.groups:
            solver.close(rows)
        return solver

    def held(self, variable: int) -> dict[int, Entries]:
        """Return a variable's vector (3,) in the axes of each link it is fixed in."""
        spins = self.pairs.spins[variable]
        if len(spins) > 1 or any(spin.slide is not None for spin in spins):
            return {}
        twin = self.pairs.twin.get(variable)
        return {s.link: s.size * s.axis for s in (*spins, *([twin] if twin else []))}


def _rotations(
    structure: Structure,
    links: Sequence[LinkOrientation],
    variables: Sequence[Expr],
    pair: int,
) -> list[Exprs]:
    """Return the rotation (3, 3) of a pair's second link, and where the pair has it."""
    first, second = structure.mechanism.ends[pair]
    chain = structure.pairs.chains[pair]
    there = placed_by(chain, links[first], Angles(variables))
    return [
        np.stack([placed.direction(axis) for axis in np.eye(3)], axis=1)
        for placed in (links[second], there)
    ]


def _half_turn(basis: Exprs, rate: Exprs) -> Exprs:
    """Return half the sum of b x b' over the columns of two matrices (3, 3)."""
    total = vector([0.0, 0.0, 0.0])
    for k in range(3):
        total = total + cross(basis[:, k], rate[:, k])
    return np.asarray(total * 0.5)


def misfits(
    structure: Structure, links: Sequence[LinkOrientation], variables: Sequence[Expr]
) -> dict[int, Exprs]:
    """Return by how much (3,) each pair that closes a loop is off, to first order (rad)."""
    made = {}
    for pair in LoopTree.of(structure.mechanism).chords:
        here, there = _rotations(structure, links, variables, pair)
        made[pair] = _half_turn(there, here)
    return made


def openness(
    structure: Structure, links: Sequence[LinkOrientation], variables: Sequence[Expr]
) -> Expr:
    """Return the square of by how much loops are open (rad2), half turns included."""
    total: Expr = 0.0
    for pair in LoopTree.of(structure.mechanism).chords:
        here, there = _rotations(structure, links, variables, pair)
        for entry in (here - there).ravel():
            total = total + 0.5 * (entry * entry)
    return total


def misfit_rates(
    structure: Structure,
    links: Sequence[LinkOrientation],
    variables: Sequence[Expr],
    by: ExpressionNode,
) -> dict[int, Exprs]:
    """Return the rates (3,) of the misfits by a size, the variables held."""
    made = {}
    for pair in LoopTree.of(structure.mechanism).chords:
        turned = []
        for basis in _rotations(structure, links, variables, pair):
            rate = vector(derivatives(list(basis.ravel()), {by: 1.0})).reshape(3, 3)
            turned.append(_half_turn(basis, rate))
        made[pair] = np.asarray(turned[0] - turned[1])
    return made


def answers(
    structure: Structure,
    links: Sequence[LinkOrientation],
    misfit: dict[int, Exprs],
) -> list[Expr]:
    """Return how all variables answer to misfits (3,) of pairs, the inputs at rest."""
    return newton_step(structure, links, misfit)[0]


def newton_step(
    structure: Structure,
    links: Sequence[LinkOrientation],
    misfit: dict[int, Exprs],
) -> tuple[list[Expr], Expr]:
    """Return the `answers`, and the determinant of the equations."""
    solver = structure.solved(structure.at_rest, structure.vectors(links), misfit)
    made = [solver.rates[v] / solver.scale for v in range(len(solver.vectors))]
    return made, solver.scale


def rates_by_inputs(
    structure: Structure, links: Sequence[LinkOrientation]
) -> tuple[list[list[Expr]], Expr]:
    """Return the derivatives of all variables by each input, and the determinant.

    It is that of the equations: its sign changes where modes meet.
    """
    flow = CoordinateRates(structure, links)
    return [[rate / flow.scale for rate in tau] for tau in flow.tau], flow.scale


@final
class CoordinateRates:
    """Rates at given placements of the links.

    `vectors[v]` (3,) are the angular velocities of pairs' second links relative to the
    first per unit rate of variables, in ground axes; `w[i][link]` (3,) those of links per
    unit rate of input i, times `scale` as `tau[i][v]` are.
    """

    def __init__(self, structure: Structure, placed: Sequence[LinkOrientation]) -> None:
        self.structure, self.placed = structure, placed
        mechanism = structure.mechanism
        self.tree = LoopTree.of(mechanism)
        self._spins = [
            spin_vectors(structure.pairs, placed, v)
            for v in range(len(mechanism.variable_owners))
        ]
        self.vectors = structure.vectors(placed)
        self.tau: list[list[Expr]] = []
        for moving in structure.input_pairs:
            solver = structure.solved(structure.moving(moving), self.vectors)
            self.tau.append([solver.rates[v] for v in range(len(self.vectors))])
            self.scale = solver.scale
        self.w = [self.links(self._parts(tau)) for tau in self.tau]

    def _parts(self, rates: Sequence[Expr]) -> list[Exprs]:
        """Return what pairs turn by (3,) at rates of their variables."""
        owned = self.structure.mechanism.variables_of
        return [
            vector_sum([self.vectors[v] * rates[v] for v in owned(pair)])
            for pair in range(len(self.tree.ends))
        ]

    def links(self, parts: Sequence[Exprs]) -> list[Exprs]:
        """Return the sums (3,) of what pairs turn by, on the way to each link."""
        vectors = [vector_sum([])] * self.tree.count
        for pair, parent, child in self.tree.placements:
            ahead = self.tree.ends[pair][0] == parent
            part = parts[pair]
            vectors[child] = vectors[parent] + part if ahead else vectors[parent] - part
        return vectors

    def seen(self, moving: int, link: int) -> Exprs:
        """Return the components (3,) of w along a link's basis while an input moves.

        What is fixed in the link has components that are numbers.
        """
        placed, parts = self.placed[link], []
        for v, sense in enumerate(self.tree.paths[link]):
            if sense:
                held = self.structure.held(v)
                along = (
                    placed.fixed(held[link])
                    if link in held
                    else placed.seen(self.vectors[v])
                )
                parts.append(along * (float(sense) * self.tau[moving][v]))
        return vector_sum(parts)

    def moving(self, speeds: Sequence[Expr]) -> tuple[list[Expr], list[Expr], list[Exprs]]:
        """Return rates of inputs over `scale`, those of all variables, and w of links."""
        slow = [speed * (1.0 / self.scale) for speed in speeds]
        rates = [along(column, slow) for column in zip(*self.tau, strict=True)]
        return slow, rates, [along(column, slow) for column in zip(*self.w, strict=True)]

    def bias(self, rates: Sequence[Expr], w: Sequence[Exprs]) -> list[Exprs]:
        """Return the angular accelerations (3,) of links while no input accelerates.

        `rates` are those of the variables by time, `w` (3,) the links' angular velocities.
        """
        turning = [self._turning(pair, rates, w) for pair in range(len(self.tree.ends))]
        misfits = {pair: np.asarray(turned * -1.0) for pair, turned in enumerate(turning)}
        solver = self.structure.solved(self.structure.at_rest, self.vectors, misfits)
        share = 1.0 / solver.scale
        second = [solver.rates[v] * share for v in range(len(self.vectors))]
        accelerated = self._parts(second)
        return self.links([a + b for a, b in zip(accelerated, turning, strict=True)])

    def _turning(self, pair: int, rates: Sequence[Expr], w: Sequence[Exprs]) -> Exprs:
        """Return the change (3,) of what a pair turns by, while its rates stay."""
        mechanism = self.structure.mechanism
        variables = mechanism.variables_of(pair)
        if mechanism.pairs[pair].kind.has_axis:
            # w_first x (rate axis), and rate axis = w_second - w_first.
            first, second = mechanism.ends[pair]
            return cross(w[first], w[second])
        changes = [
            spin.change(w[spin.link], rates[v]) * (spin.size * rates[v])
            for v in variables
            for spin in self._spins[v]
        ]
        return vector_sum(changes)


def along(parts: Sequence[Any], rates: Sequence[Expr]) -> Any:
    """Return the sum of numbers, terms or vectors times rates."""
    total = parts[0] * rates[0]
    for part, rate in zip(parts[1:], rates[1:], strict=True):
        total = total + part * rate
    return total


@final
class InputMoments:
    """What links with tensors (3, 3), by number and in link axes, resist to inputs.

    Terms are over `unit`, kg m2, by default the largest number in the tensors.
    """

    def __init__(
        self,
        flow: CoordinateRates,
        tensors: Mapping[int, Entries],
        unit: float = 0.0,
    ) -> None:
        self.flow = flow
        # Entries near 0 are made exact zeros, so they need a size near one.
        plain = [tensor for tensor in tensors.values() if tensor.dtype != object]
        sizes = [float(max_abs(tensor)) for tensor in plain]
        self.unit = unit or max(sizes, default=1.0) or 1.0
        self._links = []
        for link, tensor in tensors.items():
            if link and np.any(tensor):
                placed = flow.placed[link]
                seen = [flow.seen(i, link) for i in range(len(flow.tau))]
                here = constants(placed.tensor(tensor / self.unit))
                self._links.append((link, placed, seen, [here @ y for y in seen]))

    @property
    def matrix(self) -> list[list[Expr]]:
        """The inertia matrix by tau."""
        places = range(len(self.flow.tau))
        return [
            [
                sum_of(
                    dot(seen[max(i, k)], momenta[min(i, k)])
                    for _, _, seen, momenta in self._links
                )
                for k in places
            ]
            for i in places
        ]

    def pull(self, bias: Sequence[Exprs], slow: Sequence[Expr]) -> list[Expr]:
        """Return what links resist by at no acceleration of the inputs, by tau.

        `slow` are the rates of the inputs over the scale of the flow. With y_i the rates
        w_ji seen from the link, h its momentum: y_i . I b, as I y_i . b, and
        y_i . (w x h) = sum of s_k h . (y_i x y_k), of which one sign is enough.
        """
        count = len(slow)
        pulls: list[Expr] = [0.0] * count
        turned: list[list[Expr]] = [[0.0] * count for _ in range(count)]
        for link, placed, seen, momenta in self._links:
            acceleration, momentum = placed.seen(bias[link]), along(momenta, slow)
            for i in range(count):
                pulls[i] = pulls[i] + dot(momenta[i], acceleration)
            if not np.array_equal(placed.metric, np.eye(3)):
                # Only in axes at right angles are components those of cross products.
                seen, momentum = [w[link] for w in self.flow.w], placed.basis @ momentum
            for i in range(count):
                for k in range(i):
                    turned[i][k] = turned[i][k] + dot(cross(seen[i], seen[k]), momentum)
        for i in range(count):
            for k in range(i):
                pulls[i] = pulls[i] + slow[k] * turned[i][k]
                pulls[k] = pulls[k] - slow[i] * turned[i][k]
        return pulls

    def inertia(self, one: int, other: int) -> Expr:
        """Return the inertia between two inputs."""
        share = 1.0 / self.flow.scale
        return self.matrix[one][other] * (share * share) * self.unit

    def resistance(
        self, moving: int, speeds: Sequence[Expr], accelerations: Sequence[Expr]
    ) -> Expr:
        """Return what links resist to an input while inputs move and accelerate so."""
        share = 1.0 / self.flow.scale
        slow, rates, w = self.flow.moving(speeds)
        pull = self.pull(self.flow.bias(rates, w), slow)[moving]
        push = along(self.matrix[moving], [x * share for x in accelerations])
        return (push + pull) * share * self.unit
