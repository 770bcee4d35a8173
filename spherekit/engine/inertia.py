"""The generalised inertia of Eksergian's equation as an expression.

B = sum w_j . I_j w_j over the links, with w_j the angular velocity of link j per unit
rate of the coordinate and I_j its tensor about the centre of the sphere (Di Gregorio
2024, eq. 15). Here the coordinate is the homogeneous parameter p.
"""

from collections.abc import Mapping

import numpy as np

from spherekit.engine.algebra import Exprs, SeriesExpressions
from spherekit.engine.expression_graph import Expr
from spherekit.engine.kinematics import RateExpressions
from spherekit.engine.turns import Entries
from spherekit.model.mechanism import Mechanism
from spherekit.sphere.rotation import Floats


def tensors(mechanism: Mechanism) -> dict[int, Floats]:
    """Return the tensors (3, 3) of links with mass about O, in link axes (kg m2)."""
    return {
        mechanism.link_number[mass.link]: np.array(mass.tensor, dtype=float)
        for mass in mechanism.masses
    }


def inertia(flow: RateExpressions, by_link: Mapping[int, Entries]) -> SeriesExpressions:
    """Return the generalised inertia of a flow; `by_link` are the links' tensors."""
    # Entries near 0 are made exact zeros, so they need a size near one.
    plain = [
        plain_tensor for plain_tensor in by_link.values() if plain_tensor.dtype != object
    ]
    unit = (
        max((float(np.max(np.abs(plain_tensor))) for plain_tensor in plain), default=1.0)
        or 1.0
    )
    total: list[Expr] = [0.0] * (flow.order + 1)
    for link, tensor in by_link.items():
        if link == 0 or not np.any(tensor):
            continue
        here = flow.placed[link].tensor(tensor / unit)
        y = flow.seen(link)
        for k in range(flow.order + 1):
            for i in range(k // 2 + 1):
                part = _form(y[i], here, y[k - i])
                total[k] = total[k] + (part if 2 * i == k else 2.0 * part)
    return SeriesExpressions(tuple(unit * coefficient for coefficient in total))


def _form(a: Exprs, matrix: Exprs, b: Exprs) -> Expr:
    """Return a . M b; with a = b each mixed term once."""
    if a is b:
        total: Expr = 0.0
        for i in range(3):
            total = total + matrix[i, i] * (a[i] * a[i])
            for j in range(i):
                total = total + (2.0 * matrix[i, j]) * (a[i] * a[j])
        return total
    total = 0.0
    for i in range(3):
        row: Expr = 0.0
        for j in range(3):
            row = row + matrix[i, j] * a[j]
        total = total + row * b[i]
    return total
