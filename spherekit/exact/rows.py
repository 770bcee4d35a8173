"""Reference values of the rows of a motion: configuration, rates and their derivatives.

The rows of a motion say only which solution is meant. From there Newton's method closes
the loops in the arithmetic chosen, and the loop equations as power series in the input
give all derivatives: the coefficient of each order solves linear equations with the same
matrix. Nothing of the solvers that made the motion is used.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.checked import checked
from spherekit.conventions import CLOSURE_TOLERANCE, Status, listing
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

FAST = 1e-6
"""Steps that shrink by less than this get the inverse of a Jacobian of their own."""

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
    MODE_LOST where the solution is farther than 1e-6 rad and than the row may be off by
    its open loops, or others are as near;
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


@checked(SolveError)
def exact_rows(
    motion: Motion,
    rows: NDArray[np.bool_],
    driven: int,
    arithmetic: Arithmetic | None = None,
    order: int = 2,
    inputs: Numbers | None = None,
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
    inputs
        (rows wanted, inputs) rad in the arithmetic, which the motion's are rounded from;
        by default its own are exact.

    Raises
    ------
    SolveError
        If the pair is not an input, or the order is not 1, 2 or 3.
    """
    (reference,) = exact_rows_by_input(motion, rows, (driven,), arithmetic, order, inputs)
    return reference


def exact_rows_by_input(
    motion: Motion,
    rows: NDArray[np.bool_],
    driven: Sequence[int],
    arithmetic: Arithmetic | None = None,
    order: int = 2,
    inputs: Numbers | None = None,
) -> tuple[ExactRows, ...]:
    """Return `exact_rows` for each of some inputs that move alone, the others held.

    The configurations are found once.
    """
    mechanism = motion.mechanism
    for pair in driven:
        if pair not in motion.assembly.inputs:
            names = listing(mechanism.pairs[p].name for p in motion.assembly.inputs)
            raise SolveError(
                f"{mechanism.name}: pair number {pair} is not an input; inputs: {names}"
            )
    if order not in (1, 2, 3):
        raise SolveError(f"order {order} was asked for; give 1, 2 or 3")
    chosen = motion.rows(np.asarray(rows, dtype=bool))
    with np.errstate(all="ignore"):
        solver = _Solver(chosen, arithmetic or wide(), inputs)
        return tuple(solver.rows(pair, order) for pair in driven)


@final
class _Solver:
    """Rows of a motion on their way to the solution."""

    def __init__(
        self, motion: Motion, arithmetic: Arithmetic, inputs: Numbers | None
    ) -> None:
        self.motion, self.arithmetic = motion, arithmetic
        self.inputs = arithmetic.exact(motion.inputs) if inputs is None else inputs
        mechanism = motion.mechanism
        self.chain = ExactChain(arithmetic, mechanism)
        self.held = [mechanism.variables_of(pair)[0] for pair in motion.assembly.inputs]
        count = len(mechanism.variable_owners)
        self.free = [v for v in range(count) if v not in self.held]
        finite = np.all(np.isfinite(motion.values), axis=1)
        self.known = np.flatnonzero(~motion.failed & finite)
        self.closed = self._closed(self.known)

    def rows(self, driven: int, order: int) -> ExactRows:
        motion, closed, usable = self.motion, self.closed, self.known
        n, count = motion.values.shape
        links = len(motion.mechanism.links)
        status = motion.status.copy()
        status[status == Status.OK] = Status.NOT_CONVERGED
        status[usable] = closed.status
        distance, residual, condition = (np.full(n, np.nan) for _ in range(3))
        distance[usable], residual[usable] = closed.distance, closed.residual
        condition[usable] = closed.condition
        values, rates = self._nothing(n, count), self._nothing(n, count)
        rotations = self._nothing(n, links, 3, 3)
        axes = self._nothing(n, len(motion.mechanism.pairs), 3)
        w = [self._nothing(n, links, 3) for _ in range(order)]
        good = closed.status == Status.OK
        if np.any(good):
            kept = usable[good]
            inverse = closed.inverse[good]
            (moved,) = motion.mechanism.variables_of(driven)
            series = motion_series(
                self.chain, closed.values[good], inverse, self.free, moved, order
            )
            placed, _ = self.chain.place(series)
            values[kept], rates[kept] = series[0], series[1]
            rotations[kept] = placed[0]
            axes[kept] = self.chain.axes(series[0], placed[0])
            for given, rate in zip(w, turning_rates(placed), strict=True):
                given[kept] = rate
        more = [*w[1:], None, None]
        return ExactRows(
            arithmetic=self.arithmetic,
            mechanism=motion.mechanism,
            driven=driven,
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
            start[:, variable] = self.inputs[rows, column] - whole
        return start

    def _gaps(self, values: Numbers) -> Numbers:
        """Return by how much the loops stay open, (k, 3 loops)."""
        return np.asarray(self.chain.gaps(*self.chain.place(values[None]))[0])

    def _inverse(self, values: Numbers) -> tuple[Numbers, Floats]:
        """Return the inverse of the Jacobian without the inputs, and its condition."""
        placed, _ = self.chain.place(values[None])
        jacobian = self.chain.jacobian(self.chain.vectors(values, placed[0]))
        passive = jacobian[:, :, self.free]
        inverse = left_inverse(self.arithmetic, passive)
        sizes = (
            np.linalg.norm(self.arithmetic.floats(matrix), axis=(1, 2))
            for matrix in (passive, inverse)
        )
        return inverse, np.maximum(np.prod(list(sizes), axis=0), 1.0)

    def _largest(self, values: Numbers) -> Floats:
        """Return the largest size (k,) in each row of values (k, m)."""
        sizes = self.arithmetic.floats(np.abs(values))
        return np.asarray(np.max(sizes, axis=1, initial=0.0))

    def _closed(self, rows: NDArray[np.intp]) -> "_Closed":
        """Return the solutions nearest to some rows, by Newton's method.

        The inverse of the first step serves for those after it too, while they shrink
        fast. A step ends the iteration when it is rounding: no longer shrinking, and
        small against the conditioning.
        """
        eps, k = self.arithmetic.eps, len(rows)
        start = self._start(rows)
        values = start.copy()
        first, second, last = np.zeros(k), np.zeros(k), np.full(k, np.inf)
        condition = np.full(k, np.nan)
        inverse = self._nothing(k, len(self.free), 3 * len(self.chain.chords))
        status = np.full(k, Status.NOT_CONVERGED, dtype=np.int8)
        going, slow = np.arange(k), np.ones(k, dtype=bool)
        for step in range(STEPS):
            if not len(going):
                break
            anew = going[slow[going]]
            if len(anew):
                inverse[anew], condition[anew] = self._inverse(values[anew])
            gaps = self._gaps(values[going])
            change = -(inverse[going] @ gaps[..., None])[..., 0]
            size = self._largest(change)
            if step < 2:
                (first, second)[step][going] = size
            flat = ~np.isfinite(size)
            status[going[flat]] = Status.AT_SINGULARITY
            rounding = size <= ROUNDING * eps * condition[going]
            ended = rounding & ((size <= 4 * eps) | (size >= last[going] / 2))
            status[going[ended]] = Status.OK
            slow[going] = size > FAST * last[going]
            last[going] = size
            moved = ~flat & ~ended & (size <= 1.0)
            going = going[moved]
            values[going[:, None], self.free] += change[moved]
        closed = status == Status.OK
        residual = np.full(k, np.nan)
        if np.any(closed):
            inverse[closed], condition[closed] = self._inverse(values[closed])
            residual[closed] = self._largest(self._gaps(values[closed]))
            status[closed & ~np.isfinite(condition)] = Status.AT_SINGULARITY
            closed &= status == Status.OK
        distance = self._largest(values - start)
        wild = (second > ROUNDING * eps * condition) & (second > CONTRACTION * first)
        status[closed & (residual > CLOSURE_TOLERANCE)] = Status.NOT_CLOSED
        off = self.motion.configuration_error[rows]
        near = np.maximum(np.where(np.isfinite(off), 2.0 * off, 0.0), RADIUS)
        status[closed & (wild | (distance > near))] = Status.MODE_LOST
        return _Closed(values, inverse, distance, residual, condition, status)


def motion_series(
    chain: ExactChain,
    values: Numbers,
    inverse: Numbers,
    free: Sequence[int],
    moved: int,
    order: int,
) -> Numbers:
    """Return series (order + 1, k, variables) of all variables in one that moves.

    At closed configurations (k, variables); `inverse` is that of the closure Jacobian's
    columns of the `free` variables, all but those that are held and the moved one.
    """
    k, count = values.shape
    rest = np.zeros((order, k, count))
    rest[0, :, moved] = 1.0
    series = np.concatenate([values[None], chain.arithmetic.exact(rest)])
    for power in range(1, order + 1):
        part = series[: power + 1]
        gaps = chain.gaps(*chain.place(part))[power]
        series[power][:, list(free)] = -(inverse @ gaps[..., None])[..., 0]
    return series


def turning_rates(placed: Numbers) -> list[Numbers]:
    """Return w, dw, ddw as far as series (order + 1, n, links, 3, 3) of rotations go."""
    order = len(placed) - 1
    slope = np.stack([(k + 1) * placed[k + 1] for k in range(order)])
    spin = skew_part(matrix_product(slope, transpose(placed[:-1])))
    return [factor * spin[k] for k, factor in enumerate((1, 1, 2)[:order])]


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
