"""Angles that go on over whole turns, where a motion reduces them to one.

Loads that depend on an angle itself, such as wound springs, want it to go on.
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, Self, final

import numpy as np

from spherekit.conventions import TURN
from spherekit.motion.assembly_modes import Solver
from spherekit.motion.motion import Motion
from spherekit.sphere.rotation import Floats


@final
class AngleMemory:
    """The last configuration of each mode with its turns, from which samples go on.

    With one input nothing is remembered: its value says how far all angles have turned.
    """

    def __init__(self) -> None:
        self._last: dict[int, Floats] = {}

    def state(self) -> list[list[Any]]:
        """Return what is remembered, ready for JSON, bit for bit."""
        return [[mode, *map(float, last)] for mode, last in self._last.items()]

    @classmethod
    def restored(cls, state: Iterable[Any]) -> Self:
        """Return the memory that `state` gave."""
        memory = cls()
        memory._last = {int(mode): np.array(last) for mode, *last in state}
        return memory

    def continued(
        self, motion: Motion, names: Iterable[str], solver: Solver
    ) -> Mapping[str, Floats]:
        """Return the variables (n,) of pairs, by name, at the next block of a motion.

        Angles are those of `spherekit.motion.unwrapping`; NaN stays, and is passed over.
        That of a driven pair is the input as it was given. Arc lengths, and angles of a
        simulation, which go on already, are those of the motion.
        """
        names = list(names)
        mechanism, inputs = motion.mechanism, motion.assembly.inputs
        wanted = [mechanism.angles[name] for name in names if name in mechanism.angles]
        turns = np.zeros_like(motion.values)
        if wanted and motion.sense is None:
            for place, mode in enumerate(motion.assembly_modes):
                first = place * motion.samples
                here = motion.values[first : first + motion.samples]
                rows = np.flatnonzero(np.all(np.isfinite(here), axis=1)) + first
                if not len(rows):
                    continue
                turns[rows] = solver.unwrapping.turns(
                    mode.number,
                    motion.values[rows],
                    motion.inputs[rows],
                    wanted,
                    self._last.get(mode.number),
                )
                if len(inputs) > 1:
                    last = motion.values[rows[-1]] + TURN * turns[rows[-1]]
                    last[list(solver.driven)] = motion.inputs[rows[-1]]
                    self._last[mode.number] = last
        angles = {}
        for name in names:
            pair = mechanism.pair_number[name]
            (variable,) = mechanism.variables_of(pair)
            angles[name] = motion.values[:, variable] + TURN * turns[:, variable]
            if pair in inputs:
                angles[name] = motion.inputs[:, inputs.index(pair)]
        return angles


def going_on(motion: Motion, solver: Solver) -> Motion:
    """Return a motion whose angles go on over all turns, as loads see them."""
    values, angles = motion.values.copy(), motion.mechanism.angles
    for pair, angle in AngleMemory().continued(motion, angles, solver).items():
        values[:, angles[pair]] = angle
    return replace(motion, values=values)
