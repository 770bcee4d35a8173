"""Searching the configurations of a mechanism over the range of its inputs at random.

With one input the input is unknown too: a start goes to the configuration curves, so that
one that is short along the input is met as well as others, and not only where an input
probed happens to lie in it. With several each start has the inputs of one sample. Where
wheels are in mesh, each start has an input and the lengths rolled that belong to it.
"""

from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import CLOSURE_TOLERANCE
from spherekit.motion.assembly_modes import Solver, determinant_signs
from spherekit.motion.pairs import penetrates
from spherekit.motion.search import POLISHING_STEPS, SEED, STARTS, damped, starting_range
from spherekit.numeric.turns import wrap
from spherekit.sphere.rotation import Floats

RANGE_ROUNDS = 4
"""Rounds of a search over a range at least."""
FLAT = 1e-5
"""Configurations nearer to a dead centre (relative singular value) are not told apart."""


@final
class RangeSearch:
    """Rounds of random starts over a range of the inputs, the same ones every time.

    `low`, `high` (inputs,) rad; `samples` (n, inputs) are the inputs to start at if they
    are to be kept.
    """

    def __init__(
        self,
        solver: Solver,
        low: Floats,
        high: Floats,
        samples: Floats | None = None,
        seed: int = SEED,
    ) -> None:
        self.solver, self.samples = solver, samples
        self._random = np.random.default_rng(seed)
        self._low, self._high = starting_range(solver.closure)
        driven = list(solver.driven)
        self._low[driven], self._high[driven] = low, high
        self._least = np.full(len(self._low), -np.inf)
        self._most = np.full(len(self._low), np.inf)
        self._least[driven], self._most[driven] = low, high

    def _drawn(self) -> tuple[Floats, NDArray[np.intp]]:
        """Return the starts (n, variables) of a round, and the sample (n,) of each."""
        starts = self._random.uniform(self._low, self._high, (STARTS, len(self._low)))
        if self.samples is None:
            return starts, np.zeros(STARTS, dtype=np.intp)
        rows = self._random.integers(0, len(self.samples), STARTS)
        starts[:, list(self.solver.driven)] = self.samples[rows]
        return starts, rows

    def rounds(self, count: int = 1) -> tuple[Floats, NDArray[np.intp]]:
        """Return closed configurations (k, variables) that so many rounds lead to.

        With them the sample (k,) of each where the inputs are kept. Those whose contacts
        do not exist, or that lie at a dead centre, are left out.
        """
        solver, driven = self.solver, list(self.solver.driven)
        drawn = [self._drawn() for _ in range(count)]
        starts, rows = (np.concatenate(parts) for parts in zip(*drawn, strict=True))
        closure = solver.closure
        with np.errstate(all="ignore"):
            held = driven
            if solver.meshes is not None:
                held = driven + list(solver.meshes.variables)
                starts[:, held[len(driven) :]] = solver.meshes.rolled(starts[:, driven])
            if self.samples is None and solver.meshes is None:
                values, near = damped(closure, starts, (), self._least, self._most)
            else:
                values, near = damped(closure, starts, held)
            values, rows = values[near], rows[near]
            if not len(values):
                return values, rows
            result = closure.solve(values, held, iterations=POLISHING_STEPS)
            values = result.values
            at = closure.at(values)
            free = [v for v in range(values.shape[1]) if v not in driven]
            _, reciprocal_condition = determinant_signs(at.jacobian[:, :, free])
            good = (result.residual < CLOSURE_TOLERANCE) & (reciprocal_condition > FLAT)
            good &= np.all(at.states.inside, axis=1)
            good &= ~penetrates(closure.joints, at.states)
        turning = [v for v in solver.angles if v not in driven]
        values[:, turning] = wrap(values[:, turning])
        return values[good], rows[good]
