"""Closed forms of outputs that consist of dyads when held, driven directly or by wheels."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import TURN
from spherekit.errors import SpherekitError
from spherekit.geometry.triangle import arc
from spherekit.mechanism.elements import Input, Output
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.pair_frames import COLLINEAR_SINE
from spherekit.numerics.angles import wrap
from spherekit.outputs.dyad_chain import Signs
from spherekit.outputs.inverse_kinematics import InverseKinematics
from spherekit.outputs.mid_plane_architecture import axis_in
from spherekit.outputs.output_kinematics import ClosedKinematics
from spherekit.outputs.pose_constraints import LegSpan, ModeAtPoses
from spherekit.planning.assembly_plan import driven_pairs
from spherekit.planning.gear_train import GearTrain, find_gear_train
from spherekit.planning.submechanism import of_pairs

EQUAL_SUM_DECIMALS = 9
"""Decimals (rad) to which sums of absolute inputs are compared.

More decimals: rounding errors decide between inputs that are equally large. Fewer: the sum
of the chosen inputs need not be the smallest.
"""


class DyadKinematics(ClosedKinematics):
    """An output whose mechanism consists of dyads when it is held.

    Parameters
    ----------
    kinematics
        Inverse kinematics of the output, with a closed form.
    """

    solved_by = "dyads"

    def __init__(self, kinematics: InverseKinematics) -> None:
        """Store the inverse kinematics, and name the leg of each dyad by its three pairs.

        The inverse kinematics adds two virtual links, with three R pairs, between the two
        links of the output. The angles of their pairs are the coordinates of the pose, so
        that they hold the output in it. A dyad can end at a virtual pair.

        Parameters
        ----------
        kinematics
            Inverse kinematics of an output whose mechanism consists of dyads when it is
            held: groups of two links and three R pairs.
        """
        assert kinematics.dyads is not None
        virtual_chain = kinematics.wrist
        mechanism_without_virtual_links = kinematics.own
        super().__init__(
            mechanism_without_virtual_links, virtual_chain.output, virtual_chain.points
        )
        self.kinematics = kinematics
        self.modes = kinematics.modes
        self.dyads = kinematics.dyads.dyads
        legs = []
        for dyad in self.dyads:
            pairs = (dyad.near_pair, dyad.middle_pair, dyad.far_pair)
            names = [self.name_of(self._find_real_pair(pair)) for pair in pairs]
            legs.append(f"leg of {', '.join(names)}")
        self.legs = tuple(legs)

    def _find_real_pair(self, pair: int) -> int:
        """Return the number of the mechanism's pair that has the axis of a virtual pair.

        For the inverse kinematics two virtual links with three R pairs join the two links
        of the output and hold it in its pose. A leg can end at the last virtual pair, which
        is on the output link. Users do not know this pair. If it has the same axis as a
        real pair of the output link, the number of the latter is returned, whose name is
        then reported. All other numbers are returned unchanged.
        """
        virtual_chain = self.kinematics.wrist
        if pair != virtual_chain.pairs[-1]:
            return pair
        solver = self.kinematics.solver
        link = virtual_chain.link
        virtual_axis = axis_in(solver.mechanism, solver.joints, pair, link)
        for real_pair, ends in enumerate(self.mechanism.ends):
            if link not in ends:
                continue
            real_axis = axis_in(solver.mechanism, solver.joints, real_pair, link)
            # The sine of so small an arc is the arc itself (rad).
            if arc(real_axis, virtual_axis) < COLLINEAR_SINE:
                return real_pair
        return pair

    @property
    def spans(self) -> tuple[LegSpan, ...]:
        """The reach of every dyad: the least and the largest angle of its outer axes.

        The outer axes are those of the near and far pair, which join the two links of the
        dyad to other links. One of these can be a virtual link, which is added to hold the
        output in its pose. The outer pair is then replaced by the real pair of the output
        link with the same axis, if there is one.
        """
        return tuple(
            LegSpan(
                first_pair=self._find_real_pair(dyad.near_pair),
                second_pair=self._find_real_pair(dyad.far_pair),
                shortest=dyad.shortest,
                longest=dyad.longest,
                # At the smallest angle of the outer axes, both links of a dyad are in one
                # plane, one of them over the other.
                can_fold=True,
            )
            for dyad in self.dyads
        )

    def at(self, poses: Floats, signs: Signs) -> ModeAtPoses:
        """Return one assembly mode at poses.

        Parameters
        ----------
        poses
            (n, 3) directions or (n, 3, 3) orientations of the output.
        signs
            The sign of each dyad, 1 or -1, for the two positions of its middle axis.
        """
        return self.kinematics.posed(poses, signs)


@dataclass(frozen=True)
class CarrierAngle:
    """The angle of a pair as a linear function of the inputs q: ratios . q + offset.

    Attributes
    ----------
    ratios
        (inputs,) derivatives of the angle by the inputs.
    offset
        Angle (rad) at q = 0.
    """

    ratios: Floats
    offset: float


class GearedKinematics(ClosedKinematics):
    """An output of a mechanism in which wheels drive the links that carry the output.

    The inverse kinematics has two steps. The mechanism without wheels, which consists of
    dyads if the output is held, gives the angles of all its pairs. Some of these pairs, the
    carriers, have angles that are linear functions of the inputs through the wheels; the
    inputs follow from them.

    Parameters
    ----------
    mechanism
        The whole mechanism.
    output
        Its output.
    carried
        Closed form of the mechanism without the wheels, driven at the carriers.
    train
        The wheels, with the ratios by which their pairs follow from the inputs.
    carriers
        As many pairs as there are inputs, by their numbers in the whole mechanism. Their
        angles determine the inputs.

    Attributes
    ----------
    offsets
        (inputs,) angles (rad) of the carriers at the inputs 0.
    input_ratios
        (inputs, inputs) derivatives of the inputs by the angles of the carriers.
    carried_pair
        Number of a pair in the mechanism without wheels, by its number in the whole
        mechanism.
    """

    solved_by = "dyads"

    def __init__(
        self,
        mechanism: Mechanism,
        output: Output,
        carried: DyadKinematics,
        train: GearTrain,
        carriers: Mapping[int, CarrierAngle],
    ) -> None:
        """Store the parts, and invert the matrix of the ratios of the carriers.

        Carriers are as many pairs as there are inputs. Their angles are linear functions of
        the inputs through the wheels. They were chosen with linearly independent ratios, so
        that the matrix is regular.

        Parameters
        ----------
        mechanism, output
            The whole mechanism, and its output.
        carried
            Closed form of the mechanism without the wheels, driven at the carriers. It has
            the links that carry the output.
        train
            The wheels, with the ratios by which their pairs follow from the inputs.
        carriers
            Angle of each carrier, by its number in the whole mechanism.
        """
        super().__init__(mechanism, output, carried.points)
        self.carried = carried
        self.train = train
        # Carrier angles = ratios @ inputs + offsets, so inputs = ratios^-1 @ (angles -
        # offsets).
        self.carriers = tuple(carriers)
        self.offsets = np.array([carrier.offset for carrier in carriers.values()])
        ratios = np.array([carrier.ratios for carrier in carriers.values()])
        self.input_ratios = np.linalg.inv(ratios)
        self.modes = carried.modes
        self.legs = carried.legs
        # From the number of a pair in the whole mechanism to that in the mechanism without
        # wheels.
        self.carried_pair = {
            mechanism.pair_number[pair.name]: number
            for number, pair in enumerate(carried.mechanism.pairs)
        }

    @property
    def carrying(self) -> Mechanism:
        """The mechanism without the wheels."""
        return self.carried.mechanism

    @property
    def spans(self) -> tuple[LegSpan, ...]:
        """The reach of the legs that carry the output."""
        return self.carried.spans

    def at(self, poses: Floats, signs: Signs) -> ModeAtPoses:
        """Return one assembly mode at poses.

        Parameters
        ----------
        poses
            (n, 3) directions or (n, 3, 3) orientations of the output.
        signs
            The sign of each dyad of the mechanism without wheels, 1 or -1.
        """
        return _GearedMode(self, carried_mode=self.carried.at(poses, signs))


class _GearedMode:
    """One working mode of a mechanism with wheels, at n poses (a `ModeAtPoses`).

    Parameters
    ----------
    kinematics
        The closed form of the output.
    carried_mode
        The mode of the mechanism without the wheels.
    """

    def __init__(self, kinematics: GearedKinematics, carried_mode: ModeAtPoses) -> None:
        """Keep the parts; all results are computed when they are read."""
        self.kinematics = kinematics
        self.carried_mode = carried_mode

    def cosine(self, one: int, other: int) -> Floats:
        """Return the cosine (n,) between the axes of two pairs, numbered without wheels."""
        return self.carried_mode.cosine(one, other)

    def angle(self, pair: int) -> Floats:
        """Return the variable (n,) of a pair of the whole mechanism in rad."""
        return self._values[:, pair]

    @cached_property
    def inputs(self) -> Floats:
        """(n, inputs) values of the inputs (rad).

        Without its wheels, the mechanism is solved at the poses first (`carried_mode`).
        Some of its pairs, the carriers, are turned by the wheels. Their angles are linear
        functions of the inputs, ratios @ inputs + offsets, from which the inputs follow.

        The angle of a carrier is known up to whole revolutions. Each choice of revolutions
        gives other inputs, because the wheels do not have the ratio 1. Of the choices -1, 0
        and 1 for each carrier, the one with the smallest sum of absolute inputs is taken.
        """
        kinematics = self.kinematics
        # `carried_pair` is the number of a pair in the mechanism without wheels.
        carrier_angles = [
            self.carried_mode.angle(kinematics.carried_pair[pair])
            for pair in kinematics.carriers
        ]
        wrapped_angles = wrap(np.stack(carrier_angles, axis=1) - kinematics.offsets)
        carrier_count = wrapped_angles.shape[1]
        # All combinations of -1, 0 and 1 revolutions of the carriers. The combination
        # without revolutions comes first and wins if sums are equal.
        revolutions = TURN * np.array(list(product((0.0, -1.0, 1.0), repeat=carrier_count)))
        # (n, combinations, inputs)
        candidates = (wrapped_angles[:, None] + revolutions) @ kinematics.input_ratios.T
        sums = np.sum(np.abs(candidates), axis=2)
        best = np.argmin(np.round(sums, EQUAL_SUM_DECIMALS), axis=1)
        return candidates[np.arange(len(candidates)), best]

    @cached_property
    def _values(self) -> Floats:
        """(n, pairs) variables of all pairs (rad).

        The variable of an R pair is its angle in (-pi, pi]. That of a contact of two wheels
        is the arc length by which they have rolled on each other. There are three sources:
        the inputs, the ratios of the wheels for pairs that follow the inputs, and for all
        other R pairs the mechanism without wheels (`carried_mode`).
        """
        kinematics = self.kinematics
        train = kinematics.train
        mechanism = kinematics.mechanism
        values = np.empty((len(self.inputs), len(mechanism.pairs)))
        # A pair can have several sources, which agree up to rounding. Later assignments
        # replace earlier ones.
        values[:, driven_pairs(mechanism)] = wrap(self.inputs)
        follower_angles = self.inputs @ train.ratios.T + train.offsets
        values[:, train.followers] = wrap(follower_angles)
        values[:, train.contacts] = self.inputs @ train.length_ratios.T + train.lengths
        # The pairs of the mechanism without wheels, by their numbers in both mechanisms.
        for pair, carried_pair in kinematics.carried_pair.items():
            values[:, pair] = self.carried_mode.angle(carried_pair)
        return values

    @cached_property
    def rates(self) -> Floats:
        """(n, inputs, 3) rates of the inputs per unit angular velocity of the output.

        They are those of the carriers, times the derivatives of the inputs by the angles of
        the carriers.
        """
        return self.kinematics.input_ratios @ self.carried_mode.rates

    @property
    def type_1(self) -> Floats:
        """(n, inputs) measures of type I, 0 where an input can move with a resting output.

        The measure is the inverse of the largest rate of the input per unit angular
        velocity of the output.
        """
        return 1.0 / np.linalg.norm(self.rates, axis=2)

    @property
    def type_1_square(self) -> Floats:
        """(n, inputs) squares of `type_1`, continued out of reach with negative values.

        Out of reach `type_1` is NaN. The square of an input is then the smallest square of
        the carriers that move with it, each divided by the squared derivative of the input
        by the angle of the carrier.
        """
        square = self.type_1**2
        squared_ratios = self.kinematics.input_ratios**2
        # (n, inputs, carriers)
        continuation = self.carried_mode.type_1_square[:, None] / squared_ratios
        continuation = np.min(continuation, axis=2, where=squared_ratios > 0.0, initial=0.0)
        return np.where(np.isnan(square), continuation, square)

    @property
    def type_2(self) -> Floats:
        """(n,) measure of type II, 0 where the output can move with locked inputs."""
        return self.kinematics.type_2(self._values)


def geared_kinematics(mechanism: Mechanism, output: Output) -> GearedKinematics | None:
    """Return the closed form of an output that wheels drive, None if it has none.

    There is one under three conditions:

    1. All pairs are R pairs or contacts of wheels. The pairs without the wheels and their
       supports contain as many independent *carriers* as there are inputs. These are pairs
       whose angles follow from the inputs of the whole mechanism by the ratios of the
       wheels.
    2. No pair of a wheel has joint limits.
    3. The mechanism without the wheels consists of dyads (two links and three R pairs) if
       the output is held.
    """
    driven = list(driven_pairs(mechanism))
    train = find_gear_train(mechanism, driven)
    r_pairs = {mechanism.pair_number[name] for name in mechanism.angles}
    # 1. All pairs that are no R pairs have to be contacts of the wheels.
    if train is None or len(r_pairs) + len(train.contacts) < len(mechanism.pairs):
        return None
    # The pairs of the links between ground and output, without those that support wheels.
    pairs_without_wheels = _find_carrying_pairs(mechanism, output, r_pairs)
    carriers = _choose_carriers(train, driven, pairs_without_wheels)
    if carriers is None:
        return None
    # 2. Joint limits of wheels would not be taken into account.
    limited_pairs = {mechanism.pair_number[limit.pair] for limit in mechanism.joint_limits}
    if not limited_pairs <= pairs_without_wheels:
        return None
    # 3. The mechanism without the wheels is driven at the carriers. Names of assembly modes
    # are those of the whole mechanism, so they are left out.
    carrier_inputs = tuple(
        Input(mechanism.pairs[pair].name, 0.0, TURN) for pair in carriers
    )
    try:
        driven_at_carriers = replace(mechanism, inputs=carrier_inputs, modes={})
        part = of_pairs(driven_at_carriers, pairs_without_wheels)
        inverse = InverseKinematics(part, output.name)
    except SpherekitError:
        return None
    if not inverse.has_closed_form:
        return None
    return GearedKinematics(
        mechanism, output, carried=DyadKinematics(inverse), train=train, carriers=carriers
    )


def _find_carrying_pairs(mechanism: Mechanism, output: Output, pairs: set[int]) -> set[int]:
    """Return the pairs of the links through which the output is joined to the ground.

    Wheels and their supports are left out. Without the contacts between wheels, a wheel has
    a single pair, so it joins nothing. Links with a single pair are therefore removed with
    this pair, again and again, until none remains.

    Parameters
    ----------
    mechanism
        The mechanism.
    output
        The output. Its two links and the ground are not removed.
    pairs
        Numbers of the R pairs, without the contacts between wheels.
    """
    number = mechanism.link_number
    carrying_pairs = set(pairs)
    fixed_links = {0, number[output.link], number[output.relative_to]}
    while True:
        ends = [link for pair in carrying_pairs for link in mechanism.ends[pair]]
        loose_links = {link for link in ends if ends.count(link) == 1} - fixed_links
        if not loose_links:
            return carrying_pairs
        carrying_pairs = {
            pair for pair in carrying_pairs if loose_links.isdisjoint(mechanism.ends[pair])
        }


def _choose_carriers(
    train: GearTrain, driven: list[int], carrying_pairs: set[int]
) -> dict[int, CarrierAngle] | None:
    """Return carriers: as many pairs as there are inputs, whose angles give the inputs.

    Candidates are the driven pairs themselves, and the pairs whose angles follow from the
    inputs q through the wheels as ratios . q + offset. They are examined in the order of
    their numbers. A pair is chosen if its ratios are linearly independent of those of the
    pairs chosen before.

    Parameters
    ----------
    train
        The wheels, with the ratios of the pairs that follow from the inputs.
    driven
        Numbers of the driven pairs.
    carrying_pairs
        Numbers of the pairs among which carriers are chosen: those of the mechanism without
        wheels, because its solution gives the angles of the carriers.

    Returns
    -------
    The angles of the chosen pairs (carriers) as linear functions of the inputs, by the
    number of the pair. None if there are too few.
    """
    # 1. The candidates. The angle of driven pair k is input k itself, so its ratios are a
    # row of the identity matrix. `train.followers` are the pairs that follow the inputs.
    angles = {
        pair: CarrierAngle(np.eye(len(driven))[k], 0.0) for k, pair in enumerate(driven)
    }
    for pair, ratios, offset in zip(
        train.followers, train.ratios, train.offsets, strict=True
    ):
        angles[pair] = CarrierAngle(ratios, float(offset))

    # 2. The choice.
    carriers: list[int] = []
    for pair in sorted(carrying_pairs & set(angles)):
        ratios = np.array([angles[carrier].ratios for carrier in (*carriers, pair)])
        if np.linalg.matrix_rank(ratios) == len(ratios):
            carriers.append(pair)
    if len(carriers) != len(driven):
        return None
    return {pair: angles[pair] for pair in carriers}
