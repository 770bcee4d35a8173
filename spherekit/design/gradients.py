"""Figures of merit of one design in one assembly mode, with exact gradients."""

from collections.abc import Sequence
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.analysis.merit import Merit
from spherekit.design.evaluate import DesignAt, Evaluator
from spherekit.design.held_modes import HeldMode
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
        self.evaluator = evaluator
        terms = evaluator.terms()
        self._kernel = design_kernel(terms, evaluator.figures.columns, gradients=True)
        names = [*evaluator.figures.sample, *evaluator.figures.columns]
        self._functions = [
            with_derivatives(expression, names)
            for expression in evaluator.figures.expressions
        ]

    def at(self, values: Floats, mode: HeldMode) -> tuple[Floats, Floats, float]:
        """Return figures (m,), gradients (m, variables), and the share that closes.

        Values (variables,) are in the file's units, and derivatives by them; figures are in
        rad and SI, NaN where there is no such design, or the mode cannot be followed to it.
        """
        merits = self.evaluator.merits
        figures = np.full(len(merits), np.nan)
        gradients = np.full((len(merits), len(values)), np.nan)
        evaluator = self.evaluator
        design = evaluator.design_at(values)
        if design is None:
            return figures, gradients, 0.0
        samples, points = evaluator.samples.rows, evaluator.figures.points()
        places, k = mode.places(design, len(samples) + len(points)), len(samples)
        turns = self._turns(design, places)
        every = self._rows(design, places[:, :k], samples, turns[:, :k])
        there = every
        if len(points):
            there = self._rows(design, places[:, k:], points, turns[:, k:])
        for k, merit in enumerate(merits):
            closed, quantities, changes = there if merit.point else every
            if merit.point:
                there_at = points[:, : len(merit.point)]
                closed = closed & np.all(there_at == merit.point, axis=1)
            if np.any(closed):
                figures[k], by_values = self._reduced(merit, k, quantities, changes, closed)
                gradients[k] = by_values
        return figures, gradients, float(np.mean(every[0]))

    def _turns(self, design: DesignAt, places: Floats) -> Floats:
        """Return the turns (pairs, n), rad, at samples and points."""
        kernel, evaluator = self._kernel, self.evaluator
        if kernel.closed_form:
            prepared = kernel.prepare(design.sizes[:, None])
            both = evaluator.turns(kernel, prepared, places[:, 0].tolist())
            return np.concatenate(both, axis=1)[:, :, 0]
        if not kernel.turning:
            return np.zeros((0, places.shape[1]))
        return evaluator.turns_at(kernel, design.values, places[:, :, None])[:, :, 0]

    def _rows(
        self,
        design: DesignAt,
        places: Floats,
        samples: Floats,
        turns: Floats,
    ) -> tuple[NDArray[np.bool_], Floats, Floats]:
        """Return who closes (n,), quantities (c, n) and derivatives (values, c, n)."""
        kernel, count = self._kernel, len(design.sizes)
        prepared = kernel.prepare(design.sizes[:, None])
        fixed = [turns, np.repeat(prepared, len(samples), axis=1)]
        whole = np.all(np.isfinite(places), axis=0)
        placed = [places]
        if design.profiles is not None:
            columns = np.full((9 * len(design.profiles.tracks), len(samples)), np.nan)
            columns[:, whole] = design.profiles.columns(places[:, whole].T)
            placed.append(columns)
        with np.errstate(all="ignore"):
            outputs = kernel.evaluate(np.concatenate([samples.T, *placed, *fixed]))
        closed = np.all(outputs[: kernel.reaches] >= 0.0, axis=0)
        closed &= whole
        first, width = len(self.evaluator.figures.sample), len(kernel.columns)
        made = outputs[kernel.reaches :].reshape(-1, width, len(samples))
        quantities = np.concatenate([samples.T, made[0]])
        changes = np.zeros((design.slopes.shape[1], first + width, len(samples)))
        by_sizes = made[1 : count + 1]
        changes[:, first:] = np.tensordot(design.slopes.T, by_sizes, 1)
        if design.profiles is not None:
            by_columns = made[count + 1 :][:, :, whole]
            slopes = design.profiles.slopes(places[:, whole].T)
            changes[:, first:, whole] += np.einsum("kpn,pcn->kcn", slopes, by_columns)
        return closed, quantities, changes

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
                samples = np.full(len(closed), np.nan)
                samples[closed] = value
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
