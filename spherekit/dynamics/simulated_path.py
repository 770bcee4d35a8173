"""The states of a simulation at any time, whichever engine computed them.

The NumPy engine computes steps of Gauss collocation, the compiled engine segments of Taylor
series. Both become parts of a `StatePath`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from spherekit.arrays import Floats, Indices
from spherekit.conventions import TURN
from spherekit.dynamics.collocation_step import CollocationStep
from spherekit.dynamics.compiled_equation import CompiledEquation
from spherekit.dynamics.equation_of_motion import EquationOfMotion, InertiaRoots
from spherekit.dynamics.inertia import inertia
from spherekit.dynamics.multi_dof_equation import total_moment_of_inertia
from spherekit.dynamics.taylor_integration import Segment, TaylorRun
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

    Attributes
    ----------
    states, rates
        (n, states) states and their rates by time. A state has the pair variables (rad),
        the m momenta p = R u and the work of each load. Here u are the rates of the m
        coordinates, and R is the symmetric root of the inertia matrix. The variables are
        reduced by whole revolutions.
    frames
        (n, m, variables) definition of the coordinates. With several degrees of freedom,
        each coordinate is a weighted sum of the pair variables, and the weights are a row
        of the frame. With one, the coordinate is the arc length of the configuration curve.
        The frame is then a tangent of this curve of any length. The mechanism moves along
        it if the momentum is positive.
    turns
        (n, variables) numbers of the whole revolutions by which the variables are reduced.
    """

    states: Floats
    rates: Floats
    frames: Floats
    turns: Floats

    @property
    def values(self) -> Floats:
        """(n, variables) variables with all whole revolutions, rad."""
        return self.states[:, : self.turns.shape[1]] + TURN * self.turns


@dataclass(frozen=True)
class StatePath:
    """The states of a simulation over time.

    Attributes
    ----------
    part_starts
        (parts,) times from which each part applies, s. A part is one step of the NumPy
        engine, or one segment of several steps of the compiled engine.
    parts
        For each part a function that returns the states at times (n,), s.
    starts, lengths
        (steps,) start times and lengths of the steps, s.
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
        """Numbers of the steps at which energy and power balances are checked.

        They are evenly distributed. To limit computing time, there are at most
        `MAX_CHECKED_STEPS` of them.
        """
        count = len(self.starts)
        return np.linspace(0, count - 1, min(MAX_CHECKED_STEPS, count)).astype(np.intp)

    def evaluate(self, t: Floats) -> PathStates:
        """Return the states at times (n,) within the path, in any order.

        Times within one part of the path are evaluated together, in blocks whose size is
        limited because of the memory.
        """
        part_of_row = np.searchsorted(self.part_starts[1:], t, side="right")
        # Rows sorted by their part, and the positions at which the next part begins.
        order = np.argsort(part_of_row, kind="stable")
        cuts = np.flatnonzero(np.diff(part_of_row[order], prepend=-1))[1:]
        # Blocks of rows that belong to one part each.
        blocks: list[Indices] = []
        for rows in np.split(order, cuts):
            blocks += np.split(rows, range(STATES_PER_BLOCK, len(rows), STATES_PER_BLOCK))
        results: list[PathStates] = []
        for rows in blocks:
            # Without any times there is one empty block, for which any part will do.
            part = self.parts[part_of_row[rows[0]] if len(rows) else 0]
            results.append(part(t[rows]))
        # Back to the order of the times.
        return PathStates.concatenate(results).rows(np.argsort(order))


def make_collocation_path(
    steps: Sequence[CollocationStep], turns: Floats, max_closure_residual: float
) -> StatePath:
    """Return the path of steps of the NumPy engine.

    Parameters
    ----------
    steps
        The steps in order of time.
    turns
        (variables,) numbers of whole revolutions. The engine subtracted them from the
        variables before the first step, and the states of its steps do not contain them.
    max_closure_residual
        Largest closure residual (opening of a loop) that was removed by corrections of the
        configuration between steps, rad.
    """
    starts = np.array([step.start for step in steps])
    # The path consists of parts, each with a function that evaluates it. Here each step is
    # a part. (In a path of the compiled engine a part has several steps.)
    return StatePath(
        part_starts=starts,
        parts=tuple(partial(_evaluate_step, step, turns) for step in steps),
        starts=starts,
        lengths=np.array([step.length for step in steps]),
        max_closure_residual=max_closure_residual,
    )


def _evaluate_step(step: CollocationStep, turns: Floats, t: Floats) -> PathStates:
    """Return the states at times (n,) within a step; see `make_collocation_path`."""
    # The step stores frames for equal parts of its length.
    position = (t - step.start) / step.length * len(step.frames)
    frames = np.take(step.frames, position.astype(int), axis=0, mode="clip")
    return PathStates(
        states=step.evaluate_state(t),
        rates=step.evaluate_rate(t),
        frames=frames,
        turns=np.tile(turns, (len(t), 1)),
    )


MomentumConversion = Callable[[Floats, Floats], Floats]
"""A function of the states and their rates (n, states) of a compiled equation. It replaces
the momenta in both arrays by those of `PathStates`. It returns the frames
(n, m, variables), which define the coordinates of the momenta."""


@dataclass(frozen=True)
class CurveMomentumConversion:
    """Converts momenta of the compiled engine if there is one degree of freedom.

    A momentum is positive if the mechanism moves along the configuration curve in its
    positive direction. The compiled engine may have chosen the opposite direction. Its
    momenta then change their sign.

    Instances are called like functions. They can be pickled, which nested functions cannot.

    Attributes
    ----------
    equation
        The compiled equation of motion. It computes homogeneous rates: a tangent of the
        curve, of any length.
    sense
        +1 if this tangent points in the positive direction of the simulation, otherwise -1.
    """

    equation: CompiledEquation
    sense: float

    def __call__(self, states: Floats, rates: Floats) -> Floats:
        """Give the momentum the sign that it has in a simulation, in place.

        The mechanism has one degree of freedom, so it moves along a curve of
        configurations. The compiled engine may count a momentum as positive along this
        curve in the direction opposite to that of the simulation. `sense` is then -1,
        otherwise +1, and all momenta are multiplied by it.

        Parameters
        ----------
        states, rates
            (n, states) states and their rates by time. The momentum is the column after the
            pair variables.

        Returns
        -------
        (n, 1, variables) tangents of the configuration curve, of any length. A positive
        momentum, as it is after the conversion, moves the mechanism along them.
        """
        count = self.equation.layout.variable_count
        for array in (states, rates):
            array[:, count] *= self.sense
        tangents = self.equation.homogeneous_rates(states[:, :count])
        return self.sense * tangents


@dataclass(frozen=True)
class CoordinateMomentumConversion:
    """Converts rates of the compiled engine to momenta if there are several freedoms.

    The m coordinates of a run are some of the pair variables. The states of the compiled
    engine contain scaled rates of the coordinates, those of a simulation contain momenta.
    Instances are called like functions. They can be pickled with a simulation.

    Attributes
    ----------
    equation
        The equation of motion, whose functions compute the inertia.
    frame
        (m, variables) the coefficients of the pair variables in each of the m coordinates:
        a 1 in each row, at the variable that is the coordinate.
    """

    equation: EquationOfMotion
    frame: Floats

    def __call__(self, states: Floats, rates: Floats) -> Floats:
        """Convert the coordinate rates in each state to momenta, in place.

        The compiled engine stores s u. Here u are the rates of the m coordinates. The
        factor s, the square root of the sum of the largest moments of inertia of all links,
        gives them the unit of the momenta of a simulation. These are p = R u, with the
        symmetric root R of the inertia matrix, M = R R.

        Parameters
        ----------
        states, rates
            (n, states) states and their rates by time. The columns `equation.momenta` have
            s u at first, and p after the call.

        Returns
        -------
        (n, m, variables) the frame, repeated for each state. It defines the coordinates of
        the momenta: each coordinate is a sum of pair variables, with the coefficients in
        its row. With one degree of freedom the frame differs from state to state.
        """
        equation = self.equation
        scale = np.sqrt(total_moment_of_inertia(equation.mechanism))
        momenta = equation.momenta
        speeds = states[:, momenta] / scale
        accelerations = rates[:, momenta] / scale
        motion = equation.compute_motion(
            states[:, : equation.variable_count], self.frame, order=2
        )
        masses = inertia(equation.mechanism, motion)
        roots = InertiaRoots.from_inertia(masses.M)
        # p = R u.
        states[:, momenta] = roots.multiply(speeds)
        # By the product rule, dp/dt = (dR/dt) u + R du/dt.
        root_part = roots.multiply_derivative(masses.dM, speeds)
        rates[:, momenta] = root_part + roots.multiply(accelerations)
        return np.broadcast_to(self.frame, (len(states), *self.frame.shape))


def make_taylor_path(
    runs: Sequence[TaylorRun], momentum_conversions: Sequence[MomentumConversion]
) -> StatePath:
    """Return the path of integrations by the compiled engine.

    A run is an integration of one compiled equation. A run consists of segments, and a
    segment of several steps. Each segment is a part of the path, and is evaluated as a
    whole.

    Parameters
    ----------
    runs
        The runs in order of time.
    momentum_conversions
        For each run a function that converts the momenta in its states, in place, to those
        of `PathStates`. It returns the frames, which define the coordinates of the momenta.
    """
    segments: list[Segment] = []
    parts: list[Callable[[Floats], PathStates]] = []
    for run, convert_momenta in zip(runs, momentum_conversions, strict=True):
        for segment in run.segments:
            segments.append(segment)
            parts.append(partial(_evaluate_segment, segment, convert_momenta))
    # `segment.starts` are the start times of the steps in a segment.
    return StatePath(
        part_starts=np.array([segment.starts[0] for segment in segments]),
        parts=tuple(parts),
        starts=np.concatenate([segment.starts for segment in segments]),
        lengths=np.concatenate([segment.lengths for segment in segments]),
        max_closure_residual=max(run.max_closure_residual for run in runs),
    )


def _evaluate_segment(
    segment: Segment, convert_momenta: MomentumConversion, t: Floats
) -> PathStates:
    """Return the states at times (n,) within a segment; see `make_taylor_path`."""
    states, rates = segment.evaluate(t)
    turns = np.broadcast_to(segment.turns, (len(t), len(segment.turns)))
    frames = convert_momenta(states, rates)
    return PathStates(states, rates, frames, turns)
