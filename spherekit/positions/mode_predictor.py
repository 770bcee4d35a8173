"""Predicts the configurations of an assembly mode from verified configurations of it.

Groups that are not dyads are placed by Newton's method, which needs a start value on the
right assembly mode. With one input, a mode is a curve of verified nodes, and any sample is
interpolated from it (`ModeCurve`). With several inputs, a mode is known at the samples of
an input grid (`ModeOverGrid`): from a known configuration it spreads from sample to
neighbouring sample by verified steps on straight lines. In this way it reaches samples
behind a region that is out of reach. Unless constraints are redundant, it never passes a
configuration at which the inputs do not determine the motion.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Floats, Indices, SmallIntegers
from spherekit.geometry.vectors import all_finite, max_abs, nans
from spherekit.numerics.hermite import cubic_hermite
from spherekit.positions.curve_crossing import find_outgoing_points
from spherekit.positions.input_grid import InputGrid
from spherekit.positions.input_paths import (
    InputPathNodes,
    Trail,
    follow_inputs,
    is_nearly_singular,
    nodes_at,
)
from spherekit.positions.loop_closure import Closure
from spherekit.status import Status

DEAD_CENTRE_RATIO = 1e-9
"""A configuration with a smaller reciprocal condition number is a dead centre of the input.

The number belongs to the closure Jacobian with locked input. Larger: more modes begin with
the slower search for outgoing curves. Smaller: slopes at the nodes are rounding errors.
"""
MIN_INPUT_CHANGE_RAD = 1e-9
"""A curve along which the input changes less, near a dead centre, does not move the input.

Larger: curves along which the input moves slowly are left out. Smaller: rounding errors
count as a motion of the input.
"""
DEAD_CENTRE_END_RAD = 1e-4
"""A curve that ends nearer to a dead centre than this is extended to the dead centre.

Larger: a neighbouring mode may be connected with the dead centre. Smaller: the mode of a
dead centre can end before it.
"""
NEAREST_SAMPLES = 8
"""Number of nearest grid samples to which straight paths from a configuration are tried.

Larger: more time. Smaller: modes in narrow regions may reach no sample.
"""
RANGE_END_TOLERANCE = 1e-14
"""Inputs beyond the end of a curve by less (rad, relative above 1 rad) are at the end."""


class ModePrediction(NamedTuple):
    """Predicted configurations of an assembly mode (one way to assemble) at n samples.

    These are start values of Newton's method, interpolated between known configurations of
    the mode, the nodes.

    Attributes
    ----------
    values
        (n, variables) predicted pair variables (rad).
    spread
        (n,) largest change of a variable between the two nodes around the sample (rad). The
        permitted error of the prediction grows with it. Zero if nothing is interpolated, or
        if there is only one node.
    status
        (n,) OK, or a code that says why the mode has no configuration at the sample.
    """

    values: Floats
    spread: Floats
    status: SmallIntegers


@dataclass(frozen=True)
class ModeCurve:
    """An assembly mode (way to assemble the links) as a curve over a single input.

    The curve is stored as nodes (verified configurations), between which configurations are
    interpolated.

    Attributes
    ----------
    inputs
        (k,) values of the input (rad) at the nodes, rising.
    values
        (k, variables) pair variables at the nodes (rad).
    slopes
        (k, variables) derivatives of the variables with respect to the input. They are
        exact except at a dead centre, which has the slope of the line to the next node.
    ends
        Why the curve ends at the first and at the last node: OK if the range ends,
        otherwise the status of the samples beyond.
    tried_steps
        Number of steps that were tried to find the curve, including those that failed.
    """

    inputs: Floats
    values: Floats
    slopes: Floats
    ends: tuple[Status, Status]
    tried_steps: int = 0

    def interpolate(self, q: Floats) -> tuple[Floats, Floats]:
        """Interpolate the configurations of a mode between its nodes by cubic polynomials.

        The nodes are verified configurations, at the values `inputs` of the only input,
        with the derivatives `slopes` of the variables with respect to the input.

        Parameters
        ----------
        q
            (n,) values of the input (rad).

        Returns
        -------
        values
            (n, variables) interpolated variables (rad).
        spread
            (n,) largest difference of a variable between the two nodes around q (rad). The
            permitted error of the interpolated values grows with it.
        """
        # A curve of one node is constant.
        if len(self.inputs) == 1:
            return np.repeat(self.values, len(q), axis=0), np.zeros(len(q))
        # q lies between the nodes k and k + 1. Beyond the ends, the last polynomial goes
        # on.
        k = np.clip(np.searchsorted(self.inputs, q) - 1, 0, len(self.inputs) - 2)
        width = (self.inputs[k + 1] - self.inputs[k])[:, None]
        fraction = (q - self.inputs[k])[:, None] / width
        values = cubic_hermite(
            (self.values[k], self.slopes[k]),
            (self.values[k + 1], self.slopes[k + 1]),
            width,
            fraction,
        )
        return values, max_abs(self.values[k + 1] - self.values[k], axis=1)

    def predict(self, q: Floats, rows: Indices | None = None) -> ModePrediction:
        """Return predicted configurations of the mode at inputs q (n, 1) in rad.

        Newton's method starts from these configurations. `rows` is not used (see
        `ModeOverGrid.predict`).
        """
        inputs = q[:, 0]
        status = np.full(len(q), Status.OK, dtype=np.int8)
        slack = RANGE_END_TOLERANCE * np.maximum(1.0, np.abs(inputs))
        status[inputs < self.inputs[0] - slack] = self.ends[0]
        status[inputs > self.inputs[-1] + slack] = self.ends[1]
        values, spread = self.interpolate(inputs)
        return ModePrediction(values, spread, status)


class ModeOverGrid(NamedTuple):
    """Configurations of an assembly mode (one way to assemble) at n samples of inputs.

    The class is used for mechanisms with several inputs, and `ModeCurve` for one input.
    Both have the method `predict`, which gives the start values of Newton's method. Here
    they are known at the samples only.

    Attributes
    ----------
    values
        (n, variables) pair variables (rad), NaN where the mode was not reached.
    status
        (n,) OK, or a code that says why the last path towards the sample ended.
    """

    values: Floats
    status: SmallIntegers

    def predict(self, q: Floats, rows: Indices | None) -> ModePrediction:
        """Return the configurations at the samples with the indices `rows` (m,).

        The configurations are stored, so nothing is interpolated. `q` (m, inputs) are the
        inputs (rad) at these samples. The indices are needed here; they may be None only in
        `ModeCurve.predict`, which has the same parameters.
        """
        assert rows is not None
        return ModePrediction(
            values=self.values[rows],
            # Stored configurations have no interpolation error.
            spread=np.zeros(len(q)),
            status=self.status[rows],
        )


def follow_each(
    closure: Closure, driven: int, values: Floats, low: float, high: float
) -> list[ModeCurve]:
    """Follow assembly modes from n configurations over the range of the only input.

    From each configuration the input moves to both ends of the range, in steps that are
    verified to stay on the mode. At a dead centre the input is stationary, so the variables
    have no derivatives with respect to the input. A mode that starts there is followed from
    a point nearby.

    Parameters
    ----------
    closure
        The loops of the whole mechanism, as equations for the pair variables.
    driven
        Index of the variable of the input.
    values
        (n, variables) closed configurations (rad).
    low, high
        Range of the input (rad). For a configuration outside it, the range is extended to
        the input of the configuration.

    Returns
    -------
    The curve of each configuration, as far as its mode reaches.
    """
    # At a dead centre the equations for the other variables are singular. A nearly singular
    # start counts as a dead centre: ratio of the least to the greatest singular value below
    # `DEAD_CENTRE_RATIO`.
    start_nodes = _evaluate_nodes(closure, driven, values)
    is_regular = ~is_nearly_singular(closure.linearise(values), [driven], DEAD_CENTRE_RATIO)
    is_regular &= all_finite(start_nodes.slope, 1)
    # Regular starts are followed together, which is faster; dead centres one by one.
    regular_starts = start_nodes.rows(is_regular)
    regular_curves = iter(
        _follow_from_nodes(closure, driven, starts=regular_starts, low=low, high=high)
    )
    # The curves are returned in the order of the configurations.
    curves = []
    for configuration, is_regular_start in zip(values, is_regular, strict=True):
        if is_regular_start:
            curves.append(next(regular_curves))
        else:
            curves.append(
                _follow_from_dead_centre(
                    closure, driven, values=configuration, low=low, high=high
                )
            )
    return curves


def _follow_from_dead_centre(
    closure: Closure, driven: int, values: Floats, low: float, high: float
) -> ModeCurve:
    """Return the curve of an assembly mode (way to assemble the links) at a dead centre.

    A mode is a curve of configurations over the input. At a dead centre the input is
    stationary on this curve, so derivatives with respect to the input are infinite. The
    curve is therefore followed from a point near the dead centre.

    Several curves may leave the dead centre, so there are several points. From each point
    the input moves towards both ends of its range. A curve is the mode of the dead centre
    if it ends near the dead centre in one of the two directions. If there are several of
    these curves, the first one is returned.

    Parameters
    ----------
    closure
        The loops of the whole mechanism.
    driven
        Index of the variable of the input.
    values
        (variables,) the dead centre (rad).
    low, high
        Range of the input (rad).

    Returns
    -------
    The first curve with an end near the dead centre, extended to the dead centre. If there
    is none, the curve that was followed from the dead centre itself.
    """
    # (k, variables) points near the dead centre, one on each branch of a curve through it.
    # Curves along which the input does not move belong to no mode and are left out.
    points = find_outgoing_points(closure, values)
    input_changes = points[:, driven] - values[driven]
    points = points[np.abs(input_changes) > MIN_INPUT_CHANGE_RAD]
    # Points are sorted, so that rounding errors do not decide which curve is the first. The
    # key is the rounded difference from the dead centre.
    sorted_points = sorted(points, key=lambda point: tuple(np.round(values - point, 6)))
    # The last start is the dead centre itself. Its derivatives with respect to the input
    # are inaccurate, so its curve is the result only if no other curve reaches the dead
    # centre.
    starts = _evaluate_nodes(closure, driven, np.array([*sorted_points, values]))
    curves = _follow_from_nodes(closure, driven, starts=starts, low=low, high=high)
    # The result states how many steps were tried on all these curves.
    tried_steps = sum(curve.tried_steps for curve in curves)
    for curve in curves[:-1]:
        # The node at an end of the curve, and the index at which the dead centre would be
        # inserted: before the first node, or behind the last one.
        for end_node, insertion_index in ((0, 0), (-1, len(curve.inputs))):
            difference = curve.values[end_node] - values
            input_difference = difference[driven]
            if input_difference and max_abs(difference) < DEAD_CENTRE_END_RAD:
                # At the dead centre, the slope with respect to the input is infinite. The
                # slope of the straight line from the dead centre to the node is used.
                slope = difference / input_difference
                return ModeCurve(
                    inputs=np.insert(curve.inputs, insertion_index, values[driven]),
                    values=np.insert(curve.values, insertion_index, values, axis=0),
                    slopes=np.insert(curve.slopes, insertion_index, slope, axis=0),
                    ends=curve.ends,
                    tried_steps=tried_steps,
                )
    return replace(curves[-1], tried_steps=tried_steps)


def _evaluate_nodes(closure: Closure, driven: int, values: Floats) -> InputPathNodes:
    """Return the nodes at configurations (n, variables), with their input derivatives."""
    return nodes_at(closure.linearise(values), [driven], np.ones((len(values), 1)))


def _follow_from_nodes(
    closure: Closure, driven: int, starts: InputPathNodes, low: float, high: float
) -> list[ModeCurve]:
    """Return the assembly modes through nodes at which the input moves.

    The input moves from each node to both ends of its range. A node is a verified
    configuration with the derivatives of all variables with respect to the length of the
    path of the input. This length grows on every path, also where the input falls.

    Parameters
    ----------
    closure
        The loops of the whole mechanism.
    driven
        Index of the variable of the input.
    starts
        n nodes, with derivatives for a rising input.
    low, high
        Range of the input (rad).
    """
    start_inputs = starts.values[:, driven]
    count = len(starts.values)
    # Each node is the start of two paths: path k to the low end of the range, and path
    # k + count to the high end.
    goals = np.concatenate([np.minimum(low, start_inputs), np.maximum(high, start_inputs)])
    # The trail receives, for each step, the numbers of the paths and their new nodes.
    trail = Trail()
    followed = follow_inputs(
        closure,
        [driven],
        values=np.tile(starts.values, (2, 1)),
        q=goals[:, None],
        trail=trail,
    )
    all_nodes = InputPathNodes.concatenate([starts, *(nodes for _, nodes in trail)])
    # The curve k has the nodes of both paths k and k + count, sorted by the input.
    curve_numbers = np.concatenate(
        [np.arange(count), *(paths % count for paths, _ in trail)]
    )
    order = np.argsort(all_nodes.values[:, driven], kind="stable")
    curves = []
    for curve_number in range(count):
        nodes = all_nodes.rows(order[curve_numbers[order] == curve_number])
        low_path = curve_number
        high_path = curve_number + count
        curves.append(
            ModeCurve(
                inputs=nodes.values[:, driven].copy(),
                values=nodes.values,
                # The direction is 1, or -1 for nodes on paths to the low end. The product
                # is the derivative with respect to the input itself.
                slopes=nodes.slope * nodes.direction,
                ends=(
                    Status(followed.status[low_path]),
                    Status(followed.status[high_path]),
                ),
                tried_steps=int(
                    followed.tried_steps[low_path] + followed.tried_steps[high_path]
                ),
            )
        )
    return curves


def sheets_through(
    closure: Closure, driven: Sequence[int], input_grid: InputGrid, values: Floats
) -> list[ModeOverGrid | None]:
    """Spread configurations over the samples of an input grid, by verified paths.

    A sheet is the set of configurations that are reached from one start, at most one at
    each sample (node of the grid). A sheet is an assembly mode (way to assemble the links),
    or a part of one.

    Parameters
    ----------
    closure
        The loops of the whole mechanism.
    driven
        Indices of the variables of the inputs.
    input_grid
        The n samples.
    values
        (k, variables) closed configurations (rad). Straight paths lead from each
        configuration to its nearest samples, and from these to neighbouring samples.

    Returns
    -------
    k sheets; None for a configuration from which no sample is reached.
    """
    n = len(input_grid)
    count = len(values)
    if not count:
        return []
    # All points of all sheets are in one list: first the samples of sheet 0, then those of
    # sheet 1, and so on, and behind them the k configurations.
    points = np.concatenate([nans((count * n, values.shape[1])), values])
    status = np.full(len(points), Status.OUT_OF_REACH, dtype=np.int8)
    status[count * n :] = Status.OK
    sheet_offsets = n * np.arange(count)[:, None]
    nearest = np.array(
        [input_grid.nearest(row[list(driven)], NEAREST_SAMPLES) for row in values]
    )
    configurations = np.repeat(count * n + np.arange(count), nearest.shape[1])
    neighbours = input_grid.neighbours()
    exists = neighbours >= 0
    # Each path is an index in `points` of its start, and one of its stop.
    starts = np.append(configurations, np.nonzero(exists)[1] + sheet_offsets)
    stops = np.append(nearest + sheet_offsets, neighbours[exists] + sheet_offsets)
    is_untried = np.ones(len(stops), dtype=bool)
    while True:
        is_useful = (status[starts] == Status.OK) & (status[stops] != Status.OK)
        (paths,) = np.nonzero(is_untried & is_useful)
        if not len(paths):
            break
        # Only one path to each point at a time.
        paths = paths[np.unique(stops[paths], return_index=True)[1]]
        is_untried[paths] = False
        targets = stops[paths]
        followed = follow_inputs(
            closure, driven, points[starts[paths]], input_grid.q[targets % n]
        )
        status[targets] = followed.status
        has_arrived = followed.status == Status.OK
        points[targets[has_arrived]] = followed.nodes.values[has_arrived]
    sheets: list[ModeOverGrid | None] = []
    for sheet in range(count):
        samples = slice(sheet * n, (sheet + 1) * n)
        if np.any(status[samples] == Status.OK):
            sheets.append(ModeOverGrid(points[samples], status[samples]))
        else:
            sheets.append(None)
    return sheets
