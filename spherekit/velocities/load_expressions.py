"""Loads as expressions of the generalised forces they exert on the motion.

What loads do is said in `spherekit.mechanism.load_kinds`; here the coordinate of one
freedom is the homogeneous parameter p. Where an expression is not smooth it asks for a
switch, a factor +1 or -1 that the integration changes exactly where a condition passes
through zero.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import add

import numpy as np

from spherekit.conventions import TURN
from spherekit.mechanism.load import Component, Load, TorqueTable, expression_of
from spherekit.mechanism.load_expression import Expression
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.sizes import Vector
from spherekit.symbolic.expression_graph import Expr, dot
from spherekit.symbolic.parsed_expressions import convert_to_graph
from spherekit.symbolic.vector_algebra import Exprs, constants, cross, vector
from spherekit.velocities.pose_expressions import LinkOrientation


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

    def named(self, name: str) -> tuple[Expr, Expr]:
        """Return what a name in an expression stands for, and that less whole turns."""
        kind, _, pair = name.partition("_")
        if kind == "t":
            return self.time, self.time
        number = self.mechanism.angles[pair]
        if kind == "theta":
            angle = self.variables[number]
            return angle + TURN * self.turns[number], angle
        return self.rates[number], self.rates[number]


def generalised_forces(load: Load, moving: LoadState) -> list[Expr]:
    """Return the power of a load per unit rate of each coordinate."""
    return forces_of(load.components(moving.mechanism), moving)


def forces_of(parts: Sequence[Component], moving: LoadState) -> list[Expr]:
    """Return the power of a load's components per unit rate of each coordinate."""
    totals: list[Expr] = [0.0] * len(moving.tau)
    on_links: dict[tuple[str, str, Vector | None], Exprs] = {}
    for part in parts:
        law = part.magnitude
        magnitude = (
            moving.table(law.name)
            if isinstance(law, TorqueTable)
            else expression_value(expression_of(law), moving)
        )
        if part.pair:
            variable = moving.mechanism.angles[part.pair]
            worked = (magnitude * tau[variable] for tau in moving.tau)
            totals = [*map(add, totals, worked)]
        for moment in part.moments:
            key = moment.link, moment.axes, moment.arm
            along = vector([magnitude * component for component in moment.direction])
            on_links[key] = on_links[key] + along if key in on_links else along
    for (link, axes, arm), along in on_links.items():
        number = moving.mechanism.link_number[link]
        if number and (arm is None or any(arm)):
            turning = _moment(moving.placed[number], axes, arm, along)
            totals = [*map(add, totals, (dot(w[number], turning) for w in moving.w))]
    return totals


def steep_arguments(load: Load, moving: LoadState) -> list[Expr]:
    """Return what the load's `Expression.steep_and_smooth` are; kinks have switches."""
    return [
        expression_value(argument, moving)
        for part in load.components(moving.mechanism)
        if isinstance(part.magnitude, Expression)
        for argument in part.magnitude.steep_and_smooth
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
    return placed.basis @ (constants(placed.within) @ moment)


def expression_value(law: Expression, moving: LoadState) -> Expr:
    """Return an expression's value; sines and the like are of angles less whole turns."""
    return convert_to_graph(law, {x: moving.named(x) for x in law.names}, moving.switch)
