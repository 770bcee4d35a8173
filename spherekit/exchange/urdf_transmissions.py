"""Transmissions of URDF files: what motors turn, and how far.

The elements of two packages can be read. In ros_control, the role and the reduction are
child elements. In ros2_control, the role is an attribute. Both packages have the same
equations (in their part transmission_interface). The positions of actuators are a, and the
positions of joints relative to their offsets are q. The reductions are n_a and n_j:

- `SimpleTransmission`: a = n_a n_j q;
- `DifferentialTransmission`: a1 = n_a1 (n_j1 q1 + n_j2 q2), a2 = n_a2 (n_j1 q1 - n_j2 q2);
- `FourBarLinkageTransmission`: a1 = n_a1 n_j1 q1, a2 = n_a2 (q1 + n_j2 q2).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from xml.etree import ElementTree

from spherekit.errors import FileError
from spherekit.wording import counted, listing

Element = ElementTree.Element

REDUCTION_TAGS = ("mechanicalReduction", "mechanical_reduction")
"""Names of the element of a reduction, in ros_control and ros2_control."""


@dataclass(frozen=True)
class DrivenJoint:
    """A joint of a URDF file with a motor that drives no other joint.

    Attributes
    ----------
    transmission, motor, joint
        Names of the transmission, the motor and the joint.
    motor_ratio
        Angle of the motor divided by the angle of the joint.
    """

    transmission: str
    motor: str
    joint: str
    motor_ratio: float


@dataclass(frozen=True)
class DrivenWheel:
    """A wheel that one motor of a transmission with two motors and two joints turns.

    In a differential, for example, each motor turns a side wheel, and both wheels together
    move both joints. The file does not contain the wheel. It is added to the model as a
    link, because the motor turns none of the joints alone.

    The inner joint carries the outer joint. The wheel is coaxial with the inner joint. The
    angle of the wheel is the angle of the inner joint plus `ratio` times the angle of the
    outer joint.

    Attributes
    ----------
    transmission, motor
        Names of the transmission and the motor.
    wheel
        Name of the link that is added for the wheel, and of the joint of this link.
    inner_joint, outer_joint
        Names of the two joints of the transmission.
    ratio
        Factor of the angle of the outer joint.
    motor_ratio
        Angle of the motor divided by the angle of the wheel.
    """

    transmission: str
    motor: str
    wheel: str
    inner_joint: str
    outer_joint: str
    ratio: float
    motor_ratio: float


@dataclass(frozen=True)
class TransmissionEnd:
    """An actuator or joint of a transmission, by its name, with its reduction.

    The reduction is a ratio of angles, such as 50 for a gear unit; see `_equations`.
    """

    name: str
    reduction: float


def read_transmissions(
    root: Element, path: object
) -> tuple[list[DrivenJoint | DrivenWheel], list[str]]:
    """Return the joints and wheels that the transmissions of a URDF drive.

    Parameters
    ----------
    root
        The element `<robot>`.
    path
        The file, for messages.

    Returns
    -------
    driven
        A joint for each motor that turns only one joint. A motor in a differential turns
        two joints together by a wheel; the wheel then takes the place of the joint.
    notes
        Sentences on transmissions of unknown types, except those of a single joint.

    Raises
    ------
    FileError
        If a differential or four-bar linkage has not two actuators and two joints, or if
        neither of its joints carries the other. Also if a reduction (a ratio of angles) is
        zero, infinite or not a number.
    """
    links_by_joint = _find_joined_links(root)
    driven: list[DrivenJoint | DrivenWheel] = []
    notes: list[str] = []
    for item in root.iter("transmission"):
        name = item.get("name", "transmission")
        where = f"{path}: transmission {name}"
        kind = _kind(item)
        actuators = _ends(item, "actuator", where)
        joints = _ends(item, "joint", where)
        if kind in ("DifferentialTransmission", "FourBarLinkageTransmission"):
            if len(actuators) != 2 or len(joints) != 2:
                raise FileError(
                    f"{where}: a {kind} has 2 actuators and 2 joints; found "
                    f"{counted(len(actuators), 'actuator')} and "
                    f"{counted(len(joints), 'joint')}"
                )
            # For each actuator the factors of both joint angles in its angle.
            rows = _equations(kind, actuators, joints)
            inner = _find_inner_joint(joints, links_by_joint, where)
            driven += [
                _drive(name, actuator, joints, row, inner)
                for actuator, row in zip(actuators, rows, strict=True)
            ]
            continue
        if kind not in ("", "SimpleTransmission") and (len(joints) > 1 or not joints):
            names = listing(joint.name for joint in joints)
            reading = f"its joints {names} are read as driven each on its own"
            notes.append(
                f"transmission {name} of type {kind} is not known: "
                f"{reading if joints else 'left out, since it names no joint'}"
            )
        # Each joint has its own actuator. A missing actuator turns as far as the joint.
        for number, joint in enumerate(joints):
            actuator = (
                actuators[number]
                if number < len(actuators)
                else TransmissionEnd(joint.name, 1.0)
            )
            ratio = actuator.reduction * joint.reduction
            driven.append(DrivenJoint(name, actuator.name, joint.name, ratio))
    return driven, notes


def _equations(
    kind: str, actuators: Sequence[TransmissionEnd], joints: Sequence[TransmissionEnd]
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the factors of both joint angles in the angle of each actuator.

    A transmission of a URDF file couples two actuators (angles a) with two joints (angles
    q). Let n_a be the reductions of the actuators, and n_j the reductions of the joints. In
    a differential, a1 = n_a1 (n_j1 q1 + n_j2 q2) and a2 = n_a2 (n_j1 q1 - n_j2 q2). In a
    four-bar linkage, a1 = n_a1 n_j1 q1 and a2 = n_a2 (q1 + n_j2 q2).

    Parameters
    ----------
    kind
        Type of the transmission: a differential or a four-bar linkage.
    actuators, joints
        The two actuators and the two joints, in the order of their roles in the file.
    """
    motor_1, motor_2 = (actuator.reduction for actuator in actuators)
    joint_1, joint_2 = (joint.reduction for joint in joints)
    if kind == "DifferentialTransmission":
        return (
            (motor_1 * joint_1, motor_1 * joint_2),
            (motor_2 * joint_1, -motor_2 * joint_2),
        )
    return (motor_1 * joint_1, 0.0), (motor_2, motor_2 * joint_2)


def _drive(
    transmission: str,
    actuator: TransmissionEnd,
    joints: Sequence[TransmissionEnd],
    factors: tuple[float, float],
    inner: int,
) -> DrivenJoint | DrivenWheel:
    """Return what an actuator drives: a single joint, or a wheel coupled to both joints.

    With the angles q_i and q_o of the inner and the outer joint, the angle of the actuator
    is a = f_i q_i + f_o q_o. If one factor is zero, the actuator turns only the joint with
    the other factor. Otherwise the actuator turns a wheel that is coaxial with the inner
    joint. The angle of the wheel is q_i + ratio q_o with ratio = f_o / f_i. The angle of
    the actuator is f_i times the angle of the wheel.

    Parameters
    ----------
    transmission
        Name of the transmission.
    actuator, joints
        The actuator, and the two joints of the transmission.
    factors
        Factors of both joint angles in the angle of the actuator, in the order of the
        joints. At most one of them is zero.
    inner
        Index, 0 or 1, of the joint that carries the other one.
    """
    outer = 1 - inner
    if factors[outer] == 0.0:
        return DrivenJoint(transmission, actuator.name, joints[inner].name, factors[inner])
    if factors[inner] == 0.0:
        return DrivenJoint(transmission, actuator.name, joints[outer].name, factors[outer])
    # The file has no name for the wheel, so it is named after its motor.
    return DrivenWheel(
        transmission=transmission,
        motor=actuator.name,
        wheel=actuator.name,
        inner_joint=joints[inner].name,
        outer_joint=joints[outer].name,
        ratio=factors[outer] / factors[inner],
        motor_ratio=factors[inner],
    )


def _kind(item: Element) -> str:
    """Return the type of a transmission without its package, "" if it has none."""
    for tag in ("type", "plugin"):
        text = item.findtext(tag) or item.get(tag)
        if text:
            return text.strip().rpartition("/")[2]
    return ""


def _ends(item: Element, tag: str, where: str) -> list[TransmissionEnd]:
    """Return the actuators or joints of a URDF transmission, with their reductions.

    If all of them have a role, such as ``actuator1``, they are sorted by role. A missing
    reduction is 1. A reduction that is zero, infinite or not a number is an error.

    Parameters
    ----------
    item
        The element of the transmission.
    tag
        ``"actuator"`` or ``"joint"``.
    where
        The transmission, for messages.
    """
    ends: list[tuple[str, TransmissionEnd]] = []
    for child in item.findall(tag):
        name = child.get("name", "")
        role = child.get("role") or child.findtext("role") or ""
        texts = [child.findtext(reduction) for reduction in REDUCTION_TAGS]
        text = next((text for text in texts if text is not None), "1")
        try:
            reduction = float(text)
        except ValueError:
            reduction = 0.0
        if not abs(reduction) > 0.0 or abs(reduction) == float("inf"):
            raise FileError(
                f'{where}: the mechanical reduction of {tag} {name} is "{text.strip()}"; '
                "it has to be a number other than zero"
            )
        ends.append((role, TransmissionEnd(name, reduction)))
    if all(role for role, _ in ends):
        ends.sort(key=lambda end: end[0])
    return [end for _, end in ends]


def _find_joined_links(root: Element) -> Mapping[str, tuple[str, str]]:
    """Return the parent and the child link of each joint that is not fixed, by its name.

    Links that fixed joints join are one body. Of these links, the result has the link
    nearest to the root of the tree.
    """
    links_by_joint: dict[str, tuple[str, str]] = {}
    parent_by_fixed_link: dict[str, str] = {}
    for joint in root.findall("joint"):
        parent = joint.find("parent")
        child = joint.find("child")
        if parent is None or child is None:
            continue
        parent_link = parent.get("link", "")
        child_link = child.get("link", "")
        if joint.get("type") == "fixed":
            parent_by_fixed_link[child_link] = parent_link
        else:
            links_by_joint[joint.get("name", "")] = (parent_link, child_link)

    def first_link(link: str) -> str:
        """Return the link nearest to the root that is rigidly joined to a link."""
        visited_links = {link}
        # A faulty file may have a cycle of fixed joints.
        while parent_by_fixed_link.get(link, link) not in visited_links:
            link = parent_by_fixed_link[link]
            visited_links.add(link)
        return link

    return {
        joint: (first_link(parent_link), first_link(child_link))
        for joint, (parent_link, child_link) in links_by_joint.items()
    }


def _find_inner_joint(
    joints: Sequence[TransmissionEnd],
    links_by_joint: Mapping[str, tuple[str, str]],
    where: str,
) -> int:
    """Return the index (0 or 1) of the inner joint: the one that carries the other.

    The transmission couples both joints by bevel wheels. The outer joint is on the link
    that the inner joint turns.

    Parameters
    ----------
    joints
        The two joints of a transmission.
    links_by_joint
        Parent and child link of each joint that is not fixed, by its name.
    where
        The transmission, for messages.
    """
    for joint in joints:
        if joint.name not in links_by_joint:
            raise FileError(f'{where}: no rotating joint is named "{joint.name}"')
    # The inner joint turns the link on which the outer joint is.
    for inner in (0, 1):
        _, inner_child = links_by_joint[joints[inner].name]
        outer_parent, _ = links_by_joint[joints[1 - inner].name]
        if inner_child == outer_parent:
            return inner
    names = listing(joint.name for joint in joints)
    raise FileError(
        f"{where}: the transmission couples joints {names}, but neither of them is on the "
        "link that the other one turns, so no bevel wheels can couple them. Remove the "
        "transmission from a copy of the file; each joint is then driven on its own"
    )


def name_wheels(
    root: Element, driven: Sequence[DrivenJoint | DrivenWheel]
) -> list[DrivenJoint | DrivenWheel]:
    """Give each driven wheel a name that no link and no joint of the URDF has.

    A driven wheel stands for one motor of a transmission, and the URDF has no name for it.
    The wheel gets the name of its motor, or a name made from that of the transmission if
    the motor has none. If the name is not free, "_wheel" is added.

    Parameters
    ----------
    root
        The element ``<robot>`` of the URDF.
    driven
        All joints and wheels that motors drive. Names of wheels may be in use.

    Returns
    -------
    The same joints and wheels, with new names of wheels.
    """
    taken = {item.get("name", "") for item in root if item.tag in ("link", "joint")}
    renamed: list[DrivenJoint | DrivenWheel] = []
    for drive in driven:
        if isinstance(drive, DrivenWheel):
            name = drive.motor or f"{drive.transmission}_motor"
            while name in taken:
                name += "_wheel"
            taken.add(name)
            drive = replace(drive, wheel=name)
        renamed.append(drive)
    return renamed


def describe_motors(driven: Sequence[DrivenJoint | DrivenWheel]) -> Iterator[str]:
    """Yield notes that say how far motors turn when their inputs turn.

    The input of the imported mechanism is the driven joint or wheel, not the motor. A
    driven wheel stands for one motor of a transmission with two motors, such as a bevel
    differential. The angle of the wheel is a sum of both joint angles with factors.
    """
    for drive in driven:
        if isinstance(drive, DrivenWheel):
            # The URDF has no such wheel, so its angle is always explained.
            ratio = f"{abs(drive.ratio):.6g} times " if abs(drive.ratio) != 1.0 else ""
            sign = "minus" if drive.ratio < 0.0 else "plus"
            yield (
                f"motor {drive.motor} of transmission {drive.transmission} drives bevel "
                f"wheel {drive.wheel}, whose angle is that of {drive.inner_joint} {sign} "
                f"{ratio}that of {drive.outer_joint}; the motor turns "
                f"{drive.motor_ratio:.6g} times as far as the wheel"
            )
        # A joint gets a note only if its motor turns by another angle.
        elif drive.motor_ratio != 1.0:
            yield (
                f"motor {drive.motor} of transmission {drive.transmission} turns "
                f"{drive.motor_ratio:.6g} times as far as joint {drive.joint}, its input"
            )
