"""Pointing outputs of mechanisms in the mid-plane architecture, in closed form."""

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from spherekit.arrays import Floats, Indices
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


@dataclass(frozen=True)
class InputMidPlanes:
    """The mid-planes of a mechanism at n values of its inputs.

    Base and output link mirror each other in the mid-plane. The direction of the output is
    the mirror image of a constant direction of the base, the home direction.

    Attributes
    ----------
    normals
        (n, 3) unit normals that point from the home direction to the direction of the
        output. They are in mirror axes (a second set of axes fixed to the base). NaN where
        the inputs determine no mid-plane.
    driven_signs
        (n, 2) sign of each of the two driven legs, 1.0 or -1.0. A leg has two links, and
        its elbow is the axis between them. The sign tells which of two possible elbows the
        leg has. It is the sign of normal . (base axis x elbow). It is 0.0 if the output
        points in its home direction, because the sense of the normal is then undetermined.
    """

    normals: Floats
    driven_signs: Floats


class MidPlaneKinematics(ClosedKinematics):
    """A pointing output of a mechanism in its mid-plane symmetric architecture.

    Base and output link mirror each other in the mid-plane. The direction p of the output
    is therefore the mirror image of a constant direction m of the base, the home direction.
    The normal n of the mid-plane points from m to p. A leg has two links, and its elbow is
    the axis between them. The mode of a leg is the sign of n . (base axis x elbow). If p
    equals m, every plane through m is possible, so the pose does not determine the links.

    Parameters
    ----------
    mechanism
        The mechanism.
    output
        The output of the mechanism, with a direction.
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

        The outer axes are the axes at the base and at the output link. The outer axes
        mirror each other in the mid-plane, a plane through the centre. The angle between
        the outer axes is therefore twice the angle between one of them and this plane. The
        angle is 0 if the leg is folded, with its links over each other.
        """
        # `plane.reach` is the largest angle of each leg between its axis and the mid-plane.
        plane = self.form.plane
        longest = (2.0 * plane.reach).tolist()
        # `shortest` is the smallest angle for links without width. If the user states a
        # width, the caller increases it for legs with `is_limited_by_width`, whose links
        # cannot lie over each other. Chen et al. (2021, section 3) apply the width to the
        # driven legs only.
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
        """Return the poses at inputs (n, 2) rad (forward kinematics).

        Base and output link mirror each other in the mid-plane, which contains the elbows
        of all legs (the axes between the two links of each leg). The inputs determine the
        elbows of both driven legs, and thereby the mid-plane. The elbow of each other leg
        can have two positions. The same pose is returned once for each choice of these
        positions. No pose is returned at an input if

        - both driven elbows are parallel, so that they determine no mid-plane,
        - the output points in its home direction, so that the signs of the legs are not
          determined (see `InputMidPlanes`), or
        - another leg does not reach the mid-plane.

        The loops can also close with an output that is no mirror image of the base, or with
        other positions of the links that hold the elbows. These configurations are not
        searched. So `complete` is false at all inputs: configurations may be missing.
        """
        form = self.form  # the mid-plane architecture of the mechanism
        mid_planes = self._find_mid_planes(inputs)
        row, mode = self._list_modes(mid_planes)
        # A mode has a sign, 1 or -1, for each leg, which chooses the position of its elbow.
        signs = np.array(self.modes)[mode]
        # The residuals are not needed: in this architecture the loops close whenever each
        # leg reaches the mid-plane. If a leg does not reach it, values are NaN.
        values, _residuals = form.values(form.place(mid_planes.normals[row], signs))
        is_closed = np.isfinite(values).all(axis=1)
        row = row[is_closed]
        mode = mode[is_closed]
        orientations = form.orientations(mid_planes.normals[row])
        return PoseSolutions(
            row=row,
            inputs=inputs[row],
            values=values[is_closed],
            rotations=orientations,
            directions=orientations @ np.array(self.output.direction),
            signs=tuple(self.modes[number] for number in mode),
            complete=np.zeros(len(inputs), dtype=bool),
        )

    def _find_mid_planes(self, inputs: Floats) -> InputMidPlanes:
        """Return the mid-planes at inputs (n, 2) rad, with the signs of the driven legs."""
        plane = self.form.plane
        # These normals have n_z >= 0. The sign of a leg is the sign of n . (base axis x
        # elbow), and is reversed together with the normal.
        upward_normals = plane.normals(inputs)
        upward_signs = plane.modes(inputs)
        # The sense, 1.0 or -1.0, makes the normal point away from the home direction. If
        # the home direction is in the mid-plane, the sense of the normal is not determined.
        # The sense is then 0.0, and signs of 0 fit no mode.
        sense = -np.sign(upward_normals @ self.form.home)[:, None]
        return InputMidPlanes(
            normals=sense * upward_normals, driven_signs=sense * upward_signs
        )

    def _list_modes(self, mid_planes: InputMidPlanes) -> tuple[Indices, Indices]:
        """Return the combinations of a mid-plane and an assembly mode possible there.

        A mode has a sign for each leg, which chooses one of two possible positions of its
        elbow (the axis between its two links). The inputs determine the signs of the driven
        legs. The signs of the other legs are free. The caller places the links for each
        combination.

        Parameters
        ----------
        mid_planes
            The mid-planes at some inputs, in which base and output link mirror each other.

        Returns
        -------
        row, mode
            For each of k combinations, the index of the mid-plane and the index of the mode
            in `modes`.
        """
        driven_signs_of_modes = np.array(self.modes)[:, self.form.plane.driven]
        # Axes: mid-plane, mode, driven leg.
        is_equal = mid_planes.driven_signs[:, None] == driven_signs_of_modes
        row, mode = np.nonzero(np.all(is_equal, axis=2))
        return row, mode


class _MidPlaneMode:
    """One working mode of a mid-plane architecture, at n directions (a `ModeAtPoses`).

    Parameters
    ----------
    kinematics
        The closed form of the output.
    directions
        (n, 3) directions of the output in mirror axes.
    signs
        The sign of each leg, 1 or -1, for its two possible positions.
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
        return self._input_rates.type_1

    @property
    def rates(self) -> Floats:
        """(n, inputs, 3) rates of the inputs per unit angular velocity of the output."""
        return self._input_rates.rates

    @cached_property
    def _input_rates(self) -> InputRates:
        """Rates of the inputs for any angular velocity of the output, in axes of the base.

        The elbow e is the axis between the two links of a driven leg. It is in the
        mid-plane with the normal n, in which base and output link mirror each other. The
        time derivative of e . n = 0 is

            e' . n + e . n' = 0.

        The input rotates the elbow about the base axis, so e' is the rate of the input
        times (base axis x e). The direction p of the output is the mirror image of a
        constant direction m of the base (home direction), so n = (p - m) / ``|p - m|``. For
        the angular velocity w of the output, p' = w x p. A change of ``|p - m|`` changes n'
        along n only, and e is at right angles to n. Therefore

            e . n' = e . (w x p) / ``|p - m|`` = -(e x p) . w / ``|p - m|``,
            rate = (e x p) . w / (n . (base axis x e) ``|p - m|``).

        The denominator is 0 at a singularity of type I, where the input can move while the
        output rests. The leg is then at the limit of its reach, or the output points in its
        home direction.
        """
        driven = self.driven
        # The triple products are n . (base axis x elbow).
        elbows, triple_products = self._elbows
        numerators = cross(elbows[:, driven], self.directions[:, None])
        denominators = triple_products[:, driven] * self.home_distance[:, None]
        # The elbows and directions are in mirror axes, a second set of axes fixed to the
        # base. The matrix `frame` converts vectors to the axes of the base.
        numerators_in_base = numerators @ self.form.frame.T
        # The variable of a pair can be counted against the rotation of the elbow. The sense
        # is then -1.0.
        senses = self.form.plane.senses[driven]
        return InputRates(numerators_in_base * senses[:, None], denominators)

    @property
    def type_1_square(self) -> Floats:
        """(n, inputs) squares of `type_1`, continued out of reach with negative values."""
        # Out of reach the foot half-way between both elbows takes the place of the elbow,
        # and the square of the triple product is negative.
        square = self.type_1**2
        feet = self.form.plane.elbow_feet(self.normals)
        across = cross(self.directions[:, None], feet.foot[:, self.driven])
        with np.errstate(all="ignore"):
            # The divisor is 0 if the output points along a foot.
            continuation = feet.triple_product_square[:, self.driven] / np.vecdot(
                across, across
            )
            continuation = np.fmin(continuation * (self.home_distance**2)[:, None], 0.0)
        return np.where(np.isnan(square), continuation, square)

    @property
    def type_2(self) -> Floats:
        """(n,) transmission measure, 0 where the output can move with locked inputs."""
        elbows, _products = self._elbows
        return self.form.transmission(self.normals, elbows)

    @cached_property
    def _elbows(self) -> tuple[Floats, Floats]:
        """Elbows (n, legs, 3), and the products n . (base axis x elbow) (n, legs).

        An elbow is the axis between the two links of a leg, as a unit vector. n is the
        normal of the mid-plane, in which all elbows lie. The product is 0 where the leg is
        at the limit of its reach.
        """
        return self.form.plane.elbows(self.normals, self.signs)
