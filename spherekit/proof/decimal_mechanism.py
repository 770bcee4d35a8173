"""A mechanism as its file writes it, with wheels whose rotation follows from the inputs.

Rolling contacts of circles relate the angles of R pairs (`planning.gear_train`). If the
inputs determine the angle of a pair through these relations, the pair is a follower: its
angle is known, like that of an input. A file states the distance of the axes of two wheels
twice: by the sizes of their carrier, and by the radii of the wheels. Decimal numbers can
state both only approximately, so circles that nearly touch count as touching.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from spherekit.arrays import Array
from spherekit.errors import PlanError
from spherekit.files.mechanism_reader import read
from spherekit.files.mechanism_writer import dumps
from spherekit.files.toml_document import Document, parse
from spherekit.mechanism.coaxial_links import SAME_AXIS_RAD
from spherekit.mechanism.elements import PoseGeometry
from spherekit.mechanism.joint_construction import make_joints
from spherekit.mechanism.mechanism import Mechanism
from spherekit.planning.assembly_plan import driven_pairs
from spherekit.planning.gear_mesh import (
    GearMesh,
    PairPath,
    find_carried_contact,
    reverse_path,
)
from spherekit.planning.gear_train import find_gear_train
from spherekit.proof.ball_frames import Frame, Vector, exact_ball, exact_balls
from spherekit.proof.balls import (
    Ball,
    centre_float,
    centre_floats,
    lower_magnitude,
    pi_ball,
    polar_angle,
    solve_balls,
    upper_magnitude,
)
from spherekit.proof.decimal_geometry import CircleContact, DecimalGeometry
from spherekit.proof.structure import Structure, extract_structure
from spherekit.wording import listing

TOLERANCE_LIMIT_RAD = 0.1
"""Tolerances of sizes of this angle (6 deg) or more are taken for mistakes and refused."""

WHOLE_TURN_TOLERANCE = 1e-6
"""A number of turns counts as whole if a ball of it comes this close to an integer.

Larger: wheels may be counted with a wrong number of turns. Smaller: rounding of the float64
plan of the wheels is refused.
"""

MAX_TURN_ERROR = 0.25
"""Largest deviation of a number of turns from an integer that its ball may contain.

Larger: a ball may contain two integers, of which one is taken. Smaller: a large tolerance
of the sizes is refused.
"""

MAX_GEAR_RATIO_DENOMINATOR = 10**6
"""Largest denominator of a gear ratio that is reconstructed from a ball.

Larger: balls of 80 bits may contain several such fractions. Smaller: trains of many large
gears have no exact ratio.
"""


@dataclass(frozen=True)
class DecimalMechanism(DecimalGeometry):
    """A mechanism of R pairs and wheels with the decimal sizes of its file.

    Each sliding contact of circles is replaced by a coupler: a link joined by R pairs at
    the centres of both circles. The links and R pairs of the mechanism, together with the
    couplers and their R pairs, are the *structure*. Links and pairs have other indices in
    the structure than in the mechanism.

    Attributes
    ----------
    structure
        The links and R pairs.
    meshes
        The rolling contacts, each with its carrier: the link that carries both wheels.
    rolled_lengths
        For each mesh, the approximate lengths (rad) along both circles that have rolled in
        the position in which all pair angles are zero. The exact lengths follow from the
        azimuths of the contacts, which are known up to whole turns. The approximate lengths
        only select these turns.
    """

    structure: Structure
    meshes: Sequence[GearMesh] = ()
    rolled_lengths: Sequence[Sequence[float]] = ()

    def pair_frames(self) -> list[tuple[Frame, Frame]]:
        """Return two frames for every pair of the structure: one in each of its two links.

        The structure says which links the pairs join, without sizes. Its pairs are the
        revolute pairs of the mechanism, then two for each coupler. A coupler is a link that
        replaces a sliding contact of two circles. Revolute pairs join it to both links at
        the centres of the circles.

        A frame (3, 3) has three unit vectors x, y and z as rows. z is the axis of the pair,
        and the pair angle is counted from x. All numbers are balls (numbers with a bound of
        their error).
        """
        revolute_frames = self.revolute_frames()
        frames = [
            revolute_frames[name]
            for name in self.structure.pairs
            if name in revolute_frames
        ]
        # The sliding contacts, each replaced by a coupler.
        for contact in self.structure.couplers:
            circle_contact = self.circle_contact(contact)
            frames += zip(
                circle_contact.frames, _coupler_frames(circle_contact), strict=True
            )
        return frames

    def known_angles(self, inputs: Sequence[Ball]) -> list[Ball]:
        """Return the angles (rad) of the inputs, then the angles of the followers.

        Followers are the pairs (joints) that the inputs drive through wheels. A mesh is two
        wheels that roll on each other, and a carrier: the link that carries both. The first
        wheel has the angular radius r1 and turns by a1 relative to the carrier, the second
        one has r2 and turns by a2. In external contact one of these angles is counted in
        the opposite sense. Both wheels roll the same length, so

            sin(r1) a1 - sin(r2) a2 = constant.

        Numbers of teeth can replace the sines, because they have the same ratio. Each angle
        a1 or a2 is a signed sum of the angles of the revolute pairs between wheel and
        carrier. So each mesh gives one linear equation of pair angles, and all meshes
        together give

            relations @ angles = constants.

        Parameters
        ----------
        inputs
            Angle (rad) of each input, in the order of `structure.inputs`. All angles are
            balls: numbers with a bound of their error.
        """
        if not self.meshes:
            return [*inputs]
        structure = self.structure
        relations = self._mesh_relations()
        # The constants follow from one position of the wheels that the file describes. This
        # is either a reference pose with its pair angles, or the position in which all pair
        # angles are 0. For the latter, the lengths rolled by the wheels are computed.
        if isinstance(self.mechanism.geometry, PoseGeometry):
            constants = self._constants_from_pose(relations)
        else:
            constants = self._constants_from_rolled_lengths()
        # The terms of the inputs are known. The equations then give the followers.
        right_side = constants - relations[:, structure.inputs] @ np.array(inputs)
        followers = self._solve_followers(relations, right_side[:, None])[:, 0]
        return [*inputs, *followers]

    def _constants_from_pose(self, relations: Array) -> Array:
        """Return the constants (meshes,) of the mesh equations of a file with a pose.

        A mesh is a rolling contact of two wheels. Its equation says that a weighted sum of
        pair angles is constant. The constant is computed in the reference pose, for which
        the file states the angles. A pair without an angle in the file has the angle 0
        there. `relations` (meshes, pairs) are the factors of all pair angles.
        """
        pose_angles = self.pair_angles("value")
        return relations @ [
            pose_angles.get(pair, exact_ball(0.0)) for pair in self.structure.pairs
        ]

    def _constants_from_rolled_lengths(self) -> Array:
        """Return the constants (meshes,) of the mesh equations of a file with sizes.

        A mesh is a rolling contact of two wheels: circles of radii r1 and r2 (rad), turned
        by the angles a1 and a2. The contact is at a length along each circle from a start
        point of the circle. If all pair angles are zero, these lengths are L1 and L2. If a
        wheel turns forwards, the contact moves backwards along its circle. So the lengths
        are L1 - sin(r1) a1 and L2 - sin(r2) a2. Rolling wheels have equal lengths. The
        constant sin(r1) a1 - sin(r2) a2 is therefore L1 - L2.
        """
        return self._rolled_lengths_at_zero() @ exact_balls([1.0, -1.0])

    def follower_ratios(self) -> Array:
        """Return the rates (followers, inputs) of the followers at unit rates of inputs.

        Followers are the pairs with angles that follow from the inputs through wheels.
        """
        relations = self._mesh_relations()
        return self._solve_followers(relations, -relations[:, self.structure.inputs])

    def exact_follower_ratios(self) -> list[Fraction] | None:
        """Return the rates of the followers at unit rate of the only input, as fractions.

        Followers are the pairs (joints) that the input drives through wheels. If all wheels
        have numbers of teeth, the rates are exact fractions. The denominators tell after
        how many turns of the input the followers have their initial angles again.

        The rates are computed as balls (numbers with a bound of their error). Each fraction
        is then recovered from its ball. A ball is small enough to contain only one fraction
        with a denominator up to `MAX_GEAR_RATIO_DENOMINATOR`. The nearest such fraction to
        the centre of the ball is tried.

        The result is None if a wheel has no number of teeth, or if a ball does not contain
        the fraction that is tried.
        """
        # The factors of the mesh equations are numbers of teeth, which are exact. Without
        # these numbers they are sines of radii, which have an error.
        if not all(factor.is_exact() for factor in self._mesh_relations().flat):
            return None
        ratios = []
        for (ball,) in self.follower_ratios():
            ratio = Fraction(centre_float(ball)).limit_denominator(
                MAX_GEAR_RATIO_DENOMINATOR
            )
            if not (ball * ratio.denominator).contains(ratio.numerator):
                return None
            ratios.append(ratio)
        return ratios

    def motion_columns(self) -> list[tuple[str, float]]:
        """Return the columns of the table `motion` from which all pair angles follow.

        Proofs replace each sliding contact of two circles by a coupler: a link with a
        revolute pair at the centre of each circle. So the pairs here are the revolute pairs
        of the mechanism, then the pairs of the couplers. The table `motion` has no angles
        of coupler pairs, but the arc lengths along the circles. An arc length is the angle
        times the sine of the circle's radius.

        Returns
        -------
        For each pair the name of the column, and the factor from its values to the angle: 1
        for revolute pairs of the mechanism, 1 / (sine of the radius) for a pair of a
        coupler. On the second circle of an external contact, arc length and angle have
        opposite senses, so the factor is negative.
        """
        # First each pair gets the column of a revolute pair. The columns of coupler pairs
        # are replaced below.
        columns = [(f"theta_{name}", 1.0) for name in self.structure.pairs]
        for coupler, contact in enumerate(self.structure.couplers):
            pair = self.mechanism.pairs[contact]
            circle_contact = self.circle_contact(contact)
            # The two coupler pairs, at the centres of the circles, and the columns of the
            # arc lengths along the circles.
            _, coupler_pairs = self.structure.coupler_parts(coupler)
            names = pair.kind.variable_names(pair.name, pair.links)
            for coupler_pair, name, sense, radius in zip(
                coupler_pairs,
                names,
                (1, circle_contact.sense),
                circle_contact.radii,
                strict=True,
            ):
                columns[coupler_pair] = name, sense / centre_float(radius.sin())
        return columns

    def with_gear_meshes(self) -> "DecimalMechanism":
        """Return the mechanism with its meshes of wheels and with the followers.

        A mesh is a rolling contact of two wheels, with the link that carries both. The
        followers are the R pairs with angles that follow from the inputs through the
        meshes. Followers are numbered as in `structure`, which has the R pairs only.

        Raises
        ------
        PlanError
            If no link carries the wheels of a contact, if the inputs do not determine all
            angles that the meshes relate, or if the meshes relate inputs only.
        """
        structure = self.structure
        mechanism = self.mechanism
        joints = make_joints(mechanism)
        meshes = list[GearMesh]()
        for contact in structure.wheels:
            carried_contact = find_carried_contact(
                mechanism, joints, contact, SAME_AXIS_RAD
            )
            if carried_contact is None:
                pair = mechanism.pairs[contact]
                raise PlanError(
                    f"{mechanism.name}: pair {pair.name} is a rolling contact, but no link "
                    f"carries {pair.links[0]} and {pair.links[1]} as wheels that touch, "
                    "each turning about the centre of its circle. Proofs allow rolling "
                    "contacts only of such wheels, and sliding contacts only of circles"
                )
            meshes.append(carried_contact.mesh)
        related_pairs = {
            self._structure_pair(pair) for mesh in meshes for pair in mesh.pairs
        }
        followers = tuple(sorted(related_pairs - set(structure.inputs)))
        if not followers:
            raise PlanError(
                f"{structure.name}: its rolling contacts relate the inputs "
                f"{listing(structure.names_of(sorted(related_pairs)))} to each other, so "
                "not all of them can be chosen; drive fewer pairs"
            )
        # The train has the lengths that wheels have rolled. Pair angles are known only up
        # to whole turns, which change these lengths, so combinations of turns are tried.
        # None if no tried combination agrees with all meshes, or if the meshes do not
        # determine the angles.
        train = find_gear_train(mechanism, driven_pairs(mechanism))
        # Each mesh gives a linear equation, and each follower is an unknown.
        if train is not None and len(followers) == len(meshes):
            decimal_mechanism = replace(
                self,
                structure=replace(structure, followers=followers),
                meshes=meshes,
                rolled_lengths=train.wheel_lengths.tolist(),
            )
            # The equations are solved once, only to see whether they can be solved. If they
            # are singular, a division by zero skips the return statement.
            with suppress(ZeroDivisionError):
                decimal_mechanism.follower_ratios()
                return decimal_mechanism
        follower_names = listing(structure.names_of(followers))
        raise PlanError(
            f"{structure.name}: its {len(meshes)} rolling contacts relate the angles "
            f"{follower_names} to the inputs, but do not determine each of these angles, "
            "or allow more combinations of whole turns than can be tried. Proofs need "
            "wheels whose turning follows from the inputs alone: drive another pair, or "
            "give a reference pose"
        )

    def _solve_followers(self, relations: Array, right: Array) -> Array:
        """Return the angles or rates (followers, n) for n right-hand sides (meshes, n)."""
        return solve_balls(relations[:, self.structure.followers], right)

    def _mesh_relations(self) -> Array:
        """Return the factors (meshes, pairs) of the pair angles in the mesh equations.

        A mesh is a rolling contact of two wheels. The sum of the pair angles with these
        factors is constant while the wheels roll.
        """
        relations = exact_balls(np.zeros((len(self.meshes), len(self.structure.pairs))))
        for row, mesh in zip(relations, self.meshes, strict=True):
            first_sine, second_sine = self.circle_contact(mesh.contact).sines
            factors = mesh.angle_factors(first_sine, second_sine)
            for pair, factor in factors.items():
                row[self._structure_pair(pair)] = factor
        return relations

    def _rolled_lengths_at_zero(self) -> Array:
        """Return the lengths that wheels have rolled if all pair angles are zero.

        The length along a circle is the sine of its radius times the azimuth of the contact
        about its centre, less the length at the start of the contact. The azimuth is known
        up to whole turns. Turns are added until the length agrees with the approximate
        `rolled_lengths`.

        Returns
        -------
        (meshes, 2) lengths along both circles, in rad. If the file gives numbers of teeth,
        these numbers replace the sines of the radii. The length of a whole turn is then 2
        pi times the number of teeth.

        Raises
        ------
        PlanError
            If a number of whole turns is not unique within the tolerance of the sizes.
        """
        frames = self.pair_frames()
        lengths_by_mesh = list[Array]()

        def carry_along(vector: Vector, path: PairPath) -> Vector:
            """Return a vector of the first link of a path in axes of the last link."""
            for pair, side in path:
                ends = frames[self._structure_pair(pair)]
                # With the pair at zero both frames coincide.
                vector = ends[1 - side].T @ (ends[side] @ vector)
            return vector

        for mesh, float_lengths in zip(self.meshes, self.rolled_lengths, strict=True):
            circle_contact = self.circle_contact(mesh.contact)
            sines = np.array(circle_contact.sines)
            centres = [frame[2] for frame in circle_contact.frames]
            # The directions from both centres to the contact are computed in axes of the
            # carrier. Each is carried back to the axes of its wheel, where its azimuth is
            # measured.
            directions_in_carrier = circle_contact.contact_directions(
                *map(carry_along, centres, mesh.paths)
            )
            azimuths = [
                polar_angle(*(frame[:2] @ carry_along(direction, reverse_path(path))))
                for frame, path, direction in zip(
                    circle_contact.frames, mesh.paths, directions_in_carrier, strict=True
                )
            ]
            # `sines` are the sines of both radii, or the numbers of teeth in the same
            # ratio. The scales convert lengths in rad to the unit of `sines`.
            scales = sines / [radius.sin() for radius in circle_contact.radii]
            starts = scales * self.contact_starts(mesh.contact)
            lengths = sines * azimuths * (1, circle_contact.sense) - starts
            length_of_turn = 2 * pi_ball() * sines
            turns = (scales * float_lengths - lengths) / length_of_turn
            whole_turns = np.round(centre_floats(turns))
            for turn_error in turns - whole_turns:
                is_whole = lower_magnitude(turn_error) < WHOLE_TURN_TOLERANCE
                is_unique = upper_magnitude(turn_error) < MAX_TURN_ERROR
                if not (is_whole and is_unique):
                    raise PlanError(
                        f"{self.structure.name}: the sizes do not determine how many turns "
                        "the wheels have made; give sizes with more digits, or a smaller "
                        "tolerance"
                    )
            lengths_by_mesh.append(lengths + length_of_turn * whole_turns)
        return np.array(lengths_by_mesh)

    def _structure_pair(self, pair: int) -> int:
        """Return the number that an R pair of the mechanism has in `structure`.

        `structure` has R pairs only. `pair` is the index in the mechanism, where contacts
        are counted too.
        """
        return self.structure.pairs.index(self.mechanism.pairs[pair].name)


def read_decimals(
    mechanism: Mechanism, document: Document | None = None, tolerance: float = 0.0
) -> DecimalMechanism:
    """Return a mechanism with the exact decimal numbers of its file as sizes.

    A size such as 0.1 is not exactly a float64 number, and proofs are about the file. If
    the mechanism has wheels, the contacts in which they roll on each other (meshes) are
    added.

    Parameters
    ----------
    mechanism
        The mechanism.
    document
        The parsed file of the mechanism. By default the mechanism is written as a file and
        read again.
    tolerance
        Largest error (rad) of the sizes. The proof then covers all mechanisms with sizes
        that differ from the file by at most this. With 0 it covers exactly the file.

    Raises
    ------
    PlanError
        If a profile of a contact is not a circle, if circles roll by amounts that do not
        follow from the inputs, or if the tolerance is negative or large.
    """
    structure = extract_structure(mechanism)
    if not 0.0 <= tolerance < TOLERANCE_LIMIT_RAD:
        raise PlanError(
            f"tolerance: found {tolerance:g} rad, expected at least 0 rad and less than "
            f"{TOLERANCE_LIMIT_RAD:g} rad, such as 1e-9 rad"
        )
    if document is None:
        document = parse(dumps(mechanism), mechanism.name)
        # The written file must describe the same mechanism. Writing and reading can change
        # data of the user (table "user"), for example from tuples to lists. So mechanisms
        # with such data are not compared.
        has_user_data = bool(mechanism.user)
        assert has_user_data or read(document) == mechanism
    decimal_mechanism = DecimalMechanism(mechanism, document, tolerance, structure)
    if structure.wheels:
        return decimal_mechanism.with_gear_meshes()
    return decimal_mechanism


def _coupler_frames(circle_contact: CircleContact) -> list[Frame]:
    """Return the frames of both pairs of a coupler, in the axes of the coupler.

    A coupler is a link that replaces the sliding contact of two circles. Revolute pairs
    join it to both links at the centres of the circles. The first pair axis is chosen as z
    axis of the coupler, and the second one in its y-z plane. The arc between both is that
    between the centres.

    The zero directions, from which pair angles are counted, point to the contact. So a pair
    angle is the azimuth of the contact about the centre of the circle.

    Returns
    -------
    Two frames (3, 3) of balls (numbers with a bound of their error). The rows are: zero
    direction, side (axis x zero direction), and axis of the pair.
    """
    sine, cosine = circle_contact.centre_arc.sin_cos()
    axes = (exact_balls([0.0, 0.0, 1.0]), np.array([exact_ball(0.0), sine, cosine]))
    directions = circle_contact.contact_directions(*axes)
    return [
        np.stack([direction, np.cross(axis, direction), axis])
        for axis, direction in zip(axes, directions, strict=True)
    ]
