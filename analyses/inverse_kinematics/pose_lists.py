"""Many poses of an output, or inputs, from numbers, a file, or a grid over a window."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import prod
from pathlib import Path

import numpy as np

from spherekit.plugin import (
    AnalysisError,
    Floats,
    listing,
)
from spherekit.plugin.quantities import ANGLE, AngleUnit, QuantityError, read_quantity
from spherekit.plugin.workspace import (
    OutputKinematics,
    columns_of,
    read_numbers,
)

from ..output_poses import (
    AZIMUTH_TILT_TERMS,
    CONVERSION_OF_FORM,
    DIRECTION_TERMS,
    MATRIX_TERMS,
    MID_PLANE_TERMS,
    NO_DIRECTION,
    QUATERNION_TERMS,
    ROTATION_VECTOR_TERMS,
    TILT_TORSION_TERMS,
    find_angular_terms,
    read_terms,
)

ROTATION_TOLERANCE = 1e-6
"""A matrix whose R R^T differs from 1 by more is not a rotation. Larger: rounded numbers in
files are accepted; smaller: they are refused."""
MAX_POSES = 500_000
"""Largest number of poses of one run. The tables are in memory: 2 GB with eight modes."""
MAX_LISTED_FAULTS = 5
"""Largest number of poses that are listed in an error message."""


@dataclass(frozen=True)
class PoseList:
    """A list of poses of an output, or a list of inputs for which poses are computed.

    Attributes
    ----------
    poses
        (n, 3) directions or (n, 3, 3) rotations; None if inputs are listed.
    inputs
        (n, inputs) inputs (rad); None if poses are listed.
    grid_shape
        Number of values along each axis if the poses are a grid; None for other lists.
    """

    poses: Floats | None
    inputs: Floats | None
    grid_shape: tuple[int, ...] | None


@dataclass(frozen=True)
class NumberTable:
    """Numbers from a list, file or window (grid), before their conversion to a `PoseList`.

    A row describes one pose in some form, for example by azimuth and tilt, or has inputs.

    Attributes
    ----------
    terms
        Name of the number in each of k columns, such as azimuth and tilt.
    rows
        (n, k) numbers, one row for each pose or set of inputs.
    units
        Unit of columns by name, if it is known.
    locations
        Position of each row in the file, for error messages; empty for other sources.
    grid_shape
        Number of values along each axis if the poses are a grid; None for other sources.
    """

    terms: tuple[str, ...]
    rows: Floats
    units: Mapping[str, str] = field(default_factory=dict)
    locations: Sequence[str] = ()
    grid_shape: tuple[int, ...] | None = None


def read_poses(
    solver: OutputKinematics,
    where: str,
    poses: Sequence[str] = (),
    columns: tuple[str, ...] = (),
    file: str = "",
    window: Sequence[str] = (),
    unit: AngleUnit | None = None,
    parameter: str = "poses",
) -> PoseList:
    """Return the poses, or the inputs, in a list, a file or a window (grid).

    Exactly one of the three sources is given. If the names of the numbers are those of the
    driven pairs, the numbers are inputs, for which the poses are computed.

    Parameters
    ----------
    solver
        The inverse kinematics of the output, which decides how a pose can be given.
    where
        Name of the analysis, for error messages.
    poses
        Texts ``name=number``. A name that occurs again begins the next pose.
    columns
        Names of the columns of the file that are read. The names are needed if the file has
        the columns of several descriptions of a pose.
    file
        Path of a CSV or Parquet file.
    window
        Texts ``NAME:FROM:TO:COUNT`` of a grid.
    unit
        Unit of angles, deg or rad, that have no unit. By default it is the unit of the
        mechanism's file. A column of a file may state another unit.
    parameter
        Name of the parameter with the list `poses`, for error messages.

    Raises
    ------
    AnalysisError, FileError
        If the poses cannot be read. The message has the position in the list or the line of
        the file.
    PlanError
        If inputs cannot be computed from poses of the output, and no inputs are given.
    """
    sources = {parameter: poses, "file": file, "window": window}
    given_sources = [name for name, source in sources.items() if source]
    if len(given_sources) != 1:
        first_form = _forms_of_output(solver)[0]
        example = "+".join(f"{name}={10 * k}" for k, name in enumerate(first_form, 1))
        mistake = "no poses are given"
        if given_sources:
            mistake = f"found {' and '.join(given_sources)}"
        raise AnalysisError(
            f"{where}: {mistake}; give exactly one of these: a list of poses, such as "
            f"{parameter}={example}, a file, such as file=NAME.csv, or a grid of poses, as "
            "window=NAME:FROM:TO:COUNT (one NAME:FROM:TO:COUNT for each coordinate, joined "
            "by +)"
        )
    if columns and not file:
        raise AnalysisError(
            f"{where}: columns: found {listing(columns)}, but columns can be chosen only "
            "with file=NAME.csv; leave columns out, and state the names in poses or "
            "window, such as poses=azimuth=10+tilt=20"
        )
    where = f"{where}: {file or given_sources[0]}"
    angle_unit = unit or solver.mechanism.angle_unit
    try:
        if file:
            table = _read_file(solver, where, Path(file), columns)
        elif window:
            table = _read_window(solver, where, window, angle_unit)
        else:
            table = _read_list(solver, where, poses, angle_unit)
    except AnalysisError:
        texts = [*poses, *window]
        given_names = {text.partition(":")[0].partition("=")[0] for text in texts}
        gives_inputs = not given_names.isdisjoint(solver.mechanism.input_pairs)
        if not solver.labels and not gives_inputs:
            # The output cannot be solved for poses. This call raises an error with the
            # reason, which is more useful than the present error.
            solver.inverse(np.zeros((0, 3, 3)), ())
        raise
    _check_pose_count(len(table.rows), where)
    gives_inputs = table.terms == solver.mechanism.input_pairs
    # Columns of angles are converted to rad. A unit that the file states takes precedence.
    angular_terms = find_angular_terms(table.terms, solver.mechanism.input_pairs)
    is_in_degrees = [
        term in angular_terms and (table.units.get(term) or angle_unit) == "deg"
        for term in table.terms
    ]
    rows = np.where(is_in_degrees, np.radians(table.rows), table.rows)
    if gives_inputs:
        return PoseList(None, rows, table.grid_shape)
    locations = table.locations or [f"number {k + 1}" for k in range(len(rows))]
    converted_poses = _convert_rows(solver, table.terms, rows, locations, where)
    return PoseList(converted_poses, None, table.grid_shape)


def _read_list(
    solver: OutputKinematics, where: str, poses: Sequence[str], angle_unit: AngleUnit
) -> NumberTable:
    """Return the numbers of poses from texts ``name=number``.

    All poses must have the same names. The names decide in which form poses are described,
    for example by azimuth and tilt, or by the inputs.

    Parameters
    ----------
    solver
        The inverse kinematics of the output, which decides in which forms a pose can be
        given.
    where
        Name of the analysis and of the parameter, for error messages.
    poses
        The texts. A name that occurs again begins the next pose.
    angle_unit
        Unit of angles without a unit.

    Raises
    ------
    AnalysisError
        If the names are not those of a pose, or differ from pose to pose.
    """
    given_numbers = read_terms(poses, solver.mechanism.input_pairs, where, angle_unit)
    first_pose = given_numbers[0]
    form = _match_form(_forms_of_output(solver), tuple(first_pose), where)
    for number, pose in enumerate(given_numbers, 1):
        if pose.keys() != first_pose.keys():
            raise AnalysisError(
                f"{where}: pose {number} is given by {listing(pose)}, but the first pose "
                f"by {listing(first_pose)}; give all poses by the same quantities"
            )
    rows = [[pose[term] for term in form] for pose in given_numbers]
    # `read_terms` has converted all angles to rad. For other numbers the unit has no
    # effect.
    units = dict.fromkeys(form, "rad")
    return NumberTable(form, np.array(rows), units=units)


def _read_file(
    solver: OutputKinematics, where: str, path: Path, columns: tuple[str, ...]
) -> NumberTable:
    """Return the numbers of poses in a file.

    A form is one of the descriptions of a pose, given by the names (terms) of its numbers.
    Examples are (azimuth, tilt) and (x, y, z). The names of the driven pairs are the form
    of inputs.

    Parameters
    ----------
    solver
        The inverse kinematics of the output, which decides how a pose can be given.
    where
        Name of the analysis and of the file, for error messages.
    path
        Path of a CSV or Parquet file.
    columns
        The terms to read. If there are none, the file must have the columns of exactly one
        form.

    Raises
    ------
    AnalysisError
        If a term has no column, or the columns fit no form or several forms.
    FileError
        If the file cannot be read, or if a cell is not a finite number.
    """
    # Columns of the file by name without unit.
    header = columns_of(path)
    forms = _forms_of_output(solver)
    # Tables of spherekit have the input PAIR in the column q_PAIR, a single input in q.
    pairs = solver.mechanism.input_pairs
    pair_of_column = {f"q_{pair}": pair for pair in pairs}
    if len(pairs) == 1:
        pair_of_column["q"] = pairs[0]
    column_of_term = {
        pair_of_column.get(name, name): column for name, column in header.items()
    }
    terms = tuple(pair_of_column.get(name, name) for name in columns)
    missing = [
        name
        for name, term in zip(columns, terms, strict=True)
        if term not in column_of_term
    ]
    if missing:
        raise AnalysisError(
            f"{where}: the file has no column {listing(missing)}; columns: "
            f"{listing(header)}"
        )
    if columns:
        forms_of_file = [_match_form(forms, terms, where)]
    else:
        # Forms whose terms are all in the file.
        complete = [form for form in forms if set(form) <= set(column_of_term)]
        # A form that is a part of another one is left out: (azimuth, tilt) if the file also
        # has a torsion.
        forms_of_file = [
            form
            for form in complete
            if not any(set(form) < set(larger) for larger in complete)
        ]
    if not forms_of_file:
        raise AnalysisError(
            f"{where}: the columns {listing(header)} do not give a pose; a pose needs "
            f"the columns of one of these forms: {_list_forms(forms)}"
        )
    if len(forms_of_file) > 1:
        raise AnalysisError(
            f"{where}: the columns {listing(header)} give a pose in "
            f"{len(forms_of_file)} forms: {_list_forms(forms_of_file)}; choose one of "
            f"them, such as columns={_list_forms(forms_of_file[:1])}"
        )
    (form,) = forms_of_file
    numbers = read_numbers(path, [column_of_term[term] for term in form])
    units = {term: numbers.units.get(column_of_term[term], "") for term in form}
    return NumberTable(
        terms=form, rows=numbers.values, units=units, locations=numbers.places
    )


def _read_window(
    solver: OutputKinematics, where: str, window: Sequence[str], angle_unit: AngleUnit
) -> NumberTable:
    """Return the numbers of all poses of a regular grid.

    A pose can be given by different numbers, such as azimuth and tilt. The names of these
    numbers are called terms. A tuple of terms that describes a pose, such as
    (azimuth, tilt), is a form. The names in `window` tell which form is meant.

    Parameters
    ----------
    solver
        The inverse kinematics of the output, which decides in which forms a pose can be
        given.
    where
        Name of the analysis and of the parameter, for error messages.
    window
        Texts ``NAME:FROM:TO:COUNT``, one for each number of the poses. The grid has all
        combinations of their values.
    angle_unit
        Unit of angles in `window` that state no unit, and of all angles in the result.
    """
    names = [text.partition(":")[0] for text in window]
    angular_terms = find_angular_terms(names, solver.mechanism.input_pairs)
    # The ends and the number of values of each term.
    ranges: dict[str, tuple[float, float, int]] = {}
    for text in window:
        name, *numbers = text.split(":")
        try:
            *ends, count_text = numbers
            count = float(count_text)
            # The numbers are angles if the name is an angle of a pose, such as azimuth, or
            # the name of an input pair.
            if name in angular_terms:
                # A text can state its own unit. All angles are returned in `angle_unit`.
                low_and_high = [
                    read_quantity(end, ANGLE, angle_unit, target=angle_unit) for end in ends
                ]
            else:
                low_and_high = [float(end) for end in ends]
            low, high = low_and_high
            is_valid = count.is_integer() and count > 0.0 and np.isfinite(low + high)
        except QuantityError as problem:
            raise AnalysisError(f'{where}: "{text}": {problem}') from None
        except ValueError:
            is_valid = False
        if not is_valid or name in ranges:
            raise AnalysisError(
                f'{where}: "{text}" is not of the form NAME:FROM:TO:COUNT with each name '
                "once; write for example azimuth:0:360:37"
            )
        ranges[name] = (low, high, int(count))
    form = _match_form(_forms_of_output(solver), tuple(ranges), where)
    grid_shape = tuple(ranges[term][2] for term in form)
    _check_pose_count(prod(grid_shape), where)
    axes = [np.linspace(*ranges[term]) for term in form]
    grids = np.meshgrid(*axes, indexing="ij")
    rows = np.stack([grid.ravel() for grid in grids], axis=1)
    return NumberTable(form, rows, grid_shape=grid_shape)


def _convert_rows(
    solver: OutputKinematics,
    form: tuple[str, ...],
    rows: Floats,
    locations: Sequence[str],
    where: str,
) -> Floats:
    """Convert rows of numbers to poses, and check that each row describes a pose.

    Parameters
    ----------
    solver
        The inverse kinematics of the output.
    form
        Names of the numbers in the k columns. The names decide how the numbers describe a
        pose: as a direction, as an orientation, or by the mid-plane. The mid-plane is the
        plane about which the base and the output link are mirror images of each other. Its
        inclination is given by the angles phi and gamma.
    rows
        (n, k) numbers, angles in rad.
    locations, where
        For error messages: the position of each row in its source, and the name of the
        source.

    Returns
    -------
    (n, 3) directions or (n, 3, 3) rotations.

    Raises
    ------
    AnalysisError
        If some rows do not describe a pose. The message lists these rows.
    """
    # Rows that do not describe a pose become NaN. `fault` is the message about these
    # rows.
    if form == MATRIX_TERMS:
        poses = _read_rotation_matrices(rows)
        fault = "is not a rotation matrix"
    elif form == MID_PLANE_TERMS:
        normals = CONVERSION_OF_FORM[form](rows)
        poses = _find_directions_at_mid_planes(solver, normals)
        fault = "is not a mid-plane: phi and gamma are too large"
    else:
        poses = CONVERSION_OF_FORM[form](rows)
        fault = f"has {NO_DIRECTION}"
    faulty_rows = np.unique(np.nonzero(np.isnan(poses))[0])
    if len(faulty_rows):
        faulty_locations = (locations[row] for row in faulty_rows)
        listed = listing(faulty_locations, MAX_LISTED_FAULTS)
        raise AnalysisError(f"{where}: {listed} {fault}")
    return poses


def _read_rotation_matrices(rows: Floats) -> Floats:
    """Return matrices (n, 3, 3) from rows (n, 9) of elements, NaN if no rotation matrix."""
    matrices = rows.reshape(-1, 3, 3)
    # R R^T must be the identity matrix, and the determinant positive.
    products = matrices @ np.swapaxes(matrices, 1, 2)
    deviation = np.abs(products - np.eye(3)).max(axis=(1, 2))
    is_rotation = (deviation < ROTATION_TOLERANCE) & (np.linalg.det(matrices) > 0.0)
    matrices[~is_rotation] = np.nan
    return matrices


def _find_directions_at_mid_planes(solver: OutputKinematics, normals: Floats) -> Floats:
    """Return the directions (n, 3) of the output at mid-planes with normals (n, 3).

    The mechanism has legs between the base and the output link. Base and output link are
    mirror images of each other in the mid-plane. The normals have components along the
    mirror axes, which are fixed in the base. The result is in the axes of the base. A
    normal that is NaN gives NaN.
    """
    architecture = solver.form
    assert architecture is not None and solver.output.direction is not None
    return architecture.orientations(normals) @ np.array(solver.output.direction)


def _check_pose_count(count: int, where: str) -> None:
    """Raise an error if there are too many poses for the tables in memory."""
    if count > MAX_POSES:
        raise AnalysisError(
            f"{where}: found {count} poses, at most {MAX_POSES} are possible in one run; "
            "split them into several runs"
        )


def _forms_of_output(solver: OutputKinematics) -> list[tuple[str, ...]]:
    """Return the forms in which poses of an output can be described, the inputs last.

    A form is a tuple of the names of its numbers, such as azimuth and tilt. Without working
    modes (`solver.labels`), inputs cannot be computed from poses, so poses can only be
    described by inputs. A form with the names of the inputs is left out.
    """
    forms: list[tuple[str, ...]] = []
    # Poses are directions if the solver has `points`, else rotations.
    if solver.labels and solver.points:
        forms = [AZIMUTH_TILT_TERMS, DIRECTION_TERMS]
    elif solver.labels:
        forms = [TILT_TORSION_TERMS, QUATERNION_TERMS, ROTATION_VECTOR_TERMS, MATRIX_TERMS]
    # In a mid-plane symmetric architecture (`form`), base and output mirror each other.
    if solver.form is not None:
        forms.append(MID_PLANE_TERMS)
    inputs = solver.mechanism.input_pairs
    return [*(form for form in forms if set(form) != set(inputs)), inputs]


def _match_form(
    forms: Sequence[tuple[str, ...]], names: tuple[str, ...], where: str
) -> tuple[str, ...]:
    """Find out in which form the user describes poses, such as azimuth and tilt.

    The user names each number of a pose, in any order. A form is a tuple of such names in
    a fixed order. The form with the same names is returned.

    Parameters
    ----------
    forms
        The possible forms.
    names
        The names that the user wrote.
    where
        The source of the names, for error messages.

    Raises
    ------
    AnalysisError
        If there is no such form.
    """
    for form in forms:
        if sorted(form) == sorted(names):
            return form
    raise AnalysisError(
        f'{where}: "{"+".join(names)}" does not describe a pose; give one of '
        f"{_list_forms(forms)}"
    )


def _list_forms(forms: Sequence[tuple[str, ...]]) -> str:
    """Return forms of poses in words, such as ``azimuth+tilt and x+y+z``."""
    return listing("+".join(form) for form in forms)
