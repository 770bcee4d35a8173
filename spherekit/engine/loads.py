"""Loads as expressions of the generalised force they exert on the motion.

A load is anything that can give its virtual work: the generalised force for the
homogeneous parameter p, Q = sum of torque times dtheta/dp, or of moment . dw/dp. Where a
load is not smooth it asks for a switch, a factor +1 or -1 that the integration changes
exactly where a condition passes through zero.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import final

from spherekit.engine.compiler import Expr, choose, function, power
from spherekit.engine.kinematics import Flow
from spherekit.errors import EngineError
from spherekit.model.dynamics import Load, PairTorque
from spherekit.model.expression import Call, Name, Node, Number, load_names, parse
from spherekit.model.mechanism import Mechanism

FULL_TURN = 6.283185307179586


@final
@dataclass(frozen=True)
class Moving:
    """A mechanism in motion, as loads see it.

    `flow` gives directions, placements and angular velocities per unit of p, `speed` is
    dp/dt, `time` the time. `switch(condition)` is +1 where an expression is positive and
    -1 where it is negative. `variables` are reduced by whole turns, the k-th by
    `turns[k]` of them.
    """

    flow: Flow
    variables: Sequence[Expr]
    turns: Sequence[Expr]
    speed: Expr
    time: Expr
    switch: Callable[[Expr], Expr]

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism that moves."""
        return self.flow.structure.mechanism

    def variable(self, pair: str) -> int:
        """Return the number of an R pair's variable."""
        mechanism = self.mechanism
        if mechanism.pair(pair).type != "R":
            raise EngineError(
                f"{mechanism.name}: pair {pair} is a contact and has no angle; use R pairs"
            )
        (number,) = mechanism.variables_of(mechanism.pair_number[pair])
        return number

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
        return self.flow.tau[self.variable(pair)]

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


def sign_of(condition: Expr) -> Expr:
    """Return the sign of a condition where it stands for itself: 1, -1, 0 at zero."""
    return choose(condition, 1.0, choose(-1.0 * condition, -1.0, 0.0))


@final
@dataclass(frozen=True)
class AppliedLoad:
    """A load by name: `force(moving)` is its generalised force per unit of p.

    `content` says what the load is, for the cache of compiled kernels: loads whose
    expressions differ must differ in it.
    """

    name: str
    force: Callable[[Moving], Expr]
    content: str


def pair_torque(mechanism: Mechanism, name: str, pair: str, torque: str) -> AppliedLoad:
    """Return a torque about a pair's axis, given as an expression.

    Parameters
    ----------
    mechanism
        The mechanism it acts in.
    name, pair
        The load's name, and the pair on whose second link it acts.
    torque
        N m, in ``theta_PAIR``, ``dtheta_PAIR`` and ``t``; see `spherekit.model.expression`.

    Raises
    ------
    ModelError
        If the expression is not in the grammar, or the pair is unknown.
    """
    parsed = parse(torque, load_names(mechanism.pair_number))
    mechanism.pair(pair)

    def force(moving: Moving) -> Expr:
        return convert(parsed.root, moving) * moving.coefficient(pair)

    return AppliedLoad(name, force, f"torque {pair} {parsed.text}")


def declared_loads(mechanism: Mechanism) -> tuple[AppliedLoad, ...]:
    """Return the loads that a mechanism's file declares."""
    return tuple(_declared(mechanism, load) for load in mechanism.loads)


def _declared(mechanism: Mechanism, load: Load) -> AppliedLoad:
    if not isinstance(load, PairTorque):
        raise EngineError(
            f"{mechanism.name}: loads.{load.name}: the compiled engine takes torques at "
            f"pairs, not a {type(load).__name__}; simulate with NumPy"
        )
    return pair_torque(mechanism, load.name, load.pair, load.torque)


def convert(node: Node, moving: Moving) -> Expr:
    """Return the tree of a load's expression as an expression to be compiled."""
    return _convert(node, moving, moving.angle)


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
