"""The equation of motion on the configurations of a mechanism, of any mobility.

The state is the pair variables v, the momenta p = R u, with u the rates of m coordinates
and R the symmetric root of the inertia matrix M = R R, and the work W of each load. With
the rates N of the variables by the coordinates, and M u' + C u = Q,

    dv/dt = N u,   dp/dt = R^-1 Q + S p,   dW/dt = Q u,   u = R^-1 p,
    S p = R' u - R^-1 C u.

S is skew, for R^-1 (M' - 2 C) R^-1 is; so the kinetic energy p^2 / 2 changes by the work of
the loads alone. Of one freedom S is zero: p is constant where no load acts, the rate of the
arc length in the metric of the kinetic energy, and no derivative of M is needed.

Of one freedom the coordinate is the arc length s of the configuration curve, along which
every dead centre is an ordinary point (Eksergian's equation B du/dt + 1/2 dB/ds u^2 = Q, Di
Gregorio 2024, eq. (9)). Of several the coordinates are sums of the pair variables whose
factors, the frame, are an orthonormal basis of the velocities somewhere near: so all
configurations are ordinary points at which the velocity equations are regular, whether or
not the inputs hold the mechanism there.
"""

from dataclasses import dataclass, replace

import numpy as np

from spherekit.arrays import Floats
from spherekit.dynamics.bearing_friction import rubbed
from spherekit.dynamics.coordinates import (
    CoordinateMotion,
    Inertia,
    Order,
    by_arc_length,
    by_combinations,
    continued,
    coriolis,
    inertia,
    inertia_matrix,
)
from spherekit.dynamics.transmitted_forces import DrivenState, Loads, rates_by_time
from spherekit.geometry.rotation import all_finite, transpose
from spherekit.mechanism.mechanism import Mechanism
from spherekit.positions.linearisation import Linearisation
from spherekit.positions.loop_closure import Closure
from spherekit.positions.timing import Timing
from spherekit.status import Status

PROJECTIONS = 3
"""Steps of Newton's method that lead an iterate near its set of configurations onto it."""

LONGEST = 0.05
"""Longest of these (rad): near a crossing the first may lead far away."""


@dataclass(frozen=True)
class Roots:
    """The symmetric roots R of inertia matrices (n, m, m), by their eigenvectors.

    `vectors` (n, m, m) in columns, `sizes` (n, m) the eigenvalues of R; NaN where M is not
    positive.
    """

    vectors: Floats
    sizes: Floats

    @classmethod
    def of(cls, M: Floats) -> "Roots":
        """Return the roots of M (n, m, m)."""
        finite = all_finite(M, (1, 2))[:, None, None]
        squares, vectors = np.linalg.eigh(np.where(finite, M, 0.0))
        return cls(vectors, np.sqrt(np.where(squares > 0.0, squares, np.nan)))

    @property
    def inverse(self) -> Floats:
        """(n, m, m) that of M."""
        return (self.vectors / self.sizes[:, None] ** 2) @ transpose(self.vectors)

    def times(self, x: Floats) -> Floats:
        """Return R x (n, m)."""
        return self._scaled(x, self.sizes)

    def solved(self, x: Floats) -> Floats:
        """Return R^-1 x (n, m)."""
        return self._scaled(x, 1.0 / self.sizes)

    def _scaled(self, x: Floats, by: Floats) -> Floats:
        turned = by[..., None] * (transpose(self.vectors) @ x[..., None])
        return (self.vectors @ turned)[..., 0]

    def changing(self, dM: Floats, u: Floats) -> Floats:
        """Return R' u (n, m) at rates u (n, m), given the derivatives of M (n, m, m, m)."""
        back = transpose(self.vectors)
        change = back @ (dM @ u[:, None, :, None])[..., 0] @ self.vectors
        change /= self.sizes[:, :, None] + self.sizes[:, None]
        return (self.vectors @ change @ back @ u[..., None])[..., 0]


@dataclass(frozen=True)
class Dynamics:
    """Motion, inertia and generalised forces at n states.

    `motion`, with its variables as loads see them, is of the first order where there is one
    coordinate, no bearing rubs and no more was asked for, otherwise of the second, and then
    there are `masses`; its status is NOT_CONVERGED where bearings lock. `roots` are those
    of M (n, m, m), `forces` (n, m, loads) the Q of each load, `speed` (n, m) is u, `pull`
    (n, m) is C u, as far as masses are known, `carried` (n, k) N what bearings that rub
    carry, None without any.
    """

    motion: CoordinateMotion
    masses: Inertia | None
    roots: Roots
    forces: Floats
    speed: Floats
    pull: Floats
    carried: Floats | None = None

    @property
    def power(self) -> Floats:
        """(n, loads) power of each load, W."""
        return (self.speed[:, None] @ self.forces)[:, 0]

    @property
    def change(self) -> Floats:
        """(n, m) accelerations u'; those that masses say, which have to be known."""
        drive = np.sum(self.forces, axis=2) - self.pull
        return self.roots.solved(self.roots.solved(drive))

    @property
    def push(self) -> Floats:
        """(n, m) rates of the momenta."""
        push = self.roots.solved(np.sum(self.forces, axis=2))
        if self.masses is None or push.shape[1] == 1:
            return push
        bend = self.roots.changing(self.masses.dM, self.speed)
        return push + (bend - self.roots.solved(self.pull))


class EquationOfMotion:
    """Rates of the state (n, variables + m + loads) of one mechanism with its loads."""

    def __init__(self, mechanism: Mechanism, closure: Closure, freedoms: int = 1) -> None:
        self.mechanism = mechanism
        self.closure = closure
        self.freedoms = freedoms
        self.loads = Loads(mechanism)
        self.variables = len(mechanism.variable_names)
        self.momenta = slice(self.variables, self.variables + freedoms)
        self.works = slice(self.variables + freedoms, None)

    def state(self, values: Floats, speed: Floats, frame: Floats) -> Floats:
        """Return the state (states,) at rates (m,), where no work has been done."""
        roots = Roots.of(inertia_matrix(self.mechanism, self.motion(values[None], frame)))
        momenta = roots.times(speed[None])[0]
        return np.concatenate([values, momenta, np.zeros(len(self.loads.names))])

    def framed(self, state: Floats, frame: Floats) -> tuple[Floats, Floats]:
        """Return a state in a frame that is orthonormal there, and that frame."""
        dynamics = self.at(np.zeros(1), state[None], frame)
        rates = rates_by_time(dynamics.motion, dynamics.speed)[0]
        rows = dynamics.motion.rates[0]
        squares, turn = np.linalg.eigh(rows @ rows.T)
        frame = (turn / np.sqrt(squares)) @ turn.T @ rows
        framed = self.state(state[: self.variables], frame @ rates, frame)
        framed[self.works] = state[self.works]
        return framed, frame

    def motion(self, values: Floats, frame: Floats, order: Order = 1) -> CoordinateMotion:
        """Return the motion at pair variables (n, variables).

        Of one freedom it is by arc length: the first tangent points to the side of the
        frame (1, variables), each further one to the side of the one before; with frames
        (n, 1, variables) each to that of its row. Of several it is by the combinations in
        the frame (m, variables), or in that of each row.
        """
        if self.freedoms > 1:
            return by_combinations(self.closure, values, frame, order)
        motion = by_arc_length(self.closure, values, order)
        if frame.ndim == 2:
            return motion.turned(continued(motion.rates[:, 0], frame[0]))
        side = np.sum(frame * motion.rates, axis=(1, 2))
        return motion.turned(np.where(side < 0.0, -1.0, 1.0))

    def closed(self, values: Floats) -> tuple[Floats, float]:
        """Return a configuration (variables,) put back among the closed ones, and its gap.

        By a step of Newton's method; the gap is its residual (rad).
        """
        at = self.closure.at(values[None])
        return _nearer(at)[0], float(at.gap[0])

    def nearest_closed(self, values: Floats) -> Floats:
        """Return configurations (n, variables) after `PROJECTIONS` steps to closed ones."""
        for _ in range(PROJECTIONS):
            values = _nearer(self.closure.at(values))
        return values

    def at(
        self,
        t: Floats,
        states: Floats,
        frame: Floats,
        whole: Floats | float = 0.0,
        second: bool = False,
    ) -> Dynamics:
        """Return what acts at successive times t (n,); `frame` as in `motion`.

        `whole` (n, variables) rad are turns by which the states' variables are less than
        those that the loads see; `second` asks for the motion to the second order.
        """
        second = second or self.freedoms > 1 or bool(self.loads.rubbing)
        motion = self.motion(states[:, : self.variables], frame, 2 if second else 1)
        momenta = states[:, self.momenta]
        masses = inertia(self.mechanism, motion) if second else None
        roots = Roots.of(masses.M if masses else inertia_matrix(self.mechanism, motion))
        speed = roots.solved(momenta)
        pull = coriolis(masses.dM, speed) if masses else np.zeros_like(momenta)
        motion = replace(motion, values=motion.values + whole)
        forces = self.loads.parts(motion, speed, t)
        dynamics = Dynamics(motion, masses, roots, forces, speed, pull)
        if not self.loads.rubbing:
            return dynamics
        timing = Timing(t, speed, dynamics.change)
        driven = DrivenState(self.mechanism, motion, timing, np.zeros_like(speed))
        carried, locked, _ = rubbed(
            driven, self.loads, all_finite(timing.ddq, 1), roots.inverse
        )
        status = np.where(locked, Status.NOT_CONVERGED, motion.status)
        return replace(
            dynamics,
            motion=replace(motion, status=status.astype(np.int8)),
            forces=self.loads.parts(motion, speed, t, carried),
            carried=carried,
        )

    def rates(self, dynamics: Dynamics) -> Floats:
        """Return the rates of the states (n, states)."""
        rates = rates_by_time(dynamics.motion, dynamics.speed)
        return np.concatenate([rates, dynamics.push, dynamics.power], axis=1)


def _nearer(at: Linearisation) -> Floats:
    """Return the values (n, variables) after a step of Newton's method towards closed ones.

    Along the normal space, so that no travel is added, and no longer than `LONGEST` (rad).
    """
    moved = (np.linalg.pinv(at.jacobian, rcond=1e-10) @ at.residual[..., None])[..., 0]
    size = np.linalg.norm(moved, axis=1, keepdims=True)
    return at.values - moved * np.minimum(1.0, LONGEST / np.maximum(size, LONGEST))
