"""Formulas as source code in one of the programming languages."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

from spherekit.errors import OutputError
from spherekit.exchange.c_source import CPP, C, write_c, write_cpp
from spherekit.exchange.casadi_source import CASADI, write_casadi
from spherekit.exchange.formula_expressions import Formulas
from spherekit.exchange.javascript_source import JAVASCRIPT, write_javascript
from spherekit.exchange.julia_source import JULIA, write_julia
from spherekit.exchange.python_source import PYTHON, write_python
from spherekit.exchange.source_language import Language
from spherekit.exchange.source_printer import FormulaSource


class SourceWriter(NamedTuple):
    """A language, and the function that writes formulas in it."""

    language: Language
    write: Callable[[FormulaSource], str]


WRITERS: Mapping[str, SourceWriter] = {
    "c": SourceWriter(C, write_c),
    "cpp": SourceWriter(CPP, write_cpp),
    "js": SourceWriter(JAVASCRIPT, write_javascript),
    "python": SourceWriter(PYTHON, write_python),
    "julia": SourceWriter(JULIA, write_julia),
    "casadi": SourceWriter(CASADI, write_casadi),
}
"""Languages by the names that `spherekit.export` has for them."""


def source(formulas: Formulas, language: str) -> str:
    """Return formulas as source code.

    The result is the text of functions that other programs can call.

    Parameters
    ----------
    formulas
        The formulas.
    language
        One of the names in `WRITERS`.

    Raises
    ------
    OutputError
        If there are no results.
    """
    if not formulas.results:
        raise OutputError(
            f"{formulas.mechanism.name}: source code needs at least one quantity"
        )
    writer = WRITERS[language]
    return writer.write(FormulaSource(formulas, writer.language))
