"""Truncated power series: arrays whose first axis counts powers of one variable.

Element k of a series is the coefficient of the k-th power, an array (n, ...). Two series
in one operation have the same number of coefficients.
"""

from functools import reduce
from operator import add

import numpy as np

from spherekit.exact.arithmetic import Arithmetic, Numbers


def product(a: Numbers, b: Numbers) -> Numbers:
    """Return a b, element by element."""
    return np.stack(
        [reduce(add, (a[j] * b[k - j] for j in range(k + 1))) for k in range(len(a))]
    )


def matrix_product(a: Numbers, b: Numbers) -> Numbers:
    """Return the products of matrices (..., 3, 3)."""
    return np.stack(
        [reduce(add, (a[j] @ b[k - j] for j in range(k + 1))) for k in range(len(a))]
    )


def quotient(a: Numbers, b: Numbers) -> Numbers:
    """Return a / b, element by element."""
    series: list[Numbers] = []
    for k in range(len(a)):
        rest = a[k]
        for j in range(k):
            rest = rest - series[j] * b[k - j]
        series.append(rest / b[0])
    return np.stack(series)


def root(arithmetic: Arithmetic, a: Numbers) -> Numbers:
    """Return the square root of a."""
    series = [arithmetic.root(a[0])]
    for k in range(1, len(a)):
        rest = a[k]
        for j in range(1, k):
            rest = rest - series[j] * series[k - j]
        series.append(rest / (2 * series[0]))
    return np.stack(series)


def cosine_sine(arithmetic: Arithmetic, a: Numbers) -> tuple[Numbers, Numbers]:
    """Return the cosine and the sine of an angle (rad)."""
    first, other = arithmetic.cosine_sine(a[0])
    cosine, sine = [first], [other]
    for k in range(1, len(a)):
        steps = [(j * a[j], k - j) for j in range(1, k + 1)]
        cosine.append(-reduce(add, (step * sine[j] for step, j in steps)) / k)
        sine.append(reduce(add, (step * cosine[j] for step, j in steps)) / k)
    return np.stack(cosine), np.stack(sine)


def dot(a: Numbers, b: Numbers) -> Numbers:
    """Return the products (..., ) of vectors (..., 3)."""
    return np.asarray(reduce(add, (product(a[..., c], b[..., c]) for c in range(3))))


def cross(a: Numbers, b: Numbers) -> Numbers:
    """Return a x b for vectors (..., 3)."""
    turns = ((1, 2), (2, 0), (0, 1))
    return np.stack(
        [product(a[..., p], b[..., q]) - product(a[..., q], b[..., p]) for p, q in turns],
        axis=-1,
    )


def transpose(a: Numbers) -> Numbers:
    """Return the transposes of matrices (..., 3, 3)."""
    return np.swapaxes(a, -1, -2)


def skew_part(a: Numbers) -> Numbers:
    """Return the vectors (..., 3) of the skew parts of matrices (..., 3, 3)."""
    turns = ((2, 1), (0, 2), (1, 0))
    return np.stack([(a[..., p, q] - a[..., q, p]) / 2 for p, q in turns], axis=-1)
