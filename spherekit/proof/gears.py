"""Trains of wheels as balls: angles that follow from the inputs through rolling circles.

Where the relations of all rolling contacts (`planning.wheels`) fix the angles that they
relate by the inputs, the pairs are known like inputs. A wheel repeats what its carrier
says of the distance of the axes; decimal numbers can say both only nearly, so that
circles that touch nearly are taken to touch.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import final

import numpy as np

from spherekit.errors import PlanError
from spherekit.planning.wheels import Mesh, Way, back, least_rolled
from spherekit.proof.balls import (
    Ball,
    Balls,
    angle_of,
    exactly,
    floats,
    matrix,
    pi,
    solved,
    solved_exactly,
)
from spherekit.proof.frames import Frame, Vector, carried
from spherekit.proof.structure import Structure


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


@final
@dataclass(frozen=True)
class Train:
    """Wheels in mesh with the numbers of a file, in balls of the present precision.

    `touching` are the circles of each mesh and `starts` the lengths (rad) along both at
    which it starts, `frames` those of the structure's pairs. `reference` are the angles
    (pairs,) in a pose in which nothing has rolled; without one `turns` (meshes, 2) are the
    whole turns of both circles with which wheels are put together.
    """

    structure: Structure
    meshes: tuple[Mesh, ...]
    touching: Sequence[Touching]
    starts: Sequence[tuple[Ball, Ball]]
    frames: Sequence[tuple[Frame, Frame]]
    reference: Balls | None
    turns: tuple[tuple[int, int], ...] = ()

    @property
    def followers(self) -> tuple[int, ...]:
        """The pairs whose angles follow, in order."""
        every = set().union(*(mesh.pairs for mesh in self.meshes))
        return tuple(sorted(every - set(self.structure.inputs)))

    def ratios(self) -> list[list[Ball]]:
        """Return the rates (followers, inputs) of the angles that follow."""
        rows = self._rows()
        return self._solved(rows, -rows[:, list(self.structure.inputs)])

    def exact_ratios(self) -> list[Fraction] | None:
        """Return the rates of angles by the only input, None unless all have teeth."""
        rows = self._rows()
        if not all(factor.is_exact() for factor in rows.flat):
            return None
        (driven,) = self.structure.inputs
        return solved_exactly(rows[:, list(self.followers)], -rows[:, driven])

    def angles(self, inputs: Sequence[Ball]) -> list[Ball]:
        """Return the angles (rad) of followers at angles of the inputs."""
        rows = self._rows()
        if self.reference is not None:
            constants = rows @ self.reference
        else:
            constants = self._rolled(self.turns) @ exactly([1.0, -1.0])
        right = constants - rows[:, list(self.structure.inputs)] @ np.array(inputs)
        return [angle for (angle,) in self._solved(rows, right[:, None])]

    def assembled(self) -> "Train":
        """Return it put together as the file means.

        That is with nothing rolled in the reference pose; without one, with wheels rolled
        least at inputs of zero.

        Raises
        ------
        PlanError
            If the meshes do not fix all angles that they relate by the inputs.
        """
        structure, count = self.structure, len(self.meshes)
        where = ", ".join(structure.pairs[pair] for pair in self.followers)
        problem = PlanError(
            f"{structure.name}: its {count} rolling contacts relate the angles {where} to "
            "the inputs, and do not fix each of them; proofs are for wheels whose turning "
            "follows from the inputs alone: drive another pair"
        )
        if count != len(self.followers):
            raise problem
        try:
            self.ratios()
        except ZeroDivisionError:
            raise problem from None
        if self.reference is not None:
            return self
        scale = floats(
            np.array(
                [
                    [two.circles[0].sine / two.circles[0].radius.sin()]
                    for two in self.touching
                ]
            )
        )
        laps = [[c.sine for c in two.circles] for two in self.touching]
        senses = np.array([(1, two.sense) for two in self.touching])
        square = floats(self._rows()[:, list(self.followers)])
        on_first = [[p in mesh.turned[0] for p in self.followers] for mesh in self.meshes]
        turns = least_rolled(
            floats(self._rolled([(0, 0)] * count)) / scale,
            2.0 * np.pi * floats(np.array(laps)) * senses / scale,
            square * on_first / scale,
            square / scale,
        )
        if turns is None:
            raise PlanError(
                f"{structure.name}: it has {count} rolling contacts; without a reference "
                "pose proofs are for fewer, whose turns can all be tried"
            )
        return replace(self, turns=tuple((int(one), int(other)) for one, other in turns))

    def _rows(self) -> Balls:
        """Return the factors (meshes, pairs) of sums of angles that stay the same."""
        rows = exactly(np.zeros((len(self.meshes), len(self.frames))))
        for row, mesh, touch in zip(rows, self.meshes, self.touching, strict=True):
            one, other = (circle.sine for circle in touch.circles)
            for pair, factor in mesh.relation((one, -touch.sense * other)).items():
                row[pair] = factor
        return rows

    def _rolled(self, turns: Sequence[tuple[int, int]]) -> Balls:
        """Return the lengths (meshes, 2) rolled along circles with all angles zero.

        It is the sine of the radius times the azimuth of the contact, less where it starts;
        in teeth, if these are given.
        """
        rolled = []
        for mesh, touch, start, two in zip(
            self.meshes, self.touching, self.starts, turns, strict=True
        ):
            lines = [
                self._carried(circle.axes[2], way)
                for circle, way in zip(touch.circles, mesh.ways, strict=True)
            ]
            lengths = []
            for side, direction in enumerate(touch.towards(lines[0], lines[1])):
                circle = touch.circles[side]
                ahead, across, _ = circle.axes @ self._carried(
                    direction, back(mesh.ways[side])
                )
                length = circle.sine * (angle_of(ahead, across) + 2 * pi() * two[side])
                length = length * touch.sense if side else length
                lengths.append(length - start[side] * circle.sine / circle.radius.sin())
            rolled.append(lengths)
        return np.array(rolled)

    def _solved(self, rows: Balls, right: Balls) -> list[list[Ball]]:
        """Return the angles that follow, or their rates, from the columns of `right`."""
        made = solved(matrix(rows[:, list(self.followers)]), matrix(right)).tolist()
        return [[entry.real for entry in row] for row in made]

    def _carried(self, vector: Vector, way: Way) -> Vector:
        """Return a vector of the first link of a way in the last, all angles zero."""
        for pair, side in way:
            vector = carried(vector, self.frames[pair][side], self.frames[pair][1 - side])
        return vector
