"""The pairs of a mechanism as it declares them, in any arithmetic."""

from dataclasses import dataclass
from typing import final

import numpy as np

from spherekit.exact.arithmetic import Arithmetic, Numbers
from spherekit.exact.curves import ExactCurve, exact_curve, unit
from spherekit.exact.linear import left_inverse
from spherekit.exact.series import cosine_sine, cross, matrix_product, skew_part, transpose
from spherekit.model.geometry import COLLINEAR, axes_from_sizes, geometry_of
from spherekit.model.mechanism import Mechanism
from spherekit.model.parts import LinkSizes, PoseGeometry, SizeGeometry
from spherekit.sphere.rotation import Floats

STEPS = 60


@final
@dataclass(frozen=True)
class ExactRevolute:
    """An R pair: its frames (3, 3) in both links, columns zero direction, side, axis."""

    arithmetic: Arithmetic
    first: Numbers
    second: Numbers

    def turn(self, values: Numbers) -> Numbers:
        """Return rotations (k, n, 3, 3) of the second link in the first's axes.

        At series (k, n, 1) of the variable.
        """
        c, s = cosine_sine(self.arithmetic, values)
        x, y, z = self.first.T
        fixed = 0 * c + 0 * x
        fixed[0] = z
        frame = np.stack([c * x + s * y, c * y - s * x, fixed], axis=-1)
        return np.asarray(frame @ self.second.T)

    def vectors(self, values: Numbers) -> Numbers:
        """Return the variable's vector (n, 1, 3) in the first link's axes."""
        return np.broadcast_to(self.first[:, 2], (len(values), 1, 3))

    def axis(self, values: Numbers) -> Numbers:
        """Return the axis (n, 3) in the first link's axes."""
        return self.vectors(values)[:, 0]


@final
@dataclass(frozen=True)
class ExactContact:
    """A contact pair: two curves, whose frames agree at the contact.

    Each is run along by the variable of its number in `variables`, from its `start` (2,)
    on: in rolling both by the same one.
    """

    arithmetic: Arithmetic
    curves: tuple[ExactCurve, ExactCurve]
    variables: tuple[int, int]
    start: Numbers

    def turn(self, values: Numbers) -> Numbers:
        """Return rotations (k, n, 3, 3) of the second link in the first's axes.

        At series (k, n, 1 or 2) of the variables.
        """
        one, other = self._frames(values)
        return matrix_product(one, transpose(other))

    def vectors(self, values: Numbers) -> Numbers:
        """Return the vectors (n, 1 or 2, 3) of the variables, values (n, 1 or 2)."""
        along = self.arithmetic.exact(np.ones(values.shape))
        first, second = self._frames(np.stack([values, along]))
        back = transpose(second)
        vectors = self.arithmetic.zeros(*values.shape, 3)
        vectors[:, self.variables[0]] += skew_part(first[1] @ transpose(first[0]))
        turned = first[0] @ back[1] @ second[0] @ transpose(first[0])
        vectors[:, self.variables[1]] += skew_part(turned)
        return np.asarray(vectors)

    def axis(self, values: Numbers) -> Numbers:
        """Return the contact point (n, 3) in the first link's axes."""
        return self._frames(values[None])[0][0, :, :, 2]

    def _frames(self, values: Numbers) -> list[Numbers]:
        """Return the frames (k, n, 3, 3) of both curves at series of the variables."""
        frames = []
        for curve, variable, start in zip(
            self.curves, self.variables, self.start, strict=True
        ):
            s = values[..., variable].copy()
            s[0] = s[0] + start
            frames.append(curve.frame(s))
        return frames


ExactJoint = ExactRevolute | ExactContact


def exact_joints(arithmetic: Arithmetic, mechanism: Mechanism) -> tuple[ExactJoint, ...]:
    """Return the pairs of a mechanism, in their order.

    Which axes a zero direction is taken from, and near which place two profiles touch,
    is read off the float64 geometry; every number is computed anew.
    """
    frames = (
        _pose_frames(arithmetic, mechanism.geometry)
        if isinstance(mechanism.geometry, PoseGeometry)
        else _size_frames(arithmetic, mechanism, mechanism.geometry)
    )
    made: list[ExactJoint] = []
    given = geometry_of(mechanism).joints
    for pair, joint in zip(mechanism.pairs, given, strict=True):
        if pair.profiles is None:
            made.append(ExactRevolute(arithmetic, *frames[pair.name]))
            continue
        one, other = pair.profiles
        curves = (
            exact_curve(arithmetic, one, False),
            exact_curve(arithmetic, other, pair.contact == "external"),
        )
        tracks = joint.tracks
        start = arithmetic.exact([track.start for track in tracks])
        if joint.rolled and isinstance(mechanism.geometry, PoseGeometry):
            start = _touching(arithmetic, curves, start)
        first, second = (track.variable for track in tracks)
        made.append(ExactContact(arithmetic, curves, (first, second), start))
    return tuple(made)


def _touching(
    arithmetic: Arithmetic, curves: tuple[ExactCurve, ExactCurve], start: Numbers
) -> Numbers:
    """Return the arc lengths (2,) at which two profiles touch with links aligned.

    Least squares, as profiles may miss each other by what the float64 geometry allows.
    """
    pair = ExactContact(arithmetic, curves, (0, 1), arithmetic.zeros(2))
    s = start
    last = np.inf
    for _ in range(STEPS):
        miss = skew_part(pair.turn(s[None, None]))[0, 0]
        columns = np.swapaxes(pair.vectors(s[None]), 1, 2)
        step = left_inverse(arithmetic, columns)[0] @ miss
        s = s - step
        size = float(np.max(arithmetic.floats(np.abs(step))))
        if size == 0.0 or not size < last / 2:
            break
        last = size
    return s


Frames = dict[str, tuple[Numbers, Numbers]]
"""The frames (3, 3) of every R pair in its first and its second link."""


def _pose_frames(arithmetic: Arithmetic, geometry: PoseGeometry) -> Frames:
    made = {}
    for name, given in geometry.axes.items():
        axis = unit(arithmetic, np.array(given))
        first = _frame(axis, _perpendicular(arithmetic, axis, np.array(given)))
        turn = _about_z(arithmetic, geometry.values.get(name, 0.0))
        made[name] = (first, first @ turn)
    return made


def _size_frames(
    arithmetic: Arithmetic, mechanism: Mechanism, geometry: SizeGeometry
) -> Frames:
    sizes = {link: geometry.links.get(link, LinkSizes(())) for link in mechanism.links}
    near = {link: axes_from_sizes(given) for link, given in sizes.items()}
    axes = {link: _axes_of_link(arithmetic, given) for link, given in sizes.items()}
    made = {}
    for pair in mechanism.pairs:
        if not pair.kind.has_axis:
            continue
        first, second = (
            _reference_frame(arithmetic, axes[link], near[link], pair.name)
            for link in pair.links
        )
        zero = _about_z(arithmetic, geometry.zeros.get(pair.name, 0.0))
        made[pair.name] = (first @ zero, second)
    return made


def _axes_of_link(arithmetic: Arithmetic, sizes: LinkSizes) -> dict[str, Numbers]:
    """Return the unit axes (3,) of a link in its own frame, in the order listed."""
    axes = {name: arithmetic.exact([0.0, 0.0, 1.0]) for name in sizes.axes[:1]}
    arcs, angles = arithmetic.exact(sizes.arcs), arithmetic.exact((0.0, *sizes.angles))
    for name, length, angle in zip(sizes.axes[1:], arcs, angles, strict=False):
        up, across = arithmetic.cosine_sine(np.asarray(length))
        c, s = arithmetic.cosine_sine(np.asarray(angle))
        axes[name] = np.stack([-across * s, across * c, up])
    return axes


def _reference_frame(
    arithmetic: Arithmetic, axes: dict[str, Numbers], near: dict[str, Floats], name: str
) -> Numbers:
    """Return the frame (3, 3) of an axis; its x axis leads to the first other axis."""
    axis = axes[name]
    for other, direction in axes.items():
        side = np.linalg.norm(np.cross(near[name], near[other]))
        if other != name and side > COLLINEAR:
            toward = direction - np.sum(axis * direction) * axis
            return _frame(axis, toward / arithmetic.root(np.sum(toward * toward)))
    return _frame(axis, _perpendicular(arithmetic, axis, near[name]))


def _frame(axis: Numbers, tangent: Numbers) -> Numbers:
    side = cross(axis[None, None], tangent[None, None])[0, 0]
    return np.stack([tangent, side, axis], axis=1)


def _perpendicular(arithmetic: Arithmetic, axis: Numbers, near: Floats) -> Numbers:
    """Return a unit vector (3,) at right angles: axis x the helper axis least along it."""
    helper = np.zeros(3)
    helper[int(np.argmin(np.abs(near)))] = 1.0
    side = cross(axis[None, None], arithmetic.exact(helper)[None, None])[0, 0]
    return np.asarray(side / arithmetic.root(np.sum(side * side)))


def _about_z(arithmetic: Arithmetic, angle: float) -> Numbers:
    c, s = arithmetic.cosine_sine(arithmetic.exact(angle))
    made = arithmetic.exact(np.eye(3))
    made[0, 0] = made[1, 1] = c[()]
    made[0, 1], made[1, 0] = -s[()], s[()]
    return made
