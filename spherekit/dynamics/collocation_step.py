"""A step of Gauss collocation, and the zeros of functions within it.

Gauss collocation is the implicit Runge-Kutta method of highest order, 2 N at the ends of
steps with N nodes (Hairer, Norsett and Wanner 1993, II.7). Within a step the solution is a
polynomial of degree N, here a Legendre series.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import legendre

from spherekit.arrays import Floats
from spherekit.dynamics.simulation_start import variable_of
from spherekit.dynamics.taylor_integration import CROSSING_RATIO
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
        coordinates, at k times of the step in rising order. Each momentum belongs to one of
        these coordinates. With one degree of freedom, k = N: the unit tangent of the
        configuration curve at each node. With several, k = 1, since the weights are the
        same in the whole step.
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
        """Return the values (n, columns) of Legendre series over the step.

        Parameters
        ----------
        series
            (k, columns) coefficients.
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
        """Yield the times at which pairs first exceed a joint limit, and their names.

        Parameters
        ----------
        mechanism
            The mechanism with its joint limits.
        turn_angles
            (variables,) whole revolutions (rad, multiples of 2 pi) that are left out of the
            variables in the state. They are added before a variable is compared with its
            joint limits.
        """
        for joint_limit in mechanism.joint_limits:
            variable = variable_of(mechanism, joint_limit.pair)
            for limit, sense in ((joint_limit.low, -1.0), (joint_limit.high, 1.0)):
                # The variable minus its limit, as a function of time that returns value and
                # slope. `distance` times `sense` is positive beyond the limit.
                limit_of_state = limit - turn_angles[variable]
                distance_series = self.state_series(variable, limit_of_state)
                distance = self._function(distance_series)
                zero_times = find_zeros(distance, self.times).places
                _, slopes = distance(zero_times)
                outward_times = zero_times[sense * slopes > 0.0]
                ((end_distance,), _) = distance(self.times[-1:])
                if len(outward_times) or sense * end_distance > 0.0:
                    # A pair that is outside at the end, but never crossed the limit
                    # outwards, was outside from the start of this step.
                    first_time = self.start
                    if len(outward_times):
                        first_time = float(outward_times[0])
                    yield first_time, joint_limit.pair

    def closure_determinants(self, closure: Closure, rates: Floats) -> Floats:
        """Return a determinant at each node that changes its sign where curves cross.

        Its matrix is the Jacobian of the loop-closure equations with the rates of the
        variables as further rows. On a smooth curve of configurations the determinant keeps
        its sign. It passes through zero where two such curves cross.

        Parameters
        ----------
        closure
            The loops.
        rates
            (N, m, variables) rates of the variables by m coordinates at the nodes.

        Returns
        -------
        (N,) the determinants. If constraints are redundant, the matrix is not square. The
        result is then 1 at all nodes, so that no crossing is reported.
        """
        # `times` has the start of the step, the N nodes and the end.
        values = self.evaluate_state(self.times[1:-1])[:, : rates.shape[2]]
        matrices = np.concatenate([closure.linearise(values).jacobian, rates], axis=1)
        if matrices.shape[1] != matrices.shape[2]:
            return np.ones(len(values))
        return np.linalg.det(matrices)

    def find_crossing(self, determinants: Floats, signed_largest: float) -> float | None:
        """Return the time at which curves of configurations cross, if they do in the step.

        A determinant changes its sign where curves cross. Its matrix has the Jacobian of
        the loop-closure equations, and below it the rates of the variables.

        Parameters
        ----------
        determinants
            (N,) this determinant at the nodes, from `closure_determinants`.
        signed_largest
            Two facts in one number. Its magnitude is that of the largest determinant from
            the start of the motion to the end of this step. Its sign is that of the
            determinant before this step.

        Returns
        -------
        The time (s) of the first zero, or of the first node at which the determinant is
        zero or has changed its sign. None if there is no such node: two zeros between
        neighbouring nodes, after which the sign is the same again, are not searched.
        """
        sign_before_step = np.sign(signed_largest)
        zero_limit = CROSSING_RATIO * abs(signed_largest)  # smaller ones count as zero
        # This product is positive as long as the determinant has not changed its sign.
        is_zero_or_changed = determinants * sign_before_step < zero_limit
        if not np.any(is_zero_or_changed):
            return None
        # The Legendre series of the polynomial through the determinants at the nodes.
        determinant_series = SERIES_MATRIX @ determinants
        sign_changes = self.find_sign_changes(determinant_series)
        # `times` begins with the start of the step, so node k has the index k + 1.
        first_node_time = float(self.times[1 + np.argmax(is_zero_or_changed)])
        return min([*sign_changes, first_node_time])
