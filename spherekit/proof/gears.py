"""Trains of wheels as balls: angles that follow from the inputs through rolling circles.

Where the relations of all rolling contacts (`planning.wheels`) fix the angles that they
relate by the inputs, the pairs are known like inputs. A wheel repeats what its carrier
says of the distance of the axes; decimal numbers can say both only nearly, so that
circles that touch nearly are taken to touch.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import final

import numpy as np

from spherekit.errors import PlanError
from spherekit.planning.wheels import Mesh, Way, back, least_rolled, mesh_of
from spherekit.proof.balls import (
    Ball,
    angle_of,
    complex_ball,
    exact,
    floats,
    matrix,
    middle,
    pi,
    solved,
    solved_exactly,
)
from spherekit.proof.frames import Frame, Vector, carried
from spherekit.proof.structure import Structure

Frames = Sequence[tuple[Frame, Frame]]


@final
@dataclass(frozen=True)
class Circle:
    """A circle in link axes: centre, angular radius, its sine, and where arcs begin.

    `axes` has the directions of azimuth 0 and 90 degrees about the centre, and the centre,
    or the pole of a great circle.
    """

    axes: Frame
    radius: Ball
    sine: Ball


@final
@dataclass(frozen=True)
class Touching:
    """The circles of a contact, and the way from one centre to the other.

    `arc` is the signed arc from the first centre over the contact on to the second, `sense`
    1 for circles one within the other and -1 beside each other: how the arc length runs
    about the second centre.
    """

    circles: tuple[Circle, Circle]
    arc: Ball
    sense: int

    def towards(self, first: Vector, second: Vector) -> tuple[Vector, Vector]:
        """Return the directions of the contact at both centres, where these are."""
        sine, cosine = self.arc.sin_cos()
        return (second - cosine * first) / sine, self.sense * (
            cosine * second - first
        ) / sine


def carried_wheels(
    structure: Structure,
    contact: int,
    wheels: tuple[int, int],
    touching: Touching,
    frames: Frames,
) -> Mesh | None:
    """Return how a carrier holds the wheels of a contact, None if none does."""
    axes = {
        pair: (floats(one[2]), floats(other[2])) for pair, (one, other) in enumerate(frames)
    }
    first, second = (floats(circle.axes[2]) for circle in touching.circles)
    cosine = float(np.cos(middle(touching.arc)))
    return mesh_of(structure.ends, axes, (contact, wheels), (first, second), cosine)


@final
@dataclass(frozen=True)
class Train:
    """All meshes of a mechanism, and with which turns its wheels are put together.

    `turns` (meshes, 2) are whole turns of both circles of each mesh; with a reference pose
    they have no meaning. `reference` are the angles of pairs there, None without one.
    """

    structure: Structure
    meshes: tuple[Mesh, ...]
    reference: Mapping[int, Ball] | None
    turns: tuple[tuple[int, int], ...]

    @property
    def followers(self) -> tuple[int, ...]:
        """The pairs whose angles follow, in order."""
        every = set().union(*(mesh.pairs for mesh in self.meshes))
        return tuple(sorted(every - set(self.structure.inputs)))

    def ratios(self, touching: Sequence[Touching]) -> list[list[Ball]]:
        """Return the rates (followers, inputs) of the angles that follow."""
        rows = self._rows(touching)
        columns = [
            self._solved(rows, [-_of(row, pair) for row in rows])
            for pair in self.structure.inputs
        ]
        return [list(column) for column in zip(*columns, strict=True)]

    def exact_ratios(self, touching: Sequence[Touching]) -> list[Fraction] | None:
        """Return the rates of angles by the only input, None unless all have teeth."""
        rows = self._rows(touching)
        if not all(factor.is_exact() for row in rows for factor in row.values()):
            return None
        (driven,) = self.structure.inputs
        square = [[_of(row, pair) for pair in self.followers] for row in rows]
        return solved_exactly(square, [-_of(row, driven) for row in rows])

    def angles(
        self,
        touching: Sequence[Touching],
        starts: Sequence[tuple[Ball, Ball]],
        frames: Frames,
        inputs: Sequence[Ball],
    ) -> list[Ball]:
        """Return the angles (rad) of followers at angles of the inputs."""
        rows = self._rows(touching)
        if self.reference is not None:
            constants = [
                sum((f * self.reference[p] for p, f in row.items()), exact(0.0))
                for row in rows
            ]
        else:
            rolled = (
                _rolled(mesh, contact, start, frames, turn)
                for mesh, contact, start, turn in zip(
                    self.meshes, touching, starts, self.turns, strict=True
                )
            )
            constants = [one - other for one, other in rolled]
        given = list(zip(self.structure.inputs, inputs, strict=True))
        right = [
            constant - sum((_of(row, pair) * q for pair, q in given), exact(0.0))
            for row, constant in zip(rows, constants, strict=True)
        ]
        return self._solved(rows, right)

    def _rows(self, touching: Sequence[Touching]) -> list[dict[int, Ball]]:
        return [
            _relation(mesh, contact)
            for mesh, contact in zip(self.meshes, touching, strict=True)
        ]

    def _solved(
        self, rows: Sequence[Mapping[int, Ball]], right: Sequence[Ball]
    ) -> list[Ball]:
        square = matrix([[_of(row, pair) for pair in self.followers] for row in rows])
        column = matrix([[complex_ball(ball)] for ball in right])
        return [entry.real for entry in solved(square, column).entries()]


def _of(row: Mapping[int, Ball], pair: int) -> Ball:
    return row.get(pair, exact(0.0))


def _relation(mesh: Mesh, touching: Touching) -> dict[int, Ball]:
    """Return the factors by pair of the sum of angles that stays the same."""
    one, other = (circle.sine for circle in touching.circles)
    return mesh.relation((one, -touching.sense * other))


def _rolled(
    mesh: Mesh,
    touching: Touching,
    start: tuple[Ball, Ball],
    frames: Frames,
    turns: tuple[int, int],
) -> tuple[Ball, Ball]:
    """Return the length rolled along each circle with all angles of pairs zero.

    It is the sine of the radius times the azimuth of the contact, less where it starts; in
    teeth, if these are given.
    """
    lines = [
        _carried(circle.axes[2], way, frames)
        for circle, way in zip(touching.circles, mesh.ways, strict=True)
    ]
    lengths = []
    for side, direction in enumerate(touching.towards(lines[0], lines[1])):
        circle = touching.circles[side]
        ahead, across, _ = circle.axes @ _carried(direction, back(mesh.ways[side]), frames)
        azimuth = angle_of(ahead, across)
        length = circle.sine * (azimuth + 2 * pi() * turns[side])
        length = length * touching.sense if side else length
        lengths.append(length - start[side] * circle.sine / circle.radius.sin())
    return lengths[0], lengths[1]


def _carried(vector: Vector, way: Way, frames: Frames) -> Vector:
    """Return a vector of the first link of a way in the last, all angles zero."""
    for pair, side in way:
        vector = carried(vector, frames[pair][side], frames[pair][1 - side])
    return vector


def train_of(
    structure: Structure,
    meshes: Sequence[Mesh],
    touching: Sequence[Touching],
    starts: Sequence[tuple[Ball, Ball]],
    frames: Frames,
    reference: Mapping[int, Ball] | None,
) -> Train:
    """Return the train of meshes, put together as the file means.

    That is with nothing rolled in the reference pose; without one, with wheels rolled least
    at inputs of zero.

    Raises
    ------
    PlanError
        If the meshes do not fix all angles that they relate by the inputs.
    """
    none = tuple((0, 0) for _ in meshes)
    train = Train(structure, tuple(meshes), reference, none)
    count = len(meshes)
    where = ", ".join(structure.pairs[pair] for pair in train.followers)
    problem = PlanError(
        f"{structure.name}: its {count} rolling contacts relate the angles {where} to the "
        "inputs, and do not fix each of them; proofs are for wheels whose turning follows "
        "from the inputs alone: drive another pair"
    )
    if count != len(train.followers):
        raise problem
    try:
        train.ratios(touching)
    except ZeroDivisionError:
        raise problem from None
    if reference is not None:
        return train
    turns = _least_rolled(train, touching, starts, frames)
    if turns is None:
        raise PlanError(
            f"{structure.name}: it has {count} rolling contacts; without a reference pose "
            "proofs are for fewer, whose turns can all be tried"
        )
    return Train(structure, tuple(meshes), None, turns)


def _least_rolled(
    train: Train,
    touching: Sequence[Touching],
    starts: Sequence[tuple[Ball, Ball]],
    frames: Frames,
) -> tuple[tuple[int, int], ...] | None:
    """Return the turns with which wheels have rolled least at inputs of zero."""
    rolled = np.array(
        [
            [middle(ball) for ball in _rolled(mesh, two, start, frames, (0, 0))]
            for mesh, two, start in zip(train.meshes, touching, starts, strict=True)
        ]
    )
    sizes = np.array([[middle(circle.sine) for circle in two.circles] for two in touching])
    laps = 2.0 * np.pi * sizes * [(1, two.sense) for two in touching]
    scale = sizes[:, :1] / [[middle(two.circles[0].radius.sin())] for two in touching]
    rows = [_relation(mesh, two) for mesh, two in zip(train.meshes, touching, strict=True)]
    square = np.array([[middle(_of(row, p)) for p in train.followers] for row in rows])
    on_first = [[p in mesh.turned[0] for p in train.followers] for mesh in train.meshes]
    turns = least_rolled(
        rolled / scale, laps / scale, square * on_first / scale, square / scale
    )
    if turns is None:
        return None
    return tuple((int(one), int(other)) for one, other in turns)
