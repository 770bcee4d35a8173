"""Public names of a package that are imported when they are first asked for."""

import re
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

_OFFERED = re.compile(r"^    from (\S+) import \(?\s*(\w+) as (\w+)", re.M)


def homes(file: Path) -> dict[str, tuple[str, str]]:
    """Return the module, and the name in it, of all that a package's file offers."""
    return {
        name: (module, attribute)
        for module, attribute, name in _OFFERED.findall(file.read_text("utf-8"))
    }


def offered(
    package: str, file: str, of: Callable[[Any, str], Any] = lambda value, _: value
) -> tuple[list[str], Callable[[str], Any], Callable[[], list[str]]]:
    """Return a package's `__all__`, its `__getattr__` that imports names, its `__dir__`.

    The names are those that its `file` imports for type checkers, so that they are said
    once; `of` makes what is offered of what is ours and the package's name.
    """
    home = homes(Path(file))

    def imported(name: str) -> Any:
        if name not in home:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        module, attribute = home[name]
        value = of(getattr(import_module(module), attribute), package)
        vars(import_module(package))[name] = value
        return value

    return sorted(home), imported, lambda: sorted(home)
