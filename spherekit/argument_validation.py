"""Decorators by which public functions and classes refuse arguments of wrong types.

A message names the function and the argument, and says what was found and what is allowed.
Calls within spherekit are checked by mypy, so private functions need no decorator.
"""

import contextlib
import functools
import inspect
import re
from collections.abc import Callable, Iterable
from typing import Any, ParamSpec, TypeVar, get_type_hints

from spherekit.errors import SpherekitError
from spherekit.type_checks import type_fault
from spherekit.wording import choices, listing

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")
Class = TypeVar("Class")

MAX_LISTED_ARGUMENTS = 30
"""Largest number of valid arguments listed in a message about an unknown argument."""


def checked(
    error: type[SpherekitError],
) -> Callable[[Callable[Parameters, Result]], Callable[Parameters, Result]]:
    """Return a decorator by which a function checks the types of its arguments.

    A decorated function raises `error` if an argument is unknown or missing, or has a type
    that differs from its annotation.
    """

    def decorate(function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
        """Return a function that checks its arguments and then calls `function`.

        A public function is decorated with `checked(error)`, and `error` is the class of
        its errors. A wrong argument raises this error with a message that names the
        function.
        """
        signature = inspect.signature(function)

        @functools.cache
        def annotations() -> dict[str, Any]:
            """Return the types of the parameters of `function` by name; they are read once.

            They are read at the first call of `function`. So an annotation can name a type
            that is defined after the function.
            """
            return {
                name: resolved_annotation(function, parameter.annotation)
                for name, parameter in signature.parameters.items()
            }

        @functools.wraps(function)
        def _check_and_call(*args: Parameters.args, **kwargs: Parameters.kwargs) -> Result:
            # No docstring here: `wraps` copies that of `function`, which users see.
            try:
                arguments = signature.bind(*args, **kwargs).arguments
            except TypeError as bind_error:  # an argument is unknown, missing or repeated
                message = _bind_message(signature, kwargs, bind_error)
                raise error(f"{_public_name(function)}: {message}") from None
            for name, value in arguments.items():
                # One value, or all values of a parameter such as ``*names``. The annotation
                # of such a parameter is the type of each of them.
                for item in _annotated_values(signature.parameters[name], value):
                    if fault := type_fault(name, item, annotations()[name]):
                        raise error(f"{_public_name(function)}: {fault}")
            return function(*args, **kwargs)

        return _check_and_call

    return decorate


def _annotated_values(parameter: inspect.Parameter, value: Any) -> tuple[Any, ...]:
    """Return the values of an argument that must each have the annotated type.

    The annotation of ``*args`` is the type of each item. Any other argument is one value.
    Functions with ``**kwargs`` annotate them as `Any`, which allows every value.
    """
    if parameter.kind is inspect.Parameter.VAR_POSITIONAL:
        return tuple(value)
    return (value,)


def checked_class(
    error: type[SpherekitError], *methods: str
) -> Callable[[type[Class]], type[Class]]:
    """Return a class decorator by which methods check the types of their arguments.

    The constructor and the named methods then raise `error` for a wrong argument.
    """

    def decorate(cls: type[Class]) -> type[Class]:
        for name in ("__init__", *methods):
            setattr(cls, name, checked(error)(getattr(cls, name)))
        return cls

    return decorate


def check_fields(instance: object, error: type[SpherekitError], where: str) -> None:
    """Raise an error if a field of a dataclass has another type than its annotation states.

    Public dataclasses call this for values from users.

    Parameters
    ----------
    instance
        An instance of a dataclass.
    error
        The class of the error.
    where
        The beginning of the message, such as the name of the class.
    """
    cls: Any = type(instance)
    for name, annotation in _class_annotations(cls).items():
        if fault := type_fault(name, getattr(instance, name), annotation):
            raise error(f"{where}: {fault}")


_class_annotations = functools.cache(get_type_hints)


def resolved_annotation(function: Callable[..., Any], annotation: Any) -> Any:
    """Return the type that the annotation of a parameter states.

    An annotation may be a text, such as ``"Mechanism | None"``. Its names are looked up in
    the module of the function. The result is `Any`, which allows every type, if there is no
    annotation or if a name is missing. A name is missing if only type checkers import it.
    """
    if annotation is inspect.Parameter.empty:
        return Any
    # `get_type_hints` needs an object with annotations: a class with this annotation only.
    holder = type("_Holder", (), {"__annotations__": {"annotation": annotation}})
    names = inspect.unwrap(function).__globals__
    with contextlib.suppress(NameError):
        return get_type_hints(holder, names)["annotation"]
    return Any


def _public_name(function: Callable[..., Any]) -> str:
    """Return the name by which users call a function; for a constructor, its class."""
    *_, owner, name = ("", *function.__qualname__.split("."))
    return owner if name == "__init__" else name.strip("_")


def _bind_message(
    signature: inspect.Signature, keywords: Iterable[str], bind_error: TypeError
) -> str:
    """Return the message for a call with an unknown, missing or repeated argument.

    Parameters
    ----------
    signature
        The signature of the function.
    keywords
        The names of the keyword arguments of the call.
    bind_error
        The error that `inspect.Signature.bind` raised.
    """
    takes_any_keyword = any(
        parameter.kind is inspect.Parameter.VAR_KEYWORD
        for parameter in signature.parameters.values()
    )
    names = [name for name in signature.parameters if name != "self"]
    unknown = [keyword for keyword in keywords if keyword not in names]
    if unknown and not takes_any_keyword:
        ending = choices(unknown[0], names, "Arguments", MAX_LISTED_ARGUMENTS)
        return f'there is no argument "{unknown[0]}"{ending}'
    # Otherwise use Python's message, with other words for a missing argument.
    problem = re.sub(
        r"missing a required argument: '(\w+)'",
        r'the argument "\1" is missing',
        str(bind_error),
    )
    return f"{problem}. Arguments: {listing(names, MAX_LISTED_ARGUMENTS)}"
