"""Wheels in mesh: angles that follow from the inputs through rolling circles.

Two wheels that one link carries, each about the centre of its circle, turn relative to
it by angles f and g with sin(r) f -+ sin(s) g constant, r and s the radii: a linear
relation of the angles of the pairs between them. Where such relations fix all these
angles by the inputs, the pairs are known like inputs. A wheel repeats what its carrier
says of the distance of the axes; decimal numbers can say both only nearly, so that
circles that touch to `REPEATED` are taken to touch.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import final

import numpy as np
from numpy.typing import NDArray

from spherekit.errors import PlanError
from spherekit.proof.balls import Ball, complex_ball, exact, matrix, middle, pi, solved
from spherekit.proof.circles import Touching
from spherekit.proof.structure import Structure
from spherekit.proof.vectors import Frame, Vector, carried
from spherekit.sphere.rotation import Floats

REPEATED = 1e-9
"""Lines and arcs (rad) that differ by less are meant to be the same."""
SAME_LENGTH = 1e-7
"""Lengths (rad) that differ by less are one."""
MOST_MESHES = 5
MOST_TURNS = (2, 2, 2, 2, 1)
"""Whole turns of wheels of one contact among so many that are tried."""

Frames = Sequence[tuple[Frame, Frame]]
Way = tuple[tuple[int, int], ...]
Terms = Mapping[int, float]
"""Angles of pairs by number, with factors."""


@final
@dataclass(frozen=True)
class Mesh:
    """Two wheels on a carrier: by which pairs each is turned in it, and the signs.

    `contact` is the number of the rolling contact among the pairs of the mechanism. `ways`
    have the pairs from each wheel to the carrier, each with the side of the link that is
    nearer to the wheel.
    """

    contact: int
    carrier: int
    turned: tuple[Terms, Terms]
    ways: tuple[Way, Way]

    @property
    def pairs(self) -> set[int]:
        """The pairs whose angles it relates."""
        return {*self.turned[0], *self.turned[1]}


def mesh_of(
    structure: Structure,
    contact: int,
    wheels: tuple[int, int],
    touching: Touching,
    frames: Frames,
) -> Mesh | None:
    """Return how a carrier holds the wheels of a contact, None if none does."""
    turning = [
        _turning(structure, wheel, circle.centre, frames)
        for wheel, circle in zip(wheels, touching.circles, strict=True)
    ]
    shared = set(turning[0]) & set(turning[1])
    cosine = np.cos(middle(touching.arc))
    best = None
    for link in sorted(shared):
        (one, terms, way), (other, turned, back) = (table[link] for table in turning)
        apart = abs(float(one @ other) - cosine)
        fits = apart < REPEATED and np.linalg.norm(np.cross(one, other)) > REPEATED
        if fits and (best is None or len(way) + len(back) < len(best.pairs)):
            best = Mesh(contact, link, (terms, turned), (way, back))
    return best


_Turning = dict[int, tuple[Floats, dict[int, float], Way]]


def _turning(structure: Structure, wheel: int, centre: Vector, frames: Frames) -> _Turning:
    """Return the links relative to which a wheel turns about its centre only.

    By link: the centre in it, the angle as factors of pairs, and the pairs on the way.
    """
    reached: _Turning = {wheel: (_near(centre), {}, ())}
    waiting = [wheel]
    while waiting:
        link = waiting.pop(0)
        line, terms, way = reached[link]
        for pair, ends in enumerate(structure.ends):
            if link not in ends:
                continue
            side = ends.index(link)
            further = ends[1 - side]
            axis, beyond = _near(frames[pair][side][2]), _near(frames[pair][1 - side][2])
            if further in reached or not np.linalg.norm(np.cross(axis, line)) < REPEATED:
                continue
            sense = float(np.sign(axis @ line))
            # the angle moves the second link of a pair
            factor = sense if side else -sense
            reached[further] = (
                sense * beyond,
                {**terms, pair: factor},
                (*way, (pair, side)),
            )
            waiting.append(further)
    return reached


def _near(vector: Vector) -> Floats:
    return np.array([middle(ball) for ball in vector])


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
    row: dict[int, Ball] = {}
    for side, sense in ((0, 1), (1, -touching.sense)):
        size = touching.circles[side].sine * sense
        for pair, factor in mesh.turned[side].items():
            row[pair] = _of(row, pair) + size * exact(factor)
    return row


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
        _carried(circle.centre, way, frames)
        for circle, way in zip(touching.circles, mesh.ways, strict=True)
    ]
    lengths = []
    for side, direction in enumerate(touching.towards(lines[0], lines[1])):
        circle = touching.circles[side]
        back = tuple((pair, 1 - end) for pair, end in reversed(mesh.ways[side]))
        azimuth = circle.azimuth(_carried(direction, back, frames))
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
    if count > MOST_MESHES:
        raise PlanError(
            f"{structure.name}: it has {count} rolling contacts; proofs are for at most "
            f"{MOST_MESHES}"
        )
    return Train(
        structure, tuple(meshes), None, _least_rolled(train, touching, starts, frames)
    )


def _least_rolled(
    train: Train,
    touching: Sequence[Touching],
    starts: Sequence[tuple[Ball, Ball]],
    frames: Frames,
) -> tuple[tuple[int, int], ...]:
    """Return the turns with which wheels have rolled least at inputs of zero.

    Of those that have rolled as far, the ones with the greatest first length.
    """
    count = len(train.meshes)
    rolled = np.array(
        [
            [middle(ball) for ball in _rolled(mesh, two, start, frames, (0, 0))]
            for mesh, two, start in zip(train.meshes, touching, starts, strict=True)
        ]
    )
    sizes = np.array([[middle(circle.sine) for circle in two.circles] for two in touching])
    sizes[:, 1] *= [two.sense for two in touching]
    scale = sizes[:, 0] / [middle(two.circles[0].radius.sin()) for two in touching]
    rows = [_relation(mesh, two) for mesh, two in zip(train.meshes, touching, strict=True)]
    square = np.array([[middle(_of(row, p)) for p in train.followers] for row in rows])
    first = np.array(
        [
            [mesh.turned[0].get(pair, 0.0) for pair in train.followers]
            for mesh in train.meshes
        ]
    )
    most = MOST_TURNS[count - 1]
    whole_turns = range(-most, most + 1)
    turns: NDArray[np.int64] = np.array(list(product(whole_turns, repeat=2 * count)))
    turns = turns.reshape(-1, count, 2)
    grown = rolled + 2.0 * np.pi * sizes * turns
    angles = np.linalg.solve(square, (grown[..., 0] - grown[..., 1]).T).T
    lengths = (grown[..., 0] - sizes[:, 0] * (angles @ first.T)) / scale
    keys = np.round(
        np.column_stack([np.sum(np.abs(lengths), axis=1), -lengths]) / SAME_LENGTH
    )
    best = np.lexsort(keys.T[::-1])[0]
    return tuple((int(one), int(other)) for one, other in turns[best])
