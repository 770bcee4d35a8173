"""Singularity of mechanisms with several inputs at given configurations.

Each input i, moved alone with the others locked, makes a mechanism with one freedom, in
which the output link turns about u_i with rate w_i, and c_i w_i = d_i q_i' (Di Gregorio
2015). The same is said without poles by the motions that close the loops: with N a basis
of them, N_a its rows of the inputs and E N the output's rates, type II is det N_a = 0 and
type I a loss of rank of E N. All of these stay finite on singularities.

Singular configurations as the inputs and the output see them.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cached_property, partial
from itertools import combinations
from typing import Any, Literal

import numpy as np

from spherekit.arrays import Bools, Floats, SmallIntegers
from spherekit.geometry.vectors import all_finite, cross, nans
from spherekit.numerics.array_rows import ArrayRows
from spherekit.planning.pole_plan import Pole, pole_of
from spherekit.positions.input_revolutions import in_range, into_range
from spherekit.positions.motion import Motion, make_motion
from spherekit.positions.position_solver import PositionSolver
from spherekit.singularities.input_output_relation import FourLinks, relation_of
from spherekit.singularities.slices import LocusPoints, SingularityLocus, adjugate
from spherekit.singularities.stationarity import InputsLocked, OutputStationary
from spherekit.singularities.tangent_space import (
    OutputPart,
    TangentSpace,
    decomposed,
    tangent_space,
)
from spherekit.velocities.pole_evaluation import evaluate
from spherekit.velocities.pole_request import request
from spherekit.velocities.transmission import SINGULAR, Transmission
from spherekit.velocities.transmission import hold as hold_of

ALONE = 10.0
"""A single-freedom mechanism is singular below this multiple of the tolerance."""
VANISHES = 1e-8
"""A coefficient or triple product below this vanishes."""


class RowType(IntEnum):
    """Gosselin and Angeles's types; type III is I and II at once.

    SELF_MOTION: a motion in which the inputs and the output rest, and none in which only
    one of them does. Where the loops lose their rank, as sheets of configurations cross,
    the row is of type II or a self-motion: type I is not asked for there. UNKNOWN: no
    configuration.
    """

    REGULAR = 0
    I = 1  # noqa: E741
    II = 2
    III = 3
    SELF_MOTION = 4
    UNKNOWN = -1

    @property
    def label(self) -> str:
        """The type in tables: regular, I, II, III, self-motion, or nothing."""
        return LABELS.get(self, self.name)


LABELS = {
    RowType.REGULAR: "regular",
    RowType.SELF_MOTION: "self-motion",
    RowType.UNKNOWN: "",
}


@dataclass(frozen=True)
class OutputCoefficients:
    """n rows of a motion with g inputs, with each moved alone, and all together.

    NaN where the motion failed.

    Attributes
    ----------
    w
        (n, g, 3) angular velocity of the output per unit rate of each input, in ground
        axes; NaN where that is infinite or undetermined.
    u
        (n, g, 3) unit vectors along the pole axes of the output, with the signs that
        `spherekit.velocities.pole_evaluation` gives them; finite on singularities too.
    c, d
        (n, g) of c w_i = d q_i', from the pole axes, at most 1 in size.
    input_rate, output_rate
        (n, g) of the unit motion in which input i moves alone: its rate, which vanishes
        with c_i and has the sign of det N_a, and the size of the output's, which vanishes
        with d_i. NaN where that motion is not unique.
    alone
        (n, g, 3) unit vectors along the output's angular velocity in that motion, NaN where
        it is at rest: the pole axes, up to their signs, also where the plan knows none.
    type_two
        (n,) how surely the inputs hold the output, see `spherekit.velocities.transmission`:
        0 where it can move with the inputs at rest, also where the loops lose their rank.
    hold
        (n,) how surely they hold all links, see `hold` there.
    type_one
        (n,) how surely the inputs rest where the output does: of all motions, seen as rates
        of the inputs and of the output, the sine of the angle to those in which the output
        rests; 0 where inputs can move though it does. Self-motions do not count.
    reciprocal_condition
        (n,) relative smallest singular value of the closure Jacobian.
    type, group
        (n,) `RowType`, and the group of Di Gregorio's discussion: 1 for singularities of at
        least one of the single-freedom mechanisms, 2 for those that are of none, 0 for
        regular configurations.
    """

    w: Floats
    u: Floats
    c: Floats
    d: Floats
    input_rate: Floats
    output_rate: Floats
    alone: Floats
    type_two: Floats
    hold: Floats
    type_one: Floats
    reciprocal_condition: Floats
    type: SmallIntegers
    group: SmallIntegers

    @property
    def triples(self) -> Floats:
        """(n, k) triple products of the u of any three inputs."""
        threes = np.array([*combinations(range(self.u.shape[1]), 3)], dtype=int)
        with np.errstate(invalid="ignore"):
            return np.linalg.det(self.u[:, threes.reshape(-1, 3)])


def coefficients(
    motion: Motion, output: OutputStationary, by_rank: bool = False
) -> OutputCoefficients:
    """Return the coefficients of an output, and the type of every row of a motion.

    Parameters
    ----------
    motion
        Any motion of a mechanism with at least one input.
    output
        Which link's rates count, from `spherekit.singularities.stationarity.output_of`.
    by_rank
        That of `spherekit.planning.pole_planner.plan`.
    """
    links = (output.link, output.relative_to)
    held = _held(motion)
    space = tangent_space(motion.linearisation, len(held))
    alone = space.basis @ adjugate(space.basis[:, held])
    related: list[tuple[Floats, ...]] = []
    with np.errstate(invalid="ignore", divide="ignore"):
        alone /= np.linalg.norm(alone, axis=1, keepdims=True)
        for k, pair in enumerate(motion.assembly.inputs):
            r, i = motion.mechanism.ends[pair]
            wanted = request(
                motion.mechanism,
                motion.mechanism.pairs[pair].name,
                tuple(combinations(sorted({i, r, *links}), 2)),
                [output.pole],
                by_rank=by_rank,
            )
            # With the others locked links are called by one link of their body each.
            body = wanted.plan.body
            named = {body[link]: link for link in (*links[::-1], r, i)}
            four = FourLinks(*(named[body[link]] for link in (i, r, *links)))
            field = evaluate(motion, wanted)
            w = field.w[output.link] - field.w[output.relative_to]
            direction = partial(
                _direction,
                planned=field.direction,
                driven=(pole_of(four.i, four.r), space.at.vectors[:, held[k]]),
                rates=space.at.body_rates(alone[:, :, k]),
            )
            related.append((w, *_relation(four, direction)))
        w, c, d, u = (np.stack(parts, axis=1) for parts in zip(*related, strict=True))
        c[motion.failed] = d[motion.failed] = u[motion.failed] = np.nan
        return OutputCoefficients(w, u, c, d, **by_motions(motion, space, output))


def _relation(four: FourLinks, direction: Callable[[Pole], Floats]) -> tuple[Floats, ...]:
    """Return c, d (n,) and u (n, 3) of form i, from the axes of poles.

    An output that is locked has none, c = 1 and d = 0.
    """
    if four.o == four.s:
        n = len(direction(pole_of(four.i, four.r)))
        return np.ones(n), np.zeros(n), nans((n, 3))
    made = relation_of("i", four, direction)
    return made.c, made.d, made.poles.os


def _direction(
    pole: Pole,
    planned: Mapping[Pole, Floats],
    driven: tuple[Pole, Floats],
    rates: Floats,
) -> Floats:
    """Return the axis (n, 3) of a pole by the plan, or where that knows none by rates.

    These are of links in the motion in which one input moves alone, finite at
    singularities. An axis of links that rest in it is NaN, but for the input's own.
    """
    between = driven[1] if pole == driven[0] else rates[:, pole[0]] - rates[:, pole[1]]
    size = np.linalg.norm(between, axis=1, keepdims=True)
    moved = between / np.where(size > SINGULAR, size, np.nan)
    return np.where(np.isfinite(planned[pole]), planned[pole], moved)


def _held(motion: Motion) -> list[int]:
    return [motion.mechanism.variables_of(pair)[0] for pair in motion.assembly.inputs]


def by_motions(
    motion: Motion, space: TangentSpace, output: OutputStationary
) -> dict[str, Any]:
    """Return those of `OutputCoefficients` that the motions that close the loops say."""
    held, tree = _held(motion), space.tree
    inputs = space.basis[:, held]
    moving = output.equations(space.at) @ space.basis
    transmission = Transmission(
        tree, tuple(held), output.link, output.relative_to, output.pointing
    )
    vectors = space.at.vectors
    two = transmission.at(vectors, transmission.pointed(space.at.placed))
    determinant = np.linalg.det(inputs)
    if not space.oriented:
        determinant = np.abs(determinant)
    alone = adjugate(inputs)
    size = np.linalg.norm(alone, axis=1)
    unique = size > SINGULAR * np.max(size, axis=1, keepdims=True)
    turning = output.angular_velocity(space, space.basis @ alone)
    speed = np.linalg.norm(turning, axis=2, keepdims=True)
    turns = speed > SINGULAR * size[..., None]
    size = np.where(unique, size, np.nan)
    rates = determinant[:, None] / size, np.linalg.norm(moving @ alone, axis=1) / size
    one, beside = _type_one(inputs, moving)
    condition = np.where(motion.failed, np.nan, space.reciprocal_condition)
    crossed = condition < SINGULAR
    kind = ((one < SINGULAR) & ~crossed) + 2 * (two < SINGULAR)
    kind[(kind == RowType.REGULAR) & (crossed | beside)] = RowType.SELF_MOTION
    kind[~np.isfinite(two)] = RowType.UNKNOWN
    alone_singular = np.any(~(np.abs(rates) > ALONE * SINGULAR), axis=(0, 2))
    group = np.isin(kind, np.arange(1, 4)) * (2 - alone_singular)
    return {
        "input_rate": rates[0],
        "output_rate": rates[1],
        "alone": turning / np.where(turns, speed, np.nan),
        "type_two": two,
        "hold": hold_of(tree, held, vectors)[0],
        "type_one": np.where(np.isfinite(two), one, np.nan),
        "reciprocal_condition": condition,
        "type": kind.astype(np.int8),
        "group": group.astype(np.int8),
    }


def _type_one(inputs: Floats, output: Floats) -> tuple[Floats, Bools]:
    """Return `OutputCoefficients.type_one` (n,), and where there are self-motions (n,).

    From rates of g inputs (n, g, g) and of the output (n, m, g) in g motions. Of these an
    orthonormal basis is made, in which motions that move neither are lost.
    """
    both = np.concatenate([inputs, output], axis=1)
    left, sizes, _, _ = decomposed(both)
    moves = sizes > SINGULAR
    basis = left[:, inputs.shape[1] :, : both.shape[2]] * moves[:, None]
    turns = np.linalg.svd(basis, compute_uv=False)
    turns = np.pad(turns, ((0, 0), (1, 0)), constant_values=1.0)
    rank = np.sum(moves, axis=1)
    which = np.minimum(rank, output.shape[1])
    return turns[np.arange(len(turns)), which], rank < both.shape[2]


@np.errstate(invalid="ignore", divide="ignore", over="ignore")
def what_vanishes(
    motion: Motion,
    output: OutputStationary,
    pointing: Floats | None = None,
    by_rank: bool = False,
) -> list[str]:
    """Return which c_i and d_i vanish at each row (n), and whether the u_i coincide.

    Or which three of them are coplanar, or which u_i is the direction `pointing` (n, 3)
    that counts, in axes of the link that the output is relative to: it then rests though
    its link turns. Where none of these says it, what else does; and which links take part
    in a self-motion. For the symbols see `OutputCoefficients`.
    """
    at = coefficients(motion, output, by_rank)
    c, d, u = (  # some axes may be unknown there; the rates vanish with c and d
        np.where(np.isfinite(one), one, other)
        for one, other in ((at.c, at.input_rate), (at.d, at.output_rate), (at.u, at.alone))
    )
    pairs = motion.mechanism.names_of(motion.assembly.inputs)
    one, other = np.triu_indices(len(pairs), 1)
    crossed = cross(u[:, one], u[:, other])
    parallel = np.linalg.norm(crossed, axis=2)
    widest = np.max(parallel, axis=1, keepdims=True)
    volumes = np.where(widest < VANISHES, np.nan, replace(at, u=u).triples)
    both = [f"u_{a} and u_{b}" for a, b in combinations(pairs, 2)]
    first = [
        ("c_{}=0", pairs, c),
        ("d_{}=0", pairs, d),
        ("u of {} coincide", [", ".join(pairs)], widest),
        ("u of {} coplanar", [*map(", ".join, combinations(pairs, 3))], volumes),
    ]
    tiers = [first, [("{} along one line", both, parallel)]]
    if pointing is not None:
        direction = np.matvec(motion.rotations[:, output.relative_to], pointing)
        off = np.linalg.norm(cross(u, direction[:, None]), axis=2)
        first.insert(2, ("u_{} along the direction", pairs, off))
        flat = np.matvec(crossed, direction)
        tiers.append([("{} coplanar with the direction", both, flat)])
    words: list[list[str]] = [[] for _ in c]
    for tier in tiers:
        said = [text.format(name) for text, names, _ in tier for name in names]
        small = np.abs(np.hstack([sizes for _, _, sizes in tier])) < VANISHES
        for row, phrases in enumerate(words):
            words[row] = phrases or [said[k] for k in np.flatnonzero(small[row])]
    for row in np.flatnonzero(at.type == RowType.SELF_MOTION).tolist():
        words[row] = [_what_moves(motion.rows(slice(row, row + 1)), output)]
    for row, phrases in enumerate(words):
        if not phrases:
            least = np.min(np.abs([c[row], d[row]]))
            why = f"motions alone: no c, d below {least:.1e}"
            if at.reciprocal_condition[row] < VANISHES:
                why = "the loops lose rank"
            elif not all_finite(u[row]):
                why = "pole axes not known"
            phrases.append(why)
    return [" ".join(listed) for listed in words]


def _what_moves(motion: Motion, output: OutputStationary) -> str:
    """Return in words which links move while the inputs and the output of one row rest."""
    at = motion.linearisation
    held = np.eye(motion.values.shape[1])[_held(motion)]
    equations = np.concatenate([at.jacobian[0], held, output.equations(at)[0]])
    _, _, right = np.linalg.svd(equations)
    speeds = np.linalg.norm(at.body_rates(right[-1:])[0], axis=1)
    return f"{' '.join(np.array(motion.mechanism.links)[speeds > VANISHES])} alone move"


LocusName = Literal["I", "II", "self-motion"]
OWN: Mapping[LocusName, tuple[RowType, ...]] = {
    "I": (RowType.I, RowType.III),
    "II": (RowType.II, RowType.III),
    "self-motion": (RowType.SELF_MOTION,),
}
"""Types of the configurations on each locus."""


@dataclass(frozen=True)
class SingularPoints(ArrayRows):
    """n singular configurations, as what stands still and what moves sees them.

    Attributes
    ----------
    kind
        The locus that they are on. II: the inputs stand still in the singular motion; I:
        the output does; self-motion: both.
    type
        (n,) what each is for the output, a
        `spherekit.singularities.several_inputs.RowType`.
    values, motion
        The variables and the unit rates of the singular motion, (n, V), of the pairs that
        move the output.
    inputs
        (n, g) values of the inputs (rad), less whole turns in their declared ranges or as
        near to these as can be.
    inside
        (n,) whether all are within those ranges.
    orientation, pointing
        (n, 3, 3) from the output link's axes to those of its reference link, and the
        output direction (n, 3) there, or None.
    input_rate, output_rate
        (n,) norms of the rates of the inputs and of the output in the singular motion.
    residual
        (n,) the larger of the loops' residual (rad) and that of the singularity.
    """

    kind: LocusName
    type: SmallIntegers
    values: Floats
    motion: Floats
    inputs: Floats
    inside: Bools
    orientation: Floats
    pointing: Floats | None
    input_rate: Floats
    output_rate: Floats
    residual: Floats


@dataclass(frozen=True)
class SingularityReport:
    """The singular configurations of a type, and what of them is reported."""

    solver: PositionSolver
    output: OutputStationary
    kind: LocusName
    part: OutputPart | None = None

    @staticmethod
    def of(
        solver: PositionSolver, output: OutputStationary, kind: LocusName
    ) -> "SingularityReport":
        """Return what is singular of an output: of the part alone that moves it.

        Self-motions are those of the whole mechanism.
        """
        part = None
        if kind != "self-motion":
            part = OutputPart.of(
                solver.mechanism, solver.assembly, output.link, output.relative_to
            )
        way = output.way if part is None else part.way
        return SingularityReport(solver, replace(output, way=way), kind, part)

    @cached_property
    def locus(self) -> SingularityLocus:
        """The configurations of the type."""
        return self._locus(self.kind)

    @cached_property
    def other(self) -> SingularityLocus:
        """Those of the other type."""
        return self._locus("II" if self.kind == "I" else "I")

    def _locus(self, kind: LocusName) -> SingularityLocus:
        driven = self.solver.driven if self.part is None else self.part.driven
        return SingularityLocus(
            self.solver.closure,
            len(self.solver.driven),
            self.output if kind == "I" else InputsLocked(driven),
            self.part,
        )

    def types(self, values: Floats) -> SmallIntegers:
        """Return the types (n,) of configurations for the output."""
        motion = make_motion(self.solver, values)
        space = tangent_space(motion.linearisation, len(self.solver.driven))
        return by_motions(motion, space, self.output)["type"]

    def is_own(self, types: SmallIntegers) -> Bools:
        """Return which types (n,) are those of the locus."""
        return np.isin(types, OWN[self.kind])

    @cached_property
    def ranges(self) -> Floats:
        """(2, g) the lowest and the highest declared values of the inputs (rad)."""
        return np.transpose([item.range for item in self.solver.mechanism.inputs])

    def inputs_of(self, values: Floats) -> Floats:
        """Return the inputs (n, g) of configurations (n, V), as in `SingularPoints`."""
        q = values[:, list(self.solver.driven)]
        low, high = self.ranges
        return into_range(q, low, high, self.solver.periods)

    def points(self, nodes: LocusPoints) -> SingularPoints:
        """Return what points of the locus look like."""
        return self.seen(nodes.values, nodes.motions, nodes.residual)

    def seen(self, values: Floats, motions: Floats, residual: Floats) -> SingularPoints:
        """Return what configurations and singular motions (n, V) look like."""
        at = self.solver.closure.at(values)
        inputs = self.inputs_of(values)
        orientation = self.output.orientation(at)
        pointing = None
        if self.output.pointing is not None:
            pointing = orientation @ np.array(self.output.pointing)
        moving = np.matvec(self.output.equations(at), motions)
        return SingularPoints(
            self.kind,
            self.types(values),
            values,
            motions,
            inputs,
            np.all(in_range(inputs, *self.ranges), axis=1),
            orientation,
            pointing,
            np.linalg.norm(motions[:, list(self.solver.driven)], axis=1),
            np.linalg.norm(moving, axis=1),
            residual,
        )
