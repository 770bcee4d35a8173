"""Conventions of the whole project: spelling of names, default samples, common types."""

import math
import os
import re
from typing import Any

TURN = 2.0 * math.pi
"""One revolution (rad)."""


DEFAULT_SAMPLES = 361
"""Samples along the range of an input: one for each degree of a whole turn."""

NAME_PATTERN = re.compile(r"[A-Za-z0-9_]+")
"""Names of links, pairs, masses, loads: letters, digits and underscores."""


MAX_NAME_LENGTH = 64
"""Names longer than this are refused; they become columns and entity paths."""


Facts = dict[str, Any]
"""Values by name, ready for JSON."""

Names = tuple[str, ...]
"""Names in their order."""

Lines = list[str]
"""Lines of a text, or words to choose from."""

AnyPath = str | os.PathLike[str]
"""Path of a file or folder."""
