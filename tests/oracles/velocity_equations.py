"""Independent ways to the same numbers; nothing here calls a solver of spherekit."""

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
    """Return the matrix that takes the rates of all links to what pairs do not allow.

    w_b - w_a has no component across a pair's axis, of a Cs pair along its normal, and of
    a pair that is held none at all.
    """
    count, rows = 1 + max(max(pair) for pair in ends), []
    for k, ((a, b), u) in enumerate(zip(ends, axes, strict=True)):
        across = u[None] if types and types[k] == "Cs" else np.eye(3) - np.outer(u, u)
        across = np.eye(3) if k in held else across
        rows.append(np.zeros((len(across), 3 * count)))
        rows[-1][:, 3 * b : 3 * b + 3], rows[-1][:, 3 * a : 3 * a + 3] = across, -across
    return np.vstack(rows)


def null_space(count, ends, axes, types=None):
    """Return link rates (count, 3) with |w| = 1 in all, and the relative gap.

    One link fixed, singular value decomposition; the gap is the second smallest singular
    value over the largest.
    """
    _, values, right = np.linalg.svd(velocity_equations(ends, axes, types)[:, 3:])
    size = 3 * count - 3
    w = np.vstack([np.zeros(3), right[size - 1].reshape(-1, 3)])
    return w, values[size - 2] / values[0]


def closure_gap(mechanism, rotations, frames):
    """Return the largest misalignment (rad) of a pair's axis between its two links."""
    first, second = frames
    worst = 0.0
    for k, (a, b) in enumerate(mechanism.ends):
        one = rotations[:, a] @ first[k, :, 2]
        other = rotations[:, b] @ second[k, :, 2]
        sine = np.linalg.norm(np.cross(one, other), axis=1)
        worst = max(worst, float(np.nanmax(np.arctan2(sine, np.sum(one * other, axis=1)))))
    return worst


def least_misfit(ends, axes, locked, link, of, direction=None):
    """Return the least misfit for a unit rate of a link relative to another.

    All pairs locked it is 1. From link rates: the rows of the inverse of the equations
    that the link's rate has, by singular values; turning about a direction does not count.
    """

    def turned(held):
        rows = velocity_equations(ends, axes, held=held)
        kept = [k for k in range(rows.shape[1]) if k // 3 != of]
        _left, sizes, right = np.linalg.svd(rows[:, kept], full_matrices=False)
        own = [kept.index(3 * link + k) for k in range(3)]
        part = right[:, own].T
        if direction is not None:
            part = part - np.outer(direction, direction @ part)
        return np.linalg.norm(part / sizes, 2)

    return turned(range(len(ends))) / turned(locked)


def sine_between_lines(direction, vector):
    """Return the angle-like distance (n,) of lines along two vectors: |sin|."""
    sine = np.linalg.norm(np.cross(direction, vector), axis=-1)
    return sine / (np.linalg.norm(direction, axis=-1) * np.linalg.norm(vector, axis=-1))


def locked_rates(motion, row, moved):
    """Return link rates (count, 3) of one row while inputs move, and the relative gap.

    `moved` is the number of the only input pair that moves, at unit rate, or a mapping
    from input pairs to their rates. The velocity equations of R, Cr and Cs pairs, with
    the rate of every input given, by least squares.
    """
    rates = moved if isinstance(moved, dict) else {moved: 1.0}
    made, axes = motion.mechanism, motion.axes[row]
    types, held = [pair.type for pair in made.pairs], motion.assembly.inputs
    matrix = velocity_equations(made.ends, axes, types, held)[:, 3:]
    right = [
        rates.get(k, 0.0) * axes[k] if k in held else np.zeros(1 if kind == "Cs" else 3)
        for k, kind in enumerate(types)
    ]
    values = np.linalg.svd(matrix, compute_uv=False)
    found = np.linalg.lstsq(matrix, np.concatenate(right), rcond=None)[0]
    return np.vstack([np.zeros(3), found.reshape(-1, 3)]), values[-1] / values[0]


def link_rates(mechanism, rotations, inputs, moved):
    """Return w and dw (n, links, 3) of links in ground axes per unit rate of an input.

    The velocity equations of all pairs and their derivative, solved by least squares for
    all rows at once; the inputs other than `moved` stand still. `rotations` (n, links, 3,
    3). Contacts are external ones of circles: their line and its change follow from the
    two centres. Also returned: the singular values of the equations (n, 3 links - 3),
    the largest entry that the equations leave over (n,), the equations without the
    moved input's own (n, rows, 3 links - 3), and the largest miss (n,) of any pair.
    """
    n, count = len(rotations), len(mechanism.links)
    joints = make_joints(mechanism)
    rows, right, pairs, missed = [], [], [], np.zeros(n)
    for k, (pair, (a, b)) in enumerate(zip(mechanism.pairs, mechanism.ends, strict=True)):
        if pair.type == "R":
            line = (1.0, rotations[:, a] @ joints[k].first[:, 2], a), None
            other = rotations[:, b] @ joints[k].second[:, 2]
            missed = np.maximum(missed, np.linalg.norm(line[0][1] - other, axis=1))
        else:
            circles = pair.profiles
            centres = [
                rotations[:, link] @ np.array(circle.centre)
                for link, circle in zip((a, b), circles, strict=True)
            ]
            r1, r2 = (circle.radius for circle in circles)
            apart = np.linalg.norm(centres[0] - centres[1], axis=1)
            missed = np.maximum(missed, np.abs(apart - 2 * np.sin((r1 + r2) / 2)))
            line = (
                (np.sin(r2) / np.sin(r1 + r2), centres[0], a),
                (np.sin(r1) / np.sin(r1 + r2), centres[1], b),
            )
        pairs.append((pair.type, a, b, line))
        u = _line(pair.type, line)
        if pair.type == "Cs":
            across = u[:, None]
        elif k in inputs:
            across = np.broadcast_to(np.eye(3), (n, 3, 3))
        else:
            across = np.eye(3) - u[:, :, None] * u[:, None, :]
        block = np.zeros((n, across.shape[1], 3 * count))
        block[:, :, 3 * b : 3 * b + 3] = across
        block[:, :, 3 * a : 3 * a + 3] = -across
        rows.append(block)
        right.append(u if k == moved else np.zeros(across.shape[:2]))
    matrix = np.concatenate(rows, axis=1)[:, :, 3:]
    one, values, two = np.linalg.svd(matrix, full_matrices=False)
    with np.errstate(divide="ignore", invalid="ignore"):

        def solved(sides):
            found = np.einsum("nij,ni->nj", one, sides) / values
            flat = np.einsum("nij,ni->nj", two, found)
            return np.concatenate([np.zeros((n, 3)), flat], axis=1).reshape(n, count, 3)

        w = solved(np.concatenate(right, axis=1))
        left = np.einsum("nij,nj->ni", matrix, w[:, 1:].reshape(n, -1))
        over = np.max(np.abs(left - np.concatenate(right, axis=1)), axis=1)
        bias = []
        for k, (kind, a, b, line) in enumerate(pairs):
            u, du = _line(kind, line), _line_change(kind, line, w)
            relative = w[:, b] - w[:, a]
            if kind == "Cs":
                bias.append(-np.sum(du * relative, axis=1)[:, None])
            elif k in inputs and k != moved:
                bias.append(np.zeros((n, 3)))
            else:
                bias.append(np.sum(u * relative, axis=1)[:, None] * du)
        dw = solved(np.concatenate(bias, axis=1))
    free = matrix.copy()
    at = sum(block.shape[1] for block in rows[:moved])
    u = _line("R", pairs[moved][3])
    keep = np.eye(3) - u[:, :, None] * u[:, None, :]
    free[:, at : at + 3] = keep @ free[:, at : at + 3]
    return w, dw, values, over, free, missed


def _line(kind, line):
    """Return the unit vector of a pair: an axis, of Cs what it does not turn about."""
    (s1, c1, _), second = line
    if second is None:
        return s1 * c1
    s2, c2, _ = second
    if kind == "Cr":
        return s1 * c1 + s2 * c2
    normal = np.cross(c1, c2)
    return normal / np.linalg.norm(normal, axis=1, keepdims=True)


def _line_change(kind, line, w):
    (s1, c1, a), second = line
    d1 = np.cross(w[:, a], c1)
    if second is None:
        return s1 * d1
    s2, c2, b = second
    d2 = np.cross(w[:, b], c2)
    if kind == "Cr":
        return s1 * d1 + s2 * d2
    normal, change = np.cross(c1, c2), np.cross(d1, c2) + np.cross(c1, d2)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    u = normal / length
    return (change - u * np.sum(u * change, axis=1, keepdims=True)) / length
