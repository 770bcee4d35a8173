"""What is agreed once: status codes, tolerances, and how names are spelt."""

import difflib
import math
import os
import re
from collections.abc import Collection, Iterable, Mapping
from enum import IntEnum
from typing import Any

TURN = 2.0 * math.pi


class Status(IntEnum):
    """What became of one sample; every failed sample carries one of these."""

    OK = 0
    OUT_OF_REACH = 1
    AT_SINGULARITY = 2
    MODE_LOST = 3
    NOT_CONVERGED = 4
    NOT_CLOSED = 5
    NO_POLE = 6
    ILL_CONDITIONED = 7
    OFF_PROFILE = 8
    CURVATURE = 9
    OVERFLOW = 10
    LIFT_OFF = 11
    BOUND_EXCEEDED = 12


STATUS_MEANING = {
    Status.OK: "closed, on its assembly mode, with finite rates",
    Status.OUT_OF_REACH: "the arcs cannot close at this input or pose, a joint limit "
    "excludes the pose (column limiting names it), the assembly mode ends at a "
    "dead centre before it, or with several inputs no configuration here is joined to it; "
    "narrow the range, sample more finely or change the arcs",
    Status.AT_SINGULARITY: "the links close, but the input rate does not determine "
    "the motion here; choose another input pair or step around it",
    Status.MODE_LOST: "a solution was found, but not on this assembly mode; ask for more "
    "samples or start nearer",
    Status.NOT_CONVERGED: "the iteration did not reach the tolerance; start nearer "
    "or check for nearly parallel axes",
    Status.NOT_CLOSED: "the closure residual is above the tolerance",
    Status.NO_POLE: "the two links do not move relative to each other here: the "
    "coefficient is zero and they have no pole axis",
    Status.ILL_CONDITIONED: "nearly parallel axes or a singularity nearby leave the "
    "direction of this pole, though the links move, or the inertia and torque of this row "
    "unknown to the accuracy asked for",
    Status.OFF_PROFILE: "the contact has run off the end of an open profile",
    Status.CURVATURE: "at the contact the profiles have equal curvature or would enter "
    "each other; use a smaller roller or a less curved cam",
    Status.OVERFLOW: "a load, an inertia or their torque is too large for a number; use "
    "other units, or look for a load that grows without bound",
    Status.LIFT_OFF: "a contact would have to pull to keep its links together; press it "
    "with a spring, or move more slowly",
    Status.BOUND_EXCEEDED: "a proven enclosure shows that this row is off by more than its "
    "error bound says; please report it with the mechanism",
}

EPS = 2.220446049250313e-16
"""Unit roundoff of float64, doubled (the spacing of numbers just above 1)."""

CLOSURE_TOLERANCE = 1e-12
"""Largest loop rotation (rad) of a sample reported as OK; solvers reach 1e-15."""

REACH_SLACK = 16 * EPS
"""A spherical triangle may miss closing by this much (rad): rounding of its arcs."""

USABLE_DIRECTION = 1e-6
"""A pole direction with a larger error bound (rad) is not given."""

NO_MOTION = 1e-9
"""Links whose relative rate is below this part of their own rates move as one."""

EQUAL_CURVATURE = 1e-9
"""Profiles in contact whose curvatures differ by less do not determine their motion."""

SINGULAR_RATIO = 1e-11
"""Smallest relative singular value of the closure Jacobian with trusted rates."""

DEFAULT_SAMPLES = 361
"""Samples along the range of an input: one for each degree of a whole turn."""

NAME_PATTERN = re.compile(r"[A-Za-z0-9_]+")
"""Names of links, pairs, masses, loads: letters, digits and underscores."""

_NUMBER = re.compile(r"(?<![\w.])-?\d[\d.]*(?:e[-+]?\d+)?(?![\w.])")
"""A number that is no part of a key, such as ``links.4.arc``."""

MAX_NAME_LENGTH = 64
"""Names longer than this are refused; they become columns and entity paths."""


def nearest(word: str, allowed: Iterable[str]) -> str:
    """Return a hint ``; did you mean "x"?`` for a misspelt word, or an empty string."""
    words = list(allowed)
    close = [candidate for candidate in words if candidate.casefold() == word.casefold()]
    close = close or [candidate for candidate in words if sorted(candidate) == sorted(word)]
    close = close or difflib.get_close_matches(word, words, n=1, cutoff=0.5)
    return f'; did you mean "{close[0]}"?' if close else ""


def choices(word: object, allowed: Collection[str], what: str, most: int = 12) -> str:
    """Return how a message about an unknown word ends: the nearest, and what is allowed."""
    hint = nearest(str(word), allowed) or ";"
    return f"{hint} {what}: {listing(allowed, most) or 'none'}"


def counted(number: object, noun: str) -> str:
    """Return a number with its noun, ``1 row`` or ``2 rows``; grids are ``41x21 rows``."""
    return f"{number} {noun}{'' if str(number) == '1' else 's'}"


Facts = dict[str, Any]
"""What is said, by name, ready for JSON."""

Names = tuple[str, ...]
"""Names, or words, in their order."""

Lines = list[str]
"""What is said, line by line, or words to choose from."""

AnyPath = str | os.PathLike[str]
"""Where a file or folder is."""


def listing(words: Iterable[object], limit: int = 12) -> str:
    """Return words as ``a, b, c``, cut after `limit` with the number left out."""
    items = [str(word) for word in words]
    rest = len(items) - limit
    shown = ", ".join(items[:limit])
    return f"{shown} and {rest} more" if rest > 0 else shown


def size_text(count: float) -> str:
    """Return a number of bytes as ``1.5 GB``."""
    for unit, scale in (("TB", 1e12), ("GB", 1e9), ("MB", 1e6)):
        if count >= scale:
            return f"{count / scale:.3g} {unit}"
    return f"{count / 1e3:.3g} kB"


def without_numbers(text: str) -> str:
    """Return a text by which those that differ in numbers only are one."""
    return _NUMBER.sub("", text)


def numbered(word: str, numbers: Iterable[object]) -> str:
    """Return a word with what it counts: ``assembly mode 0``, ``assembly modes 0, 1``."""
    every = list(numbers)
    return f"{word}{'' if len(every) == 1 else 's'} {listing(every)}"


def with_units(names: Iterable[str], units: Mapping[str, str]) -> list[str]:
    """Return names of columns with the units of those that have one."""
    return [f"{name} [{units[name]}]" if units.get(name) else name for name in names]
