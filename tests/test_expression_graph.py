"""Terms: sharing, what is simplified, and their values on arrays."""

import gc
import math
import operator

import numpy as np
import pytest

from spherekit.designs.path_kernel import complex_function
from spherekit.mechanism.load_expression import load_names, parse
from spherekit.symbolic.compiler import compile_function
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
    sign_of,
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


def test_equal_numbers_of_other_types_give_the_same_node():
    assert X * 2 is X * 2.0
    assert X + np.float64(2.5) is X + 2.5
    assert function("atan2", X, 0.0) is not function("atan2", X, -0.0)


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


@pytest.mark.parametrize("dtype", [np.int64, np.float32, bool])
def test_arguments_with_fewer_digits_are_evaluated_in_float64(dtype):
    """In its own type the square overflows or is rounded, and booleans have no sum."""
    numbers = np.array([[4_000_000_001, 1, 7]]).astype(dtype)
    values = array_function([X * X * X, X - Y], [X, Y])(np.vstack([numbers, numbers]))
    exact_numbers = numbers[0].astype(float)
    assert np.array_equal(values[0], exact_numbers * exact_numbers * exact_numbers)
    assert np.array_equal(values[1], np.zeros(3))


def test_zeros_of_both_signs_are_different_constants():
    """The angle of a point on the negative x axis is pi, also if its x is -0.0."""
    outputs = [function("atan2", X, 0.0), function("atan2", X, -0.0), -0.0, 0.0]
    expected = [0.0, math.pi, -0.0, 0.0]
    array_values = array_function(outputs, [X])(np.zeros((1, 1)))[:, 0]
    for values in (array_values, float_function(outputs, [X])([0.0])):
        assert np.array_equal(values, expected)
        assert np.array_equal(np.signbit(values), np.signbit(expected))


def test_a_constant_may_be_nan():
    assert np.isnan(array_function([X * np.float64("nan")], [X])(np.ones((1, 1))))


def test_compiled_signs_and_maxima_of_nan_are_nan_like_those_of_numpy():
    pytest.importorskip("heyoka")
    outputs = [function("maximum", X, Y), function("maximum", Y, X), function("sign", X)]
    points = np.array([[np.nan, 1.0, 2.0, -3.0, 0.0], [1.0, np.nan, -1.0, 4.0, 0.0]])
    expected = array_function(outputs, [X, Y])(points)
    assert np.isnan(expected[:, 0]).all()
    assert np.array_equal(
        compile_function(outputs, [X, Y])(points), expected, equal_nan=True
    )


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


@pytest.mark.parametrize("sign", [None, sign_of])
@pytest.mark.parametrize(
    ("text", "expected", "slope"),
    [("min(1e17*t, 3)", 3.0, 0.0), ("max(t*-1e17, t*2)", 1.0, 2.0)],
)
def test_the_larger_argument_adds_no_rounding_error_to_an_extremum(
    text, expected, slope, sign
):
    """The extremum is that of the two arguments to all digits, and so is its derivative."""
    (t,) = symbols(["t"])
    expression = convert_to_graph(parse(text, ["t"]), {"t": (t, t)}, sign)
    (rate,) = differentiate([expression], {t: 1.0})
    assert float_function([expression, rate], [t])([0.5]) == [expected, slope]


@pytest.mark.parametrize(
    "text", ["abs(0*t - 2)", "sign(t - t)", "max(1, 2, t)", "max(t, t)", "min(3, 4, t)"]
)
def test_signs_that_never_change_need_no_switch(text):
    """Only expressions with a variable have a sign that an integrator has to follow."""
    (t,) = symbols(["t"])
    conditions = []

    def sign(condition):
        conditions.append(condition)
        return sign_of(condition)

    law = parse(text, ["t"])
    expression = convert_to_graph(law, {"t": (t, t)}, sign)
    assert all(has_variables(condition) for condition in conditions)
    value = array_function([expression], [t])(np.array([[0.5]]))[0, 0]
    assert value == law.evaluate({"t": 0.5})


@pytest.mark.parametrize("name", ["asin", "acos", "atan", "tanh", "exp"])
def test_functions_of_floats_and_of_arrays_have_the_values_of_the_math_module(name):
    outputs = [function(name, X), function("atan2", X, Y), power(Y, 2.0)]
    x, y = 0.3, -0.4
    float_values = float_function(outputs, [X, Y])([x, y])
    array_values = array_function(outputs, [X, Y])(np.array([[x], [y]]))[:, 0]
    expected = [getattr(math, name)(x), math.atan2(x, y), 0.16]
    assert float_values == pytest.approx(expected, rel=1e-15)
    assert array_values == pytest.approx(expected, rel=1e-15)
