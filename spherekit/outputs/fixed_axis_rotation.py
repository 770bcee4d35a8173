"""Rotations of the output link about a fixed axis, for any mechanism.

`spherekit.outputs.rotation_path` follows the configuration nearest to the turned
orientation. Samples are predicted from the nodes of that way and corrected, so that they do
not depend on each other.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.polynomial.chebyshev import chebfit, chebpts1, chebval
from numpy.typing import ArrayLike

from spherekit.argument_validation import checked
from spherekit.arrays import Floats, SmallIntegers
from spherekit.conventions import Names
from spherekit.errors import SolveError
from spherekit.files.mechanism_reader import AnyMechanism, mechanism_of
from spherekit.geometry.mirror import angles_between, quaternion
from spherekit.geometry.rotation import all_finite, max_abs, unit_rows
from spherekit.geometry.tilt_torsion import rotation
from spherekit.geometry.triangle import arc
from spherekit.mechanism.mechanism import chosen_output
from spherekit.numerics.minima import minimize_in_brackets
from spherekit.outputs.rotation_path import (
    LEAPS,
    STATIONARY,
    UNFIXED,
    VERIFIED,
    Nodes,
    Optimality,
    OutputTarget,
    Way,
)
from spherekit.positions.assembly_mode import has_configuration
from spherekit.positions.linear_equations import condition_numbers
from spherekit.status import Status
from spherekit.tolerances import EPS, SINGULAR_RATIO, USABLE_DIRECTION
from spherekit.velocities.transmission import SINGULAR, Transmission

AROUND, POINTS = 0.08, 14
"""How far around a configuration that was stepped over (rad of theta) rates are
interpolated, through how many points."""
MARKS = 257
"""Angles on a rotation among which the inputs may let go of the output."""
ROUNDING = 8.0 * EPS
"""Error of the axis times angle of a rotation computed from two orientations (rad)."""
CLOSED_START = 1e-6
"""A configuration to start from may be as far from closed as this (rad)."""


@dataclass(frozen=True)
class RotationSamples:
    """n samples of a rotation about a fixed axis, in the axes of the base.

    Attributes
    ----------
    theta
        (n,) rad, the angle turned through about the axis.
    inputs, rates, second_rates
        (n, inputs): the driven variables (rad) and their first and second derivatives by
        theta.
    values
        (n, variables) rad, of all pairs.
    orientation
        (n, 3, 3) from the axes of the output link to those of the base.
    departure
        (n,) rad, the angle between this orientation and the one turned exactly about
        the axis.
    drift
        (n,) rad, the angle between the axis about which the link turns there and the
        fixed one.
    type_2
        (n,) how surely the inputs hold the output, 0 where they do not: the measure of
        type II, see `spherekit.velocities.transmission`.
    status
        (n,) codes of `Status`. A row that is not OK is NaN, except at AT_SINGULARITY:
        there the inputs do not hold the mechanism, but the rotation goes on; rates that
        are not finite are NaN.
    """

    theta: Floats
    inputs: Floats
    rates: Floats
    second_rates: Floats
    values: Floats
    orientation: Floats
    orientation_error: Floats
    drift: Floats
    type_2: Floats
    status: SmallIntegers


@dataclass(frozen=True)
class FollowedRotation(Way):
    """A rotation about a fixed axis as far as a mechanism follows it.

    Attributes
    ----------
    inputs
        Names of the driven pairs.
    axis, angle
        Unit vector (3,) in the axes of the base, and the whole angle (rad), 0 or more.
    exact
        Whether the output link turns exactly about the axis, as far as it gets.
    end
        Status of what lies beyond: OUT_OF_REACH where the output link cannot turn further,
        AT_SINGULARITY where the loops stop fixing the links, MODE_LOST otherwise.
    leaps
        Angles (rad) of configurations that were stepped over, because the loops do not fix
        the links there; rates near them are interpolated.
    """

    transmission: Transmission
    driven: list[int]
    inputs: Names
    angle: float
    nodes: Nodes
    end: Status
    leaps: tuple[float, ...]

    @property
    def reached(self) -> float:
        """The angle (rad) at which following ended."""
        return min(float(self.nodes.theta[-1]), self.angle)

    @cached_property
    def crossings(self) -> tuple[float, ...]:
        """Angles (rad) on the way at which the inputs do not hold the output.

        Where the transmission measure has a minimum of 0, enclosed more and more narrowly.
        """
        marks = np.linspace(0.0, self.reached, MARKS)
        held = np.nan_to_num(self._held(marks), nan=np.inf)
        beside = np.pad(held, 1, constant_values=np.inf)
        low = np.flatnonzero((held <= beside[:-2]) & (held < beside[2:]))
        ends = marks[np.clip([low - 1, low + 1], 0, MARKS - 1)]
        places = minimize_in_brackets(self._held, *ends)
        lost = places[~(self._held(places) > SINGULAR_RATIO)]
        apart = np.abs(lost[:, None] - np.array(self.leaps)) > LEAPS[-1]
        places = np.concatenate([self.leaps, lost[np.all(apart, axis=1)]])
        return tuple(np.sort(np.clip(places, 0.0, self.reached) + 0.0).tolist())

    def _held(self, theta: Floats) -> Floats:
        """Return how surely (n,) the inputs hold the output at angles reached (n,)."""
        near, _ = self.near(theta, self.nodes.between(theta)[0])
        return self.transmission.of_values(self.target.closure, near.values)

    def at(self, theta: ArrayLike) -> RotationSamples:
        """Return the samples at angles theta (n,) rad from 0 to the whole angle."""
        theta = within(theta, self.angle, "theta", "rad")
        status = np.where(theta <= self.reached, Status.OK, self.end).astype(np.int8)
        predicted, size = self.nodes.between(np.minimum(theta, self.reached))
        near, _ = self.near(theta, predicted)
        hold = np.nan_to_num(1.0 / condition_numbers(near.system))
        if not self.exact:
            hold = np.minimum(near.least_eigenvalue, near.loop_conditioning)
        unfixed = (status == Status.OK) & ~(hold > UNFIXED)
        if np.any(unfixed):
            values = np.where(unfixed[:, None], predicted, near.values)
            near = self.target.at(values, self.wanted(theta))
        off = max_abs(near.values - predicted, axis=1)
        held = self.transmission.of_values(self.target.closure, near.values)
        for wrong, why in (
            (unfixed, Status.AT_SINGULARITY),
            (~(near.miss(self.exact) < STATIONARY), Status.NOT_CONVERGED),
            (~(off <= 10.0 * VERIFIED.middle * size + 1e-8), Status.MODE_LOST),
            (~np.all(near.at.states.inside, axis=1), Status.OFF_PROFILE),
            (~(held > SINGULAR), Status.AT_SINGULARITY),
        ):
            status[(status == Status.OK) & wrong] = why
        slopes, bends = self._rates(theta, near)
        with np.errstate(all="ignore"):
            w = unit_rows(np.matvec(near.turning, slopes))
        lost = (theta > self.reached) | ~has_configuration(status)

        def kept(array: Floats) -> Floats:
            array[lost] = np.nan
            return array

        return RotationSamples(
            theta,
            kept(near.values[:, self.driven]),
            kept(slopes[:, self.driven]),
            kept(bends[:, self.driven]),
            kept(near.values),
            kept(near.reached),
            kept(angles_between(near.reached, self.wanted(theta))),
            kept(arc(w, self.axis)),
            kept(held),
            status,
        )

    def _rates(self, theta: Floats, near: Optimality) -> tuple[Floats, Floats]:
        """Return first and second derivatives (n, variables) by theta.

        Near a configuration that was stepped over, where rounding grows without bound,
        from the polynomial through the derivatives at Chebyshev points around it.
        """
        slopes, bends, _ = near.rates(self.axis)
        ends, x = self.nodes.theta[[0, -1]], chebpts1(POINTS)
        for place in self.leaps:
            low, high = np.clip([place - AROUND, place + AROUND], *ends)
            rows = (theta > low) & (theta < high)
            points = 0.5 * (low + high) + 0.5 * (high - low) * x
            around, _ = self.near(points, self.nodes.between(points)[0])
            part = (2.0 * theta[rows] - low - high) / (high - low)
            for quantity, rates in zip(
                around.rates(self.axis), (slopes, bends), strict=False
            ):
                rates[rows] = chebval(part, chebfit(x, quantity, POINTS - 1)).T
        return slopes, bends


def turn_to(first: Floats, second: Floats) -> tuple[Floats, float]:
    """Return axis (3,) and angle (rad) of the rotation between orientations (3, 3).

    Raises
    ------
    SolveError
        If the axis or its sense is not determined.
    """
    four = quaternion((second @ first.T)[None])[0]
    sine = float(np.linalg.norm(four[:3]))
    angle = 2.0 * math.atan2(sine, abs(four[3]))
    if angle * USABLE_DIRECTION <= ROUNDING:
        raise SolveError(
            "the orientations coincide: every axis will do, none is given; there is "
            "nothing to turn"
        )
    if np.pi - angle <= ROUNDING:
        raise SolveError(
            "the orientations differ by half a turn: the line of the axis is determined, "
            "but both senses lead from one to the other; give the axis, with the sense "
            "wanted, and the angle"
        )
    return np.copysign(1.0, four[3]) * four[:3] / sine, angle


def unit(axis: ArrayLike) -> Floats:
    """Return a direction (3,) with length 1; `SolveError` if it has none."""
    given = np.asarray(axis, dtype=float)
    length = float(np.linalg.norm(given))
    if given.shape != (3,) or not 0.0 < length < np.inf:
        raise SolveError(
            f"direction: found {given.tolist()}, needs three finite numbers, not all zero"
        )
    return given / length


def within(places: ArrayLike, whole: float, name: str, unit: str) -> Floats:
    """Return angles or times (n,) of a rotation as an array.

    Raises
    ------
    SolveError
        If one is not between 0 and the whole.
    """
    given = np.atleast_1d(np.asarray(places, dtype=float))
    inside = np.clip(given, 0.0, whole)
    if given.ndim != 1 or not np.all(np.abs(given - inside) <= 1e-12 * max(1.0, whole)):
        raise SolveError(
            f"{name} has to be an array (n,) of numbers from 0 to {whole:.6g} {unit}, "
            "where the rotation ends"
        )
    return inside


@checked(SolveError)
def follow_rotation(
    mechanism: AnyMechanism,
    values: ArrayLike,
    axis: ArrayLike,
    angle: float,
    output: str | None = None,
    lead: float = 0.0,
) -> FollowedRotation:
    """Return the rotation of an output link about a fixed axis.

    Parameters
    ----------
    mechanism
        A mechanism driven at as many R pairs as it has freedoms, three at most.
    values
        (variables,) the closed configuration to start from, as in a row of a `Motion`.
    axis
        Direction of the axis, (3,), in the axes of the link that the output is relative to.
    angle
        How far to turn, rad, above 0.
    output
        Name of the output; may be left out if there is one.
    lead
        Angle (rad) before the start of the rotation at which the configuration is given:
        where loops do not fix the links no way can begin, but one can go through.

    Raises
    ------
    ModelError
        If the output is unknown.
    SolveError
        If the configuration does not close, or the output link cannot turn there in as
        many ways as there are inputs.
    """
    mechanism = mechanism_of(mechanism)
    end = chosen_output(mechanism, output)
    about = unit(axis)
    if not 0.0 < angle < np.inf:
        raise SolveError(f"angle: found {angle:g} rad, needs a finite angle above 0")
    target = OutputTarget.of(mechanism, end)
    near = _started(target, _configuration(target, values, mechanism.name), mechanism.name)
    given = target, about, rotation(about, [lead])[0] @ near.reached[0]
    way = Way(*given, bool(near.rates(about)[2][0]))
    measure = Transmission.of(replace(mechanism, ground=end.relative_to), end)
    return FollowedRotation(
        *given,
        way.exact,
        measure,
        list(measure.driven),
        mechanism.input_pairs,
        float(angle),
        *way.follow(way.nodes_of(np.array([0.0 - lead]), near), angle),
    )


@checked(SolveError)
def follow_to(
    mechanism: AnyMechanism,
    values: ArrayLike,
    orientation: ArrayLike,
    output: str | None = None,
) -> FollowedRotation:
    """Return the rotation that carries the output link to an orientation (3, 3).

    In the axes of the link that the output is relative to. Other parameters and errors are
    those of `follow_rotation`; `SolveError` also if the axis is not determined.
    """
    mechanism = mechanism_of(mechanism)
    target = OutputTarget.of(mechanism, chosen_output(mechanism, output))
    placed = target.closure.at(_configuration(target, values, mechanism.name)[None]).placed
    wanted = np.asarray(orientation, dtype=float)
    proper = wanted.shape == (3, 3) and np.linalg.det(wanted) > 0.0
    if not proper or not max_abs(wanted @ wanted.T - np.eye(3)) < 1e-9:
        raise SolveError("the orientation has to be a rotation matrix (3, 3)")
    axis, angle = turn_to(placed[0, target.link], wanted)
    return follow_rotation(mechanism, values, axis, angle, output)


def _configuration(target: OutputTarget, values: ArrayLike, name: str) -> Floats:
    """Return a configuration (variables,); `SolveError` unless it has finite values."""
    given, count = np.asarray(values, dtype=float), len(target.closure.tree.owners)
    if given.shape != (count,) or not all_finite(given):
        raise SolveError(
            f"{name}: the configuration to start from has to be {count} finite values, as "
            "in a row of its motion"
        )
    return given


def _started(target: OutputTarget, values: Floats, name: str) -> Optimality:
    """Return a configuration (variables,), closed exactly, from which a way may begin."""
    count = len(values)
    if target.freedoms > 3:
        raise SolveError(
            f"{name}: {target.freedoms} inputs turn the output link in more ways than "
            "there are; lock some of them"
        )
    freer = count - 3 * len(target.closure.tree.chords)
    if freer > target.freedoms:
        raise SolveError(
            f"{name}: it has {freer} freedoms or more, but {target.freedoms} inputs; "
            f"declare {freer} R pairs as inputs"
        )
    near = target.at(values[None], np.eye(3)[None])
    gap = near.at.gap[0]
    if not gap < CLOSED_START:
        raise SolveError(
            f"{name}: the configuration to start from does not close: its residual is "
            f"{gap:.3g} rad, but at most {CLOSED_START:g} is allowed"
        )
    way = Way(target, np.eye(3)[2], near.reached[0], False)
    near, _ = way.near(np.zeros(1), values[None])
    sizes = np.linalg.svd(near.at.jacobian[0], compute_uv=False)
    held = np.any(sizes[count - target.freedoms :] > UNFIXED * np.max(sizes, initial=0.0))
    if held or not near.loop_conditioning[0] > UNFIXED:
        raise SolveError(
            f"{name}: the configuration to start from is singular, or the mechanism has "
            f"other freedoms than its {target.freedoms} inputs; start from another one"
        )
    if not near.output_singular_value[0] > UNFIXED:
        raise SolveError(
            f"{name}: at the start the output link cannot turn in as many ways as there "
            f"are inputs ({target.freedoms}): it is at the limit of its reach, or does "
            "not move with all inputs; start elsewhere or choose another output"
        )
    return near
