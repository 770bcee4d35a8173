"""Predicts the samples of a motion from a part of them, by splines.

If the samples of a path lie close together, every n-th of them is a node and is solved as
usual. The others are read from splines through the nodes. The predictions are not verified
here: the caller has to check that the loops are closed.
"""

from collections.abc import Callable, Iterator
from functools import cache
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.conventions import TURN
from spherekit.geometry.vectors import max_abs
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.status import Status

PREDICTION_SPLINE_DEGREE = 7
"""Degree of the splines. A mode needs more nodes in a row than this."""
NODE_DISTANCE_RAD = 0.01
"""Largest change of an input between two nodes.

Splines are then as accurate as rounding, except near inputs where modes meet and near
corners of the path. Larger: fewer nodes are solved, and more predictions fail. Smaller:
more nodes are solved.
"""
MIN_SAMPLES_PER_NODE = 4
"""Smallest number of samples per node. With fewer, solving all samples is faster."""
MAX_SAMPLES_PER_NODE = 1024
"""Largest number of samples per node, also if the inputs hardly change."""
NODES_PER_BLOCK = 1024
"""Number of nodes that are solved together. Larger: more memory. Smaller: more calls."""


class ModeSpline(NamedTuple):
    """A spline through successive nodes of one assembly mode (one way to assemble).

    A node is a sample of the inputs that is solved exactly. Only one of every few samples
    is a node. The spline predicts the samples between the nodes, which saves time.

    Attributes
    ----------
    mode
        Index of the assembly mode in `PositionAnalysis.assembly_modes`.
    first, last
        Indices of the samples that are the first and the last node.
    evaluate
        Function that takes the indices (n,) of samples. It returns the passive variables
        (n, passive) in rad there: all variables that are not inputs.
    """

    mode: int
    first: int
    last: int
    evaluate: Callable[[Floats], Floats]


def make_sample_predictor(
    position_analysis: PositionAnalysis,
) -> Callable[[int, int, Floats], None] | None:
    """Return a function that predicts configurations at samples of a path of inputs.

    A sample is one set of values of the inputs on the path. If samples are close together,
    the position analysis solves only some of them (nodes).
    Splines through the nodes predict the configurations at the samples between. The result
    is None if samples are too few or too far apart to save time, if they are a grid, or if
    there is no assembly mode.

    The function has the arguments start, stop and out. The variables of the samples from
    start up to, but without, stop are written into out (variables, modes, samples), in rad.
    The variables are NaN if nothing is predicted. The nodes are solved when the function is
    called for the first time.
    """
    q = position_analysis.input_grid.q
    if not position_analysis.input_grid.is_path or not position_analysis.assembly_modes:
        return None
    # Between two nodes no input changes by more than `NODE_DISTANCE_RAD`. The largest
    # change from sample to sample therefore determines the number of samples for each node.
    # If the inputs hardly change, `MAX_SAMPLES_PER_NODE` limits this number. There must be
    # more nodes than the degree of the spline.
    smallest_step = NODE_DISTANCE_RAD / MAX_SAMPLES_PER_NODE
    largest_step = max(smallest_step, max_abs(np.diff(q, axis=0)))
    samples_per_node = min(
        int(NODE_DISTANCE_RAD / largest_step), (len(q) - 1) // PREDICTION_SPLINE_DEGREE
    )
    if samples_per_node < MIN_SAMPLES_PER_NODE:
        return None
    driven = list(position_analysis.solver.driven)
    variable_count = len(position_analysis.mechanism.variable_owners)
    passive = np.delete(np.arange(variable_count), driven)
    is_angle = np.isin(passive, position_analysis.solver.angles)

    @cache
    def get_splines() -> list[ModeSpline]:
        """Return the splines. The nodes are solved in the first call only."""
        splines = _fit_splines(
            position_analysis, samples_per_node, passive=passive, is_angle=is_angle
        )
        return list(splines)

    def predict_samples(start: int, stop: int, out: Floats) -> None:
        """Write the predicted configurations at successive samples into `out`.

        A sample is one set of values of the inputs on the path. These values are copied
        into `out`. The other (passive) variables come from splines through the nodes, which
        are the solved samples. Passive variables are NaN where there is no spline. The
        caller has to verify the predictions.

        Parameters
        ----------
        start, stop
            Index of the first sample, and the index after the last one.
        out
            (variables, modes, samples) array (rad) that is filled. Its indices number the
            pair variables, the assembly modes (ways to assemble) and the samples.
        """
        out[:] = np.nan
        out[driven] = q[start:stop].T[:, None]
        for spline in get_splines():
            # The samples that both the spline and the request contain.
            low = max(start, spline.first)
            high = min(stop, spline.last + 1)
            if low < high:
                values = spline.evaluate(np.arange(low, high, dtype=float)).T
                # Reduce angles to (-pi, pi]. Only angles outside are computed, which saves
                # time.
                angles = values[is_angle]
                is_outside = ~(np.abs(angles) < np.pi)
                angles[is_outside] -= TURN * np.ceil((angles[is_outside] - np.pi) / TURN)
                values[is_angle] = angles
                out[passive, spline.mode, low - start : high - start] = values

    return predict_samples


def _fit_splines(
    position_analysis: PositionAnalysis,
    samples_per_node: int,
    passive: Indices,
    is_angle: Bools,
) -> Iterator[ModeSpline]:
    """Solve some samples, and yield splines that predict the samples between them.

    A solved sample is called a node. An assembly mode (one way to assemble) can have gaps,
    where it has no configuration. Each run of successive nodes with the status OK therefore
    has its own spline. Runs with too few nodes for a spline are left out.

    Parameters
    ----------
    position_analysis
        The samples of the inputs, and the assembly modes.
    samples_per_node
        Number of samples from one node to the next. The last sample is a node, too.
    passive
        Indices of the variables that are not inputs.
    is_angle
        (passive,) whether a variable is an angle, which has to be made continuous.
    """
    from scipy.interpolate import make_interp_spline

    # Solve the nodes in blocks. The results have all nodes of a mode, then of the next
    # mode.
    last_sample = len(position_analysis.input_grid) - 1
    mode_count = len(position_analysis.assembly_modes)
    nodes = np.append(np.arange(0, last_sample, samples_per_node), last_sample)
    values = np.empty((mode_count, len(nodes), len(passive)))
    is_ok = np.empty((mode_count, len(nodes)), dtype=bool)
    for start in range(0, len(nodes), NODES_PER_BLOCK):
        block = slice(start, start + NODES_PER_BLOCK)
        motion = position_analysis.samples(nodes[block])
        passive_values = motion.values[:, passive]
        values[:, block] = passive_values.reshape(mode_count, -1, len(passive))
        is_ok[:, block] = (motion.status == Status.OK).reshape(mode_count, -1)
    for mode in range(mode_count):
        # Where runs with the status OK begin and end: first node, and first node after the
        # run.
        borders = np.flatnonzero(np.diff(is_ok[mode], prepend=False, append=False))
        for first, stop in borders.reshape(-1, 2):
            if stop - first <= PREDICTION_SPLINE_DEGREE:
                continue
            run_values = values[mode, first:stop]
            run_nodes = nodes[first:stop]
            run_values[:, is_angle] = np.unwrap(run_values[:, is_angle], axis=0)
            spline = make_interp_spline(run_nodes, run_values, k=PREDICTION_SPLINE_DEGREE)
            yield ModeSpline(mode, first=run_nodes[0], last=run_nodes[-1], evaluate=spline)
