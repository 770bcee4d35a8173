"""Time of a run of many samples, compared with its kernel alone and with careful rows.

A run evaluates most rows by a compiled or interpreted kernel at once. Rows that the kernel
cannot certify, and single samples, are evaluated *with care*, one by one.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Literal
from unittest.mock import patch

import numpy as np

import spherekit as sk
from benchmarks.harness import (
    Cell,
    Job,
    Section,
    measure_rounds,
    median_ratio,
    median_time,
)
from spherekit.arrays import Floats
from spherekit.planning.pole_plan import all_poles
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.runs import batch_runner, prefetch
from spherekit.runs.batch_runner import REFERENCE_SAMPLES
from spherekit.runs.kernel_columns import SLICE_ROWS
from spherekit.symbolic.compiler import available, heyoka
from spherekit.velocities.pole_request import request
from spherekit.velocities.row_kernel import row_kernel

ROAD_MECHANISMS = ("four_bar", "stephenson", "double_butterfly", "shaped_cam", "five_bar")

UNREACHABLE_ROWS = 1 << 60
"""A number of rows that no run has. As the least number of rows for which a kernel is used,
it switches the kernel off."""

CAREFUL_PART = 20
"""The run that evaluates rows one by one has the number of samples divided by this, because
it is slower."""

MIN_CAREFUL_SAMPLES = 100

KernelEngine = Literal["numpy", "compiled"]
"""How the kernel is evaluated: on NumPy arrays, or compiled by heyoka."""


def run(quick: bool) -> list[Section]:
    """Return the section; compiled code runs on one thread."""
    engines: tuple[KernelEngine, ...] = ("numpy",)
    module = None
    if available():
        engines = ("compiled", "numpy")
        module = heyoka()
    with ExitStack() as cleanup:
        if module:
            cleanup.callback(module.set_nthreads, module.get_nthreads())
            module.set_nthreads(1)
        rows = [
            _measure_mechanism(name, engine, quick)
            for name in ROAD_MECHANISMS
            for engine in engines
        ]
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


@contextmanager
def _kernel_engine(engine: KernelEngine | None) -> Iterator[None]:
    """Force runs to use one kind of kernel in a ``with`` block, or none at all."""
    min_kernel_rows = UNREACHABLE_ROWS if engine is None else 0
    min_compiled_rows = 0 if engine == "compiled" else UNREACHABLE_ROWS
    with patch.multiple(
        batch_runner, MIN_KERNEL_ROWS=min_kernel_rows, MIN_COMPILED_ROWS=min_compiled_rows
    ):
        yield


def _measure_mechanism(name: str, engine: KernelEngine, quick: bool) -> tuple[Cell, ...]:
    """Return the table row of a mechanism, for one kind of kernel.

    The search for assembly modes is measured alone. All other times leave it out.
    """
    mechanism = sk.load(name)
    position_analysis = PositionAnalysis(mechanism)
    mode_count = len(position_analysis.assembly_modes)
    kernel_rows = 200_000 if quick else 1_000_000
    samples = kernel_rows // mode_count
    careful_samples = max(MIN_CAREFUL_SAMPLES, samples // CAREFUL_PART)
    kernel_fractions: list[float] = []
    # Two inputs that are neither at an end nor where modes meet.
    two_inputs = position_analysis.input_grid.q[[5, 6]].squeeze()

    def run_by_kernel(cores: int = 1) -> None:
        with _kernel_engine(engine), patch.object(prefetch, "usable_cores", lambda: cores):
            result = sk.run(mechanism, "poles", samples=samples)
        errors = result.summary["errors_reached"]
        kernel_fractions.append(errors["fraction_by_kernel"])

    def run_with_care() -> None:
        with _kernel_engine(None):
            sk.run(mechanism, "poles", samples=careful_samples)

    kernel = _make_kernel(position_analysis, engine)
    repetitions = -(-kernel_rows // kernel.variables.shape[1])  # rounded up
    variables = np.repeat(kernel.variables, repetitions, axis=1)[:, :kernel_rows].copy()
    columns = np.empty((kernel.column_count, kernel_rows))
    jobs: dict[str, Job] = {
        "run": run_by_kernel,
        "careful": run_with_care,
        "search": lambda: PositionAnalysis(mechanism, samples=samples),
        "one input": lambda: sk.evaluate(mechanism, two_inputs[:1], assembly_mode=0),
        "two inputs": lambda: sk.evaluate(mechanism, two_inputs, assembly_mode=0),
        "kernel": lambda: kernel.evaluate(variables, columns),
    }
    times = measure_rounds(jobs, 3 if quick else 5, clock=time.process_time)
    wall_times = measure_rounds(
        {"one core": run_by_kernel, "two cores": lambda: run_by_kernel(2)},
        3 if quick else 5,
    )
    run_rows = samples * mode_count
    careful_rows = careful_samples * mode_count
    search_seconds = median_time(times, "search")
    run_row_seconds = (median_time(times, "run") - search_seconds) / run_rows
    careful_row_seconds = (median_time(times, "careful") - search_seconds) / careful_rows
    kernel_row_seconds = median_time(times, "kernel") / kernel_rows
    run_over_kernel = median_ratio(times, "run", "kernel") * kernel_rows / run_rows
    search_over_kernel = search_seconds / run_rows / kernel_row_seconds
    return (
        name,
        engine,
        run_rows,
        run_over_kernel - search_over_kernel,
        careful_row_seconds / run_row_seconds,
        kernel_fractions[-1],
        median_ratio(wall_times, "one core", "two cores"),
        1e9 * run_row_seconds,
        1e9 * kernel_row_seconds,
        1e9 * careful_row_seconds,
        1e6 * median_time(times, "one input"),
        median_ratio(times, "two inputs", "one input"),
    )


@dataclass(frozen=True)
class BareKernel:
    """The function (kernel) that computes the rows of a run, to be called without the run.

    Attributes
    ----------
    evaluate
        Function of variables (variables, n) and of an array for the results (columns, n).
    column_count
        Number of columns, bounds of errors included.
    variables
        (variables, rows) closed configurations (rad) with which it can be called.
    """

    evaluate: Callable[[Floats, Floats], object]
    column_count: int
    variables: Floats


def _make_kernel(position_analysis: PositionAnalysis, engine: KernelEngine) -> BareKernel:
    """Return the kernel that computes all poles of a mechanism, with error bounds."""
    mechanism = position_analysis.mechanism
    motion = position_analysis.motion()
    poles = all_poles(len(mechanism.links))
    requests = [
        request(mechanism, pair, poles, poles, by_rank=position_analysis.by_rank)
        for pair in position_analysis.inputs
    ]
    sparse_motion = position_analysis.sparse(REFERENCE_SAMPLES)
    kernel = row_kernel(sparse_motion, requests, engine)
    assert kernel is not None
    all_columns = kernel.all_columns

    def evaluate(variables: Floats, columns: Floats) -> None:
        """Evaluate the kernel in slices, as a run does."""
        for start in range(0, variables.shape[1], SLICE_ROWS):
            rows = slice(start, start + SLICE_ROWS)
            columns[:, rows] = all_columns(variables[:, rows])

    return BareKernel(evaluate, all_columns.width, motion.values[~motion.failed].T)
