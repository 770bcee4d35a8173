"""Coupling tables as NumPy archives, CSV, and C headers."""

import os
from dataclasses import fields
from typing import Any

import numpy as np

from spherekit.checked import checked
from spherekit.dynamics.model_metadata import DAMAGED, Archive
from spherekit.errors import FileError
from spherekit.exchange.coupling import CouplingTable
from spherekit.exchange.coupling_made import cells_of
from spherekit.files.atomic import write_text
from spherekit.sphere.rotation import Floats

ARCHIVE = Archive("spherekit coupling table", 1, "write one with `--to coupling`")

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


def write_npz(table: CouplingTable, path: str | os.PathLike[str]) -> None:
    """Write a table as a NumPy archive (.npz) that `load_coupling` reads.

    Raises
    ------
    OutputError
        If it cannot be written.
    """
    given = {item.name: getattr(table, item.name) for item in fields(table)}
    heading = {name: given.pop(name) for name in WORDS}
    ARCHIVE.write(path, heading, given)


@checked(FileError)
def load_coupling(path: str | os.PathLike[str]) -> CouplingTable:
    """Return a table that was written as a NumPy archive.

    Raises
    ------
    FileError
        If it cannot be read, or is no such table.
    """
    heading, arrays = ARCHIVE.read(path)
    try:
        whole: dict[str, Any] = {name: heading[name] for name in WORDS} | arrays
        return CouplingTable(**whole)
    except DAMAGED as error:
        raise ARCHIVE.damaged(repr(str(path)), error) from None


def columns(table: CouplingTable) -> dict[str, Floats]:
    """Return the columns (modes nodes,) of a table, mode after mode, by their names.

    ``theta_41`` is in rad, ``theta_41_by_21`` its coefficient, ``theta_41_by_21_by_51`` in
    1/rad the derivative of that by the second input; ``w_6_1_x_by_12`` a component of the
    angular velocity of link 6 relative to link 1. `cell_error` (rad) is measured in the
    cell that starts at the node.
    """
    modes, nodes = len(table.modes), len(table.nodes)
    arrays: dict[str, Floats] = {"assembly_mode": np.repeat(table.modes, nodes)}
    for k, name in enumerate(table.inputs):
        arrays[f"q_{name}"] = np.tile(table.nodes[:, k], modes)

    def put(name: str, values: Floats) -> None:
        arrays[name] = values.reshape(modes * nodes)

    for v, name in enumerate(table.variables):
        put(name, table.angles[:, :, v])
        for i, one in enumerate(table.inputs):
            put(f"{name}_by_{one}", table.coefficients[:, :, v, i])
        for i, one in enumerate(table.inputs):
            for j, other in list(enumerate(table.inputs))[i:]:
                put(f"{name}_by_{one}_by_{other}", table.derivatives[:, :, v, i, j])
    for p, pole in enumerate(table.poles):
        stem = f"w_{pole.replace('/', '_')}"
        for i, one in enumerate(table.inputs):
            for x, axis in enumerate("xyz"):
                put(f"{stem}_{axis}_by_{one}", table.turning[:, :, p, i, x])
    cells = cells_of(table)
    padded = np.concatenate([table.error, np.full((modes, 1), np.nan)], axis=1)
    put("cell_error", padded[:, cells])
    return arrays


def write_csv(table: CouplingTable, path: str | os.PathLike[str]) -> None:
    """Write a table as CSV, see `columns`; places without a mode are empty.

    Raises
    ------
    OutputError
        If it cannot be written.
    """
    made = columns(table)
    lines = [",".join(made)]
    for row in zip(*(column.tolist() for column in made.values()), strict=True):
        lines.append(",".join("" if x != x else repr(x) for x in row))
    write_text(path, "\n".join([*lines, ""]))
