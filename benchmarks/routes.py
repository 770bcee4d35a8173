"""Routes to poles and coefficients against each other."""

import time
from collections.abc import Callable
from functools import partial

import numpy as np

from benchmarks.report import Cell, Section
from benchmarks.timing import median, ratio, rounds
from spherekit.conventions import Status
from spherekit.files.read import load
from spherekit.motion.motion import Motion, Tracer
from spherekit.planning.poles import all_poles
from spherekit.rates.field import evaluate
from spherekit.rates.pole_field import PoleField
from spherekit.rates.request import Request, request
from spherekit.rates.routes import ROUTES

MECHANISMS = ("four_bar", "stephenson", "eight_bar_01", "double_butterfly", "shaped_cam")


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
            "Coefficients by several routes",
            "Coefficients of all poles and their derivatives: the largest differences from "
            "the velocity equations, relative where above 1, over the rows at which all is "
            "well conditioned, and the time in that of `conditioned`, the two great "
            "circles with the smallest error bounds.",
            (
                "mechanism",
                "route",
                "coefficient",
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
) -> tuple[dict[str, Callable[[], PoleField]], tuple[Motion, Request]]:
    """Return each route as a job, and the motion and request that it is for."""
    tracer = Tracer(load(name), samples=samples)
    motion = tracer.motion()
    poles = all_poles(len(tracer.mechanism.links))
    wanted = request(
        tracer.mechanism, tracer.inputs[0], poles, poles, by_rank=tracer.by_rank
    )
    return {route: partial(evaluate, motion, wanted, route=route) for route in ROUTES}, (
        motion,
        wanted,
    )


def apart(found: PoleField, motion: Motion, wanted: Request) -> tuple[float, float]:
    """Return how far coefficients and their derivatives are from those of the equations."""
    right = evaluate(motion, wanted, route="equations")
    gaps = []
    for name in ("velocity_coefficient", "acceleration_coefficient"):
        gap = 0.0
        for pole, values in getattr(right, name).items():
            good = (right.status == Status.OK) & (right.error[pole] < 1e-13)
            theirs, ours = values[good], getattr(found, name)[pole][good]
            miss = np.abs(np.abs(theirs) - np.abs(ours)) / np.maximum(1.0, np.abs(theirs))
            gap = max(gap, float(np.max(miss, initial=0.0)))
        gaps.append(gap)
    return gaps[0], gaps[1]
