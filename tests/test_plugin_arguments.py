"""What functions and classes of `spherekit.plugin` are called with from outside."""

import importlib
import inspect
import os
import pickle
import subprocess
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from enum import Enum
from types import NoneType, UnionType
from typing import Literal, Union, get_args, get_origin

import numpy as np
import pytest
from public_packages import TOPICS

import spherekit as sk
from spherekit.argument_validation import _fits, _resolved, judges
from spherekit.errors import ArgumentError, SpherekitError

PACKAGES = ("spherekit.plugin", *(f"spherekit.plugin.{topic}" for topic in TOPICS))
ANYTHING = object()
"""Something that no type allows but those that allow anything."""
MAY_BE_ANYTHING = ("Batch.once: key", "counted: number")
PLAIN = {bool: True, int: 1, float: 1.0, str: "x", NoneType: None}
HOLDERS = {tuple: (), Mapping: {}, dict: {}, frozenset: frozenset(), set: set()}


class Anyhow:
    """A stand-in for what is asked for by its attributes alone."""

    def __getattr__(self, name):
        return print


def allowed(hint):
    """Return something that a type allows."""
    origin, inner = get_origin(hint), get_args(hint)
    if hint in PLAIN:
        return PLAIN[hint]
    if origin is Literal:
        return inner[0]
    if _fits(np.zeros(1), hint):
        return np.zeros(1)
    if _fits(np.array(["x"]), hint):
        return np.array(["x"])
    if origin in (Union, UnionType):
        return allowed(inner[0])
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
    return next(iter(hint)) if issubclass(hint, Enum) else object.__new__(hint)


def own(made):
    """Every public method of a class that takes arguments, as it is to be called."""
    for key in dir(made):
        if key[0] != "_" or key == "__call__":
            item = inspect.getattr_static(made, key)
            function = getattr(item, "__func__", item)
            if inspect.isfunction(function) and not isinstance(item, property):
                if getattr(function, "__isabstractmethod__", False):
                    continue  # plugins write it, and we call it
                bound = () if isinstance(item, staticmethod) else (ANYTHING,)
                bound = (made,) if isinstance(item, classmethod) else bound
                yield f"{made.__name__}.{key}", function, bound


def callables():
    """Every function, class and method that plugins may call, with what it is bound to."""
    for package in map(importlib.import_module, PACKAGES):
        for name in package.__all__:
            value = getattr(package, name)
            if inspect.isfunction(value):
                yield name, value, ()
            elif inspect.isclass(value) and not issubclass(value, Exception | Enum):
                if getattr(value, "_is_protocol", False):
                    continue  # whoever answers to it is no class of ours
                if "__init__" in dir(value) and inspect.isfunction(value.__init__):
                    yield name, value.__init__, (ANYTHING,)
                yield from own(value)


def test_every_public_callable_of_plugins_is_checked():
    """Each refuses an object of no known type in each of its arguments, by its name."""
    count, missed = 0, []
    for name, function, bound in callables():
        parameters = list(inspect.signature(function).parameters.values())[len(bound) :]
        hints = {item.name: _resolved(function, item.annotation) for item in parameters}
        for wrong in parameters:
            if _fits(ANYTHING, hints[wrong.name]):
                where = f"{name}: {wrong.name}"
                assert where in MAY_BE_ANYTHING or where.endswith(".put: new")
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
                if f"{wrong.name} is <object" not in str(error):
                    missed.append(f"{name}: {wrong.name}: {error}")
            except Exception as error:
                missed.append(f"{name}: {wrong.name}: {error!r}")
            else:
                missed.append(f"{name}: {wrong.name} may be anything")
    assert not missed, "\n".join(missed)
    assert count > 800


def test_messages_say_where_what_and_what_to_try():
    from spherekit.plugin import Arrow, Table, conformance
    from spherekit.plugin.workspace import closed_kinematics, find_region

    five_bar = sk.load("five_bar")
    for wrong, said in [
        (lambda: closed_kinematics("five_bar"), "mechanism is .*spherekit.load"),
        (lambda: closed_kinematics(five_bar, outptu="x"), 'did you mean "output"'),
        (lambda: find_region(print, most=1e6), "find_region: most .* a whole number"),
        (lambda: Arrow("a", "b", 3.0), "Arrow: missing a required argument: 'primary'"),
        (lambda: Table("a", "b", ["sample"]), r"Table: columns .* each Column"),
        (lambda: conformance(int), "conformance: analysis .* AbstractAnalysis or one that"),
    ]:
        with pytest.raises(ArgumentError, match=said):
            wrong()


def test_names_are_those_of_the_library_to_help_and_to_pickle():
    from spherekit.plugin.dynamics import inertia
    from spherekit.plugin.singularities import LockedInputSection

    ours = importlib.import_module("spherekit.dynamics.coordinates").inertia
    assert inspect.signature(inertia) == inspect.signature(ours)
    assert inertia.__doc__ == ours.__doc__ and inertia.__name__ == ours.__name__
    assert judges(inertia) and not judges(ours)
    assert pickle.loads(pickle.dumps(inertia)) is inertia
    assert list(inspect.signature(LockedInputSection).parameters) == list(
        LockedInputSection.__dataclass_fields__
    )


INSIDE = """
import spherekit.plugin
from spherekit.plugin.workspace import output_kinematics
import spherekit as sk

solver = output_kinematics(sk.load("five_bar"), graph=True)
for name in ("outside", "spherekit.within"):
    try:
        exec("solver.forward('a')", {"solver": solver, "__name__": name})
    except Exception as error:
        print(type(error).__name__)
"""


def test_objects_judge_what_comes_from_outside_alone():
    """Also those of classes that extend an offered one and are named nowhere."""
    out = subprocess.run(
        [sys.executable, "-c", INSIDE], capture_output=True, text=True, check=True
    )
    outside, within = out.stdout.split()
    assert outside == "ArgumentError" and within != "ArgumentError"
