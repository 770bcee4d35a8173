"""Checks of messages, which are listed in `refusals.toml`.

A table of `refusals.toml` has the name of a file of the tests, or it lists calls or
commands. A row for a file has a passage of the file, the faulty passage that replaces it,
and fragments of the expected message. A row for a call or command has the fragments alone.
A message says where the fault is, what it is, what is allowed and what to do, in any order.
"""

import tomllib
from pathlib import Path

import pytest

from spherekit.errors import SpherekitError
from spherekit.files.mechanism_reader import read
from spherekit.files.toml_document import parse
from spherekit.proof.decimal_mechanism import read_decimals

HERE = Path(__file__).parent.parent
TABLES = tomllib.loads((HERE / "refusals.toml").read_text(encoding="utf-8"))


def mechanism_text(name):
    """Return the text of a file of these tests."""
    return (HERE / "files" / f"{name}.toml").read_text(encoding="utf-8")


def decimal_mechanism(text, tolerance=0.0):
    """Return the mechanism with exact decimal sizes from the text of a mechanism file."""
    document = parse(text, "made")
    return read_decimals(read(document), document, tolerance=tolerance)


def replace_passages(text, *replacements):
    """Return a text with passages replaced.

    `replacements` are, alternately, a passage of the text and the one that replaces it.
    """
    for old, new in zip(replacements[::2], replacements[1::2], strict=True):
        assert text.count(old) >= 1, old
        text = text.replace(old, new, 1)
    return text


def check_fragments(message, fragments):
    for fragment in fragments:
        assert fragment in message, message


def check_call(call, names, fragments):
    """Check that a call raises an error whose class and message contain all fragments.

    `call` is the call as a text, and `names` has the values of the names in it.
    """
    with pytest.raises(SpherekitError) as caught:
        eval(call, dict(names))
    classes = [f"{each.__name__}: " for each in type(caught.value).__mro__]
    check_fragments("".join(classes) + str(caught.value), fragments)
