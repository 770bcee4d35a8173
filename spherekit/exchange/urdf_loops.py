"""Loops of URDF files, in elements that the format itself does not define.

The joints of a URDF form a tree. Two ways to close loops are in use: `<loop_joint>` with
two links and the positions of the joint on them (Drake, Isaac Sim, and exporters that write
parent and child with origins), and `<loop>` with `<predecessor>` and `<successor>` (URDF+,
Chignoli et al. 2024).
"""

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from spherekit.arrays import Floats
from spherekit.errors import FileError
from spherekit.wording import counted, listing

Element = ElementTree.Element

AXIS_LOOP_TYPES = ("revolute", "continuous")
"""Types of loop joints that have an axis."""

LOOP_TYPES = (*AXIS_LOOP_TYPES, "spherical", "ball", "fixed")
"""Types of loop joints that can be imported."""

END_TAGS = ("link1", "link2", "predecessor", "successor", "parent", "child")
"""Names of the elements that give the two links of a loop joint."""


def add_loop_joint(
    mujoco: Any, spec: Any, loop_joint: Element, path: Path
) -> dict[str, Floats]:
    """Add a loop joint of a URDF to a MuJoCo model, as a constraint.

    URDF joints form a tree. A loop joint is an extension that closes a loop between two
    links of the tree.

    A fixed joint becomes a weld of the two links. Any other joint holds one point of both
    links together.

    Parameters
    ----------
    mujoco
        The Python module `mujoco`, an optional dependency.
    spec
        The `MjSpec` of the model, which is changed.
    loop_joint
        The element of the joint, which has two links, with position and orientation of the
        joint on each.
    path
        The file, for messages.

    Returns
    -------
    The unit axis (3,) of the joint in the axes of its first link, by the name of the joint;
    empty if the joint has no axis.

    Raises
    ------
    FileError
        If the type is not one of `LOOP_TYPES`, there are not two links, a link does not
        exist, or an axis is zero.
    ValueError
        If a vector is not given by three finite numbers.
    """
    joint_type = loop_joint.get("type", "spherical")
    name = loop_joint.get("name", "loop")
    where = f"{path}: loop joint {name}"
    if joint_type not in LOOP_TYPES:
        raise FileError(
            f'{where}: found type "{joint_type}", allowed: {listing(LOOP_TYPES)}'
        )
    ends = [(tag, end) for tag in END_TAGS for end in loop_joint.findall(tag)]
    if len(ends) != 2:
        raise FileError(
            f"{where}: has {counted(len(ends), 'link')}, expected 2: link1 and link2, "
            "predecessor and successor, or parent and child with origins"
        )
    # Put a site (a point with a name) on each of the two links.
    axis_by_name: dict[str, Floats] = {}
    for end_index, (tag, end) in enumerate(ends):
        # Exporters write the position in one of three elements.
        origins = [end.find("origin"), loop_joint.find(f"{tag}_origin"), end]
        origin = next(element for element in origins if element is not None)
        link = end.get("link", "")
        body = spec.body(link)
        if body is None:
            raise FileError(f'{where}: no link "{link}"')
        rotation = Rotation.from_euler("xyz", _read_vector(origin, "rpy"))
        body.add_site(
            name=f"{name}_{end_index}",
            pos=_read_vector(origin, "xyz"),
            quat=rotation.as_quat(scalar_first=True),
        )
        if joint_type in AXIS_LOOP_TYPES and end_index == 0:
            axis_element = loop_joint.find("axis")
            if axis_element is None:
                axis = np.eye(3)[0]  # as for other joints of a URDF
            else:
                axis = _read_vector(axis_element, "xyz")
            if not np.any(axis):
                raise FileError(f"{where}: its axis is zero")
            axis_by_name[name] = rotation.apply(axis) / np.linalg.norm(axis)
    # Add the constraint. A weld holds the positions and orientations of the two sites
    # together, other joints only their positions.
    is_fixed = joint_type == "fixed"
    spec.add_equality(
        name=name,
        name1=f"{name}_0",
        name2=f"{name}_1",
        type=mujoco.mjtEq.mjEQ_WELD if is_fixed else mujoco.mjtEq.mjEQ_CONNECT,
        objtype=mujoco.mjtObj.mjOBJ_SITE,
    )
    return axis_by_name


def _read_vector(element: Element, attribute: str) -> Floats:
    """Return three numbers of an attribute; zeros if the element does not have it.

    Raises
    ------
    ValueError
        If a number is not finite, or no number.
    """
    vector = np.array((element.get(attribute) or "0 0 0").split(), dtype=float)
    if not np.all(np.isfinite(vector)):
        raise ValueError(f"{attribute} has to consist of finite numbers")
    return vector
