"""Assembly modes that exist, counted by an independent search, and those a run has."""

from dataclasses import dataclass, replace

import numpy as np
from chains import mechanism, random_axes, random_chain, with_contacts
from independent import lacking, multi_start

from spherekit.errors import PlanError
from spherekit.model.parts import Input
from spherekit.motion.motion import PositionAnalysis
from spherekit.planning.inputs import plan_assembly

HALF = np.radians(30.0)
"""Half of the range of the input (rad), its middle the reference pose."""
INPUTS = 5
"""Inputs over the range, at random, at which modes are counted."""
STARTS = 600
"""Starts of the judge at each."""


@dataclass
class Tally:
    """What was counted over the mechanisms judged."""

    modes: int = 0
    missed_by_run: int = 0
    missed_by_curves: int = 0


def ten_bar(seed):
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


def cams(seed):
    """Return a chain of up to five links, one to three of its pairs contacts of circles."""
    random = np.random.default_rng(seed)
    links, sliding = int(random.integers(3, 6)), int(random.integers(1, 3))
    if (links + sliding) % 2:  # no chain grows to that; three links have no room for three
        sliding += 1 if links > 3 else -1
    return _over_range(with_contacts(random, links, 0, sliding))


def _over_range(made):
    return replace(made, inputs=(Input(made.inputs[0].pair, -HALF, HALF),))


def judge(tally, made, seed):
    """Add what a run and the search for all curves have of a mechanism's modes."""
    random = np.random.default_rng([seed, 1])
    inputs = random.uniform(-HALF, HALF, INPUTS)
    tracer = PositionAnalysis(made, samples=91)
    solver, found = tracer.solver, tracer.configurations
    for q in inputs:
        turns, links = multi_start(made, random, STARTS, q)
        on_modes = [
            solver.evaluate(mode, np.array([[q]])).rotations
            for mode in tracer.assembly_modes
        ]
        on_curves = [
            solver.closure.at(
                each.curve.at(each.curve.at_input(solver.single, float(q)).places).values
            ).placed
            for each in found.curves
        ]
        tally.modes += len(turns)
        tally.missed_by_run += lacking(turns, _of_bodies(on_modes, links))
        tally.missed_by_curves += lacking(turns, _of_bodies(on_curves, links))


def _of_bodies(placed, links):
    """Return orientations (n, bodies, 3, 3) of those known, of a link of each body."""
    every = np.concatenate(placed)[:, links]
    return every[np.all(np.isfinite(every), axis=(1, 2, 3))]
