"""Configurations in which two links stand still, by Newton's method in 50 digits.

This is independent of spherekit. The unknowns are the rotations and rates of all links, not
the variables of pairs. The equations say that the axis of each pair has the same direction
in both of its links.
"""

from typing import NamedTuple

import mpmath as mp
import numpy as np
from oracles.velocity_equations import revolute_frames

DIGITS = 50
STEPS = 12
wide = np.frompyfunc(mp.mpf, 1, 1)
root = np.frompyfunc(mp.sqrt, 1, 1)


class Rest(NamedTuple):
    """Configuration and rates in which two links rest relative to each other.

    It is the result of Newton's method in 50 digits for the rotations and rates (angular
    velocities) of all links. The equations are: the axis of each pair has the same
    direction in both links, the links turn about it only, and one component of the relative
    rate of the two links is zero. The equations do not demand that its other components are
    zero. `relative_rate` shows whether they are, and so whether the links rest. The size of
    all rates is fixed, because rates of zero would always be a solution.

    Tests compare it with a singularity found by spherekit, from which Newton's method
    starts.

    Attributes
    ----------
    rotation_change
        Largest change of an element of the link rotations by Newton's method. It is the
        error of the configuration from which the method started.
    residual
        Largest residual of these equations at the end of Newton's method.
    relative_rate
        Largest component of the rate of one of the two links relative to the other. It is 0
        if they rest.
    rates
        (links, 3) rates of all links at the end, in ground axes.
    """

    rotation_change: float
    residual: float
    relative_rate: float
    rates: np.ndarray


def exact_rest(mechanism, rotations, w, links, along):
    """Find the nearest configuration in which two links rest relative to each other.

    For each pair between links a and b, with its axis u in a and v in b, the equations are
    R_a u = R_b v and (w_b - w_a) x R_a u = 0. Two more fix the size of the rates and make
    the relative rate of `links` zero along one vector. The residual is evaluated in 50
    digits; the Jacobian by differences, and the steps by least squares in float64.

    Parameters
    ----------
    mechanism
        Mechanism of R pairs.
    rotations, w
        (links, 3, 3) orientations and (links, 3) rates of the links to start from.
    links
        Numbers of the two links.
    along
        (3,) direction of the component of their relative rate that is made zero: the
        derivative of the relative rate along the configuration curve.

    Returns
    -------
    Rest
    """
    with mp.workdps(DIGITS):
        first_frames, second_frames = revolute_frames(mechanism)
        first_axes = _unit_rows(wide(first_frames[:, :, 2]))
        second_axes = _unit_rows(wide(second_frames[:, :, 2]))
        link_a, link_b = links
        a, b = np.array(mechanism.ends).T
        turns = wide(rotations)
        rates = wide(w)
        along = wide(along)
        for _ in range(3):  # orthonormal in 50 digits
            turns = turns @ (3 * wide(np.eye(3)) - np.swapaxes(turns, 1, 2) @ turns) / 2
        start = turns
        start_rates = rates

        def residual(turns, rates):
            axes = (turns[a] @ first_axes[..., None])[..., 0]
            axes_in_second = (turns[b] @ second_axes[..., None])[..., 0]
            slip = np.cross(rates[b] - rates[a], axes)
            size_change = np.sum(start_rates * (rates - start_rates))
            rate_along = np.sum(along * (rates[link_a] - rates[link_b]))
            gaps = (axes - axes_in_second).ravel()
            return np.concatenate([gaps, slip.ravel(), [size_change, rate_along]])

        def take_step(turns, rates, step):
            """Apply a step (2, links - 1, 3) of rotation vectors and rates."""
            moved = [_about(x) @ r for x, r in zip(step[0], turns[1:], strict=True)]
            ground = np.zeros((1, 3), dtype=int)
            return np.stack([turns[0], *moved]), rates + np.concatenate([ground, step[1]])

        step_shape = (2, len(turns) - 1, 3)
        unit_steps = np.eye(6 * (len(turns) - 1)).reshape(-1, *step_shape)
        small = mp.mpf(10) ** -20
        slopes = [
            residual(*take_step(turns, rates, small * wide(x))) - residual(turns, rates)
            for x in unit_steps
        ]
        jacobian = (np.array(slopes) / small).astype(float).T
        inverse = np.linalg.pinv(jacobian, rcond=1e-10)
        for _ in range(STEPS):
            gap = residual(turns, rates)
            largest_gap = np.max(np.abs(gap))
            if largest_gap < mp.mpf(10) ** (4 - DIGITS):
                break
            # Scaled by its size, the residual fits into float64.
            step = -(inverse @ (gap / largest_gap).astype(float)) * largest_gap
            turns, rates = take_step(turns, rates, step.reshape(step_shape))
        return Rest(
            rotation_change=float(np.max(np.abs(turns - start))),
            residual=float(largest_gap),
            relative_rate=float(np.max(np.abs(rates[link_a] - rates[link_b]))),
            rates=rates.astype(float),
        )


def _unit_rows(vectors):
    """Return vectors (n, 3) divided by their lengths, in 50 digits."""
    return vectors / root(np.sum(vectors * vectors, axis=1, keepdims=True))


def _about(x):
    """Return the rotation matrix of a rotation vector (3,)."""
    angle = mp.sqrt(np.sum(x * x))
    if not angle:
        return wide(np.eye(3))
    n = np.cross(wide(np.eye(3)), -x / angle)
    return wide(np.eye(3)) + mp.sin(angle) * n + (1 - mp.cos(angle)) * (n @ n)
