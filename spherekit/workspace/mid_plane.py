"""Pointing outputs of mechanisms in the mid-plane architecture, in closed form."""

from functools import cached_property
from itertools import product
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.guidance.mid_plane_architecture import MidPlaneArchitecture
from spherekit.model.joints import revolute
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import Output
from spherekit.motion.pairs import turns_of
from spherekit.output.dyads import DyadArcs, Signs
from spherekit.output.measures import InputRates
from spherekit.output.solutions import PoseSolutions
from spherekit.sphere.rotation import Floats, cross
from spherekit.workspace.kinematics import ClosedKinematics
from spherekit.workspace.rows import Rows, Span


@final
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
            "leg of " + ", ".join(map(self.name_of, (leg.base, leg.elbow, leg.tip)))
            for leg in form.legs
        )

    @property
    def spans(self) -> tuple[Span, ...]:
        """What limits the reach: the axes of every leg at base and end effector."""
        plane = self.form.plane
        return tuple(
            Span(
                leg.base, leg.tip, DyadArcs(float(arc), float(arc)), number in plane.driven
            )
            for number, (leg, arc) in enumerate(
                zip(self.form.legs, plane.arcs, strict=True)
            )
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
        parts: list[tuple[NDArray[np.intp], Floats, list[Signs]]] = []
        for signs in self.modes:
            same = np.all(driven_modes == np.array(signs)[list(plane.driven)], axis=1)
            row = np.flatnonzero(same)
            values, _ = form.values(form.place(normals[row], signs))
            closed = np.isfinite(values).all(axis=1)
            row, values = row[closed], values[closed]
            parts.append((row, values, [signs] * len(row)))
        rows = np.concatenate([row for row, _, _ in parts])
        order = np.argsort(rows, kind="stable")
        values = np.concatenate([values for _, values, _ in parts])[order]
        labels = [signs for _, _, listed in parts for signs in listed]
        turned = form.orientations(normals[rows[order]])
        return PoseSolutions(
            rows[order],
            inputs[rows[order]],
            values,
            turned,
            turned @ np.array(self.output.direction),
            tuple(labels[k] for k in order),
            np.ones(len(inputs), dtype=bool),
        )


@final
class _MidPlaneRows:
    def __init__(self, owner: MidPlaneKinematics, points: Floats, signs: Signs) -> None:
        self.form, self.signs, self.points = owner.form, signs, points
        self.driven = list(owner.form.plane.driven)
        self.normals, self.distance = self.form.normals_to(points)

    def cosine(self, one: int, other: int) -> Floats:
        ends = [self._axis(pair) for pair in (one, other)]
        dots = np.sum(ends[0] * ends[1], axis=1)
        return np.broadcast_to(dots, len(self.points))

    def angle(self, pair: int) -> Floats:
        for k, leg in enumerate(self.form.legs):
            if pair == leg.base:
                return self.form.plane.readings(self._elbows[0])[:, k]
        ends, joint = self.form.mechanism.ends[pair], revolute(self.form.joints[pair])
        placed = self.form.place(self.normals, self.signs, links=ends)
        return turns_of([ends], [joint], placed)[0][:, 0]

    @property
    def inputs(self) -> Floats:
        return self.form.plane.readings(self._elbows[0])[:, self.driven]

    @property
    def type_1(self) -> Floats:
        return self._moved.type_1

    @property
    def rates(self) -> Floats:
        return self._moved.rates

    @cached_property
    def _moved(self) -> InputRates:
        elbows, root = self._elbows
        across = cross(elbows[:, self.driven], self.points[:, None]) @ self.form.frame.T
        senses = self.form.plane.senses[self.driven]
        bottoms = root[:, self.driven] * self.distance[:, None]
        return InputRates(across * senses[:, None], bottoms)

    @property
    def type_1_square(self) -> Floats:
        square = self.type_1**2
        flat, left = self.form.plane.nearest_elbows(self.normals)
        across = cross(self.points[:, None], flat[:, self.driven])
        beyond = left[:, self.driven] / np.sum(across * across, axis=2)
        beyond = np.fmin(beyond * (self.distance**2)[:, None], 0.0)
        return np.where(np.isnan(square), beyond, square)

    @property
    def type_2(self) -> Floats:
        return self.form.transmission(self.normals, self._elbows[0])

    @cached_property
    def _elbows(self) -> tuple[Floats, Floats]:
        return self.form.plane.elbows(self.normals, self.signs)

    def _axis(self, pair: int) -> Floats:
        """Return the axis (n or 1, 3) of a pair in mirror axes."""
        return self.form.axis(pair, self.normals, self._elbows[0])
