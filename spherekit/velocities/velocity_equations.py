"""Velocity equations as terms, in the variables of the inputs: rates, misfits, moments.

In homogeneous form: `tau[i]` are the rates of all variables times `scale` while input i
moves at the rate 1 and the others rest. The scale vanishes where these inputs do not say
how all variables move. Of one freedom tau are the minors of the velocity equations
(`spherekit.velocities.rate_expressions`), the rates in a parameter p that runs through the
dead centres of every pair, for nothing is divided. Rates by the input are those by p over
the scale, rates by the arc length of the curve in the space of all variables those over
|tau|.

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

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

from spherekit.arrays import Floats
from spherekit.errors import EngineError
from spherekit.mechanism.joint_construction import make_joints
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import Assembly, driven_at, plan_assembly
from spherekit.positions.loop_closure import Closure
from spherekit.positions.loop_tree import LoopTree
from spherekit.positions.motion_cache import assembly_by_count_or_rank, position_analysis_of
from spherekit.symbolic.expression_derivatives import differentiate
from spherekit.symbolic.expression_graph import (
    ADVICE_WITHOUT_EXPRESSIONS,
    Expr,
    ExpressionNode,
    dot,
)
from spherekit.symbolic.vector_algebra import Exprs, constants, cross, vector, vector_sum
from spherekit.velocities.axis_rotations import (
    AxisRotation,
    Entries,
    PairRotations,
    pair_rotations,
)
from spherekit.velocities.carried_vectors import carried_vectors, root
from spherekit.velocities.pose_expressions import (
    LinkOrientation,
    place_by_variables,
    place_link,
    sum_along_paths,
)
from spherekit.velocities.rate_expressions import GroupEquations

COINCIDENT = 1e-9
"""Axes of one link whose angle has a smaller sine are one axis."""


@dataclass(frozen=True)
class Structure:
    """What of a mechanism's kinematics does not depend on how links are placed."""

    mechanism: Mechanism
    assembly: Assembly
    pairs: PairRotations
    groups: tuple[GroupEquations, ...]

    @property
    def input_pairs(self) -> tuple[int, ...]:
        """The numbers of the inputs: the driven pairs without those that follow."""
        inputs = self.assembly.inputs
        return tuple(pair for pair in inputs if pair not in self.pairs.followers)

    @property
    def inputs(self) -> tuple[int, ...]:
        """The numbers of the inputs' variables."""
        return tuple(self.mechanism.variables_of(pair)[0] for pair in self.input_pairs)

    def moving(self, one: int) -> dict[int, Expr]:
        """Return the rates of the driven pairs while an input pair moves at the rate 1."""
        place = self.input_pairs.index(one)
        following = {pair: rates[place] for pair, rates in self.pairs.followers.items()}
        return self.at_rest | {one: 1.0} | following

    @property
    def at_rest(self) -> dict[int, Expr]:
        """The rates of the driven pairs while no input moves."""
        return dict.fromkeys(self.assembly.inputs, 0.0)

    def following(self, q: Sequence[Expr]) -> dict[int, Expr]:
        """Return the angles by variable that follow from the angles q of the inputs."""
        return {
            self.mechanism.variables_of(pair)[0]: dot(follower, [*q, 1.0])
            for pair, follower in self.pairs.followers.items()
        }

    @staticmethod
    def of(
        mechanism: Mechanism,
        input_pairs: str | Sequence[str],
        pairs: PairRotations | None = None,
        closed: Floats | None = None,
        by_rank: bool = False,
    ) -> "Structure":
        """Return the structure of a mechanism with these pairs as inputs.

        Its `pairs` may be those of a design, in terms, and some of them follow the inputs;
        where equations repeat, independent ones are chosen at a `closed` configuration
        (variables,), which is looked for where none is given. `by_rank` says that the rank
        at configurations leaves the degrees of freedom that counting does not, so that no
        configurations are searched for that.

        Raises
        ------
        EngineError
            If a profile is not a circle, or a group is too large.
        PlanError
            If the mechanism does not have a freedom for each input.
        """
        names = [input_pairs] if isinstance(input_pairs, str) else [*input_pairs]
        pairs = pairs or pair_rotations(mechanism)
        names += mechanism.names_of(pairs.followers)
        driven = driven_at(mechanism, names)
        if by_rank:
            assembly = plan_assembly(driven, by_rank)
        else:
            assembly = assembly_by_count_or_rank(driven)

        def vectors() -> Floats:
            values = closed
            if values is None:
                motion = position_analysis_of(driven_at(mechanism, input_pairs)).sparse(9)
                if np.all(motion.failed):
                    raise EngineError(
                        f"{mechanism.name}: no configuration was found at which to choose "
                        "independent equations; give a range of the input where it closes"
                    )
                values = motion.values[int(np.argmin(motion.failed))]
            closure = Closure.of(mechanism, make_joints(mechanism))
            return closure.at(values[None]).vectors[0]

        groups = (GroupEquations(mechanism, assembly, x, vectors) for x in assembly.groups)
        made = Structure(mechanism, assembly, pairs, tuple(groups))
        for private in (both for group in made.groups for both in group.private if both):
            held = [made.held(v) for v in private]
            for link in held[0].keys() & held[1].keys():
                normal = cross(*(constants(axes[link]) for axes in held))
                sine = root(dot(normal, normal))
                if isinstance(sine, float) and sine < COINCIDENT:
                    one, other = (mechanism.variable_names[v] for v in private)
                    raise EngineError(
                        f"{mechanism.name}: the axes of {one} and {other} coincide in "
                        "a link, so these two cannot be told apart",
                        ADVICE_WITHOUT_EXPRESSIONS,
                    )
        return made

    def held(self, variable: int) -> dict[int, Entries]:
        """Return a variable's vector (3,) in the axes of each link it is fixed in."""
        pair = self.mechanism.variable_owners[variable]
        ends, sides = self.mechanism.ends[pair], self.pairs.sides.get(pair)
        if sides is None:
            return dict(zip(ends, self.pairs.axes(pair), strict=True))
        owned = self.mechanism.variables_of(pair)
        place = owned.index(variable)
        chain = sides[place].chain
        (turn,) = chain.rotations
        if len(owned) == 1 or not isinstance(turn, AxisRotation):
            return {}
        return {ends[place]: chain.constants[0][:, 2] * ((1.0, -1.0)[place] * turn.scale)}


def _half_turn(basis: Exprs, rate: Exprs) -> Exprs:
    """Return half the sum of b x b' over the columns of two matrices (3, 3)."""
    return vector_sum(map(cross, basis.T, rate.T)) * 0.5


class VelocityEquations(ABC):
    """Velocities at given placements of the links, `variables` those that contacts run by.

    `vectors[v]` (3,) are the angular velocities of pairs' second links relative to the
    first per unit rate of variables, in ground axes, each `carried` by a link; `lines` are
    those of rolling contacts, by pair.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        pairs: PairRotations,
        placed: Sequence[LinkOrientation],
        variables: Sequence[Expr],
        about_centres: bool,
    ) -> None:
        self.mechanism, self.pairs = mechanism, pairs
        self.placed, self.variables = placed, variables
        self.tree = LoopTree.of(mechanism)
        self.carried, self.lines = carried_vectors(
            mechanism, pairs, placed, variables, about_centres
        )
        self.vectors = [carried.vector for carried in self.carried]
        self.owned = [mechanism.variables_of(pair) for pair in range(len(self.tree.ends))]

    @abstractmethod
    def answers(self, misfits: Mapping[int, Exprs]) -> list[Expr]:
        """Return how all variables answer to misfits (3,) of pairs, the inputs at rest."""

    @cached_property
    def _meetings(self) -> dict[int, tuple[Exprs, Exprs]]:
        """Of pairs that close loops: a frame (3, 3) of the second link.

        With it where the pair has that.
        """
        made = {}
        for pair in self.tree.chords:
            first, second = self.tree.ends[pair]
            chain = self.pairs.chains[pair]
            there = place_link(chain, self.placed[first], self.variables)
            made[pair] = self.placed[second].direction(chain.constants[-1].T), there.basis
        return made

    @property
    def misfits(self) -> dict[int, Exprs]:
        """By how much (3,) each pair that closes a loop is off, to first order (rad)."""
        return {
            pair: _half_turn(there, here) for pair, (here, there) in self._meetings.items()
        }

    @property
    def openness(self) -> Expr:
        """The square of by how much loops are open (rad2), half turns included."""
        gaps = ((here - there).ravel() for here, there in self._meetings.values())
        return 0.5 * sum((dot(gap, gap) for gap in gaps), 0.0)

    def parts(self, rates: Sequence[Expr]) -> list[Exprs]:
        """Return what pairs turn by (3,) at rates of their variables."""
        return [vector_sum([self.vectors[v] * rates[v] for v in of]) for of in self.owned]

    def accelerated(
        self, rates: Sequence[Expr], w: Sequence[Exprs]
    ) -> tuple[list[Expr], list[Exprs]]:
        """Return the accelerations of variables, and of pairs (3,), at no input's.

        `rates` are those of the variables by time, `w` (3,) the links' angular velocities.
        """
        changes = [
            carried.derivative(w[carried.link], rate) * rate
            for carried, rate in zip(self.carried, rates, strict=True)
        ]
        turning = [vector_sum(changes[v] for v in owned) for owned in self.owned]
        second = self.answers({pair: x * -1.0 for pair, x in enumerate(turning)})
        parts = zip(self.parts(second), turning, strict=True)
        return second, [part + turned for part, turned in parts]


class CoordinateRates(VelocityEquations):
    """Rates of a structure in homogeneous form, by default placed by its variables.

    `w[i][link]` (3,) are the angular velocities of links per unit rate of input i, times
    `scale` as `tau[i][v]` are.
    """

    def __init__(
        self,
        structure: Structure,
        variables: Sequence[Expr],
        placed: Sequence[LinkOrientation] = (),
    ) -> None:
        self.structure, given = structure, (structure.mechanism, structure.pairs)
        placed = placed or place_by_variables(*given, variables)
        super().__init__(*given, placed, variables, True)

    def _solved(
        self, driven: Mapping[int, Expr], misfits: Mapping[int, Exprs] | None = None
    ) -> tuple[list[Expr], Expr]:
        """Return the rates of all variables at those of the driven pairs, and the scale."""
        solved = {self.owned[pair][0]: rate for pair, rate in driven.items()}
        scale: Expr = 1.0
        for group in self.structure.groups:
            turned = self.parts([solved.get(v, 0.0) for v in range(len(self.vectors))])
            for pair, misfit in (misfits or {}).items():
                turned[pair] = turned[pair] - misfit * scale
            rates, factor = group.rates(self.vectors, turned)
            solved = {v: rate * factor for v, rate in solved.items()} | rates
            scale = scale * factor
        return [solved[v] for v in range(len(self.vectors))], scale

    @cached_property
    def _by_inputs(self) -> list[tuple[list[Expr], Expr]]:
        structure = self.structure
        return [self._solved(structure.moving(pair)) for pair in structure.input_pairs]

    @property
    def tau(self) -> list[list[Expr]]:
        """The rates of all variables by each input, times the scale."""
        return [rates for rates, _ in self._by_inputs]

    @property
    def scale(self) -> Expr:
        """The determinant of the equations: its sign changes where modes meet."""
        return self._by_inputs[-1][1]

    @cached_property
    def w(self) -> list[list[Exprs]]:
        """The angular velocities of links by each input, times the scale."""
        return [sum_along_paths(self.tree, self.parts(tau)) for tau in self.tau]

    def misfit_rates(self, by: ExpressionNode) -> dict[int, Exprs]:
        """Return the rates (3,) of the misfits by a size, the variables held."""
        made = {}
        for pair, bases in self._meetings.items():
            one, other = (
                _half_turn(
                    basis, vector(differentiate([*basis.ravel()], {by: 1.0})).reshape(3, 3)
                )
                for basis in bases
            )
            made[pair] = one - other
        return made

    def answers(self, misfits: Mapping[int, Exprs]) -> list[Expr]:
        """Return how all variables answer to misfits (3,) of pairs, the inputs at rest."""
        rates, scale = self._solved(self.structure.at_rest, misfits)
        share = 1.0 / scale
        return [rate * share for rate in rates]

    def seen(self, moving: int, link: int) -> Exprs:
        """Return the components (3,) of w along a link's basis while an input moves.

        What is fixed in the link has components that are numbers.
        """
        placed, parts = self.placed[link], []
        for v, sense in enumerate(self.tree.paths[link]):
            if sense:
                held = self.structure.held(v)
                along = (
                    placed.fixed_components(held[link])
                    if link in held
                    else placed.components(self.vectors[v])
                )
                parts.append(along * (float(sense) * self.tau[moving][v]))
        return vector_sum(parts)

    def moving(self, speeds: Sequence[Expr]) -> tuple[list[Expr], list[Expr], list[Exprs]]:
        """Return rates of inputs over `scale`, those of all variables, and w of links."""
        slow = [speed * (1.0 / self.scale) for speed in speeds]
        rates = [dot(column, slow) for column in zip(*self.tau, strict=True)]
        return slow, rates, [dot(column, slow) for column in zip(*self.w, strict=True)]

    def bias(self, rates: Sequence[Expr], w: Sequence[Exprs]) -> list[Exprs]:
        """Return the angular accelerations (3,) of links while no input accelerates.

        `rates` are those of the variables by time, `w` (3,) the links' angular velocities.
        """
        return sum_along_paths(self.tree, self.accelerated(rates, w)[1])


class InputMoments:
    """What links with tensors (3, 3), by number and in link axes, resist to inputs.

    Terms are over `unit`, kg m2, by default the largest number in the tensors.
    """

    def __init__(
        self, flow: CoordinateRates, tensors: Mapping[int, Entries], unit: float = 0.0
    ) -> None:
        self.flow = flow
        # Entries near 0 are made exact zeros, so they need a size near one.
        entries = (x for tensor in tensors.values() for x in tensor.flat)
        sizes = (abs(float(x)) for x in entries if not isinstance(x, ExpressionNode))
        self.unit = unit or max(sizes, default=1.0) or 1.0
        self._links = []
        for link, tensor in tensors.items():
            if link and np.any(tensor):
                placed = flow.placed[link]
                seen = [flow.seen(i, link) for i in range(len(flow.tau))]
                here = constants(placed.basis_tensor(tensor / self.unit))
                self._links.append((link, placed, seen, [here @ y for y in seen]))

    @property
    def matrix(self) -> list[list[Expr]]:
        """The inertia matrix by tau."""
        places = range(len(self.flow.tau))
        return [
            [
                sum(
                    (
                        dot(seen[max(i, k)], momenta[min(i, k)])
                        for _, _, seen, momenta in self._links
                    ),
                    0.0,
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
        places = range(len(slow))
        pulls: list[Expr] = [0.0 for _ in places]
        turned: dict[tuple[int, int], Expr] = dict.fromkeys(combinations(places, 2), 0.0)
        for link, placed, seen, momenta in self._links:
            acceleration, momentum = placed.components(bias[link]), dot(momenta, slow)
            for i in places:
                pulls[i] = pulls[i] + dot(momenta[i], acceleration)
            for k, i in turned:
                turned[k, i] = turned[k, i] + dot(cross(seen[i], seen[k]), momentum)
        for (k, i), part in turned.items():
            pulls[i] = pulls[i] + slow[k] * part
            pulls[k] = pulls[k] - slow[i] * part
        return pulls

    def resistance(
        self, moving: int, speeds: Sequence[Expr], accelerations: Sequence[Expr]
    ) -> Expr:
        """Return what links resist to an input while inputs move and accelerate so."""
        share = 1.0 / self.flow.scale
        slow, rates, w = self.flow.moving(speeds)
        pull = self.pull(self.flow.bias(rates, w), slow)[moving]
        push = dot(self.matrix[moving], [x * share for x in accelerations])
        return (push + pull) * share * self.unit
