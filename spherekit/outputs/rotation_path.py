"""Verified steps along a rotation of an output link about a fixed axis.

From a closed configuration the orientation wanted turns about the axis, and the
configuration nearest to it is followed in steps that are verified as
`spherekit.positions.path_continuation` says, with exact first and second derivatives. Where
the loops do not fix the links at one configuration on the way, that is stepped over at
once, if the polynomials on both sides of it agree.

The configuration whose output link is nearest to an orientation, and how it moves.

Nearest means by the angle a of the rotation d that is left between the orientation wanted
and the one reached. At the nearest one the gradient of a^2 / 2 along the configurations
vanishes: G^T d + J^T m = 0, with J v' = 0 the velocity equations, w = G v' the angular
velocity of the output link and m multipliers of the loops. With as many freedoms as the
orientation has, or where the mechanism can follow, d and m are 0. Differentiated once and
twice by the angle turned through, the condition gives exact rates.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.geometry.mirror import rotation_vector
from spherekit.geometry.rotation import (
    all_finite,
    cross,
    log_rate,
    log_rate_change,
    max_abs,
    transpose,
)
from spherekit.geometry.tilt_torsion import rotation
from spherekit.mechanism.elements import Output
from spherekit.mechanism.joint_construction import make_joints
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.array_rows import ArrayRows
from spherekit.numerics.hermite import quintic_hermite
from spherekit.numerics.minima import minimize_in_brackets
from spherekit.positions.linear_equations import left_inverse
from spherekit.positions.linearisation import Linearisation
from spherekit.positions.loop_closure import Closure, newton
from spherekit.positions.path_continuation import STEP_PARTS, Verification
from spherekit.status import Status
from spherekit.tolerances import CLOSURE_TOLERANCE

DEPARTED = 1e-10
"""A mechanism that is further from the orientation wanted (rad) has departed from it."""


@dataclass(frozen=True)
class OutputTarget:
    """An output link, number `link`, of a mechanism with `freedoms`, and its closure."""

    closure: Closure
    link: int
    freedoms: int

    @staticmethod
    def of(mechanism: Mechanism, output: Output) -> "OutputTarget":
        """Return the target of an output, body 0 the link that it is relative to."""
        made = replace(mechanism, ground=output.relative_to)
        link, freedoms = made.link_number[output.link], len(made.inputs)
        return OutputTarget(Closure.of(made, make_joints(made)), link, freedoms)

    def at(self, values: Floats, wanted: Floats) -> "Optimality":
        """Return n configurations (n, variables) beside orientations (n, 3, 3)."""
        at = self.closure.at(values)
        left = rotation_vector(wanted @ transpose(at.placed[:, self.link]))
        turning = self.closure.tree.paths[self.link] * np.swapaxes(at.vectors, 1, 2)
        return Optimality(self, at, turning, left)


@dataclass(frozen=True)
class Optimality:
    """n configurations, and how far they are from being the nearest ones.

    `turning` G (n, 3, variables); `left` d (n, 3) rad.
    """

    target: OutputTarget
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
        return self.at.placed[:, self.target.link]

    @cached_property
    def _split(self) -> tuple[Floats, Floats, Floats]:
        """The pseudo-inverse of J with its known rank, its null space, its flatness."""
        rank = self.values.shape[1] - self.target.freedoms
        left, sizes, right = np.linalg.svd(self.at.jacobian)
        kept = sizes[:, :rank]
        with np.errstate(all="ignore"):
            inverse = transpose(right[:, :rank]) / kept[:, None] @ transpose(left)[:, :rank]
            flatness = np.min(kept / kept[:, :1], axis=1, initial=1.0)
        return inverse, transpose(right[:, rank:]), flatness

    @property
    def loop_conditioning(self) -> Floats:
        """(n,) relative size of the weakest loop equation; 0 where a motion comes free."""
        return self._split[2]

    @cached_property
    def swing(self) -> Floats:
        """Angular velocities (n, 3, freedoms) of the output link by the free motions."""
        return self.turning @ self._split[1]

    @cached_property
    def output_singular_value(self) -> Floats:
        """(n,) least size of an angular velocity by a free motion of unit length."""
        return np.asarray(np.linalg.svd(self.swing, compute_uv=False)[:, -1])

    @cached_property
    def system(self) -> Floats:
        """J above G, (n, 3 loops + 3, variables): of full rank where motions are seen."""
        return np.concatenate([self.at.jacobian, self.turning], axis=1)

    @cached_property
    def system_inverse(self) -> Floats:
        """(n, variables, 3 loops + 3) the pseudo-inverse of the system."""
        return np.linalg.pinv(np.nan_to_num(self.system), rcond=1e-14)

    @cached_property
    def _departed(self) -> Bools:
        return np.linalg.norm(self.left, axis=1) > DEPARTED

    @cached_property
    def _pulls(self) -> Floats:
        """Vectors f (n, variables, 3): the gradient by each variable is vector . f.

        Zero where the link is as wanted.
        """
        pulls = self._combined(self.left, np.vecmat(self.left, self.turning))
        return np.where(self._departed[:, None, None], pulls, 0.0)

    def _combined(self, at_output: Floats, slope: Floats) -> Floats:
        """Return how rotations (n, 3), and loops that hold a slope, pull at variables.

        Vectors (n, variables, 3); the slope is (n, variables).
        """
        tree = self.at.tree
        at_loops = -np.vecmat(slope, self._split[0])
        at_loops = at_loops.reshape(len(slope), len(tree.chords), 3)
        at_link = tree.paths[self.target.link][:, None] * at_output[:, None]
        return transpose(tree.signs) @ at_loops + at_link

    def _turned(self, rates: Floats) -> Floats:
        """Return how vectors change, (n, variables, 3), at rates (n, variables)."""
        return self.at.turned(self.at.body_rates(rates))

    def _turned_twice(self, rates: Floats, turned: Floats) -> Floats:
        """Return the second derivatives (n, variables, 3) of vectors at constant rates.

        NaN for contact pairs, whose profiles would be needed to one more derivative; zero
        where the link is as wanted, and they do not matter.
        """
        tree = self.at.tree
        firsts = tree.firsts[list(tree.owners)]
        out = cross(tree.body_rates(turned, rates)[:, firsts], self.at.vectors)
        out += cross(self.at.body_rates(rates)[:, firsts], turned)
        out[:, [not self.at.joints[pair].has_axis for pair in tree.owners]] = np.nan
        out[~self._departed] = 0.0
        return out

    def _stiff(self, motion: Floats) -> Floats:
        """Return how the gradient of a^2 / 2 changes with motions (n, variables)."""
        back = log_rate(-self.left, np.matvec(self.turning, motion))
        pulled = np.vecdot(self._turned(motion), self._pulls)
        return np.vecmat(back, self.turning) - pulled

    @cached_property
    def stiffness(self) -> Floats:
        """Second derivative (n, freedoms, freedoms) of a^2 / 2 along configurations."""
        free = self._split[1]
        bent = [self._stiff(motion) for motion in np.moveaxis(free, 2, 0)]
        return transpose(free) @ np.stack(bent, axis=2)

    @cached_property
    def least_eigenvalue(self) -> Floats:
        """(n,) least second derivative of a^2 / 2 along configurations; -1 if unknown."""
        stiffness = 0.5 * (self.stiffness + transpose(self.stiffness))
        finite = all_finite(stiffness, (1, 2))
        least = np.full(len(stiffness), -1.0)
        least[finite] = np.linalg.eigvalsh(stiffness[finite])[:, 0]
        return least

    def _balanced(self, pull: Floats, gaps: Floats, stiffness: Floats) -> Floats:
        """Return the motion (n, variables) that makes up for a pull and for gaps.

        Of the pull (n, variables) what lies along configurations, by a stiffness of those.
        """
        inverse, free, _ = self._split
        held = np.matvec(inverse, gaps)
        along = np.matvec(
            left_inverse(stiffness), np.vecmat(pull - self._stiff(held), free)
        )
        return held + np.matvec(free, along)

    def step(self, exact: bool) -> Floats:
        """Return the change (n, variables) of Newton's method towards the nearest one.

        Where a^2 / 2 is not convex the curvature is left out, which always descends. Where
        the link can follow, `exact`, the orientation is one more equation, which also holds
        the links where the loops alone do not.
        """
        if exact:
            right = np.concatenate([-self.at.residual, self.left], axis=1)
            return np.matvec(self.system_inverse, right)
        plain = transpose(self.swing) @ self.swing
        convex = self.least_eigenvalue > 1e-6 * self.output_singular_value**2
        used = np.where(convex[:, None, None], self.stiffness, plain)
        return self._balanced(np.vecmat(self.left, self.turning), -self.at.residual, used)

    def miss(self, exact: bool) -> Floats:
        """Return by how much (n,) loops are open, and how far off the link is (rad).

        As the gradient of a^2 / 2, or with `exact` as the rotation left.
        """
        off = self.left if exact else np.vecmat(self.left, self.swing)
        return np.maximum(self.at.gap, max_abs(off, axis=1))

    def rates(self, axis: Floats) -> tuple[Floats, Floats, Bools]:
        """Return first and second derivatives (n, variables) by theta.

        As the target turns about an `axis` (3,), a unit vector in the axes of body 0; and
        whether (n,) the output link turns exactly as wanted. The configurations have to be
        nearest ones. Where the link follows exactly, its rotation is one more equation of
        the motion, which also holds where the loops alone do not fix it.
        """
        right = np.zeros(self.system.shape[:2])
        right[:, -3:] = axis
        first = np.matvec(self.system_inverse, right)
        off = np.matvec(self.system, first) - right
        bias = -np.concatenate(self._biases(first, self._turned(first)), axis=1)
        second = np.matvec(self.system_inverse, bias)
        further = np.matvec(self.system, second) - bias
        further /= 1.0 + max_abs(bias, axis=1)[:, None]
        misfit = max_abs(np.hstack([off, further]), axis=1)
        follows = ~self._departed & (misfit < DEPARTED)
        if not np.all(follows):
            near = self._nearest_rates(axis)
            first, second = np.where(follows[:, None], (first, second), near)
        return first, second, follows

    def _biases(self, rates: Floats, turned: Floats) -> tuple[Floats, Floats]:
        """Return J' rates (n, 3 loops) and G' rates (n, 3) as vectors change."""
        loops = np.matvec(self.at.tree.jacobian(turned), rates)
        return loops, self.at.tree.body_rates(turned, rates)[:, self.target.link]

    def _nearest_rates(self, axis: Floats) -> tuple[Floats, Floats]:
        """Return the rates of the nearest configurations, from the condition for those."""
        left, log = self.left, log_rate(self.left, axis)
        ahead = np.vecmat(log, self.turning)
        first = self._balanced(ahead, np.zeros_like(self.at.residual), self.stiffness)
        turned = self._turned(first)
        w = np.matvec(self.turning, first)
        left_rate = log - log_rate(-left, w)
        slope = np.vecdot(turned, self._pulls) + np.vecmat(left_rate, self.turning)
        pulls_rate = self._combined(left_rate, slope)
        loops, swung = self._biases(first, turned)
        left_bias = log_rate_change(left, left_rate, axis)
        left_bias -= log_rate_change(-left, -left_rate, w)
        pull = np.vecdot(self._turned_twice(first, turned), self._pulls)
        pull += np.vecmat(left_bias - log_rate(-left, swung), self.turning)
        pull += 2.0 * np.vecdot(turned, pulls_rate)
        return first, self._balanced(pull, -loops, self.stiffness)


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


@dataclass(frozen=True)
class Nodes(ArrayRows):
    """n configurations on a way, with their derivatives by theta.

    Attributes
    ----------
    theta, values, first, second
        (n,) rad; (n, variables) the variables and their derivatives.
    follows, holds
        (n,) whether the link turns exactly as wanted; whether the configuration is the
        nearest one, its derivatives finite.
    system, condition
        (n, 3 loops + 3, variables) the equations, (n,) their reciprocal condition.
    firmness, reach
        (n,) how firmly the nearest configuration is held, and how far the link is from a
        limit of its reach.
    """

    theta: Floats
    values: Floats
    first: Floats
    second: Floats
    follows: Bools
    holds: Bools
    system: Floats
    condition: Floats
    firmness: Floats
    reach: Floats

    def ahead(self, way: Floats) -> Floats:
        """Return the variables (n, variables) at ways (n,) from the only node."""
        way = way[:, None]
        return self.values + way * self.first + 0.5 * way**2 * np.nan_to_num(self.second)

    def between(self, theta: Floats) -> tuple[Floats, Floats]:
        """Return the variables (n, variables) at angles (n,) between nodes.

        With how far (n,) the nodes are apart, in theta or a variable.
        """
        if len(self.theta) == 1:
            return np.repeat(self.values, len(theta), axis=0), np.zeros(len(theta))
        cell = np.clip(np.searchsorted(self.theta, theta) - 1, 0, len(self.theta) - 2)
        start, stop = (
            (self.values[c], self.first[c], self.second[c]) for c in (cell, cell + 1)
        )
        h = np.diff(self.theta)[cell]
        made = quintic_hermite(start, stop, h, (theta - self.theta[cell]) / h)
        return made, np.maximum(h, max_abs(stop[0] - start[0], axis=1))


@dataclass(frozen=True)
class Way:
    """The configurations nearest to orientations that turn about a fixed axis.

    `axis` (3,) is a unit vector, `start` (3, 3) the orientation at theta = 0, both in the
    axes of body 0; `exact` says that the output link can follow.
    """

    target: OutputTarget
    axis: Floats
    start: Floats
    exact: bool

    def wanted(self, theta: Floats) -> Floats:
        """Return the orientations (n, 3, 3) wanted at angles (n,) rad."""
        return rotation(self.axis, theta) @ self.start

    def near(self, theta: Floats, guess: Floats) -> tuple[Optimality, Floats]:
        """Return the nearest configurations by Newton's method from (n, variables)."""
        wanted = self.wanted(theta)

        def change(some: Floats, rows: Indices) -> Floats:
            return np.nan_to_num(self.target.at(some, wanted[rows]).step(self.exact))

        values, steps = newton(change, guess, CORRECTIONS, SETTLED, LARGEST_CHANGE)
        return self.target.at(values, wanted), steps

    def nodes_of(self, theta: Floats, near: Optimality) -> Nodes:
        """Return the nodes at angles (n,) with their nearest configurations."""
        first, second, follows = near.rates(self.axis)
        sizes = [np.linalg.norm(x, axis=(1, 2)) for x in (near.system, near.system_inverse)]
        return Nodes(
            theta,
            near.values,
            first,
            second,
            follows,
            all_finite(first, 1) & (near.miss(self.exact) < STATIONARY),
            near.system,
            1.0 / (sizes[0] * sizes[1]),
            np.minimum(near.least_eigenvalue, near.loop_conditioning),
            near.output_singular_value,
        )

    def _nodes(self, theta: Floats, guess: Floats) -> tuple[Nodes, Floats]:
        near, steps = self.near(theta, guess)
        return self.nodes_of(theta, near), steps

    def step(self, at: Nodes, goal: float) -> Nodes | None:
        """Return the node at an angle if the way there from a node passes all tests."""
        parts = STEP_PARTS * (goal - at.theta)
        guess = at.ahead(parts)
        if not all_finite(guess):
            return None
        made, steps = self._nodes(np.append(at.theta + parts[:1], goal), guess)
        middle, node = made.rows(slice(0, 1)), made.rows(slice(1, 2))
        moved = max_abs(node.values - at.values)
        good = VERIFIED.corrected(steps, moved) & made.holds
        if not np.all(good & (made.follows == at.follows)):
            return None
        if at.follows[0]:
            change = np.linalg.pinv(at.system[0]) @ (made.system - at.system)
            firm = VERIFIED.regular(np.abs(np.linalg.eigvals(change)))
        else:
            firm = made.firmness > UNFIXED
        there, _ = Nodes.joined([at, node]).between(middle.theta)
        off = max_abs(there - middle.values)
        fine = VERIFIED.predicted(off, moved, CLOSURE_TOLERANCE) and np.all(firm)
        return node if fine else None

    def leap(self, at: Nodes, end: float) -> tuple[Nodes, float] | None:
        """Return a node beyond a singular configuration, and the angle of that.

        None if there is none near, or the way to the angle `end` does not go on smoothly.
        """
        for way in LEAPS:
            goal = at.theta + way
            if end < goal and at.theta < end - LEAP_FROM:
                return None
            node, steps = self._nodes(goal, at.ahead(np.array([way])))
            moved = max_abs(node.values - at.values)
            steady = node.holds[0] and node.condition[0] > LEAP_FROM * way
            if not steady or steps[0, 0] > VERIFIED.correction * moved:
                continue
            places = at.theta + way * np.arange(0.2, 0.9, 0.2)
            both = Nodes.joined([at, node])
            guess, _ = both.between(places)
            inner, _ = self._nodes(places, guess)
            off = max_abs(inner.values - guess, axis=1)[inner.condition > 100.0 * UNFIXED]
            if len(off) < 2 or np.max(off) > SMOOTH or not np.all(inner.holds):
                continue

            def hold(theta: Floats, both: Nodes = both) -> Floats:
                """Return how firmly (n,) the equations fix the links on the way."""
                system = self.target.at(both.between(theta)[0], np.eye(3)[None]).system
                return np.asarray(np.linalg.svd(system, compute_uv=False)[:, -1])

            place = minimize_in_brackets(hold, at.theta, goal)
            if hold(place)[0] < SINGULAR * np.min(hold(both.theta)):
                return node, float(place[0])
        return None

    def follow(self, first: Nodes, end: float) -> tuple[Nodes, Status, tuple[float, ...]]:
        """Return the nodes from the first on to an angle, or as far as steps hold.

        With the status of what lies beyond, and the angles of singular configurations that
        were stepped over.
        """
        nodes, step, leaps, leapt = [first], FIRST_STEP, list[float](), -np.inf
        why = Status.OK
        while (theta := float(nodes[-1].theta[0])) < end:
            at = nodes[-1]
            step = min(step, _longest(at))
            if len(nodes) >= MOST_NODES or step < SMALLEST_STEP:
                why = Status.MODE_LOST if len(nodes) >= MOST_NODES else _why(at)
                break
            goal = end if end - theta - step < SMALLEST_STEP else theta + step
            made = self.step(at, goal)
            if made is None and step < LEAP_FROM and theta > leapt + LEAP_FROM:
                leapt, leap = theta, self.leap(at, end)
                if leap is not None:
                    made, place = leap
                    leaps.append(place)
                    leapt = float(made.theta[0])
                    step = leapt - theta
            if made is not None:
                nodes.append(made)
            step *= 0.5 if made is None else 2.0
        return Nodes.joined(nodes), why, tuple(leaps)


def _longest(at: Nodes) -> float:
    """Return the step that the bend of the way allows."""
    bend: float = max_abs(np.nan_to_num(at.second)) + 1e-300
    nearer: float = NEARER * max_abs(at.first) / bend
    step = min(LARGEST_STEP, (2.0 * BEND / bend) ** 0.5)
    return min(step, nearer) if nearer < SHORT else step


def _why(at: Nodes) -> Status:
    """Return the status of what lies beyond a node that no step leaves."""
    if not at.follows[0] or at.reach[0] < STRETCHED:
        return Status.OUT_OF_REACH
    return Status.AT_SINGULARITY if at.condition[0] < STRETCHED else Status.MODE_LOST
