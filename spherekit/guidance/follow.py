"""Following a rotation of the output link about a fixed axis, for any mechanism.

From a closed configuration the orientation wanted turns about the axis, and the
configuration nearest to it is followed in verified steps: a step is accepted only if the
prediction with exact first and second derivatives was nearly right, Newton's method
contracted at once, the equations changed by less than would make them singular, and the
Hermite polynomial of the step predicts its middle. Where the loops do not fix the links at
one configuration on the way, that is stepped over at once, if the polynomials on both
sides of it agree.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from spherekit.conventions import CLOSURE_TOLERANCE, SINGULAR_RATIO, Status
from spherekit.errors import SolveError
from spherekit.guidance.nearest import Nearness, Target
from spherekit.guidance.rotation import (
    RotationSamples,
    chosen_output,
    control,
    turn_to,
    unit,
    within,
)
from spherekit.model.geometry import geometry_of
from spherekit.model.mechanism import Mechanism
from spherekit.motion.closure import Closure
from spherekit.motion.steps import determinant_sign
from spherekit.sphere.poses import rotation, turns_between
from spherekit.sphere.rotation import Floats, arc

LARGEST_STEP = 0.2
"""Longest step (rad of theta)."""
SMALLEST_STEP = 1e-9
MOST_NODES = 5000
BEND = 0.05
"""Second-order part (rad) of a step that is aimed at."""
NEARER, SHORT = 0.3, 0.02
"""Part of slope / bend stepped at most, if that is short: 0.6 of the way to a limit of the
reach, where variables go as the square root of the way left."""
LARGEST_CHANGE = 0.6
"""Eigenvalues of the change of the equations in one step, relative to them; they become
singular on the way where one is -1."""
LARGEST_CORRECTION = 0.05
"""A prediction from the start of a step may be wrong by this part of it."""
LARGEST_MIDDLE = 1e-4
"""The prediction of its middle from both ends may be wrong by this part of it."""
CORRECTIONS = 8
SETTLED = 1e-10
"""A Newton step (rad) below this leaves an error that its square bounds."""
STATIONARY = 1e-11
"""How well (rad) a configuration has to be the nearest one."""
LEAPS = (0.004, 0.01, 0.02, 0.04)
"""Ways (rad of theta) tried over a singular configuration, from steps this short."""
LEAP_FROM = 2e-3
AROUND, POINTS = 0.08, 14
"""How far around such a configuration (rad of theta) rates are interpolated, through how
many points."""
SMOOTH = 1e-7
"""The Hermite polynomial of a leap has to agree with configurations in it to this."""
SINGULAR = 0.01
"""Where links are held less firmly than this part of how they are beside, on a leap."""
UNFIXED = 1e-7
"""Equations of this reciprocal condition do not fix the links."""
STRETCHED = 1e-3
"""How near the last node is to a limit of the output's reach, to name it as the reason."""
CLOSED_START = 1e-6
"""A configuration to start from may be as far from closed as this (rad)."""


@final
@dataclass(frozen=True)
class _Node:
    """A configuration on the way with its derivatives by theta, one row each."""

    theta: float
    near: Nearness
    first: Floats
    second: Floats
    follows: bool

    @property
    def values(self) -> Floats:
        return np.asarray(self.near.values[0])

    def taylor(self, way: Floats) -> Floats:
        """Return the variables (n, variables) at ways (n,) from here, by derivatives."""
        way = way[:, None]
        bend = np.nan_to_num(self.second)
        return np.asarray(self.values + way * self.first + 0.5 * way**2 * bend)

    @cached_property
    def inverse(self) -> Floats:
        """(variables, rows) pseudo-inverse of the equations."""
        return np.asarray(np.linalg.pinv(self.near.system[0]))

    @cached_property
    def condition(self) -> float:
        """Reciprocal condition of the equations."""
        size = np.linalg.norm(self.near.system[0]) * np.linalg.norm(self.inverse)
        return float(1.0 / size)


@final
@dataclass(frozen=True)
class FollowedRotation:
    """A rotation about a fixed axis as far as a mechanism follows it.

    See `FixedAxisRotation` for `axis`, `angle` and `inputs`.

    Attributes
    ----------
    end
        Status of what lies beyond: OUT_OF_REACH where the output link cannot turn further,
        AT_SINGULARITY where the loops stop fixing the links, BRANCH_LOST otherwise.
    crossings
        Angles (rad) of singular configurations on the way, where the inputs do not hold
        the mechanism.
    leaps
        Those of them that were stepped over, because the loops do not fix the links
        there; rates near them are interpolated.
    """

    target: Target
    driven: list[int]
    inputs: tuple[str, ...]
    axis: Floats
    angle: float
    start: Floats
    nodes: tuple[_Node, ...]
    end: Status
    crossings: tuple[float, ...]
    leaps: tuple[float, ...]

    @property
    def reached(self) -> float:
        """The angle (rad) at which following ended."""
        return self.nodes[-1].theta

    @property
    def exact(self) -> bool:
        """Whether the output link turns exactly about the axis, as far as it gets."""
        return self.nodes[0].follows

    @cached_property
    def _known(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Angle (k,), values, first and second derivatives (k, variables) of nodes."""
        return (
            np.array([node.theta for node in self.nodes]),
            np.stack([node.values for node in self.nodes]),
            np.stack([node.first for node in self.nodes]),
            np.stack([node.second for node in self.nodes]),
        )

    def _predict(self, theta: Floats) -> tuple[Floats, Floats]:
        """Return predicted variables (n, variables) and how far (n,) they may be off."""
        angles, values, first, second = self._known
        if len(angles) == 1:
            return np.repeat(values, len(theta), axis=0), np.full(len(theta), 1e-8)
        cell = np.clip(np.searchsorted(angles, theta) - 1, 0, len(angles) - 2)
        h = angles[cell + 1] - angles[cell]
        ends = [(values[c], first[c], second[c]) for c in (cell, cell + 1)]
        predicted = hermite(ends[0], ends[1], h, (theta - angles[cell]) / h)
        return predicted, 10.0 * LARGEST_MIDDLE * h + 1e-8

    def at(self, theta: ArrayLike) -> RotationSamples:
        """Return the samples at angles theta (n,) rad from 0 to the whole angle."""
        theta = within(theta, self.angle)
        status = np.where(theta <= self.reached, Status.OK, self.end).astype(np.int8)
        wanted = rotation(self.axis, theta) @ self.start
        predicted, allowed = self._predict(np.minimum(theta, self.reached))
        near, _, _ = corrected(self.target, predicted, wanted, self.exact)
        beyond = theta > self.reached
        hold = _conditions(near.system)
        if not self.exact:
            hold = np.minimum(near.firmness, near.looseness)
        unfixed = (status == Status.OK) & ~(hold > UNFIXED)
        if np.any(unfixed):
            values = np.where(unfixed[:, None], predicted, near.values)
            near = self.target.at(values, wanted)
            status[unfixed] = Status.AT_SINGULARITY
        off = np.max(np.abs(near.values - predicted), axis=1)
        followed = status == Status.OK
        status[followed & ~(near.miss(self.exact) < STATIONARY)] = Status.NOT_CONVERGED
        status[(status == Status.OK) & ~(off <= allowed)] = Status.BRANCH_LOST
        off_profile = (status == Status.OK) & ~np.all(near.states.inside, axis=1)
        status[off_profile] = Status.OFF_PROFILE
        held = control(self.target.closure, self.driven, near.values)
        status[(status == Status.OK) & ~(held > SINGULAR_RATIO)] = Status.AT_SINGULARITY
        slopes, bends = self._rates(theta, near)
        w = np.einsum("nkv,nv->nk", near.turning, slopes)
        with np.errstate(invalid="ignore", divide="ignore"):
            w = w / np.linalg.norm(w, axis=1, keepdims=True)
        lost = beyond | ~np.isin(status, (Status.OK, Status.AT_SINGULARITY))

        def known(array: Floats) -> Floats:
            array[lost] = np.nan
            return array

        return RotationSamples(
            theta=theta,
            inputs=known(near.values[:, self.driven]),
            rates=known(slopes[:, self.driven]),
            second_rates=known(bends[:, self.driven]),
            values=known(near.values),
            orientation=known(near.reached),
            departure=known(turns_between(near.reached, wanted).angle),
            drift=known(arc(w, np.broadcast_to(self.axis, w.shape))),
            control=known(held),
            status=status,
        )

    def _rates(self, theta: Floats, near: Nearness) -> tuple[Floats, Floats]:
        """Return first and second derivatives (n, variables) by theta.

        Near a configuration that was stepped over, where rounding grows without bound,
        from the polynomial through the derivatives at Chebyshev points around it.
        """
        rates = near.rates(self.axis)
        slopes, bends = rates.first, rates.second
        for place in self.leaps:
            low, high = max(place - AROUND, 0.0), min(place + AROUND, self.reached)
            rows = (theta > low) & (theta < high)
            if not np.any(rows):
                continue
            k = np.arange(POINTS) + 0.5
            x = np.cos(k * np.pi / POINTS)
            points = 0.5 * (low + high) + 0.5 * (high - low) * x
            wanted = rotation(self.axis, points) @ self.start
            around, _, _ = corrected(
                self.target, self._predict(points)[0], wanted, self.exact
            )
            known = around.rates(self.axis)
            distance = theta[rows, None] - points
            distance[distance == 0.0] = 1e-300
            weights = (-1.0) ** np.arange(POINTS) * np.sin(k * np.pi / POINTS) / distance
            weights /= np.sum(weights, axis=1, keepdims=True)
            slopes[rows], bends[rows] = weights @ known.first, weights @ known.second
        return slopes, bends


def follow_rotation(
    mechanism: Mechanism,
    values: ArrayLike,
    axis: ArrayLike,
    angle: float,
    output: str | None = None,
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

    Raises
    ------
    ModelError
        If the output is unknown.
    SolveError
        If the configuration does not close, or the output link cannot turn there in as
        many ways as there are inputs.
    """
    end = chosen_output(mechanism, output)
    made = replace(mechanism, ground=end.relative_to)
    about = unit(axis)
    if not (np.isfinite(angle) and angle > 0.0):
        raise SolveError(f"angle: found {angle:g} rad, needs a finite angle above 0")
    inputs = tuple(item.pair for item in made.inputs)
    driven = [made.variables_of(made.pair_number[name])[0] for name in inputs]
    target = Target(
        Closure.of(made, geometry_of(made).joints), made.link_number[end.link], len(inputs)
    )
    start = _configuration(values, len(target.closure.tree.owners), made.name)
    first = _started(target, start, about, made.name)
    march = _March(
        target, driven, about, float(angle), first.near.reached[0], first.follows
    )
    nodes, status, crossings, leaps = march.run(first)
    return FollowedRotation(
        target,
        driven,
        inputs,
        about,
        float(angle),
        march.start,
        tuple(nodes),
        status,
        tuple(crossings),
        tuple(leaps),
    )


def follow_to(
    mechanism: Mechanism,
    values: ArrayLike,
    orientation: ArrayLike,
    output: str | None = None,
) -> FollowedRotation:
    """Return the rotation that carries the output link to an orientation (3, 3).

    In the axes of the link that the output is relative to. Other parameters and errors are
    those of `follow_rotation`; `SolveError` also if the axis is not determined.
    """
    end = chosen_output(mechanism, output)
    made = replace(mechanism, ground=end.relative_to)
    closure = Closure.of(made, geometry_of(made).joints)
    start = _configuration(values, len(closure.tree.owners), made.name)
    placed, _ = closure.place(start[None])
    wanted = np.asarray(orientation, dtype=float)
    proper = wanted.shape == (3, 3) and np.linalg.det(wanted) > 0.0
    if not proper or not np.max(np.abs(wanted @ wanted.T - np.eye(3))) < 1e-9:
        raise SolveError("the orientation has to be a rotation matrix (3, 3)")
    axis, angle = turn_to(placed[0, made.link_number[end.link]], wanted)
    return follow_rotation(mechanism, values, axis, angle, output)


def hermite(
    start: tuple[Floats, Floats, Floats],
    stop: tuple[Floats, Floats, Floats],
    h: Floats,
    part: Floats,
) -> Floats:
    """Return quintic Hermite values (n, m) at parts (n,), 0 to 1, of cells.

    `h` (n,) are their lengths; `start` and `stop` are values, first and second derivatives
    (n, m) at both ends; where those are not known, NaN, the values are cubic.
    """
    x, h = part[:, None], h[:, None]
    y = 1.0 - x
    x3, y3 = x**3, y**3
    value, slope, bend = start
    last, last_slope, last_bend = stop
    quintic = (
        value
        + x3 * (10.0 - 15.0 * x + 6.0 * x * x) * (last - value)
        + x * y3 * ((1.0 + 3.0 * x) * h * slope + 0.5 * x * h * h * bend)
        + x3 * y * (0.5 * y * h * h * last_bend - (4.0 - 3.0 * x) * h * last_slope)
    )
    cubic = value + x * x * (3.0 - 2.0 * x) * (last - value)
    cubic = cubic + x * y * h * (y * slope - x * last_slope)
    return np.where(np.isnan(quintic), cubic, quintic)


def corrected(
    target: Target, values: Floats, wanted: Floats, exact: bool
) -> tuple[Nearness, Floats, Floats]:
    """Return the nearest configurations by Newton's method from values (n, variables).

    With the size (n,) of the first step and the ratio of the second to the first.
    `exact` says that the output link can follow.
    """
    n = len(values)
    first, ratio = np.zeros(n), np.zeros(n)
    near = target.at(values, wanted)
    for step in range(CORRECTIONS):
        change = np.nan_to_num(near.exact_step() if exact else near.step())
        length = np.max(np.abs(change), axis=1)
        change *= np.minimum(1.0, 0.5 / np.maximum(length, 1e-300))[:, None]
        if step == 0:
            first = length
        elif step == 1:
            ratio = length / np.maximum(first, 1e-300)
        near = target.at(near.values + change, wanted)
        if not np.any(length > SETTLED):
            break
    return near, first, ratio


def _conditions(matrices: Floats) -> Floats:
    """Return reciprocal conditions (n,) of matrices (n, m, k), m >= k; 0 if not finite."""
    finite = np.all(np.isfinite(matrices), axis=(1, 2))
    sizes = np.linalg.svd(np.where(finite[:, None, None], matrices, 0.0), compute_uv=False)
    with np.errstate(invalid="ignore"):
        return np.nan_to_num(sizes[:, -1] / sizes[:, 0])


def _configuration(values: ArrayLike, count: int, name: str) -> Floats:
    """Return a configuration (variables,); `SolveError` unless it has finite values."""
    given = np.asarray(values, dtype=float)
    if given.shape != (count,) or not np.all(np.isfinite(given)):
        raise SolveError(
            f"{name}: the configuration to start from has to be {count} finite values, as "
            "in a row of its motion"
        )
    return given


def _started(target: Target, values: Floats, axis: Floats, name: str) -> _Node:
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
    gap = float(np.max(np.abs(near.gap), initial=0.0))
    if not gap < CLOSED_START:
        raise SolveError(
            f"{name}: the configuration to start from does not close: its residual is "
            f"{gap:.3g} rad, but at most {CLOSED_START:g} is allowed"
        )
    near, _, _ = corrected(target, values[None], near.reached, False)
    sizes = np.linalg.svd(near.jacobian[0], compute_uv=False)
    held = np.any(sizes[count - target.freedoms :] > UNFIXED * np.max(sizes, initial=0.0))
    if held or not near.looseness[0] > UNFIXED:
        raise SolveError(
            f"{name}: the configuration to start from is singular, or the mechanism has "
            f"other freedoms than its {target.freedoms} inputs; start from another one"
        )
    if not near.grasp[0] > UNFIXED:
        raise SolveError(
            f"{name}: at the start the output link cannot turn in as many ways as there "
            f"are inputs ({target.freedoms}): it is at the limit of its reach, or does "
            "not move with all inputs; start elsewhere or choose another output"
        )
    rates = near.rates(axis)
    return _Node(0.0, near, rates.first[0], rates.second[0], bool(rates.follows[0]))


@final
@dataclass(frozen=True)
class _March:
    target: Target
    driven: Sequence[int]
    axis: Floats
    angle: float
    start: Floats
    exact: bool

    def run(self, start: _Node) -> tuple[list[_Node], Status, list[float], list[float]]:
        """Return the nodes, what lies beyond the last, and singular places on the way.

        And those of them that were stepped over.
        """
        nodes, crossings, leaps = [start], list[float](), list[float]()
        at, step, leapt = start, 0.05, -np.inf
        while at.theta < self.angle and len(nodes) < MOST_NODES:
            bend = float(np.max(np.abs(np.nan_to_num(at.second)))) + 1e-300
            step = min(step, LARGEST_STEP, np.sqrt(2.0 * BEND / bend))
            nearer = NEARER * float(np.max(np.abs(at.first))) / bend
            if nearer < SHORT:
                step = min(step, nearer)
            if step < SMALLEST_STEP:
                return nodes, self._why(at), crossings, leaps
            goal = min(at.theta + step, self.angle)
            if self.angle - goal < SMALLEST_STEP:
                goal = self.angle
            made = self._advance(at, goal)
            if made is None and step < LEAP_FROM and at.theta > leapt + LEAP_FROM:
                leapt = at.theta
                leap = self._leap(at)
                if leap is not None:
                    made, place = leap
                    leaps.append(place)
                    crossings.append(place)
                    leapt, step = made.theta, made.theta - at.theta
            if made is None:
                step *= 0.5
                continue
            if self._sign(made) != self._sign(at) and not (
                crossings and crossings[-1] > at.theta
            ):
                crossings.append(self._flip(at, made))
            nodes.append(made)
            at = made
            step *= 2.0
        end = Status.OK if at.theta >= self.angle else Status.BRANCH_LOST
        return nodes, end, crossings, leaps

    def _nodes(self, theta: Floats, guess: Floats) -> tuple[list[_Node], Floats, Floats]:
        wanted = rotation(self.axis, theta) @ self.start
        near, first, ratio = corrected(self.target, guess, wanted, self.exact)
        rates = near.rates(self.axis)
        made = []
        for row, angle in enumerate(theta):
            one = self.target.at(near.values[row : row + 1], wanted[row : row + 1])
            slope, bend = rates.first[row], rates.second[row]
            made.append(_Node(float(angle), one, slope, bend, bool(rates.follows[row])))
        return made, first, ratio

    def _advance(self, at: _Node, goal: float) -> _Node | None:
        """Return the node at an angle if the way there passes all tests."""
        step = goal - at.theta
        guess = at.taylor(np.array([0.5, 1.0]) * step)
        if not np.all(np.isfinite(guess)):
            return None
        (middle, node), first, ratio = self._nodes(
            np.array([at.theta + 0.5 * step, goal]), guess
        )
        moved = float(np.max(np.abs(node.values - at.values)))
        if np.any(first > LARGEST_CORRECTION * moved + CLOSURE_TOLERANCE):
            return None
        if np.any((first > 1e-7) & (ratio > 0.1)):
            return None
        for each in (middle, node):
            if not self._holds(each) or each.follows != at.follows:
                return None
            if at.follows:
                change = at.inverse @ (each.near.system[0] - at.near.system[0])
                if not np.max(np.abs(np.linalg.eigvals(change))) < LARGEST_CHANGE:
                    return None
            elif not min(each.near.firmness[0], each.near.looseness[0]) > UNFIXED:
                return None
        off = np.max(np.abs(self._between(at, node, middle.theta) - middle.values))
        return node if off < LARGEST_MIDDLE * moved + CLOSURE_TOLERANCE else None

    def _holds(self, node: _Node) -> bool:
        finite = np.all(np.isfinite(node.first))
        return bool(finite and node.near.miss(self.exact)[0] < STATIONARY)

    @staticmethod
    def _between(at: _Node, node: _Node, theta: float) -> Floats:
        h = node.theta - at.theta
        ends = [(n.values[None], n.first[None], n.second[None]) for n in (at, node)]
        part = np.array([(theta - at.theta) / h])
        return np.asarray(hermite(ends[0], ends[1], np.array([h]), part)[0])

    def _leap(self, at: _Node) -> tuple[_Node, float] | None:
        """Return a node beyond a singular configuration, and the angle of that.

        None if there is none near, or the way does not go on smoothly.
        """
        for way in LEAPS:
            goal = at.theta + way
            if goal > self.angle:
                return None
            (node,), first, _ = self._nodes(np.array([goal]), at.taylor(np.array([way])))
            moved = float(np.max(np.abs(node.values - at.values)))
            if not self._holds(node) or first[0] > LARGEST_CORRECTION * moved:
                continue
            if not node.condition > LEAP_FROM * way:
                continue
            places = at.theta + way * np.array([0.2, 0.4, 0.6, 0.8])
            guess = np.stack([self._between(at, node, place) for place in places])
            inner, _, _ = self._nodes(places, guess)
            off = [
                np.max(np.abs(each.values - one))
                for each, one in zip(inner, guess, strict=True)
                if each.condition > 100.0 * UNFIXED
            ]
            if len(off) < 2 or max(off) > SMOOTH or not all(map(self._holds, inner)):
                continue
            place, hold = self._loosest(at, node)
            if hold < SINGULAR * min(self._hold(at, at, 0.0), self._hold(at, node, goal)):
                return node, place
        return None

    def _hold(self, at: _Node, node: _Node, theta: float) -> float:
        """Return how firmly the equations fix the links between two nodes."""
        values = at.values if node is at else self._between(at, node, theta)
        near = self.target.at(values[None], np.eye(3)[None])
        return float(np.linalg.svd(near.system[0], compute_uv=False)[-1])

    def _loosest(self, at: _Node, node: _Node) -> tuple[float, float]:
        """Return the angle between two nodes where the links are fixed least, and how."""
        low, high = at.theta, node.theta
        golden = 0.5 * (np.sqrt(5.0) - 1.0)
        for _ in range(60):
            inner = [high - golden * (high - low), low + golden * (high - low)]
            left, right = (self._hold(at, node, x) for x in inner)
            if left < right:
                high = inner[1]
            else:
                low = inner[0]
        place = float(0.5 * (low + high))
        return place, self._hold(at, node, place)

    def _sign(self, node: _Node) -> float:
        return self._signs(node.values[None])

    def _signs(self, values: Floats) -> float:
        free = [v for v in range(values.shape[1]) if v not in self.driven]
        _, jacobian = self.target.closure.linearise(values)
        return float(determinant_sign(jacobian[:, :, free])[0])

    def _flip(self, at: _Node, node: _Node) -> float:
        """Return the angle at which the inputs stop holding the mechanism."""
        # SciPy's optimisers take long to import, and most ways need none.
        from scipy.optimize import brentq

        free = [v for v in range(len(at.values)) if v not in self.driven]

        def determinant(theta: float) -> float:
            guess = self._between(at, node, theta)[None]
            wanted = rotation(self.axis, np.array([theta])) @ self.start
            near, _, _ = corrected(self.target, guess, wanted, self.exact)
            return float(np.linalg.det(near.jacobian[0][:, free]))

        return float(brentq(determinant, at.theta, node.theta, xtol=1e-13))

    def _why(self, at: _Node) -> Status:
        """Return the status of what lies beyond a node that no step leaves."""
        if not at.follows or at.near.grasp[0] < STRETCHED:
            return Status.OUT_OF_REACH
        return Status.AT_SINGULARITY if at.condition < STRETCHED else Status.BRANCH_LOST
