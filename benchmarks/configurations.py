"""Cost per configuration: every shipped mechanism, and growth with links and contacts."""

import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from benchmarks.motion import row_of, times_of
from benchmarks.own import own_mechanisms
from benchmarks.report import Cell, Section
from benchmarks.samples import grown, with_contacts
from benchmarks.timing import median, ratio
from spherekit.conventions import Status
from spherekit.errors import SpherekitError
from spherekit.files.read import load
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import Input
from spherekit.motion.motion import Tracer

UNIT = "four_bar"
QUICK = (UNIT, "stephenson", "five_bar", "roller_cam", "bevel_differential")
SAMPLES = 361
SPAN = 0.01
"""Half of the range (rad) about the reference pose of a random chain."""
LINKS = (4, 8, 12, 16, 20)
FIXED = 8
CONTACTS = ((0, 0), (1, 0), (2, 0), (3, 0), (0, 2), (1, 2), (0, 4))
"""Numbers of rolling and of sliding pairs; with eight links sliding ones are even."""


def run(quick: bool) -> list[Section]:
    """Return the costs of shipped mechanisms, of longer chains, and of more contacts."""
    chains = 1 if quick else 5
    repeats = 3 if quick else 5
    sizes = LINKS[::2][:2] if quick else LINKS
    counts = (CONTACTS[0], CONTACTS[1], CONTACTS[4]) if quick else CONTACTS
    columns = (
        "groups",
        "not dyads",
        "poles",
        "motion, us per configuration",
        "motion, over the first row",
        "poles, us per configuration",
        "poles, over the first row",
    )
    ratios = ("motion, over the first row", "poles, over the first row")
    longer: dict[tuple[int, ...], list[Tracer]] = {
        (links,): [
            _traced(partial(grown, links=links, triads=False), seed)
            for seed in range(chains)
        ]
        for links in sizes
    }
    touching: dict[tuple[int, ...], list[Tracer]] = {
        pairs: [
            _traced(
                partial(with_contacts, links=FIXED, rolling=pairs[0], sliding=pairs[1]),
                seed,
            )
            for seed in range(chains)
        ]
        for pairs in counts
    }
    about = (
        f"{SAMPLES} samples within {SPAN} rad of a random reference pose, one assembly "
        f"mode, all "
        f"poles with derivatives; medians over {chains} seeded chains of each kind."
    )
    return [
        _shipped(quick),
        Section(
            "Cost per configuration: links",
            f"A four-bar grown by dyads added at random links. {about}",
            ("links", *columns),
            _growth(longer, repeats),
            ratios=ratios,
        ),
        Section(
            "Cost per configuration: contact pairs",
            f"Chains of {FIXED} links in which R pairs became rolling pairs, or binary "
            "links with their two R pairs sliding pairs, between circles. Groups with a "
            f"contact are not dyads and closed by Newton's method. {about}",
            ("Cr pairs", "Cs pairs", *columns),
            _growth(touching, repeats),
            ratios=ratios,
            keys=2,
        ),
    ]


def _shipped(quick: bool) -> Section:
    """Return the costs of the shipped mechanisms, as ratios over one of them."""
    every = own_mechanisms()
    names = list(QUICK) if quick else [UNIT, *(name for name in every if name != UNIT)]
    rows: list[tuple[Cell, ...]] = []
    unit = Tracer(load(UNIT), samples=SAMPLES, assembly_mode=0)
    for name in names:
        started = time.perf_counter()
        tracer = Tracer(load(name), samples=SAMPLES, assembly_mode=0)
        before = time.perf_counter() - started
        pair = {UNIT: unit, name: tracer}
        times = times_of(pair, 3 if quick else 5)
        motion, poles = (
            row_of(pair, name, SAMPLES, times, what) for what in ("motion", "poles")
        )
        made = tracer.mechanism
        inputs = len(made.inputs)
        kinds = ", ".join(group.kind for group in tracer.assembly.groups)
        count = inputs * len(made.links) * (len(made.links) - 1) // 2
        rows.append(
            (
                name,
                inputs,
                len(made.links),
                kinds,
                before,
                1e-3 * float(motion[4] or 0),
                float(motion[5] or 0),
                count,
                1e-3 * float(poles[4] or 0),
                float(poles[5] or 0),
            )
        )
    return Section(
        "Cost per configuration: shipped mechanisms",
        f"{SAMPLES} samples over the range of the input, or on the straight path through "
        "the ranges of several, on assembly mode 0; all poles with rates and "
        "derivatives, for "
        f"each input moved alone. Each mechanism alternates with {UNIT}. `modes "
        "before` is the search for all modes, timed once; with several inputs and "
        "irreducible groups it includes following every mode to all samples.",
        (
            "mechanism",
            "inputs",
            "links",
            "groups",
            "modes before, s",
            "motion, us",
            f"motion over {UNIT}",
            "poles",
            "poles, us",
            f"poles over {UNIT}",
        ),
        rows,
        ratios=(f"motion over {UNIT}", f"poles over {UNIT}"),
    )


def _traced(make: Callable[[np.random.Generator], Mechanism], seed: int) -> Tracer:
    """Return the first random chain that moves through its whole small range."""
    for attempt in range(100):
        made = make(np.random.default_rng([seed, attempt]))
        drives = Input(made.inputs[0].pair, -SPAN, SPAN)
        try:
            tracer = Tracer(
                replace(made, inputs=(drives,)),
                samples=SAMPLES,
                assembly_mode=0,
                search=False,
            )
        except SpherekitError:
            continue
        if np.all(tracer.sparse(9).status == Status.OK):
            return tracer
    raise RuntimeError("no random chain moves through the range")


def _growth(
    cases: dict[tuple[int, ...], list[Tracer]], repeats: int
) -> list[tuple[Cell, ...]]:
    """Return a row for each case, with the medians over its chains."""
    named = {
        f"{case} {k}": tracer
        for case, tracers in cases.items()
        for k, tracer in enumerate(tracers)
    }
    times = times_of(named, repeats)
    first = next(iter(cases))
    rows: list[tuple[Cell, ...]] = []
    for case, tracers in cases.items():
        cells: list[Cell] = []
        for what in ("motion", "poles"):
            jobs = [f"{case} {k} {what}" for k in range(len(tracers))]
            units = [f"{first} {k} {what}" for k in range(len(tracers))]
            cost = statistics.median(median(times, job) for job in jobs) / SAMPLES
            relation = statistics.median(
                ratio(times, job, unit) for job, unit in zip(jobs, units, strict=True)
            )
            cells += [1e6 * cost, relation]
        links = len(tracers[0].mechanism.links)
        groups = [tracer.assembly.groups for tracer in tracers]
        counts = (
            statistics.median(map(len, groups)),
            statistics.median(sum(not g.is_dyad for g in each) for each in groups),
        )
        rows.append((*case, *counts, links * (links - 1) // 2, *cells))
    return rows
