"""The part of a mechanism that analyses need, for runs that leave the rest out."""

from collections.abc import Sequence

from spherekit.analysis.contract import AbstractAnalysis, Needs
from spherekit.errors import AnalysisError
from spherekit.model.mechanism import Mechanism
from spherekit.planning.part import part_for


def links_of(mechanism: Mechanism, needs: Needs) -> frozenset[int]:
    """Return the numbers of the links whose placement something declared depends on."""
    poles = needs.directions | needs.rates | needs.planes
    pairs = needs.pair_values | needs.pair_rates
    names = needs.rotations | needs.link_rates
    names |= {link for pair in pairs for link in mechanism.pair(pair).links}
    return frozenset(
        {link for pole in poles for link in pole}
        | {mechanism.link_number[name] for name in names}
    )


def needed_part(
    mechanism: Mechanism,
    analyses: Sequence[AbstractAnalysis],
    inputs: Sequence[str] = (),
) -> Mechanism:
    """Return the mechanism without what no analysis needs, driven at `inputs` if given.

    Raises
    ------
    AnalysisError
        If an analysis does not declare what it reads, so that it may read anything.
    PlanError
        If there is not one freedom for each input.
    """
    if inputs:
        mechanism = mechanism.with_inputs(*inputs)
    wanted: frozenset[int] = frozenset()
    for analysis in analyses:
        needs = analysis.needs(mechanism)
        links = links_of(mechanism, needs)
        if needs.tracer or not links:
            raise AnalysisError(
                f"{analysis.name}: looks at the whole mechanism, so no part of it can be "
                "left out; run it without only_needed (--only-needed)"
            )
        wanted |= links
    return part_for(mechanism, wanted)
