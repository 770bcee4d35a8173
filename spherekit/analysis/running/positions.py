"""Where the samples of a run lie, all at once: read between nodes, or in closed form."""

from dataclasses import dataclass
from typing import Literal, final

import numpy as np
from numpy.typing import NDArray

from spherekit.engine.closed_positions import ClosedPositions, closed_positions
from spherekit.motion.motion import Tracer
from spherekit.motion.predicted import Predictor
from spherekit.sphere.rotation import Floats


@final
@dataclass(frozen=True)
class Positions:
    """The variables of samples, nearly closed, and which modes surely do not reach them.

    The `closed` form where all groups are dyads; a `predictor` where samples lie close
    together along a path and there is none, or it takes longer.
    """

    tracer: Tracer
    predictor: Predictor | None
    closed: ClosedPositions | None

    @classmethod
    def of(cls, tracer: Tracer, engine: Literal["numpy", "compiled"]) -> "Positions":
        """Return those of a tracer's samples."""
        closed = closed_positions(tracer.mechanism, tracer.assembly, engine)
        # On arrays, reading between nodes takes half the time.
        is_read = closed is None or (engine == "numpy" and len(tracer.inputs) == 1)
        return cls(tracer, Predictor.of(tracer) if is_read else None, closed)

    def at(self, start: int, stop: int) -> tuple[Floats, NDArray[np.bool_]]:
        """Return variables (variables, modes, samples) of samples from `start` to `stop`.

        NaN where nothing is known; and (modes, samples) what is out of reach.
        """
        tracer = self.tracer
        modes, count = len(tracer.assembly_modes), stop - start
        lost = np.zeros((modes, count), dtype=bool)
        if self.predictor is not None:
            values = self.predictor.at(start, stop)
        else:
            wide = len(tracer.mechanism.variable_owners), modes, count
            values = np.full(wide, np.nan)
        if self.closed is None:
            return values, lost
        q = tracer.input_grid.q[start:stop].T
        for number, mode in enumerate(tracer.assembly_modes):
            open_ = np.flatnonzero(np.isnan(values[:, number]).any(axis=0))
            if len(open_) == count:
                values[:, number], lost[number] = self.closed.at(q, mode.signs)
            elif len(open_):
                closed_values, out = self.closed.at(q[:, open_], mode.signs)
                values[:, number, open_], lost[number, open_] = closed_values, out
        return values, lost
