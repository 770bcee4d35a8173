"""Values of files as messages show them."""

from datetime import date

import pytest

from spherekit.errors import FileError
from spherekit.files.schema import check, mismatch, shown
from spherekit.files.toml_document import parse


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (["it's", True, {"a": 1}], '["it\'s", true, a table]'),
        ([10**5000], "[a huge integer]"),
        (date(2020, 1, 31), "2020-01-31"),
    ],
)
def test_values_are_shown_as_toml_text(value, text):
    assert shown(value) == text


def test_a_huge_integer_in_an_array_as_format_is_refused_with_its_line():
    document = parse(f"format = [0x{'F' * 5000}]", "x.toml")
    with pytest.raises(FileError, match=r"x.toml:1: format: found \[a huge integer\]"):
        check(document)


@pytest.mark.parametrize(
    ("value", "word"),
    [((1, 2), "array"), (None, "NoneType"), (date(2020, 1, 31), "date or time")],
)
def test_the_type_of_a_wrong_value_is_named(value, word):
    assert f"({word}), expected a number" in mismatch(value, "a number")
