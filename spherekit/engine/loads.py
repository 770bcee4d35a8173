"""Loads as expressions of the generalised force they exert on the motion.

A load's generalised force for the homogeneous parameter p is its power per unit rate of p:
a torque times dtheta/dp of its pair, a moment times the angular velocity of its link per
unit of p (Di Gregorio 2024, eq. (12)). Where an expression is not smooth it asks for a
switch, a factor +1 or -1 that the integration changes exactly where a condition passes
through zero.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.engine.algebra import Exprs, constants, cross, dot, vector
from spherekit.engine.kinematics import Flow
from spherekit.engine.terms import Expr, function, power
from spherekit.model.dynamics import (
    Damper,
    Friction,
    Gravity,
    Load,
    Moment,
    PairTorque,
    PointForce,
    Spring,
)
from spherekit.model.expression import Call, Name, Node, Number, load_names, parse
from spherekit.model.mechanism import Mechanism
from spherekit.sphere.rotation import Floats

FULL_TURN = 6.283185307179586


@final
@dataclass(frozen=True)
class Moving:
    """A mechanism in motion, as loads see it.

    `flow` gives directions, placements and angular velocities per unit of p, `speed` is
    dp/dt, `time` the time. `switch(condition)` is +1 where an expression is positive and
    -1 where it is negative, `table(name)` the torque of a table now. `variables` are
    reduced by whole turns, the k-th by `turns[k]` of them.
    """

    flow: Flow
    variables: Sequence[Expr]
    turns: Sequence[Expr]
    speed: Expr
    time: Expr
    switch: Callable[[Expr], Expr]
    table: Callable[[str], Expr]

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism that moves."""
        return self.flow.structure.mechanism

    def variable(self, pair: str) -> int:
        """Return the number of an R pair's variable."""
        mechanism = self.mechanism
        return mechanism.variables_of(mechanism.pair_number[pair])[0]

    def angle(self, pair: str) -> Expr:
        """Return the angle of an R pair (rad), whole turns included."""
        number = self.variable(pair)
        return self.variables[number] + FULL_TURN * self.turns[number]

    def direction(self, pair: str) -> Expr:
        """Return the angle of an R pair up to whole turns: for sines and the like.

        After many turns it is the more accurate one.
        """
        return self.variables[self.variable(pair)]

    def coefficient(self, pair: str) -> Expr:
        """Return dtheta/dp of an R pair."""
        return self.flow.tau[0][self.variable(pair)]

    def rate(self, pair: str) -> Expr:
        """Return dtheta/dt of an R pair (rad/s)."""
        return self.coefficient(pair) * self.speed


@final
class Switches:
    """The conditions that loads switch on; `factor(k)` stands for the sign of the k-th."""

    def __init__(self, factor: Callable[[int], Expr]) -> None:
        self.factor = factor
        self.conditions: list[Expr] = []

    def __call__(self, condition: Expr) -> Expr:
        """Return the factor of a condition."""
        if condition not in self.conditions:
            self.conditions.append(condition)
        return self.factor(self.conditions.index(condition))


def generalised_force(load: Load, moving: Moving) -> Expr:
    """Return the power of a load per unit rate of the homogeneous parameter."""
    if isinstance(load, Gravity):
        return _gravity(load, moving)
    if isinstance(load, PointForce | Moment):
        return _on_link(load, moving)
    return _torque(load, moving) * moving.coefficient(load.pair)


def _torque(load: Load, moving: Moving) -> Expr:
    """Return the torque of a load at a pair."""
    if isinstance(load, PairTorque):
        return _expression(load.torque, moving)
    if isinstance(load, Spring):
        return -load.stiffness * (moving.angle(load.pair) - load.rest)
    if isinstance(load, Damper):
        return -load.damping * moving.rate(load.pair)
    if isinstance(load, Friction):
        rate = moving.rate(load.pair)
        dry = load.torque * function("tanh", rate * (1.0 / load.speed))
        return -1.0 * (dry + load.viscous * rate)
    return moving.table(load.name)


def _gravity(load: Gravity, moving: Moving) -> Expr:
    flow, total = moving.flow, 0.0
    g = vector([float(each) for each in load.acceleration])
    for mass in moving.mechanism.masses:
        link = moving.mechanism.link_number[mass.link]
        if link and mass.mass and mass.centre is not None and any(mass.centre):
            arm = _direction(flow, link, mass.mass * np.array(mass.centre))
            total = total + dot(flow.w[0][link], cross(arm, g))
    return total


def _on_link(load: PointForce | Moment, moving: Moving) -> Expr:
    """Return the power of a moment about O, that of a force included."""
    flow = moving.flow
    link = moving.mechanism.link_number[load.link]
    in_link = load.axes == "link"
    if isinstance(load, Moment):
        moment = vector([_expression(text, moving) for text in load.moment])
    else:
        force = vector([_expression(text, moving) for text in load.force])
        point = np.array(load.point)
        arm = vector(list(map(float, point)))
        moment = cross(arm if in_link else _direction(flow, link, point), force)
    if in_link:
        placed = flow.placed[link]
        moment = np.asarray(placed.basis @ (constants(placed.within) @ moment))
    return dot(flow.w[0][link], moment)


def _direction(flow: Flow, link: int, given: Floats) -> Exprs:
    """Return a vector (3,) of any length, fixed in a link, in ground axes."""
    size = float(np.linalg.norm(given))
    if size == 0.0:
        return vector([0.0, 0.0, 0.0])
    return np.asarray(flow.placed[link].direction(given / size) * size)


def _expression(text: str, moving: Moving) -> Expr:
    pairs = [pair.name for pair in moving.mechanism.pairs if pair.type == "R"]
    return _convert(parse(text, load_names(pairs)).root, moving, moving.angle)


def _convert(node: Node, moving: Moving, angle: Callable[[str], Expr]) -> Expr:
    if isinstance(node, Number):
        return node.value
    if isinstance(node, Name):
        if node.name == "t":
            return moving.time
        kind, _, pair = node.name.partition("_")
        return angle(pair) if kind == "theta" else moving.rate(pair)
    if node.function in _PERIODIC and all(map(_counts_turns, node.arguments)):
        angle = moving.direction
    arguments = [_convert(each, moving, angle) for each in node.arguments]
    if node.function in _BY_OPERATOR:
        return _BY_OPERATOR[node.function](*arguments)
    if node.function in _BY_SWITCH:
        return _BY_SWITCH[node.function](moving, *arguments)
    return function(node.function, *arguments)


_PERIODIC = ("sin", "cos", "tan")


def _counts_turns(node: Node) -> bool:
    """Return whether a whole turn of any angle changes a value by whole turns."""
    if isinstance(node, Number | Name):
        return True
    if not _has_angle(node):
        return True
    arguments = node.arguments
    if node.function in ("+", "-", "negative"):
        return all(map(_counts_turns, arguments))
    whole = [isinstance(x, Number) and x.value == round(x.value) for x in arguments]
    return node.function == "*" and any(whole) and all(map(_counts_turns, arguments))


def _has_angle(node: Node) -> bool:
    if isinstance(node, Call):
        return any(map(_has_angle, node.arguments))
    return isinstance(node, Name) and node.name.startswith("theta_")


_BY_OPERATOR: Mapping[str, Callable[..., Expr]] = {
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "*": lambda a, b: a * b,
    "/": lambda a, b: a / b,
    "**": power,
    "negative": lambda a: -1.0 * a,
}


def _larger(moving: Moving, *items: Expr) -> Expr:
    best = items[0]
    for item in items[1:]:
        gap = best - item
        best = 0.5 * (best + item + moving.switch(gap) * gap)
    return best


def _smaller(moving: Moving, *items: Expr) -> Expr:
    return -1.0 * _larger(moving, *(-1.0 * item for item in items))


_BY_SWITCH: Mapping[str, Callable[..., Expr]] = {
    "abs": lambda moving, a: moving.switch(a) * a,
    "sign": lambda moving, a: moving.switch(a),
    "max": _larger,
    "min": _smaller,
}
