"""Making a coupling table: computed on a grid, measured between its nodes."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from spherekit.argument_validation import checked
from spherekit.arrays import Floats
from spherekit.conventions import TURN
from spherekit.dynamics.coordinates import motion_by_variables
from spherekit.dynamics.reduced_model_samples import pole_name
from spherekit.errors import SolveError
from spherekit.exchange.coupling_table import CouplingTable
from spherekit.files.mechanism_reader import AnyMechanism, mechanism_of
from spherekit.files.mechanism_writer import mechanism_hash
from spherekit.geometry.vectors import all_finite, max_abs, nans
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import driven_at
from spherekit.planning.pole_plan import Pole, parse_pole
from spherekit.positions.angle_unwrapping import unwrap_motion
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.progress import ProgressReporter
from spherekit.version import __version__
from spherekit.wording import listing

FIRST_NODES = (61, 13, 5)
"""Nodes along each of one, two, and more inputs that are tried first."""

PARTS, BETWEEN = 3, 1.3
"""Errors are measured at the thirds of cells, and count by the second factor: remainders
like x^2 (1 - x)^2 of angles and x (1/2 - x) (1 - x) of coefficients are so much larger in
between."""

MOST_NODES = 25_000
"""Places at which modes are computed at most, unless more nodes are asked for."""

ENOUGH = 0.98
"""Part of the cells with a mode in all corners that are to be sure."""

SAME = 1e-9
"""What returns after a turn returns to this (rad)."""


@checked(SolveError)
def coupling_table(
    mechanism: AnyMechanism,
    *,
    input_pair: str | Sequence[str] | None = None,
    assembly_mode: int | None = None,
    pairs: Sequence[str] | None = None,
    poles: Iterable[str] = (),
    samples: int | Sequence[int] | None = None,
    tolerance: float = 1e-6,
) -> CouplingTable:
    """Return passive variables and coefficients on a grid of the inputs, for controllers.

    Parameters
    ----------
    mechanism
        The mechanism, the name of a shipped one, or the path of a file.
    input_pair
        The driven pairs, by default the inputs of the mechanism.
    assembly_mode
        The only mode wanted; by default all.
    pairs
        The passive pairs wanted; by default all.
    poles
        Poles such as ``"4/1"`` whose angular velocities are wanted too.
    samples
        Nodes along each input, or one number for all; by default as many as make 98 % of
        the cells sure, as far as 25 000 places in all suffice.
    tolerance
        Error of angles (rad) up to which a cell is sure.

    Raises
    ------
    SolveError, PlanError, ModelError
        If there is no such mode, pair or pole, or no cell is sure.

    Examples
    --------
    >>> import spherekit as sk
    >>> table = sk.coupling_table("four_bar", assembly_mode=0, pairs=["41"])
    >>> here = table.at(0.7)
    >>> here.angles.shape, here.coefficients.shape
    ((1, 1), (1, 1, 1))
    """
    mechanism = driven_at(mechanism_of(mechanism), input_pair)
    if not 0.0 < tolerance < 1.0:
        raise SolveError(f"coupling_table: tolerance is {tolerance} rad, needs 0 to 1")
    wanted = tuple(parse_pole(mechanism, text) for text in poles)
    chosen, counts = _passive(mechanism, pairs), _counts(mechanism, samples)
    working = ProgressReporter("filling the table")
    while True:
        working.tell("x".join(map(str, counts)).__str__)
        table = _table(mechanism, assembly_mode, chosen, wanted, counts, tolerance)
        finer = tuple(2 * count - 1 for count in counts)
        refined = np.prod([PARTS * (count - 1) + 1 for count in finer])
        enough = np.sum(table.sure) >= ENOUGH * np.sum(np.isfinite(table.error))
        if samples is not None or enough or refined > MOST_NODES:
            break
        counts = finer
    _need_sure(table)
    return table


def _need_sure(table: CouplingTable) -> None:
    """Raise `SolveError` where no cell is sure."""
    if not np.any(table.sure):
        errors = table.error[np.isfinite(table.error)]
        best = f"the best is to {np.min(errors):.2g}" if len(errors) else "no mode is there"
        raise SolveError(
            f"{table.mechanism}: no cell of {'x'.join(map(str, table.count))} nodes is "
            f"sure to {table.tolerance:g} rad, {best}: ask for more samples, a larger "
            "tolerance, or narrower ranges"
        )


def _counts(mechanism: Mechanism, samples: int | Sequence[int] | None) -> tuple[int, ...]:
    m = len(mechanism.inputs)
    if samples is None:
        return (FIRST_NODES[min(m, 3) - 1],) * m
    counts = tuple(samples) if isinstance(samples, Sequence) else (samples,) * m
    if len(counts) != m or min(counts) < 2:
        raise SolveError(
            f"{mechanism.name}: samples: {'x'.join(map(str, counts))}; needs a number of "
            f"at least 2 for each input ({listing(mechanism.input_pairs)})"
        )
    return counts


def _passive(mechanism: Mechanism, pairs: Sequence[str] | None) -> list[int]:
    """Return the numbers of the passive variables that are wanted."""
    driven = mechanism.input_pairs
    passive = [pair.name for pair in mechanism.pairs if pair.name not in driven]
    named = passive if pairs is None else [*dict.fromkeys(pairs)]
    for name in named:
        if mechanism.pair(name).name in driven:
            raise SolveError(
                f"{mechanism.name}: pairs: {name} is an input; passive are "
                f"{listing(passive)}"
            )
    if not named:
        raise SolveError(
            f"{mechanism.name}: a coupling table has the variables of passive pairs, and "
            "all pairs are inputs, or none was named"
        )
    return [
        v for name in named for v in mechanism.variables_of(mechanism.pair_number[name])
    ]


def _table(
    mechanism: Mechanism,
    assembly_mode: int | None,
    columns: list[int],
    poles: tuple[Pole, ...],
    counts: tuple[int, ...],
    tolerance: float,
) -> CouplingTable:
    """Return the table of a grid, with errors from one of a third of its steps."""
    fine = tuple(PARTS * (count - 1) + 1 for count in counts)
    tracer = PositionAnalysis(mechanism, None, assembly_mode, samples=fine)
    motion = unwrap_motion(tracer.motion(), tracer.angle_unwrapping)
    good = np.flatnonzero(~motion.failed)
    parts = motion_by_variables(
        tracer.solver.closure, motion.values[good], tracer.solver.driven
    )
    modes = [mode.number for mode in tracer.assembly_modes]

    def spread(values: Floats) -> Floats:
        whole = nans((len(motion), *values.shape[1:]))
        whole[good] = values
        return whole.reshape(len(modes), motion.samples, *values.shape[1:])

    first = spread(np.swapaxes(parts.rates[:, :, columns], 1, 2))
    second = spread(np.moveaxis(parts.second[:, :, :, columns], 3, 1))
    low, high = ([pole[end] for pole in poles] for end in (0, 1))
    usable = all_finite(first, (2, 3)) & all_finite(second, (2, 3, 4))
    exact: dict[str, Any] = {
        "angles": np.where(usable[..., None], spread(parts.values[:, columns]), np.nan),
        "coefficients": first,
        "derivatives": second,
        "turning": spread(np.moveaxis(parts.w[:, :, high] - parts.w[:, :, low], 2, 1)),
        "turning_derivatives": spread(
            np.moveaxis(parts.dw[:, :, :, high] - parts.dw[:, :, :, low], 3, 1)
        ),
    }
    periods = np.array([p for joint in motion.joints for p in joint.periods])
    q = tracer.input_grid.q
    even = np.ravel_multi_index(tuple(PARTS * np.indices(counts)), fine).ravel()
    cells = len(modes), math.prod(n - 1 for n in counts)
    table = CouplingTable(
        mechanism=mechanism.name,
        mechanism_sha256=mechanism_hash(mechanism),
        made_by=__version__,
        inputs=tracer.inputs,
        variables=tuple(mechanism.variable_names[v] for v in columns),
        poles=tuple(pole_name(mechanism, pole) for pole in poles),
        modes=tuple(modes),
        tolerance=tolerance,
        start=q[0],
        step=(q[-1] - q[0]) / np.subtract(counts, 1),
        count=np.array(counts),
        periodic=np.zeros(len(counts), dtype=bool),
        rise=np.zeros((len(modes), len(counts), len(columns))),
        **{name: values[:, even] for name, values in exact.items()},
        error=np.zeros(cells),
        sure=np.ones(cells, dtype=bool),
        coefficient_error=0.0,
    )
    _find_periods(table, periods[columns])
    return replace(table, coefficient_error=_measured(table, exact, fine))


def _measured(
    table: CouplingTable, exact: Mapping[str, Floats], fine: tuple[int, ...]
) -> float:
    """Say in a table what errors its cells have; return the largest of a coefficient.

    `exact` has a mode in each row, and a grid of a third of the step.
    """
    every = np.indices(tuple(table.count - 1)).reshape(len(fine), -1).T
    slope = np.zeros_like(table.error)
    for place in product(range(PARTS + 1), repeat=len(fine)):
        part = np.array(place) / PARTS
        if not np.any(part % 1.0):
            continue
        node = np.ravel_multi_index(tuple((PARTS * every + place).T), fine)
        for number in range(len(table.modes)):
            blended = table.blended(number, every, np.broadcast_to(part, every.shape))
            for name in ("angles", "coefficients", "turning"):
                off = np.abs(getattr(blended, name) - exact[name][number, node])
                most = (table.error if name == "angles" else slope)[number]
                largest = np.max(off.reshape(len(node), -1), axis=1, initial=0.0)
                np.maximum(most, largest, out=most)
    table.error[:] *= BETWEEN
    with np.errstate(invalid="ignore"):
        table.sure[:] = table.error <= table.tolerance
    return float(np.max(BETWEEN * slope[table.sure], initial=0.0))


def _find_periods(table: CouplingTable, periods: Floats) -> None:
    """Say in a table after a turn of which inputs all returns."""
    shape = (len(table.modes), *table.count)
    for axis, lap in enumerate(table.step * (table.count - 1)):
        if abs(lap - TURN) > SAME:
            continue
        grown, change = (
            np.diff(np.take(whole.reshape(*shape, -1), [0, -1], 1 + axis), axis=1 + axis)
            for whole in (table.angles, table.coefficients)
        )
        grown = grown.reshape(len(table.modes), -1, len(periods))
        with np.errstate(invalid="ignore"):
            turns = np.nan_to_num(np.round(grown[:, 0] / periods) * periods)
        if max_abs(grown - turns[:, None]) < SAME and max_abs(change) < SAME:
            table.periodic[axis], table.rise[:, axis] = True, turns
