"""Poles of a block that a kernel computes only when their columns are read.

A `RowKernel` evaluates all columns of a row at once. It certifies most rows. All other rows
are evaluated by the ordinary functions, and these values replace the values of the kernel.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np

from spherekit.arrays import Bools, Floats, Indices, SmallIntegers
from spherekit.numerics.lazy_columns import LazyColumn, Reader, Span, copy_columns
from spherekit.planning.pole_plan import Pole
from spherekit.positions.motion import Motion
from spherekit.runs.prefetch import thread_map
from spherekit.status import Status
from spherekit.velocities.direction_signs import SignFunction, apply_signs
from spherekit.velocities.pole_evaluation import add_locked_pole, evaluate_unsigned
from spherekit.velocities.pole_field import REPORTED_ERRORS, PoleField
from spherekit.velocities.pole_request import Request
from spherekit.velocities.pole_sequence import PlannedPoles
from spherekit.velocities.row_kernel import RowKernel

SLICE_ROWS = 8184
"""Number of rows that a kernel evaluates at once.

It is no power of two, since columns would then share lines of the processor's cache.
Larger: the columns of a slice exceed the cache. Smaller: the overhead of calls grows.
"""

RowSlice = tuple[int, slice]
"""The index of an assembly mode, and a slice of its successive rows."""


class ColumnKey(NamedTuple):
    """Identifies a column of numbers: one quantity of a pole or link in all rows.

    A row is one sample in one assembly mode (way to assemble the mechanism). The rows
    belong to a block of samples that are computed together. A pole is the axis about which
    one link rotates relative to another. Compiled functions compute a column when it is
    read.

    Attributes
    ----------
    input_index
        Index of the input that moves while the other inputs are locked.
    quantity
        Name of a quantity: an attribute of `PoleField`, such as ``"direction"``.
    subject
        The pole (two link numbers) or the link (its number) to which the quantity belongs.
    component
        Index of the component if the quantity is a vector, otherwise 0.
    """

    input_index: int
    quantity: str
    subject: Any
    component: int


class UnsignedPoles(NamedTuple):
    """Poles in some rows, with directions that may still be reversed.

    A pole is the axis about which one link rotates relative to another. It is a line, and
    either of its two senses can be its direction. The sense is chosen later such that
    directions continue from row to row. A row is one sample in one assembly mode; there are
    k rows.

    Attributes
    ----------
    directions
        (3, poles, k) unit vectors of the pole axes.
    velocities
        (3, poles, k) relative angular velocities per unit rate of the input. They are the
        same for both senses.
    velocity_rates
        (3, poles, k) derivatives of these velocities with respect to the input.
    """

    directions: Floats
    velocities: Floats
    velocity_rates: Floats


def split_rows(mode_count: int, sample_count: int, size: int) -> list[RowSlice]:
    """Return the rows of all assembly modes in slices of at most `size` rows.

    A row is one sample in one mode. The first `sample_count` rows belong to the first mode,
    the next `sample_count` rows to the second mode, and so on. The result has the index of
    the mode and the rows of each slice, which never contains two modes.
    """
    return [
        (mode, slice(start, min(start + size, (mode + 1) * sample_count)))
        for mode in range(mode_count)
        for start in range(mode * sample_count, (mode + 1) * sample_count, size)
    ]


class UncertifiedPoles:
    """The poles of a block in the rows that the kernel does not certify.

    A pole is the axis about which one link rotates relative to another. The kernel, a set
    of compiled functions for many rows, certifies a row if its error bounds are small
    enough. In the other rows, slower functions evaluate the poles, and these results
    replace the results of the kernel.

    Attributes
    ----------
    rows
        (u,) indices of these rows in the block, rising.
    fields
        The poles in these rows, for each input that moves while the other inputs are
        locked. Empty if there are no such rows.
    """

    def __init__(
        self,
        kernel: RowKernel,
        motion: Motion,
        requests: Sequence[Request],
        rows: Indices,
    ) -> None:
        """Evaluate the poles in the rows where the compiled functions are too inaccurate.

        A pole is the axis about which one link rotates relative to another. A block is a
        group of samples that are computed together. A kernel (compiled functions) evaluates
        the poles in most rows of the block. In uncertified rows, the error bounds of the
        kernel are too large, and slower, more careful functions evaluate the poles.

        A pole is a line, so its direction can have two senses. If it is the axis of a pair
        (joint), the mechanism file fixes the sense. All other poles are called reversible.

        Parameters
        ----------
        kernel
            The kernel, which knows for each moving input which poles are reversible.
        motion
            The configurations of the block. A row is one sample in one assembly mode.
        requests
            The poles to evaluate, for each input that moves while the other inputs are
            locked.
        rows
            (u,) indices of the uncertified rows in the block, rising.
        """
        self.rows = rows
        self._reversible_poles = [
            input_columns.reversible_poles for input_columns in kernel.input_columns
        ]
        # One field for each moving input, with all values of its poles in these rows.
        self.fields: list[PoleField] = []
        if len(rows):
            configurations = motion.rows(rows)
            for request, poles in zip(requests, self._reversible_poles, strict=True):
                # The senses must be those that the kernel gives to reversible poles.
                field = _evaluate_with_senses_of_kernel(configurations, request, poles)
                self.fields.append(field)

    def apply_signs(self, sign_functions: Sequence[SignFunction], samples: int) -> None:
        """Give the pole directions in the uncertified rows their final senses, in place.

        A pole is the axis of the relative rotation of two links. It is a line, so its
        direction can have two senses. A pole that is the axis of a pair (joint) has the
        sense of the mechanism file and stays unchanged. Rows are uncertified if their error
        bounds are too large for the compiled functions.

        Parameters
        ----------
        sign_functions
            For each input that moves, a function of directions (3, poles, u) in the u
            uncertified rows, row numbers (u,) and indices of assembly modes (u,). It
            returns signs +1 or -1 (poles, u).
        samples
            Number of samples, which is the number of rows of each assembly mode.
        """
        # The rows of the first mode come first, then the rows of the second mode, and so
        # on.
        mode_indices = self.rows // samples
        for input_index, field in enumerate(self.fields):
            # All poles that are no pair axis.
            poles = self._reversible_poles[input_index]
            directions = np.empty((3, len(poles), len(self.rows)))
            for pole_index, pole in enumerate(poles):
                directions[:, pole_index] = field.direction[pole].T
            find_signs = sign_functions[input_index]
            signs = find_signs(directions, self.rows, mode_indices)
            for pole, signs_of_pole in zip(poles, signs, strict=True):
                apply_signs(field, pole, signs_of_pole)

    def put_into_unsigned(
        self, poles: UnsignedPoles, input_index: int, rows: Indices
    ) -> None:
        """Replace the values of poles in uncertified rows by more accurate ones, in place.

        A kernel (compiled functions) has computed the poles (axes of the relative rotation
        of two links) in all rows. In uncertified rows its errors may be too large. The
        signs of directions are arbitrary here, and are chosen later.

        Parameters
        ----------
        poles
            The poles at k rows, as the kernel has computed them.
        input_index
            Index of the input that moves while the other inputs are locked.
        rows
            (k,) indices of these rows in the block (group of samples). A row is one sample
            in one assembly mode.
        """
        # `self.rows` are the uncertified rows of the block.
        replaced = np.flatnonzero(np.isin(rows, self.rows))
        if not len(replaced):
            return
        field = self.fields[input_index]
        # The position of each replaced row among the uncertified rows, which are rising.
        field_rows = np.searchsorted(self.rows, rows[replaced])
        # Reversible poles are those that are no pair axis. `poles` has only these.
        for pole_index, (first_link, second_link) in enumerate(
            self._reversible_poles[input_index]
        ):
            direction = field.direction[first_link, second_link]
            # `w` has the angular velocity of each link, `dw` its derivative.
            velocity = field.w[second_link] - field.w[first_link]
            velocity_rate = field.dw[second_link] - field.dw[first_link]
            poles.directions[:, pole_index, replaced] = direction[field_rows].T
            poles.velocities[:, pole_index, replaced] = velocity[field_rows].T
            poles.velocity_rates[:, pole_index, replaced] = velocity_rate[field_rows].T

    def put_into_column(self, key: ColumnKey, column: Floats, rows: slice) -> None:
        """Replace the values of a kernel column in uncertified rows, in place.

        A row is one sample in one assembly mode. A column has one number for each row, such
        as the x component of the direction of one pole. A kernel (compiled functions) has
        computed it. In uncertified rows its errors may be too large, and more accurate
        results replace the values of the kernel.

        Parameters
        ----------
        key
            Identifies the column: input that moves, quantity, pole or link, and component.
        column
            (k,) the column in k successive rows.
        rows
            These rows in the block (group of samples).
        """
        # The uncertified rows at the positions `first` to `end` are among the k rows.
        first, end = np.searchsorted(self.rows, [rows.start, rows.stop])
        if first == end:
            return
        # The more accurate results for the moving input are in a `PoleField`. A quantity,
        # such as `direction`, is an attribute: a mapping from poles or links to arrays.
        field = self.fields[key.input_index]
        values = getattr(field, key.quantity)[key.subject]
        # (uncertified rows of the block, components)
        components = values.reshape(len(self.rows), -1)
        positions_in_slice = self.rows[first:end] - rows.start
        column[positions_in_slice] = components[first:end, key.component]


def _evaluate_with_senses_of_kernel(
    motion: Motion, request: Request, reversible_poles: Sequence[Pole]
) -> PoleField:
    """Evaluate poles without compiled functions, but with the same senses of direction.

    A pole is the axis of the relative rotation of two links. It is a line, so its direction
    can have two senses. If it is the axis of a pair (joint), the mechanism file fixes the
    sense. All other poles are called reversible. The kernel (compiled functions) gives them
    the sense in which the velocity coefficient (angular velocity per unit rate of the
    input) is not negative. The same rule is used here, because the results replace those
    of the kernel in some rows.

    Parameters
    ----------
    motion
        The configurations.
    request
        The poles. Their great circles (planes) are not computed here.
    reversible_poles
        The poles that are not the axis of a pair.
    """
    field = evaluate_unsigned(motion, replace(request, planes=frozenset()))
    for pole in reversible_poles:
        signs = np.where(field.velocity_coefficient[pole] < 0.0, -1.0, 1.0)
        apply_signs(field, pole, signs)
    return field


def evaluate_unsigned_poles(
    kernel: RowKernel,
    motion: Motion,
    uncertified_poles: UncertifiedPoles,
    input_index: int,
    rows: Indices,
) -> UnsignedPoles:
    """Return the poles in k rows of a block, before the senses of directions are chosen.

    A pole is the axis about which one link rotates relative to another. It is a line, so
    its direction can have two senses. The caller compares the directions of different rows,
    and then chooses senses such that the directions are continuous. A pole that is the axis
    of a pair (joint) has a fixed sense and is left out.

    Parameters
    ----------
    kernel
        Compiled functions that compute the poles at all rows together.
    motion
        The configurations of the block (group of samples). A row is one sample in one
        assembly mode.
    uncertified_poles
        More accurate poles, in the rows where the errors of the kernel may be too large.
        They replace the values of the kernel.
    input_index
        Index of the input that moves while the other inputs are locked.
    rows
        (k,) indices of the rows in the block.
    """
    poles = _evaluate_unsigned_by_kernel(kernel, input_index, motion.values.T[:, rows])
    uncertified_poles.put_into_unsigned(poles, input_index, rows)
    return poles


def _evaluate_unsigned_by_kernel(
    kernel: RowKernel, input_index: int, values: Floats
) -> UnsignedPoles:
    """Evaluate poles by compiled functions, before the senses of directions are chosen.

    A pole is the axis of the relative rotation of two links. It is a line, so its unit
    vector u can have two senses. The sense is chosen later such that directions continue
    from row to row.

    With the velocity coefficient c, the relative angular velocity is ``c u``. Its
    derivative with respect to the input is ``c' u + c u'``. These two vectors are the same
    for both senses of u.

    Parameters
    ----------
    kernel
        Compiled functions that evaluate many rows at once.
    input_index
        Index of the input that moves while the other inputs are locked.
    values
        (variables, k) pair variables (rad) in k rows (samples in assembly modes).
    """
    quantities = kernel.input_columns[input_index].reversible_quantities(
        kernel.all_columns(values)
    )
    # (3, poles, k) u and u', and (poles, k) c and c'.
    unit = quantities["direction"]
    unit_rate = quantities["direction_dq"]
    (coefficient,) = quantities["velocity_coefficient"]
    (coefficient_rate,) = quantities["acceleration_coefficient"]
    # Rows with large errors can have NaN or huge numbers here. The caller replaces these
    # rows by more accurate ones (`UncertifiedPoles`).
    with np.errstate(invalid="ignore", over="ignore"):
        velocity = coefficient * unit
        velocity_rate = coefficient_rate * unit + coefficient * unit_rate
    return UnsignedPoles(unit, velocity, velocity_rate)


class KernelColumns:
    """The columns of a block, which a kernel computes from the configurations of the block.

    A kernel is a set of compiled functions that evaluate many rows at once. Columns are
    computed when they are read.

    Parameters
    ----------
    kernel
        Evaluates the rows.
    motion
        The configurations of the block.
    requests
        The poles to evaluate, for each input that moves while the other inputs are locked.
    uncertified_poles
        The poles in the rows that the kernel does not certify, with their final senses.
    sign_functions
        For each input that moves, a function of directions (3, poles, k) in k rows, a slice
        of these rows, and the index of their assembly mode. It returns the signs +1 or -1
        (poles, k) that give the directions of the kernel their final senses.

    Attributes
    ----------
    was_read
        Whether a column was read.
    """

    def __init__(
        self,
        kernel: RowKernel,
        motion: Motion,
        requests: Sequence[Request],
        uncertified_poles: UncertifiedPoles,
        sign_functions: Sequence[SignFunction],
    ) -> None:
        """Store what the columns of a block (group of samples) are computed from.

        The columns have quantities of poles (axes of relative rotation) in n rows. The
        kernel (compiled functions) computes them in the rows that it certifies: its error
        bounds are small enough there. The values in the other rows come from
        `uncertified_poles`. The class describes all arguments.
        """
        self.kernel = kernel
        self.requests = requests
        self.uncertified_poles = uncertified_poles
        # By moving input, functions that return the final signs of the directions.
        self._sign_functions = sign_functions
        self.was_read = False  # no column has been read yet
        self._values = motion.values.T  # (variables, n) pair variables (rad)
        self._failed = motion.failed  # (n,) rows without a configuration
        # (n,) rows in which other values replace those of the kernel: NaN in failed rows,
        # and the results of slower functions in uncertified rows.
        self._is_replaced = motion.failed.copy()
        self._is_replaced[uncertified_poles.rows] = True
        # Columns are computed for one slice of rows after another, because the results of a
        # slice stay in the cache of the processor.
        mode_count = len(motion.assembly_modes)
        self._slices = split_rows(mode_count, motion.samples, SLICE_ROWS)

    def read(self, keys: Sequence[ColumnKey], reader: Reader) -> None:
        """Compute some columns slice by slice, and pass them to a reader.

        A column has one value of a pole or link in each row (sample in an assembly mode). A
        slice is a number of successive rows that fits into the cache of the processor.

        Parameters
        ----------
        keys
            The columns to compute.
        reader
            Function that is called for each slice, perhaps in several threads. Its
            arguments are the slice of rows, and a list of the values (k,) of each column in
            these rows.
        """
        self.was_read = True
        read_slice = partial(self._read_slice, keys, reader)
        thread_map(read_slice, self._slices, uses_threads=self.kernel.is_compiled)

    def _read_slice(
        self, keys: Sequence[ColumnKey], reader: Reader, row_slice: RowSlice
    ) -> None:
        """Compute some columns of one slice of rows, and pass them to a reader.

        A column has one value of a pole (axis of relative rotation) or link in each row
        (sample in an assembly mode). A kernel (compiled functions) computes the columns.

        Parameters
        ----------
        keys
            The columns to compute.
        reader
            Function of the slice of rows and a list of the columns in these rows.
        row_slice
            The index of an assembly mode, and a slice of its successive rows.
        """
        mode, rows = row_slice
        all_columns = self._evaluate_kernel(rows)
        # A pole is a line with two possible senses. `_apply_signs` chooses one of them.
        self._apply_signs(all_columns, mode, rows)
        columns = [all_columns[self._find_column(key)] for key in keys]
        # Failed rows become NaN. In inaccurate rows, more accurate results replace the
        # values of the kernel.
        if np.any(self._is_replaced[rows]):
            columns = [
                self._replace_numbers(key, column, rows)
                for key, column in zip(keys, columns, strict=True)
            ]
        reader(rows, columns)

    def _find_column(self, key: ColumnKey) -> int:
        """Return the index of a column among all columns of the kernel."""
        indices = self.kernel.input_columns[key.input_index].column_indices
        return indices[key.quantity][key.subject][key.component]

    def _evaluate_kernel(self, rows: slice) -> Floats:
        """Return all columns (columns, k) of the kernel in k successive rows."""
        values = np.ascontiguousarray(self._values[:, rows])
        all_columns = np.empty((self.kernel.all_columns.width, values.shape[1]))
        self.kernel.all_columns(values, all_columns)
        return all_columns

    def _apply_signs(self, all_columns: Floats, mode: int, rows: slice) -> None:
        """Give the pole directions of the kernel their final senses, in place.

        A pole is the axis of the relative rotation of two links. It is a line, so its
        direction can have two senses. The sign functions choose the sense: on a path of
        samples, the direction is continuous. In a grid of inputs, it has a positive
        component along a fixed vector. If a direction is reversed, its derivative and the
        coefficients of velocity and acceleration change their signs, too.

        Parameters
        ----------
        all_columns
            (columns, k) all columns of the kernel (compiled functions) in k successive
            rows.
        mode
            Index of the assembly mode of the rows.
        rows
            The rows in the block (group of samples).
        """
        for find_signs, input_columns in zip(
            self._sign_functions, self.kernel.input_columns, strict=True
        ):
            # (components, poles, k). The first three components are the direction. This is
            # a view, so that the product below changes `all_columns`.
            reversible_columns = input_columns.reversible_columns(all_columns)
            signs = find_signs(reversible_columns[:3], rows, mode)
            # Most directions keep their sense in all rows of a slice.
            reversed_poles = np.flatnonzero(np.any(signs < 0, axis=1))
            for pole_index in reversed_poles:
                reversible_columns[:, pole_index] *= signs[pole_index]

    def _replace_numbers(self, key: ColumnKey, column: Floats, rows: slice) -> Floats:
        """Return a column with the right numbers in failed and in uncertified rows.

        A column has one number in each row, such as a component of the direction of a pole
        (axis of relative rotation). A row is a sample in one assembly mode. Failed rows
        have no configuration, so their numbers become NaN. In uncertified rows the errors
        of the kernel (compiled functions) may be too large. More accurate results replace
        the values of the kernel in these rows.

        Parameters
        ----------
        key
            Identifies the column: input that moves, quantity, pole or link, and component.
        column
            (k,) the values that the kernel has computed.
        rows
            The k successive rows of the block (group of samples) to which the numbers
            belong.
        """
        result = np.where(self._failed[rows], np.nan, column)
        self.uncertified_poles.put_into_column(key, result, rows)
        return result


class LazyField:
    """The poles of a motion in which one input moves, with the attributes of `PoleField`.

    A pole is the axis about which one link rotates relative to another. A kernel (compiled
    functions for many rows) computes the columns of numbers when they are read. The method
    `column` computes a single column. Reading an attribute that is not in `IN_MEMORY`
    computes all columns as arrays.

    Parameters
    ----------
    source
        The columns of the block (group of samples).
    input_index
        Index of the input that moves.
    motion
        The configurations of the block.
    is_certified
        (n,) whether the kernel certifies the row.
    errors
        Largest errors of directions, rates and their derivatives in rows of the kernel, NaN
        if there are none.

    Attributes
    ----------
    error_maxima
        The largest errors of all rows by their names in `REPORTED_ERRORS`.
    """

    IN_MEMORY = (
        "status",
        "pole_status",
        "is_quad_precision",
        "is_certified",
        "is_decimal",
        "relative_error_bound",
    )
    """Attributes of `PoleField` that are known without evaluating the kernel."""

    def __init__(
        self,
        source: KernelColumns,
        input_index: int,
        motion: Motion,
        is_certified: Bools,
        errors: Sequence[float],
    ) -> None:
        """Set the attributes that are known without evaluating the kernel.

        Parameters
        ----------
        source
            The kernel (compiled functions that evaluate the columns of many rows), with the
            rows of the block.
        input_index
            Index of the input that moves while the other inputs are locked.
        motion
            The configurations of the block: n rows.
        is_certified
            (n,) whether the kernel certifies the row. Ordinary functions have evaluated all
            other rows.
        errors
            The largest errors in certified rows, as in `REPORTED_ERRORS`.
        """
        self._source = source
        self._input_index = input_index
        self._motion = motion
        # Positions of the columns in the kernel's result, by quantity, then by pole or
        # link.
        self._column_indices = source.kernel.input_columns[input_index].column_indices
        request = source.requests[input_index]
        uncertified_poles = source.uncertified_poles
        uncertified = uncertified_poles.rows
        n = len(motion)
        self.error_maxima = dict(zip(REPORTED_ERRORS, errors, strict=True))
        # Certified rows have the status of their configuration, and no relative error.
        status = motion.status
        is_quad_precision, is_decimal = np.zeros((2, n), dtype=bool)
        relative_error_bound = np.where(motion.failed, np.nan, 0.0)
        pole_status = dict.fromkeys(self._column_indices["direction"], status)
        # The uncertified rows have the values of the ordinary functions.
        if uncertified_poles.fields:
            field = uncertified_poles.fields[input_index]
            status = _replace_rows(status, uncertified, field.status)
            relative_error_bound[uncertified] = field.relative_error_bound
            is_quad_precision[uncertified] = field.is_quad_precision
            is_decimal[uncertified] = field.is_decimal
            for pole in pole_status:
                pole_status[pole] = _replace_rows(
                    status, uncertified, field.pole_status[pole]
                )
            for name, error in largest_errors(field).items():
                self.error_maxima[name] = np.fmax(self.error_maxima[name], error)
        self._field = PoleField(
            **{name: {} for name in self._column_indices},
            status=status,
            pole_status=pole_status,
            is_quad_precision=is_quad_precision,
            is_certified=is_certified,
            is_decimal=is_decimal,
            relative_error_bound=relative_error_bound,
        )
        # Links that locked inputs hold together have no pole, and no columns of the kernel.
        for pole in set(request.poles) - pole_status.keys():
            add_locked_pole(self._field, pole)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._field if name in self.IN_MEMORY else self.as_arrays, name)

    @cached_property
    def as_arrays(self) -> PoleField:
        """All quantities of the poles as arrays, computed at the first reading.

        A pole is the axis of the relative rotation of two links.
        """
        columns = self._add_unfilled_arrays()
        # Compute all columns together, which takes less time.
        all_rows = Span(slice(0, len(self._field.status)), first_output_row=0)
        copy_columns(columns, [all_rows])
        self._add_planes()
        return self._field

    def _add_unfilled_arrays(self) -> list[tuple[LazyColumn, Floats]]:
        """Add an empty array for each quantity of each pole or link to the pole field.

        The pole field (`_field`) has all quantities of the poles and links at n
        configurations. A pole is the axis of the relative rotation of two links. The
        caller then computes the numbers of all arrays together, which takes less time than
        one array after another.

        Returns
        -------
        For each component of a quantity, the source and the destination of its numbers: a
        `LazyColumn`, which computes the n numbers when it is read, and a view (n,) of the
        array into which they are copied.
        """
        n = len(self._field.status)
        columns: list[tuple[LazyColumn, Floats]] = []
        # The subject is a pole or a link. `indices` has one item for each component of the
        # quantity.
        for quantity, indices_by_subject in self._column_indices.items():
            for subject, indices in indices_by_subject.items():
                # Successive values of a component are adjacent in memory.
                components = np.empty((len(indices), n))
                for component_index, component_values in enumerate(components):
                    key = ColumnKey(self._input_index, quantity, subject, component_index)
                    column = LazyColumn(self._source, key, n)
                    columns.append((column, component_values))
                # The field stores a vector as (n, components), and a scalar as (n,).
                is_vector = len(components) > 1
                values = components.T if is_vector else components[0]
                getattr(self._field, quantity)[subject] = values
        return columns

    def _add_planes(self) -> None:
        """Add the great circles (planes) of poles to the field.

        A pole is the axis of the relative rotation of two links. It lies on great circles
        through other poles. The kernel (compiled functions) does not compute these circles.
        The plan of the poles, which constructs poles from others, does.
        """
        request = self._source.requests[self._input_index]
        planned_poles = PlannedPoles(request.plan, self._motion)
        for pole in request.planes:
            self._field.planes[pole] = planned_poles.great_circles(pole)

    def column(self, name: str, pole: Pole, k: int) -> LazyColumn | Floats:
        """Return one component of a quantity of a pole, at all n rows.

        A pole is the axis about which one link rotates relative to another, while one input
        moves and the others are locked. A row is one sample in one assembly mode (way to
        assemble the mechanism). A kernel (compiled functions) computes most quantities when
        they are read.

        Parameters
        ----------
        name
            Name of the quantity in `PoleField`, such as ``"direction"``.
        pole
            Indices of the two links, the smaller one first.
        k
            Index of the component if the quantity is a vector, otherwise 0.

        Returns
        -------
        (n,) numbers that are computed when they are read, or an array if the kernel does
        not have the quantity.
        """
        # `_column_indices` has the quantities and poles that the kernel computes.
        is_computed_by_kernel = pole in self._column_indices.get(name, {})
        if is_computed_by_kernel:
            key = ColumnKey(self._input_index, name, pole, k)
            return LazyColumn(self._source, key, len(self._field.status))
        values: Floats = getattr(self._field, name)[pole]
        return values.reshape(len(values), -1)[:, k]


def largest_errors(field: PoleField) -> dict[str, float]:
    """Return, by name, the largest value of each error bound in `REPORTED_ERRORS`.

    It is the largest over all poles (axes of relative rotation of two links) and rows. Only
    finite bounds in rows with the status OK count. Without such a bound it is -inf.
    The report of a run states these values.
    """
    is_ok = field.status == Status.OK
    maxima = {}
    for name in REPORTED_ERRORS:
        bounds_of_poles = [
            np.max(bound, initial=-np.inf, where=is_ok & np.isfinite(bound))
            for bound in getattr(field, name).values()
        ]
        maxima[name] = max(bounds_of_poles, default=-np.inf)
    return maxima


def _replace_rows(
    codes: SmallIntegers, rows: Indices, row_codes: SmallIntegers
) -> SmallIntegers:
    """Return a copy of status codes (n,), with new codes in some rows (k,)."""
    result = codes.copy()
    result[rows] = row_codes
    return result
