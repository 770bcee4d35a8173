"""Configurations with their first and second derivatives by one coordinate.

The coordinate is the arc length s of the configuration curve in the space of the pair
variables, where every dead centre is an ordinary point, or the variable of a pair.
"""

from dataclasses import dataclass
from typing import Literal, final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import Status
from spherekit.motion.closure import Closure
from spherekit.motion.pairs import penetrates
from spherekit.rates.core import null_motion, null_second_rates
from spherekit.sphere.rotation import Floats


@final
@dataclass(frozen=True)
class CoordinateMotion:
    """Configurations in rows, and how they change with one coordinate.

    `values`, `rates`, `second` (n, variables): the pair variables and their first and
    second derivatives by the coordinate. `rotations` (n, links, 3, 3): link axes to
    ground axes. `w`, `dw` (n, links, 3): angular velocities of the links relative to the
    ground per unit rate of the coordinate, in ground axes, and their derivatives.
    `second` and `dw` are NaN where only the first order was asked for. `status`
    (n,): OK, or OFF_PROFILE or CURVATURE where a contact does not exist.
    """

    values: Floats
    rates: Floats
    second: Floats
    rotations: Floats
    w: Floats
    dw: Floats
    status: NDArray[np.int8]

    def turned(self, signs: Floats) -> "CoordinateMotion":
        """Return the same with the coordinate's sense reversed where signs (n,) are -1."""
        return CoordinateMotion(
            self.values,
            self.rates * signs[:, None],
            self.second,
            self.rotations,
            self.w * signs[:, None, None],
            self.dw,
            self.status,
        )

    def by_variable(self, number: int) -> "CoordinateMotion":
        """Return the same configurations with a pair's variable as coordinate.

        Not finite where that variable rests, at its dead centres.
        """
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            factor = 1.0 / self.rates[:, number, None]
            change = -self.second[:, number, None] * factor**3
            return CoordinateMotion(
                self.values,
                self.rates * factor,
                self.second * factor**2 + self.rates * change,
                self.rotations,
                self.w * factor[:, None],
                self.dw * factor[:, None] ** 2 + self.w * change[:, None],
                self.status,
            )


def by_arc_length(
    closure: Closure, values: Floats, order: Literal[1, 2] = 2
) -> CoordinateMotion:
    """Return configurations with the arc length of their curve as coordinate.

    The unit tangent of the curve is the null vector of the velocity equations, in
    either sense: see `continued` and `CoordinateMotion.turned`.

    Parameters
    ----------
    closure
        The closure of a whole single-DOF mechanism.
    values
        (n, variables) closed configurations.
    order
        1 leaves out the second derivatives.
    """
    tree, at = closure.tree, closure.at(values)
    null = null_motion(tree, at.vectors)
    status = np.zeros(len(values), dtype=np.int8)
    status[penetrates(closure.joints, at.states)] = Status.CURVATURE
    status[~np.all(at.states.inside, axis=1)] = Status.OFF_PROFILE
    if order == 1:
        unknown = np.full_like(values, np.nan), np.full_like(null.w, np.nan)
        return CoordinateMotion(
            values, null.rates, unknown[0], at.placed, null.w, unknown[1], status
        )
    changed = at.turned(null.w).vectors
    bending = null_second_rates(tree, changed, null)
    return CoordinateMotion(
        values,
        null.rates,
        bending,
        at.placed,
        null.w,
        at.body_rates(bending) + tree.body_rates(changed, null.rates),
        status,
    )


def reciprocal_condition(closure: Closure, values: Floats) -> float:
    """Return how surely one motion alone closes the loops at a configuration (variables,).

    The least singular value of the closure equations that a single freedom leaves, over
    the greatest: 0 where curves of configurations cross, whatever equations are redundant.
    """
    sizes = np.linalg.svd(closure.at(values[None]).jacobian[0], compute_uv=False)
    kept = len(values) - 1
    if not kept:
        return 1.0
    return float(sizes[kept - 1] / sizes[0]) if len(sizes) >= kept else 0.0


def continued(tangents: Floats, along: Floats) -> Floats:
    """Return the signs (n,) that make tangents of successive rows one sense of travel.

    The first of `tangents` (n, variables) points to the side of `along` (variables,),
    each further one to the side of the one before.
    """
    before = np.concatenate([along[None], tangents[:-1]])
    flips = np.where(np.sum(before * tangents, axis=1) < 0.0, -1.0, 1.0)
    return np.asarray(np.cumprod(flips))
