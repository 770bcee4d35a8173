"""The API pages: every public name of the public packages, from its docstring."""

import importlib
import inspect
from collections.abc import Iterator
from pkgutil import iter_modules
from types import GenericAlias
from typing import Any

from spherekit import plugin

PACKAGES = (
    "spherekit",
    "spherekit.plugin",
    *(name for _, name, _ in iter_modules(plugin.__path__, f"{plugin.__name__}.")),
    "spherekit.display",
)

INDEX = """\
# API

These packages are public; what is imported from anywhere else may change. Angles are in
rad, vectors in ground axes, samples are the first axis of an array.

```{{toctree}}
:maxdepth: 1

{packages}
```
"""


def pages() -> Iterator[tuple[str, str]]:
    """Yield one page for each package."""
    told: dict[int, str] = {}
    yield "api/index.md", INDEX.format(packages="\n".join(PACKAGES))
    for package in PACKAGES:
        yield f"api/{package}.rst", "\n".join(_page(package, told))


def _page(package: str, told: dict[int, str]) -> Iterator[str]:
    module = importlib.import_module(package)
    purpose = (inspect.getdoc(module) or "").partition("\n")[0]
    yield f"{package}\n{'=' * len(package)}\n"
    yield f"{purpose}\n"
    yield f".. currentmodule:: {package}\n"
    values = {name: getattr(module, name) for name in module.__all__ if name[0] != "_"}
    for title, asked in (("Classes", _is_class), ("Functions", inspect.isroutine)):
        chosen = {name: value for name, value in values.items() if asked(value)}
        if chosen:
            yield f"{title}\n{'-' * len(title)}\n"
        for name, value in chosen.items():
            yield from _entry(package, name, value, told)
    rest = {
        name: value
        for name, value in values.items()
        if not _is_class(value) and not inspect.isroutine(value)
    }
    if rest:
        yield "Constants and types\n-------------------\n"
    for name, value in rest.items():
        yield f".. py:data:: {name}\n\n   ``{value!r}``\n"


def _is_class(value: Any) -> bool:
    return inspect.isclass(value) and not isinstance(value, GenericAlias)


def _entry(package: str, name: str, value: Any, told: dict[int, str]) -> Iterator[str]:
    role = "class" if _is_class(value) else "func"
    if id(value) in told:
        yield f"``{name}``\n   The same as :py:{role}:`{told[id(value)]}`.\n"
        return
    told[id(value)] = f"{package}.{name}"
    if role == "func":
        yield f".. autofunction:: {name}\n"
    else:
        yield f".. autoclass:: {name}\n   :members:\n   :member-order: bysource\n"
