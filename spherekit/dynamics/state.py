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

Friction that follows from the reactions which it changes, of bearings and contacts.

What is carried at place j of a pair k, the force on a bearing or the push of a contact, is
affine in the friction f of all pairs, a_kj + sum of b_kjl f_l. So friction solves

    f_k = r_k sum over j of |a_kj + sum of b_kjl f_l|,   r_k = -grip_k tanh(v_k' / speed_k).

The right-hand side changes by at most B_kl = |r_k| sum of |b_kjl| times a change of f.
Where the largest eigenvalue of B, the feedback, is below 1, it contracts: there is one
friction, and iteration leads to it. From 1 on there may be several or none, as in bearings
that lock. Newton's step is taken where it leaves less than iteration does.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import count

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.conventions import Names, Status, listing
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
from spherekit.dynamics.forces import (
    DEPENDENT,
    DETERMINED,
    DrivenState,
    Loads,
    NewtonEuler,
    accelerating,
    balanced,
    rates_by_time,
    without_centre,
)
from spherekit.errors import SolveError
from spherekit.model.load import BearingFriction
from spherekit.model.mechanism import Mechanism
from spherekit.motion.closure import Closure
from spherekit.motion.loops import Linearisation
from spherekit.motion.motion import Timing
from spherekit.sphere.rotation import all_finite, max_abs, nans, transpose


@dataclass(frozen=True)
class IndeterminateForces:
    """What a file would have to say more.

    `centres` are links with inertia without a centre of mass, `distances` contacts of which
    it is not known how far from O their force acts, `floating` pairs that would have to let
    their links slide along the axis as well; where all that is not `enough`, constraints
    that repeat each other leave more open.
    """

    centres: Names = ()
    distances: Names = ()
    floating: Names = ()
    enough: bool = True

    @property
    def wanted(self) -> list[str]:
        """What that is, in words."""
        wanted = []
        if self.centres:
            wanted.append(f"mass and centre of the links {listing(self.centres)}")
        if self.distances:
            wanted.append(
                f"the distance of the contacts {listing(self.distances)} from the centre"
            )
        if self.floating:
            wanted.append(
                f"that the pairs {listing(self.floating)}, or others in their loops, float "
                "(bearings, axial)"
            )
        if not self.enough:
            wanted.append("constraints that do not repeat each other")
        return wanted


def lacking(mechanism: Mechanism, frames: Floats) -> IndeterminateForces:
    """Return what would determine all forces at one row, `frames` (pairs, 3, 3) its pairs.

    The reactions that balance each other without loads are a linear space. Each pair that
    floats takes one direction from it, if the force along its axis takes part in what is
    left; the pair in which it does most is taken first.
    """
    distances = tuple(
        pair.name
        for pair in mechanism.pairs
        if not pair.kind.has_axis and pair.distance is None
    )
    told = replace(
        mechanism,
        masses=tuple(
            replace(mass, mass=1.0, centre=(0.0, 0.0, 0.0)) for mass in mechanism.masses
        ),
        pairs=tuple(
            replace(pair, distance=1.0) if pair.name in distances else pair
            for pair in mechanism.pairs
        ),
    )
    balance = NewtonEuler(told, frames[None], forces=True)
    _, sizes, back = np.linalg.svd(balance.matrix[0])
    free = back[np.count_nonzero(sizes > DEPENDENT * sizes[0]) :].T
    along = [k for k, (_, component) in enumerate(balance.columns) if component == 5]
    from scipy.linalg import qr

    # Pivots are what is left of the rows after those taken, the longest first.
    turn, rows, order = qr(free[along].T, pivoting=True)
    taken = np.count_nonzero(np.abs(np.diag(rows)) >= np.sqrt(DETERMINED))
    floating = sorted(balance.columns[along[k]][0] for k in order[:taken])
    free = free @ turn[:, taken:]
    forces = [k for k, (_, component) in enumerate(balance.columns) if component > 2]
    return IndeterminateForces(
        tuple(without_centre(mechanism)),
        distances,
        tuple(mechanism.names_of(floating)),
        not np.any(free[forces] ** 2 > DETERMINED),
    )


SETTLED = 1e-14
"""Part of the largest force by which forces may still change when friction is known."""

MOST_ROUNDS = 100


def rubbed(
    every: DrivenState, loads: Loads, good: Bools, inverse: Floats | None = None
) -> tuple[Floats, Bools, int]:
    """Return what pairs that rub carry, given how a mechanism moves without.

    In rows that are `good`, (n, k) N on bearings and N m of contacts, in sum, else NaN;
    where (n,) that is not known, since the feedback, what comes back of a change of the
    friction, is not below 1; and in how many rounds of iteration it is found.

    Parameters
    ----------
    every
        Rows in which nothing rubs.
    good
        Which of them are finite.
    inverse
        That of the inertia matrix (n, m, m), by which friction changes the accelerations;
        without it they are given, and it changes the torques at the inputs.

    Raises
    ------
    SolveError
        If a reaction is open that friction follows from.
    """
    carried = nans((len(good), len(loads.rubbing)))
    driven, locked = every.rows(good), np.zeros(len(good), dtype=bool)
    mechanism, motion = driven.mechanism, driven.motion
    velocities = np.swapaxes(loads.velocities(motion)[..., loads.rubbing], 1, 2)
    faster, driving = 0.0 * velocities, -velocities
    if inverse is not None:
        faster, driving = velocities @ inverse[good], 0.0 * velocities
    parts = [loads.components[k] for k in loads.rubbing]
    bearings = [x.rubs for x in parts if x.rubs is not None]
    balance = balanced(driven, any(one.asks_forces for one in bearings))
    pairs = [mechanism.pair_number[one.pair] for one in bearings]
    _need_determined(driven, balance, bearings)

    def on_bearings(left: Floats) -> Floats:
        # (n, k, 2, 3); 0 at a second place where there is none
        wrenches = balance.on_pairs(balance.held(left)[0])
        forces = np.zeros((len(left), len(pairs), 2, 3))
        for k, (one, pair) in enumerate(zip(bearings, pairs, strict=True)):
            through = wrenches[:, pair, 3:] if one.asks_forces else None
            on_each = one.carried(wrenches[:, pair, :3], through)
            forces[:, k, : on_each.shape[1]] = on_each
        return forces

    still = on_bearings(balance.left)
    change = np.empty((*still.shape, len(pairs)))
    inputs = [mechanism.pair_number[item.pair] for item in mechanism.inputs]
    for k, pair in enumerate(pairs):
        about = np.zeros((len(still), len(mechanism.pairs)))
        about[:, inputs] = driving[:, k]
        about[:, pair] += 1.0
        needed = accelerating(mechanism, motion, faster[:, k])
        change[..., k] = on_bearings(balance.left_by(needed, about))
    laws, timing = [part.magnitude for part in parts], driven.timing
    factors = loads.grips * loads.evaluated(laws, motion, timing.dq, timing.t)
    carried[good], locked[good], rounds = _solved(still, change, factors)
    return carried, locked, rounds


def _need_determined(
    driven: DrivenState, balance: NewtonEuler, rubbing: Sequence[BearingFriction]
) -> None:
    """Raise `SolveError` if a reaction is open that friction follows from."""
    mechanism = driven.mechanism
    for one in rubbing:
        is_open = balance.opened[:, mechanism.pair_number[one.pair]]
        if np.any(is_open[:, :3]) or not np.all(balance.settled):
            raise SolveError(
                f"{mechanism.name}: loads.{one.name}: redundant constraints leave the "
                f"reaction of pair {one.pair} open, and so the friction that follows from "
                "it; take a load of kind friction, or give gears their pressure_angle"
            )
        if one.asks_forces and (np.any(is_open) or np.any(balance.slides)):
            wanted = lacking(mechanism, driven.motion.frames[0]).wanted
            more = f"; a file that says {listing(wanted)} determines it" if wanted else ""
            raise SolveError(
                f"{mechanism.name}: loads.{one.name}: the force through the centre in pair "
                f"{one.pair} is not determined, and so the friction of its bearings that "
                f"axial asks for{more}; without axial it is that of the couple alone"
            )


def _solved(still: Floats, change: Floats, factors: Floats) -> tuple[Floats, Bools, int]:
    """Return what is carried, and what is not known, given a, b and r of the module."""
    sizes = np.sum(np.linalg.norm(change, axis=3), axis=2)
    feedback = max_abs(np.linalg.eigvals(np.abs(factors)[..., None] * sizes), axis=1)

    def at(friction: Floats) -> Floats:
        return still + np.einsum("nkjal,nl->nkja", change, friction)

    def load(friction: Floats) -> Floats:
        return np.sum(np.linalg.norm(at(friction), axis=3), axis=2)

    friction = np.zeros_like(factors)
    one = np.eye(factors.shape[1])
    carried = load(friction)
    for rounds in count(1):
        before = carried
        plain = factors * carried
        forces = at(friction)
        strengths = np.linalg.norm(forces, axis=3, keepdims=True)
        with np.errstate(invalid="ignore", divide="ignore"):
            along = np.nan_to_num(forces / strengths)
        slope = np.einsum("nk,nkja,nkjal->nkl", factors, along, change)
        regular = feedback < 1.0
        matrix = np.where(regular[:, None, None], one - slope, one)
        newton = friction + np.linalg.solve(matrix, (plain - friction)[..., None])[..., 0]
        tried = [(guess, load(guess)) for guess in (plain, newton)]
        left = [max_abs(guess - factors * size, axis=1) for guess, size in tried]
        better = (left[1] < left[0])[:, None]
        friction, carried = (np.where(better, b, a) for a, b in zip(*tried, strict=True))
        gap = max_abs(carried - before, axis=1)
        moved = regular & ~(gap <= SETTLED * np.max(carried, axis=1))
        if rounds == MOST_ROUNDS or not np.any(moved):
            break
    return carried, moved | ~regular, rounds


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
