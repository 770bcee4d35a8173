"""Expressions of loads, parsed by a small grammar and never executed as code."""

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
from spherekit.wording import counted, listing, nearest

MAX_LENGTH = 2000
"""Largest number of characters of an expression. A Fourier series of 50 terms fits."""

MAX_DEPTH = 150
"""Largest depth of a tree. A sum of n terms has the depth n."""

NAMED_CONSTANTS: Mapping[str, float] = MappingProxyType({"pi": 3.141592653589793})

NON_SMOOTH_FUNCTIONS = ("abs", "sign", "min", "max")
"""Functions with kinks or jumps."""

ENTIRE_OPERATIONS = ("+", "-", "*", "negative", "sin", "cos")
"""Operations whose power series at any point gives their value everywhere, to all digits.

Some other functions have poles or branch points next to the real axis. Others become so
flat that a series in float64 does not show how they continue: tanh(20) is 1, and all its
derivatives are 0.
"""

_OPERATORS: Mapping[type[ast.operator], str] = MappingProxyType(
    {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Pow: "**"}
)
_CONSTRUCTS: Mapping[type[ast.expr], str] = MappingProxyType(
    {
        ast.Attribute: "a name after a dot",
        ast.Await: 'the word "await"',
        ast.Compare: 'a comparison such as "in" or "is"',
        ast.GeneratorExp: 'a loop "for ... in ..."',
        ast.IfExp: 'a condition "... if ... else ..."',
        ast.Starred: 'a "*" without a factor on its left',
        ast.Tuple: "a comma outside the parentheses of a function",
    }
)
"""What a user wrote, by kinds of Python's syntax tree that a load may not contain."""

_GRAMMAR = (
    "an expression may contain only numbers, names, + - * / **, parentheses and functions"
)
_DEPTH_LIMIT = f"at most {MAX_DEPTH} levels"
_FORBIDDEN_CHARACTER = re.compile(r"[^A-Za-z0-9_+\-*/(),. ]")

ARRAY_OPERATIONS: Mapping[str, Callable[..., Any]] = MappingProxyType(
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
"""Every operator and function, for arrays of any number type of NumPy."""

ARGUMENT_COUNTS: Mapping[str, tuple[int, int | None]] = MappingProxyType(
    {
        **{
            name: (1, 1)
            for name in ARRAY_OPERATIONS
            if name.isalnum() and name != "negative"
        },
        "atan2": (2, 2),
        "min": (2, None),
        "max": (2, None),
    }
)
"""Smallest and largest number of arguments of each function; `log` is the natural one."""


Node = float | str | tuple[Any, ...]
"""A node of a tree.

It is a number, the name of a variable (``theta_PAIR``, ``dtheta_PAIR``, ``t``), or a tuple
of an operator (``+ - * / **`` or ``negative``) or function and its arguments.
"""

T = TypeVar("T")


def fold(
    node: Node,
    convert_number: Callable[[float], T],
    convert_name: Callable[[str], T],
    convert_call: Callable[[str, list[T]], T],
) -> T:
    """Convert the tree of an expression to another form, such as a value or a text.

    Parameters
    ----------
    node
        Root of the tree.
    convert_number, convert_name
        Return the other form of a number, and of a variable.
    convert_call
        Returns the other form of a call. Its arguments are the operator or function, and
        the list of converted arguments.
    """
    # A node is a call (a tuple of operator or function and arguments), the name of a
    # variable, or a number.
    if isinstance(node, tuple):
        function, *arguments = node
        converted_arguments = [
            fold(argument, convert_number, convert_name, convert_call)
            for argument in arguments
        ]
        return convert_call(function, converted_arguments)
    return convert_name(node) if isinstance(node, str) else convert_number(node)


@dataclass(frozen=True)
class Expression:
    """A parsed mathematical expression in the definition of a load.

    Attributes
    ----------
    text
        The text that was parsed.
    names
        Names of variables in the expression.
    root
        Root of the tree of operations.
    """

    text: str
    names: frozenset[str]
    root: Node

    @property
    def is_smooth(self) -> bool:
        """Whether the expression contains none of the functions with kinks or jumps."""
        return fold(
            self.root,
            lambda number: True,
            lambda name: True,
            lambda function, arguments: (
                function not in NON_SMOOTH_FUNCTIONS and all(arguments)
            ),
        )

    @cached_property
    def steep_arguments(self) -> "tuple[Expression, ...]":
        """Subexpressions; where one is nearly zero, the value may change suddenly.

        An example is x in tanh(x / 0.001). Series fitted to samples could miss such a
        change. Callers therefore examine the zeros of x, and its extrema, where x can touch
        0. The steep arguments are the arguments of all functions except
        `ENTIRE_OPERATIONS` (smooth everywhere), but for min and max the differences of two
        arguments; the denominators; the bases of powers with other than natural exponents;
        and variable exponents.
        """
        return self._find_steep_arguments(ignored_functions=())

    @cached_property
    def smooth_steep_arguments(self) -> "tuple[Expression, ...]":
        """The `steep_arguments` without the arguments of functions with kinks or jumps."""
        return self._find_steep_arguments(ignored_functions=NON_SMOOTH_FUNCTIONS)

    def _find_steep_arguments(
        self, ignored_functions: Sequence[str]
    ) -> "tuple[Expression, ...]":
        """Return the distinct steep arguments of the expression.

        A steep argument is the x of a function such as tanh(1000 x) or 1 / x. The function
        may change suddenly where x passes 0, or nearly touches 0 at an extremum. Arguments
        of the `ignored_functions`, such as `abs`, are left out.
        """
        nodes = dict.fromkeys(_iterate_steep_arguments(self.root, ignored_functions))
        return tuple(Expression(self.text, _find_names(node), node) for node in nodes)

    def evaluate(self, values: Mapping[str, ArrayLike]) -> Floats:
        """Return the value of the expression of a load for every sample.

        Parameters
        ----------
        values
            An array (rad, rad/s or s) for each name in the expression. Other names are
            allowed. The result has the shape to which all arrays broadcast.

        Raises
        ------
        ModelError
            If there is no value for a name in the expression.

        Notes
        -----
        The result is NaN outside the domain of a function, and infinite on overflow.
        """
        missing = sorted(self.names - set(values))
        if missing:
            raise ModelError(f'"{self.text}": give a value for {listing(missing)}')
        arrays = {key: np.asarray(values[key], dtype=np.float64) for key in values}
        shape = np.broadcast_shapes(*(array.shape for array in arrays.values()))
        with np.errstate(all="ignore"):
            value: Any = fold(
                self.root,
                convert_number=np.float64,
                convert_name=arrays.__getitem__,
                convert_call=lambda function, arguments: ARRAY_OPERATIONS[function](
                    *arguments
                ),
            )
            return np.array(np.broadcast_to(value, shape))


def load_names(pairs: Collection[str]) -> Names:
    """Return the names of variables that a load may use, from the names of the R pairs."""
    return ("t", *(f"{kind}_{pair}" for kind in ("theta", "dtheta") for pair in pairs))


def parse(text: str, names: Iterable[str]) -> Expression:
    """Parse an expression of a load, such as ``0.5 - 2*sin(theta_41)``.

    An expression consists of numbers, `pi`, names, the operations ``+ - * / **``,
    parentheses and some functions, such as `sin` and `max`.

    Parameters
    ----------
    text
        The expression.
    names
        Names of variables that it may contain.

    Raises
    ------
    ModelError
        If it contains anything else. The message starts with the column.
    """
    # `_parse` caches its results, for which names have to be a tuple.
    return _parse(text, tuple(names))


@lru_cache(maxsize=1024)
def _parse(text: str, names: Names) -> Expression:
    """Parse an expression of a load in variables with these names.

    Results are cached (`lru_cache`). Arguments of a cache must be hashable, so the names
    are a tuple. `ModelError` states the column of a fault.
    """
    if len(text) > MAX_LENGTH:
        raise ModelError(
            f"column {MAX_LENGTH + 1}: the expression has {len(text)} characters, at "
            f"most {MAX_LENGTH} are allowed"
        )
    one_line = re.sub(r"[\t\r\n]", " ", text)
    forbidden = _FORBIDDEN_CHARACTER.search(one_line)
    if forbidden:
        character = forbidden[0]
        allowed = _GRAMMAR
        if character.isalnum():  # a letter or digit of another alphabet
            allowed = "names may contain only the letters A to Z and a to z, digits and _"
        raise _syntax_error(forbidden.start(), _describe_character(character), allowed)
    if not one_line.strip():
        raise ModelError("column 1: the expression is empty")
    # Python's parser refuses spaces at the start. These spaces count in the columns of
    # messages.
    indentation = len(one_line) - len(one_line.lstrip(" "))
    python_tree = _parse_python(one_line.strip(" "), indentation)
    root = _convert_python_tree(python_tree, names, indentation)
    return Expression(text, _find_names(root), root)


def _syntax_error(column: int, message: str, allowed: str = _GRAMMAR) -> ModelError:
    """Return the error at a column (from 0), and what is allowed instead."""
    # A list of names begins with a capital letter, as a sentence of its own.
    separator = "." if allowed[0].isupper() else ";"
    if message.endswith("?"):
        separator = ""
    return ModelError(f"column {column + 1}: {message}{separator} {allowed}")


def _parse_python(text: str, indentation: int) -> ast.expr:
    """Return the syntax tree of an expression, from Python's parser.

    Parameters
    ----------
    text
        The expression without spaces at its start.
    indentation
        Number of spaces that were removed from the start. Columns in messages include them.

    Raises
    ------
    ModelError
        If the text is no expression of Python, or too deeply nested.
    """
    try:
        with warnings.catch_warnings():
            # Python warns of texts such as "1or t", which are refused later anyway.
            warnings.simplefilter("ignore")
            return ast.parse(text, mode="eval").body
    except SyntaxError as error:
        column = indentation + max(error.offset or 1, 1) - 1
        if "(" in error.msg or ")" in error.msg:
            raise _syntax_error(
                column,
                f"parentheses do not match ({error.msg})",
                'write as many ")" as "("',
            ) from None
        # For texts such as "01", Python's message advises after a semicolon what is not
        # allowed here. Only the part before the semicolon is used.
        reason = error.msg.partition(";")[0]
        raise _syntax_error(
            column,
            f"cannot be read from here on ({reason}); products are written with *",
        ) from None
    except (RecursionError, MemoryError, ValueError):
        # Deep nesting makes the parser fail with one of these types of errors.
        raise _syntax_error(indentation, "too deeply nested", _DEPTH_LIMIT) from None


def _convert_python_tree(
    node: ast.expr, names: Names, indentation: int, depth: int = 1
) -> Node:
    """Return a syntax tree of Python as a tree of `Node`.

    Expressions of loads are parsed by Python's parser, and only a small grammar is allowed.
    A `Node` is a number, the name of a variable, or a tuple of an operator or function and
    its arguments. Calls with numbers only are replaced by their value.

    Parameters
    ----------
    node
        Root of the tree.
    names
        Names of variables that are allowed.
    indentation
        Spaces before the text, which count in the columns of messages.
    depth
        Depth of this node in the whole tree.

    Raises
    ------
    ModelError
        If the tree contains anything outside the grammar.
    """
    # Position in the text, for messages.
    column = indentation + node.col_offset
    if depth > MAX_DEPTH:
        raise _syntax_error(column, "too deeply nested", _DEPTH_LIMIT)
    operands: Sequence[ast.expr]
    match node:
        case ast.Constant(value):
            return _convert_number(value, column)
        case ast.Name(name):
            return _convert_name(name, names, column)
        case ast.BinOp(left, operation, right) if type(operation) in _OPERATORS:
            function = _OPERATORS[type(operation)]
            operands = (left, right)
        case ast.UnaryOp(ast.USub(), operand):
            function = "negative"
            operands = (operand,)
        case ast.UnaryOp(ast.UAdd(), operand):
            return _convert_python_tree(operand, names, indentation, depth + 1)
        case ast.Call():
            function = _read_function_name(node, names, column)
            operands = node.args
        case ast.BinOp(op=ast.FloorDiv()):
            raise _syntax_error(column, 'found the operator "//", which is not allowed')
        case _:
            message = f"found {_describe_construct(node)}, which is not allowed"
            raise _syntax_error(column, message)
    arguments = [
        _convert_python_tree(operand, names, indentation, depth + 1) for operand in operands
    ]
    # A call of numbers becomes its value. A value that is not finite is refused.
    numbers = [argument for argument in arguments if isinstance(argument, float)]
    if function == "/" and arguments[1] == 0.0:
        fault = "divides by zero"
    elif len(numbers) < len(arguments):
        return (function, *arguments)
    else:
        with np.errstate(all="ignore"):
            value = float(ARRAY_OPERATIONS[function](*map(np.float64, numbers)))
        if np.isfinite(value):
            return value
        fault = "is not a finite number"
    raise _syntax_error(
        column, f"{ast.unparse(node)} {fault}", "constants have to be finite"
    )


def _describe_character(character: str) -> str:
    """Return the message about a character that no expression may contain."""
    if character == "^":
        return "found the character '^'; powers are written **"
    shown = "an invisible character"
    if character.isprintable():
        shown = f"the character {character!r}"
        if character.isascii():
            return f"found {shown}"
    # Some letters of other alphabets look like ASCII letters. The code tells them apart.
    return f"found {shown} (U+{ord(character):04X})"


def _describe_construct(node: ast.expr) -> str:
    """Return what a user wrote, for a syntax tree of Python that is not allowed."""
    if isinstance(node, ast.BoolOp):
        return 'the word "and"' if isinstance(node.op, ast.And) else 'the word "or"'
    if isinstance(node, ast.UnaryOp):
        return 'the word "not"'
    if isinstance(node, ast.Tuple) and not node.elts:
        return "parentheses with nothing between them"
    return _CONSTRUCTS.get(type(node), f'"{ast.unparse(node)}"')


def _convert_number(value: Any, column: int) -> float:
    """Return a constant as a float; raise `ModelError` if it is no finite real number."""
    if type(value) not in (int, float):
        text = '"..."' if value is ... else repr(value)
        raise _syntax_error(column, f"found {text}, which is not a real number")
    if value > sys.float_info.max:
        raise _syntax_error(column, "found a number too large for a float64")
    return float(value)


def _convert_name(name: str, names: Names, column: int) -> Node:
    """Convert a name in an expression: to the value of a constant, or to a variable.

    Parameters
    ----------
    name
        Name in the expression.
    names
        Names of variables that the expression may contain.
    column
        Column of the name, for messages.

    Raises
    ------
    ModelError
        If the name is neither a constant nor one of `names`.
    """
    if name in NAMED_CONSTANTS:
        return NAMED_CONSTANTS[name]
    if name in ARGUMENT_COUNTS:
        raise _syntax_error(column, f'"{name}" is a function', f"write {name}(...)")
    if name not in names:
        hint = nearest(name, [*names, *NAMED_CONSTANTS, *ARGUMENT_COUNTS])
        allowed = f"Names: {listing([*names, *NAMED_CONSTANTS])}"
        raise _syntax_error(column, f'"{name}" is not known{hint}', allowed)
    return name


def _read_function_name(call: ast.Call, names: Names, column: int) -> str:
    """Return the name of the function in a call, after a check of name and arguments.

    Parameters
    ----------
    call
        The call in the syntax tree of Python.
    names
        Names of variables that are allowed.
    column
        Column of the call, for messages.

    Raises
    ------
    ModelError
        If there is no such function, or if it does not accept this many arguments.
    """
    name = call.func.id if isinstance(call.func, ast.Name) else ""
    if name not in ARGUMENT_COUNTS:
        what = f'"{name}"' if name else "the expression before the parenthesis"
        # `nearest` returns a suggestion such as ``; did you mean "sin"?``, or no text.
        message = f"{what} is not a function{nearest(name, ARGUMENT_COUNTS)}"
        functions = listing(ARGUMENT_COUNTS, 20)  # the message lists at most 20
        # A number or a variable before a parenthesis is probably meant as a factor.
        if not name or name in (*names, *NAMED_CONSTANTS):
            allowed = f"products are written with *; functions: {functions}"
        else:
            allowed = f"Functions: {functions}"
        raise _syntax_error(column, message, allowed)
    # `largest` is None for functions without an upper limit, such as max. All others take
    # exactly `smallest` arguments.
    smallest, largest = ARGUMENT_COUNTS[name]
    count = len(call.args)
    if not smallest <= count <= (largest or count) or call.keywords:
        needed = f"{smallest} or more" if largest is None else f"{smallest}"
        if call.keywords:
            needed += ", without names"
        raise _syntax_error(
            column, f"{name}: found {counted(count, 'argument')}", f"needs {needed}"
        )
    return name


def _iterate_steep_arguments(
    node: Node, ignored_functions: Sequence[str]
) -> Iterator[Node]:
    """Yield arguments of functions that can change suddenly near zero, innermost first.

    Series that approximate an expression can be inaccurate near zeros of these arguments.
    The arguments are called steep. Integrators check their steps there. Sums, products,
    sine and cosine have no steep arguments. Examples of other functions are tanh(1000 x)
    and sqrt(x), with the steep arguments 1000 x and x. For a / b it is the denominator b,
    and for max(a, b) the difference a - b. Constants are left out.

    Parameters
    ----------
    node
        Root of the tree.
    ignored_functions
        Functions whose arguments are not yielded, such as abs.
    """
    if not isinstance(node, tuple):
        return
    name, *arguments = node
    for argument in arguments:
        yield from _iterate_steep_arguments(argument, ignored_functions)
    # Power series of these operations, such as products and sines, converge everywhere. So
    # these have no steep arguments.
    if name in ENTIRE_OPERATIONS or name in ignored_functions:
        return
    for argument in _steep_arguments(name, arguments):
        # An argument without variables is a constant.
        if _find_names(argument):
            yield argument


def _steep_arguments(name: str, arguments: list[Node]) -> list[Node]:
    """Return expressions near whose zeros a function may change suddenly or have a kink.

    For example, 1 / x changes suddenly near x = 0, so x is returned. Series and steps of
    integration can be inaccurate there, so integrators check their steps.

    Parameters
    ----------
    name
        Name of the function, or sign of the operation. Sums and products are not passed,
        because they never change suddenly.
    arguments
        Arguments of the function or operation.
    """
    if name in ("min", "max"):
        # The value has a kink where two arguments are equal.
        return [("-", *pair) for pair in combinations(arguments, 2)]
    if name == "/":
        _, denominator = arguments
        return [denominator]
    if name == "**":
        base, exponent = arguments
        # With a natural exponent, a power is a product, which has no sudden change. With
        # another constant exponent only the base counts.
        if isinstance(exponent, float):
            is_natural = exponent >= 0.0 and exponent.is_integer()
            if is_natural:
                return []
            return [base]
    # Other functions, such as tanh and sqrt, and powers with a variable exponent. As a
    # precaution, all their arguments are returned.
    return arguments


def _find_names(node: Node) -> frozenset[str]:
    """Return the names of variables in a tree."""
    return fold(
        node,
        lambda number: frozenset(),
        lambda name: frozenset([name]),
        lambda function, sets: frozenset().union(*sets),
    )
