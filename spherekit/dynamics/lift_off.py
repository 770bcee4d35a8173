"""Where a one-sided contact of a simulation would have to pull: there it lifts off."""

from dataclasses import replace

import numpy as np

from spherekit.dynamics.simulation import Event, Simulation, SimulationEnd
from spherekit.errors import SolveError
from spherekit.sphere.rotation import Floats

PLACES = 8
"""Places in each step at which contacts are looked at."""

PULLS = 1e-9
"""A contact pulls where it does so by more than this part of the largest reaction."""


def until_lift_off(simulation: Simulation, pressed: float) -> Simulation:
    """Return a simulation as far as all one-sided contacts press.

    Up to the time `pressed` (s), the end of a step, they are known to.

    Raises
    ------
    SolveError
        If one would have to pull from the start.
    """
    mechanism = simulation.mechanism
    pairs = [k for k, pair in enumerate(mechanism.pairs) if pair.one_sided]
    path = simulation.path
    late = path.starts >= pressed
    parts = np.arange(PLACES) / PLACES
    t = (path.starts[late, None] + parts * path.lengths[late, None]).ravel()
    t = np.append(t[t < simulation.end.t], simulation.end.t)

    def pushes(t: Floats) -> tuple[Floats, float]:
        moments = simulation.moments(t).moments
        return moments[:, pairs, 0], float(np.nanmax(np.abs(moments)))

    push, size = pushes(t)
    rows = np.flatnonzero(np.any(push < -PULLS * size, axis=1))
    if not len(rows):
        return simulation
    row = int(rows[0])
    which = int(np.argmin(push[row]))
    name = mechanism.pairs[pairs[which]].name
    if row == 0 and pressed == 0.0:
        raise SolveError(
            f"{mechanism.name}: contact {name} would have to pull at the start, and is "
            "one_sided: press it with a spring, start more slowly, or leave one_sided out"
        )
    from scipy.optimize import brentq

    low, high = float(t[max(row - 1, 0)]), float(t[row])
    when = low
    if row and push[row - 1, which] > 0.0:
        when = brentq(lambda x: pushes(np.array([x]))[0][0, which], low, high, xtol=1e-14)
    end = SimulationEnd(
        "lift_off",
        float(when),
        f"contact {name} lifts off: it would have to pull to keep its links together; "
        "press it with a spring, or move more slowly",
    )
    inputs = simulation.at([when]).inputs[0].tolist()
    before = tuple(event for event in simulation.events if event.t <= when)
    event = Event("lift_off", float(when), tuple(inputs), name)
    return replace(simulation, events=(*before, event), end=end)
