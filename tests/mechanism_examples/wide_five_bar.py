"""The shipped five-bar with wider ranges of its inputs, half of which is out of reach.

Both inputs are 40 to 140 degrees. With the narrower ranges of the shipped file all samples
close.
"""

import re

import spherekit as sk
from spherekit.files.library import find
from spherekit.files.mechanism_reader import loads

WIDE_RANGE_DEG = (40.0, 140.0)
"""Range of each input. The cranks are too far apart in a part of the square of inputs."""


def wide_five_bar_text() -> str:
    """Return the text of the shipped five-bar with the wider ranges."""
    low, high = WIDE_RANGE_DEG
    text = find("five_bar").read_text("utf-8")
    text_with_ranges, count = re.subn(
        r"^from = .*\nto = .*$", f"from = {low}\nto = {high}", text, flags=re.M
    )
    assert count == 2
    return text_with_ranges


def wide_five_bar() -> sk.Mechanism:
    """Return the shipped five-bar with the wider ranges."""
    return loads(wide_five_bar_text(), "five_bar")
