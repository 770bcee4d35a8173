"""A mechanism reduced to functions of the arc length of its curve: once made, quick.

Of a mechanism that moves along one curve, dynamics needs but a few functions of the arc
length s: the pair variables, their tangents, B, and the velocities that the loads work
on. They are computed once (Di Gregorio 2024, section 4), on a closed curve as
Fourier series, and the direct problem is left with two scalars: s and its
rate u, the latter as p = sqrt(B) u, see `spherekit.dynamics.state`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np

from spherekit.dynamics.inertia import equivalent_inertia
from spherekit.dynamics.start import Problem
from spherekit.errors import SolveError
from spherekit.motion.arc_curve import ArcCurve
from spherekit.motion.arc_length import follow_arc
from spherekit.motion.segments import CurvePoints
from spherekit.numeric.chebyshev import PiecewiseChebyshev
from spherekit.numeric.periodic import Periodic
from spherekit.sphere.rotation import Floats

MARGIN = 0.03
"""The integrator's own tolerance per step, as part of the error tolerated in the end."""


@final
@dataclass(frozen=True)
class ReducedMotion:
    """The motion at times `t` (n,), s; NaN after the curve has ended.

    `s`, `speed` (n,) along the curve; `values`, `value_rates` (n, variables); `q`, `dq`
    of the input, rad and rad/s; `kinetic`, `work` (n,) J; `message` says why it ended;
    `evaluations` counts calls of the right-hand side.
    """

    t: Floats
    s: Floats
    speed: Floats
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


@final
@dataclass(frozen=True)
class ReducedModel:
    """Functions of the arc length s of one configuration curve.

    `functions` (of s) gives the columns: values (variables), tangents (variables),
    1/sqrt(B), velocities (load components). `error` of it is measured. `start` is (s, u).
    """

    problem: Problem
    curve: ArcCurve
    functions: Periodic | PiecewiseChebyshev
    start: tuple[float, float]

    @property
    def error(self) -> float:
        """Measured error of the functions, relative to the largest value of all."""
        return self.functions.error

    def simulate(
        self,
        times: Sequence[float] | Floats,
        tolerance: float = 1e-9,
        start: tuple[float, float] | None = None,
    ) -> ReducedMotion:
        """Return the motion at increasing times (n,) in s, the first that of the start.

        By SciPy's LSODA in the state s, p and the work of all loads.

        Parameters
        ----------
        tolerance
            Error aimed at in s (rad).
        start
            Arc length and speed at the first time, by default those of the problem.

        Raises
        ------
        SolveError
            If times do not increase or the integrator gives up.
        """
        from scipy.integrate import odeint

        name = self.problem.equation.mechanism.name
        t = np.atleast_1d(np.asarray(times, dtype=float))
        if len(t) < 2 or not (np.all(np.isfinite(t)) and np.all(np.diff(t) > 0.0)):
            raise SolveError(f"{name}: give two or more finite, increasing times")
        s, u = self.start if start is None else start
        own = max(MARGIN * tolerance, 1e-14)
        found, notes = odeint(
            self.right,
            [s, u / self.functions.one(s)[2 * self.problem.equation.variables], 0.0],
            t,
            tfirst=True,
            rtol=own,
            atol=own,
            mxstep=100_000,
            tcrit=self.problem.switches or None,
            full_output=True,
        )
        if notes["message"] != "Integration successful.":
            raise SolveError(f"{name}: {notes['message']}")
        return self._motion(t, found, int(notes["nfe"][-1]))

    @cached_property
    def right(self) -> Callable[[float, Floats], tuple[float, float, float]]:
        """The equation of motion of one state (s, p, work) at time t."""
        one = self.functions.one
        root_at = 2 * self.problem.equation.variables
        parts = tuple(enumerate(self.problem.equation.loads.row_magnitudes, root_at + 1))

        def right(t: float, state: Floats) -> tuple[float, float, float]:
            s, p, _ = state.tolist()
            row = one(s).tolist()
            root = row[root_at]
            u = p * root
            row += t, u
            force = 0.0
            for column, magnitude in parts:
                force += magnitude(row) * row[column]
            return u, force * root, force * u

        return right

    def _motion(self, t: Floats, found: Floats, evaluations: int) -> ReducedMotion:
        s, p, work = found.T
        message = ""
        if not self.curve.closed:
            beyond = np.flatnonzero((s < 0.0) | (s > self.curve.length))
            if len(beyond):
                code = self.curve.ends[int(s[beyond[0]] > 0.0)]
                message = f"the curve ends ({code.name}) before t = {t[beyond[0]]:.6g} s"
                s, p, work = s.copy(), p.copy(), work.copy()
                for array in (s, p, work):
                    array[beyond[0] :] = np.nan
        count = self.problem.equation.variables
        known = np.isfinite(s)
        rows = np.full((len(s), 2 * count + 1), np.nan)
        rows[known] = self.functions.at(s[known])[:, : 2 * count + 1]
        values = rows[:, :count]
        u = p * rows[:, 2 * count]
        rates = rows[:, count : 2 * count] * u[:, None]
        return ReducedMotion(
            t,
            s,
            u,
            values,
            rates,
            values[:, self.problem.driven],
            rates[:, self.problem.driven],
            0.5 * p**2,
            work,
            message,
            evaluations,
        )


def reduced(problem: Problem, tolerance: float = 1e-13) -> ReducedModel:
    """Return the reduced model of the curve that a direct problem starts on.

    Parameters
    ----------
    problem
        From `spherekit.dynamics.start.prepare`; its stops end the curve.
    tolerance
        Error of the functions to reach, relative to their largest value.
    """
    equation = problem.equation
    mechanism = equation.mechanism
    stops = {
        mechanism.variables_of(mechanism.pair_number[stop.pair])[0]: (stop.low, stop.high)
        for stop in mechanism.stops
    }
    curve = follow_arc(equation.closure, problem.values, stops)
    s = float(curve.find(problem.values[None])[0])
    there = curve.at(s)
    whole_periods = there.values[0] - problem.values

    def functions(points: CurvePoints) -> Floats:
        motion = equation.motion(points.values, points.tangents)
        return np.column_stack(
            [
                motion.values - whole_periods,
                motion.rates,
                1.0 / np.sqrt(equivalent_inertia(mechanism, motion)),
                equation.loads.velocities(motion),
            ]
        )

    def sample(s: Floats) -> Floats:
        return functions(curve.at(s))

    fitted: Periodic | PiecewiseChebyshev
    if curve.closed:
        width = functions(curve.nodes.rows(slice(0, 1))).shape[1]
        rise = np.zeros(width)
        rise[: equation.variables] = curve.rise
        fitted = Periodic.fit(sample, curve.length, rise, tolerance)
    else:
        fitted = PiecewiseChebyshev.fit(sample, 0.0, curve.length, tolerance)
    sense = 1.0 if float(there.tangents[0] @ problem.tangent) > 0.0 else -1.0
    return ReducedModel(
        problem,
        curve,
        fitted,
        (s, sense * float(problem.speed)),
    )
