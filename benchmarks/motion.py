"""Motion, poles and coefficients with derivatives: time per configuration."""

from collections.abc import Callable
from functools import partial

from benchmarks.report import Cell, Section
from benchmarks.timing import Times, median, ratio, rounds
from spherekit.files.read import load
from spherekit.motion.motion import BLOCK, Motion, Tracer
from spherekit.planning.poles import all_poles
from spherekit.rates.field import evaluate
from spherekit.rates.request import Request, SignMemory, request

NAMES = (
    "four_bar",
    "stephenson",
    "double_butterfly",
    "bevel_pair",
    "roller_cam",
    "shaped_cam",
)


def run(quick: bool) -> list[Section]:
    """Return the times of the evaluation and of the search before it."""
    motion: list[tuple[Cell, ...]] = []
    poles: list[tuple[Cell, ...]] = []
    for samples in (1, 361) if quick else (1, 361, 100_000):
        tracers = {name: Tracer(load(name), samples=samples) for name in NAMES}
        times = times_of(tracers, 3 if samples > 1000 or quick else 7)
        for name in NAMES:
            motion.append(row_of(tracers, name, samples, times, "motion"))
            row = row_of(tracers, name, samples, times, "poles")
            count = len(all_poles(len(tracers[name].mechanism.links)))
            poles.append((*row, count, float(row[4] or 0) / count))
    columns = (
        "mechanism",
        "assembly_modes",
        "samples",
        "ms",
        "ns per configuration",
        "over four_bar, per configuration",
    )
    return [
        Section(
            "Motion",
            f"All assembly modes over the input's range, in blocks of about {BLOCK} "
            f"rows as "
            "a run has them; a configuration is one sample of one assembly mode. "
            "Variables, "
            "orientations, status and residual; the search for assembly modes is not "
            "included.",
            columns,
            motion,
            ratios=columns[5:],
            keys=3,
        ),
        Section(
            "Poles, coefficients and their derivatives",
            "From that motion: every pole axis with its velocity coefficient, the "
            "derivative of that by the input, and error bounds.",
            (*columns, "poles", "ns per pole"),
            poles,
            ratios=columns[5:],
            keys=3,
        ),
        _search(3 if quick else 5),
    ]


def times_of(tracers: dict[str, Tracer], repeats: int) -> Times:
    """Return the times of the motion of tracers, and of all poles for each input."""
    jobs: dict[str, Callable[[], object]] = {}
    for name, tracer in tracers.items():
        made = tracer.mechanism
        every = all_poles(len(made.links))
        wanted = [request(made, item.pair, every, every) for item in made.inputs]
        blocks = list(tracer.blocks())
        jobs[f"{name} motion"] = partial(_consume, tracer)
        jobs[f"{name} poles"] = partial(_poles, blocks, wanted)
    return rounds(jobs, repeats)


def _consume(tracer: Tracer) -> None:
    for _ in tracer.blocks():
        pass


def _poles(blocks: list[Motion], wanted: list[Request]) -> None:
    for each in wanted:
        memory = SignMemory()
        for block in blocks:
            evaluate(block, each, memory)


def row_of(
    tracers: dict[str, Tracer], name: str, samples: int, times: Times, what: str
) -> tuple[Cell, ...]:
    """Return names, counts, times and the ratio of one mechanism."""
    assembly_modes = len(tracers[name].assembly_modes)
    share = len(tracers["four_bar"].assembly_modes) / assembly_modes
    seconds = median(times, f"{name} {what}")
    return (
        name,
        assembly_modes,
        samples,
        1e3 * seconds,
        1e9 * seconds / (samples * assembly_modes),
        share * ratio(times, f"{name} {what}", f"four_bar {what}"),
    )


def _search(repeats: int) -> Section:
    made = {name: load(name) for name in NAMES}
    jobs = {name: lambda each=each: Tracer(each) for name, each in made.items()}
    times = rounds(jobs, repeats)
    rows: list[tuple[Cell, ...]] = []
    for name in NAMES:
        tracer = Tracer(made[name])
        kinds = ", ".join(group.kind for group in tracer.assembly.groups)
        seconds, relation = median(times, name), ratio(times, name, "four_bar")
        rows.append((name, kinds, len(tracer.assembly_modes), 1e3 * seconds, relation))
    return Section(
        "Search for assembly modes",
        "Done once before any sample: dyads in closed form over the range; irreducible "
        "groups at several inputs, by elimination or from random starts, and by following "
        "each mode found.",
        ("mechanism", "groups", "assembly_modes", "search, ms", "over four_bar"),
        rows,
        ratios=("over four_bar",),
    )
