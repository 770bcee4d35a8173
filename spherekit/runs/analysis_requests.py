"""What several analyses need together, and the requests that are planned for it."""

from functools import reduce

from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import driven_pairs
from spherekit.runs.contract import Analyses
from spherekit.runs.declaration_checks import check_needs
from spherekit.runs.needs import Needs
from spherekit.velocities.pole_request import Request, request


def unite_needs(mechanism: Mechanism, analyses: Analyses) -> Needs:
    """Return what several analyses need together; for errors see `check_needs`."""
    needs = [check_needs(analysis, mechanism) for analysis in analyses]
    return reduce(Needs.union, needs, Needs())


def plan_requests(
    mechanism: Mechanism, needs: Needs, by_rank: bool = False
) -> tuple[Request, ...]:
    """Return the poles and links to evaluate, as one request for each input.

    The requests of a run are planned before its samples are computed. A request is about
    the motion in which one input moves and all others are locked. A pole is the axis about
    which one link rotates relative to another. `Needs` has four sets of poles, one for each
    quantity that analyses read:

    - `directions`: their directions,
    - `rates`: their velocity coefficients (angular velocity per unit rate of the input),
    - `turns`: the derivatives of their directions with respect to the input,
    - `planes`: two great circles that intersect in the pole.

    Parameters
    ----------
    mechanism
        The mechanism with its inputs.
    needs
        The quantities that analyses have declared to read.
    by_rank
        Whether mobility is decided by the rank of the closure equations instead of by
        counting links and pairs; see `spherekit.planning.pole_planner.plan`.
    """
    # The rate of a pair follows from the angular velocities of its two links.
    pair_links = [mechanism.pair(name).links for name in needs.pair_rates]
    links = needs.link_rates.union(*pair_links)
    link_numbers = sorted(mechanism.link_number[link] for link in links)
    # A pole has the direction of a relative angular velocity. The derivative of this
    # direction needs the angular velocity, so poles of `turns` are also rate poles.
    rate_poles = sorted(needs.rates | needs.turns)
    return tuple(
        request(
            mechanism,
            input_pair=mechanism.pairs[driven].name,
            poles=sorted(needs.directions),
            rates=rate_poles,
            # Whether all rates are differentiated with respect to the input.
            derivatives=needs.derivatives,
            planes=sorted(needs.planes),
            by_rank=by_rank,
            links=link_numbers,
        )
        for driven in driven_pairs(mechanism)  # index of the pair of each input
    )
