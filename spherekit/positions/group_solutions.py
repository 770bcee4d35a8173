"""All closed configurations of one irreducible group at one sample, and their method.

Elimination is used if it applies and its checks succeed. Otherwise random starts are added.
The result then states how likely they have missed a configuration.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Floats
from spherekit.geometry.vectors import max_abs
from spherekit.numerics.angles import wrap
from spherekit.planning.assembly_plan import Group
from spherekit.positions.elimination import solve_by_elimination
from spherekit.positions.elimination_order import find_elimination_orders, has_elimination
from spherekit.positions.loop_closure import Closure
from spherekit.positions.random_search import (
    MAX_MODES,
    POLISHING_STEPS,
    DistinctConfigurations,
    search_group,
)
from spherekit.tolerances import CLOSURE_TOLERANCE

SORT_DECIMALS = 6
"""Decimals of the angles (rad) by which modes are sorted.

With more decimals rounding errors could change the order. With fewer, modes that nearly
coincide would be sorted by chance.
"""

MAX_CORRECTION_RAD = 1e-2
"""Largest change of an angle (rad) between a real root and the closed configuration.

A larger change counts as a lost root, and a search follows. With a smaller value
ill-conditioned roots are searched in vain; with a larger one Newton's method may have
converged to the configuration of another root without notice.
"""


class SolutionMethod(NamedTuple):
    """The method by which the modes of one group were found.

    A group is a set of bodies that are placed together by closing their loops. A mode is
    one way to assemble it.

    Attributes
    ----------
    description
        The method in words, for messages and summaries.
    doubt
        A number from 0 to 1 that is larger, the more likely a mode is missing:

        - 0 if no real mode can be missing at the inputs that were examined.
        - After a search from random starts, a share p of the starts. A mode to which more
          than this share leads was almost certainly found.
        - 1 if modes may have been left out because there are too many, or if nothing is
          known about a search.
    """

    description: str
    doubt: float = 0.0


CLOSED_FORM = SolutionMethod("closed form")
"""The method for dyads, and for trains of wheels, which have one mode."""

RANDOM_SEARCH = SolutionMethod("search", 1.0)
"""A search from random starts about which nothing more is known."""


def find_group_configurations(
    group: Group, closure: Closure, start_values: Floats | None = None
) -> tuple[list[Floats], SolutionMethod]:
    """Return the closed configurations of a group of links, and how they were found.

    A group is a set of bodies that are placed together by closing their loops, at one
    choice of the inputs (sample). All configurations are found if elimination applies and
    its checks succeed. If not, random starts are tried, and configurations may be missing.

    Parameters
    ----------
    group
        The group, with any kinds of pairs. The group is irreducible: no part of it can be
        closed by itself.
    closure
        The loop equations of this group, with a single sample.
    start_values
        (n, variables) starting values (rad) that a search tries before the random ones.

    Returns
    -------
    configurations
        Variables (variables,) in rad of each configuration. They are sorted by angle, in
        the same order each time.
    method
        How they were found, with a number that says how likely one is missing.
    """
    # `distinct` stores the different configurations that were found. `problem` says which
    # check of the elimination failed, and is empty if all checks succeeded.
    if not has_elimination(group):
        distinct = DistinctConfigurations(closure)
        description = RANDOM_SEARCH.description
    else:
        distinct, problem = find_distinct_by_elimination(group, closure)
        if not problem:
            # All elimination orders of a group have the same number of roots.
            first_order = find_elimination_orders(group)[0]
            root_count = first_order.root_count
            description = f"elimination: all {root_count} complex roots"
            # The doubt is 0 if no configuration can be missing, and at most 1.
            doubt = 0.0
            # More real configurations were computed than are stored, so some are missing.
            if distinct.is_truncated:
                description += f", of whose real ones {len(distinct.values)} are kept"
                doubt = 1.0
            configurations = sorted(distinct.values, key=mode_sort_key)
            return configurations, SolutionMethod(description, doubt)
        description = f"{RANDOM_SEARCH.description} ({problem})"
    # Without a sound elimination, a search adds to the configurations of the elimination,
    # if any.
    statistics = search_group(closure, distinct, start_values)
    description = f"{description}: {statistics.describe('modes')}"
    # The doubt is a share of all starts. A configuration to which a larger share of starts
    # leads was almost certainly found.
    doubt = statistics.missed_share
    # The search ends when `MAX_MODES` configurations are stored, even if none was left out.
    if distinct.is_truncated or len(distinct.values) >= MAX_MODES:
        description += f"; the first {len(distinct.values)} are kept, and there may be more"
        doubt = 1.0
    configurations = sorted(distinct.values, key=mode_sort_key)
    return configurations, SolutionMethod(description, doubt)


def find_distinct_by_elimination(
    group: Group, closure: Closure
) -> tuple[DistinctConfigurations, str]:
    """Find the different closed configurations of a group by elimination.

    A group is a set of links that are placed together by closing their loops. If a link has
    two pairs, the arc between their axes is known. This gives the equations of the group.
    Elimination computes all their complex solutions (roots). Newton's method then closes
    the loops, with starts at roots whose imaginary parts are small. A root whose imaginary
    part is only rounding is real, and must lead to a closed configuration.

    Parameters
    ----------
    group
        A group for which `has_elimination` is true.
    closure
        The loop equations of this group, with a single sample.

    Returns
    -------
    distinct
        The different closed configurations.
    problem
        Why a real configuration may be missing; empty if none can be missing.
    """
    distinct = DistinctConfigurations(closure)
    result = solve_by_elimination(group, closure)
    # The starts are the real parts of the roots.
    closed = closure.solve(result.angles, max_steps=POLISHING_STEPS)
    is_closed = closed.closure_residual < CLOSURE_TOLERANCE
    correction = max_abs(wrap(closed.values - result.angles), axis=1)
    # A real root belongs to a closed configuration next to it. If Newton's method does not
    # converge, the configuration of this root is missing. If it leads farther away, it may
    # have reached the configuration of another root.
    is_confirmed = is_closed & (correction < MAX_CORRECTION_RAD)
    problem = result.problem
    if np.any(result.is_real & ~is_confirmed):
        problem = problem or "a real root led to no closed configuration"
    # All closed configurations are stored, even those that are not next to their root.
    distinct.add(closed.values[is_closed])
    return distinct, problem


def mode_sort_key(mode: Floats) -> list[float]:
    """Return the key by which `sorted` orders modes (variables,) by their angles."""
    return sortable_angles(mode).tolist()


def sortable_angles(modes: Floats) -> Floats:
    """Return angles (..., variables) by which modes can be sorted in a reproducible order.

    The angles are rounded to `SORT_DECIMALS`, so that rounding errors do not change the
    order. Half a turn, which rounding errors turn into pi or -pi, is always pi.
    """
    angles = np.round(wrap(modes), SORT_DECIMALS)
    return np.where(angles <= np.round(-np.pi, SORT_DECIMALS), -angles, angles)


def least_complete(*methods: SolutionMethod | None) -> SolutionMethod | None:
    """Return the solution method that is most likely to have missed a mode.

    This is the method with the largest `doubt`. Arguments that are None are ignored. The
    result is None if all of them are None.
    """
    used_methods = [method for method in methods if method is not None]
    return max(used_methods, key=lambda method: method.doubt, default=None)


def all_complete(methods: Iterable[SolutionMethod | None]) -> bool:
    """Return whether no method can miss a real mode; None stands for no method."""
    return all(method is None or method.doubt == 0.0 for method in methods)
