"""What URDF files say of loops and drives in elements that the format itself lacks.

Tree joints cannot close loops. In use are `<loop_joint>` with two links and the places on
them (Drake, Isaac Sim, and exporters that write parent and child with origins), and
`<loop>` with `<predecessor>` and `<successor>` (URDF+, Chignoli et al. 2024).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import final
from xml.etree import ElementTree

import numpy as np

from spherekit.conventions import counted
from spherekit.errors import FileError
from spherekit.sphere.rotation import Floats

Element = ElementTree.Element

TURNING = ("revolute", "continuous")
POINT = ("spherical", "ball")
RIGID = ("fixed",)


@final
@dataclass(frozen=True)
class UrdfLoop:
    """A joint that closes a loop: its kind, links, the places and the axis on them.

    `axis` (3,) and both `places` (3,) are in the axes of the links; the axis is the
    first link's.
    """

    name: str
    kind: str
    links: tuple[str, str]
    places: tuple[Floats, Floats]
    axis: Floats | None


def tree_only(root: Element) -> str:
    """Return a URDF without looks and contacts, which name files that may be missing."""
    for link in root.iter("link"):
        for looks in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(looks)
    return ElementTree.tostring(root, encoding="unicode")


def loops(where: str, root: Element) -> Iterator[UrdfLoop]:
    """Yield the loop joints of a URDF.

    Raises
    ------
    FileError
        If one has not two links, or is of a kind that no hinge, point or weld is.
    """
    for item in [*root.findall("loop_joint"), *root.findall("loop")]:
        name = item.get("name", "loop")
        kind = item.get("type", "spherical")
        if kind not in (*TURNING, *POINT, *RIGID):
            raise FileError(
                f'{where}: loop joint {name}: type "{kind}"; allowed: '
                f"{', '.join((*TURNING, *POINT, *RIGID))}"
            )
        ends = list(_ends(item))
        if len(ends) != 2:
            raise FileError(
                f"{where}: loop joint {name}: has {counted(len(ends), 'link')}, needs 2: "
                "link1 and link2, predecessor and successor, or parent and child with "
                "origins"
            )
        (first, place, turn), (second, other, _) = ends
        axis = _vector(item.find("axis"), "xyz") if item.find("axis") is not None else None
        if axis is not None:
            axis = turn @ axis / np.linalg.norm(axis)
        if kind in TURNING and axis is None:
            axis = turn @ np.array([1.0, 0.0, 0.0])
        yield UrdfLoop(name, kind, (first, second), (place, other), axis)


def _ends(item: Element) -> Iterator[tuple[str, Floats, Floats]]:
    """Yield each link with the place (3,) and the axes (3, 3) of the joint on it."""
    for tag in ("link1", "link2", "predecessor", "successor", "parent", "child"):
        for end in item.findall(tag):
            origin = end.find("origin")
            if origin is None:
                origin = item.find(f"{tag}_origin")
            if origin is None:
                origin = end
            yield end.get("link", ""), _vector(origin, "xyz"), _turn(_vector(origin, "rpy"))


def driven(root: Element) -> list[str]:
    """Return the joints that transmissions and ros2_control drive, in their order."""
    joints = [
        joint.get("name", "")
        for drive in [*root.iter("transmission"), *root.iter("ros2_control")]
        for joint in drive.findall("joint")
        if drive.tag == "transmission" or joint.find("command_interface") is not None
    ]
    return list(dict.fromkeys(joints))


def _vector(item: Element | None, key: str) -> Floats:
    text = (item.get(key) if item is not None else None) or "0 0 0"
    return np.array([float(part) for part in text.split()])


def _turn(rpy: Floats) -> Floats:
    (a, b, c), (d, e, f) = np.cos(rpy), np.sin(rpy)
    about_x = np.array([[1, 0, 0], [0, a, -d], [0, d, a]])
    about_y = np.array([[b, 0, e], [0, 1, 0], [-e, 0, b]])
    about_z = np.array([[c, -f, 0], [f, c, 0], [0, 0, 1]])
    return np.asarray(about_z @ about_y @ about_x)
