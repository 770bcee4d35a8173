"""Closed-form kinematics of mechanisms that consist of dyads while their output is held.

A dyad is a group of two links and three R pairs, which is placed between two known axes.
The inputs drive pairs of the dyads, or wheels that turn these pairs.
"""

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
    """An output of a mechanism that consists of dyads while the output is fixed.

    Parameters
    ----------
    kinematics
        Inverse kinematics of the output in closed form. A dyad is two links that two known
        axes determine up to a sign.
    """

    solved_by = "dyads"

    def __init__(self, kinematics: InverseKinematics) -> None:
        """Store the inverse kinematics, and name the leg of each dyad by its three pairs.

        A dyad is two links with three R pairs. The inverse kinematics prescribes the pose
        of the output. For this it adds virtual links and pairs between the output link and
        its reference link. The name of a leg has a real pair with the same axis in place of
        a virtual pair, because users know only real pairs.

        Parameters
        ----------
        kinematics
            Inverse kinematics of an output. The mechanism must consist of dyads while this
            output is held in a pose.
        """
        assert kinematics.dyads is not None
        virtual_chain = kinematics.wrist
        mechanism_without_virtual_links = kinematics.own
        # `virtual_chain.points` is True if the output is a direction, and False if it is an
        # orientation.
        super().__init__(
            mechanism_without_virtual_links, virtual_chain.output, virtual_chain.points
        )
        self.kinematics = kinematics
        self.modes = kinematics.modes
        self.dyads = kinematics.dyads.dyads
        legs = []
        for dyad in self.dyads:
            real_pairs = [self._find_real_pair(pair) for pair in dyad.pairs]
            names = [self.name_of(pair) for pair in real_pairs]
            legs.append(f"the leg of pairs {', '.join(names)}")
        self.legs = tuple(legs)

    def _find_real_pair(self, pair: int) -> int:
        """Return the real pair whose name is reported in place of a virtual pair.

        To hold the output, the inverse kinematics adds a chain of two virtual links and
        three virtual pairs between the reference link and the output link. A leg of the
        mechanism can end at the last virtual pair, which users do not know. Names and
        limits of legs therefore state a real pair of the output link with the same axis. If
        there is one, its number is returned. Every other number is returned unchanged.
        """
        virtual_chain = self.kinematics.wrist
        if pair != virtual_chain.pairs[-1]:
            return pair
        # The mechanism of the solver has the real pairs first, with the same numbers as
        # `self.mechanism`, and then the virtual ones.
        solver = self.kinematics.solver
        output_link = virtual_chain.link
        virtual_axis = axis_in(solver.mechanism, solver.joints, pair, output_link)
        for real_pair, ends in enumerate(self.mechanism.ends):
            if output_link not in ends:
                continue
            real_axis = axis_in(solver.mechanism, solver.joints, real_pair, output_link)
            # The limit is a sine. It is so small that the arc (rad) practically equals its
            # sine.
            if arc(real_axis, virtual_axis) < COLLINEAR_SINE:
                return real_pair
        return pair

    @property
    def spans(self) -> tuple[LegSpan, ...]:
        """The smallest and the largest angle between the outer axes of every leg.

        Both angles limit the reach of the leg. A leg is here a dyad: two links that a
        middle pair joins. A near pair and a far pair join these links to other links. The
        outer axes are the axes of the near and the far pair.

        To hold the output in a pose, virtual links and pairs join the output link to its
        reference link. A leg can end at a virtual pair. A real pair with the same axis is
        reported in place of the virtual pair, because users know only real pairs.
        """
        return tuple(
            LegSpan(
                first_pair=self._find_real_pair(dyad.near_pair),
                second_pair=self._find_real_pair(dyad.far_pair),
                shortest=dyad.shortest,
                longest=dyad.longest,
                # `shortest` is for links without width, folded over each other. Links of
                # some width cannot be folded so far.
                is_limited_by_width=True,
            )
            for dyad in self.dyads
        )

    def at(self, poses: Floats, signs: Signs) -> ModeAtPoses:
        """Return one working mode (way to assemble the legs) at poses.

        Parameters
        ----------
        poses
            (n, 3) directions or (n, 3, 3) orientations of the output.
        signs
            The sign of each dyad, 1 or -1, for the two positions of its middle axis.
        """
        return self.kinematics.posed(poses, signs)


@dataclass(frozen=True)
class EntryAngle:
    """The angle of an entry pair as a linear function of the inputs: ratios . q + offset.

    An entry pair is a pair at which the linkage that carries the output is driven. Such a
    pair is an input itself, or toothed wheels turn it. The inputs have the angles q.

    Attributes
    ----------
    ratios
        (inputs,) derivatives of the angle with respect to the inputs.
    offset
        Angle (rad) at q = 0.
    """

    ratios: Floats
    offset: float


class GearedKinematics(ClosedKinematics):
    """An output of a mechanism in which wheels drive the links that carry the output.

    The inverse kinematics has two steps. First the wheels are left out. The other links
    consist of dyads (two links each) if the output is fixed, which gives the angles of all
    their pairs (joints). Some of these pairs, the entry pairs, are driven by wheels or are
    inputs themselves. Their angles are linear functions of the inputs, so the inputs follow
    from them.

    Parameters
    ----------
    mechanism
        The whole mechanism.
    output
        Its output.
    wheelless
        Closed form of the mechanism without the wheels, driven at the entry pairs.
    train
        The wheels, with the ratios by which their pairs follow from the inputs.
    entry_pairs
        As many entry pairs as there are inputs, by their numbers in the whole mechanism.
        Their angles determine the inputs.

    Attributes
    ----------
    offsets
        (inputs,) angles (rad) of the entry pairs at the inputs 0.
    inverse_ratios
        (inputs, inputs) derivatives of the inputs (first axis) with respect to the angles
        of the entry pairs (second axis).
    wheelless_number
        For the number of each pair in the whole mechanism, its number in the mechanism
        without wheels.
    """

    solved_by = "dyads"

    def __init__(
        self,
        mechanism: Mechanism,
        output: Output,
        wheelless: DyadKinematics,
        train: GearTrain,
        entry_pairs: Mapping[int, EntryAngle],
    ) -> None:
        """Store the parts, and invert the matrix of the ratios of the entry pairs.

        The mechanism without wheels is driven at its entry pairs: pairs that are inputs, or
        that the wheels turn. Their angles are linear functions of the inputs. The inverse
        matrix gives the inputs from these angles. There are as many entry pairs as inputs,
        with linearly independent ratios, so the matrix is regular.

        Parameters
        ----------
        mechanism, output
            The whole mechanism, and its output.
        wheelless
            Closed form of the mechanism without the wheels, driven at the entry pairs. The
            links of the output belong to this mechanism.
        train
            The wheels, with the ratios by which their pairs follow from the inputs.
        entry_pairs
            Angle of each entry pair, by the number of the pair in the whole mechanism.
        """
        super().__init__(mechanism, output, wheelless.points)
        self.wheelless = wheelless
        self.train = train
        # Angles of entry pairs = ratios @ inputs + offsets, so inputs = ratios^-1 @ (angles
        # - offsets).
        self.entry_pairs = tuple(entry_pairs)
        self.offsets = np.array([angle.offset for angle in entry_pairs.values()])
        ratios = np.array([angle.ratios for angle in entry_pairs.values()])
        self.inverse_ratios = np.linalg.inv(ratios)
        self.modes = wheelless.modes
        self.legs = wheelless.legs
        # From the number of a pair in the whole mechanism to that in the mechanism without
        # wheels.
        self.wheelless_number = {
            mechanism.pair_number[pair.name]: number
            for number, pair in enumerate(wheelless.mechanism.pairs)
        }

    @property
    def carrying(self) -> Mechanism:
        """The mechanism without the wheels."""
        return self.wheelless.mechanism

    @property
    def spans(self) -> tuple[LegSpan, ...]:
        """The reach of the legs that carry the output."""
        return self.wheelless.spans

    def at(self, poses: Floats, signs: Signs) -> ModeAtPoses:
        """Return one working mode (way to assemble the legs) at poses.

        Parameters
        ----------
        poses
            (n, 3) directions or (n, 3, 3) orientations of the output.
        signs
            The sign of each dyad of the mechanism without wheels, 1 or -1.
        """
        return _GearedMode(self, wheelless_mode=self.wheelless.at(poses, signs))


class _GearedMode:
    """One working mode (way to assemble the legs) of a mechanism with wheels.

    Parameters
    ----------
    kinematics
        The closed form of the output.
    wheelless_mode
        The mode of the mechanism without the wheels, at n poses of the output.
    """

    def __init__(self, kinematics: GearedKinematics, wheelless_mode: ModeAtPoses) -> None:
        """Keep the parts; all results are computed when they are read."""
        self.kinematics = kinematics
        self.wheelless_mode = wheelless_mode

    def cosine(self, first_pair: int, second_pair: int) -> Floats:
        """Return the cosine (n,) of the angle between the axes of two pairs.

        The pairs (joints) are numbered as in the mechanism without its wheels
        (`GearedKinematics.carrying`).
        """
        return self.wheelless_mode.cosine(first_pair, second_pair)

    def angle(self, pair: int) -> Floats:
        """Return the variable (n,) of a pair of the whole mechanism in rad."""
        return self._values[:, pair]

    @cached_property
    def inputs(self) -> Floats:
        """(n, inputs) values of the inputs (rad) at n poses of the output.

        The mechanism without its wheels (`wheelless_mode`) gives the angles of all its
        pairs at the poses. Some of them, the entry pairs, are inputs or are turned by the
        wheels. Their angles are linear functions of the inputs, ratios @ inputs + offsets.
        The inputs follow from them.

        A pose gives the angles of the entry pairs only up to whole revolutions, and a
        revolution of an entry pair changes the inputs. One revolution less, none, and one
        more are tried for each entry pair. The inputs with the smallest sum of absolute
        values are taken.
        """
        kinematics = self.kinematics
        # `wheelless_number` has the numbers of pairs in the mechanism without wheels. Its
        # keys are their numbers in the whole mechanism.
        entry_angles = [
            self.wheelless_mode.angle(kinematics.wheelless_number[pair])
            for pair in kinematics.entry_pairs
        ]
        angles_from_zero = np.stack(entry_angles, axis=1) - kinematics.offsets
        return _choose_least_inputs(wrap(angles_from_zero), kinematics.inverse_ratios)

    @cached_property
    def _values(self) -> Floats:
        """(n, pairs) variables of all pairs at n poses of the output.

        The variable of an R pair is its angle in (-pi, pi] (rad). The variable of a contact
        of two wheels is the arc length (rad) by which the wheels have rolled on each other.
        There are three sources: the inputs, the wheels for pairs that follow the inputs,
        and the mechanism without wheels (`wheelless_mode`) for all other R pairs.
        """
        kinematics = self.kinematics
        train = kinematics.train
        mechanism = kinematics.mechanism
        values = np.empty((len(self.inputs), len(mechanism.pairs)))
        # A pair can have several sources, which agree up to rounding. The last assignment
        # counts.
        values[:, driven_pairs(mechanism)] = wrap(self.inputs)
        # Through the wheels, angles and rolled arc lengths are linear functions of the
        # inputs. `followers` are the R pairs that the wheels turn, `contacts` the pairs of
        # two wheels.
        follower_angles = self.inputs @ train.ratios.T + train.offsets
        values[:, train.followers] = wrap(follower_angles)
        values[:, train.contacts] = self.inputs @ train.length_ratios.T + train.lengths
        # The pairs of the mechanism without wheels, by their numbers in both mechanisms.
        for pair, wheelless_number in kinematics.wheelless_number.items():
            values[:, pair] = self.wheelless_mode.angle(wheelless_number)
        return values

    @cached_property
    def rates(self) -> Floats:
        """(n, inputs, 3) rates of the inputs per unit angular velocity of the output.

        Entry pairs are the joints through which inputs act on the mechanism without wheels.
        The rates of the entry pairs are multiplied by the derivatives of the inputs with
        respect to the angles of these pairs.
        """
        return self.kinematics.inverse_ratios @ self.wheelless_mode.rates

    @property
    def type_1(self) -> Floats:
        """(n, inputs) measures of type I, 0 where an input can move while the output rests.

        The measure of an input is the least angular speed of the output per unit rate of
        this input: 1 / (largest rate of the input per unit angular velocity of the output).
        """
        return 1.0 / np.linalg.norm(self.rates, axis=2)

    @property
    def type_1_square(self) -> Floats:
        """(n, inputs) squares of `type_1`, continued out of reach.

        The border of a workspace, at which the square is zero, is searched from both sides.
        A pose out of reach has no `type_1`. The square is continued there with negative
        values, or with 0 if the distance from the reach is unknown.
        """
        square = self.type_1**2
        is_out_of_reach = np.isnan(square)
        return np.where(is_out_of_reach, self._continue_type_1_square(), square)

    def _continue_type_1_square(self) -> Floats:
        """Return the squared measures of type I for poses out of reach.

        The measure of an input is the speed of the output per unit rate of this input. The
        measure is 0 at the limit of the reach, where the input can move while the output
        rests. Beyond the limit the measure itself has no value. Its square can be continued
        and is negative there, so that the limit can be searched from both sides.

        The continued squares are known for the mechanism without wheels
        (`wheelless_mode`). Its inputs are the entry pairs: the pairs that the wheels or the
        inputs of the whole mechanism drive. So these squares are per unit rate of an entry
        pair. They are converted to unit rate of an input: if the input changes by r per
        unit angle of the entry pair, the square is divided by r^2.

        An input can get quotients from several entry pairs. The least one counts, because a
        pose is out of reach as soon as one square is negative.

        Returns
        -------
        (n, inputs) the least quotient of all entry pairs that have an effect on the input,
        but at most 0. Within reach the result is 0.
        """
        # There are as many entry pairs as inputs. Both arrays have n rows.
        entry_squares = self.wheelless_mode.type_1_square  # a column for each entry pair
        continuation = np.zeros(entry_squares.shape)  # a column for each input
        # Each row of `inverse_ratios` has the derivatives of one input with respect to the
        # angles of all entry pairs.
        for number, derivatives in enumerate(self.kinematics.inverse_ratios):
            for entry_number, squared_derivative in enumerate(derivatives**2):
                # An entry pair with the derivative 0 has no effect on the input.
                if squared_derivative > 0.0:
                    quotient = entry_squares[:, entry_number] / squared_derivative
                    continuation[:, number] = np.minimum(continuation[:, number], quotient)
        return continuation

    @property
    def type_2(self) -> Floats:
        """(n,) transmission measure, 0 where the output can move with locked inputs."""
        return self.kinematics.type_2(self._values)


def geared_kinematics(mechanism: Mechanism, output: Output) -> GearedKinematics | None:
    """Return the closed form of an output that wheels drive, None if it has none.

    The wheels and the links that only support wheels are removed. Some of the remaining
    pairs are *entry pairs*: they are inputs, or the wheels turn them. From a pose of the
    output, the mechanism without wheels gives the angles of the entry pairs. From these
    angles, the ratios of the wheels give the inputs. There are four conditions:

    1. All pairs are R pairs or contacts of wheels.
    2. There are as many entry pairs as inputs, and their angles are independent linear
       functions of the inputs.
    3. No pair that was removed with the wheels has joint limits, because the closed form
       would not check them.
    4. If the output is held in a pose, the mechanism without the wheels consists of dyads
       (two links and three R pairs).
    """
    driven = list(driven_pairs(mechanism))
    # `mechanism.angles` has the names of the R pairs.
    r_pairs = {mechanism.pair_number[name] for name in mechanism.angles}
    # 1. R pairs and contacts are all pairs.
    train = find_gear_train(mechanism, driven)
    if train is None or len(r_pairs) + len(train.contacts) < len(mechanism.pairs):
        return None
    # 2. The entry pairs are among the pairs that remain without the wheels.
    pairs_without_wheels = _find_pairs_without_wheels(mechanism, output, r_pairs)
    entry_pairs = _choose_entry_pairs(train, driven, pairs_without_wheels)
    if entry_pairs is None:
        return None
    # 3. Joint limits.
    limited_pairs = {mechanism.pair_number[limit.pair] for limit in mechanism.joint_limits}
    if not limited_pairs <= pairs_without_wheels:
        return None
    # 4. The remaining mechanism consists of dyads.
    wheelless = _solve_without_wheels(
        mechanism, output, pairs_without_wheels, entry_pairs=list(entry_pairs)
    )
    if wheelless is None:
        return None
    return GearedKinematics(
        mechanism, output, wheelless=wheelless, train=train, entry_pairs=entry_pairs
    )


def _solve_without_wheels(
    mechanism: Mechanism, output: Output, carrying_pairs: set[int], entry_pairs: list[int]
) -> DyadKinematics | None:
    """Return the closed form of a mechanism without its wheels, None if it has none.

    Some of the remaining pairs are entry pairs: they are inputs, or the wheels turn them.
    The closed form gives the angles of the entry pairs from a pose of the output. From
    these angles, `GearedKinematics` then computes the inputs by the ratios of the wheels.

    Parameters
    ----------
    mechanism
        The whole mechanism.
    output
        The output.
    carrying_pairs
        Numbers of the pairs that remain without the wheels.
    entry_pairs
        Numbers of the entry pairs, which become the inputs.
    """
    # The names of assembly modes belong to the whole mechanism, so they are left out.
    # Inputs range over one turn.
    entry_inputs = tuple(
        Input(mechanism.pairs[pair].name, 0.0, TURN) for pair in entry_pairs
    )
    # An error means that the mechanism without wheels is not valid, or that a pose of the
    # output does not place its links.
    try:
        driven_at_entry_pairs = replace(mechanism, inputs=entry_inputs, modes={})
        part = of_pairs(driven_at_entry_pairs, carrying_pairs)
        inverse = InverseKinematics(part, output.name)
    except SpherekitError:
        return None
    return DyadKinematics(inverse) if inverse.has_closed_form else None


def _choose_least_inputs(entry_angles: Floats, inverse_ratios: Floats) -> Floats:
    """Return the tried inputs with the smallest sum of absolute values at each of n poses.

    An entry pair is a pair that is an input, or that toothed wheels turn. The inputs are
    linear functions of the angles of the entry pairs. A pose gives these angles only up to
    whole revolutions. A revolution of an entry pair leaves the pose as it is, but changes
    the inputs. The caller needs one choice. For each entry pair, one revolution less, none,
    and one more are tried. More revolutions are not tried, but could give a smaller sum.

    Parameters
    ----------
    entry_angles
        (n, entry pairs) angles (rad) in (-pi, pi] of the entry pairs, counted from their
        values at inputs of 0.
    inverse_ratios
        (inputs, entry pairs) derivatives of the inputs with respect to these angles.

    Returns
    -------
    (n, inputs) rad. If sums are equal, inputs without revolutions are preferred.
    """
    entry_count = entry_angles.shape[1]
    # (combinations, entry pairs). The combination without revolutions is the first one, and
    # `argmin` chooses the first one of equal sums.
    combinations = list(product((0.0, -1.0, 1.0), repeat=entry_count))
    revolutions = TURN * np.array(combinations)
    possible_angles = entry_angles[:, None] + revolutions  # (n, combinations, entry pairs)
    possible_inputs = possible_angles @ inverse_ratios.T  # (n, combinations, inputs)
    sums = np.sum(np.abs(possible_inputs), axis=2)
    best = np.argmin(np.round(sums, EQUAL_SUM_DECIMALS), axis=1)
    return possible_inputs[np.arange(len(possible_inputs)), best]


def _find_pairs_without_wheels(
    mechanism: Mechanism, output: Output, pairs: set[int]
) -> set[int]:
    """Return the pairs that remain if the wheels of a mechanism are removed.

    The remaining mechanism joins the output to the ground. From a pose of the output, it
    gives the angles of the pairs that the wheels turn.

    Without the contacts between wheels, a wheel has a single pair, so it connects no other
    links. Each link with a single pair is removed with this pair. A link that only supports
    wheels then has a single pair, too. The removal is repeated until no such link is left.

    Parameters
    ----------
    mechanism
        The mechanism.
    output
        The output, a link whose pose relative to another link is wanted. Both links and the
        ground are not removed.
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


def _choose_entry_pairs(
    train: GearTrain, driven: list[int], carrying_pairs: set[int]
) -> dict[int, EntryAngle] | None:
    """Return as many pairs as there are inputs, so that their angles give the inputs.

    The caller solves the inverse kinematics in two steps. First it leaves the wheels out,
    and computes the angles of the remaining pairs from a pose of the output. Then it needs
    the inputs q. They follow from the angles of the pairs that this function chooses, the
    entry pairs.

    Candidates are the driven pairs, and the pairs that the wheels turn. Their angles are
    ratios . q + offset. Candidates are examined in the order of their numbers. A pair is
    chosen if its ratios are linearly independent of those of the pairs chosen before.

    Parameters
    ----------
    train
        The wheels, with the ratios of the pairs that follow from the inputs.
    driven
        Numbers of the driven pairs.
    carrying_pairs
        Numbers of the pairs of the mechanism without wheels. Other pairs are not chosen.

    Returns
    -------
    The angles of the chosen entry pairs as linear functions of the inputs, by the number of
    the pair. None if there are too few.
    """
    # 1. The candidates. The angle of driven pair k is input k itself, so its ratios are a
    # row of the identity matrix. `train.followers` are the pairs that follow the inputs.
    angles = {
        pair: EntryAngle(np.eye(len(driven))[k], 0.0) for k, pair in enumerate(driven)
    }
    for pair, ratios, offset in zip(
        train.followers, train.ratios, train.offsets, strict=True
    ):
        angles[pair] = EntryAngle(ratios, float(offset))

    # 2. The choice.
    entry_pairs: list[int] = []
    for pair in sorted(carrying_pairs & set(angles)):
        ratios = np.array([angles[number].ratios for number in (*entry_pairs, pair)])
        if np.linalg.matrix_rank(ratios) == len(ratios):
            entry_pairs.append(pair)
    if len(entry_pairs) != len(driven):
        return None
    return {pair: angles[pair] for pair in entry_pairs}
