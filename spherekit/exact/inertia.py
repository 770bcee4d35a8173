"""Equivalent inertia of a mechanism from reference values of its motion."""

from spherekit.exact.arithmetic import Numbers
from spherekit.exact.rows import ExactRows


def exact_inertia(exact: ExactRows) -> tuple[Numbers, Numbers]:
    """Return the equivalent inertia B (n,), kg m2, and its derivative by the input (n,).

    Twice the kinetic energy per squared rate of the input that moves (Di Gregorio 2024,
    eqs. (14), (15)). Inertia tensors are taken as the float64 numbers they are given by.

    Raises
    ------
    ValueError
        If the rows were made with order 1, without derivatives.
    """
    if exact.dw is None:
        raise ValueError("inertia needs rows of order 2 or 3")
    arithmetic = exact.arithmetic
    B, dB = arithmetic.zeros(len(exact.status)), arithmetic.zeros(len(exact.status))
    for mass in exact.mechanism.masses:
        link = exact.mechanism.link_number[mass.link]
        turn, w, dw = exact.rotations[:, link], exact.w[:, link], exact.dw[:, link]
        own = (w[:, None, :] @ turn)[:, 0] @ arithmetic.exact(mass.tensor)
        momentum = (turn @ own[..., None])[..., 0]
        B = B + (w * momentum).sum(axis=1)
        dB = dB + 2 * (dw * momentum).sum(axis=1)
    return B, dB
