"""Expressions of loads: parsed against a small grammar, never run as code."""

import ast
import math
import operator
import re
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, reduce
from itertools import combinations
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from spherekit.arrays import Floats
from spherekit.conventions import listing, nearest
from spherekit.errors import ModelError

MAX_LENGTH = 2000
"""Longest expression (characters); a Fourier series of 50 terms fits easily."""

MAX_DEPTH = 150
"""Deepest tree; a sum of n terms is n deep."""

CONSTANTS: Mapping[str, float] = MappingProxyType({"pi": 3.141592653589793})

FUNCTIONS: Mapping[str, tuple[int, int | None]] = MappingProxyType(
    {
        "sin": (1, 1),
        "cos": (1, 1),
        "tan": (1, 1),
        "asin": (1, 1),
        "acos": (1, 1),
        "atan": (1, 1),
        "atan2": (2, 2),
        "sqrt": (1, 1),
        "exp": (1, 1),
        "log": (1, 1),
        "abs": (1, 1),
        "tanh": (1, 1),
        "sign": (1, 1),
        "min": (2, None),
        "max": (2, None),
    }
)
"""Fewest and most arguments of each function; `log` is the natural logarithm."""

KINKED = ("abs", "sign", "min", "max")
"""The functions among them that are not smooth."""

ENTIRE = ("+", "-", "*", "negative", "sin", "cos")
"""Those whose power series at any point is their value everywhere, to the last digit.

Of the others some have poles or branch points beside the real axis, others become so flat
that float64 shows nothing of what follows: tanh(20) is 1, and all its derivatives are 0.
"""

_OPERATORS: Mapping[type[ast.operator], str] = MappingProxyType(
    {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Pow: "**"}
)
_GRAMMAR = "numbers, names, + - * / **, parentheses and functions are allowed"
_LEVELS = f"at most {MAX_DEPTH} levels"
_FOREIGN = re.compile(r"[^A-Za-z0-9_+\-*/(),. ]")

ON_ARRAYS: Mapping[str, Callable[..., Any]] = MappingProxyType(
    {
        "+": np.add,
        "-": np.subtract,
        "*": np.multiply,
        "/": np.divide,
        "**": np.power,
        "negative": np.negative,
        "sin": np.sin,
        "cos": np.cos,
        "tan": np.tan,
        "asin": np.arcsin,
        "acos": np.arccos,
        "atan": np.arctan,
        "atan2": np.arctan2,
        "sqrt": np.sqrt,
        "exp": np.exp,
        "log": np.log,
        "abs": np.abs,
        "tanh": np.tanh,
        "sign": np.sign,
        "min": lambda *values: reduce(np.minimum, values),
        "max": lambda *values: reduce(np.maximum, values),
    }
)
"""Every operator and function on arrays of any kind of number that NumPy knows."""


@dataclass(frozen=True)
class Number:
    """A number written in an expression, or a constant."""

    value: float


@dataclass(frozen=True)
class Name:
    """A variable: ``theta_PAIR``, ``dtheta_PAIR`` or ``t``."""

    name: str


@dataclass(frozen=True)
class Call:
    """An operator (``+ - * / **`` or ``negative``) or a function with its arguments."""

    function: str
    arguments: "tuple[Node, ...]"


Node = Number | Name | Call

T = TypeVar("T")


def fold(
    node: Node,
    number: Callable[[float], T],
    name: Callable[[str], T],
    apply: Callable[[str, list[T]], T],
) -> T:
    """Return what a tree comes to, from its numbers, names and calls.

    `apply` gets the function of a call and what its arguments came to, which are taken in
    the order in which they are written.
    """
    if isinstance(node, Number):
        return number(node.value)
    if isinstance(node, Name):
        return name(node.name)
    parts = [fold(argument, number, name, apply) for argument in node.arguments]
    return apply(node.function, parts)


@dataclass(frozen=True)
class Expression:
    """A parsed expression: its text, the names it uses, and its tree."""

    text: str
    names: frozenset[str]
    root: Node

    @property
    def smooth(self) -> bool:
        """Whether it uses none of the functions that have kinks or jumps."""
        return fold(
            self.root,
            lambda value: True,
            lambda name: True,
            lambda function, parts: function not in KINKED and all(parts),
        )

    @cached_property
    def steep(self) -> "tuple[Expression, ...]":
        """The arguments at whose zeros and turns the value may change all at once.

        Those of every function that is not among `ENTIRE`, the denominators and the bases
        of powers that are not whole: no power series need show what happens there.
        """
        return self._arguments(KINKED)

    @cached_property
    def steep_and_smooth(self) -> "tuple[Expression, ...]":
        """Those among `steep` that are not arguments of functions with kinks or jumps."""
        return self._arguments(())

    def _arguments(self, kinked: Sequence[str]) -> "tuple[Expression, ...]":
        nodes = dict.fromkeys(_steep(self.root, kinked))
        return tuple(Expression(self.text, _names(x), x) for x in nodes)

    def evaluate(self, values: Mapping[str, ArrayLike]) -> Floats:
        """Return the expression's value for every sample.

        Parameters
        ----------
        values
            An array for at least each name used: rad, rad/s or s. The result has the
            shape all arrays in `values` broadcast to, also where none is used.

        Notes
        -----
        Outside a function's domain the result is NaN, and infinite on overflow.
        """
        arrays, shape = self._arrays(values)
        with np.errstate(all="ignore"):
            value: Any = fold(
                self.root,
                np.float64,
                arrays.__getitem__,
                lambda function, parts: ON_ARRAYS[function](*parts),
            )
            return np.array(np.broadcast_to(value, shape), dtype=np.float64)

    def code(self, names: Mapping[str, str]) -> str:
        """Return it as Python for `made_of`, of floats for which its names are written so.

        Where `evaluate` gives NaN or infinity it may raise ValueError or ArithmeticError.
        """
        return fold(self.root, _literal, names.__getitem__, _written)

    def _arrays(
        self, values: Mapping[str, ArrayLike]
    ) -> tuple[dict[str, Floats], tuple[int, ...]]:
        missing = sorted(self.names - set(values))
        if missing:
            raise ModelError(f'"{self.text}": give a value for {listing(missing)}')
        arrays = {key: np.asarray(values[key], dtype=np.float64) for key in values}
        return arrays, np.broadcast_shapes(*(array.shape for array in arrays.values()))


def load_names(pairs: Iterable[str]) -> tuple[str, ...]:
    """Return the names a load may use, given the names of the R pairs."""
    pairs = list(pairs)
    rates = (f"dtheta_{pair}" for pair in pairs)
    return ("t", *(f"theta_{pair}" for pair in pairs), *rates)


def parse(text: str, names: Iterable[str]) -> Expression:
    """Parse an expression in which only these names may occur.

    Raises
    ------
    ModelError
        If anything but the grammar occurs; the message starts with the column.
    """
    return _parsed(text, tuple(names))


@lru_cache(maxsize=1024)
def _parsed(text: str, names: tuple[str, ...]) -> Expression:
    if len(text) > MAX_LENGTH:
        raise ModelError(
            f"column {MAX_LENGTH + 1}: the expression has {len(text)} characters, at "
            f"most {MAX_LENGTH} are allowed"
        )
    flat = re.sub(r"[\t\r\n]", " ", text)
    foreign = _FOREIGN.search(flat)
    if foreign:
        hint = "; powers are written **" if foreign[0] == "^" else ""
        raise _fault(foreign.start(), f"found {foreign[0]!a}{hint}")
    if not flat.strip():
        raise ModelError("column 1: the expression is empty; write 0 for no torque")
    reader = _Parser(names, len(flat) - len(flat.lstrip(" ")))
    root = reader.node(_syntax_tree(flat.strip(" "), reader.margin), 1)
    return Expression(text, frozenset(reader.used), root)


def _fault(column: int, message: str, allowed: str = _GRAMMAR) -> ModelError:
    end = "" if message.endswith("?") else ";"
    return ModelError(f"column {column + 1}: {message}{end} {allowed}")


def _syntax_tree(text: str, margin: int) -> ast.expr:
    try:
        with warnings.catch_warnings():
            # Python warns of spellings such as "1or t", which are refused below anyway.
            warnings.simplefilter("ignore")
            return ast.parse(text, mode="eval").body
    except SyntaxError as error:
        column = margin + max(error.offset or 1, 1) - 1
        hint = "products are written with *"
        raise _fault(column, f"cannot be read here ({error.msg}); {hint}") from None
    except (RecursionError, MemoryError, ValueError):
        raise _fault(margin, "too deeply nested", _LEVELS) from None


class _Parser:
    """Turns Python's syntax tree into ours, refusing whatever is not in the grammar."""

    def __init__(self, names: tuple[str, ...], margin: int) -> None:
        self.names = names
        self.margin = margin
        self.used: set[str] = set()

    def node(self, item: ast.expr, depth: int) -> Node:
        column = self.margin + item.col_offset
        if depth > MAX_DEPTH:
            raise _fault(column, "too deeply nested", _LEVELS)
        if isinstance(item, ast.Constant):
            return self.number(item.value, column)
        if isinstance(item, ast.Name):
            return self.name(item.id, column)
        if isinstance(item, ast.BinOp) and type(item.op) in _OPERATORS:
            sides = self.node(item.left, depth + 1), self.node(item.right, depth + 1)
            return self.applied(_OPERATORS[type(item.op)], sides, item)
        if isinstance(item, ast.UnaryOp) and isinstance(item.op, ast.USub):
            return self.applied("negative", (self.node(item.operand, depth + 1),), item)
        if isinstance(item, ast.UnaryOp) and isinstance(item.op, ast.UAdd):
            return self.node(item.operand, depth + 1)
        if isinstance(item, ast.Call):
            return self.call(item, column, depth)
        what = {"FloorDiv": "//"}.get(type(getattr(item, "op", item)).__name__)
        construct = f'the operator "{what}"' if what else f"{type(item).__name__.lower()}"
        raise _fault(column, f"found {construct}, which is not allowed")

    def number(self, value: object, column: int) -> Node:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise _fault(column, f"found {value!r}, which is not a real number")
        try:
            number = float(value)
        except OverflowError:
            number = float("inf")
        if number == float("inf"):
            raise _fault(column, "found a number too large for a float64")
        return Number(number)

    def name(self, name: str, column: int) -> Node:
        if name in CONSTANTS:
            return Number(CONSTANTS[name])
        if name in FUNCTIONS:
            raise _fault(column, f'"{name}" is a function', f"write {name}(...)")
        if name not in self.names:
            hint = nearest(name, [*self.names, *CONSTANTS, *FUNCTIONS])
            allowed = f"names: {listing([*self.names, *CONSTANTS])}"
            raise _fault(column, f'"{name}" is not known{hint}', allowed)
        self.used.add(name)
        return Name(name)

    def call(self, item: ast.Call, column: int, depth: int) -> Node:
        name = item.func.id if isinstance(item.func, ast.Name) else ""
        if name not in FUNCTIONS:
            what = f'"{name}"' if name else "what stands before the parenthesis"
            message = f"{what} is not a function{nearest(name, FUNCTIONS)}"
            allowed = f"functions: {listing(FUNCTIONS, 20)}; for products write *"
            raise _fault(column, message, allowed)
        fewest, most = FUNCTIONS[name]
        count = len(item.args)
        if count < fewest or (most is not None and count > most) or item.keywords:
            needs = f"{fewest} or more" if most is None else f"{fewest}"
            raise _fault(column, f"{name} has {count} arguments", f"it takes {needs}")
        arguments = tuple(self.node(argument, depth + 1) for argument in item.args)
        return self.applied(name, arguments, item)

    def applied(self, function: str, arguments: tuple[Node, ...], item: ast.expr) -> Node:
        """Return a call; of numbers alone the number that it is, which has to be finite."""
        numbers = [x.value for x in arguments if isinstance(x, Number)]
        if function == "/" and arguments[1] == Number(0.0):
            what = "divides by zero"
        elif len(numbers) < len(arguments):
            return Call(function, arguments)
        else:
            with np.errstate(all="ignore"):
                value = float(ON_ARRAYS[function](*map(np.float64, numbers)))
            if np.isfinite(value):
                return Number(value)
            what = "is not a finite number"
        column = self.margin + item.col_offset
        message = f"{ast.unparse(item)} {what}"
        raise _fault(column, message, "constants have to be finite")


_SCALAR: Mapping[str, Callable[..., float]] = MappingProxyType(
    {
        "**": math.pow,
        "negative": operator.neg,
        "sign": lambda a: a if a != a else float((a > 0.0) - (a < 0.0)),
        "abs": abs,
        "min": lambda *values: float(reduce(np.minimum, values)),
        "max": lambda *values: float(reduce(np.maximum, values)),
    }
)
"""Functions of floats; those that are not here are those of `math`."""


def made_of(code: str, more: Mapping[str, Any] | None = None) -> Callable[..., Any]:
    """Return the function that a lambda of `Expression.code` is, which may call more."""
    named = {"__builtins__": {}, **_NAMED, **(more or {})}
    made: Callable[..., Any] = eval(code, named)
    return made


_INFIX = ("+", "-", "*", "/")

_NAMED: Mapping[str, Any] = MappingProxyType(
    {
        "inf": math.inf,
        "nan": math.nan,
        "power": _SCALAR["**"],
        **{
            name: _SCALAR.get(name) or getattr(math, name)
            for name in ON_ARRAYS
            if name.isalnum() and name != "negative"
        },
    }
)
"""What code of expressions calls."""


def _written(function: str, items: list[str]) -> str:
    """Return a call as code."""
    if function in _INFIX:
        return f"({f' {function} '.join(items)})"
    if function == "negative":
        return f"(-{items[0]})"
    name = "power" if function == "**" else function
    return f"{name}({', '.join(items)})"


def _literal(number: float) -> str:
    return repr(number) if number >= 0.0 else f"({number!r})"


def _steep(node: Node, kinked: Sequence[str]) -> Iterator[Node]:
    """Yield the arguments that `Expression.steep` has, the innermost first."""
    if not isinstance(node, Call):
        return
    for child in node.arguments:
        yield from _steep(child, kinked)
    name, arguments = node.function, node.arguments
    if name in ENTIRE or (name in KINKED and name not in kinked):
        return
    if name in ("min", "max"):
        arguments = tuple(Call("-", pair) for pair in combinations(arguments, 2))
    elif name == "/":
        arguments = arguments[1:]
    elif name == "**" and isinstance(arguments[1], Number):
        whole = arguments[1].value >= 0.0 and arguments[1].value == round(
            arguments[1].value
        )
        arguments = () if whole else arguments[:1]
    yield from (argument for argument in arguments if _names(argument))


def _names(node: Node) -> frozenset[str]:
    return fold(
        node,
        lambda value: frozenset(),
        lambda name: frozenset([name]),
        lambda function, parts: frozenset().union(*parts),
    )
