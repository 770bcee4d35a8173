"""Masses and loads of a mechanism as numbers, for functions that apply to many designs.

The inertia tensors and load components of all designs have one form. Their numbers,
including those in the expressions of loads, are listed in a fixed order. A function of
designs takes these numbers as arguments.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from spherekit.mechanism.load import LinkMoment, LoadComponent
from spherekit.mechanism.load_expression import Expression
from spherekit.mechanism.mechanism import Mechanism
from spherekit.symbolic.expression_graph import ExpressionNode

LOAD_DEPENDENT_PREFIXES = (
    "torque",
    "generalized_force",
    "free_acceleration",
    "A_q",
    "A_dq",
)
"""Beginnings of the names of quantities that depend on loads and on rates of the inputs."""

MassesAndLoads = Any
"""Two nested tuples of dataclasses and numbers. The first has pairs of a link and the
rows of its inertia tensor in link axes, the second the components of every load."""


def masses_and_loads(mechanism: Mechanism) -> MassesAndLoads:
    """Return the inertia tensors and the load components of a mechanism."""
    tensors = tuple((mass.link, mass.tensor) for mass in mechanism.masses)
    components = tuple(load.components(mechanism) for load in mechanism.loads)
    return tensors, components


def replace_numbers(part: Any, replace_number: Callable[[Any], Any]) -> Any:
    """Return masses and loads, or a part of them, with other numbers.

    The nested data (tuples and dataclasses) are visited recursively. With all numbers
    replaced by symbols, one function applies to many designs. With all numbers replaced by
    0, the results show whether two mechanisms differ in numbers only. The original texts of
    expressions contain the old numbers, so the texts are removed.

    Parameters
    ----------
    part
        A number, an expression node, or any nested part of `MassesAndLoads`.
    replace_number
        Returns the new number or expression for a number or an expression node. Called in a
        fixed order.
    """
    if isinstance(part, tuple):
        return tuple(replace_numbers(item, replace_number) for item in part)
    if isinstance(part, ExpressionNode):
        return replace_number(part)
    if isinstance(part, int | float):
        return replace_number(float(part))
    # Only the numbers of these dataclasses are replaced. Other parts, such as names,
    # functions and tables of torques, stay the same. A mass is a tuple of a link and its
    # inertia tensor.
    fields_with_numbers: dict[str, Any] = {}
    if isinstance(part, LoadComponent):
        fields_with_numbers = {"magnitude": part.magnitude, "moments": part.moments}
        # `bearing_friction` is a load of the mechanism file, which has the old numbers.
        part = replace(part, bearing_friction=None)
    elif isinstance(part, LinkMoment):
        fields_with_numbers = {"direction": part.direction, "arm": part.arm}
    elif isinstance(part, Expression):
        fields_with_numbers = {"root": part.root}
        part = replace(part, text="")
    new_fields = {
        name: replace_numbers(value, replace_number)
        for name, value in fields_with_numbers.items()
    }
    return replace(part, **new_fields) if new_fields else part


def list_numbers(part: MassesAndLoads) -> list[float]:
    """Return all numerical values of masses and loads in their fixed order."""
    numbers: list[float] = []
    replace_numbers(part, numbers.append)
    return numbers
