"""Many poses of an output, or inputs, from numbers, a file, or a grid over a window."""

from collections.abc import Sequence
from math import prod
from pathlib import Path

import numpy as np

from spherekit.plugin import (
    AnalysisError,
    Floats,
    listing,
)
from spherekit.plugin.workspace import (
    OutputKinematics,
    columns_of,
    read_numbers,
)

from ..output_poses import (
    ANGLES,
    AZIMUTH_TILT,
    DIRECTION,
    MIRROR,
    POSED,
    QUATERNION,
    TILT_TORSION,
    VECTOR,
    WANTING,
    numbers_of,
)

MATRIX = tuple(f"r{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3))
NOT_ROTATION = 1e-6
"""A matrix whose R R^T differs from 1 by more is not a rotation."""
MOST_POSES = 500_000
"""Of one run, whose tables are in memory: with eight modes 2 GB."""
MOST_SHOWN = 5


Poses = tuple[Floats | None, Floats | None, tuple[int, ...] | None]
"""Directions (n, 3) or rotations (n, 3, 3), or else inputs (n, inputs) that are given; and
the grid of a window."""
Names = tuple[str, ...]


def read_poses(
    solver: OutputKinematics,
    where: str,
    poses: Sequence[str] = (),
    columns: Names = (),
    file: str = "",
    window: Sequence[str] = (),
    unit: str = "deg",
    called: str = "poses",
) -> Poses:
    """Return the poses of a list, `called` so, of `columns` of a file, or of a window.

    Raises
    ------
    AnalysisError, FileError
        If they cannot be read, with the place in the list or the line of the file.
    """
    sources = {called: poses, "file": file, "window": window}
    told = [name for name, source in sources.items() if source]
    if len(told) != 1:
        first = enumerate(_kinds(solver)[0], 1)
        example = "+".join(f"{name}={10 * k}" for k, name in first)
        raise AnalysisError(
            f"{where}: found {' and '.join(told) or 'no poses'}; give one of "
            f"poses={example}, file=NAME.csv and window=NAME:FROM:TO:COUNT+.."
        )
    if columns and not file:
        raise AnalysisError(
            f"{where}: columns: {listing(columns)} are those of a file; poses and "
            "window say the names themselves, such as poses=azimuth=10+tilt=20"
        )
    units = dict[str, str]()
    shape = None
    places: Sequence[str] = ()
    where = f"{where}: {file or told[0]}"
    try:
        if file:
            names, rows, units, places = _of_file(solver, where, Path(file), columns)
        elif window:
            names, rows, shape = _of_window(solver, where, window)
        else:
            names, rows = _of_text(solver, where, poses)
        _check_size(len(rows), where)
    except AnalysisError:
        if not solver.labels:
            solver.inverse(np.zeros((0, 3, 3)), ())  # says why there is none
        raise
    driven = names == solver.mechanism.input_pairs
    angular = [
        (driven or name in ANGLES) and (units.get(name) or unit) == "deg" for name in names
    ]
    rows = np.where(angular, np.radians(rows), rows)
    if driven:
        return None, rows, shape
    places = places or [f"number {k + 1}" for k in range(len(rows))]
    return _posed(solver, names, rows, places, where), None, shape


def _of_text(
    solver: OutputKinematics, where: str, poses: Sequence[str]
) -> tuple[Names, Floats]:
    given = numbers_of(poses, where)
    kind = _kind(_kinds(solver), tuple(given[0]), where)
    for number, row in enumerate(given, 1):
        if row.keys() != given[0].keys():
            raise AnalysisError(
                f"{where}: number {number} has {listing(row)}, but the first "
                f"{listing(given[0])}; say all poses in the same terms"
            )
    return kind, np.array([[row[name] for name in kind] for row in given])


def _of_file(
    solver: OutputKinematics, where: str, path: Path, wanted: Names
) -> tuple[Names, Floats, dict[str, str], Sequence[str]]:
    """Return names, rows, units, "" where none is said, and where each row is."""
    header = columns_of(path)
    kinds = _kinds(solver)
    prefixed = {f"q_{name}": name for name in kinds[-1]}
    columns = {prefixed.get(name, name): written for name, written in header.items()}
    missing = [name for name in wanted if name not in columns]
    if missing:
        raise AnalysisError(
            f"{where}: it has no column {listing(missing)}; columns: {listing(header)}"
        )
    if wanted:
        held = [_kind(kinds, wanted, where)]
    else:
        held = [kind for kind in kinds if set(kind) <= set(columns)]
        held = [k for k in held if not any(set(k) < set(other) for other in held)]
    if len(held) != 1:
        raise AnalysisError(
            f"{where}: its columns {listing(header)} hold {len(held)} of "
            f"{_ways(held or kinds)}; give one of them, as columns=.. if there are more"
        )
    (names,) = held
    numbers = read_numbers(path, [columns[name] for name in names])
    units = {name: numbers.units.get(columns[name], "") for name in names}
    return names, numbers.values, units, numbers.places


def _of_window(
    solver: OutputKinematics, where: str, window: Sequence[str]
) -> tuple[Names, Floats, tuple[int, ...]]:
    """Return names and rows of a grid, and its shape."""
    axes: dict[str, Floats] = {}
    for text in window:
        name, *numbers = text.split(":")
        try:
            low, high, count = map(float, numbers)
            good = count.is_integer() and count > 0.0 and np.isfinite(low + high)
        except ValueError:
            good = False
        if not good or name in axes:
            raise AnalysisError(
                f'{where}: "{text}" is not NAME:FROM:TO:COUNT, each name once; '
                "say for example azimuth:0:360:37"
            )
        axes[name] = np.linspace(low, high, int(count))
    names = _kind(_kinds(solver), tuple(axes), where)
    sides = [axes[name] for name in names]
    shape = tuple(map(len, sides))
    _check_size(prod(shape), where)
    mesh = np.meshgrid(*sides, indexing="ij")
    return names, np.stack([grid.ravel() for grid in mesh], axis=1), shape


def _posed(
    solver: OutputKinematics,
    names: Names,
    rows: Floats,
    places: Sequence[str],
    where: str,
) -> Floats:
    """Return the poses of rows (n, names), refusing those that are none."""
    why = f"has {WANTING}"
    if names == MATRIX:
        why = "is not a rotation matrix"
        made = rows.reshape(-1, 3, 3)
        gap = np.abs(made @ np.swapaxes(made, 1, 2) - np.eye(3)).max(axis=(1, 2))
        made[~((gap < NOT_ROTATION) & (np.linalg.det(made) > 0.0))] = np.nan
    else:
        made = POSED[names](rows)
    if names == MIRROR:
        assert solver.form is not None and solver.output.direction is not None
        why = "is not a mid-plane: phi and gamma are too large"
        made = solver.form.orientations(made) @ np.array(solver.output.direction)
    wrong = np.unique(np.nonzero(np.isnan(made))[0])
    if len(wrong):
        shown = listing((places[k] for k in wrong), MOST_SHOWN)
        raise AnalysisError(f"{where}: {shown} {why}")
    return made


def _check_size(count: int, where: str) -> None:
    if count > MOST_POSES:
        raise AnalysisError(
            f"{where}: {count} poses are more than {MOST_POSES}; take them in parts"
        )


def _kinds(solver: OutputKinematics) -> list[Names]:
    """Return what columns make a pose of this output, and the inputs last."""
    kinds: list[Names] = []
    if solver.labels and solver.points:
        kinds = [AZIMUTH_TILT, DIRECTION]
    elif solver.labels:
        kinds = [TILT_TORSION, QUATERNION, VECTOR, MATRIX]
    if solver.form is not None:
        kinds.append(MIRROR)
    return [*kinds, solver.mechanism.input_pairs]


def _kind(kinds: Sequence[Names], names: Names, where: str) -> Names:
    """Return the kind with these names, whose order is then that of the kind."""
    for kind in kinds:
        if sorted(kind) == sorted(names):
            return kind
    raise AnalysisError(
        f"{where}: {listing(names)} is not a pose; say one of {_ways(kinds)}"
    )


def _ways(kinds: Sequence[Names]) -> str:
    return listing("+".join(kind) for kind in kinds)
