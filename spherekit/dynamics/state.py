"""The equation of motion along the configuration curve.

The state is the pair variables v, the momentum p = sqrt(B) u, with u = ds/dt the speed
along the curve, and the work W of each load. Eksergian's equation in the arc length s,
B du/dt + 1/2 dB/ds u^2 = Q (Di Gregorio 2024, eq. (9)), is then

    dv/dt = u dv/ds,   dp/dt = Q / sqrt(B),   dW/dt = Q u,   u = p / sqrt(B),

for dp/dt = (B du/dt + 1/2 dB/ds u^2) / sqrt(B). The kinetic energy is p^2 / 2, and p is
constant where no load acts; it is the rate of the arc length in the metric of the kinetic
energy. No derivative of B is needed, and every dead centre is an ordinary point.
"""

from dataclasses import dataclass, replace
from typing import final

import numpy as np

from spherekit.dynamics.forces import Loads
from spherekit.dynamics.inertia import equivalent_inertia
from spherekit.dynamics.kinematics import CoordinateMotion, by_arc_length, continued
from spherekit.model.mechanism import Mechanism
from spherekit.motion.closure import Closure
from spherekit.sphere.rotation import Floats


@final
@dataclass(frozen=True)
class Dynamics:
    """Motion, inertia and generalised forces at n states, with the coordinate s.

    `motion` is of the first order; `B` (n,) is by s, `forces` (n, loads) the Q of each
    load, `speed` (n,) is u.
    """

    motion: CoordinateMotion
    B: Floats
    forces: Floats
    speed: Floats


@final
class EquationOfMotion:
    """Rates of the state (n, variables + 1 + loads) of one mechanism with its loads."""

    def __init__(self, mechanism: Mechanism, closure: Closure) -> None:
        self.mechanism = mechanism
        self.closure = closure
        self.loads = Loads(mechanism)
        self.variables = len(mechanism.variable_names)

    def state(self, values: Floats, speed: float, along: Floats) -> Floats:
        """Return the state (states,) at the start, where no work has been done."""
        motion = self.motion(values[None], along)
        root = np.sqrt(equivalent_inertia(self.mechanism, motion)[0])
        return np.concatenate([values, [root * speed], np.zeros(len(self.loads.names))])

    def motion(self, values: Floats, along: Floats) -> CoordinateMotion:
        """Return the motion by arc length at pair variables (n, variables).

        The first tangent points to the side of `along` (variables,), each further one to
        the side of the one before; with `along` (n, variables) each to that of its row.
        """
        motion = by_arc_length(self.closure, values, order=1)
        if along.ndim == 1:
            return motion.turned(continued(motion.rates, along))
        side = np.sum(along * motion.rates, axis=1)
        return motion.turned(np.where(side < 0.0, -1.0, 1.0))

    def closed(self, values: Floats) -> tuple[Floats, float]:
        """Return a configuration (variables,) put back onto its curve, and its residual.

        By a step of Newton's method along the normal space, so that no travel is added.
        """
        at = self.closure.at(values[None])
        if not at.residual.size:
            return values, 0.0
        moved = np.linalg.pinv(at.jacobian[0], rcond=1e-10) @ at.residual[0]
        return np.asarray(values - moved), float(at.gap[0])

    def at(
        self, t: Floats, states: Floats, along: Floats, whole: Floats | None = None
    ) -> Dynamics:
        """Return what acts at successive times t (n,); `along` as in `motion`.

        `whole` (n, variables) rad are turns by which the states' variables are less than
        those that the loads see.
        """
        motion = self.motion(states[:, : self.variables], along)
        B = equivalent_inertia(self.mechanism, motion)
        with np.errstate(divide="ignore", invalid="ignore"):
            speed = states[:, self.variables] / np.sqrt(B)
        seen = motion
        if whole is not None:
            seen = replace(motion, values=motion.values + whole)
        return Dynamics(motion, B, self.loads.parts(seen, speed, t), speed)

    def arguments(self, found: Dynamics, whole: Floats, t: Floats) -> Floats:
        """Return the steep arguments (n, arguments) of the loads, `whole` as in `at`."""
        rates = found.motion.rates * found.speed[:, None]
        return self.loads.arguments(found.motion.values + whole, rates, t)

    def rates(self, found: Dynamics) -> Floats:
        """Return the rates of the states (n, states)."""
        speed = found.speed[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            push = np.sum(found.forces, axis=1) / np.sqrt(found.B)
        return np.concatenate(
            [found.motion.rates * speed, push[:, None], found.forces * speed], axis=1
        )
