"""Masses and loads as numbers that are inputs of a kernel.

What a mechanism's tensors are and what its loads are made of has one form for all designs;
the numbers in it, those of the texts of laws included, come one after another.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from spherekit.mechanism.load import Component, LinkMoment
from spherekit.mechanism.load_expression import Expression
from spherekit.mechanism.mechanism import Mechanism
from spherekit.symbolic.expression_graph import ExpressionNode

LOADED = ("torque", "generalized_force", "free_acceleration", "A_q", "A_dq")
"""How quantities begin that loads and rates of the inputs enter."""


Actions = Any
"""Tensors (rows of link axes) by link, and the components of every load, in tuples."""


def actions_of(mechanism: Mechanism) -> Actions:
    """Return the masses and loads of a mechanism."""
    tensors = ((mass.link, mass.tensor) for mass in mechanism.masses)
    return tuple(tensors), tuple(load.components(mechanism) for load in mechanism.loads)


def with_other_numbers(part: Any, change: Callable[[Any], Any]) -> Any:
    """Return the same form with other numbers or terms, asked for in one order.

    With 0 for every number it is equal for mechanisms that differ in these alone.
    """
    if isinstance(part, tuple):
        return tuple(with_other_numbers(item, change) for item in part)
    if isinstance(part, ExpressionNode):
        return change(part)
    if isinstance(part, int | float):
        return change(float(part))
    parts: dict[str, Any] = {}
    if isinstance(part, Component):
        parts = {"magnitude": part.magnitude, "moments": part.moments}
        part = replace(part, rubs=None)
    elif isinstance(part, LinkMoment):
        parts = {"direction": part.direction, "arm": part.arm}
    elif isinstance(part, Expression):
        part, parts = replace(part, text=""), {"root": part.root}
    changed = {name: with_other_numbers(item, change) for name, item in parts.items()}
    return replace(part, **changed) if changed else part


def numbers_of(actions: Actions) -> list[float]:
    """Return all numbers of masses and loads, in order."""
    numbers: list[float] = []
    with_other_numbers(actions, numbers.append)
    return numbers
