"""Links and pairs of an imported model: bodies become links, hinges and loops pairs.

Links are numbered like the bodies of the model. Bodies that are rigidly joined form one
link, which has the number of one of these bodies; the ground has number 0. Links that are
no bodies, such as those between two hinges of one body, have the numbers after the last
body.
"""

import re
from collections.abc import Iterable, Sequence
from itertools import chain, count, groupby
from typing import NamedTuple

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import MAX_NAME_LENGTH
from spherekit.errors import FileError
from spherekit.exchange.axis_intersection import distances_to_lines, find_common_point
from spherekit.exchange.gear_couplings import IdlerWheel, ImportedPair
from spherekit.exchange.mujoco_file import MASSLESS_KG, ForeignModel, LoopPoint
from spherekit.exchange.short_decimals import round_to_short_decimal
from spherekit.mechanism.graph import component_labels
from spherekit.wording import listing

CENTRE_TOLERANCE = 1e-6
"""Largest distance of an axis from the centre, relative to the size of the model.

Larger: mechanisms that are not spherical are imported with wrong axes; smaller: models
whose file has few digits need the option ``within``.
"""

LISTED_DISTANCE_RATIO = 1e-3
"""Distances below this part of the allowed one are listed as 0 in the message on axes."""


class AxisLine(NamedTuple):
    """An axis of the imported model as a line, which has to pass the centre of the sphere.

    Attributes
    ----------
    name
        Name of the joint, or of the constraint that closes a loop, for messages.
    point
        (3,) a point of the line (m, world axes).
    direction
        (3,) unit vector along the line.
    """

    name: str
    point: Floats
    direction: Floats


class ImportedLinkage:
    """The links and pairs of a spherical mechanism that a model describes.

    Parameters
    ----------
    where
        The file, for messages.
    foreign_model
        The model.
    max_distance
        Distance (m) by which axes of joints may miss the centre of the sphere. By default
        this distance is `CENTRE_TOLERANCE` times the size of the model. The size is the
        distance of the farthest centre of mass, joint or loop point (where a loop is
        closed) from the mean of all these points.

    Attributes
    ----------
    link_by_body
        Number of the link of each body of the model, then the numbers of added links.
        Bodies that are rigidly joined form one link, which has the number of one of these
        bodies. The ground is 0.
    links
        Numbers of the links that have pairs, the ground first.
    pairs
        The R pairs.
    pair_comments
        Comments on pairs, by name.
    loop_points
        For each two links that are held together at points, these points.
    centre
        (3,) centre of the sphere (m, world axes).
    centre_distance
        Largest distance (m) of an axis from the centre.
    least_radius
        Distance (m) from the centre up to which a point counts as the centre, since its
        direction is only rounding.
    joint_limits
        Ends of the range (rad) of each limited joint, by its number.
    notes
        What was left out or changed, in sentences.

    Raises
    ------
    FileError
        If axes miss the centre or are parallel, a link is not joined to the ground, or
        nothing moves.
    """

    def __init__(
        self, where: str, foreign_model: ForeignModel, max_distance: float | None
    ) -> None:
        """Merge bodies into links, find the centre of the sphere, and list the pairs.

        A link is one or more bodies of the model that do not move relative to each other.
        Joints become R pairs of a spherical mechanism: their axes meet in the centre of the
        sphere.

        Parameters
        ----------
        where
            Name of the file, for messages.
        foreign_model
            The model, in a pose in which its loops are closed.
        max_distance
            Distance (m) by which axes may miss the centre; None for the default.
        """
        self.where = where
        self.foreign_model = foreign_model
        # The model and its state in the data types of MuJoCo.
        self._mj_model = foreign_model.mj_model
        self._mj_data = foreign_model.mj_data
        self.notes: list[str] = []  # what was left out or changed
        self.pair_comments: dict[str, str] = {}  # by names of pairs
        self._name_by_link: dict[int, str] = {}
        # Constraints of the file can lock a joint at a constant angle.
        self._turning_joints = [
            joint
            for joint in range(self._mj_model.njnt)
            if joint not in foreign_model.locked_joints
        ]
        # Ends of the range (rad) of each limited joint, by the number of the joint.
        limited_joints = np.flatnonzero(self._mj_model.jnt_limited).tolist()
        self.joint_limits: dict[int, Sequence[float]] = {
            joint: self._mj_model.jnt_range[joint].tolist() for joint in limited_joints
        }
        self.link_by_body = self._merge_bodies()  # number of the link of each body
        self.loop_points = self._group_loop_points()  # points at which loops are closed
        # The centre (3,), and the largest distance (m) of an axis from it.
        self.centre, self.centre_distance = self._find_centre(max_distance)
        # Points nearer to the centre than this distance (m) count as the centre.
        self.least_radius = max(
            self.centre_distance, CENTRE_TOLERANCE * self._measure_size()
        )
        # Each ball joint was replaced by three hinges. These hinges are left out if other
        # pairs connect the two links.
        self._removed_hinges = self._find_redundant_ball_hinges()
        self.pairs: list[ImportedPair] = []
        self._add_joint_pairs()
        self._add_loop_pairs()
        self._check_connected()
        # Links in the order in which pairs name them, the ground first.
        links_of_pairs = chain.from_iterable(pair.links for pair in self.pairs)
        self.links = list(dict.fromkeys([0, *links_of_pairs]))

    # Names

    def link_name(self, link: int) -> str:
        """Return the name of a link in the mechanism file: the name of its body.

        The ground has the name of the only body that is fixed to the world. If no or
        several bodies are fixed to the world, the ground is called "ground".
        """
        if link not in self._name_by_link:  # names are chosen at the first call
            # The number of a link is the number of one of its bodies.
            text = self.foreign_model.body_names[link]
            if link == 0:
                # Bodies that belong to the ground and have the world (body 0) as parent.
                ground_bodies = [
                    name
                    for body, name in enumerate(self.foreign_model.body_names)
                    if body
                    and self.link_by_body[body] == 0
                    and self._mj_model.body_parentid[body] == 0
                ]
                text = ground_bodies[0] if len(ground_bodies) == 1 else "ground"
            self._name_by_link[link] = self.make_unique_name(
                text, self._name_by_link.values()
            )
        return self._name_by_link[link]

    def make_unique_name(self, text: str, used_names: Iterable[str]) -> str:
        """Return a name for the mechanism file, made from a text, that is not in use yet.

        Characters that names can't have become underscores. A number is added if the name
        is in use. If the result differs from the text, a note says so.
        """
        name = re.sub(r"[^A-Za-z0-9_]", "_", text)[:MAX_NAME_LENGTH] or "unnamed"
        used = set(used_names)
        # Names are limited in length. Four characters remain for the numbers _2 to _999.
        stem = name[: MAX_NAME_LENGTH - 4]
        numbers = count(2)
        while name in used:
            name = f"{stem}_{next(numbers)}"
        if name != text:
            self.notes.append(f'"{text}" is called {name}')
        return name

    # Bodies that are one link

    def _merge_bodies(self) -> list[int]:
        """Return the number of the link of each body of the model.

        Bodies are one link if they are welded, or if no joint between them can turn. The
        number of the link is the number of one of its bodies; the ground is 0. A note is
        added for each locked joint.
        """
        mj_model = self._mj_model
        # In MuJoCo, each body except the world (0) has a parent body. The joints of a body
        # are between the body and its parent. Without a turning joint, body and parent are
        # one link.
        turning_bodies = {0, *mj_model.jnt_bodyid[self._turning_joints].tolist()}
        fixed_couples = [
            (mj_model.body_parentid[body], body)
            for body in range(mj_model.nbody)
            if body not in turning_bodies
        ]
        link_by_body = [*range(mj_model.nbody)]
        for couple in [*fixed_couples, *self.foreign_model.welded_bodies]:
            # All bodies of the link `merged` get the number of the link `remaining`.
            remaining, merged = (link_by_body[body] for body in couple)
            if merged == 0:  # The ground keeps its number.
                remaining, merged = merged, remaining
            link_by_body = [remaining if link == merged else link for link in link_by_body]
        for joint in sorted(self.foreign_model.locked_joints):
            joint_name = self.foreign_model.joint_names[joint]
            self.notes.append(f"joint {joint_name} is locked, so it does not become a pair")
        return link_by_body

    # The centre of the sphere

    def _group_loop_points(self) -> dict[tuple[int, int], list[LoopPoint]]:
        """Return the points at which two links are held together, grouped by these links.

        Each point closes a loop of the model. The two links of a group are in the order of
        its first point. A point between two bodies of the same link is left out.
        """
        points_by_links: dict[tuple[int, int], list[LoopPoint]] = {}
        for loop_point in self.foreign_model.loop_points:
            first_body, second_body = loop_point.bodies
            first_link = self.link_by_body[first_body]
            second_link = self.link_by_body[second_body]
            if first_link == second_link:
                continue
            links = (first_link, second_link)
            if links[::-1] in points_by_links:
                links = links[::-1]
            points_by_links.setdefault(links, []).append(loop_point)
        return points_by_links

    def _list_axis_lines(self) -> list[AxisLine]:
        """Return the axes that have to pass the centre of the sphere.

        These are the axes of all joints that can turn. Loops of the model are closed at
        points at which two links are held together. Two links with two such points can only
        turn about the line through them. This line is one of the axes.
        """
        # MuJoCo's xanchor is a point of the axis of a joint, xaxis its unit vector.
        lines = [
            AxisLine(
                f"joint {self.foreign_model.joint_names[joint]}",
                self._mj_data.xanchor[joint],
                self._mj_data.xaxis[joint],
            )
            for joint in self._turning_joints
        ]
        for first, *further_points in self.loop_points.values():
            for second in further_points:
                length = np.linalg.norm(second.point - first.point)
                if length > 0.0:
                    name = f"loop {first.name}"
                    if second.name != first.name:
                        name += f" through {second.name}"
                    direction = (second.point - first.point) / length
                    lines.append(AxisLine(name, first.point, direction))
        return lines

    def _find_centre(self, max_distance: float | None) -> tuple[Floats, float]:
        """Find the point in which all axes of the model meet: the centre of the sphere.

        Parameters
        ----------
        max_distance
            Distance (m) by which an axis may miss the point, None for the default.

        Returns
        -------
        The point (3,) in world axes, and the largest distance (m) of an axis from it.

        Raises
        ------
        FileError
            If all joints are locked, or the axes are parallel or do not meet in a point.
            In the last case the message lists the distances of all axes.
        """
        lines = self._list_axis_lines()  # the axes in the pose of the model
        if not lines:
            raise FileError(
                f"{self.where}: no link can move, because all joints are "
                "locked; release at least one joint"
            )
        points = np.array([line.point for line in lines])
        directions = np.array([line.direction for line in lines])
        size = self._measure_size()
        if max_distance is None:
            max_distance = CENTRE_TOLERANCE * size
        centre = find_common_point(points, directions, max_distance)
        if centre is None:
            axes = "both axes" if len(points) == 2 else f"all {len(points)} axes"
            raise FileError(
                f"{self.where}: {axes} are parallel: this is a planar "
                "mechanism, but the axes of a spherical mechanism meet in one point"
            )
        distances = distances_to_lines(centre, points, directions)
        largest_distance = np.max(distances)
        if largest_distance > max_distance:
            # The message lists the axes, the farthest first. Small distances are shown as
            # zero.
            centre_text = listing(
                round_to_short_decimal(coordinate, size) for coordinate in centre
            )
            least_listed = LISTED_DISTANCE_RATIO * max_distance
            distance_lines = ""
            for index in np.argsort(-distances, kind="stable"):
                distance = distances[index] if distances[index] > least_listed else 0.0
                distance_lines += f"\n  {lines[index].name}: {distance:.4g} m"
            passing_count = np.sum(distances <= max_distance)
            raise FileError(
                f"{self.where}: the axes do not meet in one point, so this is not a "
                f"spherical mechanism. {passing_count} of {len(distances)} axes pass "
                f"through the point {centre_text} m; the distances from it "
                f"are:{distance_lines}\nAllowed is {max_distance:.2g} m; give --within "
                "METRES if larger distances are rounding, or remove the other joints from "
                "a copy of the file"
            )
        return centre, largest_distance

    def _measure_size(self) -> float:
        """Return the distance (m) of the farthest point of the model from their mean.

        The points are centres of mass, joints, and points that close loops.
        """
        has_mass = self._mj_model.body_mass > MASSLESS_KG
        points = [*self._mj_data.xipos[has_mass], *self._mj_data.xanchor]
        points += [loop_point.point for loop_point in self.foreign_model.loop_points]
        offsets = points - np.mean(points, axis=0)
        size: float = np.max(np.linalg.norm(offsets, axis=1))
        return size or 1.0

    # Pairs

    def _find_redundant_ball_hinges(self) -> set[int]:
        """Return the indices of the hinges of ball joints that are to be left out.

        A ball joint was replaced by three hinges. The joint does not constrain its links,
        since all links turn about the centre of the sphere. The hinges would double the
        number of assembly modes (ways to assemble the links). The hinges are kept only if
        the links are not connected without the ball joint, directly or through further
        links.

        A note is added for each ball joint, whether it is left out or not.
        """
        removed_hinges: set[int] = set()
        connections = self._list_connections_without_balls()
        # Each link has the number of one of its bodies.
        max_link_count = self._mj_model.nbody
        for ball, hinges in self.foreign_model.hinges_by_ball.items():
            # All three hinges belong to the body that the ball joint joins to its parent.
            links = self._find_joined_links(self._mj_model.jnt_bodyid[hinges[0]])
            parent_link, child_link = links
            # Links have the same label if connections lead from one to the other.
            labels = component_labels(max_link_count, connections)
            if labels[parent_link] == labels[child_link]:
                removed_hinges |= set(hinges)
                self.notes.append(
                    f"ball joint {ball} left out: all links turn about the centre anyway"
                )
            else:
                connections.append(links)
                names = listing(self.foreign_model.joint_names[hinge] for hinge in hinges)
                self.notes.append(f"ball joint {ball} is three hinges, {names}")
        return removed_hinges

    def _list_connections_without_balls(self) -> list[tuple[int, int]]:
        """Return the couples of links that are joined directly, other than by a ball joint.

        All links of a spherical mechanism turn about the centre of the sphere, so a ball
        joint at the centre does not constrain them. The caller therefore leaves out a ball
        joint if its links are connected without it.

        Links are joined directly by joints between a body and its parent in MuJoCo's tree
        of bodies, or by loop points: common points at which the model holds two links
        together.
        """
        mj_model = self._mj_model
        # Each ball joint was replaced by three hinges, all between the same two bodies.
        bodies_on_balls = {
            int(mj_model.jnt_bodyid[hinges[0]])
            for hinges in self.foreign_model.hinges_by_ball.values()
        }
        # Body 0 is the world. All others have a parent.
        connections = [
            self._find_joined_links(body)
            for body in range(1, mj_model.nbody)
            if body not in bodies_on_balls
        ]
        for links, loop_points in self.loop_points.items():
            radii = [np.linalg.norm(point.point - self.centre) for point in loop_points]
            # A common point at the centre does not constrain the links either.
            if max(radii) > self.least_radius:
                connections.append(links)
        return connections

    def _find_joined_links(self, body: int) -> tuple[int, int]:
        """Return the links of the parent of a body and of the body itself."""
        parent = self._mj_model.body_parentid[body]
        return self.link_by_body[parent], self.link_by_body[body]

    def _add_pair(
        self,
        text: str,
        links: tuple[int, int],
        axis: Floats,
        value: float,
        joint: int = -1,
    ) -> str:
        """Add an R pair (revolute joint) to the list of pairs, and return its name.

        Parameters
        ----------
        text
            The name of the pair. A name that another pair has, or with characters that
            names in a mechanism file can't have, is changed.
        links
            Numbers of the first and the second link.
        axis
            (3,) unit vector in world axes about which the second link turns.
        value
            Variable (joint angle, rad) in the pose of the model.
        joint
            Number of the joint of the model. The number is -1 for a pair that is no joint
            in the model: a pair that closes a loop, or a pair that carries an idler wheel
            (a wheel added between two gears).
        """
        name = self.make_unique_name(text, (pair.name for pair in self.pairs))
        self.pairs.append(ImportedPair(name, links, axis, value, joint))
        return name

    def _add_joint_pairs(self) -> None:
        """Add the hinges of all bodies as pairs (joints) of the mechanism.

        A ball joint was replaced by three hinges. Its hinges are left out
        (`_removed_hinges`) if the links stay connected without it. A body may be joined to
        its parent by several hinges. These hinges become a chain of pairs, with a new link
        between each hinge and the next.
        """
        hinges = [
            joint for joint in self._turning_joints if joint not in self._removed_hinges
        ]
        body_by_joint = self._mj_model.jnt_bodyid.tolist()
        # Joints are numbered body by body, so `groupby` yields all hinges of each body.
        for body, joints_of_body in groupby(hinges, lambda joint: body_by_joint[joint]):
            joints = [*joints_of_body]
            first_link = self.link_by_body[self._mj_model.body_parentid[body]]
            body_link = self.link_by_body[body]
            if first_link == body_link:
                joint_names = listing(
                    self.foreign_model.joint_names[joint] for joint in joints
                )
                self.notes.append(f"joint {joint_names} cannot turn: its bodies are welded")
                continue
            for joint in joints:
                second_link = body_link
                joint_name = self.foreign_model.joint_names[joint]
                if joint != joints[-1]:
                    body_name = self.foreign_model.body_names[body]
                    second_link = self._add_link(f"{body_name}_{joint_name}")
                axis = self._mj_data.xaxis[joint]  # unit vector in world axes
                # Joint angle (rad). All joints are hinges, so each has one position.
                value = self._mj_data.qpos[joint]
                self._add_pair(joint_name, (first_link, second_link), axis, value, joint)
                first_link = second_link

    def _add_link(self, text: str) -> int:
        """Add a link that is no body, called by a text, and return its number."""
        link = len(self.link_by_body)
        self.link_by_body.append(link)
        self._name_by_link[link] = self.make_unique_name(text, self._name_by_link.values())
        return link

    def _add_loop_pairs(self) -> None:
        """Add a pair (joint) for each two links that are held together at points.

        Such points close the loops of the model. Both links turn about the centre of the
        sphere, so a common point joins them like an R pair (revolute joint) with its axis
        from the centre to the point. Of several points, the farthest one gives the most
        accurate direction.
        """
        for links, points in self.loop_points.items():
            arms = np.array([point.point for point in points]) - self.centre
            radii = np.linalg.norm(arms, axis=1)
            farthest = np.argmax(radii)
            # Within `least_radius` of the centre, a point has no reliable direction.
            if radii[farthest] <= self.least_radius:
                self.notes.append(
                    f"loop {points[farthest].name} left out: it holds the centre, which "
                    "does not move"
                )
                continue
            # The pair has the name of the first constraint that holds the two links. The
            # file may state the pair variable (rad) under this name.
            loop_name = points[0].name
            value = self.foreign_model.loop_values.get(loop_name, 0.0)
            axis = arms[farthest] / radii[farthest]
            pair_name = self._add_pair(loop_name, links, axis, value)
            link_names = " and ".join(map(self.link_name, links))
            self.pair_comments[pair_name] = f"Closes a loop: holds {link_names} at a point."

    def _check_connected(self) -> None:
        """Raise `FileError` unless pairs join all links to the ground, directly or not."""
        if not self.pairs:
            raise FileError(
                f"{self.where}: no link can move, because all bodies are welded together"
            )
        links_of_pairs = [pair.links for pair in self.pairs]
        part_of_link = component_labels(len(self.link_by_body), links_of_pairs)
        # Connected links form one component of the graph. The component of the ground has
        # the number 0.
        separate_links = {
            link for links in links_of_pairs for link in links if part_of_link[link]
        }
        if separate_links:
            raise FileError(
                f"{self.where}: link {listing(map(self.link_name, separate_links))} is not "
                "joined to the ground"
            )

    def add_idler_wheels(self, idlers: Sequence[IdlerWheel]) -> None:
        """Add idler wheels of gears as links, each on a pair of its carrier.

        An idler wheel meshes with two coaxial wheels and turns on their carrier link.
        """
        for number, idler in enumerate(idlers, 1):
            link = self._add_link(f"idler_{number}")
            self.links.append(link)
            pair_name = self._add_pair(
                f"idler_axis_{number}",
                links=(idler.carrier, link),
                axis=idler.axis,
                value=0.0,  # joint angle in the pose of the model
            )
            self.pair_comments[pair_name] = (
                "The idler wheel was added: two coaxial wheels need one for a ratio."
            )
