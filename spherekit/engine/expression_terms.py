"""Expressions of users as terms, so that they have exact derivatives."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from spherekit.engine.expression_graph import Expr, function, power
from spherekit.errors import EngineError
from spherekit.model.expression import Expression, fold


def _size(x: Expr) -> Expr:
    return x * function("sign", x)


def _larger(*items: Expr) -> Expr:
    best = items[0]
    for item in items[1:]:
        best = 0.5 * (best + item + _size(best - item))
    return best


def need_divisor(law: Expression, name: str, parts: Sequence[Expr]) -> None:
    """Refuse a quotient by terms that cancel each other."""
    if name == "/" and parts[1] == 0.0:
        what = f'"{law.text}"' if law.text else "a load"
        raise EngineError(f"{what} divides by what is zero everywhere")


BY_OPERATOR: Mapping[str, Callable[..., Expr]] = {
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "*": lambda a, b: a * b,
    "/": lambda a, b: a / b,
    "**": power,
    "negative": lambda a: -1.0 * a,
}

_BY_TERMS: Mapping[str, Callable[..., Expr]] = {
    **BY_OPERATOR,
    "abs": _size,
    "max": _larger,
    "min": lambda *items: -1.0 * _larger(*(-1.0 * item for item in items)),
}


def expression_terms(expression: Expression, named: Mapping[str, Expr]) -> Expr:
    """Return an expression in terms, from the terms of its names."""

    def apply(name: str, parts: list[Any]) -> Expr:
        need_divisor(expression, name, parts)
        made = _BY_TERMS.get(name)
        return made(*parts) if made else function(name, *parts)

    return fold(expression.root, float, lambda name: named[name], apply)
