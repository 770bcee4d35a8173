"""Torque expressions: what they compute, and that nothing else gets through."""

import functools
import itertools
import math
import re

import numpy as np
import pytest
from helpers.expressions import expression_as_function
from helpers.refusals import TABLES, check_fragments

from spherekit.errors import ModelError
from spherekit.mechanism.load_expression import (
    ARGUMENT_COUNTS,
    MAX_DEPTH,
    MAX_LENGTH,
    load_names,
    parse,
)

NAMES = load_names(["21", "41"])
VALUES = {
    "theta_21": np.array([0.3, -0.7, 0.9]),
    "dtheta_21": np.array([1.5, 2.5, -0.5]),
    "t": np.array([0.0, 1.0, 2.0]),
}


TEXTS = """\
-sin(theta_21) - 2*dtheta_21; 2 + 3 * t ** 2; -t**2; 2**-1**2; 2**3**2 - 6/3/2
(1 + t)*(1 - t); 1 - 2 - 3; +t; tan(theta_21)+asin(theta_21); acos(theta_21)*atan(t)
atan2(dtheta_21, theta_21); sqrt(t) + exp(-t) + log(1+t); abs(theta_21)*sign(dtheta_21)
-0.2*tanh(dtheta_21/1e-2); min(theta_21, t, 0.5); max(theta_21, t); cos(pi*t); \t t  + 1
2*t - -theta_21/3 + 1; t**2 + abs(dtheta_21)*sign(theta_21); sqrt(t) + log(t) + asin(t)
min(t, theta_21, 1) + max(t, dtheta_21); sin(t) + cos(t)*tan(t) + tanh(t) + exp(t)
1/theta_21 + theta_21**(0-1); exp(1000*t) - theta_21**0.5; pi"""
PYTHON_NAMES = {name: getattr(np, name) for name in ARGUMENT_COUNTS if hasattr(np, name)}
PYTHON_NAMES |= {
    "pi": math.pi,
    "min": lambda *values: functools.reduce(np.minimum, values),
    "max": lambda *values: functools.reduce(np.maximum, values),
}
"""Names of the language of loads, with their meaning in NumPy and Python."""


@pytest.mark.parametrize("text", re.split("; |\n", TEXTS))
def test_expressions_have_the_values_of_python_and_numpy(text):
    """The text itself is evaluated by `eval`, with the functions of NumPy."""
    expression = parse(text, NAMES)
    with np.errstate(all="ignore"):
        expected = eval(text.strip(), PYTHON_NAMES, VALUES)
    values = expression.evaluate(VALUES)
    np.testing.assert_allclose(values, expected, rtol=4e-16, atol=1e-16)


@pytest.mark.parametrize("text", re.split("; |\n", TEXTS))
def test_functions_of_floats_have_the_values_of_arrays(text):
    """Where a function of floats raises an error, the array has no finite value."""
    expression = parse(text, NAMES)
    names = ("t", "theta_21", "dtheta_21")
    evaluate_floats = expression_as_function(expression, names)
    for floats in itertools.product((-2.0, 0.0, 0.7), repeat=3):
        expected = expression.evaluate(dict(zip(names, floats, strict=True)))
        try:
            value = evaluate_floats(floats)
            np.testing.assert_allclose(value, expected, rtol=1e-15, err_msg=f"{floats}")
        except (ValueError, ArithmeticError):
            assert not np.isfinite(expected)


def test_an_expression_lists_the_names_that_it_uses():
    assert parse("sin(theta_21) + pi*t", NAMES).names == {"theta_21", "t"}
    assert parse("5", NAMES).names == frozenset()


def test_a_divisor_is_an_argument_at_which_values_may_jump():
    (divisor,) = parse("t/theta_21", NAMES).steep_arguments
    assert divisor.names == {"theta_21"}


def test_a_constant_has_the_shape_of_the_given_values():
    values = parse("5", NAMES).evaluate({"t": np.zeros((4, 2))})
    assert values.shape == (4, 2)
    assert (values == 5.0).all()
    assert parse("5", NAMES).evaluate({}).shape == ()


def test_evaluating_without_all_values_names_the_missing_ones():
    with pytest.raises(ModelError, match="give a value for dtheta_21, t"):
        parse("t + dtheta_21", NAMES).evaluate({"theta_21": 1.0})


@pytest.mark.parametrize("text", TABLES["expressions"])
def test_texts_outside_the_language_of_loads_are_refused(text):
    with pytest.raises(ModelError) as caught:
        parse(text, NAMES)
    check_fragments(str(caught.value), TABLES["expressions"][text])


@pytest.mark.parametrize(
    "text",
    [
        "(" * 500 + "t" + ")" * 500,
        "sin(" * 180 + "t" + ")" * 180,
        "-" * 1900 + "t",
        "+".join(["t"] * 900),
        "**".join(["2"] * 600),
    ],
    ids=["parentheses", "sines", "signs", "sum", "powers"],
)
def test_deeply_nested_expressions_are_refused(text):
    """Each text is short enough but would need a deep recursion."""
    assert len(text) <= MAX_LENGTH
    with pytest.raises(ModelError, match="column"):
        parse(text, NAMES)


def test_the_message_about_an_empty_expression_does_not_call_it_a_torque():
    """Conditions and figures of merit are expressions too."""
    with pytest.raises(ModelError, match="^column 1: the expression is empty$"):
        parse("  ", NAMES)


def test_long_expressions_are_refused():
    with pytest.raises(ModelError, match=f"at most {MAX_LENGTH} are allowed"):
        parse("1" * (MAX_LENGTH + 1), NAMES)


def test_sums_up_to_the_allowed_depth_are_evaluated():
    series = " + ".join(f"0.5*sin({k}*theta_21)" for k in range(80))
    assert parse(series, NAMES).names == {"theta_21"}
    ones = "+".join(["1"] * (MAX_DEPTH - 1))
    assert parse(ones, ()).evaluate({}) == MAX_DEPTH - 1
