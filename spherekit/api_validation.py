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
from collections.abc import Callable
from enum import Enum
from pathlib import Path
from typing import Any

from spherekit.argument_validation import P, R, checked, judges, marked
from spherekit.errors import ArgumentError
from spherekit.lazy_imports import homes

_PASSED_ON = ("dataclasses", "copy", "functools")
"""Modules that call on behalf of the module that called them."""
_PLAIN = re.compile(r"[^_].*|__init__|__call__")


@functools.cache
def _waiting() -> dict[str, set[str]]:
    """Return by module the names that packages offer and that were not looked at yet."""
    waiting: dict[str, set[str]] = {}
    for file in sorted((Path(__file__).parent / "plugin").glob("*.py")):
        for module, attribute in homes(file).values():
            waiting.setdefault(module, set()).add(attribute)
    return waiting


def offer(value: Any, package: str) -> Any:
    """Return what a package of `spherekit.plugin` offers in place of something of ours.

    Classes judge from the moment at which the first name is offered after their module is
    loaded: an object reaches the outside by a name that was offered, or is made of one.
    """
    for module, names in _waiting().items():
        defined = vars(sys.modules[module]) if module in sys.modules else {}
        for name in names & defined.keys():
            names.discard(name)
            if inspect.isclass(defined[name]):
                _let_judge(defined[name])
    if not inspect.isfunction(value) or judges(value):
        return value
    offered = checked(ArgumentError)(value)
    offered.__module__ = package  # where it is imported from, so that it pickles
    return offered


def _let_judge(made: type) -> None:
    """Let a class and those that extend it judge what they are called with from outside."""
    if issubclass(made, BaseException | Enum) or getattr(made, "_is_protocol", False):
        return
    for owner in [part for part in made.__mro__ if _is_inside(part.__module__)]:
        for name, item in list(vars(owner).items()):
            function = getattr(item, "__func__", item)
            if (
                _PLAIN.fullmatch(name)
                and inspect.isfunction(function)
                and not judges(function)
                and not getattr(function, "__isabstractmethod__", False)
            ):
                judging = _outside(function)
                setattr(owner, name, judging if item is function else type(item)(judging))
    for extended in made.__subclasses__():
        if _is_inside(extended.__module__):
            _let_judge(extended)


def _outside(function: Callable[P, R]) -> Callable[P, R]:
    """Return a function that judges its arguments unless it is called from inside."""

    @functools.cache
    def judging() -> Callable[P, R]:
        return checked(ArgumentError)(function)

    @functools.wraps(function)
    def _asked(*args: P.args, **kwargs: P.kwargs) -> R:
        if _is_inside(_caller()):
            return function(*args, **kwargs)
        return judging()(*args, **kwargs)

    return marked(_asked)


def _caller() -> str:
    """Return the name of the module that calls the function which asks for it."""
    frame = sys._getframe(2)
    while frame.f_globals.get("__name__") in _PASSED_ON and frame.f_back is not None:
        frame = frame.f_back
    return str(frame.f_globals.get("__name__", ""))


def _is_inside(module: str) -> bool:
    return module.startswith("spherekit.")
