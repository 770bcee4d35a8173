"""What several analyses need together, and the requests that are planned for it."""

from functools import reduce

from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import driven_pairs
from spherekit.runs.contract import Analyses
from spherekit.runs.declaration_checks import declared
from spherekit.runs.needs import Needs
from spherekit.velocities.pole_request import Request, request


def needs_of(mechanism: Mechanism, analyses: Analyses) -> Needs:
    """Return what several analyses need together; see `declared` for what it raises."""
    return reduce(Needs.union, (declared(x, mechanism) for x in analyses), Needs())


def requests_for(
    mechanism: Mechanism, needs: Needs, by_rank: bool = False
) -> tuple[Request, ...]:
    """Return the planned request behind some needs for each input, moved alone.

    `by_rank` is that of `spherekit.planning.pole_planner.plan`.
    """
    ends = (mechanism.pair(name).links for name in needs.pair_rates)
    links = needs.link_rates.union(*ends)
    numbers = sorted(mechanism.link_number[link] for link in links)
    return tuple(
        request(
            mechanism,
            mechanism.pairs[driven].name,
            sorted(needs.directions),
            sorted(needs.rates | needs.turns),
            needs.derivatives,
            sorted(needs.planes),
            by_rank,
            numbers,
        )
        for driven in driven_pairs(mechanism)
    )
