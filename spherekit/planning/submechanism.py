"""The part of a mechanism on which the relative positions of some links depend.

Groups are placed in solving order. A group needs an earlier group only if two of its pairs
are on a body that the earlier group has formed. Going back from the requested links
therefore gives the groups that are needed. All other pairs can be left out, and the
remaining positions do not change.
"""

from collections.abc import Iterable
from dataclasses import replace

from spherekit.errors import CountError
from spherekit.mechanism.elements import PoseGeometry, SizeGeometry
from spherekit.mechanism.load import Load
from spherekit.mechanism.load_dependence import (
    rubbing_contacts,
    used_links,
    used_pairs,
)
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import Assembly, Group, plan_assembly
from spherekit.planning.mobility import merge_locked_links


def moving_pairs(
    mechanism: Mechanism, assembly: Assembly, links: Iterable[int]
) -> tuple[int, ...]:
    """Return the pairs on which the relative positions of some links depend, rising.

    The singularities of an output are computed with these pairs only, without the others.

    With locked inputs, a mechanism is put together group after group. A group is a set of
    bodies that its pairs join into one rigid body. In the end all links are one rigid body.
    Some inputs and groups can be left out, and the given links still become parts of one
    rigid body. Then their relative positions do not depend on these inputs and groups. The
    result has the remaining inputs, and the pairs of the remaining groups.

    Parameters
    ----------
    mechanism
        The mechanism.
    assembly
        Its groups in the order in which they are placed.
    links
        Indices of the links.
    """
    requested_links = frozenset(links)
    needed_groups = placing_groups(mechanism, assembly, requested_links)
    # With these groups and all inputs locked, the links are one rigid body. Each input is
    # unlocked as a trial. If the links remain one rigid body, the input is not needed. It
    # then stays unlocked while the next inputs are tried.
    needed_inputs = list(assembly.inputs)
    for pair in assembly.inputs:
        remaining_inputs = [needed for needed in needed_inputs if needed != pair]
        if _are_one_body(
            mechanism, remaining_inputs, groups=needed_groups, links=requested_links
        ):
            needed_inputs = remaining_inputs
    pairs = needed_inputs.copy()
    for group in needed_groups:
        pairs += group.pairs
    return tuple(sorted(pairs))


def placing_groups(
    mechanism: Mechanism, assembly: Assembly, links: frozenset[int]
) -> list[Group]:
    """Return the groups that are needed to place some links relative to each other.

    The other groups have no influence on the relative positions of these links. A group is
    a set of bodies that become one rigid body when all its pairs are closed. The inputs of
    the mechanism are locked.

    Parameters
    ----------
    mechanism
        The mechanism.
    assembly
        Its groups in the order in which they are placed.
    links
        Indices of the links.

    Returns
    -------
    The needed groups in the same order.
    """
    needed_groups = list(assembly.groups)
    # A group can need earlier groups, never later ones. So later groups are tried first.
    for group in reversed(assembly.groups):
        remaining_groups = [needed for needed in needed_groups if needed is not group]
        # A group is left out if the links are one rigid body without it.
        if _are_one_body(mechanism, assembly.inputs, groups=remaining_groups, links=links):
            needed_groups = remaining_groups
    return needed_groups


def _are_one_body(
    mechanism: Mechanism,
    inputs: Iterable[int],
    groups: Iterable[Group],
    links: frozenset[int],
) -> bool:
    """Return whether some of the inputs and groups are enough to join some links rigidly.

    The caller leaves out an input or a group. If the links still are one rigid body, they
    do not need it.

    Parameters
    ----------
    mechanism
        The whole mechanism.
    inputs
        Indices of the driven pairs that are locked.
    groups
        The groups, in the order in which they are placed. A group is a set of bodies that
        its pairs join into one rigid body. Each of its bodies is a set of links that locked
        inputs and earlier groups have joined.
    links
        Indices of the links that have to end in one body.

    Returns
    -------
    Whether the links are in one body. False also if a group needs an input or a group that
    is left out.
    """
    # For each link the label of its rigid body. In the beginning only inputs join links.
    label_of_link = list(merge_locked_links(mechanism, inputs))
    for group in groups:
        # The links at which the pairs of the group end. Other links of its bodies have no
        # effect on the group.
        end_links: set[int] = set()
        for pair in group.pairs:
            end_links.update(mechanism.ends[pair])
        merged_labels: set[int] = set()
        for group_body in group.bodies:
            labels = {label_of_link[link] for link in end_links.intersection(group_body)}
            # The end links of one body must be rigid with each other. With several labels,
            # an input or group that joins them was left out.
            if len(labels) > 1:
                return False
            merged_labels |= labels
        new_label = min(merged_labels)
        label_of_link = [
            new_label if label in merged_labels else label for label in label_of_link
        ]
    return len({label_of_link[link] for link in links}) <= 1


def part_for(mechanism: Mechanism, links: Iterable[int]) -> Mechanism:
    """Return only the links and pairs that determine the motion of some links.

    A smaller mechanism is solved faster. Names, frames of links, zeros of variables and
    ranges of inputs stay as they are. Links and pairs get new indices. Masses, loads, joint
    limits, outputs and named assembly modes stay if all links and pairs to which they refer
    stay. If nothing can be left out, or if this cannot be decided, the mechanism itself is
    returned.

    Parameters
    ----------
    mechanism
        The mechanism.
    links
        Indices of the links that have to move as before.

    Raises
    ------
    PlanError
        If an input is a contact, if there is no R pair, or if no pairs connect some links
        to the ground.
    """
    try:
        assembly = plan_assembly(mechanism)
    except CountError:
        # The count of links and pairs does not fit the inputs, as with redundant
        # constraints. So it does not show which pairs place which links. All are kept.
        return mechanism
    # The ground and the links of the inputs stay, so that all inputs can be driven.
    driven_links: set[int] = set()
    for pair in assembly.inputs:
        driven_links.update(mechanism.ends[pair])
    needed_links = frozenset({0, *driven_links, *links})
    # A group is a set of links that are placed together.
    groups = placing_groups(mechanism, assembly, needed_links)
    pairs = {*assembly.inputs}.union(*(group.pairs for group in groups))
    if len(pairs) == len(mechanism.pairs):
        return mechanism
    return of_pairs(mechanism, pairs)


def of_pairs(mechanism: Mechanism, numbers: Iterable[int]) -> Mechanism:
    """Return a mechanism with only some of the pairs and the links that they join.

    Outputs, masses, loads, joint limits and named assembly modes stay if all links and
    pairs to which they refer stay. The ground always stays. The callers analyse the smaller
    mechanism in place of the whole one.

    Parameters
    ----------
    mechanism
        The whole mechanism.
    numbers
        Indices of the pairs that stay.
    """
    # The pairs that stay, their names, and the names of the ground and of their links.
    pairs = tuple(mechanism.pairs[number] for number in sorted(numbers))
    names = {pair.name for pair in pairs}
    links = {mechanism.links[0]}
    for pair in pairs:
        links.update(pair.links)

    def uses_remaining_parts(load: Load) -> bool:
        """Return whether a load depends only on links and pairs that remain.

        `used_links`, `used_pairs` and `rubbing_contacts` return the links and pairs that
        all loads of a mechanism use. So they are called with a copy that has this load
        only.
        """
        with_this_load = replace(mechanism, loads=(load,))
        used_names = used_pairs(with_this_load) | rubbing_contacts(with_this_load)
        return used_links(with_this_load) <= links and used_names <= names

    return replace(
        mechanism,
        links=tuple(link for link in mechanism.links if link in links),
        pairs=pairs,
        geometry=_reduce_geometry(mechanism.geometry, links, names),
        outputs=tuple(o for o in mechanism.outputs if {o.link, o.relative_to} <= links),
        masses=tuple(mass for mass in mechanism.masses if mass.link in links),
        loads=tuple(load for load in mechanism.loads if uses_remaining_parts(load)),
        joint_limits=tuple(x for x in mechanism.joint_limits if x.pair in names),
        modes={
            mode: values
            for mode, values in mechanism.modes.items()
            if values.keys() <= names
        },
    )


def _reduce_geometry(
    geometry: SizeGeometry | PoseGeometry, links: set[str], pairs: set[str]
) -> SizeGeometry | PoseGeometry:
    """Return the geometry of some links and pairs of a mechanism.

    The geometry states arcs and angles from one pair axis of a link to the next. If a pair
    is left out, its axis therefore stays in the list of its links, marked as an axis
    without a pair.

    Parameters
    ----------
    geometry
        The sizes of all links, or the axes of all pairs in a reference pose.
    links, pairs
        Names of the links and pairs that stay.
    """
    if isinstance(geometry, PoseGeometry):
        # `values` are the pair variables in the reference pose.
        return PoseGeometry(
            {name: axis for name, axis in geometry.axes.items() if name in pairs},
            {name: value for name, value in geometry.values.items() if name in pairs},
        )
    sizes_by_link = {}
    for link, sizes in geometry.links.items():
        if link in links:
            unpaired_axes = tuple(axis for axis in sizes.axes if axis not in pairs)
            sizes_by_link[link] = replace(sizes, unpaired=unpaired_axes)
    # `zeros` are the angles of pairs at which their variables are zero.
    zeros = {name: geometry.zeros[name] for name in geometry.zeros if name in pairs}
    return SizeGeometry(sizes_by_link, zeros)
