"""The part of a mechanism that analyses need, for runs that leave the rest out."""

from collections.abc import Sequence
from typing import Any

from spherekit.analysis.contract import AbstractAnalysis
from spherekit.analysis.declared import declared
from spherekit.analysis.needs import Needs
from spherekit.errors import AnalysisError, PluginError
from spherekit.files.write import mechanism_hash
from spherekit.model.mechanism import Mechanism
from spherekit.model.study import Study
from spherekit.planning.part import part_for


def links_of(mechanism: Mechanism, needs: Needs) -> frozenset[int]:
    """Return the numbers of the links whose placement something declared depends on."""
    poles = needs.directions | needs.rates | needs.planes | needs.turns
    pairs = needs.pair_values | needs.continued_values | needs.pair_rates
    names = needs.rotations | needs.link_rates
    names |= {link for pair in pairs for link in mechanism.pair(pair).links}
    return frozenset(
        {link for pole in poles for link in pole}
        | {mechanism.link_number[name] for name in names}
        | needs.links
    )


def needed_part(study: Study, analyses: Sequence[AbstractAnalysis]) -> Mechanism:
    """Return the mechanism of a study without what no analysis needs.

    Raises
    ------
    AnalysisError
        If an analysis does not declare what it reads, so that it may read anything, or
        the motion follows from loads on all links.
    PlanError
        If there is not one freedom for each input.
    """
    mechanism = study.mechanism
    if study.start is not None:
        raise AnalysisError(
            f"{mechanism.name}: a motion that follows from loads needs all links; run it "
            "without only_needed (--only-needed)"
        )
    wanted: frozenset[int] = frozenset()
    for analysis in analyses:
        try:
            needs = declared(analysis, mechanism)
        except PluginError:
            continue  # the run says so
        links = links_of(mechanism, needs)
        if not (needs.links if needs.tracer else links):
            raise AnalysisError(
                f"{analysis.name}: looks at the whole mechanism, so no part of it can be "
                "left out; run it without only_needed (--only-needed)"
            )
        wanted |= links
    return part_for(mechanism, wanted)


def left_out(whole: Mechanism, part: Mechanism) -> dict[str, Any]:
    """Return what a part lacks, with the fingerprint of the whole, ready for JSON."""
    names = {pair.name for pair in part.pairs}
    return {
        "mechanism_hash": mechanism_hash(whole),
        "left_out_links": [link for link in whole.links if link not in part.links],
        "left_out_pairs": [p.name for p in whole.pairs if p.name not in names],
    }
