"""How far the errors that spherekit states for its rows hold, and how wide they are."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from benchmarks.random_mechanisms import random_mechanism
from benchmarks.report import Cell, Section
from spherekit.conventions import Status
from spherekit.errors import SpherekitError
from spherekit.exact.arithmetic import Digits, wide
from spherekit.exact.field import exact_direction
from spherekit.exact.rows import ExactRows, exact_rows
from spherekit.files.library import shipped
from spherekit.files.read import load
from spherekit.model.mechanism import Mechanism
from spherekit.motion.motion import Motion, Tracer
from spherekit.planning.poles import all_poles
from spherekit.rates.field import PoleField, evaluate
from spherekit.rates.request import request
from spherekit.sphere.rotation import Floats

QUICK = ("four_bar", "universal_joint", "roller_cam", "stephenson")


@final
@dataclass(frozen=True)
class Stated:
    """Errors and what is stated for them, of some configurations and directions (rad)."""

    off: Floats
    known: Floats
    apart: Floats
    bound: Floats


def run(quick: bool) -> list[Section]:
    """Return the share of errors within what is stated, and how much of it they take."""
    names: tuple[str, ...] = QUICK
    if not quick:
        packs = [pack for pack in shipped() if pack.distribution == "spherekit"]
        names = tuple(sorted(name for pack in packs for name in pack.files))
    rows = [_row(name, [load(name)], 13) for name in names]
    families: dict[str, list[Mechanism]] = {}
    for seed in range(30 if quick else 1000):
        family, made = random_mechanism(seed)
        families.setdefault(family, []).append(made)
    rows += [_row(f"{name}, random", made, 3) for name, made in families.items()]
    return [
        Section(
            "Stated errors",
            "The shipped mechanisms and random ones, all modes of the former: what "
            "configurations and pole directions are off by, against the closure equations "
            f"in {wide().name} (50 digits where that says no), over `configuration_error` "
            "and `error_bound`. Above 1 it would be wrong; the median says how wide it is.",
            (
                "mechanism",
                "configurations",
                "largest part",
                "median part",
                "directions",
                "largest part of the bound",
                "median part of the bound",
                "largest error stated, rad",
            ),
            [row for row in rows if row[1]],
            ratios=("largest part", "largest part of the bound"),
        )
    ]


def _row(name: str, several: list[Mechanism], samples: int) -> tuple[Cell, ...]:
    found = [stated(tracer) for tracer in _tracers(several, samples)]
    off, known, apart, bound = (
        np.concatenate([getattr(each, part) for each in found] or [np.empty(0)])
        for part in ("off", "known", "apart", "bound")
    )
    if not len(off) or not len(apart):
        return (name, 0, None, None, 0, None, None, None)
    one, other = off / known, apart / bound
    return (
        name,
        len(one),
        float(np.max(one)),
        float(np.median(one)),
        len(other),
        float(np.max(other)),
        float(np.median(other)),
        float(np.max(bound)),
    )


def _tracers(several: list[Mechanism], samples: int) -> Iterator[Tracer]:
    for made in several:
        grid = samples if len(made.inputs) == 1 else [3] * len(made.inputs)
        branch = None if len(several) == 1 else 0
        try:
            yield Tracer(made, search=False, samples=grid, branch=branch)
        except SpherekitError:
            continue


def stated(tracer: Tracer) -> Stated:
    """Return errors and statements of the rows that are OK and have a reference."""
    motion = tracer.motion()
    made = motion.mechanism
    poles = all_poles(len(made.links))
    off, known = np.empty(0), np.empty(0)
    apart, bound = [np.empty(0)], [np.empty(0)]
    for driven in motion.assembly.inputs:
        wanted = request(
            made, made.pairs[driven].name, poles, poles, by_rank=tracer.by_rank
        )
        field = evaluate(motion, wanted)
        good = field.status == Status.OK
        if not np.any(good):
            continue
        exact = exact_rows(motion, good, driven, wide())
        judged = exact.status == Status.OK
        off, known = exact.distance[judged], motion.configuration_error[good][judged]
        errors, bounds = _directions(motion, field, good, exact)
        beyond = np.any(errors > bounds, axis=0)
        if np.any(beyond):  # axes of links that hardly move need more than 18 digits
            rows = np.flatnonzero(good)[beyond]
            again = exact_rows(motion, _only(rows, len(motion)), driven, Digits(50))
            errors[:, beyond], _ = _directions(
                motion, field, _only(rows, len(motion)), again
            )
        stands = judged & np.isfinite(errors)
        apart.append(errors[stands])
        bound.append(bounds[stands])
    return Stated(off, known, np.concatenate(apart), np.concatenate(bound))


def _only(rows: NDArray[np.intp], count: int) -> NDArray[np.bool_]:
    chosen = np.zeros(count, dtype=bool)
    chosen[rows] = True
    return chosen


def _directions(
    motion: Motion, field: PoleField, rows: NDArray[np.bool_], exact: ExactRows
) -> tuple[Floats, Floats]:
    """Return errors and bounds (poles, rows) of all directions."""
    errors, bounds = [], []
    for pole in field.direction:
        given = field.direction[pole][rows]
        way = exact_direction(exact, pole, given) - exact.arithmetic.exact(given)
        errors.append(np.linalg.norm(exact.arithmetic.floats(way), axis=1))
        bounds.append(field.error[pole][rows])
    return np.array(errors), np.array(bounds)
