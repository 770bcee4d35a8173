"""What is refused or told, as data: `refusals.toml` says what the message of each says.

Of files a row is (what stands in the file of the table's name, what is put there instead,
fragments of the message), of calls and commands the fragments alone. A message says where
the fault is, what it is, what is allowed and what to do, in any order.
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
    """Return what is proven of, from the text of a file."""
    document = parse(text, "made")
    return read_decimals(read(document), document, tolerance=tolerance)


def replace_passages(text, *replacements):
    """Return the text with passages replaced, given in turn as old, new."""
    for old, new in zip(replacements[::2], replacements[1::2], strict=True):
        assert text.count(old) >= 1, old
        text = text.replace(old, new, 1)
    return text


def check_fragments(message, fragments):
    for fragment in fragments:
        assert fragment in message, message


def check_call(call, names, fragments):
    """Check that a call is refused, with the class of the error before its message."""
    with pytest.raises(SpherekitError) as caught:
        eval(call, dict(names))
    classes = [f"{each.__name__}: " for each in type(caught.value).__mro__]
    check_fragments("".join(classes) + str(caught.value), fragments)
