"""Verified steps along a rotation of an output link about a fixed axis.

From a closed configuration the orientation wanted turns about the axis, and the
configuration nearest to it is followed in steps that are verified as
`spherekit.motion.steps` says, with exact first and second derivatives.
Where the loops do not fix the links at
one configuration on the way, that is stepped over at once, if the polynomials on both
sides of it agree.

The configuration whose output link is nearest to an orientation, and how it moves.

Nearest means by the angle a of the rotation d that is left between the orientation wanted
and the one reached. At the nearest one the gradient of a^2 / 2 along the configurations
vanishes: G^T d + J^T m = 0, with J v' = 0 the velocity equations, w = G v' the angular
velocity of the output link and m multipliers of the loops. With as many freedoms as the
orientation has, or where the mechanism can follow, d and m are 0. Differentiated once and
twice by the angle turned through, the condition gives exact rates.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import final

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.conventions import CLOSURE_TOLERANCE, Status
from spherekit.motion.closure import Closure, NewtonSteps, newton
from spherekit.motion.loops import Linearisation, left_inverse
from spherekit.motion.steps import Verification, follow_paths
from spherekit.numeric.zeros import hermite
from spherekit.sphere.rotation import (
    LogRate,
    all_finite,
    cross,
    max_abs,
    rotation,
    rotation_vector,
    transpose,
)

DEPARTED = 1e-10
"""A mechanism that is further from the orientation wanted (rad) has departed from it."""


@final
@dataclass(frozen=True)
class Target:
    """An output link, number `link`, of a mechanism with `freedoms`, and its closure."""

    closure: Closure
    link: int
    freedoms: int

    @property
    def reach(self) -> Floats:
        """(variables,) sense in which the way to the output link uses each variable."""
        return np.asarray(self.closure.tree.paths[self.link])

    def at(self, values: Floats, wanted: Floats) -> "Optimality":
        """Return n configurations (n, variables) beside orientations (n, 3, 3)."""
        at = self.closure.at(values)
        left = rotation_vector(wanted @ transpose(at.placed[:, self.link]))
        turning = self.reach[None, None, :] * np.swapaxes(at.vectors, 1, 2)
        return Optimality(self, at, turning, left)


@final
@dataclass(frozen=True)
class Optimality:
    """n configurations, and how far they are from being the nearest ones.

    `turning` G (n, 3, variables); `left` d (n, 3) rad.
    """

    target: Target
    at: Linearisation
    turning: Floats
    left: Floats

    @property
    def values(self) -> Floats:
        """The variables (n, variables)."""
        return self.at.values

    @property
    def reached(self) -> Floats:
        """Orientations (n, 3, 3) of the output link."""
        return np.asarray(self.at.placed[:, self.target.link])

    @cached_property
    def _split(self) -> tuple[Floats, Floats, Floats]:
        """The pseudo-inverse of J with its known rank, its null space, its flatness."""
        n, rows, count = self.at.jacobian.shape
        if rows == 0:
            return np.zeros((n, count, 0)), np.tile(np.eye(count), (n, 1, 1)), np.ones(n)
        rank = count - self.target.freedoms
        left, sizes, right = np.linalg.svd(self.at.jacobian)
        kept = sizes[:, :rank]
        with np.errstate(divide="ignore"):
            inverse = np.swapaxes(right[:, :rank], 1, 2) / kept[:, None, :]
        inverse = np.einsum("nvr,nmr->nvm", inverse, left[:, :, :rank])
        return inverse, np.swapaxes(right[:, rank:], 1, 2), kept[:, -1] / kept[:, 0]

    @property
    def free(self) -> Floats:
        """Orthonormal motions (n, variables, freedoms) that keep the loops closed."""
        return self._split[1]

    @property
    def loop_conditioning(self) -> Floats:
        """(n,) relative size of the weakest loop equation; 0 where a motion comes free."""
        return self._split[2]

    @cached_property
    def swing(self) -> Floats:
        """Angular velocities (n, 3, freedoms) of the output link by the free motions."""
        return self.turning @ self.free

    @cached_property
    def output_singular_value(self) -> Floats:
        """(n,) least size of an angular velocity by a free motion of unit length."""
        sizes = np.linalg.svd(self.swing, compute_uv=False)
        return np.asarray(sizes[:, self.target.freedoms - 1])

    @cached_property
    def system(self) -> Floats:
        """J above G, (n, 3 loops + 3, variables): of full rank where motions are seen."""
        return np.concatenate([self.at.jacobian, self.turning], axis=1)

    @cached_property
    def _pseudo_inverse(self) -> Floats:
        return np.asarray(np.linalg.pinv(np.nan_to_num(self.system), rcond=1e-14))

    @cached_property
    def _pulls(self) -> Floats:
        """Vectors f (n, variables, 3): the gradient by each variable is vector . f."""
        inverse, _, _ = self._split
        slope = np.einsum("nkv,nk->nv", self.turning, self.left)
        return self._combined(self.left, -np.einsum("nvm,nv->nm", inverse, slope))

    def _combined(self, at_output: Floats, at_loops: Floats) -> Floats:
        """Return what rotations (n, 3) and multipliers (n, 3 loops) pull at variables."""
        tree = self.target.closure.tree
        loops = at_loops.reshape(len(at_loops), len(tree.chords), 3)
        pulled = np.einsum("lv,nlk->nvk", tree.signs, loops)
        return np.asarray(pulled + self.target.reach[:, None] * at_output[:, None])

    def _turned(self, rates: Floats) -> Floats:
        """Return how vectors change, (n, variables, 3), at rates (n, variables)."""
        return self.at.turned(self.at.body_rates(rates)).vectors

    def _turned_twice(self, rates: Floats, turned: Floats) -> Floats:
        """Return the second derivatives (n, variables, 3) of vectors at constant rates.

        NaN for contact pairs, whose profiles would be needed to one more derivative.
        """
        tree = self.at.tree
        first = self.at.body_rates(rates)[:, tree.firsts]
        change = tree.body_rates(turned, rates)[:, tree.firsts]
        out = np.full_like(turned, np.nan)
        for v, pair in enumerate(self.target.closure.tree.owners):
            if self.target.closure.joints[pair].has_axis:
                out[:, v] = cross(change[:, pair], self.at.vectors[:, v])
                out[:, v] += cross(first[:, pair], turned[:, v])
        return out

    @property
    def _departs(self) -> bool:
        return bool(np.any(np.linalg.norm(self.left, axis=1) > DEPARTED))

    @cached_property
    def _curved(self) -> Floats:
        """How the gradient by the free motions bends with them, (n, freedoms, freedoms)."""
        if not self._departs:
            return np.zeros((len(self.values), *2 * (self.free.shape[2],)))
        columns = [
            np.einsum("nvk,nvk->nv", self._turned(self.free[:, :, j]), self._pulls)
            for j in range(self.free.shape[2])
        ]
        return np.asarray(np.swapaxes(self.free, 1, 2) @ np.stack(columns, axis=2))

    @cached_property
    def stiffness(self) -> Floats:
        """Second derivative (n, freedoms, freedoms) of a^2 / 2 along configurations."""
        log = LogRate(self.left, -1.0)
        turned = [log.of(self.swing[:, :, j]) for j in range(self.swing.shape[2])]
        return np.asarray(
            np.swapaxes(self.swing, 1, 2) @ np.stack(turned, axis=2) - self._curved
        )

    @cached_property
    def least_eigenvalue(self) -> Floats:
        """(n,) least second derivative of a^2 / 2 along configurations; -1 if unknown."""
        stiffness = 0.5 * (self.stiffness + np.swapaxes(self.stiffness, 1, 2))
        finite = all_finite(stiffness, (1, 2))
        least = np.full(len(stiffness), -1.0)
        least[finite] = np.linalg.eigvalsh(stiffness[finite])[:, 0]
        return least

    def step(self) -> Floats:
        """Return the change (n, variables) of Newton's method towards the nearest one.

        Where a^2 / 2 is not convex the curvature is left out, which always descends.
        """
        inverse, free, _ = self._split
        closing = -np.einsum("nvm,nm->nv", inverse, self.at.residual)
        turned = np.einsum("nkv,nv->nk", self.turning, closing)
        left = self.left - LogRate(self.left, -1.0).of(turned)
        pull = np.einsum("nkj,nk->nj", self.swing, left)
        if self._departs:
            force = np.einsum("nvk,nvk->nv", self._turned(closing), self._pulls)
            pull += np.einsum("nvj,nv->nj", free, force)
        plain = np.swapaxes(self.swing, 1, 2) @ self.swing
        convex = self.least_eigenvalue > 1e-6 * self.output_singular_value**2
        used = np.where(convex[:, None, None], self.stiffness, plain)
        along = np.einsum("nij,nj->ni", left_inverse(used), pull)
        return np.asarray(np.einsum("nvj,nj->nv", free, along) + closing)

    def exact_step(self) -> Floats:
        """Return the change (n, variables) of Newton's method where the link can follow.

        The orientation is one more equation then, which also holds the links where the
        loops alone do not.
        """
        right = np.concatenate([-self.at.residual, self.left], axis=1)
        return np.asarray(np.einsum("nvm,nm->nv", self._pseudo_inverse, right))

    def miss(self, exact: bool) -> Floats:
        """Return by how much (n,) loops are open, and how far off the link is (rad).

        As the gradient of a^2 / 2, or with `exact` as the rotation left.
        """
        if exact:
            both = np.concatenate([self.at.residual, self.left], axis=1)
            return np.asarray(max_abs(both, axis=1))
        pull = np.einsum("nkj,nk->nj", self.swing, self.left)
        open_by = self.at.gap
        return np.asarray(np.maximum(open_by, max_abs(pull, axis=1)))

    def rates(self, axis: Floats) -> tuple[Floats, Floats, Bools]:
        """Return first and second derivatives (n, variables) by theta.

        As the target turns about an `axis` (3,), a unit vector in the axes of body 0; and
        whether (n,) the output link turns exactly as wanted. The configurations have to be
        nearest ones. Where the link follows exactly, its rotation is one more equation of
        the motion, which also holds where the loops alone do not fix it.
        """
        first, second, misfit = self._exact_rates(axis)
        follows = np.linalg.norm(self.left, axis=1) < DEPARTED
        follows &= misfit < DEPARTED
        if not np.all(follows):
            near, rows = self._nearest_rates(axis), follows[:, None]
            first, second = np.where(rows, first, near[0]), np.where(rows, second, near[1])
        return first, second, follows

    def _exact_rates(self, axis: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the rates if the output link turns about the axis, and by how far not."""
        rows = self.system.shape[1]
        inverse = self._pseudo_inverse
        right = np.zeros((len(self.values), rows))
        right[:, -3:] = axis
        first = np.einsum("nvm,nm->nv", inverse, right)
        left = np.einsum("nmv,nv->nm", self.system, first) - right
        turned = self._turned(first)
        bias = np.zeros_like(right)
        loops = self.target.closure.tree.jacobian(turned)
        bias[:, :-3] = -np.einsum("nij,nj->ni", loops, first)
        bias[:, -3:] = -np.einsum("v,nvk,nv->nk", self.target.reach, turned, first)
        second = np.einsum("nvm,nm->nv", inverse, bias)
        further = np.einsum("nmv,nv->nm", self.system, second) - bias
        size = 1.0 + max_abs(bias, axis=1)
        misfit = max_abs(left, axis=1)
        misfit = np.maximum(misfit, max_abs(further, axis=1) / size)
        return first, second, misfit

    def _nearest_rates(self, axis: Floats) -> tuple[Floats, Floats]:
        """Return the rates of the nearest configurations, from the condition for those."""
        inverse, free, _ = self._split
        log, backward = LogRate(self.left), LogRate(self.left, -1.0)
        tree, reach = self.target.closure.tree, self.target.reach
        about = np.broadcast_to(axis, self.left.shape)
        soft = left_inverse(self.stiffness)

        def along(gradient: Floats) -> Floats:
            motion = np.einsum("nij,nj->ni", soft, gradient)
            return np.asarray(np.einsum("nvj,nj->nv", free, motion))

        def seen(change: Floats) -> Floats:
            return np.asarray(np.einsum("nkj,nk->nj", self.swing, change))

        first = along(seen(log.of(about)))
        turned = self._turned(first)
        w = np.einsum("nkv,nv->nk", self.turning, first)
        left_rate = log.of(about) - backward.of(w)
        pulls = self._pulls
        slope = np.einsum("nvk,nvk->nv", turned, pulls)
        slope += np.einsum("nkv,nk->nv", self.turning, left_rate)
        pulls_rate = self._combined(left_rate, -np.einsum("nvm,nv->nm", inverse, slope))

        bias = np.einsum("nij,nj->ni", tree.jacobian(turned), first)
        held = -np.einsum("nvm,nm->nv", inverse, bias)
        twice = self._turned_twice(first, turned) + self._turned(held)
        departed = np.linalg.norm(self.left, axis=1) > DEPARTED
        twice[~departed] = 0.0
        force = np.einsum("nvk,nvk->nv", twice, pulls)
        force += 2.0 * np.einsum("nvk,nvk->nv", turned, pulls_rate)
        w_bias = np.einsum("nkv,nv->nk", self.turning, held)
        w_bias += np.einsum("v,nvk,nv->nk", reach, turned, first)
        left_bias = log.changed(left_rate, about) - backward.changed(left_rate, w)
        left_bias -= backward.of(w_bias)
        second = held + along(np.einsum("nvj,nv->nj", free, force) + seen(left_bias))
        return first, second


LARGEST_STEP = 0.2
"""Longest step (rad of theta)."""
FIRST_STEP = 0.05
SMALLEST_STEP = 1e-9
MOST_NODES = 5000
BEND = 0.05
"""Second-order part (rad) of a step that is aimed at."""
NEARER, SHORT = 0.3, 0.02
"""Part of slope / bend stepped at most, if that is short: 0.6 of the way to a limit of the
reach, where variables go as the square root of the way left."""
VERIFIED = Verification()
"""The change of the equations is that of their eigenvalues."""
CORRECTIONS = 8
LARGEST_CHANGE = 0.5
"""Largest change of a variable (rad) in one step of Newton's method."""
SETTLED = 1e-14
"""A Newton step (rad) below this is rounding; near crossings torques magnify the rest."""
STATIONARY = 1e-11
"""How well (rad) a configuration has to be the nearest one."""
LEAPS = (0.004, 0.01, 0.02, 0.04)
"""Ways (rad of theta) tried over a singular configuration."""
LEAP_FROM = 2e-3
"""Steps that have become shorter than this are tried as leaps."""
SMOOTH = 1e-7
"""The Hermite polynomial of a leap has to agree with configurations in it to this."""
SINGULAR = 0.01
"""Where links are held less firmly than this part of how they are beside, on a leap."""
UNFIXED = 1e-7
"""Equations of this reciprocal condition do not fix the links."""
STRETCHED = 1e-3
"""How near the last node is to a limit of the output's reach, to name it as the reason."""


ZOOM = 16
"""Parts into which an interval is cut that holds a minimum."""
NARROW = 1e-14
"""How narrow (rad) it becomes."""


def least_about(
    function: Callable[[Floats], Floats],
    places: Floats,
    width: float,
    span: tuple[float, float],
) -> Floats:
    """Return where a function is least about places (n,), in intervals cut again and again.

    `width` (rad) is half that of the first, `span` what none leaves.
    """
    while len(places) and width > NARROW:
        grid = places[:, None] + width * np.linspace(-1.0, 1.0, ZOOM + 1)
        grid = np.clip(grid, *span)
        values = np.nan_to_num(function(grid.ravel()), nan=np.inf).reshape(grid.shape)
        places = grid[np.arange(len(grid)), np.argmin(values, axis=1)]
        width *= 2.0 / ZOOM
    return places


@final
@dataclass(frozen=True)
class Node:
    """A configuration on the way with its derivatives by theta, one row each."""

    theta: float
    near: Optimality
    first: Floats
    second: Floats
    follows: bool

    @property
    def values(self) -> Floats:
        """(variables,) of the configuration."""
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
@dataclass
class March:
    """The way from a node about `axis` (3,) by `angle` (rad).

    `exact` says that the output link of the target can follow. `nodes` are what was
    reached, `end` is the status of what lies beyond, `leaps` are the angles of singular
    places that were stepped over.
    """

    target: Target
    axis: Floats
    angle: float
    exact: bool
    nodes: list[Node]
    leaps: list[float] = field(default_factory=list, init=False)
    end: Status = field(default=Status.OK, init=False)
    leapt: float = field(default=-np.inf, init=False)

    def __post_init__(self) -> None:
        follow_paths(self, np.array([FIRST_STEP]))

    @property
    def start(self) -> Floats:
        """The orientation (3, 3) from where the angle counts."""
        first = self.nodes[0]
        back = rotation(self.axis, [-first.theta])[0]
        return np.asarray(back @ first.near.reached[0])

    @property
    def going(self) -> Indices:
        """Number 0, until the way ends."""
        arrived = self.nodes[-1].theta >= self.angle
        if not arrived and len(self.nodes) >= MOST_NODES:
            self.end = Status.MODE_LOST
        return np.arange(0 if arrived or self.end != Status.OK else 1)

    def allowed(self, rows: Indices, step: Floats) -> Floats:
        """Return the step that the bend of the way allows."""
        at = self.nodes[-1]
        bend = float(max_abs(np.nan_to_num(at.second))) + 1e-300
        step = np.minimum(step, min(LARGEST_STEP, np.sqrt(2.0 * BEND / bend)))
        nearer = NEARER * float(max_abs(at.first)) / bend
        return np.minimum(step, nearer) if nearer < SHORT else step

    def advance(self, rows: Indices, step: Floats) -> Floats:
        """Go on by a step, or by a leap over a singular configuration."""
        at, length = self.nodes[-1], float(step[0])
        if length < SMALLEST_STEP:
            return np.zeros(1)
        goal = min(at.theta + length, self.angle)
        if self.angle - goal < SMALLEST_STEP:
            goal = self.angle
        made, growth = self._advance(at, goal), 2.0
        if made is None and length < LEAP_FROM and at.theta > self.leapt + LEAP_FROM:
            self.leapt = at.theta
            leap = self._leap(at)
            if leap is not None:
                made, place = leap
                self.leaps.append(place)
                self.leapt, growth = made.theta, 2.0 * (made.theta - at.theta) / length
        if made is None:
            return np.zeros(1)
        self.nodes.append(made)
        return np.array([growth])

    def smallest(self, rows: Indices) -> Floats:
        """Return the step at which the way ends."""
        return np.full(len(rows), SMALLEST_STEP)

    def stop(self, row: int) -> None:
        """End the way at its last node."""
        self.end = self._why(self.nodes[-1])

    def _nodes(self, theta: Floats, guess: Floats) -> tuple[list[Node], NewtonSteps]:
        wanted = rotation(self.axis, theta) @ self.start
        near, steps = corrected(self.target, guess, wanted, self.exact)
        first, second, follows = near.rates(self.axis)
        made = []
        for row, angle in enumerate(theta):
            one = self.target.at(near.values[row : row + 1], wanted[row : row + 1])
            made.append(
                Node(float(angle), one, first[row], second[row], bool(follows[row]))
            )
        return made, steps

    def _advance(self, at: Node, goal: float) -> Node | None:
        """Return the node at an angle if the way there passes all tests."""
        step = goal - at.theta
        guess = at.taylor(np.array([0.5, 1.0]) * step)
        if not all_finite(guess):
            return None
        (middle, node), steps = self._nodes(np.array([at.theta + 0.5 * step, goal]), guess)
        moved = float(max_abs(node.values - at.values))
        if not np.all(VERIFIED.corrected(steps.first, steps.ratio, moved)):
            return None
        for reached in (middle, node):
            if not self._holds(reached) or reached.follows != at.follows:
                return None
            if at.follows:
                change = at.inverse @ (reached.near.system[0] - at.near.system[0])
                if not np.all(VERIFIED.regular(np.abs(np.linalg.eigvals(change)))):
                    return None
            elif (
                not min(reached.near.least_eigenvalue[0], reached.near.loop_conditioning[0])
                > UNFIXED
            ):
                return None
        there = self._between(at, node, np.array([middle.theta]))
        off = max_abs(there - middle.values)
        return node if VERIFIED.predicted(off, moved, CLOSURE_TOLERANCE) else None

    def _holds(self, node: Node) -> bool:
        finite = all_finite(node.first)
        return bool(finite and node.near.miss(self.exact)[0] < STATIONARY)

    @staticmethod
    def _between(at: Node, node: Node, theta: Floats) -> Floats:
        """Return the variables (n, variables) at angles (n,) between two nodes."""
        h = node.theta - at.theta
        ends = [(n.values[None], n.first[None], n.second[None]) for n in (at, node)]
        return hermite(ends[0], ends[1], np.array([h]), (theta - at.theta) / h)

    def _leap(self, at: Node) -> tuple[Node, float] | None:
        """Return a node beyond a singular configuration, and the angle of that.

        None if there is none near, or the way does not go on smoothly.
        """
        for way in LEAPS:
            goal = at.theta + way
            if self.angle < goal and at.theta < self.angle - LEAP_FROM:
                return None
            (node,), steps = self._nodes(np.array([goal]), at.taylor(np.array([way])))
            moved = float(max_abs(node.values - at.values))
            if not self._holds(node) or steps.first[0] > VERIFIED.correction * moved:
                continue
            if not node.condition > LEAP_FROM * way:
                continue
            places = at.theta + way * np.array([0.2, 0.4, 0.6, 0.8])
            guess = self._between(at, node, places)
            inner, _ = self._nodes(places, guess)
            off = [
                max_abs(inner_node.values - one)
                for inner_node, one in zip(inner, guess, strict=True)
                if inner_node.condition > 100.0 * UNFIXED
            ]
            if len(off) < 2 or max(off) > SMOOTH or not all(map(self._holds, inner)):
                continue

            def hold(theta: Floats, node: Node = node) -> Floats:
                """Return how firmly (n,) the equations fix the links on the way."""
                values = self._between(at, node, theta)
                system = self.target.at(values, np.eye(3)[None]).system
                return np.asarray(np.linalg.svd(system, compute_uv=False)[:, -1])

            span = at.theta, goal
            place = least_about(hold, np.array([at.theta + 0.5 * way]), 0.5 * way, span)
            if hold(place)[0] < SINGULAR * np.min(hold(np.array(span))):
                return node, float(place[0])
        return None

    def _why(self, at: Node) -> Status:
        """Return the status of what lies beyond a node that no step leaves."""
        if not at.follows or at.near.output_singular_value[0] < STRETCHED:
            return Status.OUT_OF_REACH
        return Status.AT_SINGULARITY if at.condition < STRETCHED else Status.MODE_LOST


def corrected(
    target: Target, values: Floats, wanted: Floats, exact: bool
) -> tuple[Optimality, NewtonSteps]:
    """Return the nearest configurations by Newton's method from values (n, variables).

    `exact` says that the output link can follow.
    """

    def change(some: Floats, rows: Indices) -> Floats:
        near = target.at(some, wanted[rows])
        return np.nan_to_num(near.exact_step() if exact else near.step())

    values, steps = newton(change, values, CORRECTIONS, SETTLED, LARGEST_CHANGE)
    near = target.at(values, wanted)
    return near, steps
