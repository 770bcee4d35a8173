"""A mechanism that is driven at its output, by means of two virtual links.

Two virtual links and three R pairs between the two links that the output joins (a virtual
wrist) do not change the mobility. The angles of these pairs give the coordinates of the
output: three Euler angles of an orientation, or azimuth and tilt of a direction. About a
direction the third pair turns freely. If the pairs of the coordinates are driven, the
inverse kinematics is the position analysis of an ordinary mechanism.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from spherekit.arrays import Floats
from spherekit.conventions import Names
from spherekit.errors import PlanError
from spherekit.geometry.tilt_torsion import azimuth_tilt, from_euler_zyz
from spherekit.mechanism.elements import Input, Output, Pair, PoseGeometry, SizeGeometry
from spherekit.mechanism.mechanism import Mechanism
from spherekit.mechanism.output_choice import chosen_output
from spherekit.mechanism.pair_frames import pair_frames
from spherekit.mechanism.sizes import Vector
from spherekit.mechanism.sizes_from_frames import sizes_from_frames
from spherekit.planning.assembly_plan import driven_pairs
from spherekit.wording import counted

Z_AXIS: Vector = (0.0, 0.0, 1.0)
"""The third axis of a link."""

FULL_TURN_RAD = 2.0 * np.pi
"""Angle of a revolution (rad)."""

COORDINATES = (2, 3)
"""Numbers of coordinates: 2 of a pointing output, 3 of an orientation."""


@dataclass(frozen=True)
class VirtualOutputChain:
    """A mechanism with two virtual links, which prescribe the pose of one of its outputs.

    The virtual links serve for inverse kinematics. The output is observed from another
    link, the base. Two virtual links and three R pairs (revolute joints) in series lead
    from the base to the output link. The angles of these pairs are the coordinates of the
    pose, and become the inputs. If the output is an orientation, all three are driven. If
    it is a direction, the third pair turns freely about this direction.

    The inputs of the original mechanism are no longer driven. The position analysis of the
    extended mechanism therefore gives their values for a pose. The numbers of virtual links
    and pairs come after those of the original mechanism.

    Attributes
    ----------
    mechanism
        The mechanism with the virtual links. Its inputs are the coordinates of the output:
        azimuth and tilt of a pointing direction, or the angles a, b, c of an orientation R
        = Z(a) Y(b) Z(c). R rotates from the axes of the output link to those of the base.
    output
        The output.
    driven
        Numbers of the pairs that are the inputs of the mechanism without virtual links.
    pairs
        Numbers of the three virtual pairs, from the base to the output link.
    """

    mechanism: Mechanism
    output: Output
    driven: tuple[int, ...]
    pairs: tuple[int, int, int]

    @property
    def points(self) -> bool:
        """Whether the output points in a direction, which has two coordinates.

        Otherwise the output is an orientation, with three coordinates.
        """
        return len(self.mechanism.inputs) == 2

    @property
    def base(self) -> int:
        """Number of the link from which the output is observed."""
        return self.mechanism.link_number[self.output.relative_to]

    @property
    def last_virtual_link(self) -> int:
        """Number of the virtual link that the third virtual pair joins to the output link.

        Virtual links and pairs (joints) are added to fix the output in a pose. The axis of
        the third virtual pair is the direction of a pointing output.
        """
        return len(self.mechanism.links) - 1

    @property
    def link(self) -> int:
        """Number of the output link."""
        return self.mechanism.link_number[self.output.link]


def with_wrist(mechanism: Mechanism, name: str | None = None) -> VirtualOutputChain:
    """Return a mechanism with a virtual wrist at its output.

    The wrist is two virtual links and three R pairs between the two links that the output
    joins. It holds the output: the angles of its pairs are the coordinates of the pose, and
    become the inputs. In a mechanism with three inputs, the pose is an orientation. In a
    mechanism with two inputs, it is the direction that the output declares.

    Parameters
    ----------
    mechanism
        The mechanism with its inputs.
    name
        Name of the output; may be left out if there is one.

    Raises
    ------
    ModelError, PlanError
        If the output is unknown, joins a link to itself, there are neither two nor three
        inputs, or a mechanism with two inputs declares no direction.
    """
    output = chosen_output(mechanism, name)
    where = f"{mechanism.name}: outputs.{output.name}"
    driven = driven_pairs(mechanism)
    if len(driven) not in COORDINATES:
        raise PlanError(
            f"{where}: to reach given poses of an output, a mechanism needs two inputs "
            "(for a direction) or three (for an orientation), but this one has "
            f"{counted(len(driven), 'input')}; compute the motion of the output from the "
            f"inputs instead{_suggest_direct_drive(mechanism, output, len(driven))}"
        )
    if output.link == output.relative_to:
        raise PlanError(
            f"{where}: link {output.link} does not move relative to itself; give another "
            "link as relative_to"
        )
    points = len(driven) == 2
    # The last axis of the wrist is the direction in which the output points.
    if points and output.direction is None:
        raise PlanError(
            f"{where}: with two inputs the output must be a direction; state which "
            f"direction of link {output.link} is meant: axis = the name of an R pair on "
            "it, or xyz"
        )
    pan_link, swing_link = _choose_unused_names(mechanism.links, ("pan", "swing"))
    pair_names = _choose_unused_names(mechanism.pair_number, ("azimuth", "tilt", "turn"))
    azimuth_name, tilt_name, turn_name = pair_names
    virtual_pairs = (
        Pair(azimuth_name, "R", (output.relative_to, pan_link)),
        Pair(tilt_name, "R", (pan_link, swing_link)),
        Pair(turn_name, "R", (swing_link, output.link)),
    )
    direction = output.direction if points and output.direction is not None else Z_AXIS
    geometry: PoseGeometry | SizeGeometry
    if isinstance(mechanism.geometry, PoseGeometry):
        geometry = _add_to_pose(mechanism.geometry, pair_names, direction)
    else:
        geometry = _add_to_sizes(mechanism, mechanism.geometry, virtual_pairs, direction)
    azimuth_input = Input(azimuth_name, 0.0, FULL_TURN_RAD)
    tilt_input = Input(tilt_name, 0.0, 0.5 * FULL_TURN_RAD)
    turn_input = Input(turn_name, 0.0, FULL_TURN_RAD)
    coordinate_inputs = (azimuth_input, tilt_input, turn_input)
    extended_mechanism = replace(
        mechanism,
        links=(*mechanism.links, pan_link, swing_link),
        pairs=(*mechanism.pairs, *virtual_pairs),
        geometry=geometry,
        modes={},
        inputs=coordinate_inputs[:2] if points else coordinate_inputs,
    )
    count = len(mechanism.pairs)
    return VirtualOutputChain(
        mechanism=extended_mechanism,
        output=output,
        driven=driven,
        pairs=(count, count + 1, count + 2),
    )


def _suggest_direct_drive(mechanism: Mechanism, output: Output, input_count: int) -> str:
    """Return advice for a mechanism whose output could be driven directly at one pair.

    The advice is the end of an error message for a mechanism with one input. It names the
    pair (joint) between the two links of the output. The text is empty if no pair joins
    these links, or if the pair is the input already.

    Parameters
    ----------
    mechanism
        The mechanism.
    output
        The output, a link and the link relative to which it moves.
    input_count
        Number of inputs of the mechanism. The text is empty if it is not 1.
    """
    output_links = {output.link, output.relative_to}
    for pair in mechanism.pairs:
        if pair.name in mechanism.input_pairs:
            continue
        if input_count == 1 and pair.kind.has_axis and set(pair.links) == output_links:
            return (
                f". The angle of pair {pair.name} alone sets this output; to prescribe it, "
                f"make this pair the input: --input {pair.name}"
            )
    return ""


def _choose_unused_names(
    used_names: "Names | Mapping[str, int]", names: Names
) -> list[str]:
    """Return names that are not used yet, with underscores appended where necessary."""
    unused_names = []
    for name in names:
        while name in used_names:
            name += "_"
        unused_names.append(name)
    return unused_names


def _add_to_pose(
    geometry: PoseGeometry, pair_names: list[str], direction: Vector
) -> PoseGeometry:
    """Return a reference pose with the axes and angles of three virtual pairs added.

    Two virtual links and three virtual pairs in series hold the output link in its pose.
    The angles of these pairs are the coordinates of the pose. They can be inputs of the
    mechanism, so that its pairs follow from a given pose of the output.

    The first axis is z of the base, and the third axis is the direction of the output. The
    second axis, the tilt axis, is at right angles to the other two.

    Parameters
    ----------
    geometry
        Axes and variables of all pairs in the reference pose.
    pair_names
        Names of the three virtual pairs.
    direction
        Direction of the output in the reference pose. For an output that is an orientation,
        it is the z axis of the output link. The third Euler angle turns about this axis.
    """
    azimuth, tilt = azimuth_tilt(np.array([direction]))[0].tolist()
    tilt_axis = (-float(np.sin(azimuth)), float(np.cos(azimuth)), 0.0)
    virtual_axes = zip(pair_names, (Z_AXIS, tilt_axis, direction), strict=True)
    # Azimuth and tilt alone give the direction. The third angle is counted from the
    # reference pose, so its value there is 0.
    virtual_values = zip(pair_names, (azimuth, tilt, 0.0), strict=True)
    return PoseGeometry(
        {**geometry.axes, **dict(virtual_axes)},
        {**geometry.values, **dict(virtual_values)},
    )


def _add_to_sizes(
    mechanism: Mechanism,
    geometry: SizeGeometry,
    virtual_pairs: Sequence[Pair],
    direction: Vector,
) -> SizeGeometry:
    """Return the sizes of all links with three virtual pairs added.

    The virtual pairs serve for inverse kinematics. With two virtual links they form a chain
    from the base to the output link. Their angles are Euler angles about z, y and z. All
    three are coordinates of an orientation. The first two, azimuth and tilt, are
    coordinates of a direction; the third pair then turns freely about the direction.

    The new sizes are computed from the frames of all pairs.

    Parameters
    ----------
    mechanism
        The mechanism without the virtual links.
    geometry
        The sizes of this mechanism.
    virtual_pairs
        The three virtual pairs, from the base to the output link.
    direction
        Direction of the output in the axes of its link; z for an orientation, whose third
        Euler angle is about z.
    """
    # The frames (3, 3) of all pairs in their first and in their second link, by pair name.
    first_frames, second_frames = pair_frames(mechanism)
    virtual_frames = _make_virtual_frames(direction)
    for pair, frames in zip(virtual_pairs, virtual_frames, strict=True):
        first_frames[pair.name] = frames.in_first_link
        second_frames[pair.name] = frames.in_second_link
    # Only links with a virtual pair get new sizes. All others keep theirs.
    changed_links = {link for pair in virtual_pairs for link in pair.links}
    unchanged_sizes = {
        link: sizes for link, sizes in geometry.links.items() if link not in changed_links
    }
    return sizes_from_frames(
        (*mechanism.pairs, *virtual_pairs),
        frames=(first_frames, second_frames),
        known_sizes=unchanged_sizes,
    )


@dataclass(frozen=True)
class VirtualPairFrames:
    """The frames of a virtual pair (joint that fixes the output) in its two links.

    A frame is a (3, 3) matrix with the unit vectors x, y and z as columns, in the axes of
    the link. z is the axis of the pair, and the pair angle is counted from x.
    """

    in_first_link: Floats
    in_second_link: Floats


def _make_virtual_frames(direction: Vector) -> tuple[VirtualPairFrames, ...]:
    """Return the frames of three virtual pairs, from the base to the output link.

    A chain of two virtual links and three virtual pairs joins the base to the output link.
    If the angles of the pairs are locked, the chain holds the output in a pose. The pairs
    rotate one after another about z, y and z (Euler angles). The last axis is the direction
    of the output. At the angle 0, the frames of a pair in its two links coincide.

    Parameters
    ----------
    direction
        Direction of the output in the axes of its link.
    """
    # The columns of a frame are three unit vectors in link axes. The last one is the pair
    # axis. The three are in the cyclic order of x, y, z, so the frame is right-handed.
    x, y, z = np.eye(3)
    z_frame = np.stack([x, y, z], axis=1)  # the pair axis is z
    y_frame = np.stack([z, x, y], axis=1)  # the pair axis is y
    # The rotation Z(azimuth) Y(tilt) turns z to the direction, so its last column is the
    # direction. A further rotation about the direction is not needed: its angle is 0.
    azimuth_and_tilt = azimuth_tilt(np.array([direction]))
    pointing_angles = np.append(azimuth_and_tilt, [[0.0]], axis=1)
    direction_frame = from_euler_zyz(pointing_angles)[0]
    return (
        VirtualPairFrames(in_first_link=z_frame, in_second_link=z_frame),
        VirtualPairFrames(in_first_link=y_frame, in_second_link=y_frame),
        VirtualPairFrames(in_first_link=z_frame, in_second_link=direction_frame),
    )
