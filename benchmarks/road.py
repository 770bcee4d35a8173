"""A run of many samples against the kernel alone, and against every row with care."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from unittest.mock import patch

import numpy as np

import spherekit as sk
from benchmarks.report import Cell, Section
from benchmarks.timing import median, rounds
from spherekit.analysis.running import rows_at_once
from spherekit.engine.compiler import available, heyoka
from spherekit.engine.kernels import Engine, Kernel, kernel
from spherekit.errors import SpherekitError
from spherekit.model.mechanism import Mechanism
from spherekit.motion.motion import Tracer

MECHANISMS = ("four_bar", "stephenson", "double_butterfly", "shaped_cam", "five_bar")

NEVER = 1 << 60


def run(quick: bool) -> list[Section]:
    """Return the section; compiled code runs on one thread."""
    compiles = available()
    threads = heyoka().get_nthreads() if compiles else 0
    if compiles:
        heyoka().set_nthreads(1)
    try:
        rows = [_row(name, engine, quick) for name in MECHANISMS for engine in _engines()]
    finally:
        if compiles:
            heyoka().set_nthreads(threads)
    return [
        Section(
            "Runs of many samples",
            "`sk.run(mechanism, 'poles')` in memory, all assembly modes, by the kernel of "
            "rows (so many of them) and with care throughout, and the batch kernel of the "
            "same poles and derivatives alone, from pair variables to an array that is "
            "there already. The time of the search for assembly modes is left out.",
            (
                "mechanism",
                "engine",
                "rows",
                "run / kernel",
                "careful / run",
                "by kernel",
                "run, ns a row",
                "kernel, ns a row",
                "of which careful, ns",
            ),
            rows,
            "All of it is processor time of one thread. Of profiles other than circles "
            "there is no kernel, with several inputs none of one of them: no ratio then.",
            ratios=("run / kernel", "careful / run"),
            keys=2,
        )
    ]


def _engines() -> tuple[Engine, ...]:
    return ("compiled", "numpy") if available() else ("numpy",)


@contextmanager
def _by(engine: Engine | None) -> Iterator[None]:
    """Have rows given by a kernel on this engine, or by none."""
    fewest = NEVER if engine is None else 0
    many = 0 if engine == "compiled" else NEVER
    with patch.multiple(rows_at_once, FEWEST=fewest, MANY=many):
        yield


def _row(name: str, engine: Engine, quick: bool) -> tuple[Cell, ...]:
    made = sk.load(name)
    tracer = Tracer(made)
    modes = len(tracer.assembly_modes)
    wanted = 200_000 if quick else 1_000_000
    samples = wanted // modes
    few = max(100, samples // 20)
    shares: list[float] = []

    def quickly() -> None:
        with _by(engine):
            found = sk.run(made, "poles", samples=samples)
        shares.append(found.summary["errors_reached"]["fraction_by_kernel"])

    def carefully() -> None:
        with _by(None):
            sk.run(made, "poles", samples=few)

    jobs: dict[str, Callable[[], object]] = {
        "run": quickly,
        "careful": carefully,
        "search": lambda: Tracer(made, samples=samples),
    }
    alone = _alone(tracer, engine)
    if alone is not None:
        own, inputs = alone
        inputs = np.ascontiguousarray(
            np.tile(inputs, (1, -(-wanted // inputs.shape[1])))[:, :wanted]
        )
        out = np.empty((len(own.columns), wanted))
        jobs["kernel"] = lambda: own(inputs, out)
    times = rounds(jobs, 3 if quick else 5, now=time.process_time)
    rows, some = samples * modes, few * modes
    each = (median(times, "run") - median(times, "search")) / rows
    careful = (median(times, "careful") - median(times, "search")) / some
    unit = median(times, "kernel") / wanted if alone is not None else None
    return (
        name,
        engine,
        rows,
        None if unit is None else each / unit,
        careful / each,
        shares[-1],
        1e9 * each,
        None if unit is None else 1e9 * unit,
        1e9 * careful,
    )


def _alone(
    tracer: Tracer, engine: Engine
) -> tuple[Kernel, np.ndarray[tuple[int, ...], np.dtype[np.float64]]] | None:
    """Return the kernel of all poles, and variables to call it with."""
    made: Mechanism = tracer.mechanism
    if len(made.inputs) > 1:
        return None
    try:
        own = kernel(made, made.inputs[0].pair, engine=engine)
    except SpherekitError:
        return None
    motion = tracer.motion()
    return own, motion.values[~motion.failed].T
