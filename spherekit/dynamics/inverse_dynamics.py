"""The inverse problem: the torques of a given motion, or that hold a mechanism at rest."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from spherekit.argument_validation import checked
from spherekit.arrays import Bools, Floats, Integers, SmallIntegers
from spherekit.dynamics.bearing_friction import solve_bearing_friction
from spherekit.dynamics.configurations_at_inputs import compute_modes_at_inputs
from spherekit.dynamics.coordinates import (
    CoordinateMotion,
    Inertia,
    InputMotion,
    by_variables,
    determined,
    driving_torques,
    inertia,
    single,
)
from spherekit.dynamics.generalised_forces import Loads
from spherekit.dynamics.transmitted_forces import DrivenState
from spherekit.errors import ModelError, SolveError
from spherekit.files.mechanism_reader import AnyMechanism, mechanism_of
from spherekit.files.time_law import TimeLaw
from spherekit.geometry.vectors import all_finite, nans
from spherekit.mechanism.mechanism import Mechanism
from spherekit.outputs.rotation_timing import TimeScaling
from spherekit.planning.assembly_plan import driven_at
from spherekit.positions.angle_unwrapping import unwrap_motion
from spherekit.positions.loop_closure import Closure
from spherekit.positions.motion import Motion
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.positions.timing import Timing, evaluate_time_laws
from spherekit.status import Status
from spherekit.velocities.pole_evaluation import evaluate_unsigned
from spherekit.velocities.pole_request import request
from spherekit.wording import counted, listing

DEAD_CENTRE = 1e-6
"""Inputs that say less surely how all variables move lose half the digits of rates."""


ROUNDING = 1e-13
"""Torques that are a smaller part of the terms that they are the sum of are zero."""


def total(parts: Floats, status: SmallIntegers) -> Floats:
    """Return sums (n, ...) of parts (n, k, ...), NaN in rows that failed, also of none."""
    with np.errstate(over="ignore"):
        sums: Floats = np.sum(parts, axis=1)
    sums[status != Status.OK] = np.nan
    return sums


def of_parts(parts: Floats, status: SmallIntegers) -> SmallIntegers:
    """Return (n, k) why parts (n, k) of rows with a status (n,) are NaN, else OK."""
    return np.where(np.isfinite(parts), np.int8(Status.OK), status[:, None])


def judged(
    status: SmallIntegers,
    masses: Inertia,
    forces: Floats,
    torques: Floats,
    rates: Floats,
    locked: Bools | bool,
) -> SmallIntegers:
    """Return the status (n,) of torques (n, m), and blank what is not known.

    `status` is that of the rates, on which inertia depends: that stays where a load of
    `forces` (n, m, loads) is no number, or bearings are `locked`, and so do other loads.
    """
    rated = status == Status.OK
    status = status.copy()
    status[rated & locked] = Status.NOT_CONVERGED
    with np.errstate(over="ignore", invalid="ignore"):
        powers = np.einsum("ni,nil->nl", rates, forces)
    finite = np.isfinite(powers) & all_finite(forces, 1)
    lost = ~(all_finite(torques, 1) & np.all(finite, axis=1))
    status[(status == Status.OK) & lost] = Status.OVERFLOW
    for parts in (masses.M_parts, masses.dM_parts):
        parts[~rated] = np.nan
        parts[~np.isfinite(parts)] = np.nan
    held = finite & np.isin(status, (Status.OK, Status.OVERFLOW))[:, None]
    np.moveaxis(forces, 1, 2)[~held] = np.nan
    torques[status != Status.OK] = np.nan
    return status


@dataclass(frozen=True)
class InverseSolution(InputMotion):
    """The driving torques, row after row: mode after mode, in each the times.

    `sample`, `assembly_mode`, `status` (n,); `t` s; `inputs`, `input_rates`,
    `input_accelerations` (n, inputs) the motion of the inputs; `M_parts` (n, masses,
    inputs, inputs) kg m2 and `dM_parts` (n, masses, inputs, inputs, inputs) by the inputs;
    `Q_parts` (n, inputs, loads) N m; `torques` (n, inputs) N m at the inputs; `values` (n,
    variables) rad; `motion` what moves how by the inputs; `residual` (n,) rad. Failed rows
    are NaN; what does not depend on loads is so where `rate_status` (n,) says why. Where
    bearings rub, `carried` (n, k) N are the sums of the forces that their friction follows
    from, of each such load, found in `rounds` of iteration.
    """

    mechanism: Mechanism
    sample: Integers
    assembly_mode: Integers
    t: Floats
    inputs: Floats
    input_rates: Floats
    input_accelerations: Floats
    M_parts: Floats
    dM_parts: Floats
    Q_parts: Floats
    torques: Floats
    values: Floats
    motion: CoordinateMotion
    residual: Floats
    status: SmallIntegers
    rate_status: SmallIntegers
    carried: Floats | None = None
    rounds: int = 0

    def __repr__(self) -> str:
        return (
            f"<InverseSolution of {self.mechanism.name}: {counted(len(self.t), 'row')} in "
            f"{counted(len(np.unique(self.assembly_mode)), 'assembly mode')}, "
            f"{np.count_nonzero(self.status)} failed>"
        )

    @property
    def M(self) -> Floats:
        """(n, inputs, inputs) inertia matrix, kg m2."""
        return total(self.M_parts, self.rate_status)

    @property
    def dM(self) -> Floats:
        """(n, inputs, inputs, inputs) its derivatives by the inputs, the last axis."""
        return total(self.dM_parts, self.rate_status)

    @property
    def Q_all(self) -> Floats:
        """(n, inputs) generalised forces of all loads, N m."""
        return total(np.moveaxis(self.Q_parts, 2, 1), self.status)

    @property
    def sure_torques(self) -> Floats:
        """(n, inputs) driving torques, zero where they are less than rounding leaves."""
        speeds = np.abs(self.input_rates)
        with np.errstate(over="ignore"):
            moved = np.max(speeds, axis=1)[:, None] * speeds
            moved += np.abs(self.input_accelerations)
            terms = np.einsum("nkij,nj->ni", np.abs(self.M_parts), moved)
            terms += np.sum(np.abs(self.Q_parts), axis=2)
            return np.where(np.abs(self.torques) <= ROUNDING * terms, 0.0, self.torques)

    @property
    def kinetic(self) -> Floats:
        """(n,) kinetic energy, J."""
        return 0.5 * np.einsum("ni,nij,nj->n", self.input_rates, self.M, self.input_rates)

    @property
    def power(self) -> Floats:
        """(n, loads) power of each load, W."""
        return np.einsum("ni,nil->nl", self.input_rates, self.Q_parts)

    @property
    def tau(self) -> Floats:
        """(n,) driving torque at the only input, N m; `SolveError` with several."""
        return single(self.torques)

    @property
    def B_parts(self) -> Floats:
        """(n, masses) parts of the equivalent inertia, kg m2."""
        return single(self.M_parts[..., 0])

    @property
    def dB_parts(self) -> Floats:
        """(n, masses) their derivatives by the input."""
        return single(self.dM_parts[..., 0, 0])

    @property
    def B(self) -> Floats:
        """(n,) equivalent inertia, kg m2."""
        return single(self.M[..., 0])

    @property
    def dB_dq(self) -> Floats:
        """(n,) its derivative, kg m2/rad."""
        return single(self.dM[..., 0, 0])

    @property
    def Q(self) -> Floats:
        """(n,) generalised force of all loads, N m."""
        return single(self.Q_all)

    @property
    def rates(self) -> Floats:
        """(n, inputs, variables) rates of pair variables per unit rate of each input."""
        return self.motion.rates

    @property
    def pair_rates(self) -> Floats:
        """(n, variables) rates of the pair variables per unit rate of the input."""
        return single(np.moveaxis(self.rates, 1, 2))

    def torque_at(self, pair: str) -> Floats:
        """Return the torque (n,) in N m that does the same at another R pair.

        Not finite at the dead centres of that pair, where no torque there does it.
        """
        (number,) = self.mechanism.variables_of(self.mechanism.pair_number[pair])
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.tau / self.pair_rates[:, number]


@checked(SolveError)
def inverse_dynamics(
    mechanism: AnyMechanism,
    law: TimeLaw | Mapping[str, TimeLaw] | TimeScaling,
    times: ArrayLike,
    *,
    input_pair: str | None = None,
    assembly_mode: int | None = None,
    search: bool = True,
) -> InverseSolution:
    """Return the torques that move the inputs by laws against inertia and loads.

    Parameters
    ----------
    mechanism
        One with masses, loads or both.
    law
        Variable, rate and acceleration of the input by time, of several inputs a mapping
        from their names; or a rotation of an output in time (`spherekit.time_optimal`), in
        its own assembly mode.
    times
        (k,) increasing times, s.
    input_pair, assembly mode, search
        See `spherekit.trace`; not for a rotation, which has its own.

    Raises
    ------
    ModelError, PlanError, SolveError
        Before any sample is computed. Samples that cannot be reached get a status.

    Examples
    --------
    >>> import spherekit as sk
    >>> laws = {"21": sk.ConstantSpeed(0.5, 1.0), "51": sk.ConstantSpeed(-0.2, 1.5)}
    >>> found = sk.inverse_dynamics("five_bar", laws, [0.0, 0.5], assembly_mode=0)
    >>> found.torques.shape
    (2, 2)
    """
    mechanism = mechanism_of(mechanism)
    t = np.atleast_1d(np.asarray(times, dtype=float))
    if t.ndim != 1 or not (all_finite(t) and np.all(np.diff(t) > 0.0)):
        raise SolveError(
            f"{mechanism.name}: the times (k,) of samples must be finite and increase"
        )
    need_terms(mechanism)
    if isinstance(law, TimeScaling):
        return needed_torques(_scheduled(mechanism, law, t))
    mechanism, laws = _driven(mechanism, law, input_pair)
    q, timing = evaluate_time_laws(mechanism.input_pairs, laws, t)
    tracer, motion = compute_modes_at_inputs(mechanism, q, assembly_mode, search)
    motion = replace(motion, timing=timing.repeated(len(tracer.assembly_modes)))
    return needed_torques(unwrap_motion(motion, tracer.angle_unwrapping))


def _driven(
    mechanism: Mechanism, law: TimeLaw | Mapping[str, TimeLaw], input_pair: str | None
) -> tuple[Mechanism, Mapping[str, TimeLaw]]:
    """Return a mechanism with the inputs that laws are of, and the law of each."""
    if not isinstance(law, Mapping):
        mechanism = driven_at(mechanism, input_pair)
        law = {mechanism.input_pairs[0]: law}
    inputs = mechanism.input_pairs
    if len(law) < len(inputs):
        lacking = next(pair for pair in inputs if pair not in law)
        raise SolveError(
            f"{mechanism.name}: input {lacking} has no law; give one for every input by "
            f"its name ({listing(inputs)})"
        )
    return mechanism.with_inputs(*(inputs if {*inputs} == {*law} else law)), law


def _scheduled(mechanism: Mechanism, schedule: TimeScaling, t: Floats) -> Motion:
    """Return the motion of a rotation in time, its angles going on."""
    rows = schedule.at(t)
    tracer = PositionAnalysis(mechanism.with_inputs(*rows.names), follow=False)
    motion = tracer.given(schedule.rotation.at(rows.theta).values)
    timing = Timing(t, rows.rates, rows.accelerations)
    motion = replace(motion, inputs=rows.inputs, status=rows.status, timing=timing)
    return unwrap_motion(motion, tracer.angle_unwrapping)


def needed_torques(motion: Motion) -> InverseSolution:
    """Return the torques at the inputs that a motion in time needs.

    Parameters
    ----------
    motion
        Of all inputs, with its timing; its angles are those that loads see.
    """
    assert motion.timing is not None
    mechanism = motion.mechanism
    timing = motion.timing
    status = motion.status.copy()
    numbers = [mechanism.variables_of(pair)[0] for pair in motion.assembly.inputs]
    coordinates = by_variables(Closure.of(mechanism, motion.joints), motion.values, numbers)
    flat = ~(determined(coordinates.rates) >= DEAD_CENTRE)
    held = ~motion.failed
    # Where assembly modes nearly cross, rounding of the configuration decides the
    # derivatives.
    for name in mechanism.names_of(motion.assembly.inputs):
        wanted = request(mechanism, name, (), by_rank=True)
        field = evaluate_unsigned(motion.rows(held), wanted)
        # Inertia is computed in float64, by the rounded sizes. Rows whose rates are known
        # by the decimal sizes of the file alone are too near a singularity for that.
        flat[held] |= (field.status != Status.OK) | field.is_decimal
    status[(status == Status.OK) & flat] = Status.AT_SINGULARITY
    rows = motion.sample, motion.assembly_mode, motion.inputs, motion.residual
    of = mechanism, rows, timing, coordinates, status
    solution = balancing(*of)
    loads = Loads(mechanism)
    if loads.friction_components:
        good = all_finite(solution.torques, 1)
        every = DrivenState(mechanism, coordinates, timing, solution.torques)
        with np.errstate(over="ignore", invalid="ignore"):
            friction = solve_bearing_friction(every, loads, good)
        friction.carried[~good] = 0.0
        solution = replace(
            balancing(*of, friction.is_unknown, friction.carried),
            rounds=friction.iterations,
        )
    for array in (solution.values, coordinates.rates, coordinates.frames):
        array[status != Status.OK] = np.nan
    return solution


def balancing(
    mechanism: Mechanism,
    rows: tuple[Integers, Integers, Floats, Floats],
    timing: Timing,
    coordinates: CoordinateMotion,
    rate_status: SmallIntegers,
    locked: Bools | bool = False,
    carried: Floats | None = None,
) -> InverseSolution:
    """Return the torques that balance inertia and loads, given how all moves by the inputs.

    Parameters
    ----------
    rows
        The samples, assembly modes, inputs (n, inputs) and residuals of the rows.
    rate_status
        (n,) the status of what does not depend on loads.
    locked, carried
        Where (n,) bearings that rub lock, and what they carry, see `InverseSolution`.
    """
    sample, assembly_mode, inputs, residual = rows
    with np.errstate(over="ignore", invalid="ignore"):
        masses = inertia(mechanism, coordinates)
        forces = Loads(mechanism).evaluate_forces(coordinates, timing.dq, timing.t, carried)
        Q = np.sum(forces, axis=2)
        torques = driving_torques(masses.M, masses.dM, Q, timing.dq, timing.ddq)
    return InverseSolution(
        mechanism,
        sample,
        assembly_mode,
        timing.t,
        inputs,
        timing.dq,
        timing.ddq,
        masses.M_parts,
        masses.dM_parts,
        forces,
        torques,
        coordinates.values.copy(),
        coordinates,
        residual,
        judged(rate_status, masses, forces, torques, timing.dq, locked),
        rate_status,
        carried,
    )


def need_terms(mechanism: Mechanism) -> None:
    """Raise `ModelError` if there is neither inertia nor a load, so no torque at all."""
    if not mechanism.masses and not mechanism.loads:
        raise ModelError(
            f"{mechanism.name}: has neither masses nor loads, so it needs no torque; give "
            "at least one [mass.LINK] or [loads.NAME]"
        )


def holding_torques(motion: Motion, t: float = 0.0) -> InverseSolution:
    """Return the torques at the inputs that hold a mechanism at rest against its loads.

    Parameters
    ----------
    motion
        Configurations in rows; their timing does not matter.
    t
        The time (s) at which loads that depend on it are taken.
    """
    still = np.zeros_like(motion.inputs)
    timing = Timing(np.full(len(motion), t), still, still)
    return needed_torques(replace(motion, timing=timing))


RIGID = 1e-12
"""An axis whose compliance is below this part of the largest does not yield; an input that
moves a link by less than this part of the fastest link does not move it."""


@dataclass(frozen=True)
class Stiffness:
    """How inputs hold a link relative to another one at n rows.

    `w` (n, inputs, 3): its angular velocity per unit rate of each input, in ground axes.
    `advantage` (n, inputs): the moment about the axis of w that a unit torque at that input
    balances while the others are locked, one over the size of w; infinite where the input
    does not move the link. `stiffness` (n, 3) N m/rad rising and `axes` (n, 3, 3), in rows:
    the principal ones of the link where every input yields by its torque over its
    stiffness; about axes that do not yield it is infinite, and the axis NaN.
    """

    w: Floats
    advantage: Floats
    stiffness: Floats
    axes: Floats


def output_stiffness(
    solution: InverseSolution, link: str, relative_to: str, stiffness: Floats
) -> Stiffness:
    """Return how inputs hold a link, each yielding by its own stiffness.

    Parameters
    ----------
    solution
        Torques or holding torques, whose rates are used.
    link, relative_to
        Names of two links.
    stiffness
        (inputs,) N m/rad.

    Notes
    -----
    A moment m on the link is balanced by the torques w_i . m, which turn the inputs by
    w_i . m / k_i, and the link by C m with C = sum of w_i w_i^T / k_i. That the loads
    change as the mechanism yields is left out.
    """
    number = solution.mechanism.link_number
    every = solution.motion.w
    w = every[:, :, number[link]] - every[:, :, number[relative_to]]
    fastest = np.max(np.linalg.norm(every, axis=3), axis=2)
    w[np.linalg.norm(w, axis=2) < RIGID * fastest] = 0.0
    good = solution.rate_status == Status.OK
    w[~good] = np.nan
    compliance = np.einsum("nia,nib,i->nab", w, w, 1.0 / stiffness)
    values = nans((len(w), 3))
    vectors = nans((len(w), 3, 3))
    values[good], turned = np.linalg.eigh(compliance[good])
    vectors[good] = np.swapaxes(turned, 1, 2)
    values[values < RIGID * values[:, -1:]] = 0.0
    vectors[values == 0.0] = np.nan
    # Each axis points to the side to which the inputs turn the link together.
    side = np.sum(w / (1.0 + np.arange(w.shape[1]))[:, None], axis=1)
    vectors *= np.where(vectors @ side[..., None] < 0.0, -1.0, 1.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        advantage = 1.0 / np.linalg.norm(w, axis=2)
        return Stiffness(w, advantage, 1.0 / values[:, ::-1], vectors[:, ::-1])
