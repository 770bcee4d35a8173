"""A mid-plane symmetric mechanism: links placed, and what its mid-planes say.

Orientations differ by mirrors, so two of them by a rotation about the line in which their
mid-planes meet, by twice the angle between these; on the way the normal turns about that
line by half the angle (Chen et al. 2021, section 4).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from spherekit.arrays import Floats
from spherekit.errors import SolveError
from spherekit.geometry.mirror import mirror_angles, mirror_of, reflections, upward
from spherekit.geometry.rotation import rotation_about_axis, transpose
from spherekit.geometry.sphere_mesh import spiral_directions
from spherekit.geometry.triangle import frame_toward
from spherekit.geometry.vectors import cross, nans
from spherekit.mechanism.elements import Output
from spherekit.mechanism.joint import Joint, revolute, revolutes
from spherekit.mechanism.mechanism import Mechanism
from spherekit.outputs.fixed_axis_rotation import (
    FollowedRotation,
    axis_and_angle,
    follow_rotation,
    unit,
)
from spherekit.outputs.mid_plane import MidPlane
from spherekit.positions.loop_closure import Closure
from spherekit.positions.loop_tree import rank_mobility
from spherekit.positions.pair_states import measure_pair_angles
from spherekit.velocities.transmission import Transmission
from spherekit.wording import listing

LEAD = 0.02
"""Angle (rad) before a singular start of a rotation from which it is followed."""
INSIDE = np.radians(0.01)
"""How far inside the legs' reach an offered pose is."""
PROOF_POSES, SPREAD = 64, 2**16
"""Poses at which the closed form is proven, about, of so many mid-planes."""


Leg = tuple[int, int, int]
"""Numbers of a leg's pairs at the base, the elbow and the end effector."""
KINDS = "base", "tip", "elbow", "normal"
PairAxis = tuple[str, int, float]
"""What an axis is along: the base axis, elbow or tip of a leg, or the normal (-1), with
the sense."""


@dataclass(frozen=True)
class MidPlaneArchitecture:
    """A mechanism in its mid-plane symmetric architecture.

    Attributes
    ----------
    mechanism
        The mechanism with its base as the ground.
    plane
        The closed forms, in mirror axes.
    effector
        Number of the end effector, the link of the `output`.
    frame
        (3, 3) from mirror axes to the axes of the base.
    image
        (3, 3), determinant -1, from the axes of the end effector to mirror axes; its
        orientation is ``frame @ mirror(n) @ image``.
    legs, along
        The legs, and of every pair what its axis is along.
    """

    mechanism: Mechanism
    joints: tuple[Joint, ...]
    plane: MidPlane
    effector: int
    frame: Floats
    image: Floats
    legs: tuple[Leg, ...]
    along: tuple[PairAxis, ...]
    output: Output

    def name_of(self, leg: int) -> str:
        """Return the name of the pair of a leg at the base."""
        return self.mechanism.pairs[self.legs[leg][0]].name

    def orientations(self, normals: Floats) -> Floats:
        """Return orientations (n, 3, 3) of the end effector at mid-planes (n, 3)."""
        return self.frame @ reflections(normals) @ self.image

    @cached_property
    def home(self) -> Floats:
        """Where the output points (3,) with the end effector laid upon its image.

        In mirror axes; the output declares a direction.
        """
        return self.image @ np.array(self.output.direction)

    def normals_to(self, directions: Floats) -> tuple[Floats, Floats]:
        """Return the mid-planes (n, 3) in which the output points at directions (n, 3).

        Both in mirror axes, the normals pointing from `home` to the directions, and how
        far (n,) those are from it: at `home` itself every plane through it serves.
        """
        way = directions - self.home
        # lengths that differ by a rounding would turn the normal by that over the distance
        longer = np.sum(way * (directions + self.home), axis=1, keepdims=True)
        way = way - 0.5 * longer * directions
        distance = np.linalg.norm(way, axis=1)
        with np.errstate(all="ignore"):
            return way / distance[:, None], distance

    def angles_to(self, directions: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the angles of the mid-planes in which the output points at directions.

        These (n, 3) are in the axes of the base.
        """
        return mirror_angles(self.normals_to(directions @ self.frame)[0])

    def angle_rates(self, directions: Floats, turns: Floats) -> Floats:
        """Return the derivatives (n, k, 2) of phi and gamma by k variables.

        `turns` (n, 3, k) are the output's angular velocities per unit rate of each, where
        it points at directions (n, 3), both in the axes of the base.
        """
        normals, distance = self.normals_to(directions @ self.frame)
        swept = cross(np.swapaxes(turns, 1, 2), directions[:, None]) @ self.frame
        along = np.matvec(swept, normals)[..., None]
        x, y, z = normals.T
        with np.errstate(all="ignore"):
            slopes = (swept - along * normals[:, None]) / distance[:, None, None]
            scale = np.stack([-1.0 / np.hypot(y, z), 1.0 / np.hypot(x, z)], axis=1)
            scale *= 2.0 * np.where(z < 0.0, -1.0, 1.0)[:, None]
            return scale[:, None] * slopes[..., :2]

    def normals(self, orientations: Floats) -> tuple[Floats, Floats]:
        """Return the mid-planes (n, 3) nearest to orientations (n, 3, 3).

        And by what angle (n,) rad the orientations depart from them.
        """
        return mirror_of(transpose(self.frame) @ orientations @ transpose(self.image))

    def place(
        self, normals: Floats, modes: ArrayLike, links: Sequence[int] | None = None
    ) -> Floats:
        """Return orientations (n, links, 3, 3) of all links relative to the base.

        Parameters
        ----------
        normals
            (n, 3) in mirror axes.
        modes
            A sign for each leg, or (n, legs).
        links
            Numbers of the links wanted, all by default; the others are left NaN.
        """
        elbows, _ = self.plane.elbows(normals, modes)
        count = len(self.mechanism.links)
        placed = nans((len(normals), count, 3, 3))
        placed[:, 0] = np.eye(3)
        placed[:, self.effector] = self.orientations(normals)
        for link in {*(range(count) if links is None else links)} - {0, self.effector}:
            pairs = sorted(
                (pair for pair, ends in enumerate(self.mechanism.ends) if link in ends),
                key=lambda pair: KINDS.index(self.along[pair][0]),
            )
            outer = pairs[0], pairs[-1]
            axes = (self.axis(pair, normals, elbows) for pair in outer)
            turned = self.frame @ frame_toward(*np.broadcast_arrays(*axes))
            fixed = (axis_in(self.mechanism, self.joints, pair, link) for pair in outer)
            placed[:, link] = turned @ frame_toward(*fixed).T
        return placed

    def axis(self, pair: int, normals: Floats, elbows: Floats) -> Floats:
        """Return the axis (n or 1, 3) of a pair in mirror axes.

        At mid-planes (n, 3) with the elbows (n, legs, 3).
        """
        what, leg, sense = self.along[pair]
        if what == "base":
            return self.plane.axes[leg][None]
        if what == "tip":
            return reflections(normals) @ self.plane.axes[leg]
        return sense * (normals if what == "normal" else elbows[:, leg])

    def axes(self, normals: Floats, elbows: Floats) -> Floats:
        """Return the axes (n, pairs, 3) of all pairs, see `axis`."""
        pairs = range(len(self.along))
        axes = np.broadcast_arrays(*(self.axis(pair, normals, elbows) for pair in pairs))
        return np.stack(axes, axis=1)

    @cached_property
    def _transmission(self) -> Transmission:
        return Transmission.from_mechanism(self.mechanism, self.output)

    def transmission(self, normals: Floats, elbows: Floats) -> Floats:
        """Return the measure (n,) of type II at mid-planes (n, 3) with elbows."""
        directions = None
        if self.output.direction is not None:
            directions = reflections(normals) @ self.home
        return self._transmission.measure(self.axes(normals, elbows), directions)

    def values(self, placed: Floats) -> tuple[Floats, Floats]:
        """Return the variables (n, pairs) rad of placed links, and gaps (n, pairs) rad."""
        return measure_pair_angles(self.mechanism.ends, revolutes(self.joints), placed)

    def proof(self) -> tuple[float, int]:
        """Return how well the closed form closes the graph, at poses over the reach.

        In all modes: the largest angle (rad) between the axes of a pair in its two links,
        and the least mobility by rank.
        """
        normals = _spread_normals(self.plane)
        gap = 0.0
        for modes in product((1, -1), repeat=len(self.legs)):
            values, gaps = self.values(self.place(normals, modes))
            gap = max(gap, float(np.max(gaps)))
        closure = Closure.of(self.mechanism, self.joints)
        return gap, int(np.min(rank_mobility(closure.tree, closure.at(values).vectors)))

    def check_reach(self, normal: Floats) -> None:
        """Raise `SolveError` if a mid-plane (3,) is outside the reach of the legs.

        With the nearest one that is inside.
        """
        elbows, _ = self.plane.elbows(normal[None], np.ones(len(self.legs)))
        lost = np.flatnonzero(np.isnan(elbows[0, :, 0])).tolist()
        if lost:
            raise SolveError(
                f"{self.mechanism.name}: {named(normal)} is outside the workspace: the "
                f"legs at {listing(map(self.name_of, lost))} do not reach its mid-plane; "
                f"the nearest pose inside is {named(self.plane.nearest(normal, INSIDE))}"
            )

    def rotation_between(
        self, start: Floats, stop: Floats, modes: ArrayLike
    ) -> FollowedRotation:
        """Return the rotation about a fixed axis from one pose to another.

        Parameters
        ----------
        start, stop
            Normals (3,) of the mid-planes, in mirror axes.
        modes
            A sign for each leg, for the start's normal with n_z >= 0; it stays on the way.

        Raises
        ------
        SolveError
            If the poses coincide or differ by half a turn, or a leg does not reach one.
        """
        signs = np.asarray(modes, dtype=float)
        if signs.shape != (len(self.legs),) or not np.all(np.abs(signs) == 1.0):
            raise SolveError(
                f"modes: found {signs.tolist()}, needs 1 or -1 for each of "
                f"{len(self.legs)} legs"
            )
        ends = np.stack([upward(unit(normal)) for normal in (start, stop)])
        for normal in ends:
            self.check_reach(normal)
        return self.rotation_about(
            ends[0], *axis_and_angle(*self.orientations(ends)), signs
        )

    def rotation_about(
        self, start: Floats, axis: Floats, angle: float, modes: Floats
    ) -> FollowedRotation:
        """Return the rotation about an axis (3,) in a mid-plane of normal `start` (3,).

        Where the loops do not fix the links there, the way begins a little before.
        """

        def followed(lead: float) -> FollowedRotation:
            normals = rotation_about_axis(self.frame.T @ axis, [-0.5 * lead]) @ start
            (values,), _ = self.values(self.place(normals, modes))
            name = self.output.name
            return follow_rotation(self.mechanism, values, axis, angle, name, lead)

        try:
            return followed(0.0)
        except SolveError as singular:
            try:
                return followed(LEAD)
            except SolveError:
                raise singular from None


def axis_in(mechanism: Mechanism, joints: Sequence[Joint], pair: int, link: int) -> Floats:
    """Return the axis (3,) of an R pair in one of its links."""
    joint = revolute(joints[pair])
    return (joint.first if mechanism.ends[pair][0] == link else joint.second)[:, 2]


def _spread_normals(plane: MidPlane) -> Floats:
    """Return mid-planes (n, 3) spread evenly over the reach of all legs."""
    normals = spiral_directions(SPREAD, min_z=0.0)
    limits = np.sin(0.95 * plane.reach)
    inside = normals[np.all(np.abs(normals @ plane.axes.T) < limits, axis=1)]
    return inside[:: max(1, len(inside) // PROOF_POSES)]


def named(normal: Floats) -> str:
    """Return words for a mid-plane (3,)."""
    phi, gamma, _ = np.round(np.degrees(mirror_angles(normal)), 9) + 0.0
    return f"phi = {phi:.6g}, gamma = {gamma:.6g} deg"
