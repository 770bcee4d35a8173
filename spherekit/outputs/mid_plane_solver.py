"""Pointing outputs of mechanisms in the mid-plane architecture, in closed form."""

from functools import cached_property
from itertools import product

import numpy as np

from spherekit.arrays import Floats
from spherekit.geometry.vectors import cross
from spherekit.mechanism.elements import Output
from spherekit.mechanism.joint import revolute
from spherekit.mechanism.mechanism import Mechanism
from spherekit.outputs.dyad_chain import InputRates, Signs
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
            "the leg of pairs " + ", ".join(map(self.name_of, leg)) for leg in form.legs
        )

    @property
    def spans(self) -> tuple[LegSpan, ...]:
        """The range of the angle between the two outer axes of every leg.

        The outer axes are those at the base and at the output link. They mirror each other
        in the mid-plane, so the angle between them is twice the angle between one of them
        and the mid-plane. The latter is at most the reach of the leg. It can be 0, if the
        axis is in the mid-plane and both links of the leg lie over each other.
        """
        plane = self.form.plane
        # A user may give a width of the links. Links of some width cannot lie over each
        # other, so it increases the smallest angle. Chen et al. (2021, section 3) state
        # such a width for the driven legs only.
        longest = (2.0 * plane.reach).tolist()
        return tuple(
            LegSpan(
                first_pair=base,
                second_pair=tip,
                shortest=0.0,
                longest=longest[number],
                is_limited_by_width=number in plane.driven,
            )
            for number, (base, _, tip) in enumerate(self.form.legs)
        )

    def at(self, poses: Floats, signs: Signs) -> ModeAtPoses:
        """Return one working mode (way to assemble the legs) at poses.

        Parameters
        ----------
        poses
            (n, 3) directions of the output in the axes of the base.
        signs
            The sign of each leg, 1 or -1, for its two possible elbows. An elbow is the axis
            between the two links of a leg.
        """
        return _MidPlaneMode(self, directions=poses @ self.form.frame, signs=signs)

    def forward(self, inputs: Floats) -> PoseSolutions:
        """Return the poses at inputs (n, 2) rad, once for each mode of the other legs.

        Base and output link mirror each other in the mid-plane. An elbow is the axis
        between the two links of a leg, and all elbows lie in this plane. The inputs
        determine the elbows of both driven legs, and thereby the mid-plane. There is no
        pose if both elbows are parallel.

        A mode has a sign for each leg: that of n . (base axis x elbow) with the normal n of
        the mid-plane. The inputs determine the signs of the driven legs, and all signs of
        the other legs are possible. A mid-plane has two opposite normals, and the signs are
        reversed with n. Here n points from the home direction m (a constant direction of
        the base) to its mirror image, the direction of the output. So n . m < 0.
        """
        form = self.form  # the mid-plane architecture of the mechanism
        plane = form.plane
        # `plane` returns normals with n_z >= 0, and the signs of the driven legs for these
        # normals. If n . m > 0, the normal and the signs are multiplied by -1.
        # If n . m = 0, m is in the mid-plane and is its own mirror image. The vector from m
        # to its image, which gives the normal, is then 0. Signs multiplied by 0 fit no
        # mode, so these inputs get no pose.
        upward_normals = plane.normals(inputs)
        sense = -np.sign(upward_normals @ form.home)[:, None]
        normals = sense * upward_normals
        driven_signs = sense * plane.modes(inputs)
        # Combinations of a row of inputs with a mode whose driven legs have the signs of
        # the row.
        modes = np.array(self.modes)
        is_mode = driven_signs[:, None] == modes[:, plane.driven]
        row, mode = np.nonzero(np.all(is_mode, axis=2))
        # The residuals are zero up to rounding in every mechanism with this architecture,
        # which was tested before.
        values, _residuals = form.values(form.place(normals[row], modes[mode]))
        is_closed = np.isfinite(values).all(axis=1)
        row = row[is_closed]
        mode = mode[is_closed]
        orientations = form.orientations(normals[row])
        # `complete` is whether all configurations were found. The closed form gives all.
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

    def cosine(self, first_pair: int, second_pair: int) -> Floats:
        """Return the cosine (n,) of the angle between the axes of two pairs."""
        elbows, _products = self._elbows
        first_axis = self.form.axis(first_pair, self.normals, elbows)
        second_axis = self.form.axis(second_pair, self.normals, elbows)
        return np.broadcast_to(np.vecdot(first_axis, second_axis), len(self.directions))

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
        elbows, _products = self._elbows
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

        Rates are (rows, inputs, 3), measures (rows, inputs). Base and output mirror each
        other in the mid-plane, whose normal is n. The elbow, the axis between the two links
        of a driven leg, is in this plane, because both links have the same arc. Let p be
        the direction of the output, and m its home direction, whose mirror image is p. For
        the angular velocity w of the output, the rate of the input is numerator . w over
        denominator, with

            numerator = elbow x p,   denominator = n . (base axis x elbow) ``|p - m|``.

        It follows from the derivative of elbow . n = 0:

            elbow' . n + elbow . n' = 0

        - elbow' is the rate of the input times (base axis x elbow).
        - n = (p - m) / ``|p - m|``, with p' = w x p and constant m. The derivative of the
          length only changes n along itself, at right angles to the elbow. So
          elbow . n' = elbow . (w x p) / ``|p - m|`` = -(elbow x p) . w / ``|p - m|``.

        `InputRates` computes these quotients. It also returns the measure of type I: the
        size of the denominator over the length of the numerator. If it is 0, the input can
        move while the output rests. There are two such cases. The leg is at the limit of
        its reach: n, base axis and elbow are in one plane. Or the output points in its home
        direction: p = m.
        """
        # The triple products are n . (base axis x elbow).
        elbows, triple_products = self._elbows
        numerators = cross(elbows[:, self.driven], self.directions[:, None])
        # Elbows and directions are in mirror axes: x halves the angle between the base axes
        # of the two driven legs, and z is normal to both. The result is rotated to the axes
        # of the base. Denominators are scalars and need no rotation. The sense of a pair is
        # -1.0 if its variable decreases while the elbow turns about the base axis in the
        # positive sense.
        senses = self.form.plane.senses[self.driven]
        numerators = (numerators @ self.form.frame.T) * senses[:, None]
        denominators = triple_products[:, self.driven] * self.home_distance[:, None]
        fractions = InputRates(numerators, denominators)
        return fractions.rates, fractions.type_1

    @property
    def type_1_square(self) -> Floats:
        """(n, inputs) squares of `type_1`, continued out of reach with negative values."""
        # Out of reach the foot half-way between both elbows takes the place of the elbow,
        # and the square of the triple product is negative.
        square = self.type_1**2
        feet = self.form.plane.elbow_feet(self.normals)
        across = cross(self.directions[:, None], feet.foot[:, self.driven])
        continuation = feet.triple_product_square[:, self.driven] / np.vecdot(
            across, across
        )
        continuation = np.fmin(continuation * (self.home_distance**2)[:, None], 0.0)
        return np.where(np.isnan(square), continuation, square)

    @property
    def type_2(self) -> Floats:
        """(n,) measure of type II, 0 where the output can move with locked inputs."""
        elbows, _products = self._elbows
        return self.form.transmission(self.normals, elbows)

    @cached_property
    def _elbows(self) -> tuple[Floats, Floats]:
        """Elbows (n, legs, 3), and n . (base axis x elbow) (n, legs).

        An elbow is the axis between the two links of a leg, as a unit vector, and n is the
        normal of the mid-plane.
        """
        return self.form.plane.elbows(self.normals, self.signs)
