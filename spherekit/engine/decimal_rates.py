"""Rates in quad precision of a mechanism with the decimal sizes of its file.

Beside a dead centre, at a distance d in angles, rates are off by the rounding of the
geometry over d squared, relatively. Where that leaves nothing of the float64 geometry, the
numbers of the file still determine them: 64.02 degrees is one number, and 33 digits are
enough for d down to 1e-11. The velocity equations J r = 0 of all loops and their derivative
are solved for the rates r of all variables and for dr.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from spherekit.arrays import Array, Bools, Floats, Indices
from spherekit.conventions import EPS, Status
from spherekit.engine.columns import BOUNDS
from spherekit.motion.assembly_modes import AssemblyMode
from spherekit.motion.loops import left_inverse
from spherekit.motion.motion import Motion
from spherekit.motion.quad_positions import QuadAssembly, dot, rotated
from spherekit.planning.poles import Pole

PLACED_RAD = 1e-30
"""What links of a body are off by in quad precision: some thousand roundings."""
LARGEST_SENSITIVITY = 1e12
"""Rates are not computed where variables move by more as loops open by one unit."""


@dataclass(frozen=True)
class DecimalRates:
    """Rates of n rows while one input moves at unit rate, and bounds of their errors.

    Attributes
    ----------
    is_known
        (n,) where the configuration and the rates are known; numbers elsewhere are not.
    axes
        (n, pairs, 3) axes of the pairs in ground axes, in quad precision like all below.
    rates, changes
        (n, pairs) rates of the pair variables and their derivatives by the input.
    w, dw
        (n, links, 3) angular velocities of links and their derivatives, in ground axes.
    axis_error, w_error, dw_error
        (n,) bounds of the errors of axes, of w and of dw, of any pair or link.
    ends
        First and second link of each pair.
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
    def of(motion: Motion, driven: int) -> "DecimalRates | None":
        """Return the rates of all rows of a motion while the input of a number moves.

        None if the mechanism has contacts or redundant equations, or if no assembly modes
        say which solutions are meant.
        """
        quad_assembly = QuadAssembly(motion.mechanism, motion.assembly)
        modes = {mode.number: mode for mode in motion.assembly_modes}
        numbers = set(motion.assembly_mode.tolist())
        if not quad_assembly.is_supported or not numbers <= modes.keys():
            return None
        n, tree = len(motion), motion.linearisation.tree
        values: Array | None = None
        is_known = np.zeros(n, dtype=bool)
        for mode, rows in _rows_of_modes(motion, [modes[k] for k in sorted(numbers)]):
            placed = quad_assembly.place(
                mode.signs, mode.determinants, motion.inputs[rows], motion.values[rows]
            )
            if values is None:
                values = np.zeros((n, tree.count, 3, 3)).astype(placed.rotations.dtype)
            values[rows] = placed.rotations
            is_known[rows] = placed.status == Status.OK
        assert values is not None
        axes = np.stack(
            [
                rotated(values[:, first], quad_assembly.frames[pair][0][:, 2])
                for pair, (first, _) in enumerate(tree.ends)
            ],
            axis=1,
        )
        return _solved(motion, driven, is_known, axes)

    @property
    def loss(self) -> Floats:
        """(n,) the part of the largest rate or derivative, or of 1, that may be wrong."""
        size, swing = (
            np.maximum(1.0, np.max(np.sqrt(dot(x, x)).astype(float), axis=1))
            for x in (self.w, self.dw)
        )
        return np.maximum(self.w_error / size, self.dw_error / swing)

    def pole(self, pole: Pole, pair: int | None) -> tuple[dict[str, Floats], Floats]:
        """Return the numbers of a pole and bounds of their errors.

        Parameters
        ----------
        pole
            The numbers of two links.
        pair
            The number of the pair along whose axis the pole lies, None where it lies along
            the relative angular velocity.

        Returns
        -------
        numbers
            (k, n) the parts that change their sign with the direction, and ``angle``, by
            name.
        errors
            (4, n) bounds, in the order of `BOUNDS`.
        """
        i, j = pole
        v, dv = self.w[:, j] - self.w[:, i], self.dw[:, j] - self.dw[:, i]
        speed = np.sqrt(dot(v, v))
        sizes = [np.sqrt(dot(w, w)) for w in (self.w[:, i], self.w[:, j])]
        angle = speed / (sizes[0] + sizes[1])
        if pair is None:
            unit, rate = v / speed[:, None], speed
            turned = (dv - dot(dv, unit)[:, None] * unit) / speed[:, None]
        else:
            unit = self.axes[:, pair]
            rate = dot(v, unit)
            turned = np.cross(self.w[:, self.ends[pair][0]], unit)
            angle = np.ones_like(angle)
        numbers: Mapping[str, Any] = {
            "direction": unit.T,
            "direction_dq": turned.T,
            "velocity_coefficient": rate[None],
            "acceleration_coefficient": dot(dv, unit)[None],
            "angle": angle[None],
        }
        floats = {name: number.astype(float) for name, number in numbers.items()}
        return floats, self._errors(floats, speed.astype(float), dv, pair is not None)

    def _errors(
        self, numbers: Mapping[str, Floats], speed: Floats, dv: Array, is_pair_axis: bool
    ) -> Floats:
        """Return bounds (4, n), each with the rounding of the number to float64."""
        swing = np.sqrt(dot(dv, dv)).astype(float)
        v_error, dv_error = 2.0 * self.w_error, 2.0 * self.dw_error
        direction = self.axis_error
        turned = self.w_error + self.axis_error * self._fastest
        if not is_pair_axis:
            direction = v_error / speed
            turned = (dv_error + 2.0 * direction * swing) / speed
        change = dv_error + direction * swing
        if not is_pair_axis:
            direction = np.where(speed <= v_error, np.inf, direction)
        bounds = {
            "direction": direction,
            "velocity_coefficient": v_error,
            "acceleration_coefficient": change,
            "direction_dq": turned,
        }
        rounding = {
            name: 2.0 * EPS * np.sqrt(np.sum(numbers[name] ** 2, axis=0)) for name in bounds
        }
        errors = {f"{name}_error": bounds[name] + rounding[name] for name in bounds}
        errors["error"] = errors.pop("direction_error")
        return np.array([errors[name] for name in BOUNDS])

    @property
    def _fastest(self) -> Floats:
        return np.max(np.sqrt(dot(self.w, self.w)).astype(float), axis=1)


def _rows_of_modes(
    motion: Motion, modes: Sequence[AssemblyMode]
) -> Iterator[tuple[AssemblyMode, Indices]]:
    """Yield assembly modes, or the pieces of those that have any, with their rows."""
    for mode in modes:
        rows = np.flatnonzero(motion.assembly_mode == mode.number)
        if not mode.pieces:
            yield mode, rows
            continue
        owners = mode.pieces_at(motion.inputs[rows, 0])
        for number in np.unique(owners):
            yield mode.pieces[number][1], rows[owners == number]


def _solved(motion: Motion, driven: int, is_known: Bools, axes: Array) -> DecimalRates:
    """Return the rates by the axes (n, pairs, 3) of all pairs, in quad precision."""
    tree, free = motion.linearisation.tree, list(motion.free)
    (moved,) = motion.mechanism.variables_of(driven)
    signs, paths = tree.signs.astype(axes.dtype), tree.paths.astype(axes.dtype)
    firsts = tree.firsts
    n, count = axes.shape[:2]

    def around_loops(vectors: Array) -> Array:
        """Return sums (n, 3 loops) of vectors (n, pairs, 3) of the pairs of each loop."""
        return np.sum(signs[:, :, None] * vectors[:, None], axis=2).reshape(n, -1)

    def of_links(vectors: Array) -> Array:
        """Return sums (n, links, 3) of vectors of the pairs on the way to each link."""
        return np.sum(paths[:, :, None] * vectors[:, None], axis=2)

    equations = (signs[:, None, :] * np.swapaxes(axes, 1, 2)[:, None]).reshape(n, -1, count)
    passive = equations[:, :, free]
    rates = np.zeros((n, count)).astype(axes.dtype)
    rates[:, moved] = 1
    rates[:, free] = _linear_solution(passive, -equations[:, :, moved])
    w = of_links(rates[:, :, None] * axes)
    turned = rates[:, :, None] * np.cross(w[:, firsts], axes)
    changes = np.zeros_like(rates)
    changes[:, free] = _linear_solution(passive, -around_loops(turned))
    dw = of_links(changes[:, :, None] * axes + turned)

    # Norms alone: 33 digits leave room. Each of `count` axes on a way may be off.
    sensitivity = np.linalg.norm(left_inverse(passive.astype(float)), axis=(1, 2))
    is_known = is_known & (sensitivity < LARGEST_SENSITIVITY)
    fast, bent = (np.max(np.abs(x.astype(float)), axis=1) for x in (rates, changes))
    axis_error = 2.0 * count**2 * sensitivity * PLACED_RAD + PLACED_RAD
    rate_error = 2.0 * count * sensitivity * fast * axis_error
    turn_error = count * (rate_error + fast * axis_error)
    bias_error = count * (count * fast * rate_error + fast * turn_error)
    change_error = 2.0 * sensitivity * (count * bent * axis_error + bias_error)
    return DecimalRates(
        is_known=is_known,
        axes=axes,
        rates=rates,
        changes=changes,
        w=w,
        dw=dw,
        axis_error=axis_error,
        w_error=count * (rate_error + fast * axis_error),
        dw_error=count * (change_error + bent * axis_error) + bias_error,
        ends=tree.ends,
    )


def _linear_solution(matrices: Array, right: Array) -> Array:
    """Return x (n, m) with matrices (n, m, m) x = right (n, m), by elimination.

    Pivots are the largest entries of columns.
    """
    n, m = right.shape
    whole = np.concatenate([matrices, right[:, :, None]], axis=2)
    rows = np.arange(n)
    for k in range(m):
        best = k + np.argmax(np.abs(whole[:, k:, k]).astype(float), axis=1)
        pivot_rows = whole[rows, best].copy()
        whole[rows, best] = whole[:, k]
        whole[:, k] = pivot_rows / pivot_rows[:, k][:, None]
        factors = whole[:, :, k].copy()
        factors[:, k] = 0
        whole -= factors[:, :, None] * whole[:, k][:, None]
    return whole[:, :, -1]
