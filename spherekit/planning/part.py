"""The part of a mechanism on which the relative positions of some links depend.

Groups are solved in order, and a group asks for earlier ones only where two of its pairs
sit on a body that they made. Going back from the links wanted gives the groups that are
needed; the pairs of all others can be left out without a change of what is left.
"""

from collections.abc import Iterable
from dataclasses import replace

from spherekit.errors import CountError
from spherekit.model.actions import used_links, used_pairs
from spherekit.model.load import Load
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import LinkSizes, PoseGeometry, SizeGeometry
from spherekit.planning.inputs import Assembly, plan_assembly


def moving_pairs(
    mechanism: Mechanism, assembly: Assembly, links: Iterable[int]
) -> tuple[int, ...]:
    """Return the pairs by which these links move relative to each other, in order.

    Those of the groups that place them, and the inputs that these groups and the links
    themselves are driven by: what is left out moves none of them.
    """
    groups, driven_bodies = _placing(mechanism, assembly, frozenset(links))
    driving = set(assembly.inputs)
    joined = frozenset().union(*driven_bodies)
    while True:
        ends = [link for pair in driving for link in mechanism.ends[pair]]
        loose = {link for link in ends if ends.count(link) == 1 and link not in joined}
        idle = {pair for pair in driving if loose & set(mechanism.ends[pair])}
        if not idle:
            break
        driving -= idle
    return tuple(
        sorted(driving.union(*(assembly.groups[number].pairs for number in groups)))
    )


def _placing(
    mechanism: Mechanism, assembly: Assembly, links: frozenset[int]
) -> tuple[set[int], list[frozenset[int]]]:
    """Return the groups that place links relative to each other.

    With them the sets of links, of those and of the groups' pairs, that locked inputs
    alone make one body.
    """
    stages = [list(assembly.bodies)]
    for group in assembly.groups:
        inside = {link for body in group.bodies for link in body}
        base = min(inside)
        last = stages[-1]
        stages.append([base if link in inside else last[link] for link in range(len(last))])
    waiting = [links]
    seen: set[frozenset[int]] = set()
    needed: set[int] = set()
    by_inputs = []
    while waiting:
        wanted = waiting.pop()
        if wanted in seen:
            continue
        seen.add(wanted)
        if _is_one_body(stages[0], wanted):
            by_inputs.append(wanted)
            continue
        number = next(
            k for k, after in enumerate(stages[1:]) if _is_one_body(after, wanted)
        )
        needed.add(number)
        group = assembly.groups[number]
        joined = {link for pair in group.pairs for link in mechanism.ends[pair]}
        waiting += [frozenset(set(body) & (joined | wanted)) for body in group.bodies]
    return needed, by_inputs


def _is_one_body(body: list[int], links: frozenset[int]) -> bool:
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
        See `spherekit.planning.inputs.plan_assembly`.
    """
    try:
        assembly = plan_assembly(mechanism)
    except CountError:
        return mechanism
    driven = {link for pair in assembly.inputs for link in mechanism.ends[pair]}
    groups, _ = _placing(mechanism, assembly, frozenset({0} | driven | set(links)))
    numbers = {*assembly.inputs}.union(*(assembly.groups[k].pairs for k in groups))
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
    sizes: dict[str, LinkSizes] = {}
    for link, link_sizes in given.links.items():
        if link in links:
            sizes[link] = replace(
                link_sizes,
                unpaired=tuple(axis for axis in link_sizes.axes if axis not in pairs),
            )
    zeros = {name: zero for name, zero in given.zeros.items() if name in pairs}
    return SizeGeometry(sizes, zeros)
