"""Trains of wheels: groups whose bodies are placed one by one, without a choice.

Where it is known how far wheels have rolled, a contact says how its two bodies stand to
each other; and a body is placed that carries the axes of two pairs whose other bodies
are. A group that can be placed so has one assembly mode, in closed form.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from spherekit.model.joints import Joint, revolute
from spherekit.model.mechanism import Mechanism
from spherekit.planning.assembly import Group
from spherekit.sphere.complex_rotation import taking
from spherekit.sphere.rotation import Floats, cross

COAXIAL = 1e-6
"""Two axes of a body hold it if they are farther apart (sine) than this."""

Frames = Mapping[int, tuple[NDArray[Any], NDArray[Any]]]
"""Frames (..., 3, 3) of contacts in the axes of their first and second link, by pair."""


@final
@dataclass(frozen=True)
class WheelPlacement:
    """A group with the order in which its bodies are placed.

    Each step is a body's position in `group.bodies`, and those in `group.pairs` of the
    contact, or of the two R pairs, that place it.
    """

    group: Group
    steps: tuple[tuple[int, tuple[int, ...]], ...]

    @property
    def contacts(self) -> tuple[int, ...]:
        """The numbers of the pairs whose rolled lengths place a body."""
        return tuple(self.group.pairs[step[0]] for _, step in self.steps if len(step) == 1)

    def turns(
        self,
        within: Mapping[int, NDArray[Any]] | Sequence[NDArray[Any]],
        ends: Sequence[tuple[int, int]],
        joints: Sequence[Joint],
        frames: Frames,
    ) -> list[NDArray[Any]]:
        """Return the rotations (..., 3, 3) of the bodies, in their order, to the first.

        `within[link]` (..., 3, 3) are those of links in their bodies, of any real or
        complex numbers; `ends[pair]` the links and `joints[pair]` the joint of each pair.
        """
        turns: dict[int, NDArray[Any]] = {0: np.eye(3)}
        for body, places in self.steps:
            sides = []
            for place in places:
                pair = self.group.pairs[place]
                here = self.group.ends[place].index(body)
                links, bodies = ends[pair], self.group.ends[place]
                if pair in frames:
                    both = frames[pair]
                else:
                    joint = revolute(joints[pair])
                    both = joint.first, joint.second
                inside = within[links[here]] @ both[here]
                outside = within[links[1 - here]] @ both[1 - here]
                sides.append((inside, turns[bodies[1 - here]] @ outside))
            if len(sides) == 1:
                ((inside, outside),) = sides
                turns[body] = outside @ np.swapaxes(inside, -1, -2)
            else:
                (one, to_one), (other, to_other) = (
                    (inside[..., 2], outside[..., 2]) for inside, outside in sides
                )
                turned = taking(one, other, to_one, to_other)
                turns[body] = turned if np.iscomplexobj(to_one) else turned.real
        return [turns[body] for body in range(len(self.group.bodies))]


def train_of(
    mechanism: Mechanism,
    joints: Sequence[Joint],
    group: Group,
    rolled: Collection[int],
) -> WheelPlacement | None:
    """Return a group as a train, None if it cannot be placed body by body.

    `rolled` are the numbers of the variables that follow from the inputs alone.
    """
    steps: list[tuple[int, tuple[int, ...]]] = []
    placed = {0}
    left = set(range(1, len(group.bodies)))
    while left:
        step = next(
            (
                (body, places)
                for body in sorted(left)
                if (places := _holding(mechanism, joints, group, rolled, body, placed))
            ),
            None,
        )
        if step is None:
            return None
        steps.append(step)
        placed.add(step[0])
        left.remove(step[0])
    train = WheelPlacement(group, tuple(steps))
    return train if train.contacts else None


def _holding(
    mechanism: Mechanism,
    joints: Sequence[Joint],
    group: Group,
    rolled: Collection[int],
    body: int,
    placed: Collection[int],
) -> tuple[int, ...]:
    """Return the places of pairs that place a body beside those `placed`, or none."""
    axes: list[tuple[int, int, Floats]] = []
    for place, bodies in enumerate(group.ends):
        if body not in bodies or bodies[1 - bodies.index(body)] not in placed:
            continue
        pair, here = group.pairs[place], bodies.index(body)
        if not joints[pair].has_axis:
            if all(variable in rolled for variable in mechanism.variables_of(pair)):
                return (place,)
            continue
        joint = revolute(joints[pair])
        axis = (joint.first, joint.second)[here][:, 2]
        link = mechanism.ends[pair][here]
        for other, its_link, its_axis in axes:
            if its_link == link and np.linalg.norm(cross(axis, its_axis)) > COAXIAL:
                return other, place
        axes.append((place, link, axis))
    return ()
