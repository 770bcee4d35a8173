"""A step of Gauss collocation, and the zeros of functions within it.

Gauss collocation is the implicit Runge-Kutta method of highest order, 2 N at the ends of
steps with N nodes (Hairer, Norsett and Wanner 1993, II.7). Within a step the solution is a
polynomial of degree N, here a Legendre series.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.polynomial import legendre

from spherekit.arrays import Floats
from spherekit.dynamics.simulation_start import variable_of
from spherekit.dynamics.taylor_integration import CROSSING_RATIO
from spherekit.geometry.vectors import max_abs
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.zeros import DifferentiableFunction, find_zeros
from spherekit.positions.loop_closure import Closure

NODE_COUNT = 24
"""Number N of nodes of a step.

In measurements with linkages at tolerances of 1e-7 to 1e-11, this number needed the fewest
evaluations.
"""

GAUSS_NODES, _GAUSS_WEIGHTS = legendre.leggauss(NODE_COUNT)
"""(N,) the nodes of a step in [-1, 1], and their weights."""

SERIES_MATRIX = (
    (np.arange(NODE_COUNT)[:, None] + 0.5)
    * _GAUSS_WEIGHTS
    * legendre.legvander(GAUSS_NODES, NODE_COUNT - 1).T
)
"""(N, N) converts values at the nodes to Legendre coefficients."""

INTEGRATION_MATRIX = legendre.legvander(GAUSS_NODES, NODE_COUNT) @ legendre.legint(
    SERIES_MATRIX, lbnd=-1
)
"""(N, N) converts values at the nodes to the integrals from -1 to each node."""


@dataclass(frozen=True)
class ClosureDeterminantRecord:
    """Size and sign of the closure determinant in the steps of a simulation so far.

    The simulation follows a curve of configurations. Where this curve crosses another one,
    the closure determinant is zero and changes its sign; see
    `CollocationStep.closure_determinants`. The simulation compares the determinants of the
    next step with this record to find a crossing.

    Attributes
    ----------
    largest
        Largest absolute value at any node (time at which a step evaluates the equations) so
        far; 0 before the first step.
    sign
        The sign after the last step, 1 or -1. Before the first step, the sign is 0. The
        sign stays 0 until a crossing if the first determinant was exactly 0.
    """

    largest: float = 0.0
    sign: float = 0.0

    def include_sizes(self, determinants: Floats) -> "ClosureDeterminantRecord":
        """Return the record with which the determinants of a new step are compared.

        The largest absolute value of the record includes the new determinants. A
        determinant that is small relative to it is near a crossing. The sign of the record
        stays the sign before the step. A determinant with the other sign is beyond a
        crossing. For the first step, the sign is that at the first node.

        Parameters
        ----------
        determinants
            (N,) closure determinants at the nodes (times at which the step was evaluated).
        """
        is_first_step = self.largest == 0.0
        if is_first_step:
            sign = float(np.sign(determinants[0]))
        else:
            sign = self.sign
        largest_in_step = float(max_abs(determinants))
        return ClosureDeterminantRecord(max(self.largest, largest_in_step), sign)

    def after_step(
        self, determinants: Floats, *, has_crossing: bool
    ) -> "ClosureDeterminantRecord":
        """Return the record of the closure determinant up to the end of a step.

        The simulation compares the determinants of the next step with this record. The sign
        only changes where curves of configurations cross. Without a crossing, the
        sign before the step is kept, since a small determinant can have a wrong sign by
        rounding.

        Parameters
        ----------
        determinants
            (N,) closure determinants at the nodes (times at which the step was evaluated).
        has_crossing
            Whether curves of configurations cross in the step.
        """
        record = self.include_sizes(determinants)
        if not has_crossing:
            return record
        # The last node is after the crossing.
        sign_after_crossing = float(np.copysign(1.0, determinants[-1]))
        return replace(record, sign=sign_after_crossing)


@dataclass(frozen=True)
class CollocationStep:
    """One step of Gauss collocation with N nodes, an implicit Runge-Kutta method.

    A state (states,) has the pair variables, the momenta and the work of each load. Within
    the step it is a polynomial of time.

    Attributes
    ----------
    start, length
        Time at the start, and length, s.
    state
        (states,) state at the start.
    series
        (N, states) Legendre coefficients of the rate of the state over the step.
    rate_weights
        (k, m, variables) weights of the rates of the pair variables in the rates of the m
        coordinates, at k times of the step in rising order. With one degree of freedom,
        k = N, and the weights are the unit tangent of the configuration curve at each node
        (time of the method). With several, k = 1, since the weights are constant in the
        step.
    """

    start: float
    length: float
    state: Floats
    series: Floats
    rate_weights: Floats

    @property
    def stop(self) -> float:
        """Time at the end, s."""
        return self.start + self.length

    @property
    def end_state(self) -> Floats:
        """(states,) the state at the end. Its error has the order 2 N."""
        return self.state + self.length * self.series[0]

    @cached_property
    def change_series(self) -> Floats:
        """(N + 1, states) Legendre coefficients of the change of state since the start."""
        return np.asarray(0.5 * self.length * legendre.legint(self.series, lbnd=-1))

    def evaluate_series(self, series: Floats, t: Floats) -> Floats:
        """Return the values (n, columns) of Legendre series at n times within the step.

        Parameters
        ----------
        series
            (k, columns) coefficients of the series, one series in each column.
        t
            (n,) times, s.
        """
        x = 2.0 * (t - self.start) / self.length - 1.0
        return legendre.legvander(x, len(series) - 1) @ series

    def evaluate_state(self, t: Floats) -> Floats:
        """Return the state (n, states) at times (n,) within the step."""
        return self.state + self.evaluate_series(self.change_series, t)

    def evaluate_rate(self, t: Floats) -> Floats:
        """Return the rate of the state (n, states) at times (n,) within the step."""
        return self.evaluate_series(self.series, t)

    @cached_property
    def times(self) -> Floats:
        """(N + 2,) times of the start, the nodes and the end, s."""
        nodes = np.array([-1.0, *GAUSS_NODES, 1.0])
        return self.start + 0.5 * self.length * (nodes + 1.0)

    def state_series(self, index: int, level: float = 0.0) -> Floats:
        """Return the series (N + 1,) of element `index` of the state, minus `level`."""
        series = self.change_series[:, index].copy()
        series[0] += self.state[index] - level
        return series

    def _function(self, series: Floats) -> DifferentiableFunction:
        """Return a function that computes value and slope of a Legendre series (k,)."""
        slope = legendre.legder(series) * 2.0 / self.length
        columns = np.stack([series, np.append(slope, 0.0)], axis=1)
        return lambda t: tuple(self.evaluate_series(columns, t).T)

    def find_sign_changes(self, series: Floats) -> list[float]:
        """Return the times after the start at which a series (k,) changes its sign."""
        # Legendre polynomials are between -1 and 1 on the step. If the constant term
        # exceeds all others together, there is no zero, and no search is needed.
        if abs(series[0]) > np.sum(np.abs(series[1:])):
            return []
        zeros = find_zeros(self._function(series), self.times)
        changes_sign = (zeros.places > self.start) & ~zeros.double
        return zeros.places[changes_sign].tolist()

    def find_exceeded_limits(
        self, mechanism: Mechanism, turn_angles: Floats
    ) -> Iterator[tuple[float, str]]:
        """Yield the times (s) at which joint angles first exceed a limit, and their pairs.

        Parameters
        ----------
        mechanism
            The mechanism with its joint limits.
        turn_angles
            (variables,) whole turns (rad, multiples of 2 pi) of the joint angles. The state
            has the angles without these turns. Joint limits are limits of the angles with
            them.
        """
        for joint_limit in mechanism.joint_limits:
            variable = variable_of(mechanism, joint_limit.pair)
            # The limits of the angle without whole turns, as it is in the state.
            lower_limit = joint_limit.low - turn_angles[variable]
            upper_limit = joint_limit.high - turn_angles[variable]
            for limit, outward_sense in ((lower_limit, -1.0), (upper_limit, 1.0)):
                first_time = self._find_first_time_beyond(variable, limit, outward_sense)
                if first_time is not None:
                    yield first_time, joint_limit.pair

    def _find_first_time_beyond(
        self, variable: int, limit: float, outward_sense: float
    ) -> float | None:
        """Return the time (s) at which a variable first moves beyond a limit in this step.

        The result is None if the variable does not exceed the limit.

        Parameters
        ----------
        variable
            Index of the variable (a joint angle) in the state.
        limit
            The limit, rad.
        outward_sense
            1 for an upper limit, -1 for a lower limit.
        """
        # The variable minus its limit, as a function of time: it returns values and slopes.
        difference = self._function(self.state_series(variable, level=limit))
        crossing_times = find_zeros(difference, self.times).places
        _, slopes = difference(crossing_times)
        outward_times = crossing_times[outward_sense * slopes > 0.0]
        if len(outward_times):
            return float(outward_times[0])
        # Without an outward crossing, a variable that is beyond the limit at the end has
        # been beyond since the start of the step.
        end_time = self.times[-1:]
        (end_difference,), _ = difference(end_time)
        is_beyond_at_end = outward_sense * end_difference > 0.0
        return self.start if is_beyond_at_end else None

    def closure_determinants(self, closure: Closure, rates: Floats) -> Floats:
        """Return a determinant at each node that changes its sign where curves cross.

        Configurations of a mechanism form curves. Along a smooth curve the determinant
        keeps its sign. Where two curves cross, the determinant passes through zero.

        The matrix of the determinant has two parts: the Jacobian of the loop-closure
        equations, and below this the rates of the variables.

        Parameters
        ----------
        closure
            The loop-closure equations.
        rates
            (N, m, variables) rates of the variables per unit rate of each of the m
            coordinates of the equation of motion, at the N nodes (times at which the step
            evaluates the equations).

        Returns
        -------
        (N,) the determinants. If constraints are redundant, the matrix is not square. The
        result is then 1 at all nodes, so that no crossing is reported.
        """
        # `times` has the start of the step, the N nodes and the end.
        states = self.evaluate_state(self.times[1:-1])
        # A state begins with the variables (joint angles).
        variable_count = rates.shape[2]
        values = states[:, :variable_count]
        matrices = np.concatenate([closure.linearise(values).jacobian, rates], axis=1)
        is_square = matrices.shape[1] == matrices.shape[2]
        if not is_square:
            return np.ones(len(values))
        return np.linalg.det(matrices)

    def find_crossing(
        self, determinants: Floats, record: ClosureDeterminantRecord
    ) -> float | None:
        """Return the time at which curves of configurations cross in the step, or None.

        Curves cross where the closure determinant is zero or changes its sign. Below
        `CROSSING_RATIO` times its largest size, the determinant counts as zero.

        Parameters
        ----------
        determinants
            (N,) closure determinants at the nodes, from `closure_determinants`.
        record
            The sign of the determinant before the step, and its largest size so far,
            including the nodes of this step.

        Returns
        -------
        The time (s) of the first zero between the nodes, or of the first node that is at or
        beyond a crossing if this is earlier. None if no node shows a crossing.
        """
        is_zero = np.abs(determinants) < CROSSING_RATIO * record.largest
        has_other_sign = determinants * record.sign < 0.0
        is_at_or_beyond_crossing = is_zero | has_other_sign
        if not np.any(is_at_or_beyond_crossing):
            return None
        first_node = int(np.argmax(is_at_or_beyond_crossing))
        first_node_time = float(self.times[1 + first_node])  # times[0] is the start
        # Between the nodes, the determinant is interpolated by a polynomial, here as its
        # Legendre series.
        determinant_series = SERIES_MATRIX @ determinants
        return min([*self.find_sign_changes(determinant_series), first_node_time])
