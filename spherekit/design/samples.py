"""The samples that every design goes through."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.analysis.running.sampling import UNIT_SPEED, check_time
from spherekit.errors import DesignError
from spherekit.model.laws import ConstantSpeed
from spherekit.model.mechanism import Mechanism
from spherekit.model.study import Study
from spherekit.motion.input_grid import InputGrid, given_path, grid, straight
from spherekit.motion.timing import by_laws
from spherekit.numeric.turns import return_by_turns
from spherekit.planning.inputs import driven_pairs
from spherekit.sphere.rotation import Floats


@final
@dataclass(frozen=True)
class DesignSamples:
    """The inputs at every sample.

    `rows` (samples, 3 inputs + 1): angles (rad) of the `inputs`, rates, accelerations, and
    the time. `shape` counts the samples along a path, or along each axis of a grid.
    """

    inputs: tuple[str, ...]
    rows: Floats
    shape: tuple[int, ...]

    @staticmethod
    def of(study: Study) -> "DesignSamples":
        """Return the samples of a study, by its laws if it has some.

        Raises
        ------
        DesignError
            If it is a simulation, or so many samples are of another number of inputs.
        """
        mechanism = study.mechanism
        if study.start is not None:
            raise DesignError(
                f"{study.name}: designs are compared at samples of inputs, not along "
                "simulations; drive them"
            )
        check_time(study)
        if not mechanism.inputs:
            (pair,) = driven_pairs(mechanism)
            mechanism = mechanism.with_inputs(mechanism.pairs[pair].name)
        names = tuple(driven.pair for driven in mechanism.inputs)
        start = np.array([driven.start for driven in mechanism.inputs])
        if study.path is not None:
            path = given_path(study.path, len(names)).q
            start = np.min(path, axis=0) if len(names) == 1 else path[0]
            return DesignSamples.at(names, path, start, np.ones(len(names)))
        if study.duration is not None:
            return DesignSamples._timed(study, mechanism, names)
        lattice = _lattice(study, mechanism)
        sense = np.array([driven.sense for driven in mechanism.inputs])
        return DesignSamples.at(names, lattice.q, start, sense, lattice.shape)

    @staticmethod
    def _timed(
        study: Study, mechanism: Mechanism, names: tuple[str, ...]
    ) -> "DesignSamples":
        if not isinstance(study.samples, int):
            raise DesignError(f"{study.name}: over a time give one number of samples")
        assert study.duration is not None
        t = np.linspace(0.0, study.duration, study.samples)
        laws = {
            driven.pair: ConstantSpeed(driven.sense * UNIT_SPEED, driven.start)
            for driven in mechanism.inputs
        }
        q, timing = by_laws(names, {**laws, **study.laws}, t)
        rows = np.concatenate([q, timing.dq, timing.ddq, t[:, None]], axis=1)
        return DesignSamples(names, rows, (len(t),))

    @staticmethod
    def at(
        inputs: Sequence[str],
        q: Floats,
        start: Floats,
        sense: Floats,
        shape: tuple[int, ...] | None = None,
    ) -> "DesignSamples":
        """Return samples q (n, inputs) of inputs that turn at unit speed from a start.

        `sense` (inputs,) is 1 of those that rise and -1 of those that fall.
        """
        n = len(q)
        rates = np.broadcast_to(UNIT_SPEED * sense, q.shape)
        time = (q[:, :1] - start[0]) * sense[0] / UNIT_SPEED
        rows = np.concatenate([q, rates, np.zeros_like(q), time], axis=1)
        return DesignSamples(tuple(inputs), rows, shape or (n,))

    @property
    def returns(self) -> bool:
        """Whether a path ends at the inputs of its start, after whole turns."""
        first, last = self.rows[[0, -1], : len(self.inputs)]
        return len(self.shape) == 1 and return_by_turns(first, last)

    @property
    def lattice(self) -> InputGrid:
        """The inputs with their neighbours."""
        return InputGrid(self.rows[:, : len(self.inputs)], self.shape)


def _lattice(study: Study, mechanism: Mechanism) -> InputGrid:
    count, samples = len(mechanism.inputs), study.samples
    if isinstance(samples, int):
        if study.grid:
            return grid(mechanism.inputs, [samples] * count)
        return straight(mechanism.inputs, samples)
    if len(samples) != count:
        raise DesignError(
            f"{study.name}: samples: {'x'.join(map(str, samples))} is of {len(samples)} "
            f"inputs, but there are {count}; give one number for each"
        )
    return grid(mechanism.inputs, samples)
