"""Evaluation of the samples of a run by a kernel, for runs of many rows.

The kernel evaluates all columns of many rows at once. For each row it also gives error
bounds, by which rows are certified. Rows that are not certified are computed by
`PositionAnalysis` and `evaluate`, as in a run without a kernel.

A block is evaluated slice by slice, so that the arrays of a slice stay in the cache. Signs
of pole directions continue from row to row. While a slice is in the cache, the runner
therefore also notes between which rows a pole direction may reverse (`pole_reversals.py`).
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise

import numpy as np

from spherekit.arrays import Bools, Floats, Indices
from spherekit.geometry.vectors import max_abs, nans
from spherekit.positions.assembly_mode import has_configuration
from spherekit.positions.mode_predictor import ModeCurve
from spherekit.positions.motion import Motion
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.positions.sample_prediction import make_sample_predictor
from spherekit.runs.kernel_columns import (
    SLICE_ROWS,
    KernelColumns,
    LazyField,
    RowSlice,
    UncertifiedPoles,
    evaluate_unsigned_poles,
    split_rows,
)
from spherekit.runs.pole_reversals import (
    SliceReversals,
    find_compared_rows,
    find_slice_reversals,
)
from spherekit.runs.prefetch import prefetch, thread_map
from spherekit.runs.resource_checks import evaluation_memory
from spherekit.runs.sampling import Sampling
from spherekit.status import Status
from spherekit.symbolic.compiler import available
from spherekit.velocities.direction_signs import (
    ComparedRows,
    SignContinuation,
    SignFunction,
    continue_signs,
    signs_by_first_axis_sums,
)
from spherekit.velocities.dyad_expressions import find_out_of_reach, write_arguments
from spherekit.velocities.pole_request import Request
from spherekit.velocities.row_kernel import RowKernel, row_kernel

MAX_BLOCK_NEWTON_STEP_RAD = 1e-6
"""Step of Newton's method from a predicted configuration that stays in its assembly mode.

Larger: a step may reach another mode; smaller: more rows are computed without the kernel.
"""

MIN_KERNEL_ROWS = 1 << 14
"""Number of rows below which no kernel is made, as making it takes longer than it saves."""

MIN_COMPILED_ROWS = 1 << 19
"""Number of rows from which the kernel is compiled, if heyoka is installed."""

REFERENCE_SAMPLES = 64
"""Samples from which the kernel learns in which order it eliminates variables."""

BYTES_PER_NUMBER = 8
"""Size of a number of type float64 (bytes)."""

BLOCK_BYTES = 1 << 27
"""Largest size of the columns of a block, or of its rotation matrices if they are read."""

SLICE_NUMBERS = 1 << 19
"""Numbers of a slice that decide about its rows. So many stay in the cache."""

MAX_BLOCK_GROWTH = 8
"""Factor by which blocks may grow while no column is read.

Larger: an analysis that begins to read columns late then has larger blocks in memory.
"""

MAX_BLOCK_FACTOR = 32
"""Blocks that do not grow have at most this factor times the samples without a kernel."""


class BlockRows:
    """The rows of a block (group of samples) while they are computed, slice by slice.

    A row is one sample in one assembly mode (way to assemble the mechanism). The block
    first has the rows of the first mode, then the rows of the second mode, and so on. A
    slice is a part of the rows of one mode, small enough for the cache. The kernel is a set
    of compiled functions that evaluate many rows at once. It certifies a row if the error
    bounds of the row are small enough.

    Parameters
    ----------
    kernel
        Evaluates the rows.
    position_analysis
        The assembly modes, and the solver of rows that the kernel does not certify.
    q
        (inputs, n) inputs of the rows, rad.

    Attributes
    ----------
    values
        (variables, n) pair variables, rad. If the kernel has no closed form, they are
        predicted before `fill`, or NaN.
    closure_residual, configuration_error
        (n,) closure residual of each row, and the error bound of its configuration, rad.
    is_certified
        (n,) whether the row is closed and the columns of the kernel may be used.
    status
        (n,) status of each row.
    singular_error
        (n,) as in `Motion`; NaN for rows that are not solved again.
    slices
        Index of the assembly mode and rows of each slice.
    """

    def __init__(
        self, kernel: RowKernel, position_analysis: PositionAnalysis, q: Floats
    ) -> None:
        """Allocate the arrays and cut the rows into slices. `fill` computes the rows.

        A row is one sample in one assembly mode (way to assemble the mechanism). A row is
        certified if the error bounds that the kernel computes are small enough. A slice is
        a number of successive rows of one mode that are computed together.

        Parameters
        ----------
        kernel
            Compiled functions that evaluate many rows at once.
        position_analysis
            The assembly modes, and the solver for rows that the kernel does not certify.
        q
            (inputs, n) inputs of the rows, rad: all samples of the first mode, then all
            samples of the second mode, and so on.
        """
        self.kernel = kernel
        self._position_analysis = position_analysis
        self._q = q
        n = q.shape[1]
        self.closure_residual = np.empty(n)
        self.configuration_error = np.empty(n)
        # Rows count as certified, and have the status OK (0), until `fill` changes this.
        self.is_certified = np.ones(n, dtype=bool)
        self.status = np.zeros(n, dtype=np.int8)
        # Error bounds near dead centres. Rows that the position analysis does not solve
        # again keep NaN.
        self.singular_error = nans(n)
        # `values` are the pair variables (joint angles). `_column_function` computes the
        # error bounds of rows.
        variable_count = len(position_analysis.mechanism.variable_owners)
        if kernel.has_closed_form:
            # The function computes the pair variables from the inputs.
            self.values = np.empty((variable_count, n))
            self._column_function = kernel.closed_form_quality
        else:
            # The caller predicts pair variables before `fill`. NaN is no prediction.
            self.values = nans((variable_count, n))
            self._column_function = kernel.row_quality
        mode_count = len(position_analysis.assembly_modes)
        sample_count = n // mode_count
        # The results of a whole slice should fit into the processor cache.
        numbers_per_row = self._column_function.width
        slice_size = _choose_slice_size(numbers_per_row)
        self.slices = split_rows(mode_count, sample_count, slice_size)

    def fill(self, samples: Indices) -> list[SliceReversals]:
        """Compute all rows of the block, and store the results in this object.

        A row is one sample in one assembly mode (way to assemble the mechanism). Compiled
        functions compute the rows. A row is certified if its error bounds are small enough.
        The position analysis solves all other rows again, except those out of reach. The
        error bounds of the solved rows are then computed, and may certify these rows.

        Parameters
        ----------
        samples
            (k,) indices, in the whole run, of the samples of the block.

        Returns
        -------
        A list with an item for each slice that finally has certified rows. A slice has
        successive rows of one mode. The item says between which of these rows the computed
        direction of a pole may reverse. Only there, directions are compared later to make
        them continuous. A pole is the axis about which one link rotates relative to
        another.
        """
        # The result of a slice is None if some of its rows have to be solved first, or if
        # all are out of reach.
        reversals_by_slice = thread_map(
            self._fill_slice, self.slices, uses_threads=self.kernel.is_compiled
        )
        self._solve_uncertified(samples)
        examined_slices: list[SliceReversals] = []
        for row_slice, reversals in zip(self.slices, reversals_by_slice, strict=True):
            if reversals is None:
                # All rows of the slice have been solved by now, so it can be examined.
                reversals = self._examine_slice(row_slice)
            # The result is still None if no row of the slice is certified.
            if reversals is not None:
                examined_slices.append(reversals)
        return examined_slices

    @property
    def has_failed(self) -> Bools:
        """(n,) whether the row has no configuration."""
        return ~has_configuration(self.status)

    @property
    def uncertified(self) -> Indices:
        """(k,) indices of the rows that have a configuration, but are not certified."""
        return np.flatnonzero(~(self.is_certified | self.has_failed))

    def erase_failed(self) -> None:
        """Replace the numbers of rows without a configuration by NaN."""
        has_failed = self.has_failed
        self.values[:, has_failed] = np.nan
        self.closure_residual[has_failed] = np.nan
        self.configuration_error[has_failed] = np.nan

    def _solve_uncertified(self, samples: Indices) -> None:
        """Solve the rows that the kernel has not certified, except rows out of reach.

        The kernel (compiled functions for many rows) certifies rows with small error
        bounds. The position analysis solves all other rows. `samples` (k,) are the indices,
        in the whole run, of the samples of the block.
        """
        uncertified = np.flatnonzero(~self.is_certified & (self.status == Status.OK))
        if len(uncertified):
            self._solve_rows(samples, uncertified)
            self._certify_solved_rows(uncertified)
        self.is_certified &= self.status == Status.OK

    def _examine_slice(self, row_slice: RowSlice) -> SliceReversals | None:
        """Find where in a slice of rows the computed directions of poles may reverse.

        A pole is the axis of the relative rotation of two links. Its computed direction may
        reverse from row to row, because an axis has two directions. Only where it may
        reverse, directions are compared later to make them continuous.

        Only certified rows (with small error bounds) are examined. The result is None if
        the slice has no such row.
        """
        mode, slice_rows = row_slice
        rows = slice_rows.start + np.flatnonzero(self.is_certified[slice_rows])
        if not len(rows):
            return None
        # A direction may reverse where the angular velocities of links change much from row
        # to row. `row_quality` computes columns of numbers, among them these velocities.
        column_function = self.kernel.row_quality
        columns = column_function(self.values[:, rows])
        return find_slice_reversals(self.kernel, column_function, columns, mode, rows)

    def _fill_slice(self, row_slice: RowSlice) -> SliceReversals | None:
        """Compute the rows of a slice, and decide which of them are certified.

        A row is one sample in one assembly mode (way to assemble the mechanism). A slice is
        a number of successive rows of one mode. A row is certified if its loops are closed
        up to rounding, and if its error bounds are small enough.

        Parameters
        ----------
        row_slice
            The index of an assembly mode, and the indices of the rows in the block (group
            of samples).

        Returns
        -------
        The rows between which the computed direction of a pole (axis of the relative
        rotation of two links) may reverse. Only there, directions are compared later to
        make them continuous. None if rows of the slice still have to be solved, or if none
        is certified.
        """
        mode, rows = row_slice
        columns = self._evaluate_slice(mode, rows)
        if not self._is_certified_as_whole(columns):
            return self._fill_row_by_row(mode, rows, columns)
        # `is_certified` is true and `status` is OK for all rows from the beginning.
        self._store_closure(rows, columns)
        row_numbers = np.arange(rows.start, rows.stop)
        # `_column_function` has computed the columns. It knows the quantity of each
        # column.
        return find_slice_reversals(
            self.kernel, self._column_function, columns, mode, row_numbers
        )

    def _fill_row_by_row(
        self, mode: int, rows: slice, columns: Floats
    ) -> SliceReversals | None:
        """Decide for each row of a slice whether it is out of reach, or certified.

        A row is one sample in one assembly mode (way to assemble the mechanism). A row is
        out of reach if the mechanism cannot be assembled at the inputs of the row. A row is
        certified if its loops are closed and its error bounds are small enough. All other
        rows are solved later by the position analysis.

        Parameters
        ----------
        mode
            Index of the assembly mode.
        rows
            The n rows of the slice, which all belong to this mode, as a range of rows of
            the block (group of samples).
        columns
            (numbers, n) the numbers that the kernel (compiled functions) has computed for
            these rows: closure residuals, error bounds and angular velocities. The columns
            are changed in place where a step of Newton's method is taken.

        Returns
        -------
        The rows between which the computed direction of a pole (axis of relative rotation)
        may reverse. Only there, directions are compared later to make them continuous. None
        if rows of the slice still have to be solved, or if none is certified.
        """
        row_numbers = np.arange(rows.start, rows.stop)
        is_out_of_reach = self._find_out_of_reach(mode, rows, columns)
        self.status[row_numbers[is_out_of_reach]] = Status.OUT_OF_REACH
        if not self.kernel.has_closed_form:
            # Configurations were predicted by interpolation, so loops may be slightly open.
            # A step of Newton's method closes them, and changes `columns` in place.
            self._close_rows(columns, row_numbers)
        self._store_closure(rows, columns)
        is_certified = self._find_certified_rows(columns)
        self.is_certified[rows] = is_certified
        # If rows still have to be solved, the slice is examined after that.
        is_complete = np.all(is_certified | is_out_of_reach)
        if not is_complete or not np.any(is_certified):
            return None
        # `_column_function` has computed the columns. It knows the quantity of each
        # column.
        return find_slice_reversals(
            self.kernel,
            self._column_function,
            columns[:, is_certified],
            mode,
            row_numbers[is_certified],
        )

    def _store_closure(self, rows: slice, columns: Floats) -> None:
        """Store the closure residuals and the configuration errors of a slice.

        A slice is a group of successive rows. A closure residual tells how far the loops
        are open. The columns (width, n) of the n rows come from `_evaluate_slice`.
        """
        residual, error = columns[self._column_function.slices["closure"]]
        self.closure_residual[rows] = residual
        self.configuration_error[rows] = error

    def _is_certified_as_whole(self, columns: Floats) -> bool:
        """Return whether all rows of a slice are closed and have small error bounds.

        This quick test decides most slices. The columns (width, n) come from
        `_evaluate_slice`. An uncertainty is an error bound, divided by the largest one that
        is allowed.
        """
        parts = self._column_function.slices
        # The uncertainties are not negative. If their sum is at most 1, so is each of them.
        uncertainty_sum = columns[parts["uncertainty_sum"]]
        residual = columns[parts["closure"]][0]
        has_small_bounds = np.max(uncertainty_sum) <= 1.0
        return bool(has_small_bounds and np.max(residual) <= self._rounding_rad)

    def _find_certified_rows(self, columns: Floats) -> Bools:
        """Return a mask (n,) of rows closed up to rounding and with small error bounds.

        A row is one configuration.
        The columns (width, n) come from `_evaluate_slice`. An uncertainty is an error
        bound, divided by the largest one that is allowed.
        """
        parts = self._column_function.slices
        residual = columns[parts["closure"]][0]
        has_small_bounds = np.all(columns[parts["uncertainties"]] <= 1.0, axis=0)
        return has_small_bounds & (residual <= self._rounding_rad)

    @property
    def _rounding_rad(self) -> float:
        """Closure residual up to which loops count as closed."""
        return self.kernel.closure_rounding_rad

    def _evaluate_slice(self, mode: int, rows: slice) -> Floats:
        """Return the numbers that decide whether n rows need no other solver.

        The array (width, n) has a column of `width` numbers for each row, among them the
        closure residual and the error bounds. `rows` is a slice of the rows of the assembly
        mode with the index `mode`.
        """
        if self.kernel.has_closed_form:
            return self._evaluate_closed_form(mode, rows)
        return self._evaluate_predicted(rows)

    def _evaluate_closed_form(self, mode: int, rows: slice) -> Floats:
        """Compute the configurations of n rows in closed form, and store them in `values`.

        A row is one sample in one assembly mode (way to assemble the mechanism). The pair
        variables follow from the inputs and from the sign of each dyad (two links and three
        R pairs). The sign says in which of two ways the dyad is assembled.

        Parameters
        ----------
        mode
            Index of the assembly mode.
        rows
            The n rows, as a range of rows of the block (group of samples).

        Returns
        -------
        (width, n) for each row a column of `width` numbers. From its closure residual and
        its error bounds the caller decides whether the row needs another solver.
        """
        q = self._q[:, rows]
        signs = self._position_analysis.assembly_modes[mode].signs_along(q)
        arguments, columns = self._allocate_numbers(len(q) + len(signs), q.shape[1])
        write_arguments(q, signs, arguments)
        self._column_function(arguments, columns)
        self.values[:, rows] = columns[self._column_function.slices["variables"]]
        return columns

    def _evaluate_predicted(self, rows: slice) -> Floats:
        """Return the numbers that decide whether n predicted rows are good enough.

        The array (width, n) has a column of `width` numbers for each row.
        """
        values = self.values[:, rows]
        arguments, columns = self._allocate_numbers(*values.shape)
        arguments[:] = values
        self._column_function(arguments, columns)
        return columns

    def _allocate_numbers(self, argument_count: int, n: int) -> tuple[Floats, Floats]:
        """Return empty arrays for the arguments and the results of the quality function.

        The quality function computes the numbers that decide whether n rows are accurate
        enough. The two arrays are parts of one array in memory, which suits the cache of
        the processor. The arguments are (argument_count, n), the results (width, n).
        """
        numbers = np.empty((argument_count + self._column_function.width, n))
        return numbers[:argument_count], numbers[argument_count:]

    def _find_out_of_reach(self, mode: int, rows: slice, columns: Floats) -> Bools:
        """Return in which rows (n,) the mechanism cannot be assembled at the inputs.

        A row is one sample in one assembly mode (way to assemble the mechanism).

        - If configurations have a closed form (formulas), a formula says whether the two
          links of each dyad can meet.
        - Without a closed form, an assembly mode is a curve of known configurations over
          the input. Inputs beyond its ends are out of reach.

        Parameters
        ----------
        mode
            Index of the assembly mode.
        rows
            The n rows, as a range of rows of the block (group of samples).
        columns
            (width, n) the numbers that the kernel (compiled functions) has computed for
            these rows.
        """
        if not self.kernel.has_closed_form:
            return self._find_beyond_curve(mode, rows)
        # A dyad is two links with three R pairs. A formula gives the square of the triple
        # product of the three axes, from the arcs of the links and the arc between the
        # ends. If the links cannot meet, the result is negative. `columns` contains these
        # squares.
        triple_squares = columns[self._column_function.slices["squares"]]  # (dyads, n)
        return find_out_of_reach(triple_squares)

    def _find_beyond_curve(self, mode: int, rows: slice) -> Bools:
        """Return in which rows (n,) the input is beyond the end of the curve of its mode.

        With a single input, an assembly mode (way to assemble the mechanism) without a
        closed form is a curve of known configurations over this input. The curve may end
        where the mechanism can be assembled no further. The caller marks rows beyond such
        an end as out of reach.

        Parameters
        ----------
        mode
            Index of the assembly mode.
        rows
            The n rows, as a range of rows of the block (group of samples).
        """
        # Before this method is called, splines through other samples have predicted the
        # configurations of most rows. Only rows without a prediction can be beyond the end.
        has_prediction = self._has_prediction(rows)
        is_beyond = np.zeros_like(has_prediction)
        assembly_mode = self._position_analysis.assembly_modes[mode]
        # `guide` has the known configurations of the mode: a curve or a grid.
        curve = assembly_mode.guide
        # A grid has no ends, and a mode composed of pieces of other modes has no single
        # curve.
        if not isinstance(curve, ModeCurve) or assembly_mode.pieces:
            return is_beyond
        # `_q` is (inputs, rows). The curve says whether it reaches these inputs.
        inputs = self._q[:, rows][:, ~has_prediction].T
        status = curve.predict(inputs).status
        is_beyond[~has_prediction] = status == Status.OUT_OF_REACH
        return is_beyond

    def _has_prediction(self, rows: slice) -> Bools:
        """Return whether the configurations of rows (n,) were predicted by interpolation.

        Either all passive variables (not inputs) of a row are predicted or none. The first
        passive variable is tested: without a prediction it is NaN.
        """
        first_passive_variable = self.kernel.passive_variables[0]
        return ~np.isnan(self.values[first_passive_variable, rows])

    def _close_rows(self, columns: Floats, row_numbers: Indices) -> None:
        """Take a step of Newton's method at rows of a slice in which loops are not closed.

        A slice is a group of successive rows. A row is one sample in one assembly mode. The
        configurations of these rows were predicted, mostly with errors far below
        `MAX_BLOCK_NEWTON_STEP_RAD`. Newton's method reduces an error to about its square,
        so one step is enough. A larger step may lead to another assembly mode and is not
        taken.

        For these rows, the pair variables (joint angles) in the attribute `values` and the
        numbers in `columns` are changed in place.

        Parameters
        ----------
        columns
            (width, n) results of `RowKernel.row_quality`, a column for each row of the
            slice: closure residual, error bounds and angular velocities.
        row_numbers
            (n,) for each column the index, in the block, of its row.
        """
        residual = columns[self._column_function.slices["closure"]][0]
        is_open = (residual > self._rounding_rad) & np.isfinite(residual)
        open_columns = np.flatnonzero(is_open)
        if not len(open_columns):
            return
        # (variables, k) pair variables (rad) before and after the step.
        before = self.values[:, row_numbers[open_columns]]
        after = before.copy()
        passive_variables = list(self.kernel.passive_variables)
        # Only the passive variables (those that are not inputs) are corrected.
        after[passive_variables] = self.kernel.newton_step(before)
        is_small = max_abs(after - before, axis=0) < MAX_BLOCK_NEWTON_STEP_RAD
        # Rows in which the step is taken, as columns of the slice and as rows of the block.
        moved_columns = open_columns[is_small]
        moved_rows = row_numbers[moved_columns]
        moved_values = np.ascontiguousarray(after[:, is_small])
        self.values[:, moved_rows] = moved_values
        columns[:, moved_columns] = self.kernel.row_quality(moved_values)

    def _solve_rows(self, samples: Indices, rows: Indices) -> None:
        """Solve rows that the compiled functions could not certify, mode by mode.

        A row is one sample in one assembly mode (way to assemble the mechanism). The solver
        of the position analysis computes pair variables, status, closure residual and the
        error bound near dead centres. These results are stored at the rows.

        Parameters
        ----------
        samples
            (k,) indices, in the whole run, of the samples of the block.
        rows
            (m,) indices of the rows in the block, which has k rows for each assembly mode.
        """
        position_analysis = self._position_analysis
        sample_count = len(samples)
        row_modes = rows // sample_count
        for mode in np.unique(row_modes):
            mode_rows = rows[row_modes == mode]
            first_row_of_mode = mode * sample_count
            mode_samples = samples[mode_rows - first_row_of_mode]
            q = position_analysis.input_grid.q[mode_samples]
            evaluated = position_analysis.solver.evaluate(
                position_analysis.assembly_modes[mode], q, mode_samples
            )
            self.values[:, mode_rows] = evaluated.values.T
            self.status[mode_rows] = evaluated.status
            self.singular_error[mode_rows] = evaluated.singular_error
            self.closure_residual[mode_rows] = evaluated.residual

    def _certify_solved_rows(self, rows: Indices) -> None:
        """Bound the errors of rows that the position analysis has solved, and certify them.

        The kernel (compiled functions) computes the error bounds.

        Parameters
        ----------
        rows
            (m,) indices of rows in the block (group of samples). A row is one sample in one
            assembly mode. Rows without a closure residual have no configuration, and are
            left out.
        """
        solved_rows = rows[np.isfinite(self.closure_residual[rows])]
        column_function = self.kernel.row_quality
        columns = column_function(self.values[:, solved_rows])
        # The closure residual of the solver is kept, so that of the kernel is not used.
        _kernel_residual, configuration_error = columns[column_function.slices["closure"]]
        self.configuration_error[solved_rows] = configuration_error
        # Uncertainties are error bounds divided by their limits, so 1 is the limit.
        uncertainties = columns[column_function.slices["uncertainties"]]
        self.is_certified[solved_rows] = np.all(uncertainties <= 1.0, axis=0)


@dataclass(frozen=True)
class PendingPoles:
    """Facts about the poles of a block, known before the poles are computed.

    A pole is the axis about which one link rotates relative to another. Poles are computed
    when an analysis reads them. These facts are computed earlier, with the positions. A
    block has n rows: samples of all assembly modes. The kernel (compiled functions)
    computes error bounds for each row, and certifies the row if they are small enough.

    Attributes
    ----------
    is_certified
        (n,) rows that the kernel certifies.
    is_assembled
        (modes, samples) rows with a configuration. The n rows have one sample after another
        in the first mode, then those in the second mode, and so on.
    uncertified
        (k,) indices of the rows that have a configuration but are not certified.
    compared_rows_by_input
        For each input that moves: a mapping from the index of an assembly mode to rows.
        Between these rows the computed direction of a pole may jump to the opposite one. So
        directions are compared at these rows, to make them continuous. The list is empty
        for a grid of inputs, in which successive rows are not successive positions.
    error_maxima
        (inputs, 3) largest error bound in all certified rows: of directions (rad), of
        velocity coefficients and of their derivatives. NaN if no row is certified.
    """

    is_certified: Bools
    is_assembled: Bools
    uncertified: Indices
    compared_rows_by_input: Sequence[Mapping[int, ComparedRows]]
    error_maxima: Floats


def _choose_slice_size(width: int) -> int:
    """Return the number of rows of a slice, with `width` numbers that decide about a row.

    A slice has about `SLICE_NUMBERS` such numbers, which stay in the cache. It is a
    multiple of `SLICE_ROWS`, as many as the kernel evaluates in a single call.
    """
    numbers_per_call = width * SLICE_ROWS
    calls_per_slice = round(SLICE_NUMBERS / numbers_per_call)
    return max(1, calls_per_slice) * SLICE_ROWS


def _find_error_maxima(slices: Sequence[SliceReversals], input_count: int) -> Floats:
    """Return the largest errors (inputs, 3) of all slices, NaN if there are no slices."""
    maxima = nans((input_count, 3))
    for reversals in slices:
        errors = [by_input.largest_errors for by_input in reversals.by_input]
        # `fmax` ignores NaN.
        maxima = np.fmax(maxima, errors)
    return maxima


def _store_configuration_errors(motion: Motion, rows: BlockRows) -> None:
    """Store the errors of the configurations in the motion of a block (group of samples).

    The kernel (compiled functions for many rows) has computed the errors of the rows that
    it certifies. To avoid a second computation, they are stored as the cached value of the
    property `Motion.configuration_error`. In uncertified rows that property computes the
    errors.
    """
    errors = rows.configuration_error
    uncertified = rows.uncertified
    if len(uncertified):
        errors[uncertified] = motion.rows(uncertified).configuration_error
    vars(motion)["configuration_error"] = errors


@dataclass
class BatchRunner:
    """Computes the motion and the poles of blocks of samples by a kernel.

    A kernel is a set of compiled functions that evaluate all numbers of many rows at once.
    A row is one sample in one assembly mode (way to assemble the mechanism). If all groups
    of links are dyads (two links and three R pairs), the kernel computes configurations in
    closed form. Otherwise configurations of samples along a path are predicted by
    interpolation. All other configurations come from the position analysis.

    Attributes
    ----------
    sampling
        The samples of the run.
    requests
        The poles to evaluate, for each input that moves while the other inputs are locked.
        A pole is the axis about which one link rotates relative to another.
    kernel
        Evaluates the rows.
    predict
        Function that predicts configurations along a path. None if there is a closed form.
    is_recorded
        Whether the run is recorded or verified, so that rotation matrices of all links are
        read.
    looks_ahead
        Whether the next block is computed in another thread while a block is used. While a
        thread computes a block, nothing else may use the position analysis.
    needs_timing
        Whether motions have times.
    reads_frames
        Whether an analysis reads rotation matrices, which need more memory than columns.
    pending_poles
        Facts about the poles of each block that `motion_at` has returned, until `fields` is
        called for this block. The keys are the `id` of the motions, because objects with
        arrays are not hashable.
    """

    # `_latest_columns` are the poles of the block for which `fields` was called last. If no
    # column of them was read, later blocks become larger.

    sampling: Sampling
    requests: Sequence[Request]
    kernel: RowKernel
    predict: Callable[[int, int, Floats], None] | None
    is_recorded: bool
    looks_ahead: bool
    needs_timing: bool
    reads_frames: bool = False
    pending_poles: dict[int, PendingPoles] = field(default_factory=dict, repr=False)
    _latest_columns: KernelColumns | None = None

    @classmethod
    def prepare(
        cls,
        sampling: Sampling,
        requests: Sequence[Request],
        is_recorded: bool,
        looks_ahead: bool = False,
        needs_timing: bool = True,
        reads_frames: bool = False,
    ) -> "BatchRunner | None":
        """Return a runner with a kernel for a run, or None if a kernel does not help.

        A kernel is a set of compiled functions that evaluate all numbers of many rows at
        once. A kernel bounds the errors of each row, and certifies rows with small error
        bounds. All other rows are solved without it.

        Parameters
        ----------
        sampling
            The samples of the run. A row is one sample in one assembly mode (way to
            assemble the mechanism).
        requests
            The poles to evaluate, for each input that moves while the other inputs are
            locked.
        is_recorded
            Whether the run is recorded or verified.
        looks_ahead
            Whether the next block is computed in another thread while a block is used.
        needs_timing
            Whether motions need times.
        reads_frames
            Whether an analysis reads rotation matrices.

        Returns
        -------
        The runner. None in a simulation, for few rows, without poles, or if the kernel
        cannot bound the errors of this mechanism.
        """
        position_analysis = sampling.position_analysis
        row_count = len(sampling) * len(position_analysis.assembly_modes)
        if sampling.simulation is not None or row_count < MIN_KERNEL_ROWS or not requests:
            return None
        is_compiled = row_count >= MIN_COMPILED_ROWS and available()
        # The configurations at some evenly spaced samples decide in which order variables
        # are eliminated.
        reference_motion = position_analysis.sparse(REFERENCE_SAMPLES)
        kernel = row_kernel(
            reference_motion,
            requests,
            engine="compiled" if is_compiled else "numpy",
        )
        if kernel is None or not kernel.can_certify_rows:
            return None
        # Without a closed form, configurations are predicted by interpolation.
        predict = None
        if not kernel.has_closed_form:
            predict = make_sample_predictor(position_analysis)
        return cls(
            sampling=sampling,
            requests=requests,
            kernel=kernel,
            predict=predict,
            is_recorded=is_recorded,
            looks_ahead=looks_ahead,
            needs_timing=needs_timing,
            reads_frames=reads_frames,
        )

    @property
    def block_size(self) -> int:
        """Number of samples that are computed together as a block, limited by memory.

        There are two limits:

        - The columns of a block, or its rotation matrices if analyses read them, need at
          most `BLOCK_BYTES`.
        - Without this runner and its kernel, blocks have `PositionAnalysis.block` samples.
          A block of the runner has at most `MAX_BLOCK_FACTOR` times as many. If the run is
          recorded or verified (`is_recorded`), the factor is 1, because rotation matrices
          of all links need more memory.
        """
        position_analysis = self.sampling.position_analysis
        # Each sample has one row in each assembly mode (way to assemble the mechanism).
        bytes_per_sample = self._bytes_per_row * len(position_analysis.assembly_modes)
        fitting_size = BLOCK_BYTES // bytes_per_sample
        largest_size = position_analysis.block
        if not self.is_recorded:
            largest_size *= MAX_BLOCK_FACTOR
        return max(1, min(fitting_size, largest_size))

    @property
    def _bytes_per_row(self) -> int:
        """Bytes of a row: its columns, or its rotation matrices if they need more.

        `BLOCK_BYTES` limits each of the two separately, not their sum. Rotation matrices
        count only if an analysis reads them.
        """
        column_bytes = BYTES_PER_NUMBER * self.kernel.column_count
        if not self.reads_frames:
            return column_bytes
        mechanism = self.sampling.position_analysis.mechanism
        return max(column_bytes, evaluation_memory(mechanism, row_count=1))

    def blocks(self, size: int, first_sample: int = 0) -> Iterator[Motion]:
        """Yield the motion of the mechanism in blocks of successive samples.

        Most of the memory of a block is for its poles (axes of relative rotation), but only
        if an analysis reads their columns. Blocks become larger while no column is read;
        see `_choose_next_size`.

        Parameters
        ----------
        size
            Number of samples in the first block. If this is not `block_size`, all blocks
            have this size.
        first_sample
            Number of the first sample.
        """
        # A recorded run, and analyses that read rotation matrices, need memory for each row
        # even if no column of a pole is read.
        needs_memory_without_poles = self.is_recorded or self.reads_frames
        largest_size = size
        if size == self.block_size and not needs_memory_without_poles:
            largest_size = MAX_BLOCK_GROWTH * size
        samples_of_blocks = self._split_samples(first_sample, size, largest_size)
        # The next block may be computed in another thread while the caller uses a block.
        return prefetch(self.motion_at, samples_of_blocks, looks_ahead=self.looks_ahead)

    def _split_samples(
        self, first_sample: int, first_size: int, largest_size: int
    ) -> Iterator[Indices]:
        """Yield the indices (n,) of the samples of each block (group of samples) of a run.

        The columns of a block are the quantities of its poles (axes of relative rotation).
        They are computed when an analysis reads them, and only then need memory. While no
        analysis reads columns, the blocks become larger.

        Parameters
        ----------
        first_sample
            Number of the first sample.
        first_size, largest_size
            Number of samples in the first block, and the largest number in a block.
        """
        sample_count = len(self.sampling)
        start = first_sample
        size = first_size
        while start < sample_count:
            end = min(start + size, sample_count)
            yield np.arange(start, end)
            start = end
            # This is computed when the caller asks for the next block. By then, analyses
            # may have read columns of the blocks before.
            size = self._choose_next_size(size, first_size, largest_size)

    def _choose_next_size(self, size: int, first_size: int, largest_size: int) -> int:
        """Return the number of samples of the next block (group of samples).

        The quantities of poles (axes of relative rotation) are columns. A column needs
        memory only after an analysis has read it. If a column of the latest block was read,
        the next block has the size of the first one. If none was read, the size is doubled.

        Parameters
        ----------
        size, first_size, largest_size
            Number of samples in the present block, in the first one, and in the largest.
        """
        if self._latest_columns is None:
            # No block has columns yet, so it is unknown whether they will be read.
            return size
        if self._latest_columns.was_read:
            return first_size
        return min(2 * size, largest_size)

    def has_pending_poles(self, motion: Motion) -> bool:
        """Return whether `fields` can be called for a motion.

        `fields` evaluates the poles of a block (group of samples), once for each motion
        that `motion_at` has returned.
        """
        return id(motion) in self.pending_poles

    def fields(
        self, motion: Motion, sign_continuations: Sequence[SignContinuation]
    ) -> tuple[LazyField, ...]:
        """Return the poles of a block (group of samples), for each moving input.

        A pole is the axis about which one link rotates relative to another, while one input
        moves and the others are locked. A row is one sample in one assembly mode (way to
        assemble the mechanism). The kernel (compiled functions) certifies a row if its
        error bounds are small enough. Poles of certified rows are computed later, when a
        column of their numbers is read. Poles of all other rows are computed now.

        `motion_at` has stored in `pending_poles` what is known before poles are computed:
        which rows are certified, at which rows directions may reverse, and the largest
        error bounds. These facts are removed here, so each motion can be used only once.

        Parameters
        ----------
        motion
            A block of samples that `motion_at` has returned.
        sign_continuations
            For each input, the last pole directions of the previous block, in each mode.
            The directions of this block continue with the same senses. The objects are
            updated in place.

        Returns
        -------
        For each input, an object with the attributes of `PoleField`.
        """
        pending_poles = self.pending_poles.pop(id(motion))
        # The poles in all rows that are not certified are computed here. `requests` states
        # for each input which poles the analyses read.
        uncertified_poles = UncertifiedPoles(
            self.kernel, motion, self.requests, pending_poles.uncertified
        )
        # A pole is a line, so its computed direction can have either sense. For each input,
        # a function gives the signs +1 or -1 by which directions have to be multiplied. To
        # continue the signs from row to row, the function needs the uncertified rows.
        sign_functions = []
        for input_index, sign_continuation in enumerate(sign_continuations):
            sign_function = self._make_sign_function(
                motion, input_index, uncertified_poles, pending_poles, sign_continuation
            )
            sign_functions.append(sign_function)
        # The directions of the uncertified rows get their signs now. The directions of the
        # certified rows get their signs when they are computed, so `columns` keeps the
        # functions.
        uncertified_poles.apply_signs(sign_functions, motion.samples)
        columns = KernelColumns(
            self.kernel, motion, self.requests, uncertified_poles, sign_functions
        )
        # The size of the next block depends on whether these columns will be read.
        self._latest_columns = columns
        # `error_maxima` has the largest error bounds of certified rows for each input.
        return tuple(
            LazyField(columns, input_index, motion, pending_poles.is_certified, errors)
            for input_index, errors in enumerate(pending_poles.error_maxima)
        )

    def _make_sign_function(
        self,
        motion: Motion,
        input_index: int,
        uncertified_poles: UncertifiedPoles,
        pending_poles: PendingPoles,
        sign_continuation: SignContinuation,
    ) -> SignFunction:
        """Return the function that gives each pole direction its sign.

        A pole is the axis of the relative rotation of two links. It is a line, so its
        direction is known up to a sign. A row is one sample in one assembly mode (way to
        assemble the mechanism).

        - On a path of samples, signs are such that directions are continuous from row to
          row.
        - In a grid of inputs, successive rows are not successive positions of a motion. All
          directions of an assembly mode have a positive component along one vector: the sum
          of all pair axes in the first row of this mode.

        Parameters
        ----------
        motion
            A block of samples.
        input_index
            Index of the input that moves while the other inputs are locked.
        uncertified_poles
            More accurate poles for the rows in which the error bounds of the kernel
            (compiled functions) are too large.
        pending_poles
            What is known before poles are computed. Used here are the rows that have a
            configuration, and the rows at which a computed direction may jump to the
            opposite one.
        sign_continuation
            The last directions of the previous block. It is updated in place.

        Returns
        -------
        Function of pole directions and their rows. It returns the signs +1 or -1 by which
        the directions have to be multiplied.
        """
        if not motion.is_path:
            return signs_by_first_axis_sums(
                motion, pending_poles.is_assembled, sign_continuation
            )
        # Reversible poles are all poles that are no pair axis.
        reversible_poles = self.kernel.input_columns[input_index].reversible_poles
        # Function of row numbers that returns the poles in these rows. The signs of their
        # directions are still arbitrary. `continue_signs` compares the directions.
        evaluate_poles = partial(
            evaluate_unsigned_poles, self.kernel, motion, uncertified_poles, input_index
        )
        return continue_signs(
            motion,
            reversible_poles,
            pending_poles.compared_rows_by_input[input_index],
            evaluate_poles,
            sign_continuation,
        )

    def motion_at(self, samples: Indices) -> Motion:
        """Compute the positions of the mechanism at some samples, in all assembly modes.

        Facts about the poles (axes of relative rotation) are computed at the same time, and
        stored in `pending_poles`. The method `fields` needs them to compute the poles
        later. A pole is a line, so its computed direction may reverse from one sample to
        the next. The facts say, for example, where this may happen.

        Parameters
        ----------
        samples
            (n,) indices of the samples, rising.

        Returns
        -------
        The configurations at all samples in the first assembly mode, then at all samples in
        the second mode, and so on.
        """
        position_analysis = self.sampling.position_analysis
        # (inputs, rows): the rows are all samples in the first assembly mode, then all
        # samples in the second mode, and so on.
        mode_count = len(position_analysis.assembly_modes)
        q = np.tile(position_analysis.input_grid.q[samples].T, mode_count)
        rows = BlockRows(self.kernel, position_analysis, q)
        # Without a closed form, approximate configurations are first stored in `rows`.
        # `fill` then computes all rows in slices (groups of successive rows of one mode).
        # For slices with certified rows (small error bounds), it returns between which rows
        # the direction of a pole may reverse.
        self._predict_configurations(samples, rows)
        reversals_of_slices = rows.fill(samples)
        rows.erase_failed()  # replaces the numbers of rows without a configuration by NaN
        motion = self._make_motion(samples, q, rows)
        _store_configuration_errors(motion, rows)
        self.pending_poles[id(motion)] = self._collect_pole_facts(
            motion, rows, reversals_of_slices
        )
        return motion

    def _collect_pole_facts(
        self, motion: Motion, rows: BlockRows, examined_slices: Sequence[SliceReversals]
    ) -> PendingPoles:
        """Return what the method `fields` needs to compute the poles of a block later.

        A pole is the axis about which one link rotates relative to another. For each input
        that moves while the others are locked, the poles of several pairs of links are
        requested. A block is a group of samples. A row of the block is one sample in one
        assembly mode (way to assemble the mechanism).

        The result says which rows are certified (have small error bounds), at which rows
        the direction of a pole may reverse, and how large the error bounds are.

        Parameters
        ----------
        motion
            The configurations of the block.
        rows
            The same rows, with the information which of them are certified.
        examined_slices
            Results for the certified rows, one for each slice (successive rows of one mode
            in this block): the rows between which the direction of a pole may reverse, and
            the largest error bounds of poles.
        """
        # Indices of the rows with a configuration, but with too large error bounds.
        uncertified = rows.uncertified
        is_uncertified = np.zeros(len(motion), dtype=bool)
        is_uncertified[uncertified] = True
        # Rows are sorted by mode. Arrays of this shape have an axis for the modes and an
        # axis for the samples.
        shape = (len(motion.assembly_modes), motion.samples)
        # A row fails if it has no configuration, or unknown angles beside a dead centre.
        is_assembled = ~motion.failed.reshape(shape)
        is_uncertified = is_uncertified.reshape(shape)
        # `requests` has one item for each moving input.
        input_count = len(self.requests)
        # A pole is a line, so its computed direction may reverse from one row to the next.
        # At the compared rows, the direction has to be compared with the row before. In a
        # grid of inputs, successive rows are not successive positions, so no directions are
        # compared.
        compared_rows_by_input = []
        if motion.is_path:
            # Failed rows have no directions. Uncertified rows were not examined, so a
            # direction may always reverse before and after such a row.
            for input_index in range(input_count):
                compared_rows = find_compared_rows(
                    examined_slices, input_index, is_assembled, is_uncertified
                )
                compared_rows_by_input.append(compared_rows)
        return PendingPoles(
            is_certified=rows.is_certified,
            is_assembled=is_assembled,
            uncertified=uncertified,
            compared_rows_by_input=compared_rows_by_input,
            error_maxima=_find_error_maxima(examined_slices, input_count),
        )

    def _predict_configurations(self, samples: Indices, rows: BlockRows) -> None:
        """Predict the configurations of a block by splines through other samples.

        Every n-th sample of the run is solved before, and the splines go through these. A
        block is a group of samples. The method is used if configurations are not computed
        in closed form. The predicted pair variables (joint angles) are stored in `rows`.
        `BlockRows.fill` then closes the loops by a step of Newton's method.

        Parameters
        ----------
        samples
            (n,) indices of the samples, rising. Each series of successive samples is
            predicted separately.
        rows
            The rows of the block: all samples in each assembly mode.
        """
        if self.predict is None or not len(samples):
            return
        # A view (variables, modes, samples), into which the function writes.
        values = rows.values.reshape(len(rows.values), -1, len(samples))
        # A new series begins after each sample that is not followed by the next one.
        series_starts = 1 + np.flatnonzero(np.diff(samples) != 1)
        for first, end in pairwise([0, *series_starts, len(samples)]):
            first_sample = samples[first]
            end_sample = samples[end - 1] + 1
            self.predict(first_sample, end_sample, values[:, :, first:end])

    def _make_motion(self, samples: Indices, q: Floats, rows: BlockRows) -> Motion:
        """Return the computed rows of a block as a `Motion`, the form that analyses read.

        Parameters
        ----------
        samples
            (n,) indices of the samples of the block.
        q
            (inputs, modes * n) inputs (rad): all samples in the first assembly mode, then
            all samples in the second mode, and so on.
        rows
            The computed rows, in the same order.
        """
        position_analysis = self.sampling.position_analysis
        assembly_modes = position_analysis.assembly_modes
        mode_count = len(assembly_modes)
        count = len(samples)
        timing = self.sampling.timing if self.needs_timing else None
        return Motion(
            mechanism=position_analysis.mechanism,
            joints=position_analysis.solver.joints,
            assembly=position_analysis.assembly,
            assembly_modes=assembly_modes,
            samples=count,
            sample=np.tile(samples, mode_count),
            assembly_mode=np.repeat([mode.number for mode in assembly_modes], count),
            inputs=q.T,
            values=rows.values.T,
            status=rows.status,
            residual=rows.closure_residual,
            is_path=position_analysis.input_grid.is_path,
            timing=None if timing is None else timing.rows(samples).repeated(mode_count),
            singular_error=rows.singular_error,
        )
