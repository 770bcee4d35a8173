"""Transmissions of URDF files: what motors turn, and how far.

Read are the elements of ros_control, with the role and the reduction as child elements, and
of ros2_control, where the role is an attribute. The equations are those of the package
transmission_interface of both, with the positions a of actuators, q of joints relative to
their offsets, and the reductions n_a and n_j:

- `SimpleTransmission`: a = n_a q;
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


@dataclass(frozen=True)
class DrivenJoint:
    """A joint that a motor turns alone; the motor turns `motor_ratio` times as far."""

    transmission: str
    motor: str
    joint: str
    motor_ratio: float


@dataclass(frozen=True)
class DrivenWheel:
    """A wheel, coaxial with `inner_joint`, through which a motor turns two joints.

    `wheel` is its name as a link and as a joint. Its angle is that of the inner joint, plus
    `ratio` times that of the outer joint, which the inner one carries. The motor turns
    `motor_ratio` times as far as the wheel.
    """

    transmission: str
    motor: str
    wheel: str
    inner_joint: str
    outer_joint: str
    ratio: float
    motor_ratio: float


@dataclass(frozen=True)
class _End:
    """An actuator or joint of a transmission, with its reduction."""

    name: str
    reduction: float


def read_transmissions(
    root: Element, path: object
) -> tuple[list[DrivenJoint | DrivenWheel], list[str]]:
    """Return what the transmissions of a URDF drive, and notes on those that are not known.

    Parameters
    ----------
    root
        The element `<robot>`.
    path
        The file, for messages.

    Raises
    ------
    FileError
        If a transmission has too few actuators or joints, a reduction that is no number or
        zero, or drives two joints of which neither carries the other.
    """
    carried = _carried_links(root)
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
            rows = _equations(kind, actuators, joints)
            inner = _inner_joint(joints, carried, where)
            driven += [
                _drive(name, actuator, joints, row, inner)
                for actuator, row in zip(actuators, rows, strict=True)
            ]
            continue
        if kind not in ("", "SimpleTransmission") and (len(joints) > 1 or not joints):
            names = listing(joint.name for joint in joints)
            notes.append(
                f"transmission {name} of type {kind} is not known: its joints {names} are "
                "taken as driven one by one"
            )
        for number, joint in enumerate(joints):
            actuator = (
                actuators[number] if number < len(actuators) else _End(joint.name, 1.0)
            )
            ratio = actuator.reduction * joint.reduction
            driven.append(DrivenJoint(name, actuator.name, joint.name, ratio))
    return driven, notes


def _equations(
    kind: str, actuators: Sequence[_End], joints: Sequence[_End]
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the factors of both joints in the angle of each actuator."""
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
    actuator: _End,
    joints: Sequence[_End],
    factors: tuple[float, float],
    inner: int,
) -> DrivenJoint | DrivenWheel:
    """Return what an actuator turns, of two joints of which `inner` carries the other."""
    outer = 1 - inner
    for alone in (inner, outer):
        if factors[1 - alone] == 0.0:
            joint = joints[alone].name
            return DrivenJoint(transmission, actuator.name, joint, factors[alone])
    return DrivenWheel(
        transmission,
        actuator.name,
        actuator.name,
        joints[inner].name,
        joints[outer].name,
        factors[outer] / factors[inner],
        factors[inner],
    )


def _kind(item: Element) -> str:
    """Return the type of a transmission without its package, "" if it has none."""
    for tag in ("type", "plugin"):
        text = item.findtext(tag) or item.get(tag)
        if text:
            return text.strip().rpartition("/")[2]
    return ""


def _ends(item: Element, tag: str, where: str) -> list[_End]:
    """Return the actuators or joints of a transmission in the order of their roles."""
    ends: list[tuple[str, _End]] = []
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
        ends.append((role, _End(name, reduction)))
    if all(role for role, _ in ends):
        ends.sort(key=lambda end: end[0])
    return [end for _, end in ends]


def _carried_links(root: Element) -> Mapping[str, tuple[str, str]]:
    """Return parent and child of each joint; the first of welded links stands for all."""
    joints: dict[str, tuple[str, str]] = {}
    welded: dict[str, str] = {}
    for joint in root.findall("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        if parent is None or child is None:
            continue
        ends = parent.get("link", ""), child.get("link", "")
        if joint.get("type") == "fixed":
            welded[ends[1]] = ends[0]
        else:
            joints[joint.get("name", "")] = ends

    def first_of(link: str) -> str:
        seen = {link}
        while link in welded and welded[link] not in seen:
            link = welded[link]
            seen.add(link)
        return link

    return {name: (first_of(a), first_of(b)) for name, (a, b) in joints.items()}


def _inner_joint(
    joints: Sequence[_End], carried: Mapping[str, tuple[str, str]], where: str
) -> int:
    """Return which of two joints carries the other one."""
    for joint in joints:
        if joint.name not in carried:
            raise FileError(f'{where}: there is no joint "{joint.name}" that turns')
    for inner in (0, 1):
        inner_ends, outer_ends = (carried[joints[k].name] for k in (inner, 1 - inner))
        if inner_ends[1] == outer_ends[0]:
            return inner
    names = listing(joint.name for joint in joints)
    raise FileError(
        f"{where}: it drives joints {names} together, but neither of them is on the link "
        "that the other one turns, so no bevel wheels couple them. Take the transmission "
        "out of a copy of the file; the joints are then driven one by one"
    )


def name_wheels(
    root: Element, driven: Sequence[DrivenJoint | DrivenWheel]
) -> list[DrivenJoint | DrivenWheel]:
    """Return what motors drive, with wheels named like no link and no joint of the URDF.

    A wheel has the name of its motor where that is free.
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
    """Yield notes on motors that do not turn as far as the input that stands for them."""
    for drive in driven:
        if isinstance(drive, DrivenWheel):
            ratio = f"{abs(drive.ratio):.6g} times " if abs(drive.ratio) != 1.0 else ""
            sign = "minus" if drive.ratio < 0.0 else "plus"
            yield (
                f"motor {drive.motor} of transmission {drive.transmission} drives bevel "
                f"wheel {drive.wheel}, whose angle is that of {drive.inner_joint} {sign} "
                f"{ratio}that of {drive.outer_joint}; the motor turns "
                f"{drive.motor_ratio:.6g} times as far as the wheel"
            )
        elif drive.motor_ratio != 1.0:
            yield (
                f"motor {drive.motor} of transmission {drive.transmission} turns "
                f"{drive.motor_ratio:.6g} times as far as joint {drive.joint}, its input"
            )
