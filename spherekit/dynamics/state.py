"""The equation of motion on the configurations of a mechanism, of any mobility.

The state is the pair variables v, the momenta p = R u, with u the rates of m coordinates
and R the symmetric root of the inertia matrix M = R R, and the work W of each load. With
the rates N of the variables by the coordinates, and M u' + C u = Q,

    dv/dt = N u,   dp/dt = R^-1 Q + S p,   dW/dt = Q u,   u = R^-1 p,
    S = R' R^-1 - R^-1 C R^-1.

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
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import Status
from spherekit.dynamics.forces import Loads, rates_by_time
from spherekit.dynamics.inertia import coriolis, inertia, inertia_matrix
from spherekit.dynamics.kinematics import (
    CoordinateMotion,
    Order,
    by_arc_length,
    by_combinations,
    continued,
)
from spherekit.dynamics.rubbing import rubbed
from spherekit.dynamics.transmitted import Driven
from spherekit.model.mechanism import Mechanism
from spherekit.motion.closure import Closure
from spherekit.motion.timing import Timing
from spherekit.sphere.rotation import Floats, transpose

PROJECTIONS = 3
"""Steps of Newton's method that lead an iterate near its set of configurations onto it."""

LONGEST = 0.05
"""Longest of these (rad): near a crossing the first may lead far away."""


@final
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
        finite = np.all(np.isfinite(M), axis=(1, 2))
        squares, vectors = np.linalg.eigh(np.where(finite[:, None, None], M, 0.0))
        with np.errstate(invalid="ignore"):
            sizes = np.sqrt(np.where(finite[:, None] & (squares > 0.0), squares, np.nan))
        return cls(vectors, sizes)

    def times(self, x: Floats) -> Floats:
        """Return R x (n, m)."""
        return self._scaled(x, self.sizes)

    def solved(self, x: Floats) -> Floats:
        """Return R^-1 x (n, m)."""
        return self._scaled(x, 1.0 / self.sizes)

    def _scaled(self, x: Floats, by: Floats) -> Floats:
        turned = by[..., None] * (transpose(self.vectors) @ x[..., None])
        return np.asarray((self.vectors @ turned)[..., 0])

    def changing(self, dM: Floats, u: Floats) -> Floats:
        """Return R' u (n, m) at rates u (n, m), given the derivatives of M (n, m, m, m)."""
        along = transpose(self.vectors) @ u[..., None]
        return np.asarray((self.vectors @ self._change(dM, u) @ along)[..., 0])

    def _change(self, dM: Floats, u: Floats) -> Floats:
        """Return R' (n, m, m) along the eigenvectors."""
        change = (dM @ u[:, None, :, None])[..., 0]
        sums = self.sizes[:, :, None] + self.sizes[:, None]
        return np.asarray(transpose(self.vectors) @ change @ self.vectors / sums)

    def turning(self, dM: Floats, u: Floats, p: Floats) -> Floats:
        """Return S p (n, m) at rates u (n, m), given the derivatives of M (n, m, m, m)."""
        back = transpose(self.vectors)
        root_change = self._change(dM, u)
        pull = back @ coriolis(dM, u) @ self.vectors / self.sizes[:, :, None]
        part = (root_change - pull) / self.sizes[:, None]
        skew = 0.5 * (part - transpose(part))
        return np.asarray((self.vectors @ skew @ back @ p[..., None])[..., 0])


@final
@dataclass(frozen=True)
class Dynamics:
    """Motion, inertia and generalised forces at n states.

    `motion` is of the first order where there is one coordinate and no bearing rubs,
    otherwise of the second; its status is NOT_CONVERGED where bearings lock. `M` (n, m, m)
    with its `roots`, `forces` (n, m, loads) the Q of each load, `speed` (n, m) is u, `bend`
    (n, m) is S p, `carried` (n, k) N what bearings that rub carry, None without any.
    """

    motion: CoordinateMotion
    M: Floats
    roots: Roots
    forces: Floats
    speed: Floats
    bend: Floats
    carried: Floats | None = None

    @property
    def power(self) -> Floats:
        """(n, loads) power of each load, W."""
        return np.asarray((self.speed[:, None] @ self.forces)[:, 0])

    @property
    def push(self) -> Floats:
        """(n, m) rates of the momenta."""
        return self.roots.solved(np.sum(self.forces, axis=2)) + self.bend


@final
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
        motion = self.motion(values[None], frame)
        roots = Roots.of(inertia_matrix(self.mechanism, motion))
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

        By a step of Newton's method along the normal space, so that no travel is added; the
        gap is its residual (rad).
        """
        at = self.closure.at(values[None])
        if not at.residual.size:
            return values, 0.0
        moved = np.linalg.pinv(at.jacobian[0], rcond=1e-10) @ at.residual[0]
        return np.asarray(values - moved), float(at.gap[0])

    def nearest_closed(self, values: Floats) -> Floats:
        """Return configurations (n, variables) led to closed ones by Newton's method.

        Each by `PROJECTIONS` steps along the normal space, no longer than `LONGEST` (rad).
        """
        for _ in range(PROJECTIONS):
            at = self.closure.at(values)
            if not at.residual.size:
                return values
            inverse = np.linalg.pinv(at.jacobian, rcond=1e-9)
            moved = (inverse @ at.residual[..., None])[..., 0]
            size = np.linalg.norm(moved, axis=1, keepdims=True)
            values = values - moved * np.minimum(1.0, LONGEST / np.maximum(size, LONGEST))
        return values

    def at(
        self, t: Floats, states: Floats, frame: Floats, whole: Floats | None = None
    ) -> Dynamics:
        """Return what acts at successive times t (n,); `frame` as in `motion`.

        `whole` (n, variables) rad are turns by which the states' variables are less than
        those that the loads see.
        """
        values = states[:, : self.variables]
        second = self.freedoms > 1 or bool(self.loads.rubbing)
        motion = self.motion(values, frame, 2 if second else 1)
        momenta = states[:, self.momenta]
        if second:
            masses = inertia(self.mechanism, motion)
            M = masses.M
        else:
            M = inertia_matrix(self.mechanism, motion)
        roots = Roots.of(M)
        speed = roots.solved(momenta)
        bend = np.zeros_like(momenta)
        if self.freedoms > 1:
            bend = roots.turning(masses.dM, speed, momenta)
        seen = motion
        if whole is not None:
            seen = replace(motion, values=motion.values + whole)
        forces, carried = self.loads.parts(seen, speed, t), None
        if self.loads.rubbing:
            pull = (coriolis(masses.dM, speed) @ speed[..., None])[..., 0]
            drive = np.sum(forces, axis=2) - pull
            carried, locked = self._carried(values, seen, roots, speed, drive, t)
            forces = self.loads.parts(seen, speed, t, carried)
            status = np.where(locked, Status.NOT_CONVERGED, motion.status)
            motion = replace(motion, status=status.astype(np.int8))
        return Dynamics(motion, M, roots, forces, speed, bend, carried)

    def _carried(
        self,
        values: Floats,
        seen: CoordinateMotion,
        roots: Roots,
        speed: Floats,
        drive: Floats,
        t: Floats,
    ) -> tuple[Floats, NDArray[np.bool_]]:
        """Return what bearings that rub carry (n, k), N, and where they lock (n,).

        `drive` (n, m) is what accelerates the coordinates while nothing rubs; rows that are
        not finite are NaN.
        """
        n, joints = len(t), self.closure.joints
        carried = np.full((n, len(self.loads.rubbing)), np.nan)
        locked = np.zeros(n, dtype=bool)
        change = roots.solved(roots.solved(drive))
        good = np.all(np.isfinite(change), axis=1)
        if not np.any(good):
            return carried, locked
        none = np.zeros((n, len(self.mechanism.inputs)))
        timing = Timing(t, speed, change)
        frames = self.closure.at(values).frames
        driven = Driven(self.mechanism, joints, frames, seen, timing, none).rows(good)
        turned = np.moveaxis(self.loads.rubbing_velocities(driven.motion), 1, 0)
        some = Roots(roots.vectors[good], roots.sizes[good])
        faster = np.stack([some.solved(some.solved(column)) for column in turned], axis=1)
        drives = np.zeros((*faster.shape[:2], none.shape[1]))
        rub = rubbed(driven, self.loads, faster, drives)
        carried[good], locked[good] = rub.carried, ~rub.settled
        return carried, locked

    def arguments(self, dynamics: Dynamics, whole: Floats, t: Floats) -> Floats:
        """Return the steep arguments (n, arguments) of the loads, `whole` as in `at`."""
        rates = rates_by_time(dynamics.motion, dynamics.speed)
        return self.loads.arguments(dynamics.motion.values + whole, rates, t)

    def rates(self, dynamics: Dynamics) -> Floats:
        """Return the rates of the states (n, states)."""
        rates = rates_by_time(dynamics.motion, dynamics.speed)
        return np.concatenate([rates, dynamics.push, dynamics.power], axis=1)
