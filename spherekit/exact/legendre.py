"""Legendre polynomials in any arithmetic: quadrature, series, and their integrals."""

from functools import cached_property
from typing import final

import numpy as np
from numpy.polynomial.legendre import leggauss

from spherekit.exact.arithmetic import Arithmetic, Numbers


def gauss_legendre(arithmetic: Arithmetic, count: int) -> tuple[Numbers, Numbers]:
    """Return nodes and weights (count,) of Gauss's quadrature from -1 to 1."""
    x = arithmetic.exact(leggauss(count)[0])
    for _ in range(2 + int(np.log2(arithmetic.digits / 15))):
        value, slope = _with_slope(x, count)
        x = x - value / slope
    _, slope = _with_slope(x, count)
    return x, 2 / ((1 - x * x) * slope * slope)


def _with_slope(x: Numbers, count: int) -> tuple[Numbers, Numbers]:
    """Return the Legendre polynomial of degree `count` and its derivative at x."""
    every = legendre(x, count + 1)
    before, here = every[..., -2], every[..., -1]
    return here, np.asarray(count * (x * here - before) / (x * x - 1))


def legendre(x: Numbers, count: int) -> Numbers:
    """Return the first `count` Legendre polynomials at x (...), as (..., count)."""
    polynomials = [x * 0 + 1, x][:count]
    for degree in range(1, count - 1):
        before, here = polynomials[-2:]
        polynomials.append(((2 * degree + 1) * x * here - degree * before) / (degree + 1))
    return np.stack(polynomials, axis=-1)


@final
class LegendreSeries:
    """Series of `count` Legendre polynomials on [-1, 1], from values at Gauss's nodes.

    `nodes` (count,) are these, and `from_values` (count, count) gives the coefficients.
    """

    def __init__(self, arithmetic: Arithmetic, count: int) -> None:
        self.count = count
        self.nodes, weights = gauss_legendre(arithmetic, count)
        odd = arithmetic.exact(2.0 * np.arange(count) + 1.0)
        self.from_values = (legendre(self.nodes, count) * weights[:, None] * odd / 2).T

    @cached_property
    def to_integrals(self) -> Numbers:
        """(count, count): from values at the nodes to the integrals from -1 to them."""
        return np.asarray(self.integrals(self.nodes) @ self.from_values)

    def integrals(self, x: Numbers) -> Numbers:
        """Return (n, count): the integrals from -1 to x (n,) of the polynomials.

        From (2 k + 1) P_k = (P_{k+1} - P_{k-1})'.
        """
        every = legendre(x, self.count + 1)
        integrals = [x + 1]
        for k in range(1, self.count):
            integrals.append((every[..., k + 1] - every[..., k - 1]) / (2 * k + 1))
        return np.stack(integrals, axis=-1)

    def values(self, coefficients: Numbers, x: Numbers) -> Numbers:
        """Return the series with coefficients (count,) at x (n,)."""
        return np.asarray(legendre(x, self.count) @ coefficients)
