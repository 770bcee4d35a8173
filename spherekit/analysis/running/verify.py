"""Some rows of a run computed once more in many digits, and how far the run was off.

Rows are chosen while the run goes on: those with the largest closure residual, the largest
error bound of a pole direction and the worst conditioning, the others spread evenly over
assembly modes and samples. Their configurations, rates and derivatives come from
`spherekit.proof`, which shares no solver with the run, and every analysis that reads them
is computed from both: where its rows do not stand alone, from the whole motion with these
rows replaced.
"""

import time
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, final

import numpy as np

from spherekit.analysis.batch import Batch, Needs
from spherekit.analysis.computed import computed
from spherekit.analysis.result import MOTION
from spherekit.analysis.running.kernel_columns import UnreadField
from spherekit.analysis.running.summary import BOUNDED, RunPlan
from spherekit.analysis.tables import (
    ASSEMBLY_MODE,
    RESIDUAL,
    SAMPLE,
    Column,
    Table,
    TableArrays,
    arrays,
)
from spherekit.arrays import Bools, Floats, Indices
from spherekit.conventions import CLOSURE_TOLERANCE, EPS, TURN, Status
from spherekit.errors import SpherekitError
from spherekit.motion.motion import Motion
from spherekit.numeric.crossings import wrap
from spherekit.numeric.zeros import ArrayRows
from spherekit.planning.poles import Pole
from spherekit.proof.balls import DIGITS, Digits, floats
from spherekit.proof.rows import (
    ExactRows,
    exact_direction,
    exact_field,
    exact_motion,
    exact_rows_by_input,
)
from spherekit.rates.request import PoleField, Request
from spherekit.sphere.rotation import nans

GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)
"""Multiples of it, without their whole parts, are spread evenly over 0 to 1."""


Read = tuple[Motion, tuple[PoleField, ...], Mapping[str, Floats]]
"""What a batch reads: a motion, its poles, and variables that go on."""

BEYOND = 1e4
"""A deviation above this many roundings times the conditioning is a fault."""

TINY = 1e-300

OPEN = 100.0
"""Rows of a simulation may be off by this times their residual and conditioning too."""


@final
@dataclass(frozen=True)
class _Kept(ArrayRows):
    """Rows of a motion with fields and continued angles, and what they are chosen by."""

    motion: Motion
    fields: tuple[PoleField, ...]
    angles: Mapping[str, Floats]
    spread: Floats
    bound: Floats
    condition: Floats

    def worst(self) -> list[int]:
        """Return the rows with the largest residual, bound and condition."""
        scores = (self.motion.residual, self.bound, self.condition)
        return [int(np.argmax(np.nan_to_num(score, nan=-1.0))) for score in scores]

    def chosen(self, count: int) -> Bools:
        """Return which rows to keep: the worst, and as many others as fit, spread."""
        wanted = dict.fromkeys([*self.worst(), *map(int, np.argsort(self.spread))])
        rows = np.zeros(len(self.spread), dtype=bool)
        rows[list(wanted)[:count]] = True
        return rows


@final
class Verifier:
    """Chooses rows of a run as they come, and verifies them in the end.

    Parameters
    ----------
    job
        What the run evaluates.
    count
        How many rows to verify.
    """

    def __init__(self, job: RunPlan, count: int) -> None:
        self._plans, self._timed = job.plans, job.course.timed
        self._wanted = [item for item in job.requests if item.poles]
        self._analyses = list(zip(job.analyses, job.needs, strict=True))
        self._samples, self._count = job.course.total, count
        self._kept: _Kept | None = None
        self._whole: Read | None = None

    def see(
        self,
        motion: Motion,
        poles: Sequence[PoleField | UnreadField],
        angles: Mapping[str, Floats],
    ) -> None:
        """Take a block of the run, and keep the rows of it that may be verified.

        The whole motion is kept where an analysis had it, as a single block.
        """
        fields = tuple(field.made for field in poles)
        if any(analysis.at_once for analysis, _ in self._analyses):
            self._whole = motion, fields, angles
        good = motion.status == Status.OK
        for field in fields:
            good &= field.status == Status.OK
        if not np.any(good):
            return
        good_rows = motion.rows(good)
        good_fields = tuple(field.rows(good) for field in fields)
        turned = {name: angle[good] for name, angle in angles.items()}
        number = good_rows.assembly_mode * self._samples + good_rows.sample
        bound = nans(len(good_rows))
        for field in good_fields:
            for pole in field.error:
                bound = np.fmax(bound, field.error[pole])
        spread = (number + 1) * GOLDEN % 1.0
        new = _Kept(good_rows, good_fields, turned, spread, bound, good_rows.conditioning)
        new = new.rows(new.chosen(self._count))
        if self._kept is not None:
            new = _together(self._kept, new)
        self._kept = new.rows(new.chosen(self._count))

    def verdict(self, failed: Collection[str] = ()) -> dict[str, Any]:
        """Return what is to be said of the rows, ready for JSON.

        Analyses that `failed` in the run, or now, are not verified.

        `columns` has the largest deviation of each table column from its value in many
        digits, wrapped into one turn for angles, and where that is; `in_roundings` is the
        largest deviation over the rounding of the value (of 1, where that is smaller)
        times the conditioning of the row, at the place `worst`. `beyond` lists the columns
        where that is too much to be rounding.
        """
        started = time.perf_counter()
        verdict: dict[str, Any] = {
            "digits": DIGITS,
            "rows": 0,
            "not_verified": [],
        }
        if self._kept is None:
            return verdict
        motion, fields = self._kept.motion, self._kept.fields
        every = np.ones(len(motion), dtype=bool)
        driven = [item.plan.input for item in self._wanted] or motion.assembly.inputs[:1]
        arithmetic = Digits(DIGITS)
        try:
            exact = exact_rows_by_input(motion, every, driven, arithmetic)
        except SpherekitError as problem:
            return verdict | {"problem": str(problem)}
        status = np.max([reference.status for reference in exact], axis=0)
        compared = list(zip(exact, self._wanted, fields, strict=False))
        nearest = tuple(exact_field(*triple) for triple in compared)
        better = exact_motion(motion, every, exact[0])
        rows = _Rows(motion, status == Status.OK, exact[0].condition, _allowed(motion))
        pairs = [(MOTION, *tables) for tables in _configurations(motion, better)]
        angles = self._kept.angles
        alone = (motion, fields, angles), (better, nearest, _as_far(better, angles))
        for analysis, needs in self._analyses:
            if analysis.name in failed or not _reads_rows(needs):
                verdict["not_verified"].append(analysis.name)
                continue
            both = alone
            if analysis.at_once and self._whole is not None:
                both = self._whole, _replaced(self._whole, rows, *alone[1])
            try:
                declared = [table.of(motion.mechanism) for table in analysis.tables]
                first, second = (
                    computed(
                        analysis,
                        declared,
                        Batch(motion.mechanism, self._plans, needs, *read, self._timed),
                    )
                    for read in both
                )
            except SpherekitError:
                verdict["not_verified"].append(analysis.name)
                continue
            pairs += [
                (
                    analysis.name,
                    table,
                    arrays(first[table.name]),
                    arrays(second[table.name]),
                )
                for table in declared
            ]
        columns = [item for pair in pairs for item in _compared(rows, *pair)]
        told = [item for item in columns if item["compared"]]
        worst = max(told, key=lambda item: float(item["in_roundings"]))
        return verdict | {
            "rows": len(motion),
            "without_reference": [
                {
                    "sample": int(motion.sample[row]),
                    "assembly_mode": int(motion.assembly_mode[row]),
                    "status": Status(int(status[row])).name,
                    "distance_rad": _number(exact[0].distance[row]),
                }
                for row in np.flatnonzero(~rows.has_reference)
            ],
            "largest_condition": _largest(exact[0].condition),
            "largest_distance_rad": _largest(exact[0].distance),
            "columns": told,
            "not_recomputed": [
                f"{item['table']}.{item['column']}"
                for item in columns
                if not item["compared"]
            ],
            **_within_bounds(rows, compared, nearest),
            "worst": {
                "column": f"{worst['table']}.{worst['column']}",
                "in_roundings": worst["in_roundings"],
                **worst["worst"],
            },
            "beyond": [
                f"{item['table']}.{item['column']}" for item in told if item["beyond"]
            ],
            "seconds": time.perf_counter() - started,
        }


@final
@dataclass(frozen=True)
class _Rows:
    """The rows compared.

    Whether each has a reference, its conditioning, and how many roundings times that a
    number may be off.
    """

    motion: Motion
    has_reference: Bools
    condition: Floats
    allowed: Floats

    def of(self, data: TableArrays) -> Indices:
        """Return the row that each row of a table belongs to, -1 if none."""
        number = {
            place: row
            for row, place in enumerate(
                zip(
                    self.motion.sample.tolist(),
                    self.motion.assembly_mode.tolist(),
                    strict=True,
                )
            )
        }
        places = zip(
            np.asarray(data["sample"]).tolist(),
            np.asarray(data["assembly_mode"]).tolist(),
            strict=True,
        )
        return np.array([number.get(place, -1) for place in places], dtype=np.intp)


def _reads_rows(needs: Needs) -> bool:
    """Return whether an analysis reads rows of the motion, and no others."""
    return not needs.tracer and needs != Needs(time=needs.time)


def _replaced(
    whole: Read,
    rows: _Rows,
    better: Motion,
    nearest: tuple[PoleField, ...],
    angles: Mapping[str, Floats],
) -> Read:
    """Return what is read of a whole motion, with rows that have a reference put in."""
    motion, fields, going_on = whole
    row = rows.of({"sample": motion.sample, "assembly_mode": motion.assembly_mode})
    at = np.flatnonzero(row >= 0)
    at = at[rows.has_reference[row[at]]]
    source = row[at]

    def put(old: Any, new: Any) -> Any:
        if isinstance(old, dict):
            return {key: put(old[key], new[key]) for key in old}
        changed = old.copy()
        changed[at] = new[source]
        return changed

    names = {"values": "values", "placed": "rotations", "residual": "residual"}
    parts = {
        part: put(getattr(motion, name), getattr(better, name))
        for part, name in names.items()
    }
    better_fields = tuple(
        PoleField(
            **{name: put(value, getattr(new, name)) for name, value in vars(old).items()}
        )
        for old, new in zip(fields, nearest, strict=True)
    )
    return replace(motion, **parts), better_fields, put(going_on, angles)


def _as_far(better: Motion, angles: Mapping[str, Floats]) -> Mapping[str, Floats]:
    """Return the variables of better rows, after as many turns as continued ones made."""
    turned = {}
    for name, angle in angles.items():
        (number,) = better.mechanism.variables_of(better.mechanism.pair_number[name])
        value = better.values[:, number]
        turned[name] = value + TURN * np.round((angle - value) / TURN)
    return turned


def _configurations(
    motion: Motion, better: Motion
) -> Iterator[tuple[Table, TableArrays, TableArrays]]:
    """Yield the table of pair variables, as it was and in many digits."""
    mechanism = motion.mechanism
    names = mechanism.variable_names
    columns = tuple(Column(name, "rad", "pair variable") for name in names)
    table = Table(MOTION, "the configurations", (SAMPLE, ASSEMBLY_MODE, *columns))
    first, second = (
        {"sample": configurations.sample, "assembly_mode": configurations.assembly_mode}
        | {name: configurations.values[:, k] for k, name in enumerate(names)}
        for configurations in (motion, better)
    )
    yield table, first, second


def _allowed(motion: Motion) -> Floats:
    """Return (n,) how many roundings a number may be off.

    Rows of a simulation close no better than its tolerance; those are not faults.
    """
    simulated = motion.residual > CLOSURE_TOLERANCE
    return BEYOND + np.where(simulated, OPEN * motion.residual / EPS, 0.0)


def _compared(
    rows: _Rows, analysis: str, table: Table, given: TableArrays, reference: TableArrays
) -> Iterator[dict[str, Any]]:
    """Yield for each column of numbers the place where it deviates most."""
    if not {"sample", "assembly_mode"} <= set(given):
        return
    row = rows.of(given)
    if not np.any(row >= 0):
        return
    given, reference = (
        {name: np.asarray(values)[row >= 0] for name, values in data.items()}
        for data in (given, reference)
    )
    row = row[row >= 0]
    has_reference = rows.has_reference[row]
    subjects = [c.name for c in table.columns if c.kind == "text"]
    for column in table.columns:
        if column.kind != "number" or column == RESIDUAL:
            continue
        one, other = (
            np.where(has_reference, np.asarray(data[column.name], dtype=float), np.nan)
            for data in (given, reference)
        )
        off = np.abs(one - other)
        if column.unit == "rad":
            off = np.abs(wrap(off))
        rounding = EPS * np.maximum(1.0, np.abs(other)) * rows.condition[row]
        share = off / rounding
        compared = bool(np.any(np.isfinite(off)))
        apart, rough = (
            int(np.nanargmax(measure)) if compared else 0 for measure in (off, share)
        )

        def place(at: int, one: Floats = one, other: Floats = other) -> dict[str, Any]:
            return {
                "sample": int(given["sample"][at]),
                "assembly_mode": int(given["assembly_mode"][at]),
                "subject": {name: str(given[name][at]) for name in subjects},
                "value": _number(one[at]),
                "reference": _number(other[at]),
            }

        yield {
            "analysis": analysis,
            "table": table.name,
            "column": column.name,
            "unit": column.unit,
            "compared": compared or not np.any(np.isfinite(one)),
            "deviation": _largest(off),
            **place(apart),
            "in_roundings": _largest(share),
            "beyond": bool(np.any(share > rows.allowed[row])),
            "worst": place(rough),
            "given_by_one_alone": int(np.sum(np.isnan(one) != np.isnan(other))),
        }


def _within_bounds(
    rows: _Rows,
    compared: Sequence[tuple[ExactRows, Request, PoleField]],
    references: Sequence[PoleField],
) -> dict[str, dict[str, Any]]:
    """Return how many directions, rates and derivatives lie within their bounds.

    With the worst of each.
    """
    verdicts = {name: _Within() for name in BOUNDED}
    for (exact, wanted, field), nearest in zip(compared, references, strict=True):
        for pole in wanted.poles:
            given = field.direction[pole]
            with exact.arithmetic.within():
                apart = floats(exact_direction(exact, pole, given) - given)
            errors = {
                "directions": np.linalg.norm(apart, axis=1),
                "rates": np.abs(
                    field.velocity_coefficient[pole] - nearest.velocity_coefficient[pole]
                ),
                "rate_derivatives": np.abs(
                    field.acceleration_coefficient[pole]
                    - nearest.acceleration_coefficient[pole]
                ),
            }
            bounds = (
                field.error,
                field.velocity_coefficient_error,
                field.acceleration_coefficient_error,
            )
            for (name, error), bound in zip(errors.items(), bounds, strict=True):
                verdicts[name].add(rows, exact.driven, pole, error, bound[pole])
    return {name: verdict.told for name, verdict in verdicts.items()}


@final
class _Within:
    """How many numbers of a kind lie within their bounds, and the worst."""

    def __init__(self) -> None:
        self.told: dict[str, Any] = {"count": 0, "within_bound": 0, "over_bound": 0.0}

    def add(
        self, rows: _Rows, driven: int, pole: Pole, error: Floats, bound: Floats
    ) -> None:
        """Count the numbers of a pole in all rows."""
        motion = rows.motion
        judged = rows.has_reference & np.isfinite(error) & np.isfinite(bound)
        if not np.any(judged):
            return
        over = np.where(judged, error / np.maximum(bound, TINY), 0.0)
        self.told["count"] += int(np.sum(judged))
        self.told["within_bound"] += int(np.sum(judged & (over <= 1.0)))
        at = int(np.argmax(over))
        if over[at] >= self.told["over_bound"]:
            links = motion.mechanism.links
            self.told |= {
                "over_bound": float(over[at]),
                "error": float(error[at]),
                "bound": float(bound[at]),
                "sample": int(motion.sample[at]),
                "assembly_mode": int(motion.assembly_mode[at]),
                "subject": {
                    "link": links[pole[1]],
                    "relative_to": links[pole[0]],
                    "moving": motion.mechanism.pairs[driven].name,
                },
            }


def _together(one: _Kept, other: _Kept) -> _Kept:
    """Return the rows of two blocks, mode after mode, in each the samples in order."""
    both = _Kept.joined([one, other])
    return both.rows(np.lexsort((both.motion.sample, both.motion.assembly_mode)))


def _largest(values: Floats) -> float:
    return float(np.nanmax(values, initial=0.0))


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
