"""Angles that go on from sample to sample, where a motion reduces them to a turn.

Loads that depend on an angle itself, such as wound springs, want it to go on.
"""

from collections.abc import Iterable, Mapping
from typing import Any, Self, final

import numpy as np

from spherekit.conventions import TURN
from spherekit.motion.motion import Motion
from spherekit.sphere.rotation import Floats


@final
class AngleMemory:
    """What earlier blocks of a motion found, so that angles continue.

    For each assembly mode and variable the last angle in (-pi, pi], and the turns made
    since the first sample; whole turns, so that nothing adds up however many there are.
    """

    def __init__(self) -> None:
        self._last: dict[tuple[int, int], tuple[float, int]] = {}

    def state(self) -> list[list[Any]]:
        """Return what is remembered, ready for JSON, bit for bit."""
        return [[*key, *last] for key, last in self._last.items()]

    @classmethod
    def restored(cls, state: Iterable[Any]) -> Self:
        """Return the memory that `state` gave."""
        memory = cls()
        for assembly_mode, variable, angle, turns in state:
            memory._last[assembly_mode, variable] = float(angle), int(turns)
        return memory

    def continued(self, motion: Motion, names: Iterable[str]) -> Mapping[str, Floats]:
        """Return the variables (n,) of pairs, by name, at the next block of a motion.

        From the first sample of each assembly mode on an angle moves by less than half a
        turn from one sample to the next; NaN stays, and is passed over. That of a driven
        pair is the input as it was given. Arc lengths, and angles over a grid, are those of
        the motion.
        """
        return {name: self._of(motion, name) for name in names}

    def _of(self, motion: Motion, name: str) -> Floats:
        pair = motion.mechanism.pair_number[name]
        if pair in motion.assembly.inputs:
            return motion.inputs[:, motion.assembly.inputs.index(pair)]
        (variable,) = motion.mechanism.variables_of(pair)
        angles = motion.values[:, variable].copy()
        if not motion.is_path or name not in motion.mechanism.angles:
            return angles
        for position, assembly_mode in enumerate(motion.assembly_modes):
            in_mode = angles[position * motion.samples : (position + 1) * motion.samples]
            finite = np.flatnonzero(np.isfinite(in_mode))
            if not len(finite):
                continue
            angle = in_mode[finite]
            key = assembly_mode.number, variable
            last, turns = self._last.get(key, (float(angle[0]), 0))
            steps = np.round(np.diff(angle, prepend=last) / TURN).astype(np.int64)
            made = turns - np.cumsum(steps)
            in_mode[finite] += TURN * made
            self._last[key] = float(angle[-1]), int(made[-1])
        return angles
