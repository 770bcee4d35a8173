"""Evaluates the requested poles and velocity coefficients at the rows of a motion.

By default the velocity equations of the whole mechanism give angular velocities, and these
give the poles (`spherekit.velocities.row_velocities`). The other routes follow the plan of
the poles from great circle to great circle (`spherekit.velocities.pole_sequence`).

Symbols: v is the angular velocity of the second link of a pole relative to the first, per
unit rate of the moving input, and dv its derivative with respect to this input. u is the
direction of the pole. The velocity coefficient is v . u, the acceleration coefficient is
dv . u.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from spherekit.arrays import Bools, Floats
from spherekit.errors import SolveError
from spherekit.geometry.vectors import dot_columns, norm_columns
from spherekit.planning.pole_plan import Pole
from spherekit.positions.motion import Motion
from spherekit.status import Status
from spherekit.tolerances import EPS, NO_MOTION, USABLE_DIRECTION
from spherekit.velocities.direction_signs import SignContinuation, apply_continuous_signs
from spherekit.velocities.elimination_order import EliminationOrder
from spherekit.velocities.input_columns import InputColumns
from spherekit.velocities.pole_field import (
    MAX_DIRECTION_DQ_ERROR,
    POLE_ERRORS,
    POLE_QUANTITIES,
    SIGNED_COMPONENTS,
    PoleField,
    axis_pairs,
)
from spherekit.velocities.pole_request import ROUTES, Request, Route
from spherekit.velocities.pole_sequence import PlannedPoles
from spherekit.velocities.row_velocities import RowEngine, RowVelocities
from spherekit.wording import listing, nearest


def evaluate(
    motion: Motion,
    request: Request,
    sign_continuation: SignContinuation | None = None,
    route: Route = "best",
    engine: RowEngine = "numpy",
) -> PoleField:
    """Return the requested poles and coefficients at every row of a motion.

    A row is one configuration. A pole is the axis about which two links turn relative to
    each other. Its velocity coefficient is their relative angular velocity per unit rate of
    the moving input. The sign of the direction of a pole is continuous along the motion.

    Parameters
    ----------
    motion
        Any motion of the mechanism of the request.
    request
        The poles to compute, from `spherekit.velocities.pole_request.request`.
    sign_continuation
        Signs at the end of the previous block of the same motion, which are continued.
        Updated in place. By default the signs of this motion start anew.
    route
        How the poles are computed:

        - "best": from the velocity equations of the whole mechanism, with more digits where
          float64 is doubtful.
        - "equations": the same numbers as "best". In addition,
          `PoleField.is_quad_precision` is set in all rows, so that the report of a run
          counts all rows as computed from the equations.
        - "first": by a plan, in which each pole is the intersection of two great circles.
          If the plan has more than two circles for a pole, the first two are used.
        - "conditioned": by the plan, with the two best circles. The first is the circle
          with the smallest error bound. The second is the circle whose intersection with
          the first has the smallest error bound.
    engine
        "numpy", "compiled" (by heyoka), or "extended": quad precision for all rows.

    Raises
    ------
    SolveError
        If there is no such route.
    """
    if route not in ROUTES:
        # `nearest` returns '; did you mean ...' or an empty text.
        raise SolveError(
            f'{motion.mechanism.name}: "{route}" is not a route'
            f"{nearest(str(route), ROUTES) or '.'} Routes: {listing(ROUTES)}"
        )
    with np.errstate(all="ignore"):
        field = evaluate_unsigned(motion, request, engine, route)
        apply_continuous_signs(
            field, motion, request, sign_continuation or SignContinuation()
        )
    # The report of a run counts the rows with this flag as computed by the velocity
    # equations. On this route all rows count, whether or not quad precision was needed.
    if route == "equations":
        field.is_quad_precision[:] = True
    return field


@np.errstate(all="ignore")
def evaluate_unsigned(
    motion: Motion,
    request: Request,
    engine: RowEngine = "numpy",
    route: Route = "best",
    order: EliminationOrder | None = None,
) -> PoleField:
    """Return the requested poles, before the signs of their directions are continuous.

    A row is one configuration of the motion. A pole is the axis about which two links turn
    relative to each other. Its direction may reverse from one row to the next, since both
    directions give the same axis. `evaluate` makes the signs continuous afterwards.

    There are two ways to compute poles:

    - The velocity equations of the whole mechanism give the angular velocities of all
      links, and the poles follow from these.
    - The plan computes poles one after another, as intersections of two great circles.

    The routes "first" and "conditioned" use the plan for all poles. For each pole, "first"
    takes the first two great circles of the plan, "conditioned" the two best ones. The
    other routes use the equations, and the plan only for directions that the equations
    leave open.

    Parameters
    ----------
    motion, request, engine, route
        As for `evaluate`.
    order
        The order in which variables are eliminated from the velocity equations, for all
        rows. By default an order is chosen that never divides by nearly zero in as many
        rows as possible. The remaining rows are computed with orders that suit them.
    """
    links = range(len(motion.mechanism.links))
    # All links are computed. Their largest rate is the scale of relative errors.
    request_with_links = replace(request, links=frozenset(links))
    row_velocities = RowVelocities(motion, request_with_links, engine, order)
    # The plan is evaluated only if some row requires it, and at most once.
    get_planned_poles = cache(
        lambda: PlannedPoles(
            request.plan,
            motion,
            route,
            axis_separations=row_velocities.separations_of_common_axes(),
        )
    )
    if route in ("first", "conditioned"):
        row_velocities.use_planned_velocities(get_planned_poles())

    is_ok = row_velocities.status == Status.OK
    field = PoleField(
        status=row_velocities.status,
        is_quad_precision=row_velocities.is_quad_precision,
        is_certified=row_velocities.is_certified,
        is_decimal=row_velocities.is_decimal,
        relative_error_bound=np.where(is_ok, row_velocities.relative_error_bound, np.nan),
    )
    for link in links:
        field.w[link] = row_velocities.quantity("w", link).T
        field.dw[link] = row_velocities.quantity("dw", link).T
    for pole in request.poles:
        # None: both links belong to one body.
        if request.plan.pole(*pole) is None:
            add_locked_pole(field, pole)
        else:
            _add_pole(field, row_velocities, pole, get_planned_poles)
    # Poles for which the normals of two great circles through them are requested as well.
    for pole in request.planes:
        field.planes[pole] = get_planned_poles().great_circles(pole)

    # Rows at which this elimination order nearly divides by zero are computed again, each
    # with an order that suits it.
    for row_order, rows in row_velocities.reordered:
        field.assign_rows(
            rows, evaluate_unsigned(motion.rows(rows), request, engine, route, row_order)
        )
    return field


@dataclass
class _PoleColumns:
    """The quantities of one pole at n rows (configurations), as an intermediate result.

    A pole is the axis about which one link rotates relative to another. `_add_pole` takes
    the quantities from the velocity equations. It replaces some directions by those of the
    plan, and sets doubtful numbers to NaN. At last it stores all arrays in a `PoleField`.

    Attributes
    ----------
    quantities
        Values (components, n) of each of the `POLE_QUANTITIES`, such as the direction, by
        name.
    errors
        Values (n,) of each of the `POLE_ERRORS`, the error bounds, by name.
    """

    quantities: dict[str, Floats]
    errors: dict[str, Floats]


def _add_pole(
    field: PoleField,
    row_velocities: RowVelocities,
    pole: Pole,
    get_planned_poles: Callable[[], PlannedPoles],
) -> None:
    """Add a pole to a field, with its status at each row.

    Parameters
    ----------
    field
        The field, which is changed in place.
    row_velocities
        Velocities and poles by the velocity equations.
    pole
        Two links that move relative to each other.
    get_planned_poles
        Returns the poles by the plan, which replace directions that the velocity equations
        leave open, or all directions on the routes "first" and "conditioned".
    """
    n = len(row_velocities.status)
    errors = row_velocities.pole_errors.get(pole)
    if errors is None:
        errors = {name: np.full(n, np.inf) for name in POLE_ERRORS}
    columns = _PoleColumns(
        quantities={
            quantity.name: row_velocities.quantity(quantity.name, pole)
            for quantity in POLE_QUANTITIES
        },
        errors=errors,
    )
    # The relative angular velocity v of the two links, and the derivative of v with
    # respect to the input.
    v_size = norm_columns(row_velocities.relative_velocity(pole))
    dv_size = norm_columns(row_velocities.relative_velocity_derivative(pole))
    has_failed = row_velocities.motion.failed
    is_on_planned_route = bool(row_velocities.planned_w)
    is_open = ~(errors["direction_error"] < USABLE_DIRECTION)
    takes_planned = ~has_failed & (is_open | is_on_planned_route)
    # If constraints repeat each other, great circles can coincide except for rounding, and
    # their intersection is meaningless.
    groups = row_velocities.motion.assembly.groups
    has_redundant_group = any(group.redundant for group in groups)
    if np.any(takes_planned) and (is_on_planned_route or not has_redundant_group):
        _take_planned_direction(
            columns, row_velocities, pole, get_planned_poles(), takes_planned, is_open
        )

    # The derivative of a direction is left out if its error may be too large.
    direction_dq = columns.quantities["direction_dq"]
    has_direction_dq = errors["direction_dq_error"] < (
        MAX_DIRECTION_DQ_ERROR * np.maximum(1.0, norm_columns(direction_dq))
    )
    direction_dq[:, ~has_direction_dq] = np.nan
    has_no_direction = has_failed | ~(errors["direction_error"] < USABLE_DIRECTION)
    for values in columns.quantities.values():
        values[:, has_no_direction] = np.nan

    is_ok = row_velocities.status == Status.OK
    pole_status = row_velocities.status.copy()
    pole_status[has_no_direction & is_ok] = Status.ILL_CONDITIONED
    # Without a direction, links whose relative velocity vanishes have no pole, and their
    # velocity coefficient is 0.
    w_size = norm_columns(row_velocities.quantity("w", pole[1]))
    is_without_motion = v_size < NO_MOTION * np.maximum(1.0, w_size)
    has_no_pole = has_no_direction & is_ok & is_without_motion
    pole_status[has_no_pole] = Status.NO_POLE
    field.pole_status[pole] = pole_status
    is_at_rest = has_no_pole & (dv_size < NO_MOTION)
    columns.quantities["velocity_coefficient"][:, has_no_pole] = 0.0
    columns.quantities["acceleration_coefficient"][:, is_at_rest] = 0.0

    for quantity in POLE_QUANTITIES:
        values = columns.quantities[quantity.name]
        # Vectors become (n, 3), single numbers (n,).
        getattr(field, quantity.name)[pole] = values.T if len(values) > 1 else values[0]
        if quantity.has_error_bound:
            # A bound is NaN if its quantity is.
            getattr(field, quantity.error_name)[pole] = np.where(
                np.isnan(values[0]), np.nan, errors[quantity.error_name]
            )


def _take_planned_direction(
    columns: _PoleColumns,
    row_velocities: RowVelocities,
    pole: Pole,
    planned_poles: PlannedPoles,
    rows: Bools,
    is_open: Bools,
) -> None:
    """Replace the direction of a pole by the direction that the plan gives, in place.

    A pole is the axis about which two links turn relative to each other. The plan finds
    poles one after another, as intersections of great circles. The coefficients, which are
    components along the direction, and the error bounds change with the direction. The
    derivative of the direction becomes NaN in rows in which the velocity equations leave
    the direction open, unless the direction is the axis of a pair. Further quantities that
    change their sign with the direction become NaN.

    Parameters
    ----------
    columns
        The quantities of the pole at all n rows, which are changed in place.
    row_velocities
        Angular velocities of the links at these rows.
    pole
        The two links.
    planned_poles
        Directions by the plan, with any sign.
    rows
        (n,) rows in which the direction is replaced.
    is_open
        (n,) rows in which the velocity equations do not determine the direction.
    """
    plan = row_velocities.request.plan
    body_pole = plan.pole(*pole)
    assert body_pole is not None
    planned_direction = planned_poles.directions[body_pole]
    direction = columns.quantities["direction"]
    # The new direction points to the side of the present one, if there is one.
    is_opposite = ~is_open & (dot_columns(direction, planned_direction) < 0.0)
    planned_direction = planned_direction * np.where(is_opposite, -1.0, 1.0)
    # The bounds of the plan assume axes that are known up to rounding. Here the axes
    # can have a larger error, the error of the configuration, so the bounds grow in
    # proportion.
    motion = row_velocities.motion
    configuration_error = np.fmin(motion.orientation_error, motion.fold_error)
    planned_error = planned_poles.errors[body_pole] * np.maximum(
        configuration_error / EPS, 1.0
    )
    planned_error = planned_error + row_velocities.axis_separations.get(pole, 0.0)

    direction[:, rows] = planned_direction[:, rows]
    direction_error = columns.errors["direction_error"]
    direction_error[rows] = planned_error[rows]
    v = row_velocities.relative_velocity(pole)
    dv = row_velocities.relative_velocity_derivative(pole)
    projections = {
        "velocity_coefficient": dot_columns(v, direction),
        "acceleration_coefficient": dot_columns(dv, direction),
    }
    for name in SIGNED_COMPONENTS:
        if name in projections:
            columns.quantities[name][:, rows] = projections[name][rows]
        elif name not in ("direction", "direction_dq"):
            columns.quantities[name][:, rows] = np.nan
    # The coefficients are the components of v and dv along the direction. An error of the
    # direction changes them by at most this part of |v| and |dv|.
    relative_change = np.where(direction_error < USABLE_DIRECTION, direction_error, 1.0)
    velocity_error = columns.errors["velocity_coefficient_error"]
    velocity_error[rows] += (relative_change * norm_columns(v))[rows]
    acceleration_error = columns.errors["acceleration_coefficient_error"]
    acceleration_error[rows] += (relative_change * norm_columns(dv))[rows]
    if body_pole not in axis_pairs(plan):
        columns.quantities["direction_dq"][:, rows & is_open] = np.nan


def make_certified_field(
    input_columns: InputColumns, columns: Floats, motion: Motion, request: Request
) -> PoleField:
    """Return the poles of rows for which the float64 results are certified as accurate.

    A pole is the axis of the relative rotation of two links. A compiled function (kernel)
    has computed all quantities in one array. Here they are sorted into the fields of a
    `PoleField`, which map a pole or link to its values.

    Parameters
    ----------
    input_columns
        The meaning of the columns while one input moves. For example,
        ``column_indices["direction"][0, 4]`` lists the columns with the three components of
        the direction of pole (0, 4).
    columns
        (columns, n) the results of the kernel. The signs of pole directions have been made
        continuous along the motion before.
    motion, request
        The n configurations (rows), and the requested poles.
    """
    n = len(motion)
    computed_poles = input_columns.column_indices["direction"].keys()
    field = PoleField(
        status=motion.status,
        pole_status=dict.fromkeys(computed_poles, motion.status),
        is_quad_precision=np.zeros(n, dtype=bool),
        is_certified=np.ones(n, dtype=bool),
        # Uncertified rows near a dead centre need the sizes as the decimal numbers of the
        # mechanism file. Certified rows are accurate with the sizes in float64.
        is_decimal=np.zeros(n, dtype=bool),
        # The bound is not computed for certified rows, whose errors are below fixed limits.
        relative_error_bound=np.zeros(n),
    )
    for name, indices_by_key in input_columns.column_indices.items():
        values_by_key = getattr(field, name)
        for pole_or_link, indices in indices_by_key.items():
            values = columns[indices]
            # Vectors become (n, 3), single numbers (n,).
            values_by_key[pole_or_link] = values.T if len(indices) > 1 else values[0]
    # While one input moves, the other inputs are locked. Two links can then be one body. If
    # the pole of two such links is requested, it has no columns.
    for pole in set(request.poles) - computed_poles:
        add_locked_pole(field, pole)
    return field


def add_locked_pole(field: PoleField, pole: Pole) -> None:
    """Add the pole of two links that cannot move relative to each other.

    A pole is the axis of the relative rotation of two links. One input moves while the
    other inputs are locked. The two links are then one body, without an axis of relative
    rotation. Quantities that are 0 without relative motion, such as the
    relative angular velocity, are 0, and all others, such as directions, are NaN. In rows
    that failed, all quantities are NaN.

    Parameters
    ----------
    field
        The field, which is changed in place.
    pole
        The numbers of the two links.
    """
    is_ok = field.status == Status.OK
    pole_status = np.where(is_ok, Status.NO_POLE, field.status).astype(np.int8)
    field.pole_status[pole] = pole_status
    for quantity in POLE_QUANTITIES:
        values = np.where(is_ok, quantity.locked_value, np.nan)
        if quantity.has_error_bound:
            getattr(field, quantity.error_name)[pole] = values.copy()
        if quantity.components > 1:
            values = np.repeat(values[:, None], quantity.components, axis=1)
        getattr(field, quantity.name)[pole] = values
