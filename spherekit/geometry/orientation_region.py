"""The volume of the orientations where given margins are not negative.

Unit quaternions up to sign are four cubes: where the component of number c is the
largest, q is (x, y, z) with a 1 put in at c, divided by its length, and x, y, z lie in
[-1, 1]. The measure that turning does not change is 8 / (1 + x^2 + y^2 + z^2)^2 dx dy dz;
all orientations have 8 pi^2 of it, as with Euler angles and sin(b) da db dc.
"""

from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Array, Bools, Floats, Indices
from spherekit.geometry.region_margins import (
    VALUE_SLACK,
    Evaluator,
    Margins,
    check_positive,
    least,
)
from spherekit.geometry.rotation import max_abs, unit_rows
from spherekit.numerics.chebyshev import tensor
from spherekit.progress import ProgressReporter

ALL_ORIENTATIONS = 8.0 * np.pi**2
"""Volume of all orientations."""
BITS = 18
"""Cubes are 2**BITS units wide."""
SIDES = 3 * (2**BITS + 1,)
"""Places along each side of a cube."""
COARSEST = 3
"""Halvings of the cubes before the first look."""
STEPS = 6
"""Steps of the grid on which a cell's polynomials are summed."""
COST_OF_CUT = 120
"""Evaluations that halving a cell three ways costs, about."""


def _cube(axis: Array) -> Array:
    """Return the points (n**3, 3) of a cubic grid, the last coordinate fastest."""
    return tensor(3 * [axis])


_THREE, _TWO = _cube(np.arange(3)), _cube(np.arange(2))
_CHECKS = np.array([[1, 1, 1], [1, 3, 3], [3, 1, 3], [3, 3, 1]])
"""Places of four checks in a cell, in quarters of it."""
_SAMPLED = np.concatenate([2 * _THREE, _CHECKS])


@dataclass(frozen=True)
class Orientations:
    """Orientations where all margins are at least 0.

    Attributes
    ----------
    volume, error
        Volume, that of all orientations being 8 pi^2, and a bound of its error: what the
        last halving of each cell changed.
    place, depth
        The quaternion xyzw (4,) with the largest smallest margin seen, and that margin.
    evaluations, calls
        Orientations at which the margins were evaluated, and calls that took.
    """

    volume: float
    error: float
    place: Floats
    depth: float
    evaluations: int
    calls: int

    @property
    def fraction(self) -> float:
        """The part of all orientations."""
        return self.volume / ALL_ORIENTATIONS


def _at(places: Floats) -> Floats:
    """Return what turns the 27 values of a cell into those at places (m, 3), (m, 27)."""
    u = places.T
    rows = np.stack([(1 - u) * (1 - 2 * u), 4 * u * (1 - u), u * (2 * u - 1)], axis=2)
    return np.einsum("ma,mb,mc->mabc", *rows).reshape(-1, 27)


_LINE = np.array([[1.0, 0.0, 0.0], [-0.5, 2.0, -0.5], [0.0, 0.0, 1.0]])
_BOUNDS = np.kron(_LINE, np.kron(_LINE, _LINE))
"""What turns 27 values into the coefficients that bound their polynomial."""
_CENTRES = (_cube(np.arange(STEPS)) + 0.5) / STEPS
_CHANGES = [_at(_CENTRES + h) - _at(_CENTRES - h) for h in 0.5 / STEPS * np.eye(3)]
"""Of the polynomial over a step in each direction, there exactly its slope."""
_MEANS = np.mean([_at(_CENTRES + h / STEPS) for h in (_TWO - 0.5) / 3**0.5], axis=0)
"""Of the polynomial over steps, by Gauss's rule."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)
_GAUSS_PLACES = _cube(0.5 * (1.0 + _NODES))
_GAUSS_WEIGHTS = np.prod(_cube(0.5 * _WEIGHTS), axis=1)
"""The places (64, 3) and weights (64,) of Gauss's rule in a cell."""


def find_orientations(
    margins: Margins, tolerance: float = 1e-3, most: int = 1_000_000
) -> Orientations:
    """Return the volume of the orientations where all margins are at least 0.

    Parameters
    ----------
    margins
        Values (n, k) at unit quaternions (n, 4) xyzw, the same for q and -q. NaN says that
        an orientation cannot be reached, unless another margin is negative there.
    tolerance
        Error to aim at, relative to the volume.
    most
        Evaluations after which the work ends.

    Raises
    ------
    RegionError
        A size is not positive, or the margins do not return a row for each orientation.

    Notes
    -----
    Cells in which a margin may change its sign are halved in all three directions. In
    them every margin is a polynomial of degree 2 in each coordinate.
    """
    check_positive({"tolerance": tolerance, "most": most})
    evaluate = Evaluator(margins)
    cells = _Cells(evaluate)
    working = ProgressReporter("measuring a set of orientations")
    while True:
        volume = float(cells.volume.sum())
        error = float(cells.error.sum())
        goal = tolerance * volume
        told = f"volume {volume:.4g} +- {error:.2g}, to be known to {goal:.2g}"
        working.tell(told.__str__)
        if error <= goal:
            break
        wide = cells.error > 0.5 * goal / np.count_nonzero(cells.error)
        cut = np.flatnonzero(wide & (cells.cells[:, 4] > 4))
        cost = COST_OF_CUT * len(cut)
        if not cost or evaluate.evaluations + cost > most:
            break
        cells.halve(cut)
    return Orientations(
        volume, error, cells.place, cells.depth, evaluate.evaluations, evaluate.calls
    )


class _Cells:
    """Cells of the cubes, their volumes and how well these are known.

    A row of `cells` (n, 5) is the number of the cube, the lowest corner, and the width.
    """

    def __init__(self, evaluate: Evaluator) -> None:
        self.evaluate = evaluate
        self.place = np.array([0.0, 0.0, 0.0, 1.0])
        self.depth = -np.inf
        corners = _cube(np.arange(2**COARSEST))
        width = 2 ** (BITS - COARSEST)
        number = np.arange(4 * len(corners))
        self.cells = np.column_stack(
            [number // len(corners), np.tile(corners * width, (4, 1)), width + 0 * number]
        )
        self.volume, certain = self._measure(self.cells)
        self.error = np.where(certain, 0.0, _density(self.cells).sum(axis=1))

    def halve(self, cut: Indices) -> None:
        """Replace some cells by their eighths."""
        cells = np.repeat(self.cells[cut], 8, axis=0)
        cells[:, 4] //= 2
        cells[:, 1:4] += np.tile(_TWO, (len(cut), 1)) * cells[:, 4:]
        volume, certain = self._measure(cells)
        change = np.abs(volume.reshape(-1, 8).sum(axis=1) - self.volume[cut])
        vague = ~certain.reshape(-1, 8)
        share = change / np.maximum(np.count_nonzero(vague, axis=1), 1)
        made = {
            "cells": cells,
            "volume": volume,
            "error": np.where(vague, share[:, None], 0.0).ravel(),
        }
        for name, eighths in made.items():
            kept = np.delete(getattr(self, name), cut, axis=0)
            setattr(self, name, np.concatenate([kept, eighths]))

    def _measure(self, cells: Indices) -> tuple[Floats, Bools]:
        """Return the volumes (n,) of the region in cells, and whether they are certain."""
        rows, checks = self._sample(cells)
        k = rows.shape[2]
        error = max_abs(np.tensordot(_at(_CHECKS / 4.0), rows, axes=1) - checks, axis=0)
        control = np.tensordot(_BOUNDS, rows, axes=1)
        slack = VALUE_SLACK * error
        out = (control.max(axis=0) + slack < 0.0).any(axis=1)
        certain = out | (control.min(axis=0) >= slack).all(axis=1)
        share = _density(cells) * ~out[:, None]
        some = np.flatnonzero(~certain)
        for part in np.array_split(some, len(some) * k // 2**13 + 1):
            filled = _filled(rows[:, part].reshape(27, -1))
            share[part] *= filled.reshape(STEPS**3, len(part), k).min(axis=2).T
        return share.sum(axis=1), certain

    def _sample(self, cells: Indices) -> tuple[Floats, Floats]:
        """Return margins at the 27 places (27, n, k) and the checks (4, n, k) of cells.

        A margin that is NaN is -1 where no other is negative, else the largest in the
        cell, as it bounds nothing there.
        """
        whole = cells[:, 1:4] + _SAMPLED[:, None] * (cells[:, 4:] // 4)
        cubes = np.broadcast_to(cells[:, 0], whole.shape[:2])
        key = np.ravel_multi_index((cubes, *np.moveaxis(whole, 2, 0)), (4, *SIDES))
        _, first, back = np.unique(key, return_index=True, return_inverse=True)
        quaternions = _quaternions(cubes.ravel()[first], whole.reshape(-1, 3)[first])
        margins = self.evaluate(quaternions)
        smallest = least(margins)
        best = int(np.argmax(smallest))
        if smallest[best] > self.depth:
            self.place = quaternions[best]
            self.depth = float(smallest[best])
        rows = margins[back].reshape(*cubes.shape, -1)
        missing = np.isnan(rows)
        negative = np.any(rows < 0.0, axis=2, keepdims=True)
        highest = np.nan_to_num(np.fmax.reduce(rows, axis=0), nan=1.0)
        rows = np.where(missing, np.where(negative, highest, -1.0), rows)
        return rows[:27], rows[27:]


def _filled(model: Floats) -> Floats:
    """Return how full (STEPS**3, m) the steps of cells are, by polynomials (27, m).

    Across the border this rises evenly over the width of the step, which is exact for
    planes on the average; what bending does to that average is taken away.
    """
    value = _at(_CENTRES) @ model
    changes = np.abs(_CHANGES @ model)
    reach = changes.sum(axis=0)
    square = np.sum(changes**2, axis=0)
    with np.errstate(all="ignore"):
        bent = value / reach + (_MEANS @ model - value) * reach / square
        return np.where(square > 0.0, np.clip(0.5 + bent, 0.0, 1.0), value >= 0.0)


def _quaternions(cube: Indices, units: Array) -> Floats:
    """Return the unit quaternions (n, 4) xyzw at places (n, 3) of cubes (n,)."""
    out = np.ones((len(cube), 4))
    out[np.arange(4) != cube[:, None]] = units.ravel() * 2.0 ** (1 - BITS) - 1.0
    return unit_rows(out)


def _density(cells: Indices) -> Floats:
    """Return the volumes (n, STEPS**3) of the steps of cells' grids.

    They are those by their middles, scaled so that their sum is that by Gauss's rule.
    """
    scaled = cells[:, None] * 2.0 ** (1 - BITS)
    width = scaled[..., 4:]

    def density(places: Floats) -> Floats:
        x = scaled[..., 1:4] - 1.0 + places * width
        return 8.0 / (1.0 + np.vecdot(x, x)) ** 2

    by_middles = density(_CENTRES)
    whole = density(_GAUSS_PLACES) @ _GAUSS_WEIGHTS * width[:, 0, 0] ** 3
    return by_middles * (whole / by_middles.sum(axis=1))[:, None]
