"""What public functions and classes are called with from outside: judged, and told."""

import importlib
import inspect
import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from enum import Enum
from types import NoneType, UnionType
from typing import Literal, Union, get_args, get_origin

import numpy as np
import pytest
from helpers.refusals import TABLES, check_call
from numpy.typing import ArrayLike

import spherekit as sk
from spherekit.argument_validation import checked, resolved_annotation
from spherekit.errors import SpherekitError
from spherekit.mechanism.load import Load
from spherekit.type_checks import has_type

FRONT = ("spherekit", "spherekit.display")
COMPUTED = (
    *("Kinematics", "Mechanism", "Motion"),
    *("Plan", "RunResult", "Simulation"),
)
"""Classes of the front whose objects functions of ours make."""
INSIDE = {
    "Bearings": "supported_loads",
    "ContactFriction": "supported_loads",
    "Digits": "within",
    "Mechanism": "angle_between names_of variables_of",
    "Motion": "joined put rows",
    "Plan": "name pole",
    "RerunRecorder": "log start",
    "InverseKinematics": "no_closed_form",
    "Start": "of",
    "Study": "fault",
    "TorqueTable": "knots one",
}
"""Methods by which parts of the library ask each other, as do all of `Load`."""
FOUR_BAR = sk.load("four_bar")
READY = {
    sk.Mechanism: FOUR_BAR,
    sk.Start: sk.Start(0.3, 1.0),
}
"""Objects of classes that judge by what they have."""
ANYTHING = object()
"""Something that no type allows but those that allow anything."""
PLAIN = {bool: True, int: 1, float: 1.0, str: "x", NoneType: None}
HOLDERS = {tuple: (), Mapping: {}, dict: {}, frozenset: frozenset(), set: set()}


class Anyhow:
    """A stand-in for what is asked for by its attributes alone."""

    def __getattr__(self, name):
        return print


def allowed(hint):
    """Return something that a type allows."""
    origin, inner = get_origin(hint), get_args(hint)
    if hint in PLAIN or hint in READY:
        return (PLAIN | READY)[hint]
    if origin is Literal:
        return inner[0]
    if has_type(np.zeros(1), hint):
        return np.zeros(1)
    if has_type(np.array(["x"]), hint):
        return np.array(["x"])
    if origin in (Union, UnionType):
        return allowed(next((part for part in inner if part in READY), inner[0]))
    if origin is tuple and inner[1:] != (...,):
        return tuple(allowed(item) for item in inner)
    if origin in (Sequence, Iterable, list):
        return []
    if origin in HOLDERS:
        return HOLDERS[origin]
    if origin is os.PathLike:
        return os.devnull
    if origin is Callable:
        return print
    if origin is type:
        return inner[0]
    if getattr(hint, "_is_protocol", False):
        return Anyhow()
    if inspect.isabstract(hint):
        hint = type("Extended", (hint,), {})
        hint.__abstractmethods__ = frozenset()
    if issubclass(hint, Enum):
        return next(iter(hint))
    return (tuple if issubclass(hint, tuple) else object).__new__(hint)


def own(made):
    """Every public method of a class that takes arguments, with what it is bound to."""
    for key in dir(made):
        if key[0] != "_" or key == "__call__":
            item = inspect.getattr_static(made, key)
            function = getattr(item, "__func__", item)
            if inspect.isfunction(function) and not isinstance(item, property):
                if getattr(function, "__isabstractmethod__", False):
                    continue  # plugins write it, and we call it
                bound = (
                    () if isinstance(item, staticmethod) else (READY.get(made, ANYTHING),)
                )
                yield key, function, (made,) if isinstance(item, classmethod) else bound


def callables():
    """Every function, class and method that others may call, with what it is bound to."""
    for package in map(importlib.import_module, FRONT):
        for name in package.__all__:
            value = getattr(package, name)
            if inspect.isfunction(value):
                yield name, value, ()
            elif inspect.isclass(value) and not issubclass(value, Exception | Enum):
                if getattr(value, "_is_protocol", False):
                    continue  # whoever answers to it is no class of ours
                if inspect.isfunction(value.__init__) and name not in COMPUTED:
                    yield name, value.__init__, (allowed(value),)
                left_out = {*INSIDE.get(name, "").split(), *dir(Load)}
                for key, function, bound in own(value):
                    if key not in left_out:
                        yield f"{name}.{key}", function, bound


def test_every_public_callable_is_checked():
    """Each refuses an object of no known type in each of its arguments, by its name."""
    count, missed = 0, []
    for name, function, bound in callables():
        parameters = list(inspect.signature(function).parameters.values())[len(bound) :]
        hints = {
            item.name: resolved_annotation(function, item.annotation) for item in parameters
        }
        for wrong in parameters:
            if has_type(ANYTHING, hints[wrong.name]):
                continue
            count += 1
            given = {
                item.name: allowed(hints[item.name])
                for item in parameters
                if item.default is item.empty and item.kind is not item.VAR_POSITIONAL
            }
            several = wrong.kind is wrong.VAR_POSITIONAL
            given |= {} if several else {wrong.name: ANYTHING}
            try:
                function(*bound, *([ANYTHING] if several else []), **given)
            except SpherekitError as error:
                if not re.search(f'({wrong.name} is|is named) "?<object', str(error)):
                    missed.append(f"{name}: {wrong.name}: {error}")
            except Exception as error:
                missed.append(f"{name}: {wrong.name}: {error!r}")
            else:
                missed.append(f"{name}: {wrong.name} may be anything")
    assert not missed, "\n".join(missed)
    assert count > 300


@pytest.mark.parametrize("call", TABLES["arguments"])
def test_messages_say_where_what_and_what_to_try(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = {"sk": sk, "FOUR_BAR": FOUR_BAR}
    check_call(call, names, TABLES["arguments"][call])
    assert list(tmp_path.iterdir()) == []


def test_what_the_types_allow_passes():
    """NumPy's numbers, lists for sequences, paths for text: nothing right is refused."""

    @checked(SpherekitError)
    def asked(
        count: int,
        size: float = 1.0,
        flag: bool = False,
        words: "tuple[str, ...] | None" = None,
        late: "NoSuchType | None" = None,  # noqa: F821
        numbers: ArrayLike | None = None,
    ) -> int:
        return count

    assert asked(np.int64(3), np.float32(2), np.bool_(True), ["a", "b"], object()) == 3
    assert asked(count=3, size=2) == 3
    for numbers in (1, 0.5, [1, 2], [[1.0], [2.0]], np.eye(3), None):
        assert asked(3, numbers=numbers) == 3
    for wrong in ([3.0], [True], [3, "2"], [3, 2.0, False, None, None, "a"]):
        with pytest.raises(SpherekitError):
            asked(*wrong)
    with pytest.raises(SpherekitError, match="asked: missing a required argument: 'count'"):
        asked()
    with pytest.raises(SpherekitError, match=r'asked: no argument is "cnt"; did you mean'):
        asked(cnt=3)
