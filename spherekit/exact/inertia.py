"""Equivalent inertia of a mechanism from reference values of its motion."""

from spherekit.exact.arithmetic import Arithmetic, Numbers
from spherekit.exact.rows import ExactRows
from spherekit.model.mechanism import Mechanism


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
    B, dB = link_inertia(
        exact.arithmetic, exact.mechanism, exact.rotations, exact.w, exact.dw
    )
    return B, dB


def link_inertia(
    arithmetic: Arithmetic,
    mechanism: Mechanism,
    rotations: Numbers,
    w: Numbers,
    dw: Numbers,
) -> tuple[Numbers, Numbers]:
    """Return B (n,) of a coordinate and its derivative by it, see `exact_inertia`.

    From orientations (n, links, 3, 3), angular velocities (n, links, 3) per unit rate of
    the coordinate, and their derivatives by it.
    """
    B, dB = arithmetic.zeros(len(w)), arithmetic.zeros(len(w))
    for mass in mechanism.masses:
        link = mechanism.link_number[mass.link]
        turn = rotations[:, link]
        in_link = (w[:, link][:, None, :] @ turn)[:, 0] @ arithmetic.exact(mass.tensor)
        momentum = (turn @ in_link[..., None])[..., 0]
        B = B + (w[:, link] * momentum).sum(axis=1)
        dB = dB + 2 * (dw[:, link] * momentum).sum(axis=1)
    return B, dB
