"""Which poles a set of wanted directions and coefficients needs."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, final

from spherekit.model.mechanism import Mechanism
from spherekit.planning.plan import (
    plan,
    prune,
)
from spherekit.planning.poles import (
    BlockPoles,
    CoaxialPole,
    Plan,
    Pole,
    PrimaryPole,
    pole_of,
)

Route = Literal["best", "first", "conditioned", "equations"]

ROUTES: dict[Route, str] = {
    "best": "two best great circles, velocity equations where these are doubtful",
    "first": "first two great circles of the plan",
    "conditioned": "two best great circles",
    "equations": "velocity equations of the whole mechanism",
}
"""Only ``best`` changes over to another source; the others give a status instead."""


@final
@dataclass(frozen=True)
class Request:
    """The plan behind wanted poles and coefficients, and the links whose rates it gives.

    `poles` are the wanted ones, by links; `bodies` are the bodies of the plan whose
    angular velocity is found, the ground and the two of the input among them. `planes`
    are the poles whose great circles are wanted as well, `links` those whose angular
    velocities are.
    """

    plan: Plan
    poles: tuple[Pole, ...]
    bodies: tuple[int, ...]
    derivatives: bool
    planes: frozenset[Pole] = frozenset()
    links: frozenset[int] = frozenset()


@lru_cache(maxsize=64)
def _whole_plan(mechanism_key: "_ByIdentity", driven: str, by_rank: bool) -> Plan:
    return plan(mechanism_key.mechanism, None, driven, by_rank)


class _ByIdentity:
    """A mechanism as a cache key: the same object, not an equal one."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism

    def __hash__(self) -> int:
        return id(self.mechanism)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _ByIdentity) and other.mechanism is self.mechanism


def request(
    mechanism: Mechanism,
    driven: str,
    poles: Iterable[Pole],
    rates: Iterable[Pole] = (),
    derivatives: bool = True,
    planes: Iterable[Pole] = (),
    by_rank: bool = False,
    links: Iterable[int] = (),
) -> Request:
    """Return what must be planned for these poles and velocity coefficients.

    `driven` is the input that moves; others stand still, and poles of links that they
    join are left out. The coefficient of links (i, j) is the component of w_j - w_i;
    each w follows from the two poles of its body with those of the input. Derivatives
    in ground axes also need the rate of one body at each pair whose axis the plan uses.
    `links` are those whose angular velocity is wanted. `by_rank` is that of
    `spherekit.planning.poles.plan`.
    """
    whole = _whole_plan(_ByIdentity(mechanism), driven, by_rank)
    a, b = whole.ends[whole.input]
    circles = frozenset(pole_of(*pole) for pole in planes)
    wanted = tuple(dict.fromkeys([*(pole_of(*pole) for pole in poles), *sorted(circles)]))
    turned = frozenset(links)
    to_ground = [pole_of(0, link) for link in sorted(turned - {0})]
    coefficients = list(dict.fromkeys([*(pole_of(*pole) for pole in rates), *to_ground]))
    bodies = {a, b} | {whole.body[link] for pole in coefficients for link in pole}
    if derivatives:
        bodies.add(0)
    while True:
        needed = {whole.pole(*pole) for pole in (*wanted, *coefficients, (a, b))}
        for body in bodies - {a, b}:
            needed |= {pole_of(a, body), pole_of(b, body)}
        pruned = prune(whole, sorted(pole for pole in needed if pole is not None))
        more = _moving_bodies(pruned) - bodies if derivatives else set()
        if not more:
            everything = tuple(dict.fromkeys((*wanted, *coefficients)))
            body_numbers = tuple(sorted(bodies))
            return Request(pruned, everything, body_numbers, derivatives, circles, turned)
        bodies |= more


def _moving_bodies(planned: Plan) -> set[int]:
    """The bodies whose rates tell how the axes used by a plan move.

    The axis of an R pair is fixed in its first link; a contact moves along the profiles
    of both.
    """
    mechanism = planned.mechanism
    used: set[int] = set()
    for step in planned.steps:
        if isinstance(step, PrimaryPole | CoaxialPole):
            used.add(step.pair)
        elif isinstance(step, BlockPoles):
            used |= set(step.pairs)
        else:
            used |= set(step.contacts)
    bodies: set[int] = set()
    for pair in used:
        carriers = mechanism.pairs[pair].kind.carriers
        bodies |= set(planned.ends[pair][:carriers])
    return bodies
