"""Symbolic expressions as a graph in which equal subexpressions are one node.

The kinematics, loads and equations of motion of a mechanism are written as such
expressions. This module contains the nodes, their arithmetic, and functions that walk
through a graph or transform it. Derivatives are in
`spherekit.symbolic.expression_derivatives`, evaluation is in
`spherekit.symbolic.expression_evaluation` and `spherekit.symbolic.compiler`.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import count
from typing import Any
from weakref import WeakValueDictionary

Expr = Any
"""A number, or an `ExpressionNode`."""

ADVICE_WITHOUT_EXPRESSIONS = (
    'use NumPy\'s simulate(engine="numpy") or engine.fields.evaluate'
)
"""Advice in messages about mechanisms that cannot be written as expressions."""


def negated_operand(expression: Expr) -> Expr | None:
    """Return x if the expression is -1 * x, and None for any other expression."""
    if (
        isinstance(expression, ExpressionNode)
        and expression.operation == "*"
        and expression.arguments[0] == -1.0
    ):
        return expression.arguments[1]
    return None


def add(a: Expr, b: Expr) -> Expr:
    """Return a + b; zeros are dropped, and a + (-x) becomes a - x."""
    for first, second in ((a, b), (b, a)):
        if first == 0.0:
            return second
        operand = negated_operand(second)
        if operand is not None:
            return subtract(first, operand)
    return function("+", *_sort_arguments(a, b))


def subtract(a: Expr, b: Expr) -> Expr:
    """Return a - b; zeros are dropped, x - x is 0, and a - (-x) becomes a + x."""
    if a is b:
        return 0.0
    if b == 0.0:
        return a
    if a == 0.0:
        return multiply(-1.0, b)
    operand = negated_operand(b)
    return function("-", a, b) if operand is None else add(a, operand)


def multiply(a: Expr, b: Expr) -> Expr:
    """Return a * b; 0 * x becomes 0, 1 * x becomes x, and a * (-x) becomes -(a * x)."""
    for first, second in ((a, b), (b, a)):
        if first == 0.0:
            return 0.0
        if first == 1.0:
            return second
        operand = negated_operand(second)
        if operand is not None:
            if isinstance(first, ExpressionNode):
                return multiply(-1.0, multiply(first, operand))
            return multiply(-first, operand)
    return function("*", *_sort_arguments(a, b))


def divide(a: Expr, b: Expr) -> Expr:
    """Return a / b; 0 / b becomes 0, and a / 1 becomes a."""
    if a == 0.0 or b == 1.0:
        return a
    return function("/", a, b)


def _sort_arguments(a: Expr, b: Expr) -> list[Expr]:
    """Return the arguments of a sum or product in one order: numbers, then nodes by age.

    So a + b and b + a are stored as the same node.
    """
    return sorted(
        (a, b), key=lambda x: x.creation_index if isinstance(x, ExpressionNode) else -1
    )


_BinaryOperation = Callable[[Any, Any], Expr]


def _make_operator_methods(
    operation: _BinaryOperation,
) -> tuple[_BinaryOperation, _BinaryOperation]:
    """Return the two methods of a binary operator of nodes, such as + or *.

    For the operator +, the first method computes ``node + x`` and the second ``x + node``.
    Python calls the second method if x cannot add a node itself. If x is neither a number
    nor a node, such as a NumPy array, both methods return `NotImplemented`, so that Python
    uses the operator of x.

    Parameters
    ----------
    operation
        The function of two operands that computes the result, such as `add`.
    """

    def node_first(node: Any, operand: Any) -> Expr:
        """Return ``node + operand``."""
        return (
            operation(node, operand) if isinstance(operand, _OPERANDS) else NotImplemented
        )

    def node_second(node: Any, operand: Any) -> Expr:
        """Return ``operand + node``."""
        return (
            operation(operand, node) if isinstance(operand, _OPERANDS) else NotImplemented
        )

    return node_first, node_second


class ExpressionNode:
    """A variable, or an operation on numbers and other nodes, in a symbolic expression.

    Nodes are created by `symbols`, `function` and the operators ``+ - * /``. Two equal
    nodes are always one object, so an expression that occurs several times is stored once.
    The operators simplify products with 0 and 1, sums with 0, and x - x. They move minus
    signs out of products, and write a + (-b) as a - b. Finite values stay the same. The
    expressions 0 x, x - x and 0 / x become 0, even if x is later infinite or NaN, or the
    denominator is 0.

    Attributes
    ----------
    operation
        ``variable``, one of ``+ - * / **``, or the name of a function such as ``sin``.
    arguments
        The numbers and nodes on which the operation operates. For a variable, its name.
    creation_index
        Number of nodes that were created before this one.
    """

    __slots__ = ("__weakref__", "arguments", "creation_index", "operation")

    operation: str
    arguments: tuple[Any, ...]
    creation_index: int

    __add__, __radd__ = _make_operator_methods(add)
    __sub__, __rsub__ = _make_operator_methods(subtract)
    __mul__, __rmul__ = _make_operator_methods(multiply)
    __truediv__, __rtruediv__ = _make_operator_methods(divide)

    def __neg__(self) -> Expr:
        return multiply(-1.0, self)

    # NumPy calls these methods if a function such as np.sin is applied to an array of
    # nodes.

    def sin(self) -> "ExpressionNode":
        """Return the sine."""
        return function("sin", self)

    def cos(self) -> "ExpressionNode":
        """Return the cosine."""
        return function("cos", self)

    def sqrt(self) -> "ExpressionNode":
        """Return the square root."""
        return function("sqrt", self)


_OPERANDS = (ExpressionNode, float, int)

# All nodes in use, by operation and arguments. The weak references let nodes be deleted
# that no expression contains any more.
_nodes_by_key: WeakValueDictionary[tuple[Any, ...], ExpressionNode] = WeakValueDictionary()
_creation_counter = count()


def function(operation: str, *arguments: Any) -> ExpressionNode:
    """Return the node of an operation or function, without any simplification.

    A new node is created only if no node has this operation and these arguments. Two equal
    nodes are therefore always one object.

    Parameters
    ----------
    operation
        One of ``+ - * / **``, or the name of a function such as ``atan2``.
    arguments
        Numbers and nodes to which the operation is applied.
    """
    # The key has numbers as text. As floats, 0.0 and -0.0 would be the same key, but their
    # nodes have to differ. All numbers are converted to floats first, so that 2, 2.0 and
    # np.float64(2.0) have the same text.
    key = (operation, *map(_argument_key, arguments))
    node = _nodes_by_key.get(key)
    if node is None:
        node = ExpressionNode()
        node.operation = operation
        node.arguments = arguments
        node.creation_index = next(_creation_counter)
        _nodes_by_key[key] = node
    return node


def _argument_key(argument: Any) -> Any:
    """Return a node itself, the text of a number, or the name of a variable in quotes."""
    if isinstance(argument, ExpressionNode):
        return argument
    return repr(argument if isinstance(argument, str) else float(argument))


def symbols(names: Iterable[str]) -> list[ExpressionNode]:
    """Return one variable for each name; the same name is the same variable."""
    return [function("variable", name) for name in names]


def power(base: Expr, exponent: Expr) -> ExpressionNode:
    """Return base ** exponent."""
    return function("**", base, exponent)


def sign_of(expression: Expr) -> Expr:
    """Return the sign of an expression: -1, 0 or 1."""
    return function("sign", expression)


def dot(a: Iterable[Any], b: Iterable[Expr]) -> Any:
    """Return the sum of the products of two vectors, whose entries are added in order."""
    return sum((x * y for x, y in zip(a, b, strict=True)), 0.0)


def vector_product(operation: str, a: Expr, b: Expr) -> Expr:
    """Return the dot or cross product of two nodes that each represent a whole vector.

    A product with a zero vector is 0. Minus signs are moved outwards: (-a) . b becomes -(a
    . b). If a . b occurs as well, both then share one node, which is evaluated once.

    Parameters
    ----------
    operation
        ``dot`` or ``cross``.
    a, b
        Nodes that represent vectors, or 0.0 for a zero vector.
    """
    if 0.0 in (a, b):
        return 0.0
    negated_a = negated_operand(a)
    if negated_a is not None:
        return -1.0 * vector_product(operation, negated_a, b)
    negated_b = negated_operand(b)
    if negated_b is not None:
        return -1.0 * vector_product(operation, a, negated_b)
    return function(operation, a, b)


def has_variables(expression: Expr) -> bool:
    """Return whether an expression contains a variable."""
    return any(node.operation == "variable" for node in iterate_nodes([expression]))


def iterate_nodes(expressions: Sequence[Expr]) -> Iterator[ExpressionNode]:
    """Yield each node of some expressions once, after the nodes of its arguments.

    A node is a variable or an operation on other nodes and numbers. In this order, each
    node can be computed from nodes that were yielded before.
    """
    visited: set[ExpressionNode] = set()
    # Items are a node, and whether its arguments have been visited. A stack replaces
    # recursion, because deep graphs would exceed Python's limit.
    stack = [(expression, False) for expression in reversed(expressions)]
    while stack:
        node, are_arguments_visited = stack.pop()
        if not isinstance(node, ExpressionNode) or node in visited:
            continue
        if are_arguments_visited or node.operation == "variable":
            visited.add(node)
            yield node
            continue
        # The arguments are put on top of the stack, so this node is visited again after
        # them.
        stack.append((node, True))
        stack += [(argument, False) for argument in reversed(node.arguments)]


def rewrite(
    expressions: Sequence[Expr],
    convert_number: Callable[[float], Any],
    convert_node: Callable[[ExpressionNode, list[Any]], Any],
) -> list[Any]:
    """Return expressions converted to another form, such as text or derivatives.

    Each node is converted once, after its arguments, even if it occurs several times.

    Parameters
    ----------
    expressions
        Numbers and nodes.
    convert_number
        Returns the converted form of a number.
    convert_node
        Returns the converted form of a node. The function gets the node and its converted
        arguments; a variable has none.
    """
    converted: dict[ExpressionNode, Any] = {}

    def converted_form(expression: Expr) -> Any:
        """Return the converted form of a node, which is stored, or of a number."""
        if isinstance(expression, ExpressionNode):
            return converted[expression]
        return convert_number(float(expression))

    for node in iterate_nodes(expressions):
        arguments = []
        if node.operation != "variable":
            # Nodes are visited after their arguments, whose converted forms are stored.
            arguments = [converted_form(argument) for argument in node.arguments]
        converted[node] = convert_node(node, arguments)
    return [converted_form(expression) for expression in expressions]


def substitute(
    expressions: Sequence[Expr], replacements: Mapping[ExpressionNode, Expr]
) -> list[Expr]:
    """Return expressions in which some nodes are replaced by other expressions.

    Parameters
    ----------
    expressions
        Numbers, and nodes (variables or operations).
    replacements
        For each node to replace, the expression that takes its place.
    """
    # Functions that simplify, for example if a replacement is zero.
    operators = {"+": add, "-": subtract, "*": multiply, "/": divide}

    def convert_node(node: ExpressionNode, arguments: list[Any]) -> Expr:
        """Return the replacement of a node, or the node with replaced arguments."""
        if node in replacements or node.operation == "variable":
            return replacements.get(node, node)
        if node.operation in operators:
            return operators[node.operation](*arguments)
        # Other operations, such as sines, get a node with the same operation.
        return function(node.operation, *arguments)

    # Numbers are not replaced.
    return rewrite(expressions, convert_number=float, convert_node=convert_node)


def separate_constant_parts(
    expressions: Sequence[Expr], moving: Iterable[ExpressionNode]
) -> tuple[list[Expr], dict[ExpressionNode, ExpressionNode]]:
    """Replace the constant parts of expressions by new variables.

    A part is constant if it contains none of the nodes `moving`. It can be evaluated once
    for many values of these nodes. For example, the parts that depend only on the sizes of
    a design are evaluated once per design. The new variables are called design_0,
    design_1, ...

    Parameters
    ----------
    expressions
        Numbers, and nodes (variables or operations).
    moving
        Nodes with changing values.

    Returns
    -------
    replaced
        The expressions, in which new variables replace the constant parts. The parts are as
        large as possible.
    part_by_variable
        The part that each new variable replaces.
    """
    moving_nodes = set(moving)
    nodes = list(iterate_nodes(expressions))
    # Every operation on a moving node is moving.
    for node in nodes:  # arguments come first, so one pass is enough
        if any(x in moving_nodes for x in node.arguments if isinstance(x, ExpressionNode)):
            moving_nodes.add(node)

    # The largest constant parts are constant arguments of moving nodes, and constant whole
    # expressions. `dict.fromkeys` removes repetitions and keeps the order.
    arguments_of_moving_nodes = [
        x for node in nodes if node in moving_nodes for x in node.arguments
    ]
    constant_parts = dict.fromkeys(
        x
        for x in (*arguments_of_moving_nodes, *expressions)
        if isinstance(x, ExpressionNode) and x not in moving_nodes
    )
    variables = symbols(f"design_{k}" for k in range(len(constant_parts)))
    replaced = substitute(expressions, dict(zip(constant_parts, variables, strict=True)))
    return replaced, dict(zip(variables, constant_parts, strict=True))
