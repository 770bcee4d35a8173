"""The states of a simulation at any time, whichever engine computed them.

The NumPy engine computes steps of Gauss collocation, the compiled engine segments of Taylor
series. Both become parts of a `StatePath`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np

from spherekit.arrays import Floats, Indices
from spherekit.conventions import TURN
from spherekit.dynamics.collocation_step import CollocationStep
from spherekit.dynamics.compiled_equation import CompiledEquation
from spherekit.dynamics.equation_of_motion import EquationOfMotion, InertiaRoots
from spherekit.dynamics.inertia import inertia
from spherekit.dynamics.multi_dof_equation import total_moment_of_inertia
from spherekit.dynamics.taylor_integration import Segment, TaylorRun
from spherekit.geometry.vectors import unit_rows
from spherekit.numerics.array_rows import ArrayRows

MAX_CHECKED_STEPS = 2000
"""Largest number of steps at which balances of energy and power are computed.

Larger: checks of long simulations take longer. Smaller: errors between these steps are not
noticed.
"""

STATES_PER_BLOCK = 1024
"""Number of times at which states are evaluated together. Larger: more memory."""


@dataclass(frozen=True)
class PathStates(ArrayRows):
    """States of a simulation at n times.

    A state has the pair variables v (joint angles, rad), the m momenta p = R u and the work
    of each load. Here u are the rates of m coordinates, and R is the symmetric root of the
    inertia matrix M = R R. The kinetic energy u . M u / 2 is then p^2 / 2. Each rate of a
    coordinate is a weighted sum of the rates of the pair variables. With one degree of
    freedom, the coordinate is the arc length of the curve of configurations. The weights
    are then the components of the unit tangent of this curve.

    Attributes
    ----------
    states, rates
        (n, states) states and their time derivatives. The whole revolutions `turns` are
        subtracted from the pair variables.
    rate_weights
        (n, m, variables) the weights: the matrix W in u = W v'.
    turns
        (n, variables) how many whole revolutions were subtracted from each variable.
    """

    states: Floats
    rates: Floats
    rate_weights: Floats
    turns: Floats

    @property
    def values(self) -> Floats:
        """(n, variables) variables with all whole revolutions, rad."""
        return self.states[:, : self.turns.shape[1]] + TURN * self.turns


@dataclass(frozen=True)
class StatePath:
    """The states of a simulation as a function of time, which consists of parts.

    Each part of the path has a function of its own. A part is one step of the NumPy engine,
    or several steps (a segment) of the compiled engine.

    Attributes
    ----------
    part_starts
        (parts,) time at which each part starts, s.
    parts
        For each part a function that returns the states at times (n,), s.
    starts, lengths
        (steps,) start times and lengths of all integration steps, s.
    max_closure_residual
        Largest closure residual (opening of a loop) that was removed by corrections of the
        configuration during the integration, rad.
    """

    part_starts: Floats
    parts: tuple[Callable[[Floats], PathStates], ...]
    starts: Floats
    lengths: Floats
    max_closure_residual: float

    @property
    def checked_steps(self) -> Indices:
        """Indices of the integration steps at which energy and power balances are checked.

        To limit computing time, at most `MAX_CHECKED_STEPS` steps are chosen, evenly
        distributed.
        """
        count = len(self.starts)
        return np.linspace(0, count - 1, min(MAX_CHECKED_STEPS, count)).astype(np.intp)

    def evaluate(self, t: Floats) -> PathStates:
        """Return the states at times (n,) within the path, in any order.

        Times within one part of the path (one function) are evaluated together, in blocks
        of limited size to save memory.
        """
        if not len(t):
            return self.parts[0](t)  # any part returns states without rows
        part_of_row = np.searchsorted(self.part_starts[1:], t, side="right")
        blocks = _divide_rows(part_of_row, max_size=STATES_PER_BLOCK)
        results: list[PathStates] = []
        for rows in blocks:
            part = self.parts[part_of_row[rows[0]]]
            results.append(part(t[rows]))
        # Put the rows back into the order of the times.
        order = np.concatenate(blocks)
        return PathStates.concatenate(results).rows(np.argsort(order))


def _divide_rows(group_of_row: Indices, max_size: int) -> list[Indices]:
    """Divide rows into blocks of at most `max_size` rows that all belong to one group.

    A row is a time, and a group is the times in one part of a path. The rows of a block are
    evaluated together by the function of this part.

    Parameters
    ----------
    group_of_row
        (n,) index of the group of each row, for one or more rows.
    max_size
        Largest number of rows in a block.

    Returns
    -------
    The indices of the rows in each block. Each row is in one of the blocks.
    """
    rows_by_group = np.argsort(group_of_row, kind="stable")
    # The positions in `rows_by_group` at which a group begins.
    _, group_starts = np.unique(group_of_row[rows_by_group], return_index=True)
    blocks: list[Indices] = []
    for rows in np.split(rows_by_group, group_starts[1:]):
        blocks += np.split(rows, range(max_size, len(rows), max_size))
    return blocks


def make_collocation_path(
    steps: Sequence[CollocationStep], turns: Floats, max_closure_residual: float
) -> StatePath:
    """Return the states over time of a simulation by the NumPy engine, from its steps.

    Parameters
    ----------
    steps
        The steps in order of time.
    turns
        (variables,) how many whole revolutions were subtracted from each pair variable
        (joint angle) at the start. The states of the steps do not contain these
        revolutions.
    max_closure_residual
        Largest closure residual (opening of a loop) that was removed by corrections of the
        configuration between steps, rad.
    """
    starts = np.array([step.start for step in steps])
    # A path has parts, each evaluated by one function. Here each step is a part.
    return StatePath(
        part_starts=starts,
        parts=tuple(partial(_evaluate_step, step, turns) for step in steps),
        starts=starts,
        lengths=np.array([step.length for step in steps]),
        max_closure_residual=max_closure_residual,
    )


def _evaluate_step(step: CollocationStep, turns: Floats, t: Floats) -> PathStates:
    """Return the states at times (n,) within a step; see `make_collocation_path`."""
    # The step stores the weights for equal parts of its length.
    position = (t - step.start) / step.length * len(step.rate_weights)
    rate_weights = np.take(step.rate_weights, position.astype(int), axis=0, mode="clip")
    return PathStates(
        states=step.evaluate_state(t),
        rates=step.evaluate_rate(t),
        rate_weights=rate_weights,
        turns=np.tile(turns, (len(t), 1)),
    )


class MomentumConversion(Protocol):
    """Converts states of the compiled engine to states of a simulation.

    A state has the pair variables (joint angles), the momenta of m coordinates, and the
    work of each load. The compiled engine defines the momenta in its own way. Momenta of a
    simulation are p = R u; see `PathStates`. With several degrees of freedom, the compiled
    engine and the simulation use different coordinates, so their momenta differ.
    """

    def convert_momenta(self, states: Floats, state_rates: Floats) -> None:
        """Replace the momenta of the compiled engine by momenta of a simulation, in place.

        The time derivatives of the momenta are replaced, too.

        Parameters
        ----------
        states, state_rates
            (n, states) states (pair variables, momenta, works) and their time derivatives.
        """

    def compute_rate_weights(self, states: Floats) -> Floats:
        """Return the matrices W that define the rates of the coordinates at n states.

        A state has the pair variables v and the momenta p = R u (see `PathStates`). Here u
        are the rates of m coordinates, one for each degree of freedom, and R is the root of
        the inertia matrix. The rates of the coordinates are weighted sums u = W v' of the
        rates v' of the pair variables. To convert momenta into rates of the pair variables,
        the equation of motion needs W.

        Parameters
        ----------
        states
            (n, states) states. The pair variables are the first columns.

        Returns
        -------
        (n, m, variables) W for each state: row i has the weights for coordinate i.
        """


@dataclass(frozen=True)
class CurveMomentumConversion:
    """Converts states of the compiled engine if there is one degree of freedom.

    The mechanism moves along a curve of configurations. The compiled engine and the
    simulation may count the momentum as positive in opposite directions of this curve.

    Attributes
    ----------
    equation
        The compiled equation of motion, which computes tangents of the curve.
    sense
        +1 if these tangents point in the positive direction of the simulation, otherwise
        -1.
    """

    equation: CompiledEquation
    sense: float

    def convert_momenta(self, states: Floats, state_rates: Floats) -> None:
        """Change the sign of the momentum to that of a simulation, in place.

        The compiled engine may count the opposite direction of motion as positive.

        Parameters
        ----------
        states, state_rates
            (n, states) states and their time derivatives. The momentum is the column after
            the pair variables.
        """
        momentum = self.equation.layout.variable_count
        states[:, momentum] *= self.sense
        state_rates[:, momentum] *= self.sense

    def compute_rate_weights(self, states: Floats) -> Floats:
        """Return the weights (n, 1, variables) of the pair variables' rates in ds/dt.

        The only coordinate is the arc length s of the curve of configurations. With the
        unit tangent e of the curve, ds/dt = e . v' for the rates v' of the pair variables
        (joint angles). The weights are therefore the components of e.

        Parameters
        ----------
        states
            (n, states) states. The pair variables are the first columns.
        """
        pair_variables = states[:, : self.equation.layout.variable_count]
        tangents = self._compute_tangents(pair_variables)
        return tangents[:, None]

    def _compute_tangents(self, pair_variables: Floats) -> Floats:
        """Return unit tangents (n, variables) of the curve of configurations.

        The tangents point in the direction in which the mechanism moves if its momentum is
        positive in the simulation.

        Parameters
        ----------
        pair_variables
            (n, variables) configurations on the curve, rad.
        """
        # Homogeneous rates are the rates of the variables per unit rate of the input, times
        # the determinant of the velocity equations. There is one input, so index 0.
        tangents = self.equation.homogeneous_rates(pair_variables)[:, 0]
        # Where curves cross there is no single tangent. The homogeneous rates are zero
        # there, so the unit vector is NaN.
        with np.errstate(invalid="ignore", divide="ignore"):
            return self.sense * unit_rows(tangents)


@dataclass(frozen=True)
class CoordinateMomentumConversion:
    """Converts states of the compiled engine if there are several degrees of freedom.

    The velocity of the mechanism is given by the rates u of its m coordinates, which are
    some of the pair variables (joint angles). The compiled engine stores scaled rates s u.
    A simulation stores momenta p = R u, with which the kinetic energy is p^2 / 2 in all
    configurations. R is the symmetric root of the inertia matrix, M = R R.

    Attributes
    ----------
    equation
        The equation of motion, whose functions compute the inertia.
    rate_weights
        (m, variables) the coordinates: in each row a 1 at the pair variable that is the
        coordinate, and 0 elsewhere.
    """

    equation: EquationOfMotion
    rate_weights: Floats

    def convert_momenta(self, states: Floats, state_rates: Floats) -> None:
        """Replace the scaled rates of the coordinates by momenta, in place.

        States of the compiled engine have the rates of m coordinates, multiplied by a
        constant (`rate_scale`).

        Parameters
        ----------
        states, state_rates
            (n, states) states and their time derivatives. The columns `equation.momenta`
            have the scaled rates of the coordinates before the call, and the momenta after
            it.
        """
        columns = self.equation.momenta
        coordinate_rates = states[:, columns] / self.rate_scale
        coordinate_accelerations = state_rates[:, columns] / self.rate_scale
        momenta, momentum_rates = self._compute_momenta(
            states[:, : self.equation.variable_count],
            coordinate_rates,
            coordinate_accelerations,
        )
        states[:, columns] = momenta
        state_rates[:, columns] = momentum_rates

    def compute_rate_weights(self, states: Floats) -> Floats:
        """Return `rate_weights` (m, variables) for each of n states: (n, m, variables).

        The coordinates are the same in all states, so the weights are, too.
        """
        return np.broadcast_to(self.rate_weights, (len(states), *self.rate_weights.shape))

    @property
    def rate_scale(self) -> float:
        """Factor by which the compiled engine multiplies the rates of the coordinates.

        The factor is the square root of a moment of inertia of the whole mechanism, so that
        scaled rates have the unit of momenta.
        """
        return float(np.sqrt(total_moment_of_inertia(self.equation.mechanism)))

    def _compute_momenta(
        self,
        pair_variables: Floats,
        coordinate_rates: Floats,
        coordinate_accelerations: Floats,
    ) -> tuple[Floats, Floats]:
        """Return the momenta p = R u of moving configurations, and their time derivatives.

        u are the rates of the m coordinates. R is the symmetric root of the inertia matrix,
        M = R R, so that the kinetic energy u . M u / 2 is p^2 / 2. The caller,
        `convert_momenta`, writes the results to the states in place of the rates.

        Parameters
        ----------
        pair_variables
            (n, variables) pair variables (joint angles) of the configurations, rad.
        coordinate_rates, coordinate_accelerations
            (n, m) first and second time derivatives of the coordinates: u and du/dt.

        Returns
        -------
        momenta, momentum_rates
            (n, m) p and dp/dt.
        """
        # First and second derivatives of the configurations with respect to the
        # coordinates. `rate_weights` says which pair variables are the coordinates.
        motion = self.equation.compute_motion(pair_variables, self.rate_weights, order=2)
        mechanism_inertia = inertia(self.equation.mechanism, motion)
        inertia_roots = InertiaRoots.from_inertia(mechanism_inertia.M)
        momenta = inertia_roots.multiply(coordinate_rates)
        # By the product rule, dp/dt = (dR/dt) u + R du/dt. The call computes (dR/dt) u from
        # the derivatives of the inertia with respect to the coordinates.
        by_change_of_inertia = inertia_roots.multiply_derivative(
            mechanism_inertia.dM, coordinate_rates
        )
        by_acceleration = inertia_roots.multiply(coordinate_accelerations)
        return momenta, by_change_of_inertia + by_acceleration


def make_taylor_path(
    runs: Sequence[TaylorRun], momentum_conversions: Sequence[MomentumConversion]
) -> StatePath:
    """Return the states over time of a simulation by the compiled engine, from its runs.

    A run is an integration of the compiled equation of motion in certain coordinates. A run
    consists of segments, and a segment consists of several steps. Each segment is a part of
    the path, evaluated by one function.

    Parameters
    ----------
    runs
        The runs in order of time.
    momentum_conversions
        For each run the conversion of its momenta, which depend on the coordinates of the
        run, to those of `PathStates`.
    """
    segments: list[Segment] = []
    parts: list[Callable[[Floats], PathStates]] = []
    for run, momentum_conversion in zip(runs, momentum_conversions, strict=True):
        for segment in run.segments:
            segments.append(segment)
            parts.append(partial(_evaluate_segment, segment, momentum_conversion))
    # `segment.starts` are the start times of the steps in a segment.
    return StatePath(
        part_starts=np.array([segment.starts[0] for segment in segments]),
        parts=tuple(parts),
        starts=np.concatenate([segment.starts for segment in segments]),
        lengths=np.concatenate([segment.lengths for segment in segments]),
        max_closure_residual=max(run.max_closure_residual for run in runs),
    )


def _evaluate_segment(
    segment: Segment, momentum_conversion: MomentumConversion, t: Floats
) -> PathStates:
    """Return the states at times (n,) within a segment; see `make_taylor_path`."""
    states, rates = segment.evaluate(t)
    turns = np.broadcast_to(segment.turns, (len(t), len(segment.turns)))
    rate_weights = momentum_conversion.compute_rate_weights(states)
    momentum_conversion.convert_momenta(states, rates)
    return PathStates(states, rates, rate_weights, turns)
