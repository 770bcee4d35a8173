"""The closure equations of designs at any input, real or complex.

Sizes are real. The variables, the inputs among them, may be complex: the equations are
analytic, and off the real axis their solutions neither meet nor vanish.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from spherekit.engine.algebra import cross, dot
from spherekit.engine.arrays import ArrayFunction, array_function
from spherekit.engine.compiler import CompiledFunction, available, compile_function
from spherekit.engine.complex_terms import compile_complex
from spherekit.engine.design_kernel import DesignTerms
from spherekit.engine.expression_graph import Expr, ExpressionNode, hoisted
from spherekit.engine.misfits import answers, misfits, openness, rates_by_inputs
from spherekit.engine.pose import spin_vectors
from spherekit.sphere.rotation import Floats

Numbers = NDArray[Any]
"""An array of real or complex numbers."""


@final
@dataclass(frozen=True)
class At:
    """Equations at n places: Newton's `step` (variables, n) and the `rates` by the inputs.

    `rates` (inputs, variables, n), `determinant` (n,) of the equations, `open` (n,) the
    square of how far loops are open.
    """

    step: Numbers
    rates: Numbers
    determinant: Numbers
    open: Numbers


@final
@dataclass(frozen=True)
class PathKernel:
    """Newton's step and the rates of a topology whose sizes are inputs.

    `prepare` takes the sizes (sizes, n) to what is the same at all samples of a design,
    `real` and `complex` variables and these to `At`; `turning` to the triple products that
    dyads are named by, `groups` has ``+`` for each of them and ``~`` for other groups.
    """

    variables: int
    driven: list[int]
    prepare: ArrayFunction
    real: ArrayFunction | CompiledFunction
    complex: Callable[[Numbers, Floats], Numbers]
    groups: str
    turning: ArrayFunction

    def labels(self, values: Floats, prepared: Floats) -> list[str]:
        """Return the signs of dyads, ``~`` for other groups, at closed configurations."""
        rows = np.concatenate([values, prepared])
        signs = iter(np.where(self.turning(rows) >= 0.0, "+", "-"))
        columns = [next(signs) if g == "+" else None for g in self.groups]
        width = values.shape[1]
        return [
            "".join("~" if column is None else str(column[k]) for column in columns)
            for k in range(width)
        ]

    def at(self, values: Numbers, prepared: Floats) -> At:
        """Return what the equations are at values (variables, n) and prepared (k, n)."""
        if np.iscomplexobj(values):
            columns = self.complex(values, prepared)
        else:
            columns = self.real(np.concatenate([values, prepared]))
        v, k = self.variables, len(self.driven)
        rates = columns[v : (k + 1) * v].reshape(k, v, -1)
        return At(columns[:v], rates, columns[-2], columns[-1])


def _on_arrays(
    outputs: Sequence[Expr],
    variables: Sequence[ExpressionNode],
    numbers: Sequence[ExpressionNode],
) -> Callable[[Numbers, Floats], Numbers]:
    made = array_function(outputs, [*variables, *numbers], complex)

    def at(values: Numbers, prepared: Floats) -> Numbers:
        return np.asarray(made(np.concatenate([values, prepared.astype(complex)])))

    return at


def path_kernel(terms: DesignTerms, compiled: bool = True) -> PathKernel:
    """Return the kernel; `terms` are of variables, not of signs."""
    structure, links, places = terms.structure, terms.links, terms.places
    change = answers(structure, links, misfits(structure, links, terms.variables))
    for variable, angle in enumerate(terms.variables):
        if angle is not places[variable]:
            change[variable] = angle - places[variable]
    rates, determinant = rates_by_inputs(structure, links)
    outputs = [*change, *(rate for row in rates for rate in row), determinant]
    outputs.append(openness(structure, links, terms.variables))
    dyads = [group for group in structure.assembly.groups if group.is_dyad]
    turning = []
    for group in dyads:
        axes = []
        for pair in group.pairs:
            (variable,) = structure.mechanism.variables_of(pair)
            (spin,) = spin_vectors(structure.pairs, links, variable)
            axes.append(spin.axis)
        turning.append(dot(axes[0], cross(axes[1], axes[2])))
    rows, fixed = hoisted([*outputs, *turning], places, "design_")
    rows, turning = rows[: len(outputs)], rows[len(outputs) :]
    inputs = [*places, *fixed]
    compiles = compiled and available()
    make = compile_function if compiles else array_function
    off_axis = compile_complex if compiles else _on_arrays
    return PathKernel(
        len(places),
        list(structure.inputs),
        array_function(list(fixed.values()), terms.sizes),
        make(rows, inputs),
        off_axis(rows, places, list(fixed)),
        "".join("+" if group.is_dyad else "~" for group in structure.assembly.groups),
        array_function(turning, inputs),
    )
