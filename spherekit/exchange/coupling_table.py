"""Coupling tables for controllers: passive variables on a grid of the inputs.

A table is interpolated between its nodes. The m inputs have nodes at equal steps. A cell is
the box between neighbouring nodes, with 2^m corners.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import combinations_with_replacement, product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from spherekit.argument_validation import checked
from spherekit.arrays import Bools, Floats, Integers
from spherekit.conventions import AnyPath, Names
from spherekit.errors import FileError, SolveError
from spherekit.storage.atomic_write import write_text
from spherekit.storage.numpy_archive import ArchiveFormat, read_archive, write_archive
from spherekit.tables.table_files import make_frame
from spherekit.wording import counted, listing

COUPLING_FORMAT = ArchiveFormat(
    "spherekit coupling table", 1, "write one with `--to coupling`"
)
"""The format of archives of coupling tables."""

HEADING_FIELDS = (
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
"""Fields of a table in the heading of an archive. The others are arrays of their names."""

GRID_SLACK_STEPS = 1e-9
"""Distance from the grid, in steps, up to which an input counts as inside.

Smaller: an end of the range is refused because of rounding; larger: inputs outside are
extrapolated. The C header has the same number.
"""


class CouplingValues(NamedTuple):
    """The values of a coupling table at n points of its m inputs.

    The table has passive variables (joint angles that are not driven) at the nodes of a
    grid of inputs. A cell is a box between neighbouring nodes. A cell is called sure if the
    measured error of interpolation in it is within the tolerance. Values in other cells are
    NaN.

    Attributes
    ----------
    angles
        (n, K) the K passive variables (rad).
    coefficients
        (n, K, m) rates of the passive variables per unit rate of each input.
    derivatives
        (n, K, m, m) derivatives of the coefficients with respect to each input (1/rad).
    turning
        (n, P, m, 3) for each of P poles (axes of relative rotation of two links) the
        angular velocity of its first link relative to its second, per unit rate of each
        input, in ground axes.
    """

    angles: Floats
    coefficients: Floats
    derivatives: Floats
    turning: Floats


@dataclass(frozen=True)
class CouplingTable:
    """Passive variables and coefficients of assembly modes on a grid of m inputs.

    A coefficient is the rate of a passive variable per unit rate of one input. Nodes are
    the points of the grid, and a cell is the box between neighbouring nodes. Nodes and
    cells are each listed along one axis of an array, on which the last input varies
    fastest. A cell has the place of its corner with the smallest inputs.

    Attributes
    ----------
    mechanism
        Name of the mechanism.
    mechanism_sha256
        SHA-256 checksum of the mechanism file.
    made_by
        Version of spherekit that computed the table.
    inputs
        Names of the m inputs.
    variables
        Names of the K passive variables.
    poles
        Names of the P poles (pairs of links) of which the relative angular velocity is
        stored.
    modes
        Numbers of the assembly modes.
    tolerance
        Largest error (rad) of an angle in cells that are sure.
    start, step, count
        (m,) first node (rad), step (rad) and number of nodes of each input.
    periodic
        (m,) whether the range of an input is one revolution after which all
        configurations return.
    rise
        (modes, m, K) growth (rad) of each variable over such a revolution.
    angles
        (modes, nodes, K) the variables (rad).
    coefficients
        (modes, nodes, K, m) rates of the variables per unit rate of each input.
    derivatives
        (modes, nodes, K, m, m) derivatives of the coefficients (1/rad).
    turning
        (modes, nodes, P, m, 3) angular velocities of poles per unit rate of each input.
    turning_derivatives
        (modes, nodes, P, m, m, 3) derivatives of `turning` with respect to each input, the
        last axis but one.
    error
        (modes, cells) largest error (rad) of an angle that was measured in a cell, with an
        allowance for errors between the measured points. It is NaN if the mode is missing
        at a corner or at a measured point.
    sure
        (modes, cells) whether the error is within the tolerance. Cells in which a larger
        jump or the end of a mode was found are not sure.
    coefficient_error
        Largest error of a coefficient or of a component of `turning` in cells that are
        sure, with the same allowance.
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
        """Largest error of an angle (rad) in cells whose error is within the tolerance."""
        return float(np.max(self.error[self.sure], initial=0.0))

    @property
    def nodes(self) -> Floats:
        """(nodes, m) the inputs at the nodes (rad)."""
        node_indices = np.indices(tuple(self.count)).reshape(len(self.count), -1)
        return self.start + self.step * node_indices.T

    @checked(SolveError)
    def at(self, q: ArrayLike, assembly_mode: int | None = None) -> CouplingValues:
        """Return the values of the table at inputs, interpolated between the nodes.

        The values are the angles of the passive variables (joint angles that are not
        driven), their rates per unit rate of each input (coefficients) and so on, see
        `CouplingValues`. A cell is the box between neighbouring nodes of the grid. A cell
        is called sure if the measured error of interpolation in it is within the tolerance
        of the table.

        Parameters
        ----------
        q
            (m,) or (n, m) inputs (rad). A table of one input also takes a number.
        assembly_mode
            Number of the mode, by default the first in the table.

        Returns
        -------
        The values at n points, NaN beyond the grid and in cells that are not sure.

        Raises
        ------
        SolveError
            If the mode is not in the table, or if q has another shape.

        Notes
        -----
        Each corner of a cell has the angle f of a passive variable, and the gradient g and
        Hessian H of f with respect to the inputs. The elements of g are the coefficients of
        the variable. Let d (m,) be the vector from the corner to the point, and W the
        multilinear weight of the corner. The angle at the point is the sum of
        W (f + 2/3 g d + 1/6 d H d) over the corners, which is exact for cubics. The
        coefficients are the sum of W (g + 1/2 H d), which is exact for quadratics (Guessab,
        Nouisser and Schmeisser, J. Comput. Appl. Math. 196, 2006, 162-179). Angles and
        coefficients are continuous from cell to cell.
        """
        if assembly_mode is None:
            assembly_mode = self.modes[0]
        if assembly_mode not in self.modes:
            raise SolveError(
                f"{self.mechanism}: assembly mode {assembly_mode} is not in the table, "
                f"which has {listing(self.modes)}"
            )
        mode_index = self.modes.index(assembly_mode)
        inputs = self._input_rows(q)
        # Positions (n, m) on the grid in steps. Whole revolutions of a periodic input are
        # removed.
        last_node = self.count - 1
        positions = (inputs - self.start) / self.step
        revolutions = np.where(self.periodic, np.floor(positions / last_node), 0.0)
        positions -= revolutions * last_node
        is_known = np.all(
            (positions >= -GRID_SLACK_STEPS) & (positions <= last_node + GRID_SLACK_STEPS),
            axis=1,
        )
        # Points outside are computed at the first node, and become NaN below.
        positions[~is_known] = 0.0
        cells = np.clip(np.floor(positions).astype(np.int64), 0, last_node - 1)
        cell_numbers = np.ravel_multi_index(tuple(cells.T), tuple(last_node))
        is_known &= self.sure[mode_index, cell_numbers]
        values = self.interpolate(mode_index, cells, positions - cells)
        values.angles[:] += revolutions @ self.rise[mode_index]  # growth per revolution
        for array in values:
            array[~is_known] = np.nan
        return values

    def _input_rows(self, q: ArrayLike) -> Floats:
        """Return inputs as rows (n, m), with NaN in place of infinite inputs.

        Raises
        ------
        SolveError
            If the shape of `q` is neither (m,) nor (n, m). With one input, numbers and
            arrays (n,) are allowed too.
        """
        inputs = np.asarray(q, dtype=float)
        input_count = len(self.inputs)
        if inputs.ndim < 2:
            # The numbers are values of the only input, or one point of several inputs.
            inputs = inputs.reshape((-1, 1) if input_count == 1 else (1, -1))
        if inputs.ndim != 2 or inputs.shape[1] != input_count:
            raise SolveError(
                f"{self.mechanism}: q has the shape {np.shape(q)}, expected (number of "
                f"points, {input_count}): one column for each input "
                f"({listing(self.inputs)})"
            )
        return np.where(np.isfinite(inputs), inputs, np.nan)

    def interpolate(self, mode: int, cells: Integers, positions: Floats) -> CouplingValues:
        """Return the interpolated values of a mode in cells of the grid of m inputs.

        A mode is one way to assemble the mechanism. A cell is a box between neighbouring
        nodes, and its corners are nodes. At each corner the table has the angle f of every
        passive variable (joint angle that is not driven). It also has the gradient g of f
        (the coefficients) and the Hessian H (their derivatives) with respect to the inputs.
        At the distance d (m,) from the corner these give

        - the angle f + (2/3) g d + (1/6) d H d,
        - the coefficients g + (1/2) H d,
        - the derivatives H.

        The results of all corners are averaged with multilinear weights. The average is
        exact for angles that are cubic functions of the inputs, and for coefficients that
        are quadratic (Guessab, Nouisser and Schmeisser, J. Comput. Appl. Math. 196, 2006).
        Relative angular velocities of two links (`turning`) are interpolated like
        coefficients.

        Parameters
        ----------
        mode
            Position of the mode in `modes`.
        cells
            (n, m) index of a cell along each input.
        positions
            (n, m) position in the cell, from 0 to 1 along each input.
        """
        angles: Any = 0.0
        coefficients: Any = 0.0
        derivatives: Any = 0.0
        turning: Any = 0.0
        for corner in product((0, 1), repeat=len(self.inputs)):
            weights = _multilinear_weights(positions, corner)
            extended = self._extend_from_corner(mode, cells, positions, corner)
            angles = angles + _multiply_points(weights, extended.angles)
            coefficients = coefficients + _multiply_points(weights, extended.coefficients)
            derivatives = derivatives + _multiply_points(weights, extended.derivatives)
            turning = turning + _multiply_points(weights, extended.turning)
        return CouplingValues(angles, coefficients, derivatives, turning)

    def _extend_from_corner(
        self, mode: int, cells: Integers, positions: Floats, corner: Sequence[int]
    ) -> CouplingValues:
        """Return the values at n points, extrapolated from one corner of their cells.

        A cell is a box between neighbouring nodes of the grid of m inputs. Each node has
        the stored angle f of a variable, and its gradient g and Hessian H with respect to
        the inputs. At the distance d from the node, the angle is taken as

            f + (2/3) g d + (1/6) d H d,

        and the gradient as g + (1/2) H d. The caller averages the values from all corners
        of a cell with multilinear weights. With these factors, the average is exact if f is
        a cubic function.

        The angular velocities of links relative to other links (`turning`) are extrapolated
        like gradients.

        Parameters
        ----------
        mode
            Position of the mode (way to assemble the mechanism) in `modes`.
        cells
            (n, m) index of the cell of each point along each input.
        positions
            (n, m) position in the cell, from 0 to 1 along each input.
        corner
            Position of the corner in the cell: 0 or 1 along each of the m inputs.
        """
        # Nodes are numbered in one row, so the index along each input is converted.
        corner_node = np.ravel_multi_index(tuple((cells + corner).T), tuple(self.count))
        node = mode, corner_node
        distance = (positions - corner) * self.step  # d (n, m), in rad
        angle = self.angles[node]  # f (n, K)
        gradient = self.coefficients[node]  # g (n, K, m)
        hessian = self.derivatives[node]  # H (n, K, m, m)
        # In the sums n is the point, k the variable, i and j are inputs.
        hessian_change = np.einsum("nkij,nj->nki", hessian, distance)  # H d
        # (2/3) g d + (1/6) d H d, with d factored out.
        slope = 2 / 3 * gradient + hessian_change / 6
        angle_change = np.einsum("nki,ni->nk", slope, distance)
        # Angular velocities per unit rate of input i: p counts the pairs of links, and x is
        # a component of a vector.
        turning = self.turning[node]  # (n, P, m, 3)
        turning_derivatives = self.turning_derivatives[node]  # by input j, (n, P, m, m, 3)
        turning_change = np.einsum("npijx,nj->npix", turning_derivatives, distance)
        return CouplingValues(
            angles=angle + angle_change,
            coefficients=gradient + 0.5 * hessian_change,
            derivatives=hessian,
            turning=turning + 0.5 * turning_change,
        )


def _multilinear_weights(positions: Floats, corner: Sequence[int]) -> Floats:
    """Return the weights (n,) of one corner of a cell, for interpolation at n positions.

    `positions` (n, m) go from 0 to 1 along each of m inputs, and `corner` has a 0 or 1 for
    each input. The weight is a product over the inputs: of the position if the corner has
    1, and of 1 - position if it has 0.
    """
    return np.prod(np.where(corner, positions, 1.0 - positions), axis=1)


def _multiply_points(weights: Floats, values: Floats) -> Floats:
    """Return values (n, ...) of points, multiplied by the weight (n,) of each point."""
    trailing_axes = (1,) * (values.ndim - 1)
    return weights.reshape(-1, *trailing_axes) * values


def write_npz(table: CouplingTable, path: AnyPath) -> None:
    """Write a coupling table as a NumPy archive (.npz) that `load_coupling` reads.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    value_by_field = {field.name: getattr(table, field.name) for field in fields(table)}
    heading = {name: value_by_field.pop(name) for name in HEADING_FIELDS}
    write_archive(path, COUPLING_FORMAT, heading, value_by_field)


@checked(FileError)
def load_coupling(path: AnyPath) -> CouplingTable:
    """Return a coupling table that was written as a NumPy archive.

    The table has the variables of passive pairs (joints that are not driven), and their
    rates per unit rate of each input, on a grid of the inputs.

    Raises
    ------
    FileError
        If the file can't be read, or if it is another kind of file.
    """

    def construct_table(heading: dict[str, Any], arrays: dict[str, Any]) -> CouplingTable:
        """Construct the table from the contents of the archive.

        Parameters
        ----------
        heading
            Values of the fields that are texts or single numbers.
        arrays
            Values of the fields that are arrays.
        """
        heading_fields = {name: heading[name] for name in HEADING_FIELDS}
        return CouplingTable(**heading_fields, **arrays)

    return read_archive(path, COUPLING_FORMAT, construct_table)


def columns(table: CouplingTable) -> dict[str, Floats]:
    """Return a coupling table as columns (modes * nodes,) by their names, mode after mode.

    The table has values of assembly modes (ways to assemble the mechanism) at the nodes of
    a grid of inputs. The names are built like these:

    - ``assembly_mode``, ``q_21``: the number of the mode, and the input 21 (rad);
    - ``theta_41``: a passive variable (angle of a joint that is not driven, rad);
    - ``theta_41_by_21``: its coefficient, the rate per unit rate of the input 21;
    - ``theta_41_by_21_by_51``: the derivative of the coefficient with respect to a second
      input (1/rad);
    - ``w_6_1_x_by_12``: the x component of the angular velocity of link 6 relative to link
      1, per unit rate of the input 12;
    - ``cell_error``: the largest measured error (rad) in the cell (box between neighbouring
      nodes) that starts at the node.
    """
    mode_count = len(table.modes)
    nodes = table.nodes
    inputs = list(enumerate(table.inputs))
    arrays: dict[str, Floats] = {"assembly_mode": np.repeat(table.modes, len(nodes))}
    for i, input_name in inputs:
        arrays[f"q_{input_name}"] = np.tile(nodes[:, i], mode_count)
    for k, variable in enumerate(table.variables):
        arrays[variable] = table.angles[:, :, k]
        for i, input_i in inputs:
            arrays[f"{variable}_by_{input_i}"] = table.coefficients[:, :, k, i]
        # The derivatives are symmetric, so each pair of inputs occurs once.
        for (i, input_i), (j, input_j) in combinations_with_replacement(inputs, 2):
            name = f"{variable}_by_{input_i}_by_{input_j}"
            arrays[name] = table.derivatives[:, :, k, i, j]
    for p, pole in enumerate(table.poles):
        prefix = f"w_{pole.replace('/', '_')}"
        for (i, input_i), (x, component) in product(inputs, enumerate("xyz")):
            name = f"{prefix}_{component}_by_{input_i}"
            # `turning` are the relative angular velocities of two links.
            arrays[name] = table.turning[:, :, p, i, x]
    # `count` are the numbers of nodes along the inputs. Along each input there is one cell
    # less. Add NaN for the last node.
    cell_errors = table.error.reshape(mode_count, *(table.count - 1))
    padding = [(0, 0), *[(0, 1)] * len(table.count)]
    arrays["cell_error"] = np.pad(cell_errors, padding, constant_values=np.nan)
    return {name: values.ravel() for name, values in arrays.items()}


def write_csv(table: CouplingTable, path: AnyPath) -> None:
    """Write a coupling table as CSV, with the columns of `columns`.

    A row is a node (point of the grid of the inputs) in one assembly mode. Where the mode
    does not exist, cells are empty.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    frame = make_frame(columns(table), {})
    write_text(path, frame.to_csv(index=False, lineterminator="\n"))
