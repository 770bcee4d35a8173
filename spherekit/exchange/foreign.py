"""What another program's model holds, in its world axes, in the pose that is imported."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, final

from spherekit.sphere.rotation import Floats


@final
@dataclass(frozen=True)
class ForeignBody:
    """A rigid body: its parent's number, and its inertia, None where it has no mass.

    `centre` (3,) m and `tensor` (3, 3) kg m2 about it. `weightless` says that no gravity
    acts on it.
    """

    name: str
    parent: int
    mass: float | None
    centre: Floats
    tensor: Floats
    weightless: bool = False


@final
@dataclass(frozen=True)
class ForeignHinge:
    """A hinge that turns a body against its parent, after the hinges of it before.

    `point` (3,) lies on the axis; the body turns about the unit vector `axis` (3,).
    `value` (rad) is its variable in this pose.
    """

    name: str
    body: int
    point: Floats
    axis: Floats
    value: float
    limits: tuple[float, float] | None = None
    stiffness: float = 0.0
    rest: float = 0.0
    damping: float = 0.0
    dry: float = 0.0
    locked: bool = False


@final
@dataclass(frozen=True)
class ForeignHold:
    """What holds two bodies to each other: at a point, or rigidly without one."""

    name: str
    first: int
    second: int
    point: Floats | None = None


@final
@dataclass(frozen=True)
class ForeignCoupling:
    """Hinges whose rates, times their factors, add up to zero."""

    name: str
    factors: Mapping[str, float]


@final
@dataclass(frozen=True)
class ForeignLoad:
    """A load that an actuator without control is.

    At a hinge it has ``vector`` as constant, factor of the variable and factor of the
    rate; on a body it is a constant force at a point (3,), or a moment, with components
    along the world's or the body's axes.
    """

    name: str
    kind: Literal["torque", "force", "moment"]
    vector: tuple[float, float, float]
    hinge: str = ""
    body: int = 0
    point: Floats | None = None
    turns: bool = False


@final
@dataclass(frozen=True)
class ForeignModel:
    """A model as rigid bodies on hinges; body 0 is the world.

    `driven` are the actuated hinges with the ends of their range where the file has some;
    `values` the variables of holds where it says so. `notes` say what is not here.
    """

    name: str
    source: str
    bodies: Sequence[ForeignBody]
    hinges: Sequence[ForeignHinge]
    holds: Sequence[ForeignHold]
    driven: Mapping[str, tuple[float, float] | None]
    couplings: Sequence[ForeignCoupling] = ()
    loads: Sequence[ForeignLoad] = ()
    gravity: Floats | None = None
    values: Mapping[str, float] = field(default_factory=dict)
    made_up: bool = False
    notes: tuple[str, ...] = ()
