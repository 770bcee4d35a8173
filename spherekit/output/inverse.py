"""Inverse kinematics of a mechanism's output, in all working modes, many rows at once.

With the output held, the mechanism is assembled like any other: group by group, from the
derived mechanism that `wrist` makes. Where all groups are dyads on the held body, as for
legs of any make, a batch is computed from vectors of axes and each sign of a dyad is a
working mode. Otherwise each row is solved on its own, by elimination or search.

Singularity measures are those of C. Gosselin and J. Angeles, Singularity analysis of
closed-loop kinematic chains (1990), made free of units. With the other inputs free, a
locked input leaves the output a plane of angular velocities; n_i is its normal.
"""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from spherekit.conventions import REACH_SLACK, Status
from spherekit.errors import SolveError
from spherekit.model.geometry import Revolute
from spherekit.model.mechanism import Mechanism
from spherekit.motion.branches import Solver
from spherekit.output.dyads import Dyads, Placed, Signs
from spherekit.output.solutions import Solutions, solved
from spherekit.output.wrist import Wrist, with_wrist
from spherekit.planning.assembly import plan_assembly
from spherekit.rates.vectors import cross, dot, norm
from spherekit.sphere.rotation import Floats
from spherekit.sphere.tilt_torsion import azimuth_tilt, euler_zyz

ROWS = 8192
"""Rows computed at once: few enough for the processor's cache, and enough to hide calls."""
NOT_UNIT = 1e-6
"""Poses whose squared lengths or volume differ from 1 by more are refused."""


@final
@dataclass(frozen=True)
class Inverse:
    """The inputs of n poses in m working modes, and how near they are to singularities.

    Attributes
    ----------
    modes
        The signs of each mode's dyads, see `Inverse.labels`.
    inputs
        (m, n, inputs) rad in (-pi, pi], in the order of the mechanism's inputs; NaN
        where the status is neither OK nor AT_SINGULARITY.
    status
        (m, n) values of `Status`: OK, OUT_OF_REACH, or AT_SINGULARITY where a dyad of the
        mode is stretched or folded, or can turn about two axes that coincide.
    margin
        (m, n) rad: by how much the pose is within reach; negative outside. The least over
        the dyads of the arc that is left between the outer axes of a dyad until it is
        stretched or folded.
    limiting
        (m, n) the number of the dyad that the margin belongs to, see `legs` of
        `InverseKinematics`.
    type_1
        (m, n, inputs): how fast the output turns about n_i per unit rate of input i; 0 at
        a type I singularity of that input. At most 1 for an input on the base, where it
        is the sine of the angle between its axis and the plane of the next link.
    type_2
        (m, n): |n_1 . (n_2 x n_3)| of an orientation, |n_1 x n_2| of a pointing output;
        from 0 (type II singularity) to 1 (normals at right angles).
    normals
        (m, n, inputs, 3) the unit n_i in axes of the link that the output is seen from,
        in the sense in which the input's rate is positive; None if not asked for.
    """

    modes: tuple[Signs, ...]
    inputs: Floats
    status: NDArray[np.int8]
    margin: Floats
    limiting: NDArray[np.int8]
    type_1: Floats
    type_2: Floats
    normals: Floats | None = None

    @property
    def labels(self) -> tuple[str, ...]:
        """The signs of the modes as text, ``+-+``."""
        return tuple(
            "".join("+" if sign > 0 else "-" for sign in signs) for signs in self.modes
        )

    @cached_property
    def jacobian(self) -> Floats:
        """Angular velocity (m, n, 3, inputs) of the output per unit rate of each input.

        In axes of the link that the output is seen from. Of a pointing output the part at
        right angles to its direction. NaN or endless at a type II singularity.

        Raises
        ------
        SolveError
            If the normals were not asked for.
        """
        if self.normals is None:
            raise SolveError("the Jacobian needs the normals: ask with normals=True")
        rows = self.normals / self.type_1[..., None]
        if rows.shape[2] == 3:
            a, b, c = (rows[..., k, :] for k in range(3))
            columns = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=-1)
            volume = np.sum(a * np.cross(b, c), axis=-1)
        else:
            a, b = rows[..., 0, :], rows[..., 1, :]
            axis = np.cross(a, b)
            columns = np.stack([np.cross(b, axis), np.cross(axis, a)], axis=-1)
            volume = np.sum(axis * axis, axis=-1)
        return np.asarray(columns / volume[..., None, None])


@final
class InverseKinematics:
    """The inverse kinematics of one declared output.

    Parameters
    ----------
    mechanism
        A mechanism with two inputs and a pointing output, or three inputs.
    output
        Name of the output, if it declares several.

    Raises
    ------
    PlanError
        If the output is not declared, or holding it leaves a part that is rigid or free.
    """

    def __init__(self, mechanism: Mechanism, output: str | None = None) -> None:
        self.own = mechanism
        self.wrist: Wrist = with_wrist(mechanism, output)
        self.mechanism = self.wrist.mechanism
        self.solver = Solver(self.mechanism, plan_assembly(self.mechanism))
        self.driven = [
            number for pair in self.wrist.driven for number in mechanism.variables_of(pair)
        ]
        self._dyads: Dyads | None = None
        joints = [joint for joint in self.solver.joints if isinstance(joint, Revolute)]
        every = len(joints) == len(self.solver.joints)
        if every and Dyads.fit(self.solver.assembly, self.wrist.base):
            given = self.wrist.carrier if self.wrist.points else self.wrist.link
            self._dyads = Dyads(
                self.mechanism, joints, self.solver.assembly, self.wrist.base, [given]
            )

    @property
    def has_closed_form(self) -> bool:
        """Whether `at` can be asked: all groups are dyads on the held body."""
        return self._dyads is not None

    @property
    def legs(self) -> tuple[str, ...]:
        """The groups in solving order, each by its kind and the names of its pairs."""
        return tuple(
            f"{group.kind} of "
            + ", ".join(self.mechanism.pairs[p].name for p in group.pairs)
            for group in self.solver.assembly.groups
        )

    @property
    def modes(self) -> tuple[Signs, ...]:
        """The signs of all working modes."""
        found: list[Signs] = [()]
        for group in self.solver.assembly.groups:
            choices = (1, -1) if group.is_dyad else (0,)
            found = [(*signs, sign) for signs in found for sign in choices]
        return tuple(found)

    def at(
        self,
        poses: ArrayLike,
        modes: Sequence[Signs] | None = None,
        normals: bool = False,
    ) -> Inverse:
        """Return the inputs of poses in closed form.

        Parameters
        ----------
        poses
            (n, 3, 3) orientations of the output link, or (n, 3) directions that it points
            at, both in axes of the link that the output is seen from.
        modes
            Signs of the modes wanted; all by default.
        normals
            Whether to keep the normals, which the Jacobian needs.

        Raises
        ------
        SolveError
            If the poses are no rotations or directions, a mode does not exist, or the
            groups have no closed form; then ask for `solutions`.
        """
        dyads = self._dyads
        if dyads is None:
            raise SolveError(
                f"{self.own.name}: with the output held there is no closed form: "
                f"{'; '.join(self.legs)}. Ask for `solutions` row by row, or trace "
                "`InverseKinematics.mechanism` along a path of its inputs"
            )
        given = self._checked(poses)
        chosen = self._chosen(modes)
        m, n, g = len(chosen), len(given), len(self.driven)
        inputs, type_1 = np.empty((m, g, n)), np.empty((m, g, n))
        margin, type_2 = np.empty((m, n)), np.empty((m, n))
        status = np.empty((m, n), dtype=np.int8)
        limiting = np.empty((m, n), dtype=np.int8)
        kept = np.empty((m, g, 3, n)) if normals else None
        with np.errstate(invalid="ignore", divide="ignore"):
            for start in range(0, n, ROWS):
                rows = slice(start, min(start + ROWS, n))
                block = np.ascontiguousarray(given[rows].T)
                placed = (
                    Placed(dyads, {self.wrist.pairs[2]: block}, None)
                    if self.wrist.points
                    else Placed(dyads, {}, block)
                )
                self._check(block, start)
                for k, signs in enumerate(chosen):
                    reach = _reach(placed, signs)
                    margin[k, rows], limiting[k, rows] = reach.margin, reach.limiting
                    status[k, rows] = reach.status
                    rates = []
                    for i, pair in enumerate(self.wrist.driven):
                        inputs[k, i, rows] = _input(placed, pair, signs, reach)
                        rates.append(_rate(placed, pair, signs))
                        type_1[k, i, rows] = rates[-1].speed
                        if kept is not None:
                            kept[k, i, :, rows] = rates[-1].unit
                    type_2[k, rows] = _independence(placed, rates, self.wrist.driven, signs)
        return Inverse(
            chosen,
            np.swapaxes(inputs, 1, 2),
            status,
            margin,
            limiting,
            np.swapaxes(type_1, 1, 2),
            type_2,
            None if kept is None else np.moveaxis(kept, -1, 1),
        )

    def solutions(self, poses: ArrayLike) -> Solutions:
        """Return every configuration found at poses, of any mechanism, row by row.

        Poses are those of `at`. Dyads are solved in closed form, other groups by
        elimination or search, which cost milliseconds to seconds a row.

        Raises
        ------
        SolveError
            If the poses are no rotations or directions.
        """
        given = self._checked(poses)
        coordinates = azimuth_tilt(given) if self.wrist.points else euler_zyz(given)
        return solved(self.solver, self.wrist.output, coordinates, self.driven)

    def _checked(self, poses: ArrayLike) -> Floats:
        given = np.asarray(poses, dtype=float)
        shape = (3,) if self.wrist.points else (3, 3)
        what = "directions (n, 3)" if self.wrist.points else "rotations (n, 3, 3)"
        if given.shape == shape:
            given = given[None]
        if given.shape[1:] != shape or given.ndim != len(shape) + 1:
            raise SolveError(
                f"{self.own.name}: outputs.{self.wrist.output.name}: poses are {what}, "
                f"not {given.shape}"
            )
        return given

    def _check(self, block: Floats, start: int) -> None:
        """Raise the error about a pose (..., n) that is none; NaN passes."""
        columns = [block] if self.wrist.points else list(block)
        wrong = np.zeros(block.shape[-1], dtype=bool)
        for column in columns:
            wrong |= np.abs(dot(column, column) - 1.0) > NOT_UNIT
        if not self.wrist.points:
            # unit columns span at most the unit volume, and only at right angles
            wrong |= np.abs(dot(cross(block[0], block[1]), block[2]) - 1.0) > NOT_UNIT
        if np.any(wrong):
            raise SolveError(
                f"{self.own.name}: outputs.{self.wrist.output.name}: row "
                f"{start + int(np.argmax(wrong))} is no "
                + ("unit vector" if self.wrist.points else "rotation matrix")
            )

    def _chosen(self, modes: Sequence[Signs] | None) -> tuple[Signs, ...]:
        if modes is None:
            return self.modes
        chosen = tuple(tuple(int(sign) for sign in signs) for signs in modes)
        for signs in chosen:
            if signs not in self.modes:
                raise SolveError(
                    f"{self.own.name}: {signs} is no working mode; a mode is a sign, 1 or "
                    f"-1, for each of: {'; '.join(self.legs)}"
                )
        return chosen


@final
@dataclass(frozen=True)
class _Reach:
    """Whether the dyads of a mode close (n,), see `Inverse`; `key` names what it is of."""

    key: Hashable
    margin: Floats
    limiting: NDArray[np.int8]
    status: NDArray[np.int8]


def _reach(placed: Placed, signs: Signs) -> _Reach:
    numbers = range(len(signs))
    key = ("reach", *(placed.reach_key(number, signs) for number in numbers))
    if key not in placed.known:
        margin = placed.margin(0, signs)
        limiting = np.zeros(len(margin), dtype=np.int8)
        status = np.zeros(len(margin), dtype=np.int8)
        for number in numbers:
            another = placed.margin(number, signs)
            limiting[another < margin] = number
            margin = np.fmin(margin, another)
            status[~placed.sound(number, signs)] = Status.AT_SINGULARITY
        status[~(margin >= -REACH_SLACK)] = Status.OUT_OF_REACH
        placed.known[key] = _Reach(key, margin, limiting, status)
    found: _Reach = placed.known[key]
    return found


def _input(placed: Placed, pair: int, signs: Signs, reach: _Reach) -> Floats:
    """Return an input (n,), NaN where any dyad of the mode is out of reach."""
    angle, key = placed.angle(pair, signs)
    masked = (key, reach.key)
    if masked not in placed.known:
        held = angle.copy()
        held[reach.status == Status.OUT_OF_REACH] = np.nan
        placed.known[masked] = held
    return np.asarray(placed.known[masked])


@final
@dataclass(frozen=True)
class _Rate:
    """How an input moves with the output: a vector (3, n) along its normal, and sizes."""

    normal: Floats
    size: Floats
    sense: Floats
    speed: Floats

    @property
    def unit(self) -> Floats:
        """The unit normal (3, n)."""
        return np.asarray(self.normal * (self.sense / self.size))


def _rate(placed: Placed, pair: int, signs: Signs) -> _Rate:
    key = ("size", placed.key("rate", pair, placed.dyads.moves_with(pair), signs))
    if key not in placed.known:
        rate = placed.rate(pair, signs)
        size = norm(rate.top)
        speed = np.abs(rate.bottom) / size
        placed.known[key] = _Rate(rate.top, size, np.sign(rate.bottom), speed)
    found: _Rate = placed.known[key]
    return found


def _independence(
    placed: Placed, rates: Sequence[_Rate], pairs: Sequence[int], signs: Signs
) -> Floats:
    """Return the volume or area (n,) that the unit normals span."""
    one, other, *rest = rates
    needs = placed.dyads.moves_with(pairs[0]) | placed.dyads.moves_with(pairs[1])
    key = placed.key("cross", pairs[0], needs, signs)
    if key not in placed.known:
        placed.known[key] = cross(one.normal, other.normal), one.size * other.size
    across, sizes = placed.known[key]
    if not rest:
        return np.asarray(norm(across) / sizes)
    return np.asarray(np.abs(dot(across, rest[0].normal)) / (sizes * rest[0].size))
