"""Terms: sharing, what is simplified, and their values on arrays."""

import gc
import math
import operator

import numpy as np
import pytest

from spherekit.designs.path_kernel import complex_function
from spherekit.mechanism.load_expression import load_names, parse
from spherekit.symbolic.expression_derivatives import differentiate
from spherekit.symbolic.expression_evaluation import (
    BLOCK_SAMPLES,
    array_function,
    float_function,
)
from spherekit.symbolic.expression_graph import (
    ExpressionNode,
    function,
    has_variables,
    iterate_nodes,
    power,
    substitute,
    symbols,
)
from spherekit.symbolic.parsed_expressions import convert_to_graph

X, Y, Z = symbols(["x", "y", "z"])


def test_equal_expressions_are_the_same_object():
    """Sums and products are also shared in the other order of their arguments."""
    assert X + Y is Y + X
    assert (X + Y) * Z is Z * (X + Y)
    assert X - Y is not Y - X
    assert function("sin", X * 2.0) is function("sin", 2.0 * X)
    assert symbols(["x"])[0] is X


def test_sums_and_products_with_zero_and_one_are_simplified():
    assert {0.0 + X, X - 0.0, 1.0 * X, X / 1.0, -(-1.0 * X)} == {X}
    assert {X * 0.0, X - X, 0.0 / X} == {0.0}


def test_signs_move_to_the_outside_of_sums_and_products():
    assert {0.0 - X} == {-X}
    assert {X + -Y} == {X - Y}
    assert {-X + Y} == {Y - X}
    assert {X - -Y} == {X + Y}
    assert {2.0 * -X} == {-2.0 * X}
    assert {-X * Y} == {-(X * Y)}
    assert {-X * -Y} == {X * Y}


def count_nodes():
    """Return the number of expression nodes in memory."""
    return sum(isinstance(item, ExpressionNode) for item in gc.get_objects())


@pytest.mark.slow
def test_expressions_without_references_are_freed():
    """The table of shared expressions holds weak references only."""
    gc.collect()
    count_before = count_nodes()
    expression = sum((X * float(k) for k in range(2, 50)), Y)
    assert count_nodes() > count_before + 90
    del expression
    gc.collect()
    assert count_nodes() == count_before


def test_nodes_are_listed_once_each_after_their_arguments():
    """The expression has 7 nodes: X, Y, X + Y, its root, its cube, product, difference."""
    expression = (X + Y) * function("sqrt", X + Y) - power(X + Y, 3.0)
    order = list(iterate_nodes([expression, X + Y]))
    assert len(order) == len(set(order)) == 7
    for position, node in enumerate(order):
        for argument in node.arguments:
            if isinstance(argument, ExpressionNode):
                assert order.index(argument) < position


def test_expressions_of_numbers_alone_have_no_variables():
    assert has_variables((X + Y) * function("sqrt", X + Y) - power(X + Y, 3.0))
    assert not has_variables(function("sqrt", 2.0))
    assert not has_variables(2.0)


def random_expressions(count):
    """Return pairs of a random symbolic expression of X, Y, Z and a plain Python function.

    The function takes a point (3,) and computes the same operations on floats, as a
    reference. Each of `count` steps adds, subtracts or multiplies two earlier pairs, and
    sometimes appends the sine of the result.
    """

    def constant_function(value):
        return lambda point: value

    def combined_function(operation, first, second):
        return lambda point: operation(first(point), second(point))

    def sine_function(argument):
        return lambda point: math.sin(argument(point))

    random = np.random.default_rng(5)
    pairs = [
        (X, lambda point: point[0]),
        (Y, lambda point: point[1]),
        (Z, lambda point: point[2]),
    ]
    pairs += [(value, constant_function(value)) for value in (-1.0, 0.0, 1.0, 2.5)]
    for _ in range(count):
        first_number, second_number = random.integers(0, len(pairs), 2)
        first, first_function = pairs[first_number]
        second, second_function = pairs[second_number]
        operation = (operator.add, operator.sub, operator.mul)[random.integers(0, 3)]
        result = operation(first, second)
        result_function = combined_function(operation, first_function, second_function)
        pairs.append((result, result_function))
        if isinstance(result, ExpressionNode) and random.random() < 0.2:
            pairs.append((function("sin", result), sine_function(result_function)))
    return pairs


def test_values_of_random_expressions_on_arrays_are_those_of_python_floats():
    """Arrays are evaluated in blocks, so the samples at the ends of blocks are compared."""
    pairs = random_expressions(120)
    evaluate = array_function([expression for expression, _ in pairs], [X, Y, Z])
    points = np.random.default_rng(1).normal(size=(3, BLOCK_SAMPLES + 5))
    values = evaluate(points)  # (expressions, samples)
    for sample in (0, BLOCK_SAMPLES - 1, BLOCK_SAMPLES, BLOCK_SAMPLES + 4):
        expected = np.array([compute(points[:, sample]) for _, compute in pairs])
        error = np.abs(values[:, sample] - expected)
        assert np.max(error / (1.0 + np.abs(expected))) < 1e-14


def complex_expressions_and_points():
    """Return three expressions of X, Y (complex) and Z (real), and 50 values of each."""
    expressions = [
        function("sin", X * Z) * Y / (function("cos", Y) + 3.0 * Z) - X,
        (X - 2.0) / (Y * Y + Z),
        -function("cos", X + Y) + 1.5,
    ]
    random = np.random.default_rng(3)
    x, y = random.normal(size=(2, 50)) + 1j * random.normal(size=(2, 50))
    z = random.normal(size=50) + 4.0
    return expressions, x, y, z


def test_compiled_expressions_of_complex_variables_have_the_values_of_numpy():
    """The compiler knows real numbers only: real and imaginary parts are compiled."""
    pytest.importorskip("heyoka")
    expressions, x, y, z = complex_expressions_and_points()
    values = complex_function(expressions, [X, Y], [Z], True)(np.stack([x, y]), z[None])
    expected = [
        np.sin(x * z) * y / (np.cos(y) + 3.0 * z) - x,
        (x - 2.0) / (y * y + z),
        1.5 - np.cos(x + y),
    ]
    assert np.allclose(values, expected, rtol=1e-13, atol=0.0)


def test_substitution_replaces_all_variables_at_once():
    """X becomes Y Z while Y becomes X, as if values were replaced before evaluation."""
    pytest.importorskip("heyoka")
    expressions, x, y, z = complex_expressions_and_points()
    substituted = substitute(expressions, {X: Y * Z, Y: X})
    values = array_function(substituted, [X, Y, Z], complex)(np.stack([x, y, z]))
    evaluate = complex_function(expressions, [X, Y], [Z], True)
    expected = evaluate(np.stack([y * z, x]), z[None])
    assert np.allclose(values, expected, rtol=1e-13, atol=0.0)


def test_expressions_with_a_stated_rate_are_differentiated_like_variables():
    """Expressions are differentiated by time, with some rates by time stated.

    The rate of s = sin x is stated as 3 y, and that of y as z. All other variables are
    constant: z, and also x wherever it is not part of s. The expected derivatives are
    computed by hand at x = 0.4, y = 0.7, z = 1.3.
    """
    s = function("sin", X)
    expressions = [s * Y / Z, function("sqrt", s * s + Y), X * s, Z + 2.0]
    rates = differentiate(expressions, {s: 3.0 * Y, Y: Z})
    x, y, z = 0.4, 0.7, 1.3
    values = array_function(rates, [X, Y, Z])(np.array([[x], [y], [z]]))[:, 0]
    sine = np.sin(x)
    expected = [
        (3.0 * y * y + sine * z) / z,
        (sine * 3.0 * y + 0.5 * z) / np.sqrt(sine**2 + y),
        x * 3.0 * y,
        0.0,
    ]
    assert np.max(np.abs(values - expected)) < 1e-15


@pytest.mark.parametrize(
    ("text", "turns", "expected"),
    [
        ("sin(theta_a + 0.5*t)", 1e7, np.sin(0.7 + 0.15)),
        ("cos(2*theta_a - sin(theta_a))", 1e7, np.cos(1.4 - np.sin(0.7))),
        ("tan(-3*theta_a)", 1e7, np.tan(-2.1)),
        ("sin(t*2 + cos(-theta_a))", 1e7, np.sin(0.6 + np.cos(0.7))),
        ("sin(0.5*theta_a)", 1.0, np.sin(0.35 + np.pi)),
    ],
)
def test_sines_of_angles_after_many_turns_keep_their_digits(text, turns, expected):
    """The angle theta_a is 0.7 rad plus whole turns; t is 0.3.

    An angle is passed twice, with its turns and reduced to one turn. Sines of whole
    multiples use the reduced angle, whose digits are not lost to the turns. Half an angle
    needs the turns.
    """
    whole, reduced, t = symbols(["whole", "reduced", "t"])
    symbols_by_name = {"theta_a": (whole, reduced), "t": (t, t)}
    expression = convert_to_graph(parse(text, load_names(["a"])), symbols_by_name)
    evaluate = array_function([expression], [whole, reduced, t])
    whole_angle = 0.7 + 2.0 * np.pi * turns
    value = evaluate(np.array([[whole_angle], [0.7], [0.3]]))[0, 0]
    assert abs(value - expected) < 1e-14


@pytest.mark.parametrize("name", ["asin", "acos", "atan", "tanh", "exp"])
def test_functions_of_floats_and_of_arrays_have_the_values_of_the_math_module(name):
    outputs = [function(name, X), function("atan2", X, Y), power(Y, 2.0)]
    x, y = 0.3, -0.4
    float_values = float_function(outputs, [X, Y])([x, y])
    array_values = array_function(outputs, [X, Y])(np.array([[x], [y]]))[:, 0]
    expected = [getattr(math, name)(x), math.atan2(x, y), 0.16]
    assert float_values == pytest.approx(expected, rel=1e-15)
    assert array_values == pytest.approx(expected, rel=1e-15)
