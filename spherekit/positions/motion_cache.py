"""Position analyses of mechanisms, computed once and reused, and the mobility by rank.

Counting links and pairs gives too few degrees of freedom if constraints are redundant, as
in a mechanism with equal links side by side. The rank of the velocity equations then gives
the number. It requires that configurations are computed first.
"""

from dataclasses import replace

from spherekit.errors import CountError
from spherekit.files.study import Crossings
from spherekit.mechanism.cache import MechanismCache
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import Assembly, driven_at, plan_assembly
from spherekit.positions.position_analysis import PositionAnalysis

MAX_KEPT_GEOMETRIES = 8
"""Number of geometries whose assembly modes are kept. Larger: more memory; smaller:
simulations and exports of the same few mechanisms in turn search their modes again.
"""

_POSITION_ANALYSES = MechanismCache(max_results=MAX_KEPT_GEOMETRIES)


def position_analysis_of(
    mechanism: Mechanism, crossings: Crossings = "end"
) -> PositionAnalysis:
    """Return the position analysis of a mechanism over the ranges of its inputs.

    The analysis finds the assembly modes (ways to assemble the mechanism), which takes
    long. The results for the last few geometries are therefore stored and used again.

    Parameters
    ----------
    mechanism
        The mechanism. Its masses, loads and joint limits are ignored.
    crossings
        What a mode does where curves of configurations cross: "end", or "pass" to follow
        the smooth curve.
    """
    geometry = kinematics_only(mechanism)
    return _POSITION_ANALYSES.get(
        geometry,
        f"assembly modes, crossings {crossings}",
        lambda: PositionAnalysis(geometry, crossings=crossings),
    )


def kinematics_only(mechanism: Mechanism) -> Mechanism:
    """Return the mechanism without masses, loads and joint limits.

    Mechanisms that differ only in masses, loads and joint limits have the same
    configurations, and can share one position analysis.
    """
    return replace(mechanism, masses=(), loads=(), joint_limits=())


def assembly_by_count_or_rank(mechanism: Mechanism) -> Assembly:
    """Return the groups of links of a mechanism, in the order in which they are placed.

    A group is a set of links that are placed together by closing their loops. Counting
    links and pairs gives too few degrees of freedom if constraints are redundant. In this
    case closed configurations are searched, and the rank of their velocity equations gives
    the degrees of freedom.

    Raises
    ------
    PlanError
        If the degrees of freedom, by counting or else by rank, are not the number of
        inputs.
    SolveError
        If the mechanism cannot be assembled anywhere.
    """
    try:
        return plan_assembly(mechanism)
    except CountError:  # counting gives another number of degrees of freedom than inputs
        # `driven_at` returns the same mechanism, or raises an error if one of its inputs
        # cannot be driven.
        checked_mechanism = driven_at(mechanism)
        # The position analysis searches configurations, and counts by rank.
        position_analysis = position_analysis_of(checked_mechanism)
        return position_analysis.assembly


def is_mobile_by_rank_only(mechanism: Mechanism) -> bool:
    """Return whether a mechanism moves although a count of links and pairs denies it.

    The count is too small if constraints are redundant. The rank of the velocity equations
    then shows that the mechanism moves.

    Raises
    ------
    PlanError
        If the degrees of freedom, by counting or else by rank, are not the number of
        inputs.
    SolveError
        If the mechanism cannot be assembled anywhere.
    """
    try:
        plan_assembly(mechanism)
    except CountError:  # counting gives another number of degrees of freedom than inputs
        # `driven_at` returns the same mechanism, or raises an error if one of its inputs
        # cannot be driven.
        checked_mechanism = driven_at(mechanism)
        # `by_rank` says whether the degrees of freedom follow from the rank.
        return position_analysis_of(checked_mechanism).by_rank
    return False
