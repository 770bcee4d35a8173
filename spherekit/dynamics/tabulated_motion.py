"""The direct problem of a stored model: its motion under its loads, in two scalars.

The state is the coordinate x of the model, q or s, the momentum p = sqrt(B) x' and the
work W of all loads. As in `spherekit.dynamics.state`, which holds in any coordinate,

    dx/dt = p / sqrt(B),   dp/dt = Q / sqrt(B),   dW/dt = Q dx/dt.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import final

import numpy as np

from spherekit.checked import checked
from spherekit.dynamics.tabulated import Floats, TabulatedModel
from spherekit.errors import SolveError

MARGIN = 0.03
"""The integrator's own tolerance per step, as part of the error tolerated in the end."""


@final
@dataclass(frozen=True)
class TabulatedMotion:
    """The motion at times `t` (n,), s; NaN after the curve has ended.

    `x` (n,) coordinate of the model; `values`, `value_rates` (n, variables); `q`, `dq` of
    the input, rad and rad/s; `kinetic`, `work` (n,) J; `message` says why it ended;
    `evaluations` counts calls of the right-hand side.
    """

    t: Floats
    x: Floats
    values: Floats
    value_rates: Floats
    q: Floats
    dq: Floats
    kinetic: Floats
    work: Floats
    message: str
    evaluations: int

    @property
    def energy(self) -> float:
        """Largest difference of kinetic energy gained and work of the loads, J."""
        gap = self.kinetic - self.kinetic[0] - self.work
        return float(np.nanmax(np.abs(gap)))


@checked(SolveError)
def online_motion(
    model: TabulatedModel,
    times: Sequence[float] | Floats,
    x: float,
    dx: float,
    tolerance: float = 1e-9,
    switches: Iterable[float] = (),
) -> TabulatedMotion:
    """Return the motion of a stored model at times (n,), by SciPy's LSODA.

    Parameters
    ----------
    model
        One with masses; a driving torque is given by `OnlineModel.with_torque`.
    times
        Increasing times (s), the first that of the start.
    x, dx
        Coordinate of the model and its rate at the start.
    tolerance
        Error aimed at in x (rad).
    switches
        Times (s) at which expressions have kinks; knots of torque tables are known.

    Raises
    ------
    SolveError
        If times do not increase, the model has no inertia or not this coordinate, or the
        integrator gives up.
    """
    from scipy.integrate import odeint

    heading, name = model.heading, model.heading.mechanism
    t = np.atleast_1d(np.asarray(times, dtype=float))
    if len(t) < 2 or not (np.all(np.isfinite(t)) and np.all(np.diff(t) > 0.0)):
        raise SolveError(f"{name}: give two or more finite, increasing times")
    at, force = model.state.at, model.state.force
    low, high = heading.low, heading.high
    inertia = at(x)[0]
    if not inertia > 0.0:
        raise SolveError(f"{name}: has no inertia, so loads would accelerate it endlessly")

    def right(time: float, state: Floats) -> tuple[float, float, float]:
        place, p, _ = state.tolist()
        row = at(place if heading.periodic else min(max(place, low), high))
        root = 1.0 / sqrt(row[0])
        speed = p * root
        push = force(row, speed, time)
        return speed, push * root, push * speed

    tighter = max(MARGIN * tolerance, 1e-14)
    kinks = set(switches)
    for load in heading.loads:
        if load.table is not None:
            kinks |= set(load.table.knots(float(t[0]), float(t[-1])))
    critical = sorted(time for time in kinks if t[0] < time < t[-1])
    states, notes = odeint(
        right,
        [x, sqrt(inertia) * dx, 0.0],
        t,
        tfirst=True,
        rtol=tighter,
        atol=tighter,
        mxstep=100_000,
        tcrit=critical or None,
        full_output=True,
    )
    if notes["message"] != "Integration successful.":
        raise SolveError(f"{name}: {notes['message']}")
    return _motion(model, t, states, int(notes["nfe"][-1]))


def _motion(
    model: TabulatedModel, t: Floats, states: Floats, evaluations: int
) -> TabulatedMotion:
    heading, message = model.heading, ""
    x, p, work = states.T
    if not heading.periodic:
        beyond = np.flatnonzero((x < heading.low) | (x > heading.high))
        if len(beyond):
            message = f"the curve ends before t = {t[beyond[0]]:.6g} s"
            x, p, work = x.copy(), p.copy(), work.copy()
            for array in (x, p, work):
                array[beyond[0] :] = np.nan
    finite = np.isfinite(x)
    rows = np.full((len(x), 2 * len(heading.variables)), np.nan)
    dx = np.full(len(x), np.nan)
    names = [*heading.variables, *map(heading.derivative, heading.variables)]
    for column, name in enumerate(names):
        rows[finite, column] = model.value(name, x[finite])
    dx[finite] = p[finite] / np.sqrt(model.inertia(x[finite]))
    values, tangents = np.split(rows, 2, axis=1)
    rates = tangents * dx[:, None]
    driven = heading.variables.index(f"theta_{heading.input}")
    return TabulatedMotion(
        t,
        x,
        values,
        rates,
        values[:, driven],
        rates[:, driven],
        0.5 * p**2,
        work,
        message,
        evaluations,
    )
