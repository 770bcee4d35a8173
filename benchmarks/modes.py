"""Assembly modes that exist, counted by an independent search, and those a run has."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import final

import numpy as np

from benchmarks.report import Section
from benchmarks.samples import (
    Structure,
    mechanism,
    random_axes,
    random_chain,
    with_contacts,
)
from spherekit.errors import PlanError
from spherekit.guarantee import Guarantee
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import Input
from spherekit.motion.assembly_modes import Solver
from spherekit.motion.motion import Tracer
from spherekit.motion.search import CLOSE, SEED, damped, starting_range
from spherekit.planning.assembly import plan_assembly
from spherekit.sphere.rotation import Floats

HALF = np.radians(30.0)
"""Half of the range of the input (rad), its middle the reference pose."""
INPUTS = 5
"""Inputs over the range, at random, at which modes are counted."""
STARTS = 600
"""Starts of the judge at each."""
SAME = 1e-4
"""Rotation matrices of a mode of the judge and of the same one elsewhere differ by less."""
NEWTON_STEPS = 40
"""Steps of the undamped method that is timed beside the damped one."""


def run(quick: bool, count: int | None = None) -> list[Section]:
    """Return what runs and searches for all curves miss of the modes that exist."""
    wanted = count or (2 if quick else 200)
    kinds: dict[str, Callable[[int], Mechanism]] = {
        "ten-bar, one group of nine bodies": ten_bar,
        "circular cams among R pairs": cams,
    }
    rows = []
    for name, made in kinds.items():
        tally = Tally()
        for seed in range(wanted):
            judge(tally, made(seed), seed)
        rows.append(
            (
                name,
                wanted,
                tally.modes,
                tally.missed_by_run,
                tally.missed_by_curves,
                tally.complete,
                f"{tally.least_starts}" if tally.least_starts else "-",
                float(np.median(tally.seconds)),
                tally.damped_closed / max(tally.newton_closed, 1),
                tally.newton_seconds / tally.damped_seconds,
            )
        )
    return [
        Section(
            "Modes that exist",
            f"Random mechanisms over {np.degrees(2 * HALF):.0f} deg of the input about "
            f"their reference pose. The modes at {INPUTS} random inputs are counted by an "
            f"independent search, {STARTS} starts at each, which knows orientations of "
            "bodies and arcs of links and no pair variables. Missed is a mode that no "
            "assembly mode of a run has there, or no curve of the search for all. Where "
            "the claim "
            "is not complete it rests on so many starts. The last columns compare the "
            "damped search with Newton's method from the same starts.",
            (
                "mechanisms",
                "number",
                "modes",
                "missed by the run",
                "missed by all curves",
                "complete curves",
                "starts, least",
                "run, s",
                "starts closed, damped / Newton",
                "time, Newton / damped",
            ),
            rows,
            ratios=("starts closed, damped / Newton", "time, Newton / damped"),
        )
    ]


@final
@dataclass
class Tally:
    """What was counted over the mechanisms judged."""

    modes: int = 0
    missed_by_run: int = 0
    missed_by_curves: int = 0
    complete: int = 0
    least_starts: int = 0
    seconds: list[float] = field(default_factory=list)
    damped_closed: int = 0
    newton_closed: int = 0
    damped_seconds: float = 0.0
    newton_seconds: float = 0.0


def ten_bar(seed: int) -> Mechanism:
    """Return a random ten-bar whose locked structure is one group of nine bodies."""
    random = np.random.default_rng(seed)
    while True:
        edges = random_chain(random, 10)
        made = mechanism(edges, random_axes(random, len(edges)))
        for pair in random.permutation(len(edges)):
            driven = made.with_inputs(made.pairs[pair].name)
            try:
                groups = plan_assembly(driven).groups
            except PlanError:
                continue
            if [len(group.bodies) for group in groups] == [9]:
                return _over_range(driven)


def cams(seed: int) -> Mechanism:
    """Return a chain of up to five links, one to three of its pairs contacts of circles."""
    random = np.random.default_rng(seed)
    links, sliding = int(random.integers(3, 6)), int(random.integers(1, 3))
    if (links + sliding) % 2:  # no chain grows to that; three links have no room for three
        sliding += 1 if links > 3 else -1
    return _over_range(with_contacts(random, links, 0, sliding))


def _over_range(made: Mechanism) -> Mechanism:
    return replace(made, inputs=(Input(made.inputs[0].pair, -HALF, HALF),))


def judge(tally: Tally, made: Mechanism, seed: int) -> None:
    """Add what a run and the search for all curves have of a mechanism's modes."""
    random = np.random.default_rng([seed, 1])
    inputs = random.uniform(-HALF, HALF, INPUTS)
    structure = Structure.of(made)
    started = time.process_time()
    tracer = Tracer(made, samples=91)
    tally.seconds.append(time.process_time() - started)
    solver, found = tracer.solver, tracer.configurations
    if found.claim.guarantee is Guarantee.SAMPLED:
        starts = int(str(found.claim.reason).split()[0])
        tally.least_starts = min(tally.least_starts or starts, starts)
    else:
        tally.complete += 1
    for q, (modes, _) in zip(inputs, structure.modes(inputs, STARTS, random), strict=True):
        on_assembly_modes = [
            solver.evaluate(assembly_mode, np.array([[q]])).rotations
            for assembly_mode in tracer.assembly_modes
        ]
        on_curves = [
            solver.closure.at(
                each.curve.at(each.curve.at_input(solver.single, float(q)).places).values
            ).placed
            for each in found.curves
        ]
        tally.modes += len(modes)
        tally.missed_by_run += _lacking(structure, made, modes, on_assembly_modes)
        tally.missed_by_curves += _lacking(structure, made, modes, on_curves)
    _compare(tally, solver)


def _lacking(
    structure: Structure, made: Mechanism, modes: Floats, placed: list[Floats]
) -> int:
    """Return how many modes are none of the configurations placed."""
    every = np.concatenate([np.zeros((0, len(made.links), 3, 3)), *placed])
    seen = structure.seen(made.links, every[np.all(np.isfinite(every), axis=(1, 2, 3))])
    away = np.max(np.abs(modes[:, None] - seen[None]), axis=(2, 3, 4), initial=0.0)
    return int(np.sum(np.min(away, axis=1, initial=np.inf) > SAME))


def _compare(tally: Tally, solver: Solver) -> None:
    """Add how many starts at the reference input both methods close, and their times."""
    low, high = starting_range(solver.closure)
    starts = np.random.default_rng(SEED).uniform(low, high, (STARTS // 2, len(low)))
    driven = list(solver.driven)
    starts[:, driven] = 0.0
    with np.errstate(all="ignore"):
        started = time.process_time()
        _, near = damped(solver.closure, starts, driven)
        tally.damped_seconds += time.process_time() - started
        tally.damped_closed += int(np.sum(near))
        started = time.process_time()
        result = solver.closure.solve(starts, driven, iterations=NEWTON_STEPS)
        tally.newton_seconds += time.process_time() - started
        tally.newton_closed += int(np.sum(result.residual < CLOSE))
