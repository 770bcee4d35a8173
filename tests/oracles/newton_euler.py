"""Newton's and Euler's equations of all links with all reactions.

They are written without spherekit's dynamics. The unknowns are the angular velocities and
accelerations of all links and the reactions of all pairs, and are solved by least squares.
Only the orientations of links and the frames of contacts are computed by spherekit. Units
are SI. Vectors are in ground axes, and moments are about the centre of the sphere.
"""

from dataclasses import replace

import numpy as np
import pytest

import spherekit as sk
from spherekit.mechanism.inertia import Mass
from spherekit.mechanism.joint_construction import make_joints
from spherekit.positions.loop_closure import Closure


def random_mass(random, link):
    """Return the mass of a link that consists of five random point masses."""
    points = random.normal(size=(5, 3)) * 0.5
    weights = random.uniform(0.2, 2.0, size=5)
    tensor = np.zeros((3, 3))
    for weight, point in zip(weights, points, strict=True):
        tensor += weight * (point @ point * np.eye(3) - np.outer(point, point))
    centre = weights @ points / weights.sum()
    return Mass(
        link,
        tuple(tuple(float(v) for v in row) for row in tensor),
        float(weights.sum()),
        tuple(float(v) for v in centre),
    )


def with_point_masses(name):
    """Return a mechanism without its loads, with random point masses on all moving links.

    `name` is a mechanism or the name of a shipped one. The masses depend on its name only.
    """
    mechanism = sk.load(name) if isinstance(name, str) else name
    random = np.random.default_rng(sum(map(ord, mechanism.name)))
    moving_links = [link for link in mechanism.links if link != mechanism.ground]
    masses = tuple(random_mass(random, link) for link in moving_links)
    return replace(mechanism, masses=masses, loads=())


def with_masses_and_loads(name, random):
    """Return a shipped mechanism with masses on all links and one load of every kind.

    Masses are random. `moments` and `bearing_forces` evaluate exactly these loads by hand.

    Returns
    -------
    mechanism
        Mechanism with masses and loads.
    joint
        Name of the R pair (revolute joint) with motor, spring, damper and friction.
    """
    mechanism = sk.load(name)
    moving = mechanism.links[1:]
    joint = next(p.name for p in reversed(mechanism.pairs) if p.type == "R")
    loads = (
        sk.Gravity("weight", (1.0, -2.0, -9.0)),
        sk.PairTorque("motor", joint, f"2*cos(theta_{joint}) - dtheta_{joint}"),
        # Forces have a link, a point in its axes, three components, and the axes of these.
        sk.PointForce("push", moving[-1], (0.3, -0.2, 0.9), ("1", "2*t", "-1"), "ground"),
        sk.PointForce("pull", moving[0], (0.1, 0.5, 0.4), ("t", "-1", "0.5"), "link"),
        sk.Moment("turn", moving[-1], ("0.3", "t", "1"), "link"),
        # Stiffness 0.7 N m/rad, relaxed at the angle 0.2 rad.
        sk.Spring("coil", joint, 0.7, 0.2),
        # Damping 0.4 N m s/rad.
        sk.Damper("oil", joint, 0.4),
        # Torque -0.6 tanh(rate / 0.5) - 0.1 rate, in N m with the rate in rad/s.
        sk.Friction("rub", joint, 0.6, 0.1, 0.5),
    )
    masses = tuple(random_mass(random, link) for link in moving)
    return replace(mechanism, masses=masses, loads=loads), joint


def newton_euler_arguments(found, row, joint):
    """Return the positional arguments of `newton_euler` for a row of inverse dynamics.

    `newton_euler` is the independent reference. A row is one instant.

    Parameters
    ----------
    found
        Result of `inverse_dynamics`.
    row
        Number of the row.
    joint
        R pair with loads, from `with_masses_and_loads`.
    """
    mechanism = found.mechanism
    values = found.values[row]
    # `mechanism.angles` has the number of the variable of each R pair.
    angle = values[mechanism.angles[joint]]
    dq = found.input_rates[row]
    ddq = found.input_accelerations[row]
    return mechanism, values, angle, found.t[row], dq, ddq, joint


def newton_euler(mechanism, values, angle, t, dq, ddq, joint, full=False, torques=None):
    """Return the torques at the inputs by Euler's equation of every link.

    I alpha + w x (I w) = sum of all moments, for each link about the centre of the sphere.
    Unknown are the reactions of pairs, which are moments about the directions in which a
    pair holds its links, and the torques at the inputs. There are as many equations as
    unknowns if no constraint is redundant; least squares also solves them otherwise.

    Parameters
    ----------
    mechanism
        Mechanism with masses.
    values
        (variables,) configuration, rad.
    angle, joint
        Angle (rad) and name of the R pair with loads, from `with_masses_and_loads`.
    t
        Time, s.
    dq, ddq
        (inputs,) rates and accelerations of the inputs, rad/s and rad/s^2.
    full
        Whether the reactions of all pairs are returned instead.
    torques
        Torques (N m) by pair that replace all loads. By default the loads are those of
        `with_masses_and_loads`.

    Returns
    -------
    (inputs,) torques in N m. If `full`, reactions by pair: of R and Cr pairs about x and y
    of their frame (for contacts tangent and normal), of Cs pairs about the tangent.
    """
    orientations, w, alpha, frames, constraints, drive = link_motions(
        mechanism, values, dq, ddq
    )
    link_count = len(mechanism.links)
    if torques is None:
        applied = moments(mechanism, orientations, w, angle, t, joint)
    else:
        applied = np.zeros((link_count, 3))
        for k, a, b, _, _, axis in frames:
            torque = torques.get(mechanism.pairs[k].name, 0.0)
            applied[b] += torque * axis
            applied[a] -= torque * axis
    inertial = []
    for link in range(1, link_count):
        mass = next(m for m in mechanism.masses if m.link == mechanism.links[link])
        tensor = orientations[link] @ np.array(mass.tensor) @ orientations[link].T
        gyroscopic = np.cross(w[link], tensor @ w[link])
        inertial.append(tensor @ alpha[link] + gyroscopic - applied[link])
    # A row of `constraints` or `drive` takes the angular velocities of all links to the
    # relative rate about one direction of a pair. A unit moment about this direction acts
    # on the links with the same coefficients (virtual work).
    directions = np.vstack([constraints, drive]).T
    reactions = np.linalg.lstsq(directions, np.concatenate(inertial))[0]
    if not full:
        return reactions[-len(drive) :]
    moments_by_pair = {}
    first = 0
    for k, *_ in frames:
        pair = mechanism.pairs[k]
        count = 1 if pair.type == "Cs" else 2
        moments_by_pair[pair.name] = reactions[first : first + count]
        first += count
    return moments_by_pair


def check_simulated_motion(found, drive, grips=(), speed=1.0, within=1e-11, dry=()):
    """Assert that a simulation is a motion under given torques.

    In every time step, (1) variables and rates are the integrals of rates and
    accelerations, by Chebyshev series through 28 nodes, (2) a step begins where the one
    before ends, and (3) at one time Euler's equations of all links need the torques that
    `drive` gives.

    Parameters
    ----------
    found
        Simulation.
    drive
        Function of time and input rates (inputs,) that returns the torques (inputs,) at the
        inputs.
    grips
        The friction of bearings, by pair: the ratio of the friction torque at high speed to
        the moment across the axis. The torque has the additional factor
        tanh(rate / speed).
    speed
        Rate (rad/s) at which friction of bearings has nearly its full size.
    within
        Allowed deviation: rad, rad/s and N m.
    dry
        Friction torques (N m) by pair that do not depend on reactions.
    """
    node_count = 28
    mechanism = found.mechanism
    chebyshev = np.polynomial.chebyshev
    nodes = np.cos(np.pi * (np.arange(node_count) + 0.5) / node_count)

    step_starts = found.path.starts[1:]
    before = found.at(np.nextafter(step_starts, 0.0))
    after = found.at(step_starts)
    ends = np.hstack([before.values, before.input_rates])
    starts = np.hstack([after.values, after.input_rates])
    assert np.allclose(ends, starts, rtol=0.0, atol=within)

    for start, length in zip(found.path.starts, found.path.lengths, strict=True):
        history = found.at(start + 0.5 * length * (nodes + 1.0))
        for rates, integrals in (
            (history.value_rates, history.values),
            (history.input_accelerations, history.input_rates),
        ):
            series = chebyshev.chebfit(nodes, 0.5 * length * rates, node_count - 1)
            gap = chebyshev.chebval(nodes, chebyshev.chebint(series)).T - integrals
            assert np.max(np.abs(gap - gap[0])) < within  # equal but for a constant

        node = 9  # any node inside the step
        time = history.t[node]
        dq = history.input_rates[node]
        ddq = history.input_accelerations[node]
        state = (mechanism, history.values[node], 0.0, time, dq, ddq, "")
        friction_signs = {}
        for pair in (*grips, *dry):
            rate = history.value_rates[node, mechanism.angles[pair]]
            friction_signs[pair] = -np.tanh(rate / speed)
        friction = {pair: dry[pair] * friction_signs[pair] for pair in dry}
        # Reactions depend on the friction of bearings and the reverse: fixed-point steps.
        for _ in range(60 if grips else 0):
            reactions = newton_euler(*state, full=True, torques=friction)
            for pair in grips:
                moment_across = np.hypot(*reactions[pair])
                friction[pair] = grips[pair] * friction_signs[pair] * moment_across
        needed = newton_euler(*state, torques=friction)
        assert needed == pytest.approx(drive(time, dq), abs=within)


def link_motions(mechanism, values, dq, ddq):
    """Return the motion of all links at one configuration, and the directions of its pairs.

    Parameters
    ----------
    mechanism, values
        Mechanism, and its configuration (variables,) in rad.
    dq, ddq
        (inputs,) rates and accelerations of the inputs.

    Returns
    -------
    orientations
        (links, 3, 3) orientations.
    w, alpha
        (links, 3) angular velocities and accelerations.
    frames
        Per pair its number, the numbers of its links, and x, y, z of its frame. For
        contacts these are tangent, normal and contact point.
    constraints
        (rows, 3 links - 3) velocity equations: directions that pairs hold.
    drive
        (inputs, 3 links - 3) rows that take link rates to input rates.
    """
    joints = make_joints(mechanism)
    closure = Closure.of_mechanism(mechanism, joints).linearise(values[None])
    states = closure.states
    orientations = closure.rotations[0]
    link_count = len(mechanism.links)
    frames = []
    for k, (a, b) in enumerate(mechanism.ends):
        frame = orientations[a] @ states.first[0, k]
        frames.append((k, a, b, *frame.T))

    rows = []
    drive_by_pair = {}
    for k, a, b, tangent, normal, point in frames:
        pair = mechanism.pairs[k]
        rows.append(relative_rate_row(link_count, a, b, tangent))
        if pair.type != "Cs":  # a Cs pair lets links turn about the normal too
            rows.append(relative_rate_row(link_count, a, b, normal))
        drive_by_pair[pair.name] = relative_rate_row(link_count, a, b, point)
    constraints = np.array(rows)
    drive = np.array([drive_by_pair[item.pair] for item in mechanism.inputs])
    equations = np.vstack([constraints, drive])

    prescribed = np.append(np.zeros(len(constraints)), dq)
    w = np.linalg.lstsq(equations, prescribed)[0]
    w = np.vstack([np.zeros(3), w.reshape(-1, 3)])

    # Derivative of the equations: their directions move with the first link, and the
    # contact point moves along its profile at the rate s.
    accelerations = []
    for k, a, b, tangent, normal, point in frames:
        k1, k2 = states.curvatures[0, k]
        relative = w[b] - w[a]
        pair_type = mechanism.pairs[k].type
        s = 0.0
        if pair_type == "Cs":
            s = (relative @ point - k2 * relative @ normal) / (k1 - k2)
        elif pair_type == "Cr":
            s = relative @ point / (k1 - k2)
        is_contact = pair_type != "R"
        tangent_change = np.cross(w[a], tangent) + s * (k1 * normal - point) * is_contact
        accelerations.append(-tangent_change @ relative)
        if pair_type != "Cs":
            normal_change = np.cross(w[a], normal) - s * k1 * tangent * is_contact
            accelerations.append(-normal_change @ relative)
    alpha = np.linalg.lstsq(equations, np.append(accelerations, ddq))[0]
    alpha = np.vstack([np.zeros(3), alpha.reshape(-1, 3)])
    return orientations, w, alpha, frames, constraints, drive


def relative_rate_row(link_count, a, b, vector):
    """Return the row (3 links - 3,) that takes link rates to (w_b - w_a) . vector."""
    row = np.zeros((link_count, 3))
    row[b] = vector
    row[a] = -vector
    return row[1:].ravel()


def moments(mechanism, orientations, w, angle, t, joint):
    """Return the moments (links, 3) of the loads of `with_masses_and_loads`, in N m.

    They are about the centre of the sphere, in ground axes. The equations of motion of this
    reference use them. They are written by hand, load by load, independently of spherekit.
    Numbers are those of the loads in `with_masses_and_loads`: 0.7 N m/rad is the stiffness
    of the spring, for example.

    Parameters
    ----------
    mechanism
        Mechanism with these loads.
    orientations
        (links, 3, 3) rotations from link axes to ground axes.
    w
        (links, 3) angular velocities in ground axes, rad/s.
    angle, joint
        Angle (rad) and name of the R pair with motor, spring, damper and friction.
    t
        Time, s.
    """
    number = mechanism.link_number
    last = number[mechanism.links[-1]]
    first = number[mechanism.links[1]]
    total = np.zeros((len(mechanism.links), 3))
    for mass in mechanism.masses:
        link = number[mass.link]
        centre = orientations[link] @ np.array(mass.centre)
        weight = mass.mass * np.array([1.0, -2.0, -9.0])
        total[link] += np.cross(centre, weight)
    arm = orientations[last] @ np.array([0.3, -0.2, 0.9])
    total[last] += np.cross(arm, [1.0, 2.0 * t, -1.0])  # push
    pull_in_link = np.cross([0.1, 0.5, 0.4], [t, -1.0, 0.5])
    total[first] += orientations[first] @ pull_in_link  # pull
    total[last] += orientations[last] @ np.array([0.3, t, 1.0])  # turn

    pair = mechanism.pair_number[joint]
    a, b = mechanism.ends[pair]
    # The z column of this frame is the axis of the pair, in the axes of its first link.
    frame_in_first_link = make_joints(mechanism)[pair].first
    axis = orientations[a] @ frame_in_first_link[:, 2]
    rate = (w[b] - w[a]) @ axis
    motor = 2.0 * np.cos(angle) - rate
    spring = -0.7 * (angle - 0.2)
    damper = -0.4 * rate
    friction = -0.6 * np.tanh(rate / 0.5) - 0.1 * rate
    torque = motor + spring + damper + friction
    total[b] += torque * axis
    total[a] -= torque * axis
    return total


def bearing_forces(mechanism, values, angle, t, dq, ddq, joint, sides=None):
    """Return the forces on bearings and contacts, with each link as a free body.

    Each link satisfies Newton's equation, and Euler's equation about its centre of mass. No
    link is held at the centre of the sphere. An R pair has two bearings. Each bearing is a
    point at which the pair holds its links together across the axis. The bearing whose
    `axial` is 1 also holds them along the axis. A contact pushes at its distance from the
    centre of the sphere. Teeth push along the normal of a flank and do not pull.

    Parameters
    ----------
    mechanism, values, angle, t, dq, ddq, joint
        As in `newton_euler`; the loads include `sk.Bearings` for all R pairs.
    sides
        +1 or -1 for the flank that carries the load, by pair of toothed wheels.

    Returns
    -------
    forces
        (3,) forces in N, in ground axes, of the first link on the second. Keys are (load of
        the bearings, number of the bearing) or (pair, 0) for contacts; (pair, "torque")
        holds the torque vector of an input.
    undetermined
        Number of forces that the equations do not determine.
    residual
        Largest residual of the equations.
    """
    orientations, w, alpha, frames, _, _ = link_motions(mechanism, values, dq, ddq)
    number = mechanism.link_number
    link_count = len(mechanism.links)
    gravity = np.array([1.0, -2.0, -9.0])

    # Right sides (links, 6): inertia minus loads, force first, then moment.
    centres = np.zeros((link_count, 3))
    right_sides = np.zeros((link_count, 6))
    for mass in mechanism.masses:
        k = number[mass.link]
        c = orientations[k] @ np.array(mass.centre)
        m = mass.mass
        tensor = orientations[k] @ np.array(mass.tensor) @ orientations[k].T
        tensor = tensor - m * (c @ c * np.eye(3) - np.outer(c, c))  # parallel axes
        acceleration = np.cross(alpha[k], c) + np.cross(w[k], np.cross(w[k], c))
        centres[k] = c
        right_sides[k, :3] = m * (acceleration - gravity)
        right_sides[k, 3:] = tensor @ alpha[k] + np.cross(w[k], tensor @ w[k])

    last = number[mechanism.links[-1]]
    first = number[mechanism.links[1]]
    push_point = orientations[last] @ [0.3, -0.2, 0.9]
    push_force = np.array([1.0, 2.0 * t, -1.0])
    pull_point = orientations[first] @ [0.1, 0.5, 0.4]
    pull_force = orientations[first] @ [t, -1.0, 0.5]
    for k, point, force in (
        (last, push_point, push_force),
        (first, pull_point, pull_force),
    ):
        right_sides[k, :3] -= force
        right_sides[k, 3:] -= np.cross(point - centres[k], force)

    # The other loads are couples: all moments less those of the two forces.
    without_weight = replace(mechanism, masses=(), loads=())
    couples = moments(without_weight, orientations, w, angle, t, joint)
    couples[last] -= np.cross(push_point, push_force)
    couples[first] -= orientations[first] @ np.cross([0.1, 0.5, 0.4], [t, -1.0, 0.5])
    right_sides[:, 3:] -= couples

    # One column (6 links - 6,) per unknown: the effect of a unit force on both links.
    columns = []
    unknowns = []

    def add_force(a, b, point, vector, key):
        rows = np.zeros((link_count, 6))
        for k, sign in ((b, 1.0), (a, -1.0)):
            rows[k] += sign * np.append(vector, np.cross(point - centres[k], vector))
        columns.append(rows[1:].ravel())
        unknowns.append((key, vector))

    bearings = {x.pair: x for x in mechanism.loads if isinstance(x, sk.Bearings)}
    input_pairs = [item.pair for item in mechanism.inputs]
    for k, a, b, x, y, z in frames:
        pair = mechanism.pairs[k]
        if pair.type == "R":
            load = bearings[pair.name]
            for n, (position, is_axial) in enumerate(
                zip(load.positions, load.axial, strict=True)
            ):
                for vector in (x, y, z) if is_axial else (x, y):
                    add_force(a, b, position * z, vector, (load.name, n))
        elif pair.pressure_angle is not None:
            # Normal to the flank: y of the pair points to the side of the first wheel.
            vector = sides[pair.name] * x - np.tan(pair.pressure_angle) * y
            add_force(a, b, pair.distance * z, vector, (pair.name, 0))
        else:
            for vector in (y,) if pair.type == "Cs" else (x, y):
                add_force(a, b, pair.distance * z, vector, (pair.name, 0))
        if pair.name in input_pairs:
            rows = np.zeros((link_count, 6))
            rows[b, 3:] = z
            rows[a, 3:] = -z
            columns.append(rows[1:].ravel())
            unknowns.append(((pair.name, "torque"), z))

    matrix = np.array(columns).T
    right_side = right_sides[1:].ravel()
    sizes = np.linalg.lstsq(matrix, right_side)[0]
    undetermined = matrix.shape[1] - np.linalg.matrix_rank(matrix)
    forces = {key: np.zeros(3) for key, _ in unknowns}
    for size, (key, vector) in zip(sizes, unknowns, strict=True):
        forces[key] = forces[key] + size * vector
    residual = np.max(np.abs(matrix @ sizes - right_side))
    return forces, undetermined, residual
