"""Formulas as source in a language."""

from collections.abc import Callable, Mapping

from spherekit.exchange import c_source, script_source, source_printer
from spherekit.exchange.formula_expressions import Formulas

LANGUAGES: Mapping[
    str, tuple[source_printer.Language, Callable[[source_printer.Source], str]]
] = {
    "c": (c_source.C, c_source.c),
    "cpp": (c_source.CPP, c_source.cpp),
    "js": (script_source.JS, script_source.javascript),
    "python": (script_source.PYTHON, script_source.python),
    "julia": (script_source.JULIA, script_source.julia),
    "casadi": (script_source.CASADI, script_source.casadi),
}


def source(formulas: Formulas, language: str) -> str:
    """Return formulas as source in one of `LANGUAGES`.

    Raises
    ------
    OutputError
        If names of results are the same in it.
    """
    form, write = LANGUAGES[language]
    return write(source_printer.Source(formulas, form))
