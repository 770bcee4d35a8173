"""The part of a mechanism on which the relative positions of some links depend.

Groups are solved in order, and a group asks for earlier ones only where two of its pairs
sit on a body that they made. Going back from the links wanted gives the groups that are
needed; the pairs of all others can be left out without a change of what is left.
"""

from collections.abc import Iterable
from dataclasses import replace

from spherekit.errors import CountError
from spherekit.mechanism.elements import PoseGeometry, SizeGeometry
from spherekit.mechanism.load import Load
from spherekit.mechanism.load_dependence import used_links, used_pairs
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import Assembly, Group, plan_assembly
from spherekit.planning.mobility import merge_locked_links


def moving_pairs(
    mechanism: Mechanism, assembly: Assembly, links: Iterable[int]
) -> tuple[int, ...]:
    """Return the pairs by which these links move relative to each other, in order.

    Those of the groups that place them, and the inputs that these groups and the links
    themselves are driven by: what is left out moves none of them.
    """
    wanted, inputs = frozenset(links), list(assembly.inputs)
    groups = placing_groups(mechanism, assembly, wanted)
    for pair in assembly.inputs:
        rest = [other for other in inputs if other != pair]
        if _are_one_body(mechanism, rest, groups, wanted):
            inputs = rest
    return tuple(sorted([*inputs, *(pair for group in groups for pair in group.pairs)]))


def placing_groups(
    mechanism: Mechanism, assembly: Assembly, links: frozenset[int]
) -> list[Group]:
    """Return the groups that place links relative to each other."""
    groups = list(assembly.groups)
    for group in reversed(assembly.groups):
        rest = [other for other in groups if other is not group]
        if _are_one_body(mechanism, assembly.inputs, rest, links):
            groups = rest
    return groups


def _are_one_body(
    mechanism: Mechanism,
    inputs: Iterable[int],
    groups: Iterable[Group],
    links: frozenset[int],
) -> bool:
    """Return whether locked inputs and groups, solved in order, alone join links."""
    body = list(merge_locked_links(mechanism, inputs))
    for group in groups:
        ends = {link for pair in group.pairs for link in mechanism.ends[pair]}
        parts = [{body[link] for link in ends.intersection(x)} for x in group.bodies]
        if any(len(part) > 1 for part in parts):
            return False
        one = set().union(*parts)
        body = [min(one) if owner in one else owner for owner in body]
    return len({body[link] for link in links}) <= 1


def part_for(mechanism: Mechanism, links: Iterable[int]) -> Mechanism:
    """Return the mechanism without the pairs and links that the given links do not need.

    Names, frames of links, zeros of variables and ranges of inputs stay as they are;
    numbers of links and pairs change. Masses, loads, joint limits and outputs stay where
    all that they refer to stays. The same object where nothing can be left out, as where
    constraints are redundant and all pairs are solved together.

    Raises
    ------
    PlanError
        See `spherekit.planning.assembly_plan.plan_assembly`.
    """
    try:
        assembly = plan_assembly(mechanism)
    except CountError:
        return mechanism
    driven = {link for pair in assembly.inputs for link in mechanism.ends[pair]}
    groups = placing_groups(mechanism, assembly, frozenset({0, *driven, *links}))
    numbers = {*assembly.inputs}.union(*(group.pairs for group in groups))
    if len(numbers) == len(mechanism.pairs):
        return mechanism
    return of_pairs(mechanism, numbers)


def of_pairs(mechanism: Mechanism, numbers: Iterable[int]) -> Mechanism:
    """Return the mechanism of some of its pairs, by number, as `part_for` does."""
    pairs = tuple(mechanism.pairs[number] for number in sorted(numbers))
    on = {mechanism.links[0]} | {link for pair in pairs for link in pair.links}
    names = {pair.name for pair in pairs}

    def stays(load: Load) -> bool:
        alone = replace(mechanism, loads=(load,))
        return used_links(alone) <= on and used_pairs(alone) <= names

    return replace(
        mechanism,
        links=tuple(link for link in mechanism.links if link in on),
        pairs=pairs,
        geometry=_geometry(mechanism.geometry, on, names),
        outputs=tuple(o for o in mechanism.outputs if {o.link, o.relative_to} <= on),
        masses=tuple(mass for mass in mechanism.masses if mass.link in on),
        loads=tuple(load for load in mechanism.loads if stays(load)),
        joint_limits=tuple(stop for stop in mechanism.joint_limits if stop.pair in names),
        modes={
            mode: values
            for mode, values in mechanism.modes.items()
            if values.keys() <= names
        },
    )


def _geometry(
    given: SizeGeometry | PoseGeometry, links: set[str], pairs: set[str]
) -> SizeGeometry | PoseGeometry:
    if isinstance(given, PoseGeometry):
        return PoseGeometry(
            {name: axis for name, axis in given.axes.items() if name in pairs},
            {name: value for name, value in given.values.items() if name in pairs},
        )
    sizes = {
        link: replace(x, unpaired=tuple(axis for axis in x.axes if axis not in pairs))
        for link, x in given.links.items()
        if link in links
    }
    return SizeGeometry(sizes, {x: given.zeros[x] for x in given.zeros if x in pairs})
