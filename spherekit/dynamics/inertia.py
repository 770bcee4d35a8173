"""The equivalent moment of inertia of a mechanism and its derivative, link by link."""

from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.dynamics.kinematics import CoordinateMotion
from spherekit.errors import ModelError, SolveError
from spherekit.model.mechanism import Mechanism
from spherekit.sphere.rotation import Floats

STILL = 1e-9
"""Links that turn slower than this part of the fastest stand still but for rounding."""


@final
@dataclass(frozen=True)
class Inertia:
    """Each link's part of the equivalent inertia B and of dB by the coordinate.

    `B_parts` (n, masses) kg m2 per squared unit of the coordinate, `dB_parts` its
    derivative, in the order of the mechanism's masses.
    """

    B_parts: Floats
    dB_parts: Floats

    @property
    def B(self) -> Floats:
        """(n,) equivalent inertia."""
        return np.asarray(np.sum(self.B_parts, axis=1))

    @property
    def dB(self) -> Floats:
        """(n,) derivative of the equivalent inertia by the coordinate."""
        return np.asarray(np.sum(self.dB_parts, axis=1))


def inertia(mechanism: Mechanism, motion: CoordinateMotion) -> Inertia:
    """Return the equivalent inertia B and dB at every row of a motion.

    Notes
    -----
    With I the tensor of a link about the centre, turned to ground axes, and w its angular
    velocity per unit rate of the coordinate, B is the sum of w . I w (Di Gregorio 2024,
    eqs. (14), (15)). I turns with the link: dI = [w] I - I [w], with [w] the matrix of the
    cross product. So w . dI w = w . (w x I w) - w . I (w x w) = 0, and
    dB = 2 sum w . I dw, which is eq. (19) without its derivatives of rotations.
    """
    tensors, (w, dw) = _in_links(mechanism, motion, (motion.w, motion.dw))
    momentum = np.einsum("kij,nkj->nki", tensors, w)
    return Inertia(np.sum(momentum * w, axis=2), 2.0 * np.sum(momentum * dw, axis=2))


def equivalent_inertia(mechanism: Mechanism, motion: CoordinateMotion) -> Floats:
    """Return B (n,) alone, which needs the motion to the first order only."""
    tensors, (w,) = _in_links(mechanism, motion, (motion.w,))
    return np.asarray(np.einsum("kij,nki,nkj->n", tensors, w, w))


def _in_links(
    mechanism: Mechanism, motion: CoordinateMotion, vectors: tuple[Floats, ...]
) -> tuple[Floats, list[Floats]]:
    """Return the tensors (masses, 3, 3), and vectors (n, masses, 3) in link axes."""
    links = [mechanism.link_number[mass.link] for mass in mechanism.masses]
    tensors = np.array([mass.tensor for mass in mechanism.masses]).reshape(-1, 3, 3)
    turns = motion.rotations[:, links]
    return tensors, [np.einsum("nkji,nkj->nki", turns, v[:, links]) for v in vectors]


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
    B = float(equivalent_inertia(mechanism, motion)[0])
    moving = [mass for mass in mechanism.masses if mass.link != mechanism.ground]
    sizes = [np.linalg.norm(mass.tensor, 2) for mass in moving]
    fastest = np.max(np.sum(motion.w[0] ** 2, axis=-1))
    if not (STILL**2 * float(np.sum(sizes)) * fastest < B):
        raise SolveError(
            f"{mechanism.name}: at the start no link with mass moves (less than {STILL:g} "
            "of the fastest), so loads would accelerate the others endlessly; give mass to "
            "links that move, or start elsewhere"
        )
