"""The generalised inertia of Eksergian's equation as an expression.

B = sum w_j . I_j w_j over the links, with w_j the angular velocity of link j per unit
rate of the coordinate and I_j its tensor about the centre of the sphere (Di Gregorio
2024, eq. 15). Here the coordinate is the homogeneous parameter p.
"""

from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.engine.algebra import Exprs
from spherekit.engine.compiler import Expr
from spherekit.engine.kinematics import Flow
from spherekit.model.mechanism import Mechanism
from spherekit.sphere.rotation import Floats


@final
@dataclass(frozen=True)
class Inertia:
    """B and dB/dp; `parts[link]` is the share of each link that has mass."""

    value: Expr
    rate: Expr
    parts: dict[int, Expr]


def tensors(mechanism: Mechanism) -> dict[int, Floats]:
    """Return the tensors (3, 3) of links with mass about O, in link axes (kg m2)."""
    return {
        mechanism.link_number[mass.link]: np.array(mass.tensor, dtype=float)
        for mass in mechanism.masses
    }


def inertia(flow: Flow, by_link: dict[int, Floats]) -> Inertia:
    """Return the generalised inertia of a flow; `by_link` are the links' tensors."""
    value: Expr = 0.0
    rate: Expr = 0.0
    parts: dict[int, Expr] = {}
    for link, tensor in by_link.items():
        if link == 0:
            continue
        here = flow.placed[link].tensor(tensor)
        y, change = flow.seen_rates(link)
        parts[link] = _form(y, here, y)
        value = value + parts[link]
        rate = rate + 2.0 * _form(y, here, change)
    return Inertia(value, rate, parts)


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
