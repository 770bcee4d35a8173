"""Reference values of the rows of a motion: configuration, rates and their derivatives.

The rows of a motion say only which solution is meant. From there Newton's method closes
the loops in the arithmetic chosen, and the loop equations as power series in the input
give all derivatives: the coefficient of each order solves linear equations with the same
matrix. Nothing of the solvers that made the motion is used.
"""

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.conventions import CLOSURE_TOLERANCE, Status
from spherekit.errors import SolveError
from spherekit.exact.arithmetic import Arithmetic, Numbers, wide
from spherekit.exact.chain import ExactChain
from spherekit.exact.linear import left_inverse
from spherekit.exact.series import matrix_product, skew_part, transpose
from spherekit.model.mechanism import Mechanism
from spherekit.motion.motion import Motion
from spherekit.sphere.rotation import Floats

RADIUS = 1e-6
"""A solution farther (rad) from the row than this is not taken for the one meant."""

CONTRACTION = 0.125
"""Newton's second step may be this part of the first; else other solutions are near."""

ROUNDING = 1e3
"""Steps below this many roundings times the conditioning are rounding."""

STEPS = 40


@final
@dataclass(frozen=True)
class ExactRows:
    """Reference values of n rows while one input moves at unit rate, the others held.

    In ground axes, in the numbers of `arithmetic`: `values` (n, variables) rad; `rates`
    (n, variables) of them per unit rate of the input; `rotations` (n, links, 3, 3);
    `axes` (n, pairs, 3) the axis of an R pair, the contact point of others; `w`
    (n, links, 3) angular velocities relative to the ground; `dw`, `ddw` their first and
    second derivative by the input, None where the order asked for does not reach them.
    NaN where the status is not OK.

    In float64: `distance` (n,) rad, the largest change of a variable from the row to the
    solution; `residual` (n,) rad, by which the geometry as declared stays open (rounding,
    except in over-constrained chains); `condition` (n,) of the closure Jacobian without
    the inputs, in Frobenius norms: an error e of the geometry moves the configuration by
    up to about `condition` times e, and it grows without bound towards singularities of
    type II. `status` (n,): that of a row which failed already; NOT_CONVERGED;
    BRANCH_LOST where the solution is farther than 1e-6 rad or others are as near;
    AT_SINGULARITY where the Jacobian has no full rank in these numbers; NOT_CLOSED.
    """

    arithmetic: Arithmetic
    mechanism: Mechanism
    driven: int
    values: Numbers
    rates: Numbers
    rotations: Numbers
    axes: Numbers
    w: Numbers
    dw: Numbers | None
    ddw: Numbers | None
    distance: Floats
    residual: Floats
    condition: Floats
    status: NDArray[np.int8]


def exact_rows(
    motion: Motion,
    rows: NDArray[np.bool_],
    driven: int,
    arithmetic: Arithmetic | None = None,
    order: int = 2,
) -> ExactRows:
    """Return reference values of some rows of a motion.

    The inputs, arcs, angles, radii and coefficients are taken as the float64 numbers
    they are given by; axes and centres are made unit vectors in the arithmetic.

    Parameters
    ----------
    motion
        Any motion; its variables are the starts, its inputs are exact.
    rows
        (n,) which rows are wanted.
    driven
        Number of the input pair that moves.
    arithmetic
        By default the quickest that is wider than float64.
    order
        1 for w alone, 2 for dw as well, 3 for ddw as well.

    Raises
    ------
    SolveError
        If the pair is no input, or the order is not 1, 2 or 3.
    """
    mechanism = motion.mechanism
    if driven not in motion.assembly.inputs:
        names = ", ".join(mechanism.pairs[pair].name for pair in motion.assembly.inputs)
        raise SolveError(
            f"{mechanism.name}: pair number {driven} is no input; inputs: {names}"
        )
    if order not in (1, 2, 3):
        raise SolveError(f"order {order} was asked for; give 1, 2 or 3")
    chosen = motion.rows(np.asarray(rows, dtype=bool))
    numbers = arithmetic or wide()
    with np.errstate(all="ignore"):
        return _Solver(chosen, driven, numbers).rows(order)


@final
class _Solver:
    """Rows of a motion on their way to the solution."""

    def __init__(self, motion: Motion, driven: int, arithmetic: Arithmetic) -> None:
        self.motion, self.driven, self.arithmetic = motion, driven, arithmetic
        mechanism = motion.mechanism
        self.chain = ExactChain(arithmetic, mechanism)
        self.held = [mechanism.variables_of(pair)[0] for pair in motion.assembly.inputs]
        count = len(mechanism.variable_owners)
        self.free = [v for v in range(count) if v not in self.held]

    def rows(self, order: int) -> ExactRows:
        motion, arithmetic = self.motion, self.arithmetic
        n, count = motion.values.shape
        status = motion.status.copy()
        lost = motion.failed | ~np.all(np.isfinite(motion.values), axis=1)
        status[lost & (status == Status.OK)] = Status.NOT_CONVERGED
        known = np.flatnonzero(~lost)
        status[known] = Status.OK
        distance, residual, condition = (np.full(n, np.nan) for _ in range(3))
        links = len(motion.mechanism.links)
        values = self._nothing(n, count)
        rates = self._nothing(n, count)
        rotations = self._nothing(n, links, 3, 3)
        axes = self._nothing(n, len(motion.mechanism.pairs), 3)
        w = [self._nothing(n, links, 3) for _ in range(order)]
        if len(known):
            found = self._closed(known)
            distance[known], residual[known] = found.distance, found.residual
            condition[known], status[known] = found.condition, found.status
            good = found.status == Status.OK
            kept = known[good]
            if len(kept):
                series = self._series(found.values[good], found.inverse[good], order)
                placed, _ = self.chain.place(series)
                values[kept], rates[kept] = series[0], series[1]
                rotations[kept] = placed[0]
                axes[kept] = self.chain.axes(series[0], placed[0])
                slope = np.stack([(k + 1) * placed[k + 1] for k in range(order)])
                spin = skew_part(matrix_product(slope, transpose(placed[:-1])))
                for k, factor in enumerate((1, 1, 2)[:order]):
                    w[k][kept] = factor * spin[k]
        more = [*w[1:], None, None]
        return ExactRows(
            arithmetic=arithmetic,
            mechanism=motion.mechanism,
            driven=self.driven,
            values=values,
            rates=rates,
            rotations=rotations,
            axes=axes,
            w=w[0],
            dw=more[0],
            ddw=more[1],
            distance=distance,
            residual=residual,
            condition=condition,
            status=status,
        )

    def _nothing(self, *shape: int) -> Numbers:
        return self.arithmetic.exact(np.full(shape, np.nan))

    def _start(self, rows: NDArray[np.intp]) -> Numbers:
        """Return the starts (k, variables), with the inputs exactly as given.

        Variables may have been brought into one turn; then so are the inputs.
        """
        near = self.motion.values[rows]
        start = self.arithmetic.exact(near)
        turn = 2 * self.arithmetic.pi()
        for column, variable in enumerate(self.held):
            given = self.motion.inputs[rows, column]
            turns = np.round((given - near[:, variable]) / (2.0 * np.pi))
            whole = self.arithmetic.exact(turns) * turn
            start[:, variable] = self.arithmetic.exact(given) - whole
        return start

    def _linear(self, values: Numbers) -> tuple[Numbers, Numbers, Floats]:
        """Return gaps (k, 3 loops), the inverse of their Jacobian, and its condition."""
        placed, turns = self.chain.place(values[None])
        gaps = self.chain.gaps(placed, turns)[0]
        jacobian = self.chain.jacobian(self.chain.vectors(values, placed[0]))
        own = jacobian[:, :, self.free]
        inverse = left_inverse(self.arithmetic, own)
        return gaps, inverse, self._norm(own) * self._norm(inverse)

    def _norm(self, matrices: Numbers) -> Floats:
        floats = self.arithmetic.floats(matrices)
        return np.asarray(np.linalg.norm(floats, axis=(1, 2)))

    def _closed(self, rows: NDArray[np.intp]) -> "_Closed":
        """Return the solutions nearest to some rows, by Newton's method."""
        eps = self.arithmetic.eps
        start = self._start(rows)
        values = start.copy()
        k = len(rows)
        steps = np.full((STEPS, k), np.nan)
        residual, condition = np.full(k, np.nan), np.full(k, np.nan)
        inverse = self._nothing(k, len(self.free), 3 * len(self.chain.chords))
        going = np.arange(k)
        status = np.full(k, Status.NOT_CONVERGED, dtype=np.int8)
        for step in range(STEPS):
            gaps, inverse[going], condition[going] = self._linear(values[going])
            change = -(inverse[going] @ gaps[..., None])[..., 0]
            size = np.max(self.arithmetic.floats(np.abs(change)), axis=1, initial=0.0)
            steps[step, going] = size
            residual[going] = np.max(
                self.arithmetic.floats(np.abs(gaps)), axis=1, initial=0.0
            )
            flat = ~np.isfinite(size)
            status[going[flat]] = Status.AT_SINGULARITY
            floor = ROUNDING * eps * condition[going]
            ended = (size <= floor) & (
                (size <= 4 * eps) | (size >= steps[step - 1, going] / 2) & (step > 1)
            )
            status[going[ended]] = Status.OK
            moved = ~flat & ~ended & (size <= 1.0)
            values[going[moved, None], self.free] += change[moved]
            going = going[moved]
            if not len(going):
                break
        distance = np.max(self.arithmetic.floats(np.abs(values - start)), axis=1)
        floor = np.maximum(ROUNDING * eps * condition, 0.0)
        wild = (steps[1] > floor) & (steps[1] > CONTRACTION * steps[0])
        closed = status == Status.OK
        status[closed & (residual > CLOSURE_TOLERANCE)] = Status.NOT_CLOSED
        status[closed & (wild | (distance > RADIUS))] = Status.BRANCH_LOST
        return _Closed(values, inverse, distance, residual, condition, status)

    def _series(self, values: Numbers, inverse: Numbers, order: int) -> Numbers:
        """Return series (order + 1, k, variables) of all variables in the moved input."""
        (moved,) = self.motion.mechanism.variables_of(self.driven)
        k, count = values.shape
        rest = np.zeros((order, k, count))
        rest[0, :, moved] = 1.0
        series = np.concatenate([values[None], self.arithmetic.exact(rest)])
        for power in range(1, order + 1):
            part = series[: power + 1]
            gaps = self.chain.gaps(*self.chain.place(part))[power]
            series[power][:, self.free] = -(inverse @ gaps[..., None])[..., 0]
        return series


@final
@dataclass(frozen=True)
class _Closed:
    """What Newton's method reached: see `ExactRows`; `inverse` is of the Jacobian."""

    values: Numbers
    inverse: Numbers
    distance: Floats
    residual: Floats
    condition: Floats
    status: NDArray[np.int8]
