"""The inertia of a mechanism in its coordinates, link by link, and the equation it is in.

With the inertia matrix M(q), its Christoffel symbols and the generalised forces Q of all
loads, M q'' + C q' = Q + tau, where C_ij = sum of c_ijk q'_k and
c_ijk = 1/2 (dM_ij/dq_k + dM_ik/dq_j - dM_jk/dq_i): so M' - 2 C is skew. Of one coordinate
it is Eksergian's, B q'' + 1/2 dB/dq q'^2 = Q + tau (Di Gregorio 2024, eq. (9)).
"""

from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.conventions import listing
from spherekit.dynamics.kinematics import CoordinateMotion
from spherekit.errors import ModelError, SolveError
from spherekit.model.mechanism import Mechanism
from spherekit.sphere.rotation import Floats, cross

ROUNDED = 1e-14
"""Moments of inertia that are a smaller part of the largest are rounding."""
ROUGHLY = 1e-6
"""Rates of pairs below this are left out where those that move are named."""
STILL = 1e-9
"""Links that turn slower than this part of the fastest stand still but for rounding."""


@final
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
        return np.asarray(np.sum(self.M_parts, axis=1))

    @property
    def dM(self) -> Floats:
        """(n, m, m, m) its derivatives, by the last axis."""
        return np.asarray(np.sum(self.dM_parts, axis=1))

    @property
    def B_parts(self) -> Floats:
        """(n, masses) parts of the equivalent inertia, of a single coordinate."""
        return self.M_parts[:, :, 0, 0]

    @property
    def dB_parts(self) -> Floats:
        """(n, masses) their derivatives by that coordinate."""
        return self.dM_parts[:, :, 0, 0, 0]

    @property
    def B(self) -> Floats:
        """(n,) equivalent inertia."""
        return np.asarray(np.sum(self.B_parts, axis=1))

    @property
    def dB(self) -> Floats:
        """(n,) derivative of the equivalent inertia by the coordinate."""
        return np.asarray(np.sum(self.dB_parts, axis=1))


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
    across = cross(w[:, :, None], w[:, None])
    half += np.einsum("nika,njlka->nkijl", momentum, across)
    return Inertia(_products(momentum, w), half + np.swapaxes(half, 2, 3))


def inertia_matrix(mechanism: Mechanism, motion: CoordinateMotion) -> Floats:
    """Return M (n, m, m) alone, which needs the motion to the first order only."""
    tensors, w = _in_links(mechanism, motion, motion.w)
    return np.asarray(np.sum(_products(_momentum(tensors, w), w), axis=1))


def equivalent_inertia(mechanism: Mechanism, motion: CoordinateMotion) -> Floats:
    """Return B (n,) of a single coordinate alone."""
    return inertia_matrix(mechanism, motion)[:, 0, 0]


def _in_links(
    mechanism: Mechanism, motion: CoordinateMotion, vectors: Floats
) -> tuple[Floats, Floats]:
    """Return the tensors (masses, 3, 3), and vectors (n, ..., masses, 3) in link axes."""
    links = [mechanism.link_number[mass.link] for mass in mechanism.masses]
    tensors = np.array([mass.tensor for mass in mechanism.masses]).reshape(-1, 3, 3)
    turns = motion.rotations[:, links]
    return tensors, np.einsum("nkji,n...kj->n...ki", turns, vectors[..., links, :])


def _momentum(tensors: Floats, w: Floats) -> Floats:
    return np.asarray(np.einsum("kij,n...kj->n...ki", tensors, w))


def _products(momentum: Floats, w: Floats) -> Floats:
    return np.asarray(np.einsum("nika,njka->nkij", momentum, w))


def need_inertia(mechanism: Mechanism) -> None:
    """Raise `ModelError` unless some moving link has inertia."""
    moving = [m for m in mechanism.masses if m.link != mechanism.ground]
    if not any(np.any(np.array(mass.tensor) != 0.0) for mass in moving):
        raise ModelError(
            f"{mechanism.name}: mass: no moving link has inertia, so loads would "
            "accelerate it endlessly; give at least one [mass.LINK]"
        )


def need_moving_inertia(mechanism: Mechanism, motion: CoordinateMotion) -> None:
    """Raise `SolveError` where links with mass stand still while others move."""
    inertias, ways = np.linalg.eigh(inertia_matrix(mechanism, motion)[0])
    least = float(inertias[0])
    if len(inertias) > 1 and least < ROUNDED * inertias[-1]:
        rates = np.abs(ways[:, 0] @ motion.rates[0])
        pairs = [name for name, v in mechanism.angles.items() if rates[v] > ROUGHLY]
        raise SolveError(
            f"{mechanism.name}: at the start pairs {listing(pairs)} can turn together so "
            "that no link with mass moves, so loads would accelerate them endlessly; give "
            "mass to links that move then, or lock a pair"
        )
    moving = [mass for mass in mechanism.masses if mass.link != mechanism.ground]
    sizes = [np.linalg.norm(mass.tensor, 2) for mass in moving]
    fastest = np.max(np.sum(motion.w[0] ** 2, axis=-1))
    if not (STILL**2 * float(np.sum(sizes)) * fastest < least):
        raise SolveError(
            f"{mechanism.name}: at the start no link with mass moves (less than {STILL:g} "
            "of the fastest), so loads would accelerate the others endlessly; give mass to "
            "links that move, or start elsewhere"
        )


def christoffel(dM: Floats) -> Floats:
    """Return c (n, m, m, m) from the derivatives of M (n, m, m, m)."""
    skew = np.swapaxes(dM, 2, 3) - np.moveaxis(dM, 3, 1)
    return np.asarray(0.5 * (dM + skew))


def coriolis(dM: Floats, rates: Floats) -> Floats:
    """Return C (n, m, m) from the derivatives of M (n, m, m, m) at rates (n, m)."""
    return np.asarray((christoffel(dM) @ rates[:, None, :, None])[..., 0])


def driving_torques(M: Floats, dM: Floats, Q: Floats, dq: Floats, ddq: Floats) -> Floats:
    """Return tau (n, m) = M q'' + C q' - Q, N m.

    The torques at the pairs of the coordinates, `M` (n, m, m), `dM` (n, m, m, m); `Q`
    (n, m) is of all other loads.
    """
    needed = (M @ ddq[..., None] + coriolis(dM, dq) @ dq[..., None])[..., 0]
    return np.asarray(needed - Q)
