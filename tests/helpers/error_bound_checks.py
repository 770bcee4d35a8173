"""Compares the errors of configurations and poles with the bounds that spherekit states.

The reference is `spherekit.proof.reference_rows`: the same loops closed in more digits.
"""

from dataclasses import dataclass, field
from typing import final

import numpy as np
from mechanism_examples.special_mechanisms import special_mechanism

from spherekit.arrays import Bools
from spherekit.errors import SpherekitError
from spherekit.geometry.rotation import Floats
from spherekit.planning.pole_plan import all_poles
from spherekit.positions.motion import Motion
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.proof.ball_frames import exact_balls
from spherekit.proof.balls import MIN_DIGITS, Digits, centre_floats
from spherekit.proof.decimal_mechanism import read_decimals
from spherekit.proof.reference_rows import exact_direction, exact_field, exact_rows_by_input
from spherekit.status import Status
from spherekit.velocities.pole_evaluation import evaluate
from spherekit.velocities.pole_field import PoleField
from spherekit.velocities.pole_request import Request, request

TINY = 1e-30
"""Bounds below this number are replaced by it.

A bound of 0 belongs to a number that is exactly 0. The reference of this number is rounded,
and can therefore differ from 0 by less than `TINY`.
"""

KINDS = ("configurations", "directions", "rates", "derivatives", "direction derivatives")
"""Quantities with an error bound.

Variables of the configuration (rad), pole directions (unit vectors), velocity and
acceleration coefficients of poles, and derivatives of pole directions by the input.
"""
"""What errors are stated of."""


@final
@dataclass
class ErrorComparison:
    """Errors of numbers in rows with status OK, and the bounds stated for them.

    Attributes
    ----------
    error, bound
        Per kind of `KINDS` a list of arrays, with one error and one bound per number.
    rows
        Number of rows with status OK. A row is one configuration with one of its inputs
        moving alone.
    pole_rows
        Number of these rows times number of poles.
    failed_rows
        Number of rows with another status than OK, which are not compared.
    rows_without_reference
        Number of rows for which the reference could not be computed.
    rows_in_50_digits
        Number of rows whose reference was computed in 50 digits.
    missing_numbers
        Number of coefficients and bounds that are NaN although their row is OK.
    """

    error: dict[str, list[Floats]] = field(default_factory=lambda: {k: [] for k in KINDS})
    bound: dict[str, list[Floats]] = field(default_factory=lambda: {k: [] for k in KINDS})
    rows: int = 0
    pole_rows: int = 0
    failed_rows: int = 0
    rows_without_reference: int = 0
    rows_in_50_digits: int = 0
    missing_numbers: int = 0

    def errors_and_bounds(self, kind):
        """Return the errors (n,) and the bounds (n,) of a kind."""
        nothing = [np.empty(0)]
        errors = np.concatenate(self.error[kind] or nothing)
        bounds = np.concatenate(self.bound[kind] or nothing)
        return errors, bounds

    def error_ratios(self, kind):
        """Return (n,) errors divided by their bounds; at most 1 if the bounds are right."""
        errors, bounds = self.errors_and_bounds(kind)
        # A bound of 0 is replaced by a number far below any rounding of float64.
        return errors / np.maximum(bounds, TINY)

    def add(self, comparison):
        """Append the numbers and counts of another comparison."""
        for kind in KINDS:
            self.error[kind] += comparison.error[kind]
            self.bound[kind] += comparison.bound[kind]
        for name in (
            "rows",
            "pole_rows",
            "failed_rows",
            "rows_without_reference",
            "rows_in_50_digits",
            "missing_numbers",
        ):
            setattr(self, name, getattr(self, name) + getattr(comparison, name))


def judge_bounds(mechanism, path, **options):
    """Assert that every number in a row with status OK has an error bound that holds.

    A row is one configuration with one of its inputs moving alone.

    Parameters
    ----------
    mechanism
        Mechanism that is moved along the path.
    path
        Inputs (samples, inputs) in rad.
    options
        Keyword arguments of `compare_errors_with_bounds`.

    Returns
    -------
    ErrorComparison
        Errors and bounds; empty if the loops of the mechanism close nowhere.
    """
    try:
        position_analysis = PositionAnalysis(mechanism, path=path)
    except SpherekitError:  # the loops close nowhere
        return ErrorComparison()
    with np.errstate(all="ignore"):
        comparison = compare_errors_with_bounds(position_analysis, **options)
    assert comparison.missing_numbers == 0
    assert comparison.rows_without_reference == 0
    for kind in KINDS:
        assert np.all(comparison.error_ratios(kind) <= 1.0), kind
    return comparison


def compare_special_mechanism(seed):
    """Compare errors and their stated bounds for the special mechanism of a seed.

    It is a four-bar, perhaps with dyads (two links joined by a pair) added. Its geometry is
    special or nearly so, such as equal arcs.

    Each row (one sample of one mode) is compared with a reference in few digits. A row with
    an error near or beyond its bound is compared again in 50 digits. So is every 50th row.

    Returns
    -------
    family
        Number of links and kind of the special geometry, in words.
    comparison
        `ErrorComparison`; empty if the loops close nowhere.
    """
    family, mechanism, path = special_mechanism(seed)
    try:
        position_analysis = PositionAnalysis(mechanism, path=path)
    except SpherekitError:
        return family, ErrorComparison()
    # Warnings of NumPy are ignored: failed rows hold NaN, which the comparison leaves out.
    with np.errstate(all="ignore"):
        # `as_written`: the reference has the sizes in the decimal digits of a file, which
        # float64 only approximates. The bounds must cover this rounding too.
        comparison = compare_errors_with_bounds(
            position_analysis, as_written=True, every=50
        )
    return family, comparison


def compare_errors_with_bounds(position_analysis, as_written=False, every=0):
    """Compare all rows of a motion that have status OK with their reference.

    A row is one configuration with one of its inputs moving alone. The reference solves the
    same loops in more digits.

    Parameters
    ----------
    position_analysis
        Position analysis whose motion is evaluated, one input moving at a time.
    as_written
        Whether rows are also compared with the mechanism whose sizes are the decimal
        numbers of the file, without rounding to float64.
    every
        The reference first has few digits. A row is compared again in 50 digits if its
        error is near its bound or beyond. With a number k, also one of k other rows is
        compared again; with 0, none is.

    Returns
    -------
    ErrorComparison
        Errors and bounds of all numbers.
    """
    motion = position_analysis.motion()
    mechanism = motion.mechanism
    poles = all_poles(len(mechanism.links))
    comparison = ErrorComparison()
    for moving_input in motion.assembly.inputs:
        # Directions and velocity coefficients of all poles. `by_rank` says that the
        # mobility follows from the rank of the velocity equations, not from counting.
        pole_request = request(
            mechanism,
            mechanism.pairs[moving_input].name,
            poles=poles,
            rates=poles,
            by_rank=position_analysis.by_rank,
        )
        field = evaluate(motion, pole_request)
        is_ok = field.status == Status.OK
        comparison.failed_rows += int(np.sum(~is_ok))
        comparison.missing_numbers += _count_missing_numbers(field, is_ok)
        if not np.any(is_ok):
            continue
        comparison.rows += int(np.sum(is_ok))
        comparison.pole_rows += int(np.sum(is_ok)) * len(poles)
        evaluated_poles = EvaluatedPoles(motion, field, pole_request, moving_input)
        # spherekit evaluates some rows from the decimal numbers of the file. They are not
        # compared with the float64 reference, whose mechanism is slightly different.
        float64_rows = is_ok & ~field.is_decimal
        if np.any(float64_rows):
            _compare_rows(
                comparison, evaluated_poles, float64_rows, is_decimal=False, every=every
            )
        decimal_rows = is_ok if as_written else is_ok & field.is_decimal
        if np.any(decimal_rows):
            _compare_rows(
                comparison, evaluated_poles, decimal_rows, is_decimal=True, every=every
            )
    return comparison


def _count_missing_numbers(field, is_ok):
    """Return how many numbers and error bounds of poles are NaN but should not be.

    A pole is the axis of the relative rotation of two links. A row is one sample in one
    assembly mode (way to assemble the links). In rows that are OK, coefficients of poles
    and their bounds must be numbers. The derivative of a pole direction by the input
    (`direction_dq`) may be NaN. Where it is a number, it needs a bound.

    Parameters
    ----------
    field
        `PoleField`: the poles with their coefficients, and a status for each pole and row.
    is_ok
        (rows,) whether the configuration and velocities of a row are OK.
    """
    count = 0
    for pole, codes in field.pole_status.items():
        has_direction = is_ok & (codes == Status.OK)
        is_at_rest = is_ok & (codes == Status.NO_POLE)
        for values in (
            field.velocity_coefficient,
            field.acceleration_coefficient,
            field.velocity_coefficient_error,
            field.acceleration_coefficient_error,
            field.direction_error,
        ):
            count += int(np.sum(~np.isfinite(values[pole]) & has_direction))
        # Links at rest relative to each other have the coefficient 0, with a bound.
        rate_error = field.velocity_coefficient_error[pole]
        count += int(np.sum(~np.isfinite(rate_error) & is_at_rest))
        has_derivative = np.isfinite(field.direction_dq[pole][:, 0])
        has_bound = np.isfinite(field.direction_dq_error[pole])
        count += int(np.sum(has_derivative & ~has_bound))
    return count


@final
@dataclass(frozen=True)
class EvaluatedPoles:
    """The poles of a motion while one input moves, as spherekit evaluates them.

    A pole is the axis of the relative rotation of two links. The poles are compared with a
    reference in more digits.

    Attributes
    ----------
    motion, field, pole_request
        Motion, its poles, and the request that the poles were evaluated for.
    moving_input
        Number of the input pair that moves.
    """

    motion: Motion
    field: PoleField
    pole_request: Request
    moving_input: int


@final
@dataclass(frozen=True)
class RowErrors:
    """Errors of some rows against a reference, and the bounds stated for them.

    A row is one configuration with one of its inputs moving alone.

    Attributes
    ----------
    errors, bounds
        By kind of `KINDS`: (rows,) for configurations, (poles, rows) for all others.
    has_reference
        (rows,) whether the reference could be computed.
    """

    errors: dict[str, Floats]
    bounds: dict[str, Floats]
    has_reference: Bools

    def find_doubtful_rows(self):
        """Return the rows (rows,) on which the rounding of the reference might decide.

        They have no reference, or an error of more than half of its bound.
        """
        is_doubtful = ~self.has_reference
        for kind in KINDS:
            is_close_to_bound = self.errors[kind] > 0.5 * self.bounds[kind]
            # One pole that is close to its bound makes a row doubtful.
            errors_of_poles = is_close_to_bound.reshape(-1, len(is_doubtful))
            is_doubtful |= np.any(errors_of_poles, axis=0)
        return is_doubtful

    def replace_errors(self, is_replaced, better):
        """Replace the errors of some rows by those against a better reference.

        Parameters
        ----------
        is_replaced
            (rows,) True for the rows that are replaced.
        better
            `RowErrors` of these rows only.
        """
        for kind in KINDS:
            self.errors[kind][..., is_replaced] = better.errors[kind]
        self.has_reference[is_replaced] = better.has_reference

    def append_to(self, comparison):
        """Append errors and bounds to an `ErrorComparison`, where both have a value.

        An infinite bound is a value: spherekit then promises nothing.
        """
        comparison.rows_without_reference += int(np.sum(~self.has_reference))
        for kind in KINDS:
            errors = self.errors[kind]
            bounds = self.bounds[kind]
            is_comparable = self.has_reference & np.isfinite(errors) & ~np.isnan(bounds)
            comparison.error[kind].append(errors[is_comparable])
            comparison.bound[kind].append(bounds[is_comparable])


def _compare_rows(comparison, evaluated_poles, rows, is_decimal, every):
    """Append errors and bounds of some rows to a comparison.

    A row is one configuration with one of its inputs moving alone. All rows are first
    compared with a reference in few digits. Doubtful rows have no reference, or an error of
    more than half of its bound. Doubtful rows are compared again in 50 digits.

    Parameters
    ----------
    comparison
        `ErrorComparison` that is extended.
    evaluated_poles
        `EvaluatedPoles` of a motion.
    rows
        (n,) True for the rows of the motion that are compared.
    is_decimal
        Whether the sizes of the reference mechanism are the exact decimal numbers of the
        file, and not these numbers rounded to float64.
    every
        One of this many rows is compared in 50 digits even if it is not doubtful; 0 for
        none.
    """
    row_errors = _errors_of_rows(evaluated_poles, rows, is_decimal, Digits(MIN_DIGITS))
    needs_50_digits = row_errors.find_doubtful_rows()
    if every:
        # The first row is arbitrary. The count of rows so far and the kind of reference
        # choose it, so that different calls choose different rows.
        first = comparison.rows
        if is_decimal:
            first += 1
        needs_50_digits[first % every :: every] = True
    if np.any(needs_50_digits):
        row_numbers = np.flatnonzero(rows)[needs_50_digits]
        is_repeated = np.zeros(len(rows), dtype=bool)
        is_repeated[row_numbers] = True
        better = _errors_of_rows(evaluated_poles, is_repeated, is_decimal, Digits(50))
        row_errors.replace_errors(needs_50_digits, better)
        comparison.rows_in_50_digits += len(row_numbers)
    row_errors.append_to(comparison)


def _errors_of_rows(evaluated_poles, rows, is_decimal, digits):
    """Return the `RowErrors` of some rows, with a reference in `digits`.

    Parameters
    ----------
    evaluated_poles
        `EvaluatedPoles` of a motion.
    rows
        (n,) True for the rows that are compared.
    is_decimal
        Whether the sizes of the reference mechanism are the exact decimal numbers of the
        file, and not these numbers rounded to float64.
    digits
        The arithmetic of the reference, with its number of digits.
    """
    motion = evaluated_poles.motion
    with digits.within():
        frames = read_decimals(motion.mechanism).revolute_frames() if is_decimal else None
        inputs = exact_balls(motion.inputs[rows])
    (exact,) = exact_rows_by_input(
        motion,
        rows,
        (evaluated_poles.moving_input,),
        digits,
        inputs=inputs,
        frames=frames,
    )
    evaluated = evaluated_poles.field.rows(rows)
    reference = exact_field(exact, evaluated_poles.pole_request, evaluated)
    poles = list(evaluated.direction)

    direction_errors = []
    with digits.within():
        for pole, direction in evaluated.direction.items():
            deviation = centre_floats(exact_direction(exact, pole, direction) - direction)
            direction_errors.append(np.linalg.norm(deviation, axis=1))
    errors = {"configurations": exact.distance, "directions": direction_errors}
    bounds = {
        "configurations": motion.configuration_error[rows],
        "directions": [evaluated.direction_error[pole] for pole in poles],
    }
    for kind, name in (
        ("rates", "velocity_coefficient"),
        ("derivatives", "acceleration_coefficient"),
    ):
        values = getattr(evaluated, name)
        exact_values = getattr(reference, name)
        stated_bounds = getattr(evaluated, f"{name}_error")
        errors[kind] = [np.abs(values[pole] - exact_values[pole]) for pole in poles]
        bounds[kind] = [stated_bounds[pole] for pole in poles]
    errors["direction derivatives"] = [
        np.linalg.norm(evaluated.direction_dq[pole] - reference.direction_dq[pole], axis=1)
        for pole in poles
    ]
    bounds["direction derivatives"] = [evaluated.direction_dq_error[p] for p in poles]

    # The reference is rounded too. Rates depend on the inverse of the velocity equations,
    # and their derivatives on its square, so the rounding may grow with the square of the
    # condition number. The factor 10 leaves room for several such errors.
    reference_rounding = 10.0 * digits.eps * exact.condition**2
    errors = {
        kind: np.maximum(np.array(values) - reference_rounding, 0.0)
        for kind, values in errors.items()
    }
    bounds = {kind: np.array(values) for kind, values in bounds.items()}
    return RowErrors(errors, bounds, has_reference=exact.status == Status.OK)
