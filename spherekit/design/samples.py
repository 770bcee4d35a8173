"""The samples that every design goes through."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.analysis.running.sampling import UNIT_SPEED, check_time
from spherekit.errors import DesignError
from spherekit.model.laws import ConstantSpeed
from spherekit.model.study import Study
from spherekit.motion.timing import by_laws
from spherekit.sphere.rotation import Floats


@final
@dataclass(frozen=True)
class DesignSamples:
    """The input at every sample: q (rad), dq, ddq and t, as rows (samples, 4)."""

    rows: Floats

    @staticmethod
    def of(study: Study) -> "DesignSamples":
        """Return the samples of a study with one input, by its law if it has one.

        Raises
        ------
        DesignError
            If it has several inputs, or is a simulation.
        """
        mechanism = study.mechanism
        if len(mechanism.inputs) != 1 or study.start is not None or study.grid:
            raise DesignError(
                f"{study.name}: designs are compared at samples of one input, not along "
                "simulations or over several inputs; drive one and lock the others"
            )
        (driven,) = mechanism.inputs
        if not isinstance(study.samples, int):
            raise DesignError(f"{study.name}: give one number of samples")
        check_time(study)
        if study.path is not None:
            return DesignSamples.at(study.path[:, 0], float(np.min(study.path)))
        if study.duration is None:
            q = np.linspace(driven.start, driven.stop, study.samples)
            return DesignSamples.at(q, driven.start)
        t = np.linspace(0.0, study.duration, study.samples)
        law = study.laws.get(driven.pair, ConstantSpeed(UNIT_SPEED, driven.start))
        q, timing = by_laws([driven.pair], {driven.pair: law}, t)
        states = q[:, 0], timing.dq[:, 0], timing.ddq[:, 0], t
        return DesignSamples(np.stack(states, axis=1))

    @staticmethod
    def at(q: Sequence[float] | Floats, start: float) -> "DesignSamples":
        """Return samples of an input that turns at unit speed from a start."""
        q = np.asarray(q, dtype=float)
        ones = np.full_like(q, UNIT_SPEED)
        return DesignSamples(
            np.stack([q, ones, np.zeros_like(q), (q - start) / UNIT_SPEED], axis=1)
        )
