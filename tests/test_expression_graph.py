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


def test_equal_terms_are_the_same_object():
    assert X + Y is Y + X and (X + Y) * Z is Z * (X + Y) and X - Y is not Y - X
    assert function("sin", X * 2.0) is function("sin", 2.0 * X) and symbols(["x"])[0] is X


def test_signs_move_outwards_and_zeros_and_ones_go():
    assert {0.0 + X, X - 0.0, 1.0 * X, X / 1.0, -(-1.0 * X)} == {X}
    assert {X * 0.0, X - X, 0.0 / X} == {0.0} and {0.0 - X} == {-X} and {X + -Y} == {X - Y}
    assert {-X + Y} == {Y - X} and {X - -Y} == {X + Y} and {2.0 * -X} == {-2.0 * X}
    assert {-X * Y} == {-(X * Y)} and {-X * -Y} == {X * Y}


@pytest.mark.slow
def test_terms_that_nothing_holds_are_forgotten():
    gc.collect()
    count = sum(isinstance(each, ExpressionNode) for each in gc.get_objects())
    made = sum((X * float(k) for k in range(2, 50)), Y)
    assert sum(isinstance(each, ExpressionNode) for each in gc.get_objects()) > count + 90
    del made
    gc.collect()
    assert sum(isinstance(each, ExpressionNode) for each in gc.get_objects()) == count


def test_a_term_comes_after_its_arguments_and_once():
    item = (X + Y) * function("sqrt", X + Y) - power(X + Y, 3.0)
    order = list(iterate_nodes([item, X + Y]))
    assert len(order) == len(set(order)) == 7
    for place, term in enumerate(order):
        for each in term.arguments:
            if isinstance(each, ExpressionNode):
                assert order.index(each) < place
    assert (
        has_variables(item)
        and not has_variables(function("sqrt", 2.0))
        and not has_variables(2.0)
    )


def random_expressions(count):
    """Return terms and, from the same choices, functions of three numbers."""
    random = np.random.default_rng(5)
    made = [(X, lambda p: p[0]), (Y, lambda p: p[1]), (Z, lambda p: p[2]), (-1.0, None)]
    made += [(each, None) for each in (0.0, 1.0, 2.5)]
    values = [f or (lambda p, c=c: c) for c, f in made]
    terms = [term for term, _ in made]
    pool = list(zip(terms, values, strict=True))
    for _ in range(count):
        (a, f), (b, g) = (pool[k] for k in random.integers(0, len(pool), 2))
        which = (operator.add, operator.sub, operator.mul)[random.integers(0, 3)]
        pool.append((which(a, b), lambda p, f=f, g=g, w=which: w(f(p), g(p))))
        if isinstance(pool[-1][0], ExpressionNode) and random.random() < 0.2:
            h = pool[-1][1]
            pool.append((function("sin", pool[-1][0]), lambda p, h=h: math.sin(h(p))))
    return pool


def test_values_on_arrays_are_those_of_numbers():
    pool = random_expressions(120)
    found = array_function([term for term, _ in pool], [X, Y, Z])
    points = np.random.default_rng(1).normal(size=(3, BLOCK_SAMPLES + 5))
    values = found(points)
    for column in (0, BLOCK_SAMPLES - 1, BLOCK_SAMPLES, BLOCK_SAMPLES + 4):
        expected = np.array([value(points[:, column]) for _, value in pool])
        gap = np.abs(values[:, column] - expected)
        assert np.max(gap / (1.0 + np.abs(expected))) < 1e-14


def test_terms_of_complex_variables():
    """Compiled by parts they are NumPy's complex ones, and others stand for variables."""
    pytest.importorskip("heyoka")
    sines = function("sin", X * Z) * Y / (function("cos", Y) + 3.0 * Z) - X
    made = [sines, (X - 2.0) / (Y * Y + Z), -function("cos", X + Y) + 1.5]
    rng = np.random.default_rng(3)
    x, y = rng.normal(size=(2, 50)) + 1j * rng.normal(size=(2, 50))
    z = rng.normal(size=50) + 4.0
    given = np.stack([x, y]), z[None]
    found = complex_function(made, [X, Y], [Z], True)(*given)
    sines = np.sin(x * z) * y / (np.cos(y) + 3.0 * z) - x
    expected = [sines, (x - 2.0) / (y * y + z), 1.5 - np.cos(x + y)]
    assert np.allclose(found, expected, rtol=1e-13, atol=0.0)
    swapped = array_function(substitute(made, {X: Y * Z, Y: X}), [X, Y, Z], complex)
    onward = complex_function(made, [X, Y], [Z], True)(np.stack([y * z, x]), z[None])
    assert np.allclose(swapped(np.stack([x, y, z])), onward, rtol=1e-13, atol=0.0)


def test_rates_of_terms_that_stand_for_what_they_are_made_of():
    # s = sin x and y run at rates of their own, whatever x does; z rests.
    s = function("sin", X)
    items = [s * Y / Z, function("sqrt", s * s + Y), X * s, Z + 2.0]
    rates = differentiate(items, {s: 3.0 * Y, Y: Z})
    found = array_function(rates, [X, Y, Z])(np.array([[0.4], [0.7], [1.3]]))[:, 0]
    sine, y, z = np.sin(0.4), 0.7, 1.3
    swing = (sine * 3.0 * y + 0.5 * z) / np.sqrt(sine**2 + y)
    expected = [(3.0 * y * y + sine * z) / z, swing, 0.4 * 3.0 * y, 0.0]
    assert np.max(np.abs(found - expected)) < 1e-15


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
    """The value is that without the turns, but where parts of angles need them."""
    whole, reduced, t = symbols(["whole", "reduced", "t"])
    named = {"theta_a": (whole, reduced), "t": (t, t)}
    value = convert_to_graph(parse(text, load_names(["a"])), named)
    turned = 0.7 + 2.0 * np.pi * turns
    run = array_function([value], [whole, reduced, t])
    assert abs(run(np.array([[turned], [0.7], [0.3]]))[0, 0] - expected) < 1e-14


@pytest.mark.parametrize("name", ["asin", "acos", "atan", "tanh", "exp"])
def test_functions_of_floats_and_of_arrays_have_the_same_values(name):
    outputs = [function(name, X), function("atan2", X, Y), power(Y, 2.0)]
    of_floats = float_function(outputs, [X, Y])([0.3, -0.4])
    of_arrays = array_function(outputs, [X, Y])(np.array([[0.3], [-0.4]]))[:, 0]
    expected = [getattr(math, name)(0.3), math.atan2(0.3, -0.4), 0.16]
    assert of_floats == pytest.approx(expected, rel=1e-15)
    assert of_arrays == pytest.approx(expected, rel=1e-15)
