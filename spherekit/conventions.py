"""What is agreed once: status codes, tolerances, and how names are spelt."""

import math
import os
import re
from typing import Any

TURN = 2.0 * math.pi


DEFAULT_SAMPLES = 361
"""Samples along the range of an input: one for each degree of a whole turn."""

NAME_PATTERN = re.compile(r"[A-Za-z0-9_]+")
"""Names of links, pairs, masses, loads: letters, digits and underscores."""


MAX_NAME_LENGTH = 64
"""Names longer than this are refused; they become columns and entity paths."""


Facts = dict[str, Any]
"""What is said, by name, ready for JSON."""

Names = tuple[str, ...]
"""Names, or words, in their order."""

Lines = list[str]
"""What is said, line by line, or words to choose from."""

AnyPath = str | os.PathLike[str]
"""Where a file or folder is."""
