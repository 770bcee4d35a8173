"""Velocity equations of all links and what follows from them, by linear algebra.

The unknowns are the angular velocities of all links. No pair variable and no pole occurs,
and no solver of spherekit is called. "Rates" are angular velocities, in rad per rad of the
moving input. An R pair is a revolute pair, a Cr pair a rolling contact and a Cs pair a
sliding contact.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from spherekit.mechanism.joint_construction import make_joints


def revolute_frames(mechanism):
    """Return the frames (pairs, 3, 3) of R pairs in both links, NaN for contact pairs."""
    nothing = np.full((3, 3), np.nan)
    joints = make_joints(mechanism)
    revolute = [joint.has_axis for joint in joints]
    first = [j.first if r else nothing for j, r in zip(joints, revolute, strict=True)]
    second = [j.second if r else nothing for j, r in zip(joints, revolute, strict=True)]
    return np.array(first), np.array(second)


def velocity_equations(ends, axes, types=None, held=()):
    """Return the matrix E of the velocity equations E w = 0 for the rates w of all links.

    Rates are angular velocities. Let w_a and w_b be those of the two links of a pair
    (joint). The rows of a pair say that w_b - w_a has no component

    - perpendicular to the axis of a revolute pair (R),
    - perpendicular to the line to the contact point of a rolling contact (Cr),
    - along the normal of a sliding contact (Cs): the normal of the plane that contains the
      centres of both circles,
    - in any direction if the pair is locked.

    Parameters
    ----------
    ends
        Numbers (a, b) of the two links of each pair.
    axes
        (pairs, 3) unit vectors: axes, lines to contact points, or normals of Cs pairs.
    types
        Types of the pairs; all are R pairs by default.
    held
        Numbers of the pairs that are locked.

    Returns
    -------
    (rows, 3 links) matrix.
    """
    link_count = 1 + max(max(pair) for pair in ends)
    rows = []
    for k, ((a, b), axis) in enumerate(zip(ends, axes, strict=True)):
        if k in held:
            constraint = np.eye(3)
        elif types and types[k] == "Cs":
            constraint = axis[None]
        else:
            constraint = np.eye(3) - np.outer(axis, axis)
        row = np.zeros((len(constraint), 3 * link_count))
        row[:, 3 * b : 3 * b + 3] = constraint
        row[:, 3 * a : 3 * a + 3] = -constraint
        rows.append(row)
    return np.vstack(rows)


def null_space(count, ends, axes, types=None):
    """Return the only motion that the pairs (joints) allow while link 0 is fixed.

    This is an independent reference for velocities. The motion is the right singular vector
    of the smallest singular value of the velocity equations.

    Parameters
    ----------
    count
        Number of links.
    ends, axes, types
        Links (a, b), unit vector and type of each pair, as in `velocity_equations`.

    Returns
    -------
    rates
        (count, 3) angular velocities of the links, of norm 1 altogether; the sign is
        arbitrary.
    gap
        Second smallest singular value over the largest. Near 0 there is a second motion.
    """
    # Without the first three columns, those of link 0, which does not move.
    equations = velocity_equations(ends, axes, types)[:, 3:]
    _, singular_values, right_vectors = np.linalg.svd(equations)
    size = 3 * count - 3
    rates = np.vstack([np.zeros(3), right_vectors[size - 1].reshape(-1, 3)])
    return rates, singular_values[size - 2] / singular_values[0]


def closure_gap(mechanism, rotations, frames):
    """Return the largest angle (rad) between the axis of a joint in its two links.

    With closed loops, both links place the axis in the same direction.

    Parameters
    ----------
    mechanism
        Mechanism whose loops are closed.
    rotations
        (n, links, 3, 3) orientations of the links in the ground frame.
    frames
        Frames of the revolute joints in both links, from `revolute_frames`. Contacts have
        NaN, which is ignored.
    """
    first_frames, second_frames = frames
    largest_gap = 0.0
    for k, (a, b) in enumerate(mechanism.ends):
        first_axis = rotations[:, a] @ first_frames[k, :, 2]
        second_axis = rotations[:, b] @ second_frames[k, :, 2]
        sine = np.linalg.norm(np.cross(first_axis, second_axis), axis=1)
        cosine = np.sum(first_axis * second_axis, axis=1)
        largest_gap = max(largest_gap, float(np.nanmax(np.arctan2(sine, cosine))))
    return largest_gap


def least_misfit(ends, axes, locked, link, reference_link, direction=None):
    """Return how strongly pairs (joints) resist a rotation of a link while some are locked.

    Tests lock the inputs, and compare the measure of singularities of type II with the
    result. The result is 0 if the link can move relative to the reference link although
    the pairs in `locked` are locked. It is 1 if all pairs are locked.

    The velocity equations E w = 0 say which rates w (angular velocities of all links) the
    pairs allow. The misfit of rates w is the norm |E w| of their residuals. The link gets a
    rate of size 1 relative to the reference link. This rate and the rates of all other
    links are those with the least misfit. The least misfit is divided by the least misfit
    with all pairs locked.

    Parameters
    ----------
    ends, axes
        Links (a, b) and axis of each pair, as in `velocity_equations`.
    locked
        Numbers of the locked pairs.
    link, reference_link
        Numbers of the link that turns, and of the link relative to which it turns.
    direction
        Unit vector of a pointer on the link. Rates about it do not move the pointer and are
        not counted. By default all rates are counted.
    """

    def rate_at_unit_misfit(locked_pairs):
        equations = velocity_equations(ends, axes, held=locked_pairs)
        return largest_rate(equations, link, reference_link, direction)

    # The misfit is proportional to the rates. So the least misfit if the rate of the link
    # is 1 is the reciprocal of the largest rate of the link if the misfit is 1.
    all_pairs = range(len(ends))
    return rate_at_unit_misfit(all_pairs) / rate_at_unit_misfit(locked)


def largest_rate(equations, link, reference_link, direction=None):
    """Return the largest angular velocity (rate) of a link, if the misfit |E w| is 1.

    E w = 0 are the velocity equations for the rates w of all links. Let E = U S V^T be the
    singular value decomposition. With e = U^T E w, which has the length 1, the rates are w
    = V S^-1 e. Three rows of V S^-1 give the rate of the link. The largest rate is the
    spectral norm of these rows.

    Parameters
    ----------
    equations
        (rows, 3 links) matrix of `velocity_equations`.
    link, reference_link
        Numbers of the link, and of the link relative to which it turns.
    direction
        Unit vector of a pointer on the link. Only the part of the rate perpendicular to it
        is counted, which moves the pointer. By default the whole rate is counted.
    """
    # The columns of the reference link are left out: it does not move.
    columns = [k for k in range(equations.shape[1]) if k // 3 != reference_link]
    _, singular_values, right_vectors = np.linalg.svd(
        equations[:, columns], full_matrices=False
    )
    columns_of_link = [columns.index(3 * link + k) for k in range(3)]
    rows_of_link = right_vectors[:, columns_of_link].T  # V_link
    if direction is not None:
        # The part of the rate along the pointer is removed.
        part_along_direction = np.outer(direction, direction @ rows_of_link)
        rows_of_link = rows_of_link - part_along_direction
    return np.linalg.norm(rows_of_link / singular_values, 2)


def sine_between_lines(direction, vector):
    """Return the size (n,) of the sine of the angle between two lines."""
    sine = np.linalg.norm(np.cross(direction, vector), axis=-1)
    return sine / (np.linalg.norm(direction, axis=-1) * np.linalg.norm(vector, axis=-1))


def locked_rates(motion, row, moved):
    """Return the angular velocities of all links while some inputs are locked.

    The velocity equations of all pairs are solved by least squares, as an independent
    reference. They are about the relative rate of the two links of a pair:

    - Input: the relative rate is the prescribed one, along its axis. Three equations.
    - Revolute pair (R) or rolling contact (Cr): the part perpendicular to its axis is zero.
      The three components of this part are three equations, of rank two.
    - Sliding contact (Cs): the component along its normal is zero. One equation.

    Parameters
    ----------
    motion, row
        Motion, and number of the row (one sample in one assembly mode).
    moved
        Number of the only input pair that moves, at unit rate, or a mapping from numbers of
        input pairs to their rates.

    Returns
    -------
    rates
        (links, 3) angular velocities in ground axes.
    gap
        Smallest singular value of the equations over the largest: their reciprocal
        condition number. Near 0 the inputs do not determine the motion.
    """
    input_rates = moved if isinstance(moved, dict) else {moved: 1.0}
    mechanism = motion.mechanism
    axes = motion.axes[row]
    types = [pair.type for pair in mechanism.pairs]
    inputs = motion.assembly.inputs
    # The first three columns, of the ground, are left out: it does not move.
    matrix = velocity_equations(mechanism.ends, axes, types, inputs)[:, 3:]
    # Right-hand sides: the relative rate of an input along its axis, otherwise zero.
    relative_rates = []
    for k, pair_type in enumerate(types):
        if k in inputs:
            relative_rates.append(input_rates.get(k, 0.0) * axes[k])
        else:
            relative_rates.append(np.zeros(1 if pair_type == "Cs" else 3))
    singular_values = np.linalg.svd(matrix, compute_uv=False)
    solution = np.linalg.lstsq(matrix, np.concatenate(relative_rates), rcond=None)[0]
    rates = np.vstack([np.zeros(3), solution.reshape(-1, 3)])
    return rates, singular_values[-1] / singular_values[0]


@dataclass(frozen=True)
class LinkRates:
    """Angular velocities of all links in n configurations, while one input moves.

    All other inputs are locked. The angular velocities are the least-squares solution of
    the velocity equations of all pairs (joints), an independent reference for tests.

    Attributes
    ----------
    w
        (n, links, 3) angular velocities in ground axes, per unit rate of the input.
    dw
        (n, links, 3) derivatives of w by the input.
    singular_values
        (n, 3 links - 3) singular values of the equations, largest first.
    residuals
        (n,) largest residual of an equation.
    free_matrix
        (n, rows, 3 links - 3) equations without those that prescribe the moved input. Their
        null vector is the motion at a dead centre, where this input cannot have a rate.
    gaps
        (n,) largest error of a pair: distance between its axis as each of the two links
        places it, or between two circles that should touch. 0 if the loops are closed.
    """

    w: Any
    dw: Any
    singular_values: Any
    residuals: Any
    free_matrix: Any
    gaps: Any


def link_rates(mechanism, rotations, inputs, moved):
    """Return angular velocities of all links and their derivatives by one input.

    The velocity equations of all pairs and their derivative are solved by least squares
    for all rows at once. The inputs other than `moved` are locked. Contacts are external
    ones of circles, whose axis and its change follow from the two centres.

    Parameters
    ----------
    mechanism
        Mechanism of R, Cr and Cs pairs.
    rotations
        (n, links, 3, 3) orientations of the links in the ground frame.
    inputs, moved
        Numbers of all input pairs, and of the one that moves at unit rate.

    Returns
    -------
    LinkRates
    """
    n = len(rotations)
    link_count = len(mechanism.links)
    joints = make_joints(mechanism)
    gaps = np.zeros(n)

    # The line of a pair: its axis in the first link, or the two centres with their weights.
    lines = []
    for joint, pair, (a, b) in zip(joints, mechanism.pairs, mechanism.ends, strict=True):
        if pair.type == "R":
            axis = rotations[:, a] @ joint.first[:, 2]
            axis_in_second = rotations[:, b] @ joint.second[:, 2]
            gaps = np.maximum(gaps, np.linalg.norm(axis - axis_in_second, axis=1))
            lines.append(((1.0, axis, a), None))
            continue
        first_circle, second_circle = pair.profiles
        first_centre = rotations[:, a] @ np.array(first_circle.centre)
        second_centre = rotations[:, b] @ np.array(second_circle.centre)
        r1, r2 = first_circle.radius, second_circle.radius
        distance = np.linalg.norm(first_centre - second_centre, axis=1)
        gaps = np.maximum(gaps, np.abs(distance - 2 * np.sin((r1 + r2) / 2)))
        # The contact point divides the arc r1 + r2 between the centres.
        first_term = (np.sin(r2) / np.sin(r1 + r2), first_centre, a)
        second_term = (np.sin(r1) / np.sin(r1 + r2), second_centre, b)
        lines.append((first_term, second_term))

    # Equations: relative rates that the pairs do not allow, or that the inputs prescribe.
    blocks = []
    prescribed_rates = []
    for k, (pair, (a, b)) in enumerate(zip(mechanism.pairs, mechanism.ends, strict=True)):
        u = _contact_vector(pair.type, lines[k])
        if pair.type == "Cs":
            constraint = u[:, None]
        elif k in inputs:
            constraint = np.broadcast_to(np.eye(3), (n, 3, 3))
        else:
            constraint = np.eye(3) - u[:, :, None] * u[:, None, :]
        block = np.zeros((n, constraint.shape[1], 3 * link_count))
        block[:, :, 3 * b : 3 * b + 3] = constraint
        block[:, :, 3 * a : 3 * a + 3] = -constraint
        blocks.append(block)
        prescribed_rates.append(u if k == moved else np.zeros(constraint.shape[:2]))
    matrix = np.concatenate(blocks, axis=1)[:, :, 3:]
    prescribed = np.concatenate(prescribed_rates, axis=1)
    left_vectors, singular_values, right_vectors = np.linalg.svd(
        matrix, full_matrices=False
    )

    def solve(right_side):
        """Return the link vectors (n, links, 3) of the least-squares solution."""
        scaled = np.einsum("nij,ni->nj", left_vectors, right_side) / singular_values
        solution = np.einsum("nij,ni->nj", right_vectors, scaled)
        with_ground = np.concatenate([np.zeros((n, 3)), solution], axis=1)
        return with_ground.reshape(n, link_count, 3)

    with np.errstate(divide="ignore", invalid="ignore"):
        w = solve(prescribed)
        relative_rates = np.einsum("nij,nj->ni", matrix, w[:, 1:].reshape(n, -1))
        residuals = np.max(np.abs(relative_rates - prescribed), axis=1)

        # Derivative of the equations: the change of the lines at the rates w.
        derivative_terms = []
        for k, (pair, (a, b)) in enumerate(
            zip(mechanism.pairs, mechanism.ends, strict=True)
        ):
            u = _contact_vector(pair.type, lines[k])
            du = _contact_vector_change(pair.type, lines[k], w)
            relative = w[:, b] - w[:, a]
            if pair.type == "Cs":
                derivative_terms.append(-np.sum(du * relative, axis=1)[:, None])
            elif k in inputs and k != moved:
                derivative_terms.append(np.zeros((n, 3)))
            else:
                derivative_terms.append(np.sum(u * relative, axis=1)[:, None] * du)
        dw = solve(np.concatenate(derivative_terms, axis=1))

    # Without its prescribed rate the moved input is an ordinary R pair.
    free_matrix = matrix.copy()
    first_row = sum(block.shape[1] for block in blocks[:moved])
    rows = slice(first_row, first_row + 3)
    u = _contact_vector("R", lines[moved])
    across_axis = np.eye(3) - u[:, :, None] * u[:, None, :]
    free_matrix[:, rows] = across_axis @ free_matrix[:, rows]
    return LinkRates(w, dw, singular_values, residuals, free_matrix, gaps)


def _contact_vector(pair_type, line):
    """Return the unit vector (n, 3) of a pair, for the velocity equations.

    - Revolute pair (R): the axis. The relative angular velocity of the links is along it.
    - Rolling contact of circles (Cr): the unit vector to the contact point. The relative
      angular velocity is along it, too.
    - Sliding contact of circles (Cs): the normal of the plane that contains both centres.
      The relative angular velocity has no component along it.

    Parameters
    ----------
    pair_type
        Type of the pair.
    line
        Two terms (weight, vector (n, 3), link that carries the vector). An R pair has its
        axis with the weight 1, and None. A contact has the centres of both circles, and the
        sum of weights times centres is the unit vector to the contact point.
    """
    (first_weight, first_centre, _), second_term = line
    if second_term is None:
        return first_weight * first_centre
    second_weight, second_centre, _ = second_term
    if pair_type == "Cr":
        return first_weight * first_centre + second_weight * second_centre
    normal = np.cross(first_centre, second_centre)
    return normal / np.linalg.norm(normal, axis=1, keepdims=True)


def _contact_vector_change(pair_type, line, w):
    """Return the derivative (n, 3) of the unit vector that `_contact_vector` computes.

    The caller differentiates the velocity equations with it. The unit vector is the axis of
    a revolute pair (R), points to the contact point of a rolling contact (Cr), or is the
    normal of the plane through both centres of a sliding contact (Cs). A vector c that is
    fixed in a link changes by w x c.

    Parameters
    ----------
    pair_type
        "R", "Cr" or "Cs".
    line
        Two terms (weight, vector (n, 3), link that carries the vector): the axis of an R
        pair and None, or the centres of both circles of a contact. The sum of weights times
        centres is the vector to the contact point.
    w
        (n, links, 3) angular velocities.
    """
    (first_weight, first_centre, a), second_term = line
    first_change = np.cross(w[:, a], first_centre)
    if second_term is None:
        return first_weight * first_change
    second_weight, second_centre, b = second_term
    second_change = np.cross(w[:, b], second_centre)
    if pair_type == "Cr":
        return first_weight * first_change + second_weight * second_change
    normal = np.cross(first_centre, second_centre)
    normal_change = np.cross(first_change, second_centre)
    normal_change = normal_change + np.cross(first_centre, second_change)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    u = normal / length
    # Derivative of a normalized vector: only the part perpendicular to it remains.
    along = np.sum(u * normal_change, axis=1, keepdims=True)
    return (normal_change - u * along) / length
