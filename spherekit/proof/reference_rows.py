"""Reference values of the rows of a motion: configuration, rates and their derivatives.

The rows of a motion only say which solution is meant. Starting from them, Newton's method
closes the loops in as many digits as requested. The loop equations as power series in the
input give all derivatives. The solvers that computed the motion are not used.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from spherekit.argument_validation import checked
from spherekit.arrays import Array, Bools, Floats, SmallIntegers
from spherekit.conventions import TURN
from spherekit.errors import SolveError
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.pole_plan import Pole
from spherekit.positions.motion import Motion
from spherekit.proof.ball_curves import vector_lengths
from spherekit.proof.ball_frames import Frames, exact_ball, exact_balls
from spherekit.proof.balls import (
    MIN_DIGITS,
    Digits,
    centre_floats,
    exact_centres,
    pi_ball,
    power_series,
)
from spherekit.proof.linkage import (
    ROUNDING_STEP_RATIO,
    Linkage,
    LoopClosure,
    angular_velocities,
    largest_in_rows,
)
from spherekit.status import Status
from spherekit.tolerances import CLOSURE_TOLERANCE, SAME_SOLUTION_AS_ROW_RAD
from spherekit.velocities.pole_field import PoleField
from spherekit.velocities.pole_request import Request
from spherekit.wording import listing

DIRECTION_ROUNDING_RATIO = 1e6
"""Length of a vector, over its rounding, above which it gives a direction.

Rounding could then rotate the direction by 1e-6 rad at most. Larger: more poles of slow
links are NaN. Smaller: directions with larger errors are returned.
"""

Key = TypeVar("Key")
"""A pole or a link, by which the values of a field are stored."""


@dataclass(frozen=True)
class ExactRows:
    """Very accurate values of n rows, with which computed rows are compared.

    A row is one configuration of a motion. One input moves at unit rate, the other inputs
    are locked. Vectors and rotations are in ground axes. Values are balls, which are
    numbers with a bound of their error, with the digits of `arithmetic`. Values are NaN in
    rows with a status other than OK.

    Attributes
    ----------
    arithmetic
        The number of digits.
    mechanism
        The mechanism.
    driven
        Index of the input pair that moves.
    values
        (n, variables) balls, the pair variables (rad).
    rates
        (n, variables) balls, their rates per unit rate of the input.
    rotations
        (n, links, 3, 3) balls, rotations from link axes to ground axes.
    axes
        (n, pairs, 3) balls, the axis of an R pair, the contact point of another pair.
    w
        (n, links, 3) balls, angular velocities relative to the ground.
    dw, ddw
        (n, links, 3) balls, their first and second derivative with respect to the input.
        None if the argument `order` of `exact_rows` did not ask for them.
    distance
        (n,) largest change (rad) of a variable from the row to the solution.
    residual
        (n,) largest component (rad) of the loop residuals of the declared geometry. Except
        in over-constrained chains, the residual is rounding.
    condition
        (n,) condition number, in Frobenius norms, of the closure Jacobian without the
        inputs. An error e of the geometry moves the configuration by up to about
        `condition` times e.
    status
        (n,) `Status`. A row that had failed keeps its status. NOT_CONVERGED; NOT_CLOSED;
        MODE_LOST if the solution is farther from the row than 1e-6 rad and also farther
        than the error bound of the row allows, or if another solution may be as near;
        AT_SINGULARITY if the Jacobian does not have full rank in these digits.
    """

    arithmetic: Digits
    mechanism: Mechanism
    driven: int
    values: Array
    rates: Array
    rotations: Array
    axes: Array
    w: Array
    dw: Array | None
    ddw: Array | None
    distance: Floats
    residual: Floats
    condition: Floats
    status: SmallIntegers

    @property
    def slopes(self) -> Array:
        """`dw`: derivatives of angular velocities with respect to the input, if requested.

        Raises
        ------
        ValueError
            If the rows were computed with `order=1`, without derivatives.
        """
        if self.dw is None:
            raise ValueError("this needs rows of order 2 or 3")
        return self.dw


@checked(SolveError)
def exact_rows(
    motion: Motion,
    rows: Bools,
    driven: int,
    arithmetic: Digits | None = None,
    order: int = 2,
    inputs: Array | None = None,
) -> ExactRows:
    """Return reference values of some rows of a motion, computed with many digits.

    Reference values serve to check results of normal precision. A row is one configuration.
    One input moves at unit rate while the other inputs are locked. Values are balls
    (numbers with a bound of their error). All sizes and inputs count as exact float64
    numbers.

    Parameters
    ----------
    motion
        Any motion. Newton's method closes the loops from its configurations, at constant
        inputs.
    rows
        (n,) which rows of the motion are computed.
    driven
        Index of the input pair (joint) that moves.
    arithmetic
        The number of decimal digits. By default 20, four more than float64 has.
    order
        1 for the angular velocities w of the links, 2 for their derivatives dw with respect
        to the input as well, 3 for the second derivatives ddw as well.
    inputs
        (computed rows, inputs) exact inputs (rad) as balls, if they have more digits than
        float64. By default the float64 inputs of the motion are exact.

    Raises
    ------
    SolveError
        If the pair is not an input, the order is not 1, 2 or 3, `rows` is not a mask of the
        rows of the motion, or `inputs` has another shape.
    """
    (reference,) = exact_rows_by_input(motion, rows, (driven,), arithmetic, order, inputs)
    return reference


def exact_rows_by_input(
    motion: Motion,
    rows: Bools,
    driven: Sequence[int],
    arithmetic: Digits | None = None,
    order: int = 2,
    inputs: Array | None = None,
    frames: Frames | None = None,
) -> tuple[ExactRows, ...]:
    """Return reference values of rows of a motion for each of several moving inputs.

    One input moves at unit rate while the other inputs are locked. Newton's method closes
    the loops from the rows of the motion, once for all inputs. Power series in the moving
    input then give all derivatives.

    Parameters
    ----------
    motion, rows, arithmetic, order, inputs
        See `exact_rows`.
    driven
        Indices of the input pairs. Each of these pairs moves while the other inputs are
        locked.
    frames
        Frames of the R pairs. By default the frames for the sizes as float64 numbers;
        frames for the decimal sizes come from `DecimalMechanism.revolute_frames`.

    Raises
    ------
    SolveError
        See `exact_rows`.
    """
    mechanism = motion.mechanism
    for pair in driven:
        if pair not in motion.assembly.inputs:
            names = listing(mechanism.names_of(motion.assembly.inputs))
            raise SolveError(
                f"{mechanism.name}: pair number {pair} is not an input. Inputs: {names}"
            )
    if order not in (1, 2, 3):
        raise SolveError(f"order: found {order}, expected 1, 2 or 3")
    mask = np.asarray(rows)
    if mask.dtype != bool or mask.shape != (len(motion),):
        raise SolveError(
            f"rows: found an array of {mask.dtype} of the shape {mask.shape}, expected "
            f"True or False for each of the {len(motion)} rows"
        )
    arithmetic = arithmetic or Digits(MIN_DIGITS)
    chosen = motion.rows(mask)
    if inputs is not None and np.shape(inputs) != chosen.inputs.shape:
        raise SolveError(
            f"inputs: found the shape {np.shape(inputs)}, expected {chosen.inputs.shape}"
        )
    with arithmetic.within(), np.errstate(all="ignore"):
        linkage = Linkage(mechanism, frames)
        input_variables = [
            mechanism.variables_of(pair)[0] for pair in motion.assembly.inputs
        ]
        # 1. Close the loops. The inputs are exact, all other variables are start values.
        start = exact_balls(chosen.values)
        # Variables may have been wrapped into one turn. The inputs are then moved by the
        # same whole turns.
        turns = np.round((chosen.inputs - chosen.values[:, input_variables]) / TURN)
        input_values = exact_balls(chosen.inputs) if inputs is None else inputs
        start[:, input_variables] = input_values - turns * (2 * pi_ball())
        closure = linkage.close_loops(start, input_variables, arithmetic.eps)
        # Rows with a status other than OK become NaN.
        status = _closure_status(chosen, closure)
        is_good = status == Status.OK
        orientations, _ = linkage.place_links(closure.values)
        axes = linkage.pair_axes(closure.values, orientations)

        # 2. Rates and derivatives for each moving input.
        references = []
        for pair in driven:
            (moving_variable,) = mechanism.variables_of(pair)
            # Coefficients (rows, variables) for each power of the moving input.
            coefficients = linkage.expand_motion(closure, moving_variable, order)
            moving_orientations, _ = linkage.place_links(power_series(*coefficients))
            # w, then its derivatives up to the order.
            velocities = [
                _nan_unless(is_good, array)
                for array in angular_velocities(moving_orientations, order)
            ]
            reference = ExactRows(
                arithmetic=arithmetic,
                mechanism=mechanism,
                driven=pair,
                values=_nan_unless(is_good, closure.values),
                rates=_nan_unless(is_good, coefficients[1]),
                rotations=_nan_unless(is_good, orientations),
                axes=_nan_unless(is_good, axes),
                w=velocities[0],
                dw=velocities[1] if order > 1 else None,
                ddw=velocities[2] if order > 2 else None,
                distance=closure.distance,
                residual=closure.residual,
                condition=closure.condition,
                status=status,
            )
            references.append(reference)
    return tuple(references)


def _nan_unless(is_good: Bools, balls: Array) -> Array:
    """Return a copy of an array (n, ...) with NaN in the rows where `is_good` is false.

    The numbers are balls: each has a bound of its error.
    """
    result = balls.copy()
    result[~is_good] = exact_ball(np.nan)
    return result


def _closure_status(motion: Motion, closure: LoopClosure) -> SmallIntegers:
    """Return the status (n,) of reference rows: OK, or why there is no solution.

    Newton's method computes a solution in many digits from each row (configuration) of the
    motion. The first of these that applies is the status:

    1. If the row of the motion has failed, its own status. A row that is OK, but not
       finite, is NOT_CONVERGED, since Newton's method cannot start from it.
    2. MODE_LOST: the solution may be in another assembly mode (way to assemble the
       mechanism). The solution is too far from the row, or another solution may be equally
       near to the row.
    3. NOT_CLOSED: the loops of the solution are open.
    4. The status of Newton's method.

    Parameters
    ----------
    motion
        The rows from which Newton's method started.
    closure
        The solutions that it reached.
    """
    had_failed = motion.failed | ~np.all(np.isfinite(motion.values), axis=1)
    was_ok = motion.status == Status.OK
    reason_of_failure = np.where(was_ok, Status.NOT_CONVERGED, motion.status)

    is_converged = closure.status == Status.OK
    is_too_far = closure.distance > _largest_distance_from_row(motion)
    may_be_other_mode = closure.is_ambiguous | is_too_far
    is_open = closure.residual > CLOSURE_TOLERANCE
    # The first true condition decides.
    status = np.select(
        [had_failed, is_converged & may_be_other_mode, is_converged & is_open],
        [reason_of_failure, Status.MODE_LOST, Status.NOT_CLOSED],
        default=closure.status,
    )
    return status.astype(np.int8)


def _largest_distance_from_row(motion: Motion) -> Floats:
    """Return distances (n,) up to which a solution counts as the solution of its row (rad).

    The solution is computed in high precision from a row of the motion. A correct row may
    differ from it by the error bound of the motion. This bound is an estimate, so twice the
    bound is allowed. Rows without a finite bound get the smallest distance.
    """
    error = motion.configuration_error
    allowed_error = np.where(np.isfinite(error), 2.0 * error, 0.0)
    return np.maximum(allowed_error, SAME_SOLUTION_AS_ROW_RAD)


def exact_motion(motion: Motion, rows: Bools, reference: ExactRows) -> Motion:
    """Return some rows of a motion, with configurations replaced by reference values.

    A row is one configuration. Its reference values are computed in many digits, and serve
    to measure the errors of a run. They are rounded to float64 here. Analyses can then
    compute reference tables from the returned motion. The stored closure residual is the
    one before the rounding.

    Parameters
    ----------
    motion
        The motion.
    rows
        Mask (n,) of the rows of the motion to which the reference values belong.
    reference
        The reference values of these rows.
    """
    return replace(
        motion.rows(rows),
        values=centre_floats(reference.values),
        placed=centre_floats(reference.rotations),  # rotations of the links
        residual=reference.residual,
        status=reference.status,
    )


def exact_direction(reference: ExactRows, pole: Pole, toward: Floats) -> Array:
    """Return the direction of a pole in reference rows (configurations in many digits).

    The pole of two links is the axis of their relative rotation while one input moves. If a
    revolute pair (joint) or a rolling contact joins both links, it is the axis or contact
    point of the pair. Otherwise it is the direction of the relative angular velocity. If
    the links are at relative rest, the derivative of this velocity with respect to the
    input replaces it.

    Parameters
    ----------
    reference
        The reference rows. They must have `dw`, the derivatives of the angular velocities.
        `exact_rows` computes it if its argument `order` is 2 or 3.
    pole
        Indices of the two links.
    toward
        (n, 3) vectors in ground axes. Of two opposite directions, the one on their side is
        returned.

    Returns
    -------
    (n, 3) unit vectors in ground axes, as balls (numbers with a bound of their error). NaN
    where `toward` or the reference is NaN, and where rounding could turn the direction by
    1e-6 rad.

    Raises
    ------
    ValueError
        If the rows have no `dw`, because they were computed with `order=1`.
    """
    with reference.arithmetic.within(), np.errstate(all="ignore"):
        # Reading `slopes` raises the ValueError, also for poles that do not need it.
        derivatives = reference.slopes
        joining_pair = reference.mechanism.pole_pairs.get(pole)
        if joining_pair is not None:
            vectors = reference.axes[:, joining_pair]
        else:
            vectors = _vector_of_relative_motion(reference, derivatives, pole)
        return _orient_unit_vectors(vectors, toward)


def _orient_unit_vectors(vectors: Array, toward: Floats) -> Array:
    """Return unit vectors (n, 3) along vectors, with the sense of the vectors in `toward`.

    An axis has two opposite directions. The one at less than 90 degrees from `toward`
    (n, 3) is chosen. The vectors (n, 3) are balls, which are numbers with a bound of their
    error. The result is NaN where `toward` is NaN.
    """
    is_opposite = np.sum(centre_floats(vectors) * toward, axis=1) < 0.0
    sign = np.where(is_opposite, -1.0, 1.0)
    # The vector is divided by the length of its centre. The ball of a squared length may
    # contain 0 or negative numbers, and then has no square root.
    length = vector_lengths(exact_centres(vectors))
    has_side = np.all(np.isfinite(toward), axis=1)
    return _nan_unless(has_side, vectors * (sign / length)[:, None])


def _vector_of_relative_motion(
    reference: ExactRows, derivatives: Array, pole: Pole
) -> Array:
    """Return a vector along the axis about which two links rotate relative to each other.

    The vector is the relative angular velocity. At relative rest, the vector is the
    derivative of this velocity with respect to the input, because the links start to rotate
    about this derivative.

    Parameters
    ----------
    reference
        The reference rows (configurations with velocities in many digits).
    derivatives
        (n, links, 3) derivatives of the angular velocities with respect to the input.
    pole
        Indices of the two links.

    Returns
    -------
    (n, 3) vectors of any length in ground axes, as balls (numbers with a bound of their
    error). NaN where rounding could turn the direction by 1e-6 rad.
    """
    velocity = _relative_vector(reference.w, pole)
    derivative = _relative_vector(derivatives, pole)
    motion = _find_relative_motion(reference, pole)
    # Links at rest start to rotate about the derivative, if it is not only rounding.
    has_derivative = _has_direction(
        # Size of the difference, relative to the derivatives of the two links.
        size=_relative_size(derivative, derivatives, pole),
        rounding=_derivative_rounding(reference),
    )
    # A row may be neither: so slow that rounding can turn the direction of the velocity,
    # but not certainly at rest. It gets NaN.
    has_vector = motion.moves | (motion.rests & has_derivative)
    vectors = np.where(motion.moves[:, np.newaxis], velocity, derivative)
    return _nan_unless(has_vector, vectors)


def _has_direction(size: Floats, rounding: Floats) -> Bools:
    """Return a mask of the vectors that are too long for rounding to rotate by 1e-6 rad.

    Shorter vectors have no reliable direction.

    Parameters
    ----------
    size
        (n,) sizes of the vectors.
    rounding
        (n,) their rounding errors, in the same unit.
    """
    # A rounding error across a vector rotates it by the error divided by the size.
    return size > DIRECTION_ROUNDING_RATIO * rounding


def _velocity_rounding(reference: ExactRows) -> Floats:
    """Return the rounding errors (n,) of angular velocities, in the unit of their size.

    Angular velocities solve linear equations. The rounding of the arithmetic is multiplied
    by the condition number of their matrix. The error has the unit of `_relative_size`.
    """
    return reference.arithmetic.eps * reference.condition


def _derivative_rounding(reference: ExactRows) -> Floats:
    """Return the rounding errors (n,) of input derivatives of angular velocities.

    The derivatives solve equations with the same matrix as the angular velocities. The
    right-hand sides contain these velocities, so the condition number multiplies their
    rounding once more. The error has the unit of `_relative_size`.
    """
    return _velocity_rounding(reference) * reference.condition


@dataclass(frozen=True)
class _RelativeMotion:
    """Masks of the rows in which two links move, and rest, relative to each other.

    A row is one configuration with velocities. Where the links move, their velocity gives
    the axis of rotation. Where they rest, the axis has to be found in another way. Where
    both masks are false, rounding leaves open whether the links move.

    Attributes
    ----------
    moves
        (n,) whether the links move so fast that their axis of rotation is known: rounding
        changes its direction by less than 1e-6 rad.
    rests
        (n,) whether the relative velocity is zero up to rounding, or unknown (NaN).
    """

    moves: Bools
    rests: Bools


def _find_relative_motion(reference: ExactRows, pole: Pole) -> _RelativeMotion:
    """Return masks of the rows in which two links move, and rest, relative to each other.

    Where the links move, callers take the axis of rotation (pole) from their relative
    velocity. Where they rest, callers find it in another way.

    A row is one configuration with velocities in many digits. The relative angular velocity
    is compared with its rounding error. The links move if the velocity is above
    `DIRECTION_ROUNDING_RATIO` times the error. The links rest if the velocity is at most
    `ROUNDING_STEP_RATIO` times the error. Between these limits neither is certain.

    Parameters
    ----------
    reference
        The reference rows.
    pole
        Indices of the two links.
    """
    velocity = _relative_vector(reference.w, pole)
    speed = _relative_size(velocity, reference.w, pole)
    rounding = _velocity_rounding(reference)
    exceeds_rounding = speed > ROUNDING_STEP_RATIO * rounding
    # In rows without velocity (NaN) the links count as at rest.
    return _RelativeMotion(moves=_has_direction(speed, rounding), rests=~exceeds_rounding)


def _relative_size(relative: Array, vectors: Array, pole: Pole) -> Floats:
    """Return the size of the difference of two links' vectors, relative to these vectors.

    The caller compares the result with a rounding error, to see whether the difference is
    more than rounding. The vectors are angular velocities at unit rate of the input, or
    their derivatives. The size of a vector is the largest magnitude of its components. If
    both vectors are smaller than 1 (the rate of the input), the difference is divided by 1.

    Parameters
    ----------
    relative
        (n, 3) differences of the vectors of the two links.
    vectors
        (n, links, 3) the vectors of all links.
    pole
        Indices of the two links.

    Returns
    -------
    (n,) size of the difference, divided by the larger of 1 and the sizes of both vectors.
    """
    first_link, second_link = pole
    # (n, 6) the components of both vectors.
    components = np.concatenate([vectors[:, first_link], vectors[:, second_link]], axis=1)
    return largest_in_rows(relative) / np.maximum(largest_in_rows(components), 1.0)


def exact_field(reference: ExactRows, request: Request, field: PoleField) -> PoleField:
    """Return the poles of a field with the float64 numbers nearest to reference values.

    A field has, for each pole of two links, the direction of the axis of their relative
    rotation while one input moves, and two coefficients. The velocity coefficient is the
    component of the relative angular velocity along this direction. The acceleration
    coefficient is the component of the derivative of this velocity with respect to the
    input.

    Parameters
    ----------
    reference
        Reference rows with `dw`, for the input that the request moves.
    request
        Which poles the field has.
    field
        The values that were computed for the same rows. The directions of the result are
        oriented like the directions of the field, and NaN stays NaN.

    Returns
    -------
    PoleField
        Rows without a reference are NaN and have the status of the reference.
        `conditioning`, `planes` and the error bounds of poles are NaN, since they belong to
        the computation of the field.
    """
    with reference.arithmetic.within():
        directions = {
            pole: exact_direction(reference, pole, field.direction[pole])
            for pole in request.poles
        }
        direction_derivatives = {
            pole: _direction_derivative(reference, pole, direction)
            for pole, direction in directions.items()
        }
        velocity_coefficients = {
            pole: _component_along(_relative_vector(reference.w, pole), direction)
            for pole, direction in directions.items()
        }
        acceleration_coefficients = {
            pole: _component_along(_relative_vector(reference.slopes, pole), direction)
            for pole, direction in directions.items()
        }
        w = {link: reference.w[:, link] for link in field.w}
        dw = {link: reference.slopes[:, link] for link in field.dw}

    def status_of(codes: SmallIntegers) -> SmallIntegers:
        """Return status codes (n,) of the rows, where rows without a reference have failed.

        Such rows get the code of `reference.status`, which says why. Other rows keep their
        code in `codes` (n,).
        """
        has_reference = reference.status == Status.OK
        return np.where(has_reference, codes, reference.status).astype(np.int8)

    return replace(
        field.without_pole_values(),
        direction=_round_where_known(field.direction, directions),
        direction_dq=_round_where_known(field.direction_dq, direction_derivatives),
        velocity_coefficient=_round_where_known(
            field.velocity_coefficient, velocity_coefficients
        ),
        acceleration_coefficient=_round_where_known(
            field.acceleration_coefficient, acceleration_coefficients
        ),
        w=_round_where_known(field.w, w),
        dw=_round_where_known(field.dw, dw),
        planes=_all_nan(field.planes),
        status=status_of(field.status),
        pole_status={pole: status_of(field.pole_status[pole]) for pole in request.poles},
    )


def _round_where_known(
    field_values: Mapping[Key, Floats], balls: Mapping[Key, Array]
) -> dict[Key, Floats]:
    """Round reference numbers to float64, with NaN where the computed values are NaN.

    `exact_field` replaces the values that were computed in float64 by these numbers.

    Parameters
    ----------
    field_values
        The computed values of one quantity, by pole (axis of the relative rotation of two
        links) or by link.
    balls
        Reference numbers by the same keys, in many digits with a bound of their error.
    """
    return {
        key: np.where(np.isnan(field_values[key]), np.nan, centre_floats(array))
        for key, array in balls.items()
    }


def _all_nan(field_values: Mapping[Key, Floats]) -> dict[Key, Floats]:
    """Return arrays of NaN with the shapes of the values of a field."""
    return {key: np.full(array.shape, np.nan) for key, array in field_values.items()}


def _component_along(vectors: Array, directions: Array) -> Array:
    """Return the components (n,) of vectors (n, 3) along unit vectors (n, 3).

    Where the direction is NaN (unknown), the result is the length of the vector. All
    numbers are balls (numbers with a bound of their error).
    """
    has_no_direction = ~np.all(np.isfinite(centre_floats(directions)), axis=1)
    lengths = vector_lengths(exact_centres(vectors))
    return np.where(has_no_direction, lengths, np.sum(vectors * directions, axis=1))


def _direction_derivative(reference: ExactRows, pole: Pole, direction: Array) -> Floats:
    """Return the derivative u' (n, 3) of a pole direction u with respect to the input.

    The pole of two links is the axis of their relative rotation. Each row is one
    configuration, and belongs to one of four cases:

    - The pole is the axis of a revolute pair (joint). It turns with both links.
    - The links move relative to each other. u' follows from their relative velocity and its
      derivative.
    - The links touch in a rolling contact, and rest relative to each other. The contact
      point rests on both links, so it turns with them.
    - Otherwise u' is NaN. Either the links rest and no such pair joins them. Or their
      relative velocity is so near its rounding error that neither motion nor rest is
      certain.

    Parameters
    ----------
    reference
        Angular velocities of the links, and their derivatives with respect to the input, in
        balls (numbers with a bound of their error). The result has no bounds.
    pole
        Indices of the two links.
    direction
        (n, 3) the direction u of the pole, as balls.
    """
    mechanism = reference.mechanism
    # `pole_pairs` has the pairs that determine a pole: revolute pairs and rolling contacts.
    # Sliding contacts are not among them.
    joining_pair = mechanism.pole_pairs.get(pole)
    if joining_pair is not None and mechanism.pairs[joining_pair].kind.has_axis:
        return _derivative_with_link(reference, joining_pair, direction)
    motion = _find_relative_motion(reference, pole)
    derivative = np.full((len(direction), 3), np.nan)
    # A rolling contact, in rows in which the links rest.
    if joining_pair is not None:
        with_link = _derivative_with_link(reference, joining_pair, direction)
        derivative[motion.rests] = with_link[motion.rests]
    by_velocity = _derivative_by_relative_velocity(reference, pole, direction)
    derivative[motion.moves] = by_velocity[motion.moves]
    return derivative


def _derivative_with_link(reference: ExactRows, pair: int, direction: Array) -> Floats:
    """Return the derivative w x u (n, 3) of a direction u that is fixed in a link.

    u is the axis about which the two links of a pair (joint) rotate relative to each other.
    The derivative is with respect to the input.

    Parameters
    ----------
    reference
        The n configurations, with the angular velocity w of the link at unit rate of the
        input. The numbers are balls (numbers with a bound of their error).
    pair
        Index of the pair. The first of its links is the link in which u is fixed.
    direction
        (n, 3) the direction u, as balls.
    """
    first_link, _second_link = reference.mechanism.ends[pair]
    angular_velocity = reference.w[:, first_link]
    # The product is computed in balls, and only the result is rounded to float64. Rounded
    # factors would add errors of about 1e-16.
    derivative = np.cross(angular_velocity, direction)
    return centre_floats(derivative)


def _derivative_by_relative_velocity(
    reference: ExactRows, pole: Pole, direction: Array
) -> Floats:
    """Return the derivative u' (n, 3) of a pole direction u while the links move.

    The pole is the axis of the relative rotation of two links. At unit rate of the input,
    their relative angular velocity is v = k u with a number k. Its derivative is v' = k' u
    + k u', and u' is perpendicular to u. So u' is the part of v' perpendicular to u,
    divided by k.

    Parameters
    ----------
    reference
        Reference rows with the angular velocities and their derivatives, in balls (numbers
        with a bound of their error).
    pole
        Indices of the two links.
    direction
        (n, 3) the direction u, as balls.

    Returns
    -------
    The derivatives. Derivatives have no meaning where the links rest (k = 0).
    """
    v = _relative_vector(reference.w, pole)
    # `slopes` are the derivatives of w with respect to the input.
    dv = _relative_vector(reference.slopes, pole)
    dv_along = np.sum(dv * direction, axis=1)[:, np.newaxis] * direction
    k = np.sum(v * direction, axis=1)
    # The difference may be small, so it is computed in balls. The quotient needs no balls.
    with np.errstate(all="ignore"):
        return centre_floats(dv - dv_along) / centre_floats(k)[:, np.newaxis]


def _relative_vector(vectors: Array, pole: Pole) -> Array:
    """Return the vectors (n, 3) of the second link of a pole less the first link's."""
    return vectors[:, pole[1]] - vectors[:, pole[0]]
