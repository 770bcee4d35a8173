"""Tables for controllers: what inputs do to everything else, read between nodes."""

from dataclasses import dataclass
from itertools import product
from typing import final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spherekit.conventions import counted, listing
from spherekit.errors import SolveError
from spherekit.sphere.rotation import Floats


@final
@dataclass(frozen=True)
class Coupled:
    """What a table says at inputs (n, m): NaN where it is not sure.

    `angles` (n, K) the passive variables, rad; `coefficients` (n, K, m) their rates per
    unit rate of each input; `derivatives` (n, K, m, m) of the coefficients by each input,
    1/rad. `turning` (n, P, m, 3): the angular velocity of the first link of a pole
    relative to the second, in ground axes, per unit rate of each input.
    """

    angles: Floats
    coefficients: Floats
    derivatives: Floats
    turning: Floats


@final
@dataclass(frozen=True)
class CouplingTable:
    """Passive variables and coefficients of some assembly modes on a grid of the inputs.

    `start`, `step`, `count` (m,): the nodes of each input; `periodic` (m,) says that its
    range is a turn after which all returns, and `rise` (modes, m, K) by how much variables
    have grown then. `angles` (modes, nodes, K), `coefficients` (modes, nodes, K, m),
    `derivatives` (modes, nodes, K, m, m), `turning` (modes, nodes, P, m, 3) and
    `turning_derivatives` (modes, nodes, P, m, m, 3), nodes in rows with the last input
    running fastest. `error` (modes, cells): the largest error of an angle (rad) that was
    measured in a cell; `sure` (modes, cells) where it is within
    `tolerance`, so that no cell spans a jump or a change of mode. `coefficient_error` is
    the largest measured in these.
    """

    mechanism: str
    mechanism_sha256: str
    made_by: str
    inputs: tuple[str, ...]
    variables: tuple[str, ...]
    poles: tuple[str, ...]
    modes: tuple[int, ...]
    tolerance: float
    start: Floats
    step: Floats
    count: NDArray[np.int64]
    periodic: NDArray[np.bool_]
    rise: Floats
    angles: Floats
    coefficients: Floats
    derivatives: Floats
    turning: Floats
    turning_derivatives: Floats
    error: Floats
    sure: NDArray[np.bool_]
    coefficient_error: float

    def __repr__(self) -> str:
        return (
            f"<CouplingTable of {self.mechanism}: {'x'.join(map(str, self.count))} nodes, "
            f"assembly modes {listing(self.modes)}, "
            f"{counted(len(self.variables), 'variable')} by {listing(self.inputs)}>"
        )

    @property
    def angle_error(self) -> float:
        """The largest error of an angle (rad) in cells that are sure."""
        return float(np.max(self.error[self.sure], initial=0.0))

    @property
    def nodes(self) -> Floats:
        """(nodes, m) rad, the inputs at the nodes."""
        axes = [
            first + step * np.arange(count)
            for first, step, count in zip(self.start, self.step, self.count, strict=True)
        ]
        return np.stack(
            [grid.ravel() for grid in np.meshgrid(*axes, indexing="ij")], axis=1
        )

    def at(self, q: ArrayLike, assembly_mode: int | None = None) -> Coupled:
        """Return what the table says at inputs (m,) or (n, m) rad.

        Parameters
        ----------
        assembly_mode
            Its number, by default the first in the table.

        Raises
        ------
        SolveError
            If the mode is not in the table.

        Notes
        -----
        With multilinear weights W of the corners of a cell, d the way from each, g and H
        the gradient and Hessian there, an angle is the sum of
        W (f + 2/3 g d + 1/6 d H d), which is exact for cubics, and a coefficient that of
        W (g + 1/2 H d), exact for quadratics (Guessab, Nouisser and Schmeisser, J. Comput.
        Appl. Math. 196, 2006, 162-179). Both go on without a jump from cell to cell.
        """
        mode = self.modes[0] if assembly_mode is None else assembly_mode
        if mode not in self.modes:
            raise SolveError(
                f"{self.mechanism}: assembly mode {mode} is not in the table, which has "
                f"{listing(self.modes)}"
            )
        number = self.modes.index(mode)
        q = np.asarray(q, dtype=float).reshape(-1, len(self.inputs))
        cells, at, turns, inside = self._cells(q)
        coupled = self._blended(number, cells, at)
        grown = turns @ self.rise[number]
        good = inside & self.sure[number, self._number(cells, self.count - 1)]
        coupled = Coupled(
            coupled.angles + grown,
            coupled.coefficients,
            coupled.derivatives,
            coupled.turning,
        )
        for part in (
            coupled.angles,
            coupled.coefficients,
            coupled.derivatives,
            coupled.turning,
        ):
            part[~good] = np.nan
        return coupled

    def _cells(
        self, q: Floats
    ) -> tuple[NDArray[np.int64], Floats, Floats, NDArray[np.bool_]]:
        """Return cells (n, m), places in them from 0 to 1, turns, and which are inside."""
        lap = self.step * (self.count - 1)
        along = (q - self.start) / self.step
        turns = np.where(self.periodic, np.floor((q - self.start) / lap), 0.0)
        along = along - turns * (self.count - 1)
        slack = 1e-9
        with np.errstate(invalid="ignore"):
            inside = np.all((along >= -slack) & (along <= self.count - 1 + slack), axis=1)
        filled = np.nan_to_num(along)
        cells = np.clip(np.floor(filled).astype(np.int64), 0, self.count - 2)
        return cells, filled - cells, turns, inside

    @staticmethod
    def _number(places: NDArray[np.int64], count: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the numbers (n,) of places (n, m) in a grid of so many."""
        number = np.zeros(len(places), dtype=np.int64)
        for axis, size in enumerate(count):
            number = number * size + places[:, axis]
        return number

    def _blended(self, mode: int, cells: NDArray[np.int64], at: Floats) -> Coupled:
        parts: list[Floats] = []
        for corner in product((0, 1), repeat=len(self.inputs)):
            weight = np.prod(np.where(np.array(corner) == 1, at, 1.0 - at), axis=1)
            d = (at - corner) * self.step
            node = self._number(cells + np.array(corner), self.count)
            f, g = self.angles[mode, node], self.coefficients[mode, node]
            H, w = self.derivatives[mode, node], self.turning[mode, node]
            dw = self.turning_derivatives[mode, node]
            bent = np.einsum("nkij,nj->nki", H, d)
            expansion = [
                f + np.einsum("nki,ni->nk", 2.0 / 3.0 * g + bent / 6.0, d),
                g + 0.5 * bent,
                H,
                w + 0.5 * np.einsum("npijx,nj->npix", dw, d),
            ]
            for k, part in enumerate(expansion):
                shaped = weight.reshape(-1, *(1,) * (part.ndim - 1)) * part
                if len(parts) > k:
                    parts[k] = parts[k] + shaped
                else:
                    parts.append(shaped)
        return Coupled(*parts)
