"""The equation of motion along the configuration curve.

The state is the pair variables v, the speed u of travel along the curve, and the work of
each load: dv/dt = u dv/ds, B du/dt = Q - 1/2 dB/ds u^2, dW/dt = Q u, with s the arc length
(Di Gregorio 2024, eq. (9), in the coordinate s). It is regular at every dead centre.
"""

from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.dynamics.forces import Loads
from spherekit.dynamics.inertia import Inertia, inertia
from spherekit.dynamics.kinematics import CoordinateMotion, by_arc_length, continued
from spherekit.model.mechanism import Mechanism
from spherekit.motion.closure import Closure
from spherekit.sphere.rotation import Floats


@final
@dataclass(frozen=True)
class Dynamics:
    """Motion, inertia and generalised forces at n states, with the coordinate s.

    `speed` (n,) is u, `acceleration` (n,) du/dt, `forces` (n, loads) the Q of each load.
    """

    motion: CoordinateMotion
    inertia: Inertia
    forces: Floats
    speed: Floats
    acceleration: Floats


@final
class EquationOfMotion:
    """Rates of the state (n, variables + 1 + loads) of one mechanism with its loads."""

    def __init__(self, mechanism: Mechanism, closure: Closure) -> None:
        self.mechanism = mechanism
        self.closure = closure
        self.loads = Loads(mechanism)
        self.variables = len(mechanism.variable_names)

    def state(self, values: Floats, speed: float) -> Floats:
        """Return the state (states,) at the start, where no work has been done."""
        return np.concatenate([values, [speed], np.zeros(len(self.loads.names))])

    def at(self, t: Floats, states: Floats, along: Floats) -> Dynamics:
        """Return what acts at successive times t (n,), the first tangent towards `along`.

        With `along` (n, variables), each tangent points to the side of its own row.
        """
        motion = self.motion(states[:, : self.variables], along)
        return self.acting(motion, states[:, self.variables], t)

    def motion(self, values: Floats, along: Floats) -> CoordinateMotion:
        """Return the motion by arc length at pair variables (n, variables)."""
        motion = by_arc_length(self.closure, values)
        if along.ndim == 1:
            return motion.turned(continued(motion.rates, along))
        side = np.sum(along * motion.rates, axis=1)
        return motion.turned(np.where(side < 0.0, -1.0, 1.0))

    def acting(self, motion: CoordinateMotion, speed: Floats, t: Floats) -> Dynamics:
        """Return inertia and forces of a motion at these speeds and times (n,)."""
        found = inertia(self.mechanism, motion)
        forces = self.loads.parts(motion, speed, t)
        drive = np.sum(forces, axis=1) - 0.5 * found.dB * speed**2
        with np.errstate(divide="ignore", invalid="ignore"):
            acceleration = drive / found.B
        return Dynamics(motion, found, forces, speed, acceleration)

    def rates(self, found: Dynamics) -> Floats:
        """Return the rates of the states (n, states)."""
        speed = found.speed[:, None]
        return np.concatenate(
            [
                found.motion.rates * speed,
                found.acceleration[:, None],
                found.forces * speed,
            ],
            axis=1,
        )
