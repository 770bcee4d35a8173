"""Every configuration of a mechanism at given inputs, as poses of its output."""

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import Output
from spherekit.motion.assemblies import assemblies
from spherekit.motion.assembly_modes import Solver
from spherekit.output.wheel_turns import as_assembled
from spherekit.sphere.rotation import Floats, transpose


@final
@dataclass(frozen=True)
class PoseSolutions:
    """Every configuration found at some poses or inputs, a row for each.

    `row` (k,) is the number of the pose or of the inputs given; `inputs` (k, inputs) rad;
    `values` (k, variables) rad of all pairs of the mechanism; `rotations` (k, 3, 3) the
    orientations of the output link seen from its other link, `directions` (k, 3) what it
    points at, None if it declares no direction; `signs` those of the dyads, 0 for
    irreducible groups, in solving order; `complete` (rows,) whether no solution can be
    missing.
    """

    row: NDArray[np.intp]
    inputs: Floats
    values: Floats
    rotations: Floats
    directions: Floats | None
    signs: tuple[tuple[int, ...], ...]
    complete: NDArray[np.bool_]


def pose_of(mechanism: Mechanism, output: Output, rotations: Floats) -> Floats:
    """Return the orientations (n, 3, 3) of an output from those of all links."""
    base = mechanism.link_number[output.relative_to]
    link = mechanism.link_number[output.link]
    return transpose(rotations[:, base]) @ rotations[:, link]


def solved(
    solver: Solver, output: Output, inputs: Floats, released: Solver | None = None
) -> PoseSolutions:
    """Return every configuration of a mechanism at inputs (n, inputs), row by row.

    Where `solver` holds the output, `released` is that of the mechanism itself, whose
    variables come first; those and its inputs are told. Inputs are in (-pi, pi] unless
    wheels count their turns.
    """
    told = solver if released is None else released
    driven, count = list(told.driven), len(told.mechanism.variable_owners)
    row, values, signs = [], [], []
    complete = np.ones(len(inputs), dtype=bool)
    for number, q in enumerate(inputs):
        if not np.all(np.isfinite(q)):
            continue
        here = assemblies(solver, q)
        complete[number] = all(m is None or m.is_complete for m in here.methods)
        for mode, closed in here.modes:
            configuration = (
                closed if released is None else as_assembled(solver, released, closed)
            )
            if configuration is None:
                continue
            row.append(number)
            values.append(configuration)
            signs.append(mode)
    every = np.array(values).reshape(-1, len(solver.mechanism.variable_owners))
    turned = pose_of(solver.mechanism, output, solver.closure.at(every).placed)
    return PoseSolutions(
        np.array(row, dtype=np.intp),
        told.reduced(every[:, driven]),
        every[:, :count],
        turned,
        None if output.direction is None else turned @ np.array(output.direction),
        tuple(signs),
        complete,
    )
