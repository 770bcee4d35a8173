"""Poles from what a kernel gives of the rows, those in doubt with care."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import Status
from spherekit.motion.motion import Motion
from spherekit.planning.poles import Pole
from spherekit.rates.columns import RateColumns
from spherekit.rates.field import add_locked, by_sequence
from spherekit.rates.pole_field import PoleField
from spherekit.rates.request import Request
from spherekit.rates.sequence import PlannedPoles
from spherekit.rates.unread_columns import UnreadColumns
from spherekit.sphere.rotation import Floats


@final
@dataclass(frozen=True)
class CarefulRows:
    """Rows by their numbers (k,), and the poles that were found of these with care."""

    rows: NDArray[np.intp]
    field: PoleField

    @classmethod
    def of(
        cls, motion: Motion, wanted: Request, rows: NDArray[np.intp]
    ) -> "CarefulRows | None":
        """Return those of a motion, by `evaluate`'s ``best``; None where rows are none."""
        if not len(rows):
            return None
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            few = replace(wanted, planes=frozenset())
            field = by_sequence(motion.rows(rows), few, "best")
            turned = {pole: field.turned(wanted.plan, pole) for pole in field.direction}
        return cls(rows, replace(field, direction_dq=turned))

    def write(self, columns: RateColumns, signed: Sequence[Pole]) -> None:
        """Write them to columns (k rows); rates of the poles `signed` are not negative."""
        field = self.field
        for pole, part in columns.poles.items():
            for name, of in PARTS.items():
                if name not in ("w", "dw"):
                    getattr(part, of)[:] = getattr(field, name)[pole].T
            if pole in signed:
                turned = np.where(part.rate < 0.0, -1.0, 1.0)
                for values in (part.direction, part.turn, part.rate, part.change):
                    values *= turned
        for name in ("w", "dw"):
            for link, vectors in getattr(columns, name).items():
                vectors[:] = getattr(field, name)[link].T

    def relative(self, pole: Pole, rows: NDArray[np.intp]) -> tuple[Floats, Floats]:
        """Return (3, k) relative angular velocities of some of them, and their changes."""
        (i, j), w, dw = pole, self.field.w, self.field.dw
        return (w[j] - w[i])[rows].T, (dw[j] - dw[i])[rows].T

    def put_into(self, column: NDArray[Any], values: NDArray[Any]) -> NDArray[Any]:
        """Return a copy of a column of all rows with the values of these."""
        made = column.copy()
        made[self.rows] = values
        return made

    def largest(self, name: str) -> float | None:
        """Return the largest number of a part at rows that are well, None without any."""
        good = self.field.status == Status.OK
        values = [errors[good] for errors in getattr(self.field, name).values()]
        finite = np.concatenate([x[np.isfinite(x)] for x in values] or [np.empty(0)])
        return float(np.max(finite)) if len(finite) else None


def field_unread(
    motion: Motion,
    wanted: Request,
    columns: UnreadColumns,
    vouched: NDArray[np.bool_],
    errors: Sequence[float | None],
    careful: CarefulRows | None,
) -> PoleField:
    """Return the poles of a motion, made when they are read.

    A kernel vouches for rows (n,) or they are in `columns` as they were found with care.
    `errors` are the largest of directions, rates and changes, of the kernel.
    """
    parts = {name: columns.part(of) for name, of in PARTS.items()}
    for name, most in zip(ERRORS, errors, strict=True):
        largest = careful.largest(name) if careful is not None else None
        both = [x for x in (most, largest) if x is not None]
        parts[name].largest = max(both, default=None)
    status, loss = motion.status, _loss(motion)
    by_equations = np.broadcast_to(False, len(motion))
    pole_status = dict.fromkeys(parts["direction"], status)
    if careful is not None:
        status = careful.put_into(status, careful.field.status)
        loss = careful.put_into(loss, careful.field.loss)
        by_equations = careful.put_into(by_equations, careful.field.by_equations)
        for pole in pole_status:
            of_pole = careful.field.pole_status[pole]
            alike = np.array_equal(of_pole, careful.field.status)
            pole_status[pole] = status if alike else careful.put_into(status, of_pole)
    field = PoleField(
        **parts,
        planes=_PlanesWhenRead(wanted, motion),
        status=status,
        pole_status=pole_status,
        by_equations=by_equations,
        by_kernel=vouched,
        loss=loss,
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


def _loss(motion: Motion) -> Floats:
    """Return (n,) the part of the rates in doubt: none, and unknown of some rows."""
    nothing = motion.failed
    if not np.any(nothing):
        return np.broadcast_to(0.0, len(motion))
    return np.where(nothing, np.nan, 0.0)


def _with_locked(field: PoleField, motion: Motion, wanted: Request) -> PoleField:
    """Add the poles that there are none of."""
    for pole in wanted.poles:
        if pole not in field.pole_status:
            add_locked(field, motion, pole)
            field.direction_dq[pole] = field.direction[pole]
    return field


@final
class _PlanesWhenRead(dict[Pole, Floats]):
    """The great circles of poles, drawn when they are first read."""

    def __init__(self, wanted: Request, motion: Motion) -> None:
        super().__init__()
        self._wanted, self._motion = wanted, motion

    def __missing__(self, pole: Pole) -> Floats:
        self[pole] = np.full((len(self._motion), 2, 3), np.nan)
        if pole in self._wanted.planes:
            self[pole] = PlannedPoles(self._wanted.plan, self._motion).circles(pole)
        return self[pole]
