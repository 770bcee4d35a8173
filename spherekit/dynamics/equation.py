"""The equation of motion in any number of coordinates, solved for the driving torques.

With the inertia matrix M(q), its Christoffel symbols and the generalised forces Q of all
loads, M q'' + C q' = Q + tau, where C_ij = sum of c_ijk q'_k and
c_ijk = 1/2 (dM_ij/dq_k + dM_ik/dq_j - dM_jk/dq_i): so M' - 2 C is skew. Of one coordinate
it is Eksergian's, B q'' + 1/2 dB/dq q'^2 = Q + tau (Di Gregorio 2024, eq. (9)).
"""

import numpy as np

from spherekit.sphere.rotation import Floats


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
