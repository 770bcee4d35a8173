"""Terms evaluated on NumPy arrays, in blocks that stay in the cache.

Each operation is one call for a whole block and writes into a row that is free by then,
so nothing is allocated on the way and intermediate values do not leave the cache.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from spherekit.engine.expression_graph import Expr, ExpressionNode, in_order

BLOCK = 8192
"""Columns evaluated together: enough that calls cost little, few enough for the cache."""

_OPERATORS = {
    "+": np.add,
    "-": np.subtract,
    "*": np.multiply,
    "/": np.divide,
    "**": np.power,
}


@final
@dataclass(frozen=True)
class _Step:
    """An operation: rows or numbers it reads, and the row it writes."""

    operation: Callable[..., Any]
    arguments: tuple[int, ...]
    result: int


@final
@dataclass(frozen=True)
class ArrayFunction:
    """A function of arrays (inputs, n) with values (outputs, n), made of NumPy's.

    The steps run on places: the inputs, the outputs, the numbers, then `rows` rows of a
    block for what is needed in between. `number` is the type computed with, `seconds` is
    what making it took.
    """

    inputs: int
    outputs: int
    numbers: tuple[float, ...]
    rows: int
    steps: tuple[_Step, ...]
    number: type[Any]
    seconds: float

    def __call__(self, inputs: NDArray[Any], out: NDArray[Any] | None = None) -> Any:
        """Return the values (outputs, n) at inputs (inputs, n), written to `out`."""
        count = inputs.shape[1]
        if out is None:
            out = np.empty((self.outputs, count), dtype=self.number)
        numbers = [np.array(number, dtype=self.number) for number in self.numbers]
        work = np.empty((self.rows, min(count, BLOCK)), dtype=self.number)
        with np.errstate(all="ignore"):
            for start in range(0, count, BLOCK):
                block = slice(start, min(start + BLOCK, count))
                places = [*inputs[:, block], *out[:, block], *numbers]
                places += [*work[:, : block.stop - block.start]]
                for step in self.steps:
                    given = [places[place] for place in step.arguments]
                    step.operation(*given, out=places[step.result])
        return out


def array_function(
    outputs: Sequence[Expr], inputs: Sequence[ExpressionNode], number: type[Any] = float
) -> ArrayFunction:
    """Return expressions as a function of arrays; `number` is the type computed with."""
    started = time.perf_counter()
    order = [term for term in in_order(outputs) if term.operation != "variable"]
    used = [item for term in order for item in term.arguments] + list(outputs)
    numbers = tuple(
        dict.fromkeys(float(x) for x in used if not isinstance(x, ExpressionNode))
    )
    places: dict[Any, int] = {term: k for k, term in enumerate(inputs)}
    for k, item in enumerate(outputs):
        if isinstance(item, ExpressionNode):
            places.setdefault(item, len(inputs) + k)
    first = len(inputs) + len(outputs)
    places |= {x: first + k for k, x in enumerate(numbers)}
    first += len(numbers)
    steps, rows = _steps(order, places, first)
    for k, item in enumerate(outputs):
        if places[item] != len(inputs) + k:
            steps.append(_Step(np.positive, (places[item],), len(inputs) + k))
    seconds = time.perf_counter() - started
    sizes = len(inputs), len(outputs)
    return ArrayFunction(*sizes, numbers, rows, tuple(steps), number, seconds)


def _steps(
    order: Sequence[ExpressionNode], places: dict[Any, int], first: int
) -> tuple[list[_Step], int]:
    """Return the steps that form terms, and how many rows from `first` on they need.

    A row is free again after the last step that reads it.
    """
    last = {item: k for k, term in enumerate(order) for item in term.arguments}
    free: list[int] = []
    rows = 0
    steps: list[_Step] = []
    for k, term in enumerate(order):
        given = tuple(places[item] for item in term.arguments)
        done = [x for x in dict.fromkeys(term.arguments) if last[x] == k]
        free += [places[item] for item in done if places[item] >= first]
        if term not in places:
            if not free:
                free.append(first + rows)
                rows += 1
            places[term] = free.pop()
        steps.append(_Step(_ufunc(term.operation), given, places[term]))
    return steps, rows


def _ufunc(operation: str) -> Callable[..., Any]:
    ufunc: Callable[..., Any] = _OPERATORS.get(operation) or getattr(np, operation)
    return ufunc
