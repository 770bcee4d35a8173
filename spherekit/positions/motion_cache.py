"""The assembly modes of mechanisms, found once, and what they say of the mobility.

Counting on the graph leaves too few degrees of freedom where constraints repeat each
other, as equal links side by side do. The rank of the velocity equations at
configurations then decides, and the configurations have to be found first.
"""

from dataclasses import replace

from spherekit.errors import CountError
from spherekit.files.study import Crossings
from spherekit.mechanism.cache import MechanismCache
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import Assembly, driven_at, plan_assembly
from spherekit.positions.position_analysis import PositionAnalysis

MAX_KEPT_GEOMETRIES = 8
"""Geometries whose assembly modes are kept. Larger: more memory; smaller: simulations and
exports of the same few mechanisms in turn search their modes again."""

_POSITION_ANALYSES = MechanismCache(max_results=MAX_KEPT_GEOMETRIES)


def traced(mechanism: Mechanism, crossings: Crossings = "end") -> PositionAnalysis:
    """Return the assembly modes of a mechanism, found once for the last few geometries.

    `crossings` says what a mode does where curves cross, as in `PositionAnalysis`.
    """
    made = bare(mechanism)
    return _POSITION_ANALYSES.get(
        made,
        f"assembly modes, crossings {crossings}",
        lambda: PositionAnalysis(made, crossings=crossings),
    )


def bare(mechanism: Mechanism) -> Mechanism:
    """Return a mechanism without what its configurations do not depend on."""
    return replace(mechanism, masses=(), loads=(), joint_limits=())


def assembly_by_count_or_rank(mechanism: Mechanism) -> Assembly:
    """Return the groups of a mechanism whose inputs are locked.

    Where constraints repeat each other, so that counting on the graph leaves too few
    degrees of freedom, configurations are searched and their rank decides.

    Raises
    ------
    PlanError
        If there is not one degree of freedom for each input, by counting and by rank.
    SolveError
        If the arcs close nowhere.
    """
    try:
        return plan_assembly(mechanism)
    except CountError:
        return traced(driven_at(mechanism)).assembly


def is_mobile_by_rank_only(mechanism: Mechanism) -> bool:
    """Return whether the rank leaves the degrees of freedom that counting does not.

    The errors are those of `assembly_by_count_or_rank`.
    """
    try:
        plan_assembly(mechanism)
    except CountError:
        return traced(driven_at(mechanism)).by_rank
    return False
