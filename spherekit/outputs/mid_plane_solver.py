"""Pointing outputs of mechanisms in the mid-plane architecture, in closed form."""

from functools import cached_property
from itertools import product

import numpy as np

from spherekit.arrays import Floats
from spherekit.geometry.vectors import cross
from spherekit.mechanism.elements import Output
from spherekit.mechanism.joint import revolute
from spherekit.mechanism.mechanism import Mechanism
from spherekit.outputs.dyad_chain import Signs, input_rates
from spherekit.outputs.forward_kinematics import PoseSolutions
from spherekit.outputs.mid_plane_architecture import MidPlaneArchitecture
from spherekit.outputs.output_kinematics import ClosedKinematics
from spherekit.outputs.pose_constraints import LegSpan, ModeAtPoses
from spherekit.positions.pair_states import measure_pair_angles


class MidPlaneKinematics(ClosedKinematics):
    """A pointing output of a mechanism in its mid-plane symmetric architecture.

    Base and output link mirror each other in the mid-plane, so the direction p of the
    output is the mirror image of a constant direction m of the base, the home direction.
    The normal n of the mid-plane points from m to p. The mode of a leg is the sign of
    n . (base axis x elbow), where the elbow is the axis between its two links. If p is m
    itself, every plane through m is possible, and nothing is determined.

    Parameters
    ----------
    mechanism
        The mechanism.
    output
        Its output, with a direction.
    form
        The mid-plane architecture of this output.
    """

    form: MidPlaneArchitecture
    solved_by = "mid-plane"

    def __init__(
        self, mechanism: Mechanism, output: Output, form: MidPlaneArchitecture
    ) -> None:
        """Keep the architecture, and name each leg by its three pairs."""
        assert output.direction is not None
        super().__init__(mechanism, output, points=True)
        self.form = form
        self.modes = tuple(product((1, -1), repeat=len(form.legs)))
        self.legs = tuple(
            "leg of " + ", ".join(map(self.name_of, leg)) for leg in form.legs
        )

    @property
    def spans(self) -> tuple[LegSpan, ...]:
        """The range of the angle between the two outer axes of every leg.

        The outer axes are those at the base and at the output link. They mirror each other
        in the mid-plane, so the angle between them is at most twice the largest distance
        from the mid-plane (the reach of the leg).
        """
        plane = self.form.plane
        longest = (2.0 * plane.reach).tolist()
        return tuple(
            LegSpan(
                first_pair=base,
                second_pair=tip,
                shortest=0.0,
                longest=longest[number],
                can_fold=number in plane.driven,
            )
            for number, (base, _, tip) in enumerate(self.form.legs)
        )

    def at(self, poses: Floats, signs: Signs) -> ModeAtPoses:
        """Return one assembly mode at poses.

        Parameters
        ----------
        poses
            (n, 3) directions of the output in the axes of the base.
        signs
            The sign of each leg, 1 or -1, for its two possible elbows.
        """
        return _MidPlaneMode(self, directions=poses @ self.form.frame, signs=signs)

    def forward(self, inputs: Floats) -> PoseSolutions:
        """Return the poses at inputs (n, 2) rad, once for each mode of the other legs.

        The inputs determine the elbows of both driven legs, and thereby the mid-plane and
        the signs of these legs. The signs of all other legs are free. There is no pose if
        both elbows lie on one line.
        """
        form = self.form
        plane = form.plane
        upward_normals = plane.normals(inputs)
        # The normals of this class point away from the home direction m.
        sense = -np.sign(upward_normals @ form.home)[:, None]
        normals = sense * upward_normals
        driven_signs = sense * plane.modes(inputs)
        # Combinations of a row of inputs with a mode whose driven legs have the signs of
        # the row.
        modes = np.array(self.modes)
        is_mode = driven_signs[:, None] == modes[:, plane.driven]
        row, mode = np.nonzero(np.all(is_mode, axis=2))
        values, _residuals = form.values(form.place(normals[row], modes[mode]))
        is_closed = np.isfinite(values).all(axis=1)
        row = row[is_closed]
        mode = mode[is_closed]
        orientations = form.orientations(normals[row])
        return PoseSolutions(
            row=row,
            inputs=inputs[row],
            values=values[is_closed],
            rotations=orientations,
            directions=orientations @ np.array(self.output.direction),
            signs=tuple(self.modes[number] for number in mode),
            complete=np.ones(len(inputs), dtype=bool),
        )


class _MidPlaneMode:
    """One working mode of a mid-plane architecture, at n directions (a `ModeAtPoses`).

    Parameters
    ----------
    kinematics
        The closed form of the output.
    directions
        (n, 3) directions of the output in mirror axes.
    signs
        The sign of each leg.
    """

    def __init__(
        self, kinematics: MidPlaneKinematics, directions: Floats, signs: Signs
    ) -> None:
        """Compute the normals of the mid-planes; all else is computed when it is read."""
        self.form = kinematics.form
        self.signs = signs
        self.directions = directions
        self.driven = kinematics.form.plane.driven
        self.normals, self.home_distance = self.form.normals_to(directions)

    def cosine(self, one: int, other: int) -> Floats:
        """Return the cosine (n,) of the angle between the axes of two pairs."""
        elbows, _heights = self._elbows
        one_axis = self.form.axis(one, self.normals, elbows)
        other_axis = self.form.axis(other, self.normals, elbows)
        return np.broadcast_to(np.vecdot(one_axis, other_axis), len(self.directions))

    def angle(self, pair: int) -> Floats:
        """Return the variable (n,) of a pair in (-pi, pi] rad."""
        ends = self.form.mechanism.ends[pair]
        joint = revolute(self.form.joints[pair])
        link_rotations = self.form.place(self.normals, self.signs, links=ends)
        values, _ = measure_pair_angles([ends], [joint], link_rotations)
        return values[:, 0]

    @property
    def inputs(self) -> Floats:
        """(n, inputs) rad in (-pi, pi], NaN out of reach."""
        elbows, _heights = self._elbows
        return self.form.plane.readings(elbows)[:, self.driven]

    @property
    def type_1(self) -> Floats:
        """(n, inputs) measures of type I, see `Inverse`."""
        _, type_1 = self._rates_and_type_1
        return type_1

    @property
    def rates(self) -> Floats:
        """(n, inputs, 3) rates of the inputs per unit angular velocity of the output."""
        rates, _ = self._rates_and_type_1
        return rates

    @cached_property
    def _rates_and_type_1(self) -> tuple[Floats, Floats]:
        """Rates of the inputs per unit angular velocity of the output, and type I measures.

        Rates are (n, inputs, 3), measures (n, inputs). With the normal n of the mid-plane,
        a rate is the vector elbow x direction divided by
        n . (base axis x elbow) |direction - home|. The divisor is 0 if a leg is at the
        limit of its reach, or if the output points in its home direction; the measure of
        type I is then 0, too.
        """
        elbows, elbow_height = self._elbows
        normals = cross(elbows[:, self.driven], self.directions[:, None])
        senses = self.form.plane.senses[self.driven]
        numerators = (normals @ self.form.frame.T) * senses[:, None]
        denominators = elbow_height[:, self.driven] * self.home_distance[:, None]
        return input_rates(numerators, denominators)

    @property
    def type_1_square(self) -> Floats:
        """(n, inputs) squares of `type_1`, continued out of reach with negative values."""
        # Out of reach the foot half-way between both elbows takes the place of the elbow,
        # and the square of the height is negative.
        square = self.type_1**2
        feet = self.form.plane.elbow_feet(self.normals)
        across = cross(self.directions[:, None], feet.foot[:, self.driven])
        continuation = feet.height_square[:, self.driven] / np.vecdot(across, across)
        continuation = np.fmin(continuation * (self.home_distance**2)[:, None], 0.0)
        return np.where(np.isnan(square), continuation, square)

    @property
    def type_2(self) -> Floats:
        """(n,) measure of type II, 0 where the output can move with locked inputs."""
        elbows, _heights = self._elbows
        return self.form.transmission(self.normals, elbows)

    @cached_property
    def _elbows(self) -> tuple[Floats, Floats]:
        """Elbows (n, legs, 3), and n . (base axis x elbow) (n, legs)."""
        return self.form.plane.elbows(self.normals, self.signs)
