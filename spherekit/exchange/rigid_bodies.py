"""A mechanism as rigid bodies on the hinges of a tree, and constraints that close loops.

General engines move bodies of a tree and close loops by constraints. Two bodies that turn
about the centre O of the sphere share an axis if one point of it coincides in both. The
usual three equations for a point then have rank two, since the radial one is empty.

MuJoCo weighs these constraints by how easily forces move the centres of mass of both
bodies. A centre of mass at O cannot move. Loops are then closed wrongly, by radians and
without a message, so bodies get centres of mass away from O.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Floats
from spherekit.errors import ModelError
from spherekit.exchange.body_inertia import (
    BodyInertia,
    find_link_inertias,
    make_body_inertia,
)
from spherekit.exchange.identifiers import unique_names
from spherekit.geometry.vectors import all_finite
from spherekit.mechanism.elements import Pair
from spherekit.mechanism.graph import component_labels, find_spanning_tree
from spherekit.mechanism.joint import Joint
from spherekit.mechanism.joint_construction import make_joints
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.gear_mesh import find_carried_contact
from spherekit.positions.loop_closure import Closure
from spherekit.wording import listing

LIGHT_END_RATIO = 1e-6
"""Inertia of a link without mass that carries no mass in the tree, relative to the largest.

Smaller: a load on it, or the loop that it closes, is followed less exactly, because engines
weigh constraints by the mobility of the bodies; larger: the motion lags.
"""

LIGHT_CARRIER_RATIO = 1e-9
"""The same of a link without mass that carries others with mass.

These move with it, so it may be much lighter. Larger: the motion lags by as much.
"""


class Hinge(NamedTuple):
    """A joint that turns about one axis (an R pair of the mechanism) between two bodies.

    Attributes
    ----------
    pair
        Name of the R pair. A hinge of a coupler (see `RigidBodies`) has the name of the
        coupler or of the contact instead.
    parent, child
        Names of the two bodies. Bodies form a tree: each body but the ground has one hinge
        that joins it to its parent. A hinge that closes a loop is not in the tree. Either
        of its bodies can then be the parent.
    axis
        (3,) unit vector in ground axes, in the exported configuration. A positive variable
        turns the child about this axis.
    value
        Variable (rad) of the pair in the exported configuration.
    """

    pair: str
    parent: str
    child: str
    axis: Floats
    value: float


class Branch(NamedTuple):
    """A pair of the tree of links, with its known link and the link that the pair places.

    All three are given by number.
    """

    pair: int
    parent: int
    child: int


class RigidBodies(NamedTuple):
    """A mechanism in one configuration, as bodies on the hinges of a tree.

    Programs for multibody dynamics (engines) move bodies on a tree of hinges, and close
    loops by constraints. Vectors have components in ground axes. The origin of each body is
    the centre O of the sphere.

    Attributes
    ----------
    mechanism
        The mechanism.
    hinges
        First the hinges of the tree, depth first, so that the hinges of each subtree follow
        each other, as Pinocchio assumes. Then the hinges of couplers. A coupler is a body
        that replaces the contact of two circles that slide on each other, because their
        centres have a constant distance. The hinge of a coupler at the centre of the first
        circle joins the coupler to the first link.
    bodies
        Inertia of the bodies. Body k is the child of hinge k.
    loop_hinges
        The R pairs that close loops, and the second hinge of each coupler, at the centre of
        the second circle.
    gear_equations
        The equation of each rolling contact, by the name of the contact. Each equation is a
        mapping from R pairs to factors: the sum of factors times rates of these pairs is
        zero.
    rotations
        (links, 3, 3) rotations from link axes to ground axes.
    has_made_up_masses
        Whether the mechanism file has no masses, so that the export invented some.
    light_ends
        Names of all couplers, and of the links without mass that carry no link with mass in
        the tree. They get more inertia than other links without mass, because engines
        follow a load on a light body less exactly.
    """

    mechanism: Mechanism
    hinges: tuple[Hinge, ...]
    bodies: tuple[BodyInertia, ...]
    loop_hinges: tuple[Hinge, ...]
    gear_equations: Mapping[str, Mapping[str, float]]
    rotations: Floats
    has_made_up_masses: bool
    light_ends: tuple[str, ...]


def construct_rigid_bodies(
    mechanism: Mechanism, values: Floats, tree_pairs: Iterable[str] = ()
) -> RigidBodies:
    """Return the bodies, hinges, loops and gear equations of a mechanism.

    Programs such as MuJoCo describe a mechanism as a tree of bodies. Hinges join the bodies
    of the tree, and constraints close its loops.

    Parameters
    ----------
    mechanism
        A mechanism of R pairs, of rolling contacts with a constant ratio, and of circles
        that slide on each other, whose centres keep their distance.
    values
        (variables,) a closed configuration.
    tree_pairs
        Names of pairs (joints) that should be hinges of the tree instead of closing a loop,
        the most important first. Inputs and pairs of links without mass take precedence
        over these pairs.

    Raises
    ------
    ModelError
        If a contact has no constant ratio, some links are joined only by contacts, or the
        number of variables is wrong or a variable is not finite.
    """
    values = np.asarray(values, dtype=float)
    variable_count = len(mechanism.variable_names)
    if values.shape != (variable_count,) or not all_finite(values):
        raise ModelError(
            f"{mechanism.name}: a configuration needs {variable_count} finite numbers, one "
            f"for each variable ({listing(mechanism.variable_names)}), not "
            f"{values.tolist()}"
        )
    # The configuration: orientations of links, and frames of pairs (z is the pair axis).
    pairs = mechanism.pairs
    links = mechanism.links
    pose = Closure.of_mechanism(mechanism, make_joints(mechanism)).linearise(values[None])
    rotations = pose.rotations[0]
    pair_frames = pose.frames[0]
    link_inertias = find_link_inertias(mechanism)
    massless_links = {
        link for link in mechanism.links[1:] if not link_inertias.has_mass(link)
    }
    # Loops are cut between links with mass if that is possible: engines close a loop less
    # exactly if a light link closes it.
    pairs_of_massless_links = [
        pair.name
        for pair in pairs
        if pair.kind.has_axis and not massless_links.isdisjoint(pair.links)
    ]
    branches = _choose_tree(
        mechanism, [*mechanism.input_pairs, *pairs_of_massless_links, *tree_pairs]
    )
    light_ends = _find_light_ends(mechanism, branches, massless_links)

    def make_hinge(pair: int, parent: int, child: int) -> Hinge:
        """Return the hinge of an R pair from a parent link to a child, all by number."""
        sense = 1.0 if mechanism.ends[pair][0] == parent else -1.0
        axis = pair_frames[pair, :, 2] * sense
        name = pairs[pair].name
        value = values[mechanism.angles[name]]
        return Hinge(name, links[parent], links[child], axis, value)

    # The tree: a hinge and a body for each link but the ground.
    hinges: list[Hinge] = []
    bodies: list[BodyInertia] = []
    for branch in branches:
        hinges.append(make_hinge(*branch))
        link = links[branch.child]
        light_ratio = LIGHT_END_RATIO if link in light_ends else LIGHT_CARRIER_RATIO
        bodies.append(
            make_body_inertia(link_inertias, link, rotations[branch.child], light_ratio)
        )
    # The other pairs: hinges that close loops, gears, and circles that slide.
    tree_pair_numbers = [branch.pair for branch in branches]
    used_names = [*links, *(pair.name for pair in pairs)]
    loop_hinges: list[Hinge] = []
    gear_equations: dict[str, Mapping[str, float]] = {}
    for number, pair in enumerate(pairs):
        if pair.kind.has_axis:
            if number not in tree_pair_numbers:
                loop_hinges.append(make_hinge(number, *mechanism.ends[number]))
        elif pair.rolls or _find_noncircular_links(pair):
            gear_equations[pair.name] = _find_gear_equation(
                mechanism, pose.joints, number, tree_pair_numbers
            )
        else:
            # Circles that slide keep the distance of their centres, so a body between the
            # centres replaces the contact. In the frame of the contact, the centre of a
            # circle, or the opposite point, is along (0, 1, curvature).
            (name,) = unique_names([f"centres_{pair.name}"], taken=used_names)
            used_names.append(name)
            light_ends.append(name)
            first_centre, second_centre = (
                pair_frames[number] @ [0.0, 1.0, curvature] / np.hypot(1.0, curvature)
                for curvature in pose.states.curvatures[0, number]
            )
            first_link, second_link = pair.links
            hinges.append(Hinge(name, first_link, name, first_centre, 0.0))
            loop_hinges.append(Hinge(pair.name, name, second_link, second_centre, 0.0))
            bodies.append(
                make_body_inertia(link_inertias, name, np.eye(3), LIGHT_END_RATIO)
            )
    return RigidBodies(
        mechanism=mechanism,
        hinges=tuple(hinges),
        bodies=tuple(bodies),
        loop_hinges=tuple(loop_hinges),
        gear_equations=gear_equations,
        rotations=rotations,
        has_made_up_masses=link_inertias.are_made_up,
        light_ends=tuple(light_ends),
    )


def _find_light_ends(
    mechanism: Mechanism, branches: Sequence[Branch], massless_links: Collection[str]
) -> list[str]:
    """Return the links without mass that carry no link with mass in the tree.

    Dynamics programs (engines) need a mass in each body, so links without mass get a little
    inertia. This is enough for a link that carries links with mass in the tree. A link that
    carries no link with mass needs more inertia (`LIGHT_END_RATIO`), because engines follow
    a load on a light body less exactly.

    Parameters
    ----------
    branches
        The tree of links, depth first. Each branch has a parent and a child link.
    massless_links
        Names of the links without mass.
    """
    links = mechanism.links
    links_carrying_mass: set[int] = set()
    # From the ends of the tree to the ground, so that children come before their parents.
    for branch in reversed(branches):
        has_mass = links[branch.child] not in massless_links
        if has_mass or branch.child in links_carrying_mass:
            links_carrying_mass.add(branch.parent)
    return [
        links[branch.child]
        for branch in branches
        if links[branch.child] in massless_links and branch.child not in links_carrying_mass
    ]


def _find_noncircular_links(pair: Pair) -> list[str]:
    """Return the links of a contact whose profiles are not circles."""
    profiles = zip(pair.links, pair.profiles or (), strict=True)
    return [link for link, profile in profiles if profile.round_axis is None]


def _find_gear_equation(
    mechanism: Mechanism, joints: Sequence[Joint], contact: int, tree_pairs: Collection[int]
) -> dict[str, float]:
    """Return the equation of a rolling contact between the rates of R pairs.

    Two circles that roll on each other have a constant ratio if both turn on one link (the
    carrier), each on an R pair (hinge) through its centre. The equation contains only R
    pairs of the spanning tree, a choice of pairs that joins all links to the ground without
    a loop.

    Parameters
    ----------
    joints
        For each pair a `Joint`: the pair with its geometry.
    contact
        Number of the contact.
    tree_pairs
        Numbers of the R pairs of the spanning tree.

    Returns
    -------
    Factors, by the name of the pair: the sum of the factors times the rates of these pairs
    is zero. The largest factor is 1 or -1.

    Raises
    ------
    ModelError
        If the ratio is not constant: no link carries both circles, or a profile is not a
        circle.
    """
    pair = mechanism.pairs[contact]
    carried_contact = find_carried_contact(mechanism, joints, contact, pairs=tree_pairs)
    if carried_contact is not None:
        factors = carried_contact.angle_factors()
        largest_factor = max(map(abs, factors.values()))
        return {
            mechanism.pairs[number].name: factor / largest_factor
            for number, factor in factors.items()
        }
    reason = "no link carries both circles, each on a hinge through its centre"
    noncircular_links = _find_noncircular_links(pair)
    if noncircular_links:
        reason = f"the profile of link {noncircular_links[0]} is not a circle"
    raise ModelError(
        f"{mechanism.name}: pairs.{pair.name}: cannot be part of a MuJoCo model: {reason}. "
        "Allowed: R pairs, circles that slide on each other, and rolling circles that turn "
        "about their centres on one carrier at a constant ratio. Leave the pair out of a "
        "copy of the file, and export the copy"
    )


def _choose_tree(mechanism: Mechanism, preferred_pairs: Iterable[str]) -> list[Branch]:
    """Return a tree of R pairs (hinges) that joins all links to the ground, depth first.

    Dynamics programs place the bodies by this spanning tree. All other R pairs close loops.

    Parameters
    ----------
    preferred_pairs
        Names of pairs, the most important first. Each of these pairs belongs to the tree
        unless it closes a loop with the pairs before it.

    Raises
    ------
    ModelError
        If R pairs do not join all links.
    """
    ends = mechanism.ends
    links = mechanism.links
    revolute_pairs = [k for k, pair in enumerate(mechanism.pairs) if pair.kind.has_axis]
    default_tree = find_spanning_tree(ends, pairs=revolute_pairs)
    if len(default_tree) + 1 < len(links):
        reached_links = {0, *(child for _, _, child in default_tree)}
        unreached_links = listing(
            name for link, name in enumerate(links) if link not in reached_links
        )
        raise ModelError(
            f"{mechanism.name}: link {unreached_links} is connected by contacts only, but "
            "a MuJoCo model needs a chain of R pairs from the ground to every link"
        )
    # Take the preferred pairs first, then the others. Two links with the same component
    # label are already joined, so a pair between them would close a loop.
    candidates = [mechanism.pair_number[name] for name in preferred_pairs]
    candidates += [pair for pair, _, _ in default_tree]
    tree_pairs: list[int] = []
    for pair in candidates:
        if pair not in revolute_pairs:
            continue
        component = component_labels(len(links), [ends[k] for k in tree_pairs])
        first, second = ends[pair]
        if component[first] != component[second]:
            tree_pairs.append(pair)
    branches = [Branch(*branch) for branch in find_spanning_tree(ends, pairs=tree_pairs)]

    def subtree(link: int) -> list[Branch]:
        """Return the pairs of the tree beyond a link, depth first."""
        result: list[Branch] = []
        for branch in branches:
            if branch.parent == link:
                result += [branch, *subtree(branch.child)]
        return result

    return subtree(0)
