"""A mechanism as rigid bodies on the hinges of a tree, with what closes its loops.

General engines move bodies of a tree and close loops by constraints. Two bodies that turn
about the centre O of the sphere share an axis if one point of it coincides in both. The
usual three equations for a point have rank two then, since the radial one is empty. An
engine that weighs constraints by the mobility of centres of mass needs centres away from
O, or it is wrong by radians without a word.
"""

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.analysis.link_scenes import link_shapes
from spherekit.arrays import Floats
from spherekit.conventions import listing
from spherekit.errors import ModelError
from spherekit.model.dynamics import Mass, moments_of_point
from spherekit.model.gears import geometry_of
from spherekit.model.graph import spanning
from spherekit.model.joints import Joint
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import Profile
from spherekit.motion.closure import Closure
from spherekit.motion.loops import Linearisation
from spherekit.planning.wheels import (
    on_carrier,
)
from spherekit.sphere.rotation import all_finite


@final
@dataclass(frozen=True)
class Ratio:
    """A rolling contact as an equation: factors by hinge, whose sum of rates is zero."""

    pair: str
    factors: Mapping[str, float]


def ratio_of(
    mechanism: Mechanism, joints: Sequence[Joint], number: int, hinges: Iterable[int]
) -> Ratio:
    """Return what the contact of a number says of the hinges of a tree.

    Raises
    ------
    ModelError
        Unless two circles roll that turn about their centres on one carrier.
    """
    pair = mechanism.pairs[number]
    held = on_carrier(mechanism, joints, number, pairs=hinges)
    if held is not None:
        factors = held.mesh.relation(held.sizes)
        most = max(map(abs, factors.values()))
        names = {mechanism.pairs[n].name: f / most for n, f in factors.items()}
        return Ratio(pair.name, names)
    profiles = zip(pair.links, pair.profiles or (), strict=True)
    shaped = [link for link, profile in profiles if profile.round_axis is None]
    why = "no link carries both circles, each on a hinge through its centre"
    if shaped:
        why = f"the profile of link {shaped[0]} is no circle"
    raise ModelError(
        f"{mechanism.name}: pairs.{pair.name}: bodies on hinges express R pairs, circles "
        "that slide on each other, and rolling circles that turn about their centres on "
        f"one carrier, whose ratio is constant; {why}. Leave the pair out of a copy of "
        "the file, or lock it away"
    )


SMALL = 1e-6
"""Bodies without inertia get this part of the largest one: no engine moves massless
bodies."""

AT_CENTRE = 1e-9
"""Centres of mass nearer to O than this part of the radius of gyration are at O."""


@final
@dataclass(frozen=True)
class Hinge:
    """A pair of the tree that turns link `child` about a fixed axis of link `parent`.

    `axis` (3,) is a unit vector along which the pair variable, which is `value` (rad) in
    the pose given, is positive.
    """

    pair: str
    parent: str
    child: str
    axis: Floats
    value: float


@final
@dataclass(frozen=True)
class LoopCut:
    """A pair that closes a loop: links `first` and `second` share `point` (3,).

    `value` (rad) is its variable in the pose given.
    """

    pair: str
    first: str
    second: str
    point: Floats
    value: float


@final
@dataclass(frozen=True)
class BodyInertia:
    """Mass (kg), centre of mass (3,) and tensor (3, 3) about it, in m and kg m2.

    `stated` says whether they are the link's own. Otherwise they are some that have the
    right tensor about O, which alone matters where no gravity acts on the link.
    """

    link: str
    mass: float
    centre: Floats
    tensor: Floats
    stated: bool


@final
@dataclass(frozen=True)
class RigidBodies:
    """A mechanism in one pose, in ground axes, all bodies' origins at O.

    Hinges come depth first, each subtree in one piece, as Pinocchio takes for granted;
    body k is the child of hinge k. Last come bodies in ground axes, of no link, hinged at
    the centres of circles that slide on each other. `ratios` are what rolling contacts
    say of hinges, and `rotations` (links, 3, 3) from link axes. `made_up` says that the
    mechanism has no masses and its links were given some.
    """

    mechanism: Mechanism
    hinges: tuple[Hinge, ...]
    cuts: tuple[LoopCut, ...]
    ratios: tuple[Ratio, ...]
    bodies: tuple[BodyInertia, ...]
    rotations: Floats
    made_up: bool


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
    at = Closure.of(mechanism, geometry_of(mechanism).joints).at(values[None])
    ways = _tree(mechanism, [*mechanism.input_pairs, *hinged])
    hinges = _hinges(mechanism, at, ways)
    held = {hinge.pair for hinge in hinges}
    pairs, axes = mechanism.pairs, at.frames[0, :, :, 2]
    cuts = tuple(
        LoopCut(
            pair.name,
            *pair.links,
            axes[k],
            float(at.values[0, mechanism.angles[pair.name]]),
        )
        for k, pair in enumerate(pairs)
        if pair.kind.has_axis and pair.name not in held
    )
    sliding = [
        k
        for k, pair in enumerate(pairs)
        if not pair.rolls and pair.profiles and all(map(_is_round, pair.profiles))
    ]
    ratios = tuple(
        ratio_of(mechanism, at.joints, k, [pair for pair, _, _ in ways])
        for k, pair in enumerate(pairs)
        if not pair.kind.has_axis and k not in sliding
    )
    masses, made_up = _masses(mechanism)
    bodies = tuple(
        _body(masses, hinge.child, at.placed[0, mechanism.link_number[hinge.child]])
        for hinge in hinges
    )
    for k in sliding:
        name = f"centres_{pairs[k].name}"
        # From its tangent's turning: what is fixed on a circle, its centre or opposite.
        first, second = (
            at.frames[0, k] @ [0.0, 1.0, bend] / np.hypot(1.0, bend)
            for bend in at.states.curvatures[0, k]
        )
        hinges += (Hinge(name, pairs[k].links[0], name, first, 0.0),)
        cuts += (LoopCut(pairs[k].name, name, pairs[k].links[1], second, 0.0),)
        bodies += (_body(masses, name, np.eye(3)),)
    return RigidBodies(mechanism, hinges, cuts, ratios, bodies, at.placed[0], made_up)


def _is_round(profile: Profile) -> bool:
    return profile.round_axis is not None


def _tree(mechanism: Mechanism, wanted: Iterable[str]) -> tuple[tuple[int, int, int], ...]:
    """Return (pair, parent, child) of a spanning tree of R pairs, breadth first.

    Of the wanted pairs it has the first ones that close no loop with those before.
    """
    ends = mechanism.ends
    turning = [k for k, pair in enumerate(mechanism.pairs) if pair.kind.has_axis]
    usual = spanning(ends, pairs=turning)
    if len(usual) + 1 < len(mechanism.links):
        reached = {0, *(child for _, _, child in usual)}
        lost = listing(n for k, n in enumerate(mechanism.links) if k not in reached)
        raise ModelError(
            f"{mechanism.name}: link {lost} is held by contacts alone; bodies on hinges "
            "need a chain of R pairs from the ground to every link"
        )
    order = [mechanism.pair_number[name] for name in wanted]
    order += [pair for pair, _, _ in usual]
    piece = list(range(len(mechanism.links)))
    kept = []
    for pair in order:
        a, b = (piece[end] for end in ends[pair])
        if a != b and mechanism.pairs[pair].kind.has_axis:
            kept.append(pair)
            piece = [a if label == b else label for label in piece]
    return spanning(ends, pairs=kept)


def _hinges(
    mechanism: Mechanism, at: Linearisation, ways: Sequence[tuple[int, int, int]]
) -> tuple[Hinge, ...]:
    axes = at.frames[0, :, :, 2]
    links, pairs, ends = mechanism.links, mechanism.pairs, mechanism.ends
    return tuple(
        Hinge(
            pairs[pair].name,
            links[parent],
            links[child],
            axes[pair] if ends[pair][0] == parent else -axes[pair],
            float(at.values[0, mechanism.angles[pairs[pair].name]]),
        )
        for pair, parent, child in _depth_first(ways, 0)
    )


def _depth_first(
    ways: Sequence[tuple[int, int, int]], root: int
) -> list[tuple[int, int, int]]:
    ordered: list[tuple[int, int, int]] = []
    for way in ways:
        if way[1] == root:
            ordered += [way, *_depth_first(ways, way[2])]
    return ordered


def _masses(mechanism: Mechanism) -> tuple[dict[str, Mass], bool]:
    """Return the masses by link, made up where no moving link has any."""
    masses = {mass.link: mass for mass in mechanism.masses}
    moving = [mass for link, mass in masses.items() if link != mechanism.ground]
    if any(np.any(np.array(mass.tensor) != 0.0) for mass in moving):
        return masses, False
    shapes = zip(mechanism.links, link_shapes(mechanism), strict=True)
    return {
        link: _wire(link, [*shape.curves, *spokes(shape.joints)]) for link, shape in shapes
    }, True


def spokes(joints: Floats) -> list[Floats]:
    """Return lines (2, 3) from O to the axes (j, 3) of a link."""
    return [np.stack([0.0 * joint, joint]) for joint in joints]


def _wire(link: str, lines: Sequence[Floats]) -> Mass:
    """Return the inertia of wires of 1 kg/m along polylines (k, 3) in m."""
    tensor, mass, moment = np.zeros((3, 3)), 0.0, np.zeros(3)
    for line in lines:
        for a, b in itertools.pairwise(line):
            length = float(np.linalg.norm(b - a))
            middle = 0.5 * (a + b)
            tensor += moments_of_point(length, middle)
            tensor += moments_of_point(length / 12.0, b - a)
            mass, moment = mass + length, moment + length * middle
    rows = tuple((float(x), float(y), float(z)) for x, y, z in tensor)
    assert len(rows) == 3
    x, y, z = moment / (mass or 1.0)
    return Mass(link, rows, mass, (float(x), float(y), float(z)))


def _body(masses: dict[str, Mass], link: str, turn: Floats) -> BodyInertia:
    given = masses.get(link)
    if given is not None and np.any(np.array(given.tensor)):
        about_O = turn @ np.array(given.tensor) @ turn.T
        if given.mass is not None and given.centre is not None:
            centre = turn @ np.array(given.centre)
            gyration = np.sqrt(np.trace(about_O) / given.mass)
            if np.linalg.norm(centre) > AT_CENTRE * gyration:
                tensor = _moved(about_O, given.mass, centre)
                return BodyInertia(link, given.mass, centre, tensor, True)
    else:
        most = max(float(np.trace(np.array(m.tensor))) for m in masses.values())
        about_O = SMALL * most * np.diag([1.0, 1.0, 1.0])
    # The second moments of the mass: one body of many has all of it at unit distance from
    # O, and its centre halfway to where the moments would allow none beyond.
    moments = 0.5 * np.trace(about_O) * np.eye(3) - about_O
    spread, directions = np.linalg.eigh(moments)
    mass = float(np.trace(moments))
    centre = 0.5 * np.sqrt(spread[-1] / mass) * directions[:, -1]
    return BodyInertia(link, mass, centre, _moved(about_O, mass, centre), False)


def _moved(about_O: Floats, mass: float, centre: Floats) -> Floats:
    tensor = about_O - moments_of_point(mass, centre)
    return np.asarray(0.5 * (tensor + tensor.T))
