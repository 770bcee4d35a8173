"""Signs of pole directions that are continuous along each assembly mode.

The direction u of a pole is determined up to its sign. It follows the angular velocity v of
the second link relative to the first: at each sample the velocity coefficient v . u has
the sign that it has at the previous sample. If v passes through zero between two
samples, it reverses relative to u, and so does the coefficient. The reversals are read
from the cubic Hermite interpolant of v between the samples. At the first sample of a
mode, u points to the side on which the sum of all axes and contact points lies. Over a
grid of several inputs, all directions point to this side.

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


SignFunction = Callable[[Floats, Any, Any], Array]
"""Returns the factors +1 or -1 (poles, k) of k directions. The arguments are the directions
(3, poles, k) before, their rows in the motion, and the index of the assembly mode, one for
all or (k,)."""


@dataclass(frozen=True, eq=False)
class ComparedRows:
    """Rows of one assembly mode at which the computed directions of poles are compared.

    A pole is the axis of the relative rotation of two links. Its computed direction can
    jump to the opposite direction from one row to the next. A factor of 1 or -1 in each row
    makes the direction continuous. To find this factor, `continue_signs` compares each of
    these rows with the compared row before it. The rows between two compared rows have the
    factor of the first of these.

    Attributes
    ----------
    rows
        (k,) indices of the compared rows among the rows of the motion, rising. The first
        and the last row of the assembly mode (way to assemble the links) are among them.
    may_reverse
        (k - 1,) for each compared row but the first, whether a direction may jump between
        the previous compared row and this one.
    """

    rows: Indices
    may_reverse: Bools


@dataclass(frozen=True, eq=False)
class VelocityPath:
    """The relative angular velocity v of two links at k samples along a path of the inputs.

    The sign of the pole direction (axis of v) is continued along this path.

    Attributes
    ----------
    coordinate
        (k,) coordinate along the path: the input (rad) or, if there are several inputs, the
        index of the sample.
    sense
        (k,) `Motion.sense`: -1 where the input moves back after a dead centre, otherwise 1.
    v
        (3, k) relative angular velocity while one input moves at the rate `sense`.
    dv
        (3, k) derivative of `v` with respect to the coordinate; 0 if there are several
        inputs, for which the derivative is not known.
    """

    coordinate: Floats
    sense: Floats
    v: Floats
    dv: Floats

    def selection(self, samples: Any) -> "VelocityPath":
        """Return the path at some of its samples, given by indices or a slice."""
        return VelocityPath(
            self.coordinate[samples],
            self.sense[samples],
            self.v[:, samples],
            self.dv[:, samples],
        )

    def followed_by(self, other: "VelocityPath") -> "VelocityPath":
        """Return the path of all samples of this path and then those of another one."""
        return VelocityPath(
            np.append(self.coordinate, other.coordinate),
            np.append(self.sense, other.sense),
            np.hstack([self.v, other.v]),
            np.hstack([self.dv, other.dv]),
        )


@dataclass(frozen=True, eq=False)
class LastSample:
    """The last sample of a block at which the two links of a pole have relative motion.

    A pole is the axis of this relative rotation. Its direction is computed with an
    arbitrary sign, and then multiplied by +1 or -1, so that it has no jumps. Long motions
    are computed in blocks of samples. The first factor of the next block follows from the
    factor of this sample: it is the opposite one if v reverses in between.

    Attributes
    ----------
    path
        The relative angular velocity v at this sample, as a path of one sample. `sense` is
        -1 where the input moves back after a dead centre, otherwise 1.
    sign
        The factor of the direction at this sample, +1.0 or -1.0.
    """

    path: VelocityPath
    sign: float

    def numbers(self) -> list[Any]:
        """Return eight numbers of the path, and the sign, for the file of the run's state.

        The eight numbers are the coordinate, the sense, and three components each of v and
        dv.
        """
        path = self.path
        columns = [path.coordinate, path.sense, *path.v, *path.dv]
        # The path has a single sample, so each column has one number.
        return [[float(column[0]) for column in columns], self.sign]

    @staticmethod
    def from_numbers(numbers: Sequence[float], sign: float) -> "LastSample":
        """Return the sample from the eight numbers and the sign that `numbers` returns."""
        coordinate, sense, *components = (np.array([number]) for number in numbers)
        path = VelocityPath(
            coordinate, sense, v=np.array(components[:3]), dv=np.array(components[3:])
        )
        return LastSample(path, sign)


class SignContinuation:
    """The signs of pole directions at the end of a block of samples of one motion.

    A pole is the axis of the relative rotation of two links. Its direction is known up to
    its sign. A run computes samples in blocks, and the next block continues the signs.

    Attributes
    ----------
    last
        The last sample of each pole in each assembly mode (way to assemble the links).
        A key has three numbers: the number of the mode and the indices of the two
        links.
    first_axis_sums
        By the number of the assembly mode, the sum (3,) of a unit vector for each pair
        (joint) at the first sample of the mode. The unit vector is the axis of the pair, or
        leads to its contact point. At this sample, the sign of each direction is chosen so
        that its scalar product with the sum is not negative.
    """

    def __init__(self) -> None:
        """Begin without any signs."""
        self.last: dict[tuple[int, ...], LastSample] = {}
        self.first_axis_sums: dict[int, Floats] = {}

    def state(self) -> dict[str, Any]:
        """Return the signs as plain lists for a JSON file, without loss of digits."""
        return {
            # "home" is the key of `first_axis_sums` in files of interrupted runs.
            "home": [
                [mode, axis_sum.tolist()] for mode, axis_sum in self.first_axis_sums.items()
            ],
            # A list for each key: its three numbers, then a list of eight numbers
            # (coordinate, sense, v and dv of `LastSample.path`), then the sign.
            "last": [[*key, *sample.numbers()] for key, sample in self.last.items()],
        }

    @classmethod
    def restored(cls, state: Mapping[str, Any]) -> "SignContinuation":
        """Return the object from the lists that `state` returns."""
        sign_continuation = cls()
        for mode, axis_sum in state["home"]:
            sign_continuation.first_axis_sums[mode] = np.array(axis_sum)
        for *key, numbers, sign in state["last"]:
            sign_continuation.last[tuple(key)] = LastSample.from_numbers(numbers, sign)
        return sign_continuation


def apply_continuous_signs(
    field: PoleField, motion: Motion, request: Request, sign_continuation: SignContinuation
) -> None:
    """Give directions, and coefficients along the directions, continuous signs, in place.

    The direction of a pole follows the angular velocity v of its second link relative to
    the first: their scalar product keeps its sign until v passes through zero.

    Parameters
    ----------
    field
        Poles at the n rows of the motion, whose directions have arbitrary signs.
    motion, request
        The configurations, and the request of the poles.
    sign_continuation
        Signs at the end of the previous block of rows, updated in place.
    """
    n = len(motion)
    # Some poles need no sign here: the axis of a pair has its sign already, and two links
    # of one body have no pole (None).
    settled_poles = {None, *axis_pairs(request.plan)}
    poles = [
        pole for pole in request.poles if request.plan.pole(*pole) not in settled_poles
    ]
    if not (poles and motion.assembly_modes and n):
        return
    # +1, or -1 where the input moves back. v is per unit rate of the input, so only its
    # product with the sense is continuous at dead centres of the input.
    sense = np.ones(n) if motion.sense is None else motion.sense
    # Arrays (poles, 3, n) of directions, of v, and of the derivative of v with respect
    # to the input.
    directions = np.array([field.direction[pole].T for pole in poles])
    v = np.array([(field.w[j] - field.w[i]).T for i, j in poles])
    dv = np.array([(field.dw[j] - field.dw[i]).T for i, j in poles])
    coefficients = np.array([field.velocity_coefficient[pole] for pole in poles])
    v_error = np.array([field.velocity_coefficient_error[pole] for pole in poles])
    dv_error = np.array([field.acceleration_coefficient_error[pole] for pole in poles])

    # The relative velocity v of links at rest is a rounding error. For such links the
    # direction itself, in place of v, is continued from row to row.
    is_at_rest = (norm_columns(v) <= v_error) & (norm_columns(dv) <= dv_error)
    along_v = np.where((coefficients * sense < 0.0) & ~is_at_rest, -1.0, 1.0)
    continued_v = np.where(is_at_rest[:, None], directions, sense * v)
    continued_dv = np.where(is_at_rest[:, None], 0.0, sense * dv)
    # Directions, velocities and derivatives, of shape (3, poles, n) each. Velocity
    # coefficients along these directions are not negative.
    paths = np.swapaxes([along_v[:, None] * directions, continued_v, continued_dv], 1, 2)

    # (modes, samples) whether a row has a configuration.
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
    """Return a function that gives pole directions a sign by comparison with fixed vectors.

    The direction of a pole (the axis about which two links turn relative to each other) is
    known up to its sign. In a single configuration, or over a grid of several inputs, there
    is no path along which a sign could be continued. Each assembly mode (way to assemble
    the links) therefore has a fixed vector. If the angle between this vector and a
    direction is obtuse, the sign is -1, otherwise 1.

    Parameters
    ----------
    axis_sums
        (modes, 3) a vector for each assembly mode, usually the sum of all pair axes in one
        configuration.
    """

    def find_signs(directions: Floats, rows: Any, modes: Any) -> Floats:
        """Return the signs (poles, k) of directions (3, poles, k) at k rows.

        Each direction is turned to the side of the axis sum of its mode.

        `modes` is the index of the assembly mode, one for all rows or (k,). `rows` is not
        used here, but every `SignFunction` has this argument.
        """
        x, y, z = np.atleast_2d(axis_sums[modes]).T
        is_opposite = x * directions[0] + y * directions[1] + z * directions[2] < 0.0
        return np.where(is_opposite, -1.0, 1.0)

    return find_signs


def signs_by_first_axis_sums(
    motion: Motion, has_configuration: Bools, sign_continuation: SignContinuation
) -> SignFunction:
    """Return a function that gives pole directions a sign by the first row of each mode.

    The direction of a pole (axis of the relative rotation of two links) is known up to its
    sign. This function is for motions whose rows (configurations) are no path along which
    a sign could be continued, such as a grid of several inputs.

    Each assembly mode (way to assemble the links) has one constant vector: the sum of all
    pair axes at its first row with a configuration. A direction gets the sign -1 if its
    angle to this vector is obtuse, and otherwise 1.

    Parameters
    ----------
    motion
        Rows of all assembly modes, mode after mode.
    has_configuration
        (modes, samples) whether a row has a configuration.
    sign_continuation
        The vectors of modes that occurred in earlier blocks of rows, which these modes
        keep. Vectors of new modes are added in place.
    """
    # A mode without any configuration has no directions, so its vector may stay zero.
    axis_sums = np.zeros((len(motion.assembly_modes), 3))
    for mode_index, is_valid in enumerate(has_configuration):
        if np.any(is_valid):
            mode = motion.assembly_modes[mode_index]
            first_valid_sample = int(np.argmax(is_valid))
            first_row = mode_index * motion.samples + first_valid_sample
            axis_sums[mode_index] = _first_axis_sum(
                motion, mode.number, first_row, sign_continuation
            )
    return signs_by_axis_sums(axis_sums)


def _first_axis_sum(
    motion: Motion, mode: int, first_row: int, sign_continuation: SignContinuation
) -> Floats:
    """Return the vector (3,) that decides the signs of directions at the start of a mode.

    A direction along a pole has an arbitrary sign, and is turned to the side of this
    vector. The vector is the sum of the axes and contact points of all pairs at the first
    row of the assembly mode. The first row may be in an earlier block, so the sum is
    stored.
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
        second links relative to the first, and the derivatives of v with respect to the
        input, each (3, poles, k). v and its derivatives contain the sense of the input. The
        scalar products of v and these directions are not negative. The signs apply to these
        directions.
    sign_continuation
        Signs at the end of the previous block, updated in place.
    """
    signs = np.ones((len(poles), len(motion)), dtype=np.int8)

    def look_up_signs(directions: Floats, rows: Any, modes: Any) -> Array:
        """Return the signs (poles, k) at k rows from those that were computed for all rows.

        `directions` and `modes` are not used here, but every `SignFunction` has these
        arguments.
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
        # dv is the derivative with respect to one input, not along the path of all inputs,
        # so dv is replaced by 0.
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
        axis_sum = _first_axis_sum(motion, mode_number, int(rows[0]), sign_continuation)
        # Number of gaps up to each row in which directions may reverse.
        open_gaps = np.append(0, np.cumsum(compared_rows.may_reverse))
        for pole_index, pole in enumerate(poles):
            key = (mode_number, *pole)
            pole_directions = directions[:, pole_index, columns]
            is_moving = has_motion[pole_index, columns]
            moving = np.flatnonzero(is_moving)
            if not len(moving):
                continue
            # At the start of a mode, the direction points to the side of the axis sum.
            start_sign = 1.0
            is_new = key not in sign_continuation.last
            if is_new and axis_sum @ pole_directions[:, moving[0]] < 0.0:
                start_sign = -1.0
            path = VelocityPath(
                coordinate[rows],
                sense,
                v[:, pole_index, columns],
                dv[:, pole_index, columns],
            ).selection(moving)
            may_reverse_between = open_gaps[moving[1:]] > open_gaps[moving[:-1]]
            moving_signs = _continue_along_path(
                sign_continuation, key, start_sign, path, may_reverse_between
            )
            resting = np.flatnonzero(has_direction[pole_index, columns] & ~is_moving)
            row_signs = _add_signs_at_rest(
                rows, pole_directions, moving, moving_signs, resting
            )
            # Rows between two compared rows have the sign of the first of these.
            row_counts = np.diff(rows, append=end_row)
            signs[pole_index, rows[0] : end_row] = np.repeat(row_signs, row_counts)
    return look_up_signs


def _add_signs_at_rest(
    rows: Indices,
    directions: Floats,
    moving: Indices,
    moving_signs: Floats,
    resting: Indices,
) -> Floats:
    """Return the signs (k,) of a pole direction at k rows, including rows at rest.

    A pole is the axis of the relative rotation of two links. The sign of its direction
    normally follows their relative angular velocity. Where the links rest, the direction
    may still be known. The sign of such a direction is chosen so that its angle with the
    direction at the nearest moving row is not obtuse.

    Parameters
    ----------
    rows
        (k,) indices of the rows, rising. They can have gaps.
    directions
        (3, k) directions without their signs.
    moving, moving_signs
        Positions (m,), from 0 to k - 1, of the rows in which the links move, and their
        signs (m,). m is at least 1.
    resting
        Positions of the rows that have a direction, but no velocity.
    """
    # For each of the k rows, the position in `moving` of the last moving row up to it. It
    # is -1 if there is none.
    last_moving = np.searchsorted(moving, np.arange(len(rows)), side="right") - 1
    # Each row first gets the sign of its last moving row, or 1 if there is none. Moving
    # rows get their own sign. Rows without a direction can have any sign.
    signs = np.where(last_moving >= 0, moving_signs[last_moving], 1.0)
    for k in resting:
        distances = np.abs(rows[moving] - rows[k])
        nearest = moving[np.argmin(distances)]
        nearest_direction = signs[nearest] * directions[:, nearest]
        is_opposite = nearest_direction @ directions[:, k] < 0.0
        signs[k] = -1.0 if is_opposite else 1.0
    return signs


def _continue_along_path(
    sign_continuation: SignContinuation,
    key: tuple[int, ...],
    start_sign: float,
    path: VelocityPath,
    may_reverse: Bools,
) -> Floats:
    """Return signs (k,) that make a pole direction continuous along a path of samples.

    A pole is the axis of the relative rotation of two links. Its computed direction points
    to the side of the relative angular velocity v. Where v passes through zero and
    reverses, the computed direction reverses too. From there on, the direction is
    multiplied by the opposite sign, so that it continues without a jump.

    Long motions are computed in blocks of samples. The first sign of a block follows in the
    same way from the last sample of the previous block.

    Parameters
    ----------
    sign_continuation
        Last samples of the previous block. The last sample of this pole is replaced.
    key
        Three numbers: the number of the assembly mode and the indices of the two links.
    start_sign
        The sign at the first sample, if there is no previous block.
    path
        The velocity v at k samples.
    may_reverse
        (k - 1,) whether v may reverse between a sample and the next one.
    """
    first_sign = start_sign
    # The last sample of the previous block, or None.
    last_sample = sign_continuation.last.get(key)
    if last_sample is not None:
        across_blocks = last_sample.path.followed_by(path.selection([0]))
        (sign_change,) = _sign_changes(across_blocks)
        first_sign = last_sample.sign * float(sign_change)

    sign_changes = np.ones(len(may_reverse))
    if np.any(may_reverse):
        sign_changes = np.where(may_reverse, _sign_changes(path), 1.0)
    # The sign of each sample is the sign of the previous sample, times the factor between
    # both: -1 if v reverses, otherwise 1.
    signs = np.cumprod(np.append(first_sign, sign_changes))
    sign_continuation.last[key] = LastSample(path.selection([-1]), float(signs[-1]))
    return signs


def _sign_changes(path: VelocityPath) -> Floats:
    """Return whether a velocity reverses between successive samples, as factors -1 and +1.

    The velocity v is the relative angular velocity of two links. If the scalar product of v
    at two samples is negative, v may have reversed by passing through zero, or turned by
    more than a right angle without becoming zero. To decide this, v is interpolated, and
    its reversals are counted. The caller multiplies the sign of a sample by the factor to
    get the sign of the next sample.

    Parameters
    ----------
    path
        The velocity at k samples.

    Returns
    -------
    (k - 1,) -1 between two samples if v reverses an odd number of times, otherwise +1.
    """
    sign_changes = np.ones(len(path.coordinate) - 1)
    # The gaps between two samples in which v can have reversed.
    gaps = np.flatnonzero(dot_columns(path.v[:, 1:], path.v[:, :-1]) < 0.0)
    if len(gaps):
        # (3, points, gaps) values of v at many points of each gap.
        v = _interpolate_in_gaps(path, gaps)
        # v reverses where its scalar product with the next value is negative. Between such
        # close points, v turns by more than 90 degrees only if it reverses.
        products = np.sum(v[:, 1:] * v[:, :-1], axis=0)
        reversal_counts = np.sum(products < 0.0, axis=0)
        sign_changes[gaps] = np.where(reversal_counts % 2 == 1, -1.0, 1.0)
    return sign_changes


def _interpolate_in_gaps(path: VelocityPath, gaps: Indices) -> Floats:
    """Interpolate a velocity v between samples by cubic Hermite polynomials.

    The caller counts with the interpolated values how often v reverses between two samples.

    The polynomials use v and the derivative of v with respect to the coordinate of the
    path. Between two samples with opposite senses of the input, the derivatives cannot be
    used, and v is interpolated by a straight line.

    Parameters
    ----------
    path
        The velocity at k samples.
    gaps
        (m,) indices of gaps. Gap g is between the samples g and g + 1.

    Returns
    -------
    (3, `HERMITE_SUBSTEPS` + 1, m) v at equally spaced positions in each gap, from the
    sample before the gap to the sample after it.
    """
    start = path.selection(gaps)
    stop = path.selection(gaps + 1)
    # With a length of zero, the derivatives have no effect, and v follows a straight line.
    has_same_sense = start.sense == stop.sense
    lengths = np.where(has_same_sense, stop.coordinate - start.coordinate, 0.0)
    fractions = np.linspace(0.0, 1.0, HERMITE_SUBSTEPS + 1)
    # The arrays have the axes component (3), position, gap (m). A derivative that is not
    # known (NaN) counts as zero.
    interpolated = cubic_hermite(
        start=(start.v[:, None], np.nan_to_num(start.dv)[:, None]),
        stop=(stop.v[:, None], np.nan_to_num(stop.dv)[:, None]),
        length=lengths,
        fraction=fractions[:, None],
    )
    # At both ends v is known exactly. If v is nearly zero there, rounding errors of the
    # interpolation could reverse it.
    interpolated[:, 0] = start.v
    interpolated[:, -1] = stop.v
    return interpolated
