"""The sequence of a plan: every pole a product of known ones, every coefficient a ratio.

With two third links k and r a pole lies along (u_ik x u_jk) x (u_ir x u_jr), and
w_k - w_a = x u_ka with one ratio x of such products. All of it is written once for series,
a quantity alone or with its derivative by the input: (3, n) of vectors, (n,) of numbers.

Each pole carries a bound of its error, propagated from those of its sources. Of all the
great circles that the plan keeps for a pole, a route takes the best two or the first two.
The best two are the one with the smallest error and then the partner that makes the
intersection most certain; both the angle between the two planes and the bound are reported.
"""

from collections.abc import Callable
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import EPS
from spherekit.model.joints import PairRates
from spherekit.motion.loops import LoopTree
from spherekit.motion.motion import Motion
from spherekit.planning.poles import (
    BlockPoles,
    CoaxialPole,
    LinePole,
    Plan,
    Pole,
    PrimaryPole,
    pole_of,
)
from spherekit.rates.core import NullMotion, null_motion, null_motion_rate
from spherekit.rates.request import (
    Route,
)
from spherekit.rates.vectors import cross, dot, norm
from spherekit.sphere.rotation import Floats

Series = tuple[Floats, ...]
"""A quantity and, if there are two orders, its derivative by the input."""


@final
class PlannedPoles:
    """The poles of a plan at the rows of a motion, with any signs of secondary ones.

    `unit[pole]` (3, n) the direction; `error[pole]` (n,) bound of its error (rad);
    `angle[pole]` (n,) sine of the angle between the two planes used, 1 for primary poles.
    Where it is known how pairs are `turned`, there are derivatives, by the product rule
    through the same intersections. `blocks` are irreducible parts that were solved before.
    By the route ``equations`` only the poles of pairs are planned, the others are NaN.
    """

    def __init__(
        self,
        plan: Plan,
        motion: Motion,
        route: Route = "best",
        turned: PairRates | None = None,
        blocks: dict[BlockPoles, NullMotion] | None = None,
    ) -> None:
        self.plan, self.motion, self.route, self._turned = plan, motion, route, turned
        self.unit: dict[Pole, Series] = {}
        self.error: dict[Pole, Floats] = {}
        self.angle: dict[Pole, Floats] = {}
        self._drawn: dict[Pole, tuple[Floats, Floats]] = {}
        self._blocks = {} if blocks is None else blocks
        self._axes = (motion.axes,) if turned is None else (motion.axes, turned.axes)
        n = len(motion)
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            for step in plan.steps:
                if isinstance(step, PrimaryPole | CoaxialPole):
                    axis = self._of_pair(step.pair)
                    self._add(step.pole, axis, np.full(n, EPS), np.ones(n))
                elif route == "equations":
                    for pole in step.poles if isinstance(step, BlockPoles) else [step.pole]:
                        self._add(pole, (np.full((3, n), np.nan),), np.ones(n), np.zeros(n))
                elif isinstance(step, LinePole):
                    one, other, angle, error = self._two_circles(step)
                    self._drawn[step.pole] = one[0], other[0]
                    self._add(step.pole, _unit(_cross(one, other)), error, angle)
                else:
                    self._solve(step)

    def moving(self, turned: PairRates) -> "PlannedPoles":
        """Return the same with derivatives, given those of axes and vectors of pairs."""
        return PlannedPoles(self.plan, self.motion, self.route, turned, self._blocks)

    def _add(self, pole: Pole, unit: Series, error: Floats, angle: Floats) -> None:
        self.unit[pole], self.error[pole], self.angle[pole] = unit, error, angle

    def _of_pair(self, pair: int) -> Series:
        return tuple(np.ascontiguousarray(axes[:, pair].T) for axes in self._axes)

    def _two_circles(self, step: LinePole) -> tuple[Series, Series, Floats, Floats]:
        """Return the normals of the two great circles of a pole.

        And the sine of the angle between them and the bound of where they meet (n,). Of
        all these are those through pairs of known poles, then the contact planes.
        """
        i, j = step.pole
        sources = [(pole_of(i, k), pole_of(j, k)) for k in step.via]
        every = [_cross(self.unit[a], self.unit[b]) for a, b in sources]
        every += [self._of_pair(number) for number in step.contacts]
        drawn = [self.error[a] + self.error[b] for a, b in sources]
        drawn += [np.zeros(len(self.motion))] * len(step.contacts)
        count = 2 if self.route == "first" else len(every)
        orders = [np.stack(order) for order in zip(*every[:count], strict=True)]
        length, row = norm(orders[0]), np.arange(len(self.motion))
        errors = (np.stack(drawn[:count]) + EPS) / np.maximum(length, EPS)
        # Only two are taken in their order, so that their sense is that of the plan.
        best = np.argmin(errors, axis=0) * (len(errors) > 2)
        first = [_taken(order, best) for order in orders]
        across = norm(cross(first[0], orders[0]))
        sine = across / np.maximum(length * length[best, row], EPS * EPS)
        doubt = (errors + errors[best, row]) / np.maximum(sine, EPS)
        doubt[best, row] = np.inf
        partner = np.argmin(doubt, axis=0)
        second = tuple(_taken(order, partner) for order in orders)
        off = np.minimum(doubt[partner, row], 1.0)
        return tuple(first), second, sine[partner, row], off

    def _solve(self, step: BlockPoles) -> None:
        """Add the poles of an irreducible part: the null vector of its equations."""
        number = {link: k for k, link in enumerate(step.links)}
        owned = [self.plan.mechanism.variables_of(pair) for pair in step.pairs]
        ends = [self.plan.ends[pair] for pair in step.pairs]
        tree = LoopTree(
            len(step.links),
            tuple((number[a], number[b]) for a, b in ends),
            tuple(k for k, of_pair in enumerate(owned) for _ in of_pair),
        )
        variables = [variable for of_pair in owned for variable in of_pair]
        vectors = self.motion.vectors[:, variables]
        block = self._blocks.get(step) or null_motion(tree, vectors)
        self._blocks[step] = block
        w = [block.w]
        if self._turned is not None:
            turned = self._turned.vectors[:, variables]
            w.append(null_motion_rate(tree, vectors, turned, block))
        growth = np.linalg.norm(block.inverse, axis=(1, 2))
        for pole in step.poles:
            i, j = (number[link] for link in pole)
            vector = tuple((order[:, j] - order[:, i]).T for order in w)
            error = np.minimum(EPS * growth / np.maximum(norm(vector[0]), EPS), 1.0)
            self._add(pole, _unit(vector), error, 1.0 / np.maximum(growth, 1.0))

    def link_rates(self, bodies: tuple[int, ...]) -> tuple[dict[int, Series], Floats]:
        """Return w relative to the ground by body, and a bound (n,) of its error.

        By the vector form of eq. (5) of Di Gregorio 2024, with a and b the links of the
        input: u_ab = x u_ak + y u_bk. It is 0/0 only where the axes on the right coincide,
        not where the rate of one of them vanishes.
        """
        a, b = self.plan.ends[self.plan.input]
        driven = self.unit[pole_of(a, b)]
        still = tuple(np.zeros_like(order) for order in driven)
        w, doubt = {a: still, b: driven}, np.zeros(len(self.motion))
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            for body in set(bodies) - {a, b}:
                one, other = pole_of(a, body), pole_of(b, body)
                normal = _cross(self.unit[one], self.unit[other])
                square = _product(dot, normal, normal)
                along = _product(dot, _cross(driven, self.unit[other]), normal)
                w[body] = _product(np.multiply, self.unit[one], _ratio(along, square))
                off = (self.error[one] + self.error[other]) / np.sqrt(square[0])
                doubt = np.maximum(doubt, off)
        if 0 in w:
            ground = w[0]
            for body, series in w.items():
                w[body] = tuple(x - y for x, y in zip(series, ground, strict=True))
        return w, np.nan_to_num(doubt, nan=1.0, posinf=1.0)

    def circles(self, pole: Pole) -> Floats:
        """Return (n, 2, 3) unit normals of two great circles of a pole of links.

        Through third links whose poles with both are known, where it was found otherwise;
        NaN without two.
        """
        nothing, bodies = np.full((len(self.motion), 2, 3), np.nan), self.plan.pole(*pole)
        if bodies is None:
            return nothing
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            if bodies not in self._drawn:
                (i, j), others = bodies, (k for k in self.plan.bodies if k not in bodies)
                via = [k for k in others if {pole_of(i, k), pole_of(j, k)} <= {*self.unit}]
                if len(via) < 2:
                    return nothing
                first, second, *_ = self._two_circles(LinePole(bodies, 0, tuple(via)))
                self._drawn[bodies] = first[0], second[0]
            one, other = self._drawn[bodies]
            return np.stack([one / norm(one), other / norm(other)]).transpose(2, 0, 1)


def _product(of: Callable[[Floats, Floats], Floats], a: Series, b: Series) -> Series:
    """Return the series of a product of any kind (Leibniz)."""
    value = of(a[0], b[0])
    return (value, *(of(x, b[0]) + of(a[0], y) for x, y in zip(a[1:], b[1:], strict=True)))


def _ratio(a: Series, number: Series) -> Series:
    """Return the series of a quotient by a number."""
    value, changes = a[0] / number[0], zip(a[1:], number[1:], strict=True)
    return (value, *((x - value * y) / number[0] for x, y in changes))


def _unit(a: Series) -> Series:
    """Return the series of a vector made a unit vector; NaN where it is zero."""
    square, *changes = _product(dot, a, a)
    length = np.sqrt(square)
    return _ratio(a, (length, *(change / (2.0 * length) for change in changes)))


def _cross(a: Series, b: Series) -> Series:
    return _product(cross, a, b)


def _taken(stack: Floats, which: NDArray[np.intp]) -> Floats:
    """Return (3, n) from (lines, 3, n), its own line for each row."""
    return np.asarray(np.take_along_axis(stack, which[None, None], axis=0)[0])
