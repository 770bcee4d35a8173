"""The compiled engine: kernels per configuration, forward dynamics."""

import time
from functools import partial

import numpy as np

from benchmarks.harness import Cell, Section, median, ratio, rounds
from spherekit.dynamics.forward_dynamics import simulate
from spherekit.dynamics.reference_simulation import reference_simulation
from spherekit.dynamics.simulation import Simulation
from spherekit.files.mechanism_reader import load
from spherekit.files.study import Start
from spherekit.planning.pole_plan import all_poles
from spherekit.positions.position_analysis import PositionAnalysis
from spherekit.symbolic.compiler import available, heyoka
from spherekit.velocities.dyad_expressions import COMPILED
from spherekit.velocities.kernels import MOST_DERIVATIVES, Engine, Source, kernel
from spherekit.velocities.pole_evaluation import evaluate
from spherekit.velocities.pole_request import request

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

NAMES = ("four_bar", "stephenson", "double_butterfly", "roller_cam", "planetary_bevel")

BLOCK = 512
"""Configurations evaluated at once."""

KERNEL_ENGINES: tuple[Engine, ...] = ("compiled", "numpy")


def run(quick: bool) -> list[Section]:
    """Return the sections, or one that says why there are none."""
    if not available():
        text = "heyoka is not installed; nothing was measured."
        return [Section("Compiled engine", text, (), ())]
    module = heyoka()
    threads = module.get_nthreads()
    module.set_nthreads(1)
    try:
        return [_batch(quick), _dynamics(quick)]
    finally:
        module.set_nthreads(threads)


def _batch(quick: bool) -> Section:
    count = 100_000 if quick else 1_000_000
    rows: list[tuple[Cell, ...]] = []
    for name in NAMES:
        tracer = PositionAnalysis(load(name), search=False)
        sources: tuple[Source, ...] = ("variables",)
        if tracer.assembly.has_closed_form:
            sources = ("variables", "input")
        for source in sources:
            for derivatives in range(MOST_DERIVATIVES + 1):
                rows.append(_kernel_row(tracer, source, derivatives, count))
    return Section(
        "Batch kernels",
        f"Every pole axis and coefficient, with B where the mechanism has masses, at "
        f"{count} configurations on one thread, the kernel compiled and on NumPy arrays. "
        "From all pair variables, or from the input and the signs of the dyads, positions "
        "included. The plan: `velocities.pole_evaluation.evaluate`, the same without B, "
        f"with one derivative, in blocks of {BLOCK}.",
        (
            "mechanism",
            "from",
            "derivatives",
            "values",
            "compiled, ns",
            "arrays, ns",
            "arrays / compiled",
            "plan, ns",
            "plan / arrays",
            "compiled in, s",
            "arrays made in, s",
        ),
        rows,
        "ns are of processor time, per configuration. heyoka keeps compiled code on disk, "
        "so a second process compiles in less.",
    )


def _kernel_row(
    tracer: PositionAnalysis, source: Source, derivatives: int, count: int
) -> tuple[Cell, ...]:
    made = tracer.mechanism
    pair = made.inputs[0].pair
    kernels, seconds = [], []
    terms = partial(kernel, made, pair, source=source, derivatives=derivatives)
    for engine in KERNEL_ENGINES:
        started = time.perf_counter()
        kernels.append(terms(with_inertia=bool(made.masses), engine=engine))
        seconds.append(time.perf_counter() - started)
    compiled, arrays = kernels
    q = np.linspace(*tracer.range, BLOCK)
    motion = tracer.at(q)
    assembly_mode = motion.assembly_modes[0]
    rows = motion.values[:BLOCK].T
    if source == "input":
        rows = np.vstack(
            [q, *(np.full(BLOCK, float(sign)) for sign in assembly_mode.signs)]
        )
    inputs = np.ascontiguousarray(np.tile(rows, (1, -(-count // BLOCK)))[:, :count])
    out = np.empty((len(compiled.columns), count))
    every = all_poles(len(made.links))
    wanted = request(made, pair, every, every)
    configurations = BLOCK * len(motion.assembly_modes)

    def plan() -> object:
        return evaluate(tracer.at(q) if source == "input" else motion, wanted)

    jobs = {
        "compiled": lambda: compiled(inputs, out),
        "arrays": lambda: arrays(inputs, out),
        "plan": plan,
    }
    times = rounds(jobs, 5, now=time.process_time)
    each = count / configurations
    return (
        made.name,
        source,
        derivatives,
        len(compiled.columns),
        1e9 * median(times, "compiled") / count,
        1e9 * median(times, "arrays") / count,
        ratio(times, "arrays", "compiled"),
        1e9 * median(times, "plan") / configurations,
        each * ratio(times, "plan", "arrays"),
        *seconds,
    )


def _paper(tolerance: float, compact: bool) -> Simulation:
    return simulate(
        load("four_bar"),
        Start(0.3, 1.0),
        10.0,
        torque="10*sin(2*t)",
        tolerance=tolerance,
        engine="compiled",
        compact=compact,
    )


def _exact(times: Floats) -> Floats:
    """Return q in many digits, in balls."""
    start = Start(0.3, 1.0)
    exact = reference_simulation("four_bar", start, 10.0, torque="10*sin(2*t)")
    values, *_ = exact.at(times)
    return np.array(values[:, load("four_bar").angles["21"]], dtype=float)


def _dynamics(quick: bool) -> Section:
    times = np.linspace(0.0, 10.0, 101)
    exact = _exact(times)
    tolerances = (1e-9, 1e-13) if quick else (1e-9, 1e-12, 1e-13, 1e-14, 1e-15)
    rows: list[tuple[Cell, ...]] = []
    for compact in (True, False):
        for tolerance in tolerances:
            COMPILED.clear()
            first = _paper(tolerance, compact)
            seconds = [_paper(tolerance, compact).engine.seconds for _ in range(9)]
            rows.append(
                (
                    "compact" if compact else "full",
                    tolerance,
                    float(np.max(np.abs(first.at(times).q - exact))),
                    1e3 * float(np.median(seconds)),
                    1e3 * min(seconds),
                    first.engine.compile_seconds,
                    first.engine.steps,
                    first.checks.energy,
                    first.checks.closure,
                )
            )
    return Section(
        "Compiled forward dynamics",
        "The paper's four-bar, q(0) = 0.3, q'(0) = 1, loads of its Table 2 and a torque "
        "10 sin 2t on link 2, 10 s. The error is the largest of q at 101 times against a "
        "reference simulation in balls. Tolerances above 1e-12 run as 1e-12. heyoka keeps "
        "compiled code on disk, so a second process compiles in less.",
        (
            "mode",
            "tolerance",
            "error of q, rad",
            "solved in, ms",
            "fastest, ms",
            "compiled in, s",
            "steps",
            "energy less work, J",
            "closure, rad",
        ),
        rows,
    )
