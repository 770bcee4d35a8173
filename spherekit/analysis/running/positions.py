"""Where the samples of a run lie, all at once: read between nodes, or in closed form."""

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.engine.closed_positions import ClosedPositions, closed_positions
from spherekit.engine.row_kernel import RowKernel
from spherekit.motion.guides import ModeCurve
from spherekit.motion.motion import Tracer
from spherekit.motion.predicted import Predictor
from spherekit.sphere.rotation import Floats


@final
@dataclass(frozen=True)
class Positions:
    """The variables of samples, nearly closed, and which modes surely do not reach them.

    A `predictor` where samples lie close together along a path, else the `closed` form
    where all groups are dyads. What lies beyond the curve that a mode follows is out of
    reach where that curve ends for this reason. Where they are `by_inputs`, nothing is
    read: the kernel of rows has the closed form in it.
    """

    tracer: Tracer
    predictor: Predictor | None
    closed: ClosedPositions | None
    by_inputs: bool

    @classmethod
    def of(cls, tracer: Tracer, kernel: RowKernel) -> "Positions":
        """Return those of a tracer's samples."""
        # On arrays, reading between nodes takes half the time.
        may_be_read = kernel.engine == "numpy" and len(tracer.inputs) == 1
        is_read = may_be_read or not kernel.has_closed_form
        predictor = Predictor.of(tracer) if is_read else None
        closed = closed_positions(tracer.mechanism, tracer.assembly)
        by_inputs = kernel.has_closed_form and predictor is None
        return cls(tracer, predictor, closed, by_inputs)

    def read(self, start: int, stop: int, out: Floats) -> None:
        """Write what is read between nodes of samples from `start` to `stop`.

        As variables (variables, modes, samples), NaN where nothing is.
        """
        if self.predictor is not None:
            self.predictor.read(start, stop, out)
        elif not self.by_inputs:
            out[:] = np.nan

    def signs(self, number: int) -> tuple[int, ...]:
        """Return the signs of a mode's dyads."""
        return self.tracer.assembly_modes[number].signs

    def complete(self, number: int, q: Floats, values: Floats) -> NDArray[np.bool_]:
        """Write variables (variables, n) of a mode at inputs q (inputs, n), if not read.

        In closed form, or none. Return (n,) which samples the mode surely does not reach.
        """
        mode = self.tracer.assembly_modes[number]
        lost = np.zeros(q.shape[1], dtype=bool)
        open_ = np.flatnonzero(np.isnan(values[0]))
        if len(open_) and self.closed is not None:
            values[:, open_], lost[open_] = self.closed.at(q[:, open_], mode.signs)
        elif len(open_) and isinstance(mode.guide, ModeCurve):
            lost[open_] = mode.guide.ends_before(q[0, open_])
        return lost
