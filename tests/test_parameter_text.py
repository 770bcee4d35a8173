"""Parameters of dataclasses that are read from texts of the command line."""

from dataclasses import dataclass, field

import pytest

import spherekit as sk
from spherekit.errors import AnalysisError
from spherekit.runs.parameter_text import describe_parameters, parse_fields


@dataclass
class Example:
    count: int = 1
    computed: int = field(default=3, init=False)


def test_a_parameter_that_is_given_twice_is_refused():
    with pytest.raises(AnalysisError, match='"count" is given twice'):
        parse_fields("count=1,count=2", Example, "example")
    with pytest.raises(AnalysisError, match='"only" is given twice'):
        sk.run("four_bar", "poles:only=21,only=41", samples=3)


def test_a_field_that_the_constructor_does_not_take_is_no_parameter():
    assert list(describe_parameters(Example)) == ["count"]
    with pytest.raises(AnalysisError, match='"computed" is not a parameter'):
        parse_fields("computed=4", Example, "example")
