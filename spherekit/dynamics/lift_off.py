"""Ends simulations at the time at which a one-sided contact would have to pull."""

from dataclasses import dataclass, replace

import numpy as np

from spherekit.arrays import Floats
from spherekit.dynamics.simulated_path import STATES_PER_BLOCK
from spherekit.dynamics.simulation import Event, Simulation
from spherekit.dynamics.simulation_end import SimulationEnd
from spherekit.errors import SolveError
from spherekit.tolerances import MAX_SIMULATED_PULL

PROBES_PER_STEP = 8
"""Number of times in each step at which the pushes of contacts are computed.

Larger: more time. Smaller: a contact that lifts off for a short time is missed.
"""

FIRST_LIFT_OFF_STEPS = 8
"""Number of first steps whose largest reaction is a lower limit of the scale for pulls.

A contact lifts off if its pull is not small compared with this scale. Smaller: if a
mechanism starts without reactions, their rounding ends the simulation.
"""

LIFT_OFF_TOLERANCE_S = 1e-14
"""Tolerance of the time at which a contact lifts off."""


@dataclass(frozen=True)
class ContactPushes:
    """The forces with which one-sided contacts press or pull, at n times.

    A one-sided contact can only press. If it would have to pull, its links lift off.

    Attributes
    ----------
    pushes
        (n, contacts) force along the normal times the radius, N m. Negative if a contact
        pulls.
    largest_reaction
        (n,) largest component of any moment that a pair transmits, N m. A pull that is very
        small compared with it counts as a rounding error.
    """

    pushes: Floats
    largest_reaction: Floats


def end_at_lift_off(simulation: Simulation) -> Simulation:
    """Return a simulation up to the time at which a one-sided contact would have to pull.

    At this time the links would lift off. If no one-sided contact would have to pull, the
    simulation is returned unchanged. Pushes are computed at some times of each step, so
    short pulls between these times can be missed. A push that is not determined does not
    end the simulation.

    Raises
    ------
    SolveError
        If a contact would have to pull at the start.
    """
    mechanism = simulation.mechanism
    one_sided = [k for k, pair in enumerate(mechanism.pairs) if pair.one_sided]
    if not one_sided:
        return simulation
    # Some times of each step, and the end.
    path = simulation.path
    fractions = np.arange(PROBES_PER_STEP) / PROBES_PER_STEP
    t = (path.starts[:, None] + fractions * path.lengths[:, None]).ravel()
    t = np.append(t[t < simulation.end.t], simulation.end.t)

    def compute_pushes(t: Floats) -> ContactPushes:
        """Return the pushes of the one-sided contacts at times (n,), s."""
        moments = simulation.moments(t).moments
        # The first component of a contact's moment is the force along its normal times the
        # radius.
        return ContactPushes(
            pushes=moments[:, one_sided, 0],
            largest_reaction=np.fmax.reduce(np.abs(moments), axis=(1, 2)),
        )

    blocks = [
        compute_pushes(block) for block in np.array_split(t, 1 + len(t) // STATES_PER_BLOCK)
    ]
    # (n, contacts)
    pushes = np.concatenate([block.pushes for block in blocks])
    reactions = np.concatenate([block.largest_reaction for block in blocks])
    # A pull is compared with the largest reaction so far. The first steps always count.
    scale = np.fmax.accumulate(reactions)
    scale = np.maximum(scale, scale[: FIRST_LIFT_OFF_STEPS * PROBES_PER_STEP][-1])
    is_pulling = pushes < -MAX_SIMULATED_PULL * scale[:, None]
    pulling_rows = np.flatnonzero(np.any(is_pulling, axis=1))
    if not len(pulling_rows):
        return simulation
    # The first time at which contacts pull, and these contacts.
    row = pulling_rows[0]
    contacts = np.flatnonzero(is_pulling[row]).tolist()
    if row == 0:
        name = mechanism.pairs[one_sided[contacts[0]]].name
        raise SolveError(
            f"{mechanism.name}: contact {name}, which is one_sided, would have to pull at "
            "the start; press it together with a spring, start more slowly, or leave "
            "one_sided out"
        )
    from scipy.optimize import brentq

    def find_lift_off(contact: int) -> float:
        """Return the time at which the push of a contact vanishes.

        It lies between the first time at which contacts pull and the time before.
        """
        if not pushes[row - 1, contact] > 0.0:
            return float(t[row - 1])
        zero = brentq(
            lambda x: compute_pushes(np.array([x])).pushes[0, contact],
            t[row - 1],
            t[row],
            xtol=LIFT_OFF_TOLERANCE_S,
        )
        return float(zero)

    # The contact that lifts off first ends the simulation.
    times = [find_lift_off(contact) for contact in contacts]
    lift_off_time = min(times)
    name = mechanism.pairs[one_sided[contacts[times.index(lift_off_time)]]].name
    end = SimulationEnd(
        "lift_off",
        lift_off_time,
        f"contact {name} lifts off: it would have to pull to keep its links together; "
        "press it together with a spring, or move more slowly",
    )
    inputs = tuple(simulation.at([lift_off_time]).inputs[0].tolist())
    events = [event for event in simulation.events if event.t <= lift_off_time]
    events.append(Event("lift_off", lift_off_time, inputs, name))
    return replace(simulation, events=tuple(events), end=end)
