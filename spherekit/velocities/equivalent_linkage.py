"""Replaces contacts of circles by links and constant ratios, so that only R pairs remain.

If two circles slide on each other, their centres keep their distance. The contact then
moves its links in the same way as an additional link that is hinged at both centres. (In
the plane, two circular cams move like a four-bar.) Circles that roll on a common carrier
turn their pairs at a constant ratio. Positions and assembly modes are therefore those of a
mechanism of R pairs. Its constant rotations are given by three Euler angles each.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import MAX_NAME_LENGTH
from spherekit.errors import EngineError
from spherekit.geometry.tilt_torsion import euler_zyz
from spherekit.mechanism.coaxial_links import SAME_AXIS_RAD
from spherekit.mechanism.elements import Pair
from spherekit.mechanism.friction import ContactFriction
from spherekit.mechanism.joint_construction import make_joints
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.sizes_from_frames import sizes_from_frames
from spherekit.planning.gear_train import GearTrain, find_gear_train
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
    """A mechanism of R pairs that moves like a mechanism with contacts of circles.

    A sliding contact of two circles is replaced by a link that is hinged at both centres.
    Rolling contacts are replaced by constant ratios.

    Attributes
    ----------
    contact_mechanism
        The mechanism with contacts.
    pairs_without_rolling
        Indices of the pairs of the mechanism with contacts, without the rolling contacts.
    sliding
        Indices, in `pairs_without_rolling`, of the sliding contacts.
    constant_rotations
        For each of `pairs_without_rolling`, the constant rotations (3, 3) of
        `pair_rotations`: two for an R pair, three for a contact.
    variable_rotations
        For each variable of the linkage, its angle as a linear function of a variable of
        the mechanism with contacts.
    train
        The ratios of pairs that follow the inputs through wheels, by the indices of the
        pairs of the linkage. None without rolling contacts.
    """

    contact_mechanism: Mechanism
    pairs_without_rolling: tuple[int, ...]
    sliding: tuple[int, ...]
    constant_rotations: tuple[tuple[Floats, ...], ...]
    variable_rotations: tuple[AxisRotation, ...]
    train: GearTrain | None

    @cached_property
    def mechanism(self) -> Mechanism:
        """The mechanism of R pairs."""
        return _replace_contacts(
            self.contact_mechanism,
            self.pairs_without_rolling,
            self.sliding,
            self.constant_rotations,
        )

    @property
    def numbers(self) -> list[float]:
        """The Euler angles (rad) of all constant rotations, then the numbers of the train.

        The numbers of the train are the ratios of wheels. All these numbers determine the
        linkage among all linkages with the same `form`.
        """
        rotations = np.concatenate(self.constant_rotations)
        euler_angles = euler_zyz(rotations).ravel().tolist()
        return euler_angles + (self.train.numbers if self.train else [])

    @property
    def form(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """A key that is equal for linkages to which the same expressions apply."""
        return self.sliding, self.train.followers if self.train else ()

    def values(self, contact_values: Floats) -> Floats:
        """Return the variables of the linkage from those of the mechanism with contacts.

        The linkage has R pairs (revolute joints) only and moves in the same way.

        Parameters
        ----------
        contact_values
            (n, w) variables of the mechanism with contacts at n configurations (rad).

        Returns
        -------
        (n, v) variables of the linkage (rad).
        """
        # Each variable is a linear function of one variable of the mechanism with contacts.
        return np.column_stack(
            [
                rotation.scale * contact_values[:, rotation.variable] + rotation.offset
                for rotation in self.variable_rotations
            ]
        )

    def pairs(self, symbol_by_index: Mapping[int, Expr]) -> PairRotations:
        """Return the rotations of the pairs of the linkage, with symbols for some numbers.

        The linkage has R pairs (revolute joints) only. It replaces a mechanism with
        contacts of circles. A sliding contact becomes a link between the centres of the
        circles, with an R pair at each centre. A rolling contact of wheels is replaced by
        its effect: some pairs (followers) turn by angles that are linear functions of the
        input angles.

        All numbers of the linkage are in the property `numbers`. They are the Euler angles
        of all constant rotations, from link axes to the frames of pairs, then the factors
        of the linear functions. Results for other sizes follow from symbols in place of
        some numbers.

        Parameters
        ----------
        symbol_by_index
            Symbols that replace some of the `numbers`, by the index of the number.
        """
        # A symbol where there is one, otherwise the number.
        numbers = [symbol_by_index.get(k, x) for k, x in enumerate(self.numbers)]
        rotation_count = sum(len(rotations) for rotations in self.constant_rotations)
        euler_angle_count = 3 * rotation_count
        transforms = self._pair_transforms(numbers[:euler_angle_count])
        followers = self._follower_factors(numbers[euler_angle_count:])
        # `sides` are the profiles of contacts. The linkage has no contacts.
        return PairRotations(tuple(transforms), sides={}, followers=followers)

    def _pair_transforms(self, euler_angles: Sequence[Expr]) -> list[JointTransform]:
        """Return the rotation from the first to the second link of each R pair (hinge).

        The linkage has R pairs only. It replaces a mechanism with contacts of circles. A
        sliding contact becomes a link between the centres of both circles. A rolling
        contact gives no pair.

        Each rotation from link to link is a constant rotation, the rotation by the variable
        of the pair, and another constant rotation. The constant rotations depend on the
        sizes of the mechanism.

        Parameters
        ----------
        euler_angles
            Three Euler angles (rad) for each constant rotation, in the order of the pairs.
            They are numbers, or symbols. Later the values for other sizes of the mechanism
            are inserted for the symbols.
        """
        all_rotations: list[Exprs] = []
        for start in range(0, len(euler_angles), 3):
            three_angles = euler_angles[start : start + 3]
            all_rotations.append(_rotation_from_euler(*three_angles))

        transforms: list[JointTransform] = []

        def add_r_pair(before_turn: Entries, after_turn: Entries) -> None:
            """Add an R pair with the constant rotations before and after its variable."""
            variable = len(transforms)  # each R pair has one variable, of the same index
            transforms.append(
                JointTransform((before_turn, after_turn), (AxisRotation(variable),))
            )

        remaining_rotations = iter(all_rotations)
        # `constant_rotations` has an entry for each R pair and each sliding contact of the
        # mechanism.
        for index in range(len(self.constant_rotations)):
            if index in self.sliding:
                # A sliding contact becomes two R pairs, at the centres of the circles. The
                # frame of the link between them is chosen equal to that of the first pair.
                # So the rotation from this pair to the link is the unit matrix.
                first_link_to_centre = next(remaining_rotations)
                between_centres = next(remaining_rotations)
                centre_to_second_link = next(remaining_rotations)
                add_r_pair(first_link_to_centre, np.eye(3))
                add_r_pair(between_centres, centre_to_second_link)
            else:
                first_link_to_pair = next(remaining_rotations)
                pair_to_second_link = next(remaining_rotations)
                add_r_pair(first_link_to_pair, pair_to_second_link)
        return transforms

    def _follower_factors(self, train_numbers: Sequence[Expr]) -> dict[int, list[Expr]]:
        """Return, by the index of each follower (pair that wheels drive), its factors.

        The angle of a follower is a linear function of the input angles. A follower has one
        factor for each input, and then the constant (rad). `train_numbers` are the
        factors and constants of all followers, one after another.
        """
        if self.train is None:
            return {}
        rows = np.array([*train_numbers], dtype=object)
        rows = rows.reshape(len(self.train.followers), -1)
        return dict(zip(self.train.followers, rows.tolist(), strict=True))


def find_equivalent_linkage(
    mechanism: Mechanism, input_pairs: Sequence[str], max_gap_rad: float = SAME_AXIS_RAD
) -> EquivalentLinkage | None:
    """Return the linkage of R pairs that moves like a mechanism with contacts of circles.

    Two circles that slide on each other keep the distance of their centres, so a link that
    is hinged at both centres replaces the contact. Circles that roll on a common carrier
    turn their pairs at constant ratios, so these contacts are left out.

    Parameters
    ----------
    mechanism
        The mechanism.
    input_pairs
        Names of its input pairs.
    max_gap_rad
        Largest gap (rad) between two wheels that count as touching.

    Returns
    -------
    EquivalentLinkage or None
        None if there are no contacts, if a contact is of another kind or has friction, or
        if wheels are not on a common carrier.

    Raises
    ------
    EngineError
        If the profiles of a sliding contact cut into each other, or have equal curvature.
    """
    joints = make_joints(mechanism)
    contacts = [n for n, joint in enumerate(joints) if joint.contact_profiles]
    has_friction = any(isinstance(load, ContactFriction) for load in mechanism.loads)
    if not contacts or has_friction:
        return None
    try:
        pairs = pair_rotations(mechanism)
    except EngineError:
        # Profiles that are no circles have no rotation about a fixed axis.
        return None
    # Below, n is the index of a pair of the mechanism.
    rolling = [n for n in contacts if mechanism.pairs[n].rolls]
    sliding = [n for n in contacts if n not in rolling]
    # A convex profile must not be in contact with a profile that is curved as much or
    # more.
    for n in sliding:
        first_curvature, second_curvature = (
            profile.curve.evaluate(np.zeros(1)).curvature[0]
            for profile in joints[n].contact_profiles
        )
        if first_curvature - second_curvature < EQUAL_CURVATURE:
            raise EngineError(
                f"{mechanism.name}: pairs.{mechanism.pairs[n].name}: the profiles would "
                "cut into each other, or have equal curvature; change the size of one "
                "profile"
            )
    # The ratios of the pairs that follow the inputs through wheels.
    train = None
    if rolling:
        inputs = [mechanism.pair_number[name] for name in input_pairs]
        train = find_gear_train(mechanism, inputs, max_gap_rad)
        if train is None:
            return None
    remaining = [n for n in range(len(mechanism.pairs)) if n not in rolling]
    constant_rotations = tuple(
        tuple(np.array(rotation, dtype=float) for rotation in pairs.chains[n].constants)
        for n in remaining
    )
    variable_rotations = tuple(
        rotation
        for n in remaining
        for rotation in pairs.chains[n].rotations
        if isinstance(rotation, AxisRotation)
    )
    if train is not None:
        # A sliding contact has two pairs in the linkage, so later pairs are shifted by one.
        followers = tuple(
            remaining.index(n) + sum(contact < n for contact in sliding)
            for n in train.followers
        )
        train = train._replace(followers=followers)
    return EquivalentLinkage(
        contact_mechanism=mechanism,
        pairs_without_rolling=tuple(remaining),
        sliding=tuple(remaining.index(n) for n in sliding),
        constant_rotations=constant_rotations,
        variable_rotations=variable_rotations,
        train=train,
    )


def _replace_contacts(
    mechanism: Mechanism,
    pairs_without_rolling: Sequence[int],
    sliding: Sequence[int],
    constant_rotations: Sequence[tuple[Floats, ...]],
) -> Mechanism:
    """Return a mechanism in which sliding contacts are links between the centres.

    Each sliding contact of two circles is replaced by a link with two R pairs, about the
    centres of the circles. The second of the three constant rotations of the contact leads
    from one of these axes to the other. Joint limits and named modes are left out.

    Parameters
    ----------
    mechanism
        The mechanism with contacts.
    pairs_without_rolling
        Indices of its pairs, without the rolling contacts.
    sliding
        Indices, in `pairs_without_rolling`, of the sliding contacts.
    constant_rotations
        For each of `pairs_without_rolling`, two rotations (3, 3) for an R pair and three
        for a contact.
    """
    links = list(mechanism.links)
    # Names that a new pair must not have.
    pair_names = [pair.name for pair in mechanism.pairs]
    pairs: list[Pair] = []
    # Frames (3, 3) of the pairs in their first and in their second links.
    first_frames: dict[str, Floats] = {}
    second_frames: dict[str, Floats] = {}

    def add_pair(pair: Pair, first_frame: Floats, second_frame: Floats) -> None:
        """Add an R pair with its frames in its first and second link."""
        pairs.append(pair)
        first_frames[pair.name] = first_frame
        second_frames[pair.name] = second_frame

    for index, (n, rotations) in enumerate(
        zip(pairs_without_rolling, constant_rotations, strict=True)
    ):
        pair = mechanism.pairs[n]
        if index not in sliding:
            # An R pair: its frame in the first link, and its transposed frame in the
            # second.
            add_pair(pair, rotations[0], rotations[1].T)
            continue
        first_link, second_link = pair.links
        centre_link = _free_name(f"centres_{pair.name}", links)
        links.append(centre_link)
        first_name = _free_name(f"{centre_link}_{first_link}", pair_names)
        pair_names.append(first_name)
        second_name = _free_name(f"{centre_link}_{second_link}", pair_names)
        pair_names.append(second_name)
        first_pair = Pair(first_name, "R", (first_link, centre_link))
        second_pair = Pair(second_name, "R", (centre_link, second_link))
        add_pair(first_pair, rotations[0], np.eye(3))
        add_pair(second_pair, rotations[1], rotations[2].T)
    return replace(
        mechanism,
        links=tuple(links),
        pairs=tuple(pairs),
        geometry=sizes_from_frames(pairs, (first_frames, second_frames)),
        joint_limits=(),
        modes={},
    )


def _free_name(name: str, used_names: Collection[str]) -> str:
    """Return a name that is not used: the given name, shortened or numbered if needed."""
    free_name = name[:MAX_NAME_LENGTH]
    number = 1
    while free_name in used_names:
        number += 1
        ending = f"_{number}"
        free_name = name[: MAX_NAME_LENGTH - len(ending)] + ending
    return free_name


def _rotation_from_euler(first: Expr, second: Expr, third: Expr) -> Exprs:
    """Return the rotation (3, 3) about z, y and z by three Euler angles (rad)."""
    return about_z(first) @ _about_y(second) @ about_z(third)


def _about_y(angle: Expr) -> Exprs:
    """Return the rotation (3, 3) about y by an angle (rad)."""
    c = cosine(angle)
    s = sine(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-1.0 * s, 0.0, c]], dtype=object)
