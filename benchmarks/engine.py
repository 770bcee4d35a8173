"""The compiled engine: kernels per configuration, forward dynamics, long runs."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from benchmarks.report import Cell, Section
from benchmarks.timing import median, rounds
from spherekit.engine import cache
from spherekit.engine.compiler import available, heyoka
from spherekit.engine.kernels import Source, kernel
from spherekit.engine.loads import AppliedLoad, declared_loads, pair_torque
from spherekit.engine.simulation import Simulation, simulate
from spherekit.files.read import load
from spherekit.model.mechanism import Mechanism, SizeGeometry
from spherekit.motion.motion import BLOCK, Tracer
from spherekit.planning.poles import all_poles
from spherekit.rates.field import evaluate
from spherekit.rates.request import request

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

NAMES = ("four_bar", "stephenson", "double_butterfly", "roller_cam", "planetary_bevel")


def run(quick: bool) -> list[Section]:
    """Return the sections, or one that says why there are none."""
    if not available():
        text = "heyoka is not installed; nothing was measured."
        return [Section("Compiled engine", text, (), ())]
    module = heyoka()
    threads = module.get_nthreads()
    module.set_nthreads(1)
    try:
        return [_batch(quick), _dynamics(quick), _long_runs(quick)]
    finally:
        module.set_nthreads(threads)


def _batch(quick: bool) -> Section:
    count = 100_000 if quick else 1_000_000
    rows: list[tuple[Cell, ...]] = []
    for name in NAMES:
        tracer = Tracer(load(name), search=False)
        sources: tuple[Source, ...] = ("variables",)
        if tracer.assembly.has_closed_form:
            sources = ("variables", "input")
        for source in sources:
            for derivatives in (False, True):
                rows.append(_kernel_row(tracer, source, derivatives, count))
    return Section(
        "Compiled batch kernels",
        f"Every pole axis and coefficient, with B where the mechanism has masses, at "
        f"{count} configurations on one thread. From all pair variables, or from the input "
        "and the signs of the dyads, positions included. NumPy: the same without B, in "
        f"blocks of {BLOCK}, derivatives always included.",
        (
            "mechanism",
            "from",
            "derivatives",
            "values",
            "ns per configuration",
            "NumPy, ns",
            "compiled in, s",
        ),
        rows,
    )


def _kernel_row(
    tracer: Tracer, source: Source, derivatives: bool, count: int
) -> tuple[Cell, ...]:
    made = tracer.mechanism
    pair = made.inputs[0].pair
    found = kernel(
        made,
        pair,
        source=source,
        derivatives=derivatives,
        with_inertia=bool(made.masses),
    )
    q = np.linspace(*tracer.range, BLOCK)
    motion = tracer.at(q)
    branch = motion.branches[0]
    rows = motion.values[:BLOCK].T
    if source == "input":
        rows = np.vstack([q, *(np.full(BLOCK, float(sign)) for sign in branch.signs)])
    inputs = np.ascontiguousarray(np.tile(rows, (1, -(-count // BLOCK)))[:, :count])
    out = np.empty((len(found.columns), count))
    every = all_poles(len(made.links))
    wanted = request(made, pair, every, every)
    configurations = BLOCK * len(motion.branches)

    def plain() -> object:
        return evaluate(tracer.at(q) if source == "input" else motion, wanted)

    times = rounds({"compiled": lambda: found(inputs, out), "numpy": plain}, 5)
    return (
        made.name,
        source,
        "yes" if derivatives else "no",
        len(found.columns),
        1e9 * median(times, "compiled") / count,
        1e9 * median(times, "numpy") / configurations,
        found.compiled.seconds,
    )


def _paper(tolerance: float, compact: bool, number: type[object] = float) -> Simulation:
    made = load("four_bar")
    drive = pair_torque(made, "drive", "21", "10*sin(2*t)")
    return simulate(
        made,
        "21",
        _start(made, 0.3),
        np.linspace(0.0, 10.0, 101),
        rate=1.0,
        loads=[*declared_loads(made), drive],
        tolerance=tolerance,
        compact=compact,
        number=number,
    )


def _start(made: Mechanism, q: float) -> Floats:
    return np.asarray(Tracer(made).at(np.array([q])).values[0])


def _dynamics(quick: bool) -> Section:
    module = heyoka()
    if hasattr(module, "real128"):
        exact, what = _paper(1e-25, True, module.real128), "in quadruple precision"
    else:
        exact, what = _paper(1e-17, True), "at the tightest tolerance"
    tolerances = (1e-9, 1e-13) if quick else (1e-7, 1e-8, 1e-9, 1e-11, 1e-13, 1e-15)
    rows: list[tuple[Cell, ...]] = []
    for compact in (True, False):
        for tolerance in tolerances:
            cache.clear()
            first = _paper(tolerance, compact)
            seconds = [_paper(tolerance, compact).seconds for _ in range(9)]
            rows.append(
                (
                    "compact" if compact else "full",
                    tolerance,
                    float(np.max(np.abs(first.q - exact.q))),
                    1e3 * float(np.median(seconds)),
                    1e3 * min(seconds),
                    first.compile_seconds,
                    first.steps,
                    float(np.max(np.abs(first.imbalance))),
                    float(np.max(first.closure)),
                )
            )
    return Section(
        "Compiled forward dynamics",
        "The paper's four-bar, q(0) = 0.3, q'(0) = 1, loads of its Table 2 and a torque "
        f"10 sin 2t on link 2, 10 s. The error is the largest of q at 101 times against "
        f"the same equations {what}; that these are right is tested against a Runge-Kutta "
        "code and the paper's formulas. heyoka keeps compiled code on disk, so a second "
        "process compiles in less.",
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


def _long_runs(quick: bool) -> Section:
    crank = replace(load("four_bar"), loads=())
    share = 0.1 if quick else 1.0
    weight = pair_torque(crank, "weight", "41", "-5*sin(theta_41)")
    jobs: list[tuple[str, Callable[[], Simulation], Sequence[AppliedLoad]]] = [
        ("crank, free", lambda: _free(crank, 0.3, 5050.0 * share, (), rate=1.0), ()),
        (
            "crank, weight",
            lambda: _free(crank, 0.3, 1400.0 * share, [weight], rate=4.0),
            [weight],
        ),
        (
            "rocker, weight",
            lambda: _free(_rocker(), 2.0, 1000.0 * share, [weight], arc_rate=6.0),
            [weight],
        ),
    ]
    rows: list[tuple[Cell, ...]] = []
    for label, job, loads in jobs:
        found = job()
        angle = found.reduced[:, crank.variable_names.index("theta_41")]
        energy = found.kinetic - (5.0 * np.cos(angle) if loads else 0.0)
        drift = np.max(np.abs(energy - energy[0])) / np.max(found.kinetic)
        rows.append(
            (
                label,
                float((found.q[-1] - found.q[0]) / (2.0 * np.pi)),
                len(found.events),
                float(drift),
                float(np.max(found.closure)),
                found.steps,
                found.seconds,
            )
        )
    return Section(
        "Long runs without loss",
        "Energy of conservative systems: kinetic, and potential where a torque "
        "-5 sin(theta_41) stands for a weight. The rocker (arcs 60, 55, 70, 40 deg) swings "
        "over the dead centres of its input. Tolerance 1e-15.",
        (
            "motion",
            "turns of the input",
            "dead centres",
            "drift of energy, relative",
            "closure, rad",
            "steps",
            "solved in, s",
        ),
        rows,
    )


def _free(
    made: Mechanism,
    q: float,
    last: float,
    loads: Sequence[AppliedLoad],
    rate: float | None = None,
    arc_rate: float | None = None,
) -> Simulation:
    return simulate(
        made,
        "21",
        _start(made, q),
        np.linspace(0.0, last, 101),
        rate=rate,
        arc_rate=arc_rate,
        loads=loads,
        dead_centres=["theta_21"],
        tolerance=1e-15,
    )


def _rocker() -> Mechanism:
    made = load("four_bar")
    assert isinstance(made.geometry, SizeGeometry)
    arcs = {"1": 60.0, "2": 55.0, "3": 70.0, "4": 40.0}
    sizes = {
        link: replace(given, arcs=(float(np.deg2rad(arcs[link])),))
        for link, given in made.geometry.links.items()
    }
    return replace(made, geometry=replace(made.geometry, links=sizes), loads=())
