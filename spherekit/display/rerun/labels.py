"""From where the sphere is seen, and where names of links and pairs stand on it.

None covers another where that is possible.
"""

from collections.abc import Sequence

import numpy as np

from spherekit.arrays import Floats
from spherekit.geometry.rotation import from_quaternion
from spherekit.geometry.vectors import all_finite, unit_rows
from spherekit.scenes.scene import Body

DISTANCE = 3.0
LOOKS_ASIDE = 0.3
"""Tangent of the angle between the eye's direction and the middle of the mechanism."""
DEFAULT_FOCUS = (0.76, 0.47, 0.44)
STEEP = 0.8
"""A focus nearer to the z axis than this cosine is seen with x up instead of z."""

HEIGHT = 1.09
LINK_HEIGHT = 1.15
ASIDE = np.array([0.07, 0.11, 0.16, 0.22, 0.3])
"""Angles (rad) between an axis and its name, the nearest first."""
TURNS = np.radians([0, 30, -30, 60, -60, 90, -90, 120, -120, 150, -150, 180])
"""Ways from an axis to its name, from the one that leads away from the link's others."""
ALONG = np.array([0.5, 0.4, 0.6, 0.3, 0.7, 0.2, 0.8])
"""Parts of a link's longest arc at which its name may stand."""
NEAR = np.cos(np.radians(4.0))
"""Pairs of a link with axes closer than this have one name."""
MOST_PICTURES = 60
LETTER = 0.016
"""Half the width of a letter as it is seen first, in radii of the sphere."""
LINE = 0.045
"""Half the height of a name."""
DROP = 0.055
"""The viewer writes a name so far below its place."""
DOT = 0.03
DOT_WEIGHT = 0.1
"""What covering the axis of a pair costs; the name of one costs 1."""
FARTHER = 0.005
"""What the next of the places for a name costs, in parts of pictures in which it covers."""
FIRST = 0.5
"""What the first picture counts."""


_Taken = tuple[float, Floats, Floats]
"""What covering a box costs; its middles (n, 2) on the pictures; half its sides (2,)."""


Name = tuple[str, Floats, bool]
"""A name, its place (3,) in the axes of its link, and whether it is that of a pair."""

_Wanted = tuple[str, str, bool, Floats, Floats]
"""The path of a link, a name of it or of a pair, which is said, that looks for its place
among some (k, 3), the best first, and the middles of its box on the pictures (n, k, 2)."""


Sight = tuple[Floats, Floats, Floats]
"""An eye, the point that it looks at, and what is up for it, each (3,)."""


def facing(focus: Floats | None) -> Sight:
    """Return what faces the mechanism a little from the side, with z up where possible."""
    focus = unit_rows(np.array(DEFAULT_FOCUS if focus is None else focus))
    up = np.array([0.0, 0.0, 1.0] if abs(focus[2]) < STEEP else [-1.0, 0.0, 0.0])
    right = unit_rows(np.cross(focus, up))
    eye = focus + LOOKS_ASIDE * (0.8 * right + 0.6 * np.cross(right, focus))
    return DISTANCE * unit_rows(eye), 0.1 * focus, up


def seen(sight: Sight, points: Floats) -> Floats:
    """Return where points (..., 3) are on the picture (..., 2), as long as there."""
    eye, target, up = sight
    way = target - eye
    distance = np.linalg.norm(way)
    forward = way / distance
    right = unit_rows(np.cross(forward, up))
    across = np.stack([right, np.cross(right, forward)], axis=-1)
    from_eye = points - eye
    return distance * (from_eye @ across) / (from_eye @ forward)[..., None]


def _half(words: str) -> Floats:
    """Return half the width and height of a name's box."""
    return np.array([LETTER * (len(words) + 1), LINE])


class Names:
    """The names that a page shows: places of those given, which others keep off."""

    def __init__(self, sight: Sight) -> None:
        """Begin without names."""
        self._sight = sight
        self._given: set[str] = set()
        self._taken: list[_Taken] = []

    def give(self, bodies: Sequence[Body]) -> dict[str, list[Name]]:
        """Return the names of links by their paths, in one picture or more of them.

        A name keeps its place in its link over all pictures: the one of a few that
        covers others in the fewest of them, the first of which counts most; the
        nearest of equals. Wide names choose first.
        """
        wanted: list[_Wanted] = []
        for body, turn in zip(bodies, _rotations(bodies), strict=True):
            for axis in body.joints:
                dot = seen(self._sight, np.einsum("nij,j->ni", turn, axis))
                self._taken.append((DOT_WEIGHT, dot, np.full(2, DOT)))
            wanted += self._of_pairs(body, turn) + self._of_link(body, turn)
        names: dict[str, list[Name]] = {body.path: [] for body in bodies}
        wanted.sort(key=lambda name: -len(name[1]))
        for path, words, of_pair, places, middles in wanted:
            cost = FARTHER * np.arange(len(places))
            for weight, taken, half in self._taken:
                near = np.abs(middles - taken[:, None]) < _half(words) + half
                covers = np.all(near, axis=-1)
                part = FIRST * covers[0] + (1.0 - FIRST) * np.mean(covers, axis=0)
                cost += weight * part
            k = np.argmin(cost)
            self._taken.append((1.0, middles[:, k], _half(words)))
            names[path].append((words, places[k], of_pair))
        return names

    def _of_pairs(self, body: Body, turn: Floats) -> list[_Wanted]:
        axes: list[Floats] = []
        words: list[str] = []
        for axis, label in zip(body.joints, body.joint_labels, strict=True):
            if not label or label in self._given:
                continue
            self._given.add(label)
            near = [k for k, other in enumerate(axes) if other @ axis > NEAR]
            if near:
                words[near[0]] += f", {label}"
            else:
                axes.append(axis)
                words.append(label)
        around = [HEIGHT * _around(axis, body.joints) for axis in axes]
        return [
            (body.path, text, True, places, self._middles(turn, places))
            for text, places in zip(words, around, strict=True)
        ]

    def _of_link(self, body: Body, turn: Floats) -> list[_Wanted]:
        if not len(body.curves) or not body.label:
            return []
        longest = np.asarray(max(body.curves, key=_length))
        places = LINK_HEIGHT * longest[np.round(ALONG * (len(longest) - 1)).astype(int)]
        return [(body.path, body.label, False, places, self._middles(turn, places))]

    def _middles(self, turn: Floats, places: Floats) -> Floats:
        """Return where names at places (k, 3) of a link are on the pictures (n, k, 2)."""
        turned = np.einsum("nij,kj->nki", turn, places)
        return seen(self._sight, turned) - np.array([0.0, DROP])


def _rotations(bodies: Sequence[Body]) -> list[Floats]:
    """Return the rotations (n, 3, 3) of links in the same few pictures; one if at rest."""
    moving = [body.quaternions for body in bodies if body.quaternions is not None]
    still = np.eye(3)[None]
    good = np.flatnonzero(all_finite(moving, (0, 2))) if moving else moving
    if not len(good):
        return [still] * len(bodies)
    few = good[np.linspace(0, len(good) - 1, MOST_PICTURES).astype(int)]
    return [
        still if body.quaternions is None else from_quaternion(body.quaternions[few])
        for body in bodies
    ]


def _around(axis: Floats, joints: Floats) -> Floats:
    """Return places (k, 3) beside an axis of a link, those away from its others first."""
    away = -np.sum(joints, axis=0)
    away = away - (away @ axis) * axis
    if np.linalg.norm(away) < ASIDE[0]:
        away = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    away = unit_rows(away)
    across = np.array([away, np.cross(axis, away)])
    ways = np.stack([np.cos(TURNS), np.sin(TURNS)], axis=1) @ across
    far = ASIDE[:, None, None]
    return np.reshape(np.cos(far) * axis + np.sin(far) * ways, (-1, 3))


def _length(curve: Floats) -> float:
    return float(np.linalg.norm(np.diff(curve, axis=0), axis=1).sum())
