"""Assembly modes that exist, counted by an independent search, and those a run has."""

from dataclasses import dataclass, replace

import numpy as np
from chains import mechanism, random_axes, random_chain, with_contacts
from mode_judge import Structure

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
SAME = 1e-4
"""Rotation matrices of a mode of the judge and of the same one elsewhere differ by less."""


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
    structure = Structure.of(made)
    tracer = PositionAnalysis(made, samples=91)
    solver, found = tracer.solver, tracer.configurations
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


def _lacking(structure, made, modes, placed):
    """Return how many modes are none of the configurations placed."""
    every = np.concatenate([np.zeros((0, len(made.links), 3, 3)), *placed])
    seen = structure.seen(made.links, every[np.all(np.isfinite(every), axis=(1, 2, 3))])
    away = np.max(np.abs(modes[:, None] - seen[None]), axis=(2, 3, 4), initial=0.0)
    return int(np.sum(np.min(away, axis=1, initial=np.inf) > SAME))
