"""Reports warnings of libraries as plain sentences, without the path of a source file.

A warning of NumPy or SciPy, such as "invalid value encountered in divide", arises where an
operation has no result. Wherever spherekit expects this and checks the result, the warning
is silenced at the operation itself (``np.errstate``, ``warnings.catch_warnings``). Any
other warning is therefore a fault of spherekit or of a plugin, and may concern results.
It must not be lost, but the path and the line of a source file mean nothing to the user.
"""

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO


@contextmanager
def warnings_as_sentences(
    report: Callable[[str], None], shows_source: bool
) -> Iterator[None]:
    """Report each warning that is raised within a `with` block once, as one sentence.

    Warnings that Python's filters ignore, such as most of deprecated functions, are not
    reported.

    Parameters
    ----------
    report
        Function that receives the sentence, for example to print it.
    shows_source
        Whether sentences for programmers also name the file and the line, as
        ``--traceback`` asks for.
    """
    reported: set[str] = set()

    def report_warning(
        message: Warning | str,
        category: type[Warning],
        filename: str,
        lineno: int,
        file: TextIO | None = None,
        line: str | None = None,
    ) -> None:
        """Report a warning once; it has the parameters of `warnings.showwarning`."""
        text = " ".join(str(message).split()).rstrip(".")
        if text in reported:
            return
        reported.add(text)
        if shows_source:
            where = f"it arose in {filename}, line {lineno}"
        else:
            where = "--traceback shows where it arose"
        # A `UserWarning` has a sentence that spherekit or a library wrote for users, who do
        # not need the place in the code. Other categories, such as `RuntimeWarning`, are
        # for programmers.
        if category is UserWarning:
            report(f"warning: {text}")
            return
        # In result tables, each row with a known problem has a status that names it. An
        # unexpected warning may concern rows without a status, so users should check these.
        report(
            f"warning: {_name_library(filename)} reports: {text}; spherekit did not expect "
            "this warning, which may concern results; check results that have no status; "
            f"{where}"
        )

    with warnings.catch_warnings():
        warnings.showwarning = report_warning
        yield


def _name_library(filename: str) -> str:
    """Return the name of the installed package that a source file belongs to.

    The name is ``a numerical library`` for files of spherekit and for files that are not in
    a folder ``site-packages``.
    """
    parts = Path(filename).parts
    # Warnings of compiled functions are attributed to the line that calls them, which is
    # often a line of spherekit, installed or not.
    if "site-packages" in parts[:-1]:
        after = parts[len(parts) - parts[::-1].index("site-packages")]
        name = after.removesuffix(".py")
        if name != __package__:
            return name
    return "a numerical library"
