"""Requests: which poles have to be computed for given directions and coefficients."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.pole_plan import Plan, Pole, pole_of
from spherekit.planning.pole_planner import plan, prune_plan

Route = Literal["best", "first", "conditioned", "equations"]
"""How poles and coefficients are computed. `ROUTES` describes these routes."""

ROUTES: dict[Route, str] = {
    "best": "velocity equations of the whole mechanism, in more digits where doubtful",
    "first": "first two great circles of the plan",
    "conditioned": "two best great circles",
    "equations": "same as best, but all rows count as solved by the equations",
}
"""The routes, with their description in tables. "first" and "conditioned" follow the plan
of the poles. They return a status for poles that are ill-conditioned on this route."""


@dataclass(frozen=True)
class Request:
    """The poles to compute while one input moves, and the plan that gives them.

    A pole is the axis about which two links turn relative to each other. Links that do not
    move relative to each other, while the other inputs are locked, are one body. The plan
    has bodies in place of links, and says from which other poles each pole follows.

    Attributes
    ----------
    plan
        The plan, reduced to the necessary steps.
    poles
        The poles to compute, as pairs of link indices.
    bodies
        Bodies whose angular velocities are needed. The ground and the two bodies of the
        input are among them. On the routes "first" and "conditioned" (ways to compute
        poles, see `ROUTES`), these velocities follow from the plan.
    derivatives
        Whether derivatives with respect to the moving input are requested, too.
    planes
        Poles for which two great circles through the pole are requested as well, for
        drawings.
    links
        Links with requested angular velocities.
    """

    plan: Plan
    poles: tuple[Pole, ...]
    bodies: tuple[int, ...]
    derivatives: bool
    planes: frozenset[Pole] = frozenset()
    links: frozenset[int] = frozenset()


class MechanismKey:
    """A mechanism as the key of a cache, compared by identity (the same object in memory).

    Identities are compared faster than contents. Equal mechanisms in two objects have
    different keys.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        """Make the key of this object."""
        self.mechanism = mechanism

    def __hash__(self) -> int:
        return id(self.mechanism)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, MechanismKey) and other.mechanism is self.mechanism


@lru_cache
def _plan_all_poles(mechanism_key: MechanismKey, input_pair: str, by_rank: bool) -> Plan:
    """Return the plan of all poles. The function `request` describes the arguments."""
    return plan(mechanism_key.mechanism, None, input_pair, by_rank)


def request(
    mechanism: Mechanism,
    input_pair: str,
    poles: Iterable[Pole],
    rates: Iterable[Pole] = (),
    derivatives: bool = True,
    planes: Iterable[Pole] = (),
    by_rank: bool = False,
    links: Iterable[int] = (),
) -> Request:
    """Return the request for some poles, velocity coefficients and angular velocities.

    A pole is the axis about which one link rotates relative to another. Its velocity
    coefficient is the relative angular velocity along the pole, per unit rate of the input.

    Parameters
    ----------
    mechanism
        The mechanism.
    input_pair
        Name of the input that moves. The other inputs are locked. Links that cannot move
        relative to each other form one body without poles.
    poles
        Pairs of link indices for which pole directions are requested.
    rates
        Pairs of link indices for which velocity coefficients are requested.
    derivatives
        Whether the derivatives of the coefficients are requested.
    planes
        Pairs of link indices for which two great circles through the pole are
        requested.
    by_rank
        As in `spherekit.planning.pole_planner.plan`.
    links
        Indices of the links for which angular velocities are requested.
    """
    plan_of_all_poles = _plan_all_poles(MechanismKey(mechanism), input_pair, by_rank)
    body_of_link = plan_of_all_poles.body
    input_first, input_second = plan_of_all_poles.ends[plan_of_all_poles.input]
    pole_planes = frozenset(pole_of(*pole) for pole in planes)
    direction_poles = [*(pole_of(*pole) for pole in poles), *sorted(pole_planes)]
    requested_links = frozenset(links)
    link_poles = [pole_of(0, link) for link in sorted(requested_links - {0})]
    coefficient_poles = [*(pole_of(*pole) for pole in rates), *link_poles]

    bodies = {0, input_first, input_second}
    for pole in coefficient_poles:
        bodies |= {body_of_link[link] for link in pole}
    needed_poles = {
        plan_of_all_poles.pole(*pole)
        for pole in (*direction_poles, *coefficient_poles, (input_first, input_second))
    }
    # A coefficient is the component of w_j - w_i along the pole. The angular velocity of
    # each body follows from its poles with the two bodies of the input.
    for body in bodies - {input_first, input_second}:
        needed_poles |= {pole_of(input_first, body), pole_of(input_second, body)}
    body_poles = sorted(pole for pole in needed_poles if pole is not None)
    return Request(
        plan=prune_plan(plan_of_all_poles, body_poles),
        poles=tuple(dict.fromkeys([*direction_poles, *coefficient_poles])),
        bodies=tuple(sorted(bodies)),
        derivatives=derivatives,
        planes=pole_planes,
        links=requested_links,
    )
