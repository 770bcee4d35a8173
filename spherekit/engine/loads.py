"""Loads as expressions of the generalised forces they exert on the motion.

What loads do is said in `spherekit.model.dynamics`; here the coordinate of one freedom is
the homogeneous parameter p. Where an expression is not smooth it asks for a switch, a
factor +1 or -1 that the integration changes exactly where a condition passes through zero.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.conventions import TURN
from spherekit.engine.algebra import Exprs, constants, cross, dot, vector
from spherekit.engine.expression_graph import (
    BY_OPERATOR,
    Expr,
    function,
    need_divisor,
)
from spherekit.engine.kinematics import RateExpressions
from spherekit.engine.pose import LinkOrientation
from spherekit.model.expression import Expression, fold
from spherekit.model.load import Called, Component, Load, TorqueTable, Vector, expression_of
from spherekit.model.mechanism import Mechanism


@final
@dataclass(frozen=True)
class LoadState:
    """A mechanism in motion, as loads see it.

    `tau[i][v]` and `w[i][link]` (3,) are what variables and links turn by per unit of the
    i-th coordinate; `placed` are the placements, `rates` those of the variables by time,
    `time` the time. `switch(condition)` is +1 where an expression is positive and -1
    where it is negative, `table(name)` the torque of a table now. `variables` are reduced
    by whole turns, the k-th by `turns[k]` of them.
    """

    mechanism: Mechanism
    placed: Sequence[LinkOrientation]
    tau: Sequence[Sequence[Expr]]
    w: Sequence[Sequence[Exprs]]
    variables: Sequence[Expr]
    turns: Sequence[Expr]
    rates: Sequence[Expr]
    time: Expr
    switch: Callable[[Expr], Expr]
    table: Callable[[str], Expr]

    @staticmethod
    def along(
        flow: RateExpressions,
        variables: Sequence[Expr],
        turns: Sequence[Expr],
        speed: Expr,
        time: Expr,
        switch: Callable[[Expr], Expr],
        table: Callable[[str], Expr],
    ) -> "LoadState":
        """Return the state of a motion whose only coordinate p changes by dp/dt = speed."""
        return LoadState(
            flow.structure.mechanism,
            flow.placed,
            [flow.tau[0]],
            [flow.w[0]],
            variables,
            turns,
            [rate * speed for rate in flow.tau[0]],
            time,
            switch,
            table,
        )

    def variable(self, pair: str) -> int:
        """Return the number of an R pair's variable."""
        mechanism = self.mechanism
        return mechanism.variables_of(mechanism.pair_number[pair])[0]

    def angle(self, pair: str) -> Expr:
        """Return the angle of an R pair (rad), whole turns included."""
        number = self.variable(pair)
        return self.variables[number] + TURN * self.turns[number]

    def direction(self, pair: str) -> Expr:
        """Return the angle of an R pair up to whole turns: for sines and the like.

        After many turns it is the more accurate one.
        """
        return self.variables[self.variable(pair)]

    def rate(self, pair: str) -> Expr:
        """Return dtheta/dt of an R pair (rad/s)."""
        return self.rates[self.variable(pair)]


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


def generalised_forces(load: Load, moving: LoadState) -> list[Expr]:
    """Return the power of a load per unit rate of each coordinate."""
    return forces_of(load.components(moving.mechanism), moving)


def forces_of(parts: Sequence[Component], moving: LoadState) -> list[Expr]:
    """Return the power of a load's components per unit rate of each coordinate."""
    totals: list[Expr] = [0.0] * len(moving.tau)
    on_links: dict[tuple[str, str, Vector | None], Exprs] = {}
    for part in parts:
        magnitude = _magnitude(part.magnitude, moving)
        if part.pair:
            variable = moving.variable(part.pair)
            totals = [
                total + magnitude * tau[variable]
                for total, tau in zip(totals, moving.tau, strict=True)
            ]
        for moment in part.moments:
            key = moment.link, moment.axes, moment.arm
            along = vector([magnitude * component for component in moment.direction])
            on_links[key] = on_links[key] + along if key in on_links else along
    for (link, axes, arm), along in on_links.items():
        number = moving.mechanism.link_number[link]
        if number and not (arm is not None and not any(arm)):
            turning = _moment(moving.placed[number], axes, arm, along)
            totals = [
                total + dot(w[number], turning)
                for total, w in zip(totals, moving.w, strict=True)
            ]
    return totals


def steep_arguments(load: Load, moving: LoadState) -> list[Expr]:
    """Return what the load's `Expression.steep_and_smooth` are; kinks have switches."""
    laws = [part.magnitude for part in load.components(moving.mechanism)]
    return [
        expression_value(argument, moving)
        for law in laws
        if isinstance(law, Expression)
        for argument in law.steep_and_smooth
    ]


def _moment(placed: LinkOrientation, axes: str, arm: Vector | None, along: Exprs) -> Exprs:
    """Return a moment (3,), or that of a force with an arm, in ground axes."""
    if axes == "ground":
        if arm is None:
            return along
        if not all(isinstance(component, float) for component in arm):
            return cross(placed.direction(vector(list(arm))), along)
        size = float(np.linalg.norm(arm))
        return cross(placed.direction(np.array(arm) / size) * size, along)
    moment = along if arm is None else cross(vector(list(arm)), along)
    return np.asarray(placed.basis @ (constants(placed.within) @ moment))


def _magnitude(law: Expression | Called | TorqueTable, moving: LoadState) -> Expr:
    if isinstance(law, TorqueTable):
        return moving.table(law.name)
    return expression_value(expression_of(law), moving)


def expression_value(law: Expression, moving: LoadState) -> Expr:
    """Return an expression's value.

    Beside each part stands one that differs from it by whole turns at most, formed of
    angles without their turns: sines and the like are taken of that.
    """

    def named(name: str) -> tuple[Expr, Expr]:
        kind, _, pair = name.partition("_")
        if kind == "theta":
            return moving.angle(pair), moving.direction(pair)
        value = moving.time if name == "t" else moving.rate(pair)
        return value, value

    def apply(name: str, parts: list[tuple[Expr, Expr]]) -> tuple[Expr, Expr]:
        whole, reduced = zip(*parts, strict=True)
        need_divisor(law, name, whole)
        if name in _PERIODIC:
            whole = reduced
        if name in BY_OPERATOR:
            value = BY_OPERATOR[name](*whole)
            if name in _COUNTS_TURNS or (name == "*" and any(map(_is_whole, whole))):
                return value, BY_OPERATOR[name](*reduced)
            return value, value
        if name in _BY_SWITCH:
            value = _BY_SWITCH[name](moving, *whole)
        else:
            value = function(name, *whole)
        return value, value

    return fold(law.root, lambda value: (value, value), named, apply)[0]


_PERIODIC = ("sin", "cos", "tan")

_COUNTS_TURNS = ("+", "-", "negative")


def _is_whole(item: Expr) -> bool:
    return isinstance(item, float) and item.is_integer()


def _larger(moving: LoadState, *items: Expr) -> Expr:
    best = items[0]
    for item in items[1:]:
        gap = best - item
        best = 0.5 * (best + item + moving.switch(gap) * gap)
    return best


def _smaller(moving: LoadState, *items: Expr) -> Expr:
    return -1.0 * _larger(moving, *(-1.0 * item for item in items))


_BY_SWITCH: Mapping[str, Callable[..., Expr]] = {
    "abs": lambda moving, a: moving.switch(a) * a,
    "sign": lambda moving, a: moving.switch(a),
    "max": _larger,
    "min": _smaller,
}
