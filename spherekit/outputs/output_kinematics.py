"""An output of a mechanism with its poses: base classes of all ways to solve them.

`OutputKinematics` is any output. `ClosedKinematics` is an output with a closed form, whose
poses are limited by the reach of its legs. `spherekit.outputs.pose_solver` chooses the
class for a mechanism.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from spherekit.arrays import Bools, Floats, Indices, SmallIntegers
from spherekit.conventions import Names
from spherekit.errors import AnalysisError
from spherekit.mechanism.elements import Output
from spherekit.mechanism.joint_construction import make_joints
from spherekit.mechanism.mechanism import Mechanism
from spherekit.numerics.array_rows import ArrayRows
from spherekit.outputs.dyad_chain import Signs
from spherekit.outputs.forward_kinematics import (
    ForwardKinematics,
    PoseSolutions,
    output_rates,
)
from spherekit.outputs.mid_plane_architecture import MidPlaneArchitecture
from spherekit.outputs.pose_constraints import (
    AngleLimit,
    Constraints,
    LegSpan,
    ModeAtPoses,
    bounds_of,
    find_least_margin,
)
from spherekit.outputs.virtual_output import with_wrist
from spherekit.positions.assembly_mode import label_of
from spherekit.positions.loop_closure import Closure
from spherekit.positions.motion import make_motion
from spherekit.status import Status
from spherekit.tolerances import SINGULAR_DYAD_SINE
from spherekit.velocities.transmission_measure import Transmission
from spherekit.wording import listing

MAX_LISTED_MODES = 64
"""Largest number of working modes that an error message lists."""


@dataclass(frozen=True)
class InverseRows(ArrayRows):
    """Configurations at given poses, in k rows, with margins and measures.

    Usually there is one row for each pose and working mode, which is a sign for each leg.

    Attributes
    ----------
    pose
        (k,) index of the pose, ascending.
    mode
        (k,) label of the working mode (way to assemble the legs), such as ``+-``. A group
        of links without a sign has ``~``. If the position solver finds no configuration at
        a pose, the pose has one row with an empty label.
    inputs
        (k, inputs) rad in (-pi, pi]. If wheels drive the mechanism, they can be outside of
        this range.
    status
        (k,) values of `Status`: OK; OUT_OF_REACH, and then all but margin and limiting
        are NaN; AT_SINGULARITY where a measure is nearly 0 or has no value.
    margin, limiting
        (k,) angle (rad) that is left to the nearest limit, negative beyond it, and (k,) the
        index of this limit in `limits`. They are NaN and -1 where the margin is not known.
    type_1
        (k, inputs) speed of the output per unit rate of each input; 0 at a singularity of
        type I, where the input moves while the output rests.
    type_2
        (k,) transmission measure; 0 at a singularity of type II, where the output can move
        although the inputs are locked (`spherekit.velocities.transmission_measure`).
    rates
        (k, inputs, 3) rates of the inputs per unit angular velocity of the output.
    values
        (k, pairs) variables of the requested pairs, rad in (-pi, pi].
    limits
        Names of the limits; empty if they were not examined.
    """

    pose: Indices
    mode: NDArray[np.str_]
    inputs: Floats
    status: SmallIntegers
    margin: Floats
    limiting: Indices
    type_1: Floats
    type_2: Floats
    rates: Floats
    values: Floats
    limits: Names

    def __len__(self) -> int:
        return len(self.pose)

    @property
    def solved(self) -> Bools:
        """(k,) whether the row has a configuration."""
        return self.status != Status.OUT_OF_REACH

    def with_status(self) -> Self:
        """Return the rows, each with the status that follows from its other values.

        A row is one configuration at a pose. The margin of a row is the angle (rad) that is
        left to the nearest limit.

        - A row with a negative margin becomes OUT_OF_REACH, and its values become NaN.
        - Another row becomes AT_SINGULARITY if an input is not finite, or if a measure of
          type I or II is nearly 0 or NaN. At type I an input moves while the output rests;
          at type II the output can move although the inputs are locked.
        - All other rows become OK.

        A margin of NaN means that the limits were not examined, and has no influence on the
        status. A margin of -inf stands for a pose without a configuration, and becomes NaN.
        """
        is_outside = self.margin < 0.0
        # Type I has a measure for each input (axis 1), type II has one. The result is NaN
        # if one of them is NaN, and then fails the comparison below.
        least_measure = np.minimum(np.min(self.type_1, axis=1), self.type_2)
        has_inputs = np.isfinite(self.inputs).all(axis=1)
        # Both measures are 0 at a singularity. Where two links are nearly in line, half of
        # the digits are lost if the sine of the angle between them is below this limit. The
        # same limit is used here for every measure.
        is_regular = has_inputs & (least_measure > SINGULAR_DYAD_SINE)
        status = np.where(is_regular, Status.OK, Status.AT_SINGULARITY)
        status[is_outside] = Status.OUT_OF_REACH
        # NaN is added to all values of rows outside, and 0 to the others.
        blank = np.where(is_outside, np.nan, 0.0)
        return replace(
            self,
            inputs=self.inputs + blank[:, None],
            status=status.astype(np.int8),
            margin=np.where(np.isfinite(self.margin), self.margin, np.nan),
            type_1=self.type_1 + blank[:, None],
            type_2=self.type_2 + blank,
            rates=self.rates + blank[:, None, None],
            values=self.values + blank[:, None],
        )

    @classmethod
    def concatenate(cls, parts: Sequence[Self]) -> Self:
        """Return the rows of several modes; rows of the same pose follow each other."""
        rows = super().concatenate(parts)
        return rows.rows(np.argsort(rows.pose, kind="stable"))


class OutputKinematics:
    """The poses of one declared output.

    If the number of inputs differs from the number of coordinates of a pose, the poses at
    inputs can be computed, but not the inputs of poses.

    Attributes
    ----------
    mechanism, output
        The output, and the mechanism that declares it.
    points
        Whether poses are directions (n, 3). Otherwise they are rotations (n, 3, 3).
    modes
        The signs of all working modes.
    legs
        For each sign the leg or group of links that it belongs to, as text.
    form
        The mid-plane symmetric architecture of the output, if it has one.
    solved_by
        Method that gives the configurations: ``dyads`` and ``mid-plane`` are closed forms,
        ``graph`` solves the loops of all links.
    """

    modes: tuple[Signs, ...] = ()
    legs: Names = ()
    form: MidPlaneArchitecture | None = None
    solved_by = "graph"

    def __init__(self, mechanism: Mechanism, output: Output, points: bool) -> None:
        self.mechanism = mechanism
        self.output = output
        self.points = points

    @property
    def labels(self) -> Names:
        """Labels of the working modes."""
        return tuple(map(label_of, self.modes))

    def chosen_modes(self, text: str) -> tuple[Signs, ...]:
        """Return the working modes that the user has named by a text.

        A working mode is one way to assemble the legs at a pose, with a sign for each leg.
        The text is the label of a mode, such as ``+-+``, or its number. An empty text means
        all modes.

        Returns
        -------
        The signs of each mode.

        Raises
        ------
        AnalysisError
            If there is no such mode.
        """
        if not text:
            return self.modes
        if text in self.labels:
            return (self.modes[self.labels.index(text)],)
        if not self.modes:
            raise AnalysisError(
                f'{self.mechanism.name}: outputs.{self.output.name}: working mode "{text}" '
                "is not known, because this output has no working modes; leave it out"
            )
        # Texts are compared, because Python converts no text of thousands of digits.
        number = text.lstrip("0") or "0"
        numbers = [str(mode) for mode in range(len(self.modes))]
        if number in numbers:
            return (self.modes[numbers.index(number)],)
        raise AnalysisError(
            f'{self.mechanism.name}: outputs.{self.output.name}: working mode "{text}" is '
            f"not known; give one of {listing(self.labels, MAX_LISTED_MODES)}, or a number "
            f"from 0 to {len(self.modes) - 1}. A working mode has one sign for each of "
            f"these parts, in this order: {'; '.join(self.legs)}"
        )

    def inverse(
        self, poses: Floats, modes: Sequence[str], pairs: Sequence[int] = ()
    ) -> InverseRows:
        """Raise an error, because outputs of this class have no inverse kinematics.

        Subclasses override this method and return the configurations at poses. In this
        class, the error says why there is no inverse kinematics.

        Parameters
        ----------
        poses
            (n, 3) directions of the output, or (n, 3, 3) rotations.
        modes
            Labels of the working modes, such as ``+-``.
        pairs
            Numbers of the pairs whose variables are returned.

        Raises
        ------
        PlanError
            Always in this base class, since the output has no inverse kinematics.
        """
        # `with_wrist` is the first step of inverse kinematics. Outputs of this class fail
        # there, for example because of their number of inputs. The error says why.
        with_wrist(self.mechanism, self.output.name)
        raise AssertionError("this line is never reached")

    def forward(self, inputs: Floats) -> PoseSolutions:
        """Return every pose found at inputs (n, inputs) rad."""
        return self._forward.solutions(inputs)

    def turns(self, values: Floats) -> Floats:
        """Return the output's angular velocity (n, 3, inputs) per unit rate of an input.

        One input moves while the others are locked. The result is in the axes of the link
        from which the output is observed; NaN where the inputs do not determine the motion.

        Parameters
        ----------
        values
            (n, variables) pair variables of n closed configurations (rad).
        """
        return output_rates(make_motion(self._forward.solver, values), self.output)

    def type_2(self, values: Floats) -> Floats:
        """Return the transmission measure (n,) at configurations (n, variables)."""
        transmission = Transmission.from_mechanism(self.mechanism, self.output)
        return transmission.measure_configurations(self._closure, values)

    def residual(self, values: Floats) -> Floats:
        """Return the closure residuals (n,) in rad at values (n, variables)."""
        return self._closure.linearise(values).closure_residual

    @cached_property
    def _forward(self) -> ForwardKinematics:
        """Forward kinematics of the output."""
        return ForwardKinematics(self.mechanism, self.output.name)

    @cached_property
    def _closure(self) -> Closure:
        """Loop closure of the mechanism."""
        return Closure.of_mechanism(self.mechanism, make_joints(self.mechanism))


class ClosedKinematics(OutputKinematics, ABC):
    """An output whose poses are solved in closed form, without a starting configuration.

    Joint limits and the reach of the legs decide which poses the output reaches.
    """

    @property
    def carrying(self) -> Mechanism:
        """The mechanism without the wheels that drive it.

        Pose calculations need only these links. The pairs (joints) in `spans` have their
        numbers in this mechanism. If no wheels drive the output, the result is the whole
        mechanism.
        """
        return self.mechanism

    @property
    @abstractmethod
    def spans(self) -> tuple[LegSpan, ...]:
        """The reach of the legs."""

    @abstractmethod
    def at(self, poses: Floats, signs: Signs) -> ModeAtPoses:
        """Return one working mode at poses: a choice of one position for each leg."""

    def name_of(self, pair: int) -> str:
        """Return the name of a pair, or that of the output for a virtual pair."""
        pairs = self.carrying.pairs
        return pairs[pair].name if pair < len(pairs) else self.output.name

    @cached_property
    def bounds(self) -> tuple[AngleLimit, ...]:
        """The reach of the legs, and the joint limits of the mechanism."""
        return bounds_of(self, Constraints())

    def inverse(
        self, poses: Floats, modes: Sequence[str], pairs: Sequence[int] = ()
    ) -> InverseRows:
        """Return the inputs of poses in some working modes, also for poses out of reach.

        A working mode is a choice of one of two positions for each leg. The result has a
        row for each pose and mode (see `InverseRows`). Each row has:

        - the inputs, and the rates of the inputs per unit angular velocity of the output,
        - the margin: the angle (rad) to the nearest limit of the reach of a leg or of a
          joint (`bounds`), negative beyond the limit,
        - two measures, which are 0 at singularities: of type I if an input can move while
          the output rests, of type II if the output can move with locked inputs,
        - the status: regular, at a singularity, or out of reach.

        Parameters
        ----------
        poses
            (n, 3) directions of an output that is a direction, or (n, 3, 3) rotations of an
            output that is an orientation.
        modes
            Labels of the modes, such as ``+-``.
        pairs
            Numbers of the pairs whose variables are returned.
        """
        limits = tuple(bound.name for bound in self.bounds)
        signs_by_label = dict(zip(self.labels, self.modes, strict=True))
        count = len(poses)
        parts = []
        for mode in modes:
            # Quantities of poses out of reach become NaN, which is no reason for a warning.
            with np.errstate(all="ignore"):
                mode_at_poses = self.at(poses, signs_by_label[mode])
                pair_values = [mode_at_poses.angle(pair) for pair in pairs]
                margin, limiting = find_least_margin(self.bounds, mode_at_poses)
                part = InverseRows(
                    pose=np.arange(count),
                    mode=np.full(count, mode),
                    inputs=mode_at_poses.inputs,
                    # A placeholder: `with_status` computes it from margin and measures.
                    status=np.zeros(count, dtype=np.int8),
                    margin=margin,
                    limiting=limiting,
                    type_1=mode_at_poses.type_1,
                    type_2=mode_at_poses.type_2,
                    rates=mode_at_poses.rates,
                    # The empty array gives the right shape if there are no pairs.
                    values=np.column_stack([np.empty((count, 0)), *pair_values]),
                    limits=limits,
                )
            parts.append(part.with_status())
        return InverseRows.concatenate(parts)
