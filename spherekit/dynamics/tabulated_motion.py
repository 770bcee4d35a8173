"""The direct problem of a stored model: its motion under its loads, in two scalars.

The state is the coordinate x of the model, q or s, the momentum p = sqrt(B) x' and the
work W of all loads. As in `spherekit.dynamics.state`, which holds in any coordinate,

    dx/dt = p / sqrt(B),   dp/dt = Q / sqrt(B),   dW/dt = Q dx/dt.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import chain
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
    heading, name = model.heading, model.heading.mechanism
    t = np.atleast_1d(np.asarray(times, dtype=float))
    if len(t) < 2 or not (np.all(np.isfinite(t)) and np.all(np.diff(t) > 0.0)):
        raise SolveError(f"{name}: give two or more finite, increasing times")
    at, low, high = model.dynamics.at, heading.low, heading.high
    inertia = at(x)[0]
    if not inertia > 0.0:
        raise SolveError(f"{name}: has no inertia, so loads would accelerate it endlessly")

    def right(time: float, state: Floats) -> tuple[float, float, float]:
        place, p, _ = state.tolist()
        within = place if heading.periodic else min(max(place, low), high)
        row = at(within)
        root = 1.0 / sqrt(row[0])
        speed = p * root
        push = row[1] * speed * speed - model.torque_at(row, within, speed, 0.0, time)
        return speed, push * root, push * speed

    tighter = max(MARGIN * tolerance, 1e-14)
    start, stop = float(t[0]), float(t[-1])
    tables = [load.table.knots(start, stop) for load in heading.loads if load.table]
    critical = sorted(k for k in {*chain(switches, *tables)} if start < k < stop)
    from scipy.integrate import odeint

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
    """Return the motion of states (n, 3): the coordinate, momentum and work."""
    heading = model.heading
    message, reached = "", states[:, 0]
    if not heading.periodic:
        beyond = np.flatnonzero((reached < heading.low) | (reached > heading.high))
        if len(beyond):
            message = f"the curve ends before t = {t[beyond[0]]:.6g} s"
            states[beyond[0] :] = np.nan
    places, p, work = states.T
    finite = np.isfinite(places)
    rows = np.full((2, len(heading.variables), len(t)), np.nan)
    speeds = np.full(len(t), np.nan)
    speeds[finite] = p[finite] / np.sqrt(model.inertia(places[finite]))
    for k, variable in enumerate(heading.variables):
        for row, function in zip(
            rows, (variable, heading.derivative(variable)), strict=True
        ):
            row[k, finite] = model.value(function, places[finite])
    values, rates = rows[0].T, rows[1].T * speeds[:, None]
    driven = heading.variables.index(f"theta_{heading.input}")
    return TabulatedMotion(
        t,
        places,
        values,
        rates,
        values[:, driven],
        rates[:, driven],
        0.5 * p**2,
        work,
        message,
        evaluations,
    )
