"""Computes rates near dead centres in quad precision, from the decimal sizes in the file.

At a distance d (rad, in the pair variables) from a dead centre, the relative error of rates
is the rounding error of the geometry divided by d squared. With float64 sizes, no digit of
the rates can then be correct. The decimal numbers of the file still determine them: 64.02
degrees is an exact number. Computations with 33 digits are sufficient down to d = 1e-11.

One input moves at unit rate. The velocity equations J r = 0 of all loops are solved for the
rates r of all variables. Their derivative with respect to the input, J dr = -dJ r, is
solved for dr.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from spherekit.arrays import Array, Bools, Floats, Indices
from spherekit.geometry.vectors import dot
from spherekit.planning.pole_plan import Pole
from spherekit.positions.assembly_mode import AssemblyMode
from spherekit.positions.linear_equations import left_inverse
from spherekit.positions.motion import Motion
from spherekit.positions.quad_positions import QuadAssembly
from spherekit.positions.quad_rotations import matrix_vector_products
from spherekit.status import Status
from spherekit.tolerances import EPS, MAX_RATE_SENSITIVITY

PLACEMENT_ERROR_RAD = 1e-30
"""Error bound of the orientation of a link in quad precision: some thousand rounding
errors."""


@dataclass(frozen=True)
class DecimalRates:
    """Rates of n rows while one input moves at unit rate, and bounds of their errors.

    The rates are computed from the decimal sizes of the file, for rows that are too near to
    a dead centre for sizes rounded to float64. Rates are per unit rate of the input
    (rad/rad), and vectors are in ground axes. Derivatives are with respect to the input.
    Rates and axes are in quad precision, bounds in float64.

    Attributes
    ----------
    is_known
        (n,) whether the configuration and the rates of a row were computed. The other
        arrays are meaningless in rows where this is False.
    axes
        (n, pairs, 3) unit axes of the pairs.
    rates
        (n, pairs) rates of the pair variables.
    changes
        (n, pairs) derivatives of these rates.
    w
        (n, links, 3) angular velocities of the links.
    dw
        (n, links, 3) derivatives of these angular velocities.
    axis_error, w_error, dw_error
        (n,) bounds of the errors of `axes`, of `w` and of `dw`, for any pair or link.
    ends
        First and second link of each pair, by their numbers.
    """

    is_known: Bools
    axes: Array
    rates: Array
    changes: Array
    w: Array
    dw: Array
    axis_error: Floats
    w_error: Floats
    dw_error: Floats
    ends: Sequence[tuple[int, int]]

    @staticmethod
    def from_motion(motion: Motion, driven: int) -> "DecimalRates | None":
        """Compute the rates of all rows of a motion in quad precision (33 digits).

        Near a dead centre, rounding the sizes to float64 can change every digit of the
        rates. The decimal numbers of the file are therefore used with 33 digits, for the
        configurations and for the rates.

        Parameters
        ----------
        motion
            n rows, each one configuration: inputs, pair variables in float64, and the
            assembly mode (way to assemble the links).
        driven
            Index of the input pair that moves at unit rate. Other inputs are locked.

        Returns
        -------
        The rates. None if the mechanism has contacts or redundant equations, or if a row
        has an assembly mode that `motion.assembly_modes` does not list.
        """
        quad_assembly = QuadAssembly(motion.mechanism, motion.assembly)
        modes = {mode.number: mode for mode in motion.assembly_modes}
        numbers = set(motion.assembly_mode.tolist())
        if not quad_assembly.is_supported or not numbers <= modes.keys():
            return None
        n = len(motion)
        # The tree of links and pairs, and the loops that they form.
        tree = motion.linearisation.tree
        # (n, links, 3, 3) rotations from link axes to ground axes, in quad precision.
        rotations: Array | None = None
        is_known = np.zeros(n, dtype=bool)
        for mode, rows in _rows_of_modes(motion, [modes[k] for k in sorted(numbers)]):
            # The signs of the assembly mode choose one solution for each group of links.
            placed = quad_assembly.place(
                mode.signs, mode.group_signs, motion.inputs[rows], motion.values[rows]
            )
            # The number type (quad precision) is known from the first result.
            if rotations is None:
                rotations = np.zeros((n, tree.count, 3, 3)).astype(placed.rotations.dtype)
            rotations[rows] = placed.rotations
            is_known[rows] = placed.status == Status.OK
        assert rotations is not None
        # The axis of a pair is the last column of its frame in its first link.
        axes_of_pairs: list[Array] = []
        for pair, (first_link, _) in enumerate(tree.ends):
            first_frame, _ = quad_assembly.frames[pair]
            axes_of_pairs.append(
                matrix_vector_products(rotations[:, first_link], first_frame[:, 2])
            )
        axes = np.stack(axes_of_pairs, axis=1)
        return _solve_rates(motion, driven, is_known, axes)

    @property
    def relative_error_bound(self) -> Floats:
        """(n,) the larger of the relative error bounds of `w` and `dw`.

        `w` are the angular velocities of links and `dw` their derivatives with respect
        to the input, at n rows.

        Each bound is relative to the largest vector of any link, or to 1 if 1 is
        larger.
        """
        rate_size, derivative_size = (
            np.maximum(1.0, np.max(np.sqrt(dot(x, x)).astype(float), axis=1))
            for x in (self.w, self.dw)
        )
        return np.maximum(self.w_error / rate_size, self.dw_error / derivative_size)

    def pole(
        self, pole: Pole, pair: int | None
    ) -> tuple[dict[str, Floats], dict[str, Floats]]:
        """Return the quantities of a pole, and bounds of their errors.

        One input moves at unit rate. All velocities are per unit rate of this input, so v
        is the angular velocity of the second link relative to the first in rad/rad, and dv
        its derivative with respect to the input. With the direction u of the pole, the
        velocity coefficient is v . u, and the acceleration coefficient is dv . u.

        Parameters
        ----------
        pole
            Indices of the first and the second link.
        pair
            Index of the pair whose axis is the pole. None if the pole has the direction
            of v.

        Returns
        -------
        numbers
            Arrays (k, n) in float64: "direction" and its derivative with respect to the
            input, "direction_dq", with k = 3; "velocity_coefficient",
            "acceleration_coefficient" and "conditioning" with k = 1. The conditioning is
            |v| divided by the sum of the angular speeds of both links, and 1 for a pair
            axis.
        errors
            (n,) error bounds by their names in `PoleField`.
        """
        i, j = pole
        v = self.w[:, j] - self.w[:, i]
        dv = self.dw[:, j] - self.dw[:, i]
        speed = np.sqrt(dot(v, v))
        if pair is None:
            first_speed = np.sqrt(dot(self.w[:, i], self.w[:, i]))
            second_speed = np.sqrt(dot(self.w[:, j], self.w[:, j]))
            conditioning = speed / (first_speed + second_speed)
            u = v / speed[:, None]
            velocity_coefficient = speed
            # The derivative of the unit vector v / |v|.
            direction_change = (dv - dot(dv, u)[:, None] * u) / speed[:, None]
        else:
            u = self.axes[:, pair]
            velocity_coefficient = dot(v, u)
            # The axis is fixed in both links of the pair, so its derivative follows from
            # the angular velocity of either link.
            first_link, _ = self.ends[pair]
            direction_change = np.cross(self.w[:, first_link], u)
            conditioning = np.ones_like(speed)
        numbers: Mapping[str, Any] = {
            "direction": u.T,
            "direction_dq": direction_change.T,
            "velocity_coefficient": velocity_coefficient[None],
            "acceleration_coefficient": dot(dv, u)[None],
            "conditioning": conditioning[None],
        }
        floats = {name: number.astype(float) for name, number in numbers.items()}
        return floats, self._errors(
            numbers=floats,
            speed=speed.astype(float),
            dv=dv,
            is_pair_axis=pair is not None,
        )

    def _errors(
        self, numbers: Mapping[str, Floats], speed: Floats, dv: Array, is_pair_axis: bool
    ) -> dict[str, Floats]:
        """Return the error bounds of the quantities of a pole.

        The pole of two links has the direction u: the axis of a pair, or the direction of
        v, the angular velocity of the second link relative to the first. The velocity
        coefficient is v . u, the acceleration coefficient dv . u. The errors of all angular
        velocities of links are at most `w_error`, those of their derivatives `dw_error`,
        and those of pair axes `axis_error`. The rounding of each quantity to float64 is
        included.

        Parameters
        ----------
        numbers
            The quantities as arrays (k, n), k = 3 for vectors and 1 for numbers, by their
            names.
        speed
            (n,) size of the relative angular velocity v.
        dv
            (n, 3) its derivative.
        is_pair_axis
            Whether the direction is the axis of a pair, and not the direction of v.

        Returns
        -------
        (n,) bounds by their names in `PoleField`. The bound of the direction is infinite if
        v may be zero within its error.
        """
        dv_size = np.sqrt(dot(dv, dv)).astype(float)
        # v and dv are differences of the vectors of two links.
        v_error = 2.0 * self.w_error
        dv_error = 2.0 * self.dw_error
        # Bounds of the errors of u, and of du, its derivative with respect to the input.
        if is_pair_axis:
            # du = w x u with the angular velocity w of a link of the pair. The error of
            # du is the error of w, plus the error of u times |w|, which is at most the
            # largest speed of any link.
            direction_error = self.axis_error
            change_error = self.w_error + self.axis_error * self._largest_speed
            direction_bound = direction_error
        else:
            # u = v / |v|, and du = (dv - (dv . u) u) / |v|. Three errors contribute to du:
            # the error of dv, and two that are multiplied by |dv|. The two are the error of
            # u and the relative error of |v|, each at most `direction_error`.
            direction_error = v_error / speed
            change_error = (dv_error + 2.0 * direction_error * dv_size) / speed
            # If v may be zero within its error, any direction is possible, so the bound is
            # infinite.
            direction_bound = np.where(speed <= v_error, np.inf, direction_error)
        bounds = {
            "direction": direction_bound,
            "velocity_coefficient": v_error,
            # The coefficient is dv . u: the error of dv, and that of u times |dv|.
            "acceleration_coefficient": dv_error + direction_error * dv_size,
            "direction_dq": change_error,
        }
        # The rounding of the numbers to float64: twice the rounding error of the size.
        rounding = {
            name: 2.0 * EPS * np.sqrt(np.sum(numbers[name] ** 2, axis=0)) for name in bounds
        }
        return {f"{name}_error": bounds[name] + rounding[name] for name in bounds}

    @property
    def _largest_speed(self) -> Floats:
        """(n,) the largest angular speed of any link."""
        return np.max(np.sqrt(dot(self.w, self.w)).astype(float), axis=1)


def _rows_of_modes(
    motion: Motion, modes: Sequence[AssemblyMode]
) -> Iterator[tuple[AssemblyMode, Indices]]:
    """Yield each assembly mode with the indices of its rows (k,) in a motion.

    A mode is a way to assemble the links. Its signs select one solution for each group of
    links, and the caller places the links by these signs. Where two modes meet, a mode may
    follow the smooth curve of configurations, and its signs change there. A mode whose
    signs change is composed of `pieces`: ranges of the input, each with a mode of constant
    signs. Instead of a composed mode, the modes of its pieces are yielded. Each has the
    rows whose input is in its range.
    """
    for mode in modes:
        rows = np.flatnonzero(motion.assembly_mode == mode.number)
        if not mode.pieces:
            yield mode, rows
            continue
        # The index of the piece of each row.
        piece_numbers = mode.pieces_at(motion.inputs[rows, 0])
        for number in np.unique(piece_numbers):
            _, piece_mode = mode.pieces[number]
            yield piece_mode, rows[piece_numbers == number]


def _solve_rates(motion: Motion, driven: int, is_known: Bools, axes: Array) -> DecimalRates:
    """Solve the velocity equations and their derivative, and bound the errors.

    The velocity equations J r = 0 of all loops give the rates r of all pairs while one
    input has the rate 1. Their derivative with respect to this input, J dr = -dJ r, gives
    dr.

    Parameters
    ----------
    motion
        The motion with the n rows. Its loops, paths and passive variables (which no input
        sets) are used.
    driven
        Index of the input pair that moves at unit rate.
    is_known
        (n,) whether the configuration of a row is known. Rows whose velocity equations are
        nearly singular (`MAX_RATE_SENSITIVITY`) become unknown in the result.
    axes
        (n, pairs, 3) unit axes of all pairs in ground axes, in quad precision.
    """
    tree = motion.linearisation.tree
    passive_variables = list(motion.passive_variables)
    (driven_variable,) = motion.mechanism.variables_of(driven)
    # The sense, 1 or -1, in which each loop and the path to each link passes each pair; 0
    # if it does not.
    signs = tree.signs.astype(axes.dtype)
    paths = tree.paths.astype(axes.dtype)
    n, count = axes.shape[:2]

    def sum_around_loops(vectors: Array) -> Array:
        """Return the sum around each loop (n, 3 loops) of vectors (n, pairs, 3)."""
        return np.sum(signs[:, :, None] * vectors[:, None], axis=2).reshape(n, -1)

    def sum_along_paths(vectors: Array) -> Array:
        """Return sums (n, links, 3) of vectors (n, pairs, 3) on the path to each link."""
        return np.sum(paths[:, :, None] * vectors[:, None], axis=2)

    # J (n, 3 loops, pairs). Its columns are the axes, with the sense in which a loop passes
    # them.
    equations = (signs[:, None, :] * np.swapaxes(axes, 1, 2)[:, None]).reshape(n, -1, count)
    passive_equations = equations[:, :, passive_variables]
    rates = np.zeros((n, count)).astype(axes.dtype)
    rates[:, driven_variable] = 1
    rates[:, passive_variables] = _solve_linear_systems(
        passive_equations, -equations[:, :, driven_variable]
    )
    # An axis a is fixed in the first link of its pair, so its derivative is w x a.
    w = sum_along_paths(rates[:, :, None] * axes)
    direction_change = rates[:, :, None] * np.cross(w[:, tree.first_bodies], axes)
    changes = np.zeros_like(rates)
    changes[:, passive_variables] = _solve_linear_systems(
        passive_equations, -sum_around_loops(direction_change)
    )
    dw = sum_along_paths(changes[:, :, None] * axes + direction_change)

    # The bounds use norms. A loop or path has at most `count` pairs, and each axis may have
    # an error. The bounds are much too large, but still small with 33 digits.
    inverse = left_inverse(passive_equations.astype(float))
    sensitivity = np.linalg.norm(inverse, axis=(1, 2))
    is_known = is_known & (sensitivity < MAX_RATE_SENSITIVITY)
    largest_rate = np.max(np.abs(rates.astype(float)), axis=1)
    largest_change = np.max(np.abs(changes.astype(float)), axis=1)
    axis_error = 2.0 * count**2 * sensitivity * PLACEMENT_ERROR_RAD + PLACEMENT_ERROR_RAD
    rate_error = 2.0 * count * sensitivity * largest_rate * axis_error
    w_error = count * (rate_error + largest_rate * axis_error)
    # Errors of r w x a, summed over all pairs, with the rate r and the axis a of a pair.
    largest_speed = count * largest_rate  # a bound of |w|
    bias_error = count * (
        largest_speed * rate_error + largest_rate * (w_error + largest_speed * axis_error)
    )
    change_error = 2.0 * sensitivity * (count * largest_change * axis_error + bias_error)
    return DecimalRates(
        is_known=is_known,
        axes=axes,
        rates=rates,
        changes=changes,
        w=w,
        dw=dw,
        axis_error=axis_error,
        w_error=w_error,
        dw_error=count * (change_error + largest_change * axis_error) + bias_error,
        ends=tree.ends,
    )


def _solve_linear_systems(matrices: Array, right_sides: Array) -> Array:
    """Return the solutions x (n, m) of n systems matrices (n, m, m) x = right_sides.

    numpy.linalg has no quad precision. The method is Gauss-Jordan elimination with partial
    pivoting, for all n systems at once. The solution of an exactly singular system is not
    finite.
    """
    n, m = right_sides.shape
    # (n, m, m + 1) the matrices with their right-hand sides as a last column.
    augmented = np.concatenate([matrices, right_sides[:, :, None]], axis=2)
    systems = np.arange(n)
    for k in range(m):
        # In each system the row with the largest entry in column k is exchanged with row k
        # and divided by this entry. Multiples of row k are subtracted from all other rows,
        # so that column k becomes zero there.
        pivot = k + np.argmax(np.abs(augmented[:, k:, k]).astype(float), axis=1)
        pivot_rows = augmented[systems, pivot].copy()
        augmented[systems, pivot] = augmented[:, k]
        augmented[:, k] = pivot_rows / pivot_rows[:, k][:, None]
        factors = augmented[:, :, k].copy()
        factors[:, k] = 0
        augmented -= factors[:, :, None] * augmented[:, k][:, None]
    return augmented[:, :, -1]
