"""The inverse problem: the torque that drives a mechanism through a given motion."""

from dataclasses import dataclass, replace
from typing import final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spherekit.checked import checked
from spherekit.conventions import SINGULAR_RATIO, Status
from spherekit.dynamics.forces import Loads
from spherekit.dynamics.inertia import inertia
from spherekit.dynamics.kinematics import by_arc_length
from spherekit.dynamics.start import into_range, reaching
from spherekit.errors import ModelError, SolveError
from spherekit.files.read import AnyMechanism, mechanism_of
from spherekit.model.laws import TimeLaw
from spherekit.model.mechanism import Mechanism
from spherekit.motion.continued import AngleMemory
from spherekit.motion.motion import Tracer
from spherekit.rates.core import driven_rates
from spherekit.sphere.rotation import Floats

DEAD_CENTRE = 1e-6
"""An input whose rate along the curve is smaller loses half the digits of all rates."""


def driving_torque(B: Floats, dB: Floats, Q: Floats, dq: Floats, ddq: Floats) -> Floats:
    """Return tau (n,) = B q'' + 1/2 dB/dq q'^2 - Q, N m.

    Eksergian's equation solved for the torque at the pair of q (Di Gregorio 2024,
    eq. (21), with the factor 1/2 q'^2 of eq. (17)); Q is of all other loads.
    """
    return np.asarray(B * ddq + 0.5 * dB * dq**2 - Q)


def total(parts: Floats, status: NDArray[np.int8]) -> Floats:
    """Return sums (n,) of parts (n, k), NaN in rows that failed, also where k is 0."""
    return np.where(status == Status.OK, np.sum(parts, axis=1), np.nan)


@final
@dataclass(frozen=True)
class InverseSolution:
    """The driving torque, row after row: mode after mode, in each the times.

    `sample`, `assembly_mode`, `status` (n,); `t` s; `q`, `dq`, `ddq` the law of the input;
    `B_parts`, `dB_parts` (n, masses) kg m2 by the input; `Q_parts` (n, loads) N m;
    `tau` (n,) N m at the input; `values` (n, variables) rad; `pair_rates` (n, variables)
    rates of the pair variables per unit rate of the input; `residual` (n,) rad.
    Failed rows are NaN.
    """

    mechanism: Mechanism
    sample: NDArray[np.int64]
    assembly_mode: NDArray[np.int64]
    t: Floats
    q: Floats
    dq: Floats
    ddq: Floats
    B_parts: Floats
    dB_parts: Floats
    Q_parts: Floats
    tau: Floats
    values: Floats
    pair_rates: Floats
    residual: Floats
    status: NDArray[np.int8]

    def __repr__(self) -> str:
        failed = int(np.count_nonzero(self.status))
        return (
            f"<InverseSolution of {self.mechanism.name}: {len(self.t)} rows in "
            f"{len(set(self.assembly_mode.tolist()))} assembly modes, {failed} failed>"
        )

    @property
    def B(self) -> Floats:
        """(n,) equivalent inertia, kg m2."""
        return total(self.B_parts, self.status)

    @property
    def dB_dq(self) -> Floats:
        """(n,) its derivative, kg m2/rad."""
        return total(self.dB_parts, self.status)

    @property
    def Q(self) -> Floats:
        """(n,) generalised force of all loads, N m."""
        return total(self.Q_parts, self.status)

    @property
    def kinetic(self) -> Floats:
        """(n,) kinetic energy, J."""
        return np.asarray(0.5 * self.B * self.dq**2)

    @property
    def power(self) -> Floats:
        """(n, loads) power of each load, W."""
        return np.asarray(self.Q_parts * self.dq[:, None])

    def torque_at(self, pair: str) -> Floats:
        """Return the torque (n,) in N m that does the same at another R pair.

        Not finite at the dead centres of that pair, where no torque there does it.
        """
        (number,) = self.mechanism.variables_of(self.mechanism.pair_number[pair])
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(self.tau / self.pair_rates[:, number])


@checked(SolveError)
def inverse_dynamics(
    mechanism: AnyMechanism,
    law: TimeLaw,
    times: ArrayLike,
    *,
    input_pair: str | None = None,
    assembly_mode: int | None = None,
    search: bool = True,
) -> InverseSolution:
    """Return the torque that moves the input by a law against inertia and loads.

    Parameters
    ----------
    mechanism
        A single-DOF mechanism with masses.
    law
        Variable, rate and acceleration of the input by time.
    times
        (k,) increasing times, s.
    input_pair, assembly mode, search
        See `spherekit.trace`.

    Raises
    ------
    ModelError, PlanError, SolveError
        Before any sample is computed. Samples that cannot be reached get a status.
    """
    mechanism = mechanism_of(mechanism)
    t = np.atleast_1d(np.asarray(times, dtype=float))
    if t.ndim != 1 or not (np.all(np.isfinite(t)) and np.all(np.diff(t) > 0.0)):
        raise SolveError(
            f"{mechanism.name}: the times (k,) of samples must be finite and increase"
        )
    need_terms(mechanism)
    loads = Loads(mechanism)
    q, dq, ddq = law.at(t)
    tracer = reaching(
        Tracer(mechanism, input_pair, assembly_mode, search), q, assembly_mode, search
    )
    motion = tracer.at(into_range(tracer, q))
    count = len(tracer.assembly_modes)
    values = motion.values.copy()
    pairs, owners = tracer.mechanism.pairs, tracer.mechanism.variable_owners
    names = {number: pairs[owners[number]].name for number in tracer.solver.angles}
    angles = AngleMemory().continued(motion, names.values())
    for number, name in names.items():
        values[:, number] = angles[name]
    values[:, tracer.solver.single] = np.tile(q, count)
    arc = by_arc_length(tracer.solver.closure, motion.values)
    found = replace(arc.by_variable(tracer.solver.single), values=values)
    t, q, dq, ddq = (np.tile(x, count) for x in (t, q, dq, ddq))
    with np.errstate(over="ignore", invalid="ignore"):
        masses = inertia(mechanism, found)
        forces = loads.parts(found, dq, t)
        tau = driving_torque(masses.B, masses.dB, np.sum(forces, axis=1), dq, ddq)
    status = motion.status.copy()
    flat = ~(np.abs(arc.rates[:, tracer.solver.single]) >= DEAD_CENTRE)
    held = ~motion.failed
    # Where assembly modes nearly cross, rounding of the configuration decides the
    # derivatives.
    kept = driven_rates(motion, held, tracer.assembly.input).reciprocal_condition
    flat[held] |= ~(kept >= SINGULAR_RATIO)
    status[(status == Status.OK) & flat] = Status.AT_SINGULARITY
    status[(status == Status.OK) & ~np.isfinite(tau)] = Status.OVERFLOW
    bad = status != Status.OK
    rows = (masses.B_parts, masses.dB_parts, forces, tau, values, found.rates)
    for array in rows:
        array[bad] = np.nan
    return InverseSolution(
        tracer.mechanism,
        motion.sample,
        motion.assembly_mode,
        t,
        q,
        dq,
        ddq,
        *rows,
        motion.residual,
        status,
    )


def need_terms(mechanism: Mechanism) -> None:
    """Raise `ModelError` if there is neither inertia nor a load, so no torque at all."""
    if not mechanism.masses and not mechanism.loads:
        raise ModelError(
            f"{mechanism.name}: has neither masses nor loads, so it needs no torque; give "
            "at least one [mass.LINK] or [loads.NAME]"
        )
