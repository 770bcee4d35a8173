"""Newton's and Euler's equations of all links with all reactions, written by themselves."""

from dataclasses import replace

import numpy as np
import pytest

import spherekit as sk
from spherekit.mechanism.inertia import Mass
from spherekit.mechanism.joint_construction import make_joints
from spherekit.positions.loop_closure import Closure


def random_mass(random, link):
    """Return the mass of a link made of five points in and about the unit sphere."""
    points = random.normal(size=(5, 3)) * 0.5
    weights = random.uniform(0.2, 2.0, size=5)
    tensor = sum(
        m * (r @ r * np.eye(3) - np.outer(r, r))
        for m, r in zip(weights, points, strict=True)
    )
    centre = weights @ points / weights.sum()
    return Mass(
        link,
        tuple(tuple(float(v) for v in row) for row in tensor),
        float(weights.sum()),
        tuple(float(v) for v in centre),
    )


def with_point_masses(name):
    """Return a (shipped) mechanism without its loads, five points of mass in each link."""
    made = sk.load(name) if isinstance(name, str) else name
    random = np.random.default_rng(sum(map(ord, made.name)))
    masses = tuple(random_mass(random, link) for link in made.links if link != made.ground)
    return replace(made, masses=masses, loads=())


def with_masses_and_loads(name, random):
    """Return a shipped mechanism with masses on all links and loads of many kinds."""
    mechanism = sk.load(name)
    moving = mechanism.links[1:]
    joint = next(p for p in reversed(mechanism.pairs) if p.type == "R")
    loads = (
        sk.Gravity("weight", (1.0, -2.0, -9.0)),
        sk.PairTorque(
            "motor", joint.name, f"2*cos(theta_{joint.name}) - dtheta_{joint.name}"
        ),
        sk.PointForce("push", moving[-1], (0.3, -0.2, 0.9), ("1", "2*t", "-1"), "ground"),
        sk.PointForce("pull", moving[0], (0.1, 0.5, 0.4), ("t", "-1", "0.5"), "link"),
        sk.Moment("turn", moving[-1], ("0.3", "t", "1"), "link"),
        sk.Spring("coil", joint.name, 0.7, 0.2),
        sk.Damper("oil", joint.name, 0.4),
        sk.Friction("rub", joint.name, 0.6, 0.1, 0.5),
    )
    masses = tuple(random_mass(random, link) for link in moving)
    return replace(mechanism, masses=masses, loads=loads), joint.name


def row_of_torques(found, row, joint):
    """Return what the functions below take, of a row of torques that were found."""
    made, values = found.mechanism, found.values[row]
    moved = found.input_rates[row], found.input_accelerations[row]
    return made, values, values[made.angles[joint]], found.t[row], *moved, joint


def newton_euler(mechanism, values, angle, t, dq, ddq, joint, full=False, torques=None):
    """Return the torques (m,) at the inputs from the equations of all links with reactions.

    `dq` and `ddq` (m,) are those of the inputs. The loads are those of `loaded`, or
    `torques` at pairs alone. Angular velocities of all links are the
    unknowns; no pair variable is differentiated. `full` gives by pair the reactions about
    the directions that it holds: of R pairs x and y of its frame, of contacts the tangent
    and, where they do not slide, the normal.
    """
    turns, w, alpha, plans, A, drive = link_motions(mechanism, values, dq, ddq)
    count = len(mechanism.links)
    if torques is None:
        applied = moments(mechanism, turns, w, angle, t, joint)
    else:
        applied = np.zeros((count, 3))
        for k, a, b, _, _, axis in plans:
            size = torques.get(mechanism.pairs[k].name, 0.0)
            applied[b], applied[a] = applied[b] + size * axis, applied[a] - size * axis
    right = []
    for link in range(1, count):
        mass = next(m for m in mechanism.masses if m.link == mechanism.links[link])
        tensor = turns[link] @ np.array(mass.tensor) @ turns[link].T
        spin = np.cross(w[link], tensor @ w[link])
        right.append(tensor @ alpha[link] + spin - applied[link])
    reactions = np.linalg.lstsq(np.vstack([A, drive]).T, np.concatenate(right))[0]
    if not full:
        return reactions[-len(drive) :]
    moments_by_pair, at = {}, 0
    for k, *_ in plans:
        held = 1 if mechanism.pairs[k].type == "Cs" else 2
        moments_by_pair[mechanism.pairs[k].name] = reactions[at : at + held]
        at += held
    return moments_by_pair


def check_simulated_motion(found, drive, grips=(), speed=1.0, within=1e-11, dry=()):
    """Hold a simulation to be the motion under torques at its inputs.

    In each step its variables and rates are integrals of its rates and accelerations, at
    which links that pairs hold together need the torques that `drive` gives of a time and
    the rates of the inputs; steps begin where those before them end. Bearings at pairs rub
    by what these `grips` make of the moment across, and `dry` (N m) at others whatever
    that is.
    """
    count, made, chebyshev = 28, found.mechanism, np.polynomial.chebyshev
    nodes = np.cos(np.pi * (np.arange(count) + 0.5) / count)
    after = found.path.starts[1:]
    joined = (found.at(t) for t in (np.nextafter(after, 0.0), after))
    ends, starts = (np.hstack([x.values, x.input_rates]) for x in joined)
    assert np.allclose(ends, starts, rtol=0.0, atol=within)
    for start, length in zip(found.path.starts, found.path.lengths, strict=True):
        t = start + 0.5 * length * (nodes + 1.0)
        history = found.at(t)
        for rates, values in (
            (history.value_rates, history.values),
            (history.input_accelerations, history.input_rates),
        ):
            series = chebyshev.chebfit(nodes, 0.5 * length * rates, count - 1)
            gap = chebyshev.chebval(nodes, chebyshev.chebint(series)).T - values
            assert np.max(np.abs(gap - gap[0])) < within
        moving = history.input_rates[9], history.input_accelerations[9]
        state = made, history.values[9], 0.0, t[9], *moving, ""
        slowed = {
            pair: -np.tanh(history.value_rates[9, made.angles[pair]] / speed)
            for pair in (*grips, *dry)
        }
        rubbing = {pair: dry[pair] * slowed[pair] for pair in dry}
        for _ in range(60 if grips else 0):
            held = newton_euler(*state, full=True, torques=rubbing)
            for pair in grips:
                rubbing[pair] = grips[pair] * slowed[pair] * np.hypot(*held[pair])
        needed = newton_euler(*state, torques=rubbing)
        assert needed == pytest.approx(drive(t[9], moving[0]), abs=within)


def link_motions(mechanism, values, dq, ddq):
    """Return turns, angular velocities and accelerations of all links, and the pairs.

    Of each pair its number, links and frame; then the equations of velocities, and what the
    inputs turn about.
    """
    joints = make_joints(mechanism)
    at = Closure.of_mechanism(mechanism, joints).at(values[None])
    placed, states = at.rotations, at.states
    turns, count = placed[0], len(mechanism.links)
    rows, rates, drives = [], [], {}
    plans = []
    for k, (a, b) in enumerate(mechanism.ends):
        frame = turns[a] @ states.first[0, k]
        plans.append((k, a, b, *frame.T))
    for k, a, b, tangent, normal, point in plans:
        kind = mechanism.pairs[k].type
        for vector in (tangent,) if kind == "Cs" else (tangent, normal):
            rows.append(spread(count, a, b, vector))
        drives[mechanism.pairs[k].name] = spread(count, a, b, point)
    A = np.array(rows)
    drive = np.array([drives[item.pair] for item in mechanism.inputs])
    w = np.linalg.lstsq(np.vstack([A, drive]), np.append(np.zeros(len(A)), dq))[0]
    w = np.vstack([np.zeros(3), w.reshape(-1, 3)])
    for k, a, b, tangent, normal, point in plans:
        k1, k2 = states.curvatures[0, k]
        relative = w[b] - w[a]
        kind, s = mechanism.pairs[k].type, 0.0
        if kind == "Cs":
            s = (relative @ point - k2 * relative @ normal) / (k1 - k2)
        elif kind == "Cr":
            s = relative @ point / (k1 - k2)
        moved = np.cross(w[a], tangent) + s * (k1 * normal - point) * (kind != "R")
        rates.append(-moved @ relative)
        if kind != "Cs":
            turned = np.cross(w[a], normal) - s * k1 * tangent * (kind != "R")
            rates.append(-turned @ relative)
    alpha = np.linalg.lstsq(np.vstack([A, drive]), np.append(rates, ddq))[0]
    alpha = np.vstack([np.zeros(3), alpha.reshape(-1, 3)])
    return turns, w, alpha, plans, A, drive


def spread(count, a, b, vector):
    row = np.zeros((count, 3))
    row[b], row[a] = vector, -vector
    return row[1:].ravel()


def moments(mechanism, turns, w, angle, t, joint):
    """Return the moments (links, 3) of the loads of `loaded` about the centre."""
    number = mechanism.link_number
    last, first = number[mechanism.links[-1]], number[mechanism.links[1]]
    found = np.zeros((len(mechanism.links), 3))
    for mass in mechanism.masses:
        link = number[mass.link]
        arm = turns[link] @ np.array(mass.centre)
        found[link] += np.cross(arm, mass.mass * np.array([1.0, -2.0, -9.0]))
    arm = turns[last] @ np.array([0.3, -0.2, 0.9])
    found[last] += np.cross(arm, [1.0, 2.0 * t, -1.0])
    arm = np.cross([0.1, 0.5, 0.4], [t, -1.0, 0.5])
    found[first] += turns[first] @ arm
    found[last] += turns[last] @ np.array([0.3, t, 1.0])
    pair = mechanism.pair_number[joint]
    a, b = mechanism.ends[pair]
    axis = turns[a] @ make_joints(mechanism)[pair].first[:, 2]
    rate = (w[b] - w[a]) @ axis
    torque = 2.0 * np.cos(angle) - rate - 0.7 * (angle - 0.2) - 0.4 * rate
    torque -= 0.6 * np.tanh(rate / 0.5) + 0.1 * rate
    found[b] += torque * axis
    found[a] -= torque * axis
    return found


def bearing_forces(mechanism, values, angle, t, dq, ddq, joint, sides=None):
    """Return the forces on bearings and contacts of links that nothing holds at O.

    Every R pair has two bearings, each a point that holds its links together across the
    axis, the one with `axial` 1 along it too; contacts hold theirs at their distance. So
    each link is a free body with Newton's equation and Euler's about its centre of mass.
    Teeth push along the normal of a flank, which has +1 or -1 in `sides`, and do not pull.
    The forces (3,) in ground axes are of the first link on the second, by pair, or by the
    load of the bearings and the number of the bearing; then how many are not determined,
    and what misses the equations.
    """
    turns, w, alpha, plans, _, _ = link_motions(mechanism, values, dq, ddq)
    number, count = mechanism.link_number, len(mechanism.links)
    centres, right = np.zeros((count, 3)), np.zeros((count, 6))
    weight = np.array([1.0, -2.0, -9.0])
    for mass in mechanism.masses:
        k = number[mass.link]
        c, m = turns[k] @ np.array(mass.centre), mass.mass
        tensor = turns[k] @ np.array(mass.tensor) @ turns[k].T
        tensor = tensor - m * (c @ c * np.eye(3) - np.outer(c, c))
        faster = np.cross(alpha[k], c) + np.cross(w[k], np.cross(w[k], c))
        centres[k] = c
        right[k, :3] = m * (faster - weight)
        right[k, 3:] = tensor @ alpha[k] + np.cross(w[k], tensor @ w[k])
    last, first = number[mechanism.links[-1]], number[mechanism.links[1]]
    for k, place, force in (
        (last, turns[last] @ [0.3, -0.2, 0.9], np.array([1.0, 2.0 * t, -1.0])),
        (first, turns[first] @ [0.1, 0.5, 0.4], turns[first] @ [t, -1.0, 0.5]),
    ):
        right[k, :3] -= force
        right[k, 3:] -= np.cross(place - centres[k], force)
    couples = moments(replace(mechanism, masses=(), loads=()), turns, w, angle, t, joint)
    couples[last] -= np.cross(turns[last] @ [0.3, -0.2, 0.9], [1.0, 2.0 * t, -1.0])
    couples[first] -= turns[first] @ np.cross([0.1, 0.5, 0.4], [t, -1.0, 0.5])
    right[:, 3:] -= couples
    bearings = {x.pair: x for x in mechanism.loads if isinstance(x, sk.Bearings)}
    columns, meant = [], []

    def column(a, b, place, vector, key):
        rows = np.zeros((count, 6))
        for k, sense in ((b, 1.0), (a, -1.0)):
            rows[k] += sense * np.append(vector, np.cross(place - centres[k], vector))
        columns.append(rows[1:].ravel())
        meant.append((key, vector))

    for k, a, b, x, y, z in plans:
        pair = mechanism.pairs[k]
        if pair.type == "R":
            load = bearings[pair.name]
            for n, (at, share) in enumerate(zip(load.positions, load.axial, strict=True)):
                for vector in (x, y, z) if share else (x, y):
                    column(a, b, at * z, vector, (load.name, n))
        elif pair.pressure_angle is not None:
            # Normal to the flank: y of the pair points to the side of the first wheel.
            vector = sides[pair.name] * x - np.tan(pair.pressure_angle) * y
            column(a, b, pair.distance * z, vector, (pair.name, 0))
        else:
            for vector in (y,) if pair.type == "Cs" else (x, y):
                column(a, b, pair.distance * z, vector, (pair.name, 0))
        if pair.name in [item.pair for item in mechanism.inputs]:
            rows = np.zeros((count, 6))
            rows[b, 3:], rows[a, 3:] = z, -z
            columns.append(rows[1:].ravel())
            meant.append(((pair.name, "torque"), z))
    matrix = np.array(columns).T
    sizes = np.linalg.lstsq(matrix, right[1:].ravel())[0]
    rank = np.linalg.matrix_rank(matrix)
    forces = {key: np.zeros(3) for key, _ in meant}
    for size, (key, vector) in zip(sizes, meant, strict=True):
        forces[key] = forces[key] + size * vector
    missed = np.max(np.abs(matrix @ sizes - right[1:].ravel()))
    return forces, matrix.shape[1] - rank, missed
