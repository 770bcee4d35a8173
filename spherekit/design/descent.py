"""Descents of sizings by exact gradients.

The least of the greatest of several functions that have kinks, within bounds.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from spherekit.analysis.contract import Merit
from spherekit.arrays import Array, Bools, Floats
from spherekit.design.evaluate import Evaluator
from spherekit.design.figures import extremes, widest_swings
from spherekit.design.held_modes import HeldMode
from spherekit.design.sensitivity import DEG, DesignAt
from spherekit.design.sweep import Columns
from spherekit.design.wanted import Sizing
from spherekit.engine.design_kernel import design_kernel
from spherekit.engine.expression_graph import (
    derivatives,
    expression_terms,
    symbols,
)
from spherekit.engine.row_quantities import row_quantities
from spherekit.engine.system import ArrayFunction, array_function
from spherekit.model.expression import Expression

Parts = tuple[Floats, Floats, Floats, Floats]
"""Values (k,), gradients (k, n), limits' values (m,) and gradients (m, n) at a place."""

FIRST, LONGEST, SHORTEST = 0.05, 0.25, 1e-9
"""Longest step along an axis: of the first step, of any, and where a descent ends."""
SERIOUS = 0.1
"""Part of the decrease that the planes promise from which a step is taken."""
ROOM = 0.1
"""Part of a promised decrease by which limits are kept to."""
MOST_STEPS = 200
KEPT = 40
"""Places whose planes are kept, the newest."""
NEAR = 4.0
"""Planes of places within this many steps are kept."""


def least_greatest(
    parts: Callable[[Floats], Parts | None], x: Floats, enough: float
) -> tuple[Floats, float]:
    """Return a place (n,) in the unit cube and the greatest of some functions there.

    No step within a shrinking box about it makes the greatest smaller, as far as the planes
    through the functions at all places tried tell (the cutting-plane method with a trust
    region; Schramm and Zowe 1992). Planes that functions bend away from are moved down.

    Parameters
    ----------
    parts
        Functions, and limits that are to stay <= 0, with gradients; None where there are
        none. A gradient at a kink is that of one side.
    x
        (n,) where to begin; limits that are missed there may be missed as much.
    enough
        The descent ends where planes promise less.
    """
    begun = parts(x)
    if begun is None:
        return x, np.inf
    now = float(np.max(begun[0]))
    allowed = np.maximum(begun[2], 0.0)
    places, made, radius = [x], [begun], FIRST
    for _ in range(MOST_STEPS):
        step, promised = _step(places, made, x, now, allowed, radius)
        if promised < enough and radius <= FIRST * 1e-2:
            break
        tried = np.clip(x + step, 0.0, 1.0)
        there = parts(tried) if promised > 0.0 else None
        if there is not None:
            places.append(tried)
            made.append(there)
            value = float(np.max(there[0]))
            if now - value >= SERIOUS * promised and np.all(there[2] <= allowed):
                x, now, radius = tried, value, min(2.0 * radius, LONGEST)
                continue
        radius *= 0.5
        if radius < SHORTEST:
            break
        near = [
            k
            for k, place in enumerate(places)
            if np.max(np.abs(place - x)) <= NEAR * radius
        ][-KEPT:]
        places, made = [places[k] for k in near], [made[k] for k in near]
    return x, now


def _step(
    places: list[Floats],
    made: list[Parts],
    x: Floats,
    now: float,
    allowed: Floats,
    radius: float,
) -> tuple[Floats, float]:
    """Return the step (n,) that planes promise most of, and how much."""
    from scipy.optimize import linprog

    n = len(x)
    planes, right = [], []
    for place, (values, gradients, limits, slopes) in zip(places, made, strict=True):
        away = x - place
        at_x = np.minimum(values + gradients @ away, now)
        planes.append(np.column_stack([gradients, -np.ones(len(values))]))
        right.append(now - at_x)
        # A limit that bends is met with room, as much as the step promises.
        at_x = np.minimum(limits + slopes @ away, allowed)
        planes.append(np.column_stack([slopes, -np.full(len(limits), ROOM)]))
        right.append(allowed - at_x)
    low, high = np.maximum(-radius, -x), np.minimum(radius, 1.0 - x)
    bounds = [*zip(low, high, strict=True), (None, 0.0)]
    result = linprog(
        np.append(np.zeros(n), 1.0),
        A_ub=np.vstack(planes),
        b_ub=np.concatenate(right),
        bounds=bounds,
        method="highs",
    )
    if result.x is None:
        return np.zeros(n), 0.0
    return result.x[:n], float(-result.x[n])


STEPS = 50
"""Most steps of a descent by quadratic programming."""
SLACK = 1e-9
"""A condition that is missed by less, of its size, holds."""


@final
class FigureGradients:
    """The figures of an evaluator with their derivatives by its variables.

    Of the least and the greatest value it is the derivative at the sample where that is.
    """

    def __init__(self, evaluator: Evaluator) -> None:
        self.evaluator, figures = evaluator, evaluator.figures
        terms = evaluator.varied.terms()
        self._kernel = design_kernel(terms, figures.columns, gradients=True)
        names = [*figures.sample, *figures.columns]
        self._functions = [with_derivatives(item, names) for item in figures.expressions]

    def at(self, values: Floats, mode: HeldMode) -> tuple[Floats, Floats, float]:
        """Return figures (m,), gradients (m, variables), and the share that closes.

        Values (variables,) are in the file's units, and derivatives by them; figures are in
        rad and SI, NaN where there is no such design, or the mode cannot be followed to it.
        """
        of = self.evaluator.figures
        figures = np.full(len(of.merits), np.nan)
        gradients = np.full((len(of.merits), len(values)), np.nan)
        design = self.evaluator.varied.design_at(values)
        if design is None:
            return figures, gradients, 0.0
        closed, quantities, changes = self._rows(design, mode)
        for k, merit in enumerate(of.merits):
            rows = of.rows_of(merit)
            figures[k], gradients[k] = self._reduced(
                merit, k, quantities[:, rows], changes[:, :, rows], closed[rows]
            )
        return figures, gradients, float(np.mean(closed[: len(of.samples.rows)]))

    def _turns(self, design: DesignAt, places: Floats) -> Floats:
        """Return the turns (pairs, n), rad, at samples and points."""
        kernel, evaluator = self._kernel, self.evaluator
        if kernel.closed_form:
            prepared = kernel.prepare(design.sizes[:, None])
            return evaluator.turns(kernel, prepared, places[:, 0].tolist())[:, :, 0]
        if not kernel.turning:
            return np.zeros((0, places.shape[1]))
        mechanism = evaluator.kernel_mechanism(design.values)
        return evaluator.turns_at(kernel, mechanism, places[:, :, None])[:, :, 0]

    def _rows(self, design: DesignAt, mode: HeldMode) -> tuple[Bools, Floats, Floats]:
        """Return who closes (n,), quantities (c, n) and derivatives (values, c, n).

        At samples, then at points.
        """
        kernel, samples = self._kernel, self.evaluator.figures.rows
        places = mode.places(design, len(samples))
        columns = None if design.profiles is None else design.profiles.columns(places.T)
        turns, sizes = self._turns(design, places), design.sizes[:, None]
        outputs = kernel.at(samples.T, places, sizes, columns, turns)
        whole = np.all(np.isfinite(places), axis=0)
        closed = np.all(outputs[: kernel.reaches] >= 0.0, axis=0) & whole
        first, width = len(self.evaluator.figures.sample), len(kernel.columns)
        made = outputs[kernel.reaches :].reshape(-1, width, len(samples))
        changes = np.zeros((len(design.values), first + width, len(samples)))
        changes[:, first:, whole] = design.by_values(made[1:, :, whole], places[:, whole].T)
        return closed, np.concatenate([samples.T, made[0]]), changes

    def _reduced(
        self,
        merit: Merit,
        k: int,
        quantities: Floats,
        changes: Floats,
        closed: Bools,
    ) -> tuple[float, Floats]:
        with np.errstate(all="ignore"):
            value, *partial = self._functions[k](np.ascontiguousarray(quantities))
        value, kind = np.where(closed, value, np.nan), merit.reduction
        of, column = self.evaluator.figures, value[:, None]
        figure = float(of.reduced(merit, column)[0])
        if not np.any(closed) or kind.startswith("arg"):
            return figure, np.full(len(changes), np.nan)
        share = np.zeros(len(value))  # of each row in the derivative
        if kind in ("mean", "sum", "at", "rms"):
            share[closed] = 1.0 if kind == "sum" else 1.0 / np.sum(closed)
            if kind == "rms":
                share[closed] *= value[closed] / max(figure, 1e-300)
        else:
            low, high = extremes(column)
            if kind == "swing":
                _, low, high = widest_swings(column, of.samples.returns)
            share[high] += kind != "min"
            share[low] += {"min": 1.0, "max": 0.0}.get(kind, -1.0)
        some = np.flatnonzero(share)
        by_columns = np.array(partial)[:, some]
        return figure, np.einsum(
            "cn,vcn,n->v", by_columns, changes[:, :, some], share[some]
        )


def with_derivatives(expression: Expression, names: Sequence[str]) -> ArrayFunction:
    """Return a function of named rows: the expression, then its derivative by each."""
    terms = symbols(names)
    named = {name: (x, x) for name, x in zip(names, terms, strict=True)}
    item = expression_terms(expression, named)
    partial = [derivatives([item], {term: 1.0})[0] for term in terms]
    return array_function([item, *partial], terms)


@final
class Descent:
    """Descents of a sizing in units of the ranges of its variables."""

    def __init__(self, sizing: Sizing) -> None:
        self.sizing = sizing
        sweep = self.sweep = sizing.sweep
        assert isinstance(sweep.evaluator, Evaluator)
        self.figures = FigureGradients(sweep.evaluator)
        self.low = np.array([variation.low for variation in sweep.space.variations])
        self.width = (
            np.array([variation.high for variation in sweep.space.variations]) - self.low
        )
        self.objectives = [self._differentiable(item) for item in sizing.objectives]
        conditions = [item for item in sweep.conditions if "closes" not in item.names]
        below = [item.sign.startswith("<") for item in conditions]
        self.signs = np.where(below, 1.0, -1.0)
        self.sides = [
            [self._differentiable(getattr(item, side)) for item in conditions]
            for side in ("left", "right")
        ]
        radians = DEG if sweep.angle == "deg" else 1.0
        quantities = row_quantities(sweep.mechanism)
        units = [merit.unit(quantities) == "rad" for merit in sweep.merits]
        self.figure_unit = np.where(units, radians, 1.0)
        self._last: tuple[tuple[bytes, HeldMode], Any] | None = None

    def _differentiable(self, expression: Expression) -> ArrayFunction:
        return with_derivatives(expression, self.sizing.names)

    def places(self, rows: Columns) -> Floats:
        """Return where rows of a sweep are (n, variables), in units of the ranges."""
        varied = [rows[variable.name] for variable in self.sweep.variables]
        return np.asarray((np.stack(varied, axis=1) - self.low) / self.width)

    def moved(self, x: Floats, mode: HeldMode) -> HeldMode:
        """Return a mode that is followed from x, where there is a design, from now on."""
        design = self.figures.evaluator.varied.design_at(self.low + self.width * x)
        return mode if design is None else mode.moved(design)

    def at(self, x: Floats, mode: HeldMode) -> tuple[Floats, Floats, float]:
        """Return varied numbers and figures (k,), their gradients by x, what closes."""
        key = x.tobytes(), mode
        if self._last is None or self._last[0] != key:
            values = self.low + self.width * x
            figures, slopes, closes = self.figures.at(values, mode)
            figures = figures / self.figure_unit
            slopes = slopes * self.width / self.figure_unit[:, None]
            columns = np.concatenate([values, figures])
            gradient = np.concatenate([np.diag(self.width), slopes])
            if self.sizing.matched:
                names = self.sizing.names
                rows = [names.index(name) for name in self.sizing.matched]
                missed = columns[rows]
                size = np.sqrt(np.mean(missed**2))
                slope = np.mean(missed[:, None] * gradient[rows], axis=0)
                columns = np.append(columns, size)
                gradient = np.vstack([gradient, slope / max(size, 1e-300)])
            self._last = key, (columns, gradient, closes)
        made: tuple[Floats, Floats, float] = self._last[1]
        return made

    def value(
        self, function: ArrayFunction, x: Floats, mode: HeldMode
    ) -> tuple[float, Floats]:
        """Return an expression of varied numbers and figures, and its gradient by x."""
        columns, gradient, _ = self.at(x, mode)
        values = function(columns[:, None])[:, 0]
        return float(values[0]), values[1:] @ np.nan_to_num(gradient)

    def wanted(self, x: Floats, mode: HeldMode) -> Floats:
        """Return the objectives (k,)."""
        return self._values(self.objectives, x, mode)[0]

    def _values(
        self, functions: Sequence[ArrayFunction], x: Floats, mode: HeldMode
    ) -> tuple[Floats, Floats]:
        """Return expressions (k,) and their gradients (k, variables)."""
        made = [self.value(function, x, mode) for function in functions]
        slopes = np.array([slope for _, slope in made]).reshape(-1, len(x))
        return np.array([value for value, _ in made]), slopes

    def _limits(self, x: Floats, mode: HeldMode) -> tuple[Floats, Floats]:
        """Return by how much conditions are missed (k,), < 0 where they hold; gradients."""
        left, right = (self._values(side, x, mode) for side in self.sides)
        return self.signs * (left[0] - right[0]), self.signs[:, None] * (left[1] - right[1])

    def go(self, x: Floats, mode: HeldMode) -> Floats:
        """Return where a descent of the first objective from x ends.

        The others may not grow (the epsilon-constraint method: Haimes, Lasdon and Wismer
        1971).
        """
        from scipy.optimize import minimize

        closes = self.at(x, mode)[2]
        first, *others = self.objectives
        bounds = self.wanted(x, mode)[1:]

        def objective(y: Floats) -> tuple[float, Floats]:
            value, slope = self.value(first, y, mode)
            if not np.isfinite(value):
                return 1e6, np.zeros_like(y)
            return value, slope

        def slack(y: Floats) -> Floats:
            closed, missed = self.at(y, mode)[2], self._limits(y, mode)[0]
            rest = bounds - self._values(others, y, mode)[0]
            made = np.concatenate([[closed - closes], -missed, rest])
            return np.asarray(np.nan_to_num(made, nan=-1e6))

        def slopes(y: Floats) -> Floats:
            by_limits, by_others = (
                self._limits(y, mode)[1],
                self._values(others, y, mode)[1],
            )
            return np.concatenate([np.zeros((1, len(y))), -by_limits, -by_others])

        result = minimize(  # type: ignore[call-overload]
            objective,
            x,
            jac=True,
            method="SLSQP",
            bounds=[(0.0, 1.0)] * len(x),
            constraints=[{"type": "ineq", "fun": slack, "jac": slopes}],
            options={"maxiter": STEPS, "ftol": 1e-14},
        )
        ends: Floats = np.clip(result.x, 0.0, 1.0)
        better = objective(ends)[0] <= objective(x)[0]
        holds = bool(np.all(slack(ends) >= -SLACK * (1.0 + np.abs(slack(x)))))
        return ends if better and holds else x

    def towards(
        self, x: Floats, mode: HeldMode, aim: Floats, size: Floats, enough: float
    ) -> tuple[Floats, float]:
        """Return where objectives come nearest to an aim (k,) from x, and by how much.

        By how many sizes (k,) the objective that misses its aim most does, < 0 where all
        are less: the scalarisation of Pascoletti and Serafini 1984. Where the aim is what
        the objectives are at x, this is a descent of all of them, and ends where nothing
        beside makes all smaller.
        """
        closes = self.at(x, mode)[2]

        def parts(y: Floats) -> Parts | None:
            if self.at(y, mode)[2] < closes:
                return None
            wanted, gradients = self._values(self.objectives, y, mode)
            made = (wanted - aim) / size, gradients / size[:, None], *self._limits(y, mode)
            return made if all(np.all(np.isfinite(part)) for part in made) else None

        return least_greatest(parts, x, enough)


BEATEN = 1e-6
"""Part of the width of each objective along a front by less than which none is beaten."""
ENOUGH = 0.1 * BEATEN
"""Part of it by less than which a descent goes on no more."""
ROUNDS = 12
"""Most times that a descent is taken up again."""
OTHERS = 3
"""Other starts from which a point is attacked, those that come nearest to beating it."""
BESIDE = 0.1
"""Starts nearer than this part of every range lead to the same place."""


@final
@dataclass(frozen=True)
class End:
    """Where a descent ended: mode, place in units of the ranges, objectives and figures."""

    mode: HeldMode
    x: Floats
    wanted: Floats
    columns: Floats


@final
class Settling:
    """Descents to where a sizing's objectives no longer fall.

    Parameters
    ----------
    descent
        The sizing's descents.
    modes, places, wanted
        Rows that are tried as other starts: modes (n,), places (n, variables) and
        objectives (n, k).
    """

    def __init__(
        self, descent: Descent, modes: Array, places: Floats, wanted: Floats
    ) -> None:
        self.descent = descent
        self.modes, self.places, self.wanted = modes, places, wanted
        widths = np.ptp(wanted, axis=0)
        several = (widths > 0.0) & (wanted.shape[1] > 1)
        least = np.min(np.abs(wanted), axis=0)
        self.size = np.where(several, widths, np.where(least > 0.0, least, 1.0))

    @property
    def tolerance(self) -> Floats:
        """By how much of each objective (k,) a design has to be better to beat another."""
        return BEATEN * self.size

    def down(self, mode: HeldMode, x: Floats) -> End:
        """Return where descents from x end for good, those of one objective and of all."""
        descent = self.descent
        for _ in range(ROUNDS):
            before = descent.wanted(x, mode)
            x = descent.go(x, mode)
            mode = descent.moved(x, mode)
            here = descent.wanted(x, mode)
            x, _ = descent.towards(x, mode, here, self.size, ENOUGH)
            mode = descent.moved(x, mode)
            gain = (before - descent.wanted(x, mode)) / self.size
            if not np.max(gain) > ENOUGH:
                break
        return self.here(mode, x)

    def here(self, mode: HeldMode, x: Floats) -> End:
        """Return a place as the end of a descent."""
        columns, _, _ = self.descent.at(x, mode)
        return End(mode, x, self.descent.wanted(x, mode), columns)

    def attacked(self, end: End, ends: Sequence[End]) -> End:
        """Return what is left where a design, also from other starts, beats an end."""
        for _ in range(ROUNDS):
            for start in self._others(end, ends):
                x, missed = self.descent.towards(
                    start, end.mode, end.wanted, self.size, ENOUGH
                )
                if missed < -BEATEN:
                    end = self.down(end.mode, x)
                    break
            else:
                break
        return end

    def _others(self, end: End, ends: Sequence[End]) -> Iterator[Floats]:
        """Yield places apart from an end, those that come nearest to beating it first."""
        rows = self.modes == end.mode.label
        others = [other for other in ends if other.mode.goes_on_in(end.mode)]
        places = np.concatenate([self.places[rows], *([other.x] for other in others)])
        wanted = np.concatenate([self.wanted[rows], *([other.wanted] for other in others)])
        missed = np.max((wanted - end.wanted) / self.size, axis=1)
        taken = [end.x]
        for k in np.argsort(missed, kind="stable"):
            if len(taken) > OTHERS:
                return
            if all(np.max(np.abs(places[k] - place)) >= BESIDE for place in taken):
                taken.append(places[k])
                yield places[k]


def unbeaten(ends: Sequence[End], tolerance: Floats) -> list[End]:
    """Return the ends that none of their mode beats within a tolerance (k,).

    One beats another that is less in an objective by more than the tolerance, and in
    none greater by more.
    """

    def beats(one: End, other: End) -> bool:
        less = other.wanted - one.wanted
        return bool(np.all(less >= -tolerance) and np.any(less > tolerance))

    return [
        end
        for end in ends
        if not any(other.mode.goes_on_in(end.mode) and beats(other, end) for other in ends)
    ]
