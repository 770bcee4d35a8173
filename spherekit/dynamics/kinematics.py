"""Configurations with their first and second derivatives by independent coordinates.

There are as many coordinates as freedoms: the variables of the inputs, fixed sums of pair
variables, or, of one freedom, the arc length s of the configuration curve in the space of
the pair variables, where every dead centre is an ordinary point.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import Status
from spherekit.errors import SolveError
from spherekit.motion.closure import Closure
from spherekit.motion.loops import Linearisation, left_inverse, penetrates
from spherekit.numeric.zeros import ArrayRows
from spherekit.rates.core import null_motion
from spherekit.sphere.rotation import Floats

Order = Literal[1, 2]


@final
@dataclass(frozen=True)
class CoordinateMotion(ArrayRows):
    """Configurations in rows, and how they change with m coordinates.

    `values` (n, variables): the pair variables; `rates` (n, m, variables) and `second`
    (n, m, m, variables) their first and second derivatives by the coordinates.
    `rotations` (n, links, 3, 3): link axes to ground axes. `w` (n, m, links, 3): angular
    velocities of the links relative to the ground per unit rate of each coordinate, in
    ground axes; `dw` (n, m, m, links, 3): at [i, k] the derivative of the i-th by
    coordinate k. `second` and `dw` are NaN where only the first order was asked for.
    `status` (n,): OK, or OFF_PROFILE or CURVATURE where a contact does not exist.
    """

    values: Floats
    rates: Floats
    second: Floats
    rotations: Floats
    w: Floats
    dw: Floats
    status: NDArray[np.int8]

    def turned(self, signs: Floats) -> "CoordinateMotion":
        """Return the same with the coordinates' sense reversed where signs (n,) are -1."""
        rates, w = self.rates * signs[:, None, None], self.w * signs[:, None, None, None]
        return replace(self, rates=rates, w=w)


def by_arc_length(closure: Closure, values: Floats, order: Order = 2) -> CoordinateMotion:
    """Return configurations with the arc length of their curve as the only coordinate.

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
    at = closure.at(values)
    null = null_motion(closure.tree, at.vectors)
    return _derived(at, null.rates[:, None], null.inverse[:, :, :-1], order)


def by_combinations(
    closure: Closure, values: Floats, frame: Floats, order: Order = 2
) -> CoordinateMotion:
    """Return configurations with sums of the pair variables as coordinates.

    Parameters
    ----------
    closure
        The closure of a whole mechanism of mobility m.
    values
        (n, variables) closed configurations.
    frame
        (m, variables), or (n, m, variables) for each row: the factors of the pair variables
        in each coordinate. Rows are NaN where these do not say how all variables move.
    order
        1 leaves out the second derivatives.
    """
    at = closure.at(values)
    count = frame.shape[-2]
    rows = np.broadcast_to(frame, (len(values), *frame.shape[-2:]))
    bordered = np.concatenate([at.jacobian, rows], axis=1)
    inverse = left_inverse(bordered)
    sides = np.zeros((bordered.shape[1], count))
    sides[-count:] = np.eye(count)
    solved = inverse[:, :, -count:]
    # The product with an inverse loses digits; a step of refinement brings them back.
    solved = solved + inverse @ (sides - bordered @ solved)
    rates = np.ascontiguousarray(np.swapaxes(solved, 1, 2))
    return _derived(at, rates, inverse[:, :, :-count], order)


def by_variables(
    closure: Closure, values: Floats, numbers: Sequence[int], order: Order = 2
) -> CoordinateMotion:
    """Return configurations with pair variables, by their numbers, as coordinates.

    Not finite where these do not move independently: at dead centres of a single one, at
    singularities of type II of several.
    """
    frame = np.eye(values.shape[1])[list(numbers)]
    return by_combinations(closure, values, frame, order)


def _derived(
    at: Linearisation, rates: Floats, inverse: Floats, order: Order
) -> CoordinateMotion:
    """Return a motion from rates (n, m, variables), and what closes loops.

    `inverse` (n, variables, equations) turns the change of the velocity equations into
    that of the rates.
    """
    n, m, variables = rates.shape
    tree = at.tree
    w = tree.body_rates(at.vectors[:, None], rates)
    status = np.zeros(n, dtype=np.int8)
    status[penetrates(at.joints, at.states)] = Status.CURVATURE
    status[~np.all(at.states.inside, axis=1)] = Status.OFF_PROFILE
    second = np.full((n, m, m, variables), np.nan)
    dw = np.full((n, m, m, tree.count, 3), np.nan)
    for k in range(m if order == 2 else 0):
        turned = at.turned(w[:, k]).vectors
        bias = rates @ np.swapaxes(tree.jacobian(turned), 1, 2)
        second[:, :, k] = -bias @ np.swapaxes(inverse, 1, 2)
        dw[:, :, k] = tree.body_rates(at.vectors[:, None], second[:, :, k])
        dw[:, :, k] += tree.body_rates(turned[:, None], rates)
    return CoordinateMotion(at.values, rates, second, at.placed, w, dw, status)


def determined(rates: Floats) -> Floats:
    """Return how surely coordinates say the motion (n,), given their rates.

    `rates` (n, m, variables) are of pair variables that are coordinates themselves. 1 where
    no other variable moves, 0 where others move though none of these does: of one freedom,
    the rate of its variable along the curve.
    """
    finite = np.all(np.isfinite(rates), axis=(1, 2))
    measure = np.zeros(len(rates))
    measure[finite] = 1.0 / np.linalg.norm(rates[finite], ord=2, axis=(1, 2))
    return measure


def reciprocal_condition(closure: Closure, values: Floats, freedoms: int = 1) -> float:
    """Return how surely only so many freedoms are left at a configuration (variables,).

    The least singular value of the closure equations that these freedoms leave, over
    the greatest: 0 where curves of configurations cross, whatever equations are redundant.
    """
    sizes = np.linalg.svd(closure.at(values[None]).jacobian[0], compute_uv=False)
    kept = len(values) - freedoms
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


def single(columns: Floats) -> Floats:
    """Return the only one of columns (..., inputs); `SolveError` with several inputs."""
    if columns.shape[-1] != 1:
        raise SolveError(
            f"there are {columns.shape[-1]} inputs; read inputs, input_rates, "
            "input_accelerations or torques"
        )
    return np.asarray(columns[..., 0])


class InputMotion:
    """Records with the inputs, their rates and accelerations in columns (n, inputs)."""

    inputs: Floats
    input_rates: Floats
    input_accelerations: Floats

    @property
    def q(self) -> Floats:
        """(n,) variable of the only input, rad; `SolveError` with several, as all below."""
        return single(self.inputs)

    @property
    def dq(self) -> Floats:
        """(n,) its rate, rad/s."""
        return single(self.input_rates)

    @property
    def ddq(self) -> Floats:
        """(n,) its acceleration, rad/s2."""
        return single(self.input_accelerations)
