"""The part of a mechanism that places some links, with the assembly modes of the whole.

What hangs on it multiplies assembly modes and curves, and says nothing of the links asked
about unless it stops the input. A group that is left out has no dead centre anywhere.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.conventions import Status
from spherekit.motion.configuration import SAME_CONFIGURATION
from spherekit.motion.input_turning_points import input_turning_points
from spherekit.motion.modes import MOST_COST, MOST_TIME
from spherekit.motion.motion import Motion, Tracer
from spherekit.numeric.turns import wrap
from spherekit.planning.part import part_for

COMPARED = 9
"""Samples at which assembly modes of the part and of the whole are compared."""
SAME_INPUT = 1e-6
"""Inputs (rad) at which modes meet and that differ by less are one."""


@final
@dataclass(frozen=True)
class TracedPart:
    """A tracer of a part, or of the whole mechanism where nothing can be left out.

    Attributes
    ----------
    tracer
        That of the part.
    variables
        Numbers that its variables have in the whole.
    modes
        Numbers of the assembly modes of the whole, by those of the part.
    """

    tracer: Tracer
    variables: tuple[int, ...]
    modes: dict[int, tuple[int, ...]]

    @staticmethod
    def of(tracer: Tracer, links: Iterable[int]) -> "TracedPart":
        """Return the part that places links, by their numbers, relative to the input."""
        whole = tracer.mechanism
        made = whole if tracer.by_rank else part_for(whole, links)
        if made is not whole and tracer.solver.meshes is None:
            part = Tracer(made, path=np.linspace(*tracer.range, COMPARED)[:, None])
            pairs = [whole.pair_number[pair.name] for pair in made.pairs]
            variables = tuple(v for pair in pairs for v in whole.variables_of(pair))
            modes = _modes(tracer, part, list(variables))
            if modes is not None and _same_turning_points(tracer, part):
                return TracedPart(part, variables, modes)
        numbers = [mode.number for mode in tracer.assembly_modes]
        every = tuple(range(len(whole.variable_owners)))
        return TracedPart(tracer, every, {number: (number,) for number in numbers})


def _modes(
    tracer: Tracer, part: Tracer, variables: list[int]
) -> dict[int, tuple[int, ...]] | None:
    """Return the modes of the whole in each of the part, None if one has no place."""
    motion: Motion = tracer.sparse(COMPARED)
    modes: dict[int, tuple[int, ...]] = {mode.number: () for mode in part.assembly_modes}
    k = motion.samples
    there = {
        mode.number: part.solver.evaluate(mode, motion.inputs[:k]).values
        for mode in part.assembly_modes
    }
    for place, mode in enumerate(tracer.assembly_modes):
        rows = slice(place * k, (place + 1) * k)
        good = motion.status[rows] == Status.OK
        values = motion.values[rows][good][:, variables]
        for number, of_part in there.items():
            away = np.abs(wrap(of_part[good] - values))
            if len(values) and np.max(away, initial=0.0) < SAME_CONFIGURATION:
                modes[number] += (mode.number,)
                break
        else:
            return None
    return modes


def _same_turning_points(tracer: Tracer, part: Tracer) -> bool:
    """Return whether what is left out meets no dead centre at any input of a turn."""
    whole, inner = (
        input_turning_points(solver, -np.pi, np.pi, MOST_COST, MOST_TIME)
        for solver in (tracer.solver, part.solver)
    )
    return (
        not len(whole.doubtful)
        and len(whole.places) == len(inner.places)
        and bool(np.all(np.abs(whole.places - inner.places) < SAME_INPUT))
    )
