"""Following irreducible groups: nodes and Newton steps for a turn of the input."""

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from functools import wraps
from typing import Any

import numpy as np

from benchmarks.report import Cell, Section
from benchmarks.timing import median, rounds
from spherekit.files.read import load
from spherekit.motion import closure as closures
from spherekit.motion.closure import Closure
from spherekit.motion.guides import ModeCurve, follow
from spherekit.motion.motion import Tracer
from spherekit.motion.steps import LARGEST_STEP

NAMES = ("double_butterfly", "single_flier")


def run(quick: bool) -> list[Section]:
    """Return the cost of every assembly mode of the shipped mechanisms that need it."""
    rows: list[tuple[Cell, ...]] = []
    for name in NAMES:
        tracer = Tracer(load(name))
        for assembly_mode in tracer.assembly_modes:
            rows.append(_assembly_mode(tracer, assembly_mode, 3 if quick else 7, name))
    return [
        Section(
            "Tracking of irreducible groups",
            "One assembly mode followed from a node in its middle to both ends of its "
            "range, "
            "then evaluated at 361 samples. A trial is one predicted step with its "
            "Newton iteration; it is accepted as a node, or the step is halved.",
            (
                "mechanism",
                "assembly_mode",
                "range, turns",
                "nodes",
                "trials",
                "Newton steps of the trials",
                "Newton steps per node",
                "nodes per turn",
                "ms per turn",
                "us per node",
                "Newton steps of 361 samples, per sample",
            ),
            rows,
            f"Steps are at most {LARGEST_STEP} rad, which makes at least "
            f"{2 * np.pi / LARGEST_STEP:.0f} nodes a turn. An assembly mode of less than "
            "a turn ends at dead centres of the input, where the steps shrink.",
            ratios=("Newton steps per node", "Newton steps of 361 samples, per sample"),
            keys=2,
        )
    ]


def _assembly_mode(
    tracer: Tracer, assembly_mode: Any, repeats: int, name: str
) -> tuple[Cell, ...]:
    curve = assembly_mode.guide
    middle = curve.values[len(curve.inputs) // 2]
    closure, driven = tracer.solver.closure, tracer.solver.driven[0]

    def job() -> ModeCurve:
        return follow(closure, driven, middle, *tracer.range)

    with counted() as cost:
        found = job()
    nodes = len(found.inputs)
    turns = float(found.inputs[-1] - found.inputs[0]) / (2 * np.pi)
    steps = cost["steps"]
    seconds = median(rounds({"follow": job}, repeats), "follow")
    q = np.linspace(found.inputs[0], found.inputs[-1], 361)
    with counted() as later:
        tracer.solver.evaluate(assembly_mode, q)
    return (
        name,
        assembly_mode.number,
        turns,
        nodes,
        cost["solved"],
        steps,
        steps / nodes,
        nodes / turns,
        1e3 * seconds / turns,
        1e6 * seconds / nodes,
        later["steps"] / len(q),
    )


@contextmanager
def counted() -> Iterator[Counter[str]]:
    """Count the samples given to `Closure.solve`, and the steps of Newton's method."""
    count: Counter[str] = Counter()
    solve, least_change = Closure.solve, closures.least_change

    @wraps(solve)
    def counting_solve(self: Closure, values: Any, *args: Any, **named: Any) -> Any:
        count["solved"] += len(values)
        return solve(self, values, *args, **named)

    @wraps(least_change)
    def counting_change(matrices: Any, right: Any) -> Any:
        count["steps"] += len(matrices)
        return least_change(matrices, right)

    Closure.solve = counting_solve  # type: ignore[method-assign]
    closures.least_change = counting_change
    try:
        yield count
    finally:
        Closure.solve = solve  # type: ignore[method-assign]
        closures.least_change = least_change
