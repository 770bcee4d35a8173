"""Mechanisms at rest: the torques that hold them, and how stiffly inputs hold an output."""

from dataclasses import dataclass, replace
from typing import final

import numpy as np

from spherekit.conventions import Status
from spherekit.dynamics.inverse import InverseSolution, needed_torques
from spherekit.motion.motion import Motion
from spherekit.motion.timing import Timing
from spherekit.sphere.rotation import Floats


def holding_torques(motion: Motion, t: float = 0.0) -> InverseSolution:
    """Return the torques at the inputs that hold a mechanism at rest against its loads.

    Parameters
    ----------
    motion
        Configurations in rows; their timing does not matter.
    t
        The time (s) at which loads that depend on it are taken.
    """
    still = np.zeros_like(motion.inputs)
    timing = Timing(np.full(len(motion), float(t)), still, still)
    return needed_torques(replace(motion, timing=timing))


RIGID = 1e-12
"""An axis whose compliance is below this part of the largest does not yield."""


@final
@dataclass(frozen=True)
class Stiffness:
    """How inputs hold a link relative to another one at n rows.

    `w` (n, inputs, 3): its angular velocity per unit rate of each input, in ground axes.
    `advantage` (n, inputs): the moment about the axis of w that a unit torque at that input
    balances while the others are locked, one over the size of w; infinite where the input
    does not move the link. `stiffness` (n, 3) N m/rad rising and `axes` (n, 3, 3), in rows:
    the principal ones of the link where every input yields by its torque over its
    stiffness; about axes that do not yield it is infinite, and the axis NaN.
    """

    w: Floats
    advantage: Floats
    stiffness: Floats
    axes: Floats


def output_stiffness(
    solution: InverseSolution, link: str, relative_to: str, stiffness: Floats
) -> Stiffness:
    """Return how inputs hold a link, each yielding by its own stiffness.

    Parameters
    ----------
    found
        Torques or holding torques, whose rates are used.
    link, relative_to
        Names of two links.
    stiffness
        (inputs,) N m/rad.

    Notes
    -----
    A moment m on the link is balanced by the torques w_i . m, which turn the inputs by
    w_i . m / k_i, and the link by C m with C = sum of w_i w_i^T / k_i. That the loads
    change as the mechanism yields is left out.
    """
    number = solution.mechanism.link_number
    w = solution.motion.w[:, :, number[link]] - solution.motion.w[:, :, number[relative_to]]
    good = solution.rate_status == Status.OK
    w = np.where(good[:, None, None], w, np.nan)
    compliance = np.einsum("nia,nib,i->nab", w, w, 1.0 / stiffness)
    values, vectors = np.full((len(w), 3), np.nan), np.full((len(w), 3, 3), np.nan)
    values[good], turned = np.linalg.eigh(compliance[good])
    vectors[good] = np.swapaxes(turned, 1, 2)
    values[values < RIGID * values[:, -1:]] = 0.0
    vectors[values == 0.0] = np.nan
    # Each axis points to the side to which the inputs turn the link together.
    side = np.sum(w / (1.0 + np.arange(w.shape[1]))[:, None], axis=1)
    vectors *= np.where(np.einsum("nka,na->nk", vectors, side) < 0.0, -1.0, 1.0)[..., None]
    with np.errstate(divide="ignore", invalid="ignore"):
        principal = 1.0 / values
        advantage = 1.0 / np.linalg.norm(w, axis=2)
    return Stiffness(w, advantage, principal[:, ::-1], vectors[:, ::-1])
