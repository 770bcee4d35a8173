"""Limits of numbers in files against the schema's own judgement of whole files."""

import numpy as np
import pytest

from spherekit.errors import SpherekitError
from spherekit.files.number_change import document_of, with_numbers
from spherekit.files.schema import check, check_numbers

MECHANISM_NAMES = ("four_bar", "planetary_bevel", "shaped_cam", "two_contacts", "three_rrr")
TRIED_NUMBERS = (0.0, -1.0, 0.5, 3.0, 1e5, -2e6, 1e99, 1e101, float("inf"), float("nan"))


def number_paths(value, path=()):
    """Yield the key paths (keys and indices) of all numbers in nested data."""
    if isinstance(value, dict | list):
        items = value.items() if isinstance(value, dict) else enumerate(value)
        for key, item in items:
            yield from number_paths(item, (*path, key))
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield path


def passes(check_function, *arguments):
    """Return whether a check raises no error."""
    try:
        check_function(*arguments)
    except SpherekitError:
        return False
    return True


@pytest.mark.many
@pytest.mark.parametrize("name", MECHANISM_NAMES)
def test_the_fast_check_of_changed_numbers_agrees_with_the_check_of_the_file(name):
    """The fast check of changed numbers accepts the same numbers as the check of a file.

    `check_numbers` looks only at the changed entries; `check` validates the whole document
    against the schema. Eight random numbers of a shipped file are each replaced by ten
    others.
    """
    document = document_of(name)
    paths = []
    for table in ("links", "pairs", "mass", "loads"):
        if table in document.data:
            paths += number_paths({table: document.data[table]})
    random = np.random.default_rng(2)
    for k in random.permutation(len(paths))[:8]:
        for number in TRIED_NUMBERS:
            numbers = {paths[k]: number}
            changed = with_numbers(document, numbers)
            passes_fast_check = passes(check_numbers, changed, numbers)
            assert passes_fast_check == passes(check, changed), numbers
