"""The equation of motion on the configurations of a mechanism, of any mobility m.

The state consists of the pair variables v, the momenta p = R u and the work W of each load.
Here u are the rates of m coordinates, and R is the symmetric root of the inertia matrix, M
= R R. With the rates N of the variables with respect to the coordinates, the Coriolis
matrix C and the generalised forces Q, M du/dt + C u = Q becomes

    dv/dt = N u,   dp/dt = R^-1 Q + S p,   dW/dt = Q u,   u = R^-1 p,
    S p = (dR/dt) u - R^-1 C u.

S is skew because R^-1 (dM/dt - 2 C) R^-1 is, so the kinetic energy p^2 / 2 changes by the
work of the loads alone. With one degree of freedom S is zero: p is constant if no load
acts, and the equation contains no derivative of M.

With one degree of freedom the coordinate is the arc length s of the configuration curve,
along which every dead centre is an ordinary point (Eksergian's equation B du/dt + 1/2 dB/ds
u^2 = Q, Di Gregorio 2024, eq. (9)). With several, each coordinate is a weighted sum of pair
variables. The weights are an orthonormal basis of the possible velocities in a
configuration nearby. All configurations in which the velocity equations are regular are
then ordinary points, whether or not the inputs determine the motion there.

In both cases the rates of the coordinates are weighted sums of the rates of the variables,
u = W dv/dt. The matrix W (m, variables) is called `rate_weights`. With one degree of
freedom it is the unit tangent of the curve, which changes along the motion.
"""

from dataclasses import dataclass, replace

import numpy as np

from spherekit.arrays import Floats
from spherekit.dynamics.bearing_friction import solve_bearing_friction
from spherekit.dynamics.coordinates import (
    CoordinateMotion,
    Order,
    continuous_signs,
    motion_by_arc_length,
    motion_by_combinations,
)
from spherekit.dynamics.generalised_forces import Loads, rates_by_time
from spherekit.dynamics.inertia import Inertia, coriolis, inertia, inertia_matrix
from spherekit.dynamics.transmitted_forces import DrivenState
from spherekit.geometry.rotation import transpose
from spherekit.geometry.vectors import all_finite
from spherekit.mechanism.mechanism import Mechanism
from spherekit.positions.linearisation import Linearisation
from spherekit.positions.loop_closure import Closure
from spherekit.positions.timing import Timing
from spherekit.status import Status

PROJECTION_STEPS = 3
"""Newton steps that project an iterate onto the closed configurations.

Smaller: configurations far from closed ones stay open. Larger: only more time, since steps
converge quadratically.
"""

MAX_PROJECTION_STEP_RAD = 0.05
"""Longest of these steps.

Larger: near a crossing of curves, where the equations are nearly singular, the first step
can lead far away. Smaller: configurations farther from closed ones stay open.
"""

PROJECTION_RANK_RATIO = 1e-10
"""Relative singular value below which closure equations count as redundant in a step."""


@dataclass(frozen=True)
class InertiaRoots:
    """The symmetric square roots R of n inertia matrices M = R R.

    The roots are stored as eigenvectors and eigenvalues. Momenta are p = R u with the rates
    u of the m coordinates, so that the kinetic energy is p^2 / 2.

    Attributes
    ----------
    eigenvectors
        (n, m, m) orthonormal eigenvectors in the columns.
    eigenvalues
        (n, m) eigenvalues of R, rising; NaN where M is not positive.
    """

    eigenvectors: Floats
    eigenvalues: Floats

    @classmethod
    def from_inertia(cls, M: Floats) -> "InertiaRoots":
        """Return the roots of inertia matrices M (n, m, m), kg m2."""
        finite = all_finite(M, (1, 2))[:, None, None]
        squares, vectors = np.linalg.eigh(np.where(finite, M, 0.0))
        return cls(vectors, np.sqrt(np.where(squares > 0.0, squares, np.nan)))

    @property
    def inverse_inertia(self) -> Floats:
        """(n, m, m) the inverse of M."""
        # An eigenvalue of M is the square of that of R.
        scaled = self.eigenvectors / self.eigenvalues[:, None] ** 2
        return scaled @ transpose(self.eigenvectors)

    def multiply(self, x: Floats) -> Floats:
        """Return R x (n, m)."""
        return self._scale_components(x, self.eigenvalues)

    def solve(self, x: Floats) -> Floats:
        """Return R^-1 x (n, m)."""
        return self._scale_components(x, 1.0 / self.eigenvalues)

    def _scale_components(self, x: Floats, factors: Floats) -> Floats:
        """Return vectors x (n, m) after a stretch along the eigenvectors of the matrices R.

        R is the root of an inertia matrix. The component of x along an eigenvector is
        multiplied by the factor (n, m) of this eigenvector. With powers of the eigenvalues
        as factors, the result is x times a power of R.
        """
        components = factors[..., None] * (transpose(self.eigenvectors) @ x[..., None])
        return (self.eigenvectors @ components)[..., 0]

    def multiply_derivative(self, dM: Floats, u: Floats) -> Floats:
        """Return (dR/dt) u (n, m), which is needed for the rates of the momenta p = R u.

        R is the symmetric square root of the inertia matrix, M = R R. Its derivative solves
        R dR/dt + dR/dt R = dM/dt. In the basis of the eigenvectors of R, with the
        eigenvalues r, the solution is dR_ij/dt = (dM/dt)_ij / (r_i + r_j).

        Parameters
        ----------
        dM
            (n, m, m, m) derivatives of M with respect to the m coordinates, which are the
            last axis.
        u
            (n, m) rates of the coordinates.
        """
        to_eigenvectors = transpose(self.eigenvectors)
        # dM/dt by the chain rule. Then its components in the basis of the eigenvectors.
        inertia_rate = (dM @ u[:, None, :, None])[..., 0]
        root_rate = to_eigenvectors @ inertia_rate @ self.eigenvectors
        # Division by r_i + r_j turns it into dR/dt in the basis of the eigenvectors.
        root_rate /= self.eigenvalues[:, :, None] + self.eigenvalues[:, None]
        return (self.eigenvectors @ root_rate @ to_eigenvectors @ u[..., None])[..., 0]


@dataclass(frozen=True)
class StateDynamics:
    """Motion, inertia and generalised forces at n states of a simulation.

    The equation of motion is M du/dt + C u = Q with the rates u of m coordinates, the
    inertia matrix M, the Coriolis forces C u and the sum Q of the generalised forces. A
    state has the momenta p = R u in place of the rates. R is the symmetric square root of
    the inertia matrix, M = R R, so the kinetic energy is p^2 / 2.

    Attributes
    ----------
    motion
        Configurations and their derivatives with respect to the m coordinates. Angles
        include whole turns, on which loads may depend. Second derivatives that were not
        needed are NaN. The status is NOT_CONVERGED where bearings may lock.
    masses
        Inertia with its derivatives; None if `motion` has no second derivatives.
    roots
        The square roots R of the inertia matrices.
    forces
        (n, m, loads) generalised force of each load.
    speed
        (n, m) rates u of the coordinates.
    coriolis_forces
        (n, m) C u; 0 if `masses` are None.
    carried
        (n, k) loads that the pairs with bearing friction carry, see `CarriedLoads`; None
        without such pairs.
    """

    motion: CoordinateMotion
    masses: Inertia | None
    roots: InertiaRoots
    forces: Floats
    speed: Floats
    coriolis_forces: Floats
    carried: Floats | None = None

    @property
    def power(self) -> Floats:
        """(n, loads) power of each load, W."""
        return (self.speed[:, None] @ self.forces)[:, 0]

    @property
    def accelerations(self) -> Floats:
        """(n, m) accelerations du/dt = M^-1 (Q - C u); needs `masses`."""
        net_forces = np.sum(self.forces, axis=2) - self.coriolis_forces
        # M^-1 is R^-1 R^-1.
        return self.roots.solve(self.roots.solve(net_forces))

    @property
    def momentum_rates(self) -> Floats:
        """(n, m) rates dp/dt of the momenta p = R u.

        The rates are R^-1 (Q - C u) + (dR/dt) u with the root R of the inertia matrix, the
        sum Q of the generalised forces and the rates u of the coordinates.
        """
        load_part = self.roots.solve(np.sum(self.forces, axis=2))
        # With one degree of freedom the other terms cancel: M = R^2 gives dR/dt =
        # (dM/dt) / (2 R), and C is (dM/dt) / 2.
        if self.masses is None or load_part.shape[1] == 1:
            return load_part
        root_part = self.roots.multiply_derivative(self.masses.dM, self.speed)
        return load_part + (root_part - self.roots.solve(self.coriolis_forces))


class EquationOfMotion:
    """The equation of motion of a mechanism under loads: it gives the rates of its state.

    A state (variables + m + loads,) has the pair variables (rad), the m momenta p = R u and
    the work of each load (J). R is the symmetric root of the inertia matrix. The rates u
    are the rates of m coordinates. These rates are weighted sums of the rates of the pair
    variables. Row i of `rate_weights` (m, variables) has the weights for coordinate i.

    Attributes
    ----------
    freedoms
        Number m of degrees of freedom.
    variable_count
        Number of pair variables.
    momenta, works
        Slices of the momenta and of the works in a state.
    """

    def __init__(self, mechanism: Mechanism, closure: Closure, freedoms: int = 1) -> None:
        """Store the mechanism, and define where each quantity is in a state.

        The state of a simulation is one array: pair variables (joint angles), then m
        momenta, then the work that each load has done.

        Parameters
        ----------
        mechanism, closure
            The mechanism with its loads, and its loop-closure equations.
        freedoms
            Number m of degrees of freedom.
        """
        self.mechanism = mechanism
        self.closure = closure
        self.freedoms = freedoms
        self.loads = Loads(mechanism)
        self.variable_count = len(mechanism.variable_names)
        self.momenta = slice(self.variable_count, self.variable_count + freedoms)
        self.works = slice(self.variable_count + freedoms, None)

    def make_state(self, values: Floats, speed: Floats, rate_weights: Floats) -> Floats:
        """Return the state of a simulation at its start, from positions and rates.

        A state has the momenta p = R u in place of the rates u of m coordinates. R is the
        symmetric square root of the inertia matrix M = R R, so the kinetic energy is p^2 /
        2. The works of the loads are zero.

        Parameters
        ----------
        values
            (variables,) pair variables (rad) of a configuration in which all loops close.
        speed
            (m,) rates u of the coordinates.
        rate_weights
            (m, variables) in row i the weights of the rates of the pair variables in the
            rate of coordinate i; see `compute_motion`.

        Returns
        -------
        (states,) the pair variables, the m momenta, and zeros for the works of the loads.
        """
        motion = self.compute_motion(values[None], rate_weights)
        roots = InertiaRoots.from_inertia(inertia_matrix(self.mechanism, motion))
        momenta = roots.multiply(speed[None])[0]
        return np.concatenate([values, momenta, np.zeros(len(self.loads.names))])

    def renew_coordinates(
        self, state: Floats, rate_weights: Floats
    ) -> tuple[Floats, Floats]:
        """Return the same state in new coordinates, and the weights of these coordinates.

        The coordinates are m weighted sums of the pair variables. As the mechanism moves,
        the old coordinates determine the motion less and less well. The new weights are an
        orthonormal basis of the velocities that are possible in the present configuration.

        Parameters
        ----------
        state
            (states,) pair variables, momenta and works. The momenta belong to the
            coordinates with the weights `rate_weights`.
        rate_weights
            (m, variables) the old weights, those of coordinate i in row i.
        """
        # Only the motion is used, which does not depend on the time, so the time is 0.
        dynamics = self.evaluate(np.zeros(1), state[None], rate_weights)
        # (variables,) the time derivatives of the variables.
        variable_rates = rates_by_time(dynamics.motion, dynamics.speed)[0]
        # (m, variables) rates of the variables per unit rate of each old coordinate. These
        # rows are a basis of the possible velocities.
        velocity_basis = dynamics.motion.rates[0]
        new_weights = _orthonormalise_symmetrically(velocity_basis)
        # The same configuration, velocity and work in the new coordinates.
        values = state[: self.variable_count]
        coordinate_rates = new_weights @ variable_rates
        new_state = self.make_state(values, coordinate_rates, new_weights)
        new_state[self.works] = state[self.works]
        return new_state, new_weights

    def compute_motion(
        self, values: Floats, rate_weights: Floats, order: Order = 1
    ) -> CoordinateMotion:
        """Return configurations with their derivatives with respect to the m coordinates.

        With several degrees of freedom, the coordinates are weighted sums of the pair
        variables (joint angles). With one, the coordinate is the arc length of the curve of
        configurations in the space of all pair variables.

        Parameters
        ----------
        values
            (n, variables) pair variables (rad).
        rate_weights
            With several degrees of freedom, the weights of the pair variables in the
            coordinates: (m, variables) in all rows, or (n, m, variables) for each row.

            With one degree of freedom, approximate tangents of the curve instead:
            (n, 1, variables) for each row, or (1, variables) for the first row. They only
            decide the sense of the computed tangents, which is the sense in which arc
            length increases. A row without a tangent keeps the sense of the row before.
        order
            Order of the derivatives, 1 or 2.
        """
        if self.freedoms > 1:
            return motion_by_combinations(self.closure, values, rate_weights, order)
        return self._compute_curve_motion(values, rate_weights, order)

    def _compute_curve_motion(
        self, values: Floats, tangents: Floats, order: Order
    ) -> CoordinateMotion:
        """Return configurations and their derivatives d/ds, s the arc length of a curve.

        The configurations of a mechanism with one degree of freedom form the curve. The
        first derivative is a unit tangent of the curve. A tangent may point in either of
        two directions. Approximate tangents decide which one is positive.

        Parameters
        ----------
        values
            (n, variables) configurations of a mechanism with one degree of freedom (rad).
        tangents
            (n, 1, variables) for each row an approximate tangent, with which the tangent of
            the row makes an acute angle. Or (1, variables) for the first row only. Each
            further tangent then makes an acute angle with the one before, so rows must be
            in order along the motion.
        order
            Order of the derivatives, 1 or 2.
        """
        motion = motion_by_arc_length(self.closure, values, order)
        is_for_first_row = tangents.ndim == 2
        if is_for_first_row:
            senses = continuous_signs(motion.rates[:, 0], start=tangents[0])
        else:
            cosines = np.sum(tangents * motion.rates, axis=(1, 2))
            senses = np.where(cosines < 0.0, -1.0, 1.0)
        return motion.with_senses(senses)

    def project_once(self, values: Floats) -> tuple[Floats, float]:
        """Move a configuration (variables,) towards closed loops by one Newton step.

        Integration errors open the loops a little. The second value that is returned is the
        closure residual before the step, rad.
        """
        linearisation = self.closure.linearise(values[None])
        return _project_step(linearisation)[0], float(linearisation.closure_residual[0])

    def project(self, values: Floats) -> Floats:
        """Return configurations (n, variables) after `PROJECTION_STEPS` Newton steps."""
        for _ in range(PROJECTION_STEPS):
            values = _project_step(self.closure.linearise(values))
        return values

    def evaluate(
        self,
        t: Floats,
        states: Floats,
        rate_weights: Floats,
        whole_turns: Floats | float = 0.0,
        needs_second_order: bool = False,
    ) -> StateDynamics:
        """Return motion, inertia and forces at n states.

        Parameters
        ----------
        t
            (n,) times, s.
        states
            (n, states) in each row the pair variables (rad), the m momenta p = R u, and the
            works of the loads (J). u are the rates of m coordinates. R is the symmetric
            square root of the inertia matrix M = R R.
        rate_weights
            (m, variables) or (n, m, variables). With several degrees of freedom, the rate
            of a coordinate is the sum of the rates of the pair variables, each times its
            weight. With one, these are approximate tangents of the curve of configurations.
            They only decide in which of its two senses the curve is followed. The exact
            tangents are computed (see `compute_motion`).
        whole_turns
            (n, variables) multiples of 2 pi (rad) that the states leave out, but on which
            loads such as springs may depend.
        needs_second_order
            Whether the caller needs `StateDynamics.masses`, the inertia with derivatives.
        """
        # Second derivatives give the Coriolis forces. With several degrees of freedom,
        # momentum rates depend on these forces. Accelerations always do, and bearing
        # friction depends on accelerations.
        has_friction = bool(self.loads.friction_components)
        has_second_order = needs_second_order or self.freedoms > 1 or has_friction
        order: Order = 2 if has_second_order else 1
        motion = self.compute_motion(states[:, : self.variable_count], rate_weights, order)
        momenta = states[:, self.momenta]
        masses = inertia(self.mechanism, motion) if has_second_order else None
        M = masses.M if masses is not None else inertia_matrix(self.mechanism, motion)
        roots = InertiaRoots.from_inertia(M)
        # The rates u of the coordinates, from p = R u.
        speed = roots.solve(momenta)
        if masses is not None:
            coriolis_forces = coriolis(masses.dM, speed)
        else:
            # The Coriolis force is not needed here. With one degree of freedom it cancels
            # with (dR/dt) u in the momentum rate, so dp/dt = R^-1 Q.
            coriolis_forces = np.zeros_like(momenta)
        # Only loads, such as springs, depend on whole turns.
        motion = replace(motion, values=motion.values + whole_turns)
        forces = self.loads.evaluate_forces(motion, speed, t)
        dynamics = StateDynamics(
            motion=motion,
            masses=masses,
            roots=roots,
            forces=forces,
            speed=speed,
            coriolis_forces=coriolis_forces,
        )
        if has_friction:
            return self._add_bearing_friction(t, dynamics)
        return dynamics

    def _add_bearing_friction(self, t: Floats, dynamics: StateDynamics) -> StateDynamics:
        """Return the dynamics with the friction that follows from reactions in bearings.

        The friction changes the accelerations, and the accelerations change the reactions,
        so both are solved together. The friction is added to the generalised forces, from
        which `StateDynamics.accelerations` are computed. Rows (states) in which the
        friction is not known get the status NOT_CONVERGED.

        Parameters
        ----------
        t
            (n,) times, s.
        dynamics
            Motion and forces without this friction, at n states.
        """
        motion = dynamics.motion
        timing = Timing(t, dynamics.speed, dynamics.accelerations)
        # A simulation has no unknown driving torques: torques at the inputs are loads.
        no_torques = np.zeros_like(dynamics.speed)
        friction = solve_bearing_friction(
            DrivenState(self.mechanism, motion, timing, no_torques),
            loads=self.loads,
            is_finite=all_finite(timing.ddq, 1),
            inverse_inertia=dynamics.roots.inverse_inertia,
        )
        status = np.where(friction.is_unknown, Status.NOT_CONVERGED, motion.status)
        # The load on each bearing or contact, to which its friction is proportional.
        carried = friction.carried
        return replace(
            dynamics,
            motion=replace(motion, status=status.astype(np.int8)),
            forces=self.loads.evaluate_forces(motion, dynamics.speed, t, carried),
            carried=carried,
        )

    def state_rates(self, dynamics: StateDynamics) -> Floats:
        """Return the time derivatives (n, states) of variables, momenta and works."""
        variable_rates = rates_by_time(dynamics.motion, dynamics.speed)
        return np.concatenate(
            [variable_rates, dynamics.momentum_rates, dynamics.power], axis=1
        )


def _project_step(linearisation: Linearisation) -> Floats:
    """Return pair variables (n, variables) after one Newton step that closes the loops.

    The step is normal to the set of closed configurations, so that the mechanism does not
    move along this set. The step is at most `MAX_PROJECTION_STEP_RAD` long.
    """
    inverse = np.linalg.pinv(linearisation.jacobian, rcond=PROJECTION_RANK_RATIO)
    steps = (inverse @ linearisation.residual[..., None])[..., 0]
    lengths = np.linalg.norm(steps, axis=1, keepdims=True)
    limit = MAX_PROJECTION_STEP_RAD
    return linearisation.values - steps * np.minimum(
        1.0, limit / np.maximum(lengths, limit)
    )


def _orthonormalise_symmetrically(basis: Floats) -> Floats:
    """Return the orthonormal basis of the same space that is nearest to a given one.

    The result is (B B^T)^(-1/2) B for a basis B (m, k) whose rows are the vectors: the
    symmetric orthogonalisation of Löwdin.
    """
    eigenvalues, eigenvectors = np.linalg.eigh(basis @ basis.T)
    return (eigenvectors / np.sqrt(eigenvalues)) @ eigenvectors.T @ basis
