"""Poles from what a kernel found of the rows, those in doubt with care."""

from collections.abc import Sequence
from dataclasses import replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.motion.motion import Motion
from spherekit.numeric.lent_memory import LentMemory
from spherekit.planning.poles import Pole
from spherekit.rates.columns import Gaps, PoleColumns, RateColumns
from spherekit.rates.field import add_locked, by_lines
from spherekit.rates.lines import evaluate_lines
from spherekit.rates.pole_field import PoleField
from spherekit.rates.request import Request
from spherekit.rates.signs import (
    SignMemory,
    continuous_signs,
    sided_signs,
    steady_signs,
    turn_each,
    turn_round,
)
from spherekit.rates.unread_columns import UnreadColumns
from spherekit.sphere.rotation import Floats


def field_of_columns(
    motion: Motion,
    wanted: Request,
    columns: RateColumns,
    vouched: NDArray[np.bool_],
    memory: SignMemory,
    with_planes: bool,
    steady: bool,
    memory_of_gaps: LentMemory,
) -> PoleField:
    """Return the requested poles of a motion from what a kernel found of its rows.

    Rows that it does not vouch for (n,) are found by `evaluate`'s ``best``, and put in
    their place; `columns` are written to, and hold nothing where the motion has nothing.
    Great circles are drawn when they are read, or at once, `with_planes`. `steady` says
    that all other rows are vouched for, and no direction reverses within an assembly mode.
    """
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        nothing = np.flatnonzero(motion.failed)
        rest = np.flatnonzero(~vouched & ~motion.failed)
        if len(nothing):
            columns = Gaps(nothing, memory_of_gaps).within(columns)
        if len(rest):
            columns = columns.parted()
        field = _field(motion, wanted, columns, vouched, nothing)
        careful = _with_care(field, motion, wanted, rest) if len(rest) else None
        if steady and motion.is_path:
            held = columns.with_sign
            signs = steady_signs(motion, columns.signed, lambda k: held[:, :, k], memory)
            turn_round(columns, signs)
        for pole, pole_columns in columns.poles.items():
            if not pole_columns.is_signed or (steady and motion.is_path):
                continue
            if not motion.is_path:
                turn_each(pole_columns, sided_signs(motion, pole_columns.direction, memory))
            else:
                _go_on(motion, pole, pole_columns, careful, memory)
    for pole in wanted.planes if with_planes else ():
        _ = field.planes[pole]
    return field


def _field(
    motion: Motion,
    wanted: Request,
    columns: RateColumns,
    vouched: NDArray[np.bool_],
    nothing: NDArray[np.intp],
) -> PoleField:
    """Return what columns say, with their signs, as views; `nothing` is known of some."""
    n, items = len(motion), columns.poles.items()
    field = PoleField(
        direction={pole: part.direction.T for pole, part in items},
        velocity_coefficient={pole: part.rate for pole, part in items},
        acceleration_coefficient={pole: part.change for pole, part in items},
        angle={pole: part.angle for pole, part in items},
        error={pole: part.direction_error for pole, part in items},
        velocity_coefficient_error={pole: part.rate_error for pole, part in items},
        acceleration_coefficient_error={pole: part.change_error for pole, part in items},
        planes=_PlanesWhenRead(wanted, motion),
        w={link: values.T for link, values in columns.w.items()},
        dw={link: values.T for link, values in columns.dw.items()},
        status=motion.status,
        pole_status=dict.fromkeys(columns.poles, motion.status),
        by_equations=np.broadcast_to(False, n),
        by_kernel=vouched,
        loss=_loss(n, nothing),
        direction_dq={pole: part.turn.T for pole, part in items},
    )
    return _with_locked(field, motion, wanted)


def field_unread(
    motion: Motion,
    wanted: Request,
    columns: UnreadColumns,
    vouched: NDArray[np.bool_],
    errors: Sequence[float | None],
) -> PoleField:
    """Return the poles of a motion that a kernel vouches for, made when they are read.

    `errors` are the largest of directions, rates and changes.
    """
    parts = {name: columns.part(of) for name, of in PARTS.items()}
    for name, most in zip(ERRORS, errors, strict=True):
        parts[name].largest = most
    nothing = np.flatnonzero(motion.failed)
    field = PoleField(
        **parts,
        planes=_PlanesWhenRead(wanted, motion),
        status=motion.status,
        pole_status=dict.fromkeys(parts["direction"], motion.status),
        by_equations=np.broadcast_to(False, len(motion)),
        by_kernel=vouched,
        loss=_loss(len(motion), nothing),
    )
    return _with_locked(field, motion, wanted)


PARTS = {
    "direction": "direction",
    "velocity_coefficient": "rate",
    "acceleration_coefficient": "change",
    "angle": "angle",
    "error": "direction_error",
    "velocity_coefficient_error": "rate_error",
    "acceleration_coefficient_error": "change_error",
    "w": "w",
    "dw": "dw",
    "direction_dq": "turn",
}
"""Parts of a field, and which columns these are."""
ERRORS = ("error", "velocity_coefficient_error", "acceleration_coefficient_error")


def _loss(n: int, nothing: NDArray[np.intp]) -> Floats:
    """Return (n,) the part of the rates in doubt: none, and unknown of some rows."""
    if not len(nothing):
        return np.broadcast_to(0.0, n)
    loss = np.zeros(n)
    loss[nothing] = np.nan
    return loss


def _with_locked(field: PoleField, motion: Motion, wanted: Request) -> PoleField:
    """Add the poles that there are none of."""
    for pole in wanted.poles:
        if pole not in field.pole_status:
            add_locked(field, motion, pole)
            field.direction_dq[pole] = field.direction[pole]
    return field


def _with_care(
    field: PoleField, motion: Motion, wanted: Request, rest: NDArray[np.intp]
) -> tuple[NDArray[np.intp], PoleField]:
    """Put rows in by their numbers, found with care; return them, and which."""
    careful = by_lines(motion.rows(rest), replace(wanted, planes=frozenset()), "best")
    turned = {pole: careful.turned(wanted.plan, pole) for pole in field.direction_dq}
    given = replace(careful, direction_dq=turned)
    for name in ("status", "by_equations", "loss"):
        column = getattr(field, name).copy()
        column[rest] = getattr(given, name)
        object.__setattr__(field, name, column)
    for pole, status in field.pole_status.items():
        field.pole_status[pole] = status.copy()
    for name in ROWS_OF_EACH:
        new = getattr(given, name)
        for key, values in getattr(field, name).items():
            values[rest] = new[key]
    return rest, careful


ROWS_OF_EACH = (
    "direction",
    "velocity_coefficient",
    "acceleration_coefficient",
    "angle",
    "error",
    "velocity_coefficient_error",
    "acceleration_coefficient_error",
    "w",
    "dw",
    "pole_status",
    "direction_dq",
)
"""The parts of a field that have arrays for each pole or link."""


def _go_on(
    motion: Motion,
    pole: Pole,
    columns: PoleColumns,
    careful: tuple[NDArray[np.intp], PoleField] | None,
    memory: SignMemory,
) -> None:
    """Give a direction, and what goes with it, the signs that continue, in place."""
    i, j = pole
    v, dv = columns.relative(slice(None))
    if careful is not None:
        rest, field = careful
        v[:, rest] = (field.w[j] - field.w[i]).T
        dv[:, rest] = (field.dw[j] - field.dw[i]).T
    signs = continuous_signs(motion, columns.direction, columns.rate, v, dv, pole, memory)
    for values in columns.with_sign:
        values *= signs


@final
class _PlanesWhenRead(dict[Pole, Floats]):
    """The great circles of poles, drawn when they are first read."""

    def __init__(self, wanted: Request, motion: Motion) -> None:
        super().__init__()
        self._wanted, self._motion = wanted, motion

    def __missing__(self, pole: Pole) -> Floats:
        plan, motion = self._wanted.plan, self._motion
        body_pole = plan.pole(*pole)
        self[pole] = np.full((len(motion), 2, 3), np.nan)
        if pole in self._wanted.planes and body_pole is not None:
            with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
                lines = evaluate_lines(plan, motion, [body_pole])
            self[pole] = np.moveaxis(lines.planes[body_pole], -1, 0)
        return self[pole]
