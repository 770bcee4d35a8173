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
from spherekit.type_checks import has_type, type_fault
from spherekit.type_descriptions import describe_type

PUBLIC_PACKAGES = ("spherekit", "spherekit.display")
RESULT_CLASSES = (
    *("Kinematics", "Mechanism", "Motion"),
    *("Plan", "RunResult", "Simulation"),
)
"""Classes of the front whose objects functions of ours make."""
INTERNAL_METHODS = {
    "Bearings": "supported_loads",
    "ContactFriction": "supported_loads",
    "Digits": "within",
    "Mechanism": "angle_between names_of variables_of",
    "Motion": "assign_rows concatenate rows",
    "Plan": "name pole",
    "RerunRecorder": "log start",
    "InverseKinematics": "no_closed_form",
    "Start": "of",
    "Study": "fault",
    "TorqueTable": "knots one",
}
"""Methods by which parts of the library ask each other, as do all of `Load`."""
FOUR_BAR = sk.load("four_bar")
OBJECT_BY_CLASS = {
    sk.Mechanism: FOUR_BAR,
    sk.Start: sk.Start(0.3, 1.0),
}
"""Valid objects of classes whose methods read their attributes."""
WRONG_OBJECT = object()
"""An object that no type hint allows, except for those that allow anything."""
VALUE_BY_TYPE = {bool: True, int: 1, float: 1.0, str: "x", NoneType: None}
"""A value of each built-in type."""
EMPTY_BY_COLLECTION = {tuple: (), Mapping: {}, dict: {}, frozenset: frozenset(), set: set()}
"""An empty collection of each type."""


class AnyAttributes:
    """An object with every attribute, for parameters that are judged by attributes only."""

    def __getattr__(self, name):
        return print


def allowed(hint):
    """Return some value that a type hint allows.

    Tests call functions with it. The value need not make sense: it only has to pass the
    check of types. Kinds of hints are tried in turn. Arrays come before unions, because the
    hint `ArrayLike` is a union of many types.
    """
    origin = get_origin(hint)
    arguments = get_args(hint)
    # Built-in types, and classes for which a valid object is made beforehand.
    if hint in VALUE_BY_TYPE or hint in OBJECT_BY_CLASS:
        return (VALUE_BY_TYPE | OBJECT_BY_CLASS)[hint]
    if origin is Literal:
        return arguments[0]
    if has_type(np.zeros(1), hint):
        return np.zeros(1)
    if has_type(np.array(["x"]), hint):
        return np.array(["x"])
    if origin in (Union, UnionType):
        return allowed(
            next((part for part in arguments if part in OBJECT_BY_CLASS), arguments[0])
        )
    # `tuple[int, str]` has a type for each item; `tuple[int, ...]` may be empty.
    is_fixed_tuple = origin is tuple and arguments[1:] != (...,)
    if is_fixed_tuple:
        return tuple(allowed(item) for item in arguments)
    if origin in (Sequence, Iterable, list):
        return []
    if origin in EMPTY_BY_COLLECTION:
        return EMPTY_BY_COLLECTION[origin]
    if origin is os.PathLike:
        return os.devnull
    if origin is Callable:
        return print  # any function will do
    if origin is type:
        return arguments[0]
    if getattr(hint, "_is_protocol", False):
        return AnyAttributes()
    # An abstract class has no instances. A subclass whose set of abstract methods is
    # emptied has some.
    if inspect.isabstract(hint):
        hint = type("Extended", (hint,), {})
        hint.__abstractmethods__ = frozenset()
    if issubclass(hint, Enum):
        return next(iter(hint))
    # An instance of a class without attributes: `__init__` is not called.
    base = tuple if issubclass(hint, tuple) else object
    return base.__new__(hint)


def public_methods(cls):
    """Yield the public methods of a class as plain functions, with their first arguments.

    Abstract methods are left out: plugins define them, and only spherekit calls them.

    Yields
    ------
    name, function
        Name and plain function of a method.
    bound
        Tuple with the argument that Python passes first: the class for a class method, an
        object for a method (``self``), nothing for a static method. Only for the classes of
        `OBJECT_BY_CLASS` the object is a valid one.
    """
    for name in dir(cls):
        if name.startswith("_") and name != "__call__":
            continue
        attribute = inspect.getattr_static(cls, name)
        # Static methods and class methods contain a plain function.
        function = getattr(attribute, "__func__", attribute)
        if not inspect.isfunction(function):
            continue
        if getattr(function, "__isabstractmethod__", False):
            continue
        if isinstance(attribute, staticmethod):
            bound = ()
        elif isinstance(attribute, classmethod):
            bound = (cls,)
        else:
            bound = (OBJECT_BY_CLASS.get(cls, WRONG_OBJECT),)
        yield name, function, bound


def callables():
    """Yield every public function, constructor and method of `PUBLIC_PACKAGES`.

    What users do not call is left out: exceptions, enumerations, protocols, constructors of
    results (`RESULT_CLASSES`, which functions of spherekit return), and methods that only
    spherekit calls (`INTERNAL_METHODS`, and all methods of `Load`).

    Yields
    ------
    name, function
        Name and plain function.
    bound
        Tuple with the first argument of a method (``self`` or the class) or constructor
        (an object without attributes). Empty for functions and static methods.
    """
    for package in map(importlib.import_module, PUBLIC_PACKAGES):
        for name in package.__all__:
            value = getattr(package, name)
            if inspect.isfunction(value):
                yield name, value, ()
                continue
            if not inspect.isclass(value) or issubclass(value, Exception | Enum):
                continue
            if getattr(value, "_is_protocol", False):
                continue
            if inspect.isfunction(value.__init__) and name not in RESULT_CLASSES:
                new_object = allowed(value)  # an object before `__init__` is called
                yield name, value.__init__, (new_object,)
            left_out = {*INTERNAL_METHODS.get(name, "").split(), *dir(Load)}
            for method, function, bound in public_methods(value):
                if method not in left_out:
                    yield f"{name}.{method}", function, bound


def test_every_public_callable_refuses_a_wrong_type_by_the_name_of_the_argument():
    """Every public function refuses an argument of a wrong type, and names the argument.

    Each argument in turn is an object that its type hint does not allow. All other required
    arguments have values that their hints allow (`allowed`). The call must raise a
    `SpherekitError`. An argument that is the name of a part of a mechanism need not be
    named. `callables` lists all public functions, constructors and methods.
    """
    count = 0
    missed = []
    # `bound` has the first argument of a method (``self`` or the class), if there is one.
    for name, function, bound in callables():
        parameters = list(inspect.signature(function).parameters.values())[len(bound) :]
        hints = {p.name: resolved_annotation(function, p.annotation) for p in parameters}
        required = [
            p for p in parameters if p.default is p.empty and p.kind is not p.VAR_POSITIONAL
        ]
        for wrong in parameters:
            # This argument may be anything, so it has no wrong type.
            if has_type(WRONG_OBJECT, hints[wrong.name]):
                continue
            count += 1
            keywords = {p.name: allowed(hints[p.name]) for p in required}
            positional = [*bound]
            if wrong.kind is wrong.VAR_POSITIONAL:
                positional.append(WRONG_OBJECT)
            else:
                keywords[wrong.name] = WRONG_OBJECT
            try:
                function(*positional, **keywords)
            except SpherekitError as error:
                # The message names the argument and shows the wrong object: 'NAME is
                # <object ...'. For the name of a part it may say instead that there is no
                # such part: 'no pair is named "<object ...'.
                if not re.search(f'({wrong.name} is|is named) "?<object', str(error)):
                    missed.append(f"{name}: {wrong.name}: {error}")
            except Exception as error:
                missed.append(f"{name}: {wrong.name}: {error!r}")
            else:
                missed.append(f"{name}: {wrong.name} may be anything")
    assert not missed, "\n".join(missed)
    assert count > 300  # so the test does look at the public functions


@pytest.mark.parametrize("call", TABLES["arguments"])
def test_messages_say_where_what_and_what_to_try(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = {"sk": sk, "FOUR_BAR": FOUR_BAR}
    check_call(call, names, TABLES["arguments"][call])
    assert list(tmp_path.iterdir()) == []


def test_checked_functions_accept_numpy_numbers_and_lists_and_refuse_other_types():
    """The decorator `checked` accepts NumPy's numbers as numbers and lists as tuples.

    It refuses other types, and missing, misspelt or too many arguments. A type hint that is
    not defined (`NoSuchType`) is ignored.
    """

    @checked(SpherekitError)
    def function(
        count: int,
        size: float = 1.0,
        flag: bool = False,
        words: "tuple[str, ...] | None" = None,
        late: "NoSuchType | None" = None,  # noqa: F821
        numbers: ArrayLike | None = None,
    ) -> int:
        return count

    assert function(np.int64(3), np.float32(2), np.bool_(True), ["a", "b"], object()) == 3
    assert function(count=3, size=2) == 3
    for numbers in (1, 0.5, [1, 2], [[1.0], [2.0]], np.eye(3), None):
        assert function(3, numbers=numbers) == 3
    for wrong in ([3.0], [True], [3, "2"], [3, 2.0, False, None, None, "a"]):
        with pytest.raises(SpherekitError):
            function(*wrong)
    missing = 'function: the argument "count" is missing'
    with pytest.raises(SpherekitError, match=missing):
        function()
    misspelt = r'function: there is no argument "cnt"; did you mean'
    with pytest.raises(SpherekitError, match=misspelt):
        function(cnt=3)


@pytest.mark.parametrize(
    "hint", [int | Sequence[int], tuple[int, ...], tuple[int, int], Iterable[int]]
)
def test_an_array_without_dimensions_is_no_sequence(hint):
    fault = type_fault("samples", np.array(5), hint)
    assert fault.startswith("samples is array(5) (ndarray); it has to be ")


@pytest.mark.parametrize(
    ("value", "hint"),
    [(np.str_("deg"), Literal["deg", "rad"]), (np.int64(2), Literal[1, 2])],
)
def test_texts_and_numbers_of_numpy_are_choices(value, hint):
    assert has_type(value, hint)


@pytest.mark.parametrize("value", [True, np.True_, 1.0, "1", None])
def test_values_of_another_type_are_no_choices(value):
    assert not has_type(value, Literal[1, 2])


def test_a_long_text_is_shortened_in_the_message_about_a_choice():
    assert f'found "{57 * "x"}...".' in type_fault("x", 300 * "x", Literal["a", "b"])
    assert f'found "{60 * "x"}".' in type_fault("x", 60 * "x", Literal["a", "b"])


def test_a_tuple_of_one_number_is_described_in_the_singular():
    assert describe_type(tuple[float]) == "a tuple (a number)"
    assert describe_type(tuple[float, float]) == "a tuple of 2 numbers"
