"""Arguments that come in from outside, judged at the packages that offer names.

Calls within spherekit are judged by mypy before it is shipped, so only others are judged
when they happen. A function is offered as one that judges and then calls ours; ours is
called from inside as before. A class judges in its constructor and its public methods,
unless the caller is a module of spherekit, and so do the classes that extend it.
"""

import functools
import inspect
import re
import sys
from collections.abc import Callable, Iterator
from enum import Enum
from pathlib import Path
from typing import Any

from spherekit.checked import P, R, checked, judges, marked
from spherekit.errors import ArgumentError, SpherekitError
from spherekit.lazily import homes

_PASSED_ON = ("dataclasses", "copy", "functools")
"""Modules that call on behalf of the module that called them."""
_PLAIN = re.compile(r"[^_].*|__init__|__call__")


class Boundary:
    """What the packages in a folder offer, and which of its classes do not judge yet.

    Classes judge from the moment at which the first name is offered after their module is
    loaded: an object reaches the outside by a name that was offered, or is made of one.
    """

    def __init__(self, folder: Path, error: type[SpherekitError]) -> None:
        self._error = error
        self._waiting: dict[str, set[str]] = {}
        for file in sorted(folder.glob("*.py")):
            for module, attribute in homes(file).values():
                self._waiting.setdefault(module, set()).add(attribute)

    def offer(self, value: Any, package: str) -> Any:
        """Return what a package offers in place of something of ours."""
        self._reach()
        if not inspect.isfunction(value) or judges(value):
            return value
        offered = checked(self._error)(value)
        offered.__module__ = package  # where it is imported from, so that it pickles
        return offered

    def _reach(self) -> None:
        """Let the classes judge whose modules were loaded since."""
        for module in [name for name in self._waiting if name in sys.modules]:
            defined = vars(sys.modules[module])
            names = self._waiting[module]
            for name in [name for name in names if name in defined]:
                names.discard(name)
                if inspect.isclass(defined[name]):
                    _let_judge(defined[name], self._error)
            if not names:
                self._waiting.pop(module, None)


@functools.cache
def _of_plugins() -> Boundary:
    return Boundary(Path(__file__).parent / "plugin", ArgumentError)


def offer(value: Any, package: str) -> Any:
    """Return what a package of `spherekit.plugin` offers in place of something of ours."""
    return _of_plugins().offer(value, package)


def _let_judge(made: type, error: type[SpherekitError]) -> None:
    """Let a class and those that extend it judge what they are called with from outside."""
    if issubclass(made, BaseException | Enum) or getattr(made, "_is_protocol", False):
        return
    for owner in [part for part in made.__mro__ if _is_inside(part.__module__)]:
        for name, item in _callables(owner):
            if isinstance(item, classmethod | staticmethod):
                setattr(owner, name, type(item)(_outside(item.__func__, error)))
            else:
                setattr(owner, name, _outside(item, error))
    for extended in made.__subclasses__():
        if _is_inside(extended.__module__):
            _let_judge(extended, error)


def _callables(made: type) -> Iterator[tuple[str, Any]]:
    """Return the functions of a class that take arguments and do not judge yet."""
    for name, item in list(vars(made).items()):
        function = getattr(item, "__func__", item)
        if (
            _PLAIN.fullmatch(name)
            and inspect.isfunction(function)
            and not judges(function)
            and not getattr(function, "__isabstractmethod__", False)
            and _takes_any(function, 0 if isinstance(item, staticmethod) else 1)
        ):
            yield name, item


def _takes_any(function: Callable[..., Any], bound: int) -> bool:
    """Return whether a function has parameters besides those that are bound."""
    code = inspect.unwrap(function).__code__
    several = inspect.CO_VARARGS | inspect.CO_VARKEYWORDS
    count: int = code.co_argcount + code.co_kwonlyargcount
    return count > bound or bool(code.co_flags & several)


def _outside(function: Callable[P, R], error: type[SpherekitError]) -> Callable[P, R]:
    """Return a function that judges its arguments unless it is called from inside."""

    @functools.cache
    def judging() -> Callable[P, R]:
        return checked(error)(function)

    @functools.wraps(function)
    def _asked(*args: P.args, **kwargs: P.kwargs) -> R:
        if _is_inside(_caller()):
            return function(*args, **kwargs)
        return judging()(*args, **kwargs)

    return marked(_asked)


def _caller() -> str:
    """Return the name of the module that calls the function which asks for it."""
    frame = sys._getframe(2)
    name: str = frame.f_globals.get("__name__", "")
    while name in _PASSED_ON and frame.f_back is not None:
        frame = frame.f_back
        name = frame.f_globals.get("__name__", "")
    return name


def _is_inside(module: str) -> bool:
    return module.startswith("spherekit.")
