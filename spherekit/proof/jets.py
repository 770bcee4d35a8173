"""Products of matrices with their derivatives by some variables, of floats or of balls."""

from collections.abc import Mapping
from typing import Any, Protocol, final

import numpy as np
from numpy.typing import NDArray

from spherekit.proof.balls import BallMatrix, matrix

Jet = Mapping[tuple[int, ...], Any]
"""A matrix under (), its derivatives under (j,) and (j, l) with j <= l; zero if missing."""


class Arithmetic(Protocol):
    """What jets are computed in."""

    def times(self, one: Any, other: Any) -> Any:
        """Return the matrix product."""

    def cross(self, one: Any, other: Any) -> Any:
        """Return the vector product of columns."""

    def dot(self, one: Any, other: Any) -> Any:
        """Return the product of columns without conjugation, 1 x 1."""


@final
class Batches:
    """Arrays (n, 3, 3) and (n, 3, 1) of floats."""

    def times(self, one: NDArray[Any], other: NDArray[Any]) -> NDArray[Any]:
        """See `Arithmetic`."""
        return np.asarray(one @ other)

    def cross(self, one: NDArray[Any], other: NDArray[Any]) -> NDArray[Any]:
        """See `Arithmetic`."""
        ax, ay, az = np.moveaxis(one[..., 0], -1, 0)
        bx, by, bz = np.moveaxis(other[..., 0], -1, 0)
        rows = [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx]
        return np.stack(rows, axis=-1)[..., None]

    def dot(self, one: NDArray[Any], other: NDArray[Any]) -> NDArray[Any]:
        """See `Arithmetic`."""
        return np.asarray(np.swapaxes(one, -1, -2) @ other)


@final
class Matrices:
    """Matrices of balls."""

    def times(self, one: BallMatrix, other: BallMatrix) -> BallMatrix:
        """See `Arithmetic`."""
        return one * other

    def cross(self, one: BallMatrix, other: BallMatrix) -> BallMatrix:
        """See `Arithmetic`."""
        ax, ay, az = one.entries()
        bx, by, bz = other.entries()
        return matrix([[ay * bz - az * by], [az * bx - ax * bz], [ax * by - ay * bx]])

    def dot(self, one: BallMatrix, other: BallMatrix) -> BallMatrix:
        """See `Arithmetic`."""
        return one.transpose() * other


def product(one: Jet, other: Jet, times: Any, order: int) -> Jet:
    """Return the jet of a bilinear product, with derivatives up to an order of 0 to 2."""
    out: dict[tuple[int, ...], Any] = {}
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


def total(*jets: Jet) -> Jet:
    """Return the sum of jets."""
    out: dict[tuple[int, ...], Any] = {}
    for jet in jets:
        for key, value in jet.items():
            out[key] = out[key] + value if key in out else value
    return out


def values_and_slopes(jets: list[Jet], variables: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return values (n, k) and slopes (n, k, v) of many configurations."""
    values = np.stack([jet[()] for jet in jets], axis=1)
    slopes = np.zeros((*values.shape, variables), dtype=values.dtype)
    for row, jet in enumerate(jets):
        for column in range(variables):
            if (column,) in jet:
                slopes[:, row, column] = jet[(column,)]
    return values, slopes
