"""The identity of software and machine on which stored results depend."""

import json
import platform
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

from spherekit.version import __version__
from spherekit.wording import listing

MAX_VALUE_LENGTH = 60
"""Characters of a value in a message about different runs. Longer values are cut."""

CHECKSUM_TITLES = {
    "mechanism_hash": "contents of the mechanism file",
    "input_values": "values of the inputs",
    "times": "times of the samples or rates of the inputs",
}
"""What has changed if a checksum of an identity differs, by the key of the checksum."""


def code_identity() -> dict[str, str]:
    """Return the versions of the software and the kind of machine, by name.

    Two runs with the same options and the same identity on one machine have the same
    results, bit for bit. A run may continue the stored work of another run only if both
    have the same options and identity.
    """
    # The library heyoka compiles expressions if it is installed. Otherwise NumPy evaluates
    # them.
    try:
        heyoka_version = version("heyoka")
    except PackageNotFoundError:
        heyoka_version = "none"
    return {
        "spherekit": __version__,
        "numpy": np.__version__,
        "scipy": version("scipy"),
        "heyoka": heyoka_version,
        # The type of text columns in stored parts of tables. Earlier versions wrote another
        # type, and such parts cannot be continued.
        "texts_in_parts": "strings",
        "machine": f"{platform.system()} {platform.machine()}",
    }


def differences(stored: Mapping[str, Any], current: Mapping[str, Any]) -> str:
    """Return the differences of two identities in words; empty if there are none.

    An identity has the options, versions and checksums on which the results of a run
    depend. A stopped run is continued only without differences. For a checksum that
    differs, the text says from what it was computed.

    Parameters
    ----------
    stored, current
        Identity of the stopped run as stored in a file, and of the run that would continue
        it.
    """
    changes = []
    for key in {**stored, **current}:
        old = stored.get(key)
        new = current.get(key)
        # Compare as JSON, because tuples have become lists in the stored identity.
        if json.dumps(old) != json.dumps(new):
            title = CHECKSUM_TITLES.get(key)
            if title is not None:
                changes.append(f"other {title}")
                continue
            title = key.replace("_", " ")
            old_text = _value_text(old)
            new_text = _value_text(new)
            # A long value is cut so that the first difference stays in the message.
            characters = zip(old_text, new_text, strict=False)
            is_different = [
                old_letter != new_letter for old_letter, new_letter in characters
            ]
            first_difference = [*is_different, True].index(True)
            start = first_difference - MAX_VALUE_LENGTH // 2
            changes.append(
                f"{title}: {_shortened(old_text, start)} there, "
                f"{_shortened(new_text, start)} now"
            )
    return listing(changes, limit=4)


def _value_text(value: object) -> str:
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _shortened(text: str, start: int) -> str:
    """Return a text, or if it is long, a part of it that begins near `start`."""
    if len(text) <= MAX_VALUE_LENGTH:
        return text
    # Near its end, the text is shown from further left.
    start = min(start, len(text) - MAX_VALUE_LENGTH)
    beginning = ""
    if start > 0:
        beginning = "..."
        text = text[start + len(beginning) :]
    if len(beginning + text) > MAX_VALUE_LENGTH:
        text = text[: MAX_VALUE_LENGTH - len(beginning) - 3] + "..."
    return beginning + text
