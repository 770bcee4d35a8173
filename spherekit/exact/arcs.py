"""Arc length of a curve against its own parameter, and back, in any arithmetic."""

from typing import Protocol, final

import numpy as np

from spherekit.errors import EngineError
from spherekit.exact.arithmetic import Arithmetic, Hardware, Numbers
from spherekit.exact.legendre import gauss_legendre

HALVINGS = 8
STEPS = 60


class Measurable(Protocol):
    """A curve in a parameter of its own."""

    def edges(self, arithmetic: Arithmetic) -> Numbers:
        """Return the parameters (m,) between which the curve is analytic."""

    def speed(self, arithmetic: Arithmetic, u: Numbers) -> Numbers:
        """Return |dp/du|, a series (k, n), at a series u (k, n)."""


@final
class ArcTable:
    """The arc length of a smooth curve from the first of its edges on.

    Raises
    ------
    EngineError
        If quadrature does not reach the digits of the arithmetic.
    """

    def __init__(self, arithmetic: Arithmetic, curve: Measurable) -> None:
        self._arithmetic, self._curve = arithmetic, curve
        self._nodes, self._weights = gauss_legendre(arithmetic, 10 + arithmetic.digits // 3)
        self._edges = curve.edges(arithmetic)
        whole = self._covered(self._edges[:-1], self._edges[1:])
        for _ in range(HALVINGS):
            middles = (self._edges[:-1] + self._edges[1:]) / 2
            edges = np.empty(2 * len(middles) + 1, dtype=self._edges.dtype)
            edges[::2], edges[1::2] = self._edges, middles
            halves = self._covered(edges[:-1], edges[1:])
            total = np.sum(halves)
            change = np.abs(halves[::2] + halves[1::2] - whole)
            self._edges, whole = edges, halves
            if np.all(change <= 16 * arithmetic.eps * total):
                break
        else:
            raise EngineError(
                "the arc length of a profile does not converge; give its points more evenly"
            )
        self.starts = np.concatenate([arithmetic.zeros(1), np.cumsum(whole)])
        self.length = self.starts[-1]
        self._guess = (
            None
            if isinstance(arithmetic, Hardware)
            else ArcTable(Hardware(np.float64), curve)
        )

    def parameters(self, arcs: Numbers) -> Numbers:
        """Return the parameters (n,) at arc lengths (n,), by Newton's method.

        NaN where it does not end.
        """
        places = self._arithmetic.floats(arcs)
        starts = self._arithmetic.floats(self.starts)
        panel = np.searchsorted(starts, places, side="right") - 1
        panel = np.clip(panel, 0, len(starts) - 2)
        low, high = self._edges[panel], self._edges[panel + 1]
        if self._guess is None:
            share = (arcs - self.starts[panel]) / (
                self.starts[panel + 1] - self.starts[panel]
            )
            u = low + share * (high - low)
        else:
            u = self._arithmetic.exact(self._guess.parameters(places))
        for _ in range(STEPS):
            miss = arcs - self.starts[panel] - self._covered(low, u)
            step = miss / self._speed(u)
            u = u + step
            # the error left over is about the square of the step
            ended = self._arithmetic.floats(np.abs(step)) <= 1e-3 * np.sqrt(
                self._arithmetic.eps
            )
            if np.all(ended):
                break
        nothing = self._arithmetic.exact(np.nan)
        return np.where(ended, u, nothing)

    def _speed(self, u: Numbers) -> Numbers:
        """Return |dp/du| at parameters u (n,)."""
        return np.asarray(self._curve.speed(self._arithmetic, u[None])[0])

    def _covered(self, low: Numbers, high: Numbers) -> Numbers:
        """Return the arc lengths (n,) between parameters low and high (n,)."""
        half = (high - low) / 2
        u = low[:, None] + half[:, None] * (1 + self._nodes)
        speeds = self._speed(u.ravel()).reshape(u.shape)
        return np.asarray(half * np.sum(speeds * self._weights, axis=1))
