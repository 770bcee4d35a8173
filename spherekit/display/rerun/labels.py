"""The eye from which the sphere is seen, and the places of the names of links and pairs.

Names are placed so that they cover each other as little as possible.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spherekit.arrays import Floats
from spherekit.geometry.rotation import from_quaternion
from spherekit.geometry.vectors import all_finite, unit_rows
from spherekit.scenes.scene import Body

EYE_DISTANCE = 3.0
"""Distance of the eye from the centre of the sphere, in radii."""

EYE_OFFSET = 0.3
"""Tangent of the angle between the direction to the eye and the middle of the mechanism.

The mechanism is seen a little from the side, so that arcs in its middle plane show.
"""

DEFAULT_FOCUS = (0.76, 0.47, 0.44)
"""Direction of view for a mechanism whose axes have no middle."""

STEEP_COSINE = 0.8
"""Size of the cosine of the angle between focus and z axis above which -x is up, not z."""

PAIR_NAME_RADIUS = 1.09
LINK_NAME_RADIUS = 1.15
"""Distances of names from the centre of the sphere."""

PAIR_NAME_ANGLES_RAD = np.array([0.07, 0.11, 0.16, 0.22, 0.3])
"""Possible angles between the axis of a pair and the pair's name, the nearest first."""

MIN_AWAY_LENGTH = 0.07
"""Shortest vector that is used as the direction away from the other axes of a link.

The vector is the negative sum of the unit vectors of these axes, at right angles to the
axis of the name. Larger: more names are placed on an arbitrary side of their axis. Smaller:
a tiny change of the axes can move a name to the other side.
"""

PAIR_NAME_DIRECTIONS_RAD = np.radians(
    [0, 30, -30, 60, -60, 90, -90, 120, -120, 150, -150, 180]
)
"""Possible directions from an axis to its name; 0 leads away from the link's other axes."""

LINK_NAME_FRACTIONS = np.array([0.5, 0.4, 0.6, 0.3, 0.7, 0.2, 0.8])
"""Possible positions of the name of a link along its longest arc."""

COAXIAL_COSINE = np.cos(np.radians(4.0))
"""Cosine above which axes of pairs on one link share a name."""

MAX_PICTURES = 60
"""Number of configurations in which it is tested whether names cover each other."""

NAME_LETTER_HALF_WIDTH = 0.016
NAME_HALF_HEIGHT = 0.045
"""Half the size of a letter, in radii of the sphere, as the eye sees it."""

NAME_DROP = 0.055
"""Distance by which the viewer writes a name below its place."""

DOT_HALF_SIZE = 0.03
"""Half the size of the dot that marks the axis of a pair."""

DOT_COST = 0.1
"""Cost of covering the dot of a pair; covering a name costs 1."""

NEXT_PLACE_COST = 0.005
"""Cost of each further place in the list of possible places, so near places win."""

FIRST_PICTURE_WEIGHT = 0.5
"""Weight of the first picture in the cost; the mean of all pictures has the remainder."""

Name = tuple[str, Floats, bool]
"""A name, its place (3,) in the axes of its link, and whether it is the name of a pair."""

Sight = tuple[Floats, Floats, Floats]
"""The eye, the point that it looks at, and the direction that is up, each (3,)."""


@dataclass(frozen=True)
class _Box:
    """The rectangle that a name, or the dot of a pair axis, covers in the viewer's window.

    Names are placed where they cover few of these rectangles. A picture is the mechanism in
    one configuration, seen from the eye of the viewer. The rectangle moves from picture to
    picture, because the name or dot is fixed to a link. Lengths are in radii of the sphere.

    Attributes
    ----------
    cost
        Cost of covering this rectangle with another name: 1 for a name, `DOT_COST` for a
        dot.
    centres
        (pictures, 2) its centre in each picture: coordinates to the right and up.
    half_size
        (2,) half its width and height.
    """

    cost: float
    centres: Floats
    half_size: Floats


@dataclass(frozen=True)
class _NameRequest:
    """A name that needs a place in the view of a mechanism, and the places to choose from.

    The name is fixed to a link and moves with it. The chosen place is one at which the name
    covers few other names in several pictures (the mechanism in one configuration each).

    Attributes
    ----------
    path
        Path of the link that shows the name, in the tree of the recording.
    text
        The name of a link, or the names of one or more pairs (joints).
    is_pair
        Whether it is the name of a pair.
    places
        (k, 3) possible places in the axes of the link. If several cover equally little, the
        first of them is chosen.
    centres
        (pictures, k, 2) the middle of the name in each picture, for each possible place:
        coordinates to the right and up.
    """

    path: str
    text: str
    is_pair: bool
    places: Floats
    centres: Floats


def facing(focus: Floats | None) -> Sight:
    """Return the eye, its target and the upward direction for a view of a mechanism.

    The eye is outside of the sphere, on the side on which the middle of the mechanism is.
    It looks nearly at the centre of the sphere. The z axis is up. If the middle is near the
    z axis, -x is up, so that the picture is not twisted.

    Parameters
    ----------
    focus
        (3,) direction from the centre of the sphere to the middle of the mechanism. None:
        `DEFAULT_FOCUS`.
    """
    focus = unit_rows(np.array(DEFAULT_FOCUS if focus is None else focus))
    up = np.array([0.0, 0.0, 1.0] if abs(focus[2]) < STEEP_COSINE else [-1.0, 0.0, 0.0])
    # The eye is moved sideways and upwards from the direction of the focus, so that the
    # picture shows the depth of the mechanism. The offset has the length `EYE_OFFSET`.
    sideways = unit_rows(np.cross(focus, up))
    upwards = np.cross(sideways, focus)
    eye = focus + EYE_OFFSET * (0.8 * sideways + 0.6 * upwards)
    target = 0.1 * focus  # nearly the centre of the sphere
    return EYE_DISTANCE * unit_rows(eye), target, up


def project(sight: Sight, points: Floats) -> Floats:
    """Return the perspective image (..., 2) of points (..., 3), to the right and up.

    `sight` is the position of the eye, the target that it looks at, and the direction up. A
    point at the vector p from the eye is imaged at d (p . right, p . up) / (p . forward). d
    is the distance of the target from the eye, so that lengths at the target keep their
    size.
    """
    eye, target, up = sight
    view_vector = target - eye
    distance = np.linalg.norm(view_vector)
    forward = view_vector / distance
    right = unit_rows(np.cross(forward, up))
    picture_axes = np.stack([right, np.cross(right, forward)], axis=-1)  # columns: x, y
    from_eye = points - eye
    return distance * (from_eye @ picture_axes) / (from_eye @ forward)[..., None]


class Names:
    """Chooses places for the names of links and joints on one page.

    The names should cover each other little. Each name is placed away from the names and
    dots that were placed before it.
    """

    def __init__(self, sight: Sight) -> None:
        """Begin without names, for a viewer whose eye is at the given place."""
        self._sight = sight
        self._named_pairs: set[str] = set()  # pairs that a link names already
        self._obstacles: list[_Box] = []  # areas covered by names and dots so far

    def place_names(self, bodies: Sequence[Body]) -> dict[str, list[Name]]:
        """Return the names that links show, each with the point at which it is written.

        A name moves with its link. So the function computes where names are in several
        pictures (perspective images of the mechanism in a few configurations). A possible
        place of a name has a high cost if the name would cover other names there, or the
        dots that mark pair axes. The place with the lowest cost is chosen. Long names are
        placed first, because space for them is hardest to find.

        Parameters
        ----------
        bodies
            The links, at rest or with their orientations in all rows (samples).

        Returns
        -------
        By the path of each link in the recording: the names of the link itself, and of its
        pairs (joints) that no other link shows.
        """
        # A request is a name of a link or pair with the places to choose from.
        requests: list[_NameRequest] = []
        # For each link its orientations (pictures, 3, 3) in the pictures.
        rotations_of_bodies = _picture_rotations(bodies)
        for body, rotations in zip(bodies, rotations_of_bodies, strict=True):
            # Names should not cover the dots that mark the pair axes.
            self._obstacles += self._dot_boxes(body, rotations)
            requests += self._pair_name_requests(body, rotations)
            requests += self._link_name_requests(body, rotations)
        requests.sort(key=lambda request: -len(request.text))

        names: dict[str, list[Name]] = {body.path: [] for body in bodies}
        for request in requests:
            best = int(np.argmin(self._place_costs(request)))
            name = (request.text, request.places[best], request.is_pair)
            names[request.path].append(name)
            # Names that follow avoid the rectangle of this name. `centres` are its middles
            # in all pictures.
            box = _Box(
                cost=1.0,
                centres=request.centres[:, best],
                half_size=_name_half_size(request.text),
            )
            self._obstacles.append(box)
        return names

    def _dot_boxes(self, body: Body, rotations: Floats) -> list[_Box]:
        """Return the rectangles of the dots that mark the pair axes of a link.

        Names are placed so that they cover few of these dots.

        Parameters
        ----------
        body
            The link. Its `joints` are the unit vectors of its pair axes in its own frame.
        rotations
            (pictures, 3, 3) its orientation in each picture (a configuration of the
            mechanism).
        """
        boxes = []
        for axis in body.joints:
            dots = project(self._sight, np.einsum("nij,j->ni", rotations, axis))
            boxes.append(_Box(DOT_COST, dots, np.full(2, DOT_HALF_SIZE)))
        return boxes

    def _place_costs(self, request: _NameRequest) -> Floats:
        """Return the costs (k,) of the k possible places of a name. The lowest is best.

        The cost of a place is the sum of

        - for each name that has a place already, the share of pictures in which the new
          name would cover it;
        - the same share for the dots that mark the pair axes, times `DOT_COST`;
        - a small amount for each place that comes before this place in the list.
        """
        costs: Floats = np.arange(len(request.places), dtype=float) * NEXT_PLACE_COST
        for obstacle in self._obstacles:
            costs += obstacle.cost * _covered_shares(request, obstacle)
        return costs

    def _pair_name_requests(self, body: Body, rotations: Floats) -> list[_NameRequest]:
        """Return requests for places of the names of a link's pairs (joints).

        A request has a name and several possible places on the link. `place_names` later
        chooses the place at which the name covers few other names. A pair belongs to two
        links, so pairs that another link already names are left out. Pairs with nearly the
        same axis share one name, such as "A, B".

        Parameters
        ----------
        body
            The link. Its `joints` are unit vectors of its pair axes in its own frame.
        rotations
            (pictures, 3, 3) its orientation in each picture (a configuration of the
            mechanism).
        """
        # Each name has a text, and an axis beside which it is written.
        axes: list[Floats] = []
        texts: list[str] = []
        for axis, label in zip(body.joints, body.joint_labels, strict=True):
            if not label or label in self._named_pairs:
                continue
            self._named_pairs.add(label)
            coaxial = [
                index
                for index, named_axis in enumerate(axes)
                if named_axis @ axis > COAXIAL_COSINE
            ]
            if coaxial:
                texts[coaxial[0]] += f", {label}"
            else:
                axes.append(axis)
                texts.append(label)
        requests = []
        for text, axis in zip(texts, axes, strict=True):
            # Possible places (k, 3) of the name on the link, in the frame of the link. At
            # each of them, the middle (pictures, k, 2) of the text in the pictures.
            places = PAIR_NAME_RADIUS * _places_around(axis, body.joints)
            centres = self._centres(rotations, places)
            requests.append(
                _NameRequest(body.path, text, is_pair=True, places=places, centres=centres)
            )
        return requests

    def _link_name_requests(self, body: Body, rotations: Floats) -> list[_NameRequest]:
        """Return a request for a place of the name of a link, at the link's longest arc.

        The request has several possible places along the arc. `place_names` later chooses
        the place at which the name covers few other names. The list is empty if the link
        has no name or no arc.

        Parameters
        ----------
        body
            The link. Its `curves` are its arcs in its own frame.
        rotations
            (pictures, 3, 3) its orientation in each picture (a configuration of the
            mechanism).
        """
        if not len(body.curves) or not body.label:
            return []
        longest_arc = np.asarray(max(body.curves, key=_curve_length))  # (points, 3)
        last = len(longest_arc) - 1
        point_numbers = np.round(LINK_NAME_FRACTIONS * last).astype(int)
        # Possible places (k, 3) in the axes of the link. For each of them, the middle
        # (pictures, k, 2) of the name in the plane of the picture.
        places = LINK_NAME_RADIUS * longest_arc[point_numbers]
        centres = self._centres(rotations, places)
        return [
            _NameRequest(
                body.path, body.label, is_pair=False, places=places, centres=centres
            )
        ]

    def _centres(self, rotations: Floats, places: Floats) -> Floats:
        """Return the centres (pictures, k, 2) of names at places (k, 3) of a link."""
        points = np.einsum("nij,kj->nki", rotations, places)
        return project(self._sight, points) - np.array([0.0, NAME_DROP])


def _covered_shares(request: _NameRequest, obstacle: _Box) -> Floats:
    """Return the share of pictures in which a name would cover an obstacle, by place.

    A picture is the mechanism in one configuration. The first picture, which the viewer
    shows at the start, has half of the weight. The mean over all pictures has the other
    half.

    Parameters
    ----------
    request
        The name, with k possible places.
    obstacle
        The rectangle of another name, or of the dot of a pair axis.

    Returns
    -------
    (k,) weighted shares of pictures, from 0 to 1.
    """
    # Two rectangles overlap if, to the right and up, their centres are nearer than the sum
    # of their half sizes.
    obstacle_centres = obstacle.centres[:, None, :]  # the same for all places
    distance = np.abs(request.centres - obstacle_centres)  # (pictures, k, 2)
    largest_distance = _name_half_size(request.text) + obstacle.half_size
    covers = np.all(distance < largest_distance, axis=-1)  # (pictures, k)
    in_first_picture = FIRST_PICTURE_WEIGHT * covers[0]
    mean = np.count_nonzero(covers, axis=0) / len(covers)
    in_all_pictures = (1.0 - FIRST_PICTURE_WEIGHT) * mean
    return in_first_picture + in_all_pictures


def _name_half_size(text: str) -> Floats:
    """Return half the width and height (2,) of a name as it is seen."""
    return np.array([NAME_LETTER_HALF_WIDTH * (len(text) + 1), NAME_HALF_HEIGHT])


def _picture_rotations(bodies: Sequence[Body]) -> list[Floats]:
    """Return the rotations (pictures, 3, 3) of each link in a few configurations.

    The configurations are called pictures, and are the same for all links. Names are placed
    where they cover each other little in the pictures. The pictures are `MAX_PICTURES`
    evenly spaced rows (samples) of the motion, out of those in which all links have an
    orientation. If there are fewer such rows, some occur several times. A link at rest gets
    a single identity matrix, and so do all links if there is no such row.
    """
    at_rest = np.eye(3)[None]
    moving = [body.quaternions for body in bodies if body.quaternions is not None]
    if not moving:
        return [at_rest] * len(bodies)
    # Axes of `moving`: link, row, component of the quaternion.
    valid_rows = np.flatnonzero(all_finite(moving, (0, 2)))
    if not len(valid_rows):
        return [at_rest] * len(bodies)
    spaced = np.linspace(0, len(valid_rows) - 1, MAX_PICTURES).astype(int)
    rows = valid_rows[spaced]
    return [
        at_rest if body.quaternions is None else from_quaternion(body.quaternions[rows])
        for body in bodies
    ]


def _places_around(axis: Floats, pair_axes: Floats) -> Floats:
    """Return possible places of a name around the axis of a pair, on the unit sphere.

    The places are on circles around the axis. On each circle, the angle f is counted from
    the direction a, which leads away from the other axes of the link. The unit vector b is
    at right angles to the axis and to a. A place at the angle r from the axis is

        cos(r) axis + sin(r) (cos(f) a + sin(f) b).

    Parameters
    ----------
    axis
        (3,) axis of the pair in the frame of its link.
    pair_axes
        (n, 3) axes of all pairs of the link.

    Returns
    -------
    (k, 3) places, the nearest first. Among places at one distance, the first is away from
    the other axes (f = 0), and the size of f grows from there.
    """
    away = _direction_away(axis, pair_axes)  # a
    across = np.cross(axis, away)  # b
    cosines_sines = np.stack(
        [np.cos(PAIR_NAME_DIRECTIONS_RAD), np.sin(PAIR_NAME_DIRECTIONS_RAD)], axis=1
    )
    # (directions, 3) cos(f) a + sin(f) b
    directions = cosines_sines @ np.array([away, across])
    # (distances, directions, 3) places
    angles = PAIR_NAME_ANGLES_RAD[:, None, None]
    places = np.cos(angles) * axis + np.sin(angles) * directions
    return np.reshape(places, (-1, 3))


def _direction_away(axis: Floats, pair_axes: Floats) -> Floats:
    """Return the direction from the axis of a pair away from the other axes of its link.

    The name of the pair is preferably placed on this side of its axis. The result is a unit
    vector (3,) at right angles to the axis. If there are no other axes, or if they lie
    evenly around this axis, there is no such direction. Then an arbitrary one is returned.

    Parameters
    ----------
    axis
        (3,) axis of the pair in the frame of its link.
    pair_axes
        (n, 3) axes of all pairs of the link.
    """
    away = -np.sum(pair_axes, axis=0)
    # Remove the part along the axis.
    away = away - (away @ axis) * axis
    if np.linalg.norm(away) < MIN_AWAY_LENGTH:
        # The coordinate axis that makes the largest angle with the axis.
        coordinate_axis = np.eye(3)[np.argmin(np.abs(axis))]
        away = np.cross(axis, coordinate_axis)
    return unit_rows(away)


def _curve_length(curve: Floats) -> float:
    """Return the length of a polyline (n, 3)."""
    return float(np.linalg.norm(np.diff(curve, axis=0), axis=1).sum())
