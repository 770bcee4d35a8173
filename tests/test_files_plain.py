"""Parameters as JSON: the same in every process, whatever order a set has there."""

import json
from datetime import date

import numpy as np

from spherekit.files.toml_document import LiteralNumber
from spherekit.storage.json_data import as_json


def test_what_json_gives_back_is_what_was_given():
    value = {
        1: (1.5, np.float64(2.5), None, True),
        "names": frozenset({"b", "c", "a"}),
        "day": date(2026, 1, 2),
        "arc": LiteralNumber("1e1"),
    }
    made = as_json(value)
    assert made["names"] == ["a", "b", "c"] and made == json.loads(json.dumps(made))
    assert made["1"] == [1.5, 2.5, None, True]
    assert made["day"] == "datetime.date(2026, 1, 2)"
    assert type(made["arc"]) is float and made["arc"] == 10.0


def test_arrays_that_differ_in_any_entry_differ_as_json():
    """The `repr` of an array omits the last digits, and entries of long arrays."""
    values = np.linspace(0.0, 1.0, 2000)
    for row in (0, 1000):
        changed = values.copy()
        changed[row] += 1e-12
        assert as_json({"x": values}) != as_json({"x": changed})
    assert as_json(values.reshape(2, 1000)) == values.reshape(2, 1000).tolist()
