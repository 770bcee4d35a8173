"""What several analyses need together, and the planned requests behind it."""

from collections.abc import Sequence

from spherekit.analysis.contract import AbstractAnalysis
from spherekit.analysis.declared import declared
from spherekit.analysis.needs import Needs
from spherekit.model.mechanism import Mechanism
from spherekit.planning.inputs import driven_pairs
from spherekit.rates.request import Request, request


def needs_of(mechanism: Mechanism, analyses: Sequence[AbstractAnalysis]) -> Needs:
    """Return what several analyses need together; see `declared` for what it raises."""
    together = Needs()
    for analysis in analyses:
        together = together.union(declared(analysis, mechanism))
    return together


def requests_for(
    mechanism: Mechanism, needs: Needs, by_rank: bool = False
) -> tuple[Request, ...]:
    """Return the planned request behind some needs for each input, moved alone.

    `by_rank` is that of `spherekit.planning.poles.plan`.
    """
    ends = {link for name in needs.pair_rates for link in mechanism.pair(name).links}
    numbers = {mechanism.link_number[link] for link in needs.link_rates | ends}
    return tuple(
        request(
            mechanism,
            mechanism.pairs[driven].name,
            sorted(needs.directions),
            sorted(needs.rates | needs.turns),
            needs.derivatives,
            sorted(needs.planes),
            by_rank,
            sorted(numbers),
        )
        for driven in driven_pairs(mechanism)
    )
