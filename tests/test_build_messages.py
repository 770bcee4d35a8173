"""Faults in data of `sk.build` are refused with the key, and without a line of a file."""

import numpy as np
import pytest

import spherekit as sk
from spherekit.errors import ModelError

PAIRS = {
    "a": {"links": ["1", "2"], "lonlat": [0, 90]},
    "b": {"links": ["2", "3"], "lonlat": [0, 45]},
}


def build(**changes):
    """Return an open chain of three links and two R pairs, with some arguments changed."""
    arguments = {
        "name": "chain",
        "angle_unit": "deg",
        "ground": "1",
        "links": ["1", "2", "3"],
        "pairs": PAIRS,
    }
    return sk.build(**{**arguments, **changes})


def refusal_message(**changes):
    """Return the message with which `sk.build` refuses changed arguments."""
    with pytest.raises(ModelError) as caught:
        build(**changes)
    return str(caught.value)


def test_data_with_two_forms_of_geometry_are_refused_without_a_line():
    message = refusal_message(links={"1": {}, "2": {"axes": ["a", "b"]}, "3": {}})
    assert "links.2.axes belongs to the dimensions, but" in message
    assert "line" not in message


def test_a_link_with_a_curve_and_a_follower_is_refused_without_a_line():
    contact = {
        "links": ["2", "3"],
        "type": "Cs",
        "profiles": {"2": {"kind": "circle", "radius": 20, "centre_xyz": [0, 0, 1]}},
        "follower": {"link": "2", "roller": 5, "centre_xyz": [0, 0, 1]},
    }
    message = refusal_message(pairs={**PAIRS, "c": contact})
    assert 'link "2" already has a curve in "profiles"; remove' in message


@pytest.mark.parametrize("text", ["90deg", "ab"])
def test_a_range_that_is_a_text_is_refused(text):
    message = refusal_message(inputs={"a": text})
    assert message.startswith(f'chain: inputs.a: found "{text}" (text), expected a table')


def test_a_range_that_is_an_array_without_dimensions_is_refused():
    message = refusal_message(inputs={"a": np.array(3.0)})
    assert message.startswith("chain: inputs.a: found 3.0 (number), expected a table")


def test_a_range_may_be_an_array():
    driven = build(inputs={"a": np.array([180, 0])}).inputs[0]
    assert (driven.start, driven.stop) == (np.pi, 0.0)


def test_an_output_by_an_axis_on_an_unknown_link_is_refused_with_the_links():
    message = refusal_message(outputs={"tool": {"link": "33", "axis": "b"}})
    expected = 'chain: outputs.tool.link: no link is named "33"; did you mean "3"? Links: '
    assert message.startswith(expected)
