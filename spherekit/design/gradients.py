"""Figures of merit of one design in one assembly mode, with exact gradients."""

from collections.abc import Sequence
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.merit import Merit
from spherekit.design.evaluate import Evaluator
from spherekit.design.held_modes import HeldMode
from spherekit.design.varied import DesignAt
from spherekit.engine.arrays import ArrayFunction, array_function
from spherekit.engine.derivatives import derivatives
from spherekit.engine.design_kernel import design_kernel
from spherekit.engine.expression_graph import symbols
from spherekit.engine.expression_terms import expression_terms
from spherekit.model.expression import Expression
from spherekit.numeric.turns import widest_swing
from spherekit.sphere.rotation import Floats


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
        count, inputs = len(of.samples.rows), len(self.evaluator.inputs)
        at_samples = np.arange(len(closed)) < count
        for k, merit in enumerate(of.merits):
            rows = at_samples
            if merit.point:
                rows = ~at_samples & np.all(of.rows[:, :inputs] == merit.point, axis=1)
            rows = closed & rows
            if np.any(rows):
                figures[k], by_values = self._reduced(merit, k, quantities, changes, rows)
                gradients[k] = by_values
        return figures, gradients, float(np.mean(closed[:count]))

    def _turns(self, design: DesignAt, places: Floats) -> Floats:
        """Return the turns (pairs, n), rad, at samples and points."""
        kernel, evaluator = self._kernel, self.evaluator
        if kernel.closed_form:
            prepared = kernel.prepare(design.sizes[:, None])
            return evaluator.turns(kernel, prepared, places[:, 0].tolist())[:, :, 0]
        if not kernel.turning:
            return np.zeros((0, places.shape[1]))
        return evaluator.turns_at(kernel, design.values, places[:, :, None])[:, :, 0]

    def _rows(
        self, design: DesignAt, mode: HeldMode
    ) -> tuple[NDArray[np.bool_], Floats, Floats]:
        """Return who closes (n,), quantities (c, n) and derivatives (values, c, n).

        At samples, then at points.
        """
        kernel, samples = self._kernel, self.evaluator.figures.rows
        places = mode.places(design, len(samples))
        parts = [samples.T, places]
        if design.profiles is not None:
            parts.append(design.profiles.columns(places.T))
        prepared = kernel.prepare(design.sizes[:, None])
        parts += [self._turns(design, places), np.repeat(prepared, len(samples), axis=1)]
        with np.errstate(all="ignore"):
            outputs = kernel.evaluate(np.concatenate(parts))
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
        closed: NDArray[np.bool_],
    ) -> tuple[float, Floats]:
        quantities, changes = quantities[:, closed], changes[:, :, closed]
        both = self._functions[k](np.ascontiguousarray(quantities))
        value, partial = both[0], both[1:]
        slope = np.einsum("cn,vcn->vn", partial, changes)
        match merit.reduction:
            case "swing":
                count = len(self.evaluator.samples.rows)
                samples = np.full(count, np.nan)
                samples[closed[:count]] = value
                returns = self.evaluator.samples.returns
                swing, low, high = widest_swing(samples, returns)
                low, high = (int(np.sum(closed[:end])) for end in (low, high))
                return swing, slope[:, high] - slope[:, low]
            case "min" | "max":
                place = int(np.argmin(value if merit.reduction == "min" else -value))
                return float(value[place]), slope[:, place]
            case "range":
                low, high = int(np.argmin(value)), int(np.argmax(value))
                return float(value[high] - value[low]), slope[:, high] - slope[:, low]
            case "mean" | "sum" | "at":
                share = 1.0 if merit.reduction == "sum" else 1.0 / len(value)
                return float(share * np.sum(value)), share * np.sum(slope, axis=1)
            case "rms":
                size = float(np.sqrt(np.mean(value * value)))
                return size, np.mean(value * slope, axis=1) / max(size, 1e-300)
        place = int(np.argmin(value if merit.reduction == "argmin" else -value))
        number = self.evaluator.inputs.index(merit.place) if merit.place else 0
        return float(quantities[number, place]), np.full(len(slope), np.nan)


def with_derivatives(expression: Expression, names: Sequence[str]) -> ArrayFunction:
    """Return a function of named rows: the expression, then its derivative by each."""
    terms = symbols(names)
    item = expression_terms(expression, dict(zip(names, terms, strict=True)))
    partial = [derivatives([item], term)[0] for term in terms]
    return array_function([item, *partial], terms)
