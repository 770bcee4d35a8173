"""Signs of pole directions that are continuous along each assembly mode.

The direction u of a pole is determined up to its sign. It follows the angular velocity v of
the second link relative to the first: at each sample the velocity coefficient v . u has the
sign of the previous sample. If v passes through zero between two samples, it reverses
relative to u, and so does the coefficient. The reversals are read from the cubic Hermite
interpolant of v between the samples. At the first sample of a mode, u points to the side on
which the sum of all axes and contact points lies. Over a grid of several inputs, all
directions point to this side.

v is per unit rate of the moving input. At a dead centre of the input it reverses through
infinity, and only its product with the sense of the input (+1 or -1) is continuous. v and
dv below contain this factor.

Signs are continued from block to block of a run by a `SignContinuation`.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from spherekit.arrays import Array, Bools, Floats, Indices
from spherekit.geometry.vectors import all_finite, dot_columns, norm_columns
from spherekit.numerics.hermite import cubic_hermite
from spherekit.planning.pole_plan import Pole
from spherekit.positions.motion import Motion
from spherekit.velocities.pole_field import SIGNED_COMPONENTS, PoleField, axis_pairs
from spherekit.velocities.pole_request import Request

HERMITE_SUBSTEPS = 8
"""Number of parts of the interpolant between two samples in which reversals are sought.

Larger: two zeros of v that are closer together are both noticed. Smaller: fewer products.
"""


VelocityPath = Floats
"""(8,) or (8, k) the relative angular velocity of a pole at one or k samples.

Index 0 is the coordinate along the path (the input, or the number of the sample), 1 the
sense of the input, 2 to 4 are v, and 5 to 7 the derivative dv of v by the coordinate.
"""

SignFunction = Callable[[Floats, Any, Any], Array]
"""Returns the factors +1 or -1 (poles, k) of k directions. The arguments are the directions
(3, poles, k) before, their rows in the motion, and the index of the assembly mode, one for
all or (k,)."""


@dataclass(frozen=True, eq=False)
class ComparedRows:
    """Rows of one assembly mode at which directions are compared with the row before.

    All rows between two of them have the sign of the first one, because no direction can
    reverse there.

    Attributes
    ----------
    rows
        (k,) numbers of the rows in the block, rising. The first and the last row of the
        mode are among them.
    may_reverse
        (k - 1,) whether a direction may reverse between a compared row and the next one.
    """

    rows: Indices
    may_reverse: Bools


class SignContinuation:
    """The signs of pole directions at the end of a block of samples of one motion.

    The direction of a pole (axis of the relative rotation of two links) is determined up to
    its sign. A run computes samples in blocks, and the next block continues the signs.

    Attributes
    ----------
    last
        The keys are three numbers: the number of the assembly mode, and the numbers of the
        two links of a pole. The values are eight numbers of the last sample, and the sign
        of the direction there. The eight numbers (`VelocityPath`) are the input, the sense
        in which it moves, the relative angular velocity of the links (3) and its derivative
        (3).
    first_axis_sums
        By the number of the assembly mode, the sum (3,) of the axes and contact points of
        all pairs at the first sample of the mode. There, directions of poles are chosen
        such that their scalar product with this vector is not negative.
    """

    def __init__(self) -> None:
        """Begin without any signs."""
        self.last: dict[tuple[int, ...], tuple[VelocityPath, float]] = {}
        self.first_axis_sums: dict[int, Floats] = {}

    def state(self) -> dict[str, Any]:
        """Return the state as plain lists, from which JSON restores every bit."""
        return {
            # Files of interrupted runs have this key.
            "home": [
                [mode, axis_sum.tolist()] for mode, axis_sum in self.first_axis_sums.items()
            ],
            "last": [
                [*key, path.tolist(), sign] for key, (path, sign) in self.last.items()
            ],
        }

    @classmethod
    def restored(cls, state: Mapping[str, Any]) -> "SignContinuation":
        """Return the object whose `state` this is."""
        sign_continuation = cls()
        for mode, axis_sum in state["home"]:
            sign_continuation.first_axis_sums[mode] = np.array(axis_sum)
        for *key, path, sign in state["last"]:
            sign_continuation.last[tuple(key)] = np.array(path), sign
        return sign_continuation


def apply_continuous_signs(
    field: PoleField, motion: Motion, request: Request, sign_continuation: SignContinuation
) -> None:
    """Give directions, and the coefficients along them, their continuous signs, in place.

    The direction of a pole follows the angular velocity v of its second link relative to
    the first: their scalar product keeps its sign until v passes through zero.

    Parameters
    ----------
    field
        Poles at the n rows of the motion, whose directions have arbitrary signs. They are
        multiplied by signs in place.
    motion, request
        The configurations, and the request of the poles.
    sign_continuation
        Signs at the end of the previous block of rows. It is updated in place.
    """
    n = len(motion)
    # The axis of a pair has its sign already, and two links of one body have no pole.
    settled_poles = {None, *axis_pairs(request.plan)}
    poles = [
        pole for pole in request.poles if request.plan.pole(*pole) not in settled_poles
    ]
    if not (poles and motion.assembly_modes and n):
        return
    # +1, or -1 where the input moves back. v is per unit rate of the input, so only its
    # product with the sense is continuous at dead centres of the input.
    sense = np.ones(n) if motion.sense is None else motion.sense
    # Arrays (poles, 3, n) of directions, of v, and of its derivative by the input.
    directions = np.array([field.direction[pole].T for pole in poles])
    v = np.array([(field.w[j] - field.w[i]).T for i, j in poles])
    dv = np.array([(field.dw[j] - field.dw[i]).T for i, j in poles])
    coefficients = np.array([field.velocity_coefficient[pole] for pole in poles])
    v_error = np.array([field.velocity_coefficient_error[pole] for pole in poles])
    dv_error = np.array([field.acceleration_coefficient_error[pole] for pole in poles])

    # The relative velocity of links at rest is a rounding error. In place of v, the
    # direction itself is then continued from row to row.
    is_at_rest = (norm_columns(v) <= v_error) & (norm_columns(dv) <= dv_error)
    along_v = np.where((coefficients * sense < 0.0) & ~is_at_rest, -1.0, 1.0)
    continued_v = np.where(is_at_rest[:, None], directions, sense * v)
    continued_dv = np.where(is_at_rest[:, None], 0.0, sense * dv)
    # Directions, velocities and derivatives, of shape (3, poles, n) each. Velocity
    # coefficients along these directions are not negative.
    paths = np.swapaxes([along_v[:, None] * directions, continued_v, continued_dv], 1, 2)

    has_configuration = ~motion.failed.reshape(-1, motion.samples)
    if motion.is_path:
        compared_rows_by_mode: dict[int, ComparedRows] = {}
        for mode_index, is_valid in enumerate(has_configuration):
            rows = np.flatnonzero(is_valid) + mode_index * motion.samples
            if len(rows):
                # A direction may reverse between any two rows.
                compared_rows_by_mode[mode_index] = ComparedRows(
                    rows, may_reverse=np.ones(len(rows) - 1, dtype=bool)
                )
        sign_function = continue_signs(
            motion,
            poles,
            compared_rows_by_mode,
            lambda rows: paths[..., rows],
            sign_continuation,
        )
    else:
        sign_function = signs_by_first_axis_sums(
            motion, has_configuration, sign_continuation
        )
    rows = np.arange(n)
    signs = along_v * sign_function(paths[0], rows, rows // motion.samples)
    for pole, pole_signs in zip(poles, signs, strict=True):
        apply_signs(field, pole, pole_signs)


def apply_signs(field: PoleField, pole: Pole, signs: Floats) -> None:
    """Multiply the direction of a pole and its coefficients by signs (n,), in place."""
    for name in SIGNED_COMPONENTS:
        values = getattr(field, name)[pole].T
        values *= signs


def signs_by_axis_sums(axis_sums: Floats) -> SignFunction:
    """Return a function of the signs that make pole directions agree with given vectors.

    The direction of a pole (the axis about which two links turn relative to each other) is
    determined up to its sign. A direction that makes an obtuse angle with the vector of its
    assembly mode gets the sign -1, any other 1. So the sign depends on the direction alone,
    not on other rows. It jumps where the direction passes the plane at right angles to the
    vector.

    Parameters
    ----------
    axis_sums
        (modes, 3) a constant vector for each assembly mode, usually the sum of all pair
        axes in one configuration.
    """

    def find_signs(directions: Floats, rows: Any, modes: Any) -> Floats:
        """Return the signs (poles, k) of directions (3, poles, k) at k rows.

        `modes` is the index of the assembly mode, one for all rows or (k,). `rows` has no
        effect here. Other functions of the type `SignFunction` need it.
        """
        x, y, z = np.atleast_2d(axis_sums[modes]).T
        is_opposite = x * directions[0] + y * directions[1] + z * directions[2] < 0.0
        return np.where(is_opposite, -1.0, 1.0)

    return find_signs


def signs_by_first_axis_sums(
    motion: Motion, has_configuration: Bools, sign_continuation: SignContinuation
) -> SignFunction:
    """Return a function of signs that depend only on the first row of each assembly mode.

    The direction of a pole is determined up to its sign. If rows are no path, the sign
    cannot be continued from row to row. Each assembly mode then has one constant vector for
    all poles and rows: the sum of all pair axes at its first row. Signs are such that the
    scalar products of directions with this vector are not negative. So the sign of a row
    does not depend on the order of the rows.

    Parameters
    ----------
    motion
        Rows of all assembly modes.
    has_configuration
        (modes, samples) which rows have a configuration.
    sign_continuation
        The vectors of modes that have rows in earlier blocks. The vectors of other modes
        are added in place.
    """
    axis_sums = np.zeros((len(motion.assembly_modes), 3))
    # A motion can also be a selection of rows. It still lists all modes, but
    # `has_configuration` then has one row for all of them. `strict=False` allows this.
    for mode_index, (mode, is_valid) in enumerate(
        zip(motion.assembly_modes, has_configuration, strict=False)
    ):
        if np.any(is_valid):
            first_row = mode_index * motion.samples + int(np.argmax(is_valid))
            axis_sums[mode_index] = _first_axis_sum(
                motion, mode.number, first_row, sign_continuation
            )
    return signs_by_axis_sums(axis_sums)


def _first_axis_sum(
    motion: Motion, mode: int, first_row: int, sign_continuation: SignContinuation
) -> Floats:
    """Return the vector (3,) that decides the signs of directions at the start of a mode.

    It is the sum of the axes and contact points of all pairs at the first row of the mode,
    which may be in an earlier block of rows.
    """
    if mode not in sign_continuation.first_axis_sums:
        (frames,) = motion.rows(np.array([first_row])).frames
        sign_continuation.first_axis_sums[mode] = np.sum(frames[:, :, 2], axis=0)
    return sign_continuation.first_axis_sums[mode]


def continue_signs(
    motion: Motion,
    poles: Sequence[Pole],
    compared_rows_by_mode: Mapping[int, ComparedRows],
    evaluate_poles: Callable[[Indices], Iterable[Floats]],
    sign_continuation: SignContinuation,
) -> SignFunction:
    """Return a function that returns signs of pole directions at rows of a motion.

    The direction of a pole is determined up to its sign. Multiplied by the signs, the
    directions are continuous along each assembly mode.

    Parameters
    ----------
    motion
        A motion along a path of its inputs.
    poles
        The poles whose signs are computed.
    compared_rows_by_mode
        The rows at which directions are compared, by the index of the assembly mode.
    evaluate_poles
        Returns at rows (k,) the directions of the poles, the angular velocities v of their
        second links relative to the first, and the derivatives of v by the input, each
        (3, poles, k). v and its derivatives contain the sense of the input. The scalar
        products of v and these directions are not negative; the signs apply to them.
    sign_continuation
        Signs at the end of the previous block. It is updated.
    """
    signs = np.ones((len(poles), len(motion)), dtype=np.int8)

    def look_up_signs(directions: Floats, rows: Any, modes: Any) -> Array:
        """Return the signs (poles, k) at rows (k,), which were computed for all rows.

        The other arguments have no effect here; other functions of the type `SignFunction`
        need them.
        """
        return signs[:, rows]

    if not poles or not compared_rows_by_mode:
        return look_up_signs
    all_rows = np.concatenate(
        [compared_rows.rows for compared_rows in compared_rows_by_mode.values()]
    )
    directions, v, dv = evaluate_poles(all_rows)
    has_several_inputs = motion.inputs.shape[1] > 1
    if has_several_inputs:
        # dv is the derivative by one input, and not along the path of all inputs.
        dv = np.zeros_like(v)
    coordinate = motion.sample.astype(float) if has_several_inputs else motion.inputs[:, 0]
    has_direction = all_finite(directions, 0)
    has_motion = has_direction & all_finite(v, 0) & np.any(v, axis=0)

    first = 0
    for mode_index, compared_rows in compared_rows_by_mode.items():
        rows = compared_rows.rows
        mode_number = motion.assembly_modes[mode_index].number
        # The columns of this mode in the arrays of `evaluate_poles`.
        columns = slice(first, first + len(rows))
        first = columns.stop
        end_row = (mode_index + 1) * motion.samples
        sense = np.ones(len(rows)) if motion.sense is None else motion.sense[rows]
        # Number of gaps up to each row in which directions may reverse.
        open_gaps = np.append(0, np.cumsum(compared_rows.may_reverse))
        for pole_index, pole in enumerate(poles):
            key = (mode_number, *pole)
            pole_directions = directions[:, pole_index, columns]
            is_moving = has_motion[pole_index, columns]
            moving = np.flatnonzero(is_moving)
            if not len(moving):
                continue
            start_sign = 1.0
            if key not in sign_continuation.last:
                axis_sum = _first_axis_sum(
                    motion, mode_number, int(rows[moving[0]]), sign_continuation
                )
                if axis_sum @ pole_directions[:, moving[0]] < 0.0:
                    start_sign = -1.0
            path = np.concatenate(
                [
                    coordinate[rows][None],
                    sense[None],
                    v[:, pole_index, columns],
                    dv[:, pole_index, columns],
                ]
            )[:, moving]
            may_reverse_between = open_gaps[moving[1:]] > open_gaps[moving[:-1]]
            moving_signs = _continue_along_path(
                sign_continuation, key, start_sign, path, may_reverse_between
            )
            # Rows that do not move have the sign of the last moving row before them.
            repetitions = np.diff(moving, prepend=0, append=len(rows))
            row_signs = np.repeat(np.append(1.0, moving_signs), repetitions)
            # Directions without a velocity point to the side of the nearest one with it.
            is_resting = has_direction[pole_index, columns] & ~is_moving
            for k in np.flatnonzero(is_resting):
                nearest = moving[np.argmin(np.abs(rows[moving] - rows[k]))]
                nearest_direction = row_signs[nearest] * pole_directions[:, nearest]
                row_signs[k] = (
                    -1.0 if nearest_direction @ pole_directions[:, k] < 0.0 else 1.0
                )
            signs[pole_index, rows[0] : end_row] = np.repeat(
                row_signs, np.diff(rows, append=end_row)
            )
    return look_up_signs


def _continue_along_path(
    sign_continuation: SignContinuation,
    key: tuple[int, ...],
    start_sign: float,
    path: VelocityPath,
    may_reverse: Bools,
) -> Floats:
    """Return the continuous signs (k,) of a direction along a path of samples.

    The direction is along the relative angular velocity v of the links of its pole. Where v
    passes through zero and reverses between two samples, the sign changes. That is only
    possible if the scalar product of v at both samples is negative. But v may also have
    turned by more than 90 degrees, so `_find_reversals` interpolates v to decide.

    Long motions are computed in blocks of samples. The last sample is stored, so that the
    next block continues from there.

    Parameters
    ----------
    sign_continuation
        Signs at the end of the previous block. It is updated in place.
    key
        Three numbers: of the assembly mode and of the two links of the pole.
    start_sign
        The sign at the first sample, if there is no previous block.
    path
        (8, k) at each sample: the coordinate (index 0), which is the input or, if there are
        several inputs, the number of the sample; the sense in which the input moves, 1 or
        -1 (1); v (2 to 4); and the derivative of v by the coordinate (5 to 7).
    may_reverse
        (k - 1,) whether the gap between a sample and the next one has to be examined. The
        caller knows already that v does not reverse in the other gaps.
    """
    # -1 for the gaps between two samples in which v reverses, otherwise 1.
    reversals = np.ones(len(may_reverse))
    if np.any(may_reverse):
        reversals = np.where(may_reverse, _find_reversals(path), 1.0)
    first_sign = start_sign
    if key in sign_continuation.last:
        # v may also reverse between the last sample of the previous block and the first
        # one of this block.
        last_path, first_sign = sign_continuation.last[key]
        last_v = last_path[2:5]
        first_v = path[2:5, 0]
        if last_v @ first_v < 0.0:
            across_blocks = np.column_stack([last_path, path[:, 0]])
            first_sign *= float(_find_reversals(across_blocks)[0])
    # The sign of each sample is that of the one before, times the sign of the gap.
    signs = np.cumprod(np.append(first_sign, reversals))
    sign_continuation.last[key] = path[:, -1].copy(), float(signs[-1])
    return signs


def _find_reversals(path: VelocityPath) -> Floats:
    """Return whether a vector reverses between successive samples, as signs -1 and +1.

    The vector is the relative angular velocity v of the links of a pole. If the scalar
    product of its values at two samples is not negative, it counts as not reversed between
    them. Otherwise it may have reversed, or have turned by more than a right angle without
    becoming zero. To decide this, it is interpolated by a cubic Hermite polynomial, whose
    reversals are counted. If the sense of the input changes between the samples,
    derivatives by the coordinate cannot be used, and v is interpolated by a straight line.

    Parameters
    ----------
    path
        (8, k) at each of k samples: the coordinate (index 0), which is the input or, if
        there are several inputs, the number of the sample; the sense in which the input
        moves, 1 or -1 (1); v (2 to 4); and the derivative of v by the coordinate (5 to 7).

    Returns
    -------
    (k - 1,) -1 between two samples if v reverses an odd number of times, otherwise +1.
    """
    coordinate = path[0]
    sense = path[1]
    v = path[2:5]
    # A derivative that is not known (NaN) counts as zero.
    dv = np.nan_to_num(path[5:])
    reversals = np.ones(len(coordinate) - 1)
    gaps = np.flatnonzero(dot_columns(v[:, 1:], v[:, :-1]) < 0.0)
    if not len(gaps):
        return reversals
    # With a length of zero, the derivatives at both ends have no effect.
    lengths = np.where(sense[1:] == sense[:-1], np.diff(coordinate), 0.0)[gaps]
    fractions = np.linspace(0.0, 1.0, HERMITE_SUBSTEPS + 1)[:, None]
    start = v[:, None, gaps], dv[:, None, gaps]
    stop = v[:, None, gaps + 1], dv[:, None, gaps + 1]
    # (3, substeps + 1, gaps) v at positions between the samples.
    interpolated = cubic_hermite(start, stop, lengths, fractions)
    # At both ends v is known without the rounding errors of the interpolation. If it is
    # nearly zero there, these errors could reverse it.
    interpolated[:, 0] = start[0][:, 0]
    interpolated[:, -1] = stop[0][:, 0]
    # v reverses where its scalar product with the next value is negative.
    products = np.sum(interpolated[:, 1:] * interpolated[:, :-1], axis=0)
    reversals[gaps] = (-1.0) ** np.sum(products < 0.0, axis=0)
    return reversals
