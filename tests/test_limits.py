"""Limits of numbers in files against the schema's own judgement of whole files."""

import numpy as np
import pytest

from spherekit.errors import SpherekitError
from spherekit.files.number_change import document_of, with_numbers
from spherekit.files.schema import check, check_numbers

NAMES = ("four_bar", "planetary_bevel", "shaped_cam", "two_contacts", "three_rrr")
TRIED = (0.0, -1.0, 0.5, 3.0, 1e5, -2e6, 1e99, 1e101, float("inf"), float("nan"))


def paths_of(value, path=()):
    """Yield where numbers stand in data."""
    if isinstance(value, dict | list):
        items = value.items() if isinstance(value, dict) else enumerate(value)
        for step, item in items:
            yield from paths_of(item, (*path, step))
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield path


def fits(judge, *given):
    """Return whether a document fits the format."""
    try:
        judge(*given)
    except SpherekitError:
        return False
    return True


@pytest.mark.many
@pytest.mark.parametrize("name", NAMES)
def test_limits_are_those_of_the_format(name):
    document = document_of(name)
    parts = [{table: document.data[table]} for table in ("links", "pairs", "mass", "loads")
             if table in document.data]  # fmt: skip
    rng = np.random.default_rng(2)
    every = [path for part in parts for path in paths_of(part)]
    for k in rng.permutation(len(every))[:8]:
        for number in TRIED:
            numbers = {every[k]: number}
            changed = with_numbers(document, numbers)
            judged = fits(check_numbers, changed, numbers)
            assert judged == fits(check, changed), numbers
