"""Functions that read the text of one command-line argument, for ``argparse``.

Each raises `argparse.ArgumentTypeError` with a message that says what is allowed.
"""

from argparse import ArgumentTypeError

from spherekit.quantity import ANGLE, DURATION, QuantityError, read_quantity


def number(text: str) -> float:
    """Return the number that a text states."""
    try:
        return float(text)
    except ValueError:
        raise ArgumentTypeError(f"{text!r} is not a number") from None


def seconds(text: str) -> float:
    """Return the time in s that a text states, such as ``2``, ``2s`` or ``500ms``."""
    try:
        return read_quantity(text, DURATION, "rad")
    except QuantityError as problem:
        raise ArgumentTypeError(str(problem)) from None


def angles_in_degrees(text: str) -> tuple[float, ...]:
    """Return the angles in degrees of a list such as ``90,60deg,1rad``.

    A number without a unit is in degrees. The options that use this function refer to no
    mechanism file, which could state another unit.
    """
    try:
        return tuple(
            read_quantity(item, ANGLE, "deg", target="deg") for item in text.split(",")
        )
    except QuantityError as problem:
        raise ArgumentTypeError(f"{text}: {problem}") from None


def whole_number(text: str) -> int:
    """Return the whole number, which may be negative, that a text states."""
    try:
        return int(text)
    except ValueError:
        raise ArgumentTypeError(f"{text!r} is not a whole number") from None


def row_count(text: str) -> int:
    """Return the number of rows, at least 1, that a text states."""
    if not text.isdecimal() or int(text) < 1:
        # "run --verify four_bar" reads the file as the number of rows.
        raise ArgumentTypeError(
            f"needs a whole number of at least 1, such as 16, not {text!r}; if this is the "
            "name of the file, put it before --verify"
        )
    return int(text)


def sample_counts(text: str) -> int | tuple[int, ...]:
    """Return the samples that ``361`` states, or ``41x21`` for a grid of two inputs."""
    counts = text.split("x")
    if not all(count.isdecimal() and int(count) > 0 for count in counts):
        raise ArgumentTypeError(
            f"needs whole numbers of at least 1, such as 361 or 41x21, not {text!r}"
        )
    if len(counts) == 1:
        return int(text)
    return tuple(int(count) for count in counts)
