"""Routes to poles against each other, and against all great circles by least squares."""

import time
from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from benchmarks.least_squares import directions_and_rates
from benchmarks.report import Cell, Section
from benchmarks.timing import median, ratio, rounds
from spherekit.conventions import Status
from spherekit.files.read import load
from spherekit.motion.motion import Motion, Tracer
from spherekit.planning.poles import Pole, all_poles
from spherekit.rates.field import evaluate
from spherekit.rates.lines import evaluate_line_rates, evaluate_lines
from spherekit.rates.request import Request, request
from spherekit.rates.routes import Route
from spherekit.sphere.rotation import Floats

MECHANISMS = ("four_bar", "stephenson", "eight_bar_01", "double_butterfly", "shaped_cam")

Found = tuple[Mapping[Pole, Floats], Mapping[Pole, Floats]]
"""Directions (3, n) of poles and their derivatives."""


def run(quick: bool) -> list[Section]:
    """Return the section."""
    rows: list[tuple[Cell, ...]] = []
    for name in MECHANISMS[:2] if quick else MECHANISMS:
        jobs, rest = routes(name, 61 if quick else 361)
        times = rounds(jobs, 3 if quick else 15, now=time.process_time)
        for route, job in jobs.items():
            own = median(times, route), ratio(times, route, "conditioned")
            rows.append((name, route, *apart(job(), *rest), 1e3 * own[0], own[1]))
    return [
        Section(
            "Directions by several routes",
            "Directions of all poles and their derivatives from the great circles of the "
            "plan: the largest differences from the velocity equations over the rows at "
            "which all is well conditioned, derivatives relative to the largest, and the "
            "time in that of `conditioned`, the two with the smallest error bounds. "
            "`least_squares` takes all great circles, each weighted by the reciprocal of "
            "its bound, and is not a route of the package: it is not a sharper.",
            (
                "mechanism",
                "route",
                "direction, rad",
                "derivative",
                "median, ms",
                "in conditioned",
            ),
            rows,
            ratios=("in conditioned",),
            keys=2,
        )
    ]


def routes(
    name: str, samples: int
) -> tuple[dict[str, Callable[[], Found]], tuple[Motion, Request]]:
    """Return each route as a job, and the motion and request that it is for."""
    tracer = Tracer(load(name), samples=samples)
    motion = tracer.motion()
    poles = all_poles(len(tracer.mechanism.links))
    wanted = request(tracer.mechanism, tracer.inputs[0], poles, by_rank=tracer.by_rank)
    field = evaluate(motion, wanted, route="equations")
    unknown = np.full((len(motion), 3), np.nan)

    def of_ends(rates: Mapping[int, Floats], which: int) -> Floats:
        ends = (pair[which] for pair in tracer.mechanism.ends)
        return np.stack([rates.get(k, unknown) for k in ends], axis=1)

    turned = motion.linearisation.pair_rates(of_ends(field.w, 0), of_ends(field.w, 1))

    def along(route: Route) -> Found:
        lines = evaluate_lines(wanted.plan, motion, route=route)
        evaluate_line_rates(wanted.plan, lines, motion, turned)
        return lines.unit, lines.rate

    jobs: dict[str, Callable[[], Found]] = {
        "conditioned": partial(along, "conditioned"),
        "first": partial(along, "first"),
        "least_squares": partial(directions_and_rates, wanted.plan, motion, turned),
    }
    return {key: _quiet(job) for key, job in jobs.items()}, (motion, wanted)


def _quiet(job: Callable[[], Found]) -> Callable[[], Found]:
    def silent() -> Found:
        with np.errstate(all="ignore"):
            return job()

    return silent


def apart(found: Found, motion: Motion, wanted: Request) -> tuple[float, float]:
    """Return how far directions and derivatives are from those of the equations."""
    right = evaluate(motion, wanted, route="equations")
    directions, rates = found
    gap, change = 0.0, 0.0
    for pole in wanted.poles:
        own = wanted.plan.pole(*pole)
        if own is None:
            continue
        i, j = pole
        w, dw = right.w[j] - right.w[i], right.dw[j] - right.dw[i]
        size = np.linalg.norm(w, axis=1)[:, None]
        good = (right.status == Status.OK) & (right.error[pole] < 1e-13)
        good &= size[:, 0] > 1e-2
        unit, turned = w[good] / size[good], dw[good] / size[good]
        turned -= unit * np.sum(unit * turned, axis=1)[:, None]
        u, du = directions[own].T[good], rates[own].T[good]
        side = np.sign(np.sum(u * unit, axis=1))[:, None]
        scale = np.maximum(1.0, np.linalg.norm(turned, axis=1, keepdims=True))
        gap = max(gap, float(np.max(np.abs(u - side * unit), initial=0.0)))
        miss = np.abs(du - side * turned) / scale
        change = max(change, float(np.max(miss, initial=0.0)))
    return gap, change
