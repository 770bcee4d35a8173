"""Terms: expressions as a graph in which what occurs twice is one node.

The engine writes a mechanism's kinematics and loads in terms. `spherekit.symbolic.compiler`
gives them to heyoka; here they are evaluated on floats and on NumPy arrays.

Arrays are gone through in blocks that stay in the cache. Each operation is one call for a
whole block and writes into a row that is free by then, so nothing is allocated on the way
and intermediate values do not leave the cache.
"""

import math
import operator
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, reduce
from itertools import count
from typing import Any
from weakref import WeakValueDictionary

import numpy as np

from spherekit.arrays import Array
from spherekit.errors import EngineError
from spherekit.mechanism.load_expression import Expression, fold

Expr = Any
"""A number or a term."""

WITHOUT_EXPRESSIONS = 'use NumPy\'s simulate(engine="numpy") or engine.fields.evaluate'
"""What to ask for where a mechanism cannot be written in terms."""


def _negated(item: Expr) -> Expr | None:
    """Return x of a term -1 * x, else None."""
    if (
        isinstance(item, ExpressionNode)
        and item.operation == "*"
        and item.arguments[0] == -1.0
    ):
        return item.arguments[1]
    return None


def _sum(a: Expr, b: Expr) -> Expr:
    for one, other in ((a, b), (b, a)):
        if one == 0.0:
            return other
        opposite = _negated(other)
        if opposite is not None:
            return _difference(one, opposite)
    return function("+", *_ordered(a, b))


def _difference(a: Expr, b: Expr) -> Expr:
    if a is b:
        return 0.0
    if b == 0.0:
        return a
    if a == 0.0:
        return _product(-1.0, b)
    opposite = _negated(b)
    return function("-", a, b) if opposite is None else _sum(a, opposite)


def _product(a: Expr, b: Expr) -> Expr:
    for one, other in ((a, b), (b, a)):
        if one == 0.0:
            return 0.0
        if one == 1.0:
            return other
        opposite = _negated(other)
        if opposite is not None:
            if isinstance(one, ExpressionNode):
                return _product(-1.0, _product(one, opposite))
            return _product(-one, opposite)
    return function("*", *_ordered(a, b))


def _quotient(a: Expr, b: Expr) -> Expr:
    if a == 0.0 or b == 1.0:
        return a
    return function("/", a, b)


def _ordered(a: Expr, b: Expr) -> list[Expr]:
    """Return the arguments of a sum or product in one order: numbers first, then by age."""
    return sorted((a, b), key=lambda x: x.number if isinstance(x, ExpressionNode) else -1)


_Operation = Callable[[Any, Any], Expr]


def _operators(made: _Operation) -> tuple[_Operation, _Operation]:
    """Return an operation and its reverse, for terms and numbers alone."""

    def forward(one: Any, other: Any) -> Expr:
        return made(one, other) if isinstance(other, _OWN) else NotImplemented

    def backward(one: Any, other: Any) -> Expr:
        return made(other, one) if isinstance(other, _OWN) else NotImplemented

    return forward, backward


class ExpressionNode:
    """A variable, or an operation on terms and numbers.

    `operation` is ``variable``, one of ``+ - * / **`` or the name of a function. Equal
    terms are the same object. Products with 0 and 1, sums with 0 and x - x are carried
    out as terms are made, and signs are moved outwards; the value remains the same to
    the last bit, except that what is not finite is 0 when times 0 and when less itself.
    """

    __slots__ = ("__weakref__", "arguments", "number", "operation")

    operation: str
    arguments: tuple[Any, ...]
    number: int

    __add__, __radd__ = _operators(_sum)
    __sub__, __rsub__ = _operators(_difference)
    __mul__, __rmul__ = _operators(_product)
    __truediv__, __rtruediv__ = _operators(_quotient)

    def __neg__(self) -> Expr:
        return _product(-1.0, self)

    # NumPy's functions call these on arrays of objects.

    def sin(self) -> "ExpressionNode":
        """Return the sine."""
        return function("sin", self)

    def cos(self) -> "ExpressionNode":
        """Return the cosine."""
        return function("cos", self)

    def sqrt(self) -> "ExpressionNode":
        """Return the square root."""
        return function("sqrt", self)


_OWN = (ExpressionNode, float, int)
_known: WeakValueDictionary[tuple[Any, ...], ExpressionNode] = WeakValueDictionary()
_numbers = count()


def function(operation: str, *arguments: Any) -> ExpressionNode:
    """Return the operation or function of this name applied to terms or numbers."""
    # Numbers stand in the key by their text, for 0.0 and -0.0 are equal.
    key = (operation, *(x if isinstance(x, ExpressionNode) else repr(x) for x in arguments))
    node = _known.get(key)
    if node is None:
        node = ExpressionNode()
        node.operation, node.arguments = operation, arguments
        node.number = next(_numbers)
        _known[key] = node
    return node


def symbols(names: Iterable[str]) -> list[ExpressionNode]:
    """Return one variable for each name; the same name is the same variable."""
    return [function("variable", name) for name in names]


def power(base: Expr, exponent: Expr) -> ExpressionNode:
    """Return base ** exponent."""
    return function("**", base, exponent)


def dot(a: Iterable[Any], b: Iterable[Expr]) -> Any:
    """Return a . b, the sum of products; those of vectors with numbers or terms too."""
    return sum((x * y for x, y in zip(a, b, strict=True)), 0.0)


def vector_product(operation: str, a: Expr, b: Expr) -> Expr:
    """Return the ``dot`` or ``cross`` product of terms that stand for vectors."""
    if 0.0 in (a, b):
        return 0.0
    for k, opposite in enumerate((_negated(a), _negated(b))):
        if opposite is not None:
            sides = (opposite, b) if k == 0 else (a, opposite)
            return -1.0 * vector_product(operation, *sides)
    return function(operation, a, b)


def varies(item: Expr) -> bool:
    """Return whether an expression has variables in it."""
    return any(node.operation == "variable" for node in in_order([item]))


def in_order(items: Sequence[Expr]) -> Iterator[ExpressionNode]:
    """Yield each term that expressions consist of once, after its arguments."""
    done: set[ExpressionNode] = set()
    stack = [(item, False) for item in reversed(items)]
    while stack:
        term, ready = stack.pop()
        if not isinstance(term, ExpressionNode) or term in done:
            continue
        if ready or term.operation == "variable":
            done.add(term)
            yield term
            continue
        stack.append((term, True))
        stack += [(argument, False) for argument in reversed(term.arguments)]


def rewrite(
    items: Sequence[Expr],
    number: Callable[[float], Any],
    apply: Callable[[ExpressionNode, list[Any]], Any],
) -> list[Any]:
    """Return expressions in another form, from their numbers and operations."""
    made: dict[ExpressionNode, Any] = {}

    def of(item: Expr) -> Any:
        return made[item] if isinstance(item, ExpressionNode) else number(float(item))

    for term in in_order(items):
        arguments = [] if term.operation == "variable" else [of(x) for x in term.arguments]
        made[term] = apply(term, arguments)
    return [of(item) for item in items]


def substituted(items: Sequence[Expr], terms: Mapping[ExpressionNode, Expr]) -> list[Expr]:
    """Return expressions in which other terms stand for some of their terms."""
    made = {"+": _sum, "-": _difference, "*": _product, "/": _quotient}

    def apply(term: ExpressionNode, arguments: list[Any]) -> Expr:
        if term in terms or term.operation == "variable":
            return terms.get(term, term)
        if term.operation in made:
            return made[term.operation](*arguments)
        return function(term.operation, *arguments)

    return rewrite(items, float, apply)


def hoisted(
    items: Sequence[Expr], moving: Iterable[ExpressionNode]
) -> tuple[list[Expr], dict[ExpressionNode, ExpressionNode]]:
    """Return expressions in which what does not depend on `moving` is a variable.

    The variables, named by numbers, come with the terms that they stand for.
    """
    moves = set(moving)
    order = list(in_order(items))
    for term in order:
        if any(x in moves for x in term.arguments if isinstance(x, ExpressionNode)):
            moves.add(term)
    used = [item for term in order if term in moves for item in term.arguments]
    still = (x for x in (*used, *items) if isinstance(x, ExpressionNode) and x not in moves)
    fixed = dict.fromkeys(still)
    new = symbols(f"design_{k}" for k in range(len(fixed)))
    made = substituted(items, dict(zip(fixed, new, strict=True)))
    return made, dict(zip(new, fixed, strict=True))


_Chain = Callable[[ExpressionNode, Sequence[Expr], Sequence[Expr]], Expr]
"""The derivative of a node from its arguments and their derivatives."""


def _power_rate(node: ExpressionNode, x: Sequence[Expr], dx: Sequence[Expr]) -> Expr:
    base, exponent = x
    total: Expr = exponent * power(base, exponent - 1.0) * dx[0]
    if dx[1] != 0.0:
        total = total + node * function("log", base) * dx[1]
    return total


def _vector_rate(node: ExpressionNode, x: Sequence[Expr], dx: Sequence[Expr]) -> Expr:
    first = vector_product(node.operation, dx[0], x[1])
    return first + vector_product(node.operation, x[0], dx[1])


_DERIVATIVES: Mapping[str, _Chain] = {
    "+": lambda node, x, dx: dx[0] + dx[1],
    "-": lambda node, x, dx: dx[0] - dx[1],
    "*": lambda node, x, dx: dx[0] * x[1] + x[0] * dx[1],
    "/": lambda node, x, dx: (dx[0] - node * dx[1]) / x[1],
    "**": _power_rate,
    "sin": lambda node, x, dx: function("cos", x[0]) * dx[0],
    "cos": lambda node, x, dx: -1.0 * (function("sin", x[0]) * dx[0]),
    "tan": lambda node, x, dx: (1.0 + node * node) * dx[0],
    "asin": lambda node, x, dx: dx[0] / function("sqrt", 1.0 - x[0] * x[0]),
    "acos": lambda node, x, dx: -1.0 * dx[0] / function("sqrt", 1.0 - x[0] * x[0]),
    "atan": lambda node, x, dx: dx[0] / (1.0 + x[0] * x[0]),
    "atan2": lambda node, x, dx: (
        (x[1] * dx[0] - x[0] * dx[1]) / (x[0] * x[0] + x[1] * x[1])
    ),
    "sqrt": lambda node, x, dx: 0.5 * dx[0] / node,
    "exp": lambda node, x, dx: node * dx[0],
    "log": lambda node, x, dx: dx[0] / x[0],
    "tanh": lambda node, x, dx: (1.0 - node * node) * dx[0],
    "dot": _vector_rate,
    "cross": _vector_rate,
    "norm": lambda node, x, dx: vector_product("dot", x[0], dx[0]) / node,
    "sign": lambda node, x, dx: 0.0,
    "maximum": lambda node, x, dx: (
        0.5 * (dx[0] + dx[1] + sign_of(x[0] - x[1]) * (dx[0] - dx[1]))
    ),
}


def derivatives(items: Sequence[Expr], rates: Mapping[ExpressionNode, Expr]) -> list[Expr]:
    """Return how expressions change while terms change at these rates; others rest.

    Terms may be variables or what expressions are made of. Kinks and jumps have the
    derivative of the side they are on.
    """
    # Signs move outwards, so a term may occur as the opposite of one with a rate.
    slopes: dict[Any, Expr] = {_negated(x): -1.0 * rate for x, rate in rates.items()}
    slopes |= rates

    def apply(node: ExpressionNode, changes: list[Expr]) -> Expr:
        if node in slopes or not any(changes):
            return slopes.get(node, 0.0)
        return _DERIVATIVES[node.operation](node, node.arguments, changes)

    return rewrite(items, lambda _: 0.0, apply)


OPERATORS: Mapping[str, _Operation] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
}

_PERIODIC = ("sin", "cos", "tan")

_COUNTS_TURNS = ("+", "-", "negative")


def sign_of(item: Expr) -> Expr:
    """Return the sign of an expression as a function."""
    return function("sign", item)


def expression_terms(
    expression: Expression,
    named: Mapping[str, tuple[Expr, Expr]],
    sign: Callable[[Expr], Expr] | None = None,
) -> Expr:
    """Return an expression in terms, from those of its names.

    Each name has two terms, of which the second differs by whole turns at most: beside each
    part stands one formed of these, and sines and the like are taken of that. After many
    turns it is the more accurate one. `sign` gives the sign of what may be positive or
    negative where the expression is not smooth; by default functions of it are taken.
    """

    def larger(one: Expr, other: Expr) -> Expr:
        if sign is None:
            return function("maximum", one, other)
        gap = one - other
        return 0.5 * (one + other + sign(gap) * gap)

    signed = sign or sign_of
    made: Mapping[str, Callable[..., Expr]] = {
        **OPERATORS,
        "**": power,
        "negative": lambda a: -1.0 * a,
        "abs": lambda a: signed(a) * a,
        "sign": signed,
        "max": lambda *items: reduce(larger, items),
        "min": lambda *items: -1.0 * reduce(larger, (-1.0 * item for item in items)),
    }

    def apply(name: str, parts: list[tuple[Expr, Expr]]) -> tuple[Expr, Expr]:
        whole, reduced = zip(*parts, strict=True)
        if name == "/" and whole[1] == 0.0:
            what = f'"{expression.text}"' if expression.text else "a load"
            raise EngineError(f"{what} divides by what is zero everywhere")
        given = reduced if name in _PERIODIC else whole
        value = made[name](*given) if name in made else function(name, *given)
        counts = name == "*" and any(isinstance(x, float) and x % 1.0 == 0.0 for x in whole)
        if name in _COUNTS_TURNS or counts:
            return value, made[name](*reduced)
        return value, value

    root = expression.root
    value: Expr = fold(root, lambda x: (x, x), named.__getitem__, apply)[0]
    return value


BLOCK = 8192
"""Columns evaluated together: enough that calls cost little, few enough for the cache."""

_UFUNCS = {
    "+": "add",
    "-": "subtract",
    "*": "multiply",
    "/": "divide",
    "**": "power",
}

_INFIX = (*OPERATORS, "positive")
"""Operations that are written between their arguments, which are floats."""

TermFunction = Callable[..., Array]
"""A function of arrays (inputs, n) with values (outputs, n), written to a second array if
one is given."""

FloatFunction = Callable[[Sequence[float]], list[float]]


def array_function(
    outputs: Sequence[Expr], inputs: Sequence[ExpressionNode], number: type[Any] = float
) -> TermFunction:
    """Return expressions as a function of arrays.

    It computes with the type of what it is given, if that has more digits than `number`.
    The operations are a list that is gone through for each block. Source text of as many
    lines would have to be compiled first, which takes longer than to run it once and as
    much memory again.
    """
    program = _write_program(outputs, inputs)
    names = [*program.constants, *program.inputs, *program.outputs, *program.rows]
    row_of = {name: row for row, name in enumerate(names)}
    operations: list[tuple[Callable[..., Any], int, int | None, int]] = []
    for step in program.steps:
        name = _UFUNCS.get(step.operation, step.operation)
        ufunc = _maximum if name == "maximum" else getattr(np, name)
        arguments = [row_of[x] for x in step.arguments]
        second = arguments[1] if len(arguments) == 2 else None
        operations.append((ufunc, arguments[0], second, row_of[step.result]))
    row_count = len(program.rows)
    constants = lru_cache(2)(
        lambda kind: [*np.array([*program.constants.values()], dtype=kind)[:, None]]
    )

    def evaluate(given: Array, out: Array | None = None) -> Array:
        kind, count = np.result_type(given, number), given.shape[1]
        if out is None:
            out = np.empty((len(outputs), count), dtype=kind)
        work = np.empty((row_count, min(count, BLOCK)), dtype=kind)
        with np.errstate(all="ignore"):
            for start in range(0, count, BLOCK):
                block = slice(start, start + BLOCK)
                spare = work[:, : count - start]
                rows = [*constants(kind), *given[:, block], *out[:, block], *spare]
                for ufunc, first, second, result in operations:
                    if second is None:
                        ufunc(rows[first], rows[result])
                    else:
                        ufunc(rows[first], rows[second], rows[result])
        return out

    return evaluate


def _maximum(one: Array, other: Array, result: Array) -> None:
    """Write the larger numbers to a third array, which NumPy wants as a keyword here."""
    np.maximum(one, other, out=result)


def float_function(
    outputs: Sequence[Expr], inputs: Sequence[ExpressionNode]
) -> FloatFunction:
    """Return expressions as a function of floats.

    For one row it takes a tenth of the time of an `array_function`. Where a result is not
    finite it may raise `ArithmeticError` or `ValueError`.
    """
    program = _write_program(outputs, inputs)
    lines = [f"[{', '.join(program.inputs)}] = given"]
    for step in program.steps:
        if step.operation in _INFIX:
            value = f" {step.operation} ".join(step.arguments)
        else:
            name = _UFUNCS.get(step.operation, step.operation)
            value = f"{name}({', '.join(step.arguments)})"
        lines.append(f"{step.result} = {value}")
    lines.append(f"return [{', '.join(program.outputs)}]")
    scope: dict[str, Any] = {
        **vars(math),
        "power": math.pow,
        # As NumPy's: of what is no number neither is one.
        "maximum": lambda a, b: a if a >= b or a != a else b,
        "sign": lambda a: np.sign(a).item(),
        **program.constants,
    }
    exec("\n    ".join(["def evaluate(given):", *lines]), scope)
    function: FloatFunction = scope["evaluate"]
    return function


@dataclass(frozen=True)
class _Step:
    """An operation on named numbers, whose result gets a name."""

    operation: str
    arguments: Sequence[str]
    result: str


@dataclass(frozen=True)
class _Program:
    """The operations that give outputs, one after another.

    `constants` are the numbers by name. A row in between is free again after the last step
    that reads it, so `rows` are fewer than the steps.
    """

    steps: Sequence[_Step]
    constants: Mapping[str, float]
    inputs: Sequence[str]
    outputs: Sequence[str]
    rows: Sequence[str]


def _write_program(outputs: Sequence[Expr], inputs: Sequence[ExpressionNode]) -> _Program:
    """Return the operations that expressions consist of, in an order that runs."""
    order = [term for term in in_order(outputs) if term.operation != "variable"]
    last = {item: k for k, term in enumerate(order) for item in term.arguments}
    used = [*(item for term in order for item in term.arguments), *outputs]
    numbers = dict.fromkeys(float(x) for x in used if not isinstance(x, ExpressionNode))
    called: dict[Any, str] = {x: f"c{k}" for k, x in enumerate(numbers)}
    constants = {called[x]: x for x in numbers}
    given = [f"x{k}" for k in range(len(inputs))]
    called |= zip(inputs, given, strict=True)
    results = [f"y{k}" for k in range(len(outputs))]
    for item, result in zip(outputs, results, strict=True):
        called.setdefault(item, result)

    steps = list[_Step]()
    free = list[str]()
    rows = dict[str, None]()  # in order, and quick to look up: long chains have thousands
    for k, term in enumerate(order):
        parts = [called[item] for item in term.arguments]
        done = dict.fromkeys(called[x] for x in term.arguments if last[x] == k)
        free += [row for row in done if row in rows]
        if term not in called:
            if not free:
                free.append(f"z{len(rows)}")
                rows[free[0]] = None
            called[term] = free.pop()
        steps.append(_Step(term.operation, parts, called[term]))
    for item, result in zip(outputs, results, strict=True):
        if called[item] != result:
            steps.append(_Step("positive", [called[item]], result))
    return _Program(steps, constants, given, results, [*rows])
