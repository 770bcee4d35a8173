"""Where the samples of a run lie, all at once: read between nodes, or in closed form."""

from dataclasses import dataclass
from typing import Literal, final

import numpy as np
from numpy.typing import NDArray

from spherekit.engine.closed_positions import ClosedPositions, closed_positions
from spherekit.motion.follow import ModeCurve
from spherekit.motion.motion import Tracer
from spherekit.motion.predicted import Predictor
from spherekit.sphere.rotation import Floats


@final
@dataclass(frozen=True)
class Positions:
    """The variables of samples, nearly closed, and which modes surely do not reach them.

    The `closed` form where all groups are dyads; a `predictor` where samples lie close
    together along a path and there is none, or it takes longer. What lies beyond the curve
    that a mode follows is out of reach where that curve ends for this reason.
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

    def read(self, start: int, stop: int, out: Floats) -> None:
        """Write what is read between nodes of samples from `start` to `stop`.

        As variables (variables, modes, samples), NaN where nothing is.
        """
        if self.predictor is not None:
            self.predictor.read(start, stop, out)
        elif self.closed is None:
            out[:] = np.nan

    @property
    def width(self) -> int:
        """Rows of the memory that `complete` takes."""
        if self.closed is not None and self.predictor is None:
            return self.closed.width
        return len(self.tracer.mechanism.variable_owners)

    def complete(
        self, number: int, q: Floats, values: Floats, memory: Floats
    ) -> tuple[Floats, NDArray[np.bool_]]:
        """Return variables (variables, n) of a mode at inputs q (inputs, n), in `memory`.

        Those of `values`, which were read; the others in closed form, or NaN. With them
        (n,) which samples the mode surely does not reach. The memory is (width, n).
        """
        mode = self.tracer.assembly_modes[number]
        if self.closed is not None and self.predictor is None:
            return self.closed.at(q, mode.signs, memory)
        memory[:] = values
        values = memory
        lost = np.zeros(q.shape[1], dtype=bool)
        open_ = np.flatnonzero(np.isnan(values[0]))
        if len(open_) and self.closed is not None:
            values[:, open_], lost[open_] = self.closed.at(q[:, open_], mode.signs)
        elif len(open_) and isinstance(mode.guide, ModeCurve):
            lost[open_] = mode.guide.ends_before(q[0, open_])
        return values, lost
