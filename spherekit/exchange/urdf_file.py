"""A URDF file as a MuJoCo model, with its loops and the wheels of its transmissions."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from spherekit.arrays import Floats
from spherekit.errors import FileError
from spherekit.exchange.urdf_loops import Element, add_loop_joint
from spherekit.exchange.urdf_transmissions import (
    DrivenJoint,
    DrivenWheel,
    describe_motors,
    name_wheels,
    read_transmissions,
)


@dataclass(frozen=True)
class UrdfContent:
    """A URDF file as a MuJoCo model that is not compiled yet.

    Attributes
    ----------
    spec
        The `MjSpec` of the model.
    transmissions
        What the motors of transmissions drive: single joints, or wheels that are added to
        the model. Each motor of a differential, for example, turns such a wheel. The angle
        of the wheel is a combination of the angles of two joints.
    loop_axes
        Unit axis (3,) of each revolute loop joint (joint that closes a loop), by the name
        of the joint, in the axes of the first link.
    notes
        Sentences for the user. They name transmissions of unknown type. They also say which
        motors turn by another angle than the joint they drive, and explain the angle of
        each wheel.
    """

    spec: Any
    transmissions: Sequence[DrivenJoint | DrivenWheel]
    loop_axes: dict[str, Floats]
    notes: list[str]


def read_urdf(mujoco: Any, root: Element, path: Path) -> UrdfContent:
    """Return the MuJoCo model of a URDF, with constraints for loops and transmissions.

    In a transmission with two motors and two joints, a motor can turn a weighted sum of
    both joint angles. For each such motor a wheel (`DrivenWheel`) is added to the model,
    whose angle is this sum.

    Parameters
    ----------
    mujoco
        The Python module `mujoco`, an optional dependency.
    root
        The element `<robot>`. The elements of shapes are removed from it.
    path
        The file, for messages.

    Raises
    ------
    FileError
        If a transmission or a loop joint cannot be read.
    ValueError
        If MuJoCo cannot read the file.
    """
    # A mechanism has no shapes, and their files may be missing.
    for link in root.iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(shape)
    # Each item is what a motor drives: a joint or a wheel. Wheels get names.
    transmissions, transmission_notes = read_transmissions(root, path)
    transmissions = name_wheels(root, transmissions)
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))
    # Links on fixed joints keep their names as bodies of their own.
    spec.compiler.fusestatic = False
    for drive in transmissions:
        if isinstance(drive, DrivenWheel):
            _add_wheel(mujoco, spec, drive, path)
    loop_axes: dict[str, Floats] = {}
    try:
        # Joints that close loops, in the tags of two extensions of URDF.
        for loop_joint in [*root.findall("loop_joint"), *root.findall("loop")]:
            loop_axes |= add_loop_joint(mujoco, spec, loop_joint, path)
    except ValueError as error:
        raise FileError(f"{path}: a loop joint cannot be read: {error}") from None
    notes = [*transmission_notes, *describe_motors(transmissions)]
    return UrdfContent(spec, transmissions, loop_axes, notes)


def _add_wheel(mujoco: Any, spec: Any, drive: DrivenWheel, path: Path) -> None:
    """Add a wheel for one motor to a model, and couple it with the two joints it drives.

    The motor turns a combination of two joints. The inner joint carries the outer joint.
    The angle of the wheel is the angle of the inner joint plus `drive.ratio` times the
    angle of the outer joint. In MuJoCo this equation is a tendon (sum of joint angles with
    factors) that stays constant: wheel - inner - ratio outer = 0.

    Parameters
    ----------
    mujoco
        The Python module `mujoco`, an optional dependency.
    spec
        The `MjSpec`, which is changed.
    drive
        The wheel, with the names of the two joints and the ratio.
    path
        The file, for messages.

    Raises
    ------
    FileError
        If the model has no joint with one of the two names.
    """
    joint = spec.joint(drive.inner_joint)
    if joint is None or spec.joint(drive.outer_joint) is None:
        raise FileError(
            f"{path}: transmission {drive.transmission}: joints "
            f"{drive.inner_joint} and {drive.outer_joint} are not both rotating joints, "
            "which a transmission needs"
        )
    inner_link = joint.parent
    carrier = inner_link.parent
    # The wheel turns on the same carrier about the axis of the inner joint, so its body has
    # the frame of the link on that joint.
    wheel = carrier.add_body(name=drive.wheel, pos=inner_link.pos, quat=inner_link.quat)
    wheel.add_joint(name=drive.wheel, type=joint.type, pos=joint.pos, axis=joint.axis)
    tendon = spec.add_tendon(name=drive.wheel)
    tendon.wrap_joint(drive.wheel, 1.0)
    tendon.wrap_joint(drive.inner_joint, -1.0)
    tendon.wrap_joint(drive.outer_joint, -drive.ratio)
    spec.add_equality(
        name=f"{drive.wheel}_mesh",
        type=mujoco.mjtEq.mjEQ_TENDON,
        objtype=mujoco.mjtObj.mjOBJ_TENDON,
        name1=drive.wheel,
    )
