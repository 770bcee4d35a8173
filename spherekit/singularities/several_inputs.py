"""Types of singularity of mechanisms with several inputs, at the rows of a motion.

If input i moves alone and the others are locked, the mechanism has one degree of freedom.
The output link then turns about the pole axis u_i with the angular velocity w_i, and
c_i w_i = d_i q_i' (Di Gregorio 2015). The types also follow without poles from the rates
that close the loops: let N be a basis of these rates, N_a the rows of the inputs in N,
and E N the rates of the output. Apart from self-motions, type II is det N_a = 0, and type
I is a loss of rank of E N. N, N_a and E N are finite at singularities.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import partial
from itertools import combinations

import numpy as np

from spherekit.arrays import Bools, Floats, Integers, SmallIntegers
from spherekit.geometry.vectors import all_finite, cross, dot, nans
from spherekit.planning.pole_plan import Pole, pole_of
from spherekit.positions.motion import Motion
from spherekit.singularities.input_output_relation import FourLinks, make_relation
from spherekit.singularities.locus import adjugate
from spherekit.singularities.stationarity import OutputStationary
from spherekit.singularities.tangent_space import TangentSpace, decompose, tangent_space
from spherekit.tolerances import SINGULAR_TRANSMISSION
from spherekit.velocities.pole_evaluation import evaluate
from spherekit.velocities.pole_request import request
from spherekit.velocities.transmission_measure import Transmission, input_authority

ALONE_SINGULAR_FACTOR = 10.0
"""The mechanism in which one input moves alone counts as singular if one of its unit rates
is below this factor times `SINGULAR_TRANSMISSION`.

Larger: more singularities are in group 1.
"""
VANISHING_SIZE = 1e-8
"""Coefficients, sines and triple products below this are reported as zero. Larger: more
conditions are reported as fulfilled; smaller: rounding hides fulfilled conditions."""


class RowType(IntEnum):
    """Type of singularity of one configuration, by Gosselin and Angeles.

    At type I inputs can move while the output rests. At type II the output can move while
    the inputs rest. Type III is both at once. At a SELF_MOTION other links can move while
    inputs and output rest, and the configuration is of no other type. UNKNOWN means that
    there is no configuration.

    The rates of all variables satisfy linear equations, which keep the loops closed. These
    equations lose rank, for example, where surfaces of configurations cross. Some solutions
    are then rates at which the mechanism cannot really move. So other rules apply to a
    configuration at which the equations lose rank:

    - It never counts as type I or III.
    - It counts as type II if a solution moves the output while the inputs rest.
    - Otherwise it counts as SELF_MOTION.
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
        return ROW_TYPE_LABELS.get(self, self.name)


ROW_TYPE_LABELS = {
    RowType.REGULAR: "regular",
    RowType.SELF_MOTION: "self-motion",
    RowType.UNKNOWN: "",
}
"""Labels in tables of the types whose label differs from the name."""


@dataclass(frozen=True)
class SingleInputMotions:
    """The motions of n configurations in which one input moves and the others are locked.

    There are g inputs, and one such motion for each input. The rates of all pair variables
    in a motion are scaled to a vector of length 1. A rate near 0 then shows that the
    mechanism with this single input is singular. A motion is not unique if the links can
    move in several ways while the other inputs are locked.

    Attributes
    ----------
    input_rate
        (n, g) rate of the input that moves; NaN if the motion is not unique.
    output_rate
        (n, g) size of the output's angular velocity; NaN if the motion is not unique. If
        the output is only a direction of the link, the component of the angular velocity
        along this direction is left out.
    output_direction
        (n, g, 3) unit vectors along the angular velocity of the output link, in ground
        axes; NaN if the link rests, or if the motion is not unique.
    """

    input_rate: Floats
    output_rate: Floats
    output_direction: Floats


@dataclass(frozen=True)
class SingularityMeasures:
    """How near n configurations are to singularities of each type.

    At type I inputs can move while the output rests. At type II the output can move while
    the inputs rest.

    Attributes
    ----------
    type_one_sine
        (n,) measure from 0 to 1, zero at type I. The rates of inputs and output in a motion
        are scaled to a vector of length 1. The measure is the smallest size that the rates
        of the output can have in this vector. The output has 3 rates if it is an
        orientation, and 2 if it is a direction. If the mechanism has more independent
        motions than this, the output can rest in some motions at every configuration. These
        motions are not counted.
    type_two_transmission
        (n,) measure from 0 to 1 of how firmly locked inputs fix the output, zero at type
        II. `Transmission` defines this measure.
    locked_singular_value
        (n,) smallest singular value of the closure equations with locked inputs, zero if
        any link can move.
    locked_reciprocal_condition
        (n,) that value divided by the largest singular value of the same equations.
    reciprocal_condition
        (n,) smallest singular value of the closure Jacobian divided by the largest one.
    has_self_motion
        (n,) whether links can move while inputs and output rest; True without a
        configuration.
    """

    type_one_sine: Floats
    type_two_transmission: Floats
    locked_singular_value: Floats
    locked_reciprocal_condition: Floats
    reciprocal_condition: Floats
    has_self_motion: Bools


@dataclass(frozen=True)
class RowClassification:
    """Types of singularity of n configurations, and the numbers from which they follow.

    Attributes
    ----------
    single_input_motions
        Rates in the motions in which one input moves and the others are locked.
    measures
        How near the configurations are to singularities of each type.
    type
        (n,) `RowType` of each configuration: for example I if inputs can move while the
        output rests, and II if the output can move while the inputs rest.
    group
        (n,) group of Di Gregorio's discussion. With all inputs but one locked, there is one
        mechanism for each input. 1: at least one of these mechanisms is singular, too. 2:
        none of these mechanisms is singular. 0: the configuration is not of type I, II or
        III.
    """

    single_input_motions: SingleInputMotions
    measures: SingularityMeasures
    type: SmallIntegers
    group: SmallIntegers


@dataclass(frozen=True)
class OutputCoefficients:
    """n rows of a motion with g inputs: coefficients of each input, and singularity types.

    Input i "moves alone" in the motion in which all other inputs are locked. The output
    link then turns with the angular velocity w_i about the pole axis u_i. This axis is
    the axis of rotation of the output link relative to its reference link. The relation
    c_i w_i = d_i q_i' holds with the rate q_i' of the input. N are the independent
    motions that close the loops, N_a their input rates. Rows in which the motion failed
    are NaN.

    Attributes
    ----------
    w
        (n, g, 3) angular velocity of the output per unit rate of each input, in ground
        axes; NaN where that is infinite or not known.
    u
        (n, g, 3) unit vectors along the pole axes of the output, with the signs that
        `spherekit.velocities.pole_evaluation` gives them; at most singularities finite,
        too. Where the plan of poles gives no axis, the sign is arbitrary.
    c, d
        (n, g) coefficients of c w_i = d q_i', from the pole axes, at most 1 in size. The
        relation holds with the sign of u_i in the same row.
    input_rate, output_rate
        (n, g) rates in the unit motion in which input i moves alone. The rate of the
        input vanishes with c_i and has the sign of det N_a, if that is fixed. The size of
        the output's angular velocity vanishes with d_i. If the output is only a direction
        of the link, the component along this direction is left out. NaN if that motion is
        not unique.
    alone
        (n, g, 3) unit vectors along the angular velocity of the output link in that
        motion, NaN where it is at rest or the motion is not unique. They are the pole
        axes, up to their signs, also where the plan of poles gives none.
    type_two
        (n,) transmission measure, see `spherekit.velocities.transmission_measure`: 0 if the
        output can move with the inputs at rest, also where the loops lose rank.
    hold
        (n,) smallest singular value of the closure with locked inputs, see
        `spherekit.velocities.transmission_measure.input_authority`.
    type_one
        (n,) measure from 0 to 1: 0 if inputs can move while the output rests. It is the
        sine of the smallest angle between two linear spaces of rates of inputs and output:
        the possible rates, and all rates with the output at rest. Self-motions do not
        count.
    reciprocal_condition
        (n,) `hold` divided by the largest singular value of the closure with locked inputs.
    type
        (n,) `RowType`.
    group
        (n,) group of Di Gregorio's discussion: 1 if at least one of the mechanisms in
        which one input moves alone is singular, 2 if none of these is singular, 0 if the
        configuration is not of type I, II or III.
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
        return _triple_products(self.u)


@dataclass(frozen=True)
class _InputCoefficients:
    """Coefficients of the motion in which one input moves and the others are locked.

    The rate y' of the output and the rate q' of the input satisfy c y' = d q'. Values
    belong to n configurations. `coefficients` collects the values of all inputs in
    `OutputCoefficients`.

    Attributes
    ----------
    w
        (n, 3) angular velocity vector of the output per unit rate of the input. It is (d /
        c) u, or NaN where it is infinite or could not be computed.
    c, d
        (n,) coefficients of the relation. Unlike w, they are finite at singularities.
        `make_relation` states their formulas.
    u
        (n, 3) unit vector along the axis about which the output turns.
    """

    w: Floats
    c: Floats
    d: Floats
    u: Floats


def coefficients(
    motion: Motion, output: OutputStationary, by_rank: bool = False
) -> OutputCoefficients:
    """Return the coefficients c_i, d_i of an output, and the singularity type of each row.

    Let input i move at the rate q_i' while all other inputs are locked. The output link
    then turns about a pole axis at the rate w_i, and the numbers c_i and d_i satisfy
    c_i w_i = d_i q_i'; see `OutputCoefficients`.

    Parameters
    ----------
    motion
        Any motion of a mechanism with at least one input.
    output
        The output link and its reference link, as
        `spherekit.singularities.stationarity.output_of` returns them.
    by_rank
        Whether degrees of freedom are determined from the rank of the closure equations,
        instead of by counting links and pairs.
    """
    input_variables = _input_variables(motion)
    # N = space.basis (n, V, g) are g independent rates that close the loops, N_a are their
    # rows of the inputs.
    space = tangent_space(motion.linearisation, len(input_variables))
    # Column i of the adjugate of N_a gives a motion in which input i moves alone. Unlike
    # the inverse, the adjugate is finite where det N_a = 0.
    input_rates = space.basis[:, input_variables]
    rates_alone = space.basis @ adjugate(input_rates)
    with np.errstate(invalid="ignore", divide="ignore"):
        sizes = np.linalg.norm(rates_alone, axis=1)
        rates_alone /= _discard_ambiguous_motions(sizes, input_rates)[:, None]
        by_input = [
            _input_coefficients(
                motion,
                output,
                space=space,
                rates_alone=rates_alone,
                position=position,
                by_rank=by_rank,
            )
            for position in range(len(input_variables))
        ]
        w = np.stack([item.w for item in by_input], axis=1)
        c = np.stack([item.c for item in by_input], axis=1)
        d = np.stack([item.d for item in by_input], axis=1)
        u = np.stack([item.u for item in by_input], axis=1)
        c[motion.failed] = np.nan
        d[motion.failed] = np.nan
        u[motion.failed] = np.nan
        classification = classify_rows(motion, space, output)
    single_input_motions = classification.single_input_motions
    measures = classification.measures
    return OutputCoefficients(
        w=w,
        u=u,
        c=c,
        d=d,
        input_rate=single_input_motions.input_rate,
        output_rate=single_input_motions.output_rate,
        alone=single_input_motions.output_direction,
        type_two=measures.type_two_transmission,
        hold=measures.locked_singular_value,
        type_one=measures.type_one_sine,
        reciprocal_condition=measures.locked_reciprocal_condition,
        type=classification.type,
        group=classification.group,
    )


def _input_coefficients(
    motion: Motion,
    output: OutputStationary,
    space: TangentSpace,
    rates_alone: Floats,
    position: int,
    by_rank: bool,
) -> _InputCoefficients:
    """Return the input-output relation of one input that moves while the others are locked.

    The relation c w = d q' follows from the pole axes of four links: the input link i, its
    reference link r, the output link o and its reference link s. The pole axis of two links
    is the axis about which one turns relative to the other at the moment.

    Parameters
    ----------
    motion, output
        n configurations, and the output whose rates count.
    by_rank
        Whether degrees of freedom are determined from the rank of the closure equations,
        instead of by counting links and pairs.
    space
        Rates that close the loops at these configurations.
    rates_alone
        (n, V, g) unit rates of the motions in which one input moves alone, NaN if such a
        motion is not unique.
    position
        Index of the input among the inputs of the mechanism.
    """
    mechanism = motion.mechanism
    pair = motion.assembly.inputs[position]
    reference_link, input_link = mechanism.ends[pair]
    output_links = (output.link, output.relative_to)
    # Request the poles of any two of the four links.
    pole_request = request(
        mechanism,
        mechanism.pairs[pair].name,
        tuple(combinations(sorted({input_link, reference_link, *output_links}), 2)),
        [output.pole],
        by_rank=by_rank,
    )
    # Links that are joined by locked inputs are one body. `body` has the index of the body
    # of each link. The relation names each body by one of its links, preferably a link of
    # the input, which replaces others in the loop.
    body = pole_request.plan.body
    representative: dict[int, int] = {}
    for link in (output.relative_to, output.link, reference_link, input_link):
        representative[body[link]] = link
    four_links = FourLinks(
        i=representative[body[input_link]],
        r=representative[body[reference_link]],
        o=representative[body[output.link]],
        s=representative[body[output.relative_to]],
    )
    field = evaluate(motion, pole_request)
    variable = _input_variables(motion)[position]
    pole_axis = partial(
        _pole_axis,
        planned_axes=field.direction,
        input_pole=pole_of(four_links.i, four_links.r),
        input_axis=space.linearisation.vectors[:, variable],
        angular_velocities=space.linearisation.body_rates(rates_alone[:, :, position]),
    )
    w = field.w[output.link] - field.w[output.relative_to]
    if four_links.o == four_links.s:
        # The locked inputs join the output to its reference link: it cannot move, so that
        # the relation is w = 0, with no pole axis.
        n = len(pole_axis(pole_of(four_links.i, four_links.r)))
        return _InputCoefficients(w, c=np.ones(n), d=np.zeros(n), u=nans((n, 3)))
    relation = make_relation("i", four_links, pole_axis)
    return _InputCoefficients(w, c=relation.c, d=relation.d, u=relation.poles.os)


def _pole_axis(
    pole: Pole,
    planned_axes: Mapping[Pole, Floats],
    input_pole: Pole,
    input_axis: Floats,
    angular_velocities: Floats,
) -> Floats:
    """Return the axis about which two links turn relative to each other (their pole axis).

    Pole axes are constructed from each other by great circles, in the order of a plan. At
    singularities the plan may yield no axis. The axis is then found from a motion in which
    one input moves and the others are locked: it is along the relative angular velocity.

    Parameters
    ----------
    pole
        Indices of the two links.
    planned_axes
        (n, 3) axis of each pole by the plan, NaN where the plan yields none.
    input_pole, input_axis
        Pole of the two links of the input that moves, and its axis (n, 3).
    angular_velocities
        (n, bodies, 3) angular velocities of all links in the motion, NaN if it is not
        unique.

    Returns
    -------
    (n, 3) unit vectors in ground axes. Their sense is arbitrary, except for the axis of the
    input. NaN where the plan yields no axis, and the links rest or the motion is not
    unique.
    """
    if pole == input_pole:
        # The axis of the input's R pair is known even if the input rests.
        direction = input_axis
    else:
        first, second = pole
        direction = angular_velocities[:, first] - angular_velocities[:, second]
    # The motion is scaled so that the rates of all pair variables form a vector of length
    # 1. A relative angular velocity below the limit counts as zero, and has no direction.
    size = np.linalg.norm(direction, axis=1, keepdims=True)
    axis_by_rates = direction / np.where(size > SINGULAR_TRANSMISSION, size, np.nan)
    planned_axis = planned_axes[pole]
    return np.where(np.isfinite(planned_axis), planned_axis, axis_by_rates)


def _input_variables(motion: Motion) -> list[int]:
    """Return the index of the variable of each input."""
    return [motion.mechanism.variables_of(pair)[0] for pair in motion.assembly.inputs]


def classify_rows(
    motion: Motion, space: TangentSpace, output: OutputStationary
) -> RowClassification:
    """Return the singularity types of configurations, from the rates that close the loops.

    At type I inputs can move while the output rests. At type II the output can move while
    the inputs rest.

    Parameters
    ----------
    motion
        n configurations of a mechanism with g inputs.
    space
        Rates that close the loops at these configurations.
    output
        The condition that the output rests.
    """
    single_input_motions = _find_single_input_motions(motion, space, output)
    measures = _measure_singularities(motion, space, output)
    row_type = _decide_types(measures)
    # A singular configuration is in group 1 if it is also singular with all inputs but one
    # locked, and in group 2 otherwise.
    group = _decide_groups(row_type, single_input_motions)
    return RowClassification(
        single_input_motions=single_input_motions,
        measures=measures,
        type=row_type,
        group=group,
    )


def _find_single_input_motions(
    motion: Motion, space: TangentSpace, output: OutputStationary
) -> SingleInputMotions:
    """Return the rates of inputs and output if one input moves and the others are locked.

    Each of the g columns of a matrix N is a motion: rates of all variables that close the
    loops. N_a are the rows of the g inputs in N. The motion of input i is a combination of
    the columns. The coefficients are column i of the inverse of N_a. In place of the
    inverse, the adjugate (inverse times det N_a) is used, because it is finite at
    singularities. Input i then has the rate det N_a.

    The output can be the orientation of a link, or only a direction of the link. In the
    second case, rotations of the link about this direction do not count as its rate.

    Parameters
    ----------
    motion, space, output
        The n configurations, their rates that close the loops, and the condition that the
        output rests.
    """
    input_rates = space.basis[:, _input_variables(motion)]  # N_a
    # Column i has the coefficients of the motion of input i.
    coefficients_by_input = adjugate(input_rates)
    # The size of a column is the size of all rates in the motion, as N is orthonormal.
    sizes = np.linalg.norm(coefficients_by_input, axis=1)
    # NaN replaces the size if links can move in several ways, so that rates divided by this
    # size are NaN.
    unique_sizes = _discard_ambiguous_motions(sizes, input_rates)

    # The rate of the input in its motion, det N_a. The rate has no sign if the signs of the
    # columns of N are arbitrary.
    input_determinant = _determinant_with_sense(input_rates, space)
    # The components of the angular velocity that are zero if the output rests: two for a
    # direction, three for an orientation. First in the g columns of N, then in the motions.
    rates_in_columns = output.equations(space.linearisation) @ space.basis
    output_rates = rates_in_columns @ coefficients_by_input
    output_sizes = np.linalg.norm(output_rates, axis=1)

    # (n, g, 3) the whole angular velocity of the output link in these motions.
    angular_velocity = output.angular_velocity(space, space.basis @ coefficients_by_input)
    # Division by the sizes scales all rates in a motion to a vector of length 1.
    return SingleInputMotions(
        input_rate=input_determinant[:, None] / unique_sizes,
        output_rate=output_sizes / unique_sizes,
        output_direction=_turning_directions(angular_velocity, unique_sizes),
    )


def _turning_directions(angular_velocity: Floats, sizes: Floats) -> Floats:
    """Return unit vectors along angular velocities of a link, NaN where the link rests.

    They are also NaN for a motion that is not unique, because the links can move in several
    ways. The link counts as resting if its speed is very small compared with the size of
    all rates in the motion, because such a speed can be rounding.

    Parameters
    ----------
    angular_velocity
        (n, g, 3) angular velocities in g motions.
    sizes
        (n, g) norm of all rates in each motion, NaN for motions that are not unique.
    """
    speed = np.linalg.norm(angular_velocity, axis=2, keepdims=True)
    is_turning = speed > SINGULAR_TRANSMISSION * sizes[..., None]
    known_speed = np.where(is_turning, speed, np.nan)
    return angular_velocity / known_speed


def _discard_ambiguous_motions(sizes: Floats, input_rates: Floats) -> Floats:
    """Return the sizes (n, g) of motions, with NaN where a motion is not unique.

    Motion i of the g motions moves input i while the other inputs are locked. Its size is
    the norm of all its rates. The caller divides by this size.

    At some singularities the links can move in several ways while all inputs but input i
    are locked. Motion i is then not unique, and its computed size is zero up to rounding.
    NaN replaces this size, so that quotients are NaN and not rounding errors.

    The size is zero for this reason. All motions are combinations of g orthonormal basis
    motions. The coefficients of motion i are column i of the adjugate of `input_rates`. Up
    to its sign, each of these coefficients is a determinant of the rows of the locked
    inputs without one column. If these rows are linearly dependent, the links can move in
    several ways, and all these determinants are zero.

    Parameters
    ----------
    sizes
        (n, g) the sizes.
    input_rates
        (n, g, g) rates of the g inputs (rows) in the basis motions (columns).
    """
    # A size counts as zero if it is very small compared with the largest of the g sizes.
    largest_size = np.max(sizes, axis=1, keepdims=True)
    is_unique = sizes > SINGULAR_TRANSMISSION * largest_size
    if input_rates.shape[1] > 1:
        # This comparison fails if all sizes are zero, because ratios of the sizes are then
        # rounding errors. All sizes are zero if the links can move in two ways while all
        # inputs rest. Two singular values of `input_rates` are then zero.
        second_smallest = decompose(input_rates).values[:, -2]
        is_unique &= second_smallest[:, None] > SINGULAR_TRANSMISSION
    return np.where(is_unique, sizes, np.nan)


def _determinant_with_sense(input_rates: Floats, space: TangentSpace) -> Floats:
    """Return the determinant (n,) of the rates of the inputs in independent motions.

    The determinant is zero where links can move while all inputs rest. The caller divides
    it by the size of all rates. The quotient is the rate of an input that moves alone.

    The independent motions are the columns of `space.basis`. If their signs are arbitrary,
    the sign of the determinant has no meaning. Its absolute value is then returned.

    Parameters
    ----------
    input_rates
        (n, g, g) rates of the g inputs in g independent motions.
    space
        The motions that close the loops, with g basis vectors at each configuration.
    """
    determinant = np.linalg.det(input_rates)
    if space.has_fixed_sense:
        return determinant
    return np.abs(determinant)


def _measure_singularities(
    motion: Motion, space: TangentSpace, output: OutputStationary
) -> SingularityMeasures:
    """Return how near configurations are to singularities of types I and II.

    At type I inputs can move while the output rests. At type II the output can move while
    the inputs rest. In a self-motion other links move while inputs and output rest.

    The output can be the orientation of a link, or only a direction of the link. In the
    second case, the link may turn about this direction while the output rests.

    Parameters
    ----------
    motion, space, output
        The n configurations, their rates that close the loops, and the condition that the
        output rests. `output.pointing` is the direction in the axes of the output link, or
        None for an orientation.
    """
    input_variables = _input_variables(motion)
    # (n, variables, 3) relative angular velocity of the links of a pair per unit rate.
    vectors = space.linearisation.vectors
    # How firmly locked inputs fix the output, zero if the output can move.
    transmission = Transmission(
        tree=space.tree,
        driven=tuple(input_variables),
        link=output.link,
        relative_to=output.relative_to,
        direction=output.pointing,
    )
    # (n, 3) the direction in each configuration, or None.
    output_directions = transmission.output_directions(space.linearisation.rotations)
    type_two_transmission = transmission.measure(vectors, output_directions)
    # How firmly locked inputs fix all links, zero if any link can move.
    locked_values = input_authority(space.tree, input_variables, vectors)
    locked_singular_value, locked_reciprocal_condition = locked_values

    # The columns of `space.basis` are independent motions: rates of all variables. Each
    # motion has rates of the inputs and rates of the output, which occur together.
    occurring_rates = _find_occurring_rates(
        input_rates=space.basis[:, input_variables],
        output_rates=output.equations(space.linearisation) @ space.basis,
    )
    # How much the output has to move if the inputs move, zero if the output can rest. A
    # motion in which inputs and output rest is a self-motion, and is not counted here.
    type_one_sine = _smallest_output_size(occurring_rates)
    # In rows that have no configuration the transmission is NaN. The measure of type I is
    # set to NaN there, too.
    return SingularityMeasures(
        type_one_sine=np.where(np.isfinite(type_two_transmission), type_one_sine, np.nan),
        type_two_transmission=type_two_transmission,
        locked_singular_value=locked_singular_value,
        locked_reciprocal_condition=locked_reciprocal_condition,
        reciprocal_condition=np.where(motion.failed, np.nan, space.reciprocal_condition),
        has_self_motion=occurring_rates.has_self_motion,
    )


def _decide_types(measures: SingularityMeasures) -> SmallIntegers:
    """Return the type of singularity (n,) of configurations from their measures.

    At type I inputs can move while the output rests. At type II the output can move while
    the inputs rest. Type III is both. In a self-motion other links move while inputs and
    output rest. A measure below `SINGULAR_TRANSMISSION` counts as zero.

    The rates of all variables satisfy linear equations, which keep the loops closed. Where
    these equations lose rank, they have additional solutions. Not every solution is then a
    real motion of the mechanism, so types I and III are not considered. The configuration
    counts as type II if a solution moves the output while the inputs rest. Otherwise it
    counts as a self-motion.
    """
    loses_rank = measures.reciprocal_condition < SINGULAR_TRANSMISSION
    is_type_one = (measures.type_one_sine < SINGULAR_TRANSMISSION) & ~loses_rank
    is_type_two = measures.type_two_transmission < SINGULAR_TRANSMISSION
    has_other_type = is_type_one | is_type_two
    is_self_motion = ~has_other_type & (loses_rank | measures.has_self_motion)

    row_type = np.full(len(loses_rank), RowType.REGULAR, dtype=np.int8)
    row_type[is_type_one] = RowType.I
    row_type[is_type_two] = RowType.II
    row_type[is_type_one & is_type_two] = RowType.III
    row_type[is_self_motion] = RowType.SELF_MOTION
    # Without a configuration, the measures are NaN.
    row_type[~np.isfinite(measures.type_two_transmission)] = RowType.UNKNOWN
    return row_type


def _decide_groups(
    row_type: SmallIntegers, single_input_motions: SingleInputMotions
) -> SmallIntegers:
    """Return the group (n,) of each configuration in Di Gregorio's discussion.

    At type I inputs can move while the output rests. At type II the output can move
    while the inputs rest. Type III is both at once.

    If all inputs but one are locked, the mechanism has one degree of freedom. There is one
    such mechanism for each input. A configuration of type I, II or III is in group 1 if at
    least one of these mechanisms is singular, and in group 2 if none is. Other
    configurations are in no group (0).

    Parameters
    ----------
    row_type
        (n,) type of singularity (`RowType`) of each configuration.
    single_input_motions
        The motions of these mechanisms.
    """
    # In each motion, all rates together are a vector of length 1. A rate below this
    # tolerance counts as zero.
    tolerance = ALONE_SINGULAR_FACTOR * SINGULAR_TRANSMISSION
    # (n, inputs) a mechanism is regular if its input and its output move. If its motion is
    # not unique, its rates are NaN. The comparisons are then False, so it is not regular.
    is_input_moving = np.abs(single_input_motions.input_rate) > tolerance
    is_output_moving = np.abs(single_input_motions.output_rate) > tolerance
    is_regular_alone = is_input_moving & is_output_moving
    is_singular_alone = np.any(~is_regular_alone, axis=1)

    is_of_type = np.isin(row_type, (RowType.I, RowType.II, RowType.III))
    group = np.zeros(len(row_type), dtype=np.int8)
    group[is_of_type & is_singular_alone] = 1
    group[is_of_type & ~is_singular_alone] = 2
    return group


@dataclass(frozen=True)
class _OccurringRates:
    """A basis of the rates of inputs and output that occur together, at n configurations.

    The mechanism has k independent motions. Each column of the basis belongs to a motion.
    The upper g numbers are the rates of the inputs in this motion. The m numbers below them
    are the rates of the output. From the basis, the nearness to type I is measured, where
    inputs can move while the output rests. The basis also shows whether only other links
    can move (self-motion).

    Attributes
    ----------
    input_part, output_part
        (n, g, k) upper and (n, m, k) lower part of the columns. The first `rank` columns
        are orthonormal. The other columns are zero: one for each independent motion in
        which inputs and output rest.
    rank
        (n,) number of columns that are not zero.
    """

    input_part: Floats
    output_part: Floats
    rank: Integers

    @property
    def has_self_motion(self) -> Bools:
        """(n,) whether a motion moves neither the inputs nor the output."""
        motion_count = self.output_part.shape[2]
        return self.rank < motion_count


def _find_occurring_rates(input_rates: Floats, output_rates: Floats) -> _OccurringRates:
    """Return a basis of the rates that inputs and output can have in the same motion.

    There are k independent motions. Each motion has a column of g + m numbers: the rates of
    the g inputs, and below these the m rates of the output. The basis spans the same space
    as these columns. Its columns are orthonormal, or zero if there are fewer than k
    dimensions.

    From the basis, the caller measures how near a configuration is to a singularity of
    type I, where inputs can move while the output rests.

    Parameters
    ----------
    input_rates, output_rates
        (n, g, k) rates of the inputs and (n, m, k) rates of the output.
    """
    _, input_count, motion_count = input_rates.shape
    svd = decompose(np.concatenate([input_rates, output_rates], axis=1))
    # The first k left singular vectors are the basis. A singular value of zero belongs to a
    # motion in which inputs and output rest. Its vector is replaced by zeros.
    is_moving = svd.values > SINGULAR_TRANSMISSION
    basis = svd.left[:, :, :motion_count] * is_moving[:, None]
    return _OccurringRates(
        input_part=basis[:, :input_count],
        output_part=basis[:, input_count:],
        rank=np.sum(is_moving, axis=1),
    )


def _smallest_output_size(occurring_rates: _OccurringRates) -> Floats:
    """Return how little the output can move in a motion of the mechanism, from 0 to 1.

    The rates of inputs and output in a motion are scaled to a vector of length 1. The size
    of the output's part of this vector is computed for the motion in which it is smallest.
    The result (n,) is zero in a singularity of type I, where inputs can move while the
    output rests.

    The output has m rates. If there are more than m independent motions, the output rests
    in some motions in every configuration. These motions do not indicate a singularity, so
    they are not counted.
    """
    output_part = occurring_rates.output_part  # (n, m, motions)
    # The motions form an orthonormal basis. The singular values of the output's part are
    # therefore its extreme sizes, the largest one first.
    sizes = np.linalg.svd(output_part, compute_uv=False)
    output_rate_count = output_part.shape[1]
    # One size for each independent motion (there are `rank`), but at most one for each rate
    # of the output.
    size_count = np.minimum(occurring_rates.rank, output_rate_count)
    # If nothing moves, the result is 1, the largest possible size.
    smallest_size = np.ones(len(sizes))
    (moving_rows,) = np.nonzero(size_count > 0)
    # The last size that is counted is the smallest one.
    last_column = size_count[moving_rows] - 1
    smallest_size[moving_rows] = sizes[moving_rows, last_column]
    return smallest_size


@dataclass(frozen=True)
class _SingularityCause:
    """A quantity that vanishes at some singularities, and words for what this means.

    Attributes
    ----------
    phrase
        Words that are reported in rows in which the quantity vanishes.
    sizes
        (n,) the quantity at n rows (configurations), NaN in rows in which it must not be
        reported.
    """

    phrase: str
    sizes: Floats


@np.errstate(invalid="ignore", divide="ignore", over="ignore")
def what_vanishes(
    motion: Motion,
    output: OutputStationary,
    pointing: Floats | None = None,
    by_rank: bool = False,
) -> list[str]:
    """Return, for each row, the geometric reason of the singularity as a short text.

    If input i moves alone while the others are locked, the output turns about the pole axis
    u_i with the angular velocity w_i, and c_i w_i = d_i q_i'. The text has the first of the
    following items that applies:

    1. vanishing c_i and d_i, or pole axes u_i that coincide, are coplanar in threes, or lie
       along the pointing direction,
    2. two axes along one line,
    3. two axes coplanar with the pointing direction,
    4. the reason why none of these is decided.

    For a self-motion, the text has the moving links.

    Parameters
    ----------
    motion, output
        The motion (n rows) of a mechanism with at least two inputs, and the output.
    by_rank
        Whether degrees of freedom are determined from the rank of the closure equations,
        instead of by counting links and pairs.
    pointing
        (n, 3) the output direction, in axes of the output's reference link. None if the
        orientation of the link is the output.

    Returns
    -------
    n texts.
    """
    result = coefficients(motion, output, by_rank)
    # Some pole axes may be unknown at a singularity. In the motion in which one input moves
    # alone, the rates vanish with c and d, and the output turns about the pole axis. These
    # numbers replace unknown ones.
    c = np.where(np.isfinite(result.c), result.c, result.input_rate)
    d = np.where(np.isfinite(result.d), result.d, result.output_rate)
    u = np.where(np.isfinite(result.u), result.u, result.alone)
    inputs = motion.mechanism.names_of(motion.assembly.inputs)
    direction = None
    if pointing is not None:
        direction = np.matvec(motion.rotations[:, output.relative_to], pointing)

    phrases_by_row: list[list[str]] = [[] for _ in c]
    for causes in _possible_causes(inputs, c, d, u, direction):
        for row, phrases in enumerate(phrases_by_row):
            if not phrases:
                phrases_by_row[row] = [
                    cause.phrase
                    for cause in causes
                    if np.abs(cause.sizes[row]) < VANISHING_SIZE
                ]
    for row in np.flatnonzero(result.type == RowType.SELF_MOTION).tolist():
        moving_links = _describe_self_motion(motion.rows(slice(row, row + 1)), output)
        phrases_by_row[row] = [moving_links]
    # Rows in which nothing vanishes get a text that says why no reason was found.
    for row, phrases in enumerate(phrases_by_row):
        if phrases:
            continue
        if result.reciprocal_condition[row] < VANISHING_SIZE:
            phrases.append("the loops lose rank")
        elif not all_finite(u[row]):
            phrases.append("pole axes not known")
        else:
            least = np.min(np.abs([c[row], d[row]]))
            phrases.append(f"motions alone: no c, d below {least:.1e}")
    return [" ".join(phrases) for phrases in phrases_by_row]


def _possible_causes(
    inputs: Sequence[str], c: Floats, d: Floats, u: Floats, direction: Floats | None
) -> list[list[_SingularityCause]]:
    """Return the possible causes of a singularity, in the order in which they are reported.

    If input i moves with the rate q_i' while the others are locked, the output turns about
    the axis u_i with the angular velocity w_i, and c_i w_i = d_i q_i'. A cause is a
    quantity that vanishes at a singularity. The causes are in three lists. A cause of a
    later list is reported only if no cause of the earlier lists applies:

    1. a coefficient c_i or d_i is zero, all axes coincide, three are in one plane, or an
       axis is along the output direction;
    2. two axes coincide;
    3. two axes are in one plane with the output direction.

    If the output is the orientation of a link, it has no direction, and there is no third
    list.

    Parameters
    ----------
    inputs
        Names of the g inputs.
    c, d
        (n, g) the coefficients c_i and d_i of each input.
    u
        (n, g, 3) unit vectors along the axes u_i, at n configurations.
    direction
        (n, 3) the output, if this is a line fixed in the output link: a unit vector along
        the line. A rotation of the link about the line does not count as a motion. None if
        the output is the orientation of the link. All vectors are in ground axes.
    """
    c_causes = [_SingularityCause(f"c_{name}=0", c[:, i]) for i, name in enumerate(inputs)]
    d_causes = [_SingularityCause(f"d_{name}=0", d[:, i]) for i, name in enumerate(inputs)]
    all_axes_causes = _causes_of_all_axes(inputs, u)
    two_axes_causes = _causes_of_two_axes(inputs, u)
    if direction is None:
        return [c_causes + d_causes + all_axes_causes, two_axes_causes]
    along_causes = _causes_along_direction(inputs, u, direction)
    coplanar_causes = _causes_coplanar_with_direction(inputs, u, direction)
    return [
        c_causes + d_causes + along_causes + all_axes_causes,
        two_axes_causes,
        coplanar_causes,
    ]


def _causes_of_all_axes(inputs: Sequence[str], u: Floats) -> list[_SingularityCause]:
    """Return the causes that all axes of inputs coincide, or that three are coplanar.

    A cause is a quantity that vanishes at a singularity. `what_vanishes` reports the cause.
    If one input moves alone, the output turns about an axis u. If three axes are in one
    plane, the three inputs cannot turn the output at right angles to this plane.

    Parameters
    ----------
    inputs, u
        Names of the g inputs, and their axes (n, g, 3) at n configurations.
    """
    largest_sine = np.max(np.linalg.norm(_cross_products(u), axis=2), axis=1)
    causes = [_SingularityCause(f"u of {', '.join(inputs)} coincide", largest_sine)]
    # Axes that coincide are coplanar, too. Only the first cause is reported there, so the
    # volume is NaN.
    do_coincide = largest_sine < VANISHING_SIZE
    volumes = np.where(do_coincide[:, None], np.nan, _triple_products(u))
    for number, three in enumerate(combinations(inputs, 3)):
        causes.append(
            _SingularityCause(f"u of {', '.join(three)} coplanar", volumes[:, number])
        )
    return causes


def _causes_of_two_axes(inputs: Sequence[str], u: Floats) -> list[_SingularityCause]:
    """Return for any two inputs the cause that their pole axes (n, g, 3) coincide."""
    sines = np.linalg.norm(_cross_products(u), axis=2)
    return [
        _SingularityCause(f"u_{a} and u_{b} along one line", sines[:, number])
        for number, (a, b) in enumerate(combinations(inputs, 2))
    ]


def _causes_along_direction(
    inputs: Sequence[str], u: Floats, direction: Floats
) -> list[_SingularityCause]:
    """Return, for each input, the cause that its axis is along the output direction.

    The output is a direction on a link. Each input alone turns the link about an axis. If
    this axis is along the direction, the direction rests while the input moves. A cause is
    a quantity that vanishes at a singularity. Here this is the sine of the angle between
    the axis and the direction.

    Parameters
    ----------
    inputs, u
        Names of the g inputs, and their axes (n, g, 3).
    direction
        (n, 3) the output direction.
    """
    sines = np.linalg.norm(cross(u, direction[:, None]), axis=2)
    return [
        _SingularityCause(f"u_{name} along the direction", sines[:, i])
        for i, name in enumerate(inputs)
    ]


def _causes_coplanar_with_direction(
    inputs: Sequence[str], u: Floats, direction: Floats
) -> list[_SingularityCause]:
    """Return, for any two inputs, the cause that the direction is coplanar with their axes.

    The output is a direction on a link. Each input alone turns the link about an axis. If
    the direction is in the plane of two axes, a motion of these two inputs together can
    turn the link about the direction. The direction then rests. A cause is a quantity that
    vanishes at a singularity, here a triple product.

    Parameters
    ----------
    inputs, u
        Names of the g inputs, and their axes (n, g, 3).
    direction
        (n, 3) the output direction.
    """
    # (n, pairs of inputs) triple products of the axes of two inputs and the direction.
    volumes = np.matvec(_cross_products(u), direction)
    causes = []
    for pair_number, (first, second) in enumerate(combinations(inputs, 2)):
        phrase = f"u_{first} and u_{second} coplanar with the direction"
        causes.append(_SingularityCause(phrase, volumes[:, pair_number]))
    return causes


def _cross_products(axes: Floats) -> Floats:
    """Return the cross products (n, pairs, 3) of any two of g axes (n, g, 3).

    Here pairs are any two axes, in the order of `itertools.combinations`. A product
    vanishes if two axes coincide.
    """
    first, second = np.triu_indices(axes.shape[1], 1)
    return cross(axes[:, first], axes[:, second])


def _triple_products(axes: Floats) -> Floats:
    """Return the triple products (n, threes) of any three of g axes (n, g, 3).

    The threes are in the order of `itertools.combinations`. A product vanishes if three
    axes are coplanar.
    """
    threes = np.array([*combinations(range(axes.shape[1]), 3)], dtype=int)
    first, second, third = threes.reshape(-1, 3).T
    # With an unknown axis (NaN), a determinant by LAPACK can be 0, but this is NaN.
    return dot(axes[:, first], cross(axes[:, second], axes[:, third]))


def _describe_self_motion(motion: Motion, output: OutputStationary) -> str:
    """Return as text which links move in a self-motion.

    In a self-motion, other links move while inputs and output rest. The text is reported as
    the cause of this singularity.

    Parameters
    ----------
    motion
        One row, which was classified as a self-motion.
    output
        The condition that the output rests.
    """
    linearisation = motion.linearisation
    # Rates of the variables are a self-motion if three products vanish: those with the
    # Jacobian (the loops stay closed), with `input_equations` (the inputs rest), and with
    # the equations of the output.
    variable_count = motion.values.shape[1]
    input_equations = np.eye(variable_count)[_input_variables(motion)]
    equations = np.concatenate(
        [linearisation.jacobian[0], input_equations, output.equations(linearisation)[0]]
    )
    # The last right singular vectors solve the equations.
    _, singular_values, right_vectors = np.linalg.svd(equations)
    rank = np.sum(singular_values > SINGULAR_TRANSMISSION)
    # Other measures have shown that there is a self-motion. So at least the last vector is
    # taken, even if its singular value is just above the limit.
    self_motions = right_vectors[min(rank, len(right_vectors) - 1) :]
    link_rates = [linearisation.body_rates(rates[None])[0] for rates in self_motions]
    speeds = np.linalg.norm(link_rates, axis=(0, 2))
    moving_links = np.array(motion.mechanism.links)[speeds > VANISHING_SIZE]
    return f"{' '.join(moving_links)} alone move"
