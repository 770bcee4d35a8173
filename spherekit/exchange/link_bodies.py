"""A mechanism as rigid bodies on the hinges of a tree, with what closes its loops.

General engines move bodies of a tree and close loops by constraints. Two bodies that turn
about the centre O of the sphere share an axis if one point of it coincides in both. The
usual three equations for a point have rank two then, since the radial one is empty. An
engine that weighs constraints by the mobility of centres of mass needs centres away from
O, or it is wrong by radians without a word.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import Lines
from spherekit.errors import ModelError
from spherekit.geometry.vectors import all_finite
from spherekit.mechanism.elements import Pair
from spherekit.mechanism.graph import component_labels, find_spanning_tree
from spherekit.mechanism.inertia import point_mass_inertia
from spherekit.mechanism.joint import Joint
from spherekit.mechanism.joint_construction import make_joints
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.wheel_train import on_carrier, rolled_angles
from spherekit.positions.loop_closure import Closure
from spherekit.scenes.link_scenes import link_shapes
from spherekit.wording import listing

LIGHT_END = 1e-6
"""Part of the largest inertia that a link without mass gets where no mass follows it in the
tree. Smaller: a load on it, or the loop that it closes, is followed less exactly, because
engines weigh constraints by the mobility of the bodies; larger: the motion lags."""

LIGHT_CARRIER = 1e-9
"""The same of a link without mass that carries others with mass. These move with it, so it
may be much lighter. Larger: the motion lags by as much."""

LEAST_INERTIA = 1e-14
"""kg m2 below which no link is made; MuJoCo refuses less than 1e-15."""

AT_CENTRE = 1e-9
"""Centres of mass nearer to O than this part of the radius of gyration are at O."""


class Hinge(NamedTuple):
    """A pair that turns link `child` about an axis of link `parent`.

    `axis` (3,) is a unit vector along which the pair variable, which is `value` (rad) in
    the pose given, is positive. A pair that closes a loop is one too: both links hold the
    point `axis`.
    """

    pair: str
    parent: str
    child: str
    axis: Floats
    value: float


class BodyInertia(NamedTuple):
    """Mass (kg), centre of mass (3,) and tensor (3, 3) about it, in m and kg m2.

    `stated` says whether they are the link's own. Otherwise they are some that have the
    right tensor about O, which alone matters where no gravity acts on the link.
    """

    link: str
    mass: float
    centre: Floats
    tensor: Floats
    stated: bool


class RigidBodies(NamedTuple):
    """A mechanism in one pose, in ground axes, all bodies' origins at O.

    Hinges come depth first, each subtree in one piece, as Pinocchio takes for granted;
    body k is the child of hinge k. Last come bodies in ground axes, of no link, hinged at
    the centres of circles that slide on each other. `cuts` close loops. `ratios` are what
    rolling contacts say: factors by hinge, whose sum of rates is zero. `rotations`
    (links, 3, 3) are from link axes. `made_up` says that the mechanism has no masses and
    its links were given some. `light_ends` are links without mass at the ends of the tree.
    """

    mechanism: Mechanism
    hinges: tuple[Hinge, ...]
    cuts: tuple[Hinge, ...]
    ratios: Mapping[str, Mapping[str, float]]
    bodies: tuple[BodyInertia, ...]
    rotations: Floats
    made_up: bool
    light_ends: tuple[str, ...]


def rigid_bodies(
    mechanism: Mechanism, values: Floats, hinged: Iterable[str] = ()
) -> RigidBodies:
    """Return the bodies, hinges, cut loops and ratios of a mechanism.

    Parameters
    ----------
    mechanism
        A mechanism of R pairs, of rolling contacts with a constant ratio, and of circles
        that slide on each other, whose centres keep their distance.
    values
        (variables,) the closed configuration to give.
    hinged
        Pairs that close no loop if that can be, the most important first; inputs go
        before all.

    Raises
    ------
    ModelError
        If a contact has no constant ratio, some links are held by contacts alone, or the
        variables are not as many as there are.
    """
    values = np.asarray(values, dtype=float)
    count = len(mechanism.variable_names)
    if values.shape != (count,) or not all_finite(values):
        raise ModelError(
            f"{mechanism.name}: a configuration has {count} finite variables "
            f"({listing(mechanism.variable_names)}), not {values.tolist()}"
        )
    at = Closure.of(mechanism, make_joints(mechanism)).at(values[None])
    masses, made_up = _masses(mechanism)
    weightless = {
        link
        for link in mechanism.links[1:]
        if link not in masses or not np.any(masses[link][0])
    }
    # Loops are cut between links with mass if that can be: engines keep a loop softly where
    # a light link closes it.
    beside_weightless = [
        pair.name
        for pair in mechanism.pairs
        if pair.kind.has_axis and not weightless.isdisjoint(pair.links)
    ]
    ways = _tree(mechanism, [*mechanism.input_pairs, *beside_weightless, *hinged])
    light_ends = _light_ends(mechanism, ways, weightless)
    held = [pair for pair, _, _ in ways]
    pairs, links, ends = mechanism.pairs, mechanism.links, mechanism.ends

    def hinge(pair: int, one: int, other: int) -> Hinge:
        axis = at.frames[0, pair, :, 2] * (1.0 if ends[pair][0] == one else -1.0)
        name = pairs[pair].name
        return Hinge(name, links[one], links[other], axis, values[mechanism.angles[name]])

    hinges = [hinge(*way) for way in ways]
    bodies = [
        _body(
            masses,
            links[child],
            at.placed[0, child],
            LIGHT_END if links[child] in light_ends else LIGHT_CARRIER,
        )
        for _, _, child in ways
    ]
    cuts, ratios = [], {}
    for k, pair in enumerate(pairs):
        if pair.kind.has_axis:
            cuts += [] if k in held else [hinge(k, *ends[k])]
        elif pair.rolls or _shaped(pair):
            ratios[pair.name] = _ratio(mechanism, at.joints, k, held)
        else:
            name = f"centres_{pair.name}"
            # From its tangent's turning: what is fixed on a circle, its centre or opposite.
            first, second = (
                at.frames[0, k] @ [0.0, 1.0, bend] / np.hypot(1.0, bend)
                for bend in at.states.curvatures[0, k]
            )
            hinges.append(Hinge(name, pair.links[0], name, first, 0.0))
            cuts.append(Hinge(pair.name, name, pair.links[1], second, 0.0))
            bodies.append(_body(masses, name, np.eye(3), LIGHT_END))
    return RigidBodies(
        mechanism,
        tuple(hinges),
        tuple(cuts),
        ratios,
        tuple(bodies),
        at.placed[0],
        made_up,
        tuple(light_ends),
    )


def _light_ends(
    mechanism: Mechanism, ways: Sequence[tuple[int, int, int]], weightless: Collection[str]
) -> list[str]:
    """Return the links without mass that carry no mass in the tree, in its order.

    Parameters
    ----------
    ways
        (pair, parent, child) of the tree, by number, depth first.
    weightless
        Names of the links without mass.
    """
    carries_mass = set[int]()
    for _, parent, child in reversed(ways):
        if mechanism.links[child] not in weightless or child in carries_mass:
            carries_mass.add(parent)
    return [
        mechanism.links[child]
        for _, _, child in ways
        if mechanism.links[child] in weightless and child not in carries_mass
    ]


def _shaped(pair: Pair) -> Lines:
    """Return the links of a contact whose profiles are no circles."""
    profiles = zip(pair.links, pair.profiles or (), strict=True)
    return [link for link, profile in profiles if profile.round_axis is None]


def _ratio(
    mechanism: Mechanism, joints: Sequence[Joint], number: int, hinges: Iterable[int]
) -> dict[str, float]:
    """Return what a contact says of hinges; `ModelError` without a constant ratio."""
    pair = mechanism.pairs[number]
    held = on_carrier(mechanism, joints, number, pairs=hinges)
    if held is not None:
        factors = rolled_angles(held)
        most = max(map(abs, factors.values()))
        return {mechanism.pairs[n].name: f / most for n, f in factors.items()}
    why = "no link carries both circles, each on a hinge through its centre"
    if _shaped(pair):
        why = f"the profile of link {_shaped(pair)[0]} is no circle"
    raise ModelError(
        f"{mechanism.name}: pairs.{pair.name}: bodies on hinges express R pairs, circles "
        "that slide on each other, and rolling circles that turn about their centres on "
        f"one carrier, whose ratio is constant; {why}. Leave the pair out of a copy of "
        "the file, or lock it away"
    )


def _tree(mechanism: Mechanism, wanted: Iterable[str]) -> list[tuple[int, int, int]]:
    """Return (pair, parent, child) of a spanning tree of R pairs, depth first.

    Of the wanted pairs it has the first ones that close no loop with those before.
    """
    ends, links = mechanism.ends, mechanism.links
    turning = [k for k, pair in enumerate(mechanism.pairs) if pair.kind.has_axis]
    usual = find_spanning_tree(ends, pairs=turning)
    if len(usual) + 1 < len(links):
        held = {0, *(child for _, _, child in usual)}
        lost = listing(link for k, link in enumerate(links) if k not in held)
        raise ModelError(
            f"{mechanism.name}: link {lost} is held by contacts alone; bodies on hinges "
            "need a chain of R pairs from the ground to every link"
        )
    kept: list[int] = []
    named = (mechanism.pair_number[name] for name in wanted)
    for pair in [*named, *(pair for pair, _, _ in usual)]:
        piece = component_labels(len(links), [ends[k] for k in kept])
        if pair in turning and piece[ends[pair][0]] != piece[ends[pair][1]]:
            kept.append(pair)
    ways = find_spanning_tree(ends, pairs=kept)

    def beyond(link: int) -> list[tuple[int, int, int]]:
        return [x for way in ways if way[1] == link for x in (way, *beyond(way[2]))]

    return beyond(0)


Inertia = tuple[Any, float | None, Any]
"""A tensor (3, 3) about O, a mass and its centre (3,)."""


def _masses(mechanism: Mechanism) -> tuple[dict[str, Inertia], bool]:
    """Return the inertia of links, made up where no moving link has any."""
    masses: dict[str, Inertia] = {
        m.link: (m.tensor, m.mass, m.centre) for m in mechanism.masses
    }
    if any(np.any(m[0]) for link, m in masses.items() if link != mechanism.ground):
        return masses, False
    for link, shape in zip(mechanism.links, link_shapes(mechanism), strict=True):
        # Wires of 1 kg/m.
        lines = [*shape.curves, *spokes(shape.joints)]
        middle = np.concatenate([0.5 * (line[1:] + line[:-1]) for line in lines])
        along = np.concatenate([np.diff(line, axis=0) for line in lines])
        lengths = np.linalg.norm(along, axis=1)
        moments = (lengths * middle.T) @ middle + (lengths / 12.0 * along.T) @ along
        mass, tensor = float(np.sum(lengths)), np.trace(moments) * np.eye(3) - moments
        masses[link] = tensor, mass, lengths @ middle / (mass or 1.0)
    return masses, True


def spokes(joints: Floats) -> Floats:
    """Return lines (j, 2, 3) from O to the axes (j, 3) of a link."""
    return np.stack([0.0 * joints, joints], axis=1)


def _body(
    masses: Mapping[str, Inertia], link: str, turn: Floats, light: float
) -> BodyInertia:
    """Return the inertia of a link; without any, `light` of the largest one."""
    tensor, mass, centre = masses.get(link, (np.zeros((3, 3)), None, None))
    about_O = turn @ tensor @ turn.T
    if not np.any(tensor):
        most = max(np.trace(other) for other, _, _ in masses.values())
        about_O, mass = max(light * most, LEAST_INERTIA) * np.eye(3), None
    stated: Any = False
    if mass is not None and centre is not None:
        stated = np.linalg.norm(centre) > AT_CENTRE * np.sqrt(np.trace(about_O) / mass)
        at = turn @ centre
    if mass is None or not stated:
        # The second moments of the mass: one body of many has all of it at unit distance
        # from O, and its centre halfway to where the moments would allow none beyond.
        moments = 0.5 * np.trace(about_O) * np.eye(3) - about_O
        spread, directions = np.linalg.eigh(moments)
        mass = float(np.trace(moments))
        at = 0.5 * np.sqrt(spread[-1] / mass) * directions[:, -1]
    tensor = about_O - point_mass_inertia(mass, at)
    return BodyInertia(link, mass, at, 0.5 * (tensor + tensor.T), bool(stated))
