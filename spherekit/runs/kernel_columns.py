"""Poles of a block that a kernel computes only when their columns are read.

A `RowKernel` evaluates all columns of a row at once. It certifies most rows. The others are
evaluated by the ordinary functions, and their numbers replace those of the kernel.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from spherekit.arrays import Bools, Floats, Indices, SmallIntegers
from spherekit.numerics.lazy_columns import LazyColumn, Reader, put
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
    """Identifies a column: one number of a pole or link at all rows of a block.

    Attributes
    ----------
    input_index
        Index of the input that moves.
    quantity
        Name of a quantity of `PoleField`, such as ``"direction"``.
    subject
        The pole or link.
    component
        Index of the component of a vector, 0 for a number.
    """

    input_index: int
    quantity: str
    subject: Any
    component: int


class UnsignedPoles(NamedTuple):
    """Poles in k rows, with directions whose sense is not chosen yet.

    A pole is the axis about which one link rotates relative to another. It is a line, and
    either of its two senses can be its direction.

    Attributes
    ----------
    directions
        (3, poles, k) unit vectors of the pole axes.
    velocities
        (3, poles, k) relative angular velocities per unit rate of the input.
    velocity_rates
        (3, poles, k) their derivatives by the input.
    """

    directions: Floats
    velocities: Floats
    velocity_rates: Floats


def split_rows(mode_count: int, sample_count: int, size: int) -> list[RowSlice]:
    """Return the rows of all modes in slices of at most `size` rows.

    The rows of a mode follow each other, `sample_count` for each mode.
    """
    return [
        (mode, slice(start, min(start + size, (mode + 1) * sample_count)))
        for mode in range(mode_count)
        for start in range(mode * sample_count, (mode + 1) * sample_count, size)
    ]


class KernelColumns:
    """The columns of a block that a kernel computes from the values of its motion.

    Directions follow their angular velocity until `set_signs` is called.

    Parameters
    ----------
    kernel
        Evaluates the rows.
    motion
        The configurations of the block.
    requests
        The poles to evaluate, for each input that moves.
    uncertified
        (k,) numbers of the rows that the kernel does not certify.

    Attributes
    ----------
    uncertified_fields
        The poles in these rows for each input; empty without such rows.
    was_read
        Whether a column was read.
    """

    def __init__(
        self,
        kernel: RowKernel,
        motion: Motion,
        requests: Sequence[Request],
        uncertified: Indices,
    ) -> None:
        """Evaluate the rows that are not certified. Columns are computed by `read`."""
        self.kernel = kernel
        self.uncertified = uncertified
        self.requests = requests
        self.uncertified_fields: list[PoleField] = []
        self.was_read = False
        self._values = motion.values.T
        self._failed = motion.failed
        # Rows whose numbers are not those of the kernel.
        self._is_replaced = motion.failed.copy()
        self._is_replaced[uncertified] = True
        mode_count = len(motion.assembly_modes)
        self._slices = split_rows(mode_count, motion.samples, SLICE_ROWS)
        self._sign_functions: Sequence[SignFunction] = ()
        if len(uncertified):
            rows = motion.rows(uncertified)
            for request, columns in zip(requests, kernel.input_columns, strict=True):
                field = evaluate_unsigned(rows, replace(request, planes=frozenset()))
                # As in the kernel, directions are first chosen so that no velocity
                # coefficient is negative.
                for pole in columns.signed_poles:
                    signs = np.where(field.velocity_coefficient[pole] < 0.0, -1.0, 1.0)
                    apply_signs(field, pole, signs)
                self.uncertified_fields.append(field)

    def unsigned_poles(self, input_index: int, rows: Indices) -> UnsignedPoles:
        """Return the poles whose sense is to be chosen, in some rows.

        They are all poles but the axes of pairs. The angular velocity of a pole is its unit
        vector u times the velocity coefficient c. Its derivative is c' u + c u'.

        Parameters
        ----------
        input_index
            Index of the input that moves.
        rows
            (k,) numbers of the rows.
        """
        input_columns = self.kernel.input_columns[input_index]
        part = input_columns.signed_part(self.kernel.all_columns(self._values[:, rows]))
        # The part is (8, poles, k): direction (3), its derivative (3), velocity coefficient
        # and acceleration coefficient.
        unit, unit_rate, (coefficient, coefficient_rate) = np.split(part, [3, 6])
        with np.errstate(invalid="ignore", over="ignore"):  # of uncertified rows
            velocity = coefficient * unit
            velocity_rate = coefficient_rate * unit + coefficient * unit_rate
        # Rows that the kernel does not certify come from the fields that replace it.
        replaced = np.flatnonzero(np.isin(rows, self.uncertified))
        if len(replaced):
            field = self.uncertified_fields[input_index]
            field_rows = np.searchsorted(self.uncertified, rows[replaced])
            # `field.w` has the angular velocity of each link, `field.dw` its derivative.
            for k, (i, j) in enumerate(input_columns.signed_poles):
                unit[:, k, replaced] = field.direction[i, j][field_rows].T
                velocity[:, k, replaced] = (field.w[j] - field.w[i])[field_rows].T
                velocity_rate[:, k, replaced] = (field.dw[j] - field.dw[i])[field_rows].T
        return UnsignedPoles(unit, velocity, velocity_rate)

    def set_signs(self, sign_functions: Sequence[SignFunction], samples: int) -> None:
        """Choose the senses of all directions.

        Parameters
        ----------
        sign_functions
            For each input, the function that returns the signs.
        samples
            Number of samples of each mode.
        """
        self._sign_functions = sign_functions
        rows = self.uncertified
        for input_index, field in enumerate(self.uncertified_fields):
            poles = self.kernel.input_columns[input_index].signed_poles
            unit = np.array([field.direction[pole].T for pole in poles])
            unit = unit.reshape(-1, 3, len(rows)).swapaxes(0, 1)
            signs = sign_functions[input_index](unit, rows, rows // samples)
            for pole, signs_of_pole in zip(poles, signs, strict=True):
                apply_signs(field, pole, signs_of_pole)

    def read(self, keys: Sequence[ColumnKey], reader: Reader) -> None:
        """Compute some columns slice by slice, and pass them to a reader.

        Parameters
        ----------
        keys
            The columns.
        reader
            Called for each slice, with the rows and the numbers of all columns there. Calls
            can come from several threads.
        """
        self.was_read = True
        # The row of each column in the result of the kernel.
        kernel_rows = [
            self.kernel.input_columns[key.input_index].column_indices[key.quantity][
                key.subject
            ][key.component]
            for key in keys
        ]

        def read_slice(row_slice: RowSlice) -> None:
            """Compute the columns of one slice."""
            mode, rows = row_slice
            values = np.ascontiguousarray(self._values[:, rows])
            computed = np.empty((self.kernel.all_columns.width, values.shape[1]))
            self.kernel.all_columns(values, computed)
            for find_signs, input_columns in zip(
                self._sign_functions, self.kernel.input_columns, strict=False
            ):
                # A view of `computed`: directions (first three rows) and what changes its
                # sign with them.
                signed = input_columns.signed_part(computed)
                signs = find_signs(signed[:3], rows, mode)
                # Most directions keep their sense in all rows of a slice.
                for k in np.flatnonzero(np.any(signs < 0, axis=1)):
                    signed[:, k] *= signs[k]
            columns = [computed[row] for row in kernel_rows]
            if np.any(self._is_replaced[rows]):
                columns = [
                    self._replace_uncertified(key, column, rows)
                    for key, column in zip(keys, columns, strict=True)
                ]
            reader(rows, columns)

        thread_map(read_slice, self._slices, self.kernel.is_compiled)

    def _replace_uncertified(self, key: ColumnKey, column: Floats, rows: slice) -> Floats:
        """Return a column of some rows with the numbers of rows that are not certified.

        Failed rows become NaN.

        Parameters
        ----------
        key
            The column.
        column
            Its numbers of the kernel.
        rows
            The rows of the block to which the numbers belong.
        """
        result = np.where(self._failed[rows], np.nan, column)
        low, high = np.searchsorted(self.uncertified, [rows.start, rows.stop])
        if low < high:
            field = self.uncertified_fields[key.input_index]
            values = getattr(field, key.quantity)[key.subject]
            values = values.reshape(len(self.uncertified), -1)
            replaced = self.uncertified[low:high] - rows.start
            result[replaced] = values[low:high, key.component]
        return result


class LazyField:
    """The poles of a motion in which one input moves, with the attributes of `PoleField`.

    A column is computed when it is read: one by one by `column`, or all as arrays when a
    quantity is read by its name.

    Parameters
    ----------
    source
        The columns of the block.
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
        """Set the attributes that are known without evaluating the kernel."""
        self._source = source
        self._input_index = input_index
        self._motion = motion
        # Rows of the kernel's result by quantity, then by pole or link.
        self._column_indices = source.kernel.input_columns[input_index].column_indices
        request = source.requests[input_index]
        uncertified = source.uncertified
        n = len(motion)
        self.error_maxima = dict(zip(REPORTED_ERRORS, errors, strict=True))
        # Certified rows have the status of their configuration, and no relative error. The
        # numbers of the other rows are then put in.
        status = motion.status
        is_quad_precision, is_decimal = np.zeros((2, n), dtype=bool)
        relative_error_bound = np.where(motion.failed, np.nan, 0.0)
        pole_status = dict.fromkeys(self._column_indices["direction"], status)
        if source.uncertified_fields:
            field = source.uncertified_fields[input_index]
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
            add_locked_pole(self._field, motion, pole)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._field if name in self.IN_MEMORY else self.as_arrays, name)

    @cached_property
    def as_arrays(self) -> PoleField:
        """The field with all columns as arrays, computed when it is first asked for."""
        # Each component of each quantity is a row of an array, which `put` fills below.
        n = len(self._field.status)
        columns: list[tuple[LazyColumn, Floats]] = []
        for quantity, indices_by_subject in self._column_indices.items():
            for subject, indices in indices_by_subject.items():
                components = np.empty((len(indices), n))
                for k, component in enumerate(components):
                    key = ColumnKey(self._input_index, quantity, subject, k)
                    columns.append((LazyColumn(self._source, key, n), component))
                values = components.T if len(components) > 1 else components[0]
                getattr(self._field, quantity)[subject] = values
        put(columns, [(slice(0, n), 0)])
        request = self._source.requests[self._input_index]
        poles = PlannedPoles(request.plan, self._motion)
        self._field.planes.update({x: poles.great_circles(x) for x in request.planes})
        return self._field

    def column(self, name: str, pole: Pole, k: int) -> LazyColumn | Floats:
        """Return one component of a quantity (n,), which is computed when it is read.

        Parameters
        ----------
        name
            Name of the quantity in `PoleField`.
        pole
            The pole.
        k
            Index of the component, 0 for a number.
        """
        if pole in self._column_indices.get(name, {}):
            key = ColumnKey(self._input_index, name, pole, k)
            return LazyColumn(self._source, key, len(self._field.status))
        values: Floats = getattr(self._field, name)[pole]
        return values.reshape(len(values), -1)[:, k]


def largest_errors(field: PoleField) -> dict[str, float]:
    """Return the largest finite `REPORTED_ERRORS` of rows with the status OK, by name.

    They are -inf if there is no such row.
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
    """Return a copy of status codes (n,) in which those of some rows (k,) are replaced."""
    result = codes.copy()
    result[rows] = row_codes
    return result
