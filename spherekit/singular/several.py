"""Singularity of mechanisms with several inputs at given configurations.

Each input i, moved alone with the others locked, makes a mechanism with one freedom, in
which the output link turns about u_i with rate w_i, and c_i w_i = d_i q_i' (Di Gregorio
2015). The same is said without poles by the motions that close the loops: with N a basis
of them, N_a its rows of the inputs and E N the output's rates, type II is det N_a = 0 and
type I a loss of rank of E N. All of these stay finite on singularities.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import IntEnum
from itertools import combinations
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.motion.closure import Closure
from spherekit.motion.motion import Motion
from spherekit.planning.poles import Pole, pole_of
from spherekit.rates.field import TRUSTED_ERROR, evaluate
from spherekit.rates.pole_field import PoleField
from spherekit.rates.request import Request, request
from spherekit.rates.sequence import PlannedPoles
from spherekit.rates.transmission import SINGULAR, Transmission
from spherekit.rates.transmission import hold as hold_of
from spherekit.singular.locus import Locus, adjugate
from spherekit.singular.relation import FourLinks, SixPoles, form_i
from spherekit.singular.stationarity import OutputStationary
from spherekit.sphere.rotation import Floats

ALONE = 10.0
"""A single-freedom mechanism is singular below this multiple of the tolerance."""


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


@final
@dataclass(frozen=True)
class OutputCoefficients:
    """n rows of a motion with g inputs, each input moved alone, and all together.

    NaN where the motion failed.

    Attributes
    ----------
    w
        (n, g, 3) angular velocity of the output per unit rate of each input, in ground
        axes; NaN where that is infinite or undetermined.
    u
        (n, g, 3) unit vectors along the pole axes of the output, with the signs that
        `spherekit.rates.field` gives them; finite on singularities too.
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
        (n,) how surely the inputs hold the output, see `spherekit.rates.transmission`: 0
        where it can move with the inputs at rest, also where the loops lose their rank.
    hold
        (n,) how surely they hold all links, see `hold` there.
    type_one
        (n,) how surely the inputs rest where the output does: of all motions, seen as rates
        of the inputs and of the output, the sine of the angle to those in which the output
        rests; 0 where inputs can move though it does. Self-motions do not count.
    determinant
        (n,) det N_a. Where the loops are independent equations its sign is that of one
        smooth function, and changes only through type II; where not, it has none.
    triples, triplets
        (n, k) triple products of the u of three inputs, and which inputs those are.
    flatness
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
    determinant: Floats
    triples: Floats
    triplets: tuple[tuple[int, int, int], ...]
    reciprocal_condition: Floats
    type: NDArray[np.int8]
    group: NDArray[np.int8]


def needed_poles(motion: Motion, output: OutputStationary) -> dict[str, tuple[Pole, ...]]:
    """Return the poles of links that `coefficients` reads, by the name of the input."""
    poles = {}
    for driven in motion.assembly.inputs:
        links = sorted({*motion.mechanism.ends[driven], output.link, output.relative_to})
        poles[motion.mechanism.pairs[driven].name] = tuple(combinations(links, 2))
    return poles


def coefficients(
    motion: Motion,
    output: OutputStationary,
    fields: Mapping[str, PoleField] | None = None,
    by_rank: bool = False,
    tolerance: float = SINGULAR,
) -> OutputCoefficients:
    """Return the coefficients of an output, and the type of every row of a motion.

    Parameters
    ----------
    motion
        Any motion of a mechanism with at least one input.
    output
        Which link's rates count, from `spherekit.singular.stationarity.output_of`.
    fields
        Poles and rates with one input moving, by its name, that hold `needed_poles`; they
        are evaluated if not given.
    by_rank
        That of `spherekit.planning.poles.plan`.
    tolerance
        Singular values below this count as zero.
    """
    with np.errstate(invalid="ignore"):
        return _coefficients(motion, output, fields, by_rank, tolerance)


def _coefficients(
    motion: Motion,
    output: OutputStationary,
    fields: Mapping[str, PoleField] | None,
    by_rank: bool,
    tolerance: float,
) -> OutputCoefficients:
    mechanism = motion.mechanism
    poles = needed_poles(motion, output)
    requests = {
        name: request(mechanism, name, needed, [output.pole], by_rank=by_rank)
        for name, needed in poles.items()
    }
    if fields is None:
        fields = {name: evaluate(motion, wanted) for name, wanted in requests.items()}
    n, g = len(motion), len(poles)
    w, u = np.full((n, g, 3), np.nan), np.full((n, g, 3), np.nan)
    c, d = np.full((n, g), np.nan), np.full((n, g), np.nan)
    for k, (name, field) in enumerate((name, fields[name]) for name in poles):
        w[:, k] = field.w[output.link] - field.w[output.relative_to]
        c[:, k], d[:, k], u[:, k] = _relation(requests[name], field.direction, output)
    _without_plan(motion, output, c, d, u)
    c[motion.failed] = d[motion.failed] = u[motion.failed] = np.nan
    triplets = tuple(combinations(range(g), 3))
    triples = [np.linalg.det(u[:, list(three)]) for three in triplets]
    measured = by_motions(motion, output, tolerance)
    return replace(
        measured,
        w=w,
        u=u,
        c=c,
        d=d,
        triples=np.stack(triples, axis=1) if triples else np.zeros((n, 0)),
        triplets=triplets,
    )


def _relation(
    wanted: Request, directions: Mapping[Pole, Floats], output: OutputStationary
) -> tuple[Floats, Floats, Floats]:
    """Return c, d (n,) and the output's pole (n, 3) with one input moving.

    `directions` (n, 3) are those of the poles of links.
    """
    mechanism = wanted.plan.mechanism
    r, i = mechanism.ends[wanted.plan.input]
    links = (i, r, output.link, output.relative_to)
    body = wanted.plan.body
    named = {body[link]: link for link in reversed(links)}
    i, r, o, s = (named[body[link]] for link in links)
    if o == s:
        n = len(directions[output.pole])
        return np.ones(n), np.zeros(n), np.full((n, 3), np.nan)

    def direction(a: int, b: int) -> Floats:
        return directions[pole_of(a, b)]

    four = FourLinks(i, r, o, s)
    made = form_i(four, SixPoles.of(four, direction))
    return made.c, made.d, direction(o, s)


def relations(
    motion: Motion, output: OutputStationary, by_rank: bool = False
) -> tuple[Floats, Floats, Floats]:
    """Return c, d (n, g) and u (n, g, 3) of `OutputCoefficients`, u with any signs.

    By the plan's great circles where these are surely good, else by motions. No rate is
    asked for, nor its error, which takes longer than all poles.
    """
    n, g = len(motion), len(motion.assembly.inputs)
    c, d = np.full((n, g), np.nan), np.full((n, g), np.nan)
    u = np.full((n, g, 3), np.nan)
    for k, (name, needed) in enumerate(needed_poles(motion, output).items()):
        wanted = request(motion.mechanism, name, needed, derivatives=False, by_rank=by_rank)
        planned = PlannedPoles(wanted.plan, motion)
        directions = {}
        for pole in wanted.poles:
            body_pole = wanted.plan.pole(*pole)
            directions[pole] = np.full((n, 3), np.nan)
            if body_pole is not None:
                sure = planned.error[body_pole] < TRUSTED_ERROR
                directions[pole][sure] = planned.unit[body_pole][0][:, sure].T
        c[:, k], d[:, k], u[:, k] = _relation(wanted, directions, output)
    _without_plan(motion, output, c, d, u)
    return c, d, u


def _without_plan(
    motion: Motion, output: OutputStationary, c: Floats, d: Floats, u: Floats
) -> None:
    """Fill in c, d (n, g) and u (n, g, 3) of rows whose pole axes no plan gives usably."""
    rows = np.flatnonzero(~motion.failed & np.any(~np.isfinite(c), axis=1))
    if not len(rows):
        return
    made = relations_by_motions(motion.rows(rows), output)
    for whole, filling in zip((c, d, u), made, strict=True):
        whole[rows] = np.where(np.isfinite(whole[rows]), whole[rows], filling)


def relations_by_motions(
    motion: Motion, output: OutputStationary
) -> tuple[Floats, Floats, Floats]:
    """Return c, d (n, g) and u (n, g, 3) of `OutputCoefficients` without a plan.

    The axes are those of the motion in which one input moves alone. That is finite at
    singularities; an axis of links that rest in it is not known, but for the input's own,
    and what needs it is NaN. The signs of u are any.
    """
    closure = Closure.of(motion.mechanism, motion.joints)
    held = [motion.mechanism.variables_of(pair)[0] for pair in motion.assembly.inputs]
    n, g = len(motion), len(held)
    c, d = np.full((n, g), np.nan), np.full((n, g), np.nan)
    u = np.full((n, g, 3), np.nan)
    space = Locus(closure, g, output).space(motion.values)
    alone = space.basis @ adjugate(space.basis[:, held])
    o, s = output.link, output.relative_to
    for k, pair in enumerate(motion.assembly.inputs):
        ways = alone[:, :, k] / np.linalg.norm(alone[:, :, k], axis=1, keepdims=True)
        rates = space.at.body_rates(ways)
        r, i = motion.mechanism.ends[pair]
        given_axes = {pole_of(i, r): space.at.vectors[:, held[k]]}

        def direction(
            a: int,
            b: int,
            given_axes: dict[Pole, Floats] = given_axes,
            rates: Floats = rates,
        ) -> Floats:
            between = given_axes.get(pole_of(a, b), rates[:, a] - rates[:, b])
            size = np.linalg.norm(between, axis=1, keepdims=True)
            return np.asarray(between / np.where(size > SINGULAR, size, np.nan))

        if o == s:
            continue
        four = FourLinks(i, r, o, s)
        made = form_i(four, SixPoles.of(four, direction))
        c[:, k], d[:, k], u[:, k] = made.c, made.d, direction(o, s)
    return c, d, u


def by_motions(
    motion: Motion, output: OutputStationary, tolerance: float = SINGULAR
) -> OutputCoefficients:
    """Return what the motions that close the loops say; poles are left empty."""
    held = [motion.mechanism.variables_of(pair)[0] for pair in motion.assembly.inputs]
    n, g = len(motion), len(held)
    closure = Closure.of(motion.mechanism, motion.joints)
    space = Locus(closure, g, output).space(motion.values)
    inputs, moving = space.basis[:, held], output.equations(space.at) @ space.basis
    transmission = Transmission(
        closure.tree, tuple(held), output.link, output.relative_to, output.pointing
    )
    directions = transmission.pointed(space.at.placed)
    two = transmission.at(space.at.vectors, directions)
    determinant = np.linalg.det(inputs)
    if not space.oriented:
        determinant = np.abs(determinant)
    alone = adjugate(inputs)
    size = np.linalg.norm(alone, axis=1)
    scale = np.max(size, axis=1, keepdims=True)
    unique = size > tolerance * scale
    size = np.where(unique, size, np.nan)
    input_rate = determinant[:, None] / size
    output_rate = np.linalg.norm(moving @ alone, axis=1) / size
    turning = output.angular_velocity(space, space.basis @ alone)
    speed = np.linalg.norm(turning, axis=2, keepdims=True)
    turns = speed > tolerance * np.linalg.norm(alone, axis=1)[..., None]
    nothing = np.zeros((n, g))
    measured = OutputCoefficients(
        w=np.zeros((n, g, 3)),
        u=np.zeros((n, g, 3)),
        c=nothing,
        d=nothing,
        input_rate=input_rate,
        output_rate=output_rate,
        alone=turning / np.where(turns, speed, np.nan),
        type_two=two,
        hold=hold_of(closure.tree, held, space.at.vectors)[0],
        type_one=two,
        determinant=determinant,
        triples=nothing,
        triplets=(),
        reciprocal_condition=np.where(motion.failed, np.nan, space.reciprocal_condition),
        type=np.zeros(n, dtype=np.int8),
        group=np.zeros(n, dtype=np.int8),
    )
    one, beside = _type_one(inputs, moving, tolerance)
    one = np.where(np.isfinite(two), one, np.nan)
    measured = replace(measured, type_one=one)
    kind, group = _types(measured, beside, tolerance)
    return replace(measured, type=kind, group=group)


def _type_one(
    inputs: Floats, output: Floats, tolerance: float
) -> tuple[Floats, NDArray[np.bool_]]:
    """Return `OutputCoefficients.type_one` (n,), and where there are self-motions (n,).

    From rates of g inputs (n, g, g) and of the output (n, m, g) in g motions. Of these an
    orthonormal basis is made, in which motions that move neither are lost.
    """
    both = np.concatenate([inputs, output], axis=1)
    finite = np.all(np.isfinite(both), axis=(1, 2))
    clean = np.where(finite[:, None, None], both, 0.0)
    left, sizes, _ = np.linalg.svd(clean, full_matrices=False)
    moves = sizes > tolerance
    turns = np.linalg.svd(left[:, inputs.shape[1] :] * moves[:, None], compute_uv=False)
    turns = np.concatenate([np.ones((len(turns), 1)), turns], axis=1)
    rank = np.sum(moves, axis=1)
    which = np.minimum(rank, output.shape[1])
    return turns[np.arange(len(turns)), which], rank < both.shape[2]


def _types(
    measured: OutputCoefficients, beside: NDArray[np.bool_], tolerance: float
) -> tuple[NDArray[np.int8], NDArray[np.int8]]:
    finite = np.isfinite(measured.type_two)
    second = measured.type_two < tolerance
    first = measured.type_one < tolerance
    crossed = measured.reciprocal_condition < tolerance
    kind = np.select(
        [~finite, second & first & ~crossed, second, crossed, first, beside],
        [
            RowType.UNKNOWN,
            RowType.III,
            RowType.II,
            RowType.SELF_MOTION,
            RowType.I,
            RowType.SELF_MOTION,
        ],
        RowType.REGULAR,
    )
    rates = np.stack([np.abs(measured.input_rate), measured.output_rate])
    alone = np.any(~(rates > ALONE * tolerance), axis=(0, 2))
    group = np.select([(kind <= 0) | (kind > RowType.III), alone], [0, 1], 2)
    return kind.astype(np.int8), group.astype(np.int8)
