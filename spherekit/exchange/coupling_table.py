"""Tables for controllers: what inputs do to everything else, read between nodes."""

from dataclasses import dataclass, fields
from itertools import combinations_with_replacement, product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from spherekit.argument_validation import checked
from spherekit.arrays import Bools, Floats, Integers
from spherekit.conventions import AnyPath, Names
from spherekit.dynamics.reduced_model_archive import read_archive, write_archive
from spherekit.errors import FileError, SolveError
from spherekit.storage.atomic_write import write_text
from spherekit.tables.table_files import make_frame
from spherekit.wording import counted, listing

KIND = ("spherekit coupling table", 1, "write one with `--to coupling`")

WORDS = (
    "mechanism",
    "mechanism_sha256",
    "made_by",
    "inputs",
    "variables",
    "poles",
    "modes",
    "tolerance",
    "coefficient_error",
)
"""What the heading of an archive says; the rest are arrays of their names."""


class Coupled(NamedTuple):
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
    inputs: Names
    variables: Names
    poles: Names
    modes: tuple[int, ...]
    tolerance: float
    start: Floats
    step: Floats
    count: Integers
    periodic: Bools
    rise: Floats
    angles: Floats
    coefficients: Floats
    derivatives: Floats
    turning: Floats
    turning_derivatives: Floats
    error: Floats
    sure: Bools
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
        places = np.indices(tuple(self.count)).reshape(len(self.count), -1)
        return self.start + self.step * places.T

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
        last, slack = self.count - 1, 1e-9
        along = (q - self.start) / self.step
        turns = np.where(self.periodic, np.floor(along / last), 0.0)
        along -= turns * last
        with np.errstate(invalid="ignore"):
            good = np.all((along >= -slack) & (along <= last + slack), axis=1)
        filled = np.nan_to_num(along)
        cells = np.clip(np.floor(filled).astype(np.int64), 0, last - 1)
        good &= self.sure[number, np.ravel_multi_index(tuple(cells.T), tuple(last))]
        coupled = self.blended(number, cells, filled - cells)
        coupled.angles[:] += turns @ self.rise[number]
        for part in coupled:
            part[~good] = np.nan
        return coupled

    def blended(self, mode: int, cells: Integers, at: Floats) -> Coupled:
        """Return what the mode of a number is at places from 0 to 1 in cells (n, m)."""
        parts: list[Any] = [0.0] * 4
        for corner in product((0, 1), repeat=len(self.inputs)):
            weight = np.prod(np.where(corner, at, 1.0 - at), axis=1)
            d = (at - corner) * self.step
            places = tuple((cells + corner).T)
            node = mode, np.ravel_multi_index(places, tuple(self.count))
            g, H = self.coefficients[node], self.derivatives[node]
            bent = np.einsum("nkij,nj->nki", H, d)
            turned = np.einsum("npijx,nj->npix", self.turning_derivatives[node], d)
            for k, part in enumerate(
                (
                    self.angles[node] + np.einsum("nki,ni->nk", 2 / 3 * g + bent / 6, d),
                    g + 0.5 * bent,
                    H,
                    self.turning[node] + 0.5 * turned,
                )
            ):
                parts[k] = parts[k] + weight.reshape(-1, *(1,) * (part.ndim - 1)) * part
        return Coupled(*parts)


def write_npz(table: CouplingTable, path: AnyPath) -> None:
    """Write a table as a NumPy archive (.npz) that `load_coupling` reads.

    Raises
    ------
    OutputError
        If it cannot be written.
    """
    given = {item.name: getattr(table, item.name) for item in fields(table)}
    write_archive(path, KIND, {name: given.pop(name) for name in WORDS}, given)


@checked(FileError)
def load_coupling(path: AnyPath) -> CouplingTable:
    """Return a table that was written as a NumPy archive.

    Raises
    ------
    FileError
        If it cannot be read, or is no such table.
    """

    def made(heading: dict[str, Any], arrays: dict[str, Any]) -> CouplingTable:
        return CouplingTable(**{name: heading[name] for name in WORDS}, **arrays)

    return read_archive(path, KIND, made)


def columns(table: CouplingTable) -> dict[str, Floats]:
    """Return the columns (modes nodes,) of a table, mode after mode, by their names.

    ``theta_41`` is in rad, ``theta_41_by_21`` its coefficient, ``theta_41_by_21_by_51`` in
    1/rad the derivative of that by the second input; ``w_6_1_x_by_12`` a component of the
    angular velocity of link 6 relative to link 1. `cell_error` (rad) is measured in the
    cell that starts at the node.
    """
    modes, nodes = len(table.modes), len(table.nodes)
    inputs = list(enumerate(table.inputs))
    arrays: dict[str, Floats] = {"assembly_mode": np.repeat(table.modes, nodes)}
    arrays |= {f"q_{name}": np.tile(table.nodes[:, k], modes) for k, name in inputs}
    for v, name in enumerate(table.variables):
        arrays[name] = table.angles[:, :, v]
        for i, one in inputs:
            arrays[f"{name}_by_{one}"] = table.coefficients[:, :, v, i]
        for (i, one), (j, other) in combinations_with_replacement(inputs, 2):
            arrays[f"{name}_by_{one}_by_{other}"] = table.derivatives[:, :, v, i, j]
    for p, pole in enumerate(table.poles):
        stem = f"w_{pole.replace('/', '_')}"
        for (i, one), (x, axis) in product(inputs, enumerate("xyz")):
            arrays[f"{stem}_{axis}_by_{one}"] = table.turning[:, :, p, i, x]
    cells = table.error.reshape(modes, *(table.count - 1))
    wider = [(0, 0), *[(0, 1)] * len(table.count)]
    arrays["cell_error"] = np.pad(cells, wider, constant_values=np.nan)
    return {name: values.ravel() for name, values in arrays.items()}


def write_csv(table: CouplingTable, path: AnyPath) -> None:
    """Write a table as CSV, see `columns`; places without a mode are empty.

    Raises
    ------
    OutputError
        If it cannot be written.
    """
    write_text(
        path, make_frame(columns(table), {}).to_csv(index=False, lineterminator="\n")
    )
