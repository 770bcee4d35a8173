"""An output at given poses in a working mode, whichever closed form the mechanism has.

Two closed forms serve every pose without a start: dyads on the held output, and the
mid-plane form. A `Rows` says what constraints may be put on.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, final

import numpy as np
from numpy.typing import NDArray

from spherekit.errors import AnalysisError, ModelError
from spherekit.guidance.form import MidPlaneForm, axis_in
from spherekit.guidance.symmetry import mid_plane_form
from spherekit.model.geometry import COLLINEAR
from spherekit.model.joints import revolute
from spherekit.model.mechanism import Mechanism, Output
from spherekit.motion.pairs import turns_of
from spherekit.output.dyads import Cones, Signs
from spherekit.output.forward import ForwardKinematics
from spherekit.output.inverse import InverseKinematics
from spherekit.output.posed import Posed
from spherekit.output.solutions import Solutions
from spherekit.sphere.rotation import Floats, cross


class Rows(Protocol):
    """A mechanism at n poses of its output, in one working mode.

    Everything is NaN where it is not determined; what limits the reach is not.
    """

    def cosine(self, one: int, other: int) -> Floats:
        """Return the cosine (n,) of the angle between the axes of two pairs."""

    def angle(self, pair: int) -> Floats:
        """Return the variable (n,) of a pair in (-pi, pi] rad."""

    @property
    def inputs(self) -> Floats:
        """(n, inputs) rad in (-pi, pi]."""

    @property
    def type_1(self) -> Floats:
        """(n, inputs) measures of type I, see `Inverse`."""

    @property
    def type_1_square(self) -> Floats:
        """(n, inputs) its squares, continued smoothly where a leg does not reach.

        There they are negative.
        """

    @property
    def type_2(self) -> Floats:
        """(n,) measure of type II, see `Inverse`."""

    @property
    def rates(self) -> Floats:
        """(n, inputs, 3) rates of the inputs per unit angular velocity of the output.

        In axes of the link that the output is seen from; for a pointing output of the part
        at right angles to its direction.
        """


@final
@dataclass(frozen=True)
class Span:
    """Two pairs whose axes a leg joins, and between what angles (rad) it does.

    `folds` says that the leg's two links can lie over each other there.
    """

    one: int
    other: int
    cones: Cones
    folds: bool


class OutputKinematics(ABC):
    """The poses of one declared output, in every working mode."""

    mechanism: Mechanism
    output: Output

    @property
    @abstractmethod
    def points(self) -> bool:
        """Whether poses are directions (n, 3), else rotations (n, 3, 3)."""

    @property
    @abstractmethod
    def modes(self) -> tuple[Signs, ...]:
        """The signs of all working modes."""

    @property
    @abstractmethod
    def legs(self) -> tuple[str, ...]:
        """What each sign belongs to."""

    @property
    @abstractmethod
    def spans(self) -> tuple[Span, ...]:
        """What limits the reach."""

    @abstractmethod
    def at(self, poses: Floats, signs: Signs) -> Rows:
        """Return one mode at poses."""

    @abstractmethod
    def forward(self, inputs: Floats) -> Solutions:
        """Return all poses at inputs (n, inputs) rad."""

    def name_of(self, pair: int) -> str:
        """Return the name of a pair, or that of the output for a pair made for it."""
        pairs = self.mechanism.pairs
        return pairs[pair].name if pair < len(pairs) else self.output.name


def label_of(signs: Signs) -> str:
    """Return the signs of a mode as text, ``+-+``, with ``~`` for groups without one."""
    return "".join("~+-"[sign] for sign in signs)


def kinematics_of(mechanism: Mechanism, output: str | None = None) -> OutputKinematics:
    """Return the closed form of an output.

    Raises
    ------
    PlanError
        If the output is unknown or cannot take every pose.
    AnalysisError
        If there is no closed form that needs no start.
    """
    return closed_form_of(InverseKinematics(mechanism, output))


def closed_form_of(kinematics: InverseKinematics) -> OutputKinematics:
    """Return the closed form of an output, see `kinematics_of`."""
    mechanism, output = kinematics.own, kinematics.wrist.output.name
    if kinematics.has_closed_form:
        return DyadKinematics(kinematics)
    try:
        form = mid_plane_form(mechanism, output)
    except ModelError as problem:
        raise AnalysisError(
            f"{mechanism.name}: outputs.{kinematics.wrist.output.name}: the poses of a "
            "working mode have no closed form that needs no start. With the output held "
            f"these groups are left: {'; '.join(kinematics.legs)}; dyads on the output "
            f"alone would do. And {problem}"
        ) from None
    return MidPlaneKinematics(mechanism, kinematics.wrist.output, form)


@final
class DyadKinematics(OutputKinematics):
    """An output whose mechanism falls into dyads when it is held."""

    def __init__(self, kinematics: InverseKinematics) -> None:
        self.kinematics = kinematics
        self.mechanism = kinematics.own
        self.output = kinematics.wrist.output
        self._own = {pair: self._same_axis(pair) for pair in kinematics.wrist.pairs}

    def _same_axis(self, made: int) -> int:
        """Return the mechanism's own pair with the axis of one made for the output."""
        mechanism, joints = self.kinematics.mechanism, self.kinematics.solver.joints
        link = self.kinematics.wrist.link
        if link in mechanism.ends[made]:
            axis = axis_in(mechanism, joints, made, link)
            for pair, ends in enumerate(self.mechanism.ends):
                if link in ends:
                    gap = axis_in(mechanism, joints, pair, link) - axis
                    if np.linalg.norm(gap) < COLLINEAR:
                        return pair
        return made

    @property
    def points(self) -> bool:
        """Whether poses are directions (n, 3), else rotations (n, 3, 3)."""
        return self.kinematics.wrist.points

    @property
    def modes(self) -> tuple[Signs, ...]:
        """The signs of all working modes."""
        return self.kinematics.modes

    @property
    def legs(self) -> tuple[str, ...]:
        """What each sign belongs to."""
        return tuple(
            "leg of "
            + ", ".join(
                self.name_of(self._own.get(pair, pair))
                for pair in (s.near, s.middle, s.far)
            )
            for s in self.kinematics.stands
        )

    @property
    def spans(self) -> tuple[Span, ...]:
        """What limits the reach: the outer axes of every dyad."""
        own = self._own
        return tuple(
            Span(own.get(s.near, s.near), own.get(s.far, s.far), s.cones, True)
            for s in self.kinematics.stands
        )

    def at(self, poses: Floats, signs: Signs) -> Rows:
        """Return one mode at poses."""
        return _DyadRows(self.kinematics, self.kinematics.posed(poses, signs), poses)

    def forward(self, inputs: Floats) -> Solutions:
        """Return all poses at inputs (n, inputs) rad."""
        return ForwardKinematics(self.mechanism, self.output.name).solutions(inputs)


@final
@dataclass(frozen=True)
class _DyadRows:
    owner: InverseKinematics
    posed: Posed
    poses: Floats

    @property
    def driven(self) -> tuple[int, ...]:
        return self.owner.wrist.driven

    def cosine(self, one: int, other: int) -> Floats:
        return np.broadcast_to(self.posed.cosine(one, other), len(self.poses))

    def angle(self, pair: int) -> Floats:
        return self.posed.angle(pair)

    @property
    def inputs(self) -> Floats:
        return np.stack([self.posed.input(pair) for pair in self.driven], axis=1)

    @property
    def type_1(self) -> Floats:
        return np.stack([self.posed.rate(pair).speed for pair in self.driven], axis=1)

    @property
    def type_1_square(self) -> Floats:
        return np.stack([self.posed.speed_square(pair) for pair in self.driven], axis=1)

    @property
    def type_2(self) -> Floats:
        return self.owner.type_2(self.posed, self.poses)

    @property
    def rates(self) -> Floats:
        rates = [self.posed.rate(pair) for pair in self.driven]
        return np.stack([(rate.unit / rate.speed).T for rate in rates], axis=1)


@final
class MidPlaneKinematics(OutputKinematics):
    """A pointing output of a mechanism in its mid-plane form.

    The mid-plane of a direction p is the one that mirrors m, where the output would point
    with the end effector laid upon its image, to p; its normal n points from m to p. The
    mode of a leg is the sign of n . (base axis x elbow). In the direction m itself every
    plane through m serves, and nothing is determined.
    """

    def __init__(self, mechanism: Mechanism, output: Output, form: MidPlaneForm) -> None:
        assert output.direction is not None
        self.mechanism = mechanism
        self.output = output
        self.form = form
        self.home = form.image @ np.array(self.output.direction)

    @property
    def points(self) -> bool:
        """Whether poses are directions: yes."""
        return True

    @property
    def modes(self) -> tuple[Signs, ...]:
        """The signs of all working modes."""
        found: list[Signs] = [()]
        for _ in self.form.legs:
            found = [(*signs, sign) for signs in found for sign in (1, -1)]
        return tuple(found)

    @property
    def legs(self) -> tuple[str, ...]:
        """What each sign belongs to."""
        return tuple(
            "leg of " + ", ".join(map(self.name_of, (leg.base, leg.elbow, leg.tip)))
            for leg in self.form.legs
        )

    @property
    def spans(self) -> tuple[Span, ...]:
        """What limits the reach: the axes of every leg at base and end effector."""
        plane = self.form.plane
        return tuple(
            Span(leg.base, leg.tip, Cones(float(arc), float(arc)), number in plane.driven)
            for number, (leg, arc) in enumerate(
                zip(self.form.legs, plane.arcs, strict=True)
            )
        )

    def at(self, poses: Floats, signs: Signs) -> Rows:
        """Return one mode at directions (n, 3)."""
        return _MidPlaneRows(self, poses @ self.form.frame, signs)

    def forward(self, inputs: Floats) -> Solutions:
        """Return the pose at driven readings (n, 2) rad, the other legs in each mode.

        None where the driven elbows lie on one line.
        """
        form, plane = self.form, self.form.plane
        upward = plane.normals(inputs)
        away = -np.sign(upward @ self.home)[:, None]  # from the image of the output
        normals, own = away * upward, away * plane.modes(inputs)
        parts: list[tuple[NDArray[np.intp], Floats, list[Signs]]] = []
        for signs in self.modes:
            same = np.all(own == np.array(signs)[list(plane.driven)], axis=1)
            row = np.flatnonzero(same)
            values, _ = form.values(form.place(normals[row], signs))
            closed = np.isfinite(values).all(axis=1)
            row, values = row[closed], values[closed]
            parts.append((row, values, [signs] * len(row)))
        rows = np.concatenate([row for row, _, _ in parts])
        order = np.argsort(rows, kind="stable")
        values = np.concatenate([values for _, values, _ in parts])[order]
        labels = [signs for _, _, found in parts for signs in found]
        turned = form.orientations(normals[rows[order]])
        return Solutions(
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
        way = points - owner.home
        # lengths that differ by a rounding would turn the normal by that over the distance
        longer = np.sum(way * (points + owner.home), axis=1, keepdims=True)
        way = way - 0.5 * longer * points
        self.distance = np.linalg.norm(way, axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            self.normals = way / self.distance[:, None]

    def cosine(self, one: int, other: int) -> Floats:
        ends = [self._axis(pair) for pair in (one, other)]
        dots = np.sum(ends[0] * ends[1], axis=1)
        return np.broadcast_to(dots, len(self.points))

    def angle(self, pair: int) -> Floats:
        for k, leg in enumerate(self.form.legs):
            if pair == leg.base:
                return np.asarray(self.form.plane.readings(self._elbows[0])[:, k])
        ends, joint = self.form.mechanism.ends[pair], revolute(self.form.joints[pair])
        placed = self.form.place(self.normals, self.signs, links=ends)
        return turns_of([ends], [joint], placed)[0][:, 0]

    @property
    def inputs(self) -> Floats:
        return self.form.plane.readings(self._elbows[0])[:, self.driven]

    @property
    def type_1(self) -> Floats:
        elbows, root = self._elbows
        across = cross(self.points[:, None], elbows[:, self.driven])
        size = np.linalg.norm(across, axis=2)
        return np.asarray(np.abs(root[:, self.driven]) * self.distance[:, None] / size)

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

    @property
    def rates(self) -> Floats:
        elbows, root = self._elbows
        own = self.driven
        across = cross(elbows[:, own], self.points[:, None]) @ self.form.frame.T
        senses = self.form.plane.senses[own]
        return np.asarray(
            across * (senses / (root[:, own] * self.distance[:, None]))[..., None]
        )

    @cached_property
    def _elbows(self) -> tuple[Floats, Floats]:
        return self.form.plane.elbows(self.normals, self.signs)

    def _axis(self, pair: int) -> Floats:
        """Return the axis (n or 1, 3) of a pair in mirror axes."""
        return self.form.axis(pair, self.normals, self._elbows[0])
