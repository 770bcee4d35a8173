"""Some rows of a run computed once more in many digits, and how far the run was off.

Rows are chosen while the run goes on: those with the largest closure residual, the largest
error bound of a pole direction and the worst conditioning, the others spread evenly over
assembly modes and samples. Their configurations, rates and derivatives come from
`spherekit.proof`, which shares no solver with the run, and every analysis that reads them
is computed from both: where its rows do not stand alone, from the whole motion with these
rows replaced.
"""

import time
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from spherekit.arrays import Array, Floats, Indices
from spherekit.conventions import TURN, Facts
from spherekit.errors import AnalysisError, SpherekitError
from spherekit.geometry.rotation import nans
from spherekit.numerics.angles import wrap
from spherekit.numerics.array_rows import ArrayRows
from spherekit.positions.motion import Motion
from spherekit.proof.balls import DIGITS, Digits, floats
from spherekit.proof.decimal_mechanism import Written
from spherekit.proof.reference_rows import (
    ExactRows,
    exact_direction,
    exact_field,
    exact_motion,
    exact_rows_by_input,
)
from spherekit.runs.contract import AbstractAnalysis
from spherekit.runs.needs import Needs
from spherekit.runs.run_plan import RunPlan, motion_rows, motion_table
from spherekit.runs.run_result import MOTION
from spherekit.runs.summary import BOUNDED
from spherekit.runs.table_scenes import Angles, Fields, run_status
from spherekit.status import Status
from spherekit.storage.json_data import finite
from spherekit.tables.table import ASSEMBLY_MODE, RESIDUAL, SAMPLE, Table, TableData, arrays
from spherekit.tolerances import CLOSURE_TOLERANCE, EPS
from spherekit.velocities.pole_field import PoleField
from spherekit.velocities.pole_request import Request

GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)
"""Multiples of it, without their whole parts, are spread evenly over 0 to 1."""


BEYOND = 1e4
"""A deviation above this many roundings times the conditioning is a fault."""

OPEN = 100.0
"""Rows of a simulation may be off by this times their residual and conditioning too."""


@dataclass(frozen=True)
class _Read(ArrayRows):
    """Rows of what a batch reads: a motion, its poles, and variables that go on."""

    motion: Motion
    fields: tuple[PoleField, ...]
    angles: Angles

    def chosen(self, count: int, samples: int) -> "_Read":
        """Return the worst rows, and as many others as fit, spread, by mode and sample.

        The worst have the largest residual, bound of a direction, and condition.
        """
        motion = self.motion
        bound = nans(len(motion))
        for field in self.fields:
            for errors in field.error.values():
                bound = np.fmax(bound, errors)
        worst = [
            np.argmax(np.nan_to_num(score, nan=-1.0))
            for score in (motion.residual, bound, motion.conditioning)
        ]
        number = motion.assembly_mode * samples + motion.sample
        spread = np.argsort((number + 1) * GOLDEN % 1.0)
        wanted = list(dict.fromkeys([*worst, *spread]))[:count]
        return self.rows(np.array(wanted)[np.argsort(number[wanted])])


def in_many_digits(
    motion: Motion,
    wanted: Sequence[Request],
    fields: Sequence[PoleField],
    arithmetic: Digits | None = None,
    inputs: Array | None = None,
) -> tuple[tuple[ExactRows, ...], Motion, tuple[PoleField, ...]]:
    """Return reference values of a motion, and it and its fields with the nearest numbers.

    By each input that a request for poles moves, or by the first. See `exact_rows` for
    `arithmetic` and `inputs`, and for errors. All reference values are those of the decimal
    sizes of the file where some rows are.
    """
    every = np.ones(len(motion), dtype=bool)
    driven = [item.plan.input for item in wanted] or motion.assembly.inputs[:1]
    frames = None
    if any(np.any(field.by_decimals) for field in fields):
        arithmetic = arithmetic or Digits()
        with arithmetic.within():
            frames = Written.of(motion.mechanism).r_frames()
    exact = exact_rows_by_input(
        motion, every, driven, arithmetic, inputs=inputs, frames=frames
    )
    nearest = tuple(map(exact_field, exact, wanted, fields))
    return exact, exact_motion(motion, every, exact[0]), nearest


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
        self._job = job
        self._course = job.course
        self._wanted = [item for item in job.requests if item.poles]
        self._count = count
        self._kept: list[_Read] = []
        self._whole: _Read | None = None

    def see(
        self,
        motion: Motion,
        poles: Fields,
        angles: Angles,
    ) -> None:
        """Take a block of the run, and keep the rows of it that may be verified.

        The whole motion is kept where an analysis had it, as a single block.
        """
        read = _Read(motion, tuple(field.made for field in poles), angles)
        if self._job.at_once:
            self._whole = read
        good = run_status(motion, read.fields) == Status.OK
        if np.any(good):
            count = self._count, len(self._course)
            new = read.rows(good).chosen(*count)
            self._kept = [_Read.joined([*self._kept, new]).chosen(*count)]

    def verdict(self, failed: Collection[str] = ()) -> Facts:
        """Return what is to be said of the rows, ready for JSON.

        Analyses that `failed` in the run, or now, are not verified.

        `columns` has the largest deviation of each table column from its value in many
        digits, wrapped into one turn for angles, and where that is; `in_roundings` is the
        largest deviation over the rounding of the value (of 1, where that is smaller)
        times the conditioning of the row, at the place `worst`. `beyond` lists the columns
        where that is too much to be rounding.
        """
        started = time.perf_counter()
        verdict: Facts = {"digits": DIGITS, "rows": 0, "not_verified": []}
        if not self._kept:
            return verdict
        (kept,) = self._kept
        motion = kept.motion
        try:
            exact, better, nearest = in_many_digits(
                motion, self._wanted, kept.fields, Digits(DIGITS)
            )
        except SpherekitError as problem:
            return verdict | {"problem": str(problem)}
        status = np.max([reference.status for reference in exact], axis=0)
        self._motion = motion
        self._condition = exact[0].condition
        self._has_reference = status == Status.OK
        alone = kept, _Read(better, nearest, _as_far(better, kept.angles))
        motions = [motion_rows(self._course, read.motion, read.fields) for read in alone]
        pairs: list[_Pair] = [(MOTION, motion_table(self._course), motions[0], motions[1])]
        for analysis, needs in zip(self._job.analyses, self._job.needs, strict=True):
            try:
                rowless = needs.tracer or needs == Needs(time=needs.time)
                if analysis.name in failed or rowless:
                    raise AnalysisError("it failed, or reads other rows")
                pairs += self._pairs(analysis, alone)
            except SpherekitError:
                verdict["not_verified"].append(analysis.name)
        return verdict | {
            "rows": len(motion),
            "without_reference": [
                {
                    "sample": int(motion.sample[row]),
                    "assembly_mode": int(motion.assembly_mode[row]),
                    "status": Status(status[row]).name,
                    "distance_rad": finite(exact[0].distance[row]),
                }
                for row in np.flatnonzero(~self._has_reference)
            ],
            "largest_condition": _largest(exact[0].condition),
            "largest_distance_rad": _largest(exact[0].distance),
            **_of_columns([item for pair in pairs for item in self._compared(*pair)]),
            **self._within_bounds(
                zip(exact, self._wanted, kept.fields, nearest, strict=False)
            ),
            "seconds": time.perf_counter() - started,
        }

    def _pairs(
        self, analysis: AbstractAnalysis, both: tuple[_Read, _Read]
    ) -> list["_Pair"]:
        """Return the tables of an analysis by what was read, and by what is right."""
        if analysis.at_once and self._whole is not None:
            both = self._whole, self._replaced(self._whole, both[1])
        job = self._job
        first, second = (
            job.given(analysis, job.batch(analysis, x.motion, x.fields, x.angles))
            for x in both
        )
        return [
            (analysis.name, table, first[table.name], second[table.name])
            for table in job.tables_of(analysis)
        ]

    def _rows_of(self, data: Mapping[str, Any]) -> Indices:
        """Return the row that each row of a table belongs to, -1 if none."""
        places, wanted = (
            x[ASSEMBLY_MODE.name] + 1j * x[SAMPLE.name] for x in (vars(self._motion), data)
        )
        row = np.minimum(np.searchsorted(places, wanted), len(places) - 1)
        return np.where(places[row] == wanted, row, -1)

    def _replaced(self, whole: _Read, better: _Read) -> _Read:
        """Return what is read of a whole motion, with rows that have a reference put in."""
        motion = replace(whole.motion, placed=whole.motion.rotations)
        row = self._rows_of(vars(motion))
        order = np.arange(len(motion))
        at = np.flatnonzero((row >= 0) & self._has_reference[row])
        order[at] = len(motion) + row[at]
        made = _Read.joined([replace(whole, motion=motion), better]).rows(order)
        return replace(made, motion=replace(made.motion, samples=motion.samples))

    def _compared(
        self, analysis: str, table: Table, given: TableData, reference: TableData
    ) -> Iterator[Facts]:
        """Yield for each column of numbers the place where it deviates most."""
        if not table.in_assembly_modes:
            return
        row = self._rows_of(arrays(given))
        if not np.any(row >= 0):
            return
        first, second = (
            {name: values[row >= 0] for name, values in arrays(data).items()}
            for data in (given, reference)
        )
        row = row[row >= 0]
        # Rows of a simulation close no better than its tolerance; those are no faults.
        residual = self._motion.residual
        allowed = BEYOND + np.where(
            residual > CLOSURE_TOLERANCE, OPEN * residual / EPS, 0.0
        )
        subjects = [c.name for c in table.columns if c.kind == "text"]
        for column in table.columns:
            if column.kind != "number" or column == RESIDUAL:
                continue
            one, other = (
                np.where(self._has_reference[row], data[column.name], np.nan)
                for data in (first, second)
            )
            off = np.abs(one - other)
            if column.unit == "rad":
                off = np.abs(wrap(off))
            share = off / (EPS * np.maximum(1.0, np.abs(other)) * self._condition[row])
            compared = bool(np.any(np.isfinite(off)))
            apart, rough = (
                {
                    **{name: int(first[name][at]) for name in ("sample", "assembly_mode")},
                    "subject": {name: str(first[name][at]) for name in subjects},
                    "value": finite(one[at]),
                    "reference": finite(other[at]),
                }
                for at in (np.nanargmax(x) if compared else 0 for x in (off, share))
            )
            yield {
                "analysis": analysis,
                "table": table.name,
                "column": column.name,
                "unit": column.unit,
                "compared": compared or not np.any(np.isfinite(one)),
                "deviation": _largest(off),
                **apart,
                "in_roundings": _largest(share),
                "beyond": bool(np.any(share > allowed[row])),
                "worst": rough,
                "given_by_one_alone": int(np.sum(np.isnan(one) != np.isnan(other))),
            }

    def _within_bounds(
        self, compared: Iterable[tuple[ExactRows, Request, PoleField, PoleField]]
    ) -> dict[str, Facts]:
        """Return how many numbers of each kind in `BOUNDED` lie within their bounds.

        The worst number of each kind is there too.
        """
        told: dict[str, Facts] = {name: {"count": 0, "within_bound": 0} for name in BOUNDED}
        motion = self._motion
        links = motion.mechanism.links
        for exact, wanted, field, nearest in compared:
            moving = motion.mechanism.pairs[exact.driven].name
            for pole in wanted.poles:
                low, high = (links[k] for k in pole)
                with exact.arithmetic.within():
                    given = field.direction[pole]
                    apart = floats(exact_direction(exact, pole, given) - given)
                rate, change = (
                    np.abs(getattr(field, name)[pole] - getattr(nearest, name)[pole])
                    for name in ("velocity_coefficient", "acceleration_coefficient")
                )
                turned = field.direction_dq[pole] - nearest.direction_dq[pole]
                errors = {
                    "directions": np.linalg.norm(apart, axis=1),
                    "rates": rate,
                    "rate_derivatives": change,
                    "direction_derivatives": np.linalg.norm(turned, axis=1),
                }
                for name, error in errors.items():
                    facts, bound = told[name], getattr(field, BOUNDED[name].bound)[pole]
                    judged = self._has_reference & np.isfinite(error) & np.isfinite(bound)
                    over = np.where(judged, error / np.maximum(bound, EPS**2), -1.0)
                    facts["count"] += int(np.sum(judged))
                    facts["within_bound"] += int(np.sum(judged & (over <= 1.0)))
                    row = np.argmax(over)
                    if over[row] > facts.get("over_bound", -1.0):
                        facts |= {
                            "over_bound": float(over[row]),
                            "error": float(error[row]),
                            "bound": float(bound[row]),
                            "sample": int(motion.sample[row]),
                            "assembly_mode": int(motion.assembly_mode[row]),
                            "subject": {"link": high, "relative_to": low, "moving": moving},
                        }
        return told


_Pair = tuple[str, Table, TableData, TableData]
"""An analysis, a table of it, its rows, and those that are right."""


def _as_far(better: Motion, angles: Angles) -> Angles:
    """Return the variables of better rows, after as many turns as continued ones made."""
    turned = {}
    for name, angle in angles.items():
        (number,) = better.mechanism.variables_of(better.mechanism.pair_number[name])
        value = better.values[:, number]
        turned[name] = value + TURN * np.round((angle - value) / TURN)
    return turned


def _of_columns(columns: Sequence[Facts]) -> Facts:
    """Return what is to be said of columns that were compared, and of the others."""
    told = [item for item in columns if item["compared"]]
    worst = max(told, key=lambda item: item["in_roundings"])

    def name(item: Facts) -> str:
        return f"{item['table']}.{item['column']}"

    return {
        "columns": told,
        "not_recomputed": [name(item) for item in columns if not item["compared"]],
        "worst": {
            "column": name(worst),
            "in_roundings": worst["in_roundings"],
            **worst["worst"],
        },
        "beyond": [name(item) for item in told if item["beyond"]],
    }


def _largest(values: Floats) -> float:
    return float(np.nanmax(values, initial=0.0))
