"""Configurations with their first and second derivatives by independent coordinates.

There are as many coordinates as freedoms: the variables of the inputs, fixed sums of pair
variables, or, of one freedom, the arc length s of the configuration curve in the space of
the pair variables, where every dead centre is an ordinary point.

The inertia of a mechanism in its coordinates, link by link, and the equation it is in.

With the inertia matrix M(q), its Christoffel symbols and the generalised forces Q of all
loads, M q'' + C q' = Q + tau, where C_ij = sum of c_ijk q'_k and
c_ijk = 1/2 (dM_ij/dq_k + dM_ik/dq_j - dM_jk/dq_i): so M' - 2 C is skew. Of one coordinate
it is Eksergian's, B q'' + 1/2 dB/dq q'^2 = Q + tau (Di Gregorio 2024, eq. (9)).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from spherekit.arrays import Floats, SmallIntegers
from spherekit.errors import ModelError, SolveError
from spherekit.geometry.rotation import transpose
from spherekit.geometry.vectors import all_finite, cross, nans
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.array_rows import ArrayRows
from spherekit.positions.linear_equations import left_inverse
from spherekit.positions.linearisation import Linearisation
from spherekit.positions.loop_closure import Closure
from spherekit.positions.pair_states import has_penetration
from spherekit.status import Status
from spherekit.velocities.pole_sequence import solve_null_motion
from spherekit.wording import listing

Order = Literal[1, 2]


@dataclass(frozen=True)
class CoordinateMotion(ArrayRows):
    """Configurations in rows, and how they change with m coordinates.

    `values` (n, variables): the pair variables; `rates` (n, m, variables) and `second`
    (n, m, m, variables) their first and second derivatives by the coordinates.
    `rotations` (n, links, 3, 3): link axes to ground axes. `w` (n, m, links, 3): angular
    velocities of the links relative to the ground per unit rate of each coordinate, in
    ground axes; `dw` (n, m, m, links, 3): at [i, k] the derivative of the i-th by
    coordinate k. `second` and `dw` are NaN where only the first order was asked for.
    `status` (n,): OK, or OFF_PROFILE or CURVATURE where a contact does not exist; `frames`
    (n, pairs, 3, 3): those of the pairs, in ground axes.
    """

    values: Floats
    rates: Floats
    second: Floats
    rotations: Floats
    w: Floats
    dw: Floats
    status: SmallIntegers
    frames: Floats

    def turned(self, signs: Floats) -> "CoordinateMotion":
        """Return the same with the coordinates' sense reversed where signs (n,) are -1."""
        rates = self.rates * signs[:, None, None]
        w = self.w * signs[:, None, None, None]
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
    null_motion = solve_null_motion(closure.tree, at.vectors)
    return _derived(at, null_motion.rates[:, None], null_motion.inverse[:, :, :-1], order)


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
    solved = inverse[:, :, -count:]
    # The product with an inverse loses digits; a step of refinement brings them back.
    left = np.eye(bordered.shape[1])[:, -count:] - bordered @ solved
    solved = solved + inverse @ left
    rates = np.ascontiguousarray(transpose(solved))
    return _derived(at, rates, inverse[:, :, :-count], order)


def by_variables(
    closure: Closure, values: Floats, numbers: Sequence[int], order: Order = 2
) -> CoordinateMotion:
    """Return configurations with pair variables, by their numbers, as coordinates.

    Not finite where these do not move independently: at dead centres of a single one, at
    singularities of type II of several.
    """
    return by_combinations(closure, values, np.eye(values.shape[1])[list(numbers)], order)


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
    status[has_penetration(at.joints, at.states)] = Status.CURVATURE
    status[~np.all(at.states.inside, axis=1)] = Status.OFF_PROFILE
    second = nans((n, m, m, variables))
    dw = nans((n, m, m, tree.count, 3))
    for k in range(m if order == 2 else 0):
        turned = at.turned(w[:, k])
        bias = rates @ transpose(tree.jacobian(turned))
        second[:, :, k] = -bias @ transpose(inverse)
        dw[:, :, k] = tree.body_rates(at.vectors[:, None], second[:, :, k])
        dw[:, :, k] += tree.body_rates(turned[:, None], rates)
    return CoordinateMotion(at.values, rates, second, at.placed, w, dw, status, at.frames)


def determined(rates: Floats) -> Floats:
    """Return how surely coordinates say the motion (n,), given their rates.

    `rates` (n, m, variables) are of pair variables that are coordinates themselves. 1 where
    no other variable moves, 0 where others move though none of these does: of one freedom,
    the rate of its variable along the curve.
    """
    finite = all_finite(rates, (1, 2))
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
    sides = np.vecdot(before, tangents)
    return np.asarray(np.cumprod(np.where(sides < 0.0, -1.0, 1.0)))


def single(columns: Floats) -> Floats:
    """Return the only one of columns (..., inputs); `SolveError` with several inputs."""
    if columns.shape[-1] != 1:
        raise SolveError(
            f"there are {columns.shape[-1]} inputs; read inputs, input_rates, "
            "input_accelerations or torques"
        )
    return columns[..., 0]


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


ROUNDED = 1e-14
"""Moments of inertia that are a smaller part of the largest are rounding."""
ROUGHLY = 1e-6
"""Rates of pairs below this are left out where those that move are named."""
STILL = 1e-9
"""Links that turn slower than this part of the fastest stand still but for rounding."""


@dataclass(frozen=True)
class Inertia:
    """Each link's part of the inertia matrix M and of its derivatives.

    `M_parts` (n, masses, m, m) kg m2 per product of units of the m coordinates;
    `dM_parts` (n, masses, m, m, m) at [i, j, k] the derivative of M_ij by coordinate k; in
    the order of the mechanism's masses. The matrix of one coordinate is the equivalent
    inertia B.
    """

    M_parts: Floats
    dM_parts: Floats

    @property
    def M(self) -> Floats:
        """(n, m, m) inertia matrix."""
        return np.sum(self.M_parts, axis=1)

    @property
    def dM(self) -> Floats:
        """(n, m, m, m) its derivatives, by the last axis."""
        return np.sum(self.dM_parts, axis=1)

    @property
    def B(self) -> Floats:
        """(n,) equivalent inertia."""
        return self.M[:, 0, 0]

    @property
    def dB(self) -> Floats:
        """(n,) derivative of the equivalent inertia by the coordinate."""
        return self.dM[:, 0, 0, 0]


def inertia(mechanism: Mechanism, motion: CoordinateMotion) -> Inertia:
    """Return the inertia matrix and its derivatives at every row of a motion.

    Notes
    -----
    With I the tensor of a link about the centre, turned to ground axes, and w_i its angular
    velocity per unit rate of coordinate i, M_ij is the sum of w_i . I w_j (Di Gregorio
    2024, eqs. (14), (15), of one coordinate). I turns with the link: I_k is
    [w_k] I - I [w_k], with [w] the matrix of the cross product, so that

        w_i . I_k w_j = (w_i x w_k) . I w_j + (I w_i) . (w_j x w_k),

    which is zero for i = j = k, and dB = 2 sum w . I dw of one coordinate is eq. (19) there
    without its derivatives of rotations.
    """
    tensors, w = _in_links(mechanism, motion, motion.w)
    _, dw = _in_links(mechanism, motion, motion.dw)
    momentum = _momentum(tensors, w)
    half = np.einsum("nika,njlka->nkijl", momentum, dw)
    half += np.einsum("nika,njlka->nkijl", momentum, cross(w[:, :, None], w[:, None]))
    return Inertia(_products(momentum, w), half + np.swapaxes(half, 2, 3))


def inertia_matrix(mechanism: Mechanism, motion: CoordinateMotion) -> Floats:
    """Return M (n, m, m) alone, which needs the motion to the first order only."""
    tensors, w = _in_links(mechanism, motion, motion.w)
    return np.sum(_products(_momentum(tensors, w), w), axis=1)


def _in_links(
    mechanism: Mechanism, motion: CoordinateMotion, vectors: Floats
) -> tuple[Floats, Floats]:
    """Return the tensors (masses, 3, 3), and vectors (n, ..., masses, 3) in link axes."""
    links = [mechanism.link_number[mass.link] for mass in mechanism.masses]
    tensors = np.array([mass.tensor for mass in mechanism.masses]).reshape(-1, 3, 3)
    return tensors, np.einsum(
        "nkji,n...kj->n...ki", motion.rotations[:, links], vectors[..., links, :]
    )


def _momentum(tensors: Floats, w: Floats) -> Floats:
    return np.einsum("kij,n...kj->n...ki", tensors, w)


def _products(momentum: Floats, w: Floats) -> Floats:
    return np.einsum("nika,njka->nkij", momentum, w)


def need_inertia(mechanism: Mechanism) -> None:
    """Raise `ModelError` unless some moving link has inertia."""
    moving = (mass for mass in mechanism.masses if mass.link != mechanism.ground)
    if not any(np.any(mass.tensor) for mass in moving):
        raise ModelError(
            f"{mechanism.name}: mass: no moving link has inertia, so loads would "
            "accelerate it endlessly; give at least one [mass.LINK]"
        )


def need_moving_inertia(mechanism: Mechanism, motion: CoordinateMotion) -> None:
    """Raise `SolveError` where links with mass stand still while others move."""
    inertias, ways = np.linalg.eigh(inertia_matrix(mechanism, motion)[0])
    least = inertias[0]
    if len(inertias) > 1 and least < ROUNDED * inertias[-1]:
        rates = np.abs(ways[:, 0] @ motion.rates[0])
        pairs = [name for name, v in mechanism.angles.items() if rates[v] > ROUGHLY]
        raise SolveError(
            f"{mechanism.name}: at the start pairs {listing(pairs)} can turn together so "
            "that no link with mass moves, so loads would accelerate them endlessly; give "
            "mass to links that move then, or lock a pair"
        )
    moving = (mass for mass in mechanism.masses if mass.link != mechanism.ground)
    size = sum(np.linalg.norm(mass.tensor, 2) for mass in moving)
    fastest = np.max(np.sum(motion.w[0] ** 2, axis=-1))
    if not STILL**2 * size * fastest < least:
        raise SolveError(
            f"{mechanism.name}: at the start no link with mass moves (less than {STILL:g} "
            "of the fastest), so loads would accelerate the others endlessly; give mass to "
            "links that move, or start elsewhere"
        )


def christoffel(dM: Floats) -> Floats:
    """Return c (n, m, m, m) from the derivatives of M (n, m, m, m)."""
    return 0.5 * (dM + (np.swapaxes(dM, 2, 3) - np.moveaxis(dM, 3, 1)))


def coriolis(dM: Floats, rates: Floats) -> Floats:
    """Return C q' (n, m) from the derivatives of M (n, m, m, m) at rates (n, m)."""
    return np.einsum("nijk,nj,nk->ni", christoffel(dM), rates, rates)


def driving_torques(M: Floats, dM: Floats, Q: Floats, dq: Floats, ddq: Floats) -> Floats:
    """Return tau (n, m) = M q'' + C q' - Q, N m.

    The torques at the pairs of the coordinates, `M` (n, m, m), `dM` (n, m, m, m); `Q`
    (n, m) is of all other loads.
    """
    return (M @ ddq[..., None])[..., 0] + coriolis(dM, dq) - Q
