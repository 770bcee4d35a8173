"""What links need and what loads give: moments about the centre O, and forces through it.

A wrench (6,) is a moment about O (N m) and then a force (N), in ground axes. O is at rest,
so a body with the tensor I about O, the mass m and its centre of mass at c needs

    I a + w x I w    and    m (a x c + w x (w x c)),

two sums of one form: a linear map of a, and w times that of w.
"""

import numpy as np

from spherekit.dynamics.forces import Loads, rates_by_time
from spherekit.dynamics.kinematics import CoordinateMotion
from spherekit.model.mechanism import Mechanism
from spherekit.motion.timing import Timing
from spherekit.sphere.rotation import Floats, cross, transpose


def accelerating(mechanism: Mechanism, motion: CoordinateMotion, change: Floats) -> Floats:
    """Return the wrenches (n, links, 6) that the coordinates' accelerations (n, m) need.

    Forces of links whose centre of mass is not known are left out.
    """
    return _of_inertia(mechanism, motion, np.einsum("ni,nila->nla", change, motion.w))


def gyroscopic(mechanism: Mechanism, motion: CoordinateMotion, speed: Floats) -> Floats:
    """Return those (n, links, 6) that rates (n, m) need while these stay as they are."""
    w = np.einsum("ni,nila->nla", speed, motion.w)
    bend = np.einsum("ni,nk,nikla->nla", speed, speed, motion.dw)
    wrenches = _of_inertia(mechanism, motion, bend)
    momenta = _of_inertia(mechanism, motion, w)
    for half in (slice(0, 3), slice(3, 6)):
        wrenches[..., half] += cross(w, momenta[..., half])
    return wrenches


def _of_inertia(mechanism: Mechanism, motion: CoordinateMotion, vectors: Floats) -> Floats:
    """Return I v and m v x c of the links' vectors v (n, links, 3), in ground axes."""
    wrenches = np.zeros((*vectors.shape[:2], 6))
    for mass in mechanism.masses:
        link = mechanism.link_number[mass.link]
        turn, vector = motion.rotations[:, link], vectors[:, link]
        tensor = turn @ np.array(mass.tensor) @ transpose(turn)
        wrenches[:, link, :3] = (tensor @ vector[..., None])[..., 0]
        if mass.mass is not None and mass.centre is not None:
            wrenches[:, link, 3:] = mass.mass * cross(vector, turn @ np.array(mass.centre))
    return wrenches


def applied(
    mechanism: Mechanism,
    motion: CoordinateMotion,
    timing: Timing,
    torques: Floats,
    carried: Floats | None,
) -> tuple[Floats, Floats]:
    """Return the wrenches of loads on links (n, links, 6), and torques at pairs (n, pairs).

    With the drives' `torques` (n, inputs); `carried` as of `Loads.magnitudes`.
    """
    loads = Loads(mechanism)
    rates = rates_by_time(motion, timing.dq)
    magnitudes = loads.magnitudes(motion.values, rates, timing.t, carried)
    wrenches = np.zeros((len(timing.t), len(mechanism.links), 6))
    about = np.zeros((len(timing.t), len(mechanism.pairs)))
    for k, part in enumerate(loads.components):
        if part.pair:
            about[:, mechanism.pair_number[part.pair]] += magnitudes[:, k]
        for moment in part.moments:
            link = mechanism.link_number[moment.link]
            turn = motion.rotations[:, link]
            vector = np.broadcast_to(np.array(moment.direction), (len(turn), 3))
            if moment.axes == "link":
                vector = (turn @ vector[..., None])[..., 0]
            vector = magnitudes[:, k, None] * vector
            if moment.arm is not None:
                wrenches[:, link, 3:] += vector
                vector = cross(turn @ np.array(moment.arm), vector)
            wrenches[:, link, :3] += vector
    for k, item in enumerate(mechanism.inputs):
        about[:, mechanism.pair_number[item.pair]] += torques[:, k]
    return wrenches, about
