"""Descents of sizings by exact gradients."""

from typing import Any, final

import numpy as np

from spherekit.design.conditions import Condition
from spherekit.design.cutting_planes import Parts, least_greatest
from spherekit.design.evaluate import Evaluator
from spherekit.design.gradients import FigureGradients, with_derivatives
from spherekit.design.held_modes import HeldMode
from spherekit.design.sweep import Columns
from spherekit.design.varied import DEG
from spherekit.design.wanted import Sizing
from spherekit.engine.arrays import ArrayFunction
from spherekit.engine.row_quantities import row_quantities
from spherekit.sphere.rotation import Floats

STEPS = 50
"""Most steps of a descent by quadratic programming."""
SLACK = 1e-9
"""A condition that is missed by less, of its size, holds."""


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
        self.objectives = [
            with_derivatives(objective, sizing.names) for objective in sizing.objectives
        ]
        self.conditions = [
            (condition, self._slack(condition))
            for condition in sweep.conditions
            if "closes" not in condition.names
        ]
        radians = DEG if sweep.angle == "deg" else 1.0
        quantities = row_quantities(sweep.mechanism)
        units = [merit.unit(quantities) == "rad" for merit in sweep.merits]
        self.figure_unit = np.where(units, radians, 1.0)
        self._last: tuple[tuple[bytes, HeldMode], Any] | None = None

    def _slack(self, condition: Condition) -> tuple[ArrayFunction, ArrayFunction]:
        return tuple(  # type: ignore[return-value]
            with_derivatives(side, self.sizing.names)
            for side in (condition.left, condition.right)
        )

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
        return np.array(
            [self.value(objective, x, mode)[0] for objective in self.objectives]
        )

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
            made = [self.at(y, mode)[2] - closes]
            for condition, (left, right) in self.conditions:
                sense = 1.0 if condition.sign.startswith("<") else -1.0
                ends = [self.value(side, y, mode)[0] for side in (right, left)]
                made.append(sense * (ends[0] - ends[1]))
            for other, bound in zip(others, bounds, strict=True):
                made.append(bound - self.value(other, y, mode)[0])
            return np.asarray(np.nan_to_num(np.array(made), nan=-1e6))

        def slopes(y: Floats) -> Floats:
            made = [np.zeros_like(y)]
            for condition, (left, right) in self.conditions:
                sense = 1.0 if condition.sign.startswith("<") else -1.0
                ends = [self.value(side, y, mode)[1] for side in (right, left)]
                made.append(sense * (ends[0] - ends[1]))
            made += [-self.value(other, y, mode)[1] for other in others]
            return np.array(made)

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
            wanted = [self.value(objective, y, mode) for objective in self.objectives]
            limits = []
            for condition, sides in self.conditions:
                left, right = (self.value(side, y, mode) for side in sides)
                sense = 1.0 if condition.sign.startswith("<") else -1.0
                limits.append((sense * (left[0] - right[0]), sense * (left[1] - right[1])))
            missed = (np.array([value for value, _ in wanted]) - aim) / size
            made = (
                missed,
                np.array([slope for _, slope in wanted]) / size[:, None],
                np.array([value for value, _ in limits]),
                np.array([slope for _, slope in limits]).reshape(-1, len(y)),
            )
            return made if all(np.all(np.isfinite(part)) for part in made) else None

        return least_greatest(parts, x, enough)
