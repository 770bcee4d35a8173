"""The pairs of a configuration: their frames, and how their variables move links.

An R pair has one variable, the angle about its axis; a rolling contact one arc length
that runs along both profiles; a sliding contact one arc length for each profile. The
frame (tangent t, normal n, point p) of a profile with geodesic curvature k moves with its
arc length by dp/ds = t, dt/ds = k n - p, dn/ds = -k t.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import EQUAL_CURVATURE
from spherekit.model.geometry import Joint, Revolute
from spherekit.sphere.rotation import Floats, arc, cross, transpose


@final
@dataclass(frozen=True)
class PairStates:
    """The pairs of n samples as their variables have them.

    `first`, `second`: (n, pairs, 3, 3) frames in the axes of the pair's two bodies, which
    coincide in space. `curvatures`, `curvature_rates`: (n, pairs, 2) of the two profiles
    and their derivatives by arc length, zero for R pairs. `inside`: (n, pairs) whether
    the contact lies on both profiles.
    """

    first: Floats
    second: Floats
    curvatures: Floats
    curvature_rates: Floats
    inside: NDArray[np.bool_]


def turns_of(
    ends: Sequence[tuple[int, int]], joints: Sequence[Revolute], placed: Floats
) -> tuple[Floats, Floats]:
    """Return the variables (n, pairs) rad of R pairs between placed links, and gaps.

    `ends` are the numbers of each pair's links, `placed` (n, links, 3, 3) the orientations
    of these; a gap (n, pairs) rad is the angle between the axes of a pair in its links.
    """
    values, gaps = [], []
    for (a, b), joint in zip(ends, joints, strict=True):
        one, other = placed[:, a] @ joint.first, placed[:, b] @ joint.second
        between = transpose(one) @ other
        values.append(np.arctan2(between[:, 1, 0], between[:, 0, 0]))
        gaps.append(arc(one[..., 2], other[..., 2]))
    return np.stack(values, axis=1), np.stack(gaps, axis=1)


def pair_states(joints: Sequence[Joint], values: Floats) -> PairStates:
    """Return the states of pairs for variables (n, variables)."""
    n, pairs = len(values), len(joints)
    first, second = np.empty((n, pairs, 3, 3)), np.empty((n, pairs, 3, 3))
    curvatures, rates = np.zeros((n, pairs, 2)), np.zeros((n, pairs, 2))
    inside = np.ones((n, pairs), dtype=bool)
    turning: list[tuple[int, int, Revolute]] = []
    at = 0
    for k, joint in enumerate(joints):
        if isinstance(joint, Revolute):
            turning.append((k, at, joint))
            at += 1
            continue
        last = at if joint.rolling else at + 1
        offset = joint.start if joint.rolling else (0.0, 0.0)
        one = joint.first.at(np.nan_to_num(values[:, at]) + offset[0])
        other = joint.second.at(np.nan_to_num(values[:, last]) + offset[1])
        first[:, k], second[:, k] = one.frame, other.frame
        curvatures[:, k, 0], curvatures[:, k, 1] = one.curvature, other.curvature
        rates[:, k, 0], rates[:, k, 1] = one.curvature_rate, other.curvature_rate
        inside[:, k] = one.inside & other.inside
        at = last + 1
    if turning:
        every = len(turning) == pairs
        which = slice(None) if every else [k for k, _, _ in turning]
        angle = values[:, [v for _, v, _ in turning], None]
        frame = np.array([joint.first for _, _, joint in turning])
        c, s = np.cos(angle), np.sin(angle)
        turned = first if every else np.empty((n, len(turning), 3, 3))
        turned[..., 0] = c * frame[..., 0] + s * frame[..., 1]
        turned[..., 1] = c * frame[..., 1] - s * frame[..., 0]
        turned[..., 2] = frame[..., 2]
        if not every:
            first[:, which] = turned
        second[:, which] = np.array([joint.second for _, _, joint in turning])
    return PairStates(first, second, curvatures, rates, inside)


def variable_vectors(joints: Sequence[Joint], frames: Floats, curvatures: Floats) -> Floats:
    """Return the vectors (n, variables, 3) of all variables.

    `frames` (n, pairs, 3, 3) are the pair frames in the axes wanted, `curvatures` as in
    `PairStates`. With t, n, p the tangent, normal and point of a contact and k1, k2 the
    curvatures: the axis (R); (k1 - k2) p (Cr); n + k1 p and -(n + k2 p) (Cs).
    """
    if all(isinstance(joint, Revolute) for joint in joints):
        return np.ascontiguousarray(frames[..., 2])
    vectors = []
    for k, joint in enumerate(joints):
        normal, point = frames[:, k, :, 1], frames[:, k, :, 2]
        k1, k2 = curvatures[:, k, :1], curvatures[:, k, 1:]
        if isinstance(joint, Revolute):
            vectors.append(point)
        elif joint.rolling:
            vectors.append((k1 - k2) * point)
        else:
            vectors += [normal + k1 * point, -(normal + k2 * point)]
    return np.stack(vectors, axis=1)


@final
@dataclass(frozen=True)
class PairRates:
    """First derivatives at the pairs: of the variables' vectors and of the pair axes.

    `vectors` (n, variables, 3); `axes` (n, pairs, 3), see `pair_axes`.
    """

    vectors: Floats
    axes: Floats


def pair_axes(joints: Sequence[Joint], frames: Floats) -> Floats:
    """Return (n, pairs, 3): axis (R), contact line (Cr), normal of contact plane (Cs)."""
    column = [2 if isinstance(joint, Revolute) or joint.rolling else 0 for joint in joints]
    return np.stack([frames[:, k, :, c] for k, c in enumerate(column)], axis=1)


def pair_rates(
    joints: Sequence[Joint],
    frames: Floats,
    states: PairStates,
    first_w: Floats,
    second_w: Floats,
) -> PairRates:
    """Return how vectors and axes change, given the rates of the pairs' two links.

    `first_w`, `second_w` (n, pairs, 3) are angular velocities of the links in the axes
    that `frames` (n, pairs, 3, 3) are given in. The contact moves along the profiles at
    s1' = (w . p - k2 w . n) / (k1 - k2) and s2' = (w . p - k1 w . n) / (k1 - k2), w the
    relative angular velocity (derived from the frames' own derivatives).
    """
    if all(isinstance(joint, Revolute) for joint in joints):
        turned = cross(first_w, frames[..., 2])
        return PairRates(turned, turned)
    vectors, axes = [], []
    for k, joint in enumerate(joints):
        w1, w2 = first_w[:, k], second_w[:, k]
        tangent, normal, point = (frames[:, k, :, c] for c in range(3))
        if isinstance(joint, Revolute):
            turned = cross(w1, point)
            vectors.append(turned)
            axes.append(turned)
            continue
        k1, k2 = states.curvatures[:, k, :1], states.curvatures[:, k, 1:]
        dk1, dk2 = states.curvature_rates[:, k, :1], states.curvature_rates[:, k, 1:]
        relative = w2 - w1
        along_p = np.sum(relative * point, axis=1, keepdims=True)
        along_n = np.sum(relative * normal, axis=1, keepdims=True)
        if joint.rolling:
            along_n = np.zeros_like(along_n)
        s1 = (along_p - k2 * along_n) / (k1 - k2)
        s2 = (along_p - k1 * along_n) / (k1 - k2)
        moved = cross(w1, point) + s1 * tangent
        if joint.rolling:
            vectors.append((dk1 - dk2) * s1 * point + (k1 - k2) * moved)
            axes.append(moved)
        else:
            vectors.append(cross(w1, normal + k1 * point) + s1 * dk1 * point)
            vectors.append(-cross(w2, normal + k2 * point) - s2 * dk2 * point)
            axes.append(cross(w1, tangent) + s1 * (k1 * normal - point))
    return PairRates(np.stack(vectors, axis=1), np.stack(axes, axis=1))


def penetrates(joints: Sequence[Joint], states: PairStates) -> NDArray[np.bool_]:
    """Return (n,) whether a contact's profiles curve into each other, or alike."""
    contact = [not isinstance(joint, Revolute) for joint in joints]
    relative = states.curvatures[:, contact, 0] - states.curvatures[:, contact, 1]
    return np.asarray(np.any(relative < EQUAL_CURVATURE, axis=1))
