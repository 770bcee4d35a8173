"""A run of many samples against the kernel alone, and against every row with care."""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Literal
from unittest.mock import patch

import numpy as np

import spherekit as sk
from benchmarks.harness import Cell, Section, median, ratio, rounds
from spherekit.arrays import Floats
from spherekit.planning.pole_plan import all_poles
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.runs import batch_runner, prefetch
from spherekit.runs.batch_runner import REFERENCE_SAMPLES
from spherekit.runs.kernel_columns import SLICE_ROWS
from spherekit.symbolic.compiler import available, heyoka
from spherekit.velocities.pole_request import request
from spherekit.velocities.row_kernel import row_kernel

MECHANISMS = ("four_bar", "stephenson", "double_butterfly", "shaped_cam", "five_bar")

NEVER = 1 << 60


def run(quick: bool) -> list[Section]:
    """Return the sections; compiled code runs on one thread."""
    module = heyoka() if available() else None
    threads = module.get_nthreads() if module else 0
    with ExitStack() as after:
        if module:
            after.callback(module.set_nthreads, threads)
            module.set_nthreads(1)
        rows = [_row(name, engine, quick) for name in MECHANISMS for engine in _engines()]
    return [
        Section(
            "Runs of many samples",
            "`sk.run(mechanism, 'poles')` in memory, all assembly modes, by the kernel of "
            "rows (so many of them) and with care throughout, and this kernel alone, from "
            "pair variables to an array that is there already. The time of the search for "
            "assembly modes is left out.",
            (
                "mechanism",
                "engine",
                "rows",
                "run / kernel",
                "careful / run",
                "by kernel",
                "two cores",
                "run, ns a row",
                "kernel, ns a row",
                "of which careful, ns",
                "evaluate, us",
                "two inputs / one",
            ),
            rows,
            "All of it is processor time of one thread. What two cores gain is wall time, "
            "of other programs as well. One mode at one input is evaluated by terms of "
            "floats, at two inputs with care.",
        )
    ]


Engine = Literal["numpy", "compiled"]


def _engines() -> tuple[Engine, ...]:
    return ("compiled", "numpy") if available() else ("numpy",)


@contextmanager
def _by(engine: Engine | None) -> Iterator[None]:
    """Have rows given by a kernel on this engine, or by none."""
    fewest = NEVER if engine is None else 0
    many = 0 if engine == "compiled" else NEVER
    with patch.multiple(batch_runner, MIN_KERNEL_ROWS=fewest, MIN_COMPILED_ROWS=many):
        yield


def _row(name: str, engine: Engine, quick: bool) -> tuple[Cell, ...]:
    made = sk.load(name)
    tracer = PositionAnalysis(made)
    modes = len(tracer.assembly_modes)
    wanted = 200_000 if quick else 1_000_000
    samples = wanted // modes
    few = max(100, samples // 20)
    shares: list[float] = []
    q = tracer.input_grid.q[[5, 6]].squeeze()  # neither at an end nor where modes meet

    def quickly(cores: int = 1) -> None:
        with _by(engine), patch.object(prefetch, "usable_cores", lambda: cores):
            found = sk.run(made, "poles", samples=samples)
        shares.append(found.summary["errors_reached"]["fraction_by_kernel"])

    def carefully() -> None:
        with _by(None):
            sk.run(made, "poles", samples=few)

    jobs: dict[str, Callable[[], object]] = {
        "run": quickly,
        "careful": carefully,
        "search": lambda: PositionAnalysis(made, samples=samples),
        "one": lambda: sk.evaluate(made, q[:1], assembly_mode=0),
        "two": lambda: sk.evaluate(made, q, assembly_mode=0),
    }
    alone, width, inputs = _alone(tracer, engine)
    inputs = np.repeat(inputs, -(-wanted // inputs.shape[1]), axis=1)[:, :wanted].copy()
    out = np.empty((width, wanted))
    jobs["kernel"] = lambda: alone(inputs, out)
    times = rounds(jobs, 3 if quick else 5, now=time.process_time)
    rows, some = samples * modes, few * modes
    walls = rounds({"one": quickly, "two": lambda: quickly(2)}, 3 if quick else 5)
    each = (median(times, "run") - median(times, "search")) / rows
    careful = (median(times, "careful") - median(times, "search")) / some
    unit = median(times, "kernel") / wanted
    return (
        name,
        engine,
        rows,
        ratio(times, "run", "kernel") * wanted / rows
        - median(times, "search") / rows / unit,
        careful / each,
        shares[-1],
        ratio(walls, "one", "two"),
        1e9 * each,
        1e9 * unit,
        1e9 * careful,
        1e6 * median(times, "one"),
        ratio(times, "two", "one"),
    )


def _alone(
    tracer: PositionAnalysis, engine: Engine
) -> tuple[Callable[[Floats, Floats], object], int, Floats]:
    """Return the kernel of rows with bounds, its columns, and variables to call it with."""
    made, motion = tracer.mechanism, tracer.motion()
    values = motion.values[~motion.failed].T
    every = all_poles(len(made.links))
    by = tracer.by_rank
    requests = [request(made, x, every, every, by_rank=by) for x in tracer.inputs]
    rows = row_kernel(tracer.sparse(REFERENCE_SAMPLES), requests, engine)
    assert rows is not None
    terms = rows.all_columns

    def sliced(inputs: Floats, out: Floats) -> None:
        for start in range(0, inputs.shape[1], SLICE_ROWS):
            rows = slice(start, start + SLICE_ROWS)
            out[:, rows] = terms(inputs[:, rows])

    return sliced, terms.width, values
