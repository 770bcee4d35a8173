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
    """Identifies a column of a kernel: one number of a pole or link in all rows.

    A kernel is a set of compiled functions that evaluates many rows at once. A row is one
    sample in one assembly mode (way to assemble the mechanism). The rows are those of a
    block, the samples that are computed together. A pole is the axis about which one link
    rotates relative to another.

    Attributes
    ----------
    input_index
        Index of the input that moves while the others are locked.
    quantity
        Name of a quantity: an attribute of `PoleField`, which has quantities of poles and
        of links. An example is ``"direction"``.
    subject
        The pole (two link numbers) or the link (its number).
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
        (3, poles, k) derivatives of these velocities by the input.
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
    """The columns of a block, which a kernel computes from the configurations of the block.

    A kernel is a set of compiled functions that evaluate many rows at once. The direction
    of a pole is that of the relative angular velocity, until `set_signs` chooses directions
    that are continuous from row to row.

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
        The poles in the rows that are not certified, for each input. Empty if there are no
        such rows.
    was_read
        Whether a column was read. Later blocks may be longer if it is False.
    """

    def __init__(
        self,
        kernel: RowKernel,
        motion: Motion,
        requests: Sequence[Request],
        uncertified: Indices,
    ) -> None:
        """Evaluate the poles in the rows that are not certified, without the kernel.

        A row is certified if the error bounds that the kernel computes are small enough.
        The kernel computes the columns of the other rows later, when they are read.

        Parameters
        ----------
        kernel
            Compiled functions that evaluate all columns of many rows at once.
        motion
            The configurations of the block. A row is one sample in one assembly mode.
        requests
            The poles to evaluate, for each input that moves while the others are locked. A
            pole is the axis about which one link rotates relative to another.
        uncertified
            (k,) numbers of the rows that the kernel does not certify.
        """
        self.kernel = kernel
        self.uncertified = uncertified
        self.requests = requests
        self.uncertified_fields: list[PoleField] = []
        # Whether a column was read. As long as no column is read, little memory is needed,
        # so the run makes the next blocks longer.
        self.was_read = False
        # For the n rows of the block: (variables, n) pair variables (rad), and (n,) whether
        # the row has failed.
        self._values = motion.values.T
        self._failed = motion.failed
        # (n,) rows in which other numbers replace those of the kernel: NaN in failed rows,
        # and the results of ordinary functions in rows that are not certified.
        self._is_replaced = motion.failed.copy()
        self._is_replaced[uncertified] = True
        # Columns are computed for one slice of rows after another, because the results of a
        # slice stay in the cache of the processor.
        mode_count = len(motion.assembly_modes)
        self._slices = split_rows(mode_count, motion.samples, SLICE_ROWS)
        # One function for each input, which `set_signs` stores here. The function returns
        # the sign (+1 or -1) of each pole direction in some rows.
        self._sign_functions: Sequence[SignFunction] = ()

        if len(uncertified):
            rows = motion.rows(uncertified)
            for request, input_columns in zip(requests, kernel.input_columns, strict=True):
                # The great circles (planes) through poles are left out. They are computed
                # for all rows together when they are read, as the kernel has none.
                request_without_planes = replace(request, planes=frozenset())
                field = evaluate_unsigned(rows, request_without_planes)
                # A pole is a line with two senses. At first the sense is chosen so that no
                # velocity coefficient is negative, as the kernel does. `set_signs` changes
                # it so that directions are continuous along the samples.
                for pole in input_columns.reversible_poles:
                    signs = np.where(field.velocity_coefficient[pole] < 0.0, -1.0, 1.0)
                    apply_signs(field, pole, signs)
                self.uncertified_fields.append(field)

    def unsigned_poles(self, input_index: int, rows: Indices) -> UnsignedPoles:
        """Return the poles whose sense is chosen later, in some rows.

        A pole is the axis about which one link rotates relative to another: a line, with
        two senses. The sense of poles that are the axis of a pair is fixed; they are left
        out. With the unit vector u and the velocity coefficient c of a pole, the relative
        angular velocity is ``c u`` and its derivative is ``c' u + c u'``. Derivatives are
        with respect to the input. Both do not depend on the choice of the sense.

        Parameters
        ----------
        input_index
            Index of the input that moves while the others are locked.
        rows
            (k,) numbers of the rows.

        Returns
        -------
        Unit vectors u, relative angular velocities, and their derivatives.
        """
        # In the kernel, poles without a fixed sense are called reversible.
        input_columns = self.kernel.input_columns[input_index]
        quantities = input_columns.reversible_quantities(
            self.kernel.all_columns(self._values[:, rows])
        )
        # (3, poles, k) u and u', and (poles, k) c and c'.
        unit = quantities["direction"]
        unit_rate = quantities["direction_dq"]
        (coefficient,) = quantities["velocity_coefficient"]
        (coefficient_rate,) = quantities["acceleration_coefficient"]
        # A row is certified if the error bounds that the kernel computes are small enough.
        # Other rows can have NaN or huge numbers here.
        with np.errstate(invalid="ignore", over="ignore"):
            velocity = coefficient * unit
            velocity_rate = coefficient_rate * unit + coefficient * unit_rate
        # In rows that are not certified, the numbers of the kernel are replaced by those
        # that ordinary functions, without a kernel, have computed.
        replaced = np.flatnonzero(np.isin(rows, self.uncertified))
        if len(replaced):
            field = self.uncertified_fields[input_index]
            field_rows = np.searchsorted(self.uncertified, rows[replaced])
            # `field.w` has the angular velocity of each link, `field.dw` its derivative.
            for k, (i, j) in enumerate(input_columns.reversible_poles):
                unit[:, k, replaced] = field.direction[i, j][field_rows].T
                velocity[:, k, replaced] = (field.w[j] - field.w[i])[field_rows].T
                velocity_rate[:, k, replaced] = (field.dw[j] - field.dw[i])[field_rows].T
        return UnsignedPoles(unit, velocity, velocity_rate)

    def set_signs(self, sign_functions: Sequence[SignFunction], samples: int) -> None:
        """Choose the senses of all pole directions.

        A pole is the axis about which one link rotates relative to another: a line, whose
        direction has two possible signs. A row is one configuration, and the columns are
        the numbers of all poles. There are two kinds of rows:

        - In most rows compiled functions, the kernel, compute the columns as soon as they
          are read. `read` will then apply the signs.
        - In rows whose errors may be too large for the kernel (not certified), ordinary
          functions have evaluated the poles already. Their signs are applied here.

        Parameters
        ----------
        sign_functions
            For each input that moves, a function of directions (3, poles, k), row numbers
            (k,) and indices of assembly modes (k,). It returns signs +1 or -1 (poles, k).
        samples
            Number of samples of each assembly mode.
        """
        self._sign_functions = sign_functions
        rows = self.uncertified
        # The rows of a mode are successive, one for each sample.
        mode_indices = rows // samples
        # A field has the numbers of all poles in these rows, for one input that moves.
        for input_index, field in enumerate(self.uncertified_fields):
            # Poles that are the axis of a pair have the direction of the file. The others
            # get a sign.
            poles = self.kernel.input_columns[input_index].reversible_poles
            directions = np.empty((len(poles), 3, len(rows)))
            for pole_index, pole in enumerate(poles):
                directions[pole_index] = field.direction[pole].T
            signs = sign_functions[input_index](
                directions.swapaxes(0, 1), rows, mode_indices
            )
            for pole, signs_of_pole in zip(poles, signs, strict=True):
                apply_signs(field, pole, signs_of_pole)

    def read(self, keys: Sequence[ColumnKey], reader: Reader) -> None:
        """Compute some columns slice by slice, and pass them to a reader.

        A slice is a number of successive rows that fits into the cache of the processor.

        Parameters
        ----------
        keys
            The columns to compute.
        reader
            Function that is called for each slice, perhaps in several threads. Its
            arguments are the slice of rows, and a list of the numbers (k,) of each column
            in these rows.
        """
        self.was_read = True
        # The position of each column in the result of the kernel, the set of compiled
        # functions that evaluates all columns of many rows at once. A key has the name of a
        # quantity, its subject (a pole or a link), and the index of a component.
        column_indices = []
        for key in keys:
            indices = self.kernel.input_columns[key.input_index].column_indices
            column_indices.append(indices[key.quantity][key.subject][key.component])

        def read_slice(row_slice: RowSlice) -> None:
            """Compute the columns of one slice, and pass them to the reader.

            They are the columns `keys` that `read` was asked for. `column_indices` has
            their positions among all columns of the kernel.

            Parameters
            ----------
            row_slice
                The index of an assembly mode, and a slice of its successive rows.
            """
            mode, rows = row_slice
            values = np.ascontiguousarray(self._values[:, rows])
            all_columns = np.empty((self.kernel.all_columns.width, values.shape[1]))
            self.kernel.all_columns(values, all_columns)
            # The kernel gives directions in one of their two senses. The chosen signs
            # change them in place. There is a sign function for each input. Before
            # `set_signs` is called there are none, and the senses stay (strict=False).
            for find_signs, input_columns in zip(
                self._sign_functions, self.kernel.input_columns, strict=False
            ):
                # A view (components, poles, k) of the columns that change sign together.
                # The first three components are the direction. The others are its
                # derivative and the coefficients of velocity and acceleration.
                reversible_columns = input_columns.reversible_columns(all_columns)
                signs = find_signs(reversible_columns[:3], rows, mode)
                # Most directions keep their sense in all rows of a slice.
                for k in np.flatnonzero(np.any(signs < 0, axis=1)):
                    reversible_columns[:, k] *= signs[k]
            columns = [all_columns[index] for index in column_indices]
            # In these rows other numbers replace those of the kernel: NaN in failed rows,
            # and the numbers of ordinary functions where errors may be too large.
            if np.any(self._is_replaced[rows]):
                columns = [
                    self._replace_uncertified(key, column, rows)
                    for key, column in zip(keys, columns, strict=True)
                ]
            reader(rows, columns)

        thread_map(read_slice, self._slices, self.kernel.is_compiled)

    def _replace_uncertified(self, key: ColumnKey, column: Floats, rows: slice) -> Floats:
        """Return a column of some rows, with the right numbers in uncertified rows.

        The kernel, a compiled function, certifies a row if its error bounds are small
        enough. Slower functions have computed the uncertified rows (`uncertified_fields`),
        and their numbers replace those of the kernel. Failed rows become NaN.

        Parameters
        ----------
        key
            Identifies the column: input that moves, quantity, pole or link, and component.
        column
            (k,) the numbers of the kernel.
        rows
            The k successive rows of the block to which the numbers belong.
        """
        result = np.where(self._failed[rows], np.nan, column)
        # `uncertified` are the numbers of all uncertified rows, rising. Those from `low` to
        # `high` are among these rows.
        low, high = np.searchsorted(self.uncertified, [rows.start, rows.stop])
        if low < high:
            # The field has an attribute for each quantity, such as `direction`, with the
            # numbers by pole or link (`subject`).
            field = self.uncertified_fields[key.input_index]
            values = getattr(field, key.quantity)[key.subject]
            # (uncertified rows, components)
            values = values.reshape(len(self.uncertified), -1)
            positions = self.uncertified[low:high] - rows.start
            result[positions] = values[low:high, key.component]
        return result


class LazyField:
    """The poles of a motion in which one input moves, with the attributes of `PoleField`.

    A pole is the axis about which one link rotates relative to another. A kernel (compiled
    functions for many rows) computes the columns of numbers when they are read. The method
    `column` computes a single column. If an attribute of `PoleField` is read instead, all
    columns are computed as arrays.

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
        """Set the attributes that are known without evaluating the kernel.

        Parameters
        ----------
        source
            The kernel (compiled functions that evaluate the columns of many rows), with the
            rows of the block.
        input_index
            Index of the input that moves while the others are locked.
        motion
            The configurations of the block: n rows.
        is_certified
            (n,) whether the kernel certifies the row. Ordinary functions have evaluated the
            others.
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
        uncertified = source.uncertified
        n = len(motion)
        self.error_maxima = dict(zip(REPORTED_ERRORS, errors, strict=True))
        # Certified rows have the status of their configuration, and no relative error.
        status = motion.status
        is_quad_precision, is_decimal = np.zeros((2, n), dtype=bool)
        relative_error_bound = np.where(motion.failed, np.nan, 0.0)
        pole_status = dict.fromkeys(self._column_indices["direction"], status)
        # The other rows have the numbers of the ordinary functions.
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
        """The poles with all columns as arrays.

        The arrays are computed when this property is first read, and then stored.
        """
        # `_field` has no columns of numbers yet. It gets them here.
        n = len(self._field.status)
        # Allocate an array (components, n) for each quantity of each subject (a pole or a
        # link). The field gets views of these arrays, which are filled below.
        columns: list[tuple[LazyColumn, Floats]] = []
        # `_column_indices` has, by quantity and by subject, the columns of the kernel with
        # the components of the quantity.
        for quantity, indices_by_subject in self._column_indices.items():
            for subject, indices in indices_by_subject.items():
                components = np.empty((len(indices), n))
                for k, component in enumerate(components):
                    # A lazy column is computed by its source, the kernel, when it is read.
                    key = ColumnKey(self._input_index, quantity, subject, k)
                    columns.append((LazyColumn(self._source, key, n), component))
                values = components.T if len(components) > 1 else components[0]
                getattr(self._field, quantity)[subject] = values
        # Compute all columns together, which takes less time.
        all_rows = Span(slice(0, n), first_output_row=0)
        copy_columns(columns, [all_rows])
        # The kernel has no columns for the great circles (planes) in which poles are. They
        # are computed by the plan, which constructs poles from others.
        request = self._source.requests[self._input_index]
        planned_poles = PlannedPoles(request.plan, self._motion)
        for pole in request.planes:
            self._field.planes[pole] = planned_poles.great_circles(pole)
        return self._field

    def column(self, name: str, pole: Pole, k: int) -> LazyColumn | Floats:
        """Return one component of a quantity of a pole, at all n rows.

        A pole is the axis about which one link rotates relative to another. A kernel, a set
        of compiled functions, computes most quantities when they are read.

        Parameters
        ----------
        name
            Name of the quantity in `PoleField`, such as ``"direction"``.
        pole
            Numbers of the two links, the smaller one first.
        k
            Index of the component of a vector, 0 for a number.

        Returns
        -------
        (n,) numbers that are computed when they are read, or an array if the kernel does
        not have the quantity.
        """
        if pole in self._column_indices.get(name, {}):
            key = ColumnKey(self._input_index, name, pole, k)
            return LazyColumn(self._source, key, len(self._field.status))
        values: Floats = getattr(self._field, name)[pole]
        return values.reshape(len(values), -1)[:, k]


def largest_errors(field: PoleField) -> dict[str, float]:
    """Return the largest of each of the `REPORTED_ERRORS` over all poles, by name.

    Only finite errors in rows with the status OK count. The result is -inf without any.
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
