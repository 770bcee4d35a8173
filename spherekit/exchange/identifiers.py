"""Names of functions and enumerators that each language of a source allows.

Names of mechanisms are letters, digits and underscores. Some of these names are keywords,
functions or macros of a language, begin with a digit, or are used by the source itself.
Such a name gets ``m_`` in front. The head of a source states each change.
"""

import keyword
import re
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.resources import files

_WORDS = {
    language: frozenset(words.split())
    for language, words in tomllib.loads(
        files(__package__).joinpath("reserved_words.toml").read_text("utf-8")
    ).items()
}
"""Names that a language uses itself."""

_LOCAL = re.compile(
    r"t\d+|_?table_\d+|motion|mode|variables|size|result|given|values|sign_of|larger_of"
    r"|Scalar|Real|constant_of"
)
"""Names of arguments, terms and helpers in the sources."""

_C_MACROS = re.compile(
    r"(E[A-Z0-9]|SIG|FE_|FP_|LC_|ATOMIC_|M_)[A-Z0-9_]*|(PRI|SCN)[diouxX]\w*"
    r"|(CHAR|SCHAR|UCHAR|SHRT|USHRT|U?INT|U?LONG|U?LLONG|FLT|DBL|LDBL|SIZE|PTRDIFF|WCHAR)_\w*"
    r"|U?INT(MAX|PTR|(_LEAST|_FAST)?\d+)_\w*|CLOCKS_PER_SEC|TIME_UTC|SIG_ATOMIC_\w*"
    r"|(MB|MB_CUR|WINT|SCHAR|RAND|PATH|OPEN|IOV|NAME|ARG|MATH)_(MAX|MIN|LEN_MAX|ERR\w*)"
)
"""Families of macros that the headers of C define."""


@dataclass(frozen=True)
class NameRules:
    """The rules of a programming language for names of functions in generated source code.

    Attributes
    ----------
    words
        Names that can't be used: keywords, functions and macros of the language.
    families
        Pattern of further names that can't be used. By default it matches none.
    underscores
        Whether a name may begin with an underscore and have two in a row.
    """

    words: frozenset[str]
    families: re.Pattern[str] = re.compile("(?!)")
    underscores: bool = True

    def identifier(self, text: str) -> str:
        """Return a text as a name that the language allows; an allowed name is unchanged.

        Characters that names cannot have become underscores. If the name is then still not
        allowed, "m_" is put before it. No reserved name begins with "m_".
        """
        name = re.sub(r"\W", "_", text, flags=re.ASCII)
        if not self.underscores:
            name = re.sub("__+", "_", name)
        if self.is_taken(name):
            name = "m_" + (name if self.underscores else name.lstrip("_"))
        return name

    def is_taken(self, name: str) -> bool:
        """Return whether a text of letters, digits and underscores cannot be a new name.

        There are three reasons:

        - The text is empty, or its first character cannot begin a name.
        - The language reserves the name: it is one of `words`, or matches `families`.
        - The generated source uses the name itself, for an argument, a term or a helper.
        """
        return bool(
            not name
            or name[0].isdigit()
            or (not self.underscores and name[0] == "_")
            or name in self.words
            or _LOCAL.fullmatch(name)
            or self.families.fullmatch(name)
        )


# Libraries add names to `builtins`, as IPython adds `display`. The name of a function must
# not depend on that, so a list has the names that Python itself defines. The pattern of
# Python below excludes all names that begin with two underscores.
_PYTHON = frozenset([*keyword.kwlist, *keyword.softkwlist]) | _WORDS["python_builtins"]
_C = _WORDS["c_keywords"] | _WORDS["c_library"]

C_NAME_RULES = NameRules(_C, _C_MACROS, underscores=False)
CPP_NAME_RULES = NameRules(_C | _WORDS["cpp_keywords"], _C_MACROS, underscores=False)
JAVASCRIPT_NAME_RULES = NameRules(_WORDS["javascript"])
JULIA_NAME_RULES = NameRules(_WORDS["julia"])
PYTHON_NAME_RULES = NameRules(_PYTHON | _WORDS["python_source"], re.compile(r"__\w+"))
CASADI_NAME_RULES = NameRules(
    _C | PYTHON_NAME_RULES.words | _WORDS["casadi"], _C_MACROS, underscores=False
)
"""CasADi writes functions of C of the same names."""


def unique_names(names: Iterable[str], taken: Iterable[str] = ()) -> list[str]:
    """Return a list of names in which equal names are made different by numbers.

    The first of equal names stays as it is. The others end in ``_2``, ``_3`` and so on. The
    names keep their order.

    Parameters
    ----------
    names
        Names, some of which may be equal.
    taken
        Names that the result must not contain.
    """
    requested_names = list(names)
    used_names = set(taken)
    result: list[str] = []
    for name in requested_names:
        candidate = name
        number = 1
        # A candidate with a number must also differ from all later names of the list.
        while candidate in used_names or (number > 1 and candidate in requested_names):
            number += 1
            candidate = f"{name}_{number}"
        used_names.add(candidate)
        result.append(candidate)
    return result
