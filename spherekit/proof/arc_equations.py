"""The equations of a mechanism: the arc of each link that is put on two axes.

f = U . W - cos(arc), with U and W the axes of the link's two pairs in the links placed
before, is a polynomial in the cosines and sines of the angles. Every placed link turns
another one by a rotation about a fixed axis, of norm 1 as are all its derivatives by the
angle; a link put on two axes contributes a matrix of known norm. So the derivatives of f
of any order are bounded by one constant for each equation, for all configurations at once,
real ones or with imaginary parts of the angles up to a bound.

A jet is an array of balls with its derivatives by some variables.
"""

from collections.abc import Mapping, Sequence
from functools import cached_property
from math import prod
from typing import Any

import numpy as np

from spherekit.arrays import Array, Floats
from spherekit.errors import PlanError
from spherekit.proof.ball_frames import Frame, Vector, exact, exactly, revolute
from spherekit.proof.balls import UNIT, Ball, lower
from spherekit.proof.construction import Construction, Step
from spherekit.proof.decimal_mechanism import Written
from spherekit.proof.harmonics import Harmonics

Jet = Mapping[tuple[int, ...], Any]
"""An array under (), its derivatives under (j,) and (j, l) with j <= l; zero if missing."""


def product(one: Jet, other: Jet, times: Any, order: int, before: Jet | None = None) -> Jet:
    """Return the jet of a bilinear product, with derivatives up to an order of 0 to 2.

    It is added to what was `before`.
    """
    out: dict[tuple[int, ...], Any] = dict(before or {})
    for a, left in one.items():
        for b, right in other.items():
            if len(a) + len(b) > order:
                continue
            key = tuple(sorted(a + b))
            term = times(left, right)
            if a and a == b:
                term = term + term
            out[key] = out[key] + term if key in out else term
    return out


SHORTEST = 1e-6
"""Least sine of the arc of a link that is put on two axes: else it can spin there."""


class Equations:
    """The equations of a mechanism in the arithmetic of balls of the present precision.

    Raises
    ------
    PlanError
        If a link that is put on two axes has an arc of 0 or 180 degrees.
    """

    def __init__(self, written: Written, construction: Construction) -> None:
        self.written, self.construction = written, construction
        self.unknowns, self.degrees = construction.unknowns, construction.degrees
        self.variables = len(construction.pairs)
        self.frames = written.frames()
        # the angles (rad) at an input of 0 of pairs that turn with its variable
        self.offsets: dict[int, Ball] = {}
        if not construction.followers:
            _, *angles = written.given([exact(0.0)])
            self.offsets = dict(zip(written.structure.followers, angles, strict=True))
        steps = construction.steps
        self.turning = {x.link: self._turning(x) for x in steps if not x.is_dyad}
        self.putting = {x.link: self._putting(x) for x in construction.equations}

    def frame(self, pair: int, link: int) -> Frame:
        """Return the frame of a pair in one of its links."""
        return self.frames[pair][self.written.structure.ends[pair].index(link)]

    def _turning(self, step: Step) -> Array:
        """Return how a link turns in the one before: still, and by cosine and sine."""
        (pair,) = step.pairs
        parts = revolute(*self.frames[pair])
        if self.written.structure.ends[pair][0] not in step.parents:
            parts = parts.swapaxes(1, 2)
        if pair in self.offsets:
            (s, c), (still, even, odd) = self.offsets[pair].sin_cos(), parts
            parts = np.array([still, even * c + odd * s, odd * c - even * s])
        return parts

    def _putting(self, step: Step) -> tuple[list[Vector], list[Vector], Ball, float]:
        """Return what puts a link on axes u and w of two others, and its arc.

        That is u and w in these links, and rows a, b and n for its orientation
        U a + W b + (U x W) n, with U and W the axes where they are. Of its arc it is the
        cosine, and a lower bound of the sine.
        """
        a, b = (self.frame(pair, step.link)[2] for pair in step.pairs)
        normal = np.cross(a, b)
        square = normal @ normal
        sine = np.sqrt(lower(square)) * (1 - 8 * UNIT)
        if not sine > SHORTEST:
            structure = self.written.structure
            raise PlanError(
                f"{structure.name}: link {structure.links[step.link]} has an arc of about "
                "0 or 180 deg between two pairs, about which it could spin; nothing can "
                "be proven of it"
            )
        rows = [v / square for v in (np.cross(b, normal), np.cross(normal, a), normal)]
        axes = [self.frame(*two)[2] for two in zip(step.pairs, step.parents, strict=True)]
        return axes, rows, a @ b, sine

    def arrays(self, places: Sequence[Ball] | Array, order: int = 1) -> list[Array]:
        """Return f (k,), and its derivatives (k, v), (k, v, v), at balls of variables."""
        shape = [len(self.degrees), *[self.variables] * order]
        arrays = [np.full(shape[: k + 1], exact(0.0)) for k in range(order + 1)]
        for k, jet in enumerate(self._placed(places, order)[0]):
            for key, entry in jet.items():
                array = arrays[len(key)]
                array[(k, *key)] = array[(k, *key[::-1])] = entry
        return arrays

    def orientations(self, places: Sequence[Ball], order: int = 0) -> dict[int, Jet]:
        """Return the jets of all links' orientations in the root, at balls of variables."""
        _, placed = self._placed(places, order)
        placed[self.construction.root] = {(): exactly(np.eye(3))}
        for step in self.construction.steps:
            above, _ = self.construction.placed[step.link]
            placed[step.link] = product(placed[above], placed[step.link], np.matmul, order)
        return placed

    def _placed(
        self, places: Sequence[Ball] | Array, order: int
    ) -> tuple[list[Jet], dict[int, Jet]]:
        """Return the jets of f, and of links' orientations in links of `Construction`."""
        values: list[Jet] = []
        local: dict[int, Jet] = {}

        def along(way: Sequence[int], axis: Vector) -> Jet:
            """Return an axis of the first link of a way in the link that it leads to."""
            jet: Jet = {(): axis}
            for link in way:
                jet = product(local[link], jet, np.matmul, order)
            return jet

        for step in self.construction.steps:
            if not step.is_dyad:
                turned = _turned(self.turning[step.link], places, step)
                local[step.link] = {k: x for k, x in turned.items() if len(k) <= order}
                continue
            axes, rows, cosine, _ = self.putting[step.link]
            one, other = map(along, self.construction.apart(step)[1:], axes)
            values.append(product(one, other, np.dot, order, {(): -cosine}))
            both = one, other, product(one, other, _cross, order)
            placed: Jet = {}
            for jet, row in zip(both, rows, strict=True):
                placed = product(jet, {(): row}, np.multiply.outer, order, placed)
            local[step.link] = placed
        return values, local

    @cached_property
    def bound(self) -> Floats:
        """Bounds of f of each equation at real angles (equations,).

        All derivatives of order k are at most that times the k-th power of `degrees`.
        """
        factors = dict.fromkeys(self.turning, 1.0)
        products = []
        for step in self.construction.equations:
            _, *ways = self.construction.apart(step)
            one, other = (prod(factors[link] for link in way) for way in ways)
            sums = (one + other + one * other) * (1 + 16 * UNIT)
            factors[step.link] = sums / self.putting[step.link][-1]
            products.append(one * other)
        return np.array(products) * (1 + 64 * UNIT)

    @cached_property
    def real(self) -> Harmonics:
        """The same equations at real angles by their coefficients, in float64."""
        return Harmonics(self.degrees, lambda angles: self.arrays(angles, 0)[0])


def _cross(a: Vector, b: Vector) -> Vector:
    """Return the vector product; NumPy's takes ten times as long for two vectors."""
    up, down = [1, 2, 0], [2, 0, 1]
    return a[up] * b[down] - a[down] * b[up]


def _turned(parts: Array, places: Sequence[Ball] | Array, step: Step) -> Jet:
    """Return the jet of a rotation by a step's variable at balls of all variables."""
    sine, cosine = (places[step.variable] * step.turns).sin_cos()
    still, even, odd = parts
    one, along = even * cosine + odd * sine, odd * cosine - even * sine
    j, turns = step.variable, step.turns
    return {(): still + one, (j,): along * turns, (j, j): -one * turns**2}
