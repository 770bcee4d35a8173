"""The sequence of a plan: every pole a product of known ones, every coefficient a ratio.

With two third links k and r a pole lies along (u_ik x u_jk) x (u_ir x u_jr), and
w_k - w_a = x u_ka with one ratio x of such products, as arrays (3, n) and (n,).

Each pole carries a bound of its error, propagated from those of its sources. Of all the
great circles that the plan keeps for a pole, a route takes the best two or the first two.
The best two are the one with the smallest error and then the partner that makes the
intersection most certain.
"""

import numpy as np

from spherekit.arrays import Floats
from spherekit.geometry.vectors import nans, unit_rows
from spherekit.planning.pole_plan import (
    BlockPoles,
    LinePole,
    Plan,
    Pole,
    PrimaryPole,
    pole_of,
)
from spherekit.positions.linear_equations import left_inverse
from spherekit.positions.loop_tree import LoopTree
from spherekit.positions.motion import Motion
from spherekit.tolerances import EPS
from spherekit.velocities.direction_signs import dot, norm
from spherekit.velocities.pole_request import Route, cross


class PlannedPoles:
    """The poles of a plan at the rows of a motion, with any signs of secondary ones.

    `unit[pole]` (3, n) the direction; `error[pole]` (n,) bound of its error (rad).
    """

    def __init__(self, plan: Plan, motion: Motion, route: Route = "best") -> None:
        self.plan, self.motion, self.route = plan, motion, route
        self.unit: dict[Pole, Floats] = {}
        self.error: dict[Pole, Floats] = {}
        self._drawn: dict[Pole, tuple[Floats, Floats]] = {}
        n = len(motion)
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            for step in plan.steps:
                if isinstance(step, PrimaryPole):
                    self.unit[step.pole] = self._of_pair(step.pair)
                    self.error[step.pole] = np.full(n, EPS)
                elif isinstance(step, LinePole):
                    one, other, self.error[step.pole] = self._two_circles(step)
                    self._drawn[step.pole] = one, other
                    self.unit[step.pole] = _unit(cross(one, other))
                else:
                    self._solve(step)

    def _of_pair(self, pair: int) -> Floats:
        return np.ascontiguousarray(self.motion.axes[:, pair].T)

    def _two_circles(self, step: LinePole) -> tuple[Floats, Floats, Floats]:
        """Return the normals of the two great circles of a pole.

        And the bound of where they meet (n,). Of all these are those through pairs of known
        poles, then the contact planes.
        """
        i, j = step.pole
        sources = [(pole_of(i, k), pole_of(j, k)) for k in step.via]
        every = [cross(self.unit[a], self.unit[b]) for a, b in sources]
        every += [self._of_pair(number) for number in step.contacts]
        drawn = [self.error[a] + self.error[b] for a, b in sources]
        drawn += [np.zeros(len(self.motion))] * len(step.contacts)
        count = 2 if self.route == "first" else len(every)
        circles = np.stack(every[:count])
        length, row = norm(circles), np.arange(len(self.motion))
        errors = (np.stack(drawn[:count]) + EPS) / np.maximum(length, EPS)
        # Only two are taken in their order, so that their sense is that of the plan.
        best = np.argmin(errors, axis=0) * (len(errors) > 2)
        first = circles[best, :, row].T
        sine = norm(cross(first, circles))
        sine /= np.maximum(length * length[best, row], EPS * EPS)
        doubt = (errors + errors[best, row]) / np.maximum(sine, EPS)
        doubt[best, row] = np.inf
        partner = np.argmin(doubt, axis=0)
        off = np.minimum(doubt[partner, row], 1.0)
        return first, circles[partner, :, row].T, off

    def _solve(self, step: BlockPoles) -> None:
        """Add the poles of an irreducible part: the null vector of its equations."""
        number = {link: k for k, link in enumerate(step.links)}
        ends = [self.plan.ends[pair] for pair in step.pairs]
        owned = {
            variable: k
            for k, pair in enumerate(step.pairs)
            for variable in self.plan.mechanism.variables_of(pair)
        }
        tree = LoopTree(
            len(step.links),
            tuple((number[a], number[b]) for a, b in ends),
            tuple(owned.values()),
        )
        vectors = self.motion.vectors[:, [*owned]]
        rates, inverse = null_motion(tree, vectors)
        w, growth = tree.body_rates(vectors, rates), np.linalg.norm(inverse, axis=(1, 2))
        for pole in step.poles:
            i, j = (number[link] for link in pole)
            vector = (w[:, j] - w[:, i]).T
            off = EPS * growth / np.maximum(norm(vector), EPS)
            self.unit[pole], self.error[pole] = _unit(vector), np.minimum(off, 1.0)

    def link_rates(self, bodies: tuple[int, ...]) -> tuple[dict[int, Floats], Floats]:
        """Return w (3, n) relative to the ground by body, and a bound (n,) of its error.

        By the vector form of eq. (5) of Di Gregorio 2024, with a and b the links of the
        input: u_ab = x u_ak + y u_bk. It is 0/0 only where the axes on the right coincide,
        not where the rate of one of them vanishes.
        """
        a, b = self.plan.ends[self.plan.input]
        driven = self.unit[pole_of(a, b)]
        w, doubt = {a: np.zeros_like(driven), b: driven}, np.zeros(len(self.motion))
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            for body in set(bodies) - {a, b}:
                one, other = pole_of(a, body), pole_of(b, body)
                normal = cross(self.unit[one], self.unit[other])
                square = dot(normal, normal)
                along = dot(cross(driven, self.unit[other]), normal)
                w[body] = self.unit[one] * (along / square)
                off = (self.error[one] + self.error[other]) / np.sqrt(square)
                doubt = np.maximum(doubt, off)
        doubt = np.nan_to_num(doubt, nan=1.0, posinf=1.0)
        return {body: rates - w[0] for body, rates in w.items()}, doubt

    def circles(self, pole: Pole) -> Floats:
        """Return (n, 2, 3) unit normals of two great circles of a pole of links.

        Through third links whose poles with both are known, where it was found otherwise;
        NaN without two.
        """
        nothing, bodies = nans((len(self.motion), 2, 3)), self.plan.pole(*pole)
        if bodies is None:
            return nothing
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            if bodies not in self._drawn:
                (i, j), others = bodies, (k for k in self.plan.bodies if k not in bodies)
                via = [k for k in others if {pole_of(i, k), pole_of(j, k)} <= {*self.unit}]
                if len(via) < 2:
                    return nothing
                first, second, *_ = self._two_circles(LinePole(bodies, 0, tuple(via)))
                self._drawn[bodies] = first, second
            both = np.stack(self._drawn[bodies])
            return (both / norm(both)[:, None]).transpose(2, 0, 1)


def _unit(a: Floats) -> Floats:
    """Return a vector made a unit vector; NaN where it is zero."""
    return a / norm(a)


def null_motion(tree: LoopTree, vectors: Floats) -> tuple[Floats, Floats]:
    """Return the motion of a single-freedom part up to its scale.

    The null vector (n, variables), of unit length, of its velocity equations, vectors
    (n, variables, 3); and the inverse (n, variables, variables) of the equations bordered
    by it, which gives derivatives.
    """
    jacobian = tree.jacobian(vectors)
    n, _, count = jacobian.shape
    border = np.broadcast_to(np.cos(1.0 + np.arange(count)), (n, count))
    for _ in range(2):
        inverse = left_inverse(np.concatenate([jacobian, border[:, None, :]], axis=1))
        border = rates = unit_rows(inverse[:, :, -1])
    return rates, inverse
