"""Evaluation of symbolic expressions on NumPy arrays and on floats, without a compiler.

Arrays are evaluated in blocks of samples that fit into the cache of the processor. Each
operation is one NumPy call for a whole block. It writes into a row of a small work
array whose content is no longer used, so no memory is allocated in between.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from spherekit.arrays import Array
from spherekit.symbolic.expression_graph import Expr, ExpressionNode, iterate_nodes

BLOCK_SAMPLES = 8192
"""Number of samples that are evaluated together.

Larger: the work array no longer fits into the cache. Smaller: the time of the NumPy calls
dominates.
"""

_NUMPY_NAMES = {
    "+": "add",
    "-": "subtract",
    "*": "multiply",
    "/": "divide",
    "**": "power",
}
"""NumPy's names of the operations that have other names in NumPy."""

_INFIX_OPERATIONS = ("+", "-", "*", "/", "positive")
"""Operations that Python code writes between, or before, their arguments."""

ArrayFunction = Callable[..., Array]
"""A function of an array (inputs, n) that returns an array (outputs, n).

The second argument, if there is one, is the array to which the result is written.
"""

FloatFunction = Callable[[Sequence[float]], list[float]]
"""A function of a list of inputs that returns the list of outputs."""


def array_function(
    outputs: Sequence[Expr], inputs: Sequence[ExpressionNode], number: type[Any] = float
) -> ArrayFunction:
    """Return a function that evaluates expressions on arrays.

    Parameters
    ----------
    outputs
        Expressions that contain no other variables than the inputs.
    inputs
        Variables, in the order of the rows of the argument.
    number
        Type of numbers with which to compute. An argument whose type has more digits is
        evaluated in its own type. A complex argument is evaluated in complex numbers.
    """
    # The operations are a list that a loop processes.
    program = _write_program(outputs, inputs)
    names = [
        *program.constants,
        *program.input_names,
        *program.output_names,
        *program.work_names,
    ]
    row_of_name = {name: row for row, name in enumerate(names)}
    # All values are rows of arrays, in the order of `names`. An operation has a NumPy
    # function, the rows of its first and second argument (None without a second), and the
    # row of its result.
    operations: list[tuple[Callable[..., Any], int, int | None, int]] = []
    for step in program.steps:
        name = _NUMPY_NAMES.get(step.operation, step.operation)
        ufunc = _write_maximum if name == "maximum" else getattr(np, name)
        argument_rows = [row_of_name[argument] for argument in step.arguments]
        second_row = argument_rows[1] if len(argument_rows) == 2 else None
        operations.append((ufunc, argument_rows[0], second_row, row_of_name[step.result]))
    work_row_count = len(program.work_names)

    # Cached for the two number types that are common: float64 and one with more digits.
    @lru_cache(2)
    def constant_rows(dtype: Any) -> list[Array]:
        """Return the constants as rows (1,) of a number type."""
        return [*np.array([*program.constants.values()], dtype=dtype)[:, None]]

    def evaluate(inputs_array: Array, out: Array | None = None) -> Array:
        """Return the values (outputs, n) of all expressions at n samples of the inputs.

        Parameters
        ----------
        inputs_array
            (inputs, n) values of the input variables.
        out
            Array (outputs, n) to write to; a new one by default.
        """
        # The type of the inputs, or the type `number` that the caller of `array_function`
        # has chosen, if that type has more digits.
        dtype = np.result_type(inputs_array, number)
        # NumPy would compute products of integers or of float32 in their own type.
        inputs_array = np.asarray(inputs_array, dtype=dtype)
        sample_count = inputs_array.shape[1]
        if out is None:
            out = np.empty((len(outputs), sample_count), dtype=dtype)
        work = np.empty((work_row_count, min(sample_count, BLOCK_SAMPLES)), dtype=dtype)
        with np.errstate(all="ignore"):
            for start in range(0, sample_count, BLOCK_SAMPLES):
                block = slice(start, start + BLOCK_SAMPLES)
                work_block = work[:, : sample_count - start]
                # The `operations` have the numbers of rows in this list: constants, inputs,
                # outputs, intermediate values. Inputs, outputs and intermediate values are
                # views of one block of samples.
                rows = [
                    *constant_rows(dtype),
                    *inputs_array[:, block],
                    *out[:, block],
                    *work_block,
                ]
                # An operation with one argument has no second row.
                for ufunc, first, second, result in operations:
                    if second is None:
                        ufunc(rows[first], rows[result])
                    else:
                        ufunc(rows[first], rows[second], rows[result])
        return out

    return evaluate


def _write_maximum(a: Array, b: Array, result: Array) -> None:
    """Write the maximum of two arrays to a third one.

    `array_function` calls each NumPy function with the output array as last argument.
    `np.maximum` deprecates this, so this function passes the array by name.
    """
    np.maximum(a, b, out=result)


def _float_maximum(a: float, b: float) -> float:
    """Return the larger of two numbers, or NaN if either is NaN, like NumPy's maximum."""
    # Only NaN differs from itself. If b is NaN, both comparisons are false.
    if a >= b or a != a:
        return a
    return b


def float_function(
    outputs: Sequence[Expr], inputs: Sequence[ExpressionNode]
) -> FloatFunction:
    """Return a function that evaluates symbolic expressions on floats, for one sample.

    The expressions become Python code, which is compiled. For one sample the code takes at
    most about a tenth of the time of an `array_function`. If an operation has no finite
    result, the function may raise `ArithmeticError` or `ValueError`.

    Parameters
    ----------
    outputs
        Expressions that contain no other variables than the inputs.
    inputs
        Variables, in the order of the argument of the function.
    """
    # The operations in order, with a name for each input, constant and result.
    program = _write_program(outputs, inputs)
    # The body of a Python function with one line per operation, which is then compiled.
    lines = [f"[{', '.join(program.input_names)}] = input_values"]
    for step in program.steps:
        if step.operation in _INFIX_OPERATIONS:
            code = f" {step.operation} ".join(step.arguments)
        else:
            # Other operations have the names of functions, such as "sin". The name of "**"
            # is "power".
            name = "power" if step.operation == "**" else step.operation
            code = f"{name}({', '.join(step.arguments)})"
        lines.append(f"{step.result} = {code}")
    lines.append(f"return [{', '.join(program.output_names)}]")
    # All names that occur in the code: functions by name, and constants.
    namespace: dict[str, Any] = {
        **vars(math),
        # `math` has no functions with these three names.
        "power": math.pow,
        "maximum": _float_maximum,
        "sign": lambda a: np.sign(a).item(),
        **program.constants,
    }
    exec("\n    ".join(["def evaluate(input_values):", *lines]), namespace)
    evaluate: FloatFunction = namespace["evaluate"]
    return evaluate


@dataclass(frozen=True)
class _ProgramStep:
    """One operation of a program that evaluates symbolic expressions step by step.

    Attributes
    ----------
    operation
        Operation of an `ExpressionNode`, such as ``sin``. The additional operation
        ``positive`` copies a value. An output is copied if it is just a constant, an input
        or another output.
    arguments
        Names of the values on which the step operates.
    result
        Name of the value that the step computes. The name of an earlier value can be used
        again if that value is no longer needed.
    """

    operation: str
    arguments: Sequence[str]
    result: str


@dataclass(frozen=True)
class _Program:
    """Expressions as a sequence of operations on named values.

    Functions that evaluate the expressions, on arrays or on single numbers, are made from
    it.

    Attributes
    ----------
    steps
        The operations, in an order in which they can be executed.
    constants
        Numbers in the expressions, by name (c0, c1, ...).
    input_names, output_names
        Names of the inputs (x0, x1, ...) and of the outputs (y0, y1, ...).
    work_names
        Names of intermediate values (z0, z1, ...). A name is used again after the last step
        that reads its value.
    """

    steps: Sequence[_ProgramStep]
    constants: Mapping[str, float]
    input_names: Sequence[str]
    output_names: Sequence[str]
    work_names: Sequence[str]


def _write_program(outputs: Sequence[Expr], inputs: Sequence[ExpressionNode]) -> _Program:
    """Return expressions as a sequence of operations on named values.

    Each node (operation) of the expressions is computed once. Names of intermediate values
    are used again as soon as possible, so that few rows of work memory are needed.

    Parameters
    ----------
    outputs
        Numbers and nodes to compute.
    inputs
        The variables in them.
    """
    nodes = [node for node in iterate_nodes(outputs) if node.operation != "variable"]
    # The last step that reads each value: later steps replace the entries of earlier ones.
    # There is one step for each node.
    last_step_reading: dict[Any, int] = {}
    for step_number, node in enumerate(nodes):
        for argument in node.arguments:
            last_step_reading[argument] = step_number

    # Names of numbers (c0, c1, ...), inputs (x0, ...) and outputs (y0, ...). An output that
    # is a number, an input or an earlier output has a name already and keeps it.
    values = [*(x for node in nodes for x in node.arguments), *outputs]
    number_by_key = {
        _value_key(x): float(x) for x in values if not isinstance(x, ExpressionNode)
    }
    name_of: dict[Any, str] = {key: f"c{k}" for k, key in enumerate(number_by_key)}
    constants = {name_of[key]: number for key, number in number_by_key.items()}
    input_names = [f"x{k}" for k in range(len(inputs))]
    name_of |= zip(inputs, input_names, strict=True)
    output_names = [f"y{k}" for k in range(len(outputs))]
    for output, output_name in zip(outputs, output_names, strict=True):
        name_of.setdefault(_value_key(output), output_name)

    # One step per node. Intermediate values have names z0, z1, ... `free_names` has the
    # names of values that no later step reads.
    steps = list[_ProgramStep]()
    free_names = list[str]()
    # A dictionary, because it keeps the order and finds a name quickly.
    work_names = dict[str, None]()
    for k, node in enumerate(nodes):
        arguments = [name_of[_value_key(x)] for x in node.arguments]
        # The result may overwrite an argument that no later step reads.
        names_read_last = dict.fromkeys(
            name_of[x]
            for x in node.arguments
            if isinstance(x, ExpressionNode) and last_step_reading[x] == k
        )
        free_names += [name for name in names_read_last if name in work_names]
        # Results that are no outputs take a free name or a new one.
        if node not in name_of:
            if free_names:
                name_of[node] = free_names.pop()
            else:
                new_name = f"z{len(work_names)}"
                work_names[new_name] = None
                name_of[node] = new_name
        steps.append(_ProgramStep(node.operation, arguments, name_of[node]))
    # Numbers, inputs and repeated outputs have another name and are copied.
    for output, output_name in zip(outputs, output_names, strict=True):
        name = name_of[_value_key(output)]
        if name != output_name:
            steps.append(_ProgramStep("positive", [name], output_name))
    return _Program(
        steps=steps,
        constants=constants,
        input_names=input_names,
        output_names=output_names,
        work_names=[*work_names],
    )


def _value_key(value: Expr) -> Any:
    """Return a node itself, and the text of a number.

    0.0 and -0.0 are equal but different numbers, and NaN does not equal itself.
    """
    return value if isinstance(value, ExpressionNode) else repr(float(value))
