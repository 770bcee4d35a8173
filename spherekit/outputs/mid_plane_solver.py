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
from spherekit.outputs.pose_constraints import ClosedKinematics, Rows, Span
from spherekit.positions.pair_states import measure_pair_angles


class MidPlaneKinematics(ClosedKinematics):
    """A pointing output of a mechanism in its mid-plane symmetric architecture.

    The mid-plane of a direction p is the one that mirrors m, where the output would point
    with the end effector laid upon its image, to p; its normal n points from m to p. The
    mode of a leg is the sign of n . (base axis x elbow). In the direction m itself every
    plane through m serves, and nothing is determined.
    """

    form: MidPlaneArchitecture
    solved_by = "mid-plane"

    def __init__(
        self, mechanism: Mechanism, output: Output, form: MidPlaneArchitecture
    ) -> None:
        assert output.direction is not None
        super().__init__(mechanism, output, points=True)
        self.form = form
        self.modes = tuple(product((1, -1), repeat=len(form.legs)))
        self.legs = tuple(
            "leg of " + ", ".join(map(self.name_of, leg)) for leg in form.legs
        )

    @property
    def spans(self) -> tuple[Span, ...]:
        """What limits the reach: the axes of every leg at base and end effector."""
        plane = self.form.plane
        most = (2.0 * plane.reach).tolist()
        return tuple(
            (base, tip, 0.0, most[k], k in plane.driven)
            for k, (base, _, tip) in enumerate(self.form.legs)
        )

    def at(self, poses: Floats, signs: Signs) -> Rows:
        """Return one mode at directions (n, 3)."""
        return _MidPlaneRows(self, poses @ self.form.frame, signs)

    def forward(self, inputs: Floats) -> PoseSolutions:
        """Return the pose at driven readings (n, 2) rad, the other legs in each mode.

        None where the driven elbows lie on one line.
        """
        form, plane = self.form, self.form.plane
        upward = plane.normals(inputs)
        away = -np.sign(upward @ form.home)[:, None]  # from the image of the output
        normals, driven_modes = away * upward, away * plane.modes(inputs)
        every = np.array(self.modes)
        same = driven_modes[:, None] == every[:, plane.driven]
        row, mode = np.nonzero(np.all(same, axis=2))
        values, _ = form.values(form.place(normals[row], every[mode]))
        closed = np.isfinite(values).all(axis=1)
        row, mode, values = row[closed], mode[closed], values[closed]
        turned = form.orientations(normals[row])
        return PoseSolutions(
            row,
            inputs[row],
            values,
            turned,
            turned @ np.array(self.output.direction),
            tuple(self.modes[number] for number in mode),
            np.ones(len(inputs), dtype=bool),
        )


class _MidPlaneRows:
    def __init__(self, owner: MidPlaneKinematics, points: Floats, signs: Signs) -> None:
        self.form, self.signs, self.points = owner.form, signs, points
        self.driven = owner.form.plane.driven
        self.normals, self.distance = self.form.normals_to(points)

    def cosine(self, one: int, other: int) -> Floats:
        elbows = self._elbows[0]
        axes = (self.form.axis(pair, self.normals, elbows) for pair in (one, other))
        return np.broadcast_to(np.vecdot(*axes), len(self.points))

    def angle(self, pair: int) -> Floats:
        ends, joint = self.form.mechanism.ends[pair], revolute(self.form.joints[pair])
        placed = self.form.place(self.normals, self.signs, links=ends)
        return measure_pair_angles([ends], [joint], placed)[0][:, 0]

    @property
    def inputs(self) -> Floats:
        return self.form.plane.readings(self._elbows[0])[:, self.driven]

    @property
    def type_1(self) -> Floats:
        return self._moved[1]

    @property
    def rates(self) -> Floats:
        return self._moved[0]

    @cached_property
    def _moved(self) -> tuple[Floats, Floats]:
        elbows, root = self._elbows
        across = cross(elbows[:, self.driven], self.points[:, None]) @ self.form.frame.T
        senses = self.form.plane.senses[self.driven]
        bottoms = root[:, self.driven] * self.distance[:, None]
        return input_rates(across * senses[:, None], bottoms)

    @property
    def type_1_square(self) -> Floats:
        square = self.type_1**2
        flat, _, left = self.form.plane.nearest_elbows(self.normals)
        across = cross(self.points[:, None], flat[:, self.driven])
        beyond = left[:, self.driven] / np.vecdot(across, across)
        beyond = np.fmin(beyond * (self.distance**2)[:, None], 0.0)
        return np.where(np.isnan(square), beyond, square)

    @property
    def type_2(self) -> Floats:
        return self.form.transmission(self.normals, self._elbows[0])

    @cached_property
    def _elbows(self) -> tuple[Floats, Floats]:
        return self.form.plane.elbows(self.normals, self.signs)
