"""Wheels that turn with an input by ratios of teeth, over all turns until they are back.

Where an input turns p/q as fast as others, all these angles are multiples of one variable
that goes round once while the input goes round q times. Then equations are sums of its
cosines and sines, as of any other angle, and configurations a turn of the input apart are
different unless everything is back.
"""

from dataclasses import replace
from math import lcm

from spherekit.conventions import listing
from spherekit.errors import PlanError
from spherekit.proof.construction import Across, Construction
from spherekit.proof.written import Written

MOST_LAPS = 64
"""Turns until wheels are back, and turns of wheels meanwhile, at most."""


def turned_together(written: Written, construction: Construction) -> Construction:
    """Return a construction in which wheels turn with the variable of the only input.

    Raises
    ------
    PlanError
        If the ratios are not those of teeth, or are back after too many turns.
    """
    structure = written.structure
    wheels = listing(structure.pairs[pair] for pair in construction.followers)
    ratios = written.exact_ratios()
    if ratios is None:
        raise PlanError(
            f"{structure.name}: wheels turn {wheels} with the input; proofs over ranges "
            "are for ratios of teeth, with which wheels come back: give teeth, or give "
            "values of the inputs with --at"
        )
    laps = lcm(*(ratio.denominator for ratio in ratios))
    turns = dict(zip(structure.followers, (int(laps * r) for r in ratios), strict=True))
    most = max(laps, *map(abs, turns.values()))
    if most > MOST_LAPS:
        raise PlanError(
            f"{structure.name}: wheels turn {wheels} with the input, up to {most} turns "
            f"until they are back; proofs over ranges are for at most {MOST_LAPS}: give "
            "values of the inputs with --at"
        )
    (driven,) = construction.driven
    turns[driven] = laps
    variable = construction.unknowns
    steps = tuple(
        replace(step, variable=variable, turns=turns[step.pair])
        if isinstance(step, Across) and step.pair in turns
        else step
        for step in construction.steps
    )
    pairs = construction.pairs[: variable + 1]
    return replace(construction, steps=steps, pairs=pairs, laps=laps)
