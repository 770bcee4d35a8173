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
MEANT = {name: getattr(np, name) for name in ARGUMENT_COUNTS if hasattr(np, name)} | {
    "pi": math.pi,
    "min": lambda *each: functools.reduce(np.minimum, each),
    "max": lambda *each: functools.reduce(np.maximum, each),
}


@pytest.mark.parametrize("text", re.split("; |\n", TEXTS))
def test_values(text):
    """As Python and NumPy have them; functions of floats agree with those of arrays."""
    expression = parse(text, NAMES)
    with np.errstate(all="ignore"):
        expected = eval(text.strip(), MEANT, VALUES)
    result = expression.evaluate(VALUES)
    np.testing.assert_allclose(result, expected, rtol=4e-16, atol=1e-16)
    names = ("t", "theta_21", "dtheta_21")
    call = expression_as_function(expression, names)
    for row in itertools.product((-2.0, 0.0, 0.7), repeat=3):
        want = expression.evaluate(dict(zip(names, row, strict=True)))
        try:
            np.testing.assert_allclose(call(row), want, rtol=1e-15, err_msg=f"{row}")
        except (ValueError, ArithmeticError):
            assert not np.isfinite(want)


def test_names_used_and_missing():
    assert parse("sin(theta_21) + pi*t", NAMES).names == {"theta_21", "t"}
    assert parse("5", NAMES).names == frozenset()
    (divisor,) = parse(
        "t/theta_21", NAMES
    ).steep_arguments  # where values change all at once
    assert divisor.names == {"theta_21"}
    result = parse("5", NAMES).evaluate({"t": np.zeros((4, 2))})
    assert result.shape == (4, 2) and (result == 5.0).all()
    assert parse("5", NAMES).evaluate({}).shape == ()
    with pytest.raises(ModelError, match="give a value for dtheta_21, t"):
        parse("t + dtheta_21", NAMES).evaluate({"theta_21": 1.0})


@pytest.mark.parametrize("text", TABLES["expressions"])
def test_nothing_else_gets_through(text):
    with pytest.raises(ModelError) as caught:
        parse(text, NAMES)
    check_fragments(str(caught.value), TABLES["expressions"][text])


def test_deep_and_long_expressions_are_refused_and_ordinary_sums_are_not():
    deep = "(" * 500 + "t" + ")" * 500, "sin(" * 180 + "t" + ")" * 180, "-" * 1900 + "t"
    for text in (*deep, "+".join(["t"] * 900), "**".join(["2"] * 600)):
        assert len(text) <= MAX_LENGTH
        with pytest.raises(ModelError, match="column"):
            parse(text, NAMES)
    with pytest.raises(ModelError, match=f"at most {MAX_LENGTH} are allowed"):
        parse("1" * (MAX_LENGTH + 1), NAMES)
    series = " + ".join(f"0.5*sin({k}*theta_21)" for k in range(80))
    assert parse(series, NAMES).names == {"theta_21"}
    ones = "+".join(["1"] * (MAX_DEPTH - 1))
    assert parse(ones, ()).evaluate({}) == MAX_DEPTH - 1
