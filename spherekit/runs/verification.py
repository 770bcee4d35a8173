"""Verification of a run: some of its rows are computed again in many digits.

While the run goes on, rows are chosen: those with the largest closure residual, the largest
error bound of a pole direction and the worst conditioning, and further rows that are spread
evenly over assembly modes and samples. `spherekit.proof`, which shares no solver with the
run, computes their configurations, rates and derivatives. Each analysis is then computed
from these reference rows, and its tables are compared. If an analysis reads all samples at
once, the reference rows replace rows of the whole motion.
"""

import time
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from spherekit.arrays import Array, Floats, Indices, Integers
from spherekit.conventions import TURN, Facts
from spherekit.errors import AnalysisError, SpherekitError
from spherekit.geometry.vectors import nans
from spherekit.numerics.angles import wrap
from spherekit.numerics.array_rows import ArrayRows
from spherekit.planning.pole_plan import Pole
from spherekit.positions.motion import Motion
from spherekit.proof.balls import DEFAULT_DIGITS, Digits, centre_floats
from spherekit.proof.decimal_mechanism import read_decimals
from spherekit.proof.reference_rows import (
    ExactRows,
    exact_direction,
    exact_field,
    exact_motion,
    exact_rows_by_input,
)
from spherekit.runs.batch import ContinuedAngles, PoleFields, run_status
from spherekit.runs.contract import AbstractAnalysis
from spherekit.runs.needs import Needs
from spherekit.runs.run_plan import RunPlan, motion_rows, motion_table
from spherekit.runs.run_result import MOTION
from spherekit.runs.verification_text import BOUNDED_QUANTITIES
from spherekit.status import Status
from spherekit.storage.json_data import finite_or_none
from spherekit.tables.table import ASSEMBLY_MODE, RESIDUAL, SAMPLE, Table, TableData, arrays
from spherekit.tolerances import CLOSURE_TOLERANCE, EPS
from spherekit.velocities.pole_field import PoleField
from spherekit.velocities.pole_request import Request

GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)
"""The golden ratio less 1. The fractional parts of its multiples are spread evenly in
(0, 1), without any regular pattern that samples could share."""

MAX_ROUNDINGS = 1e4
"""Deviation of a number above which it is reported, in roundings times the conditioning.

Larger: faults of more digits pass; smaller: long chains of correct operations are reported.
"""

MAX_RESIDUAL_RATIO = 100.0
"""The same for rows of a simulation, in closure residuals times the conditioning.

Such rows close no better than the tolerance of the simulation, which is no fault.
"""


@dataclass(frozen=True)
class _BlockRows(ArrayRows):
    """Configurations of a block of samples, with their poles and continued angles.

    A pole is the axis about which one link rotates relative to another.

    Attributes
    ----------
    motion
        The configurations.
    pole_fields
        The poles, for each input that moves while the other inputs are locked.
    continued_angles
        Variables (rad) without jumps of whole revolutions, by pair.
    """

    motion: Motion
    pole_fields: tuple[PoleField, ...]
    continued_angles: ContinuedAngles

    def select_for_check(self, count: int, sample_count: int) -> "_BlockRows":
        """Return the rows of a run that will be checked by a computation in many digits.

        A row is one sample in one assembly mode (way to assemble the mechanism). The worst
        rows are checked: the rows with the largest closure residual, error bound of a pole
        direction (axis of relative rotation), and condition number of the closure Jacobian.
        Further checked rows are spread evenly over the run.

        A run is computed in blocks. After each block, rows are selected again from the
        earlier selection and the new rows.

        Parameters
        ----------
        count
            Largest number of rows that are returned.
        sample_count
            Number of samples of the run.

        Returns
        -------
        The rows, sorted by assembly mode and sample.
        """
        # The number of each row in the whole run. The order of the evenly spread rows
        # depends only on these numbers, so later blocks do not change it.
        row_numbers = self.motion.assembly_mode * sample_count + self.motion.sample
        # Indices of rows in this object, the most important rows first.
        candidates = [*self._find_worst_rows(), *order_evenly(row_numbers)]
        # A dictionary removes repeated rows and keeps the order.
        selected = np.array(list(dict.fromkeys(candidates))[:count], dtype=np.intp)
        order = np.argsort(row_numbers[selected])
        return self.rows(selected[order])

    def replace_rows(
        self, rows: Indices, source: "_BlockRows", source_rows: Indices
    ) -> "_BlockRows":
        """Return the same rows, some of them replaced by rows of another object.

        A row is one sample in one assembly mode, with its configuration and its poles (axes
        of relative rotation). The caller replaces rows of a run by the same rows computed
        in many digits. It then compares the tables of both.

        Parameters
        ----------
        rows
            (k,) indices of the rows to replace.
        source
            The object with the new rows.
        source_rows
            (k,) number in `source` of the row that replaces each of them.
        """
        # The rotations of links (`placed`) may not be computed yet. The rotations are
        # computed here, so that they can be joined with the rows of `source`.
        motion = replace(self.motion, placed=self.motion.rotations)
        joined = _BlockRows.concatenate([replace(self, motion=motion), source])
        # In the joined rows, the n rows of this object are followed by the rows of
        # `source`.
        n = len(motion)
        row_numbers = np.arange(n)
        row_numbers[rows] = n + source_rows
        result = joined.rows(row_numbers)
        # The attribute `samples` is the number of rows of each mode. The method `rows` has
        # lost it, so it is taken from this object.
        return replace(result, motion=replace(result.motion, samples=self.motion.samples))

    def _find_worst_rows(self) -> list[np.intp]:
        """Return the rows with the largest residual, error bound and condition number.

        These rows are verified, because the largest errors are expected there.

        The error bound is the largest one of all pole directions of a row.
        """
        direction_bound = nans(len(self.motion))
        for pole_field in self.pole_fields:
            for errors in pole_field.direction_error.values():
                direction_bound = np.fmax(direction_bound, errors)
        scores = (self.motion.residual, direction_bound, self.motion.conditioning)
        # NaN never counts as the largest.
        return [np.argmax(np.nan_to_num(score, nan=-1.0)) for score in scores]


def order_evenly(numbers: Integers) -> Indices:
    """Return an order of numbers in which the first numbers are spread evenly over all.

    Rows of a run are selected for checks in this order. A number k is sorted by the
    fractional part of (k + 1) g, where g is 0.618... (`GOLDEN`, the golden ratio less 1).
    For successive k, these parts are spread evenly from 0 to 1. The order of two numbers
    depends only on these two. So it stays the same if other numbers are added.

    Parameters
    ----------
    numbers
        (n,) whole numbers, 0 or more.

    Returns
    -------
    (n,) indices of the numbers.
    """
    # With k instead of k + 1, the fractional part of the number 0 would be 0, and 0 would
    # always be the first number.
    fractional_parts = (numbers + 1) * GOLDEN % 1.0
    return np.argsort(fractional_parts)


@dataclass(frozen=True)
class ReferenceRows:
    """Reference values of configurations and poles, computed in many digits.

    They serve to measure the errors of a run.

    Attributes
    ----------
    exact
        Values in many digits, for each input that moves while the other inputs are locked.
    motion
        The configurations, rounded from these values to float64.
    pole_fields
        The poles of each input, rounded in the same way. A pole is the axis about which one
        link rotates relative to another.
    """

    exact: tuple[ExactRows, ...]
    motion: Motion
    pole_fields: tuple[PoleField, ...]


def compute_reference(
    motion: Motion,
    requests: Sequence[Request],
    pole_fields: Sequence[PoleField],
    arithmetic: Digits | None = None,
    inputs: Array | None = None,
) -> ReferenceRows:
    """Compute configurations and poles in many digits, as a reference for a run.

    A pole is the axis about which one link rotates relative to another, while one input
    moves and the other inputs are locked.

    Parameters
    ----------
    motion
        The n configurations of the run.
    requests
        The poles of the run: one request for each moving input. Without requests, the first
        input moves.
    pole_fields
        The computed poles: one field for each request.
    arithmetic
        The number of digits; see `exact_rows_by_input`, which also lists the errors that
        can be raised.
    inputs
        (n, inputs) inputs in more digits than float64. By default the values of the motion.
    """
    all_rows = np.ones(len(motion), dtype=bool)
    input_pairs = [request.plan.input for request in requests]
    if not input_pairs:
        input_pairs = list(motion.assembly.inputs[:1])
    frames = None  # the reference then uses the dimensions rounded to float64
    if _has_decimal_rows(pole_fields):
        # Near a dead centre, the run has used the decimal dimensions of the file, and so
        # does the reference. `frames` has the axes and zero directions of all R pairs.
        arithmetic = arithmetic or Digits()
        with arithmetic.within():
            frames = read_decimals(motion.mechanism).revolute_frames()
    exact = exact_rows_by_input(
        motion, all_rows, input_pairs, arithmetic, inputs=inputs, frames=frames
    )
    # The configurations are the same for all moving inputs.
    return ReferenceRows(
        exact=exact,
        motion=exact_motion(motion, all_rows, exact[0]),
        pole_fields=tuple(map(exact_field, exact, requests, pole_fields)),
    )


def _has_decimal_rows(pole_fields: Iterable[PoleField]) -> bool:
    """Return whether a run has rows that were computed from decimal sizes.

    These are the sizes of the mechanism as they are written in the file.

    Near a dead centre, rounding the sizes to float64 changes the poles noticeably. A run
    computes such rows from the decimal sizes, so the reference of these rows uses the
    decimal sizes.
    """
    return any(np.any(pole_field.is_decimal) for pole_field in pole_fields)


@dataclass(frozen=True)
class _TablePair:
    """Rows of a table of an analysis as the run gives them, and from reference rows."""

    analysis_name: str
    table: Table
    rows: TableData
    reference: TableData


class Verifier:
    """Verifies a run: some of its rows are computed again in many digits and compared.

    A row is one sample of one assembly mode. The rows are chosen during the run, block by
    block, and verified at its end.

    Parameters
    ----------
    run_plan
        What the run evaluates.
    count
        Number of rows to verify.
    """

    def __init__(self, run_plan: RunPlan, count: int) -> None:
        """Begin without selected rows; see the class for the arguments."""
        self._run_plan = run_plan
        self._sampling = run_plan.sampling
        self._requests = [item for item in run_plan.requests if item.poles]
        self._count = count
        self._selected: _BlockRows | None = None
        # All rows of the run, if an analysis reads them at once.
        self._whole: _BlockRows | None = None

    def select_from_block(
        self,
        motion: Motion,
        pole_fields: PoleFields,
        continued_angles: ContinuedAngles,
    ) -> None:
        """Select rows of a block that may be verified at the end of the run.

        Verification compares rows of the run (samples in assembly modes) with values that
        are computed in many digits. `_count` rows are verified: those with the largest
        residuals, error bounds and condition numbers, and further rows spread evenly over
        the run. After each block they are selected anew, from the earlier selection and the
        rows of the block. So only few rows are in memory.

        Parameters
        ----------
        motion
            The configurations of the block.
        pole_fields
            The poles of the block, for each input that moves while the other inputs are
            locked. A pole is the axis about which one link rotates relative to another.
        continued_angles
            Variables (rad) without jumps of whole revolutions, by pair.
        """
        block_rows = _BlockRows(
            motion, tuple(field.as_arrays for field in pole_fields), continued_angles
        )
        # Some analyses (`whole_analyses`) read all samples at once. A run with such an
        # analysis has a single block, which is stored. At the end, values in many digits
        # replace the verified rows in this block. From the changed block, the tables of
        # these analyses are computed again, to compare them with the tables of the run.
        if self._run_plan.whole_analyses:
            self._whole = block_rows
        is_valid = run_status(motion, block_rows.pole_fields) == Status.OK
        if not np.any(is_valid):
            return
        # The number of samples of the whole run, over which rows are spread evenly.
        sample_count = len(self._sampling)
        selected = block_rows.rows(is_valid).select_for_check(self._count, sample_count)
        if self._selected is not None:
            selected = _BlockRows.concatenate([self._selected, selected])
        self._selected = selected.select_for_check(self._count, sample_count)

    def verify(self, failed: Collection[str] = ()) -> Facts:
        """Compute the selected rows in many digits, and compare the tables of all analyses.

        Parameters
        ----------
        failed
            Names of analyses that failed in the run. They are not verified. The same holds
            for analyses that fail here, that find configurations themselves, or that have
            other rows with the reference values.

        Returns
        -------
        dict
            The result, ready for JSON. ``columns`` has the largest deviation of each table
            column and its row; angles are compared within one revolution.
            ``in_roundings`` is the largest quotient of a deviation and the error that
            rounding can cause. This error is ``EPS * max(1, |value|) * condition``, with
            the condition number of the row; ``worst`` has the row of this quotient.
            ``beyond`` lists the columns with deviations that rounding does not explain. If
            the reference cannot be computed, ``problem`` says why.
        """
        start_time = time.perf_counter()
        verification: Facts = {"digits": DEFAULT_DIGITS, "rows": 0, "not_verified": []}
        selected = self._selected
        if selected is None:
            return verification
        motion = selected.motion
        try:
            reference = compute_reference(
                motion, self._requests, selected.pole_fields, Digits(DEFAULT_DIGITS)
            )
        except SpherekitError as error:
            return verification | {"problem": str(error)}
        exact = reference.exact
        # A row has a reference only if it has one for every input that moves. So the worst
        # status of all inputs counts.
        status = np.max([rows.status for rows in exact], axis=0)
        # Used by the methods below.
        self._motion = motion
        self._condition = exact[0].condition
        self._has_reference = status == Status.OK
        reference_rows = _BlockRows(
            reference.motion,
            reference.pole_fields,
            _add_revolutions(reference.motion, selected.continued_angles),
        )

        pairs = [
            _TablePair(
                MOTION,
                motion_table(self._sampling),
                motion_rows(self._sampling, motion, selected.pole_fields),
                motion_rows(self._sampling, reference.motion, reference.pole_fields),
            )
        ]
        run_plan = self._run_plan
        for analysis, needs in zip(run_plan.analyses, run_plan.needs, strict=True):
            # Such an analysis reads no configurations of the run, so that no reference for
            # its tables can be computed from verified rows.
            reads_no_rows = needs.tracer or needs == Needs(time=needs.time)
            try:
                if analysis.name in failed or reads_no_rows:
                    raise AnalysisError(
                        "the analysis failed, or its tables do not follow from the "
                        "verified rows"
                    )
                pairs += self._table_pairs(analysis, selected, reference_rows)
            except SpherekitError:
                verification["not_verified"].append(analysis.name)

        compared_columns = [facts for pair in pairs for facts in self._compare_table(pair)]
        return verification | {
            "rows": len(motion),
            "without_reference": [
                {
                    "sample": int(motion.sample[row]),
                    "assembly_mode": int(motion.assembly_mode[row]),
                    "status": Status(status[row]).name,
                    "distance_rad": finite_or_none(exact[0].distance[row]),
                }
                for row in np.flatnonzero(~self._has_reference)
            ],
            "largest_condition": _largest(exact[0].condition),
            "largest_distance_rad": _largest(exact[0].distance),
            **_summarize_columns(compared_columns),
            **self._count_within_bounds(selected.pole_fields, reference),
            "seconds": time.perf_counter() - start_time,
        }

    def _table_pairs(
        self,
        analysis: AbstractAnalysis,
        selected: _BlockRows,
        reference_rows: _BlockRows,
    ) -> list[_TablePair]:
        """Compute the tables of an analysis twice: from run rows and from reference rows.

        A row is one sample in one assembly mode. Usually an analysis computes each row by
        itself, and the verified rows are enough. An analysis that reads all samples of a
        run at once (`at_once`) needs all rows. The verified rows among them are then
        replaced by reference rows.

        Parameters
        ----------
        analysis
            The analysis.
        selected
            The verified rows as the run has computed them.
        reference_rows
            The same rows, computed in many digits.

        Returns
        -------
        For each declared table its columns by the run, and by the reference.

        Raises
        ------
        AnalysisError
            If a table has other samples or assembly modes with the reference values.
        """
        # `_whole` has all rows of the run. None if no analysis needs them.
        if analysis.at_once and self._whole is not None:
            reference_rows = self._put_into_whole(self._whole, reference_rows)
            selected = self._whole
        tables = self._compute_tables(analysis, selected)
        reference_tables = self._compute_tables(analysis, reference_rows)
        # An analysis of whole motions may choose rows by their values. With reference
        # values these can be other rows, which cannot be compared.
        for table in self._run_plan.tables_of(analysis):
            both = [arrays(tables[table.name]), arrays(reference_tables[table.name])]
            if table.in_assembly_modes and not all(
                np.array_equal(both[0][key.name], both[1][key.name])
                for key in (SAMPLE, ASSEMBLY_MODE)
            ):
                raise AnalysisError(
                    f"{analysis.name}: {table.name} has other rows with reference values"
                )
        return [
            _TablePair(
                analysis.name, table, tables[table.name], reference_tables[table.name]
            )
            for table in self._run_plan.tables_of(analysis)
        ]

    def _compute_tables(
        self, analysis: AbstractAnalysis, rows: _BlockRows
    ) -> dict[str, TableData]:
        """Return the tables of an analysis at some rows, by name."""
        batch = self._run_plan.make_batch(
            analysis, rows.motion, rows.pole_fields, rows.continued_angles
        )
        return self._run_plan.compute_tables(analysis, batch)

    def _find_verified_rows(self, assembly_mode: Array, sample: Array) -> Indices:
        """Return, for given assembly modes and samples, which verified row has them.

        The verified rows are the rows of the run that are computed again in many digits.

        Parameters
        ----------
        assembly_mode, sample
            (n,) index of the assembly mode, and index of the sample.

        Returns
        -------
        (n,) indices of verified rows, -1 where there is none.
        """
        # NumPy sorts complex numbers by their real part first. So mode + i sample is a key
        # in the order of the verified rows.
        verified = self._motion.assembly_mode + 1j * self._motion.sample
        keys = assembly_mode + 1j * sample
        row = np.minimum(np.searchsorted(verified, keys), len(verified) - 1)
        return np.where(verified[row] == keys, row, -1)

    def _put_into_whole(self, whole: _BlockRows, reference_rows: _BlockRows) -> _BlockRows:
        """Return all rows of the run, with reference values in the verified rows.

        A row is one sample in one assembly mode. Verified rows are computed again in many
        digits. The caller passes the result to an analysis that needs all rows at once, and
        compares its tables with those of the run.

        Parameters
        ----------
        whole
            All rows as the run has computed them.
        reference_rows
            The verified rows, computed in many digits.
        """
        motion = whole.motion
        # For each row of the run the index of its verified row, or -1 without such a row.
        verified_rows = self._find_verified_rows(motion.assembly_mode, motion.sample)
        replaced = np.flatnonzero(verified_rows >= 0)
        # In some verified rows, no solution in many digits was found.
        replaced = replaced[self._has_reference[verified_rows[replaced]]]
        return whole.replace_rows(replaced, reference_rows, verified_rows[replaced])

    def _compare_table(self, pair: _TablePair) -> Iterator[Facts]:
        """Yield the largest deviation in each numeric column of a table.

        See `verify` for the keys of a result. A deviation counts in roundings: it is
        divided by the rounding error of the value and by the condition number of the row.
        """
        table = pair.table
        if not table.in_assembly_modes:
            return
        rows = arrays(pair.rows)
        # For each row of the table the index of its verified row, or -1 without such a row.
        row = self._find_verified_rows(rows[ASSEMBLY_MODE.name], rows[SAMPLE.name])
        is_verified = row >= 0
        if not np.any(is_verified):
            return
        row = row[is_verified]
        values_by_column = {name: values[is_verified] for name, values in rows.items()}
        reference_by_column = {
            name: values[is_verified] for name, values in arrays(pair.reference).items()
        }
        # Allowed roundings of each verified row. Rows of simulations close less well.
        residual = self._motion.residual
        allowed = MAX_ROUNDINGS + np.where(
            residual > CLOSURE_TOLERANCE, MAX_RESIDUAL_RATIO * residual / EPS, 0.0
        )
        text_columns = [c.name for c in table.columns if c.kind == "text"]
        has_reference = self._has_reference[row]

        for column in table.columns:
            # Residuals are not compared: the residual of the reference only shows its own
            # rounding.
            if column.kind != "number" or column == RESIDUAL:
                continue
            values = np.where(has_reference, values_by_column[column.name], np.nan)
            reference = np.where(has_reference, reference_by_column[column.name], np.nan)
            deviation = np.abs(values - reference)
            if column.unit == "rad":
                deviation = np.abs(wrap(deviation))
            rounding = EPS * np.maximum(1.0, np.abs(reference))
            roundings = deviation / (rounding * self._condition[row])
            is_compared = bool(np.any(np.isfinite(deviation)))
            is_beyond = roundings > allowed[row]
            # A value with an error bound may deviate by up to this bound. Near
            # singularities derivatives lose more digits than the condition number tells.
            bounds = values_by_column.get(f"{column.name}_error_bound")
            if bounds is not None:
                is_beyond &= ~(deviation <= bounds)

            # Default values are evaluated now, so that the function uses the arrays of this
            # column.
            def describe(
                index: Any, values: Floats = values, reference: Floats = reference
            ) -> Facts:
                """Return sample and mode of a row, its value and the reference value."""
                return {
                    "sample": int(values_by_column["sample"][index]),
                    "assembly_mode": int(values_by_column["assembly_mode"][index]),
                    "subject": {
                        name: str(values_by_column[name][index]) for name in text_columns
                    },
                    "value": finite_or_none(values[index]),
                    "reference": finite_or_none(reference[index]),
                }

            yield {
                "analysis": pair.analysis_name,
                "table": table.name,
                "column": column.name,
                "unit": column.unit,
                # A column that is NaN at all rows in the run counts as compared.
                "compared": is_compared or not np.any(np.isfinite(values)),
                "deviation": _largest(deviation),
                **describe(np.nanargmax(deviation) if is_compared else 0),
                "in_roundings": _largest(roundings),
                "beyond": bool(np.any(is_beyond)),
                "worst": describe(np.nanargmax(roundings) if is_compared else 0),
                "given_by_one_alone": int(np.sum(np.isnan(values) != np.isnan(reference))),
            }

    def _count_within_bounds(
        self, pole_fields: Sequence[PoleField], reference: ReferenceRows
    ) -> dict[str, Facts]:
        """Count for each quantity how many numbers have errors within their error bounds.

        A pole is the axis about which one link rotates relative to another. A run gives
        error bounds for pole directions, rates and their derivatives. Here the true errors
        are known from a reference in many digits.

        Parameters
        ----------
        pole_fields
            The poles of the verified rows as the run has computed them, for each input that
            moves while the other inputs are locked.
        reference
            The reference values of these rows.

        Returns
        -------
        By name of the quantity: the number of checked numbers, how many of them are within
        their bound, and the number with the largest ratio of error to bound.
        """
        facts_by_quantity: dict[str, Facts] = {
            name: {"count": 0, "within_bound": 0} for name in BOUNDED_QUANTITIES
        }
        motion = self._motion
        links = motion.mechanism.links
        for exact, request, pole_field, reference_field in zip(
            reference.exact,
            self._requests,
            pole_fields,
            reference.pole_fields,
            # If no poles are requested, the values that the reference has for the first
            # input are skipped.
            strict=False,
        ):
            moving = motion.mechanism.pairs[exact.driven].name
            for pole in request.poles:
                errors_by_quantity = _pole_errors(exact, pole_field, reference_field, pole)
                for name, error in errors_by_quantity.items():
                    facts = facts_by_quantity[name]
                    bound = getattr(pole_field, BOUNDED_QUANTITIES[name].bound)[pole]
                    is_checked = (
                        self._has_reference & np.isfinite(error) & np.isfinite(bound)
                    )
                    # (n,) ratios; -1 in rows that are not checked. A bound of 0 belongs to
                    # an error of 0. `EPS**2` avoids the division by 0.
                    ratio = error / np.maximum(bound, EPS**2)
                    ratio = np.where(is_checked, ratio, -1.0)
                    facts["count"] += int(np.sum(is_checked))
                    facts["within_bound"] += int(np.sum(is_checked & (ratio <= 1.0)))
                    row = np.argmax(ratio)
                    if ratio[row] > facts.get("over_bound", -1.0):
                        facts |= {
                            "over_bound": float(ratio[row]),
                            "error": float(error[row]),
                            "bound": float(bound[row]),
                            "sample": int(motion.sample[row]),
                            "assembly_mode": int(motion.assembly_mode[row]),
                            "subject": {
                                "link": links[pole[1]],
                                "relative_to": links[pole[0]],
                                "moving": moving,
                            },
                        }
        return facts_by_quantity


def _pole_errors(
    exact: ExactRows, pole_field: PoleField, reference_field: PoleField, pole: Pole
) -> dict[str, Floats]:
    """Return the errors of the quantities of a pole in n rows, against a reference.

    A pole is the axis about which one link rotates relative to another. The error of a
    vector is the length of the difference from its reference.

    Parameters
    ----------
    exact
        Reference values in many digits.
    pole_field
        The poles of the run.
    reference_field
        The reference values, rounded to float64.
    pole
        Indices of the two links.

    Returns
    -------
    Errors (n,) by name of the quantity: directions (rad), rates (velocity coefficients),
    and derivatives of both with respect to the input (1/rad).
    """
    # Errors of directions are as small as the rounding error of float64. The difference is
    # therefore computed in more digits and then rounded. `exact_direction` has the sense of
    # the run's direction, and its numbers are balls (a centre with an error bound).
    with exact.arithmetic.within():
        direction = pole_field.direction[pole]
        direction_error = centre_floats(exact_direction(exact, pole, direction) - direction)
    # All other quantities have larger errors, so the rounded reference is enough.
    rate_error = (
        pole_field.velocity_coefficient[pole] - reference_field.velocity_coefficient[pole]
    )
    rate_derivative_error = (
        pole_field.acceleration_coefficient[pole]
        - reference_field.acceleration_coefficient[pole]
    )
    direction_derivative_error = (
        pole_field.direction_dq[pole] - reference_field.direction_dq[pole]
    )
    return {
        "directions": np.linalg.norm(direction_error, axis=1),
        "rates": np.abs(rate_error),
        "rate_derivatives": np.abs(rate_derivative_error),
        "direction_derivatives": np.linalg.norm(direction_derivative_error, axis=1),
    }


def _add_revolutions(motion: Motion, continued_angles: ContinuedAngles) -> ContinuedAngles:
    """Return the variables of a motion with the whole revolutions of continued angles."""
    result = {}
    for name, angle in continued_angles.items():
        (number,) = motion.mechanism.variables_of(motion.mechanism.pair_number[name])
        value = motion.values[:, number]
        result[name] = value + TURN * np.round((angle - value) / TURN)
    return result


def _summarize_columns(columns: Sequence[Facts]) -> Facts:
    """Return the comparison of all columns with reference values, for the summary.

    Parameters
    ----------
    columns
        For each column:

        - its table and name;
        - ``compared``: whether it was compared. A column is not compared if it has values,
          but only in rows without a reference value;
        - ``in_roundings``: the largest ratio of a deviation (from the reference value) to
          the error that rounding can cause. This error is the rounding error of the value,
          times the condition number of the row;
        - ``worst``: the row with the largest ratio;
        - ``beyond``: whether the ratio is too large to be explained by rounding.

    Returns
    -------
    The compared columns, the names of the other columns, the column and row with the
    largest ratio, and the names of the columns that deviate by more than rounding.
    """
    # There is at least one compared column, since the configurations are always compared.
    compared = [item for item in columns if item["compared"]]
    worst = max(compared, key=lambda item: item["in_roundings"])

    def name(item: Facts) -> str:
        """Return the name of a column with the name of its table."""
        return f"{item['table']}.{item['column']}"

    return {
        "columns": compared,
        "not_recomputed": [name(item) for item in columns if not item["compared"]],
        "worst": {
            "column": name(worst),
            "in_roundings": worst["in_roundings"],
            **worst["worst"],
        },
        "beyond": [name(item) for item in compared if item["beyond"]],
    }


def _largest(values: Floats) -> float:
    return float(np.nanmax(values, initial=0.0))
