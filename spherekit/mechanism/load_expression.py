"""Expressions of loads: parsed against a small grammar, never run as code."""

import ast
import re
import sys
import warnings
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, reduce
from itertools import combinations
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from spherekit.arrays import Floats
from spherekit.conventions import Names
from spherekit.errors import ModelError
from spherekit.wording import listing, nearest

MAX_LENGTH = 2000
"""Longest expression (characters); a Fourier series of 50 terms fits easily."""

MAX_DEPTH = 150
"""Deepest tree; a sum of n terms is n deep."""

CONSTANTS: Mapping[str, float] = MappingProxyType({"pi": 3.141592653589793})

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

FUNCTIONS: Mapping[str, tuple[int, int | None]] = MappingProxyType(
    {
        **{name: (1, 1) for name in ON_ARRAYS if name.isalnum() and name != "negative"},
        "atan2": (2, 2),
        "min": (2, None),
        "max": (2, None),
    }
)
"""Fewest and most arguments of each function; `log` is the natural logarithm."""


Node = float | str | tuple[Any, ...]
"""A tree: a number, the name of a variable (``theta_PAIR``, ``dtheta_PAIR``, ``t``), or an
operator (``+ - * / **`` or ``negative``) or a function with its arguments after it."""

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
    if isinstance(node, tuple):
        function, *parts = node
        return apply(function, [fold(part, number, name, apply) for part in parts])
    return name(node) if isinstance(node, str) else number(node)


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
        missing = sorted(self.names - set(values))
        if missing:
            raise ModelError(f'"{self.text}": give a value for {listing(missing)}')
        arrays = {key: np.asarray(values[key], dtype=np.float64) for key in values}
        shape = np.broadcast_shapes(*(array.shape for array in arrays.values()))
        with np.errstate(all="ignore"):
            value: Any = fold(
                self.root,
                np.float64,
                arrays.__getitem__,
                lambda function, parts: ON_ARRAYS[function](*parts),
            )
            return np.array(np.broadcast_to(value, shape))


def load_names(pairs: Collection[str]) -> Names:
    """Return the names a load may use, given the names of the R pairs."""
    return ("t", *(f"{kind}_{pair}" for kind in ("theta", "dtheta") for pair in pairs))


def parse(text: str, names: Iterable[str]) -> Expression:
    """Parse an expression in which only these names may occur.

    Raises
    ------
    ModelError
        If anything but the grammar occurs; the message starts with the column.
    """
    return _parsed(text, tuple(names))


@lru_cache(maxsize=1024)
def _parsed(text: str, names: Names) -> Expression:
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
    margin = len(flat) - len(flat.lstrip(" "))
    root = _tree(_syntax_tree(flat.strip(" "), margin), names, margin)
    return Expression(text, _names(root), root)


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
        message = f"cannot be read here ({error.msg}); products are written with *"
        raise _fault(column, message) from None
    except (RecursionError, MemoryError, ValueError):
        raise _fault(margin, "too deeply nested", _LEVELS) from None


def _tree(item: ast.expr, names: Names, margin: int, depth: int = 1) -> Node:
    """Return Python's syntax tree as ours, refusing whatever is not in the grammar."""
    column = margin + item.col_offset
    if depth > MAX_DEPTH:
        raise _fault(column, "too deeply nested", _LEVELS)
    parts: Sequence[ast.expr]
    match item:
        case ast.Constant(value):
            return _number(value, column)
        case ast.Name(name):
            return _variable(name, names, column)
        case ast.BinOp(left, operation, right) if type(operation) in _OPERATORS:
            function, parts = _OPERATORS[type(operation)], (left, right)
        case ast.UnaryOp(ast.USub(), operand):
            function, parts = "negative", (operand,)
        case ast.UnaryOp(ast.UAdd(), operand):
            return _tree(operand, names, margin, depth + 1)
        case ast.Call():
            function, parts = _function(item, column), item.args
        case ast.BinOp(op=ast.FloorDiv()):
            raise _fault(column, 'found the operator "//", which is not allowed')
        case _:
            message = f"found {type(item).__name__.lower()}, which is not allowed"
            raise _fault(column, message)
    arguments = [_tree(part, names, margin, depth + 1) for part in parts]
    if function == "/" and arguments[1] == 0.0:
        what = "divides by zero"
    elif len(numbers := [x for x in arguments if isinstance(x, float)]) < len(arguments):
        return (function, *arguments)
    else:  # of numbers alone, the number that it is
        with np.errstate(all="ignore"):
            value = float(ON_ARRAYS[function](*map(np.float64, numbers)))
        if np.isfinite(value):
            return value
        what = "is not a finite number"
    raise _fault(column, f"{ast.unparse(item)} {what}", "constants have to be finite")


def _number(value: Any, column: int) -> float:
    if type(value) not in (int, float):
        raise _fault(column, f"found {value!r}, which is not a real number")
    if value > sys.float_info.max:
        raise _fault(column, "found a number too large for a float64")
    return float(value)


def _variable(name: str, names: Names, column: int) -> Node:
    if name in CONSTANTS:
        return CONSTANTS[name]
    if name in FUNCTIONS:
        raise _fault(column, f'"{name}" is a function', f"write {name}(...)")
    if name not in names:
        hint = nearest(name, [*names, *CONSTANTS, *FUNCTIONS])
        allowed = f"names: {listing([*names, *CONSTANTS])}"
        raise _fault(column, f'"{name}" is not known{hint}', allowed)
    return name


def _function(item: ast.Call, column: int) -> str:
    """Return the name of the function that is called, if it takes so many arguments."""
    name = item.func.id if isinstance(item.func, ast.Name) else ""
    if name not in FUNCTIONS:
        what = f'"{name}"' if name else "what stands before the parenthesis"
        message = f"{what} is not a function{nearest(name, FUNCTIONS)}"
        allowed = f"functions: {listing(FUNCTIONS, 20)}; for products write *"
        raise _fault(column, message, allowed)
    fewest, most = FUNCTIONS[name]
    count = len(item.args)
    if not fewest <= count <= (most or count) or item.keywords:
        needs = f"{fewest} or more" if most is None else f"{fewest}"
        raise _fault(column, f"{name} has {count} arguments", f"it takes {needs}")
    return name


def _steep(node: Node, kinked: Sequence[str]) -> Iterator[Node]:
    """Yield the arguments that `Expression.steep` has, the innermost first."""
    if not isinstance(node, tuple):
        return
    name, *arguments = node
    for child in arguments:
        yield from _steep(child, kinked)
    if name in ENTIRE or (name in KINKED and name not in kinked):
        return
    if name in ("min", "max"):
        arguments = [("-", *pair) for pair in combinations(arguments, 2)]
    elif name == "/":
        arguments = arguments[1:]
    elif name == "**" and isinstance(power := arguments[1], float):
        arguments = [] if power >= 0.0 and power.is_integer() else arguments[:1]
    yield from (argument for argument in arguments if _names(argument))


def _names(node: Node) -> frozenset[str]:
    return fold(
        node,
        lambda value: frozenset(),
        lambda name: frozenset([name]),
        lambda function, parts: frozenset().union(*parts),
    )
