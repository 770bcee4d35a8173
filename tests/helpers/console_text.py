"""Comparison of what a page shows in a console block with what the command prints."""

import re


def shows(shown: str, printed: str) -> bool:
    """Return whether a console block of a page shows what a command has printed.

    Rounding errors such as 3e-14, and sizes of files, depend on the processor and may
    differ. So `_mask_rounding` replaces both by a sign before the comparison. Spaces at the
    ends of lines do not count.

    Parameters
    ----------
    shown
        The lines of the block. A line ``...`` stands for any lines.
    printed
        The output of the command.
    """
    patterns = [
        r"(?:.*\n)*" if line == "..." else re.escape(line.rstrip()) + r"\n"
        for line in _mask_rounding(shown).splitlines()
    ]
    lines = [line.rstrip() for line in _mask_rounding(printed).splitlines()]
    text = "".join(f"{line}\n" for line in lines)
    return re.fullmatch("".join(patterns), text) is not None


def _mask_rounding(text: str) -> str:
    """Replace numbers that are rounding errors, and sizes of files, by a sign.

    The spaces before a size are left out too, because columns of tables are as wide as
    their longest size.
    """
    text = re.sub(r"\b\d(\.\d+)?e-1\d\b", "#", text)
    return re.sub(r" *\b\d+(\.\d+)? [kM]B\b", " #", text)
