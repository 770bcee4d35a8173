"""Masses and loads as numbers that a kernel has as inputs.

What a mechanism's tensors are and what its loads are made of has one form for all designs;
the numbers in it, those of the texts of laws included, come one after another.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from spherekit.engine.expression_graph import Expr
from spherekit.engine.turns import Entries
from spherekit.model.expression import Call, Expression, Name, Node, Number
from spherekit.model.load import Component, LinkMoment
from spherekit.model.mechanism import Mechanism

_Each = Callable[[Any], Any]


@final
@dataclass(frozen=True)
class Actions:
    """Tensors (rows of link axes) by link, and the components of every load."""

    tensors: tuple[tuple[str, tuple[tuple[Any, ...], ...]], ...]
    loads: tuple[tuple[Component, ...], ...]

    @staticmethod
    def of(mechanism: Mechanism) -> "Actions":
        """Return those of a mechanism."""
        tensors = [
            (mass.link, tuple(tuple(map(float, row)) for row in mass.tensor))
            for mass in mechanism.masses
        ]
        return Actions(
            tuple(tensors), tuple(load.components(mechanism) for load in mechanism.loads)
        )

    def mapped(self, change: _Each) -> "Actions":
        """Return the same form with other numbers, asked for in one order."""
        tensors = tuple(
            (link, tuple(tuple(change(x) for x in row) for row in rows))
            for link, rows in self.tensors
        )
        loads = tuple(tuple(_component(x, change) for x in parts) for parts in self.loads)
        return Actions(tensors, loads)

    @property
    def numbers(self) -> list[float]:
        """All numbers, in order."""
        numbers: list[float] = []
        self.mapped(numbers.append)
        return numbers

    @property
    def form(self) -> "Actions":
        """What is left without the numbers: equal for mechanisms that differ in these."""
        return self.mapped(lambda number: 0.0)

    def replaced(self, numbers: Sequence[Expr]) -> "Actions":
        """Return the same form with these numbers or terms."""
        more: Iterator[Expr] = iter(numbers)
        return self.mapped(lambda number: next(more))

    def by_link(self, mechanism: Mechanism) -> dict[int, Entries]:
        """Return the tensors (3, 3) by the number of their link."""
        made: dict[int, Entries] = {}
        for link, rows in self.tensors:
            plain = all(isinstance(x, float) for row in rows for x in row)
            made[mechanism.link_number[link]] = np.array(rows, float if plain else object)
        return made


def _component(part: Component, change: _Each) -> Component:
    law = part.magnitude
    if isinstance(law, Expression):
        law = Expression("", law.names, _tree(law.root, change))
    return Component(law, part.pair, tuple(_moment(x, change) for x in part.moments))


def _moment(moment: LinkMoment, change: _Each) -> LinkMoment:
    x, y, z = map(change, moment.direction)
    arm = None
    if moment.arm is not None:
        a, b, c = map(change, moment.arm)
        arm = a, b, c
    return LinkMoment(moment.link, (x, y, z), moment.axes, arm)


def _tree(node: Node, change: _Each) -> Node:
    if isinstance(node, Number):
        return Number(change(node.value))
    if isinstance(node, Name):
        return node
    match node:
        case Call("negative", (Number(value),)):
            # A number below zero has no other form than one above.
            return Number(change(-value))
    return Call(node.function, tuple(_tree(x, change) for x in node.arguments))
