"""Which poles a set of wanted directions and coefficients needs."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np

from spherekit.arrays import Floats
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.pole_plan import Plan, Pole, pole_of
from spherekit.planning.pole_planner import plan, prune_plan


def cross(a: Floats, b: Floats) -> Floats:
    """Return a x b for arrays (..., 3, n)."""
    return np.cross(a, b, axis=-2)


Route = Literal["best", "first", "conditioned", "equations"]

ROUTES: dict[Route, str] = {
    "best": "velocity equations of the whole mechanism, in more digits where doubtful",
    "first": "first two great circles of the plan",
    "conditioned": "two best great circles",
    "equations": "velocity equations of the whole mechanism",
}
"""Those of the sequence give a status where it is ill-conditioned."""


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


class ByIdentity:
    """A mechanism as a cache key: the same object, not an equal one."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism

    def __hash__(self) -> int:
        return id(self.mechanism)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ByIdentity) and other.mechanism is self.mechanism


@lru_cache
def _whole_plan(of: ByIdentity, driven: str, by_rank: bool) -> Plan:
    return plan(of.mechanism, None, driven, by_rank)


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
    each w follows from the two poles of its body with those of the input.
    `links` are those whose angular velocity is wanted. `by_rank` is that of
    `spherekit.planning.pole_planner.plan`.
    """
    whole = _whole_plan(ByIdentity(mechanism), driven, by_rank)
    a, b = whole.ends[whole.input]
    circles = frozenset(pole_of(*pole) for pole in planes)
    wanted = [*(pole_of(*pole) for pole in poles), *sorted(circles)]
    turned = frozenset(links)
    to_ground = [pole_of(0, link) for link in sorted(turned - {0})]
    coefficients = [*(pole_of(*pole) for pole in rates), *to_ground]
    bodies = {0, a, b} | {whole.body[link] for pole in coefficients for link in pole}
    needed = {whole.pole(*pole) for pole in (*wanted, *coefficients, (a, b))}
    for body in bodies - {a, b}:
        needed |= {pole_of(a, body), pole_of(b, body)}
    pruned = prune_plan(whole, sorted(pole for pole in needed if pole is not None))
    every = tuple(dict.fromkeys([*wanted, *coefficients]))
    return Request(pruned, every, tuple(sorted(bodies)), derivatives, circles, turned)
