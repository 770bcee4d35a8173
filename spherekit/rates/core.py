"""Angular velocities straight from the loop-closure velocity equations.

The independent route beside the pole axes: exact wherever the mechanism has a unique
motion, whatever its topology. It solves irreducible parts, takes over from the plan at
configurations where that is badly conditioned, and gives mobility by rank.
"""

from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.motion.closure import LoopTree
from spherekit.sphere.rotation import Floats, cross


@final
@dataclass(frozen=True)
class LinkRates:
    """First and second derivatives by the motion's parameter of a set of bodies.

    `w`, `dw`: (n, bodies, 3) angular velocity relative to body 0 and its derivative;
    `flatness`: (n,) reciprocal condition of the equations.
    """

    w: Floats
    dw: Floats
    flatness: Floats


def driven_rates(
    tree: LoopTree, axes: Floats, driven: int, owners: list[int], ground: int
) -> LinkRates:
    """Return the rates per unit rate of the driven pair, relative to body `ground`.

    Parameters
    ----------
    axes
        (n, pairs, 3) pair axes, in axes fixed to body `ground`.
    owners
        For each pair a body in which its axis is fixed.
    """
    free = [e for e in range(axes.shape[1]) if e != driven]
    jacobian = tree.jacobian(axes)
    inverse = _inverse(jacobian[:, :, free])
    rates = np.ones((len(axes), axes.shape[1]))
    rates[:, free] = -np.einsum("nij,nj->ni", inverse, jacobian[:, :, driven])
    w = tree.body_rates(axes, rates)
    w = w - w[:, ground : ground + 1]
    turned = cross(w[:, owners], axes)
    second = np.zeros_like(rates)
    bias = np.einsum("nij,nj->ni", tree.jacobian(turned), rates)
    second[:, free] = -np.einsum("nij,nj->ni", inverse, bias)
    dw = tree.body_rates(axes, second) + tree.body_rates(turned, rates)
    dw = dw - dw[:, ground : ground + 1]
    size = np.linalg.norm(jacobian[:, :, free], axis=(1, 2))
    flatness = 1.0 / (np.linalg.norm(inverse, axis=(1, 2)) * size)
    return LinkRates(w, dw, flatness)


@final
@dataclass(frozen=True)
class NullMotion:
    """The motion of a single-freedom part up to its scale.

    `rates` (n, pairs) has unit length; `inverse` (n, pairs, pairs) belongs to the
    equations bordered by it, and gives derivatives; `w` (n, bodies, 3).
    """

    rates: Floats
    inverse: Floats
    w: Floats


def null_motion(tree: LoopTree, axes: Floats) -> NullMotion:
    """Return the null vector of the velocity equations of a part (n, pairs, 3)."""
    jacobian = tree.jacobian(axes)
    n, _, pairs = jacobian.shape
    border = np.broadcast_to(np.cos(1.0 + np.arange(pairs)), (n, pairs))
    for _ in range(2):
        bordered = np.concatenate([jacobian, border[:, None, :]], axis=1)
        inverse = _inverse(bordered)
        rates = inverse[:, :, -1]
        rates = rates / np.linalg.norm(rates, axis=1, keepdims=True)
        border = rates
    return NullMotion(rates, inverse, tree.body_rates(axes, rates))


def null_motion_rate(
    tree: LoopTree, axes: Floats, turned: Floats, motion: NullMotion
) -> Floats:
    """Return the derivative (n, bodies, 3) of `motion.w`, given that of the axes."""
    bias = np.einsum("nij,nj->ni", tree.jacobian(turned), motion.rates)
    second = -np.einsum("nij,nj->ni", motion.inverse[:, :, :-1], bias)
    return tree.body_rates(axes, second) + tree.body_rates(turned, motion.rates)


def rank_mobility(tree: LoopTree, axes: Floats, tolerance: float = 1e-9) -> Floats:
    """Return the nullity (n,) of the velocity equations: the mobility at each sample."""
    values = np.linalg.svd(tree.jacobian(axes), compute_uv=False)
    if values.shape[1] == 0:
        return np.full(len(axes), axes.shape[1])
    rank = np.sum(values > tolerance * values[:, :1], axis=1)
    return np.asarray(axes.shape[1] - rank)


def _inverse(matrices: Floats) -> Floats:
    try:
        return np.asarray(np.linalg.inv(matrices))
    except np.linalg.LinAlgError:
        out = np.full_like(matrices, np.nan)
        for k, matrix in enumerate(matrices):
            try:
                out[k] = np.linalg.inv(matrix)
            except np.linalg.LinAlgError:
                continue
        return out
