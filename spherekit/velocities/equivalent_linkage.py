"""Contacts of circles as links between their centres, and as ratios of wheels.

Where two circles slide on each other, their centres keep their distance: the contact moves
its links as a link that is hinged at both centres does (two circles on a plane are a
four-bar; the same holds on the sphere). Circles that roll on a common carrier turn pairs by
a constant ratio. Positions and modes are then those of R pairs, and what rotations lie
between the turns of all pairs are numbers, three angles of Euler each.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from spherekit.arrays import Floats
from spherekit.errors import EngineError
from spherekit.geometry.tilt_torsion import euler_zyz
from spherekit.mechanism.coaxial_links import SAME_AXIS_RAD
from spherekit.mechanism.elements import Pair
from spherekit.mechanism.friction import ContactFriction
from spherekit.mechanism.joint_construction import make_joints
from spherekit.mechanism.locking import sizes_by_frames
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.wheel_train import GearTrain, wheel_train
from spherekit.symbolic.expression_graph import Expr
from spherekit.symbolic.frame_expressions import about_z
from spherekit.symbolic.vector_algebra import Exprs, cosine, sine
from spherekit.tolerances import EQUAL_CURVATURE
from spherekit.velocities.axis_rotations import (
    AxisRotation,
    Entries,
    JointTransform,
    PairRotations,
    pair_rotations,
)


@dataclass(frozen=True)
class EquivalentLinkage:
    """A mechanism of R pairs instead of contacts, and the rotations between its turns.

    Attributes
    ----------
    given
        The mechanism with contacts.
    kept, contacts
        The numbers of its pairs without the contacts that roll; the places of those that
        slide among them.
    constants
        Of the pairs kept (`pair_rotations`): two of an R pair, three of a contact.
    turns
        How the variables follow from those of the given mechanism.
    train
        How pairs follow the inputs through wheels.
    """

    given: Mechanism
    kept: tuple[int, ...]
    contacts: tuple[int, ...]
    constants: tuple[tuple[Floats, ...], ...]
    turns: tuple[AxisRotation, ...]
    train: GearTrain | None

    @cached_property
    def mechanism(self) -> Mechanism:
        """The mechanism of R pairs."""
        return _without_contacts(self.given, self.kept, self.contacts, self.constants)

    @property
    def numbers(self) -> list[float]:
        """The angles of all rotations (rad) in order, then the numbers of the train."""
        every = euler_zyz(np.concatenate(self.constants)).ravel().tolist()
        return every + (self.train.numbers if self.train else [])

    @property
    def form(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """What mechanisms of which the same kernel holds have in common."""
        return self.contacts, self.train.followers if self.train else ()

    def values(self, given: Floats) -> Floats:
        """Return its variables (n, v) from those of the given mechanism (n, w)."""
        return np.column_stack(
            [turn.scale * given[:, turn.variable] + turn.offset for turn in self.turns]
        )

    def pairs(self, given: Mapping[int, Expr]) -> PairRotations:
        """Return the pairs of the mechanism with terms for some of the `numbers`."""
        chains: list[JointTransform] = []
        angles = iter(given.get(k, x) for k, x in enumerate(self.numbers))
        for number, rotations in enumerate(self.constants):
            turned = [[next(angles) for _ in range(3)] for _ in rotations]
            made = [about_z(a) @ _about_y(b) @ about_z(c) for a, b, c in turned]
            parts: list[tuple[Entries, Entries]] = [(made[0], made[-1])]
            if number in self.contacts:
                parts = [(made[0], np.eye(3)), (made[1], made[2])]
            for first, second in parts:
                chains.append(JointTransform((first, second), (AxisRotation(len(chains)),)))
        followers = {}
        if self.train is not None:
            rows = np.array([*angles], dtype=object).reshape(len(self.train.followers), -1)
            followers = dict(zip(self.train.followers, rows.tolist(), strict=True))
        return PairRotations(tuple(chains), {}, followers)


def hinged(
    mechanism: Mechanism, driven: Sequence[str], apart: float = SAME_AXIS_RAD
) -> EquivalentLinkage | None:
    """Return a mechanism driven at pairs without contacts; None if some are of other kinds.

    None too where contacts rub, which pairs between centres do not. Wheels that miss each
    other by less than `apart` (rad) roll as gears do.

    Raises
    ------
    EngineError
        If profiles of a contact curve into each other.
    """
    joints = make_joints(mechanism)
    contacts = [n for n, joint in enumerate(joints) if joint.contact_profiles]
    if not contacts or any(isinstance(x, ContactFriction) for x in mechanism.loads):
        return None
    try:
        pairs = pair_rotations(mechanism)
    except EngineError:
        return None
    rolling = [n for n in contacts if mechanism.pairs[n].rolls]
    contacts = [n for n in contacts if n not in rolling]
    for n in contacts:
        one, other = (
            track.curve.evaluate(np.zeros(1)).curvature
            for track in joints[n].contact_profiles
        )
        if one[0] - other[0] < EQUAL_CURVATURE:
            raise EngineError(
                f"{mechanism.name}: pairs.{mechanism.pairs[n].name}: the profiles curve "
                "into each other, or alike"
            )
    train = None
    if rolling:
        inputs = [mechanism.pair_number[name] for name in driven]
        train = wheel_train(mechanism, inputs, apart)
        if train is None:
            return None
    kept = [n for n in range(len(mechanism.pairs)) if n not in rolling]
    constants = tuple(
        tuple(np.array(rotation, dtype=float) for rotation in pairs.chains[n].constants)
        for n in kept
    )
    turns = [turn for n in kept for turn in pairs.chains[n].rotations]
    round_ones = tuple(turn for turn in turns if isinstance(turn, AxisRotation))
    if train is not None:
        # A contact that slides has two pairs in place of one.
        places = (kept.index(n) + sum(m < n for m in contacts) for n in train.followers)
        train = train._replace(followers=tuple(places))
    slide = tuple(kept.index(n) for n in contacts)
    return EquivalentLinkage(mechanism, tuple(kept), slide, constants, round_ones, train)


def _without_contacts(
    mechanism: Mechanism,
    kept: Sequence[int],
    contacts: Sequence[int],
    constants: Sequence[tuple[Floats, ...]],
) -> Mechanism:
    """Return a mechanism with the pairs that are `kept`, its contacts links."""
    links, pairs = list(mechanism.links), list[Pair]()
    frames: tuple[dict[str, Floats], dict[str, Floats]] = {}, {}

    def put(pair: Pair, first: Floats, second: Floats) -> None:
        pairs.append(pair)
        frames[0][pair.name], frames[1][pair.name] = first, second

    for place, (n, rotations) in enumerate(zip(kept, constants, strict=True)):
        pair = mechanism.pairs[n]
        if place not in contacts:
            put(pair, rotations[0], rotations[1].T)
            continue
        one, other = pair.links
        bar = f"centres_{pair.name}"
        while bar in links:
            bar += "_"
        links.append(bar)
        put(Pair(f"{bar}_{one}", "R", (one, bar)), rotations[0], np.eye(3))
        put(Pair(f"{bar}_{other}", "R", (bar, other)), rotations[1], rotations[2].T)
    return replace(
        mechanism,
        links=tuple(links),
        pairs=tuple(pairs),
        geometry=sizes_by_frames(pairs, frames),
        joint_limits=(),
        modes={},
    )


def _about_y(angle: Expr) -> Exprs:
    c, s = cosine(angle), sine(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-1.0 * s, 0.0, c]], dtype=object)
