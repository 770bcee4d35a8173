"""The inertia of a mechanism in its coordinates, and the equation of motion.

With the inertia matrix M, its Christoffel symbols c and the generalised forces Q of all
loads, the driving torques tau satisfy

    M q'' + C q' = Q + tau,   C_ij = sum over k of c_ijk q'_k,
    c_ijk = 1/2 (dM_ij/dq_k + dM_ik/dq_j - dM_jk/dq_i),

so that M' - 2 C is skew-symmetric. With one coordinate this is Eksergian's equation
B q'' + 1/2 dB/dq q'^2 = Q + tau (Di Gregorio 2024, eq. (9)).
"""

from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Floats
from spherekit.dynamics.coordinates import CoordinateMotion
from spherekit.errors import ModelError, SolveError
from spherekit.geometry.vectors import cross
from spherekit.mechanism.mechanism import Mechanism
from spherekit.wording import listing

MIN_RELATIVE_INERTIA = 1e-14
"""Smallest moment of inertia, relative to the largest of all directions, that is no
rounding error.

Larger: simulations with very different inertias are refused. Smaller: motions in which no
mass moves are not recognised.
"""

MIN_NAMED_RATE = 1e-6
"""Smallest rate of a pair that is named in a message, in a motion of unit size."""

MIN_RELATIVE_SPEED = 1e-9
"""Smallest angular velocity of a link, relative to the fastest link, that counts as motion.

Larger: starts at which heavy links move slowly are refused. Smaller: rounding errors count
as motion.
"""


@dataclass(frozen=True)
class Inertia:
    """Contributions of the links to the inertia matrix M and its derivatives, at n rows.

    A row is one configuration of a motion. M is the inertia matrix of the mechanism for m
    coordinates. Only links with mass are listed, in the order of `Mechanism.masses`. With
    one coordinate the matrix is a single number, the equivalent inertia B.

    Attributes
    ----------
    M_parts
        (n, masses, m, m) contribution of each link to M, kg m2 per product of the units of
        two coordinates.
    dM_parts
        (n, masses, m, m, m) derivatives of `M_parts`: at [..., i, j, k] the derivative of
        M_ij with respect to coordinate k.
    """

    M_parts: Floats
    dM_parts: Floats

    @property
    def M(self) -> Floats:
        """(n, m, m) inertia matrix."""
        return np.sum(self.M_parts, axis=1)

    @property
    def dM(self) -> Floats:
        """(n, m, m, m) derivatives of M: index k of the last axis is the coordinate."""
        return np.sum(self.dM_parts, axis=1)

    @property
    def B(self) -> Floats:
        """(n,) equivalent inertia."""
        return self.M[:, 0, 0]

    @property
    def dB(self) -> Floats:
        """(n,) derivative of the equivalent inertia with respect to the coordinate."""
        return self.dM[:, 0, 0, 0]


def inertia(mechanism: Mechanism, motion: CoordinateMotion) -> Inertia:
    """Return the contribution of each link to the inertia matrix and to its derivatives.

    The inertia matrix is the sum of the contributions of all links with mass.

    Parameters
    ----------
    mechanism
        The mechanism with its masses.
    motion
        The motion to second order.

    Notes
    -----
    M_ij is the sum of w_i . I w_j over the links (Di Gregorio 2024, eqs. (14), (15), for
    one coordinate). I is the inertia tensor of a link about the centre, and w_i its angular
    velocity per unit rate of coordinate i. The components of both are along link axes, so I
    is constant. By the product rule, the derivative of M_ij with respect to coordinate k is
    the sum over the links of

        I w_i . dw_j/dq_k + I w_j . dw_i/dq_k,

    where dw/dq_k are the derivatives of the components of w along link axes. With one
    coordinate q, M is a number, and its derivative is the sum of 2 I w . dw/dq (eq. (19) of
    Di Gregorio 2024).
    """
    # Vectors of the links with mass, along link axes: w_i (n, m, masses, 3), its
    # derivatives dw_i/dq_k (n, m, m, masses, 3), and the angular momentum I w_i.
    w = _components_along_links(mechanism, motion, motion.w)
    dw = _components_along_links(mechanism, motion, _derivatives_seen_from_links(motion))
    momenta = _angular_momenta(mechanism, w)
    # I w_i . dw_j/dq_k of each link. Letters: n row, b link (body), i j k coordinates,
    # c component. The links are not summed here, so b remains.
    first_terms = np.einsum("nibc,njkbc->nbijk", momenta, dw)
    # I w_j . dw_i/dq_k: the same with i and j (axes 2 and 3) exchanged.
    second_terms = np.swapaxes(first_terms, 2, 3)
    return Inertia(_velocity_products(momenta, w), first_terms + second_terms)


def inertia_matrix(mechanism: Mechanism, motion: CoordinateMotion) -> Floats:
    """Return the inertia matrix M (n, m, m) of a motion to first order."""
    w = _components_along_links(mechanism, motion, motion.w)
    return np.sum(_velocity_products(_angular_momenta(mechanism, w), w), axis=1)


def _derivatives_seen_from_links(motion: CoordinateMotion) -> Floats:
    """Return derivatives of the angular velocities of links, as seen from each link.

    w_i is the angular velocity of a link per unit rate of coordinate i. The result (n, m,
    m, links, 3) has the vectors dw_i/dq_k - w_k x w_i at [:, i, k], in ground axes. The
    second term takes off the change by the rotation of the link. In link axes, the inertia
    of a link is constant, so the derivatives of the inertia matrix follow from these
    derivatives alone.
    """
    w_i = motion.w[:, :, None]
    w_k = motion.w[:, None]
    return motion.dw - cross(w_k, w_i)


def _components_along_links(
    mechanism: Mechanism, motion: CoordinateMotion, vectors: Floats
) -> Floats:
    """Convert a vector of each link from ground axes to link axes, for the links with mass.

    Inertia tensors are constant in link axes.

    Parameters
    ----------
    mechanism, motion
        The mechanism with its masses, and n configurations with orientations of its links.
    vectors
        (n, ..., links, 3) a vector of each link in ground axes.

    Returns
    -------
    (n, ..., masses, 3) the vectors of the links with mass, in link axes.
    """
    links = [mechanism.link_number[mass.link] for mass in mechanism.masses]
    # Letters: n row, b link (body), g component in the ground, c component in the link.
    return np.einsum(
        "nbgc,n...bg->n...bc", motion.rotations[:, links], vectors[..., links, :]
    )


def _angular_momenta(mechanism: Mechanism, w: Floats) -> Floats:
    """Return I w (n, ..., masses, 3) of the links with mass, from w, both in link axes."""
    tensors = np.array([mass.tensor for mass in mechanism.masses]).reshape(-1, 3, 3)
    # Letters: n row, b link (body), c and d components.
    return np.einsum("bcd,n...bd->n...bc", tensors, w)


def _velocity_products(momenta: Floats, w: Floats) -> Floats:
    """Return I w_i . w_j (n, masses, m, m) from I w and w (n, m, masses, 3)."""
    # Letters: n row, b link (body), i j coordinates, c component.
    return np.einsum("nibc,njbc->nbij", momenta, w)


def need_inertia(mechanism: Mechanism) -> None:
    """Raise `ModelError` unless some moving link has inertia."""
    moving_masses = (mass for mass in mechanism.masses if mass.link != mechanism.ground)
    if not any(np.any(mass.tensor) for mass in moving_masses):
        raise ModelError(
            f"{mechanism.name}: mass: no moving link has inertia, so a load would cause an "
            "infinite acceleration; give at least one [mass.LINK]"
        )


def need_moving_inertia(mechanism: Mechanism, motion: CoordinateMotion) -> None:
    """Raise `SolveError` if the mechanism can move without any motion of a link with mass.

    A load would accelerate such a motion infinitely.

    Parameters
    ----------
    mechanism
        The mechanism with its masses.
    motion
        The motion with derivatives with respect to m coordinates. Its first row is the
        start of a simulation.
    """
    inertia_at_start = inertia_matrix(mechanism, motion)[0]
    principal_inertias, directions = np.linalg.eigh(inertia_at_start)
    smallest = principal_inertias[0]
    largest = principal_inertias[-1]
    if len(principal_inertias) > 1 and smallest < MIN_RELATIVE_INERTIA * largest:
        # With several coordinates, one combination of their rates has no inertia.
        coordinate_rates = directions[:, 0]
        raise _make_error_of_free_pairs(mechanism, coordinate_rates @ motion.rates[0])
    # If all links with mass are at rest, the true inertia is 0. Their computed speeds have
    # rounding errors, which can cause a computed inertia up to this limit.
    rounding_inertia = _inertia_by_rounding(mechanism, motion)
    has_inertia = smallest > rounding_inertia  # False if `smallest` is NaN
    if not has_inertia:
        raise SolveError(
            f"{mechanism.name}: at the start no link with mass moves (its speed is "
            f"below {MIN_RELATIVE_SPEED:g} of that of the fastest link), so a load "
            "would cause an infinite acceleration; give mass to links that move, or "
            "start elsewhere"
        )


def _make_error_of_free_pairs(mechanism: Mechanism, variable_rates: Floats) -> SolveError:
    """Return the error for a motion in which pairs turn but no link with mass moves.

    The message names the pairs (joints) that turn.

    Parameters
    ----------
    mechanism
        The mechanism.
    variable_rates
        (variables,) rates of the pair variables (joint angles) in this motion. They are
        scaled such that the rates of the coordinates form a unit vector.
    """
    pairs = [
        name
        for name, variable in mechanism.angles.items()
        if np.abs(variable_rates[variable]) > MIN_NAMED_RATE
    ]
    return SolveError(
        f"{mechanism.name}: at the start, pairs {listing(pairs)} can turn together "
        "without moving any link that has mass, so a load would cause an infinite "
        "acceleration; give mass to the links that they move, or lock a pair"
    )


def _inertia_by_rounding(mechanism: Mechanism, motion: CoordinateMotion) -> float:
    """Return the largest inertia (kg m2) that rounding errors can cause at the start.

    A mechanism whose links with mass are at rest should have no inertia. By rounding
    errors, these links may have small computed speeds, up to a speed w. The result is the
    inertia if all of them moved at this speed: the sum of I w^2, with the largest moment of
    inertia I of each link. The speed w is `MIN_RELATIVE_SPEED` times that of the fastest
    link. All speeds are per unit rate of a coordinate.

    Parameters
    ----------
    mechanism
        The mechanism with its masses.
    motion
        The motion with derivatives with respect to the coordinates. Its first row is the
        start of a simulation.
    """
    total_inertia = 0.0
    for mass in mechanism.masses:
        if mass.link != mechanism.ground:
            # This norm of an inertia tensor is its largest moment of inertia.
            total_inertia += float(np.linalg.norm(mass.tensor, 2))
    # (m, links, 3) angular velocities per unit rate of each coordinate
    w_at_start = motion.w[0]
    largest_speed_square = np.max(np.sum(w_at_start**2, axis=-1))
    return float(MIN_RELATIVE_SPEED**2 * total_inertia * largest_speed_square)


def christoffel(dM: Floats) -> Floats:
    """Return the Christoffel symbols c (n, m, m, m) of n inertia matrices M.

    These symbols give the velocity-dependent torques, sum of c_ijk q'_j q'_k. `dM` (n, m,
    m, m) has at [i, j, k] the derivative of M_ij with respect to coordinate k. The symbols
    are c_ijk = (dM_ij/dq_k + dM_ik/dq_j - dM_jk/dq_i) / 2.
    """
    return 0.5 * (dM + (np.swapaxes(dM, 2, 3) - np.moveaxis(dM, 3, 1)))


def coriolis(dM: Floats, rates: Floats) -> Floats:
    """Return the velocity-dependent (Coriolis and centrifugal) torques C q' (n, m).

    `dM` (n, m, m, m) are the derivatives of the inertia matrix with respect to the m
    coordinates (last axis). `rates` (n, m) are the time derivatives of the coordinates.
    """
    return np.einsum("nijk,nj,nk->ni", christoffel(dM), rates, rates)


def driving_torques(M: Floats, dM: Floats, Q: Floats, dq: Floats, ddq: Floats) -> Floats:
    """Return the driving torques tau (n, m) = M q'' + C q' - Q at the coordinates q, N m.

    These torques produce a known motion. C q' are the torques that depend on products of
    rates (Coriolis and centrifugal).

    Parameters
    ----------
    M, dM
        (n, m, m) inertia matrix at n rows, and (n, m, m, m) its derivatives: at [..., k]
        those with respect to coordinate k.
    Q
        (n, m) generalised forces, the sum over all loads.
    dq, ddq
        (n, m) rates q' and accelerations q'' of the coordinates.
    """
    return (M @ ddq[..., None])[..., 0] + coriolis(dM, dq) - Q
