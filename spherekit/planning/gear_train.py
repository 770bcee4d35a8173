"""Gear trains: wheels on common carriers whose angles follow from the inputs.

Each rolling contact is a linear relation of pair variables
(`spherekit.planning.gear_mesh`). If the relations of all contacts determine the variables
that they relate from the inputs, these variables and the rolled lengths are linear
functions of the inputs.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import TURN
from spherekit.geometry.vectors import max_abs
from spherekit.mechanism.coaxial_links import SAME_AXIS_RAD
from spherekit.mechanism.joint import Joint, revolute
from spherekit.mechanism.joint_construction import make_joints, make_joints_in_pose
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.wheel_phase import find_wheel_contact
from spherekit.planning.gear_mesh import (
    CarriedContact,
    find_carried_contact,
    rolling_contacts,
)
from spherekit.planning.least_rolling import (
    SAME_ROLLED_LENGTH_RAD,
    find_least_rolled_turns,
    index_of_least_rolled,
)

RELATION_RANK_TOLERANCE = 1e-9
"""Relative singular value below which relations of angles count as dependent.

Larger: trains with very different radii are not recognised. Smaller: rounding errors of
radii make dependent relations independent.
"""

MAX_REPEATED_CONTACT_TURNS = 64
"""Largest number of tried whole turns in a contact whose relation follows from others.

Larger: more time. Smaller: wheels with many turns are not assembled.
"""


class GearTrain(NamedTuple):
    """The angles of pairs, and the rolled lengths, that follow from the inputs.

    A rolled length is the arc length by which two wheels have rolled on each other. Angles
    and rolled lengths are linear functions of the inputs.

    Attributes
    ----------
    followers
        Indices of the R pairs whose angles follow from the inputs, without the inputs
        themselves.
    ratios
        (followers, inputs) derivatives of the follower angles with respect to the inputs.
    offsets
        (followers,) angles (rad) of the followers at inputs of zero.
    contacts
        Indices of the rolling contacts.
    length_ratios
        (contacts, inputs) derivatives of the rolled lengths of the contacts with respect to
        the inputs.
    lengths
        (contacts,) rolled lengths (rad) of the contacts at inputs of zero.
    wheel_lengths
        (contacts, 2) arc lengths (rad) along the circles of both wheels. Each length leads
        from the start to the end of an arc, and includes whole turns. At the start of both
        arcs, the wheels touch when the rolled length is zero. At their end, the wheels
        touch when the variables of all R pairs are zero. So the lengths tell which teeth
        mesh. A reference pose determines `offsets` and `lengths` directly. With such a
        pose, these arc lengths are not computed and are NaN.
    """

    followers: tuple[int, ...]
    ratios: Floats
    offsets: Floats
    contacts: tuple[int, ...]
    length_ratios: Floats
    lengths: Floats
    wheel_lengths: Floats

    @property
    def numbers(self) -> list[float]:
        """The ratios and the offset of each follower (pair driven by wheels), in turn.

        These are all the numbers on which the angles of the train depend.
        """
        return list(np.column_stack([self.ratios, self.offsets]).ravel().tolist())


def find_gear_train(
    mechanism: Mechanism,
    driven: Sequence[int],
    max_gap: float = SAME_AXIS_RAD,
    whole: bool = True,
) -> GearTrain | None:
    """Return the gear train by which wheels follow the inputs.

    A mechanism with wheels can be assembled in many ways, with different teeth in contact.
    The train has the assembly of the reference pose. Without a reference pose, it has the
    assembly in which the sum of the absolute rolled lengths of all contacts is smallest at
    inputs of zero.

    Parameters
    ----------
    mechanism
        The mechanism.
    driven
        Indices of the driven pairs.
    max_gap
        Largest error of the arc between the centres of two wheels, measured by its cosine.
        An arc without an error lets the circles touch exactly. Wheels with a gap roll at
        their nearest points, as gears do.
    whole
        Whether all rolling contacts have to belong to the train, with independent
        relations. If not, contacts with angles that the inputs do not determine by
        themselves are left out, and relations may be redundant.

    Returns
    -------
    The train. None if no rolling contact has wheels on a carrier, or if the contacts do not
    determine the angles that they relate, contradict each other or have too many wheels
    (`find_least_rolled_turns`). With `whole`, also None if a contact has no carrier or its
    relation follows from others.
    """
    # Contacts of two wheels that rotate on a common link, the carrier.
    joints = make_joints(mechanism)
    numbers = rolling_contacts(joints)
    carried = [
        find_carried_contact(mechanism, joints, number, max_gap) for number in numbers
    ]
    contacts = [contact for contact in carried if contact]
    if whole and len(contacts) < len(numbers):
        return None
    while contacts:
        # Each contact is a linear relation of pair angles. Followers are the related pairs
        # that are not driven. The matrix of their factors has a row for each contact.
        relations = _Relations.of_contacts(contacts, len(mechanism.pairs), driven)
        follower_factors = relations.factors[:, relations.followers]
        _, singular_values, right_vectors = np.linalg.svd(follower_factors)
        largest = np.max(singular_values, initial=0.0)
        rank = np.sum(singular_values > RELATION_RANK_TOLERANCE * largest)
        # The rows of `null_space` are motions of the followers with the inputs at rest that
        # no contact prevents. A follower is loose if it takes part in one of them.
        null_space = right_vectors[rank:]
        is_loose = np.any(np.abs(null_space) > RELATION_RANK_TOLERANCE, axis=0)
        # The angles of a contact follow from the inputs if none of them is loose.
        is_determined = ~np.any(follower_factors[:, is_loose], axis=1)
        are_all_determined = bool(np.all(is_determined))
        # Whether the relation of a contact follows from those of others.
        has_repetitions = rank < len(contacts)
        if are_all_determined:
            if whole and has_repetitions:
                return None
            return _solve_train(mechanism, list(driven), contacts, relations)
        if whole:
            return None
        # Leave out the contacts whose angles do not follow, and try again.
        contacts = [
            contact
            for contact, determined in zip(contacts, is_determined, strict=True)
            if determined
        ]
    return None


class TrainConstants(NamedTuple):
    """The constants of a gear train that depend on which teeth mesh.

    The relations of rolling leave these constants open. The attributes are those of
    `GearTrain`: the angles of the followers (pairs driven by wheels) at inputs of zero, the
    rolled lengths at inputs of zero, and the lengths along the circles at pair angles of
    zero.
    """

    offsets: Floats
    lengths: Floats
    wheel_lengths: Floats


class _Relations(NamedTuple):
    """The linear relations between pair angles that several rolling contacts impose.

    Two wheels turn by f and g relative to their carrier, a link that carries both. Their
    circles have the radii r and s. While the wheels roll, the point of contact moves by the
    same length along both circles, sin(r) f and sin(s) g. So sin(r) f - sin(s) g is
    constant. Each of the angles f and g is a sum of variables of R pairs, each times 1 or
    -1.

    Attributes
    ----------
    factors
        (contacts, pairs) factors of the pair variables in sin(r) f - sin(s) g.
    first_factors
        (contacts, pairs) factors of the pair variables in the term sin(r) f. The rolled
        length of a contact is a constant minus sin(r) f.
    followers
        Indices of the related pairs that are not driven.
    """

    factors: Floats
    first_factors: Floats
    followers: list[int]

    @staticmethod
    def of_contacts(
        contacts: Sequence[CarriedContact], pair_count: int, driven: Sequence[int]
    ) -> "_Relations":
        """Return the relations sin(r) f - sin(s) g = constant of some rolling contacts.

        Two wheels turn by f and g relative to their carrier, the link that carries both.
        Their circles have the radii r and s. While the wheels roll, the point of contact
        moves by the same length along both circles, sin(r) f and sin(s) g. So the
        difference is constant. (Wheels that touch from outside turn in opposite senses. One
        of their angles is counted in the opposite sense, so that f and g grow together.)
        Each angle is a sum of variables of R pairs, each times 1 or -1.

        Parameters
        ----------
        contacts
            The contacts.
        pair_count
            Number of all pairs of the mechanism.
        driven
            Indices of the driven pairs.
        """
        factors, first_factors = np.zeros((2, len(contacts), pair_count))
        for k, contact in enumerate(contacts):
            # `angle_factors` returns the factor of each pair variable in sin(r) f - sin(s)
            # g. The factors in sin(r) f, those of the pairs of the first wheel, are also
            # stored separately, because they give the length that the wheels have rolled.
            pairs_of_first_wheel, _pairs_of_second_wheel = contact.mesh.angle_signs
            for pair, factor in contact.angle_factors().items():
                factors[k, pair] = factor
                if pair in pairs_of_first_wheel:
                    first_factors[k, pair] = factor
        # Followers are the pairs in these relations that are not driven. Their angles will
        # follow from those of the driven pairs.
        related_pairs = np.flatnonzero(np.any(factors, axis=0))
        followers = np.setdiff1d(related_pairs, driven).tolist()
        return _Relations(factors, first_factors, followers)


def _solve_train(
    mechanism: Mechanism,
    inputs: list[int],
    contacts: Sequence[CarriedContact],
    relations: _Relations,
) -> GearTrain | None:
    """Return the train of contacts whose relations determine the angles of all followers.

    The relation of a contact is a sum of pair variables with constant factors, which keeps
    its value while the wheels roll. Followers are the pairs in these sums that are not
    driven. With the factors F of the followers and G of the inputs, the derivatives of the
    follower angles with respect to the inputs are -F^-1 G.

    F is formed from contacts with independent relations. These already give the angles of
    the wheels of all other contacts. The meshing teeth of the other contacts are chosen to
    fit these angles.

    Parameters
    ----------
    mechanism
        The mechanism.
    inputs
        Indices of the driven pairs.
    contacts
        The contacts of the train.
    relations
        Their relations.

    Returns
    -------
    The train; None if the contacts contradict each other, cannot be assembled, or have too
    many wheels to try their turns.
    """
    joints, reference = make_joints_in_pose(mechanism)
    followers = relations.followers
    independent = _choose_independent_contacts(relations)
    follower_factors = relations.factors[:, followers]  # F, a row for each contact
    input_factors = relations.factors[:, inputs]  # G
    ratios = np.asarray(
        -np.linalg.solve(follower_factors[independent], input_factors[independent])
    )
    # The relations of all contacts must agree with these ratios.
    if max_abs(follower_factors @ ratios + input_factors) > RELATION_RANK_TOLERANCE:
        return None
    # If the first wheel of a contact has the radius r and turns by f, the length that the
    # wheels have rolled is a constant less sin(r) f. `first_factors` has the factors of the
    # pair variables in sin(r) f.
    first_slopes = relations.first_factors[:, followers]
    length_ratios = -(first_slopes @ ratios + relations.first_factors[:, inputs])
    contact_numbers = [contact.mesh.contact for contact in contacts]
    if reference is None:
        constants = _find_constants_of_least_rolling(
            contacts, joints, relations, independent=independent
        )
        if constants is None:
            return None
    else:
        # The reference pose gives the angles and rolled lengths at its own inputs. From
        # there they are continued to inputs of zero.
        reference_inputs = reference[_list_first_variables(mechanism, inputs)]
        reference_angles = reference[_list_first_variables(mechanism, followers)]
        reference_lengths = reference[_list_first_variables(mechanism, contact_numbers)]
        constants = TrainConstants(
            offsets=reference_angles - ratios @ reference_inputs,
            lengths=reference_lengths - length_ratios @ reference_inputs,
            wheel_lengths=np.full((len(contacts), 2), np.nan),
        )
    return GearTrain(
        followers=tuple(followers),
        ratios=ratios,
        offsets=constants.offsets,
        contacts=tuple(contact_numbers),
        length_ratios=length_ratios,
        lengths=constants.lengths,
        wheel_lengths=constants.wheel_lengths,
    )


def _list_first_variables(mechanism: Mechanism, pairs: Sequence[int]) -> list[int]:
    """Return the index of the first variable of each pair (joint).

    For an R pair (revolute joint) this is its angle. For a rolling contact it is the rolled
    length.
    """
    return [mechanism.variables_of(pair)[0] for pair in pairs]


def _find_constants_of_least_rolling(
    contacts: Sequence[CarriedContact],
    joints: Sequence[Joint],
    relations: _Relations,
    independent: list[int],
) -> TrainConstants | None:
    """Return the constants of the assembly in which wheels have rolled least.

    Wheels can be assembled with different teeth in contact. The point of contact on each
    circle is therefore known only up to whole turns. The assembly with the smallest rolled
    lengths at inputs of zero is chosen. Followers are the pairs (joints) that turn with the
    wheels and are not driven. The independent contacts determine their angles, so their
    whole turns are chosen first. The wheels of the other contacts then have to fit these
    angles.

    Parameters
    ----------
    contacts
        The contacts of the train.
    joints
        The joints of all pairs of the mechanism.
    relations
        The relations of the contacts.
    independent
        Indices of contacts whose relations determine the angles of all followers. The
        relations of the others follow from these.

    Returns
    -------
    The constants. None if too many whole turns would have to be tried, or if the teeth of a
    contact that is not independent do not fit.
    """
    # (contacts, 2) arc lengths (rad) along the circles of both wheels: to the point of
    # contact if all pair angles are zero, and of a whole turn.
    wheel_lengths = np.array(
        [_contact_lengths_at_zero(contact, joints) for contact in contacts]
    )
    circumferences = _wheel_circumferences(contacts)
    # If the followers turn by angles, the point of contact moves back along the first
    # circle by `first_slopes` @ angles. What remains is the rolled length. The difference
    # between both circles falls by `follower_factors` @ angles.
    follower_factors = relations.factors[:, relations.followers]
    first_slopes = relations.first_factors[:, relations.followers]

    # 1. Whole turns of the independent contacts.
    turns = find_least_rolled_turns(
        wheel_lengths[independent],
        circumferences[independent],
        first_slopes[independent],
        follower_factors[independent],
    )
    if turns is None:
        return None
    wheel_lengths[independent] += turns * circumferences[independent]

    # 2. The angles of the followers at inputs of zero.
    offsets = _solve_angles_of_equal_lengths(
        wheel_lengths[independent], follower_factors[independent]
    )

    # 3. Whole turns of the other contacts.
    for k in range(len(contacts)):
        if k in independent:
            continue
        fitting_lengths = _fit_contact_to_angles(
            wheel_lengths[k],
            circumferences[k],
            difference=follower_factors[k] @ offsets,
            first_angle_length=first_slopes[k] @ offsets,
        )
        if fitting_lengths is None:
            return None
        wheel_lengths[k] = fitting_lengths

    lengths = wheel_lengths[:, 0] - first_slopes @ offsets
    return TrainConstants(offsets, lengths, wheel_lengths)


def _wheel_circumferences(contacts: Sequence[CarriedContact]) -> Floats:
    """Return the arc lengths (contacts, 2) of a whole turn along both circles (rad)."""
    radii = [[wheel.radius for wheel in contact.wheels] for contact in contacts]
    return TURN * np.abs(np.sin(radii))


def _solve_angles_of_equal_lengths(
    wheel_lengths: Floats, follower_factors: Floats
) -> Floats:
    """Return the follower angles at which both wheels of contacts have rolled equally.

    Followers are pairs that turn with the wheels. The result is their angles at inputs of
    zero, from which the caller computes the constants of the train.

    Two wheels that have rolled on each other have rolled by the same arc length.
    `wheel_lengths` has both lengths at follower angles of zero, where they differ. At
    follower angles a, their difference is smaller by F a, with constant factors F. So F a
    has to be the difference at angles of zero.

    Parameters
    ----------
    wheel_lengths
        (m, 2) arc lengths (rad) of both wheels of m independent contacts at angles of zero.
    follower_factors
        (m, m) factors F: by how much the difference of the lengths of each contact falls
        per radian of the angle of each follower.
    """
    differences = wheel_lengths[:, 0] - wheel_lengths[:, 1]
    return np.asarray(np.linalg.solve(follower_factors, differences), dtype=float)


def _fit_contact_to_angles(
    wheel_lengths: Floats,
    circumferences: Floats,
    difference: float,
    first_angle_length: float,
) -> Floats | None:
    """Return the arc lengths along two circles to their contact, including whole turns.

    The circles belong to two wheels with the angular radii r and s. L and M are the arc
    lengths to the point of contact at wheel angles of zero. Which teeth touch is not known,
    so L and M are known only up to whole turns. Other contacts determine the angles f and g
    by which the wheels turn. These rotations reduce the arc lengths to the rolled lengths
    L - sin(r) f and M - sin(s) g. Two wheels roll by equal lengths, so the turns have to
    make these equal. If several turns fit, those with the smallest rolled length are
    chosen.

    Parameters
    ----------
    wheel_lengths
        (2,) arc lengths L and M (rad), without whole turns.
    circumferences
        (2,) arc lengths (rad) of a whole turn on each circle.
    difference
        Required L - M (rad), which is sin(r) f - sin(s) g.
    first_angle_length
        The arc length sin(r) f (rad).

    Returns
    -------
    (2,) the arc lengths L and M with whole turns; None if no turns fit.
    """
    fitting_lengths = _find_fitting_lengths(wheel_lengths, circumferences, difference)
    if not len(fitting_lengths):
        return None
    # The rolled lengths (n, 1) for n combinations of turns and one contact. They are equal
    # on both circles, so the first circle is enough.
    rolled_lengths = fitting_lengths[:, :1] - first_angle_length
    return fitting_lengths[index_of_least_rolled(rolled_lengths)]


def _choose_independent_contacts(relations: _Relations) -> list[int]:
    """Return indices of contacts with independent relations, the first possible ones."""
    independent: list[int] = []
    # Take each contact with a row of factors that is independent of the rows taken before.
    for k in range(len(relations.factors)):
        rows = relations.factors[[*independent, k]][:, relations.followers]
        if np.linalg.matrix_rank(rows) > len(independent):
            independent.append(k)
    return independent


def _find_fitting_lengths(
    lengths: Floats, circumferences: Floats, difference: float
) -> Floats:
    """Return the arc lengths along two circles in contact, including whole turns.

    Each length is known up to whole circumferences. Several contacts form a closed loop of
    wheels, and this contact is the last. The others already determine the angles of both
    wheels, and so the difference of the lengths. All combinations of up to
    `MAX_REPEATED_CONTACT_TURNS` turns are tried, since wheels may have rolled far.

    Parameters
    ----------
    lengths
        (2,) arc lengths (rad) along both circles to the point of contact, without turns.
    circumferences
        (2,) arc lengths of whole turns.
    difference
        Required first length minus the second.

    Returns
    -------
    (n, 2) all lengths that fit, up to rounding.
    """
    # (combinations, 2) all whole turns of both circles, from -max_turns to max_turns.
    max_turns = MAX_REPEATED_CONTACT_TURNS
    grid = np.indices((2 * max_turns + 1, 2 * max_turns + 1))
    turns = grid.reshape(2, -1).T - max_turns
    shifted_lengths = lengths + turns * circumferences
    deviations = np.abs(shifted_lengths[:, 0] - shifted_lengths[:, 1] - difference)
    return shifted_lengths[deviations < SAME_ROLLED_LENGTH_RAD]


def _contact_lengths_at_zero(
    contact: CarriedContact, joints: Sequence[Joint]
) -> list[float]:
    """Return where two wheels touch if the variables of all R pairs are zero.

    The mechanism file states for each wheel at which point of its circle it touches the
    other wheel when the rolled length (variable of the contact) is zero. Arc lengths along
    the circle are measured from this point. When the R pairs are at zero, the wheels may
    touch at other points, and the two arc lengths may differ. From this difference the
    caller finds the angles of the undriven pairs at which both lengths are equal.

    Parameters
    ----------
    contact
        The contact.
    joints
        The joints of all pairs of the mechanism.

    Returns
    -------
    (2,) arc lengths (rad) of the point of contact along the circles of both wheels.
    """
    # Rotations from the axes of each wheel to those of the carrier, the link that carries
    # both wheels. Several R pairs may lead from a wheel to the carrier.
    rotations = []
    for path in contact.mesh.paths:
        rotation = np.eye(3)
        for pair, near in path:
            # A pair has a frame in each of its two links. `near` is 0 if its first link is
            # nearer to the wheel, and 1 if its second link is.
            joint = revolute(joints[pair])
            frames = joint.first, joint.second
            near_frame = frames[near]
            far_frame = frames[1 - near]
            # At angle zero both frames coincide. So this product rotates from the nearer
            # link to the other one. The columns of a frame are its axes.
            rotation = far_frame @ near_frame.T @ rotation
        rotations.append(rotation)
    return find_wheel_contact(contact.wheels, rotations)
