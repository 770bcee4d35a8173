"""Angular velocities straight from the loop-closure velocity equations.

The independent route beside the pole axes: exact wherever the mechanism has a unique
motion, whatever its topology. It solves irreducible parts, takes over from the plan at
configurations where that is badly conditioned, and gives mobility by rank.
"""

from dataclasses import dataclass, replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import EPS
from spherekit.motion.closure import Closure
from spherekit.motion.loops import LoopTree, left_inverse
from spherekit.motion.motion import Motion
from spherekit.sphere.rotation import Floats

INCONSISTENT = 1e-10
"""Velocity or acceleration equations that leave over more, relatively, have no solution."""
NEARLY_FLAT = 1e-3
"""Equations flatter than this are solved once more beside, to see what rounding does."""
PROBES = 3
"""Roundings of the equations at random from which their effect is estimated."""
TRUSTED_CHANGE = 1e-3
"""Rates, or derivatives, that rounding of the configuration changes by more are lost."""


@final
@dataclass(frozen=True)
class LinkRates:
    """First and second derivatives by the motion's parameter of a set of bodies.

    `w`, `dw`: (n, bodies, 3) angular velocity relative to body 0 and its derivative;
    `flatness`: (n,) reciprocal condition of the equations, 0 where rounding of the
    configuration leaves nothing of the rates or of their derivatives; `slack`: (n, probes,
    bodies, 3), where known: changes of w under roundings of the equations at random.
    """

    w: Floats
    dw: Floats
    flatness: Floats
    slack: Floats | None = None


def driven_rates(motion: Motion, rows: NDArray[np.bool_], driven: int) -> LinkRates:
    """Return the rates of links relative to the ground, per unit rate of one input.

    `rows` (n,) says which rows of the motion are wanted, `driven` is the number of the
    input pair that moves; the other inputs stand still.
    """
    motion = motion.rows(rows)
    w, dw, inverse, flatness, slack = _driven(motion, driven)
    near = flatness < NEARLY_FLAT
    if np.any(near):
        beside = _off_by_rounding(motion.rows(near), inverse[near])
        moved_w, moved_dw, *_ = _driven(beside, driven)
        change = np.fmax(_changed(w[near], moved_w), _changed(dw[near], moved_dw))
        flatness[near] = np.where(change <= TRUSTED_CHANGE, flatness[near], 0.0)
    return LinkRates(w, dw, flatness, slack)


def _held(motion: Motion) -> list[int]:
    """Return the numbers of the inputs' variables."""
    return [motion.mechanism.variables_of(pair)[0] for pair in motion.assembly.inputs]


def _off_by_rounding(motion: Motion, inverse: Floats) -> Motion:
    """Return a motion off where rounding shows most in its variables.

    `inverse` (n, free variables, equations) is that of the closure equations.
    """
    held = _held(motion)
    free = [v for v in range(motion.values.shape[1]) if v not in held]
    left, sizes, _ = np.linalg.svd(np.nan_to_num(inverse), full_matrices=False)
    values = motion.values.copy()
    values[:, free] += EPS * sizes[:, :1] * left[:, :, 0]
    placed, _ = Closure.of(motion.mechanism, motion.joints).place(values)
    return replace(motion, values=values, rotations=placed)


def _changed(vectors: Floats, moved: Floats) -> Floats:
    """Return the largest change (n,) of vectors (n, bodies, 3), relative to the largest."""
    size = np.max(np.linalg.norm(vectors, axis=2), axis=1)
    change = np.max(np.linalg.norm(moved - vectors, axis=2), axis=1)
    return np.asarray(change / np.maximum(size, 1.0))


def _driven(motion: Motion, driven: int) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Return w, dw, the inverse of the closure equations, their flatness, and the slack."""
    tree = LoopTree.of(motion.mechanism)
    (moved,) = motion.mechanism.variables_of(driven)
    held = _held(motion)
    vectors = motion.vectors
    free = [v for v in range(vectors.shape[1]) if v not in held]
    jacobian = tree.jacobian(vectors)
    matrix = jacobian[:, :, free]
    inverse = left_inverse(matrix)
    rates = np.zeros((len(vectors), vectors.shape[1]))
    rates[:, moved] = 1.0
    rates[:, free], over = _solved(matrix, inverse, -jacobian[:, :, moved])
    w = tree.body_rates(vectors, rates)
    first, second = (w[:, [pair[k] for pair in tree.ends]] for k in (0, 1))
    turned = motion.rates_of_pairs(first, second).vectors
    change = np.zeros_like(rates)
    bias = np.einsum("nij,nj->ni", tree.jacobian(turned), rates)
    change[:, free], bent = _solved(matrix, inverse, -bias)
    dw = tree.body_rates(vectors, change) + tree.body_rates(turned, rates)
    size = np.linalg.norm(matrix, axis=(1, 2))
    # An open chain whose pairs are all driven has no equations, and nothing to lose.
    flatness = np.ones(len(w))
    if free:
        flatness = 1.0 / (np.linalg.norm(inverse, axis=(1, 2)) * size)
    # Redundant constraints may admit a velocity, but no motion that goes on with it.
    flatness[~(np.maximum(over, bent) < INCONSISTENT)] = 0.0
    rounding = np.einsum("nij,nj->ni", np.abs(matrix), np.abs(rates[:, free]))
    rounding = EPS * (rounding + np.abs(jacobian[:, :, moved]))
    slack = np.empty((len(w), PROBES, *w.shape[1:]))
    for probe, signs in enumerate(_signs(matrix.shape[1])):
        change = np.zeros_like(rates)
        change[:, free] = np.einsum("nij,nj->ni", inverse, rounding * signs)
        slack[:, probe] = tree.body_rates(vectors, change)
    return w, dw, inverse, flatness, slack


def _signs(count: int) -> Floats:
    """Return (probes, count) signs at random, the same every time."""
    return np.random.default_rng(count).choice([-1.0, 1.0], (PROBES, count))


def _solved(matrix: Floats, inverse: Floats, right: Floats) -> tuple[Floats, Floats]:
    """Return x (n, k) with matrix x = right, and what is left over (n,), relative.

    The product with an inverse loses digits where x is small beside the inverse; two
    steps of iterative refinement bring them back (Higham 2002, section 12.1).
    """
    found = np.einsum("nij,nj->ni", inverse, right)
    for _ in range(2):
        left = right - np.einsum("nij,nj->ni", matrix, found)
        found = found + np.einsum("nij,nj->ni", inverse, left)
    left = np.linalg.norm(right - np.einsum("nij,nj->ni", matrix, found), axis=1)
    scale = np.linalg.norm(right, axis=1) + np.linalg.norm(found, axis=1)
    return found, left / np.maximum(scale, 1.0)


@final
@dataclass(frozen=True)
class NullMotion:
    """The motion of a single-freedom part up to its scale.

    `rates` (n, variables) has unit length; `inverse` (n, variables, variables) is of the
    equations bordered by them, and gives derivatives; `w` (n, bodies, 3).
    """

    rates: Floats
    inverse: Floats
    w: Floats


def null_motion(tree: LoopTree, vectors: Floats) -> NullMotion:
    """Return the null vector of a part's velocity equations, vectors (n, variables, 3)."""
    jacobian = tree.jacobian(vectors)
    n, _, count = jacobian.shape
    border = np.broadcast_to(np.cos(1.0 + np.arange(count)), (n, count))
    for _ in range(2):
        bordered = np.concatenate([jacobian, border[:, None, :]], axis=1)
        inverse = left_inverse(bordered)
        rates = inverse[:, :, -1]
        rates = rates / np.linalg.norm(rates, axis=1, keepdims=True)
        border = rates
    return NullMotion(rates, inverse, tree.body_rates(vectors, rates))


def null_second_rates(tree: LoopTree, turned: Floats, motion: NullMotion) -> Floats:
    """Return the derivative (n, variables) of `motion.rates` by arc length.

    `turned` (n, variables, 3) is that of the variables' vectors.
    """
    bias = np.einsum("nij,nj->ni", tree.jacobian(turned), motion.rates)
    return np.asarray(-np.einsum("nij,nj->ni", motion.inverse[:, :, :-1], bias))


def null_motion_rate(
    tree: LoopTree, vectors: Floats, turned: Floats, motion: NullMotion
) -> Floats:
    """Return the derivative (n, bodies, 3) of `motion.w`, given that of the vectors."""
    second = null_second_rates(tree, turned, motion)
    return tree.body_rates(vectors, second) + tree.body_rates(turned, motion.rates)
